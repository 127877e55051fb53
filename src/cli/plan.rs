//! Settings chosen for a scene's bodies by [`tuning`](crate::tuning), with the files, poses and progress of the command
//! line.

use super::accuracy::scripted_or_random;
use super::failure::Failure;
use super::progress::Bars;
use super::session;
use crate::base::notice::notice;
use crate::green::{GreenError, GreenFile};
use crate::scene::Scene;
use crate::tuning::Planner;

/// [`Planner::choose`]; says on standard error what was chosen, and why.
pub fn settled(scene: Scene, quiet: bool, force: bool) -> Result<Scene, Failure> {
    with_planner(quiet, |planner| planner.choose(scene, force))
}

/// [`Planner::choose_from_file`].
pub fn known(scene: Scene) -> Result<Scene, Failure> {
    with_planner(true, |planner| planner.choose_from_file(scene))
}

fn with_planner(
    quiet: bool,
    choose: impl FnOnce(&Planner<'_, Failure>) -> Result<Scene, Failure>,
) -> Result<Scene, Failure> {
    choose(&Planner {
        needs: &|scene, name| session::needs(scene, name, &scene.body[name]),
        file: &green_file,
        poses: &|scene, name| scripted_or_random(scene, name, None, true),
        progress: &|name| Box::new(Bars::new(name, quiet)),
        notify: &|sentence| notice!("{sentence}"),
    })
}

/// The scene's .green file, shipped or unpacked, where there is one.
fn green_file(scene: &Scene) -> Result<Option<GreenFile>, Failure> {
    let path = session::green_path(scene);
    session::unpack_shipped(&path)?;
    match GreenFile::open(&path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
        file => Ok(Some(file?)),
    }
}

/// The turn up to which the error of a planned body was measured, with a tenth to spare; nothing of other bodies.
pub fn range(file: &GreenFile, body: &str) -> Option<f64> {
    file.meta.bodies.get(body)?.plan.as_ref()?.get("range")?.as_f64().map(|range| 1.1 * range)
}
