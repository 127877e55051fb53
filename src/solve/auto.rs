//! The method that is fastest among those that fit into memory, by their own predictions.
//!
//! In: A, and how many columns will be solved. Out: the solver of one method of the list, with the reason in words, which goes
//! into the closing table. Methods are analysed in the order of the least time that each may take, until none of the rest can
//! be faster than the best. A method that foresees, while it iterates, that it would be slower than the next one gives way to it.

use super::analysis::SharedAnalysis;
use super::error::SolveError;
use super::kept_factor::KeptFactor;
use super::solver::{
    AnalysisInput, Factor, InverseStrip, Job, LinearSolver, Method, NoUnknowns, SolveResult, SolveStats,
    Solver,
};
use crate::base::progress::Progress;
use crate::base::table::{bytes, seconds};
use crate::fem::{NodeFields, StiffnessMatrix};
use std::cell::RefCell;
use std::sync::OnceLock;

pub const AUTO: Method = Method {
    name: "auto",
    is_direct: false,
    keeps_factor: true,
    bounds_error: false,
    remedy: "name a direct method in solver.method, and look for slivers, for thin parts and for large contrasts of stiffness \
             (`greenstage check`)",
    factor_number: 0,
    least_seconds: None,
    analyse: |asked| {
        let choice = choose(asked, None)?;
        let AnalysisInput { settings, job, methods, pattern, .. } = *asked;
        Ok(Box::new(Auto {
            settings,
            job,
            methods,
            pattern: pattern.clone(),
            choice,
            second: OnceLock::new(),
        }))
    },
};

/// Time expected of a method that was not analysed, over its least time.
const USUAL: f64 = 2.0;

/// A method that was taken.
struct Choice {
    method: &'static Method,
    solver: Box<dyn LinearSolver>,
    /// The reason of the choice.
    reason: String,
    /// Seconds that the next best takes by its prediction; infinite where there is none.
    next: f64,
}

/// The choice, with what another is made of.
struct Auto {
    settings: Solver,
    job: Job,
    methods: &'static [&'static Method],
    pattern: SharedAnalysis,
    choice: Choice,
    /// Taken once the first has proved slow.
    second: OnceLock<Choice>,
}

/// Whether a method comes last, its seconds, and what is known of it.
type Ranked<T> = (bool, f64, T);

/// Sorts by rank, then by seconds.
fn rank<T>(list: &mut [Ranked<T>]) {
    list.sort_by(|one, other| one.0.cmp(&other.0).then(one.1.total_cmp(&other.1)));
}

/// The fastest method that fits, without the one that proved slow. If the factor is needed for more than the solve, the methods
/// whose factor can be kept come first.
fn choose(asked: &AnalysisInput<'_>, slow: Option<&'static Method>) -> Result<Choice, SolveError> {
    let AnalysisInput { a, job: Job { columns, needs_factor }, .. } = *asked;
    let least = |method: &&'static Method| {
        let is_last = needs_factor && !method.keeps_factor;
        if Some(*method) == slow || is_last && method.is_direct {
            return None;
        }
        Some((is_last, method.least_seconds?(asked), *method))
    };
    let mut waiting: Vec<Ranked<&'static Method>> = asked.methods.iter().filter_map(least).collect();
    rank(&mut waiting);
    let mut found: Vec<Ranked<(&'static Method, Box<dyn LinearSolver>)>> = Vec::new();
    let (mut refused, mut next) = (None, f64::INFINITY);
    for (is_last, least, method) in waiting {
        if found.iter().any(|(was_last, best, _)| *best <= least || is_last && !was_last) {
            next = next.min(USUAL * least);
            continue;
        }
        let settings = Solver { method, ..asked.settings };
        let analysed = (method.analyse)(&AnalysisInput { settings, ..*asked });
        match analysed.and_then(|solver| solver.fits(a, columns).map(|()| solver)) {
            Ok(solver) => found.push((is_last, solver.seconds(a, columns), (method, solver))),
            Err(error) => match error {
                SolveError::FactorMemory(_) | SolveError::Unfit { .. } | SolveError::Memory(_) => {
                    refused = Some(error);
                }
                other => return Err(other),
            },
        }
    }
    rank(&mut found);
    let told: Vec<String> = found
        .iter()
        .map(|(_, s, (method, solver))| {
            format!("for {} {} and {}", method.name, seconds(*s), bytes(solver.memory(a, columns)))
        })
        .collect();
    let because = match &refused {
        Some(
            SolveError::FactorMemory(refused)
            | SolveError::Unfit { refused, .. }
            | SolveError::Memory(refused),
        ) => {
            format!(", for {refused}; ")
        }
        _ => ": ".into(),
    };
    let mut found = found.into_iter();
    let Some((_, _, (method, solver))) = found.next() else {
        return Err(refused.unwrap_or(SolveError::NoFactor(AUTO.name)));
    };
    let next = found.next().map_or(next, |(_, s, _)| next.min(s));
    let reason = format!("{} by \"auto\"{because}predicted {}", method.name, told.join(", "));
    Ok(Choice { method, solver, reason, next })
}

impl LinearSolver for Auto {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.choice.solver.memory(a, columns)
    }

    fn seconds(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.choice.solver.seconds(a, columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        self.choice.solver.fits(a, columns)
    }

    fn keeps(&self, a: &StiffnessMatrix, columns: usize) -> bool {
        self.choice.solver.keeps(a, columns)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        let Choice { solver, reason, next, .. } = &self.choice;
        let factor = RefCell::new((solver.factor_within(a, *next, progress)?, reason.clone()));
        Ok(Box::new(ChosenFactor { auto: self, a, factor }))
    }
}

/// The factor that was taken, with the reason.
struct ChosenFactor<'a> {
    auto: &'a Auto,
    a: &'a StiffnessMatrix,
    factor: RefCell<(Box<dyn Factor + 'a>, String)>,
}

impl ChosenFactor<'_> {
    /// Solves with the method that was taken; where it gives up, with the next.
    fn solved(&self, solve: &dyn Fn(&dyn Factor) -> SolveResult, progress: &dyn Progress) -> SolveResult {
        let first = solve(self.factor.borrow().0.as_ref());
        let solved = match first {
            Err(slow @ (SolveError::Slow { .. } | SolveError::Residual { .. })) => {
                self.take_next(&slow, progress)?;
                solve(self.factor.borrow().0.as_ref())
            }
            first => first,
        };
        let chosen = Some(self.factor.borrow().1.clone());
        solved.map(|(x, stats)| (x, SolveStats { chosen, ..stats }))
    }

    /// The next method takes over. Errors with the reason where there is none.
    fn take_next(&self, slow: &SolveError, progress: &dyn Progress) -> Result<(), SolveError> {
        let Auto { settings, job, methods, ref pattern, ref choice, ref second } = *self.auto;
        if second.get().is_none() {
            let asked = AnalysisInput { settings, a: self.a, job, methods, pattern, progress };
            let made = choose(&asked, Some(choice.method))?;
            second.get_or_init(|| made);
        }
        let Some(next) = second.get() else { return Ok(()) };
        progress.tell(&format!("{} takes over from {}: {slow}.", next.method.name, choice.method.name));
        let reason = format!("{}, after {} had given up", next.reason, choice.method.name);
        // Its memory goes before the next takes its own.
        self.factor.replace((Box::new(NoUnknowns), String::new()));
        self.factor.replace((next.solver.factor(self.a, progress)?, reason));
        Ok(())
    }
}

impl Factor for ChosenFactor<'_> {
    fn nodes(&self) -> usize {
        self.factor.borrow().0.nodes()
    }

    fn columns_together(&self) -> usize {
        self.factor.borrow().0.columns_together()
    }

    fn solve_at(&self, loaded: &[u32], b: &NodeFields, asked: &[u32]) -> Result<NodeFields, SolveError> {
        self.factor.borrow().0.solve_at(loaded, b, asked)
    }

    fn kept(&self, nodes: &[u32], progress: &dyn Progress) -> Result<Option<KeptFactor>, SolveError> {
        self.factor.borrow().0.kept(nodes, progress)
    }

    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        self.factor.borrow().0.inverse_block_from(first, nodes, take, progress)
    }

    fn solve_memory(&self, columns: usize, asked: usize) -> f64 {
        self.factor.borrow().0.solve_memory(columns, asked)
    }

    fn strip_nodes(&self) -> usize {
        self.factor.borrow().0.strip_nodes()
    }

    fn strip_memory(&self, nodes: usize) -> f64 {
        self.factor.borrow().0.strip_memory(nodes)
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solved(&|factor| factor.solve(b, progress), progress)
    }

    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.factor.borrow().0.precondition(b)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solved(&|factor| factor.solve_and_judge(b, progress), progress)
    }
}

#[cfg(test)]
mod tests {
    use super::super::cholesky::CHOLESKY;
    use super::super::pcg::PCG;
    use super::*;
    use crate::base::progress::Silent;
    use crate::fem::{Lame, Partition, TET4};
    use crate::mesh::{Block, block};
    use crate::solve::residual::Column;
    use crate::solve::{SOLVERS, residuals};

    /// A block that is held at both ends.
    fn body(size: [f64; 3], cells: [u32; 3]) -> StiffnessMatrix {
        let mesh = block(&Block { size, cells }).unwrap();
        let k = TET4.assemble(&mesh, &vec![Lame::from_young_poisson(1.0, 0.3); mesh.tets.len()]).unwrap();
        let held = mesh.groups["xmin"].iter().chain(&mesh.groups["xmax"]).copied();
        Partition::new(mesh.nodes.len(), held).a(&k)
    }

    fn chosen(a: &StiffnessMatrix, job: Job) -> &'static Method {
        let pattern = &SharedAnalysis::default();
        let settings = Solver::default();
        choose(&AnalysisInput { settings, a, job, methods: SOLVERS, pattern, progress: &Silent }, None)
            .unwrap()
            .method
    }

    #[test]
    fn mixed_is_considered_and_left_where_f32_or_more_work_speaks_against_it() {
        let once = Job { columns: 24, needs_factor: false };
        let cube = body([1.0; 3], [20; 3]);
        assert_eq!(chosen(&cube, once).name, "mixed");
        assert_eq!(chosen(&cube, Job { needs_factor: true, ..once }).name, "cholesky");
        let needle = body([1.0, 0.002, 0.002], [300, 2, 2]);
        assert_eq!(chosen(&needle, once).name, "cholesky");
    }

    /// Conjugate gradients on a needle found no end.
    #[test]
    fn what_iterates_without_end_gives_way_to_the_next_method() {
        const EAGER: Method = Method { least_seconds: Some(|_| 0.0), ..PCG };
        const PATIENT: Method = Method { least_seconds: PCG.least_seconds, ..CHOLESKY };
        let a = body([1.0, 0.002, 0.002], [300, 2, 2]);
        let b = NodeFields { nodes: a.nodes(), columns: 2, data: vec![1.0; 6 * a.nodes()] };
        let pattern = &SharedAnalysis::default();
        let job = Job { columns: 2, needs_factor: false };
        let (settings, progress) = (Solver::default(), &Silent);
        let auto = (AUTO.analyse)(&AnalysisInput {
            settings,
            a: &a,
            job,
            methods: &[&EAGER, &PATIENT],
            pattern,
            progress,
        });
        let auto = auto.unwrap();
        let factor = auto.factor(&a, &Silent).unwrap();
        let (x, stats) = factor.solve(&b, &Silent).unwrap();
        assert_eq!(stats.method.name, "cholesky");
        assert!(stats.chosen.unwrap().contains("after pcg had given up"));
        let (_, r) = residuals(&a, &x, &b);
        let errors = (0..b.columns).map(|column| Column::new(&a, &x, &b, &r, column).backward_error());
        assert!(errors.into_iter().all(|error| error < 1e-13));

        // Without another it says why.
        let alone = Solver { method: &PCG, max_iterations: 40, ..Solver::default() };
        let alone = alone.analyse(&a, &Silent).unwrap();
        let error = alone.factor(&a, &Silent).unwrap().solve(&b, &Silent).unwrap_err();
        let SolveError::Slow { iterations, expected, .. } = error else { panic!("{error}") };
        assert!((10..40).contains(&iterations) && expected > 40.0, "{iterations} {expected}");
    }
}
