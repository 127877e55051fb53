//! The effect `ghost_rest`: the body at rest, translucent, where the body as it is has left it.

use super::entry::{EffectEntry, EffectInput};
use crate::deform::{ControlPose, Deformer, vertex_normals};
use crate::render::{Drawable, Ghost, GhostShape, Line};
use crate::world::{Frame, PlacedBody, RunningEffect, World};
use nalgebra::{Matrix4, Point3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A pale grey, linear, and the opacity of the outline.
const COLOR: [f32; 4] = [0.55, 0.62, 0.72, 0.4];

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: "ghost_rest",
    summary: "the rest shape, translucent, beside the deformed body",
    attach: Some(|listed, world| Ok(Some(Box::new(RestGhosts::new(listed, world))))),
    ..EffectEntry::NOTHING
};

struct RestGhosts {
    bodies: Vec<(usize, GhostSurface)>,
}

/// A ghost's surface with its sharp edges.
pub(super) struct GhostSurface {
    pub shape: Arc<GhostShape>,
    edges: Vec<[u32; 2]>,
}

/// Largest cosine between the normals of two triangles at a sharp edge: they differ by more than 40°.
const SHARP: f64 = 0.766;
/// A displacement is seen from this part of the body's radius on.
const SEEN: f64 = 1e-3;
/// Nodes that are looked at on a surface that the graphics device sums.
const SAMPLE: usize = 256;
/// Largest number of edges that are drawn: more would hide what they show.
const MOST_EDGES: usize = 4000;

impl RestGhosts {
    fn new(listed: &EffectInput<'_>, world: &World) -> RestGhosts {
        let of = |&(b, _): &(usize, &str)| (b, GhostSurface::new(&world.bodies[b].deformer, None));
        RestGhosts { bodies: listed.bodies.iter().map(of).collect() }
    }
}

impl RunningEffect for RestGhosts {
    fn name(&self) -> &'static str {
        ENTRY.name
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        for (b, shape) in &self.bodies {
            let body = &world.bodies[*b];
            let is_posed = body.deformer.poses.iter().any(|pose| *pose != ControlPose::REST);
            if is_posed || is_moved(body) {
                let room_from_shape = body.room_from_body.to_homogeneous().cast();
                let edges = shape.lines(&room_from_shape, COLOR, false).collect();
                let shape = shape.shape.clone();
                let ghost = Ghost { shape, room_from_shape, color: COLOR, through: 0.0 };
                frame.drawables.extend([Drawable::Lines(edges), Drawable::Ghost(ghost)]);
            }
        }
    }
}

/// Whether a node of a body whose elements rest is shown away from its rest, as by loads and tools; on a surface that the graphics device
/// sums, some nodes are looked at.
fn is_moved(body: &PlacedBody) -> bool {
    let deformer = &body.deformer;
    let least = SEEN * body.assets.ball.1;
    let at = |x: &[f32; 3]| Vector3::from(x.map(f64::from));
    if deformer.is_partial() {
        let nodes = (0..deformer.node_count() as u32).step_by(deformer.node_count().div_ceil(SAMPLE).max(1));
        let rest = nodes.clone().map(|node| at(&deformer.rest()[node as usize]));
        return deformer
            .places_in_state(nodes)
            .iter()
            .zip(rest)
            .any(|(now, rest)| (now - rest).norm() > least);
    }
    let body_from_surface = deformer.body_from_surface();
    let apart = |(now, rest): (&[f32; 3], &[f32; 3])| {
        ((body_from_surface * Point3::from(at(now))).coords - at(rest)).norm() > least
    };
    deformer.positions().iter().zip(deformer.rest()).any(apart)
}

impl GhostSurface {
    /// The surface of a body at rest, or moved by these displacements, in the body's frame.
    pub fn new(deformer: &Deformer, moved: Option<&[[f64; 3]]>) -> GhostSurface {
        let edges = sharp_edges(deformer.rest(), deformer.triangles());
        GhostSurface { shape: Arc::new(shape(deformer, moved)), edges }
    }

    /// Lines of the sharp edges in the room; with `over` they lie over everything, else nearer things hide them.
    pub fn lines(
        &self,
        room_from_shape: &Matrix4<f32>,
        [r, g, b, opacity]: [f32; 4],
        over: bool,
    ) -> impl Iterator<Item = Line> {
        let of = move |node: u32| {
            room_from_shape.transform_point(&Point3::from(self.shape.positions[node as usize])).into()
        };
        let line = move |[from, to]: &[u32; 2]| {
            // Opaque, so that pieces of an edge do not add up where they meet.
            let color =
                if over { [r, g, b, 0.3 * opacity] } else { [r * opacity, g * opacity, b * opacity, 1.0] };
            Line { from: of(*from), to: of(*to), color, width_px: 1.5, over: f32::from(u8::from(over)) }
        };
        self.edges.iter().map(line)
    }
}

/// Edges of a closed surface where it is creased; none where there are too many.
fn sharp_edges(rest: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let at = |node: u32| Vector3::from(rest[node as usize]).cast::<f64>();
    let mut beside: BTreeMap<[u32; 2], Vector3<f64>> = BTreeMap::new();
    let mut edges = Vec::new();
    for &[a, b, c] in triangles {
        let normal = (at(b) - at(a)).cross(&(at(c) - at(a))).normalize();
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let edge = [from.min(to), from.max(to)];
            match beside.remove(&edge) {
                None => drop(beside.insert(edge, normal)),
                Some(other) if other.dot(&normal) < SHARP => edges.push(edge),
                Some(_) => {}
            }
        }
    }
    if edges.len() > MOST_EDGES { Vec::new() } else { edges }
}

fn shape(deformer: &Deformer, moved: Option<&[[f64; 3]]>) -> GhostShape {
    let mut positions = deformer.rest().to_vec();
    for (position, u) in positions.iter_mut().zip(moved.into_iter().flatten()) {
        *position = [0, 1, 2].map(|axis| (f64::from(position[axis]) + u[axis]) as f32);
    }
    let triangles = deformer.triangles().to_vec();
    let mut normals = vec![[0.0; 3]; positions.len()];
    vertex_normals(&positions, &triangles, &mut Vec::new(), &mut normals);
    GhostShape { positions, normals, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::ghost_equilibrium::tests::bar;
    use crate::effect::{self, Resolved, attach, file_of};
    use crate::stage::Stage;
    use crate::track::TrackerState;
    use std::path::Path;

    #[test]
    fn the_ghost_is_the_body_at_rest_and_stands_only_beside_one_that_is_moved() {
        let (scene, file, mut world) = bar("linear", &["ghost_rest"]);
        let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap();
        world.show_by(running[0].as_mut());
        assert!(
            world.frame.all(Drawable::ghost).next().is_none(),
            "at rest there is nothing beside the body"
        );
        let mut poses = world.bodies[0].deformer.poses.clone();
        poses[1].translation.x = 0.01;
        world.bodies[0].deformer.evaluate(&poses);
        world.show_by(running[0].as_mut());
        // The twelve edges of the bar: four of 12 pieces, eight of 3.
        assert_eq!(world.frame.all(Drawable::lines).flatten().count(), 4 * 12 + 8 * 3);
        let ghosts: Vec<_> = world.frame.all(Drawable::ghost).collect();
        let [ghost] = ghosts[..] else { panic!("{} ghosts", ghosts.len()) };
        let deformer = &world.bodies[0].deformer;
        assert_eq!(ghost.shape.positions, deformer.rest());
        assert_ne!(ghost.shape.positions[..], deformer.positions()[..]);
        assert_eq!(ghost.room_from_shape, world.bodies[0].room_from_body.to_homogeneous().cast::<f32>());
    }

    /// A body that its weight bends has a rest shape beside it too, whoever sums its surface.
    #[test]
    fn a_body_that_sags_has_its_ghost() {
        let text = "[body.b]\ngenerate = { block = { size = [1.0, 0.1, 0.1], cells = [8, 2, 2] } }\ngravity = true\n\
                    material = { young = 1.0e6, poisson = 0.3, density = 1000.0 }\neffects = [\"ghost_rest\"]\n\
                    control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";
        let scene = Resolved::parse(text, Path::new("sag.toml")).unwrap();
        let mut world =
            effect::world(&[ENTRY], &scene, &file_of(&scene).unwrap(), Stage::find("desktop").unwrap())
                .unwrap();
        for partial in [false, true] {
            if partial {
                world.bodies[0].deformer.sum_only_at(vec![0]);
            }
            world.step(&TrackerState::default().into());
            assert_eq!(world.frame.all(Drawable::ghost).count(), 1, "{partial}");
        }
    }
}
