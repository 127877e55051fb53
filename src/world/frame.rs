//! The content of one frame, which is thrown away with the next.
//!
//! In: a world after [`World::step`](super::World::step). Out: colours of the bodies, forces, drawables beside the bodies,
//! warnings, whether a hand points at a control element, holds it, or neither ([`Highlight`]), and the time that the
//! mechanics took ([`StepTimes`]). The shapes of the bodies themselves stay with their deformers, which the next frame
//! brings up to date.

use super::assets::{Assets, BodyAssets};
use super::dissipation::Dissipation;
use super::force_scale::ForceScale;
use super::vibration::Vibration;
use crate::deform::{ExpectedErrors, TouchPotential};
use crate::render::Drawable;
use crate::scene::Color;
#[cfg(doc)]
use crate::scene::Quantity;
use nalgebra::Vector3;
use std::sync::Arc;

/// The content of one frame; the next one begins empty.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Time since the frame before, s.
    pub dt_s: f64,
    pub bodies: Vec<BodyFrame>,
    /// The forces of held elements, of bodies that list an effect with forces.
    pub forces: Vec<HeldForce>,
    /// Styli, arrows, the ruler, and what effects draw.
    pub drawables: Vec<Drawable>,
    /// Warnings of effects.
    pub warnings: Vec<String>,
    /// Times of the mechanics.
    pub times: StepTimes,
}

/// The look of a body in a frame, beside its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyFrame {
    /// The highlight of each control element.
    pub highlights: Vec<Highlight>,
    /// The code of every node ([`crate::render::field_code`]), if an effect shows a field in colours.
    pub colours: Option<Arc<Vec<[u8; 4]>>>,
    /// The scale of forces, if an effect shows them.
    pub force_scale: Option<Arc<ForceScale>>,
    /// The errors to expect of its model, if an effect has measured them.
    pub expected: Option<Arc<ExpectedErrors>>,
    /// Tools on styli with a force device that can touch it.
    pub touches: Vec<TouchPotential>,
    /// Its vibration, if it is to be heard.
    pub vibration: Option<Arc<Vibration>>,
    /// Work of what rubs and cuts it, if it is to be heard.
    pub dissipation: Dissipation,
    /// The largest value of each quantity on its surface, in the order of [`Quantity::ALL`], if an effect measures them and it is to be heard.
    pub largest: Option<[f64; 3]>,
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
    /// Whether the body has the colours of another frame: made from the same codes, with the same highlights.
    pub fn is_drawn_as(&self, other: &BodyFrame) -> bool {
        let is_same = match (&self.colours, &other.colours) {
            (Some(one), Some(two)) => Arc::ptr_eq(one, two),
            (one, two) => one.is_none() && two.is_none(),
        };
        is_same && self.highlights == other.highlights
    }
}

impl Frame {
    /// A frame with nothing but the bodies.
    pub(super) fn at_rest(assets: &Assets) -> Frame {
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

/// Decides the colour of a control element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Highlight {
    Idle,
    Hovered,
    Held,
}

impl Highlight {
    /// Colour of what a hand can take.
    pub fn color(self) -> Color {
        Color(match self {
            Highlight::Idle => [224, 138, 52],
            Highlight::Hovered => [255, 186, 96],
            Highlight::Held => [170, 214, 84],
        })
    }
}

/// Time of the mechanics of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Pick rays and hands.
    pub interact_s: f64,
    pub deform_s: f64,
    pub normals_s: f64,
}

impl StepTimes {
    pub fn total_s(&self) -> f64 {
        self.interact_s + self.deform_s + self.normals_s
    }
}
