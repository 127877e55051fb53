use super::*;

const WAVE: &str = r#"
frame = "workspace"
[[key]]
time = 0.5
head = { offset = [0.0, 0.0, 0.0] }
stylus.right = { position = [1.0, 0.0, 0.0], direction = [0.0, 0.0, -1.0] }
[[key]]
time = 1.0
stylus.right = { pressed = true }
[[key]]
time = 2.0
head = { offset = [0.1, 0.0, 0.0] }
stylus.right = { position = [0.0, 1.0, 0.0], rotation = [0.0, 0.0, 1.0] }
[[key]]
time = 3.0
stylus.right = { pressed = false }
"#;

fn parse(text: &str) -> Result<Script, ScriptError> {
    Script::parse(text, Path::new("wave.toml"))
}

fn refusal(from: &str, to: &str) -> String {
    assert!(WAVE.contains(from));
    parse(&WAVE.replacen(from, to, 1)).unwrap_err().to_string()
}

#[test]
fn poses_are_placed_in_the_stages_workspace_and_what_is_not_stated_holds() {
    let script = parse(WAVE).unwrap();
    let stage = Stage::find("workbench").unwrap();
    assert_eq!(script.duration_s, 3.0);
    let stylus = |t: f64| script.sample(&stage, t).styli[0];
    let start = stylus(0.0);
    assert!(
        (start.room_from_stylus.translation.vector - nalgebra::Vector3::new(0.35, 1.15, 0.55)).norm() < 1e-6
    );
    assert_eq!(stylus(0.8).room_from_stylus, start.room_from_stylus);
    assert_eq!(
        [0.5, 0.99, 1.0, 2.99, 3.0, 9.0].map(|t| stylus(t).pressed),
        [false, false, true, true, false, false]
    );
    assert!((stylus(2.5).room_from_stylus.rotation.angle() - 1.0).abs() < 1e-6);
    assert!((stylus(2.5).room_from_stylus.translation.y - 1.5).abs() < 1e-6);
    let head_x = |t: f64| script.sample(&stage, t).head.unwrap().translation.x;
    assert!((head_x(1.0)).abs() < 1e-7 && (head_x(3.0) - 0.1).abs() < 1e-7);
}

#[test]
fn a_script_is_found_by_name_or_by_path() {
    assert_eq!(Script::find("bend").unwrap().duration_s, 4.0);
    assert!(Script::find("bnd").unwrap_err().to_string().contains("there are `bend`, "));
    assert!(Script::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
}

#[test]
fn styli_come_in_the_stages_order_then_by_name() {
    let key =
        |name: &str, x: f64| format!("stylus.{name} = {{ position = [{x}, 0, 0], target = [0, 0, 1] }}\n");
    let keys = [("hand", 3.0), ("left", 2.0), ("right", 1.0)].map(|(name, x)| key(name, x)).concat();
    let script = parse(&format!("frame = \"room\"\n[[key]]\ntime = 0.0\n{keys}")).unwrap();
    let stage = Stage::find("desktop").unwrap();
    assert_eq!(script.stylus_names(&stage).collect::<Vec<_>>(), ["right", "left", "hand"]);
    let styli = script.sample(&stage, 0.0).styli;
    assert_eq!(styli.iter().map(|s| s.room_from_stylus.translation.x).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
}

#[test]
fn a_script_in_the_room_needs_no_workspace_and_an_unmoved_head_is_untracked() {
    let text = WAVE.replace("workspace", "room").replace("head = ", "# ");
    let state = parse(&text).unwrap().sample(&Stage::find("desktop").unwrap(), 0.5);
    assert_eq!(state.head, None);
    assert_eq!(state.styli[0].room_from_stylus.translation.x, 1.0);
}

#[test]
fn faults_name_file_line_key_frame_and_remedy() {
    let error = refusal("time = 1.0", "time = 0.5");
    assert!(error.starts_with("wave.toml:7: key frame 2: time is 0.5 s, not later than"), "{error}");
    assert!(refusal("time = 0.5", "time = -1").contains("between 0 and 86400"));
    assert!(refusal("time = 3.0", "time = nan").contains("time is NaN"));
    assert!(refusal("position = [1.0, 0.0, 0.0], ", "").contains("stylus `right` has no position"));
    assert!(refusal(", direction = [0.0, 0.0, -1.0]", "").contains("has no orientation"));
    assert!(refusal("[0.0, 0.0, -1.0]", "[0, 0, 0]").contains("points nowhere"));
    assert!(refusal("[0.0, 0.0, -1.0]", "[0, 0, inf]").contains("direction of stylus `right` is inf"));
    assert!(refusal("direction =", "target = [0, 0, 0], direction =").contains("keep one"));
    assert!(refusal("pressed = true", "roll = 1").contains("`roll` without"));
    assert!(
        refusal("rotation = [0.0, 0.0, 1.0]", "rotation = [0, 0, 1], roll = 1").contains("`roll` without")
    );
    assert!(refusal("[0.1, 0.0, 0.0]", "[0.1, 0.0, 0.0], roll = 1").contains("the head has `offset`"));
    let error = refusal("stylus.right = { pressed = true }", "stylus.rihgt = { pressed = true }");
    assert!(error.contains("stylus `rihgt` is not in the first") && error.contains("`right`?"), "{error}");
    assert!(refusal("pressed = true", "presed = true").contains("did you mean `pressed`?"));
    assert!(parse("frame = \"room\"").unwrap_err().to_string().contains("no key frame"));
    let late_head = WAVE.replacen("head = { offset = [0.0, 0.0, 0.0] }", "", 1);
    assert!(parse(&late_head).unwrap_err().to_string().contains("the head is not in the first key frame"));
}
