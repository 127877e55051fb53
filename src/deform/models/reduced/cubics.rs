//! Cubics g of the same z, of which an energy is g_0 + ½ Σ g_m²: their values and slopes, and the energy's second derivatives.
//!
//! In: coefficients in the order of [`CubicShape`], and z. The coefficients of all g_m for one monomial stand side by side, in lanes of
//! [`SIDE`]; they are read once for values and slopes, once more for second derivatives. Each loop over monomials carries a sum from
//! one to the next, which lets the compiler make vectors of forms, whose numbers are side by side, and not of monomials.
//!
//! The coefficients of the g_m are kept in single precision: where strains are of the order ε, their energy is as exact as 10⁻⁷/ε.
//! g_0, in which terms of the order 1 leave one of ε², keeps double precision. Allocates nothing once it is made.

use super::quartic::SIDE;
use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::CubicShape;
use crate::green::MOST_PRESSURES;
use nalgebra::DMatrix;

/// Lanes of the most pressures.
const MOST_LANES: usize = MOST_PRESSURES.div_ceil(SIDE);

/// Coefficients of [`SIDE`] forms, and numbers of as many.
type Coefficients = [f32; SIDE];
type Lane = [f64; SIDE];

/// The coefficients.
pub struct Cubics {
    /// Coefficients of g_0.
    pub first: Vec<f64>,
    /// Coefficients of the others, `lanes` for each monomial.
    others: Vec<Coefficients>,
    lanes: usize,
}

/// The cubics at one z.
#[derive(Clone, Debug)]
pub struct Forms {
    pub z: Vec<f64>,
    /// Numbers z that may be other than 0.
    pub active: usize,
    /// g_0 and ∂g_0/∂z_i.
    first: f64,
    first_slopes: Vec<f64>,
    /// g_m, and 0 behind g_M; ∂g_m/∂z_i, as many for each i.
    values: Vec<Lane>,
    slopes: Vec<Lane>,
}

/// Second derivatives of the energy while they are made.
pub struct Second {
    pub forms: Forms,
    /// Row by row of as many numbers as there are z, below the diagonal and on it.
    sums: Vec<f64>,
    /// For the a of one b and c: Σ g_m w_abc by lanes, and in all with that of g_0.
    parts: Vec<Lane>,
    row: Vec<f64>,
    /// ∂²V/∂z² of the last that were made, row by row.
    made: Vec<f64>,
    /// The next c; `None` before the first.
    next: Option<usize>,
}

/// Runs a kernel that is generic in its number of lanes.
macro_rules! run {
    ($lanes:expr, $kernel:ident $fields:tt) => {
        match $lanes {
            1 => lanes::run($kernel::<1> $fields),
            2 => lanes::run($kernel::<2> $fields),
            3 => lanes::run($kernel::<3> $fields),
            4 => lanes::run($kernel::<4> $fields),
            _ => lanes::run($kernel::<MOST_LANES> $fields),
        }
    };
}

impl Cubics {
    /// The cubics whose coefficients are the rows; `None` where there are none or too many.
    pub fn new(forms: &DMatrix<f64>) -> Option<Cubics> {
        let lanes = forms.nrows().checked_sub(1)?.div_ceil(SIDE).max(1);
        if lanes > MOST_LANES {
            return None;
        }
        let mut others = vec![[0.0; SIDE]; lanes * forms.ncols()];
        for (own, column) in others.chunks_exact_mut(lanes).zip(forms.column_iter()) {
            for (to, from) in own.as_flattened_mut().iter_mut().zip(&column.as_slice()[1..]) {
                *to = *from as f32;
            }
        }
        Some(Cubics { first: forms.row(0).iter().copied().collect(), others, lanes })
    }

    /// The coefficients of g_1, g_2, … for one monomial.
    pub fn others(&self, monomial: usize) -> &[f32] {
        self.others[monomial * self.lanes..][..self.lanes].as_flattened()
    }
}

impl Forms {
    /// The cubics of `variables` numbers z, not yet evaluated.
    pub fn new(cubics: &Cubics, variables: usize) -> Forms {
        Forms {
            z: vec![0.0; variables],
            active: 0,
            first: 0.0,
            first_slopes: vec![0.0; variables],
            values: vec![[0.0; SIDE]; cubics.lanes],
            slopes: vec![[0.0; SIDE]; cubics.lanes * variables],
        }
    }

    /// Takes over another's numbers, without memory of its own as `clone_from` would take.
    pub fn copy_from(&mut self, other: &Forms) {
        (self.active, self.first) = (other.active, other.first);
        self.z.copy_from_slice(&other.z);
        self.first_slopes.copy_from_slice(&other.first_slopes);
        self.values.copy_from_slice(&other.values);
        self.slopes.copy_from_slice(&other.slopes);
    }

    /// Finds values and slopes at z.
    pub fn evaluate(&mut self, cubics: &Cubics) {
        run!(cubics.lanes, Evaluate { cubics, forms: self });
    }

    /// Finds the slopes against the z behind the active ones, up to `until`, which are 0.
    pub fn evaluate_beyond(&mut self, cubics: &Cubics, until: usize) {
        run!(cubics.lanes, Beyond { cubics, forms: self, until });
    }

    /// g_0 + ½ Σ g_m².
    pub fn energy(&self) -> f64 {
        self.first + 0.5 * self.values.as_flattened().iter().map(|g| g * g).sum::<f64>()
    }

    /// Slope of [`Forms::energy`] against z_k.
    pub fn slope(&self, k: usize) -> f64 {
        let others = self.slopes_by(k).iter().zip(self.values.as_flattened());
        self.first_slopes[k] + others.map(|(slope, g)| slope * g).sum::<f64>()
    }

    /// ∂g_m/∂z_k.
    fn slopes_by(&self, k: usize) -> &[f64] {
        let lanes = self.values.len();
        self.slopes[k * lanes..(k + 1) * lanes].as_flattened()
    }
}

#[inline(always)]
fn widened(own: &Coefficients) -> Lane {
    let mut wide = [0.0; SIDE];
    for i in 0..SIDE {
        wide[i] = f64::from(own[i]);
    }
    wide
}

/// by · own + sum.
#[inline(always)]
fn added<const FUSED: bool>(by: f64, own: &Lane, sum: &Lane) -> Lane {
    let mut added = *sum;
    for i in 0..SIDE {
        added[i] = fused64::<FUSED>(by, own[i], added[i]);
    }
    added
}

/// sum += by · own.
#[inline(always)]
fn add<const FUSED: bool>(by: f64, own: &[Lane], sum: &mut [Lane]) {
    for (sum, own) in sum.iter_mut().zip(own) {
        *sum = added::<FUSED>(by, own, sum);
    }
}

/// g and ∂g/∂z, of `N` lanes.
struct Evaluate<'a, const N: usize> {
    cubics: &'a Cubics,
    forms: &'a mut Forms,
}

impl<const N: usize> Kernel for Evaluate<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Forms { z, active, first, first_slopes, values, slopes } = self.forms;
        let mut rest_of_first = self.cubics.first.as_slice();
        let mut rest = self.cubics.others.as_chunks::<N>().0;
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
                        let w = widened(&own[lane]);
                        slopes[lane] = added::<FUSED>(both, &w, &slopes[lane]);
                        sums[lane] = added::<FUSED>(*za, &w, &sums[lane]);
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
struct Beyond<'a, const N: usize> {
    cubics: &'a Cubics,
    forms: &'a mut Forms,
    until: usize,
}

impl<const N: usize> Kernel for Beyond<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Forms { z, active, first_slopes, slopes, .. } = self.forms;
        let slopes_by = slopes.as_chunks_mut::<N>().0;
        for c in *active..self.until {
            let before = CubicShape { variables: c }.len();
            let mut rest_of_first = &self.cubics.first[before..];
            let mut rest = &self.cubics.others.as_chunks::<N>().0[before..];
            let (mut own, mut own_of_first) = ([[0.0; SIDE]; N], 0.0);
            for b in 0..*active {
                let (row, of_first);
                (of_first, rest_of_first) = rest_of_first.split_at(b + 1);
                (row, rest) = rest.split_at(b + 1);
                own_of_first += z[b] * of_first.iter().zip(&*z).map(|(w, za)| w * za).sum::<f64>();
                let mut sums = [[0.0; SIDE]; N];
                for (of_a, za) in row.iter().zip(&*z) {
                    for lane in 0..N {
                        sums[lane] = added::<FUSED>(*za, &widened(&of_a[lane]), &sums[lane]);
                    }
                }
                add::<FUSED>(z[b], &sums, &mut own);
            }
            (slopes_by[c], first_slopes[c]) = (own, own_of_first);
        }
    }
}

/// The part ∂²g_0 + Σ g_m ∂²g_m of the second derivatives.
struct SumSecond<'a, const N: usize> {
    cubics: &'a Cubics,
    second: &'a mut Second,
    /// Coefficients that are read, up to the end of a c.
    count: usize,
}

impl<const N: usize> Kernel for SumSecond<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Second { forms: Forms { z, active, values, .. }, sums, parts, row, next, .. } = self.second;
        let (n, values) = (z.len(), lanes::lanes::<N, _>(values, 0));
        let mut c = next.unwrap_or(0);
        let before = CubicShape { variables: c }.len();
        let mut rest_of_first = &self.cubics.first[before..];
        let mut rest = &self.cubics.others.as_chunks::<N>().0[before..];
        let mut read = 0;
        while c < *active && read < self.count {
            for b in 0..=c {
                let (own, of_first);
                (of_first, rest_of_first) = rest_of_first.split_at(b + 1);
                (own, rest) = rest.split_at(b + 1);
                read += b + 1;
                // Σ z_a Σ g_m w_abc.
                let mut along = [0.0; SIDE];
                for ((part, own), za) in parts.iter_mut().zip(own).zip(&*z) {
                    let mut sum = [0.0; SIDE];
                    for lane in 0..N {
                        let w = widened(&own[lane]);
                        for i in 0..SIDE {
                            sum[i] = fused64::<FUSED>(w[i], values[lane][i], sum[i]);
                        }
                    }
                    *part = sum;
                    along = added::<FUSED>(*za, &sum, &along);
                }
                let whole = &mut row[..=b];
                for ((whole, part), w) in whole.iter_mut().zip(&*parts).zip(of_first) {
                    *whole = w + part.iter().sum::<f64>();
                }
                let (before_c, of_c) = sums.split_at_mut(c * n);
                for (sum, whole) in of_c.iter_mut().zip(&*whole) {
                    *sum = fused64::<FUSED>(*whole, z[b], *sum);
                }
                let of_b = if b == c { &mut *of_c } else { &mut before_c[b * n..] };
                for (sum, whole) in of_b.iter_mut().zip(&*whole) {
                    *sum = fused64::<FUSED>(*whole, z[c], *sum);
                }
                let along_first: f64 = of_first.iter().zip(&*z).map(|(w, za)| w * za).sum();
                of_c[b] += along.iter().sum::<f64>() + along_first;
            }
            c += 1;
        }
        *next = Some(c);
    }
}

impl Second {
    /// Room for the second derivatives against `variables` numbers z, where `forms` are of as many or of one more.
    pub fn new(forms: &Forms, variables: usize) -> Second {
        let all = forms.z.len();
        Second {
            forms: forms.clone(),
            sums: vec![0.0; all * all],
            parts: vec![[0.0; SIDE]; all],
            row: vec![0.0; all],
            made: vec![0.0; variables * variables],
            next: None,
        }
    }

    /// Begins where its forms are evaluated.
    pub fn begin(&mut self) {
        self.sums.fill(0.0);
        self.next = Some(0);
    }

    /// Reads about `count` coefficients more.
    pub fn go_on(&mut self, cubics: &Cubics, count: usize) {
        run!(cubics.lanes, SumSecond { cubics, second: self, count });
    }

    pub fn has_begun(&self) -> bool {
        self.next.is_some()
    }

    /// Whether all coefficients were read.
    pub fn is_summed(&self) -> bool {
        self.next.is_some_and(|next| next >= self.forms.active)
    }

    /// Drops what was summed.
    pub fn forget(&mut self) {
        self.next = None;
    }

    /// Adds the products of the slopes, and multiplies by `scale`: the second derivatives against the first `count` of z.
    pub fn finish(&mut self, count: usize, scale: f64) -> &mut [f64] {
        let Second { forms, sums, made, .. } = self;
        let n = forms.z.len();
        for i in 0..count {
            for j in 0..=i {
                let products: f64 =
                    forms.slopes_by(i).iter().zip(forms.slopes_by(j)).map(|(a, b)| a * b).sum();
                let sum = sums[i * n + j] * if i == j { 2.0 } else { 1.0 };
                let whole = scale * (sum + products);
                (made[i * count + j], made[j * count + i]) = (whole, whole);
            }
        }
        &mut made[..count * count]
    }

    /// The second derivatives that were finished last.
    pub fn made(&self) -> &[f64] {
        &self.made
    }
}
