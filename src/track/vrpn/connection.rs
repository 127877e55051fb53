//! The data that a VRPN client's threads share: the connection to write to, and the state that the reading threads fill.

use super::codec::{self, Header};
use super::listener::Listener;
use super::payload::{ForceField, MessageKind, Payload};
use crate::base::guard::Guard;
use crate::track::device::{DeviceState, Link};
use crate::track::flow::RateLimiter;
use crate::track::worker::StatePublisher;
use std::io::Write;
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use triple_buffer::Output;

/// The data that the client and its threads share.
pub struct Control {
    pub stop: AtomicBool,
    /// The connection, for whoever writes.
    writer: Mutex<Option<Writer>>,
    hearing: Mutex<Hearing>,
}

/// The data of both reading threads: the meaning of messages, and how the state that follows from them is published.
pub struct Hearing {
    pub listener: Listener,
    publisher: StatePublisher,
}

struct Writer {
    /// Present for a device that has been sent a force.
    guard: Option<Guard>,
    stream: TcpStream,
}

/// The types that this side sends; their numbers are their positions here.
pub const SPOKEN: [MessageKind; 3] = [MessageKind::Ping, MessageKind::Pong, MessageKind::ForceField];

impl Control {
    pub fn new(device: &str) -> (Control, Output<DeviceState>) {
        let (publisher, newest) = StatePublisher::new();
        let hearing = Mutex::new(Hearing { listener: Listener::new(device), publisher });
        (Control { stop: AtomicBool::new(false), writer: Mutex::new(None), hearing }, newest)
    }

    pub fn hearing(&self) -> MutexGuard<'_, Hearing> {
        lock(&self.hearing)
    }

    /// Writes go to this stream from now on.
    pub fn connected(&self, stream: TcpStream) {
        *lock(&self.writer) = Some(Writer { guard: None, stream });
    }

    /// Sends a force field to the device; false if there is no connection. A guard takes the force back however the program ends.
    pub fn push(&self, field: &ForceField) -> bool {
        let bytes = message(&Payload::ForceField(*field));
        let is_force = field.force != [0.0; 3];
        self.write(|writer| {
            if is_force {
                writer.guarded()?.pushes()?;
            }
            writer.stream.write_all(&bytes)?;
            writer.guard.as_mut().filter(|_| !is_force).map_or(Ok(()), Guard::rests)
        })
    }

    pub fn send(&self, bytes: &[u8]) -> bool {
        self.write(|writer| writer.stream.write_all(bytes))
    }

    fn write(&self, write: impl FnOnce(&mut Writer) -> std::io::Result<()>) -> bool {
        let written = lock(&self.writer).as_mut().map(write);
        if let Some(Err(error)) = &written {
            tracing::debug!("vrpn: the connection ends: {error}");
            // A stream that was cut in the middle of a message cannot go on.
            self.hang_up();
        }
        matches!(written, Some(Ok(())))
    }

    /// Ends the connection, if there is one; its reader wakes up.
    pub fn hang_up(&self) {
        if let Some(writer) = lock(&self.writer).take() {
            let _ = writer.stream.shutdown(Shutdown::Both);
        }
    }
}

impl Writer {
    fn guarded(&mut self) -> std::io::Result<&mut Guard> {
        let guard = match self.guard.take() {
            Some(guard) => guard,
            None => Guard::start(&self.stream, &message(&Payload::ForceField(ForceField::default())))
                .inspect_err(|error| {
                    tracing::warn!("vrpn: no force is sent: its guard does not start ({error})")
                })?,
        };
        Ok(self.guard.insert(guard))
    }
}

impl Hearing {
    pub fn publish(&mut self) {
        self.publisher.publish(&self.listener.state);
    }

    pub fn publish_changed(&mut self, has_changed: bool) -> bool {
        self.publisher.publish_changed(&self.listener.state, has_changed)
    }

    pub fn set_link(&mut self, link: Link) {
        self.publisher.set_link(&mut self.listener.state, link);
    }

    pub fn throttle(&mut self, limiter: &mut RateLimiter, began_s: f64) -> Option<Duration> {
        self.publisher.throttle(&mut self.listener.state, limiter, began_s)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A message of this side's device.
pub fn message(payload: &Payload) -> Vec<u8> {
    let kind = SPOKEN.iter().position(|kind| *kind == payload.kind()).unwrap_or(0);
    let mut bytes = Vec::with_capacity(96);
    codec::encode(&Header::now(0, kind as i32), &payload.encode(), &mut bytes);
    bytes
}
