//! Writes a scene as a person would: keys in their usual order, what is at its default left out, comments in a column.
//!
//! In: a [`Scene`] and [`Comments`]. Out: TOML that [`Scene::parse`] reads back as the same scene.

use super::{Body, Material, Scene, SceneError, Tool};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};

/// Comments on keys: by "stage", "body.NAME.material", "body.NAME.control.NAME.grab"; under "" the head of the file, under
/// "body.NAME" or "body.NAME.control.NAME" the lines over its table. Without `#`, on one line.
pub type Comments = BTreeMap<String, String>;

/// Widest line.
const WIDTH: usize = 120;
/// A comment stands behind lines up to this length, and over longer ones.
const BEHIND: usize = 72;
/// A list of more numbers than this is written over several lines.
const LONG: usize = 12;
/// Keys that are written though they have their default: what one changes first.
const ALWAYS: [&str; 2] = ["model", "effects"];

/// The text of a scene file.
pub fn text(scene: &Scene, comments: &Comments) -> Result<String, SceneError> {
    let mut text = String::new();
    if let Some(head) = comments.get("") {
        wrap(&mut text, head);
        text.push('\n');
    }
    let mut block = Block::new(comments, "");
    for (key, value) in entries(scene, scene)? {
        if key != "body" && key != "tool" {
            block.line(&key, &value);
        }
    }
    block.end(&mut text);
    for (name, tool) in &scene.tool {
        let plain = format!("tool.{name}");
        table(&mut text, comments, &plain, &format!("tool.{}", quoted_key(name)));
        let mut block = Block::new(comments, &format!("{plain}."));
        let usual = entries(scene, &Tool::new(tool.shape.clone()))?;
        for (key, value) in entries(scene, tool)? {
            if key == "shape" || usual.get(&key) != Some(&value) {
                block.line(&key, &value);
            }
        }
        block.end(&mut text);
    }
    for (name, body) in &scene.body {
        let mut body = body.as_written();
        body.forget_added();
        let body = &body;
        let path = format!("body.{}", quoted_key(name));
        table(&mut text, comments, &format!("body.{name}"), &path);
        let mut block = Block::new(comments, &format!("body.{name}."));
        let usual = usual(scene)?;
        for (key, value) in entries(scene, body)? {
            let is_usual = usual.get(&key) == Some(&value) && !ALWAYS.contains(&key.as_str());
            match key.as_str() {
                _ if is_usual => {}
                "control" => {}
                "material" => block.line(&key, &material(scene, &body.material)?),
                "region" => {
                    for (region, of_region) in &body.region {
                        block.line(&format!("region.{}", quoted_key(region)), &material(scene, of_region)?);
                    }
                }
                _ => block.line(&key, &value),
            }
        }
        block.end(&mut text);
        for (control_name, control) in &body.control {
            let plain = format!("body.{name}.control.{control_name}");
            table(&mut text, comments, &plain, &format!("{path}.control.{}", quoted_key(control_name)));
            let mut block = Block::new(comments, &format!("{plain}."));
            for (key, value) in entries(scene, control)? {
                block.line(&key, &value);
            }
            block.end(&mut text);
        }
    }
    Ok(text)
}

/// The keys and values of a part of the scene, in the order of its fields.
fn entries(scene: &Scene, part: &impl Serialize) -> Result<Table, SceneError> {
    Table::try_from(part)
        .map_err(|error| scene.invalid("scene", format!("cannot be written as TOML: {error}")))
}

/// A body of which nothing but the required keys is written.
fn usual(scene: &Scene) -> Result<Table, SceneError> {
    const LEAST: &str = "[body.a]\nmesh = \"a\"\nmaterial = { young = 1.0, poisson = 0.0 }\n\
                         [body.a.control.a]\nnodes = { group = \"a\" }\ngrab = \"fixed\"\n";
    let least = Scene::parse(LEAST, Path::new(""))?;
    let body: &Body = &least.body["a"];
    let mut table = entries(scene, body)?;
    for required in ["mesh", "material"] {
        table.remove(required);
    }
    Ok(table)
}

/// A material by its name in the library where it has one, with the numbers that differ from the library's.
fn material(scene: &Scene, material: &Material) -> Result<Value, SceneError> {
    let table = entries(scene, material)?;
    let Some(known) = material.known else { return Ok(Value::Table(table)) };
    let own = entries(scene, &Material::from(known))?;
    let mut written = Table::from_iter([("name".to_owned(), Value::from(known.name))]);
    written.extend(table.into_iter().filter(|(key, value)| own.get(key) != Some(value)));
    Ok(if written.len() == 1 { Value::from(known.name) } else { Value::Table(written) })
}

fn table(text: &mut String, comments: &Comments, plain: &str, path: &str) {
    text.push('\n');
    if let Some(comment) = comments.get(plain) {
        wrap(text, comment);
    }
    text.push_str(&format!("[{path}]\n"));
}

/// Lines up to the next table, whose comments begin in one column.
struct Block<'a> {
    comments: &'a Comments,
    prefix: String,
    lines: Vec<(String, Option<&'a String>)>,
}

impl<'a> Block<'a> {
    fn new(comments: &'a Comments, prefix: &str) -> Block<'a> {
        Block { comments, prefix: prefix.to_owned(), lines: Vec::new() }
    }

    fn line(&mut self, key: &str, value: &Value) {
        let comment = self.comments.get(&format!("{}{key}", self.prefix));
        self.lines.push((format!("{key} = {}", inline(value)), comment));
    }

    fn end(self, text: &mut String) {
        let width = |line: &str| line.chars().count();
        let commented = self.lines.iter().filter(|(_, comment)| comment.is_some());
        let widths = commented.map(|(line, _)| width(line)).filter(|&width| width <= BEHIND);
        let column = widths.max().unwrap_or(0) + 2;
        for (line, comment) in self.lines {
            match comment {
                Some(comment) if width(&line) < column && column + 2 + width(comment) <= WIDTH => {
                    text.push_str(&format!("{line:<column$}# {comment}\n"));
                }
                comment => {
                    if let Some(comment) = comment {
                        wrap(text, comment);
                    }
                    text.push_str(&line);
                    text.push('\n');
                }
            }
        }
    }
}

/// Writes a comment that does not share its lines, over as many as it needs.
fn wrap(text: &mut String, comment: &str) {
    text.push('#');
    let mut length = 1;
    for word in comment.split_whitespace() {
        let word_length = word.chars().count();
        if length > 1 && length + 1 + word_length > WIDTH {
            text.push_str("\n#");
            length = 1;
        }
        text.push(' ');
        text.push_str(word);
        length += 1 + word_length;
    }
    text.push('\n');
}

fn inline(value: &Value) -> String {
    match value {
        Value::Float(number) => float(*number),
        Value::Array(values) if values.len() > LONG && values.iter().all(Value::is_integer) => tags(values),
        Value::String(text) => string(text),
        Value::Array(values) => format!("[{}]", values.iter().map(inline).collect::<Vec<_>>().join(", ")),
        Value::Table(table) => {
            let entry = |(key, value): (&String, &Value)| format!("{} = {}", quoted_key(key), inline(value));
            format!("{{ {} }}", table.iter().map(entry).collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}

/// A long list of whole numbers, over several lines.
fn tags(values: &[Value]) -> String {
    let mut lines = vec![String::new()];
    for value in values {
        let word = format!("{value}, ");
        if lines.last().is_some_and(|line| line.len() + word.len() > WIDTH - 4) {
            lines.push(String::new());
        }
        lines.last_mut().into_iter().for_each(|line| line.push_str(&word));
    }
    let lines: String = lines.iter().map(|line| format!("    {}\n", line.trim_end())).collect();
    format!("[\n{lines}]")
}

/// The shortest text of the same number: 0.07, 250.0, 2.1e11.
fn float(number: f64) -> String {
    let size = number.abs();
    if size == 0.0 || (1e-4..1e5).contains(&size) {
        return format!("{number:?}");
    }
    let text = format!("{number:e}");
    match text.split_once('e') {
        Some((digits, power)) if !digits.contains('.') => format!("{digits}.0e{power}"),
        _ => text.to_lowercase(),
    }
}

/// A key as TOML writes it: bare where it may be.
pub fn quoted_key(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    match !key.is_empty() && key.chars().all(is_bare) {
        true => key.to_owned(),
        false => string(key),
    }
}

/// Writes text on one line, between quotation marks.
fn string(text: &str) -> String {
    let escaped = text.chars().map(|c| match c {
        '"' | '\\' => format!("\\{c}"),
        c if c.is_control() => format!("\\u{:04x}", u32::from(c)),
        c => c.to_string(),
    });
    format!("\"{}\"", escaped.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"# Two bodies.

stage = "workbench"

[body.part]
mesh = "part.stl"
unit = "mm"                        # as CAD writes it
tetrahedralise = { cell = 0.0042 } # about 15000 nodes
material = "liver"
region.core = { name = "bone", young = 1.2e10 }
region."outer shell" = { young = 2.0e11, poisson = 0.3 }
model = "rotation"
effects = []
place = { position = [0.0, 1.15, 0.55], rotation = [0.0, 0.0, 0.0], scale = 0.5 }

# What the hand takes.
[body.part.control.tip]
nodes = { sphere = { centre = [0.5, 0.0, 1.0e-7], radius = 0.1 } }
grab = "dragger"                   # with the stylus

[body."a bar"]
generate = { block = { size = [1.0, 0.2, 0.2], cells = [10, 2, 2] } }
refine = 1
material = { young = 1.0e6, poisson = 0.3, density = 920.0 }
model = "linear"
effects = ["haptics"]
solver = { method = "pcg", tolerance = 1.0e-8, max_iterations = 1000 }

[body."a bar".control.low]
nodes = { group = "xmin" }
grab = "fixed"
"#;

    #[test]
    fn a_scene_is_written_as_it_was() {
        let scene = Scene::parse(SCENE, Path::new("scene.toml")).unwrap();
        let comments: Comments = [
            ("", "Two bodies."),
            ("body.part.unit", "as CAD writes it"),
            ("body.part.tetrahedralise", "about 15000 nodes"),
            ("body.part.control.tip", "What the hand takes."),
            ("body.part.control.tip.grab", "with the stylus"),
        ]
        .map(|(key, comment)| (key.to_owned(), comment.to_owned()))
        .into();
        let written = text(&scene, &comments).unwrap();
        // The column is that of each table's own longest commented line.
        let spaces = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(spaces(&written), spaces(SCENE), "{written}");
        assert!(written.contains("cell = 0.0042 }  # about"), "{written}");
        assert!(written.contains(&format!("unit = \"mm\"{}# as CAD", " ".repeat(25))), "{written}");
        assert_eq!(Scene::parse(&written, Path::new("scene.toml")).unwrap(), scene);
    }

    #[test]
    fn long_comments_stand_over_their_line_and_are_wrapped() {
        let mut scene = Scene::parse(SCENE, Path::new("scene.toml")).unwrap();
        scene.body.truncate(1);
        let long = "word ".repeat(40);
        let comments =
            Comments::from([("body.part.material".to_owned(), long), ("".to_owned(), "any ".repeat(60))]);
        let written = text(&scene, &comments).unwrap();
        assert!(written.lines().all(|line| line.chars().count() <= WIDTH), "{written}");
        assert_eq!(written.matches("word").count(), 40);
        assert!(written.contains("word\nmaterial = \"liver\"\n"), "{written}");
        // A line that is full to the last column.
        let mut full = String::new();
        wrap(&mut full, &format!("{} more", "x".repeat(WIDTH - 2)));
        assert_eq!(full, format!("# {}\n# more\n", "x".repeat(WIDTH - 2)));
        assert_eq!(Scene::parse(&written, Path::new("scene.toml")).unwrap(), scene);
    }

    proptest::proptest! {
        #[test]
        fn numbers_and_keys_come_back(number in proptest::num::f64::NORMAL, key in ".{1,12}") {
            let line = format!("{} = {}", quoted_key(&key), float(number));
            let table: Table = toml::from_str(&line).unwrap();
            proptest::prop_assert_eq!(table.get(&key).and_then(Value::as_float), Some(number), "{}", line);
        }
    }
}
