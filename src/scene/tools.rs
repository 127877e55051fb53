//! The tools of a scene: what is wrong with them, and the surfaces in their files.

use super::{Scene, SceneError};
use crate::mesh::length_unit::{LengthUnit, Scale};
use crate::mesh::surface_check;
use crate::mesh::surface_files::{self, TriangleSurface};
use std::path::Path;

impl Scene {
    /// The first fault of each tool.
    pub(super) fn faults_of_tools(&self) -> impl Iterator<Item = SceneError> {
        let of = |(name, tool): (&String, &super::Tool)| {
            let (key, message) = tool.check().err()?;
            Some(self.invalid(&format!("tool.{name}.{key}"), message))
        };
        self.tool.iter().filter_map(of)
    }

    /// The closed surface of a tool's mesh file, m, its triangles turned outward. The error names the tool and the file.
    pub fn tool_surface(
        &self,
        name: &str,
        file: &Path,
        unit: Option<&'static LengthUnit>,
    ) -> Result<TriangleSurface, SceneError> {
        let wrong = |message: String| self.invalid(&format!("tool.{name}.shape"), message);
        let loaded = surface_files::load(&self.resolve(file)).map_err(|error| wrong(error.to_string()))?;
        let mut surface = loaded.surface;
        unit.map_or(Scale::ONE, |unit| Scale(unit.metres)).apply(&mut surface.vertices);
        let report = surface_check::check(&mut surface, &mut Vec::new());
        if !report.is_closed() {
            let faults = report.faults().join("; ");
            return Err(wrong(format!("{}: the surface is not closed: {faults}", file.display())));
        }
        Ok(surface)
    }
}
