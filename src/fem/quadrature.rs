//! Rules of integration over tetrahedra and triangles: barycentric coordinates of points, and their weights.

/// Barycentric coordinates and weights of a rule; the weights' sum is 1.
pub type Rule = [([f64; 4], f64)];

const NEAR: f64 = 0.585_410_196_624_968_5;
const FAR: f64 = 0.138_196_601_125_010_5;
const THIRD: f64 = 1.0 / 3.0;

/// Four points, of degree 2 (Zienkiewicz and Taylor, vol. 1, 5th ed., table 9.3).
pub const STRAIGHT: &Rule = &[
    ([NEAR, FAR, FAR, FAR], 0.25),
    ([FAR, NEAR, FAR, FAR], 0.25),
    ([FAR, FAR, NEAR, FAR], 0.25),
    ([FAR, FAR, FAR, NEAR], 0.25),
];

/// The corners and the faces' centres, of degree 3 (Keast, Comput. Methods Appl. Mech. Engng. 55, 1986, 339-348).
pub const CURVED: &Rule = &[
    ([1.0, 0.0, 0.0, 0.0], 1.0 / 40.0),
    ([0.0, 1.0, 0.0, 0.0], 1.0 / 40.0),
    ([0.0, 0.0, 1.0, 0.0], 1.0 / 40.0),
    ([0.0, 0.0, 0.0, 1.0], 1.0 / 40.0),
    ([0.0, THIRD, THIRD, THIRD], 9.0 / 40.0),
    ([THIRD, 0.0, THIRD, THIRD], 9.0 / 40.0),
    ([THIRD, THIRD, 0.0, THIRD], 9.0 / 40.0),
    ([THIRD, THIRD, THIRD, 0.0], 9.0 / 40.0),
];

/// Nodes r in (0, 1) and weights of the Gauss–Jacobi rules of four points for the means of 3 (1 - r)² f, 2 (1 - r) f and
/// f: each is exact to degree 7.
const GAUSS_JACOBI: [[[f64; 2]; 4]; 3] = [
    [
        [0.048_500_549_446_997_33, 0.332_665_246_833_833_97],
        [0.238_600_737_551_862_3, 0.430_376_369_397_642_6],
        [0.517_047_295_104_367_5, 0.205_901_661_518_769_24],
        [0.795_851_417_896_772_9, 0.031_056_722_249_754_195],
    ],
    [
        [0.057_104_196_114_517_68, 0.271_013_826_862_976_2],
        [0.276_843_013_638_123_86, 0.406_929_136_020_542_7],
        [0.583_590_432_368_916_8, 0.259_695_095_216_464_9],
        [0.860_240_135_656_219_4, 0.062_361_941_900_016_16],
    ],
    [
        [0.069_431_844_202_973_71, 0.173_927_422_568_726_92],
        [0.330_009_478_207_571_87, 0.326_072_577_431_273_05],
        [0.669_990_521_792_428_1, 0.326_072_577_431_273_05],
        [0.930_568_155_797_026_3, 0.173_927_422_568_726_92],
    ],
];

/// Barycentric coordinates and weights (their sum is 1) of a rule of degree 7 on the tetrahedron: the conical product
/// of three Gauss–Jacobi rules, 64 points, all weights positive (Stroud, Approximate Calculation of Multiple Integrals,
/// 1971, section 2.4).
///
/// The error of a quadratic element is cubic where the exact field is smooth, and its square has degree 6; a rule of
/// degree 5 makes it 5 % too small.
pub fn tetrahedron_rule() -> Vec<([f64; 4], f64)> {
    let [first, second, third] = GAUSS_JACOBI;
    let mut rule = Vec::with_capacity(64);
    for [r, by_r] in first {
        for [s, by_s] in second {
            for [t, by_t] in third {
                let (x, y) = (r, (1.0 - r) * s);
                let z = (1.0 - r) * (1.0 - s) * t;
                rule.push(([x, y, z, 1.0 - x - y - z], by_r * by_s * by_t));
            }
        }
    }
    rule
}

/// Barycentric coordinates and weights (their sum is 1) of Radon's rule of degree 5 on the triangle (Zienkiewicz and
/// Taylor, The Finite Element Method, vol. 1, 5th ed., table 9.2, septic).
pub fn triangle_rule() -> [([f64; 3], f64); 7] {
    let (a, wa) = (0.470_142_064_105_115_1, 0.132_394_152_788_506_2);
    let (b, wb) = (0.101_286_507_323_456_34, 0.125_939_180_544_827_15);
    let third = 1.0 / 3.0;
    [
        ([third; 3], 0.225),
        ([1.0 - 2.0 * a, a, a], wa),
        ([a, 1.0 - 2.0 * a, a], wa),
        ([a, a, 1.0 - 2.0 * a], wa),
        ([1.0 - 2.0 * b, b, b], wb),
        ([b, 1.0 - 2.0 * b, b], wb),
        ([b, b, 1.0 - 2.0 * b], wb),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factorial(n: u32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    /// Mean of L₀^a L₁^b … over a simplex of dimension d: d! a! b! … / (d + a + b + …)!.
    #[test]
    fn rules_are_exact_to_their_degree() {
        let fine = tetrahedron_rule();
        for (a, b, c) in (0..=7_u32)
            .flat_map(|a| (0..=7 - a).map(move |b| (a, b)))
            .flat_map(|(a, b)| (0..=7 - a - b).map(move |c| (a, b, c)))
        {
            let degree = a + b + c;
            let product = |at: &[f64]| at[0].powi(a as i32) * at[1].powi(b as i32) * at[2].powi(c as i32);
            let powers = factorial(a) * factorial(b) * factorial(c);
            for (rule, most) in [(STRAIGHT, 2), (CURVED, 3), (&fine, 7)] {
                let solid: f64 = rule.iter().map(|(at, w)| w * product(at)).sum();
                let exact = 6.0 * powers / factorial(3 + degree);
                assert!(degree > most || (solid - exact).abs() < 1e-15, "{} points: {a} {b} {c}", rule.len());
            }
            if degree <= 5 {
                let flat: f64 = triangle_rule().iter().map(|(at, w)| w * product(at)).sum();
                assert!((flat - 2.0 * powers / factorial(2 + degree)).abs() < 1e-15, "{a} {b} {c}");
            }
        }
    }
}
