//! Finds mistakes in a stage's loudspeakers: places as the viewer hears them, against each other and against their names.

use crate::base::diagnostic::{Diagnostic, Severity};
use crate::stage::description::Stage;
use crate::stage::error::place;
use crate::stage::loudspeaker::{Bearing, Loudspeaker, SoundOutput, most_open};
use nalgebra::{Isometry3, Rotation3, Vector3};

/// Loudspeakers that the viewer sees nearer to each other than this are reported, degrees.
const NEAR_DEGREES: f64 = 5.0;
/// Loudspeakers nearer to the viewer than this are reported, m.
const NEAREST_M: f64 = 0.3;
/// Loudspeakers nearer to each other than this stand at the same place, m.
const SAME_M: f64 = 0.01;
/// A loudspeaker that is named after a side may be so far on the other one, degrees.
const ASIDE_DEGREES: f64 = 5.0;

pub fn lint(stage: &Stage, found: &mut Vec<Diagnostic>) {
    let (all, head) = (&stage.sound.loudspeakers, &stage.viewer.room_from_head);
    if stage.sound.used(head) != *all {
        if !all.is_empty() {
            let message = format!(
                "output = \"{}\" leaves the {} [[loudspeaker]] tables unused",
                stage.sound.output.name(),
                all.len()
            );
            found.push(Diagnostic::new(Severity::Note, "sound.output", message));
        }
        return;
    }
    for (k, one) in all.iter().enumerate() {
        let entity = format!("loudspeaker.{}", k + 1);
        let bearing = Bearing::new(head, &one.position);
        let message = format!("{} at {} m, {bearing}", one.name, place(&one.position));
        found.push(Diagnostic::new(Severity::Note, &entity, message));
        let mut warn = |message: String| found.push(Diagnostic::new(Severity::Warning, &entity, message));
        if bearing.distance_m < NEAREST_M {
            warn(format!(
                "it is {:.2} m from the viewer's head, below {NEAREST_M} m: is its position that of another thing?",
                bearing.distance_m
            ));
        }
        all[..k]
            .iter()
            .enumerate()
            .filter_map(|(i, other)| near(head, i + 1, other, one))
            .for_each(&mut warn);
        named(one, &bearing).into_iter().for_each(&mut warn);
    }
    if stage.sound.output == SoundOutput::Loudspeakers {
        found.extend(open(stage));
    }
}

/// Words about two loudspeakers at one place, or in one direction.
fn near(head: &Isometry3<f64>, number: usize, other: &Loudspeaker, one: &Loudspeaker) -> Option<String> {
    let apart_m = (one.position - other.position).norm();
    if apart_m < SAME_M {
        return Some(format!(
            "it stands where loudspeaker {number} stands: correct one `position`, or remove one"
        ));
    }
    let [a, b] = [one, other].map(|it| it.position.coords - head.translation.vector);
    let degrees = a.angle(&b).to_degrees();
    (degrees < NEAR_DEGREES).then(|| {
        format!(
            "the viewer sees it {degrees:.1}° from loudspeaker {number}, below {NEAR_DEGREES}°, so that both sound as one: \
             move it, or remove it"
        )
    })
}

/// Words about a loudspeaker that does not stand where its name says.
fn named(one: &Loudspeaker, bearing: &Bearing) -> Option<String> {
    let azimuth = bearing.azimuth_degrees;
    let sideways = azimuth.to_radians().sin().asin().to_degrees();
    let forward = 90.0 - azimuth.abs();
    let lower = one.name.to_lowercase();
    let has = |word: &&str| lower.split(|c: char| !c.is_alphanumeric()).any(|part| part == *word);
    let sides = [
        (&["left"][..], -sideways, "left"),
        (&["right"], sideways, "right"),
        (&["front"], forward, "in front"),
        (&["rear", "back", "behind"], -forward, "behind"),
    ];
    let wrong = sides.iter().find(|(words, side, _)| words.iter().any(&has) && *side < -ASIDE_DEGREES);
    wrong.map(|(.., side)| {
        format!(
            "its name \"{}\" says {side}, and the viewer sees it {bearing}: exchange the places, or correct the name; \
             `greenstage pattern STAGE --sound` lets you hear which it is",
            one.name
        )
    })
}

/// Directions from which nothing can sound.
fn open(stage: &Stage) -> Option<Diagnostic> {
    let head = &stage.viewer.room_from_head;
    let away = stage.sound.loudspeakers.iter().map(|one| one.position.coords - head.translation.vector);
    let directions: Vec<Vector3<f64>> = away.filter_map(|away| away.try_normalize(1e-6)).collect();
    let (worst, angle) = most_open(&directions)?;
    let ways = [
        ("left", -Vector3::x()),
        ("right", Vector3::x()),
        ("in front", -Vector3::z()),
        ("behind", Vector3::z()),
        ("above", Vector3::y()),
        ("below", -Vector3::y()),
    ];
    let gaze = head.rotation * -Vector3::z();
    let room_from_gaze = Rotation3::new(Vector3::y() * -gaze.x.atan2(-gaze.z));
    // The directions near the one that is farthest from all loudspeakers count as one.
    let name = ways.iter().find(|(_, way)| (room_from_gaze * way).dot(&worst) > 0.999).map_or_else(
        || {
            Bearing::new(head, &(head.translation.vector + worst).into())
                .to_string()
                .replace("1.00 m away, ", "")
        },
        |(name, _)| format!("from {name}"),
    );
    let message = format!(
        "nothing sounds {name}: the nearest loudspeaker is {:.0}° aside. Sounds of there come from the loudspeakers around; \
         add one there, or leave it so",
        angle.to_degrees()
    );
    Some(Diagnostic::new(Severity::Warning, "loudspeakers", message))
}
