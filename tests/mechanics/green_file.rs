//! The .green file: what is written is what is read, and no damage passes.

use crate::common::{HAPTICS, block_scene, folder, scene, some_pose};
use greenstage::deform::{ControlPose, Deformer, LINEAR, ROTATION};
use greenstage::green::{self, AFFINE, FIELDS, GreenError, GreenFile, Requirements};
use greenstage::mesh::{self, generate};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub fn written(name: &str, requirements: &Requirements) -> (PathBuf, green::Precomputed) {
    let path = folder(name).join("block.green");
    let precomputed = green::precompute(&block_scene([2, 1, 1], ""), "block", requirements, &Silent).unwrap();
    green::write(&path, std::slice::from_ref(&precomputed)).unwrap();
    (path, precomputed)
}

#[test]
fn round_trip_keeps_every_number_to_f32() {
    let (path, precomputed) = written("green-round-trip", &HAPTICS);
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
    assert_eq!(file.stiffness("block").as_ref(), solution.stiffness());
}

/// Half the bytes: every number is within the error that the file states for its field, and no smaller error is true.
#[test]
fn compact_columns_are_as_exact_as_their_file_says() {
    let within = "{ error = 1e-4 }";
    for (storage, bound) in [("\"f16\"", 2.5e-4), ("\"int16\"", 1.6e-5), (within, 1e-4)] {
        let scene = block_scene([3, 2, 2], &format!("storage = {storage}"));
        let precomputed = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
        let file = green::opened(std::slice::from_ref(&precomputed)).unwrap();
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
        let mut deformer = Deformer::new(file.clone(), "block", &LINEAR).unwrap();
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
    let (path, _) = written("green-packed", &HAPTICS);
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

/// Columns that are packed as what differs from guesses: smaller, the same again, and no damage to what zstd passes panics
/// or comes through.
#[test]
fn guessed_columns_come_back_and_their_damage_is_told() {
    let folder = folder("green-guessed");
    let path = folder.join("block.green");
    let made =
        green::precompute(&block_scene([7, 3, 3], "storage = { error = 1e-3 }"), "block", &HAPTICS, &Silent);
    green::write(&path, &[made.unwrap()]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let (small, back) = (green::packed_path(&path), folder.join("back.green"));
    let (_, packed) = green::pack(&path, &small).unwrap();
    let plain = zstd::bulk::compress(&bytes, 19).unwrap().len() as u64;
    assert!(packed < plain, "{packed} bytes, {plain} without guesses");
    green::unpack(&small, &back).unwrap();
    assert!(std::fs::read(&back).unwrap() == bytes);
    let inner = zstd::decode_all(&*std::fs::read(&small).unwrap()).unwrap();
    // Each byte behind the container, which says what was guessed, and some of its own.
    let at = (bytes.len()..inner.len()).chain((0..bytes.len()).step_by(bytes.len() / 60));
    for (at, flip) in at.flat_map(|at| [1, 0x16, 0x80].map(|flip| (at, flip))) {
        let mut copy = inner.clone();
        copy[at] ^= flip;
        std::fs::write(&small, zstd::bulk::compress(&copy, 1).unwrap()).unwrap();
        let error = green::unpack(&small, &back).unwrap_err().to_string();
        assert!(error.contains("does not unpack") || error.contains("no sound .green file"), "{at}: {error}");
    }
}

#[test]
fn same_scene_gives_the_same_bytes() {
    let (one, _) = written("green-same-1", &HAPTICS);
    let (two, _) = written("green-same-2", &HAPTICS);
    assert!(std::fs::read(one).unwrap() == std::fs::read(two).unwrap());
}

#[test]
fn scene_without_haptics_has_no_stiffness_in_its_file() {
    let (with, _) = written("green-with", &HAPTICS);
    let (without, _) = written("green-without", &Requirements::new(&[AFFINE]));
    let stiffness = |path: &Path| GreenFile::open(path).unwrap().stiffness("block").is_some();
    assert!(stiffness(&with) && !stiffness(&without));
    let size = |path: &Path| std::fs::metadata(path).unwrap().len() as usize;
    assert!(size(&with) - size(&without) > 24 * 24 * 8);
}

/// Every byte flipped in turn, each refused with the reason and the remedy.
#[test]
fn no_flipped_byte_passes() {
    let (path, _) = written("green-flipped", &Requirements::new(&[AFFINE]));
    let bytes = std::fs::read(&path).unwrap();
    let damaged = path.with_extension("damaged.green");
    std::fs::write(&damaged, &bytes).unwrap();
    let file = File::options().write(true).open(&damaged).unwrap();
    for (at, byte) in bytes.iter().enumerate() {
        file.write_all_at(&[byte ^ 0x10], at as u64).unwrap();
        let opened = GreenFile::open(&damaged);
        file.write_all_at(&[*byte], at as u64).unwrap();
        match opened {
            Err(error @ GreenError::Damaged { .. }) => {
                assert!(error.to_string().contains("greenstage precompute"))
            }
            other => panic!("byte {at} of {} flipped: {:?}", bytes.len(), other.map(|file| file.meta)),
        }
    }
}

#[test]
fn no_cut_file_passes() {
    let (path, _) = written("green-cut", &Requirements::new(&[AFFINE]));
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

/// A body of which no family is required has its surface and its control elements in the file, and no model.
#[test]
fn what_is_not_required_is_neither_solved_nor_stored() {
    let (path, precomputed) = written("green-nothing", &Requirements::default());
    let solution = &precomputed.solution;
    assert_eq!((solution.fields.columns, solution.stats.columns, solution.stiffness()), (0, 0, None));
    let file = Arc::new(GreenFile::open(&path).unwrap());
    let names: Vec<&str> = file.tensors().map(|(name, ..)| name).collect();
    assert_eq!(
        names,
        ["block/control/high", "block/control/low", "block/rest", "block/tags", "block/triangles"]
    );
    let refused = Deformer::new(file, "block", &LINEAR).err().unwrap();
    assert!(refused.contains("no numbers of the family affine, which the model \"linear\""), "{refused}");
}

#[test]
fn changed_scene_makes_the_file_stale() {
    let affine = &Requirements::new(&[AFFINE]);
    let fingerprint = |text: &str, requirements: &Requirements| {
        green::fingerprint(&block_scene([2, 1, 1], text), "block", requirements).unwrap()
    };
    let base = fingerprint("", affine);
    assert_eq!(base, fingerprint("", affine));
    assert_eq!(base, fingerprint("place = { position = [0.0, 1.0, 0.0] }", affine), "placing moves nothing");
    assert_ne!(base, fingerprint("", &HAPTICS));
    assert_ne!(base, fingerprint("solver = { method = \"pcg\" }", affine));
    let finer = green::fingerprint(&block_scene([2, 2, 1], ""), "block", affine).unwrap();
    assert_ne!(base, finer);

    let (path, _) = written("green-stale", &Requirements::new(&[AFFINE]));
    let file = GreenFile::open(&path).unwrap();
    file.check_fresh("block", &base).unwrap();
    let stale = file.check_fresh("block", &finer).unwrap_err();
    assert!(matches!(stale, GreenError::Stale { .. }) && stale.to_string().contains("stale"), "{stale}");
}

/// Each file of a mesh in several files counts, whichever of them the scene names.
#[test]
fn a_change_of_any_file_of_the_mesh_makes_the_file_stale() {
    let folder = folder("green-tetgen");
    let block = mesh::block(&mesh::Block { size: [1.0; 3], cells: [2, 1, 1] }).unwrap();
    mesh::save(&folder.join("m.node"), &block, None).unwrap();
    let change = |file: &str| {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, format!("# moved\n{text}")).unwrap();
    };
    for named in ["m.node", "m.ele"] {
        let scene = Scene::parse(
            &format!(
                "[body.block]\nmesh = \"{named}\"\nmaterial = {{ young = 1.0e3, poisson = 0.3 }}\n\
                 [body.block.control.low]\ngrab = \"fixed\"\n\
                 nodes = {{ plane = {{ point = [-0.5, 0.0, 0.0], normal = [1.0, 0.0, 0.0], distance = 0.01 }} }}\n"
            ),
            &folder.join("scene.toml"),
        )
        .unwrap();
        let fingerprint = || green::fingerprint(&scene, "block", &Requirements::new(&[AFFINE])).unwrap();
        for changed in ["m.node", "m.ele"] {
            let precomputed =
                green::precompute(&scene, "block", &Requirements::new(&[AFFINE]), &Silent).unwrap();
            let file = green::opened(&[precomputed]).unwrap();
            file.check_fresh("block", &fingerprint()).unwrap();
            change(changed);
            let stale = file.check_belongs(&scene, "block", &Requirements::new(&[AFFINE])).unwrap_err();
            assert!(matches!(stale, GreenError::Stale { .. }), "{named}, {changed}: {stale}");
        }
        std::fs::rename(folder.join("m.ele"), folder.join("away")).unwrap();
        let missing =
            green::fingerprint(&scene, "block", &Requirements::new(&[AFFINE])).unwrap_err().to_string();
        assert!(missing.contains("m.ele: "), "{missing}");
        std::fs::rename(folder.join("away"), folder.join("m.ele")).unwrap();
    }
}

/// Another program cuts the file, or writes over it, while it is in use: what was read stays as it was.
#[test]
fn a_file_that_shrinks_while_it_is_open_changes_nothing() {
    let (path, precomputed) = written("green-shrinks", &HAPTICS);
    let file = Arc::new(GreenFile::open(&path).unwrap());
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
    assert_eq!(file.triangles("block"), precomputed.solution.surface.triangles);
    assert_eq!(file.stiffness("block").as_ref(), precomputed.solution.stiffness());
    let mut deformer = Deformer::new(file, "block", &ROTATION).unwrap();
    deformer.evaluate(&[some_pose(0.3), some_pose(2.0)]);
    assert!(deformer.positions().as_flattened().iter().all(|x| x.is_finite()));
    let error = GreenFile::open(&path).unwrap_err();
    assert!(error.to_string().ends_with("the file is empty"), "{error}");
}

/// Flat control elements whose planes lie along no axis: no column vanishes, though three of each depend on the others. The file is read
/// again, and its body does in each pose what the same body does that lies along the axes.
#[test]
fn flat_control_elements_may_lie_oblique() {
    let turn = Rotation3::new(Vector3::new(0.4, -0.7, 0.5));
    let shown = |name: &str, turn: &Rotation3<f64>| {
        let folder = folder(name);
        let mut block =
            generate::block(&generate::Block { size: [1.0, 0.3, 0.2], cells: [4, 2, 2] }).unwrap();
        block.nodes.iter_mut().for_each(|x| *x = turn * *x);
        mesh::save(&folder.join("block.msh"), &block, None).unwrap();
        let text = "[body.block]\nmesh = \"block.msh\"\nmaterial = { young = 1.0e3, poisson = 0.3 }\n\
                    control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let scene = Scene::parse(text, &folder.join("block.toml")).unwrap();
        let made = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
        let file = green::opened(&[made]).unwrap();
        let vanishing: Vec<usize> =
            file.meta.bodies["block"].controls.iter().map(|control| control.vanishing.len()).collect();
        let mut body = Deformer::new(file, "block", &LINEAR).unwrap();
        let bend = Matrix3::identity() + Vector3::new(0.02, 0.05, -0.1).cross_matrix();
        let pose = ControlPose {
            translation: turn * Vector3::new(0.01, -0.02, 0.03),
            matrix: turn * bend * turn.inverse().matrix(),
        };
        body.evaluate(&[ControlPose::REST, pose]);
        let moved: Vec<Vector3<f64>> =
            (0..body.node_count()).map(|i| turn.inverse() * body.displacement(i)).collect();
        let force = turn.inverse() * body.wrenches().unwrap().0[1].force;
        (vanishing, moved, force)
    };
    let (zero, straight, force) = shown("green-straight", &Rotation3::identity());
    let (none, oblique, turned) = shown("green-oblique", &turn);
    assert_eq!((zero, none), (vec![3, 3], vec![0, 0]));
    assert!(straight.iter().zip(&oblique).all(|(a, b)| (a - b).norm() < 1e-7), "0.1 m at most");
    assert!((force - turned).norm() < 1e-9 * force.norm(), "{force} {turned}");
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
    let precomputed = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
    assert!(
        precomputed
            .solution
            .notices
            .iter()
            .any(|n| n.message.contains("planar") && n.message.contains("m11, m21, m31"))
    );
    assert!(precomputed.solution.notices.iter().any(|n| n.message.contains("a single point")));
    let file = green::opened(&[precomputed]).unwrap();
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
