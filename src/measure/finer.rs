//! The finer equilibrium of a pose, against which whole errors are measured.
//!
//! In: a pose with its equilibrium on the scene's mesh. Out: static equilibrium of a St. Venant–Kirchhoff body with tet10 on the
//! finest mesh of the ladder ([`Truth::Finer`]), started from the coarser one. Where the ladder has two meshes, both are solved and
//! extrapolated: the error of quadratic elements is taken to fall by the order 1.5 with their size, because stresses are
//! singular at the edges of held parts, so that u = u₂ + (u₂ - u₁)/(2^1.5 - 1), and what is added is the reference's own error.

use super::course::{Course, Step};
use super::fields::difference;
use super::norms::Norms;
use super::poses::about_origins;
use super::reference::{EquilibriumOfPose, Size};
use super::request::{MeasureError, Request};
use super::variants::{Meshes, variant};
use crate::deform::{ControlPoses, Statics, StaticsError, Truth, Wrench};
use crate::fem::TET4;
use crate::solve::{Progress, Silent, Solver};
use nalgebra::Vector3;

/// The order in which the error of quadratic elements falls with their size.
const ORDER: f64 = 1.5;
/// Largest part that the last halving may change for an extrapolation to be worth anything.
const MOST: f64 = 0.25;

/// The finer equilibrium of a pose.
pub struct FinerReference {
    /// Displacements of the nodes of the ladder's finest mesh, m.
    pub field: Vec<Vector3<f64>>,
    /// The wrench that holds each control element, about where the pose brings the origin that it has on the scene's mesh.
    pub held: Vec<Wrench>,
    pub size: Size,
    /// Its own error, relative, of shape and of wrench; `None` where only one mesh was solved.
    pub doubt: Option<[f64; 2]>,
}

/// The body on the meshes of the ladder with tet10, each made when it is first needed.
pub struct Finer<'a> {
    request: &'a Request<'a>,
    meshes: &'a Meshes,
    /// Origins of the control elements on the scene's mesh.
    about: &'a [Vector3<f64>],
    statics: Vec<Option<Statics>>,
}

impl<'a> Finer<'a> {
    pub fn new(request: &'a Request<'a>, meshes: &'a Meshes, about: &'a [Vector3<f64>]) -> Finer<'a> {
        let statics = meshes.ladder.levels.iter().map(|_| None).collect();
        Finer { request, meshes, about, statics }
    }

    /// The finer equilibrium of pose number `pose`, next to displacements of the nodes of the scene's mesh; the inner error says why there is
    /// none.
    pub fn solve(
        &mut self,
        norms: &Norms<'_>,
        pose: usize,
        coarse: &[Vector3<f64>],
        course: &Course<'_>,
    ) -> Result<Result<FinerReference, String>, MeasureError> {
        let (name, poses) = &self.request.poses[pose];
        let key = Step::finer(pose, name);
        if !course.affords(&key) {
            return Ok(Err("--quick left no time for its finer equilibrium".into()));
        }
        let top = self.statics.len() - 1;
        let found = course.step_as_json(&key, |progress| {
            let mut guess = coarse.to_vec();
            let mut found: Vec<EquilibriumOfPose> = Vec::new();
            for level in 0..=top {
                match self.at(level, &guess, poses, progress)? {
                    Ok(settled) => {
                        guess = settled.field();
                        found.push(settled);
                        // Only the last two are compared.
                        found.drain(..found.len().saturating_sub(2));
                    }
                    Err(why) => return Ok(Err(why)),
                }
                if level < top {
                    guess = self.meshes.ladder.climb(level, &guess);
                }
            }
            Ok(Ok(found))
        })?;
        Ok(found.and_then(|found| self.reference(norms, &found)))
    }

    fn at(
        &mut self,
        level: usize,
        guess: &[Vector3<f64>],
        poses: &ControlPoses,
        progress: &dyn Progress,
    ) -> Result<Result<EquilibriumOfPose, String>, MeasureError> {
        let mesh = &self.meshes.ladder.levels[level];
        let statics = match &mut self.statics[level] {
            Some(statics) => statics,
            none => {
                let scene = variant(self.request, level as u32, &TET4, Solver::default());
                match Truth::Finer.statics(&scene, self.request.body, &Silent) {
                    Ok(made) => none.insert(made),
                    Err(StaticsError::Green(why)) => return Ok(Err(format!("tet10: {why}"))),
                    Err(error) => return Err(error.into()),
                }
            }
        };
        let origins: Vec<Vector3<f64>> = statics.controls.iter().map(|control| control.origin).collect();
        let guess = self.meshes.ladder.with_mids(level, guess);
        let own = about_origins(poses, self.about, &origins);
        Ok(match statics.solve_near(&guess, &own, progress) {
            Ok(settled) if !settled.inverted.is_empty() => Err(format!(
                "{} of {} tetrahedra with tet10 turn inside out",
                settled.inverted.len(),
                mesh.tets.len()
            )),
            Ok(settled) => {
                let place =
                    |(e, wrench): (usize, &Wrench)| wrench.about(&(origins[e] - self.about[e]), &poses[e]);
                let held = settled.wrenches.iter().enumerate().map(place).collect();
                Ok(EquilibriumOfPose { wrenches: held, ..settled.into() })
            }
            Err(StaticsError::Stopped { share, .. }) => {
                Err(format!("tet10 has no equilibrium beyond {:.0} % of the way", 100.0 * share))
            }
            Err(error) => return Err(error.into()),
        })
    }

    /// The reference of one mesh, or extrapolated from two.
    fn reference(&self, norms: &Norms<'_>, found: &[EquilibriumOfPose]) -> Result<FinerReference, String> {
        let top = self.statics.len() - 1;
        let Some((best, coarser)) = found.split_last() else { return Err("nothing was solved".into()) };
        let (mut field, mut held) = (best.field(), best.wrenches.clone());
        let Some(coarser) = coarser.last() else {
            let size = Size::new(norms, &field, &held, best.energy);
            return Ok(FinerReference { field, held, size, doubt: None });
        };
        let part = 1.0 / (ORDER.exp2() - 1.0);
        let change = difference(&field, &self.meshes.ladder.raise(top - 1, &coarser.field()));
        let less =
            |(a, b): (&Wrench, &Wrench)| Wrench { force: a.force - b.force, moment: a.moment - b.moment };
        let wrenches: Vec<Wrench> = held.iter().zip(&coarser.wrenches).map(less).collect();
        field.iter_mut().zip(&change).for_each(|(u, change)| *u += change * part);
        for (wrench, change) in held.iter_mut().zip(&wrenches) {
            wrench.force += change.force * part;
            wrench.moment += change.moment * part;
        }
        let energy = best.energy + part * (best.energy - coarser.energy);
        let size = Size::new(norms, &field, &held, energy);
        let off = |w: &Wrench| (w.force.norm() / size.force).max(w.moment.norm() / size.torque);
        let wrench = wrenches.iter().map(off).fold(0.0, f64::max);
        let changed = [norms.l2(&change) / size.displacement, wrench];
        if changed.iter().any(|changed| *changed > MOST) {
            let [shape, wrench] = changed.map(|changed| 100.0 * changed);
            return Err(format!(
                "its two finest meshes differ by {shape:.0} % in shape and {wrench:.0} % in force and torque"
            ));
        }
        Ok(FinerReference { field, held, size, doubt: Some(changed.map(|changed| part * changed)) })
    }
}
