//! The tractions of a pattern of 1 N, 1 N·m or 1 Pa: forces for each area of some faces of a body.
//!
//! In: a pattern of a scene, and the body's mesh. Out: for each of the pattern's columns the traction at a place of a face whose
//! outward unit normal is known, as consistent nodal forces or at the triangles of the surface.

use crate::fem::{Area, traction};
use crate::mesh::{Surface, TetMesh, outer_faces};
use crate::scene::{DirectionField, Load, LoadKind, Scene};
use nalgebra::Vector3;
use std::cell::RefCell;

type V3 = Vector3<f64>;

/// At a place with this normal, N/m² for 1 of the pattern's unit.
type Traction = Box<dyn Fn(&V3, &V3) -> V3>;

/// The faces on which a pattern acts, and what it does there.
pub struct Tractions {
    /// Their numbers among [`outer_faces`], and their nodes.
    numbers: Vec<usize>,
    faces: Vec<Vec<u32>>,
    columns: Vec<Traction>,
}

impl Tractions {
    /// The error says why the pattern cannot act.
    pub fn of(scene: &Scene, mesh: &TetMesh, pattern: &Load) -> Result<Tractions, String> {
        let chosen = pattern.nodes.select(mesh)?;
        let is_chosen = |node: &u32| chosen.binary_search(node).is_ok();
        let outer = outer_faces(mesh).into_iter().enumerate();
        let (numbers, faces): (Vec<usize>, Vec<Vec<u32>>) =
            outer.filter(|(_, face)| face.iter().all(is_chosen)).unzip();
        if faces.is_empty() {
            return Err(format!(
                "no face of the surface has all its nodes among the {} that are selected, and a pattern acts on faces: select more \
                 of the surface, or use surface_compliance for forces on single nodes",
                chosen.len()
            ));
        }
        let columns = match &pattern.direction {
            Some(direction) => {
                let field = direction.load(&scene.resolve(&direction.file), mesh)?;
                vec![along_field(mesh, &faces, field)?]
            }
            None => of_kind(mesh, &faces, pattern)?,
        };
        Ok(Tractions { numbers, faces, columns })
    }

    /// f_a = ∫ N_a t dA over all nodes, for each column.
    pub fn nodal_forces(&self, mesh: &TetMesh) -> Vec<Vec<V3>> {
        self.columns.iter().map(|column| traction(mesh, &self.faces, column)).collect()
    }

    /// At the middle of every triangle of `surface`, that of `mesh`, for each column; zero beside the faces.
    pub fn at_triangles(&self, mesh: &TetMesh, surface: &Surface) -> Vec<Vec<V3>> {
        let of_face = if mesh.mids.is_empty() { 1 } else { 4 };
        let triangles = || self.numbers.iter().flat_map(|face| of_face * face..of_face * (face + 1));
        let mut all = vec![vec![V3::zeros(); surface.triangles.len()]; self.columns.len()];
        for triangle in triangles().filter(|&triangle| triangle < surface.triangles.len()) {
            let place = |corner: u32| mesh.nodes[surface.nodes[corner as usize] as usize];
            let [a, b, c] = surface.triangles[triangle].map(place);
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else { continue };
            for (all, column) in all.iter_mut().zip(&self.columns) {
                all[triangle] = column(&((a + b + c) / 3.0), &normal);
            }
        }
        all
    }
}

fn of_kind(mesh: &TetMesh, faces: &[Vec<u32>], pattern: &Load) -> Result<Vec<Traction>, String> {
    let area = Area::of(mesh, faces);
    let axis = match pattern.axis {
        Some(axis) => V3::from(axis).normalize(),
        None => area.normal / area.normal.norm(),
    };
    let needs_axis = !matches!(pattern.kind, LoadKind::Shift | LoadKind::Pressure);
    if needs_axis && pattern.axis.is_none() && area.normal.norm() < 1e-3 * area.size {
        return Err(
            "the normals of its faces cancel, so that they have no mean: give axis = [x, y, z]".to_owned()
        );
    }
    let spread = |direction: V3| -> Traction {
        let each = direction / area.size;
        Box::new(move |_, _| each)
    };
    Ok(match pattern.kind {
        LoadKind::Stretch | LoadKind::Direction => vec![spread(axis)],
        LoadKind::Shift => (0..3).map(|along| spread(V3::ith(along, 1.0))).collect(),
        LoadKind::Pressure => vec![Box::new(|_, normal| -normal)],
        LoadKind::Twist => {
            let middle = area.middle;
            let around = traction(mesh, faces, &|x, _| axis.cross(&(x - middle)));
            let arms = around.iter().zip(&mesh.nodes);
            let torque: f64 = arms.map(|(force, x)| (x - middle).cross(force).dot(&axis)).sum();
            vec![Box::new(move |x, _| axis.cross(&(x - middle)) / torque)]
        }
    })
}

/// Tractions along a field and as large as it is, scaled so that their sizes come to 1 N.
fn along_field(mesh: &TetMesh, faces: &[Vec<u32>], field: DirectionField) -> Result<Traction, String> {
    let wrong = RefCell::new(None);
    let sizes = traction(mesh, faces, &|x, _| match field.at(x) {
        Ok(vector) => V3::x() * vector.norm(),
        Err(message) => {
            wrong.borrow_mut().get_or_insert(message);
            V3::zeros()
        }
    });
    let size: f64 = sizes.iter().map(|force| force.x).sum();
    if let Some(message) = wrong.into_inner() {
        return Err(message);
    }
    if size <= f64::MIN_POSITIVE {
        return Err("the direction field is zero on all its faces".to_owned());
    }
    Ok(Box::new(move |x, _| field.at(x).map_or_else(|_| V3::zeros(), |vector| vector / size)))
}
