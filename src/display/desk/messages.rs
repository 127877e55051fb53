//! Messages that the window shows for a few seconds, and the progress of a computation.

use super::style::{GOOD, WRONG};
use crate::base::notice::notice;
use crate::base::text::one_line;
use crate::session::change::Step;
use egui::{Align2, Area, Context, Frame, Id, ProgressBar, Rect, RichText, Ui, vec2};
use std::time::{Duration, Instant};

/// Time for which a message is shown.
/// Time for which an error is shown.
const SHOWN: Duration = Duration::from_secs(5);
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
