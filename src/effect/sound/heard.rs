//! A session that is heard, for tests.

use crate::effect::{self, EFFECTS, Resolved};
use crate::green::GreenFile;
use crate::stage::Stage;
use crate::track::{StylusState, TrackerState};
use crate::world::World;
use crate::world::dissipation::Dissipation;
use nalgebra::Isometry3;
use std::sync::Arc;

pub const RATE_HZ: f64 = 48_000.0;

pub struct Heard {
    pub world: World,
    frame: u32,
    /// Pa.
    pub channels: Vec<Vec<f64>>,
}

impl Heard {
    pub fn of(scene: &Resolved, file: &Arc<GreenFile>, stage: &str) -> Heard {
        let world = effect::world(EFFECTS, scene, file, Stage::find(stage).unwrap()).unwrap();
        Heard { world, frame: 0, channels: Vec::new() }
    }

    /// A frame; the work that was done in it on the first body, and the energy that is heard, Pa² s.
    pub fn step(&mut self, room_from_stylus: Isometry3<f64>) -> (Dissipation, f64) {
        let stylus = StylusState { room_from_stylus: room_from_stylus.cast(), ..Default::default() };
        let time_s = f64::from(self.frame) / 60.0;
        self.frame += 1;
        self.world.step(&TrackerState { head: None, styli: vec![stylus], time_s }.into());
        (self.world.frame.bodies[0].dissipation, self.listen())
    }

    /// Takes what is heard since this was last asked for; its energy, Pa² s.
    pub fn listen(&mut self) -> f64 {
        let Some(sound) = self.world.effects.iter_mut().find_map(|effect| effect.heard()) else { return 0.0 };
        assert_eq!(f64::from(sound.rate_hz), RATE_HZ);
        self.channels.resize(sound.channels, Vec::new());
        let mut energy = 0.0;
        for moment in sound.samples.chunks_exact(sound.channels) {
            for (all, sample) in self.channels.iter_mut().zip(moment) {
                let pa = f64::from(*sample) * sound.full_scale_pa;
                energy += pa * pa / RATE_HZ;
                all.push(pa);
            }
        }
        energy
    }
}
