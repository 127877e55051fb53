//! The q at which a strain energy V(1, y, q) is least for given y.
//!
//! In: y. Out: q with ∂V/∂q = 0, by Newton's method from the last q, predicted along the tangent dq/dy. The factored second
//! derivatives are kept while they serve, mended by the last steps ([`Secants`]), so that most steps cost one evaluation of the
//! slopes; the tangent is mended by what the prediction missed (C. Broyden, Math. Comp. 19, 1965, 577-593). Each step is shortened
//! until V falls (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithms 3.1 and 3.2). A q that is stationary but not stable
//! is left along its mode, so that a slender body that is pressed straight along its axis buckles. Allocates nothing.

use super::secants::Secants;
use super::strain_energy::StrainEnergy;
use crate::deform::loads::LoadedPotential;
use crate::deform::memory::Unknowns;
use crate::solve::envelope::Envelope;
use crate::solve::minimise::{Energy, Step, minimise};

/// A step that promises to lower V by less than this part of it is the last, and is taken without another evaluation: what
/// it leaves is of the order of its square, or a third of it where the second derivatives are old.
const LAST: f64 = 1e-12;
/// A step that promises less than the first of these parts of V, and changes the squares of the forces by less than the second, is the last
/// too: it changes the forces by 10⁻⁵, of which a third is left where the second derivatives are old.
const NEARLY_LAST: [f64; 2] = [1e-9, 1e-10];
/// A step with old second derivatives that leaves more than this part of the promised decrease is the last such one.
const SERVES: f64 = 0.1;
/// Second derivatives do not serve where V is more than so many times that with which they were made: a body that is pressed along its
/// axis has no other sign that it is not stable.
const GREW: f64 = 2.0;
const MOST_STEPS: usize = 60;
/// Least shift of second derivatives that are not positive definite, in parts of the largest on their diagonal.
const SHIFT: f64 = 1e-4;
/// Steps of the iteration for the mode along which V falls most.
const MODE_STEPS: usize = 20;
/// A curvature of V along its mode that is above this, in parts of the largest by one q, is 0 but for rounding.
const FALLS: f64 = -1e-6;
/// Rounding errors of V, as a part of it.
const ROUNDING: f64 = 1e-12;
/// A change of y that is smaller than this, in metres and parts, says nothing of the tangent: what is left of q by rounding,
/// over so little, would be taken for its slope, and the next prediction would lead to another equilibrium.
const SAYS_NOTHING: f64 = 1e-6;
/// The way before shows how q bends away from its tangent if this one is 1/4 to 4 times as long and leads within 27° in its
/// direction: the ratio of the lengths, and the square of the cosine.
const AS_LONG: [f64; 2] = [0.25, 4.0];
const AS_STRAIGHT: f64 = 0.8;
/// Evaluations beyond which an equilibrium is a long one, where the second derivatives that slopes near it need are there, and
/// where they are not; one of second derivatives counts as two.
const USUAL_WORK: [usize; 2] = [3, 2];
/// y beyond those of undeformed elements count as 0 below this; where loads are taken away, so does the energy of such a y.
const NOTHING: f64 = 1e-9;

/// The energy with where it was last in equilibrium.
pub struct ReducedBody {
    energy: Box<dyn StrainEnergy>,
    /// An energy that counts as none, J.
    nothing: f64,
    /// z = (1, coordinates y of undeformed elements, q, the other y).
    rigid: usize,
    fields: usize,
    z: Vec<f64>,
    slopes: Vec<f64>,
    factor: Envelope,
    /// dq/dz row by row, as many columns as `active`, those of q being unused.
    tangent: Vec<f64>,
    cross: Vec<f64>,
    /// ½ ∂²V/∂z_k² at rest.
    stiffness: Vec<f64>,
    /// Number of variables of z with which the factor and the tangent were made, 0 where there are none.
    active: usize,
    step: Vec<f64>,
    /// V, or the numbers that make it up, in the last equilibrium and where the factor was made.
    magnitude: f64,
    made_at: f64,
    /// Secants since the factor was made, and the slopes by q before the step that is tried.
    secants: Secants,
    slopes_before: Vec<f64>,
    /// The last z, and the z that is tried.
    before: Vec<f64>,
    trial: Vec<f64>,
    /// The last change of y in the places of z, and by how much q missed its tangent then.
    change: Vec<f64>,
    missed: Vec<f64>,
    /// Evaluations for the last equilibrium, and whether the tangent was made in it.
    work: usize,
    is_fresh: bool,
    /// The factor of the part by q of ∂²V/∂z² at an earlier equilibrium, if that has one; the slopes that were found with it.
    beside: Envelope,
    has_beside: bool,
    slopes_beside: Vec<f64>,
}

impl ReducedBody {
    /// The body of an energy of (1, `rigid` y, `fields` q, `others` y).
    pub fn new([rigid, fields, others]: [usize; 3], energy: Box<dyn StrainEnergy>) -> ReducedBody {
        let n = 1 + rigid + fields + others;
        let mut z = vec![0.0; n];
        z[0] = 1.0;
        let stiffness: Vec<f64> = (0..n).map(|k| if k == 0 { 0.0 } else { energy.stiffness(k) }).collect();
        let stiffest = stiffness.iter().copied().fold(0.0, f64::max);
        let factor = Envelope::square(fields);
        ReducedBody {
            nothing: NOTHING * NOTHING * stiffest,
            stiffness,
            energy,
            rigid,
            fields,
            before: z.clone(),
            trial: z.clone(),
            z,
            slopes: vec![0.0; n],
            beside: factor.clone(),
            has_beside: false,
            slopes_beside: vec![0.0; n],
            factor,
            tangent: vec![0.0; fields * n],
            cross: vec![0.0; fields * n],
            active: 0,
            step: vec![0.0; fields],
            magnitude: 0.0,
            made_at: 0.0,
            secants: Secants::new(fields),
            slopes_before: vec![0.0; fields],
            change: vec![0.0; n],
            missed: vec![0.0; fields],
            work: 0,
            is_fresh: false,
        }
    }

    /// Whether the last equilibrium left little time for slopes near it.
    pub fn was_long(&self) -> bool {
        self.work > USUAL_WORK[usize::from(!self.energy.is_prepared())]
    }

    /// q, as it was last found.
    pub fn q(&self) -> &[f64] {
        &self.z[1 + self.rigid..][..self.fields]
    }

    /// Whether it is inside out where the points are at which its law is summed.
    pub fn is_inverted(&self) -> bool {
        self.energy.is_inverted(&self.z)
    }

    /// Index of the k-th y in z.
    fn place(&self, k: usize) -> usize {
        if k < self.rigid { 1 + k } else { 1 + self.fields + k }
    }

    /// ∂V/∂y of the k-th y.
    pub fn slope(&self, k: usize) -> f64 {
        self.slopes[self.place(k)]
    }

    /// Count of the numbers that [`ReducedBody::keep`] adds.
    pub fn kept(&self) -> usize {
        let made = self.factor.entries().len() + self.tangent.len() + self.cross.len();
        3 * self.z.len() + self.fields + 3 + made + self.secants.kept()
    }

    /// Adds the last equilibrium with its slopes, and the factor and the tangent with which the next one is found.
    pub fn keep(&self, unknowns: &mut Vec<f64>) {
        unknowns.extend(self.z.iter().chain(&self.slopes));
        unknowns.extend([self.active as f64, self.magnitude, self.made_at]);
        unknowns.extend(self.factor.entries().iter().chain(&self.tangent).chain(&self.cross));
        unknowns.extend(self.change.iter().chain(&self.missed));
        self.secants.keep(unknowns);
    }

    /// Takes back what [`ReducedBody::keep`] added.
    pub fn take_back(&mut self, unknowns: &mut Unknowns<'_>) {
        self.forget_beside();
        unknowns.fill(&mut self.z);
        unknowns.fill(&mut self.slopes);
        self.active = (unknowns.take::<f64>() as usize).min(self.z.len());
        (self.magnitude, self.made_at) = (unknowns.take(), unknowns.take());
        self.factor.take_back(|entries| unknowns.fill(entries));
        for numbers in [&mut self.tangent, &mut self.cross, &mut self.change, &mut self.missed] {
            unknowns.fill(numbers);
        }
        self.secants.take_back(unknowns);
    }

    /// Makes the next search begin at q = 0.
    pub fn forget(&mut self) {
        self.forget_beside();
        self.change.fill(0.0);
        self.z[1..].fill(0.0);
        self.active = 0;
    }

    /// z, as it was last found.
    pub fn z(&self) -> &[f64] {
        &self.z
    }

    /// V, with what loads make of it, at its least over q; its slopes by y are kept. `None` where no q was found; q is then that of
    /// before.
    pub fn settle(&mut self, y: &[f64], mut burden: Option<&mut LoadedPotential>) -> Option<f64> {
        (self.work, self.is_fresh) = (0, false);
        let is_deformed = y[self.rigid..].iter().any(|y| y.abs() > NOTHING);
        let active = if is_deformed { self.z.len() } else { 1 + self.rigid + self.fields };
        self.before.copy_from_slice(&self.z);
        for (k, y) in y.iter().enumerate() {
            let at = self.place(k);
            self.z[at] = if at < active { *y } else { 0.0 };
        }
        let is_predicted = self.active == active;
        if is_predicted {
            self.predict();
        }
        let (q, fields) = (1 + self.rigid, self.fields);
        let found = self.iterate(active, burden.as_deref_mut()).filter(|value| value.is_finite());
        if found.is_none() {
            self.z[q..q + fields].copy_from_slice(&self.before[q..q + fields]);
            self.active = 0;
            self.change.fill(0.0);
            return None;
        }
        if is_predicted {
            self.mend();
        } else {
            self.change.fill(0.0);
        }
        self.energy.slopes_beyond(&self.z, active, &mut self.slopes[active..]);
        if let Some(burden) = burden {
            burden.add_beyond(&self.z, active, &mut self.slopes[active..]);
        }
        found
    }

    /// Does a part of what [`ReducedBody::settle_beside`] needs, beginning at the last equilibrium where `anew`; true when nothing is
    /// left to do. The search for equilibria goes on with these second derivatives too, which are newer than its own.
    pub fn prepare_beside(&mut self, anew: bool) -> bool {
        if anew {
            self.forget_beside();
        }
        if self.energy.is_prepared() {
            return true;
        }
        self.has_beside = false;
        if !self.energy.prepare(&self.z) {
            return false;
        }
        let (n, q, fields) = (self.z.len(), 1 + self.rigid, self.fields);
        let second = self.energy.prepared();
        for i in 0..fields {
            self.beside.set(i, 0, &second[(q + i) * n + q..][..fields]);
        }
        self.has_beside = self.beside.factor();
        let active = self.active;
        if self.has_beside && active > 0 {
            for i in 0..fields {
                self.cross[i * active..(i + 1) * active].copy_from_slice(&second[(q + i) * n..][..active]);
            }
            self.factor.copy_from(&self.beside);
            self.secants.clear();
            self.made_at = self.magnitude;
            self.find_tangent(active);
            self.missed.fill(0.0);
        }
        true
    }

    fn forget_beside(&mut self) {
        self.has_beside = false;
        self.energy.forget();
    }

    /// Finds the slopes by y a little beside that which was settled last, to first order of the way there: q follows y along
    /// ∂²V/∂q² δq = -∂²V/∂q∂y δy. Returns what that adds to V; `None` where it is not prepared, or q was not stable.
    pub fn settle_beside(&mut self, y: &[f64]) -> Option<f64> {
        let (n, q, fields) = (self.z.len(), 1 + self.rigid, self.fields);
        if !self.has_beside {
            return None;
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        self.trial.fill(0.0);
        for (k, y) in y.iter().enumerate() {
            let at = self.place(k);
            self.trial[at] = y - self.z[at];
        }
        let added = dot(&self.slopes, &self.trial);
        let second = self.energy.prepared();
        for (i, step) in self.step.iter_mut().enumerate() {
            *step = -dot(&second[(q + i) * n..][..n], &self.trial);
        }
        self.beside.solve(&mut self.step);
        self.trial[q..q + fields].copy_from_slice(&self.step);
        for (at, slope) in self.slopes_beside.iter_mut().enumerate() {
            *slope = self.slopes[at] + dot(&second[at * n..][..n], &self.trial);
        }
        Some(added)
    }

    /// ∂V/∂y of the k-th y where [`ReducedBody::settle_beside`] was.
    pub fn slope_beside(&self, k: usize) -> f64 {
        self.slopes_beside[self.place(k)]
    }

    /// The change of y since the last equilibrium, in the places of z.
    fn change_of(&self, at: usize) -> f64 {
        let is_q = (1 + self.rigid..1 + self.rigid + self.fields).contains(&at);
        if is_q { 0.0 } else { self.z[at] - self.before[at] }
    }

    /// Moves q with y along the tangent, and aside by as much as it missed that on the way before, where this is a like one: what it
    /// misses grows with the square of the way.
    fn predict(&mut self) {
        let (n, q) = (self.active, 1 + self.rigid);
        let [mut own, mut last, mut both] = [0.0; 3];
        for (at, before) in self.change.iter().enumerate().take(n) {
            let change = self.change_of(at);
            own += change * change;
            last += before * before;
            both += change * before;
        }
        let is_like = both * both >= AS_STRAIGHT * own * last && last > SAYS_NOTHING * SAYS_NOTHING;
        let long = if is_like { both / last } else { 0.0 };
        let share = if (AS_LONG[0]..AS_LONG[1]).contains(&long) { long * long } else { 0.0 };
        for i in 0..self.fields {
            let along: f64 = (0..n).map(|at| self.tangent[i * n + at] * self.change_of(at)).sum();
            self.trial[q + i] = self.z[q + i] + along + share * self.missed[i];
        }
        self.z[q..q + self.fields].copy_from_slice(&self.trial[q..q + self.fields]);
    }

    /// Lets a tangent that was not made on this way say of it what was found.
    fn mend(&mut self) {
        let (n, q, fields) = (self.active, 1 + self.rigid, self.fields);
        let square: f64 = (0..n).map(|at| self.change_of(at).powi(2)).sum();
        if square <= SAYS_NOTHING * SAYS_NOTHING {
            return;
        }
        for at in 0..n {
            self.change[at] = self.change_of(at);
        }
        self.change[n..].fill(0.0);
        if self.is_fresh {
            self.missed.fill(0.0);
            return;
        }
        for i in 0..fields {
            let tangent = &mut self.tangent[i * n..(i + 1) * n];
            let along: f64 = tangent.iter().zip(&self.change).map(|(slope, change)| slope * change).sum();
            self.missed[i] = self.z[q + i] - self.before[q + i] - along;
            for (slope, change) in tangent.iter_mut().zip(&self.change) {
                *slope += self.missed[i] / square * change;
            }
        }
    }

    /// V at the q that is found from the q in z.
    fn iterate(&mut self, active: usize, burden: Option<&mut LoadedPotential>) -> Option<f64> {
        let mut search = Search {
            active,
            burden,
            at: (0.0, 0.0),
            tried: (0.0, 0.0),
            last: f64::INFINITY,
            promised: f64::INFINITY,
            is_new: false,
            is_shifted: false,
            body: self,
        };
        search.at = search.slopes(false);
        let found = minimise(&mut search, MOST_STEPS, &mut 0);
        let (is_shifted, (_, magnitude)) = (search.is_shifted, search.at);
        self.magnitude = if magnitude.is_finite() { magnitude } else { 0.0 };
        if is_shifted {
            self.active = 0;
        }
        found.ok().map(|found| found.energy)
    }

    /// The last step, with what it does to V and its slopes by y.
    fn take_last(&mut self, value: f64, promised: f64) -> f64 {
        let (n, q) = (self.active, 1 + self.rigid);
        for (i, step) in self.step.iter().enumerate() {
            self.z[q + i] -= step;
            for (slope, cross) in self.slopes.iter_mut().zip(&self.cross[i * n..(i + 1) * n]) {
                *slope -= cross * step;
            }
        }
        value - 0.5 * promised
    }

    /// Change of the slopes by y in the step, as a part of them: squares over the stiffness at rest, J, so that forces and moments count
    /// alike.
    fn part_of_forces(&self, n: usize) -> f64 {
        let (q, fields) = (1 + self.rigid, self.fields);
        let mut largest = [0.0, 0.0];
        for at in (1..n).filter(|at| !(q..q + fields).contains(at) && self.stiffness[*at] > 0.0) {
            let change: f64 =
                self.step.iter().enumerate().map(|(i, step)| self.cross[i * n + at] * step).sum();
            for (largest, slope) in largest.iter_mut().zip([change, self.slopes[at]]) {
                *largest = f64::max(*largest, slope * slope / self.stiffness[at]);
            }
        }
        let [change, force] = largest;
        if force > 0.0 { change / force } else { f64::INFINITY }
    }

    /// Newton's step from the slopes, and twice the decrease of V that it promises.
    fn direction(&mut self) -> f64 {
        let own = &self.slopes[1 + self.rigid..][..self.fields];
        self.step.copy_from_slice(own);
        self.secants.solve(&mut self.step, |step| self.factor.solve(step));
        self.step.iter().zip(own).map(|(step, slope)| step * slope).sum()
    }

    /// dq/dy of the `n` active z, by the factor and the derivatives by q and y.
    fn find_tangent(&mut self, n: usize) {
        let (q, fields) = (1 + self.rigid, self.fields);
        for at in (0..n).filter(|at| !(q..q + fields).contains(at)) {
            for i in 0..fields {
                self.step[i] = -self.cross[i * n + at];
            }
            self.factor.solve(&mut self.step);
            for i in 0..fields {
                self.tangent[i * n + at] = self.step[i];
            }
        }
        for i in 0..fields {
            self.tangent[i * n + q..][..fields].fill(0.0);
        }
    }
}

/// The search for the q at which V is least.
struct Search<'a, 'b> {
    body: &'a mut ReducedBody,
    burden: Option<&'b mut LoadedPotential>,
    /// Number of variables of z that are not 0.
    active: usize,
    /// V at z and where a step is tried, each with how large the numbers are that make it up.
    at: (f64, f64),
    tried: (f64, f64),
    /// Twice the decrease of V that the last step promised, and that this one does; whether its second derivatives are new.
    last: f64,
    promised: f64,
    is_new: bool,
    /// Whether the newest second derivatives were not positive definite, so that the factor is that of others.
    is_shifted: bool,
}

impl Search<'_, '_> {
    /// The largest second derivative of V by one q.
    fn largest(&self) -> f64 {
        let (n, q) = (self.active, 1 + self.body.rigid);
        (0..self.body.fields).map(|i| self.body.cross[i * n + q + i].abs()).fold(0.0, f64::max)
    }

    /// Size of the stress-free body, in parts of that at rest.
    fn size(&self) -> f64 {
        self.burden.as_ref().map_or(1.0, |burden| burden.size)
    }

    /// Finds the slopes at z, or where a step is tried, and V with what loads make of it.
    fn slopes(&mut self, is_tried: bool) -> (f64, f64) {
        let size = self.size();
        let ReducedBody { energy, slopes, z, trial, work, .. } = &mut *self.body;
        let (z, slopes) = (if is_tried { trial } else { z }, &mut slopes[..self.active]);
        *work += 1;
        let value = energy.slopes(z, self.active, size, slopes);
        match &mut self.burden {
            None => (value, value.abs()),
            Some(burden) => burden.add(value, z, slopes),
        }
    }
}

impl Energy for Search<'_, '_> {
    const TRIALS: usize = 10;

    fn evaluate(&mut self) -> Option<f64> {
        Some(self.at.0)
    }

    fn rounding(&self) -> f64 {
        ROUNDING * self.at.1
    }

    fn serves(&mut self) -> bool {
        let has_grown = self.at.1 > GREW * self.body.made_at.max(self.body.nothing);
        self.is_new = self.body.active != self.active || self.is_shifted || has_grown;
        if !self.is_new {
            self.promised = self.body.direction();
            self.is_new = self.promised > SERVES * self.last;
        }
        !self.is_new
    }

    /// Makes the tangent dq/dy as well.
    fn factorise(&mut self, shift: f64) -> bool {
        let size = self.size();
        let body = &mut *self.body;
        let (n, q, fields) = (self.active, 1 + body.rigid, body.fields);
        if shift == 0.0 {
            body.work += 2;
            body.is_fresh = true;
            body.active = 0;
            body.made_at = self.at.1;
            body.secants.clear();
            let second = body.energy.second(&body.z, n, size);
            if let Some(burden) = &self.burden {
                burden.add_second(n, second);
            }
            body.cross[..fields * n].copy_from_slice(&second[q * n..(q + fields) * n]);
        }
        self.is_shifted = shift > 0.0;
        let added = SHIFT * self.largest() * shift;
        let body = &mut *self.body;
        (0..fields).for_each(|i| body.factor.set(i, 0, &body.cross[i * n + q..][..fields]));
        body.factor.change_diagonal(|entry| entry + added);
        if !body.factor.factor() {
            return false;
        }
        body.active = n;
        body.find_tangent(n);
        self.promised = body.direction();
        true
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        self.last = self.promised;
        let q = 1 + self.body.rigid;
        self.body.slopes_before.copy_from_slice(&self.body.slopes[q..q + self.body.fields]);
        let energy = self.at.1.max(self.body.nothing);
        let [nearly, of_forces] = NEARLY_LAST;
        let is_nearly = !self.is_shifted && self.promised <= nearly * energy;
        let is_last = self.promised <= LAST * energy
            || (is_nearly && self.body.part_of_forces(self.active) <= of_forces);
        Step { gain: self.promised, is_last }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let ReducedBody { z, trial, step, rigid, .. } = &mut *self.body;
        trial.copy_from_slice(z);
        trial[1 + *rigid..].iter_mut().zip(step).for_each(|(q, step)| *q -= share * *step);
        self.tried = self.slopes(true);
        Some(self.tried.0)
    }

    fn accept(&mut self) {
        let ReducedBody { z, trial, slopes, slopes_before, secants, rigid, .. } = &mut *self.body;
        let q = 1 + *rigid;
        secants.add([&trial[q..], &z[q..]], [&slopes[q..], slopes_before]);
        z.copy_from_slice(trial);
        self.at = self.tried;
    }

    fn finish(&mut self, energy: f64, gain: f64) -> Option<f64> {
        Some(self.body.take_last(energy, gain))
    }

    /// Inverse iteration with the shifted second derivatives, from a start without symmetry. The first way would take as much energy as
    /// the body has, were it as stiff as it is to the stiffest field.
    fn find_mode(&mut self) -> Option<f64> {
        let largest = self.largest();
        let (n, q) = (self.active, 1 + self.body.rigid);
        let ReducedBody { factor, cross, step, fields, .. } = &mut *self.body;
        step.iter_mut().enumerate().for_each(|(i, step)| *step = (1.7 * i as f64).sin() + 0.3);
        for _ in 0..MODE_STEPS {
            factor.solve(step);
            let size = step.iter().map(|step| step * step).sum::<f64>().sqrt();
            step.iter_mut().for_each(|step| *step /= size);
        }
        let along = |i: usize| {
            cross[i * n + q..][..*fields].iter().zip(&*step).map(|(h, step)| h * step).sum::<f64>()
        };
        let curvature: f64 = (0..*fields).map(|i| step[i] * along(i)).sum();
        if curvature < FALLS * largest {
            return Some((2.0 * self.at.1 / largest).sqrt());
        }
        // Newton's step, in whose place the mode stands.
        self.body.direction();
        None
    }

    fn renew(&mut self) -> bool {
        if !self.is_new {
            self.body.active = 0;
            self.at = self.slopes(false);
        }
        !self.is_new
    }
}

#[cfg(test)]
#[path = "equilibrium_tests.rs"]
mod tests;
