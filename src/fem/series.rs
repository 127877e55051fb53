//! Power series of equilibria under the St. Venant–Kirchhoff law: the loads that drive each order.
//!
//! In: the fields u_1 … u_{k-1} of u(a) = Σ a^k u_k, one column for each of several paths. Out: the right-hand side for u_k,
//!
//! ```text
//! K u_k = -Σ vol (C:½ Σ_{i+j=k} H_iᵀH_j + Σ_{i+j=k} H_i S_j) G_a      S_j = C:(sym H_j + ½ Σ_{p+q=j} H_pᵀH_q)
//! ```
//!
//! (The asymptotic numerical method: B. Cochelin, N. Damil, M. Potier-Ferry, Int. J. Numer. Meth. Engng. 37, 1994,
//! 1187-1213.)

use super::rest_points::{RestPoint, RestPoints};
use super::stiffness::NodeFields;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Points whose stresses are computed at a time.
const BLOCK: usize = 256;

impl RestPoints {
    /// The loads of order k = `orders.len()` + 1 over all nodes, N, from the orders before it, each over all nodes with a
    /// column for every path.
    pub fn series_loads(&self, orders: &[NodeFields]) -> NodeFields {
        let paths = orders.first().map_or(0, |first| first.columns);
        let mut loads = NodeFields::zeros(self.nodes, paths);
        for first in (0..self.count()).step_by(BLOCK) {
            let block = first..self.count().min(first + BLOCK);
            let stresses = block.clone().into_par_iter().map(|q| series_stresses(&self.at(q), orders, paths));
            let stresses: Vec<Vec<Matrix3<f64>>> = stresses.collect();
            for (point, stresses) in block.map(|q| self.at(q)).zip(&stresses) {
                for (&node, gradient) in point.nodes.iter().zip(point.gradients) {
                    for axis in 0..3 {
                        let row = loads.row_mut(3 * node as usize + axis);
                        for (load, stress) in row.iter_mut().zip(stresses) {
                            *load -= stress.row(axis).dot(&gradient.transpose());
                        }
                    }
                }
            }
        }
        loads
    }
}

/// vol (C:½ Σ H_iᵀH_j + Σ H_i S_j) of every path, i + j one more than there are orders.
fn series_stresses(point: &RestPoint<'_>, orders: &[NodeFields], paths: usize) -> Vec<Matrix3<f64>> {
    let mut h = vec![Vec::new(); orders.len()];
    for (h, fields) in h.iter_mut().zip(orders) {
        point.gradients_of(fields, h);
    }
    let mut second = Vec::with_capacity(orders.len());
    (0..paths)
        .map(|path| {
            // ½ Σ H_pᵀH_q over p + q = order, from 1.
            let products = |order: usize| -> Matrix3<f64> {
                (1..order).map(|p| h[p - 1][path].transpose() * h[order - p - 1][path] * 0.5).sum()
            };
            second.clear();
            for order in 1..=orders.len() {
                let own = &h[order - 1][path];
                second.push(point.stress(&((own + own.transpose()) * 0.5 + products(order))));
            }
            let k = orders.len() + 1;
            let first = point.stress(&products(k));
            let turned: Matrix3<f64> = (1..k).map(|i| h[i - 1][path] * second[k - i - 1]).sum();
            (first + turned) * point.volume
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Hyperelastic, Lame, STVK, TET4};
    use crate::mesh::{Block, block};
    use nalgebra::DMatrix;

    /// The forces along u(a) = Σ a^k u_k are a polynomial in a; its coefficient k without K u_k is minus the load.
    #[test]
    fn loads_are_the_coefficients_of_the_forces() {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [2, 1, 2] }).unwrap();
        let lame = vec![Lame::from_young_poisson(2.0, 0.3); mesh.tets.len()];
        let points = RestPoints::new(&TET4, &mesh, &lame).unwrap();
        let body = Hyperelastic::new(&TET4, &STVK, &mesh, &lame).unwrap();
        let nodes = mesh.nodes.len();
        let orders: Vec<NodeFields> = (0..3)
            .map(|k| {
                let mut field = NodeFields::zeros(nodes, 1);
                let number = |i: usize| (1.7 * i as f64 + 2.1 * k as f64).sin();
                field.data.iter_mut().enumerate().for_each(|(i, u)| *u = number(i));
                field
            })
            .collect();
        // Degree 9: ten places.
        let places: Vec<f64> = (0..10).map(|i| (0.3 * f64::from(i) + 0.1).cos()).collect();
        let forces = DMatrix::from_fn(10, 3 * nodes, |_, _| 0.0);
        let forces = places.iter().enumerate().fold(forces, |mut forces, (row, a)| {
            let mut u = NodeFields::zeros(nodes, 1);
            for (k, order) in orders.iter().enumerate() {
                u.data.iter_mut().zip(&order.data).for_each(|(u, own)| *u += a.powi(k as i32 + 1) * own);
            }
            forces.row_mut(row).copy_from_slice(&body.forces(&body.gradients(&u)).data);
            forces
        });
        let powers = DMatrix::from_fn(10, 10, |row, k| places[row].powi(k as i32));
        let coefficients = powers.lu().solve(&forces).unwrap();
        let k = TET4.assemble(&mesh, &lame).unwrap();
        for order in 2..=3 {
            let loads = points.series_loads(&orders[..order - 1]);
            let mut linear = NodeFields::zeros(nodes, 1);
            k.multiply(&orders[order - 1], &mut linear);
            let size = coefficients.row(order).amax();
            for (i, load) in loads.data.iter().enumerate() {
                let expected = linear.data[i] - coefficients[(order, i)];
                assert!((load - expected).abs() < 1e-7 * size, "order {order}, {i}: {load} {expected}");
            }
        }
    }
}
