//! For tests: a source that says what the test has it say.

use super::device::{DeviceState, Source};
use std::sync::{Arc, Mutex};

/// Clones say the same.
#[derive(Clone, Default)]
pub struct Puppet(Arc<Mutex<DeviceState>>, DeviceState);

impl Puppet {
    pub fn say(&self, change: impl FnOnce(&mut DeviceState)) {
        change(&mut self.0.lock().unwrap());
    }
}

impl Source for Puppet {
    fn describe(&self) -> String {
        "puppet".into()
    }

    fn latest(&mut self) -> &DeviceState {
        self.1.clone_from(&self.0.lock().unwrap());
        &self.1
    }
}
