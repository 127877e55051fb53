//! Has a VRPN force device push: the newest force field wins, and whoever sets it never waits for the network.
//!
//! The bytes follow the protocol's description; no force device was at hand to verify them.

use super::client::Control;
use super::payload::ForceField;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, park_timeout};
use std::time::Duration;

/// Sends force fields; dropped, it has the device push no more.
pub struct ForceSender {
    newest: Arc<Newest>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Newest {
    field: Mutex<Option<ForceField>>,
    stop: AtomicBool,
}

impl ForceSender {
    pub(super) fn new(control: Arc<Control>) -> ForceSender {
        let newest = Arc::new(Newest::default());
        let shared = newest.clone();
        let thread = std::thread::spawn(move || {
            while !shared.stop.load(Relaxed) && !control.stop.load(Relaxed) {
                let field = shared.field.lock().unwrap_or_else(PoisonError::into_inner).take();
                match field {
                    Some(field) => drop(control.push(&field)),
                    None => park_timeout(Duration::from_millis(50)),
                }
            }
            control.push(&ForceField::default());
        });
        ForceSender { newest, thread: Some(thread) }
    }

    /// The device is to push like this from now on. Never blocks: where the sending thread is just taking the last
    /// field, this one is left out, false, and the next tick's comes instead.
    pub fn set(&self, field: ForceField) -> bool {
        let Ok(mut newest) = self.newest.field.try_lock() else { return false };
        *newest = Some(field);
        drop(newest);
        self.thread.iter().for_each(|thread| thread.thread().unpark());
        true
    }
}

impl Drop for ForceSender {
    fn drop(&mut self) {
        self.newest.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}
