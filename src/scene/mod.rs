//! Scenes: bodies with their materials, control elements, deformation model, effects, solver and place.
//!
//! In: a strict TOML file. Out: a checked [`Scene`]; meshes and node selections are loaded from it on demand.
//! Models and effects stay names here, because their entries live in rooms above this one: `deform` and `effect` check them.

mod accuracy_target;
mod body_loads;
mod boundary;
pub mod built_in;
mod control;
pub mod file_kind;
mod limit;
mod load;
mod loads;
mod look;
pub mod materials;
mod method;
mod parts;
pub mod proposal;
mod select;
mod updates;
mod updating;
pub mod write;

pub use crate::base::columns::Storage;
pub use accuracy_target::{Accuracy, AccuracyTarget, Budget};
pub use control::{Control, Grab};
pub use limit::{LegendSettings, Limit, Quantity};
pub use loads::{
    CENTRIFUGAL, Centrifugal, GRAVITY, Gravity, Load, LoadEntry, LoadKind, LoadSource, LoadValue,
    SurfaceCompliance, SurfaceNodes, THERMAL, Take, Thermal,
};
pub use look::{CREASE, Color, Lines, Texture};
pub use method::Method;
pub use parts::Parts;
pub use select::Nodes;
pub use updates::Updates;

use crate::base::failure::Failure;
use crate::config::{self, ConfigError};
use crate::fem::{Element, Lame};
use crate::mesh::length_unit::{LengthUnit, Scale};
use crate::mesh::{MeshError, blobs, generate, refine, surface_files};
use crate::solve::Solver;
use file_kind::is_mesh_or_surface;
use indexmap::IndexMap;
use materials::{Known, Written, find_material};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error("{}: no such file, and {message}; give one of these, or the path of a .toml file", path.display())]
    Unknown { path: PathBuf, message: String },
    #[error("{}: {entity}: {message}", path.display())]
    Invalid { path: PathBuf, entity: String, message: String },
    #[error("{}: is a mesh or a surface, no scene; `greenstage new {}` makes a scene of it", path.display(), path.display())]
    IsMesh { path: PathBuf },
    #[error("{}: body.{body}.mesh: {source}", path.display())]
    Mesh { path: PathBuf, body: String, source: Box<MeshError> },
    #[error("{}: {entity}: {source}", path.display())]
    Generate { path: PathBuf, entity: String, source: generate::GenerateError },
}

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of a built-in stage, or the path of a stage file.
    #[serde(default = "desktop")]
    pub stage: String,
    /// A script that moves head and stylus when nobody does: a built-in name, or a path relative to the scene file.
    pub script: Option<PathBuf>,
    /// What colours bodies that list an effect with colours, and up to which value.
    pub legend: Option<LegendSettings>,
    /// In the order of the file.
    pub body: IndexMap<String, Body>,
    /// The scene's own path; relative paths start at its folder.
    #[serde(skip)]
    pub path: PathBuf,
}

/// Permitted tolerances of conjugate gradients, as relative residuals.
pub const TOLERANCE: std::ops::RangeInclusive<f64> = 1e-14..=1e-3;
/// Permitted Young's moduli, Pa: from far below any jelly to far above diamond.
const YOUNG: std::ops::RangeInclusive<f64> = 1e-12..=1e24;

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
    /// How a surface file is filled with tetrahedra.
    pub tetrahedralise: Option<Tetrahedralise>,
    /// How often every tetrahedron is divided into eight, 0 to [`refine::MOST`].
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
    /// What may be changed while the body is shown, without computing it anew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub updates: Option<Updates>,
    /// How the model `substructured` cuts the body; `{ along = 8 }` where it is left out.
    pub parts: Option<Parts>,
    #[serde(default)]
    pub effects: Vec<String>,
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
    /// Its weight, where it hangs in the room.
    pub gravity: Option<Gravity>,
    pub centrifugal: Option<Centrifugal>,
    pub thermal: Option<Thermal>,
    /// Force patterns, in the order of the file.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub load: IndexMap<String, Load>,
    /// Where a stylus and pose files can apply forces to single points.
    pub surface_compliance: Option<SurfaceCompliance>,
    /// In the order of the file, which is the order of all results.
    pub control: IndexMap<String, Control>,
    /// The body's place in the room; without it, the body is fitted into the stage's workspace.
    pub place: Option<Place>,
    /// Of what is no control element.
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

impl Material {
    pub fn lame(&self) -> Lame {
        Lame::from_young_poisson(self.young, self.poisson)
    }
}

impl Body {
    /// By what the mesh file's coordinates become metres.
    pub fn mesh_scale(&self) -> Scale {
        self.unit.map_or(self.scale.map_or(Scale::ONE, Scale), |unit| Scale(unit.metres))
    }

    /// That of the body, then those of its regions.
    pub fn materials(&self) -> impl Iterator<Item = &Material> {
        std::iter::once(&self.material).chain(self.region.values())
    }

    /// The target by which the settings are to be chosen, if there is one.
    pub fn accuracy_target(&self) -> Option<AccuracyTarget> {
        self.accuracy.map(AccuracyTarget::Accuracy).or(self.budget.map(AccuracyTarget::Budget))
    }

    /// What it means where no control element is fixed, or none can be grabbed; nothing of a body that has both.
    pub fn held_by(&self) -> Option<String> {
        let count = |grab: Grab| self.control.values().filter(|control| control.grab == grab).count();
        Some(match (count(Grab::Fixed), count(Grab::Dragger)) {
            (0, 1) => "its only control element can be grabbed and nothing is fixed: the body follows the hand as a \
                       whole, and is deformed by stretching that element alone; a second control element with grab = \
                       \"fixed\" would hold it"
                .to_owned(),
            (0, many) => format!(
                "nothing is fixed: all {many} control elements can be grabbed, and each stays where it is let go. To \
                 move the body as a whole, move the scene (middle button); to hold it somewhere, give an element \
                 grab = \"fixed\""
            ),
            (_, 0) => "nothing can be grabbed: every control element is fixed; give one grab = \"dragger\"".to_owned(),
            _ => return None,
        })
    }
}

/// Errors name the key below the body and what is wrong with it.
fn check_target(body: &Body) -> Result<(), (&'static str, &'static str)> {
    let target = body.accuracy_target();
    let (key, asked) = match target {
        None => return Ok(()),
        Some(_) if body.accuracy.is_some() && body.budget.is_some() => {
            return Err(("", "name either accuracy or budget, one of the two"));
        }
        Some(AccuracyTarget::Accuracy(Accuracy { displacement, force, .. })) => {
            (".accuracy", [displacement, force, None])
        }
        Some(AccuracyTarget::Budget(Budget { frame_ms, file_mb, offline_s, .. })) => {
            (".budget", [frame_ms, file_mb, offline_s])
        }
    };
    let largest = target.and_then(|target| target.largest());
    let mut numbers = asked.into_iter().flatten().peekable();
    if numbers.peek().is_none() || !numbers.chain(largest).all(|value| value > 0.0 && value.is_finite()) {
        return Err((key, "one positive number or more is needed"));
    }
    let is_free = body.element == <&Element>::default()
        && body.storage == Storage::default()
        && body.solver == Solver::default()
        && body.model == linear()
        && body.refine == 0;
    if is_free {
        Ok(())
    } else {
        Err((key, "element, refine, storage, solver and model are chosen by it: leave them out"))
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
#[serde(deny_unknown_fields)]
pub struct Tetrahedralise {
    /// Edge of a lattice cube, m; the tetrahedra's edges have about this length.
    pub cell: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "Written")]
pub struct Material {
    /// The entry of the library that it was written by. Its numbers may differ from the entry's.
    #[serde(skip)]
    pub known: Option<&'static Known>,
    /// Young's modulus, Pa.
    pub young: f64,
    pub poisson: f64,
    /// kg/m³, needed only by effects with inertia.
    pub density: Option<f64>,
    /// What it bears; where that is passed, pictures and closing words say so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<Limit>,
}

impl From<&'static Known> for Material {
    fn from(known: &'static Known) -> Material {
        let Known { young, poisson, density, yield_stress, .. } = *known;
        let limit = yield_stress.map(Limit::Stress);
        Material { known: Some(known), young, poisson, density: Some(density), limit }
    }
}

impl TryFrom<Written> for Material {
    type Error = String;

    fn try_from(written: Written) -> Result<Material, String> {
        let known = written.name.as_deref().map(find_material).transpose()?;
        let missing = |key: &str| {
            format!(
                "missing field `{key}`; write {{ young = 1.0e6, poisson = 0.3 }}, or a name of `greenstage manual materials`"
            )
        };
        Ok(Material {
            known,
            young: written.young.or(known.map(|known| known.young)).ok_or_else(|| missing("young"))?,
            poisson: written
                .poisson
                .or(known.map(|known| known.poisson))
                .ok_or_else(|| missing("poisson"))?,
            density: written.density.or(known.map(|known| known.density)),
            limit: written.limit.or(known.and_then(|known| known.yield_stress).map(Limit::Stress)),
        })
    }
}

/// room_from_body: x ↦ position + scale · R(rotation) · x. What is left out is chosen as without a place
/// ([`Stage::room_from_mesh`](crate::stage::Stage::room_from_mesh)).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
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
        match built_in::named(path) {
            Some(Ok((text, path))) => return Scene::parse(text, &path),
            Some(Err(message)) => {
                let path = path.to_owned();
                return Err(SceneError::Unknown { path, message });
            }
            None => {}
        }
        if is_mesh_or_surface(path) {
            return Err(SceneError::IsMesh { path: path.to_owned() });
        }
        let scene: Scene = config::load(path)?;
        scene.begin(path)
    }

    /// Parses a scene from text; `path` is where its relative paths start and what errors name.
    pub fn parse(text: &str, path: &Path) -> Result<Scene, SceneError> {
        let scene: Scene = config::parse(text, path)?;
        scene.begin(path)
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

    /// An error about one entity of this scene.
    pub fn invalid(&self, entity: &str, message: impl Into<String>) -> SceneError {
        SceneError::Invalid { path: self.path.clone(), entity: entity.to_owned(), message: message.into() }
    }

    /// A scene that was changed in the program, as it would be read from its file.
    pub fn checked(&self) -> Result<Scene, SceneError> {
        self.check().map(|()| self.clone())
    }

    fn check(&self) -> Result<(), SceneError> {
        if self.body.is_empty() {
            return Err(self.invalid("body", "the scene has no body; add a [body.NAME] table"));
        }
        for (name, body) in &self.body {
            self.check_body(name, body)?;
        }
        self.legend.map_or(Ok(()), |legend| legend.check()).map_err(|message| self.invalid("legend", message))
    }

    fn check_body(&self, name: &str, body: &Body) -> Result<(), SceneError> {
        let entity = format!("body.{name}");
        if name.contains('/') {
            return Err(self.invalid(&entity, "a body's name must not contain '/'"));
        }
        if body.mesh.is_some() == body.generate.is_some() {
            return Err(
                self.invalid(&entity, "name either mesh = \"file\" or generate = { … }, one of the two")
            );
        }
        self.check_scale(&entity, body)?;
        self.check_tetrahedralise(&entity, body)?;
        body.check_method().map_err(|(key, message)| self.invalid(&format!("{entity}.{key}"), message))?;
        if body.refine > refine::MOST {
            let asked = refine::RefineError::TooOften { asked: body.refine };
            return Err(self.invalid(&format!("{entity}.refine"), asked.to_string()));
        }
        self.check_material(&format!("{entity}.material"), &body.material)?;
        for (region, material) in &body.region {
            self.check_material(&format!("{entity}.region.{region}"), material)?;
        }
        let solver = &body.solver;
        if !TOLERANCE.contains(&solver.tolerance) || solver.max_iterations == 0 {
            let message = format!(
                "tolerance {} must lie between {:e} and {:e}, max_iterations {} be above 0; above {:e} forces and \
                 displacements would be wrong by more than is seen in the residual, and little time is saved: leave it out \
                 for 1e-10",
                solver.tolerance,
                TOLERANCE.start(),
                TOLERANCE.end(),
                solver.max_iterations,
                TOLERANCE.end()
            );
            return Err(self.invalid(&format!("{entity}.solver"), message));
        }
        look::check(body.lines, body.texture.as_ref(), body.crease)
            .map_err(|(key, message)| self.invalid(&format!("{entity}.{key}"), message))?;
        self.check_updates(&entity, body)?;
        if let Some(parts) = body.parts {
            parts.check().map_err(|message| self.invalid(&format!("{entity}.parts"), message))?;
        }
        check_target(body).map_err(|(key, message)| self.invalid(&format!("{entity}{key}"), message))?;
        body.check_loads().map_err(|(key, message)| self.invalid(&format!("{entity}.{key}"), message))?;
        if body.control.is_empty() {
            return Err(self.invalid(
                &entity,
                "no control element: nothing would hold the body; add a [body.NAME.control.NAME] table",
            ));
        }
        for (control_name, control) in &body.control {
            let entity = format!("{entity}.control.{control_name}");
            if control_name.contains('/') {
                return Err(self.invalid(&entity, "a control element's name must not contain '/'"));
            }
            control.nodes.check().map_err(|message| self.invalid(&entity, message))?;
        }
        if let Some(place) = &body.place {
            let mut numbers = place.position.iter().chain(&place.rotation).flatten();
            if !numbers.all(|v| v.abs() <= 1e3) || !place.scale.is_none_or(|s| (1e-15..=1e15).contains(&s)) {
                return Err(self.invalid(
                    &format!("{entity}.place"),
                    "position (m) and rotation (rad) must be within ±1000, scale within 1e-15 to 1e15",
                ));
            }
        }
        Ok(())
    }

    fn check_scale(&self, entity: &str, body: &Body) -> Result<(), SceneError> {
        if body.unit.is_some() && body.scale.is_some() {
            return Err(self.invalid(entity, "name either unit or scale, one of the two"));
        }
        let key = if body.unit.is_some() { "unit" } else { "scale" };
        if (body.unit.is_some() || body.scale.is_some()) && body.mesh.is_none() {
            let message = "only the coordinates of a mesh file are scaled; what is generated is in metres";
            return Err(self.invalid(&format!("{entity}.{key}"), message));
        }
        match body.scale {
            Some(scale) if !(1e-12..=1e12).contains(&scale) => {
                let message = format!(
                    "{scale} must lie between 1e-12 and 1e12: metres in one unit of the mesh file, 0.001 for millimetres"
                );
                Err(self.invalid(&format!("{entity}.scale"), message))
            }
            _ => Ok(()),
        }
    }

    fn check_tetrahedralise(&self, entity: &str, body: &Body) -> Result<(), SceneError> {
        let Some(Tetrahedralise { cell }) = body.tetrahedralise else {
            return Ok(());
        };
        let entity = format!("{entity}.tetrahedralise");
        if !body.mesh.as_deref().is_some_and(surface_files::is_surface_file) {
            let message = "only a surface file (.stl, .obj, .ply) can be filled; a mesh of tetrahedra or a generated \
                           one needs no tetrahedralise";
            return Err(self.invalid(&entity, message));
        }
        if !(cell > 0.0 && cell.is_finite()) {
            return Err(self.invalid(&entity, format!("cell is {cell} m: a positive length is needed")));
        }
        Ok(())
    }

    fn check_material(&self, entity: &str, material: &Material) -> Result<(), SceneError> {
        let Material { young, poisson, density, limit, .. } = *material;
        if !YOUNG.contains(&young) {
            return Err(
                self.invalid(entity, format!("Young's modulus {young} Pa must lie between 1e-12 and 1e24"))
            );
        }
        if poisson == 0.5 {
            return Err(self.invalid(
                entity,
                "Poisson's ratio 0.5 is exactly incompressible: λ is infinite and the displacement method cannot \
                 solve it; write 0.49 for rubber-like materials",
            ));
        }
        if !(poisson > -1.0 && poisson < 0.5) {
            return Err(self.invalid(
                entity,
                format!("Poisson's ratio {poisson} is not physical; it must lie between -1 and 0.5"),
            ));
        }
        if density.is_some_and(|density| !(density > 0.0 && density.is_finite())) {
            return Err(self.invalid(entity, "density must be positive and finite, kg/m³"));
        }
        if let Some(limit) = limit {
            limit.check().map_err(|message| self.invalid(&format!("{entity}.limit"), message))?;
        }
        Ok(())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        Failure::request(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::TET4;

    const BLOCK: &str = r#"
[body.block]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3 }
[body.block.control.low]
nodes = { group = "xmin" }
grab = "fixed"
"#;

    fn error(from: &str, to: &str) -> String {
        let text = BLOCK.replace(from, to);
        assert_ne!(text, BLOCK, "{from} must stand in the scene");
        Scene::parse(&text, Path::new("scene.toml")).unwrap_err().to_string()
    }

    #[test]
    fn defaults_are_the_papers() {
        let scene = Scene::parse(BLOCK, Path::new("scene.toml")).unwrap();
        let body = &scene.body["block"];
        assert_eq!((scene.stage.as_str(), body.model.as_str()), ("desktop", "linear"));
        assert_eq!((body.element, body.solver.method), (&TET4, Default::default()));
        assert!(body.effects.is_empty() && body.place.is_none());
    }

    #[test]
    fn a_material_is_named_changed_or_given() {
        let material = |text: &str| {
            let text = BLOCK.replace("{ young = 1.0e6, poisson = 0.3 }", text);
            Scene::parse(&text, Path::new("scene.toml")).unwrap().body["block"].material
        };
        let steel = material("\"steel\"");
        assert_eq!((steel.young, steel.poisson, steel.density), (210e9, 0.3, Some(7850.0)));
        let soft = material("{ name = \"steel\", young = 1.0e9 }");
        assert_eq!(soft, Material { young: 1e9, ..steel });
        let given = material("{ young = 210e9, poisson = 0.3, density = 7850 }");
        assert_eq!(given, Material { known: None, limit: None, ..steel });
        assert_eq!(steel.limit, Some(Limit::Stress(235e6)));
        let limited = material("{ name = \"steel\", limit = { stress = 1e9 } }");
        assert_eq!(limited.limit, Some(Limit::Stress(1e9)));
    }

    /// A file in millimetres gives the numbers of one in metres.
    #[test]
    fn a_meshs_unit_is_one_of_two_keys() {
        let text = BLOCK.replace(
            "generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }",
            "mesh = \"a.msh\"\nunit = \"mm\"",
        );
        let told = |text: &str| Scene::parse(text, Path::new("scene.toml"));
        assert_eq!(told(&text).unwrap().body["block"].mesh_scale(), Scale(0.001));
        let scaled = told(&text.replace("unit = \"mm\"", "scale = 0.0254")).unwrap();
        assert_eq!(scaled.body["block"].mesh_scale(), Scale(0.0254));
        for (line, expected) in [
            ("unit = \"mm\"\nscale = 0.001", "name either unit or scale"),
            ("unit = \"millimetres\"", "unknown unit of length"),
            ("scale = 0.0", "body.block.scale: 0 must lie between"),
        ] {
            let error = told(&text.replace("unit = \"mm\"", line)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn mistakes_name_the_entity_and_the_remedy() {
        for (from, to, expected) in [
            ("young = 1.0e6", "young = -1.0", "body.block.material: Young's modulus -1 Pa"),
            (
                "poisson = 0.3",
                "poisson = 0.5",
                "body.block.material: Poisson's ratio 0.5 is exactly incompressible",
            ),
            (
                "poisson = 0.3 }",
                "poisson = 0.3 }\nlines = 0.0",
                "body.block.lines: a spacing of 0 m: write a positive",
            ),
            ("poisson = 0.3 }", "poisson = 0.3 }\nlines = \"thin\"", "expected true, false, or the spacing"),
            (
                "poisson = 0.3 }",
                "poisson = 0.3 }\ncrease = 200.0",
                "body.block.crease: 200 is no angle from 0",
            ),
            ("poisson = 0.3 }", "poisson = 0.3 }\ncolor = \"red\"", "write \"#c05030\" (red, green, blue)"),
            ("poisson = 0.3 }", "poisson = 0.3 }\ncolor = [0, 1]", "red, green and blue from 0 to 255"),
            ("poisson = 0.3 }", "poisson = 0.3 }\ntexture = { size = 1.0 }", "missing field `image`"),
            (
                "poisson = 0.3 }",
                "poisson = 0.3 }\ntexture = { image = \"a.png\", size = -1.0 }",
                "body.block.texture: size is -1 m: a positive length",
            ),
            ("poisson = 0.3", "poisson = 0.7", "must lie between -1 and 0.5"),
            ("poisson = 0.3", "poisson = nan", "must lie between -1 and 0.5"),
            ("{ young = 1.0e6, poisson = 0.3 }", "\"stel\"", "scene.toml:4:12: unknown material \"stel\""),
            ("{ young = 1.0e6, poisson = 0.3 }", "\"stel\"", "did you mean \"steel\"?"),
            ("young = 1.0e6, ", "", "scene.toml:4:12: missing field `young`; write"),
            ("young = 1.0e6, ", "name = \"wood\", ", "unknown material \"wood\""),
            ("{ young = 1.0e6, poisson = 0.3 }", "3.0", "expected a table, or a name of"),
            ("material", "unit = \"mm\"\nmaterial", "body.block.unit: only the coordinates of a mesh file"),
            ("poisson = 0.3", "poison = 0.3", "scene.toml:4:"),
            ("poisson = 0.3", "poison = 0.3", "did you mean `poisson`?"),
            ("generate = {", "generat = {", "did you mean `generate`?"),
            ("group = \"xmin\"", "gruop = \"xmin\"", "did you mean `group`?"),
            ("grab = \"fixed\"", "grab = \"fixt\"", "did you mean `fixed`?"),
            ("generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }", "", "one of the two"),
            (
                "material",
                "tetrahedralise = { cell = 0.1 }\nmaterial",
                "only a surface file (.stl, .obj, .ply)",
            ),
            (
                "generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }",
                "mesh = \"a.stl\"\ntetrahedralise = { cell = -0.1 }",
                "body.block.tetrahedralise: cell is -0.1 m",
            ),
            (
                "material",
                "solver = { method = \"pcg\", tolerance = 0.5 }\nmaterial",
                "body.block.solver: tolerance 0.5 must lie between 1e-14 and 1e-3",
            ),
            ("material", "refine = 5\nmaterial", "body.block.refine: 5 refinements"),
            ("material", "refine = -1\nmaterial", "scene.toml:4:"),
        ] {
            let text = error(from, to);
            assert!(text.contains(expected), "{text}\nlacks {expected}");
        }
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_it_panic(text in ".*", at in 0..BLOCK.len(), cut in proptest::bool::ANY) {
            let rest = if cut { "" } else { &BLOCK[at..] };
            for text in [text.clone(), format!("{}{text}{rest}", &BLOCK[..at])] {
                if let Err(error) = Scene::parse(&text, Path::new("scene.toml")) {
                    proptest::prop_assert!(error.to_string().starts_with("scene.toml"), "{error}");
                }
            }
        }
    }
}
