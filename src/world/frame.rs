//! What one frame shows, thrown away with the next.
//!
//! In: a world after [`World::step`](super::World::step). Out: colours of the bodies, forces, what is drawn beside the bodies, warnings.
//! The shapes of the bodies themselves stay with their deformers, which the next frame brings up to date.

use super::assets::{Assets, BodyAssets};
use super::force_scale::ForceScale;
use super::highlight::Highlight;
use super::times::StepTimes;
use crate::deform::ExpectedErrors;
use crate::render::Drawable;
use nalgebra::Vector3;
use std::sync::Arc;

/// What one frame shows; the next one begins empty.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Time since the frame before, s.
    pub dt_s: f64,
    pub bodies: Vec<BodyFrame>,
    /// The forces of held elements, of bodies that list an effect with forces.
    pub forces: Vec<HeldForce>,
    /// Styli, arrows, the ruler, and what effects draw.
    pub drawables: Vec<Drawable>,
    /// What effects warn of.
    pub warnings: Vec<String>,
    /// What the mechanics took.
    pub times: StepTimes,
}

/// What a frame shows of a body beside its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyFrame {
    /// Per control element.
    pub highlights: Vec<Highlight>,
    /// Where an effect shows a field in colours: the code of every node ([`crate::render::field_code`]).
    pub colours: Option<Arc<Vec<[u8; 4]>>>,
    /// Where an effect shows forces: how.
    pub force_scale: Option<Arc<ForceScale>>,
    /// Where an effect has measured them: what errors to expect of its model.
    pub expected: Option<Arc<ExpectedErrors>>,
}

/// The force of the body on the hand that holds one of its control elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldForce {
    pub body: usize,
    pub control: usize,
    /// N, along the room's axes.
    pub force_n: Vector3<f64>,
    /// The force of the longest arrow, N.
    pub full_n: f64,
}

impl BodyFrame {
    /// Whether the body has the colours of another frame, told by what they were made from.
    pub fn is_drawn_as(&self, other: &BodyFrame) -> bool {
        let is_same = match (&self.colours, &other.colours) {
            (Some(one), Some(two)) => Arc::ptr_eq(one, two),
            (one, two) => one.is_none() && two.is_none(),
        };
        is_same && self.highlights == other.highlights
    }
}

impl Frame {
    /// Nothing but the bodies.
    pub(super) fn of(assets: &Assets) -> Frame {
        let of = |body: &Arc<BodyAssets>| BodyFrame {
            highlights: vec![Highlight::Idle; body.controls.len()],
            ..BodyFrame::default()
        };
        Frame { bodies: assets.bodies.iter().map(of).collect(), ..Frame::default() }
    }

    /// All drawables of a kind, such as [`Drawable::plate`].
    pub fn all<'a, T>(&'a self, kind: fn(&'a Drawable) -> Option<&'a T>) -> impl Iterator<Item = &'a T> {
        self.drawables.iter().filter_map(kind)
    }

    pub(super) fn draw(&mut self, drawable: Drawable) {
        self.drawables.push(drawable);
    }
}
