//! Frames that snap: equilibria by arc length through stable and unstable states, against rods.

use super::body;
use super::rod::{Section, curve, extrema};
use greenstage::deform::{ControlPose, Freedom, StaticForces, Statics};
use greenstage::mesh::{Block, block, save};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

const YOUNG: f64 = 1e9;

/// The section's width in parts of its thickness: a frame that is narrower would leave its plane.
const WIDTH: f64 = 8.0;

/// A frame along `corners` with a flat section and mitred joints, of `cells` cells on each of its bars; control elements `high` at
/// its end and `low` at its beginning.
fn frame(name: &str, corners: &[[f64; 2]], thickness: f64, cells: u32) -> Statics {
    let bars = corners.len() - 1;
    let size = [1.0, thickness, WIDTH * thickness];
    let mut mesh = block(&Block { size, cells: [cells * bars as u32, 1, 1] }).unwrap();
    let corners: Vec<Vector2<f64>> = corners.iter().map(|corner| Vector2::from(*corner)).collect();
    let normal = |bar: usize| {
        let way = (corners[bar + 1] - corners[bar]).normalize();
        Vector2::new(-way.y, way.x)
    };
    // The section at a corner halves its angle.
    let section = |corner: usize| {
        let (before, after) = (normal(corner.saturating_sub(1)), normal(corner.min(bars - 1)));
        (before + after) / (1.0 + before.dot(&after))
    };
    for x in &mut mesh.nodes {
        let along = (x.x + 0.5) * bars as f64;
        let bar = (along.floor() as usize).min(bars - 1);
        let end = |corner: usize| corners[corner] + section(corner) * x.y;
        let place = end(bar).lerp(&end(bar + 1), along - bar as f64);
        *x = Vector3::new(place.x, place.y, x.z);
    }
    let path = std::env::temp_dir().join(format!("greenstage-{name}-{}.msh", std::process::id()));
    save(&path, &mesh, None).unwrap();
    let made = body(&format!(
        "mesh = {path:?}\n\
         material = {{ young = {YOUNG:?}, poisson = 0.0 }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
    ));
    std::fs::remove_file(path).unwrap();
    made
}

/// EI, and EA L²/EI for L = 1.
fn stiffness(thickness: f64) -> (f64, f64) {
    (YOUNG * WIDTH * thickness.powi(4) / 12.0, 12.0 / thickness.powi(2))
}

/// Points of a curve of equilibria with the number of negative eigenvalues.
type Curve<const N: usize> = Vec<([f64; N], usize)>;

fn near(what: &str, own: f64, known: f64, size: f64) {
    println!("{what}: {own:.4}, {known:.4} of the rod: {:.2} %", 100.0 * (own - known) / size);
    assert!((own - known).abs() < 0.02 * size, "{what}: {own} and {known}");
}

/// Williams' toggle: two bars that are clamped at their feet and meet at an apex that is pressed down; half of it, 12.94 in wide and 0.386 in
/// high, EA 1.885·10⁶ lb, EI 9.27·10³ lb in² (Williams, Q. J. Mech. Appl. Math. 17, 1964, 451-469). Its load rises to a limit point, falls
/// and rises again.
#[test]
fn williams_toggle_snaps_as_its_rods_do() {
    let (height, thickness) = (0.386_f64 / 12.94, (12.0 * 9.27e3 / 1.885e6_f64).sqrt() / 12.94);
    let (ei, ea) = stiffness(thickness);
    // Unknowns: the force on the half, the moment at its foot, the deflection.
    let slope = height.atan();
    let apex = |z: &[f64; 4]| {
        let foot = Section { x: 0.0, y: 0.0, angle: slope, moment: z[2] };
        let end = foot.after(height.hypot(1.0), ea, [z[0], z[1]]);
        vec![end.x - 1.0, end.y - height + z[3], end.angle - slope]
    };
    let rod = curve([30.0, 5.0, 1.0, height], [0.0; 4], 3, (0.02, 200), apex);
    let rod: Vec<[f64; 2]> = rod.iter().map(|z| [z[3], -2.0 * z[1]]).collect();

    let mut statics = frame("toggle", &[[0.0, 0.0], [1.0, height]], thickness, 30);
    let unit = 10.0;
    let mut load = [0.0; 6];
    load[1] = -0.5 * unit * ei;
    let mut free = [false; 6];
    free[1] = true;
    statics.push(&[Freedom { free, load }, Freedom::default()]);
    let started = Instant::now();
    let mut own: Curve<2> = vec![([0.0; 2], 0)];
    statics
        .trace(&vec![ControlPose::REST; 2], (0.005, 0.06 * height), &mut |share, found| {
            let down = -found.poses[0].translation.y;
            own.push(([down, share * unit], found.stability.negative));
            down < 2.0 * height && own.len() < 150
        })
        .unwrap();
    let points: Vec<[f64; 2]> = own.iter().map(|(point, _)| *point).collect();
    println!("{} states, {:.1} s", points.len(), started.elapsed().as_secs_f64());
    let scaled =
        |points: &[[f64; 2]]| -> Vec<[f64; 2]> { points.iter().map(|p| [p[0] / height, p[1]]).collect() };
    let (limits, known) = (extrema(&scaled(&points), 1), extrema(&scaled(&rod), 1));
    println!("limits {limits:?}, {known:?}");
    assert!(limits.len() == 2 && known.len() >= 2, "it snaps");
    for (own, known) in limits.iter().zip(&known) {
        near("deflection", own[0], known[0], known[0]);
        near("load", own[1], known[1], known[1]);
    }
    let largest = known[0][1];
    for [down, load] in &points {
        let Some(at) = rod.windows(2).find(|w| (w[0][0]..=w[1][0]).contains(down)) else { continue };
        let part = (down - at[0][0]) / (at[1][0] - at[0][0]);
        let known = at[0][1] + part * (at[1][1] - at[0][1]);
        assert!((load - known).abs() < 0.02 * largest, "at {down}: {load} and {known}");
    }
    // It is unstable between the limits alone.
    for ([down, _], negative) in &own {
        let between = *down > 1.02 * height * limits[0][0] && *down < 0.98 * height * limits[1][0];
        let outside = *down < 0.98 * height * limits[0][0] || *down > 1.02 * height * limits[1][0];
        assert!(!between || *negative == 1, "{down}: {negative}");
        assert!(!outside || *negative == 0, "{down}: {negative}");
    }
}

/// Lee's frame: a hinged column and a hinged beam, pressed down at a fifth of the beam. Beyond its limit load the deflection goes back
/// (Lee, Manuel and Rossow, J. Eng. Mech. Div. ASCE 94, 1968, 521-547); P L²/EI = 18.53 there (Simo and Vu-Quoc, Comput. Methods
/// Appl. Mech. Engng. 58, 1986, 79-116).
#[test]
#[ignore = "takes half a minute"]
fn lees_frame_snaps_back_as_its_rods_do() {
    let thickness = 1.0 / 60.0;
    let (ei, ea) = stiffness(thickness);
    let place = |z: &[f64; 4]| {
        let foot = Section { x: 0.0, y: 0.0, angle: FRAC_PI_2 + z[2], moment: 0.0 };
        let corner = foot.after(1.0, ea, [z[0], z[1]]);
        let corner = Section { angle: corner.angle - FRAC_PI_2, ..corner };
        corner.after(0.2, ea, [z[0], z[1]])
    };
    let rod = curve([10.0, 10.0, 1.0, 10.0], [0.0; 4], 3, (0.02, 600), |z| {
        let end = place(z).after(0.8, ea, [z[0], z[1] + z[3]]);
        vec![end.x - 1.0, end.y - 1.0, end.moment]
    });
    let rod: Vec<[f64; 3]> = rod
        .iter()
        .map(|z| {
            let at = place(z);
            [at.x - 0.2, 1.0 - at.y, z[3] / 10.0]
        })
        .collect();

    let mut statics = frame("lee", &[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]], thickness, 20);
    let mut free = [false; 6];
    free[5] = true;
    let hinge = Freedom { free, load: [0.0; 6] };
    statics.push(&[hinge, hinge]);
    let is_loaded = |x: &Vector3<f64>| (x.x - 0.2).abs() < 1e-9 && (x.y - 1.0).abs() < 0.51 * thickness;
    let loaded: Vec<usize> =
        (0..statics.mesh.nodes.len()).filter(|&n| is_loaded(&statics.mesh.nodes[n])).collect();
    let force = Vector3::new(0.0, -10.0 * ei / loaded.len() as f64, 0.0);
    let at_nodes = loaded.iter().map(|&node| (node as u32, force)).collect();
    statics.apply(&StaticForces { at_nodes, ..StaticForces::default() }).unwrap();
    let started = Instant::now();
    let mut own: Curve<3> = vec![([0.0; 3], 0)];
    statics
        .trace(&vec![ControlPose::REST; 2], (0.02, 0.06), &mut |share, found| {
            let mean: Vector3<f64> =
                loaded.iter().map(|&node| found.displacement[node]).sum::<Vector3<f64>>()
                    / loaded.len() as f64;
            own.push(([mean.x, -mean.y, share], found.stability.negative));
            let has_fallen = own.iter().any(|(point, _)| point[2] < -0.5);
            own.len() < 250 && !(has_fallen && share > 0.5)
        })
        .unwrap();
    let points: Vec<[f64; 3]> = own.iter().map(|(point, _)| *point).collect();
    println!(
        "{} states, {} nodes loaded, {:.1} s",
        points.len(),
        loaded.len(),
        started.elapsed().as_secs_f64()
    );
    let (limits, known) = (extrema(&points, 2), extrema(&rod, 2));
    println!("limits {limits:.4?}, {known:.4?}");
    assert!(limits.len() >= 2 && known.len() >= 2, "it snaps");
    assert!((known[0][2] / 1.853 - 1.0).abs() < 0.01, "the published limit load");
    for (own, known) in limits.iter().zip(&known).take(2) {
        near("shift", own[0], known[0], 1.0);
        near("deflection", own[1], known[1], known[1]);
        near("load", own[2], known[2], known[2].abs());
    }
    // Deflections at which the curve turns back and forth.
    let (turns, known) = (extrema(&points, 1), extrema(&rod, 1));
    println!("turns {turns:.4?}, {known:.4?}");
    assert!(turns.len() >= 2 && known.len() >= 2, "it snaps back");
    for (own, known) in turns.iter().zip(&known).take(2) {
        near("deflection", own[1], known[1], known[1]);
    }
}
