//! Points and weights of Gauss' rules on a triangle and on an edge, in lanes.
//!
//! Each [`Nested`] rule holds two, so that one pass over its points gives a value and, by their difference, its error.

use super::potentials::Points;
use nalgebra::Vector3;

/// Weights of the corners in the three points of degree 2, each of a third of the area.
pub const THREE: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// Points by the weights of the C corners that they lie between, and parts of the whole that each stands for: in `fine`, and in the less
/// exact `coarse`.
pub struct Nested<const C: usize, const N: usize> {
    pub at: [[f64; N]; C],
    pub coarse: [f64; N],
    pub fine: [f64; N],
}

impl<const C: usize, const N: usize> Nested<C, N> {
    /// The points between these corners.
    pub fn points(&self, corners: &[Vector3<f64>; C]) -> Points<N> {
        let mut points = [[0.0; N]; 3];
        for (corner, at) in corners.iter().zip(&self.at) {
            for (points, x) in points.iter_mut().zip(corner) {
                points.iter_mut().zip(at).for_each(|(point, at)| *point += at * x);
            }
        }
        points
    }

    /// The means of these values, coarse and fine.
    pub fn means<const M: usize>(&self, values: &[[f64; N]; M]) -> [[f64; M]; 2] {
        [&self.coarse, &self.fine].map(|weights| {
            std::array::from_fn(|m| values[m].iter().zip(weights).map(|(value, weight)| value * weight).sum())
        })
    }
}

/// The rule of a triangle: degree 5 (Radon) on the first seven, degree 8 (Dunavant, Int. J. Numer. Meth. Eng. 21, 1985) on the
/// last sixteen points; the eighth counts nothing.
pub const TRIANGLE: Nested<3, 24> = {
    const THIRD: f64 = 1.0 / 3.0;
    // Points that differ by the order of the corners alone: two weights alike, or none.
    const fn put(
        rule: &mut Nested<3, 24>,
        from: usize,
        [a, b, c]: [f64; 3],
        is_fine: bool,
        part: f64,
    ) -> usize {
        let orders = [[a, b, c], [b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]];
        let count = if a == c {
            1
        } else if b == c {
            3
        } else {
            6
        };
        let mut k = 0;
        while k < count {
            let mut q = 0;
            while q < 3 {
                rule.at[q][from + k] = orders[k][q];
                q += 1;
            }
            if is_fine {
                rule.fine[from + k] = part;
            } else {
                rule.coarse[from + k] = part;
            }
            k += 1;
        }
        from + count
    }
    const fn alike(a: f64) -> [f64; 3] {
        [1.0 - 2.0 * a, a, a]
    }
    let mut rule = Nested { at: [[0.0; 24]; 3], coarse: [0.0; 24], fine: [0.0; 24] };
    let at = put(&mut rule, 0, [THIRD; 3], false, 0.225);
    let at = put(&mut rule, at, alike(0.470_142_064_105_115_1), false, 0.132_394_152_788_506_2);
    let at = put(&mut rule, at, alike(0.101_286_507_323_456_33), false, 0.125_939_180_544_827_17);
    let at = put(&mut rule, at, [THIRD; 3], false, 0.0);
    let at = put(&mut rule, at, [THIRD; 3], true, 0.144_315_607_677_787_17);
    let at = put(&mut rule, at, alike(0.459_292_588_292_723_2), true, 0.095_091_634_267_284_62);
    let at = put(&mut rule, at, alike(0.170_569_307_751_760_2), true, 0.103_217_370_534_718_25);
    let at = put(&mut rule, at, alike(0.050_547_228_317_030_98), true, 0.032_458_497_623_198_08);
    let last = [0.008_394_777_409_957_605, 0.263_112_829_634_638_1, 0.728_492_392_955_404_3];
    put(&mut rule, at, last, true, 0.027_230_314_174_434_994);
    rule
};

/// The first seven of them alone, the eighth counts nothing.
pub const SEVEN: Nested<3, 8> = {
    let mut rule = Nested { at: [[0.0; 8]; 3], coarse: [0.0; 8], fine: [0.0; 8] };
    let mut k = 0;
    while k < 8 {
        let mut q = 0;
        while q < 3 {
            rule.at[q][k] = TRIANGLE.at[q][k];
            q += 1;
        }
        rule.coarse[k] = TRIANGLE.coarse[k];
        rule.fine[k] = TRIANGLE.coarse[k];
        k += 1;
    }
    rule
};

/// The rule of an edge: Gauss' seven points within Kronrod's fifteen; the last counts nothing.
pub const EDGE: Nested<2, 16> = {
    // On [-1, 1]: point, part in Kronrod's, part in Gauss' rule.
    const HALF: [[f64; 3]; 8] = [
        [0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4],
        [0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0],
        [0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9],
        [0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0],
        [0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_67],
        [0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0],
        [0.949_107_912_342_758_5, 0.063_092_092_629_978_56, 0.129_484_966_168_869_7],
        [0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0],
    ];
    let mut rule = Nested { at: [[0.5; 16]; 2], coarse: [0.0; 16], fine: [0.0; 16] };
    let mut k = 0usize;
    while k < 15 {
        let [x, kronrod, gauss] = HALF[k.div_ceil(2)];
        let x = if k.is_multiple_of(2) { x } else { -x };
        rule.at[0][k] = (1.0 - x) / 2.0;
        rule.at[1][k] = (1.0 + x) / 2.0;
        rule.fine[k] = kronrod / 2.0;
        rule.coarse[k] = gauss / 2.0;
        k += 1;
    }
    rule
};

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ of monomials over the simplex: a! b! c! 2/(a + b + c + 2)!, and over the edge a! b!/(a + b + 1)!.
    #[test]
    fn monomials_are_integrated_up_to_the_degree_of_the_rule() {
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        let check = |at: &[&[f64]], weights: &[f64], powers: &[i32], exact: f64| {
            let of = |k: usize| at.iter().zip(powers).map(|(at, power)| at[k].powi(*power)).product::<f64>();
            let sum: f64 = weights.iter().enumerate().map(|(k, weight)| weight * of(k)).sum();
            assert!((sum - exact).abs() < 1e-14, "{powers:?}: {sum} {exact}");
        };
        for (a, b, c) in
            (0..9).flat_map(|a| (0..9 - a).flat_map(move |b| (0..9 - a - b).map(move |c| (a, b, c))))
        {
            let exact = 2.0 * factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 2);
            let at = TRIANGLE.at.each_ref().map(|at| at.as_slice());
            check(&at, &TRIANGLE.fine, &[a, b, c], exact);
            if a + b + c <= 5 {
                check(&at, &TRIANGLE.coarse, &[a, b, c], exact);
            }
        }
        for (a, b) in (0..23).flat_map(|a| (0..23 - a).map(move |b| (a, b))) {
            let exact = factorial(a) * factorial(b) / factorial(a + b + 1);
            let at = EDGE.at.each_ref().map(|at| at.as_slice());
            check(&at, &EDGE.fine, &[a, b], exact);
            if a + b <= 13 {
                check(&at, &EDGE.coarse, &[a, b], exact);
            }
        }
    }
}
