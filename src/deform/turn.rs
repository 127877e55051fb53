//! Measures of a deformation: how far linear theory is strained, by the largest rotation in the part that it computes and by the
//! mean of its strain, how far a material law is, and how far a body is deformed.

use super::deformer::Deformer;
use super::pose::se3::slide_matrix;
use crate::fem::nearest_turn;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// The largest rotation of a piece of the surface by u alone, rad; what the model took out of the poses as a rigid motion
/// is not in it. Looks at `most` triangles at the most, spread over the surface.
///
/// A triangle with edges a, b and unit normal n that comes to a', b', n' turns by the polar factor of
/// F = [a' b' n'] [a b n]⁻¹. Linear theory takes the strain of u to be ½(∇u + ∇uᵀ), which leaves out the square of this
/// angle (Bathe, Finite Element Procedures, section 6.2).
pub fn local_turn(deformer: &Deformer, most: usize) -> f64 {
    let turn = |triangle: &[u32; 3]| {
        let rest = triangle.map(|node| Vector3::from(deformer.rest()[node as usize]).cast::<f64>());
        let moved = [0, 1, 2].map(|k| rest[k] + deformer.linear_part(triangle[k] as usize));
        let gradient = frame(&moved)? * frame(&rest)?.try_inverse()?;
        gradient.iter().all(|x| x.is_finite()).then(|| nearest_turn(&gradient).angle())
    };
    sample(deformer.triangles(), most).filter_map(turn).fold(0.0, f64::max)
}

/// A sample of at most `most` triangles, spread over the surface.
fn sample(triangles: &[[u32; 3]], most: usize) -> impl Iterator<Item = &[u32; 3]> {
    triangles.iter().step_by(triangles.len().div_ceil(most.max(1)).max(1))
}

/// The mean strain of the surface by u alone as linear theory has it, weighed by its own square, which is the strain energy per
/// area but for a factor. Looks at `most` triangles at the most, spread over the surface.
///
/// With D the gradient of u in a triangle's plane, 2 E_ab = e_a·D_b + e_b·D_a, A its area and ε the larger of |E₁|, |E₂|,
/// it is Σ A (E:E) ε / Σ A (E:E): ε itself of a bar that is pulled, 3/4 of the outermost fibre's of one that is bent.
pub fn mean_strain(deformer: &Deformer, most: usize) -> f64 {
    let of = |triangle: &[u32; 3]| {
        let corners = triangle.map(|node| Vector3::from(deformer.rest()[node as usize]).cast::<f64>());
        let Tangents { area, first, second, along, across } =
            Tangents::new(&corners, &triangle.map(|node| deformer.linear_part(node as usize)))?;
        let (x, y) = (first.dot(&along), second.dot(&across));
        let shear = 0.5 * (first.dot(&across) + second.dot(&along));
        let (mean, half) = (0.5 * (x + y), (0.5 * (x - y)).hypot(shear));
        let weight = area * (x * x + y * y + 2.0 * shear * shear);
        Some([weight * (mean.abs() + half), weight])
    };
    mean(sample(deformer.triangles(), most).filter_map(of))
}

/// Poisson's ratio in [`law_strain`].
const POISSON: f64 = 0.3;

/// The strain of a surface by which the forces of material laws differ, weighed by its own square. Looks at `most` triangles at the
/// most, spread over the surface; `corners` are the places of a node at rest and its displacement, `free` is the stretch that warmth
/// gives a free body.
///
/// With the stretches λ₁, λ₂ in a triangle's plane, ε = λ/free - 1, its area A and ν = 0.3 it is
///
/// ```text
/// Σ A (ε₁³ + ε₂³ + ν ε₁ ε₂ (ε₁ + ε₂)) / Σ A (ε₁² + ε₂² + 2ν ε₁ ε₂)
/// ```
///
/// the energy's part of third order against that of second, in plane stress under St. Venant and Kirchhoff's law: ε of a bar that is
/// pulled (0.85 ε at ν = 0.49), and small of one that is bent or twisted, where fibres are pulled as much as others are pressed. So is
/// that of a body of which one part is pulled as much as another is pressed. A pulled bar bears 1 + 3/2 ε times as much as by Hooke's
/// law, by neo-Hooke's 1 - 3ν/(1 + ν) ε times.
pub fn law_strain(
    triangles: &[[u32; 3]],
    corners: &dyn Fn(u32) -> [Vector3<f64>; 2],
    free: f64,
    most: usize,
) -> f64 {
    let of = |triangle: &[u32; 3]| {
        let nodes = triangle.map(corners);
        let Tangents { area, first, second, along, across } =
            Tangents::new(&nodes.map(|[rest, _]| rest), &nodes.map(|[_, u]| u))?;
        let (a, b) = (first + along, second + across);
        let (mean, half) = (
            0.5 * (a.norm_squared() + b.norm_squared()),
            (0.5 * (a.norm_squared() - b.norm_squared())).hypot(a.dot(&b)),
        );
        let [x, y] = [mean + half, mean - half].map(|square| square.max(0.0).sqrt() / free - 1.0);
        let third = x.powi(3) + y.powi(3) + POISSON * x * y * (x + y);
        Some([area * third, area * (x * x + y * y + 2.0 * POISSON * x * y)])
    };
    mean(sample(triangles, most).filter_map(of))
}

/// The sum of the first numbers over that of the second, where both are finite; 0 of none.
fn mean(of: impl Iterator<Item = [f64; 2]>) -> f64 {
    let finite = of.filter(|both| both.iter().all(|x| x.is_finite()));
    let [sum, weights] = finite.fold([0.0; 2], |[sum, weights], [x, weight]| [sum + x, weights + weight]);
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// A triangle at rest: its area and two axes in its plane; and the derivatives of u along these.
struct Tangents {
    area: f64,
    first: Vector3<f64>,
    second: Vector3<f64>,
    along: Vector3<f64>,
    across: Vector3<f64>,
}

impl Tangents {
    /// `None` for a triangle without area.
    fn new(corners: &[Vector3<f64>; 3], u: &[Vector3<f64>; 3]) -> Option<Tangents> {
        let (a, b) = (corners[1] - corners[0], corners[2] - corners[0]);
        let normal = a.cross(&b);
        let first = a.try_normalize(0.0).filter(|_| normal.norm() > 0.0)?;
        let second = normal.normalize().cross(&first);
        let along = (u[1] - u[0]) / a.norm();
        let across = (u[2] - u[0] - along * b.dot(&first)) / b.dot(&second);
        Some(Tangents { area: 0.5 * normal.norm(), first, second, along, across })
    }
}

/// [a b n]; None for a triangle without area.
fn frame(corners: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    let (a, b) = (corners[1] - corners[0], corners[2] - corners[0]);
    Some(Matrix3::from_columns(&[a, b, a.cross(&b).try_normalize(0.0)?]))
}

/// Reach of a deformation: the measures by which errors are looked up for a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// The largest turn of a piece of the surface, or of another control element, against the first control element, rad.
    pub turn: f64,
    /// The largest turn by which two control elements are bent along an arc, and twisted, against each other, rad: of an end that is
    /// turned in place the twist alone, of one that is shifted nothing.
    pub arc: f64,
    /// The largest |λ - 1| of the stretches λ of a piece of the surface.
    pub stretch: f64,
    /// Largest distance of two control elements from where an arc of their own length would bring them with their turn, as a part
    /// of that length: with V(φ) d of the helicoidal motion with the turn φ between them.
    pub off: f64,
    /// Part of its distance by which one control element is pulled away from the others, which rest, or pressed towards them where it is
    /// negative, and neither turned nor shifted aside; else 0.
    pub pull: f64,
}

/// Pose of one control element against another, by the axes of that one.
pub(super) struct Relative {
    /// Vector from the origin of that one to its own at rest, m.
    pub way: Vector3<f64>,
    /// rad.
    pub turn: Vector3<f64>,
    /// m.
    pub shift: Vector3<f64>,
}

impl Relative {
    /// Pose of control element `b` against `a`.
    pub fn between(deformer: &Deformer, a: usize, b: usize) -> Relative {
        let Deformer { controls, poses, .. } = deformer;
        let way = controls[b].origin - controls[a].origin;
        let to_a = nearest_turn(&poses[a].matrix).inverse();
        let turn = (to_a * nearest_turn(&poses[b].matrix)).scaled_axis();
        let shift = to_a * (way + poses[b].translation - poses[a].translation) - way;
        Relative { way, turn, shift }
    }

    /// Whether it stands as at rest; not known of two that have one origin.
    pub fn rests(&self) -> bool {
        self.turn.norm() < RESTS && self.shift.norm() < RESTS * self.way.norm()
    }

    /// The part of the way by which it is pulled straight away, or pressed; 0 where it is turned or shifted aside too.
    fn pull(&self) -> f64 {
        let along = self.shift.dot(&self.way) / self.way.norm();
        let aside = (self.shift.norm_squared() - along * along).max(0.0).sqrt();
        let most = ASIDE * along.abs();
        let is_straight = aside <= most && self.turn.norm() * self.way.norm() <= most;
        if is_straight { along / self.way.norm() } else { 0.0 }
    }

    /// Distance of the shift from that of an arc, as a part of the way.
    fn off_the_arc(&self) -> f64 {
        (self.shift - self.arc_shift()).norm() / self.way.norm()
    }

    /// The turn about the way, rad.
    fn twist(&self) -> f64 {
        (self.turn.dot(&self.way) / self.way.norm()).abs()
    }

    /// The twist, and as much of the bend as the shift is of an arc's, rad.
    fn along_the_arc(&self) -> f64 {
        let Relative { turn, shift, .. } = self;
        let twist = self.twist();
        let bend = (turn.norm_squared() - twist * twist).max(0.0).sqrt();
        let of_arc = self.arc_shift();
        let part = shift.dot(&of_arc) / of_arc.norm_squared();
        twist.hypot(if part.is_finite() { bend * part.clamp(0.0, 1.0) } else { bend })
    }

    /// Shift of the end of an arc of the way's length that bends by this turn.
    fn arc_shift(&self) -> Vector3<f64> {
        slide_matrix(&self.turn) * self.way - self.way
    }
}

/// Largest turn, rad, and shift aside of an element that counts as pulled away from the others, as parts of the pull.
const ASIDE: f64 = 0.02;
/// Largest motion of others against each other with which they count as resting, of their distance and in rad.
pub(super) const RESTS: f64 = 1e-6;

/// The pull of one control element away from all others; 0 where there is none.
fn pull(deformer: &Deformer) -> f64 {
    let of_one = |e: usize| {
        let others = others_at_rest(deformer, e)?;
        let pulls = others.map(|a| Relative::between(deformer, a, e).pull());
        pulls.reduce(|a, b| if a * b > 0.0 { a } else { 0.0 }).filter(|pull| *pull != 0.0 && pull.is_finite())
    };
    (0..deformer.controls.len()).find_map(of_one).unwrap_or(0.0)
}

/// The control elements but for `element`; `None` where they do not rest against each other.
fn others_at_rest(deformer: &Deformer, element: usize) -> Option<impl Iterator<Item = usize>> {
    let others = move |count: usize| (0..count).filter(move |&a| a != element);
    let count = deformer.controls.len();
    let rest =
        others(count).all(|b| others(count).all(|a| a == b || Relative::between(deformer, a, b).rests()));
    rest.then(|| others(count))
}

/// Turn of control element `element` against all others, by their axes, rad; `None` where these do not rest against each other.
pub(super) fn turn_against_others(deformer: &Deformer, element: usize) -> Option<Vector3<f64>> {
    let base = others_at_rest(deformer, element)?.next()?;
    Some(Relative::between(deformer, base, element).turn)
}

/// The largest of all pairs of control elements.
fn largest(deformer: &Deformer, of: fn(&Relative) -> f64) -> f64 {
    let pairs = (0..deformer.controls.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    let found = pairs.map(|(a, b)| of(&Relative::between(deformer, a, b)));
    found.filter(|found| found.is_finite()).fold(0.0, f64::max)
}

/// Whether all control elements stand as they do at rest, but for a shift of all.
pub fn rests(deformer: &Deformer) -> bool {
    let Deformer { controls, poses, .. } = deformer;
    let (Some(first), Some(origin)) = (poses.first(), controls.first().map(|control| control.origin)) else {
        return true;
    };
    let size = controls.iter().map(|control| (control.origin - origin).norm()).fold(0.0, f64::max);
    poses.iter().all(|pose| {
        (pose.matrix - Matrix3::identity()).norm() <= RESTS
            && (pose.translation - first.translation).norm() <= RESTS * size
    })
}

/// Number of triangles that are looked at, spread over the surface: where errors are measured and where they are shown.
const PIECES: usize = 256;

/// The reach of a body in its pose, whatever its model.
pub fn reach(deformer: &Deformer) -> Reach {
    let base = deformer.poses.first().map_or(UnitQuaternion::identity(), |pose| nearest_turn(&pose.matrix));
    let triangles = deformer.triangles();
    let step = triangles.len().div_ceil(PIECES).max(1);
    let turn = deformer.largest_turn();
    let mut reach = Reach {
        turn,
        // A half turn and one more are the same matrix.
        arc: if turn < std::f64::consts::PI { largest(deformer, Relative::along_the_arc) } else { turn },
        stretch: 0.0,
        off: largest(deformer, Relative::off_the_arc),
        pull: pull(deformer),
    };
    for triangle in triangles.iter().step_by(step) {
        let rest = triangle.map(|node| Vector3::from(deformer.rest()[node as usize]).cast::<f64>());
        let moved = [0, 1, 2].map(|k| rest[k] + deformer.displacement(triangle[k] as usize));
        let gradient = frame(&moved).zip(frame(&rest).and_then(|rest| rest.try_inverse()));
        let Some(f) = gradient.map(|(moved, inverse)| moved * inverse) else { continue };
        if f.iter().all(|x| x.is_finite()) {
            reach.turn = reach.turn.max(nearest_turn(&f).angle_to(&base));
            let stretches = f.singular_values();
            reach.stretch = stretches.iter().fold(reach.stretch, |most, s| most.max((s - 1.0).abs()));
        }
    }
    reach
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of 1 × 0.2 m in 20 × 4 squares, moved by a map of its points.
    fn strain_of(free: f64, map: &dyn Fn(Vector3<f64>) -> Vector3<f64>) -> f64 {
        let node = |i: u32, j: u32| 5 * i + j;
        let squares = (0..20).flat_map(|i| (0..4).map(move |j| (i, j)));
        let triangles: Vec<[u32; 3]> = squares
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        law_strain(
            &triangles,
            &|node| {
                let rest = Vector3::new(0.05 * f64::from(node / 5), 0.05 * f64::from(node % 5) - 0.1, 0.0);
                [rest, map(rest) - rest]
            },
            free,
            1000,
        )
    }

    /// A pull counts by its size, a turn, a bend in the plane and a shear for nothing or next to nothing.
    #[test]
    fn laws_differ_by_what_is_pulled_and_not_by_what_is_bent() {
        let bar = |strain: f64| {
            move |x: Vector3<f64>| Vector3::new((1.0 + strain) * x.x, (1.0 - 0.3 * strain) * x.y, x.z)
        };
        for strain in [0.2, -0.1] {
            let pulled = strain_of(1.0, &bar(strain));
            assert!((pulled - strain).abs() < 1e-12, "{pulled}");
        }
        let turn = nalgebra::Rotation3::from_scaled_axis(Vector3::new(1.0, -2.0, 0.5));
        let turned = strain_of(1.0, &|x| turn * bar(0.2)(x) + Vector3::repeat(3.0));
        assert!((turned - 0.2).abs() < 1e-12, "{turned}");
        let warm = strain_of(1.1, &|x| 1.1 * bar(0.2)(x));
        assert!((warm - 0.2).abs() < 1e-12 && strain_of(1.1, &|x| 1.1 * x).abs() < 1e-12, "{warm}");
        // Round an arc of 1 rad, whose outer fibres are pulled by 10 %.
        let bent =
            strain_of(1.0, &|x| Vector3::new((1.0 - x.y) * x.x.sin(), 1.0 - (1.0 - x.y) * x.x.cos(), 0.0));
        assert!(bent.abs() < 2e-3, "{bent}");
        // λ = 1 ± γ/2 + γ²/8: of second order.
        let sheared = strain_of(1.0, &|x| Vector3::new(x.x + 0.1 * x.y, x.y, x.z));
        assert!(sheared.abs() < 0.5 * 0.1 * 0.1, "{sheared}");
    }

    /// Bent by 0.4 about an axis across the way, and twisted by 0.3: shifted as an arc asks for, half as far, twice as far and
    /// the other way.
    #[test]
    fn a_bend_counts_by_as_much_of_an_arc_as_its_shift_is() {
        for (twist, part, counted) in [(0.0, 1.0, 1.0), (0.0, 0.5, 0.5), (0.3, 2.0, 1.0), (0.3, -1.0, 0.0)] {
            let (way, turn) = (Vector3::z(), Vector3::new(0.0, 0.4, twist));
            let straight = Relative { way, turn, shift: Vector3::zeros() };
            let shift = straight.arc_shift() * part;
            let found = Relative { shift, ..straight }.along_the_arc();
            assert!((found - f64::hypot(0.4 * counted, twist)).abs() < 1e-12, "{twist} {part}: {found}");
        }
    }
}
