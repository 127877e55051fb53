//! PLY 1.0, text and binary of both byte orders (Turk, The PLY Polygon File Format, Stanford 1994).
//!
//! Elements `vertex` (x, y, z) and `face` (vertex_indices or vertex_index) are used; all other elements and properties
//! are skipped by their declared sizes.

use super::words::{RawSurface, lines, words};
use crate::mesh::error::{FormatFault, refuse};
use crate::mesh::scalar::Scalar;
use nalgebra::Vector3;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    Text,
    Little,
    Big,
}

struct Property {
    name: Vec<u8>,
    /// The type of the length of a list.
    length: Option<Scalar>,
    kind: Scalar,
}

struct Element {
    name: Vec<u8>,
    count: u64,
    properties: Vec<Property>,
}

/// Largest number of properties of one element of a mesh.
const MOST_PROPERTIES: usize = 256;

pub fn read(bytes: &[u8]) -> Result<RawSurface, FormatFault> {
    let (form, elements, body) = header(bytes)?;
    let mut data = Data { bytes, at: body, form };
    let mut raw = RawSurface::default();
    for element in &elements {
        read_element(element, &mut data, &mut raw)?;
    }
    Ok(raw)
}

fn kind(name: &[u8], at: usize) -> Result<Scalar, FormatFault> {
    Ok(match name {
        b"char" | b"int8" => Scalar::I8,
        b"uchar" | b"uint8" => Scalar::U8,
        b"short" | b"int16" => Scalar::I16,
        b"ushort" | b"uint16" => Scalar::U16,
        b"int" | b"int32" => Scalar::I32,
        b"uint" | b"uint32" => Scalar::U32,
        b"float" | b"float32" => Scalar::F32,
        b"double" | b"float64" => Scalar::F64,
        _ => return refuse(at, "unknown kind of number in a property"),
    })
}

/// The form, the elements in their order, and where the data begin.
fn header(bytes: &[u8]) -> Result<(Form, Vec<Element>, usize), FormatFault> {
    let mut form = None;
    let mut elements: Vec<Element> = Vec::new();
    for (number, (at, line)) in lines(bytes).enumerate() {
        let line_words: Vec<_> = words(line, at).take(6).collect();
        let texts: Vec<&[u8]> = line_words.iter().map(|word| word.text).collect();
        match texts.as_slice() {
            [b"ply"] if number == 0 => {}
            _ if number == 0 => return refuse(at, "the first line of a PLY file is \"ply\""),
            [b"format", name, ..] => {
                form = Some(match *name {
                    b"ascii" => Form::Text,
                    b"binary_little_endian" => Form::Little,
                    b"binary_big_endian" => Form::Big,
                    _ => return refuse(at, "the format is ascii, binary_little_endian or binary_big_endian"),
                });
            }
            [b"element", name, _] => {
                let count = line_words[2].parse("a number of elements")?;
                elements.push(Element { name: name.to_vec(), count, properties: Vec::new() });
            }
            [b"property", rest @ ..] => {
                let (length, kind, name) = match rest {
                    [b"list", length, item, name] => {
                        (Some(self::kind(length, at)?), self::kind(item, at)?, name)
                    }
                    [item, name] => (None, self::kind(item, at)?, name),
                    _ => return refuse(at, "a property is \"property KIND NAME\" or a list"),
                };
                let element = elements
                    .last_mut()
                    .ok_or_else(|| FormatFault::at(at, "a property before any element"))?;
                if element.properties.len() == MOST_PROPERTIES {
                    return refuse(at, format!("more than {MOST_PROPERTIES} properties"));
                }
                element.properties.push(Property { name: name.to_vec(), length, kind });
            }
            [b"end_header"] => {
                let form = form.ok_or_else(|| FormatFault::at(at, "the header names no format"))?;
                return Ok((form, elements, (at + line.len() + 1).min(bytes.len())));
            }
            [b"comment" | b"obj_info", ..] | [] => {}
            _ => return refuse(at, "not a line of a PLY header"),
        }
    }
    Err(FormatFault::whole("the PLY header has no end_header"))
}

/// Reads on through the data.
struct Data<'a> {
    bytes: &'a [u8],
    at: usize,
    form: Form,
}

impl Data<'_> {
    fn number(&mut self, kind: Scalar) -> Result<f64, FormatFault> {
        let cut = |at| FormatFault::at(at, "the file ends before all its elements: it is cut short");
        if self.form == Form::Text {
            let rest = &self.bytes[self.at..];
            let begin = rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(|| cut(self.at))?;
            let length = rest[begin..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - begin);
            let at = self.at + begin;
            self.at = at + length;
            return super::words::Word { text: &self.bytes[at..at + length], at }.parse("a number");
        }
        let size = kind.size();
        let found = self.bytes.get(self.at..self.at + size).ok_or_else(|| cut(self.at))?;
        self.at += size;
        let mut wide = [0; 8];
        let number = &mut wide[8 - size..];
        number.copy_from_slice(found);
        if self.form == Form::Little {
            number.reverse();
        }
        Ok(kind.value(wide))
    }

    /// A number that must be a whole one from 0 to 2³² - 2.
    fn whole(&mut self, kind: Scalar, what: &str) -> Result<u32, FormatFault> {
        let at = self.at;
        let number = self.number(kind)?;
        if number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&number) {
            Ok(number as u32)
        } else {
            refuse(at, format!("{number} is no {what}"))
        }
    }
}

fn read_element(element: &Element, data: &mut Data, raw: &mut RawSurface) -> Result<(), FormatFault> {
    let column = |names: &[&[u8]]| element.properties.iter().position(|p| names.contains(&p.name.as_slice()));
    let axes = [column(&[b"x"]), column(&[b"y"]), column(&[b"z"])];
    let faces = column(&[b"vertex_indices", b"vertex_index"]);
    let (is_vertex, is_face) = (element.name == b"vertex", element.name == b"face");
    if is_vertex && axes.contains(&None) {
        return Err(FormatFault::whole("the vertices have no properties x, y and z"));
    }
    if is_face && faces.is_none_or(|c| element.properties[c].length.is_none()) {
        return Err(FormatFault::whole("the faces have no list vertex_indices"));
    }
    if element.name == b"tristrips" {
        return Err(FormatFault::whole("triangle strips are not read: export faces"));
    }
    // Without properties nothing is stored, however many elements there are.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        let at = data.at;
        let mut position = Vector3::zeros();
        for (c, property) in element.properties.iter().enumerate() {
            let Some(length) = property.length else {
                let number = data.number(property.kind)?;
                if let Some(axis) = axes.iter().position(|&axis| axis == Some(c)) {
                    position[axis] = number;
                }
                continue;
            };
            let sides = data.whole(length, "length of a list")?;
            for _ in 0..sides {
                if is_face && faces == Some(c) {
                    raw.corners.push(data.whole(property.kind, "vertex number")?);
                } else {
                    data.number(property.kind)?;
                }
            }
            if is_face && faces == Some(c) {
                raw.polygons.push((sides, at));
            }
        }
        if is_vertex {
            raw.vertices.push(position);
        }
    }
    Ok(())
}
