//! The colours of a field, and their code in a vertex: the CPU's twin of `shaders/common/field.wgsl`.

use egui::ecolor::gamma_u8_from_linear_f32;

/// Linear RGB where a limit is passed; the map has no colour like it.
const BEYOND: [f32; 3] = [0.745, 0.0, 0.262];

/// a and b of OKLab as polynomials of t; the lightness goes from 0.37 to 0.93.
const A: [f32; 4] = [0.061162, -0.441731, 0.185061, 0.141814];
const B: [f32; 4] = [-0.152849, -0.007685, 0.735370, -0.392648];
const LIGHTNESS: [f32; 2] = [0.37, 0.56];

fn oklab(t: f32) -> [f32; 3] {
    let at = |c: [f32; 4]| c[0] + t * (c[1] + t * (c[2] + t * c[3]));
    [LIGHTNESS[0] + LIGHTNESS[1] * t, at(A), at(B)]
}

/// Linear RGB of a part 0 to 1 of the range.
fn linear(t: f32) -> [f32; 3] {
    let [l, a, b] = oklab(t);
    let lms = [
        l + 0.396_337_78 * a + 0.215_803_76 * b,
        l - 0.105_561_346 * a - 0.063_854_17 * b,
        l - 0.089_484_18 * a - 1.291_485_5 * b,
    ]
    .map(|root| root * root * root);
    let row = |c: [f32; 3]| (c[0] * lms[0] + c[1] * lms[1] + c[2] * lms[2]).clamp(0.0, 1.0);
    [
        row([4.076_741_7, -3.307_711_6, 0.230_969_94]),
        row([-1.268_438, 2.609_757_4, -0.341_319_38]),
        row([-0.004_196_086, -0.703_418_6, 1.707_614_7]),
    ]
}

/// sRGB of a part of the range, for a legend; values outside have the colour of the nearer end.
pub fn map_color(t: f32) -> [u8; 3] {
    linear(if t.is_finite() { t.clamp(0.0, 1.0) } else { 1.0 }).map(gamma_u8_from_linear_f32)
}

/// sRGB of values beyond their limit.
pub fn beyond_color() -> [u8; 3] {
    BEYOND.map(gamma_u8_from_linear_f32)
}

/// A vertex' colour in a body that shows a field: its value as a part of the range, and as a part of its limit. Values beyond the
/// range have the colour of its end; those without a limit have a part of 0.
pub fn field_code(part_of_range: f64, part_of_limit: f64) -> [u8; 4] {
    let of = |part: f64| if part.is_nan() { 4095 } else { (4095.0 * part.clamp(0.0, 1.0)).round() as u32 };
    // Just above one half is beyond, whatever rounding does.
    let limit = of(0.5 * part_of_limit);
    let limit = if part_of_limit <= 1.0 { limit.min(2047) } else { limit.max(2048) };
    let bits = of(part_of_range) << 12 | limit;
    [(bits >> 16) as u8, (bits >> 8) as u8, bits as u8, 0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_steps_look_equal_and_every_colour_can_be_shown() {
        let steps: Vec<f32> = (0..100)
            .map(|i| {
                let [p, q] = [i, i + 1].map(|i| oklab(i as f32 / 100.0));
                100.0 * (0..3).map(|k| (q[k] - p[k]).powi(2)).sum::<f32>().sqrt()
            })
            .collect();
        assert!(steps.iter().all(|step| (0.69..0.73).contains(step)), "{steps:?}");
        for i in 0..=100 {
            let color = linear(i as f32 / 100.0);
            assert!(color.iter().all(|c| (0.01..0.95).contains(c)), "{i}: {color:?} is not cut");
        }
        assert_eq!([0.0, 0.5, 1.0].map(map_color), [[70, 33, 141], [49, 162, 159], [249, 239, 45]]);
    }

    #[test]
    fn a_code_keeps_value_and_limit() {
        for (value, limit) in [(0.0, 0.0), (0.25, 0.5), (1.0, 1.0), (0.7, 1.0001), (0.3, 1.7)] {
            let [r, g, b, mark] = field_code(value, limit).map(f64::from);
            let high = (g / 16.0).floor();
            let parts = [(r * 16.0 + high) / 4095.0, ((g - 16.0 * high) * 256.0 + b) / 4095.0];
            assert!((parts[0] - value).abs() < 2e-4 && (2.0 * parts[1] - limit).abs() < 5e-4 && mark == 0.0);
            assert_eq!(parts[1] > 0.5, limit > 1.0);
        }
        assert_eq!(field_code(f64::INFINITY, f64::NAN), field_code(1.0, f64::INFINITY));
    }
}
