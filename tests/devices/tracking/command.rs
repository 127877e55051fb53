//! `greenstage track`: the whole way from a packet to the table.

use crate::common::folder;
use greenstage::stage::BUILT_IN;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::process::{Command, Stdio};

const KEYS: &str = r#"
[tracker.art]
dtrack = "0"
room_from_tracker = { position = [0.0, 1.0, 0.0], axes = [[1, 0, 0], [0, 0, -1], [0, 1, 0]] }
[tracker.pad]
gamepad = "/no/such/js0"
[sensor.head]
tracker = "art"
id = 0
[sensor.wand]
tracker = "art"
id = 1000
[stylus.right]
sensor = "wand"
grab = { tracker = "art", button = 0 }
"#;

fn track(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_greenstage"));
    command.arg("track").args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_packet_is_seen_in_the_table_where_the_calibration_puts_it() {
    let stage = folder("track-command").join("bench.toml");
    std::fs::write(&stage, format!("{}{KEYS}", BUILT_IN[0].1)).unwrap();
    let stage = stage.to_str().unwrap();
    let mut child = track(&[stage, "--json", "--interval", "0.05", "--seconds", "120"]).spawn().unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let unit = "[1 0 0 0 1 0 0 0 1]";
    let mut seen = None;
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        let told: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        let art = &told["trackers"][0];
        let port: u16 = art["source"].as_str().unwrap().rsplit_once(':').unwrap().1.parse().unwrap();
        let time = told["time_s"].as_f64().unwrap();
        let frame = format!(
            "ts {time}\n6d 1 [0 1][100 200 300 0 0 0]{unit}\n6df2 1 1 [0 1 2 1][0 0 500]{unit}[1 0.25]\n"
        );
        sender.send_to(frame.as_bytes(), ("127.0.0.1", port)).unwrap();
        // A busy machine may have lost it for a moment.
        let head = &art["sensors"][0];
        if head["count"].as_u64().unwrap() >= 5 && head["signal"] == "live" && art["link"] == "up" {
            seen = Some(told);
            break;
        }
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let seen = seen.expect("the frames are seen within 120 s");
    let art = &seen["trackers"][0];
    let head = &art["sensors"][0];
    assert_eq!((head["name"].as_str(), head["signal"].as_str()), (Some("head"), Some("live")));
    let place: Vec<f64> = serde_json::from_value(head["in_room"]["position"].clone()).unwrap();
    for (x, expected) in place.iter().zip([0.1, 1.3, -0.2]) {
        assert!((x - expected).abs() < 1e-9, "{place:?}");
    }
    assert_eq!(art["sensors"][1]["name"].as_str(), Some("wand"));
    assert_eq!(art["buttons"][0]["pressed"].as_bool(), Some(true));
    assert_eq!(art["valuators"][0]["value"].as_f64(), Some(0.25));
    assert!(art["link"] == "up", "{seen}");
    assert!(seen["trackers"][1]["link"].as_str().unwrap().starts_with("DOWN"), "{seen}");
}

#[test]
fn once_tells_one_table_and_what_is_missing() {
    let stage = folder("track-once").join("bench.toml");
    std::fs::write(&stage, format!("{}{KEYS}", BUILT_IN[0].1)).unwrap();
    let output = track(&[stage.to_str().unwrap(), "--once", "--seconds", "0.2"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "the pad is not there, and nobody has spoken");
    let told = String::from_utf8(output.stderr).unwrap();
    for part in
        ["nothing was heard from tracker art", "sensor head was never heard", "tracker pad is not there"]
    {
        assert!(told.contains(part), "no `{part}` in\n{told}");
    }
    assert_eq!(text.matches("position (m)").count(), 1, "{text}");
    for part in [
        "head",
        "wand",
        "never heard",
        "art: dtrack on 127.0.0.1:",
        "waiting",
        "pad: gamepad /no/such/js0, DOWN",
    ] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    assert!(!text.contains('\x1b'), "no escape sequences into a pipe");
}

#[test]
fn a_stage_without_trackers_is_refused_with_the_remedy() {
    let output = track(&["workbench"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("names no tracker") && told.contains("greenstage manual tracking"), "{told}");
}
