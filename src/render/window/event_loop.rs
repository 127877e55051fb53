//! The process' only event loop, or the reason why there is none.

use super::super::error::RenderError;
use super::display::find_display;
use std::panic::catch_unwind;
use winit::event_loop::EventLoop;

/// Errors: [`RenderError::NoDisplay`] where there is no display, or a library is missing that windows need.
pub(super) fn event_loop() -> Result<EventLoop<()>, RenderError> {
    find_display()?;
    // winit panics when a library it loads at run time is missing; the user gets an error with the remedy instead.
    catch_unwind(build_event_loop)
        .map_err(|panic| no_display(panic_message(&*panic).to_owned()))?
        .map_err(|error| no_display(error.to_string()))
}

fn build_event_loop() -> Result<EventLoop<()>, winit::error::EventLoopError> {
    let mut builder = EventLoop::builder();
    #[cfg(target_os = "linux")]
    {
        // X11 allows it, and tests do not run on the main thread.
        use winit::platform::x11::EventLoopBuilderExtX11;
        builder.with_any_thread(true);
    }
    builder.build()
}

fn panic_message(panic: &(dyn std::any::Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("the window system did not start")
}

pub(super) fn no_display(reason: String) -> RenderError {
    RenderError::NoDisplay(format!(
        "{reason}; on X11 windows need libxcursor1, libxi6 and libxkbcommon-x11-0 (Debian, Ubuntu: apt install)"
    ))
}
