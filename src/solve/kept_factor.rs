//! The part of a factor that solves between chosen nodes, as it is kept in a file and as it is used again.
//!
//! In: L and nodes. Out: the supernodes on the ways from these nodes to the root of the elimination tree, with their numbers:
//! no other is passed by a solve with a right-hand side at such nodes of which only their rows are wanted. Of a supernode's
//! columns the file has the diagonal and what stands below it, column after column, each number in five bytes: the upper ones
//! of an f64, 29 bits of it. On tubes, boxes, and on a plate and a rod with condition numbers of 1e8 and 1e9, that changes a
//! column by at most 1.2e-7 of its largest number, less than single precision does to the columns; numbers in f32 by up to 3e-6.

use super::dense::Real;
use super::error::SolveError;
use super::substitution::Triangle;
use super::supernodes::Supernodes;
use crate::base::machine;
use crate::base::progress::Silent;
use crate::fem::NodeFields;
use std::io::Read;

/// Bytes of a number.
pub const NUMBER: usize = 5;

/// The part of a factor, as it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptFactor {
    /// Number of nodes of each supernode, and of rows below them, children before parents.
    pub supernodes: Vec<[u32; 2]>,
    /// The rows below, as positions of nodes in the order of elimination.
    pub rows: Vec<u32>,
    /// The position of each chosen node.
    pub places: Vec<u32>,
    /// [`NUMBER`] bytes each.
    pub numbers: Vec<u8>,
}

/// The part of a factor, ready for solves between its chosen nodes.
#[derive(Debug)]
pub struct LoadedFactor {
    supernodes: Supernodes,
    values: Vec<f64>,
}

/// Bytes of the numbers of these supernodes, each with its number of nodes and of rows below them.
pub fn kept_bytes(supernodes: &[[u32; 2]]) -> u128 {
    let numbers = |&[n, m]: &[u32; 2]| {
        let (n, m) = (3 * u128::from(n), 3 * u128::from(m));
        n * (n + 1) / 2 + n * m
    };
    NUMBER as u128 * supernodes.iter().map(numbers).sum::<u128>()
}

/// The upper bytes of a number, rounded.
fn rounded(number: f64) -> [u8; NUMBER] {
    // Of a number next to the largest the exponent would run over: no factor has any.
    let [.., a, b, c, d, e] = number.to_bits().wrapping_add(1 << 23).to_le_bytes();
    [a, b, c, d, e]
}

impl KeptFactor {
    /// The part of L that solves between these nodes.
    pub(super) fn from_triangle<T: Real>(
        l: &Triangle<'_, T>,
        nodes: &[u32],
    ) -> Result<KeptFactor, SolveError> {
        let (taken, supernodes, rows, places) = l.supernodes.part(nodes);
        let size = kept_bytes(&supernodes) as usize;
        let mut numbers = Vec::new();
        numbers
            .try_reserve_exact(size)
            .map_err(|_full| SolveError::Memory(machine::refused("the factor as it is kept", size as f64)))?;
        for s in taken {
            let height = 3 * (l.supernodes.own(s).len() + l.supernodes.below(s).len());
            let columns = l.values[l.supernodes.values(s)].chunks_exact(height).enumerate();
            let below = columns.flat_map(|(j, column)| &column[j..]);
            below.for_each(|value| numbers.extend(rounded(value.to_f64())));
        }
        Ok(KeptFactor { supernodes, rows, places, numbers })
    }
}

impl LoadedFactor {
    /// Reads a factor that was kept and [checked](LoadedFactor::check); `numbers` gives the bytes of the numbers. The error names
    /// what could not be read or held.
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
                column_bytes.resize(NUMBER * (height - j), 0);
                numbers.read_exact(&mut column_bytes)?;
                for (value, &[a, b, c, d, e]) in column[j..].iter_mut().zip(column_bytes.as_chunks().0) {
                    *value = f64::from_le_bytes([0, 0, 0, a, b, c, d, e]);
                }
            }
        }
        Ok(LoadedFactor { supernodes, values })
    }

    /// Checks that this is the pattern of a factor whose numbers take `bytes` bytes; the error says why not.
    pub fn check(supernodes: &[[u32; 2]], rows: &[u32], places: &[u32], bytes: usize) -> Result<(), String> {
        // First, for it bounds the memory of what follows.
        let expected = kept_bytes(supernodes);
        if expected != bytes as u128 {
            return Err(format!("its supernodes have numbers of {expected} bytes, and there are {bytes}"));
        }
        Supernodes::new(places.to_vec(), supernodes, rows.to_vec()).map(drop)
    }

    /// The rows at all chosen nodes of A⁻¹ at some of them: three columns for each of `loaded`, which are places among the
    /// chosen nodes.
    pub fn columns(&self, loaded: &[u32]) -> Result<NodeFields, SolveError> {
        let triangle = Triangle { supernodes: &self.supernodes, values: &self.values, branches: &[] };
        let all: Vec<u32> = (0..self.supernodes.inverse.len() as u32).collect();
        triangle.between(loaded, &NodeFields::unit(loaded.len()), &all, &Silent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, Partition, StiffnessMatrix, TET4};
    use crate::mesh::{Block, block};
    use crate::solve::Solver;
    use proptest::prelude::*;
    use std::sync::LazyLock;

    /// A cube held at one side.
    fn cube() -> StiffnessMatrix {
        let mesh = block(&Block { size: [1.0; 3], cells: [5; 3] }).unwrap();
        let held = (0..mesh.nodes.len() as u32).filter(|&i| mesh.nodes[i as usize].x < -0.5 + 1e-9);
        let partition = Partition::new(mesh.nodes.len(), held);
        let lame = vec![Lame::from_young_poisson(1.0, 0.3); mesh.tets.len()];
        partition.a(&TET4.assemble(&mesh, &lame).unwrap())
    }

    fn nodes() -> Vec<u32> {
        (0..150).filter(|node| node % 7 == 3).rev().collect()
    }

    static KEPT: LazyLock<KeptFactor> = LazyLock::new(|| {
        let a = cube();
        let solver = Solver::default().analyse(&a, &Silent).unwrap();
        assert!(solver.keeps(&a, 1));
        solver.factor(&a, &Silent).unwrap().kept(&nodes(), &Silent).unwrap().unwrap()
    });

    fn load(kept: &KeptFactor) -> Result<LoadedFactor, std::io::Error> {
        let (rows, places) = (kept.rows.clone(), kept.places.clone());
        LoadedFactor::check(&kept.supernodes, &rows, &places, KEPT.numbers.len())
            .map_err(std::io::Error::other)?;
        LoadedFactor::read(&kept.supernodes, rows, places, &mut kept.numbers.as_slice())
    }

    #[test]
    fn the_kept_part_solves_between_its_nodes_as_the_whole_factor() {
        let a = cube();
        let solver = Solver::default().analyse(&a, &Silent).unwrap();
        let factor = solver.factor(&a, &Silent).unwrap();
        let (nodes, loaded) = (nodes(), [5, 0, 17]);
        let own = loaded.map(|place| nodes[place as usize]);
        let exact = factor.solve_at(&own, &NodeFields::unit(3), &nodes).unwrap();
        let found = load(&KEPT).unwrap().columns(&loaded).unwrap();
        let largest = exact.data.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let off = exact.data.iter().zip(&found.data).fold(0.0, |m: f64, (x, y)| m.max((x - y).abs()));
        assert!(off < 2e-8 * largest, "{off:e} of {largest:e}");
        assert_eq!(KEPT.numbers.len() as u128, kept_bytes(&KEPT.supernodes));
        // Less than all of it, and of a smaller choice still less.
        let all: Vec<u32> = (0..a.nodes() as u32).collect();
        let sizes = [&nodes[..1], &nodes, &all]
            .map(|nodes| factor.kept(nodes, &Silent).unwrap().unwrap().numbers.len());
        assert!(sizes[0] < sizes[1] && sizes[1] <= sizes[2], "{sizes:?}");
    }

    /// A column has the same bits whatever is solved with it.
    #[test]
    fn a_column_does_not_depend_on_the_others() {
        let loaded = load(&KEPT).unwrap();
        let places = [5, 0, 17, 3, 9, 12, 1, 20];
        for count in 1..=places.len() {
            let together = loaded.columns(&places[..count]).unwrap();
            for (k, place) in places[..count].iter().enumerate() {
                let alone = loaded.columns(&[*place]).unwrap();
                let same = |row: usize| alone.row(row) == &together.row(row)[3 * k..3 * k + 3];
                assert!((0..3 * alone.nodes).all(same), "place {place} among {count}");
            }
        }
    }

    #[test]
    fn numbers_are_rounded_to_29_bits() {
        for number in [1.0, -1.0 / 3.0, 1e-300, -0.0, 0.1 + 1e-9, 1.999_999_999_9, 123_456_789.25] {
            let [a, b, c, d, e] = rounded(number);
            let back = f64::from_le_bytes([0, 0, 0, a, b, c, d, e]);
            assert!((back - number).abs() <= number.abs() * 2f64.powi(-29), "{number} {back}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        /// Whatever a file says: an error, or a factor that solves to some numbers.
        #[test]
        fn what_is_damaged_is_an_error_or_solves_to_nonsense(
            list in 0..4usize,
            at in any::<prop::sample::Index>(),
            value in prop_oneof![0..200u32, Just(u32::MAX), any::<u32>()],
            cut in any::<bool>(),
        ) {
            let mut kept = KEPT.clone();
            match list {
                0 => { let i = at.index(kept.supernodes.len()); kept.supernodes[i][usize::from(value % 2 == 0)] = value; }
                1 => { let i = at.index(kept.rows.len()); kept.rows[i] = value; }
                2 => { let i = at.index(kept.places.len()); kept.places[i] = value; }
                _ => { let i = at.index(kept.numbers.len()); kept.numbers[i] = value as u8; }
            }
            if cut {
                kept.numbers.truncate(at.index(kept.numbers.len()));
            }
            match load(&kept) {
                Ok(loaded) => {
                    prop_assert!(!cut);
                    prop_assert_eq!(loaded.columns(&[1, 2]).unwrap().data.len(), 3 * 6 * kept.places.len());
                }
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }
}
