//! The element, model and effects that suit a body and its purpose.
//!
//! In: a mesh, its material and [`Wishes`]. Out: a [`Choice`], with its reasons.

use super::super::{Body, Material};
use super::ends;
use super::telling::Explanations;
use super::wishes::Wishes;
use crate::base::table::duration;
use crate::fem::{Element, TET4, TET4_ANP, TET10};
use crate::mesh::walls::walls_too_thin;
use crate::mesh::{TetMesh, quality};

/// Element, model and effects of a body.
pub struct Choice {
    pub element: &'static Element,
    pub model: String,
    pub effects: Vec<String>,
}

/// Length in radii of gyration below which a body is compact: St. Venant–Kirchhoff's law has no equilibrium at 90° of bend.
const COMPACT: f64 = 15.0;
/// Length over mean thickness from which a body is slender.
const SLENDER: f64 = 6.0;
/// Length in radii of gyration from which a body is a rod: that of a square bar of 25 : 1 is 87.
const ROD: f64 = 85.0;
/// Poisson's ratio above which linear tetrahedra are too stiff.
pub const INCOMPRESSIBLE: f64 = 0.45;
/// Young's modulus below which bodies are pulled by a large part of their size, as organs are, Pa.
const SOFT: f64 = 1e5;
/// Most corners of a mesh for elements of ten nodes, which take minutes beyond.
const MOST_CORNERS: usize = 15_000;
/// Most nodes for the model `reduced` where it was not asked for: it takes minutes beyond. With up to [`WITH_EQUILIBRIA`]
/// it has fields of equilibria, of which it takes [`REDUCED_S`] for a node to precompute.
const MOST_REDUCED: usize = 60_000;
const WITH_EQUILIBRIA: usize = 33_000;
const REDUCED_S: f64 = 2e-2;
/// Unknowns of a mesh with nodes on its edges, for each corner.
const UNKNOWNS: usize = 21;
/// Most unknowns of the better body that errors are measured by, which is solved in a minute or two.
const MOST_MEASURED: usize = 700_000;
/// The model `reduced` takes so many control elements.
const MOST_CONTROLS: usize = 4;
/// Effects that answer how much force something takes; a model of equilibrium is measured against no other.
pub const FORCES: [&str; 2] = ["haptics", "stress"];
pub const ERRORS: &str = "expected_errors";
/// The effect that divides linear tetrahedra alone.
const CUT: &str = "cut";

/// The model that holds furthest for a body of two control elements at the ends of this mesh, `nodes` with those on its edges;
/// how far it holds, and what it costs.
pub fn of_two_ends(mesh: &TetMesh, nodes: usize) -> Option<(&'static str, String)> {
    let slenderness = ends::slenderness(mesh);
    let seconds = REDUCED_S * nodes as f64;
    if slenderness >= ROD {
        let reach = "any angle and several turns, forces within 5 % where its walls keep their shape";
        Some(("rod", format!("{reach}; the body is {slenderness:.0} radii of gyration long")))
    } else if nodes <= WITH_EQUILIBRIA && slenderness < COMPACT {
        let reach = "bends and twists to 90° by the neo-Hookean law; `precompute` measures how far its forces hold on this body";
        Some((
            "reduced_neo_hookean",
            format!("{reach}; about {} more to precompute", duration(5.0 + seconds)),
        ))
    } else if nodes <= WITH_EQUILIBRIA {
        let reach = "bends and twists to 90°; `precompute` measures how far its forces hold on this body";
        Some(("reduced", format!("{reach}; about {} more to precompute", duration(seconds))))
    } else if nodes <= MOST_REDUCED {
        Some(("reduced", "forces to about 60° of bend and twist, minutes to precompute".to_owned()))
    } else {
        None
    }
}

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
    let is_thin = walls_too_thin(mesh).is_some();
    let takes_edges = is_incompressible || (asks_forces || is_thin) && !is_large;
    let of_reduced = if takes_edges { UNKNOWNS / 3 * nodes } else { nodes };
    let of_two = (controls == 2).then(|| of_two_ends(mesh, of_reduced)).flatten();
    // A rod needs its control elements at its ends, and an element that does not lock.
    let at_ends = wishes.fixed.is_empty() && wishes.grab.is_empty();
    let takes_rod = at_ends && !(is_large && is_incompressible);
    let of_two = of_two.filter(|(model, _)| *model != "rod" || takes_rod);
    let reach = of_two.as_ref().map_or(String::new(), |(_, reach)| reach.clone());
    let reduced = of_two.as_ref().map_or("reduced", |(model, _)| model);
    let with = if is_incompressible { " with element = \"tet10\"" } else { "" };
    let (model, comment, why) = match &wishes.model {
        Some(model) => (model.as_str(), String::new(), "as you asked".to_owned()),
        None if wishes.is_touched && wishes.is_cut => (
            "linear",
            "has an energy, with which it is touched, while it is cut".to_owned(),
            "because a body that is both touched and cut needs the energy of what is cut; turns are small"
                .to_owned(),
        ),
        None if wishes.is_touched || wishes.is_cut => (
            "rotation",
            "presses single points and can be cut, as \"linear\" can".to_owned(),
            "because a body that is touched or cut is a sum of columns in one frame".to_owned(),
        ),
        None if is_soft => (
            "neo_hookean",
            "static equilibrium at large strain, found anew for every pose".to_owned(),
            "because a soft body stretches far: any strain; it is solved for every pose".to_owned(),
        ),
        None if of_two.as_ref().is_some_and(|(model, _)| *model == "rod") => {
            ("rod", "for slender bodies; \"reduced\" for others".to_owned(), reach)
        }
        None if asks_forces && can_reduce && is_large && is_incompressible => (
            "rotation",
            "for large rotations; \"reduced\", which is made for forces, needs element = \"tet10\" here"
                .to_owned(),
            format!("because {nodes} nodes are many for \"reduced\" with tet10; a larger --cell makes fewer"),
        ),
        None if asks_forces && can_reduce => (
            reduced,
            "made for forces, and bends far; \"rotation\" is quicker to precompute".to_owned(),
            if reach.is_empty() { "because you ask for forces".to_owned() } else { reach },
        ),
        None if of_two.is_some() => {
            (reduced, "bends far, with forces; \"rotation\" is quicker to precompute".to_owned(), reach)
        }
        None if slender >= SLENDER && can_reduce && of_reduced <= MOST_REDUCED => (
            "reduced",
            "bends far, with forces; \"rotation\" is quicker to precompute".to_owned(),
            format!("because the body is slender ({slender:.0} times as long as thick) and bends far"),
        ),
        None => (
            "rotation",
            format!("for large rotations; \"reduced\"{with} for forces, and to bend far"),
            format!(
                "quick; shapes to about 60° of bend, forces of compact bodies to 30°; further \"reduced\"{with}"
            ),
        ),
    };
    let element = match wishes.is_cut {
        true => of_cut(telling, material),
        false => element_of(model, is_incompressible, asks_forces || is_thin, is_large),
    };
    if element == &TET4_ANP {
        telling.comment(&key("element"), "does not lock at a Poisson's ratio near 1/2");
    }
    if element == &TET10 {
        let why = if asks_forces { "you ask for forces" } else { "linear ones are too stiff here" };
        telling.comment(&key("element"), "least error of forces for its nodes");
        telling.reason(format!("element: tet10, because {why}"));
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

/// The element that a blade divides, with a warning where it locks.
fn of_cut(telling: &mut Explanations, material: &Material) -> &'static Element {
    if material.poisson > INCOMPRESSIBLE {
        telling.warnings.push(format!(
            "a blade divides linear tetrahedra alone, which are too stiff at a Poisson's ratio of {}: a material of at most {INCOMPRESSIBLE} \
             is truer",
            material.poisson
        ));
    }
    &TET4
}

/// The element that suits a model; `is_exact` where forces are asked for, or walls are too thin for linear tetrahedra.
fn element_of(model: &str, is_incompressible: bool, is_exact: bool, is_large: bool) -> &'static Element {
    match model {
        "substructured" => &TET4,
        // Solved for every pose: tet10 would take minutes.
        "neo_hookean" | "stvk" | "corotational" if !is_incompressible => &TET4,
        "neo_hookean" | "stvk" | "corotational" => &TET4_ANP,
        _ if is_exact && !is_large => &TET10,
        // Linear tetrahedra are too stiff in a slender rod's bend.
        "rod" if !is_large => &TET10,
        // Their energy is a quartic form, which that of tet4_anp is not.
        "reduced" | "reduced_neo_hookean" | "perturbation" if is_incompressible => &TET10,
        _ if is_incompressible => &TET4_ANP,
        _ => &TET4,
    }
}

/// Elements that do not lock near a Poisson's ratio of 1/2 and that the model and effects of the body take, that of the least error
/// first.
pub fn without_locking(body: &Body) -> &'static [&'static Element] {
    match body.model.as_str() {
        _ if body.effects.iter().any(|effect| effect == CUT) => &[],
        "substructured" => &[],
        "reduced" | "reduced_neo_hookean" | "perturbation" => &[&TET10],
        _ => &[&TET10, &TET4_ANP],
    }
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
