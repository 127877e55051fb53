//! Saves results from a window: a picture of it, a video, the deformed bodies as a file for other programs, a recording of the
//! session.
//!
//! Files stand in the folder in which the program was started, a recording with the name of its scene, the others with date and
//! time. The surfaces are those that [`crate::export`] writes for a list of poses, in the coordinates of the bodies' meshes, m.

use super::video::Video;
use crate::base::failure::Failure;
use crate::base::output;
use crate::base::text::quoted;
use crate::display::pictures::PNG;
use crate::edit::save::save as save_scene;
use crate::export::{Exporter, Geometry, PoseResult, ResultSet};
use crate::prepare::Resolved;
use crate::render::window::Windows;
use crate::scene::write::Comments;
use crate::session::Session;
use crate::world::World;
use image::RgbaImage;
use std::path::{Path, PathBuf};

/// Pictures that are wanted of a window, and a video that is being recorded.
#[derive(Default)]
pub struct Keeper {
    is_picture_wanted: bool,
    is_video_wanted: bool,
    video: Option<Video>,
}

impl Keeper {
    pub fn want_picture(&mut self) {
        self.is_picture_wanted = true;
    }

    pub fn is_recording(&self) -> bool {
        self.is_video_wanted || self.video.is_some()
    }

    /// Begins a video with the next picture, or ends the one that is being recorded; returns a message about it.
    pub fn toggle_video(&mut self) -> Option<Result<String, String>> {
        if self.video.is_none() {
            self.is_video_wanted = !self.is_video_wanted;
            return None;
        }
        self.end_video("")
    }

    /// Ends a video, where one is recorded.
    pub fn end_video(&mut self, why: &str) -> Option<Result<String, String>> {
        let video = self.video.take()?;
        let path = video.path.clone();
        Some(match video.finish() {
            Ok(recorded) => {
                Ok(format!("{why}Video of {} pictures: {}", recorded.pictures, recorded.path.display()))
            }
            Err(error) => Err(format!("The video {} was not written: {error}", path.display())),
        })
    }

    /// Asks the window for its next picture, where one is wanted at `time_s`.
    pub fn ask(&self, windows: &mut Windows, window: usize, time_s: f64) {
        let is_due = self.is_video_wanted || self.video.as_ref().is_some_and(|video| video.is_due(time_s));
        if self.is_picture_wanted || is_due {
            windows.wanted = Some(window);
        }
    }

    /// Takes the picture that was asked for; returns a message about it.
    pub fn take(&mut self, windows: &mut Windows, time_s: f64) -> Option<Result<String, String>> {
        let picture = match windows.taken.take()? {
            Ok(picture) => picture,
            Err(why) => {
                (self.is_picture_wanted, self.is_video_wanted) = (false, false);
                return Some(Err(why));
            }
        };
        let is_wanted = std::mem::take(&mut self.is_picture_wanted);
        let told = is_wanted.then(|| save(&picture).map_err(|failure| said(&failure)));
        if std::mem::take(&mut self.is_video_wanted) {
            match Video::begin(&stamped(""), [picture.width(), picture.height()]) {
                Ok(video) => self.video = Some(video),
                Err(error) => return Some(Err(format!("No video: {error}"))),
            }
        }
        let goes_on = self.video.as_mut().is_none_or(|video| video.add(picture, time_s));
        if goes_on { told } else { self.end_video("The window has changed. ") }
    }
}

fn save(picture: &RgbaImage) -> Result<String, Failure> {
    let path = stamped(".png");
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).map_err(Failure::work)?;
    output::write(&path, &PNG, |file| file.write_all(bytes.get_ref()))?;
    Ok(format!("Picture: {}", path.display()))
}

/// Begins a recording of the session, `SCENE-1.jsonl` or with the next number that is free, or ends the one that goes on; returns
/// a message about it.
pub fn toggle_recording(session: &mut Session) -> Result<String, Failure> {
    let scene = session.scene.as_ref().map(|scene| scene.path.clone()).unwrap_or_default();
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let Some(recorder) = &session.recorder else {
        let numbered = |number: u32| PathBuf::from(format!("{stem}-{number}.jsonl"));
        let is_free = |path: &PathBuf| !path.exists() && !path.with_extension("toml").exists();
        let path = (1..).map(numbered).find(is_free).unwrap_or_default();
        let scene = save_changed(session, &path.with_extension("toml"))?;
        session.record(&path)?;
        return Ok(format!("{scene}Recording the session: {}. F8 ends it.", path.display()));
    };
    // A built-in scene is no file, and is named by its name.
    let scene = if scene.exists() { scene.display().to_string() } else { stem };
    let [scene, recording] = [scene, recorder.path.display().to_string()].map(|word| quoted(&word));
    let recorded = session.stop_recording()?;
    Ok(format!("{recorded}Replay: greenstage view {scene} --replay {recording}"))
}

/// Saves the scene of a session whose bodies differ from its file, because a replay opens a file; returns a message about it.
fn save_changed(session: &mut Session, path: &Path) -> Result<String, Failure> {
    let Some(scene) = session.scene.as_ref().filter(|_| !session.is_saved) else { return Ok(String::new()) };
    let saved = save_scene(scene, &Comments::default(), session.file.as_deref(), path)?;
    session.scene = Some(Resolved::new(saved)?);
    session.is_saved = true;
    Ok(format!("The scene as it is now: {}. ", path.display()))
}

/// Writes the bodies as they are deformed now.
pub fn export(world: &World, exporter: &Exporter) -> Result<String, Failure> {
    let path = stamped(exporter.suffix);
    let contents = (exporter.write)(&now(world));
    output::write(&path, &exporter.kind, |file| file.write_all(&contents))?;
    Ok(format!("Bodies as they are: {}", path.display()))
}

/// The bodies in the pose that they have now.
pub fn now(world: &World) -> ResultSet {
    let mut set = ResultSet::default();
    for body in &world.bodies {
        let deformer = &body.deformer;
        set.geometry.push(Geometry::surface(deformer));
        set.results.push(PoseResult {
            pose: "now".to_owned(),
            body: deformer.body.clone(),
            displacement: (0..deformer.node_count()).map(|node| deformer.displacement(node)).collect(),
            stress: None,
            told: Default::default(),
            wrenches: None,
        });
    }
    set
}

/// An error in the words of a window.
pub fn said(failure: &Failure) -> String {
    failure.to_string()
}

/// `greenstage-2026-07-04-173012` with the end of the file's name; where that stands already, with a number.
fn stamped(end: &str) -> PathBuf {
    let name = format!("greenstage-{}", date_and_time());
    let is_free = |path: &Path| ["", ".png", ".mp4"].iter().all(|end| !with_end(path, end).exists());
    let numbered = (2..1000).map(|number| PathBuf::from(format!("{name}-{number}{end}")));
    let first = PathBuf::from(format!("{name}{end}"));
    std::iter::once(first.clone()).chain(numbered).find(|path| is_free(path)).unwrap_or(first)
}

fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}

/// Local time.
fn date_and_time() -> String {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let seconds = now.as_secs() as libc::time_t;
    // SAFETY: all fields are numbers, or a pointer that nobody follows.
    let mut local: libc::tm = unsafe { std::mem::zeroed() };
    // SAFETY: both point to what outlives the call.
    unsafe { libc::localtime_r(&raw const seconds, &raw mut local) };
    let (year, month) = (1900 + local.tm_year, 1 + local.tm_mon);
    let libc::tm { tm_mday: day, tm_hour: hour, tm_min: minute, tm_sec: second, .. } = local;
    format!("{year:04}-{month:02}-{day:02}-{hour:02}{minute:02}{second:02}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::{Request, Session};

    /// A recording of bodies that no file held was refused.
    #[test]
    fn a_recording_of_changed_bodies_brings_their_scene_and_is_replayed_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let text = "[body.a]\ngenerate = { block = { size = [1.0, 0.2, 0.2], cells = [5, 1, 1] } }\n\
                    material = { young = 1.0e6, poisson = 0.3 }\n\
                    control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let scene = Resolved::parse(text, &folder.path().join("scene.toml")).unwrap();
        let mut session = Session::open(&Request::new(&scene)).unwrap();
        let rotation = crate::deform::find_model("rotation").unwrap();
        (session.scene, session.is_saved) = (Some(scene.with_model("a", rotation)), false);
        let path = folder.path().join("scene-1.toml");
        assert!(save_changed(&mut session, &path).unwrap().contains("scene-1.toml"));
        assert!(session.is_saved && save_changed(&mut session, &path).unwrap().is_empty());
        assert_eq!(Resolved::load(&path).unwrap().bodies["a"].model.name, "rotation");
    }
}
