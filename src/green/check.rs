//! Checks before anything is factorised: a Cholesky factorization that succeeds proves nothing. It passes flat and swapped
//! tetrahedra, pieces held at two points and bodies cracked open, and answers with nonsense.

use super::control::ControlElement;
use super::error::GreenError;
use super::floating::{Floating, floating};
use super::pieces;
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::extent::bounding_box;
use crate::fem::Lame;
use crate::mesh::TetMesh;
use crate::mesh::diagnostics::{self, digits, place};
use crate::mesh::length_unit::implausible;
use crate::mesh::walls::{FEW, ThinWalls, thin_walls, walls_too_thin};
use crate::scene::proposal::choice::{ERRORS, without_locking};
use crate::scene::{Body, Material, Method, Scene};
use indexmap::IndexMap;
use std::collections::BTreeSet;

/// Poisson's ratio above which a material is called nearly incompressible.
const LOCKING: f64 = 0.45;
/// Stiffness of a floating inclusion over that around it: above the first, digits are lost; above the second, all.
const STIFF: [f64; 2] = [1e8, 1e12];

/// Faults of the mesh itself; pieces are judged by [`support`].
pub fn mesh(entity: &str, mesh: &TetMesh, material: &Material) -> Vec<Diagnostic> {
    let found = diagnostics::find(mesh).into_iter().filter(|found| found.severity < Severity::Note);
    let found = found.map(|found| Diagnostic::new(found.severity, entity, found.message));
    found.chain(unit(entity, mesh, material)).collect()
}

/// Note on bodies of an unlikely size: pictures are fitted to the stage and hide a wrong unit.
fn unit(entity: &str, mesh: &TetMesh, material: &Material) -> Option<Diagnostic> {
    let (low, high) = bounding_box(&mesh.nodes);
    let side = (high - low).max();
    implausible(side, material.largest_m()).map(|message| Diagnostic::new(Severity::Note, entity, message))
}

/// Control elements that span no volume, all that are alike in one detail.
fn shapes(entity: &str, controls: &[ControlElement]) -> Vec<Diagnostic> {
    let mut alike: IndexMap<String, Vec<&str>> = IndexMap::new();
    for control in controls {
        if let Some(notice) = control.notice() {
            alike.entry(notice).or_default().push(&control.name);
        }
    }
    let detail = |(notice, names): (String, Vec<&str>)| {
        Diagnostic::new(Severity::Detail, entity, format!("control {}: {notice}", names.join(", ")))
    };
    alike.into_iter().map(detail).collect()
}

/// Control elements that share nodes, and pieces that none holds or joins ([`pieces`]).
pub fn support(entity: &str, mesh: &TetMesh, controls: &[ControlElement]) -> Vec<Diagnostic> {
    let mut findings = shapes(entity, controls);
    let mut owner: Vec<Option<usize>> = vec![None; mesh.nodes.len()];
    let mut told = BTreeSet::new();
    for (index, control) in controls.iter().enumerate() {
        for &node in &control.nodes {
            let Some(other) = owner[node as usize].replace(index) else { continue };
            if !told.insert((other, index)) {
                continue;
            }
            let other = &controls[other];
            let shared = control.nodes.iter().filter(|n| other.nodes.binary_search(n).is_ok()).count();
            let message = format!(
                "overlaps control {}: {shared} nodes belong to both (the first has tag {}). Make the selections \
                 disjoint",
                other.name, mesh.tags[node as usize]
            );
            let entity = format!("{entity}.control.{}", control.name);
            findings.push(Diagnostic::new(Severity::Error, &entity, message));
        }
    }
    findings.extend(pieces::find(entity, mesh, controls));
    findings
}

/// Walls that bend too stiffly because displacements are linear along their edges, by c (edge/thickness)² more than they are. Boundary
/// elements: c = 1/18 (plates of 1 × 1 m, 5 to 100 mm thick, beside `tet10`: chapter `method`). Linear tetrahedra, in however many
/// layers: c = 0.36, from 0.50 at ν = 0 to 0.31 at 0.45 (clamped plates of 1 × 0.2 m, 10 to 50 mm thick, one end moved aside, beside
/// `tet10`).
pub fn walls(entity: &str, body: &Body, mesh: &TetMesh) -> Option<Diagnostic> {
    let (found, too_stiff) = match body.method {
        Method::Bem => (thin_walls(mesh, 2.0).filter(|walls| walls.share > FEW), 1.0 / 18.0),
        Method::Fem if body.element.order == 1 => (walls_too_thin(mesh), 0.36),
        Method::Fem => return None,
    };
    let ThinWalls { share, edge, thickness } = found?;
    let [thin, long] = [thickness, edge].map(digits);
    let advice = match body.method {
        Method::Bem => format!("Write longest_edge = {thin}, or fill the body (no method) with tet10"),
        Method::Fem if without_locking(body).is_empty() => {
            "More layers do not help, and this model and these effects take linear tetrahedra alone"
                .to_owned()
        }
        Method::Fem => "More layers do not help: write element = \"tet10\"".to_owned(),
    };
    let message = format!(
        "walls {thin} m thick with edges of {long} m bend about {:.1} times too stiffly (under {:.0} % of the surface). {advice}",
        1.0 + too_stiff * (edge / thickness).powi(2),
        100.0 * share,
    );
    Some(Diagnostic::new(Severity::Warning, entity, message))
}

/// Materials that linear tetrahedra answer badly, and stiff inclusions that float.
pub fn materials(
    entity: &str,
    body: &Body,
    mesh: &TetMesh,
    controls: &[ControlElement],
    lame: &[Lame],
) -> Vec<Diagnostic> {
    let mut findings = Vec::new();
    let named = std::iter::once(("material".to_owned(), &body.material))
        .chain(body.region.iter().map(|(region, material)| (format!("region.{region}"), material)));
    for (key, material) in named.clone() {
        if let Some((severity, message)) = material.doubt() {
            findings.push(Diagnostic::new(severity, format!("{entity}.{key}"), message));
        }
    }
    let locks = |material: &Material| body.method == Method::Fem && material.poisson > LOCKING;
    for (key, Material { poisson, .. }) in named.filter(|(_, material)| locks(material)) {
        let (severity, advice) = nearly_incompressible(body);
        let message = format!("Poisson's ratio {poisson}: {advice}");
        findings.push(Diagnostic::new(severity, format!("{entity}.{key}"), message));
        findings.push(Diagnostic::new(Severity::Detail, format!("{entity}.{key}"), COARSE));
    }
    let mut controlled = vec![false; mesh.nodes.len()];
    for &node in controls.iter().flat_map(|control| &control.nodes) {
        controlled[node as usize] = true;
    }
    for part in floating(mesh, lame, &controlled, STIFF[0]) {
        let severity = if part.ratio > STIFF[1] { Severity::Error } else { Severity::Warning };
        let message = format!(
            "{}, {:.1e} times stiffer than what is around it ({} tetrahedra around {}), and {}: about {:.0} \
             digits of its own motion are left. A contrast of 10⁶ is as good as rigid; or hold it at three \
             nodes off one line",
            floats(mesh, &part),
            part.ratio,
            part.tetrahedra,
            place(&part.centre),
            part.how,
            (16.0 - part.ratio.log10()).max(0.0)
        );
        findings.push(Diagnostic::new(severity, entity, message));
    }
    findings
}

/// Errors of coarse meshes near ν = 1/2.
const COARSE: &str = "at Poisson's ratio 0.4999 the moment of a bent bar errs by 31 % with 4 cells of tet4_anp through its \
                      thickness and by 10 % with 8, by 9 % with 2 of tet10 and by 2 % with 4";

/// Warning or note for the element of a body near ν = 1/2, with a remedy that its model and effects take.
fn nearly_incompressible(body: &Body) -> (Severity, String) {
    if body.element.locks {
        let remedy = match without_locking(body) {
            [] => format!(
                "Write a Poisson's ratio of at most {LOCKING}: this model and these effects take linear tetrahedra alone"
            ),
            [element] => format!("Write element = \"{}\"", element.name),
            [least, other, ..] => {
                format!("Write element = \"{}\" (least error) or \"{}\" (same nodes)", least.name, other.name)
            }
        };
        return (Severity::Warning, format!("linear tetrahedra lock, and the body is too stiff. {remedy}"));
    }
    let is_measured = body.effects.iter().any(|effect| effect == ERRORS);
    let advice =
        if is_measured { String::new() } else { format!(". effects = [\"{ERRORS}\"] measures by how much") };
    (Severity::Note, format!("the element does not lock, but coarse meshes are too stiff{advice}"))
}

/// "region 2 and a part of region 3 (bone) float".
fn floats(mesh: &TetMesh, part: &Floating) -> String {
    let name = |(region, whole): &(u32, bool)| {
        let known = mesh.region_names.get(region).map_or(String::new(), |name| format!(" ({name})"));
        format!("{}region {region}{known}", if *whole { "" } else { "a part of " })
    };
    let names: Vec<String> = part.regions.iter().map(name).collect();
    match names.as_slice() {
        [one] => format!("{one} floats"),
        [others @ .., last] => format!("{} and {last} float", others.join(", ")),
        [] => "a part floats".to_owned(),
    }
}

/// The first error among the findings, if there is one.
pub fn refuse(scene: &Scene, findings: &[Diagnostic]) -> Result<(), GreenError> {
    let mut errors = findings.iter().filter(|finding| finding.severity == Severity::Error);
    let Some(first) = errors.next() else { return Ok(()) };
    let more = match errors.count() {
        0 => String::new(),
        count => format!(" ({count} more: `greenstage check {}`)", scene.path.display()),
    };
    Err(scene.invalid(&first.place, format!("{}{more}", first.message)).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};
    use crate::scene::materials::find_material;

    #[test]
    fn a_body_of_unlikely_size_is_told_of() {
        let material = Material::from(find_material("steel").unwrap());
        let told = |size: [f64; 3]| {
            let body = block(&Block { size, cells: [1; 3] }).unwrap();
            unit("body.part", &body, &material).map(|finding| finding.message)
        };
        assert_eq!(told([0.2, 0.05, 0.02]), None);
        let far_too_long = told([93.0, 20.0, 20.0]).unwrap();
        assert!(far_too_long.starts_with("its longest side is 93.00 m"), "{far_too_long}");
        assert!(told([2e-7; 3]).unwrap().contains("is 2.000e-7 m"));
    }
}
