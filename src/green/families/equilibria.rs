//! Equilibria of a body whose two control elements are turned far against each other: what a basis of few fields must hold.
//!
//! In: an assembled body with its affine fields u_k, and a law. Out: for each equilibrium that was found, w = u - Σ c_k u_k seen
//! from the middle between the elements, so that w = 0 on them, over √(2 V): ½ wᵀKw is then a part of that equilibrium's energy V. The
//! wrenches on the elements go into the file with the coefficients ([`KnownEquilibrium`]), so that a model can be compared with them.
//!
//! The elements go along screws, as in [`screw_paths`](super::screw_paths): turned by up to 90° about the axes and the diagonals
//! of a cube that stands along the way between them, pulled, pressed, and turned and shifted at once in random directions. Twists go on to
//! 330°, or to where the body buckles. A step that fails is halved, most often where the body is pressed much; where it buckles before
//! 90°, it gives way to a side. Under St. Venant–Kirchhoff's law a state in which a tetrahedron is inside out is no equilibrium, for
//! nothing resists that; the neo-Hookean law resists it.

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::Assembled;
use super::super::solution::Solution;
use super::found::{self, Found, Known};
use super::screw_paths::{Path, screw_motion};
use crate::base::machine;
use crate::base::random::Random;
use crate::base::teams::each_in_teams;
use crate::fem::dense_fields::{add, beside, combined};
use crate::fem::{Hyperelastic, Law, NodeFields, Partition};
use crate::solve::{Equilibrium, LinearSolver, Newton, Progress, SolveError, Solver};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
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
const RANDOM: usize = 24;
/// More such paths, of which no field is made: a model is only compared with them.
const HELD_OUT: usize = 4;
/// Shares of a path at which equilibria are sought.
const STEPS: [f64; 2] = [0.5, 1.0];
/// Shares of a twist, which goes on to 330°, a little less than the whole turn up to which a mean frame is defined.
const TWIST_STEPS: [f64; 6] = [0.5, 1.0, 1.75, 2.5, 3.1, 3.67];
/// Share of a path at which a motion is small: a turn by 3.6°.
const SMALL: f64 = 0.04;
/// The least step is this part of the way between two of them; and this where a tetrahedron has less than half of its volume, for such a
/// body snaps soon, and its forces change fast before.
const LEAST_STEP: f64 = 0.25;
const LEAST_STEP_PRESSED: f64 = 1.0 / 16.0;
const PRESSED_VOLUME: f64 = 0.5;
/// A body that buckles does so while every tetrahedron has more than this part of its volume; one with a smaller one is about to
/// turn that inside out instead.
const BUCKLES: f64 = 0.8;
/// Newton's iteration ends after a step below this part of the largest displacement: of fields for a basis no more is asked.
const LAST_STEP: f64 = 3e-4;
/// Unknowns up to which a body is solved so often, with about 300 factorisations.
pub const MOST_UNKNOWNS: usize = 100_000;

/// The equilibria of a body, and the small motions at the beginning of their paths.
pub struct Equilibria {
    /// A column for each equilibrium.
    pub fields: NodeFields,
    /// c of each, column by column, and V.
    pub coefficients: DMatrix<f64>,
    pub energies: Vec<f64>,
    /// Whether a tetrahedron is turned inside out in it, as in no real body.
    pub inverted: Vec<bool>,
    /// Beginnings of the paths.
    pub small: Vec<SmallMotion>,
    /// Paths, and how many of them have an equilibrium at their end.
    pub paths: [usize; 2],
    /// The table of [`KnownEquilibrium`]s, those of paths without fields too.
    pub known: DMatrix<f64>,
}

/// Kind of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathKind {
    Turned,
    /// Pulled or pressed, almost without a turn.
    Stretched,
    /// Turned in a random direction and shifted.
    Mixed,
    /// Turned and shifted likewise, but no field is made of it.
    HeldOut,
}

impl PathKind {
    const ALL: [PathKind; 4] = [PathKind::Turned, PathKind::Stretched, PathKind::Mixed, PathKind::HeldOut];
}

/// An equilibrium as the file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownEquilibrium {
    pub kind: PathKind,
    /// Coefficients of both elements.
    pub coefficients: [f64; 2 * FIELDS],
    /// Force, N, and moment about its place, N·m, of each element.
    pub wrenches: [[Vector3<f64>; 2]; 2],
    /// V, J.
    pub energy: f64,
    /// Whether a tetrahedron is turned inside out.
    pub is_inverted: bool,
}

/// Numbers of a [`KnownEquilibrium`]: a column of the table.
pub const KNOWN: usize = 2 * FIELDS + 2 * 6 + 3;

impl KnownEquilibrium {
    fn numbers(&self) -> Vec<f64> {
        let kind = PathKind::ALL.iter().position(|kind| *kind == self.kind).unwrap_or(0);
        let wrenches = self.wrenches.iter().flatten().flat_map(|part| part.iter().copied());
        let rest = [self.energy, kind as f64, f64::from(u8::from(self.is_inverted))];
        self.coefficients.iter().copied().chain(wrenches).chain(rest).collect()
    }

    /// Reads a column of the table; `None` where it is of another length.
    pub fn read(numbers: &[f64]) -> Option<KnownEquilibrium> {
        let (coefficients, rest) = numbers.split_first_chunk()?;
        let (wrenches, &[energy, kind, is_inverted]) = rest.split_first_chunk::<12>()? else { return None };
        let part = |of: usize| Vector3::from_column_slice(&wrenches[3 * of..3 * of + 3]);
        Some(KnownEquilibrium {
            kind: *PathKind::ALL.get(kind as usize)?,
            coefficients: *coefficients,
            wrenches: [[part(0), part(1)], [part(2), part(3)]],
            energy,
            is_inverted: is_inverted != 0.0,
        })
    }
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

/// c at the steps of all paths, and where their motions are small.
pub fn motions(solution: &Solution) -> DMatrix<f64> {
    let paths = directions(solution);
    let of = |(path, _, steps): &DirectedPath| {
        let shares = std::iter::once(SMALL).chain(steps.iter().copied());
        shares.map(|share| seen(solution, path, share).column(0).into_owned()).collect::<Vec<_>>()
    };
    DMatrix::from_columns(&paths.iter().flat_map(of).collect::<Vec<_>>())
}

/// The equilibria of a body; `None` where [`has_equilibria`] says no, and where none was found.
pub fn equilibria(
    (law, model): (&'static Law, &str),
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
    let usual = 2 * paths.iter().map(|(_, _, steps)| steps.len()).sum::<usize>();
    // Of the fields: as they are found, side by side, what the others miss of them, and its forces; of two tangents: K, A and factor.
    let fields = 4.0 * 24.0 * (usual * solution.mesh.nodes.len()) as f64;
    let tangents = 2.0 * (24.0 * assembled.k.scalar_entries() as f64 + solver.memory(&a, 1));
    let needed = |teams: usize| fields + teams as f64 * tangents;
    // Of the memory that is left, no more than half for speed alone.
    let is_spare = |teams: &usize| machine::fits("", 2.0 * needed(*teams), 0.0).is_ok();
    let teams = (2..=rayon::current_num_threads()).rev().find(is_spare).unwrap_or(1);
    machine::expect(format!("the equilibria of the model \"{model}\""), needed(teams))
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    drop(a);
    let walk = Walk {
        body: &body,
        partition: assembled.partition,
        solver: solver.as_ref(),
        last_step: LAST_STEP,
        law,
        solution,
    };
    let key = assembled.caching.and_then(|_| found::key(law, assembled, solution));
    let identity = || key;
    let mut earlier = Known::open(assembled.caching, key, &identity, solution.mesh.nodes.len());
    let there = earlier.count(paths.len());
    if there > 0 {
        progress.tell(&format!("resumes: the equilibria on {there} of {} paths were there", paths.len()));
    }
    let (mut fields, mut coefficients) = (Vec::new(), Vec::new());
    let (mut energies, mut inverted) = (Vec::new(), Vec::new());
    let (mut small, mut whole, mut known) = (Vec::new(), 0, Vec::new());
    let found = walk.on_all(&paths, &mut earlier, teams, progress).map_err(failed)?;
    for ((path, kind, _), found) in paths.iter().zip(found) {
        let of = |share: f64| seen(solution, path, share);
        known.extend(found.iter().map(|found| known_equilibrium(*kind, &of(found.share), found)));
        if *kind == PathKind::HeldOut {
            continue;
        }
        whole += usize::from(found.last().is_some_and(|found| found.share >= 1.0));
        small.extend(found.first().map(|found| SmallMotion {
            coefficients: of(SMALL),
            equilibrium: fields.len(),
            times: found.share / SMALL,
        }));
        for found in found {
            inverted.push(found.is_inverted);
            let (c, mut own) = (of(found.share), found.u);
            add(&mut own, -1.0, &combined(&solution.fields, &c));
            let size = (2.0 * found.energy).max(f64::MIN_POSITIVE).sqrt();
            own.data.iter_mut().for_each(|value| *value /= size);
            fields.push(own);
            coefficients.push(c);
            energies.push(found.energy);
        }
    }
    earlier.finish();
    let fields: Vec<&NodeFields> = fields.iter().collect();
    Ok((!fields.is_empty()).then(|| Equilibria {
        fields: beside(&fields),
        coefficients: DMatrix::from_fn(coefficients[0].nrows(), energies.len(), |row, at| {
            coefficients[at][row]
        }),
        energies,
        inverted,
        small,
        paths: [paths.len() - HELD_OUT, whole],
        known: DMatrix::from_columns(&known),
    }))
}

/// A path, its kind, and the shares of it at which equilibria are sought.
type DirectedPath = (Path, PathKind, &'static [f64]);

/// The way along paths from rest.
struct Walk<'a> {
    body: &'a Hyperelastic,
    partition: &'a Partition,
    solver: &'a dyn LinearSolver,
    last_step: f64,
    law: &'static Law,
    solution: &'a Solution,
}

impl Walk<'_> {
    /// The equilibria on each path, several paths at a time; those that are known are not sought, the others become known.
    fn on_all(
        &self,
        paths: &[DirectedPath],
        known: &mut Known<'_>,
        teams: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<Found>>, SolveError> {
        progress.begin("equilibria at large turns", paths.len() as u64);
        let mut all: Vec<Option<Vec<Found>>> = (0..paths.len()).map(|number| known.on(number)).collect();
        let sought: Vec<usize> = (0..paths.len()).filter(|number| all[*number].is_none()).collect();
        progress.advance((paths.len() - sought.len()) as u64);
        let mut failure = None;
        let job = |at: usize| {
            let (path, _, steps) = &paths[sought[at]];
            let found = self.equilibria_on(path, steps)?.into_iter();
            let of = |(share, found)| {
                of_equilibrium(self.solution, &seen(self.solution, path, share), share, found)
            };
            Ok(found.map(of).collect::<Vec<Found>>())
        };
        each_in_teams(teams, sought.len(), job, |at, found| {
            match found {
                Ok(found) => {
                    known.keep(sought[at], &found);
                    all[sought[at]] = Some(found);
                }
                Err(error) => failure = Some(error),
            }
            progress.advance(1);
        });
        progress.end();
        match failure {
            Some(failure) => Err(failure),
            None => Ok(all.into_iter().flatten().collect()),
        }
    }

    fn newton(&self) -> Newton<'_> {
        let Walk { body, partition, solver, last_step, .. } = *self;
        Newton { body, partition, solver: Some(solver), loads: None, last_step }
    }

    /// The equilibria on a path as far as they are found, each with its share of it: at `steps`, and where a step was halved.
    fn equilibria_on(&self, path: &Path, steps: &[f64]) -> Result<Vec<(f64, Equilibrium)>, SolveError> {
        let (mut found, mut from, mut before) = (Vec::<(f64, Equilibrium)>::new(), 0.0, 0.0);
        let mut tangent = None;
        let rest = NodeFields::zeros(self.solution.mesh.nodes.len(), 1);
        for goal in steps {
            let way = goal - before;
            let mut step = way;
            while from < *goal {
                // The last steps share what is left, so that none is a sliver.
                let share = if goal - from <= step * (1.0 + 1e-9) { *goal } else { from + step };
                let last = found.last().map(|(_, last)| last);
                let u = last.map_or(&rest, |last| &last.u);
                let volume = last.map_or(1.0, least_volume);
                let is_pressed = volume > 0.0 && volume < PRESSED_VOLUME;
                let least = if is_pressed { LEAST_STEP_PRESSED } else { LEAST_STEP };
                let held = |_: f64, u: &mut NodeFields| hold(self.solution, path, share, u);
                let mut next = self.newton().step_to(u, &mut tangent, &held)?;
                if next.as_ref().is_some_and(|next| !self.is_sound(next)) {
                    (next, tangent) = (None, None);
                }
                if next.is_none() && 0.5 * step >= least * way {
                    step *= 0.5;
                    continue;
                }
                if next.is_none() && share <= 1.0 && volume > BUCKLES {
                    tangent = None;
                    next = self.aside(path, [from, share], u)?;
                }
                let Some(next) = next else { return Ok(found) };
                found.push((share, next));
                from = share;
            }
            before = *goal;
        }
        Ok(found)
    }

    /// The stable state to which a body gives way that buckles.
    fn aside(
        &self,
        path: &Path,
        [from, to]: [f64; 2],
        u: &NodeFields,
    ) -> Result<Option<Equilibrium>, SolveError> {
        let moved = seen(self.solution, path, to) - seen(self.solution, path, from);
        let mut guess = u.clone();
        add(&mut guess, 1.0, &combined(&self.solution.fields, &moved));
        hold(self.solution, path, to, &mut guess);
        Ok(self.newton().settle_near(guess)?.filter(|found| self.is_sound(found)))
    }

    /// Whether a state is an equilibrium of the law.
    fn is_sound(&self, found: &Equilibrium) -> bool {
        self.law.resists_inversion || !is_inverted(found)
    }
}

/// Whether a tetrahedron is turned inside out.
fn is_inverted(found: &Equilibrium) -> bool {
    least_volume(found) <= 0.0
}

/// The least volume of a tetrahedron, as a part of that at rest.
fn least_volume(found: &Equilibrium) -> f64 {
    let volumes = found.gradients.iter().map(|h| (Matrix3::identity() + h).determinant());
    volumes.fold(f64::INFINITY, f64::min)
}

/// The paths with their steps: half of each motion to either element.
fn directions(solution: &Solution) -> Vec<DirectedPath> {
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
    let moved = (0..RANDOM + HELD_OUT).map(|number| {
        let turn = Vector3::from_fn(|_, _| draw()).try_normalize(1e-3).unwrap_or_else(Vector3::x);
        let kind = if number < RANDOM { PathKind::Mixed } else { PathKind::HeldOut };
        (path([0.025 + 0.075 * draw(), 0.1 * draw(), 0.1 * draw()], along(turn.into())), kind)
    });
    let turned = turned.map(|path| (path, PathKind::Turned));
    let stretched = pressed.chain([pulled]).map(|path| (path, PathKind::Stretched));
    let of_path =
        |(number, (path, kind))| (path, kind, if number < 2 { &TWIST_STEPS[..] } else { &STEPS[..] });
    turned.chain(stretched).chain(moved).enumerate().map(of_path).collect()
}

/// An equilibrium at a share of a path, with the coefficients c there.
fn of_equilibrium(solution: &Solution, c: &DMatrix<f64>, share: f64, found: Equilibrium) -> Found {
    let vector = |numbers: &[f64]| Vector3::from_column_slice(numbers);
    let wrench = |e: usize| {
        let control = &solution.controls[e];
        let place = control.origin + vector(&c.as_slice()[FIELDS * e..FIELDS * e + 3]);
        control.nodes.iter().fold([Vector3::zeros(); 2], |[force, moment], &node| {
            let own = vector(&found.forces.data[3 * node as usize..][..3]);
            let at = solution.mesh.nodes[node as usize] + vector(&found.u.data[3 * node as usize..][..3]);
            [force + own, moment + (at - place).cross(&own)]
        })
    };
    let (wrenches, is_inverted) = ([wrench(0), wrench(1)], is_inverted(&found));
    Found { share, u: found.u, energy: found.energy, is_inverted, wrenches }
}

/// Record of an equilibrium with the coefficients c in the file.
fn known_equilibrium(kind: PathKind, c: &DMatrix<f64>, found: &Found) -> DVector<f64> {
    let known = KnownEquilibrium {
        kind,
        coefficients: std::array::from_fn(|row| c[row]),
        wrenches: found.wrenches,
        energy: found.energy,
        is_inverted: found.is_inverted,
    };
    DVector::from_vec(known.numbers())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, NEO_HOOKEAN, TET4};
    use crate::green::{self, Requirements};
    use crate::scene::Scene;
    use crate::solve::{Followed, LAST_STEP as EXACT, Silent};

    /// The equilibria of a block on the way to a turn by 90°, and where small steps along its branch lead.
    fn walked(block: &str, turn: Vector3<f64>) -> (Vec<(f64, Equilibrium)>, Followed) {
        let text = format!(
            "[body.b]\ngenerate = {{ block = {block} }}\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\n\
             control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        );
        let scene = Scene::parse(&text, std::path::Path::new("block.toml")).unwrap();
        let solution = green::solve(&scene, "b", &Requirements::new(&[green::AFFINE]), &Silent).unwrap();
        let mesh = &solution.mesh;
        let lame = vec![Lame::from_young_poisson(1.0e6, 0.3); mesh.tets.len()];
        let body = Hyperelastic::new(&TET4, &NEO_HOOKEAN, mesh, &lame).unwrap();
        let held = solution.controls.iter().flat_map(|control| control.nodes.iter().copied());
        let partition = Partition::new(mesh.nodes.len(), held);
        let rest = NodeFields::zeros(mesh.nodes.len(), 1);
        let a = partition.a(&body.tangent(&body.gradients(&rest)));
        let solver = Solver::default().analyse(&a, &Silent).unwrap();
        let walk = Walk {
            body: &body,
            partition: &partition,
            solver: &*solver,
            last_step: EXACT,
            law: &NEO_HOOKEAN,
            solution: &solution,
        };
        let path: Path = [-0.5, 0.5].map(|half| (Vector3::zeros(), turn * (half * TURN))).to_vec();
        let found = walk.equilibria_on(&path, &STEPS).unwrap();
        let way = |share: f64, u: &mut NodeFields| hold(&solution, &path, share, u);
        (found, walk.newton().follow(rest, 24, &way, &Silent).unwrap())
    }

    /// A plate that is bent in its own plane buckles out of it: the state at the end of the way is the one to which small steps lead.
    #[test]
    fn a_plate_that_is_bent_in_its_plane_goes_on_buckled() {
        let (found, known) = walked("{ size = [0.24, 0.24, 0.02], cells = [6, 6, 1] }", Vector3::z());
        let (share, last) = found.last().unwrap();
        let out_of_plane =
            |of: &Equilibrium| of.u.data.iter().skip(2).step_by(3).fold(0.0_f64, |a, z| a.max(z.abs()));
        let [own, expected] = [last, &known.equilibrium].map(|of| (of.energy, out_of_plane(of)));
        println!("share {share}, {own:?} and {expected:?}, passed {}", known.passed.len());
        assert!(*share == 1.0 && expected.1 > 0.02, "{share} {expected:?}");
        assert!(
            (own.0 / expected.0 - 1.0).abs() < 0.01 && (own.1 / expected.1 - 1.0).abs() < 0.05,
            "{own:?}"
        );
    }

    /// A compact body that is bent across its diagonal goes on in small steps where long ones lose it.
    #[test]
    fn a_compact_body_is_followed_in_small_steps() {
        let block = "{ size = [1.0, 1.0, 1.0], cells = [6, 6, 6] }";
        let (found, known) = walked(block, Vector3::new(0.0, 1.0, 1.0).normalize());
        let (share, last) = found.last().unwrap();
        let [own, expected] = [last, &known.equilibrium].map(|of| of.energy);
        println!("followed to {share}; {own} and {expected} J");
        assert!(*share == 1.0 && (own / expected - 1.0).abs() < 1e-12, "{share}: {own} and {expected} J");
    }
}
