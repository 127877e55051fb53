//! Ends the program safely on Ctrl-C, or another request to end, while a force device is open: first the force, then the
//! program.
//!
//! Such a signal would end the process at once, and the device might go on pushing with the last force that it was told.
//! Ends that nobody asked for (a fault, an abort) are handled by [`last_word`].

use super::thread::stop_all;
use crate::base::last_word;
use crate::base::signal::on_end;
use std::sync::Once;
use std::time::Duration;

/// A loop ends within one tick, and the connection of its device within this time.
const PATIENCE: Duration = Duration::from_secs(2);

/// From the first call on, the devices are told to push no more before such a signal ends the program.
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
