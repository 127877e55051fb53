//! Report of `bench` on a scene beside the times: where bodies deform, why there, and how much was drawn.

use super::*;
use device::Choice;

/// Frames were counted once for each of their screens: a stage of four that is redrawn 50 times a second had "200 stereo pairs".
#[test]
fn the_choice_and_what_was_drawn_stand_in_the_table_and_in_the_json() {
    let drawn = Drawn {
        samples: 4,
        shadows: Shadows::Soft,
        device: "a device".into(),
        pictures: "4 stereo pairs".into(),
        steps: vec![("deform", 1e-3)],
        frame_s: 0.02,
        shapes: [10.25, 54.0],
        bodies: vec![("tube".into(), Choice::by_time(2e-3, 5e-4))],
    };
    let json = as_json(&[], None, &[], std::slice::from_ref(&drawn), &[]);
    let frame = &json["frames"][0];
    assert_eq!((&frame["shapes_drawn"], &frame["shapes_culled"]), (&json!(10.25), &json!(54.0)));
    assert_eq!(frame["frames_per_s"], json!(50.0));
    let told = json!({ "on": "device", "why": "measured", "cpu_s": 2e-3, "device_s": 5e-4 });
    assert_eq!(frame["deformation"]["tube"], told);
    let (title, table) = frame_table("cyberstage", &[drawn]);
    let text = table.text();
    println!("{title}\n{text}");
    assert!(
        text.contains("4× MSAA, soft shadows")
            && title.contains("each of 4 stereo pairs")
            && text.lines().any(|line| line.starts_with("frames per second") && line.ends_with("50.0"))
            && text.contains("10.2, 54.0")
            && text.contains("deforms on device 0.50 ms, CPU 2.00 ms"),
        "{text}"
    );
}

/// A reading loop that is slower than the loop it limits is no limit, and no ratio is shown.
#[test]
fn a_share_of_the_limit_is_at_most_1() {
    let of = |reading_s| Loop { name: "", time_s: 1e-4, bytes: 1e6, reading_s }.share();
    assert_eq!([of(7.5e-5), of(1e-4), of(1.2e-4)], ["0.75", "1.00", "more: reading was slower"]);
}
