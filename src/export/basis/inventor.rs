//! Open Inventor 2.1, ASCII (Wernecke, "The Inventor Mentor"): the basis shapes of each body, as in the paper's figure 7b, and
//! the body itself as a live sum.
//!
//! The sum is made of engines, at most eight vectors and eight numbers each. NAME.m12 is a Calculator whose field `a` a user
//! edits and whose `b` a dragger drives; CONTROL.sum adds the columns of one control element, as only its part changes while it
//! is moved; LIVE adds the parts to the rest shape:
//!
//! ```text
//! dragger → T, R·S → right_tx … right_m33 ┐
//!                              left_tx … ├ coefficients × columns → right_sum, left_sum → rest + Σ → Coordinate3.point
//! ```
//!
//! A dragger is scaled to its control element: T is its translation times that scale. The rows of M - 1 are the
//! displacements of the unit axes under R·S. A node's name consists of letters, digits and `_`, does not begin with a digit,
//! and occurs once ([`InventorNames`]).

use super::basis_file::{BasisFile, Profile, numbers, triangles};
use super::body_basis::{BodyBasis, Column, Handle};
use crate::base::extent::extent;
use crate::base::output::Kind;
use crate::base::text::one_line;
use crate::export::shape::COLOUR;
use crate::green::{ColumnSource, FIELDS};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::io::Write;

const HEADER: &str = "#Inventor V2.1 ascii\n# Green's functions by greenstage";

pub const FILE: BasisFile = BasisFile {
    suffix: ".iv",
    about: "Open Inventor 2.1, ASCII: basis shapes, and the live sum with draggers",
    kind: Kind {
        name: "an Inventor file by greenstage",
        recognizes: |head| head.starts_with(HEADER.as_bytes()),
    },
    // A number takes some 13 characters, a triangle three indices and -1.
    size: |bodies, _| 13 * numbers(bodies) + 24 * triangles(bodies),
    most: None,
    is_for_viewers: false,
    write,
};

/// Vectors that one Calculator multiplies, and parts that one adds to a vector.
const PRODUCTS: usize = 8;
const PARTS: usize = 7;

/// A basis shape is moved by this part of the body's size.
const AMPLITUDE: f64 = 0.15;
/// Scale at which the basis shapes are drawn.
const SHAPE_SCALE: f64 = 0.5;
/// Edges with sides further apart are drawn sharp.
const CREASE: f64 = 0.7;

fn write(bodies: &[BodyBasis], _: Profile, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{HEADER}\n{ABOUT}\n")?;
    writeln!(
        out,
        "DEF greenstage Separator {{\n  ShapeHints {{ vertexOrdering COUNTERCLOCKWISE shapeType SOLID creaseAngle {CREASE} }}"
    )?;
    let [r, g, b] = COLOUR.map(|value| f32::from(value) / 255.0);
    writeln!(out, "  Material {{ diffuseColor {r} {g} {b} specularColor 0.2 0.2 0.2 shininess 0.3 }}")?;
    writeln!(out, "  DEF storage Switch {{ whichChild -1   # holds numbers, and is not drawn")?;
    writeln!(out, "    DEF axes Coordinate3 {{ point [ 1 0 0, 0 1 0, 0 0 1 ] }}")?;
    let mut names = InventorNames::default();
    // Taken by what stands in the file once.
    ["greenstage", "storage", "axes", "show", "x", "y", "z"].iter().for_each(|name| drop(names.unique(name)));
    let mut named = Vec::new();
    for body in bodies {
        named.push(NamedBody::new(body, bodies.len() > 1, &mut names));
    }
    for body in &named {
        body.store(out)?;
    }
    writeln!(
        out,
        "  }}\n  DEF show Switch {{ whichChild -3   # 0: the bodies alone, 1: the basis shapes alone, -3: both"
    )?;
    writeln!(out, "    Separator {{")?;
    named.iter().try_for_each(|body| body.put_live(out))?;
    writeln!(out, "    }}\n    Separator {{")?;
    let below = |body: &NamedBody<'_>| body.body.centre.y + bounds(&body.body.rest).0.y - body.margin();
    let mut corner = bodies.first().map_or(Vector3::zeros(), |body| body.centre);
    corner.x -= named.first().map_or(0.0, |body| 0.5 * body.width());
    corner.y = named.iter().map(below).fold(f64::INFINITY, f64::min);
    for body in &named {
        body.put_shapes(corner, out)?;
        corner.x += body.width();
    }
    writeln!(out, "    }}\n  }}\n}}")
}

const ABOUT: &str = "\
#
# Units: m, in the mesh's coordinates. Every column is stored once (DEF storage); a name as right_tx_column is the
# displacement for a unit of its coefficient. NAME.a is the coefficient that you edit (right_tx: m; right_m12: an entry
# of M - 1), NAME.b what a dragger adds: take it with the mouse, to shift, turn or stretch its control element.
# A sum of columns is the linear theory: right for small turns, 10 degrees or so; beyond, bodies swell.";

/// A body, and the names of its nodes.
struct NamedBody<'a> {
    body: &'a BodyBasis,
    id: String,
    columns: Vec<NamedColumn<'a>>,
    draggers: BTreeMap<usize, String>,
    /// Columns that are summed together: a control element, the loads, the model's own.
    groups: Vec<(String, Vec<usize>)>,
}

struct NamedColumn<'a> {
    column: &'a Column,
    id: String,
}

impl<'a> NamedBody<'a> {
    fn new(body: &'a BodyBasis, is_one_of_many: bool, names: &mut InventorNames) -> NamedBody<'a> {
        let id = names.unique(&body.body);
        let prefix = if is_one_of_many { format!("{id}_") } else { String::new() };
        let columns: Vec<NamedColumn<'_>> = body
            .columns
            .iter()
            .map(|column| NamedColumn { column, id: names.unique(&format!("{prefix}{}", column.name.name)) })
            .collect();
        let mut draggers = BTreeMap::new();
        let mut groups = Vec::new();
        for (e, handle) in body.controls.iter().enumerate() {
            let is_own = |column: &Column| matches!(column.name.source, ColumnSource::Field { control, .. } if control == e);
            let own: Vec<usize> = (0..columns.len()).filter(|k| is_own(columns[*k].column)).collect();
            if handle.is_grabbed && !own.is_empty() {
                draggers.insert(e, names.unique(&format!("{prefix}{}_dragger", handle.rest.name)));
            }
            groups.push((names.unique(&format!("{prefix}{}_sum", handle.rest.name)), own));
        }
        for (name, source) in [("loads", ColumnSource::Load), ("model", ColumnSource::Model)] {
            let own = (0..columns.len()).filter(|k| columns[*k].column.name.source == source).collect();
            groups.push((names.unique(&format!("{prefix}{name}_sum")), own));
        }
        groups.retain(|(_, own)| !own.is_empty());
        NamedBody { body, id, columns, draggers, groups }
    }

    /// Rest shape, columns and faces, each once.
    fn store(&self, out: &mut dyn Write) -> io::Result<()> {
        let (id, name) = (&self.id, one_line(&self.body.body));
        writeln!(
            out,
            "    # body {name}: {} nodes, {} columns, model {}",
            self.body.rest.len(),
            self.columns.len(),
            self.body.model.name
        )?;
        for column in &self.body.vanishing {
            let why = match column.source {
                ColumnSource::Field { .. } => ", because the control element is flat along that axis",
                ColumnSource::Load | ColumnSource::Model => "",
            };
            writeln!(out, "    # {} is zero{why}", one_line(&column.name))?;
        }
        put_points(out, &format!("{id}_rest"), &self.body.rest)?;
        for NamedColumn { column, id } in &self.columns {
            writeln!(out, "    # {}: metres for 1 {}", one_line(&column.name.name), unit(&column.name.unit))?;
            put_points(out, &format!("{id}_column"), &column.u)?;
        }
        writeln!(out, "    DEF {id}_faces IndexedFaceSet {{ coordIndex [")?;
        for [a, b, c] in &self.body.triangles {
            writeln!(out, "{a}, {b}, {c}, -1,")?;
        }
        writeln!(out, "    ] }}")
    }

    /// Draggers, and the body whose coordinates are the sum.
    fn put_live(&self, out: &mut dyn Write) -> io::Result<()> {
        let (id, name) = (&self.id, one_line(&self.body.body));
        let c = self.body.centre;
        writeln!(out, "      Separator {{   # body {name}, live")?;
        writeln!(out, "        Translation {{ translation {} }}", vector(c))?;
        let motion = self.body.motion;
        if let Some(pose) = &self.body.pose {
            let (axis, angle) = motion.rotation.axis_angle().unwrap_or((Vector3::x_axis(), 0.0));
            writeln!(out, "        # pose {}", one_line(pose))?;
            writeln!(
                out,
                "        DEF {id}_motion Transform {{ translation {} rotation {} {angle:e} }}",
                vector(motion.translation.vector),
                vector(*axis)
            )?;
        }
        for (e, dragger) in &self.draggers {
            let Handle { rest, radius, .. } = &self.body.controls[*e];
            writeln!(out, "        Separator {{")?;
            writeln!(out, "          Translation {{ translation {} }}", vector(rest.origin))?;
            writeln!(out, "          Scale {{ scaleFactor {0:e} {0:e} {0:e} }}", handle_scale(*radius))?;
            writeln!(out, "          DEF {dragger} TransformerDragger {{ }}\n        }}")?;
        }
        writeln!(out, "        DEF {id}_live Coordinate3 {{ point =")?;
        self.put_total(out)?;
        writeln!(out, "        }}\n        USE {id}_faces\n      }}")
    }

    /// rest + the sums of all groups.
    fn put_total(&self, out: &mut dyn Write) -> io::Result<()> {
        let id = &self.id;
        let links: Vec<&[(String, Vec<usize>)]> = self.groups.chunks(PARTS).collect();
        // The first link of the chain stands innermost.
        for (number, link) in links.iter().enumerate().rev() {
            writeln!(
                out,
                "DEF {id}_total_{} Calculator {{ expression \"oA = {}\"\n A =",
                number + 1,
                sum(link.len())
            )?;
        }
        writeln!(out, "USE {id}_rest . point")?;
        for link in &links {
            for ((name, own), letter) in link.iter().zip('B'..) {
                writeln!(out, " {letter} =")?;
                self.put_group(out, name, own)?;
            }
            writeln!(out, "}} . oA")?;
        }
        Ok(())
    }

    /// The sum of one group's columns.
    fn put_group(&self, out: &mut dyn Write, name: &str, own: &[usize]) -> io::Result<()> {
        let links: Vec<&[usize]> = match own.len() {
            0..=PRODUCTS => vec![own],
            // The others add seven to what came before.
            _ => std::iter::once(&own[..PRODUCTS]).chain(own[PRODUCTS..].chunks(PARTS)).collect(),
        };
        let last = links.len() - 1;
        for (number, link) in links.iter().enumerate().rev() {
            let called = if number == last { name.to_owned() } else { format!("{name}_{}", number + 1) };
            let begins = if number == 0 { "" } else { "A + " };
            let letters = ('a'..).zip('A'..).skip(usize::from(number > 0));
            let products: Vec<String> =
                letters.take(link.len()).map(|(number, vector)| format!("{number}*{vector}")).collect();
            writeln!(
                out,
                "  DEF {called} Calculator {{ expression \"oA = {begins}{}\"",
                products.join(" + ")
            )?;
            if number > 0 {
                writeln!(out, "  A =")?;
            }
        }
        for (number, link) in links.iter().enumerate() {
            let letters = ('a'..).zip('A'..).skip(usize::from(number > 0));
            for (k, (scalar, vector)) in link.iter().zip(letters) {
                let NamedColumn { column, id } = &self.columns[*k];
                write!(out, "    {vector} = USE {id}_column . point {scalar} = ")?;
                self.put_coefficient(out, column, id)?;
            }
            writeln!(out, "  }} . oA")?;
        }
        Ok(())
    }

    /// Writes the coefficient that is edited, and the part that a dragger adds.
    fn put_coefficient(&self, out: &mut dyn Write, column: &Column, id: &str) -> io::Result<()> {
        let value = column.coefficient;
        write!(out, "DEF {id} Calculator {{ a {value:e}")?;
        let dragged = match column.name.source {
            ColumnSource::Field { control, field } => {
                self.draggers.get(&control).map(|name| (control, field, name))
            }
            ColumnSource::Load | ColumnSource::Model => None,
        };
        let Some((control, field, dragger)) = dragged else {
            return writeln!(out, " expression \"oa = a\" }} . oa");
        };
        // Engines that several fields share are written where the first of them needs them.
        let is_first = |of: &dyn Fn(usize) -> bool| {
            let first = (0..FIELDS).find(|k| of(*k) && self.body.field(control, *k).is_some());
            first == Some(field)
        };
        write!(out, " b = ")?;
        if field < 3 {
            if is_first(&|k| k < 3) {
                let scale = handle_scale(self.body.controls[control].radius);
                write!(
                    out,
                    "DEF {dragger}_T DecomposeVec3f {{ vector = Calculator {{ A = USE {dragger} . translation a {scale:e} \
                     expression \"oA = a*A\" }} . oA }}"
                )?;
            } else {
                write!(out, "USE {dragger}_T")?;
            }
            write!(out, " . {}", ["x", "y", "z"][field])?;
        } else {
            let (row, column) = ((field - 3) / 3, (field - 3) % 3);
            write!(out, "SelectOne {{ type \"MFFloat\" index {column} input = ")?;
            if is_first(&|k| k >= 3) {
                write!(
                    out,
                    "DEF {dragger}_M DecomposeVec3f {{ vector = Calculator {{ B = USE axes . point expression \"oA = A - B\" \
                     A = TransformVec3f {{ vector = USE axes . point matrix = ComposeMatrix {{ \
                     rotation = USE {dragger} . rotation scaleFactor = USE {dragger} . scaleFactor }} . matrix }} . direction \
                     }} . oA }}"
                )?;
            } else {
                write!(out, "USE {dragger}_M")?;
            }
            write!(out, " . {} }} . output", ["x", "y", "z"][row])?;
        }
        writeln!(out, " expression \"oa = a + b\" }} . oa")
    }

    /// The space of a basis shape with its name, before it is made smaller, m.
    fn cell(&self) -> Vector3<f64> {
        let (low, high) = bounds(&self.body.rest);
        high - low + Vector3::repeat(self.margin())
    }

    fn margin(&self) -> f64 {
        2.5 * AMPLITUDE * self.body.size
    }

    /// Whether control elements stand below each other, and not side by side: whichever is more compact.
    fn is_stacked(&self) -> bool {
        let cell = self.cell();
        cell.x > cell.y
    }

    /// Width of all basis shapes together, m.
    fn width(&self) -> f64 {
        let cells = if self.is_stacked() { 3.5 } else { 3.5 * self.groups.len() as f64 };
        SHAPE_SCALE * cells * self.cell().x
    }

    /// Writes the rest shape with each column in turn, each control element's twelve as T and the rows of M stand; from `corner`
    /// on to the right and down.
    fn put_shapes(&self, corner: Vector3<f64>, out: &mut dyn Write) -> io::Result<()> {
        let (id, name) = (&self.id, one_line(&self.body.body));
        let (cell, (low, _)) = (self.cell(), bounds(&self.body.rest));
        writeln!(
            out,
            "      Separator {{   # body {name}: each shape is the rest shape plus a times the column that it names\n        \
             Translation {{ translation {} }}\n        Scale {{ scaleFactor {SHAPE_SCALE} {SHAPE_SCALE} {SHAPE_SCALE} }}",
            vector(corner)
        )?;
        let is_stacked = self.is_stacked();
        for (block, (_, own)) in self.groups.iter().enumerate() {
            let place = |at: usize, k: usize| match self.columns[k].column.name.source {
                ColumnSource::Field { field, .. } => (field % 3, field / 3),
                ColumnSource::Load | ColumnSource::Model => (at % 3, at / 3),
            };
            let first = if is_stacked {
                (0.5, 0.5 + self.rows_above(block))
            } else {
                (0.5 + 3.5 * block as f64, 0.5)
            };
            for (at, k) in own.iter().enumerate() {
                let (x, y) = place(at, *k);
                let NamedColumn { column, id: column_id } = &self.columns[*k];
                let shift = Vector3::new((first.0 + x as f64) * cell.x, -(first.1 + y as f64) * cell.y, 0.0);
                let amount = AMPLITUDE * self.body.size / column.largest.max(f64::MIN_POSITIVE);
                let under = Vector3::new(0.0, low.y - 0.45 * self.margin(), 0.0);
                writeln!(
                    out,
                    "        Separator {{\n          Translation {{ translation {} }}\n          Coordinate3 {{ point = DEF \
                     {column_id}_shape Calculator {{ a {amount:e} A = USE {id}_rest . point B = USE {column_id}_column . point \
                     expression \"oA = A + a*B\" }} . oA }}\n          USE {id}_faces\n          Translation {{ translation {} \
                     }}\n          BaseColor {{ rgb 0.8 0.8 0.8 }}\n          Text2 {{ string {} justification CENTER }}\n        }}",
                    vector(shift),
                    vector(under),
                    quoted(&column.name.name)
                )?;
            }
        }
        writeln!(out, "      }}")
    }

    /// Number of rows above a group, of the groups before it: four for a control element, and half of one between them.
    fn rows_above(&self, block: usize) -> f64 {
        let rows = |own: &Vec<usize>| match self.columns[own[0]].column.name.source {
            ColumnSource::Field { .. } => 4,
            ColumnSource::Load | ColumnSource::Model => own.len().div_ceil(3),
        };
        self.groups[..block].iter().map(|(_, own)| rows(own) as f64 + 0.5).sum()
    }
}

/// A dragger's box is a little larger than what it holds, so that it can be taken.
fn handle_scale(radius: f64) -> f64 {
    1.15 * radius
}

/// The expression `A + B + C`: a vector and `parts` parts.
fn sum(parts: usize) -> String {
    let letters: Vec<String> = ('A'..).take(1 + parts).map(String::from).collect();
    letters.join(" + ")
}

fn unit(unit: &str) -> &str {
    if unit == "1" { "(no unit)" } else { unit }
}

fn bounds(places: &[[f32; 3]]) -> (Vector3<f64>, Vector3<f64>) {
    extent(places.iter().map(|x| Vector3::from(*x).cast())).unwrap_or_default()
}

fn put_points(out: &mut dyn Write, name: &str, points: &[[f32; 3]]) -> io::Result<()> {
    writeln!(out, "    DEF {name} Coordinate3 {{ point [")?;
    for [x, y, z] in points {
        writeln!(out, "{} {} {},", Number(*x), Number(*y), Number(*z))?;
    }
    writeln!(out, "    ] }}")
}

fn vector(v: Vector3<f64>) -> String {
    format!("{} {} {}", Number(v.x as f32), Number(v.y as f32), Number(v.z as f32))
}

/// All digits of a number, in the shorter of two ways.
struct Number(f32);

impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Number(x) = self;
        match x.abs() {
            0.0 => f.write_str("0"),
            1e-3..1e7 => write!(f, "{x}"),
            _ => write!(f, "{x:e}"),
        }
    }
}

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
