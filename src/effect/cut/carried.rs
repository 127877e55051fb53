//! Hands that carry pieces which have fallen off.
//!
//! In: the styli of a frame, and the pieces where they are. Out: which piece each hand carries and where to, and which it points at. A hand
//! takes the piece that the tip of its stylus touches, or else the ray hits, when its button is pressed and it takes no control element.

use crate::interact::PickTarget;
use crate::mesh::split::TetCorner;
use crate::track::{Signal, StylusState};
use crate::world::hand::pick_shape;
use crate::world::{Highlight, World};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// A piece: number of the body among those that are cut, and the lowest corner of a tetrahedron in it.
pub type PieceId = (usize, TetCorner);

/// All hands, by stylus.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Carriers(Vec<Carrier>);

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Carrier {
    was_pressed: bool,
    carries: Option<Carried>,
    /// The piece that it would take now.
    #[serde(skip)]
    points_at: Option<PieceId>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Carried {
    piece: PieceId,
    #[serde(with = "crate::field::numbers")]
    stylus_from_piece: Isometry3<f64>,
}

impl Carriers {
    /// Sees the hands of a frame: they let go of pieces, and take others.
    pub fn see(&mut self, world: &World, pieces: &[(PieceId, PickTarget<'_>)]) {
        self.0.resize(world.fields.styli.len(), Carrier::default());
        let is_there = |carried: &Carried| pieces.iter().any(|(piece, _)| *piece == carried.piece);
        self.0.iter_mut().for_each(|hand| hand.carries = hand.carries.filter(is_there));
        for i in 0..self.0.len() {
            let stylus = world.graph.get(world.fields.styli[i].stylus).as_ref();
            let taken = self.0[i].see((i, stylus), world, pieces);
            if let Some(taken) = taken {
                let is_other = |carried: &Carried| carried.piece != taken.piece;
                self.0.iter_mut().for_each(|hand| hand.carries = hand.carries.filter(is_other));
                self.0[i].carries = Some(taken);
            }
        }
    }

    /// The pieces of a body that hands carry, with the pose in the room to which they are carried.
    pub fn of_body(&self, body: usize, world: &World) -> Vec<(TetCorner, Isometry3<f64>)> {
        let hands = &world.graph.get(world.fields.hands).hands;
        let goal = |(i, hand): (usize, &Carrier)| {
            let Carried { piece: (of, corner), stylus_from_piece } = hand.carries?;
            Some((corner, hands.room_from_stylus(i)? * stylus_from_piece)).filter(|_| of == body)
        };
        self.0.iter().enumerate().filter_map(goal).collect()
    }

    /// Whether the hand with the stylus of this number carries a piece.
    pub fn carries(&self, stylus: usize) -> bool {
        self.0.get(stylus).is_some_and(|hand| hand.carries.is_some())
    }

    pub fn highlight(&self, piece: PieceId) -> Highlight {
        if self.0.iter().any(|hand| hand.carries.is_some_and(|carried| carried.piece == piece)) {
            Highlight::Held
        } else if self.0.iter().any(|hand| hand.points_at == Some(piece)) {
            Highlight::Hovered
        } else {
            Highlight::Idle
        }
    }
}

impl Carrier {
    /// Sees the stylus of this number; returns what it takes.
    fn see(
        &mut self,
        (i, stylus): (usize, Option<&StylusState>),
        world: &World,
        pieces: &[(PieceId, PickTarget<'_>)],
    ) -> Option<Carried> {
        self.points_at = None;
        let Some(stylus) = stylus else {
            *self = Carrier::default();
            return None;
        };
        let begins = stylus.pressed && !self.was_pressed;
        self.was_pressed = stylus.pressed;
        let is_lost = matches!(stylus.signal, Signal::Lost { .. });
        if is_lost || !stylus.pressed {
            self.carries = None;
        }
        let hands = &world.graph.get(world.fields.hands).hands;
        let is_busy = hands.grip(i).is_some()
            || world.touched(i).is_some()
            || self.carries.is_some()
            || (!begins && world.graph.get(world.fields.styli[i].hit).is_some());
        if is_lost || is_busy || (stylus.pressed && !begins) {
            return None;
        }
        let targets: Vec<PickTarget<'_>> = pieces.iter().map(|(_, target)| *target).collect();
        let hit = pick_shape(stylus, &targets, world.assets.stage.workspace.radius_m)?;
        let (piece, target) = pieces[hit.target];
        if !begins {
            self.points_at = Some(piece);
            return None;
        }
        let stylus_from_room = hands.room_from_stylus(i)?.inverse();
        Some(Carried { piece, stylus_from_piece: stylus_from_room * target.room_from_body.isometry })
    }
}
