//! The body in the pose in which the scene's own setting is furthest off, as some of the settings bend it: for the page's picture.

use super::candidate::Candidate;
use super::candidates::Meshes;
use super::fields::stored;
use super::pose_errors::Compared;
use super::reference::References;
use crate::deform::ModelEntry;
use crate::mesh::Surface;
use crate::report::data::{Measurement, Setting, Shapes};
use crate::scene::Storage;
use nalgebra::Vector3;

/// `None` where none of the rows can be drawn.
pub fn of(
    meshes: &Meshes,
    candidates: &[Candidate],
    references: &References<'_>,
    rows: &[Measurement],
    shown: &[usize],
    own: &Setting,
) -> Option<Shapes> {
    let settings: Vec<(usize, Drawn<'_>)> =
        shown.iter().filter_map(|&i| Some((i, Drawn::new(candidates, &rows[i].setting)?))).collect();
    let judged = settings.iter().find(|(i, _)| rows[*i].setting == *own).or_else(|| settings.first())?;
    let mut worst: Option<(usize, f64)> = None;
    for (p, pose) in references.poses.iter().enumerate() {
        let compared = Compared { meshes, candidates, candidate: judged.1.candidate, references };
        let (_, errors) = compared.field(judged.1.model, &judged.1.rounded, pose)?;
        if worst.is_none_or(|(_, most)| errors.displacement_m > most) {
            worst = Some((p, errors.displacement_m));
        }
    }
    let pose = &references.poses[worst?.0];
    let mesh = &meshes.linear[0];
    let surface = Surface::of(mesh);
    let on_surface = |field: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        surface.nodes.iter().map(|&node| field[node as usize]).collect()
    };
    let errors = settings.iter().filter_map(|(i, drawn)| {
        let compared = Compared { meshes, candidates, candidate: drawn.candidate, references };
        let (field, _) = compared.field(drawn.model, &drawn.rounded, pose)?;
        Some((*i, on_surface(&field)))
    });
    let bent: Vec<Vector3<f64>> = mesh.nodes.iter().zip(&pose.displacement).map(|(x, u)| x + u).collect();
    Some(Shapes {
        pose: pose.name.clone(),
        errors: errors.collect(),
        equilibrium: on_surface(&bent),
        triangles: surface.triangles,
    })
}

/// A setting with what it was computed from.
struct Drawn<'a> {
    candidate: &'a Candidate,
    model: &'static ModelEntry,
    rounded: Vec<Vec<f64>>,
}

impl<'a> Drawn<'a> {
    fn new(candidates: &'a [Candidate], setting: &Setting) -> Option<Drawn<'a>> {
        let model = setting.model;
        let storage = Storage::named(&setting.storage)?;
        let is_own = |of: &&Candidate| {
            (of.refine, of.element.name, of.solver) == (setting.refine, &setting.element, setting.solver)
                && of.models.contains(&model)
        };
        let candidate = candidates.iter().find(is_own)?;
        Some(Drawn { candidate, model, rounded: stored(&candidate.solution, storage) })
    }
}
