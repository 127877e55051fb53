//! The tractions of a pattern of 1 N, 1 N·m or 1 Pa: forces for each area of some faces of a body.
//!
//! In: a pattern of a scene, and the body's mesh. Out: for each of the pattern's columns the traction at a place of a face whose
//! outward unit normal is known, as consistent nodal forces or at the triangles of the surface.

use crate::fem::{Area, FacePoint, traction};
use crate::mesh::{Surface, TetMesh, outer_faces};
use crate::scene::{DirectionField, Load, LoadKind, Scene};
use nalgebra::Vector3;
use std::cell::RefCell;
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Traction at a point of a face, N/m² for 1 of the pattern's unit.
type Traction = Box<dyn Fn(&FacePoint) -> V3>;

/// A field's vector at a point of a face, or why there is none.
type VectorAt = Box<dyn Fn(&FacePoint) -> Result<V3, String>>;

/// The faces on which a pattern acts, and what it does there.
pub struct Tractions {
    /// Their numbers among [`outer_faces`], and their nodes.
    numbers: Vec<usize>,
    faces: Vec<Vec<u32>>,
    columns: Vec<Traction>,
}

impl Tractions {
    /// The error says why the pattern cannot act.
    pub fn new(scene: &Scene, mesh: &TetMesh, pattern: &Load) -> Result<Tractions, String> {
        let chosen = pattern.nodes.select(mesh)?;
        let is_chosen = |node: &u32| chosen.binary_search(node).is_ok();
        let outer = outer_faces(mesh).into_iter().enumerate();
        let (numbers, faces): (Vec<usize>, Vec<Vec<u32>>) =
            outer.filter(|(_, face)| face.iter().all(is_chosen)).unzip();
        if faces.is_empty() {
            return Err(format!(
                "no face of the surface lies among the {} selected nodes, and a pattern acts on faces. Select \
                 more, or use surface_compliance",
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

    /// Tractions at the middle of every triangle of `surface`, that of `mesh`, for each column; zero beside the faces.
    pub fn at_triangles(&self, mesh: &TetMesh, surface: &Surface) -> Vec<Vec<V3>> {
        let of_face = if mesh.mids.is_empty() { 1 } else { 4 };
        let triangles = || self.numbers.iter().flat_map(|face| of_face * face..of_face * (face + 1));
        let mut all = vec![vec![V3::zeros(); surface.triangles.len()]; self.columns.len()];
        for triangle in triangles().filter(|&triangle| triangle < surface.triangles.len()) {
            let nodes = surface.triangles[triangle].map(|corner| surface.nodes[corner as usize]);
            let [a, b, c] = nodes.map(|node| mesh.nodes[node as usize]);
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else { continue };
            let middle =
                FacePoint { place: (a + b + c) / 3.0, normal, nodes: &nodes, shapes: &[1.0 / 3.0; 3] };
            for (all, column) in all.iter_mut().zip(&self.columns) {
                all[triangle] = column(&middle);
            }
        }
        all
    }
}

fn of_kind(mesh: &TetMesh, faces: &[Vec<u32>], pattern: &Load) -> Result<Vec<Traction>, String> {
    let area = Area::new(mesh, faces);
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
        Box::new(move |_| each)
    };
    Ok(match pattern.kind {
        LoadKind::Stretch | LoadKind::Direction => vec![spread(axis)],
        LoadKind::Shift => (0..3).map(|along| spread(V3::ith(along, 1.0))).collect(),
        LoadKind::Pressure => vec![Box::new(|at| -at.normal)],
        LoadKind::Twist => {
            let middle = area.middle;
            let around = traction(mesh, faces, &|at| axis.cross(&(at.place - middle)));
            let arms = around.iter().zip(&mesh.nodes);
            let torque: f64 = arms.map(|(force, x)| (x - middle).cross(force).dot(&axis)).sum();
            vec![Box::new(move |at| axis.cross(&(at.place - middle)) / torque)]
        }
    })
}

/// Tractions along a field and as large as it is, scaled so that their sizes come to 1 N.
fn along_field(mesh: &TetMesh, faces: &[Vec<u32>], field: DirectionField) -> Result<Traction, String> {
    let vector_at = vectors(mesh, faces, field);
    let wrong = RefCell::new(None);
    let sizes = traction(mesh, faces, &|at| match vector_at(at) {
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
    Ok(Box::new(move |at| vector_at(at).map_or_else(|_| V3::zeros(), |vector| vector / size)))
}

/// The vector of a field at a point of a face: by the elements' own functions where the field has one at every corner of the
/// faces, else by the places nearest to the point.
fn vectors(mesh: &TetMesh, faces: &[Vec<u32>], field: DirectionField) -> VectorAt {
    let Some(known) = at_nodes(mesh, faces, &field) else {
        return Box::new(move |at| field.at(&at.place));
    };
    Box::new(move |at| Ok(at.nodes.iter().zip(at.shapes).map(|(node, shape)| known[node] * *shape).sum()))
}

/// The vectors at the nodes of the faces; a node between two corners that the field does not give takes their mean. `None` where
/// the field lacks one of a corner.
fn at_nodes(mesh: &TetMesh, faces: &[Vec<u32>], field: &DirectionField) -> Option<BTreeMap<u32, V3>> {
    let own = |node: u32| field.just_at(&mesh.nodes[node as usize]);
    let mut known = BTreeMap::new();
    for face in faces {
        for &corner in &face[..3] {
            known.insert(corner, own(corner)?);
        }
        for (between, &node) in face[3..].iter().enumerate() {
            let ends = [between, (between + 1) % 3].map(|end| known[&face[end]]);
            known.insert(node, own(node).unwrap_or((ends[0] + ends[1]) / 2.0));
        }
    }
    Some(known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block, quadratic};
    use crate::scene::DirectionFile;

    /// Vectors that are linear in the place, at the corners alone: the nodal forces are those of the linear traction itself.
    #[test]
    fn vectors_at_nodes_are_interpolated_by_the_elements_functions() {
        let linear = block(&Block { size: [1.0, 2.0, 0.5], cells: [2, 3, 2] }).unwrap();
        let exact = |x: &V3| V3::new(0.3 + x.y, 2.0 * x.z - x.x, x.x + 0.5 * x.y);
        let rows = linear.nodes.iter().zip(&linear.tags).map(|(x, tag)| {
            let v = exact(x);
            format!("{tag}, {:?}, {:?}, {:?}\n", v.x, v.y, v.z)
        });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wind.csv");
        std::fs::write(&path, rows.collect::<String>()).unwrap();
        let curved = quadratic::quadratic(linear.clone(), &quadratic::straight);
        for mesh in [linear, curved] {
            let field = DirectionFile { file: path.clone(), array: None }.load(&path, &mesh).unwrap();
            let faces = outer_faces(&mesh);
            let size: f64 =
                traction(&mesh, &faces, &|at| V3::x() * exact(&at.place).norm()).iter().map(|f| f.x).sum();
            let found = traction(&mesh, &faces, &along_field(&mesh, &faces, field).unwrap());
            let wanted = traction(&mesh, &faces, &|at| exact(&at.place) / size);
            let worst = found.iter().zip(&wanted).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-15, "{worst:e} N of 1 N");
        }
    }
}
