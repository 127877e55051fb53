//! The chapters of the demo, in their order.

use super::measure;
use crate::base::failure::Failure;
use crate::effect::Resolved;
use crate::scene::Scene;
use crate::world::World;
use std::path::Path;

/// One chapter: its scene, its words and its measured values.
pub struct Chapter {
    /// The name in file names.
    pub name: &'static str,
    pub title: &'static str,
    /// One or two sentences that stay as long as the chapter.
    pub text: &'static str,
    /// A built-in scene.
    pub scene: &'static str,
    /// A built-in script of the chapter; `None` for the scene's own.
    pub script: Option<&'static str>,
    /// Effects of all its bodies besides those that the scene lists.
    pub effects: &'static [&'static str],
    /// A built-in stage that has one window.
    pub stage: &'static str,
    pub looks: Looks,
    /// Everything springs back to rest at this time of the script, s.
    pub springs_back_s: Option<f64>,
    /// Time for which its end is shown in the window before the next chapter, s.
    pub holds_s: f64,
    /// Words for the values measured in a frame, with the time that the mechanics of the last frame took that moved anything, s;
    /// may be empty.
    pub numbers: fn(&Scene, &World, f64) -> String,
    /// The times of the script at which pictures are taken, s.
    pub stills_s: &'static [f64],
}

/// The point of view of a chapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Looks {
    /// The viewer's, on the screens of the stage.
    AtScreens,
    /// A view of the whole room from outside.
    AtRoom,
}

pub const CHAPTERS: &[Chapter] = &[
    Chapter {
        name: "liver",
        title: "An organ is cut, hooked and pressed",
        text: "Each frame is in equilibrium: the blade opens the finite elements that it passes, and the tools feel the cut organ.",
        scene: "liver",
        script: None,
        effects: &[],
        stage: "desktop",
        looks: Looks::AtScreens,
        springs_back_s: None,
        holds_s: 1.5,
        numbers: measure::cut,
        stills_s: &[3.3, 4.0],
    },
    Chapter {
        name: "hose",
        title: "A hose is bent, and let go",
        text: "The force is computed live: a sum of responses that were solved in advance.",
        scene: "hose",
        script: None,
        effects: &[],
        stage: "demo",
        looks: Looks::AtScreens,
        springs_back_s: Some(3.45),
        holds_s: 1.5,
        numbers: measure::bend,
        stills_s: &[1.75, 3.15],
    },
    Chapter {
        name: "bar",
        title: "A bar is pulled: is the force right?",
        text: "Linear theory against its formula. Poisson's ratio is 0 here: the bar grows no thinner, and its clamped ends change \
               nothing. In brackets: what a St. Venant-Kirchhoff body of that length would pull.",
        scene: "bar",
        script: None,
        effects: &[],
        stage: "demo",
        looks: Looks::AtScreens,
        springs_back_s: Some(5.7),
        holds_s: 1.5,
        numbers: measure::pull,
        stills_s: &[2.0, 4.5],
    },
    Chapter {
        name: "bear",
        title: "A soft bear in two hands",
        text: "Three control elements, 60 precomputed fields. A frame costs the same however many nodes lie inside.",
        scene: "bear",
        script: None,
        effects: &[],
        stage: "demo",
        looks: Looks::AtScreens,
        springs_back_s: Some(7.5),
        holds_s: 1.5,
        numbers: measure::hands,
        stills_s: &[2.6, 5.1],
    },
    Chapter {
        name: "ghost",
        title: "How far is that from the truth?",
        text: "Once the hands rest, St. Venant–Kirchhoff equilibrium of this pose is solved on the whole mesh: the pink ghost.",
        scene: "bear",
        script: Some("raise"),
        effects: &["ghost_equilibrium"],
        stage: "demo",
        looks: Looks::AtScreens,
        springs_back_s: None,
        holds_s: 15.0,
        numbers: measure::ghost,
        stills_s: &[3.5],
    },
    Chapter {
        name: "room",
        title: "The room from outside",
        text: "A tube over a two-sided workbench: each eye sees each screen off-axis, from where the tracked head is.",
        scene: "tube",
        script: None,
        effects: &[],
        stage: "workbench",
        looks: Looks::AtRoom,
        springs_back_s: None,
        holds_s: 1.5,
        numbers: measure::room,
        stills_s: &[3.0],
    },
    Chapter {
        name: "workbench",
        title: "What the workbench shows",
        text: "Left: what the left eye sees, wall above table; right: the right eye. `greenstage view tube` opens a window for each \
               of these four pictures.",
        scene: "tube",
        script: None,
        effects: &[],
        stage: "workbench-in-a-window",
        looks: Looks::AtScreens,
        springs_back_s: None,
        holds_s: 1.5,
        numbers: measure::room,
        stills_s: &[3.0],
    },
];

/// The chapter that has its own key.
pub fn workbench() -> usize {
    CHAPTERS.iter().position(|chapter| chapter.name == "workbench").unwrap_or(0)
}

impl Chapter {
    /// The scene with the chapter's own script and effects, which must require no columns beyond the scene's: its .green file
    /// serves several chapters.
    pub fn scene(&self) -> Result<Resolved, Failure> {
        let mut scene = Scene::load(Path::new(self.scene))?;
        if let Some(script) = self.script {
            scene.script = Some(script.into());
        }
        for body in scene.body.values_mut() {
            body.effects.extend(self.effects.iter().map(|effect| (*effect).to_owned()));
        }
        Resolved::new(scene)
    }
}
