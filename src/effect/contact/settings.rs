//! Settings of `contact`: `[body.NAME.effect.contact]`.

use crate::config;
use crate::deform::{LINEAR, ModelEntry, ROTATION};
use crate::effect::entry::{ResolvedBody, Settings as AnySettings};
use crate::scene::{Body, Method, Scene, SceneError, Tool, ToolShape};
use serde::Deserialize;
use std::sync::Arc;

/// The effect's name in scenes.
pub const NAME: &str = "contact";

/// Models whose answer to forces at single nodes is known: sums of columns in one frame.
pub const TOUCHED: [&ModelEntry; 2] = [&LINEAR, &ROTATION];

#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Coefficient of friction.
    pub friction: f64,
    /// Tools that touch the body; without it, all of the scene.
    pub tools: Option<Vec<String>>,
    /// Bodies that touch it; without it, all that list the effect.
    pub bodies: Option<Vec<String>>,
    /// Whether it touches itself.
    pub itself: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { friction: 0.3, tools: None, bodies: None, itself: false }
    }
}

impl Settings {
    /// The settings of a scene's table. The error names a value that cannot be.
    pub fn read(table: Option<&toml::Table>) -> Result<AnySettings, String> {
        let settings: Settings = table.map_or_else(|| Ok(Settings::default()), config::from_table)?;
        if !(settings.friction.is_finite() && settings.friction >= 0.0) {
            let friction = settings.friction;
            return Err(format!(
                "friction = {friction} is no coefficient of friction: 0 slides freely, 1 hardly slides"
            ));
        }
        Ok(Arc::new(settings))
    }

    /// The settings of a body that lists the effect.
    pub fn of(body: &ResolvedBody) -> Settings {
        body.settings::<Settings>(NAME).cloned().unwrap_or_default()
    }

    /// Friction of the tool of this name on a body that lists the effect.
    pub fn friction_of(body: &ResolvedBody, tool: &str) -> Option<f64> {
        let settings = Settings::of(body);
        settings.touches(tool).then_some(settings.friction)
    }

    /// Whether the tool of this name touches the body.
    pub fn touches(&self, tool: &str) -> bool {
        self.tools.as_ref().is_none_or(|tools| tools.iter().any(|name| name == tool))
    }

    /// Whether the body of this name and another touch.
    pub fn meets(&self, name: &str, other: &Settings, other_name: &str) -> bool {
        let lists = |settings: &Settings, name: &str| {
            settings.bodies.as_ref().is_none_or(|bodies| bodies.iter().any(|body| body == name))
        };
        if name == other_name { self.itself } else { lists(self, other_name) && lists(other, name) }
    }
}

/// Refuses a body that nothing can touch, or whose answer to a touch is not known.
pub fn suits(scene: &Scene, name: &str, body: &Body, resolved: &ResolvedBody) -> Result<(), SceneError> {
    let wrong = |key: &str, message: String| Err(scene.invalid(&format!("body.{name}.{key}"), message));
    let settings = Settings::of(resolved);
    let others =
        || scene.body.iter().filter(|(other, body)| *other != name && body.effects.iter().any(|e| e == NAME));
    let named = settings.bodies.iter().flatten();
    if let Some(unknown) = named.into_iter().find(|body| others().all(|(other, _)| other != *body)) {
        let message = match scene.body.contains_key(unknown.as_str()) {
            true if unknown == name => "a body touches itself by itself = true".to_owned(),
            true => format!("body.{unknown} lists no \"contact\": both bodies must"),
            false => config::unknown_name("body", unknown, scene.body.keys().map(String::as_str)),
        };
        return wrong("effect.contact.bodies", message);
    }
    if let Some(unknown) =
        settings.tools.iter().flatten().find(|tool| !scene.tool.contains_key(tool.as_str()))
    {
        let known = scene.tool.keys().map(String::as_str);
        return wrong("effect.contact.tools", config::unknown_name("tool", unknown, known));
    }
    let is_blade = |tool: &&String| scene.tool.get(*tool).is_some_and(|tool| tool.shape.is_blade());
    if let Some(blade) = settings.tools.iter().flatten().find(is_blade) {
        return wrong("effect.contact.tools", format!("tool.{blade} is a blade, which touches nothing"));
    }
    let lists = |other: &String| settings.bodies.as_ref().is_none_or(|bodies| bodies.contains(other));
    let touches = |(name, tool): (&String, &Tool)| !tool.shape.is_blade() && settings.touches(name);
    let by_tools = scene.tool.iter().any(touches);
    if !by_tools && !others().any(|(other, _)| lists(other)) && !settings.itself {
        let message = "nothing touches the body: add a tool, as [tool.probe] with shape = { ball = { radius = 0.01 } } \
                       and stylus = 1, list \"contact\" in another body too, or write effect.contact = { itself = true }";
        return wrong("effects", message.to_owned());
    }
    if body.method == Method::Bem {
        let message = "\"contact\" solves for how the surface yields with the factor of a body of tetrahedra: leave out method = \
                       \"bem\"";
        return wrong("method", message.to_owned());
    }
    for (name, tool) in &scene.tool {
        if let ToolShape::Mesh { file, unit, .. } = &tool.shape {
            scene.tool_surface(name, file, *unit)?;
        }
    }
    let model = resolved.model;
    if !TOUCHED.contains(&model) {
        let message = format!(
            "\"{NAME}\" presses single nodes by the columns of surface_compliance, in one frame, which \"{}\" does not do: write model = \
             \"{}\"",
            model.name,
            TOUCHED.map(|model| model.name).join("\" or \"")
        );
        return wrong("model", message);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::effect::Resolved;
    use std::path::Path;

    #[test]
    fn settings_that_cannot_be_are_told() {
        let body = |keys: &str, tool: &str| {
            let listed = if keys.starts_with("effects") { "" } else { "effects = [\"contact\"]\n" };
            let text = format!(
                "{tool}\n[body.b]\ngenerate = {{ block = {{ size = [1.0, 1.0, 1.0], cells = [2, 2, 2] }} }}\n\
                 material = {{ young = 1.0, poisson = 0.3, density = 1000.0 }}\n{listed}{keys}\n\
                 control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
            );
            let scene = Resolved::parse(&text, Path::new("c.toml"));
            scene.and_then(|scene| scene.requirements("b").map(drop)).map_err(|error| error.to_string())
        };
        const TOOL: &str = "tool.probe = { shape = { ball = { radius = 0.1 } } }";
        const SURFACE: &str = "surface_compliance = { nodes = \"surface\" }\n";
        [SURFACE, ""].into_iter().for_each(|keys| body(keys, TOOL).unwrap());
        body("effect.contact = { itself = true }", "").unwrap();
        for (keys, tool, told) in [
            (SURFACE.to_owned(), "", "nothing touches the body"),
            (format!("{SURFACE}effect.contact = {{ friction = -1.0 }}"), TOOL, "no coefficient of friction"),
            (format!("{SURFACE}effect.contact = {{ tools = [\"prode\"] }}"), TOOL, "did you mean \"probe\""),
            (format!("{SURFACE}effect.contact = {{ fritcion = 0.1 }}"), TOOL, "fritcion"),
            (format!("{SURFACE}effect.contact = {{ bodies = [\"b\"] }}"), TOOL, "by itself = true"),
            (format!("{SURFACE}effect.contact = {{ bodies = [\"c\"] }}"), TOOL, "unknown body \"c\""),
            ("model = \"reduced\"".to_owned(), TOOL, "write model = \"linear\" or \"rotation\""),
            (
                SURFACE.to_owned(),
                "tool.probe = { shape = { ball = { radius = -0.1 } } }",
                "a positive length",
            ),
            (SURFACE.to_owned(), "tool.probe = { shape = \"floor\", stylus = 0 }", "counted from 1"),
            (SURFACE.to_owned(), "tool.probe = { shape = \"floor\", stiffness = 0.0 }", "a positive number"),
            (
                SURFACE.to_owned(),
                "tool.probe = { shape = { box = { size = [1.0, 0.1, 1.0], radius = 0.1 } } }",
                "rounds away",
            ),
        ] {
            let error = body(&keys, tool).unwrap_err();
            assert!(error.contains(told), "{keys}: {error}");
        }
    }
}
