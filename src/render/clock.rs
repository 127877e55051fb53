//! Time on the device itself: how long each pass took, by its own timestamps, where the device has them.
//!
//! Nothing is measured, and no query is made, until [`super::Gpu::start_clock`] is called.

use super::{Gpu, RenderError};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use wgpu::BufferUsages;

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
    pub(super) fn new(gpu: &Gpu) -> Result<Clock, RenderError> {
        let bytes = u64::from(2 * PASSES) * 8;
        Ok(Clock {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("clock"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES,
            }),
            resolved: gpu.buffer("clock", bytes, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC)?,
            readable: gpu.buffer("clock", bytes, BufferUsages::COPY_DST | BufferUsages::MAP_READ)?,
            passes: AtomicU32::new(0),
            labels: Mutex::default(),
        })
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

    /// Label and seconds of every pass since the last reading, in order.
    pub(super) fn read(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, RenderError> {
        let labels = {
            let mut labels = self.labels.lock().unwrap_or_else(PoisonError::into_inner);
            self.passes.store(0, Ordering::Relaxed);
            std::mem::take(&mut *labels)
        };
        if labels.is_empty() {
            return Ok(Vec::new());
        }
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let queries = 2 * labels.len() as u32;
        encoder.resolve_query_set(&self.queries, 0..queries, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, self.readable.size());
        gpu.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = gpu.mapped(&self.readable, bytemuck::pod_collect_to_vec)?;
        let tick_s = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let spans = ticks
            .chunks_exact(2)
            .take(labels.len())
            .map(|span| span[1].saturating_sub(span[0]) as f64 * tick_s);
        Ok(labels.into_iter().zip(spans).collect())
    }
}
