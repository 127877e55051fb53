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

/// Recognised by its tables `[body.NAME]`, or its keys `body.NAME.KEY`.
pub const SCENE: Kind = Kind {
    name: "a scene file",
    recognizes: |head| {
        head.windows(6).any(|window| window == b"[body.")
            || head.split(|byte| *byte == b'\n').any(|line| line.trim_ascii_start().starts_with(b"body."))
    },
};
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
    moved.script.iter_mut().filter(|script| is_file(script)).for_each(|script| *script = there(script));
    moved.paths_mut().into_iter().for_each(|named| *named = there(named));
    let mut staged = Vec::new();
    for (name, body) in &mut moved.body {
        for (control_name, control) in &mut body.control {
            if let Nodes::List(tags) = &control.nodes
                && tags.len() > LONG
            {
                let named = PathBuf::from(format!("{stem}.{name}.{control_name}.nodes"));
                let place = moved_beside(path, &named);
                staged.push(stage_tags(&place, &format!("{name}, {control_name}"), tags)?);
                control.nodes = Nodes::File(named);
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
        high = { nodes = { group = \"high\" }, grab = \"dragger\" }\n\
        loose = { nodes = { file = \"loose.nodes\" }, grab = \"dragger\" }\n";
    /// Other keys of it that name files.
    const FILES: &str = "texture = \"wood.png\"\n\
        load.wind = { nodes = { file = \"wind.nodes\" }, kind = \"direction\", direction = { file = \"wind.csv\" } }\n\
        surface_compliance = { nodes = { file = \"pressed.nodes\" } }\n\
        updates = { release = [\"loose\"], released = [\"loose\"] }\n";
    const PROBE: &str = "[tool.probe]\nshape = { mesh = { file = \"probe.stl\" } }\n";

    #[test]
    fn a_saved_scene_is_the_same_from_where_it_stands() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("scenes")).unwrap();
        let text = SCENE.replace("[body.part.control]", &format!("{FILES}[body.part.control]"));
        let mut scene = Scene::parse(&format!("{text}{PROBE}"), &folder.path().join("part.toml")).unwrap();
        scene.body["part"].control["low"].nodes = Nodes::List((1..=1000).collect());
        let mut other = scene.body["part"].clone();
        other.control["low"].nodes = Nodes::List((1001..=2000).collect());
        scene.body.insert("other".to_owned(), other);
        let path = folder.path().join("scenes/mine.toml");
        let saved = save(&scene, &Comments::new(), None, &path).unwrap();
        assert_eq!(saved.body["part"].mesh.as_deref(), Some(Path::new("../part.msh")));
        for (body, first) in [("part", "1"), ("other", "1001")] {
            let name = format!("mine.{body}.low.nodes");
            assert_eq!(saved.body[body].control["low"].nodes, Nodes::File(name.as_str().into()));
            let tags = std::fs::read_to_string(folder.path().join("scenes").join(name)).unwrap();
            let tags: Vec<&str> = tags.lines().filter(|line| !line.starts_with('#')).collect();
            assert_eq!((tags.len(), tags[0]), (1000, first));
        }
        let paths = |scene: &mut Scene| {
            scene.paths_mut().iter().map(|path| path.display().to_string()).collect::<Vec<_>>()
        };
        let moved: Vec<String> = paths(&mut scene).iter().map(|path| format!("../{path}")).collect();
        assert_eq!(moved.len(), 1 + 2 * 6, "{moved:?}");
        let own = |path: &String| path.ends_with(".low.nodes");
        let found: Vec<String> = paths(&mut saved.clone()).into_iter().filter(|path| !own(path)).collect();
        assert_eq!(found, moved);
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
