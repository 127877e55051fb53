//! The world as a graph of fields: stylus → hit → dragger → control pose → coefficients → surface.
//!
//! | field | type | made from |
//! |---|---|---|
//! | `tracker.head` | tracked pose | set from outside |
//! | `head` | pose | `tracker.head`, `head.previous`: the last usable one |
//! | `stylus.right` | stylus | set from outside |
//! | `hit.right` | hit | `stylus.right`, `dragger.right.previous`, every `surface.previous`: the body as it was seen |
//! | `dragger.right` | dragger | `stylus.right`, `hit.right`, `dragger.right.previous`, every `pose.previous` |
//! | `body.B.control.C.pose` | control pose | every dragger, `pose.previous` |
//! | `body.B.coefficients` | coefficients | every `pose` of the body: the paper's `fieldHasChanged` |
//! | `body.B.surface` | surface | `coefficients`: the paper's `evaluate` |
//!
//! The functions act on the bodies (their deformers) and on nothing else outside the graph.

use super::PlacedBody;
use super::hand::{self, Grip};
use crate::deform::{Coefficients, ControlPose};
use crate::field::{Each, Field, FieldError, Graph, Value};
use crate::interact::Hit;
use crate::scene::{Body, Grab, Scene};
use crate::track::{StylusState, usable};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// What the graph's functions act on beside its fields.
pub type Bodies = Vec<PlacedBody>;

/// The fields of a world by what they are.
pub struct Fields {
    pub tracked_head: Field<Tracked>,
    pub head: Field<Pose>,
    pub hands: Vec<HandFields>,
    pub bodies: Vec<BodyFields>,
    /// Control elements that can be taken, as (body, control element): what a hit and a dragger number.
    pub targets: Vec<(usize, usize)>,
}

/// One stylus.
#[derive(Clone, Copy)]
pub struct HandFields {
    pub stylus: Field<Option<StylusState>>,
    pub hit: Field<Option<Hit>>,
    pub dragger: Field<Grip>,
}

pub struct BodyFields {
    /// Per control element. That of a fixed one can be set.
    pub poses: Vec<Field<ControlPose>>,
    #[allow(dead_code, reason = "for the overlay")]
    pub coefficients: Field<Coefficients>,
    pub surface: Field<Surface>,
}

/// A head as the tracker has it, where it has one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Tracked(#[serde(with = "crate::field::numbers::option")] pub Option<Isometry3<f32>>);

/// A place and an orientation in the room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Pose(#[serde(with = "crate::field::numbers")] pub Isometry3<f64>);

/// A deformed surface by how often it was deformed; its vertices are the deformer's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Surface(pub u64);

impl Value for Tracked {
    const TYPE: &'static str = "tracked pose";
}

impl Value for Pose {
    const TYPE: &'static str = "pose";
}

impl Value for Surface {
    const TYPE: &'static str = "surface";
}

impl Value for Option<StylusState> {
    const TYPE: &'static str = "stylus";
}

impl Value for Option<Hit> {
    const TYPE: &'static str = "hit";
}

impl Value for ControlPose {
    const TYPE: &'static str = "control pose";
}

impl Value for Coefficients {
    const TYPE: &'static str = "coefficients";
}

/// The graph of a scene, with a head that stands there as long as none is tracked, and one hand.
pub fn graph(scene: &Scene, head: Isometry3<f64>) -> Result<(Graph<Bodies>, Fields), FieldError> {
    let mut graph = Graph::default();
    let tracked_head = graph.field("tracker.head", Tracked::default())?;
    let room_from_head = graph.field("head", Pose(head))?;
    let last = graph.previous(room_from_head)?;
    graph.compute(room_from_head, "usable", (tracked_head, last), |_, (head, last): (&Tracked, &Pose)| {
        head.0.as_ref().and_then(usable).map_or(*last, Pose)
    })?;
    let mut fields = Fields {
        tracked_head,
        head: room_from_head,
        hands: Vec::new(),
        bodies: Vec::new(),
        targets: targets(scene),
    };
    for (b, (name, body)) in scene.body.iter().enumerate() {
        fields.bodies.push(body_fields(&mut graph, b, name, body)?);
    }
    fields.add_hand(&mut graph)?;
    Ok((graph, fields))
}

/// All control elements that can be taken, as (body, control element).
fn targets(scene: &Scene) -> Vec<(usize, usize)> {
    let of = |(b, body): (usize, &Body)| {
        let takable = body.control.values().enumerate().filter(|(_, c)| c.grab == Grab::Dragger);
        takable.map(move |(c, _)| (b, c)).collect::<Vec<_>>()
    };
    scene.body.values().enumerate().flat_map(of).collect()
}

/// Poses → coefficients → surface of body `b`.
fn body_fields(
    graph: &mut Graph<Bodies>,
    b: usize,
    name: &str,
    body: &Body,
) -> Result<BodyFields, FieldError> {
    let pose =
        |control: &String| graph.field(format!("body.{name}.control.{control}.pose"), ControlPose::REST);
    let poses: Vec<_> = body.control.keys().map(pose).collect::<Result<_, _>>()?;
    let coefficients =
        graph.field(format!("body.{name}.coefficients"), Coefficients::at_rest(poses.len()))?;
    let surface = graph.field(format!("body.{name}.surface"), Surface(0))?;
    let mut taken = Vec::new();
    graph.compute(
        coefficients,
        "coefficients",
        poses.clone(),
        move |bodies: &mut Bodies, poses: Each<'_, Field<ControlPose>>| {
            taken.clear();
            taken.extend(poses.iter().copied());
            let body = &mut bodies[b];
            body.deformer.take(&taken);
            body.check_range();
            body.deformer.coefficients.clone()
        },
    )?;
    graph.compute(surface, "sum", coefficients, move |bodies: &mut Bodies, _: &Coefficients| {
        let body = &mut bodies[b];
        body.deformer.deform();
        (body.moved, body.deformations) = (true, body.deformations + 1);
        body.times.deform_s = body.deformer.times.deform_s;
        body.times.normals_s = body.deformer.times.normals_s;
        Surface(body.deformations)
    })?;
    Ok(BodyFields { poses, coefficients, surface })
}

impl Fields {
    /// One more hand, at whose draggers every pose looks from now on.
    pub fn add_hand(&mut self, graph: &mut Graph<Bodies>) -> Result<(), FieldError> {
        let name = match self.hands.len() {
            0 => "right".to_owned(),
            1 => "left".to_owned(),
            n => (n + 1).to_string(),
        };
        let stylus = graph.field(format!("stylus.{name}"), None)?;
        let hit = graph.field(format!("hit.{name}"), None)?;
        let dragger = graph.field(format!("dragger.{name}"), Grip::default())?;
        let last = graph.previous(dragger)?;
        let mut surfaces = Vec::new();
        for body in &self.bodies {
            surfaces.push(graph.previous(body.surface)?);
        }
        let mut poses = Vec::new();
        for &(b, c) in &self.targets {
            poses.push(graph.previous(self.bodies[b].poses[c])?);
        }
        let targets = self.targets.clone();
        graph.compute(
            hit,
            "pick",
            (stylus, last, surfaces),
            move |bodies: &mut Bodies,
                  (stylus, last, _): (&Option<StylusState>, &Grip, Each<'_, Field<Surface>>)| {
                let free = stylus.as_ref().filter(|_| last.dragger.held().is_none())?;
                hand::pick(free, bodies, &targets)
            },
        )?;
        let targets = self.targets.clone();
        graph.compute(
            dragger,
            "drag",
            (stylus, hit, last, poses),
            move |bodies: &mut Bodies, (stylus, hit, last, poses)| {
                let stylus: &Option<StylusState> = stylus;
                let matrix = |target: usize| {
                    let (b, c) = targets[target];
                    let pose = poses.get(target).copied().unwrap_or(ControlPose::REST);
                    bodies[b].room_from_element(c, &pose)
                };
                stylus.map_or_else(Grip::default, |stylus| last.follow(&stylus, hit.as_ref(), matrix))
            },
        )?;
        self.hands.push(HandFields { stylus, hit, dragger });
        for target in 0..self.targets.len() {
            self.connect_pose(graph, target)?;
        }
        Ok(())
    }

    /// A control element goes where a hand carries it, as far as a body can follow; else it stays.
    fn connect_pose(&self, graph: &mut Graph<Bodies>, target: usize) -> Result<(), FieldError> {
        let (b, c) = self.targets[target];
        let pose = self.bodies[b].poses[c];
        let last = graph.previous(pose)?;
        graph.disconnect(pose);
        let draggers: Vec<Field<Grip>> = self.hands.iter().map(|hand| hand.dragger).collect();
        graph.compute(
            pose,
            "follow",
            (draggers, last),
            move |bodies: &mut Bodies, (draggers, last): (Each<'_, Field<Grip>>, &ControlPose)| {
                let drags = draggers.iter().filter_map(|grip| grip.drag);
                let drag = drags.filter(|drag| drag.target == target).last();
                let body = &mut bodies[b];
                let asked = drag.and_then(|drag| body.pose_of(c, &drag.room_from_element));
                body.admit(c, last, &asked.unwrap_or(*last))
            },
        )
    }
}
