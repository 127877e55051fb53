//! The .green file: a safetensors container, read into memory, checked by hash; but for the largest tensors, which are read
//! piece by piece when they are needed ([`super::on_disk`]).
//!
//! Tensors per body: `rest` (surface nodes about `centre`), `triangles`, `tags`, `control/NAME` (the surface nodes of
//! each control element), those of the column families that the body requires, and `EFFECT/TENSOR` of effects that own some. The metadata key `greenstage` holds one JSON object;
//! NumPy's safetensors opens the file as it is.

use super::bytes::{Bytes, Number};
use super::compressed::Shapes;
use super::error::GreenError;
use super::kind::GREEN;
use super::on_demand::{OnDemand, SolvedCompliance};
use super::on_disk::{OnDisk, Recent};
use super::requirements::Requirements;
use crate::base::columns::Storage;
use crate::base::output;
use safetensors::tensor::{Dtype, Metadata};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Version of the container's contents; a file of another version is refused.
pub const FORMAT: u32 = 3;
pub(super) const KEY: &str = "greenstage";

/// Metadata of a .green file.
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
    /// Name of the element in scenes.
    pub element: String,
    /// Nodes of the whole mesh; the file holds the surface's only.
    pub mesh_nodes: usize,
    pub mesh_tets: usize,
    pub surface_nodes: usize,
    pub surface_triangles: usize,
    pub controls: Vec<ControlMeta>,
    pub accuracy: Accuracy,
    /// Measurements from which the body's settings were chosen, where the scene asks for an accuracy or a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<serde_json::Value>,
    /// Loads, in the order of their columns.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<LoadMeta>,
    /// Nodes of the surface that take forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliance_nodes: Option<usize>,
    /// Errors of a compressed compliance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compressed: Option<CompressedMeta>,
}

impl BodyMeta {
    /// Columns of all loads.
    pub fn load_columns(&self) -> usize {
        self.loads.iter().fold(0, |sum, load| sum.saturating_add(load.columns))
    }
}

/// Errors of a compressed compliance, in parts of the displacement of a pressed node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompressedMeta {
    pub asked: f64,
    /// The largest error of displacements anywhere for forces at `nodes` nodes, against columns solved anew.
    pub measured: f64,
    pub nodes: usize,
}

impl CompressedMeta {
    /// The errors in a sentence.
    pub fn told(&self) -> String {
        let CompressedMeta { asked, measured, nodes } = self;
        format!(
            "compressed compliance: error at most {measured:.1e} of the pressed node's displacement, at \
             {nodes} nodes (asked: {asked:e})"
        )
    }
}

/// One load of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadMeta {
    pub name: String,
    /// Three for a vector, else one.
    pub columns: usize,
    pub turning: Turning,
    /// Unit of its coefficients.
    pub unit: String,
}

/// Behaviour of a load when the body turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turning {
    /// A vector whose direction stays.
    Fixed,
    /// A load that turns along.
    Follows,
    /// Forces of the body on itself, which turn along and do no work where the body turns as a whole.
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

/// Accuracy of the numbers, as far as it is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    pub solver: String,
    /// Largest relative residual ‖b - A x‖₂/‖b‖₂ over the columns, in f64, before rounding.
    pub residual: f64,
    pub residuals: Vec<f64>,
    /// Estimate of the condition number of A scaled by its diagonal; absent where nothing had to be solved.
    pub scaled_condition: Option<f64>,
    /// Bound on the distance of the solution from the exact one of the same mesh, relative to the largest displacement.
    pub forward_error: Option<f64>,
    /// max |S - Sᵀ| / max |S| as solved.
    pub asymmetry: Option<f64>,
    pub storage: Storage,
    /// Largest error of storage of a field, as a part of its largest displacement.
    pub storage_error: f64,
}

impl Accuracy {
    /// Storage of the columns and its measured error, in a phrase.
    pub fn stored(&self) -> String {
        let (storage, error) = (self.storage.name(), self.storage_error);
        format!("stored as {storage}: at most {error:.1e} of each field's largest displacement")
    }
}

/// Metadata as it stands in the file, with its hash, so that a flipped bit in a number is found too.
#[derive(Serialize, Deserialize)]
pub(super) struct Sealed<'a> {
    pub(super) blake3: String,
    #[serde(borrow)]
    pub(super) content: &'a RawValue,
}

/// Ends of the names of tensors that stay on the disk.
pub(super) const COMPLIANCE_VALUES: &str = "compliance/values";
pub(super) const FACTOR_VALUES: &str = "kept_factor/values";
pub(super) const COMPRESSED_VALUES: &str = "compressed/values";

/// A .green file in memory; its tensors are read where they lie. What becomes of the file on the disk afterwards changes
/// nothing here, but for a compliance: that of a file which is replaced stays as it was, what is damaged is an error.
#[derive(Debug)]
pub struct GreenFile {
    pub path: PathBuf,
    pub meta: Meta,
    pub(super) bytes: Bytes,
    pub(super) tensors: Tensors,
    pub(super) on_disk: Option<OnDisk>,
    pub(super) recent: Recent,
    pub(super) on_demand: OnDemand,
    pub(super) shapes: Shapes,
    /// The file that this one was derived from, where a control element was released or a modulus changed.
    pub base: Option<Arc<GreenFile>>,
    /// The compliance of the file's only body, where it is solved for when it is asked for.
    pub(super) solved: Option<Arc<dyn SolvedCompliance>>,
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
        let file = std::fs::File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        if length == 0 {
            return Err(failed(std::io::Error::new(ErrorKind::NotFound, "the file is empty")));
        }
        let unread = |source: std::io::Error| match source.kind() {
            ErrorKind::UnexpectedEof => damaged("it is cut short".into()),
            ErrorKind::InvalidData => damaged(source.to_string()),
            _ => failed(source),
        };
        let header = Bytes::header(&mut &file, length).map_err(|source| match output::is(path, &GREEN) {
            true => unread(source),
            false => GreenError::Foreign { path: path.to_owned() },
        })?;
        let (meta, mut tensors) = read_container(&header, length).map_err(damaged)?;
        let (places, left) = leave(&meta, &mut tensors);
        let on_disk = OnDisk::new(file, places);
        let bytes = Bytes::read(&mut on_disk.others(), length - left).map_err(unread)?;
        let on_disk = (left > 0).then_some(on_disk);
        let file = GreenFile::of(path, (meta, tensors), bytes, on_disk);
        file.check().map_err(damaged)?;
        Ok(file)
    }

    /// The error says what is wrong.
    pub(super) fn parse(path: &Path, bytes: Bytes) -> Result<GreenFile, String> {
        let length = bytes.as_slice().len() as u64;
        let (meta, tensors) = read_container(bytes.as_slice(), length)?;
        let file = GreenFile::of(path, (meta, tensors), bytes, None);
        file.check()?;
        Ok(file)
    }

    fn of(path: &Path, (meta, tensors): (Meta, Tensors), bytes: Bytes, on_disk: Option<OnDisk>) -> GreenFile {
        GreenFile {
            path: path.to_owned(),
            meta,
            bytes,
            tensors,
            on_disk,
            recent: Recent::default(),
            shapes: Shapes::default(),
            on_demand: OnDemand::default(),
            base: None,
            solved: None,
        }
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
        self.tensors.iter().map(|(name, (dtype, shape, _))| {
            let size = shape.iter().product::<usize>() * dtype.bitsize() / 8;
            (name.as_str(), format!("{dtype:?}"), shape.as_slice(), size)
        })
    }

    /// Whether the tensor was left on the disk.
    pub(super) fn is_on_disk(&self, name: &str) -> bool {
        self.on_disk.as_ref().is_some_and(|on_disk| on_disk.holds(name))
    }

    /// Bytes of a tensor, from memory or from the disk.
    pub(super) fn bytes_of(&self, name: &str, part: Range<usize>) -> std::io::Result<Cow<'_, [u8]>> {
        match self.on_disk.as_ref().filter(|on_disk| on_disk.holds(name)) {
            Some(on_disk) => on_disk.read(name, part.start as u64..part.end as u64).map(Cow::Owned),
            None => {
                let whole: &[u8] = self.slice(name);
                whole.get(part).map(Cow::Borrowed).ok_or_else(|| ErrorKind::InvalidInput.into())
            }
        }
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

/// Reads the metadata of a container of `length` bytes, and the places of its tensors, from its beginning.
fn read_container(bytes: &[u8], length: u64) -> Result<(Meta, Tensors), String> {
    let text = |error: &dyn std::fmt::Display| format!("it is cut short or damaged ({error})");
    let (head, rest) = bytes.split_first_chunk::<8>().ok_or("it is cut short")?;
    let header = usize::try_from(u64::from_le_bytes(*head)).map_err(|error| text(&error))?;
    let header = rest.get(..header).ok_or("it is cut short")?;
    // It sees to it that tensors follow each other without gaps, and have the bytes of their shapes.
    let info: Metadata = serde_json::from_slice(header).map_err(|error| text(&error))?;
    let base = 8 + header.len();
    let said = base as u128 + info.data_len() as u128;
    if said != u128::from(length) {
        return Err(text(&format!("its tensors end at {said} of {length} bytes")));
    }
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
    let tensors = info
        .offset_keys()
        .into_iter()
        .filter_map(|name| {
            let tensor = info.info(&name)?;
            let range = base + tensor.data_offsets.0..base + tensor.data_offsets.1;
            Some((name, (tensor.dtype, tensor.shape.clone(), range)))
        })
        .collect();
    Ok((meta, tensors))
}

/// Takes tensors that stay on the disk out of what is read; returns their places and their bytes together. They are of numbers
/// of 4 bytes, and those of 8 stand before them: what is behind stays aligned.
fn leave(meta: &Meta, tensors: &mut Tensors) -> (BTreeMap<String, Range<u64>>, u64) {
    let left = [COMPLIANCE_VALUES, COMPRESSED_VALUES, FACTOR_VALUES];
    let names = meta.bodies.keys().flat_map(|body| left.map(|values| format!("{body}/{values}")));
    let mut places = BTreeMap::new();
    for name in names {
        let Some((.., range)) = tensors.get_mut(&name) else { continue };
        places.insert(name, range.start as u64..range.end as u64);
        *range = 0..0;
    }
    for (_, _, range) in tensors.values_mut() {
        let before = places.values().filter(|place| place.end <= range.start as u64);
        let cut = before.map(|place| (place.end - place.start) as usize).sum::<usize>();
        *range = range.start - cut..range.end - cut;
    }
    let left = places.values().map(|place| place.end - place.start).sum();
    (places, left)
}
