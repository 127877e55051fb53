//! `greenstage deform --surface`: what other readers find in the STL, PLY and glTF files of a pose.

use crate::common::{coarse_demo, folder, greenstage};
use greenstage::mesh::surface_files;
use nalgebra::Vector3;

const POSES: &str = "[[pose]]\nname = \"pulled\"\ncontrol.right = { translation = [0.1, 0.0, 0.0] }\n\
                     [[pose]]\nname = \"at rest\"\n";

/// Volume inside of a closed surface: of outward triangles, positive.
fn volume(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        a.dot(&b.cross(&c)) / 6.0
    };
    triangles.iter().map(of).sum()
}

#[test]
fn the_surfaces_of_a_pose_are_closed_and_as_long_as_the_pose_says() {
    let place = folder("surface-export");
    coarse_demo(&place);
    std::fs::write(place.join("poses.toml"), POSES).unwrap();
    let out = place.join("out/tube");
    let arguments = ["deform", "tube.toml", "--poses", "poses.toml", "--surface", "stl,ply,obj,glb", "-o"];
    greenstage(&place, &[&arguments[..], &[out.to_str().unwrap()]].concat());
    for (pose, length) in [("pulled", 1.1), ("at-rest", 1.0)] {
        let mut volumes = Vec::new();
        for format in ["stl", "ply", "obj"] {
            let path = place.join(format!("out/tube.{pose}.{format}"));
            let surface = surface_files::load(&path).unwrap().surface;
            let xs = || surface.vertices.iter().map(|vertex| vertex.x);
            let extent = xs().fold(f64::MIN, f64::max) - xs().fold(f64::MAX, f64::min);
            assert!((extent - length).abs() < 1e-5, "{pose}, {format}: {extent} m long");
            let mut edges = std::collections::BTreeMap::new();
            for [a, b, c] in &surface.triangles {
                for edge in [(a, b), (b, c), (c, a)] {
                    *edges.entry(edge).or_insert(0) += 1;
                }
            }
            assert!(
                edges.iter().all(|((a, b), count)| *count == 1 && edges.contains_key(&(*b, *a))),
                "closed"
            );
            volumes.push(volume(&surface.vertices, &surface.triangles));
        }
        let is_first = |volume: &f64| (volume / volumes[0] - 1.0).abs() < 1e-5;
        assert!(volumes[0] > 0.0 && volumes.iter().all(is_first), "{volumes:?}");
        let glb = std::fs::read(place.join(format!("out/tube.{pose}.glb"))).unwrap();
        assert_eq!(glb[..8], [b'g', b'l', b'T', b'F', 2, 0, 0, 0]);
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let root: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        let position = &root["accessors"][0];
        let x = |bound: &str| position[bound][0].as_f64().unwrap();
        let expected = if pose == "pulled" { 1.1 } else { 1.0 };
        assert!((x("max") - x("min") - expected).abs() < 1e-5);
        assert_eq!(root["nodes"][0]["name"], "tube");
    }
}

#[test]
fn an_unknown_surface_format_is_answered_with_the_known_ones() {
    let place = folder("surface-export-unknown");
    coarse_demo(&place);
    std::fs::write(place.join("poses.toml"), POSES).unwrap();
    let output = crate::common::attempt(
        &place,
        &["deform", "tube.toml", "--poses", "poses.toml", "--surface", "off", "-o", "x"],
    );
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("stl") && said.contains("glb"), "{said}");
}
