//! Logarithm and arc tangent without branches, so that loops over them become vector instructions.

/// ln x of a positive normal number, to two units in the last place: ln 2ᵉ m = e ln 2 + 2 artanh s, s = (m - 1)/(m + 1), |s| < 0.172.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    /// The bits of √½, from which on a mantissa counts to the exponent above.
    const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const MANTISSA: u64 = (1 << 52) - 1;
    // 2⁵² + n has n in its last bits.
    const SHIFT: f64 = 4_503_599_627_370_496.0;
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    let bits = x.to_bits().wrapping_add((1023 << 52) - HALF_ROOT);
    let exponent = f64::from_bits((bits >> 52) | SHIFT.to_bits()) - (SHIFT + 1023.0);
    let m = f64::from_bits((bits & MANTISSA).wrapping_add(HALF_ROOT));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let mut sum = 1.0 / 21.0;
    for k in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        sum = sum * z + 1.0 / k;
    }
    exponent * LN_2[0] + (2.0 * s + (2.0 * s * z * sum + exponent * LN_2[1]))
}

/// The angle of (x, y) from the x axis, within ±π; 0 of (0, 0). Moshier, Methods and Programs for Mathematical Functions, 1989.
#[inline(always)]
pub fn atan2(y: f64, x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    const P: [f64; 5] = [
        -8.750_608_600_031_904e-1,
        -1.615_753_718_733_365e1,
        -7.500_855_792_314_705e1,
        -1.228_866_684_490_136_2e2,
        -6.485_021_904_942_025e1,
    ];
    const Q: [f64; 5] = [
        2.485_846_490_142_306_3e1,
        1.650_270_098_316_988_5e2,
        4.328_810_604_912_903e2,
        4.853_903_996_359_137e2,
        1.945_506_571_482_614e2,
    ];
    let (across, up) = (x.abs(), y.abs());
    let (small, great) = if up < across { (up, across) } else { (across, up) };
    // Above tan π/8, the angle less π/4.
    let is_steep = small > 0.414_213_562_373_095_03 * great;
    let (over, under) = if is_steep { (small - great, small + great) } else { (small, great) };
    let t = over / under.max(f64::MIN_POSITIVE);
    let z = t * t;
    let p = P.iter().fold(0.0, |sum, part| sum * z + part);
    let q = Q.iter().fold(1.0, |sum, part| sum * z + part);
    let angle = t + t * z * p / q + if is_steep { FRAC_PI_4 } else { 0.0 };
    let angle = if up < across { angle } else { FRAC_PI_2 - angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    let angle = if great > 0.0 { angle } else { 0.0 };
    if y < 0.0 { -angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn they_are_those_of_the_standard_library(exponent in -700.0..700.0f64, near in -0.5..0.5f64, x in -1.0..1.0f64, y in -1.0..1.0f64) {
            for value in [exponent.exp(), 1.0 + near, 1.0 + 1e-9 * near] {
                prop_assert!((ln(value) - value.ln()).abs() <= 1e-15 * value.ln().abs(), "{value:e}");
            }
            for scale in [1.0, 1e-3, 1e-12] {
                for (y, x) in [(y, scale * x), (scale * y, x)] {
                    prop_assert!((atan2(y, x) - y.atan2(x)).abs() <= 1e-15 * y.atan2(x).abs(), "{y} {x}");
                }
            }
        }
    }

    #[test]
    fn their_ends_are_finite() {
        use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
        for value in [f64::MIN_POSITIVE, f64::MAX, 1.0, 0.5f64.sqrt(), 2f64.sqrt()] {
            assert!((ln(value) - value.ln()).abs() <= 2e-16 * value.ln().abs(), "{value:e}");
        }
        assert_eq!(
            [atan2(0.0, 0.0), atan2(1.0, 1.0), atan2(1.0, 0.0), atan2(0.0, -1.0)],
            [0.0, FRAC_PI_4, FRAC_PI_2, PI]
        );
    }
}
