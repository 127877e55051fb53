//! Tables: `pose,node,ux,uy,uz` and `pose,control,fx,fy,fz,mx,my,mz,energy`, in m, N, N·m and J.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use crate::base::output::Kind;
use crate::base::table::quoted;
use crate::deform::Wrench;
use std::fmt::Write;

const DISPLACEMENT_HEADING: &str = "pose,node,ux,uy,uz\n";
const STRESS_HEADING: &str = "pose,von_mises,node,strain,strain_node,of_limit,passed\n";
const FORCE_HEADING: &str = "pose,control,fx,fy,fz,mx,my,mz,energy";
const ERROR_HEADING: &str = ",force_error,moment_error";

/// The displacement of every node, by the mesh's node tags.
pub const DISPLACEMENTS: Exporter = Exporter {
    suffix: ".csv",
    kind: Kind {
        name: "a table of displacements by `deform`",
        recognizes: |head| head.starts_with(DISPLACEMENT_HEADING.as_bytes()),
    },
    spread: Spread::AllPoses,
    needs: Needs::Nothing,
    write: displacements,
};

/// Force and moment of every control element, and the energy of its body; with what they may be wrong by, where it was measured.
pub const FORCES: Exporter = Exporter {
    suffix: ".forces.csv",
    kind: Kind {
        name: "a table of forces by `deform`",
        recognizes: |head| head.starts_with(FORCE_HEADING.as_bytes()),
    },
    spread: Spread::AllPoses,
    needs: Needs::Forces,
    write: forces,
};

/// The largest von Mises stress (Pa) and strain of every body that lists the effect stress, with the nodes that have them; the
/// part of a limit that is reached, and the part of the surface in which one is passed.
pub const STRESSES: Exporter = Exporter {
    suffix: ".stress.csv",
    kind: Kind {
        name: "a table of stresses by `deform`",
        recognizes: |head| head.starts_with(STRESS_HEADING.as_bytes()),
    },
    needs: Needs::Stress,
    spread: Spread::AllPoses,
    write: stresses,
};

fn stresses(set: &ResultSet) -> Vec<u8> {
    let mut text = STRESS_HEADING.to_owned();
    for result in &set.results {
        let Some(reached) = result.stress.as_ref().map(|stress| &stress.reached) else { continue };
        let tags = set.geometry.iter().find(|g| g.body == result.body).map_or(&[][..], |g| &g.tags);
        let tag = |node: usize| tags.get(node).map_or(String::new(), u64::to_string);
        let part = reached.limit.map_or(String::new(), |(part, _)| format!("{part:e}"));
        let ((stress, at), (strain, strained)) = (reached.von_mises, reached.strain);
        let (label, at, strained) = (quoted(&set.label(result)), tag(at), tag(strained));
        let _ = writeln!(text, "{label},{stress:e},{at},{strain:e},{strained},{part},{:e}", reached.passed);
    }
    text.into_bytes()
}

fn displacements(set: &ResultSet) -> Vec<u8> {
    let mut text = DISPLACEMENT_HEADING.to_owned();
    for result in &set.results {
        let label = quoted(&set.label(result));
        let tags = set.geometry.iter().find(|g| g.body == result.body).map_or(&[][..], |g| &g.tags);
        for (tag, u) in tags.iter().zip(&result.displacement) {
            // Writing into a String cannot fail.
            let _ = writeln!(text, "{label},{tag},{:e},{:e},{:e}", u.x, u.y, u.z);
        }
    }
    text.into_bytes()
}

fn forces(set: &ResultSet) -> Vec<u8> {
    let is_measured = set.results.iter().any(|result| result.told.error.measured().is_some());
    let mut text = format!("{FORCE_HEADING}{}\n", if is_measured { ERROR_HEADING } else { "" });
    for result in &set.results {
        let Some(forces) = &result.wrenches else { continue };
        let label = quoted(&set.label(result));
        let error = match (is_measured, result.told.error.measured()) {
            (true, Some(error)) if error.is_whole => format!(",{:e},{:e}", error.force, error.moment),
            (true, _) => ",NaN,NaN".to_owned(),
            (false, _) => String::new(),
        };
        for (control, Wrench { force: f, moment: m }) in &forces.controls {
            let name = quoted(control);
            let numbers = [f.x, f.y, f.z, m.x, m.y, m.z, forces.energy].map(|value| format!("{value:e}"));
            let _ = writeln!(text, "{label},{name},{}{error}", numbers.join(","));
        }
    }
    text.into_bytes()
}
