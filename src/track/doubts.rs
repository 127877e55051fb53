//! Finds doubtful places of head and styli: another unit, or a head that is turned.
//!
//! In: a stage and the reports of its trackers. Out: sentences with numbers and the keys to change. A wrong unit is no error in
//! the file, and a picture only goes black by it.

use super::tracker_set::{SensorReport, TrackerReport};
use crate::stage::tracking::{Axis, TrackerFrame};
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
    /// A place farther from every screen than anyone stands.
    Far,
    /// A head behind every screen, or right behind the picture of one.
    Behind,
    /// A head whose top does not point up, or that looks away from every screen.
    Turned,
    /// Never heard, while the tracker reports others under numbers that the stage does not name.
    Number,
}

/// Largest distance of a person from the nearest screen, m; three times that of the stage's viewer if this is more.
const FAR_M: f64 = 5.0;
/// Distance from the expected place of head or hand below which a unit counts as confirmed, m.
const EXPECTED_M: f64 = 1.5;
/// Angle of a head's top from the vertical above which it counts as turned, degrees: who looks at a table bends by less.
const TURNED: f64 = 65.0;
/// Largest distance beside a screen's picture at which a head still counts as behind it, m.
const BESIDE_M: f64 = 0.3;
/// Least distance behind a screen at which a head counts as behind it, m: more than the error of a calibration.
const BEHIND_M: f64 = 0.1;
/// The most numbers that are listed.
const MOST_NAMED: usize = 12;
/// Smallest cosine between an axis of a sensor and one of the room for which it is named: 40°, since heads are bent.
const ALONG: f64 = 0.766;
/// Units of trackers, m.
const UNITS: [(f64, &str); 5] =
    [(1.0, "metres"), (0.0254, "inches"), (0.01, "centimetres"), (0.001, "millimetres"), (0.3048, "feet")];

/// The doubts about all sensors that the stage names and a tracker has reported.
pub fn doubts(stage: &Stage, reports: &[TrackerReport]) -> Vec<Doubt> {
    let of_report = |report: &TrackerReport| {
        let placed = report.sensors.iter().flat_map(|sensor| of_sensor(stage, sensor).unwrap_or_default());
        placed.chain(numbers(stage, report)).collect::<Vec<_>>()
    };
    reports.iter().flat_map(of_report).collect()
}

/// Sensors that were never heard, of a tracker that reports numbers which the stage does not name.
fn numbers(stage: &Stage, report: &TrackerReport) -> Vec<Doubt> {
    let unnamed: Vec<i32> =
        report.sensors.iter().filter(|sensor| sensor.name.is_none()).map(|sensor| sensor.id).collect();
    let unheard: Vec<(&String, i32)> = report
        .sensors
        .iter()
        .filter(|sensor| sensor.count == 0)
        .filter_map(|sensor| Some((sensor.name.as_ref()?, sensor.id)))
        .collect();
    if unnamed.is_empty() {
        return Vec::new();
    }
    let fits = |by: &i32| unheard.iter().all(|(_, id)| unnamed.contains(&id.saturating_add(*by)));
    // Where one was heard under its number, the others count as it does.
    let none_heard = report.sensors.iter().all(|sensor| sensor.name.is_none() || sensor.count == 0);
    let shift = [-1, 1].into_iter().find(fits).filter(|_| none_heard);
    let those: Vec<String> = unnamed.iter().take(MOST_NAMED).map(i32::to_string).collect();
    let those = those.join(", ");
    let doubt = |(name, id): (&String, i32)| {
        let advice = match shift {
            Some(by) => format!("write id = {}{}", id + by, buttons(stage, report, by)),
            None if none_heard => "move each thing in turn to see which number is which".to_owned(),
            None => "it may be off or out of sight; else move it to see which number it has".to_owned(),
        };
        let from_zero =
            if shift == Some(-1) && unnamed.contains(&0) { ", for its numbers count from 0" } else { "" };
        let text = format!(
            "sensor {name} has id = {id}, which tracker `{}` never reported; it reports {those}, which the stage does not \
             name: {advice}{from_zero}",
            report.name
        );
        Doubt { sensor: name.clone(), kind: DoubtKind::Number, text }
    };
    unheard.into_iter().map(doubt).collect()
}

/// The buttons of a stylus that are counted likewise: 32 for each flystick of a DTrack.
fn buttons(stage: &Stage, report: &TrackerReport, by: i32) -> String {
    let is_reported = |button: i32| report.buttons.iter().any(|known| known.id == button);
    let used = stage.tracking.styli.values().flat_map(|stylus| [&stylus.grab, &stylus.second]).flatten();
    let used = used.filter(|id| id.tracker == report.name).map(|id| id.button);
    let wrong = used.filter(|button| !is_reported(*button) && is_reported(button.saturating_add(32 * by)));
    wrong.map(|button| format!(", and button = {} instead of {button}", button + 32 * by)).collect()
}

fn of_sensor(stage: &Stage, report: &SensorReport) -> Option<Vec<Doubt>> {
    let name = report.name.clone()?;
    let room_from_body = report.in_room.or_else(|| beyond_room(stage, &name, report))?;
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
    let behind = behind(stage, &place).map(|text| {
        let remedy = mirrored(stage, &name, report, viewer).unwrap_or_else(unit);
        doubt(DoubtKind::Behind, format!("sensor {name} is {text}; {remedy}"))
    });
    let turned = turned(stage, &name, &room_from_body);
    let turned = turned.or_else(|| aside(stage, &name, &room_from_body).filter(|_| behind.is_none()));
    let turned = turned.map(|text| doubt(DoubtKind::Turned, text));
    Some(behind.into_iter().chain(turned).collect())
}

/// Pose of a body whose sensor reports a place that no room has, as in millimetres: it is never shown.
fn beyond_room(stage: &Stage, name: &str, report: &SensorReport) -> Option<Isometry3<f64>> {
    let sensor = stage.tracking.sensors.get(name)?;
    let frame = stage.tracking.trackers.get(&sensor.tracker)?.frame;
    let raw = report.raw.filter(|_| report.quality > 0.0)?;
    Some(frame.room_from_sensor(&raw) * sensor.sensor_from_body)
}

/// Words for the screens behind which a head is, where nobody stands who sees the others.
fn behind(stage: &Stage, place: &Point3<f64>) -> Option<String> {
    let before = stage.screens.iter().map(|screen| (screen.distance_m(place), screen));
    let (farthest_m, farthest) = before.clone().max_by(|a, b| a.0.total_cmp(&b.0))?;
    if farthest_m < MIN_EYE_DISTANCE_M {
        let Screen { name, .. } = farthest;
        let behind_m = -farthest_m;
        return Some(format!(
            "behind the plane of every screen, {behind_m:.3} m behind `{name}`: all stay black"
        ));
    }
    // Beside a screen's edges its plane goes on through the room.
    let is_right_behind = |(distance_m, screen): &(f64, &Screen)| {
        let aside_m = (screen.away_m(place).powi(2) - distance_m.powi(2)).max(0.0).sqrt();
        *distance_m < -BEHIND_M && aside_m < BESIDE_M
    };
    let (distance_m, screen) = before.filter(is_right_behind).min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!(
        "{:.3} m behind screen `{}`, which stays black, and before `{}`",
        -distance_m, screen.name, farthest.name
    ))
}

fn nearest_m(stage: &Stage, place: &Point3<f64>) -> f64 {
    stage.screens.iter().map(|screen| screen.away_m(place)).fold(f64::INFINITY, f64::min)
}

/// Words for the unit that would bring the sensor to where it is expected, and the key to write then.
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
            "if tracker `{tracker}` reports {called}, write scale = {unit} into its room_from_tracker (now \
             {scale}): then {:.2} m off",
            off_m(unit)
        ),
        None => format!(
            "check scale, axes and position in room_from_tracker of tracker `{tracker}`, and the sensor's \
             mount"
        ),
    }
}

/// The axis that is to be reversed, if that puts a head before all screens, to where it is expected.
fn mirrored(stage: &Stage, name: &str, report: &SensorReport, expected: Point3<f64>) -> Option<String> {
    let sensor = stage.tracking.sensors.get(name)?;
    let (tracker, found) = stage.tracking.trackers.get_key_value(&sensor.tracker)?;
    let raw = report.raw?;
    let at = |mirror: Option<Axis>| {
        let frame = TrackerFrame { mirror, ..found.frame };
        let room_from_body = frame.room_from_sensor(&raw) * sensor.sensor_from_body;
        Point3::from(room_from_body.translation.vector)
    };
    let is_right = |mirror: &Option<Axis>| {
        let place = at(*mirror);
        *mirror != found.frame.mirror
            && stage.screens.iter().all(|screen| screen.distance_m(&place) > MIN_EYE_DISTANCE_M)
            && (place - expected).norm() < EXPECTED_M
    };
    let candidates = [None, Some(Axis::X), Some(Axis::Y), Some(Axis::Z)];
    let best = candidates.into_iter().filter(is_right).min_by(|a, b| {
        let off_m = |mirror: &Option<Axis>| (at(*mirror) - expected).norm();
        off_m(a).total_cmp(&off_m(b))
    })?;
    let write = match best {
        Some(axis) => format!("if its system is left-handed, write mirror = \"{}\" into", axis.name()),
        None => "if its system is right-handed, remove `mirror` from".to_owned(),
    };
    let off_m = (at(best) - expected).norm();
    Some(format!(
        "{write} the room_from_tracker of tracker `{tracker}`: it would be {off_m:.2} m from where it is expected"
    ))
}

/// A head before the screens that looks at none of them, and the axes that put it right if its wearer does now.
fn aside(stage: &Stage, name: &str, room_from_body: &Isometry3<f64>) -> Option<String> {
    let eye = Point3::from(room_from_body.translation.vector);
    let looks = room_from_body.rotation * -Vector3::z();
    let off = |screen: &Screen| {
        let to = |place: Point3<f64>| looks.angle(&(place - eye)).to_degrees();
        to(screen.point([0.0, 0.0])).min(to(screen.nearest(&eye)))
    };
    let nearest = stage.screens.iter().map(|screen| (off(screen), screen));
    let (degrees, screen) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Who looks along -z from beside the screens is not turned.
    if degrees < TURNED || looks.angle(&-Vector3::z()).to_degrees() < TURNED {
        return None;
    }
    let remedy = upright(stage, name, room_from_body)?;
    Some(format!(
        "sensor {name}: the head looks away from every screen, {degrees:.0}° from `{}`: {remedy}",
        screen.name
    ))
}

/// A head that lies on its side, and the axes that put it upright if it looks along -z now.
fn turned(stage: &Stage, name: &str, room_from_body: &Isometry3<f64>) -> Option<String> {
    let up = room_from_body.rotation * Vector3::y();
    let degrees = up.angle(&Vector3::y()).to_degrees();
    if degrees < TURNED {
        return None;
    }
    let words = [["to the right", "to the left"], ["up", "down"], ["backwards", "forwards"]];
    let top = words[up.iamax()][usize::from(up[up.iamax()] < 0.0)];
    let remedy = upright(stage, name, room_from_body)?;
    Some(format!("sensor {name}: the head is turned by {degrees:.0}°, its top points {top}: {remedy}"))
}

/// The axes to write if the wearer looks along -z now.
fn upright(stage: &Stage, name: &str, room_from_body: &Isometry3<f64>) -> Option<String> {
    let sensor = stage.tracking.sensors.get(name)?;
    let room_from_sensor = (room_from_body.rotation * sensor.sensor_from_body.rotation.inverse())
        .to_rotation_matrix()
        .into_inner();
    Some(match along_room(&room_from_sensor) {
        Some(axes) => format!(
            "if the wearer looks towards -z now, body_from_sensor needs axes = [{}]",
            axes.map(|[x, y, z]| format!("[{x}, {y}, {z}]")).join(", ")
        ),
        None => "have the wearer look straight along -z, and read this again".to_owned(),
    })
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
    use nalgebra::UnitQuaternion;
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

    /// 1.7 m in millimetres is more than a kilometre, so that no pose is ever shown.
    #[test]
    fn millimetres_are_told_with_the_scale_to_write() {
        let found = told("", LEVEL, at([0.0, -1500.0, 1700.0]));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!(doubt.kind, DoubtKind::Far);
        assert!(doubt.text.contains("reports millimetres, write scale = 0.001 "), "{}", doubt.text);
        assert_eq!(told(", scale = 0.001", LEVEL, at([0.0, -1500.0, 1700.0])), []);
    }

    /// A tracker whose y points to the viewer; its z is up.
    #[test]
    fn a_head_behind_the_wall_that_stands_above_the_table_is_told_which_axis_to_reverse() {
        let found = told("", LEVEL, at([0.0, 1.5, 1.7]));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!(doubt.kind, DoubtKind::Behind);
        for part in ["1.500 m behind screen `wall`", "before `table`", "write mirror = \"y\"", "0.00 m from"]
        {
            assert!(doubt.text.contains(part), "no `{part}` in {}", doubt.text);
        }
        assert_eq!(told(", mirror = \"y\"", LEVEL, at([0.0, 1.5, 1.7])), []);
        // Beside the bench, behind the wall's plane, people stand.
        assert_eq!(told("", LEVEL, at([2.0, 0.3, 1.7])), []);
    }

    /// The axes that it says to write make the head look at the wall.
    #[test]
    fn a_head_that_looks_away_from_every_screen_is_told_with_the_axes_to_write() {
        let yaw = |degrees: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), degrees.to_radians());
            Isometry3::from_parts(at([0.0, -1.5, 1.7]).translation, turn)
        };
        let found = told("", LEVEL, yaw(90.0));
        let [doubt] = &found[..] else { panic!("{found:?}") };
        assert_eq!(doubt.kind, DoubtKind::Turned);
        assert!(doubt.text.contains("looks away from every screen, 90° from `"), "{}", doubt.text);
        let (_, axes) = doubt.text.split_once("body_from_sensor needs ").unwrap();
        assert_eq!(told("", &format!("body_from_sensor = {{ {axes} }}"), yaw(90.0)), []);
        assert_eq!(told("", LEVEL, yaw(40.0)), [], "a glance to the side");
    }

    /// The recorded frame of a DTrack has body 0 and flystick 0, whose first button is 0; its own windows count from 1.
    #[test]
    fn numbers_that_count_from_0_are_told_with_those_to_write() {
        let keys = "[tracker.art]\ndtrack = \"5000\"\n[sensor.glasses]\ntracker = \"art\"\nid = 1\n[sensor.wand]\n\
                    tracker = \"art\"\nid = 1001\n[stylus.right]\nsensor = \"wand\"\n\
                    grab = { tracker = \"art\", button = 32 }\n";
        let stage = Stage::parse(&format!("{}{keys}", BUILT_IN[0].1), Path::new("bench.toml")).unwrap();
        let source = FakeSource::default();
        let mut trackers = TrackerSet::with_sources(&stage.tracking, vec![Box::new(source.clone())], now_s());
        assert_eq!(doubts(&stage, &trackers.report(now_s())), [], "nothing was heard yet");
        source.change(|device| {
            device.take_pose(0, at([0.0, 1.7, 1.5]), None, 1.0);
            device.take_pose(1000, at([0.0, 1.2, 1.0]), None, 1.0);
            device.take_button(0, false, None);
        });
        let [glasses, wand] = &doubts(&stage, &trackers.report(now_s()))[..] else { panic!() };
        assert!(glasses.text.contains("reports 0, 1000, which"), "{}", glasses.text);
        assert!(glasses.text.contains("write id = 0, and button = 0 instead of 32"), "{}", glasses.text);
        assert!(wand.text.contains("write id = 1000") && wand.text.contains("count from 0"), "{}", wand.text);
    }
}
