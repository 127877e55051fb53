//! The effect in a world: the sound of each frame, when somebody asks for it.

use super::player::{Frames, Player, SoundFrame};
use super::settings::NAME;
use super::source::Source;
use crate::audio::Listening;
use crate::base::failure::Failure;
use crate::effect::entry::EffectInput;
use crate::world::running::Heard;
use crate::world::{Frame, RunningEffect, World};

/// Samples of a second in files.
const RATE_HZ: u32 = 48_000;

/// The longest frame, s.
const LONGEST_S: f64 = 1.0;

/// All that is heard.
pub struct Ensemble {
    sources: Vec<Source>,
    listening: Listening,
    rate_hz: f64,
    /// Time of all frames, s, and their samples.
    time_s: f64,
    samples: u64,
}

impl Ensemble {
    pub fn new(listed: &EffectInput<'_>, world: &World, rate_hz: f64) -> Ensemble {
        let of = |&(b, name): &(usize, &str)| Source::all((b, &listed.scene.bodies[name]), world, rate_hz);
        Ensemble {
            sources: listed.bodies.iter().flat_map(of).collect(),
            listening: Listening::new(&world.assets.stage),
            rate_hz,
            time_s: 0.0,
            samples: 0,
        }
    }

    /// The sound of a frame, and a warning for each body that is silent though it moves.
    pub fn frame(&mut self, world: &World, frame: &Frame) -> (SoundFrame, Vec<String>) {
        // What takes longer is no frame: something else held the program up.
        let is_frame = frame.dt_s.is_finite() && frame.dt_s <= LONGEST_S;
        let dt_s = if is_frame { frame.dt_s.max(0.0) } else { 0.0 };
        let begins = self.time_s * self.rate_hz;
        self.time_s += dt_s;
        let ends = (self.time_s * self.rate_hz).round() as u64;
        let mut of_frame = SoundFrame {
            samples: (ends - self.samples) as usize,
            offset: begins - self.samples as f64,
            ..SoundFrame::default()
        };
        self.samples = ends;
        let mut warnings = Vec::new();
        for source in &mut self.sources {
            let phrase = source.phrase(is_frame.then_some(&frame.bodies[source.b]), dt_s);
            let mut paths = self.listening.paths(&world.room_from_head, &source.place(world));
            paths.0.iter_mut().for_each(|path| path.gain *= source.gain as f32);
            of_frame.phrases.push(phrase);
            of_frame.paths.push(paths);
            warnings.extend(source.silence(world));
        }
        (of_frame, warnings)
    }

    /// Forgets what was heard last.
    pub fn break_off(&mut self) {
        self.sources.iter_mut().for_each(Source::break_off);
    }

    pub fn listening(&self) -> &Listening {
        &self.listening
    }

    /// A player for all sources.
    pub fn player(&self) -> Player {
        Player::new(&self.listening, self.rate_hz, self.sources.len())
    }
}

/// The sound of each frame, from the second time on that somebody asks for it.
struct Sounding {
    ensemble: Ensemble,
    player: Option<Player>,
    last: Option<Box<SoundFrame>>,
    samples: Vec<f32>,
    /// Whether somebody has asked yet.
    is_asked: bool,
}

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let ensemble = Ensemble::new(listed, world, f64::from(RATE_HZ));
    let samples = Vec::new();
    Ok(Some(Box::new(Sounding { ensemble, player: None, last: None, samples, is_asked: false })))
}

/// A frame that is played at once.
struct Single(Option<Box<SoundFrame>>);

impl Frames for Single {
    fn next(&mut self) -> Option<Box<SoundFrame>> {
        self.0.take()
    }

    fn done(&mut self, _: Box<SoundFrame>) {}

    fn waiting(&self) -> usize {
        0
    }
}

impl RunningEffect for Sounding {
    fn name(&self) -> &'static str {
        NAME
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        if !self.is_asked {
            return;
        }
        let (of_frame, warnings) = self.ensemble.frame(world, frame);
        self.last = Some(Box::new(of_frame));
        frame.warnings.extend(warnings);
    }

    fn heard(&mut self) -> Option<Heard<'_>> {
        self.is_asked = true;
        let channels = self.ensemble.listening.channels();
        let player = self.player.get_or_insert_with(|| self.ensemble.player());
        self.samples.clear();
        if let Some(frame) = self.last.take() {
            self.samples.resize(frame.samples * channels, 0.0);
            player.fill(&mut self.samples, &mut Single(Some(frame)));
        }
        let full_scale_pa = self.ensemble.listening.full_scale_pa;
        let limited = player.limited();
        Some(Heard { rate_hz: RATE_HZ, channels, samples: &self.samples, full_scale_pa, limited })
    }
}
