//! `greenstage demo`, and `greenstage` alone: the story in one window; where there is no display, as pictures and a film.

use super::parsers;
use super::print::print;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::demo::{CHAPTERS, film, live};
use crate::display::device;
use crate::render::{Samples, window};
use std::path::{Path, PathBuf};

/// Play the demo: seven chapters in one window, which you can take over with the mouse at any time
///
/// The window names the keys. Without a display, or with --output, the demo is written as pictures, a contact sheet and a film.
/// The first start computes what is needed and keeps it in ~/.cache/greenstage.
#[derive(Debug, Default, clap::Args)]
pub struct Args {
    /// The chapter to start with; with --output the only one
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=CHAPTERS.len() as i64))]
    pub chapter: Option<u8>,
    /// Make pictures and a film in this folder in place of opening a window; overwrites files of its own names, and nothing
    /// else. Without a display: out/demo
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Pictures alone, no film
    #[arg(long)]
    pub no_film: bool,
    /// Width of a picture; its height is 5/8 of it, and a film is half as wide; default: 1280
    #[arg(long, value_parser = clap::value_parser!(u32).range(64..=7680))]
    pub width: Option<u32>,
    /// Samples per pixel: 1, 4, or auto: 4 on a graphics device and in pictures, else 1
    #[arg(long, default_value = "auto", value_parser = parsers::samples)]
    pub samples: Samples,
    /// Quit after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    #[command(flatten)]
    pub device: device::Args,
}

const WIDTH: u32 = 1280;
const FOLDER: &str = "out/demo";

pub fn run(args: &Args) -> Result<(), Failure> {
    let chapter = args.chapter.map(|number| usize::from(number) - 1);
    let display = window::find_display();
    if let (Ok(_), None) = (&display, &args.output) {
        let options = live::Options {
            chapter: chapter.unwrap_or(0),
            samples: args.samples,
            limit_s: args.seconds,
            device: args.device,
        };
        return live::run(options);
    }
    let width = args.width.unwrap_or(WIDTH);
    let request = film::Request {
        folder: args.output.clone().unwrap_or_else(folder),
        chapters: chapter.map_or_else(|| (0..CHAPTERS.len()).collect(), |chapter| vec![chapter]),
        size: [width, width * 5 / 8],
        samples: if args.samples == Samples::Auto { Samples::Exactly(4) } else { args.samples },
        film: !args.no_film,
        device: args.device,
    };
    if let (Err(reason), None) = (display, &args.output) {
        notice!("{reason}: pictures go to {}", request.folder.display());
    }
    print(&request.make()?)
}

/// Default folder of the pictures: here, or among the temporary files where this folder takes none.
fn folder() -> PathBuf {
    let here = PathBuf::from(FOLDER);
    let takes =
        |folder: &Path| std::fs::create_dir_all(folder).is_ok() && tempfile::tempfile_in(folder).is_ok();
    if takes(&here) { here } else { std::env::temp_dir().join("greenstage-demo") }
}
