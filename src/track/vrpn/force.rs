//! Has a VRPN force device push: the newest force field wins, and whoever sets it never waits for the network.
//!
//! The bytes follow the protocol's description; no force device was at hand to verify them.

use super::client::Control;
use super::payload::ForceField;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, park_timeout};
use std::time::Duration;

/// Sends force fields; dropped, it has the device push no more, if its client is still there.
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
        let thread = Builder::new().name("vrpn force".into()).spawn(move || {
            while !shared.stop.load(Relaxed) && !control.stop.load(Relaxed) {
                let field = shared.field.lock().unwrap_or_else(PoisonError::into_inner).take();
                match field {
                    Some(field) => drop(control.push(&field)),
                    None => park_timeout(Duration::from_millis(50)),
                }
            }
            control.push(&ForceField::default());
        });
        ForceSender { newest, thread: thread.ok() }
    }

    /// The device is to push like this from now on. Never blocks: where the sending thread is just taking the last
    /// field, this one is left out, false, and the next tick's comes instead; always, where the system gave no thread.
    pub fn set(&self, field: ForceField) -> bool {
        let (Some(thread), Ok(mut newest)) = (&self.thread, self.newest.field.try_lock()) else {
            return false;
        };
        *newest = Some(field);
        drop(newest);
        thread.thread().unpark();
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
