//! The surface of the finite-element body on the rod.
//!
//! In: the surface at rest, which of its nodes the control elements hold, and the Green's fields. Out: the weights w_ip of
//! the moving frames, a quadratic spline along the rod, and for each frame in time a field y so that
//! x = Σ_p w_ip (R_p (X + y) + t_p).
//!
//! Parts are the first clamp, the middles of the n segments, the last clamp, and the two control elements, whose nodes
//! go exactly where the hand holds them. The field is what the body does beyond its rod: with the wrench q(s) at the
//! section s, brought to the middle of the rod at rest,
//!
//! ```text
//! y(X) = Σ_k W_k(X) q_k(s) + Σ_j Y_j(X) (U_e - I)_j    W_k = Green's field of a unit wrench - the skin of the linear rod
//! ```
//!
//! so that small motions give the finite-element solution itself: the contraction across the rod (Poisson), the warping of
//! its sections (Saint-Venant), and what happens close to its ends are in it.

use super::chain::Chain;
use super::section::{Section, rigid_fields, shift};
use crate::base::parts::PartWeights;
use crate::deform::pose::se3::{halves, joined};
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, Translation3, Vector3, Vector6};

/// Fields: six of the wrench, and six of each end's stretch.
const FIELDS: usize = 18;
/// The rows and columns of the six numbers of a symmetric stretch.
const STRETCHES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)];

/// Parts that move a node, and their weights: the first of three that stand side by side.
struct Place {
    first: usize,
    weights: [f64; 3],
    /// Segments from the middle of the first one.
    at: f64,
    /// The control element that holds it.
    held: Option<usize>,
}

/// A surface on a rod.
pub struct Skin {
    places: Vec<Place>,
    /// The place at rest of the frame that each part is.
    rest: Vec<Isometry3<f64>>,
    segments: usize,
    axis: Vector3<f64>,
    middle: Vector3<f64>,
    /// W and Y, node after node.
    fields: Vec<[[f32; 3]; FIELDS]>,
    /// Offset of each node: a held one's from its control element's origin, another's from the axis.
    offsets: Vec<[f32; 3]>,
    field: Vec<[f32; 3]>,
}

impl Skin {
    /// `held`: the surface nodes of both control elements; `columns`: Green's 24 columns over the surface.
    pub fn new(
        section: &Section,
        segments: usize,
        origins: [Vector3<f64>; 2],
        rest: &[[f32; 3]],
        held: &[Vec<u32>; 2],
        columns: Option<&DMatrix<f64>>,
    ) -> Skin {
        let (axis, length) = (section.axis(), (section.ends[1] - section.ends[0]).norm());
        let point = |x: &[f32; 3]| Vector3::from(*x).cast::<f64>();
        let mut places: Vec<Place> = rest
            .iter()
            .map(|x| Place::at((point(x) - section.ends[0]).dot(&axis) / length, segments))
            .collect();
        let across = |x: &[f32; 3]| {
            let from = point(x) - section.ends[0];
            <[f32; 3]>::from((from - axis * axis.dot(&from)).cast::<f32>())
        };
        let mut offsets: Vec<[f32; 3]> = rest.iter().map(across).collect();
        for (e, nodes) in held.iter().enumerate() {
            for &node in nodes {
                if let Some(place) = places.get_mut(node as usize) {
                    place.held = Some(e);
                    offsets[node as usize] = (point(&rest[node as usize]) - origins[e]).cast::<f32>().into();
                }
            }
        }
        let share = |p: usize| ((p as f64 - 0.5) / segments as f64).clamp(0.0, 1.0);
        let mut frames: Vec<Isometry3<f64>> = (0..segments + 2).map(|p| section.frame_at(share(p))).collect();
        frames.extend(origins.map(|origin| Isometry3::from(Translation3::from(origin))));
        let middle = (section.ends[0] + section.ends[1]) * 0.5;
        let mut skin = Skin {
            places,
            rest: frames,
            segments,
            axis,
            middle,
            fields: Vec::new(),
            offsets,
            field: vec![[0.0; 3]; rest.len()],
        };
        if let Some(columns) = columns.filter(|columns| columns.shape() == (3 * rest.len(), 24)) {
            skin.fields = skin.beyond_the_rod(section, origins, rest, columns);
        }
        skin
    }

    pub fn weights(&self) -> Result<PartWeights, String> {
        let row = |place: &Place| match place.held {
            Some(e) => vec![((self.segments + 2 + e) as u32, 1.0)],
            None => (0..3).map(|k| ((place.first + k) as u32, place.weights[k])).collect(),
        };
        PartWeights::new(self.rest.len(), &self.places.iter().map(row).collect::<Vec<_>>())
    }

    /// The motion of every part; `controls`: the frames of the control elements.
    pub fn motions(&self, chain: &Chain, controls: &[Isometry3<f64>; 2], motions: &mut Vec<Isometry3<f64>>) {
        motions.clear();
        motions.push(chain.frames[0]);
        motions.extend((0..self.segments).map(|i| {
            // The spline of moving frames cuts the corner: by r''ℓ²/8, which is R (ω × v)/8.
            let (v, turn) = halves(&chain.screw(i));
            chain.middle(i) * Translation3::from(turn.cross(&v) / 8.0)
        }));
        motions.push(chain.frames[self.segments]);
        motions.extend(controls);
        for (motion, rest) in motions.iter_mut().zip(&self.rest) {
            *motion *= rest.inverse();
        }
    }

    /// y of all nodes for the wrenches in the rod, and U - I of both ends, of a rod that warmth lengthens by `strain`.
    pub fn update(&mut self, chain: &Chain, stretches: [&Matrix3<f64>; 2], strain: f64) -> &[[f32; 3]] {
        let wrench = |i: usize| {
            let arm = self.axis * (chain.length() * ((i as f64 + 0.5) / self.segments as f64 - 0.5));
            let (force, moment) = halves(&chain.linear_wrench(i));
            joined(&force, &(moment + arm.cross(&force))).cast::<f32>()
        };
        let wrenches: Vec<Vector6<f32>> = (0..self.segments).map(wrench).collect();
        let stretch: Vec<f32> = stretches
            .iter()
            .flat_map(|u| {
                STRETCHES.map(|(i, j)| (u[(i, j)] - if i == j { 1.0 + strain } else { 0.0 }) as f32)
            })
            .collect();
        let is_stretched = stretch.iter().any(|s| *s != 0.0);
        let affine = stretches.map(|u| (u - Matrix3::identity()).cast::<f32>());
        for (node, place) in self.places.iter().enumerate() {
            if let Some(e) = place.held {
                self.field[node] = (affine[e] * Vector3::from(self.offsets[node])).into();
                continue;
            }
            let Some(fields) = self.fields.get(node) else { continue };
            let at = place.at.clamp(0.0, (self.segments - 1) as f64);
            let i = (at as usize).min(self.segments - 2);
            let q = wrenches[i].lerp(&wrenches[i + 1], (at - i as f64) as f32);
            let mut y = self.offsets[node].map(|across| strain as f32 * across);
            let mut add =
                |share: f32, field: &[f32; 3]| (0..3).for_each(|axis| y[axis] += share * field[axis]);
            (0..6).for_each(|k| add(q[k], &fields[k]));
            if is_stretched {
                (0..12).for_each(|j| add(stretch[j], &fields[6 + j]));
            }
            self.field[node] = y;
        }
        &self.field
    }

    pub fn field(&self) -> &[[f32; 3]] {
        &self.field
    }

    /// W and Y.
    fn beyond_the_rod(
        &self,
        section: &Section,
        origins: [Vector3<f64>; 2],
        rest: &[[f32; 3]],
        columns: &DMatrix<f64>,
    ) -> Vec<[[f32; 3]; FIELDS]> {
        let linear = LinearRod::new(section, self.segments);
        // Green's fields by unit wrenches on the middle: where those bring the last origin, the first one being held.
        let to_origin = shift(&(self.middle - origins[1]));
        let moved = to_origin * linear.compliance;
        let mut coefficients = DMatrix::zeros(24, FIELDS);
        let rigid = rigid_fields(1);
        coefficients.columns_mut(0, 6).copy_from(&(&rigid * moved));
        // A stretch, with the last element let go, as the rod sees it: from where it has no strain.
        let (mut carried, last_end) = (DMatrix::<f64>::zeros(6, FIELDS), section.ends[1]);
        for j in 0..12 {
            let (e, (row, column)) = (j / 6, STRETCHES[j % 6]);
            let mut stretch = nalgebra::SVector::<f64, 9>::zeros();
            stretch[3 * row + column] = 1.0;
            stretch[3 * column + row] = 1.0;
            (0..9).for_each(|k| coefficients[(12 * e + 3 + k, 6 + j)] = stretch[k]);
            let offset = section.offsets[e] * stretch;
            // Where the last origin goes beside the first; and the rod, with the first end's offset.
            let (goes, rod) = if e == 0 {
                (shift(&(section.ends[0] - origins[1])) * offset, offset)
            } else {
                (-(shift(&(last_end - origins[1])) * offset), Vector6::zeros())
            };
            let mut fields = coefficients.column_mut(6 + j);
            fields += &rigid * goes;
            carried.set_column(6 + j, &rod);
        }
        let fields = columns * coefficients;
        let node = |i: usize| {
            let x = Vector3::from(rest[i]).cast::<f64>();
            std::array::from_fn(|f| {
                let green = fields.fixed_view::<3, 1>(3 * i, f).into_owned();
                let rod = if f < 6 {
                    self.linear_skin(&linear, f, i, &x)
                } else {
                    let (v, turn) = halves(&carried.column(f).into_owned().fixed_rows::<6>(0).into_owned());
                    v + turn.cross(&(x - section.ends[0]))
                };
                (green - rod).cast::<f32>().into()
            })
        };
        (0..rest.len()).map(node).collect()
    }

    /// Displacement of node `i` by the skin alone for unit wrench `k`.
    fn linear_skin(&self, linear: &LinearRod, k: usize, i: usize, x: &Vector3<f64>) -> Vector3<f64> {
        let place = &self.places[i];
        let part = |p: usize| {
            let (v, turn) = halves(&linear.parts[p][k]);
            v + turn.cross(&(x - self.rest[p].translation.vector))
        };
        (0..3).map(|j| part(place.first + j) * place.weights[j]).sum()
    }
}

impl Place {
    /// A node so far along the rod, 0 to 1.
    fn at(share: f64, segments: usize) -> Place {
        let x = (share * segments as f64).clamp(0.0, segments as f64);
        let interval = (x as usize).min(segments - 1);
        let t = x - interval as f64;
        // Quadratic B-splines whose knots are the sections, those at the clamps threefold: part p stands over
        // knots p - 2 to p + 1 of the sections.
        let knot = |k: isize| k.clamp(0, segments as isize) as f64;
        let k = interval as isize;
        let left = |d: isize| x - knot(k + 1 - d);
        let right = |d: isize| knot(k + d) - x;
        let (a, b) = (right(1) / (right(1) + left(1)), left(1) / (right(1) + left(1)));
        let (c, d) = (a / (right(1) + left(2)), b / (right(2) + left(1)));
        debug_assert!(t >= 0.0);
        Place {
            first: interval,
            weights: [right(1) * c, left(2) * c + right(2) * d, left(1) * d],
            at: x - 0.5,
            held: None,
        }
    }
}

/// The linear rod: compliance on its middle, and how every part moves for unit wrenches there.
struct LinearRod {
    compliance: Matrix6<f64>,
    parts: Vec<[Vector6<f64>; 6]>,
}

impl LinearRod {
    fn new(section: &Section, segments: usize) -> LinearRod {
        let n = segments as f64;
        let chord = section.ends[1] - section.ends[0];
        let piece = chord.norm() / n;
        let flexible = section.stiffness.try_inverse().unwrap_or_else(Matrix6::zeros) * piece;
        let along = |share: f64| chord * (share - 0.5);
        // The motion of a section beside the first, about the middle of the rod, after 0, 1, … segments, and the strains
        // of these on their own middles.
        let (mut motions, mut strains) = (vec![Matrix6::zeros()], Vec::new());
        for i in 0..segments {
            let to_middle = shift(&along((i as f64 + 0.5) / n));
            strains.push(flexible * to_middle.transpose());
            motions.push(motions[i] + to_middle * strains[i]);
        }
        let of_part = |p: usize| -> [Vector6<f64>; 6] {
            let share = ((p as f64 - 0.5) / n).clamp(0.0, 1.0);
            let to_part = shift(&-along(share));
            std::array::from_fn(|k| match p {
                0 => to_part * motions[0].column(k),
                p if p > segments => to_part * motions[segments].column(k),
                p => {
                    // On the way of `Skin::motions`: half a segment is bent as the whole, and so is what the spline cuts.
                    let turn = halves(&strains[p - 1].column(k).into_owned()).1;
                    let mean = (motions[p - 1].column(k) + motions[p].column(k)) * 0.5;
                    to_part * mean + joined(&(turn.cross(&chord) / (4.0 * n)), &Vector3::zeros())
                }
            })
        };
        LinearRod { compliance: motions[segments], parts: (0..segments + 2).map(of_part).collect() }
    }
}
