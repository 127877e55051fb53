//! Picking: the nearest element, from either side, and nothing where there is nothing.

use greenstage::interact::{PickRay, PickShape, PickTarget, pick};
use greenstage::mesh::Surface;
use greenstage::track::StylusState;
use nalgebra::{Isometry3, Point3, Similarity3, UnitQuaternion, Vector3};
use proptest::prelude::*;

/// Two unit squares of two triangles each, at z = 0 and z = 1, in one body.
fn squares() -> (Vec<Vector3<f32>>, [PickShape; 2]) {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions = [0.0, 1.0].iter().flat_map(|&z| corners.map(|[x, y]| Vector3::new(x, y, z))).collect();
    let shape = |first: u32| PickShape {
        triangles: vec![[first, first + 1, first + 2], [first, first + 2, first + 3]],
        points: vec![],
    };
    (positions, [shape(0), shape(4)])
}

fn target<'a>(shape: &'a PickShape, positions: &'a [Vector3<f32>]) -> PickTarget<'a> {
    PickTarget { shape, positions, ball_radius_m: 0.05, room_from_body: Similarity3::identity() }
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> PickRay {
    PickRay { origin_in_room: origin.into(), direction_in_room: Vector3::from(direction).normalize() }
}

#[test]
fn the_nearest_of_two_elements_is_hit_from_either_side() {
    let (positions, shapes) = squares();
    let targets = [target(&shapes[0], &positions), target(&shapes[1], &positions)];
    let hit = pick(&ray([0.25, 0.5, 3.0], [0.0, 0.0, -1.0]), &targets).unwrap();
    assert_eq!((hit.target, hit.distance_m), (1, 2.0));
    assert_eq!(hit.point_in_room, Point3::new(0.25, 0.5, 1.0));
    let hit = pick(&ray([0.25, 0.5, -3.0], [0.0, 0.0, 1.0]), &targets).unwrap();
    assert_eq!((hit.target, hit.distance_m), (0, 3.0));
    let hit = pick(&ray([0.25, 0.5, 0.5], [0.0, 0.0, -1.0]), &targets).unwrap();
    assert_eq!(hit.target, 0, "from between the two");
}

#[test]
fn beside_behind_and_along_there_is_no_hit() {
    let (positions, shapes) = squares();
    let targets = [target(&shapes[0], &positions), target(&shapes[1], &positions)];
    assert_eq!(pick(&ray([1.25, 0.5, 3.0], [0.0, 0.0, -1.0]), &targets), None, "beside");
    assert_eq!(pick(&ray([0.25, 0.5, 3.0], [0.0, 0.0, 1.0]), &targets), None, "behind the origin");
    assert_eq!(pick(&ray([-1.0, 0.5, 1.0], [1.0, 0.0, 0.0]), &targets), None, "in the plane");
    assert_eq!(pick(&ray([0.25, 0.5, 3.0], [0.0, 0.0, -1.0]), &[]), None, "nothing there");
}

#[test]
fn degenerate_and_damaged_triangles_are_never_hit() {
    let nan = f32::NAN;
    let positions = [
        Vector3::new(0.0, 0.0, 0.0),
        Vector3::new(1.0, 0.0, 0.0),
        Vector3::new(2.0, 0.0, 0.0),
        Vector3::new(nan, nan, nan),
        Vector3::new(0.0, 2.0, 0.0),
        Vector3::new(f32::INFINITY, 0.0, 0.0),
    ];
    let triangles = vec![[0, 0, 0], [0, 1, 2], [0, 1, 1], [0, 1, 3], [0, 1, 99], [0, 4, 5], [3, 3, 3]];
    let shape = PickShape { triangles, points: vec![] };
    for origin in [[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [1.0, 0.0, 1.0], [0.25, 0.25, 1.0]] {
        assert_eq!(pick(&ray(origin, [0.0, 0.0, -1.0]), &[target(&shape, &positions)]), None);
    }
}

#[test]
fn rays_that_are_not_finite_hit_nothing() {
    let (positions, shapes) = squares();
    let targets = [target(&shapes[0], &positions)];
    for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
        let ray = PickRay { origin_in_room: Point3::new(bad, 0.5, 1.0), direction_in_room: -Vector3::z() };
        assert_eq!(pick(&ray, &targets), None);
        let ray = PickRay {
            origin_in_room: Point3::new(0.5, 0.5, 1.0),
            direction_in_room: Vector3::new(0.0, f32::NAN, bad),
        };
        assert_eq!(pick(&ray, &targets), None);
    }
    let still = PickRay { origin_in_room: Point3::new(0.5, 0.5, 1.0), direction_in_room: Vector3::zeros() };
    assert_eq!(pick(&still, &targets), None);
    let pose = Isometry3::translation(0.0, f32::NAN, 0.0);
    let stylus = StylusState { room_from_stylus: pose, pressed: true, ..Default::default() };
    assert_eq!(PickRay::from_stylus(&stylus), None);
}

#[test]
fn a_body_that_is_turned_scaled_and_moved_is_hit_where_it_is_shown() {
    let (positions, shapes) = squares();
    let room_from_body = Similarity3::new(Vector3::new(0.3, 1.2, -0.4), Vector3::new(0.2, -0.9, 0.5), 0.35);
    let targets = [PickTarget { room_from_body, ..target(&shapes[0], &positions) }];
    let aimed_at = room_from_body * Point3::new(0.25, 0.5, 0.0);
    let origin = Point3::new(0.1, 1.9, 1.1);
    let towards = aimed_at - origin;
    let ray = PickRay { origin_in_room: origin.cast(), direction_in_room: towards.normalize().cast() };
    let hit = pick(&ray, &targets).unwrap();
    assert!((hit.point_in_room.cast::<f64>() - aimed_at).norm() < 1e-6);
    assert!((f64::from(hit.distance_m) - towards.norm()).abs() < 1e-6);
}

#[test]
fn a_stylus_aims_along_its_negative_z() {
    let turn = UnitQuaternion::from_euler_angles(0.0, std::f32::consts::FRAC_PI_2, 0.0);
    let pose = Isometry3::from_parts(nalgebra::Translation3::new(1.0, 2.0, 3.0), turn);
    let stylus = StylusState { room_from_stylus: pose, ..Default::default() };
    let ray = PickRay::from_stylus(&stylus).unwrap();
    assert_eq!(ray.origin_in_room, Point3::new(1.0, 2.0, 3.0));
    assert!((ray.direction_in_room + Vector3::x()).norm() < 1e-6);
}

#[test]
fn an_element_is_its_whole_triangles_or_else_balls_about_its_nodes() {
    // Mesh nodes 10, 12, 14, 16 are on the surface.
    let surface = Surface { triangles: vec![[0, 1, 2], [1, 3, 2]], nodes: vec![10, 12, 14, 16] };
    let shape = PickShape::new(&surface, &[10, 11, 12, 14]);
    assert_eq!((shape.triangles, shape.points), (vec![[0, 1, 2]], vec![]));
    let shape = PickShape::new(&surface, &[10, 11, 16]);
    assert_eq!((shape.triangles.len(), shape.points), (0, vec![0, 3]));
    assert_eq!(PickShape::new(&surface, &[11, 13]), PickShape::default());

    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]].map(Vector3::from);
    let shape = PickShape { triangles: vec![], points: vec![0, 3] };
    let hit = pick(&ray([1.0, 1.0, 2.0], [0.0, 0.0, -1.0]), &[target(&shape, &positions)]).unwrap();
    assert!((hit.distance_m - 1.95).abs() < 1e-6);
    assert_eq!(pick(&ray([0.5, 0.5, 2.0], [0.0, 0.0, -1.0]), &[target(&shape, &positions)]), None);
    let inside = pick(&ray([0.0, 0.0, 0.0], [0.0, 0.0, -1.0]), &[target(&shape, &positions)]).unwrap();
    assert_eq!(inside.distance_m, 0.0);
}

fn any_number() -> impl Strategy<Value = f32> {
    prop_oneof![4 => -2.0..2.0f32, 1 => any::<f32>(), 1 => Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_hit_is_always_a_place_on_the_ray(
        origin in prop::array::uniform3(any_number()),
        direction in prop::array::uniform3(any_number()),
        corners in prop::collection::vec(prop::array::uniform3(any_number()), 6),
    ) {
        let positions: Vec<Vector3<f32>> = corners.into_iter().map(Vector3::from).collect();
        let faces = PickShape { triangles: vec![[0, 1, 2], [3, 4, 5], [2, 3, 6]], points: vec![] };
        let balls = PickShape { triangles: vec![], points: vec![1, 4, 7] };
        let ray = PickRay { origin_in_room: origin.into(), direction_in_room: direction.into() };
        if let Some(hit) = pick(&ray, &[target(&faces, &positions), target(&balls, &positions)]) {
            prop_assert!(hit.distance_m >= 0.0 && hit.distance_m.is_finite());
            let unit = Vector3::from(direction).cast::<f64>().normalize();
            let expected = ray.origin_in_room.cast::<f64>() + unit * f64::from(hit.distance_m);
            let error = (hit.point_in_room.cast::<f64>() - expected).norm();
            prop_assert!(error <= 1e-5 * (1.0 + f64::from(hit.distance_m) + expected.coords.norm()), "{error}");
        }
    }
}
