//! Lets [`tuning`](crate::tuning) choose the settings of a scene's bodies, with the files, poses and progress bars of the
//! command line.

use super::accuracy::scripted_or_random;
use crate::base::bars::Bars;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::green::{GreenError, GreenFile};
use crate::prepare;
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
        requirements: &|scene, name| prepare::requirements(scene, name, &scene.body[name]),
        file: &green_file,
        poses: &|scene, name| scripted_or_random(scene, name, None, true),
        progress: &|name| Box::new(Bars::new(name, quiet)),
        notify: &|sentence| notice!("{sentence}"),
    })
}

/// The scene's .green file, shipped or unpacked, where there is one.
fn green_file(scene: &Scene) -> Result<Option<GreenFile>, Failure> {
    let path = prepare::green_path(scene);
    prepare::unpack_shipped(&path)?;
    match GreenFile::open(&path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
        file => Ok(Some(file?)),
    }
}
