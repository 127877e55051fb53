//! Equilibria of a body in the user's cache folder, so that a body that is made again with one more effect, load or storage takes them
//! from there.
//!
//! In: a body, a law, and the equilibria found on a path. Out: the same in a later run of this program, from `equilibria-KEY.part`, a [`Journal`]
//! with a record for each path; KEY is the hash of all that they depend on. The files that were not used for longest are removed
//! when all take more than [`MOST_BYTES`].

use super::super::family::Assembled;
use super::super::journal::{Journal, Key};
use super::super::kept::Caching;
use super::super::solution::Solution;
use crate::base::cache;
use crate::fem::{Law, NodeFields};
use nalgebra::Vector3;

/// All files together, bytes.
const MOST_BYTES: u64 = 1 << 30;
const PREFIX: &str = "equilibria-";

/// An equilibrium on a path.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Share of the path.
    pub share: f64,
    /// Displacements of all nodes, one column, m.
    pub u: NodeFields,
    /// Strain energy, J.
    pub energy: f64,
    /// Whether a tetrahedron is turned inside out in it, as in no real body.
    pub is_inverted: bool,
    /// Force, N, and moment about its place, N·m, of each control element.
    pub wrenches: [[Vector3<f64>; 2]; 2],
}

/// Numbers of a [`Found`] beside its displacements.
const NUMBERS: usize = 3 + 12;

impl Found {
    fn numbers(&self) -> Vec<f64> {
        let head = [self.share, self.energy, f64::from(u8::from(self.is_inverted))];
        let wrenches = self.wrenches.iter().flatten().flat_map(|part| part.iter().copied());
        head.into_iter().chain(wrenches).chain(self.u.data.iter().copied()).collect()
    }

    fn read(numbers: &[f64]) -> Option<Found> {
        let (&[share, energy, is_inverted], rest) = numbers.split_first_chunk()?;
        let (wrenches, u) = rest.split_first_chunk::<12>()?;
        let part = |of: usize| Vector3::from_column_slice(&wrenches[3 * of..3 * of + 3]);
        Some(Found {
            share,
            u: NodeFields { nodes: u.len() / 3, columns: 1, data: u.to_vec() },
            energy,
            is_inverted: is_inverted != 0.0,
            wrenches: [[part(0), part(1)], [part(2), part(3)]],
        })
    }
}

/// The hash of a body and a law, of the settings with which its equilibria are found, and of this program; `None` where that is not
/// known.
pub fn key(law: &Law, assembled: &Assembled<'_>, solution: &Solution) -> Option<Key> {
    let mesh = &solution.mesh;
    let mut hasher = blake3::Hasher::new();
    let settings = (law.name, solution.element.name, assembled.body.solver.to_string(), cache::program()?);
    hasher.update(format!("{settings:?} {} {}", mesh.nodes.len(), mesh.tets.len()).as_bytes());
    mesh.nodes.iter().for_each(|node| {
        hasher.update(bytemuck::cast_slice(node.as_slice()));
    });
    hasher.update(bytemuck::cast_slice(&mesh.tets)).update(bytemuck::cast_slice(&mesh.mids));
    assembled.lame.iter().for_each(|lame| {
        hasher.update(bytemuck::cast_slice(&[lame.lambda, lame.mu]));
    });
    for control in &solution.controls {
        hasher
            .update(&(control.nodes.len() as u64).to_le_bytes())
            .update(bytemuck::cast_slice(&control.nodes));
        hasher.update(bytemuck::cast_slice(control.origin.as_slice()));
    }
    Some(hasher.finalize().into())
}

/// The equilibria on the paths of a body of so many nodes; without a journal, none is known and none is kept.
pub struct Known<'a> {
    journal: Option<(Journal<'a>, String)>,
    nodes: usize,
    /// Paths that were walked before results are kept.
    early: Vec<(usize, Vec<Found>)>,
}

impl<'a> Known<'a> {
    /// Opens the journal of this key, which `identity` returns; without a key or caching there is none.
    pub fn open(
        asked: Option<Caching>,
        key: Option<Key>,
        identity: &'a dyn Fn() -> Option<Key>,
        nodes: usize,
    ) -> Known<'a> {
        let journal = asked.zip(key).map(|(Caching { kept_after, is_anew }, key)| {
            let name = format!("{PREFIX}{}.part", blake3::Hash::from_bytes(key).to_hex());
            let path = cache::folder().join(&name);
            if is_anew {
                // It may not be there.
                let _ = std::fs::remove_file(&path);
            }
            (Journal::at(path, kept_after, identity), name)
        });
        Known { journal, nodes, early: Vec::new() }
    }

    /// Number of paths below `all` that were walked.
    pub fn count(&self, all: usize) -> usize {
        self.journal
            .iter()
            .map(|(journal, _)| (0..all).filter(|path| journal.has(&key_of(*path))).count())
            .sum()
    }

    /// Equilibria that were found on the path of this number; `None` where it was not walked yet.
    pub fn on(&self, path: usize) -> Option<Vec<Found>> {
        let bytes = self.journal.as_ref()?.0.find(&key_of(path))?;
        let numbers: Vec<f64> = bytes
            .chunks_exact(8)
            .filter_map(|bytes| bytes.first_chunk())
            .map(|b| f64::from_le_bytes(*b))
            .collect();
        let found = numbers.chunks(NUMBERS + 3 * self.nodes);
        found.map(|one| Found::read(one).filter(|one| one.u.nodes == self.nodes)).collect()
    }

    /// Keeps the equilibria on a path.
    pub fn keep(&mut self, path: usize, found: &[Found]) {
        let Some((journal, _)) = &self.journal else { return };
        self.early.push((path, found.to_vec()));
        if !journal.is_kept() {
            return;
        }
        for (path, found) in self.early.drain(..) {
            let numbers: Vec<Vec<f64>> = found.iter().map(Found::numbers).collect();
            let parts: Vec<&[u8]> = numbers.iter().map(|one| bytemuck::cast_slice(one)).collect();
            journal.keep(&key_of(path), &parts);
        }
    }

    /// Removes those of other bodies until all take no more than [`MOST_BYTES`].
    pub fn finish(self) {
        if let Some((_, name)) = &self.journal {
            cache::trim(PREFIX, name, MOST_BYTES);
        }
    }
}

/// The key of a path's record.
fn key_of(path: usize) -> Key {
    blake3::hash(&(path as u64).to_le_bytes()).into()
}
