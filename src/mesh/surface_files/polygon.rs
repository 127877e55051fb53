//! Faces of many corners as triangles.
//!
//! In: the corners of a face in their order. Out: triangles of the same orientation that use every corner: a fan about the first one where
//! none of its triangles is turned over, as in every convex face, else ears (G. H. Meisters, American Mathematical Monthly 82, 1975,
//! 648-651), the best shaped first.

use nalgebra::Vector3;

/// Corners up to which ears are cut off; their time grows with the square of the number.
pub const MOST_CORNERS: usize = 1024;
/// Times that all corners are judged anew, because none of those judged before is an ear: no plain face needs as many.
const MOST_ROUNDS: usize = 16;

/// Triangles, each of three positions in `corners`; `None` if the face crosses itself, or is concave with more than [`MOST_CORNERS`].
pub fn triangles(corners: &[Vector3<f64>]) -> Option<Vec<[usize; 3]>> {
    let fan: Vec<[usize; 3]> = (2..corners.len()).map(|i| [0, i - 1, i]).collect();
    let twice_area = |[a, b, c]: [usize; 3]| (corners[b] - corners[a]).cross(&(corners[c] - corners[a]));
    let whole: Vector3<f64> = fan.iter().map(|triangle| twice_area(*triangle)).sum();
    let is_turned_over = |triangle: &[usize; 3]| twice_area(*triangle).dot(&whole) < 0.0;
    if !fan.iter().any(is_turned_over) {
        return Some(fan);
    }
    if corners.len() > MOST_CORNERS {
        return None;
    }
    let (right, up) = axes(&whole);
    let flat: Vec<[f64; 2]> =
        corners.iter().map(|x| x - corners[0]).map(|x| [x.dot(&right), x.dot(&up)]).collect();
    Ears::new(&flat).cut()
}

/// Two directions that make a right-handed system with `normal`.
fn axes(normal: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let right = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    (right, normal.cross(&right).normalize())
}

/// The corners of a plane face that are left, counter-clockwise.
struct Ears<'a> {
    corners: &'a [[f64; 2]],
    left: Vec<usize>,
    /// Quality of the triangle of each corner that is left with its neighbours, as [`Ears::shape`] has it; `None` where it is no ear.
    shapes: Vec<Option<f64>>,
}

/// Twice the area of a triangle, positive where it is counter-clockwise.
fn doubled([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

impl<'a> Ears<'a> {
    fn new(corners: &'a [[f64; 2]]) -> Ears<'a> {
        let mut ears = Ears { corners, left: (0..corners.len()).collect(), shapes: Vec::new() };
        ears.judge_all();
        ears
    }

    fn cut(mut self) -> Option<Vec<[usize; 3]>> {
        let mut triangles = Vec::with_capacity(self.left.len());
        let mut rounds = 0;
        while self.left.len() > 3 {
            let at = match self.best() {
                Some(at) => at,
                None if rounds == MOST_ROUNDS => return None,
                None => {
                    rounds += 1;
                    self.judge_all();
                    self.best()?
                }
            };
            triangles.push(self.about(at));
            self.left.remove(at);
            self.shapes.remove(at);
            let count = self.left.len();
            for beside in [(at + count - 1) % count, at % count] {
                self.shapes[beside] = self.shape(beside);
            }
        }
        // What is left of a face that crosses itself is turned over.
        let last = self.about(1);
        triangles.push(last);
        (doubled(last.map(|corner| self.corners[corner])) >= 0.0).then_some(triangles)
    }

    fn best(&self) -> Option<usize> {
        let shapes = self.shapes.iter().enumerate().filter_map(|(at, shape)| Some((at, (*shape)?)));
        shapes.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
    }

    fn judge_all(&mut self) {
        self.shapes = (0..self.left.len()).map(|at| self.shape(at)).collect();
    }

    /// A corner that is left, between its neighbours.
    fn about(&self, at: usize) -> [usize; 3] {
        let count = self.left.len();
        [self.left[(at + count - 1) % count], self.left[at], self.left[(at + 1) % count]]
    }

    /// Area against the squares of the sides, if the triangle is turned as the face is and no other corner lies in it or on its rim.
    fn shape(&self, at: usize) -> Option<f64> {
        let own = self.about(at).map(|corner| self.corners[corner]);
        let area = doubled(own);
        let [a, b, c] = own;
        let is_inside =
            |x: [f64; 2]| doubled([a, b, x]) >= 0.0 && doubled([b, c, x]) >= 0.0 && doubled([c, a, x]) >= 0.0;
        let others = self.left.iter().map(|corner| self.corners[*corner]).filter(|x| !own.contains(x));
        if area <= 0.0 || others.into_iter().any(is_inside) {
            return None;
        }
        let square = |from: [f64; 2], to: [f64; 2]| (to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2);
        Some(area / (square(a, b) + square(b, c) + square(c, a)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Vector3<f64>], triangles: &[[usize; 3]]) -> f64 {
        let of = |[a, b, c]: [usize; 3]| (corners[b] - corners[a]).cross(&(corners[c] - corners[a])).norm();
        triangles.iter().map(|triangle| 0.5 * of(*triangle)).sum()
    }

    /// Whatever corner comes first and wherever the face lies, an L, a comb and a spiral keep their area, and every corner is used.
    #[test]
    fn concave_faces_keep_their_area() {
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let mut comb = vec![[10.0, 0.0], [10.0, 1.0]];
        comb.extend((0..10).rev().flat_map(|i| [[i as f64 + 0.5, 3.0], [i as f64, 1.0]]));
        comb.push([0.0, 0.0]);
        let tilt = nalgebra::Rotation3::new(Vector3::new(0.4, -1.1, 0.7));
        let arm = |k: usize, width: f64| {
            let (angle, radius) = (0.1 * k as f64, 1.0 + 0.02 * k as f64 + width);
            [radius * angle.cos(), radius * angle.sin()]
        };
        let out = (0..500).map(|k| arm(k, 0.5));
        let spiral: Vec<[f64; 2]> = out.chain((0..500).rev().map(|k| arm(k, 0.0))).collect();
        let shoelace = |flat: &[[f64; 2]]| {
            let next = flat.iter().cycle().skip(1);
            0.5 * flat.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
        };
        for (flat, exact) in [(&l[..], 3.0), (&comb[..], 20.0), (&spiral[..], shoelace(&spiral))] {
            for first in (0..flat.len()).step_by(1 + flat.len() / 30) {
                let order = (0..flat.len()).map(|i| flat[(first + i) % flat.len()]);
                let corners: Vec<Vector3<f64>> = order.map(|[x, y]| tilt * Vector3::new(x, y, 0.3)).collect();
                let found = triangles(&corners).unwrap();
                assert_eq!(found.len(), corners.len() - 2);
                assert!((area(&corners, &found) / exact - 1.0).abs() < 1e-12, "{first}: {found:?}");
                assert!((0..corners.len()).all(|corner| found.iter().flatten().any(|own| *own == corner)));
            }
        }
    }

    /// A square whose hole is joined to its rim by a cut that is walked twice.
    #[test]
    fn a_face_round_a_hole_keeps_its_area() {
        let corners = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]];
        let corners = corners.map(|[x, y]| Vector3::new(f64::from(x), f64::from(y), 0.0));
        let found = triangles(&corners).unwrap();
        assert!((area(&corners, &found) - 12.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_face_that_crosses_itself_is_told() {
        let corners = [[0.0, 0.0], [4.0, 3.0], [4.0, 0.0], [0.0, 1.0]];
        assert_eq!(triangles(&corners.map(|[x, y]| Vector3::new(x, y, 0.0))), None);
    }
}
