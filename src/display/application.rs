//! The window application: moves a session on once a frame, and draws it into windows.
//!
//! In: a [`Session`], and what its windows show ([`Shows`]): the screens of the stage, or the stage as a model from outside.
//! Out: pictures of all windows, presented together, until a window is closed, the time is over, or a recording ends.

use super::bodies::GpuBodies;
use super::desk::{After, Desk};
use super::device;
use super::model_window::ModelWindow;
use super::screen_windows::ScreenWindows;
use super::window_layout::WindowFrame;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::green::GreenFile;
use crate::render::window::{self, AppError, Flow, Input, WindowApp, WindowOptions, WindowSpec, Windows};
use crate::render::{Gpu, Samples};
use crate::session::{Making, Session, SessionProgress};
use std::sync::Arc;
use std::time::Instant;

/// Contents of the windows.
pub enum Shows {
    Screens(Box<ScreenWindows>),
    Model(Box<ModelWindow>),
}

impl Shows {
    fn specs(&self, session: &Session) -> Vec<WindowSpec> {
        match self {
            Shows::Screens(screens) => screens.specs(&session.world.assets.stage),
            Shows::Model(model) => vec![model.spec(&session.world.assets.stage)],
        }
    }

    fn input(&mut self, input: Input, session: &mut Session) {
        match self {
            Shows::Screens(screens) => screens.input(input, session),
            Shows::Model(model) => model.input(&input),
        }
    }

    fn draw(&mut self, frame: &mut WindowFrame<'_>) -> Result<(), AppError> {
        match self {
            Shows::Screens(screens) => screens.draw(frame),
            Shows::Model(model) => model.draw(frame),
        }
    }
}

/// Options of the windows' drawing, and their time limit.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub samples: Samples,
    /// Wait for the display's refresh.
    pub vsync: bool,
    /// Time after which the windows close, s.
    pub limit_s: Option<f64>,
    pub device: device::Args,
}

/// The session after its windows were closed, with its frames and duration.
pub struct FinishedSession {
    pub session: Session,
    pub frames: u32,
    pub lasted_s: f64,
}

/// A session whose scene is not ready yet.
pub struct Opening<'a> {
    pub making: Making,
    /// Opens the session on the stage that is shown, with the file that was made.
    pub open: Box<dyn FnOnce(Arc<GreenFile>) -> Result<Session, Failure> + 'a>,
}

/// Opens the windows and runs the session until they close. It is that of an empty stage where its scene is still `opening`.
pub fn run(
    session: Session,
    opening: Option<Opening<'_>>,
    shows: Shows,
    options: Options,
) -> Result<FinishedSession, Failure> {
    let specs = shows.specs(&session);
    let is_scene = (session.scene.is_some() || opening.is_some()) && matches!(shows, Shows::Screens(_));
    let making = opening.as_ref().map(|opening| opening.making.steps.clone());
    let mut desk = is_scene.then(Desk::default);
    desk.iter_mut().for_each(|desk| desk.making.clone_from(&making));
    let now = Instant::now();
    let mut app = Application {
        session,
        opening,
        shows,
        options,
        bodies: None,
        desk,
        started: now,
        last: now,
        frames: 0,
        cursor: None,
        failure: None,
    };
    let drawn = WindowOptions { samples: options.samples, vsync: options.vsync };
    window::run(&specs, drawn, &mut app).map_err(Failure::work)?;
    app.desk.iter_mut().for_each(Desk::end);
    match app.failure {
        Some(failure) => Err(failure),
        None => Ok(FinishedSession {
            lasted_s: app.started.elapsed().as_secs_f64(),
            frames: app.frames,
            session: app.session,
        }),
    }
}

struct Application<'a> {
    session: Session,
    opening: Option<Opening<'a>>,
    shows: Shows,
    options: Options,
    bodies: Option<GpuBodies>,
    /// Present if a scene is shown.
    desk: Option<Desk>,
    started: Instant,
    last: Instant,
    frames: u32,
    /// The last place of the cursor, for a session that is opened meanwhile.
    cursor: Option<Input>,
    /// The error that ended it early.
    failure: Option<Failure>,
}

impl WindowApp for Application<'_> {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        let world = &mut self.session.world;
        notice!("{}: drawing on {}", world.assets.stage.name, device::describe(gpu, self.options.samples));
        self.bodies = Some(GpuBodies::new(gpu, world, self.options.device)?);
        (self.started, self.last) = (Instant::now(), Instant::now());
        Ok(())
    }

    fn input(&mut self, input: Input) {
        if matches!(input, Input::Cursor { .. } | Input::CursorLeft { .. }) {
            self.cursor = Some(input);
        }
        let Application { desk, shows, session, .. } = self;
        let ray = |window: usize, position: [f32; 2], session: &Session| match shows {
            Shows::Screens(screens) => screens.ray(window, position, session),
            Shows::Model(_) => None,
        };
        let meant = match desk {
            Some(desk) => desk.input(input, session, ray),
            None => Some(input),
        };
        if let Some(input) = meant {
            self.shows.input(input, &mut self.session);
        }
    }

    fn quits(&mut self) -> bool {
        !self.desk.as_mut().is_some_and(Desk::keeps_open)
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        if let Some(opening) = self.opening.take_if(|opening| opening.making.is_done())
            && let Err(failure) = self.open(opening, &windows.gpu)?
        {
            self.failure = Some(failure);
            return Ok(Flow::Quit);
        }
        let Some(bodies) = &mut self.bodies else { return Ok(Flow::Continue) };
        let step_s = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        if self.frames == 0 {
            self.options.device.apply(&windows.gpu, &mut windows.renderer)?;
        }
        match self.session.advance(self.started.elapsed().as_secs_f64()) {
            Ok(SessionProgress::Running) => {}
            Ok(SessionProgress::Ended) => return Ok(Flow::Quit),
            Err(failure) => {
                self.failure = Some(failure);
                return Ok(Flow::Quit);
            }
        }
        let mechanics_s = self.session.world.frame.times.total_s();
        let track_s = (self.last.elapsed().as_secs_f64() - mechanics_s).max(0.0);
        let session = &mut self.session;
        if let Some(desk) = &mut self.desk {
            desk.lay_out(windows, session);
        }
        let covered = self.desk.as_ref().map_or_else(Default::default, Desk::covered);
        let edited = match &mut self.desk {
            Some(desk) => desk.edited(&windows.gpu, session)?,
            None => None,
        };
        self.shows.draw(&mut WindowFrame {
            presenter: windows,
            session,
            bodies,
            edited,
            covered,
            step_s,
            track_s,
        })?;
        self.frames += 1;
        self.change(windows)?;
        let is_shown = self.opening.is_none();
        let is_over = |limit_s| is_shown && self.started.elapsed().as_secs_f64() >= limit_s;
        Ok(if self.options.limit_s.is_some_and(is_over) { Flow::Quit } else { Flow::Continue })
    }
}

impl Application<'_> {
    /// Shows the scene that was made in place of the empty stage; its time begins now.
    fn open(&mut self, opening: Opening<'_>, gpu: &Gpu) -> Result<Result<(), Failure>, AppError> {
        let Opening { making, open } = opening;
        match making.finish().and_then(open) {
            Ok(session) => self.session = session,
            Err(failure) => return Ok(Err(failure)),
        }
        self.bodies = Some(GpuBodies::new(gpu, &mut self.session.world, self.options.device)?);
        self.desk.iter_mut().for_each(|desk| desk.making = None);
        (self.started, self.last, self.frames) = (Instant::now(), Instant::now(), 0);
        if let Some(cursor) = self.cursor {
            self.input(cursor);
        }
        Ok(Ok(()))
    }

    /// Carries out what was asked for at the desk, between two frames.
    fn change(&mut self, windows: &mut Windows) -> Result<(), AppError> {
        let Some(desk) = &mut self.desk else { return Ok(()) };
        desk.take_picture(windows);
        let after = desk.step(&mut self.session);
        if after == After::Nothing {
            return Ok(());
        }
        self.bodies = Some(GpuBodies::new(&windows.gpu, &mut self.session.world, self.options.device)?);
        if after == After::NewWindows {
            self.shows = Shows::Screens(Box::new(ScreenWindows::new(&self.session.world.assets.stage, None)));
            windows.reopen = Some(self.shows.specs(&self.session));
        }
        Ok(())
    }
}
