//! Control elements that are free in some directions, or pushed there by a force: their poses are found.
//!
//! In: poses as they are asked for, which shifts and turns of which element are free ([`Freedom`]) with what pushes along
//! them, and a body that gives the wrenches of any pose. Out: poses in which the body holds those forces and moments. With q the
//! free shifts and turns, each element at T + q_T and exp(\[q_ω\]) M, Newton's iteration solves
//!
//! ```text
//! w(q) = load     q ← q - J⁻¹ (w - load)
//! ```
//!
//! on the way from rest, with J by differences once and then by Broyden's updates (Math. Comp. 19, 1965). The moment is about
//! where the element's origin is now. A model that is linear in the matrices takes M + \[q_ω\] and has the equilibrium of small
//! strain, whose moments do not know by how much the body is displaced: one step is exact.

use crate::deform::pose::frame::{ControlPose, ControlPoses, Wrench};
use nalgebra::{DMatrix, DVector, Rotation3, Vector3};

/// Shifts along the body's axes, then turns about them.
pub const COMPONENTS: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// Free directions of a control element, and the loads along them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Freedom {
    pub free: [bool; 6],
    /// Forces and moments along the free directions, N and N·m.
    pub load: [f64; 6],
}

impl Freedom {
    pub fn is_any(&self) -> bool {
        self.free.contains(&true)
    }
}

/// Change of a free component by which J is found as a difference, in parts of the body's size, or rad.
const STEP: f64 = 1e-5;
/// Change of a free component that counts as none, in the same units.
const NOTHING: f64 = 1e-12;
/// Largest error of the loads, as a part of the largest wrench; and that of a body which answers no more closely, because its own
/// equilibrium is found to a tolerance: a thin strip resists being stretched (L/t)² times more than being bent.
const TOLERANCE: f64 = 1e-8;
const ROUGH: f64 = 1e-5;
/// A step is taken where the next one, with the same slopes, is at most this part as long: what bends little stretches a thin body to
/// second order, so that forces grow before they fall (after the natural monotonicity test; P. Deuflhard, Newton Methods for
/// Nonlinear Problems, Springer 2004, section 3.1). Else half of it is tried, and so on, so many in all.
const NEARER: f64 = 0.9;
const TRIALS: i32 = 5;
const ITERATIONS: usize = 30;
/// The first part of the way, and the smallest.
const FIRST_PART: f64 = 0.25;
const LEAST_PART: f64 = 1.0 / 128.0;
/// Ratio of the least to the largest stiffness below which nothing holds the body.
pub(super) const LOOSE: f64 = 1e-9;

/// "1st", "2nd", "3rd", "4th" …
fn ordinal(n: usize) -> String {
    let end = match (n % 10, n % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{n}{end}")
}

/// Names a control element with a motion that no force resists, and the remedy.
pub(super) fn loose(element: usize, component: &str) -> String {
    format!(
        "the {} control element of the scene can move in {component} without a force: take that out of its free directions, or \
         hold another element",
        ordinal(element + 1)
    )
}

/// The wrenches that hold a body in poses, each with the moment about where the element's origin is; the error says why there are none.
pub type Wrenches<'a> = dyn FnMut(&[ControlPose]) -> Result<Vec<Wrench>, String> + 'a;

/// A search for poses in which the free directions hold their loads.
pub struct Search<'a> {
    pub freedom: &'a [Freedom],
    /// Size of the body, m.
    pub length: f64,
    /// Whether the body's model takes matrices as they are.
    pub is_linear: bool,
    /// Largest difference between wrenches and loads, as a part of the largest wrench.
    pub tolerance: f64,
    /// The poses as they are asked for, at a share of the way to them.
    pub way: &'a dyn Fn(f64) -> ControlPoses,
    /// Wrench that holds each control element where the way begins: zero at rest.
    start: Vec<[f64; 6]>,
    jacobian: Option<DMatrix<f64>>,
    /// The last that was found, as a start for others: its share and q.
    last: (f64, DVector<f64>),
}

/// A residual with its size, that below which it is none, and that below which it may stay where it does not fall.
struct Residual {
    r: DVector<f64>,
    enough: f64,
    rough: f64,
}

impl<'a> Search<'a> {
    pub fn new(
        freedom: &'a [Freedom],
        length: f64,
        is_linear: bool,
        way: &'a dyn Fn(f64) -> ControlPoses,
    ) -> Search<'a> {
        let count = freedom.iter().flat_map(|of| of.free).filter(|free| *free).count();
        let last = (0.0, DVector::zeros(count));
        let start = vec![[0.0; 6]; freedom.len()];
        Search { freedom, length, is_linear, tolerance: TOLERANCE, way, start, jacobian: None, last }
    }

    /// Begins the way at another pose than rest: loads grow from the wrenches that hold the body there.
    pub fn going_on(mut self, of: &mut Wrenches<'_>) -> Result<Search<'a>, String> {
        let poses = (self.way)(0.0);
        let of_six = |w: &Wrench| [w.force.x, w.force.y, w.force.z, w.moment.x, w.moment.y, w.moment.z];
        self.start = of(&poses)?.iter().map(of_six).collect();
        Ok(self)
    }

    /// Element and component of each unknown.
    fn unknowns(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let of = |(e, of): (usize, &'a Freedom)| (0..6).filter(|&k| of.free[k]).map(move |k| (e, k));
        self.freedom.iter().enumerate().flat_map(of)
    }

    fn poses(&self, share: f64, q: &DVector<f64>) -> ControlPoses {
        let mut poses = (self.way)(share);
        let mut turns = vec![Vector3::zeros(); poses.len()];
        for ((e, k), q) in self.unknowns().zip(q.iter()) {
            if k < 3 {
                poses[e].translation[k] += q * self.length;
            } else {
                turns[e][k - 3] = *q;
            }
        }
        for (pose, turn) in poses.iter_mut().zip(turns) {
            pose.matrix = match self.is_linear {
                true => pose.matrix + turn.cross_matrix(),
                false => Rotation3::from_scaled_axis(turn).matrix() * pose.matrix,
            };
        }
        poses
    }

    /// w - load in N·m, forces by the body's size.
    fn residual(&self, share: f64, q: &DVector<f64>, of: &mut Wrenches<'_>) -> Result<Residual, String> {
        let poses = self.poses(share, q);
        let placed = of(&poses)?;
        let value = |e: usize, k: usize| {
            let wrench = &placed[e];
            if k < 3 { wrench.force[k] * self.length } else { wrench.moment[k - 3] }
        };
        let load = |e: usize, k: usize| {
            let load = self.start[e][k] + share * (self.freedom[e].load[k] - self.start[e][k]);
            if k < 3 { load * self.length } else { load }
        };
        let r: Vec<f64> = self.unknowns().map(|(e, k)| value(e, k) - load(e, k)).collect();
        let wrenches = placed.iter().map(|w| (w.force.norm() * self.length).max(w.moment.norm()));
        let loads = self.unknowns().map(|(e, k)| load(e, k).abs());
        let largest = wrenches.chain(loads).fold(0.0, f64::max);
        let stiff = self.jacobian.as_ref().map_or(0.0, |jacobian| jacobian.norm());
        let r = DVector::from_vec(r);
        if !r.iter().all(|x| x.is_finite()) {
            return Err("the forces are not finite".to_owned());
        }
        let enough = self.tolerance * largest + NOTHING * stiff;
        Ok(Residual { r, enough, rough: enough.max(ROUGH * largest) })
    }

    fn slope(&self, share: f64, q: &DVector<f64>, of: &mut Wrenches<'_>) -> Result<DMatrix<f64>, String> {
        let at = self.residual(share, q, of)?.r;
        let mut slope = DMatrix::zeros(at.len(), at.len());
        for k in 0..at.len() {
            let mut moved = q.clone();
            moved[k] += STEP;
            slope.set_column(k, &((self.residual(share, &moved, of)?.r - &at) / STEP));
        }
        let svd = slope.clone().svd(false, true);
        let stretches = &svd.singular_values;
        if stretches.min() <= LOOSE * stretches.max() {
            let weakest = svd.v_t.map(|v| v.row(stretches.imin()).iamax_full().1);
            let (e, k) = weakest.and_then(|at| self.unknowns().nth(at)).unwrap_or_default();
            return Err(loose(e, COMPONENTS[k]));
        }
        Ok(slope)
    }

    /// The poses at a share of the way, from what was found last.
    pub fn at(&mut self, share: f64, of: &mut Wrenches<'_>) -> Result<ControlPoses, String> {
        let (before, q) = &self.last;
        let mut q = if *before > 0.0 { q * (share / before) } else { q.clone() };
        let mut is_fresh = self.jacobian.is_none();
        if is_fresh {
            self.jacobian = Some(self.slope(share, &q, of)?);
        }
        let mut now = self.residual(share, &q, of)?;
        for _ in 0..ITERATIONS {
            if now.r.norm() <= now.enough {
                break;
            }
            // It stays where it is: the residual that is none is a part of it.
            let jacobian = self.jacobian.clone().unwrap_or_else(|| DMatrix::zeros(q.len(), q.len()));
            let factor = jacobian.clone().lu();
            let step = factor.solve(&-&now.r).filter(|_| !q.is_empty());
            let mut found = None;
            for halvings in 0..TRIALS {
                let Some(whole) = &step else { break };
                let step = whole * 0.5f64.powi(halvings);
                if let Ok(next) = self.residual(share, &(&q + &step), of).map(|next| (step, next))
                    && factor.solve(&next.1.r).is_some_and(|more| more.norm() < NEARER * whole.norm())
                {
                    found = Some(next);
                    break;
                }
                // An old slope may be at fault: a new one costs as much as a few halvings.
                if !is_fresh {
                    break;
                }
            }
            match found {
                Some((step, next)) => {
                    let change = &next.r - &now.r - &jacobian * &step;
                    let updated = jacobian + change * step.transpose() / step.norm_squared();
                    (q, now, self.jacobian, is_fresh) = (q + step, next, Some(updated), false);
                }
                None if !is_fresh => {
                    self.jacobian = Some(self.slope(share, &q, of)?);
                    is_fresh = true;
                }
                None => break,
            }
        }
        if now.r.norm() <= now.rough {
            let poses = self.poses(share, &q);
            self.last = (share, q);
            return Ok(poses);
        }
        self.jacobian = None;
        Err("no pose of the free directions was found that these forces hold".to_owned())
    }

    /// The poses at the end of the way, found from rest on.
    pub fn follow(&mut self, of: &mut Wrenches<'_>) -> Result<ControlPoses, String> {
        self.follow_to(1.0, of)
    }

    /// The poses at a share of the way, found from rest or from what was found last, in as many parts as it takes.
    pub fn follow_to(&mut self, end: f64, of: &mut Wrenches<'_>) -> Result<ControlPoses, String> {
        if self.is_linear {
            return self.at(end, of);
        }
        let mut share = self.last.0;
        let mut part = if share == 0.0 { FIRST_PART * end } else { end - share };
        let least = 2.0 * LEAST_PART * end;
        loop {
            let to = f64::min(share + part, end);
            match self.at(to, of) {
                Ok(poses) if to == end => return Ok(poses),
                Ok(_) => (share, part) = (to, 2.0 * part),
                Err(why) if share == 0.0 && self.jacobian.is_none() && part < least => return Err(why),
                Err(why) if part < least => {
                    return Err(format!(
                        "{why}, beyond {:.0} % of the way; try a pose on the way there, and another that goes on from it by \
                         after = \"NAME\"",
                        100.0 * share
                    ));
                }
                Err(_) => part = 0.5 * (to - share),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    /// A cantilever of Bernoulli's: end force and moment of deflection w along z and turn θ about y.
    fn beam(poses: &[ControlPose]) -> Result<Vec<Wrench>, String> {
        let (ei, l) = (2.0, 0.5_f64);
        let pose = &poses[0];
        let (w, turn) = (pose.translation.z, pose.matrix[(0, 2)]);
        let mut wrench = Wrench { force: pose.translation * 1e3, moment: Vector3::zeros() };
        // A turn about y lowers the end of a beam along x.
        wrench.force.z = ei * (12.0 * w / l.powi(3) + 6.0 * turn / l.powi(2));
        wrench.moment = Vector3::new(pose.matrix[(2, 1)], 0.0, pose.matrix[(1, 0)]) * 10.0;
        wrench.moment.y = ei * (6.0 * w / l.powi(2) + 4.0 * turn / l);
        Ok(vec![wrench])
    }

    fn freedom(free: [bool; 6], load: [f64; 6]) -> [Freedom; 1] {
        [Freedom { free, load }]
    }

    /// Gere and Timoshenko, Mechanics of Materials, appendix G: 3 EI/L³ where the end may turn, 12 EI/L³ where it may not.
    #[test]
    fn an_end_that_may_turn_takes_a_quarter_of_the_force() {
        let asked = [ControlPose { translation: Vector3::new(0.0, 0.0, 1e-3), ..ControlPose::REST }];
        let way = |share: f64| vec![ControlPose { translation: asked[0].translation * share, ..asked[0] }];
        let turns = freedom([true, true, false, true, true, true], [0.0; 6]);
        for is_linear in [true, false] {
            let mut search = Search::new(&turns, 0.5, is_linear, &way);
            let found = search.follow(&mut beam).unwrap();
            let force = beam(&found).unwrap()[0].force.z;
            assert!((force - 3.0 * 2.0 / 0.125 * 1e-3).abs() < 1e-6, "{force}");
            assert!((found[0].matrix[(0, 2)] + 1.5 * 1e-3 / 0.5).abs() < 1e-7, "θ = 3 w / 2 L: {found:?}");
        }
    }

    #[test]
    fn a_force_finds_its_pose_and_nothing_moves_without_one() {
        let rest = |_: f64| vec![ControlPose::REST];
        let pushed = freedom([true; 6], [0.0, 0.0, 5.0, 0.0, 0.0, 0.0]);
        let found = Search::new(&pushed, 0.5, true, &rest).follow(&mut beam).unwrap();
        assert!((found[0].translation.z - 5.0 * 0.125 / 6.0).abs() < 1e-9, "F L³ / 3 EI");
        let free = freedom([true; 6], [0.0; 6]);
        let found = Search::new(&free, 0.5, false, &rest).follow(&mut beam).unwrap();
        assert!(
            found[0].translation.norm() < 1e-12 && (found[0].matrix - Matrix3::identity()).amax() < 1e-12
        );
    }

    /// A warm bar with a free end: no force is left, neither there nor at the clamp, that the residual could be a part of.
    #[test]
    fn a_free_end_of_a_warm_bar_moves_without_a_force() {
        let (stiffness, expansion) = (1e8 / 3.0, 1.2e-4);
        let mut bar = |poses: &[ControlPose]| {
            let force = Vector3::new(stiffness * (poses[0].translation.x - expansion), 0.0, 0.0);
            let wrench = |force| Wrench { force, moment: Vector3::zeros() };
            Ok(vec![wrench(force), wrench(-force)])
        };
        let slides = |free| Freedom { free: [free, false, false, false, false, false], load: [0.0; 6] };
        let freedom = [slides(true), slides(false)];
        let rest = |_: f64| vec![ControlPose::REST; 2];
        for is_linear in [true, false] {
            let found = Search::new(&freedom, 0.2, is_linear, &rest).follow(&mut bar).unwrap();
            assert!((found[0].translation.x - expansion).abs() < 1e-9 * expansion, "{found:?}");
        }
    }

    /// A strip that is 10⁶ times as stiff along as across answers to 10⁻⁶ N, as one whose equilibrium is found to a tolerance: the pose
    /// is found all the same, to that.
    #[test]
    fn a_body_whose_forces_are_rough_is_held_as_nearly_as_they_tell() {
        let mut strip = |poses: &[ControlPose]| {
            let shift = poses[0].translation;
            let along = 1e6 * (shift.x + 0.6 * shift.z * shift.z) + 1e-6 * (1e9 * shift.x).sin().signum();
            let force = Vector3::new(along, 0.0, shift.z + 1.2 * shift.z * along);
            Ok(vec![Wrench { force, moment: Vector3::zeros() }])
        };
        let slides = [Freedom { free: [true, false, false, false, false, false], load: [0.0; 6] }];
        let way = |share: f64| {
            vec![ControlPose { translation: Vector3::new(0.0, 0.0, 0.3 * share), ..ControlPose::REST }]
        };
        let found = Search::new(&slides, 1.0, false, &way).follow(&mut strip).unwrap();
        assert!((found[0].translation.x + 0.6 * 0.09).abs() < 1e-9, "x = -0.6 w²: {found:?}");
    }

    /// A strip that is free along and pushed across: the first step stretches it, by a force 10⁴ times that which pushes.
    #[test]
    fn a_thin_body_gives_way_though_forces_grow_at_first() {
        let mut strip = |poses: &[ControlPose]| {
            let shift = poses[0].translation;
            let along = 1e6 * (shift.x + 0.6 * shift.z * shift.z);
            let force = Vector3::new(along, 0.0, shift.z + 1.2 * shift.z * along);
            Ok(vec![Wrench { force, moment: Vector3::zeros() }])
        };
        let free = [true, false, true, false, false, false];
        let slides = [Freedom { free, load: [0.0, 0.0, 0.3, 0.0, 0.0, 0.0] }];
        let rest = |_: f64| vec![ControlPose::REST];
        let found = Search::new(&slides, 1.0, false, &rest).follow(&mut strip).unwrap()[0].translation;
        println!("{:e} and {:e} m off", found.z - 0.3, found.x + 0.6 * 0.09);
        assert!((found.z - 0.3).abs() < 1e-6 && (found.x + 0.6 * 0.09).abs() < 1e-6, "{found}");
    }

    /// x³ - x has three places that 0.1 N holds; from that of 0.9 N one comes to the nearest.
    #[test]
    fn a_pose_after_another_goes_on_from_its_forces() {
        let mut snap = |poses: &[ControlPose]| {
            let x = poses[0].translation.x;
            Ok(vec![Wrench { force: Vector3::new(x.powi(3) - x, 0.0, 0.0), moment: Vector3::zeros() }])
        };
        let slides = |load| {
            [Freedom {
                free: [true, false, false, false, false, false],
                load: [load, 0.0, 0.0, 0.0, 0.0, 0.0],
            }]
        };
        let before = 1.301_f64;
        let way = |share: f64| {
            vec![ControlPose { translation: Vector3::x() * before * (1.0 - share), ..ControlPose::REST }]
        };
        for load in [0.1, 1.5] {
            let freedom = slides(load);
            let search = Search::new(&freedom, 1.0, false, &way).going_on(&mut snap);
            let x = search.unwrap().follow(&mut snap).unwrap()[0].translation.x;
            assert!((x.powi(3) - x - load).abs() < 1e-6 && x > 1.0, "{load} N: {x}");
        }
    }

    #[test]
    fn a_body_that_nothing_holds_is_refused() {
        let rest = |_: f64| vec![ControlPose::REST];
        let free = freedom([true; 6], [0.0; 6]);
        let mut loose = |poses: &[ControlPose]| {
            let force = Vector3::new(poses[0].translation.x, 0.0, 0.0);
            Ok(vec![Wrench { force, moment: Vector3::zeros() }])
        };
        let why = Search::new(&free, 0.5, false, &rest).follow(&mut loose).unwrap_err();
        assert!(why.starts_with("the 1st control element of the scene can move in "), "{why}");
    }
}
