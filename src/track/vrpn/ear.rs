//! What a client's two threads hear with: one listener, and how its state is handed on.

use super::listener::Listener;
use crate::track::device::{DeviceState, Link, now_s};
use crate::track::pace::{NEWS_S, Pace};
use std::time::Duration;

pub struct Ear {
    pub listener: Listener,
    input: triple_buffer::Input<DeviceState>,
    published_s: f64,
    is_waiting: bool,
}

impl Ear {
    pub fn new(device: &str, input: triple_buffer::Input<DeviceState>) -> Ear {
        Ear { listener: Listener::new(device), input, published_s: 0.0, is_waiting: false }
    }

    pub fn publish(&mut self) {
        self.input.write(self.listener.state.clone());
        (self.published_s, self.is_waiting) = (now_s(), false);
    }

    /// Publishes if there is news, and if that was not done a moment ago; true: it is to be asked again soon.
    pub fn publish_news(&mut self, is_news: bool) -> bool {
        self.is_waiting |= is_news;
        if self.is_waiting && now_s() - self.published_s >= NEWS_S {
            self.publish();
        }
        self.is_waiting
    }

    /// The source worked since `began_s`: how long it waits, if it has used up its share.
    pub fn throttle(&mut self, pace: &mut Pace, began_s: f64) -> Option<Duration> {
        let wait_s = pace.worked(began_s, now_s())?;
        self.listener.state.counters.throttled += 1;
        self.publish();
        Some(Duration::from_secs_f64(wait_s))
    }

    /// Publishes how the connection is, if that changed.
    pub fn set_link(&mut self, link: Link) {
        if self.listener.state.link != link {
            self.listener.state.link = link;
            self.publish();
        }
    }
}
