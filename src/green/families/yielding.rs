//! Compliance of the surface of a body under forces at its single nodes, in the way in which its file has it.
//!
//! In: a .green file with one of the families `compliance`, `compressed` and `kept_factor`, or a file in memory whose maker solves for them.
//! Out: columns of (K⁻¹)ₛ.

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::file::GreenFile;
use super::super::on_demand::{SolvedCompliance, Yield};
use super::super::update::ChangedSystem;
use super::compliance::{COMPLIANCE, Order, Tiles};
use super::compressed::{COMPRESSED, CompressedColumns};
use super::kept_factor::{KEPT_FACTOR, KeptColumns};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// The compliance of a body, read where it lies.
pub enum Compliance<'a> {
    Solved(SolvedColumns<'a>),
    Tiles(Tiles<'a>),
    Factor(KeptColumns<'a>),
    Compressed(CompressedColumns<'a>),
}

/// The compliance of a body whose columns are solved for.
pub struct SolvedColumns<'a> {
    file: &'a GreenFile,
    body: &'a str,
    of: &'a dyn SolvedCompliance,
    order: Order<'a>,
}

impl SolvedColumns<'_> {
    fn columns(&self, places: &[usize]) -> Result<Vec<Arc<Yield>>, GreenError> {
        self.file.on_demand.body(self.body).columns(places, |missing| {
            let nodes: Vec<u32> = missing.iter().map(|place| self.order.nodes[*place]).collect();
            self.of.columns(&nodes).map_err(|reason| self.failed(&reason))
        })
    }

    fn failed(&self, reason: &str) -> GreenError {
        let reason = format!("the compliance of {}: {reason}", self.body);
        GreenError::Damaged { path: self.file.path.clone(), reason }
    }
}

impl Compliance<'_> {
    fn order(&self) -> Order<'_> {
        match self {
            Compliance::Solved(solved) => solved.order,
            Compliance::Tiles(tiles) => tiles.order,
            Compliance::Factor(kept) => kept.order,
            Compliance::Compressed(compressed) => compressed.order,
        }
    }

    /// Place of each node of the surface that takes forces.
    pub fn places(&self) -> BTreeMap<u32, usize> {
        self.order().places()
    }

    /// Displacements of the whole surface by a force at the node at `place`; nodes of control elements stay. Errors where the
    /// bytes that are read from the file are not those that were written.
    pub fn column(&self, place: usize) -> Result<Yield, GreenError> {
        match self {
            Compliance::Tiles(tiles) => tiles.column(place),
            Compliance::Factor(kept) => {
                Ok(kept.columns(&[place])?.iter().flat_map(|column| column.iter().copied()).collect())
            }
            Compliance::Compressed(compressed) => compressed.column(place),
            Compliance::Solved(solved) => {
                Ok(solved.columns(&[place])?.iter().flat_map(|column| column.iter().copied()).collect())
            }
        }
    }

    /// Number of nodes that take forces after a change by which the nodes `freed` of the surface are held no more.
    pub fn taking(&self, freed: &[u32]) -> usize {
        self.order().with(freed).1
    }

    /// Reads all of it; errors at the first that is not what was written.
    pub fn verify(&self) -> Result<(), GreenError> {
        match self {
            Compliance::Solved(_) => Ok(()),
            Compliance::Tiles(tiles) => tiles.verify(),
            Compliance::Factor(kept) => kept.load().map(drop),
            Compliance::Compressed(compressed) => compressed.verify(),
        }
    }

    /// The tensors after a change by which the nodes `freed` of the surface are held no more.
    pub fn changed(
        &self,
        freed: &[u32],
        change: &ChangedSystem<'_>,
    ) -> Result<Vec<(String, Tensor)>, GreenError> {
        match self {
            Compliance::Solved(solved) => Err(solved.failed("it is that of a cut body")),
            Compliance::Tiles(tiles) => tiles.changed(freed, change),
            Compliance::Factor(kept) => kept.changed(freed, change),
            Compliance::Compressed(compressed) => compressed.changed(freed, change),
        }
    }
}

impl GreenFile {
    /// The compliance of a body's surface, where the scene asked for it.
    pub fn compliance(&self, body: &str) -> Option<Compliance<'_>> {
        let (body, meta) = self.meta.bodies.get_key_value(body)?;
        if let Some(of) = self.solved.as_deref() {
            let nodes = of.nodes();
            let order = Order { nodes, n: nodes.len(), surface_nodes: meta.surface_nodes };
            return Some(Compliance::Solved(SolvedColumns { file: self, body, of, order }));
        }
        if meta.requirements.has(KEPT_FACTOR) {
            return KeptColumns::open(self, body, meta).map(Compliance::Factor);
        }
        if meta.requirements.has(COMPRESSED) {
            return CompressedColumns::open(self, body, meta).map(Compliance::Compressed);
        }
        let meta = Some(meta).filter(|meta| meta.requirements.has(COMPLIANCE))?;
        Tiles::open(self, body, meta).map(Compliance::Tiles)
    }

    /// The columns at these places of a body, as [`Compliance::column`] has them one by one. Those that are solved for may take
    /// longer than `patience`: there are none then, and they are there when they are asked for later.
    pub fn columns(
        self: &Arc<Self>,
        body: &str,
        places: &[usize],
        patience: Duration,
    ) -> Result<Option<Vec<Arc<Yield>>>, GreenError> {
        match self.compliance(body) {
            None => Ok(None),
            Some(Compliance::Factor(_) | Compliance::Solved(_)) if patience < Duration::MAX => {
                self.on_demand.body(body).columns_within(places, patience, self.solving(body))
            }
            Some(Compliance::Factor(kept)) => kept.columns(places).map(Some),
            Some(Compliance::Solved(solved)) => solved.columns(places).map(Some),
            Some(compliance) => {
                let column = |&place: &usize| compliance.column(place).map(Arc::new);
                places.iter().map(column).collect::<Result<_, _>>().map(Some)
            }
        }
    }

    /// Has the columns at these places solved for in the background, the first ones first, where they have to be. Those that were to come
    /// before and are not among these are left out.
    pub fn prepare_columns(self: &Arc<Self>, body: &str, places: &[usize]) -> Result<(), GreenError> {
        match self.compliance(body) {
            Some(Compliance::Factor(_) | Compliance::Solved(_)) => {
                self.on_demand.body(body).prepare(places, self.solving(body))
            }
            _ => Ok(()),
        }
    }

    /// Drops the columns that were solved for.
    pub fn forget_columns(&self, body: &str) {
        self.on_demand.body(body).forget();
    }

    /// Solves for columns of a body, and leaves them where they are kept.
    fn solving(self: &Arc<Self>, body: &str) -> impl Fn(&[usize]) -> Result<(), GreenError> + Send + use<> {
        let (file, body) = (self.clone(), body.to_owned());
        move |places| match file.compliance(&body) {
            Some(Compliance::Factor(kept)) => kept.columns(places).map(drop),
            Some(Compliance::Solved(solved)) => solved.columns(places).map(drop),
            _ => Ok(()),
        }
    }

    /// Reads what stays on the disk, which opening the file does not look at; errors where it is damaged.
    pub fn verify(&self) -> Result<(), GreenError> {
        self.meta.bodies.keys().filter_map(|body| self.compliance(body)).try_for_each(|of| of.verify())
    }
}
