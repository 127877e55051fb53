//! A body made ready to be solved: its mesh, control elements and materials, and all that was found wrong or odd.

use super::check::{self, Finding};
use super::{ControlElement, GreenError};
use crate::fem::Lame;
use crate::mesh::trouble::Severity;
use crate::mesh::{Loaded, TetMesh, quality};
use crate::scene::{Body, Material, Scene};
use std::collections::{BTreeMap, BTreeSet};

/// What a body is, before anything is assembled.
pub struct Prepared {
    pub mesh: TetMesh,
    pub controls: Vec<ControlElement>,
    /// Lamé's constants per tetrahedron.
    pub lame: Vec<Lame>,
    /// Most severe first. With an error among them the body must not be solved.
    pub findings: Vec<Finding>,
}

/// Loads body `name` and judges it without solving. Errors where it cannot even be judged: no mesh, a selection that
/// is empty, a region that is not there.
pub fn prepare(scene: &Scene, name: &str) -> Result<Prepared, GreenError> {
    prepare_mesh(scene, name, scene.load_mesh(name, &scene.body[name])?)
}

/// [`prepare`] with another mesh than that of the body's file or generator.
pub fn prepare_mesh(scene: &Scene, name: &str, loaded: Loaded) -> Result<Prepared, GreenError> {
    let body = &scene.body[name];
    let mesh = loaded.mesh;
    let controls = control_elements(scene, name, body, &mesh)?;
    let lame = materials(scene, name, body, &mesh)?;
    let entity = format!("body.{name}");
    let mut findings: Vec<Finding> =
        loaded.notices.into_iter().map(|notice| Finding::new(Severity::Note, &entity, notice)).collect();
    findings.extend(check::mesh(&entity, &mesh));
    findings.extend(check::support(&entity, &mesh, &controls));
    findings.extend(check::materials(&entity, body, &mesh, &controls, &lame));
    findings.sort_by_key(|finding| finding.severity);
    Ok(Prepared { mesh, controls, lame, findings })
}

fn control_elements(
    scene: &Scene,
    name: &str,
    body: &Body,
    mesh: &TetMesh,
) -> Result<Vec<ControlElement>, GreenError> {
    let (low, high) = quality::bounding_box(&mesh.nodes);
    let size = (high - low).norm();
    body.control
        .iter()
        .map(|(control_name, control)| {
            let nodes = control.nodes.select(mesh).map_err(|message| {
                scene.invalid(&format!("body.{name}.control.{control_name}.nodes"), message)
            })?;
            Ok(ControlElement::new(control_name, nodes, mesh, size))
        })
        .collect()
}

fn materials(scene: &Scene, name: &str, body: &Body, mesh: &TetMesh) -> Result<Vec<Lame>, GreenError> {
    let lame = |material: &Material| Lame::from_young_poisson(material.young, material.poisson);
    let mut by_region = BTreeMap::new();
    for (key, material) in &body.region {
        let named = mesh.region_names.iter().find(|(_, region_name)| *region_name == key).map(|(id, _)| *id);
        let region = named.or_else(|| key.parse().ok()).filter(|id| mesh.regions.contains(id));
        let Some(region) = region else {
            let known: BTreeSet<u32> = mesh.regions.iter().copied().collect();
            let known: Vec<String> = known
                .iter()
                .map(|id| match mesh.region_names.get(id) {
                    Some(region_name) => format!("{id} ({region_name})"),
                    None => id.to_string(),
                })
                .collect();
            let message =
                format!("no tetrahedron lies in this region; the mesh has regions {}", known.join(", "));
            return Err(scene.invalid(&format!("body.{name}.region.{key}"), message).into());
        };
        if by_region.insert(region, lame(material)).is_some() {
            let message = format!("region {region} is given a material twice, by its number and by its name");
            return Err(scene.invalid(&format!("body.{name}.region.{key}"), message).into());
        }
    }
    let other = lame(&body.material);
    Ok(mesh.regions.iter().map(|region| *by_region.get(region).unwrap_or(&other)).collect())
}
