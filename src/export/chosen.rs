//! One pose of a pose file, with those that it goes on from.

use super::asked::{Asked, ask};
use crate::base::failure::Failure;
use crate::config::unknown_name;
use crate::deform::pose_file::Pose;
use crate::prepare::Resolved;
use std::path::Path;

/// The pose called `name` of every body that has one of this name; the only pose of the file, where no name is given. Each of
/// them stands behind those that it goes on from.
pub fn chosen<'a>(
    scene: &'a Resolved,
    poses: &'a [Pose],
    name: Option<&str>,
    path: &Path,
) -> Result<Vec<Asked<'a>>, Failure> {
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
            asked.push(Asked { after: at.checked_sub(1).map(|before| first + before), ..one });
        }
    }
    Ok(asked)
}
