//! A .green file after control elements were released or moduli changed, from the one before, without factoring again.
//!
//! In: a file of bodies with the family `updates`, and the scene as it is now. Out: a file in memory of the same surfaces, with
//! the columns and the handle stiffness that a new precomputation would find ([`super::update`]).

use super::control::FIELDS;
use super::error::GreenError;
use super::families::{AFFINE, FAMILIES, STIFFNESS, UPDATES, affine_tensors};
use super::file::{BodyMeta, GreenFile};
use super::tensor::Tensor;
use super::update::{Change, Updated};
use crate::base::columns::StoredColumns;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The sections of effects of a changed body, by their names within it.
pub type Sections<'a> = &'a dyn Fn(&GreenFile, &str) -> Vec<(String, Tensor)>;

/// The families that are found again after a change.
pub fn is_derived(family: &str) -> bool {
    [AFFINE, STIFFNESS, UPDATES].iter().any(|known| known.name == family)
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
        let after = updates.apply(&change, &stiffness).ok_or_else(|| {
            let loose: Vec<&str> = body.updates.iter().flat_map(|updates| updates.loose()).collect();
            let message = format!(
                "without {} nothing holds the body any more: let it hold again, or release another control element",
                loose.join(", ")
            );
            scene.invalid(&format!("body.{name}.updates"), message)
        })?;
        let (own, mut tensors) = derived(&base, name, meta, after);
        tensors.extend(sections(&base, name));
        changed.insert(name.clone(), (own, tensors));
    }
    base.with_bodies(changed)
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
    for (at, control) in own.controls.iter_mut().enumerate() {
        let before = base.basis(name, &control.name);
        let column = |k: usize| -> Vec<f64> {
            let added = after.added.column(FIELDS * at + k);
            (0..3 * surface).map(|row| f64::from(before.value(surface, k, row)) + added[row]).collect()
        };
        let stored = StoredColumns::new(meta.accuracy.storage, &(0..FIELDS).map(column).collect::<Vec<_>>());
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        control.storage_errors.clone_from(&stored.errors);
        tensors.extend(affine_tensors(&control.name, surface, meta.accuracy.storage, stored));
    }
    let s = after.stiffness;
    tensors.insert(STIFFNESS.name.to_owned(), Tensor::new(&[s.ncols(), s.nrows()], s.iter().copied()));
    debug_assert!(
        FAMILIES.iter().filter(|entry| own.requirements.has(entry.family)).all(|e| is_derived(e.family.name))
    );
    (own, tensors)
}
