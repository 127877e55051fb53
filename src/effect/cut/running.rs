//! The effect in a world: blades, and the bodies that they cut, from frame to frame.

use super::blade::{Blade, Sweep, Swept};
use super::body::{CutBody, Seen};
use super::carried::Carriers;
use super::fallen::Falling;
use super::landing::Obstacle;
use super::recall::BodyMemory;
use super::resistance::Resistance;
use super::settings::{NAME, Settings};
use super::shown;
use crate::base::extent::extent;
use crate::base::failure::Failure;
use crate::base::quantity::quantity;
use crate::deform::Contribution;
use crate::effect::entry::{EffectInput, ResolvedBody};
use crate::green::GreenFile;
use crate::render::{Drawable, Formed};
use crate::world::inertia::Inertia;
use crate::world::running::{Memory, read, written};
use crate::world::tool::Tool;
use crate::world::{BodyFrame, Frame, Highlight, PlacedBody, RunningEffect, World};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Radii of a body from its middle at rest, beyond the way of its elements, to which it may reach.
const FAR: f64 = 4.0;
/// Part of a body's extent by which a blade beside it counts as near: it may move so far in a frame.
const BESIDE: f64 = 0.25;
/// Frames without a cut after which a stroke of the blades has ended.
const QUIET: u32 = 20;
/// Time since the first frame within which a blade's stylus should be seen, s.
const SEEN_S: f64 = 2.0;

struct Cuts {
    blades: Vec<Blade>,
    bodies: Vec<CutBody>,
    /// Tools on which pieces land, with their friction on each body.
    tools: Vec<(Tool, Vec<Option<f64>>)>,
    /// Hands that carry pieces.
    hands: Carriers,
    /// Pose of each blade and of each tool in the last frame.
    last: Vec<Option<Isometry3<f64>>>,
    last_of_tools: Vec<Option<Isometry3<f64>>>,
    /// Time of the last frame, s.
    last_s: Option<f64>,
    /// Frames since something was cut or worked out, [`QUIET`] at most.
    quiet: u32,
    /// Whether a stroke has begun of which the world does not know yet.
    has_begun: bool,
    warnings: Vec<String>,
    /// Time of the first frame, s.
    first_s: Option<f64>,
}

/// All that lasts from frame to frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Memorised {
    blades: Vec<Posed>,
    tools: Vec<Posed>,
    bodies: Vec<BodyMemory>,
    hands: Carriers,
    quiet: u32,
    #[serde(with = "crate::field::numbers::flat")]
    last_s: Vec<f64>,
}

/// Pose of a blade that was there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
struct Posed(#[serde(with = "crate::field::numbers::option")] Option<Isometry3<f64>>);

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let blades: Vec<Blade> =
        listed.scene.tool.iter().filter_map(|(name, tool)| Blade::new(name, tool)).collect();
    let mut bodies = Vec::new();
    for &(b, name) in &listed.bodies {
        let file = world.bodies[b].deformer.file().clone();
        let resolved = &listed.scene.bodies[name];
        let toughness = Settings::of(resolved).toughness;
        let is_felt = resolved.entries().any(|effect| effect.is_felt);
        let wrong = |message: String| Failure::request(anyhow::anyhow!("body.{name}: {message}"));
        let mut body = CutBody::new(b, name, file, (toughness, blades.len(), is_felt)).map_err(wrong)?;
        body.is_heard = resolved.entries().any(|effect| effect.is_heard);
        bodies.push(body);
    }
    let mut tools = Vec::new();
    for (name, tool) in listed.scene.tool.iter().filter(|(_, tool)| !tool.shape.is_blade()) {
        let of = |(_, body): &(usize, &str)| friction(listed.scene.bodies.get(*body)?, name);
        let frictions: Vec<Option<f64>> = listed.bodies.iter().map(of).collect();
        if frictions.iter().any(Option::is_some) {
            tools.push((Tool::new(listed.scene, name, tool)?, frictions));
        }
    }
    Ok(Some(Box::new(Cuts {
        last: vec![None; blades.len()],
        last_of_tools: vec![None; tools.len()],
        last_s: None,
        blades,
        bodies,
        tools,
        hands: Carriers::default(),
        quiet: QUIET,
        has_begun: false,
        warnings: Vec::new(),
        first_s: None,
    })))
}

/// Friction of the tool of this name on a body, if an effect lets it touch the body.
fn friction(body: &ResolvedBody, tool: &str) -> Option<f64> {
    body.effects.iter().find_map(|listed| listed.entry.friction?(body, tool))
}

/// Whether the edge of a blade comes near the body as it is shown.
fn is_near(sweep: &Sweep, body: &PlacedBody) -> bool {
    let reach = sweep.low_and_high();
    // Where it is surely far, the places of the nodes need not be known.
    let (centre, radius) = body.assets.ball;
    let moved = body.deformer.poses.iter().map(|pose| pose.translation.norm()).fold(0.0, f64::max);
    let far = (FAR * radius + moved) * body.room_from_body.scaling();
    let middle = (body.room_from_body * centre).coords;
    if (0..3).any(|k| reach[0][k] > middle[k] + far || reach[1][k] < middle[k] - far) {
        return false;
    }
    let room_from_surface = body.room_from_surface();
    let places = body.deformer.positions();
    let places = places.iter().map(|x| (room_from_surface * Point3::from(V3::from(x.map(f64::from)))).coords);
    let Some((low, high)) = extent(places) else {
        return false;
    };
    let more = (high - low) * BESIDE;
    (0..3).all(|k| reach[0][k] <= high[k] + more[k] && reach[1][k] >= low[k] - more[k])
}

impl Cuts {
    /// The ways of the blades since the last frame.
    fn sweep(&mut self, world: &World) -> Vec<Swept> {
        let poses: Vec<_> = self.blades.iter().map(|blade| blade.place.pose(world)).collect();
        let way = |blade: usize| {
            let (last, now) = self.last[blade].zip(poses[blade])?;
            let [from, to] = [last, now].map(|pose| self.blades[blade].edge(&pose));
            Some(Swept { blade, room_from_blade: now, sweep: Sweep { from, to } })
        };
        let swept = (0..poses.len()).filter_map(way).collect();
        self.last = poses;
        swept
    }

    /// Moves pieces that have fallen off on to this frame.
    fn let_fall(&mut self, world: &World) {
        let now_s = Some(*world.graph.get(world.fields.time)).filter(|now| now.is_finite());
        let dt_s = self.last_s.zip(now_s).map_or(0.0, |(last, now)| now - last);
        let poses: Vec<_> = self.tools.iter().map(|(tool, _)| tool.place.pose(world)).collect();
        self.bodies.iter_mut().for_each(|body| body.follow(&world.bodies[body.b].room_from_body));
        let pieces = self.bodies.iter().enumerate().flat_map(|(number, body)| {
            let scale = world.bodies[body.b].room_from_body.scaling();
            body.fallen().iter().map(move |piece| ((number, piece.corner), piece.target(scale)))
        });
        self.hands.see(world, &pieces.collect::<Vec<_>>());
        for (number, body) in self.bodies.iter_mut().enumerate() {
            let tools = self.tools.iter().zip(self.last_of_tools.iter().zip(&poses));
            let there = tools.filter_map(|((tool, frictions), (last, now))| {
                let (friction, to) = frictions[number].zip(*now)?;
                Some(Obstacle { shape: &tool.shape, from: last.unwrap_or(to), to, friction })
            });
            let obstacles: Vec<Obstacle<'_>> = there.collect();
            let gravity = gravity(world, body.b);
            let scale = world.bodies[body.b].room_from_body.scaling();
            let carried = self.hands.of_body(number, world);
            body.fall(&Falling { dt_s, gravity, scale, obstacles: &obstacles, carried: &carried });
        }
        (self.last_of_tools, self.last_s) = (poses, now_s);
    }
}

/// Acceleration by the gravity that acts on a body now, along the room's axes, m/s².
fn gravity(world: &World, body: usize) -> Option<V3> {
    let loads = world.graph.get(world.fields.bodies[body].loads?);
    let axes = loads.0.get(..3).filter(|_| world.bodies[body].assets.has_gravity)?;
    Some(V3::from_column_slice(axes))
}

impl RunningEffect for Cuts {
    fn name(&self) -> &'static str {
        NAME
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(
        &mut self,
        world: &World,
        _contributions: &mut [Contribution],
        _inertias: &mut [&mut dyn Inertia],
    ) {
        self.warnings.clear();
        let swept = self.sweep(world);
        self.let_fall(world);
        let shapes: Vec<Seen> = self.bodies.iter_mut().map(|body| body.see(world)).collect();
        let arrived: Vec<_> = self.bodies.iter_mut().map(CutBody::arrive).collect();
        let is_over = self.quiet == QUIET && self.bodies.iter().all(CutBody::is_idle);
        for ((body, now), arrived) in self.bodies.iter_mut().zip(shapes).zip(arrived) {
            let placed = &world.bodies[body.b];
            let near: Vec<&Swept> = swept.iter().filter(|swept| is_near(&swept.sweep, placed)).collect();
            let passed = body.pass(&near, now);
            let done = passed.as_deref().unwrap_or_default();
            body.resist(&near, done, placed.room_from_body.scaling());
            for message in [arrived, passed.map(drop)].into_iter().filter_map(Result::err) {
                let name = &body.whole.name;
                self.warnings.push(format!("body.{name}: what a blade passes here stays uncut: {message}"));
            }
        }
        let is_quiet = self.bodies.iter().all(CutBody::is_idle);
        if is_over && !is_quiet {
            self.bodies.iter_mut().for_each(CutBody::begin_stroke);
            self.has_begun = true;
        }
        self.quiet = if is_quiet { (self.quiet + 1).min(QUIET) } else { 0 };
        self.bodies.iter_mut().for_each(CutBody::begin);
    }

    fn has_begun(&mut self) -> bool {
        std::mem::take(&mut self.has_begun)
    }

    fn undo(&mut self) -> Result<(), String> {
        self.bodies.iter_mut().for_each(CutBody::undo);
        self.quiet = QUIET;
        Ok(())
    }

    fn redo(&mut self) -> Result<(), String> {
        self.quiet = QUIET;
        self.bodies.iter_mut().try_for_each(CutBody::redo)
    }

    fn remade(&mut self) -> Vec<(usize, Arc<GreenFile>)> {
        self.bodies.iter_mut().filter_map(CutBody::remade).collect()
    }

    fn holds(&self, stylus: usize) -> bool {
        self.hands.carries(stylus)
    }

    fn surface(&mut self, world: &World, bodies: &mut [BodyFrame]) {
        self.bodies.iter().for_each(|body| bodies[body.b].dissipation.add(&body.torn));
        for body in self.bodies.iter().filter(|body| body.is_felt) {
            let scale = world.bodies[body.b].room_from_body.scaling();
            for carried in shown::carried(&self.blades, world) {
                let Some(resistance) = body.resistances.get(carried.0) else { continue };
                bodies[body.b].touches.push(shown::touch(body, resistance, carried, scale));
            }
        }
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        frame.warnings.append(&mut self.warnings);
        let now_s = *world.graph.get(world.fields.time);
        if now_s - *self.first_s.get_or_insert(now_s) > SEEN_S {
            let unseen = self.blades.iter().zip(&self.last).filter(|(_, pose)| pose.is_none());
            frame
                .warnings
                .extend(unseen.filter_map(|(blade, _)| blade.place.unseen(&blade.name, SEEN_S, world)));
        }
        for (number, body) in self.bodies.iter().enumerate() {
            let placed = &world.bodies[body.b];
            for piece in body.fallen() {
                let (shape, room_from_shape) = piece.drawn(placed.room_from_body.scaling());
                let color = match self.hands.highlight((number, piece.corner)) {
                    Highlight::Idle => placed.assets.color,
                    highlight => highlight.color(),
                };
                let color = color.linear();
                frame.drawables.push(Drawable::Formed(Formed { shape, room_from_shape, color }));
            }
        }
        for (number, (blade, pose)) in self.blades.iter().zip(&self.last).enumerate() {
            let Some(pose) = pose else { continue };
            blade.place.hide_pen(world, frame);
            shown::force(&self.bodies, (number, blade, pose), world, frame);
            let (shape, color) = (blade.drawn.clone(), blade.color);
            let room_from_shape = pose.to_homogeneous().cast();
            frame.drawables.push(Drawable::Formed(Formed { shape, room_from_shape, color }));
        }
    }

    fn summary(&mut self) -> String {
        let of = |body: &CutBody| {
            let (copies, error) = body.state.outcome?;
            let (name, edges) = (&body.whole.name, body.state.cut.len());
            let work: f64 = body.resistances.iter().map(Resistance::work).sum();
            let work = if body.toughness() > 0.0 {
                format!(", {} of work", quantity(work, "J"))
            } else {
                String::new()
            };
            let fallen = match body.fallen().len() {
                0 => String::new(),
                1 => ", 1 piece has fallen off".to_owned(),
                pieces => format!(", {pieces} pieces have fallen off"),
            };
            Some(format!(
                "{name}: cut across {edges} edges of its mesh, {copies} copies of nodes{work}{fallen}; its equations hold to a part of \
                 {error:.0e}\n"
            ))
        };
        self.bodies.iter().filter_map(of).collect()
    }

    fn memory(&self) -> Option<Memory> {
        written(&Memorised {
            blades: self.last.iter().copied().map(Posed).collect(),
            tools: self.last_of_tools.iter().copied().map(Posed).collect(),
            bodies: self.bodies.iter().map(CutBody::remember).collect(),
            hands: self.hands.clone(),
            quiet: self.quiet,
            last_s: self.last_s.into_iter().collect(),
        })
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let Memorised { blades, tools, bodies, hands, quiet, last_s } = read(memory)?;
        let own = [self.blades.len(), self.tools.len(), self.bodies.len()];
        if [blades.len(), tools.len(), bodies.len()] != own || last_s.len() > 1 {
            return Err("its blades, tools and bodies are those of another scene".to_owned());
        }
        self.last_of_tools = tools.into_iter().map(|Posed(pose)| pose).collect();
        self.last_s = last_s.first().copied();
        self.quiet = quiet.min(QUIET);
        self.hands = hands;
        self.last = blades.into_iter().map(|Posed(pose)| pose).collect();
        for (body, memory) in self.bodies.iter_mut().zip(bodies) {
            body.restore(memory)?;
        }
        Ok(())
    }
}
