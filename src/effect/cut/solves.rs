//! Solves with the factor of a body, in a thread that holds it.
//!
//! In: A of the free nodes. Out: A⁻¹ b. The thread factorises while the session begins, so that the factor is there when a blade comes;
//! it ends when its [`Solves`] is dropped, or as soon as the factor is done then.

use crate::fem::{NodeFields, StiffnessMatrix};
use crate::solve::{Silent, SolveError, Solver};
use std::sync::mpsc::{Receiver, Sender, channel};

struct Question {
    b: NodeFields,
    answer: Sender<Result<NodeFields, String>>,
}

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
        let (answer, answered) = channel();
        let ended = || "the thread that solves for cuts has ended".to_owned();
        self.ask.send(Question { b, answer }).map_err(|_closed| ended())?;
        answered.recv().map_err(|_closed| ended())?
    }
}

fn run(a: &StiffnessMatrix, asked: &Receiver<Question>) {
    match serve(a, asked) {
        Ok(()) => {}
        Err(error) => {
            let message = error.to_string();
            while let Ok(question) = asked.recv() {
                // Who does not wait any more needs no answer.
                let _ = question.answer.send(Err(message.clone()));
            }
        }
    }
}

fn serve(a: &StiffnessMatrix, asked: &Receiver<Question>) -> Result<(), SolveError> {
    let analysed = Solver::default().analyse(a, &Silent)?;
    let factor = analysed.factor(a, &Silent)?;
    while let Ok(Question { b, answer }) = asked.recv() {
        let solved = factor.solve(&b, &Silent).map(|(x, _)| x).map_err(|error| error.to_string());
        // Who does not wait any more needs no answer.
        let _ = answer.send(solved);
    }
    Ok(())
}
