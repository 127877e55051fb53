//! Lines, quads and balls of the room view: as wide as asked for, in the right colour from either side, cut at the near
//! plane, and no pipeline where there are none.

use crate::render_common::{black_room, draw_full, off_axis, require_gpu};
use greenstage::base::strips::{StripKind, Strips};
use greenstage::render::{
    Arrow, Ball, COLOR_FORMAT, Drawable, FrameContents, Gpu, Grid, Line, Quad, Renderer, View,
};
use image::RgbaImage;
use nalgebra::{Point3, Vector3};

const SIZE: [u32; 2] = [100, 80];

/// 1 × 0.8 m about the origin, seen from 2 m away.
fn before() -> View {
    off_axis(Point3::origin(), [1.0, 0.8], 0.0, Point3::new(0.0, 0.0, 2.0))
}

fn behind() -> View {
    let turn = nalgebra::Matrix4::new_rotation(nalgebra::Vector3::new(0.0, std::f32::consts::PI, 0.0));
    let View { clip_from_room, .. } = before();
    View { clip_from_room: clip_from_room * turn, eye_in_room: Point3::new(0.0, 0.0, -2.0) }
}

fn drawn(gpu: &Gpu, renderer: &mut Renderer, view: View, contents: &FrameContents) -> RgbaImage {
    draw_full(gpu, renderer, SIZE, view, &FrameContents { lighting: black_room(), ..*contents })
}

const GREEN: [f32; 4] = [0.0, 1.0, 0.0, 1.0];

fn line(from: [f32; 3], to: [f32; 3], width_px: f32) -> Line {
    Line { from, to, color: GREEN, width_px, over: 0.0 }
}

#[test]
fn pipelines_are_made_with_the_first_thing_that_they_draw() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    drawn(&gpu, &mut renderer, before(), &FrameContents::default());
    assert_eq!(renderer.made(), ["background"]);
    let lines = [Drawable::Lines(vec![line([-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], 2.0)])];
    drawn(&gpu, &mut renderer, before(), &FrameContents { drawables: [&lines, &[]], ..Default::default() });
    assert_eq!(renderer.made(), ["background", "lines"]);
    let arrow =
        Arrow { from: Point3::origin(), along: Vector3::x(), radius_m: 0.1, color: [1.0; 3], through: false };
    drawn(
        &gpu,
        &mut renderer,
        before(),
        &FrameContents { drawables: [&[Drawable::Arrow(arrow)], &[]], ..Default::default() },
    );
    assert_eq!(renderer.made(), ["solid", "background", "lines"]);
    let grid = Some(Grid::new(Point3::origin(), [1.0, 1.0], 0.1));
    drawn(&gpu, &mut renderer, before(), &FrameContents { grid, ..Default::default() });
    assert_eq!(renderer.made(), ["solid", "background", "grid", "lines"]);
}

/// The light of a line adds up to its width, near and far, level and slanting, with one and with four samples a pixel.
#[test]
fn a_line_is_as_wide_as_asked_for_wherever_it_runs() {
    let Some(gpu) = require_gpu() else { return };
    for samples in [1, 4] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        for (width_px, to) in [
            (3.0, [0.4, 0.0, 0.0]),
            (1.5, [0.4, 0.0, 0.0]),
            (0.5, [0.4, 0.0, 0.0]),
            (3.0, [0.3, 0.13, 1.4]),
            (2.0, [0.3, 0.23, -5.0]),
        ] {
            let lines = [Drawable::Lines(vec![line([-0.4, -0.013, 0.0], to, width_px)])];
            let picture = drawn(
                &gpu,
                &mut renderer,
                before(),
                &FrameContents { drawables: [&lines, &[]], ..Default::default() },
            );
            let linear = |value: u8| (f64::from(value) / 255.0).powf(2.2);
            // Upright through the line, a column at a time: the cosine of its slope makes it longer.
            let column = |x: u32| (0..SIZE[1]).map(|y| linear(picture.get_pixel(x, y)[1])).sum::<f64>();
            let middle = |x: u32| {
                let at = |y: u32| f64::from(y) * linear(picture.get_pixel(x, y)[1]);
                (0..SIZE[1]).map(at).sum::<f64>() / column(x)
            };
            let (a, b) = (20, 50);
            let slope = (middle(b) - middle(a)) / f64::from(b - a);
            let found = (a..b).map(column).sum::<f64>() / f64::from(b - a) / (1.0 + slope * slope).sqrt();
            assert!(
                (found - f64::from(width_px)).abs() < 0.06 * f64::from(width_px) + 0.03,
                "{samples} samples, {width_px} px to {to:?}: {found}"
            );
        }
    }
}

#[test]
fn a_line_that_passes_the_eye_is_cut_at_the_near_plane() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let mut green = |from, to| {
        let lines = [Drawable::Lines(vec![line(from, to, 2.0)])];
        let contents = FrameContents { drawables: [&lines, &[]], ..Default::default() };
        let picture = drawn(&gpu, &mut renderer, before(), &contents);
        picture
            .enumerate_pixels()
            .filter(|(.., pixel)| pixel[1] > 100)
            .map(|(x, y, _)| (x, y))
            .collect::<Vec<_>>()
    };
    // From the middle of the screen over the eye's right shoulder: it leaves the picture on the right.
    for pixels in [green([0.0, 0.0, 0.0], [0.5, 0.0, 4.0]), green([0.5, 0.0, 4.0], [0.0, 0.0, 0.0])] {
        assert!(pixels.len() > 90, "{}", pixels.len());
        assert!(pixels.iter().all(|&(x, y)| x >= 48 && (38..42).contains(&y)), "{pixels:?}");
        assert!(pixels.iter().any(|&(x, _)| x == 99));
    }
    assert!(green([0.1, 0.0, 2.5], [0.5, 0.0, 4.0]).is_empty(), "behind the eye");
}

#[test]
fn a_quad_has_a_front_and_a_back() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let quads = [Drawable::Quad(Quad {
        corner: [-0.2, -0.2, 0.0],
        right: [0.4, 0.0, 0.0],
        up: [0.0, 0.4, 0.0],
        front: [1.0, 0.0, 0.0, 0.5],
        back: [0.0, 0.0, 1.0, 0.25],
    })];
    let contents = FrameContents { drawables: [&quads, &[]], ..Default::default() };
    let front = *drawn(&gpu, &mut renderer, before(), &contents).get_pixel(50, 40);
    let back = *drawn(&gpu, &mut renderer, behind(), &contents).get_pixel(50, 40);
    // 0.5 and 0.25 of linear light are 187.5 and 136.9 in sRGB; devices round as they like.
    assert!((187..=188).contains(&front[0]) && front[2] == 0, "{front:?}");
    assert!((136..=137).contains(&back[2]) && back[0] == 0, "{back:?}");
}

#[test]
fn a_ball_covers_its_disc() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let balls =
        [Drawable::Ball(Ball { center: Point3::new(0.2, 0.1, 0.0), radius_m: 0.1, color: [0.8, 0.2, 0.2] })];
    let picture = drawn(
        &gpu,
        &mut renderer,
        before(),
        &FrameContents { drawables: [&balls, &[]], ..Default::default() },
    );
    let covered: Vec<_> = picture.enumerate_pixels().filter(|(.., pixel)| pixel[0] > 30).collect();
    // A radius of 10 pixels about (70, 30).
    assert!((300..330).contains(&covered.len()), "{}", covered.len());
    assert!(covered.iter().all(|(x, y, _)| x.abs_diff(70) <= 11 && y.abs_diff(30) <= 11));
}

/// Strips of an effect: quads with the quads' own shader come out as quads do, and nothing is made before.
#[test]
fn strips_with_a_shader_of_their_own_are_drawn_as_it_says() {
    const KIND: StripKind = StripKind {
        name: "quads of an effect",
        shader: include_str!("../../shaders/quads.wgsl"),
        attributes: &[3, 3, 3, 4, 4],
    };
    let Some(gpu) = require_gpu() else { return };
    let [corner, right, up] = [[-0.3, -0.2, 0.0], [0.5, 0.1, 0.0], [0.0, 0.4, 0.1]];
    let (front, back) = ([0.1, 0.6, 0.2, 0.5], [0.7, 0.1, 0.1, 1.0]);
    let quads = [Drawable::Quad(Quad { corner, right, up, front, back })];
    let instances = [&corner[..], &right, &up, &front, &back].concat();
    let strips = [Drawable::Strips(Strips { kind: &KIND, instances })];
    for view in [before(), behind()] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
        let expected = drawn(
            &gpu,
            &mut renderer,
            view,
            &FrameContents { drawables: [&quads, &[]], ..Default::default() },
        );
        assert!(expected.pixels().any(|pixel| pixel.0[..3] != [0; 3]), "the quad is in the picture");
        assert!(!renderer.made().contains(&"custom strips"));
        let found = drawn(
            &gpu,
            &mut renderer,
            view,
            &FrameContents { drawables: [&strips, &[]], ..Default::default() },
        );
        assert!(renderer.made().contains(&"custom strips"));
        assert_eq!(found, expected);
    }
}
