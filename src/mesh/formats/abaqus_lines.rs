//! The lines of an Abaqus deck: keywords with their parameters, and the data that follows them.

use super::words::Words;
use crate::mesh::error::{FormatFault, refuse};

/// `*NAME, KEY=VALUE, KEY`, in upper case but for the values.
pub struct Keyword {
    pub at: usize,
    pub name: String,
    parameters: Vec<(String, String)>,
}

impl Keyword {
    /// The keyword line that begins with `line`; where that ends in a comma, the next one continues it.
    pub fn read(at: usize, line: &[u8], lines: &mut Words) -> Result<Keyword, FormatFault> {
        let mut text = String::from_utf8_lossy(line).into_owned();
        while text.ends_with(',') {
            let Some(line) = data_line(lines) else { break };
            text.push_str(&String::from_utf8_lossy(line.1));
        }
        let mut fields = text.trim_start_matches('*').split(',').map(str::trim);
        let name = fields.next().unwrap_or_default().to_uppercase();
        let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
        const MOST_PARAMETERS: usize = 100;
        let parameters = fields.filter(|field| !field.is_empty()).take(MOST_PARAMETERS).map(|field| {
            let (key, value) = field.split_once('=').unwrap_or((field, ""));
            (key.trim().to_uppercase(), value.trim().trim_matches('"').to_owned())
        });
        let parameters = parameters.collect();
        let keyword = Keyword { at, name, parameters };
        if matches!(keyword.name.as_str(), "NODE" | "ELEMENT" | "NSET" | "ELSET") && keyword.has("INPUT") {
            let reason = "INPUT= names another file, which is not followed: put its lines in its place";
            return refuse(at, reason);
        }
        Ok(keyword)
    }

    pub fn value(&self, key: &str) -> Option<&str> {
        self.parameters.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str())
    }

    pub fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }
}

/// The next line of data and its offset; comments and empty lines are skipped. `None` before a keyword.
pub fn data_line<'a>(lines: &mut Words<'a>) -> Option<(usize, &'a [u8])> {
    loop {
        let mut ahead = *lines;
        let (at, line) = ahead.full_line()?;
        match line {
            [b'*', b'*', ..] => *lines = ahead,
            [b'*', ..] => return None,
            _ => {
                *lines = ahead;
                return Some((at, line));
            }
        }
    }
}

/// Skips the data of a keyword that is not used.
pub fn skip_data(lines: &mut Words) {
    while data_line(lines).is_some() {}
}

/// The fields of a line of data; a comma at its end adds none.
pub fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let line = line.strip_suffix(b",").unwrap_or(line);
    line.split(|&byte| byte == b',').map(<[u8]>::trim_ascii)
}
