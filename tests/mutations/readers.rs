//! Every reader of the program with small good files of its kind, and what is done with what it accepts.

use crate::common::block_scene;
use crate::mutate::{Random, mutated};
use crate::{meshes, surfaces};
use greenstage::deform::{ControlPose, Deformer, ROTATION, pose_file as poses};
use greenstage::green::{self, GreenFile, Requirements, STIFFNESS};
use greenstage::mesh::{
    self, Block, Order, Surface, block, diagnostics, formats, quality, surface_check, surface_files,
};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use greenstage::stage::Stage;
use greenstage::track::Script;
use std::path::Path;
use std::sync::Arc;

/// Work on an accepted file beyond reading it; its memory does not count.
pub type Then = Option<Box<dyn FnOnce()>>;

/// A reader of a file's name, which determines the format, and its bytes.
type Read = dyn Fn(&Path, &[u8]) -> Then + Sync;

pub struct Reader {
    pub name: &'static str,
    /// Names, which determine the format, and bytes of good files.
    pub seeds: Vec<(String, Vec<u8>)>,
    /// Damages a seed; the second is another of them.
    pub damage: fn(&[u8], &[u8], &mut Random) -> Vec<u8>,
    pub read: Box<Read>,
    /// Takes far longer than the others.
    pub is_dear: bool,
    /// Bytes of memory that reading may take whatever the file's size, and for each of its bytes.
    pub constant: usize,
    pub per_byte: usize,
}

impl Reader {
    fn new(
        name: &'static str,
        seeds: Vec<(String, Vec<u8>)>,
        read: impl Fn(&Path, &[u8]) -> Then + Sync + 'static,
    ) -> Reader {
        assert!(!seeds.is_empty(), "{name}");
        for (seed, bytes) in &seeds {
            assert!(read(Path::new(seed), bytes).is_some(), "{seed} is a good file");
        }
        Reader {
            name,
            seeds,
            damage: mutated,
            read: Box::new(read),
            is_dear: false,
            constant: 16 << 10,
            per_byte: 20,
        }
    }
}

/// All readers; `folder` is for those that read from the disk.
pub fn readers(folder: &Path) -> Vec<Reader> {
    let mut readers = Vec::new();
    let of = |ending: &str, all: &[(String, Vec<u8>)]| -> Vec<(String, Vec<u8>)> {
        all.iter().filter(|(name, _)| name.to_lowercase().ends_with(ending)).cloned().collect()
    };
    let tets = mesh_seeds(folder);
    for (name, ending) in [
        ("Gmsh", ".msh"),
        ("VTK", ".vtk"),
        ("VTU", ".vtu"),
        ("TetGen nodes", ".node"),
        ("TetGen elements", ".ele"),
        ("Abaqus", ".inp"),
        ("Medit", ".mesh"),
        ("Vega", ".veg"),
    ] {
        readers.push(Reader::new(name, of(ending, &tets), read_mesh));
    }
    // Of compressed arrays the unpacked bytes count, 64 for one at most.
    readers[2].per_byte *= 64;
    let shells: Vec<(String, Vec<u8>)> =
        surfaces::samples().into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).collect();
    for (name, ending) in [("STL", ".stl"), ("OBJ", ".obj"), ("PLY", ".ply")] {
        readers.push(Reader::new(name, of(ending, &shells), read_surface));
    }
    readers.push(Reader::new("scene", examples("scene"), |path, bytes| {
        Scene::parse(&String::from_utf8_lossy(bytes), path).ok().map(|_| Box::new(|| ()) as _)
    }));
    readers.push(Reader::new("stage", examples("stage"), |path, bytes| {
        let stage = Stage::parse(&String::from_utf8_lossy(bytes), path).ok()?;
        Some(Box::new(move || drop((stage.seams(), stage.screens_from_top(), format!("{stage:?}")))))
    }));
    readers.push(Reader::new("script", examples("script"), read_script));
    readers.push(Reader::new("poses", examples("poses"), |path, bytes| {
        poses::parse(&String::from_utf8_lossy(bytes), path).ok().map(|_| Box::new(|| ()) as _)
    }));
    // The parser's tree of brackets; such files are refused beyond 16 MiB.
    let toml = readers.len() - 4;
    readers[toml..].iter_mut().for_each(|reader| reader.per_byte = 200);
    let greens: Vec<(String, Vec<u8>)> = ["f32", "int16", "f16"]
        .map(|storage| (format!("{storage}.green"), green_seed(folder, storage)))
        .to_vec();
    let packed =
        greens.iter().map(|(name, bytes)| (format!("{name}.zst"), green::packed(bytes).unwrap())).collect();
    let own = |ending: &str| {
        let folder = folder.to_owned();
        let ending = ending.to_owned();
        move || folder.join(format!("{:?}{ending}", std::thread::current().id()))
    };
    let (path, unpacked) = (own(".green"), own(".green.zst"));
    let read = move |_: &Path, bytes: &[u8]| {
        std::fs::write(path(), bytes).unwrap();
        read_green(&path())
    };
    readers.push(Reader { damage: damage_green, is_dear: true, ..Reader::new(".green", greens, read) });
    let path = own(".green");
    let read = move |_: &Path, bytes: &[u8]| {
        std::fs::write(unpacked(), bytes).unwrap();
        green::unpack(&unpacked(), &path()).ok()?;
        read_green(&path())
    };
    // A block of zstd has 128 KiB; what came out is read back, to be checked before it is put in its place.
    let read = Reader { is_dear: true, constant: 192 << 10, ..Reader::new(".green.zst", packed, read) };
    readers.push(Reader { damage: damage_packed, ..read });
    readers
}

/// Small meshes of every format, with groups and regions where it has them. Of a TetGen pair one file lies in `folder`.
fn mesh_seeds(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut seeds = meshes::all();
    seeds.extend(meshes::quadratic());
    let mut mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
    mesh.regions[2] = 7;
    mesh.region_names.insert(7, "core".into());
    for writer in formats::writers() {
        for ((extension, _), bytes) in writer.files.iter().zip((writer.encode)(&mesh).unwrap().files) {
            let path = folder.join(format!("{}.{extension}", writer.name));
            std::fs::write(&path, &bytes).unwrap();
            seeds.push((path.to_str().unwrap().to_owned(), bytes));
        }
    }
    seeds
}

fn read_mesh(path: &Path, bytes: &[u8]) -> Then {
    // One or the other: both would take twice the time.
    let order = if bytes.len().is_multiple_of(2) { Order::Linear } else { Order::Quadratic };
    let mesh = mesh::parse_as(path, bytes, order).ok()?.mesh;
    Some(Box::new(move || {
        let surface = Surface::from_mesh(&mesh);
        drop((quality::report(&mesh, &surface), diagnostics::find(&mesh)));
    }))
}

fn read_surface(path: &Path, bytes: &[u8]) -> Then {
    let mut loaded = surface_files::parse(path, bytes).ok()?;
    Some(Box::new(move || drop(surface_check::check(&mut loaded.surface, &mut loaded.notices))))
}

fn read_script(path: &Path, bytes: &[u8]) -> Then {
    let script = Script::parse(&String::from_utf8_lossy(bytes), path).ok()?;
    Some(Box::new(move || {
        let stage = Stage::find("workbench").unwrap();
        [-1.0, 0.0, 0.3, 1e3].into_iter().for_each(|time_s| drop(script.sample(&stage, time_s)));
    }))
}

fn read_green(path: &Path) -> Then {
    let file = Arc::new(GreenFile::open(path).ok()?);
    Some(Box::new(move || {
        for body in file.meta.bodies.keys() {
            let Ok(mut deformer) = Deformer::new(file.clone(), body, &ROTATION) else { continue };
            let mut poses = vec![ControlPose::REST; deformer.controls.len()];
            poses.iter_mut().for_each(|pose| pose.translation.x = 0.1);
            deformer.evaluate(&poses);
            drop((deformer.wrenches(), file.tensors().count()));
        }
    }))
}

/// A block's .green file with all that one can hold.
fn green_seed(folder: &Path, storage: &str) -> Vec<u8> {
    let scene = block_scene([1, 1, 1], &format!("effects = [\"haptics\"]\nstorage = \"{storage}\""));
    let path = folder.join("seed.green");
    let body = green::precompute(&scene, "block", &Requirements::new(&[STIFFNESS]), &Silent).unwrap();
    green::write(&path, &[body]).unwrap();
    std::fs::read(&path).unwrap()
}

/// Damage as it comes, which zstd finds; or damage to what it unpacks to.
fn damage_packed(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let unpacked = |bytes: &[u8]| zstd::decode_all(bytes).unwrap();
    match random.below(2) {
        0 => mutated(seed, other, random),
        _ => zstd::encode_all(&mutated(&unpacked(seed), &unpacked(other), random)[..], 1).unwrap(),
    }
}

/// Damage as it comes, which the hashes find; or damage to the numbers or the metadata that is hashed anew, as a forger
/// would do it, and which only the checks behind the hashes can find.
fn damage_green(seed: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    match random.below(3) {
        0 => mutated(seed, other, random),
        which => forged(seed, which == 1, random).unwrap_or_else(|| mutated(seed, other, random)),
    }
}

fn forged(seed: &[u8], metadata: bool, random: &mut Random) -> Option<Vec<u8>> {
    let length = u64::from_le_bytes(seed[..8].try_into().ok()?) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&seed[8..8 + length]).ok()?;
    let mut data = seed[8 + length..].to_vec();
    let sealed: serde_json::Value =
        serde_json::from_str(header["__metadata__"]["greenstage"].as_str()?).ok()?;
    let mut content = sealed["content"].clone();
    let text = if metadata {
        let text = content.to_string();
        String::from_utf8_lossy(&mutated(text.as_bytes(), text.as_bytes(), random)).into_owned()
    } else {
        let tensors = header.as_object()?.iter().filter(|(name, _)| *name != "__metadata__");
        let (name, tensor) = tensors.clone().nth(random.below(tensors.count()))?;
        let offset = |which: usize| tensor["data_offsets"][which].as_u64().map(|at| at as usize);
        let range = offset(0)?..offset(1)?;
        let mut part = mutated(&data[range.clone()], &data, random);
        part.resize(range.len(), 0);
        content["blake3"][name] = blake3::hash(&part).to_hex().to_string().into();
        data[range].copy_from_slice(&part);
        content.to_string()
    };
    let seal = blake3::hash(text.as_bytes()).to_hex().to_string();
    header["__metadata__"]["greenstage"] = format!("{{\"blake3\":\"{seal}\",\"content\":{text}}}").into();
    let header = header.to_string();
    Some([&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &data].concat())
}

/// The manual's and the package's own files of a kind.
fn examples(kind: &str) -> Vec<(String, Vec<u8>)> {
    let texts: &[&str] = match kind {
        "scene" => &[
            include_str!("../../configs/scenes/tube.toml"),
            "[body.a]\nmesh = \"a.stl\"\ntetrahedralise = { cell = 0.1 }\nmaterial = { young = 1e6, poisson = 0.3 }\n\
             region.core = { young = 2e11, poisson = 0.3, density = 1e3 }\nsolver = { method = \"pcg\" }\n\
             place = { position = [0.0, 1.0, 0.5], scale = 0.5 }\n[body.a.control.c]\ngrab = \"fixed\"\n\
             nodes = { plane = { point = [0.5, 0.0, 0.0], normal = [1.0, 0.0, 0.0], distance = 0.001 } }\n\
             [body.a.control.d]\ngrab = \"dragger\"\nnodes = { grow = { from = [0.5, 0.0, 0.0], radius = 0.1 } }\n",
        ],
        "stage" => &[
            include_str!("../../configs/stages/workbench.toml"),
            include_str!("../../configs/stages/cyberstage.toml"),
            include_str!("../../configs/stages/desktop.toml"),
        ],
        "script" => &[include_str!("../../configs/scripts/bend.toml")],
        _ => &[
            "[[pose]]\nname = \"a\"\ncontrol.c = { translation = [0.1, 0, 0], matrix = [[1, 0, 0], [0, 1, 0], \
              [0, 0, 1]] }\n[[pose]]\nname = \"b\"\nbody = \"tube\"\n",
        ],
    };
    texts.iter().zip(0..).map(|(text, i)| (format!("{kind}{i}.toml"), text.as_bytes().to_vec())).collect()
}
