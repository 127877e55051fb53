//! Equilibria beyond critical states, and far from rest, against published curves: elastica, frames that snap, rods that writhe.

mod elastica;
mod frames;
mod rod;
mod writhing;

use greenstage::deform::Statics;
use greenstage::fem::STVK;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use std::path::Path;

/// A body of St. Venant–Kirchhoff material with these keys.
fn body(keys: &str) -> Statics {
    let scene = Scene::parse(&format!("[body.b]\nelement = \"tet10\"\n{keys}"), Path::new("branches.toml"));
    let mut statics = Statics::new(&scene.unwrap(), "b", &STVK, &Silent).unwrap();
    statics.judge_stability();
    statics
}

/// A slender bar of length 1 m along x, twice as wide as thick, held at `low` and with the control element `high` at the other end.
fn bar(thickness: f64, cells: u32) -> Statics {
    let width = 2.0 * thickness;
    body(&format!(
        "generate = {{ block = {{ size = [1.0, {width:?}, {thickness:?}], cells = [{cells}, 1, 1] }} }}\n\
         material = {{ young = 1.0e9, poisson = 0.0 }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
    ))
}

/// E I of that bar across its thickness, N·m².
fn bending_stiffness(thickness: f64) -> f64 {
    2.0e9 * thickness.powi(4) / 12.0
}
