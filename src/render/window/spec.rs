//! Requested properties of a window, and the monitors it may stand on, in the window system's own pixels.

/// One window, in physical pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WindowSpec {
    pub title: String,
    /// Monitor from whose corner `position` counts; None: from the corner of the desktop that spans all monitors.
    pub monitor: Option<MonitorChoice>,
    /// Place of the top left corner; None is the monitor's corner, or leaves it to the window manager.
    pub position: Option<[i32; 2]>,
    pub size: [u32; 2],
    /// Whether it gets the size of `monitor` instead.
    pub fills: bool,
    pub decorated: bool,
    /// Whether the window manager, where there is one, is asked to cover the whole monitor that holds the place.
    pub fullscreen: bool,
    /// X11: no window manager is asked (override-redirect). The place is exact, but no click gives it the keyboard.
    pub unmanaged: bool,
}

/// A monitor's place on the desktop, in physical pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Monitor {
    /// The name in the window system: `DP-1`; on X11, `xrandr` lists the same.
    pub name: String,
    pub at: [i32; 2],
    pub size: [u32; 2],
}

/// A monitor by number, in the order of [`super::monitors`], or by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MonitorChoice {
    Number(usize),
    Name(String),
}

impl std::fmt::Display for Monitor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Monitor { name, at, size } = self;
        write!(f, "\"{name}\", {} × {} at ({}, {})", size[0], size[1], at[0], at[1])
    }
}

impl std::fmt::Display for MonitorChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Name(name) => write!(f, "\"{name}\""),
        }
    }
}
