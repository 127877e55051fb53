//! A rod in a plane, bent and stretched however far: m' = -r' × n, θ' = m/EI, r' = (1 + n·t/EA) t (Antman, Nonlinear Problems of
//! Elasticity, chapter 4), integrated from one end, and curves of its equilibria.

use nalgebra::{DMatrix, DVector};

/// Place, angle and moment at a point of the rod.
#[derive(Clone, Copy)]
pub struct Section {
    pub x: f64,
    pub y: f64,
    pub angle: f64,
    pub moment: f64,
}

impl Section {
    /// The section a `length` further, in a rod of bending stiffness 1 and stretching stiffness `ea` that carries the force `n`.
    pub fn after(self, length: f64, ea: f64, n: [f64; 2]) -> Section {
        const STEPS: usize = 60;
        let slope = |at: Section| {
            let (sine, cosine) = at.angle.sin_cos();
            let stretch = 1.0 + (n[0] * cosine + n[1] * sine) / ea;
            let (x, y) = (stretch * cosine, stretch * sine);
            Section { x, y, angle: at.moment, moment: y * n[0] - x * n[1] }
        };
        let h = length / STEPS as f64;
        let add = |at: Section, by: f64, d: Section| Section {
            x: at.x + by * d.x,
            y: at.y + by * d.y,
            angle: at.angle + by * d.angle,
            moment: at.moment + by * d.moment,
        };
        (0..STEPS).fold(self, |at, _| {
            let a = slope(at);
            let b = slope(add(at, 0.5 * h, a));
            let c = slope(add(at, 0.5 * h, b));
            let d = slope(add(at, h, c));
            [(a, 1.0), (b, 2.0), (c, 2.0), (d, 1.0)]
                .into_iter()
                .fold(at, |sum, (k, w)| add(sum, w * h / 6.0, k))
        })
    }
}

/// The curve of solutions of N - 1 equations in N unknowns through `start`, in `count` steps of length `step` of the unknowns in parts of
/// their `sizes`; the unknown `first` grows at first.
pub fn curve<const N: usize>(
    sizes: [f64; N],
    start: [f64; N],
    first: usize,
    (step, count): (f64, usize),
    equations: impl Fn(&[f64; N]) -> Vec<f64>,
) -> Vec<[f64; N]> {
    let unknowns = |z: &DVector<f64>| std::array::from_fn(|k| z[k] * sizes[k]);
    let of = |z: &DVector<f64>| DVector::from_iterator(N, equations(&unknowns(z)).into_iter().chain([0.0]));
    let unit = |k: usize, size: f64| DVector::from_fn(N, |row, _| if row == k { size } else { 0.0 });
    let matrix = |z: &DVector<f64>, last: &DVector<f64>| {
        let column = |k: usize| (of(&(z + unit(k, 1e-6))) - of(&(z + unit(k, -1e-6)))) / 2e-6;
        let mut all = DMatrix::from_columns(&(0..N).map(column).collect::<Vec<_>>());
        all.set_row(N - 1, &last.transpose());
        all.lu()
    };
    let (mut z, mut heading) = (DVector::from_fn(N, |k, _| start[k] / sizes[k]), unit(first, 1.0));
    let mut found = Vec::new();
    for number in 0..=count {
        if number > 0 {
            heading = matrix(&z, &heading).solve(&unit(N - 1, 1.0)).unwrap().normalize();
            z += &heading * step;
        }
        for _ in 0..20 {
            let change = matrix(&z, &heading).solve(&of(&z)).unwrap();
            z -= &change;
            if change.norm() < 1e-12 {
                break;
            }
        }
        found.push(unknowns(&z));
    }
    found
}

/// Local extrema of `of` on a curve of points, each by the parabola through three, as the values of `of` and of all of `beside` there.
pub fn extrema<const N: usize>(points: &[[f64; N]], of: usize) -> Vec<[f64; N]> {
    let found = points.windows(3).filter(|w| (w[1][of] - w[0][of]) * (w[2][of] - w[1][of]) < 0.0);
    let vertex = |w: &[[f64; N]]| {
        let length =
            |a: &[f64; N], b: &[f64; N]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let (s0, s2) = (-length(&w[0], &w[1]), length(&w[1], &w[2]));
        // value = w1 + a s + b s².
        let fit = |k: usize| {
            let (d0, d2) = ((w[0][k] - w[1][k]) / s0, (w[2][k] - w[1][k]) / s2);
            let b = (d2 - d0) / (s2 - s0);
            (d0 - b * s0, b)
        };
        let (a, b) = fit(of);
        let s = -a / (2.0 * b);
        std::array::from_fn(|k| {
            let (a, b) = fit(k);
            w[1][k] + a * s + b * s * s
        })
    };
    found.map(vertex).collect()
}
