use super::base::Tables;
use super::fallen::Fallen;
use super::opened::{Cuttable, Known, Shape};
use crate::base::extent::bounding_box;
use crate::fem::dense_fields::products;
use crate::fem::{Element, Lame, NodeFields, Partition, TET4, tet4};
use crate::green::{ControlElement, FIELDS, Volume};
use crate::mesh::split::{CutEdges, Split, edge};
use crate::mesh::{Block, Surface, TetMesh, block, edges_of};
use crate::solve::{Silent, Solver};
use nalgebra::{DMatrix, DVector, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;

type V3 = Vector3<f64>;

/// A bar of two materials, held at both ends.
fn bar(cells: [u32; 3]) -> Volume {
    let mesh = block(&Block { size: [0.3, 0.1, 0.06], cells }).unwrap();
    let lame = (0..mesh.tets.len())
        .map(|tet| Lame::from_young_poisson(if mesh.corners(tet)[0].y > 0.0 { 1e5 } else { 4e5 }, 0.4))
        .collect();
    let held = ["xmin", "xmax"].map(|group| mesh.groups[group].clone()).to_vec();
    let surface = Surface::from_mesh(&mesh).nodes;
    let forces = DMatrix::zeros(3 * mesh.nodes.len(), 0);
    Volume { element: &TET4, mesh, lame, held, surface, forces, density: Vec::new() }
}

/// Handle stiffness and affine fields at all nodes of a mesh, assembled and solved anew.
fn anew(
    mesh: &TetMesh,
    lame: &[Lame],
    held: &[Vec<u32>],
    origins: &[ControlElement],
) -> (DMatrix<f64>, NodeFields) {
    let k = Element::assemble(&TET4, mesh, lame).unwrap();
    let partition = Partition::new(mesh.nodes.len(), held.iter().flatten().copied());
    let mut fields = NodeFields::zeros(mesh.nodes.len(), FIELDS * held.len());
    for (e, control) in origins.iter().enumerate() {
        control.prescribe(&mesh.nodes, FIELDS * e, &mut fields);
    }
    let b = partition.minus_b_times(&k, &fields);
    let a = partition.a(&k);
    let solver = Solver::default().analyse(&a, &Silent).unwrap();
    let (x, _) = solver.factor(&a, &Silent).unwrap().solve(&b, &Silent).unwrap();
    partition.insert_free(&x, &mut fields);
    (products(&k, &fields, &fields), fields)
}

fn controls(volume: &Volume) -> Vec<ControlElement> {
    let (low, high) = bounding_box(&volume.mesh.nodes);
    let control =
        |nodes: &Vec<u32>| ControlElement::new("", nodes.clone(), &volume.mesh, (high - low).norm());
    volume.held.iter().map(control).collect()
}

fn cuttable(volume: &Volume) -> Cuttable {
    let (stiffness, _) = anew(&volume.mesh, &volume.lame, &volume.held, &controls(volume));
    let names = vec!["a"; volume.held.len()];
    let tables = Tables { stiffness, weight: None, takes_points: true };
    Cuttable::new(volume.clone(), &names, V3::zeros(), tables).unwrap()
}

/// The edges that a plane n·x = d cuts where `is_in` holds.
fn by_plane(mesh: &TetMesh, n: V3, d: f64, is_in: impl Fn(V3) -> bool) -> CutEdges {
    let mut cut = CutEdges::new();
    for [a, b] in mesh.tets.iter().flat_map(edges_of) {
        let [x, y] = [a, b].map(|node| mesh.nodes[node as usize]);
        let (from, to) = (n.dot(&x) - d, n.dot(&y) - d);
        let share = from / (from - to);
        if from * to < 0.0 && is_in(x + (y - x) * share) {
            cut.insert(edge([a, b]), share);
        }
    }
    cut
}

/// The cut body as a mesh of its own: each piece a tetrahedron with that share of the material's stiffness.
fn as_mesh(volume: &Volume, split: &Split) -> (TetMesh, Vec<Lame>) {
    let mut mesh = TetMesh { groups: Default::default(), ..volume.mesh.clone() };
    mesh.nodes.extend(split.copies.iter().map(|node| volume.mesh.nodes[*node as usize]));
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    let mut lame = volume.lame.clone();
    let mut seen = BTreeSet::new();
    for piece in &split.pieces {
        let tet = piece.tet as usize;
        let Lame { lambda, mu } = volume.lame[tet];
        let part = Lame { lambda: lambda * piece.volume(), mu: mu * piece.volume() };
        if seen.insert(tet) {
            (mesh.tets[tet], lame[tet]) = (piece.nodes, part);
        } else {
            mesh.tets.push(piece.nodes);
            mesh.regions.push(0);
            lame.push(part);
        }
    }
    (mesh, lame)
}

/// Columns and handle stiffness against the cut body assembled and solved anew: a slit, a second one that crosses it, and one through a
/// control element; from the whole body, and each from a new base with the slits before.
#[test]
fn a_cut_body_is_the_body_solved_anew() {
    let volume = bar([8, 4, 3]);
    let cuttable = cuttable(&volume);
    [false, true].into_iter().for_each(|renews| slits_are_solved_anew(&volume, &cuttable, renews));
}

fn slits_are_solved_anew(volume: &Volume, cuttable: &Cuttable, renews: bool) {
    let (mut cut, mut known) = (CutEdges::new(), Known::default());
    let mut base = cuttable.base.clone();
    let slits = [
        (V3::new(1.0, 0.2, 0.0), 0.013, 0.03),
        (V3::new(0.3, 0.1, 1.0), 0.004, 0.02),
        (V3::new(1.0, 0.0, 0.1), -0.14, 0.01),
    ];
    for (n, d, deep) in slits {
        let (low, high) = bounding_box(&volume.mesh.nodes);
        let middle = (low + high) * 0.5;
        let more = by_plane(&volume.mesh, n, n.dot(&middle) + d, |x| {
            x.y > middle.y + deep * 0.5 && x.x < high.x - 0.05
        });
        for (edge, share) in more {
            cut.insert(edge, share);
        }
        let split = cuttable.split(&cut, &base);
        let points = cuttable.matter.splitter.surface(&split, &cut);
        let opened = cuttable.open(&base, &known, (&split, &points)).unwrap();
        let (mesh, lame) = as_mesh(volume, &split);
        let (stiffness, fields) = anew(&mesh, &lame, &volume.held, &controls(volume));
        let largest = fields.data.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        let columns = &opened.surface.columns;
        let mut apart = 0.0_f64;
        let mut compare = |row: usize, expected: &dyn Fn(usize) -> f64| {
            let misses = (0..columns.ncols()).map(|k| (columns[(row, k)] - expected(k)).abs());
            apart = misses.fold(apart, f64::max);
        };
        for axis in 0..3 {
            for (at, node) in volume.surface.iter().enumerate() {
                compare(3 * at + axis, &|k| fields.row(3 * *node as usize + axis)[k]);
            }
            // The points of the surface move with the pieces on whose edges they lie.
            for (at, point) in points.points.iter().enumerate() {
                let [a, b] = point.nodes.map(|node| fields.row(3 * node as usize + axis));
                let expected = |k: usize| a[k] * (1.0 - point.share) + b[k] * point.share;
                compare(3 * (volume.surface.len() + at) + axis, &expected);
            }
        }
        let c: Vec<f64> = (0..2 * FIELDS).map(|k| (k as f64 * 1.7).sin() * 0.1).collect();
        let shape = Shape { coefficients: &c, forces: &[] };
        let places = cuttable.places(&opened.moved, &shape).unwrap();
        let mut off = 0.0_f64;
        for (node, place) in places.iter().enumerate() {
            let u = |axis: usize| fields.row(3 * node + axis).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>();
            off = off.max((place - volume.mesh.nodes[node] - V3::new(u(0), u(1), u(2))).amax());
        }
        let forces = (&opened.surface.stiffness - &stiffness).amax() / stiffness.amax();
        let softer = 1.0 - opened.surface.stiffness[(0, 0)] / cuttable.base.tables.stiffness[(0, 0)];
        println!(
            "{} copies, {} of them beyond: columns {:e}, places {off:e} m, stiffness {forces:e}, equations {:e}, softer by {softer:.3}",
            split.copies.len(),
            opened.known.count(),
            apart / largest,
            opened.error
        );
        assert!(forces < 1.5e-13, "{forces:e}");
        assert!(apart < 5e-7 * largest && off < 1e-7, "{apart:e} of {largest}, {off:e} m");
        assert!(split.copies.len() > 5 && softer > 0.0);
        known = opened.known;
        if renews {
            assert!(known.count() < split.copies.len() || base.edges == 0);
            (base, known) = (cuttable.cut_base(Arc::new(split), cut.len()).unwrap(), Known::default());
        }
    }
}

/// Stiffness against bending of a bar with a slit to its middle, across its length.
fn bending(stiffness: &DMatrix<f64>) -> f64 {
    // The right end turns about z: M - 1 = θ (e_y e_xᵀ - e_x e_yᵀ), row by row after T.
    let mut turn = DVector::zeros(2 * FIELDS);
    (turn[FIELDS + 3 + 1], turn[FIELDS + 3 + 3]) = (-1.0, 1.0);
    turn.dot(&(stiffness * &turn))
}

/// The slit in the middle of elements against the same slit along faces of a mesh whose nodes there stand twice: both come to the same, the
/// difference falls with the length of the edges.
#[test]
fn a_cut_through_elements_converges_to_one_along_faces() {
    let mut apart = Vec::new();
    for m in [1, 2, 4] {
        let along = bar([8 * m, 4 * m, 2 * m]);
        let mut mesh = along.mesh.clone();
        let (low, high) = bounding_box(&mesh.nodes);
        let middle = (low + high) * 0.5;
        let mut twice = BTreeMap::new();
        for (node, x) in (0..).zip(&along.mesh.nodes) {
            if (x.x - middle.x).abs() < 1e-9 && x.y > middle.y + 1e-9 {
                twice.insert(node, (along.mesh.nodes.len() + twice.len()) as u32);
                mesh.nodes.push(*x);
            }
        }
        mesh.tags = (1..=mesh.nodes.len() as u64).collect();
        for (tet, nodes) in mesh.tets.iter_mut().enumerate() {
            if along.mesh.corners(tet).iter().map(|x| x.x - middle.x).sum::<f64>() > 0.0 {
                *nodes = nodes.map(|node| *twice.get(&node).unwrap_or(&node));
            }
        }
        let (reference, _) = anew(&mesh, &along.lame, &along.held, &controls(&along));
        let (whole, _) = anew(&along.mesh, &along.lame, &along.held, &controls(&along));
        let across = bar([8 * m + 1, 4 * m, 2 * m]);
        let cut = by_plane(&across.mesh, V3::x(), middle.x, |x| x.y > middle.y);
        let across = cuttable(&across);
        let split = across.split(&cut, &across.base);
        let surface = across.matter.splitter.surface(&split, &cut);
        let opened = across.open(&across.base, &Known::default(), (&split, &surface)).unwrap();
        let softer = bending(&across.base.tables.stiffness) - bending(&opened.surface.stiffness);
        let expected = bending(&whole) - bending(&reference);
        println!("{m}: softer by {softer} N m, along faces by {expected} N m");
        apart.push(softer / expected - 1.0);
    }
    assert!(apart[2].abs() < 0.6 * apart[1].abs() && apart[1].abs() < 0.6 * apart[0].abs(), "{apart:?}");
}

/// Columns of the compliance at nodes of the old surface, of the cut, and at the end of the slit, against the cut body assembled and solved
/// anew; the bits of one do not depend on what is asked for with it. From the whole body, and from a base with half of the slit.
#[test]
fn a_cut_surface_yields_like_that_of_the_body_solved_anew() {
    let volume = bar([8, 4, 3]);
    let cuttable = cuttable(&volume);
    [false, true].into_iter().for_each(|renews| surface_yields(&volume, &cuttable, renews));
}

fn surface_yields(volume: &Volume, cuttable: &Cuttable, renews: bool) {
    let (low, high) = bounding_box(&volume.mesh.nodes);
    let middle = (low + high) * 0.5;
    let n = V3::new(1.0, 0.2, 0.3);
    let cut = by_plane(&volume.mesh, n, n.dot(&middle) + 0.004, |x| x.y > middle.y - 0.02);
    let mut base = cuttable.base.clone();
    if renews {
        let half = by_plane(&volume.mesh, n, n.dot(&middle) + 0.004, |x| x.y > middle.y + 0.02);
        let split = Arc::new(cuttable.split(&half, &base));
        base = cuttable.cut_base(split, half.len()).unwrap();
    }
    let split = cuttable.split(&cut, &base);
    let surface = cuttable.matter.splitter.surface(&split, &cut);
    let points = &surface.points;
    let opened = cuttable.open(&base, &Known::default(), (&split, &surface)).unwrap();
    assert!(opened.known.count() > 5 && (opened.known.count() < split.copies.len()) == renews);
    let compliance = opened.surface.compliance.unwrap();
    let (mesh, lame) = as_mesh(volume, &split);
    let k = Element::assemble(&TET4, &mesh, &lame).unwrap();
    let partition = Partition::new(mesh.nodes.len(), volume.held.iter().flatten().copied());
    let a = partition.a(&k);
    let solver = Solver::default().analyse(&a, &Silent).unwrap();
    let factor = solver.factor(&a, &Silent).unwrap();
    let old = volume.surface.len();
    let corners = |at: usize| match at.checked_sub(old) {
        None => vec![(volume.surface[at], 1.0)],
        Some(point) => {
            let [a, b] = points[point].nodes;
            vec![(a, 1.0 - points[point].share), (b, points[point].share)]
        }
    };
    let taking = compliance.nodes();
    let of_cut = taking.iter().filter(|node| **node as usize >= old).count();
    assert!(of_cut == points.len() && taking.len() > of_cut + 40);
    let asked: Vec<u32> = taking.iter().copied().step_by(17).collect();
    let columns = compliance.columns(&asked).unwrap();
    let mut off = 0.0_f64;
    for (node, column) in asked.iter().zip(&columns) {
        let mut b = NodeFields::zeros(mesh.nodes.len(), 3);
        for (of, share) in corners(*node as usize) {
            (0..3).for_each(|axis| b.row_mut(3 * of as usize + axis)[axis] = share);
        }
        let (x, _) = factor.solve(&b.at(&partition.free), &Silent).unwrap();
        let mut u = NodeFields::zeros(mesh.nodes.len(), 3);
        partition.insert_free(&x, &mut u);
        let most = u.data.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        for (at, found) in column.iter().enumerate() {
            for (axis, found) in found.iter().enumerate() {
                for (force, found) in found.iter().enumerate() {
                    let of = |(node, share): (u32, f64)| u.row(3 * node as usize + axis)[force] * share;
                    let expected: f64 = corners(at).into_iter().map(of).sum();
                    off = off.max((f64::from(*found) - expected).abs() / most);
                }
            }
        }
    }
    println!("{} columns, off by a part of {off:e}", columns.len());
    assert!(off < 9e-7, "{off:e}");
    for (node, column) in asked.iter().zip(&columns) {
        assert!(compliance.columns(&[*node]).unwrap()[0] == *column, "node {node}");
    }
    let (pressed, force) = (volume.surface[asked[1] as usize], V3::new(1.0, -2.0, 0.5));
    let shape = Shape { coefficients: &[], forces: &[(pressed, force)] };
    let count = || base.solves.asked.load(Ordering::Relaxed);
    let before = count();
    let places = cuttable.places(&opened.moved, &shape).unwrap();
    assert_eq!(count(), before, "a column is enough for a blade");
    let mut b = NodeFields::zeros(mesh.nodes.len(), 1);
    (0..3).for_each(|axis| b.row_mut(3 * pressed as usize + axis)[0] = force[axis]);
    let mut u = NodeFields::zeros(mesh.nodes.len(), 1);
    partition.insert_free(&factor.solve(&b.at(&partition.free), &Silent).unwrap().0, &mut u);
    let most = u.data.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
    let apart = places
        .iter()
        .zip(&volume.mesh.nodes)
        .zip(u.data.chunks_exact(3))
        .map(|((place, rest), u)| (place - rest - V3::from_column_slice(u)).amax() / most);
    let apart = apart.fold(0.0, f64::max);
    println!("places off by a part of {apart:e}");
    assert!(apart < 4e-7, "{apart:e}");
    opened.moved.forget();
    assert!(cuttable.places(&opened.moved, &shape).unwrap() == places && count() > before);
}

/// The cut body without what nothing holds, as a mesh of its own, with the new number of each node.
fn held_mesh(volume: &Volume, split: &Split) -> (TetMesh, Vec<Lame>, BTreeMap<u32, u32>) {
    let (mut mesh, mut lame) = as_mesh(volume, split);
    let is_held: Vec<bool> = mesh.tets.iter().map(|nodes| !split.is_loose(nodes[0])).collect();
    let keep = |count: usize| is_held.iter().take(count).copied().collect::<Vec<_>>();
    let (mut tets, mut materials) = (keep(mesh.tets.len()).into_iter(), keep(lame.len()).into_iter());
    mesh.tets.retain(|_| tets.next().unwrap());
    lame.retain(|_| materials.next().unwrap());
    mesh.regions.truncate(mesh.tets.len());
    let used: BTreeSet<u32> = mesh.tets.iter().flatten().copied().collect();
    let numbers: BTreeMap<u32, u32> = used.iter().copied().zip(0..).collect();
    mesh.tets.iter_mut().flatten().for_each(|node| *node = numbers[node]);
    mesh.nodes = used.iter().map(|node| mesh.nodes[*node as usize]).collect();
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    (mesh, lame, numbers)
}

/// Displacements of a body by forces at its nodes.
fn sag(mesh: &TetMesh, lame: &[Lame], held: &[Vec<u32>], forces: &DMatrix<f64>) -> NodeFields {
    let k = Element::assemble(&TET4, mesh, lame).unwrap();
    let partition = Partition::new(mesh.nodes.len(), held.iter().flatten().copied());
    let data = forces.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect();
    let b = NodeFields { nodes: mesh.nodes.len(), columns: 3, data };
    let a = partition.a(&k);
    let factor = Solver::default().analyse(&a, &Silent).unwrap();
    let (x, _) = factor.factor(&a, &Silent).unwrap().solve(&b.at(&partition.free), &Silent).unwrap();
    let mut all = NodeFields::zeros(mesh.nodes.len(), 3);
    partition.insert_free(&x, &mut all);
    all
}

/// Adds the weight of a mass at a node, for gravity along each axis.
fn weigh(forces: &mut DMatrix<f64>, node: u32, mass: f64) {
    (0..3).for_each(|axis| forces[(3 * node as usize + axis, axis)] += mass);
}

/// Work of forces on displacements.
fn work(forces: &DMatrix<f64>, fields: &NodeFields) -> DMatrix<f64> {
    DMatrix::from_fn(fields.columns, 3, |c, k| {
        (0..forces.nrows()).map(|row| fields.row(row)[c] * forces[(row, k)]).sum::<f64>()
    })
}

/// A block whose far end is cut off, and a slit beside what is left: it is the body solved anew without that end, under gravity too. Held are
/// its left end and some nodes below. Then the same from bases without the end, and with the slit.
#[test]
fn what_falls_off_is_no_part_of_the_body_any_more() {
    let mut volume = bar([8, 4, 3]);
    let (low, high) = bounding_box(&volume.mesh.nodes);
    let middle = (low + high) * 0.5;
    let below = |x: &V3| x.y < low.y + 1e-9 && x.x > low.x + 0.06 && x.x < low.x + 0.12;
    volume.held[1] = (0..).zip(&volume.mesh.nodes).filter(|(_, x)| below(x)).map(|(n, _)| n).collect();
    volume.density = (0..volume.mesh.tets.len()).map(|tet| 900.0 + 3.0 * tet as f64).collect();
    let heavy = |tet: usize| volume.density[tet] * tet4::geometry(volume.mesh.corners(tet)).unwrap().volume;
    volume.forces = DMatrix::zeros(3 * volume.mesh.nodes.len(), 3);
    for (tet, nodes) in volume.mesh.tets.iter().enumerate() {
        nodes.iter().for_each(|node| weigh(&mut volume.forces, *node, heavy(tet) / 4.0));
    }
    let origins = controls(&volume);
    let (stiffness, fields) = anew(&volume.mesh, &volume.lame, &volume.held, &origins);
    let whole_sag = sag(&volume.mesh, &volume.lame, &volume.held, &volume.forces);
    let weight = [work(&volume.forces, &fields), work(&volume.forces, &whole_sag)];
    let tables = Tables { stiffness, weight: Some(weight), takes_points: true };
    let cuttable = Cuttable::new(volume.clone(), &["a", "b"], middle, tables).unwrap();
    let n = V3::new(1.0, 0.2, 0.3);
    let through = by_plane(&volume.mesh, n, n.dot(&middle) + 0.004, |_| true);
    let slit = by_plane(&volume.mesh, V3::x(), middle.x - 0.031, |x| x.y > middle.y + 0.01);
    let (mut cut, mut known, mut base) = (CutEdges::new(), Known::default(), cuttable.base.clone());
    // From the whole body, and from bases that have lost the end, or have the slit, or both.
    let both: CutEdges = through.iter().chain(&slit).map(|(edge, share)| (*edge, *share)).collect();
    for (before, more) in [
        (None, &through),
        (None, &slit),
        (Some(&through), &slit),
        (Some(&slit), &through),
        (Some(&both), &both),
    ] {
        if let Some(before) = before {
            cut.clone_from(before);
            let split = Arc::new(cuttable.split(&cut, &cuttable.base));
            (base, known) = (cuttable.cut_base(split, cut.len()).unwrap(), Known::default());
        }
        cut.extend(more);
        let split = cuttable.split(&cut, &base);
        assert_eq!(split.loose.len(), 1);
        let points = cuttable.matter.splitter.surface(&split, &cut);
        let opened = cuttable.open(&base, &known, (&split, &points)).unwrap();
        let (mesh, lame, numbers) = held_mesh(&volume, &split);
        let held: Vec<Vec<u32>> =
            volume.held.iter().map(|nodes| nodes.iter().map(|node| numbers[node]).collect()).collect();
        let (stiffness, fields) = anew(&mesh, &lame, &held, &origins);
        let mut forces = DMatrix::zeros(3 * mesh.nodes.len(), 3);
        for (tet, nodes) in (0..).zip(&volume.mesh.tets) {
            if split.pieces_of(tet).is_none() && !split.is_loose(nodes[0]) {
                nodes.iter().for_each(|node| weigh(&mut forces, numbers[node], heavy(tet as usize) / 4.0));
            }
        }
        for piece in split.pieces.iter().filter(|piece| !split.is_loose(piece.nodes[0])) {
            let mass = heavy(piece.tet as usize);
            for (node, share) in piece.nodes.iter().zip(piece.shares) {
                weigh(&mut forces, numbers[node], mass * share);
            }
        }
        let sunk = sag(&mesh, &lame, &held, &forces);
        let new = &opened.surface;
        let off = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).amax() / b.amax();
        let of_weight = new.weight.as_ref().unwrap();
        let lost = volume.forces.column(0).sum() - forces.column(0).sum();
        let errors = [
            off(&new.stiffness, &stiffness),
            off(&of_weight.reaction, &work(&forces, &fields)),
            off(&of_weight.compliance, &work(&forces, &sunk)),
            (of_weight.lost[(0, 0)] / lost - 1.0).abs(),
        ];
        let mut apart = [0.0_f64; 2];
        for (at, node) in volume.surface.iter().enumerate() {
            let Some(number) = numbers.get(node) else { continue };
            for axis in 0..3 {
                let (row, own) = (3 * at + axis, 3 * *number as usize + axis);
                for k in 0..fields.columns {
                    apart[0] = apart[0].max((new.columns[(row, k)] - fields.row(own)[k]).abs());
                }
                for k in 0..3 {
                    apart[1] = apart[1].max((of_weight.columns[(row, k)] - sunk.row(own)[k]).abs());
                }
            }
        }
        let largest = |of: &NodeFields| of.data.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        let apart = [apart[0] / largest(&fields), apart[1] / largest(&sunk)];
        println!(
            "{} copies, {} beyond: forces off by {errors:?}, columns by {apart:?}",
            split.copies.len(),
            opened.known.count()
        );
        assert!(errors.iter().all(|error| *error < 5e-13), "{errors:?}");
        assert!(apart.iter().all(|apart| *apart < 2e-7), "{apart:?}");
        // What has fallen off takes no forces and is not drawn.
        let place = |point: u32| match (point as usize).checked_sub(volume.surface.len()) {
            None => volume.mesh.nodes[volume.surface[point as usize] as usize],
            Some(point) => V3::from(new.points[point].map(f64::from)) + middle,
        };
        let is_beyond = |point: &u32| n.dot(&(place(*point) - middle)) > 0.004 + 1e-6;
        let taking = new.compliance.as_ref().unwrap();
        assert!(!taking.nodes().iter().any(is_beyond) && !new.triangles.as_flattened().iter().any(is_beyond));
        assert!(new.triangles.len() > 100 && taking.nodes().len() > 50);
        known = opened.known;
    }
}

/// A corner of the block that a single tetrahedron has: it comes off with a part of the tetrahedron's volume, and the rest hardly changes.
#[test]
fn a_piece_of_one_tetrahedron_comes_off() {
    let mut volume = bar([8, 4, 3]);
    volume.held.truncate(1);
    volume.density = vec![1000.0; volume.mesh.tets.len()];
    volume.forces = DMatrix::zeros(3 * volume.mesh.nodes.len(), 3);
    let (stiffness, _) = anew(&volume.mesh, &volume.lame, &volume.held, &controls(&volume));
    let weight = Some([DMatrix::zeros(FIELDS, 3), DMatrix::zeros(3, 3)]);
    let tables = Tables { stiffness: stiffness.clone(), weight, takes_points: true };
    let cuttable = Cuttable::new(volume.clone(), &["a"], V3::zeros(), tables).unwrap();
    let splitter = &cuttable.matter.splitter;
    let is_corner = |node: &u32| splitter.tets_around(*node).len() == 1 && !volume.held[0].contains(node);
    let node = (0..volume.mesh.nodes.len() as u32).find(is_corner).unwrap();
    let tet = splitter.tets_around(node)[0];
    let share = |other: u32| if node < other { 0.3 } else { 0.7 };
    let others = volume.mesh.tets[tet as usize].into_iter().filter(|other| *other != node);
    let cut: CutEdges = others.map(|other| (edge([node, other]), share(other))).collect();
    let split = cuttable.split(&cut, &cuttable.base);
    let points = splitter.surface(&split, &cut);
    let opened = cuttable.open(&cuttable.base, &Known::default(), (&split, &points)).unwrap();
    let changed = (&opened.surface.stiffness - &stiffness).amax() / stiffness.amax();
    let pieces = Fallen::all(&cuttable, (&split, &cut), &Split::default());
    let mass = cuttable.matter.mass(tet) * 0.3_f64.powi(3);
    let off = pieces[0].mass() / mass - 1.0;
    println!(
        "{} copies, stiffness changed by {changed:e}, mass off by {off:e}, {:e}",
        split.copies.len(),
        opened.error
    );
    assert!(pieces.len() == 1 && pieces[0].nodes == [node] && changed < 3e-11);
    assert!(off.abs() < 2e-15, "{} kg of {mass} kg", pieces[0].mass());
    assert!(opened.error < 1e-12, "{:e}", opened.error);
}
