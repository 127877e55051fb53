//! Turns what a file says into a [`TetMesh`] that the rest of the program can trust.
//!
//! In: a [`RawMesh`], nodes and elements by their tags as a format's reader found them. Out: tetrahedra by
//! index, checked, positively oriented, every node used, physical groups as regions and node groups.

use super::error::{FormatFault, refuse};
use super::quality::signed_volume;
use super::tet_mesh::{EDGES, LoadedMesh, TetMesh, edges_of};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// A file's nodes and elements of every dimension, unchecked; `at` are byte offsets for error messages.
#[derive(Clone, Debug, Default)]
pub struct RawMesh {
    pub nodes: Vec<RawNode>,
    pub elements: Vec<RawElement>,
    /// Node tags of all elements, one element after the other.
    pub corners: Vec<u64>,
    /// Names of physical groups by (dimension, number).
    pub names: BTreeMap<(u8, u32), String>,
    /// Physical groups of each geometric entity (dimension, tag); the first volume group is the region.
    pub physicals: BTreeMap<(u8, i32), Vec<u32>>,
    /// Node groups of their own, as indices into `nodes`.
    pub groups: BTreeMap<String, Vec<u32>>,
    pub notices: Vec<String>,
    /// The file that the elements' `at` refer to, as an index into the other files; `None` for the file that was named.
    pub elements_in: Option<usize>,
}

impl RawMesh {
    /// Adds an element of the group `number`, which is taken for its geometric entity; 0 means no group.
    pub fn add(&mut self, kind: ElementShape, tag: u64, number: i32, at: usize, nodes: &[u64]) {
        if number > 0 {
            let key = (kind.dimension, number);
            self.physicals.entry(key).or_insert_with(|| vec![number.unsigned_abs()]);
        }
        self.elements.push(RawElement { tag, kind, entity: number, at });
        self.corners.extend(nodes);
    }
}

#[derive(Clone, Copy, Debug)]
pub struct RawNode {
    pub tag: u64,
    pub position: Vector3<f64>,
    pub at: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct RawElement {
    pub tag: u64,
    pub kind: ElementShape,
    pub entity: i32,
    pub at: usize,
}

/// An element's shape. A tetrahedron's first four nodes are its corners, whatever its order; the six nodes between
/// them stand on the edges 01, 12, 02, 03, 23, 13, as in Gmsh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElementShape {
    pub dimension: u8,
    pub nodes: u8,
    pub is_tetrahedron: bool,
}

impl ElementShape {
    pub const TETRAHEDRON: ElementShape = ElementShape { dimension: 3, nodes: 4, is_tetrahedron: true };
    pub const TETRAHEDRON_10: ElementShape = ElementShape { dimension: 3, nodes: 10, is_tetrahedron: true };
}

/// A node that belongs to no tetrahedron.
const DROPPED: u32 = u32::MAX;

/// The nodes of 10-node tetrahedra that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The corners only.
    Linear,
    /// The nodes between them too, of a file that has no other tetrahedra.
    Quadratic,
}

/// Checks `raw` and builds the mesh, with a notice for everything that was repaired or left out.
pub fn assemble(mut raw: RawMesh, order: Order) -> Result<LoadedMesh, FormatFault> {
    let corners = resolve(&raw)?;
    raw.corners = Vec::new();
    let (mut tets, elements) = tetrahedra(&raw, &corners)?;
    refuse_duplicates(&raw, &tets, &elements)?;
    let mut notices = raw.notices.clone();
    orient(&raw, &mut tets, &elements, &mut notices)?;

    let mids = match order {
        Order::Linear => HashMap::new(),
        Order::Quadratic => mid_nodes(&raw, &corners)?,
    };
    let index = used_nodes(&raw, &corners, &tets, &mids, &mut notices);
    let kept = |node: &usize| index.get(*node).is_some_and(|&i| i != DROPPED);
    let mut mesh = TetMesh {
        nodes: (0..raw.nodes.len()).filter(kept).map(|i| raw.nodes[i].position).collect(),
        tags: (0..raw.nodes.len()).filter(kept).map(|i| raw.nodes[i].tag).collect(),
        tets: tets.iter().map(|tet| tet.map(|node| index[node as usize])).collect(),
        ..TetMesh::default()
    };
    mesh.regions = regions(&raw, &elements, &mut notices);
    for (&(dimension, number), name) in &raw.names {
        if dimension == 3 {
            mesh.region_names.insert(number, name.clone());
        }
    }
    mesh.groups = groups(&raw, &corners, &index, &mut notices);
    if !mids.is_empty() {
        // Edges by their new nodes, since `orient` has changed the order in some tetrahedra.
        let renumbered: HashMap<[u32; 2], u32> = mids
            .iter()
            .map(|(edge, &mid)| (edge.map(|node| index[node as usize]), index[mid as usize]))
            .map(|([a, b], mid)| ([a.min(b), a.max(b)], mid))
            .collect();
        mesh.mids = mesh.tets.iter().map(|tet| edges_of(tet).map(|edge| renumbered[&edge])).collect();
    }
    Ok(LoadedMesh { mesh, notices })
}

/// The node index of each element corner.
fn resolve(raw: &RawMesh) -> Result<Vec<u32>, FormatFault> {
    if raw.nodes.len() >= DROPPED as usize {
        return Err(FormatFault::whole(format!("{} nodes are more than 2³² - 2", raw.nodes.len())));
    }
    let mut index_of = HashMap::with_capacity(raw.nodes.len());
    for (node, index) in raw.nodes.iter().zip(0u32..) {
        if !node.position.iter().all(|x| x.is_finite()) {
            return refuse(node.at, format!("node {} has a coordinate that is no finite number", node.tag));
        }
        if index_of.insert(node.tag, index).is_some() {
            return refuse(node.at, format!("node {} is defined twice", node.tag));
        }
    }
    let mut corners = Vec::with_capacity(raw.corners.len());
    for (element, tags) in with_corners(raw, &raw.corners) {
        for tag in tags {
            let &index = index_of.get(tag).ok_or_else(|| {
                let reason =
                    format!("element {} names node {tag}, which the file does not define", element.tag);
                FormatFault::at(element.at, reason)
            })?;
            corners.push(index);
        }
    }
    Ok(corners)
}

/// Each element with its part of `corners`.
fn with_corners<'a, T>(
    raw: &'a RawMesh,
    corners: &'a [T],
) -> impl Iterator<Item = (&'a RawElement, &'a [T])> {
    raw.elements.iter().scan(0, |first, element| {
        let range = *first..*first + usize::from(element.kind.nodes);
        *first = range.end;
        Some((element, corners.get(range)?))
    })
}

/// The corners of all tetrahedra, and the element each comes from.
fn tetrahedra(raw: &RawMesh, corners: &[u32]) -> Result<(Vec<[u32; 4]>, Vec<RawElement>), FormatFault> {
    let mut tets = Vec::new();
    let mut elements = Vec::new();
    for (element, nodes) in with_corners(raw, corners) {
        let (true, &[a, b, c, d, ..]) = (element.kind.is_tetrahedron, nodes) else { continue };
        if a == b || a == c || a == d || b == c || b == d || c == d {
            let tags = [a, b, c, d].map(|node| raw.nodes[node as usize].tag);
            return refuse(element.at, format!("tetrahedron {} names a node twice: {tags:?}", element.tag));
        }
        tets.push([a, b, c, d]);
        elements.push(*element);
    }
    if tets.is_empty() {
        let reason = match raw.elements.len() {
            0 => "the file holds no elements".to_owned(),
            n => format!(
                "none of the file's {n} elements is a tetrahedron: mesh the volume (gmsh -3), and put it into a \
                 physical group if there are any"
            ),
        };
        return Err(FormatFault::whole(reason));
    }
    Ok((tets, elements))
}

/// The node between the corners of each edge (ascending) of the 10-node tetrahedra. Refuses one edge with two such
/// nodes, where the body would be cracked open, a node that is between and a corner too, and other tetrahedra beside
/// those of 10 nodes.
fn mid_nodes(raw: &RawMesh, corners: &[u32]) -> Result<HashMap<[u32; 2], u32>, FormatFault> {
    let mut mids = HashMap::new();
    let mut edge_of: HashMap<u32, [u32; 2]> = HashMap::new();
    let ten = with_corners(raw, corners).filter(|(element, _)| element.kind == ElementShape::TETRAHEDRON_10);
    for (element, nodes) in ten {
        let tag = |node: u32| raw.nodes[node as usize].tag;
        for ([i, j], &mid) in EDGES.iter().zip(nodes.iter().skip(4)) {
            let edge = [nodes[*i].min(nodes[*j]), nodes[*i].max(nodes[*j])];
            let [a, b] = edge.map(tag);
            let other = *mids.entry(edge).or_insert(mid);
            if other != mid {
                let reason = format!(
                    "tetrahedron {}: between nodes {a} and {b} lies node {}, for another tetrahedron node {}; merge them",
                    element.tag,
                    tag(mid),
                    tag(other)
                );
                return refuse(element.at, reason);
            }
            if *edge_of.entry(mid).or_insert(edge) != edge {
                let reason = format!(
                    "node {} lies between the corners of two edges (tetrahedron {})",
                    tag(mid),
                    element.tag
                );
                return refuse(element.at, reason);
            }
        }
    }
    if mids.is_empty() {
        return Ok(mids);
    }
    for (element, nodes) in with_corners(raw, corners).filter(|(element, _)| element.kind.is_tetrahedron) {
        if element.kind != ElementShape::TETRAHEDRON_10 {
            let reason = format!(
                "tetrahedron {} has {} nodes, others have 10: make them alike (gmsh: SetOrder 2), or write \
                 element = \"tet4\"",
                element.tag, element.kind.nodes
            );
            return refuse(element.at, reason);
        }
        if let Some(node) = nodes.iter().take(4).find(|node| edge_of.contains_key(node)) {
            let reason = format!(
                "node {} is a corner of tetrahedron {} and lies between the corners of another",
                raw.nodes[*node as usize].tag, element.tag
            );
            return refuse(element.at, reason);
        }
    }
    Ok(mids)
}

fn refuse_duplicates(raw: &RawMesh, tets: &[[u32; 4]], elements: &[RawElement]) -> Result<(), FormatFault> {
    let mut sorted: Vec<([u32; 4], usize)> = tets.iter().copied().zip(0..).collect();
    for (tet, _) in &mut sorted {
        tet.sort_unstable();
    }
    sorted.sort_unstable();
    let twins = sorted.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    let Some(pair) = twins.min_by_key(|pair| pair[1].1) else { return Ok(()) };
    let (first, second) = (elements[pair[0].1], elements[pair[1].1]);
    let tags = pair[0].0.map(|node| raw.nodes[node as usize].tag);
    let reason = format!(
        "tetrahedron {} has the same nodes {tags:?} as tetrahedron {}: keep one (in Gmsh save as 4.1)",
        second.tag, first.tag
    );
    refuse(second.at, reason)
}

/// Swaps two corners of each tetrahedron of negative volume; one of zero volume is left as it is.
fn orient(
    raw: &RawMesh,
    tets: &mut [[u32; 4]],
    elements: &[RawElement],
    notices: &mut Vec<String>,
) -> Result<(), FormatFault> {
    let mut flipped = Vec::new();
    for (tet, element) in tets.iter_mut().zip(elements) {
        let volume = signed_volume(&tet.map(|node| raw.nodes[node as usize].position));
        if !volume.is_finite() {
            let reason =
                format!("tetrahedron {}: its coordinates are too large to compute with", element.tag);
            return refuse(element.at, reason);
        }
        if volume < 0.0 {
            tet.swap(2, 3);
            flipped.push(element.tag);
        }
    }
    if !flipped.is_empty() {
        notices.push(format!(
            "{} of {} tetrahedra were oriented negatively and have been flipped (element {})",
            flipped.len(),
            tets.len(),
            first_few(&flipped)
        ));
    }
    Ok(())
}

/// The new index of each node of the file, [`DROPPED`] where it is neither a corner of a tetrahedron nor among `mids`.
fn used_nodes(
    raw: &RawMesh,
    corners: &[u32],
    tets: &[[u32; 4]],
    mids: &HashMap<[u32; 2], u32>,
    notices: &mut Vec<String>,
) -> Vec<u32> {
    let mut index = vec![DROPPED; raw.nodes.len()];
    for &node in tets.iter().flatten().chain(mids.values()) {
        index[node as usize] = 0;
    }
    let (mut high_order, mut other_solids) = (0, 0);
    let mut is_between = vec![false; raw.nodes.len()];
    for (element, nodes) in with_corners(raw, corners) {
        match element.kind {
            ElementShape { is_tetrahedron: true, nodes: 5.., .. } => {
                high_order += 1;
                nodes.iter().skip(4).for_each(|&node| is_between[node as usize] = true);
            }
            ElementShape { is_tetrahedron: false, dimension: 3, .. } => other_solids += 1,
            _ => {}
        }
    }
    let mut next = 0;
    let (mut between, mut unused) = (0, Vec::new());
    for (i, index) in index.iter_mut().enumerate() {
        if *index != DROPPED {
            *index = next;
            next += 1;
        } else if is_between[i] {
            between += 1;
        } else {
            unused.push(raw.nodes[i].tag);
        }
    }
    if between > 0 {
        notices.push(format!(
            "{high_order} tetrahedra of 10 or more nodes: only their 4 corners are used, {between} nodes between \
             them have been dropped"
        ));
    }
    if other_solids > 0 {
        notices.push(format!("{other_solids} solid elements that are no tetrahedra have been left out"));
    }
    if !unused.is_empty() {
        notices.push(format!(
            "{} nodes belong to no tetrahedron and have been dropped (node {})",
            unused.len(),
            first_few(&unused)
        ));
    }
    index
}

fn regions(raw: &RawMesh, elements: &[RawElement], notices: &mut Vec<String>) -> Vec<u32> {
    let mut ambiguous = BTreeSet::new();
    let physical = |element: &RawElement| {
        let physicals = raw.physicals.get(&(3, element.entity)).map_or(&[][..], Vec::as_slice);
        if physicals.len() > 1 {
            ambiguous.insert(element.entity);
        }
        physicals.first().copied().unwrap_or(0)
    };
    let regions = elements.iter().map(physical).collect();
    for entity in ambiguous {
        let physicals = &raw.physicals[&(3, entity)];
        notices.push(format!(
            "volume {entity} belongs to the physical groups {physicals:?}: its region is the first, {}",
            physicals[0]
        ));
    }
    regions
}

/// Node groups: one for each named physical group, and for each unnamed one of points, curves or surfaces
/// under its number. Groups of equal name are joined.
fn groups(
    raw: &RawMesh,
    corners: &[u32],
    index: &[u32],
    notices: &mut Vec<String>,
) -> BTreeMap<String, Vec<u32>> {
    let mut members: BTreeMap<(u8, u32), Vec<u32>> = raw.names.keys().map(|&key| (key, Vec::new())).collect();
    for (element, nodes) in with_corners(raw, corners) {
        let dimension = element.kind.dimension;
        for &number in raw.physicals.get(&(dimension, element.entity)).map_or(&[][..], Vec::as_slice) {
            let key = (dimension, number);
            if raw.names.contains_key(&key) || (dimension < 3 && number != 0) {
                members.entry(key).or_default().extend(nodes.iter().map(|&node| index[node as usize]));
            }
        }
    }
    let mut groups: BTreeMap<String, Vec<u32>> = BTreeMap::new();
    let mut parts: BTreeMap<String, Vec<(u8, u32)>> = BTreeMap::new();
    for (key, mut nodes) in members {
        let name = raw.names.get(&key).cloned().unwrap_or_else(|| key.1.to_string());
        if !nodes.is_empty() {
            parts.entry(name.clone()).or_default().push(key);
        }
        let group = groups.entry(name).or_default();
        nodes.retain(|&node| node != DROPPED);
        group.append(&mut nodes);
    }
    for (name, nodes) in &raw.groups {
        let kept: BTreeSet<u32> =
            nodes.iter().map(|&node| index[node as usize]).filter(|&node| node != DROPPED).collect();
        let group = groups.entry(name.clone()).or_default();
        if group.iter().any(|node| !kept.contains(node)) {
            notices.push(format!("group \"{name}\" joins the nodes of a set and of a region"));
        }
        group.extend(kept);
    }
    for group in groups.values_mut() {
        group.sort_unstable();
        group.dedup();
    }
    for (name, keys) in parts.iter().filter(|(_, keys)| keys.len() > 1) {
        const DIMENSIONS: [&str; 4] = ["points", "curve", "surface", "volume"];
        let listed: Vec<String> =
            keys.iter().map(|&(dim, number)| format!("{} {number}", DIMENSIONS[usize::from(dim)])).collect();
        notices.push(format!("group \"{name}\" joins the physical groups {}", listed.join(", ")));
    }
    groups
}

/// "3", "3, 5, 8" or "3, 5, 8, …".
pub fn first_few(tags: &[u64]) -> String {
    let shown: Vec<String> = tags.iter().take(5).map(u64::to_string).collect();
    let more = if tags.len() > shown.len() { ", …" } else { "" };
    shown.join(", ") + more
}
