//! Vertex normals of the deformed surface: the sum of the cross products of the triangles around each vertex,
//! which weighs them by area, then normalised.

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
        let [a, b, c] = triangle.map(|corner| corner as usize);
        let (pa, pb, pc) = (positions[a], positions[b], positions[c]);
        let (ux, uy, uz) = (pb[0] - pa[0], pb[1] - pa[1], pb[2] - pa[2]);
        let (vx, vy, vz) = (pc[0] - pa[0], pc[1] - pa[1], pc[2] - pa[2]);
        let cross = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx, 0.0];
        for corner in [a, b, c] {
            let sum = &mut sums[corner];
            for axis in 0..4 {
                sum[axis] += cross[axis];
            }
        }
    }
    for (normal, sum) in normals.iter_mut().zip(sums.iter()) {
        // Scaled first: the square of a nanometre's area is no f32.
        let largest = sum[0].abs().max(sum[1].abs()).max(sum[2].abs());
        let unit = if largest > 0.0 { 1.0 / largest } else { 0.0 };
        let [x, y, z] = [sum[0] * unit, sum[1] * unit, sum[2] * unit];
        let scale = 1.0 / (x * x + y * y + z * z).max(f32::MIN_POSITIVE).sqrt();
        *normal = [x * scale, y * scale, z * scale];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
