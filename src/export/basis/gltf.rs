//! glTF 2.0 with a morph target for every column (Khronos, "glTF 2.0 Specification", sections 3.7.2.2 and 3.11): a target's
//! POSITION is the displacement for a weight of 1, in the column's unit, so that the weights are the coefficients of the sum.
//!
//! A target's NORMAL is the derivative of the unit normal at rest, n' = (1 - n nᵀ) s'/|s| with s the sum of the triangles'
//! areas around a vertex: right for small weights. An animation moves every control element in turn. The profile `viewer`
//! has a few motions instead, each forwards and backwards, for programs that take 8 targets with weights from 0 to 1: of
//! each control element three shifts, three turns and three stretches, and one motion for every load, each a small sum of
//! columns that people can follow.

use super::basis_file::{BasisFile, Profile, VIEWER_MOTIONS, numbers, triangles};
use super::body_basis::{BodyBasis, Handle};
use crate::base::output::Kind;
use crate::deform::vertex_normals;
use crate::export::glb::{Document, MAGIC, root};
use crate::green::{ColumnSource, FIELD_NAMES};
use nalgebra::Vector3;
use serde_json::{Value, json};
use std::io;
use std::io::Write;

const GENERATOR: &str = "greenstage, columns as morph targets";

pub const FILE: BasisFile = BasisFile {
    suffix: ".glb",
    about: "glTF 2.0 for viewers, Blender and the web: one named morph target per column, and an animation",
    kind: Kind {
        name: "a glTF file by `export`",
        recognizes: |head| {
            let mark = GENERATOR.as_bytes();
            head.starts_with(MAGIC) && head.windows(mark.len()).any(|window| window == mark)
        },
    },
    size,
    most: Some(u32::MAX as u64),
    is_for_viewers: true,
    write,
};

/// Seconds from rest to a motion's end.
const STRIDE_S: f32 = 0.6;

fn size(bodies: &[BodyBasis], profile: Profile) -> u64 {
    let vertices: u64 = bodies.iter().map(|body| body.rest.len() as u64).sum();
    match profile {
        // Positions and normals.
        Profile::Full => 8 * numbers(bodies) + 12 * triangles(bodies),
        Profile::Viewer => 12 * (2 + 2 * VIEWER_MOTIONS as u64) * vertices + 12 * triangles(bodies),
    }
}

/// One morph target, and the weight at which it begins.
struct Target {
    name: String,
    unit: String,
    position: Vec<[f32; 3]>,
    weight: f64,
}

/// The targets of a mesh, and their weights in the course of the animation.
struct Track {
    targets: Vec<Target>,
    has_normals: bool,
    /// The weights at the end of each step of a motion.
    ends: Vec<Vec<f64>>,
}

fn write(bodies: &[BodyBasis], profile: Profile, out: &mut dyn Write) -> io::Result<()> {
    let mut document = Document::default();
    let (mut meshes, mut nodes, mut channels, mut samplers) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for body in bodies {
        let track = match profile {
            Profile::Full => full(body),
            Profile::Viewer => split(body),
        };
        let mesh = mesh(&mut document, body, &track);
        if let Some(sampler) = sampler(&mut document, &track) {
            channels.push(json!({
                "sampler": samplers.len(), "target": { "node": nodes.len(), "path": "weights" }
            }));
            samplers.push(sampler);
        }
        let place = body.motion.translation.vector + body.centre;
        let turn = body.motion.rotation.coords.cast::<f32>();
        nodes.push(json!({
            "name": body.body,
            "mesh": meshes.len(),
            "translation": [place.x as f32, place.y as f32, place.z as f32],
            "rotation": [turn.x, turn.y, turn.z, turn.w],
            "extras": { "model": body.model.name, "pose": body.pose }
        }));
        meshes.push(mesh);
    }
    let mut root = root(GENERATOR);
    root["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
    (root["nodes"], root["meshes"]) = (nodes.into(), meshes.into());
    if !channels.is_empty() {
        root["animations"] = json!([{ "name": "control elements and loads, one by one", "channels": channels, "samplers": samplers }]);
    }
    out.write_all(&document.finish(root))
}

fn mesh(document: &mut Document, body: &BodyBasis, track: &Track) -> Value {
    let normals = normals(&body.rest, &body.triangles);
    let attributes = json!({
        "POSITION": document.add_vectors(&body.rest, true), "NORMAL": document.add_vectors(&normals, false)
    });
    let indices = document.add_triangles(&body.triangles);
    let target = |target: &Target| {
        let mut attributes = json!({ "POSITION": document.add_vectors(&target.position, true) });
        if track.has_normals {
            let slopes = normal_slopes(&body.rest, &body.triangles, &target.position);
            attributes["NORMAL"] = document.add_vectors(&slopes, false).into();
        }
        attributes
    };
    let targets: Vec<Value> = track.targets.iter().map(target).collect();
    let of = |value: fn(&Target) -> Value| track.targets.iter().map(value).collect::<Vec<_>>();
    let mut primitive = json!({ "attributes": attributes, "indices": indices, "material": 0 });
    let mut mesh = json!({ "name": body.body });
    if !targets.is_empty() {
        primitive["targets"] = targets.into();
        mesh["weights"] = of(|target| (target.weight as f32).into()).into();
        mesh["extras"] = json!({
            "targetNames": of(|target| target.name.clone().into()), "targetUnits": of(|target| target.unit.clone().into())
        });
    }
    mesh["primitives"] = json!([primitive]);
    mesh
}

/// Every column as it is.
fn full(body: &BodyBasis) -> Track {
    let targets: Vec<Target> = body
        .columns
        .iter()
        .map(|column| Target {
            name: column.name.name.clone(),
            unit: column.name.unit.clone(),
            position: column.u.clone(),
            weight: column.coefficient,
        })
        .collect();
    let weights = |motion: &Motion, sign: f64| {
        let mut weights: Vec<f64> = targets.iter().map(|target| target.weight).collect();
        motion.terms.iter().for_each(|(k, weight)| weights[*k] += sign * weight);
        weights
    };
    let ends =
        motions(body).iter().flat_map(|motion| [1.0, -1.0].map(|sign| weights(motion, sign))).collect();
    Track { has_normals: true, ends, targets }
}

/// A few motions, each as two targets. Normals would take the room of as many targets again in the programs that have so few.
fn split(body: &BodyBasis) -> Track {
    let all = motions(body);
    let chosen = if body.is_chosen { all } else { few(body, &all, VIEWER_MOTIONS) };
    let target = |motion: &Motion, sign: f64| {
        let mut position = vec![Vector3::<f64>::zeros(); body.rest.len()];
        for (k, weight) in &motion.terms {
            for (sum, u) in position.iter_mut().zip(&body.columns[*k].u) {
                *sum += Vector3::from(*u).cast::<f64>() * (sign * weight);
            }
        }
        Target {
            name: format!("{} {}", motion.name, if sign > 0.0 { "+" } else { "-" }),
            unit: "1".to_owned(),
            position: position.into_iter().map(|u| u.cast::<f32>().into()).collect(),
            weight: 0.0,
        }
    };
    let targets: Vec<Target> =
        chosen.iter().flat_map(|motion| [1.0, -1.0].map(|sign| target(motion, sign))).collect();
    let alone = |k: usize| (0..targets.len()).map(|j| f64::from(u8::from(j == k))).collect();
    Track { has_normals: false, ends: (0..targets.len()).map(alone).collect(), targets }
}

/// The sampler from the first weights to each end and back.
fn sampler(document: &mut Document, track: &Track) -> Option<Value> {
    if track.ends.is_empty() {
        return None;
    }
    let first: Vec<f64> = track.targets.iter().map(|target| target.weight).collect();
    let (mut times, mut weights) = (vec![0.0], first.clone());
    for end in &track.ends {
        for step in [end, &first] {
            times.push(STRIDE_S * times.len() as f32);
            weights.extend(step);
        }
    }
    let weights: Vec<f32> = weights.into_iter().map(|weight| weight as f32).collect();
    Some(json!({
        "input": document.add_numbers(&times), "output": document.add_numbers(&weights), "interpolation": "LINEAR"
    }))
}

/// Unit normals; of a vertex without any area, one that is of unit length all the same, as glTF asks for.
fn normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut normals = vec![[0.0; 3]; positions.len()];
    vertex_normals(positions, triangles, &mut Vec::new(), &mut normals);
    normals.iter_mut().filter(|normal| **normal == [0.0; 3]).for_each(|normal| *normal = [0.0, 0.0, 1.0]);
    normals
}

/// The derivative of every vertex's unit normal by the weight of a target.
fn normal_slopes(rest: &[[f32; 3]], triangles: &[[u32; 3]], u: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![(Vector3::<f64>::zeros(), Vector3::<f64>::zeros()); rest.len()];
    for triangle in triangles {
        let of =
            |values: &[[f32; 3]]| triangle.map(|node| Vector3::from(values[node as usize]).cast::<f64>());
        let ([a, b, c], [u, v, w]) = (of(rest), of(u));
        let area = (b - a).cross(&(c - a));
        let slope = (v - u).cross(&(c - a)) + (b - a).cross(&(w - u));
        for node in triangle {
            let (sum, of_slope) = &mut sums[*node as usize];
            *sum += area;
            *of_slope += slope;
        }
    }
    let slope = |(sum, slope): (Vector3<f64>, Vector3<f64>)| match sum.try_normalize(f64::MIN_POSITIVE) {
        Some(normal) => ((slope - normal * normal.dot(&slope)) / sum.norm()).cast::<f32>().into(),
        None => [0.0; 3],
    };
    sums.into_iter().map(slope).collect()
}

/// One motion; at -1 it is the opposite one.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    pub name: String,
    /// The control element that it moves.
    pub control: Option<usize>,
    /// Columns and their coefficients at 1.
    pub terms: Vec<(usize, f64)>,
}

/// A motion moves no point by more than this part of the body's size, and changes no entry of M by more than this: a turn by
/// 20°, a stretch by 35 %. Of a flat control element half of a turn's columns vanish.
const LARGEST: f64 = 0.12;
const LARGEST_OF_M: f64 = 0.35;

/// Fields and their parts, in the order in which they are shown; rows of M turn x against y with opposite signs.
const OF_CONTROL: [(&str, &[(&str, f64)]); 9] = [
    ("shift x", &[("tx", 1.0)]),
    ("shift y", &[("ty", 1.0)]),
    ("shift z", &[("tz", 1.0)]),
    ("turn x", &[("m32", 1.0), ("m23", -1.0)]),
    ("turn y", &[("m13", 1.0), ("m31", -1.0)]),
    ("turn z", &[("m21", 1.0), ("m12", -1.0)]),
    ("stretch x", &[("m11", 1.0)]),
    ("stretch y", &[("m22", 1.0)]),
    ("stretch z", &[("m33", 1.0)]),
];

/// All motions of a body: those of control elements that hands can take first, then the others', then the loads'. Where
/// columns were chosen one by one, those are the motions. Turns are those of the linear theory, which stretches what it
/// turns.
pub fn motions(body: &BodyBasis) -> Vec<Motion> {
    let single = |k: usize| Motion {
        name: body.columns[k].name.name.clone(),
        control: match body.columns[k].name.source {
            ColumnSource::Field { control, .. } => Some(control),
            ColumnSource::Load | ColumnSource::Model => None,
        },
        terms: vec![(k, 1.0)],
    };
    let all = 0..body.columns.len();
    let mut found: Vec<Motion> = Vec::new();
    if body.is_chosen {
        found.extend(all.map(single));
    } else {
        let order = |grabbed: bool| {
            let handles = body.controls.iter().enumerate();
            handles.filter(move |(_, handle)| handle.is_grabbed == grabbed)
        };
        found.extend(order(true).chain(order(false)).flat_map(|(e, handle)| of_control(body, e, handle)));
        let is_load = |k: &usize| body.columns[*k].name.source == ColumnSource::Load;
        found.extend(all.filter(is_load).map(single));
    }
    found.retain(|motion| !motion.terms.is_empty());
    found.iter_mut().for_each(|motion| scale(body, motion));
    found
}

fn of_control(body: &BodyBasis, e: usize, handle: &Handle) -> Vec<Motion> {
    let motion = |(name, fields): &(&str, &[(&str, f64)])| {
        let term = |(field, weight): &(&str, f64)| {
            let field = FIELD_NAMES.iter().position(|known| known == field)?;
            Some((body.field(e, field)?, *weight))
        };
        Motion {
            name: format!("{} {name}", handle.rest.name),
            control: Some(e),
            terms: fields.iter().filter_map(term).collect(),
        }
    };
    OF_CONTROL.iter().map(motion).collect()
}

fn scale(body: &BodyBasis, motion: &mut Motion) {
    let reach: f64 = motion.terms.iter().map(|(k, weight)| weight.abs() * body.columns[*k].largest).sum();
    let by_size = LARGEST * body.size / reach.max(f64::MIN_POSITIVE);
    let is_of_m = |(k, _): &(usize, f64)| match body.columns[*k].name.source {
        ColumnSource::Field { field, .. } => FIELD_NAMES[field].starts_with('m'),
        ColumnSource::Load | ColumnSource::Model => false,
    };
    let most = if motion.terms.iter().any(is_of_m) { by_size.min(LARGEST_OF_M) } else { by_size };
    motion.terms.iter_mut().for_each(|(_, weight)| *weight *= most);
}

/// Chooses at most `count` motions that show most of a body: the three shifts of the first control element that a hand can take,
/// and its turn about the axis along which it lies from the body's centre.
pub fn few(body: &BodyBasis, all: &[Motion], count: usize) -> Vec<Motion> {
    let first = all.iter().find_map(|motion| motion.control);
    let Some(e) = first else { return all.iter().take(count).cloned().collect() };
    let axis = ["x", "y", "z"][body.controls[e].rest.origin.iamax()];
    let ends =
        ["shift x", "shift y", "shift z"].map(str::to_owned).into_iter().chain([format!("turn {axis}")]);
    let named =
        |end: String| all.iter().find(|motion| motion.control == Some(e) && motion.name.ends_with(&end));
    let chosen: Vec<Motion> = ends.filter_map(named).take(count).cloned().collect();
    if chosen.is_empty() { all.iter().take(count).cloned().collect() } else { chosen }
}
