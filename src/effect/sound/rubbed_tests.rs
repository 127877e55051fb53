//! Blocks that are rubbed, cut and strained, and what is heard of them.

use super::heard::{Heard, RATE_HZ};
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::green::GreenFile;
use crate::world::dissipation::Dissipation;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// ρc of air at 20 °C, Pa s/m (L. Kinsler et al., Fundamentals of Acoustics, Wiley 2000, appendix A10: 415 with c = 343 m/s and 1.21 kg/m³).
const RHO_C: f64 = 1.204 * 343.2;
const EFFICIENCY: f64 = 1e-5;

fn parsed(text: &str) -> Result<Resolved, String> {
    let scene = Resolved::parse(text, Path::new("rubbed.toml")).map_err(|error| error.to_string())?;
    let all: Result<Vec<_>, _> = scene.bodies.keys().map(|name| scene.requirements(name)).collect();
    all.map(|_| scene).map_err(|error| error.to_string())
}

impl Heard {
    fn new(text: &str) -> Heard {
        let scene = parsed(text).unwrap();
        Heard::asked(&scene, &file_of(&scene).unwrap())
    }

    /// A session in which what is heard is asked for in the first frame already.
    fn asked(scene: &Resolved, file: &Arc<GreenFile>) -> Heard {
        let mut heard = Heard::of(scene, file, "desktop");
        heard.listen();
        heard
    }

    /// Distance from the head, m.
    fn away(&self, place: V3) -> f64 {
        (place - self.world.assets.stage.viewer.room_from_head.translation.vector).norm()
    }

    /// Moves the last control element of the first body.
    fn hold(&mut self, by: V3) {
        let field = *self.world.fields.bodies[0].poses.last().unwrap();
        self.world.graph.restore(field, ControlPose { translation: by, ..ControlPose::REST });
    }
}

fn at(place: V3) -> Isometry3<f64> {
    Translation3::from(place).into()
}

/// A floor that faces down.
fn ceiling(place: V3) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_scaled_axis(V3::x() * PI))
}

fn decibels(ratio: f64) -> f64 {
    10.0 * ratio.log10()
}

const MU: f64 = 0.35;
const DEPTH: f64 = 0.002;
/// Way of the plate in a frame, m.
const STEP: f64 = 2e-4;

/// A block of 0.3 × 0.1 × 0.3 m of 100 kPa on a bed, and a plate on a stylus.
fn block(keys: &str) -> String {
    format!(
        "[tool.plate]\nshape = \"floor\"\nstylus = 1\n\
         [body.b]\ngenerate = {{ block = {{ size = [0.3, 0.1, 0.3], cells = [6, 3, 6] }} }}\n\
         material = {{ young = 1.0e5, poisson = 0.0 }}\nplace = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n{keys}\n\
         control.base = {{ nodes = {{ group = \"ymin\" }}, grab = \"fixed\" }}\n"
    )
}

fn rubbed(sound: &str) -> String {
    block(&format!("effects = [\"contact\", \"sound\"]\neffect.contact = {{ friction = {MU} }}\n{sound}"))
}

/// The plate presses the block like a column, N = E A d/h, and slides on it: μ N v are dissipated. At a distance r the mean square of the
/// pressure is the efficiency times that times ρc/4πr².
#[test]
fn a_plate_that_rubs_is_as_loud_as_friction_times_speed() {
    let mut heard =
        Heard::new(&rubbed(&format!("effect.sound = {{ efficiency = {EFFICIENCY}, roughness = 1e-5 }}")));
    let pressed = |k: u32| ceiling(V3::new(STEP * f64::from(k), 0.05 - DEPTH, 0.0));
    // At rest before it comes, and as long as it sticks there is no more than its edges.
    (0..10).for_each(|_| {
        heard.step(ceiling(V3::new(0.0, 0.06, 0.0)));
    });
    assert!(heard.channels.iter().flatten().all(|sample| *sample == 0.0), "at rest");
    (0..90).for_each(|k| {
        heard.step(pressed(k));
    });
    let (mut work, mut energy) = (0.0, 0.0);
    for k in 90..330 {
        let (done, sound) = heard.step(pressed(k));
        (work, energy) = (work + done.work, energy + sound);
    }
    let power = MU * (1e5 * 0.09 * DEPTH / 0.1) * STEP * 60.0;
    println!("friction {} W of {power} W, {:e}", work / 4.0, work / 4.0 / power - 1.0);
    assert!((work / 4.0 / power - 1.0).abs() < 2e-6, "{} W, expected {power} W", work / 4.0);
    let (place, way) = heard.world.frame.bodies[0].dissipation.mean().unwrap();
    println!("at {place}, {:e} off in a frame", way / STEP - 1.0);
    assert!((place.y - 0.05).abs() < 0.003 && (way / STEP - 1.0).abs() < 1.5e-4, "{place}, {way}");
    let expected = EFFICIENCY * power * RHO_C / (4.0 * PI) / heard.away(place.coords).powi(2);
    let off = decibels(energy / 4.0 / expected);
    println!("level off by {off} dB");
    assert!(off.abs() < 0.1, "{off} dB");
    // It stops: within the frame in which nothing moves any more the noise falls to nothing.
    (0..3).for_each(|_| {
        heard.step(pressed(329));
    });
    let from = heard.channels[0].len();
    (0..30).for_each(|_| {
        heard.step(pressed(329));
    });
    assert!(heard.channels.iter().all(|all| all[from..].iter().all(|sample| *sample == 0.0)), "held still");
}

#[test]
fn two_runs_have_the_same_bits() {
    let scene = parsed(&rubbed("")).unwrap();
    let file = file_of(&scene).unwrap();
    let run = || {
        let mut heard = Heard::asked(&scene, &file);
        (0..40).for_each(|k| {
            heard.step(ceiling(V3::new(STEP * f64::from(k), 0.05 - DEPTH, 0.0)));
        });
        heard.channels
    };
    let first = run();
    assert!(first[0].iter().any(|sample| *sample != 0.0));
    assert_eq!(first, run());
}

/// Two blocks, one drawn over the other: each hears half of the work of friction; where one alone is heard, it hears all.
#[test]
fn bodies_that_rub_each_other_share_the_work() {
    let block = |name: &str, place: [f64; 3], held: &str, effects: &str| {
        format!(
            "[body.{name}]\ngenerate = {{ block = {{ size = [0.3, 0.1, 0.3], cells = [4, 2, 4] }} }}\n\
             material = {{ young = 1.0e5, poisson = 0.0 }}\neffects = [{effects}]\neffect.contact = {{ friction = {MU} }}\n\
             place = {{ position = {place:?}, scale = 1.0 }}\ncontrol.hand = {{ nodes = {{ group = \"{held}\" }}, grab = \"fixed\" }}\n"
        )
    };
    let works = |effects: &str| {
        let low = block("low", [0.0, -0.05, 0.0], "ymin", effects);
        let high = block("high", [0.0, 0.0505, 0.0], "ymax", "\"contact\", \"sound\"");
        let mut heard = Heard::new(&(low + &high));
        let mut works = [0.0; 2];
        for k in 0..60 {
            let pose = heard.world.fields.bodies[1].poses[0];
            let translation = V3::new(STEP * f64::from(k), -3e-3, 0.0);
            heard.world.graph.set(pose, ControlPose { translation, ..ControlPose::REST }).unwrap();
            heard.step(at(V3::y()));
            for (work, frame) in works.iter_mut().zip(&heard.world.frame.bodies) {
                *work += frame.dissipation.work;
            }
        }
        works
    };
    let [low, high] = works("\"contact\", \"sound\"");
    let [none, all] = works("\"contact\"");
    println!("{low} J and {high} J, alone {all} J");
    assert!(low > 0.0 && low == high && none == 0.0);
    assert!(((low + high) / all - 1.0).abs() < 1e-12, "{low} J, {high} J, {all} J");
}

/// Nobody who is not heard is looked at.
#[test]
fn what_is_not_heard_is_not_measured() {
    let text = block(&format!("effects = [\"contact\"]\neffect.contact = {{ friction = {MU} }}"));
    let mut heard = Heard::new(&text);
    (0..40).for_each(|k| {
        let (done, _) = heard.step(ceiling(V3::new(STEP * f64::from(k), 0.05 - DEPTH, 0.0)));
        assert_eq!(done, Dissipation::default());
    });
}

/// A block of 0.1 m × 0.06 m with a toughness of 100 J/m² that a blade cuts in two at 60 mm/s: 0.36 W in the middle, 0.6 J in all.
#[test]
fn a_cut_is_as_loud_as_toughness_times_area() {
    let text = format!(
        "[tool.scalpel]\nshape = {{ blade = {{ length = 0.2, width = 0.02 }} }}\nstylus = 1\n\
         [body.b]\ngenerate = {{ block = {{ size = [0.3, 0.1, 0.06], cells = [17, 8, 6] }} }}\n\
         material = {{ young = 1.0e9, poisson = 0.3 }}\nplace = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n\
         effects = [\"cut\", \"sound\"]\neffect.cut = {{ toughness = 100.0 }}\n\
         effect.sound = {{ efficiency = {EFFICIENCY}, roughness = 2e-5 }}\n\
         control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
    );
    let mut heard = Heard::new(&text);
    let (mut work, mut energy, mut middle) = (0.0, 0.0, [0.0; 2]);
    for k in 0..200 {
        let tip = V3::new(0.011, 0.08 - 1e-3 * f64::from(k), -0.1);
        let (done, sound) = heard.step(at(tip));
        // As loud as at 1 m, over all directions.
        let radiated = sound * heard.away(V3::new(tip.x, tip.y, 0.0)).powi(2) * 4.0 * PI / RHO_C;
        (work, energy) = (work + done.work, energy + radiated);
        if (70..130).contains(&k) {
            middle = [middle[0] + done.work, middle[1] + radiated];
        }
    }
    println!(
        "{work} J of 0.6 J are done, heard {} dB, in all {} dB",
        decibels(energy / EFFICIENCY / work),
        decibels(energy / EFFICIENCY / 0.6)
    );
    println!("in the middle {} W of 0.36 W, {} dB", middle[0], decibels(middle[1] / EFFICIENCY / 0.36));
    assert!((work / 0.6 - 1.0).abs() < 0.15 && (middle[0] / 0.36 - 1.0).abs() < 0.2, "{work} J, {middle:?}");
    assert!(decibels(energy / EFFICIENCY / work).abs() < 0.1);
    assert!(decibels(middle[1] / EFFICIENCY / 0.36).abs() < 1.0);
    let count = heard.channels[0].len();
    // It is silent before the blade comes and after it has gone.
    let is_silent =
        |from: usize, to: usize| heard.channels.iter().all(|all| all[from..to].iter().all(|p| *p == 0.0));
    assert!(is_silent(0, 20 * 800) && is_silent(count - 20 * 800, count));
}

/// A bar that is pulled by a twentieth, at a scale of three octaves to a tenth: its tone is half the scale above 110 Hz.
#[test]
fn a_strained_bar_has_the_pitch_of_its_strain() {
    let text = "[body.b]\ngenerate = { block = { size = [0.4, 0.05, 0.05], cells = [8, 2, 2] } }\n\
                material = { young = 1.0e6, poisson = 0.0 }\nplace = { position = [0.0, 0.0, 0.0], scale = 1.0 }\n\
                effects = [\"stress\", \"sound\"]\neffect.sound = { pitch = { of = \"strain\", full = 0.1 } }\n\
                control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let mut heard = Heard::new(text);
    (0..10).for_each(|_| {
        heard.step(at(V3::y()));
    });
    assert!(heard.channels.iter().flatten().all(|sample| *sample == 0.0), "at rest");
    for k in 1..=20 {
        heard.hold(V3::x() * 0.001 * f64::from(k));
        heard.step(at(V3::y()));
    }
    (0..2).for_each(|_| {
        heard.step(at(V3::y()));
    });
    let from = heard.channels[0].len();
    (0..120).for_each(|_| {
        heard.step(at(V3::y()));
    });
    let all = &heard.channels[0];
    let crossings: Vec<f64> = (from + 1..all.len())
        .filter(|n| all[n - 1] < 0.0 && all[*n] >= 0.0)
        .map(|n| n as f64 - all[n] / (all[n] - all[n - 1]))
        .collect();
    let turns = (crossings.len() - 1) as f64;
    let found = turns * RATE_HZ / (crossings[crossings.len() - 1] - crossings[0]);
    let expected = 110.0 * 8.0_f64.sqrt();
    println!("{found} Hz of {expected} Hz: {:e}", found / expected - 1.0);
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} Hz");
    // Half of the amplitude of 60 dB at 1 m, over both loudspeakers.
    let square: f64 = heard
        .channels
        .iter()
        .map(|all| all[from..].iter().map(|p| p * p).sum::<f64>() / (all.len() - from) as f64)
        .sum();
    let off = decibels(square / (0.01 / heard.away(V3::x() * 0.01)).powi(2));
    println!("level off by {off} dB");
    assert!(off.abs() < 9e-3, "{off} dB");
    // No click anywhere: the tone is nowhere steeper than in the end, where it is highest and loudest.
    let steepest = |part: &[f64]| part.windows(2).map(|two| (two[1] - two[0]).abs()).fold(0.0, f64::max);
    let (glide, end) = (steepest(&all[..from]), steepest(&all[from..]));
    println!("steepest 1 - {:e} of the end's", 1.0 - glide / end);
    assert!(glide < (1.0 + 1e-6) * end, "{glide} {end}");
    heard.hold(V3::zeros());
    (0..4).for_each(|_| {
        heard.step(at(V3::y()));
    });
    let from = heard.channels[0].len();
    (0..10).for_each(|_| {
        heard.step(at(V3::y()));
    });
    assert!(heard.channels.iter().all(|all| all[from..].iter().all(|p| p.abs() < 1e-6)), "at rest again");
}

#[test]
fn a_body_without_a_source_is_refused() {
    let told = |keys: &str| parsed(&block(keys)).map(drop).unwrap_err();
    let nothing = "there is nothing to hear of the body";
    for (keys, part) in [
        ("effects = [\"sound\"]", nothing),
        ("effects = [\"contact\", \"sound\"]\neffect.contact = { friction = 0.0 }", nothing),
        ("effects = [\"contact\", \"sound\"]\neffect.sound = { efficiency = 0.0 }", nothing),
        ("effects = [\"stress\", \"sound\"]", nothing),
        (
            "effects = [\"contact\", \"sound\"]\neffect.sound = { pitch = { full = 0.3 } }",
            "list \"stress\" beside \"sound\"",
        ),
    ] {
        let error = told(keys);
        assert!(error.contains(part) && error.contains("body.b.eff"), "{keys}: {error}");
    }
    for keys in [
        "effects = [\"contact\", \"sound\"]",
        "effects = [\"dynamics\", \"sound\"]\ngravity = false",
        "effects = [\"stress\", \"sound\"]\neffect.sound = { pitch = { full = 0.3 } }",
    ] {
        let text = block(keys).replace("poisson = 0.0", "poisson = 0.0, density = 1000.0");
        parsed(&text).unwrap();
    }
}
