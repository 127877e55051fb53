//! The list of methods that solve A x = b.

use super::analysis::SharedAnalysis;
use super::auto::AUTO;
use super::cholesky::CHOLESKY;
use super::error::SolveError;
use super::faer_cholesky::FAER;
use super::mixed::MIXED;
use super::pcg::PCG;
use super::solver::{AnalysisInput, Job, LinearSolver, Method, NO_UNKNOWNS, Solver};
use crate::base::by_name::by_name;
use crate::base::progress::Progress;
use crate::config::unknown_name;
use crate::fem::StiffnessMatrix;
use std::str::FromStr;

/// All methods; a new one is one file and one line here.
pub const SOLVERS: &[&Method] = &[&CHOLESKY, &MIXED, &PCG, &FAER, &AUTO];

/// The method called `name`; the error lists the known ones.
pub fn find_method(name: &str) -> Result<&'static Method, String> {
    let found = SOLVERS.iter().copied().find(|method| method.name == name);
    found.ok_or_else(|| unknown_name("solver", name, SOLVERS.iter().map(|method| method.name)))
}

/// The method that takes least memory, where no factor fits: the first that makes none.
pub fn without_factor() -> &'static Method {
    SOLVERS.iter().copied().find(|method| !method.is_direct).unwrap_or(&PCG)
}

impl Solver {
    /// The solver for all matrices with the graph of `a`.
    pub fn analyse(
        &self,
        a: &StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn LinearSolver>, SolveError> {
        self.analyse_for(a, Job::default(), progress)
    }

    /// Runs [`Solver::analyse`] for a job.
    pub fn analyse_for(
        &self,
        a: &StiffnessMatrix,
        job: Job,
        progress: &dyn Progress,
    ) -> Result<Box<dyn LinearSolver>, SolveError> {
        let method = if a.nodes() == 0 { &NO_UNKNOWNS } else { self.method };
        let pattern = &SharedAnalysis::default();
        (method.analyse)(&AnalysisInput { settings: *self, a, job, methods: SOLVERS, pattern, progress })
    }
}

/// Reads what [`Solver`] displays.
impl FromStr for Solver {
    type Err = String;

    fn from_str(text: &str) -> Result<Solver, String> {
        let (name, tolerance) = text.split_once(' ').map_or((text, None), |(name, rest)| (name, Some(rest)));
        let method = find_method(name)?;
        let solver = Solver { method, ..Solver::default() };
        match (method.is_direct, tolerance.map(str::parse)) {
            (true, None) => Ok(solver),
            (false, Some(Ok(tolerance))) => Ok(Solver { tolerance, ..solver }),
            _ => {
                let known = SOLVERS.iter().map(|method| match method.is_direct {
                    true => format!("\"{}\"", method.name),
                    false => format!("\"{} 1e-6\" with its tolerance", method.name),
                });
                let known: Vec<String> = known.collect();
                Err(format!("\"{text}\" is no solver: write {}", known.join(", or ")))
            }
        }
    }
}

impl Default for &'static Method {
    fn default() -> &'static Method {
        &CHOLESKY
    }
}

by_name!(Method, find_method);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solver_is_read_as_it_is_displayed() {
        for text in ["cholesky", "mixed", "faer", "pcg 1e-6", "pcg 2.5e-5", "pcg 1e-13"] {
            assert_eq!(text.parse::<Solver>().map(|solver| solver.to_string()), Ok(text.to_owned()));
        }
        for text in ["", "choleski", "cholesky 1e-6", "mixed 1e-6", "pcg", "pcg low", "pcg 1e-6 2"] {
            assert!(text.parse::<Solver>().is_err(), "{text}");
        }
        assert!("choleski".parse::<Solver>().unwrap_err().contains("did you mean \"cholesky\""));
    }
}
