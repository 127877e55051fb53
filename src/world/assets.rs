//! The loaded data of a session: the same in every frame, and shared by all that reads it.
//!
//! In: a scene, its .green file, the bodies' deformers, and a stage. Out: [`Assets`], of which nothing changes, with the bodies' places.

use super::place;
use crate::base::failure::Failure;
use crate::deform::{Deformer, ModelEntry};
use crate::green::GreenFile;
use crate::render::Pattern;
use crate::scene::{Body, Color, GRAVITY, Grab, Scene};
use crate::stage::Stage;
use nalgebra::{Point3, Similarity3, Translation3, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Largest distance at which a ray that passes a node of a control element still takes it, as part of the workspace's radius.
const PASSING_BY: f64 = 0.05;

/// Longest time that a frame waits for the columns of a point that is touched.
pub const PATIENCE: Duration = Duration::from_millis(5);

/// The loaded data of a session.
#[derive(Clone)]
pub struct Assets {
    pub stage: Stage,
    pub bodies: Vec<Arc<BodyAssets>>,
}

/// The loaded data of a body.
#[derive(Clone)]
pub struct BodyAssets {
    pub model: &'static ModelEntry,
    /// Names of its effects, as in the scene.
    pub effects: Vec<String>,
    /// room_from_body before anybody navigates.
    pub home: Similarity3<f64>,
    /// Whether it has no `place`.
    pub is_fitted: bool,
    /// Middle and radius of a ball about it at rest, in its frame.
    pub ball: (Point3<f64>, f64),
    pub controls: Vec<ControlAssets>,
    pub color: Color,
    /// Lines and image on the surface.
    pub pattern: Pattern,
    /// Nodes of the surface that take forces, where the scene has them touched, and the spring by which.
    pub takes_forces: BTreeSet<u32>,
    pub spring: Option<f64>,
    /// Whether its first loads are those of gravity.
    pub has_gravity: bool,
    /// Largest turn for which a planned body's error was measured, rad.
    pub range: Option<f64>,
    /// Largest distance at which a ray that misses a node of a control element still takes it, m in the room.
    pub passing_m: f64,
}

/// A control element.
#[derive(Clone, Copy)]
pub struct ControlAssets {
    /// Whether a hand can take it.
    pub grab: Grab,
}

/// The turn up to which the error of a planned body was measured, rad, with a tenth to spare; `None` for other bodies.
fn measured_range(file: &GreenFile, body: &str) -> Option<f64> {
    file.meta.bodies.get(body)?.plan.as_ref()?.get("range")?.as_f64().map(|range| 1.1 * range)
}

/// The assets of a body, and what is wrong with its place.
pub type LoadedBody = (Arc<BodyAssets>, Vec<String>);

/// The assets of all bodies of a scene at their places on a stage.
pub fn of_bodies(
    scene: &Scene,
    file: &GreenFile,
    deformers: &mut [Deformer],
    stage: &Stage,
) -> Result<Vec<LoadedBody>, Failure> {
    let points: Vec<_> = deformers.iter().map(in_mesh).collect();
    let standing: Vec<(&Body, &[Point3<f64>])> =
        scene.body.values().zip(points.iter().map(Vec::as_slice)).collect();
    let places = place::rooms_from_meshes(&standing, stage);
    let of = |(((deformer, body), points), room_from_mesh): (((&mut Deformer, &Body), &Vec<_>), &_)| {
        deformer.keep_sharp(body.crease.to_radians());
        deformer.be_patient(PATIENCE);
        let mesh_from_body = Translation3::from(deformer.centre);
        let wrong = place::fault(points, room_from_mesh, stage);
        let home = room_from_mesh * mesh_from_body;
        let ball = ball(deformer);
        let assets = BodyAssets {
            color: body.color,
            pattern: pattern(scene, body, deformer)?,
            home,
            is_fitted: body.place.is_none(),
            ball,
            controls: body.control.values().map(|control| ControlAssets { grab: control.grab }).collect(),
            model: deformer.entry,
            effects: body.effects.clone(),
            takes_forces: deformer.takes_forces(),
            spring: body.surface_compliance.as_ref().and_then(|of| of.spring),
            has_gravity: deformer.load_metas().first().is_some_and(|load| load.name == GRAVITY),
            range: measured_range(file, &deformer.body),
            passing_m: PASSING_BY * stage.workspace.radius_m,
        };
        let wrong = [
            wrong.map(|wrong| ("place", wrong)),
            body.held_by(!scene.tool.is_empty()).map(|how| ("control", how)),
        ];
        let warnings = wrong.into_iter().flatten();
        let warnings = warnings.map(|(key, message)| format!("body.{}.{key}: {message}", deformer.body));
        Ok((Arc::new(assets), warnings.collect()))
    };
    deformers.iter_mut().zip(scene.body.values()).zip(&points).zip(&places).map(of).collect()
}

/// Lowest and highest corner of the body at rest.
fn extent(deformer: &Deformer) -> Option<(Vector3<f64>, Vector3<f64>)> {
    crate::base::extent::extent(deformer.rest().iter().map(|x| Vector3::from(*x).cast()))
}

/// A ball about the body at rest.
fn ball(deformer: &Deformer) -> (Point3<f64>, f64) {
    let Some((low, high)) = extent(deformer) else {
        return (Point3::origin(), 1.0);
    };
    (Point3::from((low + high) / 2.0), (high - low).norm() / 2.0)
}

/// The surface at rest in the mesh's frame.
fn in_mesh(deformer: &Deformer) -> Vec<Point3<f64>> {
    let point = |x: &[f32; 3]| Point3::from(Vector3::from(*x).cast::<f64>() + deformer.centre);
    deformer.rest().iter().map(point).collect()
}

/// The lines and the image that the scene asks for, about the middle of the body at rest.
fn pattern(scene: &Scene, body: &Body, deformer: &Deformer) -> Result<Pattern, Failure> {
    let (low, high) = extent(deformer).unwrap_or_default();
    let longest = (high - low).max();
    let image = scene.load_texture(&deformer.body, body)?;
    let size = body.texture.as_ref().and_then(|texture| texture.size).unwrap_or(longest / 2.0);
    Ok(Pattern {
        middle: ((low + high) / 2.0).cast().into(),
        line_spacing_m: body.lines.spacing(longest).map(|spacing| spacing as f32),
        image: image.map(|image| (Arc::new(image), size as f32)),
    })
}
