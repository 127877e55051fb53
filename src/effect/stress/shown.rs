//! The field in a session: codes of vertices, legend, probe, warnings and closing words.

use super::stressed_body::{NAME, Peaks, StressedBody, share, written as limit_words};
use crate::base::failure::Failure;
use crate::base::legend::{Legend, LegendLine, round_up};
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::deform::NodeStress;
use crate::effect::entry::EffectInput;
use crate::render::{Drawable, field_code};
use crate::scene::{LegendSettings, Quantity};
use crate::world::running::{Memory, read, written};
use crate::world::{BodyFrame, Frame, PlacedBody, RunningEffect, SurfacePoint, World, is_beyond_model};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Joins a new world.
pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let mut bodies = Vec::new();
    for &(index, name) in &listed.bodies {
        let stressed = StressedBody::of_file(listed.scene, listed.file, name)?;
        bodies.push(ShownBody {
            index,
            name: name.to_owned(),
            stressed,
            deformations: None,
            nodes: Vec::new(),
            displacement: Vec::new(),
            now: Peaks::default(),
            is_beyond: false,
            was_beyond: false,
            worst: Peaks::default(),
            codes: Arc::default(),
            is_heard: listed.scene.bodies[name].entries().any(|effect| effect.is_heard),
        });
    }
    let settings = listed.scene.legend.unwrap_or_default();
    let first_tops = tops(listed, &settings, &bodies, world);
    let shown = Shown { settings, first_tops, tops: first_tops, bodies, coded: None };
    Ok(Some(Box::new(shown)))
}

/// The end of the colours of one quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Top {
    Asked(f64),
    Limit(f64),
    /// The largest value so far.
    Seen(f64),
}

impl Top {
    fn value(self) -> f64 {
        match self {
            Top::Asked(to) | Top::Limit(to) | Top::Seen(to) => to,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Top::Asked(_) => "as the scene has it",
            Top::Limit(_) => "the limit",
            Top::Seen(_) => "largest so far (C: reset)",
        }
    }
}

/// Strain at the first end of the colours, where nothing is asked for; displacements begin with this part of the body's size.
const FIRST_STRAIN: f64 = 1e-3;

fn tops(
    listed: &EffectInput<'_>,
    settings: &LegendSettings,
    bodies: &[ShownBody],
    world: &World,
) -> [Top; 3] {
    Quantity::ALL.map(|quantity| {
        let limits = bodies.iter().flat_map(|body| limits_of(&body.stressed, quantity));
        let limit = limits.reduce(f64::max);
        match (settings.to.filter(|_| settings.show == quantity), limit) {
            (Some(to), _) => Top::Asked(to),
            (None, Some(limit)) => Top::Limit(limit),
            (None, None) => {
                let of_body = |&(b, name): &(usize, &str)| match quantity {
                    Quantity::VonMises => listed.scene.body[name].material.young,
                    Quantity::Strain => 1.0,
                    Quantity::Displacement => 2.0 * world.bodies[b].assets.ball.1,
                };
                let largest = listed.bodies.iter().map(of_body).fold(0.0, f64::max);
                Top::Seen(round_up(FIRST_STRAIN * largest))
            }
        }
    })
}

fn limits_of(body: &StressedBody, quantity: Quantity) -> impl Iterator<Item = f64> {
    body.limits.iter().flatten().filter(move |limit| limit.quantity() == quantity).map(|limit| limit.value())
}

/// A body in colours.
struct ShownBody {
    /// Index in the world.
    index: usize,
    name: String,
    stressed: StressedBody,
    /// The number of deformations for which the members below were computed.
    deformations: Option<u64>,
    nodes: Vec<Option<NodeStress>>,
    /// Displacement of each node from rest, m.
    displacement: Vec<f64>,
    now: Peaks,
    /// Bent beyond its model: its values are shown, but count for nothing.
    is_beyond: bool,
    was_beyond: bool,
    /// The most of the session.
    worst: Peaks,
    /// The code of every node.
    codes: Arc<Vec<[u8; 4]>>,
    /// Whether another effect makes the body heard.
    is_heard: bool,
}

/// The memory from one frame to the next: the ends of the colours, and the most that each body has reached.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StressMemory {
    tops: [Top; 3],
    /// Whether a body was bent beyond its model, and its worst.
    bodies: Vec<(bool, Peaks)>,
}

struct Shown {
    settings: LegendSettings,
    /// The ends with which a session begins.
    first_tops: [Top; 3],
    tops: [Top; 3],
    bodies: Vec<ShownBody>,
    /// Quantity and end for which the codes were made.
    coded: Option<(Quantity, f64)>,
}

impl ShownBody {
    /// Whether the body was deformed since.
    fn update(&mut self, body: &PlacedBody) -> bool {
        if self.deformations.replace(body.deformations) == Some(body.deformations) {
            return false;
        }
        let deformer = &body.deformer;
        self.nodes = self.stressed.stress(deformer);
        self.displacement = (0..deformer.node_count()).map(|i| deformer.displacement(i).norm()).collect();
        self.now = self.stressed.reached(&self.nodes);
        self.is_beyond = is_beyond_model(body);
        self.was_beyond |= self.is_beyond;
        let part = |reached: &Peaks| reached.limit.map_or(0.0, |(part, _)| part);
        let is_worse = part(&self.now) > part(&self.worst)
            || part(&self.worst) == 0.0 && self.now.von_mises.0 > self.worst.von_mises.0;
        if is_worse && !self.is_beyond {
            self.worst = self.now;
        }
        true
    }

    /// `None` where no value is known.
    fn value(&self, quantity: Quantity, node: usize) -> Option<f64> {
        match quantity {
            Quantity::Displacement => self.displacement.get(node).copied(),
            Quantity::VonMises => self.nodes[node].map(|at| at.von_mises),
            Quantity::Strain => self.nodes[node].map(|at| at.strain),
        }
    }

    fn largest(&self, quantity: Quantity) -> f64 {
        (0..self.nodes.len()).filter_map(|node| self.value(quantity, node)).fold(0.0, f64::max)
    }

    fn coded(&self, quantity: Quantity, top: f64) -> Vec<[u8; 4]> {
        let code = |node: usize| {
            let part = self.nodes[node].map_or(0.0, |at| share(&at, &self.stressed.limits));
            field_code(self.value(quantity, node).unwrap_or(0.0) / top, part)
        };
        (0..self.nodes.len()).map(code).collect()
    }

    /// The value at a point of its surface; `None` inside a control element.
    fn probed(&self, point: &SurfacePoint, quantity: Quantity) -> Option<f64> {
        let corners = point.corners.iter().zip(point.weights);
        corners.map(|(node, weight)| Some(self.value(quantity, *node as usize)? * weight)).sum()
    }
}

impl Shown {
    /// Lets the colours reach the largest values that models hold for.
    fn grow(&mut self) {
        for quantity in Quantity::ALL {
            let good = self.bodies.iter().filter(|body| !body.is_beyond);
            let largest = good.map(|body| body.largest(quantity)).fold(0.0, f64::max);
            if let Top::Seen(top) = &mut self.tops[quantity as usize] {
                *top = top.max(round_up(largest));
            }
        }
    }

    fn quantity(&self, world: &World) -> Quantity {
        let first = Quantity::ALL.iter().position(|quantity| *quantity == self.settings.show).unwrap_or(0);
        Quantity::ALL[(first + world.field_changes) % Quantity::ALL.len()]
    }

    fn legend(&self, world: &World, quantity: Quantity) -> Legend {
        let top = self.tops[quantity as usize];
        let mut lines = Vec::new();
        for shown in &self.bodies {
            let name = &shown.name;
            let text = match shown.now.limit.filter(|(part, _)| *part > 1.0) {
                _ if shown.is_beyond => {
                    format!("{name}: deformed too far for its model, values not reliable")
                }
                Some((_, limit)) => format!("{name}: {}", shown.now.brief(limit)),
                None => format!("{name}: at most {}", written_value(shown.largest(quantity), quantity)),
            };
            lines.push(LegendLine { text, warns: shown.is_beyond || shown.now.is_beyond() });
        }
        lines.sort_by_key(|line| !line.warns);
        let warns = false;
        let points = world.pointed_surfaces();
        let probed = points.iter().filter_map(|point| self.probe(quantity, point));
        lines.extend(probed.map(|text| LegendLine { text, warns }));
        let mut limits: Vec<f64> =
            self.bodies.iter().flat_map(|body| limits_of(&body.stressed, quantity)).collect();
        limits.sort_by(f64::total_cmp);
        limits.dedup();
        Legend {
            title: quantity.title().to_owned(),
            unit: quantity.unit().to_owned(),
            to: top.value(),
            range: top.words().to_owned(),
            limits,
            has_limit: self.bodies.iter().any(|body| body.stressed.limits.iter().any(Option::is_some)),
            lines,
        }
    }

    /// Words for the point at which a ray points.
    fn probe(&self, quantity: Quantity, point: &SurfacePoint) -> Option<String> {
        Some(match self.bodies.iter().find(|body| body.index == point.body)?.probed(point, quantity) {
            Some(value) => format!("under the ray: {}", written_value(value, quantity)),
            None => "under the ray: no value, a held part".to_owned(),
        })
    }
}

fn written_value(value: f64, of: Quantity) -> String {
    quantity(value, of.unit())
}

impl RunningEffect for Shown {
    fn name(&self) -> &'static str {
        NAME
    }

    fn surface(&mut self, world: &World, bodies: &mut [BodyFrame]) {
        let shown = self.quantity(world);
        let mut is_new = false;
        for body in &mut self.bodies {
            is_new |= body.update(&world.bodies[body.index]);
        }
        if is_new {
            self.grow();
        }
        let coded = (shown, self.tops[shown as usize].value());
        if is_new || self.coded.replace(coded) != Some(coded) {
            self.coded = Some(coded);
            self.bodies.iter_mut().for_each(|body| body.codes = Arc::new(body.coded(shown, coded.1)));
        }
        for body in &self.bodies {
            let of_body = &mut bodies[body.index];
            of_body.colours = Some(body.codes.clone());
            of_body.largest = body.is_heard.then(|| Quantity::ALL.map(|quantity| body.largest(quantity)));
        }
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        for body in self.bodies.iter().filter(|body| !body.is_beyond) {
            if let Some((_, limit)) = body.now.limit.filter(|(part, _)| *part > 1.0) {
                let name = &body.name;
                frame.warnings.push(format!(
                    "body.{name}: its limit of {} ({}) is passed: what yields or tears is not computed",
                    limit_words(limit),
                    limit.quantity().title()
                ));
            }
        }
        let legend = Some(self.legend(world, self.quantity(world)));
        let plate = Plate { anchor: Anchor::LowerRight, lines: Vec::new(), plot: None, legend };
        frame.drawables.push(Drawable::Plate(plate));
    }

    fn memory(&self) -> Option<Memory> {
        let bodies = self.bodies.iter().map(|body| (body.was_beyond, body.worst)).collect();
        written(&StressMemory { tops: self.tops, bodies })
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let StressMemory { tops, bodies } = read(memory)?;
        if bodies.len() != self.bodies.len() {
            return Err(format!("it has {} bodies, the scene has {}", bodies.len(), self.bodies.len()));
        }
        self.tops = tops;
        for (body, (was_beyond, worst)) in self.bodies.iter_mut().zip(bodies) {
            (body.was_beyond, body.worst, body.deformations) = (was_beyond, worst, None);
        }
        Ok(())
    }

    fn clear(&mut self) {
        self.tops = self.first_tops;
        self.grow();
    }

    fn summary(&mut self) -> String {
        let line = |body: &ShownBody| {
            let left_out =
                if body.was_beyond { "; poses beyond the range of its model are left out" } else { "" };
            format!("body.{}: {}{left_out}\n", body.name, body.worst.sentence())
        };
        self.bodies.iter().map(line).collect()
    }
}
