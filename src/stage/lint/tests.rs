//! Tests of the findings: each thing that display walls get wrong is found, named and given its number.

use super::*;
use crate::stage::BUILT_IN;
use std::path::Path;

/// The findings about the text of a stage on these monitors; `error: entity: text`.
fn found_on(monitors: &[Monitor], text: &str) -> Vec<String> {
    let stage = Stage::parse(text, Path::new("bench.toml")).unwrap();
    let line =
        |lint: Diagnostic| format!("{:?}: {}: {}", lint.severity, lint.place, lint.message).to_lowercase();
    lint(&stage, monitors).into_iter().map(line).collect()
}

/// The text of a built-in stage with more at its end.
fn with(name: &str, more: &str) -> String {
    let text = BUILT_IN.iter().find(|(known, _)| *known == name).unwrap().1;
    format!("{text}\n{more}")
}

fn found(name: &str) -> Vec<String> {
    found_on(&[], &with(name, ""))
}

/// The findings about the workbench with a piece of its text replaced.
fn changed(from: &str, to: &str) -> Vec<String> {
    let text = with("workbench", "");
    assert!(text.contains(from), "`{from}` is not in the file");
    found_on(&[], &text.replacen(from, to, 1))
}

/// The findings about the workbench with more at its end.
fn more(monitors: &[Monitor], more: &str) -> Vec<String> {
    found_on(monitors, &with("workbench", more))
}

fn has(found: &[String], parts: &[&str]) {
    assert!(
        found.iter().any(|line| parts.iter().all(|part| line.contains(&part.to_lowercase()))),
        "no {parts:?} in {found:#?}"
    );
}

fn worse_than_notes(found: &[String]) -> Vec<&String> {
    found.iter().filter(|line| !line.starts_with("note") && !line.starts_with("detail")).collect()
}

#[test]
fn a_right_stage_has_no_more_than_notes() {
    for name in ["workbench", "workbench-one-sided", "desktop", "cave3", "cave6", "laptop"] {
        let found = found(name);
        assert!(worse_than_notes(&found).is_empty(), "{name}: {found:#?}");
        has(&found, &["note: viewer.head", "no sensor"]);
    }
    has(&found("workbench"), &["upper edge of table and lower edge of wall meet within 0.0 mm"]);
}

#[test]
fn gaps_overlaps_and_ends_are_told_in_millimetres() {
    has(&found("lbench"), &["warning: seam.front-table", "leave a gap of 14.1 mm"]);
    let bezels = found("powerwall");
    assert_eq!(bezels.iter().filter(|line| line.contains("leave a gap of 3.5 mm")).count(), 4, "{bezels:#?}");
    let off = changed("lower_right = [0.80, 0.90, 0.00]", "lower_right = [0.805, 0.90, 0.00]");
    let ends = "the second ends 5.0 mm beyond the first at one end";
    has(&off, &["warning: seam.table-wall", ends]);
    let mut stage = Stage::find("workbench").unwrap();
    let wall = &mut stage.screens[1];
    for corner in [&mut wall.lower_left, &mut wall.lower_right, &mut wall.upper_left] {
        corner.x += 0.001;
    }
    let told: String = lint(&stage, &[]).into_iter().map(|lint| lint.message).collect();
    assert!(told.contains("the second is shifted by 1.0 mm along the first"), "{told}");
}

#[test]
fn pixels_that_are_not_square_and_corners_that_are_off_are_told() {
    has(
        &found("cyberstage"),
        &["warning: screen.floor", "0.800 times as wide as high, 2.344 × 2.930 mm", "2.4000 m high"],
    );
    let skew = changed("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [-0.7992, 2.18, 0.00]");
    has(&skew, &["note: screen.wall", "0.8 mm off a rectangle"]);
    let slip = changed("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [-0.7985, 2.18, 0.00]");
    has(&slip, &["warning: screen.wall", "1.5 mm off a rectangle", "[-0.8000, 2.1800, 0.0000]"]);
}

#[test]
fn screens_that_lean_the_wrong_way_or_stand_alone_are_told() {
    let forward = changed("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [-0.80, 2.175, 0.112]");
    has(&forward, &["warning: screen.wall", "leans forward by 5.0°", "112 mm nearer", "tilt_degrees = 85.0"]);
    let back = changed("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [-0.80, 2.175, -0.112]");
    assert!(worse_than_notes(&back).is_empty(), "{back:#?}");
    has(&back, &["note: screen.wall", "leans back by 5.0° (tilt 85.0°)", "0.900 to 2.175 m high"]);
    // The table's rear edge is as much too low as it should be high.
    let falls = changed("upper_left = [-0.80, 0.90, 0.00]", "upper_left = [-0.80, 0.714, 0.00]");
    has(&falls, &["warning: screen.table", "falls by 8.3°", "186 mm lower"]);
    has(
        &falls,
        &["warning: screen.table", "nearest edges, upper edge of table and lower edge of wall, are 186 mm"],
    );
    assert_eq!(
        falls.iter().filter(|line| line.contains("nearest edges")).count(),
        1,
        "told once: {falls:#?}"
    );
}

#[test]
fn trackers_that_do_nothing_or_are_in_another_unit_are_told() {
    let tracking = |scale: &str, grab: &str| {
        more(
            &[],
            &format!(
                "[tracker.lab]\nvrpn = \"Tracker0@lab\"\nroom_from_tracker = {{ scale = {scale} }}\n[sensor.pen]\n\
                 tracker = \"lab\"\nid = 1\n[sensor.idle]\ntracker = \"lab\"\nid = 2\n[stylus.right]\n\
                 sensor = \"pen\"\n{grab}\n"
            ),
        )
    };
    let wrong = tracking("25.4", "");
    has(&wrong, &["warning: tracker.lab.room_from_tracker: scale = 25.4", "write 0.0254?"]);
    has(&wrong, &["warning: stylus.right", "no `grab`"]);
    has(&wrong, &["warning: sensor.idle", "nothing uses it"]);
    let right = tracking("0.0254", "grab = { tracker = \"lab\", button = 0 }");
    assert_eq!(worse_than_notes(&right).len(), 1, "the idle sensor alone: {right:#?}");
}

#[test]
fn viewers_are_judged() {
    has(&changed("ipd = 0.064", "ipd = 0.050"), &["note: viewer.ipd", "50.0 mm apart are rare"]);
    let low = changed("position = [0.0, 1.70, 1.50]", "position = [0.0, 0.93, 1.70]");
    has(&low, &["warning: screen.table", "under 1.6° to its plane"]);
    let far = changed("position = [0.0, 1.70, 1.50]", "position = [0.0, 8.0, 9.0]");
    has(&far, &["warning: viewer.position", "are all numbers metres?"]);
    let centimetres = changed("position = [0.0, 1.70, 1.50]", "position = [0.0, 170.0, 150.0]");
    has(&centimetres, &["error: viewer.position", "are all numbers metres?"]);
    let aside = changed("centre = [0.0, 1.15, 0.55]", "centre = [0.0, 1.15, 3.0]");
    has(&aside, &["warning: workspace.centre", "on no screen"]);
}

/// Two windows per screen: left and right eye at these places.
fn pairs(places: [[i32; 2]; 4]) -> String {
    let of = |(i, at): (usize, [i32; 2])| {
        let (screen, eye) = (["wall", "table"][i / 2], ["left", "right"][i % 2]);
        format!(
            "[[window]]\nname = \"{screen} {eye}\"\nscreen = \"{screen}\"\nstereo = \"{eye}\"\nat = {at:?}\n"
        )
    };
    places.into_iter().enumerate().map(of).collect()
}

fn monitors(count: i32) -> Vec<Monitor> {
    (0..count).map(|i| Monitor { name: format!("DP-{i}"), at: [1280 * i, 0], size: [1280, 2048] }).collect()
}

#[test]
fn a_place_that_two_screens_show_is_told_in_millimetres() {
    let with = |more: &str| found_on(&[], &with("desktop", more));
    let stage = Stage::find("desktop").unwrap();
    let screen = &stage.screens[0];
    let beside = |by_m: f64| {
        let corner = |corner: Point3<f64>| format!("[{}, {}, {}]", corner.x + by_m, corner.y, corner.z);
        let [left, right, up] = [screen.lower_left, screen.lower_right, screen.upper_left].map(corner);
        format!(
            "[[screen]]\nname = \"other\"\nlower_left = {left}\nlower_right = {right}\nupper_left = {up}\n\
             pixels = [1920, 1080]\n"
        )
    };
    has(&with(&beside(0.0)), &["error: seam.monitor-other", "have the same corners"]);
    let text = format!("overlap by 200.0 × {:.1} mm", screen.height_m() * 1e3);
    let overlap = with(&beside(screen.width_m() - 0.2));
    has(&overlap, &["warning: seam.monitor-other", &text]);
    assert_eq!(overlap.iter().filter(|line| line.contains("seam.")).count(), 1, "told once: {overlap:#?}");
    has(&with(&beside(screen.width_m())), &["detail: seam.monitor-other", "meet within 0.0 mm"]);
}

#[test]
fn pixels_on_mirrored_monitors_count_once() {
    let mut monitors = monitors(1);
    monitors.push(Monitor { name: "clone".into(), ..monitors[0].clone() });
    let half = "[[window]]\nscreen = \"wall\"\nstereo = \"mono\"\nat = [640, 0]\n";
    let found = more(&monitors, half);
    has(
        &found,
        &["warning: window.window 1", "50 % of its 1280 × 1024 pixels at (640, 0) lie on no monitor"],
    );
}

#[test]
fn eyes_swapped_between_monitors_are_told() {
    let of = |eye: &str, monitor: usize| {
        format!("[[window]]\nname = \"{eye}\"\nscreen = \"wall\"\nstereo = \"{eye}\"\nmonitor = {monitor}\n")
    };
    let judged = |left, right| more(&monitors(2), &(of("left", left) + &of("right", right)));
    has(&judged(1, 0), &["warning: screen.wall", "right of the right eye's"]);
    assert!(!judged(0, 1).iter().any(|line| line.contains("right of the right eye's")));
}

#[test]
fn swapped_and_missing_eyes_are_told() {
    let right = more(&monitors(2), &pairs([[0, 0], [1280, 0], [0, 1024], [1280, 1024]]));
    assert!(worse_than_notes(&right).is_empty(), "{right:#?}");
    let swapped = more(&monitors(2), &pairs([[0, 0], [1280, 0], [1280, 1024], [0, 1024]]));
    has(&swapped, &["warning: screen.table", "right of the right eye's, unlike those of 1 other"]);
    let both = more(&monitors(2), &pairs([[1280, 0], [0, 0], [1280, 1024], [0, 1024]]));
    for screen in ["wall", "table"] {
        has(&both, &[&format!("warning: screen.{screen}"), "right of the right eye's: are"]);
    }
    let text = with("workbench", &pairs([[0, 0], [1280, 0], [0, 1024], [1280, 1024]]));
    let all_swapped = found_on(&monitors(2), &format!("swap_eyes = true\n{text}"));
    for screen in ["wall", "table"] {
        has(&all_swapped, &[&format!("warning: screen.{screen}"), "right of the right eye's: are"]);
    }
    let one = "[[window]]\nscreen = \"wall\"\nstereo = \"left\"\n";
    let missing = more(&[], one);
    has(&missing, &["warning: screen.table", "no window shows it"]);
    has(&missing, &["warning: screen.wall", "to the left eye alone"]);
    let swap = changed("[viewer]", "swap_eyes = true\n[viewer]");
    has(&swap, &["note: swap_eyes"]);
    let of_window =
        more(&[], "[[window]]\nname = \"w\"\nscreen = \"wall\"\nstereo = \"rows\"\nswap_eyes = true\n");
    has(&of_window, &["note: window.w.swap_eyes: on wall, each eye"]);
}

#[test]
fn windows_off_the_monitors_or_over_each_other_are_told() {
    let places = [[0, 0], [1280, 0], [0, 1024], [1280, 1024]];
    let found_on = |places, monitors: &[Monitor]| more(monitors, &pairs(places));
    let off = found_on(places, &monitors(1));
    has(
        &off,
        &["error: window.wall right", "100 % of its 1280 × 1024 pixels at (1280, 0) lie on no monitor"],
    );
    let over = found_on([[0, 0], [1280, 0], [0, 1000], [1280, 1024]], &monitors(2));
    has(&over, &["warning: window.table left", "30720 of its pixels lie under or over window `wall left`"]);
    let same = found_on([[0, 0], [0, 0], [0, 1024], [1280, 1024]], &monitors(2));
    has(&same, &["error: window.wall right", "stand in one place"]);
    let partly = found_on([[-128, 0], [1280, 0], [0, 1024], [1280, 1024]], &monitors(2));
    has(&partly, &["warning: window.wall left", "10 %"]);
    let absent = "[[window]]\nscreen = \"wall\"\nstereo = \"rows\"\nmonitor = \"HDMI-7\"\n";
    let absent = more(&monitors(2), absent);
    has(&absent, &["error: window.window 1", "no monitor `hdmi-7`; there are `dp-0`, `dp-1`"]);
}

#[test]
fn tiles_of_other_sizes_than_their_screens_are_told() {
    let woven = "[[window]]\nscreen = \"wall\"\nstereo = \"rows\"\nat = [0, 0]\nsize = [640, 512]\n";
    has(&more(&[], woven), &["note: window.window 1", "its own are 1280 × 1024"]);
    let packed = "[[window]]\nscreen = \"wall\"\nstereo = \"frame_packing\"\nat = [0, 0]\n";
    has(&more(&[], packed), &["frame packing takes 1920 × 2205", "not 1280 × 2091"]);
}

/// A built-in stage with the corners of one screen named anew: lower left, lower right and upper left are those corners of
/// its own, counted from its lower left one towards its lower right one.
fn renamed(name: &str, screen: &str, corners: [usize; 3]) -> Vec<String> {
    let mut stage = Stage::find(name).unwrap();
    let screen = stage.screens.iter_mut().find(|known| known.name == screen).unwrap();
    let around = [screen.lower_left, screen.lower_right, screen.upper_right(), screen.upper_left];
    [screen.lower_left, screen.lower_right, screen.upper_left] = corners.map(|corner| around[corner]);
    let line =
        |lint: Diagnostic| format!("{:?}: {}: {}", lint.severity, lint.place, lint.message).to_lowercase();
    lint(&stage, &[]).into_iter().map(line).collect()
}

#[test]
fn pictures_that_are_turned_in_their_plane_are_told_with_the_corners_to_write() {
    for (stage, screen, corners, told, written) in [
        (
            "workbench",
            "wall",
            [2, 3, 1],
            "stands on its head",
            "lower_left = [-0.8000, 0.9000, 0.0000], lower_right = [0.8000, 0.9000, 0.0000], upper_left = [-0.8000, 2.1800, \
             0.0000] (by tape measure tilt_degrees = 90.0, facing_degrees = 0.0)",
        ),
        (
            "cave6",
            "left",
            [1, 2, 0],
            "called its right edge is the upper one",
            "lower_left = [-1.5000, 0.0000, 1.5000], lower_right = [-1.5000, 0.0000, -1.5000]",
        ),
        (
            "cave6",
            "front",
            [3, 0, 2],
            "called its left edge is the upper one",
            "lower_left = [-1.5000, 0.0000, -1.5000], lower_right = [1.5000, 0.0000, -1.5000]",
        ),
        (
            "workbench",
            "table",
            [2, 3, 1],
            "turned by 180°: screen `wall`, the wall at the front, is at its lower edge",
            "lower_left = [-0.8000, 0.9000, 1.2800], lower_right = [0.8000, 0.9000, 1.2800]",
        ),
        (
            "cave6",
            "floor",
            [1, 2, 0],
            "turned by 90°: screen `front`, the wall at the front, is at its right edge",
            "lower_left = [-1.5000, 0.0000, 1.5000], lower_right = [1.5000, 0.0000, 1.5000]",
        ),
        (
            "cave6",
            "ceiling",
            [2, 3, 1],
            "is at its upper edge, where a ceiling has its lower one",
            "lower_left = [-1.5000, 3.0000, -1.5000], lower_right = [1.5000, 3.0000, -1.5000]",
        ),
        (
            "workbench-one-sided",
            "table",
            [2, 3, 1],
            "the viewer stands at its upper edge",
            "lower_left = [-0.8000, 0.8500, 1.2800], lower_right = [0.8000, 0.8500, 1.2800]",
        ),
    ] {
        let told = [&format!("warning: screen.{screen}: its picture"), told, written];
        has(&renamed(stage, screen, corners), &told);
        let right = renamed(stage, screen, [0, 1, 3]);
        assert!(!right.iter().any(|line| line.contains("its picture")), "{stage}: {right:#?}");
    }
}

#[test]
fn displays_that_are_mounted_on_their_side_and_corners_of_rooms_are_no_mistakes() {
    // 1920 × 1080 square pixels on a panel whose left edge is the lower one.
    let portrait = "name = \"portrait\"\nstereo = \"mono\"\n[viewer]\nposition = [0, 1.6, 1.5]\n[workspace]\ncentre = [0, 1.6, \
                    0]\nradius = 0.2\n[[screen]]\nname = \"panel\"\nlower_left = [-0.3, 2.1, 0]\nlower_right = [-0.3, 1.1, 0]\n\
                    upper_left = [0.2625, 2.1, 0]\npixels = [1920, 1080]\n";
    let found = found_on(&[], portrait);
    assert!(worse_than_notes(&found).is_empty(), "{found:#?}");
    has(&found, &["note: screen.panel", "lies on its side", "mounted so"]);
    // Where walls stand all around, those that the viewer looks at are the front: both of a corner.
    let with_walls = |direction: &str| {
        let text =
            with("cave6", "").replace("target = [0.0, 1.30, -0.60]", &format!("direction = {direction}"));
        found_on(&[], &text.replace("\"front\"", "\"wall\""))
    };
    assert!(worse_than_notes(&with_walls("[-1, 0, -1]")).is_empty());
    let aside = with_walls("[-1, 0, 0]");
    has(&aside, &["warning: screen.floor", "screen `left`, the wall at the front, is at its left edge"]);
    // Of three walls the middle one is the front, wherever the viewer looks.
    let text = with("cyberstage", "").replace("\"front\"", "\"wall\"");
    let aside = found_on(&[], &text.replace("target = [0.0, 1.20, -0.60]", "direction = [-1, 0, 0]"));
    assert!(!aside.iter().any(|line| line.contains("its picture")), "{aside:#?}");
}

#[test]
fn a_table_that_hangs_below_its_wall_is_told_to_face_up() {
    let mut stage = Stage::find("workbench").unwrap();
    let table = &mut stage.screens[0];
    (table.lower_left, table.lower_right) = (table.lower_right, table.lower_left);
    table.upper_left.x = -table.upper_left.x;
    stage.viewer.room_from_head.translation.y = 0.7;
    let found = lint(&stage, &[]);
    let told = &found.iter().find(|finding| finding.message.contains("face down,")).unwrap().message;
    assert!(
        told.contains("`wall`, stand on its back") && told.contains("lower_left = [-0.8000, 0.9000, 1.2800]"),
        "{told}"
    );
}

/// The findings about the loudspeakers of the CyberStage with a piece of its text replaced.
fn heard(from: &str, to: &str) -> Vec<String> {
    let text = with("cyberstage", "");
    assert!(text.contains(from), "`{from}` is not in the file");
    let found = found_on(&[], &text.replacen(from, to, 1));
    found.into_iter().filter(|line| line.contains("loudspeaker") || line.contains("sound")).collect()
}

#[test]
fn loudspeakers_are_listed_as_the_viewer_hears_them() {
    let found = heard("[sound]", "[sound]");
    assert_eq!((found.len(), worse_than_notes(&found).len()), (8, 0), "{found:#?}");
    has(
        &found,
        &["loudspeaker.1: floor front left at [-1.5000, 0.0000, -1.5000] m, 2.96 m away, 38° left, 35° down"],
    );
    has(&heard("output = \"loudspeakers\"", "output = \"stereo\""), &["note: sound.output", "leaves the 8"]);
}

#[test]
fn loudspeakers_that_cannot_be_right_are_named_with_the_remedy() {
    let left = "position = [-1.5, 2.4, -1.5]";
    has(
        &heard(left, "position = [1.5, 2.4, -1.5]"),
        &["warning: loudspeaker.5", "says left", "38° right", "exchange"],
    );
    has(&heard(left, "position = [1.5, 2.4, -1.5]"), &["loudspeaker.6", "where loudspeaker 5 stands"]);
    has(
        &heard(left, "position = [-1.45, 0.1, -1.5]"),
        &["loudspeaker.5", "1.5° from loudspeaker 1, below 5°"],
    );
    has(&heard(left, "position = [-0.1, 1.7, 0.3]"), &["loudspeaker.5", "0.14 m from the viewer"]);
    let low = with("cyberstage", "").replace("2.4, -1.5]\n\n[[loudspeaker", "1.6, -1.5]\n\n[[loudspeaker");
    let low = low.replace("position = [1.5, 2.4, -1.5]", "position = [1.5, 1.6, -1.5]");
    let low = low
        .replace("2.4, 1.5]\n\n[[loud", "1.6, 1.5]\n\n[[loud")
        .replace("[1.5, 2.4, 1.5]", "[1.5, 1.6, 1.5]");
    has(&found_on(&[], &low), &["warning: loudspeakers: nothing sounds from above", "° aside"]);
    let front = with("cyberstage", "").replace(", 1.5]\n\n", ", -1.5]\n\n");
    let front = front.replace("position = [1.5, 2.4, 1.5]", "position = [1.5, 2.4, -1.5]");
    has(&found_on(&[], &front), &["warning: loudspeakers: nothing sounds from behind"]);
    let to_the_left = front.replace("target = [0.0, 1.20, -0.60]", "direction = [-1, 0, 0]");
    has(&found_on(&[], &to_the_left), &["warning: loudspeakers: nothing sounds from left"]);
}
