//! The world as a graph of fields: stylus → hit → hands → control pose → coefficients → surface.
//!
//! | field | type | made from |
//! |---|---|---|
//! | `tracker.head` | tracked pose | set from outside |
//! | `tracker.time` | number | set from outside |
//! | `head` | pose | `tracker.head`, `head.previous`: the last usable one |
//! | `stylus.right` | stylus | set from outside |
//! | `body.B.place` | place | set from outside: navigation, and bodies set aside |
//! | `hit.right` | hit | `stylus.right`, `hands.previous`, every `place`, every `surface.previous`: the body as it was seen |
//! | `hands` | hands | `tracker.time`, every `stylus` and `hit`, `hands.previous`, every `pose.previous` |
//! | `body.B.control.C.pose` | control pose | `hands`, `pose.previous` |
//! | `body.B.arrived` | number | set from outside: how often a state came from the background, or on the way home of a body that lost its path |
//! | `taking`, `touches` | taking, touches | where a body has `surface_compliance`: what is set from outside; `taking`, `hands`, every `stylus`, `touches.previous` |
//! | `body.B.loads` | loads | set from outside, of a body with loads |
//! | `contributions` | contributions | where an effect acts on bodies: set by the effects, when the poses of the frame are known |
//! | `body.B.coefficients` | coefficients | see below |
//! | `body.B.surface` | surface | `coefficients`: the paper's `evaluate` |
//!
//! The coefficients of a body are a [`BodyState`], which also holds the motions of the body's parts. They are made from every
//! `pose` of the body, from `arrived`, from `loads` and `place` if the body has loads, from `touches` if it can be touched, and
//! from `contributions` if an effect acts on bodies; they are computed again when one of these changes, as with the paper's
//! `fieldHasChanged`.
//!
//! The functions act on the bodies (their deformers) and on nothing else outside the graph.

use super::body::PlacedBody;
use super::hand;
use super::touch::{LoadValues, Touches};
use crate::deform::{BodyState, Contribution, ControlPose};
use crate::field::{Each, Field, FieldError, Graph, Value, value_types};
use crate::green::FIELDS;
use crate::interact::{Element, HandRequests, Hands, Hit, SurfaceGrip};
use crate::scene::{Body, Grab, Take};
use crate::stage::Stage;
use crate::track::{StylusState, usable};
use indexmap::IndexMap;
use nalgebra::{Isometry3, Similarity3};
use serde::{Deserialize, Serialize};

/// Largest number of styli that are followed; further ones are ignored.
pub(super) const MOST_STYLI: usize = 16;

/// The bodies, on which the graph's functions act beside its fields.
pub type Bodies = Vec<PlacedBody>;

/// The fields of a world by their kinds.
pub struct Fields {
    /// Names of the styli that the stage knows.
    names: Vec<String>,
    pub tracked_head: Field<Tracked>,
    pub time: Field<f64>,
    pub head: Field<Pose>,
    pub styli: Vec<StylusFields>,
    pub hands: Field<HandState>,
    pub bodies: Vec<BodyFields>,
    /// Present if a body can be touched.
    pub touch: Option<TouchFields>,
    /// Present if an effect acts on bodies.
    pub contributions: Option<Field<Contributions>>,
    /// Control elements that can be taken, as (body, control element); the targets of hits and hands are indices into this list.
    pub targets: Vec<(usize, usize)>,
}

/// One stylus, and what it points at while it holds nothing.
#[derive(Clone, Copy)]
pub struct StylusFields {
    pub stylus: Field<Option<StylusState>>,
    pub hit: Field<Option<Hit>>,
}

/// Fields of the hands' grip on surfaces.
#[derive(Clone, Copy)]
pub struct TouchFields {
    pub taking: Field<SurfaceGrip>,
    pub touches: Field<Touches>,
}

pub struct BodyFields {
    pub place: Field<BodyPlace>,
    /// Number of states that came though no pose changed: from the background, or on the way home of a body that lost its path.
    pub arrived: Field<f64>,
    /// One per control element. That of a fixed element can be set from outside.
    pub poses: Vec<Field<ControlPose>>,
    coefficients: Field<BodyState>,
    pub surface: Field<SurfaceVersion>,
    /// Present for a body with loads or a compliance.
    pub loads: Option<Field<LoadValues>>,
    /// Whether forces at single points act on it.
    is_touched: bool,
    /// Values of the loads at the start.
    pub starting: LoadValues,
}

/// The head's pose as the tracker reports it, if it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Tracked(#[serde(with = "crate::field::numbers::option")] pub Option<Isometry3<f32>>);

/// A place and an orientation in the room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Pose(#[serde(with = "crate::field::numbers")] pub Isometry3<f64>);

/// All hands, and what they ask for in this frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandState {
    pub hands: Hands,
    pub asked: HandRequests,
}

/// room_from_body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct BodyPlace(#[serde(with = "crate::field::numbers")] pub Similarity3<f64>);

/// Contributions of all effects to every body in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Contributions(pub Vec<Contribution>);

/// Number of deformations of a surface, which identifies a version of it; the deformer holds its vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SurfaceVersion(pub u64);

value_types! {
    Tracked => "tracked pose",
    Pose => "pose",
    HandState => "hands",
    BodyPlace => "place",
    SurfaceVersion => "surface",
    Option<StylusState> => "stylus",
    Option<Hit> => "hit",
    Contributions => "contributions",
    ControlPose => "control pose",
    BodyState => "coefficients",
}

/// The graph of the bodies of a scene, each with its model, on a stage, with one stylus. The head stands where it was last tracked; before it is
/// tracked for the first time, where the stage's viewer stands.
pub fn graph(bodies: &IndexMap<String, Body>, stage: &Stage) -> Result<(Graph<Bodies>, Fields), FieldError> {
    let (head, radius_m) = (stage.viewer.room_from_head, stage.workspace.radius_m);
    let mut graph = Graph::default();
    let time = graph.field("tracker.time", 0.0)?;
    let tracked_head = graph.field("tracker.head", Tracked::default())?;
    let room_from_head = graph.field("head", Pose(head))?;
    let last = graph.previous(room_from_head)?;
    graph.compute(room_from_head, "usable", (tracked_head, last), |_, (head, last): (&Tracked, &Pose)| {
        head.0.as_ref().and_then(usable).map_or(*last, Pose)
    })?;
    let hands = HandState { hands: Hands::new(radius_m), asked: HandRequests::default() };
    let mut fields = Fields {
        names: stage.tracking.stylus_names().into_iter().map(str::to_owned).collect(),
        tracked_head,
        time,
        head: room_from_head,
        styli: Vec::new(),
        hands: graph.field("hands", hands)?,
        bodies: Vec::new(),
        touch: touch_fields(&mut graph, bodies)?,
        contributions: None,
        targets: targets(bodies),
    };
    for (b, (name, body)) in bodies.iter().enumerate() {
        fields.bodies.push(body_fields(&mut graph, name, body)?);
        fields.connect_body(&mut graph, b)?;
    }
    fields.add_stylus(&mut graph)?;
    for target in 0..fields.targets.len() {
        fields.connect_pose(&mut graph, target)?;
    }
    Ok((graph, fields))
}

/// All control elements that can be taken, as (body, control element).
fn targets(bodies: &IndexMap<String, Body>) -> Vec<(usize, usize)> {
    let of = |(b, body): (usize, &Body)| {
        let takable = body.control.values().enumerate().filter(|(_, c)| c.grab == Grab::Dragger);
        takable.map(move |(c, _)| (b, c)).collect::<Vec<_>>()
    };
    bodies.values().enumerate().flat_map(of).collect()
}

/// Inputs of the touches: what is taken, styli, hands, the last touches.
type SeenByTouches<'a> = (&'a SurfaceGrip, Each<'a, Field<Option<StylusState>>>, &'a HandState, &'a Touches);

/// Inputs of a body's state: poses, what arrived, loads with the place, touches, what effects add.
type SeenByBody<'a> = (
    Each<'a, Field<ControlPose>>,
    &'a f64,
    Each<'a, (Field<LoadValues>, Field<BodyPlace>)>,
    Each<'a, Field<Touches>>,
    Each<'a, Field<Contributions>>,
);

/// Adds the fields of touching, if a body has `surface_compliance`.
fn touch_fields(
    graph: &mut Graph<Bodies>,
    bodies: &IndexMap<String, Body>,
) -> Result<Option<TouchFields>, FieldError> {
    let Some(first) = bodies.values().find_map(|body| body.surface_compliance.as_ref()) else {
        return Ok(None);
    };
    let taking = match first.take {
        Take::Elements => SurfaceGrip::Elements,
        Take::Force => SurfaceGrip::Force,
        Take::Place => SurfaceGrip::Place,
    };
    Ok(Some(TouchFields {
        taking: graph.field("taking", taking)?,
        touches: graph.field("touches", Touches::default())?,
    }))
}

/// The fields of a body.
fn body_fields(graph: &mut Graph<Bodies>, name: &str, body: &Body) -> Result<BodyFields, FieldError> {
    let pose =
        |control: &String| graph.field(format!("body.{name}.control.{control}.pose"), ControlPose::REST);
    let poses: Vec<_> = body.control.keys().map(pose).collect::<Result<_, _>>()?;
    let place = graph.field(format!("body.{name}.place"), BodyPlace(Similarity3::identity()))?;
    let coefficients =
        graph.field(format!("body.{name}.coefficients"), BodyState::at_rest(FIELDS * poses.len()))?;
    let surface = graph.field(format!("body.{name}.surface"), SurfaceVersion(0))?;
    let arrived = graph.field(format!("body.{name}.arrived"), 0.0)?;
    let starting: Vec<f64> = body.loads().into_iter().flat_map(|load| load.start).collect();
    let is_loaded = !starting.is_empty() || body.surface_compliance.is_some();
    let loads = is_loaded.then(|| graph.field(format!("body.{name}.loads"), LoadValues(starting.clone())));
    let loads = loads.transpose()?;
    let is_touched = body.surface_compliance.is_some();
    let starting = LoadValues(starting);
    Ok(BodyFields { place, arrived, poses, coefficients, surface, loads, is_touched, starting })
}

impl Fields {
    /// The stage's name of a stylus. One that the stage does not name, such as the mouse's beside tracked ones, is called by
    /// its number.
    pub fn stylus_name(&self, number: usize) -> String {
        let by_number = || {
            let mut name = (number + 1).to_string();
            while self.names.contains(&name) {
                name.push('\'');
            }
            name
        };
        self.names.get(number).cloned().unwrap_or_else(by_number)
    }

    /// Connects poses → coefficients → surface of body `b`, anew where something else is to act on it.
    fn connect_body(&self, graph: &mut Graph<Bodies>, b: usize) -> Result<(), FieldError> {
        let BodyFields { place, arrived, poses, coefficients, surface, loads, is_touched, .. } =
            &self.bodies[b];
        // Whatever its loads depend on, and nothing of a body without.
        let by_loads: Vec<_> = loads.iter().map(|loads| (*loads, *place)).collect();
        let touches = self.touch.iter().filter(|_| *is_touched).map(|touch| touch.touches);
        let acting: Vec<_> = self.contributions.into_iter().collect();
        let (poses, arrived, touches) = (poses.clone(), *arrived, touches.collect::<Vec<_>>());
        graph.disconnect(*coefficients);
        graph.disconnect(*surface);
        let mut taken = Vec::new();
        graph.compute(
            *coefficients,
            "coefficients",
            (poses, arrived, by_loads, touches, acting),
            move |bodies: &mut Bodies, (poses, _, loads, touches, acting): SeenByBody<'_>| {
                taken.clear();
                taken.extend(poses.iter().copied());
                if let Some(contribution) = acting.get(0).and_then(|all| all.0.get(b)) {
                    bodies[b].take_contribution(contribution);
                }
                if let Some((loads, _)) = loads.get(0) {
                    let none = Touches::default();
                    let applied = touches.get(0).unwrap_or(&none).applied(b, &bodies[b], loads);
                    bodies[b].deformer.apply(&applied);
                }
                let body = &mut bodies[b];
                let homecomings = body.deformer.homecomings;
                body.deformer.take(&taken);
                body.check_path(homecomings);
                body.check_range();
                body.deformer.state.clone()
            },
        )?;
        graph.compute(*surface, "sum", *coefficients, move |bodies: &mut Bodies, _: &BodyState| {
            let body = &mut bodies[b];
            body.deformer.deform();
            body.deformations += 1;
            body.times.deform_s = body.deformer.times.deform_s;
            body.times.normals_s = body.deformer.times.normals_s;
            SurfaceVersion(body.deformations)
        })
    }

    /// Connects the shapes with the effects' contributions as well: once, before the first frame.
    pub fn connect_effects(&mut self, graph: &mut Graph<Bodies>, bodies: &Bodies) -> Result<(), FieldError> {
        let none = bodies.iter().map(|body| body.deformer.no_contribution()).collect();
        self.contributions = Some(graph.field("contributions", Contributions(none))?);
        (0..self.bodies.len()).try_for_each(|b| self.connect_body(graph, b))
    }

    /// Adds a stylus and connects it with the hands.
    pub fn add_stylus(&mut self, graph: &mut Graph<Bodies>) -> Result<(), FieldError> {
        let number = self.styli.len();
        let name = self.stylus_name(number);
        let stylus = graph.field(format!("stylus.{name}"), None)?;
        let hit = graph.field(format!("hit.{name}"), None)?;
        let last = graph.previous(self.hands)?;
        let mut shown = Vec::new();
        for body in &self.bodies {
            shown.push((body.place, graph.previous(body.surface)?));
        }
        let targets = self.targets.clone();
        graph.compute(
            hit,
            "pick",
            (stylus, last, shown),
            move |bodies: &mut Bodies, (stylus, last, _)| {
                let (stylus, last): (&Option<StylusState>, &HandState) = (stylus, last);
                let free = stylus.as_ref().filter(|_| last.hands.grip(number).is_none())?;
                hand::pick(free, bodies, &targets, last.hands.radius_m)
            },
        )?;
        self.styli.push(StylusFields { stylus, hit });
        self.connect_hands(graph)?;
        self.connect_touches(graph)
    }

    /// Connects the touches, where a body can be touched, with all styli.
    fn connect_touches(&self, graph: &mut Graph<Bodies>) -> Result<(), FieldError> {
        let Some(TouchFields { taking, touches }) = self.touch else { return Ok(()) };
        let last = graph.previous(touches)?;
        graph.disconnect(touches);
        let styli: Vec<_> = self.styli.iter().map(|fields| fields.stylus).collect();
        graph.compute(
            touches,
            "touch",
            (taking, styli, self.hands, last),
            move |bodies: &mut Bodies, (taking, styli, hands, last): SeenByTouches<'_>| {
                last.step(*taking, styli.iter(), &hands.hands, bodies)
            },
        )
    }

    /// Connects the hands, which take hold of what their styli point at.
    fn connect_hands(&self, graph: &mut Graph<Bodies>) -> Result<(), FieldError> {
        let last = graph.previous(self.hands)?;
        graph.disconnect(self.hands);
        let styli: Vec<_> = self.styli.iter().map(|fields| fields.stylus).collect();
        let hits: Vec<_> = self.styli.iter().map(|fields| fields.hit).collect();
        let mut poses = Vec::new();
        for &(b, c) in &self.targets {
            poses.push(graph.previous(self.bodies[b].poses[c])?);
        }
        let targets = self.targets.clone();
        let (mut seen_styli, mut seen_hits) = (Vec::new(), Vec::new());
        graph.compute(
            self.hands,
            "hold",
            (self.time, styli, hits, last, poses),
            move |bodies: &mut Bodies, (time, styli, hits, last, poses)| {
                let (last, time): (&HandState, &f64) = (last, time);
                seen_styli.clear();
                seen_styli.extend(styli.iter().copied());
                seen_hits.clear();
                seen_hits.extend(hits.iter().copied());
                let element = |target: usize| {
                    let known = targets.get(target).zip(poses.get(target));
                    known.map(|(&(b, c), pose)| Element {
                        room_from_body: bodies[b].room_from_body,
                        room_from_element: bodies[b].room_from_element(c, pose),
                    })
                };
                let mut hands = last.hands.clone();
                let asked = hands.step(&seen_styli, *time, &seen_hits, element);
                HandState { hands, asked }
            },
        )
    }

    /// Connects the pose of a control element: it goes where hands carry it, as far as a body can follow, or stays.
    fn connect_pose(&self, graph: &mut Graph<Bodies>, target: usize) -> Result<(), FieldError> {
        let (b, c) = self.targets[target];
        let pose = self.bodies[b].poses[c];
        let last = graph.previous(pose)?;
        graph.compute(
            pose,
            "follow",
            (self.hands, last),
            move |bodies: &mut Bodies, (hands, last): (&HandState, &ControlPose)| {
                let drag = hands.asked.drags.iter().find(|drag| drag.target == target);
                let body = &mut bodies[b];
                let asked = drag.and_then(|drag| body.pose_of(c, &drag.room_from_element));
                body.admit(c, last, &asked.unwrap_or(*last))
            },
        )
    }
}
