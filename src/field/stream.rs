//! The state of all fields as lines of JSON, and back.
//!
//! ```text
//! {"greenstage":"fields","version":2,"fields":2}
//! {"field":"stylus.turn","type":"number","value":1.0}
//! {"field":"body.turn","type":"number","value":0.5,"is_due":true}
//! ```
//!
//! A field that is due has an input that changed since it was made last. Reading is strict: every field of the graph once, with
//! its own type, and nothing else. Nothing is taken over from a stream with a fault in it, and no length in it is believed.

use super::graph::{Graph, Node};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::any::Any;
use std::io::{self, BufRead, Write};

/// Version of the lines below.
pub const VERSION: u32 = 2;

/// A longer line is refused, bytes.
pub const LONGEST_LINE: usize = 1 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    greenstage: String,
    version: u32,
    fields: usize,
}

/// The value of one field, as JSON.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldState {
    field: String,
    #[serde(rename = "type")]
    type_name: String,
    value: Box<RawValue>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    is_due: bool,
}

/// The reason why a stream of fields was not taken; `line` counts from 1.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    #[error("line {line}: {source}")]
    Io { line: u64, source: io::Error },
    #[error("line {line} is longer than {longest} bytes")]
    Long { line: u64, longest: usize },
    #[error("line {line}: the stream ends in the middle")]
    Truncated { line: u64 },
    #[error("line {line}: {source}")]
    Syntax { line: u64, source: serde_json::Error },
    #[error("line {line}: not a stream of fields of version {VERSION}, but {found}")]
    Kind { line: u64, found: String },
    #[error("line {line}: it says {found} fields, this graph has {expected}")]
    Count { line: u64, found: usize, expected: usize },
    #[error("line {line}: this graph has no field {name}{hint}")]
    Unknown { line: u64, name: String, hint: String },
    #[error("line {line}: field {name} is there twice")]
    Twice { line: u64, name: String },
    #[error("line {line}: field {name} is a {found} here, a {expected} in this graph")]
    Type { line: u64, name: String, found: String, expected: &'static str },
    #[error("line {line}: field {name}: not a {expected}: {source}")]
    Value { line: u64, name: String, expected: &'static str, source: serde_json::Error },
}

/// The next line of up to `longest` bytes without its end; `None` at the end of the input. One that is cut before its end of line is
/// [`StreamError::Truncated`]. No more is ever held than the longest line.
pub fn read_line(
    input: &mut impl BufRead,
    line: u64,
    longest: usize,
) -> Result<Option<Vec<u8>>, StreamError> {
    let mut bytes = Vec::new();
    io::Read::take(&mut *input, longest as u64 + 1)
        .read_until(b'\n', &mut bytes)
        .map_err(|source| StreamError::Io { line, source })?;
    match bytes.pop() {
        None => Ok(None),
        Some(b'\n') => Ok(Some(bytes)),
        Some(_) if bytes.len() >= longest => Err(StreamError::Long { line, longest }),
        Some(_) => Err(StreamError::Truncated { line }),
    }
}

impl<C: 'static> Graph<C> {
    /// Every field's value, those of the previous frame too, and which of them the next evaluation makes anew.
    pub fn states(&self) -> serde_json::Result<Vec<FieldState>> {
        let state = |(node, value): (&Node<C>, &Box<dyn Any>)| {
            Ok(FieldState {
                field: node.name.clone(),
                type_name: node.type_name.to_owned(),
                value: RawValue::from_string((node.write)(value.as_ref())?)?,
                is_due: node.is_dirty,
            })
        };
        self.nodes.iter().zip(&self.values.0).map(state).collect()
    }

    /// Gives every field the value that [`Graph::states`] found; the next evaluation does what it would have done there. `line` is that
    /// of the first one, and errors count on from it. Where there is a fault, nothing is changed.
    pub fn set_states(&mut self, states: &[FieldState], line: u64) -> Result<(), StreamError> {
        let mut values: Vec<Option<(Box<dyn Any>, bool)>> = self.nodes.iter().map(|_| None).collect();
        for (state, line) in states.iter().zip(line..) {
            let (number, value) = self.parsed(state, line)?;
            if values[number].replace((value, state.is_due)).is_some() {
                return Err(StreamError::Twice { line, name: state.field.clone() });
            }
        }
        let (found, expected) = (states.len(), self.nodes.len());
        if found != expected {
            return Err(StreamError::Count { line, found, expected });
        }
        // As many as there are, none twice: all of them.
        let all = self.nodes.iter_mut().zip(&mut self.values.0).zip(values);
        for ((node, value), (new, is_due)) in all.filter_map(|(old, new)| Some((old, new?))) {
            *value = new;
            node.is_dirty = is_due && node.from.is_some();
        }
        Ok(())
    }

    /// Writes every field's value, those of the previous frame too.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let header = Header { greenstage: "fields".into(), version: VERSION, fields: self.nodes.len() };
        writeln!(out, "{}", serde_json::to_string(&header)?)?;
        for state in self.states()? {
            writeln!(out, "{}", serde_json::to_string(&state)?)?;
        }
        Ok(())
    }

    /// Gives every field the value that [`Graph::write`] wrote; `line` counts the lines of the input. Where there is a fault,
    /// nothing is changed.
    pub fn read(&mut self, input: &mut impl BufRead, line: &mut u64) -> Result<(), StreamError> {
        let next = |input: &mut _, line: &mut u64| {
            *line += 1;
            read_line(input, *line, LONGEST_LINE)?.ok_or(StreamError::Truncated { line: *line })
        };
        let text = next(input, line)?;
        let header: Header = parse(&text, *line)?;
        if header.greenstage != "fields" || header.version != VERSION {
            let found = format!("{} of version {}", header.greenstage, header.version);
            return Err(StreamError::Kind { line: *line, found });
        }
        if header.fields != self.nodes.len() {
            let (found, expected) = (header.fields, self.nodes.len());
            return Err(StreamError::Count { line: *line, found, expected });
        }
        let first = *line + 1;
        let mut states: Vec<FieldState> = Vec::new();
        for _ in 0..self.nodes.len() {
            let text = next(input, line)?;
            states.push(parse(&text, *line)?);
        }
        self.set_states(&states, first)
    }

    fn parsed(&self, found: &FieldState, line: u64) -> Result<(usize, Box<dyn Any>), StreamError> {
        let name = found.field.clone();
        let Some(number) = self.nodes.iter().position(|node| node.name == name) else {
            let known = self.nodes.iter().map(|node| node.name.as_str());
            let hint = crate::config::nearest(&name, known)
                .map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
            return Err(StreamError::Unknown { line, name, hint });
        };
        let expected = self.nodes[number].type_name;
        if found.type_name != expected {
            return Err(StreamError::Type { line, name, found: found.type_name.clone(), expected });
        }
        match (self.nodes[number].read)(found.value.get()) {
            Ok(value) => Ok((number, value)),
            Err(source) => Err(StreamError::Value { line, name, expected, source }),
        }
    }
}

fn parse<'a, T: Deserialize<'a>>(text: &'a [u8], line: u64) -> Result<T, StreamError> {
    serde_json::from_slice(text).map_err(|source| StreamError::Syntax { line, source })
}
