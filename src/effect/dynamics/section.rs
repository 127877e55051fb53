//! The section of the .green file: modes with all control elements held, and the masses that join them with the elements.
//!
//! In: a body assembled and factorised, its densities. Out, with the columns W = (U, Φ) of the 12E affine fields u⁽ᵏ⁾ and m modes φ
//! (R. Craig and M. Bampton, Coupling of substructures for dynamic analyses, AIAA Journal 6, 1968, 1313-1319):
//!
//! ```text
//! dynamics/basis, /scale   Φ on the surface, φᵀMφ = 1         m × nodes × 3, 1/√kg
//! dynamics/squares         ω², (rad/s)²                       m
//! dynamics/mass            WᵀMW: M̂_cc, φᵀMu, 1                (12E + m)²
//! dynamics/frame           WᵀMX                               12 × (12E + m)
//! dynamics/whole           XᵀMX: mass, its first and second moments     12 × 12
//! ```
//!
//! X are the twelve affine fields of the body as a whole about the file's centre, in the order of the coefficients.

use super::settings::{NAME, Settings};
use crate::base::extent::bounding_box;
use crate::base::machine;
use crate::deform::{Kind, ModelEntry, REDUCED, REDUCED_NEO_HOOKEAN, ROD};
use crate::effect::entry::{Resolved, ResolvedBody};
use crate::fem::dense_fields::{beside, rows};
use crate::fem::{NodeFields, StiffnessMatrix, consistent_mass};
use crate::green::{
    Assembled, FIELDS, GreenError, Precomputed, Solution, Tensor, columns_of_effect, densities_of_tets,
};
use crate::mesh::TetMesh;
use crate::scene::{Body, Scene, SceneError};
use crate::solve::{MODE_RESIDUAL, Progress, Silent, SolveError, lowest_modes};
use nalgebra::{DMatrix, Vector3};
use std::f64::consts::TAU;

/// Tables that wait in the solution until they are written: Φ over all nodes, and those of the file.
const SHAPES: &str = "dynamics/shapes";
const TABLES: [(&str, &str); 4] = [
    ("dynamics/squares", SQUARES),
    ("dynamics/mass", MASS),
    ("dynamics/frame", FRAME),
    ("dynamics/whole", WHOLE),
];
pub const SQUARES: &str = "squares";
pub const MASS: &str = "mass";
pub const FRAME: &str = "frame";
pub const WHOLE: &str = "whole";

/// Models other than `linear` in which an element that is let go from a large bend swings as it should, as the tests measure.
pub const SWINGING: [&ModelEntry; 3] = [&REDUCED, &REDUCED_NEO_HOOKEAN, &ROD];

/// Solves for the modes with the body's factor, and leaves all tables in the solution.
pub fn solve(
    scene: &Resolved,
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let settings = Settings::of(&scene.bodies[assembled.name]);
    let mesh = &solution.mesh;
    let count = settings.modes.min(3 * assembled.partition.free.len());
    expect(assembled, mesh, count)?;
    progress.begin("modes of vibration", 0);
    let mass = consistent_mass(mesh, &densities_of_tets(scene, assembled.name, mesh)?);
    let (squares, shapes) = modes(&settings, assembled, mesh, &mass)?;
    let whole = whole_fields(mesh);
    let all = beside(&[&solution.fields, &shapes]);
    let by_mass = |fields: &NodeFields| {
        let mut product = NodeFields::zeros(fields.nodes, fields.columns);
        mass.multiply(fields, &mut product);
        product
    };
    let of_whole = by_mass(&whole);
    let mut of_all = rows(&all) * rows(&by_mass(&all)).transpose();
    of_all = (&of_all + of_all.transpose()) * 0.5;
    let fields = solution.fields.columns;
    // That they are orthonormal is known to more digits than the products show.
    of_all.view_mut((fields, fields), (shapes.columns, shapes.columns)).fill_with_identity();
    let made = [
        DMatrix::from_column_slice(squares.len(), 1, &squares),
        of_all,
        rows(&all) * rows(&of_whole).transpose(),
        rows(&whole) * rows(&of_whole).transpose(),
    ];
    solution.tables.insert(SHAPES, rows(&shapes).transpose());
    solution.tables.extend(TABLES.iter().map(|(name, _)| *name).zip(made));
    progress.end();
    Ok(())
}

/// The tensors of the section.
pub fn precompute(
    scene: &Resolved,
    body: &mut Precomputed,
    _: &dyn Progress,
) -> Result<Vec<(String, Tensor)>, GreenError> {
    let missing = || {
        let message = "the body was solved without its modes of vibration";
        scene.invalid(&format!("body.{}.effects", body.name), message)
    };
    let table = |name: &str| body.solution.tables.get(name).ok_or_else(missing);
    let shapes = table(SHAPES)?;
    let mut tensors = match shapes.ncols() {
        0 => Vec::new(),
        count => columns_of_effect(body, count, &|row, column| shapes[(row, column)]),
    };
    for (name, tensor) in TABLES {
        let table = table(name)?;
        let shape = [table.ncols(), table.nrows()];
        tensors.push((tensor.to_owned(), Tensor::new(&shape, table.iter().copied())));
    }
    Ok(tensors)
}

/// Refuses a body that can have no dynamics.
pub fn suits(scene: &Scene, name: &str, body: &Body, resolved: &ResolvedBody) -> Result<(), SceneError> {
    let (settings, model) = (Settings::of(resolved), resolved.model);
    let wrong = |key: &str, message: String| Err(scene.invalid(&format!("body.{name}.{key}"), message));
    if let Err(message) = settings.free_of(body) {
        return wrong("effect.dynamics.free", message);
    }
    if let Kind::Background(law) = model.kind {
        let message = format!(
            "\"{NAME}\" adds modes to a model that follows in every frame, and \"{}\" is solved anew: write model = \
             \"linear\", \"rotation\" or \"reduced\"",
            law.name
        );
        return wrong("model", message);
    }
    if model.energy.is_none() && !settings.free.is_empty() {
        let message = format!("the model \"{}\" has no forces that could bring an element back", model.name);
        return wrong("effect.dynamics.free", message);
    }
    if !settings.free.is_empty() && body.control.len() > 1 && !model.is_linear() {
        if !SWINGING.contains(&model) {
            let message = format!(
                "an element that is let go does not swing reliably in \"{}\": write model = \"{}\", or leave free out",
                model.name,
                SWINGING.map(|model| model.name).join("\" or \"")
            );
            return wrong("effect.dynamics.free", message);
        }
        if settings.free_of(body).is_ok_and(|free| !free.contains(&false)) {
            let message = format!(
                "all elements of the body are released: in \"{}\" one at least must stay held. Take one out of free, or write \
                 model = \"linear\"",
                model.name
            );
            return wrong("effect.dynamics.free", message);
        }
    }
    if body.materials().any(|material| material.density.is_none()) {
        let message = format!(
            "\"{NAME}\" needs the density of every material of the body: write density = 1000 (kg/m³) into it, or name a \
             material of `greenstage manual materials`"
        );
        return wrong("effects", message);
    }
    Ok(())
}

/// Takes the memory for K's share at the free nodes, M twice, and the blocks of the iteration with M times each.
fn expect(assembled: &Assembled<'_>, mesh: &TetMesh, count: usize) -> Result<(), GreenError> {
    let matrices = 3.0 * 8.0 * assembled.k.scalar_entries() as f64;
    let columns = (2 * (4 * count + 40) + 4 * count) as f64;
    machine::expect("the modes of vibration", matrices + 24.0 * columns * mesh.nodes.len() as f64)
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })
}

/// ω² and φ over all nodes, zero on all control elements.
fn modes(
    settings: &Settings,
    assembled: &Assembled<'_>,
    mesh: &TetMesh,
    mass: &StiffnessMatrix,
) -> Result<(Vec<f64>, NodeFields), GreenError> {
    let partition = assembled.partition;
    let (a, m) = (partition.a(assembled.k), partition.a(mass));
    let found = lowest_modes(&a, &m, settings.modes, &|b| (assembled.solve)(b, &Silent))?;
    if let Some((mode, residual)) = found.worst() {
        let hertz = found.squares[mode].max(0.0).sqrt() / TAU;
        let source = SolveError::Mode { mode: mode + 1, hertz, residual, limit: MODE_RESIDUAL };
        return Err(GreenError::Solve { body: assembled.place.to_owned(), source });
    }
    let count = found.squares.iter().take_while(|square| settings.takes(**square)).count();
    let mut shapes = NodeFields::zeros(mesh.nodes.len(), count);
    for (from, &to) in partition.free.iter().enumerate() {
        for axis in 0..3 {
            let row = &found.shapes.row(3 * from + axis)[..count];
            shapes.row_mut(3 * to as usize + axis).copy_from_slice(row);
        }
    }
    Ok((found.squares[..count].to_vec(), shapes))
}

/// X: the affine fields of the whole body about the file's centre.
fn whole_fields(mesh: &TetMesh) -> NodeFields {
    let (low, high) = bounding_box(&mesh.nodes);
    let centre: Vector3<f64> = low + (high - low) * 0.5;
    let mut fields = NodeFields::zeros(mesh.nodes.len(), FIELDS);
    for (node, x) in mesh.nodes.iter().enumerate() {
        let offset = x - centre;
        for axis in 0..3 {
            let row = fields.row_mut(3 * node + axis);
            row[axis] = 1.0;
            row[3 + 3 * axis..6 + 3 * axis].copy_from_slice(offset.as_slice());
        }
    }
    fields
}
