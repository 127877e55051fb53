//! Names of nodes in Open Inventor files: letters, digits and `_`, no digit in front, each once.

use std::collections::BTreeSet;

/// The names that were given.
#[derive(Default)]
pub struct InventorNames(BTreeSet<String>);

impl InventorNames {
    /// A name that looks like `wanted` and is given for the first time.
    pub fn unique(&mut self, wanted: &str) -> String {
        let plain = plain(wanted);
        let numbered = (2..).map(|number| format!("{plain}_{number}"));
        let name = std::iter::once(plain.clone()).chain(numbered).find(|name| !self.0.contains(name));
        let name = name.unwrap_or(plain);
        self.0.insert(name.clone());
        name
    }
}

fn plain(wanted: &str) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = wanted.chars().map(kept).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("n_{name}") }
}

/// Text in quotes: only plain text is kept, since Inventor knows no escape but that of the quote.
pub fn quoted(text: &str) -> String {
    let kept = |c: char| if c.is_ascii_graphic() && c != '"' && c != '\\' { c } else { ' ' };
    format!("\"{}\"", text.chars().map(kept).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain_and_unique() {
        let mut names = InventorNames::default();
        let given = ["right.m12", "right m12", "right_m12", "7", "röhre", ""].map(|name| names.unique(name));
        assert_eq!(given, ["right_m12", "right_m12_2", "right_m12_3", "n_7", "r_hre", "n_"]);
        assert_eq!(quoted("a \"b\"\n\\c} é"), "\"a  b   c}  \"");
    }
}
