//! The editor of control elements: a body on which they are made, its surface at rest coloured by the elements' nodes and by
//! those that the brush would take, and the tools of the mouse.
//!
//! In: a body's mesh, a ray per movement of the mouse. Out: a [`Sketch`], and the surface on the device in place of the
//! scene's bodies. [`Sketches`] holds the body in hand and the elements that were made earlier or on other bodies, until
//! they are precomputed.

use crate::base::failure::{self, Failure};
use crate::edit::{Canvas, Sketch, Touch};
use crate::interact::PickRay;
use crate::render::{BodyBuffers, BodyInstance, Gpu, RenderError};
use crate::scene::{Grab, Scene};
use crate::session::change::Step;
use crate::world::World;
use nalgebra::{Point3, Similarity3, Translation3};
use std::collections::BTreeSet;
use std::thread::JoinHandle;

/// The part of a screen's width that the panel takes.
const PANEL_SHARE: f64 = 0.27;
/// sRGB and mark, as bodies have them.
const BODY: [u8; 4] = [96, 142, 186, 0];
const BRUSH: [u8; 4] = [236, 240, 245, 255];
const FIXED: [u8; 3] = [150, 152, 158];
/// Colours of elements that can be grabbed, one after the other.
const GRABBED: [[u8; 3]; 5] =
    [[224, 138, 52], [120, 180, 80], [196, 110, 190], [214, 190, 60], [90, 190, 180]];

/// A body on which control elements are made.
pub struct Editor {
    /// The body's name in the scene.
    pub body: String,
    pub canvas: Canvas,
    pub sketch: Sketch,
    touch: Option<Touch>,
    buffers: Option<BodyBuffers>,
    /// State for which the colours on the device were made.
    drawn: Option<(u64, Option<Touch>, usize)>,
}

/// A mesh that is being read for it.
pub struct Loading {
    pub body: String,
    thread: JoinHandle<Result<Canvas, Failure>>,
}

impl Loading {
    pub fn begin(scene: &Scene, body: &str) -> Result<Loading, Failure> {
        let (own, name) = (scene.clone(), body.to_owned());
        let load = move || Ok(Canvas::new(own.load_mesh(&name, &own.body[&name])?.mesh));
        let thread = std::thread::Builder::new().name("mesh".into()).spawn(load).map_err(Failure::work)?;
        Ok(Loading { body: body.to_owned(), thread })
    }

    pub fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    pub fn finish(self, scene: &Scene) -> Result<Editor, Failure> {
        let canvas = failure::join(self.thread, "reading the mesh")?;
        let body = scene
            .body
            .get(&self.body)
            .ok_or_else(|| Failure::wrong(format!("there is no body {}", self.body)))?;
        let sketch = Sketch::new(body, &canvas);
        Ok(Editor { body: self.body, sketch, canvas, touch: None, buffers: None, drawn: None })
    }
}

impl Editor {
    /// The mouse points elsewhere; true while it draws.
    pub fn point(&mut self, ray: Option<PickRay>, world: &World) -> bool {
        let place = self.room_from_mesh(world);
        self.touch = ray.and_then(|ray| self.canvas.touch(&ray, &place));
        if let Some(touch) = self.touch.filter(|_| self.sketch.is_drawing()) {
            self.sketch.drag(&mut self.canvas, touch);
        }
        self.sketch.is_drawing()
    }

    pub fn leave(&mut self) {
        self.touch = None;
    }

    /// The left button goes down or up.
    pub fn press(&mut self, pressed: bool) {
        match self.touch {
            Some(touch) if pressed => self.sketch.press(&mut self.canvas, touch),
            _ if !pressed => self.sketch.release(&self.canvas),
            _ => {}
        }
    }

    /// The transform by which it is shown: smaller than the scene's body and to the left of it, so that the panel covers nothing
    /// of it.
    fn room_from_mesh(&self, world: &World) -> Similarity3<f64> {
        let (stage, whole) = (&world.assets.stage, self.room_from_shown(world));
        let screen = &stage.screens[stage.faced_screen()];
        let centre = stage.workspace.centre;
        let beside = screen.axes()[0] * (-PANEL_SHARE * screen.width_m() / 2.0);
        let about_centre = Translation3::from(centre.coords + beside)
            * Similarity3::from_scaling(1.0 - PANEL_SHARE)
            * Translation3::from(-centre.coords);
        about_centre * whole
    }

    /// The transform of the scene's body, or else of the place where it would be put.
    fn room_from_shown(&self, world: &World) -> Similarity3<f64> {
        if let Some(body) = world.bodies.iter().find(|body| body.deformer.body == self.body) {
            return body.room_from_body * Translation3::from(-body.deformer.centre);
        }
        let [low, high] = self.canvas.bounds.map(Point3::from);
        let fitted =
            world.assets.stage.workspace.room_from_body(low, high).unwrap_or_else(Similarity3::identity);
        world.edit.navigation.room_from_scene * fitted
    }

    /// The surface as it is drawn now.
    pub fn instance(&mut self, gpu: &Gpu, world: &World) -> Result<BodyInstance<'_>, RenderError> {
        let room_from_body = self.room_from_mesh(world).to_homogeneous().cast();
        let now = (self.sketch.version, self.touch, self.sketch.chosen);
        if self.drawn != Some(now) || self.sketch.is_drawing() {
            let colours = self.colours();
            let buffers = match self.buffers.take() {
                Some(buffers) => buffers,
                None => self.make(gpu, &colours)?,
            };
            let buffers = self.buffers.insert(buffers);
            buffers.set_colors(gpu, &colours)?;
            self.drawn = Some(now);
        }
        let buffers = match &mut self.buffers {
            Some(buffers) => buffers,
            None => return Err(RenderError::EmptyBody { vertices: 0, triangles: 0 }),
        };
        Ok(BodyInstance { buffers, room_from_body })
    }

    fn make(&self, gpu: &Gpu, colours: &[[u8; 4]]) -> Result<BodyBuffers, RenderError> {
        let triangles = &self.canvas.shape.triangles;
        let mut buffers = BodyBuffers::new(gpu, triangles, colours)?;
        let mut normals = vec![[0.0; 3]; self.canvas.positions.len()];
        crate::deform::vertex_normals(&self.canvas.positions, triangles, &mut Vec::new(), &mut normals);
        buffers.upload(gpu, &self.canvas.positions, &normals)?;
        Ok(buffers)
    }

    fn colours(&mut self) -> Vec<[u8; 4]> {
        let mut colours = vec![BODY; self.canvas.positions.len()];
        for (number, element) in self.sketch.elements.iter().enumerate() {
            let [r, g, b] = colour(&self.sketch, number);
            let held: Vec<u32> = element.held.iter().copied().collect();
            for vertex in self.canvas.vertices(&held) {
                colours[vertex as usize] = [r, g, b, 255];
            }
        }
        for vertex in self.sketch.preview(&mut self.canvas, self.touch) {
            colours[vertex as usize] = BRUSH;
        }
        colours
    }
}

/// The colour in which an element of a sketch is shown: grey where it is fixed.
pub fn colour(sketch: &Sketch, number: usize) -> [u8; 3] {
    match sketch.elements.get(number).map(|element| element.grab) {
        Some(Grab::Dragger) => {
            let before =
                sketch.elements[..number].iter().filter(|element| element.grab == Grab::Dragger).count();
            GRABBED[before % GRABBED.len()]
        }
        _ => FIXED,
    }
}

/// All sketches of a scene.
#[derive(Default)]
pub struct Sketches {
    /// The body on which somebody works.
    pub open: Option<Editor>,
    /// A mesh that is being read for the next one.
    pub loading: Option<Loading>,
    left: Vec<Editor>,
    /// Bodies that are shown with control elements which no file holds.
    made: BTreeSet<String>,
}

/// The bodies with control elements that no file holds, each with its sketch's version.
pub type Unsaved = BTreeSet<(String, Option<u64>)>;

impl Sketches {
    /// Works on a body: on its sketch, where one was left.
    pub fn begin(&mut self, scene: &Scene, body: &str) -> Result<(), Failure> {
        self.leave();
        let left = self.left.iter().position(|editor| editor.body == body);
        self.open = left.map(|number| self.left.remove(number));
        if self.open.is_none() {
            self.loading = Some(Loading::begin(scene, body)?);
        }
        Ok(())
    }

    /// Takes a mesh that was read.
    pub fn load(&mut self, scene: &Scene) -> Result<(), Failure> {
        if let Some(loading) = self.loading.take_if(|loading| loading.is_done()) {
            self.open = Some(loading.finish(scene)?);
        }
        Ok(())
    }

    /// Stops working, and keeps what was made; returns a message if that is something.
    pub fn leave(&mut self) -> Option<String> {
        self.loading = None;
        let editor = self.open.take().filter(|editor| editor.sketch.is_changed())?;
        let told = format!("The control elements of {} are kept. Press K to go on with them.", editor.body);
        self.left.push(editor);
        Some(told)
    }

    /// The step that is under way: reading a surface.
    pub fn step(&self) -> Option<Step> {
        self.loading.as_ref().map(|_| Step { name: "the surface".into(), ..Step::default() })
    }

    /// Lets go of the sketch in hand where the scene has its control elements; whether it did.
    pub fn was_made(&mut self, scene: &Scene) -> bool {
        let is_made = |editor: &mut Editor| {
            scene.body.get(&editor.body).is_some_and(|body| body.control == editor.sketch.controls())
        };
        let made = self.open.take_if(is_made);
        let unsaved = made.iter().filter(|editor| editor.sketch.is_changed());
        self.made.extend(unsaved.map(|editor| editor.body.clone()));
        made.is_some()
    }

    /// The sketch in hand and all that was made stand in a file now.
    pub fn were_saved(&mut self) {
        self.open.iter_mut().for_each(|editor| editor.sketch.was_saved());
        self.made.clear();
    }

    pub fn is_left(&self, body: &str) -> bool {
        self.left.iter().any(|editor| editor.body == body)
    }

    pub fn unsaved(&self) -> Unsaved {
        let sketches = self.open.iter().chain(&self.left).filter(|editor| editor.sketch.is_changed());
        let sketches = sketches.map(|editor| (editor.body.clone(), Some(editor.sketch.version)));
        sketches.chain(self.made.iter().map(|body| (body.clone(), None))).collect()
    }
}

/// Warning about the work that would be lost by quitting.
pub fn warning(unsaved: &Unsaved) -> String {
    let mut bodies: Vec<&str> = unsaved.iter().map(|(body, _)| body.as_str()).collect();
    bodies.dedup();
    let bodies = bodies.join(", ");
    format!("The control elements of {bodies} are not saved. Press Escape again to quit without them.")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const SCENE: &str = "[body.bar]\ngenerate = { block = { size = [1.0, 0.2, 0.2], cells = [5, 1, 1] } }\n\
        material = \"rubber\"\n[body.bar.control]\nlow = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

    fn opened(sketches: &mut Sketches, scene: &Scene) {
        sketches.begin(scene, "bar").unwrap();
        while sketches.loading.is_some() {
            sketches.load(scene).unwrap();
            std::thread::yield_now();
        }
    }

    /// Key K, and the button that leaves, lost what was painted without a question.
    #[test]
    fn a_sketch_that_is_left_is_kept_until_it_is_thrown_away_or_made() {
        let mut scene = Scene::parse(SCENE, Path::new("bar.toml")).unwrap();
        let mut sketches = Sketches::default();
        opened(&mut sketches, &scene);
        assert!(sketches.unsaved().is_empty());
        assert_eq!(sketches.leave(), None, "nothing was made");
        opened(&mut sketches, &scene);
        sketches.open.as_mut().unwrap().sketch.delete(1);
        let made = sketches.open.as_ref().unwrap().sketch.elements.clone();
        assert!(sketches.leave().is_some());
        assert!(sketches.is_left("bar") && warning(&sketches.unsaved()).contains(" of bar are "));

        sketches.begin(&scene, "bar").unwrap();
        let sketch = &mut sketches.open.as_mut().unwrap().sketch;
        assert_eq!(sketch.elements, made, "it is there again, without reading the mesh");
        sketch.throw_away();
        assert!(!sketch.is_changed() && sketch.elements.len() == 2);
        assert!(sketches.unsaved().is_empty());
        let sketch = &mut sketches.open.as_mut().unwrap().sketch;
        sketch.undo();
        assert_eq!(sketch.elements, made);

        assert!(!sketches.was_made(&scene), "another change of the scene");
        scene.body["bar"].control.shift_remove("high");
        assert!(sketches.was_made(&scene) && sketches.open.is_none());
        assert_eq!(sketches.unsaved(), [("bar".to_owned(), None)].into(), "no file holds what is shown");
        opened(&mut sketches, &scene);
        assert!(sketches.was_made(&scene));
        assert_eq!(sketches.unsaved().len(), 1, "it was not saved meanwhile");
        sketches.were_saved();
        assert!(sketches.unsaved().is_empty());
    }
}
