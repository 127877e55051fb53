//! The monitors of the desktop, and where a window stands on them.

use super::super::error::RenderError;
use super::event_loop::{event_loop, no_display};
use super::spec::{Monitor, MonitorChoice, WindowSpec};
use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::monitor::MonitorHandle;
use winit::window::WindowId;

/// The monitors of the running display. Makes the process' only event loop: no window can be opened afterwards.
/// Errors: [`RenderError::NoDisplay`] where there is none.
pub fn monitors() -> Result<Vec<Monitor>, RenderError> {
    #[derive(Default)]
    struct Asker(Vec<Monitor>);
    impl ApplicationHandler for Asker {
        fn resumed(&mut self, event_loop: &ActiveEventLoop) {
            self.0 = all(event_loop).into_iter().map(|(monitor, _)| monitor).collect();
            event_loop.exit();
        }

        fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, _: WindowEvent) {}
    }
    let event_loop = event_loop()?;
    let mut asker = Asker::default();
    event_loop.run_app(&mut asker).map_err(|error| no_display(error.to_string()))?;
    Ok(asker.0)
}

fn all(event_loop: &ActiveEventLoop) -> Vec<(Monitor, MonitorHandle)> {
    event_loop.available_monitors().map(|handle| (described(&handle), handle)).collect()
}

pub(super) fn described(handle: &MonitorHandle) -> Monitor {
    let name = handle.name().unwrap_or_default();
    Monitor { name, at: handle.position().into(), size: handle.size().into() }
}

/// The monitor on which a pixel of the desktop lies.
pub(super) fn holding(event_loop: &ActiveEventLoop, pixel: [i32; 2]) -> Option<MonitorHandle> {
    let within = |monitor: &Monitor| {
        (0..2).all(|axis| {
            let along = i64::from(pixel[axis]) - i64::from(monitor.at[axis]);
            (0..i64::from(monitor.size[axis])).contains(&along)
        })
    };
    all(event_loop).into_iter().find(|(monitor, _)| within(monitor)).map(|(_, handle)| handle)
}

/// Place and size that a window is opened with.
/// Errors: a sentence when its monitor is not there.
pub(super) fn place(
    event_loop: &ActiveEventLoop,
    spec: &WindowSpec,
) -> Result<(Option<[i32; 2]>, [u32; 2]), String> {
    let Some(choice) = &spec.monitor else { return Ok((spec.position, spec.size)) };
    let monitors: Vec<Monitor> = all(event_loop).into_iter().map(|(monitor, _)| monitor).collect();
    let found = match choice {
        MonitorChoice::Number(number) => monitors.get(*number),
        MonitorChoice::Name(name) => monitors.iter().find(|monitor| monitor.name == *name),
    };
    let Some(monitor) = found else {
        let list: Vec<String> = monitors.iter().enumerate().map(|(i, m)| format!("{i} is {m}")).collect();
        return Err(format!("there is no monitor {choice}; {}", list.join(", ")));
    };
    let at = spec.position.unwrap_or_default();
    let position = [0, 1].map(|axis| monitor.at[axis].saturating_add(at[axis]));
    Ok((Some(position), if spec.fills { monitor.size } else { spec.size }))
}
