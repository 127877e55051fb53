//! A source for tests that reports what the test sets.

use super::device::{DeviceState, Source};
use std::sync::{Arc, Mutex, PoisonError};

/// A source without a device; clones report the same state.
#[derive(Clone, Default)]
pub struct FakeSource {
    shared: Arc<Mutex<DeviceState>>,
    latest: DeviceState,
}

impl FakeSource {
    /// Changes what the source reports from now on.
    pub fn change(&self, change: impl FnOnce(&mut DeviceState)) {
        change(&mut self.shared.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Source for FakeSource {
    fn describe(&self) -> String {
        "fake source".into()
    }

    fn latest(&mut self) -> &DeviceState {
        self.latest.clone_from(&self.shared.lock().unwrap_or_else(PoisonError::into_inner));
        &self.latest
    }
}
