//! Values in the captions of the demo: each function reads the world as it is in this frame.

use crate::base::plates::{Anchor, Tone};
use crate::base::table;
use crate::deform::ControlPose;
use crate::render::Drawable;
use crate::scene::{Generate, Scene};
use crate::world::{BodyFrame, Highlight, PlacedBody, World, why_unknown};
use nalgebra::Vector3;

/// The control element that a hand holds, else the one that is farthest from its place; `None` at rest.
fn moved(body: &PlacedBody, shown: &BodyFrame) -> Option<usize> {
    let held = shown.highlights.iter().position(|highlight| *highlight == Highlight::Held);
    held.or_else(|| (0..body.assets.controls.len()).find(|&c| body.deformer.poses[c] != ControlPose::REST))
}

/// The force of a body on what holds control element `c`, N.
fn force_n(body: &PlacedBody, c: usize) -> Option<Vector3<f64>> {
    Some(-body.deformer.wrenches()?.0[c].force)
}

/// The error to expect of a force, by its model and by its mesh together, as a part of it, `±>` where the mesh's part is not known; `None`
/// where it was not measured.
fn expected_part(body: &PlacedBody, shown: &BodyFrame) -> Option<String> {
    let expected = shown.expected.as_ref()?;
    let of_model = expected.in_pose(&body.deformer)?.force?;
    let (wrenches, _) = body.deformer.wrenches()?;
    let of_mesh = expected.mesh_at(&body.deformer, &wrenches);
    let least = if of_mesh.is_some() { "" } else { ">" };
    Some(format!("±{least} {}", per_cent(of_model + of_mesh.unwrap_or(0.0))))
}

/// The bend of the first body in degrees, and the force in newtons with the error to expect.
pub fn bend(_: &Scene, world: &World, _: f64) -> String {
    let Some(body) = world.bodies.first() else { return String::new() };
    let angle = body.deformer.largest_turn().to_degrees();
    let force = moved(body, &world.frame.bodies[0]).and_then(|c| Some(force_n(body, c)?.norm()));
    let Some(force) = force else { return format!("bent by {angle:.0}°") };
    let error = expected_part(body, &world.frame.bodies[0]).map_or_else(
        || format!(", error unknown ({})", why_unknown(body, &world.frame.bodies[0])),
        |part| format!(" {part}"),
    );
    format!("bent by {angle:.0}°     force {}{error}", newtons(force))
}

/// The pull of the first body, a generated block without lateral contraction, along x: the model's force beside E A ΔL / L, and
/// that of a St. Venant-Kirchhoff body, E A (λ³ - λ)/2.
pub fn pull(scene: &Scene, world: &World, _: f64) -> String {
    let (Some(body), Some(asked)) = (world.bodies.first(), scene.body.values().next()) else {
        return String::new();
    };
    let Some(Generate::Block(block)) = &asked.generate else { return String::new() };
    let [length, width, height] = block.size;
    let (longer, ours) = match moved(body, &world.frame.bodies[0]).and_then(|c| Some((c, force_n(body, c)?)))
    {
        Some((c, force)) => (body.deformer.poses[c].translation.x, -force.x),
        None => (0.0, 0.0),
    };
    let theirs = asked.material.young * width * height * longer / length;
    let stretch = 1.0 + longer / length;
    let nonlinear = asked.material.young * width * height * (stretch.powi(3) - stretch) / 2.0;
    format!(
        "ΔL = {:.1} mm     ours {}     E A ΔL / L = {}     (nonlinear: {})",
        1e3 * longer,
        newtons(ours),
        newtons(theirs),
        newtons(nonlinear)
    )
}

/// Distance of the hands, and the time of a frame's mechanics that move them.
pub fn hands(_: &Scene, world: &World, mechanics_s: f64) -> String {
    let Some(body) = world.bodies.first() else { return String::new() };
    let controls = &body.deformer.controls;
    let now = |c: usize| controls[c].origin + body.deformer.poses[c].translation;
    let paws: Vec<usize> = (0..controls.len())
        .filter(|&c| body.assets.controls[c].grab == crate::scene::Grab::Dragger)
        .collect();
    let [a, b] = paws[..] else { return String::new() };
    let (rest, apart) = ((controls[a].origin - controls[b].origin).norm(), (now(a) - now(b)).norm());
    let paws = format!("paws {:.0} mm apart, at rest {:.0} mm", 1e3 * apart, 1e3 * rest);
    match mechanics_s {
        0.0 => paws,
        _ => format!("{paws}     mechanics of a frame {}", table::seconds(mechanics_s)),
    }
}

/// The points that a blade has added to the surface of the first body, and the time of a frame's mechanics.
pub fn cut(_: &Scene, world: &World, mechanics_s: f64) -> String {
    let Some(body) = world.bodies.first() else { return String::new() };
    let (file, name) = (body.deformer.file(), &body.deformer.body);
    let whole = file.base.as_ref().unwrap_or(file).rest(name).len();
    let opened = match body.deformer.node_count() - whole {
        0 => format!("a surface of {whole} points"),
        more => format!("{more} points of the cut beside {whole} of the surface"),
    };
    match mechanics_s {
        0.0 => opened,
        _ => format!("{opened}     mechanics of a frame {}", table::seconds(mechanics_s)),
    }
}

/// The line of the equilibrium's plate: how far it is solved, or how far the model is from it.
pub fn ghost(_: &Scene, world: &World, _: f64) -> String {
    let Some(plate) = world.frame.all(Drawable::plate).find(|plate| plate.anchor == Anchor::LowerLeft) else {
        return String::new();
    };
    let said = |line: &Vec<(String, Tone)>| line.iter().map(|(text, _)| text.as_str()).collect::<String>();
    // Its last line says where it stands; the head of an answer is the chapter's text.
    let lines = &plate.lines[if plate.lines.len() > 2 { plate.lines.len() - 1 } else { 0 }..];
    lines.iter().map(said).collect::<Vec<_>>().join("     ")
}

/// The screens of the stage and where the head is.
pub fn room(_: &Scene, world: &World, _: f64) -> String {
    let stage = &world.assets.stage;
    let head = world.room_from_head.translation.vector;
    let sizes = stage
        .screens
        .iter()
        .map(|screen| format!("{} {:.2} × {:.2} m", screen.name, screen.width_m(), screen.height_m()));
    let sizes: Vec<String> = sizes.collect();
    format!("{}     head at ({:.2}, {:.2}, {:.2}) m", sizes.join(", "), head.x, head.y, head.z)
}

/// A force with three digits, in N or mN.
pub fn newtons(force_n: f64) -> String {
    let of = |value: f64, unit: &str| {
        let digits = if value.abs() >= 99.95 {
            0
        } else if value.abs() >= 9.995 {
            1
        } else {
            2
        };
        let text = format!("{value:.digits$}");
        let is_zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
        format!("{} {unit}", if is_zero { text.trim_start_matches('-') } else { &text })
    };
    if force_n.abs() >= 0.0995 || force_n.abs() < 1e-5 { of(force_n, "N") } else { of(1e3 * force_n, "mN") }
}

fn per_cent(part: f64) -> String {
    crate::deform::percent(part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{self, EFFECTS};

    /// The caption had no force where its error was not measured.
    #[test]
    fn a_caption_has_the_force_whether_or_not_its_error_is_known() {
        let (scene, file, mut world) = effect::ghost_equilibrium::tests::bar("linear", &["haptics"]);
        effect::attach(EFFECTS, &scene, &file, &mut world).unwrap();
        let pull = ControlPose { translation: Vector3::new(0.01, 0.0, 0.0), ..ControlPose::REST };
        world.bodies[0].deformer.evaluate(&[ControlPose::REST, pull]);
        let told = bend(&scene, &world, 0.0);
        assert!(
            told.ends_with(" N, error unknown (list expected_errors)") && told.contains("force "),
            "{told}"
        );
    }

    #[test]
    fn forces_have_three_digits_and_no_minus_zero() {
        for (force, text) in [
            (0.0, "0.00 N"),
            (-1e-9, "0.00 N"),
            (9.0, "9.00 N"),
            (-12.34, "-12.3 N"),
            (1234.0, "1234 N"),
            (0.0123, "12.3 mN"),
        ] {
            assert_eq!(newtons(force), text);
        }
    }
}
