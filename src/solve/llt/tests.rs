use super::*;
use crate::base::progress::Silent;
use crate::fem::{Lame, Partition, TET4};
use crate::mesh::generate::{self, Block};
use crate::solve::solver::Solver;
use crate::solve::{SOLVERS, residuals};
use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::{DMatrix, Matrix3};
use std::sync::Mutex;

/// Numbers between -1 and 1, always the same.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    }

    fn below(&mut self, end: u32) -> u32 {
        ((self.next() * 0.5 + 0.5) * f64::from(end)) as u32 % end
    }

    fn fields(&mut self, nodes: usize, columns: usize) -> NodeFields {
        NodeFields { nodes, columns, data: (0..3 * nodes * columns).map(|_| self.next()).collect() }
    }
}

/// A matrix on this graph with random blocks and a dominant diagonal.
fn dominant(nodes: usize, mut edges: Vec<[u32; 2]>, random: &mut Random) -> StiffnessMatrix {
    edges.iter_mut().for_each(|edge| edge.sort_unstable());
    edges.retain(|edge| edge[0] != edge[1]);
    edges.sort_unstable();
    edges.dedup();
    let mut a = StiffnessMatrix::zeros(nodes, edges);
    a.diagonal.fill(Matrix3::identity() * 0.5);
    for (edge, block) in a.edges.iter().zip(&mut a.blocks) {
        *block = Matrix3::from_fn(|_, _| random.next());
        edge.iter().for_each(|&node| a.diagonal[node as usize] += Matrix3::identity() * 3.0);
    }
    a
}

/// Chains, stars, bodies in parts, a ring, a full graph, a random one, single nodes.
fn graphs() -> Vec<(&'static str, StiffnessMatrix)> {
    let mut random = Random(7);
    let mut made = Vec::new();
    let mut add = |name, nodes: u32, edges: Vec<[u32; 2]>| {
        made.push((name, dominant(nodes as usize, edges, &mut random)));
    };
    add("node", 1, vec![]);
    add("three nodes apart", 3, vec![]);
    add("pair and a node", 3, vec![[0, 2]]);
    add("chain", 60, (1..60).map(|i| [i - 1, i]).collect());
    add("star", 50, (0..50).map(|i| [17, i]).collect());
    add("two stars", 41, (0..41).map(|i| [3 + 20 * u32::from(i > 20), i]).collect());
    add("ring", 33, (0..33).map(|i| [i, (i + 1) % 33]).collect());
    add("full", 20, (0..20).flat_map(|i| (0..i).map(move |j| [j, i])).collect());
    let mut seed = Random(3);
    add("random", 90, (0..260).map(|_| [seed.below(90), seed.below(90)]).collect());
    add("random in parts", 120, (0..110).map(|_| [seed.below(120), seed.below(120)]).collect());
    made
}

fn dense(a: &StiffnessMatrix) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(3 * a.nodes(), 3 * a.nodes());
    for (node, block) in a.diagonal.iter().enumerate() {
        all.fixed_view_mut::<3, 3>(3 * node, 3 * node).copy_from(block);
    }
    for (&[i, j], block) in a.edges.iter().zip(&a.blocks) {
        all.fixed_view_mut::<3, 3>(3 * i as usize, 3 * j as usize).copy_from(block);
        all.fixed_view_mut::<3, 3>(3 * j as usize, 3 * i as usize).copy_from(&block.transpose());
    }
    all
}

/// A cube of n³ cells, held at one side, softer at the other.
fn cube(n: u32) -> StiffnessMatrix {
    let mesh = generate::block(&Block { size: [1.0; 3], cells: [n; 3] }).unwrap();
    let lame: Vec<Lame> = (0..mesh.tets.len())
        .map(|i| Lame::from_young_poisson(1e6 / (1.0 + i as f64 / 1000.0), 0.3))
        .collect();
    let held: Vec<u32> =
        (0..mesh.nodes.len() as u32).filter(|&i| mesh.nodes[i as usize].x < -0.5 + 1e-9).collect();
    Partition::new(mesh.nodes.len(), held).a(&TET4.assemble(&mesh, &lame).unwrap())
}

fn largest_difference(x: &NodeFields, y: &NodeFields) -> f64 {
    let size = y.data.iter().fold(0.0, |m: f64, y| m.max(y.abs()));
    x.data.iter().zip(&y.data).fold(0.0, |m: f64, (x, y)| m.max((x - y).abs())) / size
}

#[test]
fn odd_graphs_are_solved_as_by_a_dense_factor() {
    for (name, a) in graphs() {
        let analysis = Analysis::new(&a, &Silent).unwrap();
        for columns in [1, 2, 30] {
            let b = Random(5).fields(a.nodes(), columns);
            let all = DMatrix::from_row_slice(3 * a.nodes(), columns, &b.data);
            let exact = dense(&a).cholesky().unwrap().solve(&all);
            let exact = NodeFields { data: exact.transpose().as_slice().to_vec(), ..b.clone() };
            let double = Llt::<f64>::new(&a, &analysis, &Silent).unwrap().substitute(&b, &Silent).unwrap();
            let single = Llt::<f32>::new(&a, &analysis, &Silent).unwrap().substitute(&b, &Silent).unwrap();
            assert!(largest_difference(&double, &exact) < 1e-13, "{name}, {columns} columns");
            let error = largest_difference(&single, &exact);
            assert!(error < 1e-5 && error > 1e-9 || a.nodes() == 1, "{name}, {columns} columns: {error}");
        }
    }
}

#[test]
fn a_body_is_solved_as_by_faer() {
    let a = cube(6);
    let n = 3 * a.nodes();
    let all = dense(&a);
    let triplets: Vec<_> = (0..n)
        .flat_map(|j| (j..n).map(move |i| (i, j)))
        .filter(|&(i, j)| all[(i, j)] != 0.0)
        .map(|(i, j)| Triplet::new(i, j, all[(i, j)]))
        .collect();
    let theirs =
        SparseColMat::try_new_from_triplets(n, n, &triplets).unwrap().sp_cholesky(Side::Lower).unwrap();
    let b = Random(1).fields(a.nodes(), 3);
    let x = theirs.solve(faer::Mat::from_fn(n, 3, |i, j| b.row(i)[j]));
    let x =
        NodeFields { data: (0..n).flat_map(|i| (0..3).map(move |j| (i, j))).map(|at| x[at]).collect(), ..b };
    let analysis = Analysis::new(&a, &Silent).unwrap();
    let ours = Llt::<f64>::new(&a, &analysis, &Silent).unwrap().substitute(&b, &Silent).unwrap();
    assert!(largest_difference(&ours, &x) < 1e-11);
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let a = cube(13);
    // One block, which is solved in branches of the tree, and several.
    let all = [4, 24, 50].map(|columns| Random(2).fields(a.nodes(), columns));
    let solve = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let analysis = Analysis::new(&a, &Silent).unwrap();
            let plan = analysis.fronts.plan(threads);
            assert!((threads == 1) == plan.top.is_empty() && plan.subtrees.len() >= threads);
            let llt = Llt::<f64>::new(&a, &analysis, &Silent).unwrap();
            assert!(analysis.branches.len() > 1);
            (all.each_ref().map(|b| llt.substitute(b, &Silent).unwrap()), llt.values)
        })
    };
    let alone = solve(1);
    for threads in [2, 3, 7] {
        assert!(solve(threads) == alone, "{threads} threads");
    }
}

#[test]
fn what_is_planned_covers_every_front_once() {
    let a = cube(8);
    let fronts = Analysis::new(&a, &Silent).unwrap().fronts;
    for threads in 1..9 {
        let plan = fronts.plan(threads);
        let mut covered: Vec<usize> = plan.top.iter().map(|&s| s as usize).collect();
        plan.subtrees.iter().for_each(|&s| covered.extend(fronts.subtree(s as usize)));
        covered.sort_unstable();
        assert_eq!(covered, (0..fronts.count()).collect::<Vec<_>>());
    }
}

/// The pattern has every number that elimination makes, and each row only once.
#[test]
fn fronts_hold_the_fill() {
    for (name, a) in graphs() {
        let fronts = Analysis::new(&a, &Silent).unwrap().fronts;
        let n = a.nodes();
        let mut full = vec![vec![false; n]; n];
        for &[i, j] in &a.edges {
            let (p, q) = (fronts.inverse[i as usize] as usize, fronts.inverse[j as usize] as usize);
            full[p.max(q)][p.min(q)] = true;
        }
        for k in 0..n {
            let below: Vec<usize> = (k + 1..n).filter(|&i| full[i][k]).collect();
            for (i, &p) in below.iter().enumerate() {
                below[..i].iter().for_each(|&q| full[p][q] = true);
            }
            let s = fronts.of_node(k);
            assert!(fronts.below(s).is_sorted_by(|a, b| a < b) && fronts.own(s).contains(&k));
            let has = |row: usize| fronts.own(s).contains(&row) || fronts.below(s).contains(&(row as u32));
            assert!(below.iter().all(|&row| has(row)), "{name}: column {k}");
        }
    }
}

#[test]
fn solves_between_few_nodes_are_the_full_ones() {
    for (name, a) in graphs().into_iter().chain([("cube", cube(5))]) {
        let analysis = Analysis::new(&a, &Silent).unwrap();
        let llt = Llt::<f64>::new(&a, &analysis, &Silent).unwrap();
        let last = a.nodes() as u32 - 1;
        let (loaded, asked) = (if last > 3 { vec![last, 1] } else { vec![0] }, vec![last, last / 2]);
        let few = Random(9).fields(loaded.len(), 4);
        let mut b = NodeFields::zeros(a.nodes(), 4);
        for (i, &node) in loaded.iter().enumerate() {
            b.data[12 * node as usize..][..12].copy_from_slice(&few.data[12 * i..][..12]);
        }
        let full = llt.substitute(&b, &Silent).unwrap().at(&asked);
        assert_eq!(llt.between(&loaded, &few, &asked, &Silent).unwrap(), full, "{name}");
    }
}

#[test]
fn the_inverse_over_some_nodes_is_that_of_the_whole() {
    for (name, a) in graphs().into_iter().chain([("cube", cube(5))]) {
        let exact = dense(&a).cholesky().unwrap().inverse();
        let mut nodes: Vec<u32> = (0..a.nodes() as u32).filter(|i| i % 3 != 1).collect();
        let half = nodes.len() / 2;
        nodes.rotate_left(half);
        let largest = exact.amax();
        for solver in SOLVERS.iter().filter(|method| method.name == "cholesky" || a.nodes() < 100) {
            let solver = Solver { method: solver, ..Solver::default() };
            let analysed = solver.analyse(&a, &Silent).unwrap();
            let mut seen = vec![false; nodes.len() * nodes.len()];
            let mut take = |strip: &InverseStrip<'_>| {
                let size = 3 * strip.rows.len();
                for (j, &column) in strip.columns.iter().enumerate() {
                    for (i, &row) in strip.rows.iter().enumerate() {
                        seen[row as usize * nodes.len() + column as usize] = true;
                        seen[column as usize * nodes.len() + row as usize] = true;
                        let (p, q) = (nodes[row as usize] as usize, nodes[column as usize] as usize);
                        for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                            let value = strip.values[(3 * j + c) * size + 3 * i + r];
                            let error = (value - exact[(3 * p + r, 3 * q + c)]).abs() / largest;
                            assert!(error < 1e-8, "{name}, {solver}: {error} at {p}, {q}");
                        }
                    }
                }
            };
            analysed.factor(&a, &Silent).unwrap().inverse_block(&nodes, &mut take, &Silent).unwrap();
            assert!(seen.iter().all(|seen| *seen), "{name}, {solver}");
        }
    }
}

#[test]
fn the_pivot_that_is_not_positive_is_named() {
    for bad in [-1.0, f64::NAN] {
        let mut a = cube(5);
        a.diagonal[70] = Matrix3::identity() * bad;
        let analysis = Analysis::new(&a, &Silent).unwrap();
        let Err(SolveError::NotPositiveDefinite { unknowns, pivot }) =
            Llt::<f64>::new(&a, &analysis, &Silent)
        else {
            panic!("{bad} was factorized");
        };
        // NaN may be met in a later row of the same front.
        assert!(unknowns == 3 * a.nodes() && (pivot == 210 || bad.is_nan()), "{pivot} of {unknowns}");
    }
}

/// Takes the sentences.
#[derive(Default)]
struct Told(Mutex<Vec<String>>);

impl Progress for Told {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self) {}
    fn tell(&self, sentence: &str) {
        self.0.lock().unwrap().push(sentence.to_owned());
    }
}

#[test]
fn a_factor_in_f32_with_conjugate_gradients_is_as_exact_as_one_in_f64() {
    let a = cube(6);
    let b = Random(4).fields(a.nodes(), 5);
    let by = |name: &str, a: &StiffnessMatrix, told: &Told| {
        let analysed = name.parse::<Solver>().unwrap().analyse(a, told).unwrap();
        analysed.factor(a, told).unwrap().solve_and_judge(&b, told).unwrap()
    };
    let told = Told::default();
    let (x, stats) = by("mixed", &a, &told);
    let (exact, double) = by("cholesky", &a, &told);
    assert!(told.0.lock().unwrap().is_empty());
    assert!(stats.method.name == "mixed" && (1..=6).contains(&stats.iterations), "{}", stats.iterations);
    assert!(stats.worst_residual() < 1e-12 && residuals(&a, &x, &b).0 == stats.residuals);
    assert!(largest_difference(&x, &exact) < 1e-11);
    let (one, other) = (stats.conditioning.unwrap(), double.conditioning.unwrap());
    let ratio = one.scaled_condition.unwrap() / other.scaled_condition.unwrap();
    assert!(
        (ratio - 1.0).abs() < 0.01 && one.forward_error < 10.0 * other.forward_error,
        "{one:?} {other:?}"
    );
}

#[test]
fn what_f32_cannot_factorize_is_told_and_solved_in_f64() {
    // Chains of ten nodes, with springs that are no binary fractions, each held by a spring of 1e-10 of theirs.
    let chains = 8;
    let nodes = 10 * chains;
    let edges = (1..nodes as u32).filter(|i| i % 10 != 0).map(|i| [i - 1, i]).collect();
    let mut a = StiffnessMatrix::zeros(nodes, edges);
    (0..chains).for_each(|chain| a.diagonal[10 * chain] += Matrix3::identity() * 1e-10);
    for (e, &[i, j]) in a.edges.iter().enumerate() {
        let spring = Matrix3::identity() / (3.0 + e as f64);
        a.blocks[e] = -spring;
        [i, j].iter().for_each(|&node| a.diagonal[node as usize] += spring);
    }
    let b = Random(4).fields(nodes, 2);
    let told = Told::default();
    let solver = "mixed".parse::<Solver>().unwrap().analyse(&a, &told).unwrap();
    let (x, stats) = solver.factor(&a, &told).unwrap().solve_and_judge(&b, &told).unwrap();
    let all = DMatrix::from_row_slice(3 * nodes, 2, &b.data);
    let exact = dense(&a).cholesky().unwrap().solve(&all);
    let exact = NodeFields { data: exact.transpose().as_slice().to_vec(), ..b.clone() };
    assert!(largest_difference(&x, &exact) < 1e-5, "{}", largest_difference(&x, &exact));
    let told = told.0.into_inner().unwrap();
    assert!(told.len() == 1 && told[0].contains("f64") && stats.method.name == "cholesky", "{told:?}");
}

/// The needle was iterated with in vain, 5.5 times as long as a factor in f64 takes.
#[test]
fn no_factor_in_f32_is_begun_of_a_needle() {
    struct Begun(Mutex<Vec<String>>);
    impl Progress for Begun {
        fn begin(&self, what: &str, _: u64) {
            self.0.lock().unwrap().push(what.to_owned());
        }
        fn advance(&self, _: u64) {}
        fn end(&self) {}
    }
    let mesh = generate::block(&Block { size: [1.0, 0.002, 0.002], cells: [300, 2, 2] }).unwrap();
    let k = TET4.assemble(&mesh, &vec![Lame::from_young_poisson(1.0, 0.3); mesh.tets.len()]).unwrap();
    let a = Partition::new(mesh.nodes.len(), mesh.groups["xmin"].iter().copied()).a(&k);
    let begun = Begun(Mutex::default());
    let solver = "mixed".parse::<Solver>().unwrap().analyse(&a, &begun).unwrap();
    let (_, stats) =
        solver.factor(&a, &begun).unwrap().solve(&Random(4).fields(a.nodes(), 1), &begun).unwrap();
    assert_eq!(stats.method.name, "cholesky");
    let begun = begun.0.into_inner().unwrap();
    assert_eq!(begun.iter().filter(|what| *what == "factorization").count(), 1, "{begun:?}");
}
