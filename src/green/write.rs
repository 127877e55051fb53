//! Writes bodies into a .green file, whole or not at all.
//!
//! In: precomputed bodies. Out: a safetensors container with the tensors of the surface, of the families that each body
//! requires and of its effects, and the metadata sealed by their hash.

use super::bytes::{Bytes, Tensor};
use super::control::{ControlElement, FIELD_NAMES, FIELDS};
use super::error::GreenError;
use super::families::FAMILIES;
use super::file::{Accuracy, BodyMeta, ControlMeta, FORMAT, GreenFile, KEY, Meta, Sealed};
use super::kind::GREEN;
use super::solution::Precomputed;
use crate::base::extent::bounding_box;
use crate::base::output;
use nalgebra::Vector3;
use safetensors::tensor::{Dtype, TensorView};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Writes all bodies of a scene to `path`, whole or not at all ([`output::write`]). Returns its size.
pub fn write(path: &Path, bodies: &[Precomputed]) -> Result<u64, GreenError> {
    write_with(path, bodies, &[])
}

/// The .green file of precomputed bodies, whose place on the disk is gone when this returns.
pub fn opened(bodies: &[Precomputed]) -> Result<Arc<GreenFile>, GreenError> {
    let failed = |source| GreenError::Io { path: std::env::temp_dir(), source };
    let folder = tempfile::tempdir().map_err(failed)?;
    let path = folder.path().join("bodies.green");
    write(&path, bodies)?;
    GreenFile::open(&path).map(Arc::new)
}

/// Writes `bodies` into a .green file, and copies the bodies `kept`, by their names, from other files as they are there.
pub fn write_with(
    path: &Path,
    bodies: &[Precomputed],
    kept: &[(&GreenFile, &str)],
) -> Result<u64, GreenError> {
    let failed = |source| GreenError::Io { path: path.to_owned(), source };
    let mut tensors = BTreeMap::new();
    let mut meta = Meta::empty();
    for body in bodies {
        let (own, of_body) = contents(body);
        tensors.extend(of_body.into_iter().map(|(name, tensor)| (format!("{}/{name}", body.name), tensor)));
        meta.bodies.insert(body.name.clone(), own);
    }
    for (file, body) in kept {
        tensors.extend(file.tensors_of(body)?);
        meta.bodies.extend(file.meta.bodies.get(*body).map(|meta| ((*body).to_owned(), meta.clone())));
    }
    let bytes = sealed(meta, &tensors).map_err(|error| failed(std::io::Error::other(error)))?;
    output::make_folder_of(path)?;
    output::write(path, &GREEN, |file| file.write_all(&bytes))?;
    Ok(bytes.len() as u64)
}

impl Meta {
    fn empty() -> Meta {
        Meta {
            format: FORMAT,
            program: format!("greenstage {}", env!("CARGO_PKG_VERSION")),
            units: "SI (m, N, Pa)".into(),
            bodies: BTreeMap::new(),
            blake3: BTreeMap::new(),
        }
    }
}

impl GreenFile {
    /// The tensors of a body as they are there, by their names in the file.
    fn tensors_of(&self, body: &str) -> Result<Vec<(String, Tensor)>, GreenError> {
        let own = format!("{body}/");
        let failed = |source| GreenError::Io { path: self.path.clone(), source };
        self.compliance(body).map_or(Ok(()), |compliance| compliance.verify())?;
        let of_body = self.tensors.iter().filter(|(name, _)| name.starts_with(&own));
        let copied = |(name, (dtype, shape, _)): (&String, &(Dtype, Vec<usize>, Range<usize>))| {
            let length = shape.iter().product::<usize>() * dtype.bitsize() / 8;
            let bytes = self.bytes_of(name, 0..length).map_err(failed)?.into_owned();
            Ok((name.clone(), Tensor { dtype: *dtype, shape: shape.clone(), bytes }))
        };
        of_body.map(copied).collect()
    }

    /// The tensors of an effect's section, by `EFFECT/TENSOR`.
    pub fn section_tensors(&self, body: &str, effect: &str) -> Vec<(String, Tensor)> {
        let section = format!("{body}/{effect}/");
        let names = self.tensors.keys().filter(|name| name.starts_with(&section));
        let within = names.filter_map(|name| name.strip_prefix(body)?.strip_prefix('/'));
        within.filter_map(|name| Some((name.to_owned(), self.tensor(body, name)?))).collect()
    }

    /// One tensor of a body.
    pub(super) fn tensor(&self, body: &str, name: &str) -> Option<Tensor> {
        let (dtype, shape, place) = self.tensors.get(&format!("{body}/{name}"))?;
        let bytes = self.bytes.as_slice()[place.clone()].to_vec();
        Some(Tensor { dtype: *dtype, shape: shape.clone(), bytes })
    }

    /// A file in memory alone, in which some bodies of this one have other tensors and say something else of themselves.
    pub(super) fn with_bodies(
        self: Arc<Self>,
        mut others: BTreeMap<String, (BodyMeta, BTreeMap<String, Tensor>)>,
    ) -> Result<GreenFile, GreenError> {
        let mut meta = Meta::empty();
        let mut tensors = BTreeMap::new();
        for (name, own) in &self.meta.bodies {
            let Some((changed, content)) = others.remove(name) else {
                meta.bodies.insert(name.clone(), own.clone());
                tensors.extend(self.tensors_of(name)?);
                continue;
            };
            meta.bodies.insert(name.clone(), changed);
            tensors.extend(content.into_iter().map(|(tensor, of)| (format!("{name}/{tensor}"), of)));
        }
        self.made_of(meta, tensors)
    }

    /// A file in memory of one body of this one alone, with other tensors.
    pub(super) fn with_alone(
        self: Arc<Self>,
        name: &str,
        own: BodyMeta,
        content: BTreeMap<String, Tensor>,
    ) -> Result<GreenFile, GreenError> {
        let mut meta = Meta::empty();
        meta.bodies.insert(name.to_owned(), own);
        let tensors = content.into_iter().map(|(tensor, of)| (format!("{name}/{tensor}"), of)).collect();
        self.made_of(meta, tensors)
    }

    fn made_of(
        self: Arc<Self>,
        meta: Meta,
        tensors: BTreeMap<String, Tensor>,
    ) -> Result<GreenFile, GreenError> {
        let damaged = |reason: String| GreenError::Damaged { path: self.path.clone(), reason };
        let bytes = sealed(meta, &tensors).map_err(|error| damaged(error.to_string()))?;
        drop(tensors);
        let bytes = Bytes::read(&mut bytes.as_slice(), bytes.len() as u64)
            .map_err(|source| GreenError::Io { path: self.path.clone(), source })?;
        let file = GreenFile::parse(&self.path, bytes).map_err(damaged)?;
        Ok(GreenFile { base: Some(self), ..file })
    }
}

/// The bytes of a file.
fn sealed(
    mut meta: Meta,
    tensors: &BTreeMap<String, Tensor>,
) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
    for (name, tensor) in tensors {
        meta.blake3.insert(name.clone(), blake3::hash(&tensor.bytes).to_hex().to_string());
    }
    let meta = &meta;
    let content = serde_json::value::to_raw_value(meta)?;
    let seal = blake3::hash(content.get().as_bytes()).to_hex().to_string();
    let sealed = serde_json::to_string(&Sealed { blake3: seal, content: &content })?;
    let views = tensors
        .iter()
        .map(|(name, t)| Ok((name.as_str(), TensorView::new(t.dtype, t.shape.clone(), &t.bytes)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    Ok(safetensors::serialize(views, Some([(KEY.to_owned(), sealed)].into()))?)
}

/// Metadata of a body that is known before the families are written.
fn body_meta(body: &Precomputed) -> BodyMeta {
    let solution = &body.solution;
    let centre = rest_centre(body);
    let control = |control: &ControlElement| ControlMeta {
        name: control.name.clone(),
        origin: (control.origin - centre).into(),
        nodes: control.nodes.len(),
        independent: control.independent_fields(),
        vanishing: (0..FIELDS)
            .filter(|&field| control.vanishing[field])
            .map(|field| FIELD_NAMES[field].to_owned())
            .collect(),
        storage_errors: Vec::new(),
    };
    let controls = solution.controls.iter().map(control).collect();
    let conditioning = solution.stats.conditioning;
    BodyMeta {
        fingerprint: body.fingerprint.clone(),
        requirements: body.requirements.clone(),
        centre: centre.into(),
        element: solution.element_name().into(),
        mesh_nodes: solution.mesh.nodes.len(),
        mesh_tets: solution.mesh.tets.len(),
        surface_nodes: solution.surface.nodes.len(),
        surface_triangles: solution.surface.triangles.len(),
        controls,
        plan: body.plan.clone(),
        loads: Vec::new(),
        compliance_nodes: None,
        compressed: None,
        accuracy: Accuracy {
            solver: solution.stats.method.name.into(),
            residual: solution.stats.worst_residual(),
            residuals: solution.stats.residuals.clone(),
            scaled_condition: conditioning.and_then(|c| c.scaled_condition),
            forward_error: conditioning.map(|c| c.forward_error),
            asymmetry: None,
            storage: body.storage,
            storage_error: 0.0,
        },
    }
}

/// Middle of the body's bounding box.
fn rest_centre(body: &Precomputed) -> Vector3<f64> {
    let (low, high) = bounding_box(&body.solution.mesh.nodes);
    low + (high - low) * 0.5
}

/// Metadata of a body in the file, and its tensors: the surface, the families that the body requires, and the sections of its
/// effects.
pub(super) fn contents(body: &Precomputed) -> (BodyMeta, Vec<(String, Tensor)>) {
    let mut meta = body_meta(body);
    let solution = &body.solution;
    let (nodes, mesh) = (&solution.surface.nodes, &solution.mesh);
    let (centre, triangles) = (rest_centre(body), &solution.surface.triangles);
    let place = |&n: &u32| <[f64; 3]>::from(mesh.nodes[n as usize] - centre).map(|x| x as f32);
    let mut own = vec![
        ("rest".to_owned(), Tensor::new(&[nodes.len(), 3], nodes.iter().flat_map(place))),
        ("triangles".to_owned(), Tensor::new(&[triangles.len(), 3], triangles.iter().flatten().copied())),
        ("tags".to_owned(), Tensor::new(&[nodes.len()], nodes.iter().map(|&n| mesh.tags[n as usize]))),
    ];
    for control in &solution.controls {
        let is_held = |i: &u32| control.nodes.binary_search(&nodes[*i as usize]).is_ok();
        let held: Vec<u32> = (0..nodes.len() as u32).filter(is_held).collect();
        own.push((format!("control/{}", control.name), Tensor::new(&[held.len()], held)));
    }
    for entry in FAMILIES.iter().filter(|entry| body.requirements.has(entry.family)) {
        own.extend((entry.write)(body, &mut meta));
    }
    own.extend(body.sections.iter().map(|(name, tensor)| (name.clone(), tensor.clone())));
    (meta, own)
}
