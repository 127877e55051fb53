//! The buttons at the foot of the panel: for the sketch, for the scene, and for pictures, videos and files.

use super::editor::Sketches;
use super::editor_panel;
use super::messages::Order;
use crate::export::surfaces;
use egui::{Button, Ui};
use std::path::PathBuf;

/// Ends or throws away the sketch in hand; `lack` is what it lacks.
pub fn sketching(ui: &mut Ui, sketches: &mut Sketches, lack: Option<String>, orders: &mut Vec<Order>) {
    let Some(editor) = &mut sketches.open else { return };
    if editor_panel::precompute(ui, lack) {
        orders.push(Order::Apply);
    }
    ui.horizontal(|ui| {
        if ui.button("Leave, keep the sketch (K)").clicked() {
            orders.push(Order::Edit(None));
        }
        let away = Button::new("Throw it away");
        let away = ui.add_enabled(editor.sketch.is_changed(), away);
        if away.on_hover_text("back to the scene's control elements; Undo brings it back").clicked() {
            editor.sketch.throw_away();
        }
    });
}

/// Begins a sketch, or goes on with one.
pub fn making(ui: &mut Ui, body: Option<String>, sketches: &Sketches, orders: &mut Vec<Order>) {
    let Some(body) = body else { return };
    let words = match sketches.is_left(&body) {
        true => "Go on making control elements (K)",
        false => "Make control elements (K)",
    };
    if ui.button(words).clicked() {
        orders.push(Order::Edit(Some(body)));
    }
}

pub fn save(ui: &mut Ui, file: &mut String, orders: &mut Vec<Order>) {
    ui.horizontal(|ui| {
        ui.add(egui::TextEdit::singleline(file).desired_width(190.0).hint_text("scene.toml"));
        if ui.button("Save the scene").clicked() {
            orders.push(Order::Save(PathBuf::from(file.trim())));
        }
    });
}

pub fn keep(ui: &mut Ui, is_filmed: bool, is_recorded: bool, orders: &mut Vec<Order>) {
    ui.horizontal_wrapped(|ui| {
        if ui.button("Save a picture (F12)").clicked() {
            orders.push(Order::Picture);
        }
        let video = if is_filmed { "End the video (F11)" } else { "Record a video (F11)" };
        if ui.button(video).clicked() {
            orders.push(Order::Video);
        }
        let session = if is_recorded { "End the recording (F8)" } else { "Record the session (F8)" };
        if ui.button(session).clicked() {
            orders.push(Order::Record);
        }
    });
    ui.horizontal(|ui| {
        ui.label("Export the bodies");
        for exporter in surfaces().filter(|exporter| exporter.name() != "png") {
            if ui.button(exporter.name().to_uppercase()).clicked() {
                orders.push(Order::Export(exporter.name()));
            }
        }
    });
}
