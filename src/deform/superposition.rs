//! u = Σ cₖ u⁽ᵏ⁾ in f32, vectorised, with only the changed control elements summed again.
//!
//! Every control element keeps its own partial sum. When its coefficients change, that sum is made anew from its
//! columns and the total from the partial sums, so that nothing drifts however often the body is moved.

use crate::green::{Basis, FIELDS, half_to_single};
use nalgebra::Vector3;
use rayon::prelude::*;

/// What one sum cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SumStats {
    /// Control elements whose columns were summed again.
    pub elements_summed: usize,
    /// Columns read for them.
    pub columns_read: usize,
}

/// The basis columns of a body, per control element.
pub struct Columns<'a> {
    pub elements: Vec<Basis<'a>>,
}

impl Columns<'_> {
    /// u of node `i` alone, of `nodes`: for coefficients `c`, 12 a control element.
    pub fn displacement(&self, nodes: usize, i: usize, c: &[[f64; FIELDS]]) -> Vector3<f64> {
        let terms =
            self.elements.iter().zip(c).flat_map(|(basis, c)| (0..FIELDS).map(move |k| (basis, k, c[k])));
        terms.fold(Vector3::zeros(), |sum, (basis, k, c)| {
            sum + Vector3::from_fn(|axis, _| c * f64::from(basis.value(nodes, k, 3 * i + axis)))
        })
    }
}

/// A coefficient, times the column's scale, and the column.
type Term<'a, T> = (f32, &'a [T]);

/// The columns of one control element that are summed.
enum Terms<'a> {
    F32(Vec<Term<'a, f32>>),
    F16(Vec<Term<'a, u16>>),
    Int16(Vec<Term<'a, i16>>),
}

impl<'a> Terms<'a> {
    /// Those with a coefficient; a column has `n` numbers.
    fn new(basis: &Basis<'a>, c: &[f32; FIELDS], n: usize) -> Terms<'a> {
        fn used<'a, T>(values: &'a [T], c: &[f32; FIELDS], scales: &[f32], n: usize) -> Vec<Term<'a, T>> {
            let used = (0..FIELDS).filter(|&k| c[k] != 0.0);
            used.map(|k| (c[k] * scales[k], &values[k * n..(k + 1) * n])).collect()
        }
        match basis {
            Basis::F32(values) => Terms::F32(used(values, c, &[1.0; FIELDS], n)),
            Basis::F16 { bits, scales } => Terms::F16(used(bits, c, scales, n)),
            Basis::Int16 { values, scales } => Terms::Int16(used(values, c, scales, n)),
        }
    }

    fn len(&self) -> usize {
        match self {
            Terms::F32(terms) => terms.len(),
            Terms::F16(terms) => terms.len(),
            Terms::Int16(terms) => terms.len(),
        }
    }

    /// out = Σ c · column[start..].
    fn combine(&self, out: &mut [f32], start: usize) {
        match self {
            Terms::F32(terms) => combine(out, terms, start, |x| x),
            Terms::F16(terms) => combine(out, terms, start, half_to_single),
            Terms::Int16(terms) => combine(out, terms, start, f32::from),
        }
    }
}

/// Numbers summed at a time: the partial sums and the total of one block stay in the first-level cache.
const BLOCK: usize = 2048;

/// Bytes of columns that are worth a thread of their own: waking it costs some 10 µs, reading these more.
pub const BYTES_PER_THREAD: usize = 1 << 20;

/// The partial sums of one body.
pub struct Superposition {
    /// The coefficients summed last, per control element.
    coefficients: Vec<[f32; FIELDS]>,
    /// Per block of numbers, the partial sum of every control element, each `BLOCK` long.
    partial: Vec<f32>,
}

impl Superposition {
    pub fn new(elements: usize) -> Superposition {
        Superposition { coefficients: vec![[0.0; FIELDS]; elements], partial: Vec::new() }
    }

    /// Brings `u` to the sum over all control elements for coefficients `c`, 12 a control element.
    ///
    /// `u` must be what the last call left, or zero on the first. The bits do not depend on the number of threads.
    pub fn update(&mut self, columns: &Columns<'_>, c: &[[f64; FIELDS]], u: &mut [[f32; 3]]) -> SumStats {
        let rounded: Vec<[f32; FIELDS]> = c.iter().map(|c| c.map(|c| c as f32)).collect();
        let changed: Vec<usize> =
            (0..rounded.len()).filter(|&e| rounded[e] != self.coefficients[e]).collect();
        let mut stats = SumStats { elements_summed: changed.len(), columns_read: 0 };
        if changed.is_empty() {
            return stats;
        }
        let u = u.as_flattened_mut();
        let terms: Vec<(usize, Terms)> =
            changed.iter().map(|&e| (e, Terms::new(&columns.elements[e], &rounded[e], u.len()))).collect();
        let width = columns.elements.iter().map(Basis::width).max().unwrap_or(4);
        stats.columns_read = terms.iter().map(|(_, terms)| terms.len()).sum();
        let moved: Vec<usize> = (0..rounded.len()).filter(|&e| rounded[e] != [0.0; FIELDS]).collect();

        let stride = BLOCK * rounded.len();
        self.partial.resize(u.len().div_ceil(BLOCK) * stride, 0.0);
        let block_bytes = width * BLOCK * stats.columns_read.max(1);
        self.partial
            .par_chunks_mut(stride)
            .zip(u.par_chunks_mut(BLOCK))
            .enumerate()
            .with_min_len(BYTES_PER_THREAD.div_ceil(block_bytes))
            .for_each(|(block, (partial, total))| {
                let n = total.len();
                for (e, terms) in &terms {
                    terms.combine(&mut partial[e * BLOCK..][..n], block * BLOCK);
                }
                let mut sums = moved.iter().map(|e| &partial[e * BLOCK..][..n]);
                match sums.next() {
                    Some(first) => total.copy_from_slice(first),
                    None => total.fill(0.0),
                }
                sums.for_each(|partial| add(total, partial));
            });
        self.coefficients = rounded;
        stats
    }
}

fn add(total: &mut [f32], term: &[f32]) {
    for (total, term) in total.iter_mut().zip(term) {
        *total += term;
    }
}

/// out = Σ c · load(column[start..]), four columns a pass.
fn combine<T: Copy>(out: &mut [f32], terms: &[Term<T>], start: usize, load: impl Fn(T) -> f32 + Copy) {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512bw") {
            // SAFETY: the processor has the features that the function is compiled for.
            return unsafe { combine_avx512(out, terms, start, load) };
        }
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            // SAFETY: the processor has the features that the function is compiled for.
            return unsafe { combine_avx2(out, terms, start, load) };
        }
    }
    combine_with(out, terms, start, load, |c, x, sum| c * x + sum);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,fma")]
fn combine_avx512<T: Copy>(out: &mut [f32], terms: &[Term<T>], start: usize, load: impl Fn(T) -> f32 + Copy) {
    combine_with(out, terms, start, load, f32::mul_add);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn combine_avx2<T: Copy>(out: &mut [f32], terms: &[Term<T>], start: usize, load: impl Fn(T) -> f32 + Copy) {
    combine_with(out, terms, start, load, f32::mul_add);
}

/// The sum itself, inlined into each of the functions above and compiled for its instruction set.
#[inline(always)]
fn combine_with<T: Copy>(
    out: &mut [f32],
    terms: &[Term<T>],
    start: usize,
    load: impl Fn(T) -> f32 + Copy,
    multiply_add: impl Fn(f32, f32, f32) -> f32,
) {
    let n = out.len();
    out.fill(0.0);
    let mut passes = terms.chunks_exact(4);
    for pass in &mut passes {
        let [(c0, x0), (c1, x1), (c2, x2), (c3, x3)] =
            [pass[0], pass[1], pass[2], pass[3]].map(|(c, column)| (c, &column[start..start + n]));
        for i in 0..n {
            let low = multiply_add(c1, load(x1[i]), multiply_add(c0, load(x0[i]), out[i]));
            out[i] = multiply_add(c3, load(x3[i]), multiply_add(c2, load(x2[i]), low));
        }
    }
    for &(c, column) in passes.remainder() {
        let column = &column[start..start + n];
        for i in 0..n {
            out[i] = multiply_add(c, load(column[i]), out[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODES: usize = 1501;

    fn columns(elements: usize) -> Vec<Vec<f32>> {
        let value = |i: usize| ((i * 2654435761 % 1000) as f32 - 500.0) * 1e-3;
        (0..elements).map(|e| (0..FIELDS * 3 * NODES).map(|i| value(i + 7 * e)).collect()).collect()
    }

    fn direct(columns: &[Vec<f32>], c: &[[f64; FIELDS]], i: usize) -> f64 {
        let term = |e: usize, k: usize| c[e][k] * f64::from(columns[e][k * 3 * NODES + i]);
        (0..columns.len()).flat_map(|e| (0..FIELDS).map(move |k| (e, k))).map(|(e, k)| term(e, k)).sum()
    }

    #[test]
    fn sum_agrees_with_f64_and_reads_only_what_changed() {
        let data = columns(3);
        let columns = Columns { elements: data.iter().map(|data| Basis::F32(data)).collect() };
        let mut sum = Superposition::new(3);
        let mut u = vec![[0.0; 3]; NODES];
        let mut c = vec![[0.0; FIELDS]; 3];
        c[0][2] = 0.5;
        c[2] = std::array::from_fn(|k| 0.1 * k as f64 - 0.4);
        let stats = sum.update(&columns, &c, &mut u);
        assert_eq!((stats.elements_summed, stats.columns_read), (2, 1 + 11));
        c[1][11] = -0.25;
        let stats = sum.update(&columns, &c, &mut u);
        assert_eq!((stats.elements_summed, stats.columns_read), (1, 1));
        for (i, u) in u.as_flattened().iter().enumerate() {
            assert!((f64::from(*u) - direct(&data, &c, i)).abs() < 2e-6);
        }
        let stats = sum.update(&columns, &c, &mut u);
        assert_eq!((stats.elements_summed, stats.columns_read), (0, 0));
        let stats = sum.update(&columns, &[[0.0; FIELDS]; 3], &mut u);
        assert_eq!((stats.elements_summed, stats.columns_read), (3, 0));
        assert!(u.as_flattened().iter().all(|u| *u == 0.0));
    }

    #[test]
    fn a_million_updates_do_not_drift() {
        const FEW: usize = 5;
        let data: Vec<Vec<f32>> = columns(2).iter().map(|all| all[..FIELDS * 3 * FEW].to_vec()).collect();
        let columns = Columns { elements: data.iter().map(|data| Basis::F32(data)).collect() };
        let pose = |step: usize, e: usize| -> [f64; FIELDS] {
            std::array::from_fn(|k| ((step * (k + 3) + e) as f64 * 0.37).sin())
        };
        let mut sum = Superposition::new(2);
        let mut u = vec![[0.0; 3]; FEW];
        for step in 0..1_000_000 {
            sum.update(&columns, &[pose(step / 2, 0), pose(step.div_ceil(2), 1)], &mut u);
        }
        let mut fresh = Superposition::new(2);
        let mut expected = vec![[0.0; 3]; FEW];
        fresh.update(&columns, &[pose(499_999, 0), pose(500_000, 1)], &mut expected);
        assert_eq!(u, expected);
    }
}
