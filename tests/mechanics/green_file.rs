//! The .green file: what is written is what is read, and no damage passes.

use crate::common;

use common::{block_scene, folder, scene, some_pose};
use greenstage::deform::Deformer;
use greenstage::green::{self, FIELDS, GreenError, GreenFile, Needs};
use greenstage::solve::Silent;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const HAPTICS: Needs = Needs { stiffness: true };

fn written(name: &str, needs: Needs) -> (PathBuf, green::Precomputed) {
    let path = folder(name).join("block.green");
    let precomputed = green::precompute(&block_scene([2, 1, 1], ""), "block", needs, &Silent).unwrap();
    green::write(&path, std::slice::from_ref(&precomputed)).unwrap();
    (path, precomputed)
}

#[test]
fn round_trip_keeps_every_number_to_f32() {
    let (path, precomputed) = written("green-round-trip", HAPTICS);
    let file = GreenFile::open(&path).unwrap();
    let solution = &precomputed.solution;
    let body = &file.meta.bodies["block"];
    let nodes = &solution.surface.nodes;
    assert_eq!((body.surface_nodes, file.tags("block").len()), (nodes.len(), nodes.len()));
    assert_eq!(file.triangles("block"), solution.surface.triangles);
    for (e, control) in solution.controls.iter().enumerate() {
        let columns = file.basis("block", &control.name);
        for k in 0..FIELDS {
            for (i, &node) in nodes.iter().enumerate() {
                for axis in 0..3 {
                    let stored = columns.value(nodes.len(), k, 3 * i + axis);
                    let solved = solution.fields.row(3 * node as usize + axis)[FIELDS * e + k];
                    assert_eq!(stored, solved as f32);
                }
            }
        }
        let held: Vec<u32> =
            file.control("block", &control.name).iter().map(|&i| nodes[i as usize]).collect();
        assert_eq!(held, control.nodes);
    }
    assert_eq!(file.stiffness("block"), solution.stiffness);
}

/// Half the bytes: every number is within the error that the file states for its field, and no smaller error is true.
#[test]
fn compact_columns_are_as_exact_as_their_file_says() {
    for (storage, bound) in [("f16", 2.5e-4), ("int16", 1.6e-5)] {
        let path = folder(&format!("green-{storage}")).join("block.green");
        let scene = block_scene([3, 2, 2], &format!("storage = \"{storage}\""));
        let precomputed = green::precompute(&scene, "block", HAPTICS, &Silent).unwrap();
        green::write(&path, std::slice::from_ref(&precomputed)).unwrap();
        let file = Arc::new(GreenFile::open(&path).unwrap());
        let (meta, solution) = (&file.meta.bodies["block"], &precomputed.solution);
        let nodes = &solution.surface.nodes;
        let mut largest: f64 = 0.0;
        for (e, control) in meta.controls.iter().enumerate() {
            let basis = file.basis("block", &control.name);
            for k in 0..FIELDS {
                let exact = |i: usize| solution.fields.row(3 * nodes[i / 3] as usize + i % 3)[FIELDS * e + k];
                let sizes = (0..3 * nodes.len()).map(|i| exact(i).abs());
                let size = sizes.fold(0.0, f64::max);
                let errors = (0..3 * nodes.len())
                    .map(|i| (f64::from(basis.value(nodes.len(), k, i)) - exact(i)).abs());
                let error = errors.fold(0.0, f64::max);
                assert!(
                    (error - control.storage_errors[k]).abs() <= 1e-7 * size,
                    "{storage} field {k}: {error}"
                );
                largest = largest.max(if size == 0.0 { 0.0 } else { error / size });
            }
        }
        assert!(
            largest <= bound && (largest / meta.accuracy.storage_error - 1.0).abs() < 0.01,
            "{largest:e}"
        );
        let mut deformer = Deformer::new(file.clone(), "block", "linear").unwrap();
        let poses = vec![some_pose(0.3), some_pose(2.0)];
        deformer.evaluate(&poses);
        let c: Vec<f64> = poses.iter().flat_map(|pose| pose.coefficients()).collect();
        // Σ |c_k| times the error that the file states for field k, and the rounding of the sum itself.
        let stated = meta.controls.iter().flat_map(|control| &control.storage_errors);
        let most = stated.zip(&c).map(|(error, c)| error * c.abs()).sum::<f64>() + 1e-6;
        let mut worst: f64 = 0.0;
        for (i, &node) in nodes.iter().enumerate() {
            for axis in 0..3 {
                let row = solution.fields.row(3 * node as usize + axis);
                let exact: f64 = row.iter().zip(&c).map(|(u, c)| u * c).sum();
                let error = (deformer.displacement(i)[axis] - exact).abs();
                worst = worst.max(error);
            }
        }
        assert!(worst <= most && worst > 0.02 * most, "{storage}: {worst:e} of {most:e}");
    }
}

#[test]
fn packed_files_unpack_to_the_same_bytes_and_damage_is_told() {
    let (path, _) = written("green-packed", HAPTICS);
    let (small, back) = (green::packed_path(&path), path.with_extension("back.green"));
    let (whole, packed) = green::pack(&path, &small).unwrap();
    assert_eq!(whole, std::fs::metadata(&path).unwrap().len());
    assert!(packed < whole && packed == std::fs::metadata(&small).unwrap().len());
    assert_eq!(green::unpack(&small, &back).unwrap(), whole);
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&back).unwrap());
    let bytes = std::fs::read(&small).unwrap();
    for at in (0..bytes.len()).step_by(7) {
        let mut copy = bytes.clone();
        copy[at] ^= 0x10;
        std::fs::write(&small, &copy).unwrap();
        // A flipped bit in a skippable place may leave the content as it was.
        match green::unpack(&small, &back) {
            Ok(_) => assert!(std::fs::read(&path).unwrap() == std::fs::read(&back).unwrap(), "byte {at}"),
            Err(error) => assert!(error.to_string().contains("does not unpack"), "{error}"),
        }
    }
    std::fs::write(&small, &bytes[..bytes.len() / 2]).unwrap();
    assert!(green::unpack(&small, &path).unwrap_err().to_string().contains("does not unpack"));
    assert!(GreenFile::open(&path).is_ok(), "what was there stays");
}

#[test]
fn same_scene_gives_the_same_bytes() {
    let (one, _) = written("green-same-1", HAPTICS);
    let (two, _) = written("green-same-2", HAPTICS);
    assert!(std::fs::read(one).unwrap() == std::fs::read(two).unwrap());
}

#[test]
fn scene_without_haptics_has_no_stiffness_in_its_file() {
    let (with, _) = written("green-with", HAPTICS);
    let (without, _) = written("green-without", Needs::default());
    let stiffness = |path: &Path| GreenFile::open(path).unwrap().stiffness("block").is_some();
    assert!(stiffness(&with) && !stiffness(&without));
    let size = |path: &Path| std::fs::metadata(path).unwrap().len() as usize;
    assert!(size(&with) - size(&without) > 24 * 24 * 8);
}

/// Every byte flipped in turn, each refused with the reason and the remedy.
#[test]
fn no_flipped_byte_passes() {
    let (path, _) = written("green-flipped", Needs::default());
    let bytes = std::fs::read(&path).unwrap();
    let damaged = path.with_extension("damaged.green");
    for at in 0..bytes.len() {
        let mut copy = bytes.clone();
        copy[at] ^= 0x10;
        std::fs::write(&damaged, &copy).unwrap();
        match GreenFile::open(&damaged) {
            Err(error @ GreenError::Damaged { .. }) => {
                assert!(error.to_string().contains("greenstage precompute"))
            }
            other => panic!("byte {at} of {} flipped: {:?}", bytes.len(), other.map(|file| file.meta)),
        }
    }
}

#[test]
fn no_cut_file_passes() {
    let (path, _) = written("green-cut", Needs::default());
    let bytes = std::fs::read(&path).unwrap();
    let cut = path.with_extension("cut.green");
    for length in (0..bytes.len()).step_by(7) {
        std::fs::write(&cut, &bytes[..length]).unwrap();
        assert!(GreenFile::open(&cut).is_err(), "cut to {length} bytes");
    }
    let mut longer = bytes.clone();
    longer.extend([0; 8]);
    std::fs::write(&cut, longer).unwrap();
    assert!(GreenFile::open(&cut).is_err(), "eight bytes too many");
}

#[test]
fn changed_scene_makes_the_file_stale() {
    let fingerprint =
        |text: &str, needs| green::fingerprint(&block_scene([2, 1, 1], text), "block", needs).unwrap();
    let base = fingerprint("", Needs::default());
    assert_eq!(base, fingerprint("", Needs::default()));
    assert_eq!(
        base,
        fingerprint("place = { position = [0.0, 1.0, 0.0] }", Needs::default()),
        "placing moves nothing"
    );
    assert_ne!(base, fingerprint("", HAPTICS));
    assert_ne!(base, fingerprint("solver = { method = \"pcg\" }", Needs::default()));
    let finer = green::fingerprint(&block_scene([2, 2, 1], ""), "block", Needs::default()).unwrap();
    assert_ne!(base, finer);

    let (path, _) = written("green-stale", Needs::default());
    let file = GreenFile::open(&path).unwrap();
    file.check_fresh("block", &base).unwrap();
    let stale = file.check_fresh("block", &finer).unwrap_err();
    assert!(matches!(stale, GreenError::Stale { .. }) && stale.to_string().contains("stale"), "{stale}");
}

/// One flat control element and one of a single node: their fields that prescribe nothing are kept as zero columns
/// and named.
#[test]
fn vanishing_columns_are_zero_and_named() {
    let scene = scene(
        r#"
[body.block]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }
material = { young = 1.0e3, poisson = 0.3 }
[body.block.control.face]
nodes = { group = "xmin" }
grab = "fixed"
[body.block.control.point]
nodes = { sphere = { centre = [0.5, 0.5, 0.5], radius = 0.01 } }
grab = "dragger"
"#,
    );
    let path = folder("green-vanishing").join("block.green");
    let precomputed = green::precompute(&scene, "block", HAPTICS, &Silent).unwrap();
    assert!(
        precomputed
            .solution
            .notices
            .iter()
            .any(|n| n.message.contains("planar") && n.message.contains("m11, m21, m31"))
    );
    assert!(precomputed.solution.notices.iter().any(|n| n.message.contains("a single point")));
    green::write(&path, &[precomputed]).unwrap();
    let file = GreenFile::open(&path).unwrap();
    let [face, point] = &file.meta.bodies["block"].controls[..] else { panic!("two control elements") };
    assert_eq!(
        (face.independent, face.vanishing.as_slice()),
        (9, ["m11", "m21", "m31"].map(String::from).as_slice())
    );
    assert_eq!((point.independent, point.vanishing.len()), (3, 9));
    let columns = file.basis("block", "point");
    let nodes = file.rest("block").len();
    let field = |k: usize| (0..3 * nodes).map(move |i| columns.value(nodes, k, i));
    assert!((3..FIELDS).flat_map(field).all(|u| u == 0.0));
    assert!(field(0).any(|u| u == 1.0));
    let s = file.stiffness("block").unwrap();
    assert!((15..24).all(|k| s.column(k).amax() == 0.0) && s.column(12).amax() > 0.0);
}

/// A file whose metadata were changed by somebody who also made the hash anew: refused, or harmless.
#[test]
fn forged_metadata_do_no_harm() {
    let (path, _) = written("green-forged", HAPTICS);
    let bytes = std::fs::read(&path).unwrap();
    let (_, header) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    let sealed = header.metadata().as_ref().unwrap()["greenstage"].clone();
    let content: serde_json::Value =
        serde_json::from_str::<serde_json::Value>(&sealed).unwrap()["content"].clone();
    let forged_path = path.with_extension("forged.green");
    let mut refused = 0;
    let forge = |content: &serde_json::Value| {
        let text = content.to_string();
        let seal = blake3::hash(text.as_bytes()).to_hex().to_string();
        let sealed = format!("{{\"blake3\":\"{seal}\",\"content\":{text}}}");
        let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let metadata = std::collections::HashMap::from([("greenstage".to_owned(), sealed)]);
        std::fs::write(&forged_path, safetensors::serialize(tensors.tensors(), Some(metadata)).unwrap())
            .unwrap();
        GreenFile::open(&forged_path)
    };
    forge(&content).unwrap();
    for pointer in [
        "/format",
        "/bodies/block/surface_nodes",
        "/bodies/block/surface_triangles",
        "/bodies/block/controls",
        "/bodies/block/controls/0/name",
        "/bodies/block/controls/0/origin",
        "/bodies/block/centre",
        "/blake3",
        "/bodies/block/needs/stiffness",
        "/bodies/block",
        "/bodies",
    ] {
        for value in
            ["0", "-1", "1e300", "\"x\"", "[]", "{}", "null", "18446744073709551615", "true", "false"]
        {
            let mut forged = content.clone();
            *forged.pointer_mut(pointer).unwrap() = serde_json::from_str(value).unwrap();
            match forge(&forged) {
                Err(error) => {
                    assert!(matches!(error, GreenError::Damaged { .. }), "{error}");
                    refused += 1;
                }
                Ok(file) => {
                    if let Ok(mut body) =
                        greenstage::deform::Deformer::new(std::sync::Arc::new(file), "block", "rotation")
                    {
                        let poses = vec![common::some_pose(1.0); body.controls.len()];
                        body.evaluate(&poses);
                    }
                }
            }
        }
    }
    assert!(refused > 80, "{refused} of 110 refused");
}

proptest::proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..300), length in 0u64..400) {
        let path = std::env::temp_dir().join(format!("greenstage-bytes-{}.green", std::process::id()));
        // With and without a plausible header length before them.
        for bytes in [bytes.clone(), [&length.to_le_bytes()[..], b"{\"__metadata__\":{\"greenstage\":\"", &bytes].concat()] {
            std::fs::write(&path, bytes).unwrap();
            proptest::prop_assert!(GreenFile::open(&path).is_err());
        }
        std::fs::remove_file(&path).unwrap();
    }
}
