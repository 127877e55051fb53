//! Chains of random updates of small bodies against fresh precomputations of the same states: differences are reported.
//!
//! `GREENSTAGE_UPDATE_CHAINS=10000 cargo test --test mechanics chains_of_updates -- --nocapture` makes that many chains; the
//! suite makes a few.

use greenstage::base::diagnostic::{Diagnostic, Severity};
use greenstage::base::progress::Progress;
use greenstage::base::random::Random;
use greenstage::green::{
    self, COMPLIANCE, Changes, FIELDS, Family, GreenFile, KEPT_FACTOR, LOAD_COMPLIANCE, LOADS, REACTION,
    Requirements, STIFFNESS, TORQUES, UPDATES,
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
fn body(draw: &mut Draw, path: &Path, family: Option<Family>, is_loaded: bool) -> Scene {
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
    let below = tags(&mesh, &|x| x[2] <= -h[2]);
    let loads = match is_loaded {
        true => format!(
            "gravity = true\nthermal = {{ expansion = 1e-5, difference = 20.0 }}\n\
             load.press = {{ nodes = {{ list = {below:?} }}, kind = \"pressure\" }}\n\
             load.push = {{ nodes = {{ list = {below:?} }}, kind = \"shift\" }}\n"
        ),
        false => String::new(),
    };
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
            let density = draw.within(1e2, 1e3);
            format!("region.{r} = {{ young = {young:e}, poisson = {poisson}, density = {density} }}\n")
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
        "[body.a]\nmesh = {:?}\nmaterial = {{ young = {young:e}, poisson = 0.3, density = 1e3 }}\n{materials}{kept}{loads}\
         updates = {{ release = [\"left\", \"right\", \"top\", \"few\"], modulus = [\"1\", \"2\", \"3\"] }}\n{controls}",
        path.display().to_string()
    );
    Scene::parse(&text, path).unwrap()
}

/// Releases, lets hold again, or changes a modulus.
fn step(draw: &mut Draw, scene: &mut Scene, before: &Scene) -> String {
    let body = &mut scene.body["a"];
    let name = ["left", "right", "top", "few"][draw.below(4)];
    match draw.below(4) {
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

fn file(scene: &Scene, required: &Requirements) -> Result<Arc<GreenFile>, String> {
    let body = green::precompute(scene, "a", required, &Silent).map_err(|error| error.to_string())?;
    Ok(green::opened(&[body]).unwrap())
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

/// The largest difference of what loads do: of a column, of its reactions, of its work on itself and others as a part of that which
/// each does on itself, and of its torques.
fn of_loads(a: &GreenFile, b: &GreenFile, size: f64) -> f64 {
    let Some(count) = b.meta.bodies.get("a").map(|meta| meta.load_columns()).filter(|count| *count > 0)
    else {
        return 0.0;
    };
    let part = |off: f64, of: f64| if off == 0.0 { 0.0 } else { off / of };
    let [of_a, of_b] = [a, b].map(|file| file.load_columns("a"));
    let nodes = b.rest("a").len();
    let column = |load: usize| {
        let pairs = (0..3 * nodes).map(|row| [&of_a, &of_b].map(|of| f64::from(of.value(nodes, load, row))));
        let [off, of] =
            pairs.fold([0.0_f64; 2], |[off, of], [a, b]| [off.max((a - b).abs()), of.max(b.abs())]);
        part(off, of)
    };
    let columns = (0..count).map(column).fold(0.0, f64::max);
    let tables = |name: &str| [a, b].map(|file| file.table("a", name).unwrap());
    let of_columns = |[a, b]: [DMatrix<f64>; 2]| {
        let each = a.column_iter().zip(b.column_iter());
        each.map(|(a, b)| part((a - b).amax(), b.amax())).fold(0.0, f64::max)
    };
    let scale = |i: usize| if i % FIELDS < 3 { 1.0 } else { 1.0 / size };
    let scaled = |of: DMatrix<f64>| DMatrix::from_fn(of.nrows(), of.ncols(), |i, j| of[(i, j)] * scale(i));
    let [work, fresh] = tables(LOAD_COMPLIANCE);
    let own: Vec<f64> = (0..count).map(|k| fresh[(k, k)].abs().sqrt()).collect();
    let pairs = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
    let pairs = pairs.map(|(i, j)| part((work[(i, j)] - fresh[(i, j)]).abs(), own[i] * own[j]));
    let others = [columns, of_columns(tables(REACTION).map(scaled)), of_columns(tables(TORQUES))];
    pairs.chain(others).fold(0.0, f64::max)
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
        std::env::var("GREENSTAGE_UPDATE_CHAINS").map_or(150, |count| count.parse::<usize>().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("a.msh");
    let mut draw = Draw(Random::default());
    let (mut states, mut anew, mut warned, mut refused, mut worst) = (0, 0, 0, 0, [0.0; 4]);
    let mut updated_with_loads = 0;
    let mut wrong = Vec::new();
    let changes = Changes { sections: &|_, _| Vec::new(), fits: &|_| None };
    for number in 0..chains.div_ceil(OF_A_BODY) {
        let family = [None, None, Some(COMPLIANCE), Some(KEPT_FACTOR)][number % 4];
        let scene = body(&mut draw, &mesh, family, number % 2 == 1);
        let families: Vec<Family> =
            [STIFFNESS, LOADS].into_iter().take(1 + number % 2).chain(family).collect();
        let of_fresh = Requirements::new(&families);
        let required = of_fresh.clone().and(Requirements::new(&[UPDATES]));
        let Ok(base) = file(&scene, &required) else { continue };
        let rest = base.rest("a");
        let size = rest.iter().flatten().fold(0.0, |most, x| f64::max(most, f64::from(x.abs())));
        for _ in 0..OF_A_BODY {
            let mut now = scene.clone();
            let mut told = Vec::new();
            for _ in 0..1 + draw.below(3) {
                told.push(step(&mut draw, &mut now, &scene));
                if !now.body["a"].is_updated() {
                    continue;
                }
                states += 1;
                let teller = |_: &str| -> Box<dyn Progress> { Box::new(Silent) };
                let derived = green::derive(base.clone(), &now, &changes, &teller);
                let fresh = file(&now, &of_fresh);
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
                // With a compliance of the surface, every change of a modulus is.
                anew += usize::from(is_anew && family.is_none());
                // Walls that bend too stiffly are as wrong in both.
                let is_of_numbers = |notice: &&Diagnostic| !notice.message.starts_with("walls ");
                if notices.iter().filter(is_of_numbers).any(|notice| notice.severity < Severity::Note) {
                    warned += 1;
                    continue;
                }
                let [columns, forces] = differences(&derived, &fresh, size);
                updated_with_loads += usize::from(!is_anew && now.body["a"].gravity.is_some());
                let of_compliance = of_compliance(&derived, &fresh);
                let found = [columns, forces, of_compliance, of_loads(&derived, &fresh, size)];
                let allowed = SAME + STORED;
                if found.iter().any(|off| *off > allowed || off.is_nan()) {
                    wrong.push(format!("body {number}, {told:?}, anew {is_anew}: {}", digits(&found)));
                }
                (0..4).for_each(|k| worst[k] = f64::max(worst[k], found[k]));
            }
        }
    }
    println!(
        "{states} states: {anew} solved anew, {warned} with a warning, {refused} refused; largest difference of columns, forces, \
         compliance and loads without a word: {}",
        digits(&worst)
    );
    assert!(states > chains && anew > 0 && anew < states / 2, "{states} {anew}");
    assert!(updated_with_loads > chains / 5, "{updated_with_loads}");
    assert!(wrong.is_empty(), "{} of {states}:\n{}", wrong.len(), wrong.join("\n"));
}
