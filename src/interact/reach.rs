//! Touching with the stylus' tip: finds the nearest point of the control elements within reach.
//!
//! In: the tip in the room and each element's triangles in its body's frame. Out: a [`Hit`] whose ray runs from the tip to
//! the point. The projections are parry's; triangles whose box is out of reach are skipped.

use super::pick::{Hit, PickTarget};
use nalgebra::{Point3, Vector3};
use parry3d::query::PointQuery;
use parry3d::shape::Triangle;

/// The nearest place of any target within `reach_m` of `tip`, in the room; `None` if there is none. Triangles without
/// area count by their edges; those with a vertex that does not exist or is not finite are never touched.
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
        normal_in_room: way.try_normalize(1e-9).unwrap_or_else(Vector3::zeros).cast(),
        is_near: true,
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
        assert_eq!((hit.target, hit.is_near), (0, true));
        assert!((hit.point_in_room - Point3::new(0.3, 0.4, 0.0)).norm() < 1e-6);
        assert!((hit.distance_m - 0.05).abs() < 1e-6 && (hit.normal_in_room - Vector3::z()).norm() < 1e-5);
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
