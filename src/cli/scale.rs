//! `greenstage scale`: how the offline stage grows with the mesh.

use super::print::print;
use super::{marks, parsers};
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::output::{self, Kind};
use crate::base::progress::Bars;
use crate::report::scale::{self, Request};
use std::path::{Path, PathBuf};

/// Measure how the offline stage grows with the mesh: every solver on boxes from 1000 nodes to a million
///
/// Solves boxes of growing numbers of nodes for the 24 columns of two control elements, by every solver that fits into
/// memory, and prints iterations, the time of every phase, the largest memory and the forward error. With -o also as
/// scale.csv, scale-time.svg and scale-memory.svg.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Nodes of the largest box: 1000, 3000, 10000, … are measured up to there
    #[arg(long, default_value_t = 30_000)]
    pub up_to: usize,
    /// Relative residual of conjugate gradients
    #[arg(long, default_value_t = 1e-8, value_parser = parsers::positive)]
    pub tolerance: f64,
    /// Leave out what would take longer, by the growth of its solver so far, s
    #[arg(long, default_value_t = 900.0, value_parser = parsers::positive)]
    pub limit: f64,
    /// Folder for scale.csv and the plots
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// A Markdown file whose lines between `<!-- scale: begin -->` and `<!-- scale: end -->` become the table
    #[arg(long)]
    pub readme: Option<PathBuf>,
    /// Show no progress bars
    #[arg(short, long)]
    pub quiet: bool,
    /// Measure although this program was compiled for tests, whose times mean nothing
    #[arg(long, hide = true)]
    pub test_build: bool,
}

const CSV: Kind = Kind {
    name: "a table of `scale`",
    recognizes: |head| head.starts_with(b"nodes,solver,method,iterations,"),
};
const PLOT: Kind = Kind {
    name: "a plot of `scale`",
    recognizes: |head| head.windows(18).any(|window| window == b" class=\"gs-plot\" r"),
};

pub fn run(args: &Args) -> Result<(), Failure> {
    args.readme.as_ref().map_or(Ok(()), |readme| marks::try_between(readme, "scale"))?;
    if let Some(folder) = &args.output {
        output::make_folder(folder)?;
        for (name, kind) in [("scale.csv", &CSV), ("scale-time.svg", &PLOT), ("scale-memory.svg", &PLOT)] {
            output::try_path(&folder.join(name), kind, &[])?;
        }
    }
    if args.tolerance > 1e-3 {
        return Err(Failure::wrong(format!("--tolerance {}: at most 1e-3", args.tolerance)));
    }
    if args.up_to < scale::LEAST {
        return Err(Failure::wrong(format!(
            "--up-to {}: the smallest box has {} nodes: name as many or more",
            args.up_to,
            scale::LEAST
        )));
    }
    machine::expect_full_speed(args.test_build).map_err(Failure::request)?;
    let request = Request { up_to: args.up_to, tolerance: args.tolerance, limit_s: args.limit };
    let (rows, left) = scale::measure(&request, &Bars::new("box", args.quiet));
    let mut text = format!("{}\n\n{}", machine::description(), scale::table(&rows).text());
    for (solver, nodes, why) in &left {
        text += &format!("\n{solver} is left at {nodes} nodes: {why}\n");
    }
    if let Some(folder) = &args.output {
        write(&folder.join("scale.csv"), &CSV, &scale::csv(&rows))?;
        for (name, picture) in scale::pictures(&rows) {
            write(&folder.join(format!("{name}.svg")), &PLOT, &picture.file())?;
        }
    }
    if let Some(readme) = &args.readme {
        let table = scale::table(&rows).markdown();
        marks::write_between(readme, "scale", &format!("{}:\n\n{table}\n", machine::description()))?;
    }
    print(&text)
}

fn write(path: &Path, kind: &Kind, text: &str) -> Result<(), Failure> {
    Ok(output::write(path, kind, |file| file.write_all(text.as_bytes()))?)
}
