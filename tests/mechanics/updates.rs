//! Released control elements and changed moduli against a fresh factorization of the body as it is then.

use greenstage::green::update::{Change, Updated, Updates};
use greenstage::green::{self, FIELDS, Requirements, STIFFNESS, Solution, UPDATES};
use greenstage::mesh::{Block, Loaded, block};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use std::path::Path;

/// A bar along x in three regions, held at both ends, on a patch of its top and, inside the second region, on one of its
/// bottom.
const SCENE: &str = "[body.a]\n\
    generate = { block = { size = [1.0, 0.4, 0.3], cells = [8, 3, 3] } }\n\
    material = { young = 1.0e6, poisson = 0.3 }\n\
    region.2 = { young = 5.0e5, poisson = 0.35 }\n\
    region.3 = { young = 4.0e6, poisson = 0.2 }\n\
    gravity = true\n\
    surface_compliance = { nodes = \"surface\" }\n\
    load.side = { nodes = { group = \"zmax\" }, kind = \"stretch\" }\n\
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
    let prepared = green::prepare_mesh(scene, "a", Loaded { mesh, notices: Vec::new() }).unwrap();
    green::solve_prepared(scene, "a", prepared, required, &Silent).unwrap()
}

fn updates(solution: &Solution) -> Updates {
    let table = |name: &str| solution.tables.get(name).cloned();
    let loads = solution.tables.get(LOAD_FIELDS).map_or(0, |fields| fields.ncols());
    Updates::of(&table, [solution.controls.len(), solution.surface.nodes.len(), loads]).unwrap()
}

/// The largest differences of the handle stiffness and of the columns from those of a fresh solution, as parts of the largest
/// number of the fresh one.
fn apart(before: &Solution, after: &Updated, fresh: &Solution) -> [f64; 2] {
    let s = fresh.stiffness().unwrap();
    let stiffness = (&after.stiffness - s).amax() / s.amax();
    let mut largest: f64 = 0.0;
    let mut off: f64 = 0.0;
    for (row, &node) in fresh.surface.nodes.iter().enumerate() {
        for axis in 0..3 {
            let (old, new) =
                (before.fields.row(3 * node as usize + axis), fresh.fields.row(3 * node as usize + axis));
            for (at, &e) in after.kept.iter().enumerate() {
                for k in 0..FIELDS {
                    let value = old[FIELDS * e + k] + after.added[(3 * row + axis, FIELDS * at + k)];
                    off = off.max((value - new[FIELDS * at + k]).abs());
                    largest = largest.max(new[FIELDS * at + k].abs());
                }
            }
        }
    }
    [stiffness, off / largest]
}

#[test]
fn a_changed_body_is_what_a_fresh_factorization_finds() {
    let scene = Scene::parse(SCENE, Path::new("any.toml")).unwrap();
    let base = solved(&scene, &Requirements::of(&[UPDATES]));
    let updates = updates(&base);
    for (release, factors) in [
        (&["right"][..], [1.0, 1.0]),
        (&["top", "bottom"], [1.0, 1.0]),
        (&["right", "bottom", "top"], [1.0, 1.0]),
        (&[], [3.0, 1.0]),
        (&[], [0.01, 40.0]),
        (&["right", "bottom"], [0.2, 7.0]),
        (&["bottom"], [1e3, 1.0]),
    ] {
        let mut changed = scene.clone();
        let body = &mut changed.body["a"];
        for name in release {
            assert!(body.release(name));
        }
        for (region, factor) in ["2", "3"].into_iter().zip(factors) {
            body.region.get_mut(region).unwrap().young *= factor;
        }
        assert_eq!(body.modulus_factors(), factors);
        let fresh = solved(&changed, &Requirements::of(&[STIFFNESS]));
        let names: Vec<&str> = base.controls.iter().map(|control| control.name.as_str()).collect();
        let released = (0..names.len()).filter(|&e| release.contains(&names[e])).collect();
        let change = Change { released, factors: factors.to_vec() };
        let after = updates.prepare(&change).unwrap().body(&hessian(&base));
        let [stiffness, columns] = apart(&base, &after, &fresh);
        println!(
            "{release:?} {factors:?}: stiffness {stiffness:.1e}, columns {columns:.1e}, asymmetry {:.1e}",
            after.asymmetry
        );
        assert!(stiffness < 1e-8 && columns < 1e-8, "{release:?} {factors:?}: {stiffness:e} {columns:e}");
        assert!(after.asymmetry < 1e-9, "{:e}", after.asymmetry);
    }
}

#[test]
fn a_body_that_nothing_holds_any_more_is_no_body() {
    let text = SCENE.replace("release = [\"right\"", "release = [\"left\", \"right\"");
    let scene = Scene::parse(&text, Path::new("any.toml")).unwrap();
    let base = solved(&scene, &Requirements::of(&[UPDATES]));
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
