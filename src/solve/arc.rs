//! A curve of equilibria through limit points, by arc length.
//!
//! In: an equilibrium on a way. Out: the equilibria that follow, stable or not, each with the number of negative eigenvalues of its
//! tangent. The share s of the way is an unknown beside the displacements, and a step of length l goes along the unit tangent t of the
//! curve in the displacements of all nodes; the iteration stays in the plane across t through its end,
//!
//! ```text
//! K d = r + σ ∂r/∂s     t·(d_r + σ d_s) = 0     s ← s + σ
//! ```
//!
//! by two substitutions with each tangent's factor (Riks, Int. J. Solids Struct. 15, 1979, 529-551; Crisfield, Comput. Struct. 13,
//! 1981, 55-62). The length follows the number of Newton's iterations.

use super::error::SolveError;
use super::faer_cholesky::Direct;
use super::newton::{Counts, Imbalance, IterationEnd, Newton, Path, Point};
use super::pushed::{Tangent, fields, matrix};
use super::settle::{largest, sum};
use crate::base::progress::Silent;
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::DMatrix;

/// Change of the share by which rates along the way are found.
const DIFFERENCE: f64 = 1e-6;
const MAX_ITERATIONS: usize = 10;
/// Iterations of a step that is as long as it should be.
const WANTED: f64 = 6.0;
/// A step by this part of the first one is too short to go on.
const SHORTEST: f64 = 1e-3;
/// Least cosine between the tangents at both ends of a step.
const LEAST_COSINE: f64 = 0.7;

/// An equilibrium on the curve.
#[derive(Clone, Debug)]
pub struct ArcPoint {
    pub point: Point,
    pub share: f64,
    /// Number of negative eigenvalues of the tangent: 0 where it is stable.
    pub negative: usize,
}

/// The direction of the curve: displacements of all nodes, of length 1, motions, and share.
struct Heading {
    u: NodeFields,
    q: Vec<f64>,
    share: f64,
}

impl Newton<'_> {
    /// Follows the curve from an equilibrium, at first by about the share `first` and never by steps in which a node moves by more than
    /// `longest`, m, as long as `visit` returns true of each state; a state where it passes share 1 is one of them. Ends where no
    /// step, however short, leads on.
    pub fn trace(
        &self,
        (mut point, mut share): (Point, f64),
        (first, longest): (f64, f64),
        path: &Path<'_>,
        counts: &mut Counts,
        visit: &mut dyn FnMut(&ArcPoint) -> Result<bool, SolveError>,
    ) -> Result<(), SolveError> {
        if self.partition.free.is_empty() {
            return Ok(());
        }
        let k = self.body.tangent(&self.body.gradients(&point.u));
        let direct = Direct::new(&self.partition.a(&k), &Silent)?;
        let Some((mut heading, _)) = self.heading(&direct, (&point, share), path, counts)? else {
            return Ok(());
        };
        let cap =
            |heading: &Heading, length: f64| length.min(longest / largest(&heading.u).max(f64::MIN_POSITIVE));
        let mut length = cap(&heading, first / heading.share.abs().max(f64::MIN_POSITIVE));
        let shortest = SHORTEST * length;
        while length > shortest {
            let ahead = share + length * heading.share;
            let Some((next, to, iterations)) =
                self.advance(&direct, (&point, ahead), (&heading, length), path, counts)?
            else {
                length *= 0.5;
                continue;
            };
            let Some((mut onwards, negative)) = self.heading(&direct, (&next, to), path, counts)? else {
                length *= 0.5;
                continue;
            };
            let way = sum(&next.u, -1.0, &point.u);
            let cosine = onwards.u.dots(&way)[0] / way.norms()[0];
            if cosine.abs() < LEAST_COSINE {
                length *= 0.5;
                continue;
            }
            if cosine < 0.0 {
                onwards.scale(-1.0);
            }
            counts.steps += 1;
            if (share - 1.0) * (to - 1.0) < 0.0 {
                let part = (1.0 - share) / (to - share);
                let between = Point {
                    u: sum(&point.u, part, &way),
                    q: point.q.iter().zip(&next.q).map(|(from, to)| from + part * (to - from)).collect(),
                };
                if let Some(found) = self.end(&direct, between, path, counts)?
                    && !visit(&found)?
                {
                    return Ok(());
                }
            }
            if !visit(&ArcPoint { point: next.clone(), share: to, negative })? {
                return Ok(());
            }
            (point, share, heading) = (next, to, onwards);
            length = cap(&heading, length * (WANTED / iterations as f64).sqrt().clamp(0.5, 2.0));
        }
        Ok(())
    }

    /// Runs `then` with the tangent of a state, what the state lacks of its balance, and the number of negative eigenvalues.
    fn signed<T>(
        &self,
        direct: &Direct,
        (point, share): (&Point, f64),
        counts: &mut Counts,
        then: impl FnOnce(&StiffnessMatrix, &Tangent<'_>, &Imbalance, usize) -> Result<T, SolveError>,
    ) -> Result<Option<T>, SolveError> {
        counts.factorizations += 1;
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let gradients = body.gradients(&point.u);
        let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
        let imbalance = self.imbalance(share, &point.q, &net);
        let k = body.tangent(&gradients);
        let a = self.partition.a(&k);
        let run = || {
            let factor = direct.factor_signed(&a)?;
            let tangent = Tangent::new(self.partition, &k, &factor, &imbalance.border)?;
            then(&k, &tangent, &imbalance, factor.negative() + tangent.negative)
        };
        match run().map_err(IterationEnd::from) {
            Ok(done) => Ok(Some(done)),
            Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// Solves for the rate along the way, a column after those of `free` and `pushes`.
    fn with_rate(
        &self,
        (point, share): (&Point, f64),
        (k, tangent): (&StiffnessMatrix, &Tangent<'_>),
        mut columns: Vec<(NodeFields, DMatrix<f64>)>,
        path: &Path<'_>,
    ) -> Result<Vec<(NodeFields, Vec<f64>)>, SolveError> {
        let (free, pushes, moved) = self.drift(point, share, DIFFERENCE, k, path)?;
        columns.push((free, pushes));
        let scale = |column: usize| if column + 1 == columns.len() { 1.0 / DIFFERENCE } else { 1.0 };
        let free: Vec<DMatrix<f64>> =
            columns.iter().enumerate().map(|(c, (free, _))| matrix(free) * scale(c)).collect();
        let all = DMatrix::from_fn(free[0].nrows(), free.len(), |row, c| free[c][(row, 0)]);
        let count = columns[0].1.nrows();
        let pushes = DMatrix::from_fn(count, columns.len(), |row, c| columns[c].1[(row, 0)] * scale(c));
        let (d, dq) = tangent.solve(&fields(&all), &pushes)?;
        let d = matrix(&d);
        let one = |c: usize| {
            let own = fields(&d.columns(c, 1).into_owned());
            let own = if c + 1 == columns.len() { sum(&own, 1.0 / DIFFERENCE, &moved) } else { own };
            (own, dq.column(c).iter().copied().collect())
        };
        Ok((0..columns.len()).map(one).collect())
    }

    /// The direction of the curve in which the share grows, and the number of negative eigenvalues.
    fn heading(
        &self,
        direct: &Direct,
        at: (&Point, f64),
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<(Heading, usize)>, SolveError> {
        self.signed(direct, at, counts, |k, tangent, _, negative| {
            let mut rate = self.with_rate(at, (k, tangent), Vec::new(), path)?;
            let (u, q) = rate.remove(0);
            let length = u.norms()[0].max(f64::MIN_POSITIVE);
            let mut heading = Heading { u, q, share: 1.0 };
            heading.scale(1.0 / length);
            Ok((heading, negative))
        })
    }

    /// The equilibrium one step along the curve, from a prediction at the share `share`, with its share and the iterations; `None` where
    /// the iteration does not converge.
    fn advance(
        &self,
        direct: &Direct,
        (from, mut share): (&Point, f64),
        (heading, length): (&Heading, f64),
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<(Point, f64, usize)>, SolveError> {
        let ahead = DMatrix::from_column_slice(heading.q.len(), 1, &heading.q);
        let mut point = self.moved(from, length, (&heading.u, &ahead), (share, path));
        self.place(share, path, &mut point);
        for iteration in 1..=MAX_ITERATIONS {
            let solved = self.signed(direct, (&point, share), counts, |k, tangent, imbalance, _| {
                let own = vec![(imbalance.free.clone(), imbalance.pushes.clone())];
                self.with_rate((&point, share), (k, tangent), own, path)
            })?;
            let Some([(own, own_q), (rate, rate_q)]) = solved.as_deref() else { return Ok(None) };
            let by = -heading.u.dots(own)[0] / heading.u.dots(rate)[0];
            let d = sum(own, by, rate);
            if !by.is_finite() || d.norms()[0] > length.max(f64::MIN_POSITIVE) {
                return Ok(None);
            }
            share += by;
            let dq: Vec<f64> = own_q.iter().zip(rate_q).map(|(own, rate)| own + by * rate).collect();
            let dq = DMatrix::from_vec(dq.len(), 1, dq);
            point = self.moved(&point, 1.0, (&d, &dq), (share, path));
            self.place(share, path, &mut point);
            if largest(&d) <= self.last_step * largest(&point.u) {
                return Ok(Some((point, share, iteration)));
            }
        }
        Ok(None)
    }

    /// The equilibrium at share 1 next to `point`.
    fn end(
        &self,
        direct: &Direct,
        mut point: Point,
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<ArcPoint>, SolveError> {
        self.place(1.0, path, &mut point);
        for _ in 0..MAX_ITERATIONS {
            let solved = self.signed(direct, (&point, 1.0), counts, |_, tangent, imbalance, negative| {
                Ok((tangent.solve(&imbalance.free, &imbalance.pushes)?, negative))
            })?;
            let Some(((d, dq), negative)) = solved else { return Ok(None) };
            point = self.moved(&point, 1.0, (&d, &dq), (1.0, path));
            if largest(&d) <= self.last_step * largest(&point.u) {
                return Ok(Some(ArcPoint { point, share: 1.0, negative }));
            }
        }
        Ok(None)
    }
}

impl Heading {
    fn scale(&mut self, by: f64) {
        self.u.data.iter_mut().for_each(|value| *value *= by);
        self.q.iter_mut().for_each(|value| *value *= by);
        self.share *= by;
    }
}
