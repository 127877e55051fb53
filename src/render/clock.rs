//! Time on the device itself: how long each pass took, by its own timestamps, where the device has them.
//!
//! Nothing is measured, and no query is made, until [`super::Gpu::start_clock`] is called.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// Passes between two readings; more are not timed.
const PASSES: u32 = 256;

/// A query set of a beginning and an end per pass.
pub(super) struct Clock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    passes: AtomicU32,
    labels: Mutex<Vec<&'static str>>,
}

impl Clock {
    /// Bytes of each of its two buffers: where queries are resolved to, and where they are read.
    pub(super) const BYTES: u64 = 2 * PASSES as u64 * 8;

    pub(super) fn new(device: &wgpu::Device, [resolved, readable]: [wgpu::Buffer; 2]) -> Clock {
        Clock {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("clock"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES,
            }),
            resolved,
            readable,
            passes: AtomicU32::new(0),
            labels: Mutex::default(),
        }
    }

    /// Query set and the indices of a pass' beginning and end.
    pub(super) fn span(&self, label: &'static str) -> Option<(&wgpu::QuerySet, u32, u32)> {
        let mut labels = self.labels.lock().unwrap_or_else(PoisonError::into_inner);
        let pass = self.passes.load(Ordering::Relaxed);
        if pass == PASSES {
            return None;
        }
        self.passes.store(pass + 1, Ordering::Relaxed);
        labels.push(label);
        Some((&self.queries, 2 * pass, 2 * pass + 1))
    }

    /// The labels of the passes since the last reading, in order; their times lie in the buffer that is returned once
    /// `encoder` is submitted, a beginning and an end each, in ticks.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) -> (Vec<&'static str>, &wgpu::Buffer) {
        let labels = {
            let mut labels = self.labels.lock().unwrap_or_else(PoisonError::into_inner);
            self.passes.store(0, Ordering::Relaxed);
            std::mem::take(&mut *labels)
        };
        encoder.resolve_query_set(&self.queries, 0..2 * labels.len() as u32, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, self.readable.size());
        (labels, &self.readable)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.labels.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }
}
