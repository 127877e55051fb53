//! The demo in a window.

use super::chapters::CHAPTERS;
use super::preparation::Preparation;
use super::story::Story;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::display::device;
use crate::render::window::{self, AppError, Flow, Input, WindowApp, WindowOptions, Windows};
use crate::render::{Gpu, Samples};
use std::time::Instant;

/// Options of the window's drawing, and its time limit.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// The first chapter, counted from 0.
    pub chapter: usize,
    pub samples: Samples,
    /// Time after which the window closes, s.
    pub limit_s: Option<f64>,
    pub device: device::Args,
}

/// Opens the window and runs the story until it is closed.
pub fn run(options: Options) -> Result<(), Failure> {
    let all = CHAPTERS.len();
    let order = (0..all).map(|k| (options.chapter + k) % all).collect();
    let preparation = Preparation::start(order).map_err(Failure::work)?;
    let story = Story::new(preparation, options.chapter, options.device);
    let spec = story.spec()?;
    let now = Instant::now();
    let mut app = Application {
        story,
        samples: options.samples,
        started: now,
        last: now,
        limit_s: options.limit_s,
        failure: None,
    };
    window::run(&[spec], WindowOptions { samples: options.samples, vsync: true }, &mut app)
        .map_err(Failure::work)?;
    app.failure.map_or(Ok(()), Err)
}

struct Application {
    story: Story,
    samples: Samples,
    started: Instant,
    last: Instant,
    limit_s: Option<f64>,
    failure: Option<Failure>,
}

impl WindowApp for Application {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        notice!("demo: drawing on {}", device::describe(gpu, self.samples));
        (self.started, self.last) = (Instant::now(), Instant::now());
        Ok(())
    }

    fn input(&mut self, input: Input) {
        self.story.input(input);
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let step_s = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        if let Err(failure) = self.story.frame(windows, step_s) {
            self.failure = Some(failure);
            return Ok(Flow::Quit);
        }
        let is_over = self.limit_s.is_some_and(|limit_s| self.started.elapsed().as_secs_f64() >= limit_s);
        Ok(if is_over { Flow::Quit } else { Flow::Continue })
    }
}
