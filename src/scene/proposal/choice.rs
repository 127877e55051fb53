//! The element, model and effects that suit a body and its purpose.
//!
//! In: a mesh, its material and [`Wishes`]. Out: a [`Choice`], with its reasons.

use super::super::Material;
use super::ends;
use super::telling::Explanations;
use super::wishes::Wishes;
use crate::fem::{Element, TET4, TET4_ANP, TET10};
use crate::mesh::{TetMesh, quality};

/// Element, model and effects of a body.
pub struct Choice {
    pub element: &'static Element,
    pub model: String,
    pub effects: Vec<String>,
}

/// Length over mean thickness from which a body is slender.
const SLENDER: f64 = 6.0;
/// Poisson's ratio above which linear tetrahedra are too stiff.
const INCOMPRESSIBLE: f64 = 0.45;
/// Young's modulus below which bodies are pulled by a large part of their size, as organs are, Pa.
const SOFT: f64 = 1e5;
/// Most corners of a mesh for elements of ten nodes, which take minutes beyond.
const MOST_CORNERS: usize = 15_000;
/// Most nodes for the model `reduced` where it was not asked for: it takes minutes beyond.
const MOST_REDUCED: usize = 60_000;
/// Unknowns of a mesh with nodes on its edges, for each corner.
const UNKNOWNS: usize = 21;
/// Most unknowns of the better body that errors are measured by, which is solved in a minute or two.
const MOST_MEASURED: usize = 700_000;
/// The model `reduced` takes so many control elements.
const MOST_CONTROLS: usize = 4;
/// Effects that answer how much force something takes; a model of equilibrium is measured against no other.
pub const FORCES: [&str; 2] = ["haptics", "stress"];
pub const ERRORS: &str = "expected_errors";

/// Chooses for a body of so many control elements.
pub fn choose(
    telling: &mut Explanations,
    key: &impl Fn(&str) -> String,
    mesh: &TetMesh,
    material: &Material,
    controls: usize,
    wishes: &Wishes,
) -> Choice {
    let asks_forces = wishes.pull_m.is_some();
    let is_soft = material.young < SOFT && asks_forces;
    let can_reduce = controls <= MOST_CONTROLS;
    let nodes = mesh.nodes.len();
    let (is_large, is_incompressible) = (nodes > MOST_CORNERS, material.poisson > INCOMPRESSIBLE);
    let volume: f64 = (0..mesh.tets.len()).map(|tet| quality::signed_volume(&mesh.corners(tet))).sum();
    let length = ends::length(mesh);
    let slender = length / (volume / length).sqrt();
    let (model, comment, why) = match &wishes.model {
        Some(model) => (model.as_str(), String::new(), "as you asked".to_owned()),
        None if is_soft => (
            "neo_hookean",
            "static equilibrium at large strain, found anew for every pose".to_owned(),
            "because a soft body stretches far; it is solved for every pose".to_owned(),
        ),
        None if asks_forces && can_reduce && is_large && is_incompressible => (
            "rotation",
            "for large rotations; \"reduced\", which is made for forces, needs element = \"tet10\" here"
                .to_owned(),
            format!("because {nodes} nodes are many for \"reduced\" with tet10; a larger --cell makes fewer"),
        ),
        None if asks_forces && can_reduce => (
            "reduced",
            "made for forces, and bends far; \"rotation\" is quicker to precompute".to_owned(),
            "because you ask for forces".to_owned(),
        ),
        None if slender >= SLENDER && can_reduce && !is_incompressible && nodes <= MOST_REDUCED => (
            "reduced",
            "bends far, with forces; \"rotation\" is quicker to precompute".to_owned(),
            format!("because the body is slender ({slender:.0} times as long as thick) and bends far"),
        ),
        None => (
            "rotation",
            "for large rotations; \"reduced\" for forces, and to bend far".to_owned(),
            "quick and good for shapes; for forces \"reduced\"".to_owned(),
        ),
    };
    let element = match model {
        "substructured" => &TET4,
        // Solved for every pose: tet10 would take minutes.
        "neo_hookean" | "stvk" | "corotational" if !is_incompressible => &TET4,
        "neo_hookean" | "stvk" | "corotational" => &TET4_ANP,
        _ if asks_forces && !is_large => &TET10,
        // Their energy is a quartic form, which that of tet4_anp is not.
        "reduced" | "perturbation" if is_incompressible => &TET10,
        _ if is_incompressible => &TET4_ANP,
        _ => &TET4,
    };
    if element == &TET4_ANP {
        telling.comment(&key("element"), "does not lock at a Poisson's ratio near 1/2");
    }
    if element == &TET10 {
        telling.comment(&key("element"), "least error of forces for its nodes");
        telling.reason("element: tet10, because you ask for forces".to_owned());
    }
    if !comment.is_empty() {
        telling.comment(&key("model"), &comment);
    }
    telling.reason(format!("model: {model}, {why}"));
    let mut effects = wishes.effects.clone();
    // Its better body has nodes on the edges, of tetrahedra of half the size if there are such nodes already.
    let better = UNKNOWNS * mesh.nodes.len() * if element == &TET10 { 8 } else { 1 };
    let measured = (!is_soft && better <= MOST_MEASURED).then_some(ERRORS);
    let asked = FORCES.into_iter().chain(measured).filter(|_| asks_forces);
    for effect in asked {
        if !effects.iter().any(|known| known == effect) {
            effects.push(effect.to_owned());
        }
    }
    tell_effects(telling, key, &effects, asks_forces);
    if asks_forces && !is_soft && !effects.iter().any(|effect| effect == ERRORS) {
        telling.reason(format!(
            "errors of the forces: not measured, as {ERRORS} would solve {:.1} million unknowns; list it, or \
             take a larger --cell",
            better as f64 * 1e-6
        ));
    }
    Choice { element, model: model.to_owned(), effects }
}

fn tell_effects(
    telling: &mut Explanations,
    key: &impl Fn(&str) -> String,
    effects: &[String],
    asks_forces: bool,
) {
    if effects.is_empty() {
        telling.comment(&key("effects"), "[\"haptics\", \"stress\"]: forces in newtons, colours by stress");
        return;
    }
    let known =
        [("haptics", "forces in newtons"), ("stress", "colours by stress"), (ERRORS, "errors of the forces")];
    let listed = known.into_iter().filter(|(name, _)| effects.iter().any(|effect| effect == name));
    let mut told: Vec<&str> = listed.map(|(_, what)| what).collect();
    told.push("all effects: `greenstage manual scene`");
    telling.comment(&key("effects"), &told.join(", "));
    let why = if asks_forces { "because you ask for forces" } else { "as you asked" };
    telling.reason(format!("effects: {}, {why}", effects.join(", ")));
}
