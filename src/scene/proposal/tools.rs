//! Tools in the hand, for effects of a body that touch or cut it.
//!
//! In: a proposal, what its effects need, and the size of the workspace. Out: the proposal with a blade, a probe or both in its scene.

use super::Proposal;
use crate::scene::{Tool, ToolShape};

/// Radius and length of the probe, and length and width of the blade, in parts of the workspace's diameter.
const PROBE: [f64; 2] = [0.04, 0.4];
const BLADE: [f64; 2] = [0.5, 0.08];

impl Proposal {
    /// Adds a blade if the body is cut and a probe if it is touched, each on a stylus of its own, of a size that suits a body
    /// which is fitted to a workspace of this diameter, m.
    pub fn add_tools(&mut self, is_cut: bool, is_touched: bool, workspace_m: f64) {
        let size = |part: f64| 1e-3 * (1e3 * part * workspace_m).round().max(1.0);
        let ([radius, rod], [length, width]) = (PROBE.map(size), BLADE.map(size));
        let (probe, blade) = (ToolShape::Capsule { radius, length: rod }, ToolShape::Blade { length, width });
        let tools = [(is_cut, "scalpel", blade, "cuts"), (is_touched, "probe", probe, "presses")];
        let asked = tools.into_iter().filter(|(is_asked, ..)| *is_asked);
        for (stylus, (_, name, shape, does)) in (1..).zip(asked) {
            let comment = "the hand that carries it; the mouse is stylus 1";
            self.comments.insert(format!("tool.{name}.stylus"), comment.to_owned());
            self.comments
                .insert(format!("tool.{name}.shape"), "m; others: `greenstage manual keys`".to_owned());
            self.reasons.push(format!("tool: {name}, which {does}, on stylus {stylus}"));
            self.scene.tool.insert(name.to_owned(), Tool { stylus: Some(stylus), ..Tool::new(shape) });
        }
    }
}
