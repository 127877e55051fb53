//! An X server of a test's own, without a window manager, and what a test asks of it.
#![allow(dead_code, clippy::unwrap_used, reason = "each test file uses its part; a test may unwrap")]

use image::RgbImage;
use std::io::{BufRead, BufReader, IoSlice};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::xproto::{
    AtomEnum, ConfigureWindowAux, ConnectionExt, CreateWindowAux, ImageFormat, InputFocus, MapState,
    PropMode, Window, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// A process that ends with the test.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A window with its inner place and size.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Placed {
    pub title: String,
    pub at: [i32; 2],
    pub size: [u32; 2],
    pub id: Window,
}

pub struct Display {
    /// The value of DISPLAY.
    pub name: String,
    connection: RustConnection,
    root: Window,
    _server: Option<Running>,
}

impl Display {
    /// Starts a server with one screen of `size`; None, aloud, where Xvfb is not installed, unless
    /// GREENSTAGE_REQUIRE_DISPLAY=1 forbids that.
    pub fn start([width, height]: [u32; 2]) -> Option<Display> {
        let server = Command::new("Xvfb")
            // It finds a free number. Without -noreset it turns clients away whenever its last one has gone.
            .args(["-displayfd", "1", "-screen", "0", &format!("{width}x{height}x24")])
            .args(["-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut server = match server {
            Ok(server) => Running(server),
            Err(error) => {
                let is_required = std::env::var("GREENSTAGE_REQUIRE_DISPLAY").as_deref() == Ok("1");
                assert!(!is_required, "Xvfb does not start ({error}): scripts/setup.sh test installs it");
                eprintln!("SKIPPED: Xvfb does not start ({error})");
                return None;
            }
        };
        // It writes the number once it listens.
        let mut number = String::new();
        BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb ended at once");
        Some(Display { _server: Some(server), ..Display::connect(&format!(":{}", number.trim())) })
    }

    /// A server that runs already.
    pub fn connect(name: &str) -> Display {
        let (connection, screen) = x11rb::connect(Some(name)).unwrap();
        let root = connection.setup().roots[screen].root;
        Display { name: name.to_owned(), connection, root, _server: None }
    }

    /// `command` with its windows here.
    pub fn run(&self, command: &mut Command) -> Running {
        let command = command.env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        Running(command.env_remove("WAYLAND_SOCKET").spawn().unwrap())
    }

    /// Every window that has a title and can be seen, sorted by it. Those that go away meanwhile are left out.
    pub fn windows(&self) -> Vec<Placed> {
        let tree = self.connection.query_tree(self.root).unwrap().reply().unwrap();
        let title = self.atom(b"_NET_WM_NAME");
        let of = |&id: &Window| {
            // One that is not shown yet stands nowhere and takes no focus.
            let attributes = self.connection.get_window_attributes(id).unwrap().reply().ok()?;
            if attributes.map_state != MapState::VIEWABLE {
                return None;
            }
            let named = self.connection.get_property(false, id, title, AtomEnum::ANY, 0, 1024).unwrap();
            let place = self.connection.get_geometry(id).unwrap().reply().ok()?;
            let title =
                String::from_utf8(named.reply().ok()?.value).ok().filter(|title| !title.is_empty())?;
            let size = [place.width, place.height].map(u32::from);
            Some(Placed { title, at: [place.x, place.y].map(i32::from), size, id })
        };
        let mut found: Vec<Placed> = tree.children.iter().filter_map(of).collect();
        found.sort();
        found
    }

    pub fn move_window(&self, id: Window, [x, y]: [i32; 2]) {
        self.connection.configure_window(id, &ConfigureWindowAux::new().x(x).y(y)).unwrap().check().unwrap();
    }

    pub fn move_cursor(&self, [x, y]: [i16; 2]) {
        self.connection.warp_pointer(x11rb::NONE, self.root, 0, 0, 0, 0, x, y).unwrap().check().unwrap();
    }

    /// The window gets what is typed.
    pub fn focus(&self, id: Window) {
        let focus = self.connection.set_input_focus(InputFocus::PARENT, id, x11rb::CURRENT_TIME);
        focus.unwrap().check().unwrap();
    }

    /// Presses and releases the key of a keysym, by the server's extension for tests (XTEST 2.2, request FakeInput).
    pub fn type_key(&self, keysym: u32) {
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let map = self.connection.get_keyboard_mapping(first, last - first + 1).unwrap().reply().unwrap();
        let each = usize::from(map.keysyms_per_keycode);
        let row = map.keysyms.chunks_exact(each).position(|syms| syms[0] == keysym).unwrap();
        let code = first + row as u8;
        let opcode = self.connection.query_extension(b"XTEST").unwrap().reply().unwrap().major_opcode;
        for kind in [2_u8, 3] {
            let mut request = vec![opcode, 2, 9, 0, kind, code, 0, 0];
            request.extend([0_u32, self.root, 0, 0].iter().flat_map(|word| word.to_le_bytes()));
            request.resize(36, 0);
            let sent = self.connection.send_request_without_reply(&[IoSlice::new(&request)], Vec::new());
            sent.unwrap().check().unwrap();
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// Plays the daemon that sends all programs the settings of the desktop (XSETTINGS), to begin with 96 dots per inch.
    pub fn manage_settings(&self) -> Window {
        let (connection, id) = (&self.connection, self.connection.generate_id().unwrap());
        let nothing = CreateWindowAux::new();
        let class = WindowClass::INPUT_ONLY;
        connection
            .create_window(0, id, self.root, 0, 0, 1, 1, 0, class, 0, &nothing)
            .unwrap()
            .check()
            .unwrap();
        self.set_dpi(id, 96);
        let role = self.atom(b"_XSETTINGS_S0");
        connection.set_selection_owner(id, role, x11rb::CURRENT_TIME).unwrap().check().unwrap();
        id
    }

    pub fn set_dpi(&self, settings: Window, dpi: u32) {
        // Byte order, serial number, one setting: an integer, its name's length and name, serial number, 1024 · dpi.
        let name = b"Xft/DPI\0";
        let mut bytes = vec![0; 4];
        bytes.extend([dpi, 1].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend([0, 0, 7, 0].iter().chain(name));
        bytes.extend([dpi, 1024 * dpi].into_iter().flat_map(u32::to_le_bytes));
        let property = self.atom(b"_XSETTINGS_SETTINGS");
        let set = self.connection.change_property8(PropMode::REPLACE, settings, property, property, &bytes);
        set.unwrap().check().unwrap();
    }

    fn atom(&self, name: &[u8]) -> u32 {
        self.connection.intern_atom(false, name).unwrap().reply().unwrap().atom
    }

    /// The picture in a rectangle of the screen: x, y, width, height.
    pub fn picture(&self, [x, y, width, height]: [u32; 4]) -> RgbImage {
        let [x, y] = [x, y].map(|pixel| pixel as i16);
        let [w, h] = [width, height].map(|pixels| pixels as u16);
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, x, y, w, h, u32::MAX);
        // Blue, green, red, nothing.
        let pixels = image.unwrap().reply().unwrap().data;
        assert_eq!(pixels.len(), (4 * width * height) as usize);
        let rgb = pixels.chunks_exact(4).flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect();
        RgbImage::from_raw(width, height, rgb).unwrap()
    }
}

/// Asks again until the answer is there; a busy machine takes its time.
pub fn wait_for<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + Duration::from_secs(240);
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(Instant::now() < end, "waited four minutes for {what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}
