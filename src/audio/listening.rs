//! What a stage is heard from: the ways of a source to the channels, for a head and a place in the room.
//!
//! In: a [`Stage`]; then the tracked head and the source's place. Out: [`Paths`]. A source's pressure falls with 1/r. A loudspeaker is
//! calibrated at the viewer's place by the stage file; where the head is nearer, its gain is less by the ratio of the distances,
//! and it waits until the sound of the farthest has arrived, so that a source is heard from where it is and not from the
//! nearest loudspeaker (precedence effect).

use super::ears::{SPEED_OF_SOUND, ears};
use super::panning::Panner;
use super::paths::{MOST_DELAY_S, Path, Paths};
use crate::stage::{SoundOutput, Stage};
use nalgebra::{Isometry3, Point3, Vector3};
use std::f64::consts::SQRT_2;

/// A source nearer to the head than this sounds as loud as one at this distance, m.
const NEAREST_M: f64 = 0.1;
/// Sound pressure level of 0 dB, Pa.
pub const REFERENCE_PA: f64 = 20e-6;

/// The loudspeakers or headphones of a stage.
#[derive(Clone, Debug)]
pub struct Listening {
    /// The name of the audio device; the system's own if there is none.
    pub device: Option<String>,
    /// Amplitude of the pressure of a sine at digital full scale, Pa.
    pub full_scale_pa: f64,
    output: Output,
}

#[derive(Clone, Debug)]
enum Output {
    Headphones,
    Loudspeakers {
        panner: Box<Panner>,
        /// Each loudspeaker's place, and its distance from the viewer by the stage file, m.
        places: Vec<(Point3<f64>, f64)>,
    },
}

impl Listening {
    pub fn new(stage: &Stage) -> Listening {
        let sound = &stage.sound;
        let full_scale_pa = SQRT_2 * REFERENCE_PA * 10f64.powf(sound.loudest_db / 20.0);
        let output = match sound.output {
            SoundOutput::Headphones => Output::Headphones,
            SoundOutput::Loudspeakers | SoundOutput::Stereo => loudspeakers(stage),
        };
        Listening { device: sound.device.clone(), full_scale_pa, output }
    }

    /// The number of channels: of loudspeakers, or of ears.
    pub fn channels(&self) -> usize {
        match &self.output {
            Output::Headphones => 2,
            Output::Loudspeakers { places, .. } => places.len(),
        }
    }

    /// The ways of a source at `place` in the room to all channels.
    pub fn paths(&self, room_from_head: &Isometry3<f64>, place: &Point3<f64>) -> Paths {
        let head = Point3::from(room_from_head.translation.vector);
        let away = place - head;
        // Within the head a sound has no direction.
        let direction = away.try_normalize(1e-6).unwrap_or_else(|| room_from_head.rotation * -Vector3::z());
        let pressure = 1.0 / away.norm().max(NEAREST_M);
        let mut paths = Paths::SILENT;
        if !pressure.is_finite() || !direction.iter().all(|x| x.is_finite()) {
            return paths;
        }
        match &self.output {
            Output::Headphones => {
                let ears = ears(&room_from_head.inverse_transform_vector(&direction));
                for (path, (delay_s, shadow)) in paths.0.iter_mut().zip(ears) {
                    *path = Path { gain: pressure as f32, delay_s: delay_s as f32, shadow: shadow as f32 };
                }
            }
            Output::Loudspeakers { panner, places } => {
                let gains = panner.gains(&head, &direction);
                let farthest_m = places.iter().map(|(place, _)| (place - head).norm()).fold(0.0, f64::max);
                for ((path, gain), (place, calibrated_m)) in paths.0.iter_mut().zip(gains).zip(places) {
                    let distance_m = (place - head).norm();
                    let delay_s = ((farthest_m - distance_m) / SPEED_OF_SOUND).min(MOST_DELAY_S);
                    path.gain = (gain * pressure * distance_m / calibrated_m) as f32;
                    path.delay_s = delay_s as f32;
                }
            }
        }
        paths
    }
}

fn loudspeakers(stage: &Stage) -> Output {
    let head = stage.viewer.room_from_head;
    let viewer = Point3::from(head.translation.vector);
    let used = stage.sound.used(&head);
    let places: Vec<Point3<f64>> = used.iter().map(|one| one.position).collect();
    let panner = Box::new(Panner::new(&places, viewer));
    // One in the viewer's place is calibrated beside it.
    let calibrated = |place: Point3<f64>| (place, (place - viewer).norm().max(NEAREST_M));
    Output::Loudspeakers { panner, places: places.into_iter().map(calibrated).collect() }
}
