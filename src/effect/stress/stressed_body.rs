//! A body's surface, the materials behind it and the stress they bear, from a .green file or a mesh.
//!
//! [`LoadedFaces`] holds the tractions of loads on the triangles of the surface, because a load's traction is a stress that
//! no strain shows. [`Peaks`] are the largest stress and strain that a body has reached, and the part of its surface where a
//! limit is passed.

use crate::base::quantity::quantity;
use crate::deform::{Deformer, FaceLoads, ModelEntry, NodeStress, Strain, SurfaceParts, SurfaceStress};
use crate::effect::entry::Resolved;
use crate::fem::Lame;
use crate::green;
use crate::green::{GreenError, GreenFile, LoadMeta, Precomputed, Tensor, Tractions, Turning};
use crate::mesh::{Surface, TetMesh};
use crate::scene::{Body, Limit, LoadSource, Material, Quantity, Scene};
use crate::solve::Progress;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

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
        let (surface, of_body) = (Surface::from_mesh(mesh), (&scene.body[name], scene.bodies[name].model));
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

/// Tensor of the indices of the patterns' columns among the body's load columns.
const COLUMNS: &str = "load";
/// Tensor of the patterns' tractions, column by column.
const TRACTIONS: &str = "traction";

/// The tractions of all patterns of a body: of each column at every triangle, Pa for a coefficient of 1, kept in the section
/// of the .green file.
#[derive(Debug, Default)]
pub struct LoadedFaces(Vec<Column>);

#[derive(Debug)]
struct Column {
    /// Number among the body's load columns.
    number: usize,
    /// Whether it turns with the body.
    follows: bool,
    of_triangles: Vec<Vector3<f64>>,
}

impl LoadedFaces {
    pub fn of_mesh(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<LoadedFaces, GreenError> {
        let mut columns = Vec::new();
        let mut number = 0;
        let mut surface = None;
        for load in scene.body[name].loads() {
            let first = number;
            number += load.source.columns();
            let LoadSource::Pattern(pattern) = load.source else { continue };
            let tractions = Tractions::new(scene, mesh, pattern)
                .map_err(|message| scene.invalid(&format!("body.{name}.load.{}", load.name), message))?;
            let surface = surface.get_or_insert_with(|| Surface::from_mesh(mesh));
            let follows = LoadMeta::new(&load).turning == Turning::Follows;
            let of_columns = tractions.at_triangles(mesh, surface).into_iter().enumerate();
            columns.extend(of_columns.map(|(k, of_triangles)| Column {
                number: first + k,
                follows,
                of_triangles,
            }));
        }
        Ok(LoadedFaces(columns))
    }

    /// Tensors for the section of the file; none without patterns.
    pub fn tensors(&self) -> Vec<(String, Tensor)> {
        let Some(first) = self.0.first() else { return Vec::new() };
        let numbers: Vec<u32> = self.0.iter().map(|column| column.number as u32).collect();
        let shape = [numbers.len(), first.of_triangles.len(), 3];
        let values = self.0.iter().flat_map(|column| column.of_triangles.iter().flat_map(|t| t.iter()));
        let values: Vec<f32> = values.map(|value| *value as f32).collect();
        vec![
            (COLUMNS.into(), Tensor::new(&[numbers.len()], numbers)),
            (TRACTIONS.into(), Tensor::new(&shape, values)),
        ]
    }

    /// Reads the section of this name in a file of this scene. The error names a tensor that does not suit the body.
    pub fn of_file(
        scene: &Scene,
        file: &GreenFile,
        name: &str,
        section: &str,
    ) -> Result<LoadedFaces, GreenError> {
        let has_patterns =
            scene.body[name].loads().iter().any(|load| matches!(load.source, LoadSource::Pattern(_)));
        if !has_patterns {
            return Ok(LoadedFaces::default());
        }
        let (_, numbers) = file.section::<u32>(name, section, COLUMNS)?;
        let (_, values) = file.section::<f32>(name, section, TRACTIONS)?;
        let metas = file.meta.bodies.get(name).map_or(&[][..], |meta| &meta.loads);
        let turnings: Vec<Turning> =
            metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns)).collect();
        let triangles = file.triangles(name).len();
        let fits = values.len() == 3 * triangles * numbers.len()
            && numbers.iter().all(|&number| (number as usize) < turnings.len())
            && values.iter().all(|value| value.is_finite());
        if !fits || triangles == 0 {
            let reason =
                format!("tensor {name}/{section}/{TRACTIONS} does not hold tractions of the body's loads");
            return Err(GreenError::Damaged { path: file.path.clone(), reason });
        }
        let vector = |value: &[f32]| Vector3::new(value[0], value[1], value[2]).cast::<f64>();
        let column = |(&number, values): (&u32, &[f32])| Column {
            number: number as usize,
            follows: turnings[number as usize] == Turning::Follows,
            of_triangles: values.chunks_exact(3).map(vector).collect(),
        };
        Ok(LoadedFaces(numbers.iter().zip(values.chunks_exact(3 * triangles)).map(column).collect()))
    }

    /// The tractions for the coefficients of all load columns of the body.
    pub fn at(&self, coefficients: &[f64]) -> FaceLoads {
        let mut loads = FaceLoads::default();
        for column in &self.0 {
            let coefficient = coefficients.get(column.number).copied().unwrap_or(0.0);
            if coefficient == 0.0 {
                continue;
            }
            let sum = if column.follows { &mut loads.follows } else { &mut loads.fixed };
            sum.resize(column.of_triangles.len(), Vector3::zeros());
            sum.iter_mut().zip(&column.of_triangles).for_each(|(sum, t)| *sum += t * coefficient);
        }
        loads
    }
}

/// Part of the peak at an edge above which the largest stress elsewhere is not reported separately.
const ALIKE: f64 = 0.9;

/// The loads on a surface beside control elements.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurfaceLoads<'a> {
    /// Coefficients of all load columns of the body, in the frame of its displacements.
    pub coefficients: &'a [f64],
    /// Nodes of the surface that bear forces of their own.
    pub points: &'a [u32],
}

/// Peaks of one body in one shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peaks {
    /// The largest values at nodes, and the nodes that have them: Pa, and a ratio.
    pub von_mises: (f64, usize),
    pub strain: (f64, usize),
    /// The largest part of a limit, with that limit; `None` without limits.
    pub limit: Option<(f64, Limit)>,
    /// Part of the surface, control elements left out, in which a limit is passed.
    pub passed: f64,
    /// `von_mises` and `limit` away from the edges of control elements ([`StressedBody::is_edge`]).
    pub inside: Inside,
}

/// Peaks away from the edges of control elements, where stress is a peak of the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inside {
    /// Pa.
    pub von_mises: f64,
    /// The largest part of a limit, with that limit; `None` without limits.
    pub limit: Option<(f64, Limit)>,
}

/// The part of its limit that a node has reached, by the limits of all materials.
fn part(at: &NodeStress, limits: &[Option<Limit>]) -> Option<(f64, Limit)> {
    let limit = limits.get(usize::from(at.material)).copied().flatten()?;
    let value = match limit {
        Limit::Stress(_) => at.von_mises,
        Limit::Strain(_) => at.strain,
    };
    Some((value / limit.value(), limit))
}

/// The part of its limit that a node has reached; 0 without one.
pub fn share(at: &NodeStress, limits: &[Option<Limit>]) -> f64 {
    part(at, limits).map_or(0.0, |(part, _)| part)
}

impl StressedBody {
    /// Stress at every node of the surface, for its displacements `u` where warmth lengthens what is free by `stretch`, under
    /// loads; `None` inside control elements, and at nodes that bear a force of their own, whose stress has no bound.
    pub fn at_nodes(
        &self,
        u: &[Vector3<f64>],
        stretch: f64,
        of: Strain,
        loads: &SurfaceLoads<'_>,
    ) -> Vec<Option<NodeStress>> {
        // Where no limit tells, the larger stress does.
        let order = |at: &NodeStress| part(at, &self.limits).map_or(at.von_mises * 1e-100, |(part, _)| part);
        let faces = self.loads.at(loads.coefficients);
        let mut found = self.surface.at_nodes(u, stretch, of, &faces, order);
        for &node in loads.points {
            found.get_mut(node as usize).into_iter().for_each(|at| *at = None);
        }
        found
    }

    /// Stress at every node of the surface of a deformed body.
    pub fn stress(&self, body: &Deformer) -> Vec<Option<NodeStress>> {
        let u: Vec<Vector3<f64>> = (0..body.node_count()).map(|i| body.straining_part(i)).collect();
        let of = match self.is_of_small_strain && body.part_weights().is_none() {
            true => Strain::Small,
            false => Strain::Finite,
        };
        let points = body.loaded_nodes();
        let loads = SurfaceLoads { coefficients: &body.load_coefficients(), points: &points };
        self.at_nodes(&u, body.free_stretch(), of, &loads)
    }

    pub fn reached(&self, nodes: &[Option<NodeStress>]) -> Peaks {
        let mut reached = Peaks::default();
        let (mut passed, mut whole) = (0.0, 0.0);
        let larger = |of: Option<(f64, Limit)>, than: Option<(f64, Limit)>| {
            of.is_some_and(|(part, _)| than.is_none_or(|(most, _)| part > most))
        };
        for ((i, at), area) in nodes.iter().enumerate().zip(&self.surface.areas) {
            let Some(at) = at else { continue };
            if at.von_mises > reached.von_mises.0 {
                reached.von_mises = (at.von_mises, i);
            }
            if at.strain > reached.strain.0 {
                reached.strain = (at.strain, i);
            }
            let of_limit = part(at, &self.limits);
            if larger(of_limit, reached.limit) {
                reached.limit = of_limit;
            }
            if !self.is_edge[i] {
                let inside = &mut reached.inside;
                inside.von_mises = inside.von_mises.max(at.von_mises);
                if larger(of_limit, inside.limit) {
                    inside.limit = of_limit;
                }
            }
            whole += area;
            passed += if of_limit.is_some_and(|(part, _)| part > 1.0) { *area } else { 0.0 };
        }
        // Of a body without any other node, what there is.
        if reached.inside.von_mises == 0.0 {
            reached.inside = Inside { von_mises: reached.von_mises.0, limit: reached.limit };
        }
        reached.passed = if whole > 0.0 { passed / whole } else { 0.0 };
        reached
    }
}

impl Peaks {
    pub fn is_beyond(&self) -> bool {
        self.limit.is_some_and(|(part, _)| part > 1.0)
    }

    /// `von Mises stress at most 412 MPa, largest strain 0.2 %`, and how it stands with the limit.
    pub fn sentence(&self) -> String {
        let stress = quantity(self.von_mises.0, Quantity::VonMises.unit());
        let strain = quantity(self.strain.0, Quantity::Strain.unit());
        let most = format!("von Mises stress at most {stress}{}, largest strain {strain}", self.peak());
        match self.limit {
            Some((part, limit)) if part > 1.0 => format!("{most}; {}", self.passing(limit)),
            Some((part, limit)) => {
                format!("{most}, {} of its limit of {}", quantity(part, ""), written(limit))
            }
            None => most,
        }
    }

    /// Words about the peak elsewhere, if the largest stress is at the edge of a control element.
    fn peak(&self) -> String {
        if self.inside.von_mises >= ALIKE * self.von_mises.0 {
            return String::new();
        }
        let elsewhere = quantity(self.inside.von_mises, Quantity::VonMises.unit());
        format!(" at the edge of a control element, {elsewhere} elsewhere")
    }

    /// The largest value against this limit, and the part of the surface in which the limit is passed.
    fn value_and_passed(&self, limit: Limit) -> [String; 2] {
        let value = self.limit.map_or(0.0, |(part, _)| part) * limit.value();
        let passed = match self.passed {
            passed if passed < 1e-3 => "less than 0.1 %".to_owned(),
            passed => quantity(passed, ""),
        };
        [quantity(value, limit.quantity().unit()), passed]
    }

    /// Short words for a legend: `412 MPa, limit 250 MPa PASSED in 3 % of the surface`.
    pub fn brief(&self, limit: Limit) -> String {
        let [value, passed] = self.value_and_passed(limit);
        format!("{value}, limit {} PASSED in {passed} of the surface", written(limit))
    }

    /// `above its 250 MPa limit on 3 % of the surface (peak 412 MPa)`.
    pub fn passing(&self, limit: Limit) -> String {
        let [value, passed] = self.value_and_passed(limit);
        format!("above its {} limit on {passed} of the surface (peak {value})", written(limit))
    }
}

/// A limit with its unit.
pub fn written(limit: Limit) -> String {
    quantity(limit.value(), limit.quantity().unit())
}
