//! Windows of one process. A process has one event loop, so the test that opens them runs in a separate process, on a separate
//! display. To look at them on yours: GREENSTAGE_WINDOW_SECONDS=20 cargo test --profile quick --test pictures -- --ignored
//! render_window

use crate::display_common::Display;
use crate::render_common::*;
use greenstage::render::window::*;
use greenstage::render::*;
use nalgebra::{Matrix4, Point3, Vector3};
use std::io::Read;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

struct TwoScreens {
    mesh: Mesh,
    body: Option<BodyBuffers>,
    end: Instant,
    frames: u32,
    times: PresentTimes,
    sizes: Vec<[u32; 2]>,
    inputs: Vec<Input>,
    display: Display,
    settings: u32,
}

/// Target of the cursor in the first window, as a share of its size.
const CURSOR: [f32; 2] = [0.5, 0.25];

impl TwoScreens {
    fn has_cursor(&self) -> bool {
        self.inputs.contains(&Input::Cursor { window: 0, position: CURSOR })
    }
}

impl WindowApp for TwoScreens {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        println!("{}", gpu.describe());
        self.body = Some(BodyBuffers::new(gpu, &self.mesh.triangles, &self.mesh.colors)?);
        Ok(())
    }

    fn input(&mut self, input: Input) {
        println!("{input:?}");
        self.inputs.push(input);
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let body = self.body.as_mut().ok_or("frame before start")?;
        body.upload(&windows.gpu, &self.mesh.positions, &self.mesh.normals)?;
        let turn = Matrix4::new_rotation(Vector3::new(0.0, 0.02 * self.frames as f32, 0.0));
        let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 1.0, 0.0)) * turn;
        let bodies = [BodyInstance { buffers: body, room_from_body }];
        let grid = Some(Grid::new(Point3::new(0.0, 0.7, 0.0), [1.2, 1.2], 0.1));
        let contents = FrameContents { bodies: &bodies, grid, ..FrameContents::default() };
        let [left, right] = [-0.032, 0.032]
            .map(|x| off_axis(Point3::new(0.0, 0.95, 0.0), [1.2, 0.96], -0.7, Point3::new(x, 1.8, 0.9)));
        self.sizes = windows.sizes().collect();
        let tiles = self.sizes.iter().enumerate().map(|(window, &[width, height])| {
            let whole = |view| Viewport::full([width, height], Some(view))[0];
            let composite = Composite::interlaced([width, height], [0, 1]);
            let show = match window {
                0 => Show::One(whole(left)),
                _ => Show::Two(composite, [whole(left), whole(right)]),
            };
            vec![Tile { rect: [0, 0, width, height], show }]
        });
        let tiles: Vec<_> = tiles.collect();
        assert!(windows.waited > Duration::ZERO, "a frame begins when its images are there");
        self.times = windows.draw(&tiles, &vec![&contents; tiles.len()], None)?;
        self.frames += 1;
        if self.frames == 6 {
            // As a projector that calls itself 160 mm wide would: three times as many pixels to the inch.
            self.display.set_dpi(self.settings, 288);
            self.display.move_cursor([10 + 160, 20 + 64]);
        }
        let done = self.frames >= 12 && self.has_cursor() && Instant::now() >= self.end;
        // The test then fails for want of the cursor.
        let is_hopeless = Instant::now() >= self.end + Duration::from_secs(240);
        Ok(if done || is_hopeless { Flow::Quit } else { Flow::Continue })
    }
}

#[test]
fn two_windows_of_one_process_draw_and_quit() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([1024, 400]) else { return };
    let status = alone(&display, "render_window::opens_two_windows");
    assert!(status.success(), "{status}");
}

/// Runs one test of this file in a separate process, where it opens windows on `display`.
fn alone(display: &Display, name: &str) -> ExitStatus {
    let mut inner = Command::new(std::env::current_exe().unwrap());
    inner.args(["--ignored", "--exact", name, "--nocapture"]).stdout(Stdio::piped());
    let mut running = display.run(&mut inner);
    let mut said = String::new();
    running.0.stdout.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("running 1 test"), "there is no test {name}: {said}");
    running.0.wait().unwrap()
}

struct Ends(Flow);

impl WindowApp for Ends {
    fn start(&mut self, _: &Gpu) -> Result<(), AppError> {
        Ok(())
    }

    fn input(&mut self, _: Input) {}

    /// Ends the first frame, whose images were acquired, before anything is drawn into them.
    fn frame(&mut self, _: &mut Windows) -> Result<Flow, AppError> {
        match self.0 {
            Flow::Quit => Ok(Flow::Quit),
            Flow::Continue => panic!("in a frame"),
        }
    }
}

/// A frame that ends the program has images that nobody will see; the windows go all the same, with status 0, or 101
/// after a panic: not by an abort.
#[test]
fn a_frame_that_quits_or_panics_undrawn_ends_without_an_abort() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([1024, 400]) else { return };
    for (name, expected) in [("quits_undrawn", 0), ("panics_undrawn", 101)] {
        let status = alone(&display, &format!("render_window::{name}"));
        assert_eq!(status.code(), Some(expected), "{name}: {status}");
    }
}

fn end_by(flow: Flow) {
    let spec = |x| WindowSpec { position: Some([x, 20]), size: [320, 256], ..WindowSpec::default() };
    run(
        &[spec(10), spec(340)],
        WindowOptions { samples: Samples::Exactly(4), vsync: false },
        &mut Ends(flow),
    )
    .unwrap();
}

#[test]
#[ignore = "opens windows: a_frame_that_quits_or_panics_undrawn_ends_without_an_abort runs it"]
fn quits_undrawn() {
    end_by(Flow::Quit);
}

#[test]
#[ignore = "opens windows: a_frame_that_quits_or_panics_undrawn_ends_without_an_abort runs it"]
fn panics_undrawn() {
    end_by(Flow::Continue);
}

#[test]
#[ignore = "opens windows: two_windows_of_one_process_draw_and_quit runs it on a display of its own"]
fn opens_two_windows() {
    let seconds = std::env::var("GREENSTAGE_WINDOW_SECONDS").map_or(0.0, |s| s.parse().unwrap());
    let spec = |title: &str, x, width| WindowSpec {
        title: title.to_owned(),
        position: Some([x, 20]),
        size: [width, 256],
        ..WindowSpec::default()
    };
    let display = Display::connect(&std::env::var("DISPLAY").unwrap());
    let specs = [spec("mono", 10, 320), spec("interlaced", 340, 640)];
    let mut app = TwoScreens {
        mesh: bent_tube(20, 16),
        body: None,
        end: Instant::now() + Duration::from_secs_f64(seconds),
        frames: 0,
        times: PresentTimes::default(),
        sizes: vec![],
        inputs: vec![],
        settings: display.manage_settings(),
        display,
    };
    run(&specs, WindowOptions { samples: Samples::Exactly(4), vsync: true }, &mut app).unwrap();
    println!("{} frames, the last one {:?}", app.frames, app.times);
    assert!(app.times.encode > Duration::ZERO, "the last frame was drawn");
    // The cursor was moved after the scale: the windows would have grown before it was told.
    assert!(app.has_cursor());
    assert_eq!(app.sizes, [[320, 256], [640, 256]]);
}
