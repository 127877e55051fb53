//! The built-in scenes: their files are inside the program, and what is computed for them goes to the cache folder.

use crate::base::cache;
use crate::config;
use std::path::{Path, PathBuf};

/// The files of the built-in scenes, by name.
pub const BUILT_IN: [(&str, &str); 7] = [
    ("liver", include_str!("../../configs/scenes/liver.toml")),
    ("tube", include_str!("../../configs/scenes/tube.toml")),
    ("hose", include_str!("../../configs/scenes/hose.toml")),
    ("bar", include_str!("../../configs/scenes/bar.toml")),
    ("bear", include_str!("../../configs/scenes/bear.toml")),
    ("models", include_str!("../../configs/scenes/models.toml")),
    ("stylus", include_str!("../../configs/scenes/stylus.toml")),
];

/// The text of the built-in scene of this name, and where its file would stand; `None` for a path, which has a folder or an
/// extension, or is there. A folder of a scene's name hides no scene.
pub fn named(name: &Path) -> Option<Result<(&'static str, PathBuf), String>> {
    let is_known = BUILT_IN.iter().any(|(known, _)| name.as_os_str() == *known);
    let is_there = name.is_file() || (name.exists() && !is_known);
    let is_path = name.components().count() != 1 || name.extension().is_some() || is_there;
    let name = name.to_str().filter(|_| !is_path)?;
    Some(match BUILT_IN.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => Ok((text, cache::folder().join(name).with_extension("toml"))),
        None => Err(config::unknown_name("scene", name, BUILT_IN.iter().map(|(known, _)| *known))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn a_name_is_a_scene_and_what_looks_like_a_path_is_none() {
        for (name, _) in BUILT_IN {
            let scene = Scene::load(Path::new(name)).unwrap();
            assert!(scene.path.ends_with(format!("{name}.toml")) && scene.path.is_absolute());
        }
        let text = Scene::load(Path::new("beer")).unwrap_err().to_string();
        assert!(
            text.contains("did you mean \"bear\"?") && text.contains("or the path of a .toml file"),
            "{text}"
        );
        let text = Scene::load(Path::new("beer.toml")).unwrap_err().to_string();
        assert!(text.starts_with("beer.toml: "), "{text}");
        assert!(named(Path::new("src")).is_none() && named(Path::new("./bear")).is_none());
    }
}
