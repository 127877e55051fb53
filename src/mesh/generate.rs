//! Structured meshes of any resolution: a tube and a block.
//!
//! In: sizes in metres and numbers of cells. Out: a [`TetMesh`] centred on the origin, with node groups.
//!
//! Each hexahedral cell becomes five tetrahedra, one inside and four corners cut off, in mirror images from cell to
//! cell so that the diagonals of shared faces agree. Against the six tetrahedra of Kuhn's split (all around one
//! space diagonal) the worst quality in a cube is 0.77 instead of 0.66, there are a sixth fewer elements, and no
//! direction is preferred, where Kuhn's parallel diagonals wind around a tube like a thread.

use super::quality::signed_volume;
use super::tet_mesh::TetMesh;
use crate::base::machine::{self, TooLarge};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Largest number of tetrahedra that is not refused.
pub const MAX_TETRAHEDRA: u128 = 20_000_000;
/// Bytes that a tetrahedron takes while a mesh is made and checked.
pub(super) const MEMORY: f64 = 200.0;

/// A tube along x, centred on the origin: (radial + 1)·around·(along + 1) nodes, 5·radial·around·along tetrahedra.
///
/// Its groups: "left" and "right", all nodes within `control_length` of the ends at -x and +x; "inner" and "outer",
/// the nodes on the two walls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tube {
    pub inner_radius: f64,
    pub outer_radius: f64,
    pub length: f64,
    /// Cells through the wall.
    pub radial: u32,
    /// Cells around; even, since neighbours are mirror images.
    pub around: u32,
    /// Cells along the axis.
    pub along: u32,
    /// 0 takes the end faces only; less than half the length.
    pub control_length: f64,
}

/// A ring for tests whose wall is one cell thick.
#[cfg(test)]
pub(crate) const RING: Tube = Tube {
    inner_radius: 0.5,
    outer_radius: 1.0,
    length: 1.0,
    radial: 1,
    around: 8,
    along: 4,
    control_length: 0.25,
};

/// A block centred on the origin: Π(cells + 1) nodes, 5·Π cells tetrahedra.
///
/// Its groups are the nodes of its six faces: "xmin", "xmax", "ymin", "ymax", "zmin", "zmax".
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    pub size: [f64; 3],
    pub cells: [u32; 3],
}

/// The reason why a mesh could not be generated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GenerateError {
    #[error("{name} is {value} m: a positive, finite length is needed")]
    Length { name: &'static str, value: f64 },
    #[error("outer_radius ({outer} m) must be greater than inner_radius ({inner} m)")]
    Radii { inner: f64, outer: f64 },
    #[error(
        "control_length is {control_length} m: it must be 0 or more and leave some of the length {length} m \
         free between the two ends"
    )]
    Control { control_length: f64, length: f64 },
    #[error("{name} is {cells} cells: at least {least} are needed")]
    Cells { name: &'static str, cells: u32, least: u32 },
    #[error("around is {around} cells: an even number is needed")]
    Odd { around: u32 },
    #[error("{tetrahedra} tetrahedra are more than {MAX_TETRAHEDRA}: take fewer cells")]
    TooMany { tetrahedra: u128 },
    #[error("{0}: take fewer cells")]
    Memory(#[from] TooLarge),
    #[error(
        "tetrahedron {tet} has volume {volume} m³: sizes so small, large or unlike cannot be computed with"
    )]
    Volume { tet: usize, volume: f64 },
    #[error("{0}")]
    Blobs(String),
}

impl Tube {
    /// The middle between two points in (x, r, θ): on the wall between two points of the wall.
    pub fn curve(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
        let (ra, rb) = (a.yz().norm(), b.yz().norm());
        let towards = a.yz() / ra + b.yz() / rb;
        let length = towards.norm();
        // Of opposite sides, which no tetrahedron joins, either way round would do.
        if length == 0.0 || length.is_nan() {
            return (a + b) * 0.5;
        }
        let across = towards * (0.5 * (ra + rb) / length);
        Vector3::new(0.5 * (a.x + b.x), across.x, across.y)
    }
}

pub fn tube(tube: &Tube) -> Result<TetMesh, GenerateError> {
    let &Tube { inner_radius, outer_radius, length, radial, around, along, control_length } = tube;
    check_length("inner_radius", inner_radius)?;
    check_length("outer_radius", outer_radius)?;
    check_length("length", length)?;
    if outer_radius <= inner_radius {
        return Err(GenerateError::Radii { inner: inner_radius, outer: outer_radius });
    }
    let cells = [("along", along, 1), ("radial", radial, 1), ("around", around, 4)];
    check_cells(cells)?;
    if around % 2 == 1 {
        return Err(GenerateError::Odd { around });
    }
    let control_layers = f64::floor(control_length / length * f64::from(along) + 1e-9);
    let is_control = control_length >= 0.0 && 2.0 * control_layers < f64::from(along);
    if !is_control {
        return Err(GenerateError::Control { control_length, length });
    }

    let mut nodes = Vec::new();
    let mut groups = Groups::new(["left", "right", "inner", "outer"]);
    for i in 0..=along {
        let x = length * (f64::from(i) / f64::from(along) - 0.5);
        for k in 0..around {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
            for j in 0..=radial {
                let t = f64::from(j) / f64::from(radial);
                let radius = inner_radius * (1.0 - t) + outer_radius * t;
                groups.add(
                    nodes.len(),
                    [
                        f64::from(i) <= control_layers,
                        f64::from(along - i) <= control_layers,
                        j == 0,
                        j == radial,
                    ],
                );
                nodes.push(Vector3::new(x, radius * cos, radius * sin));
            }
        }
    }
    let node = |[i, j, k]: [u32; 3]| (i * around + k % around) * (radial + 1) + j;
    finish(nodes, split([along, radial, around], node), groups)
}

pub fn block(block: &Block) -> Result<TetMesh, GenerateError> {
    let &Block { size, cells } = block;
    for (name, value) in ["size[0]", "size[1]", "size[2]"].into_iter().zip(size) {
        check_length(name, value)?;
    }
    check_cells([("cells[0]", cells[0], 1), ("cells[1]", cells[1], 1), ("cells[2]", cells[2], 1)])?;

    let mut nodes = Vec::new();
    let mut groups = Groups::new(["xmin", "xmax", "ymin", "ymax", "zmin", "zmax"]);
    for i in 0..=cells[0] {
        for j in 0..=cells[1] {
            for k in 0..=cells[2] {
                let ijk = [i, j, k];
                let on = |axis: usize, end: u32| ijk[axis] == end;
                let faces = [0, 1, 2].map(|axis| [on(axis, 0), on(axis, cells[axis])]);
                let [[x0, x1], [y0, y1], [z0, z1]] = faces;
                groups.add(nodes.len(), [x0, x1, y0, y1, z0, z1]);
                nodes.push(Vector3::from_fn(|axis, _| {
                    size[axis] * (f64::from(ijk[axis]) / f64::from(cells[axis]) - 0.5)
                }));
            }
        }
    }
    let node = |[i, j, k]: [u32; 3]| (i * (cells[1] + 1) + j) * (cells[2] + 1) + k;
    finish(nodes, split(cells, node), groups)
}

pub(super) fn check_length(name: &'static str, value: f64) -> Result<(), GenerateError> {
    let is_length = value.is_finite() && value > 0.0;
    if is_length { Ok(()) } else { Err(GenerateError::Length { name, value }) }
}

/// Name, number and least number of cells in each direction.
fn check_cells(cells: [(&'static str, u32, u32); 3]) -> Result<(), GenerateError> {
    for (name, cells, least) in cells {
        if cells < least {
            return Err(GenerateError::Cells { name, cells, least });
        }
    }
    let tetrahedra = 5 * cells.iter().map(|(_, cells, _)| u128::from(*cells)).product::<u128>();
    if tetrahedra > MAX_TETRAHEDRA {
        return Err(GenerateError::TooMany { tetrahedra });
    }
    machine::expect(format!("a mesh of {tetrahedra} tetrahedra"), MEMORY * tetrahedra as f64)?;
    Ok(())
}

/// Node groups while a mesh is generated.
struct Groups<const N: usize> {
    names: [&'static str; N],
    nodes: [Vec<u32>; N],
}

impl<const N: usize> Groups<N> {
    fn new(names: [&'static str; N]) -> Groups<N> {
        Groups { names, nodes: names.map(|_| Vec::new()) }
    }

    /// Adds a node to each group of which it `is_member`; nodes come in ascending order.
    fn add(&mut self, node: usize, is_member: [bool; N]) {
        for (nodes, _) in self.nodes.iter_mut().zip(is_member).filter(|(_, is_member)| *is_member) {
            nodes.push(node as u32);
        }
    }
}

/// Five tetrahedra for each of `cells`, whose corners `node` numbers; its three directions are right-handed.
fn split(cells: [u32; 3], node: impl Fn([u32; 3]) -> u32) -> Vec<[u32; 4]> {
    let mut tets = Vec::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                let corner = |bits: u32| node([i + (bits >> 2), j + (bits >> 1 & 1), k + (bits & 1)]);
                // The inner tetrahedron, and each corner that is cut off with its neighbours along the axes.
                let cell = if (i + j + k) % 2 == 0 {
                    [[0, 5, 6, 3], [4, 6, 0, 5], [2, 0, 6, 3], [1, 3, 5, 0], [7, 5, 3, 6]]
                } else {
                    [[7, 1, 2, 4], [0, 4, 2, 1], [3, 7, 1, 2], [5, 1, 7, 4], [6, 2, 4, 7]]
                };
                tets.extend(cell.map(|tet| tet.map(corner)));
            }
        }
    }
    tets
}

fn finish<const N: usize>(
    nodes: Vec<Vector3<f64>>,
    tets: Vec<[u32; 4]>,
    groups: Groups<N>,
) -> Result<TetMesh, GenerateError> {
    let mesh = TetMesh {
        tags: (1..=nodes.len() as u64).collect(),
        regions: vec![0; tets.len()],
        region_names: BTreeMap::new(),
        groups: groups.names.into_iter().map(str::to_owned).zip(groups.nodes).collect(),
        nodes,
        tets,
        mids: Vec::new(),
        triangles: Vec::new(),
    };
    for tet in 0..mesh.tets.len() {
        let volume = signed_volume(&mesh.corners(tet));
        if !(volume.is_finite() && volume > 0.0) {
            return Err(GenerateError::Volume { tet, volume });
        }
    }
    Ok(mesh)
}
