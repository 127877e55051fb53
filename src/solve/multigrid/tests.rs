use super::*;
use crate::base::progress::Silent;
use crate::fem::{Element, Lame, NodeFields, Partition, TET4, TET4_ANP, TET10};
use crate::mesh::{Block, TetMesh, block, quadratic};
use crate::solve::{SolveStats, Solver, find_method};
use std::array::from_fn;

fn bar(size: [f64; 3], cells: [u32; 3]) -> TetMesh {
    block(&Block { size, cells }).unwrap()
}

fn uniform(mesh: &TetMesh, poisson: f64) -> Vec<Lame> {
    vec![Lame::from_young_poisson(1e6, poisson); mesh.tets.len()]
}

/// The mean of a tetrahedron's corners.
fn centre(mesh: &TetMesh, tet: usize) -> [f64; 3] {
    from_fn(|axis| mesh.corners(tet).iter().map(|corner| corner[axis]).sum::<f64>() / 4.0)
}

/// A of a body held at both ends in x, and the right-hand sides of shifting one of them.
fn system(element: &Element, mesh: &TetMesh, lame: &[Lame]) -> (StiffnessMatrix, NodeFields) {
    let k = element.assemble(mesh, lame).unwrap();
    let ends = ["xmin", "xmax"].map(|name| mesh.groups[name].clone());
    let mut shift = NodeFields::zeros(mesh.nodes.len(), 3);
    for &node in &ends[1] {
        (0..3).for_each(|axis| shift.row_mut(3 * node as usize + axis)[axis] = 1.0);
    }
    let partition = Partition::new(mesh.nodes.len(), ends.into_iter().flatten());
    (partition.a(&k), partition.minus_b_times(&k, &shift))
}

fn solve(method: &str, a: &StiffnessMatrix, b: &NodeFields) -> (NodeFields, SolveStats) {
    let solver = Solver { method: find_method(method).unwrap(), tolerance: 1e-10, ..Solver::default() };
    let linear = solver.analyse(a, &Silent).unwrap();
    linear.factor(a, &Silent).unwrap().solve_and_judge(b, &Silent).unwrap()
}

/// Number of iterations, after a look at the solution: it is Cholesky's, and its error at most the reported one.
fn iterations(name: &str, element: &Element, mesh: &TetMesh, lame: &[Lame]) -> usize {
    let (a, b) = system(element, mesh, lame);
    let (x, stats) = solve("pcg", &a, &b);
    let (exact, _) = solve("cholesky", &a, &b);
    let told = stats.conditioning.unwrap().forward_error;
    let largest = exact.data.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    let worst =
        x.data.iter().zip(&exact.data).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())) / largest;
    println!("{name}: {} iterations, error {worst:.1e}, told {told:.1e}", stats.iterations);
    assert!(worst < 1e-8 && told < 1e-7, "{name}: {worst:e}, {told:e}");
    stats.iterations
}

#[test]
fn iterations_are_few_for_thick_thin_and_long_bodies() {
    let mut counts = Vec::new();
    for (name, size, cells) in [
        ("box", [1.0; 3], [5; 3]),
        ("finer box", [1.0; 3], [10; 3]),
        ("plate", [1.0, 1.0, 0.04], [24, 24, 1]),
        ("rod", [20.0, 1.0, 1.0], [60, 3, 3]),
    ] {
        let mesh = bar(size, cells);
        counts.push(iterations(name, &TET4, &mesh, &uniform(&mesh, 0.3)));
    }
    assert!(counts[..2].iter().all(|count| *count <= 20), "{counts:?}");
    assert!(counts.iter().all(|count| *count < 50), "{counts:?}");
}

/// A block of elements ten times as wide as thick; and a sheet of 1 : 200 with elements twelve times as wide, whose clusters f32
/// cannot hold: 75, and 64 where all nodes are smoothed one by one.
#[test]
fn flat_elements_cost_few_iterations() {
    for (name, size, cells, most) in
        [("flat", [1.0, 1.0, 0.1], [11; 3], 49), ("sheet", [1.0, 1.0, 0.005], [32, 32, 2], 80)]
    {
        let mesh = bar(size, cells);
        let count = iterations(name, &TET4, &mesh, &uniform(&mesh, 0.3));
        assert!(count <= most, "{name}: {count}");
    }
}

/// Fibres a million times as stiff as what is between them, some of whose elements hang on an edge or a corner.
#[test]
fn stiff_fibres_cost_few_iterations() {
    let mesh = bar([1.0; 3], [11; 3]);
    let is_even = |x: f64| ((6.0 * x) as usize).is_multiple_of(2);
    let young = |tet: usize| {
        let [_, y, z] = centre(&mesh, tet);
        if is_even(y) && is_even(z) { 1e11 } else { 1e5 }
    };
    let lame: Vec<Lame> = (0..mesh.tets.len()).map(|tet| Lame::from_young_poisson(young(tet), 0.3)).collect();
    assert!(iterations("fibres", &TET4, &mesh, &lame) <= 25);
}

/// Every line through a thin sheet is a cluster, and no two nodes of a cube are.
#[test]
fn lines_through_a_sheet_are_clusters() {
    let of = |size: [f64; 3], cells: [u32; 3]| {
        let mesh = bar(size, cells);
        let (a, _) = system(&TET4, &mesh, &uniform(&mesh, 0.3));
        let rows = Scaled::new(&a);
        let (clusters, mut order) = Clusters::new(&rows, &rows.inverses().unwrap());
        let places: Vec<Vec<[f64; 3]>> = (0..clusters.count())
            .map(|cluster| {
                order[clusters.members(cluster)].iter().map(|&node| a.places[node as usize]).collect()
            })
            .collect();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(at, &node)| at == node as usize));
        places
    };
    assert!(of([1.0; 3], [6; 3]).iter().all(|cluster| cluster.len() == 1));
    let lines = of([1.0, 1.0, 0.01], [20, 20, 2]);
    assert_eq!(lines.len(), 19 * 21);
    for line in lines {
        assert!(line.len() == 3 && line.iter().all(|place| place[..2] == line[0][..2]), "{line:?}");
    }
}

/// Cubes of 2.5 × 2.5 × 2.5 cells, a million times as stiff as those between.
#[test]
fn jumps_of_a_million_cost_few_iterations() {
    let mesh = bar([1.0; 3], [10; 3]);
    let young = |tet: usize| {
        let cube: usize = centre(&mesh, tet).iter().map(|x| (4.0 * x) as usize).sum();
        if cube.is_multiple_of(2) { 1e11 } else { 1e5 }
    };
    let lame: Vec<Lame> = (0..mesh.tets.len()).map(|tet| Lame::from_young_poisson(young(tet), 0.3)).collect();
    assert!(iterations("jump", &TET4, &mesh, &lame) < 50);
}

#[test]
fn other_elements_and_near_incompressible_bodies_converge() {
    let linear = bar([1.0; 3], [4; 3]);
    let curved = quadratic(linear.clone(), &quadratic::straight);
    assert!(iterations("tet10", &TET10, &curved, &uniform(&curved, 0.3)) < 50);
    assert!(iterations("tet4_anp 0.49", &TET4_ANP, &linear, &uniform(&linear, 0.49)) < 100);
    assert!(iterations("tet4_anp 0.499", &TET4_ANP, &linear, &uniform(&linear, 0.499)) < 250);
}

/// A rigid motion of a free body at the nodes is P times that at the aggregates, and costs no energy there; the coarse matrix is
/// symmetric and has the energy of the fine one.
#[test]
fn rigid_motions_are_motions_of_the_aggregates() {
    let mesh = bar([2.0, 1.0, 0.7], [8, 5, 4]);
    let mut k = TET4.assemble(&mesh, &uniform(&mesh, 0.3)).unwrap();
    // Far from the origin, as meshes come.
    k.places.iter_mut().for_each(|place| place[1] += 30.0);
    let rows = Scaled::new(&k);
    let clusters = Clusters::alone(k.nodes());
    let largest = Smoothed::new(&rows, &clusters).unwrap().largest_eigenvalue();
    let aggregates = Aggregates::new(&rows, &clusters, THRESHOLD);
    let (p, modes) = Prolongator::new(&rows, &clusters, &aggregates, &fine_modes(&k, &rows.order), largest);
    let coarse = galerkin::coarse(&rows, &p);
    println!("{} nodes, {} aggregates", k.nodes(), aggregates.count);
    assert!(aggregates.count * 6 < k.nodes() && !aggregates.of_node.contains(&cluster::ALONE));

    let turned = |w: [f64; 3], x: [f64; 3]| -> [f64; 3] {
        from_fn(|i| w[(i + 1) % 3] * x[(i + 2) % 3] - w[(i + 2) % 3] * x[(i + 1) % 3])
    };
    let (shift, turn) = ([0.3, -1.0, 0.5], [0.2, 0.7, -0.4]);
    let motion: Vec<[f64; 6]> = modes
        .place
        .iter()
        .zip(&modes.modes)
        .map(|(place, r)| {
            let by_turn = turned(turn, *place);
            let about: [f64; 6] = from_fn(|i| if i < 3 { shift[i] + by_turn[i] } else { turn[i - 3] });
            from_fn(|row| (0..6).map(|c| r[row][c] * about[c]).sum())
        })
        .collect();
    let size = 30.0;
    for node in 0..k.nodes() {
        let mut u = [0.0; 3];
        for at in p.start[node]..p.start[node + 1] {
            let (block, from) = (p.block(at), &motion[p.column[at] as usize]);
            (0..3).for_each(|r| u[r] += (0..6).map(|c| block[r][c] * from[c]).sum::<f64>());
        }
        let by_turn = turned(turn, k.places[node]);
        for axis in 0..3 {
            assert!((u[axis] - shift[axis] - by_turn[axis]).abs() < 1e-6 * size, "{node}: {u:?}");
        }
    }

    let norm = |block: &[[f64; 6]; 6]| block.iter().flatten().fold(0.0, |most: f64, v| most.max(v.abs()));
    let largest = coarse.diagonal.iter().map(norm).fold(0.0, f64::max);
    for i in 0..coarse.nodes() {
        let mut force = [0.0; 6];
        let mut add = |j: usize, block: &[[f64; 6]; 6]| {
            (0..6).for_each(|r| force[r] += (0..6).map(|c| block[r][c] * motion[j][c]).sum::<f64>());
        };
        add(i, &coarse.diagonal(i));
        coarse.each(i, &mut add);
        assert!(force.iter().all(|f| f.abs() < 1e-6 * size * largest), "{force:?}");
        coarse.each(i, |j, block| {
            coarse.each(j, |back, transposed| {
                for (r, c) in (0..36).map(|at| (at / 6, at % 6)).filter(|_| back == i) {
                    assert!((block[r][c] - transposed[c][r]).abs() < 1e-12 * largest);
                }
            });
        });
    }
}

/// A level without rigid motions, because the places of the nodes are unknown, and one of a single node.
#[test]
fn matrices_without_places_and_of_one_node_are_solved() {
    let mesh = bar([1.0; 3], [6; 3]);
    let (mut a, b) = system(&TET4, &mesh, &uniform(&mesh, 0.3));
    a.places.clear();
    let (_, stats) = solve("pcg", &a, &b);
    println!("without places: {} iterations", stats.iterations);
    assert!(stats.iterations < 60 && stats.worst_residual() <= 1e-10);
    let one = a.restrict(&[7]);
    let (x, _) = solve("pcg", &one, &NodeFields { nodes: 1, columns: 1, data: vec![1.0, 2.0, 3.0] });
    let force = one.diagonal[0] * nalgebra::Vector3::from_column_slice(&x.data);
    assert!((force - nalgebra::Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-9);
}

/// A column has the same bits beside any others, on any number of threads.
#[test]
fn bits_depend_on_nothing_but_the_column() {
    let mesh = bar([1.0; 3], [6, 5, 4]);
    let (a, b) = system(&TET4, &mesh, &uniform(&mesh, 0.3));
    let with = |threads: usize, b: &NodeFields| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve("pcg", &a, b).0)
    };
    let all = with(1, &b);
    assert!(all == with(3, &b));
    let second =
        NodeFields { nodes: b.nodes, columns: 1, data: b.data.iter().skip(1).step_by(3).copied().collect() };
    let alone = with(2, &second);
    assert!(alone.data.iter().zip(all.data.iter().skip(1).step_by(3)).all(|(a, b)| a == b));
}

/// Stiff layers that float between soft ones: no iteration lowers the residual to the tolerance, and rounding moves them by
/// nothing.
#[test]
fn a_residual_that_rounding_leaves_is_no_refusal() {
    let mesh = bar([1.0; 3], [8, 4, 4]);
    let layer = |tet: usize| (8.0 * centre(&mesh, tet)[0]) as usize;
    let young = |tet: usize| if layer(tet).is_multiple_of(2) { 1e12 } else { 1e5 };
    let lame: Vec<Lame> = (0..mesh.tets.len()).map(|tet| Lame::from_young_poisson(young(tet), 0.3)).collect();
    let (a, b) = system(&TET4, &mesh, &lame);
    let (x, stats) = solve("pcg", &a, &b);
    let (exact, _) = solve("cholesky", &a, &b);
    let worst = x.data.iter().zip(&exact.data).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
    println!("layers: residual {:.1e}, error {worst:.1e}", stats.worst_residual());
    assert!(stats.worst_residual() > 1e-10 && worst < 1e-4, "{:e}, {worst:e}", stats.worst_residual());
}
