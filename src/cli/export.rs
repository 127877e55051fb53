//! `greenstage export`: writes the columns of a scene's bodies, or the surface of one pose, for other programs.

use super::print::print;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output::{self, Kind};
use crate::base::table::{bytes, count};
use crate::config::unknown_name;
use crate::deform::Frame;
use crate::deform::pose_file::{self, Pose};
use crate::export::csv::DISPLACEMENTS;
use crate::export::{
    BASIS_FILES, BasisFile, BodyBasis, Choice, Exporter, PoseRequest, Profile, ResultSet, VIEWER_MOTIONS,
    basis, batch, chosen, surfaces,
};
use crate::green::ColumnSource;
use crate::prepare::{self, Resolved};
use crate::scene::Scene;
use crate::tuning;
use std::path::{Path, PathBuf};

const AFTER_HELP: &str = "\
OUT's extension chooses the format:
  .iv    Open Inventor 2.1, ASCII: the basis shapes, and the body as a live sum; draggers move it
  .glb   glTF 2.0: one named morph target per column, and an animation; for Blender and the web
  .vtu   VTK, for ParaView and meshio: one point vector per column
  .stl .ply .obj   the surface of one pose, or at rest; .png draws it

Examples:
  greenstage export tube -o tube.iv                        then: ivview tube.iv
  greenstage export tube -o tube.glb                       24 morph targets: left.tx … right.m33
  greenstage export tube -o web.glb --profile viewer       8 targets, no negative weights
  greenstage export tube -o x.vtu --columns right.tx,right.m12
  greenstage export part.toml --poses poses.toml --pose pull -o pull.stl

A sum of columns is the displacement of the model \"linear\". With \"rotation\" it stands in a frame
that follows the control elements; with \"reduced\" and \"perturbation\" the coefficients of some columns
(reduced.1, …) follow from an equilibrium. A pose of these is written as the model has it; what another
program sums by itself is the linear theory. Loads have their columns (gravity.x per m/s², a pattern
per N), `surface_compliance` has none.
`greenstage manual export` tells units and names, and how to read the .green file in Python.";

/// Write what is precomputed for other programs: Open Inventor, glTF, VTK, STL, PLY, OBJ
///
/// A column is the displacement of the surface for a unit of one coefficient: right.tx for a shift of the control element "right" by
/// 1 m, right.m12 for 1 in that entry of its matrix. Bodies bend as the sum of coefficient times column. With --pose, the file opens in
/// that pose of a pose file. Coordinates are in m, those of the mesh. The .green file is made where it is missing.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Scene file (TOML), or a built-in scene
    pub scene: PathBuf,
    /// Where to write, whole or not at all; overwrites a file of that kind by greenstage, and nothing else
    #[arg(short, long, value_name = "OUT.EXT")]
    pub output: PathBuf,
    /// One body; default: all
    #[arg(long, value_name = "NAME")]
    pub body: Option<String>,
    /// These columns alone, as right.tx,right.m12 (.iv, .glb, .vtu; of one body)
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    pub columns: Vec<String>,
    /// For whom a .glb file is made
    #[arg(long, value_enum, default_value_t)]
    pub profile: Profile,
    /// Pose file (TOML, `greenstage manual deform`)
    #[arg(long, value_name = "FILE")]
    pub poses: Option<PathBuf>,
    /// Which pose of it; the only one may be left out
    #[arg(long, value_name = "NAME", requires = "poses")]
    pub pose: Option<String>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long, value_name = "FILE")]
    pub green: Option<PathBuf>,
}

/// The format that OUT's extension chooses.
enum Format {
    Basis(&'static BasisFile),
    Surface(&'static Exporter),
}

impl Format {
    fn from_path(path: &Path) -> Option<Format> {
        let suffix = suffix(path);
        let basis = BASIS_FILES.iter().find(|file| file.suffix == suffix).map(Format::Basis);
        basis.or_else(|| surfaces().find(|exporter| exporter.suffix == suffix).map(Format::Surface))
    }

    fn kind(&self) -> &'static Kind {
        match self {
            Format::Basis(file) => &file.kind,
            Format::Surface(exporter) => &exporter.kind,
        }
    }
}

/// ".glb" of any name that ends so; nothing of a name without an extension.
fn suffix(path: &Path) -> String {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    extension.map_or_else(String::new, |extension| format!(".{extension}"))
}

/// The error of an extension that chooses nothing: it names the known ones, and the command that writes tables.
fn unknown(args: &Args) -> Failure {
    let (path, suffix) = (args.output.display(), suffix(&args.output));
    let basis = BASIS_FILES.iter().map(|file| file.suffix);
    let known: indexmap::IndexSet<&str> = basis.chain(surfaces().map(|exporter| exporter.suffix)).collect();
    let known = Vec::from_iter(known).join(", ");
    if suffix == DISPLACEMENTS.suffix {
        let scene = args.scene.display();
        let poses = args.poses.as_ref().map_or_else(|| "POSES.toml".into(), |poses| poses.to_string_lossy());
        return Failure::wrong(format!(
            "{path}: the displacements of poses are written as {suffix} by `greenstage deform {scene} --poses {poses} -o {path}`; \
             export writes {known}"
        ));
    }
    Failure::wrong(format!("{path}: the extension says what is written: {known}"))
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let format = Format::from_path(&args.output).ok_or_else(|| unknown(args))?;
    let scene = Resolved::load(&args.scene)?;
    let names = names(args, &scene)?;
    let poses = args.poses.as_deref().map(pose_file::load).transpose()?;
    refuse_pointless(args, &format, &names)?;
    let inputs = prepare::inputs_and(&scene, [args.poses.as_deref(), args.green.as_deref()]);
    output::make_folder_of(&args.output)?;
    output::try_path(&args.output, format.kind(), &inputs)?;
    let scene = tuning::settle(scene, false, false)?;
    let posed = SingularPose { poses: poses.as_deref(), args };
    match format {
        Format::Basis(file) => write_basis(&scene, &names, &posed, file),
        Format::Surface(exporter) => write_surface(&scene, &names, &posed, exporter),
    }
}

/// The bodies that are written.
fn names(args: &Args, scene: &Scene) -> Result<Vec<String>, Failure> {
    let all = || scene.body.keys().map(String::as_str);
    match &args.body {
        None => Ok(scene.body.keys().cloned().collect()),
        Some(name) if all().any(|known| known == name) => Ok(vec![name.clone()]),
        Some(name) => Err(Failure::wrong(format!("--body: {}", unknown_name("body", name, all())))),
    }
}

/// Options that the format does not know are not ignored in silence.
fn refuse_pointless(args: &Args, format: &Format, names: &[String]) -> Result<(), Failure> {
    let is_surface = matches!(format, Format::Surface(_));
    if is_surface && (!args.columns.is_empty() || args.profile != Profile::Full) {
        let options = if args.columns.is_empty() { "--profile viewer is" } else { "--columns are" };
        return Err(Failure::wrong(format!(
            "{options} for files that hold columns: name OUT.glb, or leave the option out"
        )));
    }
    if let Format::Basis(file) = format
        && args.profile == Profile::Viewer
    {
        refuse_for_viewers(args, file)?;
    }
    if !args.columns.is_empty() && names.len() > 1 {
        return Err(Failure::wrong(format!(
            "--columns are those of one body: say which by --body: {}",
            names.join(", ")
        )));
    }
    Ok(())
}

fn refuse_for_viewers(args: &Args, file: &BasisFile) -> Result<(), Failure> {
    if !file.is_for_viewers {
        return Err(Failure::wrong(
            "--profile viewer makes morph targets, which .glb files have: name OUT.glb".to_owned(),
        ));
    }
    if args.poses.is_some() {
        return Err(Failure::wrong(
            "--profile viewer has a few motions, whose sum no pose is: leave --poses out, or --profile viewer"
                .to_owned(),
        ));
    }
    if args.columns.len() > VIEWER_MOTIONS {
        return Err(Failure::wrong(format!(
            "--profile viewer has room for {VIEWER_MOTIONS} columns, each forwards and backwards, and --columns names {}: \
             name fewer",
            args.columns.len()
        )));
    }
    Ok(())
}

/// The pose that is asked for.
struct SingularPose<'a> {
    poses: Option<&'a [Pose]>,
    args: &'a Args,
}

impl<'a> SingularPose<'a> {
    fn chosen(&self, scene: &'a Resolved) -> Result<Vec<PoseRequest<'a>>, Failure> {
        let Some((poses, path)) = self.poses.zip(self.args.poses.as_deref()) else { return Ok(Vec::new()) };
        chosen(scene, poses, self.args.pose.as_deref(), path)
    }
}

/// Files above this size are announced before they are written.
const LARGE: u64 = 100_000_000;

fn write_basis(
    scene: &Resolved,
    names: &[String],
    posed: &SingularPose<'_>,
    file: &BasisFile,
) -> Result<(), Failure> {
    let args = posed.args;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    for name in &names {
        basis::refuse(scene, name, &args.columns)?;
    }
    let online = prepare::summed_part(scene)?;
    let green = prepare::green_file(&online, args.green.as_deref())?;
    let asked = posed.chosen(scene)?;
    let bodies = basis::read(scene, &green, &names, Choice { columns: &args.columns, asked: &asked })?;
    if let Some(body) = bodies.iter().find(|body| body.columns.is_empty()) {
        let names: Vec<&str> = body.vanishing.iter().map(|column| column.name.as_str()).collect();
        let is_load = body.vanishing.iter().any(|column| column.source == ColumnSource::Load);
        let why = if is_load {
            "all that it loads is held"
        } else {
            "a flat control element does not move by them"
        };
        return Err(Failure::wrong(format!(
            "--columns: {} of body {} {} zero, and nothing is left to write: {why}; name others, or leave --columns out",
            names.join(", "),
            body.body,
            if names.len() == 1 { "is" } else { "are" }
        )));
    }
    let size = (file.size)(&bodies, args.profile);
    let path = args.output.display();
    let smaller =
        "fewer columns (--columns), one body (--body), or --profile viewer in a .glb file take less";
    if file.most.is_some_and(|most| size > most) {
        let (size, most) = (bytes(size as f64), bytes(file.most.unwrap_or(0) as f64));
        return Err(Failure::wrong(format!(
            "{path}: would be {size}, and such a file can have {most}; {smaller}"
        )));
    }
    if size > LARGE {
        notice!("note: {path} will be about {}: {smaller}", bytes(size as f64));
    }
    output::write(&args.output, &file.kind, |out| (file.write)(&bodies, args.profile, out))?;
    print(&told(&bodies, file, args))
}

/// Words about the file that was written, and its numbers.
fn told(bodies: &[BodyBasis], file: &BasisFile, args: &Args) -> String {
    let mut text = format!("{}: {}\n", args.output.display(), file.about);
    for body in bodies {
        let (name, model) = (&body.body, body.model.name);
        let nodes = count(body.rest.len(), "node");
        text += &format!("body {name}: {nodes}, {}", count(body.columns.len(), "column"));
        if args.profile == Profile::Viewer {
            let most = VIEWER_MOTIONS.min(body.columns.len());
            text += &format!(", of which the file has {most} motions, forwards and backwards\n");
            continue;
        }
        if let Some(pose) = &body.pose {
            text += &format!(", in the pose \"{pose}\"");
        }
        text += match body.model.frame {
            Frame::Rest => "; their sum is its displacement\n",
            Frame::MeanMotion | Frame::Solved => "; their sum alone is the linear theory's displacement",
        };
        if body.model.frame != Frame::Rest {
            text += &format!(", not that of the model \"{model}\"\n");
        }
        if !body.vanishing.is_empty() {
            let names: Vec<&str> = body.vanishing.iter().map(|column| column.name.as_str()).collect();
            text += &format!("left out, since they are zero: {}\n", names.join(", "));
        }
    }
    text
}

fn write_surface(
    scene: &Resolved,
    names: &[String],
    posed: &SingularPose<'_>,
    exporter: &Exporter,
) -> Result<(), Failure> {
    let args = posed.args;
    let asked = posed.chosen(scene)?;
    let (set, _) = batch::solve(scene, &asked, args.green.as_deref(), false)?;
    if let Some(missed) = set.missed.first() {
        return Err(Failure::Work(anyhow::anyhow!("{}; nothing is written", missed.why)));
    }
    // Of a pose that goes on from others, they were solved too.
    let pose = asked.last().map(|asked| asked.pose);
    let of_pose = pose.map_or_else(|| set.clone(), |pose| set.of_pose(pose));
    let ResultSet { geometry, results, missed } = of_pose;
    let is_named = |body: &String| names.contains(body);
    let geometry = geometry.into_iter().filter(|geometry| is_named(&geometry.body)).collect();
    let results = results.into_iter().filter(|result| is_named(&result.body)).collect();
    let set = ResultSet { geometry, results, missed };
    let contents = (exporter.write)(&set);
    output::write(&args.output, &exporter.kind, |file| file.write_all(&contents))?;
    let pose = pose.map_or_else(|| "at rest".to_owned(), |pose| format!("in the pose \"{pose}\""));
    print(&format!("{}: {} {pose}\n", args.output.display(), names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_chooses() {
        for (path, suffix) in [("a/b.iv", ".iv"), ("x.GLB", ".glb"), ("x.y.vtu", ".vtu")] {
            assert!(
                matches!(Format::from_path(Path::new(path)), Some(Format::Basis(file)) if file.suffix == suffix)
            );
        }
        for suffix in ["stl", "ply", "obj", "png"] {
            let path = PathBuf::from("x").with_extension(suffix);
            assert!(matches!(Format::from_path(&path), Some(Format::Surface(file)) if file.name() == suffix));
        }
        assert!(["x", "x.gltf", "x.csv"].iter().all(|path| Format::from_path(Path::new(path)).is_none()));
    }

    #[test]
    fn the_help_names_every_format() {
        let missing: Vec<&str> = BASIS_FILES
            .iter()
            .map(|file| file.suffix)
            .chain(surfaces().map(|surface| surface.suffix))
            .filter(|suffix| !AFTER_HELP.contains(suffix))
            .collect();
        assert_eq!(missing, [""; 0]);
    }
}
