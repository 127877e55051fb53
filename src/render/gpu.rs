//! The graphics device. In: nothing but the machine's drivers (and `WGPU_BACKEND`, where set). Out: a device that says what
//! it is, because a software device or an OpenGL fallback is fit for tests, not for a wall. Where the device has timestamps,
//! [`Clock`] reads how long each pass took on it.

use super::error::RenderError;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// Longer than any frame takes, so that a hung driver becomes an error instead of a hung program.
const WAIT_LIMIT: Duration = Duration::from_secs(120);

/// One device with its queue, opened for pictures off screen or for windows.
pub struct Gpu {
    pub adapter_name: String,
    /// `Vulkan`, `Metal`, `Dx12` or `Gl`.
    pub backend: wgpu::Backend,
    pub driver: String,
    /// True when the "GPU" is the CPU (lavapipe, llvmpipe, WARP).
    pub is_software: bool,
    pub instance: wgpu::Instance,
    pub adapter: wgpu::Adapter,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// Bytes that one storage binding may have; bodies are split to it. A test lowers it.
    pub storage_limit: u64,
    /// The memory made on the device so far.
    pub made: ResourceCounts,
    clock: Option<Clock>,
    /// The first error the device reported since it was last asked; wgpu would panic if nobody listened.
    reported: Arc<Mutex<Option<String>>>,
}

/// Counts of the buffers and pipelines made on a device since it was opened, whether they are still there or not.
#[derive(Debug, Default)]
pub struct ResourceCounts {
    buffer_bytes: AtomicU64,
    storage_bytes: AtomicU64,
    compute_pipelines: AtomicU64,
}

impl ResourceCounts {
    /// Bytes of all buffers.
    pub fn buffer_bytes(&self) -> u64 {
        self.buffer_bytes.load(Ordering::Relaxed)
    }

    /// Bytes of the buffers that compute passes read or write.
    pub fn storage_bytes(&self) -> u64 {
        self.storage_bytes.load(Ordering::Relaxed)
    }

    pub fn compute_pipelines(&self) -> u64 {
        self.compute_pipelines.load(Ordering::Relaxed)
    }

    pub(super) fn count_pipeline(&self) {
        self.compute_pipelines.fetch_add(1, Ordering::Relaxed);
    }
}

/// Features that are used if a device has them: both eyes in one pass, also multisampled; time on the device.
const OPTIONAL: wgpu::Features =
    wgpu::Features::MULTIVIEW.union(wgpu::Features::MULTISAMPLE_ARRAY).union(wgpu::Features::TIMESTAMP_QUERY);

impl Gpu {
    /// The best device of this machine, without a window.
    /// Errors: [`RenderError::NoAdapter`] without any driver, [`RenderError::NoDevice`] when the driver fails.
    pub fn headless() -> Result<Self, RenderError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        Self::open(instance, None)
    }

    /// The best device of `instance` that can present on `surface`.
    pub(super) fn open(
        instance: wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<Self, RenderError> {
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoAdapter(error.to_string()))?;
        let info = adapter.get_info();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("greenstage"),
            required_features: adapter.features() & OPTIONAL,
            required_limits: adapter.limits(),
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoDevice { adapter: info.name, reason: error.to_string() })?;
        Ok(Self::from_adapter(instance, adapter, device, queue))
    }

    /// A device that was opened elsewhere, as the runtime of a headset does.
    pub fn from_adapter(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        device: wgpu::Device,
        queue: wgpu::Queue,
    ) -> Self {
        let info = adapter.get_info();
        let reported = Arc::new(Mutex::new(None));
        let listener = reported.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            tracing::error!("graphics device: {error}");
            let mut first = listener.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| error.to_string());
        }));
        let limits = device.limits();
        let gpu = Self {
            storage_limit: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            made: ResourceCounts::default(),
            clock: None,
            adapter_name: info.name,
            backend: info.backend,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            is_software: info.device_type == wgpu::DeviceType::Cpu,
            instance,
            adapter,
            device,
            queue,
            reported,
        };
        tracing::info!("drawing with {}", gpu.describe());
        gpu
    }

    /// One line for logs and tables, with the warning where one is due.
    pub fn describe(&self) -> String {
        let software = if self.is_software { ", in software on the CPU" } else { "" };
        let fallback =
            if self.backend == wgpu::Backend::Gl { ", the fallback for want of Vulkan" } else { "" };
        format!("{} by {:?}{fallback}{software} ({})", self.adapter_name, self.backend, self.driver)
    }

    /// Whether both eyes can be drawn in one pass with `samples` samples a pixel.
    pub fn can_multiview(&self, samples: u32) -> bool {
        let features = self.device.features();
        features.contains(wgpu::Features::MULTIVIEW)
            && (samples == 1 || features.contains(wgpu::Features::MULTISAMPLE_ARRAY))
    }

    /// Waits until everything submitted is drawn; returns how long that took.
    pub fn wait(&self) -> Result<Duration, RenderError> {
        let start = Instant::now();
        self.device
            .poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(WAIT_LIMIT) })
            .map_err(|error| RenderError::Device(error.to_string()))?;
        self.check()?;
        Ok(start.elapsed())
    }

    /// Submits what was uploaded and waits until all is done.
    /// Errors: as [`Gpu::wait`].
    pub fn finish(&self) -> Result<Duration, RenderError> {
        self.queue.submit([]);
        self.wait()
    }

    /// Hands over the error the device reported since the last check, if any.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        match self.reported.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(message) => Err(RenderError::Device(message)),
            None => Ok(()),
        }
    }

    /// A buffer, refused with the numbers when the device cannot hold it.
    pub(super) fn buffer(
        &self,
        what: &'static str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limit = self.device.limits().max_buffer_size;
        if bytes > limit {
            return Err(RenderError::BufferSize { what, bytes, limit });
        }
        let descriptor =
            wgpu::BufferDescriptor { label: Some(what), size: bytes, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        self.check()?;
        self.made.buffer_bytes.fetch_add(bytes, Ordering::Relaxed);
        if usage.contains(BufferUsages::STORAGE) {
            self.made.storage_bytes.fetch_add(bytes, Ordering::Relaxed);
        }
        Ok(buffer)
    }

    /// Writes to a buffer of vertices or instances, which is made anew of `room` bytes where it is too small.
    pub(super) fn write_vertices(
        &self,
        buffer: &mut Option<wgpu::Buffer>,
        what: &'static str,
        bytes: &[u8],
        room: usize,
    ) -> Result<(), RenderError> {
        let fitting = buffer.take().filter(|buffer| buffer.size() >= bytes.len() as u64);
        let usage = BufferUsages::VERTEX | BufferUsages::COPY_DST;
        let fitting = fitting.map_or_else(|| self.buffer(what, room as u64, usage), Ok)?;
        self.queue.write_buffer(&fitting, 0, bytes);
        *buffer = Some(fitting);
        Ok(())
    }

    /// A buffer that is bound whole as storage.
    pub(super) fn storage(
        &self,
        what: &'static str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limit = self.storage_limit;
        if bytes > limit {
            return Err(RenderError::BufferSize { what, bytes, limit });
        }
        self.buffer(what, bytes, usage | BufferUsages::STORAGE)
    }

    /// Calls `read` with the bytes of a readable buffer, once everything submitted so far is done.
    pub(super) fn mapped<T>(
        &self,
        buffer: &wgpu::Buffer,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, RenderError> {
        let failed = |error: &dyn std::fmt::Display| {
            RenderError::Device(format!("what it drew or computed cannot be read: {error}"))
        };
        let (sender, receiver) = mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver waits below; if it is gone, so is the need for an answer.
            sender.send(result).ok();
        });
        self.wait()?;
        receiver.try_recv().map_err(|error| failed(&error))?.map_err(|error| failed(&error))?;
        let value = read(&buffer.get_mapped_range(..).map_err(|error| failed(&error))?);
        buffer.unmap();
        Ok(value)
    }

    /// Starts to time every pass; false if the device has no clock.
    pub fn start_clock(&mut self) -> Result<bool, RenderError> {
        if self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            let resolved = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
            let readable = BufferUsages::COPY_DST | BufferUsages::MAP_READ;
            let buffers = [
                self.buffer("clock", Clock::BYTES, resolved)?,
                self.buffer("clock", Clock::BYTES, readable)?,
            ];
            self.clock = Some(Clock::new(&self.device, buffers));
        }
        Ok(self.clock.is_some())
    }

    /// Name and time, s, of the passes since the last reading, in their order; none before [`Gpu::start_clock`].
    pub fn read_clock(&self) -> Result<Vec<(&'static str, f64)>, RenderError> {
        let Some(clock) = self.clock.as_ref().filter(|clock| !clock.is_empty()) else {
            return Ok(Vec::new());
        };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (labels, readable) = clock.resolve(&mut encoder);
        self.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = self.mapped(readable, bytemuck::pod_collect_to_vec)?;
        let tick_s = f64::from(self.queue.get_timestamp_period()) * 1e-9;
        let spans = ticks.chunks_exact(2).map(|span| span[1].saturating_sub(span[0]) as f64 * tick_s);
        Ok(labels.into_iter().zip(spans).collect())
    }

    pub(super) fn clock(&self) -> Option<&Clock> {
        self.clock.as_ref()
    }
}

/// Passes between two readings; more are not timed.
const PASSES: u32 = 256;

/// A query set of a beginning and an end per pass. No query is made until [`Gpu::start_clock`] is called.
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
