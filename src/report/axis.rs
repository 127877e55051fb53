//! An axis: the pixel of each value, and its ticks.

use crate::measure::units::Unit;

/// Room at the low end of a logarithmic axis for values of exactly zero, pixels, and for those below a floor.
const ZERO_BAND: f64 = 26.0;
const FLOOR_BAND: f64 = 60.0;
/// Values are clamped to this range before their logarithm is taken.
const SMALLEST: f64 = 1e-300;
const LARGEST: f64 = 1e300;

#[derive(Clone, Debug)]
pub struct Axis {
    pub unit: Unit,
    pub logarithmic: bool,
    pub low: f64,
    pub high: f64,
    /// Pixels of `low` and `high`.
    pub from: f64,
    pub to: f64,
    /// Pixel of zero, where zeros were given and the axis is logarithmic.
    pub zero: Option<f64>,
    /// Value below which numbers are shown as zero.
    pub floor: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    pub value: f64,
    /// Empty: a grid line only.
    pub label: String,
}

impl Axis {
    /// An axis that shows all `values` (finite, not negative), with room on both sides: 16 % of the decades, or, where
    /// they are all equal, a factor of two. A linear axis begins at zero.
    pub fn new(values: &[f64], unit: Unit, logarithmic: bool, from: f64, to: f64) -> Axis {
        let above = |least: f64| values.iter().copied().filter(move |&v| v > least);
        let highest = above(0.0).fold(0.0, f64::max);
        if !logarithmic {
            let high = if highest > SMALLEST { (1.05 * highest).min(LARGEST) } else { 1.0 };
            return Axis { unit, logarithmic, low: 0.0, high, from, to, zero: None, floor: 0.0 };
        }
        let zeros = above(-1.0).any(|v| v == 0.0);
        let highest = if highest > 0.0 { highest.clamp(SMALLEST, LARGEST) } else { 1.0 };
        let lowest = above(0.0).fold(highest, f64::min).clamp(SMALLEST, highest);
        let room = (0.08 * (highest.log10() - lowest.log10())).clamp(0.15, 1.0);
        let low = (lowest / 10_f64.powf(room)).max(SMALLEST);
        let high = (highest * 10_f64.powf(room)).min(10.0 * LARGEST);
        let start = if zeros { from + ZERO_BAND * (to - from).signum() } else { from };
        let zero = zeros.then_some(from + 0.5 * ZERO_BAND * (to - from).signum());
        Axis { unit, logarithmic, low, high, from: start, to, zero, floor: 0.0 }
    }

    /// A logarithmic axis for values of at least `floor`; all smaller values are shown at the place of zero.
    pub fn above(floor: f64, values: &[f64], unit: Unit, from: f64, to: f64) -> Axis {
        let values: Vec<f64> = values.iter().map(|&v| if v < floor { 0.0 } else { v }).collect();
        let wide = (FLOOR_BAND - ZERO_BAND) * (to - from).signum();
        let start = if floor > 0.0 && values.contains(&0.0) { from + wide } else { from };
        Axis { floor, ..Axis::new(&values, unit, true, start, to) }
    }

    /// The pixel of a value; values beyond the ends stand at them.
    pub fn at(&self, value: f64) -> f64 {
        if let (Some(zero), true) = (self.zero, value <= self.floor) {
            return zero;
        }
        let share = if self.logarithmic {
            (value.max(SMALLEST).log10() - self.low.log10()) / self.decades()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + share.clamp(0.0, 1.0) * (self.to - self.from)
    }

    fn decades(&self) -> f64 {
        self.high.log10() - self.low.log10()
    }

    /// Ascending, inside the axis; 2 to 12 of them with labels, all different.
    pub fn ticks(&self) -> Vec<Tick> {
        if !self.logarithmic {
            let turn = [15.0, 30.0, 45.0, 90.0].into_iter().find(|step| self.high <= 9.0 * step);
            let whole = turn.filter(|_| self.unit == Unit::Degrees && self.high > 45.0);
            return self.labelled(match whole {
                Some(step) => (0..10).map(|i| step * f64::from(i)).filter(|v| *v <= self.high).collect(),
                None => linear(self.low, self.high),
            });
        }
        let decades = self.decades();
        if decades < 3.0 {
            for mantissas in [&[1.0, 2.0, 5.0][..], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]] {
                let values = self.products(mantissas);
                if (3..=12).contains(&values.len()) {
                    return self.labelled(values);
                }
            }
            if decades < 1.0 {
                return self.labelled(linear(self.low, self.high));
            }
        }
        // Whole decades, every second or third where there are many.
        let first = self.low.log10().ceil() as i32;
        let last = self.high.log10().floor() as i32;
        let stride = (last - first) / 9 + 1;
        let tick = |exponent: i32| {
            let value = decimal(1.0, exponent);
            let label = if exponent.rem_euclid(stride) == 0 { self.unit.text(value) } else { String::new() };
            Tick { value, label }
        };
        let inside = |tick: &Tick| tick.value >= self.low && tick.value <= self.high;
        let shown = |tick: &Tick| inside(tick) && (stride <= 3 || !tick.label.is_empty());
        (first..=last).map(tick).filter(shown).collect()
    }

    fn labelled(&self, values: Vec<f64>) -> Vec<Tick> {
        values.into_iter().map(|value| Tick { value, label: self.unit.text(value) }).collect()
    }

    /// Mantissas times powers of ten, as far as they are inside.
    fn products(&self, mantissas: &[f64]) -> Vec<f64> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let all = (first..=last).flat_map(|e| mantissas.iter().map(move |m| decimal(*m, e)));
        all.filter(|value| (self.low..=self.high).contains(value)).collect()
    }
}

/// The double nearest to `mantissa` times 10 to the power of `exponent`: `powi` is off by some units in the last place.
fn decimal(mantissa: f64, exponent: i32) -> f64 {
    format!("{mantissa}e{exponent}").parse().unwrap_or(f64::INFINITY)
}

/// Three to ten round numbers inside.
fn linear(low: f64, high: f64) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let decade = rough.log10().floor() as i32;
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| decimal(m, decade)).find(|step| *step >= rough);
    let Some(step) = step else { return Vec::new() };
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last.min(first + 12)).map(|i| i as f64 * step).filter(|v| (low..=high).contains(v)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(values: &[f64], unit: Unit) -> Vec<String> {
        let ticks = Axis::new(values, unit, true, 0.0, 100.0).ticks();
        ticks.into_iter().map(|tick| tick.label).filter(|label| !label.is_empty()).collect()
    }

    #[test]
    fn decades_and_what_lies_between() {
        assert_eq!(labels(&[2e-7, 3e-3], Unit::Ratio), ["10⁻⁷", "0.0001 %", "0.001 %", "0.01 %", "0.1 %"]);
        assert_eq!(
            labels(&[4e-5, 1e-4], Unit::Seconds),
            ["30 µs", "40 µs", "50 µs", "60 µs", "70 µs", "80 µs", "90 µs", "100 µs"]
        );
        assert_eq!(
            labels(&[2e3, 4e5], Unit::Bytes),
            ["2 kB", "5 kB", "10 kB", "20 kB", "50 kB", "100 kB", "200 kB", "500 kB"]
        );
        assert_eq!(
            labels(&[3e-15, 1.0], Unit::Ratio),
            ["10⁻¹⁴", "10⁻¹²", "10⁻¹⁰", "10⁻⁸", "0.0001 %", "0.01 %", "1 %", "100 %"]
        );
    }

    #[test]
    fn zeros_have_their_own_place_below_all_others() {
        let axis = Axis::new(&[0.0, 1e-8, 1e-2], Unit::Ratio, true, 400.0, 50.0);
        assert_eq!(axis.at(0.0), 387.0);
        assert!(axis.at(1e-8) < 374.0 && axis.at(1e-2) > 50.0);
        let only = Axis::new(&[0.0], Unit::Ratio, true, 400.0, 50.0);
        assert!(only.at(0.0) == 387.0 && only.ticks().len() >= 2);
    }

    fn positive() -> impl Strategy<Value = f64> {
        (-310.0_f64..305.0).prop_map(|e| 10_f64.powf(e))
    }

    proptest! {
        #[test]
        fn ticks_ascend_inside_the_axis(
            values in prop::collection::vec(prop_oneof![9 => positive(), 1 => Just(0.0)], 1..6),
            near in prop_oneof![Just(1.0), 1.0_f64..4.0],
            logarithmic in any::<bool>(),
            unit in prop_oneof![Just(Unit::Ratio), Just(Unit::Seconds), Just(Unit::Bytes), Just(Unit::Metres)],
        ) {
            let mut values = values;
            values.push(values[0] * near);
            let axis = Axis::new(&values, unit, logarithmic, 400.0, 50.0);
            let ticks = axis.ticks();
            prop_assert!(ticks.windows(2).all(|pair| pair[0].value < pair[1].value), "{ticks:?}");
            prop_assert!(ticks.windows(2).all(|pair| axis.at(pair[0].value) > axis.at(pair[1].value)), "{ticks:?}");
            prop_assert!(ticks.iter().all(|t| t.value >= axis.low && t.value <= axis.high), "{ticks:?}");
            let labels: Vec<&String> = ticks.iter().map(|t| &t.label).filter(|l| !l.is_empty()).collect();
            prop_assert!((2..=12).contains(&labels.len()), "{axis:?} {labels:?}");
            prop_assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{labels:?}");
            for value in values {
                prop_assert!((50.0..=400.0).contains(&axis.at(value)));
            }
        }

        #[test]
        fn larger_values_stand_further(a in positive(), b in positive()) {
            let axis = Axis::new(&[a, b, 0.0], Unit::Ratio, true, 400.0, 50.0);
            prop_assert!(a.min(b) == a.max(b) || axis.at(a.min(b)) >= axis.at(a.max(b)));
        }
    }
}
