//! Style of the panel: the colours of the overlays, letters that are read from an arm's length.

use crate::display::caption::{DARK, INK};
use egui::{Color32, Context, FontFamily, FontId, TextStyle, Ui, Visuals, vec2};

pub const GOOD: Color32 = Color32::from_rgb(152, 195, 121);
pub const WRONG: Color32 = Color32::from_rgb(236, 120, 100);
pub const ACTION: Color32 = Color32::from_rgb(46, 98, 150);

pub fn apply(context: &Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        let font = |size| FontId::new(size, FontFamily::Proportional);
        style.text_styles = [
            (TextStyle::Small, font(13.0)),
            (TextStyle::Body, font(15.0)),
            (TextStyle::Button, font(15.0)),
            (TextStyle::Heading, font(18.0)),
            (TextStyle::Monospace, FontId::new(14.0, FontFamily::Monospace)),
        ]
        .into();
        style.spacing.item_spacing = egui::vec2(8.0, 7.0);
        style.spacing.button_padding = egui::vec2(8.0, 4.0);
        // A name stands in the middle of its line, beside a button as well.
        style.spacing.interact_size.y = 25.0;
        style.spacing.slider_width = 152.0;
        style.spacing.window_margin = egui::Margin::same(12);
        style.visuals = Visuals::dark();
        style.visuals.override_text_color = Some(INK);
        style.visuals.window_fill = DARK;
        style.visuals.panel_fill = style.visuals.window_fill;
        style.animation_time = 0.0;
    });
}

/// A number that is typed or dragged; all are equally wide.
pub fn number(ui: &mut Ui, value: egui::DragValue<'_>) {
    ui.add_sized(vec2(78.0, ui.spacing().interact_size.y), value);
}

/// A line with its name in the first column.
pub fn row<R>(ui: &mut Ui, name: &str, content: impl FnOnce(&mut Ui) -> R) -> egui::Response {
    ui.horizontal(|ui| {
        let size = vec2(74.0, ui.spacing().interact_size.y);
        ui.allocate_ui_with_layout(size, egui::Layout::left_to_right(egui::Align::Center), |ui| {
            ui.set_min_width(size.x);
            ui.label(name);
        });
        content(ui);
    })
    .response
}
