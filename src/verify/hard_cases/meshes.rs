//! Cases 8 to 16, 21, 22 and 30: slivers, folds, cracks, loose pieces, units and places; files of meshes.

use super::case::{
    Asked, CaseRow, CaseRows, Must, base, cells, difference, refused, residual, solved, stiffness_difference,
    verdict,
};
use crate::green::{FIELDS, GreenError, Solution};
use crate::mesh::{Encoding, LoadedMesh, MeshError, TetMesh, encode, parse};
use crate::scene::SceneError;
use nalgebra::Vector3;
use std::path::Path;

pub(super) fn rows() -> CaseRows {
    let mut rows = slivers()?;
    rows.extend(orientation()?);
    rows.extend(pieces()?);
    rows.extend(units_and_places()?);
    rows.extend(files());
    Ok(rows)
}

/// The base case with a node moved towards the plane of the opposite face of one tetrahedron, to `height` of the original height.
fn squeezed(height: f64) -> Result<TetMesh, GreenError> {
    let mut mesh = base()?;
    let is_inner = |tet: &[u32; 4]| tet.iter().all(|&node| mesh.nodes[node as usize].norm() < 0.6);
    let inner = mesh.tets.iter().find(|tet| is_inner(tet)).copied();
    if let Some([a, p, q, r]) = inner.map(|tet| tet.map(|node| node as usize)) {
        let [p, q, r] = [p, q, r].map(|node| mesh.nodes[node]);
        let normal = (q - p).cross(&(r - p)).normalize();
        let distance = (mesh.nodes[a] - p).dot(&normal);
        mesh.nodes[a] -= normal * (distance * (1.0 - height));
    }
    Ok(mesh)
}

fn slivers() -> CaseRows {
    let reference = Asked::new(base()?).solve()?;
    let mut rows = Vec::new();
    for height in [1e-2, 1e-4, 1e-6] {
        let asked = Asked::new(squeezed(height)?);
        let case = format!("sliver of height {height:.0e}");
        let must = |measured, bound| match height < 1e-3 {
            true => Must::warn("slivers", measured, bound),
            false => Must::solve(measured, bound),
        };
        rows.push(solved(8, &case, must("change of S", 5e-4), &asked, |solution| {
            Ok(stiffness_difference(solution, &reference))
        })?);
        rows.push(solved(8, &case, must("residual", 4e-10), &asked, residual)?);
    }
    rows.push(refused(9, "tetrahedron without volume", "no volume", &Asked::new(squeezed(0.0)?)));
    Ok(rows)
}

/// `mesh` as a reader makes it from a file.
fn read(mesh: &TetMesh) -> Result<LoadedMesh, GreenError> {
    let failed = |source: MeshError| {
        let path = Path::new("hard-cases.toml").to_owned();
        GreenError::from(SceneError::Mesh { path, line: None, body: "b".into(), source: Box::new(source) })
    };
    let bytes = encode(mesh, Encoding::Gmsh41Binary).map_err(failed)?;
    parse(Path::new("body.msh"), &bytes).map_err(failed)
}

fn orientation() -> CaseRows {
    let reference = Asked::new(base()?).solve()?;
    let must = |words| Must { words, ..Must::solve("against the sound mesh", 1e-13) };
    let against = |solution: &Solution| Ok(difference(solution, &reference, |_| 1.0));
    let mut rows = Vec::new();

    let mut swapped = base()?;
    for tet in [3, 100, 700] {
        swapped.tets[tet].swap(0, 1);
    }
    let asked = Asked { mesh: read(&swapped)?, ..Asked::new(base()?) };
    let case = "three tetrahedra with swapped nodes";
    rows.push(solved(10, case, must("3 of 1250 tetrahedra were oriented negatively"), &asked, against)?);

    for push in [0.45, 0.8] {
        let mut inverted = base()?;
        let near = |x: &Vector3<f64>| (x - Vector3::new(0.1, 0.1, 0.0)).norm() < 1e-9;
        inverted.nodes.iter_mut().filter(|x| near(x)).for_each(|x| x.x += push);
        let case = format!("a node pushed by {push} m through its neighbours");
        rows.push(refused(11, case, "folded", &Asked { mesh: read(&inverted)?, ..Asked::new(base()?) }));
    }

    let mut unused = base()?;
    unused.nodes.push(Vector3::new(5.0, 0.0, 0.0));
    unused.tags.push(9999);
    let asked = Asked { mesh: read(&unused)?, ..Asked::new(base()?) };
    let words = "1 nodes belong to no tetrahedron and have been dropped (node 9999)";
    rows.push(solved(15, "a node of no tetrahedron", must(words), &asked, against)?);
    Ok(rows)
}

/// The base case and a cube of 1 m, moved by `shift`; with `merge` they share the nodes at equal places.
fn joined(shift: Vector3<f64>, merge: bool) -> Result<TetMesh, GreenError> {
    let (mut mesh, other) = (base()?, cells([1.0; 3], [5; 3])?);
    let count = mesh.nodes.len();
    let mut index = Vec::new();
    for x in &other.nodes {
        let place = x + shift;
        let same = mesh.nodes[..count].iter().position(|y| (y - place).norm() < 1e-9);
        index.push(same.filter(|_| merge).unwrap_or(mesh.nodes.len()) as u32);
        if index.last() == Some(&(mesh.nodes.len() as u32)) {
            mesh.nodes.push(place);
        }
    }
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    mesh.tets.extend(other.tets.iter().map(|tet| tet.map(|node| index[node as usize])));
    mesh.regions.resize(mesh.tets.len(), 0);
    Ok(mesh)
}

/// Blocks of 1 m on top of each other, whose layers between them were never merged.
fn stacked(blocks: u32) -> Result<TetMesh, GreenError> {
    let one = cells([1.0; 3], [4; 3])?;
    let count = one.nodes.len() as u32;
    let mut mesh = TetMesh::default();
    for level in 0..blocks {
        mesh.nodes.extend(one.nodes.iter().map(|x| x + Vector3::new(0.0, 0.0, f64::from(level))));
        mesh.tets.extend(one.tets.iter().map(|tet| tet.map(|node| node + count * level)));
    }
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    mesh.regions = vec![0; mesh.tets.len()];
    let top = one.groups["zmax"].iter().map(|node| node + count * (blocks - 1)).collect();
    mesh.groups = [("zmin".to_owned(), one.groups["zmin"].clone()), ("zmax".to_owned(), top)].into();
    Ok(mesh)
}

fn pieces() -> CaseRows {
    let beside = |x: f64, y: f64, z: f64, merge| joined(Vector3::new(x, y, z), merge).map(Asked::new);
    let crack = Must::warn("25 pairs of nodes lie at the same place", "residual", 1e-12);
    let not_merged = "a layer of nodes not merged, both halves held";
    let gap = Must::warn("merge nodes with a tolerance above 1.000e-7 m", "residual", 1e-12);
    let mut gaping = stacked(2)?;
    let upper = gaping.nodes.len() / 2;
    gaping.nodes[upper..].iter_mut().for_each(|x| x.z += 1e-7);
    Ok(vec![
        refused(12, "floating piece", "piece 2 of 2", &beside(3.0, 0.0, 0.0, false)?),
        solved(13, not_merged, crack, &Asked::new(stacked(2)?), residual)?,
        solved(13, "two halves 1e-7 m apart, both held", gap, &Asked::new(gaping), residual)?,
        refused(14, "two layers not merged, the middle floats", "piece 2 of 3", &Asked::new(stacked(3)?)),
        refused(
            16,
            "a piece on an edge",
            "join it to the rest by shared faces",
            &beside(1.0, 1.0, 0.5, true)?,
        ),
        refused(16, "a piece on a corner", "held at a single node", &beside(1.0, 1.0, 1.5, true)?),
    ])
}

fn units_and_places() -> CaseRows {
    let scaled = |unit: f64, offset: f64| -> Result<Asked, GreenError> {
        let mut mesh = base()?;
        mesh.nodes.iter_mut().for_each(|x| *x = *x * unit + Vector3::repeat(offset));
        Ok(Asked::new(mesh))
    };
    let reference = Asked::new(base()?).solve()?;
    let mut rows = Vec::new();
    for unit in [1e-9, 1e-3, 1e6] {
        // Fields of T keep their numbers, fields of M are lengths.
        let scale = |c: usize| if c % FIELDS < 3 { 1.0 } else { 1.0 / unit };
        let must = Must::solve("against metres", 1e-13);
        let case = format!("coordinates in units of {unit:.0e} m");
        rows.push(solved(21, case, must, &scaled(unit, 0.0)?, |solution| {
            Ok(difference(solution, &reference, scale))
        })?);
    }
    const AGAINST: &str = "against the body at its origin";
    for (offset, must) in [
        (1e3, Must::solve(AGAINST, 1e-12)),
        (1e6, Must::solve(AGAINST, 1e-9)),
        (1e9, Must::warn("digits left", AGAINST, 1e-6)),
    ] {
        let case = format!("moved by {offset:.0e} m");
        rows.push(solved(22, case, must, &scaled(1.0, offset)?, |solution| {
            Ok(difference(solution, &reference, |_| 1.0))
        })?);
    }
    Ok(rows)
}

/// A tetrahedron in Gmsh 2.2, with `from` replaced by `to`.
fn forged(from: &str, to: &str) -> String {
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n\
     $Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
     $Elements\n1\n1 4 2 7 1 1 2 3 4\n$EndElements\n"
        .replacen(from, to, 1)
}

/// Files that name what is not there, or state things twice.
fn files() -> Vec<CaseRow> {
    let cases = [
        (
            "an element of a node that is not there",
            "1 1 2 3 4\n$",
            "1 1 2 3 9\n$",
            "m.msh:13: element 1 names node 9",
        ),
        (
            "a tetrahedron that names a node twice",
            "1 1 2 3 4\n$",
            "1 1 2 3 3\n$",
            "m.msh:13: tetrahedron 1 names",
        ),
        (
            "a tetrahedron that is there twice",
            "1\n1 4 2 7 1 1 2 3 4\n",
            "2\n1 4 2 7 1 1 2 3 4\n2 4 2 7 1 2 1 4 3\n",
            "m.msh:14: tetrahedron 2 has the same nodes",
        ),
        ("a node that is defined twice", "\n2 1 0 0", "\n1 1 0 0", "m.msh:7: node 1 is defined twice"),
        ("a coordinate that is no number", "2 1 0 0", "2 nan 0 0", "m.msh:7: node 2 has a coordinate"),
        ("a file cut short", "$EndElements\n", "", "m.msh:14: the file ends"),
        ("a mesh without elements", "1\n1 4 2 7 1 1 2 3 4\n", "0\n", "the file holds no elements"),
    ];
    let read = |(case, from, to, words)| {
        let error = parse(Path::new("m.msh"), forged(from, to).as_bytes()).err();
        verdict(30, case, words, error.map(|error| error.to_string()))
    };
    cases.into_iter().map(read).collect()
}
