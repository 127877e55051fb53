//! Released control elements and changed moduli against a fresh factorization of the body as it is then.

use greenstage::base::columns::Storage;
use greenstage::green::update::{Change, ChangedSystem, Updated, Updates};
use greenstage::green::{
    self, COMPLIANCE, Changes, FIELDS, Family, KEPT_FACTOR, LOAD_COMPLIANCE, LOAD_FIELDS, LOADS, Precomputed,
    REACTION, Requirements, STIFFNESS, Solution, TORQUES, UPDATES,
};
use greenstage::mesh::{Block, LoadedMesh, block};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::DMatrix;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A bar along x in three regions, held at both ends, on a patch of its top and, inside the second region, on one of its
/// bottom.
const SCENE: &str = "[body.a]\n\
    generate = { block = { size = [1.0, 0.4, 0.3], cells = [8, 3, 3] } }\n\
    material = { young = 1.0e6, poisson = 0.3, density = 900.0 }\n\
    region.2 = { young = 5.0e5, poisson = 0.35, density = 1100.0 }\n\
    region.3 = { young = 4.0e6, poisson = 0.2, density = 2000.0 }\n\
    gravity = true\n\
    centrifugal = { axis = [1, 2, 0], speed = 2.0 }\n\
    thermal = { expansion = 1e-5, difference = 20.0 }\n\
    surface_compliance = { nodes = \"surface\" }\n\
    load.side = { nodes = { group = \"zmax\" }, kind = \"stretch\" }\n\
    load.press = { nodes = { group = \"ymin\" }, kind = \"pressure\" }\n\
    updates = { release = [\"right\", \"top\", \"bottom\"], modulus = [\"2\", \"3\"] }\n\
    control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
    control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n\
    control.top = { nodes = { box = { min = [-0.3, 0.1, -1.0], max = [-0.2, 1.0, 1.0] } }, grab = \"dragger\" }\n\
    control.bottom = { nodes = { box = { min = [-0.05, -1.0, -1.0], max = [0.05, -0.1, 1.0] } }, grab = \"dragger\" }\n";

/// Solves the scene on its block, whose regions lie one behind the other.
fn solved(scene: &Scene, required: &Requirements) -> Solution {
    let mut mesh = block(&Block { size: [1.0, 0.4, 0.3], cells: [8, 3, 3] }).unwrap();
    let region = |tet: &[u32; 4]| {
        let x = tet.iter().map(|&n| mesh.nodes[n as usize].x).sum::<f64>() / 4.0;
        if x < -0.1 {
            1
        } else if x < 0.2 {
            2
        } else {
            3
        }
    };
    mesh.regions = mesh.tets.iter().map(region).collect();
    let prepared = green::prepare_mesh(scene, "a", LoadedMesh { mesh, notices: Vec::new() }).unwrap();
    green::solve_prepared(scene, "a", prepared, required, &Silent).unwrap()
}

fn updates(solution: &Solution) -> Updates {
    let table = |name: &str| solution.tables.get(name).cloned();
    let loads = solution.tables.get(LOAD_FIELDS).map_or(0, |fields| fields.ncols());
    Updates::read(&table, [solution.controls.len(), solution.surface.nodes.len(), loads]).unwrap()
}

/// The Hessian of the energy by the coefficients of control elements and loads.
fn hessian_of(solution: &Solution) -> DMatrix<f64> {
    let (s, r, c) =
        (solution.stiffness().unwrap(), &solution.tables[REACTION], &solution.tables[LOAD_COMPLIANCE]);
    let (n, k) = (s.nrows(), c.nrows());
    DMatrix::from_fn(n + k, n + k, |i, j| match (i < n, j < n) {
        (true, true) => s[(i, j)],
        (true, false) => -r[(i, j - n)],
        (false, true) => -r[(j, i - n)],
        (false, false) => -c[(i - n, j - n)],
    })
}

/// The largest differences of the handle stiffness and of the columns from those of a fresh solution, as parts of the largest
/// number of the fresh one.
fn apart(before: &Solution, after: &Updated, fresh: &Solution) -> [f64; 4] {
    let h = hessian_of(fresh);
    let n = fresh.stiffness().unwrap().nrows();
    let k = h.nrows() - n;
    let parts = [((0, 0), (n, n)), ((0, n), (n, k)), ((n, n), (k, k))];
    let off = |(at, size)| (after.hessian.view(at, size) - h.view(at, size)).amax() / h.view(at, size).amax();
    let hessian = parts.map(off).into_iter().fold(0.0, f64::max);
    let torques = &fresh.tables[TORQUES];
    let first = 3 * before.fields.columns;
    let of = |&e: &usize| 3 * FIELDS * e..3 * FIELDS * (e + 1);
    let rows: Vec<usize> = after.kept.iter().flat_map(of).chain(first..first + 3 * k).collect();
    let torque =
        (before.tables[TORQUES].select_rows(&rows) + &after.torques - torques).amax() / torques.amax();
    let mut largest: f64 = 0.0;
    let mut off: f64 = 0.0;
    let of_fresh = &fresh.tables[LOAD_FIELDS];
    let mut loaded = DMatrix::zeros(3 * fresh.surface.nodes.len(), k);
    let mut expected = loaded.clone();
    for (row, &node) in fresh.surface.nodes.iter().enumerate() {
        for axis in 0..3 {
            let (old, new) =
                (before.fields.row(3 * node as usize + axis), fresh.fields.row(3 * node as usize + axis));
            for load in 0..k {
                let at = (3 * row + axis, load);
                loaded[at] = after.added[(at.0, n + load)];
                expected[at] = of_fresh[(3 * node as usize + axis, load)];
            }
            for (at, &e) in after.kept.iter().enumerate() {
                for k in 0..FIELDS {
                    let value = old[FIELDS * e + k] + after.added[(3 * row + axis, FIELDS * at + k)];
                    off = off.max((value - new[FIELDS * at + k]).abs());
                    largest = largest.max(new[FIELDS * at + k].abs());
                }
            }
        }
    }
    let loaded = loaded - &expected;
    let loads = loaded.column_iter().zip(expected.column_iter()).map(|(off, all)| off.amax() / all.amax());
    [hessian, off / largest, loads.fold(0.0, f64::max), torque]
}

/// The columns of a force at a node of the surface, of a solution that is written and read again.
fn yields(solution: Solution, node: u32) -> Option<Vec<[[f32; 3]; 3]>> {
    let requirements = Requirements::new(&[STIFFNESS, COMPLIANCE]);
    let body = Precomputed::from_solution("a", Storage::F32, requirements, solution);
    let file = green::opened(&[body]).unwrap();
    let compliance = file.compliance("a")?;
    compliance.column(*compliance.places().get(&node)?).ok()
}

fn change_of<'a>(updates: &'a Updates, change: &Change) -> ChangedSystem<'a> {
    updates.prepare(change).unwrap()
}

#[test]
fn a_changed_body_is_what_a_fresh_factorization_finds() {
    let loaded = Scene::parse(SCENE, Path::new("any.toml")).unwrap();
    let mut bare = loaded.clone();
    // With a compliance of the surface, a changed modulus takes a solve anew.
    bare.body["a"].surface_compliance = None;
    let bases =
        [&loaded, &bare].map(|scene| solved(scene, &Requirements::new(&[UPDATES, LOADS, COMPLIANCE])));
    for (release, factors) in [
        (&["right"][..], [1.0, 1.0]),
        (&["top", "bottom"], [1.0, 1.0]),
        (&["right", "bottom", "top"], [1.0, 1.0]),
        (&[], [3.0, 1.0]),
        (&[], [0.01, 40.0]),
        (&["right", "bottom"], [0.2, 7.0]),
        (&["bottom"], [1e3, 1.0]),
    ] {
        let yields_too = factors == [1.0, 1.0];
        let (scene, base) = if yields_too { (&loaded, &bases[0]) } else { (&bare, &bases[1]) };
        let updates = updates(base);
        let mut changed = scene.clone();
        let body = &mut changed.body["a"];
        for name in release {
            assert!(body.release(name));
        }
        for (region, factor) in ["2", "3"].into_iter().zip(factors) {
            body.region.get_mut(region).unwrap().young *= factor;
        }
        assert_eq!(body.modulus_factors(), factors);
        let fresh = solved(&changed, &Requirements::new(&[STIFFNESS, LOADS, COMPLIANCE]));
        let names: Vec<&str> = base.controls.iter().map(|control| control.name.as_str()).collect();
        let released = (0..names.len()).filter(|&e| release.contains(&names[e])).collect();
        let change = Change { released, factors: factors.to_vec() };
        let after = change_of(&updates, &change).body(&hessian_of(base));
        let found @ [hessian, columns, loads, torques] = apart(base, &after, &fresh);
        println!(
            "{release:?} {factors:?}: {hessian:.1e} {columns:.1e} {loads:.1e} {torques:.1e} {:.1e}",
            after.asymmetry
        );
        assert!(found.iter().all(|off| *off < 1e-10), "{release:?} {factors:?}: {found:?}");
        assert!(after.asymmetry < 1e-11, "{:e}", after.asymmetry);
        if !yields_too {
            continue;
        }
        // A force at a node of the surface that is free before and after.
        let node = base
            .surface
            .nodes
            .iter()
            .position(|&n| base.mesh.nodes[n as usize].x > 0.3 && base.mesh.nodes[n as usize].x < 0.45);
        let node = node.unwrap() as u32;
        let more = change_of(&updates, &change).compliance(&[node]);
        let before = yields(base.clone(), node).unwrap();
        let expected = yields(fresh, node).unwrap();
        let largest = expected.iter().flatten().flatten().fold(0.0_f32, |a, b| a.max(b.abs()));
        for (i, (before, expected)) in before.iter().zip(&expected).enumerate() {
            for (axis, force) in (0..9).map(|k| (k / 3, k % 3)) {
                let value = f64::from(before[axis][force]) + more[(3 * i + axis, force)];
                let off = value - f64::from(expected[axis][force]);
                assert!(
                    off.abs() < 1e-6 * f64::from(largest),
                    "{release:?} {factors:?}: {off:e} of {largest:e}"
                );
            }
        }
    }
}

#[test]
fn a_body_that_nothing_holds_any_more_is_no_body() {
    let text = SCENE.replace("release = [\"right\"", "release = [\"left\", \"right\"");
    let scene = Scene::parse(&text, Path::new("any.toml")).unwrap();
    let base = solved(&scene, &Requirements::new(&[UPDATES, LOADS, COMPLIANCE]));
    let all = Change { released: vec![0, 1, 2, 3], factors: vec![1.0, 1.0] };
    assert!(updates(&base).prepare(&all).is_none());
    let with = |released: [usize; 3]| {
        let change = Change { released: released.to_vec(), factors: vec![1.0, 1.0] };
        updates(&base).prepare(&change).is_some()
    };
    assert!(with([1, 2, 3]));
    // The nodes of `bottom` lie on a line, about which the body turns.
    assert!(!with([0, 1, 2]));
}

/// A released end: what a force does afterwards, from the inverse that is changed and from the factor as it was.
#[test]
fn columns_from_a_kept_factor_are_changed_as_the_inverse_is() {
    // Of one material, as the block is that the update loads again.
    let lines = SCENE.lines().filter(|line| !line.starts_with("region."));
    let text = lines.collect::<Vec<_>>().join("\n").replace(", modulus = [\"2\", \"3\"]", "");
    let columns = |kept: &str, family: Family| {
        let text = text.replace("\"surface\"", &format!("\"surface\", kept = \"{kept}\""));
        let mut scene = Scene::parse(&text, Path::new("any.toml")).unwrap();
        let requirements = Requirements::new(&[STIFFNESS, UPDATES, LOADS, family]);
        let solution = solved(&scene, &requirements);
        let body = Precomputed::from_solution("a", Storage::F32, requirements, solution);
        let base = green::opened(&[body]).unwrap();
        assert!(scene.body["a"].release("right") && scene.body["a"].release("bottom"));
        let changes = Changes { sections: &|_, _| Vec::new(), fits: &|_| None };
        let (file, notices) = green::derive(base, &scene, &changes, &|_| Box::new(Silent)).unwrap();
        assert!(notices.is_empty(), "{notices:?}");
        let file = Arc::new(file);
        let places = file.compliance("a").unwrap().places();
        // The nodes of the released elements stand behind those that were free.
        let last = places.len() - 1;
        let asked: Vec<usize> = places.values().copied().step_by(11).chain([last]).collect();
        let found = file.columns("a", &asked, Duration::from_secs(60)).unwrap().unwrap();
        (places, found.iter().map(|column| column.to_vec()).collect::<Vec<_>>())
    };
    let (places, inverse) = columns("inverse", COMPLIANCE);
    let (same, factor) = columns("factor", KEPT_FACTOR);
    assert!(places == same && inverse.len() > 5);
    let (freed, _) = places.iter().find(|(_, place)| **place == places.len() - 1).unwrap();
    let mut scene = Scene::parse(&text, Path::new("any.toml")).unwrap();
    assert!(scene.body["a"].release("right") && scene.body["a"].release("bottom"));
    let fresh = solved(&scene, &Requirements::new(&[STIFFNESS, COMPLIANCE]));
    assert_eq!(
        fresh.compliance.as_ref().unwrap().order.len(),
        places.len(),
        "all of the surface takes forces"
    );
    let fresh = yields(fresh, *freed).unwrap();
    let largest = fresh.as_flattened().as_flattened().iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    for (found, fresh) in
        inverse.last().unwrap().iter().flatten().flatten().zip(fresh.iter().flatten().flatten())
    {
        assert!((found - fresh).abs() < 1e-5 * largest, "{found} {fresh} of {largest}");
    }
    for (expected, found) in inverse.iter().zip(&factor) {
        let numbers = |of: &[[[f32; 3]; 3]]| of.as_flattened().as_flattened().to_vec();
        let (expected, found) = (numbers(expected), numbers(found));
        let largest = expected.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
        let off = expected.iter().zip(&found).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        assert!(off < 1e-6 * largest, "{off:e} of {largest:e}");
    }
}
