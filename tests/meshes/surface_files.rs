//! Surface files: the same body from every format, what is repaired, and no bytes that make a reader panic, hang or
//! take memory.

use greenstage::mesh::quality::signed_volume;
use greenstage::mesh::surface_check::{SurfaceReport, check};
use greenstage::mesh::surface_files::{LoadedSurface, parse};
use proptest::prelude::*;
use small::{OBJ, TRIANGLES, VERTICES, samples, stl_binary};
use std::path::Path;

mod small;

fn read(name: &str, bytes: &[u8]) -> Result<LoadedSurface, String> {
    parse(Path::new(name), bytes).map_err(|error| error.to_string())
}

fn checked(name: &str, bytes: &[u8]) -> (SurfaceReport, Vec<String>) {
    let LoadedSurface { mut surface, mut notices } = read(name, bytes).unwrap();
    (check(&mut surface, &mut notices), notices)
}

#[test]
fn every_format_gives_the_same_body() {
    for (name, bytes) in samples() {
        let (report, notices) = checked(name, &bytes);
        assert_eq!((report.vertices, report.triangles, report.shells.len()), (4, 4, 1), "{name}");
        assert!((report.volume - 1.0 / 6.0).abs() < 1e-15, "{name}: {}", report.volume);
        assert!(
            report.faults().is_empty() && notices.is_empty(),
            "{name}: {:?} {notices:?}",
            report.faults()
        );
    }
}

/// The pole of a sphere, where sin π is not quite 0, was a ring of vertices and so a hole.
#[test]
fn vertices_that_rounding_moved_apart_are_one() {
    let corner = |t: usize, vertex: u32| {
        let [x, y, z] = VERTICES[vertex as usize].map(|x| f64::from(x) - 3e-8 * t as f64);
        format!("vertex {x:e} {y:e} {z:e}\n")
    };
    let facet = |(t, corners): (usize, &[u32; 3])| {
        let loops: String = corners.iter().map(|&vertex| corner(t, vertex)).collect();
        format!("facet normal 0 0 0\nouter loop\n{loops}endloop\nendfacet\n")
    };
    let text: String = TRIANGLES.iter().enumerate().map(facet).collect();
    let (report, notices) = checked("a.stl", format!("solid a\n{text}endsolid a\n").as_bytes());
    assert_eq!((report.vertices, report.triangles, report.faults()), (4, 4, Vec::new()));
    assert_eq!(notices, [""; 0]);
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    for (name, text, expected) in [
        ("a.obj", "v 0 0 0\nv 1 0\n", "a.obj:2: a coordinate is missing"),
        ("a.obj", "v 0 0 0\nv 1 0 one\n", "a.obj:2: \"one\" is not a number"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "a.obj:4: a face names vertex 4, and there are 3"),
        ("a.obj", "v 0 0 0\nf 1 0 1\n", "a.obj:2: vertex number 0 points nowhere"),
        ("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 1 at (0, 0, NaN)"),
        ("a.obj", "surf 0 1 0 1\n", "a.obj:1: free-form"),
        ("a.obj", "", "no triangle"),
        (
            "a.stl",
            "solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nendloop\n",
            "a.stl:6: a facet has 2 corners",
        ),
        ("a.stl", "solid\nfacet\nouter loop\nvertex 0 0", "a.stl:4: a coordinate is missing"),
        ("a.stl", "nonsense", "neither a text"),
        ("a.ply", "ply\nelement vertex 1\nend_header\n", "a.ply:3: the header names no format"),
        ("a.ply", "plyx\n", "a.ply:1: the first line"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\nproperty float \
             z\nend_header\n1 2 3\n",
            "cut short",
        ),
        ("a.off", "OFF", "not a surface file"),
    ] {
        let text = read(name, text.as_bytes()).unwrap_err();
        assert!(text.contains(expected), "{text}\nlacks {expected}");
    }
    let mut cut = stl_binary(b"");
    cut.truncate(cut.len() - 20);
    assert!(read("a.stl", &cut).unwrap_err().contains("the header says 4 triangles"));
}

#[test]
fn repairs_are_told() {
    // One triangle turned round, one twice, one of two vertices.
    let mut text = OBJ.replace("f 1 3 2", "f 1 2 3");
    text += "f 2 3 4\nf 1 1 2\n";
    let (report, notices) = checked("a.obj", text.as_bytes());
    assert!((report.volume - 1.0 / 6.0).abs() < 1e-15);
    let all = notices.join("\n");
    for expected in
        ["1 triangles were turned round", "1 triangles that stand in the file twice", "fewer than three"]
    {
        assert!(all.contains(expected), "{all}\nlacks {expected}");
    }
    // All inside out.
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";
    let (report, notices) = checked("a.obj", text.as_bytes());
    assert!((report.volume - 1.0 / 6.0).abs() < 1e-15 && notices[0].contains("inside out"), "{notices:?}");
}

#[test]
fn shells_holes_and_crossings_are_found() {
    let tetrahedron = |at: [f64; 3], size: f64, first: usize| {
        let mut text = String::new();
        for v in VERTICES {
            let [x, y, z] = std::array::from_fn(|axis| at[axis] + size * f64::from(v[axis]));
            text += &format!("v {x} {y} {z}\n");
        }
        for [a, b, c] in TRIANGLES.map(|t| t.map(|v| v as usize + first)) {
            text += &format!("f {a} {b} {c}\n");
        }
        text
    };
    let one = tetrahedron([0.0; 3], 1.0, 1);
    // Inside the first: a cavity, whichever way it is turned.
    let (report, notices) = checked("a.obj", (one.clone() + &tetrahedron([0.1; 3], 0.3, 5)).as_bytes());
    assert_eq!(report.shells.iter().map(|s| s.is_cavity).collect::<Vec<_>>(), [false, true]);
    assert!(
        (report.volume - (1.0 - 0.027) / 6.0).abs() < 1e-15 && notices[0].contains("cavities"),
        "{notices:?}"
    );
    // Beside it.
    let (report, _) = checked("a.obj", (one.clone() + &tetrahedron([5.0, 0.0, 0.0], 1.0, 5)).as_bytes());
    assert!((report.volume - 2.0 / 6.0).abs() < 1e-15 && report.intersections.pairs == 0);
    // Through it.
    let (report, _) = checked("a.obj", (one.clone() + &tetrahedron([0.2, 0.2, -0.5], 1.0, 5)).as_bytes());
    assert!(report.intersections.pairs > 0 && report.faults()[0].contains("passes through itself"));
    // Without its last triangle.
    let (report, _) = checked("a.obj", one.rsplit_once("f ").unwrap().0.as_bytes());
    assert_eq!((report.holes.len(), report.holes[0].edges), (1, 3));
    // Three triangles on one edge.
    let (report, _) = checked("a.obj", (one + "v 9 9 9\nf 1 2 5\n").as_bytes());
    assert_eq!(report.crowded_edges, 1);
    // A Möbius band of five triangles.
    let band: String =
        (0..5).map(|i| format!("f {} {} {}\n", i + 1, (i + 1) % 5 + 1, (i + 2) % 5 + 1)).collect();
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 1 1 1\n".to_owned() + &band;
    let (report, _) = checked("a.obj", text.as_bytes());
    assert!(report.unorientable_edges > 0, "{report:?}");
}

/// Whatever comes out of a file is sound enough for all that follows.
fn survives(name: &str, bytes: &[u8]) {
    if let Ok(LoadedSurface { mut surface, mut notices }) = read(name, bytes) {
        let count = surface.vertices.len() as u32;
        assert!(surface.triangles.iter().flatten().all(|&vertex| vertex < count));
        assert!(surface.vertices.len() <= bytes.len() && surface.triangles.len() <= bytes.len());
        let report = check(&mut surface, &mut notices);
        let cell = greenstage::mesh::isosurface_stuffing::suggested_cell(&surface);
        let filled = greenstage::mesh::isosurface_stuffing::tetrahedralise(
            &surface,
            &report,
            4.0 * cell,
            &mut notices,
        );
        if let Ok(mesh) = filled {
            assert!((0..mesh.tets.len()).all(|t| signed_volume(&mesh.corners(t)) > 0.0));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400), which in 0..7usize) {
        survives(samples()[which].0, &bytes);
    }

    /// Some bytes of a good file changed, some cut off, some put in twice.
    #[test]
    fn no_mutation_makes_it_panic(
        which in 0..7usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut in proptest::option::of(any::<prop::sample::Index>()),
        twice in proptest::option::of((any::<prop::sample::Index>(), any::<prop::sample::Index>())),
    ) {
        let (name, mut bytes) = samples().swap_remove(which);
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Some((from, to)) = twice {
            let (from, to) = (from.index(bytes.len()), to.index(bytes.len()));
            let part = bytes[from.min(to)..from.max(to)].to_vec();
            bytes.extend(part);
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        survives(name, &bytes);
    }
}
