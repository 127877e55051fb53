//! A block in a world with a blade in the hand, for tests.

use super::frames::LEAST_FRAMES;
use crate::deform::ControlPose;
use crate::effect::{self, EFFECTS, Resolved, file_of};
use crate::green::GreenFile;
use crate::interact::Action;
use crate::render::Drawable;
use crate::scene::Color;
use crate::stage::Stage;
use crate::track::{StylusState, TrackerState};
use crate::world::{Highlight, Input, World};
use nalgebra::{Isometry3, Translation3, Vector3};
use std::path::Path;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// A block about the origin with a blade in the hand, whose edge lies along z.
pub struct Operated {
    pub world: World,
    pub frame: usize,
}

pub fn scene(controls: &str, keys: &str) -> Result<Resolved, String> {
    parsed(&text(controls, keys, ""))
}

pub fn text(controls: &str, keys: &str, tools: &str) -> String {
    format!(
        "{tools}[tool.scalpel]\nshape = {{ blade = {{ length = 0.2, width = 0.02 }} }}\nstylus = 1\n\
         [body.b]\n\
         generate = {{ block = {{ size = [0.3, 0.1, 0.06], cells = [9, 4, 3] }} }}\n\
         material = {{ young = 1.0e5, poisson = 0.3, density = 1000.0 }}\n\
         {}place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n{keys}\n{controls}",
        if keys.starts_with("effects") { "" } else { "effects = [\"cut\"]\n" }
    )
}

pub fn parsed(text: &str) -> Result<Resolved, String> {
    let scene = Resolved::parse(text, Path::new("cut.toml"));
    scene.and_then(|scene| scene.requirements("b").map(|_| scene)).map_err(|error| error.to_string())
}

pub const BOTH: &str = "control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
pub const ONE: &str = "control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";

/// A stylus whose tip is at this place; it points along -z.
pub fn stylus(tip: &V3) -> StylusState {
    StylusState {
        room_from_stylus: Isometry3::from(Translation3::from(*tip)).cast(),
        ..StylusState::default()
    }
}

impl Operated {
    pub fn new(scene: &Resolved, file: &Arc<GreenFile>) -> Operated {
        let world = effect::world(EFFECTS, scene, file, Stage::find("desktop").unwrap()).unwrap();
        Operated { world, frame: 0 }
    }

    pub fn of(controls: &str, keys: &str) -> Operated {
        let scene = scene(controls, keys).unwrap();
        Operated::new(&scene, &file_of(&scene).unwrap())
    }

    /// Moves the tip to this place.
    pub fn put(&mut self, tip: V3) {
        self.step(&[tip]);
    }

    /// Moves the tips of both styli.
    pub fn put_both(&mut self, blade: V3, probe: V3) {
        self.step(&[blade, probe]);
    }

    /// A command, with the tip at this place.
    pub fn act(&mut self, action: Action, tip: V3) {
        self.step_with(&[tip], vec![action]);
    }

    pub fn step(&mut self, tips: &[V3]) {
        self.step_with(tips, Vec::new());
    }

    pub fn step_with(&mut self, tips: &[V3], actions: Vec<Action>) {
        self.step_styli(tips.iter().map(stylus).collect(), actions);
    }

    pub fn step_styli(&mut self, styli: Vec<StylusState>, actions: Vec<Action>) {
        self.frame += 1;
        let time_s = self.frame as f64 / 60.0;
        let trackers = TrackerState { head: None, styli, time_s };
        self.world.step(&Input { actions, ..trackers.into() });
    }

    /// Goes from one place to another in so many frames, and stays there until the body has opened.
    pub fn pass(&mut self, from: V3, to: V3, frames: usize) {
        (0..=frames).for_each(|k| self.put(from.lerp(&to, k as f64 / frames as f64)));
        self.wait(to);
    }

    /// Lets two steps of a cut be worked out.
    pub fn wait(&mut self, tip: V3) {
        (0..2 * LEAST_FRAMES).for_each(|_| self.put(tip));
    }

    /// Moves the right end by this way from now on.
    pub fn hold(&mut self, by: V3) {
        let field = *self.world.fields.bodies[0].poses.last().unwrap();
        self.world.graph.restore(field, ControlPose { translation: by, ..ControlPose::REST });
    }

    /// Place of the deformer's nodes in the room; the block stands at the origin.
    pub fn places(&self) -> Vec<V3> {
        let deformer = &self.world.bodies[0].deformer;
        let turn = deformer.body_from_surface();
        deformer
            .positions()
            .iter()
            .map(|x| turn * nalgebra::Point3::from(V3::from(x.map(f64::from))))
            .map(|x| x.coords)
            .collect()
    }

    /// The largest depth of a node within a ball, m.
    pub fn within_ball(&self, centre: V3, radius: f64) -> f64 {
        self.places().iter().map(|x| radius - (x - centre).norm()).fold(0.0, f64::max)
    }

    /// The lowest displacement along y of a node on top near this x.
    pub fn lowest_beside(&self, x: f64) -> f64 {
        let deformer = &self.world.bodies[0].deformer;
        let is_near = |i: &usize| {
            let at = deformer.rest()[*i].map(f64::from);
            (at[0] - x).abs() < 0.02 && at[1] > 0.049
        };
        let near = (0..deformer.node_count()).filter(is_near);
        near.map(|i| deformer.displacement(i).y).fold(0.0, f64::min)
    }

    pub fn nodes(&self) -> usize {
        self.world.bodies[0].deformer.node_count()
    }

    /// Middles of the pieces that have fallen off.
    pub fn pieces(&self) -> Vec<V3> {
        let own = self.world.bodies[0].assets.color;
        let colors = [own, Highlight::Hovered.color(), Highlight::Held.color()].map(Color::linear);
        let formed = self.world.frame.drawables.iter().filter_map(|drawable| match drawable {
            Drawable::Formed(formed) if colors.contains(&formed.color) => Some(formed.room_from_shape),
            _ => None,
        });
        formed.map(|m| V3::new(m.m14.into(), m.m24.into(), m.m34.into())).collect()
    }

    /// Whether nothing was told but that the block is large for a desk.
    pub fn is_quiet(&self) -> bool {
        self.world.warnings.iter().all(|(_, warning)| warning.starts_with("body.b.place"))
    }

    /// Displacements of all nodes, by their places at rest, while the right end is moved so.
    pub fn moved(&mut self, right: ControlPose) -> Vec<(V3, V3)> {
        let deformer = &mut self.world.bodies[0].deformer;
        let mut poses = vec![ControlPose::REST; deformer.controls.len()];
        *poses.last_mut().unwrap() = right;
        deformer.evaluate(&poses);
        let at = |i: usize| V3::from(deformer.rest()[i].map(f64::from));
        (0..deformer.node_count()).map(|i| (at(i), deformer.displacement(i))).collect()
    }
}
