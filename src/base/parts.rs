//! Bodies of several rigid parts: how each part moves, and how much each part moves each node.
//!
//! In: a motion R_p, t_p of every part and a weight w_ip of every node. Out: what the sum on the CPU and the compute
//! shader both read for x_i = Σ_p w_ip (R_p y_i + t_p). A body of one part has no weights: its motion is that of the whole
//! body, and whoever draws it multiplies it into the body's place.

use nalgebra::Isometry3;

/// The share of one part in one node: `Share` of `shaders/parts.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PartShare {
    pub part: u32,
    pub weight: f32,
}

/// R_p and t_p in single precision, one row [R | t] an axis: `Motion` of `shaders/parts.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PartMotion {
    pub rows: [[f32; 4]; 3],
}

impl From<&Isometry3<f64>> for PartMotion {
    fn from(motion: &Isometry3<f64>) -> PartMotion {
        let matrix = motion.to_homogeneous();
        let rows = [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| matrix[(row, column)] as f32));
        PartMotion { rows }
    }
}

impl PartMotion {
    /// R x + t.
    #[inline(always)]
    pub fn apply(&self, x: [f32; 3]) -> [f32; 3] {
        self.rows.map(|[a, b, c, t]| a * x[0] + b * x[1] + c * x[2] + t)
    }
}

/// The weights w_ip of all nodes of a body: none is negative, and those of a node sum to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct PartWeights {
    parts: usize,
    /// Index at which the row of each node starts in `shares`; one more for the end.
    starts: Vec<u32>,
    shares: Vec<PartShare>,
}

/// Largest deviation from 1 of the sum of a node's weights; they are then scaled to 1.
const OFF: f64 = 1e-6;

impl PartWeights {
    /// One row of parts and their weights for each node, of a body of `parts` parts.
    pub fn new(parts: usize, rows: &[Vec<(u32, f64)>]) -> Result<PartWeights, String> {
        let (mut starts, mut shares) = (vec![0], Vec::new());
        for (node, row) in rows.iter().enumerate() {
            if let Some((part, _)) = row.iter().find(|(part, _)| *part as usize >= parts) {
                return Err(format!(
                    "node {node} names part {part}, but the body has {parts} parts, counted from 0"
                ));
            }
            let sum = row.iter().fold(0.0, |sum, (_, weight)| sum + weight);
            let is_one = (sum - 1.0).abs() <= OFF;
            if !is_one || row.iter().any(|(_, weight)| *weight < 0.0) {
                return Err(format!(
                    "the weights of node {node} are {row:?} with the sum {sum}: none may be negative, and their sum must be 1"
                ));
            }
            let share = |&(part, weight): &(u32, f64)| PartShare { part, weight: (weight / sum) as f32 };
            shares.extend(row.iter().map(share));
            let end = u32::try_from(shares.len())
                .map_err(|error| format!("{} weights are too many: {error}", shares.len()))?;
            starts.push(end);
        }
        Ok(PartWeights { parts, starts, shares })
    }

    pub fn parts(&self) -> usize {
        self.parts
    }

    pub fn nodes(&self) -> usize {
        self.starts.len() - 1
    }

    /// Indices at which the row of each node starts in [`PartWeights::shares`]; one more for the end.
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    pub fn shares(&self) -> &[PartShare] {
        &self.shares
    }

    /// The parts that move a node.
    pub fn at(&self, node: usize) -> &[PartShare] {
        &self.shares[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_a_partition_of_one() {
        let rows = [vec![(0, 1.0)], vec![(0, 0.25), (1, 0.75)], vec![(1, 1.0 + 1e-7)]];
        let weights = PartWeights::new(2, &rows).unwrap();
        assert_eq!((weights.parts(), weights.nodes(), weights.starts()), (2, 3, &[0, 1, 3, 4][..]));
        assert_eq!(weights.at(1)[1], PartShare { part: 1, weight: 0.75 });
        assert_eq!(weights.at(2), [PartShare { part: 1, weight: 1.0 }]);
        for (row, expected) in [
            (vec![(2, 1.0)], "node 0 names part 2, but the body has 2 parts"),
            (vec![(0, 0.5)], "with the sum 0.5"),
            (vec![(0, 1.5), (1, -0.5)], "none may be negative"),
            (vec![], "with the sum 0"),
            (vec![(0, f64::NAN)], "with the sum NaN"),
        ] {
            let error = PartWeights::new(2, &[row]).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_motion_in_single_precision_is_the_isometry() {
        let motion =
            Isometry3::new(nalgebra::Vector3::new(1.0, -2.0, 0.5), nalgebra::Vector3::new(0.3, 1.0, -0.7));
        let found = PartMotion::from(&motion).apply([0.2, -0.4, 0.9]);
        let expected = motion * nalgebra::Point3::new(0.2, -0.4, 0.9);
        assert!((0..3).all(|axis| (f64::from(found[axis]) - expected[axis]).abs() < 1e-6), "{found:?}");
    }
}
