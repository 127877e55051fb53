//! Ctrl-C, or another request to end, while a force device is open: no force first, then the end.
//!
//! Such a signal ends a process where it stands, and a device may push with the last force for as long as it is told
//! nothing. What ends it without being asked for (a fault, an abort) is seen to by [`last_word`].

use super::thread::stop_all;
use crate::base::last_word;
use crate::base::signal::on_end;
use std::sync::Once;
use std::time::Duration;

/// A loop ends within a tick, and its device's connection within this.
const PATIENCE: Duration = Duration::from_secs(2);

/// From the first call on such a signal leaves no force.
pub fn end_without_force() {
    static ASKED: Once = Once::new();
    let stop = || {
        if !stop_all(PATIENCE) {
            last_word::speak();
        }
        None
    };
    ASKED.call_once(|| on_end(stop).keep());
}

#[cfg(test)]
mod tests;
