//! A symmetric cubic form Θ(c) = Σ_{p≤q≤r} θ_pqr c_p c_q c_r, and its gradient.

/// A symmetric cubic form by its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct CubicForm {
    variables: usize,
    /// θ_pqr, r running fastest, then q.
    coefficients: Vec<f64>,
}

impl CubicForm {
    /// Number of coefficients of a form in n variables: n (n + 1)(n + 2)/6.
    pub const fn coefficients_of(variables: usize) -> usize {
        variables * (variables + 1) * (variables + 2) / 6
    }

    /// `None` where there are not [`CubicForm::coefficients_of`] the variables.
    pub fn new(variables: usize, coefficients: Vec<f64>) -> Option<CubicForm> {
        (coefficients.len() == CubicForm::coefficients_of(variables))
            .then_some(CubicForm { variables, coefficients })
    }

    pub fn variables(&self) -> usize {
        self.variables
    }

    /// Θ(c) and ∂Θ/∂c.
    pub fn evaluate(&self, c: &[f64], gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let (mut total, mut at) = (0.0, 0);
        for p in 0..self.variables {
            let mut of_p = 0.0;
            for q in p..self.variables {
                let row = &self.coefficients[at..at + self.variables - q];
                at += row.len();
                let pair = c[p] * c[q];
                let mut of_pair = 0.0;
                for ((theta, c), g) in row.iter().zip(&c[q..]).zip(&mut gradient[q..]) {
                    of_pair += theta * c;
                    *g += theta * pair;
                }
                of_p += of_pair * c[q];
                gradient[q] += of_pair * c[p];
            }
            gradient[p] += of_p;
            total += of_p * c[p];
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_form() {
        let n = 5;
        let coefficients = (0..CubicForm::coefficients_of(n)).map(|i| (1.3 * i as f64).sin()).collect();
        let form = CubicForm::new(n, coefficients).unwrap();
        let c: Vec<f64> = (0..n).map(|i| 0.4 + (2.1 * i as f64).cos()).collect();
        let (mut gradient, mut unused) = (vec![0.0; n], vec![0.0; n]);
        let value = form.evaluate(&c, &mut gradient);
        // Euler: c·∂Θ = 3 Θ.
        let euler: f64 = c.iter().zip(&gradient).map(|(c, g)| c * g).sum();
        assert!((euler - 3.0 * value).abs() < 1e-13);
        for k in 0..n {
            let mut at = |by: f64| {
                let mut c = c.clone();
                c[k] += by;
                form.evaluate(&c, &mut unused)
            };
            let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((gradient[k] - expected).abs() < 1e-8, "{k}");
        }
        assert!(CubicForm::new(4, vec![0.0; 19]).is_none());
    }
}
