//! The house: who may import whom, who may know the graphics library.

use greenstage::deform::MODELS;
use greenstage::effect::EFFECTS;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The rooms that the world and all above it may use.
const BELOW_WORLD: &str = "deform interact green scene mesh fem solve stage audio track field render config";

/// Imports go only to the right; tests and documentation links keep to it as well. Every room may use `base`.
const IMPORTS: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("config", &[]),
    ("manual", &[]),
    ("render", &[]),
    ("mesh", &["config"]),
    ("stage", &["config"]),
    ("audio", &["stage", "config"]),
    ("field", &["config"]),
    ("track", &["stage", "field", "config"]),
    ("fem", &["mesh", "config"]),
    ("solve", &["fem", "config"]),
    ("bem", &["fem", "solve"]),
    ("scene", &["mesh", "fem", "solve", "stage", "config"]),
    ("green", &["bem", "scene", "mesh", "fem", "solve", "config"]),
    ("deform", &["field", "green", "scene", "mesh", "fem", "solve", "config"]),
    ("interact", &["mesh", "field", "track", "stage", "config"]),
    ("world", &[BELOW_WORLD]),
    ("effect", &["world", BELOW_WORLD]),
    ("prepare", &["effect", "deform", "green", "scene", "mesh", "fem", "config"]),
    ("export", &["prepare effect world", BELOW_WORLD]),
    ("measure", &["prepare effect deform green scene mesh fem solve"]),
    ("verify", &["measure effect world deform green scene mesh fem solve track stage render config"]),
    ("report", &["measure export green scene mesh solve"]),
    ("session", &["prepare effect world", BELOW_WORLD]),
    ("tuning", &["session measure prepare world deform green scene mesh fem solve"]),
    ("edit", &["interact green prepare scene mesh config"]),
    ("display", &["edit session export prepare effect world", BELOW_WORLD]),
    ("demo", &["display session prepare effect world", BELOW_WORLD]),
    (
        "cli",
        &[
            "demo edit display session tuning report verify measure export manual prepare effect world",
            BELOW_WORLD,
        ],
    ),
];

/// The rooms of a row, in which [`BELOW_WORLD`] stands for several.
fn rooms_of(row: &'static [&'static str]) -> impl Iterator<Item = &'static str> {
    row.iter().flat_map(|rooms| rooms.split(' '))
}

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

/// `stage` of src/stage/screen.rs; `None` for main.rs and lib.rs, which hold nothing but the list of the modules.
fn module_of(file: &str) -> Option<&str> {
    let inside = file.strip_prefix("src/")?;
    let module = inside.split('/').next()?.trim_end_matches(".rs");
    (module != "main" && module != "lib").then_some(module)
}

/// The path of a source file's module below the crate: `["stage", "screen"]` of src/stage/screen.rs.
fn module_path(file: &str) -> Vec<String> {
    let parts = file.trim_end_matches(".rs").split('/').skip(1);
    let mut path: Vec<String> = parts.map(str::to_owned).collect();
    if path.last().is_some_and(|last| last == "mod") {
        path.pop();
    }
    if path == ["lib"] || path == ["main"] { Vec::new() } else { path }
}

/// The text without comments and without its module of tests, which may look anywhere.
fn code(text: &str) -> String {
    let lines = text.lines().take_while(|line| !line.starts_with("mod tests {"));
    lines.map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// `a::b` and `a::c` of `a::{b, c}`, at any depth and without `as`.
fn expanded(tree: &str) -> Vec<String> {
    let tree = tree.trim();
    let Some((prefix, list)) = tree.split_once('{') else {
        return vec![tree.split(" as ").next().unwrap_or(tree).trim().to_owned()];
    };
    let list = list.trim_end().strip_suffix('}').unwrap_or(list);
    let (mut depth, mut start, mut paths) = (0, 0, Vec::new());
    for (at, c) in list.char_indices().chain([(list.len(), ',')]) {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            let item = list[start..at].trim();
            start = (at + 1).min(list.len());
            if !item.is_empty() {
                paths.extend(expanded(item).into_iter().map(|path| format!("{}{path}", prefix.trim())));
            }
        }
    }
    paths
}

/// All paths that a source text names, in `use` and elsewhere, from the crate on: `["mesh", "TetMesh"]`.
fn named_paths(module: &[String], children: &BTreeSet<String>, text: &str) -> Vec<Vec<String>> {
    let text = code(text);
    let mut written = Vec::new();
    let mut elsewhere = String::new();
    let mut rest = text.as_str();
    while let Some(at) = rest.find("use ") {
        let is_word = rest[..at].chars().next_back().is_none_or(|c| c.is_whitespace() || c == ')');
        let end = rest[at..].find(';').map_or(rest.len(), |end| at + end);
        if is_word {
            written.extend(expanded(&rest[at + "use ".len()..end]));
            elsewhere += &rest[..at];
        } else {
            elsewhere += &rest[..end];
        }
        rest = &rest[end..];
    }
    elsewhere += rest;
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    written.extend(elsewhere.split(|c| !is_path(c)).filter(|word| word.contains("::")).map(str::to_owned));
    let absolute = |path: String| {
        let mut names = path.split("::").map(|name| name.trim().to_owned()).peekable();
        let mut from = module.to_vec();
        match names.peek()?.as_str() {
            "crate" => from.clear(),
            "self" | "super" => {}
            child if children.contains(child) => {}
            _ => return None,
        }
        while let Some(word) = names.next_if(|name| ["crate", "self", "super"].contains(&name.as_str())) {
            if word == "super" {
                from.pop();
            }
        }
        from.extend(names);
        Some(from)
    };
    written.into_iter().filter_map(absolute).collect()
}

/// Each source file with the paths that it names.
fn sources() -> Vec<(String, Vec<Vec<String>>)> {
    let files = files("src", "rs");
    let modules: BTreeSet<Vec<String>> = files.iter().map(|(file, _)| module_path(file)).collect();
    files
        .into_iter()
        .filter(|(file, _)| !file.ends_with("/tests.rs") && !file.contains("/tests/"))
        .map(|(file, text)| {
            let own = module_path(&file);
            let is_child = |path: &&Vec<String>| path.len() == own.len() + 1 && path.starts_with(&own);
            let children = modules.iter().filter(is_child).filter_map(|path| path.last().cloned()).collect();
            let named = named_paths(&own, &children, &text);
            (file, named)
        })
        .collect()
}

#[test]
fn imports_are_found_however_they_are_written() {
    let found = |module: &str, text: &str| -> Vec<String> {
        let module: Vec<String> = module.split('/').map(str::to_owned).collect();
        let children = BTreeSet::from(["child".to_owned()]);
        named_paths(&module, &children, text).into_iter().map(|path| path.join("::")).collect()
    };
    assert_eq!(found("a/b", "use crate::mesh::{self, Fault};"), ["mesh::self", "mesh::Fault"]);
    assert_eq!(
        found("a/b", "use crate::{fem, mesh::{x, y as z},\n    stage::Eye,\n};"),
        ["fem", "mesh::x", "mesh::y", "stage::Eye"]
    );
    assert_eq!(found("a/b", "let x = crate::scene::Scene::load();"), ["scene::Scene::load"]);
    assert_eq!(found("a/b", "use super::super::render::Gpu; // use crate::no;"), ["render::Gpu"]);
    assert_eq!(found("a/b/c", "pub(super) use super::own::Gpu; use wgpu_crate::x;"), ["a::b::own::Gpu"]);
    assert_eq!(
        found("a", "pub use child::{X, Y}; child::run()"),
        ["a::child::X", "a::child::Y", "a::child::run"]
    );
}

#[test]
fn modules_import_only_what_the_house_allows() {
    let mut faults = Vec::new();
    let sources = sources();
    let rooms: BTreeSet<&str> = sources.iter().filter_map(|(file, _)| module_of(file)).collect();
    for (file, named) in &sources {
        let Some(room) = module_of(file) else { continue };
        let Some((_, allowed)) = IMPORTS.iter().find(|(name, _)| *name == room) else {
            faults.push(format!("{file}: the module {room} has no row in the table of imports"));
            continue;
        };
        let imports: BTreeSet<&str> = named.iter().filter_map(|path| Some(path.first()?.as_str())).collect();
        for import in imports {
            if import != room && import != "base" && !rooms_of(allowed).any(|known| known == import) {
                faults.push(format!("{file}: {room} must not import {import}"));
            }
        }
    }
    assert!(rooms.len() >= 13, "sources were read: {rooms:?}");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The files that each source file imports, by the deepest module that a path names.
fn imported_files() -> BTreeMap<String, BTreeSet<String>> {
    let sources = sources();
    let modules: BTreeMap<Vec<String>, String> = sources
        .iter()
        .filter(|(file, _)| module_of(file).is_some())
        .map(|(file, _)| (module_path(file), file.clone()))
        .collect();
    let deepest =
        |path: &Vec<String>| (1..=path.len()).rev().find_map(|length| modules.get(&path[..length])).cloned();
    modules
        .values()
        .filter_map(|file| {
            let (_, named) = sources.iter().find(|(other, _)| other == file)?;
            let imports = named.iter().filter_map(deepest).filter(|import| import != file).collect();
            Some((file.clone(), imports))
        })
        .collect()
}

/// The files that can be reached from each file.
fn reached(imports: &BTreeMap<String, BTreeSet<String>>) -> BTreeMap<&str, BTreeSet<&str>> {
    let from = |start: &str| {
        let mut found = BTreeSet::new();
        let mut open = vec![start];
        while let Some(next) = open.pop() {
            let new = imports.get(next).into_iter().flatten().map(String::as_str);
            open.extend(new.filter(|import| found.insert(*import)).collect::<Vec<_>>());
        }
        found
    };
    imports.keys().map(|file| (file.as_str(), from(file))).collect()
}

/// Neither directly nor by a longer way, a parent and its child included: what children share stands in a leaf.
#[test]
fn no_two_files_import_each_other() {
    let imports = imported_files();
    assert!(imports.values().map(BTreeSet::len).sum::<usize>() > 500, "imports were found");
    let reached = reached(&imports);
    let mut told = BTreeSet::new();
    let mut circles = Vec::new();
    for (&file, from) in reached.iter().filter(|(file, from)| from.contains(*file)) {
        if told.contains(file) {
            continue;
        }
        let is_back =
            |other: &&&str| **other != file && reached.get(**other).is_some_and(|to| to.contains(file));
        let with: Vec<&str> = from.iter().filter(is_back).copied().collect();
        if !with.is_empty() {
            circles.push(format!("{file} with {}", with.len()));
            circles.extend(with.iter().map(|other| format!("    {other}")));
            told.extend(with);
        }
    }
    assert!(circles.is_empty(), "files import in circles:\n{}", circles.join("\n"));
}

/// Nobody can import in a circle: in the table everything stands behind what it imports.
#[test]
fn the_table_of_imports_has_no_circle() {
    for (row, (module, allowed)) in IMPORTS.iter().enumerate() {
        for import in rooms_of(allowed) {
            let at = IMPORTS.iter().position(|(name, _)| *name == import);
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

/// Strings that are an effect's or a model's name and are not found in a list, with the reason. `*` stands for all names.
const NAMED: &[(&str, &str, &str)] = &[
    ("src/scene/mod.rs", "linear", "the model of a body that asks for none"),
    ("src/scene/proposal/choice.rs", "*", "what a proposed scene lists by default"),
    ("src/demo/chapters.rs", "ghost_equilibrium", "what a chapter of the demo lists"),
    ("src/cli/check.rs", "expected_errors", "a key of the JSON that it prints"),
    ("src/verify/studies.rs", "haptics", "the mark of its table in the manual"),
    ("src/green/families/perturbation.rs", "perturbation", "a family of columns"),
    ("src/green/families/reduced.rs", "reduced", "a family of columns"),
    ("src/green/families/reduced.rs", "reduced_neo_hookean", "a family of columns"),
    ("src/export/basis/gltf.rs", "rotation", "a key of glTF"),
    ("src/report/files.rs", "rotation", "a column of a table: an angle"),
    ("src/stage/file/mount.rs", "rotation", "a key of a stage: an angle"),
    ("src/track/osc.rs", "rotation", "a part of an address"),
    ("src/track/script.rs", "rotation", "a key of a script: an angle"),
    ("src/verify/large_rotation.rs", "plate", "a body that is held"),
    ("src/verify/truth/bodies.rs", "*", "the models that random bodies have in turn"),
];

/// A scene's names are looked up once: code that asks for an effect or a model by its name knows what the entry should say.
#[test]
fn no_effect_and_no_model_is_named_outside_its_own_room() {
    let effects: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).collect();
    let models: Vec<&str> = MODELS.iter().map(|model| model.name).collect();
    let is_own = |file: &str, name: &str| match effects.contains(&name) {
        true => file.starts_with("src/effect/"),
        false => ["src/deform/", "src/fem/"].iter().any(|room| file.starts_with(room)),
    };
    let is_test = |file: &str| file.ends_with("tests.rs") || file.contains("/tests/");
    let (mut faults, mut met) = (Vec::new(), BTreeSet::new());
    for (file, text) in files("src", "rs").iter().filter(|(file, _)| !is_test(file)) {
        let text = code(text);
        for &name in effects.iter().chain(&models).filter(|name| !is_own(file, name)) {
            let literal = format!("\"{name}\"");
            let is_whole = |(at, _): (usize, &str)| !text[..at].ends_with('\\');
            if !text.match_indices(&literal).any(is_whole) {
                continue;
            }
            match NAMED.iter().find(|(known, word, _)| known == file && ["*", name].contains(word)) {
                Some(row) => drop(met.insert(row)),
                None => faults.push(format!("{file} names \"{name}\"")),
            }
        }
        let looks_up = ["find_model(", "find_effect("].iter().any(|word| text.contains(word));
        let may = [
            "src/deform/models/mod.rs",
            "src/effect/effects.rs",
            "src/effect/resolved.rs",
            "src/cli/new.rs",
            "src/cli/parsers.rs",
        ];
        if looks_up && !may.contains(&file.as_str()) {
            faults.push(format!("{file} looks up a name: take it from `Resolved`"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    let unmet: Vec<_> = NAMED.iter().filter(|row| !met.contains(row)).collect();
    assert!(unmet.is_empty(), "rows that excuse nothing: {unmet:?}");
}

/// A file that a reader opens by itself would be in no fingerprint: `mesh::mod` reads the files that a format names.
#[test]
fn readers_of_meshes_open_no_file_themselves() {
    let opens = |text: &str| ["fs::", "File::"].iter().any(|word| text.contains(word));
    let source = |text: &str| text.split("#[cfg(test)]").next().unwrap_or_default().to_owned();
    let opening: Vec<String> = files("src/mesh", "rs")
        .into_iter()
        .filter(|(_, text)| opens(&source(text)))
        .map(|(file, _)| file)
        .collect();
    assert!(opening.iter().all(|file| file == "src/mesh/mod.rs"), "{opening:?}");
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

#[test]
fn shaders_name_twins_that_are_there() {
    let missing: Vec<String> = files("shaders", "wgsl")
        .iter()
        .flat_map(|(shader, text)| text.split_whitespace().map(move |word| (shader, word)))
        .filter_map(|(shader, word)| Some((shader, &word[word.find("src/")?..])))
        .map(|(shader, path)| (shader, path.trim_end_matches(|c: char| !c.is_alphanumeric())))
        .filter(|(_, path)| !root().join(path).exists())
        .map(|(shader, path)| format!("{shader} names {path}"))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
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
        (own && !file.ends_with("tests.rs") && !file.contains("/tests/") && file != "src/base/diagnostic.rs")
            .then_some(file)
    };
    let faults: Vec<String> = files("src", "rs").into_iter().filter_map(ours).collect();
    assert!(faults.is_empty(), "{faults:?} should write `notice!` of base::diagnostic");
}

/// A sentence that goes on in the next line without a backslash has the indentation of that line in its middle. Texts with line
/// breaks of their own are laid out by hand.
#[test]
fn sentences_have_no_gaps() {
    let gap = " ".repeat(8);
    let mut found = Vec::new();
    for (file, text) in files("src", "rs") {
        let is_sentence = |line: &str| !line.trim_start().starts_with("//") && !line.contains("\\n");
        for (number, line) in text.lines().enumerate().filter(|(_, line)| is_sentence(line)) {
            let is_quoted = |before: &str| before.replace("\\\"", "").matches('"').count() % 2 == 1;
            let is_gap = |(at, _): (usize, &str)| {
                let (before, after) = (&line[..at], line[at..].trim_start());
                is_quoted(before)
                    && before.ends_with(|c: char| !c.is_whitespace() && c != '"')
                    && !after.is_empty()
            };
            if line.match_indices(&gap).any(is_gap) {
                found.push(format!("{file}:{}: {}", number + 1, line.trim()));
            }
        }
    }
    assert!(found.is_empty(), "{found:#?}");
}
