//! Checks of a scene's keys for values that cannot be meant.
//!
//! In: a scene as it was read. Out: what is wrong, with its key and the remedy: of each section of a body the first fault. What
//! needs the mesh (empty selections, unknown regions) is found where the mesh is loaded.

use super::accuracy_target::no_more_than_all;
use super::{
    Accuracy, AccuracyTarget, Body, Budget, Control, Material, Place, Scene, SceneError, Storage, TOLERANCE,
    Tetrahedralise, Updates, linear, look,
};
use crate::fem::Element;
use crate::mesh::{refine, surface_files};
use crate::solve::Solver;

/// A key below the body, as `.material` or `.control.left`, nothing for the body itself; and what is wrong with it.
type Wrong = (String, String);

fn wrong<T>(key: &str, message: impl Into<String>) -> Result<T, Wrong> {
    Err((key.to_owned(), message.into()))
}

/// Keys of a body that its `accuracy` or `budget` chooses.
const CHOSEN: [&str; 5] = ["element", "refine", "storage", "solver", "model"];

impl Scene {
    /// Keys that the scene's text writes although the body's `accuracy` or `budget` chooses them: defaults, which look like
    /// omitted keys in the parsed scene.
    pub(super) fn chosen_and_written(&self, text: &str) -> Vec<SceneError> {
        let table = text.parse::<toml::Table>().unwrap_or_default();
        let body = |name: &String| table.get("body")?.get(name)?.as_table();
        let fault = |(name, known): (&String, &Body)| {
            let key = known.accuracy_target()?.key();
            let body = body(name)?;
            let written: Vec<&str> = CHOSEN.into_iter().filter(|key| body.contains_key(*key)).collect();
            let (are, them) = if written.len() > 1 { ("are", "them") } else { ("is", "it") };
            let message = format!("{} {are} chosen by it: leave {them} out", written.join(", "));
            (!written.is_empty()).then(|| self.invalid(&format!("body.{name}.{key}"), message))
        };
        self.body.iter().filter_map(fault).collect()
    }

    pub(super) fn check(&self) -> Result<(), SceneError> {
        self.faults().into_iter().next().map_or(Ok(()), Err)
    }

    /// All that is wrong with it, in the order of the file.
    pub(super) fn faults(&self) -> Vec<SceneError> {
        if self.body.is_empty() {
            return vec![self.invalid("body", "the scene has no body; add a [body.NAME] table")];
        }
        let mut found = Vec::new();
        for (name, body) in &self.body {
            if name.contains('/') {
                found.push(self.invalid(&format!("body.{name}"), "a body's name must not contain '/'"));
            }
            let of_body = |(key, message): Wrong| self.invalid(&format!("body.{name}{key}"), message);
            found.extend(body.faults().into_iter().map(of_body));
        }
        found.extend(self.faults_of_tools());
        let legend = self.legend.and_then(|legend| legend.check().err());
        found.extend(legend.map(|message| self.invalid("legend", message)));
        found
    }
}

impl Body {
    fn faults(&self) -> Vec<Wrong> {
        let dotted = |(key, message): (&'static str, String)| (format!(".{key}"), message);
        let of_material = |key: String, material: &Material| {
            let below = move |(more, message): (&'static str, String)| (format!("{key}{more}"), message);
            material.check().map_err(below)
        };
        let mut sections = vec![
            self.check_mesh(),
            self.check_method().map_err(dotted),
            of_material(".material".to_owned(), &self.material),
        ];
        let of_region =
            |(region, material): (&String, &Material)| of_material(format!(".region.{region}"), material);
        sections.extend(self.region.iter().map(of_region));
        sections.extend([
            self.check_solver(),
            look::check(self.lines, self.texture.as_ref(), self.crease).map_err(dotted),
            self.check_updates().map_err(|(key, message)| (format!(".updates{key}"), message)),
            self.parts
                .map_or(Ok(()), |parts| parts.check())
                .map_err(|message| (".parts".to_owned(), message)),
            self.storage.check().map_err(|why| (".storage".to_owned(), why)),
            self.check_target(),
            self.check_loads().map_err(|(key, message)| (format!(".{key}"), message)),
            self.check_any_control(),
        ]);
        sections.extend(self.control.iter().map(check_control));
        sections.push(self.place.map_or(Ok(()), check_place));
        sections.into_iter().filter_map(Result::err).collect()
    }

    fn check_mesh(&self) -> Result<(), Wrong> {
        if self.mesh.is_some() == self.generate.is_some() {
            return wrong("", "name either mesh = \"file\" or generate = { … }, one of the two");
        }
        if self.unit.is_some() && self.scale.is_some() {
            return wrong("", "name either unit or scale, one of the two");
        }
        if (self.unit.is_some() || self.scale.is_some()) && self.mesh.is_none() {
            let key = if self.unit.is_some() { ".unit" } else { ".scale" };
            return wrong(
                key,
                "only the coordinates of a mesh file are scaled; what is generated is in metres",
            );
        }
        if let Some(scale) = self.scale.filter(|scale| !(1e-12..=1e12).contains(scale)) {
            let message = format!(
                "{scale} must lie between 1e-12 and 1e12: metres in one unit of the mesh file, 0.001 for millimetres"
            );
            return wrong(".scale", message);
        }
        if let Some(Tetrahedralise { cell }) = self.tetrahedralise {
            if !self.mesh.as_deref().is_some_and(surface_files::is_surface_file) {
                let message = "only a surface file (.stl, .obj, .ply) can be filled; a mesh of tetrahedra or a generated \
                               one needs no tetrahedralise";
                return wrong(".tetrahedralise", message);
            }
            if !(cell > 0.0 && cell.is_finite()) {
                return wrong(".tetrahedralise", format!("cell is {cell} m: a positive length is needed"));
            }
        }
        if self.refine > refine::MOST {
            return wrong(".refine", refine::RefineError::TooOften { asked: self.refine }.to_string());
        }
        Ok(())
    }

    fn check_solver(&self) -> Result<(), Wrong> {
        let Solver { tolerance, max_iterations, .. } = &self.solver;
        if TOLERANCE.contains(tolerance) && *max_iterations > 0 {
            return Ok(());
        }
        let (least, most) = (TOLERANCE.start(), TOLERANCE.end());
        let message = format!(
            "tolerance {tolerance} must lie between {least:e} and {most:e}, max_iterations {max_iterations} \
             be above 0. Leave them out for 1e-10"
        );
        wrong(".solver", message)
    }

    fn check_target(&self) -> Result<(), Wrong> {
        if self.accuracy.is_some() && self.budget.is_some() {
            return wrong("", "name either accuracy or budget, one of the two");
        }
        let Some(target) = self.accuracy_target() else { return Ok(()) };
        let asked = match target {
            AccuracyTarget::Accuracy(Accuracy { displacement, force, .. }) => [displacement, force, None],
            AccuracyTarget::Budget(Budget { frame_ms, file_mb, offline_s, .. }) => {
                [frame_ms, file_mb, offline_s]
            }
        };
        let key = format!(".{}", target.key());
        let mut numbers = asked.into_iter().flatten().peekable();
        if numbers.peek().is_none()
            || !numbers.chain(target.largest()).all(|value| value > 0.0 && value.is_finite())
        {
            return wrong(&key, "one positive number or more is needed");
        }
        if let AccuracyTarget::Accuracy(Accuracy { displacement: Some(error), .. }) = target {
            no_more_than_all(error).map_err(|message| (key.clone(), message))?;
        }
        let is_free = self.element == <&Element>::default()
            && self.storage == Storage::default()
            && self.solver == Solver::default()
            && self.model == linear()
            && self.refine == 0;
        if is_free {
            return Ok(());
        }
        wrong(&key, format!("{} are chosen by it: leave them out", CHOSEN.join(", ")))
    }

    fn check_any_control(&self) -> Result<(), Wrong> {
        if !self.control.is_empty() {
            return Ok(());
        }
        let loose: Vec<&str> = self.updates.iter().flat_map(Updates::loose).collect();
        if loose.is_empty() {
            return wrong(
                "",
                "no control element: nothing would hold the body; add a [body.NAME.control.NAME] table",
            );
        }
        let message =
            format!("all control elements are released ({}): nothing would hold the body", loose.join(", "));
        wrong("", message)
    }
}

fn check_control((name, control): (&String, &Control)) -> Result<(), Wrong> {
    let key = format!(".control.{name}");
    if name.contains('/') {
        return wrong(&key, "a control element's name must not contain '/'");
    }
    control.nodes.check().map_err(|message| (key, message))
}

fn check_place(place: Place) -> Result<(), Wrong> {
    let mut numbers = place.position.iter().chain(&place.rotation).flatten();
    if numbers.all(|v| v.abs() <= 1e3) && place.scale.is_none_or(|scale| (1e-15..=1e15).contains(&scale)) {
        return Ok(());
    }
    wrong(".place", "position (m) and rotation (rad) must be within ±1000, scale within 1e-15 to 1e15")
}
