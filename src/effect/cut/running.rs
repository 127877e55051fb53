//! The effect in a world: blades, and the bodies that they cut, from frame to frame.

use super::blade::{Blade, Sweep};
use super::opened::{Cuttable, Moved, Shape, Tables};
use super::opening::{CutStep, Opening, State, Whole};
use super::settings::NAME;
use crate::base::failure::Failure;
use crate::deform::{AppliedLoads, Contribution, Deformer, Pull};
use crate::effect::entry::EffectInput;
use crate::green::{GreenFile, LOAD_COMPLIANCE, REACTION, VOLUME, Volume};
use crate::mesh::split::CutEdges;
use crate::render::{Drawable, Formed};
use crate::world::inertia::Inertia;
use crate::world::running::{Memory, read, written};
use crate::world::{Frame, PlacedBody, RunningEffect, World};
use nalgebra::{Isometry3, Point3, Similarity3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// A blade farther from the middle of a body than so many of its radii is not near it.
const FAR: f64 = 4.0;
/// Part of a body's extent by which a blade beside it counts as near: it may move so far in a frame.
const BESIDE: f64 = 0.25;
/// Time since the first frame within which a blade's stylus should be seen, s.
const SEEN_S: f64 = 2.0;

struct Cuts {
    blades: Vec<Blade>,
    bodies: Vec<CutBody>,
    /// Pose of each blade in the last frame.
    last: Vec<Option<Isometry3<f64>>>,
    warnings: Vec<String>,
    /// Time of the first frame, s.
    first_s: Option<f64>,
}

struct CutBody {
    b: usize,
    whole: Whole,
    edges: Vec<[u32; 2]>,
    /// The body as it is cut now.
    state: State,
    /// Steps in which it was cut; the last bits of the columns depend on them.
    steps: Vec<CutStep>,
    /// The next step, which is being worked out.
    opening: Option<Opening>,
    /// Edges that blades have passed since that step began, and all that are or will be cut.
    more: CutStep,
    cut: CutEdges,
    /// Shape in the last frame.
    seen: Option<Seen>,
    /// Places of all nodes in a shape, and the motion with which they were found.
    placed: Option<(Seen, Arc<Moved>, Vec<V3>)>,
    /// The file that has the new surface, until the world takes it.
    remade: Option<Arc<GreenFile>>,
}

/// Coefficients and motion from which the places of a body's nodes follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seen {
    #[serde(with = "crate::field::numbers::flat")]
    coefficients: Vec<f64>,
    /// Forces at nodes of the mesh along the axes of the columns, N. One at a point of a cut counts at the node on its side.
    forces: Vec<Force>,
    #[serde(with = "crate::field::numbers")]
    room_from_columns: Similarity3<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Force {
    node: u32,
    #[serde(with = "crate::field::numbers")]
    force: V3,
}

/// All that lasts from frame to frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Memorised {
    blades: Vec<Posed>,
    bodies: Vec<BodyMemory>,
}

/// Pose of a blade that was there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
struct Posed(#[serde(with = "crate::field::numbers::option")] Option<Isometry3<f64>>);

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BodyMemory {
    steps: Vec<CutStep>,
    opening: Option<Begun>,
    more: CutStep,
    seen: Option<Seen>,
}

/// A step that is being worked out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Begun {
    step: CutStep,
    /// Frames until it is taken.
    left: u32,
}

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let blades: Vec<Blade> =
        listed.scene.tool.iter().filter_map(|(name, tool)| Blade::new(name, tool)).collect();
    let mut bodies = Vec::new();
    for &(b, name) in &listed.bodies {
        let file = world.bodies[b].deformer.file().clone();
        let wrong = |message: String| Failure::request(anyhow::anyhow!("body.{name}: {message}"));
        bodies.push(CutBody::new(b, name, file).map_err(wrong)?);
    }
    let last = vec![None; blades.len()];
    Ok(Some(Box::new(Cuts { blades, bodies, last, warnings: Vec::new(), first_s: None })))
}

impl CutBody {
    fn new(b: usize, name: &str, file: Arc<GreenFile>) -> Result<CutBody, String> {
        let meta = file.meta.bodies.get(name).ok_or("the file does not have it")?;
        let names: Vec<&str> = meta.controls.iter().map(|control| control.name.as_str()).collect();
        let volume = Volume::read(&|table| file.table(name, table), names.len())?;
        let lacks = || format!("its file has no numbers of the family {}", VOLUME.name);
        let stiffness = file.stiffness(name).ok_or_else(lacks)?;
        let weight = match meta.loads.is_empty() {
            true => None,
            false => file.table(name, REACTION).zip(file.table(name, LOAD_COMPLIANCE)).map(Into::into),
        };
        let tables = Tables { stiffness, weight, takes_points: file.compliance(name).is_some() };
        let cuttable = Arc::new(Cuttable::new(volume, &names, V3::from(meta.centre), tables)?);
        let whole = Whole { name: name.to_owned(), file, cuttable };
        Ok(CutBody {
            b,
            edges: whole.cuttable.edges(),
            state: whole.state()?,
            whole,
            steps: Vec::new(),
            opening: None,
            more: CutStep::new(),
            cut: CutEdges::new(),
            seen: None,
            placed: None,
            remade: None,
        })
    }

    /// Forces on a deformer's points as forces at nodes of the mesh, along the axes of its columns.
    fn forces_on(&self, deformer: &Deformer) -> Vec<Force> {
        let AppliedLoads { points, .. } = deformer.acting();
        let in_columns = deformer.state.body_from_surface().rotation.inverse();
        let mut all: BTreeMap<u32, V3> = BTreeMap::new();
        for point in points {
            let Pull::Force(force) = point.pull else { continue };
            for (node, weight) in point.nodes.into_iter().zip(point.weights).filter(|(_, w)| *w != 0.0) {
                let Some(node) = self.state.moved.node_of(node) else { continue };
                *all.entry(node).or_default() += in_columns * force * weight;
            }
        }
        all.into_iter().map(|(node, force)| Force { node, force }).collect()
    }

    /// Places of all nodes in the room.
    fn places(&self, seen: &Seen) -> Result<Vec<V3>, String> {
        if let Some((of, moved, places)) = &self.placed
            && of == seen
            && Arc::ptr_eq(moved, &self.state.moved)
        {
            return Ok(places.clone());
        }
        let forces: Vec<_> = seen.forces.iter().map(|at| (at.node, at.force)).collect();
        let shape = Shape { coefficients: &seen.coefficients, forces: &forces };
        let at = self.whole.cuttable.places(&self.state.moved, &shape)?;
        Ok(at.into_iter().map(|x| (seen.room_from_columns * Point3::from(x)).coords).collect())
    }

    /// Cuts what blades have passed through since the last frame. The error says what of it stays uncut, and why.
    fn pass(&mut self, sweeps: &[Sweep], now: Seen) -> Result<(), String> {
        let before = self.seen.replace(now.clone()).unwrap_or_else(|| now.clone());
        if sweeps.is_empty() || (before == now && sweeps.iter().all(Sweep::is_still)) {
            return Ok(());
        }
        let from = self.places(&before)?;
        let to = if before == now { from.clone() } else { self.places(&now)? };
        self.placed = Some((now, self.state.moved.clone(), to.clone()));
        let (mut cut, mut step) = (self.cut.clone(), CutStep::new());
        for sweep in sweeps {
            for (edge, share) in sweep.crossed(&self.edges, (&from, &to)) {
                if self.add(edge, share, &mut cut) {
                    step.push((edge, share));
                }
            }
        }
        if step.is_empty() {
            return Ok(());
        }
        let falls_apart = self.whole.cuttable.split(&cut).falls_apart;
        if falls_apart {
            (step, cut) = self.longest_that_holds(step);
        }
        self.more.extend(step);
        self.cut = cut;
        match falls_apart {
            true => {
                Err("a piece would fall off that no control element holds, or hang on a single node or edge"
                    .to_owned())
            }
            false => Ok(()),
        }
    }

    /// Takes the step that was worked out, if this is its frame. The error says what stays uncut, and why.
    fn arrive(&mut self) -> Result<(), String> {
        let Some(mut opening) = self.opening.take() else { return Ok(()) };
        opening.left -= 1;
        if opening.left > 0 {
            self.opening = Some(opening);
            return Ok(());
        }
        let (step, next) = opening.finish();
        match next {
            Ok((state, file)) => {
                self.state = state;
                self.remade = file.or(self.remade.take());
                self.steps.push(step);
                Ok(())
            }
            Err(message) => {
                self.more.clear();
                self.cut.clone_from(&self.state.cut);
                Err(message)
            }
        }
    }

    /// Begins the next step, unless one is being worked out.
    fn begin(&mut self) {
        if self.opening.is_none() && !self.more.is_empty() {
            let step = std::mem::take(&mut self.more);
            let left = self.whole.cuttable.frames();
            self.opening = Some(Opening::begin(&self.whole, &self.state, (step, self.cut.clone()), left));
        }
    }

    /// The cut with these edges more.
    fn with(&self, more: &[([u32; 2], f64)]) -> CutEdges {
        let mut cut = self.cut.clone();
        cut.extend(more.iter().copied());
        cut
    }

    /// The first edges of a step after which no piece falls off, if one does after all of them.
    fn longest_that_holds(&self, mut step: CutStep) -> (CutStep, CutEdges) {
        let (mut holds, mut falls) = (0, step.len());
        while falls - holds > 1 {
            let middle = (holds + falls) / 2;
            let split = self.whole.cuttable.split(&self.with(&step[..middle]));
            if split.falls_apart { falls = middle } else { holds = middle }
        }
        step.truncate(holds);
        let cut = self.with(&step);
        (step, cut)
    }

    /// Adds an edge to a cut; false where it is cut already, or a tetrahedron would fall into its four corners.
    fn add(&self, edge: [u32; 2], share: f64, cut: &mut CutEdges) -> bool {
        if cut.contains_key(&edge) {
            return false;
        }
        cut.insert(edge, share);
        let splitter = &self.whole.cuttable.splitter;
        let shatters = splitter.tets_around(edge[0]).iter().any(|tet| splitter.shatters(*tet, cut));
        if shatters {
            cut.remove(&edge);
        }
        !shatters
    }

    fn remember(&self) -> BodyMemory {
        let begun = |opening: &Opening| Begun { step: opening.step.clone(), left: opening.left };
        BodyMemory {
            steps: self.steps.clone(),
            opening: self.opening.as_ref().map(begun),
            more: self.more.clone(),
            seen: self.seen.clone(),
        }
    }

    /// Goes on from a memory. After an error the body is whole.
    fn restore(&mut self, memory: BodyMemory) -> Result<(), String> {
        self.seen.clone_from(&memory.seen);
        if memory == self.remember() {
            return Ok(());
        }
        let gone = self.go_through(memory);
        if gone.is_err() {
            self.close()?;
        }
        gone
    }

    /// Makes the body whole again.
    fn close(&mut self) -> Result<(), String> {
        self.state = self.whole.state()?;
        (self.steps, self.opening) = (Vec::new(), None);
        (self.more, self.cut) = (CutStep::new(), CutEdges::new());
        self.remade = Some(self.whole.file.clone());
        Ok(())
    }

    fn go_through(&mut self, memory: BodyMemory) -> Result<(), String> {
        let BodyMemory { steps, opening, more, .. } = memory;
        if steps != self.steps {
            self.close()?;
            let last = steps.len().saturating_sub(1);
            for (number, step) in steps.into_iter().enumerate() {
                self.add_all(&step)?;
                let cut = self.cut.clone();
                if number < last {
                    let split = self.whole.cuttable.split(&cut);
                    let known = self.whole.cuttable.follow(&self.state.known, &split)?;
                    self.state.known = Arc::new(known);
                } else {
                    let (state, file) = self.whole.cut(&self.state, cut)?;
                    self.state = state;
                    self.remade = file.or(self.remade.take());
                }
                self.steps.push(step);
            }
        }
        self.opening = None;
        self.cut.clone_from(&self.state.cut);
        if let Some(Begun { step, left }) = opening {
            self.add_all(&step)?;
            let left = left.clamp(1, self.whole.cuttable.frames());
            self.opening = Some(Opening::begin(&self.whole, &self.state, (step, self.cut.clone()), left));
        }
        self.add_all(&more)?;
        self.more = more;
        Ok(())
    }

    /// Adds edges to the cut. The error says that they are none of this body.
    fn add_all(&mut self, step: &[([u32; 2], f64)]) -> Result<(), String> {
        let mut cut = std::mem::take(&mut self.cut);
        for (edge, share) in step {
            let is_edge = self.edges.binary_search(edge).is_ok() && *share > 0.0 && *share < 1.0;
            if !is_edge || !self.add(*edge, *share, &mut cut) {
                return Err(format!("body.{}: its cut is that of another body", self.whole.name));
            }
        }
        self.cut = cut;
        Ok(())
    }
}

/// Whether the edge of a blade comes near the body as it is shown.
fn is_near(sweep: &Sweep, body: &PlacedBody) -> bool {
    let (centre, radius) = body.assets.ball;
    let place = body.room_from_body;
    let (middle, far) = ((place * centre).coords, FAR * radius * place.scaling());
    let reach = sweep.low_and_high();
    let apart = |k: usize| reach[0][k] > middle[k] + far || reach[1][k] < middle[k] - far;
    if (0..3).any(apart) {
        return false;
    }
    let room_from_surface = body.room_from_surface();
    let places = body.deformer.positions();
    let places = places.iter().map(|x| (room_from_surface * Point3::from(V3::from(x.map(f64::from)))).coords);
    let Some((low, high)) = places.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1))) else {
        return false;
    };
    let more = (high - low) * BESIDE;
    (0..3).all(|k| reach[0][k] <= high[k] + more[k] && reach[1][k] >= low[k] - more[k])
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
        let poses: Vec<_> = self.blades.iter().map(|blade| blade.place.pose(world)).collect();
        let mut sweeps = Vec::new();
        for ((blade, last), now) in self.blades.iter().zip(&self.last).zip(&poses) {
            let Some((last, now)) = last.as_ref().zip(now.as_ref()) else { continue };
            sweeps.push(Sweep { from: blade.edge(last), to: blade.edge(now) });
        }
        self.last = poses;
        for body in &mut self.bodies {
            let placed = &world.bodies[body.b];
            let near: Vec<Sweep> = sweeps.iter().copied().filter(|sweep| is_near(sweep, placed)).collect();
            let state = &placed.deformer.state;
            let now = Seen {
                coefficients: state.coefficients.clone(),
                forces: body.forces_on(&placed.deformer),
                room_from_columns: placed.room_from_body * state.body_from_surface(),
            };
            for passed in [body.arrive(), body.pass(&near, now)] {
                if let Err(message) = passed {
                    let name = &body.whole.name;
                    self.warnings
                        .push(format!("body.{name}: what a blade passes here stays uncut: {message}"));
                }
            }
            body.begin();
        }
    }

    fn remade(&mut self) -> Vec<(usize, Arc<GreenFile>)> {
        self.bodies.iter_mut().filter_map(|body| Some((body.b, body.remade.take()?))).collect()
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
        for (blade, pose) in self.blades.iter().zip(&self.last) {
            let Some(pose) = pose else { continue };
            blade.place.hide_pen(world, frame);
            let (shape, color) = (blade.drawn.clone(), blade.color);
            let room_from_shape = pose.to_homogeneous().cast();
            frame.drawables.push(Drawable::Formed(Formed { shape, room_from_shape, color }));
        }
    }

    fn summary(&mut self) -> String {
        let of = |body: &CutBody| {
            let (copies, error) = body.state.outcome?;
            let (name, edges) = (&body.whole.name, body.state.cut.len());
            Some(format!(
                "{name}: cut across {edges} edges of its mesh, {copies} copies of nodes; its equations hold to a part of {error:.0e}\n"
            ))
        };
        self.bodies.iter().filter_map(of).collect()
    }

    fn memory(&self) -> Option<Memory> {
        written(&Memorised {
            blades: self.last.iter().copied().map(Posed).collect(),
            bodies: self.bodies.iter().map(CutBody::remember).collect(),
        })
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let Memorised { blades, bodies } = read(memory)?;
        if (blades.len(), bodies.len()) != (self.blades.len(), self.bodies.len()) {
            return Err("its blades and bodies are those of another scene".to_owned());
        }
        self.last = blades.into_iter().map(|Posed(pose)| pose).collect();
        for (body, memory) in self.bodies.iter_mut().zip(bodies) {
            body.restore(memory)?;
        }
        Ok(())
    }
}
