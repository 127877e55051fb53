//! One mode: ẍ + 2δ ẋ + λ x = a + b t + c t², stepped exactly by its closed form.
//!
//! In: x and ẋ, and the coefficients of the load in the time since the beginning of a step. Out: both at the end, for every step and
//! every damping: the response is that of the differential equation, so that no energy is gained or lost and a mode with λ ≥ 0 cannot
//! become unstable; one with λ < 0 leaves its unstable place as e^(√-λ t) (L. Meirovitch, Fundamentals of Vibrations, McGraw-Hill 2001, sections 2.2 and 3.9).

/// λ = ω² and δ = ζω of a mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillator {
    /// λ, (rad/s)²; 0 of a body that is free to move, negative about an unstable place.
    pub square: f64,
    /// δ, 1/s.
    pub decay: f64,
}

/// Responses after a time t: x to an initial displacement of 1, and x to unit loads of a delta, a step, a ramp and a parabola at t = 0.
///
/// With h the response to a delta, h' + 2δ h is that to a displacement, ∫h to a step, ∫∫h to a ramp and 2 ∫∫∫h to a parabola.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Responses {
    /// x of x(0) = 1, and its rate.
    pub displaced: [f64; 2],
    /// x of ẋ(0) = 1 and its rate: h, h'.
    pub pushed: [f64; 2],
    /// x of a load of 1 and its rate: ∫h, h.
    pub step: [f64; 2],
    /// x of a load of t and its rate: ∫∫h, ∫h.
    pub ramp: [f64; 2],
    /// x of a load of t² and its rate: 2 ∫∫∫h, 2 ∫∫h.
    pub parabola: [f64; 2],
}

/// λ t² and δ t below which the power series is summed, for otherwise digits would cancel.
const SMALL: [f64; 2] = [0.1, 0.2];
/// λ t² below which digits would cancel in the mean of a step.
const SLOW: f64 = 1e-6;
/// Terms of the series, the last below 1e-20 of the first.
const TERMS: usize = 16;

impl Oscillator {
    /// ζ of a mode of a frequency that is not 0; where λ < 0, of √-λ.
    pub fn of_ratio(square: f64, ratio: f64) -> Oscillator {
        Oscillator { square, decay: ratio * square.abs().sqrt() }
    }

    /// The state x, ẋ after `dt_s` under the load a + b t + c t².
    pub fn advanced(&self, state: [f64; 2], load: [f64; 3], dt_s: f64) -> [f64; 2] {
        self.responses(dt_s).follow(state, load)
    }

    /// The mean of x over a step of `dt_s` between two states under that load, from the equation itself: λ ∫x = ∫f - Δẋ - 2δ Δx.
    pub fn mean(&self, [from, to]: [[f64; 2]; 2], [a, b, c]: [f64; 3], dt_s: f64) -> f64 {
        if self.square.abs() * dt_s * dt_s < SLOW {
            // Of the cubic between both states.
            return 0.5 * (from[0] + to[0]) + dt_s * (from[1] - to[1]) / 12.0;
        }
        let pushed = a + dt_s * (b / 2.0 + dt_s * c / 3.0);
        let [displaced, sped] = [to[0] - from[0], to[1] - from[1]];
        (pushed - (sped + 2.0 * self.decay * displaced) / dt_s) / self.square
    }

    /// The energy that damping takes in a step of `dt_s` between two states under that load, ∫ 2δ (ẋ - d)(ẋ - e): d + d' t is the speed that is
    /// not damped, a part of the load, and e that of the observer. By what is left of the balance of all others.
    pub fn dissipated(
        &self,
        [from, to]: [[f64; 2]; 2],
        load: [f64; 3],
        ([speed, rate], observer): ([f64; 2], f64),
        dt_s: f64,
    ) -> f64 {
        let Oscillator { square, decay } = *self;
        if square.abs() * dt_s * dt_s < SLOW {
            // Simpson's rule, with the speed in the middle of the cubic between both states.
            let middle = 1.5 * (to[0] - from[0]) / dt_s - 0.25 * (from[1] + to[1]);
            let taken = |v: f64, part: f64| (v - speed - rate * part * dt_s) * (v - observer);
            let all = taken(from[1], 0.0) + 4.0 * taken(middle, 0.5) + taken(to[1], 1.0);
            return 2.0 * decay * all * dt_s / 6.0;
        }
        let [a, b, c] = load;
        let place = dt_s * self.mean([from, to], load, dt_s);
        let moment = (dt_s * dt_s * (a / 2.0 + dt_s * (b / 3.0 + dt_s * c / 4.0))
            - (dt_s * to[1] - (to[0] - from[0]))
            - 2.0 * decay * (dt_s * to[0] - place))
            / square;
        let [a, b] = [a - 2.0 * decay * speed, b - 2.0 * decay * rate];
        let end = a + dt_s * (b + dt_s * c);
        let work = end * to[0]
            - a * from[0]
            - b * place
            - 2.0 * c * moment
            - observer * dt_s * (a + dt_s * (b / 2.0 + dt_s * c / 3.0));
        let kinetic = (to[1] - observer).powi(2) - (from[1] - observer).powi(2);
        let elastic = square * (to[0] * to[0] - from[0] * from[0]);
        work + observer * square * place - 0.5 * (kinetic + elastic)
    }

    pub fn responses(&self, t: f64) -> Responses {
        let Oscillator { square, decay } = *self;
        if square.abs() * t * t < SMALL[0] {
            return if decay * t < SMALL[1] { self.series(t) } else { self.halved(t) };
        }
        let (cosine, sine) = self.shaken(t);
        // displaced = e^(-δt)(C + δS), h = e^(-δt) S.
        let displaced = cosine + decay * sine;
        let by_step = (1.0 - displaced) / square;
        let by_ramp = (t - 2.0 * decay * by_step - sine) / square;
        Responses {
            displaced: [displaced, -square * sine],
            pushed: [sine, cosine - decay * sine],
            step: [by_step, sine],
            ramp: [by_ramp, by_step],
            parabola: [(t * t - 4.0 * decay * by_ramp - 2.0 * by_step) / square, 2.0 * by_ramp],
        }
    }

    /// e^(-δt) cos ωt and e^(-δt) sin ωt / ω with ω² = λ - δ², which may be negative: cosh and sinh then.
    fn shaken(&self, t: f64) -> (f64, f64) {
        let Oscillator { square, decay } = *self;
        let beaten = square - decay * decay;
        if (beaten * t * t).abs() < 1e-8 {
            let (fading, turn) = ((-decay * t).exp(), beaten * t * t);
            return (fading * (1.0 - turn / 2.0), fading * t * (1.0 - turn / 6.0));
        }
        if beaten > 0.0 {
            let (fading, rate) = ((-decay * t).exp(), beaten.sqrt());
            let (sine, cosine) = (rate * t).sin_cos();
            return (fading * cosine, fading * sine / rate);
        }
        let rate = (-beaten).sqrt();
        // Both exponents are negative where λ is not, so that none overflows; δ - rate would lose its digits.
        let slow = (-square / (decay + rate) * t).exp();
        let fast = (-(decay + rate) * t).exp();
        (0.5 * (slow + fast), 0.5 * (slow - fast) / rate)
    }

    /// y = ∫∫h solves ÿ + 2δẏ + λy = t with y(0) = ẏ(0) = 0; c_k of its power series follow from each other.
    fn series(&self, t: f64) -> Responses {
        let Oscillator { square, decay } = *self;
        let mut c = [0.0; TERMS + 2];
        for k in 0..TERMS {
            let own = if k == 1 { 1.0 } else { 0.0 };
            let next = (k + 1) as f64;
            c[k + 2] = (own - 2.0 * decay * next * c[k + 1] - square * c[k]) / (next * (next + 1.0));
        }
        // y and its first three derivatives; its integral over t.
        let (mut y, mut integral) = ([0.0; 4], 0.0);
        for k in (0..c.len()).rev() {
            let k_ = k as f64;
            integral = integral * t + c[k] / (k_ + 1.0);
            let factors = [1.0, k_, k_ * (k_ - 1.0), k_ * (k_ - 1.0) * (k_ - 2.0)];
            for (order, (y, factor)) in y.iter_mut().zip(factors).enumerate() {
                if k >= order {
                    *y = *y * t + factor * c[k];
                }
            }
        }
        let [ramp, step, pushed, rate] = y;
        Responses {
            displaced: [rate + 2.0 * decay * pushed, -square * pushed],
            pushed: [pushed, rate],
            step: [step, pushed],
            ramp: [ramp, step],
            parabola: [2.0 * t * integral, 2.0 * ramp],
        }
    }

    /// Two steps of half the time, for a mode that is slow and damped much.
    fn halved(&self, t: f64) -> Responses {
        // Its own halves end, for δ t falls by half each time; beyond e^-700 nothing moves.
        if self.decay * t > 1e6 {
            return self.creeping(t);
        }
        let half = self.responses(0.5 * t);
        let nothing = [0.0; 3];
        Responses {
            displaced: half.follow(half.displaced, nothing),
            pushed: half.follow(half.pushed, nothing),
            step: half.follow(half.step, [1.0, 0.0, 0.0]),
            ramp: half.follow(half.ramp, [0.5 * t, 1.0, 0.0]),
            parabola: half.follow(half.parabola, [0.25 * t * t, t, 1.0]),
        }
    }

    /// The limit δ t → ∞ with λ t² small: 2δ ẋ = a + b t.
    fn creeping(&self, t: f64) -> Responses {
        let soft = 0.5 / self.decay;
        Responses {
            displaced: [1.0, 0.0],
            pushed: [soft, 0.0],
            step: [soft * t, soft],
            ramp: [0.5 * soft * t * t, soft * t],
            parabola: [soft * t.powi(3) / 3.0, soft * t * t],
        }
    }
}

impl Responses {
    /// x and ẋ after the time of these responses, under the load a + b t + c t².
    fn follow(&self, [x, v]: [f64; 2], [a, b, c]: [f64; 3]) -> [f64; 2] {
        let Responses { displaced, pushed, step, ramp, parabola } = self;
        [0, 1].map(|i| x * displaced[i] + v * pushed[i] + a * step[i] + b * ramp[i] + c * parabola[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fourth-order Runge and Kutta steps, fine enough for twelve digits.
    fn integrated(of: &Oscillator, state: [f64; 2], [a, b, c]: [f64; 3], t: f64) -> [f64; 2] {
        let steps = 40_000;
        let h = t / f64::from(steps);
        let rate =
            |[x, v]: [f64; 2], at: f64| [v, a + at * (b + c * at) - 2.0 * of.decay * v - of.square * x];
        let mut s = state;
        for n in 0..steps {
            let at = f64::from(n) * h;
            let plus = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
            let k1 = rate(s, at);
            let k2 = rate(plus(s, k1, h / 2.0), at + h / 2.0);
            let k3 = rate(plus(s, k2, h / 2.0), at + h / 2.0);
            let k4 = rate(plus(s, k3, h), at + h);
            s = [0, 1].map(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        s
    }

    #[test]
    fn every_damping_is_stepped_as_the_differential_equation() {
        for square in [-3.0, -0.02, 0.0, 1e-9, 0.05, 1.0, 40.0] {
            for decay in [0.0, 1e-6, 0.05, 1.0, f64::sqrt(40.0), 9.0] {
                let of = Oscillator { square, decay };
                let (state, load, t) = ([0.3, -1.2], [0.7, 2.0, -1.1], 1.3);
                let (found, expected) = (of.advanced(state, load, t), integrated(&of, state, load, t));
                for (found, expected) in found.iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-10, "{of:?}: {found} {expected}");
                }
            }
        }
    }

    /// Means against Simpson's rule over the closed form.
    #[test]
    fn the_mean_of_a_step_is_its_integral() {
        for square in [-3.0, 0.0, 1e-9, 0.05, 1.0, 40.0] {
            for decay in [0.0, 0.05, 1.0, 9.0] {
                let of = Oscillator { square, decay };
                let (state, load, t) = ([0.3, -1.2], [0.7, 2.0, -1.1], 1.3);
                let at = |n: u32| of.advanced(state, load, t * f64::from(n) / 2000.0);
                let weight = |n: u32| if n == 0 || n == 2000 { 1.0 } else { f64::from(2 + 2 * (n % 2)) };
                let expected = (0..=2000).map(|n| weight(n) * at(n)[0]).sum::<f64>() / 6000.0;
                let found = of.mean([state, at(2000)], load, t);
                // Of a slow mode: a parabola as a load leaves the cubic by c t⁴/360. None is damped much within a step.
                let is_slow = square.abs() < 1e-6;
                if is_slow && decay > 0.1 {
                    continue;
                }
                let off = if is_slow { 1.2e-2 } else { 1e-11 };
                assert!((found - expected).abs() < off, "{of:?}: {found} {expected}");
                let (speed, observer) = ([0.4, -0.3], 0.2);
                let rate = |n: u32| {
                    let v = at(n)[1];
                    let undamped = speed[0] + speed[1] * t * f64::from(n) / 2000.0;
                    2.0 * decay * (v - undamped) * (v - observer)
                };
                let expected = (0..=2000).map(|n| weight(n) * rate(n)).sum::<f64>() * t / 6000.0;
                let found = of.dissipated([state, at(2000)], load, (speed, observer), t);
                let off = if is_slow { 0.05 * expected.abs() } else { 1e-8 };
                assert!((found - expected).abs() <= off, "{of:?}: {found} {expected}");
            }
        }
    }

    /// The series and the closed form meet, and so do under- and overdamped responses.
    #[test]
    fn the_forms_of_the_response_agree_where_they_meet() {
        for decay in [0.0, 0.15, 0.3, 0.316, 0.317, 3.0, 400.0] {
            let of = Oscillator { square: 0.1, decay };
            let all = |r: Responses| [r.displaced, r.pushed, r.step, r.ramp, r.parabola].concat();
            let (before, after) = (all(of.responses(1.0 - 1e-9)), all(of.responses(1.0 + 1e-9)));
            for (a, b) in before.iter().zip(&after) {
                assert!((a - b).abs() < 1e-8 * (1.0 + decay), "{decay}: {a} {b}");
            }
        }
    }

    #[test]
    fn no_step_is_too_long_or_too_short() {
        for square in [0.0, 1e-12, 1e2, 1e14] {
            for decay in [0.0, 1e-3, 1e3, 1e9] {
                for t in [0.0, 1e-9, 1e-3, 1.0, 1e6] {
                    let of = Oscillator { square, decay };
                    let [x, v] = of.advanced([1.0, 0.0], [0.0; 3], t);
                    assert!(
                        x.abs() <= 1.0 + 1e-9 && v.abs() <= (1.0 + 1e-9) * square.sqrt(),
                        "{of:?} {t}: {x} {v}"
                    );
                }
                assert_eq!(Oscillator { square, decay }.advanced([0.2, 0.3], [1.0; 3], 0.0), [0.2, 0.3]);
            }
        }
    }

    /// Energy of an undamped mode over 10⁶ steps of a fifth of its period.
    #[test]
    fn an_undamped_mode_keeps_its_energy() {
        let of = Oscillator { square: 30.0, decay: 0.0 };
        let energy = |[x, v]: [f64; 2]| 0.5 * (v * v + of.square * x * x);
        let mut state = [0.4, 1.0];
        let before = energy(state);
        for _ in 0..1_000_000 {
            state = of.advanced(state, [0.0; 3], 0.23);
        }
        assert!((energy(state) / before - 1.0).abs() < 1e-9, "{:e}", energy(state) / before - 1.0);
    }
}
