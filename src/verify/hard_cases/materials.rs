//! Cases 1 to 7: Poisson's ratios from -1 to ½ and beyond, and parts that are far stiffer or softer than the rest.

use super::case::{
    Asked, CaseRows, Must, base, cells, difference, largest, refused, solved, stiffness_difference,
};
use crate::green::{FIELDS, Solution};
use crate::mesh::TetMesh;
use nalgebra::Vector3;

pub(super) fn rows() -> CaseRows {
    let mut rows = poissons_ratio()?;
    rows.extend(held_contrast()?);
    rows.extend(inclusions()?);
    Ok(rows)
}

/// Numbers nodes and tetrahedra of a mesh backwards: another ordering, other rounding, the same answer.
fn backwards(mesh: &TetMesh) -> TetMesh {
    let last = mesh.nodes.len() as u32 - 1;
    let turn = |node: &u32| last - node;
    TetMesh {
        nodes: mesh.nodes.iter().rev().copied().collect(),
        tets: mesh.tets.iter().rev().map(|[a, b, c, d]| [turn(b), turn(a), turn(d), turn(c)]).collect(),
        regions: mesh.regions.iter().rev().copied().collect(),
        groups: mesh.groups.iter().map(|(n, g)| (n.clone(), g.iter().rev().map(turn).collect())).collect(),
        ..mesh.clone()
    }
}

fn poissons_ratio() -> CaseRows {
    const AGAINST: &str = "S against another ordering";
    let mut rows = Vec::new();
    for (number, poisson, must) in [
        (1, 0.3, Must::solve(AGAINST, 4e-14)),
        (2, 0.49, Must::warn("lock", AGAINST, 2.5e-13)),
        (2, 0.499999, Must::warn("lock", AGAINST, 1e-9)),
        (4, -0.5, Must::solve(AGAINST, 8e-14)),
        (4, -0.99, Must::solve(AGAINST, 1e-13)),
    ] {
        let material = format!("material = {{ young = 1.0e6, poisson = {poisson} }}\n");
        let forward = Asked::new(base()?).with(material.clone());
        let other = Asked::new(backwards(&base()?)).with(material);
        rows.push(solved(number, format!("ν = {poisson}"), must, &forward, |solution| {
            Ok(stiffness_difference(solution, &other.solve()?))
        })?);
    }
    for poisson in ["0.5", "0.51", "-1.0", "nan", "inf"] {
        let asked =
            Asked::new(base()?).with(format!("material = {{ young = 1.0e6, poisson = {poisson} }}\n"));
        rows.push(refused(3, format!("ν = {poisson}"), "body.b.material: Poisson's ratio", &asked));
    }
    Ok(rows)
}

fn with_region(mut mesh: TetMesh, inside: impl Fn(&Vector3<f64>) -> bool) -> TetMesh {
    for tet in 0..mesh.tets.len() {
        let centre = mesh.corners(tet).iter().sum::<Vector3<f64>>() / 4.0;
        mesh.regions[tet] = if inside(&centre) { 2 } else { 1 };
    }
    mesh
}

fn stiffer(mesh: &TetMesh, contrast: f64) -> Asked {
    Asked::new(mesh.clone()).with(format!("region.2 = {{ young = {:e}, poisson = 0.3 }}\n", 1e6 * contrast))
}

/// Any contrast where the stiff part is held. The reference is the limit of a rigid half, whose own motion is that of
/// its control element; a finite contrast is off it by about its inverse. Forces are those of the soft half alone, held
/// where the stiff one begins.
fn held_contrast() -> CaseRows {
    let half = with_region(base()?, |x| x.z > 0.0);
    let alone = Asked::new(cells([1.0; 3], [5; 3])?).solve()?;
    let mut rows = Vec::new();
    for contrast in [1e2, 1e6, 1e10, 1e14] {
        let (case, bound) = (format!("contrast {contrast:.0e}, stiff half held"), 3.0 / contrast + 1e-13);
        // Of a contrast of 1e14, S keeps one or two digits of the moment that turns the stiff half.
        let must = |measured| match contrast > 1e12 {
            true => Must::warn("moments are uncertain", measured, bound),
            false => Must::solve(measured, bound),
        };
        let asked = stiffer(&half, contrast);
        rows.push(solved(5, &case, must("stiff half against its control element"), &asked, |solution| {
            // Field 0 of the second control element: a unit translation along x.
            let upper = (0..solution.mesh.nodes.len()).filter(|&node| solution.mesh.nodes[node].z > 1e-9);
            Ok(largest(upper.map(|node| (solution.fields.row(3 * node)[FIELDS] - 1.0).abs())))
        })?);
        rows.push(solved(5, &case, must("pulls against the soft half alone"), &asked, |solution| {
            Ok(pull_difference(solution, &alone))
        })?);
    }
    Ok(rows)
}

/// Relative difference of the forces that shifts of the control elements cost.
fn pull_difference(a: &Solution, b: &Solution) -> f64 {
    let pulls = |solution: &Solution| {
        let shifts: Vec<usize> = (0..solution.fields.columns).filter(|column| column % FIELDS < 3).collect();
        solution.stiffness().map(|s| s.select_rows(&shifts).select_columns(&shifts))
    };
    match (pulls(a), pulls(b)) {
        (Some(a), Some(b)) if a.shape() == b.shape() => (&a - &b).amax() / b.amax(),
        _ => f64::NAN,
    }
}

/// Soft inclusions are harmless; a stiff one that floats loses its six rigid motions in rounding as the contrast grows.
fn inclusions() -> CaseRows {
    let inclusion = with_region(base()?, |x| x.norm() < 0.35);
    let mut rows = Vec::new();
    for contrast in [1e-4, 1e-12] {
        let asked = stiffer(&inclusion, contrast);
        let pcg = "solver = { method = \"pcg\", tolerance = 1e-13, max_iterations = 100000 }\n";
        let other = stiffer(&inclusion, contrast);
        let other = Asked { extra: other.extra.clone() + pcg, ..other };
        let must = Must::solve("against conjugate gradients", 2e-13);
        let case = format!("soft inclusion, contrast {contrast:.0e}");
        rows.push(solved(7, case, must, &asked, |solution| {
            Ok(difference(&other.solve()?, solution, |_| 1.0))
        })?);
    }
    let reference = stiffer(&inclusion, 1e4).solve()?;
    let against = |solution: &Solution| Ok(difference(solution, &reference, |_| 1.0));
    const AGAINST: &str = "against contrast 1e4";
    for (contrast, must) in [
        (1e5, Must::solve(AGAINST, 5e-4)),
        (1e8, Must::solve(AGAINST, 5e-4)),
        (1e10, Must::warn("region 2 floats", AGAINST, 5e-4)),
    ] {
        let case = format!("floating stiff inclusion, contrast {contrast:.0e}");
        rows.push(solved(6, case, must, &stiffer(&inclusion, contrast), against)?);
    }
    let beyond = stiffer(&inclusion, 1e13);
    rows.push(refused(6, "floating stiff inclusion, contrast 1e13", "region 2 floats", &beyond));
    let mut two = inclusion.clone();
    for tet in 0..two.tets.len() {
        let middle = two.corners(tet).iter().map(|x| x.z).sum::<f64>() / 4.0;
        if two.regions[tet] == 2 && middle > 0.0 {
            two.regions[tet] = 3;
        }
    }
    let of_two = stiffer(&two, 1e13);
    let of_two =
        Asked { extra: of_two.extra.clone() + "region.3 = { young = 1e19, poisson = 0.3 }\n", ..of_two };
    let words = "region 2 and region 3 float";
    rows.push(refused(6, "floating stiff inclusion of two regions, contrast 1e13", words, &of_two));
    let held = with_region(base()?, |x| x.norm() < 0.35 || x.z > 0.8);
    let case = "floating stiff inclusion of a region that is held elsewhere, contrast 1e13";
    rows.push(refused(6, case, "a part of region 2 floats", &stiffer(&held, 1e13)));
    Ok(rows)
}
