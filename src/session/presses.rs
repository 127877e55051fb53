//! Warns of a script's press that grabs nothing, once for each stylus: when, and by how far the ray missed.

use crate::interact::PickRay;
use crate::track::TrackerState;
use crate::world::World;

/// Whether each stylus was pressed in the frame before, and whether it was warned of it.
#[derive(Debug, Default)]
pub struct ScriptPresses {
    pressed: Vec<bool>,
    told: Vec<bool>,
}

impl ScriptPresses {
    /// The warnings of a frame that a script has led.
    pub fn watch(&mut self, world: &World, state: &TrackerState) -> Vec<String> {
        let mut warnings = Vec::new();
        let count = state.styli.len().min(world.styli_count());
        self.pressed.resize(count, false);
        self.told.resize(count, false);
        for i in 0..count {
            let stylus = &state.styli[i];
            let was_pressed = std::mem::replace(&mut self.pressed[i], stylus.pressed);
            let begins = stylus.pressed && !was_pressed;
            let hands = &world.graph.get(world.fields.hands).hands;
            let takes = hands.grip(i).is_some()
                || world.touched(i).is_some()
                || world.effects.iter().any(|effect| effect.holds(i));
            if !begins || self.told[i] || takes || world.bodies.is_empty() {
                continue;
            }
            self.told[i] = true;
            let missed = PickRay::from_stylus(stylus).and_then(|ray| world.nearest_element(&ray));
            let how = match missed {
                Some((name, missed_m, reach_m)) => format!(
                    "its ray passes {missed_m:.3} m from the nearest control element that can be grabbed, {name}, and takes \
                     what it passes within {reach_m:.3} m"
                ),
                None => "no control element can be grabbed".to_owned(),
            };
            let (time_s, stylus) = (state.time_s, world.fields.stylus_name(i));
            warnings.push(format!(
                "the script's stylus {stylus} presses at {time_s:.2} s and grabs nothing: {how}"
            ));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use crate::effect;
    use crate::prepare::Resolved;
    use crate::render::Drawable;
    use crate::scene::{Generate, Grab, Scene};
    use crate::session::Session;
    use crate::session::open::script;
    use crate::stage::Stage;
    use crate::track::Script;
    use crate::world::World;
    use std::path::Path;

    fn warnings(aside: f64) -> Vec<String> {
        let world = crate::world::tests::world();
        let end = world.bodies[0].room_from_body
            * nalgebra::Point3::from(world.bodies[0].deformer.controls[1].origin);
        let [x, y, z] = [end.x, end.y + aside, end.z];
        let script = format!(
            "frame = \"room\"\n[[key]]\ntime = 0.0\nstylus.pen = {{ position = [{x}, {y}, {}], direction = [0, 0, -1] }}\n\
             [[key]]\ntime = 1.0\nstylus.pen = {{ pressed = true }}\n[[key]]\ntime = 2.0\nstylus.pen = {{ pressed = false }}\n\
             [[key]]\ntime = 3.0\nstylus.pen = {{ pressed = true }}\n[[key]]\ntime = 4.0\n",
            z + 0.5
        );
        let script = Script::parse(&script, Path::new("s.toml")).unwrap();
        let mut session = Session::new(world, Some(script));
        for k in 0..40 {
            session.advance(0.1 * f64::from(k)).unwrap();
        }
        let told = session.world.warnings.iter().map(|(_, text)| text.clone());
        told.filter(|text| text.contains("script")).collect()
    }

    /// The scene on coarse meshes, with the model that takes least to prepare: where its bodies stand is the same.
    fn coarse(name: &str) -> Scene {
        let mut scene = Scene::load(Path::new(name)).unwrap();
        for body in scene.body.values_mut() {
            body.model = "linear".into();
            body.effects.clear();
            match body.generate.as_mut().unwrap() {
                Generate::Tube(tube) => (tube.radial, tube.around, tube.along) = (1, 16, 20),
                Generate::Block(block) => {
                    block.cells = block.cells.map(|cells| (cells / 2).max(1));
                }
                Generate::Blobs(blobs) => blobs.cell = 0.012,
            }
        }
        scene
    }

    /// `view bear` and `render bear` grabbed nothing: on its stage the bear is smaller than its script took it for. Of the liver nothing can be
    /// grabbed.
    #[test]
    fn every_built_in_script_grabs_on_every_stage() {
        for (name, _) in crate::scene::built_in::BUILT_IN {
            let scene = coarse(name);
            let mut controls = scene.body.values().flat_map(|body| body.control.values());
            if !controls.any(|control| control.grab == Grab::Dragger) {
                continue;
            }
            let scene = Resolved::new(scene).unwrap();
            let file = effect::file_of(&scene).unwrap();
            for (stage_name, _) in crate::stage::BUILT_IN {
                let world =
                    World::new(&scene, &scene.models(), &file, Stage::find(stage_name).unwrap()).unwrap();
                let script = script(&scene, None).unwrap();
                let mut session = Session::new(world, script);
                let mut pressed = 0;
                for k in 0..90 {
                    session.advance(f64::from(k) / 60.0).unwrap();
                    pressed = pressed.max(
                        session.world.frame.all(Drawable::stylus).filter(|stylus| stylus.pressed).count(),
                    );
                }
                let told = session.world.warnings.iter().find(|(_, text)| text.contains("grabs nothing"));
                assert!(pressed > 0 && told.is_none(), "{name} on {stage_name}: {told:?}");
            }
        }
    }

    #[test]
    fn a_press_that_grabs_nothing_is_told_once_with_its_miss() {
        assert_eq!(warnings(0.0), Vec::<String>::new());
        let [told] = &warnings(0.3)[..] else { panic!("{:?}", warnings(0.3)) };
        assert!(told.contains(" presses at 1.00 s and grabs nothing: its ray passes 0."), "{told}");
    }
}
