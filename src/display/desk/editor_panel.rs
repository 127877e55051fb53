//! The part of the panel with which control elements are made: tools, the list of elements, node groups of the mesh.

use super::editor::{Editor, colour};
use super::style::{ACTION, WRONG, number, row};
use super::units::{METRE, read, shown};
use crate::display::caption::QUIET;
use crate::edit::Tool;
use crate::scene::{Grab, Nodes};
use egui::{Button, Color32, ComboBox, DragValue, RichText, ScrollArea, Slider, TextEdit, Ui, vec2};

pub fn show(ui: &mut Ui, editor: &mut Editor) {
    elements(ui, editor);
    ui.separator();
    tools(ui, editor);
    groups(ui, editor);
}

/// Height of the list of elements, pixels, however many there are.
const LIST: f32 = 140.0;

fn elements(ui: &mut Ui, editor: &mut Editor) {
    let mut deleted = None;
    ScrollArea::vertical().id_salt("elements").max_height(LIST).auto_shrink(false).show(ui, |ui| {
        for number in 0..editor.sketch.elements.len() {
            let [r, g, b] = colour(&editor.sketch, number);
            let is_chosen = editor.sketch.chosen == number;
            ui.horizontal(|ui| {
                let (rect, _) = ui.allocate_exact_size(vec2(14.0, 14.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 3.0, Color32::from_rgb(r, g, b));
                let element = &mut editor.sketch.elements[number];
                if is_chosen {
                    ui.add_sized([100.0, 22.0], TextEdit::singleline(&mut element.name).hint_text("name"));
                } else if ui.add_sized([100.0, 22.0], Button::new(&element.name)).clicked() {
                    editor.sketch.chosen = number;
                }
                let element = &mut editor.sketch.elements[number];
                let words = |grab| if grab == Grab::Fixed { "is fixed" } else { "can be grabbed" };
                let before = element.grab;
                ComboBox::from_id_salt(("grab", number)).width(116.0).selected_text(words(before)).show_ui(
                    ui,
                    |ui| {
                        for grab in [Grab::Fixed, Grab::Dragger] {
                            ui.selectable_value(&mut element.grab, grab, words(grab));
                        }
                    },
                );
                if element.grab != before {
                    editor.sketch.version += 1;
                }
                if ui.button("Delete").clicked() {
                    deleted = Some(number);
                }
            });
        }
    });
    if let Some(number) = deleted {
        editor.sketch.delete(number);
    }
    ui.horizontal(|ui| {
        if ui.button("Add an element").clicked() {
            editor.sketch.add();
        }
        if ui.add_enabled(editor.sketch.can_undo(), Button::new("Undo (Ctrl+Z)")).clicked() {
            editor.sketch.undo();
        }
    });
    if let Some(element) = editor.sketch.elements.get(editor.sketch.chosen) {
        let count = element.held.len();
        ui.label(
            RichText::new(format!("{} holds {count} nodes; tools change it", element.name))
                .color(QUIET)
                .small(),
        );
    }
}

fn tools(ui: &mut Ui, editor: &mut Editor) {
    let sketch = &mut editor.sketch;
    ui.horizontal_wrapped(|ui| {
        for &(tool, verb, what) in Tool::ALL {
            let button = Button::new(verb).selected(sketch.tool == tool);
            if ui.add(button).on_hover_text(what).clicked() {
                sketch.tool = tool;
            }
        }
    });
    if let Some((_, _, what)) = Tool::ALL.iter().find(|(tool, ..)| *tool == sketch.tool) {
        ui.label(RichText::new(*what).color(QUIET).small());
    }
    let extent = editor.canvas.extent();
    row(ui, "Brush", |ui| {
        let range = 0.002 * extent..=0.5 * extent;
        ui.add(Slider::new(&mut editor.sketch.radius, range.clone()).logarithmic(true).show_value(false));
        let speed = 0.01 * editor.sketch.radius;
        let value = DragValue::new(&mut editor.sketch.radius).range(range).speed(speed);
        let value = value.custom_formatter(|length, _| shown(length, METRE));
        number(ui, value.custom_parser(|text| read(text, METRE)));
    });
    let radius = editor.sketch.radius;
    ui.horizontal(|ui| {
        if ui.button("Grow").on_hover_text("by the brush's radius along the surface").clicked() {
            editor.sketch.spread(&mut editor.canvas, radius);
        }
        if ui.button("Shrink").on_hover_text("by the brush's radius along the surface").clicked() {
            editor.sketch.spread(&mut editor.canvas, -radius);
        }
        ui.label(RichText::new("the element by the brush's radius").color(QUIET).small());
    });
    ui.label(RichText::new("right button: turn the body; wheel: nearer").color(QUIET).small());
}

fn groups(ui: &mut Ui, editor: &mut Editor) {
    let is_named = |name: &&String| !name.starts_with("list [") && !name.starts_with("file ");
    let names: Vec<String> = editor.canvas.mesh.groups.keys().filter(is_named).cloned().collect();
    if names.is_empty() {
        return;
    }
    row(ui, "Group", |ui| {
        let mut taken = None;
        ComboBox::from_id_salt("group").width(200.0).selected_text("take a node group").show_ui(ui, |ui| {
            for name in &names {
                let count = editor.canvas.mesh.groups[name].len();
                if ui.button(format!("{name} ({count} nodes)")).clicked() {
                    taken = Some(name.clone());
                }
            }
        });
        if let Some(name) = taken {
            if editor.sketch.elements.is_empty() {
                editor.sketch.add();
            }
            editor.sketch.put(&editor.canvas, Nodes::Group(name));
        }
    })
    .on_hover_text("of the mesh's file, for the chosen element");
}

/// The button that computes the elements, and a line for what is missing; true where it was pressed.
pub fn precompute(ui: &mut Ui, lack: Option<String>) -> bool {
    let button = Button::new(RichText::new("Precompute and grab").strong()).fill(ACTION);
    let is_pressed = ui.add_enabled(lack.is_none(), button).clicked();
    // The line stands there in any case, so that nothing moves.
    ui.label(RichText::new(lack.unwrap_or_else(|| " ".to_owned())).color(WRONG).small());
    is_pressed
}
