//! Vertex normals of the deformed surface: the sum of the cross products of the triangles around each vertex,
//! which weighs them by area, then normalised. And the point of a surface that is nearest to a place: a triangle, and how much of
//! each corner.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Vertices of one strip: their sums and normals stay in the second-level cache, and waking a thread costs less.
const STRIP: usize = 4096;

/// Surfaces of fewer strips are done by one thread: two gain less there than waking one costs.
const FEWEST_STRIPS: usize = 4;

/// The normals of one surface, by all threads where it is large.
///
/// The vertices are cut into strips of consecutive numbers. Each strip adds up every triangle that has a corner in it, in
/// the order of the surface: triangles between two strips are computed twice, no thread waits for another, and the bits
/// are those of [`vertex_normals`].
pub struct SurfaceNormals {
    sums: Vec<[f32; 4]>,
    /// The triangles of each strip, one strip after the other; empty for a small surface.
    triangles: Vec<[u32; 3]>,
    /// End of each strip's triangles.
    ends: Vec<usize>,
}

impl SurfaceNormals {
    /// Normals of a surface with `vertices` vertices.
    pub fn new(triangles: &[[u32; 3]], vertices: usize) -> SurfaceNormals {
        let mut normals =
            SurfaceNormals { sums: vec![[0.0; 4]; vertices], triangles: Vec::new(), ends: Vec::new() };
        let strips = vertices.div_ceil(STRIP);
        if strips < FEWEST_STRIPS || rayon::current_num_threads() == 1 {
            return normals;
        }
        let mut of_strips = vec![Vec::new(); strips];
        for triangle in triangles {
            let mut touched = triangle.map(|corner| corner as usize / STRIP);
            touched.sort_unstable();
            for (i, strip) in touched.into_iter().enumerate() {
                if i == 0 || touched[i - 1] != strip {
                    of_strips[strip].push(*triangle);
                }
            }
        }
        // Numbers without any order in space would make most of the work twice or thrice.
        if of_strips.iter().map(Vec::len).sum::<usize>() * 2 > triangles.len() * 3 {
            return normals;
        }
        for strip in of_strips {
            normals.triangles.extend(strip);
            normals.ends.push(normals.triangles.len());
        }
        normals
    }

    /// Writes the normals as [`vertex_normals`] does; `triangles` and the number of positions are those of
    /// [`SurfaceNormals::new`].
    pub fn write(&mut self, positions: &[[f32; 3]], triangles: &[[u32; 3]], normals: &mut [[f32; 3]]) {
        if self.ends.is_empty() {
            return vertex_normals(positions, triangles, &mut self.sums, normals);
        }
        let strips = self.sums.par_chunks_mut(STRIP).zip(normals.par_chunks_mut(STRIP)).enumerate();
        strips.for_each(|(strip, (sums, normals))| {
            let start = strip.checked_sub(1).map_or(0, |before| self.ends[before]);
            sums.fill([0.0; 4]);
            for triangle in &self.triangles[start..self.ends[strip]] {
                let cross = cross(positions, triangle);
                for &corner in triangle {
                    if let Some(sum) = sums.get_mut((corner as usize).wrapping_sub(strip * STRIP)) {
                        add(sum, &cross);
                    }
                }
            }
            normalise(sums, normals);
        });
    }
}

/// Writes the unit normals of `positions` under `triangles` into `normals`; a vertex whose triangles vanish gets
/// (0, 0, 0). `sums` is scratch of one entry per vertex.
pub fn vertex_normals(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    sums: &mut Vec<[f32; 4]>,
    normals: &mut [[f32; 3]],
) {
    sums.clear();
    sums.resize(positions.len(), [0.0; 4]);
    for triangle in triangles {
        let cross = cross(positions, triangle);
        for &corner in triangle {
            add(&mut sums[corner as usize], &cross);
        }
    }
    normalise(sums, normals);
}

/// The triangle's normal, twice its area long; the fourth number is 0, for sums of whole vectors.
#[inline(always)]
fn cross(positions: &[[f32; 3]], triangle: &[u32; 3]) -> [f32; 4] {
    let [pa, pb, pc] = triangle.map(|corner| positions[corner as usize]);
    let (ux, uy, uz) = (pb[0] - pa[0], pb[1] - pa[1], pb[2] - pa[2]);
    let (vx, vy, vz) = (pc[0] - pa[0], pc[1] - pa[1], pc[2] - pa[2]);
    [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx, 0.0]
}

#[inline(always)]
fn add(sum: &mut [f32; 4], cross: &[f32; 4]) {
    for (sum, cross) in sum.iter_mut().zip(cross) {
        *sum += cross;
    }
}

fn normalise(sums: &[[f32; 4]], normals: &mut [[f32; 3]]) {
    for (normal, sum) in normals.iter_mut().zip(sums) {
        // Scaled first: the square of a nanometre's area is no f32.
        let largest = sum[0].abs().max(sum[1].abs()).max(sum[2].abs());
        let unit = if largest > 0.0 { 1.0 / largest } else { 0.0 };
        let [x, y, z] = [sum[0] * unit, sum[1] * unit, sum[2] * unit];
        let scale = 1.0 / (x * x + y * y + z * z).max(f32::MIN_POSITIVE).sqrt();
        *normal = [x * scale, y * scale, z * scale];
    }
}

/// Corners, their shares, and how far the point is from the place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    pub corners: [u32; 3],
    pub weights: [f64; 3],
    pub away: f64,
}

/// The point nearest to `place` of triangles whose corners are where `at` says; `None` where none has an area.
pub fn nearest_point(
    triangles: &[[u32; 3]],
    at: &dyn Fn(u32) -> Vector3<f64>,
    place: &Vector3<f64>,
) -> Option<NearestPoint> {
    let of = |&corners: &[u32; 3]| {
        let (weights, away) = nearest_in(&corners.map(at), place)?;
        Some(NearestPoint { corners, weights, away })
    };
    triangles.iter().filter_map(of).min_by(|a, b| a.away.total_cmp(&b.away))
}

/// Weights of the corners in the point of a triangle that is nearest to a place, and its distance; `None` without area.
fn nearest_in(corners: &[Vector3<f64>; 3], place: &Vector3<f64>) -> Option<([f64; 3], f64)> {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let area = normal.norm_squared();
    if !(area.is_finite() && area > 0.0) {
        return None;
    }
    let share =
        |from: &Vector3<f64>, to: &Vector3<f64>| (to - from).cross(&(place - from)).dot(&normal) / area;
    // A ray that hits an edge may come to lie beside it by rounding.
    let shares = [share(b, c), share(c, a), share(a, b)].map(|share| share.max(0.0));
    let weights = shares.map(|share| share / shares.iter().sum::<f64>());
    let nearest = a * weights[0] + b * weights[1] + c * weights[2];
    Some((weights, (nearest - place).norm()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wavy sheet of 200 x 150 vertices, in rows and with numbers shuffled within each fifth of it, on two threads.
    #[test]
    fn strips_on_several_threads_give_the_same_bits() {
        let (wide, high) = (200_u32, 150_u32);
        let number = |i: u32, j: u32| {
            let (part, at) = ((j * wide + i) / 6000, (j * wide + i) % 6000);
            part * 6000 + at * 7 % 6000
        };
        let mut positions = vec![[0.0; 3]; (wide * high) as usize];
        let mut triangles = Vec::new();
        for (i, j) in (0..high).flat_map(|j| (0..wide).map(move |i| (i, j))) {
            let (x, y) = (i as f32, j as f32);
            positions[number(i, j) as usize] = [x, y, (0.3 * x).sin() + (0.2 * y).cos()];
            if i + 1 < wide && j + 1 < high {
                let corners = [number(i, j), number(i + 1, j), number(i, j + 1), number(i + 1, j + 1)];
                triangles
                    .extend([[corners[0], corners[1], corners[2]], [corners[2], corners[1], corners[3]]]);
            }
        }
        let mut exact = vec![[0.0; 3]; positions.len()];
        vertex_normals(&positions, &triangles, &mut Vec::new(), &mut exact);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        pool.install(|| {
            let mut made = vec![[1.0; 3]; positions.len()];
            let mut normals = SurfaceNormals::new(&triangles, positions.len());
            assert!(normals.ends.len() == 8 && normals.triangles.len() > triangles.len());
            for _ in 0..2 {
                normals.write(&positions, &triangles, &mut made);
                assert!(made == exact);
            }
        });
    }

    #[test]
    fn octahedron_normals_point_from_its_centre() {
        let positions = [
            [2.0, 0.0, 0.0],
            [-2.0, 0.0, 0.0],
            [0.0, 2.0, 0.0],
            [0.0, -2.0, 0.0],
            [0.0, 0.0, 2.0],
            [0.0, 0.0, -2.0],
        ];
        let triangles =
            [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        let mut normals = [[0.0; 3]; 6];
        vertex_normals(&positions, &triangles, &mut Vec::new(), &mut normals);
        for (normal, position) in normals.iter().zip(positions) {
            assert!((0..3).all(|axis| (normal[axis] - 0.5 * position[axis]).abs() < 1e-6), "{normals:?}");
        }
    }

    #[test]
    fn a_body_of_a_nanometre_has_normals() {
        let mut normals = [[0.0; 3]; 3];
        let positions = [[0.0; 3], [1e-12, 0.0, 0.0], [0.0, 1e-12, 0.0]];
        vertex_normals(&positions, &[[0, 1, 2]], &mut Vec::new(), &mut normals);
        assert!(normals.iter().all(|n| (n[2] - 1.0).abs() < 1e-6), "{normals:?}");
    }

    #[test]
    fn collapsed_triangles_give_zero_not_nan() {
        let mut normals = [[1.0; 3]; 3];
        vertex_normals(&[[1.0; 3]; 3], &[[0, 1, 2]], &mut Vec::new(), &mut normals);
        assert_eq!(normals, [[0.0; 3]; 3]);
    }

    #[test]
    fn a_place_beside_an_edge_belongs_to_the_edge() {
        let corners = [Vector3::zeros(), Vector3::x(), Vector3::y()];
        let (weights, away) = nearest_in(&corners, &Vector3::new(0.5, -1e-9, 0.2)).unwrap();
        assert!((weights[0] - 0.5).abs() < 1e-6 && weights[2] == 0.0 && (away - 0.2).abs() < 1e-6);
        assert_eq!(nearest_in(&[Vector3::x(); 3], &Vector3::zeros()), None);
    }
}
