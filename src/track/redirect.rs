//! Takes a tracker's poses from another VRPN server than that of its stage file: from a stand-in, or a second lab.

use super::stand_in::device_names;
use super::vrpn::Address;
use crate::config;
use crate::stage::tracking::{TrackerSource, Tracking};

/// `NAME=HOST`, `NAME=HOST:PORT` or `NAME=DEVICE@HOST:PORT`: a tracker of the stage, and where its device is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Redirect {
    tracker: String,
    place: String,
}

impl std::str::FromStr for Redirect {
    type Err = String;

    fn from_str(text: &str) -> Result<Redirect, String> {
        let parts = text.split_once('=').filter(|(name, place)| !name.is_empty() && !place.is_empty());
        let (tracker, place) =
            parts.ok_or("a tracker of the stage and a host, as lab=127.0.0.1 or lab=127.0.0.1:3884")?;
        let address = if place.contains('@') { place.to_owned() } else { format!("{tracker}@{place}") };
        Address::parse(&address).map_err(|error| error.to_string())?;
        Ok(Redirect { tracker: tracker.to_owned(), place: place.to_owned() })
    }
}

impl Redirect {
    /// Makes trackers those of VRPN there, each as the device by which it is passed on. Their calibrations stay.
    ///
    /// # Errors
    /// A sentence, if the stage has no such tracker.
    pub fn apply_all(redirects: &[Redirect], tracking: &mut Tracking) -> Result<(), String> {
        let devices = device_names(tracking);
        redirects.iter().try_for_each(|redirect| redirect.apply(tracking, &devices))
    }

    fn apply(&self, tracking: &mut Tracking, devices: &[String]) -> Result<(), String> {
        let Some(index) = tracking.trackers.get_index_of(&self.tracker) else {
            let known = tracking.trackers.keys().map(String::as_str);
            return Err(config::unknown_name("tracker", &self.tracker, known));
        };
        let (tracker, device) = (&mut tracking.trackers[index], &devices[index]);
        let TrackerSource::Table(table) = &mut tracker.source else {
            return Err(format!("tracker `{}` is a force device, which stays where it is", self.tracker));
        };
        let vrpn =
            if self.place.contains('@') { self.place.clone() } else { format!("{device}@{}", self.place) };
        table.keys = [("vrpn".to_owned(), vrpn.into())].into_iter().collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::{BUILT_IN, Stage};
    use std::path::Path;

    #[test]
    fn a_tracker_keeps_its_device_and_its_calibration() {
        let keys = "[tracker.lab]\nvrpn = \"Head3@tracker.lab:4000\"\ntransport = \"lob\"\n\
                    room_from_tracker = { scale = 0.0254 }\n[tracker.art]\ndtrack = \"0\"\n";
        let text = format!("{}{keys}", BUILT_IN[0].1);
        let tracking = Stage::parse(&text, Path::new("bench.toml")).unwrap().tracking;
        let to = |text: &str| {
            let mut moved = tracking.clone();
            Redirect::apply_all(&[text.parse().unwrap()], &mut moved).map(|()| moved)
        };
        for (text, tracker, source) in [
            ("lab=127.0.0.1", "lab", "vrpn Head3@127.0.0.1"),
            ("lab=[::1]:3884", "lab", "vrpn Head3@[::1]:3884"),
            ("lab=Other@127.0.0.1", "lab", "vrpn Other@127.0.0.1"),
            ("art=127.0.0.1", "art", "vrpn art@127.0.0.1"),
        ] {
            let moved = to(text).unwrap();
            assert_eq!(moved.trackers[tracker].source.to_string(), source);
            assert_eq!(moved.trackers[tracker].frame, tracking.trackers[tracker].frame);
        }
        let unknown = to("lap=127.0.0.1").unwrap_err();
        assert!(unknown.contains("did you mean \"lab\"?"), "{unknown}");
        for wrong in ["lab", "=127.0.0.1", "lab=", "lab=a b", "lab=127.0.0.1:0"] {
            assert!(wrong.parse::<Redirect>().is_err(), "{wrong}");
        }
    }
}
