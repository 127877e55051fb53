//! What is doubtful about where a tracker says that head and styli are: another unit, or a head that is turned.
//!
//! In: a stage and what its trackers report. Out: sentences with numbers and the keys to change. A wrong unit is no error in
//! the file, and a picture only goes black by it.

use super::tracker_set::{SensorReport, TrackerReport};
use crate::stage::{MIN_EYE_DISTANCE_M, Screen, Stage};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// A sensor of a stage, and what is doubtful about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Doubt {
    pub sensor: String,
    pub kind: DoubtKind,
    pub text: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DoubtKind {
    /// Farther from every screen than anyone stands.
    Far,
    /// A head that sees no screen from before.
    Behind,
    /// A head whose top does not point up.
    Turned,
}

/// Nobody is farther from the nearest screen than this, m, or than three times the distance of the stage's viewer.
const FAR_M: f64 = 5.0;
/// A place so near to where head or hand is expected proves a unit, m.
const EXPECTED_M: f64 = 1.5;
/// A head is turned if its top is so far from the vertical, degrees: who looks at a table bends by less.
const TURNED: f64 = 65.0;
/// A sensor's axes are named if they are so near to the room's, as a cosine: 25°.
const ALONG: f64 = 0.906;
/// Units of trackers, m.
const UNITS: [(f64, &str); 5] =
    [(1.0, "metres"), (0.0254, "inches"), (0.01, "centimetres"), (0.001, "millimetres"), (0.3048, "feet")];

/// The doubts about all sensors that the stage names and a tracker has reported.
pub fn doubts(stage: &Stage, reports: &[TrackerReport]) -> Vec<Doubt> {
    let sensors = reports.iter().flat_map(|report| &report.sensors);
    sensors.flat_map(|sensor| of_sensor(stage, sensor).unwrap_or_default()).collect()
}

fn of_sensor(stage: &Stage, report: &SensorReport) -> Option<Vec<Doubt>> {
    let name = report.name.clone()?;
    let room_from_body = report.in_room.filter(|_| report.count > 0)?;
    let is_head = stage.tracking.head.as_ref() == Some(&name);
    let place = Point3::from(room_from_body.translation.vector);
    let doubt = |kind, text| Doubt { sensor: name.clone(), kind, text };
    let viewer = Point3::from(stage.viewer.room_from_head.translation.vector);
    let away_m = nearest_m(stage, &place);
    let unit = || unit(stage, &name, &room_from_body, if is_head { viewer } else { stage.workspace.centre });
    if away_m > FAR_M.max(3.0 * nearest_m(stage, &viewer)) {
        let text = format!("sensor {name} is {away_m:.1} m from the nearest screen: {}", unit());
        return Some(vec![doubt(DoubtKind::Far, text)]);
    }
    if !is_head {
        return None;
    }
    let before = stage.screens.iter().map(|screen| (screen.distance_m(&place), screen));
    let farthest = before.max_by(|a, b| a.0.total_cmp(&b.0));
    let behind = farthest.filter(|(distance_m, _)| *distance_m < MIN_EYE_DISTANCE_M);
    let behind = behind.map(|(distance_m, Screen { name: screen, .. })| {
        let text = format!(
            "sensor {name} is behind the plane of every screen, {:.3} m behind `{screen}`: all stay black; {}",
            -distance_m,
            unit()
        );
        doubt(DoubtKind::Behind, text)
    });
    let turned = turned(stage, &name, &room_from_body).map(|text| doubt(DoubtKind::Turned, text));
    Some(behind.into_iter().chain(turned).collect())
}

fn nearest_m(stage: &Stage, place: &Point3<f64>) -> f64 {
    stage.screens.iter().map(|screen| screen.away_m(place)).fold(f64::INFINITY, f64::min)
}

/// Which unit would bring the sensor to where it is expected, and what to write then.
fn unit(stage: &Stage, name: &str, room_from_body: &Isometry3<f64>, expected: Point3<f64>) -> String {
    let sensor = stage.tracking.sensors.get(name);
    let tracker = sensor.and_then(|sensor| stage.tracking.trackers.get_key_value(&sensor.tracker));
    let (Some(sensor), Some((tracker, found))) = (sensor, tracker) else { return String::new() };
    let (origin, scale) =
        (found.frame.room_from_tracker.isometry.translation.vector, found.frame.room_from_tracker.scaling());
    let room_from_sensor = room_from_body * sensor.sensor_from_body.inverse();
    let from_origin = room_from_sensor.translation.vector - origin;
    let off_m = |unit: f64| {
        let moved = from_origin * (unit / scale - 1.0);
        (Point3::from(room_from_body.translation.vector + moved) - expected).norm()
    };
    let others = UNITS.into_iter().filter(|(unit, _)| (unit / scale - 1.0).abs() > 0.1);
    let best = others.min_by(|a, b| off_m(a.0).total_cmp(&off_m(b.0)));
    match best.filter(|(unit, _)| off_m(*unit) < EXPECTED_M) {
        Some((unit, called)) => format!(
            "if tracker `{tracker}` reports {called}, write scale = {unit} into its room_from_tracker (now {scale}): it would \
             be {:.2} m from where it is expected",
            off_m(unit)
        ),
        None => format!(
            "check scale, axes and position in room_from_tracker of tracker `{tracker}`, and how the sensor is mounted"
        ),
    }
}

/// A head that lies on its side, and the axes that put it upright if it looks along -z now.
fn turned(stage: &Stage, name: &str, room_from_body: &Isometry3<f64>) -> Option<String> {
    let up = room_from_body.rotation * Vector3::y();
    let degrees = up.angle(&Vector3::y()).to_degrees();
    if degrees < TURNED {
        return None;
    }
    let sensor = stage.tracking.sensors.get(name)?;
    let room_from_sensor = (room_from_body.rotation * sensor.sensor_from_body.rotation.inverse())
        .to_rotation_matrix()
        .into_inner();
    let words = [["to the right", "to the left"], ["up", "down"], ["backwards", "forwards"]];
    let top = words[up.iamax()][usize::from(up[up.iamax()] < 0.0)];
    let remedy = match along_room(&room_from_sensor) {
        Some(axes) => format!(
            "if the wearer looks straight along -z now, body_from_sensor needs axes = [{}]",
            axes.map(|[x, y, z]| format!("[{x}, {y}, {z}]")).join(", ")
        ),
        None => "have the wearer look straight along -z, and read this again".to_owned(),
    };
    Some(format!("sensor {name}: the head is turned by {degrees:.0}°, its top points {top}: {remedy}"))
}

/// The room's axes along which a sensor's x, y and z axes point.
fn along_room(room_from_sensor: &Matrix3<f64>) -> Option<[[i32; 3]; 3]> {
    let mut axes = [[0; 3]; 3];
    for (axis, column) in axes.iter_mut().zip(room_from_sensor.column_iter()) {
        let k = column.iamax();
        axis[k] = column[k].signum() as i32;
        if column[k].abs() < ALONG {
            return None;
        }
    }
    Some(axes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;
    use crate::track::FakeSource;
    use crate::track::device::now_s;
    use crate::track::tracker_set::TrackerSet;
    use std::path::Path;

    /// Doubts about a head, whose raw pose this is, before the workbench: a tracker with z up on the floor below the wall.
    fn told(frame: &str, mount: &str, raw: Isometry3<f64>) -> Vec<Doubt> {
        let text = BUILT_IN[0].1.replacen("[viewer]", "[viewer]\nhead = \"head\"", 1);
        let keys = format!(
            "[tracker.lab]\nvrpn = \"Tracker0@lab\"\n\
             room_from_tracker = {{ axes = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]{frame} }}\n\
             [sensor.head]\ntracker = \"lab\"\nid = 0\n{mount}\n"
        );
        let stage = Stage::parse(&format!("{text}{keys}"), Path::new("bench.toml")).unwrap();
        let source = FakeSource::default();
        let mut trackers = TrackerSet::with_sources(&stage.tracking, vec![Box::new(source.clone())], now_s());
        source.change(|device| device.take_pose(0, raw, None, 1.0));
        doubts(&stage, &trackers.report(now_s()))
    }

    /// The viewer stands at (0, 1.70, 1.50) in the room, which is (0, -59, 67) inches for the tracker.
    const INCHES: [f64; 3] = [0.0, -59.06, 66.93];
    const LEVEL: &str = "body_from_sensor = { axes = [[1, 0, 0], [0, 0, -1], [0, 1, 0]] }";

    fn at([x, y, z]: [f64; 3]) -> Isometry3<f64> {
        Isometry3::translation(x, y, z)
    }

    #[test]
    fn inches_that_are_read_as_metres_are_told_with_the_scale_to_write() {
        let found = told("", LEVEL, at(INCHES));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!((doubt.kind, doubt.sensor.as_str()), (DoubtKind::Far, "head"));
        for part in ["m from the nearest screen", "reports inches, write scale = 0.0254", "(now 1)", "0.00 m"]
        {
            assert!(doubt.text.contains(part), "no `{part}` in {}", doubt.text);
        }
        assert_eq!(told(", scale = 0.0254", LEVEL, at(INCHES)), []);
        let centimetres = told("", LEVEL, at([0.0, -150.0, 170.0]));
        assert!(centimetres[0].text.contains("write scale = 0.01 "), "{centimetres:?}");
        let nowhere = told("", LEVEL, at([400.0, 0.0, 0.0]));
        assert!(nowhere[0].text.contains("check scale, axes and position"), "{nowhere:?}");
    }

    #[test]
    fn metres_that_are_read_as_centimetres_put_the_head_behind_every_screen() {
        let found = told(", position = [0.0, 0.0, -0.1], scale = 0.01", LEVEL, at([0.0, -1.6, 1.7]));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!(doubt.kind, DoubtKind::Behind);
        assert!(doubt.text.contains("reports metres, write scale = 1 "), "{}", doubt.text);
    }

    /// The axes that it says to write put the head upright.
    #[test]
    fn a_head_that_lies_on_its_back_is_told_with_the_axes_to_write() {
        let found = told(", scale = 0.0254", "", at(INCHES));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!(doubt.kind, DoubtKind::Turned);
        assert!(doubt.text.contains("turned by 90°, its top points forwards"), "{}", doubt.text);
        let (_, axes) = doubt.text.split_once("body_from_sensor needs ").unwrap();
        let mount = format!("body_from_sensor = {{ {axes} }}");
        assert_eq!(mount, LEVEL);
        assert_eq!(told(", scale = 0.0254", &mount, at(INCHES)), []);
    }
}
