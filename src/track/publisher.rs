//! Hands the newest state of a source's thread to the frame: without a lock, and not more often than is of use.

use super::device::{DeviceState, Link, now_s};
use super::rate_limiter::{PUBLISH_S, RateLimiter};
use std::time::Duration;
use triple_buffer::{Input, Output, triple_buffer};

/// The writing end; the newest state wins.
pub struct StatePublisher {
    newest: Input<DeviceState>,
    published_s: f64,
    is_waiting: bool,
}

impl StatePublisher {
    /// Both ends: the one that writes, and the one that reads.
    pub fn new() -> (StatePublisher, Output<DeviceState>) {
        let (newest, output) = triple_buffer(&DeviceState::default());
        (StatePublisher { newest, published_s: 0.0, is_waiting: false }, output)
    }

    pub fn publish(&mut self, state: &DeviceState) {
        self.newest.input_buffer_mut().clone_from(state);
        self.newest.publish();
        (self.published_s, self.is_waiting) = (now_s(), false);
    }

    /// Publishes a state that has changed, unless that was done a moment ago; true: ask again soon.
    pub fn publish_changed(&mut self, state: &DeviceState, has_changed: bool) -> bool {
        self.is_waiting |= has_changed;
        if self.is_waiting && now_s() - self.published_s >= PUBLISH_S {
            self.publish(state);
        }
        self.is_waiting
    }

    /// Publishes how the connection is, if that changed.
    pub fn set_link(&mut self, state: &mut DeviceState, link: Link) {
        if state.link != link {
            state.link = link;
            self.publish(state);
        }
    }

    /// The source has worked since `began_s`: how long it must wait, if it has used up its share of the time.
    pub fn throttle(
        &mut self,
        state: &mut DeviceState,
        limiter: &mut RateLimiter,
        began_s: f64,
    ) -> Option<Duration> {
        let wait_s = limiter.worked(began_s, now_s())?;
        state.counters.throttled += 1;
        self.publish(state);
        Some(Duration::from_secs_f64(wait_s))
    }
}
