//! How the surface of a body yields to forces at its single nodes, in the way in which its file has that.
//!
//! In: a .green file with one of the families `compliance` and `compressed`. Out: columns of (K⁻¹)ₛ.

use super::super::error::GreenError;
use super::super::file::GreenFile;
use super::super::solution::Yield;
use super::super::tensor::Tensor;
use super::super::update::Changed;
use super::compliance::{COMPLIANCE, Order, Tiles};
use super::compressed::{COMPRESSED, CompressedColumns};
use std::collections::BTreeMap;

/// The compliance of a body, read where it lies.
pub enum Compliance<'a> {
    Tiles(Tiles<'a>),
    Compressed(CompressedColumns<'a>),
}

impl Compliance<'_> {
    fn order(&self) -> Order<'_> {
        match self {
            Compliance::Tiles(tiles) => tiles.order,
            Compliance::Compressed(compressed) => compressed.order,
        }
    }

    /// Where each node of the surface stands that takes forces.
    pub fn places(&self) -> BTreeMap<u32, usize> {
        self.order().places()
    }

    /// What a force at the node at `place` does to the whole surface; nodes of control elements stay. Errors where what is read
    /// from the file is not what was written.
    pub fn column(&self, place: usize) -> Result<Yield, GreenError> {
        match self {
            Compliance::Tiles(tiles) => tiles.column(place),
            Compliance::Compressed(compressed) => compressed.column(place),
        }
    }

    /// Reads all of it; errors at the first that is not what was written.
    pub fn verify(&self) -> Result<(), GreenError> {
        match self {
            Compliance::Tiles(tiles) => tiles.verify(),
            Compliance::Compressed(compressed) => compressed.verify(),
        }
    }

    /// The tensors after a change by which the nodes `freed` of the surface are held no more.
    pub fn changed(&self, freed: &[u32], change: &Changed<'_>) -> Result<Vec<(String, Tensor)>, GreenError> {
        match self {
            Compliance::Tiles(tiles) => tiles.changed(freed, change),
            Compliance::Compressed(compressed) => compressed.changed(freed, change),
        }
    }
}

impl GreenFile {
    /// How the surface of a body yields, where the scene asked for it.
    pub fn compliance(&self, body: &str) -> Option<Compliance<'_>> {
        let meta = self.meta.bodies.get(body)?;
        if meta.requirements.has(COMPRESSED) {
            return CompressedColumns::of(self, body, meta).map(Compliance::Compressed);
        }
        let meta = Some(meta).filter(|meta| meta.requirements.has(COMPLIANCE))?;
        Tiles::of(self, body, meta).map(Compliance::Tiles)
    }

    /// Reads what stays on the disk, which opening the file does not look at; errors where it is damaged.
    pub fn verify(&self) -> Result<(), GreenError> {
        self.meta.bodies.keys().filter_map(|body| self.compliance(body)).try_for_each(|of| of.verify())
    }
}
