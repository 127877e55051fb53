//! The columns of a body by boundary elements: of its surface alone.
//!
//! In: a prepared body without tetrahedra. Out: its [`Solution`] with the families `affine` and `stiffness`, as finite elements
//! make them.

use super::check::refuse;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::STIFFNESS;
use super::judge::judge;
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
use std::collections::BTreeMap;

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
    let surface = Surface::from_mesh(&mesh);
    let mut prescribed = NodeFields::zeros(mesh.nodes.len(), FIELDS * controls.len());
    let mut is_held = vec![false; mesh.nodes.len()];
    for (e, control) in controls.iter().enumerate() {
        control.prescribe(&mesh.nodes, FIELDS * e, &mut prescribed);
        control.nodes.iter().for_each(|&node| is_held[node as usize] = true);
    }
    let of = bem::Surface { nodes: &mesh.nodes, triangles: &mesh.triangles };
    let solved = bem::solve(of, body.material.lame(), &is_held, &prescribed, progress)
        .map_err(|source| GreenError::Boundary { body: place.clone(), source })?;

    let rigid = RigidMotion::new(&mesh, &controls, &solved.fields, Some(&solved.work));
    let entity = format!("body.{name}");
    let failed = |source| GreenError::Solve { body: place.clone(), source };
    let forward_error = solved.stats.conditioning.map(|conditioning| conditioning.forward_error);
    notices.extend(judge(&entity, solved.stats.method, forward_error, &rigid).map_err(failed)?);
    let coarse = bem::relative(&(&solved.traction_work - &solved.work), &solved.work);
    let message = format!(
        "boundary elements: the tractions' work differs by {:.1} % from the energy. Large triangles make \
         the body too stiff: solve again with refine = 1, and compare the forces",
        100.0 * coarse
    );
    notices.push(Diagnostic::new(Severity::Note, &entity, message));
    let message = format!(
        "boundary elements: a rigid motion would take {:.0e} of the largest stiffness, the error of the integrals, and is taken \
         out",
        solved.integration_error
    );
    notices.push(Diagnostic::new(Severity::Detail, &entity, message));
    notices.sort_by_key(|finding| finding.severity);

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
        kept_factor: None,
        compressed: None,
        asymmetry: needs_stiffness.then_some(solved.asymmetry),
        rigid,
        stats: solved.stats,
        times,
        matrix_entries: solved.entries,
        notices,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::green::{AFFINE, RigidMotion};
    use crate::solve::Silent;
    use std::path::Path;

    fn scene(body: &str) -> Scene {
        let text = format!(
            "[body.b]\n{body}\nmaterial = {{ young = 1000.0, poisson = 0.3 }}\n\
             control.low = {{ nodes = {{ plane = {{ point = [-2, 0, 0], normal = [1, 0, 0], distance = 1e-6 }} }}, grab = \"fixed\" }}\n\
             control.high = {{ nodes = {{ plane = {{ point = [2, 0, 0], normal = [1, 0, 0], distance = 1e-6 }} }}, grab = \"dragger\" }}\n"
        );
        Scene::parse(&text, Path::new("/nowhere/scene.toml")).unwrap()
    }

    fn solved(body: &str) -> Result<Solution, GreenError> {
        super::super::solve(&scene(body), "b", &Requirements::new(&[AFFINE, STIFFNESS]), &Silent)
    }

    /// The clamped beam of the manual's table: its force against a sideways shift of one end.
    #[test]
    fn a_beam_resists_as_that_of_tet10_and_is_in_equilibrium() {
        const BEAM: &str = "generate = { block = { size = [4.0, 1.0, 1.0], cells = [8, 2, 2] } }";
        let bem = solved(&format!("{BEAM}\nmethod = \"bem\"")).unwrap();
        let tet10 = solved(&format!("{BEAM}\nelement = \"tet10\"")).unwrap();
        let force = |solution: &Solution| solution.stiffness().unwrap()[(FIELDS + 1, FIELDS + 1)];
        // What both come to on finer meshes is 13.49; with all diagonals of the block's faces one way round it is 13.97 here.
        let [bem_error, tet10_error] = [&bem, &tet10].map(|solution| force(solution) / 13.49 - 1.0);
        assert!(
            (0.0..0.04).contains(&bem_error) && (0.0..0.03).contains(&tet10_error),
            "{bem_error} {tet10_error}"
        );
        assert_eq!((bem.mesh.nodes.len(), bem.element_name(), tet10.element_name()), (74, "bem", "tet10"));
        let RigidMotion { shift, turn, shift_force, turn_force } = bem.rigid;
        assert!(
            shift < 1e-9 && turn < 1e-9 && shift_force.unwrap() < 1e-9 && turn_force.unwrap() < 1e-6,
            "{:?}",
            bem.rigid
        );
        assert!(bem.asymmetry.unwrap() < 1e-10 && bem.stats.worst_residual() < 1e-12);
        // Displacements of the middle under the same shift.
        let middle = |solution: &Solution| {
            let mesh = &solution.mesh;
            let node = mesh
                .nodes
                .iter()
                .position(|x| (x.y - 0.5).abs() < 1e-9 && x.x.abs() < 1e-9 && x.z.abs() < 1e-9);
            solution.fields.row(3 * node.unwrap() + 1)[FIELDS + 1]
        };
        assert!((middle(&bem) - middle(&tet10)).abs() < 0.01, "{} {}", middle(&bem), middle(&tet10));
    }

    /// A box of 4 × 1 × 1 m by twelve triangles, of which `left_out` are missing.
    fn solved_file(left_out: usize, more: &str) -> Result<Solution, GreenError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("box.obj");
        let corners =
            (0..8).map(|k| format!("v {} {} {}\n", if k & 1 == 0 { -2 } else { 2 }, k >> 1 & 1, k >> 2));
        let faces = [
            "1 3 4", "1 4 2", "5 6 8", "5 8 7", "1 2 6", "1 6 5", "3 7 8", "3 8 4", "1 5 7", "1 7 3",
            "2 4 8", "2 8 6",
        ];
        let faces = faces.iter().skip(left_out).map(|face| format!("f {face}\n"));
        std::fs::write(&path, corners.chain(faces).collect::<String>()).unwrap();
        solved(&format!("mesh = {:?}\nmethod = \"bem\"\n{more}", path.display().to_string()))
    }

    #[test]
    fn a_surface_file_is_solved_as_it_is_and_cut_finer() {
        let solution = solved_file(0, "longest_edge = 0.8").unwrap();
        assert!(solution.mesh.tets.is_empty() && solution.mesh.nodes.len() > 60);
        let force = solution.stiffness().unwrap()[(FIELDS + 1, FIELDS + 1)];
        assert!((force / 13.49 - 1.0).abs() < 0.1, "{force}");
        let coarse = solved_file(0, "refine = 1").unwrap();
        assert_eq!((coarse.mesh.nodes.len(), coarse.mesh.triangles.len()), (26, 48));
    }

    #[test]
    fn an_open_surface_is_refused_with_the_place() {
        let error = solved_file(1, "").err().unwrap().to_string();
        assert!(error.contains("need a closed surface") && error.contains("1 hole:"), "{error}");
    }
}
