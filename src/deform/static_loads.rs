//! Loads on a body that is solved anew: forces on its nodes that keep their directions while a pose is solved, and warmth.
//!
//! In: the loads of a scene's body on its mesh, and what they come to. Out: forces over all nodes in a pose, N, along the body's
//! axes, and by how much warmth lengthens what is free. Loads that follow the body turn with the mean turn of its control
//! elements ([`mean_rotation`]), as they do in the model `rotation`; pressure is that on the area at rest.

use super::model::ControlRest;
use super::pose::ControlPose;
use super::rotation::mean_rotation;
use super::static_forces::StaticForces;
use crate::fem::NodeFields;
use crate::green::{self, GreenError, LoadMeta, Turning};
use crate::mesh::TetMesh;
use crate::scene::Scene;
use nalgebra::{DMatrix, Rotation3, UnitQuaternion, Vector3};

type V3 = Vector3<f64>;

/// The columns of a body's loads over all nodes of its mesh.
#[derive(Clone)]
pub(super) struct NodalLoads(Vec<Column>);

#[derive(Clone)]
struct Column {
    turning: Turning,
    /// Empty of warmth.
    force: Vec<V3>,
}

impl NodalLoads {
    pub fn new(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<NodalLoads, GreenError> {
        let mut columns = Vec::new();
        for load in scene.body[name].loads() {
            let turning = LoadMeta::of(&load).turning;
            match turning {
                Turning::Inner => columns.push(Column { turning, force: Vec::new() }),
                Turning::Fixed | Turning::Follows => {
                    let forces = green::nodal_forces(scene, name, mesh, &load)?;
                    columns.extend(forces.into_iter().map(|force| Column { turning, force }));
                }
            }
        }
        Ok(NodalLoads(columns))
    }

    /// Loads from the table of a file: the forces of each column over all nodes, x, y and z of one after another.
    pub fn of_table(metas: &[LoadMeta], forces: &DMatrix<f64>) -> NodalLoads {
        let turnings = metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns));
        let column = |(turning, forces): (Turning, &[f64])| Column {
            turning,
            force: forces.chunks_exact(3).map(V3::from_column_slice).collect(),
        };
        let rows = forces.nrows().max(1);
        NodalLoads(turnings.zip(forces.as_slice().chunks_exact(rows)).map(column).collect())
    }

    /// Factor by which warmth lengthens the body where it is free.
    pub fn stretch(&self, of: &StaticForces) -> f64 {
        let all = self.0.iter().zip(&of.coefficients);
        1.0 + all.filter(|(column, _)| column.turning == Turning::Inner).map(|(_, c)| c).sum::<f64>()
    }

    /// All forces in poses to which control elements have turned so.
    pub fn forces(
        &self,
        of: &StaticForces,
        nodes: usize,
        controls: &[ControlRest],
        poses: &[ControlPose],
        turns: &[UnitQuaternion<f64>],
    ) -> NodeFields {
        let follows = |column: &Column| column.turning == Turning::Follows;
        let mean = self.0.iter().any(follows).then(|| mean_rotation(controls, poses, turns)).flatten();
        let mean = mean.unwrap_or_else(Rotation3::identity);
        let mut all = NodeFields::zeros(nodes, 1);
        let mut add = |node: usize, force: V3| {
            all.data[3 * node..][..3].iter_mut().zip(force.iter()).for_each(|(all, own)| *all += own);
        };
        for (column, c) in self.0.iter().zip(&of.coefficients).filter(|(_, c)| **c != 0.0) {
            for (node, force) in column.force.iter().enumerate() {
                add(node, if follows(column) { mean * force * *c } else { force * *c });
            }
        }
        for (node, force) in &of.at_nodes {
            add(*node as usize, *force);
        }
        all
    }
}
