//! Residuals to the coarse level, and its corrections back.

use super::prolong::{MODES, PART, Prolongator};
use crate::base::lanes::{Kernel, LANES, fused, lanes, lanes_mut, run};
use rayon::prelude::*;

/// coarse = Pᵀ fine for some aggregates.
struct Down<'a, const B: usize> {
    prolongator: &'a Prolongator<B>,
    columns: usize,
    first: usize,
    fine: &'a [f32],
    coarse: &'a mut [f32],
}

impl<const B: usize> Kernel for Down<'_, B> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let m = self.columns;
        for (number, coarse) in self.coarse.chunks_exact_mut(MODES * m).enumerate() {
            let (start, end) = (
                self.prolongator.down_start[self.first + number],
                self.prolongator.down_start[self.first + number + 1],
            );
            let mut lane = 0;
            while lane < m {
                let mut sum = [[0.0_f32; LANES]; MODES];
                for &(node, at) in &self.prolongator.down[start..end] {
                    let block = &self.prolongator.value[MODES * B * at as usize..][..MODES * B];
                    for k in 0..B {
                        let x = lanes::<LANES, f32>(self.fine, (node as usize * B + k) * m + lane);
                        for c in 0..MODES {
                            for t in 0..LANES {
                                sum[c][t] = fused::<FUSED>(block[c * B + k], x[t], sum[c][t]);
                            }
                        }
                    }
                }
                for c in 0..MODES {
                    *lanes_mut(coarse, c * m + lane) = sum[c];
                }
                lane += LANES;
            }
        }
    }
}

/// fine += P coarse for some nodes.
struct Up<'a, const B: usize> {
    prolongator: &'a Prolongator<B>,
    columns: usize,
    first: usize,
    fine: &'a mut [f32],
    coarse: &'a [f32],
}

impl<const B: usize> Kernel for Up<'_, B> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let m = self.columns;
        for (number, fine) in self.fine.chunks_exact_mut(B * m).enumerate() {
            let (start, end) = (
                self.prolongator.start[self.first + number],
                self.prolongator.start[self.first + number + 1],
            );
            for at in start..end {
                let block = &self.prolongator.value[MODES * B * at..][..MODES * B];
                let from = self.prolongator.column[at] as usize * MODES * m;
                let mut lane = 0;
                while lane < m {
                    let mut sum = [[0.0_f32; LANES]; B];
                    for r in 0..B {
                        sum[r] = *lanes(fine, r * m + lane);
                    }
                    for c in 0..MODES {
                        let x = lanes::<LANES, f32>(self.coarse, from + c * m + lane);
                        for r in 0..B {
                            for t in 0..LANES {
                                sum[r][t] = fused::<FUSED>(block[c * B + r], x[t], sum[r][t]);
                            }
                        }
                    }
                    for r in 0..B {
                        *lanes_mut(fine, r * m + lane) = sum[r];
                    }
                    lane += LANES;
                }
            }
        }
    }
}

impl<const B: usize> Prolongator<B> {
    /// coarse = Pᵀ fine.
    pub fn restrict(&self, columns: usize, fine: &[f32], coarse: &mut [f32]) {
        const AGGREGATES: usize = 32;
        coarse.par_chunks_mut(AGGREGATES * MODES * columns).enumerate().for_each(|(part, coarse)| {
            run(Down { prolongator: self, columns, first: part * AGGREGATES, fine, coarse });
        });
    }

    /// fine += P coarse.
    pub fn add(&self, columns: usize, coarse: &[f32], fine: &mut [f32]) {
        fine.par_chunks_mut(PART * B * columns).enumerate().for_each(|(part, fine)| {
            run(Up { prolongator: self, columns, first: part * PART, fine, coarse });
        });
    }
}
