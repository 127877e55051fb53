//! Cases 23 to 29: what a tracked hand may do, a cube pressed too far, beams that are bent and twisted beyond what a series and
//! frozen frames bear, and bodies far from their origin in single precision.

use super::case::{Asked, CaseRow, CaseRows, ENDS, Must, Outcome, base, largest};
use crate::base::columns::ColumnGroup;
use crate::deform::{
    CATCH_UP, ControlPose, ControlPoses, ControlRest, Deformer, EquilibriumResult, JUMP, Kind, LINEAR,
    ModelEntry, ModelInput, PERTURBED, PoseFault, PoseLimiter, ROTATION, STRETCH, SUBSTRUCTURED, Statics,
    StaticsError, Superposition, in_session,
};
use crate::fem::{Law, NEO_HOOKEAN, STVK, nearest_turn};
use crate::green::{self, FIELDS, GreenError, Solution};
use crate::mesh::Surface;
use crate::scene::Scene;
use crate::solve::Silent;
use crate::world::out_of_range_of;
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use std::path::Path;

pub(super) fn rows() -> CaseRows {
    let mut rows = turns()?;
    rows.extend(guarded());
    rows.extend(pressed_cubes()?);
    rows.extend(bent_beams()?);
    rows.extend(twisted_beam()?);
    rows.extend(far_away()?);
    Ok(rows)
}

/// A row about the online stage; `fault` is its message.
fn row(number: u32, case: impl Into<String>, must: Must, fault: Option<PoseFault>, error: f64) -> CaseRow {
    CaseRow {
        number,
        case: case.into(),
        required: must.outcome,
        outcome: if fault.is_some() { Outcome::Warned } else { Outcome::Solved },
        words: must.words,
        said: fault.map_or(String::new(), |fault| fault.explain().to_owned()),
        measured: must.measured,
        error: Some(error),
        bound: Some(must.bound),
    }
}

/// A solved body as the online stage has it: in single precision, about its centre.
struct Online {
    /// Surface nodes about the centre.
    rest: Vec<Vector3<f64>>,
    columns: Vec<Vec<f32>>,
    controls: Vec<ControlRest>,
}

impl Online {
    fn new(solution: &Solution, centre: Vector3<f64>) -> Online {
        let nodes = &solution.surface.nodes;
        let column = |c: usize| {
            nodes.iter().flat_map(move |&n| {
                (0..3).map(move |axis| solution.fields.row(3 * n as usize + axis)[c] as f32)
            })
        };
        let controls = solution.controls.iter().map(|control| ControlRest {
            name: control.name.clone(),
            origin: control.origin - centre,
            nodes: control.nodes.len(),
        });
        Online {
            rest: nodes.iter().map(|&node| solution.mesh.nodes[node as usize] - centre).collect(),
            columns: (0..solution.controls.len())
                .map(|e| (FIELDS * e..FIELDS * (e + 1)).flat_map(column).collect())
                .collect(),
            controls: controls.collect(),
        }
    }

    /// All surface points about the centre, for poses one after the other, by a model; and whether its mean rotation was
    /// undefined.
    fn follow(
        &self,
        model: &ModelEntry,
        poses: impl Iterator<Item = ControlPoses>,
    ) -> Vec<(Vec<Vector3<f64>>, bool)> {
        let Kind::Online(make) = model.kind else { return Vec::new() };
        let none = |_| Vec::new();
        let input = ModelInput {
            controls: &self.controls,
            rest: &[],
            triangles: &[],
            control_nodes: &none,
            table: &|_| None,
            loads: None,
        };
        let Ok(mut model) = make(&input) else { return Vec::new() };
        let groups: Vec<ColumnGroup> = self.columns.iter().map(|columns| ColumnGroup::F32(columns)).collect();
        let (mut sum, mut u) =
            (Superposition::new(&groups, self.rest.len()), vec![[0.0; 3]; self.rest.len()]);
        // The point X of the body comes to x = body_from_surface · (X + u), both about the body's centre.
        let frame = |poses: ControlPoses| {
            let made = model.state(&poses);
            sum.update(&groups, &made.coefficients, &mut u);
            let motion = made.body_from_surface();
            let place = |(x, u): (&Vector3<f64>, &[f32; 3])| {
                (motion * Point3::from(x + Vector3::from(*u).cast::<f64>())).coords
            };
            (self.rest.iter().zip(&u).map(place).collect(), made.rotation_undefined)
        };
        poses.map(frame).collect()
    }

    /// Control element `e` turned about an axis through the centre.
    fn turned(&self, e: usize, turn: &Rotation3<f64>) -> ControlPose {
        let origin = self.controls[e].origin;
        ControlPose { translation: turn * origin - origin, matrix: *turn.matrix() }
    }

    /// Largest distance of two sets of surface points, as a part of the body's diagonal.
    fn apart(&self, a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
        let size = 2.0 * largest(self.rest.iter().map(Vector3::norm));
        largest(a.iter().zip(b).map(|(a, b)| (a - b).norm() / size))
    }
}

const STEP: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Hands that turn on and on: the mean rotation of `rotation` follows beyond half a turn.
fn turns() -> CaseRows {
    let body = Online::new(&Asked::new(base()?).solve()?, Vector3::zeros());
    let turn = |frame: usize| Rotation3::from_axis_angle(&Vector3::z_axis(), frame as f64 * STEP);
    let both = (0..=72).map(|frame| vec![body.turned(0, &turn(frame)), body.turned(1, &turn(frame))]);
    let places = body.follow(&ROTATION, both);
    let off = places.iter().zip(0..).map(|((places, _), frame)| {
        let rigid: Vec<Vector3<f64>> = body.rest.iter().map(|x| turn(frame) * x).collect();
        body.apart(places, &rigid)
    });
    let rigid = row(
        23,
        "both ends turned by 720° in steps of 10°",
        Must::solve("against the rigid motion", 1e-6),
        None,
        largest(off),
    );

    // One end turned by 10° moves none of its own points further than this.
    let own = largest(body.rest.iter().map(|x| x.xy().norm())) * 2.0 * (STEP / 2.0).sin();
    let one = (0..=72).map(|frame| vec![ControlPose::REST, body.turned(1, &turn(frame))]);
    let places = body.follow(&ROTATION, one);
    let steps = |undefined: bool| {
        let chosen = places.windows(2).filter(|pair| (pair[0].1 || pair[1].1) == undefined);
        let step = |pair: &[(Vec<Vector3<f64>>, bool)]| {
            largest(pair[0].0.iter().zip(&pair[1].0).map(|(a, b)| (a - b).norm() / own))
        };
        largest(chosen.map(step))
    };
    const STEPS: &str = "largest step of a point, in steps of the end";
    let smooth =
        row(23, "one end turned by 720° in steps of 10°", Must::solve(STEPS, 1.1), None, steps(false));
    // The mean turns by 5° a frame, and by 30° after the frames from 340° to 380°.
    let mut half = row(
        23,
        "the same where the ends are half a turn or a turn apart",
        Must::warn("not defined", STEPS, 6.5),
        None,
        steps(true),
    );
    if places.iter().any(|(_, undefined)| *undefined) {
        (half.outcome, half.said) =
            (Outcome::Warned, "the mean rotation is not defined, the last one is kept".into());
    }

    let mut guard = PoseLimiter::default();
    let far = ControlPose {
        matrix: *Rotation3::from_axis_angle(&Vector3::z_axis(), 1.1 * JUMP).matrix(),
        ..ControlPose::REST
    };
    let (admitted, faults) = guard.admit(&ControlPose::REST, &far);
    let followed = nearest_turn(&admitted.matrix).angle();
    let jump = row(
        23,
        "a jump by 165° in one frame",
        Must::warn("followed slowly", "first step against 15°", 1e-9),
        faults.first().copied(),
        (followed / CATCH_UP - 1.0).abs(),
    );
    Ok(vec![rigid, smooth, half, jump])
}

/// Matrices that no body can follow, and numbers that are none.
fn guarded() -> Vec<CaseRow> {
    let matrix = |matrix: Matrix3<f64>| ControlPose { matrix, ..ControlPose::REST };
    let diagonal = |x: f64, y: f64, z: f64| matrix(Matrix3::from_diagonal(&Vector3::new(x, y, z)));
    let beyond = |pose: &ControlPose| {
        let stretches = pose.matrix.singular_values();
        let outside = (STRETCH[0] - stretches.min()).max(stretches.max() - STRETCH[1]).max(0.0);
        if pose.matrix.determinant() > 0.0 { outside } else { f64::NAN }
    };
    let admit = |pose: ControlPose| {
        let (admitted, faults) = PoseLimiter::default().admit(&ControlPose::REST, &pose);
        (admitted, faults.first().copied())
    };
    let clamped = |case: &str, words: &'static str, pose: ControlPose| {
        let (admitted, fault) = admit(pose);
        row(24, case, Must::warn(words, "stretch beyond 0.05 to 20", 1e-9), fault, beyond(&admitted))
    };
    let mut rows = vec![
        clamped("M = 0", "clamped", diagonal(0.0, 0.0, 0.0)),
        clamped("M stretches by 10⁶", "clamped", diagonal(1e6, 1.0, 1.0)),
        clamped("det M < 0", "mirrors", diagonal(1.0, 1.0, -1.0)),
    ];
    let sheared = matrix(Matrix3::new(1.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0));
    let (admitted, fault) = admit(sheared);
    let change = (admitted.matrix - sheared.matrix).amax();
    rows.push(row(24, "shear by 2", Must::solve("change of M", 0.0), fault, change));

    for bad in [f64::NAN, f64::INFINITY] {
        let mut guard = PoseLimiter::default();
        let last = ControlPose { translation: Vector3::new(0.1, 0.2, 0.3), ..ControlPose::REST };
        let lost = ControlPose { translation: Vector3::new(bad, 0.0, 0.0), ..ControlPose::REST };
        let (held, faults) = guard.admit(&last, &lost);
        let must = Must::warn("the last pose is held", "held against last pose", 0.0);
        let off = (held.translation - last.translation).amax() + (held.matrix - last.matrix).amax();
        rows.push(row(25, format!("a pose with {bad}"), must, faults.first().copied(), off));
        let (again, faults) = guard.admit(&held, &last);
        let off = (again.translation - last.translation).amax();
        let must = Must::solve("change of the pose", 0.0);
        rows.push(row(25, "the same pose again, after it", must, faults.first().copied(), off));
    }
    rows
}

/// Columns about the control elements' own centres keep their digits in single precision wherever the body stands.
fn far_away() -> CaseRows {
    let mut rows = Vec::new();
    for lengths in [10.0, 1e3, 1e5] {
        let shift = Vector3::new(2.0 * lengths, 0.0, 0.0);
        let mut mesh = base()?;
        mesh.nodes.iter_mut().for_each(|x| *x += shift);
        let body = Online::new(&Asked::new(mesh).solve()?, shift);
        // x + w × x has no strain, so that the linear theory answers with it everywhere.
        let spin = Vector3::new(0.5, 0.0, 0.0).cross_matrix();
        let pose = |e: usize| ControlPose {
            translation: spin * body.controls[e].origin,
            matrix: Matrix3::identity() + spin,
        };
        let places = body.follow(&LINEAR, std::iter::once(vec![pose(0), pose(1)]));
        let rigid: Vec<Vector3<f64>> = body.rest.iter().map(|x| x + spin * x).collect();
        let error = places.first().map_or(f64::NAN, |(places, _)| body.apart(places, &rigid));
        let must = Must::solve("f32 against the rigid motion", 1e-6);
        rows.push(row(29, format!("{lengths:.0e} lengths from the origin"), must, None, error));
    }
    Ok(rows)
}

const BEAM: &str = r#"
[body.b]
generate = { block = { size = [0.1, 0.1, 1.0], cells = [2, 2, 20] } }
material = { young = 1.0e6, poisson = 0.3 }
"#;

/// The beam of 10 : 1 by a model, as a session has it.
fn beam(model: &'static ModelEntry) -> Result<Result<Deformer, String>, GreenError> {
    let scene = Scene::parse(&format!("{BEAM}{ENDS}"), Path::new("hard-cases.toml"))?;
    in_session(&green::precompute(&scene, "b", &model.with_energy(), &Silent)?, model)
}

/// A beam bent beyond the radius of its series, which by itself is 10⁵ lengths away at 180°.
fn bent_beams() -> CaseRows {
    let scene = Scene::parse(&format!("{BEAM}{ENDS}"), Path::new("hard-cases.toml"))?;
    let (mut body, mut rows) = (beam(&PERTURBED)?, Vec::new());
    for (degrees, must) in [
        (60.0_f64, Must::warn("strained by", "against equilibrium, in lengths", 0.015)),
        (120.0, Must::warn("holds up to", "against equilibrium, in lengths", 0.06)),
        (180.0, Must::warn("holds up to", "against equilibrium, in lengths", 0.12)),
    ] {
        let angle = degrees.to_radians();
        let place = Vector3::new(0.0, -(1.0 - angle.cos()), angle.sin()) / angle;
        let high = ControlPose {
            translation: place - Vector3::z(),
            matrix: *Rotation3::from_axis_angle(&Vector3::x_axis(), angle).matrix(),
        };
        let poses = vec![ControlPose::REST, high];
        let case = format!("beam bent by {degrees:.0}°, {PERTURBED}");
        let settle = || -> Result<(Vec<u32>, Vec<Vector3<f64>>), StaticsError> {
            let mut statics = Statics::new(&scene, "b", &STVK, &Silent)?;
            let settled = statics.solve(&poses, &Silent)?;
            Ok((Surface::from_mesh(&statics.mesh).nodes, settled.displacement))
        };
        let (body, (nodes, settled)) = match (&mut body, settle()) {
            (Ok(body), Ok(settled)) => (body, settled),
            (body, settled) => {
                let why = body.as_ref().err().cloned().or(settled.err().map(|error| error.to_string()));
                rows.push(CaseRow { said: why.unwrap_or_default(), ..row(27, case, must, None, f64::NAN) });
                continue;
            }
        };
        body.evaluate(&poses);
        let apart = nodes.iter().enumerate();
        let apart = apart.map(|(i, &node)| (body.displacement(i) - settled[node as usize]).norm());
        let mut found = row(27, case, must, None, largest(apart));
        if let Some(said) = out_of_range_of(body) {
            (found.outcome, found.said) = (Outcome::Warned, said);
        }
        rows.push(found);
    }
    Ok(rows)
}

/// A beam twisted by 340° in parts: with frames that are frozen in the gradient it buckled there in 345 iterations. One so
/// slender is stable to 669° (Greenhill).
fn twisted_beam() -> CaseRows {
    const WORK: Must = Must::solve("work of the torque against the energy", 1e-6);
    const AXIS: Must = Must::solve("centroid off the axis, in lengths", 1e-9);
    let case = format!("beam twisted by 340°, {SUBSTRUCTURED}");
    let mut body = match beam(&SUBSTRUCTURED)? {
        Ok(body) => body,
        Err(said) => return Ok(vec![CaseRow { said, ..row(28, case.as_str(), WORK, None, f64::NAN) }]),
    };
    // Simpson's rule over 34 steps.
    let (mut work, mut energy, mut aside) = (0.0, f64::NAN, 0.0_f64);
    for step in 0..=34 {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), f64::from(step) * STEP);
        body.evaluate(&[ControlPose::REST, ControlPose { matrix: *turn.matrix(), ..ControlPose::REST }]);
        let torque = body.wrenches().map_or(f64::NAN, |(wrenches, of_pose)| {
            energy = of_pose;
            wrenches[1].moment.z
        });
        let weight = if step % 34 == 0 { 1.0 } else { f64::from(2 + 2 * (step % 2)) };
        work += weight * torque * STEP / 3.0;
        let places = body.rest().iter().enumerate();
        let place = |(i, x): (usize, &[f32; 3])| Vector3::from(*x).cast::<f64>() + body.displacement(i);
        let middle = places.map(place).sum::<Vector3<f64>>() / body.node_count() as f64;
        aside = aside.max(middle.xy().norm());
    }
    Ok(vec![
        row(28, case.as_str(), WORK, None, (work / energy - 1.0).abs()),
        row(28, case.as_str(), AXIS, None, aside),
    ])
}

const CUBE: &str = r#"
[body.b]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [4, 4, 4] } }
material = { young = 1.0e6, poisson = 0.3 }
"#;

/// A cube pressed further than its material bears: Newton's iteration finds turned elements and calls it done; the least det F decides.
fn pressed_cubes() -> CaseRows {
    let scene = Scene::parse(&format!("{CUBE}{ENDS}"), Path::new("hard-cases.toml"))?;
    let cases = [
        (&STVK, 0.8, Must::solve("residual", 1e-10)),
        (
            &STVK,
            0.4,
            Must { outcome: Outcome::Refused, words: "no equilibrium beyond", ..Must::solve("", 0.0) },
        ),
        (&NEO_HOOKEAN, 0.4, Must::solve("residual", 1e-10)),
    ];
    cases.into_iter().map(|(law, height, must)| Ok(pressed(&scene, law, height, must))).collect()
}

fn pressed(scene: &Scene, law: &'static Law, height: f64, must: Must) -> CaseRow {
    let press = ControlPose { translation: Vector3::z() * (height - 1.0), ..ControlPose::REST };
    let settle = || -> Result<EquilibriumResult, StaticsError> {
        Statics::new(scene, "b", law, &Silent)?.solve(&vec![ControlPose::REST, press], &Silent)
    };
    let (outcome, said, error) = match settle() {
        Ok(settled) if settled.inverted.is_empty() => {
            (Outcome::Solved, String::new(), Some(settled.residual))
        }
        Ok(settled) => (Outcome::Solved, format!("{} inverted", settled.inverted.len()), Some(f64::NAN)),
        Err(error) => (Outcome::Refused, error.to_string(), None),
    };
    CaseRow {
        number: 26,
        case: format!("clamped cube pressed to {:.0} % of its height, {}", 100.0 * height, law.name),
        required: must.outcome,
        outcome,
        words: must.words,
        said,
        measured: must.measured,
        error,
        bound: (must.outcome != Outcome::Refused).then_some(must.bound),
    }
}
