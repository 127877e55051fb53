//! The lowest modes of vibration, A φ = ω² M φ, by a block Lanczos iteration with A⁻¹M.
//!
//! In: A and M at the free nodes, and a way to solve with A, such as its factor. Out: ω² in ascending order, and mode shapes with
//! φᵢᵀ M φⱼ = δᵢⱼ. Each step solves for one block of columns; every block is orthogonalised twice against all before it in the
//! inner product of M (B. Parlett, The Symmetric Eigenvalue Problem, SIAM 1998, sections 13.10 and 15.11). Modes of equal
//! frequency are found up to as many as a block has columns. At the end inverse iteration with Rayleigh and Ritz's procedure
//! makes the residuals small in the norm of forces, in which A would otherwise multiply what is left of the stiffest modes.

use crate::base::random::Random;
use crate::fem::dense_fields::{add, beside, combined, products, rows};
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::DMatrix;

/// Columns of a block.
const BLOCK: usize = 4;
/// Ritz vectors beside those that are asked for, which go through the last iterations with them.
const GUARDS: usize = 4;
/// A Ritz value is found when what the next block adds to it is below this part of it.
const FOUND: f64 = 1e-10;
/// What is left of a column after it was made orthogonal counts as nothing below this part of it.
const DEPENDENT: f64 = 1e-10;
/// The most rounds of inverse iteration.
const ROUNDS: usize = 6;
/// Largest residual of a mode.
pub const MODE_RESIDUAL: f64 = 1e-8;
/// Part of its terms below which a sum is rounding and little else: a slender body of stiff material has modes whose forces are so small.
const CANCELLED: f64 = 1e-7;

/// The lowest modes at the free nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// ω², (rad/s)², ascending.
    pub squares: Vec<f64>,
    /// φ, a column for each, 1/√kg.
    pub shapes: NodeFields,
    /// ‖A φ - ω² M φ‖ of each over ‖A φ‖, or over 1e-7 ‖|A| |φ|‖ where that is more.
    pub residuals: Vec<f64>,
}

impl Modes {
    /// The first mode that is not one, with its residual.
    pub fn worst(&self) -> Option<(usize, f64)> {
        // Written so that a NaN is found too.
        let is_found = |residual: f64| residual <= MODE_RESIDUAL;
        self.residuals.iter().copied().enumerate().find(|(_, residual)| !is_found(*residual))
    }
}

/// The `count` lowest modes, or all there are. `solve` returns A⁻¹ b.
pub fn lowest_modes<E>(
    a: &StiffnessMatrix,
    m: &StiffnessMatrix,
    count: usize,
    solve: &dyn Fn(&NodeFields) -> Result<NodeFields, E>,
) -> Result<Modes, E> {
    let count = count.min(3 * a.nodes());
    if count == 0 {
        let shapes = NodeFields::zeros(a.nodes(), 0);
        return Ok(Modes { squares: Vec::new(), shapes, residuals: Vec::new() });
    }
    let mut basis = Basis::new(m);
    let mut random = Random::default();
    let most = (4 * count + 10 * BLOCK).min(3 * a.nodes());
    while basis.columns() < most {
        if !basis.extend(&mut random) {
            break;
        }
        let answer = solve(basis.last_by_mass())?;
        basis.take(answer);
        if basis.found() >= count {
            break;
        }
    }
    let mut shapes = basis.ritz_vectors(count + GUARDS);
    let mut modes = ritz(a, m, &shapes, count);
    for _ in 0..ROUNDS {
        shapes = solve(&multiplied(m, &shapes))?;
        let refined = ritz(a, m, &shapes, count + GUARDS);
        shapes = refined.shapes.clone();
        modes = first(refined, count);
        if modes.worst().is_none() {
            break;
        }
    }
    Ok(modes)
}

/// M-orthonormal blocks Q, and T = Qᵀ M A⁻¹ M Q of those whose A⁻¹ M Q is known.
struct Basis<'a> {
    m: &'a StiffnessMatrix,
    blocks: Vec<NodeFields>,
    /// M Q of each block.
    by_mass: Vec<NodeFields>,
    t: DMatrix<f64>,
    /// What A⁻¹ M made of the last block, orthogonal to all blocks, and its part in each column of the last block.
    rest: Option<NodeFields>,
    left: Vec<f64>,
}

impl<'a> Basis<'a> {
    fn new(m: &'a StiffnessMatrix) -> Basis<'a> {
        let (blocks, by_mass, t) = (Vec::new(), Vec::new(), DMatrix::zeros(0, 0));
        Basis { m, blocks, by_mass, t, rest: None, left: Vec::new() }
    }

    fn columns(&self) -> usize {
        self.blocks.iter().map(|block| block.columns).sum()
    }

    fn last_by_mass(&self) -> &NodeFields {
        &self.by_mass[self.by_mass.len() - 1]
    }

    /// Adds the next block: what is left of the last answer, or random fields where nothing is. False if there is no further one.
    fn extend(&mut self, random: &mut Random) -> bool {
        let rest = self.rest.take().map(|rest| self.new_block(&rest));
        let block = rest.filter(|block| block.columns > 0).unwrap_or_else(|| {
            let mut fields = NodeFields::zeros(self.m.nodes(), BLOCK);
            fields.data.iter_mut().for_each(|value| *value = random.draw());
            self.orthogonalise(&mut fields);
            self.new_block(&fields)
        });
        if block.columns == 0 {
            return false;
        }
        self.by_mass.push(multiplied(self.m, &block));
        self.blocks.push(block);
        true
    }

    /// The fields, which are orthogonal to all blocks, as a block.
    fn new_block(&self, fields: &NodeFields) -> NodeFields {
        let mut block = orthonormal(self.m, fields);
        // Where little was left of a column, what lies in other blocks has grown with it.
        self.orthogonalise(&mut block);
        orthonormal(self.m, &block)
    }

    /// Takes A⁻¹ M Q of the last block.
    fn take(&mut self, mut answer: NodeFields) {
        let (before, columns) = (self.t.nrows(), answer.columns);
        let sizes = mass_norms(self.m, &answer);
        let shares = self.orthogonalise(&mut answer);
        self.t.resize_mut(before + columns, before + columns, 0.0);
        for column in 0..columns {
            for row in 0..before + columns {
                let share = shares[(row, column)];
                self.t[(row, before + column)] = share;
                self.t[(before + column, row)] = share;
            }
        }
        self.left = mass_norms(self.m, &answer);
        let is_whole = |(left, size): (&f64, &f64)| *left > DEPENDENT * size;
        let some = self.left.iter().zip(&sizes).any(is_whole);
        self.rest = Some(answer).filter(|_| some);
    }

    /// Takes out of the fields what lies in all blocks, and returns it: Qᵀ M of the fields.
    fn orthogonalise(&self, fields: &mut NodeFields) -> DMatrix<f64> {
        let mut shares = DMatrix::zeros(self.columns(), fields.columns);
        // Twice, for the digits that cancel.
        for _ in 0..2 {
            let mut start = 0;
            for (block, by_mass) in self.blocks.iter().zip(&self.by_mass) {
                let share = rows(by_mass) * rows(fields).transpose();
                add(fields, -1.0, &combined(block, &share));
                let mut own = shares.rows_mut(start, block.columns);
                own += share;
                start += block.columns;
            }
        }
        shares
    }

    /// Number of the largest Ritz values in a row that are found.
    fn found(&self) -> usize {
        let (values, vectors) = self.ritz();
        let last = self.blocks.last().map_or(0, |block| block.columns);
        let is_found = |k: &usize| {
            let tail = vectors.view((vectors.nrows() - last, *k), (last, 1));
            let added: f64 = tail.iter().zip(&self.left).map(|(y, left)| (y * left).abs()).sum();
            added <= FOUND * values[*k]
        };
        (0..values.len()).take_while(is_found).count()
    }

    /// Eigenvalues of T, the largest first, and its eigenvectors.
    fn ritz(&self) -> (Vec<f64>, DMatrix<f64>) {
        let eigen = ((&self.t + self.t.transpose()) * 0.5).symmetric_eigen();
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let values = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        (values, eigen.eigenvectors.select_columns(&order))
    }

    fn ritz_vectors(&self, count: usize) -> NodeFields {
        let (_, vectors) = self.ritz();
        let known = vectors.nrows();
        let all: Vec<&NodeFields> = self.blocks.iter().collect();
        let count = count.min(known);
        // A block whose answer never came has no rows in T.
        let by =
            DMatrix::from_fn(
                self.columns(),
                count,
                |row, column| {
                    if row < known { vectors[(row, column)] } else { 0.0 }
                },
            );
        combined(&beside(&all), &by)
    }
}

/// The fields made M-orthonormal; those that depend on others are left out.
fn orthonormal(m: &StiffnessMatrix, fields: &NodeFields) -> NodeFields {
    let mut fields = fields.clone();
    for round in 0..2 {
        if fields.columns == 0 {
            break;
        }
        let sizes = mass_norms(m, &fields);
        let scale = |column: usize| if sizes[column] > 0.0 { 1.0 / sizes[column] } else { 0.0 };
        let gram = products(m, &fields, &fields);
        let gram = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| {
            0.5 * (gram[(i, j)] + gram[(j, i)]) * scale(i) * scale(j)
        });
        let eigen = gram.symmetric_eigen();
        let least = if round == 0 { DEPENDENT } else { 0.5 };
        let kept: Vec<usize> =
            (0..eigen.eigenvalues.len()).filter(|&k| eigen.eigenvalues[k] > least).collect();
        let by = DMatrix::from_fn(fields.columns, kept.len(), |row, column| {
            let k = kept[column];
            scale(row) * eigen.eigenvectors[(row, k)] / eigen.eigenvalues[k].sqrt()
        });
        fields = combined(&fields, &by);
    }
    fields
}

fn multiplied(matrix: &StiffnessMatrix, fields: &NodeFields) -> NodeFields {
    let mut product = NodeFields::zeros(fields.nodes, fields.columns);
    matrix.multiply(fields, &mut product);
    product
}

fn mass_norms(m: &StiffnessMatrix, fields: &NodeFields) -> Vec<f64> {
    fields.dots(&multiplied(m, fields)).into_iter().map(|square| square.max(0.0).sqrt()).collect()
}

/// The `count` lowest Ritz pairs of A and M in the span of the fields.
fn ritz(a: &StiffnessMatrix, m: &StiffnessMatrix, fields: &NodeFields, count: usize) -> Modes {
    let fields = orthonormal(m, fields);
    let stiffness = products(a, &fields, &fields);
    let eigen = ((&stiffness + stiffness.transpose()) * 0.5).symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    order.truncate(count);
    let squares: Vec<f64> = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
    let mut shapes = combined(&fields, &eigen.eigenvectors.select_columns(&order));
    upright(&mut shapes);
    let (forces, mut off) = (multiplied(a, &shapes), multiplied(m, &shapes));
    for row in 0..3 * off.nodes {
        let force = forces.row(row);
        off.row_mut(row).iter_mut().zip(force).zip(&squares).for_each(|((off, f), w)| *off = f - w * *off);
    }
    let (off, mut scales) = (off.norms(), forces.norms());
    if off.iter().zip(&scales).any(|(off, scale)| *off > MODE_RESIDUAL * scale) {
        let mut sizes = shapes.clone();
        sizes.data.iter_mut().for_each(|value| *value = value.abs());
        let terms = multiplied(&a.magnitudes(), &sizes).norms();
        scales.iter_mut().zip(terms).for_each(|(scale, terms)| *scale = scale.max(CANCELLED * terms));
    }
    let residuals = off.iter().zip(scales).map(|(off, scale)| off / scale).collect();
    Modes { squares, shapes, residuals }
}

/// Gives each shape the sign with which its largest displacement is positive.
fn upright(shapes: &mut NodeFields) {
    for column in 0..shapes.columns {
        let values = (0..3 * shapes.nodes).map(|row| shapes.row(row)[column]);
        let largest = values.fold(0.0_f64, |most, value| if value.abs() > most.abs() { value } else { most });
        if largest < 0.0 {
            (0..3 * shapes.nodes).for_each(|row| shapes.row_mut(row)[column] *= -1.0);
        }
    }
}

/// The first modes alone.
fn first(modes: Modes, count: usize) -> Modes {
    let Modes { mut squares, shapes, mut residuals } = modes;
    let count = count.min(squares.len());
    squares.truncate(count);
    residuals.truncate(count);
    let data = (0..3 * shapes.nodes).flat_map(|row| shapes.row(row)[..count].to_vec()).collect();
    Modes { squares, shapes: NodeFields { nodes: shapes.nodes, columns: count, data }, residuals }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, Partition, TET4, consistent_mass};
    use crate::mesh::{Block, block};

    /// A and M of a block held at one end.
    fn held(size: [f64; 3], cells: [u32; 3]) -> [StiffnessMatrix; 2] {
        let mesh = block(&Block { size, cells }).unwrap();
        let lame = vec![Lame::from_young_poisson(3.0, 0.3); mesh.tets.len()];
        let k = TET4.assemble(&mesh, &lame).unwrap();
        let m = consistent_mass(&mesh, &vec![2.0; mesh.tets.len()]);
        let partition = Partition::new(mesh.nodes.len(), mesh.groups["xmin"].iter().copied());
        [k, m].map(|matrix| matrix.restrict(&partition.free))
    }

    fn dense(matrix: &StiffnessMatrix) -> DMatrix<f64> {
        let unit = NodeFields::unit(matrix.nodes());
        rows(&multiplied(matrix, &unit)).into_owned()
    }

    /// All eigenvalues by the dense way: with M = L Lᵀ those of L⁻¹ A L⁻ᵀ.
    fn dense_squares(a: &DMatrix<f64>, m: &DMatrix<f64>) -> Vec<f64> {
        let lower = m.clone().cholesky().unwrap().l().try_inverse().unwrap();
        let mut squares: Vec<f64> =
            (&lower * a * lower.transpose()).symmetric_eigenvalues().iter().copied().collect();
        squares.sort_by(f64::total_cmp);
        squares
    }

    fn found(matrices: &[StiffnessMatrix; 2], count: usize) -> Modes {
        let [a, m] = matrices;
        let inverse = dense(a).try_inverse().unwrap();
        let solve = |b: &NodeFields| -> Result<NodeFields, ()> {
            let x = &inverse * rows(b).transpose();
            let data =
                (0..x.nrows()).flat_map(|row| x.row(row).iter().copied().collect::<Vec<_>>()).collect();
            Ok(NodeFields { nodes: b.nodes, columns: b.columns, data })
        };
        lowest_modes(a, m, count, &solve).unwrap()
    }

    /// A square bar has its bending modes in pairs.
    #[test]
    fn modes_are_those_of_the_dense_eigenproblem_pairs_too() {
        for (size, cells) in [([3.0, 1.0, 1.0], [6, 2, 2]), ([1.0, 0.7, 0.4], [3, 2, 2])] {
            let matrices = held(size, cells);
            let [a, m] = matrices.each_ref().map(dense);
            let exact = dense_squares(&a, &m);
            let modes = found(&matrices, 12);
            assert_eq!(modes.worst(), None, "{:?}", modes.residuals);
            for (found, exact) in modes.squares.iter().zip(&exact) {
                assert!((found / exact - 1.0).abs() < 1e-10, "{found} {exact}");
            }
            let phi = rows(&modes.shapes).transpose();
            let unit = phi.transpose() * &m * &phi - DMatrix::identity(12, 12);
            assert!(unit.amax() < 1e-12, "{}", unit.amax());
        }
    }

    #[test]
    fn a_body_with_few_unknowns_has_no_more_modes() {
        let matrices = held([1.0; 3], [1, 1, 1]);
        let [a, m] = matrices.each_ref().map(dense);
        let (exact, modes) = (dense_squares(&a, &m), found(&matrices, 40));
        assert_eq!(modes.squares.len(), exact.len());
        assert!(modes.squares.iter().zip(&exact).all(|(found, exact)| (found / exact - 1.0).abs() < 1e-9));
        assert_eq!(modes.worst(), None, "{:?}", modes.residuals);
    }
}
