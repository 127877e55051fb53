//! `greenstage convert`: converts a mesh from one format to another.

use super::print::print;
use crate::base::diagnostic::notice;
use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::base::table::count;
use crate::base::text::quoted;
use crate::mesh::length_unit::{LARGEST_M, LengthUnit, Scale, find_unit, implausible};
use crate::mesh::{self, formats, surface_files};
use std::path::PathBuf;

const AFTER_HELP: &str = "\
Examples:
  greenstage convert part.inp part.msh                          Gmsh 4.1, text
  greenstage convert part.vtk part.msh --encoding msh41-binary
  greenstage convert part.msh part.vtu                          for ParaView
  greenstage convert part.msh part.node                         and part.ele beside it
  greenstage convert part.msh metres.msh --unit mm              from millimetres

Gmsh and Abaqus files keep regions, their names and node groups; the others only the numbers of
regions. A line is printed for each thing left out or lost. It reads every format that scenes read:
`greenstage manual meshes`.";

/// Convert a tetrahedral mesh from one file format to another
///
/// The formats follow from the extensions. Negatively oriented tetrahedra are flipped, nodes of no tetrahedron are
/// dropped, and elements of higher order keep only their corners, as wherever a mesh is read.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Mesh to read
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// Where to write, whole or not at all; overwrites a mesh of that format, and nothing else
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    /// Unit of the input's coordinates: m, in, cm, mm, um; they are written in metres
    #[arg(long, value_parser = find_unit)]
    pub unit: Option<&'static LengthUnit>,
    /// Or metres in one unit of the input
    #[arg(long, conflicts_with = "unit", value_parser = super::parsers::positive)]
    pub metres_per_unit: Option<f64>,
    /// How to write, where the format has several ways
    #[arg(long, value_parser = encodings())]
    pub encoding: Option<String>,
}

fn encodings() -> clap::builder::PossibleValuesParser {
    let value = |writer: &formats::Writer| clap::builder::PossibleValue::new(writer.name).help(writer.about);
    formats::writers().map(value).collect::<Vec<_>>().into()
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if surface_files::is_surface_file(&args.input) {
        let (input, named) = (args.input.display(), quoted(&args.input.to_string_lossy()));
        return Err(Failure::wrong(format!(
            "{input}: a surface, which has no tetrahedra to convert; `greenstage new {named}` makes a scene that fills it"
        )));
    }
    let encoding = args.encoding.as_deref();
    let writer = formats::writer_of(&args.output, encoding)?;
    mesh::try_save(&args.output, encoding, &args.input)?;
    let asked = args.unit.map(|unit| unit.metres).or(args.metres_per_unit);
    let loaded = Scale(asked.unwrap_or(1.0)).applied(mesh::load(&args.input)?);
    let lost = mesh::save(&args.output, &loaded.mesh, encoding)?;
    for notice in loaded.notices.iter().map(|notice| format!("read: {notice}")).chain(lost) {
        notice!("note: {notice}");
    }
    let mesh = &loaded.mesh;
    let (low, high) = bounding_box(&mesh.nodes);
    if let Some(doubt) = implausible((high - low).amax(), LARGEST_M).filter(|_| asked.is_none()) {
        notice!("note: {doubt}; `convert --unit mm` writes metres");
    }
    let regions: std::collections::BTreeSet<u32> = mesh.regions.iter().copied().collect();
    print(&format!(
        "{}: {} nodes, {} tetrahedra, {}, {}\n{}: written ({})\n",
        args.input.display(),
        mesh.nodes.len(),
        mesh.tets.len(),
        count(regions.len(), "region"),
        count(mesh.groups.len(), "node group"),
        args.output.display(),
        writer.about,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer was "not a mesh file that can be read".
    #[test]
    fn a_surface_is_answered_with_the_command_that_fills_it() {
        let (input, output) = (PathBuf::from("part.stl"), PathBuf::from("part.msh"));
        let args = Args { input, output, unit: None, metres_per_unit: None, encoding: None };
        let told = run(&args).err().unwrap().to_string();
        assert!(
            told.starts_with("part.stl: a surface") && told.contains("`greenstage new part.stl`"),
            "{told}"
        );
    }
}
