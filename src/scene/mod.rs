//! Scenes: bodies with their materials, control elements, deformation model, effects, solver and place.
//!
//! In: a strict TOML file. Out: a checked [`Scene`]; meshes and node selections are loaded from it on demand.
//! Models and effects stay names here, because their entries live in rooms above this one: `deform` and `effect` check them.

mod accuracy_target;
mod body_loads;
mod boundary;
pub mod built_in;
mod check;
mod direction;
mod error;
pub mod file_kind;
mod limit;
mod load;
mod loads;
mod look;
mod material;
pub mod materials;
mod method;
mod parts;
pub mod proposal;
mod select;
pub mod survey;
#[cfg(test)]
mod tests;
mod tool;
mod tools;
mod unprepared;
mod updates;
mod updating;
pub mod write;

pub use crate::base::columns::Storage;
pub use accuracy_target::{Accuracy, AccuracyTarget, Budget};
pub use direction::{DirectionField, DirectionFile};
pub use error::SceneError;
pub use limit::{LegendSettings, Limit, Quantity};
pub use loads::{
    CENTRIFUGAL, Centrifugal, GRAVITY, Gravity, KeptForm, LARGEST_NUMBER, Load, LoadEntry, LoadKind,
    LoadSource, LoadValue, STANDARD_GRAVITY, SurfaceCompliance, SurfaceNodes, THERMAL, Take, Thermal,
};
pub use look::{CREASE, Color, Lines, Texture};
pub use material::Material;
pub use method::Method;
pub use parts::Parts;
pub use select::{Control, Grab, Nodes};
pub use tool::{Tool, ToolShape};
pub use updates::Updates;

use crate::config::{self, ConfigError};
use crate::fem::Element;
use crate::mesh::length_unit::{LengthUnit, Scale};
use crate::mesh::{blobs, generate};
use crate::solve::Solver;
use file_kind::is_mesh_or_surface;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of a built-in stage, or the path of a stage file.
    #[serde(default = "desktop")]
    pub stage: String,
    /// A script that moves head and stylus when nobody does: a built-in name, or a path relative to the scene file.
    pub script: Option<PathBuf>,
    /// Quantity in colours on bodies that list an effect with colours, and the value at the end of its scale.
    pub legend: Option<LegendSettings>,
    /// Rigid tools that touch bodies which list the effect for it.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub tool: IndexMap<String, Tool>,
    /// Bodies, in the order of the file.
    pub body: IndexMap<String, Body>,
    /// The scene's own path; relative paths start at its folder.
    #[serde(skip)]
    pub path: PathBuf,
}

/// Permitted tolerances of conjugate gradients, as relative residuals.
pub const TOLERANCE: std::ops::RangeInclusive<f64> = 1e-14..=1e-3;
fn desktop() -> String {
    "desktop".into()
}

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Mesh file, relative to the scene; or else `generate`.
    pub mesh: Option<PathBuf>,
    /// The unit of the mesh file's coordinates; metres where neither it nor `scale` is there.
    pub unit: Option<&'static LengthUnit>,
    /// Metres in one unit of the mesh file; or else `unit`.
    pub scale: Option<f64>,
    pub generate: Option<Generate>,
    /// Finite elements in tetrahedra, or boundary elements on the surface alone.
    #[serde(default)]
    pub method: Method,
    /// Triangles of boundary elements are cut until no edge is longer, m.
    pub longest_edge: Option<f64>,
    /// Settings by which a surface file is filled with tetrahedra.
    pub tetrahedralise: Option<Tetrahedralise>,
    /// Number of times that every tetrahedron is divided into eight, 0 to [`crate::mesh::refine::MOST`].
    #[serde(default)]
    pub refine: u32,
    #[serde(default)]
    pub element: &'static Element,
    pub material: Material,
    /// Materials of single regions, by the region's number or name; all others have `material`.
    #[serde(default)]
    pub region: BTreeMap<String, Material>,
    #[serde(default = "linear")]
    pub model: String,
    /// Changes that are possible while the body is shown, without computing it anew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub updates: Option<Updates>,
    /// Parts into which the model `substructured` cuts the body; `{ along = 8 }` where it is left out.
    pub parts: Option<Parts>,
    #[serde(default)]
    pub effects: Vec<String>,
    /// Settings of effects that it lists; each effect knows its own.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub effect: BTreeMap<String, toml::Table>,
    #[serde(default)]
    pub storage: Storage,
    #[serde(default)]
    pub solver: Solver,
    /// Errors that must not be exceeded; element, refinement, storage, solver and model are then chosen by measuring.
    pub accuracy: Option<Accuracy>,
    /// Costs that must not be exceeded; or else `accuracy`.
    pub budget: Option<Budget>,
    /// The measurements from which the settings were chosen; not a key of the file.
    #[serde(skip)]
    pub plan: Option<serde_json::Value>,
    /// Gravity on the body, where it hangs in the room.
    pub gravity: Option<Gravity>,
    pub centrifugal: Option<Centrifugal>,
    pub thermal: Option<Thermal>,
    /// Force patterns, in the order of the file.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub load: IndexMap<String, Load>,
    /// Nodes of the surface at which a stylus and pose files can apply forces.
    pub surface_compliance: Option<SurfaceCompliance>,
    /// Control elements, in the order of the file, which is the order of all results.
    pub control: IndexMap<String, Control>,
    /// The body's place in the room; without it, the body is fitted into the stage's workspace.
    pub place: Option<Place>,
    /// Colour of all but the control elements.
    #[serde(default)]
    pub color: Color,
    pub texture: Option<Texture>,
    /// Material lines.
    #[serde(default)]
    pub lines: Lines,
    /// Edges are drawn sharp whose sides are further apart than this at rest, degrees.
    #[serde(default = "crease")]
    pub crease: f64,
}

fn crease() -> f64 {
    CREASE
}

fn linear() -> String {
    "linear".into()
}

impl Body {
    /// Scale from the mesh file's coordinates to metres.
    pub fn mesh_scale(&self) -> Scale {
        self.unit.map_or(self.scale.map_or(Scale::ONE, Scale), |unit| Scale(unit.metres))
    }

    /// The body's own material, then those of its regions.
    pub fn materials(&self) -> impl Iterator<Item = &Material> {
        std::iter::once(&self.material).chain(self.region.values())
    }

    /// The target by which the settings are to be chosen, if there is one.
    pub fn accuracy_target(&self) -> Option<AccuracyTarget> {
        self.accuracy.map(AccuracyTarget::Accuracy).or(self.budget.map(AccuracyTarget::Budget))
    }

    /// Consequence where no control element is fixed, or none can be grabbed; `None` for a body that has both. Where tools touch bodies,
    /// hands need not grab them.
    pub fn held_by(&self, has_tools: bool) -> Option<String> {
        let count = |grab: Grab| self.control.values().filter(|control| control.grab == grab).count();
        Some(match (count(Grab::Fixed), count(Grab::Dragger)) {
            (0, 1) => "nothing is fixed: the body follows the hand as a whole. To hold it, add a control element with \
             grab = \"fixed\""
                .to_owned(),
            (0, many) => format!(
                "nothing is fixed: all {many} control elements stay where they are let go. To hold the body, \
                 give one grab = \"fixed\""
            ),
            (_, 0) if has_tools => return None,
            (_, 0) => "nothing can be grabbed: every control element is fixed; give one grab = \"dragger\"".to_owned(),
            _ => return None,
        })
    }
}

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Generate {
    Tube(generate::Tube),
    Block(generate::Block),
    Blobs(blobs::Blobs),
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { cell = 0.004 }")]
pub struct Tetrahedralise {
    /// Edge of a lattice cube, m; the tetrahedra's edges have about this length.
    pub cell: f64,
}

/// room_from_body: x ↦ position + scale · R(rotation) · x. What is left out is chosen as without a place
/// ([`Stage::room_from_mesh`](crate::stage::Stage::room_from_mesh)).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { position = [0.0, 1.0, 0.0] }")]
pub struct Place {
    /// The position of the mesh's origin in the room, m.
    pub position: Option<[f64; 3]>,
    /// Rotation vector (axis times angle), rad.
    pub rotation: Option<[f64; 3]>,
    pub scale: Option<f64>,
}

impl Scene {
    /// Reads and checks the scene file at `path`, or the built-in scene of this name.
    pub fn load(path: &Path) -> Result<Scene, SceneError> {
        let (text, path) = Scene::text(path)?;
        Scene::parse(&text, &path)
    }

    /// The text of a scene file, or of the built-in scene of this name, and where it stands.
    fn text(path: &Path) -> Result<(Cow<'static, str>, PathBuf), SceneError> {
        match built_in::named(path) {
            Some(Ok((text, path))) => return Ok((text.into(), path)),
            Some(Err(message)) => {
                let path = path.to_owned();
                return Err(SceneError::Unknown { path, message });
            }
            None => {}
        }
        if is_mesh_or_surface(path) {
            return Err(SceneError::IsMesh { path: path.to_owned() });
        }
        Ok((config::read(path)?.into(), path.to_owned()))
    }

    /// Parses a scene from text; `path` is where its relative paths start and what errors name.
    pub fn parse(text: &str, path: &Path) -> Result<Scene, SceneError> {
        let stage = "this is a stage; a scene has [body.NAME] tables. Show a scene on it with `greenstage view SCENE \
                     --stage` and its path";
        config::refuse_other(text, path, "body", ["screen", "viewer"], stage)?;
        let scene: Scene = config::parse(text, path).map_err(of_a_body)?;
        let scene = scene.begin(path)?;
        scene.chosen_and_written(text).into_iter().next().map_or(Ok(scene), Err)
    }

    fn begin(mut self, path: &Path) -> Result<Scene, SceneError> {
        path.clone_into(&mut self.path);
        self.check()?;
        self.body.values_mut().for_each(Body::begin_updates);
        Ok(self)
    }

    /// A path of the scene file, relative to its folder.
    pub fn resolve(&self, relative: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(relative)
    }

    /// Every path of tools and bodies, relative to the scene.
    pub fn paths_mut(&mut self) -> Vec<&mut PathBuf> {
        let tools = self.tool.values_mut().filter_map(|tool| match &mut tool.shape {
            ToolShape::Mesh { file, .. } => Some(file),
            _ => None,
        });
        tools.chain(self.body.values_mut().flat_map(Body::paths_mut)).collect()
    }

    /// The stage's name, or the path of its file from where the program runs.
    pub fn stage_from_here(&self) -> String {
        match self.stage.ends_with(".toml") {
            true => self.resolve(Path::new(&self.stage)).display().to_string(),
            false => self.stage.clone(),
        }
    }

    /// An error about one entity of this scene.
    pub fn invalid(&self, entity: &str, message: impl Into<String>) -> SceneError {
        SceneError::Invalid {
            path: self.path.clone(),
            line: config::line_in(&self.path, entity),
            entity: entity.to_owned(),
            message: message.into(),
        }
    }

    /// A scene that was changed in the program, as it would be read from its file.
    pub fn checked(&self) -> Result<Scene, SceneError> {
        self.check().map(|()| self.clone())
    }
}

/// Says of a key of bodies that stands above them where it belongs.
fn of_a_body(mut error: ConfigError) -> ConfigError {
    if let ConfigError::Parse { message, .. } = &mut error
        && let Some(key) = message.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next())
        && message.contains("`stage`")
        && config::keys::<Body>().iter().any(|known| known == key)
    {
        *message = format!("`{key}` is a key of a body: it belongs below [body.NAME]");
    }
    error
}
