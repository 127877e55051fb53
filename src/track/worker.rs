//! The thread of a source: it receives, keeps a [`DeviceState`], and publishes the newest one without a lock.
//!
//! In: a function that runs until it is asked to stop. Out: a [`Source`]. The thread does what every source needs besides
//! its protocol: publishing, stopping, and waiting longer after each failure. [`StatePublisher`] hands the newest state to
//! the frame, not more often than is of use.

use super::device::{DeviceState, Link, Source, now_s};
use super::flow::{PUBLISH_S, RateLimiter};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use triple_buffer::{Input, Output, triple_buffer};

/// A running source, which stops when it is dropped.
pub struct Worker {
    description: String,
    newest: Output<DeviceState>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// The thread's side of it.
pub struct Publisher {
    /// The newest state; readers see it once it is published.
    pub state: DeviceState,
    newest: StatePublisher,
    stop: Arc<AtomicBool>,
}

/// The wait before the next attempt, which is twice as long each time, and the longest one, s.
const FIRST_WAIT_S: f64 = 0.25;
const LONGEST_WAIT_S: f64 = 5.0;
/// Time between two checks of a waiting thread whether it must stop, s.
const SLICE_S: f64 = 0.05;

impl Worker {
    /// Runs `run` in a separate thread; it must return soon after [`Publisher::is_stopped`].
    pub fn spawn(
        description: String,
        run: impl FnOnce(Publisher) + Send + 'static,
    ) -> std::io::Result<Worker> {
        let (publisher, newest) = StatePublisher::new();
        let stop = Arc::new(AtomicBool::new(false));
        let publisher = Publisher { state: DeviceState::default(), newest: publisher, stop: stop.clone() };
        let name = description.chars().filter(|c| *c != '\0').take(15).collect();
        let thread = std::thread::Builder::new().name(name).spawn(move || run(publisher))?;
        Ok(Worker { description, newest, stop, thread: Some(thread) })
    }

    /// Runs `session` again and again: it opens the device, reads it, and returns why it ended. After a failure it waits
    /// longer each time, until a message has come.
    pub fn reconnecting(
        description: String,
        mut session: impl FnMut(&mut Publisher) -> String + Send + 'static,
    ) -> std::io::Result<Worker> {
        Worker::spawn(description, move |mut publisher| {
            let mut wait_s = FIRST_WAIT_S;
            loop {
                let before = publisher.state.counters.messages;
                let why = session(&mut publisher);
                if publisher.state.counters.messages > before {
                    wait_s = FIRST_WAIT_S;
                }
                publisher.down(why);
                if !publisher.pause(wait_s) {
                    return;
                }
                wait_s = (2.0 * wait_s).min(LONGEST_WAIT_S);
                publisher.state.counters.reconnects += 1;
            }
        })
    }

    /// Does not wait for the thread at the end, because it is blocked in a read that only the device ends.
    #[must_use]
    pub fn detached(mut self) -> Worker {
        self.thread = None;
        self
    }
}

impl Source for Worker {
    fn describe(&self) -> String {
        self.description.clone()
    }

    fn latest(&mut self) -> &DeviceState {
        self.newest.read()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

impl Publisher {
    pub fn publish(&mut self) {
        self.newest.publish(&self.state);
    }

    /// Publishes a state that has changed, unless that was done a moment ago; true: ask again soon.
    pub fn publish_changed(&mut self, has_changed: bool) -> bool {
        self.newest.publish_changed(&self.state, has_changed)
    }

    /// The source has worked since `began_s`: how long it must wait, if it has used up its share of the time.
    pub fn throttle(&mut self, limiter: &mut RateLimiter, began_s: f64) -> Option<Duration> {
        self.newest.throttle(&mut self.state, limiter, began_s)
    }

    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Publishes why the source is gone, once per reason.
    pub fn down(&mut self, reason: impl Into<String>) {
        self.newest.set_link(&mut self.state, Link::Down(reason.into()));
    }

    /// Waits; false if it was stopped meanwhile.
    pub fn pause(&self, seconds: f64) -> bool {
        let mut left_s = seconds;
        while left_s > 0.0 && !self.is_stopped() {
            std::thread::sleep(Duration::from_secs_f64(left_s.min(SLICE_S)));
            left_s -= SLICE_S;
        }
        !self.is_stopped()
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::device::now_s;

    #[test]
    fn the_newest_state_is_read_and_the_thread_stops() {
        let mut worker = Worker::reconnecting("test".into(), |publisher| {
            publisher.state.counters.packets = 7;
            publisher.publish();
            "no cable".into()
        })
        .unwrap();
        let deadline = now_s() + 10.0;
        while worker.latest().counters.reconnects == 0 {
            assert!(now_s() < deadline);
            std::thread::yield_now();
        }
        assert_eq!(worker.latest().counters.packets, 7);
        assert_eq!(worker.latest().link, Link::Down("no cable".into()));
        let stopped = now_s();
        drop(worker);
        assert!(now_s() - stopped < 5.0, "the longest wait is cut short");
    }
}
