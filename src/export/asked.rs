//! The poses of an export, each with the body that it is for: all poses of a pose file, or a chosen one with the poses that
//! it starts from.

use crate::base::failure::Failure;
use crate::config::unknown_name;
use crate::deform::pose_file::{Pose, PoseLoads};
use crate::deform::{ControlPose, ControlPoses, Deformer, Freedom, Way, pose_file};
use crate::green::STIFFNESS;
use crate::prepare::Resolved;
use std::path::{Path, PathBuf};

/// A pose, and the body that it is for.
#[derive(Clone)]
pub struct PoseRequest<'a> {
    /// The pose file.
    pub path: PathBuf,
    pub pose: &'a str,
    pub body: &'a str,
    pub control: ControlPoses,
    /// The control poses in the file, if some of them are found.
    pub given: ControlPoses,
    /// The freedom of each control element; empty if none is free.
    pub freedom: Vec<Freedom>,
    pub loads: PoseLoads,
    /// Index of the pose from which it goes on; `None`: from rest.
    pub after: Option<usize>,
}

impl PoseRequest<'_> {
    /// The beginning of messages about it: file, pose and body.
    pub fn place(&self) -> String {
        format!("{}: pose \"{}\": body.{}", self.path.display(), self.pose, self.body)
    }
}

/// The poses of one entry of a pose file; errors name the file, the pose and what is wrong.
pub fn ask<'a>(scene: &'a Resolved, pose: &'a Pose, path: &Path) -> Result<PoseRequest<'a>, Failure> {
    let names = || scene.body.keys().map(String::as_str);
    let wrong =
        |message: String| Failure::wrong(format!("{}: pose \"{}\": {message}", path.display(), pose.name));
    let body = match &pose.body {
        None if scene.body.len() == 1 => names().next(),
        None => return Err(wrong(format!("name its body: {}", names().collect::<Vec<_>>().join(", ")))),
        Some(name) => names().find(|known| known == name),
    };
    let Some(body) = body else {
        let name = pose.body.as_deref().unwrap_or_default();
        return Err(wrong(crate::config::unknown_name("body", name, names())));
    };
    let given = pose_file::control_poses(pose, body, &scene.body[body], path)?;
    let freedom = pose_file::freedom(pose, body, &scene.body[body], path)?;
    if !freedom.is_empty() && !has_forces(scene, body)? {
        return Err(wrong(format!(
            "free control elements need forces, and body.{body} has none: list effects = [\"haptics\"], or \
             take model = \"stvk\""
        )));
    }
    let loads = pose_file::loads(pose, (body, &scene.body[body]), scene.bodies[body].model, path)?;
    Ok(PoseRequest {
        path: path.to_owned(),
        pose: &pose.name,
        body,
        control: given.clone(),
        given,
        freedom,
        loads,
        after: pose.goes_on_from,
    })
}

/// Whether the results of a body have forces.
pub(super) fn has_forces(scene: &Resolved, name: &str) -> Result<bool, Failure> {
    Ok(scene.law(name)?.is_some() || scene.requirements(name)?.has(STIFFNESS))
}

/// Steps in which a body is led from the pose that another goes on from to that one, so that a model that follows turns
/// sees which way they go.
const STEPS: usize = 16;

/// Leads the body through the poses that `asked` goes on from, the first of them as it stands; it is in that of `standing`.
pub(super) fn lead(
    asked: &PoseRequest<'_>,
    all: &[PoseRequest<'_>],
    standing: Option<&PoseRequest<'_>>,
    body: &mut Deformer,
) {
    let Some(before) = asked.after.and_then(|before| all.get(before)) else {
        return body.forget();
    };
    if !standing.is_some_and(|standing| std::ptr::eq(standing, before)) {
        lead(before, all, None, body);
        body.evaluate(&before.control);
    }
    go(&before.control, &asked.control, body);
}

/// Leads the body from one pose nearly to another.
pub(super) fn go(from: &[ControlPose], to: &[ControlPose], body: &mut Deformer) {
    let ways: Vec<Way> = from.iter().zip(to).map(|(from, to)| Way::onwards(from, to)).collect();
    for step in 1..STEPS {
        let share = step as f64 / STEPS as f64;
        let between: ControlPoses = ways.iter().map(|way| way.pose(share)).collect();
        body.take(&between);
    }
}

/// The pose called `name` of every body that has one of this name; the only pose of the file, where no name is given. Each of
/// them stands behind those that it goes on from.
pub fn chosen<'a>(
    scene: &'a Resolved,
    poses: &'a [Pose],
    name: Option<&str>,
    path: &Path,
) -> Result<Vec<PoseRequest<'a>>, Failure> {
    let names = || poses.iter().map(|pose| pose.name.as_str());
    let wrong = |message: String| Failure::wrong(format!("{}: {message}", path.display()));
    let name = match (name, names().next()) {
        (Some(name), _) => name,
        (None, Some(first)) if names().all(|name| name == first) => first,
        (None, _) => {
            let names: std::collections::BTreeSet<&str> = names().collect();
            let names: Vec<&str> = names.into_iter().collect();
            return Err(wrong(format!(
                "holds several poses; say which by --pose NAME: {}",
                names.join(", ")
            )));
        }
    };
    if names().all(|known| known != name) {
        return Err(wrong(unknown_name("pose", name, names())));
    }
    let mut asked = Vec::new();
    for (place, pose) in poses.iter().enumerate().filter(|(_, pose)| pose.name == name) {
        let mut way = vec![ask(scene, pose, path)?];
        let mut before = poses[place].goes_on_from;
        while let Some(at) = before {
            way.push(ask(scene, &poses[at], path)?);
            before = poses[at].goes_on_from;
        }
        let first = asked.len();
        for (at, one) in way.into_iter().rev().enumerate() {
            asked.push(PoseRequest { after: at.checked_sub(1).map(|before| first + before), ..one });
        }
    }
    Ok(asked)
}
