//! The key that lets go of a control element, or makes it hold again.

use crate::scene::{Body, Scene, Updates};
use crate::session::Session;

/// The scene after the key: without the control element under the cursor where there is one, else with the one again that was
/// let go of. The error says what the key would need.
pub fn scene(session: &Session) -> Result<(Scene, String), String> {
    let shown = session.scene.as_ref().ok_or("A replay cannot be changed.")?;
    let mut scene = Scene::clone(shown);
    let world = &session.world;
    if let Some((b, c)) = world.cursor().and_then(|cursor| world.pointed_element(cursor)) {
        let deformer = &world.bodies[b].deformer;
        let (body, control) = (deformer.body.clone(), deformer.controls[c].name.clone());
        let is_released = scene.body.get_mut(&body).is_some_and(|own| own.release(&control));
        return match is_released {
            true => {
                Ok((scene, format!("{body}.{control} is released; L beside all elements: it holds again.")))
            }
            false => {
                let why = scene.body.get(&body).map(|own| own.cannot_release(&body, &control));
                Err(format!("{}.", why.unwrap_or_default()))
            }
        };
    }
    let loose = |body: &Body| body.updates.iter().flat_map(Updates::loose).last().map(str::to_owned);
    let last = scene.body.iter_mut().find_map(|(name, body)| Some((loose(body)?, name.clone(), body)));
    let Some((control, name, body)) = last else {
        return Err("L releases the control element under the cursor; there is none, and none is released."
            .to_owned());
    };
    body.hold(&control);
    Ok((scene, format!("{name}.{control} holds again.")))
}
