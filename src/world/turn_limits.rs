//! The turn and the strain of a deformed body, against those up to which its model is good.

use super::body::PlacedBody;
use crate::deform::{
    Bearing, Deformer, Doubt, ModelEntry, REDUCED_NEO_HOOKEAN, law_strain, local_turn, mean_strain,
};
use crate::fem::{NEO_HOOKEAN, STVK};
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Number of triangles of a body that are sampled for their turns.
const PIECES: usize = 256;
/// Number of triangles whose strain is taken: as all of most bodies, for what pulls at a point strains few of them.
const STRAINED: usize = 16_384;
/// Number of triangles from which the strain against a material law is found, which costs a sum of all columns at each of their nodes.
const STRAINED_BY_LAW: usize = 512;
/// Error of force and shape beyond which a strain is told, and for a mean strain of 1. A bar of St. Venant and Kirchhoff's law bears
/// (1 + ε)(1 + ½ε) times as much as by Hooke's, by 3/2 ε more; a liver pulled at a point, by mean strains of 2.7, 9 and 18 %, moves by 8,
/// 19 and 28 % less, and by 0, 6 and 54 % more by neo-Hooke's law. Between these two laws, whose strain is that of [`law_strain`], the
/// force of a bar of ν = 0.3 differs by 10, 19, 33 and 53 % where it is pulled by 5, 10, 20 and 40 %. That of the corotational law is in
/// proportion to ε, and differs from neo-Hooke's by 3ν/(1 + ν) ε, at most ε.
const MOST: f64 = 0.1;
const ERROR: f64 = 2.0;
const ERROR_OF_COROTATIONAL: f64 = 1.0;

/// Largest turns for which a model is good, and for which it is fair, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnLimits {
    pub good: f64,
    pub fair: f64,
    /// Whether the limits were measured for this very body, by the plan of its accuracy, between two control elements
    /// ([`crate::deform::Deformer::largest_turn`]). Otherwise they hold for any piece of the surface ([`local_turn`]), by the
    /// table of [`TurnLimits::of_model`].
    pub is_measured: bool,
}

/// A judgement of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Good,
    Fair,
    /// A turn beyond the model's table.
    Poor,
    /// A turn beyond those that were measured on the body.
    NotMeasured,
    /// More than half a turn between two control elements, for which no model is made: the matrices of the poses are those of
    /// smaller turns.
    Beyond,
}

impl TurnLimits {
    /// Angles at which bent bodies were measured to be off by about 0.2 % and 2 % of their length, RMS, as the model's
    /// entry has them.
    pub fn of_model(model: &ModelEntry) -> Self {
        let [good, fair] = model.turn_limits_deg.map(f64::to_radians);
        Self { good, fair, is_measured: false }
    }

    /// The turn of a body, and its limits. It is the turn between control elements where these are more than half a turn apart,
    /// which no piece of the surface shows, and for a model that moves parts.
    pub fn of_body(body: &PlacedBody) -> (f64, Self) {
        match body.assets.range {
            Some(range) => {
                (body.deformer.largest_turn(), Self { good: range, fair: range, is_measured: true })
            }
            None => Self::of_deformer(&body.deformer),
        }
    }

    /// The turn and the limits of a body for which nothing was measured.
    pub fn of_deformer(deformer: &Deformer) -> (f64, Self) {
        let apart = deformer.largest_turn();
        let is_apart = apart > PI || deformer.moves_in_parts();
        let turn = if is_apart { apart } else { local_turn(deformer, PIECES) };
        (turn, Self::of_model(deformer.entry))
    }

    pub fn verdict(&self, turn: f64) -> Verdict {
        match turn {
            turn if turn <= self.good => Verdict::Good,
            turn if turn <= self.fair => Verdict::Fair,
            turn if turn > PI => Verdict::Beyond,
            _ if self.is_measured => Verdict::NotMeasured,
            _ => Verdict::Poor,
        }
    }
}

impl Verdict {
    /// Whether the body is bent further than its model holds.
    pub fn is_out_of_range(self) -> bool {
        !matches!(self, Verdict::Good | Verdict::Fair)
    }

    pub fn name(self) -> &'static str {
        match self {
            Verdict::Good => "good",
            Verdict::Fair => "fair",
            Verdict::Poor => "poor",
            Verdict::NotMeasured => "not measured",
            Verdict::Beyond => "too far",
        }
    }
}

/// A warning if the body is bent beyond the model's range, or its state is in doubt; else `None`.
pub fn out_of_range(body: &PlacedBody) -> Option<String> {
    words(TurnLimits::of_body(body), strained(&body.deformer), body.deformer.doubt(), body.assets.model)
}

/// [`out_of_range`] for a body that is in no world.
pub fn out_of_range_of(deformer: &Deformer) -> Option<String> {
    words(TurnLimits::of_deformer(deformer), strained(deformer), deformer.doubt(), deformer.entry)
}

/// Whether a body is bent or strained beyond the range of its model, or its state is in doubt. A strain beyond a material law is none of
/// these: the model holds, for the material that the scene names.
pub fn is_beyond_model(body: &PlacedBody) -> bool {
    let (turn, limits) = TurnLimits::of_body(body);
    let deformer = &body.deformer;
    let is_strained = || sums_columns(deformer.entry) && strain(deformer).error() > MOST;
    limits.verdict(turn).is_out_of_range() || deformer.doubt().is_some() || is_strained()
}

/// A strain, and the error of force and shape for a strain of 1.
#[derive(Clone, Copy)]
struct Strain {
    mean: f64,
    factor: f64,
}

impl Strain {
    fn error(self) -> f64 {
        self.factor * self.mean
    }

    fn words(self, advice: &str) -> Option<String> {
        let (mean, error) = (100.0 * self.mean, 100.0 * self.error());
        (self.error() > MOST)
            .then(|| format!("strained by {mean:.0} %: force and shape may be {error:.0} % off{advice}"))
    }
}

/// Whether a model sums columns of the theory of small strain.
fn sums_columns(model: &ModelEntry) -> bool {
    matches!(model.loads, Bearing::Columns)
}

/// The strain of a body by its poses, loads and forces at points, of which its model or its material law may be wrong.
fn strain(deformer: &Deformer) -> Strain {
    if sums_columns(deformer.entry) {
        return Strain { mean: mean_strain(deformer, STRAINED), factor: ERROR };
    }
    let corners = |node: u32| {
        [Vector3::from(deformer.rest()[node as usize]).cast(), deformer.straining_part(node as usize)]
    };
    let free = deformer.free_stretch();
    strain_of_law(deformer.entry, deformer.triangles(), &corners, free, STRAINED_BY_LAW)
}

/// The strain of a surface against its model's law.
fn strain_of_law(
    model: &ModelEntry,
    triangles: &[[u32; 3]],
    corners: &dyn Fn(u32) -> [Vector3<f64>; 2],
    free: f64,
    most: usize,
) -> Strain {
    let factor = match model.large_strain_law().name {
        name if name == STVK.name => ERROR,
        name if name == NEO_HOOKEAN.name => return Strain { mean: 0.0, factor: 0.0 },
        _ => ERROR_OF_COROTATIONAL,
    };
    Strain { mean: law_strain(triangles, corners, free, most).abs(), factor }
}

/// A warning if a surface is strained more than the law of its model is for: [`law_strain`] of all triangles.
pub fn beyond_law(
    model: &ModelEntry,
    triangles: &[[u32; 3]],
    corners: &dyn Fn(u32) -> [Vector3<f64>; 2],
    free: f64,
) -> Option<String> {
    strain_of_law(model, triangles, corners, free, usize::MAX).words(&advice(NEO_HOOKEAN.name))
}

/// [`strain`], and what bears more; no model of large strain is pressed at single points by effects.
fn strained(deformer: &Deformer) -> (Strain, String) {
    let is_pressed = !deformer.contribution().points.is_empty();
    let has_fields = deformer.entry.is_reduced() && deformer.controls.len() == 2;
    let bears = if has_fields { REDUCED_NEO_HOOKEAN.name } else { NEO_HOOKEAN.name };
    (strain(deformer), if is_pressed { String::new() } else { advice(bears) })
}

fn advice(model: &str) -> String {
    format!("; {model} bears large strain")
}

fn words(
    (turn, limits): (f64, TurnLimits),
    (strain, advice): (Strain, String),
    doubt: Option<Doubt>,
    ModelEntry { name, .. }: &ModelEntry,
) -> Option<String> {
    let (turned, most) = (turn.to_degrees(), limits.fair.to_degrees());
    let held = format!("the model {name} holds up to {most:.0}°");
    let strained = strain.words(&advice);
    match limits.verdict(turn) {
        Verdict::Good | Verdict::Fair => doubt.map(|doubt| doubt.explain().to_owned()).or(strained),
        Verdict::Beyond => Some(format!("turned {:.1} times round; {held}", turn / (2.0 * PI))),
        Verdict::NotMeasured => {
            Some(format!("turned by {turned:.0}°; its error was measured up to {most:.0}°"))
        }
        Verdict::Poor => {
            // A turn that differs from the limit by less than the whole degrees show.
            let digits = usize::from(turned.round() == most.round());
            let strained = strained.map_or_else(String::new, |strained| format!("; {strained}"));
            Some(format!("turned by {turned:.digits$}°; {held}{strained}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::ROTATION;

    /// "51°: beyond the model rotation, for up to 45°" made readers stop.
    #[test]
    fn a_body_that_is_bent_too_far_says_how_far_and_how_far_its_model_holds() {
        let table = TurnLimits::of_model(&ROTATION);
        let measured = TurnLimits { good: 0.7, fair: 0.7, is_measured: true };
        let by = |mean: f64| Strain { mean, factor: ERROR };
        let none = String::new;
        let told =
            |degrees: f64, limits| words((degrees.to_radians(), limits), (by(0.04), none()), None, &ROTATION);
        assert_eq!(told(44.0, table), None);
        let lost = words((0.1, table), (by(0.5), none()), Some(Doubt::NoEquilibrium), &ROTATION);
        assert_eq!(lost.as_deref(), Some("these poses have no equilibrium; an earlier one is shown"));
        let strained = words((0.1, table), (by(0.2), "; advice".to_owned()), None, &ROTATION);
        assert_eq!(strained.as_deref(), Some("strained by 20 %: force and shape may be 40 % off; advice"));
        let holds = "; the model rotation holds up to 45°";
        assert_eq!(told(51.0, table), Some(format!("turned by 51°{holds}")));
        assert_eq!(told(45.2, table), Some(format!("turned by 45.2°{holds}")));
        let both = words((1.0, table), (by(0.2), none()), None, &ROTATION);
        assert_eq!(
            both,
            Some(format!("turned by 57°{holds}; strained by 20 %: force and shape may be 40 % off"))
        );
        assert_eq!(told(720.0, table), Some(format!("turned 2.0 times round{holds}")));
        let error = "turned by 51°; its error was measured up to 40°";
        assert_eq!(told(51.0, measured).as_deref(), Some(error));
    }

    #[test]
    fn a_body_that_is_turned_by_more_than_half_a_turn_is_told_its_whole_turn() {
        let mut world = crate::world::tests::world();
        let deformer = &mut world.bodies[0].deformer;
        let mut poses = deformer.poses.clone();
        for degrees in (0..=200).step_by(10) {
            let angle = f64::from(degrees).to_radians();
            poses[1].matrix =
                *nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), angle).matrix();
            deformer.evaluate(&poses);
        }
        let (turn, limits) = TurnLimits::of_deformer(deformer);
        assert!((turn.to_degrees() - 200.0).abs() < 1e-6, "{}°", turn.to_degrees());
        assert_eq!(limits.verdict(turn), Verdict::Beyond);
    }
}
