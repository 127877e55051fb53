//! Strict TOML: text in, a typed value out, or an error that names file, line, column and remedy.
//!
//! Every configuration struct of the program carries `#[serde(deny_unknown_fields)]`; an unknown key is
//! answered with the nearest known one. An array with an element too many is refused, too.

pub mod every;
pub mod foreign;
mod strict;

use crate::base::diagnostic::is_verbose;
use crate::base::failure::Failure;
use crate::base::input;
use serde::de::DeserializeOwned;
use std::io::Read;
use std::path::{Path, PathBuf};
use strict::Strict;
use toml::de::{DeTable, DeValue};

/// Why a configuration file was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(
        "{}: more than {} MiB, which no scene, stage, script or pose file needs: is it a mesh?", path.display(),
        LARGEST >> 20
    )]
    Large { path: PathBuf },
    #[error("{}:{line}:{column}: {message}", path.display())]
    Parse { path: PathBuf, line: usize, column: usize, message: String },
}

/// A larger file is refused unread: parsing takes up to 200 times its memory.
const LARGEST: u64 = 16 << 20;

pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    parse(&read(path)?, path)
}

pub fn read(path: &Path) -> Result<String, ConfigError> {
    let failed = |source| ConfigError::Read { path: path.to_owned(), source };
    let mut text = String::new();
    let file = input::open_any(path).map_err(failed)?;
    file.take(LARGEST + 1).read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > LARGEST {
        return Err(ConfigError::Large { path: path.to_owned() });
    }
    Ok(text)
}

/// Parses TOML `text`; `path` is only named in errors.
pub fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, ConfigError> {
    let parsed = toml::Deserializer::parse(text).and_then(|document| T::deserialize(Strict(document)));
    parsed.map_err(|error| told(&error, text, path))
}

/// Refuses a text that has one of the tables `others` and none of `own`: it is of another kind, and `message` says which.
pub fn refuse_other(
    text: &str,
    path: &Path,
    own: &str,
    others: [&str; 2],
    message: &str,
) -> Result<(), ConfigError> {
    let Ok(table) = text.parse::<toml::Table>() else { return Ok(()) };
    if table.contains_key(own) || !others.iter().any(|other| table.contains_key(*other)) {
        return Ok(());
    }
    Err(ConfigError::Parse { path: path.to_owned(), line: 1, column: 1, message: message.to_owned() })
}

/// An error of toml's with its place in the text.
fn told(error: &toml::de::Error, text: &str, path: &Path) -> ConfigError {
    let at = error.span().map_or(0, |span| span.start);
    let (line, column) = line_and_column(text, at);
    if text.parse::<toml::Table>().is_err()
        && let Some(message) = foreign::advice(text)
    {
        return ConfigError::Parse { path: path.to_owned(), line: 1, column: 1, message };
    }
    let advice = match error.message() {
        _ if has_decimal_comma(text, at) => "; a number is written with a point, as 0.063".to_owned(),
        "invalid type: map, expected a sequence" => several(text, at).unwrap_or_default(),
        _ => String::new(),
    };
    let message = explain(error.message()) + &advice;
    ConfigError::Parse { path: path.to_owned(), line, column, message }
}

/// Parses a value from a table that was parsed before; an error has no position.
pub fn from_table<T: DeserializeOwned>(table: &toml::Table) -> Result<T, String> {
    let parsed = T::deserialize(Strict(toml::Value::Table(table.clone())));
    parsed.map_err(|error: toml::de::Error| explain(error.message()))
}

/// The keys of a table of this type, from the answer to one that it cannot have.
pub fn keys<T: DeserializeOwned>() -> Vec<String> {
    let stranger = toml::Table::from_iter([(String::new(), toml::Value::Boolean(false))]);
    let answer = from_table::<T>(&stranger).err().unwrap_or_default();
    answer.split('`').skip(3).step_by(2).map(str::to_owned).collect()
}

/// 1-based line and column of a byte offset.
pub fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..offset.min(text.len())];
    let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
    let start = before.iter().rposition(|&byte| byte == b'\n').map_or(0, |i| i + 1);
    (line, before.len() - start + 1)
}

/// 1-based line of a key in a TOML text, named by its way, as `body.tube.material`; of the innermost table of that way where the key
/// itself is not written, `None` where nothing of it is.
pub fn line_of(text: &str, key: &str) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let (mut table, mut rest, mut line) = (document.get_ref(), key, None);
    loop {
        // A name may have points of its own.
        let fits = |name: &str| {
            let after = rest.strip_prefix(name)?;
            if after.is_empty() { Some(after) } else { after.strip_prefix('.') }
        };
        let keys = table.iter().filter_map(|(name, value)| Some((name, value, fits(name.get_ref())?)));
        let Some((name, value, after)) = keys.max_by_key(|(name, ..)| name.get_ref().len()) else {
            return line;
        };
        line = Some(line_and_column(text, name.span().start).0);
        match value.get_ref() {
            DeValue::Table(inner) => (table, rest) = (inner, after),
            _ => return line,
        }
    }
}

/// [`line_of`] a key in a file, as it is now; `None` of a pipe, which was read before.
pub fn line_in(path: &Path, key: &str) -> Option<usize> {
    input::regular(path).ok()?;
    line_of(&read(path).ok()?, key)
}

/// Advice for the heading `[key]` or `[key.name]` at which an error stands, where there can be several such tables.
fn several(text: &str, at: usize) -> Option<String> {
    let start = text.get(..at)?.rfind('\n').map_or(0, |end| end + 1);
    let (heading, _) = text.get(start..)?.trim_start().strip_prefix('[')?.split_once(']')?;
    let parts: Vec<&str> = heading.split('.').map(|part| part.trim().trim_matches(['"', '\''])).collect();
    let (kind, written) = match parts[..] {
        [key] => (key, format!("[[{key}]]")),
        // One table of several has several of another kind.
        [key, below] if text.contains(&format!("[[{key}]]")) => (below, format!("[[{key}.{below}]]")),
        [key, name] => (key, format!("[[{key}]], and below it name = \"{name}\"")),
        _ => return None,
    };
    Some(format!("; each {kind} is a table of its own: write {written}"))
}

/// Whether an error stands at the comma of `key = 0,063`.
fn has_decimal_comma(text: &str, at: usize) -> bool {
    let line = text.get(..at).and_then(|before| before.rsplit('\n').next()).unwrap_or_default();
    let rest = text.get(at..).and_then(|after| after.lines().next()).unwrap_or_default();
    let Some((_, value)) = line.rsplit_once('=') else { return false };
    let whole = value.trim_end_matches(',').trim();
    let rest = rest.trim_start_matches(',');
    !whole.is_empty()
        && whole.trim_start_matches(['-', '+']).chars().all(|c| c.is_ascii_digit())
        && rest.starts_with(|c: char| c.is_ascii_digit())
        && (value.ends_with(',') || text[at..].starts_with(','))
}

/// A list of known keys that is longer than these letters is left out beside the nearest of them, but for `--verbose`.
const LONG_LIST: usize = 120;

/// serde's messages as a user of TOML reads them: its names of types, and "did you mean" after an unknown key or value.
fn explain(message: &str) -> String {
    if let Some((found, expected)) =
        message.rsplit_once(", expected ").filter(|_| message.starts_with("invalid"))
    {
        return format!("{found}, expected {}", kind(expected));
    }
    if message.starts_with("wanted exactly 1 element") {
        return "this table takes exactly one of its keys".to_owned();
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let is_unknown = message.starts_with("unknown field") || message.starts_with("unknown variant");
    let Some(unknown) = quoted.next().filter(|_| is_unknown) else { return message.to_owned() };
    match nearest(unknown, quoted) {
        Some(known) => {
            let is_long = |(_, list): &(&str, &str)| list.len() > LONG_LIST && !is_verbose();
            let (what, _) = message.split_once(", expected ").filter(is_long).unwrap_or((message, ""));
            format!("{what}; did you mean `{known}`?")
        }
        None => message.to_owned(),
    }
}

/// The name in TOML of a type of Rust's.
fn kind(expected: &str) -> &str {
    match expected {
        "f64" | "f32" => "a number",
        "u8" => "a whole number from 0 to 255",
        "u16" | "u32" | "u64" | "usize" => "a whole number from 0",
        "i8" | "i16" | "i32" | "i64" => "a whole number",
        "a sequence" => "an array",
        "a map" => "a table",
        _ if expected.starts_with("struct ") => "a table",
        _ => expected,
    }
}

/// The candidate most like `word`, if any is similar enough to be a slip of the hand.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(word, candidate), candidate))
        .filter(|(score, candidate)| *score > 0.7 || is_one_letter_off(word, candidate))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

/// Whether two words, the longer of three letters or more, differ by one slip, which may hide their likeness: "tp" for "top".
fn is_one_letter_off(word: &str, candidate: &str) -> bool {
    let longer = word.chars().count().max(candidate.chars().count());
    longer > 2 && strsim::damerau_levenshtein(word, candidate) == 1
}

/// The error for a name that is in no list: the names that are known, and the nearest of them.
pub fn unknown_name<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let list: Vec<&str> = known.clone().collect();
    let advice = nearest(name, known).map(|like| format!("; did you mean \"{like}\"?")).unwrap_or_default();
    format!("unknown {kind} \"{name}\" (known: {}){advice}", list.join(", "))
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Failure {
        Failure::request(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Material {
        #[allow(dead_code, reason = "only parsed")]
        young: f64,
        #[allow(dead_code, reason = "only parsed")]
        poisson: f64,
    }

    #[test]
    fn unknown_key_names_line_and_nearest_key() {
        let error = parse::<Material>("young = 1.0\npoison = 0.3\n", Path::new("a.toml")).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("a.toml:2:1: unknown field `poison`"), "{text}");
        assert!(text.ends_with("did you mean `poisson`?"), "{text}");
    }

    #[test]
    fn a_key_is_found_on_its_line() {
        let text = "stage = \"desk\"\n\n[body.tube]\nmaterial = { young = 1.0,\n poisson = 0.3 }\ncontrol.left.grab = \"fixed\"\n\
                    [body.\"tube.old\"]\nmesh = \"a.stl\"\n[[screen]]\nname = \"left\"\n";
        for (key, line) in [
            ("stage", Some(1)),
            ("body.tube", Some(3)),
            ("body.tube.material.poisson", Some(5)),
            ("body.tube.control.left.nodes", Some(6)),
            ("body.tube.old.mesh", Some(8)),
            ("body.tube.older", Some(3)),
            ("body.none", Some(3)),
            ("screen.left", Some(9)),
            ("", None),
            ("a place", None),
        ] {
            assert_eq!(line_of(text, key), line, "{key}");
        }
        assert_eq!(line_of("= 3", "body"), None);
    }

    proptest::proptest! {
        #[test]
        fn no_text_and_no_key_makes_a_panic(text in ".{0,200}", lines in "(\\[[a.\"]{0,6}\\]\n|[ab.]{0,4} = [1{}\\[\\]]{0,4}\n){0,8}", key in "[ab.]{0,8}") {
            for text in [&text, &lines] {
                let line = line_of(text, &key);
                proptest::prop_assert!(line.is_none_or(|line| (1..=text.lines().count().max(1)).contains(&line)));
            }
        }
    }

    #[test]
    fn another_type_is_told_in_the_words_of_toml() {
        let told = |text: &str| parse::<Material>(text, Path::new("a.toml")).unwrap_err().to_string();
        let text = told("young = \"5 MPa\"\npoisson = 0.3\n");
        assert_eq!(text, "a.toml:1:9: invalid type: string \"5 MPa\", expected a number");
        #[derive(Debug, serde::Deserialize)]
        struct Body {
            #[allow(dead_code, reason = "only parsed")]
            material: Material,
        }
        let text = parse::<Body>("material = 3\n", Path::new("a.toml")).unwrap_err().to_string();
        assert_eq!(text, "a.toml:1:12: invalid type: integer `3`, expected a table");
    }

    #[test]
    fn one_table_where_there_can_be_several_is_told_with_the_heading_to_write() {
        #[derive(Debug, serde::Deserialize)]
        struct Poses {
            #[allow(dead_code, reason = "only parsed")]
            pose: Vec<Material>,
        }
        for (heading, words) in [
            (
                "pose.\"far up\"",
                "; each pose is a table of its own: write [[pose]], and below it name = \"far up\"",
            ),
            ("pose", "expected an array; each pose is a table of its own: write [[pose]]"),
        ] {
            let told = parse::<Poses>(&format!("\n[{heading}]\nyoung = 1.0\n"), Path::new("a.toml"));
            let told = told.unwrap_err().to_string();
            assert!(told.starts_with("a.toml:2:") && told.ends_with(words), "{told}");
        }
        #[derive(Debug, serde::Deserialize)]
        struct Windows {
            #[allow(dead_code, reason = "only parsed")]
            window: Vec<Poses>,
        }
        let below = parse::<Windows>("[[window]]\n[window.pose]\nyoung = 1.0\n", Path::new("a.toml"));
        let below = below.unwrap_err().to_string();
        assert!(below.ends_with("; each pose is a table of its own: write [[window.pose]]"), "{below}");
        let plain = parse::<Poses>("pose = { young = 1.0 }", Path::new("a.toml")).unwrap_err().to_string();
        assert!(plain.ends_with("expected an array"), "{plain}");
    }

    #[test]
    fn a_decimal_comma_is_named() {
        let told = |text: &str| parse::<Material>(text, Path::new("a.toml")).unwrap_err().to_string();
        for text in ["young = 0,063\npoisson = 0.3\n", "poisson = 0.3\nyoung = -12,5"] {
            let told = told(text);
            assert!(told.contains("written with a point, as 0.063"), "{told}");
        }
        for text in ["young = 1.0, poisson = 0.3\n", "young = [1,2\n", "young = a,5", "young = 1.0 2\n"] {
            let told = told(text);
            assert!(!told.contains("with a point"), "{told}");
        }
    }

    #[test]
    fn a_file_of_another_kind_is_refused_before_its_keys_are() {
        let refuse =
            |text: &str| refuse_other(text, Path::new("a.toml"), "body", ["screen", "viewer"], "a stage");
        assert_eq!(refuse("[[screen]]\n").unwrap_err().to_string(), "a.toml:1:1: a stage");
        assert!(refuse("[body.tube]\n[[screen]]\n").is_ok() && refuse("legend = 3\n").is_ok());
        assert!(refuse("[viewer\n").is_ok(), "what does not parse is told by the parser");
    }

    #[test]
    fn missing_file_names_the_path() {
        let error = load::<Material>(Path::new("no/such.toml")).unwrap_err();
        assert!(error.to_string().starts_with("no/such.toml: "), "{error}");
    }

    #[test]
    fn what_is_too_large_for_a_scene_is_refused_unread() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        std::io::Write::write_all(&mut file, &vec![b'['; (LARGEST + 1) as usize]).unwrap();
        let error = load::<Material>(file.path()).unwrap_err().to_string();
        assert!(
            error.ends_with(
                "more than 16 MiB, which no scene, stage, script or pose file needs: is it a mesh?"
            )
        );
    }
}
