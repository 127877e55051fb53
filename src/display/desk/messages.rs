//! Messages that the window shows for a few seconds: the progress of a computation, the result of a change of the scene, or
//! why the change was refused; and the orders of a person at the desk, by the panel or by a key.

use super::style::{GOOD, WRONG};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::text::one_line;
use crate::deform::load_refusal;
use crate::prepare::Resolved;
use crate::scene::Scene;
use crate::session::change::Step;
use egui::{Align2, Area, Context, Frame, Id, ProgressBar, Rect, RichText, Ui, vec2};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time for which a message is shown.
const SHOWN: Duration = Duration::from_secs(5);
/// Time for which an error is shown.
const WRONG_SHOWN: Duration = Duration::from_secs(15);
/// Messages at once.
const MOST: usize = 4;

#[derive(Default)]
pub struct Messages(Vec<Message>);

struct Message {
    text: String,
    is_wrong: bool,
    until: Instant,
}

impl Messages {
    pub fn tell(&mut self, text: &str) {
        self.add(text, false);
    }

    pub fn wrong(&mut self, text: &str) {
        self.add(text, true);
    }

    pub fn say(&mut self, told: Result<String, String>) {
        match told {
            Ok(text) => self.tell(&text),
            Err(text) => self.wrong(&text),
        }
    }

    /// Adds a message, and writes it to standard error as well, where it stays.
    fn add(&mut self, text: &str, is_wrong: bool) {
        notice!("{}{text}", if is_wrong { "note: " } else { "" });
        let until = Instant::now() + if is_wrong { WRONG_SHOWN } else { SHOWN };
        self.0.push(Message {
            text: text.lines().map(one_line).collect::<Vec<_>>().join("\n"),
            is_wrong,
            until,
        });
        let surplus = self.0.len().saturating_sub(MOST);
        self.0.drain(..surplus);
    }

    pub fn forget_old(&mut self) {
        if !self.0.is_empty() {
            let now = Instant::now();
            self.0.retain(|message| message.until > now);
        }
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Shows the messages at the lower edge; returns their rectangles.
    pub fn show(&self, context: &Context, is_recording: bool) -> Vec<Rect> {
        let mut shown = Vec::new();
        if is_recording {
            let rect = plate(context, "recording", Align2::LEFT_TOP, vec2(12.0, 12.0), |ui| {
                ui.label(RichText::new("video").color(WRONG).strong());
                ui.label("F11 ends it");
            });
            shown.push(rect);
        }
        if self.0.is_empty() {
            return shown;
        }
        let rect = plate(context, "messages", Align2::CENTER_BOTTOM, vec2(0.0, -16.0), |ui| {
            ui.vertical(|ui| {
                for message in &self.0 {
                    let colour = if message.is_wrong { WRONG } else { GOOD };
                    ui.label(RichText::new(&message.text).color(colour));
                }
            });
        });
        shown.push(rect);
        shown
    }
}

/// The step of a computation while the panel is hidden; returns where.
pub fn show_step(context: &Context, step: &Step) -> Rect {
    plate(context, "step", Align2::LEFT_BOTTOM, vec2(12.0, -16.0), |ui| {
        ui.set_max_width(260.0);
        progress(ui, step);
    })
}

/// A bar with the name of the step.
pub fn progress(ui: &mut Ui, step: &Step) {
    let name =
        if step.name.is_empty() { "computing".to_owned() } else { format!("computing: {}", step.name) };
    if step.units > 0 {
        let share = step.done as f32 / step.units as f32;
        ui.add(
            ProgressBar::new(share.clamp(0.0, 1.0)).text(format!("{name} {:.0} %", 100.0 * share.min(1.0))),
        );
    } else {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label(name);
        });
    }
}

fn plate(
    context: &Context,
    id: &str,
    anchor: Align2,
    offset: egui::Vec2,
    content: impl FnOnce(&mut Ui),
) -> Rect {
    let most = (context.content_rect().width() - 40.0).clamp(80.0, 760.0);
    let area = Area::new(Id::unique(id)).anchor(anchor, offset).interactable(false);
    let shown = area.show(context, |ui| {
        ui.set_max_width(most);
        Frame::window(ui.style()).show(ui, |ui| ui.horizontal(content));
    });
    shown.response.rect
}

/// Lists the differences: `tube: model rod, effects stress; stage workbench.`
pub fn changes(before: &Scene, after: &Scene) -> String {
    let mut told: Vec<String> = Vec::new();
    for (name, body) in &after.body {
        let Some(old) = before.body.get(name) else { continue };
        let mut parts = Vec::new();
        if body.model != old.model {
            parts.push(format!("model {}", body.model));
        }
        if body.material != old.material {
            parts.push(match body.material.known {
                Some(known) => format!("material {}", known.name),
                None => "another material".to_owned(),
            });
        }
        if body.effects != old.effects {
            parts.push(match body.effects.is_empty() {
                true => "no effects".to_owned(),
                false => format!("effects {}", body.effects.join(", ")),
            });
        }
        if body.control != old.control {
            parts.push("other control elements".to_owned());
        }
        if !parts.is_empty() {
            told.push(format!("{name}: {}", parts.join(", ")));
        }
    }
    if before.stage != after.stage {
        told.push(format!("stage {}", after.stage));
    }
    match told.is_empty() {
        true => "The scene is shown as the panel has it.".to_owned(),
        false => format!("Now {}.", told.join("; ")),
    }
}

/// Refuses a model for a body with a compliance of its surface, which the panel cannot take away.
pub fn try_compliance(scene: &Resolved) -> Result<(), Failure> {
    for ((name, body), model) in scene.body.iter().zip(scene.models()) {
        if load_refusal(model, body.surface_compliance.is_some()).is_some() {
            return Err(Failure::wrong(format!(
                "{name}: the model {} has no points that can be pulled. Take rotation or linear, or remove \
                 surface_compliance from the scene",
                model.name
            )));
        }
    }
    Ok(())
}

/// A failure without the path of the scene, which the panel shows, and its line.
pub fn refused(failure: &Failure, scene: Option<&Scene>) -> String {
    let text = failure.to_string();
    let path = scene.map(|scene| scene.path.display().to_string());
    let after = path.as_ref().and_then(|path| text.strip_prefix(path));
    let short = after.and_then(|after| {
        after.trim_start_matches(|c: char| c == ':' || c.is_ascii_digit()).strip_prefix(' ')
    });
    format!("Not changed: {}", short.unwrap_or(&text))
}

/// An order of a person in the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Show the draft of the panel.
    Apply,
    /// Give up the computation under way; the scene is shown on.
    GiveUp,
    /// Reset the draft to what is shown.
    Reset,
    Picture,
    Video,
    /// Record the session, or end that.
    Record,
    /// The bodies as they are, in the format of this name.
    Export(&'static str),
    Close,
    /// Let go of the control element under the cursor, or hold the one again that was let go of last.
    Release,
    /// Make control elements on the body of this name, or end that.
    Edit(Option<String>),
    /// Write the scene to the file of this name.
    Save(PathBuf),
}

/// Changes that windows have to follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum After {
    Nothing,
    /// The bodies are others.
    NewBodies,
    /// The bodies and the stage are others, and the windows have to be opened anew.
    NewWindows,
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "stage = \"desktop\"\n\
        [body.hose]\n\
        mesh = \"hose.msh\"\n\
        model = \"rotation\"\n\
        material = { young = 3.0e5, poisson = 0.4, density = 1100 }\n\
        gravity = true\n\
        surface_compliance = { nodes = \"surface\" }\n\
        [body.hose.control]\n\
        low = { nodes = { group = \"low\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"high\" }, grab = \"dragger\" }\n";

    #[test]
    fn a_change_is_told_by_what_is_other() {
        let before = Scene::parse(SCENE, std::path::Path::new("cache/stylus.toml")).unwrap();
        let mut after = before.clone();
        after.body["hose"].model = "linear".into();
        after.body["hose"].effects = vec!["stress".into()];
        after.stage = "workbench".into();
        assert_eq!(changes(&before, &after), "Now hose: model linear, effects stress; stage workbench.");
        assert_eq!(changes(&before, &before), "The scene is shown as the panel has it.");
    }

    #[test]
    fn a_refusal_fits_the_panel() {
        let mut scene = Scene::parse(SCENE, std::path::Path::new("cache/stylus.toml")).unwrap();
        let resolved = |scene: &Scene| Resolved::new(scene.clone()).unwrap();
        assert!(try_compliance(&resolved(&scene)).is_ok());
        scene.body["hose"].model = "rod".into();
        let told = refused(&try_compliance(&resolved(&scene)).unwrap_err(), Some(&scene));
        assert!(
            told.starts_with("Not changed: hose: the model rod") && told.contains("Take rotation"),
            "{told}"
        );
        for place in ["cache/stylus.toml", "cache/stylus.toml:17"] {
            let failure = Failure::wrong(format!("{place}: body.hose.model: no such model"));
            assert_eq!(refused(&failure, Some(&scene)), "Not changed: body.hose.model: no such model");
        }
    }
}
