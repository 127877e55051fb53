//! The least and the largest eigenvalue of a preconditioned matrix, as conjugate gradients see them.

/// The ends of the preconditioned matrix' spectrum as the iterations saw them, from inside.
#[derive(Clone, Copy, Default)]
pub struct Spectrum {
    pub ends: Option<[f64; 2]>,
}

impl Spectrum {
    /// Takes the coefficients α, β of one run of iterations: conjugate gradients are Lanczos in disguise, and those of one
    /// run make one tridiagonal matrix T (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., section 6.7.3).
    pub fn widen(&mut self, coefficients: &[[f64; 2]]) {
        let mut diagonal = Vec::with_capacity(coefficients.len());
        // Square of the number beside the diagonal, in the row after it.
        let mut beside = Vec::with_capacity(coefficients.len());
        let mut before = None;
        for &[alpha, beta] in coefficients {
            let (shift, square) =
                before.map_or((0.0, 0.0), |[alpha, beta]: [f64; 2]| (beta / alpha, beta / (alpha * alpha)));
            diagonal.push(1.0 / alpha + shift);
            beside.push(square);
            before = Some([alpha, beta]);
        }
        let Some([low, high]) = ends(&diagonal, &beside) else { return };
        let known = self.ends.unwrap_or([low, high]);
        self.ends = Some([known[0].min(low), known[1].max(high)]);
    }
}

/// The least and the largest eigenvalue of a symmetric tridiagonal matrix, by bisection with Sturm sequences (Golub and
/// Van Loan, Matrix Computations, 4th ed., section 8.4.1); `None` where it has no row.
fn ends(diagonal: &[f64], beside: &[f64]) -> Option<[f64; 2]> {
    let size = diagonal.len();
    let reach = |row: usize| beside[row].sqrt() + beside.get(row + 1).map_or(0.0, |square| square.sqrt());
    let rows = || (0..size).map(|row| (diagonal[row] - reach(row), diagonal[row] + reach(row)));
    let high = rows().map(|(_, high)| high).reduce(f64::max)?;
    let low = rows().map(|(low, _)| low).reduce(f64::min)?.max(0.0);
    // Eigenvalues below `at`: negative pivots of T - at.
    let below = |at: f64| {
        let mut pivot = 1.0;
        let count = |row: usize| {
            pivot = diagonal[row] - at - if row == 0 { 0.0 } else { beside[row] / pivot };
            if pivot == 0.0 {
                pivot = f64::MIN_POSITIVE;
            }
            pivot < 0.0
        };
        (0..size).map(count).filter(|negative| *negative).count()
    };
    let end = |least: bool| {
        let (mut low, mut high) = (low, high);
        // Towards 0 the logarithm is halved first: the least may be many powers of ten below the largest.
        for _ in 0..200 {
            let middle = if low > 0.0 && high > 2.0 * low { (low * high).sqrt() } else { 0.5 * (low + high) };
            if middle <= low || middle >= high {
                break;
            }
            let most = if least { 0 } else { size - 1 };
            if below(middle) > most {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    };
    Some([end(true), end(false)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// -u'' on n points: eigenvalues 2 - 2 cos(k π / (n + 1)).
    #[test]
    fn bisection_finds_the_ends_of_a_known_spectrum() {
        for size in [1, 2, 7, 1000] {
            let mut beside = vec![1.0; size];
            beside[0] = 0.0;
            let [low, high] = ends(&vec![2.0; size], &beside).unwrap();
            let exact = |k: f64| 2.0 - 2.0 * (k * std::f64::consts::PI / (size as f64 + 1.0)).cos();
            assert!((low / exact(1.0) - 1.0).abs() < 1e-9, "{size}: {low} of {}", exact(1.0));
            assert!((high / exact(size as f64) - 1.0).abs() < 1e-9, "{size}: {high}");
        }
        assert_eq!(ends(&[], &[]), None);
    }

    /// Runs of α = 1/2, β = 0 see the eigenvalue 2 and nothing else, however many there are.
    #[test]
    fn every_run_has_a_spectrum_of_its_own() {
        let mut spectrum = Spectrum::default();
        spectrum.widen(&[]);
        assert_eq!(spectrum.ends, None);
        let is = |spectrum: &Spectrum, ends: [f64; 2]| {
            let found = spectrum.ends.unwrap();
            assert!((0..2).all(|end| (found[end] - ends[end]).abs() < 1e-12), "{found:?}");
        };
        spectrum.widen(&[[0.5, 3.0]]);
        spectrum.widen(&[[0.5, 3.0]]);
        is(&spectrum, [2.0, 2.0]);
        spectrum.widen(&[[0.25, 3.0]]);
        is(&spectrum, [2.0, 4.0]);
    }
}
