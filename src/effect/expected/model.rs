//! Measures how far a body's model is from static equilibrium, on the body itself.
//!
//! In: a body of a scene, precomputed as it will be written. Out: for a control element [`ErrorsAt`] each of `LEVELS`, all others
//! resting, against St. Venant-Kirchhoff equilibrium on the same mesh with the same element ([`Trial`]), both under the loads of
//! the scene; and how far that is from equilibrium on a finer mesh ([`Truth::Finer`]), which is the part of the mesh. It is bent in
//! the plane in which that is easiest, as hands bend it.

use super::mesh::softest_turn;
use crate::base::failure::Failure;
use crate::deform::pose_file::PoseLoads;
use crate::deform::{
    ControlPose, ControlPoses, Deformer, Deviation, Direction, DirectionErrors, ErrorsAt, FinerErrors,
    Freedom, Hung, Motion, MotionErrors, Moved, MovedErrors, PoseResult, Search, Statics, StaticsError,
    Trial, Truth, TurnErrors, in_session, reach, trials,
};
use crate::effect::entry::Resolved;
use crate::green::{Precomputed, Solution};
use crate::mesh::EDGES;
use crate::solve::{Progress, Silent};
use nalgebra::Vector3;

/// The turns of a control element at one level, °, and its shifts, which stretch the body.
struct Level {
    angle: f64,
    shifts: &'static [Motion],
}

/// An end that is turned in place by more than some 40° mostly has no equilibrium: from 60° on it is bent along an arc, and pulled and
/// pressed along its chord.
const LEVELS: [Level; 5] = [
    Level {
        angle: 1.0,
        shifts: &[Motion::Mixed(1.0, 0.0), Motion::Mixed(0.0, 0.01), Motion::Shift([PULLS[0], 0.0])],
    },
    Level { angle: 10.0, shifts: &[Motion::Mixed(10.0, 0.0), Motion::Mixed(0.0, 0.1)] },
    Level {
        angle: 30.0,
        shifts: &[Motion::Mixed(30.0, 0.0), Motion::Mixed(0.0, 0.2), Motion::Shift([0.05, 0.0])],
    },
    Level {
        angle: 60.0,
        shifts: &[
            Motion::BentAndPulled(60.0, STRAIN),
            Motion::BentAndPulled(60.0, -STRAIN),
            Motion::Shift([0.1, 0.0]),
        ],
    },
    Level {
        angle: 90.0,
        shifts: &[Motion::BentAndPulled(90.0, STRAIN), Motion::BentAndPulled(90.0, -STRAIN)],
    },
];

/// Part of its chord by which a bent body is pulled and pressed.
const STRAIN: f64 = 0.05;

/// Parts of the length by which it is pulled away, which are shifts of the levels too.
pub const PULLS: [f64; 3] = [0.01, 0.05, 0.1];
/// Parts of the length by which it is pressed.
pub const PRESSES: [f64; 2] = [0.01, 0.05];

const BEND: Direction = [0, 1, 0];
/// A bend in the stiffer plane, of which a thin body has no equilibrium: it counts where it has one.
const ASIDE: Direction = [0, 0, 1];
const TWIST: Direction = [1, 0, 0];
const BOTH: Direction = [1, 1, 1];
/// Turns of every body.
const MAIN: [Direction; 4] = [BEND, TWIST, BOTH, ASIDE];

/// The mesh's part of a wrench in a turn beyond which directions differ so that all of them are measured: of thin walls, which buckle under
/// some.
const DIFFER: f64 = 0.3;

fn turn(about: Direction, degrees: f64) -> Motion {
    match about {
        BEND => Motion::Bend(degrees),
        TWIST => Motion::Twist(degrees),
        _ => Motion::Turn(about, degrees),
    }
}

impl Level {
    fn turn(&self, about: Direction) -> Motion {
        turn(about, self.angle)
    }

    fn has(&self, motion: Motion) -> bool {
        MAIN.into_iter().any(|about| self.turn(about) == motion) || self.shifts.contains(&motion)
    }
}

/// Turns about a direction, one for each level.
fn turns(levels: &[Level], about: Direction) -> Vec<Vec<Motion>> {
    levels.iter().map(|level| vec![level.turn(about)]).collect()
}

/// Parts of the way from the level before to one without an equilibrium at which one is sought instead, the farthest first.
const NEARER: [f64; 2] = [0.5, 0.25];

/// Turns nearer than a level, the farthest first, °: the first that has an equilibrium takes its place.
fn nearer(angle: f64) -> impl Iterator<Item = f64> {
    let at = LEVELS.iter().position(|level| level.angle == angle);
    let before = at.and_then(|at| at.checked_sub(1)).map(|before| LEVELS[before].angle);
    before.into_iter().flat_map(move |before| NEARER.map(|part| before + part * (angle - before)))
}

/// The shifts of a level, and those that take their place where one of them has no equilibrium: along the arc alone, as far as the level
/// turns, and nearer.
fn shifts(level: &Level) -> Vec<(f64, Vec<Motion>)> {
    let own = (level.angle, level.shifts.to_vec());
    let is_small = level.angle < LEVELS[1].angle;
    let instead = [level.angle].into_iter().chain(nearer(level.angle)).filter(|_| !is_small);
    let along_the_arc =
        |angle: f64| (angle, [STRAIN, -STRAIN].map(|along| Motion::BentAndPulled(angle, along)).to_vec());
    [own].into_iter().chain(instead.map(along_the_arc)).collect()
}

fn presses() -> Vec<Vec<Motion>> {
    PRESSES.iter().map(|part| vec![Motion::Shift([-part, 0.0])]).collect()
}

/// All directions of a cube's faces, edges and corners.
fn directions() -> impl Iterator<Item = Direction> {
    let all = (0..27).map(|i: i8| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
    all.filter(|about| *about != [0; 3])
}

/// All directions that bend or twist, or do both, as this one does.
fn like(direction: Direction) -> Vec<Direction> {
    let kind = |[along, b, c]: Direction| [along != 0, [b, c] != [0, 0]];
    directions().filter(|about| kind(*about) == kind(direction)).collect()
}

/// Motions of one control element of which all directions are alike.
fn motions() -> usize {
    LEVELS.iter().map(|level| MAIN.len() + level.shifts.len()).sum::<usize>() + PRESSES.len()
}

/// Nodes of a finer mesh over those of the body's own, at most; and the largest number of unknowns for which equilibria are solved
/// on it, which takes some minutes in all.
const FINER: usize = 8;
const MOST_UNKNOWNS: usize = 60_000;

/// A body in its equilibria, and as its model has it.
pub struct Measured {
    statics: Statics,
    /// The body on a finer mesh, or why that is not solved.
    finer: Result<Statics, String>,
    deformer: Deformer,
    nodes: Vec<usize>,
    /// Coefficients of the scene's loads, for each column; none where none acts.
    pub loads: Vec<f64>,
}

impl Measured {
    /// The body as a session has it, and its equilibria, under the loads of the scene.
    pub fn new(scene: &Resolved, body: &mut Precomputed) -> Result<Measured, Failure> {
        let mut statics = Truth::SameMesh.statics(scene, &body.name, &Silent).map_err(Failure::work)?;
        // Sections of effects are not there yet.
        let families = body.requirements.without_sections();
        let asked = std::mem::replace(&mut body.requirements, families);
        let opened = in_session(body, scene.bodies[&body.name].model);
        body.requirements = asked;
        let mut deformer = opened.map_err(Failure::work)?.map_err(Failure::wrong)?;
        // Under the loads of the scene, as it stands there.
        let loads = PoseLoads::of_scene(&scene.body[&body.name]);
        deformer.apply(&loads.applied(&deformer).map_err(Failure::wrong)?);
        let forces = loads.on_mesh(&statics).map_err(Failure::wrong)?;
        statics.apply(&forces).map_err(Failure::work)?;
        let nodes = Trial::surface_nodes(&statics, &deformer);
        let unknowns = 3 * FINER * statics.mesh.nodes.len();
        let finer = match unknowns <= MOST_UNKNOWNS {
            false => Err(format!(
                "a finer mesh has up to {unknowns} unknowns, more than the {MOST_UNKNOWNS} for which equilibria are solved"
            )),
            true => Truth::Finer.statics(scene, &body.name, &Silent).map_err(|why| why.to_string()),
        };
        let finer = finer.and_then(|mut finer| {
            let forces = loads.on_mesh(&finer).map_err(|why| why.to_string())?;
            finer.apply(&forces).map_err(|why| why.to_string())?;
            Ok(finer)
        });
        let loads = if loads.is_none() { Vec::new() } else { loads.coefficients };
        Ok(Measured { statics, finer, deformer, nodes, loads })
    }

    /// The errors where all control elements rest; `None` for a body without loads, and, noted in `left_out`, for one without an
    /// equilibrium under them. Lengths are measured to control element `e`; `progress` is advanced by 1000.
    pub fn loaded(
        &mut self,
        e: usize,
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
    ) -> Result<Option<ErrorsAt>, Failure> {
        let origins: Vec<_> = self.statics.controls.iter().map(|control| control.origin).collect();
        let Some(moved) = Moved::new(&origins, e).filter(|_| !self.loads.is_empty()) else {
            progress.advance(1000);
            return Ok(None);
        };
        let mut told = |_, why: String| left_out(format!("its loads alone: {why}"));
        let rest = [Motion::Shift([0.0; 2])];
        let held = trials(&mut self.statics, &moved, &rest, progress, &mut told).map_err(Failure::work)?;
        Ok(held.first().map(|trial| self.at(trial)))
    }

    /// Measures control element `e` of the body that was solved as `solution`; `left_out` is called with what could not be measured.
    /// `progress` shows one step, or two where all directions are measured.
    pub fn errors(
        &mut self,
        solution: &Solution,
        e: usize,
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
    ) -> Result<MovedErrors, Failure> {
        let Some(moved) = self.moved(solution, e) else {
            left_out("no axis leads from the other control elements to it".into());
            return Ok(MovedErrors::default());
        };
        if let Err(why) = &self.finer {
            left_out(format!("what the mesh adds in large motions: {why}"));
        }
        let mut found = Found::default();
        progress.begin("errors of the model", 1000 * motions() as u64);
        for about in MAIN {
            self.turn(&moved, (&LEVELS, about), progress, left_out, &mut found)?;
        }
        let differ = found.mesh.iter().any(|(_, at)| at.wrench().is_some_and(|part| part > DIFFER));
        self.shift(&moved, progress, left_out, &mut found)?;
        self.go(&moved, &presses(), progress, left_out, &mut found)?;
        progress.end();
        if differ {
            let all: Vec<Direction> = directions().filter(|about| !MAIN.contains(about)).collect();
            progress.begin("errors in all directions", 1000 * (all.len() * LEVELS[1..].len()) as u64);
            for about in all {
                self.turn(&moved, (&LEVELS[1..], about), progress, left_out, &mut found)?;
            }
            progress.end();
        }
        let of = |found: &[(Motion, ErrorsAt)], levels, pulls| motion_errors(found, levels, pulls, differ);
        let finer = self.finer.is_ok().then(|| FinerErrors {
            mesh: of(&found.mesh, &LEVELS[1..], &PULLS[1..]),
            rest: None,
            whole: of(&found.whole, &LEVELS[1..], &PULLS[1..]),
        });
        let hung = Some(self.hung(&moved, left_out));
        let model = of(&found.model, &LEVELS, &PULLS);
        Ok(MovedErrors { across: moved.across.into(), model, hung, finer, ..MovedErrors::default() })
    }

    /// Control element `e`, bent in the plane in which that is easiest; `None` where no axis leads to it.
    pub(super) fn moved(&self, solution: &Solution, e: usize) -> Option<Moved> {
        let origins: Vec<_> = self.statics.controls.iter().map(|control| control.origin).collect();
        let moved = Moved::new(&origins, e)?;
        Some(match softest_turn(solution, e, &moved.axis) {
            Some(across) => moved.about(across),
            None => moved,
        })
    }

    /// Adds what is found at each level of a direction, and nearer than the first one where the body or the finer one has no equilibrium.
    fn turn(
        &mut self,
        moved: &Moved,
        (levels, about): (&[Level], Direction),
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
        found: &mut Found,
    ) -> Result<(), Failure> {
        self.go(moved, &turns(levels, about), progress, left_out, found)?;
        let Some(lost) = levels.iter().find(|level| !self.is_known(found, &[level.turn(about)])) else {
            return Ok(());
        };
        for angle in nearer(lost.angle) {
            let motions = [turn(about, angle)];
            self.go(moved, &[motions.to_vec()], &Silent, left_out, found)?;
            if self.is_known(found, &motions) {
                break;
            }
        }
        Ok(())
    }

    /// Adds what is found at the shifts of each level, or at those in their place; none beyond the first level that is not reached.
    fn shift(
        &mut self,
        moved: &Moved,
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
        found: &mut Found,
    ) -> Result<(), Failure> {
        let mut tried: Vec<Motion> = Vec::new();
        for level in &LEVELS {
            let mut reached = 0.0;
            for (choice, (angle, motions)) in shifts(level).into_iter().enumerate() {
                let new: Vec<Motion> =
                    motions.iter().copied().filter(|motion| !tried.contains(motion)).collect();
                // Only the level's own are foreseen.
                let progress = if choice == 0 { progress } else { &Silent };
                self.go(moved, std::slice::from_ref(&new), progress, left_out, found)?;
                tried.extend(new);
                if self.is_known(found, &motions) {
                    reached = angle;
                    break;
                }
            }
            if reached < level.angle {
                break;
            }
        }
        Ok(())
    }

    /// Whether the body has an equilibrium in all of these motions, and the finer one in those that are not small.
    fn is_known(&self, found: &Found, motions: &[Motion]) -> bool {
        let is_in = |all: &[(Motion, ErrorsAt)], motion| all.iter().any(|(own, _)| *own == motion);
        motions.iter().all(|&motion| {
            let is_fine = self.finer.is_err() || LEVELS[0].has(motion) || is_in(&found.whole, motion);
            is_in(&found.model, motion) && is_fine
        })
    }

    /// Adds what is found at the motions of each level; none beyond the first without an equilibrium.
    fn go(
        &mut self,
        moved: &Moved,
        levels: &[Vec<Motion>],
        progress: &dyn Progress,
        left_out: &mut dyn FnMut(String),
        found: &mut Found,
    ) -> Result<(), Failure> {
        for motions in levels {
            let before = found.model.len();
            let mut told = |motion: Motion, why: String| left_out(format!("{}: {why}", motion.name()));
            let held =
                trials(&mut self.statics, moved, motions, progress, &mut told).map_err(Failure::work)?;
            for trial in &held {
                let at = self.at(trial);
                found.model.push((trial.motion, at));
                let is_small = LEVELS[0].has(trial.motion);
                if is_small {
                    // There the linear theory has the part of the mesh.
                    continue;
                }
                if let Some([mesh, whole]) = self.against_finer(trial, at, left_out).map_err(Failure::work)? {
                    found.mesh.push((trial.motion, mesh));
                    found.whole.push((trial.motion, whole));
                }
            }
            if found.model.len() < before + motions.len() {
                break;
            }
        }
        Ok(())
    }

    /// Errors of the equilibrium of a trial, and of what the model shows, against equilibrium on the finer mesh, at the reach of `at`; the
    /// second as parts of what is shown. `None` where there is none.
    fn against_finer(
        &mut self,
        trial: &Trial,
        at: ErrorsAt,
        left_out: &mut dyn FnMut(String),
    ) -> Result<Option<[ErrorsAt; 2]>, StaticsError> {
        let Ok(finer) = &mut self.finer else { return Ok(None) };
        let origins =
            |statics: &Statics| statics.controls.iter().map(|control| control.origin).collect::<Vec<_>>();
        let (about, own) = (origins(&self.statics), origins(finer));
        let both = || trial.poses.iter().zip(about.iter().zip(&own));
        let poses: ControlPoses = both().map(|(pose, (about, own))| pose.with_origin(about, own)).collect();
        let near = match on_finer(&self.statics, finer, &trial.settled.displacement) {
            Some(guess) => finer.solve_near(&guess, &poses)?,
            None => None,
        };
        let settled = match near.map_or_else(|| finer.solve(&poses, &Silent), Ok) {
            Ok(settled) if settled.inverted.is_empty() => settled,
            Ok(_) | Err(StaticsError::Stopped { .. }) => {
                let motion = trial.motion.name();
                left_out(format!("what the mesh adds, {motion}: no equilibrium on the finer mesh"));
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        // The first nodes of the finer mesh are those of the body's own.
        let mut truth = PoseResult::of_equilibrium(&settled, &poses, &self.nodes);
        let placed = settled.wrenches.iter().zip(both());
        truth.wrenches =
            Some(placed.map(|(wrench, (pose, (about, own)))| wrench.about(&(own - about), pose)).collect());
        let same = PoseResult::of_equilibrium(&trial.settled, &trial.poses, &self.nodes);
        let Deviation { force, torque, shape, .. } = Deviation::new(&same, &truth, trial.moved.length);
        let mesh = ErrorsAt { force, torque, shape, ..at };
        // The deformer stands in the pose of the trial.
        let shown = PoseResult::of_model(&self.deformer);
        let Deviation { force, torque, shape, .. } = Deviation::new(&truth, &shown, trial.moved.length);
        let has_forces = shown.wrenches.is_some();
        let [force, torque] = [force, torque].map(|part| part.filter(|_| has_forces));
        Ok(Some([mesh, ErrorsAt { force, torque, shape, ..at }]))
    }

    fn at(&mut self, trial: &Trial) -> ErrorsAt {
        let deviation = trial.deviation(&mut self.deformer, &self.nodes);
        ErrorsAt::new(0.0, reach(&self.deformer), &deviation)
    }
}

/// Errors in motions: of the model against equilibrium on the own mesh, of that against equilibrium on a finer mesh, and of what the model
/// shows against the latter.
#[derive(Default)]
struct Found {
    model: Vec<(Motion, ErrorsAt)>,
    mesh: Vec<(Motion, ErrorsAt)>,
    whole: Vec<(Motion, ErrorsAt)>,
}

/// The errors of each kind of motion; `by_direction`: with those of single directions.
fn motion_errors(
    found: &[(Motion, ErrorsAt)],
    levels: &[Level],
    pulls: &[f64],
    by_direction: bool,
) -> MotionErrors {
    let along = |parts: &[f64], sign: f64| {
        growing(found, parts.iter().map(|part| (0.0, vec![Motion::Shift([sign * part, 0.0])])))
    };
    let mut turned = TurnErrors {
        bent: of_direction(found, levels, BEND, &like(BEND)),
        twisted: of_direction(found, levels, TWIST, &like(TWIST)),
        both: of_direction(found, levels, BOTH, &like(BOTH)),
        about: Vec::new(),
    };
    let with_small = |direction: Direction| {
        // Small motions are alike in all directions.
        let small = levels.iter().position(|level| level.angle >= LEVELS[1].angle).unwrap_or(0);
        let own = of_direction(found, &levels[small..], direction, &[]);
        let at = turned.of(direction).iter().take(small).copied().chain(own).collect();
        DirectionErrors { direction, at }
    };
    if by_direction {
        turned.about = directions().map(with_small).collect();
    }
    let is_found = |motion: &Motion| found.iter().any(|(own, _)| own == motion);
    let all_found = |(_, motions): &(f64, Vec<Motion>)| motions.iter().all(is_found);
    let mut reached: Vec<(f64, Vec<Motion>)> = Vec::new();
    for level in levels {
        reached.extend(shifts(level).into_iter().find(all_found));
        if reached.last().is_none_or(|(angle, _)| *angle < level.angle) {
            break;
        }
    }
    let shifted = growing(found, reached);
    MotionErrors { turned, shifted, pulled: along(pulls, 1.0), pressed: along(&PRESSES, -1.0) }
}

/// Errors of turns about one direction, as far as they were found, and nearer than the next level; with those about others `beside` it where
/// they were found.
fn of_direction(
    found: &[(Motion, ErrorsAt)],
    levels: &[Level],
    about: Direction,
    beside: &[Direction],
) -> Vec<ErrorsAt> {
    let is_found =
        |about: Direction, angle: f64| found.iter().any(|(motion, _)| *motion == turn(about, angle));
    let whole = levels.iter().map(|level| level.angle).take_while(|angle| is_found(about, *angle));
    let mut angles: Vec<f64> = whole.collect();
    let next = levels.get(angles.len()).map_or(0.0, |next| next.angle);
    angles.extend(nearer(next).find(|angle| is_found(about, *angle)));
    let motions = |angle: f64| {
        let beside = beside.iter().copied().filter(|beside| is_found(*beside, angle));
        [about].into_iter().chain(beside).map(|about| turn(about, angle)).collect()
    };
    growing(found, angles.into_iter().map(|angle| (angle, motions(angle))))
}

/// Displacements on the finer mesh, which has the same tetrahedra with nodes between their corners; `None` where it has others.
fn on_finer(own: &Statics, finer: &Statics, u: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    if own.mesh.tets != finer.mesh.tets || !own.mesh.mids.is_empty() {
        return None;
    }
    let mut all = u.to_vec();
    all.resize(finer.mesh.nodes.len(), Vector3::zeros());
    for (corners, mids) in finer.mesh.tets.iter().zip(&finer.mesh.mids) {
        for ([i, j], &mid) in EDGES.iter().zip(mids) {
            all[mid as usize] = (u[corners[*i] as usize] + u[corners[*j] as usize]) * 0.5;
        }
    }
    Some(all)
}

fn growing(
    found: &[(Motion, ErrorsAt)],
    levels: impl IntoIterator<Item = (f64, Vec<Motion>)>,
) -> Vec<ErrorsAt> {
    let at = |wanted: &Motion| found.iter().find(|(motion, _)| motion == wanted).map(|(_, at)| *at);
    let mut all: Vec<ErrorsAt> = Vec::new();
    for (angle, motions) in levels {
        let here = motions.iter().map(at).collect::<Option<Vec<ErrorsAt>>>();
        let Some(here) = here.and_then(|here| here.into_iter().reduce(|a, b| a.and(&b))) else { break };
        let so_far = all.last().map_or(here, |last| last.and(&here));
        all.push(ErrorsAt { angle, ..so_far });
    }
    all
}

/// Turns to which the end comes, about, °: of a cantilever of length L it turns by 3 w/2 L.
const ANGLES: [f64; 3] = [5.0, 15.0, 30.0];

/// Tolerance of the searches, which is enough for errors of forces to a tenth of a per cent.
const ENOUGH: f64 = 1e-4;

impl Measured {
    /// Measures control element `moved` where it is pushed aside and free in all else; `left_out` is called with the angle from which on
    /// the model or the body has no equilibrium. A held end that is moved stretches
    /// a slender body, which resists that some (L/t)² times more than bending, so that errors of held poses say nothing of an end
    /// that is pushed: with E I = E b t³/12, its force is 3 E I w/L³ (Gere and Timoshenko, Mechanics of Materials, appendix G), and both
    /// the model and the body find for themselves where its end goes. The end is pushed along that axis of the body which is nearest to
    /// the plane in which it bends most easily; compared are the forces of both in their own poses.
    pub(super) fn hung(&mut self, moved: &Moved, left_out: &mut dyn FnMut(String)) -> Hung {
        let Measured { statics, deformer, nodes, .. } = self;
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
                    let at =
                        ErrorsAt::new(angle, reach(deformer), &Deviation::new(&model, &body, moved.length));
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
}

fn of_deformer(search: &mut Search<'_>, share: f64, deformer: &mut Deformer) -> Result<PoseResult, String> {
    const NONE: &str = "the model has no forces in such a pose";
    let mut forces = |poses: &[ControlPose]| {
        deformer.take(poses);
        deformer.balance().ok_or_else(|| NONE.to_owned())
    };
    let poses = search.follow_to(share, &mut forces)?;
    // The search has taken them already.
    deformer.take(&poses);
    deformer.deform();
    Some(PoseResult::of_model(deformer))
        .filter(|found| found.wrenches.is_some())
        .ok_or_else(|| NONE.to_owned())
}

fn of_statics(
    search: &mut Search<'_>,
    share: f64,
    statics: &mut Statics,
    nodes: &[usize],
) -> Result<PoseResult, String> {
    let mut forces = |poses: &[ControlPose]| {
        let found = statics.solve(&poses.to_vec(), &Silent);
        found.map(|found| found.balance(poses)).map_err(|error| error.to_string())
    };
    let poses = search.follow_to(share, &mut forces)?;
    // The last that was tried need not be the best.
    let found = statics.solve(&poses, &Silent).map_err(|error| error.to_string())?;
    Ok(PoseResult::of_equilibrium(&found, &poses, nodes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_has_the_errors_of_all_that_goes_no_farther() {
        let at = |degrees: f64, stretch: f64, force: f64| ErrorsAt {
            angle: 0.0,
            turn: degrees.to_radians(),
            stretch,
            off: 0.0,
            force: Some(force),
            torque: Some(0.0),
            shape: 0.0,
        };
        let mut found = vec![
            (Motion::Bend(1.0), at(1.0, 0.001, 0.01)),
            (Motion::Twist(1.0), at(1.0, 0.001, 0.02)),
            (Motion::Turn(BOTH, 1.0), at(1.0, 0.001, 0.01)),
            (Motion::Bend(10.0), at(10.0, 0.01, 0.1)),
            (Motion::Twist(10.0), at(10.0, 0.02, 0.2)),
            (Motion::Bend(30.0), at(30.0, 0.03, 0.15)),
            (Motion::Twist(30.0), at(30.0, 0.04, 0.12)),
            (Motion::Bend(60.0), at(60.0, 0.05, 0.5)),
            (Motion::Twist(90.0), at(90.0, 0.06, 0.9)),
            (Motion::Turn(BOTH, 10.0), at(10.0, 0.02, 0.05)),
            (Motion::Turn(BOTH, 30.0), at(30.0, 0.02, 0.05)),
        ];
        let of =
            |found: &[(Motion, ErrorsAt)], by_direction| motion_errors(found, &LEVELS, &PULLS, by_direction);
        let told = |found: &[ErrorsAt]| -> Vec<(f64, f64, Option<f64>)> {
            found.iter().map(|at| (at.angle, at.stretch, at.force)).collect()
        };
        let all = of(&found, false).turned;
        let bent = [
            (1.0, 0.001, Some(0.01)),
            (10.0, 0.01, Some(0.1)),
            (30.0, 0.03, Some(0.15)),
            (60.0, 0.05, Some(0.5)),
        ];
        assert_eq!(told(&all.bent), bent);
        let twisted = [(1.0, 0.001, Some(0.02)), (10.0, 0.02, Some(0.2)), (30.0, 0.04, Some(0.2))];
        assert_eq!(told(&all.twisted), twisted, "no twist by 60°");
        found.push((Motion::Turn(ASIDE, 30.0), at(30.0, 0.03, 0.3)));
        assert_eq!(
            of(&found, false).turned.bent[2].force,
            Some(0.3),
            "the stiffer plane counts where it was found"
        );
        let about = of(&found, true).turned.about;
        let own =
            |direction: Direction| about.iter().find(|of| of.direction == direction).map(|of| told(&of.at));
        assert_eq!((about.len(), own(BEND)), (26, Some(bent.to_vec())), "each direction has its own");
        assert_eq!(own([0, -1, 0]), Some(bent[..1].to_vec()), "the small ones of its kind, if no others");
        let shifts: Vec<_> = LEVELS[0].shifts.iter().map(|motion| (*motion, at(7.0, 0.1, 0.7))).collect();
        found.extend(shifts);
        let all = of(&found, false);
        assert_eq!(all.turned.bent.len(), 4, "shifts say nothing of bends");
        assert_eq!((all.shifted.len(), all.shifted[0].angle, all.shifted[0].force), (1, 1.0, Some(0.7)));
        assert_eq!((all.pulled.len(), all.pressed.len()), (1, 0), "of the pulls the first is among them");
        found.pop();
        let all = of(&found, false);
        assert_eq!((all.pulled, all.shifted), (vec![], vec![]), "one of a level's motions is missing");
        assert_eq!(motions(), 35);
    }
    #[test]
    fn shifts_without_an_equilibrium_are_replaced_by_nearer_ones() {
        let at = |force: f64| ErrorsAt {
            angle: 0.0,
            turn: 0.5,
            stretch: 0.1,
            off: 0.1,
            force: Some(force),
            torque: Some(0.0),
            shape: 0.0,
        };
        let first = LEVELS[..2].iter().flat_map(|level| level.shifts);
        let mut found: Vec<(Motion, ErrorsAt)> = first.map(|motion| (*motion, at(0.1))).collect();
        let reached = |found: &[(Motion, ErrorsAt)]| -> Vec<(f64, Option<f64>)> {
            let all = motion_errors(found, &LEVELS, &PULLS, false).shifted;
            all.iter().map(|at| (at.angle, at.force)).collect()
        };
        let near = [(1.0, Some(0.1)), (10.0, Some(0.1))];
        assert_eq!(reached(&found), near);
        let arc = |angle: f64| [0.05, -0.05].map(|along| Motion::BentAndPulled(angle, along));
        found.extend(arc(15.0).map(|motion| (motion, at(0.2))));
        assert_eq!(reached(&found)[2..], [(15.0, Some(0.2))], "a quarter of the way to 30°");
        found.extend(arc(20.0).map(|motion| (motion, at(0.3))));
        assert_eq!(reached(&found)[2..], [(20.0, Some(0.3))], "half of it");
        found.extend(arc(30.0).map(|motion| (motion, at(0.4))));
        assert_eq!(reached(&found)[2..], [(30.0, Some(0.4))], "all of it, not turned in place");
        found.extend(arc(45.0).map(|motion| (motion, at(0.5))));
        assert_eq!(reached(&found)[3..], [(45.0, Some(0.5))], "and half of the way to 60°");
        let finer = arc(5.5).map(|motion| (motion, at(0.1)));
        let shifted = motion_errors(&finer, &LEVELS[1..], &PULLS, false).shifted;
        assert_eq!(shifted.len(), 1, "of a finer mesh, half of the way from 1° to 10°");
        assert_eq!((shifted[0].angle, shifted[0].force), (5.5, Some(0.1)));
    }
}
