//! `greenstage deform`: poses in, displacements and forces out.

use super::failure::Failure;
use super::poses::{self, Pose};
use super::{session, statics};
use crate::deform::{ControlPose, ControlPoses, Deformer, Settled, Wrench, wrenches};
use crate::green::{self, FIELDS, GreenFile, Solution};
use crate::mesh::TetMesh;
use crate::scene::{Body, Scene};
use crate::solve::Silent;
use anyhow::Context;
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vtkio::model::{
    Attribute, Attributes, ByteOrder, CellType, Cells, DataSet, UnstructuredGridPiece, Version,
    VertexNumbers, Vtk,
};

/// Batch: poses in, displacements and forces out
///
/// POSES holds tables `[[pose]]`: name, and per control element
/// control.NAME = { translation = [x, y, z], matrix = [[..], [..], [..]] }; what is absent is at rest.
/// Writes OUT.csv (pose,node,ux,uy,uz by the mesh's node tags), OUT.vtu (the deformed surface, one displacement
/// field a pose), and OUT.forces.csv where the scene lists the effect haptics. A body of a model of large
/// strain (stvk, neo_hookean, corotational) is solved anew for every pose, over all nodes, with its forces.
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

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = super::plan::settled(Scene::load(&args.scene)?, false, false)?;
    let poses = poses::load(&args.poses)?;
    let asked: Vec<Asked> =
        poses.iter().map(|pose| ask(&scene, pose, &args.poses)).collect::<Result<_, _>>()?;
    let online = session::online_part(&scene)?;
    let file = match online.body.is_empty() || args.all_nodes {
        true => None,
        false => Some(session::green_file(&online, args.green.as_deref())?),
    };
    let (mut geometry, mut results, mut tables) = (Vec::new(), Vec::new(), String::new());
    for (name, body) in &scene.body {
        let own: Vec<&Asked> = asked.iter().filter(|asked| asked.body == *name).collect();
        let (shape, found) = match (session::law(&scene, name, body)?, &file) {
            (None, Some(file)) => surface_results(file, name, body, &own)?,
            (None, None) => volume_results(&scene, name, body, &own)?,
            (Some(law), _) => {
                let poses: Vec<_> = own.iter().map(|asked| (asked.pose, &asked.control)).collect();
                let solved = statics::solve(&scene, name, law, &poses)?;
                tables += &format!("\n{}", solved.table.text());
                static_results(name, solved, &own)
            }
        };
        geometry.push(shape);
        results.extend(found);
    }
    let order = |result: &Deformed| {
        asked.iter().position(|asked| asked.pose == result.pose && asked.body == result.body)
    };
    results.sort_by_key(order);
    write_all(args, &scene, &geometry, &results)?;
    super::print(&tables)
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
    if body.evaluate(&asked.control).is_some() && body.coefficients.rotation_undefined {
        eprintln!(
            "warning: pose \"{}\": body.{}: the control elements are half a turn apart, their mean rotation is not \
             defined, and the result not to be trusted; model = \"linear\" has no such pose",
            asked.pose, body.body
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
    if body.model != "linear" {
        return Err(Failure::request(scene.invalid(
            &format!("body.{name}.model"),
            format!("--all-nodes solves the linear theory, not the model \"{}\"", body.model),
        )));
    }
    let solution = green::solve(scene, name, session::needs(scene, name, body)?, &Silent)?;
    for notice in &solution.notices {
        eprintln!("{notice}");
    }
    let found = asked.iter().map(|asked| volume_result(asked, name, &solution)).collect();
    Ok((Geometry::volume(name, &solution.mesh), found))
}

fn volume_result(asked: &Asked<'_>, name: &str, solution: &Solution) -> Deformed {
    let coefficients: Vec<[f64; FIELDS]> = asked.control.iter().map(ControlPose::coefficients).collect();
    let c = coefficients.as_flattened();
    let value = |row: usize| solution.fields.row(row).iter().zip(c).map(|(u, c)| u * c).sum::<f64>();
    Deformed {
        pose: asked.pose.to_owned(),
        body: name.to_owned(),
        displacement: (0..solution.mesh.nodes.len())
            .map(|node| Vector3::from_fn(|axis, _| value(3 * node + axis)))
            .collect(),
        wrenches: solution.stiffness.as_ref().map(|s| wrenches(s, &coefficients, UnitQuaternion::identity())),
    }
}

fn static_results(name: &str, solved: statics::Solved, asked: &[&Asked<'_>]) -> (Geometry, Vec<Deformed>) {
    let of = |(asked, settled): (&&Asked<'_>, Settled)| Deformed {
        pose: asked.pose.to_owned(),
        body: name.to_owned(),
        displacement: settled.displacement,
        wrenches: Some((settled.wrenches, settled.energy)),
    };
    let found = asked.iter().zip(solved.settled).map(of).collect();
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

fn write_all(args: &Args, scene: &Scene, geometry: &[Geometry], results: &[Deformed]) -> Result<(), Failure> {
    let stem = match args.output.extension() {
        Some(extension) if extension == "csv" => args.output.with_extension(""),
        _ => args.output.clone(),
    };
    let with = |ending: &str| PathBuf::from(format!("{}{ending}", stem.display()));
    if let Some(folder) = stem.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))
            .map_err(Failure::Request)?;
    }
    let write = |path: PathBuf, text: &str| {
        std::fs::write(&path, text).with_context(|| path.display().to_string()).map_err(Failure::Request)?;
        super::print(&format!("{}\n", path.display()))
    };
    let several = geometry.len() > 1;
    write(with(".csv"), &displacement_csv(geometry, results, several))?;
    if results.iter().any(|result| result.wrenches.is_some()) {
        write(with(".forces.csv"), &forces_csv(scene, results, several))?;
    } else if with(".forces.csv").exists() {
        let old = with(".forces.csv");
        std::fs::remove_file(&old).with_context(|| old.display().to_string()).map_err(Failure::Request)?;
        eprintln!("note: {} was of an earlier run with haptics and is removed", old.display());
    }
    let vtu = with(".vtu");
    vtk(geometry, results)
        .export(&vtu)
        .map_err(|error| Failure::Work(anyhow::anyhow!("{}: {error}", vtu.display())))?;
    super::print(&format!("{}\n", vtu.display()))
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
    let mut text = String::from("pose,node,ux,uy,uz\n");
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
    let mut text = String::from("pose,control,fx,fy,fz,mx,my,mz,energy\n");
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
/// poses, as VTK asks for; a body that a pose does not name is at rest in it.
fn vtk(geometry: &[Geometry], results: &[Deformed]) -> Vtk {
    let mut poses: Vec<&str> = Vec::new();
    for result in results {
        if !poses.contains(&result.pose.as_str()) {
            poses.push(&result.pose);
        }
    }
    let piece = |g: &Geometry| {
        let fields = poses.iter().map(|pose| {
            let result = results.iter().find(|result| result.body == g.body && result.pose == *pose);
            let u: Vec<f64> = match result {
                Some(result) => result.displacement.iter().flat_map(|u| <[f64; 3]>::from(*u)).collect(),
                None => vec![0.0; 3 * g.rest.len()],
            };
            Attribute::vectors(format!("displacement {pose}")).with_data(u)
        });
        let size = g.cells.first().map_or(3, Vec::len);
        let kind = match size {
            3 => CellType::Triangle,
            4 => CellType::Tetra,
            _ => CellType::QuadraticTetra,
        };
        UnstructuredGridPiece {
            points: g.rest.iter().flat_map(|x| <[f64; 3]>::from(*x)).collect::<Vec<f64>>().into(),
            cells: Cells {
                cell_verts: VertexNumbers::XML {
                    connectivity: g.cells.iter().flatten().map(|&node| u64::from(node)).collect(),
                    offsets: (1..=g.cells.len() as u64).map(|count| count * size as u64).collect(),
                },
                types: vec![kind; g.cells.len()],
            },
            data: Attributes { point: fields.collect(), cell: vec![] },
        }
    };
    Vtk {
        version: Version::XML { major: 1, minor: 0 },
        title: "greenstage deform".into(),
        byte_order: ByteOrder::LittleEndian,
        file_path: None,
        data: DataSet::UnstructuredGrid {
            meta: None,
            pieces: geometry.iter().map(|g| vtkio::model::Piece::Inline(Box::new(piece(g)))).collect(),
        },
    }
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
        let DataSet::UnstructuredGrid { pieces, .. } = vtk(&geometry, &results).data else {
            panic!("no unstructured grid");
        };
        for piece in pieces {
            let vtkio::model::Piece::Inline(piece) = piece else {
                panic!("a piece in another file");
            };
            let names: Vec<&str> = piece.data.point.iter().map(Attribute::name).collect();
            assert_eq!(names, ["displacement pull", "displacement push"]);
        }
    }
}
