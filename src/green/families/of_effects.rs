//! Columns of effects: displacements of the surface in an effect's section of the .green file.
//!
//! In: fields over all nodes that an effect has found, such as modes. Out: `EFFECT/basis` (columns × nodes × 3) as the scene
//! stores columns, and `EFFECT/scale` where they are stored scaled; and the groups again, which stand behind those of all
//! families, in the order of the effects' names.

use super::super::bytes::Tensor;
use super::super::file::GreenFile;
use super::super::solution::Precomputed;
use super::columns::{self, Names};
use crate::base::columns::ColumnGroup;
use std::ops::Range;

const BASIS: &str = "basis";
const SCALE: &str = "scale";

fn names(effect: &str) -> Names {
    Names { basis: format!("{effect}/{BASIS}"), scale: format!("{effect}/{SCALE}") }
}

/// The tensors of an effect's section for `count` columns, `value(row, column)` being the displacement of unknown
/// `row` = 3·node + axis. A column must be zero at the nodes of every control element, which are where their poses put them.
pub fn columns_of_effect(
    body: &Precomputed,
    count: usize,
    value: &dyn Fn(usize, usize) -> f64,
) -> Vec<(String, Tensor)> {
    let names = Names { basis: BASIS.to_owned(), scale: SCALE.to_owned() };
    let surface_nodes = body.solution.surface.nodes.len();
    columns::write(body.storage, surface_nodes, names, columns::stored(body, count, value))
}

/// Whether a tensor of an effect's section belongs to its columns, which hold for the stiffness matrix that they were found with.
pub fn is_column(tensor: &str) -> bool {
    matches!(tensor.rsplit('/').next(), Some(BASIS | SCALE))
}

impl GreenFile {
    /// Columns of an effect of a body; 0 of one without.
    fn columns_in_section(&self, body: &str, effect: &str) -> usize {
        let nodes = self.meta.bodies.get(body).map_or(0, |meta| meta.surface_nodes);
        self.count(&format!("{body}/{effect}/{BASIS}")).checked_div(3 * nodes).unwrap_or(0)
    }

    /// The effects of a body that have columns, and how many each has.
    pub(crate) fn effects_with_columns(&self, body: &str) -> Vec<(&str, usize)> {
        let sections = self.meta.bodies.get(body).into_iter().flat_map(|meta| meta.requirements.sections());
        let counted = sections.map(|effect| (effect, self.columns_in_section(body, effect)));
        counted.filter(|(_, count)| *count > 0).collect()
    }

    /// The columns of effects.
    pub(super) fn groups_of_effects(&self, body: &str) -> Vec<ColumnGroup<'_>> {
        let effects = self.effects_with_columns(body);
        effects.into_iter().map(|(effect, _)| columns::group(self, body, &names(effect))).collect()
    }

    /// Whether the columns of a body's effects are usable numbers.
    pub(crate) fn check_columns_of_effects(&self, body: &str) -> Result<(), String> {
        let check = |(effect, count)| columns::check(self, body, &names(effect), count);
        self.effects_with_columns(body).into_iter().try_for_each(check)
    }

    /// Range of an effect's coefficients among those of all effects of the body.
    pub fn range_of_effect(&self, body: &str, effect: &str) -> Range<usize> {
        let mut start = 0;
        for (name, count) in self.effects_with_columns(body) {
            if name == effect {
                return start..start + count;
            }
            start += count;
        }
        start..start
    }

    /// Columns of all effects of a body.
    pub fn columns_of_effects(&self, body: &str) -> usize {
        self.effects_with_columns(body).iter().map(|(_, count)| count).sum()
    }
}
