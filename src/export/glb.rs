//! glTF 2.0 in one binary file (Khronos, "glTF 2.0 Specification", chapter 4.4): a node of the body's name for each body of a
//! pose, its triangles with vertex normals, in m, and a material of the colour in which it is shown.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use super::shape::{COLOUR, Shape};
use crate::base::output::Kind;
use egui::ecolor::linear_f32_from_gamma_u8;
use serde_json::{Value, json};

pub(super) const MAGIC: &[u8] = b"glTF";
const GENERATOR: &str = "greenstage, a deformed surface";
/// Kinds of numbers and of buffers, by the numbers that OpenGL gives them.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

pub const SURFACE: Exporter = Exporter {
    suffix: ".glb",
    kind: Kind {
        name: "a glTF file by greenstage",
        recognizes: |head| {
            let mark = GENERATOR.as_bytes();
            head.starts_with(MAGIC) && head.windows(mark.len()).any(|window| window == mark)
        },
    },
    needs: Needs::Nothing,
    spread: Spread::EachPose,
    write: |set: &ResultSet| write(&Shape::list(set)),
};

/// The parts of the document that refer to each other by number.
#[derive(Default)]
pub(super) struct Document {
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
    pub binary: Vec<u8>,
}

impl Document {
    /// Adds an array; returns the number of its accessor. All numbers are of four bytes, so that every array is aligned.
    fn add(&mut self, numbers: &[u8], target: Option<u32>, accessor: Value) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": numbers.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        let mut accessor = accessor;
        accessor["bufferView"] = self.views.len().into();
        self.views.push(view);
        self.accessors.push(accessor);
        self.binary.extend_from_slice(numbers);
        self.accessors.len() - 1
    }

    pub fn add_vectors(&mut self, vectors: &[[f32; 3]], with_bounds: bool) -> usize {
        let mut accessor = json!({ "componentType": FLOAT, "count": vectors.len(), "type": "VEC3" });
        if with_bounds {
            let bound = |start: f32, pick: fn(f32, f32) -> f32| {
                [0, 1, 2].map(|axis| vectors.iter().map(|vector| vector[axis]).fold(start, pick))
            };
            accessor["min"] = json!(bound(f32::INFINITY, f32::min));
            accessor["max"] = json!(bound(f32::NEG_INFINITY, f32::max));
        }
        self.add(bytemuck::cast_slice(vectors), Some(ARRAY_BUFFER), accessor)
    }

    pub fn add_triangles(&mut self, triangles: &[[u32; 3]]) -> usize {
        let accessor =
            json!({ "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR" });
        self.add(bytemuck::cast_slice(triangles), Some(ELEMENT_ARRAY_BUFFER), accessor)
    }

    /// Numbers of an animation.
    pub fn add_numbers(&mut self, numbers: &[f32]) -> usize {
        let bound = |start: f32, pick: fn(f32, f32) -> f32| [numbers.iter().copied().fold(start, pick)];
        let (min, max) = (bound(f32::INFINITY, f32::min), bound(f32::NEG_INFINITY, f32::max));
        let accessor = json!({
            "componentType": FLOAT, "count": numbers.len(), "type": "SCALAR", "min": min, "max": max
        });
        self.add(bytemuck::cast_slice(numbers), None, accessor)
    }

    /// The whole file, of a root that names its nodes and meshes.
    pub fn finish(self, mut root: Value) -> Vec<u8> {
        root["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        (root["bufferViews"], root["accessors"]) = (self.views.into(), self.accessors.into());
        container(&root, self.binary)
    }
}

/// A document's head, with the material of bodies.
pub(super) fn root(generator: &str) -> Value {
    let [r, g, b] = COLOUR.map(linear_f32_from_gamma_u8);
    json!({
        "asset": { "version": "2.0", "generator": generator },
        "scene": 0,
        "materials": [{
            "name": "body",
            "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6 }
        }]
    })
}

pub fn write(shapes: &[Shape]) -> Vec<u8> {
    let mut document = Document::default();
    let (mut meshes, mut nodes) = (Vec::new(), Vec::new());
    // A mesh without vertices would not be valid.
    for shape in shapes.iter().filter(|shape| !shape.triangles.is_empty()) {
        let position = document.add_vectors(&shape.positions, true);
        let normal = document.add_vectors(&shape.normals, false);
        let indices = document.add_triangles(&shape.triangles);
        nodes.push(json!({ "name": shape.body, "mesh": meshes.len() }));
        meshes.push(json!({
            "name": shape.body,
            "primitives": [{
                "attributes": { "POSITION": position, "NORMAL": normal },
                "indices": indices,
                "material": 0
            }]
        }));
    }
    let mut root = root(GENERATOR);
    if nodes.is_empty() {
        root["scenes"] = json!([{}]);
        return container(&root, document.binary);
    }
    root["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
    (root["nodes"], root["meshes"]) = (nodes.into(), meshes.into());
    document.finish(root)
}

/// The document in its two chunks, each a multiple of four bytes long. What wrote it stands at the very front, where an earlier
/// file is known by it.
fn container(root: &Value, binary: Vec<u8>) -> Vec<u8> {
    let mut rest = root.clone();
    let asset = rest.as_object_mut().and_then(|rest| rest.remove("asset")).unwrap_or_default();
    let rest = rest.to_string();
    let mut text = format!("{{\"asset\":{asset},{}", rest.strip_prefix('{').unwrap_or(&rest)).into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut chunks = chunk(b"JSON", &text);
    if !binary.is_empty() {
        chunks.extend(chunk(b"BIN\0", &binary));
    }
    let mut bytes = MAGIC.to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((12 + chunks.len() as u32).to_le_bytes());
    bytes.extend(chunks);
    bytes
}

fn chunk(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut bytes = (content.len() as u32).to_le_bytes().to_vec();
    bytes.extend(kind);
    bytes.extend(content);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Read by the layout of the specification, not by the writer's own functions.
    #[test]
    fn a_file_is_what_the_specification_asks_for() {
        let shape = Shape {
            body: "a \"part\"".into(),
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -3.0, 0.5]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            triangles: vec![[0, 1, 2]],
        };
        let bytes = write(&[shape.clone(), shape]);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        assert_eq!((word(12) % 4, &bytes[16..20]), (0, &b"JSON"[..]));
        let root: Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
        let binary = 20 + word(12);
        assert_eq!((&bytes[binary + 4..binary + 8], binary + 8 + word(binary)), (&b"BIN\0"[..], bytes.len()));
        assert_eq!(root["buffers"][0]["byteLength"], word(binary));
        assert_eq!(
            (root["scenes"][0]["nodes"].as_array().unwrap().len(), &root["nodes"][1]["mesh"]),
            (2, &json!(1))
        );
        assert_eq!(root["nodes"][0]["name"], "a \"part\"");
        let primitive = &root["meshes"][1]["primitives"][0];
        let array = |accessor: &Value| {
            let accessor = &root["accessors"][accessor.as_u64().unwrap() as usize];
            let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let start = binary + 8 + view["byteOffset"].as_u64().unwrap() as usize;
            assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
            (accessor.clone(), bytes[start..start + view["byteLength"].as_u64().unwrap() as usize].to_vec())
        };
        let (position, raw) = array(&primitive["attributes"]["POSITION"]);
        assert_eq!((&position["min"], &position["max"]), (&json!([0.0, -3.0, 0.0]), &json!([2.0, 0.0, 0.5])));
        assert_eq!((position["count"].as_u64(), raw.len()), (Some(3), 36));
        assert_eq!(f32::from_le_bytes(raw[28..32].try_into().unwrap()), -3.0);
        let (indices, raw) = array(&primitive["indices"]);
        assert_eq!(
            (indices["count"].as_u64(), &raw[..]),
            (Some(3), &[0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0][..])
        );
    }

    #[test]
    fn a_file_of_no_body_has_an_empty_scene() {
        let bytes = write(&[]);
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 20 + length);
        let root: Value = serde_json::from_slice(&bytes[20..]).unwrap();
        assert!(root.get("buffers").is_none() && root.get("nodes").is_none());
    }
}
