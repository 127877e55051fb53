//! The convex hull of a few points around the origin: triangles, and the flat faces that they make.
//!
//! In: up to some thirty points, none of them twice. Out: the triangles whose planes have all points on one side,
//! counter-clockwise as seen from outside. Every three points are tried: that takes less than a millisecond, once for a stage.

use nalgebra::Vector3;

/// The triangles of the hull.
pub fn triangles(points: &[Vector3<f64>]) -> Vec<[usize; 3]> {
    let points = lifted(points);
    let count = points.len();
    let mut found = Vec::new();
    for i in 0..count {
        for j in i + 1..count {
            for k in j + 1..count {
                let normal = (points[j] - points[i]).cross(&(points[k] - points[i]));
                let others = (0..count).filter(|other| ![i, j, k].contains(other));
                let above = others.filter(|&other| normal.dot(&(points[other] - points[i])) > 0.0).count();
                match above {
                    0 => found.push([i, j, k]),
                    above if above == count - 3 => found.push([i, k, j]),
                    _ => {}
                }
            }
        }
    }
    found
}

/// The points, each a little farther out, so that no four lie in a plane, as the corners of a box do: four in a plane would have
/// two pairs of triangles.
fn lifted(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let stretched = |k: usize| 1.0 + 1e-7 * (k as f64 * 0.618_033_988_749_895).fract();
    points.iter().enumerate().map(|(k, point)| point * stretched(k)).collect()
}

/// The corners of each flat face in order around it: triangles that meet at less than `degrees` are joined.
pub fn faces(points: &[Vector3<f64>], degrees: f64) -> Vec<Vec<usize>> {
    let triangles = triangles(points);
    let normal = |[i, j, k]: [usize; 3]| (points[j] - points[i]).cross(&(points[k] - points[i])).normalize();
    let mut face_of: Vec<usize> = (0..triangles.len()).collect();
    for a in 0..triangles.len() {
        for b in 0..a {
            let common = triangles[a].iter().filter(|corner| triangles[b].contains(corner)).count();
            if common == 2 && normal(triangles[a]).dot(&normal(triangles[b])) > degrees.to_radians().cos() {
                let [from, to] = [face_of[a], face_of[b]];
                face_of.iter_mut().filter(|face| **face == from).for_each(|face| *face = to);
            }
        }
    }
    let face = |face: usize| {
        let mine = (0..triangles.len()).filter(|&t| face_of[t] == face).map(|t| triangles[t]);
        outline(&mine.collect::<Vec<_>>())
    };
    (0..triangles.len()).map(face).filter(|outline| !outline.is_empty()).collect()
}

/// The corners around some triangles that hang together: their edges without those that two of them share.
fn outline(triangles: &[[usize; 3]]) -> Vec<usize> {
    let edges = |&[i, j, k]: &[usize; 3]| [[i, j], [j, k], [k, i]];
    let all: Vec<[usize; 2]> = triangles.iter().flat_map(edges).collect();
    let outer: Vec<[usize; 2]> = all.iter().filter(|[a, b]| !all.contains(&[*b, *a])).copied().collect();
    let Some([first, mut at]) = outer.first().copied() else { return Vec::new() };
    let mut corners = vec![first];
    while at != first && corners.len() <= outer.len() {
        corners.push(at);
        let Some([_, next]) = outer.iter().find(|[from, _]| *from == at) else { break };
        at = *next;
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn box_corners(half: [f64; 3]) -> Vec<Vector3<f64>> {
        let corner =
            |k: usize| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half[axis] } else { half[axis] });
        (0..8).map(|k| corner(k).normalize()).collect()
    }

    /// Euler's formula, and every triangle faces outwards.
    #[test]
    fn a_sphere_of_v_corners_has_2v_minus_4_triangles() {
        let mut random = crate::base::random::Random::default();
        for count in [4, 6, 9, 16, 22] {
            let mut draw = || Vector3::from_fn(|_, _| random.draw());
            let axes =
                [Vector3::new(1.0, 1.0, 1.0), Vector3::new(-1.0, -1.0, 1.0), Vector3::new(-1.0, 1.0, -1.0)];
            let mut directions: Vec<Vector3<f64>> = axes.map(|axis| axis.normalize()).into();
            directions.push(Vector3::new(1.0, -1.0, -1.0).normalize());
            directions.extend((4..count).map(|_| draw().normalize()));
            let triangles = triangles(&directions);
            assert_eq!(triangles.len(), 2 * count - 4);
            for [i, j, k] in triangles {
                assert!(directions[i].dot(&directions[j].cross(&directions[k])) > 0.0);
            }
        }
        for half in [[1.0, 1.0, 1.0], [1.5, 1.2, 1.5]] {
            assert_eq!(triangles(&box_corners(half)).len(), 12);
        }
    }

    #[test]
    fn a_box_has_six_faces_of_four_corners_around() {
        let corners = box_corners([1.5, 1.2, 1.5]);
        let faces = faces(&corners, 3.0);
        assert_eq!(faces.iter().map(Vec::len).collect::<Vec<_>>(), [4; 6]);
        for face in faces {
            for k in 0..4 {
                let [a, b] = [face[k], face[(k + 1) % 4]];
                assert_eq!((a ^ b).count_ones(), 1, "an edge of the box: {a} {b}");
            }
        }
    }
}
