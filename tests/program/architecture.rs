//! The house: who may import whom, who may know the graphics library.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Imports go only to the right; tests and documentation links keep to it as well. Every room may use `base`.
const IMPORTS: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("config", &[]),
    ("manual", &[]),
    ("render", &[]),
    ("mesh", &["config"]),
    ("stage", &["config"]),
    ("field", &["config"]),
    ("track", &["stage", "field", "config"]),
    ("scene", &["mesh", "stage", "config"]),
    ("fem", &["mesh", "config"]),
    ("solve", &["fem", "config"]),
    ("green", &["scene", "mesh", "fem", "solve", "config"]),
    ("deform", &["field", "green", "scene", "mesh", "fem", "solve", "config"]),
    ("interact", &["mesh", "field", "track", "stage", "config"]),
    ("effect", &["deform", "track", "interact", "green", "scene", "mesh", "fem", "solve", "stage", "config"]),
    ("verify", &["deform", "green", "scene", "mesh", "fem", "solve", "config"]),
    ("report", &["verify", "deform", "effect", "green", "scene", "mesh", "fem", "solve", "config"]),
    (
        "cli",
        &[
            "config", "manual", "render", "mesh", "stage", "scene", "fem", "solve", "green", "deform",
            "effect", "report", "field", "track", "interact", "verify",
        ],
    ),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files with the extension below `folder`, sorted, with their text.
fn files(folder: &str, extension: &str) -> Vec<(String, String)> {
    fn walk(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, extension, found);
            } else if path.extension().is_some_and(|known| known == extension) {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), extension, &mut found);
    found.sort();
    let name = |path: &Path| path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned();
    found.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect()
}

/// `stage` of src/stage/file.rs; `None` for main.rs and lib.rs, which hold nothing but the list of the modules.
fn module_of(file: &str) -> Option<&str> {
    let inside = file.strip_prefix("src/")?;
    let module = inside.split('/').next()?.trim_end_matches(".rs");
    (module != "main" && module != "lib").then_some(module)
}

/// The modules that a source text names behind `crate::` or behind so many `super::` that they leave its own module.
fn imports(file: &str, text: &str) -> BTreeSet<String> {
    let mut named = BTreeSet::new();
    let mut rest = text;
    while let Some(at) = rest.find("crate::") {
        let before = rest[..at].chars().next_back();
        rest = &rest[at + "crate::".len()..];
        if !before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            named.extend(first_names(rest));
        }
    }
    // src/a.rs and src/a/mod.rs are one `super` below the crate, src/a/b.rs two.
    let parts: Vec<&str> = file.trim_end_matches(".rs").split('/').skip(1).collect();
    let depth = parts.len() - usize::from(parts.ends_with(&["mod"]));
    let up = "super::".repeat(depth);
    let mut rest = text;
    while let Some(at) = rest.find(&up) {
        rest = &rest[at + up.len()..];
        let in_tests = text[..text.len() - rest.len()].contains("mod tests {");
        if !in_tests && !rest.starts_with("super::") {
            named.extend(first_names(rest));
        }
    }
    named
}

/// `a` of `a::b`, or `a` and `c` of `{a::b, c::{d, e}}`.
fn first_names(path: &str) -> Vec<String> {
    let word = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let Some(list) = path.strip_prefix('{') else {
        return vec![word(path)];
    };
    let mut depth = 1;
    let mut names = vec![word(list)];
    for (at, c) in list.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match (depth, c) {
            (0, _) => break,
            (1, ',') => names.push(word(&list[at + 1..])),
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

#[test]
fn imports_are_found_however_they_are_written() {
    let found = |file: &str, text: &str| imports(file, text).into_iter().collect::<Vec<_>>();
    assert_eq!(found("src/a/b.rs", "use crate::mesh::{self, Fault};"), ["mesh"]);
    assert_eq!(
        found("src/a/b.rs", "use crate::{fem, mesh::{x, y},\n    stage::Eye,\n};"),
        ["fem", "mesh", "stage"]
    );
    assert_eq!(found("src/a/b.rs", "let x = crate::scene::Scene::load();"), ["scene"]);
    assert_eq!(found("src/a/b.rs", "use super::super::render::Gpu;"), ["render"]);
    assert_eq!(found("src/a/mod.rs", "use super::render::Gpu;"), ["render"]);
    assert_eq!(found("src/a/b/c.rs", "use super::super::own::Gpu; use wgpu_crate::x;"), [""; 0]);
}

#[test]
fn modules_import_only_what_the_house_allows() {
    let mut faults = Vec::new();
    let mut modules = BTreeSet::new();
    for (file, text) in files("src", "rs") {
        let Some(module) = module_of(&file) else {
            continue;
        };
        modules.insert(module.to_owned());
        let Some((_, allowed)) = IMPORTS.iter().find(|(name, _)| *name == module) else {
            faults.push(format!("{file}: the module {module} has no row in the table of imports"));
            continue;
        };
        for import in imports(&file, &text) {
            if import != module && import != "base" && !allowed.contains(&import.as_str()) {
                faults.push(format!("{file}: {module} must not import {import}"));
            }
        }
    }
    assert!(modules.len() >= 13, "sources were read: {modules:?}");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Nobody can import in a circle: in the table everything stands behind what it imports.
#[test]
fn the_table_of_imports_has_no_circle() {
    for (row, (module, allowed)) in IMPORTS.iter().enumerate() {
        for import in *allowed {
            let at = IMPORTS.iter().position(|(name, _)| name == import);
            assert!(at.is_some_and(|at| at < row), "{module} ← {import}");
        }
    }
}

#[test]
fn the_graphics_and_window_libraries_are_known_to_render_alone() {
    let knows = |text: &str| {
        text.lines()
            .filter(|line| !line.trim_start().starts_with("//"))
            .any(|line| line.contains("wgpu") || line.contains("winit::"))
    };
    let (inside, outside): (Vec<_>, Vec<_>) =
        files("src", "rs").into_iter().partition(|(file, _)| module_of(file) == Some("render"));
    assert!(inside.iter().any(|(_, text)| knows(text)));
    let faults: Vec<&String> = outside.iter().filter(|(_, text)| knows(text)).map(|(file, _)| file).collect();
    assert!(faults.is_empty(), "{faults:?} speak of the graphics or window library");
}

/// Every file that is not a module of tests opens by saying what it is; so does every shader.
#[test]
fn every_module_opens_with_its_documentation() {
    let is_said = |line: &str, mark: &str| line.strip_prefix(mark).is_some_and(|said| said.trim().len() > 10);
    let source = files("src", "rs").into_iter().map(|file| (file, "//!"));
    let shaders = files("shaders", "wgsl").into_iter().map(|file| (file, "//"));
    let silent: Vec<String> = source
        .chain(shaders)
        .filter(|((file, _), _)| !file.ends_with("/tests.rs"))
        .filter(|((_, text), mark)| !is_said(text.lines().next().unwrap_or(""), mark))
        .map(|((file, _), _)| file)
        .collect();
    assert!(silent.is_empty(), "without a first line of documentation: {silent:?}");
}

/// A module that cannot be named from outside needs no row; one that can is in the crate's own table.
#[test]
fn the_crates_documentation_lists_every_public_module() {
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let public: Vec<&str> =
        lib.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    assert!(public.len() >= 13, "{public:?}");
    for module in public {
        assert!(lib.contains(&format!("//! | [`{module}`] |")), "src/lib.rs does not describe {module}");
    }
}

/// `eprintln!` panics where standard error cannot be written, and a full disk of logs would cost the work.
#[test]
fn notices_go_through_base() {
    let ours = |(file, text): (String, String)| {
        let own = text.split("#[cfg(test)]\nmod ").next().unwrap_or("").contains("eprint");
        (own && !file.ends_with("tests.rs") && !file.contains("/tests/") && file != "src/base/notice.rs")
            .then_some(file)
    };
    let faults: Vec<String> = files("src", "rs").into_iter().filter_map(ours).collect();
    assert!(faults.is_empty(), "{faults:?} should write `notice!` of base::notice");
}
