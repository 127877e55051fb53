//! faer's own sparse Cholesky factorization, in the order of METIS: the reference for [`CHOLESKY`], and the factor of matrices that are
//! not positive definite.
//!
//! In: A with one column for each unknown. Out: its supernodal factor, whose dense kernels take all threads, and solves of a
//! block of columns on each thread. The bits of the factor depend on the number of threads; no part of it can be kept. Beyond a
//! critical state A = L D Lᵀ, without pivoting: as many pivots of D are negative as eigenvalues of A (Sylvester's law of inertia), and
//! the residual of each solve is refined or refused as that of every other.

use super::analysis::{nested_dissection, ordering_memory, seconds_of};
use super::cholesky::CHOLESKY;
use super::error::SolveError;
use super::fronts::front_work;
use super::refinement::{conditioning, refined};
use super::solver::{Factor, LinearSolver, Method, SolveResult, SolveStats};
use super::substitution::block_width;
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use rayon::prelude::*;
use std::time::Instant;

pub const FAER: Method = Method {
    name: "faer",
    is_direct: true,
    keeps_factor: false,
    bounds_error: true,
    remedy: CHOLESKY.remedy,
    factor_number: size_of::<f64>(),
    // Its bits depend on the number of threads.
    least_seconds: None,
    analyse: |asked| Ok(Box::new(Direct::new(asked.a, asked.progress)?)),
};

/// All matrices of one graph.
pub(super) struct Direct {
    symbolic: SymbolicCholesky<usize>,
    /// The lower triangle of A, column after column.
    starts: Vec<usize>,
    rows: Vec<usize>,
    ordering_s: f64,
    symbolic_s: f64,
}

/// Columns of the lower triangle of A: where they begin, and their rows.
fn lower(a: &StiffnessMatrix) -> (Vec<usize>, Vec<usize>) {
    let (mut starts, mut rows) = (vec![0], Vec::new());
    for node in 0..a.nodes() {
        let below = &a.edges[a.edge_start[node]..a.edge_start[node + 1]];
        for axis in 0..3 {
            rows.extend((axis..3).map(|row| 3 * node + row));
            rows.extend(below.iter().flat_map(|[_, other]| (0..3).map(|row| 3 * *other as usize + row)));
            starts.push(rows.len());
        }
    }
    (starts, rows)
}

/// Their numbers.
fn lower_values(a: &StiffnessMatrix) -> Vec<f64> {
    let of_node = |node: usize| {
        let below = &a.blocks[a.edge_start[node]..a.edge_start[node + 1]];
        (0..3).flat_map(move |axis| {
            let own = (axis..3).map(move |row| a.diagonal[node][(row, axis)]);
            own.chain(below.iter().flat_map(move |block| (0..3).map(move |row| block[(axis, row)])))
        })
    };
    (0..a.nodes()).flat_map(of_node).collect()
}

impl Direct {
    pub(super) fn new(a: &StiffnessMatrix, progress: &dyn Progress) -> Result<Direct, SolveError> {
        let n = 3 * a.nodes();
        machine::expect("ordering the unknowns and finding the factor's pattern", ordering_memory(a))
            .map_err(SolveError::FactorMemory)?;
        progress.begin("ordering", 0);
        let started = Instant::now();
        let ordering = nested_dissection(a)?;
        let ordering_s = started.elapsed().as_secs_f64();
        progress.end();
        let started = Instant::now();
        let unknowns = |nodes: &[u32]| -> Vec<usize> {
            nodes.iter().flat_map(|&node| (0..3).map(move |axis| 3 * node as usize + axis)).collect()
        };
        let (forward, inverse) = (unknowns(&ordering.forward), unknowns(&ordering.inverse));
        let (starts, rows) = lower(a);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &rows);
        let order = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, n));
        // Its simplicial factorization would take twenty times as long.
        let supernodal_flop_ratio_threshold = SupernodalThreshold::FORCE_SUPERNODAL;
        let params = CholeskySymbolicParams { supernodal_flop_ratio_threshold, ..Default::default() };
        let symbolic = factorize_symbolic_cholesky(pattern, Side::Lower, order, params)
            .map_err(|error| SolveError::Ordering { nodes: a.nodes(), reason: error.to_string() })?;
        Ok(Direct { symbolic, starts, rows, ordering_s, symbolic_s: started.elapsed().as_secs_f64() })
    }

    fn making(&self) -> StackReq {
        self.symbolic.factorize_numeric_llt_scratch::<f64>(parallel(), Default::default())
    }

    /// L D Lᵀ of a matrix that need not be positive definite; errors where a pivot is zero.
    pub(super) fn factor_signed<'a>(&'a self, a: &'a StiffnessMatrix) -> Result<Supernodal<'a>, SolveError> {
        self.fits(a, 1)?;
        let started = Instant::now();
        let n = 3 * a.nodes();
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows);
        let of_a = lower_values(a);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let need = self.symbolic.factorize_numeric_ldlt_scratch::<f64>(parallel(), Default::default());
        let made = self.symbolic.factorize_numeric_ldlt(
            &mut values,
            SparseColMatRef::new(pattern, &of_a),
            Side::Lower,
            LdltRegularization::default(),
            parallel(),
            MemStack::new(&mut memory(need)?),
            Default::default(),
        );
        made.map(drop).map_err(|error| {
            let faer::linalg::cholesky::ldlt::factor::LdltError::ZeroPivot { index } = error;
            SolveError::NotPositiveDefinite { unknowns: n, pivot: index }
        })?;
        let factor_s = started.elapsed().as_secs_f64();
        Ok(Supernodal { a, of: self, values, is_signed: true, factor_s })
    }
}

fn parallel() -> Par {
    Par::rayon(rayon::current_num_threads())
}

/// Allocates the scratch memory `need`.
fn memory(need: StackReq) -> Result<MemBuffer, SolveError> {
    let full =
        |_| SolveError::FactorMemory(machine::refused("scratch of a factor", need.size_bytes() as f64));
    MemBuffer::try_new(need).map_err(full)
}

impl LinearSolver for Direct {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        let making = (self.making().size_bytes() + 8 * self.rows.len()) as f64;
        8.0 * self.symbolic.len_val() as f64 + making.max(7.0 * 24.0 * (a.nodes() * columns) as f64)
    }

    fn seconds(&self, _: &StiffnessMatrix, columns: usize) -> f64 {
        let SymbolicCholeskyRaw::Supernodal(supernodes) = self.symbolic.raw() else { return f64::INFINITY };
        let (begin, end) = (supernodes.supernode_begin(), supernodes.supernode_end());
        let work = |s: usize| front_work(end[s] - begin[s], supernodes.supernode(s).pattern().len());
        seconds_of((0..supernodes.n_supernodes()).map(work).sum(), self.symbolic.len_val() as f64, columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        let what = format!("a factor of {} numbers by faer", self.symbolic.len_val());
        machine::fits(what, self.memory(a, columns), 0.0).map_err(SolveError::FactorMemory)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        self.fits(a, 1)?;
        progress.begin("factorization", 0);
        let started = Instant::now();
        let n = 3 * a.nodes();
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows);
        let of_a = lower_values(a);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let mut scratch = memory(self.making())?;
        let made = self.symbolic.factorize_numeric_llt(
            &mut values,
            SparseColMatRef::new(pattern, &of_a),
            Side::Lower,
            LltRegularization::default(),
            parallel(),
            MemStack::new(&mut scratch),
            Default::default(),
        );
        let made = made.map(drop);
        progress.end();
        made.map_err(|error| {
            let faer::linalg::cholesky::llt::factor::LltError::NonPositivePivot { index } = error;
            SolveError::NotPositiveDefinite { unknowns: n, pivot: index }
        })?;
        let factor_s = started.elapsed().as_secs_f64();
        Ok(Box::new(Supernodal { a, of: self, values, is_signed: false, factor_s }))
    }
}

/// A with its factor.
pub(super) struct Supernodal<'a> {
    a: &'a StiffnessMatrix,
    of: &'a Direct,
    values: Vec<f64>,
    /// L D Lᵀ, with D on the diagonal, and not L Lᵀ.
    is_signed: bool,
    factor_s: f64,
}

impl Supernodal<'_> {
    /// Number of negative eigenvalues of A: of negative pivots.
    pub(super) fn negative(&self) -> usize {
        let SymbolicCholeskyRaw::Supernodal(supernodes) = self.of.symbolic.raw() else { return 0 };
        let pivots = |s: usize| {
            let own = supernodes.supernode_end()[s] - supernodes.supernode_begin()[s];
            let rows = own + supernodes.supernode(s).pattern().len();
            let first = supernodes.col_ptr_for_val()[s];
            (0..own).filter(move |column| self.values[first + column * (rows + 1)] < 0.0).count()
        };
        (0..supernodes.n_supernodes()).map(pivots).sum()
    }

    /// A⁻¹ b, a block of columns on each thread: faer's own parallel solve of many columns takes longer than one thread.
    fn substitute(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        let (n, width) = (3 * b.nodes, block_width(b.columns));
        let symbolic = &self.of.symbolic;
        let blocks = (0..b.columns).into_par_iter().step_by(width).map(|first| {
            let columns = width.min(b.columns - first);
            let mut x: Vec<f64> = (first..first + columns)
                .flat_map(|c| b.data.iter().skip(c).step_by(b.columns))
                .copied()
                .collect();
            let mut scratch = memory(symbolic.solve_in_place_scratch::<f64>(columns, Par::Seq))?;
            let block = MatMut::from_column_major_slice_mut(&mut x, n, columns);
            let stack = MemStack::new(&mut scratch);
            match self.is_signed {
                true => LdltRef::new(symbolic, &self.values).solve_in_place_with_conj(
                    Conj::No,
                    block,
                    Par::Seq,
                    stack,
                ),
                false => LltRef::new(symbolic, &self.values).solve_in_place_with_conj(
                    Conj::No,
                    block,
                    Par::Seq,
                    stack,
                ),
            }
            Ok(x)
        });
        let all = blocks.collect::<Result<Vec<Vec<f64>>, SolveError>>()?.concat();
        let data = (0..n).flat_map(|row| all.iter().skip(row).step_by(n)).copied().collect();
        Ok(NodeFields { data, ..*b })
    }
}

impl Factor for Supernodal<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        progress.begin("solves", b.columns as u64);
        let started = Instant::now();
        let x = self.substitute(b)?;
        progress.end();
        let (x, residuals) = refined(self.a, x, b, &|b| self.substitute(b))?;
        let stats = SolveStats {
            method: &FAER,
            chosen: None,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            ordering_s: self.of.ordering_s,
            symbolic_s: self.of.symbolic_s,
            factor_s: self.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            factor_entries: self.values.len(),
            iterations: 0,
            residuals,
            conditioning: None,
        };
        Ok((x, stats))
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let (x, mut stats) = self.solve(b, progress)?;
        stats.conditioning = Some(conditioning(self.a, &x, b, &|b| self.substitute(b), progress)?);
        Ok((x, stats))
    }
}
