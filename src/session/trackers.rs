//! Starts the trackers of a session, and joins their states with those of mouse or script.

use crate::base::failure::Failure;
use crate::effect::haptics::{HapticSource, live};
use crate::stage::Stage;
use crate::track::device::Source;
use crate::track::{Signal, TrackerSet, TrackerState, open};
use crate::world::RunningEffect;

/// Starts the trackers of a stage; `None` where it names none. Force devices speak through their loops, where these run.
pub fn start(stage: &Stage, effects: &mut [Box<dyn RunningEffect>]) -> Result<Option<TrackerSet>, Failure> {
    TrackerSet::start(&stage.tracking, |name, kind| {
        let device = stage.haptics.iter().find(|haptic| haptic.tracker() == name);
        match device {
            Some(device) => match effects.iter_mut().find_map(|effect| effect.source(name)) {
                Some(source) => Ok(source),
                None => Ok(Box::new(HapticSource::alone(live::open(device)?)) as Box<dyn Source>),
            },
            None => Ok(open(name, kind)?),
        }
    })
}

/// Head and styli as they are tracked. A head that is not tracked comes from `other`; so do the styli, behind the tracked
/// ones, while no stylus is tracked.
pub fn merge(mut tracked: TrackerState, other: TrackerState) -> TrackerState {
    tracked.head = tracked.head.or(other.head);
    if tracked.styli.iter().all(|stylus| matches!(stylus.signal, Signal::Lost { .. })) {
        tracked.styli.extend(other.styli);
    }
    TrackerState { time_s: other.time_s, ..tracked }
}
