//! The force of cutting: as an arrow with its newtons at the blade, and as hands with a force device feel it.

use super::blade::Blade;
use super::body::CutBody;
use super::resistance::{RELIEVED, Resistance};
use crate::deform::{TouchPoint, TouchPotential, contact_axes};
use crate::world::force_mark::{mark_force, unknown};
use crate::world::{Frame, World};
use nalgebra::{Isometry3, Matrix3, Point3};

/// Adds the force on a blade. The longest arrow is that of a blade whose whole edge cuts.
pub fn force(
    bodies: &[CutBody],
    (number, blade, pose): (usize, &Blade, &Isometry3<f64>),
    world: &World,
    frame: &mut Frame,
) {
    let radius_m = world.assets.stage.workspace.radius_m;
    for body in bodies {
        let Some(resistance) = body.resistances.get(number) else { continue };
        let scale = world.bodies[body.b].room_from_body.scaling();
        let force = resistance.force(body.length());
        if force <= 0.0 {
            continue;
        }
        let place = pose * Point3::from(*resistance.at());
        let full = body.toughness() * blade.length() / scale;
        let words = unknown(&blade.name, force);
        mark_force((&place, &(-resistance.along() * force)), full, words, (radius_m, frame));
    }
}

/// A blade that a force device carries: its number and stylus, and room_from_stylus and room_from_blade.
pub type Carried = (usize, usize, [Isometry3<f64>; 2]);

/// The blades whose stylus a force device of the stage moves, where they are in a frame.
pub fn carried<'a>(blades: &'a [Blade], world: &'a World) -> impl Iterator<Item = Carried> + 'a {
    let felt = |(_, blade): &(usize, &Blade)| blade.place.has_device(&world.assets.stage);
    blades.iter().enumerate().filter(felt).filter_map(|(number, blade)| {
        let (stylus, room_from_stylus) = blade.place.in_hand(world)?;
        Some((number, stylus, [room_from_stylus, blade.place.pose(world)?]))
    })
}

/// The resistance as a hand feels it until the next frame: it is relieved as it is in frames, and yields at its limit. `scale` is the size of the body in the room against its own.
pub fn touch(body: &CutBody, resistance: &Resistance, carried: Carried, scale: f64) -> TouchPotential {
    let (_, stylus, [room_from_stylus, room_from_blade]) = carried;
    let (limit, length) = (resistance.limit(), body.length());
    let point = TouchPoint {
        arm: room_from_blade.rotation * resistance.at(),
        axes: contact_axes(resistance.along()),
        friction: 0.0,
        force: resistance.along() * resistance.force(length),
        gap: resistance.gap() * scale,
        limit,
    };
    let points = if limit > 0.0 { &[point][..] } else { &[] };
    let soft = Matrix3::from_diagonal_element(RELIEVED * length * scale / limit);
    TouchPotential::new((stylus, room_from_stylus, room_from_blade), points, &|_, _| soft)
}
