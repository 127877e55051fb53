//! The effect `ghost_equilibrium`: static equilibrium at large strain of the very pose in which the body is held, as a ghost over
//! the body, and how far the body's model is from it, in mm. It has the body's loads, and what hands do to points of the surface
//! as the forces that the model has found for them.
//!
//! In: the bodies of a session. Out: ghosts and plates. A thread (`solving`) solves the pose on the whole mesh once the hand
//! rests; every number belongs to the pose that was solved, and the plate says how far the hand has moved on since. Before a
//! picture that is kept the equilibrium is waited for.

mod solving;
#[cfg(test)]
pub(crate) mod tests;

use super::entry::{EffectEntry, EffectInput};
use super::ghost_rest::GhostSurface;
use super::settings;
use crate::base::plates::{Anchor, Plate, Tone};
use crate::base::quantity::quantity;
use crate::deform::{AppliedLoads, ControlPose, ControlPoses, FollowedTurn, PointLoad, Pull, StateAge};
use crate::fem::{Law, STVK};
use crate::render::{Drawable, Ghost};
use crate::scene::Scene;
use crate::world::{Frame, PlacedBody, RunningEffect, World};
use nalgebra::Vector3;
use serde::Deserialize;
use solving::{Answer, PosedBody, Question, Solved, Solving, Subject};
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

/// The effect's name in scenes.
pub const NAME: &str = "ghost_equilibrium";

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: NAME,
    summary: "static equilibrium of the held pose, solved in the background: a ghost over the body, the difference in mm",
    needs_inside: true,
    settings: Some(settings::read::<Settings>),
    attach: Some(|listed, world| Ok(Some(Box::new(EquilibriumGhosts::new(listed, world))))),
    ..EffectEntry::NOTHING
};

/// Linear, and the opacity of the outline of a ghost of the pose as it is.
const COLOR: [f32; 4] = [1.0, 0.35, 0.62, 0.9];
/// The ghost's colour as sRGB, for the plate.
const INK: [u8; 3] = [255, 161, 206];
/// Part of the ghost's opacity that is left where the body covers it.
const THROUGH: f32 = 0.4;
/// A ghost of a pose that has been left is fainter by this.
const OLD: f32 = 0.4;

/// A hand that moves by less than this part of the body's radius in [`REST_FOR`] rests.
const RESTING: f64 = 0.005;
const REST_FOR: Duration = Duration::from_millis(250);
/// An equilibrium is found anew where the pose has moved on by more than this part of the radius, or of the difference.
const MOVED_ON: [f64; 2] = [1e-4, 0.05];

struct EquilibriumGhosts {
    bodies: Vec<WatchedBody>,
}

/// The settings in scenes.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// The law of the equilibrium; that of the body's model where it has one, else `stvk`.
    law: Option<&'static Law>,
}

/// A body whose poses are solved.
struct WatchedBody {
    b: usize,
    law: &'static Law,
    /// The subject with which the thread is started at the first question.
    subject: Option<Subject>,
    solving: Option<Solving>,
    found: Option<LastAnswer>,
    /// The pose and loads in which the hand has rested, and since when.
    resting: (PosedBody, Instant),
}

/// The last answer, with the ghost of an equilibrium.
struct LastAnswer {
    answer: Answer,
    ghost: Option<GhostSurface>,
}

impl EquilibriumGhosts {
    fn new(listed: &EffectInput<'_>, world: &World) -> EquilibriumGhosts {
        let of = |&(b, name): &(usize, &str)| {
            let body = &world.bodies[b];
            let settings: Option<&Settings> = listed.scene.bodies[name].settings(ENTRY.name);
            let asked = settings.and_then(|settings| settings.law);
            let law = asked.or(body.assets.model.law()).unwrap_or(&STVK);
            let tags = body.deformer.tags().to_vec();
            let subject = Subject { scene: Scene::clone(listed.scene), body: name.to_owned(), law, tags };
            let resting = (held(body), Instant::now());
            WatchedBody { b, law, subject: Some(subject), solving: None, found: None, resting }
        };
        EquilibriumGhosts { bodies: listed.bodies.iter().map(of).collect() }
    }
}

impl RunningEffect for EquilibriumGhosts {
    fn name(&self) -> &'static str {
        NAME
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        if world.is_for_pictures {
            return;
        }
        for watched in &mut self.bodies {
            let body = &world.bodies[watched.b];
            watched.take(body, false);
            if watched.rests(body) && watched.is_to_be_solved(body) {
                watched.ask(body);
            }
            watched.show(body, frame);
        }
    }

    fn before_picture(&mut self, world: &World, frame: &mut Frame) {
        for watched in &mut self.bodies {
            let body = &world.bodies[watched.b];
            if watched.is_to_be_solved(body) {
                watched.ask(body);
                watched.take(body, true);
            }
            watched.show(body, frame);
        }
    }
}

impl WatchedBody {
    fn ask(&mut self, body: &PlacedBody) {
        let deformer = &body.deformer;
        if self.solving.is_none()
            && let Some(subject) = self.subject.take()
        {
            self.solving = Solving::start(subject).ok();
        }
        let turns: Vec<FollowedTurn> = (0..deformer.poses.len()).map(|e| deformer.turn(e)).collect();
        let is_beyond = turns.iter().any(|turn| turn.against(&FollowedTurn::REST) > TAU);
        let refused = match &self.solving {
            None => Some("no thread can be started"),
            Some(_) if is_beyond => Some("a control element has turned by more than 360°"),
            Some(_) => None,
        };
        if let Some(why) = refused {
            let answer = Answer { held: held(body), result: Err(why.into()), seconds: 0.0 };
            self.found = Some(LastAnswer { answer, ghost: None });
        } else if let Some(solving) = &mut self.solving {
            solving.ask(Question {
                held: held(body),
                turns: turns.iter().map(|turn| turn.quaternion).collect(),
                by_model: deformer.displacements_of_model(),
            });
        }
    }

    fn take(&mut self, body: &PlacedBody, waits: bool) {
        let Some(answer) = self.solving.as_mut().and_then(|solving| solving.answer(waits)) else { return };
        let ghost = |solved: &Solved| GhostSurface::new(&body.deformer, Some(&solved.displacement));
        let ghost = answer.result.as_ref().ok().map(ghost);
        self.found = Some(LastAnswer { answer, ghost });
    }

    /// Whether the hand rests.
    fn rests(&mut self, body: &PlacedBody) -> bool {
        let (rested, _) = &self.resting;
        if moved(body, &rested.poses) > RESTING * body.assets.ball.1
            || is_loaded_otherwise(body, &rested.loads)
        {
            self.resting = (held(body), Instant::now());
        }
        self.resting.1.elapsed() > REST_FOR
    }

    /// Whether the pose is another than that of the last answer, and its state the model's own.
    fn is_to_be_solved(&self, body: &PlacedBody) -> bool {
        let is_settled = body.deformer.age().is_none_or(|age| age == StateAge::Current);
        is_held(body) && is_settled && self.found.as_ref().is_none_or(|found| found.is_left(body))
    }

    fn show(&self, body: &PlacedBody, frame: &mut Frame) {
        if !is_held(body) {
            return;
        }
        let room_from_shape = body.room_from_body.to_homogeneous().cast();
        let plate = self.plate(body);
        if let Some((found, outlined)) =
            self.found.as_ref().and_then(|found| Some((found, found.ghost.as_ref()?)))
        {
            let [r, g, b, opacity] = COLOR;
            let color = [r, g, b, opacity * if found.is_left(body) { OLD } else { 1.0 }];
            let shape = outlined.shape.clone();
            for over in [false, true] {
                let edges = outlined.lines(&room_from_shape, color, over).collect();
                frame.drawables.push(Drawable::Lines(edges));
            }
            frame.drawables.push(Drawable::Ghost(Ghost { shape, room_from_shape, color, through: THROUGH }));
        }
        frame.drawables.push(Drawable::Plate(plate));
    }

    fn plate(&self, body: &PlacedBody) -> Plate {
        let name = &body.deformer.body;
        let mut lines = Vec::new();
        if let Some(found) = &self.found {
            lines.extend(found.lines(body, self.law));
        } else {
            lines.push(vec![(format!("{name}: static equilibrium, {}", self.law.title), Tone::Own(INK))]);
        }
        let is_due = self.found.as_ref().is_none_or(|found| found.is_left(body));
        match &self.solving {
            Some(Solving { asked: Some(since), .. }) => lines.push(vec![(
                format!(
                    "solving, {:.0} %, {:.1} s",
                    100.0 * self.solving.as_ref().map_or(0.0, Solving::share),
                    since.elapsed().as_secs_f64()
                ),
                Tone::Fair,
            )]),
            _ if is_due => lines.push(vec![("is solved once the hand rests".into(), Tone::Quiet)]),
            _ => {}
        }
        Plate { anchor: Anchor::LowerLeft, lines, plot: None, legend: None }
    }
}

impl LastAnswer {
    /// Whether the body is no longer where this belongs to.
    fn is_left(&self, body: &PlacedBody) -> bool {
        let difference = self.answer.result.as_ref().map_or(0.0, |solved| solved.largest_m);
        let bounds = [MOVED_ON[0] * body.assets.ball.1, MOVED_ON[1] * difference];
        moved(body, &self.answer.held.poses) > bounds[0].max(bounds[1])
            || is_loaded_otherwise(body, &self.answer.held.loads)
    }

    fn lines(&self, body: &PlacedBody, law: &Law) -> Vec<Vec<(String, Tone)>> {
        let (name, model) = (&body.deformer.body, body.assets.model.name);
        let away = moved(body, &self.answer.held.poses);
        let is_old = self.is_left(body);
        // What is a millionth of the body away is the same pose, to rounding.
        let (of, was) = match away {
            _ if is_loaded_otherwise(body, &self.answer.held.loads) => ("under other loads".into(), "was"),
            away if is_old => (format!("of a pose {} away", quantity(away, "m")), "was"),
            away if away > 1e-6 * body.assets.ball.1 => {
                (format!("of this pose within {}", quantity(away, "m")), "is")
            }
            _ => ("of this pose".into(), "is"),
        };
        let tone = if is_old { Tone::Quiet } else { Tone::Own(INK) };
        match &self.answer.result {
            Ok(Solved { largest_m, rms_m, .. }) => {
                let [largest, rms] = [largest_m, rms_m].map(|m| quantity(*m, "m"));
                let found = format!("{}, found in {:.1} s", law.title, self.answer.seconds);
                let off = format!("the model {model} {was} off by {largest} at most, {rms} RMS");
                vec![
                    vec![(format!("{name}: static equilibrium {of}"), tone)],
                    vec![(found, Tone::Quiet)],
                    vec![(off, told(tone)), (" over the surface".into(), Tone::Quiet)],
                ]
            }
            Err(why) => vec![vec![
                (format!("{name}: no static equilibrium {of} found, {}: ", law.title), Tone::Bad),
                (why.clone(), Tone::Quiet),
            ]],
        }
    }
}

fn told(head: Tone) -> Tone {
    if head == Tone::Quiet { Tone::Quiet } else { Tone::Plain }
}

/// The poses and loads of the body now.
fn held(body: &PlacedBody) -> PosedBody {
    PosedBody { poses: body.deformer.poses.clone(), loads: body.deformer.acting() }
}

/// Whether it is anything but at rest.
fn is_held(body: &PlacedBody) -> bool {
    let loads = body.deformer.acting();
    body.deformer.poses.iter().any(|pose| *pose != ControlPose::REST)
        || !loads.points.is_empty()
        || loads.coefficients.iter().any(|load| *load != 0.0)
}

/// Whether other loads act on the body now than `then`, by more than a hand at rest trembles.
fn is_loaded_otherwise(body: &PlacedBody, then: &AppliedLoads) -> bool {
    let now = body.deformer.acting();
    let differs = |now: &[f64], then: &[f64]| {
        let size = |values: &[f64]| values.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
        let apart: Vec<f64> = now.iter().zip(then).map(|(now, then)| now - then).collect();
        now.len() != then.len() || size(&apart) > RESTING * size(now).max(size(then))
    };
    let force = |point: &PointLoad| match point.pull {
        Pull::Force(force) => force,
        Pull::Towards { place, .. } => place,
    };
    let is_elsewhere = |(now, then): (&PointLoad, &PointLoad)| {
        now.nodes != then.nodes || differs(force(now).as_slice(), force(then).as_slice())
    };
    let mut at = 0;
    let mut own = |columns: usize| {
        at += columns;
        at - columns..at
    };
    let all: Vec<_> = body.deformer.load_metas().iter().map(|meta| own(meta.columns)).collect();
    let of = |loads: &[f64], columns: std::ops::Range<usize>| loads.get(columns).unwrap_or(&[]).to_vec();
    all.into_iter().any(|load| differs(&of(&now.coefficients, load.clone()), &of(&then.coefficients, load)))
        || now.points.len() != then.points.len()
        || now.points.iter().zip(&then.points).any(is_elsewhere)
}

/// Largest displacement of a control element's surface nodes since these poses, m.
fn moved(body: &PlacedBody, since: &ControlPoses) -> f64 {
    let deformer = &body.deformer;
    let of = |e: usize| {
        let (now, then) = (&deformer.poses[e], &since[e]);
        if now == then {
            return 0.0;
        }
        let (shift, turn) = (now.translation - then.translation, now.matrix - then.matrix);
        let origin = deformer.controls[e].origin;
        let at = |node: &u32| Vector3::from(deformer.rest()[*node as usize]).cast::<f64>() - origin;
        let nodes = deformer.control_nodes(e).iter().map(|node| (shift + turn * at(node)).norm());
        nodes.fold(shift.norm(), f64::max)
    };
    (0..deformer.poses.len()).map(of).fold(0.0, f64::max)
}
