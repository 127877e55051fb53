//! Helpers that several integration tests share.
#![allow(dead_code, reason = "each test file uses some of them")]

use greenstage::deform::ControlPose;
use greenstage::green::{CUBIC, Requirements, STIFFNESS};
use greenstage::mesh::{self, Surface, TetMesh, generate, quality::signed_volume};
use greenstage::scene::Scene;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// Column families of an effect with forces.
pub static HAPTICS: LazyLock<Requirements> = LazyLock::new(|| Requirements::new(&[STIFFNESS, CUBIC]));

/// The folder of independently computed cases beside the project, where there is one; else says that it skips.
pub fn shared(what: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(what);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: {} is not on this machine", path.display());
    None
}

/// A scene from text, with the package's folder as its place.
pub fn scene(text: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("test.toml");
    Scene::parse(text, &path).unwrap()
}

/// Does the same with each of these, in a thread for each.
pub fn side_by_side<T: Sync>(all: &'static [T], each: impl Fn(&'static T) + Sync) {
    std::thread::scope(|scope| {
        for one in all {
            scope.spawn(|| each(one));
        }
    });
}

/// A scene's text: a cube of side 1 about the origin, held at two faces.
pub fn block_text([i, j, k]: [u32; 3], extra: &str) -> String {
    format!(
        r#"
[body.block]
generate = {{ block = {{ size = [1.0, 1.0, 1.0], cells = [{i}, {j}, {k}] }} }}
material = {{ young = 1.0e3, poisson = 0.3 }}
{extra}
[body.block.control.high]
nodes = {{ group = "xmax" }}
grab = "dragger"
[body.block.control.low]
nodes = {{ group = "xmin" }}
grab = "fixed"
"#
    )
}

pub fn block_scene(cells: [u32; 3], extra: &str) -> Scene {
    scene(&block_text(cells, extra))
}

/// The text with some of its characters replaced by others.
pub fn damaged(text: &str, from: &proptest::sample::Index, length: usize, filling: &str) -> String {
    let text: Vec<char> = text.chars().collect();
    let start = from.index(text.len());
    let end = (start + length).min(text.len());
    text[..start].iter().copied().chain(filling.chars()).chain(text[end..].iter().copied()).collect()
}

/// Sum of the tetrahedra, m³.
pub fn tet_volume(mesh: &TetMesh) -> f64 {
    (0..mesh.tets.len()).map(|tet| signed_volume(&mesh.corners(tet))).sum()
}

/// Each edge is run through once in each direction; returns V - E + F.
pub fn euler_characteristic_of_closed(surface: &Surface) -> i64 {
    let mut directed: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for &[a, b, c] in &surface.triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            *directed.entry(edge).or_default() += 1;
        }
    }
    for (&(a, b), &count) in &directed {
        assert_eq!(count, 1, "edge {a}-{b} is run through {count} times");
        assert!(directed.contains_key(&(b, a)), "edge {a}-{b} has one side only");
    }
    surface.nodes.len() as i64 - directed.len() as i64 / 2 + surface.triangles.len() as i64
}

/// An empty folder for one test.
pub fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// A pose that differs from rest in everything.
pub fn some_pose(seed: f64) -> ControlPose {
    let mut pose = ControlPose::REST;
    for i in 0..3 {
        pose.translation[i] = 0.1 * (seed + i as f64).sin();
        for j in 0..3 {
            pose.matrix[(i, j)] += 0.1 * (seed + 3.0 * i as f64 + j as f64).cos();
        }
    }
    pose
}

/// Rows of a CSV file with a heading: the first `keys` cells, and the numbers after them.
pub fn csv_rows(path: &Path, keys: usize) -> Vec<(String, Vec<f64>)> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        (cells[..keys].join(","), cells[keys..].iter().map(|cell| cell.parse().unwrap()).collect())
    };
    text.lines().skip(1).map(row).collect()
}

#[derive(serde::Deserialize)]
struct PoseFile {
    pose: Vec<FilePose>,
}

#[derive(serde::Deserialize)]
struct FilePose {
    name: String,
    control: BTreeMap<String, Affine>,
}

#[derive(serde::Deserialize)]
struct Affine {
    translation: [f64; 3],
    matrix: [[f64; 3]; 3],
}

/// The poses of a case's poses.toml: by name, those of the control elements that the file names.
pub fn case_poses(folder: &Path) -> Vec<(String, BTreeMap<String, ControlPose>)> {
    let file: PoseFile = greenstage::config::load(&folder.join("poses.toml")).unwrap();
    let of = |Affine { translation, matrix }: Affine| ControlPose {
        translation: translation.into(),
        matrix: nalgebra::Matrix3::from_fn(|i, j| matrix[i][j]),
    };
    let named =
        |pose: FilePose| (pose.name, pose.control.into_iter().map(|(name, a)| (name, of(a))).collect());
    file.pose.into_iter().map(named).collect()
}

/// A folder with the mesh `block.msh` of 3 × 2 × 2 cells, a scene and poses.
pub fn project(name: &str, encoding: Option<&str>, scene: &str, poses: &str) -> PathBuf {
    let folder = folder(name);
    let block = generate::block(&generate::Block { size: [1.0; 3], cells: [3, 2, 2] }).unwrap();
    mesh::save(&folder.join("block.msh"), &block, encoding).unwrap();
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    std::fs::write(folder.join("poses.toml"), poses).unwrap();
    folder
}

/// The program with these arguments, to be run in `folder`.
pub fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_greenstage"));
    command.current_dir(folder).args(arguments);
    command
}

/// The text that the program wrote to one of its streams.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the program in `folder`, and may fail.
pub fn attempt(folder: &Path, arguments: &[&str]) -> Output {
    program(folder, arguments).output().unwrap()
}

/// Runs the program in `folder`; what it said is in the panic if it failed.
pub fn greenstage(folder: &Path, arguments: &[&str]) -> Output {
    let output = attempt(folder, arguments);
    let said = text(&output.stderr);
    assert!(output.status.success(), "greenstage {arguments:?}: {}\n{said}", output.status);
    output
}

/// The demo's scene and script copied into `folder`, so that its .green file goes there; its tube has 1,920 nodes
/// instead of 10,080.
pub fn coarse_demo(folder: &Path) -> PathBuf {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let read = |name: &str| std::fs::read_to_string(configs.join(name)).unwrap();
    let (fine, coarse) = ("radial = 3, around = 40, along = 62", "radial = 2, around = 20, along = 31");
    let scene = read("scenes/tube.toml");
    assert!(scene.contains(fine) && scene.contains("script = \"bend\""));
    let scene = scene.replace(fine, coarse).replace("script = \"bend\"", "script = \"bend.toml\"");
    std::fs::write(folder.join("bend.toml"), read("scripts/bend.toml")).unwrap();
    std::fs::write(folder.join("tube.toml"), scene).unwrap();
    folder.join("tube.toml")
}
