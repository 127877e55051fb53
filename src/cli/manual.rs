//! `greenstage manual`: prints the manual.

use super::failure::Failure;
/// in work
#[derive(Debug, clap::Args)]
pub struct Args {
    pub scene: std::path::PathBuf,
}
impl Args {
    pub fn demo(scene: std::path::PathBuf) -> Args {
        Args { scene }
    }
}
pub fn run(_args: &Args) -> Result<(), Failure> {
    Ok(())
}
