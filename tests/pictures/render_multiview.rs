//! Both eyes in one pass against one after the other, and views that leave out what they cannot see.

use crate::render_common::{bent_tube, black_room, off_axis, require_gpu, square};
use greenstage::render::{
    Attachments, BodyInstance, COLOR_FORMAT, DrawCounts, Drawable, EyePair, FrameContents, Gpu, Grid,
    Offscreen, RenderError, Renderer, StylusShape, View, Viewport,
};
use image::RgbaImage;
use nalgebra::{Matrix4, Point3, Rotation3, Vector3};

const SIZE: [u32; 2] = [320, 256];

fn eyes() -> [Option<View>; 2] {
    let eye = |x| off_axis(Point3::new(0.0, 0.9, 0.0), [1.2, 0.96], -0.7, Point3::new(x, 1.7, 0.9));
    [-0.032, 0.032].map(|x| Some(eye(x)))
}

fn pen(place: Vector3<f32>, hit: Option<Point3<f32>>) -> StylusShape {
    let room_from_stylus =
        Matrix4::new_translation(&place) * Matrix4::new_rotation(Vector3::new(-0.4, 0.5, 0.0));
    StylusShape { room_from_stylus, size_m: 0.25, ray_length_m: 1.5, bend: None, hit, pressed: hit.is_some() }
}

/// Both pictures of a pair, and whether one pass drew them.
fn draw_pair(
    gpu: &Gpu,
    renderer: &mut Renderer,
    views: [Option<View>; 2],
    contents: &FrameContents,
) -> ([RgbaImage; 2], bool) {
    let pair = EyePair::readable(gpu, renderer, SIZE).unwrap();
    let viewports = views.map(|view| Viewport::full(SIZE, view)[0]);
    renderer.draw(gpu, &pair.pictures(&viewports), contents).unwrap();
    ([0, 1].map(|eye| pair.read(gpu, eye).unwrap()), pair.is_one_pass())
}

/// On a software device there is but a body within the picture, in the dark: lavapipe 22.3 draws a triangle that the
/// picture's edge cuts into the first eye's layer alone, which is why it is not asked to outside of this test.
#[test]
fn one_pass_for_both_eyes_draws_what_two_passes_draw() {
    let Some(gpu) = require_gpu() else { return };
    let tube = bent_tube(72, 70).buffers(&gpu);
    let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 0.98, 0.08));
    let bodies = [BodyInstance { buffers: &tube, room_from_body }];
    let styli =
        [pen(Vector3::new(0.3, 1.2, 0.3), None), pen(Vector3::zeros(), Some(Point3::new(0.1, 1.0, 0.0)))]
            .map(Drawable::Stylus);
    let mut contents = FrameContents { bodies: &bodies, ..Default::default() };
    if gpu.is_software {
        contents.lighting = black_room();
    } else {
        contents.drawables = [&styli, &[]];
        contents.grid = Some(Grid::new(Point3::new(0.0, 0.78, 0.0), [1.6, 1.6], 0.1));
    }
    let [left, right] = eyes();
    for samples in [4, 1] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        let can = gpu.can_multiview(samples);
        assert_eq!(renderer.multiview, can && !gpu.is_software, "it is used where it is right");
        if !can {
            eprintln!("SKIPPED: no multiview with {samples} samples on {}", gpu.describe());
            continue;
        }
        for views in [[left, right], [left, None], [None, right], [None, None]] {
            renderer.multiview = true;
            let (one_pass, is_one) = draw_pair(&gpu, &mut renderer, views, &contents);
            assert!(is_one && renderer.counts.passes == 1);
            renderer.multiview = false;
            let (two_passes, is_one) = draw_pair(&gpu, &mut renderer, views, &contents);
            assert!(!is_one && renderer.counts.passes == 2);
            for eye in 0..2 {
                assert!(one_pass[eye] == two_passes[eye], "{samples} samples, eye {eye} of {views:?}");
                let lit = one_pass[eye].pixels().filter(|pixel| pixel.0[..3] != [0; 3]).count();
                assert_eq!(lit > 15_000, views[eye].is_some(), "{lit} pixels");
            }
        }
    }
}

#[test]
fn a_pass_for_both_eyes_wants_two_viewports_of_one_rectangle() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    renderer.multiview = gpu.can_multiview(4);
    if !renderer.multiview {
        let refused = Attachments::new(&gpu, COLOR_FORMAT, 4, SIZE, 2).err().unwrap();
        return assert!(matches!(refused, RenderError::NoMultiview { samples: 4, .. }));
    }
    let pair = EyePair::new(&gpu, &renderer, SIZE, EyePair::NO_OTHER_USAGE).unwrap();
    let [left, right] = eyes();
    let mut viewports = [left, right].map(|view| Viewport::full(SIZE, view)[0]);
    viewports[1].rect[2] -= 1;
    let drawn = renderer.draw(&gpu, &pair.pictures(&viewports), &FrameContents::default());
    assert!(matches!(drawn, Err(RenderError::NotAPair { found: 2 })), "{drawn:?}");
}

/// A small generator of equally distributed numbers in -1 to 1, the same on every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> Vector3<f32> {
        Vector3::from_fn(|_, _| self.next())
    }
}

/// Random heads before, in and behind the scene: leaving out shapes that a view cannot see changes no pixel.
#[test]
fn what_is_left_out_would_not_have_been_seen() {
    let Some(gpu) = require_gpu() else { return };
    let (tube, tile) =
        (bent_tube(12, 10).buffers(&gpu), square(0.2, [0.0; 3], [90, 160, 90, 0]).buffers(&gpu));
    let mut random = Random(7);
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let mut total = DrawCounts::default();
    for round in 0..40 {
        let place = |random: &mut Random, scale: f32| {
            let turn = Rotation3::from_scaled_axis(random.vector() * 3.0).to_homogeneous();
            Matrix4::new_translation(&(random.vector() * 1.5)) * turn * Matrix4::new_scaling(scale)
        };
        let bodies = [(&tube, 1.0), (&tile, 0.3), (&tube, 0.2), (&tile, 2.0)]
            .map(|(buffers, scale)| BodyInstance { buffers, room_from_body: place(&mut random, scale) });
        let styli = [0, 1].map(|k| {
            let hit = (k == 1).then(|| Point3::from(random.vector()));
            Drawable::Stylus(pen(random.vector() * 1.5, hit))
        });
        let contents = FrameContents { bodies: &bodies, drawables: [&styli, &[]], ..Default::default() };
        let eye = Point3::from(random.vector() * 1.2 + Vector3::new(0.0, 0.0, 1.6));
        let views =
            [-0.03, 0.03].map(|x| Some(off_axis(Point3::origin(), [0.8, 0.64], 0.0, eye + Vector3::x() * x)));
        renderer.multiview = round % 2 == 0 && gpu.can_multiview(1);
        renderer.culling = true;
        let (with, _) = draw_pair(&gpu, &mut renderer, views, &contents);
        let counts = renderer.counts;
        renderer.culling = false;
        let (without, _) = draw_pair(&gpu, &mut renderer, views, &contents);
        assert!(with == without, "round {round}: {counts:?}");
        assert_eq!((renderer.counts.drawn, renderer.counts.culled), (counts.drawn + counts.culled, 0));
        total.drawn += counts.drawn;
        total.culled += counts.culled;
    }
    println!("{total:?}");
    assert!(total.culled > 100 && total.drawn > 100, "both happen: {total:?}");
}

#[test]
fn targets_of_one_size_share_their_depth_and_samples() {
    let Some(gpu) = require_gpu() else { return };
    let renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let bytes = u64::from(SIZE[0] * SIZE[1]) * 4 * 8;
    let eight: Vec<_> = (0..8).map(|_| Offscreen::new(&gpu, &renderer, SIZE).unwrap()).collect();
    assert_eq!(renderer.attachment_bytes(), [bytes, 8 * bytes]);
    let other = Offscreen::new(&gpu, &renderer, [64, 64]).unwrap();
    assert_eq!(renderer.attachment_bytes()[0], bytes + 64 * 64 * 4 * 8);
    drop((eight, other));
    assert_eq!(renderer.attachment_bytes(), [0, 0], "what nobody draws into is given back");
}
