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

use super::fields::NodeFields;
use super::rest_points::{RestPoint, RestPoints};
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
        for block in self.points.chunks(BLOCK) {
            let stresses: Vec<Vec<Matrix3<f64>>> =
                block.par_iter().map(|point| series_stresses(point, orders, paths)).collect();
            for (point, stresses) in block.iter().zip(&stresses) {
                for (&node, gradient) in point.nodes.iter().zip(&point.gradients) {
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
fn series_stresses(point: &RestPoint, orders: &[NodeFields], paths: usize) -> Vec<Matrix3<f64>> {
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
