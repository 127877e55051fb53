//! `greenstage manual`: prints the manual's chapters, which stand in `src/manual`, and searches them.

use super::print::print;
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::config::unknown_name;
use crate::manual::{self, Chapter, GUIDE, REFERENCE};

/// Print the manual: how to use greenstage, install it on a display, and read its figures
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Chapter to print; any other word is searched in all chapters. Without one, the chapters are listed
    pub chapter: Option<String>,
    /// Words to search for in this chapter
    pub words: Vec<String>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    print(&answer(args.chapter.as_deref(), &args.words.join(" "))?)
}

fn answer(name: Option<&str>, words: &str) -> Result<String, Failure> {
    let Some(name) = name else { return Ok(contents()) };
    match manual::find(name) {
        Some(chapter) if words.is_empty() => Ok(chapter.text.to_owned()),
        Some(chapter) => {
            let hits = hits([chapter], words);
            if hits.is_empty() {
                return Err(Failure::wrong(format!("chapter {name} does not contain \"{words}\"")));
            }
            Ok(listing(&hits))
        }
        None => {
            let words = format!("{name} {words}");
            let hits = hits(manual::chapters(), words.trim());
            if hits.is_empty() {
                let names = manual::chapters().map(|chapter| chapter.name);
                let unknown = unknown_name("chapter", name, names);
                return Err(Failure::wrong(format!("{unknown}; no chapter contains \"{}\"", words.trim())));
            }
            Ok(listing(&hits))
        }
    }
}

fn contents() -> String {
    let part = |title: &str, chapters: &[Chapter]| {
        let mut table = Table::new(&[title, "what it explains"]);
        for chapter in chapters {
            table.row(&[chapter.name, chapter.summary]);
        }
        table.text()
    };
    format!(
        "{}\n{}\n`greenstage manual CHAPTER` prints one; `manual WORD` searches all, `manual CHAPTER \
         WORD` one.\n",
        part("guide", GUIDE),
        part("reference", REFERENCE)
    )
}

/// A line that contains the words searched for.
#[derive(Debug)]
struct Hit {
    chapter: &'static str,
    heading: &'static str,
    /// The line with the words; of a hit in a heading the first line of text below it.
    excerpt: String,
}

/// Hits shown at most: with the heading of the table and the count of the rest they fill a screen of 24 lines.
const SHOWN_HITS: usize = 20;
/// Width of an excerpt, characters.
const EXCERPT: usize = 64;
const HEADING: usize = 28;

/// Every line of the chapters that contains the words, whatever their case: headings first.
fn hits(chapters: impl IntoIterator<Item = &'static Chapter>, words: &str) -> Vec<Hit> {
    let words = folded(words);
    let (mut headings, mut lines) = (Vec::new(), Vec::new());
    for chapter in chapters {
        let (mut heading, mut is_code) = ("", false);
        let mut rest = chapter.text.lines();
        while let Some(line) = rest.next() {
            is_code ^= line.trim_start().starts_with("```");
            let is_heading = !is_code && line.starts_with('#');
            if is_heading {
                heading = line.trim_start_matches('#').trim();
            }
            let Some(place) = place(&folded(line), &words) else { continue };
            let below = || rest.clone().find(|line| !line.trim().is_empty()).unwrap_or_default();
            let (list, excerpt) = if is_heading {
                (&mut headings, excerpt(below(), 0))
            } else {
                (&mut lines, excerpt(line, place))
            };
            list.push(Hit { chapter: chapter.name, heading, excerpt });
        }
    }
    headings.append(&mut lines);
    headings
}

fn folded(text: &str) -> Vec<char> {
    text.chars().map(|c| c.to_lowercase().next().unwrap_or(c)).collect()
}

fn place(line: &[char], words: &[char]) -> Option<usize> {
    line.windows(words.len().max(1)).position(|window| window == words)
}

/// The part of a line around one of its characters that fits beside chapter and heading.
fn excerpt(line: &str, place: usize) -> String {
    let start = place.saturating_sub(EXCERPT / 2).min(line.chars().count().saturating_sub(EXCERPT));
    let part = clipped(line.chars().skip(start).collect::<String>().trim(), EXCERPT);
    if start > 0 { format!("…{part}") } else { part }
}

fn clipped(text: &str, width: usize) -> String {
    match text.char_indices().nth(width) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn listing(hits: &[Hit]) -> String {
    let mut table = Table::new(&["chapter", "heading", "line"]);
    for hit in hits.iter().take(SHOWN_HITS) {
        table.row(&[hit.chapter, &clipped(hit.heading, HEADING), &hit.excerpt]);
    }
    match hits.len().saturating_sub(SHOWN_HITS) {
        0 => table.text(),
        more => format!(
            "{}and {more} more; `greenstage manual CHAPTER WORD` searches one chapter\n",
            table.text()
        ),
    }
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
        manual::chapters().flat_map(|chapter| blocks(chapter.text)).chain(blocks(readme)).collect()
    }

    #[test]
    fn every_chapter_prints_and_is_listed() {
        let mut names = Vec::new();
        for chapter in manual::chapters() {
            assert_eq!(answer(Some(chapter.name), "").unwrap(), chapter.text);
            let begin = format!("# {}: ", chapter.name);
            assert!(chapter.text.starts_with(&begin), "{} begins with its name", chapter.name);
            assert!(contents().contains(chapter.summary));
            assert!(!names.contains(&chapter.name), "{} stands in both parts", chapter.name);
            names.push(chapter.name);
        }
    }

    #[test]
    fn every_file_of_the_manual_is_a_chapter() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/manual");
        let count = |folder: &Path| {
            let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
            names.filter(|name| Path::new(name).extension().is_some_and(|end| end == "md")).count()
        };
        assert_eq!((count(&folder), count(&folder.join("reference"))), (GUIDE.len(), REFERENCE.len()));
    }

    #[test]
    fn the_guide_and_its_chapters_are_short() {
        let words = |chapter: &Chapter| chapter.text.split_whitespace().count();
        for chapter in GUIDE {
            assert!(words(chapter) <= 3000, "{} has {} words", chapter.name, words(chapter));
        }
        assert!(GUIDE.iter().map(words).sum::<usize>() <= 25_000);
    }

    #[test]
    fn a_word_that_is_no_chapter_is_searched_in_all() {
        let found = answer(Some("STYLUS"), "").unwrap();
        let lines: Vec<&str> = found.lines().collect();
        assert_eq!(lines.len(), 2 + SHOWN_HITS + 1, "{found}");
        assert!(lines.iter().all(|line| line.chars().count() < 120), "{found}");
        assert!(
            lines[2 + SHOWN_HITS].starts_with("and ") && lines[2 + SHOWN_HITS].contains(" more;"),
            "{found}"
        );
        let all = hits(manual::chapters(), "stylus");
        let is_heading = |hit: &Hit| hit.heading.to_lowercase().contains("stylus");
        let headings = manual::chapters().flat_map(|chapter| chapter.text.lines());
        let headings =
            headings.filter(|line| line.starts_with('#') && line.to_lowercase().contains("stylus"));
        assert!(
            all.iter().take_while(|hit| is_heading(hit)).count() >= headings.count(),
            "headings come first"
        );
        let all = answer(Some("off-axis"), "projection").unwrap();
        assert!(all.contains("drawing") && !all.contains("more;"), "{all}");
    }

    #[test]
    fn a_word_is_searched_in_one_chapter() {
        let found = answer(Some("scene"), "poisson").unwrap();
        assert!(
            found.lines().skip(2).all(|line| line.starts_with("scene ") || line.starts_with("and ")),
            "{found}"
        );
        let error = answer(Some("scene"), "walrus").unwrap_err();
        assert_eq!(error.status(), 2);
        assert_eq!(error.to_string(), "chapter scene does not contain \"walrus\"");
    }

    #[test]
    fn a_word_without_a_hit_is_answered_with_the_nearest_chapter() {
        let error = answer(Some("materiel"), "").unwrap_err();
        assert_eq!(error.status(), 2);
        let error = error.to_string();
        assert!(error.contains("did you mean \"materials\"?; no chapter contains \"materiel\""), "{error}");
    }

    /// Messages, help, scenes and chapters name a chapter as `greenstage manual NAME`.
    #[test]
    fn every_pointer_names_a_chapter() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut folders: Vec<_> = ["src", "configs", "scripts"].map(|name| root.join(name)).into();
        let mut texts = vec![std::fs::read_to_string(root.join("README.md")).unwrap()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                if entry.is_dir() {
                    folders.push(entry);
                } else if !entry.ends_with("cli/manual.rs") {
                    texts.extend(std::fs::read_to_string(entry));
                }
            }
        }
        let mut count = 0;
        for text in &texts {
            // A line of a comment or of a message may end between the words.
            let text = text.split([' ', '\n', '\\', '/', '#']).filter(|word| !word.is_empty());
            let words: Vec<&str> = text.collect();
            for three in
                words.windows(3).filter(|three| three[0].ends_with("`greenstage") && three[1] == "manual")
            {
                let name = three[2].split(|c: char| !c.is_ascii_lowercase()).next().unwrap();
                if !name.is_empty() {
                    assert!(manual::find(name).is_some(), "{three:?} names no chapter");
                    count += 1;
                }
            }
        }
        assert!(count > 30, "{count}");
    }

    /// Chapters name each other as "chapter `name`".
    #[test]
    fn every_chapter_that_a_chapter_names_exists() {
        for chapter in manual::chapters() {
            let words: Vec<&str> = chapter.text.split_whitespace().collect();
            for two in words.windows(2).filter(|two| two[0].trim_start_matches('(') == "chapter") {
                let Some(name) = two[1].strip_prefix('`').and_then(|rest| rest.split('`').next()) else {
                    continue;
                };
                assert!(manual::find(name).is_some(), "{} names the chapter {name}", chapter.name);
            }
        }
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
