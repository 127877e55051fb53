//! The effect `ghost_rest`: the body at rest, translucent, where the body as it is has left it.

use super::entry::{EffectEntry, Listed};
use super::running::RunningEffect;
use crate::deform::{ControlPose, Deformer, vertex_normals};
use crate::render::{Ghost, GhostShape};
use crate::world::World;
use std::sync::Arc;

/// A pale grey, linear, and the opacity of the outline.
const COLOR: [f32; 4] = [0.55, 0.62, 0.72, 0.55];

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: "ghost_rest",
    summary: "the rest shape, translucent, beside the deformed body",
    requirements: &[],
    needs_energy: false,
    precompute: None,
    attach: Some(|listed, world| Ok(Some(Box::new(RestGhosts::new(listed, world))))),
    start: None,
};

struct RestGhosts {
    bodies: Vec<(usize, Arc<GhostShape>)>,
}

impl RestGhosts {
    fn new(listed: &Listed<'_>, world: &World) -> RestGhosts {
        let of = |&(b, _): &(usize, &str)| (b, Arc::new(shape(&world.bodies[b].deformer, None)));
        RestGhosts { bodies: listed.bodies.iter().map(of).collect() }
    }
}

impl RunningEffect for RestGhosts {
    fn after_frame(&mut self, world: &mut World) {
        for (b, shape) in &self.bodies {
            let body = &world.bodies[*b];
            if body.deformer.poses.iter().any(|pose| *pose != ControlPose::REST) {
                let room_from_shape = body.room_from_body.to_homogeneous().cast();
                let shape = shape.clone();
                world.ghosts.push(Ghost { shape, room_from_shape, color: COLOR, through: 0.0 });
            }
        }
    }
}

/// The surface of a body at rest, or moved by these displacements, in the body's frame.
pub(super) fn shape(deformer: &Deformer, moved: Option<&[[f64; 3]]>) -> GhostShape {
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
    use crate::effect::attach;
    use crate::effect::ghost_equilibrium::tests::bar;

    #[test]
    fn the_ghost_is_the_body_at_rest_and_stands_only_beside_one_that_is_moved() {
        let (scene, file, mut world) = bar("ghost-rest", "linear", &["ghost_rest"]);
        let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap();
        running[0].after_frame(&mut world);
        assert!(world.ghosts.is_empty(), "at rest there is nothing beside the body");
        let mut poses = world.bodies[0].deformer.poses.clone();
        poses[1].translation.x = 0.01;
        world.bodies[0].deformer.evaluate(&poses);
        running[0].after_frame(&mut world);
        let [ghost] = &world.ghosts[..] else { panic!("{:?}", world.ghosts.len()) };
        let deformer = &world.bodies[0].deformer;
        assert_eq!(ghost.shape.positions, deformer.rest());
        assert_ne!(ghost.shape.positions[..], deformer.positions()[..]);
        assert_eq!(ghost.room_from_shape, world.bodies[0].room_from_body.to_homogeneous().cast::<f32>());
    }
}
