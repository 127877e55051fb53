//! The neo-Hookean energy of a body that bends into few fields, its volume kept in the mean by few pressures.
//!
//! In: the forms g of the family `reduced_neo_hookean`, exact cubics in z, and z. Out
//!
//! ```text
//! V = g_0 + ½ Σ g_m²     ∂V/∂z_i = ∂g_0/∂z_i + Σ g_m ∂g_m/∂z_i     ∂²V/∂z_i∂z_j = ∂²g_0/∂z_i∂z_j + Σ g_m ∂²g_m/∂z_i∂z_j + Σ ∂g_m/∂z_i ∂g_m/∂z_j
//! ```
//!
//! V is never below a bound: g_0 falls without one as ∫ μ (1 - J) alone, and that is a multiple of g_1. The coefficients of all g_m for
//! one monomial stand side by side; they are read once for values and slopes, once more for second derivatives. They are kept in
//! single precision, for most of the time is that of reading them: where strains are of the order ε, V is as exact as 10⁻⁷/ε. g_0, in which
//! terms of the order 1 leave one of ε², keeps double precision.
//!
//! A body that warmth makes s times as large has s³ V(z/s), where its last z is 1/s - 1: the field X, by which F/s - I is more than the
//! sum of the others. Allocates nothing once it is made.

use super::quartic::SIDE;
use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::CubicShape;
use crate::green::MOST_PRESSURES;
use nalgebra::{DMatrix, Matrix3};

/// Parts in which second derivatives are made for the force loop.
const PARTS: usize = 6;
/// Entries of a gradient.
const ENTRIES: usize = 9;
/// Lanes of the most pressures.
const MOST_LANES: usize = MOST_PRESSURES.div_ceil(SIDE);

/// Coefficients of [`SIDE`] forms, and numbers of as many.
type Coefficients = [f32; SIDE];
type Lane = [f64; SIDE];

pub struct Pressures {
    /// Numbers z without that of warmth.
    variables: usize,
    tables: Tables,
    here: Forms,
    /// Second derivatives for Newton's method, and those that are prepared in parts.
    newton: Second,
    second: Second,
    /// Gradients of the fields at the points that are pressed most, entry by entry, `variables - 1` numbers each.
    points: Vec<f64>,
}

/// Coefficients in the order of [`CubicShape`].
struct Tables {
    /// Coefficients of g_0.
    first: Vec<f64>,
    /// Coefficients of the others, `lanes` for each monomial.
    others: Vec<Coefficients>,
    lanes: usize,
}

/// The forms at one z.
#[derive(Clone, Debug)]
struct Forms {
    z: Vec<f64>,
    /// s.
    size: f64,
    /// Numbers z that may be other than 0.
    active: usize,
    /// g_0 and ∂g_0/∂z_i.
    first: f64,
    first_slopes: Vec<f64>,
    /// g_m, and 0 behind g_M; ∂g_m/∂z_i, as many for each i.
    values: Vec<Lane>,
    slopes: Vec<Lane>,
    sums: Vec<Lane>,
}

/// Second derivatives while they are made.
struct Second {
    forms: Forms,
    /// Row by row of `variables` numbers and that of warmth, below the diagonal and on it.
    sums: Vec<f64>,
    row: Vec<f64>,
    /// ∂²V/∂z² of the last that were made, row by row.
    made: Vec<f64>,
    /// The next c; `None` before the first.
    next: Option<usize>,
}

impl Pressures {
    /// The energy of `variables` numbers z; `None` where the tables do not suit them.
    pub fn new(variables: usize, forms: &DMatrix<f64>, points: &DMatrix<f64>) -> Option<Pressures> {
        let all = [variables, variables + 1]
            .into_iter()
            .find(|n| CubicShape { variables: *n }.len() == forms.ncols())?;
        if forms.nrows() == 0 || points.nrows() != ENTRIES * (variables - 1) {
            return None;
        }
        let lanes = (forms.nrows() - 1).div_ceil(SIDE).max(1);
        if lanes > MOST_LANES {
            return None;
        }
        let mut others = vec![[0.0; SIDE]; lanes * forms.ncols()];
        for (own, column) in others.chunks_exact_mut(lanes).zip(forms.column_iter()) {
            for (to, from) in own.as_flattened_mut().iter_mut().zip(&column.as_slice()[1..]) {
                *to = *from as f32;
            }
        }
        let tables = Tables { first: forms.row(0).iter().copied().collect(), others, lanes };
        let none = vec![[0.0; SIDE]; lanes];
        let here = Forms {
            z: vec![0.0; all],
            size: 1.0,
            active: 0,
            first: 0.0,
            first_slopes: vec![0.0; all],
            values: none.clone(),
            slopes: vec![[0.0; SIDE]; lanes * all],
            sums: none,
        };
        let second = || Second {
            forms: here.clone(),
            sums: vec![0.0; all * all],
            row: vec![0.0; all],
            made: vec![0.0; variables * variables],
            next: None,
        };
        let (newton, second) = (second(), second());
        let points = points.as_slice().to_vec();
        Some(Pressures { variables, tables, here, newton, second, points })
    }

    /// ½ ∂²V/∂z_k² at rest.
    pub fn stiffness(&self, k: usize) -> f64 {
        let (shape, Tables { first, others, lanes }) =
            (CubicShape { variables: self.variables }, &self.tables);
        let linear = others[shape.at([0, 0, k]) * lanes..][..*lanes].as_flattened();
        first[shape.at([0, k, k])] + 0.5 * linear.iter().map(|slope| f64::from(slope * slope)).sum::<f64>()
    }

    /// V, and its slopes against the first `active` of z; the others of z must be 0.
    pub fn slopes(&mut self, z: &[f64], active: usize, size: f64, slopes: &mut [f64]) -> f64 {
        self.here.take(z, active, size);
        self.here.evaluate(&self.tables);
        for (k, slope) in slopes.iter_mut().enumerate().take(active) {
            *slope = self.here.slope(k);
        }
        self.here.energy()
    }

    /// The slopes against the z behind the first `active`, where [`Pressures::slopes`] was asked last.
    pub fn slopes_beyond(&mut self, active: usize, slopes: &mut [f64]) {
        if self.here.active == active {
            lanes::run(Beyond { tables: &self.tables, forms: &mut self.here, until: self.variables });
        }
        for (k, slope) in (active..).zip(slopes) {
            *slope = self.here.slope(k);
        }
    }

    /// The second derivatives against the first `active` of z, row by row.
    pub fn second(&mut self, z: &[f64], active: usize, size: f64) -> &mut [f64] {
        match self.here.is_at(z, active, size) {
            true => self.newton.begin_at(&self.here),
            false => self.newton.begin(&self.tables, z, active, size),
        }
        self.newton.go_on(&self.tables, usize::MAX);
        self.newton.finish(active)
    }

    /// Does the next part of the second derivatives against all of z, where no warmth acts; true when all are made.
    pub fn prepare(&mut self, z: &[f64]) -> bool {
        match self.second.next {
            None => self.second.begin(&self.tables, z, self.variables, 1.0),
            Some(_) if self.is_prepared() => return true,
            Some(_) => {
                let count = CubicShape { variables: self.variables }.len();
                self.second.go_on(&self.tables, count.div_ceil(PARTS));
                if self.is_prepared() {
                    self.second.finish(self.variables);
                }
            }
        }
        self.is_prepared()
    }

    pub fn is_prepared(&self) -> bool {
        self.second.next.is_some_and(|next| next >= self.second.forms.active)
    }

    /// The second derivatives that were prepared last.
    pub fn prepared(&self) -> &[f64] {
        &self.second.made
    }

    /// Drops the second derivatives.
    pub fn forget(&mut self) {
        self.second.next = None;
    }

    /// Whether the body is inside out at one of the points that are pressed most.
    pub fn is_inverted(&self, z: &[f64]) -> bool {
        let fields = self.variables - 1;
        self.points.chunks_exact((ENTRIES * fields).max(1)).any(|rows| {
            let entry = |row: &[f64]| row.iter().zip(&z[1..]).map(|(h, z)| h * z).sum::<f64>();
            let h = Matrix3::from_iterator(rows.chunks_exact(fields).map(entry));
            (h + Matrix3::identity()).determinant() <= 0.0
        })
    }
}

impl Forms {
    /// Takes the first `active` of z, or all of them and that of warmth.
    fn take(&mut self, z: &[f64], active: usize, size: f64) {
        let all = self.z.len();
        self.size = size;
        self.active = if size == 1.0 { active } else { all };
        self.z[active..].fill(0.0);
        for (own, z) in self.z.iter_mut().zip(&z[..active]) {
            *own = z / size;
        }
        self.z[0] = 1.0;
        if size != 1.0 {
            self.z[all - 1] = size.recip() - 1.0;
        }
    }

    /// Whether they are known there.
    fn is_at(&self, z: &[f64], active: usize, size: f64) -> bool {
        let is_same = self.active == active && size == 1.0 && self.size == 1.0;
        is_same && self.z[1..active] == z[1..active]
    }

    /// Takes over another's numbers, without memory of its own as `clone_from` would take.
    fn copy_from(&mut self, other: &Forms) {
        (self.size, self.active, self.first) = (other.size, other.active, other.first);
        self.z.copy_from_slice(&other.z);
        self.first_slopes.copy_from_slice(&other.first_slopes);
        self.values.copy_from_slice(&other.values);
        self.slopes.copy_from_slice(&other.slopes);
    }

    fn evaluate(&mut self, tables: &Tables) {
        match tables.lanes {
            1 => lanes::run(Evaluate::<1> { tables, forms: self }),
            2 => lanes::run(Evaluate::<2> { tables, forms: self }),
            3 => lanes::run(Evaluate::<3> { tables, forms: self }),
            4 => lanes::run(Evaluate::<4> { tables, forms: self }),
            _ => lanes::run(Evaluate::<MOST_LANES> { tables, forms: self }),
        }
    }

    fn energy(&self) -> f64 {
        let squares: f64 = self.values.as_flattened().iter().map(|g| g * g).sum();
        self.size.powi(3) * (self.first + 0.5 * squares)
    }

    fn slope(&self, k: usize) -> f64 {
        let others = self.slopes_by(k).iter().zip(self.values.as_flattened());
        self.size.powi(2) * (self.first_slopes[k] + others.map(|(slope, g)| slope * g).sum::<f64>())
    }

    /// ∂g_m/∂z_k.
    fn slopes_by(&self, k: usize) -> &[f64] {
        let lanes = self.values.len();
        self.slopes[k * lanes..(k + 1) * lanes].as_flattened()
    }
}

/// sum += by · own.
#[inline(always)]
fn add<const FUSED: bool>(by: f64, own: &[Lane], sum: &mut [Lane]) {
    for (sum, own) in sum.iter_mut().zip(own) {
        for i in 0..SIDE {
            sum[i] = fused64::<FUSED>(by, own[i], sum[i]);
        }
    }
}

/// [`add`] for coefficients.
#[inline(always)]
fn add_read<const FUSED: bool>(by: f64, own: &[Coefficients], sum: &mut [Lane]) {
    for (sum, own) in sum.iter_mut().zip(own) {
        for i in 0..SIDE {
            sum[i] = fused64::<FUSED>(by, f64::from(own[i]), sum[i]);
        }
    }
}

/// g and ∂g/∂z, of `N` lanes.
struct Evaluate<'a, const N: usize> {
    tables: &'a Tables,
    forms: &'a mut Forms,
}

impl<const N: usize> Kernel for Evaluate<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Forms { z, active, first, first_slopes, values, slopes, .. } = self.forms;
        let mut rest_of_first = self.tables.first.as_slice();
        let mut rest = self.tables.others.as_chunks::<N>().0;
        let slopes_by = slopes.as_chunks_mut::<N>().0;
        *first = 0.0;
        first_slopes.fill(0.0);
        values.fill([0.0; SIDE]);
        slopes_by.fill([[0.0; SIDE]; N]);
        for c in 0..*active {
            for b in 0..=c {
                let (row, of_first);
                (of_first, rest_of_first) = rest_of_first.split_at(b + 1);
                (row, rest) = rest.split_at(b + 1);
                let both = z[b] * z[c];
                // Σ w_abc z_a.
                let mut sum_of_first = 0.0;
                for ((w, slope), za) in of_first.iter().zip(&mut *first_slopes).zip(&*z) {
                    *slope = fused64::<FUSED>(both, *w, *slope);
                    sum_of_first = fused64::<FUSED>(*za, *w, sum_of_first);
                }
                *first = fused64::<FUSED>(both, sum_of_first, *first);
                first_slopes[b] = fused64::<FUSED>(z[c], sum_of_first, first_slopes[b]);
                first_slopes[c] = fused64::<FUSED>(z[b], sum_of_first, first_slopes[c]);
                let mut sums = [[0.0; SIDE]; N];
                for ((own, slopes), za) in row.iter().zip(&mut *slopes_by).zip(&*z) {
                    for lane in 0..N {
                        for i in 0..SIDE {
                            let w = f64::from(own[lane][i]);
                            slopes[lane][i] = fused64::<FUSED>(both, w, slopes[lane][i]);
                            sums[lane][i] = fused64::<FUSED>(*za, w, sums[lane][i]);
                        }
                    }
                }
                add::<FUSED>(both, &sums, values);
                add::<FUSED>(z[c], &sums, &mut slopes_by[b]);
                add::<FUSED>(z[b], &sums, &mut slopes_by[c]);
            }
        }
    }
}

/// ∂g/∂z of the z that are 0, up to `until`.
struct Beyond<'a> {
    tables: &'a Tables,
    forms: &'a mut Forms,
    until: usize,
}

impl Kernel for Beyond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Tables { first, others, lanes } = self.tables;
        let Forms { z, active, first_slopes, slopes, sums, .. } = self.forms;
        for c in *active..self.until {
            let before = CubicShape { variables: c }.len();
            let (mut rest_of_first, mut rest) = (&first[before..], &others[before * lanes..]);
            let own = &mut slopes[c * lanes..(c + 1) * lanes];
            own.fill([0.0; SIDE]);
            let mut own_of_first = 0.0;
            for b in 0..*active {
                let (row, of_first);
                (of_first, rest_of_first) = rest_of_first.split_at(b + 1);
                (row, rest) = rest.split_at((b + 1) * lanes);
                own_of_first += z[b] * of_first.iter().zip(&*z).map(|(w, za)| w * za).sum::<f64>();
                sums.fill([0.0; SIDE]);
                for (of_a, za) in row.chunks_exact(*lanes).zip(&*z) {
                    add_read::<FUSED>(*za, of_a, sums);
                }
                add::<FUSED>(z[b], sums, own);
            }
            first_slopes[c] = own_of_first;
        }
    }
}

/// The part ∂²g_0 + Σ g_m ∂²g_m of the second derivatives.
struct SumSecond<'a, const N: usize> {
    tables: &'a Tables,
    second: &'a mut Second,
    /// Coefficients that are read, up to the end of a c.
    count: usize,
}

impl<const N: usize> Kernel for SumSecond<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Second { forms: Forms { z, active, values, .. }, sums, row, next, .. } = self.second;
        let (n, values) = (z.len(), lanes::lanes::<N, _>(values, 0));
        let mut c = next.unwrap_or(0);
        let before = CubicShape { variables: c }.len();
        let mut rest_of_first = &self.tables.first[before..];
        let mut rest = &self.tables.others.as_chunks::<N>().0[before..];
        let mut read = 0;
        while c < *active && read < self.count {
            for b in 0..=c {
                let (own, of_first);
                (of_first, rest_of_first) = rest_of_first.split_at(b + 1);
                (own, rest) = rest.split_at(b + 1);
                read += b + 1;
                // w_abc of g_0 + Σ g_m g_m with the first g_m held.
                let whole = &mut row[..=b];
                for ((whole, own), w) in whole.iter_mut().zip(own).zip(of_first) {
                    let mut sum = [0.0; SIDE];
                    for lane in 0..N {
                        for i in 0..SIDE {
                            sum[i] = fused64::<FUSED>(f64::from(own[lane][i]), values[lane][i], sum[i]);
                        }
                    }
                    *whole = w + sum.iter().sum::<f64>();
                }
                let (before_c, of_c) = sums.split_at_mut(c * n);
                for (sum, whole) in of_c.iter_mut().zip(&*whole) {
                    *sum = fused64::<FUSED>(*whole, z[b], *sum);
                }
                let of_b = if b == c { &mut *of_c } else { &mut before_c[b * n..] };
                for (sum, whole) in of_b.iter_mut().zip(&*whole) {
                    *sum = fused64::<FUSED>(*whole, z[c], *sum);
                }
                of_c[b] += whole.iter().zip(&*z).map(|(whole, za)| whole * za).sum::<f64>();
            }
            c += 1;
        }
        *next = Some(c);
    }
}

impl Second {
    fn begin(&mut self, tables: &Tables, z: &[f64], active: usize, size: f64) {
        self.forms.take(z, active, size);
        self.forms.evaluate(tables);
        self.sums.fill(0.0);
        self.next = Some(0);
    }

    /// Begins where the forms are known.
    fn begin_at(&mut self, forms: &Forms) {
        self.forms.copy_from(forms);
        self.sums.fill(0.0);
        self.next = Some(0);
    }

    fn go_on(&mut self, tables: &Tables, count: usize) {
        match tables.lanes {
            1 => lanes::run(SumSecond::<1> { tables, second: self, count }),
            2 => lanes::run(SumSecond::<2> { tables, second: self, count }),
            3 => lanes::run(SumSecond::<3> { tables, second: self, count }),
            4 => lanes::run(SumSecond::<4> { tables, second: self, count }),
            _ => lanes::run(SumSecond::<MOST_LANES> { tables, second: self, count }),
        }
    }

    /// The second derivatives against the first `count` of z: what was summed, with its other half, and the products of the slopes.
    fn finish(&mut self, count: usize) -> &mut [f64] {
        let Second { forms, sums, made, .. } = self;
        let n = forms.z.len();
        for i in 0..count {
            for j in 0..=i {
                let products: f64 =
                    forms.slopes_by(i).iter().zip(forms.slopes_by(j)).map(|(a, b)| a * b).sum();
                let sum = sums[i * n + j] * if i == j { 2.0 } else { 1.0 };
                let whole = forms.size * (sum + products);
                (made[i * count + j], made[j * count + i]) = (whole, whole);
            }
        }
        &mut made[..count * count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(variables: usize, forms: usize, is_warm: bool) -> Pressures {
        let all = CubicShape { variables: variables + usize::from(is_warm) }.len();
        let forms = DMatrix::from_fn(forms, all, |form, at| (1.3 * at as f64 + 0.7 * form as f64).sin());
        let points = DMatrix::from_fn(ENTRIES * (variables - 1), 2, |row, point| (row + point) as f64);
        Pressures::new(variables, &forms, &points).unwrap()
    }

    fn value(body: &Pressures, z: &[f64]) -> f64 {
        let Tables { first, others, lanes } = &body.tables;
        let (mut g, mut first_value) = (vec![0.0; lanes * SIDE], 0.0);
        let mut at = 0;
        for c in 0..z.len() {
            for b in 0..=c {
                for a in 0..=b {
                    let (own, monomial) =
                        (others[at * lanes..(at + 1) * lanes].as_flattened(), z[a] * z[b] * z[c]);
                    g.iter_mut().zip(own).for_each(|(g, w)| *g += f64::from(*w) * monomial);
                    first_value += first[at] * monomial;
                    at += 1;
                }
            }
        }
        first_value + 0.5 * g.iter().map(|g| g * g).sum::<f64>()
    }

    /// Values against sums over all coefficients, slopes and second derivatives against central differences; those of inactive z too, and
    /// with warmth.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_sum() {
        let n = 6;
        for (active, size) in [(n, 1.0), (4, 1.0), (n, 1.03), (4, 0.9)] {
            let mut body = body(n, 11, size != 1.0);
            let mut z: Vec<f64> =
                (0..n).map(|i| if i < active { 0.4 * (0.7 * i as f64).cos() } else { 0.0 }).collect();
            z[0] = 1.0;
            let of = |body: &Pressures, z: &[f64]| {
                let mut all: Vec<f64> = z.iter().map(|z| z / size).collect();
                all[0] = 1.0;
                if size != 1.0 {
                    all.push(1.0 / size - 1.0);
                }
                size.powi(3) * value(body, &all)
            };
            let mut slopes = vec![0.0; n];
            let found = body.slopes(&z, active, size, &mut slopes[..active]);
            body.slopes_beyond(active, &mut slopes[active..]);
            assert!((found - of(&body, &z)).abs() < 1e-12 * found.abs(), "{found} {}", of(&body, &z));
            let second = body.second(&z, active, size).to_vec();
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            for i in 1..n {
                let slope = (of(&body, &moved(i, 1e-5)) - of(&body, &moved(i, -1e-5))) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-7, "{active} {size} {i}: {} {slope}", slopes[i]);
                let (mut plus, mut minus) = (vec![0.0; active], vec![0.0; active]);
                if i < active {
                    body.slopes(&moved(i, 1e-5), active, size, &mut plus);
                    body.slopes(&moved(i, -1e-5), active, size, &mut minus);
                }
                for j in (1..active).filter(|_| i < active) {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    let found = second[i * active + j];
                    assert!((found - expected).abs() < 1e-6, "{active} {size} {i} {j}: {found} {expected}");
                }
            }
        }
    }

    /// The derivatives that are made in parts are those that are made at once.
    #[test]
    fn parts_make_the_whole() {
        let n = 9;
        let mut body = body(n, 7, false);
        let z: Vec<f64> = (0..n).map(|i| if i == 0 { 1.0 } else { 0.3 * (i as f64).sin() }).collect();
        let whole = body.second(&z, n, 1.0).to_vec();
        let calls = (1..).find(|_| body.prepare(&z)).unwrap();
        assert!((3..=PARTS + 2).contains(&calls), "{calls}");
        assert_eq!(whole, body.prepared());
    }

    #[test]
    fn a_point_that_is_pressed_flat_is_inside_out() {
        let forms = DMatrix::zeros(1, CubicShape { variables: 2 }.len());
        let flat = DMatrix::from_column_slice(9, 1, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let body = Pressures::new(2, &forms, &flat).unwrap();
        assert!(body.is_inverted(&[1.0, -1.01]) && !body.is_inverted(&[1.0, -0.99]));
    }
}
