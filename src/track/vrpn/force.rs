//! Sends forces to a VRPN force device: the newest force field wins, and setting it never waits for the network.
//!
//! The bytes follow the protocol's description; no force device was at hand to verify them.

use super::connection::Control;
use super::payload::ForceField;
use crate::track::device::now_s;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, park_timeout};
use std::time::Duration;

/// Sends force fields. When it is dropped, it takes the force back if its client still exists.
pub struct ForceSender {
    newest: Arc<Newest>,
    thread: Option<JoinHandle<()>>,
}

/// A force that is not set again within this time is taken back, s, because its loop must have stopped.
const SILENT_S: f64 = 0.02;

#[derive(Default)]
struct Newest {
    field: Mutex<Option<ForceField>>,
    stop: AtomicBool,
}

impl ForceSender {
    pub fn new(control: Arc<Control>) -> ForceSender {
        let newest = Arc::new(Newest::default());
        let shared = newest.clone();
        let thread = Builder::new().name("vrpn force".into()).spawn(move || {
            let control = TakenBack(control);
            // When the device's current force was sent.
            let mut said_s = None;
            while !shared.stop.load(Relaxed) && !control.0.stop.load(Relaxed) {
                let field = shared.field.lock().unwrap_or_else(PoisonError::into_inner).take();
                match field {
                    Some(field) => {
                        control.0.push(&field);
                        said_s = (field != ForceField::default()).then(now_s);
                    }
                    None if said_s.is_some_and(|said_s| now_s() - said_s > SILENT_S) => {
                        control.0.push(&ForceField::default());
                        said_s = None;
                    }
                    None => park_timeout(Duration::from_millis(if said_s.is_some() { 5 } else { 50 })),
                }
            }
        });
        ForceSender { newest, thread: thread.ok() }
    }

    /// Sets the force from now on. Never blocks: while the sending thread takes the previous field, this one is skipped,
    /// which returns false, and the next tick's follows. Always false if the thread could not be started.
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

/// Takes the force back however the thread ends, even by a panic.
struct TakenBack(Arc<Control>);

impl Drop for TakenBack {
    fn drop(&mut self) {
        self.0.push(&ForceField::default());
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
