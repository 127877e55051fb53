//! What cannot be meant by the keys of a scene.
//!
//! In: a scene as it was read. Out: the first thing that is wrong, with its key and the remedy. What needs the mesh (empty
//! selections, unknown regions) is found where the mesh is loaded.

use super::{
    Accuracy, AccuracyTarget, Body, Budget, Place, Scene, SceneError, Storage, TOLERANCE, Tetrahedralise,
};
use super::{linear, look};
use crate::fem::Element;
use crate::mesh::{refine, surface_files};
use crate::solve::Solver;

/// A key below the body, as `.material` or `.control.left`, nothing for the body itself; and what is wrong with it.
type Wrong = (String, String);

fn wrong<T>(key: &str, message: impl Into<String>) -> Result<T, Wrong> {
    Err((key.to_owned(), message.into()))
}

impl Scene {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        if self.body.is_empty() {
            return Err(self.invalid("body", "the scene has no body; add a [body.NAME] table"));
        }
        for (name, body) in &self.body {
            if name.contains('/') {
                return Err(self.invalid(&format!("body.{name}"), "a body's name must not contain '/'"));
            }
            body.check().map_err(|(key, message)| self.invalid(&format!("body.{name}{key}"), message))?;
        }
        self.legend.map_or(Ok(()), |legend| legend.check()).map_err(|message| self.invalid("legend", message))
    }
}

impl Body {
    fn check(&self) -> Result<(), Wrong> {
        self.check_mesh()?;
        self.check_method().map_err(|(key, message)| (format!(".{key}"), message))?;
        let below =
            |key: String| move |(more, message): (&'static str, String)| (format!("{key}{more}"), message);
        self.material.check().map_err(below(".material".to_owned()))?;
        for (region, material) in &self.region {
            material.check().map_err(below(format!(".region.{region}")))?;
        }
        self.check_solver()?;
        look::check(self.lines, self.texture.as_ref(), self.crease)
            .map_err(|(key, message)| (format!(".{key}"), message))?;
        self.check_updates().map_err(|(key, message)| (format!(".updates{key}"), message))?;
        if let Some(parts) = self.parts {
            parts.check().map_err(|message| (".parts".to_owned(), message))?;
        }
        self.storage.check().map_err(|why| (".storage".to_owned(), why))?;
        self.check_target()?;
        self.check_loads().map_err(|(key, message)| (format!(".{key}"), message))?;
        self.check_controls()?;
        self.place.map_or(Ok(()), check_place)
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
            "tolerance {tolerance} must lie between {least:e} and {most:e}, max_iterations {max_iterations} be above 0; above \
             {most:e} forces and displacements would be wrong by more than is seen in the residual, and little time is saved: \
             leave it out for 1e-10"
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
        if let AccuracyTarget::Accuracy(Accuracy { displacement: Some(error), .. }) = target
            && error > 1.0
        {
            let message = format!(
                "displacement = {error} is {:.0} % of the whole: write {} for {error} %",
                100.0 * error,
                error / 100.0
            );
            return wrong(&key, message);
        }
        let is_free = self.element == <&Element>::default()
            && self.storage == Storage::default()
            && self.solver == Solver::default()
            && self.model == linear()
            && self.refine == 0;
        if is_free {
            return Ok(());
        }
        wrong(&key, "element, refine, storage, solver and model are chosen by it: leave them out")
    }

    fn check_controls(&self) -> Result<(), Wrong> {
        if self.control.is_empty() {
            let message =
                "no control element: nothing would hold the body; add a [body.NAME.control.NAME] table";
            return wrong("", message);
        }
        for (name, control) in &self.control {
            let key = format!(".control.{name}");
            if name.contains('/') {
                return wrong(&key, "a control element's name must not contain '/'");
            }
            control.nodes.check().map_err(|message| (key, message))?;
        }
        Ok(())
    }
}

fn check_place(place: Place) -> Result<(), Wrong> {
    let mut numbers = place.position.iter().chain(&place.rotation).flatten();
    if numbers.all(|v| v.abs() <= 1e3) && place.scale.is_none_or(|scale| (1e-15..=1e15).contains(&scale)) {
        return Ok(());
    }
    wrong(".place", "position (m) and rotation (rad) must be within ±1000, scale within 1e-15 to 1e15")
}
