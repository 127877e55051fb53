//! A body made ready to be solved: its mesh, control elements and materials, and all that was found wrong or odd.

use super::check;
use super::control::ControlElement;
use super::error::GreenError;
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::extent::bounding_box;
use crate::fem::Lame;
use crate::mesh::{LoadedMesh, TetMesh};
use crate::scene::{Body, Material, Nodes, Scene, SceneError};
use std::collections::{BTreeMap, BTreeSet};

/// A body before anything is assembled.
pub struct Prepared {
    pub mesh: TetMesh,
    pub controls: Vec<ControlElement>,
    /// Lamé's constants per tetrahedron.
    pub lame: Vec<Lame>,
    /// Most severe first. With an error among them the body must not be solved.
    pub findings: Vec<Diagnostic>,
}

/// Judgement of a model about a body that is not solved yet: an error where it refuses the body, a warning where it may.
pub type Fits = fn(&Prepared) -> Result<(), (Severity, String)>;

/// Loads body `name` and judges it without solving. Errors where it cannot even be judged: no mesh, a selection that
/// is empty, a region that is not there.
pub fn prepare(scene: &Scene, name: &str) -> Result<Prepared, GreenError> {
    prepare_mesh(scene, name, scene.load_mesh(name, &scene.body[name])?)
}

/// [`prepare`] with another mesh than that of the body's file or generator.
pub fn prepare_mesh(scene: &Scene, name: &str, loaded: LoadedMesh) -> Result<Prepared, GreenError> {
    let body = &scene.body[name];
    let mesh = loaded.mesh;
    let controls = control_elements(scene, name, body, &mesh)?;
    let lame = materials(scene, name, body, &mesh)?;
    let entity = format!("body.{name}");
    let mut findings: Vec<Diagnostic> =
        loaded.notices.into_iter().map(|notice| Diagnostic::new(Severity::Note, &entity, notice)).collect();
    findings.extend(check::mesh(&entity, &mesh, &body.material));
    findings.extend(check::support(&entity, &mesh, &controls));
    findings.extend(check::materials(&entity, body, &mesh, &controls, &lame));
    findings.extend(check::walls(&entity, body, &mesh));
    findings.sort_by_key(|finding| finding.severity);
    Ok(Prepared { mesh, controls, lame, findings })
}

fn control_elements(
    scene: &Scene,
    name: &str,
    body: &Body,
    mesh: &TetMesh,
) -> Result<Vec<ControlElement>, GreenError> {
    let (low, high) = bounding_box(&mesh.nodes);
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
    let all: Vec<Lame> = body.materials().map(Material::lame).collect();
    Ok(materials_of_tets(scene, name, body, mesh)?.into_iter().map(|number| all[number]).collect())
}

/// All that keeps body `name` from being judged at all: its mesh, or else every selection and region that is not there.
pub fn unjudged(scene: &Scene, name: &str) -> Vec<SceneError> {
    let body = &scene.body[name];
    let mesh = match scene.load_mesh(name, body) {
        Ok(loaded) => loaded.mesh,
        Err(error) => return vec![error],
    };
    let empty = |(key, nodes): (String, &Nodes)| {
        Some(scene.invalid(&format!("body.{name}.{key}"), nodes.select(&mesh).err()?))
    };
    let mut found: Vec<SceneError> = body.selections().into_iter().filter_map(empty).collect();
    found.extend(regions(scene, name, body, &mesh).into_iter().filter_map(Result::err));
    found
}

/// Index of each tetrahedron's material among [`Body::materials`].
pub fn materials_of_tets(
    scene: &Scene,
    name: &str,
    body: &Body,
    mesh: &TetMesh,
) -> Result<Vec<usize>, GreenError> {
    let regions = regions(scene, name, body, mesh).into_iter().collect::<Result<Vec<u32>, SceneError>>()?;
    let by_region: BTreeMap<u32, usize> = regions.into_iter().zip(1..).collect();
    Ok(mesh.regions.iter().map(|region| *by_region.get(region).unwrap_or(&0)).collect())
}

/// The density of each tetrahedron, kg/m³; 0 where its material has none.
pub fn densities_of_tets(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<Vec<f64>, GreenError> {
    let body = &scene.body[name];
    let of_material: Vec<f64> = body.materials().map(|material| material.density.unwrap_or(0.0)).collect();
    let numbers = materials_of_tets(scene, name, body, mesh)?;
    Ok(numbers.into_iter().map(|number| of_material[number]).collect())
}

/// The mesh's region for each region of the body, or why there is none.
fn regions(scene: &Scene, name: &str, body: &Body, mesh: &TetMesh) -> Vec<Result<u32, SceneError>> {
    let regions: BTreeSet<u32> = mesh.regions.iter().copied().collect();
    let called = |id: u32| mesh.region_names.get(&id);
    let listed = |regions: &mut dyn Iterator<Item = u32>| -> String {
        let told = |id: u32| called(id).map_or(id.to_string(), |name| format!("{id} ({name})"));
        regions.map(told).collect::<Vec<_>>().join(", ")
    };
    let mut taken = BTreeSet::new();
    let of_key = |key: &String| {
        let wrong = |message: String| Err(scene.invalid(&format!("body.{name}.region.{key}"), message));
        let meant: Vec<u32> =
            regions.iter().copied().filter(|id| called(*id) == Some(key) || key.parse() == Ok(*id)).collect();
        match meant[..] {
            [region] if taken.insert(region) => Ok(region),
            [region] => {
                let region = listed(&mut [region].into_iter());
                wrong(format!(
                    "region {region} is given a material twice, by its number and by its name: use one of them"
                ))
            }
            [] => {
                let known = listed(&mut regions.iter().copied());
                wrong(format!("no tetrahedron lies in this region; the mesh has regions {known}"))
            }
            [..] => wrong(format!(
                "several regions of the mesh have this name or number: {}; name each by what it alone has, or rename \
                 one in the mesh",
                listed(&mut meant.into_iter())
            )),
        }
    };
    body.region.keys().map(of_key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    /// Young's moduli of a block whose tetrahedra lie in the regions 3, called "7", 7, called "core", and 9, or the error.
    fn young(regions: &str) -> Result<Vec<f64>, String> {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        mesh.regions = (0..mesh.tets.len()).map(|tet| [3, 7, 9][tet % 3]).collect();
        mesh.region_names = [(3, "7".to_owned()), (7, "core".to_owned())].into();
        let scene = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0 }}\n{regions}\n\
             control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
        );
        let scene = Scene::parse(&scene, std::path::Path::new("any.toml")).unwrap();
        let loaded = LoadedMesh { mesh, notices: Vec::new() };
        let prepared = prepare_mesh(&scene, "a", loaded).map_err(|error| error.to_string())?;
        // With ν = 0, E = 2 μ.
        Ok(prepared.lame[..3].iter().map(|lame| 2.0 * lame.mu).collect())
    }

    #[test]
    fn a_region_is_meant_by_its_name_or_number_and_never_by_both() {
        let of = |key: &str, young: f64| format!("region.{key} = {{ young = {young:.1}, poisson = 0.0 }}");
        assert_eq!(young(&of("core", 2.0)).unwrap(), [1.0, 2.0, 1.0]);
        assert_eq!(young(&of("3", 2.0)).unwrap(), [2.0, 1.0, 1.0]);
        assert_eq!(young(&of("9", 2.0)).unwrap(), [1.0, 1.0, 2.0]);
        let error = young(&of("7", 2.0)).unwrap_err();
        assert!(error.contains("body.a.region.7") && error.contains("3 (7), 7 (core);"), "{error}");
        let error = young(&of("8", 2.0)).unwrap_err();
        assert!(error.contains("the mesh has regions 3 (7), 7 (core), 9"), "{error}");
    }
}
