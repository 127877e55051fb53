//! The bent ray to the held point, and the arrow of the force there.
//!
//! In: where the hand would carry the grabbed point, and where that point is; a force. Out: a quadratic Bézier curve and an
//! arrow. The two points differ because of constraints, limits and a second hand.

use nalgebra::{Point3, Vector3};

/// If the points are closer than this fraction of the ray's length, the ray is drawn straight.
const STRAIGHT: f64 = 0.01;
/// The ray is straight for this fraction of its length from the stylus.
const STIFF: f64 = 2.0 / 3.0;

/// The middle control point of the curve from `tip` to `held`, which leaves the tip towards `carried`; `None` if a straight
/// line suffices or a point is not finite.
pub fn bend(tip: &Point3<f64>, carried: &Point3<f64>, held: &Point3<f64>) -> Option<Point3<f64>> {
    let (along, parted) = (carried - tip, (held - carried).norm());
    let is_bent = parted.is_finite() && along.norm() > 0.0 && parted > STRAIGHT * along.norm();
    is_bent.then(|| tip + along * STIFF)
}

/// A force as it is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceArrow {
    pub from: Point3<f64>,
    /// The vector of its length and direction in the room, m.
    pub along: Vector3<f64>,
    /// 0 to 1: the colour goes from green by yellow to red.
    pub strength: f64,
}

/// The arrow of `force_n` (N, in the room) at `place`: `longest_m` long at `full_n` and above, in proportion below.
/// `None` for a force below a thousandth of that, or not finite.
pub fn force_arrow(
    place: &Point3<f64>,
    force_n: &Vector3<f64>,
    full_n: f64,
    longest_m: f64,
) -> Option<ForceArrow> {
    let force = force_n.norm();
    let strength = (force / full_n).min(1.0);
    let is_shown = force.is_finite() && strength >= 1e-3 && place.iter().all(|x| x.is_finite());
    is_shown.then(|| ForceArrow { from: *place, along: force_n / force * (strength * longest_m), strength })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_bends_only_when_the_places_part_and_leaves_along_the_stylus() {
        let (tip, carried) = (Point3::new(0.0, 1.0, 1.0), Point3::new(0.0, 1.0, 0.4));
        assert_eq!(bend(&tip, &carried, &carried), None);
        assert_eq!(bend(&tip, &carried, &(carried + Vector3::x() * 0.005)), None);
        let control = bend(&tip, &carried, &(carried + Vector3::x() * 0.1)).unwrap();
        assert!((control - Point3::new(0.0, 1.0, 0.6)).norm() < 1e-12);
        assert_eq!(bend(&tip, &tip, &carried), None);
        assert_eq!(bend(&tip, &carried, &Point3::new(f64::NAN, 0.0, 0.0)), None);
    }

    #[test]
    fn an_arrow_is_as_long_as_its_force_up_to_the_longest() {
        let place = Point3::new(1.0, 2.0, 3.0);
        let arrow = |n: f64| force_arrow(&place, &(Vector3::y() * n), 10.0, 0.2);
        assert_eq!(arrow(5.0).unwrap().along, Vector3::y() * 0.1);
        assert_eq!((arrow(50.0).unwrap().along, arrow(50.0).unwrap().strength), (Vector3::y() * 0.2, 1.0));
        assert_eq!((arrow(0.0), arrow(1e-3), arrow(f64::NAN)), (None, None, None));
        let onto_nothing = force_arrow(&place, &Vector3::y(), 0.0, 0.2);
        assert_eq!(onto_nothing.unwrap().strength, 1.0, "a body without stiffness has no scale");
    }
}
