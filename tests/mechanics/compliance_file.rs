//! The compliance of the surface in the .green file, by its inverse and by its factor: every column is that of a fresh solve, and
//! damage is reported where it is read.

use crate::common::{block_scene, folder};
use crate::forged_files::assert_refused;
use greenstage::deform::{AppliedLoads, ControlPose, Deformer, LINEAR, PointLoad, Pull};
use greenstage::fem::{NodeFields, Partition};
use greenstage::green::{self, AFFINE, COMPLIANCE, GreenError, GreenFile, KEPT_FACTOR, Requirements};
use greenstage::mesh::Surface;
use greenstage::scene::Scene;
use greenstage::solve::{Silent, Solver};
use nalgebra::Vector3;
use safetensors::tensor::SafeTensors;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A block with the compliance of its surface, or of a part of it: its file and scene.
fn compliant(name: &str, nodes: &str) -> (PathBuf, Scene) {
    let path = folder(name).join("block.green");
    let scene = block_scene([8, 4, 4], &format!("surface_compliance = {{ nodes = {nodes} }}"));
    let made =
        green::precompute(&scene, "block", &Requirements::new(&[AFFINE, COMPLIANCE]), &Silent).unwrap();
    green::write(&path, &[made]).unwrap();
    (path, scene)
}

/// A body of which the factor is kept instead of the inverse.
fn kept_factor(name: &str, nodes: &str) -> (PathBuf, Scene) {
    let path = folder(name).join("block.green");
    let keys = format!("surface_compliance = {{ nodes = {nodes}, kept = \"factor\" }}");
    let scene = block_scene([8, 4, 4], &keys);
    let made =
        green::precompute(&scene, "block", &Requirements::new(&[AFFINE, KEPT_FACTOR]), &Silent).unwrap();
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
        let surface = Surface::from_mesh(&prepared.mesh).nodes;
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

/// Damage on the disk is an error where it is read, and nowhere else; a file that is replaced goes on as it was.
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
    let mut body = Deformer::new(file, "block", &LINEAR).unwrap();
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

/// Damage of a kept factor is an error that names the file: in opening it, or where its numbers are read.
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
        let mut body = Deformer::new(file, "block", &LINEAR).unwrap();
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
