//! Whether a .green file can be used: its parts fit together, its numbers are numbers, and it belongs to the scene.
//!
//! In: a container that was read. Out: the first fault, by the name of its tensor or field. A hash tells that a file is as
//! it was written, and nothing of who wrote it: nothing that is used later is taken on trust.

use super::control::{FIELD_NAMES, FIELDS};
use super::error::GreenError;
use super::file::{BodyMeta, ControlMeta, GreenFile, basis_type};
use super::needs::Needs;
use super::storage::{Basis, half_to_single};
use crate::mesh::diagnostics::EXTENT;
use crate::scene::{Scene, Storage};
use safetensors::tensor::Dtype;

/// Largest number of a column, m per unit of its field, and of a place, m: sums of them times the coefficients of poses
/// stay within single precision.
const LARGEST: f64 = 1e18;
/// A solution with a larger relative residual is worse than none: that of x = 0 is 1.
const LARGEST_RESIDUAL: f64 = 1.0;
/// S is symmetric to this part of its largest entry.
const SYMMETRY: f64 = 1e-9;

impl GreenFile {
    /// Errors where body `name` of the scene cannot be shown from this file: where it was made from something else, and
    /// where it is not what its fingerprint says.
    pub fn check_belongs(&self, scene: &Scene, name: &str, needs: Needs) -> Result<(), GreenError> {
        self.check_fresh(name, &super::fingerprint(scene, name, needs)?)?;
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
        if meta.needs != needs {
            let [found, expected] = [meta.needs, needs].map(|needs| needs.stiffness.to_string());
            return differs("needs.stiffness", found, expected);
        }
        if meta.element != body.element.name {
            return differs("element", meta.element.clone(), body.element.name.into());
        }
        if meta.accuracy.storage != body.storage {
            let [found, expected] =
                [meta.accuracy.storage, body.storage].map(|storage| storage.name().to_owned());
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
            let found = blake3::hash(&self.bytes.as_slice()[range.clone()]).to_hex();
            if found.as_str() != expected {
                return Err(format!(
                    "tensor {name} is damaged (its blake3 is {found}, should be {expected})"
                ));
            }
        }
        for (name, body) in &self.meta.bodies {
            self.check_shapes(name, body)?;
            self.check_surface(name, body)?;
            for control in &body.controls {
                self.check_control(name, body, control)?;
            }
            self.check_stiffness(name)?;
            check_accuracy(name, body)?;
        }
        Ok(())
    }

    /// Every tensor is there, of its type and shape.
    fn check_shapes(&self, name: &str, body: &BodyMeta) -> Result<(), String> {
        let nodes = body.surface_nodes;
        self.expect(&format!("{name}/rest"), Dtype::F32, &[nodes, 3])?;
        self.expect(&format!("{name}/triangles"), Dtype::U32, &[body.surface_triangles, 3])?;
        self.expect(&format!("{name}/tags"), Dtype::U64, &[nodes])?;
        for (i, ControlMeta { name: control, .. }) in body.controls.iter().enumerate() {
            if body.controls[..i].iter().any(|other| other.name == *control) {
                return Err(format!("bodies.{name}.controls names \"{control}\" twice"));
            }
            let dtype = basis_type(body.accuracy.storage);
            self.expect(&format!("{name}/basis/{control}"), dtype, &[FIELDS, nodes, 3])?;
            if body.accuracy.storage != Storage::F32 {
                self.expect(&format!("{name}/scale/{control}"), Dtype::F32, &[FIELDS])?;
            }
            let held = format!("{name}/control/{control}");
            let count = self.tensors.get(&held).map_or(0, |(_, shape, _)| shape.iter().product());
            self.expect(&held, Dtype::U32, &[count])?;
        }
        if body.needs.stiffness {
            let fields = FIELDS * body.controls.len();
            self.expect(&format!("{name}/stiffness"), Dtype::F64, &[fields, fields])?;
        }
        Ok(())
    }

    fn expect(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<(), String> {
        let (found, found_shape, range) =
            self.tensors.get(name).ok_or_else(|| format!("tensor {name} is missing"))?;
        if *found != dtype || found_shape != shape {
            return Err(format!("tensor {name} is {found:?} {found_shape:?}, should be {dtype:?} {shape:?}"));
        }
        if !(self.bytes.as_slice().as_ptr() as usize + range.start).is_multiple_of(dtype.bitsize() / 8) {
            return Err(format!("tensor {name} is not aligned to its numbers"));
        }
        Ok(())
    }

    /// Nodes at places of their own names, and triangles between them.
    fn check_surface(&self, name: &str, body: &BodyMeta) -> Result<(), String> {
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

    fn check_control(&self, name: &str, body: &BodyMeta, control: &ControlMeta) -> Result<(), String> {
        let ControlMeta { name: called, origin, nodes, independent, vanishing, storage_errors } = control;
        let field = |key: &str| format!("bodies.{name}.controls: {called}: {key}");
        numbers(&field("origin"), *origin, LARGEST)?;
        numbers(&field("storage_errors"), storage_errors.iter().copied(), f64::MAX)?;
        let is_known = |field: &String| FIELD_NAMES.contains(&field.as_str());
        if independent.checked_add(vanishing.len()) != Some(FIELDS) || !vanishing.iter().all(is_known) {
            return Err(format!(
                "{}: {independent} independent fields and the vanishing ones {vanishing:?} are not the {FIELDS}",
                field("independent")
            ));
        }
        let held = self.control(name, called);
        let is_ascending = held.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_ascending || held.last().is_some_and(|&node| node as usize >= body.surface_nodes) {
            return Err(format!(
                "tensor {name}/control/{called} names a node that is not there, or its nodes are not ascending"
            ));
        }
        if *nodes < held.len().max(1) {
            return Err(format!("{} is {nodes}, of which {} are on the surface", field("nodes"), held.len()));
        }
        let (basis, scale) =
            (format!("tensor {name}/basis/{called}"), format!("tensor {name}/scale/{called}"));
        let scaled = |scales: &[f32], largest: f64| {
            numbers(&scale, scales.iter().map(|&x| x.into()), LARGEST / largest)
        };
        match self.basis(name, called) {
            Basis::F32(values) => numbers(&basis, values.iter().map(|&x| x.into()), LARGEST),
            Basis::F16 { bits, scales } => {
                // Of magnitude 1 at most; infinite and NaN come out above 6e4.
                numbers(&basis, bits.iter().map(|&bits| half_to_single(bits).into()), 1.0)?;
                scaled(scales, 1.0)
            }
            Basis::Int16 { scales, .. } => scaled(scales, f64::from(i16::MAX)),
        }
    }

    fn check_stiffness(&self, name: &str) -> Result<(), String> {
        let Some(s) = self.stiffness(name) else { return Ok(()) };
        let tensor = format!("tensor {name}/stiffness");
        numbers(&tensor, s.iter().copied(), f64::MAX)?;
        let largest = s.amax();
        for j in 0..s.ncols() {
            for i in 0..j {
                if (s[(i, j)] - s[(j, i)]).abs() > SYMMETRY * largest {
                    return Err(format!(
                        "{tensor} is not symmetric: {:e} and {:e} at ({i}, {j})",
                        s[(i, j)],
                        s[(j, i)]
                    ));
                }
            }
        }
        Ok(())
    }
}

/// What the file says of its own errors can be: an error that is negative or above that of no solution is none.
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

/// Errors at the first number that is not finite, or whose magnitude is above `largest`.
fn numbers(what: &str, values: impl IntoIterator<Item = f64>, largest: f64) -> Result<(), String> {
    match values.into_iter().enumerate().find(|(_, value)| value.is_nan() || value.abs() > largest) {
        None => Ok(()),
        Some((i, value)) if value.is_finite() => {
            Err(format!("{what}: number {i} is {value:e}, of a magnitude above {largest:e}"))
        }
        Some((i, value)) => Err(format!("{what}: number {i} is {value}")),
    }
}
