//! Errors to expect of a body, as they were measured on it.
//!
//! In: [`Trial`](super::Trial)s of a body with their [`Deviation`](super::Deviation)s and [`Reach`]es, and what the mesh adds. Out: the errors to expect
//! at a reach and in a pose, between the measured ones ([`ErrorsAt`]), and nothing beyond them.

use super::deformer::Deformer;
use super::errors_at::{ErrorsAt, between, is_whole, load_share};
use super::mesh_errors::MeshErrors;
use super::model::ModelEntry;
use super::motion_errors::MotionErrors;
use super::pose::frame::Wrench;
use super::statics::freedom::Freedom;
use super::trial::Moved;
use super::turn::{Reach, reach, rests, turn_against_others};
use crate::fem::nearest_turn;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Errors of a body's model, measured by moving some of its control elements alone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedErrors {
    pub model: &'static ModelEntry,
    pub element: String,
    /// Whether the model has the forces of the stiffness matrix near rest, so that its errors begin there with nothing.
    #[serde(default)]
    pub begin_at_zero: bool,
    pub moved: Vec<MovedErrors>,
    /// The coefficients of the loads' columns under which all of this was measured; none of a body without loads.
    #[serde(default)]
    pub loads: Vec<f64>,
    /// Errors where all control elements rest, under these loads.
    #[serde(default)]
    pub loaded: Option<ErrorsAt>,
    /// Measurements that could not be made, and why, in sentences.
    pub left_out: Vec<String>,
}

/// Errors measured by moving one control element.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovedErrors {
    pub control: String,
    /// Unit vector across the way from the others to it, about which it was bent; [x, y, z].
    pub across: [f64; 3],
    /// Errors of the model against static equilibrium on the same mesh.
    pub model: MotionErrors,
    /// Pushed along one axis of the body, free in all else.
    #[serde(default)]
    pub hung: Option<Hung>,
    /// Errors that mesh and element add in small motions, relative, where they could be measured.
    pub mesh: Option<MeshErrors>,
    /// Errors against equilibrium on the finer mesh of [`Truth::Finer`](super::Truth::Finer), beyond small motions; `None` where that is
    /// not affordable.
    #[serde(default)]
    pub finer: Option<FinerErrors>,
}

/// Errors against equilibrium on a finer mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinerErrors {
    /// Errors of equilibrium on the body's own mesh.
    pub mesh: MotionErrors,
    /// Errors of the finer mesh itself in small motions, against one of half its size; `None` where that is not affordable.
    pub rest: Option<MeshErrors>,
    /// Errors of what is shown, model and mesh together; those of force and torque are parts of the largest force, or torque over
    /// length, that is shown, not of the equilibrium's.
    pub whole: MotionErrors,
}

/// Errors of a control element that is free but for one shift: its pose is found, by the model and by the body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hung {
    /// The axis of the body along which it is pushed, 0 to 2.
    pub along: usize,
    /// Errors in order of increasing reach.
    pub at: Vec<ErrorsAt>,
    /// Error of the force in this motion that is due to the mesh, relative.
    pub mesh: Option<f64>,
}

impl Hung {
    /// Whether an element with this freedom is such a one: held along the axis alone, or pushed along it by a force.
    fn is_of(&self, of: &Freedom) -> bool {
        let is_free = (0..6).all(|k| of.free[k] || k == self.along);
        let is_pushed = || (0..6).all(|k| of.load[k] == 0.0 || k == self.along) && of.load[self.along] != 0.0;
        is_free && if of.free[self.along] { is_pushed() } else { of.load == [0.0; 6] }
    }
}

impl Hung {
    /// The errors at a reach; `None` beyond what was measured.
    pub fn at(&self, reach: Reach) -> Option<ErrorsAt> {
        between(&self.at, Reach { off: 0.0, ..reach }, None)
    }
}

/// Turn, °, and stretch and shift aside up to which a motion is small: there the linear theory has the part of the mesh.
const SMALL: (f64, f64) = (1.0, 0.01);

/// Factor of an error that was measured against finer meshes: their own error in large motions is not known. 1.25 is what P. J. Roache
/// recommends (Perspective: a method for uniform reporting of grid refinement studies, Journal of Fluids Engineering 116, 1994).
const SAFETY: f64 = 1.25;

fn is_small(reach: Reach) -> bool {
    let (degrees, part) = SMALL;
    reach.turn <= degrees.to_radians() && reach.stretch <= part && reach.off <= part
}

impl MovedErrors {
    /// All errors by motions.
    fn lists(&self) -> Vec<&[ErrorsAt]> {
        let MovedErrors { model, hung, finer, .. } = self;
        let mut lists: Vec<&[ErrorsAt]> = model.lists().collect();
        lists.extend(hung.iter().map(|hung| hung.at.as_slice()));
        lists.extend(finer.iter().flat_map(|finer| finer.mesh.lists().chain(finer.whole.lists())));
        lists
    }

    /// The turn of the control element against the others, with components as of a [`Direction`](super::Direction); `None` where these
    /// do not rest against each other.
    fn turn(&self, deformer: &Deformer) -> Option<Vector3<f64>> {
        let element = deformer.controls.iter().position(|control| control.name == self.control)?;
        let origins: Vec<Vector3<f64>> = deformer.controls.iter().map(|control| control.origin).collect();
        let moved = Moved::new(&origins, element)?.about(self.across.into());
        let turn = turn_against_others(deformer, element)?;
        Some(moved.directions().tr_mul(&turn))
    }
}

impl ExpectedErrors {
    /// The errors to expect of the model in the pose as it is: of a body that loads alone deform those under its loads, else those at
    /// its reach under all of its loads; `None` where that was not measured.
    pub fn in_pose(&self, deformer: &Deformer) -> Option<ErrorsAt> {
        let share = self.load_share(deformer)?;
        let is_loaded = deformer.acting().coefficients.iter().any(|load| *load != 0.0);
        if is_loaded && rests(deformer) {
            let begun = |at: ErrorsAt| at.begun_by(share, &ErrorsAt::NONE);
            return self.loaded.map(|at| if self.begin_at_zero { begun(at) } else { at });
        }
        let reach = reach(deformer);
        self.largest(|moved, begin| moved.model.at(reach, moved.turn(deformer).as_ref(), begin))
            .filter(|_| is_whole(share))
    }

    /// Errors where the control elements rest, with which all others begin; `None` where they are not known.
    fn begin(&self) -> Option<ErrorsAt> {
        let at_rest = if self.loads.is_empty() { Some(ErrorsAt::NONE) } else { self.loaded };
        at_rest.filter(|_| self.begin_at_zero)
    }

    /// Whether the loads act under which the errors were measured, and no others.
    pub fn is_under_its_loads(&self, deformer: &Deformer) -> bool {
        self.load_share(deformer).is_some_and(is_whole)
    }

    /// The part of the loads under which errors were measured that acts; `None` where others do.
    fn load_share(&self, deformer: &Deformer) -> Option<f64> {
        let (acting, metas) = (deformer.acting(), deformer.load_metas());
        // One control element was moved and the others rested, against which the loads' directions stood as they are.
        let turns = deformer.poses.iter().map(|pose| nearest_turn(&pose.matrix));
        turns.filter_map(|turn| load_share(&self.loads, &acting, metas, &turn)).reduce(f64::max)
    }

    /// The largest errors to expect of the model, whichever of the measured control elements was moved to this reach, in any direction;
    /// `None` where that was not measured.
    pub fn at(&self, reach: Reach) -> Option<ErrorsAt> {
        self.largest(|moved, begin| moved.model.at(reach, None, begin))
    }

    /// The largest of all control elements, each of which must have some.
    fn largest(&self, of: impl Fn(&MovedErrors, Option<&ErrorsAt>) -> Option<ErrorsAt>) -> Option<ErrorsAt> {
        let begin = self.begin();
        let found = self.moved.iter().map(|moved| of(moved, begin.as_ref())).collect::<Option<Vec<_>>>()?;
        found.into_iter().reduce(|a, b| a.and(&b))
    }

    /// Errors of a body of which one of the control elements `names` alone is free, in the way that was measured; `None` for
    /// others.
    pub fn hung(&self, names: &[&str], freedom: &[Freedom]) -> Option<&Hung> {
        let mut moved = names.iter().zip(freedom).filter(|(_, freedom)| freedom.is_any());
        let ((name, freedom), None) = (moved.next()?, moved.next()) else { return None };
        let measured = self.moved.iter().find(|moved| moved.control == **name)?;
        measured.hung.as_ref().filter(|hung| hung.is_of(freedom))
    }

    /// The largest errors that the mesh adds in any small motion; `None` where they could not be measured for one of the control
    /// elements.
    pub fn mesh(&self) -> Option<MeshErrors> {
        let found = self.moved.iter().map(|moved| moved.mesh.clone()).collect::<Option<Vec<_>>>()?;
        found.into_iter().reduce(|a, b| a.and(&b))
    }

    /// The part of a body's wrenches that is the mesh's, in the present pose: in small motions that of the linear theory, in the worst
    /// motion where this one was not measured, in large ones that of the equilibria. `None` where it could not be measured.
    pub fn mesh_at(&self, deformer: &Deformer, wrenches: &[Wrench]) -> Option<f64> {
        let reach = reach(deformer);
        if is_small(reach) {
            let most = self.mesh()?.wrench;
            let of_one = |moved: &MovedErrors| {
                let element = deformer.controls.iter().position(|control| control.name == moved.control)?;
                let [force, torque] = moved.mesh.as_ref()?.in_pose(deformer, wrenches, element)?;
                Some(force.max(torque))
            };
            return Some(self.moved.iter().filter_map(of_one).reduce(f64::max).unwrap_or(most));
        }
        let large = |moved: &MovedErrors| {
            let of_mesh = &moved.finer.as_ref()?.mesh;
            of_mesh.at(reach, moved.turn(deformer).as_ref(), Some(&ErrorsAt::NONE))?.wrench()
        };
        let large = self.moved.iter().map(large).collect::<Option<Vec<f64>>>()?;
        large.into_iter().reduce(f64::max)
    }

    /// The errors of force and of torque over length, model and mesh together, as parts of the largest that is shown: those against the
    /// finer mesh, and what that itself has in the small motion, times 1.25. `None` in small motions, beyond what was measured, and
    /// under other loads.
    pub fn whole_at(&self, deformer: &Deformer, wrenches: &[Wrench]) -> Option<[f64; 2]> {
        let reach = reach(deformer);
        if is_small(reach) || !self.is_under_its_loads(deformer) {
            return None;
        }
        let whole = self
            .largest(|moved, _| moved.finer.as_ref()?.whole.at(reach, moved.turn(deformer).as_ref(), None))?;
        let rest = |moved: &MovedErrors| {
            let rest = moved.finer.as_ref()?.rest.as_ref()?;
            let element = deformer.controls.iter().position(|control| control.name == moved.control)?;
            Some(rest.in_pose(deformer, wrenches, element).unwrap_or([rest.wrench; 2]))
        };
        let rest = self.moved.iter().filter_map(rest);
        let [force, torque] = rest.fold([0.0_f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        Some([SAFETY * (whole.force? + force), SAFETY * (whole.torque? + torque)])
    }

    /// Returns an error that names the first number that no measurement can give.
    pub fn check(&self) -> Result<(), String> {
        let is_error = |x: f64| x.is_finite() && x >= 0.0;
        if let Some(wrong) = self.loaded.iter().flat_map(ErrorsAt::numbers).find(|x| !is_error(*x)) {
            return Err(format!("under the loads: error {wrong}; errors must be finite and not negative"));
        }
        if let Some(wrong) = self.loads.iter().find(|load| !load.is_finite()) {
            return Err(format!("under the loads: load {wrong}; loads must be finite"));
        }
        for moved in &self.moved {
            let MovedErrors { control, across, hung, mesh, finer, .. } = moved;
            let lists = moved.lists();
            if let Some(wrong) = hung.as_ref().map(|hung| hung.along).filter(|along| *along > 2) {
                return Err(format!("{control}: pushed along axis {wrong}, where a body has 0 to 2"));
            }
            for at in lists.iter().copied().flatten() {
                if let Some(wrong) = at.numbers().into_iter().find(|x| !is_error(*x)) {
                    return Err(format!(
                        "{control} at {}°: error {wrong}; errors must be finite and not negative",
                        at.angle
                    ));
                }
            }
            let falls = |two: &[ErrorsAt]| {
                two[1].turn < two[0].turn || two[1].stretch < two[0].stretch || two[1].off < two[0].off
            };
            if lists.iter().any(|all| all.windows(2).any(falls)) {
                return Err(format!("{control}: the measured poses are not in the order of their reach"));
            }
            let rest = finer.iter().filter_map(|finer| finer.rest.as_ref());
            if let Some(wrong) = mesh
                .iter()
                .chain(rest.clone())
                .flat_map(|mesh| [mesh.wrench, mesh.shape].into_iter().chain(mesh.loads.iter().copied()))
                .chain(hung.iter().filter_map(|hung| hung.mesh))
                .find(|x| !is_error(*x))
            {
                return Err(format!(
                    "{control}: error of the mesh {wrong}; errors must be finite and not negative"
                ));
            }
            if !across.iter().all(|x| x.is_finite()) {
                return Err(format!("{control}: {across:?} is no direction"));
            }
            let stiffness = mesh.iter().chain(rest).filter_map(|mesh| mesh.stiffness);
            if let Some(wrong) = stiffness.flat_map(|all| all.numbers()).find(|x| !x.is_finite()) {
                return Err(format!("{control}: {wrong} is no stiffness"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::motion_errors::TurnErrors;
    use super::*;

    fn at(angle: f64, [stretch, off]: [f64; 2], force: f64) -> ErrorsAt {
        let turn = angle.to_radians();
        ErrorsAt { angle, turn, stretch, off, force: Some(force), torque: Some(0.01), shape: 0.1 * force }
    }

    fn measured() -> ExpectedErrors {
        let bent = vec![at(10.0, [0.01, 0.0], 0.02), at(30.0, [0.05, 0.0], 0.12), at(60.0, [0.07, 0.0], 0.5)];
        let shifted = vec![at(10.0, [0.03, 0.1], 0.04), at(30.0, [0.06, 0.3], 0.3)];
        let mesh = Some(MeshErrors { wrench: 0.09, shape: 0.01, stiffness: None, loads: vec![] });
        let turned = TurnErrors { twisted: bent.clone(), both: bent.clone(), bent, about: Vec::new() };
        let model = MotionErrors { turned, shifted, ..MotionErrors::default() };
        let moved = vec![MovedErrors { control: "right".into(), model, mesh, ..MovedErrors::default() }];
        ExpectedErrors { moved, ..ExpectedErrors::default() }
    }

    #[test]
    fn errors_stand_between_the_measured_ones_and_nothing_stands_beyond() {
        let measured = measured();
        let force = |degrees: f64, stretch: f64, off: f64| {
            let turn = f64::to_radians(degrees);
            let found = measured.at(Reach { turn, arc: turn, stretch, off, ..Reach::default() })?;
            Some((1e4 * found.wrench()?).round() / 1e4)
        };
        for (degrees, stretch, off, expected, what) in [
            (0.0, 0.0, 0.0, Some(0.02), "at rest those of the first"),
            (10.0, 0.01, 0.0, Some(0.02), "measured"),
            (20.0, 0.0, 0.0, Some(0.07), "between two"),
            (5.0, 0.03, 0.0, Some(0.07), "the farther of turn …"),
            (20.0, 0.04, 0.0, Some(0.095), "… and stretch"),
            (40.0, 0.0, 0.0005, Some(0.2467), "bent, but for a little"),
            (61.0, 0.0, 0.0, None, "beyond the turns"),
            (5.0, 0.08, 0.0, None, "beyond the stretches"),
            (10.0, 0.01, 0.1, Some(0.04), "a shift as it was measured"),
            (10.0, 0.01, 0.05, Some(0.04), "half as far off the arc"),
            (20.0, 0.0, 0.2, Some(0.17), "shifts between two"),
            (20.0, 0.0, 0.1, Some(0.12), "shifts between two, half as far off"),
            (30.0, 0.06, 0.3, Some(0.3), "the last shift"),
            (40.0, 0.0, 0.1, None, "no shift went so far"),
            (5.0, 0.0, 0.35, None, "farther off than any"),
        ] {
            assert_eq!(force(degrees, stretch, off), expected, "{what}");
        }
        assert_eq!(ExpectedErrors::default().at(Reach::default()), None, "nothing was measured");
        assert_eq!(ExpectedErrors::default().mesh(), None);
    }

    #[test]
    fn near_rest_errors_begin_with_nothing() {
        let measured = ExpectedErrors { begin_at_zero: true, ..measured() };
        let force = |degrees: f64, stretch: f64, off: f64| {
            let turn = f64::to_radians(degrees);
            measured.at(Reach { turn, arc: turn, stretch, off, ..Reach::default() })?.wrench()
        };
        assert_eq!(force(0.0, 0.0, 0.0), Some(0.0));
        let [near, far] = [force(0.1, 0.0, 0.0), force(5.0, 0.0, 0.0)].map(Option::unwrap);
        assert!(near < 1e-3 && far > 0.01 && far <= 0.02, "{near} {far}");
        let [aside, bent] = [0.0, 5.0].map(|arc| {
            let reach = Reach { turn: 0.1, arc: f64::to_radians(arc), off: 0.05, ..Reach::default() };
            measured.at(reach).and_then(|at| at.wrench()).unwrap()
        });
        assert!(
            (0.02..0.021).contains(&aside) && aside == bent,
            "half the shift, whose error is the larger: {aside} {bent}"
        );
        assert_eq!(force(20.0, 0.0, 0.0), Some(0.07), "beyond the first as without");
        assert_eq!(force(61.0, 0.0, 0.0), None);
    }

    #[test]
    fn of_several_control_elements_the_worst_counts_and_all_must_be_measured() {
        let mut both = measured();
        let mut other = both.moved[0].clone();
        other.model.turned.bent.iter_mut().for_each(|at| at.shape = 0.3);
        other.model.turned.bent[1].force = None;
        both.moved.push(other);
        let at = |degrees: f64| {
            both.at(Reach {
                turn: f64::to_radians(degrees),
                arc: f64::to_radians(degrees),
                ..Reach::default()
            })
        };
        assert_eq!(at(10.0).map(|at| (at.wrench(), at.shape)), Some((Some(0.02), 0.3)));
        assert_eq!(at(30.0).map(|at| at.wrench()), Some(None), "one has no forces there");
        both.moved[1].model.turned.bent.pop();
        both.moved[1].mesh = None;
        assert_eq!((both.at(Reach { turn: 1.0, ..Reach::default() }), both.mesh()), (None, None));
    }

    #[test]
    fn numbers_that_no_measurement_gives_are_refused() {
        assert_eq!(measured().check(), Ok(()));
        for (spoil, words) in [
            (
                (|all| all.moved[0].model.turned.bent[0].shape = -0.1) as fn(&mut ExpectedErrors),
                "right at 10°: error -0.1; errors must be",
            ),
            (
                |all| all.moved[0].model.turned.bent[1].force = Some(f64::INFINITY),
                "right at 30°: error inf; errors must be",
            ),
            (|all| all.moved[0].model.turned.bent.swap(0, 2), "not in the order"),
            (
                |all| {
                    let rest = MeshErrors { wrench: 0.1, shape: -0.1, stiffness: None, loads: vec![] };
                    all.moved[0].finer = Some(FinerErrors { rest: Some(rest), ..FinerErrors::default() });
                },
                "right: error of the mesh -0.1; errors must be",
            ),
            (
                |all| {
                    all.moved[0].mesh =
                        Some(MeshErrors { wrench: f64::NAN, shape: 0.0, stiffness: None, loads: vec![] })
                },
                "right: error of the mesh NaN; errors must be",
            ),
        ] {
            let mut wrong = measured();
            spoil(&mut wrong);
            let error = wrong.check().unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
