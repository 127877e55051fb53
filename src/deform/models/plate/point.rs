//! A Kirchhoff–Love shell at one place of its middle surface r: strains, and what they do to the control points.
//!
//! In: derivatives of the nine splines by arc lengths along two orthogonal directions of the surface at rest. Out: membrane
//! strains and changes of curvature, energy, its gradient and Hessian by the control points.
//!
//! ```text
//! ε_ab = ½ (a_a·a_b - δ_ab) + s_ab - warmth δ_ab    κ_ab = b_ab - b⁰_ab    a_a = r,a    b_ab = r,ab·n    n = a_1 × a_2/|a_1 × a_2|
//! s = h²/24 (p (κ₁₁² - ν' κ₁₁ κ_cc, κ₂₂² - ν' κ₂₂ κ_cc, 2 (1 - ν') κ₁₂ κ_cc) + q (κ₁₂², κ₁₂², 0))
//! V = ∫ ½ εᵀ A ε + ½ κᵀ D κ    δb_ab = n·(δr,ab - Γ^c_ab δa_c)    Γ^c_ab = r,ab·aᶜ
//! δ²b_ab = -2 (n·δa_c) aᶜ·(δr,ab - Γ^d_ab δa_d) - b_ab a^cd (n·δa_c)(n·δa_d)
//! ```
//!
//! with St. Venant and Kirchhoff's law for plane stress, ε = (ε₁₁, ε₂₂, 2 ε₁₂), κ and s alike (Kiendl, Bletzinger, Linhard
//! and Wüchner, CMAME 198, 2009, 3902-3914; Ciarlet, An Introduction to Differential Geometry, section 4.1). s is the mean over
//! the thickness of Green's strain of second order in z κ, for fibres z that contract as plane stress has them, with
//! p = q = 1 and ν' = ν/(1 - ν): what is bent is also stretched.

use super::spline::Shape;
use crate::solve::envelope::Envelope;
use nalgebra::{Matrix2, Matrix3, Vector3};

/// Stiffness against strains along both directions, their product, and shear: of (ε₁₁, ε₂₂, 2 ε₁₂).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Law {
    pub first: f64,
    pub second: f64,
    pub mixed: f64,
    pub shear: f64,
}

impl Law {
    /// Plane stress, E/(1 - ν²) and the like.
    pub fn isotropic(young: f64, poisson: f64) -> Law {
        let plane = young / (1.0 - poisson * poisson);
        Law { first: plane, second: plane, mixed: poisson * plane, shear: 0.5 * young / (1.0 + poisson) }
    }

    #[inline(always)]
    pub fn stress(&self, e: [f64; 3]) -> [f64; 3] {
        [self.first * e[0] + self.mixed * e[1], self.second * e[1] + self.mixed * e[0], self.shear * e[2]]
    }

    pub fn scaled(&self, by: f64) -> Law {
        Law {
            first: self.first * by,
            second: self.second * by,
            mixed: self.mixed * by,
            shear: self.shear * by,
        }
    }
}

/// A place of integration.
#[derive(Clone, Debug)]
pub struct Point {
    pub nodes: [usize; 9],
    /// First derivatives of the splines, 1/m, and the second ones by 11, 22 and 12, 1/m².
    pub slope: [[f64; 2]; 9],
    pub second: [[f64; 3]; 9],
    /// b⁰_11, b⁰_22 and 2 b⁰_12, 1/m.
    pub curvature: [f64; 3],
    /// h²/24 p and h²/24 q, m², and ν'.
    pub second_order: [f64; 2],
    pub contraction: f64,
    /// Green's strain of a surface without stress: that of warmth.
    pub warmth: f64,
    /// The area that it stands for at rest, m², and the thickness there, m.
    pub area: f64,
    pub thickness: f64,
    /// A and D times the area.
    pub membrane: Law,
    pub bending: Law,
}

/// The surface at a point.
pub struct Local {
    /// a_1, a_2 and n, a¹ and a², and a^11, a^22, a^12.
    pub tangents: [Vector3<f64>; 2],
    pub normal: Vector3<f64>,
    up: [Vector3<f64>; 2],
    metric: [f64; 3],
    /// b_11, b_22, 2 b_12.
    bent: [f64; 3],
    /// ∂s/∂κ.
    by_bending: [[f64; 3]; 3],
    /// n·δr,ab less Γ, for each control point: ∂b/∂q_i = m_i n, the last one doubled.
    m: [[f64; 3]; 9],
    /// ε and κ.
    pub strain: [[f64; 3]; 2],
}

impl Local {
    /// The moment that works on κ: M + (∂s/∂κ)ᵀ N.
    #[inline(always)]
    fn moment(&self, [n, m]: &[[f64; 3]; 2]) -> [f64; 3] {
        let [x, y, z] = &self.by_bending;
        let of = |i: usize| m[i] + x[i] * n[0] + y[i] * n[1] + z[i] * n[2];
        [of(0), of(1), of(2)]
    }
}

/// ½ ε·σ.
#[inline(always)]
pub fn half_product(strain: &[[f64; 3]; 2], stress: &[[f64; 3]; 2]) -> f64 {
    0.5 * (dot(&strain[0], &stress[0]) + dot(&strain[1], &stress[1]))
}

#[inline(always)]
fn dot(x: &[f64; 3], y: &[f64; 3]) -> f64 {
    x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
}

impl Point {
    /// The splines at a place, where the surface at rest has these control points; `None` where it has no tangent plane.
    pub fn new(shape: &Shape, rest: &[Vector3<f64>], cell_area: f64, thickness: f64) -> Option<Point> {
        let [x, y] = shape.tangents(rest);
        let normal = x.cross(&y);
        let first = x.try_normalize(0.0)?;
        let second = normal.cross(&x).try_normalize(0.0)?;
        // (x, y) of arc lengths.
        let lengths = Matrix2::new(first.dot(&x), first.dot(&y), second.dot(&x), second.dot(&y));
        let t = lengths.try_inverse()?;
        let by = |k: usize| {
            let [x, y] = shape.slope[k];
            [x * t[(0, 0)] + y * t[(1, 0)], x * t[(0, 1)] + y * t[(1, 1)]]
        };
        let twice = |k: usize| {
            let [xx, yy, xy] = shape.second[k];
            let of = |a: usize, b: usize| {
                xx * t[(0, a)] * t[(0, b)]
                    + yy * t[(1, a)] * t[(1, b)]
                    + xy * (t[(0, a)] * t[(1, b)] + t[(1, a)] * t[(0, b)])
            };
            [of(0, 0), of(1, 1), of(0, 1)]
        };
        let mut point = Point {
            nodes: shape.nodes,
            slope: std::array::from_fn(by),
            second: std::array::from_fn(twice),
            curvature: [0.0; 3],
            second_order: [0.0; 2],
            contraction: 0.0,
            warmth: 0.0,
            area: cell_area * normal.norm(),
            thickness,
            membrane: Law::default(),
            bending: Law::default(),
        };
        point.curvature = point.local(rest)?.bent;
        Some(point)
    }

    /// Couples stretching to bending: what is bent is also stretched, by p and q.
    pub fn stretch_with_bending(&mut self, poisson: f64, shares: [f64; 2]) {
        self.contraction = poisson / (1.0 - poisson);
        self.second_order = shares.map(|share| share * self.thickness * self.thickness / 24.0);
    }

    /// s of κ, and ∂s/∂κ.
    #[inline(always)]
    fn stretch_of(&self, bending: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        let ([g, t], c, [x, y, z]) = (self.second_order, self.contraction, *bending);
        let stretch = [
            g * (x * x - c * (x + y) * x) + 0.25 * t * z * z,
            g * (y * y - c * (x + y) * y) + 0.25 * t * z * z,
            g * (1.0 - c) * (x + y) * z,
        ];
        let slope = [
            [g * (2.0 * x - c * (2.0 * x + y)), -g * c * x, 0.5 * t * z],
            [-g * c * y, g * (2.0 * y - c * (x + 2.0 * y)), 0.5 * t * z],
            [g * (1.0 - c) * z, g * (1.0 - c) * z, g * (1.0 - c) * (x + y)],
        ];
        (stretch, slope)
    }

    /// Σ N ∂²s/∂κ².
    #[inline]
    fn second_stretch(&self, n: &[f64; 3]) -> [[f64; 3]; 3] {
        let ([g, t], c) = (self.second_order, self.contraction);
        let (own, mixed, shear) = (2.0 * g * (1.0 - c), -g * c * (n[0] + n[1]), g * (1.0 - c) * n[2]);
        [[own * n[0], mixed, shear], [mixed, own * n[1], shear], [shear, shear, 0.5 * t * (n[0] + n[1])]]
    }

    /// Inlined into loops that are compiled for the machine's vector instructions, as [`Point::add_gradient`] is.
    #[inline(always)]
    pub fn local(&self, q: &[Vector3<f64>]) -> Option<Local> {
        let (mut tangents, mut second) = ([Vector3::zeros(); 2], [Vector3::zeros(); 3]);
        for k in 0..9 {
            let q = &q[self.nodes[k]];
            for axis in 0..2 {
                tangents[axis] += q * self.slope[k][axis];
            }
            for pair in 0..3 {
                second[pair] += q * self.second[k][pair];
            }
        }
        let [a, b] = tangents;
        let cross = a.cross(&b);
        let size = cross.norm();
        if size.is_nan() || size <= 1e-12 {
            return None;
        }
        let normal = cross / size;
        let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
        let square = size * size;
        let metric = [bb / square, aa / square, -ab / square];
        let up = [a * metric[0] + b * metric[2], a * metric[2] + b * metric[1]];
        let twice = [1.0, 1.0, 2.0];
        let (mut m, mut bent, mut bending) = ([[0.0; 3]; 9], [0.0; 3], [0.0; 3]);
        for pair in 0..3 {
            let gamma = [up[0].dot(&second[pair]), up[1].dot(&second[pair])];
            for k in 0..9 {
                let [x, y] = self.slope[k];
                m[k][pair] = twice[pair] * (self.second[k][pair] - gamma[0] * x - gamma[1] * y);
            }
            bent[pair] = twice[pair] * second[pair].dot(&normal);
            bending[pair] = bent[pair] - self.curvature[pair];
        }
        let (s, by_bending) = self.stretch_of(&bending);
        let warm = self.warmth;
        let strain = [[0.5 * (aa - 1.0) + s[0] - warm, 0.5 * (bb - 1.0) + s[1] - warm, ab + s[2]], bending];
        Some(Local { tangents, normal, up, metric, bent, by_bending, m, strain })
    }

    #[inline(always)]
    pub fn stress(&self, strain: &[[f64; 3]; 2]) -> [[f64; 3]; 2] {
        [self.membrane.stress(strain[0]), self.bending.stress(strain[1])]
    }

    pub fn energy(&self, strain: &[[f64; 3]; 2]) -> f64 {
        half_product(strain, &self.stress(strain))
    }

    /// The change of the strains, to first order, with that of the control points.
    pub fn strain_by(&self, local: &Local, change: impl Fn(usize) -> Vector3<f64>) -> [[f64; 3]; 2] {
        let [a, b] = local.tangents;
        let (mut tangents, mut bent) = ([Vector3::zeros(); 2], [0.0; 3]);
        for k in 0..9 {
            let by = change(self.nodes[k]);
            tangents[0] += by * self.slope[k][0];
            tangents[1] += by * self.slope[k][1];
            let along = by.dot(&local.normal);
            for (bent, m) in bent.iter_mut().zip(&local.m[k]) {
                *bent += m * along;
            }
        }
        let [by_a, by_b] = tangents;
        let s = local.by_bending.map(|row| dot(&row, &bent));
        [[a.dot(&by_a) + s[0], b.dot(&by_b) + s[1], a.dot(&by_b) + b.dot(&by_a) + s[2]], bent]
    }

    /// Adds ∂V by the control points.
    #[inline(always)]
    pub fn add_gradient(&self, local: &Local, stress: &[[f64; 3]; 2], gradient: &mut [f64]) {
        let (n, moment) = (&stress[0], local.moment(stress));
        for k in 0..9 {
            let [x, y] = self.slope[k];
            let m = &local.m[k];
            let force = local.tangents[0] * (n[0] * x + n[2] * y)
                + local.tangents[1] * (n[1] * y + n[2] * x)
                + local.normal * (moment[0] * m[0] + moment[1] * m[1] + moment[2] * m[2]);
            let at = 3 * self.nodes[k];
            for (gradient, force) in gradient[at..at + 3].iter_mut().zip(&force) {
                *gradient += force;
            }
        }
    }

    /// Adds ∂²V by the control points, where the strains' own second derivatives meet the stresses `stress`.
    #[inline]
    pub fn add_hessian(&self, local: &Local, stress: &[[f64; 3]; 2], block: &mut Block) {
        let (n, moment) = (&stress[0], &local.moment(stress));
        let (a, d) = (&self.membrane, &self.bending);
        let ([a1, a2], normal) = (local.tangents, local.normal);
        let second = self.second_stretch(n);
        // A ∂s/∂κ m, and (D + (∂s/∂κ)ᵀ A ∂s/∂κ + N ∂²s/∂κ²) m.
        let pulled: [[f64; 3]; 9] =
            std::array::from_fn(|k| a.stress(local.by_bending.map(|row| dot(&row, &local.m[k]))));
        let stiff: [[f64; 3]; 9] = std::array::from_fn(|k| {
            let (m, pulled) = (&local.m[k], &pulled[k]);
            let own = d.stress(*m);
            std::array::from_fn(|i| {
                let by = local.by_bending.map(|row| row[i]);
                own[i] + dot(&by, pulled) + dot(&second[i], m)
            })
        });
        // What meets n from the side of each control point: the stretch by bending less aᶜ times the moment.
        let beta = dot(moment, &local.bent);
        let turned: [f64; 9] = std::array::from_fn(|k| dot(moment, &local.m[k]));
        let lever: [Vector3<f64>; 9] =
            std::array::from_fn(|k| local.up[0] * self.slope[k][0] + local.up[1] * self.slope[k][1]);
        let mut at = 0;
        for i in 0..9 {
            let [ix, iy] = self.slope[i];
            for j in 0..=i {
                let [jx, jy] = self.slope[j];
                let (xx, yy, mixed) = (ix * jx, iy * jy, ix * jy + iy * jx);
                let along = a1 * (a.first * xx + a.shear * yy) + a2 * (a.mixed * ix * jy + a.shear * iy * jx);
                let across =
                    a1 * (a.mixed * iy * jx + a.shear * ix * jy) + a2 * (a.second * yy + a.shear * xx);
                let lift = local.metric[0] * xx + local.metric[1] * yy + local.metric[2] * mixed;
                let (pi, pj) = (&pulled[i], &pulled[j]);
                let out = normal * (dot(&stiff[i], &local.m[j]) - beta * lift) - lever[i] * turned[j]
                    + a1 * (jx * pi[0] + jy * pi[2])
                    + a2 * (jy * pi[1] + jx * pi[2]);
                let back =
                    a1 * (ix * pj[0] + iy * pj[2]) + a2 * (iy * pj[1] + ix * pj[2]) - lever[j] * turned[i];
                let pull = n[0] * xx + n[1] * yy + n[2] * mixed;
                // a_1 ⊗ along + a_2 ⊗ across + n ⊗ out + back ⊗ n + pull I, column by column.
                let entries = &mut block.entries[at];
                for c in 0..3 {
                    for r in 0..3 {
                        entries[3 * c + r] +=
                            a1[r] * along[c] + a2[r] * across[c] + normal[r] * out[c] + back[r] * normal[c];
                    }
                    entries[4 * c] += pull;
                }
                at += 1;
            }
        }
    }
}

/// ∂²V by the nine control points of a cell: 3 × 3 numbers, column by column, of each pair i, j ≤ i.
pub struct Block {
    entries: [[f64; 9]; 45],
}

impl Block {
    pub const ZERO: Block = Block { entries: [[0.0; 9]; 45] };

    /// Adds the numbers to those of all control points, and is zero again.
    pub fn spill(&mut self, nodes: &[usize; 9], hessian: &mut Envelope) {
        let pairs = (0..9).flat_map(|i| (0..=i).map(move |j| (i, j)));
        for ((i, j), entries) in pairs.zip(&mut self.entries) {
            let (row, column) = (3 * nodes[i], 3 * nodes[j]);
            for c in 0..3 {
                for r in if i == j { c } else { 0 }..3 {
                    hessian.add(row + r, column + c, entries[3 * c + r]);
                }
            }
            entries.fill(0.0);
        }
    }
}

/// A place where a control element holds the surface, with springs that are stiff beside the shell's own.
///
/// ```text
/// V = ½ k |r - (p + M y)|² + ½ k_t Σ_a (a_a·M N)²
/// ```
#[derive(Clone, Debug)]
pub struct Grip {
    pub control: usize,
    pub nodes: [usize; 9],
    pub value: [f64; 9],
    pub slope: [[f64; 2]; 9],
    /// y: from the control element's origin to the middle surface at rest, m; N there.
    pub arm: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// Part of the cell's hold, times the thickness there, m; the mean square of the heights that are held, m².
    pub share: f64,
    pub spread: f64,
    /// k, N/m, and k_t, N·m.
    pub pull: f64,
    pub turn: f64,
}

/// The hold of a control element: its origin's place p = o + T, and M.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    pub place: Vector3<f64>,
    pub matrix: Matrix3<f64>,
}

/// A grip's springs as they are pulled and tilted.
pub struct Pulled {
    /// r less where it should be, and both a_a·M N.
    pub off: Vector3<f64>,
    pub tilt: [f64; 2],
    tangents: [Vector3<f64>; 2],
    fibre: Vector3<f64>,
}

impl Grip {
    pub fn pulled(&self, q: &[Vector3<f64>], hold: &Hold) -> Pulled {
        let (mut place, mut tangents) = (Vector3::zeros(), [Vector3::zeros(); 2]);
        for k in 0..9 {
            let q = &q[self.nodes[k]];
            place += q * self.value[k];
            tangents[0] += q * self.slope[k][0];
            tangents[1] += q * self.slope[k][1];
        }
        let fibre = hold.matrix * self.normal;
        let off = place - hold.place - hold.matrix * self.arm;
        Pulled { off, tilt: tangents.map(|a| a.dot(&fibre)), tangents, fibre }
    }

    pub fn energy(&self, pulled: &Pulled) -> f64 {
        let [x, y] = pulled.tilt;
        0.5 * (self.pull * pulled.off.norm_squared() + self.turn * (x * x + y * y))
    }

    pub fn add_gradient(&self, pulled: &Pulled, gradient: &mut [f64]) {
        let (force, [x, y]) = (pulled.off * self.pull, pulled.tilt);
        for k in 0..9 {
            let [by_x, by_y] = self.slope[k];
            let total = force * self.value[k] + pulled.fibre * (self.turn * (x * by_x + y * by_y));
            (0..3).for_each(|axis| gradient[3 * self.nodes[k] + axis] += total[axis]);
        }
    }

    pub fn add_hessian(&self, pulled: &Pulled, hessian: &mut Envelope) {
        let fibre = &pulled.fibre;
        for i in 0..9 {
            for j in 0..=i {
                let pull = self.pull * self.value[i] * self.value[j];
                let turn =
                    self.turn * (self.slope[i][0] * self.slope[j][0] + self.slope[i][1] * self.slope[j][1]);
                for r in 0..3 {
                    let most = if i == j { r } else { 2 };
                    for c in 0..=most {
                        let value = turn * fibre[r] * fibre[c] + if r == c { pull } else { 0.0 };
                        hessian.add(3 * self.nodes[i] + r, 3 * self.nodes[j] + c, value);
                    }
                }
            }
        }
    }

    /// ∂V by p and M.
    pub fn slope(&self, pulled: &Pulled) -> (Vector3<f64>, Matrix3<f64>) {
        let force = pulled.off * -self.pull;
        let [x, y] = pulled.tilt;
        let turned = (pulled.tangents[0] * x + pulled.tangents[1] * y) * self.turn;
        (force, force * self.arm.transpose() + turned * self.normal.transpose())
    }
}
