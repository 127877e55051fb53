//! `greenstage export`: what other programs find in its files, against `deform` and by each format's own rules.

mod inventor;

use crate::common::{attempt, csv_rows, folder, greenstage, text};
use inventor::Inventor;
use nalgebra::{Matrix3, Rotation3, Vector3};
use safetensors::SafeTensors;
use std::path::{Path, PathBuf};
use std::process::Command;

type V3 = Vector3<f64>;

/// Int16, so that scales count; gravity, so that loads have columns; away from the origin.
const SCENE: &str = r#"
[body.part]
generate = { block = { size = [1.0, 0.2, 0.3], cells = [6, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3, density = 1000.0 }
storage = "int16"
gravity = [0.0, -9.81, 0.0]
control.left = { nodes = { group = "xmin" }, grab = "fixed" }
control.right = { nodes = { box = { min = [0.3, -1.0, -1.0], max = [1.0, 1.0, 1.0] } }, grab = "dragger" }
"#;

/// T of the Python program in the manual, and its M.
const POSES: &str = r#"
[[pose]]
name = "both"
control.left = { translation = [0.0, 0.02, -0.01], matrix = [[1.0, 0.05, 0.0], [0.0, 1.1, 0.2], [0.0, 0.0, 0.9]] }
control.right = { translation = [0.03, 0.1, 0.0], matrix = [[1.1, 0.2, 0.3], [-0.2, 0.9, 0.05], [0.1, 0.0, 1.05]] }
[[pose]]
name = "python"
load.gravity = [0.0, 0.0, 0.0]
control.right = { translation = [0.01, 0.0, 0.0], matrix = [[1.0, -0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]] }
"#;

fn part(name: &str) -> PathBuf {
    let place = folder(name);
    std::fs::write(place.join("part.toml"), SCENE).unwrap();
    std::fs::write(place.join("poses.toml"), POSES).unwrap();
    place
}

fn export(place: &Path, arguments: &[&str]) -> String {
    text(&greenstage(place, &[&["export", "part.toml"], arguments].concat()).stdout)
}

/// Displacements of the surface nodes in a pose, by `deform`.
fn deformed(place: &Path, pose: &str) -> Vec<V3> {
    greenstage(place, &["deform", "part.toml", "--poses", "poses.toml", "-o", "deformed"]);
    let rows = csv_rows(&place.join("deformed.csv"), 2);
    let own = rows.iter().filter(|(label, _)| label.split(',').next() == Some(pose));
    own.map(|(_, u)| V3::from_column_slice(u)).collect()
}

fn largest_difference(a: &[V3], b: &[V3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Whether a program can be run; says that the check is left out if not.
fn has(program: &str, arguments: &[&str]) -> bool {
    let found = Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("SKIPPED: `{program} {}` does not run on this machine", arguments.join(" "));
    }
    found
}

fn displaced(file: &Inventor) -> Vec<V3> {
    let rest = file.value("part_rest", "point").vectors();
    file.value("part_live", "point").vectors().iter().zip(rest).map(|(x, rest)| x - rest).collect()
}

#[test]
fn inventors_live_sum_is_the_pose_and_its_dragger_moves_the_control_element() {
    let place = part("export-inventor");
    let said = export(&place, &["--poses", "poses.toml", "--pose", "both", "-o", "out/part.iv"]);
    assert!(said.contains("24 columns") && said.contains("zero: left.m11, left.m21, left.m31"), "{said}");
    let written = std::fs::read_to_string(place.join("out/part.iv")).unwrap();
    let file = Inventor::read(&written);
    let u = deformed(&place, "both");
    let off = largest_difference(&displaced(&file), &u);
    assert!(off < 1e-7, "{off}");
    // Every column has its shape, of the size that its own field says.
    let (rest, column) =
        (file.value("part_rest", "point").vectors(), file.value("right_ty_column", "point").vectors());
    let amount = file.written("right_ty_shape", "a")[0];
    assert_eq!(
        (file.kinds("Text2"), file.kinds("TransformerDragger")),
        (24, 1),
        "m11, m21 and m31 of flat ends are zero"
    );
    let shape: Vec<V3> = rest.iter().zip(&column).map(|(x, u)| x + u * amount).collect();
    assert!(largest_difference(&file.engine("right_ty_shape", "oA").vectors(), &shape) < 1e-12);

    // At rest but for the dragger: T, and a turn after a stretch, which `deform` gets as a matrix.
    export(&place, &["-o", "out/rest.iv"]);
    let written = std::fs::read_to_string(place.join("out/rest.iv")).unwrap();
    let scale: f64 = {
        let dragger = written.find("DEF right_dragger").unwrap();
        let before = &written[written[..dragger].rfind("scaleFactor").unwrap()..];
        before.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    let (t, axis, angle, s) =
        (V3::new(0.02, -0.04, 0.1), V3::new(0.6, 0.0, 0.8), 0.3, V3::new(1.1, 0.9, 1.2));
    let held = t / scale;
    let dragged = written.replace(
        "TransformerDragger { }",
        &format!(
            "TransformerDragger {{ translation {} {} {} rotation {} {} {} {angle} scaleFactor {} {} {} }}",
            held.x, held.y, held.z, axis.x, axis.y, axis.z, s.x, s.y, s.z
        ),
    );
    assert_ne!(dragged, written);
    let m = Rotation3::from_scaled_axis(axis * angle).matrix() * Matrix3::from_diagonal(&s);
    let row = |i: usize| format!("[{:?}, {:?}, {:?}]", m[(i, 0)], m[(i, 1)], m[(i, 2)]);
    let pose = format!(
        "[[pose]]\nname = \"dragged\"\nload.gravity = [0, 0, 0]\ncontrol.right = {{ translation = [{:?}, {:?}, {:?}], \
         matrix = [{}, {}, {}] }}\n",
        t.x,
        t.y,
        t.z,
        row(0),
        row(1),
        row(2)
    );
    std::fs::write(place.join("poses.toml"), pose).unwrap();
    let expected = deformed(&place, "dragged");
    let off = largest_difference(&displaced(&Inventor::read(&dragged)), &expected);
    assert!(off < 1e-7, "{off}");
    by_inventor_itself(&place, &[(&place.join("out/part.iv"), &u)], &dragged, &expected);
}

/// `ivcat` evaluates the engines and writes what they come to, to six digits; `ivfix` takes the file.
fn by_inventor_itself(place: &Path, files: &[(&Path, &[V3])], dragged: &str, expected: &[V3]) {
    if !has("ivcat", &["-h"]) && !Path::new("/usr/bin/ivcat").exists() {
        return;
    }
    let dragged_path = place.join("out/dragged.iv");
    std::fs::write(&dragged_path, dragged).unwrap();
    for (path, u) in files.iter().copied().chain([(dragged_path.as_path(), expected)]) {
        let output = Command::new("ivcat").arg(path).output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{}", text(&output.stderr));
        let written = text(&output.stdout);
        let points = |name: &str| {
            let from = written.find(&format!("DEF {name}")).unwrap();
            let list = written[from..].split_once('[').unwrap().1.split_once(']').unwrap().0;
            let numbers: Vec<f64> =
                list.replace(',', " ").split_whitespace().map(|word| word.parse().unwrap()).collect();
            numbers.chunks_exact(3).map(V3::from_column_slice).collect::<Vec<_>>()
        };
        let live: Vec<V3> =
            points("part_live").iter().zip(points("part_rest")).map(|(x, rest)| x - rest).collect();
        let off = largest_difference(&live, u);
        assert!(off < 5e-6, "{}: {off}", path.display());
        let fixed = Command::new("ivfix").arg(path).arg(place.join("out/fixed.iv")).output().unwrap();
        assert!(fixed.status.success() && fixed.stderr.is_empty(), "{}", text(&fixed.stderr));
    }
}

/// A .glb file by its specification: the document, and the numbers of an accessor.
struct Glb {
    root: serde_json::Value,
    binary: Vec<u8>,
}

impl Glb {
    fn read(path: &Path) -> Glb {
        let bytes = std::fs::read(path).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let binary = 20 + word(12);
        Glb {
            root: serde_json::from_slice(&bytes[20..binary]).unwrap(),
            binary: bytes[binary + 8..binary + 8 + word(binary)].to_vec(),
        }
    }

    fn numbers(&self, accessor: &serde_json::Value) -> Vec<f64> {
        let accessor = &self.root["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &self.root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let (start, length) = (view["byteOffset"].as_u64().unwrap(), view["byteLength"].as_u64().unwrap());
        let bytes = &self.binary[start as usize..(start + length) as usize];
        bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap()).into()).collect()
    }

    fn vectors(&self, accessor: &serde_json::Value) -> Vec<V3> {
        self.numbers(accessor).chunks_exact(3).map(V3::from_column_slice).collect()
    }

    fn names(&self) -> Vec<&str> {
        let names = self.root["meshes"][0]["extras"]["targetNames"].as_array().unwrap();
        names.iter().map(|name| name.as_str().unwrap()).collect()
    }
}

#[test]
fn the_weights_of_the_morph_targets_are_the_coefficients() {
    let place = part("export-gltf");
    export(&place, &["--poses", "poses.toml", "--pose", "both", "-o", "part.glb"]);
    let glb = Glb::read(&place.join("part.glb"));
    let mesh = &glb.root["meshes"][0];
    let weights: Vec<f64> = mesh["weights"].as_array().unwrap().iter().map(|w| w.as_f64().unwrap()).collect();
    let names = glb.names();
    let weight = |name: &str| weights[names.iter().position(|known| *known == name).unwrap()];
    assert_eq!(
        (weight("right.m12") as f32, weight("left.tz") as f32, weight("gravity.y") as f32),
        (0.2, -0.01, -9.81)
    );
    let targets = mesh["primitives"][0]["targets"].as_array().unwrap();
    assert_eq!((targets.len(), names.len()), (weights.len(), weights.len()));
    let u = deformed(&place, "both");
    let mut sum = vec![V3::zeros(); u.len()];
    for (target, weight) in targets.iter().zip(&weights) {
        for (sum, u) in sum.iter_mut().zip(glb.vectors(&target["POSITION"])) {
            *sum += u * *weight;
        }
    }
    assert!(largest_difference(&sum, &u) < 1e-7);
    // The derivative of the normals, by that of a body a little moved.
    let attributes = &mesh["primitives"][0]["attributes"];
    let (rest, normals) = (glb.vectors(&attributes["POSITION"]), glb.vectors(&attributes["NORMAL"]));
    let indices: Vec<u32> = {
        let bits = glb.numbers(&mesh["primitives"][0]["indices"]);
        bits.iter().map(|number| (*number as f32).to_bits()).collect()
    };
    let target = &targets[names.iter().position(|name| *name == "right.m12").unwrap()];
    let (move_by, slopes) = (glb.vectors(&target["POSITION"]), glb.vectors(&target["NORMAL"]));
    let unit_normals = |step: f64| {
        let place = |node: u32| rest[node as usize] + move_by[node as usize] * step;
        let mut sums = vec![V3::zeros(); rest.len()];
        for corners in indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|k| place(corners[k]));
            corners.iter().for_each(|node| sums[*node as usize] += (b - a).cross(&(c - a)));
        }
        sums.into_iter().map(|sum| sum.normalize()).collect::<Vec<_>>()
    };
    assert!(largest_difference(&unit_normals(0.0), &normals) < 1e-6);
    let step = 1e-4;
    let differences: Vec<V3> = unit_normals(step)
        .iter()
        .zip(unit_normals(-step))
        .map(|(ahead, behind)| (ahead - behind) / (2.0 * step))
        .collect();
    let size = slopes.iter().map(V3::norm).fold(0.0, f64::max);
    assert!(size > 0.1 && largest_difference(&differences, &slopes) < 1e-5 * size);
    // The animation begins and ends in the pose, and takes all weights through time that grows.
    let sampler = &glb.root["animations"][0]["samplers"][0];
    let (times, values) = (glb.numbers(&sampler["input"]), glb.numbers(&sampler["output"]));
    assert_eq!(values.len(), times.len() * weights.len());
    assert!(times.is_sorted_by(|a, b| a < b) && times[0] == 0.0 && times.len() > 20);
    for at in [&values[..weights.len()], &values[values.len() - weights.len()..]] {
        assert!(at.iter().zip(&weights).all(|(a, b)| (a - b).abs() < 1e-6));
    }
    let turned = values.iter().filter(|weight| **weight == f64::from(0.35_f32)).count();
    assert!(turned > 0, "a turn reaches 20°");
}

#[test]
fn a_viewer_of_eight_weights_gets_each_motion_forwards_and_backwards() {
    let place = part("export-viewer");
    export(&place, &["--profile", "viewer", "-o", "web.glb"]);
    let glb = Glb::read(&place.join("web.glb"));
    let names = glb.names();
    assert_eq!((names.len(), names[0], names[7]), (8, "right shift x +", "right turn x -"));
    let targets = glb.root["meshes"][0]["primitives"][0]["targets"].as_array().unwrap();
    for (pair, two) in targets.chunks_exact(2).zip(names.chunks_exact(2)) {
        assert!(pair.iter().all(|target| target.get("NORMAL").is_none()));
        let [there, back] = [0, 1].map(|k| glb.vectors(&pair[k]["POSITION"]));
        assert!(there.iter().zip(&back).all(|(a, b)| *a == -b), "{two:?}");
        let largest = there.iter().map(V3::norm).fold(0.0, f64::max);
        assert!(largest > 0.01 && largest < 0.121, "{two:?} moves by {largest} m");
    }
    let sampler = &glb.root["animations"][0]["samplers"][0];
    assert!(glb.numbers(&sampler["output"]).iter().all(|weight| (0.0..=1.0).contains(weight)));
    refuse(&place, &["--profile", "viewer", "-o", "web.iv"], &["--profile viewer", "OUT.glb"]);
    let posed = ["--profile", "viewer", "--poses", "poses.toml", "--pose", "both", "-o", "web.glb"];
    refuse(&place, &posed, &["leave --poses out"]);
}

/// Expects exit status 2 and all of `expected` in the message.
fn refuse(place: &Path, arguments: &[&str], expected: &[&str]) {
    let output = attempt(place, &[&["export", "part.toml"], arguments].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    expected.iter().for_each(|part| assert!(said.contains(part), "{arguments:?}: {said}"));
}

#[test]
fn what_cannot_be_written_is_refused_with_what_to_do() {
    let place = part("export-refused");
    std::fs::write(place.join("other.stl"), "solid of somebody else\nendsolid\n").unwrap();
    refuse(&place, &["-o", "part.dae"], &["part.dae: the extension says", ".iv, .glb, .vtu, ", ".obj"]);
    let by = "by `greenstage deform part.toml --poses poses.toml -o x.csv`; export writes .iv, ";
    refuse(&place, &["--poses", "poses.toml", "-o", "x.csv"], &["the displacements of poses", by]);
    refuse(&place, &["-o", "other.stl"], &["is not overwritten"]);
    refuse(&place, &["-o", "x.iv", "--body", "pat"], &["did you mean \"part\"?"]);
    refuse(&place, &["-o", "x.stl", "--columns", "right.tx"], &["--columns"]);
    refuse(&place, &["-o", "x.stl", "--poses", "poses.toml"], &["--pose NAME", "both, python"]);
    refuse(&place, &["-o", "x.iv", "--columns", "right.m14"], &["unknown column", "right.m13"]);
    assert!(!place.join("part.green").exists(), "nothing is solved for what cannot be written");
    let few = ["-o", "x.iv", "--columns", "right.tx", "--poses", "poses.toml", "--pose", "python"];
    refuse(&place, &few, &["add right.m12,right.m21 to --columns"]);
    let scene =
        SCENE.replace("gravity = [0.0, -9.81, 0.0]", "model = \"stvk\"").replace("storage = \"int16\"", "");
    std::fs::write(place.join("part.toml"), &scene).unwrap();
    refuse(&place, &["-o", "x.glb"], &["\"stvk\" has no columns", "OUT.stl", "model = \"linear\""]);
    assert!(!place.join("x.iv").exists() && !place.join("x.glb").exists());
    // Effects may need columns, and the model still sums none.
    // An earlier refusal came after solving.
    std::fs::remove_file(place.join("part.green")).unwrap();
    std::fs::write(place.join("part.toml"), scene.replace("material", "effects = [\"haptics\"]\nmaterial"))
        .unwrap();
    refuse(&place, &["-o", "x.glb"], &["\"stvk\" has no columns", "OUT.stl", "--pose"]);
    assert!(!place.join("x.glb").exists() && !place.join("part.green").exists());
    // Its surface can be written.
    export(&place, &["-o", "rest.ply"]);
    assert!(std::fs::read(place.join("rest.ply")).unwrap().starts_with(b"ply\n"));
}

/// The arrays of a .vtu file, by name.
fn vtu_vectors(path: &Path) -> Vec<(String, Vec<V3>)> {
    let text = std::fs::read_to_string(path).unwrap();
    let arrays = text.split("<DataArray type=\"Float64\" Name=\"").skip(1);
    arrays
        .map(|array| {
            let (name, rest) = array.split_once('"').unwrap();
            let data = rest.split_once('>').unwrap().1.split_once('<').unwrap().0;
            let mut bits = data.bytes().take_while(|byte| *byte != b'=').map(|byte| {
                b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
                    .iter()
                    .position(|known| *known == byte)
                    .unwrap()
            });
            let mut bytes = Vec::new();
            while let (Some(first), Some(second)) = (bits.next(), bits.next()) {
                let (third, fourth) = (bits.next().unwrap_or(0), bits.next().unwrap_or(0));
                let all = first << 18 | second << 12 | third << 6 | fourth;
                bytes.extend([all >> 16, all >> 8, all].map(|byte| byte as u8));
            }
            let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
            let numbers: Vec<f64> = bytes[8..8 + length]
                .chunks_exact(8)
                .map(|eight| f64::from_le_bytes(eight.try_into().unwrap()))
                .collect();
            (name.to_owned(), numbers.chunks_exact(3).map(V3::from_column_slice).collect())
        })
        .collect()
}

#[test]
fn vtk_gets_a_vector_for_every_column_and_a_choice_of_them() {
    let place = part("export-vtu");
    export(&place, &["--poses", "poses.toml", "--pose", "python", "-o", "part.vtu"]);
    let arrays = vtu_vectors(&place.join("part.vtu"));
    let of = |name: &str| &arrays.iter().find(|(known, _)| known == name).unwrap().1;
    let parts = [("tx", 0.01), ("m12", -0.1), ("m21", 0.1)];
    let mut sum = vec![V3::zeros(); of("column right.tx").len()];
    for (field, c) in parts {
        for (sum, u) in sum.iter_mut().zip(of(&format!("column right.{field}"))) {
            *sum += u * c;
        }
    }
    let u = deformed(&place, "python");
    assert!(largest_difference(&sum, &u) < 1e-8 && largest_difference(of("displacement python"), &u) < 1e-8);
    let said = export(&place, &["--columns", "right.m12,gravity.y", "-o", "part.vtu"]);
    let names: Vec<String> = vtu_vectors(&place.join("part.vtu")).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["column right.m12", "column gravity.y", "Points"], "{said}");
}

/// A load moves steel by little for 1 Pa, and a flat control element has half of the columns of its turns.
#[test]
fn a_stiff_body_keeps_its_loads_and_a_flat_end_is_not_turned_inside_out() {
    let place = part("export-stiff");
    let scene = r#"
[body.part]
generate = { block = { size = [1.0, 0.1, 0.2], cells = [6, 2, 2] } }
material = "steel"
load.press = { nodes = { group = "ymax" }, kind = "pressure", value = 1.0e5 }
control.left = { nodes = { group = "xmin" }, grab = "fixed" }
control.right = { nodes = { group = "xmax" }, grab = "dragger" }
"#;
    std::fs::write(place.join("part.toml"), scene).unwrap();
    let pose = "[[pose]]\nname = \"pressed\"\ncontrol.right = { translation = [0.0, 0.0, 0.0] }\n";
    std::fs::write(place.join("poses.toml"), pose).unwrap();
    let said = export(&place, &["--poses", "poses.toml", "-o", "part.vtu"]);
    assert!(said.contains("left out, since they are zero: left.m11, ") && !said.contains("press,"), "{said}");
    let arrays = vtu_vectors(&place.join("part.vtu"));
    let u = deformed(&place, "pressed");
    let largest = u.iter().map(V3::norm).fold(0.0, f64::max);
    let shown = &arrays.iter().find(|(name, _)| name == "displacement pressed").unwrap().1;
    assert!(largest > 1e-7 && largest_difference(shown, &u) < 1e-5 * largest, "{largest}");

    export(&place, &["--profile", "viewer", "-o", "web.glb"]);
    let glb = Glb::read(&place.join("web.glb"));
    let targets = glb.root["meshes"][0]["primitives"][0]["targets"].as_array().unwrap();
    let nodes = glb.vectors(&glb.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]);
    for (k, name) in glb.names().iter().enumerate() {
        let u = glb.vectors(&targets[k]["POSITION"]);
        let end = || {
            nodes.iter().zip(&u).filter(|(x, _)| x.x > 0.999 * nodes.iter().map(|x| x.x).fold(0.0, f64::max))
        };
        let turns = end().zip(end().skip(1)).map(|((x, u), (y, v))| (u - v).norm() / (x - y).norm());
        assert!(turns.fold(0.0, f64::max) < 0.36, "{name}");
    }
}

/// The pose of a model with a frame that turns along is that of `deform`, too; the remark about the sum is true of it.
#[test]
fn a_pose_of_the_model_rotation_stands_in_its_frame() {
    let place = part("export-rotation");
    let scene = SCENE.replace("storage = \"int16\"", "model = \"rotation\"");
    std::fs::write(place.join("part.toml"), scene).unwrap();
    let said = export(&place, &["--poses", "poses.toml", "--pose", "both", "-o", "part.vtu"]);
    assert!(said.contains("the linear theory's displacement, not that of the model \"rotation\""), "{said}");
    let arrays = vtu_vectors(&place.join("part.vtu"));
    let found = &arrays.iter().find(|(name, _)| name == "displacement both").unwrap().1;
    let u = deformed(&place, "both");
    assert!(largest_difference(found, &u) < 1e-7);
    // The same in glTF, whose node has the frame.
    export(&place, &["--poses", "poses.toml", "--pose", "both", "-o", "part.glb"]);
    let glb = Glb::read(&place.join("part.glb"));
    let of = |key: &str| -> Vec<f64> {
        glb.root["nodes"][0][key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let (t, r) = (of("translation"), of("rotation"));
    let turn = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(r[3], r[0], r[1], r[2]));
    let mesh = &glb.root["meshes"][0];
    let rest = glb.vectors(&mesh["primitives"][0]["attributes"]["POSITION"]);
    let mut places = rest.clone();
    for (target, weight) in
        mesh["primitives"][0]["targets"].as_array().unwrap().iter().zip(mesh["weights"].as_array().unwrap())
    {
        for (sum, u) in places.iter_mut().zip(glb.vectors(&target["POSITION"])) {
            *sum += u * weight.as_f64().unwrap();
        }
    }
    let places: Vec<V3> = places.iter().map(|x| turn * x + V3::from_column_slice(&t)).collect();
    let points = &arrays.iter().find(|(name, _)| name == "Points").unwrap().1;
    let expected: Vec<V3> = points.iter().zip(&u).map(|(x, u)| x + u).collect();
    assert!(largest_difference(&places, &expected) < 1e-6);
}

#[test]
fn a_pose_as_a_surface_is_what_deform_writes() {
    let place = part("export-surface");
    greenstage(
        &place,
        &["deform", "part.toml", "--poses", "poses.toml", "--surface", "stl,ply,obj", "-o", "by"],
    );
    for format in ["stl", "ply", "obj"] {
        let out = format!("one.{format}");
        export(&place, &["--poses", "poses.toml", "--pose", "both", "-o", &out]);
        let read = |name: &str| std::fs::read(place.join(name)).unwrap();
        assert!(read(&out) == read(&format!("by.both.{format}")), "{format}");
    }
}

/// The program in the chapter `green`, with the formula in Rust on the bytes of the file, and run by Python where that is there.
#[test]
fn ten_lines_of_python_deform_a_body() {
    let place = part("export-python");
    let u = deformed(&place, "python");
    let bytes = std::fs::read(place.join("part.green")).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (basis, scale) = (file.tensor("part/basis/right").unwrap(), file.tensor("part/scale/right").unwrap());
    let m = [[1.0, -0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let identity = |k: usize| f64::from(u8::from(k.is_multiple_of(4)));
    let matrix = m.as_flattened().iter().enumerate().map(|(k, m)| m - identity(k));
    let c: Vec<f64> = [0.01, 0.0, 0.0].into_iter().chain(matrix).collect();
    let scales =
        scale.data().chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().unwrap())));
    let mut sum = vec![V3::zeros(); basis.shape()[1]];
    let column_bytes = 2 * 3 * sum.len();
    for ((c, scale), column) in c.iter().zip(scales).zip(basis.data().chunks_exact(column_bytes)) {
        for (sum, node) in sum.iter_mut().zip(column.chunks_exact(6)) {
            *sum += V3::from_fn(|axis, _| {
                c * scale * f64::from(i16::from_le_bytes([node[2 * axis], node[2 * axis + 1]]))
            });
        }
    }
    assert!(largest_difference(&sum, &u) < 1e-8);

    let chapter = greenstage::manual::find("green").unwrap();
    let program = chapter.text.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    assert!(program.lines().count() < 16);
    if !has("python3", &["-c", "import numpy, safetensors"]) {
        return;
    }
    std::fs::write(place.join("example.py"), program).unwrap();
    let output = Command::new("python3").arg("example.py").current_dir(&place).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let rows = csv_rows(&place.join("u.csv"), 1);
    let deformed = csv_rows(&place.join("deformed.csv"), 2);
    let tags = deformed.iter().filter_map(|(label, _)| label.strip_prefix("python,"));
    assert!(rows.iter().map(|(tag, _)| tag.as_str()).eq(tags));
    let found: Vec<V3> = rows.iter().map(|(_, u)| V3::from_column_slice(u)).collect();
    assert!(largest_difference(&found, &u) < 1e-8);
}
