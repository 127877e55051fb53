//! Potentials of one flat triangle in closed form.
//!
//! In: a triangle and a point x. Out: the integrals over y in the triangle, with r = y - x,
//!
//! ```text
//! g = ∫ 1/r dA     H = ∫ r rᵀ/r³ dA     ∫ r·n/r³ φ_q dA     φ_q: 1 in corner q, 0 in the others, linear
//! ```
//!
//! by the theorem of Gauss in the plane: logarithms over the edges and the solid angle (Wilton, Rao, Glisson, Schaubert,
//! Al-Bundak and Butler, IEEE Trans. Antennas Propag. 32, 1984; the solid angle by Van Oosterom and Strackee, IEEE Trans.
//! Biomed. Eng. 30, 1983).

use nalgebra::{Matrix3, Vector3};

/// A flat triangle, counter-clockwise as seen from outside.
#[derive(Clone, Debug)]
pub struct Triangle {
    pub corners: [Vector3<f64>; 3],
    pub centre: Vector3<f64>,
    /// Unit normal, outward.
    pub normal: Vector3<f64>,
    pub area: f64,
    /// Of the circle about the centre that holds the corners.
    pub radius: f64,
    /// n × ∇φ_q of each corner.
    pub curls: [Vector3<f64>; 3],
    /// Unit vector along the edge behind each corner, and in the plane the one that points out of it.
    edges: [[Vector3<f64>; 2]; 3],
}

/// g and H; of the symmetric H the parts xx, xy, xz, yy, yz, zz.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pull {
    pub g: f64,
    pub h: [f64; 6],
}

impl Pull {
    /// With so much of another.
    pub fn plus(mut self, other: &Pull, weight: f64) -> Pull {
        self.g += weight * other.g;
        self.h.iter_mut().zip(&other.h).for_each(|(own, other)| *own += weight * other);
        self
    }

    /// Whether no number differs by more than `least`.
    pub fn is_near(&self, other: &Pull, least: f64) -> bool {
        (self.g - other.g).abs() < least && self.h.iter().zip(&other.h).all(|(a, b)| (a - b).abs() < least)
    }

    /// Adds a (b)ᵀ + b (a)ᵀ, halved, to H.
    pub fn add_product(&mut self, a: &Vector3<f64>, b: &Vector3<f64>, weight: f64) {
        let half = 0.5 * weight;
        self.h[0] += weight * a.x * b.x;
        self.h[1] += half * (a.x * b.y + a.y * b.x);
        self.h[2] += half * (a.x * b.z + a.z * b.x);
        self.h[3] += weight * a.y * b.y;
        self.h[4] += half * (a.y * b.z + a.z * b.y);
        self.h[5] += weight * a.z * b.z;
    }

    /// a g I + b H.
    pub fn combined(&self, a: f64, b: f64) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.h.map(|h| b * h);
        let g = a * self.g;
        Matrix3::new(g + xx, xy, xz, xy, g + yy, yz, xz, yz, g + zz)
    }
}

/// Of one point and a triangle: what its edges contribute.
struct Edges {
    /// ∫ ds/r.
    log: [f64; 3],
    /// Difference of the ends' distances.
    rise: [f64; 3],
    /// Distance of the edge's line in the plane, positive inside.
    off: [f64; 3],
    /// (y - x)·n.
    height: f64,
    solid_angle: f64,
}

impl Triangle {
    /// `None` of one without area.
    pub fn new(corners: [Vector3<f64>; 3]) -> Option<Triangle> {
        let [a, b, c] = corners;
        let across = (b - a).cross(&(c - a));
        let area = across.norm() / 2.0;
        let normal = across.try_normalize(0.0)?;
        let centre = (a + b + c) / 3.0;
        let radius = corners.iter().map(|x| (x - centre).norm()).fold(0.0, f64::max);
        let behind: [Vector3<f64>; 3] = std::array::from_fn(|q| corners[(q + 1) % 3] - corners[q]);
        let along = behind.map(|edge| edge.normalize());
        let edges = along.map(|along| [along, along.cross(&normal)]);
        let curls = std::array::from_fn(|q| -behind[(q + 1) % 3] / (2.0 * area));
        let is_sound = area > 0.0 && curls.iter().flatten().all(|x: &f64| x.is_finite());
        is_sound.then_some(Triangle { corners, centre, normal, area, radius, curls, edges })
    }

    /// ∇φ_q.
    fn slope(&self, q: usize) -> Vector3<f64> {
        self.curls[q].cross(&self.normal)
    }

    fn edges_from(&self, x: &Vector3<f64>) -> Edges {
        let r = self.corners.map(|corner| corner - x);
        let far = r.map(|r| r.norm());
        let (mut log, mut rise, mut off) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for e in 0..3 {
            let [along, out] = &self.edges[e];
            let next = (e + 1) % 3;
            let (from, to) = (r[e].dot(along), r[next].dot(along));
            off[e] = r[e].dot(out);
            rise[e] = far[next] - far[e];
            // Of the two equal quotients the one without cancellation.
            let quotient = if from + to >= 0.0 {
                (far[next] + to) / (far[e] + from).max(f64::MIN_POSITIVE)
            } else {
                (far[e] - from) / (far[next] - to).max(f64::MIN_POSITIVE)
            };
            // On the edge itself it is without bounds, and only multiplied with 0.
            log[e] = quotient.clamp(f64::MIN_POSITIVE, f64::MAX).ln();
        }
        let [a, b, c] = &r;
        let below = far[0] * far[1] * far[2] + a.dot(b) * far[2] + b.dot(c) * far[0] + c.dot(a) * far[1];
        let solid_angle = 2.0 * a.dot(&b.cross(c)).atan2(below);
        Edges { log, rise, off, height: r[0].dot(&self.normal), solid_angle }
    }

    /// g and H at x.
    pub fn pull(&self, x: &Vector3<f64>) -> Pull {
        let Edges { log, rise, off, height, solid_angle } = self.edges_from(x);
        let up = height * solid_angle;
        let g = (0..3).map(|e| off[e] * log[e]).sum::<f64>() - up;
        let n = &self.normal;
        // In the plane (I - n nᵀ) g, less what the edges take.
        let mut pull = Pull { g, h: [g, 0.0, 0.0, g, 0.0, g] };
        pull.add_product(n, n, up - g);
        let mut lean = Vector3::zeros();
        for e in 0..3 {
            let [along, out] = &self.edges[e];
            let across = off[e] * log[e];
            pull.add_product(out, &(out * across + along * rise[e]), -1.0);
            lean += out * (height * log[e]);
        }
        pull.add_product(n, &lean, -2.0);
        pull
    }

    /// -∫ r·n/r³ φ_q dA at x: what the corners' displacements are seen under, -4π all together from inside a closed surface.
    pub fn view(&self, x: &Vector3<f64>) -> [f64; 3] {
        let Edges { log, height, solid_angle, .. } = self.edges_from(x);
        let mut flow = Vector3::zeros();
        for e in 0..3 {
            flow += self.edges[e][1] * log[e];
        }
        let foot = x + self.normal * height - self.centre;
        std::array::from_fn(|q| {
            let slope = self.slope(q);
            -(1.0 / 3.0 + slope.dot(&foot)) * solid_angle + height * slope.dot(&flow)
        })
    }

    /// The point with these weights of the corners.
    pub fn at(&self, weights: &[f64; 3]) -> Vector3<f64> {
        self.corners[0] * weights[0] + self.corners[1] * weights[1] + self.corners[2] * weights[2]
    }
}
