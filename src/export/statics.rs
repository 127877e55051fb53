//! Bodies whose model is solved anew for every pose: the part of `greenstage deform` that needs no .green file.

use crate::base::bars::Bars;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::base::table::{Table, seconds};
use crate::deform::{ControlPoses, EquilibriumResult, Statics, StaticsError};
use crate::fem::Law;
use crate::scene::Scene;
use crate::solve::Progress;
use std::time::Instant;

/// One body in all its poses.
pub struct Solved {
    pub statics: Statics,
    /// In the order of the poses; why there is none where a pose has no equilibrium.
    pub settled: Vec<Result<EquilibriumResult, String>>,
    /// What each pose took, and how good it is.
    pub table: Table,
}

/// Solves body `name` in `poses`, each with its name, in their order.
pub fn solve(
    scene: &Scene,
    name: &str,
    law: &'static Law,
    poses: &[(&str, &ControlPoses)],
) -> Result<Solved, Failure> {
    let bars = Bars::new(name, false);
    let mut statics = Statics::new(scene, name, law, &bars).map_err(failure)?;
    for notice in &statics.notices {
        notice!("{notice}");
    }
    let mut table =
        Table::new(&[name, "load steps", "factorizations", "residual", "least det F", "energy J", "time"]);
    let mut settled = Vec::new();
    bars.begin("Newton", 1000 * poses.len() as u64);
    for &(pose, control) in poses {
        let started = Instant::now();
        let place = format!("pose \"{pose}\": body.{name}");
        let found = match statics.solve(control, &bars) {
            Ok(found) => found,
            Err(error @ StaticsError::Stopped { .. }) => {
                settled.push(Err(format!("{place}: {error}")));
                continue;
            }
            Err(error) => {
                return Err(match failure(error) {
                    Failure::Work(error) => Failure::Work(anyhow::anyhow!("{place}: {error}")),
                    request => request,
                });
            }
        };
        table.row(&[
            pose,
            &found.counts.steps.to_string(),
            &found.counts.factorizations.to_string(),
            &format!("{:.1e}", found.residual),
            &format!("{:.3}", found.least_det.0),
            &format!("{:.6e}", found.energy),
            &seconds(started.elapsed().as_secs_f64()),
        ]);
        settled.push(Ok(found));
    }
    bars.end();
    let found =
        poses.iter().zip(&settled).filter_map(|((pose, _), found)| Some((pose, found.as_ref().ok()?)));
    for (pose, found) in found.filter(|(_, found)| !found.inverted.is_empty()) {
        notice!("warning: pose \"{pose}\": body.{name}: {}", inverted(&statics, found));
    }
    Ok(Solved { statics, settled, table })
}

fn inverted(statics: &Statics, found: &EquilibriumResult) -> String {
    let mesh = &statics.mesh;
    let tags = |&tet: &usize| format!("{:?}", mesh.tets[tet].map(|node| mesh.tags[node as usize]));
    let named: Vec<String> = found.inverted.iter().take(5).map(tags).collect();
    format!(
        "{} of {} tetrahedra are turned inside out (least det F {:.3}; nodes {}{}): the forces balance, but no real \
         body does this; turn or press less, or refine there",
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
