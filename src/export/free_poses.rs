//! Poses of `deform` on their way from rest: those whose free control elements are found, and where a material first yields.

use super::asked::{PoseRequest, go, lead};
use super::result_set::{MissedPose, StressResult};
use super::told::FirstYield;
use crate::base::extent::extent;
use crate::base::failure::Failure;
use crate::deform::{
    ControlPose, ControlPoses, Deformer, ExpectedErrors, Freedom, ModelEntry, Screw, Search, Statics, Way,
    Wrench, Wrenches,
};
use crate::effect::stress::{Peaks, StressedBody};
use crate::green::GreenFile;
use crate::prepare::Resolved;
use crate::solve::Silent;
use crate::world::wrench_error_of;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// The poses at a share of the way to those that are asked for, from rest or from those `before`.
pub(super) fn way(
    asked: &ControlPoses,
    before: Option<&ControlPoses>,
    is_linear: bool,
    share: f64,
) -> ControlPoses {
    let part = |(e, pose): (usize, &ControlPose)| match before {
        Some(before) => Way::onwards(&before[e], pose).pose(share),
        None if is_linear => ControlPose {
            translation: pose.translation * share,
            matrix: Matrix3::identity() * (1.0 - share) + pose.matrix * share,
        },
        None if share == 1.0 => *pose,
        None => Screw::default().towards(&Screw::from_pose(pose), share).pose(),
    };
    asked.iter().enumerate().map(part).collect()
}

/// The largest extent of places, m.
pub(super) fn size(places: impl IntoIterator<Item = Vector3<f64>>) -> f64 {
    let size = extent(places).map_or(1.0, |(low, high)| (high - low).max());
    if size.is_finite() && size > 0.0 { size } else { 1.0 }
}

fn size_of(body: &Deformer) -> f64 {
    size(body.rest().iter().map(|x| Vector3::from(*x).cast()))
}

/// Finds the control elements of one pose that are free in something.
fn find(
    asked: &PoseRequest<'_>,
    before: Option<&ControlPoses>,
    (model, length): (&ModelEntry, f64),
    wrenches: &mut Wrenches<'_>,
) -> Result<ControlPoses, String> {
    let way = |share: f64| way(&asked.given, before, model.is_linear(), share);
    let mut search = Search::new(&asked.freedom, length, model.is_linear(), &way);
    match before {
        Some(_) => search.going_on(wrenches)?.follow(wrenches),
        None => search.follow(wrenches),
    }
}

/// Wrenches of a body that is shown from a .green file; where its way begins at rest, it is led from there to poses that the state
/// before them does not reach.
fn of_file<'a>(
    body: &'a mut Deformer,
    is_from_rest: bool,
) -> impl FnMut(&[ControlPose]) -> Result<Vec<Wrench>, String> + 'a {
    move |poses| {
        body.take(poses);
        if is_from_rest && body.balance().is_none() {
            body.forget();
            go(&vec![ControlPose::REST; poses.len()], poses, body);
            body.take(poses);
        }
        body.balance().ok_or_else(|| "the model has no forces in such a pose".to_owned())
    }
}

/// All poses that are asked for, with those of free control elements found for the bodies of the .green file; poses that are not
/// found go into `missed`.
pub(super) fn found<'a>(
    scene: &Resolved,
    asked: &[PoseRequest<'a>],
    file: Option<&Arc<GreenFile>>,
    missed: &mut Vec<MissedPose>,
) -> Result<Vec<PoseRequest<'a>>, Failure> {
    let mut all = asked.to_vec();
    let Some(file) = file else { return Ok(all) };
    for (name, body) in scene.bodies.iter().filter(|(name, _)| file.meta.bodies.contains_key(*name)) {
        let is_own = |asked: &PoseRequest<'_>| asked.body == *name;
        if !all.iter().any(|asked| is_own(asked) && !asked.freedom.is_empty()) {
            continue;
        }
        let mut deformer = Deformer::new(file.clone(), name, body.model).map_err(Failure::wrong)?;
        let length = size_of(&deformer);
        for place in (0..all.len()).filter(|&place| is_own(&asked[place])) {
            let one = all[place].clone();
            let loads = |asked: &PoseRequest<'_>, body: &Deformer| {
                let wrong = |message| Failure::wrong(format!("{}: {message}", asked.place()));
                asked.loads.applied(body).map_err(wrong)
            };
            let is_missed = |asked: &PoseRequest<'_>| {
                missed.iter().any(|m: &MissedPose| m.pose == asked.pose && m.body == asked.body)
            };
            let before = one.after.map(|before| &all[before]);
            let lost = before.filter(|before| is_missed(before)).map(|before| before.pose);
            let settled = match (lost, one.freedom.is_empty()) {
                (Some(lost), _) => Err(format!("it goes on from pose \"{lost}\", which has none")),
                (None, true) => continue,
                (None, false) => {
                    match before {
                        Some(before) => {
                            deformer.apply(&loads(before, &deformer)?);
                            lead(before, &all, None, &mut deformer);
                            deformer.evaluate(&before.control);
                        }
                        None => deformer.forget(),
                    }
                    deformer.apply(&loads(&one, &deformer)?);
                    let before = before.map(|before| &before.control);
                    find(&one, before, (body.model, length), &mut of_file(&mut deformer, one.after.is_none()))
                }
            };
            match settled {
                Ok(control) => all[place].control = control,
                Err(why) => missed.push(MissedPose {
                    pose: one.pose.to_owned(),
                    body: name.clone(),
                    why: format!("{}: {why}", one.place()),
                }),
            }
        }
    }
    Ok(all)
}

/// Tolerances of the first yield, as parts of a limit: of bodies that are quickly computed, and of those that are solved anew.
const NEAR: [f64; 2] = [2e-3, 1e-2];
const TRIALS: usize = 12;

/// A state on the way: the poses, and what part of a limit it reaches away from the edges of control elements.
type At = (ControlPoses, f64);

/// The part of a limit that a body reaches away from the edges of its control elements, and with them.
pub(super) fn parts(reached: &Peaks) -> Option<[f64; 2]> {
    Some([reached.inside.limit?.0, reached.limit?.0])
}

/// Whether it is asked where a body first yields: the limit is passed by more than peaks at the edges of control elements.
pub(super) fn yields(stress: Option<&StressResult>) -> bool {
    stress.and_then(|stress| parts(&stress.reached)).is_some_and(|[inside, _]| inside > 1.0)
}

/// The first share of the way at which a limit is reached, 0 where the loads alone, which act from the beginning, pass it: near
/// rest stress grows as the way does, and from there the limit is approached, between shares on either side of it.
fn approach(
    near: f64,
    is_loaded: bool,
    mut at: impl FnMut(f64) -> Option<At>,
) -> Option<(f64, ControlPoses)> {
    let mut by_loads = 0.0;
    if is_loaded {
        let (poses, part) = at(0.0)?;
        if part >= 1.0 {
            return Some((0.0, poses));
        }
        by_loads = part;
    }
    let (mut share, mut below, mut beyond) = (1e-4, 0.0, 1.0);
    for _ in 0..TRIALS {
        let (poses, part) = at(share)?;
        if (part - 1.0).abs() < near {
            return Some((share, poses));
        }
        if part < 1.0 {
            below = share;
        } else {
            beyond = share;
        }
        let next = share * (1.0 - by_loads) / (part - by_loads);
        share = if next > below && next < beyond { next } else { 0.5 * (below + beyond) };
    }
    None
}

/// The first yield of a body of the .green file on its way from rest to a pose in which its material yields.
pub(super) fn first_yield(
    asked: &PoseRequest<'_>,
    deformer: &mut Deformer,
    stressed: &StressedBody,
    expected: Option<&ExpectedErrors>,
) -> Option<FirstYield> {
    if asked.after.is_some() {
        return None;
    }
    let (linear, length) = (deformer.entry.is_linear(), size_of(deformer));
    let way = |share: f64| way(&asked.given, None, linear, share);
    let mut search = (!asked.freedom.is_empty()).then(|| Search::new(&asked.freedom, length, linear, &way));
    let mut at_edges = 0.0;
    let (share, control) = approach(NEAR[0], !asked.loads.is_none(), |share| {
        deformer.forget();
        let poses = match &mut search {
            Some(search) => search.at(share, &mut of_file(deformer, true)).ok()?,
            None => way(share),
        };
        // The search may have taken them already.
        deformer.take(&poses);
        deformer.deform();
        let [inside, all] = parts(&stressed.reached(&stressed.stress(deformer)))?;
        at_edges = all;
        Some((poses, inside))
    })?;
    let wrenches = deformer.wrenches().map(|(wrenches, _)| wrenches);
    let known = expected.zip(wrenches.as_ref());
    let error =
        known.and_then(|(expected, wrenches)| wrench_error_of(expected, deformer, wrenches, &asked.freedom));
    Some(FirstYield { share, at_edges, control, wrenches, error })
}

/// The [`parts`] of a limit that displacements of all nodes reach.
pub(super) type Parts<'a> = dyn Fn(&[Vector3<f64>]) -> Option<[f64; 2]> + 'a;

/// The first yield of a body that is solved anew for each pose; [`parts`] of a limit are reached by displacements of all its
/// nodes.
pub(super) fn first_yield_of(
    asked: &PoseRequest<'_>,
    model: &ModelEntry,
    statics: &mut Statics,
    parts: &Parts<'_>,
) -> Option<FirstYield> {
    if asked.after.is_some() {
        return None;
    }
    let way = |share: f64| way(&asked.given, None, model.is_linear(), share);
    let (mut wrenches, mut at_edges) = (None, 0.0);
    let (share, control) = approach(NEAR[1], !asked.loads.is_none(), |share| {
        let part = |freedom: &Freedom| Freedom { load: freedom.load.map(|load| load * share), ..*freedom };
        statics.push(&asked.freedom.iter().map(part).collect::<Vec<_>>());
        let found = statics.solve(&way(share), &Silent).ok()?;
        let [inside, all] = parts(&found.displacement)?;
        (wrenches, at_edges) = (Some(found.wrenches), all);
        Some((found.poses, inside))
    })?;
    Some(FirstYield { share, at_edges, control, wrenches, error: None })
}
