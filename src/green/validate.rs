//! Whether a .green file can be used: its parts fit together, its numbers are numbers, and it belongs to the scene.
//!
//! In: a container that was read. Out: the first fault, by the name of its tensor or field. A hash proves that a file is as it
//! was written, and nothing of who wrote it: nothing that is used later is taken on trust.

use super::control::{FIELD_NAMES, FIELDS};
use super::error::GreenError;
use super::families::FAMILIES;
use super::file::{BodyMeta, ControlMeta, GreenFile};
use super::numbers::{LARGEST, numbers};
use super::requirements::Requirements;
use crate::base::columns::Storage;
use crate::mesh::diagnostics::EXTENT;
use crate::scene::Scene;
use safetensors::tensor::Dtype;
use std::collections::BTreeSet;

/// A solution with a larger relative residual is worse than none: that of x = 0 is 1.
const LARGEST_RESIDUAL: f64 = 1.0;

impl GreenFile {
    /// Errors where body `name` of the scene cannot be shown from this file: where it was made from something else, and
    /// where it is not what its fingerprint says.
    pub fn check_belongs(
        &self,
        scene: &Scene,
        name: &str,
        requirements: &Requirements,
    ) -> Result<(), GreenError> {
        self.check_fresh(name, &super::fingerprint(scene, name, requirements)?)?;
        let (Some(meta), body) = (self.meta.bodies.get(name), &scene.body[name]) else { return Ok(()) };
        let differs = |field: &str, found: String, expected: String| {
            let reason = format!(
                "bodies.{name}.{field} is {found}, the scene's is {expected}, though the fingerprint agrees"
            );
            Err(GreenError::Damaged { path: self.path.clone(), reason })
        };
        let names: Vec<&str> = meta.controls.iter().map(|control| control.name.as_str()).collect();
        let expected: Vec<&str> = body.control.keys().map(String::as_str).collect();
        if names != expected {
            return differs("controls", format!("{names:?}"), format!("{expected:?}"));
        }
        if meta.requirements != *requirements {
            return differs("requirements", meta.requirements.describe(), requirements.describe());
        }
        if meta.element != body.element_name() {
            return differs("element", meta.element.clone(), body.element_name().into());
        }
        if meta.accuracy.storage != body.storage {
            let [found, expected] = [meta.accuracy.storage, body.storage].map(Storage::name);
            return differs("accuracy.storage", found, expected);
        }
        Ok(())
    }

    /// The hash of every tensor, and every body.
    pub(super) fn check(&self) -> Result<(), String> {
        if cfg!(target_endian = "big") {
            return Err("its numbers are little-endian, this machine is not".into());
        }
        if self.tensors.len() != self.meta.blake3.len() {
            return Err("tensors are missing, or there are too many".into());
        }
        for (name, (_, _, range)) in &self.tensors {
            let expected = self.meta.blake3.get(name).ok_or_else(|| format!("tensor {name} has no hash"))?;
            if self.is_on_disk(name) {
                continue;
            }
            let found = blake3::hash(&self.bytes.as_slice()[range.clone()]).to_hex();
            if found.as_str() != expected {
                return Err(format!(
                    "tensor {name} is damaged (its blake3 is {found}, should be {expected})"
                ));
            }
        }
        for (name, body) in &self.meta.bodies {
            self.check_surface(name, body)?;
            self.check_controls(name, body)?;
            self.check_requirements(name, body)?;
            check_accuracy(name, body)?;
        }
        Ok(())
    }

    /// Control elements by names of their own, at places, and of nodes that are there.
    fn check_controls(&self, name: &str, body: &BodyMeta) -> Result<(), String> {
        for (i, control) in body.controls.iter().enumerate() {
            let called = &control.name;
            if body.controls[..i].iter().any(|other| other.name == *called) {
                return Err(format!("bodies.{name}.controls names \"{called}\" twice"));
            }
            self.check_control(name, body, control)?;
        }
        Ok(())
    }

    fn check_control(&self, name: &str, body: &BodyMeta, control: &ControlMeta) -> Result<(), String> {
        let ControlMeta { name: called, origin, nodes, independent, vanishing, .. } = control;
        let field = |key: &str| format!("bodies.{name}.controls: {called}: {key}");
        numbers(&field("origin"), *origin, LARGEST)?;
        let is_known = |field: &String| FIELD_NAMES.contains(&field.as_str());
        // Of an element that is flat along no axis, fields depend on each other and none vanishes.
        let is_count = (3..=FIELDS).contains(independent) && independent.is_multiple_of(3);
        let known = vanishing.iter().filter(|field| is_known(field)).collect::<BTreeSet<_>>().len();
        if !is_count || known != vanishing.len() || known > FIELDS - independent {
            return Err(format!(
                "{}: {independent} independent fields and the vanishing ones {vanishing:?} do not suit each other",
                field("independent")
            ));
        }
        let tensor = format!("{name}/control/{called}");
        self.expect(&tensor, Dtype::U32, &[self.count(&tensor)])?;
        let held = self.control(name, called);
        let is_ascending = held.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_ascending || held.last().is_some_and(|&node| node as usize >= body.surface_nodes) {
            return Err(format!(
                "tensor {tensor} names a node that is not there, or its nodes are not ascending"
            ));
        }
        if *nodes < held.len().max(1) {
            return Err(format!("{} is {nodes}, of which {} are on the surface", field("nodes"), held.len()));
        }
        Ok(())
    }

    /// Every family that the body requires is known and can be used, and so is every section of an effect.
    fn check_requirements(&self, name: &str, body: &BodyMeta) -> Result<(), String> {
        for required in body.requirements.families() {
            let entry = FAMILIES.iter().find(|entry| entry.family.name == required).ok_or_else(|| {
                format!("bodies.{name}.requirements names \"{required}\", which this program does not know")
            })?;
            (entry.check)(self, name, body)?;
        }
        for effect in body.requirements.sections() {
            let prefix = format!("{name}/{effect}/");
            if !self.tensors.keys().any(|tensor| tensor.starts_with(&prefix)) {
                return Err(format!("the section {prefix} of the effect {effect} is missing"));
            }
        }
        self.check_columns_of_effects(name)
    }

    /// Nodes at places of their own names, and triangles between them.
    fn check_surface(&self, name: &str, body: &BodyMeta) -> Result<(), String> {
        let nodes = body.surface_nodes;
        self.expect(&format!("{name}/rest"), Dtype::F32, &[nodes, 3])?;
        self.expect(&format!("{name}/triangles"), Dtype::U32, &[body.surface_triangles, 3])?;
        self.expect(&format!("{name}/tags"), Dtype::U64, &[nodes])?;
        let rest = self.rest(name);
        numbers(&format!("tensor {name}/rest"), rest.as_flattened().iter().map(|&x| x.into()), LARGEST)?;
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for node in rest {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(node[axis]);
                bounds[1][axis] = bounds[1][axis].max(node[axis]);
            }
        }
        let [low, high] = bounds.map(|corner| corner.map(f64::from));
        let extent = (0..3).map(|axis| (high[axis] - low[axis]).powi(2)).sum::<f64>().sqrt();
        // As a mesh is refused; a hundredth of it for the rounding.
        if !(0.99 * EXTENT[0]..=1.01 * EXTENT[1]).contains(&extent) {
            return Err(format!(
                "tensor {name}/rest spans {extent:.1e} m, and only bodies of {:.0e} to {:.0e} m can be drawn",
                EXTENT[0], EXTENT[1]
            ));
        }
        for (i, triangle) in self.triangles(name).iter().enumerate() {
            let [a, b, c] = *triangle;
            if triangle.iter().any(|&corner| corner as usize >= rest.len()) || a == b || b == c || c == a {
                return Err(format!(
                    "tensor {name}/triangles: triangle {i} has the corners {triangle:?}, not three of the {} nodes",
                    rest.len()
                ));
            }
        }
        let mut tags = self.tags(name).to_vec();
        tags.sort_unstable();
        if let Some(pair) = tags.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(format!("tensor {name}/tags holds {} twice", pair[0]));
        }
        numbers(&format!("bodies.{name}.centre"), body.centre, LARGEST)
    }
}

/// Checks that the errors that a file states are possible: none is negative or above that of no solution.
fn check_accuracy(name: &str, body: &BodyMeta) -> Result<(), String> {
    let accuracy = &body.accuracy;
    let residuals = [accuracy.residual].into_iter().chain(accuracy.residuals.iter().copied());
    let estimates = [accuracy.scaled_condition, accuracy.forward_error, accuracy.asymmetry];
    let errors = [accuracy.storage_error].into_iter().chain(estimates.into_iter().flatten());
    for (key, values, largest) in [
        ("residual", residuals.collect::<Vec<f64>>(), LARGEST_RESIDUAL),
        ("storage_error, scaled_condition, forward_error or asymmetry", errors.collect(), f64::MAX),
    ] {
        if let Some(value) = values.into_iter().find(|value| !(0.0..=largest).contains(value)) {
            return Err(format!("bodies.{name}.accuracy: {key} is {value:e}, not between 0 and {largest:e}"));
        }
    }
    Ok(())
}
