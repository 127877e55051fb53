//! Equilibria of a body whose two control elements are turned far against each other: what a basis of few fields must hold.
//!
//! In: an assembled body with its affine fields u_k. Out: for each equilibrium that was found under the St. Venant–Kirchhoff
//! law, w = u - Σ c_k u_k seen from the middle between the elements, so that w = 0 on them, over √(2 V): ½ wᵀKw is then a part of
//! that equilibrium's energy V.
//!
//! The elements go along screws, as in [`screw_paths`](super::screw_paths): turned by up to 90° about the axes and the diagonals
//! of a cube that stands along the way between them, pressed, and turned and shifted at once in random directions. A state in which
//! a tetrahedron is inside out is no equilibrium. Twists go on to 330°. Where the end of a path has none, that at three quarters of it is taken, and that
//! at a quarter where the half has none.

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::Assembled;
use super::super::solution::Solution;
use super::dense_fields::{add, beside, combined};
use super::screw_paths::{Path, screw_motion};
use crate::base::machine;
use crate::base::random::Random;
use crate::fem::{Hyperelastic, NodeFields, STVK};
use crate::solve::{Newton, Progress};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Turn of the elements against each other at the end of a path, rad.
const TURN: f64 = FRAC_PI_2;
/// Turns in parts of [`TURN`] about the way and two directions across it, with which a body is pressed by a tenth: a slender one buckles
/// to a side.
const PRESSED: [[f64; 3]; 4] = [[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, -0.1]];
/// Paths in random directions, the same in every run, with random shifts: along the way between a twentieth less and a tenth more of
/// it, across it by up to a tenth.
const RANDOM: usize = 12;
/// Shares of a path at which equilibria are sought, and that which is tried in place of one that has none.
const STEPS: [[f64; 2]; 2] = [[0.5, 0.25], [1.0, 0.75]];
/// Those of a twist, which goes on to 330°: the last turn but a little that a mean frame has.
const TWIST_STEPS: [[f64; 2]; 6] =
    [[0.5, 0.25], [1.0, 0.75], [1.75, 1.5], [2.5, 2.25], [3.1, 2.8], [3.67, 3.4]];
/// Newton's iteration ends after a step below this part of the largest displacement: of fields for a basis no more is asked.
const LAST_STEP: f64 = 3e-3;
/// Unknowns up to which a body is solved so often, with about 300 factorisations.
const MOST_UNKNOWNS: usize = 100_000;

/// What was found.
pub struct Equilibria {
    /// A column for each equilibrium.
    pub fields: NodeFields,
    /// Paths, and how many of them have an equilibrium at their end.
    pub paths: [usize; 2],
}

/// The equilibria of a body with two control elements; `None` for others, where nothing is free, and where there are more than
/// [`MOST_UNKNOWNS`] or they are not solved for directly.
pub fn equilibria(
    assembled: &Assembled<'_>,
    solution: &Solution,
    progress: &dyn Progress,
) -> Result<Option<Equilibria>, GreenError> {
    let unknowns = 3 * assembled.partition.free.len();
    let is_direct = assembled.body.solver.method.is_direct;
    if solution.controls.len() != 2 || unknowns == 0 || unknowns > MOST_UNKNOWNS || !is_direct {
        return Ok(None);
    }
    let failed = |source| GreenError::Solve { body: assembled.place.to_owned(), source };
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let body = Hyperelastic::new(solution.element, &STVK, &solution.mesh, assembled.lame).map_err(unfit)?;
    let a = assembled.partition.a(assembled.k);
    let solver = assembled.body.solver.analyse(&a, progress).map_err(failed)?;
    let paths = directions(solution);
    let most: usize = paths.iter().map(|(_, steps)| steps.len()).sum();
    // Of the fields: as they are found, side by side, what the others miss of them, and its forces; of the tangent: K and A.
    let need =
        4.0 * 24.0 * (most * solution.mesh.nodes.len()) as f64 + 24.0 * assembled.k.scalar_entries() as f64;
    machine::expect("the equilibria of the model \"reduced\"", need + solver.memory(&a, 1))
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    drop(a);
    let newton = Newton {
        body: &body,
        partition: assembled.partition,
        solver: Some(solver.as_ref()),
        loads: None,
        last_step: LAST_STEP,
    };
    let (mut fields, mut whole) = (Vec::new(), 0);
    progress.begin("equilibria at large turns", paths.len() as u64);
    for (path, steps) in &paths {
        let (mut u, mut from) = (NodeFields::zeros(solution.mesh.nodes.len(), 1), 0.0);
        for step in *steps {
            for &share in step {
                let goal = |_: f64, u: &mut NodeFields| hold(solution, path, share, u);
                let found = if share > from { newton.step_to(&u, &goal).map_err(failed)? } else { None };
                let upright = |h: &Matrix3<f64>| (Matrix3::identity() + h).determinant() > 0.0;
                let Some(found) = found.filter(|found| found.gradients.iter().all(upright)) else { continue };
                let mut own = found.u.clone();
                add(&mut own, -1.0, &combined(&solution.fields, &coefficients(solution, path, share)));
                let size = (2.0 * found.energy).max(f64::MIN_POSITIVE).sqrt();
                own.data.iter_mut().for_each(|value| *value /= size);
                fields.push(own);
                (u, from) = (found.u, share);
                break;
            }
        }
        progress.advance(1);
        whole += usize::from(from >= 1.0);
    }
    progress.end();
    let fields: Vec<&NodeFields> = fields.iter().collect();
    Ok((!fields.is_empty()).then(|| Equilibria { fields: beside(&fields), paths: [paths.len(), whole] }))
}

/// The paths with their steps: half of each motion to either element.
fn directions(solution: &Solution) -> Vec<(Path, &'static [[f64; 2]])> {
    let way = solution.controls[1].origin - solution.controls[0].origin;
    let axis = way.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
    let lateral = axis.cross(&across);
    let along = |[i, j, k]: [f64; 3]| axis * i + across * j + lateral * k;
    let path = |shift: [f64; 3], turn: Vector3<f64>| -> Path {
        let shift = along(shift) * way.norm();
        [-0.5, 0.5].map(|half| (shift * half, turn * (half * TURN))).to_vec()
    };
    let signs = [1.0, -1.0];
    // The first two are twists.
    let axes = (0..3).flat_map(|axis| signs.map(|sign| Vector3::ith(axis, sign)));
    let diagonals =
        signs.iter().flat_map(|i| signs.iter().flat_map(move |j| signs.map(|k| Vector3::new(*i, *j, k))));
    let turned = axes.chain(diagonals).map(|turn| path([0.0; 3], along(turn.normalize().into())));
    let pressed = PRESSED.iter().map(|turn| path([-0.1, 0.0, 0.0], along(*turn)));
    let mut random = Random::default();
    let mut draw = || 2.0 * random.draw();
    let moved = (0..RANDOM).map(|_| {
        let turn = Vector3::from_fn(|_, _| draw()).try_normalize(1e-3).unwrap_or_else(Vector3::x);
        path([0.025 + 0.075 * draw(), 0.1 * draw(), 0.1 * draw()], along(turn.into()))
    });
    let of_path = |(number, path)| (path, if number < 2 { &TWIST_STEPS[..] } else { &STEPS[..] });
    turned.chain(pressed).chain(moved).enumerate().map(of_path).collect()
}

/// Writes the displacements of the controlled nodes at a share of the path.
fn hold(solution: &Solution, path: &Path, share: f64, u: &mut NodeFields) {
    for (e, control) in solution.controls.iter().enumerate() {
        let (translation, matrix) = motion(solution, path, share, e);
        let gradient = matrix - Matrix3::identity();
        for &node in &control.nodes {
            let moved = translation + gradient * (solution.mesh.nodes[node as usize] - control.origin);
            u.data[3 * node as usize..][..3].copy_from_slice(moved.as_slice());
        }
    }
}

/// c at a share of the path.
fn coefficients(solution: &Solution, path: &Path, share: f64) -> DMatrix<f64> {
    let mut c = DMatrix::zeros(FIELDS * solution.controls.len(), 1);
    for e in 0..solution.controls.len() {
        let (translation, matrix) = motion(solution, path, share, e);
        let gradient = (matrix - Matrix3::identity()).transpose();
        let own = translation.iter().chain(gradient.iter());
        c.rows_mut(FIELDS * e, FIELDS).iter_mut().zip(own).for_each(|(c, value)| *c = *value);
    }
    c
}

fn motion(solution: &Solution, path: &Path, share: f64, e: usize) -> (Vector3<f64>, Matrix3<f64>) {
    let count = solution.controls.len() as f64;
    let middle = solution.controls.iter().map(|control| control.origin).sum::<Vector3<f64>>() / count;
    let (slide, turn) = path[e];
    screw_motion(&(solution.controls[e].origin - middle), &(slide * share), &(turn * share))
}
