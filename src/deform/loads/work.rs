//! Energy and virtual work of loads and forces at points, for the control elements.
//!
//! In: all forces of one state, in the frame of the columns. Out: their part of the potential energy, and its slopes by the poses
//! of the control elements.

use super::applied::{PointLoad, Pull};
use super::points::Point;
use crate::deform::frames::{PoseSlope, axial};
use crate::deform::pose::ControlPose;
use crate::green::{FIELDS, LoadMeta, Turning};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

type V3 = Vector3<f64>;

/// All forces of one state, in the frame of the columns.
pub struct Exerted {
    pub rotation: Rotation3<f64>,
    pub shift: V3,
    pub c: DVector<f64>,
    pub lambda: DVector<f64>,
    pub points: Vec<Point>,
    pub forces: Vec<V3>,
}

/// The tables of a body's loads.
pub struct LoadWork {
    pub metas: Vec<LoadMeta>,
    pub origins: Vec<V3>,
    /// Whether the columns' frame turns with the control elements.
    pub turns: bool,
    pub reaction: DMatrix<f64>,
    pub compliance: DMatrix<f64>,
    pub moments: DMatrix<f64>,
    pub torques: DMatrix<f64>,
}

impl LoadWork {
    /// The coefficients of the loads' columns in a frame that is turned by `rotation`.
    pub fn lambda(&self, coefficients: &[f64], rotation: &Rotation3<f64>) -> DVector<f64> {
        let mut all = DVector::zeros(self.reaction.ncols());
        let mut at = 0;
        for meta in &self.metas {
            let own = |i: usize| coefficients.get(at + i).copied().unwrap_or(0.0);
            match (meta.turning, meta.columns) {
                (Turning::Fixed, 3) => {
                    let turned = rotation.inverse() * V3::new(own(0), own(1), own(2));
                    all.rows_mut(at, 3).copy_from(&turned);
                }
                _ => (0..meta.columns).for_each(|i| all[at + i] = own(i)),
            }
            at += meta.columns;
        }
        all
    }

    /// The loads' part of the energy, and the forces' virtual work, which is taken from the slopes.
    pub fn act(
        &self,
        exerted: &Exerted,
        (pulls, ends): (&[PointLoad], &[V3]),
        poses: &[ControlPose],
        slopes: &mut [PoseSlope],
    ) -> f64 {
        let Exerted { rotation, shift, c, lambda, points, forces } = exerted;
        // The loads' resultant and moment about the centre; work by c.
        let (mut net, mut moments) = (V3::zeros(), Matrix3::zeros());
        let (mut torque, mut at) = (V3::zeros(), 0);
        for meta in &self.metas {
            for k in at..at + meta.columns {
                let own = self.moments.column(k);
                net += own.fixed_rows::<3>(0) * lambda[k];
                moments += Matrix3::from_row_slice(own.rows(3, 9).into_owned().as_slice()) * lambda[k];
                let by = self.torques.column(k);
                for (column, factor) in c.iter().chain(lambda.iter()).enumerate() {
                    torque += by.fixed_rows::<3>(3 * column) * (factor * lambda[k]);
                }
            }
            if meta.turning == Turning::Fixed && meta.columns == 3 {
                // Σ u × f of what point forces move, by reciprocity.
                let moved = |i: usize| -> f64 {
                    let by = points.iter().zip(forces);
                    by.map(|(point, force)| point.loads.fixed_view::<3, 1>(0, at + i).dot(force)).sum()
                };
                torque += V3::new(moved(0), moved(1), moved(2)).cross(&lambda.fixed_rows::<3>(at));
            }
            at += meta.columns;
        }
        torque += axial(&moments);
        let mut work = &self.reaction * lambda;
        let rigid =
            moments.trace() + (rotation * net).dot(shift) - rotation.matrix().dot(&moments.transpose());
        let compliant = &self.compliance * lambda;
        let mut energy = -work.dot(c) - 0.5 * lambda.dot(&compliant) - rigid;
        for (((point, force), end), pull) in points.iter().zip(forces).zip(ends).zip(pulls) {
            net += force;
            torque += end.cross(force);
            work += point.affine.tr_mul(force);
            // In the body; what points and other loads do with each other cancels against the loads' work.
            energy += 0.5 * force.dot(&(end - point.now));
            match pull.pull {
                Pull::Force(in_body) => {
                    energy -= in_body.dot(&(rotation * end + shift - point.rest));
                }
                Pull::Towards { spring, .. } => {
                    energy += spring.map_or(0.0, |spring| 0.5 * force.norm_squared() / spring);
                }
            }
        }
        self.take_work(exerted, poses, (net, torque, &work), slopes);
        energy
    }

    /// Takes the virtual work R F·δt + τ·w + h·δc, with δR = R \[w\], from the slopes by the poses.
    fn take_work(
        &self,
        exerted: &Exerted,
        poses: &[ControlPose],
        (net, torque, work): (V3, V3, &DVector<f64>),
        slopes: &mut [PoseSlope],
    ) {
        let Exerted { rotation, c, .. } = exerted;
        let matrix = rotation.matrix();
        let (mut rest, mut about) = (net, torque);
        for (e, slope) in slopes.iter_mut().enumerate() {
            let h = work.rows(FIELDS * e, FIELDS);
            let (force, moment) = (V3::new(h[0], h[1], h[2]), Matrix3::from_row_slice(&h.as_slice()[3..]));
            slope.translation -= matrix * force;
            slope.matrix -= matrix * moment;
            let own = c.rows(FIELDS * e, FIELDS);
            let place = self.origins[e] + V3::new(own[0], own[1], own[2]);
            let seen = Matrix3::from_row_slice(&own.as_slice()[3..]) + Matrix3::identity();
            rest -= force;
            about -= place.cross(&force) + axial(&(moment * seen.transpose()));
        }
        if !self.turns {
            return;
        }
        // t̄ = Σ (o + T - R̄ o)/E and R̄ = polar(A) of [`super::rotation`].
        let count = self.origins.len().max(1) as f64;
        let middle = self.origins.iter().sum::<V3>() / count;
        about -= middle.cross(&rest);
        let moved: Vec<V3> =
            self.origins.iter().zip(poses).map(|(origin, pose)| origin + pose.translation).collect();
        let moved_middle = moved.iter().sum::<V3>() / count;
        let square = self.origins.iter().map(|origin| (origin - middle).norm_squared()).sum::<f64>() / count;
        let mut a = poses.iter().map(|pose| pose.matrix).sum::<Matrix3<f64>>() / count;
        if square > 0.0 {
            for (origin, moved) in self.origins.iter().zip(&moved) {
                a += (moved - moved_middle) * (origin - middle).transpose() / (square * count);
            }
        }
        let stretch = matrix.transpose() * a;
        let stretch = (stretch + stretch.transpose()) * 0.5;
        let Some(inverse) = (Matrix3::from_diagonal_element(stretch.trace()) - stretch).try_inverse() else {
            return;
        };
        let spin = matrix * (inverse * about).cross_matrix() / count;
        for (slope, origin) in slopes.iter_mut().zip(&self.origins) {
            slope.translation -= matrix * rest / count;
            slope.matrix -= spin;
            if square > 0.0 {
                slope.translation -= spin * (origin - middle) / square;
            }
        }
    }
}
