//! The rod in a body: section constants from the body's own handle stiffness.
//!
//! In: S of two control elements (24 × 24), their origins and where the free body between them begins and ends. Out: the
//! section stiffness C of the uniform straight rod that answers all small rigid motions of its ends exactly as the body
//! does (hollow and mixed sections, coarse meshes and the ends' own give included), and what stretching an end does.
//!
//! With a wrench (f, m) on the middle of the rod, at the end, a section s away feels (f, m - s a × f), and the compliance is
//!
//! ```text
//! F = ∫ A(s)ᵀ C⁻¹ A(s) ds:    C⁻¹_mm = F_mm/L    C⁻¹_fm = F_fm/L    C⁻¹_ff = F_ff/L - L²/12 (1 - 1/n²) âᵀ C⁻¹_mm â
//! ```
//!
//! with 1 - 1/n² for n segments of constant strain: 21 numbers of either, so that nothing is left over, whatever L and the
//! middle are. The middle is where a force causes least rotation (the centroid of 1/EI). L is the length between
//! the control elements, or less where the compliance to transverse shear would be smaller than [`SHEAR`] times that to
//! stretching: ends that cannot contract shorten a body of radius r by some tenths of r, and at 100 r between its ends
//! that costs 1/EI more than all its shear. With κ G A between 0.2 and 0.4 E A, L is off by at most 24 r²/L² of itself
//! (0.2 % at 100 r), which S makes good for small motions. That the body is a rod shows in L, and in its radius of gyration.
//!
//! To second order, a section that is bent or twisted is also stretched: fibres away from the axis are longer (with
//! Green's strain γ + ½ γ² + ½ r² τ² for a twist τ; Wagner, 1929), which pulls at the ends. That makes a stretch
//! ½ xᵀ A x of x = (γ, κ), with A from the cubic energy of the body, which [`Helicoidal`] has:
//!
//! ```text
//! V₃ = L Cγγ γ ½ xᵀ A x + terms without γ, for uniform strains x
//! ```

use crate::deform::models::helicoidal::Helicoidal;
use crate::deform::pose::frame::ControlFrame;
use crate::deform::pose::se3::{blocks, exp, joined};
use nalgebra::{
    DMatrix, Isometry3, Matrix2, Matrix3, Matrix6, SMatrix, SVector, Translation3, Vector3, Vector6,
};

/// Ad of a shift by x: the motion (v, ω) of a frame is that of the frame moved by -x, whose origin is x away from it.
pub fn shift(x: &Vector3<f64>) -> Matrix6<f64> {
    blocks(&Matrix3::identity(), &x.cross_matrix(), &Matrix3::zeros(), &Matrix3::identity())
}

/// The nine numbers of U - I of an end, row by row.
pub type Stretch = SVector<f64, 9>;

/// Least length of a body, in radii of gyration. A cube has 3.5, a solid round rod four for each diameter.
pub const SLENDER: f64 = 8.0;
/// Least compliance to transverse shear in that to stretching: E A/κ G A is 2.4 to 5 for solid and hollow sections with
/// 0 ≤ ν < 1/2 (Cowper, J. Appl. Mech. 33, 1966), less what ends that cannot warp take of it on short bodies.
const SHEAR: f64 = 1.0;
/// The rod is shorter than the free body by so many radii at the most, and so much of its length: 0.1 to 0.3 radii were measured on
/// uniform bars, 2.3 and 7 on bars of pieces whose moduli differ by 100.
const SHORTER: [f64; 2] = [1.0, 0.02];
/// Step of the strains with which A is found, in parts of r²/(L √(a L)), a being the largest distance of an element's origin from its end of
/// the rod. The screw of an element on such an arm contains a stretch ½ a L κ² of a bend κ, which V₃ takes back up to a part (κ L)²/12 of
/// it: with κ = step/r, less than 1e-4 of the stretch ½ r² κ² that is sought.
const ARMS: f64 = 0.03;
/// Numbers of an element's twelve in S.
const FIELDS: usize = 12;

/// A straight rod between two control elements.
#[derive(Clone, Debug)]
pub struct Section {
    /// C in the body's axes: N, N·m, N·m².
    pub stiffness: Matrix6<f64>,
    /// Places in the body at rest where the rod begins and ends.
    pub ends: [Vector3<f64>; 2],
    /// Displacement of either end of the rod, in its frame, by a stretch of its control element: E.
    pub offsets: [SMatrix<f64, 6, 9>; 2],
    /// The stiffness against stretches of both ends that leave the rod without strain: D.
    pub stretching: SMatrix<f64, 18, 18>,
    /// A, in the body's axes: of strains (γ, κ), m/m and rad/m. Zero without [`Section::fit_second`].
    pub second: Matrix6<f64>,
}

impl Section {
    /// `origins`: o_e; `reaches`: how far each element reaches along the line from the first origin to the second, from
    /// its origin towards the other; `segments` of the rod.
    pub fn fit(
        stiffness: &DMatrix<f64>,
        origins: [Vector3<f64>; 2],
        reaches: [f64; 2],
        segments: usize,
    ) -> Result<Section, String> {
        if stiffness.shape() != (2 * FIELDS, 2 * FIELDS) {
            let (rows, columns) = stiffness.shape();
            return Err(format!("S is {rows} × {columns}, a rod's is 24 × 24: it has two control elements"));
        }
        let chord = origins[1] - origins[0];
        let (distance, length) = (chord.norm(), chord.norm() - reaches[0] - reaches[1]);
        if length.is_nan() || length <= 0.05 * distance {
            return Err(format!(
                "its control elements leave {length:.3e} m of the {distance:.3e} m between their origins free, too little \
                 for a rod"
            ));
        }
        let axis = chord / distance;
        let middle = origins[0] + axis * (0.5 * (reaches[0] + distance - reaches[1]));
        let rigid = [rigid_fields(0), rigid_fields(1)];
        let of_last = rigid[1].transpose() * stiffness;
        let held: Matrix6<f64> = (&of_last * &rigid[1]).fixed_view::<6, 6>(0, 0).into_owned();
        let compliance = symmetric(&held).cholesky().map(|factor| factor.inverse()).ok_or_else(|| {
            "a rigid motion of its second control element meets no resistance: a rod needs elements that hold a face or a \
             band, not a line or a point"
                .to_owned()
        })?;

        let at = |pole: Vector3<f64>| {
            let to_pole = shift(&(origins[1] - pole));
            symmetric(&(to_pole * compliance * to_pole.transpose()))
        };
        let cross = axis.cross_matrix();
        let (turned, coupled) = {
            let flexible = at(middle);
            (cross * flexible.fixed_view::<3, 3>(3, 3), flexible.fixed_view::<3, 3>(0, 3).into_owned())
        };
        let middle = middle + axis * (turned.dot(&coupled) / turned.norm_squared());
        let flexible = at(middle);
        let shape = (1.0 - 1.0 / (segments * segments) as f64) / 12.0;
        let bending_length = (bending_square(&flexible, &axis) / shape).max(0.0).sqrt();
        let between = length;
        let length = between.min(bending_length);
        let flexible = flexible / length;
        let bending = flexible.fixed_view::<3, 3>(3, 3).into_owned();
        let mut inverse = flexible;
        let mut stretching = inverse.fixed_view_mut::<3, 3>(0, 0);
        stretching -= cross.transpose() * bending * cross * (shape * length * length);
        let by_force = (axis.transpose() * stretching * axis).x;
        let stiffness_of_section = inverse.cholesky().map(|factor| symmetric(&factor.inverse()));
        let radius = (by_force / (0.5 * (bending.trace() - (axis.transpose() * bending * axis).x))).sqrt();
        let slenderness = length / radius;
        let is_uniform = between - length <= SHORTER[0] * radius + SHORTER[1] * between;
        let Some(section) = stiffness_of_section.filter(|_| slenderness >= SLENDER && is_uniform) else {
            let as_rod = match slenderness.is_finite() {
                true => format!("it bends as a rod of {length:.3e} m, {slenderness:.1} radii of gyration"),
                false => "no straight rod bends as it does".to_owned(),
            };
            return Err(format!(
                "{between:.3e} m are free between its control elements, and {as_rod}. A rod needs {SLENDER} radii of \
                 gyration, and sections that are alike"
            ));
        };
        let ends = [middle - axis * (0.5 * length), middle + axis * (0.5 * length)];
        let (offsets, stretching) = stretches(stiffness, &of_last, &compliance, chord);
        // The pole of an offset is the origin; the rod's end stands before it.
        let at_end = [shift(&(origins[0] - ends[0])), shift(&(origins[1] - ends[1]))];
        let offsets = [at_end[0] * offsets[0], at_end[1] * offsets[1]];
        let second = Matrix6::zeros();
        Ok(Section { stiffness: section, ends, offsets, stretching, second })
    }

    /// Length of the rod in radii of gyration of its section.
    pub fn slenderness(&self) -> f64 {
        let way = self.ends[1] - self.ends[0];
        let axis = way.normalize();
        let [stretching, turning] = [0, 3].map(|at| self.stiffness.fixed_view::<3, 3>(at, at).into_owned());
        let [along, twisting] = [stretching, turning].map(|block| axis.dot(&(block * axis)));
        way.norm() * (2.0 * along / (turning.trace() - twisting)).sqrt()
    }

    /// A, from the body's energy by its control elements' frames.
    pub fn fit_second(&mut self, origins: [Vector3<f64>; 2], energy: &mut Helicoidal) {
        let axis = self.axis();
        let unit = joined(&axis, &Vector3::zeros());
        let axial = (self.stiffness * unit).dot(&unit);
        let bending = self.stiffness.fixed_view::<3, 3>(3, 3).trace() / 3.0;
        let radius = (bending / axial).sqrt();
        let directions: [Vector6<f64>; 4] = std::array::from_fn(|k| match k {
            0 => unit,
            k => joined(&Vector3::zeros(), &(Vector3::ith(k - 1, 1.0) / radius)),
        });
        // Ends turn by a tenth of a radian at most: they are seen by the shorter turn.
        let length = (self.ends[1] - self.ends[0]).norm();
        let arm = [0, 1].map(|e| (self.ends[e] - origins[e]).norm()).into_iter().fold(0.0, f64::max);
        let of_arms = ARMS * radius * radius / (length * (length * arm).sqrt());
        let step = 1e-3_f64.min(0.1 * radius / length).min(of_arms);
        let mut cubic = |strain: Vector6<f64>| self.third_order(origins, energy, &strain, step);
        let single = directions.map(&mut cubic);
        // The third derivative along γ, i and j, by differences, which are exact for a cubic form.
        let stretch = directions[0];
        let mut second = SMatrix::<f64, 4, 4>::zeros();
        for i in 0..4 {
            for j in 0..4 {
                let (one, two) = (directions[i], directions[j]);
                let third = cubic(stretch + one + two)
                    - cubic(stretch + one)
                    - cubic(stretch + two)
                    - cubic(one + two)
                    + single[0]
                    + single[i]
                    + single[j];
                let equal = [i, j].iter().filter(|&&k| k == 0).count() as f64;
                second[(i, j)] = third / (axial * (1.0 + equal));
            }
        }
        let basis = SMatrix::<f64, 6, 4>::from_columns(&[
            unit,
            directions[1] * (radius * radius),
            directions[2] * (radius * radius),
            directions[3] * (radius * radius),
        ]);
        let second = basis * second * basis.transpose();
        if second.iter().all(|a| a.is_finite()) {
            self.second = symmetric(&second);
        }
    }

    /// The third-order part of the energy for this uniform strain, per length of the rod.
    fn third_order(
        &self,
        origins: [Vector3<f64>; 2],
        energy: &mut Helicoidal,
        strain: &Vector6<f64>,
        step: f64,
    ) -> f64 {
        let chord = self.ends[1] - self.ends[0];
        let arms = [0, 1].map(|e| Translation3::from(self.ends[e] - origins[e]));
        let mut at = |scale: f64| {
            let whole = joined(&chord, &Vector3::zeros()) + strain * (chord.norm() * scale);
            let start = Isometry3::from(Translation3::from(origins[0]));
            let end = start * arms[0] * exp(&whole) * arms[1].inverse();
            let frame = |place: &Isometry3<f64>| ControlFrame {
                place: place.translation.vector,
                turn: place.rotation,
                stretch: Matrix3::identity(),
            };
            energy.third_order_energy(&[frame(&start), frame(&end)]).unwrap_or(f64::NAN)
        };
        (at(step) - at(-step)) / (2.0 * step.powi(3) * chord.norm())
    }

    /// Direction along the rod.
    pub fn axis(&self) -> Vector3<f64> {
        (self.ends[1] - self.ends[0]).normalize()
    }

    /// The frame of the section so far along the rod at rest, 0 to 1.
    pub fn frame_at(&self, share: f64) -> Isometry3<f64> {
        Isometry3::from(Translation3::from(self.ends[0].lerp(&self.ends[1], share)))
    }

    /// The screw between neighbouring sections at rest.
    pub fn rest(&self, segments: usize) -> Vector6<f64> {
        let piece = (self.ends[1] - self.ends[0]) / segments as f64;
        Vector6::new(piece.x, piece.y, piece.z, 0.0, 0.0, 0.0)
    }
}

/// L² (1 - 1/n²)/12 of the longest rod with this compliance about its middle whose compliance to transverse shear is
/// [`SHEAR`] times that to stretching at least: the least λ of (F_tt - F_to F_oo⁻¹ F_ot - SHEAR F_nn) v = λ (âᵀ F_mm â)_tt v,
/// t: the two transverse forces, o: the other four parts of a wrench, n: the force along the rod.
fn bending_square(flexible: &Matrix6<f64>, axis: &Vector3<f64>) -> f64 {
    let aside = Vector3::ith(axis.iamin(), 1.0).cross(axis).normalize();
    let own = Matrix3::from_columns(&[aside, axis.cross(&aside), *axis]);
    let axes = blocks(&own, &Matrix3::zeros(), &Matrix3::zeros(), &own);
    let own = axes.transpose() * flexible * axes;
    let others = own.fixed_view::<4, 4>(2, 2).into_owned();
    let coupled = own.fixed_view::<2, 4>(0, 2).into_owned();
    let Some(others) = others.cholesky() else { return f64::NAN };
    let shear = Matrix2::from_diagonal_element(SHEAR * own[(2, 2)]);
    let transverse = own.fixed_view::<2, 2>(0, 0) - coupled * others.solve(&coupled.transpose()) - shear;
    let bending = Matrix2::new(own[(4, 4)], -own[(4, 3)], -own[(3, 4)], own[(3, 3)]);
    let Some(inverse) = bending.cholesky().and_then(|factor| factor.l().try_inverse()) else {
        return f64::NAN;
    };
    (inverse * transverse * inverse.transpose()).symmetric_eigenvalues().min()
}

/// The fields of the six rigid motions (v, ω) of an element, among all 24.
pub fn rigid_fields(element: usize) -> DMatrix<f64> {
    let mut fields = DMatrix::zeros(2 * FIELDS, 6);
    for axis in 0..3 {
        fields[(FIELDS * element + axis, axis)] = 1.0;
        let turn = Vector3::ith(axis, 1.0).cross_matrix();
        for (at, (i, j)) in (0..9).map(|k| (k, (k / 3, k % 3))) {
            fields[(FIELDS * element + 3 + at, 3 + axis)] = turn[(i, j)];
        }
    }
    fields
}

/// A stretch of either end with the other end's motion free: where that goes, as offsets of the ends from the rod about
/// their origins, and the stiffness that is left.
fn stretches(
    stiffness: &DMatrix<f64>,
    of_last: &DMatrix<f64>,
    compliance: &Matrix6<f64>,
    chord: Vector3<f64>,
) -> ([SMatrix<f64, 6, 9>; 2], SMatrix<f64, 18, 18>) {
    let place = |k: usize| FIELDS * (k / 9) + 3 + k % 9;
    // The last end's wrench by unit stretches, with all else held, and where it goes when it is let go: -E.
    let held = SMatrix::<f64, 6, 18>::from_fn(|i, k| of_last[(i, place(k))]);
    let goes = compliance * held;
    let direct = SMatrix::<f64, 18, 18>::from_fn(|i, j| stiffness[(place(i), place(j))]);
    let left = direct - held.transpose() * goes;
    // The rod goes with the last end, beside the first, whose origin is the pole of its offset.
    let first = -shift(&chord) * goes.fixed_view::<6, 9>(0, 0);
    let last = goes.fixed_view::<6, 9>(0, 9).into_owned();
    ([first, last], (left + left.transpose()) * 0.5)
}

fn symmetric(m: &Matrix6<f64>) -> Matrix6<f64> {
    (m + m.transpose()) * 0.5
}

/// U - I as nine numbers.
pub fn stretch_of(u: &Matrix3<f64>) -> Stretch {
    Stretch::from_fn(|k, _| u[(k / 3, k % 3)] - if k % 4 == 0 { 1.0 } else { 0.0 })
}
