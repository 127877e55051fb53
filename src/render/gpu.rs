//! The graphics device. In comes nothing but the machine's drivers (and `WGPU_BACKEND`, where set); out goes a device
//! that says what it is, because a software device or an OpenGL fallback is fit for tests, not for a wall.

use super::RenderError;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

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
    /// The first error the device reported since it was last asked; wgpu would panic if nobody listened.
    reported: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// The best device of this machine, without a window.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] without any driver, [`RenderError::NoDevice`] when the driver fails.
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
            required_limits: adapter.limits(),
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoDevice { adapter: info.name.clone(), reason: error.to_string() })?;

        let reported = Arc::new(Mutex::new(None));
        let listener = reported.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            tracing::error!("graphics device: {error}");
            let mut first = listener.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| error.to_string());
        }));
        let gpu = Self {
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
        Ok(gpu)
    }

    /// One line for logs and tables, with the warning where one is due.
    pub fn describe(&self) -> String {
        let software = if self.is_software { ", in software on the CPU" } else { "" };
        let fallback =
            if self.backend == wgpu::Backend::Gl { ", the fallback for want of Vulkan" } else { "" };
        format!("{} by {:?}{fallback}{software} ({})", self.adapter_name, self.backend, self.driver)
    }

    /// Waits until everything submitted is drawn; returns how long that took.
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device failed or was lost.
    pub fn wait(&self) -> Result<Duration, RenderError> {
        let start = Instant::now();
        self.device
            .poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(WAIT_LIMIT) })
            .map_err(|error| RenderError::Device(error.to_string()))?;
        self.check()?;
        Ok(start.elapsed())
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
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limit = self.device.limits().max_buffer_size;
        if bytes > limit {
            return Err(RenderError::BufferSize { what, bytes, limit });
        }
        let descriptor =
            wgpu::BufferDescriptor { label: Some(what), size: bytes, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        self.check()?;
        Ok(buffer)
    }
}
