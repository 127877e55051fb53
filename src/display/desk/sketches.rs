//! The control elements that are being made: those in hand, and those of other bodies or of earlier, until they are precomputed.
//!
//! In: bodies to work on, one after the other. Out: their [`Editor`]s. Leaving one keeps what was made on it.

use super::editor::{Editor, Loading};
use crate::base::failure::Failure;
use crate::scene::Scene;
use crate::session::change::Step;

/// All sketches of a scene.
#[derive(Default)]
pub struct Sketches {
    /// The body on which somebody works.
    pub open: Option<Editor>,
    /// A mesh that is being read for the next one.
    pub loading: Option<Loading>,
    left: Vec<Editor>,
}

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

    /// Forgets the sketch in hand where the scene has its control elements; whether it did.
    pub fn was_made(&mut self, scene: &Scene) -> bool {
        let is_made = |editor: &mut Editor| {
            scene.body.get(&editor.body).is_some_and(|body| body.control == editor.sketch.controls())
        };
        self.open.take_if(is_made).is_some()
    }

    pub fn is_left(&self, body: &str) -> bool {
        self.left.iter().any(|editor| editor.body == body)
    }

    /// The bodies whose sketches no file holds.
    fn unsaved(&self) -> Vec<&str> {
        let all = self.open.iter().chain(&self.left);
        all.filter(|editor| editor.sketch.is_changed()).map(|editor| editor.body.as_str()).collect()
    }

    /// Warning about the work that would be lost by quitting.
    pub fn warning(&self) -> Option<String> {
        let unsaved = self.unsaved().join(", ");
        (!unsaved.is_empty()).then(|| {
            format!(
                "The control elements of {unsaved} are not saved. Press Escape again to quit without them."
            )
        })
    }
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
        assert!(sketches.is_left("bar") && sketches.unsaved() == ["bar"]);

        sketches.begin(&scene, "bar").unwrap();
        let sketch = &mut sketches.open.as_mut().unwrap().sketch;
        assert_eq!(sketch.elements, made, "it is there again, without reading the mesh");
        sketch.throw_away();
        assert!(!sketch.is_changed() && sketch.elements.len() == 2);
        sketch.undo();
        assert_eq!(sketch.elements, made);

        assert!(!sketches.was_made(&scene), "another change of the scene");
        scene.body["bar"].control.shift_remove("high");
        assert!(sketches.was_made(&scene) && sketches.unsaved().is_empty());
    }
}
