//! Solves with the factor of a body, in a thread that holds it.
//!
//! In: A of the free nodes. Out: A⁻¹ b. The thread ends when its [`Solves`] is dropped, or as soon as the factor is done then. While it
//! rests it has no factor.

use crate::base::diagnostic::notice;
use crate::fem::{NodeFields, StiffnessMatrix};
use crate::solve::{Factor, Silent, SolveError, Solver};
use std::sync::Once;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Wait after which a notice says for what, once.
const LONG: Duration = Duration::from_secs(1);

enum Question {
    Fields(NodeFields, Answer<NodeFields>),
    At(Vec<u32>, NodeFields, Option<Vec<u32>>, Answer<NodeFields>),
    Rest,
    Wake,
}

type Answer<T> = Sender<Result<T, String>>;

pub struct Solves {
    ask: Sender<Question>,
    free: usize,
    is_told: Once,
    /// Questions that were asked.
    #[cfg(test)]
    pub asked: std::sync::atomic::AtomicUsize,
}

impl Solves {
    pub fn start(a: StiffnessMatrix) -> Solves {
        let ((ask, asked), free) = (channel(), a.nodes());
        std::thread::spawn(move || run(&a, &asked));
        Solves {
            ask,
            free,
            is_told: Once::new(),
            #[cfg(test)]
            asked: Default::default(),
        }
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
        #[cfg(test)]
        self.asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let (answer, answered) = channel();
        let ended = || "the thread that solves for cuts has ended".to_owned();
        self.ask.send(question(answer)).map_err(|_closed| ended())?;
        let answer = match answered.recv_timeout(LONG) {
            Err(RecvTimeoutError::Timeout) => {
                self.is_told.call_once(|| notice!("cut: waiting for the factor of {} nodes", self.free));
                answered.recv().map_err(|_closed| ended())
            }
            other => other.map_err(|_closed| ended()),
        };
        answer?
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
    };
}
