//! Equilibria of a body whose two control elements are turned far against each other: what a basis of few fields must hold.
//!
//! In: an assembled body with its affine fields u_k, and a law. Out: for each equilibrium that was found, w = u - Σ c_k u_k seen
//! from the middle between the elements, so that w = 0 on them, over √(2 V): ½ wᵀKw is then a part of that equilibrium's energy V.
//!
//! The elements go along screws, as in [`screw_paths`](super::screw_paths): turned by up to 90° about the axes and the diagonals
//! of a cube that stands along the way between them, pulled, pressed, and turned and shifted at once in random directions. Twists go on to
//! 330°. A step that fails is halved. Under St. Venant–Kirchhoff's law a state in which a tetrahedron is inside out is no
//! equilibrium, for nothing resists that; the neo-Hookean law resists it.

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::Assembled;
use super::super::solution::Solution;
use super::screw_paths::{Path, screw_motion};
use crate::base::machine;
use crate::base::random::Random;
use crate::fem::dense_fields::{add, beside, combined};
use crate::fem::{Hyperelastic, Law, NodeFields};
use crate::solve::{Newton, Progress, Solver};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Turn of the elements against each other at the end of a path, rad.
const TURN: f64 = FRAC_PI_2;
/// Turns in parts of [`TURN`] about the way and two directions across it, with which a body is pressed by a tenth: a slender one buckles
/// to a side.
const PRESSED: [[f64; 3]; 4] = [[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, -0.1]];
/// Part of the way by which a body is pulled.
const PULLED: f64 = 0.1;
/// Paths in random directions, the same in every run, with random shifts: along the way between a twentieth less and a tenth more of
/// it, across it by up to a tenth.
const RANDOM: usize = 12;
/// Shares of a path at which equilibria are sought.
const STEPS: [f64; 2] = [0.5, 1.0];
/// Shares of a twist, which goes on to 330°, a little less than the whole turn up to which a mean frame is defined.
const TWIST_STEPS: [f64; 6] = [0.5, 1.0, 1.75, 2.5, 3.1, 3.67];
/// Share of a path at which a motion is small: a turn by 3.6°.
const SMALL: f64 = 0.04;
/// The least step is this part of the way between two of them.
const LEAST_STEP: f64 = 0.25;
/// Newton's iteration ends after a step below this part of the largest displacement: of fields for a basis no more is asked.
const LAST_STEP: f64 = 3e-3;
/// Unknowns up to which a body is solved so often, with about 300 factorisations.
pub const MOST_UNKNOWNS: usize = 100_000;

/// The equilibria of a body, and the small motions at the beginning of their paths.
pub struct Equilibria {
    /// A column for each equilibrium.
    pub fields: NodeFields,
    /// c of each, column by column, and V.
    pub coefficients: DMatrix<f64>,
    pub energies: Vec<f64>,
    /// Beginnings of the paths.
    pub small: Vec<SmallMotion>,
    /// Paths, and how many of them have an equilibrium at their end.
    pub paths: [usize; 2],
}

/// Whether a body of so many control elements and unknowns is solved for them: of two, where something is free, up to
/// 100,000 that are solved for directly.
pub fn has_equilibria(solver: &Solver, control_elements: usize, unknowns: usize) -> bool {
    control_elements == 2 && (1..=MOST_UNKNOWNS).contains(&unknowns) && solver.method.is_direct
}

/// A small motion along a path: c there, and the first equilibrium of the path, which is so many times as far.
pub struct SmallMotion {
    pub coefficients: DMatrix<f64>,
    pub equilibrium: usize,
    pub times: f64,
}

/// The equilibria of a body; `None` where [`has_equilibria`] says no.
pub fn equilibria(
    law: &'static Law,
    assembled: &Assembled<'_>,
    solution: &Solution,
    progress: &dyn Progress,
) -> Result<Option<Equilibria>, GreenError> {
    let unknowns = 3 * assembled.partition.free.len();
    if !has_equilibria(&assembled.body.solver, solution.controls.len(), unknowns) {
        return Ok(None);
    }
    let failed = |source| GreenError::Solve { body: assembled.place.to_owned(), source };
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let body = Hyperelastic::new(solution.element, law, &solution.mesh, assembled.lame).map_err(unfit)?;
    let a = assembled.partition.a(assembled.k);
    let solver = assembled.body.solver.analyse(&a, progress).map_err(failed)?;
    let paths = directions(solution);
    let most = 2 * paths.iter().map(|(_, steps)| steps.len()).sum::<usize>();
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
    let (mut fields, mut coefficients, mut energies) = (Vec::new(), Vec::new(), Vec::new());
    let (mut small, mut whole) = (Vec::new(), 0);
    progress.begin("equilibria at large turns", paths.len() as u64);
    for (path, steps) in &paths {
        let (mut u, mut from, mut before) = (NodeFields::zeros(solution.mesh.nodes.len(), 1), 0.0, 0.0);
        'path: for &goal in *steps {
            let mut step = goal - before;
            let least = LEAST_STEP * step;
            while from < goal {
                let share = goal.min(from + step);
                let held = |_: f64, u: &mut NodeFields| hold(solution, path, share, u);
                let found = newton.step_to(&u, &held).map_err(failed)?;
                let upright = |h: &Matrix3<f64>| (Matrix3::identity() + h).determinant() > 0.0;
                let found =
                    found.filter(|found| law.resists_inversion || found.gradients.iter().all(upright));
                let Some(found) = found else {
                    step *= 0.5;
                    if step < least {
                        break 'path;
                    }
                    continue;
                };
                let c = seen(solution, path, share);
                let mut own = found.u.clone();
                add(&mut own, -1.0, &combined(&solution.fields, &c));
                let size = (2.0 * found.energy).max(f64::MIN_POSITIVE).sqrt();
                own.data.iter_mut().for_each(|value| *value /= size);
                if from == 0.0 {
                    let coefficients = seen(solution, path, SMALL);
                    small.push(SmallMotion { coefficients, equilibrium: fields.len(), times: share / SMALL });
                }
                fields.push(own);
                coefficients.push(c);
                energies.push(found.energy);
                (u, from) = (found.u, share);
            }
            before = goal;
        }
        progress.advance(1);
        whole += usize::from(from >= 1.0);
    }
    progress.end();
    let fields: Vec<&NodeFields> = fields.iter().collect();
    Ok((!fields.is_empty()).then(|| Equilibria {
        fields: beside(&fields),
        coefficients: DMatrix::from_fn(coefficients[0].nrows(), energies.len(), |row, at| {
            coefficients[at][row]
        }),
        energies,
        small,
        paths: [paths.len(), whole],
    }))
}

/// The paths with their steps: half of each motion to either element.
fn directions(solution: &Solution) -> Vec<(Path, &'static [f64])> {
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
    let pulled = path([PULLED, 0.0, 0.0], Vector3::zeros());
    let mut random = Random::default();
    let mut draw = || 2.0 * random.draw();
    let moved = (0..RANDOM).map(|_| {
        let turn = Vector3::from_fn(|_, _| draw()).try_normalize(1e-3).unwrap_or_else(Vector3::x);
        path([0.025 + 0.075 * draw(), 0.1 * draw(), 0.1 * draw()], along(turn.into()))
    });
    let of_path = |(number, path)| (path, if number < 2 { &TWIST_STEPS[..] } else { &STEPS[..] });
    turned.chain(pressed).chain([pulled]).chain(moved).enumerate().map(of_path).collect()
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
fn seen(solution: &Solution, path: &Path, share: f64) -> DMatrix<f64> {
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
