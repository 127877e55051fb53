//! Finds all faults of a TOML file that stand by themselves, not the first alone.
//!
//! In: text. Out: the value that is left when each faulty key is taken out, with an error for each of them. A file that is no
//! TOML has one error. A key that is missing only because it was taken out is no separate fault.

use super::strict::Strict;
use super::{ConfigError, explain, told};
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

/// Largest number of faults that are looked for.
const MOST: usize = 100;

/// The sound part of a file, with its faults.
pub struct Every<T> {
    /// `None` where too little is left of it.
    pub value: Option<T>,
    pub faults: Vec<ConfigError>,
    /// The keys that were taken out, from the root; of an unknown one the key that was meant, where one is near.
    pub taken: Vec<Vec<String>>,
}

/// Parses TOML `text` as far as it is sound; `path` is only named in errors.
pub fn parse_every<T: DeserializeOwned>(text: &str, path: &Path) -> Every<T> {
    let mut every = Every { value: None, faults: Vec::new(), taken: Vec::new() };
    // Tables out of which a key was taken that nobody knows: what they lack may have been meant by it.
    let mut guessed: Vec<Vec<String>> = Vec::new();
    let mut root = match DeTable::parse(text) {
        Ok(root) => root.into_inner(),
        Err(error) => {
            every.faults.push(told(&error, text, path));
            return every;
        }
    };
    while every.faults.len() < MOST {
        let document = toml::Deserializer::from(Spanned::new(0..text.len(), root.clone()));
        let error = match T::deserialize(Strict(document)) {
            Ok(value) => {
                every.value = Some(value);
                break;
            }
            Err(error) => error,
        };
        // What the root lacks has all of the text.
        let span = error.span().filter(|span| *span != (0..text.len()));
        let place = span.and_then(|span| place_of(&root, span.start));
        let table = place.clone().unwrap_or_default();
        let is_consequence = match missing(&error) {
            Some(key) => {
                let own: Vec<String> = table.iter().cloned().chain([key.to_owned()]).collect();
                every.taken.contains(&own) || guessed.contains(&table)
            }
            // An empty table in the place of a choice.
            None => {
                error.message().starts_with("wanted exactly")
                    && every.taken.iter().any(|taken| taken.starts_with(&table))
            }
        };
        if !is_consequence {
            every.faults.push(told(&error, text, path));
        }
        let Some(mut place) = place.filter(|place| take(&mut root, place)) else { break };
        if !is_consequence && error.message().starts_with("unknown field") {
            let told = explain(error.message());
            let meant = told.split("; did you mean `").nth(1).and_then(|rest| rest.split('`').next());
            let key = place.pop();
            match meant {
                Some(meant) => place.push(meant.to_owned()),
                None => {
                    guessed.push(place.clone());
                    place.extend(key);
                }
            }
        }
        every.taken.push(place);
    }
    every
}

/// The field that an error misses.
fn missing(error: &Error) -> Option<&str> {
    error.message().strip_prefix("missing field `")?.split('`').next()
}

/// The keys of the innermost entry of a table in whose key or value an offset of the text lies.
fn place_of(table: &DeTable<'_>, at: usize) -> Option<Vec<String>> {
    let below = table.iter().find_map(|(key, value)| match value.get_ref() {
        // The parts of a table may stand anywhere in the file.
        DeValue::Table(table) => {
            let mut place = place_of(table, at)?;
            place.insert(0, key.get_ref().to_string());
            Some(place)
        }
        _ => None,
    });
    let own = || table.iter().find(|(key, value)| key.span().contains(&at) || value.span().contains(&at));
    below.or_else(|| Some(vec![own()?.0.get_ref().to_string()]))
}

/// Takes an entry out; false where there is none.
fn take(table: &mut DeTable<'_>, place: &[String]) -> bool {
    match place {
        [] => false,
        [key] => table.remove(key.as_str()).is_some(),
        [key, rest @ ..] => match table.get_mut(key.as_str()).map(Spanned::get_mut) {
            Some(DeValue::Table(table)) => take(table, rest),
            _ => false,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;
    use std::collections::BTreeMap;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Part {
        #[allow(dead_code, reason = "only parsed")]
        young: f64,
        size: [u32; 2],
        #[allow(dead_code, reason = "only parsed")]
        more: Option<bool>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct All {
        #[serde(default)]
        part: BTreeMap<String, Part>,
        title: Option<String>,
    }

    fn every(text: &str) -> (Option<All>, Vec<String>) {
        let found = parse_every::<All>(text, Path::new("a.toml"));
        (found.value, found.faults.iter().map(ToString::to_string).collect())
    }

    /// Seven mistakes, each reported once at its place, and the sound part is read.
    #[test]
    fn every_fault_is_told_once_with_its_place() {
        let text = "titel = \"x\"\n[part.a]\nyuong = 1.0\nsize = [1, 2]\n[part.b]\nyoung = \"soft\"\nsize = [1, 2, 3]\n\
                    [part.c]\nyoung = 2.0\nsize = [3, 4]\nmoer = true\n[part.d]\nsize = [5, 6]\n[part.e]\nx = 1\nsize = [1, 2]\n";
        let (value, faults) = every(text);
        let starts = [
            "a.toml:1:1: unknown field `titel`",
            "a.toml:3:1: unknown field `yuong`",
            "a.toml:6:9: invalid type: string",
            "a.toml:7:8: invalid length 3",
            "a.toml:11:1: unknown field `moer`",
            "a.toml:12:1: missing field `young`",
            "a.toml:15:1: unknown field `x`",
        ];
        for start in starts {
            assert_eq!(
                faults.iter().filter(|fault| fault.starts_with(start)).count(),
                1,
                "{start}: {faults:#?}"
            );
        }
        assert_eq!(faults.len(), starts.len(), "{faults:#?}");
        let all = value.unwrap();
        assert_eq!(all.part.keys().collect::<Vec<_>>(), ["c"]);
        assert_eq!((all.part["c"].size, all.title), ([3, 4], None));
    }

    #[test]
    fn what_is_no_toml_has_one_fault() {
        let (value, faults) = every("titel = 1\n[part");
        assert!(value.is_none() && faults.len() == 1 && faults[0].starts_with("a.toml:2:"), "{faults:?}");
    }

    proptest! {
        /// The first of all faults is the one that [`parse`](crate::config::parse) stops at, and a sound file has none.
        #[test]
        fn the_first_fault_is_that_of_the_plain_parser(lines in proptest::collection::vec(
            prop::sample::select(vec![
                "titel = 1", "title = 2", "part.a.young = 1.0", "part.a.size = [1, 2]", "part.b = 3", "part.b.size = [1]",
                "part.c = { young = 1.0, size = [1, 2], more = 0 }", "[part.d]", "young = 1", "size = [0, 0]", "x = [", "",
            ]), 0..8)) {
            let text = lines.join("\n");
            let found = parse_every::<All>(&text, Path::new("a.toml"));
            let plain = crate::config::parse::<All>(&text, Path::new("a.toml"));
            match plain {
                Ok(_) => prop_assert!(found.value.is_some() && found.faults.is_empty()),
                Err(error) => prop_assert_eq!(found.faults[0].to_string(), error.to_string()),
            }
        }
    }
}
