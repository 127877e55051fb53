//! .green files whose hashes are right and whose content no body can have.

use crate::common::{self, HAPTICS, block_scene};
use crate::green_file::written;
use greenstage::green::{self, GreenError, GreenFile};
use greenstage::solve::Silent;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// A .green file taken apart.
struct Parts {
    tensors: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>,
    content: Value,
}

impl Parts {
    fn read(path: &Path) -> Parts {
        let bytes = std::fs::read(path).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let sealed: Value = serde_json::from_str(&header.metadata().as_ref().unwrap()["greenstage"]).unwrap();
        let container = SafeTensors::deserialize(&bytes).unwrap();
        let taken = |(name, view): (String, TensorView)| {
            (name, (view.dtype(), view.shape().to_vec(), view.data().to_vec()))
        };
        Parts {
            tensors: container.tensors().into_iter().map(taken).collect(),
            content: sealed["content"].clone(),
        }
    }

    /// Overwrites the bytes of a tensor from number `at` on.
    fn put<const N: usize>(&mut self, tensor: &str, at: usize, number: [u8; N]) {
        self.tensors.get_mut(tensor).unwrap().2[at * N..(at + 1) * N].copy_from_slice(&number);
    }

    /// Written with every hash made anew.
    fn write(mut self, path: &Path) {
        for (name, (_, _, bytes)) in &self.tensors {
            self.content["blake3"][name] = json!(blake3::hash(bytes).to_hex().to_string());
        }
        self.write_with_its_hashes(path);
    }

    /// Written with the hash of the metadata alone made anew.
    fn write_with_its_hashes(&self, path: &Path) {
        let text = self.content.to_string();
        let seal = blake3::hash(text.as_bytes()).to_hex().to_string();
        let sealed = format!("{{\"blake3\":\"{seal}\",\"content\":{text}}}");
        let views = self.tensors.iter().map(|(name, (dtype, shape, bytes))| {
            (name, TensorView::new(*dtype, shape.clone(), bytes).unwrap())
        });
        let metadata = std::collections::HashMap::from([("greenstage".to_owned(), sealed)]);
        std::fs::write(path, safetensors::serialize(views, Some(metadata)).unwrap()).unwrap();
    }
}

type Edit = fn(&mut Parts);

/// Whoever writes a file can hash it: what no body can have is refused by the name of its tensor or field.
#[test]
fn numbers_that_no_body_has_are_refused_although_their_hashes_are_right() {
    let cases: &[(&str, Edit)] = &[
        ("tensor block/rest: number 4 is NaN", |f| f.put("block/rest", 4, f32::NAN.to_le_bytes())),
        ("tensor block/rest: number 0 is inf", |f| f.put("block/rest", 0, f32::INFINITY.to_le_bytes())),
        ("tensor block/rest: number 7 is 1.00000", |f| f.put("block/rest", 7, 1e30_f32.to_le_bytes())),
        ("tensor block/rest spans 0.0e0 m", |f| f.tensors.get_mut("block/rest").unwrap().2.fill(0)),
        ("tensor block/basis/low: number 9 is -inf", |f| {
            f.put("block/basis/low", 9, f32::NEG_INFINITY.to_le_bytes());
        }),
        ("tensor block/stiffness: number 30 is NaN", |f| {
            f.put("block/stiffness", 30, f64::NAN.to_le_bytes())
        }),
        ("tensor block/stiffness is not symmetric", |f| f.put("block/stiffness", 1, 1e9_f64.to_le_bytes())),
        ("tensor block/tags holds 1 twice", |f| f.put("block/tags", 3, 1_u64.to_le_bytes())),
        ("tensor block/triangles: triangle 1 has the corners", |f| {
            f.put("block/triangles", 4, 1000_u32.to_le_bytes());
        }),
        ("tensor block/triangles: triangle 0 has the corners [", |f| {
            let corner = f.tensors["block/triangles"].2[..4].to_vec();
            f.put("block/triangles", 1, <[u8; 4]>::try_from(corner).unwrap());
        }),
        ("tensor block/control/low names a node", |f| f.put("block/control/low", 3, 77_u32.to_le_bytes())),
        ("tensor block/control/low names a node", |f| f.put("block/control/low", 0, 11_u32.to_le_bytes())),
        ("bodies.block.accuracy: residual is 1e9", |f| f.accuracy("residual", json!(1e9))),
        ("bodies.block.accuracy: residual is 2e0", |f| f.accuracy("residuals", json!([0.0, 2.0]))),
        ("it is cut short or damaged (invalid type: null", |f| f.accuracy("residual", json!(null))),
        ("forward_error or asymmetry is -1e0", |f| f.accuracy("forward_error", json!(-1.0))),
        ("bodies.block.centre: number 2 is 1e300", |f| f.body()["centre"] = json!([0.0, 0.0, 1e300])),
        ("bodies.block.controls: high: origin: number 0", |f| f.control()["origin"][0] = json!(-1e200)),
        ("bodies.block.controls names \"low\" twice", |f| f.control()["name"] = json!("low")),
        ("bodies.block.controls: high: independent", |f| f.control()["independent"] = json!(u64::MAX)),
        ("bodies.block.controls: high: independent", |f| f.control()["vanishing"] = json!(["x", "y", "z"])),
        ("bodies.block.controls: high: nodes is 0", |f| f.control()["nodes"] = json!(0)),
    ];
    let (path, _) = written("green-rehashed", &HAPTICS);
    let forged = path.with_extension("forged.green");
    Parts::read(&path).write(&forged);
    GreenFile::open(&forged).unwrap();
    for (expected, edit) in cases {
        let mut parts = Parts::read(&path);
        edit(&mut parts);
        parts.write(&forged);
        assert_refused(GreenFile::open(&forged), expected);
    }
    for (storage, tensor, number) in [
        ("f16", "block/basis/low", &[0xff, 0x7f][..]),
        ("f16", "block/scale/low", &f32::NAN.to_le_bytes()),
        ("int16", "block/scale/low", &f32::INFINITY.to_le_bytes()),
    ] {
        let scene = block_scene([2, 1, 1], &format!("storage = \"{storage}\""));
        let precomputed = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
        green::write(&path, &[precomputed]).unwrap();
        let mut parts = Parts::read(&path);
        parts.tensors.get_mut(tensor).unwrap().2[..number.len()].copy_from_slice(number);
        parts.write(&forged);
        assert_refused(GreenFile::open(&forged), &format!("tensor {tensor}: number 0 is "));
    }
}

impl Parts {
    fn body(&mut self) -> &mut Value {
        &mut self.content["bodies"]["block"]
    }

    fn control(&mut self) -> &mut Value {
        &mut self.body()["controls"][0]
    }

    fn accuracy(&mut self, key: &str, value: Value) {
        self.body()["accuracy"][key] = value;
    }
}

#[track_caller]
pub fn assert_refused<T>(result: Result<T, GreenError>, expected: &str) {
    let Err(error) = result else { panic!("not refused: {expected}") };
    let text = error.to_string();
    assert!(matches!(error, GreenError::Damaged { .. }), "{text}");
    assert!(
        text.contains(expected) && text.contains("greenstage precompute --force"),
        "{text}\nlacks {expected}"
    );
}

/// Files with the scene's fingerprint, but with another order or other names of its control elements, or without S.
#[test]
fn a_file_that_only_claims_to_be_the_scenes_is_refused() {
    let (path, _) = written("green-claims", &HAPTICS);
    let forged = path.with_extension("forged.green");
    let scene = block_scene([2, 1, 1], "");
    GreenFile::open(&path).unwrap().check_belongs(&scene, "block", &HAPTICS).unwrap();
    let cases: &[(&str, Edit)] = &[
        ("bodies.block.controls is [\"low\", \"high\"], the scene's is [\"high\", \"low\"]", |f| {
            f.body()["controls"].as_array_mut().unwrap().reverse();
        }),
        ("bodies.block.controls is [\"other\", \"low\"]", |f| {
            f.control()["name"] = json!("other");
            for kind in ["basis", "control"] {
                let tensor = f.tensors.remove(&format!("block/{kind}/high")).unwrap();
                f.tensors.insert(format!("block/{kind}/other"), tensor);
                f.content["blake3"].as_object_mut().unwrap().remove(&format!("block/{kind}/high"));
            }
        }),
        ("bodies.block.requirements is affine, the scene's is affine, cubic, stiffness, though", |f| {
            f.body()["requirements"]["families"] = json!(["affine"]);
        }),
        ("bodies.block.element is tet10", |f| f.body()["element"] = json!("tet10")),
    ];
    for (expected, edit) in cases {
        let mut parts = Parts::read(&path);
        edit(&mut parts);
        parts.write(&forged);
        assert_refused(GreenFile::open(&forged).unwrap().check_belongs(&scene, "block", &HAPTICS), expected);
    }
    let mut parts = Parts::read(&path);
    parts.tensors.remove("block/stiffness");
    parts.content["blake3"].as_object_mut().unwrap().remove("block/stiffness");
    parts.write(&forged);
    assert_refused(GreenFile::open(&forged), "tensor block/stiffness is missing");
}

/// A file passes the same judgement as a solution: rigid motions in columns and S, and the forward error.
#[test]
fn columns_that_do_not_reproduce_rigid_motions_are_refused() {
    let (path, _) = written("green-rigid", &HAPTICS);
    let forged = path.with_extension("forged.green");
    assert!(green::judge_file(&GreenFile::open(&path).unwrap(), "block").unwrap().is_empty());
    let cases: &[(&str, Edit)] = &[
        ("(the columns of a shift are not 1 in every node) is", |f| {
            f.put("block/basis/low", 9, 0.7_f32.to_le_bytes());
        }),
        ("when all control elements are turned alike", |f| {
            // Of the field m21, the place of a node along y.
            let nodes = f.tensors["block/basis/low"].1[1];
            f.put("block/basis/low", 6 * 3 * nodes + 10, 3.0_f32.to_le_bytes());
        }),
        ("over that of shifting it alone, is", |f| {
            let (_, _, bytes) = &f.tensors["block/stiffness"];
            let first = f64::from_le_bytes(bytes[..8].try_into().unwrap());
            f.put("block/stiffness", 0, (2.0 * first).to_le_bytes());
        }),
        ("the bound on the forward error is 2.0e-1", |f| f.body()["accuracy"]["forward_error"] = json!(0.2)),
    ];
    for (expected, edit) in cases {
        let mut parts = Parts::read(&path);
        edit(&mut parts);
        parts.write(&forged);
        let error = green::judge_file(&GreenFile::open(&forged).unwrap(), "block").unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("not to be trusted"), "{error}\nlacks {expected}");
    }
}

/// A file whose metadata were changed by somebody who also made the hash anew: refused, or harmless.
#[test]
fn forged_metadata_do_no_harm() {
    let (path, _) = written("green-forged", &HAPTICS);
    let forged_path = path.with_extension("forged.green");
    let mut refused = 0;
    let mut parts = Parts::read(&path);
    let content = parts.content.clone();
    let mut forge = |content: &Value| {
        parts.content = content.clone();
        parts.write_with_its_hashes(&forged_path);
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
        "/bodies/block/requirements/families",
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
                    if let Ok(mut body) = greenstage::deform::Deformer::new(
                        std::sync::Arc::new(file),
                        "block",
                        &greenstage::deform::ROTATION,
                    ) {
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
