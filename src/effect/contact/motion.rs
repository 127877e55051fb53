//! All that lasts from frame to frame.

use super::touch::{Against, Contact, shifted};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::deform::DeformerState;
use crate::world::tool::Tool;
use nalgebra::{Isometry3, Similarity3, Vector3};
use serde::{Deserialize, Serialize};

type V3 = Vector3<f64>;

/// All that lasts from frame to frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Last place of each tool, and by how far its spring had yielded, m.
    pub tools: Vec<Placed>,
    pub contacts: Vec<Contact>,
    /// Last place of each touched body.
    #[serde(with = "crate::field::numbers::list")]
    pub places: Vec<Similarity3<f64>>,
    /// Each touched body without contact.
    pub free: Vec<DeformerState>,
    /// Whether the forces are those of the last frame's poses, loads and tools.
    pub is_settled: bool,
    /// Frames for which bodies with inertia have lain still, one more than they need while they rest ([`rest`](super::rest)).
    #[serde(default)]
    pub still: u32,
    /// Forces on each touched body with inertia in the mean over the last frame, along its axes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pushed: Vec<Vec<Push>>,
}

/// A force at a node, N.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Push {
    pub node: u32,
    #[serde(with = "crate::field::numbers")]
    pub force: V3,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placed {
    #[serde(with = "crate::field::numbers::option")]
    pub pose: Option<Isometry3<f64>>,
    #[serde(with = "crate::field::numbers")]
    pub yielded: V3,
}

impl Placed {
    /// Pose of its surface: the hand's, less what its spring yields.
    pub fn surface(&self) -> Option<Isometry3<f64>> {
        self.pose.map(|pose| shifted(&pose, &self.yielded))
    }
}

impl Motion {
    /// Whether it is that of these bodies, tools and pairs of bodies.
    pub fn fits(&self, bodies: &[TouchedBody], tools: &[Tool], pairs: &[[usize; 2]]) -> bool {
        let is_pair = |one: usize, other: usize| {
            pairs.iter().any(|pair| *pair == [one, other] || *pair == [other, one])
        };
        let fits = |contact: &Contact| {
            let is_known = match contact.against {
                Against::Tool(tool) => tool < tools.len(),
                Against::Surface { body, .. } => is_pair(contact.body, body),
            };
            let spot_fits = |(body, spot, _): (usize, SurfaceSpot, f64)| {
                bodies.get(body).is_some_and(|body| body.bears(&spot))
            };
            is_known && contact.sides().all(spot_fits)
        };
        let knows = |(pushed, body): (&Vec<Push>, &TouchedBody)| {
            pushed.iter().all(|push| (push.node as usize) < body.takes.len())
        };
        (self.tools.len(), self.free.len()) == (tools.len(), bodies.len())
            && (self.places.is_empty() || self.places.len() == bodies.len())
            && self.contacts.iter().all(fits)
            && self.pushed.iter().zip(bodies).all(knows)
    }
}
