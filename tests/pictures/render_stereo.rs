//! Two eyes' pictures joined on the device are what their twin on the CPU makes of them, in every kind of stereo, at
//! every place of the desktop; and tiles leave each other alone.

use crate::render_common::*;
use greenstage::render::window::Monitor;
use greenstage::render::*;
use image::RgbaImage;
use nalgebra::{Matrix4, Point3, Vector3};

const SIZE: [u32; 2] = [160, 98];

fn eyes() -> [View; 2] {
    [-0.032, 0.032].map(|x| off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], -0.3, Point3::new(x, 1.5, 0.7)))
}

fn kinds() -> [(&'static str, Composite); 10] {
    [
        ("side by side", Composite::side_by_side(SIZE)),
        ("top bottom", Composite::top_bottom(SIZE)),
        ("frame packing", Composite::frame_packing(SIZE)),
        ("anaglyph", Composite::anaglyph(SIZE, Anaglyph::COLOUR)),
        ("grey anaglyph", Composite::anaglyph(SIZE, Anaglyph::GREY)),
        ("half-colour anaglyph", Composite::anaglyph(SIZE, Anaglyph::HALF_COLOUR)),
        ("Dubois anaglyph", Composite::anaglyph(SIZE, Anaglyph::DUBOIS)),
        ("rows", Composite::interlaced(SIZE, [0, 1])),
        ("columns", Composite::interlaced(SIZE, [1, 0])),
        ("checkerboard", Composite::interlaced(SIZE, [1, 1])),
    ]
}

struct Studio {
    gpu: Gpu,
    renderer: Renderer,
    painter: TilePainter,
    body: BodyBuffers,
}

impl Studio {
    fn new() -> Option<Self> {
        let gpu = require_gpu()?;
        let renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
        let body = bent_tube(20, 16).buffers(&gpu);
        Some(Self { gpu, renderer, painter: TilePainter::new(COLOR_FORMAT), body })
    }

    fn draw(&mut self, size: [u32; 2], desktop: [i32; 2], tiles: &[Tile], paint: Option<Paint>) -> RgbaImage {
        self.draw_on(&[], size, desktop, tiles, paint).unwrap()
    }

    fn draw_on(
        &mut self,
        monitors: &[Monitor],
        size: [u32; 2],
        desktop: [i32; 2],
        tiles: &[Tile],
        paint: Option<Paint>,
    ) -> Result<RgbaImage, RenderError> {
        let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 1.0, 0.0));
        let bodies = [BodyInstance { buffers: &self.body, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..FrameContents::default() };
        let image = Readable::new(&self.gpu, size).unwrap();
        let mut canvas = Canvas::default();
        let target = Target {
            window: 0,
            canvas: &mut canvas,
            texture: &image.view,
            size,
            desktop,
            monitors,
            tiles,
            contents: &contents,
        };
        self.painter.draw(&self.gpu, &mut self.renderer, &mut [target], paint)?;
        Ok(image.read(&self.gpu)?.0)
    }

    fn one(&mut self, size: [u32; 2], view: View) -> RgbaImage {
        let [width, height] = size;
        let show = Show::One(Viewport::full(size, Some(view))[0]);
        self.draw(size, [0, 0], &[Tile { rect: [0, 0, width, height], show }], None)
    }
}

fn two(composite: Composite, views: [View; 2], rect: [u32; 4]) -> Tile {
    let viewports = views.map(|view| Viewport::full(composite.eye_size, Some(view))[0]);
    Tile { rect, show: Show::Two(composite, viewports) }
}

/// Largest difference of a channel, and the share of pixels that differ at all.
fn difference(a: &RgbaImage, b: &RgbaImage) -> (u8, f64) {
    assert_eq!(a.dimensions(), b.dimensions());
    let worst = a.iter().zip(b.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    let differing = a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count();
    (worst, differing as f64 / f64::from(a.width() * a.height()))
}

#[test]
fn the_device_joins_two_eyes_as_the_cpu_does() {
    let Some(mut studio) = Studio::new() else { return };
    let [left, right] = eyes();
    for (name, composite) in kinds() {
        let pictures = [left, right].map(|view| studio.one(composite.eye_size, view));
        for desktop in [[0, 0], [1, 0], [0, 1], [-5, 1921]] {
            let rect = [0, 0, SIZE[0], SIZE[1]];
            let joined = studio.draw(SIZE, desktop, &[two(composite, [left, right], rect)], None);
            let [first, second] = &pictures;
            let (worst, _) = difference(&joined, &composite.compose([first, second], SIZE, desktop));
            let (swapped, share) = difference(&joined, &composite.compose([second, first], SIZE, desktop));
            println!("{name} at {desktop:?}: {worst}/255 off; eyes swapped {swapped}/255, {share:.3} differ");
            assert!(worst <= 1, "{name} at {desktop:?}: {worst}/255");
            assert!(swapped > 60 && share > 0.02, "{name}: swapped eyes go unseen: {swapped}/255, {share}");
            if composite.turns != [0, 0] {
                let beside =
                    [desktop[0] + composite.turns[0] as i32, desktop[1] + 1 - composite.turns[0] as i32];
                let (odd, _) = difference(&joined, &composite.compose([first, second], SIZE, beside));
                assert!(odd > 60, "{name}: a parity that is off by one goes unseen: {odd}/255");
            }
        }
    }
}

/// A panel polarises rows that it counts from its own corner, wherever it stands on the desktop; a tile that reaches over
/// its edge goes with the panel that shows most of it.
#[test]
fn interlaced_rows_count_from_the_corner_of_their_panel() {
    let Some(mut studio) = Studio::new() else { return };
    let [left, right] = eyes();
    let [width, height] = SIZE;
    let composite = Composite::interlaced(SIZE, [0, 1]);
    let pictures = [left, right].map(|view| studio.one(SIZE, view));
    let monitor = |at| Monitor { name: String::new(), at, size: [1000, 1000] };
    let desk = [monitor([0, 0]), monitor([1000, 135]), monitor([2000, 134])];
    for (at, panel) in [
        ([10, 20], [0, 0]),
        ([1010, 140], [1000, 135]),
        ([1000, 134], [1000, 135]),
        ([1950, 140], [2000, 134]),
    ] {
        let tile = two(composite, [left, right], [0, 0, width, height]);
        let joined = studio.draw_on(&desk, SIZE, at, &[tile], None).unwrap();
        let on_panel = [at[0] - panel[0], at[1] - panel[1]];
        let (worst, _) =
            difference(&joined, &composite.compose([&pictures[0], &pictures[1]], SIZE, on_panel));
        assert!(worst <= 1, "at {at:?}, on the panel at {panel:?}: {worst}/255");
    }
    let tile = two(composite, [left, right], [0, 0, width, height]);
    let beyond = studio.draw_on(&desk, SIZE, [0, -501], &[tile], None).unwrap();
    let (worst, _) = difference(&beyond, &composite.compose([&pictures[0], &pictures[1]], SIZE, [0, -501]));
    assert!(worst <= 1, "on no panel, by the desktop: {worst}/255");
}

/// Two projectors on one card, as of a bench: above a pair that shares its rows, below one eye, and a border.
#[test]
fn tiles_of_one_target_leave_each_other_alone() {
    let Some(mut studio) = Studio::new() else { return };
    let [left, right] = eyes();
    let [width, height] = SIZE;
    let upper = two(Composite::top_bottom(SIZE), [left, right], [8, 4, width, height]);
    let viewport = Viewport { rect: [10, 20, width - 30, height - 25], view: Some(right) };
    let lower = Tile { rect: [8, 4 + height, width, height], show: Show::One(viewport) };
    let tiles = [upper.clone(), lower.clone()];
    let size = [width + 16, 2 * height + 8];
    let together = studio.draw(size, [0, 0], &tiles, None);
    for (tile, rect) in [(upper, [8, 4, width, height]), (lower, [18, 24 + height, width - 30, height - 25])]
    {
        let [x, y, w, h] = rect;
        let alone = studio.draw(size, [0, 0], std::slice::from_ref(&tile), None);
        let of = |image: &RgbaImage| image::imageops::crop_imm(image, x, y, w, h).to_image();
        assert_eq!(difference(&of(&together), &of(&alone)).0, 0, "{rect:?}");
        assert!(of(&together).pixels().any(|pixel| pixel.0[0] > 100), "{rect:?} shows the body");
        let outside = alone
            .enumerate_pixels()
            .filter(|(px, py, _)| !((x..x + w).contains(px) && (y..y + h).contains(py)));
        assert!(
            outside.into_iter().all(|(.., pixel)| pixel.0 == [0, 0, 0, 255]),
            "{rect:?}: black beyond it"
        );
    }
}

#[test]
fn paint_comes_over_every_eyes_picture_before_they_are_joined() {
    let Some(mut studio) = Studio::new() else { return };
    let [left, right] = eyes();
    let [width, height] = SIZE;
    let pair = two(Composite::interlaced(SIZE, [0, 1]), [left, right], [0, 0, width, height]);
    let show = Show::One(Viewport::full(SIZE, Some(left))[0]);
    let single = Tile { rect: [width, 0, width, height], show };
    let mut seen = Vec::new();
    let mut paint = |_: &Gpu, picture: &EyePicture<'_>| {
        seen.push((picture.window, picture.tile, picture.slot, picture.texture_size, picture.rect));
        Ok(())
    };
    studio.draw([2 * width, height], [0, 0], &[pair, single], Some(&mut paint));
    let whole = [0, 0, width, height];
    let target = [2 * width, height];
    assert_eq!(
        seen,
        [(0, 0, 0, SIZE, whole), (0, 0, 1, SIZE, whole), (0, 1, 0, target, [width, 0, width, height])]
    );
}

#[test]
fn a_tile_beyond_its_target_is_refused() {
    let Some(mut studio) = Studio::new() else { return };
    let show = Show::One(Viewport::full(SIZE, None)[0]);
    let tiles = [Tile { rect: [1, 0, SIZE[0], SIZE[1]], show }];
    let result = studio.draw_on(&[], SIZE, [0, 0], &tiles, None);
    assert!(result.unwrap_err().to_string().contains("[1, 0, 160, 98]"));
}
