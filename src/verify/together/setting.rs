//! The scenes of `verify together`: one body or two of one shape, with a model and effects, and what `check` says of them.
//!
//! In: a model, and the effects of each body. Out: the scene and what must be precomputed for it, or the sentence that refuses it.

use crate::base::diagnostic::Severity;
use crate::base::failure::Failure;
use crate::deform::ModelEntry;
use crate::effect::{EffectEntry, Resolved};
use crate::fem::{Element, TET4, TET10};
use crate::green::{self, Requirements};
use crate::stage::{Stage, StageError};
use nalgebra::Vector3;
use std::path::Path;

type V3 = Vector3<f64>;

/// A block about its place, held at both ends along x.
pub struct Shape {
    /// Sides, m, and the cells along them.
    pub size: [f64; 3],
    pub cells: [usize; 3],
    pub element: &'static Element,
    /// Young's modulus, Pa: under its weight it sags by less than a tenth of its length.
    pub young: f64,
}

/// Shapes of about a hundred nodes; a model has the first that suits it.
const SHAPES: [Shape; 3] = [
    Shape { size: [0.3, 0.1, 0.06], cells: [6, 3, 2], element: &TET4, young: 1e5 },
    Shape { size: [0.4, 0.03, 0.03], cells: [14, 2, 2], element: &TET4, young: 1e6 },
    Shape { size: [0.3, 0.006, 0.06], cells: [8, 1, 2], element: &TET10, young: 1e7 },
];

/// Radius of the ball that presses, m.
pub const BALL_M: f64 = 0.02;
/// Toughness of what is cut, J/m².
const TOUGHNESS: f64 = 100.0;
/// Length of the blade that cuts, m.
pub const BLADE_M: f64 = 0.2;
/// Distance of two bodies in a scene, m.
const APART_M: f64 = 0.34;

const NAMES: [&str; 2] = ["a", "b"];
const FILE: &str = "together.toml";

/// A scene by what is in it.
pub struct Setting {
    pub shape: &'static Shape,
    model: &'static ModelEntry,
    /// The effects of each body.
    pub bodies: Vec<Vec<&'static EffectEntry>>,
    pub has_gravity: bool,
}

/// A scene that is not refused.
pub struct Accepted {
    pub setting: Setting,
    pub scene: Resolved,
    /// Families and sections that must be precomputed for each body.
    pub required: Vec<Requirements>,
}

impl Setting {
    /// The stage of all scenes.
    pub fn stage() -> Result<Stage, StageError> {
        Stage::find("workbench")
    }

    /// The first shape that suits the model.
    pub fn shape_for(model: &'static ModelEntry) -> Result<&'static Shape, String> {
        let mut last = String::new();
        for shape in &SHAPES {
            match (Setting { shape, model, bodies: vec![Vec::new()], has_gravity: false }).accepted() {
                Ok(_) => return Ok(shape),
                Err(refusal) => last = refusal,
            }
        }
        Err(last)
    }

    /// The scene of bodies with these effects, under gravity unless that is refused.
    pub fn judged(
        shape: &'static Shape,
        model: &'static ModelEntry,
        bodies: &[Vec<&'static EffectEntry>],
    ) -> Result<Accepted, String> {
        let of = |has_gravity| Setting { shape, model, bodies: bodies.to_vec(), has_gravity }.accepted();
        of(true).or_else(|_| of(false))
    }

    /// A setting with the effects of each body in the opposite order.
    pub fn reversed(&self) -> Setting {
        let turned = |effects: &Vec<_>| effects.iter().rev().copied().collect();
        Setting { bodies: self.bodies.iter().map(turned).collect(), ..*self }
    }

    /// Index of the body that has an effect of this kind; the first if none has.
    pub fn body_with(&self, is_meant: fn(&EffectEntry) -> bool) -> usize {
        self.bodies.iter().position(|effects| effects.iter().any(|effect| is_meant(effect))).unwrap_or(0)
    }

    pub fn has(&self, is_meant: fn(&EffectEntry) -> bool) -> bool {
        self.bodies.iter().flatten().any(|effect| is_meant(effect))
    }

    /// The middle of a body in the room, m.
    pub fn place(&self, body: usize, stage: &Stage) -> V3 {
        let up = APART_M * (body as f64 - 0.5 * (self.bodies.len() as f64 - 1.0));
        stage.workspace.centre.coords + V3::y() * up
    }

    fn text(&self) -> Result<String, String> {
        let stage = Setting::stage().map_err(|error| error.to_string())?;
        let Shape { size, cells, element, young } = self.shape;
        let mut text = String::new();
        if self.has(|effect| effect.presses_points) {
            text += &format!("[tool.probe]\nshape = {{ ball = {{ radius = {BALL_M} }} }}\nstylus = 1\n");
        }
        if self.has(|effect| effect.is_cut) {
            text += &format!(
                "[tool.scalpel]\nshape = {{ blade = {{ length = {BLADE_M}, width = 0.02 }} }}\nstylus = 2\n"
            );
        }
        for (b, (name, effects)) in NAMES.iter().zip(&self.bodies).enumerate() {
            let is_cut = |effect: &&&EffectEntry| effect.is_cut;
            let toughness =
                |effect: &&EffectEntry| format!("effect.{} = {{ toughness = {TOUGHNESS:?} }}\n", effect.name);
            let toughness: String = effects.iter().filter(is_cut).map(toughness).collect();
            let effects: Vec<&str> = effects.iter().map(|effect| effect.name).collect();
            let place: [f64; 3] = self.place(b, &stage).into();
            text += &format!(
                "[body.{name}]\n\
                 generate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
                 material = {{ young = {young:?}, poisson = 0.3, density = 1000.0 }}\n\
                 element = \"{}\"\nmodel = \"{}\"\neffects = {effects:?}\n\
                 place = {{ position = {place:?}, rotation = [0.0, 0.0, 0.0], scale = 1.0 }}\n\
                 {}{toughness}control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
                 control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n",
                element.name,
                self.model,
                if self.has_gravity { "gravity = true\n" } else { "" },
            );
        }
        Ok(text)
    }

    /// The scene, or the error by which `check` refuses it.
    pub fn accepted(self) -> Result<Accepted, String> {
        let told = |text: String| text.strip_prefix(FILE).map_or(text.clone(), |rest| rest[2..].to_owned());
        let failed = |failure: Failure| told(failure.to_string());
        let scene = Resolved::parse(&self.text()?, Path::new(FILE)).map_err(failed)?;
        let mut required = Vec::new();
        for (name, body) in &scene.bodies {
            let needs = scene.requirements(name).map_err(failed)?;
            let prepared = green::prepare(&scene, name).map_err(|error| told(error.to_string()))?;
            green::suits(&scene, name, &prepared, &needs).map_err(|error| told(error.to_string()))?;
            if let Some(Err((Severity::Error, why))) = body.model.fits.map(|fits| fits(&prepared)) {
                return Err(format!("body.{name}.model: {why}"));
            }
            required.push(needs);
        }
        Ok(Accepted { setting: self, scene, required })
    }
}
