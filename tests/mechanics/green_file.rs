//! The .green file: what is written is what is read, and no damage passes.

use crate::common::{self, HAPTICS, block_scene, folder, scene, some_pose};
use greenstage::deform::{AppliedLoads, ControlPose, Deformer, PointLoad, Pull};
use greenstage::fem::{NodeFields, Partition};
use greenstage::green::{self, AFFINE, COMPLIANCE, FIELDS, GreenError, GreenFile, KEPT_FACTOR, Requirements};
use greenstage::mesh::{self, Surface};
use greenstage::scene::Scene;
use greenstage::solve::{Silent, Solver};
use nalgebra::Vector3;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

fn written(name: &str, requirements: &Requirements) -> (PathBuf, green::Precomputed) {
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
        let path = folder(&format!("green-{bound}")).join("block.green");
        let scene = block_scene([3, 2, 2], &format!("storage = {storage}"));
        let precomputed = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
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

/// A block with the compliance of its surface, or of a part of it: its file and scene.
fn compliant(name: &str, nodes: &str) -> (PathBuf, Scene) {
    let path = folder(name).join("block.green");
    let scene = block_scene([8, 4, 4], &format!("surface_compliance = {{ nodes = {nodes} }}"));
    let made = green::precompute(&scene, "block", &Requirements::of(&[AFFINE, COMPLIANCE]), &Silent).unwrap();
    green::write(&path, &[made]).unwrap();
    (path, scene)
}

/// The same with the factor that tells it.
fn kept_factor(name: &str, nodes: &str) -> (PathBuf, Scene) {
    let path = folder(name).join("block.green");
    let keys = format!("surface_compliance = {{ nodes = {nodes}, kept = \"factor\" }}");
    let scene = block_scene([8, 4, 4], &keys);
    let made =
        green::precompute(&scene, "block", &Requirements::of(&[AFFINE, KEPT_FACTOR]), &Silent).unwrap();
    green::write(&path, &[made]).unwrap();
    (path, scene)
}

/// Every column of the compliance, read from the disk, is the inverse of a fresh factor.
#[test]
fn a_compliance_is_read_piece_by_piece_and_is_the_inverse() {
    let some = "{ box = { min = [-1, -1, -0.3], max = [9, 9, 9] } }";
    for (name, nodes) in [("green-whole", "\"surface\""), ("green-part", some)] {
        let (path, scene) = compliant(name, nodes);
        let file = GreenFile::open(&path).unwrap();
        file.verify().unwrap();
        let prepared = green::prepare(&scene, "block").unwrap();
        let k = scene.body["block"].element.assemble(&prepared.mesh, &prepared.lame).unwrap();
        let held = prepared.controls.iter().flat_map(|control| control.nodes.iter().copied());
        let partition = Partition::new(prepared.mesh.nodes.len(), held);
        let a = partition.a(&k);
        let solver = Solver::default().analyse(&a, &Silent).unwrap();
        let factor = solver.factor(&a, &Silent).unwrap();
        let surface = Surface::of(&prepared.mesh).nodes;
        let free = |node: usize| partition.free.binary_search(&surface[node]).ok();
        let compliance = file.compliance("block").unwrap();
        let places = compliance.places();
        assert!(places.len() > 64 && (places.len() < 100) == (nodes == some), "{} nodes", places.len());
        let mut rhs = NodeFields::zeros(partition.free.len(), 3 * places.len());
        for (column, &node) in places.keys().enumerate() {
            (0..3).for_each(|axis| {
                rhs.row_mut(3 * free(node as usize).unwrap() + axis)[3 * column + axis] = 1.0
            });
        }
        let (x, _) = factor.solve(&rhs, &Silent).unwrap();
        let largest = x.data.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (column, place) in places.values().enumerate() {
            let found = compliance.column(*place).unwrap();
            for (node, of_node) in found.iter().enumerate() {
                for (axis, force) in (0..3).flat_map(|axis| [0, 1, 2].map(|force| (axis, force))) {
                    let exact = free(node).map_or(0.0, |at| x.row(3 * at + axis)[3 * column + force]);
                    let error = (f64::from(of_node[axis][force]) - exact).abs();
                    assert!(error <= 2e-7 * largest, "{name}: node {node}, column {column}: {error:e}");
                }
            }
        }
    }
}

/// What is damaged on the disk is an error where it is read, and nowhere else; a file that is replaced goes on as it was.
#[test]
fn a_damaged_compliance_is_told_where_it_is_read() {
    let (path, _) = compliant("green-tiles", "\"surface\"");
    let bytes = std::fs::read(&path).unwrap();
    let (header, info) = SafeTensors::read_metadata(&bytes).unwrap();
    let first = 8 + header + info.info("block/compliance/values").unwrap().data_offsets.0;
    let open = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Arc::new(GreenFile::open(&path).unwrap())
    };
    let column = |file: &GreenFile, place: usize| file.compliance("block").unwrap().column(place);
    let sound = open(&bytes);
    let last = sound.compliance("block").unwrap().places().len() - 1;
    let mut flipped = bytes.clone();
    flipped[first] ^= 0x10;
    let file = open(&flipped);
    assert_refused(file.verify(), "tile 0 of tensor block/compliance/values is damaged");
    assert_refused(column(&file, 0), "tile 0 of tensor block/compliance/values is damaged");
    assert_eq!(column(&file, last).unwrap().len(), file.rest("block").len());
    // A force there does nothing, and one elsewhere what it should.
    let mut body = Deformer::new(file, "block", "linear").unwrap();
    let moved = |body: &mut Deformer, node: u32| {
        let pull = Pull::Force(Vector3::new(0.0, 1.0, 0.0));
        let points = vec![PointLoad { nodes: [node; 3], weights: [1.0, 0.0, 0.0], pull }];
        body.apply(&AppliedLoads { coefficients: Vec::new(), points });
        body.evaluate(&[ControlPose::REST; 2]);
        body.displacement(node as usize).norm()
    };
    let takes: Vec<u32> = body.takes_forces().into_iter().collect();
    assert_eq!(moved(&mut body, takes[0]), 0.0);
    assert!(moved(&mut body, takes[last]) > 0.0);

    let file = open(&bytes);
    let other = path.with_extension("other");
    std::fs::write(&other, b"other").unwrap();
    std::fs::rename(&other, &path).unwrap();
    assert!(column(&file, 0).is_ok() && file.verify().is_ok());
    let file = open(&bytes);
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(first as u64 + 100).unwrap();
    assert!(matches!(column(&file, 0).unwrap_err(), GreenError::Io { .. }));
    assert!(matches!(GreenFile::open(&path).unwrap_err(), GreenError::Damaged { .. }));
}

/// Columns that are solved for from a kept factor are those of the inverse, asked one by one, together, and by one who cannot wait.
#[test]
fn columns_from_a_kept_factor_are_those_of_the_inverse() {
    let some = "{ box = { min = [-1, -1, -0.3], max = [9, 9, 9] } }";
    for (name, nodes) in [("green-factor-whole", "\"surface\""), ("green-factor-part", some)] {
        let (path, _) = compliant(&format!("{name}-inverse"), nodes);
        let inverse = GreenFile::open(&path).unwrap();
        let (path, _) = kept_factor(name, nodes);
        let file = Arc::new(GreenFile::open(&path).unwrap());
        file.verify().unwrap();
        let (inverse, factor) = (inverse.compliance("block").unwrap(), file.compliance("block").unwrap());
        let places = factor.places();
        assert_eq!(places, inverse.places());
        let same = |found: &[[[f32; 3]; 3]], place: usize| {
            let expected = inverse.column(place).unwrap();
            let numbers = |of: &[[[f32; 3]; 3]]| of.as_flattened().as_flattened().to_vec();
            let (found, expected) = (numbers(found), numbers(&expected));
            let largest = expected.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
            let off = found.iter().zip(&expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(
                found.len() == expected.len() && off < 5e-7 * largest,
                "{name} {place}: {off:e} {largest:e}"
            );
        };
        for &place in places.values() {
            same(&factor.column(place).unwrap(), place);
        }
        let asked: Vec<usize> = places.values().copied().step_by(9).collect();
        let fresh = || Arc::new(GreenFile::open(&path).unwrap());
        let together = fresh().columns("block", &asked, Duration::MAX).unwrap().unwrap();
        let (file, started) = (fresh(), Instant::now());
        let soon = loop {
            if let Some(columns) = file.columns("block", &asked, Duration::ZERO).unwrap() {
                break columns;
            }
            assert!(started.elapsed() < Duration::from_secs(60), "nothing comes");
            std::thread::sleep(Duration::from_millis(1));
        };
        for columns in [together, soon] {
            assert_eq!(columns.len(), asked.len());
            columns.iter().zip(&asked).for_each(|(column, place)| same(column, *place));
        }
    }
}

/// What is damaged of a kept factor is an error that names the file: in opening it, or where its numbers are read.
#[test]
fn a_damaged_factor_is_told_where_it_is_read() {
    let (path, _) = kept_factor("green-factor-damaged", "\"surface\"");
    let bytes = std::fs::read(&path).unwrap();
    let (header, info) = SafeTensors::read_metadata(&bytes).unwrap();
    let place = |tensor: &str| {
        let (from, to) = info.info(&format!("block/kept_factor/{tensor}")).unwrap().data_offsets;
        8 + header + from..8 + header + to
    };
    let flipped = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x10;
        std::fs::write(&path, &bytes).unwrap();
        GreenFile::open(&path)
    };
    for tensor in ["order", "supernodes", "rows", "places"] {
        let error = flipped(place(tensor).start + 4).unwrap_err();
        assert_refused::<()>(Err(error), &format!("tensor block/kept_factor/{tensor} is damaged"));
    }
    let values = place("values");
    for at in [values.start, values.start + values.len() / 2, values.end - 1] {
        let file = Arc::new(flipped(at).unwrap());
        let expected = "tensor block/kept_factor/values is damaged";
        assert_refused(file.verify(), expected);
        assert_refused(file.compliance("block").unwrap().column(0), expected);
        let late = file.columns("block", &[0, 3], Duration::from_secs(60)).unwrap_err();
        assert!(late.to_string().contains(expected) && late.is_request(), "{late}");
        // It goes on without: the body is there, and takes no force.
        let mut body = Deformer::new(file, "block", "linear").unwrap();
        let pull = Pull::Force(Vector3::new(0.0, 1.0, 0.0));
        let node = *body.takes_forces().first().unwrap();
        let points = vec![PointLoad { nodes: [node; 3], weights: [1.0, 0.0, 0.0], pull }];
        body.apply(&AppliedLoads { coefficients: Vec::new(), points });
        body.evaluate(&[ControlPose::REST; 2]);
        assert_eq!(body.displacement(node as usize).norm(), 0.0);
    }
    std::fs::write(&path, &bytes).unwrap();
    let file = GreenFile::open(&path).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(values.start as u64 + 9).unwrap();
    assert!(matches!(file.compliance("block").unwrap().column(0).unwrap_err(), GreenError::Io { .. }));
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
    let (without, _) = written("green-without", &Requirements::of(&[AFFINE]));
    let stiffness = |path: &Path| GreenFile::open(path).unwrap().stiffness("block").is_some();
    assert!(stiffness(&with) && !stiffness(&without));
    let size = |path: &Path| std::fs::metadata(path).unwrap().len() as usize;
    assert!(size(&with) - size(&without) > 24 * 24 * 8);
}

/// Every byte flipped in turn, each refused with the reason and the remedy.
#[test]
fn no_flipped_byte_passes() {
    let (path, _) = written("green-flipped", &Requirements::of(&[AFFINE]));
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
    let (path, _) = written("green-cut", &Requirements::of(&[AFFINE]));
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
    let refused = Deformer::new(file, "block", "linear").err().unwrap();
    assert!(refused.contains("no numbers of the family affine, which the model \"linear\""), "{refused}");
}

#[test]
fn changed_scene_makes_the_file_stale() {
    let affine = &Requirements::of(&[AFFINE]);
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

    let (path, _) = written("green-stale", &Requirements::of(&[AFFINE]));
    let file = GreenFile::open(&path).unwrap();
    file.check_fresh("block", &base).unwrap();
    let stale = file.check_fresh("block", &finer).unwrap_err();
    assert!(matches!(stale, GreenError::Stale { .. }) && stale.to_string().contains("stale"), "{stale}");
}

/// Of a mesh in several files each one counts, whichever of them the scene names.
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
        let fingerprint = || green::fingerprint(&scene, "block", &Requirements::of(&[AFFINE])).unwrap();
        let path = folder.join("block.green");
        for changed in ["m.node", "m.ele"] {
            let precomputed =
                green::precompute(&scene, "block", &Requirements::of(&[AFFINE]), &Silent).unwrap();
            green::write(&path, &[precomputed]).unwrap();
            let file = GreenFile::open(&path).unwrap();
            file.check_fresh("block", &fingerprint()).unwrap();
            change(changed);
            let stale = file.check_belongs(&scene, "block", &Requirements::of(&[AFFINE])).unwrap_err();
            assert!(matches!(stale, GreenError::Stale { .. }), "{named}, {changed}: {stale}");
        }
        std::fs::rename(folder.join("m.ele"), folder.join("away")).unwrap();
        let missing =
            green::fingerprint(&scene, "block", &Requirements::of(&[AFFINE])).unwrap_err().to_string();
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
    let mut deformer = Deformer::new(file, "block", "rotation").unwrap();
    deformer.evaluate(&[some_pose(0.3), some_pose(2.0)]);
    assert!(deformer.positions().as_flattened().iter().all(|x| x.is_finite()));
    let error = GreenFile::open(&path).unwrap_err();
    assert!(matches!(error, GreenError::Damaged { .. }), "{error}");
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
    let precomputed = green::precompute(&scene, "block", &HAPTICS, &Silent).unwrap();
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

/// A .green file taken apart.
struct Parts {
    tensors: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>,
    content: Value,
}

impl Parts {
    fn of(path: &Path) -> Parts {
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
    Parts::of(&path).write(&forged);
    GreenFile::open(&forged).unwrap();
    for (expected, edit) in cases {
        let mut parts = Parts::of(&path);
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
        let mut parts = Parts::of(&path);
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
fn assert_refused<T>(result: Result<T, GreenError>, expected: &str) {
    let Err(error) = result else { panic!("not refused: {expected}") };
    let text = error.to_string();
    assert!(matches!(error, GreenError::Damaged { .. }), "{text}");
    assert!(
        text.contains(expected) && text.contains("greenstage precompute --force"),
        "{text}\nlacks {expected}"
    );
}

/// With the scene's fingerprint in it, and another order or other names of its control elements, or without S.
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
        let mut parts = Parts::of(&path);
        edit(&mut parts);
        parts.write(&forged);
        assert_refused(GreenFile::open(&forged).unwrap().check_belongs(&scene, "block", &HAPTICS), expected);
    }
    let mut parts = Parts::of(&path);
    parts.tensors.remove("block/stiffness");
    parts.content["blake3"].as_object_mut().unwrap().remove("block/stiffness");
    parts.write(&forged);
    assert_refused(GreenFile::open(&forged), "tensor block/stiffness is missing");
}

/// A file whose metadata were changed by somebody who also made the hash anew: refused, or harmless.
#[test]
fn forged_metadata_do_no_harm() {
    let (path, _) = written("green-forged", &HAPTICS);
    let forged_path = path.with_extension("forged.green");
    let mut refused = 0;
    let mut parts = Parts::of(&path);
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
