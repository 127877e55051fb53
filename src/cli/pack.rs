//! `greenstage pack`: a .green file made small for shipping, and back.

use super::print::print;
use crate::base::failure::Failure;
use crate::base::output;
use crate::base::table::bytes;
use crate::green;
use std::path::PathBuf;

/// Make a .green file small for shipping, or unpack one
///
/// FILE.green becomes FILE.green.zst, FILE.green.zst becomes FILE.green. Beside its scene the packed file is enough:
/// `view`, `render`, `deform` and `bench` unpack it where the .green file is missing. Nothing is lost; to make it
/// smaller still, write storage = { error = 1e-4 } in the scene; the file records the error that this makes (`greenstage inspect`).
#[derive(Debug, clap::Args)]
pub struct Args {
    /// File to pack or to unpack
    pub file: PathBuf,
    /// Where to write; default: beside it. Overwrites a file of that kind, and nothing else
    #[arg(short, long)]
    pub output: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let is_packed = args.file.extension().is_some_and(|extension| extension == "zst");
    let beside = if is_packed { args.file.with_extension("") } else { green::packed_path(&args.file) };
    let to = args.output.clone().unwrap_or(beside);
    let kind = if is_packed { &green::GREEN } else { &green::PACKED };
    output::try_path(&to, kind, std::slice::from_ref(&args.file))?;
    if is_packed {
        let size = green::unpack(&args.file, &to)?;
        return print(&format!("{}: {}\n", to.display(), bytes(size as f64)));
    }
    let (whole, small) = green::pack(&args.file, &to)?;
    print(&format!("{}: {} from {}\n", to.display(), bytes(small as f64), bytes(whole as f64)))
}
