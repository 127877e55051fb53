//! Starts the trackers of a session, and joins their states with those of mouse or script.

use super::haptic::{self, HapticSession};
use crate::base::failure::Failure;
use crate::effect::haptics::HapticSource;
use crate::stage::Stage;
use crate::track::device::{Source, now_s};
use crate::track::{TrackerSet, TrackerState, open};

/// Starts the trackers of a stage; `None` where it names none. A force device reports
/// through its force loop, if that runs.
pub fn start(stage: &Stage, mut loops: Option<&mut HapticSession>) -> Result<Option<TrackerSet>, Failure> {
    TrackerSet::start(&stage.tracking, |name, kind| {
        let device = stage.haptics.iter().find(|haptic| haptic.tracker() == name);
        match device {
            Some(device) => match loops.as_mut().and_then(|loops| loops.source(&device.name)) {
                Some(source) => Ok(Box::new(source) as Box<dyn Source>),
                None => Ok(Box::new(HapticSource::alone(haptic::open(device)?))),
            },
            None => Ok(open(name, kind)?),
        }
    })
}

/// Head and styli as they are tracked. A head that is not tracked comes from `other`; so do the styli, behind the tracked
/// ones, while no stylus is tracked.
pub fn merge(trackers: &mut TrackerSet, other: TrackerState) -> TrackerState {
    let mut state = trackers.state(now_s());
    state.head = state.head.or(other.head);
    if !trackers.is_pointing() {
        state.styli.extend(other.styli);
    }
    TrackerState { time_s: other.time_s, ..state }
}
