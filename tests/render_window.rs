//! Windows, where there is a display. A process has one event loop, so this file has one test;
//! GREENSTAGE_WINDOW_SECONDS=20 keeps the windows open to look at them.

mod render_common;
use greenstage::render::window::*;
use greenstage::render::*;
use nalgebra::{Matrix4, Point3, Vector3};
use render_common::*;
use std::time::{Duration, Instant};

struct TwoScreens {
    mesh: Mesh,
    body: Option<BodyBuffers>,
    end: Instant,
    frames: u32,
    times: WindowTimes,
    sizes: Vec<[u32; 2]>,
    inputs: Vec<Input>,
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
            [Tile { rect: [0, 0, width, height], show }]
        });
        let tiles: Vec<_> = tiles.collect();
        self.times = windows.draw(&tiles, &contents, None)?;
        self.frames += 1;
        let done = self.frames >= 12 && Instant::now() >= self.end;
        Ok(if done { Flow::Quit } else { Flow::Continue })
    }
}

#[test]
fn two_windows_of_one_process_draw_and_quit() {
    if let Err(reason) = find_display() {
        eprintln!("SKIPPED: {reason}");
        return;
    }
    let seconds = std::env::var("GREENSTAGE_WINDOW_SECONDS").map_or(0.0, |s| s.parse().unwrap());
    let spec = |title: &str, x, width| WindowSpec {
        title: title.to_owned(),
        position: Some([x, 20]),
        size: [width, 256],
        ..WindowSpec::default()
    };
    let specs = [spec("mono", 10, 320), spec("interlaced", 340, 640)];
    let mut app = TwoScreens {
        mesh: bent_tube(20, 16),
        body: None,
        end: Instant::now() + Duration::from_secs_f64(seconds),
        frames: 0,
        times: WindowTimes::default(),
        sizes: vec![],
        inputs: vec![],
    };
    run(&specs, WindowOptions { samples: 4, vsync: true }, &mut app).unwrap();
    println!("{} frames, the last one {:?}", app.frames, app.times);
    if seconds == 0.0 {
        assert_eq!(app.frames, 12);
        assert!(app.times.encode > Duration::ZERO, "the last frame was drawn");
    }
    // A tiling window manager may choose other sizes, but none of zero.
    assert!(app.sizes.iter().flatten().all(|&side| side > 0), "{:?}", app.sizes);
}
