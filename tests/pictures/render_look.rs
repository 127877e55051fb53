//! A picture to look at, and what it costs: `cargo test --release --test pictures render_look -- --ignored --nocapture`.

use crate::render_common;
use greenstage::render::*;
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};
use render_common::*;

/// The two eyes over the table's top, the stylus reaching for the tube's right end.
fn eyes() -> [View; 2] {
    let center = Point3::new(0.0, 0.9, 0.0);
    [-0.032, 0.032].map(|x| off_axis(center, [1.8, 1.44], -0.9, Point3::new(x - 0.15, 1.75, 1.05)))
}

fn styli(mesh: &Mesh, room_from_body: &Matrix4<f32>, pressed: bool) -> [StylusShape; 1] {
    let vertex =
        mesh.positions.iter().max_by(|a, b| (a[0] + 0.3 * a[2]).total_cmp(&(b[0] + 0.3 * b[2]))).unwrap();
    let hit = room_from_body.transform_point(&Point3::from(*vertex));
    let tip = Point3::new(0.36, 1.16, 0.50);
    let rotation = UnitQuaternion::face_towards(&(tip - hit), &Vector3::y());
    let room_from_stylus = Isometry3::from_parts(Translation3::from(tip), rotation).to_homogeneous();
    [StylusShape { room_from_stylus, size_m: 0.22, ray_length_m: 2.0, hit: Some(hit), bend: None, pressed }]
}

#[test]
#[ignore = "writes pictures and measures; for people"]
fn a_bent_tube_on_the_workbench() {
    let Some(gpu) = require_gpu() else { return };
    println!("{}", gpu.describe());
    let mesh = bent_tube(72, 70);
    println!("{} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
    let mut buffers = mesh.buffers(&gpu);
    let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 0.98, 0.08));
    let styli = styli(&mesh, &room_from_body, false);
    let grid = Some(Grid::new(Point3::new(0.0, 0.78, 0.0), [1.6, 1.6], 0.1));
    let views = eyes();
    let size = [1280, 1024];
    for samples in [4, 1] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        let targets = [0, 1].map(|_| Offscreen::new(&gpu, &renderer, size).unwrap());
        let viewports = views.map(|view| Viewport::full(size, Some(view)));
        let (mut encode, mut drawn, mut pairs) = (0.0, 0.0, 0);
        let start = std::time::Instant::now();
        while start.elapsed().as_secs_f64() < 4.0 {
            buffers.upload(&gpu, &mesh.positions, &mesh.normals).unwrap();
            let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
            let contents = FrameContents { bodies: &bodies, styli: &styli, grid, ..Default::default() };
            let pictures = [0, 1].map(|k| targets[k].picture(&viewports[k]));
            encode += renderer.draw(&gpu, &pictures, &contents).unwrap().as_secs_f64();
            drawn += gpu.wait().unwrap().as_secs_f64();
            pairs += 1;
        }
        let rate = f64::from(pairs) / start.elapsed().as_secs_f64();
        let ms = |seconds: f64| seconds * 1e3 / f64::from(pairs);
        println!("{samples}×: {rate:.1} pairs/s, encode {:.2} ms, draw {:.1} ms", ms(encode), ms(drawn));
        for (eye, target) in ["left", "right"].iter().zip(&targets) {
            let (image, time) = target.read(&gpu).unwrap();
            println!("read {time:?}");
            image.save(format!("target/look_{samples}x_{eye}.png")).unwrap();
        }
    }
}

/// Where a stereo pair's time goes: each part of the frame added in turn.
#[test]
#[ignore = "measures; for people"]
fn cost_of_each_part() {
    let Some(gpu) = require_gpu() else { return };
    println!("{}", gpu.describe());
    let mesh = bent_tube(72, 70);
    let buffers = mesh.buffers(&gpu);
    let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 0.98, 0.08));
    let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
    let styli = styli(&mesh, &room_from_body, false);
    let grid = Some(Grid::new(Point3::new(0.0, 0.78, 0.0), [1.6, 1.6], 0.1));
    let background = FrameContents::default();
    let frames = [
        ("background", background),
        ("+ grid", FrameContents { grid, ..background }),
        ("+ body", FrameContents { bodies: &bodies, ..background }),
        ("+ all", FrameContents { bodies: &bodies, styli: &styli, grid, ..background }),
    ];
    let size = [1280, 1024];
    for samples in [4, 1] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        let target = Offscreen::new(&gpu, &renderer, size).unwrap();
        let mut measure = |viewports: &[Viewport], contents: &FrameContents<'_>| {
            let mut best = f64::INFINITY;
            for _ in 0..12 {
                let start = std::time::Instant::now();
                renderer.draw(&gpu, &[target.picture(viewports)], contents).unwrap();
                gpu.wait().unwrap();
                best = best.min(start.elapsed().as_secs_f64() * 1e3);
            }
            best
        };
        println!("{samples}×: {:<12} {:6.1} ms an eye", "black", measure(&[], &background));
        for (name, contents) in &frames {
            println!(
                "{samples}×: {name:<12} {:6.1} ms an eye",
                measure(&Viewport::full(size, Some(eyes()[0])), contents)
            );
        }
    }
}
