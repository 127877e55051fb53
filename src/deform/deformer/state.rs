//! Takes the state of a deformer, and goes on from one.

use super::Deformer;
use crate::deform::deformer_state::DeformerState;
use crate::deform::loads;
use crate::deform::model::BodyState;

impl Deformer {
    pub fn snapshot(&self) -> DeformerState {
        DeformerState {
            poses: self.poses.clone(),
            turns: self.turns.clone(),
            loads: self.applied(),
            loads_changed: self.loads_changed,
            contribution: self.contribution.clone(),
            state: self.state.clone(),
            summed: self.summed.clone(),
            response: self.response,
            slopes: self.slopes.clone(),
            evaluated: self.evaluated,
            memory: self.model.memory(),
        }
    }

    /// Goes on from a snapshot of a deformer of the same body and model. The error says why it cannot.
    pub fn restore(&mut self, from: &DeformerState) -> Result<(), String> {
        let shape = |state: &BodyState| (state.coefficients.len(), state.parts.len());
        let lists = [from.poses.len(), from.turns.len(), from.slopes.len()];
        if lists != [self.controls.len(); 3]
            || shape(&from.state) != shape(&self.state)
            || shape(&from.summed) != shape(&self.summed)
        {
            return Err(format!("body.{}: the stored state belongs to another body or model", self.body));
        }
        if !self.contribute(&from.contribution) {
            return Err(format!("body.{}: what effects add belongs to another body", self.body));
        }
        (self.contribution_changed, self.triangles_changed) = (false, false);
        if let Some(shared) = &self.loads {
            loads::set(shared, &from.loads);
        }
        self.model.set_memory(&from.memory).map_err(|message| format!("body.{}: {message}", self.body))?;
        self.poses.clone_from(&from.poses);
        self.turns.clone_from(&from.turns);
        self.loads_changed = from.loads_changed;
        self.slopes.clone_from(&from.slopes);
        (self.response, self.evaluated) = (from.response, from.evaluated);
        self.state.clone_from(&from.summed);
        self.deform();
        self.state.clone_from(&from.state);
        Ok(())
    }
}
