//! The linear limit of the parts, against the handle stiffness S, which is exact there.
//!
//! In: the solved parts, the control elements, S. Out: how far the forces of the assembled parts are from S at small bends and
//! twists, and parts whose chain between two control elements has the rigid motions' block of S. With F_p the compliance of
//! part p to wrenches between its ends, A_p the shift of a screw from the middle of the part to that between the control
//! elements, and F that of S:
//!
//! ```text
//! Σ A_p F_p A_pᵀ = F_c     G F_c Gᵀ = F     G = F^½ (F^½ F_c F^½)^-½ F^½     V_p(y) becomes V_p(A_p⁻¹ G⁻¹ A_p y)
//! ```
//!
//! G is the symmetric solution, which is nearest to 1 where angles are measured in half the distance of the control elements
//! (Dowson and Landau, J. Multivariate Anal. 12, 1982). A sum of parts is too stiff or too soft because each is solved as if
//! its interfaces moved like rigid ones far away; on several materials they do not.

use super::super::control::{ControlElement, FIELDS};
use super::body::{BodyError, Joint, SolvedBody, SolvedPart};
use super::part::PartSolution;
use super::second_order::pairs;
use nalgebra::{DMatrix, Matrix6, Vector3, Vector6};

/// Largest error of forces and torques at small bends and twists, in parts of the larger of the two.
const LARGEST: f64 = 0.2;

/// Part of the largest wrench below which there is no resistance.
const FREE: f64 = 1e-6;

/// Makes the small bends and twists of a chain of parts exact; refuses parts that are too far from that.
pub fn fit(
    body: &mut SolvedBody,
    controls: &[ControlElement],
    stiffness: &DMatrix<f64>,
) -> Result<(), BodyError> {
    if controls.len() < 2 {
        return Ok(());
    }
    let exact = rigid_stiffness(controls.len(), stiffness);
    let error = assembled(body, controls).map_or(f64::INFINITY, |k| largest_error(&exact, &k, controls));
    if error.is_nan() || error > LARGEST {
        return Err(BodyError::Linear { parts: body.parts.len(), percent: 100.0 * error });
    }
    if let ([first, last], Some(chain)) = (controls, chain(&body.parts)) {
        correct(body, &chain, [first.origin, last.origin], &exact);
    }
    Ok(())
}

/// The block of S by rigid motions (ω, v) of all control elements.
fn rigid_stiffness(elements: usize, stiffness: &DMatrix<f64>) -> DMatrix<f64> {
    let mut rigid = DMatrix::zeros(FIELDS * elements, 6 * elements);
    for (e, axis) in (0..elements).flat_map(|e| (0..3).map(move |axis| (e, axis))) {
        rigid[(FIELDS * e + axis, 6 * e + 3 + axis)] = 1.0;
        let turn = Vector3::ith(axis, 1.0).cross_matrix();
        for k in 0..9 {
            rigid[(FIELDS * e + 3 + k, 6 * e + axis)] = turn[(k / 3, k % 3)];
        }
    }
    rigid.transpose() * stiffness * rigid
}

/// The screw (ω, v) of a motion about x that it has about the origin.
fn shift(x: &Vector3<f64>) -> Matrix6<f64> {
    let mut shift = Matrix6::identity();
    shift.fixed_view_mut::<3, 3>(3, 0).copy_from(&x.cross_matrix());
    shift
}

/// The stiffness of the assembled parts at rest by rigid motions of the control elements; `None` where an interface is loose.
fn assembled(body: &SolvedBody, controls: &[ControlElement]) -> Option<DMatrix<f64>> {
    let (inner, outer) = (6 * body.interfaces.len(), 6 * controls.len());
    let place = |joint: &Joint| match joint {
        Joint::Interface(i) => (6 * i, body.interfaces[*i]),
        Joint::Control(e) => (inner + 6 * e, controls[*e].origin),
    };
    let mut k = DMatrix::<f64>::zeros(inner + outer, inner + outer);
    for part in &body.parts {
        let Some((first, others)) = part.ends.split_first() else { continue };
        let (base, from) = place(first);
        let m = 6 * others.len();
        let mut map = DMatrix::<f64>::zeros(m, inner + outer);
        for (link, other) in others.iter().enumerate() {
            let (end, to) = place(other);
            // The screw between two ends is that of one against the other about the point midway.
            let half = (to - from) * 0.5;
            let mut rows = map.rows_mut(6 * link, 6);
            rows.fixed_view_mut::<6, 6>(0, base).copy_from(&-shift(&-half));
            rows.fixed_view_mut::<6, 6>(0, end).copy_from(&shift(&half));
        }
        k += map.transpose() * part.solution.stiffness.view((0, 0), (m, m)) * map;
    }
    let own = k.view((inner, inner), (outer, outer)).into_owned();
    if inner == 0 {
        return Some(own);
    }
    let coupled = k.view((0, inner), (inner, outer)).into_owned();
    let held = k.view((0, 0), (inner, inner)).into_owned().cholesky()?;
    Some(own - coupled.transpose() * held.solve(&coupled))
}

/// Largest error of the wrench on a control element that turns by itself about the point midway to the others, as the end of an
/// arc does, in parts of the exact one; forces count with half the largest distance of two control elements.
fn largest_error(exact: &DMatrix<f64>, found: &DMatrix<f64>, controls: &[ControlElement]) -> f64 {
    let sum: Vector3<f64> = controls.iter().map(|control| control.origin).sum();
    let apart =
        |a: &ControlElement| controls.iter().map(|b| (a.origin - b.origin).norm()).fold(0.0, f64::max);
    let length = 0.5 * controls.iter().map(apart).fold(0.0, f64::max);
    let mut largest = 0.0_f64;
    for (e, control) in controls.iter().enumerate() {
        let others = (sum - control.origin) / (controls.len() - 1) as f64;
        let arm = (control.origin - others) * 0.5;
        let axis = arm.try_normalize(0.0).unwrap_or_else(Vector3::x);
        let aside = Vector3::ith(axis.iamin(), 1.0).cross(&axis).normalize();
        let block = |k: &DMatrix<f64>| k.fixed_view::<6, 6>(6 * e, 6 * e).into_owned();
        let wrench = |k: &Matrix6<f64>, turn: &Vector3<f64>| {
            let v = turn.cross(&arm);
            let wrench = k * Vector6::new(turn.x, turn.y, turn.z, v.x, v.y, v.z);
            (wrench.fixed_rows::<3>(0).into_owned(), wrench.fixed_rows::<3>(3) * length)
        };
        let size = |(torque, force): (Vector3<f64>, Vector3<f64>)| torque.norm().max(force.norm());
        let off = block(found) - block(exact);
        let turns = [axis, aside, axis.cross(&aside)];
        let sizes = turns.map(|turn| [&block(exact), &off].map(|k| size(wrench(k, &turn))));
        // What meets no resistance, as a line that turns about itself, has no error.
        let least = FREE * sizes.iter().fold(0.0_f64, |most, [of_exact, _]| most.max(*of_exact));
        for [of_exact, off] in sizes.into_iter().filter(|[of_exact, _]| *of_exact > least) {
            if off.is_nan() {
                return off;
            }
            largest = largest.max(off / of_exact);
        }
    }
    largest
}

/// The parts from the first control element to the second, where these are all that resist: one after the other, each between
/// two ends.
fn chain(parts: &[SolvedPart]) -> Option<Vec<usize>> {
    let resisting = parts.iter().filter(|part| part.ends.len() > 1).count();
    let (mut chain, mut joint) = (Vec::new(), Joint::Control(0));
    while joint != Joint::Control(1) {
        let is_next = |(p, part): &(usize, &SolvedPart)| {
            part.ends.len() > 1 && part.ends.contains(&joint) && !chain.contains(p)
        };
        let (next, part) = parts.iter().enumerate().find(is_next)?;
        let [a, b] = part.ends[..] else { return None };
        joint = if a == joint { b } else { a };
        chain.push(next);
    }
    (chain.len() == resisting).then_some(chain)
}

/// Changes the parts of a chain so that its stiffness is `exact`; leaves them where a compliance has no root.
fn correct(body: &mut SolvedBody, chain: &[usize], origins: [Vector3<f64>; 2], exact: &DMatrix<f64>) {
    let middle = (origins[0] + origins[1]) * 0.5;
    let length = (origins[1] - origins[0]).norm() * 0.5;
    let place = |joint: &Joint| match joint {
        Joint::Interface(i) => body.interfaces[*i],
        Joint::Control(e) => origins[*e],
    };
    let arms: Vec<Vector3<f64>> = chain
        .iter()
        .map(|&p| body.parts[p].ends.iter().map(place).sum::<Vector3<f64>>() * 0.5 - middle)
        .collect();
    let scaled = Matrix6::from_diagonal(&Vector6::new(length, length, length, 1.0, 1.0, 1.0));
    let whole = |compliance: Matrix6<f64>, arm: &Vector3<f64>| {
        let moved = scaled * shift(arm);
        moved * compliance * moved.transpose()
    };
    let compliance = |k: Matrix6<f64>| k.cholesky().map(|factor| factor.inverse());
    let of_part = |(&p, arm): (&usize, &Vector3<f64>)| {
        let k = body.parts[p].solution.stiffness.fixed_view::<6, 6>(0, 0).into_owned();
        compliance(k).map(|f| whole(f, arm))
    };
    let found: Option<Matrix6<f64>> = chain.iter().zip(&arms).map(of_part).sum();
    let wanted = compliance(exact.fixed_view::<6, 6>(6, 6).into_owned());
    let wanted = wanted.map(|f| whole(f, &(origins[1] - middle)));
    let inverse = found.zip(wanted).and_then(|(found, wanted)| inverse_map(&found, &wanted));
    let Some(inverse) = inverse else { return };
    for (&p, arm) in chain.iter().zip(&arms) {
        let own = shift(&-arm) * unscaled(&inverse, length) * shift(arm);
        body.parts[p].solution.change(&own);
    }
}

/// D⁻¹ m D for D that measures angles in `length`.
fn unscaled(m: &Matrix6<f64>, length: f64) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| m[(i, j)] * if j < 3 { length } else { 1.0 } / if i < 3 { length } else { 1.0 })
}

/// G⁻¹ of the symmetric G with G `from` G = `to`; `None` where one of them is not positive definite.
fn inverse_map(from: &Matrix6<f64>, to: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let root = power(to, 0.5)?;
    let inverse_root = power(to, -0.5)?;
    Some(inverse_root * power(&(root * from * root), 0.5)? * inverse_root)
}

/// A power of a symmetric matrix.
fn power(m: &Matrix6<f64>, exponent: f64) -> Option<Matrix6<f64>> {
    let eigen = ((m + m.transpose()) * 0.5).symmetric_eigen();
    let is_positive = eigen.eigenvalues.iter().all(|value| *value > 0.0);
    let powers = Matrix6::from_diagonal(&eigen.eigenvalues.map(|value| value.powf(exponent)));
    is_positive.then(|| eigen.eigenvectors * powers * eigen.eigenvectors.transpose())
}

impl PartSolution {
    /// Makes V(y) into V(t y), t acting on the one screw; the displacements by y stay.
    fn change(&mut self, t: &Matrix6<f64>) {
        let m = self.stiffness.nrows();
        let mut whole = DMatrix::<f64>::identity(m, m);
        whole.view_mut((0, 0), (6, 6)).copy_from(t);
        let products = of_pairs(&whole);
        let screws = of_pairs(&DMatrix::from_fn(6, 6, |i, j| t[(i, j)]));
        self.stiffness = whole.transpose() * &self.stiffness * &whole;
        self.quadratic = whole.transpose() * &self.quadratic * &products;
        self.quartic = screws.transpose() * &self.quartic * &screws;
        for table in [&mut self.stiffness, &mut self.quartic] {
            *table = (&*table + table.transpose()) * 0.5;
        }
    }
}

/// How t changes the products p of the pairs of y (half of a square): p(t y) = P p(y).
fn of_pairs(t: &DMatrix<f64>) -> DMatrix<f64> {
    let all = pairs(t.nrows());
    DMatrix::from_fn(all.len(), all.len(), |row, column| {
        let ((i, j), (k, l)) = (all[row], all[column]);
        let product = t[(i, k)] * t[(j, l)] + t[(i, l)] * t[(j, k)];
        if i == j { 0.5 * product } else { product }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_pairs_follow_the_map() {
        let m = 4;
        let t = DMatrix::from_fn(m, m, |i, j| f64::from(i == j) + 0.1 * ((3 * i + 5 * j) as f64).sin());
        let y = nalgebra::DVector::from_fn(m, |i, _| (1.3 * i as f64 + 0.2).cos());
        let p = |y: &nalgebra::DVector<f64>| {
            let half = |(i, j)| y[i] * y[j] * if i == j { 0.5 } else { 1.0 };
            nalgebra::DVector::from_iterator(10, pairs(m).into_iter().map(half))
        };
        assert!((of_pairs(&t) * p(&y) - p(&(&t * &y))).amax() < 1e-14);
    }

    #[test]
    fn the_map_takes_one_compliance_to_the_other() {
        let root = |seed: f64| {
            Matrix6::from_fn(|i, j| (seed * (7 * i + j) as f64).sin()) + Matrix6::identity() * 3.0
        };
        let [from, to] = [root(1.1), root(0.7)].map(|r| r * r.transpose());
        let g = inverse_map(&from, &to).unwrap().try_inverse().unwrap();
        assert!((g * from * g - to).amax() < 1e-11 * to.amax());
        assert!((g - g.transpose()).amax() < 1e-12);
        assert!((inverse_map(&to, &to).unwrap() - Matrix6::identity()).amax() < 1e-12);
    }
}
