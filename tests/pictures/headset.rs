//! A headset as a source of views: no stage's screens, no window and no loop of winit's stand in its way.

use crate::common::folder;
use crate::render_common::{off_axis, require_gpu};
use greenstage::display::bodies::GpuBodies;
use greenstage::display::device;
use greenstage::display::offscreen::{Pictures, Targets};
use greenstage::display::presenter::{Images, Presenter};
use greenstage::display::view_source::{ViewSource, show};
use greenstage::prepare::Resolved;
use greenstage::render::{Samples, Show, Tile, View, Viewport};
use greenstage::session::{Request, Session};
use greenstage::stage::{BUILT_IN, Eye};
use greenstage::world::World;

/// Two eyes, each with a separate frustum and picture, as a runtime of headsets reports them.
struct Headset {
    eyes: [View; 2],
}

impl ViewSource for Headset {
    fn tiles(&self, _: &World, sizes: &[[u32; 2]]) -> Vec<Vec<Tile>> {
        let of = |(view, size): (&View, &[u32; 2])| {
            let [width, height] = *size;
            let show = Show::One(Viewport { rect: [0, 0, width, height], view: Some(*view) });
            vec![Tile { rect: [0, 0, width, height], show }]
        };
        self.eyes.iter().zip(sizes).map(of).collect()
    }
}

fn session(name: &str) -> Session {
    let text = "[body.b]\ngenerate = { block = { size = [1.0, 0.3, 0.3], cells = [8, 2, 2] } }\n\
                material = { young = 1.0e4, poisson = 0.3 }\nmodel = \"rotation\"\neffects = [\"ghost_rest\"]\n\
                control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let scene = Resolved::parse(text, &folder(name).join("scene.toml")).unwrap();
    let (_, desktop) = BUILT_IN.iter().find(|(stage, _)| *stage == "desktop").unwrap();
    let stage = folder(name).join("stereo.toml");
    std::fs::write(&stage, desktop.replacen("stereo = \"mono\"", "stereo = \"side_by_side\"", 1)).unwrap();
    let request = Request { stage: stage.to_str(), ..Request::new(&scene) };
    let mut session = Session::open(&request).unwrap();
    session.act(greenstage::interact::Action::ScaleScene(1.3));
    session.advance(0.1).unwrap();
    session
}

/// Through the rectangle of a screen, frusta of the test's own making show what the stage shows there.
#[test]
fn a_headset_sees_the_frame_by_its_own_frusta_without_a_window() {
    if require_gpu().is_none() {
        return;
    }
    let mut session = session("headset");
    let samples = Samples::Exactly(1);
    let mut screens =
        Targets::new(&mut session.world, Pictures::Eyes, samples, 0.25, device::Args::default()).unwrap();
    screens.draw(&session.world).unwrap();
    let expected: Vec<_> = screens.read().unwrap().0.into_iter().map(|(_, image)| image).collect();

    let mut images = Images::new(samples).unwrap();
    for image in &expected {
        images.add(image.dimensions().into(), [0; 2]).unwrap();
    }
    let mut bodies = GpuBodies::new(&images.gpu, &mut session.world, device::Args::default()).unwrap();
    let world = &session.world;
    let screen = &world.assets.stage.screens[0];
    let [right, up, normal] = screen.axes();
    assert!(right.x > 0.999 && up.y > 0.999 && normal.z > 0.999, "an upright screen");
    let size = [screen.width_m() as f32, screen.height_m() as f32];
    let eyes = [Eye::Left, Eye::Right].map(|eye| {
        let place = world.assets.stage.viewer.eye_in_room(&world.room_from_head, eye);
        off_axis(screen.point([0.0, 0.0]).cast(), size, 0.0, place.cast())
    });
    assert_eq!(images.sizes().len(), 2);
    show(world, &mut bodies, &Headset { eyes }, &mut images).unwrap();
    let (found, _) = images.read().unwrap();
    for (found, expected) in found.iter().zip(&expected) {
        let is_other = |(a, b): (&image::Rgba<u8>, &image::Rgba<u8>)| {
            a.0.iter().zip(&b.0).any(|(a, b)| a.abs_diff(*b) > 8)
        };
        let pixels = expected.pixels().count();
        let others = found.pixels().zip(expected.pixels()).filter(|pair| is_other(*pair)).count();
        assert!(others * 500 < pixels, "{others} of {pixels} pixels differ");
        let background = expected.get_pixel(0, 0);
        let drawn = expected.pixels().filter(|pixel| is_other((pixel, background))).count();
        assert!(drawn * 20 > pixels, "the body fills {drawn} of {pixels} pixels");
    }
    assert_ne!(found[0], found[1], "each eye has a picture of its own");
}
