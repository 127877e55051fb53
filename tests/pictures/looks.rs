//! Looks of bodies: lines and images move with the material, edges stay sharp, shadows lie where the light is hidden.

use crate::render_common::*;
use crate::render_pixels::pixels_apart;
use greenstage::base::columns::ColumnGroup;
use greenstage::base::creases::Creases;
use greenstage::deform::vertex_normals;
use greenstage::render::*;
use image::{Rgba, RgbaImage};
use nalgebra::{Matrix4, Point3, Rotation3, Vector3};
use std::f32::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

const SIZE: [u32; 2] = [400, 320];

fn ahead() -> View {
    off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.0, 1.0, 0.9))
}

fn brightness(image: &RgbaImage, [x, y]: [f32; 2]) -> f32 {
    let Rgba([r, g, b, _]) = *image.get_pixel(x as u32, y as u32);
    f32::from(r) + f32::from(g) + f32::from(b)
}

/// A band along x, 0.8 × 0.3, in 40 × 12 cells; its right end is turned by `twist` about its middle line.
fn band(gpu: &Gpu, twist: f32, pattern: &Pattern) -> (BodyBuffers, impl Fn(f32, f32) -> Point3<f32> + use<>) {
    let place = move |x: f32, y: f32| {
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), twist * (x / 0.8 + 0.5));
        Point3::new(0.0, 1.0, -0.1) + turn * Vector3::new(x, y, 0.0)
    };
    let nodes =
        || (0..13).flat_map(|j| (0..41).map(move |i| (i as f32 / 50.0 - 0.4, j as f32 / 40.0 - 0.15)));
    let positions: Vec<[f32; 3]> = nodes().map(|(x, y)| place(x, y).into()).collect();
    let rest: Vec<[f32; 3]> = nodes().map(|(x, y)| [x, y, 0.0]).collect();
    let cell = |k: u32| {
        let first = k / 40 * 41 + k % 40;
        [[first, first + 1, first + 41], [first + 41, first + 1, first + 42]]
    };
    let triangles: Vec<[u32; 3]> = (0..12 * 40).flat_map(cell).collect();
    let mut normals = vec![[0.0; 3]; positions.len()];
    vertex_normals(&positions, &triangles, &mut Vec::new(), &mut normals);
    let mut buffers = BodyBuffers::new(gpu, &triangles, &vec![[150, 150, 150, 0]; rest.len()]).unwrap();
    buffers.upload(gpu, &positions, &normals).unwrap();
    buffers.set_pattern(gpu, &rest, pattern).unwrap();
    (buffers, place)
}

fn drawn(gpu: &Gpu, renderer: &mut Renderer, buffers: &BodyBuffers) -> RgbaImage {
    let bodies = [BodyInstance { buffers, room_from_body: Matrix4::identity() }];
    let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
    draw_full(gpu, renderer, SIZE, ahead(), &contents)
}

/// A pixel of a line is darker than the same pixel without lines, wherever the twist has carried it, and pixels halfway
/// between lines are the same: lines are where the material is, not where the space is.
#[test]
fn lines_follow_the_material_when_it_is_twisted() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let lines = Pattern { line_spacing_m: Some(0.1), ..Pattern::default() };
    for twist in [0.0, 0.9, -0.9] {
        let (with, place) = band(&gpu, twist, &lines);
        let (without, _) = band(&gpu, twist, &Pattern::default());
        let (with, without) = (drawn(&gpu, &mut renderer, &with), drawn(&gpu, &mut renderer, &without));
        let share = |x: f32, y: f32| {
            let pixel = pixel_of(&ahead(), SIZE, place(x, y));
            brightness(&with, pixel) / brightness(&without, pixel)
        };
        for i in -3..=3 {
            let along = 0.1 * i as f32;
            for (x, y) in [
                (along, 0.05),
                (along, -0.05),
                (along + 0.05, 0.1),
                (along + 0.05, 0.0),
                (along + 0.05, -0.1),
            ] {
                assert!(share(x, y) < 0.92, "twist {twist}: {} of a line at {x}, {y}", share(x, y));
            }
            for (x, y) in [(along + 0.05, 0.05), (along + 0.05, -0.05)] {
                assert!(
                    (share(x, y) - 1.0).abs() < 0.01,
                    "twist {twist}: {} between at {x}, {y}",
                    share(x, y)
                );
            }
        }
    }
}

/// Far away, where cells shrink to a few pixels, no line is left, and so no moiré.
#[test]
fn lines_fade_out_where_they_would_be_too_near_each_other() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let fine = Pattern { line_spacing_m: Some(0.008), ..Pattern::default() };
    let images = [fine, Pattern::default()].map(|pattern| {
        let (buffers, _) = band(&gpu, 0.4, &pattern);
        drawn(&gpu, &mut renderer, &buffers)
    });
    assert!(pixels_apart(&images[0], &images[1], 2) == 0, "cells of three pixels");
}

/// Left of the middle the image's left half shows, right of it its right half, however the band is twisted; as wide as asked.
#[test]
fn an_image_lies_on_the_material() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let halves =
        RgbaImage::from_fn(
            16,
            16,
            |x, _| if x < 8 { Rgba([255, 0, 0, 255]) } else { Rgba([0, 255, 0, 255]) },
        );
    let pattern = Pattern { image: Some((Arc::new(halves), 0.4)), ..Pattern::default() };
    for twist in [0.0, 0.9] {
        let (buffers, place) = band(&gpu, twist, &pattern);
        let image = drawn(&gpu, &mut renderer, &buffers);
        for (x, is_red) in [(-0.3, false), (-0.1, true), (0.1, false), (0.3, true)] {
            let pixel = pixel_of(&ahead(), SIZE, place(x, 0.02));
            let [r, g, ..] = image.get_pixel(pixel[0] as u32, pixel[1] as u32).0.map(u32::from);
            assert!(if is_red { r > 2 * g } else { g > 2 * r }, "twist {twist}, {x}: {r} {g}");
        }
    }
}

/// A cube of 3 × 3 × 3 nodes on its surface, counter-clockwise from outside.
fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let on_surface = |k: &usize| *k != 13;
    let numbers: Vec<usize> = (0..27).filter(on_surface).collect();
    let at = |k: usize| [k % 3, k / 3 % 3, k / 9].map(|n| n as f32 - 1.0);
    let number = |node: usize| numbers.iter().position(|known| *known == node).unwrap() as u32;
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [0, 2] {
            for cell in 0..4 {
                let corner = |u: usize, v: usize| {
                    let mut node = [side; 3];
                    (node[(axis + 1) % 3], node[(axis + 2) % 3]) = (cell % 2 + u, cell / 2 + v);
                    number(node[0] + 3 * node[1] + 9 * node[2])
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                triangles.extend(if side == 2 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
            }
        }
    }
    (numbers.into_iter().map(at).collect(), triangles)
}

/// On the device as on the CPU: at rest every vertex of a cube has the normal of its side, an axis; deformed, the same as
/// the CPU's; and vertices that share a node stay together.
#[test]
fn a_cubes_sides_keep_their_own_normals() {
    let Some(gpu) = require_gpu() else { return };
    let (rest, triangles) = cube();
    let creases = Creases::new(&triangles, &rest, 40f64.to_radians()).unwrap();
    assert_eq!(creases.copies.len(), 12 + 2 * 8, "12 edges' middles once more, 8 corners twice more");
    // One column that bends the cube about z: u_y = x².
    let column: Vec<f32> = rest.iter().flat_map(|x| [0.0, x[0] * x[0], 0.2 * x[1]]).collect();
    let colors = vec![[0; 4]; rest.len() + creases.copies.len()];
    let groups = [ColumnGroup::F32(&column)];
    let (copies, drawn) = (&creases.copies, &creases.triangles);
    let mut body = BodyBuffers::with_columns(&gpu, drawn, &colors, &rest, &groups, None, copies).unwrap();
    for coefficient in [0.0, 0.7] {
        body.deform(&gpu, &[coefficient], &[]).unwrap();
        let mut expected: Vec<[f32; 3]> = rest
            .iter()
            .zip(column.chunks_exact(3))
            .map(|(x, u)| [0, 1, 2].map(|axis| x[axis] + coefficient as f32 * u[axis]))
            .collect();
        creases.extend(&mut expected);
        let mut normals = vec![[0.0; 3]; expected.len()];
        vertex_normals(&expected, drawn, &mut Vec::new(), &mut normals);
        let [found_positions, found_normals] = body.read(&gpu).unwrap();
        let apart = |a: &[[f32; 3]], b: &[[f32; 3]]| -> f32 {
            let pairs = a.as_flattened().iter().zip(b.as_flattened());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(apart(&found_positions, &expected) < 1e-6 && apart(&found_normals, &normals) < 1e-5);
        for (copy, &node) in copies.iter().enumerate() {
            assert_eq!(found_positions[rest.len() + copy], found_positions[node as usize]);
        }
        if coefficient == 0.0 {
            let is_axis = |n: &[f32; 3]| n.iter().filter(|x| (x.abs() - 1.0).abs() < 1e-6).count() == 1;
            assert!(found_normals.iter().all(is_axis), "{found_normals:?}");
        }
    }
}

/// A horizontal disc that faces down, or a square where `sides` is 4.
fn disc(gpu: &Gpu, radius: f32, height: f32, sides: u32, color: [u8; 4]) -> BodyBuffers {
    let rim = (0..sides).map(|k| {
        let (sin, cos) = (TAU * (k as f32 + 0.5) / sides as f32).sin_cos();
        [radius * cos, height, radius * sin]
    });
    let positions: Vec<[f32; 3]> = rim.chain([[0.0, height, 0.0]]).collect();
    let triangles: Vec<[u32; 3]> = (0..sides).map(|k| [sides, (k + 1) % sides, k]).collect();
    let mut buffers = BodyBuffers::new(gpu, &triangles, &vec![color; positions.len()]).unwrap();
    buffers.upload(gpu, &positions, &vec![[0.0, 1.0, 0.0]; positions.len()]).unwrap();
    buffers
}

/// The light of one channel.
fn linear(value: f32) -> f32 {
    ((value / 255.0 + 0.055) / 1.055).powf(2.4)
}

/// The contact shadow below the middle of a disc of radius a at height h takes 80 % of the light that the disc hides of the lamp:
/// a²/(a² + h²) / 0.3 (shaders/contact_map.wgsl); beside the disc nothing. Without shadows nothing is made for them.
#[test]
fn the_floor_is_darker_below_a_body_than_beside_it() {
    let Some(gpu) = require_gpu() else { return };
    let view = off_axis(Point3::new(0.0, 0.1, 0.0), [1.0, 0.8], 0.0, Point3::new(0.0, 0.12, 0.9));
    let lighting = Lighting { horizon: [0.3; 3], nadir: [0.3; 3], zenith: [0.3; 3], ..Lighting::default() };
    let grid = Grid::new(Point3::origin(), [1.0; 2], 0.9);
    for (radius, height) in [(0.1_f32, 0.2), (0.1, 0.3), (0.15, 0.4)] {
        let buffers = disc(&gpu, radius, height, 48, [150, 150, 150, 0]);
        let bodies = [BodyInstance { buffers: &buffers, room_from_body: Matrix4::identity() }];
        let contents =
            FrameContents { bodies: &bodies, lighting, grid: Some(grid), ..FrameContents::default() };
        let images = [Shadows::Off, Shadows::Contact].map(|shadows| {
            let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
            renderer.shadows = shadows;
            let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
            assert_eq!(renderer.made().contains(&"ground"), shadows == Shadows::Contact);
            image
        });
        let left = |x: f32, z: f32| {
            let pixel = pixel_of(&view, SIZE, Point3::new(x, 0.0, z));
            let [off, on] = [0, 1].map(|k| linear(brightness(&images[k], pixel) / 3.0));
            on / off
        };
        let hidden = radius * radius / (radius * radius + height * height) / 0.3;
        // Off the grid's lines, which are drawn before the shadow.
        let (below, beside) = (left(0.02, 0.01), left(0.42, 0.01));
        println!("disc of {radius} m at {height} m: {below:.3} of the light left below, {beside:.3} beside");
        assert!((below - (1.0 - 0.8 * hidden)).abs() < 0.05, "{below}, not {}", 1.0 - 0.8 * hidden);
        assert!((beside - 1.0).abs() < 0.02, "{beside}");
    }
}

/// A small square between the light and a large one darkens what lies behind it along the light, and nothing else; below
/// it, where the key light comes in aslant, only some of the sky is gone.
#[test]
fn soft_shadows_lie_behind_what_hides_the_light() {
    let Some(gpu) = require_gpu() else { return };
    let view =
        off_axis(Point3::new(0.0, 0.1, 0.0), [1.6, 1.28], -FRAC_PI_2 + 0.4, Point3::new(0.0, 1.5, 0.9));
    let ground = disc(&gpu, 0.9, 0.0, 4, [150, 150, 150, 0]);
    let above = disc(&gpu, 0.12, 0.3, 4, [150, 150, 150, 0]);
    let bodies =
        [&ground, &above].map(|buffers| BodyInstance { buffers, room_from_body: Matrix4::identity() });
    let images = [Shadows::Off, Shadows::Soft].map(|shadows| {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
        renderer.shadows = shadows;
        let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
        draw_full(&gpu, &mut renderer, SIZE, view, &contents)
    });
    let left = |x: f32, z: f32| {
        let pixel = pixel_of(&view, SIZE, Point3::new(x, 0.0, z));
        brightness(&images[1], pixel) / brightness(&images[0], pixel)
    };
    let to_key = Lighting::default().to_key;
    let behind = -to_key * (0.3 / to_key.y);
    let (shaded, open) = (left(behind.x, behind.z), left(-0.35, 0.3));
    println!("{shaded:.3} of the brightness in the key light's shadow, {open:.3} in the open");
    assert!(shaded < 0.7, "{shaded}");
    assert!((open - 1.0).abs() < 0.03, "{open}: a plane does not shade itself");
}
