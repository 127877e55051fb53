//! The columns of a body by boundary elements: of its surface alone.
//!
//! In: a prepared body without tetrahedra. Out: its [`Solution`] with the families `affine` and `stiffness`, as finite elements
//! make them.

use super::basis::refuse;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::STIFFNESS;
use super::judge;
use super::prepare::Prepared;
use super::requirements::Requirements;
use super::rigid::RigidMotion;
use super::solution::{Solution, StepTimes};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::bem;
use crate::fem::NodeFields;
use crate::mesh::Surface;
use crate::scene::Scene;
use crate::solve::Progress;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Where the tractions' forces differ from those of the energy by more than this part, there is a warning.
const COARSE: f64 = 0.1;

pub fn solve(
    scene: &Scene,
    name: &str,
    prepared: Prepared,
    requirements: &Requirements,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    let body = &scene.body[name];
    let place = format!("{}: body.{name}", scene.path.display());
    let Prepared { mesh, controls, findings: mut notices, .. } = prepared;
    refuse(scene, &notices)?;
    let surface = Surface::of(&mesh);
    let mut prescribed = NodeFields::zeros(mesh.nodes.len(), FIELDS * controls.len());
    let mut is_held = vec![false; mesh.nodes.len()];
    for (e, control) in controls.iter().enumerate() {
        control.prescribe(&mesh.nodes, FIELDS * e, &mut prescribed);
        control.nodes.iter().for_each(|&node| is_held[node as usize] = true);
    }
    let of = bem::Surface { nodes: &mesh.nodes, triangles: &mesh.triangles };
    let solved = bem::solve(of, body.material.lame(), &is_held, &prescribed, progress)
        .map_err(|source| GreenError::Boundary { body: place.clone(), source })?;

    let rigid = RigidMotion::of(&mesh, &controls, &solved.fields, Some(&solved.work));
    let entity = format!("body.{name}");
    let failed = |source| GreenError::Solve { body: place.clone(), source };
    notices.extend(judge::judge(&entity, &solved.stats, &rigid).map_err(failed)?);
    let coarse = relative(&(&solved.traction_work - &solved.work), &solved.work);
    let severity = if coarse > COARSE { Severity::Warning } else { Severity::Note };
    let message = format!(
        "the forces of the tractions on the control elements differ from those of the energy by {:.2} % of the largest: the finer \
         the triangles there, the less; refine = 1 makes four of each, longest_edge = … bounds their edges. The integrals of the \
         kernels are exact to {:.0e}",
        100.0 * coarse,
        solved.integration_error
    );
    notices.push(Diagnostic::new(severity, &entity, message));
    notices.sort_by_key(|finding| finding.severity);

    let asymmetry = relative(&(&solved.traction_work - solved.traction_work.transpose()), &solved.traction_work);
    let needs_stiffness = requirements.has(STIFFNESS);
    let tables = needs_stiffness.then_some((STIFFNESS.name, solved.work));
    let times = StepTimes { assembly_s: solved.assembly_s, ..StepTimes::default() };
    Ok(Solution {
        element: body.element,
        method: body.method,
        mesh,
        surface,
        controls,
        fields: solved.fields,
        tables: tables.into_iter().collect::<BTreeMap<_, _>>(),
        loads: Vec::new(),
        compliance: None,
        asymmetry: needs_stiffness.then_some(asymmetry),
        rigid,
        stats: solved.stats,
        times,
        matrix_entries: solved.entries,
        notices,
    })
}

/// max |a| over max |b|; 0 where both are.
fn relative(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let (a, b) = (a.amax(), b.amax());
    if a == 0.0 { 0.0 } else { a / b }
}
