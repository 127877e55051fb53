//! Writes a scene that was made in the program as a file that reads as if a person had written it, with its .green file.
//!
//! In: a scene, whose paths start where it was opened, and where it is to stand. Out: the scene with paths from there, its
//! file, a file of node tags for each painted element that is long, and the .green file if there is one already.

use crate::base::failure::Failure;
use crate::base::output::{self, Kind, OutputError, Staged};
use crate::green::{self, GreenFile};
use crate::prepare;
use crate::scene::proposal::relative;
use crate::scene::write::{self, Comments};
use crate::scene::{Nodes, Scene};
use std::path::{Path, PathBuf};

/// Number of nodes of a painted element above which it gets a separate file.
const LONG: usize = 400;

const SCENE: Kind =
    Kind { name: "a scene file", recognizes: |head| head.windows(6).any(|window| window == b"[body.") };
const TAGS: Kind =
    Kind { name: "a file of node tags by greenstage", recognizes: |head| head.starts_with(TAGS_HEAD) };
const TAGS_HEAD: &[u8] = b"# greenstage: nodes of ";

/// Writes `scene` to `path`; returns it as it is read from there. A file that is there is left as it is.
pub fn save(
    scene: &Scene,
    comments: &Comments,
    file: Option<&GreenFile>,
    path: &Path,
) -> Result<Scene, Failure> {
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Err(Failure::wrong(format!("{}: a scene file's name ends in .toml", path.display())));
    }
    if path.exists() {
        return Err(Failure::wrong(format!("{} already exists: give it another name", path.display())));
    }
    output::make_folder_of(path)?;
    let mut moved = scene.clone();
    moved.path = path.to_owned();
    let there = |from: &Path| relative(&scene.resolve(from), path);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let is_file = |named: &Path| named.extension().is_some_and(|extension| extension == "toml");
    if is_file(Path::new(&scene.stage)) {
        moved.stage = there(Path::new(&scene.stage)).display().to_string();
    }
    moved.script =
        scene.script.as_ref().map(|script| if is_file(script) { there(script) } else { script.clone() });
    let mut staged = Vec::new();
    for (name, body) in &mut moved.body {
        body.mesh = body.mesh.as_deref().map(there);
        for (control_name, control) in &mut body.control {
            match &mut control.nodes {
                Nodes::File(tags) => *tags = there(tags),
                Nodes::List(tags) if tags.len() > LONG => {
                    let named = PathBuf::from(format!("{stem}.{control_name}.nodes"));
                    let place = moved_beside(path, &named);
                    staged.push(stage_tags(&place, &format!("{name}, {control_name}"), tags)?);
                    control.nodes = Nodes::File(named);
                }
                _ => {}
            }
        }
    }
    let text = write::text(&moved, comments)?;
    staged.push(output::stage(path, &SCENE, |file| file.write_all(text.as_bytes()))?);
    output::put_all(staged, &[])?;
    let moved = Scene::load(path)?;
    if let Some(file) = file.filter(|file| file.path.exists()) {
        keep_green(&moved, file)?;
    }
    Ok(moved)
}

fn moved_beside(path: &Path, named: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(named)
}

fn stage_tags(path: &Path, of: &str, tags: &[u64]) -> Result<Staged, OutputError> {
    let mut text = format!("{}{of}, one tag a line\n", String::from_utf8_lossy(TAGS_HEAD));
    tags.iter().for_each(|tag| text.push_str(&format!("{tag}\n")));
    output::stage(path, &TAGS, |file| file.write_all(text.as_bytes()))
}

/// Copies the .green file beside the scene, which then opens at once.
fn keep_green(scene: &Scene, file: &GreenFile) -> Result<(), Failure> {
    let path = prepare::green_path(scene);
    let mut from = std::fs::File::open(&file.path).map_err(Failure::work)?;
    output::write(&path, &green::GREEN, |to| std::io::copy(&mut from, to).map(drop))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Nodes;

    const SCENE: &str = "stage = \"workbench\"\n\
        [body.part]\n\
        mesh = \"part.msh\"\n\
        material = \"rubber\"\n\
        [body.part.control]\n\
        low = { nodes = { list = [1, 2, 3] }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"high\" }, grab = \"dragger\" }\n";

    #[test]
    fn a_saved_scene_is_the_same_from_where_it_stands() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("scenes")).unwrap();
        let mut scene = Scene::parse(SCENE, &folder.path().join("part.toml")).unwrap();
        scene.body["part"].control["low"].nodes = Nodes::List((1..=1000).collect());
        let path = folder.path().join("scenes/mine.toml");
        let saved = save(&scene, &Comments::new(), None, &path).unwrap();
        assert_eq!(saved.body["part"].mesh.as_deref(), Some(Path::new("../part.msh")));
        assert_eq!(saved.body["part"].control["low"].nodes, Nodes::File("mine.low.nodes".into()));
        let tags = std::fs::read_to_string(folder.path().join("scenes/mine.low.nodes")).unwrap();
        assert_eq!(tags.lines().filter(|line| !line.starts_with('#')).count(), 1000);
        assert_eq!(saved.stage, "workbench");
        let again = save(&scene, &Comments::new(), None, &path).unwrap_err().to_string();
        assert!(again.contains("already exists"), "{again}");
        assert!(save(&scene, &Comments::new(), None, &folder.path().join("mine")).is_err());
    }

    #[test]
    fn a_short_list_stands_in_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = Scene::parse(SCENE, &folder.path().join("part.toml")).unwrap();
        let nodes = Nodes::List((100..300).collect());
        scene.body["part"].control["low"].nodes = nodes.clone();
        let path = folder.path().join("mine.toml");
        assert_eq!(
            save(&scene, &Comments::new(), None, &path).unwrap().body["part"].control["low"].nodes,
            nodes
        );
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
    }
}
