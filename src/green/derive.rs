//! A .green file after control elements were released or moduli changed, from the one before, without factoring again.
//!
//! In: a file of bodies with the family `updates`, and the scene as it is now. Out: a file in memory of the same surfaces, with
//! the columns and the handle stiffness that a new precomputation would find ([`super::update`]).

use super::control::FIELDS;
use super::error::GreenError;
use super::families::{
    AFFINE, COMPLIANCE, COMPRESSED, FAMILIES, KEPT_FACTOR, LOAD_COMPLIANCE, LOADS, MOMENTS, REACTION,
    STIFFNESS, TORQUES, UPDATES, affine_tensors, load_tensors,
};
use super::file::{BodyMeta, GreenFile};
use super::requirements::Requirements;
use super::tensor::Tensor;
use super::update::{Change, Updated};
use crate::base::columns::{ColumnGroup, StoredColumns};
use crate::scene::Scene;
use nalgebra::DMatrix;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The sections of effects of a changed body, by their names within it.
pub type Sections<'a> = &'a dyn Fn(&GreenFile, &str) -> Vec<(String, Tensor)>;

/// The families that are found again after a change.
pub fn is_derived(family: &str) -> bool {
    let known = [AFFINE, STIFFNESS, UPDATES, LOADS, COMPLIANCE, COMPRESSED, KEPT_FACTOR];
    known.iter().any(|known| known.name == family)
}

/// The file of `scene` as it is now, from that of [`Scene::as_prepared`]. Errors where nothing holds a body any more.
pub fn derive(base: Arc<GreenFile>, scene: &Scene, sections: Sections<'_>) -> Result<GreenFile, GreenError> {
    let mut changed = BTreeMap::new();
    for (name, body) in scene.body.iter().filter(|(_, body)| body.is_updated()) {
        let damaged = |what: &str| GreenError::Damaged {
            path: base.path.clone(),
            reason: format!("{what} of the body {name} is missing"),
        };
        let meta = base.meta.bodies.get(name).ok_or_else(|| damaged("the description"))?;
        let updates = base.updates(name).ok_or_else(|| damaged("the family updates"))?;
        let stiffness = base.stiffness(name).ok_or_else(|| damaged("the handle stiffness"))?;
        let is_released = |e: &usize| !body.control.contains_key(&meta.controls[*e].name);
        let released = (0..meta.controls.len()).filter(is_released).collect();
        let change = Change { released, factors: body.modulus_factors() };
        let changed_body = updates.prepare(&change).ok_or_else(|| {
            let loose: Vec<&str> = body.updates.iter().flat_map(|updates| updates.loose()).collect();
            let message = format!(
                "without {} nothing holds the body any more: let it hold again, or release another control element",
                loose.join(", ")
            );
            scene.invalid(&format!("body.{name}.updates"), message)
        })?;
        let hessian = hessian(&base, name, stiffness);
        let (mut own, mut tensors) = derived(&base, name, meta, changed_body.body(&hessian));
        if own.requirements.has(COMPRESSED) {
            // It is changed number by number.
            own.requirements = own.requirements.without(COMPRESSED).and(Requirements::of(&[COMPLIANCE]));
            own.compressed = None;
        }
        if let Some(compliance) = base.compliance(name) {
            let loose = meta.controls.iter().filter(|control| !body.control.contains_key(&control.name));
            let freed: Vec<u32> =
                loose.flat_map(|control| base.control(name, &control.name)).copied().collect();
            own.compliance_nodes = Some(compliance.taking(&freed));
            tensors.extend(compliance.changed(&freed, &changed_body)?);
        }
        tensors.extend(sections(&base, name));
        changed.insert(name.clone(), (own, tensors));
    }
    base.with_bodies(changed)
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

/// What the file says of a changed body, and its tensors but for those of effects.
fn derived(
    base: &GreenFile,
    name: &str,
    meta: &BodyMeta,
    after: Updated,
) -> (BodyMeta, BTreeMap<String, Tensor>) {
    let surface = meta.surface_nodes;
    let mut own = meta.clone();
    own.requirements = meta.requirements.without(UPDATES);
    own.controls = after.kept.iter().map(|&e| meta.controls[e].clone()).collect();
    own.accuracy.asymmetry = Some(after.asymmetry);
    own.accuracy.storage_error = 0.0;
    own.fingerprint = format!("{} changed", meta.fingerprint);
    let controls = own.controls.iter().map(|control| format!("control/{}", control.name));
    let same = ["rest", "triangles", "tags"].into_iter().map(str::to_owned).chain(controls);
    let mut tensors: BTreeMap<String, Tensor> =
        same.filter_map(|of| Some((of.clone(), base.tensor(name, &of)?))).collect();
    let summed = |before: ColumnGroup<'_>, first: usize, count: usize| {
        let column = |k: usize| -> Vec<f64> {
            let added = after.added.column(first + k);
            (0..3 * surface).map(|row| f64::from(before.value(surface, k, row)) + added[row]).collect()
        };
        StoredColumns::new(meta.accuracy.storage, &(0..count).map(column).collect::<Vec<_>>())
    };
    for (at, control) in own.controls.iter_mut().enumerate() {
        let stored = summed(base.basis(name, &control.name), FIELDS * at, FIELDS);
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
        let stored = summed(base.load_columns(name), n, loads);
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        tensors.extend(load_tensors(surface, meta.accuracy.storage, stored));
    }
    debug_assert!(
        FAMILIES.iter().filter(|entry| own.requirements.has(entry.family)).all(|e| is_derived(e.family.name))
    );
    (own, tensors)
}
