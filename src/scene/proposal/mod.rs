//! Proposes a scene that can be shown at once for a mesh or surface file, with the reason for every choice.
//!
//! In: the file, the path of the scene, and [`Wishes`]. Out: a [`Proposal`]: the scene, the comments with which it is
//! written, and every guess in words; or the question which unit the file is in ([`UnitDoubt`]).

pub mod choice;
mod doubt;
mod ends;
mod filling;
mod grouped;
pub mod pull;
mod telling;
mod tools;
mod wishes;

pub use doubt::{ProposalError, UnitDoubt};
pub use wishes::Wishes;

use super::materials::{LibraryMaterial, MATERIALS, find_material};
use super::write::{self, Comments};
use super::{Body, Material, Scene, SceneError, Tetrahedralise};
use crate::base::extent::bounding_box;
use crate::mesh::diagnostics::digits;
use crate::mesh::length_unit::Scale;
use crate::mesh::{self, LoadedMesh, TetMesh, surface_files};
use choice::INCOMPRESSIBLE;
use doubt::plausible;
use filling::FilledSurface;
use indexmap::IndexMap;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use telling::Explanations;

pub struct Proposal {
    pub scene: Scene,
    /// The name of its one body.
    pub body: String,
    pub comments: Comments,
    /// Guesses and their reasons, a sentence each.
    pub reasons: Vec<String>,
    /// Possible failures and their remedies, a sentence each.
    pub warnings: Vec<String>,
    /// The body's mesh, in metres, as the scene will load it.
    pub mesh: TetMesh,
}

/// Material of a body where neither the user nor the file's name gives one.
pub const USUAL_MATERIAL: &str = "rubber";

/// Stage of a scene where the user names none: one window.
const USUAL_STAGE: &str = "desktop";

/// A scene at `scene_path` for the mesh or surface file at `file`.
pub fn propose(file: &Path, scene_path: &Path, wishes: &Wishes) -> Result<Proposal, ProposalError> {
    let mut telling = Explanations::default();
    let name = body_name(file);
    let key = |key: &str| format!("body.{name}.{key}");
    let asked = wishes.asked_scale();
    let (known, why) = known_material(file, wishes)?;
    let (loaded, filling) = if surface_files::is_surface_file(file) {
        let FilledSurface { loaded, cell, wall } = filling::fill(file, known.largest_m, wishes)?;
        (loaded, Some((Tetrahedralise { cell }, wall)))
    } else {
        let loaded = mesh::load(file)?;
        plausible(file, pull::extent(&loaded.mesh), known.largest_m, asked)?;
        (asked.unwrap_or(Scale::ONE).applied(loaded), None)
    };
    let mesh = &loaded.mesh;
    size(&mut telling, &key, mesh, wishes, filling);
    let material = material(&mut telling, &key, (known, why), wishes);
    regions(&mut telling, mesh);
    let control = grouped::controls(&mut telling, &name, mesh, wishes)?;
    let choice = choice::choose(&mut telling, &key, mesh, &material, control.len(), wishes);
    let body = Body {
        method: Default::default(),
        longest_edge: None,
        mesh: Some(relative(file, scene_path)),
        unit: wishes.unit,
        scale: wishes.scale,
        tetrahedralise: filling.map(|(filling, _)| filling),
        element: choice.element,
        material,
        model: choice.model,
        effects: choice.effects,
        control,
        ..least_body()?
    };
    let stage = stage_from_scene(wishes.stage.as_deref().unwrap_or(USUAL_STAGE), scene_path);
    let windows = if stage == USUAL_STAGE { "one window; " } else { "" };
    telling.comment("stage", &format!("{windows}other displays: `greenstage manual stages`"));
    telling.comment(
        "",
        &format!(
            "{}, as `greenstage new` proposes to bend it: every line can be changed. `greenstage manual keys` explains \
             each one.",
            file.file_name().unwrap_or_default().display()
        ),
    );
    let scene = Scene {
        stage,
        script: None,
        legend: None,
        tool: IndexMap::new(),
        body: IndexMap::from([(name.clone(), body)]),
        path: scene_path.to_owned(),
    };
    let body = &scene.body[&name];
    // What of the file is used, and repaired, depends on the element.
    let loaded = if body.element.order == 2 { scene.load_mesh(&name, body)? } else { loaded };
    let LoadedMesh { mesh, notices: mut warnings } = loaded;
    let Explanations { comments, reasons, warnings: others } = telling;
    warnings.extend(others);
    Ok(Proposal { scene, body: name, comments, reasons, warnings, mesh })
}

impl Proposal {
    /// The scene file.
    pub fn text(&self) -> Result<String, SceneError> {
        write::text(&self.scene, &self.comments)
    }
}

/// The body is called as the file, in letters that need no quotes.
fn body_name(file: &Path) -> String {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let plain: String =
        stem.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect();
    let plain = plain.trim_matches('_');
    if plain.is_empty() { "body".to_owned() } else { plain.to_owned() }
}

/// A stage as a scene at `scene_path` names it: a built-in one by its name, a file by its path from the scene's folder.
pub fn stage_from_scene(named: &str, scene_path: &Path) -> String {
    match named.ends_with(".toml") {
        true => relative(Path::new(named), scene_path).display().to_string(),
        false => named.to_owned(),
    }
}

/// The file as seen from the scene's folder; from the root where they have no folder in common.
pub fn relative(file: &Path, scene_path: &Path) -> PathBuf {
    let folder =
        scene_path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(file_there), Ok(folder)) = (std::path::absolute(file), std::path::absolute(folder)) else {
        return file.to_owned();
    };
    let file_there = file_there.canonicalize().unwrap_or(file_there);
    let folder = folder.canonicalize().unwrap_or(folder);
    let shared = file_there.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if shared < 2 {
        return file_there;
    }
    let up = folder.components().skip(shared).map(|_| Path::new("..").as_os_str());
    up.chain(file_there.components().skip(shared).map(|part| part.as_os_str())).collect()
}

/// Says how large the body is, in what unit the file was taken to be, and how it is filled.
fn size(
    telling: &mut Explanations,
    key: &impl Fn(&str) -> String,
    mesh: &TetMesh,
    wishes: &Wishes,
    filling: Option<(Tetrahedralise, Option<f64>)>,
) {
    let (low, high) = bounding_box(&mesh.nodes);
    let sides: Vec<String> = (high - low).iter().map(|side| digits(*side)).collect();
    let sides = format!("{} m", sides.join(" × "));
    let unit = match (wishes.unit, wishes.scale) {
        (Some(unit), _) => {
            telling.comment(&key("unit"), &format!("the file is in {}: the body is {sides}", unit.plural));
            format!("the file is read in {}, as you asked", unit.plural)
        }
        (None, Some(scale)) => {
            telling.comment(&key("scale"), &format!("metres in one unit of the file: the body is {sides}"));
            format!("one unit of the file is {scale} m, as you asked")
        }
        (None, None) => {
            telling.comment(&key("mesh"), &format!("in metres: {sides}; else write unit = \"mm\""));
            "the file is taken to be in metres; if that is not its size, give --unit mm, cm or in".to_owned()
        }
    };
    let (nodes, tets) = (mesh.nodes.len(), mesh.tets.len());
    telling.reason(format!("size: {sides}; {unit}"));
    match filling {
        Some((Tetrahedralise { cell }, wall)) => {
            let comment = format!(
                "m; fills the surface with {tets} tetrahedra, {nodes} nodes; half of it makes eight times as many"
            );
            telling.comment(&key("tetrahedralise"), &comment);
            let walls = wall.map_or(String::new(), |wall| {
                format!(", {:.1} through the thinnest walls ({} m)", wall / cell, digits(wall))
            });
            telling.reason(format!(
                "filling: the file is a surface; cells of {cell} m{walls} make {tets} tetrahedra and {nodes} nodes"
            ));
            if let Some(wall) = wall.filter(|wall| *wall < 1.5 * cell) {
                telling.warnings.push(format!(
                    "the thinnest walls ({} m) are too thin for cells of {cell} m. Retry with --cell {:.1e} (about \
                     {} nodes)",
                    digits(wall),
                    wall / 2.0,
                    filling::about(nodes as f64 * (2.0 * cell / wall).powi(3))
                ));
            }
        }
        None => telling.reason(format!("mesh: {nodes} nodes, {tets} tetrahedra, as in the file")),
    }
}

/// The material of the library that is asked for or that the file's name has, and why it was taken.
fn known_material(
    file: &Path,
    wishes: &Wishes,
) -> Result<(&'static LibraryMaterial, &'static str), ProposalError> {
    if let Some(name) = &wishes.material {
        return Ok((find_material(name).map_err(ProposalError::Wrong)?, "as you asked"));
    }
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_named =
        |known: &&LibraryMaterial| stem.split(|c: char| !c.is_alphabetic()).any(|word| word == known.name);
    match MATERIALS.iter().find(is_named) {
        Some(known) => Ok((known, "after the file's name")),
        None => {
            let usual = find_material(USUAL_MATERIAL).map_err(ProposalError::Wrong)?;
            Ok((usual, "as a placeholder; choose with --material"))
        }
    }
}

fn material(
    telling: &mut Explanations,
    key: &impl Fn(&str) -> String,
    (known, why): (&'static LibraryMaterial, &str),
    wishes: &Wishes,
) -> Material {
    let mut material = Material::from(known);
    let mut why = why.to_owned();
    if wishes.is_cut && wishes.material.is_none() && material.poisson > INCOMPRESSIBLE {
        material.poisson = INCOMPRESSIBLE;
        why += &format!(
            "; ν is {INCOMPRESSIBLE} instead of {}, at which the elements that can be cut lock",
            known.poisson
        );
    }
    let told = format!("E = {}, ν = {}", pascals(known.young), material.poisson);
    telling.comment(&key("material"), &format!("{told}; others: `greenstage manual materials`"));
    telling.reason(format!("material: {} ({told}), {why}", known.name));
    material
}

/// Says that regions of the file get one material, until the scene gives them theirs.
fn regions(telling: &mut Explanations, mesh: &TetMesh) {
    let numbers: BTreeSet<u32> = mesh.regions.iter().copied().collect();
    let named = |number: &u32| mesh.region_names.get(number).cloned().unwrap_or_else(|| number.to_string());
    let names: Vec<String> = numbers.iter().map(named).collect();
    if let [first, .., _] = names.as_slice() {
        telling.reason(format!(
            "regions: {}, all of this material; region.{first} = \"steel\" in the scene file gives one its own",
            names.join(", ")
        ));
    }
}

/// A modulus in the unit that suits it.
pub fn pascals(value: f64) -> String {
    match value {
        v if v >= 1e9 => format!("{} GPa", digits_of(v * 1e-9)),
        v if v >= 1e6 => format!("{} MPa", digits_of(v * 1e-6)),
        v if v >= 1e3 => format!("{} kPa", digits_of(v * 1e-3)),
        v => format!("{} Pa", digits_of(v)),
    }
}

/// A number with at most four digits, without zeros at the end.
fn digits_of(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    format!("{rounded}")
}

/// A body at all its defaults.
fn least_body() -> Result<Body, SceneError> {
    const LEAST: &str = "[body.a]\nmesh = \"a\"\nmaterial = { young = 1.0, poisson = 0.0 }\n\
                         [body.a.control.a]\nnodes = { group = \"a\" }\ngrab = \"fixed\"\n";
    let mut scene = Scene::parse(LEAST, Path::new(""))?;
    scene.body.shift_remove("a").ok_or_else(|| scene.invalid("body", "no body"))
}

#[cfg(test)]
mod tests;
