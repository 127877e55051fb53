//! The family `reduced`: fields that a body bends into beyond the affine ones, and its energy as a quartic in all of them.
//!
//! In: the affine fields u_k of E ≤ 4 control elements. Out: `reduced/basis`, fields Φ that vanish on the control elements,
//! and `reduced/quartic`, the strain energy of Σ c_k u_k + Φ q under the St. Venant–Kirchhoff law ([`QuarticShape`]). Φ is
//! chosen from the power series of equilibria along [`screw_paths`](super::screw_paths): the main part of all φ_2, then that of
//! all φ_3. Of two elements the φ_2 span the 21 second derivatives of the equilibrium by their relative motion, and all are kept (J.
//! Barbič, D. James, ACM Transactions on Graphics 24, 2005, 982-990, use the same with vibration modes); in place of φ_3 stand the
//! main parts of [`equilibria`](super::equilibria) at large turns, where the body is small enough to be solved for them: a proper
//! orthogonal decomposition, as many as leave at most 10⁻⁵ of the energy of each, or 10⁻³ where that takes more than 48. Equilibria with
//! tetrahedra inside out count a tenth, and nothing is asked of them. Main parts are those of the energy norm.
//!
//! The family `reduced_neo_hookean` has the same for the neo-Hookean law: fields from its equilibria, and in place of the quartic
//! `reduced/volume`, cubics of which the energy is a sum of squares ([`RestPoints::volume_forms`]), with the few
//! [pressures](mod@super::pressures) that the equilibria have. `reduced/points` has the fields' gradients where the equilibria are
//! pressed most: there a body is inside out first.
//!
//! A body with loads has more fields: what each column of them does at rest, and as many of the second order that motions and loads
//! have together. `reduced/loads` then has the work of the loads, `reduced/warmth` what warmth changes of the energy:
//!
//! ```text
//! x = m (z_0 (X - ō) + Σ z_k h_k)    W = Σ_i f_i · x_i:  Σ_i f_i, then Σ_i f_i ⊗ h_k(i) column by column for each z
//! zᵀ T z = ∫ (3λ + 2μ) tr E    T_00 = 3 ∫ (3λ + 2μ)
//! ```
//!
//! The cubics of a body that may be warm have one more variable instead, of the field X - ō.

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile, LoadMeta, Turning};
use super::super::lift::Lift;
use super::super::prepare::Prepared;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::affine::AFFINE;
use super::columns::{self, Names};
use super::equilibria::{Equilibria, KNOWN, MOST_UNKNOWNS, equilibria, has_equilibria, motions};
use super::loads::{answers, column_forces};
use super::pressures::{self, MOST_PRESSURES, States, gradients, pressures};
use super::screw_paths::{bend, lifted_order, path_count, paths, series_memory};
use super::table;
use crate::base::columns::ColumnGroup;
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::machine;
use crate::fem::dense_fields::{add, beside, combined, principal, products, split_columns, without};
use crate::fem::{CubicShape, Law, NEO_HOOKEAN, NodeFields, QuarticShape, RestPoints, STVK, StiffnessMatrix};
use crate::scene::Body;
use crate::solve::Progress;
use nalgebra::{DMatrix, DVector, Vector3};

pub const REDUCED: Family = Family { name: "reduced", from: &[AFFINE] };
pub const REDUCED_NEO_HOOKEAN: Family = Family { name: "reduced_neo_hookean", from: &[AFFINE] };

/// Table of the energy's coefficients.
pub const QUARTIC: &str = "reduced/quartic";
/// Cubics of the neo-Hookean law, a row for each, and gradients of the fields at some points, a column for each point.
pub const VOLUME_FORMS: &str = "reduced/volume";
pub const PRESSED_POINTS: &str = "reduced/points";
/// The work of loads, 3 (1 + 3 n) × K for n numbers z; and T, n × n, of a body that may be warm.
pub const REDUCED_LOADS: &str = "reduced/loads";
pub const WARMTH: &str = "reduced/warmth";
/// Equilibria of a body with the wrenches that hold it: a [`KnownEquilibrium`](super::equilibria::KnownEquilibrium) in each column.
pub const EQUILIBRIA: &str = "reduced/equilibria";
/// Φ over all nodes, until it is written.
pub const FIELDS_TABLE: &str = "reduced/fields";

fn names() -> Names {
    Names { basis: "reduced/basis".to_owned(), scale: "reduced/scale".to_owned() }
}

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: REDUCED,
    holds: "fields into which the body bends, and the strain energy as a quartic in all fields",
    suits: Some(suits),
    compute: Some(|assembled, solution, progress| compute(&STVK, assembled, solution, progress)),
    solves: true,
    write,
    check,
    groups,
    fixed_bytes: |control_elements| 8 * QuarticShape { variables: most_variables(control_elements) }.len(),
    is_derived: false,
    column_names: None,
};

pub(super) const NEO_HOOKEAN_ENTRY: FamilyEntry = FamilyEntry {
    family: REDUCED_NEO_HOOKEAN,
    suits: Some(suits_neo_hookean),
    holds: "fields into which the body bends, and the strain energy in all fields: squares of cubics",
    compute: Some(|assembled, solution, progress| compute(&NEO_HOOKEAN, assembled, solution, progress)),
    check: check_neo_hookean,
    fixed_bytes: |control_elements| {
        let variables = most_variables(control_elements);
        8 * (1 + MOST_PRESSURES) * CubicShape { variables }.len() + 8 * MOST_POINTS * 9 * variables
    },
    ..ENTRY
};

/// Numbers z of a body of so many control elements.
fn most_variables(control_elements: usize) -> usize {
    1 + Lift::new(control_elements).len() + most_fields(control_elements)
}

/// Control elements that a body may have: the coefficients grow with the fourth power of their number. At four there are
/// about 0.9 million, read in about 1 ms.
const MOST_ELEMENTS: usize = 4;

/// Fields Φ of a body of so many control elements at most: what the time of a force tick allows.
fn most_fields(control_elements: usize) -> usize {
    if control_elements == 2 { 64 } else { series_fields(control_elements) }
}

/// Fields Φ from series about rest alone.
fn series_fields(control_elements: usize) -> usize {
    match control_elements {
        0 | 1 => 0,
        2 => 33,
        3 => 24,
        _ => 20,
    }
}

/// The part of these that is of second order: of two elements 21, one for each pair of the coordinates of their relative motion.
const SECOND_ORDER_PART: f64 = 0.65;
/// Part of the energy of an equilibrium that the fields may miss: of [`FEW_FIELDS`], and of more, which cost twice the time.
const MISSED: f64 = 1e-5;
const MISSED_BY_MANY: f64 = 1e-3;
const FEW_FIELDS: usize = 48;
/// Weight of a small motion beside an equilibrium where pressures are chosen.
const SMALL_WEIGHT: f64 = 10.0;
/// Weight of equilibria in which a tetrahedron is inside out, where fields and pressures are chosen and more than a tenth of all are so:
/// with as much as the others have, what these bend into at a few nodes would take the place of fields that the others need.
const INVERTED_WEIGHT: f64 = 0.1;
const MANY_INVERTED: f64 = 0.1;
/// Displacement in parts of the body's length at which what a load does is a small strain.
const LITTLE: f64 = 1e-5;
/// Points that a body of the neo-Hookean law watches at most: one for each state.
const MOST_POINTS: usize = 256;
/// Paths for each coordinate of the elements' relative motion.
const PATHS: usize = 8;

fn suits(place: &str, body: &Body, prepared: &Prepared) -> Result<(), GreenError> {
    let count = prepared.controls.len();
    if count > MOST_ELEMENTS {
        let model = REDUCED.name;
        return Err(GreenError::ControlCount { body: place.to_owned(), model, count, allowed: "1 to 4" });
    }
    let unfit = |source| GreenError::Assembly { body: place.to_owned(), source };
    RestPoints::suits(body.element, &prepared.mesh).map_err(unfit)
}

/// Refuses bodies without equilibria, from which the points are chosen.
fn suits_neo_hookean(place: &str, body: &Body, prepared: &Prepared) -> Result<(), GreenError> {
    let model = REDUCED_NEO_HOOKEAN.name;
    let count = prepared.controls.len();
    if count != 2 {
        return Err(GreenError::ControlCount { body: place.to_owned(), model, count, allowed: "2" });
    }
    suits(place, body, prepared)?;
    let mut held: Vec<u32> =
        prepared.controls.iter().flat_map(|control| control.nodes.iter().copied()).collect();
    held.sort_unstable();
    held.dedup();
    let unknowns = 3 * (prepared.mesh.nodes.len() - held.len());
    if unknowns == 0 || has_equilibria(&body.solver, count, unknowns) {
        return Ok(());
    }
    Err(GreenError::NoEquilibria { body: place.to_owned(), model, unknowns, most: MOST_UNKNOWNS })
}

fn compute(
    law: &'static Law,
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let elements = solution.controls.len();
    let points = RestPoints::new(solution.element, &solution.mesh, assembled.lame).map_err(unfit)?;
    let forces = column_forces(assembled, &solution.mesh)?;
    let expect = |what: &str, bytes: f64| {
        machine::expect(what, bytes)
            .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })
    };
    let series = memory_of_series(points.nodes, elements, forces.len());
    let model = if law.name == STVK.name { REDUCED.name } else { REDUCED_NEO_HOOKEAN.name };
    expect(&format!("the fields of the model \"{model}\""), series)?;
    let equilibria = equilibria((law, model), assembled, solution, progress)?;
    // A body of which none are sought is refused by `suits_neo_hookean`.
    if law.name != STVK.name && equilibria.is_none() && !assembled.partition.free.is_empty() {
        return Err(GreenError::NoneFound { body: assembled.place.to_owned(), model });
    }
    let mut basis = basis(assembled, solution, &points, equilibria.is_none(), progress)?;
    if let Some(equilibria) = &equilibria {
        basis = enriched(assembled, solution, &basis, equilibria);
        solution.tables.insert(EQUILIBRIA, equilibria.known.clone());
    }
    let (basis, loaded) = with_loads(assembled, solution, &points, &forces, basis, progress)?;

    let lift = Lift::new(elements);
    let lifted = combined(&solution.fields, &lift.columns);
    // In the order of the coordinates (1, y of undeformed elements, q, the other y).
    let (first, others) = split_columns(&lifted, lift.rigid);
    let all = beside(&[&first, &basis, &others]);
    if law.name == STVK.name {
        let needed = memory_of_quartic(points.nodes, elements, basis.columns);
        expect("the energy of the model \"reduced\"", needed)?;
        progress.begin("quartic energy", points.count() as u64);
        let coefficients = points.quartic(&all, &|units| progress.advance(units));
        progress.end();
        solution.tables.insert(QUARTIC, DMatrix::from_vec(coefficients.len(), 1, coefficients));
    } else {
        let states = states(assembled, solution, equilibria.as_ref(), &loaded);
        let needed = pressures::memory(points.count(), states.u.columns) + memory_of_forms(all.columns);
        expect("the energy of the model \"reduced_neo_hookean\"", needed)?;
        write_forms(assembled, solution, &points, &all, &states, progress);
    }
    if !forces.is_empty() {
        solution.loads = assembled.body.loads().iter().map(LoadMeta::new).collect();
        let turnings =
            || solution.loads.iter().flat_map(|load| std::iter::repeat_n(load.turning, load.columns));
        let work = work_of_loads(solution, &forces, &all, turnings());
        let is_warm = law.name == STVK.name && turnings().any(|turning| turning == Turning::Inner);
        let warmth = is_warm.then(|| warmth(&points, &all));
        solution.tables.insert(REDUCED_LOADS, work);
        solution.tables.extend(warmth.map(|warmth| (WARMTH, warmth)));
    }
    let fields = DMatrix::from_row_slice(3 * basis.nodes, basis.columns, &basis.data);
    solution.tables.insert(FIELDS_TABLE, fields);
    Ok(())
}

/// States from which the pressures are chosen: the equilibria with weight 1, less where those with tetrahedra inside out are many, and
/// small motions and what each load does at rest with more, so that they are met more closely.
fn states(
    assembled: &Assembled<'_>,
    solution: &Solution,
    equilibria: Option<&Equilibria>,
    loaded: &NodeFields,
) -> States {
    let Some(equilibria) = equilibria else {
        // Nothing is free.
        let u = combined(&solution.fields, &motions(solution));
        return States { weights: vec![1.0; u.columns], u };
    };
    let loaded = little(assembled, solution, loaded);
    let small = &equilibria.small;
    let count = equilibria.energies.len();
    let c = DMatrix::from_fn(equilibria.coefficients.nrows(), count + small.len(), |row, state| match state
        .checked_sub(count)
    {
        None => equilibria.coefficients[(row, state)],
        Some(state) => small[state].coefficients[row],
    });
    // w of an equilibrium in its own size; that of a small motion is of second order.
    let sizes = DMatrix::from_fn(count, count + small.len(), |field, state| {
        let (own, size) = match state.checked_sub(count) {
            None => (state, 1.0),
            Some(state) => (small[state].equilibrium, small[state].times.powi(-2)),
        };
        if own == field { size * (2.0 * equilibria.energies[own]).sqrt() } else { 0.0 }
    });
    let mut u = combined(&solution.fields, &c);
    add(&mut u, 1.0, &combined(&equilibria.fields, &sizes));
    let u = beside(&[&u, &loaded]);
    let weights =
        weights(&equilibria.inverted).into_iter().chain(std::iter::repeat_n(SMALL_WEIGHT, u.columns - count));
    States { weights: weights.collect(), u }
}

/// Displacements by loads, so little of them that it is a small strain; of warmth without the growth that needs no stress.
fn little(assembled: &Assembled<'_>, solution: &Solution, loaded: &NodeFields) -> NodeFields {
    let metas: Vec<LoadMeta> = assembled.body.loads().iter().map(LoadMeta::new).collect();
    let turnings = metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns));
    let mut little = loaded.clone();
    for (column, turning) in (0..loaded.columns).zip(turnings) {
        let (mut most, mut length) = (0.0_f64, 0.0_f64);
        for (node, x) in solution.mesh.nodes.iter().enumerate() {
            for axis in 0..3 {
                let place = (3 * node + axis) * loaded.columns + column;
                if turning == Turning::Inner {
                    little.data[place] -= x[axis];
                }
                most = most.max(little.data[place].abs());
                length = length.max((x[axis] - solution.mesh.nodes[0][axis]).abs());
            }
        }
        let share = if most > 0.0 { LITTLE * length / most } else { 0.0 };
        little.data.iter_mut().skip(column).step_by(loaded.columns).for_each(|u| *u *= share);
    }
    little
}

/// Leaves the cubics and the points in the solution.
fn write_forms(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    points: &RestPoints,
    fields: &NodeFields,
    states: &States,
    progress: &dyn Progress,
) {
    progress.begin("energy of volume", points.count() as u64);
    let chosen = pressures(points, states);
    let is_warm = assembled.body.loads().iter().map(LoadMeta::new).any(|load| load.turning == Turning::Inner);
    let forms = match is_warm {
        true => {
            let data = solution.mesh.nodes.iter().flat_map(|x| x.iter().copied()).collect();
            let size = NodeFields { nodes: points.nodes, columns: 1, data };
            points.volume_forms(&beside(&[fields, &size]), &chosen.weights, &|units| progress.advance(units))
        }
        false => points.volume_forms(fields, &chosen.weights, &|units| progress.advance(units)),
    };
    progress.end();
    let message = format!(
        "{} pressures miss at most {:.1e} of the energy of {} states",
        chosen.weights.ncols(),
        chosen.missed,
        states.weights.iter().filter(|weight| **weight >= 1.0).count()
    );
    solution.notices.push(Diagnostic::new(Severity::Note, format!("body.{}.model", assembled.name), message));
    let watched = &chosen.pressed[..chosen.pressed.len().min(MOST_POINTS)];
    solution.tables.insert(PRESSED_POINTS, gradients(points, fields, watched));
    solution.tables.insert(VOLUME_FORMS, forms);
}

/// Bytes beside the body of the orders on all paths while the next one is solved for.
fn memory_of_series(nodes: usize, elements: usize, loads: usize) -> f64 {
    let fields = most_fields(elements) + 2 * loads;
    24.0 * (nodes * fields) as f64 + series_memory(nodes, path_count(elements, PATHS) + loads * loads, 2)
}

/// Bytes beside the body of the quartic in `fields` fields, whose products of pairs stand in panels and as a whole, with its fields and
/// the strains of a block of points.
fn memory_of_quartic(nodes: usize, elements: usize, fields: usize) -> f64 {
    let lift = Lift::new(elements).len();
    let pairs = QuarticShape { variables: 1 + lift + fields }.pairs() as f64;
    24.0 * (nodes * (2 * fields + 3 * lift)) as f64 + 12.5 * pairs * pairs + 8.0 * 768.0 * pairs
}

/// Bytes of the cubics in `fields` fields: as they are summed, together and as a tensor; and of a block of points.
fn memory_of_forms(fields: usize) -> f64 {
    8.0 * (3 * (1 + MOST_PRESSURES) + 32) as f64 * CubicShape { variables: 2 + fields }.len() as f64
}

/// Φ from the series about rest over all nodes, orthonormal in the energy of small displacements: the fields of second order, and of
/// third where these are asked for.
fn basis(
    assembled: &Assembled<'_>,
    solution: &Solution,
    points: &RestPoints,
    with_third: bool,
    progress: &dyn Progress,
) -> Result<NodeFields, GreenError> {
    let most = series_fields(solution.controls.len());
    let paths = paths(solution, PATHS);
    if most == 0 || paths.is_empty() || assembled.partition.free.is_empty() {
        return Ok(NodeFields::zeros(points.nodes, 0));
    }
    let of_second_order = (SECOND_ORDER_PART * most as f64).round() as usize;
    progress.begin("fields of second order", 0);
    let first = lifted_order(solution, &paths, 1);
    let second = bend(assembled, points, std::slice::from_ref(&first), progress)?;
    let main = principal(assembled.k, &second, of_second_order);
    progress.end();
    if !with_third {
        return Ok(main);
    }
    progress.begin("fields of third order", 0);
    let mut whole = lifted_order(solution, &paths, 2);
    add(&mut whole, 1.0, &second);
    drop(second);
    // In parts of the energy, so that a path that hardly strains the body counts as much as the others.
    let energies = products(assembled.k, &first, &first).diagonal();
    let scales = DMatrix::from_diagonal(&energies.map(|energy| energy.max(f64::MIN_POSITIVE).sqrt().recip()));
    let third = combined(&bend(assembled, points, &[first, whole], progress)?, &scales);
    let third = without(assembled.k, &third, &main);
    let rest = principal(assembled.k, &third, most - main.columns);
    progress.end();
    Ok(beside(&[&main, &rest]))
}

/// The fields of `main`, then those that `equilibria` have beside them, until each misses less than [`MISSED`] of its energy, or with more
/// than [`FEW_FIELDS`] less than [`MISSED_BY_MANY`], or there are as many as the time of a tick allows.
fn enriched(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    main: &NodeFields,
    equilibria: &Equilibria,
) -> NodeFields {
    let k = assembled.k;
    let weights = weights(&equilibria.inverted);
    let by_weight = DMatrix::from_diagonal(&DVector::from_column_slice(&weights));
    let left = combined(&without(k, &equilibria.fields, main), &by_weight);
    let found = principal(k, &left, most_fields(solution.controls.len()) - main.columns);
    let shares = products(k, &found, &left);
    let mut missed = products(k, &left, &left).diagonal();
    let mut count = 0;
    let allowed = |count: usize| if main.columns + count < FEW_FIELDS { MISSED } else { MISSED_BY_MANY };
    let worst = |missed: &DVector<f64>| {
        let asked = missed.iter().zip(&weights).filter(|(_, weight)| **weight >= 1.0);
        asked.map(|(missed, _)| *missed).fold(f64::EPSILON, f64::max)
    };
    while count < found.columns && worst(&missed) > allowed(count) {
        missed -= shares.row(count).map(|share| share * share).transpose();
        count += 1;
    }
    let basis = beside(&[main, &split_columns(&found, count).0]);
    let [paths, whole] = equilibria.paths;
    let mut message = format!(
        "{} fields reproduce the energy of {} equilibria (bent, twisted and pressed) to within {:.1e}",
        basis.columns,
        weights.iter().filter(|weight| **weight >= 1.0).count(),
        worst(&missed)
    );
    if whole < paths {
        message += &format!(
            "; on {} of {paths} paths no equilibrium was found at 90° or at their end",
            paths - whole
        );
    }
    solution.notices.push(Diagnostic::new(Severity::Note, format!("body.{}.model", assembled.name), message));
    basis
}

/// Weights of equilibria, by whether a tetrahedron is inside out there.
fn weights(inverted: &[bool]) -> Vec<f64> {
    let count = inverted.iter().filter(|inverted| **inverted).count();
    let are_many = count as f64 > MANY_INVERTED * inverted.len() as f64;
    inverted.iter().map(|inverted| if *inverted && are_many { INVERTED_WEIGHT } else { 1.0 }).collect()
}

/// Φ with what loads do: at rest, and in second order beside motions. Then that at rest, a column for each.
fn with_loads(
    assembled: &Assembled<'_>,
    solution: &Solution,
    points: &RestPoints,
    forces: &[Vec<Vector3<f64>>],
    basis: NodeFields,
    progress: &dyn Progress,
) -> Result<(NodeFields, NodeFields), GreenError> {
    if assembled.partition.free.is_empty() || forces.is_empty() {
        return Ok((basis, NodeFields::zeros(points.nodes, 0)));
    }
    progress.begin("fields of loads", 0);
    let k = assembled.k;
    let [_, at_rest] = answers(assembled, points.nodes, forces, progress)?;
    let own = of_unit_energy(k, &at_rest);
    let first = principal(k, &without(k, &own, &basis), forces.len());
    let whole = beside(&[&basis, &first]);
    // Each motion with a mixture of all loads of the same energy, then each load alone and with each other one.
    let moved = lifted_order(solution, &paths(solution, PATHS), 1);
    let moved = of_unit_energy(k, &moved);
    let (motions, loads) = (moved.columns, own.columns);
    let pairs: Vec<(usize, usize)> = (0..loads).flat_map(|i| (i..loads).map(move |j| (i, j))).collect();
    let of_motions =
        DMatrix::from_fn(motions, motions + pairs.len(), |row, column| f64::from(u8::from(row == column)));
    let of_loads =
        DMatrix::from_fn(loads, motions + pairs.len(), |row, column| match column.checked_sub(motions) {
            None => {
                if column % loads == row {
                    1.0
                } else {
                    0.0
                }
            }
            Some(pair) => [pairs[pair].0, pairs[pair].1].iter().filter(|load| **load == row).count() as f64,
        });
    let mut paths = combined(&moved, &of_motions);
    add(&mut paths, 1.0, &combined(&own, &of_loads));
    let second = bend(assembled, points, std::slice::from_ref(&paths), progress)?;
    let second = principal(k, &without(k, &second, &whole), forces.len());
    progress.end();
    Ok((beside(&[&whole, &second]), at_rest))
}

/// Each field with an energy of ½, so that none counts for its unit.
fn of_unit_energy(k: &StiffnessMatrix, fields: &NodeFields) -> NodeFields {
    let energies = products(k, fields, fields).diagonal();
    let scales = energies.map(|energy| if energy > 0.0 { energy.sqrt().recip() } else { 0.0 });
    combined(fields, &DMatrix::from_diagonal(&scales))
}

/// Σ f and Σ f ⊗ h of each column but those of warmth, whose work is that of T; h_0 is X - ō.
fn work_of_loads(
    solution: &Solution,
    forces: &[Vec<Vector3<f64>>],
    fields: &NodeFields,
    turnings: impl Iterator<Item = Turning>,
) -> DMatrix<f64> {
    let count = solution.controls.len().max(1) as f64;
    let middle = solution.controls.iter().map(|control| control.origin).sum::<Vector3<f64>>() / count;
    let mut work = DMatrix::zeros(3 * (1 + 3 * (1 + fields.columns)), forces.len());
    for ((column, forces), turning) in forces.iter().enumerate().zip(turnings) {
        let mut own = work.column_mut(column);
        let nodes = forces.iter().zip(&solution.mesh.nodes).enumerate();
        for (node, (force, x)) in nodes.filter(|_| turning != Turning::Inner) {
            let mut add =
                |slot: usize, by: f64| (0..3).for_each(|axis| own[3 * slot + axis] += force[axis] * by);
            add(0, 1.0);
            for axis in 0..3 {
                add(1 + axis, x[axis] - middle[axis]);
                for (k, u) in fields.row(3 * node + axis).iter().enumerate() {
                    add(1 + 3 * (1 + k) + axis, *u);
                }
            }
        }
    }
    work
}

/// T.
fn warmth(points: &RestPoints, fields: &NodeFields) -> DMatrix<f64> {
    let n = 1 + fields.columns;
    let (mut sum, mut h) = (DMatrix::zeros(n, n), Vec::new());
    for point in (0..points.count()).map(|point| points.at(point)) {
        point.gradients_of(fields, &mut h);
        let bulk = (3.0 * point.lame.lambda + 2.0 * point.lame.mu) * point.volume;
        sum[(0, 0)] += 3.0 * bulk;
        let rows = DMatrix::from_fn(9, fields.columns, |row, k| h[k][row]);
        sum.view_mut((1, 1), (n - 1, n - 1)).gemm_tr(0.5 * bulk, &rows, &rows, 1.0);
        for (k, h) in h.iter().enumerate() {
            sum[(0, 1 + k)] += 0.5 * bulk * h.trace();
            sum[(1 + k, 0)] += 0.5 * bulk * h.trace();
        }
    }
    sum
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let mut tensors = table::write(body, QUARTIC);
    for name in [VOLUME_FORMS, PRESSED_POINTS, EQUILIBRIA, REDUCED_LOADS, WARMTH] {
        tensors.extend(table::write(body, name));
    }
    if !body.solution.loads.is_empty() {
        meta.loads.clone_from(&body.solution.loads);
    }
    if let Some(fields) = body.solution.tables.get(FIELDS_TABLE) {
        let stored = columns::stored(body, fields.ncols(), &|row, column| fields[(row, column)]);
        tensors.extend(columns::write(body.storage, body.solution.surface.nodes.len(), names(), stored));
    }
    tensors
}

/// No file has more columns; their quartic would be 100 million numbers.
const MOST_FIELDS: usize = 128;

/// Fields Φ of a body.
fn fields_in(file: &GreenFile, name: &str) -> usize {
    let basis = format!("{name}/{}", names().basis);
    file.tensors.get(&basis).and_then(|(_, shape, _)| shape.first().copied()).unwrap_or(0)
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let variables = check_fields(file, name, body)?;
    table::check(file, name, QUARTIC, [QuarticShape { variables }.len(), 1])?;
    if body.loads.iter().any(|load| load.turning == Turning::Inner) {
        table::check(file, name, WARMTH, [variables, variables])?;
    }
    Ok(())
}

fn check_neo_hookean(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let variables = check_fields(file, name, body)?;
    let is_warm = body.loads.iter().any(|load| load.turning == Turning::Inner);
    let monomials = CubicShape { variables: variables + usize::from(is_warm) }.len();
    let shape = |table: &str| match file.tensors.get(&format!("{name}/{table}")) {
        Some((_, shape, _)) if shape.len() == 2 => [shape[1], shape[0]],
        _ => [0; 2],
    };
    let ([forms, _], [_, points]) = (shape(VOLUME_FORMS), shape(PRESSED_POINTS));
    if forms > 1 + MOST_PRESSURES || points > MOST_POINTS {
        return Err(format!(
            "tensor {name}/{VOLUME_FORMS} has {forms} forms and {name}/{PRESSED_POINTS} {points} points, more than the {} and \
             {MOST_POINTS} of any body",
            1 + MOST_PRESSURES
        ));
    }
    table::check(file, name, VOLUME_FORMS, [forms, monomials])?;
    table::check(file, name, PRESSED_POINTS, [9 * (variables - 1), points])?;
    Ok(())
}

/// Checks what both laws have; returns the number of variables z.
fn check_fields(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<usize, String> {
    let basis = format!("{name}/{}", names().basis);
    let fields = fields_in(file, name);
    if fields > MOST_FIELDS {
        return Err(format!("tensor {basis} has {fields} columns, more than the {MOST_FIELDS} of any body"));
    }
    columns::check(file, name, &names(), fields)?;
    let variables = 1 + Lift::new(body.controls.len()).len() + fields;
    if !body.loads.is_empty() {
        table::check(file, name, REDUCED_LOADS, [3 * (1 + 3 * variables), body.load_columns()])?;
    }
    if let Some(known) = file.table(name, EQUILIBRIA) {
        table::check(file, name, EQUILIBRIA, [KNOWN, known.ncols()])?;
    }
    Ok(variables)
}

fn groups<'a>(file: &'a GreenFile, body: &str) -> Vec<ColumnGroup<'a>> {
    // One element alone has no such columns.
    let group = columns::group(file, body, &names());
    if group.numbers() == 0 { Vec::new() } else { vec![group] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_inside_out_count_less_where_they_are_many() {
        let [few, many] = [1, 2].map(|count| (0..10).map(|state| state < count).collect::<Vec<_>>());
        assert_eq!(weights(&few), [1.0; 10]);
        let counted = weights(&many);
        assert_eq!((&counted[..2], &counted[2..]), (&[INVERTED_WEIGHT; 2][..], &[1.0; 8][..]));
    }
}
