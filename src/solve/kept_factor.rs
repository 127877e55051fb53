//! The part of a factor that solves between chosen nodes, as it is kept in a file and as it is used again.
//!
//! In: L and nodes. Out: the supernodes on the ways from these nodes to the root of the elimination tree, with their numbers:
//! no other is passed by a solve with a right-hand side at such nodes of which only their rows are wanted. Of a supernode's
//! columns the file has the diagonal and what stands below it, column after column.

use super::dense::Real;
use super::error::SolveError;
use super::substitution::Triangle;
use super::supernodes::Supernodes;
use crate::base::machine;
use crate::base::progress::Silent;
use crate::fem::NodeFields;
use std::io::Read;

/// The part of a factor, as it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptFactor {
    /// How many nodes each supernode has, and how many rows below them, children before parents.
    pub supernodes: Vec<[u32; 2]>,
    /// Those rows, as positions of nodes in the order of elimination.
    pub rows: Vec<u32>,
    /// The position of each chosen node.
    pub places: Vec<u32>,
    /// f64, little-endian.
    pub numbers: Vec<u8>,
}

/// The part of a factor, ready for solves between its chosen nodes.
#[derive(Debug)]
pub struct LoadedFactor {
    supernodes: Supernodes,
    values: Vec<f64>,
}

/// Bytes of the numbers of supernodes of so many nodes and rows below them.
pub fn kept_bytes(supernodes: &[[u32; 2]]) -> u128 {
    let numbers = |&[n, m]: &[u32; 2]| {
        let (n, m) = (3 * u128::from(n), 3 * u128::from(m));
        n * (n + 1) / 2 + n * m
    };
    size_of::<f64>() as u128 * supernodes.iter().map(numbers).sum::<u128>()
}

impl KeptFactor {
    /// What of L solves between these nodes.
    pub(super) fn of<T: Real>(l: &Triangle<'_, T>, nodes: &[u32]) -> Result<KeptFactor, SolveError> {
        let (taken, supernodes, rows, places) = l.supernodes.part(nodes);
        let size = kept_bytes(&supernodes) as usize;
        let mut numbers = Vec::new();
        numbers.try_reserve_exact(size).map_err(|_full| {
            SolveError::Memory(machine::refused("the factor as it is kept", size as f64))
        })?;
        for s in taken {
            let height = 3 * (l.supernodes.own(s).len() + l.supernodes.below(s).len());
            let columns = l.values[l.supernodes.values(s)].chunks_exact(height).enumerate();
            let below = columns.flat_map(|(j, column)| &column[j..]);
            below.for_each(|value| numbers.extend(value.to_f64().to_le_bytes()));
        }
        Ok(KeptFactor { supernodes, rows, places, numbers })
    }
}

impl LoadedFactor {
    /// From what was kept; `numbers` gives the bytes of the numbers. The error says what cannot be, or could not be read.
    pub fn read(
        supernodes: &[[u32; 2]],
        rows: Vec<u32>,
        places: Vec<u32>,
        numbers: &mut dyn Read,
    ) -> Result<LoadedFactor, std::io::Error> {
        let supernodes = Supernodes::new(places, supernodes, rows).map_err(std::io::Error::other)?;
        let need = (size_of::<f64>() * supernodes.entries()) as f64;
        let what = format!("a kept factor of {} numbers", supernodes.entries());
        machine::fits(what, need, 0.0).map_err(std::io::Error::other)?;
        let mut values = Vec::new();
        values.try_reserve_exact(supernodes.entries()).map_err(std::io::Error::other)?;
        values.resize(supernodes.entries(), 0.0);
        let mut column_bytes = Vec::new();
        for s in 0..supernodes.count() {
            let height = 3 * (supernodes.own(s).len() + supernodes.below(s).len());
            for (j, column) in values[supernodes.values(s)].chunks_exact_mut(height).enumerate() {
                column_bytes.resize(8 * (height - j), 0);
                numbers.read_exact(&mut column_bytes)?;
                for (value, bytes) in column[j..].iter_mut().zip(column_bytes.as_chunks().0) {
                    *value = f64::from_le_bytes(*bytes);
                }
            }
        }
        Ok(LoadedFactor { supernodes, values })
    }

    /// How many numbers a factor of this pattern keeps; the error says why it is none.
    pub fn numbers(supernodes: &[[u32; 2]], rows: &[u32], places: &[u32]) -> Result<usize, String> {
        Supernodes::new(places.to_vec(), supernodes, rows.to_vec())?;
        Ok((kept_bytes(supernodes) / size_of::<f64>() as u128) as usize)
    }

    /// The rows at all chosen nodes of A⁻¹ at some of them: three columns for each of `loaded`, which are places among the
    /// chosen nodes.
    pub fn columns(&self, loaded: &[u32]) -> Result<NodeFields, SolveError> {
        let triangle = Triangle { supernodes: &self.supernodes, values: &self.values };
        let all: Vec<u32> = (0..self.supernodes.inverse.len() as u32).collect();
        triangle.between(loaded, &NodeFields::unit(loaded.len()), &all, &Silent)
    }
}
