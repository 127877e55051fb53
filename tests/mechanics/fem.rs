//! The finite element method against closed forms: patch test, rigid motions, symmetry, published matrices.

use crate::common::{self, block_scene, shared};
use greenstage::fem::{Lame, NodeFields, Partition, StiffnessMatrix, TET4, TET4_ANP, TET10, tet4};
use greenstage::green::{self, AFFINE, Requirements};
use greenstage::mesh::{self, TetMesh, generate};
use greenstage::solve::{Silent, Solver};
use nalgebra::{Matrix3, Vector3};

/// A block whose inner nodes are moved at random, so that nothing holds by symmetry.
fn crooked_block(cells: [u32; 3]) -> TetMesh {
    let block = generate::Block { size: [1.0, 0.8, 1.2], cells };
    let mut mesh = generate::block(&block).unwrap();
    let half = Vector3::from(block.size) * 0.5;
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
    };
    for node in &mut mesh.nodes {
        let inside = (0..3).all(|axis| node[axis].abs() < half[axis] * (1.0 - 1e-9));
        let shift = Vector3::new(random(), random(), random()) * 0.05;
        if inside {
            *node += shift;
        }
    }
    mesh
}

fn uniform(mesh: &TetMesh) -> Vec<Lame> {
    vec![Lame::from_young_poisson(1e3, 0.3); mesh.tets.len()]
}

fn field(mesh: &TetMesh, displacement: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> NodeFields {
    let data = mesh.nodes.iter().flat_map(|x| <[f64; 3]>::from(displacement(x))).collect();
    NodeFields { nodes: mesh.nodes.len(), columns: 1, data }
}

/// Every element on a crooked mesh; the quadratic one with crooked edges too.
fn elements(cells: [u32; 3]) -> Vec<(&'static str, TetMesh, StiffnessMatrix)> {
    let linear = crooked_block(cells);
    let mut curved = mesh::quadratic(linear.clone(), &mesh::quadratic::straight);
    let corners = linear.nodes.len();
    let is_outside: Vec<bool> = curved.nodes.iter().map(is_on_boundary).collect();
    for (node, x) in curved.nodes.iter_mut().enumerate().skip(corners).filter(|(node, _)| !is_outside[*node])
    {
        let turn = node as f64;
        *x += Vector3::new(turn.sin(), (2.0 * turn).cos(), (3.0 * turn).sin()) * 0.004;
    }
    let lame = uniform(&linear);
    let k = [
        TET4.assemble(&linear, &lame).unwrap(),
        TET4_ANP.assemble(&linear, &lame).unwrap(),
        TET10.assemble(&curved, &lame).unwrap(),
    ];
    let meshes = [linear.clone(), linear, curved];
    let named = ["tet4", "tet4_anp", "tet10"].into_iter().zip(meshes);
    named.zip(k).map(|((name, mesh), k)| (name, mesh, k)).collect()
}

fn is_on_boundary(x: &Vector3<f64>) -> bool {
    [0.5, 0.4, 0.6].iter().zip(x.iter()).any(|(half, x)| x.abs() > half * (1.0 - 1e-9))
}

#[test]
fn rigid_motions_cost_no_force() {
    for (name, mesh, k) in elements([4, 3, 5]) {
        let scale: f64 = k.diagonal.iter().map(|block| block.norm()).fold(0.0, f64::max);
        for mode in 0..6 {
            let axis = Vector3::ith(mode % 3, 1.0);
            let rigid = field(&mesh, |x| if mode < 3 { axis } else { axis.cross(x) });
            let mut force = NodeFields::zeros(mesh.nodes.len(), 1);
            k.multiply(&rigid, &mut force);
            let relative = force.norms()[0] / (scale * rigid.norms()[0]);
            assert!(relative < 1e-13, "{name}, mode {mode}: {relative:e}");
        }
    }
}

/// A free body has six rigid motions, and no other motion without force: what the average nodal pressure gives up in
/// constraints it must not give up in stiffness.
#[test]
fn there_are_only_six_motions_without_force() {
    for (name, mesh, k) in elements([2, 2, 2]) {
        let n = 3 * mesh.nodes.len();
        let mut identity = NodeFields::zeros(mesh.nodes.len(), n);
        (0..n).for_each(|i| identity.row_mut(i)[i] = 1.0);
        let mut dense = NodeFields::zeros(mesh.nodes.len(), n);
        k.multiply(&identity, &mut dense);
        let mut values: Vec<f64> = nalgebra::DMatrix::from_row_slice(n, n, &dense.data)
            .symmetric_eigenvalues()
            .iter()
            .copied()
            .collect();
        values.sort_by(f64::total_cmp);
        assert!(values[..6].iter().all(|v| v.abs() < 1e-12 * values[n - 1]), "{name}: {:?}", &values[..6]);
        assert!(values[6] > 1e-4 * values[n - 1], "{name}: {:e} of {:e}", values[6], values[n - 1]);
    }
}

#[test]
fn assembly_has_the_same_bits_on_every_thread_count() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| elements([6, 5, 4])).into_iter().map(|(.., k)| k).collect::<Vec<_>>()
    };
    let one = with(1);
    assert!(one == with(2) && one == with(5));
}

#[test]
fn matrix_is_symmetric_and_positive_on_deformations() {
    for (name, mesh, k) in elements([3, 3, 3]) {
        for block in &k.diagonal {
            assert!((block - block.transpose()).amax() <= 1e-14 * block.amax(), "{name}");
        }
        let (a, b) = (
            field(&mesh, |x| Vector3::new(x.y.sin(), x.x * x.z, 3.0 * x.x.cos())),
            field(&mesh, |x| Vector3::new(x.z * x.z, x.x.exp(), x.y - x.x)),
        );
        let product = |x: &NodeFields| {
            let mut y = NodeFields::zeros(x.nodes, 1);
            k.multiply(x, &mut y);
            y
        };
        let (ab, ba) = (a.dots(&product(&b))[0], b.dots(&product(&a))[0]);
        assert!((ab - ba).abs() <= 1e-13 * ab.abs(), "{name}: {ab} {ba}");
        assert!(a.dots(&product(&a))[0] > 0.0, "{name}");
    }
}

/// Irons' patch test of every element: affine displacements of the whole boundary are continued exactly inside.
#[test]
fn patch_test_of_every_element() {
    let h = Matrix3::new(0.01, -0.02, 0.005, 0.03, 0.004, -0.01, 0.002, 0.015, -0.02);
    for (name, mesh, k) in elements([4, 4, 4]) {
        let boundary =
            (0..mesh.nodes.len() as u32).filter(|&node| is_on_boundary(&mesh.nodes[node as usize]));
        let partition = Partition::new(mesh.nodes.len(), boundary);
        let exact = field(&mesh, |x| h * x);
        let mut u = exact.clone();
        for &node in &partition.free {
            u.data[3 * node as usize..][..3].fill(0.0);
        }
        let (a, rhs) = (partition.a(&k), partition.minus_b_times(&k, &u));
        let solver = Solver::default().analyse(&a, &Silent).unwrap();
        let (free, _) = solver.factor(&a, &Silent).unwrap().solve(&rhs, &Silent).unwrap();
        partition.insert_free(&free, &mut u);
        let worst = u.data.iter().zip(&exact.data).map(|(u, x)| (u - x).abs()).fold(0.0, f64::max);
        assert!(!partition.free.is_empty() && worst < 1e-12 * 0.03, "{name}: {worst:e}");
    }
}

/// Irons' patch test through the whole offline line: affine displacements of the whole boundary, here of two
/// control elements that together hold it, must be continued exactly by the inner nodes.
#[test]
fn patch_test_inner_nodes_follow_an_affine_boundary() {
    let h = Matrix3::new(0.01, -0.02, 0.005, 0.03, 0.004, -0.01, 0.002, 0.015, -0.02);
    let mesh = crooked_block([4, 4, 4]);
    let folder = common::folder("patch");
    greenstage::mesh::save(&folder.join("patch.msh"), &mesh, Some("msh41-binary")).unwrap();
    let half = [0.5, 0.4, 0.6];
    let is_outside = |x: &Vector3<f64>| (0..3).any(|axis| x[axis].abs() > half[axis] * (1.0 - 1e-9));
    let tags = |low: bool| {
        let chosen = mesh.nodes.iter().zip(&mesh.tags).filter(|(x, _)| is_outside(x) && (x.x < 0.1) == low);
        chosen.map(|(_, tag)| format!("{tag}\n")).collect::<String>()
    };
    std::fs::write(folder.join("low.txt"), tags(true)).unwrap();
    std::fs::write(folder.join("high.txt"), tags(false)).unwrap();
    let text = r#"
[body.patch]
mesh = "patch.msh"
material = { young = 1.0e3, poisson = 0.3 }
[body.patch.control.low]
nodes = { file = "low.txt" }
grab = "fixed"
[body.patch.control.high]
nodes = { file = "high.txt" }
grab = "fixed"
"#;
    let scene = greenstage::scene::Scene::parse(text, &folder.join("scene.toml")).unwrap();
    let solution = green::solve(&scene, "patch", &Requirements::new(&[AFFINE]), &Silent).unwrap();
    let c: Vec<f64> = solution
        .controls
        .iter()
        .flat_map(|control| {
            let t = h * control.origin;
            [t.x, t.y, t.z].into_iter().chain(h.transpose().iter().copied().collect::<Vec<_>>())
        })
        .collect();
    let mut worst = 0.0f64;
    for (node, x) in solution.mesh.nodes.iter().enumerate() {
        for axis in 0..3 {
            let u: f64 = solution.fields.row(3 * node + axis).iter().zip(&c).map(|(u, c)| u * c).sum();
            worst = worst.max((u - (h * x)[axis]).abs());
        }
    }
    assert!(worst < 1e-12 * 0.03, "{worst:e}");
}

/// The patch with every solver: PCG is the check on Cholesky.
#[test]
fn pcg_and_cholesky_agree() {
    let cholesky =
        green::solve(&block_scene([5, 4, 4], ""), "block", &Requirements::new(&[AFFINE]), &Silent).unwrap();
    let scene = block_scene([5, 4, 4], "solver = { method = \"pcg\", tolerance = 1e-12 }");
    let pcg = green::solve(&scene, "block", &Requirements::new(&[AFFINE]), &Silent).unwrap();
    assert!(pcg.stats.iterations > 2 && cholesky.stats.iterations == 0);
    assert!(pcg.stats.worst_residual() <= 1e-12 && cholesky.stats.worst_residual() <= 1e-12);
    let worst =
        cholesky.fields.data.iter().zip(&pcg.fields.data).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-10, "{worst:e}");
}

#[test]
fn solutions_have_the_same_bits_on_every_thread_count() {
    for solver in ["", "solver = { method = \"pcg\", tolerance = 1e-8 }"] {
        let scene = block_scene([4, 4, 3], solver);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                green::solve(&scene, "block", &Requirements::new(&[AFFINE]), &Silent).unwrap().fields
            })
        };
        assert!(with(1) == with(2), "{solver}");
    }
}

/// The 12×12 matrices of two tetrahedra as NumPy and scikit-fem compute them.
#[test]
fn element_matrices_match_the_independent_ones() {
    let Some(folder) = shared("cases/unit_tet") else { return };
    let general = [[0.1, -0.2, 0.3], [1.2, 0.1, -0.1], [0.2, 0.9, 0.2], [-0.1, 0.3, 1.4]];
    let unit = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for (file, nodes, young, poisson) in
        [("K_E1_nu025.csv", unit, 1.0, 0.25), ("K_general_E2.5_nu037.csv", general, 2.5, 0.37)]
    {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        let expected: Vec<f64> = text
            .split([',', '\n'])
            .filter(|word| !word.trim().is_empty())
            .map(|w| w.trim().parse().unwrap())
            .collect();
        assert_eq!(expected.len(), 144);
        let element = tet4::geometry(nodes.map(Vector3::from)).unwrap();
        let lame = Lame::from_young_poisson(young, poisson);
        let largest = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for row in 0..12 {
            for column in 0..12 {
                let block = tet4::stiffness_block(&element, lame, row / 3, column / 3);
                let difference = block[(row % 3, column % 3)] - expected[12 * row + column];
                assert!(difference.abs() <= 1e-14 * largest, "{file} ({row}, {column}): {difference:e}");
            }
        }
    }
}
