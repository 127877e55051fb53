//! The mixer runs in the audio thread, which must not wait for memory.

use crate::memory;
use greenstage::audio::{Listening, Mixer};
use greenstage::stage::{SoundOutput, Stage};
use nalgebra::Point3;

/// Blocks of sources that move, through each output, allocate nothing, also where the limiter acts.
#[test]
fn mixing_allocates_nothing() {
    for output in [SoundOutput::Loudspeakers, SoundOutput::Headphones, SoundOutput::Stereo] {
        let mut stage = Stage::find("cyberstage").unwrap();
        stage.sound.output = output;
        let listening = Listening::new(&stage);
        let mut mixer = Mixer::new(&listening, 48_000.0, 4);
        let samples: Vec<f32> = (0..256).map(|k| (k as f32 * 0.1).sin()).collect();
        let mut out = vec![0.0; samples.len() * listening.channels()];
        let path = |k: usize| {
            let place = Point3::new((k as f64).sin(), 1.2, (k as f64).cos());
            listening.paths(&stage.viewer.room_from_head, &place)
        };
        let paths: Vec<_> = (0..32).map(path).collect();
        let mix = || {
            for (k, paths) in paths.iter().enumerate() {
                out.fill(0.0);
                mixer.add(k % 4, paths, &samples, &mut out);
                out[0] = 1e3;
                mixer.finish(&mut out);
            }
        };
        let ((), bytes) = memory::peak_of(mix);
        assert_eq!(bytes, 0, "{output:?}");
    }
}
