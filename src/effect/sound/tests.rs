//! A steel strip that is struck, and what is heard of it.

use super::heard::{Heard, RATE_HZ};
use crate::effect::{Resolved, file_of};
use crate::stage::Stage;
use nalgebra::Translation3;
use std::f64::consts::TAU;
use std::path::Path;

/// Where the strip is held, in the room.
const ROOT: [f64; 3] = [-0.6, 1.0, -0.9];

/// A strip of 0.1 × 0.004 × 0.02 m along x, held at its left end, and a ball of 10 mm on a stylus, heard on a stage.
fn strip(keys: &str, stage: &str) -> Heard {
    let text = format!(
        "[tool.hammer]\nshape = {{ ball = {{ radius = 0.01 }} }}\nstylus = 1\n\
         [body.strip]\ngenerate = {{ block = {{ size = [0.1, 0.004, 0.02], cells = [12, 1, 2] }} }}\nelement = \"tet10\"\n\
         material = {{ young = 2.1e11, poisson = 0.0, density = 7850.0 }}\neffects = [\"contact\", \"dynamics\", \"sound\"]\n\
         place = {{ position = {ROOT:?}, scale = 1.0 }}\n{keys}\n\
         control.root = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
    );
    let scene = Resolved::parse(&text, Path::new("strip.toml")).unwrap();
    Heard::of(&scene, &file_of(&scene).unwrap(), stage)
}

impl Heard {
    /// A frame with the hammer this far above where it touches the strip's free end.
    fn hammer(&mut self, above: f64) {
        let top = self.world.bodies[0].deformer.rest().iter().map(|x| x[1]).fold(f32::MIN, f32::max);
        let end = self.world.bodies[0].deformer.rest().iter().map(|x| x[0]).fold(f32::MIN, f32::max);
        let place = [ROOT[0] + f64::from(end), ROOT[1] + f64::from(top) + 0.01 + above, ROOT[2]];
        self.step(Translation3::from(place).into());
    }

    /// A blow of 0.3 m/s, and `frames` after it.
    fn strike(&mut self, frames: usize) {
        for above in [0.01, 0.005, -0.0003, 0.005].into_iter().chain(std::iter::repeat_n(0.02, frames)) {
            self.hammer(above);
        }
    }
}

/// Amplitude of a part of the sound at this frequency, under Hann's window.
fn at(samples: &[f64], hertz: f64) -> f64 {
    let count = samples.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (n, sample) in samples.iter().enumerate() {
        let window = 1.0 - (TAU * n as f64 / count).cos();
        let (sine, cosine) = (TAU * hertz * n as f64 / RATE_HZ).sin_cos();
        (re, im) = (re + window * sample * cosine, im - window * sample * sine);
    }
    2.0 * re.hypot(im) / count
}

/// The frequency near this one at which the sound is loudest.
fn peak(samples: &[f64], near: f64) -> f64 {
    let off = |k: i32| near * (1.0 + 0.0005 * f64::from(k));
    let all = (-60..=60).map(off);
    all.max_by(|a, b| at(samples, *a).total_cmp(&at(samples, *b))).unwrap()
}

fn rms(samples: &[f64]) -> f64 {
    (samples.iter().map(|p| p * p).sum::<f64>() / samples.len().max(1) as f64).sqrt()
}

/// f = β² h √(E/12ρ)/(2π L²), of Euler and Bernoulli (L. Meirovitch, Fundamentals of Vibrations, McGraw-Hill 2001, section 8.3).
fn bernoulli(beta: f64) -> f64 {
    beta * beta * 0.004 * (2.1e11 / 12.0 / 7850.0_f64).sqrt() / (TAU * 0.01)
}

#[test]
fn a_struck_strip_is_heard_at_its_frequencies_and_fades_as_it_is_damped() {
    let mut heard = strip("effect.dynamics = { modes = 12, damping = 0.002 }", "desktop");
    heard.strike(60);
    let ringing = &heard.channels[0][12_000..44_768];
    let first = bernoulli(1.87510);
    let found = peak(ringing, first);
    let modes = heard.world.frame.bodies[0].vibration.as_ref().unwrap().modes.squares.clone();
    let own = modes
        .iter()
        .map(|square| square.sqrt() / TAU)
        .min_by(|a, b| (a - found).abs().total_cmp(&(b - found).abs()));
    assert!((found / own.unwrap() - 1.0).abs() < 1e-3, "heard at {found} Hz, the mode is at {own:?}");
    assert!((found / first - 1.0).abs() < 5e-3, "heard at {found} Hz, theory says {first}");
    // e^(-ζωt) over a fifth of a second.
    let level = |from: usize| at(&heard.channels[0][from..from + 9600], found);
    let fading = (-0.002 * TAU * found * 0.2).exp();
    assert!((level(21_600) / level(12_000) / fading - 1.0).abs() < 2e-3, "{}", level(21_600) / level(12_000));
    println!(
        "{} of the mode, {} of theory, fading {}",
        found / own.unwrap() - 1.0,
        found / first - 1.0,
        level(21_600) / level(12_000) / fading - 1.0
    );
    println!("beside its modes 1 of {}", at(ringing, found) / at(ringing, 1.3 * found));
    // Away from its modes there is nothing.
    assert!(at(ringing, found) > 5e4 * at(ringing, 1.3 * found));
}

#[test]
fn what_is_at_rest_is_silent_and_so_is_what_is_pressed_slowly() {
    let mut heard = strip("gravity = true\neffect.dynamics = { modes = 12 }", "desktop");
    (0..90).for_each(|_| heard.hammer(0.05));
    // It begins in equilibrium under its weight.
    let rest = rms(&heard.channels[0][60_000..]);
    assert!(rest < 1e-9, "{rest} Pa");
    let from = heard.channels[0].len();
    (0..120).for_each(|k| heard.hammer(0.0005 - 1e-5 * f64::from(k)));
    let pressed = rms(&heard.channels[0][from..]);
    heard.strike(10);
    let struck = rms(&heard.channels[0][from + 96_000..]);
    println!("rest {rest} Pa, pressed {pressed} Pa, struck {struck} Pa");
    assert!(pressed < 0.025 * struck, "{pressed} Pa while it is pressed, {struck} Pa when it is struck");
}

/// In the CyberStage the strip is before and to the left of the viewer: the loudspeakers there are the loudest, and all together are as loud
/// as the one of a source that a listener hears from its distance.
#[test]
fn a_strip_is_heard_from_where_it_is() {
    let mut heard = strip("effect.dynamics = { modes = 6, damping = 0.002 }", "cyberstage");
    heard.strike(30);
    let levels: Vec<f64> = heard.channels.iter().map(|samples| rms(samples)).collect();
    assert_eq!(levels.len(), 8);
    let loudest = levels.iter().copied().fold(0.0, f64::max);
    let named = |level: f64| {
        heard.world.assets.stage.sound.loudspeakers[levels.iter().position(|l| *l == level).unwrap()]
            .name
            .clone()
    };
    assert!(named(loudest).contains("front left"), "{levels:?}");
    let behind: f64 = heard
        .world
        .assets
        .stage
        .sound
        .loudspeakers
        .iter()
        .zip(&levels)
        .filter(|(one, _)| one.name.contains("rear"))
        .map(|(_, level)| level * level)
        .sum();
    assert!(behind.sqrt() < 0.3 * loudest, "{levels:?}");

    // Twice as far from a head that looks the same way it is half as loud.
    let stage = Stage::find("cyberstage").unwrap();
    let listening = crate::audio::Listening::new(&stage);
    let head = stage.viewer.room_from_head;
    let power = |away: f64| {
        let place = head.translation.vector + nalgebra::Vector3::new(-0.4, -0.3, -0.8).normalize() * away;
        let paths = listening.paths(&head, &place.into());
        paths.0.iter().map(|path| f64::from(path.gain).powi(2)).sum::<f64>()
    };
    assert!((power(1.0) / power(2.0) - 4.0).abs() < 1e-4);
}

#[test]
fn a_gain_is_heard() {
    let level = |keys: &str| {
        let keys = format!("effect.dynamics = {{ modes = 6 }}\n{keys}");
        let mut heard = strip(&keys, "desktop");
        heard.strike(10);
        rms(&heard.channels[0])
    };
    let louder = level("effect.sound.gain_db = 6.0206") / level("");
    assert!((louder - 2.0).abs() < 1e-3, "{louder}");
}
