//! Finds the rectangles that plates must not cover: the control elements that are held, their arrows and what is pointed at, as
//! screens show it.

use crate::render::Drawable;
use crate::scene::Grab;
use crate::stage::{NEAR_M, Screen};
use crate::world::{Highlight, PlacedBody, World};
use nalgebra::{Matrix4, Point3, Vector3};

/// Largest number of nodes of an element or of a body that are looked at.
const NODES: usize = 64;

/// Rectangles on one screen, of both eyes: left, right, bottom, top in normalised device coordinates of the whole screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeepClear {
    /// Rectangles about each held element, each arrow and each place pointed at: nothing stands there.
    pub held: Vec<[f64; 4]>,
    /// Rectangles about each element that can be taken: plates go elsewhere if they can.
    pub loose: Vec<[f64; 4]>,
    /// Rectangles about each body.
    pub bodies: Vec<[f64; 4]>,
}

/// The rectangles of each screen.
pub fn keep_clear(world: &World) -> Vec<KeepClear> {
    let things = [held(world), elements(world, Highlight::Idle), bodies(world)];
    let of = |screen: &Screen| {
        let viewer = &world.assets.stage.viewer;
        let views = world.assets.stage.stereo.eyes().iter().filter_map(|&eye| {
            let view = screen.view(&viewer.eye_in_room(&world.room_from_head, eye), NEAR_M).ok()?;
            Some(view.clip_from_room.cast::<f64>())
        });
        let views: Vec<Matrix4<f64>> = views.collect();
        let [held, loose, bodies] =
            things.each_ref().map(|all| all.iter().filter_map(|points| rectangle(&views, points)).collect());
        KeepClear { held, loose, bodies }
    };
    world.assets.stage.screens.iter().map(of).collect()
}

/// Points in the room of each thing that is held or pointed at.
fn held(world: &World) -> Vec<Vec<Point3<f64>>> {
    let mut things = elements(world, Highlight::Held);
    let hits = world.frame.all(Drawable::stylus).filter_map(|stylus| stylus.hit);
    things.extend(hits.map(|hit| vec![hit.cast()]));
    things.extend(
        world
            .frame
            .all(Drawable::arrow)
            .map(|arrow| vec![arrow.from.cast(), (arrow.from + arrow.along).cast()]),
    );
    things
}

/// Points in the room of each control element that can be taken and has this highlight.
fn elements(world: &World, highlight: Highlight) -> Vec<Vec<Point3<f64>>> {
    let mut things = Vec::new();
    for (body, shown) in world.bodies.iter().zip(&world.frame.bodies) {
        let is_meant = |grab: Grab, now: Highlight| match highlight {
            Highlight::Held => now == Highlight::Held,
            _ => now != Highlight::Held && grab == Grab::Dragger,
        };
        let controls = body.assets.controls.iter().zip(&shown.highlights).enumerate();
        for (c, _) in controls.filter(|(_, (control, now))| is_meant(control.grab, **now)) {
            let nodes = body.deformer.control_nodes(c);
            things.push(places(body, nodes.iter().copied(), nodes.len()));
        }
    }
    things
}

fn bodies(world: &World) -> Vec<Vec<Point3<f64>>> {
    let of = |body: &PlacedBody| {
        let count = body.deformer.node_count();
        places(body, 0..count as u32, count)
    };
    world.bodies.iter().map(of).collect()
}

/// Places of some of the nodes, in the room.
fn places(body: &PlacedBody, nodes: impl Iterator<Item = u32>, count: usize) -> Vec<Point3<f64>> {
    let positions = body.deformer.kept_positions();
    let room_from_surface = body.room_from_surface();
    let place = |node: u32| {
        let position = positions.get(node as usize)?;
        Some(room_from_surface * Point3::from(Vector3::from(*position).cast::<f64>()))
    };
    nodes.step_by(count.div_ceil(NODES).max(1)).filter_map(place).collect()
}

/// The rectangle about the points in all views, as far as it is on the screen.
fn rectangle(views: &[Matrix4<f64>], points: &[Point3<f64>]) -> Option<[f64; 4]> {
    let seen = views.iter().flat_map(|view| points.iter().map(move |point| view * point.to_homogeneous()));
    let seen = seen.filter(|clip| clip.w > clip.z).map(|clip| [clip.x / clip.w, clip.y / clip.w]);
    let about = seen
        .map(|[x, y]| [x, x, y, y])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])])?;
    let [left, right, bottom, top] = about;
    let is_on_screen = left < 1.0 && right > -1.0 && bottom < 1.0 && top > -1.0;
    (is_on_screen && about.iter().all(|x| x.is_finite())).then_some(about)
}
