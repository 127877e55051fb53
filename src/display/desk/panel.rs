//! The panel by which a shown scene is changed: model, material and effects of each body, the stage.
//!
//! In: the [`Draft`] of a scene. Out: the draft as a person changed it, and [`Order`]s. Nothing is checked here that the scene
//! checks itself: a message rejects what cannot be when it is tried, and the old state stays.

use super::editor::{Editor, Sketches};
use super::editor_panel;
use super::foot::{keep, making, save, sketching};
use super::messages::{Order, progress};
use super::style::{ACTION, GOOD, number, row};
use super::units::{PASCAL, read, shown};
use crate::base::failure::Failure;
use crate::deform::{Frame as ModelFrame, MODELS};
use crate::display::caption::QUIET;
use crate::effect::EFFECTS;
use crate::scene::materials::MATERIALS;
use crate::scene::write::Comments;
use crate::scene::{Body, Grab, Material, Nodes, Scene};
use crate::session::Session;
use crate::session::change::Step;
use crate::session::open::stage;
use crate::stage::{BUILT_IN, Stage};
use egui::{Button, ComboBox, Context, DragValue, Grid, RichText, ScrollArea, Slider, Ui, Window};
use std::path::Path;

/// The draft of a scene in the panel.
pub struct Draft {
    pub scene: Scene,
    /// The scene when the panel was opened.
    shown: Scene,
    /// The name of the stage, or its file's path from the scene's folder.
    stage: String,
    shown_stage: String,
    /// Number of the body whose settings are seen.
    body: usize,
    /// The name of the file to which it is saved.
    pub file: String,
}

/// State of the program while the panel is shown.
pub struct Now<'a> {
    pub session: &'a Session,
    pub step: Option<&'a Step>,
    pub is_recording: bool,
}

impl Draft {
    pub fn new(scene: &Scene) -> Draft {
        let mut scene = scene.clone();
        scene.body.values_mut().for_each(Body::forget_added);
        Draft {
            file: free_name(&scene),
            shown: scene.clone(),
            shown_stage: scene.stage.clone(),
            stage: scene.stage.clone(),
            scene,
            body: 0,
        }
    }

    /// Whether a scene is on the stage that is shown.
    pub fn is_on_shown_stage(&self, scene: &Scene) -> bool {
        scene.stage == self.shown_stage
    }

    pub fn is_changed(&self) -> bool {
        self.scene != self.shown || self.stage != self.shown_stage
    }

    /// The name of the body whose settings are seen.
    pub fn chosen(&self) -> Option<String> {
        self.scene.body.get_index(self.body).map(|(name, _)| name.clone())
    }

    /// Comments of the file to which it is saved.
    pub fn comments(&self, scene: &Scene) -> Comments {
        let mut comments = Comments::new();
        let head = "Made in the window of `greenstage view`. `greenstage manual keys` explains every key.";
        comments.insert(String::new(), head.to_owned());
        for (name, body) in &scene.body {
            if let Some(known) = body.material.known {
                comments.insert(format!("body.{name}.material"), known.what.to_owned());
            }
            for (control_name, control) in &body.control {
                let key = format!("body.{name}.control.{control_name}");
                let grab = match control.grab {
                    Grab::Fixed => "stays where it is",
                    Grab::Dragger => "can be taken with the stylus or the mouse",
                };
                comments.insert(format!("{key}.grab"), grab.to_owned());
                if let Nodes::List(tags) = &control.nodes {
                    comments
                        .insert(key, format!("Painted: {} nodes of the mesh, by their tags.", tags.len()));
                }
            }
        }
        comments
    }

    pub fn was_saved(&mut self, saved: &Scene) {
        self.file = free_name(saved);
    }

    /// Scene and stage that are to be shown; a scene that the program could not read from a file is refused.
    pub fn wanted(&self, session: &Session, editor: Option<&Editor>) -> Result<(Scene, Stage), Failure> {
        let mut scene = self.scene.clone();
        if let Some(editor) = editor
            && let Some(body) = scene.body.get_mut(&editor.body)
        {
            body.control = editor.sketch.controls();
        }
        scene.stage.clone_from(&self.stage);
        let scene = scene.checked()?;
        let stage = match self.stage == self.shown_stage {
            true => session.world.assets.stage.clone(),
            false => stage(&scene, None)?,
        };
        Ok((scene, stage))
    }
}

/// Width of the panel, pixels.
pub const WIDTH: f32 = 352.0;
/// Height of the buttons below the settings, about, pixels.
const FOOT: f32 = 200.0;
/// Height of its title, margins and the lines between, pixels.
const FRAME: f32 = 112.0;

/// Shows the panel, at first at the right edge; a person may drag it elsewhere. Returns where it is. Its settings scroll where
/// they need more room; the buttons below them are always seen, and stay where they are while a sketch grows.
pub fn show(
    context: &Context,
    draft: &mut Draft,
    sketches: &mut Sketches,
    now: &Now<'_>,
    orders: &mut Vec<Order>,
) -> Option<egui::Rect> {
    let screen = context.content_rect();
    let is_busy = now.step.is_some();
    let is_editing = sketches.open.is_some();
    // As it was in the frame before.
    let foot_id = egui::Id::unique(("panel foot", is_editing, is_busy));
    let foot = context.data(|data| data.get_temp(foot_id)).unwrap_or(FOOT);
    let shown = Window::new(if is_editing { "Make control elements" } else { "Scene" })
        .id(egui::Id::unique("panel"))
        .pivot(egui::Align2::RIGHT_TOP)
        .default_pos([screen.right() - 12.0, 12.0])
        .default_height(screen.height())
        .constrain(true)
        .resizable(false)
        .collapsible(true)
        .show(context, |ui| {
            ui.set_width(WIDTH - 24.0);
            let most = (screen.height() - FRAME - foot).max(80.0);
            let scroll = ScrollArea::vertical().max_height(most).auto_shrink([false, !is_editing]);
            let lack = scroll.show(ui, |ui| {
                // What is changed while it is computed would be lost.
                ui.add_enabled_ui(!is_busy, |ui| match &mut sketches.open {
                    Some(editor) => {
                        editor_panel::show(ui, editor);
                        ui.separator();
                        settings(ui, draft);
                        editor.sketch.lack()
                    }
                    None => {
                        bodies(ui, draft);
                        stages(ui, draft);
                        None
                    }
                })
                .inner
            });
            ui.separator();
            let foot = ui.scope(|ui| {
                match is_editing && !is_busy {
                    true => sketching(ui, sketches, lack.inner, orders),
                    false => {
                        change(ui, draft, now, orders);
                        let body = draft.chosen().filter(|_| !is_busy);
                        making(ui, body, sketches, orders);
                    }
                }
                ui.separator();
                save(ui, &mut draft.file, orders);
                keep(ui, now.is_recording, now.session.recorder.is_some(), orders);
                ui.separator();
                if ui.button("Close the panel (Tab)").clicked() {
                    orders.push(Order::Close);
                }
            });
            ui.data_mut(|data| data.insert_temp(foot_id, foot.response.rect.height()));
        });
    Some(shown?.response.rect)
}

fn bodies(ui: &mut Ui, draft: &mut Draft) {
    let names: Vec<String> = draft.scene.body.keys().cloned().collect();
    draft.body = draft.body.min(names.len().saturating_sub(1));
    if names.len() > 1 {
        row(ui, "Body", |ui| {
            ComboBox::from_id_salt("body").width(200.0).selected_text(&names[draft.body]).show_ui(ui, |ui| {
                for (number, name) in names.iter().enumerate() {
                    ui.selectable_value(&mut draft.body, number, name);
                }
            });
        });
    } else {
        row(ui, "Body", |ui| ui.label(names.first().map_or("", String::as_str)));
    }
    settings(ui, draft);
}

/// Settings of the chosen body.
fn settings(ui: &mut Ui, draft: &mut Draft) {
    let Some((_, body)) = draft.scene.body.get_index_mut(draft.body) else { return };
    model(ui, body);
    material(ui, body);
    effects(ui, body);
}

fn model(ui: &mut Ui, body: &mut Body) {
    let before = body.model.clone();
    row(ui, "Model", |ui| {
        ComboBox::from_id_salt("model").width(200.0).height(400.0).selected_text(&body.model).show_ui(
            ui,
            |ui| {
                for model in MODELS {
                    let entry = ui.selectable_value(&mut body.model, model.name.to_owned(), model.name);
                    entry.on_hover_text(in_words(model.summary));
                }
            },
        );
    });
    if before != body.model {
        // Chosen by hand now.
        (body.accuracy, body.budget, body.plan) = (None, None, None);
    }
    if let Some(model) = MODELS.iter().find(|model| model.name == body.model) {
        let [_, fair] = model.turn_limits_deg;
        let range = match model.frame {
            ModelFrame::Solved => "solved for every pose, in the background".to_owned(),
            _ => format!("fair up to turns of {fair:.0}°"),
        };
        let told = format!("{}; {range}", in_words(model.summary));
        ui.label(RichText::new(told).color(QUIET).small());
    }
}

/// The description of a model, without the paper's number of its method.
fn in_words(summary: &str) -> &str {
    let words = summary.split_once(": ").filter(|(number, _)| number.starts_with("method "));
    words.map_or(summary, |(_, words)| words)
}

fn material(ui: &mut Ui, body: &mut Body) {
    row(ui, "Material", |ui| {
        let own = "by its numbers";
        let named = body.material.known.map_or(own, |known| known.name);
        ComboBox::from_id_salt("material").width(200.0).height(400.0).selected_text(named).show_ui(
            ui,
            |ui| {
                for known in MATERIALS {
                    let is_chosen = named == known.name;
                    let what = format!("{}\n{}", known.what, known.source);
                    if ui.selectable_label(is_chosen, known.name).on_hover_text(what).clicked() {
                        body.material = Material::from(known);
                    }
                }
            },
        );
    });
    row(ui, "Stiffness", |ui| {
        ui.add(Slider::new(&mut body.material.young, 1e2..=1e12).logarithmic(true).show_value(false));
        let speed = 0.01 * body.material.young;
        let young = DragValue::new(&mut body.material.young)
            .speed(speed)
            .range(1e-3..=1e15)
            .custom_formatter(|young, _| shown(young, PASCAL))
            .custom_parser(|text| read(text, PASCAL));
        number(ui, young);
    })
    .on_hover_text("Young's modulus E, Pa");
    row(ui, "Poisson", |ui| {
        ui.add(Slider::new(&mut body.material.poisson, 0.0..=0.499).max_decimals(3).show_value(false));
        let poisson = DragValue::new(&mut body.material.poisson).speed(0.002).range(0.0..=0.499);
        number(ui, poisson.fixed_decimals(3));
    })
    .on_hover_text("Poisson's ratio ν: 0.3 of steel, 0.49 of rubber and tissue");
}

fn effects(ui: &mut Ui, body: &mut Body) {
    ui.label("Effects");
    Grid::new("effects").num_columns(2).spacing([18.0, 4.0]).show(ui, |ui| {
        for (number, effect) in EFFECTS.iter().enumerate() {
            let mut is_listed = body.effects.iter().any(|name| name == effect.name);
            let before = is_listed;
            ui.checkbox(&mut is_listed, effect.name).on_hover_text(effect.summary);
            if is_listed && !before {
                body.effects.push(effect.name.to_owned());
            } else if before && !is_listed {
                body.effects.retain(|name| name != effect.name);
            }
            if number % 2 == 1 {
                ui.end_row();
            }
        }
    });
}

fn stages(ui: &mut Ui, draft: &mut Draft) {
    row(ui, "Stage", |ui| {
        let shown = stage_name(&draft.stage);
        ComboBox::from_id_salt("stage").width(200.0).height(400.0).selected_text(shown).show_ui(ui, |ui| {
            let own = Some(draft.shown_stage.clone());
            let own = own.filter(|own| BUILT_IN.iter().all(|(name, _)| name != own));
            for name in own.into_iter().chain(BUILT_IN.iter().map(|(name, _)| (*name).to_owned())) {
                let shown = stage_name(&name);
                ui.selectable_value(&mut draft.stage, name.clone(), shown).on_hover_text(name);
            }
        });
    });
    if draft.stage != draft.shown_stage {
        ui.label(RichText::new("its windows open in place of these").color(QUIET).small());
    }
}

/// A stage as the panel shows it: a file by its name, without its folders.
fn stage_name(stage: &str) -> String {
    let file = Path::new(stage).file_name().filter(|_| stage.ends_with(".toml"));
    file.map_or_else(|| stage.to_owned(), |file| file.to_string_lossy().into_owned())
}

fn change(ui: &mut Ui, draft: &Draft, now: &Now<'_>, orders: &mut Vec<Order>) {
    if let Some(step) = now.step {
        progress(ui, step);
        ui.horizontal(|ui| {
            if ui.button("Stop computing").clicked() {
                orders.push(Order::GiveUp);
            }
            ui.label(RichText::new("you can keep working").color(QUIET).small());
        });
        return;
    }
    if let Err(failure) = now.session.may_change() {
        ui.label(RichText::new(format!("Nothing can be changed now: {failure}")).color(QUIET).small());
        return;
    }
    ui.horizontal(|ui| {
        let is_changed = draft.is_changed();
        let apply = Button::new(RichText::new("Apply").strong()).fill(ACTION);
        if ui.add_enabled(is_changed, apply).clicked() {
            orders.push(Order::Apply);
        }
        if ui.add_enabled(is_changed, Button::new("Put back")).clicked() {
            orders.push(Order::Reset);
        }
        if !is_changed {
            ui.label(RichText::new("as shown").color(GOOD).small());
        }
    });
}

/// A name for a scene file that no file has, in the folder in which the program runs: that of its one body, or of the scene.
fn free_name(scene: &Scene) -> String {
    let only = scene.body.keys().next().filter(|_| scene.body.len() == 1).cloned();
    let stem =
        only.unwrap_or_else(|| scene.path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    let numbered = (2..1000).map(|number| format!("{stem}-{number}.toml"));
    let mut names = std::iter::once(format!("{stem}.toml")).chain(numbered);
    names.find(|name| !Path::new(name).exists()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::desk::save;
    use crate::prepare::Resolved;
    use crate::session::Request;

    const SCENE: &str = "stage = \"workbench\"\n\
        [body.bar]\n\
        generate = { block = { size = [1.0, 0.2, 0.2], cells = [5, 1, 1] } }\n\
        material = \"rubber\"\n\
        [body.bar.control]\n\
        low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

    /// `view bar.toml --stage odd.toml`: the panel said "workbench", and saved it.
    #[test]
    fn a_stage_file_is_shown_by_its_name_and_saved_by_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let places = ["scenes", "stages", "saved/deep"].map(|name| folder.path().join(name));
        places.iter().for_each(|place| std::fs::create_dir_all(place).unwrap());
        let [scenes, stages, deep] = places;
        let desktop = BUILT_IN.iter().find(|(name, _)| *name == "desktop").unwrap().1;
        assert!(desktop.contains("name = \"desktop\""));
        let odd = stages.join("odd.toml");
        std::fs::write(&odd, desktop.replace("name = \"desktop\"", "name = \"odd\"")).unwrap();
        let scene = Resolved::parse(SCENE, &scenes.join("bar.toml")).unwrap();
        let path = odd.display().to_string();
        let session = Session::open(&Request { stage: Some(&path), ..Request::new(&scene) }).unwrap();

        let draft = Draft::new(session.scene.as_ref().unwrap());
        assert_eq!(stage_name(&draft.stage), "odd.toml");
        assert!(!draft.is_changed());
        let (wanted, shown) = draft.wanted(&session, None).unwrap();
        assert_eq!((shown.name.as_str(), draft.is_on_shown_stage(&wanted)), ("odd", true));
        let saved = save::save(&wanted, &draft.comments(&wanted), None, &deep.join("mine.toml")).unwrap();
        assert_eq!(saved.stage, "../../stages/odd.toml");
        let again = Scene::load(&deep.join("mine.toml")).unwrap();
        assert_eq!(stage(&again, None).unwrap().name, "odd");

        // A built-in stage stands in place of the scene's, too.
        let session = Session::open(&Request { stage: Some("desktop"), ..Request::new(&scene) }).unwrap();
        assert_eq!(Draft::new(session.scene.as_ref().unwrap()).stage, "desktop");
    }

    /// Unticking "contact" left the compliance that it needs, and saving wrote it.
    #[test]
    fn what_an_effect_needs_is_neither_kept_without_it_nor_saved() {
        let folder = tempfile::tempdir().unwrap();
        let text = SCENE.replacen("[body.bar]\n", "[body.bar]\neffects = [\"contact\"]\n", 1);
        let scene = Resolved::parse(&text, &folder.path().join("bar.toml")).unwrap();
        assert!(scene.body["bar"].surface_compliance.is_some());
        let saved = save::save(&scene, &Comments::new(), None, &folder.path().join("mine.toml")).unwrap();
        assert_eq!(saved.body["bar"].surface_compliance, None);
        let mut draft = Draft::new(&scene);
        draft.scene.body["bar"].effects.clear();
        let without = Resolved::new(draft.scene).unwrap();
        assert_eq!(without.body["bar"].surface_compliance, None);
    }

    #[test]
    fn models_are_told_in_words() {
        assert!(MODELS.iter().all(|model| !in_words(model.summary).starts_with("method")));
        assert_eq!(in_words("method 3b: a rod: slender"), "a rod: slender");
    }
}
