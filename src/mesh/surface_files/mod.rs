//! Triangle surfaces from files: one format a file, and one line in `FORMATS`.
//!
//! In: a file's bytes. Out: a [`TriangleSurface`] whose vertices at one place are one, with a notice for everything that was
//! joined, cut into triangles or left out. The parsers are our own so that errors name the line, coordinates
//! keep the file's precision, and memory grows with the bytes, not with the counts in a header.

mod obj;
mod ply;
mod polygon;
mod stl;
mod words;

use super::error::{FormatFault, MeshError};
use crate::base::extent::bounding_box;
use nalgebra::Vector3;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use words::RawSurface;

/// Triangles in space, counter-clockwise as seen from outside once [`super::surface_check`] has oriented them; metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleSurface {
    pub vertices: Vec<Vector3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

/// A surface from a file, and what was repaired or left out on the way, one sentence each.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedSurface {
    pub surface: TriangleSurface,
    pub notices: Vec<String>,
}

type Read = fn(&[u8]) -> Result<RawSurface, FormatFault>;

/// Every format that can be read: name, extension in lower case, reader.
const FORMATS: &[(&str, &str, Read)] =
    &[("STL", "stl", stl::read), ("Wavefront OBJ", "obj", obj::read), ("PLY", "ply", ply::read)];

fn reader(path: &Path) -> Option<Read> {
    let extension = path.extension()?.to_string_lossy().to_lowercase();
    FORMATS.iter().find(|(_, known, _)| *known == extension).map(|(.., read)| *read)
}

/// Whether the file's name says that it holds a surface and no tetrahedra.
pub fn is_surface_file(path: &Path) -> bool {
    reader(path).is_some()
}

/// Reads the surface file at `path`.
pub fn load(path: &Path) -> Result<LoadedSurface, MeshError> {
    parse(path, &super::read(path)?)
}

/// Parses a file's `bytes` like [`load`]; the format follows from `path`, which is named in errors.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<LoadedSurface, MeshError> {
    let unknown = || {
        let known: Vec<String> = FORMATS.iter().map(|(name, end, _)| format!("{name} (.{end})")).collect();
        FormatFault::whole(format!("not a surface file that can be read; known are {}", known.join(", ")))
    };
    reader(path)
        .ok_or_else(unknown)
        .and_then(|read| read(bytes))
        .and_then(weld)
        .map_err(|fault| fault.in_file(path, bytes))
}

/// Vertices that differ by less than this part of the surface's longest side are one place: single precision rounds by a quarter
/// of it.
const ROUNDING: f64 = 2.5e-7;

/// Places, a cube of [`ROUNDING`] each, with the vertex there.
struct Places {
    low: Vector3<f64>,
    width: f64,
    vertex: HashMap<[i64; 3], u32>,
}

impl Places {
    fn new(vertices: &[Vector3<f64>]) -> Places {
        let (low, high) = bounding_box(vertices);
        Places { low, width: (ROUNDING * (high - low).amax()).max(f64::MIN_POSITIVE), vertex: HashMap::new() }
    }

    /// The vertex at this place or beside it; `new` where there is none.
    fn vertex(&mut self, x: &Vector3<f64>, new: u32, known: &[Vector3<f64>]) -> u32 {
        let own: [i64; 3] = ((x - self.low) / self.width).map(|part| part.floor() as i64).into();
        if let Some(vertex) = self.vertex.get(&own) {
            return *vertex;
        }
        let beside = (0..27).filter_map(|k| {
            let key = [own[0] + k % 3 - 1, own[1] + k / 3 % 3 - 1, own[2] + k / 9 - 1];
            self.vertex.get(&key).copied()
        });
        let near = |vertex: &u32| (known[*vertex as usize] - x).amax() < self.width;
        let found = beside.filter(near).min();
        *self.vertex.entry(own).or_insert(found.unwrap_or(new))
    }
}

/// Joins vertices at one place, cuts polygons into triangles, and drops triangles that name a vertex twice or
/// stand in the file twice.
fn weld(raw: RawSurface) -> Result<LoadedSurface, FormatFault> {
    let mut notices = raw.notices;
    if raw.vertices.len() >= u32::MAX as usize {
        return Err(FormatFault::whole(format!("{} vertices are more than 2³² - 2", raw.vertices.len())));
    }
    let is_place = |vertex: &Vector3<f64>| vertex.iter().all(|x| x.is_finite() && x.abs() < 1e100);
    if let Some(number) = raw.vertices.iter().position(|vertex| !is_place(vertex)) {
        let [x, y, z]: [f64; 3] = raw.vertices[number].into();
        return Err(FormatFault::whole(format!(
            "vertex {} at ({x}, {y}, {z}) has a coordinate that is no finite number to compute with",
            number + 1
        )));
    }
    let mut surface = TriangleSurface::default();
    let mut places = Places::new(&raw.vertices);
    let mut index = Vec::with_capacity(raw.vertices.len());
    for vertex in &raw.vertices {
        let next = surface.vertices.len() as u32;
        let welded = places.vertex(vertex, next, &surface.vertices);
        if welded == next {
            surface.vertices.push(*vertex);
        }
        index.push(welded);
    }
    let (mut many_sided, mut crossing, mut degenerate, mut doubled) = (0, 0, 0, 0);
    let mut seen = BTreeSet::new();
    let mut rest = raw.corners.as_slice();
    for &(sides, at) in &raw.polygons {
        let (polygon, after) = rest
            .split_at_checked(sides as usize)
            .ok_or_else(|| FormatFault::at(at, "the face has fewer corners than it says"))?;
        rest = after;
        let corner = |named: &u32| -> Result<u32, FormatFault> {
            let named = *named as usize;
            index.get(named).copied().ok_or_else(|| {
                let reason = format!("a face names vertex {}, and there are {}", named + 1, index.len());
                FormatFault::at(at, reason)
            })
        };
        if sides < 3 {
            degenerate += 1;
            continue;
        }
        many_sided += usize::from(sides > 3);
        let corners: Vec<u32> = polygon.iter().map(corner).collect::<Result<_, _>>()?;
        let places: Vec<Vector3<f64>> = corners.iter().map(|&at| surface.vertices[at as usize]).collect();
        let cut = polygon::triangles(&places).unwrap_or_else(|| {
            crossing += 1;
            (2..corners.len()).map(|i| [0, i - 1, i]).collect()
        });
        for triangle in cut {
            let triangle = triangle.map(|position| corners[position]);
            let [a, b, c] = triangle;
            if a == b || b == c || c == a {
                degenerate += 1;
            } else if seen.insert(turned(triangle)) {
                surface.triangles.push(triangle);
            } else {
                doubled += 1;
            }
        }
    }
    if surface.triangles.is_empty() {
        return Err(FormatFault::whole("the file has no triangle"));
    }
    let joined = raw.vertices.len() - surface.vertices.len();
    // In an STL file every triangle brings its own corners: joining them is reading, not repair.
    if joined > 0 && raw.vertices.len() != 3 * raw.polygons.len() {
        notices.push(format!("{joined} vertices at the place of another were joined with it"));
    }
    if many_sided > 0 {
        notices.push(format!("{many_sided} faces of more than three corners were cut into triangles"));
    }
    if crossing > 0 {
        notices.push(format!(
            "{crossing} faces cross themselves, or are concave with more than {} corners: their triangles lie over each other",
            polygon::MOST_CORNERS
        ));
    }
    if degenerate > 0 {
        notices.push(format!("{degenerate} faces of fewer than three different vertices were dropped"));
    }
    if doubled > 0 {
        notices.push(format!("{doubled} triangles that stand in the file twice were dropped"));
    }
    let unused = surface.drop_unused();
    if unused > 0 {
        notices.push(format!("{unused} vertices that belong to no triangle were dropped"));
    }
    Ok(LoadedSurface { surface, notices })
}

/// The triangle with its least vertex first.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

impl TriangleSurface {
    /// Corner positions of triangle `t`.
    pub fn corners(&self, t: usize) -> [Vector3<f64>; 3] {
        self.triangles[t].map(|vertex| self.vertices[vertex as usize])
    }

    /// Removes vertices without a triangle; how many there were.
    fn drop_unused(&mut self) -> usize {
        let mut index = vec![u32::MAX; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&vertex| index[vertex as usize] = 0);
        let mut kept = Vec::new();
        for (vertex, index) in self.vertices.iter().zip(&mut index).filter(|(_, index)| **index == 0) {
            *index = kept.len() as u32;
            kept.push(*vertex);
        }
        self.triangles.iter_mut().flatten().for_each(|vertex| *vertex = index[*vertex as usize]);
        let dropped = self.vertices.len() - kept.len();
        self.vertices = kept;
        dropped
    }
}
