//! u = Σ cₖ u⁽ᵏ⁾ in f32, vectorised, with only the changed groups of columns summed again.
//!
//! In: groups of columns as they are stored, any number in each, and their coefficients. Out: displacements. Every group
//! keeps its own partial sum. When its coefficients change, that sum is made anew from its columns and the total from the
//! partial sums, so that nothing drifts however often the body is moved. The twin on the graphics device is
//! `shaders/deform.wgsl`.

use crate::base::columns::{ColumnGroup, half_to_single};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;

/// Cost of one sum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SumStats {
    /// Groups whose columns were summed again.
    pub groups_summed: usize,
    /// Columns read for them.
    pub columns_read: usize,
}

/// u of node `i` alone, of `nodes`, for the coefficients of all columns in the order of their groups.
pub fn displacement(groups: &[ColumnGroup<'_>], nodes: usize, i: usize, c: &[f64]) -> Vector3<f64> {
    let columns = groups.iter().flat_map(|group| {
        let count = group.columns(nodes).unwrap_or(0);
        (0..count).map(move |k| (group, k))
    });
    columns.zip(c).fold(Vector3::zeros(), |sum, ((group, k), c)| {
        sum + Vector3::from_fn(|axis, _| c * f64::from(group.value(nodes, k, 3 * i + axis)))
    })
}

/// A coefficient, times the column's scale, and the column.
type Term<'a, T> = (f32, &'a [T]);

/// The columns of one group that are summed.
enum Terms<'a> {
    F32(Vec<Term<'a, f32>>),
    F16(Vec<Term<'a, u16>>),
    Int16(Vec<Term<'a, i16>>),
}

impl<'a> Terms<'a> {
    /// The columns with a coefficient that is not 0; a column has `n` numbers.
    fn new(group: &ColumnGroup<'a>, c: &[f32], n: usize) -> Terms<'a> {
        let used = c.iter().enumerate().filter(|(_, c)| **c != 0.0);
        let used = used.map(|(k, c)| (c * group.scale(k), k * n..(k + 1) * n));
        match *group {
            ColumnGroup::F32(values) => Terms::F32(used.map(|(c, part)| (c, &values[part])).collect()),
            ColumnGroup::F16 { bits, .. } => Terms::F16(used.map(|(c, part)| (c, &bits[part])).collect()),
            ColumnGroup::Int16 { values, .. } => {
                Terms::Int16(used.map(|(c, part)| (c, &values[part])).collect())
            }
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
            Terms::F16(terms) => combine_halves(out, terms, start),
            Terms::Int16(terms) => combine(out, terms, start, f32::from),
        }
    }
}

/// Places of the nodes of a surface: rest + u.
pub struct Places<'a> {
    pub rest: &'a [[f32; 3]],
    pub positions: &'a mut [[f32; 3]],
}

/// Numbers summed at a time: the partial sums and the total of one block stay in the first-level cache.
const BLOCK: usize = 2048;

/// Bytes of columns that are worth a thread of their own: waking it costs some 10 µs, reading these more.
pub const BYTES_PER_THREAD: usize = 1 << 20;

/// The partial sums of one body.
pub struct Superposition {
    /// Range of each group's columns among all.
    groups: Vec<Range<usize>>,
    /// The coefficients summed last, of all columns.
    coefficients: Vec<f32>,
    /// Partial sums of every group for each block of numbers, each `BLOCK` long.
    partial: Vec<f32>,
}

impl Superposition {
    /// A sum of these groups of columns of `nodes` nodes, none of which has a coefficient yet.
    pub fn new(groups: &[ColumnGroup<'_>], nodes: usize) -> Superposition {
        let mut end = 0;
        let range = |group: &ColumnGroup<'_>| {
            let start = end;
            end += group.columns(nodes).unwrap_or(0);
            start..end
        };
        let groups: Vec<Range<usize>> = groups.iter().map(range).collect();
        Superposition { groups, coefficients: vec![0.0; end], partial: Vec::new() }
    }

    /// Columns of all groups together.
    pub fn columns(&self) -> usize {
        self.coefficients.len()
    }

    /// Brings `u` to the sum over all groups for the coefficients of their columns; columns behind the last coefficient
    /// have none.
    ///
    /// `groups` are those of [`Superposition::new`]; `u` must be what the last call left, or zero on the first. The bits do
    /// not depend on the number of threads.
    pub fn update(&mut self, groups: &[ColumnGroup<'_>], c: &[f64], u: &mut [[f32; 3]]) -> SumStats {
        self.update_all(groups, c, u, None)
    }

    /// Updates u, and brings `places` to rest + u while each part of u is still in the cache; on the first call they must be at
    /// rest.
    pub fn update_places(
        &mut self,
        groups: &[ColumnGroup<'_>],
        c: &[f64],
        u: &mut [[f32; 3]],
        places: Places<'_>,
    ) -> SumStats {
        self.update_all(groups, c, u, Some(places))
    }

    fn update_all(
        &mut self,
        groups: &[ColumnGroup<'_>],
        c: &[f64],
        u: &mut [[f32; 3]],
        places: Option<Places<'_>>,
    ) -> SumStats {
        let mut rounded: Vec<f32> = c.iter().map(|c| *c as f32).collect();
        rounded.resize(self.columns(), 0.0);
        let columns = |g: usize| self.groups[g].clone();
        let is_changed = |g: &usize| rounded[columns(*g)] != self.coefficients[columns(*g)];
        let changed: Vec<usize> = (0..self.groups.len()).filter(is_changed).collect();
        let mut stats = SumStats { groups_summed: changed.len(), columns_read: 0 };
        if changed.is_empty() {
            return stats;
        }
        let u = u.as_flattened_mut();
        let terms: Vec<(usize, Terms)> =
            changed.iter().map(|&g| (g, Terms::new(&groups[g], &rounded[columns(g)], u.len()))).collect();
        let width = groups.iter().map(|group| group.storage().width()).max().unwrap_or(4);
        stats.columns_read = terms.iter().map(|(_, terms)| terms.len()).sum();
        let is_moved = |g: &usize| rounded[columns(*g)].iter().any(|c| *c != 0.0);
        let moved: Vec<usize> = (0..self.groups.len()).filter(is_moved).collect();

        let stride = BLOCK * self.groups.len();
        self.partial.resize(u.len().div_ceil(BLOCK) * stride, 0.0);
        let block_bytes = width * BLOCK * stats.columns_read.max(1);
        let mut places: Vec<_> = match places {
            Some(Places { rest, positions }) => {
                let positions = positions.as_flattened_mut().chunks_mut(BLOCK);
                positions.zip(rest.as_flattened().chunks(BLOCK)).map(Some).collect()
            }
            None => std::iter::repeat_with(|| None).take(u.len().div_ceil(BLOCK)).collect(),
        };
        self.partial
            .par_chunks_mut(stride)
            .zip(u.par_chunks_mut(BLOCK))
            .zip(&mut places)
            .enumerate()
            .with_min_len(BYTES_PER_THREAD.div_ceil(block_bytes))
            .for_each(|(block, ((partial, total), place))| {
                let n = total.len();
                for (g, terms) in &terms {
                    terms.combine(&mut partial[g * BLOCK..][..n], block * BLOCK);
                }
                let mut sums = moved.iter().map(|g| &partial[g * BLOCK..][..n]);
                match sums.next() {
                    Some(first) => total.copy_from_slice(first),
                    None => total.fill(0.0),
                }
                sums.for_each(|partial| add(total, partial));
                if let Some((positions, rest)) = place {
                    move_by(positions, rest, total);
                }
            });
        self.coefficients = rounded;
        stats
    }
}

/// positions = rest + u.
pub fn move_by(positions: &mut [f32], rest: &[f32], u: &[f32]) {
    for (position, (rest, u)) in positions.iter_mut().zip(rest.iter().zip(u)) {
        *position = rest + u;
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

/// [`combine`] of halves, which the processor itself converts where it can: a scalar conversion would not be vectorised.
fn combine_halves(out: &mut [f32], terms: &[Term<u16>], start: usize) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("fma")
        && std::arch::is_x86_feature_detected!("f16c")
    {
        // SAFETY: the processor has the features that the function is compiled for.
        return unsafe { combine_f16c(out, terms, start) };
    }
    combine(out, terms, start, half_to_single);
}

/// Computes the same bits as [`combine_avx2`] with [`half_to_single`].
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,f16c")]
fn combine_f16c(out: &mut [f32], terms: &[Term<u16>], start: usize) {
    out.fill(0.0);
    let end = start + out.len();
    let mut passes = terms.chunks_exact(4);
    for pass in &mut passes {
        add_f16c(out, [0, 1, 2, 3].map(|k| (pass[k].0, &pass[k].1[start..end])));
    }
    for &(c, column) in passes.remainder() {
        add_f16c(out, [(c, &column[start..end])]);
    }
}

/// out += Σ c · column, eight numbers at a time.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,f16c")]
fn add_f16c<const K: usize>(out: &mut [f32], terms: [Term<u16>; K]) {
    use std::arch::x86_64::{__m128i, __m256, _mm256_cvtph_ps, _mm256_fmadd_ps, _mm256_set1_ps};
    let columns = terms.map(|(_, column)| column.as_chunks::<8>());
    let (whole, rest) = out.as_chunks_mut::<8>();
    for (at, out) in whole.iter_mut().enumerate() {
        let mut sum: __m256 = bytemuck::cast(*out);
        for ((c, _), (column, _)) in terms.iter().zip(&columns) {
            let halves: __m128i = bytemuck::cast(column[at]);
            sum = _mm256_fmadd_ps(_mm256_set1_ps(*c), _mm256_cvtph_ps(halves), sum);
        }
        *out = bytemuck::cast(sum);
    }
    for (at, out) in rest.iter_mut().enumerate() {
        for ((c, _), (_, column)) in terms.iter().zip(&columns) {
            *out = c.mul_add(half_to_single(column[at]), *out);
        }
    }
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
    use crate::base::columns::{Storage, StoredColumns};

    const NODES: usize = 1501;

    /// Groups of columns, with `counts` columns each.
    fn data(counts: &[usize], nodes: usize) -> Vec<Vec<f32>> {
        let value = |i: usize| ((i * 2654435761 % 1000) as f32 - 500.0) * 1e-3;
        let group = |(g, count): (usize, &usize)| (0..count * 3 * nodes).map(|i| value(i + 7 * g)).collect();
        counts.iter().enumerate().map(group).collect()
    }

    fn direct(data: &[Vec<f32>], c: &[f64], i: usize) -> f64 {
        let columns = data.iter().flat_map(|group| group.chunks_exact(3 * NODES));
        columns.zip(c).map(|(column, c)| c * f64::from(column[i])).sum()
    }

    /// Places over several blocks, and still where nothing changes.
    #[test]
    fn places_are_rest_plus_u() {
        let data = data(&[12, 7], NODES);
        let groups: Vec<ColumnGroup> = data.iter().map(|data| ColumnGroup::F32(data)).collect();
        let rest: Vec<[f32; 3]> = (0..NODES).map(|i| [i as f32 * 0.01, 0.5, -0.25]).collect();
        let (mut sum, mut alone) = (Superposition::new(&groups, NODES), Superposition::new(&groups, NODES));
        let (mut u, mut expected) = (vec![[0.0; 3]; NODES], vec![[0.0; 3]; NODES]);
        let mut positions = rest.clone();
        for factor in [0.3, 0.3, -2.0, 0.0] {
            let c: Vec<f64> = (0..19).map(|k| factor * (f64::from(k) - 5.0)).collect();
            sum.update_places(&groups, &c, &mut u, Places { rest: &rest, positions: &mut positions });
            alone.update(&groups, &c, &mut expected);
            assert!(u == expected);
            for ((position, rest), u) in positions.iter().zip(&rest).zip(&u) {
                assert_eq!(*position, [0, 1, 2].map(|axis| rest[axis] + u[axis]));
            }
        }
    }

    /// Halves of all sizes, denormal ones too, over lengths that no register divides.
    #[test]
    fn halves_are_summed_as_their_singles_are() {
        let column = |k: u16| -> Vec<u16> {
            (0..2003_u16).map(|i| i.wrapping_mul(33).wrapping_add(k * 7919)).map(|h| h & 0xfbff).collect()
        };
        let columns: Vec<Vec<u16>> = (0..7).map(column).collect();
        let singles: Vec<Vec<f32>> =
            columns.iter().map(|column| column.iter().map(|&half| half_to_single(half)).collect()).collect();
        let c = |k: usize| 0.3 - 0.11 * k as f32;
        for start in [0, 5] {
            for count in [4, 7] {
                let mut found = vec![0.0; 1990];
                let halves: Vec<Term<u16>> = (0..count).map(|k| (c(k), &columns[k][..])).collect();
                combine_halves(&mut found, &halves, start);
                let mut expected = vec![0.0; 1990];
                let singles: Vec<Term<f32>> = (0..count).map(|k| (c(k), &singles[k][..])).collect();
                combine(&mut expected, &singles, start, |x| x);
                assert!(found == expected, "{start} {count}");
            }
        }
    }

    /// Groups of 12, 1 and 7 columns.
    #[test]
    fn sum_agrees_with_f64_and_reads_only_what_changed() {
        let data = data(&[12, 1, 7], NODES);
        let groups: Vec<ColumnGroup> = data.iter().map(|data| ColumnGroup::F32(data)).collect();
        let mut sum = Superposition::new(&groups, NODES);
        let mut u = vec![[0.0; 3]; NODES];
        let mut c = vec![0.0; 20];
        c[2] = 0.5;
        c[13..].copy_from_slice(&[-0.4, -0.3, 0.0, 0.1, 0.2, 0.3, 0.7]);
        let mut cost = |c: &[f64], u: &mut [[f32; 3]]| {
            let SumStats { groups_summed, columns_read } = sum.update(&groups, c, u);
            (groups_summed, columns_read)
        };
        assert_eq!(cost(&c, &mut u), (2, 1 + 6));
        c[12] = -0.25;
        assert_eq!(cost(&c, &mut u), (1, 1));
        for (i, u) in u.as_flattened().iter().enumerate() {
            assert!((f64::from(*u) - direct(&data, &c, i)).abs() < 2e-6);
        }
        for node in [0, 700, NODES - 1] {
            let alone = displacement(&groups, NODES, node, &c);
            assert!((0..3).all(|axis| (alone[axis] - f64::from(u[node][axis])).abs() < 2e-6), "{node}");
        }
        assert_eq!(cost(&c, &mut u), (0, 0));
        assert_eq!(cost(&c[..13], &mut u), (1, 0), "columns behind the last coefficient have none");
        assert_eq!(cost(&[0.0; 20], &mut u), (2, 0));
        assert!(u.as_flattened().iter().all(|u| *u == 0.0));
    }

    /// Groups may be stored differently, and be none at all.
    #[test]
    fn groups_of_any_storage_are_summed_together() {
        let exact: Vec<Vec<f64>> = data(&[5], NODES)[0]
            .chunks_exact(3 * NODES)
            .map(|c| c.iter().map(|x| (*x).into()).collect())
            .collect();
        let stored = Storage::ALL.map(|storage| StoredColumns::new(storage, &exact));
        let groups = stored.each_ref().map(StoredColumns::group);
        let c: Vec<f64> = (0..15).map(|k| 0.1 * f64::from(k) - 0.6).collect();
        let mut u = vec![[0.0; 3]; NODES];
        Superposition::new(&groups, NODES).update(&groups, &c, &mut u);
        for (i, u) in u.as_flattened().iter().enumerate() {
            let expected: f64 = (0..15).map(|k| c[k] * exact[k % 5][i]).sum();
            assert!((f64::from(*u) - expected).abs() < 1e-3, "{i}: {u} {expected}");
        }
        let nothing = Superposition::new(&[], NODES).update(&[], &c, &mut u);
        assert_eq!(nothing, SumStats::default());
    }

    #[test]
    fn a_million_updates_do_not_drift() {
        const FEW: usize = 5;
        const COLUMNS: usize = 12;
        let data = data(&[COLUMNS; 2], FEW);
        let groups: Vec<ColumnGroup> = data.iter().map(|data| ColumnGroup::F32(data)).collect();
        let pose = |steps: [usize; 2]| -> Vec<f64> {
            let c = |g: usize, k: usize| ((steps[g] * (k + 3) + g) as f64 * 0.37).sin();
            (0..2 * COLUMNS).map(|i| c(i / COLUMNS, i % COLUMNS)).collect()
        };
        let mut sum = Superposition::new(&groups, FEW);
        let mut u = vec![[0.0; 3]; FEW];
        for step in 0..1_000_000_usize {
            sum.update(&groups, &pose([step / 2, step.div_ceil(2)]), &mut u);
        }
        let mut expected = vec![[0.0; 3]; FEW];
        Superposition::new(&groups, FEW).update(&groups, &pose([499_999, 500_000]), &mut expected);
        assert_eq!(u, expected);
    }
}
