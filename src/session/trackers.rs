//! The trackers of a session: opened once, joined with what mouse or script say.

use super::haptic::{self, HapticSession};
use crate::base::failure::Failure;
use crate::effect::haptics::HapticSource;
use crate::stage::Stage;
use crate::track::device::{Source, now_s};
use crate::track::{TrackerSet, TrackerState, open};

/// Starts the trackers of a stage; `None` where it names none. Force devices speak through their loops, where these run.
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

/// Head and styli as they are tracked; what is not tracked now comes from `other`, behind them.
pub fn merge(rig: &mut TrackerSet, other: TrackerState) -> TrackerState {
    let mut state = rig.state(now_s());
    state.head = state.head.or(other.head);
    if !rig.is_pointing() {
        state.styli.extend(other.styli);
    }
    TrackerState { time_s: other.time_s, ..state }
}
