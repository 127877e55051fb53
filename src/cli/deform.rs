//! `greenstage deform`: poses in, displacements and forces out.

use super::failure::Failure;
use super::poses::{self, Pose};
use super::{session, statics};
use crate::base::notice::notice;
use crate::base::output::{self, Kind};
use crate::base::text::one_line;
use crate::deform::{
    ControlPose, ControlPoses, Deformer, EquilibriumResult, Frame, Wrench, find_model, wrenches,
};
use crate::green::{self, GreenFile, STIFFNESS, Solution};
use crate::mesh::TetMesh;
use crate::mesh::formats::vtu_write::{self, Cell, Piece};
use crate::scene::{Body, Scene};
use crate::solve::Silent;
use anyhow::Context;
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Batch: poses in, displacements and forces out
///
/// POSES holds tables `[[pose]]`: name, and per control element
/// control.NAME = { translation = [x, y, z], matrix = [[..], [..], [..]] }; what is absent is at rest.
/// Writes OUT.csv (pose,node,ux,uy,uz by the mesh's node tags), OUT.vtu (the deformed surface, one displacement
/// field a pose), and OUT.forces.csv where the scene lists the effect haptics: all of them whole, or none. They overwrite
/// those of an earlier `deform`, and nothing else. A body of a model of large strain (stvk, neo_hookean, corotational) is
/// solved anew for every pose, over all nodes, with its forces; a pose in which it has no equilibrium is named, the
/// others are written, and the status is 1.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Pose file (TOML)
    #[arg(long)]
    pub poses: PathBuf,
    /// Where to write: OUT or OUT.csv
    #[arg(short, long)]
    pub output: PathBuf,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// All nodes, those inside too, solved again in f64 and not taken from the .green file (model linear only)
    #[arg(long, conflicts_with = "green")]
    pub all_nodes: bool,
}

/// One row's worth of results for one pose of one body.
struct Deformed {
    pose: String,
    body: String,
    displacement: Vec<Vector3<f64>>,
    wrenches: Option<(Vec<Wrench>, f64)>,
}

/// A pose in which a body has no equilibrium.
struct Missed {
    pose: String,
    body: String,
    /// With both names.
    why: String,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = Scene::load(&args.scene)?;
    let poses = poses::load(&args.poses)?;
    let files = Files::of(&args.output)?;
    files.try_all(args, &scene)?;
    let scene = super::plan::settled(scene, false, false)?;
    let asked: Vec<Asked> =
        poses.iter().map(|pose| ask(&scene, pose, &args.poses)).collect::<Result<_, _>>()?;
    let online = session::online_part(&scene)?;
    let file = match online.body.is_empty() || args.all_nodes {
        true => None,
        false => Some(session::green_file(&online, args.green.as_deref())?),
    };
    let (mut geometry, mut results, mut missed, mut tables) =
        (Vec::new(), Vec::new(), Vec::new(), String::new());
    for (name, body) in &scene.body {
        let own: Vec<&Asked> = asked.iter().filter(|asked| asked.body == *name).collect();
        // The linear theory takes matrices as they are, not as turns.
        let doubtful =
            |asked: &Asked| poses::doubtful_turn(&asked.control, body).filter(|_| !takes_matrices(body));
        for (asked, doubt) in own.iter().filter_map(|asked| Some((asked, doubtful(asked)?))) {
            notice!("note: pose \"{}\": body.{name}: {doubt}", asked.pose);
        }
        let (shape, found) = match (session::law(&scene, name, body)?, &file) {
            (None, Some(file)) => surface_results(file, name, body, &own)?,
            (None, None) => volume_results(&scene, name, body, &own)?,
            (Some(law), _) => {
                let poses: Vec<_> = own.iter().map(|asked| (asked.pose, &asked.control)).collect();
                let solved = statics::solve(&scene, name, law, &poses)?;
                tables += &format!("\n{}", solved.table.text());
                static_results(name, solved, &own, &mut missed)
            }
        };
        geometry.push(shape);
        results.extend(found);
    }
    let order = |result: &Deformed| {
        asked.iter().position(|asked| asked.pose == result.pose && asked.body == result.body)
    };
    results.sort_by_key(order);
    if missed.is_empty() || !results.is_empty() {
        files.write(&scene, &geometry, &results, &missed)?;
        super::print(&tables)?;
    }
    if missed.is_empty() {
        return Ok(());
    }
    let reasons: Vec<&str> = missed.iter().map(|missed| missed.why.as_str()).collect();
    let rest = match results.len() {
        0 => "nothing is written",
        _ => "all else is written",
    };
    Err(Failure::Work(anyhow::anyhow!(
        "{}\n{} of {} poses missed; {rest}",
        reasons.join("\n"),
        missed.len(),
        asked.len()
    )))
}

/// A pose, and the body that it is for.
struct Asked<'a> {
    pose: &'a str,
    body: &'a str,
    control: ControlPoses,
}

fn ask<'a>(scene: &'a Scene, pose: &'a Pose, path: &Path) -> Result<Asked<'a>, Failure> {
    let names = || scene.body.keys().map(String::as_str);
    let wrong =
        |message: String| Failure::wrong(format!("{}: pose \"{}\": {message}", path.display(), pose.name));
    let body = match &pose.body {
        None if scene.body.len() == 1 => names().next(),
        None => return Err(wrong(format!("name its body: {}", names().collect::<Vec<_>>().join(", ")))),
        Some(name) => names().find(|known| known == name),
    };
    let Some(body) = body else {
        let name = pose.body.as_deref().unwrap_or_default();
        return Err(wrong(crate::config::unknown_name("body", name, names())));
    };
    Ok(Asked { pose: &pose.name, body, control: poses::control_poses(pose, body, &scene.body[body], path)? })
}

fn surface_results(
    file: &Arc<GreenFile>,
    name: &str,
    body: &Body,
    asked: &[&Asked<'_>],
) -> Result<(Geometry, Vec<Deformed>), Failure> {
    let mut deformer = Deformer::new(file.clone(), name, &body.model).map_err(Failure::wrong)?;
    let found = asked.iter().map(|asked| surface_result(asked, &mut deformer)).collect();
    Ok((Geometry::surface(&deformer), found))
}

fn surface_result(asked: &Asked<'_>, body: &mut Deformer) -> Deformed {
    body.forget();
    if body.evaluate(&asked.control).is_some() && body.state.rotation_undefined {
        notice!(
            "warning: pose \"{}\": body.{}: the control elements are half a turn apart, their mean rotation is not \
             defined, and the result not to be trusted; model = \"linear\" has no such pose",
            asked.pose,
            body.body
        );
    }
    Deformed {
        pose: asked.pose.to_owned(),
        body: body.body.clone(),
        displacement: (0..body.node_count()).map(|i| body.displacement(i)).collect(),
        wrenches: body.wrenches(),
    }
}

fn volume_results(
    scene: &Scene,
    name: &str,
    body: &Body,
    asked: &[&Asked<'_>],
) -> Result<(Geometry, Vec<Deformed>), Failure> {
    if !takes_matrices(body) {
        return Err(Failure::request(scene.invalid(
            &format!("body.{name}.model"),
            format!("--all-nodes solves the linear theory, not the model \"{}\"", body.model),
        )));
    }
    let solution = green::solve(scene, name, &session::needs(scene, name, body)?, &Silent)?;
    for notice in &solution.notices {
        notice!("{notice}");
    }
    let found = asked.iter().map(|asked| volume_result(asked, name, &solution)).collect();
    Ok((Geometry::volume(name, &solution.mesh), found))
}

/// Whether the body's model is linear in the matrices of the poses, not in their turns.
fn takes_matrices(body: &Body) -> bool {
    find_model(&body.model).is_ok_and(|model| model.frame == Frame::Rest)
}

fn volume_result(asked: &Asked<'_>, name: &str, solution: &Solution) -> Deformed {
    let c: Vec<f64> = asked.control.iter().flat_map(ControlPose::coefficients).collect();
    let value = |row: usize| solution.fields.row(row).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>();
    Deformed {
        pose: asked.pose.to_owned(),
        body: name.to_owned(),
        displacement: (0..solution.mesh.nodes.len())
            .map(|node| Vector3::from_fn(|axis, _| value(3 * node + axis)))
            .collect(),
        wrenches: solution.stiffness().map(|s| wrenches(s, &c, UnitQuaternion::identity())),
    }
}

fn static_results(
    name: &str,
    solved: statics::Solved,
    asked: &[&Asked<'_>],
    missed: &mut Vec<Missed>,
) -> (Geometry, Vec<Deformed>) {
    let mut found = Vec::new();
    for (asked, settled) in asked.iter().zip(solved.settled) {
        let (pose, body) = (asked.pose.to_owned(), name.to_owned());
        match settled {
            Ok(EquilibriumResult { displacement, wrenches, energy, .. }) => {
                found.push(Deformed { pose, body, displacement, wrenches: Some((wrenches, energy)) });
            }
            Err(why) => missed.push(Missed { pose, body, why }),
        }
    }
    (Geometry::volume(name, &solved.statics.mesh), found)
}

/// Where the displacements of one body belong: node tags, rest positions, cells.
struct Geometry {
    body: String,
    tags: Vec<u64>,
    rest: Vec<Vector3<f64>>,
    /// Triangles or tetrahedra.
    cells: Vec<Vec<u32>>,
}

impl Geometry {
    fn surface(body: &Deformer) -> Geometry {
        Geometry {
            body: body.body.clone(),
            tags: body.tags().to_vec(),
            rest: body.rest().iter().map(|x| Vector3::from(*x).cast() + body.centre).collect(),
            cells: body.triangles().iter().map(|triangle| triangle.to_vec()).collect(),
        }
    }

    fn volume(name: &str, mesh: &TetMesh) -> Geometry {
        Geometry {
            body: name.to_owned(),
            tags: mesh.tags.clone(),
            rest: mesh.nodes.clone(),
            cells: (0..mesh.tets.len()).map(|tet| vtk_cell(mesh, tet)).collect(),
        }
    }
}

/// The nodes of a tetrahedron in VTK's order, whose last two mid-side nodes change places with ours.
fn vtk_cell(mesh: &TetMesh, tet: usize) -> Vec<u32> {
    let mut nodes = mesh.tets[tet].to_vec();
    if let Some(&[a, b, c, d, e, f]) = mesh.mids.get(tet) {
        nodes.extend([a, b, c, d, f, e]);
    }
    nodes
}

const DISPLACEMENTS: Kind = Kind {
    name: "a table of displacements by `deform`",
    recognizes: |head| head.starts_with(DISPLACEMENT_HEADING.as_bytes()),
};
const FORCES: Kind = Kind {
    name: "a table of forces by `deform`",
    recognizes: |head| head.starts_with(FORCE_HEADING.as_bytes()),
};
const DISPLACEMENT_HEADING: &str = "pose,node,ux,uy,uz\n";
const FORCE_HEADING: &str = "pose,control,fx,fy,fz,mx,my,mz,energy\n";
/// A mesh in this format, as `convert` writes it, has no displacements.
const SURFACE: Kind = Kind {
    name: "a VTU file by `deform`",
    recognizes: |head| {
        let mark = b" Vectors=\"displacement ";
        head.starts_with(b"<VTKFile ") && head.windows(mark.len()).any(|window| window == mark)
    },
};

/// The files that are written.
struct Files {
    displacements: PathBuf,
    forces: PathBuf,
    surface: PathBuf,
}

impl Files {
    /// Those of OUT, or OUT.csv.
    fn of(output: &Path) -> Result<Files, Failure> {
        let is_csv = output.extension().is_some_and(|extension| extension == "csv");
        let stem = if is_csv { output.with_extension("") } else { output.to_owned() };
        let is_named = stem.file_name().is_some() && !output.as_os_str().as_encoded_bytes().ends_with(b"/");
        let is_special = std::fs::metadata(output).is_ok_and(|found| !found.is_file() && !found.is_dir());
        if !is_named || is_special {
            let text =
                "OUT.csv, OUT.vtu and OUT.forces.csv are written: OUT names files in a folder, as out/part";
            return Err(Failure::wrong(format!("{}: {text}", output.display())));
        }
        let with = |ending: &str| {
            let mut name = stem.clone().into_os_string();
            name.push(ending);
            PathBuf::from(name)
        };
        Ok(Files { displacements: with(".csv"), forces: with(".forces.csv"), surface: with(".vtu") })
    }

    /// Makes the folder and looks whether everything can be written there, before anything is solved.
    fn try_all(&self, args: &Args, scene: &Scene) -> Result<(), Failure> {
        output::make_folder_of(&self.displacements)?;
        let inputs = session::inputs_and(scene, [Some(args.poses.as_path()), args.green.as_deref()]);
        output::try_path(&self.displacements, &DISPLACEMENTS, &inputs)?;
        output::try_path(&self.surface, &SURFACE, &inputs)?;
        let (mut has_forces, mut has_columns) = (false, false);
        for (name, body) in &scene.body {
            let is_static = session::law(scene, name, body)?.is_some();
            has_columns |= !is_static;
            has_forces |= is_static || session::needs(scene, name, body)?.has(STIFFNESS);
        }
        if has_forces {
            output::try_path(&self.forces, &FORCES, &inputs)?;
        }
        if has_columns && !args.all_nodes { session::try_green(scene, args.green.as_deref()) } else { Ok(()) }
    }

    fn write(
        &self,
        scene: &Scene,
        geometry: &[Geometry],
        results: &[Deformed],
        missed: &[Missed],
    ) -> Result<(), Failure> {
        let several = geometry.len() > 1;
        let text = |path: &Path, kind, text: String| {
            output::stage(path, kind, |file| file.write_all(text.as_bytes()))
        };
        let has_forces = results.iter().any(|result| result.wrenches.is_some());
        let mut written = vec![(
            &self.displacements,
            text(&self.displacements, &DISPLACEMENTS, displacement_csv(geometry, results, several))?,
        )];
        if has_forces {
            written.push((&self.forces, text(&self.forces, &FORCES, forces_csv(scene, results, several))?));
        }
        let surface = output::stage(&self.surface, &SURFACE, |file| {
            file.write_all(&vtu_write::encode(&pieces(geometry, results, missed)))
        })?;
        written.push((&self.surface, surface));
        for (path, staged) in written {
            staged.put()?;
            super::print(&format!("{}\n", path.display()))?;
        }
        if !has_forces && output::is(&self.forces, &FORCES) {
            let old = &self.forces;
            std::fs::remove_file(old).with_context(|| old.display().to_string()).map_err(Failure::Request)?;
            notice!("note: {} was of an earlier run with haptics and is removed", old.display());
        }
        Ok(())
    }
}

/// In a scene of several bodies a pose is called POSE/BODY.
fn label(result: &Deformed, several: bool) -> String {
    if several { quoted(&format!("{}/{}", result.pose, result.body)) } else { quoted(&result.pose) }
}

/// A name as a cell of a CSV file (RFC 4180).
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

fn displacement_csv(geometry: &[Geometry], results: &[Deformed], several: bool) -> String {
    let mut text = DISPLACEMENT_HEADING.to_owned();
    for result in results {
        let label = label(result, several);
        let tags = geometry.iter().find(|g| g.body == result.body).map_or(&[][..], |g| &g.tags);
        for (tag, u) in tags.iter().zip(&result.displacement) {
            // Writing into a String cannot fail.
            let _ = writeln!(text, "{label},{tag},{:e},{:e},{:e}", u.x, u.y, u.z);
        }
    }
    text
}

fn forces_csv(scene: &Scene, results: &[Deformed], several: bool) -> String {
    let mut text = FORCE_HEADING.to_owned();
    for result in results {
        let Some((wrenches, energy)) = &result.wrenches else {
            continue;
        };
        let label = label(result, several);
        let controls = scene.body[&result.body].control.keys();
        for (control, Wrench { force: f, moment: m }) in controls.zip(wrenches) {
            let name = quoted(control);
            let numbers = [f.x, f.y, f.z, m.x, m.y, m.z, *energy].map(|value| format!("{value:e}"));
            let _ = writeln!(text, "{label},{name},{}", numbers.join(","));
        }
    }
    text
}

/// One piece per body: rest points, its cells, one displacement field a pose. Every piece has the fields of all
/// poses, as VTK asks for; a body that a pose does not name is at rest in it, one that has no equilibrium there is NaN.
fn pieces<'a>(geometry: &'a [Geometry], results: &[Deformed], missed: &[Missed]) -> Vec<Piece<'a>> {
    let mut poses: Vec<&str> = Vec::new();
    for result in results {
        if !poses.contains(&result.pose.as_str()) {
            poses.push(&result.pose);
        }
    }
    let piece = |g: &'a Geometry| {
        let field = |pose: &&str| {
            let result = results.iter().find(|result| result.body == g.body && result.pose == *pose);
            let is_missed = || missed.iter().any(|missed| missed.body == g.body && missed.pose == *pose);
            let u = match result {
                Some(result) => result.displacement.clone(),
                None => {
                    let unknown = if is_missed() { f64::NAN } else { 0.0 };
                    vec![Vector3::repeat(unknown); g.rest.len()]
                }
            };
            (one_line(format_args!("displacement {pose}")), u)
        };
        let cell = match g.cells.first().map_or(3, Vec::len) {
            3 => Cell::Triangle,
            4 => Cell::Tetra,
            _ => Cell::QuadraticTetra,
        };
        let connectivity = g.cells.concat();
        Piece {
            points: &g.rest,
            cell,
            connectivity,
            vectors: poses.iter().map(field).collect(),
            numbers: None,
        }
    };
    geometry.iter().map(piece).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_commas_and_quotes_stay_one_cell() {
        assert_eq!(quoted("bend 30"), "bend 30");
        assert_eq!(quoted("a,b \"c\""), "\"a,b \"\"c\"\"\"");
    }

    #[test]
    fn names_of_poses_leave_the_file_readable() {
        let rest = vec![Vector3::zeros(), Vector3::x(), Vector3::y()];
        let geometry = [Geometry { body: "a".into(), tags: vec![1, 2, 3], rest, cells: vec![vec![0, 1, 2]] }];
        let poses = ["\u{1b}[2Jevil", "a\n\"b\" <&> 'c'", "\u{0}\u{202e}\u{ffff}", "röhre"];
        let results = poses.map(|pose| Deformed {
            pose: pose.into(),
            body: "a".into(),
            displacement: vec![Vector3::x(); 3],
            wrenches: None,
        });
        let text = String::from_utf8(vtu_write::encode(&pieces(&geometry, &results, &[]))).unwrap();
        assert!(!text.contains(['\u{1b}', '\u{0}', '\u{202e}', '\u{ffff}']));
        let mut reader = quick_xml::Reader::from_str(&text);
        let mut names = Vec::new();
        loop {
            match reader.read_event().unwrap() {
                quick_xml::events::Event::Eof => break,
                quick_xml::events::Event::Start(start) if start.name().as_ref() == b"DataArray" => {
                    let name = start.try_get_attribute("Name").unwrap().unwrap();
                    names.push(
                        name.normalized_value(quick_xml::XmlVersion::Implicit1_0).unwrap().into_owned(),
                    );
                }
                _ => {}
            }
        }
        names.retain(|name| name.starts_with("displacement"));
        let expected = ["\\u001b[2Jevil", "a\\n\"b\" <&> 'c'", "\\u0000\\u202e\\uffff", "röhre"];
        assert_eq!(names, expected.map(|pose| format!("displacement {pose}")));
    }

    #[test]
    fn every_piece_has_the_fields_of_all_poses() {
        let geometry = ["a", "b"].map(|body| Geometry {
            body: body.into(),
            tags: vec![1],
            rest: vec![Vector3::zeros()],
            cells: vec![vec![0, 0, 0]],
        });
        let results = [("pull", "b"), ("push", "a")].map(|(pose, body)| Deformed {
            pose: pose.into(),
            body: body.into(),
            displacement: vec![Vector3::x()],
            wrenches: None,
        });
        for piece in pieces(&geometry, &results, &[]) {
            let names: Vec<&str> = piece.vectors.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, ["displacement pull", "displacement push"]);
        }
    }
}
