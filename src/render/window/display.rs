//! Finds whether there is a display, from the environment and the server's socket, without opening a window and without winit,
//! whose event loop exists once per process.

use super::super::error::RenderError;

/// Ok when windows can be expected to open.
/// Errors: [`RenderError::NoDisplay`] with the reason: no variable set, or nobody answers where it points.
#[cfg(all(unix, not(target_os = "macos")))]
pub fn find_display() -> Result<(), RenderError> {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    match set("DISPLAY") {
        Some(name) => connect_x11(&name)
            .map_err(|reason| RenderError::NoDisplay(format!("DISPLAY is \"{name}\", but {reason}"))),
        None if set("WAYLAND_DISPLAY").is_some() => Err(RenderError::NoDisplay(
            "DISPLAY is not set: windows stand at exact places, which X11 can and Wayland cannot; install Xwayland, \
             which sets it"
                .to_owned(),
        )),
        None => Err(RenderError::NoDisplay("DISPLAY is not set".to_owned())),
    }
}

/// Ok: these systems always have a display where programs may open windows.
#[cfg(not(all(unix, not(target_os = "macos"))))]
pub fn find_display() -> Result<(), RenderError> {
    Ok(())
}

/// `name` is `[host]:display[.screen]`, as in X(7).
#[cfg(all(unix, not(target_os = "macos")))]
fn connect_x11(name: &str) -> Result<(), String> {
    use std::net::{TcpStream, ToSocketAddrs};
    use std::time::Duration;

    let (host, rest) = name.rsplit_once(':').ok_or("that is not [host]:number")?;
    let number = rest.split('.').next().unwrap_or_default();
    let number: u16 =
        number.parse().map_err(|error| format!("\"{number}\" is no display number ({error})"))?;
    if matches!(host, "" | "unix") || host.starts_with('/') {
        return connect_local(number);
    }
    let port = 6000_u16.checked_add(number).ok_or("its display number is beyond TCP's ports")?;
    let host = host.strip_prefix("tcp/").unwrap_or(host).trim_matches(['[', ']']);
    let addresses =
        (host, port).to_socket_addrs().map_err(|error| format!("its host is unknown ({error})"))?;
    let reachable = |address| TcpStream::connect_timeout(&address, Duration::from_secs(3)).is_ok();
    if addresses.into_iter().any(reachable) {
        Ok(())
    } else {
        Err(format!("{host} port {port} does not answer"))
    }
}

#[cfg(all(unix, not(target_os = "macos")))]
fn connect_local(number: u16) -> Result<(), String> {
    use std::os::unix::net::UnixStream;

    let path = format!("/tmp/.X11-unix/X{number}");
    #[cfg(target_os = "linux")]
    {
        use std::os::linux::net::SocketAddrExt;
        let abstract_name = std::os::unix::net::SocketAddr::from_abstract_name(path.as_bytes());
        if abstract_name.is_ok_and(|address| UnixStream::connect_addr(&address).is_ok()) {
            return Ok(());
        }
    }
    UnixStream::connect(&path).map(drop).map_err(|error| format!("{path} does not answer ({error})"))
}

#[cfg(all(test, unix, not(target_os = "macos")))]
mod tests {
    use super::connect_x11;
    use proptest::prelude::*;

    #[test]
    fn a_display_nobody_serves_is_refused_with_the_place_asked() {
        assert!(connect_x11(":64999").unwrap_err().contains("/tmp/.X11-unix/X64999"));
        assert!(connect_x11("here").unwrap_err().contains("[host]:number"));
        assert!(connect_x11(":x.0").unwrap_err().contains("\"x\""));
        assert!(connect_x11("[::1]:60000").unwrap_err().contains("beyond TCP"));
    }

    proptest! {
        #[test]
        fn no_value_of_display_panics(name in "[^:]{0,8}:?[^0-9]{0,8}") {
            prop_assert!(connect_x11(&name).is_err());
        }
    }
}
