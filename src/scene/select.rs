//! A control element of a body, as a scene names it, and the selection of the mesh's nodes that it holds.

use crate::base::extent::bounding_box;
use crate::base::input;
use crate::config::unknown_name;
use crate::mesh::diagnostics::{digits, place};
use crate::mesh::{Surface, TetMesh, geodesic};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A selection of nodes; bounds count as inside. Coordinates are in metres, in the mesh's own frame.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Nodes {
    /// A named node group (physical group) of the mesh.
    Group(String),
    Box {
        min: [f64; 3],
        max: [f64; 3],
    },
    Sphere {
        centre: [f64; 3],
        radius: f64,
    },
    /// All nodes at most `distance` from the plane.
    Plane {
        point: [f64; 3],
        normal: [f64; 3],
        distance: f64,
    },
    /// All nodes that a path of edges of tetrahedra of at most `radius` reaches from the surface node nearest to `from`
    /// ([`geodesic::within`]).
    #[serde(rename = "grow")]
    Geodesic {
        from: [f64; 3],
        radius: f64,
    },
    /// Node tags, as the mesh's file has them; what is added between two of them belongs to them as well, as with a group.
    List(Vec<u64>),
    /// A text file of node tags, one per line, with comments after #; the path is relative to the scene. Nodes that are
    /// added between two of them belong to them as well, as with a group.
    File(PathBuf),
}

impl Nodes {
    /// Checks what can be checked without the mesh.
    pub(super) fn check(&self) -> Result<(), String> {
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        match self {
            Nodes::Box { min, max } => {
                if !finite(min) || !finite(max) || (0..3).any(|axis| min[axis] > max[axis]) {
                    return Err(format!("box: min {min:?} must be finite and nowhere above max {max:?}"));
                }
            }
            Nodes::Sphere { centre, radius } => {
                if !(finite(centre) && *radius > 0.0 && radius.is_finite()) {
                    return Err(format!("sphere: centre {centre:?} must be finite, radius {radius} above 0"));
                }
            }
            Nodes::Geodesic { from, radius } => {
                if !(finite(from) && *radius > 0.0 && radius.is_finite()) {
                    return Err(format!("grow: from {from:?} must be finite, radius {radius} above 0"));
                }
            }
            Nodes::Plane { point, normal, distance } => {
                let usable = finite(point) && finite(normal) && Vector3::from(*normal).amax() > 0.0;
                if !(usable && *distance >= 0.0 && distance.is_finite()) {
                    return Err(format!(
                        "plane: point {point:?} and normal {normal:?} must be finite, normal not zero, distance \
                         {distance} not negative"
                    ));
                }
            }
            Nodes::List(tags) if tags.is_empty() => return Err("list: name at least one node tag".to_owned()),
            Nodes::Group(_) | Nodes::List(_) | Nodes::File(_) => {}
        }
        Ok(())
    }

    /// Makes the node group for a selection by file or list, before nodes are added to `mesh`. `resolve` turns relative paths of
    /// the scene into real ones.
    pub fn prepare(&self, mesh: &mut TetMesh, resolve: impl Fn(&Path) -> PathBuf) -> Result<(), String> {
        if let Nodes::File(path) = self {
            let nodes = tags(mesh, &resolve(path))?;
            mesh.groups.insert(file_group(path), nodes);
        }
        if let Nodes::List(tags) = self {
            let index: BTreeMap<u64, u32> = mesh.tags.iter().copied().zip(0..).collect();
            let missing = |tag: &u64| format!("list: the mesh has no used node with tag {tag}");
            let nodes = tags.iter().map(|tag| index.get(tag).copied().ok_or_else(|| missing(tag)));
            let mut nodes: Vec<u32> = nodes.collect::<Result<_, _>>()?;
            nodes.sort_unstable();
            nodes.dedup();
            mesh.groups.insert(list_group(tags), nodes);
        }
        Ok(())
    }

    /// Ascending node indices in a [prepared](Nodes::prepare) mesh. The error says what was looked for and what there
    /// is instead; an empty choice is an error.
    pub fn select(&self, mesh: &TetMesh) -> Result<Vec<u32>, String> {
        let within = |inside: &dyn Fn(&Vector3<f64>) -> bool| -> Vec<u32> {
            (0..mesh.nodes.len() as u32).filter(|&node| inside(&mesh.nodes[node as usize])).collect()
        };
        let nodes = match self {
            Nodes::Group(name) => group(mesh, name)?,
            Nodes::Box { min, max } => {
                within(&|x| (0..3).all(|axis| min[axis] <= x[axis] && x[axis] <= max[axis]))
            }
            Nodes::Sphere { centre, radius } => {
                let centre = Vector3::from(*centre);
                within(&|x| (x - centre).norm() <= *radius)
            }
            Nodes::Plane { point, normal, distance } => {
                let (point, normal) = (Vector3::from(*point), Vector3::from(*normal));
                // Of any length: its square need not be a number.
                let normal = (normal / normal.amax()).normalize();
                within(&|x| normal.dot(&(x - point)).abs() <= *distance)
            }
            Nodes::Geodesic { from, radius } => grown(mesh, &Vector3::from(*from), *radius)?,
            Nodes::List(tags) => group(mesh, &list_group(tags))?,
            Nodes::File(path) => group(mesh, &file_group(path))?,
        };
        if nodes.is_empty() {
            let (low, high) = bounding_box(&mesh.nodes);
            return Err(format!(
                "selects no node; the mesh spans ({}, {}, {}) to ({}, {}, {}) m",
                low.x, low.y, low.z, high.x, high.y, high.z
            ));
        }
        Ok(nodes)
    }
}

/// The group of the nodes in a list.
fn list_group(tags: &[u64]) -> String {
    format!("list {tags:?}")
}

/// The group of the nodes in a tag file.
fn file_group(path: &Path) -> String {
    format!("file {}", path.display())
}

fn group(mesh: &TetMesh, name: &str) -> Result<Vec<u32>, String> {
    if let Some(nodes) = mesh.groups.get(name) {
        return Ok(nodes.clone());
    }
    let known: Vec<&str> = mesh.groups.keys().map(String::as_str).collect();
    if known.is_empty() {
        return Err(format!(
            "\"{name}\" is no node group: the mesh has none; select by box, sphere, plane, grow or file"
        ));
    }
    Err(unknown_name("node group", name, known.into_iter()))
}

fn grown(mesh: &TetMesh, from: &Vector3<f64>, radius: f64) -> Result<Vec<u32>, String> {
    let Some((start, distance)) = geodesic::nearest(mesh, &Surface::from_mesh(mesh).nodes, from) else {
        return Ok(Vec::new());
    };
    if distance > radius {
        return Err(format!(
            "grow: from is {} m from the nearest surface node (tag {}, {}), and the radius {radius} m. Move \
             it there, or enlarge the radius",
            digits(distance),
            mesh.tags[start as usize],
            place(&mesh.nodes[start as usize])
        ));
    }
    Ok(geodesic::within(mesh, start, radius))
}

fn tags(mesh: &TetMesh, path: &Path) -> Result<Vec<u32>, String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = String::from_utf8(input::read(path).map_err(|error| failed(&error))?)
        .map_err(|error| failed(&error))?;
    let index: BTreeMap<u64, u32> = mesh.tags.iter().copied().zip(0..).collect();
    let mut nodes = Vec::new();
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let word = line.split('#').next().unwrap_or("").trim();
        if word.is_empty() {
            continue;
        }
        let place = format!("{}:{}", path.display(), number + 1);
        let tag: u64 = word
            .parse()
            .map_err(|error| format!("{place}: {word:?} is not a node tag ({error}); write one a line"))?;
        let node =
            index.get(&tag).ok_or_else(|| format!("{place}: the mesh has no used node with tag {tag}"))?;
        nodes.push(*node);
    }
    nodes.sort_unstable();
    nodes.dedup();
    Ok(nodes)
}

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { nodes = { group = \"left\" }, grab = \"dragger\" }")]
pub struct Control {
    pub nodes: Nodes,
    pub grab: Grab,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grab {
    /// Stays where it is.
    Fixed,
    /// Can be taken by a stylus.
    Dragger,
}

impl Grab {
    /// Name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Grab::Fixed => "fixed",
            Grab::Dragger => "dragger",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};
    use proptest::prelude::*;

    /// Eight corners of the unit cube with tags 10, 20, … 80, the first four of them in group "low".
    fn corners() -> TetMesh {
        let corner = |i: usize| Vector3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        TetMesh {
            nodes: (0..8).map(corner).collect(),
            tags: (1..=8).map(|i| 10 * i).collect(),
            groups: [("low".to_owned(), vec![0, 1, 2, 3])].into(),
            ..Default::default()
        }
    }

    fn select(nodes: &Nodes) -> Result<Vec<u32>, String> {
        let mut mesh = corners();
        nodes.prepare(&mut mesh, Path::to_owned)?;
        nodes.select(&mesh)
    }

    #[test]
    fn every_kind_of_choice_takes_its_bounds_in() {
        assert_eq!(select(&Nodes::Group("low".into())).unwrap(), [0, 1, 2, 3]);
        assert_eq!(select(&Nodes::Box { min: [0.5, 0.0, 0.0], max: [1.0, 1.0, 0.0] }).unwrap(), [1, 3]);
        assert_eq!(select(&Nodes::Sphere { centre: [0.0; 3], radius: 1.0 }).unwrap(), [0, 1, 2, 4]);
        assert_eq!(select(&Nodes::List(vec![80, 10, 80])).unwrap(), [0, 7]);
        assert!(select(&Nodes::List(vec![10, 11])).unwrap_err().contains("tag 11"));
        let plane = Nodes::Plane { point: [9.0, 0.0, 1.0], normal: [0.0, 0.0, -3.0], distance: 0.0 };
        assert_eq!(select(&plane).unwrap(), [4, 5, 6, 7]);
    }

    /// A U of two fingers 0.2 m apart, with a web below: what grows on one finger does not jump to the other.
    #[test]
    fn what_grows_does_not_cross_a_gap() {
        let mut mesh = block(&Block { size: [1.0, 0.2, 1.0], cells: [10, 2, 10] }).unwrap();
        let is_gap = |x: Vector3<f64>| x.x.abs() < 0.1 && x.z > -0.3;
        let kept = |tet: &usize| !is_gap(mesh.corners(*tet).iter().sum::<Vector3<f64>>() / 4.0);
        mesh.tets = (0..mesh.tets.len()).filter(kept).map(|tet| mesh.tets[tet]).collect();
        let from = [-0.1, 0.0, 0.5];
        let right = |nodes: &[u32]| nodes.iter().filter(|&&node| mesh.nodes[node as usize].x > 0.05).count();
        let chosen = |nodes: Nodes| nodes.select(&mesh).unwrap();

        assert!(right(&chosen(Nodes::Sphere { centre: from, radius: 0.5 })) > 0);
        let grown = chosen(Nodes::Geodesic { from, radius: 0.5 });
        assert!(right(&grown) == 0 && grown.len() > 50, "{}", grown.len());
        // Down the finger, 0.8 m, across the web, 0.2 m.
        assert_eq!(right(&chosen(Nodes::Geodesic { from, radius: 0.97 })), 0);
        assert!(right(&chosen(Nodes::Geodesic { from, radius: 1.03 })) > 0);

        let off = Nodes::Geodesic { from: [0.0, 0.0, 0.5], radius: 0.09 };
        let error = off.select(&mesh).unwrap_err();
        assert!(error.contains("0.1000 m from the nearest surface node (tag ") && error.contains("0.09 m"));
        assert!(Nodes::Geodesic { from, radius: 0.0 }.check().unwrap_err().contains("radius 0 above 0"));
        assert!(Nodes::Geodesic { from: [f64::NAN; 3], radius: 1.0 }.check().is_err());
    }

    fn tag_file(name: &str, text: &[u8]) -> Result<Vec<u32>, String> {
        let path = std::env::temp_dir().join(format!("greenstage-{name}-{}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let result = select(&Nodes::File(path.clone()));
        std::fs::remove_file(&path).unwrap();
        result
    }

    #[test]
    fn tag_files_have_comments_and_name_their_lines() {
        assert_eq!(tag_file("good", b"# tags\n80 # last\n\n 10\n80\n").unwrap(), [0, 7]);
        assert_eq!(
            tag_file("marked", "\u{feff}10\n80\n".as_bytes()).unwrap(),
            [0, 7],
            "with a mark of its encoding"
        );
        let unknown = tag_file("unknown", b"10\n11\n").unwrap_err();
        assert!(unknown.contains(":2:") && unknown.contains("tag 11"), "{unknown}");
        let word = tag_file("word", b"10\n\nten\n").unwrap_err();
        assert!(word.contains(":3:") && word.contains("not a node tag"), "{word}");
        assert!(tag_file("empty", b"# nothing\n").unwrap_err().contains("selects no node"));
    }

    proptest! {
        #[test]
        fn no_tag_file_makes_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = tag_file("any", &bytes);
        }
    }
}
