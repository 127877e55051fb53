//! Parts into which the model `substructured` cuts a body.

use serde::{Deserialize, Serialize};

/// `parts = { along = 8 }` and its like: one key of the three.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Parts {
    /// Number of levels between the first control element and the others; branches come apart.
    Along(u32),
    /// The mesh's regions, each joined piece of one by itself.
    Regions(bool),
    /// Number of pieces of about the same volume, by repeated bisection across their longest extent.
    Pieces(u32),
}

/// Most parts of one body: their interfaces are found together, in a time that grows with the cube of their number at
/// worst.
const MOST: u32 = 64;

impl Default for Parts {
    fn default() -> Parts {
        Parts::Along(8)
    }
}

impl Parts {
    /// Errors for what cannot be meant.
    pub fn check(&self) -> Result<(), String> {
        match *self {
            Parts::Along(count) | Parts::Pieces(count) if !(1..=MOST).contains(&count) => {
                Err(format!("{count} parts are asked for, 1 to {MOST} are possible"))
            }
            Parts::Regions(false) => {
                Err("regions = false cuts nothing: write regions = true, along = 8 or pieces = 8".into())
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{Parts, Scene};
    use std::path::Path;

    fn parts(line: &str) -> Result<Option<Parts>, String> {
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0 }}\n{line}\n\
             control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
        );
        let scene = Scene::parse(&text, Path::new("any.toml")).map_err(|error| error.to_string())?;
        Ok(scene.body["a"].parts)
    }

    #[test]
    fn parts_are_read_and_mistakes_named() {
        assert_eq!(parts("").unwrap(), None);
        assert_eq!(parts("parts = { along = 5 }").unwrap(), Some(Parts::Along(5)));
        assert_eq!(parts("parts = { regions = true }").unwrap(), Some(Parts::Regions(true)));
        assert_eq!(parts("parts = { pieces = 6 }").unwrap(), Some(Parts::Pieces(6)));
        for (line, expected) in [
            ("parts = { along = 0 }", "body.a.parts: 0 parts are asked for, 1 to 64 are possible"),
            ("parts = { pieces = 65 }", "65 parts are asked for"),
            ("parts = { regions = false }", "regions = false cuts nothing"),
            ("parts = { allong = 5 }", "any.toml:4:"),
            ("parts = { along = -1 }", "any.toml:4:"),
            ("parts = 8", "any.toml:4:"),
        ] {
            let error = parts(line).unwrap_err();
            assert!(error.contains(expected), "{line}: {error}");
        }
    }
}
