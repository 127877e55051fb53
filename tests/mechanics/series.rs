//! Power series of equilibria against the shared case beam_series: the orders along a path, and second derivatives.

use crate::common::shared;
use flate2::read::DeflateDecoder;
use greenstage::deform::ControlPose;
use greenstage::fem::{NodeFields, Partition, RestPoints, TET4};
use greenstage::green::{self, AFFINE, FIELDS, Requirements, Solution};
use greenstage::scene::Scene;
use greenstage::solve::{LinearSolver, Silent};
use nalgebra::{DMatrix, Rotation3, Vector3};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// The arrays of a compressed .npz: f64 in little-endian order, the last index running fastest.
fn arrays(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let bytes = std::fs::read(path).unwrap();
    let number = |at: usize, width: usize| -> usize {
        bytes[at..at + width].iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte))
    };
    let mut arrays = BTreeMap::new();
    // The central directory, whose entries know the sizes.
    let end = bytes.windows(4).rposition(|w| w == b"PK\x05\x06").unwrap();
    let (count, mut at) = (number(end + 10, 2), number(end + 16, 4));
    for _ in 0..count {
        assert_eq!((&bytes[at..at + 4], number(at + 10, 2)), (&b"PK\x01\x02"[..], 8), "deflated");
        let (size, name_length) = (number(at + 20, 4), number(at + 28, 2));
        let (extra, comment, header) = (number(at + 30, 2), number(at + 32, 2), number(at + 42, 4));
        let name = String::from_utf8(bytes[at + 46..at + 46 + name_length].to_vec()).unwrap();
        let start = header + 30 + number(header + 26, 2) + number(header + 28, 2);
        let mut array = Vec::new();
        DeflateDecoder::new(&bytes[start..start + size]).read_to_end(&mut array).unwrap();
        let head = 10 + usize::from(array[8]) + 256 * usize::from(array[9]);
        if String::from_utf8_lossy(&array[..head]).contains("'<f8'") {
            let values = array[head..].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()));
            arrays.insert(name.trim_end_matches(".npy").to_owned(), values.collect());
        }
        at += 46 + name_length + extra + comment;
    }
    arrays
}

struct Beam {
    solution: Solution,
    points: RestPoints,
    partition: Partition,
    solver: Box<dyn LinearSolver>,
    a: greenstage::fem::StiffnessMatrix,
    /// The mesh node at each place of the arrays.
    nodes: Vec<usize>,
}

impl Beam {
    fn new(folder: &Path, places: &[f64]) -> Beam {
        let scene = Scene::load(&folder.join("scene.toml")).unwrap();
        let lame = green::prepare(&scene, "beam").unwrap().lame;
        let solution = green::solve(&scene, "beam", &Requirements::new(&[AFFINE]), &Silent).unwrap();
        let held = solution.controls.iter().flat_map(|control| control.nodes.iter().copied());
        let partition = Partition::new(solution.mesh.nodes.len(), held);
        let a = partition.a(&TET4.assemble(&solution.mesh, &lame).unwrap());
        let at = |place: &[f64]| {
            let place = Vector3::from_column_slice(place);
            solution.mesh.nodes.iter().position(|node| (node - place).amax() < 1e-9).unwrap()
        };
        Beam {
            nodes: places.chunks_exact(3).map(at).collect(),
            points: RestPoints::new(&TET4, &solution.mesh, &lame).unwrap(),
            solver: scene.body["beam"].solver.analyse(&a, &Silent).unwrap(),
            a,
            partition,
            solution,
        }
    }

    /// The linear answer to coefficients of both control elements, a column for each list of them.
    fn linear(&self, coefficients: &[Vec<f64>]) -> NodeFields {
        let fields = &self.solution.fields;
        let c = DMatrix::from_fn(fields.columns, coefficients.len(), |row, column| coefficients[column][row]);
        let dense = DMatrix::from_row_slice(3 * fields.nodes, fields.columns, &fields.data);
        let data = (dense * c).transpose().as_slice().to_vec();
        NodeFields { nodes: fields.nodes, columns: coefficients.len(), data }
    }

    /// The next order of a series whose boundary motion is all in its first.
    fn next(&self, orders: &[NodeFields]) -> NodeFields {
        let loads = self.points.series_loads(orders).at(&self.partition.free);
        let mut fields = NodeFields::zeros(self.points.nodes, loads.columns);
        let factor = self.solver.factor(&self.a, &Silent).unwrap();
        self.partition.insert_free(&factor.solve(&loads, &Silent).unwrap().0, &mut fields);
        fields
    }

    /// Relative difference in L2 of a column from an array over the nodes.
    fn off(&self, fields: &NodeFields, column: &[f64], expected: &[f64]) -> f64 {
        let (mut square, mut size) = (0.0, 0.0);
        for (node, expected) in self.nodes.iter().zip(expected.chunks_exact(3)) {
            for (axis, expected) in expected.iter().enumerate() {
                let row = fields.row(3 * node + axis);
                let found: f64 = row.iter().zip(column).map(|(value, share)| value * share).sum();
                square += (found - expected).powi(2);
                size += expected.powi(2);
            }
        }
        (square / size).sqrt()
    }
}

/// Orders 1 to 5 along the straight way of the affine coefficients to a bend by 20°, and three second derivatives.
#[test]
fn orders_and_second_derivatives_are_those_of_the_case() {
    let (Some(case), Some(beam)) = (shared("cases/beam_series"), shared("cases/beam_stvk")) else { return };
    let arrays = arrays(&case.join("series.npz"));
    let beam = Beam::new(&beam, &arrays["X"]);
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 20_f64.to_radians());
    let expected = &arrays["series_linear_path_bend20"];
    let per_order = arrays["X"].len();

    let angle = 20_f64.to_radians();
    // The end of the arc that a beam of length 1 m is bent into.
    let place = Vector3::new(0.0, (angle.cos() - 1.0) / angle, angle.sin() / angle - 1.0);
    let pose = ControlPose { translation: place, matrix: *turn.matrix() };
    let bend = [vec![0.0; FIELDS], pose.coefficients().to_vec()].concat();
    let mut orders = vec![beam.linear(&[bend])];
    for k in 0..5 {
        let off = beam.off(&orders[k], &[1.0], &expected[k * per_order..(k + 1) * per_order]);
        assert!(off < 1e-8, "order {}: {off:e}", k + 1);
        let next = beam.next(&orders);
        orders.push(next);
    }

    // The fields of a turn about x, a turn about y and a shift along y of the second control element.
    let unit = |entries: &[(usize, f64)]| {
        let mut c = vec![0.0; 2 * FIELDS];
        entries.iter().for_each(|(field, value)| c[FIELDS + field] = *value);
        c
    };
    // e × (x - o): rows of M - I.
    let [rx, ry, ty] = [unit(&[(8, -1.0), (10, 1.0)]), unit(&[(5, 1.0), (9, -1.0)]), unit(&[(1, 1.0)])];
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f64>>();
    let first = beam.linear(&[rx.clone(), ry.clone(), ty.clone(), sum(&rx, &ry), sum(&rx, &ty)]);
    for (name, column) in [("lin_rotx", 0), ("lin_roty", 1), ("lin_ty", 2)] {
        let mut share = [0.0; 5];
        share[column] = 1.0;
        assert!(beam.off(&first, &share, &arrays[name]) < 1e-8, "{name}");
    }
    let second = beam.next(&[first]);
    for (name, share) in [
        ("second_xx", [2.0, 0.0, 0.0, 0.0, 0.0]),
        ("second_xy", [-1.0, -1.0, 0.0, 1.0, 0.0]),
        ("second_xt", [-1.0, 0.0, -1.0, 0.0, 1.0]),
    ] {
        let off = beam.off(&second, &share, &arrays[name]);
        assert!(off < 1e-8, "{name}: {off:e}");
    }
}
