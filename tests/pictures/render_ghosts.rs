//! Ghosts: as opaque as they should be at every angle, behind bodies and before them, from outside alone.

use crate::render_common::*;
use greenstage::render::*;
use image::RgbaImage;
use nalgebra::{Matrix4, Point3, Vector3};
use std::f32::consts::PI;
use std::sync::Arc;

const SIZE: [u32; 2] = [64, 64];

/// The twin of `ghost_opacity` in shaders/ghost.wgsl.
fn ghost_opacity(n_dot_v: f32, opacity: f32) -> f32 {
    let (grazing, clear) = (1.0 - n_dot_v, if opacity < 0.0 { 0.12 } else { 0.18 });
    (opacity.abs() * (clear + (1.0 - clear) * grazing.powi(3))).clamp(0.0, 1.0)
}

fn shape(mesh: Mesh) -> Arc<GhostShape> {
    let Mesh { positions, normals, triangles, .. } = mesh;
    Arc::new(GhostShape { positions, normals, triangles })
}

/// An eye 1 m before the middle of a screen of 0.2 m.
fn view() -> View {
    off_axis(Point3::origin(), [0.2, 0.2], 0.0, Point3::new(0.0, 0.0, 1.0))
}

/// A white ghost of a square at the middle, turned about y by `turn` radians, over these bodies.
fn drawn(
    gpu: &Gpu,
    renderer: &mut Renderer,
    turn: f32,
    through: f32,
    bodies: &[BodyInstance<'_>],
) -> RgbaImage {
    let room_from_shape = Matrix4::from_axis_angle(&Vector3::y_axis(), turn);
    let shape = shape(square(0.5, [0.0; 3], [0; 4]));
    let ghosts = [Drawable::Ghost(Ghost { shape, room_from_shape, color: [1.0, 1.0, 1.0, 0.8], through })];
    let contents = FrameContents {
        drawables: [&ghosts, &[]],
        bodies,
        lighting: black_room(),
        ..FrameContents::default()
    };
    draw_full(gpu, renderer, SIZE, view(), &contents)
}

/// Light of the middle pixel, 0 to 1, linear.
fn light(image: &RgbaImage) -> f32 {
    let value = f32::from(image.get_pixel(SIZE[0] / 2, SIZE[1] / 2).0[0]) / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[test]
fn a_ghost_is_denser_towards_its_outline_and_has_no_far_side() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let nothing = draw_full(&gpu, &mut renderer, SIZE, view(), &FrameContents::default());
    assert!(nothing.pixels().count() > 0 && !renderer.made().contains(&"ghost"), "{:?}", renderer.made());
    for turn in [0.0_f32, 0.6, 1.0, 1.3, -1.3] {
        let (found, expected) =
            (light(&drawn(&gpu, &mut renderer, turn, 0.0, &[])), ghost_opacity(turn.cos(), 0.8));
        assert!((found - expected).abs() < 0.02, "{turn} rad: {found}, not {expected}");
    }
    assert!(renderer.made().contains(&"ghost"));
    assert_eq!(light(&drawn(&gpu, &mut renderer, 3.0, 1.0, &[])), 0.0, "its far side is left out");
}

#[test]
fn a_ghost_behind_a_body_shows_through_it_as_far_as_it_is_asked_to() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let buffers = square(0.5, [0.0; 3], [0, 0, 0, 0]).buffers(&gpu);
    let at = |z: f32| {
        let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 0.0, z));
        [BodyInstance { buffers: &buffers, room_from_body }]
    };
    let alone = |renderer: &mut Renderer, z: f32| {
        let bodies = at(z);
        let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
        light(&draw_full(&gpu, renderer, SIZE, view(), &contents))
    };
    // Behind, and where both are the same surface; before.
    for (z, through, opacity) in [
        (0.1, 0.0, 0.0),
        (0.1, 0.5, -0.4),
        (0.0, 0.0, 0.0),
        (0.0, 0.5, -0.4),
        (-0.1, 0.0, 0.8),
        (-0.1, 0.5, 0.8),
    ] {
        let body = alone(&mut renderer, z);
        let found = light(&drawn(&gpu, &mut renderer, 0.0, through, &at(z)));
        let alpha = ghost_opacity(1.0, opacity);
        let expected = alpha + (1.0 - alpha) * body;
        assert!((found - expected).abs() < 0.01, "body at {z}, {through}: {found}, not {expected}");
    }
}

#[test]
fn a_broken_shape_is_not_drawn() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let positions = vec![[0.0; 3]; 3];
    for (normals, triangles) in [(vec![[0.0; 3]; 2], vec![[0, 1, 2]]), (vec![[0.0; 3]; 3], vec![[0, 1, 3]])] {
        let shape = Arc::new(GhostShape { positions: positions.clone(), normals, triangles });
        let ghost = Ghost { shape, room_from_shape: Matrix4::identity(), color: [1.0; 4], through: 1.0 };
        let contents = FrameContents {
            drawables: [&[Drawable::Ghost(ghost)], &[]],
            lighting: black_room(),
            ..FrameContents::default()
        };
        let image = draw_full(&gpu, &mut renderer, SIZE, view(), &contents);
        assert!(image.pixels().all(|pixel| pixel.0[..3] == [0; 3]));
    }
}

/// A line that lies over everything is seen where a body hides another.
#[test]
fn a_line_over_everything_is_not_hidden() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let buffers = square(0.5, [0.0, 0.0, 0.1], [0, 0, 0, 0]).buffers(&gpu);
    let bodies = [BodyInstance { buffers: &buffers, room_from_body: Matrix4::identity() }];
    for (over, is_seen) in [(0.0, false), (1.0, true)] {
        let line = Line::new(Point3::new(-0.1, 0.0, 0.0), Point3::new(0.1, 0.0, 0.0), [1.0; 4], 4.0);
        let lines = [Drawable::Lines(vec![Line { over, ..line }])];
        let contents = FrameContents {
            bodies: &bodies,
            drawables: [&lines, &[]],
            lighting: black_room(),
            ..FrameContents::default()
        };
        let found = light(&draw_full(&gpu, &mut renderer, SIZE, view(), &contents));
        assert_eq!(found > 0.9, is_seen, "{over}: {found}");
    }
}

/// A formed solid in the shape of a ball looks like the ball, and its pipeline is made only for it.
#[test]
fn a_formed_ball_looks_like_a_ball() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let (radius_m, color) = (0.06_f32, [0.6, 0.3, 0.2]);
    let draw = |renderer: &mut Renderer, drawable: Drawable| {
        let contents = FrameContents { drawables: [&[drawable], &[]], ..FrameContents::default() };
        draw_full(&gpu, renderer, SIZE, view(), &contents)
    };
    let center = Point3::new(0.01, 0.02, 0.0);
    let ball = draw(&mut renderer, Drawable::Ball(Ball { center, radius_m, color }));
    assert!(!renderer.made().contains(&"formed"), "{:?}", renderer.made());

    const RINGS: usize = 40;
    let direction = |ring: usize, step: usize| {
        let (high, turn) = (ring as f32 / RINGS as f32 * PI, step as f32 / RINGS as f32 * PI);
        [high.sin() * turn.cos(), high.cos(), high.sin() * turn.sin()]
    };
    let around = 2 * RINGS;
    let directions = (0..=RINGS).flat_map(|ring| (0..=around).map(move |step| direction(ring, step)));
    let normals: Vec<[f32; 3]> = directions.collect();
    let corner = |ring: usize, step: usize| (ring * (around + 1) + step) as u32;
    let cells = (0..RINGS).flat_map(|ring| (0..around).map(move |step| (ring, step)));
    let triangles = cells.flat_map(|(ring, step)| {
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| corner(ring + i, step + j));
        [[a, c, b], [a, d, c]]
    });
    let shape = Arc::new(GhostShape {
        positions: normals.clone(),
        normals: normals.clone(),
        triangles: triangles.collect(),
    });
    let room_from_shape = Matrix4::new_translation(&center.coords) * Matrix4::new_scaling(radius_m);
    let formed = draw(&mut renderer, Drawable::Formed(Formed { shape, room_from_shape, color }));
    assert!(renderer.made().contains(&"formed"));

    let off =
        |(a, b): (&image::Rgba<u8>, &image::Rgba<u8>)| (0..3).map(|k| a.0[k].abs_diff(b.0[k])).max().unwrap();
    let differing = ball.pixels().zip(formed.pixels()).map(off).filter(|off| *off > 6).count();
    let drawn = ball.pixels().filter(|pixel| pixel.0[0] > pixel.0[2] + 10).count();
    // The outlines of both are polygons.
    assert!(drawn > 500 && differing < drawn / 20, "{differing} of {drawn} pixels differ");
}
