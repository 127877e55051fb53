//! Solves with the factor of a body, in a thread that holds it.
//!
//! In: A of the free nodes. Out: A⁻¹ b, and displacements for forces at single nodes. The thread factorises while the session begins, so
//! that the factor is there when a blade comes; it ends when its [`Solves`] is dropped, or as soon as the factor is done then. While it
//! rests it has no factor.

use crate::fem::{NodeFields, StiffnessMatrix};
use crate::solve::{Factor, Silent, SolveError, Solver};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Displacements of all free nodes for a force of 1 N along each axis: 3 free nodes × 3, m/N.
pub type PointField = Arc<NodeFields>;

/// Nodes that are solved for together: one block of a factor's solve, so that the bits of one do not depend on how many others are asked
/// for, and nobody waits long for another one's answer.
pub const TOGETHER: usize = 8;

enum Question {
    Fields(NodeFields, Answer<NodeFields>),
    At(Vec<u32>, NodeFields, Option<Vec<u32>>, Answer<NodeFields>),
    Points(Vec<u32>, Answer<Vec<PointField>>),
    Rest,
    Wake,
}

type Answer<T> = Sender<Result<T, String>>;

pub struct Solves {
    ask: Sender<Question>,
}

impl Solves {
    pub fn start(a: StiffnessMatrix) -> Solves {
        let (ask, asked) = channel();
        std::thread::spawn(move || run(&a, &asked));
        Solves { ask }
    }

    /// A⁻¹ b; waits for the factor and the solve. The error says why there is none.
    pub fn solve(&self, b: NodeFields) -> Result<NodeFields, String> {
        self.answered(|answer| Question::Fields(b, answer))
    }

    /// A⁻¹ b at the nodes asked, or at all, with b at these nodes, and zero at all others; as exact as the factor, without refinement.
    pub fn solve_at(
        &self,
        nodes: Vec<u32>,
        b: NodeFields,
        asked: Option<Vec<u32>>,
    ) -> Result<NodeFields, String> {
        self.answered(|answer| Question::At(nodes, b, asked, answer))
    }

    /// A⁻¹ of unit forces at each of these nodes. The bits of one do not depend on the others.
    pub fn points(&self, nodes: Vec<u32>) -> Result<Vec<PointField>, String> {
        self.answered(|answer| Question::Points(nodes, answer))
    }

    /// Gives back the memory of the factor until the next question, which then waits for another one.
    pub fn rest(&self) {
        // A thread that has ended has none.
        let _ = self.ask.send(Question::Rest);
    }

    /// Makes the factor again, if it rests.
    pub fn wake(&self) {
        // A thread that has ended tells so when it is asked.
        let _ = self.ask.send(Question::Wake);
    }

    fn answered<T>(&self, question: impl FnOnce(Answer<T>) -> Question) -> Result<T, String> {
        let (answer, answered) = channel();
        let ended = || "the thread that solves for cuts has ended".to_owned();
        self.ask.send(question(answer)).map_err(|_closed| ended())?;
        answered.recv().map_err(|_closed| ended())?
    }
}

fn run(a: &StiffnessMatrix, asked: &Receiver<Question>) {
    if let Err(error) = serve(a, asked) {
        let message = error.to_string();
        while let Ok(question) = asked.recv() {
            // Who does not wait any more needs no answer.
            let _ = match question {
                Question::Fields(_, answer) | Question::At(_, _, _, answer) => {
                    answer.send(Err(message.clone())).is_ok()
                }
                Question::Points(_, answer) => answer.send(Err(message.clone())).is_ok(),
                Question::Rest | Question::Wake => true,
            };
        }
    }
}

fn serve(a: &StiffnessMatrix, asked: &Receiver<Question>) -> Result<(), SolveError> {
    let analysed = Solver::default().analyse(a, &Silent)?;
    let mut first = None;
    loop {
        let factor = analysed.factor(a, &Silent)?;
        loop {
            let Some(question) = first.take().or_else(|| asked.recv().ok()) else { return Ok(()) };
            match question {
                Question::Rest => break,
                question => answer(&*factor, question),
            }
        }
        drop(factor);
        while first.as_ref().is_none_or(|question| matches!(question, Question::Rest)) {
            let Ok(question) = asked.recv() else { return Ok(()) };
            first = Some(question);
        }
    }
}

fn answer(factor: &dyn Factor, question: Question) {
    let all = || (0..factor.nodes() as u32).collect::<Vec<u32>>();
    // Who does not wait any more needs no answer.
    let _ = match question {
        Question::Rest | Question::Wake => true,
        Question::Fields(b, answer) => {
            let solved = factor.solve(&b, &Silent).map(|(x, _)| x);
            answer.send(solved.map_err(|error| error.to_string())).is_ok()
        }
        Question::At(nodes, b, asked, answer) => {
            let solved = factor.solve_at(&nodes, &b, &asked.unwrap_or_else(all));
            answer.send(solved.map_err(|error| error.to_string())).is_ok()
        }
        Question::Points(nodes, answer) => {
            answer.send(points(factor, &nodes, &all()).map_err(|error| error.to_string())).is_ok()
        }
    };
}

fn points(factor: &dyn Factor, nodes: &[u32], all: &[u32]) -> Result<Vec<PointField>, SolveError> {
    // An iterative method ends when all columns of a solve are exact enough.
    let together = if factor.columns_together() == usize::MAX { TOGETHER } else { 1 };
    let mut fields = Vec::new();
    for some in nodes.chunks(together) {
        let x = factor.solve_at(some, &NodeFields::unit(some.len()), all)?;
        fields.extend((0..some.len()).map(|k| {
            let data = (0..3 * x.nodes).flat_map(|row| x.row(row)[3 * k..3 * k + 3].iter().copied());
            Arc::new(NodeFields { nodes: x.nodes, columns: 3, data: data.collect() })
        }));
    }
    Ok(fields)
}
