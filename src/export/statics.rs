//! Bodies whose model is solved anew for every pose: the part of `greenstage deform` that needs no .green file.

use super::asked::PoseRequest;
use crate::base::diagnostic::{is_verbose, notice};
use crate::base::failure::Failure;
use crate::base::progress::Bars;
use crate::base::table::{Table, seconds};
use crate::deform::{
    Branch, ControlPoses, CriticalPose, EquilibriumResult, HeldBody, Statics, StaticsError, percent,
};
use crate::fem::Law;
use crate::prepare::Resolved;
use crate::solve::Progress;
use std::collections::BTreeMap;
use std::time::Instant;

/// One body in all its poses.
pub struct Solved {
    pub statics: Statics,
    /// Equilibria in the order of the poses; the reason where a pose has none.
    pub settled: Vec<Result<EquilibriumResult, String>>,
    /// Control poses in each, those that were found too.
    pub control: Vec<ControlPoses>,
    /// Work and quality of each pose.
    pub table: Table,
}

/// A pose of the body.
pub struct PoseToSolve<'a> {
    pub asked: &'a PoseRequest<'a>,
    /// Index of the pose before it from which this one goes on; `None`: from rest.
    pub after: Option<usize>,
}

/// Solves body `name` in `poses`, in their order.
pub fn solve(
    scene: &Resolved,
    name: &str,
    law: &'static Law,
    poses: &[PoseToSolve<'_>],
) -> Result<Solved, Failure> {
    let bars = Bars::new(name, false);
    let mut statics = Statics::new(scene, name, law, &bars).map_err(failure)?;
    statics.judge_stability();
    for notice in &statics.notices {
        notice!("{notice}");
    }
    let columns = ["load steps", "factorizations", "residual", "least det F", "energy J", "branch"];
    let mut table = Table::new(&[&[name], &columns[..], &["least eigenvalue", "time"]].concat());
    let (mut settled, mut control) = (Vec::new(), Vec::new());
    // Of the poses that others go on from.
    let mut held: BTreeMap<usize, HeldBody> = BTreeMap::new();
    bars.begin("Newton", 1000 * poses.len() as u64);
    for (i, pose) in poses.iter().enumerate() {
        let started = Instant::now();
        let place = pose.asked.place();
        apply(pose.asked, &mut statics)?;
        statics.push(&pose.asked.freedom);
        let before = pose.after.map(|before| (poses[before].asked.pose, held.get(&before)));
        let at = &pose.asked.given;
        control.push(at.clone());
        let found = match before {
            None => statics.solve(at, &bars),
            Some((before, Some(held))) => statics.solve_after(before, held, at, &bars),
            Some((before, None)) => {
                add_none(&mut table, pose.asked.pose);
                let why = format!("it goes on from pose \"{before}\", which has no equilibrium");
                settled.push(Err(format!("{place}: {why}")));
                continue;
            }
        };
        let took = seconds(started.elapsed().as_secs_f64());
        match found {
            Ok(found) => {
                let figures = [format!("{:.1e}", found.residual), format!("{:.6e}", found.energy)];
                add_row(&mut table, pose.asked.pose, &found, [&figures[0], &figures[1]], &took);
                if let Some(state) = statics.held().filter(|_| poses.iter().any(|of| of.after == Some(i))) {
                    held.insert(i, state.clone());
                }
                if !pose.asked.freedom.is_empty() {
                    control[i].clone_from(&found.poses);
                }
                settled.push(Ok(found));
            }
            Err(error @ StaticsError::Stopped { .. }) => {
                if let StaticsError::Stopped { settled, share, .. } = &error {
                    let end = format!("none beyond {:.1} %", 100.0 * share);
                    add_row(&mut table, pose.asked.pose, settled, [&end, ""], &took);
                }
                let details = error.details().filter(|_| is_verbose()).map(|details| format!(". {details}"));
                settled.push(Err(format!("{place}: {error}{}", details.unwrap_or_default())));
            }
            Err(error @ (StaticsError::Loose { .. } | StaticsError::StillTurning { .. })) => {
                add_none(&mut table, pose.asked.pose);
                settled.push(Err(format!("{place}: {error}")));
            }
            Err(error) => {
                return Err(match failure(error) {
                    Failure::Work(error) => Failure::Work(anyhow::anyhow!("{place}: {error}")),
                    request => request,
                });
            }
        }
    }
    bars.end();
    for (pose, found) in poses.iter().zip(&settled) {
        let Ok(found) = found else { continue };
        if let Some(critical) = found.stability.passed.last() {
            notice!("note: {}: {}", pose.asked.place(), beyond(found.stability.branch, critical));
        }
        if !found.inverted.is_empty() {
            notice!("warning: {}: {}", pose.asked.place(), inverted(&statics, found));
        }
    }
    Ok(Solved { statics, settled, control, table })
}

/// The loads of the pose act from now on.
pub fn apply(asked: &PoseRequest<'_>, statics: &mut Statics) -> Result<(), Failure> {
    let wrong = |message| Failure::wrong(format!("{}: {message}", asked.place()));
    let forces = asked.loads.on_mesh(statics).map_err(wrong)?;
    statics.apply(&forces).map_err(failure)
}

/// Adds the work of a pose; its residual, or the share of its way up to which there is an equilibrium, and its energy.
fn add_row(table: &mut Table, pose: &str, at: &EquilibriumResult, figures: [&str; 2], took: &str) {
    let det = format!("{:.3}", at.least_det.0);
    let (steps, factorizations) = (at.counts.steps.to_string(), at.counts.factorizations.to_string());
    let least = at.stability.least.as_ref().map_or_else(String::new, |(least, _)| percent(*least));
    // A last state before the end of its way is no result.
    let branch = if figures[1].is_empty() { "" } else { at.stability.branch.name() };
    table.row(&[pose, &steps, &factorizations, figures[0], &det, figures[1], branch, &least, took]);
}

/// Adds a pose for which nothing was solved.
fn add_none(table: &mut Table, pose: &str) {
    table.row(&[pose, "0", "0", "none", "", "", "", "", ""]);
}

/// The way on which the body came to the branch that is shown.
fn beyond(branch: Branch, critical: &CriticalPose) -> String {
    let other = match branch {
        Branch::Snapped => "what is shown is the next stable state on its curve",
        _ => "what is shown is one stable state beyond; it may buckle to the other side as well",
    };
    format!("{critical}; {other}")
}

fn inverted(statics: &Statics, found: &EquilibriumResult) -> String {
    let mesh = &statics.mesh;
    let tags = |&tet: &usize| format!("{:?}", mesh.tets[tet].map(|node| mesh.tags[node as usize]));
    let named: Vec<String> = found.inverted.iter().take(5).map(tags).collect();
    format!(
        "{} of {} tetrahedra are turned inside out (least det F {:.3}; nodes {}{}): no real body does \
         this. Turn or press less, or refine there",
        found.inverted.len(),
        mesh.tets.len(),
        found.least_det.0,
        named.join(", "),
        if found.inverted.len() > named.len() { ", …" } else { "" }
    )
}

fn failure(error: StaticsError) -> Failure {
    match error {
        StaticsError::Green(error) => error.into(),
        other => Failure::work(other),
    }
}
