//! A body that the graphics device deforms, for which the CPU only keeps the nodes of control elements: reading its surface
//! gives the same as for a body that the CPU deforms.

use super::*;

#[test]
fn a_surface_that_the_device_deforms_reads_as_one_that_the_cpu_deforms() {
    let (mut here, mut elsewhere) = (world(), world());
    let body = &mut elsewhere.bodies[0];
    let kept = body.pickable();
    assert!(kept.len() < body.deformer.node_count(), "the middle of the block belongs to no control element");
    body.deformer.sum_only_at(kept.clone());

    for (y, pressed) in [(0.0, false), (0.0, true), (0.3, true), (0.6, true), (0.6, false)] {
        for world in [&mut here, &mut elsewhere] {
            world.step(&state(world, [1.5, y, 0.1], [0.0, y, 0.1], pressed).into());
        }
        assert_eq!(here.state_hash(), elsewhere.state_hash());
        let [a, b] = [&here, &elsewhere].map(|world| &world.bodies[0]);
        assert_eq!(here.frame.bodies, elsewhere.frame.bodies, "what is pointed at and held");
        assert_eq!(a.deformer.positions(), b.deformer.positions());
        assert_eq!(a.deformer.normals(), b.deformer.normals());
        for node in 0..a.deformer.node_count() {
            let apart = (a.deformer.displacement(node) - b.deformer.displacement(node)).norm();
            assert!(apart < 1e-6, "node {node} differs by {apart} m");
            let is_kept = b.deformer.kept_positions()[node] == a.deformer.kept_positions()[node];
            let is_known = b.deformer.kept_positions()[node].iter().all(|x| x.is_finite());
            assert_eq!((is_kept, is_known), [kept.contains(&(node as u32)); 2].into(), "stale at {node}");
        }
    }
    let moved =
        here.bodies[0].deformer.displacement(0).norm() + here.bodies[0].deformer.poses[1].translation.norm();
    assert!(moved > 0.1, "the test bends the block");
}

/// The body is set aside by its present shape: the stylus points at the middle of the bent block, which belongs to no control
/// element.
#[test]
fn a_body_that_the_device_deforms_is_pointed_at_where_it_is_bent_to() {
    let mut world = world();
    let kept = world.bodies[0].pickable();
    world.bodies[0].deformer.sum_only_at(kept.clone());
    for (y, pressed) in [(0.0, false), (0.0, true), (1.2, true), (1.2, false)] {
        world.step(&state(&world, [1.5, y, 0.1], [0.0, y, 0.1], pressed).into());
    }
    let body = &world.bodies[0];
    let place = |at: &[[f32; 3]], node: usize| {
        body.room_from_surface() * Point3::from(Vector3::from(at[node]).cast::<f64>())
    };
    let height =
        |node: usize| place(&body.deformer.positions(), node).y - place(body.deformer.rest(), node).y;
    let free = |node: &usize| !kept.contains(&(*node as u32));
    let node = (0..body.deformer.node_count())
        .filter(free)
        .max_by(|a, b| height(*a).total_cmp(&height(*b)))
        .unwrap();
    assert!(
        height(node) > 0.2 * world.assets.stage.workspace.radius_m,
        "it was carried up by {} m",
        height(node)
    );
    let workspace = world.assets.stage.workspace;
    let there = (place(&body.deformer.positions(), node) - workspace.centre) / workspace.radius_m;
    // From the front, a little inside of the surface.
    let aim = [0.98 * there.x, 0.98 * there.y, 0.0];
    let from = [aim[0], aim[1], 3.0];
    world.step(&state(&world, from, aim, false).into());
    assert_eq!(world.pointed_body(0), Some(0));
    let past = [aim[0], aim[1] + 0.8, 0.0];
    world.step(&state(&world, [past[0], past[1], 3.0], past, false).into());
    assert_eq!(world.pointed_body(0), None);
}
