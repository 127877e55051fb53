use super::groups::PAIRS;
use super::{CutEdges, CutPoint, CutSurface, LoosePart, Split, Splitter, edge};
use crate::base::random::Random;
use crate::mesh::{Block, TetMesh, block};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

type V3 = Vector3<f64>;

fn a_block() -> Arc<TetMesh> {
    Arc::new(block(&Block { size: [0.3, 0.2, 0.1], cells: [6, 4, 3] }).unwrap())
}

/// The edges that a plane n·x = d cuts where `is_in` holds for the point.
fn by_plane(mesh: &TetMesh, n: Vector3<f64>, d: f64, is_in: &dyn Fn(Vector3<f64>) -> bool) -> CutEdges {
    let mut cut = CutEdges::new();
    for tet in &mesh.tets {
        for (i, j) in PAIRS {
            let [a, b] = edge([tet[i], tet[j]]);
            let [x, y] = [a, b].map(|node| mesh.nodes[node as usize]);
            let (from, to) = (n.dot(&x) - d, n.dot(&y) - d);
            let share = from / (from - to);
            if from * to < 0.0 && is_in(x + (y - x) * share) {
                cut.insert([a, b], share);
            }
        }
    }
    cut
}

fn volume_of(mesh: &TetMesh) -> f64 {
    (0..mesh.tets.len()).map(|tet| volume_of_tet(mesh, tet)).sum()
}

fn volume_of_tet(mesh: &TetMesh, tet: usize) -> f64 {
    let [a, b, c, d] = mesh.corners(tet);
    (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
}

/// Volume within the triangles, and by how much the sum of their normals misses 0.
fn enclosed(splitter: &Splitter, split: &Split, surface: &CutSurface) -> (f64, f64) {
    let at = |node: u32| match (node as usize).checked_sub(splitter.mesh.nodes.len()) {
        None => splitter.mesh.nodes[node as usize],
        Some(point) => {
            let CutPoint { nodes, share } = surface.points[point];
            let [x, y] = nodes.map(|node| splitter.place(split, node));
            x + (y - x) * share
        }
    };
    let (mut volume, mut normals) = (0.0, Vector3::zeros());
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(at);
        volume += a.cross(&b).dot(&c) / 6.0;
        normals += (b - a).cross(&(c - a));
    }
    (volume, normals.norm())
}

fn holding(mesh: &TetMesh, is_held: &dyn Fn(Vector3<f64>) -> bool) -> Vec<Option<usize>> {
    mesh.nodes.iter().map(|x| is_held(*x).then_some(0)).collect()
}

/// A plane through the whole block: both sides have the volumes that it cuts off, the surface is closed, and the side that nothing
/// holds falls off.
#[test]
fn a_plane_divides_a_block() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let (low, high) = crate::base::extent::bounding_box(&mesh.nodes);
    let n = Vector3::new(1.0, 0.2, -0.3);
    let d = n.dot(&((low + high) * 0.5)) + 0.011;
    let cut = by_plane(&mesh, n, d, &|_| true);
    let held = holding(&mesh, &|x| x.x < low.x + 1e-9);
    let split = splitter.split(&cut, &held, &Split::default());
    let surface = splitter.surface(&split, &cut);
    assert!(split.loose.len() == 1 && !split.copies.is_empty());
    let both = holding(&mesh, &|x| x.x < low.x + 1e-9 || x.x > high.x - 1e-9);
    assert!(splitter.split(&cut, &both, &Split::default()).loose.is_empty());
    let beyond = |node: u32| n.dot(&mesh.nodes[node as usize]) > d;
    let mut far = 0.0;
    for (tet, nodes) in mesh.tets.iter().enumerate() {
        let own: Vec<_> = split.pieces.iter().filter(|piece| piece.tet as usize == tet).collect();
        let sum: f64 = own.iter().map(|piece| piece.volume()).sum();
        assert!(own.is_empty() || (sum - 1.0).abs() < 1e-14, "{sum}");
        let part = match own.is_empty() {
            true => f64::from(u8::from(beyond(nodes[0]))),
            false => own
                .iter()
                .filter(|piece| (0..4).any(|k| piece.own[k] && beyond(nodes[k])))
                .map(|piece| piece.volume())
                .sum(),
        };
        far += part * volume_of_tet(&mesh, tet);
    }
    // The plane leaves the block through its four long sides: its volume beyond is that at the middle of the section.
    let size = high - low;
    let expected = size.y * size.z * (size.x * 0.5 - 0.011);
    assert!((far / expected - 1.0).abs() < 1e-12, "{far} of {expected}");
    let (volume, open) = enclosed(&splitter, &split, &surface);
    assert!((volume / volume_of(&mesh) - 1.0).abs() < 1e-12, "{volume}");
    assert!(open < 1e-15, "{open:e}");
    let mut edges = BTreeMap::new();
    for [a, b, c] in &surface.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *edges.entry([*from, *to]).or_insert(0) += 1;
        }
    }
    assert!(edges.iter().all(|([a, b], count)| *count == 1 && edges.contains_key(&[*b, *a])));
}

/// Slits, crossing cuts and edges cut at random: no volume is lost, and what meets keeps its nodes in common.
#[test]
fn any_cut_keeps_the_volume() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let whole = volume_of(&mesh);
    let held = vec![None; mesh.nodes.len()];
    let (low, high) = crate::base::extent::bounding_box(&mesh.nodes);
    let middle = (low + high) * 0.5;
    let mut cuts: Vec<CutEdges> = Vec::new();
    let slit =
        |n: Vector3<f64>, deep: f64| by_plane(&mesh, n, n.dot(&middle) + 0.004, &|x| x.y > high.y - deep);
    cuts.push(slit(Vector3::x(), 0.11));
    cuts.push(slit(Vector3::new(0.8, 0.1, 0.5), 0.07));
    let mut crossing = slit(Vector3::new(1.0, 0.0, 0.2), 0.3);
    crossing.extend(slit(Vector3::new(0.1, 0.0, 1.0), 0.3));
    cuts.push(crossing);
    let mut random = Random::default();
    for part in [0.2, 0.5, 0.8] {
        let mut cut = CutEdges::new();
        for tet in &mesh.tets {
            for (i, j) in PAIRS {
                if random.draw() + 0.5 < part {
                    cut.insert(edge([tet[i], tet[j]]), 0.5 + 0.9 * random.draw());
                }
            }
        }
        cuts.push(cut);
    }
    let mut in_four = 0;
    for cut in cuts {
        in_four +=
            (0..mesh.tets.len() as u32).filter(|tet| splitter.groups(*tet, &cut) == [0, 1, 2, 3]).count();
        let split = splitter.split(&cut, &held, &Split::default());
        let surface = splitter.surface(&split, &cut);
        let (volume, open) = enclosed(&splitter, &split, &surface);
        assert!((volume / whole - 1.0).abs() < 1e-12 && open < 1e-14, "{volume} of {whole}, {open:e}");
        assert!(split.pieces.iter().all(|piece| piece.volume() > 0.0));
        let is_loose = |node: u32| split.loose.iter().any(|part| part.nodes.contains(&node));
        for piece in &split.pieces {
            let of = |node: u32| (node as usize).checked_sub(mesh.nodes.len());
            for (k, node) in piece.nodes.iter().enumerate() {
                let own = mesh.tets[piece.tet as usize][k];
                assert_eq!(of(*node).map_or(*node, |copy| split.copies[copy]), own);
                assert!(!piece.own[k] || *node == own || is_loose(*node));
            }
        }
    }
    assert!(in_four > 100, "{in_four} tetrahedra in four pieces");
}

/// Cuts that cross within the block, where some faces have three cut edges: the surface is closed, edge by edge, also where pieces
/// move apart.
#[test]
fn crossing_cuts_leave_no_holes() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let (low, high) = crate::base::extent::bounding_box(&mesh.nodes);
    let middle = (low + high) * 0.5;
    let held = holding(&mesh, &|x| x.x < low.x + 1e-9);
    let mut cut = CutEdges::new();
    for (n, d) in
        [(V3::new(1.0, 0.1, 0.3), 0.004), (V3::new(0.2, 1.0, 0.1), 0.003), (V3::new(0.1, 0.2, 1.0), 0.002)]
    {
        for (edge, share) in by_plane(&mesh, n, n.dot(&middle) + d, &|_| true) {
            cut.entry(edge).or_insert(share);
        }
    }
    let in_four =
        (0..mesh.tets.len() as u32).filter(|tet| splitter.groups(*tet, &cut) == [0, 1, 2, 3]).count();
    assert!(in_four > 0);
    let split = splitter.split(&cut, &held, &Split::default());
    let surface = splitter.surface(&split, &cut);
    // An edge that only one neighbour has cut: its point stays on the line between both ends.
    let on = |[a, b]: [u32; 2]| {
        let at = surface.points.iter().position(|point| point.nodes == edge([a, b]));
        at.map(|at| (mesh.nodes.len() + at) as u32)
    };
    let mut edges = std::collections::BTreeSet::new();
    for [a, b, c] in &surface.triangles {
        for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
            let way = match on([from, to]) {
                Some(point) => vec![[from, point], [point, to]],
                None => vec![[from, to]],
            };
            edges.extend(way);
        }
    }
    let single = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).count();
    println!("{} edges, {single} without the other side", edges.len());
    assert!(single == 0, "{single} of {}", edges.len());
}

/// A slit that ends inside: copies at its mouth, none at its end.
#[test]
fn a_slit_closes_at_its_end() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let (low, high) = crate::base::extent::bounding_box(&mesh.nodes);
    let n = Vector3::new(1.0, 0.0, 0.0);
    let deep = by_plane(&mesh, n, 0.5 * (low.x + high.x) + 0.004, &|x| x.y > high.y - 0.11);
    let held = holding(&mesh, &|x| x.y < low.y + 1e-9);
    let split = splitter.split(&deep, &held, &Split::default());
    assert!(split.loose.is_empty() && split.copies.len() > 4);
    // A row of cells below the slit's end keeps its nodes.
    let lowest = split.copies.iter().map(|node| mesh.nodes[*node as usize].y).fold(f64::MAX, f64::min);
    assert!(lowest > high.y - 0.11 - 1e-9, "{lowest}");
    let all_held = vec![Some(0); mesh.nodes.len()];
    assert!(splitter.split(&deep, &all_held, &Split::default()).copies.is_empty());
    // A cut beside what is held leaves nothing of the other side there.
    let beside = by_plane(&mesh, n, low.x + 0.02, &|_| true);
    let at_end = holding(&mesh, &|x| x.x < low.x + 1e-9);
    assert!(splitter.split(&beside, &at_end, &Split::default()).loose.len() == 1);
}

/// Two control elements that touch, and a cut between them: each holds its own side alone.
#[test]
fn what_touching_elements_hold_comes_apart() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let cut = by_plane(&mesh, V3::x(), 0.02, &|_| true);
    let held: Vec<Option<usize>> = mesh.nodes.iter().map(|x| Some(usize::from(x.x > 0.02))).collect();
    let split = splitter.split(&cut, &held, &Split::default());
    assert!(split.loose.is_empty() && !split.pieces.is_empty());
    for piece in &split.pieces {
        for (own, node) in piece.own.iter().zip(&piece.nodes) {
            assert_eq!(*own, (*node as usize) < mesh.nodes.len());
        }
    }
}

/// A tetrahedron beside one that is held: on a common face it is held too, on an edge or a node it could turn.
#[test]
fn a_part_on_an_edge_is_not_held() {
    let nodes =
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.], [2., 1., 1.], [1., 2., 2.]];
    let loose = |second: [u32; 4]| {
        let tets = vec![[0, 1, 2, 3], second];
        let mesh = TetMesh { nodes: nodes.map(V3::from).to_vec(), tets, ..TetMesh::default() };
        let held: Vec<Option<usize>> = (0..nodes.len()).map(|node| (node < 3).then_some(0)).collect();
        Splitter::new(Arc::new(mesh)).split(&CutEdges::new(), &held, &Split::default())
    };
    assert!(loose([1, 2, 3, 4]).loose.is_empty());
    for (second, copies) in [([2, 3, 4, 5], vec![2, 3]), ([3, 4, 5, 6], vec![3])] {
        let split = loose(second);
        let own: Vec<u32> =
            (4..7).filter(|node| second.contains(node)).chain(7..7 + copies.len() as u32).collect();
        assert_eq!(split.loose, [LoosePart { tets: Vec::new(), pieces: vec![0], nodes: own }]);
        assert_eq!(split.copies, copies);
        assert!(split.is_loose_at((1, 0)) && !split.is_loose_at((0, 0)));
        assert_eq!(split.loose[0].corners(&split), [0, 1, 2, 3].map(|k| (1, k)));
    }
}

/// Two planes that cross: the pieces within one of the first cut have its shares together, which without it they have not.
#[test]
fn pieces_share_out_what_an_earlier_one_had() {
    let mesh = a_block();
    let splitter = Splitter::new(mesh.clone());
    let held = vec![Some(0); mesh.nodes.len()];
    let mut cut = by_plane(&mesh, V3::new(1.0, 0.3, 0.2), 0.013, &|_| true);
    let first = splitter.split(&cut, &held, &Split::default());
    cut.extend(by_plane(&mesh, V3::new(-0.2, 1.0, 0.3), 0.007, &|_| true));
    let off = |earlier: &Split| {
        let split = splitter.split(&cut, &held, earlier);
        let mut most = 0.0_f64;
        for whole in &first.pieces {
            let own = &split.pieces[split.pieces_of(whole.tet).unwrap()];
            let within = own.iter().filter(|piece| (0..4).all(|k| whole.own[k] || !piece.own[k]));
            let mut left = whole.shares;
            within.for_each(|piece| (0..4).for_each(|k| left[k] -= piece.shares[k]));
            assert!(own.iter().all(|piece| piece.shares.iter().all(|share| *share > 0.0)));
            most = left.iter().fold(most, |most, left| most.max(left.abs()));
        }
        most
    };
    let [with, without] = [&first, &Split::default()].map(off);
    println!("off by {with:e}, without the first {without:e}");
    assert!(with < 1e-15 && without > 1e-3, "{with:e}, {without:e}");
}
