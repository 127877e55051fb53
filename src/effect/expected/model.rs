//! How far a body's model is from static equilibrium, measured on the body itself.
//!
//! In: a body of a scene, precomputed as it will be written. Out: for a control element [`ErrorsAt`] bends and twists of
//! [`ANGLES`] and shifts by a tenth of the length, all others resting, against St. Venant-Kirchhoff equilibrium on the same mesh
//! with the same element ([`Trial`]).

use crate::base::failure::Failure;
use crate::deform::{Deformer, ErrorsAt, Motion, Moved, Statics, Trial, reach, trials};
use crate::fem::STVK;
use crate::green::{self, GreenFile, Precomputed};
use crate::scene::Scene;
use crate::solve::{Progress, Silent, Solver};
use std::sync::Arc;

/// Of bends and twists, °.
pub const ANGLES: [f64; 4] = [10.0, 30.0, 60.0, 90.0];
/// Across and along, in parts of the length.
const SHIFTS: [[f64; 2]; 2] = [[0.0, 0.1], [0.1, 0.0]];
/// Motions of one control element.
pub const MOTIONS: usize = 2 * ANGLES.len() + SHIFTS.len();

/// A body in its equilibria, and as its model has it.
pub struct Measured {
    statics: Statics,
    deformer: Deformer,
    nodes: Vec<usize>,
}

impl Measured {
    /// Writes the body into a file that is gone afterwards, and opens it as a session does.
    pub fn new(scene: &Scene, body: &mut Precomputed) -> Result<Measured, Failure> {
        let mut factorised = scene.clone();
        factorised.body[&body.name].solver = Solver::default();
        let statics = Statics::new(&factorised, &body.name, &STVK, &Silent).map_err(Failure::work)?;
        let folder = tempfile::tempdir().map_err(Failure::work)?;
        let path = folder.path().join("measured.green");
        // Sections of effects are not there yet.
        let families = body.requirements.without_sections();
        let asked = std::mem::replace(&mut body.requirements, families);
        let written = green::write(&path, std::slice::from_ref(body));
        body.requirements = asked;
        written.map_err(Failure::work)?;
        let file = Arc::new(GreenFile::open(&path).map_err(Failure::work)?);
        let model = &scene.body[&body.name].model;
        let deformer = Deformer::new(file, &body.name, model).map_err(Failure::wrong)?;
        let nodes = Trial::surface_nodes(&statics, &deformer);
        Ok(Measured { statics, deformer, nodes })
    }

    /// Of control element `e`; `left_out` hears what could not be measured. `progress` is advanced by 1000 for each of
    /// [`MOTIONS`].
    pub fn errors(
        &mut self,
        e: usize,
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
    ) -> Result<Vec<ErrorsAt>, Failure> {
        let origins: Vec<_> = self.statics.controls.iter().map(|control| control.origin).collect();
        let Some(moved) = Moved::new(&origins, e) else {
            left_out("no axis leads from the other control elements to it".into());
            return Ok(Vec::new());
        };
        let of = |motion: fn(f64) -> Motion| ANGLES.into_iter().map(motion);
        let motions: Vec<Motion> =
            of(Motion::Bend).chain(of(Motion::Twist)).chain(SHIFTS.map(Motion::Shift)).collect();
        let mut told = |motion: Motion, why: String| left_out(format!("{}: {why}", motion.name()));
        let held = trials(&mut self.statics, &moved, &motions, progress, &mut told).map_err(Failure::work)?;
        let found: Vec<(Motion, ErrorsAt)> =
            held.iter().map(|trial| (trial.motion, self.at(trial))).collect();
        Ok(by_reach(&found))
    }

    fn at(&mut self, trial: &Trial) -> ErrorsAt {
        let deviation = trial.deviation(&mut self.deformer, &self.nodes);
        let angle = match trial.motion {
            Motion::Bend(degrees) | Motion::Twist(degrees) | Motion::Mixed(degrees, _) => degrees,
            Motion::Shift(_) => 0.0,
        };
        ErrorsAt::new(angle, reach(&self.deformer), &deviation)
    }
}

/// One entry for each angle at which both bend and twist were found, as far as all smaller ones were; each with the errors of all
/// before it, and of the shifts that do not go farther.
fn by_reach(found: &[(Motion, ErrorsAt)]) -> Vec<ErrorsAt> {
    let at = |wanted: Motion| found.iter().find(|(motion, _)| *motion == wanted).map(|(_, at)| *at);
    let mut levels: Vec<ErrorsAt> = Vec::new();
    for angle in ANGLES {
        let (Some(bend), Some(twist)) = (at(Motion::Bend(angle)), at(Motion::Twist(angle))) else { break };
        let here = bend.and(&twist);
        levels.push(levels.last().map_or(here, |last| last.and(&here)));
    }
    for shift in SHIFTS.into_iter().filter_map(|shift| at(Motion::Shift(shift))) {
        let within = |level: &ErrorsAt| shift.turn <= level.turn && shift.stretch <= level.stretch;
        let first = levels.iter().position(within).unwrap_or(levels.len().saturating_sub(1));
        for level in levels.iter_mut().skip(first) {
            *level = level.and(&shift);
        }
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_has_the_errors_of_all_that_goes_no_farther() {
        let at = |angle: f64, stretch: f64, force: f64| ErrorsAt {
            angle,
            turn: angle.to_radians(),
            stretch,
            force: Some(force),
            torque: Some(0.0),
            shape: 0.0,
        };
        let mut found = vec![
            (Motion::Bend(10.0), at(10.0, 0.01, 0.1)),
            (Motion::Twist(10.0), at(10.0, 0.02, 0.2)),
            (Motion::Bend(30.0), at(30.0, 0.03, 0.15)),
            (Motion::Twist(30.0), at(30.0, 0.04, 0.12)),
            (Motion::Bend(60.0), at(60.0, 0.05, 0.5)),
            (Motion::Twist(90.0), at(90.0, 0.06, 0.9)),
        ];
        let told = |found: &[(Motion, ErrorsAt)]| -> Vec<(f64, f64, Option<f64>)> {
            by_reach(found).iter().map(|at| (at.angle, at.stretch, at.force)).collect()
        };
        assert_eq!(told(&found), [(10.0, 0.02, Some(0.2)), (30.0, 0.04, Some(0.2))], "no twist by 60°");
        found.push((Motion::Shift(SHIFTS[0]), at(0.0, 0.03, 0.7)));
        assert_eq!(told(&found)[1], (30.0, 0.04, Some(0.7)), "the shift is within 30°");
        assert_eq!(told(&found)[0], (10.0, 0.02, Some(0.2)));
        found.push((Motion::Shift(SHIFTS[1]), at(0.0, 0.1, 0.8)));
        assert_eq!(told(&found)[1], (30.0, 0.1, Some(0.8)), "a shift beyond all belongs to the last");
        assert_eq!(told(&found[6..]), [], "shifts alone say nothing of turns");
    }
}
