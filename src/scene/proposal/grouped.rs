//! The control elements of a proposal: node groups of the file, where they have names that say enough or were asked for,
//! else the body's two ends; and something to hold every piece.
//!
//! In: a mesh and the [`Wishes`]. Out: control elements that share no node, at least one of them fixed.

use super::super::{Control, Grab, Nodes};
use super::doubt::ProposalError;
use super::ends::{self, End, are_apart, can_be_held};
use super::telling::{Explanations, HeldElement};
use super::wishes::Wishes;
use crate::base::extent::bounding_box;
use crate::config::unknown_name;
use crate::mesh::diagnostics::digits;
use crate::mesh::{Surface, TetMesh, quality};
use indexmap::IndexMap;

/// Parts of names of what is held, and of what is pulled.
const FIXED: &[&str] = &[
    "fix",
    "clamp",
    "encast",
    "support",
    "base",
    "bottom",
    "foot",
    "wall",
    "ground",
    "dirichlet",
    "anchor",
    "root",
    "left",
    "hold",
    "held",
    "mount",
    "constrain",
    "bolt",
    "xmin",
    "zmin",
    "ymin",
];
const PULLED: &[&str] = &[
    "load", "drag", "grab", "tip", "right", "top", "force", "handle", "free", "pull", "push", "traction",
    "neumann", "hand", "end", "xmax", "zmax", "ymax",
];
/// Part of the nodes beyond which a group is a volume rather than a place.
const LARGEST: f64 = 0.4;
/// Pieces of a mesh that are given something to hold them; of more, the user must.
const PIECES: usize = 8;

pub fn controls(
    telling: &mut Explanations,
    body: &str,
    mesh: &TetMesh,
    wishes: &Wishes,
) -> Result<IndexMap<String, Control>, ProposalError> {
    let surface = Surface::from_mesh(mesh);
    let mut chosen: Vec<(HeldElement, Vec<u32>)> = Vec::new();
    for (names, grab) in [(&wishes.fixed, Grab::Fixed), (&wishes.grab, Grab::Dragger)] {
        for name in names {
            let nodes = asked(mesh, name)?;
            if let Some((other, _)) = chosen.iter().find(|(_, other)| !are_apart(other, &nodes)) {
                return Err(ProposalError::Wrong(format!(
                    "the node groups \"{}\" and \"{name}\" share nodes: choose others, or write the scene with box, \
                     sphere or grow",
                    other.name
                )));
            }
            chosen.push((group(name, grab, nodes.len()), nodes));
        }
    }
    if !chosen.is_empty() {
        telling.reason(format!("control elements: {}, as you asked", listed(&chosen)));
    }
    if wishes.fixed.is_empty() && wishes.grab.is_empty() {
        named(telling, mesh, &surface, &mut chosen);
    }
    opposite(telling, mesh, &mut chosen)?;
    hold_pieces(telling, mesh, &surface, &mut chosen);
    let mut controls = IndexMap::new();
    for (held, _) in &chosen {
        let key = format!("body.{body}.control.{}", held.name);
        telling.comment(&format!("{key}.nodes"), &held.comment);
        telling.comment(
            &format!("{key}.grab"),
            match held.grab {
                Grab::Fixed => "stays where it is",
                Grab::Dragger => "can be taken with the stylus or the mouse",
            },
        );
        controls.insert(held.name.clone(), held.control());
    }
    Ok(controls)
}

fn group(name: &str, grab: Grab, nodes: usize) -> HeldElement {
    HeldElement {
        name: name.replace('/', "_"),
        nodes: Nodes::Group(name.to_owned()),
        grab,
        comment: format!("a group of the file, {nodes} nodes"),
    }
}

fn listed(chosen: &[(HeldElement, Vec<u32>)]) -> String {
    let said = |(held, _): &(HeldElement, Vec<u32>)| match held.grab {
        Grab::Fixed => format!("\"{}\" fixed", held.name),
        Grab::Dragger => format!("\"{}\" to be grabbed", held.name),
    };
    chosen.iter().map(said).collect::<Vec<_>>().join(", ")
}

/// A group that the user named.
fn asked(mesh: &TetMesh, name: &str) -> Result<Vec<u32>, ProposalError> {
    let known = || mesh.groups.keys().map(String::as_str);
    match mesh.groups.get(name) {
        Some(nodes) if !nodes.is_empty() => Ok(nodes.clone()),
        Some(_) => {
            Err(ProposalError::Wrong(format!("the node group \"{name}\" holds no node of a tetrahedron")))
        }
        None if mesh.groups.is_empty() => Err(ProposalError::Wrong(format!(
            "\"{name}\" is no node group: the file has none; leave --fixed and --grab out, and the ends are taken"
        ))),
        None => Err(ProposalError::Wrong(unknown_name("node group", name, known()))),
    }
}

/// Groups of the file that are places on its surface and have names: by what the names say, else the two that are
/// furthest from each other.
fn named(
    telling: &mut Explanations,
    mesh: &TetMesh,
    surface: &Surface,
    chosen: &mut Vec<(HeldElement, Vec<u32>)>,
) {
    let is_place = |(name, nodes): &(&String, &Vec<u32>)| {
        !mesh.region_names.values().any(|region| region == *name)
            && !name.chars().all(|c| c.is_ascii_digit())
            && (nodes.len() as f64) < LARGEST * mesh.nodes.len() as f64
            && can_be_held(mesh, surface, nodes)
    };
    let places: Vec<(&String, &Vec<u32>)> = mesh.groups.iter().filter(is_place).collect();
    let says = |name: &str, words: &[&str]| words.iter().any(|word| name.to_lowercase().contains(word));
    let mut take = |name: &str, nodes: &[u32], grab: Grab| {
        let is_free = chosen.iter().all(|(_, other)| are_apart(other, nodes));
        if is_free {
            chosen.push((group(name, grab, nodes.len()), nodes.to_vec()));
        }
        is_free
    };
    let fixed = places.iter().filter(|(name, _)| says(name, FIXED));
    let is_fixed =
        fixed.map(|(name, nodes)| take(name, nodes, Grab::Fixed)).fold(false, |any, one| any | one);
    let pulled = places.iter().filter(|(name, _)| says(name, PULLED) && !says(name, FIXED));
    let is_pulled =
        pulled.map(|(name, nodes)| take(name, nodes, Grab::Dragger)).fold(false, |any, one| any | one);
    if is_fixed || is_pulled {
        telling.reason(format!(
            "control elements: {}, after the names of the file's node groups",
            listed(chosen)
        ));
    } else if let Some([first, second]) = furthest_pair(mesh, &places) {
        take(first.0, first.1, Grab::Fixed);
        take(second.0, second.1, Grab::Dragger);
        telling.reason(format!(
            "control elements: {}, the two named node groups of the file that are furthest apart",
            listed(chosen)
        ));
    }
}

type Place<'a> = (&'a String, &'a Vec<u32>);

fn furthest_pair<'a>(mesh: &TetMesh, places: &[Place<'a>]) -> Option<[Place<'a>; 2]> {
    let apart = |a: &Place, b: &Place| -> Option<f64> {
        Some((quality::centroid(mesh, a.1)? - quality::centroid(mesh, b.1)?).norm())
    };
    let pairs = places.iter().enumerate().flat_map(|(i, a)| places[..i].iter().map(move |b| (b, a)));
    let free = pairs.filter(|(a, b)| are_apart(a.1, b.1)).filter_map(|(a, b)| Some((apart(a, b)?, [*a, *b])));
    free.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, pair)| pair)
}

/// Adds what is missing of one fixed and one to be grabbed: the body's ends, the ones furthest from what is there.
fn opposite(
    telling: &mut Explanations,
    mesh: &TetMesh,
    chosen: &mut Vec<(HeldElement, Vec<u32>)>,
) -> Result<(), ProposalError> {
    let is_there =
        |chosen: &[(HeldElement, Vec<u32>)], grab| chosen.iter().any(|(held, _)| held.grab == grab);
    let missing: Vec<Grab> =
        [Grab::Fixed, Grab::Dragger].into_iter().filter(|grab| !is_there(chosen, *grab)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let nothing = || {
        ProposalError::Wrong(
            "the body is too small, or has too few tetrahedra, to find two ends on it: write the scene by hand, \
             `greenstage manual start` shows one"
                .to_owned(),
        )
    };
    let found = ends::find(mesh).ok_or_else(nothing)?;
    let held = |end: End, grab| {
        let held = HeldElement { name: end.name.to_owned(), nodes: end.nodes, grab, comment: end.what };
        (held, end.selected)
    };
    if missing.len() == 2 {
        let [first, second] = found.ends;
        chosen.extend([held(first, Grab::Fixed), held(second, Grab::Dragger)]);
        telling.reason(format!("control elements: {}: {}", listed(chosen), found.why));
        return Ok(());
    }
    let there: Vec<u32> = chosen.iter().flat_map(|(_, nodes)| nodes.iter().copied()).collect();
    let middle = quality::centroid(mesh, &there).ok_or_else(nothing)?;
    let far =
        |end: &End| quality::centroid(mesh, &end.selected).map_or(0.0, |centre| (centre - middle).norm());
    let free =
        found.ends.into_iter().filter(|end| chosen.iter().all(|(_, other)| are_apart(other, &end.selected)));
    let end = free.max_by(|a, b| far(a).total_cmp(&far(b))).ok_or_else(nothing)?;
    let mut new = held(end, missing[0]);
    while chosen.iter().any(|(held, _)| held.name == new.0.name) {
        new.0.name.push_str("_end");
    }
    let said = listed(std::slice::from_ref(&new));
    telling.reason(format!("control elements: {said}: the body's end that is furthest from the others"));
    chosen.push(new);
    Ok(())
}

/// Every piece that is joined to the others by no face must be held, or it would fly away.
fn hold_pieces(
    telling: &mut Explanations,
    mesh: &TetMesh,
    surface: &Surface,
    chosen: &mut Vec<(HeldElement, Vec<u32>)>,
) {
    let pieces = quality::components(mesh).nodes;
    if pieces.len() > PIECES {
        telling.warnings.push(format!(
            "the mesh is in {} pieces that share no face: each must be held, or joined to the others before",
            pieces.len()
        ));
        return;
    }
    for (number, piece) in pieces.iter().enumerate() {
        let is_held = |nodes: &[u32]| {
            let inside: Vec<u32> =
                nodes.iter().copied().filter(|node| piece.binary_search(node).is_ok()).collect();
            can_be_held(mesh, surface, &inside)
        };
        if chosen.iter().any(|(_, nodes)| is_held(nodes)) {
            continue;
        }
        let of_piece: Vec<_> = piece.iter().map(|&node| mesh.nodes[node as usize]).collect();
        let (low, high) = bounding_box(&of_piece);
        let outer = surface.nodes.iter().filter(|node| piece.binary_search(node).is_ok());
        let Some(&lowest) =
            outer.min_by(|a, b| mesh.nodes[**a as usize].y.total_cmp(&mesh.nodes[**b as usize].y))
        else {
            continue;
        };
        let radius = (high - low).norm() / 4.0;
        let nodes = Nodes::Geodesic { from: mesh.nodes[lowest as usize].into(), radius };
        let Ok(selected) = nodes.select(mesh) else { continue };
        if !chosen.iter().all(|(_, other)| are_apart(other, &selected)) {
            continue;
        }
        let held = HeldElement {
            name: format!("piece_{}", number + 1),
            nodes,
            grab: Grab::Fixed,
            comment: format!(
                "holds a piece that nothing joins to the others, up to {} m from its lowest node",
                digits(radius)
            ),
        };
        telling.reason(format!(
            "\"{}\" holds a piece of the mesh that shares no face with the others",
            held.name
        ));
        chosen.push((held, selected));
    }
}
