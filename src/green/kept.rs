//! A factor whose finished solves are kept in a [`Journal`] and taken from there when the same is solved again.
//!
//! In: A, what makes its factor, and right-hand sides. Out: the solutions. A factor is made when the first solve needs one. A
//! key holds the body's fingerprint, A and the right-hand side, so that nothing is ever taken that belongs to something else.

use super::journal::{Journal, Key};
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use crate::solve::{Factor, InverseStrip, KeptFactor, Method, SolveError, SolveResult, SolveStats};
use serde::de::DeserializeOwned;
use std::cell::{Cell, OnceCell};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Results that a run keeps for those after it.
#[derive(Clone, Copy, Default)]
pub struct Keeping<'a> {
    /// Finished columns, until the .green file is there.
    pub journal: Option<&'a Journal<'a>>,
    /// Equilibria in the user's cache folder; without it, none is kept there or taken from there.
    pub caching: Option<Caching>,
}

/// Use of the cache folder by a run.
#[derive(Clone, Copy)]
pub struct Caching {
    /// A run that takes no longer keeps nothing.
    pub kept_after: Duration,
    /// Whether what is there is found anew, and replaced.
    pub is_anew: bool,
}

/// The journal that keeps the solves of a body.
#[derive(Clone, Copy)]
pub struct Keep<'a> {
    pub journal: &'a Journal<'a>,
    pub fingerprint: &'a str,
}

/// Makes the factor, by a method other than the scene's where earlier columns were solved with that.
pub type Make<'a> =
    Box<dyn Fn(Option<&'static Method>, &dyn Progress) -> Result<Box<dyn Factor + 'a>, SolveError> + 'a>;

pub struct KeptSolves<'a> {
    keep: Keep<'a>,
    a: &'a StiffnessMatrix,
    make: Make<'a>,
    factor: OnceCell<Box<dyn Factor + 'a>>,
    /// Method by which the columns that were there had been solved.
    method: Cell<Option<&'static Method>>,
    /// Key of body and A.
    of_body: OnceCell<Key>,
}

/// Kinds of solves.
#[derive(Clone, Copy)]
enum SolveKind<'a> {
    Fields,
    JudgedFields,
    Rows { loaded: &'a [u32], asked: &'a [u32] },
    Strips(&'a [u32]),
}

impl<'a> KeptSolves<'a> {
    pub fn new(keep: Keep<'a>, a: &'a StiffnessMatrix, make: Make<'a>) -> KeptSolves<'a> {
        KeptSolves {
            keep,
            a,
            make,
            factor: OnceCell::new(),
            method: Cell::new(None),
            of_body: OnceCell::new(),
        }
    }

    fn factor(&self, progress: &dyn Progress) -> Result<&dyn Factor, SolveError> {
        if let Some(factor) = self.factor.get() {
            return Ok(factor.as_ref());
        }
        let made = (self.make)(self.method.get(), progress)?;
        Ok(self.factor.get_or_init(|| made).as_ref())
    }

    /// The key of what is solved, but for where in it.
    fn key(&self, asked: SolveKind<'_>, b: &[f64]) -> blake3::Hasher {
        let of_body = self.of_body.get_or_init(|| {
            let mut hasher = blake3::Hasher::new();
            hasher.update(self.keep.fingerprint.as_bytes());
            hasher.update(bytemuck::cast_slice(&self.a.edges));
            for blocks in [&self.a.diagonal, &self.a.blocks] {
                blocks.iter().for_each(|block| {
                    hasher.update(bytemuck::cast_slice(block.as_slice()));
                });
            }
            hasher.finalize().into()
        });
        let (number, lists): (u8, [&[u32]; 2]) = match asked {
            SolveKind::Fields => (0, [&[], &[]]),
            SolveKind::JudgedFields => (1, [&[], &[]]),
            SolveKind::Rows { loaded, asked } => (2, [loaded, asked]),
            SolveKind::Strips(nodes) => (3, [nodes, &[]]),
        };
        let mut hasher = blake3::Hasher::new();
        hasher.update(of_body).update(&[number]);
        for list in lists {
            hasher.update(&(list.len() as u64).to_le_bytes()).update(bytemuck::cast_slice(list));
        }
        hasher.update(bytemuck::cast_slice(b));
        hasher
    }

    /// Finds the part `number` of a solve in the journal: the description kept with it, and its numbers.
    fn find<T: DeserializeOwned>(&self, of: &blake3::Hasher, number: usize) -> Option<(T, Vec<f64>)> {
        let content = self.keep.journal.find(&part(of, number))?;
        let (size, rest) = content.split_first_chunk::<8>()?;
        let (said, numbers) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*size)).ok()?)?;
        let numbers =
            numbers.chunks_exact(8).filter_map(|bytes| bytes.first_chunk()).map(|b| f64::from_le_bytes(*b));
        Some((serde_json::from_slice(said).ok()?, numbers.collect()))
    }

    fn keep<T: serde::Serialize>(&self, of: &blake3::Hasher, number: usize, said: &T, numbers: &[f64]) {
        // It holds numbers and names alone.
        let Ok(said) = serde_json::to_vec(said) else { return };
        let size = (said.len() as u64).to_le_bytes();
        self.keep.journal.keep(&part(of, number), &[&size, &said, bytemuck::cast_slice(numbers)]);
    }

    /// All columns, as many together as the factor solves together.
    fn solve_parts(&self, asked: SolveKind<'_>, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let mut of = self.keep.journal.has_records().then(|| self.key(asked, &b.data));
        let mut x = NodeFields::zeros(0, 0);
        let mut stats = SolveStats::default();
        let joined = JoinedProgress { progress, parts: AtomicU64::new(1), has_begun: AtomicBool::new(false) };
        let (mut first, mut known) = (0, 0);
        while first < b.columns.max(1) {
            let found = of.as_ref().and_then(|of| self.find::<SolveStats>(of, first));
            let is_fit = |(stats, data): &(SolveStats, Vec<f64>)| data.len() == 3 * b.nodes * stats.columns;
            let (of_part, own) = match found.filter(is_fit) {
                Some((of_part, data)) => {
                    self.method.set(Some(of_part.method));
                    let own = NodeFields { nodes: b.nodes, columns: of_part.columns, data };
                    known = first + own.columns;
                    (of_part, own)
                }
                None => {
                    told(asked, std::mem::take(&mut known), b.columns, progress);
                    let solved = self.solve_part(asked, b, first, &joined);
                    let (own, of_part) = solved.map_err(|error| error.of_columns_from(first))?;
                    if self.keep.journal.is_kept() {
                        let of = of.get_or_insert_with(|| self.key(asked, &b.data));
                        self.keep(of, first, &of_part, &own.data);
                    }
                    (of_part, own)
                }
            };
            if own.columns == b.columns {
                told(asked, known, b.columns, progress);
                return Ok((own, of_part));
            }
            if first == 0 {
                x = NodeFields::zeros(b.nodes, b.columns);
            }
            put(&own, first, &mut x);
            first += own.columns.max(1);
            stats.join(of_part);
        }
        joined.finish();
        told(asked, known, b.columns, progress);
        Ok((x, stats))
    }

    /// The columns from `first` on that are solved together.
    fn solve_part(
        &self,
        asked: SolveKind<'_>,
        b: &NodeFields,
        first: usize,
        joined: &JoinedProgress<'_>,
    ) -> SolveResult {
        let factor = self.factor(joined.progress)?;
        let width = factor.columns_together().clamp(1, (b.columns - first).max(1));
        let copied;
        let (rhs, progress): (_, &dyn Progress) = if width >= b.columns {
            (b, joined.progress)
        } else {
            joined.parts.store((b.columns - first).div_ceil(width) as u64, Relaxed);
            copied = columns_of(b, first, width);
            (&copied, joined)
        };
        match asked {
            SolveKind::JudgedFields => factor.solve_and_judge(rhs, progress),
            _ => factor.solve(rhs, progress),
        }
    }
}

/// Reports that columns of the body were there already; other solves have too many blocks to report.
fn told(asked: SolveKind<'_>, known: usize, all: usize, progress: &dyn Progress) {
    if known > 0 && matches!(asked, SolveKind::JudgedFields) {
        progress.tell(&format!("resumes: {known} of {all} columns were there"));
    }
}

/// The key of the part `number`.
fn part(of: &blake3::Hasher, number: usize) -> Key {
    of.clone().update(&(number as u64).to_le_bytes()).finalize().into()
}

fn columns_of(fields: &NodeFields, first: usize, count: usize) -> NodeFields {
    let mut part = NodeFields::zeros(fields.nodes, count);
    let rows = part.data.chunks_exact_mut(count.max(1)).zip(fields.data.chunks_exact(fields.columns.max(1)));
    rows.for_each(|(to, from)| to.copy_from_slice(&from[first..][..count]));
    part
}

fn put(part: &NodeFields, first: usize, fields: &mut NodeFields) {
    let (count, all) = (part.columns.max(1), fields.columns.max(1));
    let rows = part.data.chunks_exact(count).zip(fields.data.chunks_exact_mut(all));
    rows.for_each(|(from, to)| to[first..][..count].copy_from_slice(from));
}

impl Factor for KeptSolves<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solve_parts(SolveKind::Fields, b, progress)
    }

    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.factor(&crate::solve::Silent)?.precondition(b)
    }

    fn solve_at(&self, loaded: &[u32], b: &NodeFields, asked: &[u32]) -> Result<NodeFields, SolveError> {
        let journal = self.keep.journal;
        let key = || self.key(SolveKind::Rows { loaded, asked }, &b.data);
        let mut of = journal.has_records().then(key);
        let found = of.as_ref().and_then(|of| self.find::<()>(of, 0));
        if let Some(((), data)) = found.filter(|(_, data)| data.len() == 3 * asked.len() * b.columns) {
            return Ok(NodeFields { nodes: asked.len(), columns: b.columns, data });
        }
        let x = self.factor(&crate::solve::Silent)?.solve_at(loaded, b, asked)?;
        if journal.is_kept() {
            self.keep(of.get_or_insert_with(key), 0, &(), &x.data);
        }
        Ok(x)
    }

    fn kept(&self, nodes: &[u32], progress: &dyn Progress) -> Result<Option<KeptFactor>, SolveError> {
        self.factor(progress)?.kept(nodes, progress)
    }

    fn unkept(&self, progress: &dyn Progress) -> Result<Option<&dyn Factor>, SolveError> {
        self.factor(progress).map(Some)
    }

    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        let journal = self.keep.journal;
        let mut of = journal.has_records().then(|| self.key(SolveKind::Strips(nodes), &[]));
        let (mut strip, mut done) = (first, 0);
        while let Some(((rows, columns), values)) =
            of.as_ref().and_then(|of| self.find::<(Vec<u32>, Vec<u32>)>(of, strip))
        {
            if values.len() != 9 * rows.len() * columns.len() {
                break;
            }
            take(&InverseStrip { rows: &rows, columns: &columns, values: &values });
            (strip, done) = (strip + 1, done + columns.len());
        }
        if done > 0 {
            progress.tell(&format!("resumes: the columns of {done} of {} nodes were there", nodes.len()));
        }
        if done == nodes.len() {
            return Ok(());
        }
        let from = strip;
        let mut keeping = |own: &InverseStrip<'_>| {
            if journal.is_kept() {
                let of = of.get_or_insert_with(|| self.key(SolveKind::Strips(nodes), &[]));
                self.keep(of, strip, &(own.rows, own.columns), own.values);
            }
            strip += 1;
            take(own);
        };
        self.factor(progress)?.inverse_block_from(from, nodes, &mut keeping, progress)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solve_parts(SolveKind::JudgedFields, b, progress)
    }
}

/// Several solves shown as one step.
struct JoinedProgress<'a> {
    progress: &'a dyn Progress,
    parts: AtomicU64,
    has_begun: AtomicBool,
}

impl JoinedProgress<'_> {
    fn finish(&self) {
        if self.has_begun.load(Relaxed) {
            self.progress.end();
        }
    }
}

impl Progress for JoinedProgress<'_> {
    fn begin(&self, step: &str, units: u64) {
        if !self.has_begun.swap(true, Relaxed) {
            self.progress.begin(step, units * self.parts.load(Relaxed));
        }
    }

    fn advance(&self, units: u64) {
        self.progress.advance(units);
    }

    fn end(&self) {}

    fn tell(&self, sentence: &str) {
        self.progress.tell(sentence);
    }
}
