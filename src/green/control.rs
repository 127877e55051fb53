//! Control elements: sets of nodes that move affinely, and the rank of what they can prescribe.

use crate::fem::NodeFields;
use crate::mesh::{TetMesh, quality};
use nalgebra::{DMatrix, Vector3};

/// Affine fields of one control element.
pub const FIELDS: usize = 12;

/// The twelve coefficients in their order: T, then M - I row by row.
pub const FIELD_NAMES: [&str; FIELDS] =
    ["tx", "ty", "tz", "m11", "m12", "m13", "m21", "m22", "m23", "m31", "m32", "m33"];

/// Offsets from the origin below this part of the body's size are rounding, and count as zero.
const RANK_TOLERANCE: f64 = 1e-9;

/// A control element: x ↦ o + T + M (x - o) on its nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlElement {
    pub name: String,
    /// Ascending mesh nodes.
    pub nodes: Vec<u32>,
    /// o: the centroid of the nodes, m.
    pub origin: Vector3<f64>,
    /// Dimension spanned by the nodes about the origin: 0 a point, 1 a line, 2 a plane, 3 a volume.
    pub rank: usize,
    /// Fields that prescribe nothing, because no node is off the origin along their axis.
    pub vanishing: [bool; FIELDS],
}

impl ControlElement {
    /// `body_size`: the length against which an offset counts as rounding, m.
    pub fn new(name: &str, nodes: Vec<u32>, mesh: &TetMesh, body_size: f64) -> ControlElement {
        let origin = quality::centroid(mesh, &nodes).unwrap_or_default();
        let offsets: Vec<Vector3<f64>> =
            nodes.iter().map(|&node| mesh.nodes[node as usize] - origin).collect();
        let tolerance = RANK_TOLERANCE * body_size;
        let is_flat = |axis: usize| offsets.iter().all(|offset| offset[axis].abs() <= tolerance);
        // Field 3 + 3 i + j prescribes the displacement e_i (x - o)_j.
        let vanishing = std::array::from_fn(|field| field >= 3 && is_flat(field % 3));
        ControlElement { name: name.to_owned(), nodes, origin, rank: rank(&offsets, tolerance), vanishing }
    }

    /// Independent fields: 3 translations and 3 for each dimension spanned.
    pub fn independent_fields(&self) -> usize {
        3 + 3 * self.rank
    }

    /// Notice to the user about a control element that does not span a volume.
    pub fn notice(&self) -> Option<String> {
        let shape = match self.rank {
            0 => "a single point",
            1 => "collinear",
            2 => "planar",
            _ => return None,
        };
        let zero: Vec<&str> =
            FIELD_NAMES.iter().zip(self.vanishing).filter(|(_, zero)| *zero).map(|(name, _)| *name).collect();
        let zero = if zero.is_empty() { String::new() } else { format!("; {} are zero", zero.join(", ")) };
        Some(format!("{shape}: {} of {FIELDS} fields are independent{zero}", self.independent_fields()))
    }

    /// Writes the unit affine displacement of every field that does not vanish into columns `first..first + 12` of
    /// `fields` over all mesh nodes.
    pub fn prescribe(&self, all: &[Vector3<f64>], first: usize, fields: &mut NodeFields) {
        for &node in &self.nodes {
            let offset = all[node as usize] - self.origin;
            for axis in 0..3 {
                let row = fields.row_mut(3 * node as usize + axis);
                row[first + axis] = 1.0;
                for j in 0..3 {
                    let field = 3 + 3 * axis + j;
                    row[first + field] = if self.vanishing[field] { 0.0 } else { offset[j] };
                }
            }
        }
    }
}

/// Number of singular values of the offsets above `tolerance`·√n.
pub fn rank(offsets: &[Vector3<f64>], tolerance: f64) -> usize {
    if offsets.is_empty() {
        return 0;
    }
    let matrix = DMatrix::from_fn(offsets.len(), 3, |row, column| offsets[row][column]);
    let limit = tolerance * (offsets.len() as f64).sqrt();
    matrix.singular_values().iter().filter(|value| **value > limit).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(points: impl IntoIterator<Item = [f64; 3]>) -> TetMesh {
        TetMesh { nodes: points.into_iter().map(Vector3::from).collect(), ..Default::default() }
    }

    fn element(points: &[[f64; 3]]) -> ControlElement {
        ControlElement::new("c", (0..points.len() as u32).collect(), &cloud(points.iter().copied()), 1.0)
    }

    #[test]
    fn rank_and_vanishing_fields_of_points_lines_planes_and_volumes() {
        let point = element(&[[5.0, 6.0, 7.0]]);
        assert_eq!((point.rank, point.vanishing.iter().filter(|v| **v).count()), (0, 9));

        let line = element(&[[0.0; 3], [0.0, 0.0, 0.3], [0.0, 0.0, 1.0]]);
        assert_eq!((line.rank, line.vanishing.iter().filter(|v| **v).count()), (1, 6));

        let plane = element(&[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]]);
        assert_eq!(plane.rank, 2);
        let zero: Vec<&str> = (0..12).filter(|&k| plane.vanishing[k]).map(|k| FIELD_NAMES[k]).collect();
        assert_eq!(zero, ["m11", "m21", "m31"]);

        let oblique = element(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!((oblique.rank, oblique.vanishing), (2, [false; 12]));

        let volume = element(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!((volume.rank, volume.notice()), (3, None));
    }

    #[test]
    fn rank_does_not_depend_on_unit_or_place() {
        for scale in [1e-9, 1.0, 1e6] {
            let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1e-3]];
            let all = cloud(points.map(|[x, y, z]| [(x + 1e4) * scale, y * scale, z * scale]));
            assert_eq!(ControlElement::new("c", vec![0, 1, 2, 3], &all, scale).rank, 3, "scale {scale}");
            assert_eq!(ControlElement::new("c", vec![0, 1, 2], &all, scale).rank, 2, "scale {scale}");
        }
    }

    #[test]
    fn prescribed_fields_are_the_affine_motion() {
        let all = cloud([[0.0, 1.0, 2.0], [3.0, 5.0, 4.0]]);
        let element = ControlElement::new("c", vec![0, 1], &all, 1.0);
        let mut fields = NodeFields::zeros(2, 12);
        element.prescribe(&all.nodes, 0, &mut fields);
        let c = [0.1, -0.2, 0.3, 0.01, 0.02, 0.03, -0.04, 0.05, 0.06, 0.07, 0.08, -0.09];
        for (node, x) in all.nodes.iter().enumerate() {
            let offset = x - element.origin;
            for axis in 0..3 {
                let sum: f64 = fields.row(3 * node + axis).iter().zip(c).map(|(f, c)| f * c).sum();
                let affine = c[axis] + (0..3).map(|j| c[3 + 3 * axis + j] * offset[j]).sum::<f64>();
                assert!((sum - affine).abs() < 1e-15);
            }
        }
    }
}
