//! An effect that gives a body other triangles in the middle of a session, as a cut does: what is drawn, picked and stored follows.

use crate::render_common::{off_axis, require_gpu};
use greenstage::base::failure::Failure;
use greenstage::deform::{Contribution, Topology};
use greenstage::display::bodies::GpuBodies;
use greenstage::display::device::{Args, DeformOn};
use greenstage::display::presenter::Images;
use greenstage::display::view_source::{ViewSource, show};
use greenstage::effect::{self, EffectEntry, EffectInput, Resolved};
use greenstage::render::{Samples, Show, Tile, Viewport};
use greenstage::scene::Scene;
use greenstage::stage::{Stage, rotation_towards};
use greenstage::track::{StylusState, TrackerState};
use greenstage::world::inertia::Inertia;
use greenstage::world::{RunningEffect, State, World};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::path::Path;
use std::sync::Arc;

const HOLE: EffectEntry = EffectEntry {
    name: "hole",
    summary: "the upper side of the body is open from the second frame on",
    attach: Some(join),
    ..EffectEntry::NOTHING
};

struct Hole {
    b: usize,
    open: Topology,
}

fn join(listed: &EffectInput<'_>, world: &mut World) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let (b, _) = listed.bodies[0];
    let deformer = &world.bodies[b].deformer;
    let is_above =
        |triangle: &&[u32; 3]| triangle.iter().all(|node| deformer.rest()[*node as usize][1] > 0.09);
    let rest = deformer.triangles().iter().filter(|triangle| !is_above(triangle)).copied().collect();
    Ok(Some(Box::new(Hole { b, open: Topology(Arc::new(rest)) })))
}

impl RunningEffect for Hole {
    fn name(&self) -> &'static str {
        HOLE.name
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(&mut self, world: &World, contributions: &mut [Contribution], _: &mut [&mut dyn Inertia]) {
        if *world.graph.get(world.fields.time) > 0.5 {
            contributions[self.b].triangles = Some(self.open.clone());
        }
    }
}

fn scene() -> Resolved {
    let text = "[body.b]\ngenerate = { block = { size = [1.0, 0.2, 0.2], cells = [10, 2, 2] } }\n\
                material = { young = 1.0e4, poisson = 0.3 }\nmodel = \"rotation\"\neffects = [\"hole\"]\n\
                control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    Resolved::among(Scene::parse(text, Path::new("hole.toml")).unwrap(), &[HOLE]).unwrap()
}

fn world() -> World {
    let scene = scene();
    let file = effect::file_of(&scene).unwrap();
    effect::world(&[HOLE], &scene, &file, Stage::find("desktop").unwrap()).unwrap()
}

/// A frame with a ray from above onto the middle of the body.
fn step(world: &mut World, time_s: f64) {
    let room_from_body = world.bodies[0].room_from_body;
    let [from, to] = [1.0, 0.0].map(|y| room_from_body * Point3::new(0.03, y, 0.03));
    let rotation = rotation_towards(&(to - from), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(from.coords), rotation).cast();
    let styli = vec![StylusState { room_from_stylus, ..Default::default() }];
    world.step(&TrackerState { head: None, styli, time_s }.into());
}

/// Depth below the upper side at which the ray meets the surface, m in the body's frame.
fn depth(world: &World) -> f64 {
    let body = &world.bodies[0];
    let hit = world.pointed_surfaces()[0];
    let at = |node: &u32| f64::from(body.deformer.positions()[*node as usize][1]);
    let height: f64 = hit.corners.iter().zip(hit.weights).map(|(node, weight)| at(node) * weight).sum();
    0.1 - height
}

#[test]
fn a_ray_goes_through_the_hole_and_a_state_keeps_it() {
    let mut first = world();
    step(&mut first, 0.0);
    assert!(depth(&first).abs() < 1e-6, "it meets the upper side");
    step(&mut first, 1.0);
    assert!((depth(&first) - 0.2).abs() < 1e-6, "it meets the lower side from inside");
    let normals = first.bodies[0].deformer.normals();
    assert!(normals.as_flattened().iter().all(|x| x.is_finite()));

    let text = serde_json::to_string(&first.state().unwrap()).unwrap();
    let mut second = world();
    second.set_state(&serde_json::from_str::<State>(&text).unwrap()).unwrap();
    assert_eq!(second.bodies[0].deformer.triangles(), first.bodies[0].deformer.triangles());
    assert_eq!(serde_json::to_string(&second.state().unwrap()).unwrap(), text);
    for world in [&mut first, &mut second] {
        step(world, 1.1);
    }
    assert_eq!(first.state_hash(), second.state_hash());
    assert_eq!(depth(&first), depth(&second));
}

/// A view from above, whoever draws the body.
struct Above;

impl ViewSource for Above {
    fn tiles(&self, world: &World, sizes: &[[u32; 2]]) -> Vec<Vec<Tile>> {
        let centre = world.bodies[0].room_from_body * Point3::origin();
        let size = world.bodies[0].room_from_body.scaling() as f32;
        let eye = centre + Vector3::new(0.0, 2.0 * f64::from(size), 0.0);
        let half_turn = -std::f32::consts::FRAC_PI_2;
        let view = off_axis(centre.cast(), [1.2 * size, 1.2 * size], half_turn, eye.cast());
        let of = |[width, height]: &[u32; 2]| {
            let rect = [0, 0, *width, *height];
            vec![Tile { rect, show: Show::One(Viewport { rect, view: Some(view) }) }]
        };
        sizes.iter().map(of).collect()
    }
}

#[test]
fn the_hole_is_seen_where_the_processor_and_where_the_device_deforms() {
    if require_gpu().is_none() {
        return;
    }
    let mut pictures = Vec::new();
    for deform in [DeformOn::Cpu, DeformOn::Gpu] {
        let mut world = world();
        let mut images = Images::new(Samples::Exactly(1)).unwrap();
        images.add([64, 64], [0; 2]).unwrap();
        let asked = Args { deform, ..Args::default() };
        let mut bodies = GpuBodies::new(&images.gpu, &mut world, asked).unwrap();
        let mut seen = |world: &mut World, time_s: f64| {
            step(world, time_s);
            world.frame.drawables.clear();
            show(world, &mut bodies, &Above, &mut images).unwrap();
            images.read().unwrap().0.remove(0)
        };
        let (closed, open) = (seen(&mut world, 0.0), seen(&mut world, 1.0));
        let others = closed.pixels().zip(open.pixels()).filter(|(a, b)| a != b).count();
        // The upper side is 1.0 by 0.2 of a picture of 1.2 by 1.2: 570 of its 4096 pixels.
        assert!((350..=700).contains(&others), "{deform:?}: {others} pixels differ");
        pictures.push((closed, open));
    }
    let apart = |a: &image::RgbaImage, b: &image::RgbaImage| {
        a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
    };
    let [(closed, open), (other_closed, other_open)] = &pictures[..] else { panic!() };
    assert!(apart(closed, other_closed) <= 2 && apart(open, other_open) <= 2);
}
