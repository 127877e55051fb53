//! A body's surface, the materials behind it and what they bear, from a .green file or a mesh.

use super::loaded_faces::LoadedFaces;
use crate::deform::{ModelEntry, SurfaceParts, SurfaceStress};
use crate::effect::entry::Resolved;
use crate::fem::Lame;
use crate::green::{self, GreenError, GreenFile, Precomputed, Tensor};
use crate::mesh::{Surface, TetMesh};
use crate::scene::{Body, Limit, Material, Scene};
use crate::solve::Progress;

/// The effect's name in scenes.
pub const NAME: &str = "stress";

/// A tensor of the section: of each triangle its material, as [`Body::materials`] counts them; empty where there is one.
const TENSOR: &str = "material";

/// Materials of a body that the section can number.
const MOST: usize = 256;

pub(super) fn section(
    scene: &Resolved,
    body: &mut Precomputed,
    _: &dyn Progress,
) -> Result<Vec<(String, Tensor)>, GreenError> {
    let numbers = of_triangles(scene, &body.name, &body.solution.mesh)?;
    let mut tensors = vec![(TENSOR.to_owned(), Tensor::new(&[numbers.len()], numbers))];
    tensors.extend(LoadedFaces::of_mesh(scene, &body.name, &body.solution.mesh)?.tensors());
    Ok(tensors)
}

/// The material behind each triangle of the mesh's surface; empty where the body has one.
fn of_triangles(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<Vec<u8>, GreenError> {
    let body = &scene.body[name];
    if body.region.is_empty() {
        return Ok(Vec::new());
    }
    if body.region.len() >= MOST {
        let message = format!("the effect {NAME} distinguishes up to {} regions", MOST - 1);
        return Err(scene.invalid(&format!("body.{name}.region"), message).into());
    }
    let of_tets = green::materials_of_tets(scene, name, body, mesh)?;
    Ok(Surface::tets_behind(mesh).into_iter().map(|tet| of_tets[tet as usize] as u8).collect())
}

/// A body's surface with its materials and what they bear.
pub struct StressedBody {
    pub surface: SurfaceStress,
    /// The limit of each material.
    pub limits: Vec<Option<Limit>>,
    /// Whether each node is held, or within an element of one that is. There the body is held by a sharp edge, at which the
    /// stress of an elastic body has no bound, so that it grows with a finer mesh.
    pub is_edge: Vec<bool>,
    /// Whether its model moves the surface as the theory of small strain does.
    pub is_of_small_strain: bool,
    /// The tractions of its loads on its surface.
    pub loads: LoadedFaces,
}

impl StressedBody {
    /// Reads a body from a .green file; its model moves the surface. Fails if the section is damaged.
    pub fn of_file(scene: &Resolved, file: &GreenFile, name: &str) -> Result<StressedBody, GreenError> {
        let (body, model) = (&scene.body[name], scene.bodies[name].model);
        let (_, material) = file.section::<u8>(name, NAME, TENSOR)?;
        let triangles = file.triangles(name);
        let count = body.materials().count();
        let fits = material.is_empty() || material.len() == triangles.len();
        if !fits || material.iter().any(|&number| usize::from(number) >= count) {
            let reason = format!("tensor {name}/{NAME}/{TENSOR} does not number the body's materials");
            return Err(GreenError::Damaged { path: file.path.clone(), reason });
        }
        let held: Vec<Vec<u32>> =
            body.control.keys().map(|control| file.control(name, control).to_vec()).collect();
        let loads = LoadedFaces::of_file(scene, file, name, NAME)?;
        Ok(StressedBody::new((body, model), file.rest(name), triangles, material, &held, loads))
    }

    /// The surface and stress of a mesh that is solved anew; `held` are nodes of the mesh.
    pub fn of_mesh(
        scene: &Resolved,
        name: &str,
        mesh: &TetMesh,
        held: &[&[u32]],
    ) -> Result<(Surface, StressedBody), GreenError> {
        let (surface, of_body) = (Surface::of(mesh), (&scene.body[name], scene.bodies[name].model));
        let material = of_triangles(scene, name, mesh)?;
        let on_surface = |nodes: &&[u32]| -> Vec<u32> {
            nodes.iter().filter_map(|node| Some(surface.nodes.binary_search(node).ok()? as u32)).collect()
        };
        let held: Vec<Vec<u32>> = held.iter().map(on_surface).collect();
        let Some(first) = surface.nodes.first().map(|&node| mesh.nodes[node as usize]) else {
            let none = StressedBody::new(of_body, &[], &[], &[], &[], LoadedFaces::default());
            return Ok((surface, none));
        };
        let about = |&node: &u32| (mesh.nodes[node as usize] - first).cast::<f32>().into();
        let rest: Vec<[f32; 3]> = surface.nodes.iter().map(about).collect();
        let loads = LoadedFaces::of_mesh(scene, name, mesh)?;
        let body = StressedBody::new(of_body, &rest, &surface.triangles, &material, &held, loads);
        Ok((surface, body))
    }

    fn new(
        (body, model): (&Body, &ModelEntry),
        rest: &[[f32; 3]],
        triangles: &[[u32; 3]],
        material: &[u8],
        held: &[Vec<u32>],
        loads: LoadedFaces,
    ) -> StressedBody {
        let lame: Vec<Lame> = body.materials().map(Material::lame).collect();
        let is_of_small_strain = model.is_of_small_strain();
        let parts = SurfaceParts { rest, triangles, material, lame: &lame, held, law: model.free_face() };
        let limits = body.materials().map(|material| material.limit).collect();
        let is_edge = edges(rest.len(), triangles, held, body.element.order);
        StressedBody { surface: SurfaceStress::new(&parts), limits, is_edge, is_of_small_strain, loads }
    }
}

/// Marks the nodes that are held, and those up to `rings` triangles away: elements have as many along an edge.
fn edges(nodes: usize, triangles: &[[u32; 3]], held: &[Vec<u32>], rings: u32) -> Vec<bool> {
    let mut is_edge = vec![false; nodes];
    held.iter().flatten().for_each(|&node| is_edge[node as usize] = true);
    for _ in 0..rings {
        let before = is_edge.clone();
        for triangle in triangles.iter().filter(|corners| corners.iter().any(|&node| before[node as usize])) {
            triangle.iter().for_each(|&node| is_edge[node as usize] = true);
        }
    }
    is_edge
}
