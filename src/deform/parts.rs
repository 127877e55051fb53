//! The rigid parts of a body: x_i = Σ_p w_ip (R_p y_i + t_p) of deformed places y_i.
//!
//! In: weights, the motion of every part and places. Out: the places moved. Bodies of one part never come here. The twin on
//! the graphics device is `shaders/parts.wgsl`.

use crate::base::parts::{PartMotion, PartShare, PartWeights};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// Nodes that are worth a thread of their own.
const NODES_PER_THREAD: usize = 1 << 14;

/// Moves the places of all nodes.
pub fn move_parts(weights: &PartWeights, parts: &[Isometry3<f64>], places: &mut [[f32; 3]]) {
    let motions: Vec<PartMotion> = parts.iter().map(PartMotion::from).collect();
    places
        .par_iter_mut()
        .enumerate()
        .with_min_len(NODES_PER_THREAD)
        .for_each(|(node, place)| *place = moved(weights.of(node), &motions, *place));
}

/// One node moved, in single precision as the device does it.
pub(super) fn moved(shares: &[PartShare], motions: &[PartMotion], place: [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for share in shares {
        let at = motions[share.part as usize].of(place);
        for axis in 0..3 {
            sum[axis] += share.weight * at[axis];
        }
    }
    sum
}

/// One node moved in double precision.
pub(super) fn moved_exactly(
    shares: &[PartShare],
    parts: &[Isometry3<f64>],
    place: Vector3<f64>,
) -> Vector3<f64> {
    let part = |share: &PartShare| {
        let motion = &parts[share.part as usize];
        (motion.rotation * place + motion.translation.vector) * f64::from(share.weight)
    };
    shares.iter().map(part).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_go_with_their_parts_and_between_them() {
        let parts = [
            Isometry3::new(Vector3::new(1.0, 0.0, 0.0), Vector3::zeros()),
            Isometry3::new(Vector3::new(0.0, 2.0, 0.0), Vector3::z() * std::f64::consts::FRAC_PI_2),
        ];
        let rows = [vec![(0, 1.0)], vec![(1, 1.0)], vec![(0, 0.25), (1, 0.75)]];
        let weights = PartWeights::new(2, &rows).unwrap();
        let mut places = [[0.5, 0.0, 0.25]; 3];
        move_parts(&weights, &parts, &mut places);
        let expected = [[1.5, 0.0, 0.25], [0.0, 2.5, 0.25], [0.375, 1.875, 0.25]];
        for (node, (place, expected)) in places.iter().zip(expected).enumerate() {
            let exact = moved_exactly(weights.of(node), &parts, Vector3::new(0.5, 0.0, 0.25));
            for axis in 0..3 {
                assert!((place[axis] - expected[axis]).abs() < 1e-6, "{place:?}");
                assert!((f64::from(place[axis]) - exact[axis]).abs() < 1e-6, "{place:?} {exact}");
            }
        }
    }
}
