//! Case 30: files that name what is not there, or state things twice.

use super::case::{CaseRows, verdict};
use crate::mesh::parse;
use std::path::Path;

/// A tetrahedron in Gmsh 2.2, with `from` replaced by `to`.
fn forged(from: &str, to: &str) -> String {
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n\
     $Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
     $Elements\n1\n1 4 2 7 1 1 2 3 4\n$EndElements\n"
        .replacen(from, to, 1)
}

pub(super) fn rows() -> CaseRows {
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
    Ok(cases.into_iter().map(read).collect())
}
