//! A body that blades cut, from frame to frame: its steps, the one that is being worked out, and what can be taken back.

use super::base::Tables;
use super::blade::Swept;
use super::fallen::{Fallen, Falling};
use super::frames;
use super::opened::{Cuttable, Moved, Shape};
use super::opening::{CutStep, Edges, From, Opening, Renewal, State, Whole};
use super::resistance::{Passed, Resistance};
use crate::deform::{AppliedLoads, Deformer, Pull};
use crate::green::{GreenFile, LOAD_COMPLIANCE, REACTION, VOLUME, Volume};
use crate::mesh::split::CutEdges;
use crate::world::World;
use crate::world::dissipation::Dissipation;
use nalgebra::{Isometry3, Point3, Similarity3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// A body that blades cut.
pub struct CutBody {
    /// Index in the world.
    pub b: usize,
    pub whole: Whole,
    pub(super) edges: Vec<[u32; 2]>,
    /// The body as it is cut now.
    pub state: State,
    /// Motion that belongs to the surface which the world has.
    shown: Arc<Moved>,
    /// Points of that surface that are pressed.
    pressed: Vec<u32>,
    /// Steps in which it was cut; the last bits of the columns depend on them.
    pub(super) steps: Vec<CutStep>,
    /// The next step, which is being worked out.
    pub(super) opening: Option<Opening>,
    /// The next base, which is being worked out.
    pub(super) renewal: Option<Renewal>,
    /// Edges that blades have passed since that step began, and all that are or will be cut.
    pub(super) more: Edges,
    pub(super) cut: CutEdges,
    /// Number of steps at the beginning of each stroke of the blades, and the body there.
    pub(super) strokes: Vec<(usize, State)>,
    /// Edges of the strokes that were taken back, the last ones last.
    pub(super) undone: Vec<Edges>,
    /// Pieces that have fallen off.
    pub(super) fallen: Vec<Fallen>,
    /// Place of the body when they moved last.
    pub(super) stood: Option<Similarity3<f64>>,
    pub is_felt: bool,
    /// Whether it is heard, and the work of the blades in the frame if it is.
    pub is_heard: bool,
    pub torn: Dissipation,
    /// Toughness, J/m², where the force of cutting is asked for, and the mean length of the mesh's edges, m.
    toughness: f64,
    length: f64,
    /// Resistance to each blade, where cutting takes force.
    pub resistances: Vec<Resistance>,
    /// Shape in the last frame.
    pub(super) seen: Option<Seen>,
    /// Places of all nodes in a shape, and the motion with which they were found.
    placed: Option<(Seen, Arc<Moved>, Vec<V3>)>,
    /// Motion with which the last frame ended.
    pub(super) last: Arc<Moved>,
    /// The file that has the new surface, until the world takes it.
    remade: Option<Arc<GreenFile>>,
}

/// Coefficients and motion from which the places of a body's nodes follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seen {
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

impl CutBody {
    /// A body of this toughness, J/m², that so many blades cut, and whether hands with a force device feel it.
    pub fn new(
        b: usize,
        name: &str,
        file: Arc<GreenFile>,
        (toughness, blades, is_felt): (f64, usize, bool),
    ) -> Result<CutBody, String> {
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
        // Here, and not in the first frame in which a blade comes near.
        whole.cuttable.base.whole()?;
        let state = whole.state()?;
        let edges = whole.cuttable.edges();
        let nodes = &whole.cuttable.matter.splitter.mesh.nodes;
        let long = |[a, b]: &[u32; 2]| (nodes[*a as usize] - nodes[*b as usize]).norm();
        let length = edges.iter().map(long).sum::<f64>() / edges.len().max(1) as f64;
        Ok(CutBody {
            b,
            edges,
            toughness,
            length,
            is_felt,
            is_heard: false,
            torn: Dissipation::default(),
            resistances: vec![Resistance::default(); if toughness > 0.0 { blades } else { 0 }],
            shown: state.moved.clone(),
            last: state.moved.clone(),
            pressed: Vec::new(),
            state,
            whole,
            steps: Vec::new(),
            opening: None,
            renewal: None,
            more: Edges::new(),
            cut: CutEdges::new(),
            strokes: Vec::new(),
            undone: Vec::new(),
            fallen: Vec::new(),
            stood: None,
            seen: None,
            placed: None,
            remade: None,
        })
    }

    /// Takes the shape that the world shows, and the points that are pressed.
    pub fn see(&mut self, world: &World) -> Seen {
        let placed = &world.bodies[self.b];
        let points = placed.deformer.acting().points;
        self.pressed = points.iter().flat_map(|point| point.nodes).collect();
        let state = &placed.deformer.state;
        Seen {
            coefficients: state.coefficients.clone(),
            forces: self.forces_on(&placed.deformer),
            room_from_columns: placed.room_from_body * state.body_from_surface(),
        }
    }

    /// Forces on a deformer's points as forces at nodes of the mesh, along the axes of its columns.
    fn forces_on(&self, deformer: &Deformer) -> Vec<Force> {
        let AppliedLoads { points, .. } = deformer.acting();
        let in_columns = deformer.state.body_from_surface().rotation.inverse();
        let mut all: BTreeMap<u32, V3> = BTreeMap::new();
        for point in points {
            let Pull::Force(force) = point.pull else { continue };
            for (node, weight) in point.nodes.into_iter().zip(point.weights).filter(|(_, w)| *w != 0.0) {
                let Some(node) = self.shown.node_of(node) else { continue };
                *all.entry(node).or_default() += in_columns * force * weight;
            }
        }
        all.into_iter().map(|(node, force)| Force { node, force }).collect()
    }

    /// Places of all nodes in the room.
    fn places(&self, seen: &Seen, moved: &Arc<Moved>) -> Result<Vec<V3>, String> {
        if let Some((of, own, places)) = &self.placed
            && of == seen
            && Arc::ptr_eq(own, moved)
        {
            return Ok(places.clone());
        }
        let forces: Vec<_> = seen.forces.iter().map(|at| (at.node, at.force)).collect();
        let shape = Shape { coefficients: &seen.coefficients, forces: &forces };
        let at = self.whole.cuttable.places(moved, &shape)?;
        Ok(at.into_iter().map(|x| (seen.room_from_columns * Point3::from(x)).coords).collect())
    }

    /// Cuts what blades have passed through since the last frame; what each of them has done. The error says why nothing is cut.
    pub fn pass(&mut self, near: &[&Swept], now: Seen) -> Result<Vec<Passed>, String> {
        let before = self.seen.replace(now.clone()).unwrap_or_else(|| now.clone());
        let last = std::mem::replace(&mut self.last, self.state.moved.clone());
        // A cut that has opened moves what is not cut yet, too, and that through a blade.
        let has_opened = !Arc::ptr_eq(&last, &self.state.moved);
        let is_still = !has_opened && before == now;
        if near.is_empty() || (is_still && near.iter().all(|swept| swept.sweep.is_still())) {
            return Ok(vec![Passed::default(); near.len()]);
        }
        let from = self.places(&before, &last)?;
        let to = if is_still { from.clone() } else { self.places(&now, &self.state.moved)? };
        self.placed = Some((now, self.state.moved.clone(), to.clone()));
        let mut cut = std::mem::take(&mut self.cut);
        let mut all = Vec::new();
        for Swept { sweep, .. } in near {
            let mut passed = Passed::default();
            for (edge, share) in sweep.crossed(&self.edges, (&from, &to)) {
                if cut.contains_key(&edge) || self.state.split.is_loose(edge[0]) {
                    continue;
                }
                let before = self.area_around(edge, &cut);
                cut.insert(edge, share);
                self.more.push((edge, share));
                passed.area += self.area_around(edge, &cut) - before;
                passed.places += to[edge[0] as usize].lerp(&to[edge[1] as usize], share);
                passed.count += 1;
            }
            all.push(passed);
        }
        self.cut = cut;
        Ok(all)
    }

    /// Area of the cuts through the tetrahedra around an edge, m², where cutting takes force.
    fn area_around(&self, edge: [u32; 2], cut: &CutEdges) -> f64 {
        let splitter = &self.whole.cuttable.matter.splitter;
        let around = splitter.tets_around(edge[0]).iter().filter(|_| self.toughness > 0.0);
        around.map(|tet| splitter.cut_area(*tet, cut)).sum()
    }

    /// Takes what the blades near the body have done in a frame; all others have left it. `scale` is its size in the room against its own.
    pub fn resist(&mut self, near: &[&Swept], passed: &[Passed], scale: f64) {
        self.torn = Dissipation::default();
        for (blade, resistance) in self.resistances.iter_mut().enumerate() {
            let own = near.iter().zip(passed).find(|(swept, _)| swept.blade == blade);
            let Some((swept, passed)) = own else {
                resistance.leave();
                continue;
            };
            let place = (passed.count > 0).then(|| Point3::from(passed.places / passed.count as f64));
            let at = place.map(|place| swept.room_from_blade.inverse_transform_point(&place).coords);
            let (before, moved) = (resistance.work(), swept.sweep.moved() / scale);
            resistance.step(self.toughness * passed.area, at, &moved, self.length);
            if self.is_heard {
                let place = swept.room_from_blade * Point3::from(*resistance.at());
                let done = resistance.work() - before;
                self.torn.add(&Dissipation::of(done, &place.coords, moved.norm()));
            }
        }
    }

    /// Mean length of the edges of the mesh, m.
    pub fn length(&self) -> f64 {
        self.length
    }

    pub fn toughness(&self) -> f64 {
        self.toughness
    }

    /// Takes the step that was worked out, if this is its frame. The error says what stays uncut, and why.
    pub fn arrive(&mut self) -> Result<(), String> {
        if let Some(renewal) = &mut self.renewal {
            renewal.left = renewal.left.saturating_sub(1);
        }
        let Some(mut opening) = self.opening.take() else { return Ok(()) };
        opening.left -= 1;
        if opening.left > 0 {
            self.opening = Some(opening);
            return Ok(());
        }
        self.take(opening)
    }

    /// Takes a step that is worked out; waits for it.
    fn take(&mut self, opening: Opening) -> Result<(), String> {
        let (step, next) = opening.finish();
        match next {
            Ok(state) => {
                let came_off = self.come_off(&state);
                self.go_to(state);
                if self.steps.last().is_some_and(|last| last.base == step.base) {
                    self.rest_others();
                }
                self.steps.push(step);
                self.renew();
                came_off
            }
            Err(message) => {
                self.more.clear();
                self.cut.clone_from(&self.state.cut);
                Err(message)
            }
        }
    }

    /// Begins to work out a new base, where the present one has too many copies beyond it.
    fn renew(&mut self) {
        if self.renewal.is_none() && self.state.known.count() > frames::MOST_COPIES {
            let sizes = [self.steps.len(), self.state.cut.len()];
            let left = frames::of_base(self.free());
            self.renewal = Some(Renewal::begin(&self.whole, &self.state.split, sizes, left));
        }
    }

    /// Gives back the memory of all factors but the present one. Not in the first step from a new base: the frame may still need the one before.
    pub(super) fn rest_others(&self) {
        let others = self.strokes.iter().map(|(_, state)| &state.base.0).chain([&self.whole.cuttable.base]);
        let others = others.filter(|base| !Arc::ptr_eq(base, &self.state.base.0));
        others.for_each(|base| base.solves.rest());
    }

    /// Number of free nodes of the mesh.
    pub(super) fn free(&self) -> usize {
        self.whole.cuttable.base.partition.free.len()
    }

    /// Adds the pieces that this state has and the present one has not, where the body shows them now.
    fn come_off(&mut self, state: &State) -> Result<(), String> {
        let mut pieces = Fallen::all(&self.whole.cuttable, (&state.split, &state.cut), &self.state.split);
        let Some(seen) = self.seen.clone().filter(|_| !pieces.is_empty()) else { return Ok(()) };
        let places = self.places(&seen, &self.state.moved)?;
        let mesh = &self.whole.cuttable.matter.splitter.mesh;
        for piece in &mut pieces {
            let rest = |node: usize| mesh.nodes[node] - self.whole.cuttable.matter.centre;
            let of = |node: &u32| (rest(*node as usize), places[*node as usize]);
            let own: Vec<(V3, V3)> = piece.nodes.iter().map(of).collect();
            piece.put(&own, &seen.room_from_columns);
        }
        self.fallen.append(&mut pieces);
        Ok(())
    }

    /// Carries the pieces along where the body stands elsewhere now, as navigation has it: with it and as large as it.
    pub fn follow(&mut self, room_from_body: &Similarity3<f64>) {
        let stood = self.stood.replace(*room_from_body).filter(|stood| stood != room_from_body);
        let Some(stood) = stood else { return };
        let of = |place: &Similarity3<f64>| {
            let shift = place.isometry.translation.vector / place.scaling();
            Isometry3::from_parts(shift.into(), place.isometry.rotation)
        };
        let by = of(room_from_body) * of(&stood).inverse();
        self.fallen.iter_mut().for_each(|piece| piece.motion = piece.motion.carried(&by));
    }

    /// Moves the pieces that have fallen off on by a frame.
    pub fn fall(&mut self, falling: &Falling<'_>) {
        self.fallen.iter_mut().for_each(|piece| piece.fall(falling));
    }

    pub fn fallen(&self) -> &[Fallen] {
        &self.fallen
    }

    /// The new surface, once.
    pub fn remade(&mut self) -> Option<(usize, Arc<GreenFile>)> {
        let file = self.remade.take()?;
        self.shown = self.state.moved.clone();
        Some((self.b, file))
    }

    pub(super) fn go_to(&mut self, state: State) {
        if !Arc::ptr_eq(&state.file, &self.state.file) {
            self.state.file.forget_columns(&self.whole.name);
            self.state.moved.forget();
            self.remade = Some(state.file.clone());
        }
        self.state = state;
    }

    /// Whether nothing is being worked out, or waits for it.
    pub fn is_idle(&self) -> bool {
        self.opening.as_ref().is_none_or(|opening| opening.step.edges.is_empty()) && self.more.is_empty()
    }

    /// Takes note that a stroke begins.
    pub fn begin_stroke(&mut self) {
        self.strokes.push((self.steps.len(), self.state.clone()));
        self.undone.clear();
    }

    /// Takes back the last stroke.
    pub fn undo(&mut self) {
        let Some((steps, state)) = self.strokes.pop() else { return };
        let mut undone: Edges = self.steps.split_off(steps).into_iter().flat_map(|step| step.edges).collect();
        undone.extend(self.opening.take().map(|opening| opening.step.edges).unwrap_or_default());
        undone.append(&mut self.more);
        self.undone.push(undone);
        self.renewal = self.renewal.take().filter(|renewal| renewal.at <= steps);
        self.cut.clone_from(&state.cut);
        self.fallen.retain(|piece| state.split.is_loose_at(piece.corner));
        self.last = state.moved.clone();
        state.base.0.solves.wake();
        self.go_to(state);
    }

    /// Cuts the stroke again that was taken back last, in one step.
    pub fn redo(&mut self) -> Result<(), String> {
        let Some(step) = self.undone.pop() else { return Ok(()) };
        let arrived = self.opening.take().map_or(Ok(()), |opening| self.take(opening));
        self.strokes.push((self.steps.len(), self.state.clone()));
        arrived?;
        self.add_all(&step)?;
        self.more.extend(step);
        self.begin();
        Ok(())
    }

    /// Begins the next step, unless one is being worked out; one with too many copies beyond its base waits for the next base, or makes one.
    pub fn begin(&mut self) {
        let renewal = self.renewal.take_if(|renewal| renewal.left == 0);
        if self.opening.is_some() || (self.more.is_empty() && renewal.is_none()) {
            self.renewal = renewal.or_else(|| self.renewal.take());
            return;
        }
        let base = renewal.as_ref().map_or(self.state.base.0.edges, |renewal| renewal.edges);
        let beyond = self.cut.len() - base;
        let new = if renewal.is_some() { beyond } else { self.more.len() };
        let of_step = frames::of_step(self.free(), new, self.pressed.len());
        let of_base = frames::of_base(self.free());
        let is_long = of_step > of_base || beyond > frames::MOST_EDGES;
        if is_long && self.renewal.is_some() {
            return;
        }
        let (from, left) = match renewal {
            _ if is_long => (From::Itself(self.steps.len() + 1), of_base),
            Some(renewal) => (From::Renewed(renewal), of_step),
            None => (From::Before, of_step),
        };
        let step = std::mem::take(&mut self.more);
        let asked = (step, self.cut.clone(), self.pressed.clone());
        self.opening = Some(Opening::begin(&self.whole, &self.state, asked, from, left));
    }

    /// Adds edges to the cut. The error says that they are none of this body.
    pub(super) fn add_all(&mut self, step: &[([u32; 2], f64)]) -> Result<(), String> {
        let mut cut = std::mem::take(&mut self.cut);
        for (edge, share) in step {
            let is_edge = self.edges.binary_search(edge).is_ok() && *share > 0.0 && *share < 1.0;
            if !is_edge || cut.insert(*edge, *share).is_some() {
                return Err(self.is_other());
            }
        }
        self.cut = cut;
        Ok(())
    }

    /// The error of a memory that does not fit the body.
    pub(super) fn is_other(&self) -> String {
        format!("body.{}: its cut is that of another body", self.whole.name)
    }
}
