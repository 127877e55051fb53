//! The effect as a scene lists it.
//!
//! In: the scene's tools, and its bodies with their settings. Out: the effect in a world.

use super::running::Contacts;
use super::settings::Settings;
use super::touched_body::TouchedBody;
use crate::base::failure::Failure;
use crate::effect::entry::EffectInput;
use crate::world::tool::Tool;
use crate::world::{RunningEffect, World};

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let scene = listed.scene;
    let touching = scene.tool.iter().filter(|(_, tool)| !tool.shape.is_blade());
    let tools = touching.map(|(name, tool)| Tool::new(scene, name, tool));
    let tools = tools.collect::<Result<Vec<_>, _>>()?;
    let settings: Vec<Settings> =
        listed.bodies.iter().map(|(_, name)| Settings::of(&scene.bodies[*name])).collect();
    let names: Vec<&str> = listed.bodies.iter().map(|(_, name)| *name).collect();
    let mut pairs = Vec::new();
    for one in 0..names.len() {
        let meets = |other: &usize| settings[one].meets(names[one], &settings[*other], names[*other]);
        pairs.extend((one..names.len()).filter(meets).map(|other| [one, other]));
    }
    let mut bodies = Vec::new();
    for (&(b, name), settings) in listed.bodies.iter().zip(&settings) {
        let is_felt = scene.bodies[name].entries().any(|effect| effect.is_felt);
        let touching = tools.iter().map(|tool| settings.touches(&tool.name)).collect();
        let deformer = &mut world.bodies[b].deformer;
        deformer.feel();
        let body = TouchedBody::new(b, deformer, (settings.friction, is_felt), touching);
        let mut body = body.map_err(|message| Failure::request(anyhow::anyhow!("body.{name}: {message}")))?;
        body.is_heard = scene.bodies[name].entries().any(|effect| effect.is_heard);
        bodies.push(body);
    }
    for (number, body) in bodies.iter_mut().enumerate() {
        if pairs.iter().any(|pair| pair.contains(&number)) {
            body.measure_walls();
        }
    }
    Ok(Some(Box::new(Contacts::new(bodies, tools, pairs, &world.assets.stage))))
}
