//! One part of a body, cut out with some of what surrounds it: its Green's functions and strain energy in the screws
//! between its ends.
//!
//! In: tetrahedra, and the ends that hold them, each an interface to another part or a control element. Out: displacements
//! u = Σ y_k u_k + ½ Σ y_i y_j w_ij in the coordinates y, seen from the frame midway between the ends, and the energy's terms
//! to fourth order, with the products p_ij of the y (half of a square) and E_ij = sym ∇w_ij + sym H_iᵀ H_j:
//!
//! ```text
//! V = ½ yᵀ S y + yᵀ Z p + pᵀ Q p      S_kl = ∫ ε_k : C : ε_l      Z_k,ij = ∫ σ_k : E_ij
//! Q_ij,kl = ∫ ½ E_ij : C : E_kl + (H_i σ_j + H_j σ_i) : ∇w_kl + Σ_ends f₁ · u₃, made symmetric
//! K w_ij = -∫ Gᵀ [C : sym H_iᵀH_j + H_i σ_j + H_j σ_i]
//! ```
//!
//! ε_k, σ_k and H_k are those of u_k. On the ends y is a screw motion, so that u has parts of second and third order there
//! ([`FrameSeries`], `Domain::end_work`). Up to third order V is the St. Venant-Kirchhoff energy whatever w_ij is
//! (2n + 1 theorem); to fourth, with these w_ij, but for what neighbours' interfaces do against each other.
//!
//! An interface is not held itself: the frame of each is fitted to its nodes, while the far boundary of what surrounds the
//! part moves rigidly (oversampling: Hou and Wu, J. Comput. Phys. 134, 1997, 169-189). By St. Venant's principle the
//! interface then warps as it does in the body; held flat, it would stiffen a tube of eight parts by a tenth.

use super::second_order::{
    FrameFit, FrameSeries, Orders, QuarticRows, StrainPoint, get, gradients, pairs, polarised, set, stress,
    sum_at, times, unit,
};
use crate::fem::{NodeFields, Partition, StiffnessMatrix};
use crate::solve::{Progress, SolveError, Solver};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// An end of a part: the nodes that hold it.
pub struct End {
    /// Nodes of the domain that the frame is fitted to, or the control element's; centroid of the interface, or the
    /// control element's origin.
    pub nodes: Vec<u32>,
    pub origin: Vector3<f64>,
    /// The nodes that are held, and the point about which they turn.
    pub held: Vec<u32>,
    pub held_origin: Vector3<f64>,
    /// A control element, which can also be stretched.
    pub is_control: bool,
}

/// The part's surroundings, in nodes of their own.
pub struct Domain<'a> {
    pub nodes: &'a [Vector3<f64>],
    pub points: &'a [StrainPoint],
    pub k: &'a StiffnessMatrix,
    pub ends: &'a [End],
}

/// Motion of an end.
struct Motion {
    turn: Vector3<f64>,
    slide: Vector3<f64>,
    stretch: Matrix3<f64>,
}

/// Solution of a part; columns are coordinates y, or pairs (i ≤ j) of them in the order of [`pairs`].
pub struct PartSolution {
    pub stiffness: DMatrix<f64>,
    /// Z, a row for each coordinate, a column for each pair.
    pub quadratic: DMatrix<f64>,
    /// Q, of pairs by pairs, of the screws' coordinates alone.
    pub quartic: DMatrix<f64>,
    /// u_k and w_ij over the domain's nodes.
    pub first: NodeFields,
    pub second: NodeFields,
}

#[derive(Debug, thiserror::Error)]
pub enum PartError {
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error(
        "the frames of its interfaces are ill-conditioned ({condition:.1e}), by too few nodes or a thin \
         sheet: ask for fewer parts"
    )]
    Fit { condition: f64 },
}

/// Coordinates of a part: ω and d of the screw from the first end to each other one, six of the stretch of each control
/// element.
pub fn coordinates(ends: usize, controls: usize) -> usize {
    6 * ends.saturating_sub(1) + 6 * controls
}

/// The symmetric matrix with s₁₁, s₂₂, s₃₃, s₁₂, s₂₃, s₃₁.
pub fn symmetric(s: &[f64]) -> Matrix3<f64> {
    Matrix3::new(s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2])
}

/// Most that the fit's equations may amplify.
const CONDITION: f64 = 1e8;

impl Domain<'_> {
    fn coordinates(&self) -> usize {
        coordinates(self.ends.len(), self.ends.iter().filter(|end| end.is_control).count())
    }

    /// Coordinates of the screws, which come first.
    fn of_screws(&self) -> usize {
        6 * self.ends.len().saturating_sub(1)
    }

    /// The pole: midway between two ends; of more, at the first.
    fn pole(&self, origin: impl Fn(&End) -> Vector3<f64>) -> Vector3<f64> {
        match self.ends {
            [a, b] => (origin(a) + origin(b)) * 0.5,
            [a, ..] => origin(a),
            [] => Vector3::zeros(),
        }
    }

    /// Turn, slide and stretch of each end at y.
    fn motions(&self, y: &[f64]) -> Vec<Motion> {
        let links = self.ends.len().saturating_sub(1);
        let mut stretches = y[6 * links..].chunks_exact(6);
        let share = |i: usize| match (self.ends.len(), i) {
            (2, 0) => (0, -0.5),
            (2, _) => (0, 0.5),
            (_, i) => (i.saturating_sub(1), if i == 0 { 0.0 } else { 1.0 }),
        };
        let end = |(i, end): (usize, &End)| {
            let (link, share) = share(i);
            let of = |from: usize| {
                y.get(from..from + 3)
                    .filter(|_| links > 0)
                    .map_or_else(Vector3::zeros, Vector3::from_column_slice)
            };
            let stretch = if end.is_control { stretches.next() } else { None };
            Motion {
                turn: of(6 * link) * share,
                slide: of(6 * link + 3) * share,
                stretch: stretch.map_or_else(Matrix3::zeros, symmetric),
            }
        };
        self.ends.iter().enumerate().map(end).collect()
    }

    /// The held frames and stretches at y.
    fn held(&self, y: &[f64]) -> Vec<(FrameSeries, Matrix3<f64>)> {
        let pole = self.pole(|end| end.held_origin);
        let of = |(end, motion): (&End, Motion)| {
            (FrameSeries::of_screw(motion.turn, motion.slide, end.held_origin - pole), motion.stretch)
        };
        self.ends.iter().zip(self.motions(y)).map(of).collect()
    }

    /// Displacements of the held nodes, of first and second order.
    fn held_nodes(&self, y: &[f64]) -> Vec<(u32, Orders)> {
        let of = |(end, (frame, stretch)): (&End, (FrameSeries, Matrix3<f64>))| {
            let node = move |&n: &u32| {
                (n, frame.displacement(&(self.nodes[n as usize] - end.held_origin), &stretch))
            };
            end.held.iter().map(node).collect::<Vec<_>>()
        };
        self.ends.iter().zip(self.held(y)).flat_map(of).collect()
    }

    /// The frames of the ends, given how the nodes are displaced.
    fn frames(&self, fits: &[Option<FrameFit>], y: &[f64], u: &dyn Fn(u32) -> Orders) -> Vec<FrameSeries> {
        let held = self.held(y);
        let fitted = |fit: &FrameFit, end: &End| {
            let moved: Vec<Orders> = end.nodes.iter().map(|&node| u(node)).collect();
            fit.fit(&moved)
        };
        let ends = self.ends.iter().zip(fits).zip(&held);
        ends.map(|((end, fit), held)| fit.as_ref().map_or(held.0, |fit| fitted(fit, end))).collect()
    }

    /// The screws between the frames, of first and second order.
    fn screws(&self, frames: &[FrameSeries]) -> [Vec<f64>; 2] {
        let mut orders = [Vec::new(), Vec::new()];
        for (end, frame) in self.ends.iter().zip(frames).skip(1) {
            let (turn, slide) = frames[0].screw_to(frame, &(end.origin - self.ends[0].origin));
            for (order, values) in orders.iter_mut().enumerate() {
                values.extend(turn[order].iter().chain(&slide[order]));
            }
        }
        orders
    }

    /// Solves the part.
    pub fn solve(&self, solver: &Solver, progress: &dyn Progress) -> Result<PartSolution, PartError> {
        let m = self.coordinates();
        let n = self.nodes.len();
        if m == 0 {
            // It hangs on one interface, which it follows as a rigid body.
            let (none, fields) = (DMatrix::zeros(0, 0), NodeFields::zeros(n, 0));
            return Ok(PartSolution {
                stiffness: none.clone(),
                quadratic: none.clone(),
                quartic: none,
                first: fields.clone(),
                second: fields,
            });
        }
        let fits: Vec<Option<FrameFit>> = self
            .ends
            .iter()
            .map(|end| {
                let offsets = end.nodes.iter().map(|&n| self.nodes[n as usize] - end.origin).collect();
                if end.is_control { None } else { FrameFit::new(offsets) }
            })
            .collect();
        let partition = Partition::new(n, self.ends.iter().flat_map(|end| end.held.iter().copied()));
        let a = partition.a(self.k);
        let linear = if partition.free.is_empty() { None } else { Some(solver.analyse(&a, progress)?) };
        let factor = linear.as_ref().map(|linear| linear.factor(&a, progress)).transpose()?;
        let equilibrium =
            |mut fields: NodeFields, load: Option<&NodeFields>| -> Result<NodeFields, SolveError> {
                let Some(factor) = &factor else { return Ok(fields) };
                let mut rhs = partition.minus_b_times(self.k, &fields);
                if let Some(load) = load {
                    let load = load.at(&partition.free);
                    rhs.data.iter_mut().zip(&load.data).for_each(|(rhs, load)| *rhs += load);
                }
                let (free, _) = factor.solve(&rhs, progress)?;
                partition.insert_free(&free, &mut fields);
                Ok(fields)
            };

        // Of first order, as the far boundary moves; then by the frames of the ends.
        let mut prescribed = NodeFields::zeros(n, m);
        for k in 0..m {
            for (node, [u, _]) in self.held_nodes(&unit(m, &[k])) {
                set(&mut prescribed, node, k, &u);
            }
        }
        let far = equilibrium(prescribed, None)?;
        let mut response = DMatrix::identity(m, m);
        for k in 0..m {
            let u = |node: u32| [get(&far, node, k), Vector3::zeros()];
            let [screws, _] = self.screws(&self.frames(&fits, &unit(m, &[k]), &u));
            screws.iter().enumerate().for_each(|(row, value)| response[(row, k)] = *value);
        }
        let scaled = response.singular_values();
        let condition = scaled.max() / scaled.min();
        let inverse = response.try_inverse().filter(|_| condition < CONDITION);
        let inverse = inverse.ok_or(PartError::Fit { condition })?;
        let first = times(&far, &inverse);

        // Of second order.
        let held_second = |y: &DVector<f64>| -> Vec<f64> {
            let far = &inverse * y;
            self.held_nodes(far.as_slice())
                .iter()
                .flat_map(|(_, [_, u])| u.iter().copied().collect::<Vec<_>>())
                .collect()
        };
        let on_held = polarised(m, held_second);
        let mut prescribed = NodeFields::zeros(n, pairs(m).len());
        for (row, (node, _)) in self.held_nodes(&vec![0.0; m]).into_iter().enumerate() {
            for axis in 0..3 {
                let values = on_held.row(3 * row + axis);
                let own = prescribed.row_mut(3 * node as usize + axis);
                own.iter_mut().zip(values.iter()).for_each(|(own, value)| *own = *value);
            }
        }
        let second = equilibrium(prescribed, Some(&self.loads(&first)))?;
        let (first, second) = self.seen(&fits, &inverse, &first, &second);
        let [stiffness, quadratic, quartic] = self.energy(&first, &second);
        Ok(PartSolution { stiffness, quadratic, quartic, first, second })
    }

    /// -∫ Gᵀ [C : sym H_iᵀH_j + H_i σ_j + H_j σ_i] for each pair.
    fn loads(&self, first: &NodeFields) -> NodeFields {
        let of_pair = pairs(first.columns);
        let mut loads = NodeFields::zeros(first.nodes, of_pair.len());
        for point in self.points {
            let h = gradients(point, first);
            let sigma: Vec<Matrix3<f64>> = h.iter().map(|h| stress(point.lame, h)).collect();
            for (column, &(i, j)) in of_pair.iter().enumerate() {
                let p = stress(point.lame, &(h[i].transpose() * h[j])) + h[i] * sigma[j] + h[j] * sigma[i];
                for (&node, gradient) in point.nodes.iter().zip(&point.gradients) {
                    let force = p * gradient * point.volume;
                    for axis in 0..3 {
                        loads.row_mut(3 * node as usize + axis)[column] -= force[axis];
                    }
                }
            }
        }
        loads
    }

    /// The fields by the screws of the ends' frames, seen from the frame midway.
    fn seen(
        &self,
        fits: &[Option<FrameFit>],
        inverse: &DMatrix<f64>,
        first: &NodeFields,
        second: &NodeFields,
    ) -> (NodeFields, NodeFields) {
        let (m, n, of_pair) = (first.columns, first.nodes, pairs(first.columns));
        let pole = self.pole(|end| end.origin);
        // By a ray y: the screws' second order, and all nodes as the frame sees them.
        let ray = |y: &DVector<f64>| -> [Vec<f64>; 2] {
            let u = |node: u32| sum_at(first, second, node, y.as_slice());
            let frames = self.frames(fits, (inverse * y).as_slice(), &u);
            let rest = |i: usize| self.ends[i].origin - self.ends[0].origin;
            let frame = match frames[..] {
                [a, b] => a.midway(&b, &rest(1)),
                [a, ..] => a,
                [] => FrameSeries::default(),
            };
            let [_, screws] = self.screws(&frames);
            let mut orders = [Vec::with_capacity(3 * n), screws];
            orders[1].resize(m, 0.0);
            for (node, place) in self.nodes.iter().enumerate() {
                let [u1, u2] = frame.seen(&(place - pole), u(node as u32));
                orders[0].extend(u1.iter());
                orders[1].extend(u2.iter());
            }
            orders
        };
        let mut seen_first = NodeFields::zeros(n, m);
        for k in 0..m {
            let [values, _] = ray(&DVector::from_vec(unit(m, &[k])));
            for (row, value) in values.into_iter().enumerate() {
                seen_first.row_mut(row)[k] = value;
            }
        }
        let orders = polarised(m, |y| {
            let [_, second] = ray(y);
            second
        });
        let mut seen_second = NodeFields::zeros(n, of_pair.len());
        let bend = orders.rows(0, m);
        for row in 0..3 * n {
            let own = DVector::from_column_slice(seen_first.row(row));
            let values = orders.row(m + row) - own.transpose() * bend;
            seen_second.row_mut(row).iter_mut().zip(values.iter()).for_each(|(to, from)| *to = *from);
        }
        (seen_first, seen_second)
    }

    /// Σ f₁ · u₃ over the nodes of the ends, of pairs by pairs: the work of the forces of first order on the displacements of
    /// third order that the turns of the ends make.
    ///
    /// A node at y from the origin o of an end, which is warped by a, moves by exp ω̂ (y + a) + V(ω)(o + d) - …, in which
    /// third order is ω × q with q = ω × d/6 + ω̂² o/24 + ω̂² y/6 + ω × a₁/2 + a₂; and f · (ω × q) = (f × ω) · q.
    fn end_work(&self, first: &NodeFields, second: &NodeFields) -> DMatrix<f64> {
        let (m, of_pair) = (self.of_screws(), pairs(self.of_screws()));
        let mut sum = DMatrix::zeros(of_pair.len(), of_pair.len());
        // Of a part with one end alone no end turns against another.
        if of_pair.is_empty() {
            return sum;
        }
        let forces = self.forces(first);
        let pole = self.pole(|end| end.origin);
        let turns: Vec<Vec<Motion>> = (0..m).map(|k| self.motions(&unit(first.columns, &[k]))).collect();
        for (i, end) in self.ends.iter().enumerate() {
            let place = end.origin - pole;
            let mut left = DMatrix::zeros(3 * end.nodes.len(), of_pair.len());
            for (row, &node) in end.nodes.iter().enumerate() {
                for (pair, &(k, l)) in of_pair.iter().enumerate() {
                    let of = |k: usize, l: usize| get(&forces, node, k).cross(&turns[l][i].turn);
                    left.fixed_view_mut::<3, 1>(3 * row, pair).copy_from(&(of(k, l) + of(l, k)));
                }
            }
            let right = polarised(m, |y| {
                let y = y.clone().resize_vertically(first.columns, 0.0);
                let motion = &self.motions(y.as_slice())[i];
                let frame = FrameSeries::of_screw(motion.turn, motion.slide, place);
                let w = motion.turn;
                let shift = w.cross(&motion.slide) / 6.0 + w.cross(&w.cross(&place)) / 24.0;
                let q = |&node: &u32| {
                    let offset = self.nodes[node as usize] - end.origin;
                    let [u1, u2] = sum_at(first, second, node, y.as_slice());
                    let [r1, r2] = frame.displacement(&offset, &Matrix3::zeros());
                    let a1 = u1 - r1;
                    let a2 = u2 - r2 - w.cross(&a1);
                    shift + w.cross(&(w.cross(&offset) / 6.0 + a1 * 0.5)) + a2
                };
                end.nodes.iter().flat_map(|node| q(node).iter().copied().collect::<Vec<_>>()).collect()
            });
            sum.gemm_tr(1.0, &left, &right, 1.0);
        }
        sum
    }

    /// The forces of first order of the part's own elements on their nodes.
    fn forces(&self, first: &NodeFields) -> NodeFields {
        let mut forces = NodeFields::zeros(first.nodes, first.columns);
        for point in self.points.iter().filter(|point| point.is_own) {
            for (k, h) in gradients(point, first).iter().enumerate() {
                let sigma = stress(point.lame, h) * point.volume;
                for (&node, gradient) in point.nodes.iter().zip(&point.gradients) {
                    let force = sigma * gradient;
                    for axis in 0..3 {
                        forces.row_mut(3 * node as usize + axis)[k] += force[axis];
                    }
                }
            }
        }
        forces
    }

    /// S, Z and Q over the part's own points.
    fn energy(&self, first: &NodeFields, second: &NodeFields) -> [DMatrix<f64>; 3] {
        let (m, of_pair) = (first.columns, pairs(first.columns));
        let mut stiffness = DMatrix::zeros(m, m);
        let mut quadratic = DMatrix::zeros(m, of_pair.len());
        let screw_pairs = pairs(self.of_screws()).len();
        let mut quartic = DMatrix::zeros(screw_pairs, screw_pairs);
        let mut rows = QuarticRows::new(screw_pairs);
        for point in self.points.iter().filter(|point| point.is_own) {
            let (h, w) = (gradients(point, first), gradients(point, second));
            let sigma: Vec<Matrix3<f64>> = h.iter().map(|h| stress(point.lame, h) * point.volume).collect();
            for (k, sigma) in sigma.iter().enumerate() {
                h.iter().enumerate().for_each(|(l, other)| stiffness[(k, l)] += sigma.dot(other));
            }
            let mut screw_pair = 0;
            for (pair, (&(i, j), w)) in of_pair.iter().zip(&w).enumerate() {
                let strain = w + h[i].transpose() * h[j];
                sigma.iter().enumerate().for_each(|(k, sigma)| quadratic[(k, pair)] += sigma.dot(&strain));
                if j < self.of_screws() {
                    let turned = h[i] * sigma[j] + h[j] * sigma[i];
                    let stress = stress(point.lame, &strain) * (0.5 * point.volume);
                    rows.set(screw_pair, &stress, &strain, &turned, w);
                    screw_pair += 1;
                }
            }
            rows.add_to(&mut quartic);
        }
        quartic += self.end_work(first, second);
        quartic = (&quartic + quartic.transpose()) * 0.5;
        [stiffness, quadratic, quartic]
    }
}
