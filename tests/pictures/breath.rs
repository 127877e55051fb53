//! An effect that stands in no list of the program, made of public parts alone: a body that breathes, and a spring at what is
//! held. It has a setting, columns, a memory, a step in each frame, and forces.

use crate::render_common::require_gpu;
use greenstage::deform::{Contribution, ControlPose, Deformer, PoseCurvature};
use greenstage::effect::{self, EffectEntry, EffectInput, Resolved, add_sections, settings};
use greenstage::green::{self, GreenFile, columns_of_effect};
use greenstage::render::BodyBuffers;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use greenstage::stage::Stage;
use greenstage::track::TrackerState;
use greenstage::world::inertia::Inertia;
use greenstage::world::running::{Memory, read, written};
use greenstage::world::{RunningEffect, State, World};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

const BREATH: EffectEntry = EffectEntry {
    name: "breath",
    summary: "the body breathes, and a spring pulls what is held back to its place",
    needs_energy: true,
    settings: Some(settings::read::<Settings>),
    precompute: Some(|_, body, _| {
        let nodes = body.solution.mesh.nodes.clone();
        let bump = |row: usize, _| {
            let x = nodes[row / 3];
            // Zero at both ends, which are control elements.
            if row % 3 == 1 { (PI * (x.x + 0.5)).sin() * (0.1 + x.y) } else { 0.0 }
        };
        Ok(columns_of_effect(body, 1, &bump))
    }),
    attach: Some(join),
    ..EffectEntry::NOTHING
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Settings {
    /// Stiffness of the spring, N/m.
    stiffness: f64,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { stiffness: 0.0 }
    }
}

fn join(
    listed: &EffectInput<'_>,
    _: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, greenstage::base::failure::Failure> {
    let (b, name) = listed.bodies[0];
    let settings: &Settings = listed.scene.bodies[name].settings(BREATH.name).unwrap();
    Ok(Some(Box::new(Breath { b, stiffness: settings.stiffness, seen_s: None, phase: 0.0 })))
}

struct Breath {
    b: usize,
    stiffness: f64,
    seen_s: Option<f64>,
    phase: f64,
}

/// Angular frequency of the breath when nothing is turned, rad/s.
const PACE: f64 = TAU / 4.0;

impl RunningEffect for Breath {
    fn name(&self) -> &'static str {
        BREATH.name
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(&mut self, world: &World, contributions: &mut [Contribution], _: &mut [&mut dyn Inertia]) {
        let now_s = *world.graph.get(world.fields.time);
        let pose: &ControlPose = world.graph.get(world.fields.bodies[self.b].poses[1]);
        // What was done so far matters: a held body breathes faster.
        let pace = PACE * (1.0 + pose.translation.norm());
        self.phase += pace * (now_s - self.seen_s.replace(now_s).unwrap_or(now_s));
        let own = &mut contributions[self.b];
        let at = world.bodies[self.b].deformer.coefficients_of(BREATH.name);
        own.coefficients[at.start] += self.phase.sin();
        own.energy += 0.5 * self.stiffness * pose.translation.norm_squared();
        own.slopes[1].translation += self.stiffness * pose.translation;
        let mut spring = PoseCurvature::zeros();
        spring.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * self.stiffness));
        own.curvatures[1] += spring;
    }

    fn memory(&self) -> Option<Memory> {
        written(&(self.seen_s, self.phase))
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        (self.seen_s, self.phase) = read(memory)?;
        Ok(())
    }
}

fn scene(effects: &str) -> Resolved {
    let text = format!(
        "[body.b]\n\
         generate = {{ block = {{ size = [1.0, 0.2, 0.2], cells = [10, 2, 2] }} }}\n\
         material = {{ young = 1.0e4, poisson = 0.3 }}\nmodel = \"rotation\"\n{effects}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
    );
    Resolved::among(Scene::parse(&text, Path::new("breath.toml")).unwrap(), &[BREATH]).unwrap()
}

const LISTED: &str = "effects = [\"breath\"]\neffect.breath.stiffness = 300.0";

fn file(scene: &Resolved) -> Arc<GreenFile> {
    let energy = scene.bodies["b"].model.energy.unwrap_or_default();
    let required = scene.requirements("b").unwrap().and(green::Requirements::new(energy));
    let mut solved = green::precompute(scene, "b", &required, &Silent).unwrap();
    add_sections(scene, &mut solved, &Silent).unwrap();
    green::opened(&[solved]).unwrap()
}

fn world(scene: &Resolved, file: &Arc<GreenFile>) -> World {
    effect::world(&[BREATH], scene, file, Stage::find("desktop").unwrap()).unwrap()
}

fn pose(frame: usize) -> ControlPose {
    let t = frame as f64 / 20.0;
    ControlPose {
        translation: Vector3::new(0.0, 0.1 * t.sin(), 0.05 * t),
        matrix: *Rotation3::from_scaled_axis(Vector3::z() * 0.6 * t.sin()).matrix(),
    }
}

fn step(world: &mut World, frame: usize) {
    let field = world.fields.bodies[0].poses[1];
    world.graph.restore(field, pose(frame));
    world.step(&TrackerState { time_s: frame as f64 / 50.0, ..Default::default() }.into());
}

#[test]
fn an_effect_of_ones_own_changes_shape_energy_and_force_in_the_frame_that_asks() {
    let (with, without) = (scene(LISTED), scene(""));
    let (mut breathing, mut still) = (world(&with, &file(&with)), world(&without, &file(&without)));
    assert!(still.fields.contributions.is_none(), "what is not listed has no field");
    for frame in 0..40 {
        step(&mut breathing, frame);
        step(&mut still, frame);
        let [one, other]: [&Deformer; 2] = [&breathing.bodies[0].deformer, &still.bodies[0].deformer];
        // x = R (X + u): the column stands in the frame that turns along.
        let size = breathing.graph.get(breathing.fields.contributions.unwrap()).0[0].coefficients[0];
        let (mut moved, mut error) = (0.0_f32, 0.0_f32);
        for (n, rest) in one.rest().iter().enumerate() {
            let x = rest.map(f64::from);
            let bump = size * (PI * (x[0] + 0.5)).sin() * (0.1 + x[1]);
            let found = one.kept_positions()[n][1] - other.kept_positions()[n][1];
            moved = moved.max(found.abs());
            error = error.max((found - bump as f32).abs());
        }
        assert!(error < 1e-6, "frame {frame}: {error} m");
        assert!(frame == 0 || moved > 1e-3, "frame {frame}: {moved} m");

        let (wrenches, energy) = one.wrenches().unwrap();
        let (plain, own) = other.wrenches().unwrap();
        let shift = pose(frame).translation;
        let spring = wrenches[1].force - plain[1].force - 300.0 * shift;
        assert!(spring.norm() < 1e-9 && (energy - own - 150.0 * shift.norm_squared()).abs() < 1e-9);
        assert_eq!(wrenches[0], plain[0]);
    }
}

#[test]
fn an_effect_of_ones_own_goes_on_from_a_state_bit_by_bit() {
    let scene = scene(LISTED);
    let file = file(&scene);
    let mut first = world(&scene, &file);
    (0..30).for_each(|frame| step(&mut first, frame));
    let text = serde_json::to_string(&first.state().unwrap()).unwrap();
    let mut second = world(&scene, &file);
    second.set_state(&serde_json::from_str::<State>(&text).unwrap()).unwrap();
    assert_eq!(second.state_hash(), first.state_hash());
    for frame in 30..130 {
        step(&mut first, frame);
        step(&mut second, frame);
        assert_eq!(second.state_hash(), first.state_hash(), "frame {frame}");
    }
}

#[test]
fn an_effect_of_ones_own_shapes_what_the_graphics_device_deforms() {
    let Some(gpu) = require_gpu() else { return };
    let scene = scene(LISTED);
    let mut world = world(&scene, &file(&scene));
    let deformer = &world.bodies[0].deformer;
    let colors = vec![[0; 4]; deformer.node_count()];
    let (triangles, rest) = (deformer.triangles(), deformer.rest());
    let mut buffers =
        BodyBuffers::with_columns(&gpu, triangles, &colors, rest, &deformer.groups(), None, &[]).unwrap();
    for frame in [3, 17, 29] {
        step(&mut world, frame);
        let deformer = &world.bodies[0].deformer;
        buffers.deform(&gpu, &deformer.state.coefficients, &[]).unwrap();
        let [found, _] = buffers.read(&gpu).unwrap();
        let pairs = found.as_flattened().iter().zip(deformer.kept_positions().as_flattened());
        let error = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(error < 1e-5, "frame {frame}: {error} m");
    }
}
