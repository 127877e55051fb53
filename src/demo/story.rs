//! Runs the chapters: which is shown, at what time of its script, and with which caption.
//!
//! In: the time that has passed, keys and the mouse. Out: frames for a [`Presenter`]. Keys of the story are taken here; all
//! others go to the scene, where a press of a mouse button or another key takes over from the script. The story then rests until
//! it is called again.

use super::chapters::{CHAPTERS, Chapter, Looks, workbench};
use super::preparation::{Preparation, Readiness, Ready};
use crate::base::failure::Failure;
use crate::base::plates::Anchor;
use crate::display::bodies::GpuBodies;
use crate::display::caption::Caption;
use crate::display::device;
use crate::display::presenter::Presenter;
use crate::display::screen_windows::ScreenWindows;
use crate::display::stage_model::Camera;
use crate::display::window_layout::WindowFrame;
use crate::effect::{self, Resolved};
use crate::interact::Action;
use crate::render::window::{Input, Key, WindowSpec};
use crate::render::{Drawable, Gpu, RenderError};
use crate::session::{Leader, Session};
use crate::stage::Stage;
use crate::track::find_stage;
use crate::world::World;
use nalgebra::Vector3;
use std::sync::Arc;

/// The last moment of a script that is shown, s after its end: before it would begin anew.
const AFTER_S: f64 = 0.5;
/// Longest step of the story by a frame, s: a frame that took longer does not make it jump over anything.
const LONGEST_STEP_S: f64 = 0.1;
/// Time for which the keys are shown at the start, s.
/// Time for which the keys are shown after their first use, s.
const KEYS_S: f64 = 12.0;
/// Time in which the keys fade, s.
const KEYS_USED_S: f64 = 2.5;
const KEYS_FADE_S: f64 = 1.0;

/// Keys and mouse, as the window names them.
const KEYS: &[(&str, &str)] = &[
    ("mouse", "point, press and drag: take over"),
    ("wheel", "while dragging: nearer, farther"),
    ("right button", "while dragging: turn"),
    ("Space", "pause, go on"),
    ("N, B", "next chapter, back"),
    ("Enter", "the chapter again"),
    ("Tab", "the workbench, and back"),
    ("F1, F2", "times and readings, the room"),
    ("H", "these keys"),
    ("Esc", "quit"),
];

/// A chapter on its way through its script.
struct Shown {
    session: Session,
    screens: ScreenWindows,
    bodies: GpuBodies,
    /// `None` while what it needs is made.
    scene: Option<Arc<Resolved>>,
    sprang_back: bool,
    /// Time of the mechanics of the last frame that moved anything, s.
    mechanics_s: f64,
    /// The camera of a chapter that looks at the room rests, because somebody has turned it.
    camera_rests: bool,
}

/// The chapters, and the state of the story.
pub struct Story {
    preparation: Preparation,
    /// The chapter that is shown.
    pub chapter: usize,
    /// The chapter to which the key to the workbench leads back.
    back_to: Option<usize>,
    /// The time in the chapter, s.
    pub clock_s: f64,
    paused: bool,
    /// Time for which the keys are still shown, s.
    keys_s: f64,
    shown: Option<Shown>,
    device: device::Args,
}

impl Story {
    pub fn new(preparation: Preparation, chapter: usize, device: device::Args) -> Story {
        let (back_to, shown) = (None, None);
        Story { preparation, chapter, back_to, clock_s: 0.0, paused: false, keys_s: KEYS_S, shown, device }
    }

    fn telling(&self) -> &'static Chapter {
        &CHAPTERS[self.chapter]
    }

    /// The one window of the demo.
    pub fn spec(&self) -> Result<WindowSpec, Failure> {
        let stage = find_stage(self.telling().stage).map_err(Failure::request)?;
        let [spec] = &ScreenWindows::new(&stage, None).specs(&stage)[..] else {
            return Err(Failure::wrong(format!("the stage {} has several windows", stage.name)));
        };
        Ok(WindowSpec { title: "greenstage – demo".into(), ..spec.clone() })
    }

    /// No keys are named: nobody can press them.
    pub fn without_keys(mut self) -> Story {
        self.keys_s = 0.0;
        self
    }

    /// Waits until what the present chapter needs is made, and opens it.
    pub fn open_ready(&mut self, gpu: &Gpu) -> Result<(), Failure> {
        let ready = self.preparation.wait(self.chapter)?;
        self.open(gpu, &Readiness::Ready(ready))
    }

    /// The chapter from its beginning.
    pub fn go_to(&mut self, chapter: usize) {
        (self.chapter, self.clock_s, self.paused) = (chapter % CHAPTERS.len(), 0.0, false);
        self.shown = None;
    }

    /// Whether a script leads, or nobody has taken over from it.
    fn is_told(&self) -> bool {
        let told = |shown: &Shown| shown.session.input.leader() == Leader::Script && !shown.camera_rests;
        self.shown.as_ref().is_some_and(told)
    }

    /// Length of the present chapter's script, s, once it is there.
    pub fn duration_s(&self) -> Option<f64> {
        let shown = self.shown.as_ref()?;
        shown.scene.as_ref()?;
        shown.session.input.script.as_ref().map(|script| script.duration_s)
    }

    pub fn input(&mut self, input: Input) {
        let was_told = self.is_told();
        if let Input::Key { key, pressed: true, .. } = input
            && self.key(key)
        {
            return;
        }
        if let Input::Button { pressed: true, .. } = input {
            self.keys_s = self.keys_s.min(KEYS_USED_S);
        }
        let Some(shown) = &mut self.shown else { return };
        let turns = matches!(input, Input::Button { pressed: true, .. } | Input::Wheel { .. });
        let is_room = CHAPTERS[self.chapter].looks == Looks::AtRoom;
        shown.camera_rests |=
            is_room && (turns || matches!(input, Input::Key { key: Key::Function(_), pressed: true, .. }));
        shown.screens.input(input, &mut shown.session);
        if was_told && !self.is_told() {
            self.paused = false;
        }
    }

    /// Takes a key of the story's own; false leaves it to the scene.
    fn key(&mut self, key: Key) -> bool {
        let all = CHAPTERS.len();
        match key {
            Key::Char(' ') => self.paused = !self.paused,
            Key::Char('n') | Key::PageDown => self.go_to(self.chapter + 1),
            Key::Char('b') | Key::PageUp => self.go_to(self.chapter + all - 1),
            Key::Enter => self.go_to(self.chapter),
            Key::Tab => match self.back_to.take() {
                Some(chapter) if self.chapter == workbench() => self.go_to(chapter),
                _ if self.chapter == workbench() => self.go_to(0),
                _ => {
                    self.back_to = Some(self.chapter);
                    self.go_to(workbench());
                }
            },
            Key::Char('h') => {
                self.keys_s = if self.keys_s > 0.0 { 0.0 } else { f64::INFINITY };
                return true;
            }
            _ => return false,
        }
        self.keys_s = self.keys_s.min(KEYS_USED_S);
        true
    }

    /// Moves on and draws, `step_s` after the frame before.
    pub fn frame(&mut self, presenter: &mut dyn Presenter, step_s: f64) -> Result<(), Failure> {
        let told_s = step_s.min(LONGEST_STEP_S);
        self.keys_s = (self.keys_s - told_s).max(0.0);
        let readiness = self.preparation.readiness(self.chapter);
        if self.shown.as_ref().is_none_or(|shown| shown.scene.is_none()) {
            self.open(presenter.gpu(), &readiness)?;
        }
        self.advance(told_s)?;
        let caption = self.caption(&readiness);
        let Some(Shown { session, screens, bodies, .. }) = &mut self.shown else { return Ok(()) };
        // The caption stands where these would, and says what they say.
        let is_curve = |it: &Drawable| it.plate().is_some_and(|plate| plate.anchor == Anchor::LowerLeft);
        session.world.frame.drawables.retain(|it| !is_curve(it));
        screens.overlays.caption = Some(Box::new(caption));
        let (covered, track_s) = (Default::default(), 0.0);
        let mut frame = WindowFrame { presenter, session, bodies, edited: None, covered, step_s, track_s };
        screens.draw(&mut frame).map_err(|error| Failure::work(RenderError::App(error)))
    }

    /// Moves the chapter on, without a picture.
    pub fn advance(&mut self, step_s: f64) -> Result<(), Failure> {
        let is_told = self.is_told();
        let chapter = self.telling();
        let Some(shown) = self.shown.as_mut().filter(|shown| shown.scene.is_some()) else { return Ok(()) };
        if !self.paused {
            self.clock_s += step_s;
        }
        let end_s = shown.session.input.script.as_ref().map(|script| script.duration_s);
        if is_told && end_s.is_some_and(|end_s| self.clock_s > end_s + chapter.holds_s) {
            self.go_to(self.chapter + 1);
            return Ok(());
        }
        if is_told && !shown.sprang_back && chapter.springs_back_s.is_some_and(|at| self.clock_s >= at) {
            shown.sprang_back = true;
            shown.session.act(Action::SnapBack);
        }
        shown.session.advance(end_s.map_or(self.clock_s, |end_s| self.clock_s.min(end_s + AFTER_S)))?;
        let times = shown.session.world.frame.times;
        if times.deform_s > 0.0 {
            shown.mechanics_s = times.total_s();
        }
        if chapter.looks == Looks::AtRoom && !shown.camera_rests {
            let camera = Camera::facing(&shown.session.world.assets.stage);
            // Round from behind the viewer's shoulder; lower, so that the caption hides nothing.
            let azimuth = camera.azimuth - 0.55 + 0.16 * self.clock_s;
            let target = camera.target - Vector3::y() * (0.07 * camera.distance_m);
            shown.screens.overlays.show_room(Camera { azimuth, target, ..camera });
        }
        Ok(())
    }

    /// Opens the chapter, or its empty stage where what it needs is still made.
    fn open(&mut self, gpu: &Gpu, readiness: &Readiness) -> Result<(), Failure> {
        let chapter = self.telling();
        let mut session = match readiness {
            Readiness::Ready(ready) => session(chapter, ready)?,
            _ if self.shown.is_some() => return Ok(()),
            _ => Session::new(World::of_stage(find_stage(chapter.stage).map_err(Failure::request)?)?, None),
        };
        let scene = match readiness {
            Readiness::Ready(ready) => Some(ready.scene.clone()),
            _ => None,
        };
        session.attach_mouse();
        let bodies = GpuBodies::new(gpu, &mut session.world, self.device)?;
        let screens = ScreenWindows::new(&session.world.assets.stage, None);
        let (sprang_back, mechanics_s, camera_rests) = (false, 0.0, false);
        self.shown = Some(Shown { session, screens, bodies, scene, sprang_back, mechanics_s, camera_rests });
        self.clock_s = 0.0;
        Ok(())
    }

    /// Waits for what effects compute in the background, before a picture that is kept.
    pub fn wait_for_effects(&mut self) {
        if let Some(Shown { session, .. }) = &mut self.shown {
            session.world.before_picture();
        }
    }

    fn caption(&self, readiness: &Readiness) -> Caption {
        let Chapter { title, text, numbers, .. } = self.telling();
        let faded = (self.keys_s / KEYS_FADE_S).min(1.0) as f32;
        let mut caption = Caption {
            title: (*title).to_owned(),
            text: (*text).to_owned(),
            chapter: (self.chapter, CHAPTERS.len()),
            keys: KEYS.iter().map(|(key, what)| ((*key).to_owned(), (*what).to_owned())).collect(),
            keys_shown: faded,
            ..Caption::default()
        };
        match readiness {
            Readiness::Failed(why) => caption.numbers = format!("This chapter cannot be shown: {why}"),
            Readiness::Waiting => caption.numbers = "Computed once, after the chapters before it …".into(),
            Readiness::Working { step, share } => {
                caption.numbers = format!("Computed once – {step} {:.0} %", 100.0 * share);
                caption.share = *share;
            }
            Readiness::Ready(_) => {
                if let Some((shown, scene)) =
                    self.shown.as_ref().and_then(|shown| Some((shown, shown.scene.as_ref()?)))
                {
                    caption.numbers = numbers(scene, &shown.session.world, shown.mechanics_s);
                    let is_told = self.is_told();
                    caption.share = self.duration_s().map_or(1.0, |end_s| self.clock_s / end_s);
                    if !is_told {
                        caption.share = 1.0;
                        caption.state = "you lead – Enter replays the chapter".into();
                    } else if self.paused {
                        caption.state = "paused".into();
                    }
                }
            }
        }
        caption
    }
}

/// A session of a chapter from its beginning.
fn session(chapter: &Chapter, Ready { scene, file }: &Ready) -> Result<Session, Failure> {
    let stage: Stage = find_stage(chapter.stage).map_err(Failure::request)?;
    let script = crate::session::open::script(scene, None)?;
    let mut session = Session::new(effect::world(effect::EFFECTS, scene, file, stage)?, script);
    session.file = Some(file.clone());
    Ok(session)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A story for which nothing is made.
    fn story(chapter: usize) -> Story {
        Story::new(Preparation::start(Vec::new()).unwrap(), chapter, device::Args::default())
    }

    fn press(story: &mut Story, key: Key) {
        story.input(Input::Key { window: 0, key, pressed: true });
        story.input(Input::Key { window: 0, key, pressed: false });
    }

    #[test]
    fn keys_lead_through_the_chapters_and_to_the_workbench_and_back() {
        let mut story = story(1);
        press(&mut story, Key::Char('n'));
        assert_eq!(story.chapter, 2);
        press(&mut story, Key::PageUp);
        press(&mut story, Key::Char('b'));
        press(&mut story, Key::Char('b'));
        assert_eq!(story.chapter, CHAPTERS.len() - 1, "from the first back to the last");
        press(&mut story, Key::PageDown);
        press(&mut story, Key::PageDown);
        press(&mut story, Key::Tab);
        assert_eq!(CHAPTERS[story.chapter].name, "workbench");
        press(&mut story, Key::Tab);
        assert_eq!(story.chapter, 1);
        (story.clock_s, story.paused) = (2.0, true);
        press(&mut story, Key::Enter);
        assert_eq!((story.chapter, story.clock_s, story.paused), (1, 0.0, false));
    }

    #[test]
    fn the_keys_are_named_at_first_and_fade_once_one_is_used() {
        let mut story = story(0);
        let shown = |story: &Story| story.caption(&Readiness::Waiting).keys_shown;
        assert_eq!(shown(&story), 1.0);
        press(&mut story, Key::Char(' '));
        assert_eq!((shown(&story), story.keys_s), (1.0, KEYS_USED_S));
        story.keys_s = 0.5 * KEYS_FADE_S;
        assert_eq!(shown(&story), 0.5);
        press(&mut story, Key::Char('h'));
        assert_eq!(shown(&story), 0.0);
        press(&mut story, Key::Char('h'));
        assert_eq!(shown(&story), 1.0);
    }

    #[test]
    fn what_is_computed_and_what_failed_is_told() {
        let story = story(2);
        let step = "bear: solves".to_owned();
        let told = story.caption(&Readiness::Working { step, share: 0.25 });
        assert!(told.numbers.contains("bear: solves 25 %"), "{}", told.numbers);
        assert_eq!((told.share, told.chapter), (0.25, (2, CHAPTERS.len())));
        let told = story.caption(&Readiness::Failed("no space left".into()));
        assert!(told.numbers.contains("cannot be shown: no space left"), "{}", told.numbers);
    }
}
