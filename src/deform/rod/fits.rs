//! Check of a body's shape, before it is solved: whether it is slender enough for a rod.
//!
//! In: a body's mesh, moduli and control elements. Out: its length between the control elements over its radius of gyration r,
//! from the tetrahedra between them (r⊥ is the distance from the axis through their middle, E Young's modulus):
//!
//! ```text
//! r² = ½ ∫ E r⊥² dV / ∫ E dV
//! ```
//!
//! which is I/A of a uniform straight rod, in the mean of both directions of bending. The rod itself takes its radius from the solved
//! body's compliance ([`Section`](super::section::Section)), which differs where the body narrows or its ends give way.

use super::section::SLENDER;
use crate::base::diagnostic::Severity;
use crate::fem::Lame;
use crate::green::{ControlElement, Prepared};
use nalgebra::Vector3;

/// Part of the slenderness that is needed, below which the solved body will not have it either.
const SURELY: f64 = 0.8;

pub fn fits(body: &Prepared) -> Result<(), (Severity, String)> {
    let refused = |why: String| Err((Severity::Error, why));
    let [first, last] = &body.controls[..] else {
        return refused(format!(
            "model \"rod\" is for bodies with two control elements, one at each end; it has {}: write model = \"rotation\"",
            body.controls.len()
        ));
    };
    let chord = last.origin - first.origin;
    let Some(axis) = chord.try_normalize(0.0) else {
        return refused(
            "model \"rod\": both control elements have the same place: write model = \"rotation\"".to_owned(),
        );
    };
    let reach = |control: &ControlElement, towards: Vector3<f64>| {
        let along = |&node: &u32| (body.mesh.nodes[node as usize] - control.origin).dot(&towards);
        control.nodes.iter().map(along).fold(0.0, f64::max)
    };
    let ends = [reach(first, axis), chord.norm() - reach(last, -axis)];
    let length = ends[1] - ends[0];
    let slenderness = length / radius(body, &first.origin, &axis, ends);
    if slenderness.is_nan() || slenderness >= SLENDER {
        return Ok(());
    }
    let why = format!(
        "model \"rod\": between its control elements the body is {:.3e} m long, about {slenderness:.1} radii of gyration, and a \
         rod needs {SLENDER}",
        length.max(0.0)
    );
    if slenderness < SURELY * SLENDER {
        return refused(format!("{why}: write model = \"rotation\""));
    }
    Err((
        Severity::Warning,
        format!("{why}; whether it suits, the solved body tells: else write model = \"rotation\""),
    ))
}

/// r, of the tetrahedra whose middles lie between two places along the axis; NaN where there are none.
fn radius(body: &Prepared, origin: &Vector3<f64>, axis: &Vector3<f64>, ends: [f64; 2]) -> f64 {
    let (mut weight, mut first, mut second) = (0.0, Vector3::zeros(), 0.0);
    for (tet, lame) in body.mesh.tets.iter().zip(&body.lame) {
        let corners = tet.map(|node| {
            let x = body.mesh.nodes[node as usize] - origin;
            (x.dot(axis), x - axis * x.dot(axis))
        });
        let middle = corners.iter().map(|(along, _)| along).sum::<f64>() / 4.0;
        if !(ends[0]..=ends[1]).contains(&middle) {
            continue;
        }
        let place = |i: usize| corners[i].1 + axis * corners[i].0;
        let edges = [1, 2, 3].map(|i| place(i) - place(0));
        let own = young(lame) * edges[0].cross(&edges[1]).dot(&edges[2]).abs() / 6.0;
        // Exact for linear tetrahedra: ∫ x² dV = V (Σ x_i² + (Σ x_i)²) / 20.
        let sum: Vector3<f64> = corners.iter().map(|(_, aside)| aside).sum();
        let squares: f64 = corners.iter().map(|(_, aside)| aside.norm_squared()).sum();
        weight += own;
        first += sum * (own / 4.0);
        second += own * (squares + sum.norm_squared()) / 20.0;
    }
    let centre = first / weight;
    (0.5 * (second / weight - centre.norm_squared())).sqrt()
}

/// E.
fn young(lame: &Lame) -> f64 {
    lame.mu * (3.0 * lame.lambda + 2.0 * lame.mu) / (lame.lambda + lame.mu)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::green;
    use crate::scene::Scene;
    use std::path::Path;

    fn block(size: [f64; 3], settings: &str) -> Prepared {
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = {size:?}, cells = [12, 4, 4] }} }}\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\n\
             control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n{settings}\n"
        );
        green::prepare(&Scene::parse(&text, Path::new("any.toml")).unwrap(), "a").unwrap()
    }

    const LAST: &str = "control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }";

    /// √(I/A) of a rectangle is the root of the mean of b²/12 and h²/12.
    #[test]
    fn the_radius_of_gyration_is_that_of_the_section() {
        let body = block([1.0, 0.3, 0.1], LAST);
        let known = ((0.09 + 0.01) / 24.0_f64).sqrt();
        let found = radius(&body, &body.controls[0].origin, &Vector3::x(), [0.0, 1.0]);
        assert!((found / known - 1.0).abs() < 1e-9, "{found} {known}");
    }

    #[test]
    fn what_is_no_rod_is_refused_with_its_slenderness() {
        assert_eq!(fits(&block([4.0, 0.5, 0.5], LAST)), Ok(()), "27.7 radii of gyration");
        let (severity, why) = fits(&block([1.0, 1.0, 1.0], LAST)).unwrap_err();
        assert!(
            severity == Severity::Error && why.contains("about 3.5 radii of gyration"),
            "a cube has √12: {why}"
        );
        let (severity, why) = fits(&block([2.1, 1.0, 1.0], LAST)).unwrap_err();
        assert!(severity == Severity::Warning && why.contains("about 7.3 radii"), "{why}");
        let (severity, why) = fits(&block([4.0, 0.5, 0.5], "")).unwrap_err();
        assert!(severity == Severity::Error && why.contains("two control elements"), "{why}");
    }
}
