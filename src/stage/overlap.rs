//! Screens that lie in one plane and cover part of it twice.
//!
//! In: screens. Out: [`Overlap`]s, with the size of the area that two screens both cover. Screens that only touch are seams.

use super::screen::Screen;
use nalgebra::Point3;

/// The part of a plane that two screens both cover.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// The lower index first.
    pub screens: [usize; 2],
    /// Width and height along the first screen's sides, m.
    pub size_m: [f64; 2],
    /// The corners of both are the same, but perhaps in another order.
    pub is_same: bool,
}

/// Screens whose corners are within this distance of each other's plane lie in one plane, m.
const PLANE_M: f64 = 0.01;
/// Cosine of the largest angle between the normals of screens in one plane: 5°.
const PARALLEL: f64 = 0.9962;

type Polygon = Vec<[f64; 2]>;

/// All pairs whose common area is larger than `least_m` in both directions.
pub fn overlaps(screens: &[Screen], least_m: f64) -> Vec<Overlap> {
    let mut found = Vec::new();
    for (i, a) in screens.iter().enumerate() {
        for (j, b) in screens.iter().enumerate().skip(i + 1) {
            let Some(size_m) = size_m(a, b).filter(|size| size.iter().all(|side| *side > least_m)) else {
                continue;
            };
            let is_corner =
                |corner: Point3<f64>| a.corners().iter().any(|other| (other - corner).norm() <= least_m);
            let is_same = b.corners().into_iter().all(is_corner);
            found.push(Overlap { screens: [i, j], size_m, is_same });
        }
    }
    found
}

/// Width and height of the area that both cover, if they lie in one plane and face the same way.
fn size_m(a: &Screen, b: &Screen) -> Option<[f64; 2]> {
    let [right, up, normal] = a.axes();
    let of_b = b.corners().map(|corner| corner - a.lower_left);
    if normal.dot(&b.axes()[2]) < PARALLEL || of_b.iter().any(|way| way.dot(&normal).abs() > PLANE_M) {
        return None;
    }
    let mut common: Polygon = of_b.iter().map(|way| [way.dot(&right), way.dot(&up)]).collect();
    for (axis, length_m) in [a.width_m(), a.height_m()].into_iter().enumerate() {
        common = cut(&common, |point| point[axis]);
        common = cut(&common, |point| length_m - point[axis]);
    }
    let extent = |axis: usize| {
        let along = common.iter().map(|point| point[axis]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    (!common.is_empty()).then(|| [extent(0), extent(1)])
}

/// The part of a convex polygon where `inside`, which is linear, is not negative.
fn cut(polygon: &Polygon, inside: impl Fn(&[f64; 2]) -> f64) -> Polygon {
    let mut kept = Polygon::new();
    for (from, to) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let [here, there] = [inside(from), inside(to)];
        if here >= 0.0 {
            kept.push(*from);
        }
        if (here < 0.0) != (there < 0.0) {
            let share = here / (here - there);
            kept.push([0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Stage;
    use nalgebra::Vector3;

    /// The workbench's wall, 1.6 × 1.28 m, and the same moved.
    fn moved(by: [f64; 3]) -> Vec<Overlap> {
        let wall = Stage::find("workbench").unwrap().screens[1].clone();
        let mut other = wall.clone();
        for corner in [&mut other.lower_left, &mut other.lower_right, &mut other.upper_left] {
            *corner += Vector3::from(by);
        }
        overlaps(&[wall, other], 0.0005)
    }

    #[test]
    fn what_two_screens_both_cover_is_measured() {
        let [overlap] = &moved([1.4, 0.08, 0.001])[..] else { panic!("one overlap") };
        assert!(overlap.size_m.iter().zip([0.2, 1.2]).all(|(a, b)| (a - b).abs() < 1e-12), "{overlap:?}");
        assert!(!overlap.is_same);
        assert_eq!(moved([1.6, 0.0, 0.0]), [], "side by side");
        assert_eq!(moved([1.603, 0.0, 0.0]), [], "with a bezel between them");
        assert_eq!(moved([0.2, 0.0, 0.1]), [], "in another plane");
    }

    #[test]
    fn the_same_screen_twice_is_known_in_any_order_of_its_corners() {
        assert!(moved([0.0, 0.0002, 0.0])[0].is_same);
        let wall = Stage::find("workbench").unwrap().screens[1].clone();
        let (lower_left, lower_right) = (wall.upper_right(), wall.upper_left);
        let turned = Screen { lower_left, lower_right, upper_left: wall.lower_right, ..wall.clone() };
        assert!(overlaps(&[wall, turned], 0.0005)[0].is_same, "a projector upside down");
    }

    #[test]
    fn a_screen_turned_in_its_plane_is_cut_at_its_corners() {
        let wall = Stage::find("workbench").unwrap().screens[1].clone();
        // A square on its corner, its lowest corner 0.1 m above the wall's lower edge's middle.
        let place = |x: f64, y: f64| wall.lower_left + Vector3::new(0.8 + x, 0.1 + y, 0.0);
        let diamond = Screen {
            lower_left: place(0.0, 0.0),
            lower_right: place(1.0, 1.0),
            upper_left: place(-1.0, 1.0),
            ..wall.clone()
        };
        let [overlap] = &overlaps(&[wall, diamond], 0.0005)[..] else { panic!("one overlap") };
        assert!(overlap.size_m.iter().zip([1.6, 1.18]).all(|(a, b)| (a - b).abs() < 1e-12), "{overlap:?}");
    }

    #[test]
    fn no_built_in_stage_shows_a_place_twice() {
        for (name, _) in crate::stage::BUILT_IN {
            assert_eq!(overlaps(&Stage::find(name).unwrap().screens, 0.0005), [], "{name}");
        }
    }
}
