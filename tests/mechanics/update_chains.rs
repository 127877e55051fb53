//! Chains of random updates of small bodies against fresh precomputations of the same states: differences are reported.
//!
//! `GREENSTAGE_UPDATE_CHAINS=10000 cargo test --test mechanics chains_of_updates -- --nocapture` makes that many chains; the
//! suite makes a few.

use greenstage::base::diagnostic::Severity;
use greenstage::base::progress::Progress;
use greenstage::base::random::Random;
use greenstage::green::{
    self, COMPLIANCE, FIELDS, Family, GreenFile, KEPT_FACTOR, Requirements, STIFFNESS, UPDATES,
};
use greenstage::mesh::{self, Block, TetMesh, block};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::DMatrix;
use std::path::Path;
use std::sync::Arc;

/// Part of the largest shape or force of a column or row by which it may differ without a report.
const SAME: f64 = 1e-6;
/// Largest error that storage in f32 may add.
const STORED: f64 = 2.5e-7;
/// Chains of each body.
const OF_A_BODY: usize = 25;

struct Draw(Random);

impl Draw {
    fn below(&mut self, count: usize) -> usize {
        (((self.0.draw() + 0.5) * count as f64) as usize).min(count - 1)
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (self.0.draw() + 0.5) * (high - low)
    }
}

/// A block of three or four cells each way, in regions by slabs or at random, and its scene. Of the elements that may be let go
/// of, one is an end, one a patch of the top, one a handful of nodes.
fn body(draw: &mut Draw, path: &Path, family: Option<Family>) -> Scene {
    let size = [1.0, draw.within(0.2, 1.0), draw.within(0.2, 1.0)]
        .map(|side| side * 10f64.powi(-(draw.below(4) as i32)));
    let cells = [3 + draw.below(3), 2 + draw.below(2), 2 + draw.below(2)].map(|count| count as u32);
    let mut mesh = block(&Block { size, cells }).unwrap();
    let slabs = draw.below(3) > 0;
    let region = |x: f64, draw: &mut Draw| match slabs {
        true => 1 + ((x / size[0] + 0.5) * 3.0).clamp(0.0, 2.9) as u32,
        false => 1 + draw.below(3) as u32,
    };
    let middles: Vec<f64> = mesh
        .tets
        .iter()
        .map(|tet| tet.iter().map(|&n| mesh.nodes[n as usize].x).sum::<f64>() / 4.0)
        .collect();
    mesh.regions = middles.iter().map(|&x| region(x, draw)).collect();
    (0..3).for_each(|k| mesh.regions[k] = 1 + k as u32);
    mesh::save(path, &mesh, None).unwrap();
    let tags = |mesh: &TetMesh, is_in: &dyn Fn([f64; 3]) -> bool| -> Vec<u64> {
        let nodes = mesh.nodes.iter().zip(&mesh.tags);
        nodes.filter(|(x, _)| is_in((**x).into())).map(|(_, tag)| *tag).collect()
    };
    let h = size.map(|side| 0.5 * side * (1.0 - 1e-9));
    let left = tags(&mesh, &|x| x[0] <= -h[0]);
    let right = tags(&mesh, &|x| x[0] >= h[0]);
    let top = tags(&mesh, &|x| x[2] >= h[2] && x[0].abs() < 0.6 * h[0]);
    let mut few = tags(&mesh, &|x| x[2] < h[2] && x[0].abs() < h[0]);
    let count = 3 + draw.below(4);
    while few.len() > count {
        few.remove(draw.below(few.len()));
    }
    let controls = [("left", left), ("right", right), ("top", top), ("few", few)];
    let controls: String = controls
        .iter()
        .map(|(name, nodes)| {
            format!("control.{name} = {{ nodes = {{ list = {nodes:?} }}, grab = \"dragger\" }}\n")
        })
        .collect();
    let young = 10f64.powf(draw.within(3.0, 9.0));
    let materials: String = (1..4)
        .map(|r| {
            let (young, poisson) = (young * 10f64.powf(draw.within(-2.0, 2.0)), draw.within(0.0, 0.45));
            format!("region.{r} = {{ young = {young:e}, poisson = {poisson} }}\n")
        })
        .collect();
    let kept = match family {
        Some(family) if family.name == KEPT_FACTOR.name => {
            "surface_compliance = { nodes = \"surface\", kept = \"factor\" }\n"
        }
        Some(_) => "surface_compliance = { nodes = \"surface\" }\n",
        None => "",
    };
    let text = format!(
        "[body.a]\nmesh = {:?}\nmaterial = {{ young = {young:e}, poisson = 0.3 }}\n{materials}{kept}\
         updates = {{ release = [\"left\", \"right\", \"top\", \"few\"], modulus = [\"1\", \"2\", \"3\"] }}\n{controls}",
        path.display().to_string()
    );
    Scene::parse(&text, path).unwrap()
}

/// Releases, lets hold again, or changes a modulus.
fn step(draw: &mut Draw, scene: &mut Scene, before: &Scene, changes_modulus: bool) -> String {
    let body = &mut scene.body["a"];
    let name = ["left", "right", "top", "few"][draw.below(4)];
    match draw.below(if changes_modulus { 4 } else { 2 }) {
        0 | 1 if body.control.len() > 1 && body.release(name) => format!("release {name}"),
        0 | 1 => format!("hold {name}: {}", body.hold(name)),
        _ => {
            let region = ["1", "2", "3"][draw.below(3)];
            let decades = [3.0, 12.0][draw.below(2)];
            let young = before.body["a"].region[region].young * 10f64.powf(draw.within(-decades, decades));
            body.region.get_mut(region).unwrap().young = young;
            format!("region {region} {young:.1e} Pa")
        }
    }
}

fn file(scene: &Scene, required: &Requirements, path: &Path) -> Result<GreenFile, String> {
    let body = green::precompute(scene, "a", required, &Silent).map_err(|error| error.to_string())?;
    green::write(path, &[body]).unwrap();
    Ok(GreenFile::open(path).unwrap())
}

/// The largest difference of a column, and of a row of S with lengths in half the body's extent, 1 m at most.
fn differences(a: &GreenFile, b: &GreenFile, size: f64) -> [f64; 2] {
    let [of_a, of_b] = [a, b].map(|file| file.affine_columns("a").unwrap());
    let part = |off: f64, of: f64| if off == 0.0 { 0.0 } else { off / of };
    let columns = of_a.column_iter().zip(of_b.column_iter());
    let columns = columns.map(|(a, b)| part((a - b).amax(), b.amax())).fold(0.0, f64::max);
    let scale = |i: usize| if i % FIELDS < 3 { 1.0 } else { 1.0 / size };
    let [of_a, of_b] = [a, b].map(|file| {
        let s = file.stiffness("a").unwrap();
        DMatrix::from_fn(s.nrows(), s.ncols(), |i, j| s[(i, j)] * scale(i) * scale(j))
    });
    // A row of rounding, as of a rigid motion of the only element that holds, has no digits.
    let least = 1e-6 * of_b.amax();
    let off = &of_a - &of_b;
    let rows = (0..off.nrows()).map(|i| part(off.row(i).amax(), of_b.row(i).amax().max(least)));
    [columns, rows.fold(0.0, f64::max)]
}

/// The largest difference of what forces at some nodes do.
fn of_compliance(a: &GreenFile, b: &GreenFile) -> f64 {
    let (Some(a), Some(b)) = (a.compliance("a"), b.compliance("a")) else { return 0.0 };
    let (of_a, of_b) = (a.places(), b.places());
    assert!(of_a.keys().eq(of_b.keys()));
    let difference = |node: &u32| {
        let [a, b] = [a.column(of_a[node]), b.column(of_b[node])].map(|column| column.unwrap());
        let numbers = |of: &[[[f32; 3]; 3]]| of.as_flattened().as_flattened().to_vec();
        let (a, b) = (numbers(&a), numbers(&b));
        let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        f64::from(off / b.iter().fold(0.0_f32, |most, b| most.max(b.abs())))
    };
    of_a.keys().step_by(17).map(difference).fold(0.0, f64::max)
}

fn digits(errors: &[f64]) -> String {
    errors.iter().map(|error| format!("{error:.1e}")).collect::<Vec<_>>().join(", ")
}

#[test]
fn chains_of_updates_say_what_differs_from_a_fresh_precomputation() {
    let chains =
        std::env::var("GREENSTAGE_UPDATE_CHAINS").map_or(50, |count| count.parse::<usize>().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let [mesh, first, again] = ["a.msh", "a.green", "b.green"].map(|name| folder.path().join(name));
    let mut draw = Draw(Random::default());
    let (mut states, mut anew, mut warned, mut refused, mut worst) = (0, 0, 0, 0, [0.0; 3]);
    let mut wrong = Vec::new();
    for number in 0..chains.div_ceil(OF_A_BODY) {
        let family = [None, None, Some(COMPLIANCE), Some(KEPT_FACTOR)][number % 4];
        let scene = body(&mut draw, &mesh, family);
        let of_fresh =
            Requirements::of(&[STIFFNESS]).and(family.map(|f| Requirements::of(&[f])).unwrap_or_default());
        let required = of_fresh.clone().and(Requirements::of(&[UPDATES]));
        let Ok(base) = file(&scene, &required, &first) else { continue };
        let base = Arc::new(base);
        let rest = base.rest("a");
        let size = rest.iter().flatten().fold(0.0, |most, x| f64::max(most, f64::from(x.abs())));
        for _ in 0..OF_A_BODY {
            let mut now = scene.clone();
            let mut told = Vec::new();
            for _ in 0..1 + draw.below(3) {
                told.push(step(&mut draw, &mut now, &scene, family.is_none()));
                if !now.body["a"].is_updated() {
                    continue;
                }
                states += 1;
                let teller = |_: &str| -> Box<dyn Progress> { Box::new(Silent) };
                let derived = green::derive(base.clone(), &now, &|_, _| Vec::new(), &teller);
                let fresh = file(&now, &of_fresh, &again);
                let (derived, notices, fresh) = match (derived, fresh) {
                    (Ok((derived, notices)), Ok(fresh)) => (derived, notices, fresh),
                    (Err(_), Err(_)) => {
                        refused += 1;
                        continue;
                    }
                    (derived, fresh) => {
                        let of = [derived.err().map(|error| error.to_string()), fresh.err()];
                        wrong.push(format!("body {number}, {told:?}: refused by one alone: {of:?}"));
                        continue;
                    }
                };
                let is_anew = notices.iter().any(|notice| notice.message.contains("solved anew"));
                anew += usize::from(is_anew);
                if notices.iter().any(|notice| notice.severity < Severity::Note) {
                    warned += 1;
                    continue;
                }
                let [columns, forces] = differences(&derived, &fresh, size);
                let found = [columns, forces, of_compliance(&derived, &fresh)];
                let allowed = SAME + STORED;
                if found.iter().any(|off| *off > allowed || off.is_nan()) {
                    wrong.push(format!("body {number}, {told:?}, anew {is_anew}: {}", digits(&found)));
                }
                (0..3).for_each(|k| worst[k] = f64::max(worst[k], found[k]));
            }
        }
    }
    println!(
        "{states} states: {anew} solved anew, {warned} with a warning, {refused} refused; largest difference of columns, forces \
         and compliance without a word: {}",
        digits(&worst)
    );
    assert!(states > chains && anew > 0 && anew < states / 2, "{states} {anew}");
    assert!(wrong.is_empty(), "{} of {states}:\n{}", wrong.len(), wrong.join("\n"));
}
