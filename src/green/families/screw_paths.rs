//! Paths on which control elements move against each other along screws, and the power series of the body on them.
//!
//! In: an assembled body with its affine fields u_j. Out: d_e and ω_e of each path, and the orders of
//!
//! ```text
//! element e at ō + V(a ω_e) (o_e - ō + a d_e), turned by exp(a [ω_e])     Σ d_e = Σ ω_e = 0
//! u(a) = Σ a^k (Σ_j c_j⁽ᵏ⁾ u_j + φ_k)     φ_k = 0 on the elements
//! ```

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::Assembled;
use super::super::solution::Solution;
use crate::base::slide::slide_matrix;
use crate::fem::dense_fields::combined;
use crate::fem::{NodeFields, RestPoints};
use crate::solve::Progress;
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

/// Turn of two elements against each other at a = 1, rad.
const TURN: f64 = 75.0 * std::f64::consts::PI / 180.0;
/// Largest shift in addition to it, in parts of their distance.
const SLIDE: f64 = 0.08;

/// φ_k from the orders before it.
pub fn bend(
    assembled: &Assembled<'_>,
    points: &RestPoints,
    orders: &[NodeFields],
    progress: &dyn Progress,
) -> Result<NodeFields, GreenError> {
    let loads = points.series_loads(orders).at(&assembled.partition.free);
    let mut fields = NodeFields::zeros(points.nodes, loads.columns);
    assembled.partition.insert_free(&(assembled.solve)(&loads, progress)?, &mut fields);
    Ok(fields)
}

/// Bytes of `fields` fields for each path, and of the next order's loads, solution and solver.
pub fn series_memory(nodes: usize, paths: usize, fields: usize) -> f64 {
    24.0 * (nodes * paths * (fields + SOLVING)) as f64
}

/// Fields for each path while one is solved for.
const SOLVING: usize = 6;

/// d_e and ω_e of every element.
pub type Path = Vec<(Vector3<f64>, Vector3<f64>)>;

/// Number of paths, `for_each` for each coordinate of the elements' relative motion.
pub fn path_count(elements: usize, for_each: usize) -> usize {
    for_each * 6 * elements.saturating_sub(1)
}

/// The paths for each coordinate of the elements' relative motion, in directions that fill its space evenly, the same in
/// every run.
pub fn paths(solution: &Solution, for_each: usize) -> Vec<Path> {
    let elements = solution.controls.len();
    let origins: Vec<Vector3<f64>> = solution.controls.iter().map(|control| control.origin).collect();
    let distance = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm();
    let pairs = |of: &[Vector3<f64>]| -> f64 {
        of.iter().flat_map(|a| of.iter().map(move |b| distance(a, b))).fold(0.0, f64::max)
    };
    let reach = pairs(&origins);
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut apart = |largest: f64| -> Vec<Vector3<f64>> {
        let some: Vec<Vector3<f64>> = (0..elements).map(|_| random.in_ball()).collect();
        let mean = some.iter().sum::<Vector3<f64>>() / elements as f64;
        let some: Vec<Vector3<f64>> = some.iter().map(|one| one - mean).collect();
        let scale = largest / pairs(&some).max(f64::MIN_POSITIVE);
        some.iter().map(|one| one * scale).collect()
    };
    let count = path_count(elements, for_each);
    (0..count)
        .map(|path| {
            // Every other path turns alone, the others slide by all sizes.
            let share = if path % 2 == 0 { 0.0 } else { (path as f64 + 0.5) / count as f64 };
            apart(SLIDE * reach * share.cbrt()).into_iter().zip(apart(TURN)).collect()
        })
        .collect()
}

/// Marsaglia's xorshift, for directions alone.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn in_ball(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::new(self.next(), self.next(), self.next());
            if v.norm() <= 1.0 {
                return v;
            }
        }
    }
}

/// Σ_j c_j⁽ᵏ⁾ u_j of every path.
pub fn lifted_order(solution: &Solution, paths: &[Path], k: usize) -> NodeFields {
    let controls = &solution.controls;
    let mean = controls.iter().map(|control| control.origin).sum::<Vector3<f64>>() / controls.len() as f64;
    let mut c = DMatrix::zeros(FIELDS * controls.len(), paths.len());
    for (column, path) in paths.iter().enumerate() {
        for (e, (slide, turn)) in path.iter().enumerate() {
            let own = screw_order(&(controls[e].origin - mean), slide, turn, k);
            c.view_mut((FIELDS * e, column), (FIELDS, 1)).copy_from(&own);
        }
    }
    combined(&solution.fields, &c)
}

/// An element's motion with arm v at the end of a screw: T = V(ω)(v + d) - v, M = exp \[ω\].
pub fn screw_motion(
    arm: &Vector3<f64>,
    slide: &Vector3<f64>,
    turn: &Vector3<f64>,
) -> (Vector3<f64>, Matrix3<f64>) {
    (slide_matrix(turn) * (arm + slide) - arm, *Rotation3::from_scaled_axis(*turn).matrix())
}

/// The coefficients of an element's affine motion at a^k, with arm v: T = V(a ω)(v + a d) - v, M = exp(a \[ω\]).
fn screw_order(arm: &Vector3<f64>, slide: &Vector3<f64>, turn: &Vector3<f64>, k: usize) -> DVector<f64> {
    // [ω]^n / n!
    let power = |n: usize| (1..=n).fold(Matrix3::identity(), |m, i| m * turn.cross_matrix() / i as f64);
    let translation = power(k) * arm / (k + 1) as f64 + power(k - 1) * slide / k as f64;
    let matrix = power(k).transpose();
    DVector::from_iterator(FIELDS, translation.iter().chain(matrix.iter()).copied())
}
