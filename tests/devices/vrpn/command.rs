//! `greenstage track --serve`: a script served by one program, followed and passed on by a second, heard by a third.

use super::lab::{STEADY, wait};
use crate::common::folder;
use greenstage::stage::{BUILT_IN, Stage};
use greenstage::track::device::Source;
use greenstage::track::vrpn::{Address, Client, Transport};
use greenstage::track::{Script, StylusState};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// A program that is ended with the test, well or not.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `greenstage track` with these arguments, and where it says that it serves.
fn track(arguments: &[&str]) -> (Running, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_greenstage"));
    command.arg("track").args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut running = Running(command.spawn().unwrap());
    let mut said = BufReader::new(running.0.stderr.take().unwrap()).lines().map(Result::unwrap);
    let served = said.by_ref().find_map(|line| line.strip_prefix("serving ").map(str::to_owned));
    // What it says later has somewhere to go.
    std::thread::spawn(move || said.for_each(drop));
    (running, served.expect("an address is told"))
}

#[test]
fn a_script_goes_through_two_programs_to_a_third() {
    let (_script, address) = track(&["--script", "bend", "--serve", "127.0.0.1:0", "--seconds", "300"]);
    assert!(address.starts_with("Tracker0@127.0.0.1:"), "{address}");
    let path = folder("vrpn-command").join("bench.toml");
    let keys = format!(
        "[tracker.lab]\nvrpn = \"{address}\"\n[sensor.wand]\ntracker = \"lab\"\nid = 1\n[stylus.right]\nsensor = \"wand\"\n"
    );
    std::fs::write(&path, BUILT_IN[0].1.to_owned() + &keys).unwrap();
    let options = ["--serve", "127.0.0.1:0", "--json", "--interval", "0.05", "--seconds", "300"];
    let (mut table, address) = track(&[&[path.to_str().unwrap()], &options[..]].concat());
    assert!(address.starts_with("Tracker0@"), "where --tracker lab=HOST looks for it: {address}");
    let mut client = Client::with_timing(Address::parse(&address).unwrap(), Transport::Tcp, STEADY);
    assert_eq!(client.describe(), format!("vrpn {address}"));
    wait("twenty poses have come", || client.latest().sensors.get(&1).is_some_and(|wand| wand.count > 20));

    // They lie on the script's way, to what it moves in half a millisecond.
    let (script, stage) = (Script::find("bend").unwrap(), Stage::find("workbench").unwrap());
    let way: Vec<StylusState> =
        (0..5000).map(|ms| script.sample(&stage, 1e-3 * f64::from(ms)).styli[0]).collect();
    let pose = client.latest().sensors[&1].value;
    let off = |stylus: &StylusState| {
        let stylus = stylus.room_from_stylus.cast::<f64>();
        (stylus.translation.vector - pose.translation.vector).norm()
            + stylus.rotation.angle_to(&pose.rotation)
    };
    let nearest = way.iter().map(off).fold(f64::INFINITY, f64::min);
    assert!(nearest < 3e-3, "{nearest} from the script's way");
    wait("the stylus takes hold", || client.latest().buttons.get(&0).is_some_and(|grab| grab.value));

    // The table of the program between them says the same.
    let lines = BufReader::new(table.0.stdout.take().unwrap()).lines();
    let told: serde_json::Value = lines
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .find(|told: &serde_json::Value| {
            let sensor = &told["trackers"][0]["sensors"][0];
            // A busy machine may have lost it for a moment.
            sensor["count"].as_u64() > Some(20) && sensor["signal"] == "live"
        })
        .unwrap();
    let sensor = &told["trackers"][0]["sensors"][0];
    assert_eq!((sensor["name"].as_str(), sensor["signal"].as_str()), (Some("wand"), Some("live")), "{told}");
}

#[test]
fn a_place_that_is_taken_is_told_with_the_remedy() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let place = taken.local_addr().unwrap().to_string();
    let output = Command::new(env!("CARGO_BIN_EXE_greenstage"))
        .args(["track", "--script", "bend", "--serve", &place, "--seconds", "1"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(&place) && said.contains("--serve ADDRESS:PORT"), "{said}");
}
