use super::*;
use crate::base::progress::Silent;
use crate::mesh::{Block, block, surface_body};
use nalgebra::Matrix3;
use std::collections::BTreeMap;

const LAME: Lame = Lame { lambda: 1.5, mu: 1.0 };

/// A sphere of radius 1, of 8·4^times triangles.
fn sphere(times: u32) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let mut nodes: Vec<_> =
        (0..6).map(|k| Vector3::ith(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })).collect();
    let mut triangles =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..times {
        let mut middles = BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |p: u32, q: u32| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    nodes.push((nodes[p as usize] + nodes[q as usize]).normalize());
                    nodes.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (nodes, triangles)
}

/// One column: `field` at every node.
fn column(nodes: &[Vector3<f64>], field: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> NodeFields {
    let data = nodes.iter().flat_map(|x| <[f64; 3]>::from(field(x))).collect();
    NodeFields { nodes: nodes.len(), columns: 1, data }
}

/// A bar whose ends are pulled apart and may shrink across is in a state that triangles hold exactly: every displacement, the
/// energy and the tractions' work are right to what the integrals are exact to.
#[test]
fn a_stretched_bar_is_exact() {
    let mut bar =
        surface_body::of_tetrahedra(&block(&Block { size: [2.0, 1.0, 0.7], cells: [2, 1, 1] }).unwrap());
    surface_body::shorten(&mut bar, 1.1).unwrap();
    let [young, poisson] = [2.6, 0.3];
    let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, -poisson, -poisson));
    let exact = column(&bar.nodes, |x| stretch * x);
    let is_held: Vec<bool> = bar.nodes.iter().map(|x| x.x.abs() > 0.999).collect();
    let surface = Surface { nodes: &bar.nodes, triangles: &bar.triangles };
    let solved = solve(surface, Lame::from_young_poisson(young, poisson), &is_held, &exact, &Silent).unwrap();
    assert!(
        is_held.iter().any(|held| !held) && solved.integration_error < 1e-6,
        "{}",
        solved.integration_error
    );
    let error =
        solved.fields.data.iter().zip(&exact.data).map(|(u, exact)| (u - exact).abs()).fold(0.0, f64::max);
    assert!(error < 5e-6, "{error:e}");
    let energy = young * 2.0 * 0.7;
    for work in [&solved.work, &solved.traction_work] {
        assert!((work[(0, 0)] / energy - 1.0).abs() < 5e-6, "{work} {energy}");
    }
}

/// u of Kelvin's point force along x at `source`, and the traction on a plane of this normal, times 16 π μ (1 - ν).
fn kelvin(x: &Vector3<f64>, normal: &Vector3<f64>, source: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let nu = LAME.lambda / (2.0 * (LAME.lambda + LAME.mu));
    let (r, e) = (x - source, Vector3::x());
    let far = r.norm();
    let u = e * ((3.0 - 4.0 * nu) / far) + r * (r.x / far.powi(3));
    let step = 1e-5;
    let at = |x: Vector3<f64>| {
        let r = x - source;
        e * ((3.0 - 4.0 * nu) / r.norm()) + r * (r.x / r.norm().powi(3))
    };
    let slope = Matrix3::from_columns(&[0, 1, 2].map(|k| {
        let d = Vector3::ith(k, step);
        (at(x + d) - at(x - d)) / (2.0 * step)
    }));
    let stress =
        Matrix3::from_diagonal_element(LAME.lambda * slope.trace()) + (slope + slope.transpose()) * LAME.mu;
    [u, stress * normal]
}

/// The work of Kelvin's tractions on a polyhedron, from its displacements alone, beside ∮ u·t; second order in the triangles' size.
#[test]
fn kelvins_solution_is_met_at_second_order() {
    let source = Vector3::new(1.6, 0.7, 0.4);
    let errors: Vec<f64> = (0..3)
        .map(|times| {
            // A cube, so that the body is the same however fine it is.
            let cells = [1u32, 2, 4][times];
            let cube =
                surface_body::of_tetrahedra(&block(&Block { size: [1.0; 3], cells: [cells; 3] }).unwrap());
            let surface = Surface { nodes: &cube.nodes, triangles: &cube.triangles };
            let given = column(&cube.nodes, |x| kelvin(x, &Vector3::x(), &source)[0]);
            let held = vec![true; cube.nodes.len()];
            let solved = solve(surface, LAME, &held, &given, &Silent).unwrap();
            let fine =
                surface_body::of_tetrahedra(&block(&Block { size: [1.0; 3], cells: [16; 3] }).unwrap());
            let exact: f64 = fine
                .triangles
                .iter()
                .map(|t| {
                    let t = Triangle::new(t.map(|node| fine.nodes[node as usize])).unwrap();
                    let [u, p] = kelvin(&t.centre, &t.frame.normal.into(), &source);
                    u.dot(&p) * t.area
                })
                .sum();
            (solved.work[(0, 0)] / exact - 1.0).abs()
        })
        .collect();
    let rate = (errors[1] / errors[2]).log2();
    assert!(errors[2] < 0.025 && rate > 1.6, "{errors:?}: order {rate}");
}

/// A hollow sphere stretched from outside: u = A r + B/r², with no traction on the wall of the cavity. It is a surface of two shells,
/// and everything inside is free.
#[test]
fn a_hollow_sphere_follows_lames_solution() {
    let (outer, inner) = (1.0f64, 0.5f64);
    let bulk = 3.0 * LAME.lambda + 2.0 * LAME.mu;
    let part = inner.powi(3) * bulk / (4.0 * LAME.mu);
    let a = 1.0 / (1.0 + part / outer.powi(3));
    let exact = a * (inner + part / (inner * inner));
    let errors = [0, 1, 2].map(|times| {
        let (shell, faces) = sphere(times);
        let count = shell.len() as u32;
        let nodes: Vec<_> = shell
            .iter()
            .chain(&shell)
            .enumerate()
            .map(|(k, x)| x * if k < shell.len() { outer } else { inner })
            .collect();
        let turned = faces.iter().map(|[a, b, c]| [a + count, c + count, b + count]);
        let triangles: Vec<_> = faces.iter().copied().chain(turned).collect();
        let is_held: Vec<bool> = (0..nodes.len()).map(|k| k < shell.len()).collect();
        let given = column(&nodes, |x| *x);
        let solved =
            solve(Surface { nodes: &nodes, triangles: &triangles }, LAME, &is_held, &given, &Silent).unwrap();
        let at = |node: usize| {
            nodes[node].normalize().dot(&Vector3::from_row_slice(&solved.fields.data[3 * node..][..3]))
        };
        let mean = (shell.len()..nodes.len()).map(at).sum::<f64>() / shell.len() as f64;
        (mean / exact - 1.0).abs()
    });
    let rate = (errors[1] / errors[2]).log2();
    assert!(errors[2] < 0.05 && rate > 1.3, "{errors:?}: order {rate}");
}

/// The energy of the bar does not lock: at ν = 0.4999 it is as near to that at 0.49 as the material is.
#[test]
fn nothing_locks_where_the_material_hardly_changes_its_volume() {
    let bar =
        surface_body::of_tetrahedra(&block(&Block { size: [3.0, 1.0, 1.0], cells: [3, 1, 1] }).unwrap());
    let is_held: Vec<bool> = bar.nodes.iter().map(|x| x.x.abs() > 1.499).collect();
    let shear = column(&bar.nodes, |x| if x.x > 0.0 { Vector3::y() } else { Vector3::zeros() });
    let surface = Surface { nodes: &bar.nodes, triangles: &bar.triangles };
    let energy = |poisson: f64| {
        let lame = Lame::from_young_poisson(1.0, poisson);
        solve(surface, lame, &is_held, &shear, &Silent).unwrap().work[(0, 0)]
    };
    let (soft, hard) = (energy(0.49), energy(0.4999));
    assert!((hard / soft - 1.0).abs() < 0.01, "{soft} {hard}");
}

#[test]
fn tractions_lie_on_held_triangles_and_around_single_nodes() {
    let triangles = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]];
    let nodes: Vec<_> = (0..6).map(|k| Vector3::new(f64::from(k / 2), f64::from(k % 2), 0.0)).collect();
    let surface = Surface { nodes: &nodes, triangles: &triangles };
    let loaded =
        |held: &[usize]| loaded_triangles(surface, &std::array::from_fn::<_, 6, _>(|k| held.contains(&k)));
    assert_eq!(loaded(&[0, 1, 2]), [0]);
    assert_eq!(loaded(&[0, 1, 2, 3]), [0, 1]);
    assert_eq!(loaded(&[4]), [2, 3]);
    assert_eq!(loaded(&[0, 1, 2, 5]), [0, 3]);
    assert_eq!(loaded(&[]), [0; 0]);
}

#[test]
fn matrices_that_do_not_fit_are_refused_with_what_would() {
    let error = fits(10_000_000, 1000).unwrap_err().to_string();
    assert!(
        error.contains("boundary elements on 10000000 nodes") && error.contains("nodes would fit"),
        "{error}"
    );
    assert!(fits(10, 1).unwrap() > 0.0);
    let Err(Error::Memory { fits, .. }) = super::fits(10_000_000, 1000) else { panic!() };
    assert!(fits > 0 && fits < 1_000_000 && super::fits(fits * 9 / 10, 0).is_ok(), "{fits}");
}
