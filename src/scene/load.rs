//! The mesh of a scene's body: read, filled or generated, and refined; and the image on it.

use super::{Body, Generate, Method, Scene, SceneError, Tetrahedralise};
use crate::base::input;
use crate::config;
use crate::mesh::quadratic::{Curve, straight};
use crate::mesh::{
    self, LoadedMesh, TetMesh, blobs, generate, isosurface_stuffing, refine, surface_body, surface_files,
};
use image::{ImageReader, RgbaImage};
use std::path::Path;

impl Scene {
    /// The mesh of body `name` with the nodes its element needs, and the notices of what was repaired and done.
    pub fn load_mesh(&self, name: &str, body: &Body) -> Result<LoadedMesh, SceneError> {
        let mut loaded = match (&body.mesh, &body.generate) {
            (Some(file), None) if body.is_surface() => self.load_surface(name, body, file)?,
            (Some(file), None) => self.load_file(name, body, file)?,
            (None, Some(generate)) => self.generate(name, generate)?,
            _ => {
                let message = "name either mesh = \"file\" or generate = { … }, one of the two";
                return Err(self.invalid(&format!("body.{name}"), message));
            }
        };
        for (key, nodes) in body.selections() {
            nodes
                .prepare(&mut loaded.mesh, |path| self.resolve(path))
                .map_err(|message| self.invalid(&format!("body.{name}.{key}"), message))?;
        }
        let on_tube;
        let curve: Curve<'_> = match &body.generate {
            Some(Generate::Tube(tube)) => {
                on_tube = |a: &_, b: &_| tube.curve(a, b);
                &on_tube
            }
            _ => &straight,
        };
        if body.refine > 0 && !body.is_surface() {
            let before = loaded.mesh.tets.len();
            loaded.mesh = refine::refine(loaded.mesh, body.refine, curve)
                .map_err(|error| self.invalid(&format!("body.{name}.refine"), error.to_string()))?;
            let TetMesh { tets, nodes, .. } = &loaded.mesh;
            loaded.notices.push(format!(
                "refined {} times: {before} tetrahedra became {}, with {} nodes",
                body.refine,
                tets.len(),
                nodes.len()
            ));
        }
        if body.element.order == 2 && loaded.mesh.mids.is_empty() {
            let before = loaded.mesh.nodes.len();
            refine::check_tags(&loaded.mesh, loaded.mesh.tets.len() as u64)
                .map_err(|error| self.invalid(&format!("body.{name}.element"), error.to_string()))?;
            loaded.mesh = mesh::quadratic(loaded.mesh, curve);
            let added = loaded.mesh.nodes.len() - before;
            loaded
                .notices
                .push(format!("{added} nodes were added between the corners, for {}", body.element.name));
        }
        if body.method == Method::Bem {
            self.cut_surface(name, body, &mut loaded)?;
        }
        Ok(loaded)
    }

    fn load_surface(&self, name: &str, body: &Body, file: &Path) -> Result<LoadedMesh, SceneError> {
        surface_body::load(&self.resolve(file), body.mesh_scale()).map_err(|source| SceneError::Mesh {
            path: self.path.clone(),
            line: config::line_in(&self.path, &format!("body.{name}.mesh")),
            body: name.to_owned(),
            source: Box::new(source),
        })
    }

    /// Makes of the mesh its surface alone, with triangles as fine as the body asks for.
    fn cut_surface(&self, name: &str, body: &Body, loaded: &mut LoadedMesh) -> Result<(), SceneError> {
        let wrong = |key: &str| {
            let entity = format!("body.{name}.{key}");
            move |message: String| self.invalid(&entity, message)
        };
        let mesh = &mut loaded.mesh;
        if !body.is_surface() {
            *mesh = surface_body::of_tetrahedra(mesh);
        }
        let before = mesh.triangles.len();
        if body.is_surface() {
            surface_body::refine(mesh, body.refine).map_err(wrong("refine"))?;
        }
        if let Some(edge) = body.longest_edge {
            surface_body::shorten(mesh, edge).map_err(wrong("longest_edge"))?;
        }
        let after = mesh.triangles.len();
        if after > before {
            loaded
                .notices
                .push(format!("{before} triangles were cut into {after}, with {} nodes", mesh.nodes.len()));
        }
        Ok(())
    }

    fn load_file(&self, name: &str, body: &Body, file: &Path) -> Result<LoadedMesh, SceneError> {
        let file = self.resolve(file);
        let failed = |source| SceneError::Mesh {
            path: self.path.clone(),
            line: config::line_in(&self.path, &format!("body.{name}.mesh")),
            body: name.to_owned(),
            source: Box::new(source),
        };
        let scale = body.mesh_scale();
        match body.tetrahedralise {
            Some(Tetrahedralise { cell }) => isosurface_stuffing::load(&file, scale, cell).map_err(failed),
            None if surface_files::is_surface_file(&file) => {
                let mut surface = surface_files::load(&file).map_err(failed)?.surface;
                scale.apply(&mut surface.vertices);
                let cell = isosurface_stuffing::suggested_cell(&surface);
                let mut loaded = isosurface_stuffing::load(&file, scale, cell).map_err(failed)?;
                let notice = format!(
                    "the surface is filled with cells of {cell} m, a thirtieth of its longest side; tetrahedralise = {{ cell = … }} \
                     sets others"
                );
                loaded.notices.insert(0, notice);
                Ok(loaded)
            }
            None if body.element.order == 2 => {
                mesh::load_quadratic(&file).map(|mesh| scale.applied(mesh)).map_err(failed)
            }
            None => mesh::load(&file).map(|mesh| scale.applied(mesh)).map_err(failed),
        }
    }

    fn generate(&self, name: &str, generate: &Generate) -> Result<LoadedMesh, SceneError> {
        let alone = |mesh: TetMesh| LoadedMesh { mesh, notices: Vec::new() };
        let loaded = match generate {
            Generate::Tube(tube) => generate::tube(tube).map(alone),
            Generate::Block(block) => generate::block(block).map(alone),
            Generate::Blobs(blobs) => blobs::blobs(blobs),
        };
        let failed = |source| SceneError::Generate {
            path: self.path.clone(),
            line: config::line_in(&self.path, &format!("body.{name}.generate")),
            entity: format!("body.{name}.generate"),
            source,
        };
        loaded.map_err(failed)
    }

    /// The image on body `name`, if it has one.
    pub fn load_texture(&self, name: &str, body: &Body) -> Result<Option<RgbaImage>, SceneError> {
        let Some(texture) = &body.texture else { return Ok(None) };
        let path = self.resolve(&texture.image);
        let wrong = |reason: String| {
            let message = format!("{}: {reason}; a PNG file is needed", path.display());
            self.invalid(&format!("body.{name}.texture"), message)
        };
        let bytes = input::read(&path).map_err(|error| wrong(error.to_string()))?;
        let reader = ImageReader::with_format(std::io::Cursor::new(bytes), image::ImageFormat::Png);
        Ok(Some(reader.decode().map_err(|error| wrong(error.to_string()))?.into_rgba8()))
    }
}
