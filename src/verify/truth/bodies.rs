//! Random bodies that no test and no table knows: meshes, materials, control elements and poses from a seed.
//!
//! In: a seed. Out: a [`RandomBody`]: a structured mesh of a tube or a block, mapped by smooth functions or cut by a level set; one
//! to four materials in the cells of a Voronoi diagram; two control elements at its ends; poses of one against the other.

use crate::deform::{ControlPose, ControlPoses, se3};
use crate::measure::poses::Random;
use crate::mesh::quality::{centroid, components, signed_volume};
use crate::mesh::{Block, Encoding, GenerateError, MeshError, TetMesh, Tube, block, encode, tube};
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Kind of a random body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyKind {
    /// Tubes and shells.
    Thin,
    /// Blocks and blobs.
    Compact,
    /// Straight and curved bars.
    Slender,
}

impl BodyKind {
    pub const ALL: [BodyKind; 3] = [BodyKind::Thin, BodyKind::Compact, BodyKind::Slender];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            BodyKind::Thin => "thin",
            BodyKind::Compact => "compact",
            BodyKind::Slender => "slender",
        }
    }
}

/// A material of a random body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomMaterial {
    /// Pa.
    pub young: f64,
    pub poisson: f64,
}

/// A pose of the second control element against the first one, which rests.
#[derive(Clone, Debug)]
pub struct RandomPose {
    pub name: String,
    /// Turn, °.
    pub turn: f64,
    pub poses: ControlPoses,
}

/// A body with two control elements, "low" and "high".
pub struct RandomBody {
    pub seed: u64,
    pub kind: BodyKind,
    /// Region r + 1 has material r.
    pub mesh: TetMesh,
    pub materials: Vec<RandomMaterial>,
    pub model: &'static str,
    pub poses: Vec<RandomPose>,
}

/// Models of which errors to expect are measured.
const MODELS: [&str; 7] =
    ["rotation", "reduced", "reduced_neo_hookean", "reduced", "substructured", "linear", "perturbation"];

/// Names of the control elements.
pub const CONTROLS: [&str; 2] = ["low", "high"];

/// Largest turn, °, stretch and pressing of a pose.
const TURN: f64 = 90.0;
const STRETCH: f64 = 0.1;
const PRESSING: f64 = 0.05;

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.number()
    }

    fn integer(&mut self, low: u32, high: u32) -> u32 {
        low + (self.number() * f64::from(high - low + 1)) as u32
    }
}

impl RandomBody {
    /// The body of a seed. The error is a fault of this generator.
    pub fn new(seed: u64) -> Result<RandomBody, String> {
        let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
        random.bits();
        let kind = BodyKind::ALL[(seed % 3) as usize];
        let is_first = random.number() < 0.5;
        let made = match (kind, is_first) {
            (BodyKind::Thin, true) => bent_tube(&mut random),
            (BodyKind::Thin, false) => shell(&mut random),
            (BodyKind::Compact, true) => lump(&mut random),
            (BodyKind::Compact, false) => blob(&mut random),
            (BodyKind::Slender, _) => bar(&mut random),
        };
        let mut mesh = made.map_err(|error| error.to_string())?;
        let mut materials = materials(&mut random);
        regions(&mut mesh, &mut materials, &mut random);
        let is_sound = |tet: &usize| signed_volume(&mesh.corners(*tet)) > 0.0;
        let turned = (0..mesh.tets.len()).find(|tet| !is_sound(tet));
        if let Some(tet) = turned {
            return Err(format!("tetrahedron {tet} has no positive volume"));
        }
        let origin = |name: &str| mesh.groups.get(name).and_then(|nodes| centroid(&mesh, nodes));
        let [Some(low), Some(high)] = CONTROLS.map(origin) else { return Err("an end has no nodes".into()) };
        let poses = poses(&(high - low), &mut random);
        let model = MODELS[random.integer(0, MODELS.len() as u32 - 1) as usize];
        Ok(RandomBody { seed, kind, mesh, materials, model, poses })
    }

    /// The scene, whose mesh file is `body.msh` beside it.
    pub fn scene(&self) -> String {
        let material =
            |m: &RandomMaterial| format!("{{ young = {:.6e}, poisson = {:.4} }}", m.young, m.poisson);
        let mut text = format!("[body.b]\nmesh = \"body.msh\"\nmodel = \"{}\"\n", self.model);
        for (r, own) in self.materials.iter().enumerate() {
            let key = if r == 0 { "material".to_owned() } else { format!("region.{}", r + 1) };
            text += &format!("{key} = {}\n", material(own));
        }
        for (name, grab) in CONTROLS.iter().zip(["fixed", "dragger"]) {
            text += &format!("control.{name} = {{ nodes = {{ group = \"{name}\" }}, grab = \"{grab}\" }}\n");
        }
        text
    }

    /// The bytes of the mesh file.
    pub fn mesh_file(&self) -> Result<Vec<u8>, MeshError> {
        encode(&self.mesh, Encoding::Gmsh41Binary)
    }
}

/// One to four materials within a factor of 30 of one another.
fn materials(random: &mut Random) -> Vec<RandomMaterial> {
    let base = 10f64.powf(random.between(4.0, 9.0));
    let count = random.integer(1, 4);
    let one = |_| {
        let young = base * 30f64.powf(random.between(-0.5, 0.5));
        // A quarter is nearly incompressible.
        let poisson =
            if random.number() < 0.25 { random.between(0.45, 0.49) } else { random.between(0.0, 0.45) };
        RandomMaterial { young, poisson }
    };
    (0..count).map(one).collect()
}

/// Gives every tetrahedron the material of the nearest of as many random nodes; those that get none are dropped.
fn regions(mesh: &mut TetMesh, materials: &mut Vec<RandomMaterial>, random: &mut Random) {
    let last = mesh.nodes.len() as u32 - 1;
    let seeds: Vec<Vector3<f64>> =
        materials.iter().map(|_| mesh.nodes[random.integer(0, last) as usize]).collect();
    let nearest = |tet: usize| {
        let centre = mesh.corners(tet).iter().sum::<Vector3<f64>>() / 4.0;
        let far = |r: &usize| (seeds[*r] - centre).norm_squared();
        (0..seeds.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
    };
    let of_tets: Vec<usize> = (0..mesh.tets.len()).map(nearest).collect();
    let used: Vec<usize> = (0..seeds.len()).filter(|r| of_tets.contains(r)).collect();
    let region = |r: &usize| used.binary_search(r).unwrap_or(0) as u32 + 1;
    mesh.regions = of_tets.iter().map(region).collect();
    *materials = used.iter().map(|r| materials[*r]).collect();
}

/// The centre line of a body of length l along z, at height z from its middle: an arc of the angle `bend` in a random plane, and the
/// turn of its section there.
struct Line {
    bend: f64,
    length: f64,
    about: Vector3<f64>,
}

impl Line {
    fn new(bend: f64, length: f64, random: &mut Random) -> Line {
        let (sin, cos) = random.between(0.0, TAU).sin_cos();
        Line { bend, length, about: Vector3::new(cos, sin, 0.0) }
    }

    /// The place of a point that stands at (x, y) of the section at height z.
    fn place(&self, x: f64, y: f64, z: f64) -> Vector3<f64> {
        let turn = self.about * (self.bend * z / self.length);
        let centre = se3::slide_matrix(&turn) * Vector3::z() * z;
        centre + Rotation3::from_scaled_axis(turn) * Vector3::new(x, y, 0.0)
    }
}

/// Control elements of the nodes within `layers` of cells from both ends, by heights before the mapping.
fn ends(mesh: &mut TetMesh, along: impl Fn(&Vector3<f64>) -> f64, layer: f64, layers: u32) {
    let heights: Vec<f64> = mesh.nodes.iter().map(along).collect();
    let (low, high) =
        heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), z| (a.min(*z), b.max(*z)));
    let within = (f64::from(layers) + 0.25) * layer;
    let nodes = |is: &dyn Fn(f64) -> bool| {
        (0..heights.len() as u32).filter(|node| is(heights[*node as usize])).collect::<Vec<u32>>()
    };
    mesh.groups.clear();
    mesh.groups.insert("low".into(), nodes(&|z| z - low <= within));
    mesh.groups.insert("high".into(), nodes(&|z| high - z <= within));
}

/// A tube with an elliptic, tapered section along an arc; its wall has a tenth to a third of its radius.
fn bent_tube(random: &mut Random) -> Result<TetMesh, GenerateError> {
    let (radial, around, along) = (1, 2 * random.integer(6, 8), random.integer(12, 14));
    let (wall, length) = (random.between(0.1, 0.3), random.between(4.0, 8.0));
    let mut mesh = tube(&Tube {
        inner_radius: 1.0 - wall,
        outer_radius: 1.0,
        length,
        radial,
        around,
        along,
        control_length: 0.0,
    })?;
    ends(&mut mesh, |x| x.x, length / f64::from(along), random.integer(0, 1));
    let line = Line::new(random.between(0.0, 0.8), length, random);
    let (oval, taper, size) = (random.between(0.7, 1.0), random.between(-0.25, 0.25), size(random));
    for x in &mut mesh.nodes {
        let wide = 1.0 + taper * x.x / length;
        *x = line.place(x.y * wide, x.z * wide * oval, x.x) * size;
    }
    Ok(mesh)
}

/// A curved sheet of one or two cells through its thickness.
fn shell(random: &mut Random) -> Result<TetMesh, GenerateError> {
    let is_single = random.number() < 0.5;
    let cells = match is_single {
        true => [random.integer(10, 12), 1, random.integer(14, 16)],
        false => [random.integer(8, 10), 2, random.integer(11, 13)],
    };
    let (width, length) = (random.between(0.5, 1.0), random.between(1.5, 2.2));
    let thickness = random.between(0.06, 0.12);
    let mut mesh = block(&Block { size: [width, thickness, length], cells })?;
    ends(&mut mesh, |x| x.z, length / f64::from(cells[2]), random.integer(0, 1));
    let (across, line) = (random.between(0.0, 1.2), Line::new(random.between(0.0, 0.8), length, random));
    let (saddle, size) = (random.between(-0.3, 0.3), size(random));
    for x in &mut mesh.nodes {
        // The section is an arc too, and its curvature changes along the sheet.
        let angle = (across + saddle * x.z) * x.x / width;
        let (sin, cos) = angle.sin_cos();
        let [slid, risen] = if angle.abs() < 1e-9 { [1.0, 0.0] } else { [sin / angle, (1.0 - cos) / angle] };
        let section = [x.x * slid - x.y * sin, x.x * risen + x.y * cos];
        *x = line.place(section[0], section[1], x.z) * size;
    }
    Ok(mesh)
}

/// A block, twisted, sheared and bulged.
fn lump(random: &mut Random) -> Result<TetMesh, GenerateError> {
    let cells = [random.integer(5, 6), random.integer(5, 6), random.integer(8, 10)];
    let size_of = [random.between(0.6, 1.0), random.between(0.6, 1.0), random.between(1.2, 2.0)];
    let mut mesh = block(&Block { size: size_of, cells })?;
    let length = size_of[2];
    ends(&mut mesh, |x| x.z, length / f64::from(cells[2]), random.integer(0, 1));
    let (twist, bulge) = (random.between(-0.8, 0.8), random.between(-0.3, 0.4));
    let (shear, size) = ([random.between(-0.3, 0.3), random.between(-0.3, 0.3)], size(random));
    for x in &mut mesh.nodes {
        let wide = 1.0 + bulge * (PI * x.z / length).cos();
        let (sin, cos) = (twist * x.z / length).sin_cos();
        let (a, b) = (x.x * wide, x.y * wide);
        *x = Vector3::new(cos * a - sin * b + shear[0] * x.z, sin * a + cos * b + shear[1] * x.z, x.z) * size;
    }
    Ok(mesh)
}

/// A blob: the cells of a block whose middles lie in the union of some balls along it; the surface is drawn to the level set as far
/// as no tetrahedron is turned inside out.
fn blob(random: &mut Random) -> Result<TetMesh, GenerateError> {
    let along = random.integer(9, 11);
    let cells = [7, 7, along];
    let cell = 1.0 / 7.0;
    let length = f64::from(along) * cell;
    let mut mesh = block(&Block { size: [1.0, 1.0, length], cells })?;
    let balls: Vec<(Vector3<f64>, f64)> = (0..4)
        .map(|i| {
            let z = length * (f64::from(i) / 3.0 - 0.5);
            let centre = Vector3::new(random.between(-0.12, 0.12), random.between(-0.12, 0.12), z);
            (centre, random.between(0.28, 0.42))
        })
        .collect();
    // Σ exp(1 - |x - c|²/r²) = 1 joins the balls smoothly.
    let level = |x: &Vector3<f64>| {
        balls.iter().map(|(c, r)| (1.0 - (x - c).norm_squared() / (r * r)).exp()).sum::<f64>() - 1.0
    };
    let middle = |of: usize| {
        let corners = mesh.tets[5 * of..5 * of + 5].iter().flatten().map(|node| mesh.nodes[*node as usize]);
        corners.sum::<Vector3<f64>>() / 20.0
    };
    let kept: Vec<[u32; 4]> = (0..mesh.tets.len() / 5)
        .filter(|of| level(&middle(*of)) > 0.0)
        .flat_map(|of| mesh.tets[5 * of..5 * of + 5].to_vec())
        .collect();
    mesh.tets = kept;
    mesh = largest_piece(&mesh);
    draw(&mut mesh, &level, cell);
    ends(&mut mesh, |x| x.z, cell, random.integer(0, 1));
    let size = size(random);
    mesh.nodes.iter_mut().for_each(|x| *x *= size);
    Ok(mesh)
}

/// The largest piece of a mesh that is joined by faces, without the nodes that it does not use.
fn largest_piece(mesh: &TetMesh) -> TetMesh {
    let pieces = components(mesh);
    let largest = (0..pieces.nodes.len()).max_by_key(|piece| pieces.nodes[*piece].len()).unwrap_or(0);
    let used = pieces.nodes.get(largest).cloned().unwrap_or_default();
    let number = |node: &u32| used.binary_search(node).unwrap_or(0) as u32;
    let tets: Vec<[u32; 4]> = (0..mesh.tets.len())
        .filter(|tet| pieces.of_tet[*tet] as usize == largest)
        .map(|tet| mesh.tets[tet].map(|node| number(&node)))
        .collect();
    TetMesh {
        nodes: used.iter().map(|node| mesh.nodes[*node as usize]).collect(),
        tags: (1..=used.len() as u64).collect(),
        regions: vec![0; tets.len()],
        tets,
        ..TetMesh::default()
    }
}

/// Moves the surface nodes towards the level 0 by up to 0.3 cells, and back where that makes a tetrahedron flat.
fn draw(mesh: &mut TetMesh, level: &dyn Fn(&Vector3<f64>) -> f64, cell: f64) {
    const STEP: f64 = 1e-4;
    let nodes = crate::mesh::Surface::from_mesh(mesh).nodes;
    for node in nodes {
        let at = mesh.nodes[node as usize];
        let slope = Vector3::from_fn(|axis, _| {
            let step = Vector3::ith(axis, STEP);
            (level(&(at + step)) - level(&(at - step))) / (2.0 * STEP)
        });
        let way = -slope * (level(&at) / slope.norm_squared().max(f64::MIN_POSITIVE));
        let way = way * (0.3 * cell / way.norm().max(f64::MIN_POSITIVE)).min(1.0);
        let around: Vec<usize> = (0..mesh.tets.len()).filter(|tet| mesh.tets[*tet].contains(&node)).collect();
        let is_sound = |mesh: &TetMesh| {
            around.iter().all(|tet| signed_volume(&mesh.corners(*tet)) > 0.05 * cell.powi(3))
        };
        for share in [1.0, 0.5, 0.25, 0.0] {
            mesh.nodes[node as usize] = at + way * share;
            if is_sound(mesh) {
                break;
            }
        }
    }
}

/// A bar with a rounded, tapered section along an arc, 8 to 20 times as long as it is thick.
fn bar(random: &mut Random) -> Result<TetMesh, GenerateError> {
    let across = random.integer(2, 3);
    let cells = [across, across, if across == 2 { random.integer(30, 45) } else { random.integer(20, 30) }];
    let length = random.between(8.0, 20.0);
    let flat = random.between(0.6, 1.0);
    let mut mesh = block(&Block { size: [1.0, 1.0, length], cells })?;
    ends(&mut mesh, |x| x.z, length / f64::from(cells[2]), random.integer(0, 1));
    let line = Line::new(random.between(0.0, FRAC_PI_2), length, random);
    let (round, taper, size) = (random.between(0.0, 0.8), random.between(-0.3, 0.3), size(random));
    for x in &mut mesh.nodes {
        let wide = 1.0 + taper * x.z / length;
        // From a square, whose corners reach farther, towards a disc.
        let [a, b] = [x.x * (1.0 - 1.2 * round * x.y * x.y), x.y * (1.0 - 1.2 * round * x.x * x.x)];
        *x = line.place(a * wide, b * wide * flat, x.z) * size;
    }
    Ok(mesh)
}

/// Size by which a body is scaled.
fn size(random: &mut Random) -> f64 {
    10f64.powf(random.between(-2.0, 0.0))
}

/// A bend, a twist, a stretch or a pressing, and a mixed pose; `way` leads from the first to the second control element.
fn poses(way: &Vector3<f64>, random: &mut Random) -> Vec<RandomPose> {
    let (axis, length) = (way.normalize(), way.norm());
    let aside = |random: &mut Random| {
        let v = random.direction();
        (v - axis * axis.dot(&v))
            .try_normalize(1e-3)
            .unwrap_or_else(|| axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize())
    };
    let pose = |name: String, turn: Vector3<f64>, along: f64, shift: Vector3<f64>| {
        let chord = se3::slide_matrix(&turn) * way;
        let translation = chord * (1.0 + along) - way + shift * length;
        let matrix = *Rotation3::from_scaled_axis(turn).matrix();
        let poses = vec![ControlPose::REST, ControlPose { translation, matrix }];
        RandomPose { name, turn: turn.norm().to_degrees(), poses }
    };
    let no = Vector3::zeros();
    let bend = random.between(2.0, TURN);
    let twist = random.between(2.0, TURN);
    let along =
        if random.number() < 0.5 { random.between(0.005, STRETCH) } else { -random.between(0.005, PRESSING) };
    let across = aside(random);
    let mixed = (random.between(2.0, TURN), random.direction());
    let (pulled, moved) =
        (random.between(-0.5 * PRESSING, 0.5 * STRETCH), aside(random) * random.between(0.0, 0.05));
    vec![
        pose(format!("bent {bend:.0}°"), across * bend.to_radians(), 0.0, no),
        pose(format!("twisted {twist:.0}°"), axis * twist.to_radians(), 0.0, no),
        pose(format!("along {:.1} %", 100.0 * along), no, along, no),
        pose(format!("mixed {:.0}°", mixed.0), mixed.1 * mixed.0.to_radians(), pulled, moved),
    ]
}
