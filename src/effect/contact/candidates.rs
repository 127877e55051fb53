//! Nodes of a body that may touch something in a frame, and their places.

use super::touch::{Contact, at_nodes};
use super::touched_body::{SurfaceSpot, TouchedBody};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// A set of a body's nodes.
#[derive(Debug, Default)]
pub struct Nodes {
    /// Numbers in ascending order.
    list: Vec<u32>,
    /// Place of each node of the body in the list; none where there is no list.
    slots: Vec<Option<u32>>,
}

impl Nodes {
    /// The set of these nodes of a body that has `count`.
    pub fn new(mut list: Vec<u32>, count: usize) -> Arc<Nodes> {
        list.sort_unstable();
        list.dedup();
        let mut slots = if list.is_empty() { Vec::new() } else { vec![None; count] };
        (0..).zip(&list).for_each(|(slot, node)| slots[*node as usize] = Some(slot));
        Arc::new(Nodes { list, slots })
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub fn iter(&self) -> impl Iterator<Item = u32> + Clone + use<'_> {
        self.list.iter().copied()
    }

    pub fn contains(&self, node: u32) -> bool {
        self.slot(node).is_some()
    }

    fn slot(&self, node: u32) -> Option<usize> {
        self.slots.get(node as usize)?.map(|slot| slot as usize)
    }
}

/// Places of a set of nodes in the room.
#[derive(Clone, Debug, Default)]
pub struct Places {
    nodes: Arc<Nodes>,
    at: Vec<V3>,
}

impl Places {
    pub fn new(nodes: &Arc<Nodes>, place: impl FnMut(u32) -> V3) -> Places {
        Places { nodes: nodes.clone(), at: nodes.iter().map(place).collect() }
    }

    /// Places of nodes of a body without what the columns of contacts show, in the state that was taken last.
    pub fn free(body: &TouchedBody, nodes: &Arc<Nodes>) -> Places {
        let places = body.free.places_in_state(nodes.iter()).into_iter();
        let at = places.map(|x| (body.room_from_body * Point3::from(x)).coords).collect();
        Places { nodes: nodes.clone(), at }
    }

    /// Places of some nodes of a body with the forces of all contacts, in the state that was taken last.
    pub fn pressed(bodies: &[TouchedBody], all: &[Contact], body: usize, nodes: Vec<u32>) -> Places {
        let nodes = Nodes::new(nodes, bodies[body].takes.len());
        Places::free(&bodies[body], &nodes).moved(&bodies[body], &at_nodes(bodies, all, body))
    }

    /// Places of the same nodes after forces at nodes, along the axes of the columns, have moved them.
    pub fn moved(&self, body: &TouchedBody, forces: &[(u32, V3)]) -> Places {
        let moved = body.moved(forces, self.nodes.iter());
        let at = self.at.iter().zip(moved).map(|(x, by)| x + by).collect();
        Places { nodes: self.nodes.clone(), at }
    }

    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// Longest way of a node to where it is in another list of the same nodes, m.
    pub fn farthest(&self, to: &Places) -> f64 {
        self.at.iter().zip(&to.at).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    pub fn nodes(&self) -> &Arc<Nodes> {
        &self.nodes
    }

    pub fn get(&self, node: u32) -> Option<V3> {
        Some(self.at[self.nodes.slot(node)?])
    }

    /// Place of a spot, all nodes of which are in the set.
    pub fn of(&self, spot: &SurfaceSpot) -> V3 {
        spot.corners().filter_map(|(node, w)| Some(self.get(node)? * w)).sum()
    }
}
