//! Tests of the loader: what it refuses, at which line, and with which advice.

use super::*;
use crate::stage::BUILT_IN;

/// The workbench with one piece of its text replaced.
fn workbench_with(from: &str, to: &str) -> Result<Stage, StageError> {
    let text = BUILT_IN[0].1;
    assert!(text.contains(from), "`{from}` is not in the file");
    Stage::parse(&text.replacen(from, to, 1), Path::new("bench.toml"))
}

fn refusal(from: &str, to: &str) -> String {
    workbench_with(from, to).unwrap_err().to_string()
}

fn line_of(needle: &str) -> usize {
    BUILT_IN[0].1.lines().position(|line| line.contains(needle)).unwrap() + 1
}

const WALL_LEFT: &str = "lower_left = [-0.80, 0.90, 0.00]";
const WALL_UP: &str = "upper_left = [-0.80, 2.18, 0.00]";

#[test]
fn a_mirrored_screen_is_named_with_the_corners_to_swap() {
    let text = BUILT_IN[0].1.replace("[-0.80, 0.90, 0.00]      # the", "[0.80, 0.90, 0.00]  # the");
    let text = text.replace("lower_right = [0.80, 0.90, 0.00]", "lower_right = [-0.80, 0.90, 0.00]");
    let text = text.replace(WALL_UP, "upper_left = [0.80, 2.18, 0.00]");
    // The table's upper edge is the wall's lower: put it back.
    let text = text.replace("upper_left = [0.80, 0.90, 0.00]", "upper_left = [-0.80, 0.90, 0.00]");
    let error = Stage::parse(&text, Path::new("bench.toml")).unwrap_err().to_string();
    let line = line_of("name = \"wall\"") - 1;
    assert!(error.starts_with(&format!("bench.toml:{line}: screen `wall` is mirrored")), "{error}");
    assert!(error.contains("swap the left corners with the right ones"), "{error}");
    assert!(error.contains("lower_left = [-0.8000, 0.9000, 0.0000], lower_right = [0.8000,"), "{error}");
}

#[test]
fn an_upside_down_mirrored_screen_is_told_from_one_that_is_left_to_right() {
    let text = BUILT_IN[0].1.replace(WALL_UP, "upper_left = [-0.80, 0.90, 0.00]");
    let text = text.replace(WALL_LEFT, "lower_left = [-0.80, 2.18, 0.00]");
    let text = text.replace("lower_right = [0.80, 0.90, 0.00]", "lower_right = [0.80, 2.18, 0.00]");
    let error = Stage::parse(&text, Path::new("bench.toml")).unwrap_err().to_string();
    assert!(error.contains("`wall` is mirrored"), "{error}");
    assert!(error.contains("swap lower_left with upper_left"), "{error}");
    assert!(error.contains("upper_left = [-0.8000, 2.1800, 0.0000]"), "{error}");
}

#[test]
fn skewed_and_degenerate_screens_are_named_with_the_remedy() {
    let error = refusal(WALL_UP, "upper_left = [-0.75, 2.18, 0.00]");
    assert!(error.contains("screen `wall`: edges meet at 87.76°"), "{error}");
    assert!(error.contains("upper_left [-0.8000, 2.1810, 0.0000]"), "{error}");
    assert!(error.contains("lower 1.600 m, left 1.281 m"), "{error}");
    assert!(error.contains("upper_left 50.0 mm off"), "{error}");
    assert!(
        workbench_with(WALL_UP, "upper_left = [-0.7955, 2.18, 0.00]").is_ok(),
        "a slip of the tape is straightened"
    );
    let error = refusal(WALL_UP, "upper_left = [-0.7945, 2.18, 0.00]");
    assert!(error.contains("upper_left 5.5 mm off, up to 5 mm is straightened"), "{error}");
    for corner in ["[-0.80, 0.90, 0.00]", "[0.80, 0.90, 0.00]", "[2.0, 0.90, 0.00]", "[-800.0, 900.0, 0.0]"] {
        let error = refusal(WALL_UP, &format!("upper_left = {corner}"));
        assert!(error.contains("screen `wall` is ") && error.contains("three different corners"), "{error}");
    }
}

/// One coordinate in centimetres is named, not the two corners that are right; nor is each window of the screen a fault.
#[test]
fn a_corner_in_another_unit_is_named_alone() {
    let text = BUILT_IN[0].1.replacen(
        "lower_right = [0.80, 0.90, 1.28]",
        "lower_right = [0.80, 90, 1.28]",
        1,
    ) + "[[window]]\nscreen = \"table\"\nstereo = \"rows\"\n[[window]]\nscreen = \"wall\"\nstereo = \"rows\"\n";
    let faults = |text: &str| survey(text, Path::new("bench.toml")).unwrap().faults;
    let [LocatedFault { fault, .. }] = &faults(&text)[..] else { panic!("one fault") };
    let told = fault.to_string();
    assert!(told.contains("y of lower_right is 90 m") && told.contains("write 0.9000"), "{told}");
    // All of it in centimetres: the screen cannot be kept, and its window is no second fault.
    let wide =
        BUILT_IN[0].1.replacen("lower_right = [0.80, 0.90, 1.28]", "lower_right = [160, 0.90, 1.28]", 1)
            + "[[window]]\nscreen = \"table\"\nstereo = \"rows\"\n";
    assert_eq!(faults(&wide).len(), 1);
}

#[test]
fn kinds_of_stereo_by_other_words_are_answered() {
    for (word, part) in
        [("active", "3D menu"), ("quad-buffered", "not supported"), ("passive", "polarised glasses")]
    {
        let error = refusal("stereo = \"separate\"", &format!("stereo = \"{word}\""));
        assert!(error.contains(part) && error.starts_with("bench.toml:"), "{error}");
    }
}

#[test]
fn numbers_outside_the_human_and_the_physical_range_are_refused() {
    assert!(refusal("ipd = 0.064", "ipd = 0.64").contains("0.045 to 0.080"));
    assert!(refusal("ipd = 0.064", "ipd = 64").contains("in millimetres? Then write 0.064"));
    assert!(refusal("ipd = 0.064", "ipd = 2.5").contains("in inches? Then write 0.0635"));
    assert!(refusal("[0.0, 1.70, 1.50]", "[0.0, 1700, 1500]").contains("in millimetres? Then write 1.7"));
    assert!(refusal("radius = 0.35", "radius = 350").contains("write 3.5 (in millimetres: 0.35)"));
    assert!(refusal("ipd = 0.064", "ipd = -0.064").contains("ipd is -0.064 m"));
    assert!(refusal("ipd = 0.064", "ipd = nan").contains("0.045 to 0.080"));
    assert!(refusal("ipd = 0.064", "ipd = 0").contains("only where stage and windows are \"mono\""));
    assert!(refusal("[1280, 1024]", "[0, 1024]").contains("`table` has 0 × 1024 pixels"));
    assert!(refusal("[1280, 1024]", "[1280, 102400]").contains("between 1 and 16384"));
    assert!(refusal("radius = 0.35", "radius = -1").contains("the workspace's radius is -1"));
    assert!(
        refusal(WALL_UP, "upper_left = [-0.8, inf, 0.0]").contains("y of upper_left of screen `wall` is inf")
    );
    assert!(refusal("[0.0, 1.70, 1.50]", "[0.0, nan, 1.5]").contains("y of the viewer's position is NaN"));
    assert!(refusal("half_size = 0.80", "half_size = 0").contains("half_size is 0"));
}

#[test]
fn a_mono_stage_needs_no_distance_between_the_eyes() {
    let desktop = BUILT_IN[3].1.replace("ipd = 0.064", "ipd = 0");
    assert_eq!(Stage::parse(&desktop, Path::new("d.toml")).unwrap().viewer.ipd_m, 0.0);
    let with = |kind: &str| {
        let text = format!("{desktop}\n[[window]]\nscreen = \"monitor\"\nstereo = \"{kind}\"\n");
        Stage::parse(&text, Path::new("d.toml"))
    };
    assert!(with("mono").is_ok());
    assert!(with("rows").unwrap_err().to_string().contains("ipd is 0 m"), "a window of it shows two eyes");
}

#[test]
fn names_counts_and_directions_are_checked() {
    let error = refusal("name = \"wall\"", "name = \"table\"");
    let first = line_of("name = \"table\"") - 1;
    assert!(error.contains(&format!("named `table` (the first stands in line {first})")), "{error}");
    assert!(refusal("name = \"wall\"", "name = \"../wall\"").contains("cannot name a screen"));
    assert!(refusal("name = \"workbench\"", "name = \"\"").contains("cannot name a stage"));
    assert!(refusal("target = [0.0, 1.20, 0.50]", "target = [0.0, 1.70, 1.50]").contains("looks nowhere"));
    assert!(refusal("ipd = 0.064", "direction = [0, 0, -1]").contains("keep one"));
    assert!(
        refusal("[0.0, 1.70, 1.50]", "[0.0, 0.905, 1.50]").contains("plane of screen `table` (5.0 mm away)")
    );
    let head = BUILT_IN[0].1.split("[[screen]]").next().unwrap();
    assert!(Stage::parse(head, Path::new("a.toml")).unwrap_err().to_string().contains("no screen"));
}

#[test]
fn unknown_keys_name_the_line_and_the_nearest_key() {
    let error = refusal("upper_left", "uper_left");
    assert!(error.contains("did you mean `upper_left`?"), "{error}");
    let error = refusal("stereo = \"separate\"", "stereo = \"side-by-side\"");
    assert!(error.contains("did you mean \"side_by_side\"?"), "{error}");
}

#[test]
fn without_a_direction_the_viewer_looks_at_the_workspace() {
    let stage = workbench_with("target = [0.0, 1.20, 0.50]", "").unwrap();
    let gaze = stage.viewer.room_from_head.rotation * -Vector3::z();
    assert!(gaze.cross(&(Vector3::new(0.0, 1.15, 0.55) - Vector3::new(0.0, 1.70, 1.50))).norm() < 1e-12);
}

/// Two corners named for each other: one fault, and what it says to write is right.
#[test]
fn swapped_corners_have_one_remedy_and_it_is_right() {
    let text = BUILT_IN[0].1;
    let [left, right, up] = [WALL_LEFT, "lower_right = [0.80, 0.90, 0.00]", WALL_UP];
    let place = |key: &str| key.split(" = ").nth(1).unwrap().to_owned();
    for (from, to, words) in [
        (
            [left, up],
            [format!("lower_left = {}", place(up)), format!("upper_left = {}", place(left))],
            "lower_left and upper_left",
        ),
        (
            [left, right],
            [format!("lower_left = {}", place(right)), format!("lower_right = {}", place(left))],
            "lower_left and lower_right",
        ),
        (
            [up, up],
            ["upper_left = [0.80, 2.18, 0.00]".into(), "upper_left = [0.80, 2.18, 0.00]".into()],
            "is the upper right corner",
        ),
        (
            [right, right],
            ["lower_right = [0.80, 2.18, 0.00]".into(), "lower_right = [0.80, 2.18, 0.00]".into()],
            "lower_right is the upper right",
        ),
    ] {
        // The wall stands after the table, which shares two of its places.
        let (head, wall) = text.split_at(text.find("name = \"wall\"").unwrap());
        let (first, second) = (wall.replace(from[0], "FIRST"), from[1]);
        let wall = first.replace(second, &to[1]).replace("FIRST", &to[0]);
        let faults = survey(&format!("{head}{wall}"), Path::new("bench.toml")).unwrap().faults;
        let [LocatedFault { fault, .. }] = &faults[..] else { panic!("{faults:?}") };
        let told = fault.to_string();
        assert!(told.contains(words), "{told}");
        let remedy = "Write lower_left = [-0.8000, 0.9000, 0.0000], lower_right = [0.8000, 0.9000, 0.0000], upper_left = \
                      [-0.8000, 2.1800, 0.0000]";
        assert!(told.contains(remedy), "{told}");
    }
}

#[test]
fn a_viewer_behind_a_screen_is_told_to_move_and_not_to_swap_corners() {
    let told = |stage: usize, from: &str, to: &str| {
        let text = BUILT_IN[stage].1;
        assert!(text.contains(from));
        let faults = survey(&text.replacen(from, to, 1), Path::new("s.toml")).unwrap().faults;
        faults.iter().map(|located| located.fault.to_string()).collect::<Vec<_>>()
    };
    // Behind the workbench's wall, whose workspace stands before it.
    let [wall] = &told(0, "position = [0.0, 1.70, 1.50]", "position = [0.0, 1.70, -0.60]")[..] else {
        panic!()
    };
    assert!(wall.contains("0.600 m behind screen `wall`, whose front is towards the workspace"), "{wall}");
    assert!(wall.ends_with("position = [0.0000, 1.7000, 0.6000]") && !wall.contains("wap"), "{wall}");
    // The desktop's ball is about its glass: nothing tells which of both is wrong.
    let [both] = &told(3, "position = [0.0, 0.06, 0.60]", "position = [0.0, 0.06, -0.60]")[..] else {
        panic!()
    };
    assert!(
        both.contains("is mirrored: swap the left corners")
            && both.contains("position = [0.0000, 0.0600, 0.6000]")
    );
}

#[test]
fn arrays_of_another_length_are_refused_with_their_line() {
    for (from, to, length) in [
        ("pixels = [1280, 1024]", "pixels = [1280, 1024, 3]", "length 3, expected an array of length 2"),
        ("centre = [0.0, 1.15, 0.55]", "centre = [0.0, 1.15]", "length 2, expected an array of length 3"),
        (WALL_UP, "upper_left = [-0.80, 2.18, 0.00, 1.0]", "length 4, expected an array of length 3"),
    ] {
        let line = line_of(from);
        let error = refusal(from, to);
        assert!(error.starts_with(&format!("bench.toml:{line}:")) && error.contains(length), "{error}");
    }
}

/// The messages about a stage's text, each fault once.
fn told(text: &str) -> Vec<String> {
    let faults = survey(text, Path::new("s.toml")).unwrap().faults;
    faults.iter().map(|located| located.fault.to_string()).collect()
}

/// The wall stands above the table, so that the table faces up, wherever the workspace's ball reaches.
#[test]
fn a_viewer_below_the_table_is_told_where_to_stand() {
    let under = |place: &str| {
        let text = BUILT_IN[0].1.replacen("position = [0.0, 1.70, 1.50]", &format!("position = {place}"), 1);
        let [fault] = &told(&text)[..] else { panic!("one fault") };
        fault.clone()
    };
    let below = under("[0.0, 0.70, 1.50]");
    assert!(below.contains("0.200 m behind screen `table`, whose front is towards screen `wall`"), "{below}");
    assert!(below.ends_with("position = [0.0000, 1.1000, 1.5000]") && !below.contains("wap"), "{below}");
    // Measured where z points up and y away from the viewer.
    let z_up = under("[0.0, -1.50, 1.70]");
    assert!(z_up.contains("with z up, write position = [0.0000, 1.7000, 1.5000]"), "{z_up}");
}

#[test]
fn a_left_handed_file_is_one_fault() {
    let cave = BUILT_IN.iter().find(|(name, _)| *name == "cyberstage").unwrap().1;
    // z of every point, reversed.
    let negate = |line: &str| {
        let is_point = ["position", "target", "centre", "lower_left", "lower_right", "upper_left"]
            .iter()
            .any(|key| line.starts_with(key));
        if !is_point {
            return line.to_owned();
        }
        let (key, rest) = line.split_once('[').unwrap();
        let numbers: Vec<f64> =
            rest.split(']').next().unwrap().split(',').map(|x| x.trim().parse().unwrap()).collect();
        format!("{key}[{}, {}, {}]", numbers[0], numbers[1], -numbers[2])
    };
    let text: String = cave.lines().map(|line| negate(line) + "\n").collect();
    let [fault] = &told(&text)[..] else { panic!("{:?}", told(&text)) };
    assert!(fault.starts_with("screens `left`, `front`, `right` and `floor` face away"), "{fault}");
    assert!(fault.contains("sign of z") && fault.ends_with("position = [0.0000, 1.7000, 0.4000]"), "{fault}");
}

#[test]
fn screens_by_tape_are_turned_by_their_keys() {
    let stage = |tilt: f64, facing: f64| {
        format!(
            "name = \"odd\"\nstereo = \"mono\"\n[viewer]\nposition = [0.5, 1.5, 0.9]\n[workspace]\ncentre = [0.15, 1.2, \
             0.35]\nradius = 0.2\n[[screen]]\nname = \"tilted\"\ncentre = [0.05, 1.1, -0.1]\nwidth = 1.2\nheight = 0.9\n\
             tilt_degrees = {tilt}\nfacing_degrees = {facing}\npixels = [1200, 900]\n"
        )
    };
    assert!(told(&stage(57.0, 25.0)).is_empty());
    for (tilt, facing, keys) in [
        (-57.0, 25.0, "write tilt_degrees = 57"),
        (90.0, -155.0, "write facing_degrees = 25"),
        (180.0, 25.0, "write tilt_degrees = 0"),
    ] {
        let [fault] = &told(&stage(tilt, facing))[..] else { panic!("{:?}", told(&stage(tilt, facing))) };
        assert!(
            fault.contains("faces away") && fault.contains(keys) && !fault.contains("lower_left"),
            "{fault}"
        );
    }
}

#[test]
fn a_screen_in_inches_is_told_so() {
    let text = BUILT_IN[0].1.replacen("[-0.80, 0.90, 1.28]", "[-31.5, 35.43, 50.4]", 1);
    let text = text.replacen("[0.80, 0.90, 1.28]", "[31.5, 35.43, 50.4]", 1);
    let text = text.replacen("upper_left = [-0.80, 0.90, 0.00]", "upper_left = [-31.5, 35.43, 0.0]", 1);
    let [fault] = &told(&text)[..] else { panic!("{:?}", told(&text)) };
    assert!(fault.contains("63.000 × 50.400 m") && fault.contains("in inches 1.600 × 1.280 m"), "{fault}");
}
