//! Sources of sound on a body: its modes, what rubs and cuts it, and a tone that follows its strain.
//!
//! In: the body in a frame. Out: a phrase for the source's voice, and the place in the room from which it is heard.

use super::listener::Listener;
use super::noise::NoiseAim;
use super::phrase::Phrase;
use super::pitch::Pitch;
use super::radiation::{Radiator, mean_square};
use super::settings::Settings;
use crate::effect::entry::ResolvedBody;
use crate::world::{BodyFrame, World};
use nalgebra::{Point3, Vector3};

/// Time for which a body may be without its modes before that is told, s.
const SILENT_S: f64 = 0.5;

/// A source of sound on a body.
pub struct Source {
    /// Index of the body.
    pub b: usize,
    pub gain: f64,
    heard: Heard,
}

enum Heard {
    Modes(Box<Modes>),
    Rubbing(Rubbing),
    Pitch(Pitch),
}

/// Modes that ring.
struct Modes {
    radiator: Radiator,
    listener: Listener,
    /// Time since they were heard, s.
    silent_s: f64,
}

/// Noise of friction and cutting.
struct Rubbing {
    /// Part of the power that is heard, and distance between bumps, m.
    efficiency: f64,
    roughness: f64,
    /// Last place and frequency.
    place: Option<Point3<f64>>,
    hertz: f64,
}

impl Source {
    /// All sources of a body, for voices that play so many samples in a second.
    pub fn all((b, body): (usize, &ResolvedBody), world: &World, rate_hz: f64) -> Vec<Source> {
        let (settings, deformer) = (Settings::of(body), &world.bodies[b].deformer);
        let modes = || {
            let radiator = Radiator::new(deformer.rest(), deformer.triangles());
            Heard::Modes(Box::new(Modes { radiator, listener: Listener::new(rate_hz), silent_s: 0.0 }))
        };
        let modes = body.entries().any(|effect| effect.vibrates).then(modes);
        let Settings { efficiency, roughness, .. } = settings;
        let rubbing = settings.hears_work(body).then_some(Heard::Rubbing(Rubbing {
            efficiency,
            roughness,
            place: None,
            hertz: 0.0,
        }));
        let all = modes.into_iter().chain(rubbing).chain(settings.pitch.map(Heard::Pitch));
        all.map(|heard| Source { b, gain: settings.gain(), heard }).collect()
    }

    /// The phrase of a frame so long; `None` for one in which time has not gone on.
    pub fn phrase(&mut self, frame: Option<&BodyFrame>, dt_s: f64) -> Phrase {
        let phrase = match &mut self.heard {
            Heard::Modes(modes) => modes.phrase(frame, dt_s),
            Heard::Rubbing(rubbing) => frame.map(|frame| rubbing.phrase(frame, dt_s)),
            Heard::Pitch(pitch) => frame.and_then(|frame| frame.largest).map(|largest| {
                let tone = Some(pitch.aim(&largest));
                Phrase { tone, ..Phrase::default() }
            }),
        };
        phrase.unwrap_or_default()
    }

    /// Forgets what was heard last.
    pub fn break_off(&mut self) {
        if let Heard::Modes(modes) = &mut self.heard {
            modes.listener.break_off();
        }
    }

    /// The place in the room from which it is heard.
    pub fn place(&self, world: &World) -> Point3<f64> {
        let own = match &self.heard {
            Heard::Rubbing(rubbing) => rubbing.place,
            Heard::Modes(_) | Heard::Pitch(_) => None,
        };
        own.unwrap_or_else(|| middle(world, self.b))
    }

    /// Warning of a body that is silent though it moves.
    pub fn silence(&self, world: &World) -> Option<String> {
        let Heard::Modes(modes) = &self.heard else { return None };
        if modes.silent_s <= SILENT_S {
            return None;
        }
        let deformer = &world.bodies[self.b].deformer;
        let (name, model) = (&deformer.body, deformer.entry.name);
        Some(format!(
            "body.{name} is silent while some of its elements are held and others released: its model \"{model}\" has other modes in \
             every step. Write model = \"linear\", or hold or release all elements"
        ))
    }
}

impl Modes {
    fn phrase(&mut self, frame: Option<&BodyFrame>, dt_s: f64) -> Option<Phrase> {
        let Some(vibration) = frame.and_then(|frame| frame.vibration.as_ref()) else {
            self.listener.break_off();
            self.silent_s += dt_s;
            return None;
        };
        self.silent_s = 0.0;
        Some(self.listener.phrase(vibration, &self.radiator))
    }
}

impl Rubbing {
    fn phrase(&mut self, frame: &BodyFrame, dt_s: f64) -> Phrase {
        let mut square = 0.0;
        if let Some((place, way)) = frame.dissipation.mean().filter(|_| dt_s > 0.0) {
            square = mean_square(self.efficiency * frame.dissipation.work / dt_s);
            (self.place, self.hertz) = (Some(place), way / dt_s / self.roughness);
        }
        let noise = Some(NoiseAim { square, hertz: self.hertz });
        Phrase { noise, ..Phrase::default() }
    }
}

/// The middle of a body's surface in the room.
fn middle(world: &World, b: usize) -> Point3<f64> {
    let body = &world.bodies[b];
    let places = body.deformer.positions();
    let sum: Vector3<f64> = places.iter().map(|place| Vector3::from(place.map(f64::from))).sum();
    body.room_from_surface() * Point3::from(sum / places.len().max(1) as f64)
}
