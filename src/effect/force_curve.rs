//! The effect `force_curve`: the force of a hold against the way of the control element that is held, as it is drawn.
//!
//! In: poses and wrenches of the held element in every frame. Out: a plot in the window, of the last hold; a table at the end. Of
//! translation and turn it shows the one through which the hand has done more work: the force along the displacement from
//! rest, in N over m, or the torque about the axis of the turn from rest, in N·m over degrees. Where errors to expect were
//! measured for the body ([`expected`](super::expected)), a band shows within which the force truly lies.

use super::entry::{EffectEntry, EffectInput};
use crate::base::diagnostic::notice;
use crate::base::output::Kind;
use crate::base::plates::{Anchor, Axis, Plate, Plot, Tone};
use crate::base::quantity::quantity;
use crate::base::table::quoted;
use crate::deform::{ControlPose, FollowedTurn, Wrench};
use crate::green::STIFFNESS;
use crate::render::Drawable;
use crate::world::running::{Memory, read, written};
use crate::world::{
    BodyFrame, Frame, Highlight, PlacedBody, RunningEffect, World, why_unknown, wrench_error,
};
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::f64::consts::TAU;
use std::fmt::Write;

pub const NAME: &str = "force_curve";

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: NAME,
    summary: "force over displacement, or torque over turn, of the control element that is held, as a live plot",
    requirements: &[STIFFNESS],
    needs_energy: true,
    table: Some(&TABLE),
    attach: Some(|listed, world| Ok(Some(Box::new(ForceCurve::new(listed, world))))),
    ..EffectEntry::NOTHING
};

const HEADING: &str = "body,control,time,displacement,turn,force,torque,force_error,torque_error\n";

/// The table of `--curve`.
const TABLE: Kind =
    Kind { name: "a table by `--curve`", recognizes: |head| head.starts_with(HEADING.as_bytes()) };

/// Largest number of samples; when it is passed, every second one is left out.
const MOST: usize = 4096;
/// Smallest displacement that has a direction, as a part of the body's radius, and smallest turn, rad.
const LEAST: f64 = 1e-5;

struct ForceCurve {
    bodies: Vec<usize>,
    /// Number of control elements of each body of the world.
    controls: Vec<usize>,
    trace: Option<Trace>,
}

/// One hold.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Trace {
    place: (usize, usize),
    body: String,
    control: String,
    is_held: bool,
    /// The model has no force in the pose as it is.
    is_undefined: bool,
    /// Errors to expect, N and N·m; or why they are unknown.
    errors: Result<[f64; 2], Cow<'static, str>>,
    samples: Vec<Sample>,
    last: Option<(ControlPose, Wrench)>,
    /// Work by translation and by turn, counted without sign, J.
    work: [f64; 2],
    /// A displacement shorter than this has no direction, m.
    least: f64,
    /// The last directions that displacement and turn had.
    along: [Option<Direction>; 2],
}

/// A vector of length 1.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(transparent)]
struct Direction(#[serde(with = "crate::field::numbers")] Vector3<f64>);

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sample {
    time_s: f64,
    /// Displacement and turn from rest, m and rad.
    displacement: f64,
    turn: f64,
    wrench: Wrench,
    /// Force along the displacement, N, and torque about the axis of the turn, N·m. At rest along the direction before, or the
    /// first one after; `None` as long as there is none.
    force: Option<f64>,
    torque: Option<f64>,
    /// Errors to expect of both, N and N·m.
    errors: Option<[f64; 2]>,
    /// Whether the curve begins anew here, not joined with the sample before.
    is_first: bool,
}

impl ForceCurve {
    fn new(listed: &EffectInput<'_>, world: &mut World) -> ForceCurve {
        for &(b, name) in &listed.bodies {
            let body = &mut world.bodies[b];
            body.deformer.feel();
            if body.deformer.respond().is_none() {
                notice!(
                    "note: body.{name}: the model {} has no forces, so {NAME} shows no curve",
                    body.assets.model.name
                );
            }
        }
        let controls = world.bodies.iter().map(|body| body.assets.controls.len()).collect();
        ForceCurve { bodies: listed.bodies.iter().map(|&(b, _)| b).collect(), controls, trace: None }
    }

    /// The first control element that is held of a body that lists the effect.
    fn held(&self, frame: &Frame) -> Option<(usize, usize)> {
        let of = |&b: &usize| {
            let highlights = &frame.bodies[b].highlights;
            highlights.iter().position(|highlight| *highlight == Highlight::Held).map(|c| (b, c))
        };
        self.bodies.iter().find_map(of)
    }
}

impl RunningEffect for ForceCurve {
    fn name(&self) -> &'static str {
        NAME
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        let held = self.held(frame);
        let goes_on = self.trace.as_ref().is_some_and(|trace| trace.is_held && Some(trace.place) == held);
        if let Some(trace) = &mut self.trace {
            trace.is_held &= goes_on;
        }
        if let Some(place) = held.filter(|_| !goes_on) {
            self.trace = Some(Trace::new(place, &world.bodies[place.0], &frame.bodies[place.0]));
        }
        if let (Some(trace), Some((b, _))) = (&mut self.trace, held) {
            trace.take(&world.bodies[b], &frame.bodies[b], *world.graph.get(world.fields.time));
        }
        frame.drawables.extend(self.trace.as_ref().and_then(Trace::plate).map(Drawable::Plate));
    }

    fn memory(&self) -> Option<Memory> {
        written(&self.trace)
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let trace: Option<Trace> = read(memory)?;
        let is_known =
            |(b, c): (usize, usize)| self.bodies.contains(&b) && self.controls.get(b).is_some_and(|n| c < *n);
        if trace.as_ref().is_some_and(|trace| !is_known(trace.place)) {
            return Err("its curve is that of a control element of another scene".into());
        }
        self.trace = trace;
        Ok(())
    }

    fn clear(&mut self) {
        self.trace = None;
    }

    fn table(&self) -> Option<(&'static Kind, String)> {
        Some((&TABLE, self.trace.as_ref()?.table()))
    }
}

impl Trace {
    fn new(place: (usize, usize), body: &PlacedBody, shown: &BodyFrame) -> Trace {
        Trace {
            place,
            body: body.deformer.body.clone(),
            control: body.deformer.controls[place.1].name.clone(),
            is_held: true,
            is_undefined: false,
            errors: Err(why_unknown(body, shown).into()),
            samples: Vec::new(),
            last: None,
            work: [0.0; 2],
            least: LEAST * radius(body.deformer.rest()),
            along: [None; 2],
        }
    }

    /// The pose and the force of this frame.
    fn take(&mut self, body: &PlacedBody, shown: &BodyFrame, time_s: f64) {
        let (c, pose) = (self.place.1, body.deformer.poses[self.place.1]);
        let wrenches = body.deformer.wrenches().map(|(all, _)| all);
        self.is_undefined = wrenches.is_none();
        let Some(wrenches) = wrenches else {
            self.last = None;
            return;
        };
        let wrench = wrenches[c].about_the_place(&pose);
        if self.last == Some((pose, wrench)) {
            return;
        }
        self.errors = errors(body, shown, &wrenches);
        self.record(body, pose, wrench, time_s);
    }

    /// A sample of this pose and this force.
    fn record(&mut self, body: &PlacedBody, pose: ControlPose, wrench: Wrench, time_s: f64) {
        let is_first = self.last.is_none();
        if let Some((before, felt)) = self.last {
            let shift = pose.translation - before.translation;
            let turn = Rotation3::from_matrix(&(pose.matrix * before.matrix.transpose())).scaled_axis();
            self.work[0] += (0.5 * (wrench.force + felt.force).dot(&shift)).abs();
            self.work[1] += (0.5 * (wrench.moment + felt.moment).dot(&turn)).abs();
        }
        self.last = Some((pose, wrench));
        let turned = body.deformer.turn(self.place.1);
        let turn = turned.against(&FollowedTurn::REST);
        let now = [pose.translation.try_normalize(self.least), axis(&turned, turn)];
        self.along = [0, 1].map(|k| now[k].map(Direction).or(self.along[k]));
        self.samples.push(Sample {
            time_s,
            displacement: pose.translation.norm(),
            turn,
            wrench,
            force: None,
            torque: None,
            errors: self.errors.as_ref().ok().copied(),
            is_first,
        });
        self.project();
        if self.samples.len() > MOST {
            let mut number = 0;
            self.samples.retain(|sample| {
                number += 1;
                number % 2 == 1 || sample.is_first
            });
        }
    }

    /// Computes force and torque of the samples that had no direction so far.
    fn project(&mut self) {
        let [shift, axis] = self.along;
        for sample in self.samples.iter_mut().rev() {
            if sample.force.is_some() && sample.torque.is_some() {
                break;
            }
            sample.force = sample.force.or(shift.map(|Direction(along)| sample.wrench.force.dot(&along)));
            sample.torque = sample.torque.or(axis.map(|Direction(axis)| sample.wrench.moment.dot(&axis)));
        }
    }

    /// Whether the turn is a better abscissa than the displacement: more work was done by it.
    fn is_by_turn(&self) -> bool {
        self.work[1] > self.work[0]
    }

    /// Coordinates x and y of a sample, and the error of y; `None` while there is no direction along which the force is meant.
    fn point(&self, sample: &Sample) -> Option<([f64; 2], Option<f64>)> {
        Some(match self.is_by_turn() {
            true => ([sample.turn.to_degrees(), sample.torque?], sample.errors.map(|errors| errors[1])),
            false => ([sample.displacement, sample.force?], sample.errors.map(|errors| errors[0])),
        })
    }

    fn plate(&self) -> Option<Plate> {
        let ([x, y], _) = self.point(self.samples.last()?)?;
        let is_by_turn = self.is_by_turn();
        let told = match is_by_turn {
            true => format!("{} at {x:.1}°", quantity(y, "N·m")),
            false => format!("{} at {}", quantity(y, "N"), quantity(x, "m")),
        };
        let hold = if self.is_held { "" } else { ", let go (C clears)" };
        let heading = vec![
            (format!("{}.{}  ", self.body, self.control), Tone::Quiet),
            (told, Tone::Plain),
            (hold.into(), Tone::Quiet),
        ];
        let axis = |name, unit| Axis { name, unit };
        let now = Some([x, y]);
        let [x, y] = match is_by_turn {
            true => [axis("turn", "°"), axis("torque about the turn", "N·m")],
            false => [axis("displacement", "m"), axis("force along it", "N")],
        };
        let plot = Plot { x, y, curves: self.curves(), band: self.bands(), now };
        let lines = vec![heading, self.error_line()];
        Some(Plate { anchor: Anchor::LowerRight, lines, plot: Some(plot), legend: None })
    }

    fn error_line(&self) -> Vec<(String, Tone)> {
        let (by_turn, unit) = if self.is_by_turn() { (1, "N·m") } else { (0, "N") };
        match &self.errors {
            _ if self.is_undefined => vec![("the model has no force in this pose".into(), Tone::Bad)],
            Ok(errors) => {
                vec![
                    ("expected error ± ".into(), Tone::Quiet),
                    (quantity(errors[by_turn], unit), Tone::Plain),
                ]
            }
            Err(why) => vec![(format!("error unknown ({why})"), Tone::Fair)],
        }
    }

    fn curves(&self) -> Vec<Vec<[f64; 2]>> {
        let mut curves: Vec<Vec<[f64; 2]>> = Vec::new();
        for sample in &self.samples {
            if sample.is_first || curves.is_empty() {
                curves.push(Vec::new());
            }
            if let (Some(curve), Some((point, _))) = (curves.last_mut(), self.point(sample)) {
                curve.push(point);
            }
        }
        curves
    }

    /// Pieces of the curve of which the error is known.
    fn bands(&self) -> Vec<Vec<[f64; 3]>> {
        let mut bands = vec![Vec::new()];
        for sample in &self.samples {
            let Some(([x, y], error)) = self.point(sample) else { continue };
            if sample.is_first || error.is_none() {
                bands.push(Vec::new());
            }
            if let (Some(error), Some(band)) = (error, bands.last_mut()) {
                band.push([x, y - error, y + error]);
            }
        }
        bands
    }

    fn table(&self) -> String {
        let mut text = HEADING.to_owned();
        let (body, control) = (quoted(&self.body), quoted(&self.control));
        for sample in &self.samples {
            let Sample { time_s, displacement, turn, force, torque, errors, .. } = sample;
            let known = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:e}"));
            let numbers = [Some(*time_s), Some(*displacement), Some(*turn), *force, *torque].map(known);
            let errors = [0, 1].map(|k| known(errors.map(|both| both[k])));
            // Writing into a String cannot fail.
            let _ = writeln!(text, "{body},{control},{},{}", numbers.join(","), errors.join(","));
        }
        text
    }
}

/// The axis of a turn by `angle` rad from rest, along which the angle grows; `None` at rest.
fn axis(turn: &FollowedTurn, angle: f64) -> Option<Vector3<f64>> {
    let axis = turn.quaternion.imag().try_normalize(0.5 * LEAST)?;
    // Between one turn and two, four … the quaternion has the opposite sign.
    Some(if (angle / TAU) as u64 % 2 == 1 { -axis } else { axis })
}

/// Half the diagonal of the box about all places, m.
fn radius(places: &[[f32; 3]]) -> f64 {
    let bounds = |k: usize| {
        let values = || places.iter().map(|place| f64::from(place[k]));
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    0.5 * Vector3::from([0, 1, 2].map(bounds)).norm().max(0.0)
}

/// The errors of force and torque to expect in the current pose: those of model and mesh together.
fn errors(body: &PlacedBody, shown: &BodyFrame, wrenches: &[Wrench]) -> Result<[f64; 2], Cow<'static, str>> {
    let error = wrench_error(body, shown, wrenches).ok_or_else(|| Cow::from(why_unknown(body, shown)))?;
    match error.is_whole {
        true => Ok([error.force, error.moment]),
        false => Err("the mesh's part is not known".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::attach;
    use super::super::ghost_equilibrium::tests::{BAR, YOUNG, bar};
    use super::*;

    /// The bar's right end held through these poses; the effect, and its world.
    fn held(model: &str, poses: &[ControlPose]) -> (Box<dyn RunningEffect>, World) {
        let (scene, file, mut world) = bar(model, &[NAME]);
        let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap().remove(0);
        world.show_by(running.as_mut());
        assert!(
            world.frame.all(Drawable::plate).next().is_none() && running.table().is_none(),
            "nothing is held"
        );
        world.frame.bodies[0].highlights[1] = Highlight::Held;
        for pose in poses {
            world.bodies[0].deformer.evaluate(&[ControlPose::REST, *pose]);
            world.frame.drawables.clear();
            world.show_by(running.as_mut());
        }
        (running, world)
    }

    fn plot(world: &World) -> &Plot {
        world.frame.all(Drawable::plate).next().unwrap().plot.as_ref().unwrap()
    }

    fn words(world: &World) -> String {
        world
            .frame
            .all(Drawable::plate)
            .next()
            .unwrap()
            .lines
            .iter()
            .flatten()
            .map(|(text, _)| text.as_str())
            .collect()
    }

    /// F = E A / L · u of a bar with ν = 0, with the law's own units, and in the table too.
    #[test]
    fn a_pulled_bar_has_the_slope_of_its_stiffness() {
        let [length, side] = BAR;
        let stiffness = YOUNG * side * side / length;
        let pulls: Vec<ControlPose> = (1..=5)
            .map(|k| ControlPose { translation: Vector3::x() * (1e-3 * f64::from(k)), ..ControlPose::REST })
            .collect();
        let (mut running, mut world) = held("linear", &pulls);
        let [curve] = &plot(&world).curves[..] else { panic!("{:?}", plot(&world).curves) };
        assert_eq!((curve.len(), plot(&world).x.unit), (5, "m"));
        for [x, y] in curve {
            assert!((y / (stiffness * x) - 1.0).abs() < 1e-5, "{y} N at {x} m, {stiffness} N/m");
        }
        assert!(words(&world).contains("1.25 N at 5.00 mm"), "{}", words(&world));
        assert!(
            words(&world).contains("error unknown (list expected_errors)")
                && plot(&world).band.iter().all(Vec::is_empty)
        );
        let (_, table) = running.table().unwrap();
        let row: Vec<f64> =
            table.lines().last().unwrap().split(',').skip(3).take(3).map(|x| x.parse().unwrap()).collect();
        assert!((row[0] - 5e-3).abs() < 1e-12 && row[1] == 0.0 && (row[2] - 1.25).abs() < 1e-4, "{row:?}");

        // Let go, the curve stays; taken again, it begins anew; and it is cleared.
        world.frame.bodies[0].highlights[1] = Highlight::Idle;
        world.frame.drawables.clear();
        world.show_by(running.as_mut());
        assert!(words(&world).contains("let go") && plot(&world).curves[0].len() == 5);
        world.frame.bodies[0].highlights[1] = Highlight::Held;
        world.frame.drawables.clear();
        world.show_by(running.as_mut());
        assert_eq!(plot(&world).curves[0].len(), 1);
        running.clear();
        world.frame.bodies[0].highlights[1] = Highlight::Idle;
        world.frame.drawables.clear();
        world.show_by(running.as_mut());
        assert!(world.frame.all(Drawable::plate).next().is_none());
    }

    /// A body under a load bears a force already at rest: 0 N at 0 mm was invented there.
    #[test]
    fn the_curve_of_a_loaded_body_begins_with_the_force_that_it_has_at_rest() {
        let (_, mut world) = held("linear", &[]);
        let weight = Wrench { force: Vector3::new(3.0, 84.0, 0.0), moment: Vector3::z() * 13.0 };
        let body = &mut world.bodies[0];
        let mut trace = Trace::new((0, 1), body, &world.frame.bodies[0]);
        let mut sample = |translation: Vector3<f64>, more: f64| {
            let pose = ControlPose { translation, ..ControlPose::REST };
            body.deformer.evaluate(&[ControlPose::REST, pose]);
            trace.record(body, pose, Wrench { force: weight.force * more, ..weight }, 0.0);
            trace.plate().and_then(|plate| plate.plot).map(|plot| plot.curves.concat())
        };
        assert_eq!(sample(Vector3::zeros(), 1.0), None, "no direction yet, and no curve");
        assert_eq!(sample(Vector3::y() * 1e-16, 1.0), None, "what rounding leaves is no direction");
        let curve = sample(Vector3::y() * 2e-3, 1.5).unwrap();
        assert_eq!(curve, [[0.0, 84.0], [1e-16, 84.0], [2e-3, 126.0]]);
        let curve = sample(Vector3::zeros(), 1.0).unwrap();
        assert_eq!(curve[3], [0.0, 84.0], "back at rest, along the way by which it came");
        let table = trace.table();
        assert!(
            table.lines().skip(1).all(|row| row.split(',').nth(6) == Some("")),
            "no turn, no torque: {table}"
        );
    }

    /// Twisted, it is torque over turn: of a square section M = 0.1406 G s⁴ θ / L (Timoshenko and Goodier, section 109), with the
    /// ends' warping held and a coarse mesh some per cent more.
    #[test]
    fn a_twisted_bar_shows_torque_over_turn() {
        let [length, side] = BAR;
        let twists: Vec<ControlPose> = (1..=4)
            .map(|k| {
                let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.01 * f64::from(k));
                ControlPose { matrix: *turn.matrix(), ..ControlPose::REST }
            })
            .collect();
        let (_, world) = held("rotation", &twists);
        assert_eq!((plot(&world).x.unit, plot(&world).y.unit), ("°", "N·m"));
        let [x, y] = plot(&world).now.unwrap();
        assert!((x - 0.04f64.to_degrees()).abs() < 1e-9, "{x}°");
        let thin = 0.1406 * (YOUNG / 2.0) * side.powi(4) * 0.04 / length;
        assert!((1.0..1.6).contains(&(y / thin)), "{y} N·m, {thin} N·m of a long bar");
    }

    /// The band is as wide as the measured errors of model and mesh, and there is none beyond the range in which they were measured, nor
    /// where the mesh's is not known.
    #[test]
    fn the_band_is_as_wide_as_the_measured_error() {
        use crate::deform::{ErrorsAt, ExpectedErrors, MeshErrors, MotionErrors, MovedErrors, TurnErrors};
        use std::sync::Arc;
        let (_, mut world) = held("linear", &[]);
        let at = |angle: f64, stretch: f64| ErrorsAt {
            angle,
            turn: 0.1,
            stretch,
            off: 0.01,
            force: Some(0.2),
            torque: Some(0.4),
            shape: 0.0,
        };
        let all = || vec![at(1.0, 0.02)];
        let turned = TurnErrors { bent: all(), twisted: all(), both: all(), about: vec![] };
        let moved = MovedErrors {
            control: "right".into(),
            model: MotionErrors { turned, shifted: all(), ..MotionErrors::default() },
            mesh: Some(MeshErrors { wrench: 0.1, shape: 0.0, stiffness: None, loads: Vec::new() }),
            ..MovedErrors::default()
        };
        let body = &mut world.bodies[0];
        let shown_of = |moved: MovedErrors| {
            let expected = ExpectedErrors { moved: vec![moved], ..ExpectedErrors::default() };
            BodyFrame { expected: Some(Arc::new(expected)), ..BodyFrame::default() }
        };
        let shown = shown_of(moved.clone());
        let mut trace = Trace::new((0, 1), body, &shown);
        for strain in [0.005, 0.009, 0.3] {
            let translation = Vector3::x() * (strain * BAR[0]);
            body.deformer.evaluate(&[ControlPose::REST, ControlPose { translation, ..ControlPose::REST }]);
            trace.take(body, &shown, 0.0);
        }
        let bands = trace.bands();
        let known: Vec<&[f64; 3]> = bands.iter().flatten().collect();
        assert_eq!(known.len(), 2, "beyond what was measured there is none");
        for ([x, low, high], [at, force]) in known.iter().zip(&trace.curves()[0]) {
            assert!(x == at && ((high - low) / force - 0.6).abs() < 1e-9, "{low} N to {high} N of {force} N");
        }
        assert!(trace.error_line()[0].0.contains("beyond"));
        let translation = Vector3::x() * (0.008 * BAR[0]);
        body.deformer.evaluate(&[ControlPose::REST, ControlPose { translation, ..ControlPose::REST }]);
        trace.take(body, &shown, 0.0);
        let lengths: Vec<usize> = trace.bands().iter().map(Vec::len).filter(|length| *length > 0).collect();
        assert_eq!(lengths, [2, 1], "no band lies across what was not measured");

        let shown = shown_of(MovedErrors { mesh: None, ..moved });
        let mut trace = Trace::new((0, 1), body, &shown);
        trace.take(body, &shown, 0.0);
        assert!(trace.bands().iter().all(Vec::is_empty), "a part of the error is not the error");
        assert!(trace.error_line()[0].0.contains("the mesh's part is not known"), "{:?}", trace.error_line());
    }
}
