//! The family `kept_factor`: (K⁻¹)ₛ as the part of A's factor from which its columns are solved when they are needed.
//!
//! In: the factor of A. Out: the supernodes between the free nodes of the surface and the root of the elimination tree
//! ([`KeptFactor`]), with `kept_factor/order`, the free nodes of the surface with the n that take forces in front. The numbers
//! stay on the disk until a node is touched; they are then read, checked against their hash, and kept in memory.
//!
//! A body that was changed while it is shown has the factor of the file before the change, and the addition to the columns
//! ([`ChangedSystem::added_yield`]).

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, FACTOR_VALUES as VALUES, GreenFile};
use super::super::numbers::{LARGEST, numbers};
use super::super::on_demand::Yield;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution, SurfaceFactor};
use super::super::update::{COLUMNS, ChangedSystem};
use super::affine::AFFINE;
use super::compliance::{Order, check_order, unknowns};
use super::tile_layout::TileLayout;
use crate::base::machine;
use crate::base::table::bytes;
use crate::solve::{KeptFactor, LoadedFactor, NUMBER, Progress, SolveError};
use safetensors::tensor::Dtype;
use std::io::{ErrorKind, Read};
use std::sync::Arc;

pub const KEPT_FACTOR: Family = Family { name: "kept_factor", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: KEPT_FACTOR,
    holds: "how the surface yields to forces at its single nodes: the factor that tells it",
    suits: None,
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 0,
    is_derived: true,
    column_names: None,
};

const ORDER: &str = "kept_factor/order";
const SUPERNODES: &str = "kept_factor/supernodes";
const ROWS: &str = "kept_factor/rows";
const PLACES: &str = "kept_factor/places";
/// Tensors of a changed body, with the terms that are added to its columns.
const FIELDS: &str = "kept_factor/fields";
const BETWEEN: &str = "kept_factor/between";
/// Bytes that are read and hashed at once.
const PIECE: usize = 1 << 20;

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let (Some(asked), Some(factor)) = (&assembled.body.surface_compliance, assembled.factor) else {
        return Ok(());
    };
    let (order, nodes, unknowns) = unknowns(assembled, solution, asked)?;
    let failed = |source| GreenError::Solve { body: assembled.place.to_owned(), source };
    let kept = factor.kept(&unknowns, progress).map_err(failed)?;
    let kept = kept.ok_or_else(|| failed(SolveError::NoFactor(solution.stats.method.name)))?;
    let size = kept.numbers.len() as f64;
    // As a tensor, and in the file's bytes.
    machine::expect("the factor that is kept", 2.0 * size)
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    progress.tell(&format!(
        "the kept factor takes {} in the file; the inverse at the surface would take {}",
        bytes(size),
        bytes(TileLayout { n: nodes, m: order.len() }.bytes() as f64)
    ));
    solution.kept_factor = Some(SurfaceFactor { nodes, order, kept });
    Ok(())
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let Some(SurfaceFactor { nodes, order, kept }) = &body.solution.kept_factor else { return Vec::new() };
    meta.compliance_nodes = Some(*nodes);
    let KeptFactor { supernodes, rows, places, numbers } = kept;
    let list = |list: &[u32]| Tensor::new(&[list.len()], list.iter().copied());
    let sizes = Tensor::new(&[supernodes.len(), 2], supernodes.iter().flatten().copied());
    let values =
        Tensor { dtype: Dtype::U8, shape: vec![numbers.len() / NUMBER, NUMBER], bytes: numbers.clone() };
    [(ORDER, list(order)), (SUPERNODES, sizes), (ROWS, list(rows)), (PLACES, list(places)), (VALUES, values)]
        .map(|(name, tensor)| (name.to_owned(), tensor))
        .into()
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let own = |tensor: &str| format!("{name}/{tensor}");
    let [_, m] = check_order(file, &own(ORDER), body)?;
    let k = file.count(&own(FIELDS));
    if k > 0 {
        file.expect(&own(FIELDS), Dtype::U32, &[k])?;
        file.expect(&own(BETWEEN), Dtype::F64, &[k, k])?;
        return numbers(&own(BETWEEN), file.slice::<f64>(&own(BETWEEN)).iter().copied(), f64::MAX);
    }
    let supernodes = own(SUPERNODES);
    file.expect(&supernodes, Dtype::U32, &[file.count(&supernodes) / 2, 2])?;
    file.expect(&own(ROWS), Dtype::U32, &[file.count(&own(ROWS))])?;
    file.expect(&own(PLACES), Dtype::U32, &[m])?;
    // Its numbers are looked at when they are read.
    let bytes = file.count(&own(VALUES));
    file.expect(&own(VALUES), Dtype::U8, &[bytes / NUMBER, NUMBER])?;
    let [sizes, rows, places] = [SUPERNODES, ROWS, PLACES].map(own);
    LoadedFactor::check(file.slice(&sizes), file.slice(&rows), file.slice(&places), bytes)
        .map_err(|reason| format!("tensors {sizes}, {rows} and {places}: {reason}"))
}

/// The compliance of a body whose factor was kept.
pub struct KeptColumns<'a> {
    file: &'a GreenFile,
    body: &'a str,
    pub(super) order: Order<'a>,
    change: Option<Change<'a>>,
}

/// Terms that are added to the columns of the body in another file: W M Wᵀ.
struct Change<'a> {
    base: &'a GreenFile,
    /// Columns of W in `all`, which has `rows` rows.
    fields: &'a [u32],
    all: &'a [f64],
    rows: usize,
    between: &'a [f64],
}

impl Change<'_> {
    fn column(&self, field: u32) -> &[f64] {
        &self.all[self.rows * field as usize..][..self.rows]
    }

    /// Adds to a column of `node`.
    fn add(&self, node: u32, column: &mut Yield) {
        let k = self.fields.len();
        let at: Vec<&[f64]> =
            self.fields.iter().map(|&field| &self.column(field)[3 * node as usize..][..3]).collect();
        let mut added = vec![[0.0; 3]; self.rows];
        for (row, &field) in self.fields.iter().enumerate() {
            let weights = [0, 1, 2].map(|force| {
                let numbers = at.iter().enumerate();
                numbers.map(|(of, at)| self.between[of * k + row] * at[force]).sum::<f64>()
            });
            for (added, w) in added.iter_mut().zip(self.column(field)) {
                added.iter_mut().zip(weights).for_each(|(added, weight)| *added += w * weight);
            }
        }
        for (moved, added) in
            column.as_flattened_mut().as_flattened_mut().iter_mut().zip(added.as_flattened())
        {
            *moved = (f64::from(*moved) + added) as f32;
        }
    }
}

impl<'a> KeptColumns<'a> {
    /// The compliance of a body with this family.
    pub(super) fn open(file: &'a GreenFile, body: &'a str, meta: &BodyMeta) -> Option<KeptColumns<'a>> {
        let own = |tensor: &str| format!("{body}/{tensor}");
        let order = Order::open(file, &own(ORDER), meta)?;
        let fields: &[u32] = file.slice(&own(FIELDS));
        if fields.is_empty() {
            return Some(KeptColumns { file, body, order, change: None });
        }
        let (base, rows) = (file.base.as_deref()?, 3 * meta.surface_nodes);
        let (all, between): (&[f64], &[f64]) = (base.slice(&own(COLUMNS)), file.slice(&own(BETWEEN)));
        let is_there = |&field: &u32| (field as usize + 1).saturating_mul(rows) <= all.len();
        let change = Change { base, fields, all, rows, between };
        fields.iter().all(is_there).then_some(KeptColumns { file, body, order, change: Some(change) })
    }

    /// The file that has the factor.
    fn source(&self) -> &'a GreenFile {
        self.change.as_ref().map_or(self.file, |change| change.base)
    }

    /// The tensors after a change by which the nodes `freed` of the surface are held no more.
    pub(super) fn changed(
        &self,
        freed: &[u32],
        change: &ChangedSystem<'_>,
    ) -> Result<Vec<(String, Tensor)>, GreenError> {
        let (fields, between) = change.added_yield().ok_or_else(|| GreenError::Damaged {
            path: self.file.path.clone(),
            reason: format!("the compliance of {} does not go with changed moduli", self.body),
        })?;
        let (nodes, _) = self.order.with(freed);
        let order = Tensor::new(&[nodes.len()], nodes);
        let k = fields.len();
        let fields = Tensor::new(&[k], fields);
        let between = Tensor::new(&[k, k], between.iter().copied());
        let tensors = [(ORDER, order), (FIELDS, fields), (BETWEEN, between)];
        Ok(tensors.map(|(name, tensor)| (name.to_owned(), tensor)).into())
    }

    /// The columns of these places; those that are not there are solved together.
    pub(super) fn columns(&self, places: &[usize]) -> Result<Vec<Arc<Yield>>, GreenError> {
        let factor = || self.source().on_demand.body(self.body).factor(|| self.load());
        let of_body = self.file.on_demand.body(self.body);
        of_body.columns(places, |missing| self.solve(&*factor()?, missing))
    }

    fn solve(&self, factor: &LoadedFactor, places: &[usize]) -> Result<Vec<Yield>, GreenError> {
        let failed = |reason: String| GreenError::Damaged { path: self.file.path.clone(), reason };
        // What was held when the factor was made did not yield.
        let solved = self.source().count(&format!("{}/{ORDER}", self.body));
        let loaded: Vec<u32> =
            places.iter().filter(|place| **place < solved).map(|&place| place as u32).collect();
        let u = factor.columns(&loaded).map_err(|error| failed(error.to_string()))?;
        numbers(&format!("columns by tensor {}/{VALUES}", self.body), u.data.iter().copied(), LARGEST)
            .map_err(failed)?;
        let column = |&place: &usize| {
            let c = loaded.iter().position(|loaded| *loaded as usize == place);
            let number = |j: usize, axis: usize, force: usize| match c {
                Some(c) if j < solved => u.row(3 * j + axis)[3 * c + force] as f32,
                _ => 0.0,
            };
            let mut column = self.order.spread(number);
            self.change.iter().for_each(|change| change.add(self.order.nodes[place], &mut column));
            column
        };
        Ok(places.iter().map(column).collect())
    }

    /// Reads the numbers, and checks them.
    pub(super) fn load(&self) -> Result<LoadedFactor, GreenError> {
        let own = |tensor: &str| format!("{}/{tensor}", self.body);
        let [supernodes, rows, places] = [SUPERNODES, ROWS, PLACES].map(own);
        let file = self.source();
        let (rows, places) = (file.slice(&rows).to_vec(), file.slice(&places).to_vec());
        let mut values = HashedBytes::new(file, own(VALUES));
        let loaded = LoadedFactor::read(file.slice(&supernodes), rows, places, &mut values);
        let path = || file.path.clone();
        let loaded = loaded.map_err(|source| GreenError::Io { path: path(), source })?;
        values.verify().map_err(|reason| GreenError::Damaged { path: path(), reason })?;
        Ok(loaded)
    }
}

/// A tensor's bytes, one piece after the other, with their hash.
struct HashedBytes<'a> {
    file: &'a GreenFile,
    tensor: String,
    length: usize,
    /// Bytes that were taken from the file, and those of them that were not yet handed on.
    taken: usize,
    piece: Vec<u8>,
    at: usize,
    hasher: blake3::Hasher,
}

impl HashedBytes<'_> {
    fn new(file: &GreenFile, tensor: String) -> HashedBytes<'_> {
        let length = file.count(&tensor);
        HashedBytes {
            file,
            tensor,
            length,
            taken: 0,
            piece: Vec::new(),
            at: 0,
            hasher: blake3::Hasher::new(),
        }
    }

    /// Whether all was read, and is what was written.
    fn verify(self) -> Result<(), String> {
        let found = self.hasher.finalize().to_hex();
        let is_right = self.taken == self.length
            && self.file.meta.blake3.get(&self.tensor).is_some_and(|hash| hash == found.as_str());
        let damaged = || format!("tensor {} is damaged (the hash differs)", self.tensor);
        is_right.then_some(()).ok_or_else(damaged)
    }
}

impl Read for HashedBytes<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.at == self.piece.len() && self.taken < self.length {
            let end = self.length.min(self.taken + PIECE);
            self.piece = self.file.bytes_of(&self.tensor, self.taken..end)?.into_owned();
            if self.piece.len() != end - self.taken {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            self.hasher.update(&self.piece);
            (self.taken, self.at) = (end, 0);
        }
        let count = into.len().min(self.piece.len() - self.at);
        into[..count].copy_from_slice(&self.piece[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}
