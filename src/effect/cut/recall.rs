//! Memory of a body that blades cut, as a part of a session's state.
//!
//! In: a body. Out: its steps, and what is being worked out. In: such a memory. Out: the body with the same bits.

use super::body::{CutBody, Seen};
use super::fallen::Fallen;
use super::landing::Motion;
use super::opening::{CutStep, Edges, From, Opening, Renewal};
use super::resistance::Resistance;
use crate::mesh::split::{CutEdges, Split, TetCorner};
use nalgebra::Similarity3;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyMemory {
    steps: Vec<CutStep>,
    opening: Option<Begun>,
    renewal: Option<Renewed>,
    more: Edges,
    strokes: Vec<usize>,
    undone: Vec<Edges>,
    fallen: Vec<Piece>,
    #[serde(default, with = "crate::field::numbers::option")]
    stood: Option<Similarity3<f64>>,
    resistances: Vec<Resistance>,
    seen: Option<Seen>,
}

/// A piece that has fallen off: its lowest corner of a tetrahedron, and its motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Piece {
    corner: TetCorner,
    motion: Motion,
}

/// A step that is being worked out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Begun {
    step: CutStep,
    /// Frames until it is taken.
    left: u32,
}

/// A base that is being worked out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Renewed {
    /// Number of steps that are cut in it.
    at: usize,
    /// Frames until a step may begin from it.
    left: u32,
}

/// A mesh in pieces, and the number of edges that are cut.
struct Mesh {
    split: Arc<Split>,
    edges: usize,
}

impl CutBody {
    pub fn remember(&self) -> BodyMemory {
        let begun = |opening: &Opening| Begun { step: opening.step.clone(), left: opening.left };
        BodyMemory {
            steps: self.steps.clone(),
            opening: self.opening.as_ref().map(begun),
            renewal: self.renewal.as_ref().map(|renewal| Renewed { at: renewal.at, left: renewal.left }),
            more: self.more.clone(),
            strokes: self.strokes.iter().map(|(steps, _)| *steps).collect(),
            undone: self.undone.clone(),
            fallen: self
                .fallen
                .iter()
                .map(|piece| Piece { corner: piece.corner, motion: piece.motion })
                .collect(),
            stood: self.stood,
            resistances: self.resistances.clone(),
            seen: self.seen.clone(),
        }
    }

    /// Goes on from a memory. After an error the body is whole.
    pub fn restore(&mut self, memory: BodyMemory) -> Result<(), String> {
        self.seen.clone_from(&memory.seen);
        self.stood = memory.stood;
        if memory.resistances.len() != self.resistances.len() {
            return Err(format!("body.{}: its cuts take another toughness", self.whole.name));
        }
        self.resistances.clone_from(&memory.resistances);
        if memory == self.remember() {
            return Ok(());
        }
        let gone = self.go_through(memory);
        if gone.is_err() {
            self.close()?;
        }
        self.last = self.state.moved.clone();
        gone
    }

    /// Makes the body whole again.
    fn close(&mut self) -> Result<(), String> {
        let whole = self.whole.state()?;
        whole.base.0.solves.wake();
        self.go_to(whole);
        (self.steps, self.opening, self.renewal) = (Vec::new(), None, None);
        (self.more, self.cut) = (Edges::new(), CutEdges::new());
        (self.strokes, self.undone) = (Vec::new(), Vec::new());
        self.fallen.clear();
        Ok(())
    }

    fn go_through(&mut self, memory: BodyMemory) -> Result<(), String> {
        let BodyMemory { steps, opening, renewal, more, strokes, undone, fallen, .. } = memory;
        let begun =
            opening.iter().map(|begun| begun.step.base).chain(renewal.iter().map(|renewal| renewal.at));
        let wanted = steps.iter().map(|step| step.base).chain(begun).filter(|at| *at <= steps.len());
        let meshes = self.meshes(&steps, wanted.collect())?;
        if steps != self.steps || strokes != self.remember().strokes {
            self.close()?;
            self.go_along(steps, &strokes, &meshes)?;
        }
        self.undone = undone;
        let is_known =
            fallen.iter().map(|piece| piece.corner).eq(self.fallen.iter().map(|piece| piece.corner));
        if !is_known || !fallen.iter().all(|piece| piece.motion.is_finite()) {
            return Err(format!("body.{}: the pieces that have fallen off it are others", self.whole.name));
        }
        self.fallen.iter_mut().zip(fallen).for_each(|(own, piece)| own.motion = piece.motion);
        (self.opening, self.renewal) = (None, None);
        self.cut.clone_from(&self.state.cut);
        let renewed = |body: &CutBody, Renewed { at, left }| {
            let Mesh { split, edges } = meshes.get(&at).ok_or_else(|| body.is_other())?;
            Ok::<_, String>(Renewal::begin(&body.whole, split, [at, *edges], left))
        };
        if let Some(Begun { step: CutStep { edges, base }, left }) = opening {
            self.add_all(&edges)?;
            let from = match base {
                base if base == self.state.base.1 => From::Before,
                base if base == self.steps.len() + 1 => From::Itself(base),
                at => From::Renewed(renewed(self, Renewed { at, left: 0 })?),
            };
            let asked = (edges, self.cut.clone(), Vec::new());
            self.opening = Some(Opening::begin(&self.whole, &self.state, asked, from, left.max(1)));
        }
        self.renewal = renewal.map(|renewal| renewed(self, renewal)).transpose()?;
        self.add_all(&more)?;
        self.more = more;
        Ok(())
    }

    /// The meshes after these numbers of steps.
    fn meshes(&self, steps: &[CutStep], wanted: BTreeSet<usize>) -> Result<BTreeMap<usize, Mesh>, String> {
        let mut found = BTreeMap::from([(0, Mesh { split: Arc::default(), edges: 0 })]);
        let (mut cut, mut before) = (CutEdges::new(), 0);
        for (at, CutStep { edges, base }) in (1..).zip(steps) {
            cut.extend(edges.iter().copied());
            if wanted.contains(&at) {
                let earlier =
                    found.get(if *base == at { &before } else { base }).ok_or_else(|| self.is_other())?;
                let split = self.whole.cuttable.matter.split(&cut, &earlier.split);
                found.insert(at, Mesh { split: Arc::new(split), edges: cut.len() });
            }
            before = *base;
        }
        Ok(found)
    }

    /// Cuts the whole body in these steps, with strokes that begin after so many of them.
    fn go_along(
        &mut self,
        steps: Vec<CutStep>,
        strokes: &[usize],
        meshes: &BTreeMap<usize, Mesh>,
    ) -> Result<(), String> {
        let bases: Vec<usize> = steps.iter().map(|step| step.base).collect();
        // After these steps the body is shown, or comes to be shown again.
        let is_shown = |at: usize| at == bases.len() || strokes.contains(&at);
        let begins = |body: &mut CutBody| {
            let at = body.steps.len();
            let here = strokes.iter().filter(|begin| **begin == at);
            body.strokes.extend(here.map(|begin| (*begin, body.state.clone())));
        };
        begins(self);
        let mut before = Split::default();
        for (at, step) in (1..).zip(steps) {
            self.add_all(&step.edges)?;
            let Mesh { split: earlier, edges } = meshes.get(&step.base).ok_or_else(|| self.is_other())?;
            let split = self.whole.cuttable.matter.split(&self.cut, earlier);
            let mut pieces = Fallen::all(&self.whole.cuttable, (&split, &self.cut), &before);
            self.fallen.append(&mut pieces);
            let is_needed = (at..=bases.len()).any(|later| is_shown(later) && bases[later - 1] == step.base);
            if is_needed && self.state.base.1 != step.base {
                let base = self.whole.cuttable.cut_base(earlier.clone(), *edges)?;
                (self.state.base, self.state.known) = ((base, step.base), Arc::default());
            }
            if is_shown(at) {
                let state = self.whole.cut(&self.state, self.cut.clone(), &[], From::Before)?;
                self.go_to(state);
            } else if is_needed {
                let known = self.whole.cuttable.follow(&self.state.base.0, &self.state.known, &split)?;
                self.state.known = Arc::new(known);
            }
            before = split;
            self.steps.push(step);
            begins(self);
        }
        self.rest_others();
        if self.strokes.len() != strokes.len() {
            return Err(format!("body.{}: its strokes are those of another cut", self.whole.name));
        }
        Ok(())
    }
}
