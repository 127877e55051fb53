//! `greenstage manual`: prints the manual's chapters, which stand in `src/manual`.

use super::print::print;
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::config::unknown_name;
use crate::manual::CHAPTERS;

/// Print the manual: how to use greenstage, install it on a display, and read its figures
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Chapter to print; without one, the chapters are listed
    pub chapter: Option<String>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.chapter {
        Some(name) => print(chapter(name)?),
        None => print(&contents()),
    }
}

fn chapter(name: &str) -> Result<&'static str, Failure> {
    match CHAPTERS.iter().find(|(known, ..)| *known == name) {
        Some((.., text)) => Ok(text),
        None => Err(Failure::wrong(unknown_name("chapter", name, CHAPTERS.iter().map(|(known, ..)| *known)))),
    }
}

fn contents() -> String {
    let mut table = Table::new(&["chapter", "what it explains"]);
    for (name, summary, _) in CHAPTERS {
        table.row(&[name, summary]);
    }
    format!("{}\n`greenstage manual CHAPTER` prints one.\n", table.text())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::stage::Stage;
    use crate::track::Script;
    use clap::Parser;
    use std::path::Path;

    /// The code blocks of a Markdown text: what stands behind the fence, and the lines between, unindented.
    fn blocks(text: &str) -> Vec<(String, String)> {
        let mut found: Vec<(String, String)> = Vec::new();
        let mut is_open = false;
        for line in text.lines() {
            let inner = line.trim_start();
            if let Some(kind) = inner.strip_prefix("```") {
                if !is_open {
                    assert!(!kind.is_empty(), "a fence without a language would be a Rust test");
                    found.push((kind.to_owned(), String::new()));
                }
                is_open = !is_open;
            } else if let Some((_, block)) = found.last_mut().filter(|_| is_open) {
                block.push_str(inner);
                block.push('\n');
            }
        }
        assert!(!is_open, "a fence is not closed");
        found
    }

    fn all_blocks() -> Vec<(String, String)> {
        let readme = include_str!("../../README.md");
        CHAPTERS.iter().flat_map(|(.., text)| blocks(text)).chain(blocks(readme)).collect()
    }

    #[test]
    fn every_chapter_prints_and_is_listed() {
        for (name, summary, text) in CHAPTERS {
            assert_eq!(chapter(name).unwrap(), *text);
            assert!(text.starts_with(&format!("# {name}: ")), "{name} begins with its name");
            assert!(contents().contains(summary));
        }
        let error = chapter("scenes").unwrap_err();
        assert_eq!(error.status(), 2);
        assert!(error.to_string().contains("did you mean \"scene\"?"), "{error}");
    }

    #[test]
    fn every_whole_file_in_the_chapters_is_read() {
        let mut counts = [0; 5];
        for (kind, text) in all_blocks() {
            let path = Path::new("manual.toml");
            let (which, result) = match kind.as_str() {
                "toml,scene" => (0, Scene::parse(&text, path).map(drop).map_err(Failure::from)),
                "toml,stage" => (
                    1,
                    Stage::parse(&text, path)
                        .and_then(crate::track::checked)
                        .map(drop)
                        .map_err(Failure::request),
                ),
                "toml,script" => (2, Script::parse(&text, path).map(drop).map_err(Failure::request)),
                "toml,poses" => (3, crate::deform::pose_file::parse(&text, path).map(drop)),
                "toml,tracking" => {
                    let stage = format!("{}{text}", crate::stage::BUILT_IN[0].1);
                    (
                        4,
                        Stage::parse(&stage, path)
                            .and_then(crate::track::checked)
                            .map(drop)
                            .map_err(Failure::request),
                    )
                }
                "toml" => continue,
                other => {
                    assert!(["sh", "text", "python"].contains(&other), "unknown fence {other}");
                    continue;
                }
            };
            assert!(result.is_ok(), "{kind}: {}\n{text}", result.unwrap_err());
            counts[which] += 1;
        }
        assert!(counts.iter().all(|&count| count > 0), "{counts:?}");
    }

    /// Pieces of a scene: each key is put into a body in place of the same key, or into its control element.
    #[test]
    fn every_piece_of_a_scene_in_the_chapters_is_read() {
        let mut count = 0;
        for (_, text) in all_blocks().iter().filter(|(kind, _)| kind == "toml") {
            for line in text.lines().filter(|line| line.contains(" = ") && !line.starts_with('#')) {
                let key = line.split(['.', ' ']).next().unwrap();
                let or = |name: &str, usual: &str| if key == name { line } else { usual }.to_owned();
                let mesh = match key {
                    "generate" => line,
                    "tetrahedralise" => "mesh = \"part.stl\"",
                    "longest_edge" => "mesh = \"part.stl\"\nmethod = \"bem\"",
                    _ => "mesh = \"part.msh\"",
                };
                let slots = [
                    "mesh",
                    "generate",
                    "material",
                    "region",
                    "solver",
                    "tetrahedralise",
                    "accuracy",
                    "nodes",
                ];
                let other = if slots.contains(&key) { "" } else { line };
                let scene = format!(
                    "[body.part]\n{mesh}\n{}\n{}\n{}\n{}\n{}\n{}\n[body.part.control.c]\n{}\ngrab = \"fixed\"\n",
                    or("material", "material = { young = 1.0, poisson = 0.3, density = 1000.0 }"),
                    or("region", ""),
                    or("solver", ""),
                    or("tetrahedralise", ""),
                    or("accuracy", ""),
                    other,
                    or("nodes", "nodes = { group = \"left\" }"),
                );
                if key != "mesh" {
                    assert!(scene.contains(line), "no place for {line}");
                }
                let result = Scene::parse(&scene, Path::new("manual.toml"));
                assert!(result.is_ok(), "{}\n{scene}", result.unwrap_err());
                count += 1;
            }
        }
        assert!(count > 8, "{count}");
    }

    #[test]
    fn every_command_in_the_chapters_is_understood() {
        let mut count = 0;
        for (_, text) in all_blocks().iter().filter(|(kind, _)| kind == "sh") {
            for line in text.lines().filter(|line| line.starts_with("greenstage")) {
                let words = line.split('#').next().unwrap().split_whitespace();
                let parsed = super::super::Cli::try_parse_from(words);
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
                count += 1;
            }
        }
        assert!(count > 20, "{count}");
    }
}
