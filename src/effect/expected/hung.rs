//! Measures how far a body's model is from static equilibrium where one end is pushed aside and free in all else.
//!
//! In: a body in its equilibria and as its model has it. Out: [`Hung`] of one control element. A held end that is moved stretches
//! a slender body, which resists that some (L/t)² times more than bending, so that errors of held poses say nothing of an end
//! that is pushed: with E I = E b t³/12, its force is 3 E I w/L³ (Gere and Timoshenko, Mechanics of Materials, appendix G), and both
//! the model and the body find for themselves where its end goes. The end is pushed along that axis of the body which is nearest to
//! the plane in which it bends most easily; compared are the forces of both in their own poses.

use crate::deform::{
    ControlPose, ControlPoses, Deformer, Deviation, ErrorsAt, Freedom, Hung, Moved, Search, Statics, Wrench,
    reach,
};
use crate::solve::Silent;
use nalgebra::Vector3;

/// Turns to which the end comes, about, °: of a cantilever of length L it turns by 3 w/2 L.
const ANGLES: [f64; 3] = [5.0, 15.0, 30.0];

/// Tolerance of the searches, which is enough for errors of forces to a tenth of a per cent.
const ENOUGH: f64 = 1e-4;

/// The result of the model, or of the body.
struct Found {
    /// Wrenches about the places of the control elements.
    wrenches: Vec<Wrench>,
    /// Displacements of the surface nodes, m.
    shape: Vec<Vector3<f64>>,
}

/// Measures control element `moved`; `left_out` is called with the angle from which on the model or the body has no equilibrium.
pub fn hung(
    statics: &mut Statics,
    deformer: &mut Deformer,
    nodes: &[usize],
    moved: &Moved,
    left_out: &mut dyn FnMut(String),
) -> Hung {
    let along = moved.across.cross(&moved.axis).iamax();
    let last = ANGLES[ANGLES.len() - 1];
    let mut freedom = vec![Freedom::default(); moved.elements];
    freedom[moved.element].free = std::array::from_fn(|k| k != along);
    let way = |share: f64| {
        let mut poses = vec![ControlPose::REST; moved.elements];
        poses[moved.element].translation[along] = share * moved.length * last.to_radians() * 2.0 / 3.0;
        poses
    };
    let mut of_model = Search::new(&freedom, moved.length, deformer.entry.is_linear(), &way);
    let mut of_body = Search::new(&freedom, moved.length, false, &way);
    (of_model.tolerance, of_body.tolerance) = (ENOUGH, ENOUGH);
    let mut hung = Hung { along, at: Vec::new(), mesh: None };
    deformer.forget();
    for angle in ANGLES {
        let both = of_deformer(&mut of_model, angle / last, deformer)
            .and_then(|model| Ok((model, of_statics(&mut of_body, angle / last, statics, nodes)?)));
        match both {
            Ok((model, body)) => {
                let at = ErrorsAt::new(angle, reach(deformer), &deviation(&model, &body, moved.length));
                let at = hung.at.last().map_or(at, |last| last.and(&at));
                hung.at.push(at);
            }
            Err(why) => {
                left_out(format!("pushed aside until it turns by {angle}°: {why}"));
                break;
            }
        }
    }
    hung
}

fn of_deformer(search: &mut Search<'_>, share: f64, deformer: &mut Deformer) -> Result<Found, String> {
    const NONE: &str = "the model has no forces in such a pose";
    let mut forces = |poses: &[ControlPose]| {
        deformer.take(poses);
        deformer.balance().ok_or_else(|| NONE.to_owned())
    };
    let poses = search.follow_to(share, &mut forces)?;
    // The search has taken them already.
    deformer.take(&poses);
    deformer.deform();
    let (wrenches, _) = deformer.wrenches().ok_or(NONE)?;
    let shape = (0..deformer.node_count()).map(|i| deformer.displacement(i)).collect();
    Ok(Found { wrenches: placed(&wrenches, &poses), shape })
}

fn of_statics(
    search: &mut Search<'_>,
    share: f64,
    statics: &mut Statics,
    nodes: &[usize],
) -> Result<Found, String> {
    let mut forces = |poses: &[ControlPose]| {
        let found = statics.solve(&poses.to_vec(), &Silent);
        found.map(|found| found.balance(poses)).map_err(|error| error.to_string())
    };
    let poses = search.follow_to(share, &mut forces)?;
    // The last that was tried need not be the best.
    let found = statics.solve(&poses, &Silent).map_err(|error| error.to_string())?;
    let shape = nodes.iter().map(|&node| found.displacement[node]).collect();
    Ok(Found { wrenches: placed(&found.wrenches, &poses), shape })
}

fn placed(wrenches: &[Wrench], poses: &ControlPoses) -> Vec<Wrench> {
    wrenches.iter().zip(poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect()
}

/// The [`Deviation`] between both, each in its own pose.
fn deviation(model: &Found, body: &Found, length: f64) -> Deviation {
    let sizes = body.wrenches.iter().map(|w| w.force.norm().max(w.moment.norm() / length));
    let size = sizes.fold(f64::MIN_POSITIVE, f64::max);
    let off = |of: &dyn Fn(&Wrench) -> Vector3<f64>| {
        let both = model.wrenches.iter().zip(&body.wrenches);
        let most = both.map(|(a, b)| (of(a) - of(b)).norm()).fold(0.0, f64::max) / size;
        Some(most).filter(|part| part.is_finite())
    };
    let apart = model.shape.iter().zip(&body.shape).map(|(a, b)| (a - b).norm_squared());
    let shape = (apart.sum::<f64>() / model.shape.len().max(1) as f64).sqrt() / length;
    Deviation { force: off(&|w| w.force), torque: off(&|w| w.moment / length), energy: None, shape }
}
