//! Picking with a ray, which finds the nearest deformed control element, and touching with the stylus' tip, which finds the
//! nearest point of the control elements within reach.
//!
//! In: a ray in the room and each element's triangles in its body's frame. Out: the [`Hit`]. The intersections
//! are parry's. There is no tree over the triangles, because they move in every frame and building it costs more than the
//! one ray that is cast.

use crate::mesh::Surface;
use crate::track::{StylusState, usable};
use nalgebra::{Point3, Similarity3, Vector3};
use parry3d::query::{PointQuery, Ray, RayCast, RayIntersection};
use parry3d::shape::{Ball, Triangle};
use std::collections::BTreeSet;

/// A ray in the room; the direction has length 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickRay {
    pub origin_in_room: Point3<f32>,
    pub direction_in_room: Vector3<f32>,
}

/// The part of one control element that can be hit, as indices into its body's surface vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PickShape {
    /// The surface's triangles that belong wholly to the element.
    pub triangles: Vec<[u32; 3]>,
    /// The element's vertices, which can be hit as balls; used only if there is no such triangle.
    pub points: Vec<u32>,
}

/// A control element as it is deformed now.
#[derive(Clone, Copy, Debug)]
pub struct PickTarget<'a> {
    pub shape: &'a PickShape,
    /// All surface vertices of the body, deformed, in the body's frame.
    pub positions: &'a [Vector3<f32>],
    /// Radius of the balls about `shape.points`, in the body's metres.
    pub ball_radius_m: f32,
    pub room_from_body: Similarity3<f64>,
}

/// The nearest point that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hit {
    /// Index into the targets.
    pub target: usize,
    #[serde(with = "crate::field::numbers")]
    pub point_in_room: Point3<f32>,
    /// Distance from the ray's origin, m in the room.
    pub distance_m: f32,
}

impl PickRay {
    /// The stylus' -z axis from its origin; `None` if its pose is not usable.
    pub fn from_stylus(stylus: &StylusState) -> Option<Self> {
        let pose = usable(&stylus.room_from_stylus)?;
        Some(Self {
            origin_in_room: Point3::from(pose.translation.vector.cast::<f32>()),
            direction_in_room: (pose.rotation * -Vector3::z()).cast(),
        })
    }
}

impl PickTarget<'_> {
    /// Distance by which the ray passes the nearest of `shape.points`, and the distance within which it would hit one, m in the
    /// room.
    pub fn missed_by(&self, ray: &PickRay) -> Option<(f64, f64)> {
        let (origin, way) = (ray.origin_in_room.cast::<f64>(), ray.direction_in_room.cast::<f64>());
        let missed = |vertex: &u32| {
            let place = self.positions.get(*vertex as usize)?;
            let from_origin = self.room_from_body * Point3::from(place.cast::<f64>()) - origin;
            let missed_m = (from_origin - way * from_origin.dot(&way).max(0.0)).norm();
            missed_m.is_finite().then_some(missed_m)
        };
        let nearest = self.shape.points.iter().filter_map(missed).min_by(f64::total_cmp)?;
        Some((nearest, f64::from(self.ball_radius_m) * self.room_from_body.scaling()))
    }
}

impl PickShape {
    /// The part of a control element that is on the surface; `element_nodes` are nodes of the mesh. Empty if none is: such an
    /// element cannot be picked.
    pub fn new(surface: &Surface, element_nodes: &[u32]) -> Self {
        let nodes: BTreeSet<u32> = element_nodes.iter().copied().collect();
        let is_of_element =
            |&vertex: &u32| surface.nodes.get(vertex as usize).is_some_and(|node| nodes.contains(node));
        let triangles: Vec<[u32; 3]> =
            surface.triangles.iter().filter(|triangle| triangle.iter().all(is_of_element)).copied().collect();
        let points = if triangles.is_empty() {
            (0..surface.nodes.len() as u32).filter(is_of_element).collect()
        } else {
            Vec::new()
        };
        Self { triangles, points }
    }
}

/// The nearest hit of a ray with any target, if there is one. A triangle can be hit from either side; those
/// without area, with a vertex that does not exist or is not finite are never hit.
pub fn pick(ray: &PickRay, targets: &[PickTarget]) -> Option<Hit> {
    let hits = targets.iter().enumerate().filter_map(|(target, shape)| pick_one(ray, target, shape));
    hits.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn pick_one(ray: &PickRay, target: usize, element: &PickTarget) -> Option<Hit> {
    let body_from_room = element.room_from_body.inverse();
    let origin: Vector3<f64> = (body_from_room * ray.origin_in_room.cast::<f64>()).coords;
    let direction: Vector3<f64> =
        (body_from_room.isometry.rotation * ray.direction_in_room.cast::<f64>()).try_normalize(1e-6)?;
    let ray_in_body = Ray::new(origin.cast::<f32>().into(), direction.cast::<f32>().into());
    let position = |vertex: u32| element.positions.get(vertex as usize).copied();

    let triangles = element.shape.triangles.iter().filter_map(|&[a, b, c]| {
        let triangle = Triangle::new(position(a)?.into(), position(b)?.into(), position(c)?.into());
        triangle.cast_local_ray_and_get_normal(&ray_in_body, f32::MAX, false)
    });
    let balls = element.shape.points.iter().filter_map(|&vertex| {
        let centre = position(vertex)?;
        let from_centre = Ray::new((origin.cast::<f32>() - centre).into(), ray_in_body.dir);
        Ball::new(element.ball_radius_m).cast_local_ray_and_get_normal(&from_centre, f32::MAX, true)
    });
    let is_place = |hit: &RayIntersection| hit.time_of_impact.is_finite() && hit.time_of_impact >= 0.0;
    let nearest = triangles
        .chain(balls)
        .filter(is_place)
        .min_by(|a, b| a.time_of_impact.total_cmp(&b.time_of_impact))?;

    let room_from_body = element.room_from_body;
    let distance_m = f64::from(nearest.time_of_impact) * room_from_body.scaling();
    let towards_room = room_from_body.isometry.rotation * direction;
    let point = ray.origin_in_room.cast::<f64>() + towards_room * distance_m;
    let is_finite = point.iter().all(|x| x.is_finite());
    is_finite.then(|| Hit { target, point_in_room: point.cast(), distance_m: distance_m as f32 })
}

/// The nearest place of any target within `reach_m` of `tip`, in the room, as a [`Hit`] whose ray runs from the tip to the
/// place; `None` if there is none. The projections are parry's; triangles whose box is out of reach are skipped. Triangles
/// without area count by their edges; those with a vertex that does not exist or is not finite are never touched.
pub fn reach(tip: &Point3<f64>, targets: &[PickTarget], reach_m: f64) -> Option<Hit> {
    let touched =
        targets.iter().enumerate().filter_map(|(target, shape)| reach_one(tip, target, shape, reach_m));
    touched.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn reach_one(tip: &Point3<f64>, target: usize, element: &PickTarget, reach_m: f64) -> Option<Hit> {
    let room_from_body = element.room_from_body;
    let tip_in_body = room_from_body.inverse() * tip;
    let centre: Vector3<f32> = tip_in_body.coords.cast();
    let reach_in_body = (reach_m / room_from_body.scaling()) as f32;
    let position = |vertex: u32| {
        element.positions.get(vertex as usize).copied().filter(|place| place.iter().all(|x| x.is_finite()))
    };
    let mut nearest: Option<(f32, Vector3<f32>)> = None;
    let mut offer = |place: Vector3<f32>| {
        let distance = (place - centre).norm();
        if distance <= reach_in_body && nearest.is_none_or(|(least, _)| distance < least) {
            nearest = Some((distance, place));
        }
    };
    for &[a, b, c] in &element.shape.triangles {
        let (Some(a), Some(b), Some(c)) = (position(a), position(b), position(c)) else { continue };
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        let is_out =
            (0..3).any(|k| centre[k] < low[k] - reach_in_body || centre[k] > high[k] + reach_in_body);
        if !is_out {
            let triangle = Triangle::new(a.into(), b.into(), c.into());
            let projected = triangle.project_local_point(centre.into(), false).point;
            offer(Vector3::new(projected.x, projected.y, projected.z));
        }
    }
    element.shape.points.iter().filter_map(|&vertex| position(vertex)).for_each(&mut offer);

    let (_, place) = nearest?;
    let point = room_from_body * Point3::from(place.cast::<f64>());
    let way = tip - point;
    point.iter().all(|x| x.is_finite()).then(|| Hit {
        target,
        point_in_room: point.cast(),
        distance_m: way.norm() as f32,
    })
}

#[cfg(test)]
mod tests {
    use super::super::PickShape;
    use super::*;
    use nalgebra::Similarity3;

    /// A unit square at z = 0, and one vertex at (3, 0, 0) that stands alone.
    fn positions() -> Vec<Vector3<f32>> {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [3.0, 0.0], [f32::NAN, 0.0]]
            .map(|[x, y]| Vector3::new(x, y, 0.0))
            .to_vec()
    }

    fn touch(tip: [f64; 3], reach_m: f64, room_from_body: Similarity3<f64>) -> Option<Hit> {
        let positions = positions();
        let square =
            PickShape { triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 1, 99]], points: vec![] };
        let lone = PickShape { triangles: vec![], points: vec![4, 5, 99] };
        let target = |shape| PickTarget { shape, positions: &positions, ball_radius_m: 0.1, room_from_body };
        let targets = [target(&square), target(&lone)];
        reach(&tip.into(), &targets, reach_m)
    }

    #[test]
    fn the_nearest_place_within_reach_is_touched() {
        let here = Similarity3::identity();
        let hit = touch([0.3, 0.4, 0.05], 0.1, here).unwrap();
        assert_eq!(hit.target, 0);
        assert!((hit.point_in_room - Point3::new(0.3, 0.4, 0.0)).norm() < 1e-6);
        assert!((hit.distance_m - 0.05).abs() < 1e-6);
        let edge = touch([1.06, 0.5, 0.08], 0.11, here).unwrap();
        assert!((edge.point_in_room - Point3::new(1.0, 0.5, 0.0)).norm() < 1e-6);
        assert_eq!(touch([2.95, 0.0, 0.0], 0.1, here).map(|hit| hit.target), Some(1));
        assert_eq!(touch([0.3, 0.4, 0.11], 0.1, here), None);
        assert_eq!(touch([f64::NAN, 0.4, 0.0], 0.1, here), None);
    }

    #[test]
    fn reach_is_measured_in_the_room() {
        let small = Similarity3::new(Vector3::new(0.0, 1.0, 0.0), Vector3::zeros(), 0.1);
        let hit = touch([0.05, 1.05, 0.02], 0.03, small).unwrap();
        assert!((hit.distance_m - 0.02).abs() < 1e-6, "{hit:?}");
        assert_eq!(touch([0.05, 1.05, 0.04], 0.03, small), None);
    }
}
