//! A .green file after control elements were released or moduli changed, from the one before.
//!
//! In: a file, and the scene as it is now. Out: a file in memory of the same surfaces, with the numbers that a new precomputation
//! finds: of a body with the family `updates` without factoring again ([`super::update`]), of the others by solving anew.
//!
//! [`error`] measures how inexact a body is after a change that was not solved for anew ([`super::update`]).

use super::acting::acting;
use super::basis::precompute_kept;
use super::bytes::Tensor;
use super::check::refuse;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::{
    COMPLIANCE, COMPRESSED, FAMILIES, LOAD_COMPLIANCE, MOMENTS, REACTION, STIFFNESS, TORQUES, UPDATES,
    affine_tensors, load_tensors,
};
use super::family::FamilyEntry;
use super::file::{BodyMeta, GreenFile};
use super::judge::judge;
use super::kept::Keeping;
use super::prepare::{Fits, prepare};
use super::requirements::Requirements;
use super::update::{Change, ChangedSystem, Updated, Updates};
use super::write::contents;
use crate::base::columns::StoredColumns;
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::extent::bounding_box;
use crate::base::progress::{Progress, Teller};
use crate::base::random::Random;
use crate::scene::{Body, Scene};
use crate::solve::find_method;
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The sections of effects of a changed body, by their names within it.
pub type Sections<'a> = &'a dyn Fn(&GreenFile, &str) -> Vec<(String, Tensor)>;

/// Knowledge of other rooms about a changed body.
pub struct Changes<'a> {
    pub sections: Sections<'a>,
    /// The judgement of its model.
    pub fits: &'a dyn Fn(&str) -> Option<Fits>,
}

/// An update may be wrong by this part; where it is by more, the body is solved anew.
const EXACT: f64 = 1e-7;
/// Nodes that were let go of whose compliance is looked at.
const PRESSED: usize = 4;

/// The description of a body in a file, and the body's tensors.
type Contents = (BodyMeta, BTreeMap<String, Tensor>);

/// The file of `scene` as it is now, from that of [`Scene::as_prepared`], and what there is to say of its bodies. They pass what
/// a precomputation passes: the check before it, and the judgement of forward error and rigid motions. A body that cannot be
/// updated, or whose update would be too inexact, is solved anew.
pub fn derive(
    base: Arc<GreenFile>,
    scene: &Scene,
    changes: &Changes<'_>,
    teller: Teller<'_>,
) -> Result<(GreenFile, Vec<Diagnostic>), GreenError> {
    let (mut changed, mut notices) = (BTreeMap::new(), Vec::new());
    for (name, body) in scene.body.iter().filter(|(_, body)| body.is_updated()) {
        let prepared = prepare(scene, name)?;
        let mut findings = acting(scene, name, &prepared.mesh, &prepared.controls)?;
        findings.extend(prepared.findings);
        refuse(scene, &findings)?;
        findings.retain(|finding| finding.severity < Severity::Note);
        let (own, mut tensors) = match update(&base, name, body)? {
            Ok(contents) => {
                notices.append(&mut findings);
                contents
            }
            Err(why) => {
                let message =
                    format!("{why}: the body is solved anew, which takes as long as precomputing it");
                notices.push(Diagnostic::new(Severity::Note, format!("body.{name}"), message));
                solved_anew(&base, scene, name, (changes.fits)(name), &*teller(name), &mut notices)?
            }
        };
        tensors.extend((changes.sections)(&base, name));
        changed.insert(name.clone(), (own, tensors));
    }
    Ok((base.with_bodies(changed)?, notices))
}

/// Why a change of a body with these requirements, of a modulus or of what holds it alone, takes a solve anew.
pub fn why_anew(body: &Body, requirements: &Requirements, changes_modulus: bool) -> Option<String> {
    let is_lost = |entry: &&FamilyEntry| requirements.has(entry.family) && !entry.is_derived;
    let of_family = |entry: &FamilyEntry| {
        format!("the family {} cannot be found from the columns before the change", entry.family.name)
    };
    FAMILIES.iter().find(is_lost).map(of_family).or_else(|| body.why_anew(changes_modulus))
}

/// A body by its family `updates`; or why not.
fn update(base: &GreenFile, name: &str, body: &Body) -> Result<Result<Contents, String>, GreenError> {
    let damaged = |what: &str| GreenError::Damaged {
        path: base.path.clone(),
        reason: format!("{what} of the body {name} is missing"),
    };
    let meta = base.meta.bodies.get(name).ok_or_else(|| damaged("the description"))?;
    let factors = body.modulus_factors();
    let changes_modulus = factors.iter().any(|factor| *factor != 1.0);
    if let Some(why) = why_anew(body, &meta.requirements, changes_modulus) {
        return Ok(Err(why));
    }
    let updates = base.updates(name).ok_or_else(|| damaged("the family updates"))?;
    let stiffness = base.stiffness(name).ok_or_else(|| damaged("the handle stiffness"))?;
    let is_released = |e: &usize| !body.control.contains_key(&meta.controls[*e].name);
    let released = (0..meta.controls.len()).filter(is_released).collect();
    let change = Change { released, factors };
    let Some(changed_body) = updates.prepare(&change) else {
        return Ok(Err("updated, its columns have no digit left".to_owned()));
    };
    let hessian = hessian(base, name, stiffness);
    let after = changed_body.body(&hessian);
    let columns = columns_after(base, name, meta, &after);
    let loose = meta.controls.iter().filter(|control| !body.control.contains_key(&control.name));
    let freed: Vec<u32> = loose.flat_map(|control| base.control(name, &control.name)).copied().collect();
    let compliance = base.compliance(name);
    let measure = Measure {
        columns: &columns,
        hessian: &hessian,
        reach: reach(base.rest(name)),
        pressed: if compliance.is_some() { &freed[..freed.len().min(PRESSED)] } else { &[] },
        residual: meta.accuracy.residual,
    };
    let error = error(&updates, &change, &changed_body, &after, &measure);
    if error > EXACT || error.is_nan() {
        return Ok(Err(format!(
            "updated, its columns or forces could be wrong by a part of {error:.1e}, above {EXACT:.0e}"
        )));
    }
    let affine = FIELDS * after.kept.len();
    let s = after.hessian.view((0, 0), (affine, affine)).into_owned();
    let (mut own, mut tensors) = derived(base, name, meta, after, &columns);
    own.accuracy.forward_error = Some(own.accuracy.forward_error.map_or(error, |before| before.max(error)));
    let value = |row: usize, column: usize| columns[(row, column)];
    let rigid = base.rigid_motion_of(name, &own.controls, &value, Some(&s));
    let method = find_method(&own.accuracy.solver).unwrap_or_default();
    if !judge(name, method, own.accuracy.forward_error, &rigid).is_ok_and(|findings| findings.is_empty()) {
        return Ok(Err("updated, it would not pass the check of rigid motions".to_owned()));
    }
    if own.requirements.has(COMPRESSED) {
        // It is changed number by number.
        own.requirements = own.requirements.without(COMPRESSED).and(Requirements::new(&[COMPLIANCE]));
        own.compressed = None;
    }
    if let Some(compliance) = compliance {
        own.compliance_nodes = Some(compliance.taking(&freed));
        tensors.extend(compliance.changed(&freed, &changed_body)?);
    }
    Ok(Ok((own, tensors)))
}

/// A body as a precomputation of the scene as it is now finds it, but for what no update of it needs.
fn solved_anew(
    base: &GreenFile,
    scene: &Scene,
    name: &str,
    fits: Option<Fits>,
    progress: &dyn Progress,
    notices: &mut Vec<Diagnostic>,
) -> Result<Contents, GreenError> {
    let before = base.meta.bodies.get(name);
    let requirements = before.map(|meta| meta.requirements.without(UPDATES)).unwrap_or_default();
    let mut body = precompute_kept(scene, name, &requirements, fits, None, Keeping::default(), progress)?;
    body.fingerprint = before.map(changed_fingerprint).unwrap_or_default();
    notices.append(&mut body.solution.notices);
    let (meta, tensors) = contents(&body);
    Ok((meta, tensors.into_iter().collect()))
}

/// A fingerprint of no scene: a changed body is never taken for one that was precomputed.
fn changed_fingerprint(before: &BodyMeta) -> String {
    format!("{} changed", before.fingerprint)
}

/// Half the extent of a body, m.
fn reach(rest: &[[f32; 3]]) -> f64 {
    let nodes: Vec<Vector3<f64>> = rest.iter().map(|&place| Vector3::from(place.map(f64::from))).collect();
    let (low, high) = bounding_box(&nodes);
    0.5 * (high - low).norm()
}

/// The columns of the control elements that still hold, then those of loads, on the surface.
fn columns_after(base: &GreenFile, name: &str, meta: &BodyMeta, after: &Updated) -> DMatrix<f64> {
    let (surface, affine) = (meta.surface_nodes, FIELDS * after.kept.len());
    let groups: Vec<_> = after.kept.iter().map(|&e| base.basis(name, &meta.controls[e].name)).collect();
    let mut columns = after.added.clone();
    for column in 0..affine {
        let (group, field) = (&groups[column / FIELDS], column % FIELDS);
        for row in 0..3 * surface {
            columns[(row, column)] += f64::from(group.value(surface, field, row));
        }
    }
    columns
}

/// The Hessian of V = ½ cᵀS c - λᵀRᵀc - ½ λᵀC λ by the coefficients c of the control elements and λ of the loads.
fn hessian(base: &GreenFile, name: &str, stiffness: DMatrix<f64>) -> DMatrix<f64> {
    let (Some(r), Some(c)) = (base.table(name, REACTION), base.table(name, LOAD_COMPLIANCE)) else {
        return stiffness;
    };
    let (n, loads) = (stiffness.nrows(), c.nrows());
    let mut all = DMatrix::zeros(n + loads, n + loads);
    all.view_mut((0, 0), (n, n)).copy_from(&stiffness);
    all.view_mut((0, n), (n, loads)).copy_from(&-&r);
    all.view_mut((n, 0), (loads, n)).copy_from(&-r.transpose());
    all.view_mut((n, n), (loads, loads)).copy_from(&-c);
    all
}

/// The description of a changed body, and its tensors but for those of effects.
fn derived(
    base: &GreenFile,
    name: &str,
    meta: &BodyMeta,
    after: Updated,
    columns: &DMatrix<f64>,
) -> Contents {
    let surface = meta.surface_nodes;
    let mut own = meta.clone();
    own.requirements = meta.requirements.without(UPDATES);
    own.controls = after.kept.iter().map(|&e| meta.controls[e].clone()).collect();
    own.accuracy.asymmetry = Some(after.asymmetry);
    own.accuracy.storage_error = 0.0;
    own.accuracy.scaled_condition = None;
    own.fingerprint = changed_fingerprint(meta);
    let controls = own.controls.iter().map(|control| format!("control/{}", control.name));
    let same = ["rest", "triangles", "tags"].into_iter().map(str::to_owned).chain(controls);
    let mut tensors: BTreeMap<String, Tensor> =
        same.filter_map(|of| Some((of.clone(), base.tensor(name, &of)?))).collect();
    let stored = |first: usize, count: usize| {
        let columns: Vec<Vec<f64>> =
            (first..first + count).map(|k| columns.column(k).as_slice().to_vec()).collect();
        StoredColumns::new(meta.accuracy.storage, &columns)
    };
    for (at, control) in own.controls.iter_mut().enumerate() {
        let stored = stored(FIELDS * at, FIELDS);
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        control.storage_errors.clone_from(&stored.errors);
        tensors.extend(affine_tensors(&control.name, surface, meta.accuracy.storage, stored));
    }
    let mut table = |name: &str, of: DMatrix<f64>| {
        tensors.insert(name.to_owned(), Tensor::new(&[of.ncols(), of.nrows()], of.iter().copied()));
    };
    let (n, loads) = (FIELDS * after.kept.len(), meta.load_columns());
    table(STIFFNESS.name, after.hessian.view((0, 0), (n, n)).into_owned());
    if loads > 0 {
        table(REACTION, -after.hessian.view((0, n), (n, loads)));
        table(LOAD_COMPLIANCE, -after.hessian.view((n, n), (loads, loads)));
        if let Some((torques, moments)) = base.table(name, TORQUES).zip(base.table(name, MOMENTS)) {
            let of = |&e: &usize| 3 * FIELDS * e..3 * FIELDS * (e + 1);
            let first = 3 * FIELDS * meta.controls.len();
            let rows: Vec<usize> = after.kept.iter().flat_map(of).chain(first..torques.nrows()).collect();
            table(TORQUES, torques.select_rows(&rows) + &after.torques);
            table(MOMENTS, moments);
        }
        let stored = stored(n, loads);
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        tensors.extend(load_tensors(surface, meta.accuracy.storage, stored));
    }
    debug_assert!(FAMILIES.iter().all(|entry| entry.is_derived || !own.requirements.has(entry.family)));
    (own, tensors)
}

/// The error of a displacement that was solved for in f64, as a part of the largest of its field.
const FIELD: f64 = 1e-15;
/// A row of the handle stiffness below this part of the largest number in it is rounding, as of a rigid motion of the only
/// control element that holds.
const ROUNDING: f64 = 1e-6;

/// Numbers on which an update is compared.
pub struct Measure<'a> {
    /// The columns of control elements and loads on the surface after the change.
    pub columns: &'a DMatrix<f64>,
    /// The Hessian before the change ([`ChangedSystem::body`]).
    pub hessian: &'a DMatrix<f64>,
    /// Half the body's extent, m: it makes a displacement of a unit field that is not a shift.
    pub reach: f64,
    /// Nodes of the surface whose compliance is compared.
    pub pressed: &'a [u32],
    /// Relative residual with which the body was solved.
    pub residual: f64,
}

/// The largest relative error of the columns, the handle stiffness and the compliance of `after`, which `changed` made;
/// infinite where no digit is left.
///
/// A change of many decades, or one that leaves little to hold the body, takes the difference of large numbers, whose errors
/// no residual of the small dense system shows. So the change is made a second time with numbers that differ at random by as
/// much as they may be wrong; the difference of the results is the error (J. Vignes, Mathematics and Computers in Simulation
/// 35, 1993, 233-261).
pub fn error(
    updates: &Updates,
    change: &Change,
    changed: &ChangedSystem<'_>,
    after: &Updated,
    measure: &Measure<'_>,
) -> f64 {
    let disturbed = disturbed(updates, measure.residual.max(FIELD));
    let Some(again) = disturbed.prepare(change) else { return f64::INFINITY };
    let other = again.body(measure.hessian);
    let columns = relative(&after.added, &other.added, measure.columns);
    let hessian = of_hessian(&after.hessian, &other.hessian, FIELDS * after.kept.len(), measure.reach);
    let [yields, others] = [changed, &again].map(|changed| changed.compliance(measure.pressed));
    [columns, hessian, relative(&yields, &others, &yields), after.asymmetry].into_iter().fold(0.0, larger)
}

/// Displacements off by [`FIELD`], forces by `part` of the largest of their field.
fn disturbed(updates: &Updates, part: f64) -> Updates {
    let mut random = Random::default();
    let mut disturb = |table: &mut DMatrix<f64>, part: f64| {
        for mut column in table.column_iter_mut() {
            let size = 2.0 * part * column.amax();
            column.iter_mut().for_each(|value| *value += size * random.draw());
        }
    };
    let mut other = updates.clone();
    disturb(&mut other.values, FIELD);
    disturb(&mut other.columns, FIELD);
    disturb(&mut other.reactions, part);
    disturb(&mut other.work, part);
    other.ports.regions.iter_mut().for_each(|region| disturb(&mut region.stiffness, part));
    other
}

fn larger(most: f64, value: f64) -> f64 {
    if value > most || value.is_nan() { value } else { most }
}

fn part(difference: f64, of: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / of }
}

/// The largest difference in a column, as a part of the largest number of that column of `all`.
fn relative(a: &DMatrix<f64>, b: &DMatrix<f64>, all: &DMatrix<f64>) -> f64 {
    let columns = a.column_iter().zip(b.column_iter()).zip(all.column_iter());
    columns.map(|((a, b), all)| part((a - b).amax(), all.amax())).fold(0.0, larger)
}

/// Largest difference of forces: S row by row, reactions to loads column by column, and the work of loads on each other as a part
/// of that which each does by itself.
fn of_hessian(a: &DMatrix<f64>, b: &DMatrix<f64>, affine: usize, reach: f64) -> f64 {
    let scale = |i: usize| if i < affine && i % FIELDS >= 3 { 1.0 / reach } else { 1.0 };
    let scaled =
        |h: &DMatrix<f64>| DMatrix::from_fn(h.nrows(), h.ncols(), |i, j| h[(i, j)] * scale(i) * scale(j));
    let (a, b) = (scaled(a), scaled(b));
    let difference = &a - &b;
    let s = |of: &DMatrix<f64>| -> DMatrix<f64> { of.view((0, 0), (affine, affine)).into() };
    let (own, off) = (s(&a), s(&difference));
    let least = ROUNDING * own.amax();
    let rows = (0..affine).map(|i| part(off.row(i).amax(), own.row(i).amax().max(least)));
    let reaction = |of: &DMatrix<f64>, j: usize| of.view((0, j), (affine, 1)).amax();
    let loads = || affine..a.ncols();
    let reactions = loads().map(|j| part(reaction(&difference, j), reaction(&a, j)));
    let of_pair = |i: usize, j: usize| part(difference[(i, j)].abs(), (a[(i, i)] * a[(j, j)]).abs().sqrt());
    let work = loads().flat_map(|i| loads().map(move |j| (i, j))).map(|(i, j)| of_pair(i, j));
    rows.chain(reactions).chain(work).fold(0.0, larger)
}
