//! One body of a .green file, deformed: poses in, positions and normals for drawing and picking out.
//!
//! The surface is read through functions alone: where the graphics device deforms it, the CPU keeps a few nodes up to date, and
//! sums the others on request.

mod home;
mod state;
mod surface;

use super::contribution::Contribution;
use super::kernel::parts::{PartialSum, move_parts, moved};
use super::kernel::superposition::{Places, SumStats, Superposition, move_by};
use super::kernel::surface::SurfaceNormals;
use super::loads::{Loaded, PointLoad, SharedLoads, refusal};
use super::memory::ModelMemory;
use super::model::{
    Bearing, BodyState, ColumnsAt, ControlRest, DeformationModel, Frame, Kind, LoadInput, ModelEntry,
    ModelInput, Response, StateAge,
};
use super::models::make_model;
use super::path::BodyPath;
use super::pose::follow::FollowedTurn;
use super::pose::frame::{ControlPose, ControlPoses, PoseSlope, Wrench};
use crate::base::columns::ColumnGroup;
use crate::base::creases::Creases;
use crate::base::parts::{PartMotion, PartWeights};
use crate::green::{AFFINE, GreenFile};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time of the two steps of the last evaluation, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    pub deform_s: f64,
    pub normals_s: f64,
}

/// A deformable body, online.
pub struct Deformer {
    file: Arc<GreenFile>,
    /// Name of the body in the scene and in the file.
    pub body: String,
    pub controls: Vec<ControlRest>,
    /// Mesh coordinates of the origin about which all of the following stands, m.
    pub centre: Vector3<f64>,
    pub poses: ControlPoses,
    /// Poses before the last evaluation.
    last: ControlPoses,
    /// Turn of every control element on the way to its pose.
    turns: Vec<FollowedTurn>,
    /// Whether the model keeps anything from frame to frame; and the path.
    has_path: bool,
    path: BodyPath,
    /// Counts how often the body left the state in which it was for the equilibrium from rest.
    pub homecomings: u64,
    /// The model's state for the poses.
    pub state: BodyState,
    pub times: FrameTimes,
    /// Counts how often the surface was summed: whoever draws it compares this with what it has drawn.
    pub version: u64,
    /// The state for which the surface was last summed.
    summed: BodyState,
    /// Weights with which each part moves each node, for a body of several parts.
    weights: Option<PartWeights>,
    /// Displacements of the surface nodes, their positions, and unit normals of what is drawn; NaN where the CPU keeps nothing up to date.
    u: Vec<[f32; 3]>,
    /// Sum of the columns alone, for a model that adds a field to it: it is brought up to date, not summed anew.
    of_columns: Vec<[f32; 3]>,
    positions: Vec<[f32; 3]>,
    /// Counts how often the surface got other triangles ([`Contribution::triangles`]): whoever draws or picks it compares this.
    pub topology: u64,
    /// Whether that was since the last evaluation.
    triangles_changed: bool,
    /// Edges whose sides are farther apart than this are drawn sharp, rad.
    sharp: Option<f64>,
    /// Nodes that are drawn more than once, and the positions of all that is drawn; empty without.
    creases: Option<Creases>,
    drawn: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    model: Box<dyn DeformationModel>,
    /// The model's entry, which is known before the model is made.
    pub entry: &'static ModelEntry,
    /// Loads as they are now, where something may act on the body.
    loads: Option<SharedLoads>,
    loads_changed: bool,
    /// Contribution of the effects, and whether it has changed since the last evaluation.
    contribution: Contribution,
    contribution_changed: bool,
    /// The energy of the poses and its slopes, where the model has them.
    response: Option<Response>,
    slopes: Vec<PoseSlope>,
    sum: Superposition,
    /// The part that the CPU sums, where the graphics device deforms the surface.
    partial: Option<PartialSum>,
    surface_normals: SurfaceNormals,
    evaluated: bool,
    /// Longest wait for columns of the compliance.
    patience: Duration,
}

impl Deformer {
    /// A deformer at rest for `body` of the file; the error names an unknown body, or what the model lacks.
    pub fn new(file: Arc<GreenFile>, body: &str, entry: &'static ModelEntry) -> Result<Deformer, String> {
        let meta = file
            .meta
            .bodies
            .get(body)
            .ok_or_else(|| format!("{}: holds no body \"{body}\"", file.path.display()))?;
        if let Some(family) = entry.requirements.iter().find(|family| !meta.requirements.has(**family)) {
            let (path, name) = (file.path.display(), family.name);
            return Err(format!(
                "{path}: body {body} has no numbers of the family {name}, which the model \"{}\" requires; run \
                 `greenstage precompute` on its scene",
                entry.name
            ));
        }
        let controls: Vec<ControlRest> = meta
            .controls
            .iter()
            .map(|control| ControlRest {
                name: control.name.clone(),
                origin: Vector3::from(control.origin),
                nodes: control.nodes,
            })
            .collect();
        let nodes = meta.surface_nodes;
        let has_loads = !meta.loads.is_empty() || meta.compliance_nodes.is_some();
        let may_act = has_loads || (entry.takes_points() && matches!(entry.kind, Kind::Online(_)));
        let loads = may_act.then(SharedLoads::default);
        if let Some(message) = refusal(entry, meta.compliance_nodes.is_some()) {
            return Err(format!("body.{body}.model: {message}"));
        }
        let model = made(&file, body, &controls, entry, loads.as_ref())?;
        let weights = model.part_weights(file.rest(body));
        if let Some(weights) = weights.as_ref().filter(|weights| weights.nodes() != nodes) {
            let found = weights.nodes();
            return Err(format!(
                "body.{body}: the parts have weights of {found} nodes, the surface has {nodes}"
            ));
        }
        let sum = Superposition::new(&file.groups(body), nodes);
        let rest = BodyState::at_rest(sum.columns());
        let mut deformer = Deformer {
            body: body.to_owned(),
            centre: Vector3::from(meta.centre),
            poses: vec![ControlPose::REST; controls.len()],
            last: Vec::with_capacity(controls.len()),
            turns: vec![FollowedTurn::REST; controls.len()],
            u: vec![[0.0; 3]; nodes],
            of_columns: model.field().map_or_else(Vec::new, |_| vec![[0.0; 3]; nodes]),
            positions: file.rest(body).to_vec(),
            topology: 0,
            triangles_changed: false,
            sharp: None,
            creases: None,
            drawn: Vec::new(),
            normals: vec![[0.0; 3]; nodes],
            times: FrameTimes::default(),
            version: 0,
            has_path: !entry.is_linear() && model.memory() != ModelMemory::default(),
            path: BodyPath::default(),
            homecomings: 0,
            model,
            entry,
            loads,
            loads_changed: false,
            contribution: Contribution::none(file.columns_of_effects(body), controls.len()),
            contribution_changed: false,
            response: None,
            slopes: vec![PoseSlope::default(); controls.len()],
            state: rest.clone(),
            summed: rest,
            weights,
            sum,
            partial: None,
            surface_normals: SurfaceNormals::new(file.triangles(body), nodes),
            evaluated: false,
            patience: Duration::MAX,
            controls,
            file,
        };
        deformer.evaluate(&vec![ControlPose::REST; deformer.controls.len()]);
        Ok(deformer)
    }

    pub fn rest(&self) -> &[[f32; 3]] {
        self.file.rest(&self.body)
    }

    /// The triangles of the surface as they are now.
    pub fn triangles(&self) -> &[[u32; 3]] {
        match &self.contribution.triangles {
            None => self.file.triangles(&self.body),
            Some(triangles) => &triangles.0,
        }
    }

    /// Mesh node tags of the surface nodes.
    pub fn tags(&self) -> &[u64] {
        self.file.tags(&self.body)
    }

    /// Surface nodes of control element `e`.
    pub fn control_nodes(&self, e: usize) -> &[u32] {
        self.file.control(&self.body, &self.controls[e].name)
    }

    /// Deforms the body for new poses; returns what it cost, or `None` where no pose changed.
    ///
    /// A pose that is not finite is not taken: that control element stays at its last valid one.
    pub fn evaluate(&mut self, poses: &[ControlPose]) -> Option<SumStats> {
        self.take(poses).then(|| self.deform())
    }

    /// First half of [`Deformer::evaluate`]: poses → state. False where no pose changed.
    pub fn take(&mut self, poses: &[ControlPose]) -> bool {
        let is_first = !std::mem::replace(&mut self.evaluated, true);
        let mut changed = is_first;
        self.last.clone_from(&self.poses);
        for ((last, turn), new) in self.poses.iter_mut().zip(&mut self.turns).zip(poses) {
            if new.is_finite() && (is_first || new != last) {
                (*last, *turn, changed) = (*new, turn.follow(new), true);
            }
        }
        if changed && !is_first {
            self.follow_path();
        }
        changed |= self.path_is_due();
        if std::mem::take(&mut self.loads_changed) {
            self.path.forget_others();
            changed = true;
        }
        changed |= std::mem::take(&mut self.contribution_changed);
        if changed || self.model.has_news() {
            changed = true;
            let version = self.state.field_version;
            self.state = self.model.state(&self.poses);
            let is_reshaped = self.has_field() || std::mem::take(&mut self.triangles_changed);
            self.go_home();
            self.state.field_version = version + u64::from(is_reshaped);
            self.respond();
            // Columns of families that the model does not know.
            let of_effects = &self.contribution.coefficients;
            self.state.coefficients.resize(self.sum.columns() - of_effects.len(), 0.0);
            self.state.coefficients.extend(of_effects);
            if let Some(weights) = &self.weights {
                self.state.parts.resize(weights.parts(), Isometry3::identity());
            }
        }
        changed
    }

    /// Whether nothing of the surface's displacements is linear theory's alone: several parts move it, or it is solved for large
    /// rotations.
    pub fn moves_in_parts(&self) -> bool {
        self.weights.is_some() || self.entry.frame == Frame::Solved
    }

    /// Whether the model computes displacements that are no sum of columns.
    pub fn has_field(&self) -> bool {
        self.model.field().is_some()
    }

    /// Whether the state has changed though no pose has: [`Deformer::take`] then takes it.
    pub fn has_news(&mut self) -> bool {
        self.model.has_news()
    }

    /// Age of the state, for a model that computes in the background.
    pub fn age(&self) -> Option<StateAge> {
        self.model.age()
    }

    /// Limits the time that a state waits for the background to `patience`. With [`Duration::MAX`] every state is exactly that of
    /// the poses asked for, as pictures and recordings need it.
    pub fn be_patient(&mut self, patience: Duration) {
        self.patience = patience;
        self.model.be_patient(patience);
    }

    /// The groups of columns that are summed, as they are stored.
    pub fn groups(&self) -> Vec<ColumnGroup<'_>> {
        self.file.groups(&self.body)
    }

    /// Weights with which each part moves each node, for a body of several parts.
    pub fn part_weights(&self) -> Option<&PartWeights> {
        self.weights.as_ref()
    }

    /// Nodes of the surface.
    pub fn node_count(&self) -> usize {
        self.positions.len()
    }

    /// Transform into the body's frame of the positions as they were last summed: the motion of a single part, where the point X
    /// of the body comes to body_from_surface · (X + u). Several parts are moved already.
    pub fn body_from_surface(&self) -> Isometry3<f64> {
        match self.weights {
            None => self.summed.body_from_surface(),
            Some(_) => Isometry3::identity(),
        }
    }

    /// Second half: state → displacements, positions, normals.
    pub fn deform(&mut self) -> SumStats {
        let started = Instant::now();
        self.version += 1;
        let (file, body) = (&self.file, &self.body);
        self.summed.clone_from(&self.state);
        let (c, parts) = (&self.summed.coefficients, &self.summed.parts);
        if let Some(partial) = &mut self.partial {
            let stats = partial.update(c, file.rest(body), &mut self.u, &mut self.positions);
            if let Some(weights) = &self.weights {
                let motions: Vec<PartMotion> = parts.iter().map(PartMotion::from).collect();
                for &node in &partial.nodes {
                    let place = &mut self.positions[node as usize];
                    *place = moved(weights.at(node as usize), &motions, *place);
                }
            }
            self.times = FrameTimes { deform_s: started.elapsed().as_secs_f64(), normals_s: 0.0 };
            return stats;
        }
        let (groups, rest) = (file.groups(body), file.rest(body));
        let stats = match (self.model.field(), &self.weights) {
            (None, None) => {
                let places = Places { rest, positions: &mut self.positions };
                self.sum.update_places(&groups, c, &mut self.u, places)
            }
            (None, Some(_)) => self.sum.update(&groups, c, &mut self.u),
            (Some(field), _) => {
                let stats = self.sum.update(&groups, c, &mut self.of_columns);
                self.u.copy_from_slice(&self.of_columns);
                add(&mut self.u, field);
                stats
            }
        };
        if self.model.field().is_some() || self.weights.is_some() {
            move_by(self.positions.as_flattened_mut(), rest.as_flattened(), self.u.as_flattened());
        }
        if let Some(weights) = &self.weights {
            move_parts(weights, parts, &mut self.positions);
        }
        self.times.deform_s = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let (drawn, triangles) = match &self.creases {
            None => match &self.contribution.triangles {
                None => (&self.positions, file.triangles(body)),
                Some(triangles) => (&self.positions, triangles.0.as_slice()),
            },
            Some(creases) => {
                self.drawn.clone_from(&self.positions);
                creases.extend(&mut self.drawn);
                (&self.drawn, creases.triangles.as_slice())
            }
        };
        self.surface_normals.write(drawn, triangles, &mut self.normals);
        self.times.normals_s = started.elapsed().as_secs_f64();
        stats
    }

    /// The next poses stand alone: a model that follows turns forgets those it saw.
    pub fn forget(&mut self) {
        self.model.forget();
        self.path = BodyPath::default();
        self.turns.fill(FollowedTurn::REST);
        self.evaluated = false;
    }

    /// Turn of control element `e` on the way to its pose.
    pub fn turn(&self, e: usize) -> FollowedTurn {
        self.turns[e]
    }

    /// The largest angle by which two control elements have turned against each other, whole turns included, rad.
    pub fn largest_turn(&self) -> f64 {
        let pairs =
            self.turns.iter().enumerate().flat_map(|(i, a)| self.turns[..i].iter().map(|b| a.against(b)));
        pairs.fold(0.0, f64::max)
    }

    /// The next pose of control element `e` continues this turn, whatever came before.
    pub fn set_turn(&mut self, e: usize, turn: FollowedTurn) {
        // The same matrix after another number of turns is another pose.
        let is_same = self.turns[e] == turn;
        (self.evaluated, self.path.is_lost) = (self.evaluated && is_same, self.path.is_lost || !is_same);
        self.turns[e] = turn;
        self.model.set_turn(e, turn.quaternion);
    }

    /// Force and torque on every control element, and the strain energy, where the model has them of these poses.
    pub fn wrenches(&self) -> Option<(Vec<Wrench>, f64)> {
        let response = self.response.filter(|response| response.is_defined)?;
        let wrenches =
            self.slopes.iter().zip(&self.poses).map(|(slope, pose)| Wrench::from_slope(slope, pose));
        Some((wrenches.collect(), response.energy))
    }

    /// ∂V/∂P of every control element, of the model and of what effects add, where the model has them of these poses.
    pub fn slopes(&self) -> Option<&[PoseSlope]> {
        self.response.filter(|response| response.is_defined).map(|_| self.slopes.as_slice())
    }

    /// The forces and moments about where each control element is that are zero where nothing holds it, by the model's own
    /// equilibrium: of a model of small strain by the body at rest.
    pub fn balance(&self) -> Option<Vec<Wrench>> {
        if self.entry.is_linear() {
            self.response.filter(|response| response.is_defined)?;
            return Some(self.slopes.iter().map(Wrench::of_small_strain).collect());
        }
        let (wrenches, _) = self.wrenches()?;
        Some(wrenches.iter().zip(&self.poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect())
    }

    /// Forces of this body are shown from now on.
    pub fn feel(&mut self) {
        self.model.feel();
    }

    /// Evaluates energy and slopes anew, as [`Deformer::take`] does for new poses: those of the model and of effects.
    pub fn respond(&mut self) -> Option<Response> {
        self.response = self.model.respond(&self.poses, &mut self.slopes);
        if let Some(response) = &mut self.response {
            response.energy += self.contribution.energy;
            for (slope, more) in self.slopes.iter_mut().zip(&self.contribution.slopes) {
                slope.translation += more.translation;
                slope.matrix += more.matrix;
            }
        }
        self.response
    }

    /// Makes another model of this body for a force loop, which follows poses independently of this one.
    pub fn another_model(&self) -> Result<Box<dyn DeformationModel>, String> {
        match self.model.for_force_loop() {
            Some(model) => Ok(model),
            None => {
                let mut model =
                    made(&self.file, &self.body, &self.controls, self.entry, self.loads.as_ref())?;
                model.be_patient(Duration::ZERO);
                Ok(model)
            }
        }
    }

    /// Makes the deformer of the same body from another file, in which its columns are others and of its nodes the first `kept` the same, in
    /// the state of this one. Forces at other nodes are gone.
    pub fn remade(&self, file: Arc<GreenFile>, kept: usize) -> Result<Deformer, String> {
        let mut other = Deformer::new(file, &self.body, self.entry)?;
        let mut state = self.snapshot();
        let keep = |points: &mut Vec<PointLoad>| {
            points.retain(|point| point.corners().all(|(node, _)| (node as usize) < kept));
            for point in points {
                // A corner without a share may be one that is gone.
                let own = point.corners().next().map_or(0, |(node, _)| node);
                let all = point.nodes.iter_mut().zip(point.weights);
                all.filter(|(_, w)| *w == 0.0).for_each(|(node, _)| *node = own);
            }
        };
        keep(&mut state.loads.points);
        keep(&mut state.contribution.points);
        other.sharp = self.sharp;
        other.find_creases();
        other.be_patient(self.patience);
        other.restore(&state)?;
        // The energy is that of the other body.
        other.respond();
        (other.topology, other.version) = (self.topology + 1, self.version + 1);
        other.homecomings = self.homecomings;
        Ok(other)
    }

    /// Makes a second deformer of this body, at rest, which knows nothing of this one.
    pub fn another(&self) -> Result<Deformer, String> {
        Deformer::new(self.file.clone(), &self.body, self.entry)
    }

    /// Lets another model of this body go on from where its own is, and wait as long.
    pub fn lend(&self, to: &mut dyn DeformationModel) -> Result<(), String> {
        to.be_patient(self.patience);
        to.set_memory(&self.model.memory())
    }
}

/// u + v.
fn add(u: &mut [[f32; 3]], v: &[[f32; 3]]) {
    for (u, v) in u.as_flattened_mut().iter_mut().zip(v.as_flattened()) {
        *u += v;
    }
}

/// The model of a body, from what the file holds of it.
fn made(
    file: &Arc<GreenFile>,
    body: &str,
    controls: &[ControlRest],
    entry: &ModelEntry,
    loads: Option<&SharedLoads>,
) -> Result<Box<dyn DeformationModel>, String> {
    let surface = columns_at(file, body);
    let metas = file.meta.bodies.get(body).map_or(&[][..], |meta| &meta.loads);
    let input = ModelInput {
        controls,
        rest: file.rest(body),
        triangles: file.triangles(body),
        control_nodes: &|e| file.control(body, &controls[e].name).to_vec(),
        table: &|name| match name {
            name if name == AFFINE.name => file.affine_columns(body),
            name => file.table(body, name),
        },
        loads: loads.map(|shared| LoadInput { metas, shared, surface: &surface }),
    };
    let model = make_model(&entry.kind, &input).map_err(|message| format!("body.{body}.model: {message}"))?;
    let Some(shared) = loads.filter(|_| matches!(entry.loads, Bearing::Columns)) else { return Ok(model) };
    let turns = entry.frame == Frame::MeanMotion;
    let loaded = Loaded::new(file, body, model, turns, controls, shared);
    Ok(Box::new(loaded.map_err(|message| format!("body.{body}: {message}"))?))
}

/// Reads where nodes of a body's surface rest, and all columns there.
fn columns_at(file: &Arc<GreenFile>, body: &str) -> ColumnsAt {
    let (file, body) = (file.clone(), body.to_owned());
    Arc::new(move |node| {
        let (rest, node) = (file.rest(&body), node as usize);
        let column = |group: &ColumnGroup<'_>, k: usize| {
            Vector3::from_fn(|axis, _| f64::from(group.value(rest.len(), k, 3 * node + axis)))
        };
        let groups = file.groups(&body);
        let all =
            |group| (0..ColumnGroup::columns(group, rest.len()).unwrap_or(0)).map(move |k| column(group, k));
        (Vector3::from(rest[node]).cast(), groups.iter().flat_map(all).collect())
    })
}
