//! The .green file: a safetensors container, written atomically, read into memory, checked by hash.
//!
//! Tensors per body: `rest` (surface nodes about `centre`), `triangles`, `tags`, per control element `basis/NAME`
//! (12 × nodes × 3), `scale/NAME` (12) where the basis is stored scaled, and `control/NAME` (its surface nodes), and
//! `stiffness` where it is needed. The metadata key `greenstage` holds one JSON object; NumPy's safetensors opens the
//! file as it is.

use super::basis::Precomputed;
use super::bytes::Bytes;
use super::control::FIELDS;
use super::error::GreenError;
use super::kind::GREEN;
use super::needs::Needs;
use super::storage::{Basis, Stored};
use crate::base::output;
use crate::mesh::quality;
use crate::scene::Storage;
use nalgebra::{DMatrix, Vector3};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Version of the container's contents; a file of another version is refused.
pub const FORMAT: u32 = 2;
const KEY: &str = "greenstage";

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
    pub needs: Needs,
    /// Mesh coordinates of the origin of `rest`, m.
    pub centre: [f64; 3],
    /// Nodes of the whole mesh; the file holds the surface's only.
    /// As scenes name it.
    pub element: String,
    pub mesh_nodes: usize,
    pub mesh_tets: usize,
    pub surface_nodes: usize,
    pub surface_triangles: usize,
    pub controls: Vec<ControlMeta>,
    pub accuracy: Accuracy,
    /// What was measured to choose the body's knobs, where the scene asks for an accuracy or a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<serde_json::Value>,
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
struct Sealed<'a> {
    blake3: String,
    #[serde(borrow)]
    content: &'a RawValue,
}

struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// Writes all bodies of a scene to `path`, whole or not at all ([`output::write`]). Returns its size.
pub fn write(path: &Path, bodies: &[Precomputed]) -> Result<u64, GreenError> {
    let failed = |source| GreenError::Io { path: path.to_owned(), source };
    let mut tensors = BTreeMap::new();
    let mut meta = Meta {
        format: FORMAT,
        program: format!("greenstage {}", env!("CARGO_PKG_VERSION")),
        units: "SI (m, N, Pa)".into(),
        bodies: BTreeMap::new(),
        blake3: BTreeMap::new(),
    };
    for body in bodies {
        let columns = stored(body);
        meta.bodies.insert(body.name.clone(), body_meta(body, &columns));
        add_tensors(body, columns, &mut tensors);
    }
    for (name, tensor) in &tensors {
        meta.blake3.insert(name.clone(), blake3::hash(&tensor.bytes).to_hex().to_string());
    }
    let bytes = container(&meta, &tensors).map_err(|error| failed(std::io::Error::other(error)))?;
    output::make_folder_of(path)?;
    output::write(path, &GREEN, |file| file.write_all(&bytes))?;
    Ok(bytes.len() as u64)
}

fn container(
    meta: &Meta,
    tensors: &BTreeMap<String, Tensor>,
) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
    let content = serde_json::value::to_raw_value(meta)?;
    let seal = blake3::hash(content.get().as_bytes()).to_hex().to_string();
    let sealed = serde_json::to_string(&Sealed { blake3: seal, content: &content })?;
    let views = tensors
        .iter()
        .map(|(name, t)| Ok((name.as_str(), TensorView::new(t.dtype, t.shape.clone(), &t.bytes)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    Ok(safetensors::serialize(views, Some([(KEY.to_owned(), sealed)].into()))?)
}

/// The columns of every control element over the surface.
fn stored(body: &Precomputed) -> Vec<Stored> {
    let (nodes, fields) = (&body.solution.surface.nodes, &body.solution.fields);
    let column = |column: usize| -> Vec<f64> {
        nodes
            .iter()
            .flat_map(|&n| (0..3).map(move |axis| fields.row(3 * n as usize + axis)[column]))
            .collect()
    };
    (0..body.solution.controls.len())
        .map(|e| Stored::new(body.storage, &(FIELDS * e..FIELDS * (e + 1)).map(column).collect::<Vec<_>>()))
        .collect()
}

fn body_meta(body: &Precomputed, columns: &[Stored]) -> BodyMeta {
    let solution = &body.solution;
    let centre = rest_centre(body);
    let controls = solution
        .controls
        .iter()
        .zip(columns)
        .map(|(control, stored)| ControlMeta {
            name: control.name.clone(),
            origin: (control.origin - centre).into(),
            nodes: control.nodes.len(),
            independent: control.independent_fields(),
            vanishing: (0..FIELDS)
                .filter(|&field| control.vanishing[field])
                .map(|field| super::control::FIELD_NAMES[field].to_owned())
                .collect(),
            storage_errors: stored.errors.clone(),
        })
        .collect();
    let conditioning = solution.stats.conditioning;
    BodyMeta {
        fingerprint: body.fingerprint.clone(),
        needs: body.needs,
        centre: centre.into(),
        element: solution.element.name.into(),
        mesh_nodes: solution.mesh.nodes.len(),
        mesh_tets: solution.mesh.tets.len(),
        surface_nodes: solution.surface.nodes.len(),
        surface_triangles: solution.surface.triangles.len(),
        controls,
        plan: body.plan.clone(),
        accuracy: Accuracy {
            solver: solution.stats.method.name.into(),
            residual: solution.stats.worst_residual(),
            residuals: solution.stats.residuals.clone(),
            scaled_condition: conditioning.and_then(|c| c.scaled_condition),
            forward_error: conditioning.map(|c| c.forward_error),
            asymmetry: solution.asymmetry,
            storage: body.storage,
            storage_error: columns.iter().map(Stored::relative_error).fold(0.0, f64::max),
        },
    }
}

/// Middle of the body's bounding box.
fn rest_centre(body: &Precomputed) -> Vector3<f64> {
    let (low, high) = quality::bounding_box(&body.solution.mesh.nodes);
    low + (high - low) * 0.5
}

fn add_tensors(body: &Precomputed, columns: Vec<Stored>, tensors: &mut BTreeMap<String, Tensor>) {
    let solution = &body.solution;
    let (nodes, mesh) = (&solution.surface.nodes, &solution.mesh);
    let centre = rest_centre(body);
    let mut add = |name: String, dtype: Dtype, shape: Vec<usize>, bytes: Vec<u8>| {
        tensors.insert(format!("{}/{name}", body.name), Tensor { dtype, shape, bytes });
    };
    let rest = nodes.iter().flat_map(|&n| <[f64; 3]>::from(mesh.nodes[n as usize] - centre));
    add(
        "rest".into(),
        Dtype::F32,
        vec![nodes.len(), 3],
        rest.flat_map(|x| (x as f32).to_le_bytes()).collect(),
    );
    let corners = solution.surface.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes());
    add("triangles".into(), Dtype::U32, vec![solution.surface.triangles.len(), 3], corners.collect());
    let tags = nodes.iter().flat_map(|&n| mesh.tags[n as usize].to_le_bytes());
    add("tags".into(), Dtype::U64, vec![nodes.len()], tags.collect());
    for (control, stored) in solution.controls.iter().zip(columns) {
        let dtype = basis_type(body.storage);
        add(format!("basis/{}", control.name), dtype, vec![FIELDS, nodes.len(), 3], stored.bytes);
        if !stored.scales.is_empty() {
            let bytes = stored.scales.iter().flat_map(|scale| scale.to_le_bytes()).collect();
            add(format!("scale/{}", control.name), Dtype::F32, vec![FIELDS], bytes);
        }
        let held: Vec<u32> = (0..nodes.len() as u32)
            .filter(|&i| control.nodes.binary_search(&nodes[i as usize]).is_ok())
            .collect();
        let bytes = held.iter().flat_map(|index| index.to_le_bytes()).collect();
        add(format!("control/{}", control.name), Dtype::U32, vec![held.len()], bytes);
    }
    if let Some(s) = &solution.stiffness {
        let bytes = s.iter().flat_map(|value| value.to_le_bytes()).collect();
        add("stiffness".into(), Dtype::F64, vec![s.nrows(), s.ncols()], bytes);
    }
}

/// A .green file in memory; its tensors are read where they lie. What becomes of the file on the disk afterwards changes
/// nothing here.
#[derive(Debug)]
pub struct GreenFile {
    pub path: PathBuf,
    pub meta: Meta,
    pub(super) bytes: Bytes,
    pub(super) tensors: Tensors,
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
        let (meta, tensors) = read_container(bytes.as_slice()).map_err(damaged)?;
        let file = GreenFile { path: path.to_owned(), meta, bytes, tensors };
        file.check().map_err(damaged)?;
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

    /// The twelve columns of one control element.
    pub fn basis(&self, body: &str, control: &str) -> Basis<'_> {
        let storage = self.meta.bodies.get(body).map_or(Storage::F32, |meta| meta.accuracy.storage);
        let (basis, scale) = (format!("{body}/basis/{control}"), format!("{body}/scale/{control}"));
        match storage {
            Storage::F32 => Basis::F32(self.slice(&basis)),
            Storage::F16 => Basis::F16 { bits: self.slice(&basis), scales: self.slice(&scale) },
            Storage::Int16 => Basis::Int16 { values: self.slice(&basis), scales: self.slice(&scale) },
        }
    }

    /// Surface nodes of one control element.
    pub fn control(&self, body: &str, control: &str) -> &[u32] {
        self.slice(&format!("{body}/control/{control}"))
    }

    /// The handle stiffness S, where the scene needed it.
    pub fn stiffness(&self, body: &str) -> Option<DMatrix<f64>> {
        self.meta.bodies.get(body).filter(|meta| meta.needs.stiffness)?;
        let name = format!("{body}/stiffness");
        let (_, shape, _) = self.tensors.get(&name)?;
        Some(DMatrix::from_column_slice(shape[0], shape[1], self.slice(&name)))
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

pub(super) fn basis_type(storage: Storage) -> Dtype {
    match storage {
        Storage::F32 => Dtype::F32,
        Storage::F16 => Dtype::F16,
        Storage::Int16 => Dtype::I16,
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
