//! The .green file: a safetensors container, read into memory, checked by hash.
//!
//! Tensors per body: `rest` (surface nodes about `centre`), `triangles`, `tags`, `control/NAME` (the surface nodes of
//! each control element), those of the column families that the body requires, and `EFFECT/TENSOR` of effects that own some. The metadata key `greenstage` holds one JSON object;
//! NumPy's safetensors opens the file as it is.

use super::bytes::Bytes;
use super::error::GreenError;
use super::requirements::Requirements;
use super::tensor::Number;
use crate::base::columns::Storage;
use safetensors::tensor::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Version of the container's contents; a file of another version is refused.
pub const FORMAT: u32 = 3;
pub(super) const KEY: &str = "greenstage";

/// What the file says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    pub format: u32,
    pub program: String,
    pub units: String,
    pub bodies: BTreeMap<String, BodyMeta>,
    /// blake3 of every tensor's bytes.
    pub blake3: BTreeMap<String, String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyMeta {
    pub fingerprint: String,
    pub requirements: Requirements,
    /// Mesh coordinates of the origin of `rest`, m.
    pub centre: [f64; 3],
    /// As scenes name it.
    pub element: String,
    /// Nodes of the whole mesh; the file holds the surface's only.
    pub mesh_nodes: usize,
    pub mesh_tets: usize,
    pub surface_nodes: usize,
    pub surface_triangles: usize,
    pub controls: Vec<ControlMeta>,
    pub accuracy: Accuracy,
    /// What was measured to choose the body's settings, where the scene asks for an accuracy or a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<serde_json::Value>,
    /// In the order of their columns.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<LoadMeta>,
    /// Nodes of the surface that take forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliance_nodes: Option<usize>,
}

impl BodyMeta {
    /// Columns of all loads.
    pub fn load_columns(&self) -> usize {
        self.loads.iter().fold(0, |sum, load| sum.saturating_add(load.columns))
    }
}

/// One load of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadMeta {
    pub name: String,
    /// Three for a vector, else one.
    pub columns: usize,
    pub turning: Turning,
    /// Of its coefficients.
    pub unit: String,
}

/// What a load does when the body turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turning {
    /// Its direction stays: a vector.
    Fixed,
    /// It turns along.
    Follows,
    /// It turns along, and does no work where the body turns as a whole: forces of the body on itself.
    Inner,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlMeta {
    pub name: String,
    /// o_e about `centre`, m.
    pub origin: [f64; 3],
    /// Nodes held, those inside the body included.
    pub nodes: usize,
    /// Independent fields, 3 to 12.
    pub independent: usize,
    /// Names of the fields that are zero, because the element is flat along an axis.
    pub vanishing: Vec<String>,
    /// Largest error of storage of each field, m per unit of the field, measured against the f64 columns.
    pub storage_errors: Vec<f64>,
}

/// What is known of the numbers' accuracy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    pub solver: String,
    /// Largest relative residual ‖b - A x‖₂/‖b‖₂ over the columns, in f64, before rounding.
    pub residual: f64,
    pub residuals: Vec<f64>,
    /// Estimate of the condition number of A scaled by its diagonal; absent where nothing had to be solved.
    pub scaled_condition: Option<f64>,
    /// How far the solution may be from the exact one of the same mesh, relative to the largest displacement.
    pub forward_error: Option<f64>,
    /// max |S - Sᵀ| / max |S| as solved.
    pub asymmetry: Option<f64>,
    pub storage: Storage,
    /// Largest error of storage of a field, as a part of its largest displacement.
    pub storage_error: f64,
}

/// Metadata as it stands in the file: its own hash beside it, so that a flipped bit in a number is found too.
#[derive(Serialize, Deserialize)]
pub(super) struct Sealed<'a> {
    pub(super) blake3: String,
    #[serde(borrow)]
    pub(super) content: &'a RawValue,
}

/// A .green file in memory; its tensors are read where they lie. What becomes of the file on the disk afterwards changes
/// nothing here.
#[derive(Debug)]
pub struct GreenFile {
    pub path: PathBuf,
    pub meta: Meta,
    pub(super) bytes: Bytes,
    pub(super) tensors: Tensors,
    /// The file that this one was derived from, where a control element was released or a modulus changed.
    pub base: Option<Arc<GreenFile>>,
}

impl GreenFile {
    /// Reads and checks the file: container, version, every hash, every shape, every number.
    pub fn open(path: &Path) -> Result<GreenFile, GreenError> {
        let failed = |source| GreenError::Io { path: path.to_owned(), source };
        let damaged = |reason: String| GreenError::Damaged { path: path.to_owned(), reason };
        // Asked before it is opened: opening a pipe waits for its writer.
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            return Err(damaged("it is not a file".into()));
        }
        let mut file = std::fs::File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let bytes = Bytes::read(&mut file, length).map_err(|source| match source.kind() {
            ErrorKind::UnexpectedEof => damaged("it is cut short".into()),
            ErrorKind::InvalidData => damaged(source.to_string()),
            _ => failed(source),
        })?;
        GreenFile::of(path, bytes).map_err(damaged)
    }

    /// The error says what is wrong.
    pub(super) fn of(path: &Path, bytes: Bytes) -> Result<GreenFile, String> {
        let (meta, tensors) = read_container(bytes.as_slice())?;
        let file = GreenFile { path: path.to_owned(), meta, bytes, tensors, base: None };
        file.check()?;
        Ok(file)
    }

    /// Errors where body `name` was made from something else than `fingerprint` says.
    pub fn check_fresh(&self, name: &str, fingerprint: &str) -> Result<(), GreenError> {
        let found = self.meta.bodies.get(name).map_or("absent", |body| body.fingerprint.as_str());
        if found == fingerprint {
            return Ok(());
        }
        let short = |text: &str| text.chars().take(12).collect::<String>();
        Err(GreenError::Stale { path: self.path.clone(), found: short(found), expected: short(fingerprint) })
    }

    pub fn rest(&self, body: &str) -> &[[f32; 3]] {
        self.slice(&format!("{body}/rest"))
    }

    pub fn triangles(&self, body: &str) -> &[[u32; 3]] {
        self.slice(&format!("{body}/triangles"))
    }

    pub fn tags(&self, body: &str) -> &[u64] {
        self.slice(&format!("{body}/tags"))
    }

    /// Surface nodes of one control element.
    pub fn control(&self, body: &str, control: &str) -> &[u32] {
        self.slice(&format!("{body}/control/{control}"))
    }

    /// A tensor of an effect's own section: its shape and numbers. The error names what is missing or of another type.
    pub fn section<T: Number + bytemuck::AnyBitPattern>(
        &self,
        body: &str,
        effect: &str,
        tensor: &str,
    ) -> Result<(&[usize], &[T]), GreenError> {
        let name = format!("{body}/{effect}/{tensor}");
        let shape = self.tensors.get(&name).map_or(&[][..], |(_, shape, _)| shape);
        self.expect(&name, T::DTYPE, shape)
            .map_err(|reason| GreenError::Damaged { path: self.path.clone(), reason })?;
        Ok((shape, self.slice(&name)))
    }

    /// Errors unless the tensor is there, of this type and shape, and aligned to its numbers.
    pub(super) fn expect(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<(), String> {
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

    /// Numbers of a tensor; 0 of one that is not there.
    pub(super) fn count(&self, name: &str) -> usize {
        self.tensors.get(name).map_or(0, |(_, shape, _)| shape.iter().product())
    }

    /// Names, types and shapes of all tensors, for `inspect`.
    pub fn tensors(&self) -> impl Iterator<Item = (&str, String, &[usize], usize)> {
        self.tensors.iter().map(|(name, (dtype, shape, range))| {
            (name.as_str(), format!("{dtype:?}"), shape.as_slice(), range.len())
        })
    }

    /// The tensor's numbers where they lie. `check` has seen that it is there, of this type and aligned.
    pub(super) fn slice<T: bytemuck::AnyBitPattern>(&self, name: &str) -> &[T] {
        self.tensors
            .get(name)
            .map_or(&[], |(_, _, range)| bytemuck::cast_slice(&self.bytes.as_slice()[range.clone()]))
    }
}

/// Type, shape and place in the file of every tensor.
pub(super) type Tensors = BTreeMap<String, (Dtype, Vec<usize>, Range<usize>)>;

fn read_container(bytes: &[u8]) -> Result<(Meta, Tensors), String> {
    let text = |error: &dyn std::fmt::Display| format!("it is cut short or damaged ({error})");
    let (header, info) = SafeTensors::read_metadata(bytes).map_err(|error| text(&error))?;
    let container = SafeTensors::deserialize(bytes).map_err(|error| text(&error))?;
    let sealed = info
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get(KEY))
        .ok_or("it is a safetensors file, but not one of greenstage")?;
    let sealed: Sealed = serde_json::from_str(sealed).map_err(|error| text(&error))?;
    if blake3::hash(sealed.content.get().as_bytes()).to_hex().as_str() != sealed.blake3 {
        return Err("its metadata is damaged (the hash differs)".into());
    }
    let value: serde_json::Value =
        serde_json::from_str(sealed.content.get()).map_err(|error| text(&error))?;
    if value["format"] != FORMAT {
        return Err(format!("it has format {}, this program reads format {FORMAT}", value["format"]));
    }
    let meta: Meta = serde_json::from_value(value).map_err(|error| text(&error))?;
    let base = header + 8;
    let tensors = container
        .names()
        .into_iter()
        .filter_map(|name| {
            let tensor = info.info(name)?;
            let range = base + tensor.data_offsets.0..base + tensor.data_offsets.1;
            Some((name.to_owned(), (tensor.dtype, tensor.shape.clone(), range)))
        })
        .collect();
    Ok((meta, tensors))
}
