//! Makes the 16-bit columns of a container pack well, and undoes it.
//!
//! In: the bytes of a .green file. Out: as many bytes, in which each number of a column is replaced by its difference from a
//! guess ([`Guesses`]: from the numbers of earlier nodes), so that small numbers are left, which pack well; behind them
//! stands which guesses were used:
//!
//! ```text
//! container | a byte for each tensor of such columns, in the order of their names | their number, u32 | MARK
//! ```

use super::zstd_context;
use nalgebra::{Matrix3, Vector3};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;

const MARK: &[u8; 8] = b"guesses\n";
/// zstd's level at which the guesses are compared.
const TRIAL: i32 = 9;

/// Columns of a tensor, and the surface that they belong to.
struct Columns {
    /// Bytes in the container.
    place: Range<usize>,
    nodes: usize,
    body: String,
}

/// Rest places and triangles of a body.
type SurfaceOf = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// The tensors of 16-bit columns of a container by their names, and the surfaces of its bodies.
fn columns_of(container: &[u8]) -> Result<(Vec<Columns>, BTreeMap<String, SurfaceOf>), String> {
    let tensors = SafeTensors::deserialize(container).map_err(|error| error.to_string())?;
    let tensors: BTreeMap<String, TensorView<'_>> = tensors.tensors().into_iter().collect();
    let mut surfaces = BTreeMap::new();
    for (name, rest) in &tensors {
        let Some(body) = name.strip_suffix("/rest") else { continue };
        let Some(triangles) = tensors.get(&format!("{body}/triangles")) else { continue };
        let of_three = |tensor: &TensorView<'_>| matches!(tensor.shape(), [_, 3]);
        if (rest.dtype(), triangles.dtype()) == (Dtype::F32, Dtype::U32)
            && of_three(rest)
            && of_three(triangles)
        {
            surfaces.insert(
                body.to_owned(),
                (triples(rest.data(), f32::from_le_bytes), triples(triangles.data(), u32::from_le_bytes)),
            );
        }
    }
    let mut columns = Vec::new();
    for (name, tensor) in tensors.iter().filter(|(_, tensor)| tensor.dtype() == Dtype::I16) {
        let &[_, nodes, 3] = tensor.shape() else { continue };
        // The longest: a name may hold a slash.
        let bodies = name.char_indices().rev().filter(|(_, c)| *c == '/').map(|(at, _)| &name[..at]);
        let is_of =
            |body: &&str| surfaces.get(*body).is_some_and(|(rest, _): &SurfaceOf| rest.len() == nodes);
        let Some(body) = { bodies }.find(is_of) else { continue };
        let start = tensor.data().as_ptr() as usize - container.as_ptr() as usize;
        let place = start..start + tensor.data().len();
        columns.extend((nodes > 0).then(|| Columns { place, nodes, body: body.to_owned() }));
    }
    Ok((columns, surfaces))
}

fn triples<T: Copy>(bytes: &[u8], number: impl Fn([u8; 4]) -> T) -> Vec<[T; 3]> {
    let four = |bytes: &[u8]| number([bytes[0], bytes[1], bytes[2], bytes[3]]);
    bytes.chunks_exact(12).map(|of| [four(&of[..4]), four(&of[4..8]), four(&of[8..])]).collect()
}

/// The guesses that were needed, by what stands for them and the body.
#[derive(Default)]
struct KnownGuesses(BTreeMap<(u8, String), Guesses>);

impl KnownGuesses {
    const KINDS: [u8; 2] = [b'p', b'f'];

    fn guesses(&mut self, kind: u8, columns: &Columns, (rest, triangles): &SurfaceOf) -> Option<&Guesses> {
        let key = (kind, columns.body.clone());
        Some(match self.0.entry(key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(vacant) => vacant.insert(match kind {
                b'p' => Guesses::previous(columns.nodes),
                b'f' => Guesses::fitted(rest, triangles)?,
                _ => return None,
            }),
        })
    }
}

/// The filtered form; the bytes as they are where they are no container.
pub fn filtered(container: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut bytes = container.to_vec();
    let Ok((columns, surfaces)) = columns_of(container) else { return Ok(bytes) };
    let mut known = KnownGuesses::default();
    let mut chosen = Vec::new();
    for of in &columns {
        let mut least: Option<(usize, u8, Vec<u8>)> = None;
        for kind in KnownGuesses::KINDS {
            let Some(guesses) = known.guesses(kind, of, &surfaces[&of.body]) else { continue };
            let mut hidden = container[of.place.clone()].to_vec();
            hidden.chunks_exact_mut(6 * of.nodes).for_each(|column| guesses.hide(column));
            let size = zstd_context::compressed(&hidden, TRIAL)?.len();
            if least.as_ref().is_none_or(|(least, ..)| size < *least) {
                least = Some((size, kind, hidden));
            }
        }
        if let Some((_, kind, hidden)) = least {
            bytes[of.place.clone()].copy_from_slice(&hidden);
            chosen.push(kind);
        }
    }
    bytes.extend_from_slice(&chosen);
    bytes.extend_from_slice(&(chosen.len() as u32).to_le_bytes());
    bytes.extend_from_slice(MARK);
    Ok(bytes)
}

/// The container of a filtered form; the error says what is wrong with it. A container alone is one already.
pub fn restored(mut bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    let Some(rest) = bytes.strip_suffix(MARK) else { return Ok(bytes) };
    let damaged = "its list of guesses is damaged";
    let (rest, count) = rest.split_last_chunk::<4>().ok_or(damaged)?;
    let at = rest.len().checked_sub(u32::from_le_bytes(*count) as usize).ok_or(damaged)?;
    let chosen = rest[at..].to_vec();
    bytes.truncate(at);
    let (columns, surfaces) = columns_of(&bytes)?;
    if columns.len() != chosen.len() {
        return Err(damaged.to_owned());
    }
    let mut known = KnownGuesses::default();
    for (of, kind) in columns.iter().zip(chosen) {
        let guesses = known.guesses(kind, of, &surfaces[&of.body]).ok_or(damaged)?;
        bytes[of.place.clone()].chunks_exact_mut(6 * of.nodes).for_each(|column| guesses.show(column));
    }
    Ok(bytes)
}

/// Part of the spread of the fitted nodes that is added to it in every direction: they lie nearly in a plane.
const RIDGE: f64 = 1e-3;
/// Part of the largest squared distance that is added to each one, so that no weight is infinite.
const NEAR: f64 = 1e-3;
/// Most neighbours of a node that are looked at, and most nodes that are fitted: a fan of a million triangles must take neither a
/// million squared steps nor the memory of as many weights.
const MOST: usize = 64;

/// The order of a surface's nodes, and the earlier nodes from which the three 16-bit numbers of each are guessed. Both ways
/// the same sums are rounded in the same order, with nothing but additions, products and quotients, so that a guess is the
/// same on every machine.
pub struct Guesses {
    order: Vec<u32>,
    /// Start of the terms of each node.
    starts: Vec<usize>,
    /// Nodes that came before, and their weights.
    terms: Vec<(u32, f64)>,
}

impl Guesses {
    /// Every node like the one before it: best where the mesh is regular and whole stretches come again.
    pub fn previous(nodes: usize) -> Guesses {
        let order: Vec<u32> = (0..nodes as u32).collect();
        let terms = order.iter().skip(1).map(|&node| (node - 1, 1.0)).collect();
        let starts = (0..=nodes).map(|node| node.saturating_sub(1)).collect();
        Guesses { order, starts, terms }
    }

    /// Guesses from neighbour to neighbour over the surface, each node by the affine field that fits best at the nodes up to two
    /// edges away that came before. `None` where a triangle names a node that is not there.
    pub fn fitted(rest: &[[f32; 3]], triangles: &[[u32; 3]]) -> Option<Guesses> {
        let neighbours = neighbours(rest.len(), triangles)?;
        let mut is_known = vec![false; rest.len()];
        let mut guesses = Guesses { order: Vec::new(), starts: vec![0], terms: Vec::new() };
        let mut found = BTreeMap::new();
        for node in walk(&neighbours) {
            found.clear();
            for &near in neighbours[node as usize].iter().take(MOST) {
                let of_near = neighbours[near as usize].iter().take(MOST);
                for &known in of_near.chain([&near]).filter(|&&known| is_known[known as usize]) {
                    if found.len() < MOST {
                        found.entry(known).or_insert_with(|| place(rest, known));
                    }
                }
            }
            guesses.terms.extend(fit(&place(rest, node), &found));
            guesses.starts.push(guesses.terms.len());
            guesses.order.push(node);
            is_known[node as usize] = true;
        }
        Some(guesses)
    }

    /// The guess for an axis of the node that comes `at`-th.
    fn guess(&self, at: usize, axis: usize, number: impl Fn(usize) -> i16) -> i16 {
        let terms = &self.terms[self.starts[at]..self.starts[at + 1]];
        let sum = terms
            .iter()
            .fold(0.0, |sum, &(node, weight)| sum + weight * f64::from(number(3 * node as usize + axis)));
        sum.round() as i16
    }

    /// Replaces the little-endian numbers of a column by number minus guess, first all low bytes, then all high ones.
    pub fn hide(&self, column: &mut [u8]) {
        let numbers: Vec<i16> =
            column.chunks_exact(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]])).collect();
        let (low, high) = column.split_at_mut(numbers.len());
        for (at, &node) in self.order.iter().enumerate() {
            for axis in 0..3 {
                let number = numbers[3 * node as usize + axis];
                let differs = number.wrapping_sub(self.guess(at, axis, |i| numbers[i]));
                // Small numbers of either sign become small ones.
                let bytes = ((differs << 1) ^ (differs >> 15)).to_le_bytes();
                let place = axis * self.order.len() + at;
                (low[place], high[place]) = (bytes[0], bytes[1]);
            }
        }
    }

    /// Undoes [`Guesses::hide`].
    pub fn show(&self, column: &mut [u8]) {
        let (low, high) = column.split_at(column.len() / 2);
        let mut numbers = vec![0_i16; low.len()];
        for (at, &node) in self.order.iter().enumerate() {
            for axis in 0..3 {
                let place = axis * self.order.len() + at;
                let folded = u16::from_le_bytes([low[place], high[place]]);
                let differs = (folded >> 1) as i16 ^ -((folded & 1) as i16);
                let guess = self.guess(at, axis, |i| numbers[i]);
                numbers[3 * node as usize + axis] = guess.wrapping_add(differs);
            }
        }
        column.chunks_exact_mut(2).zip(numbers).for_each(|(pair, x)| pair.copy_from_slice(&x.to_le_bytes()));
    }
}

fn place(rest: &[[f32; 3]], node: u32) -> Vector3<f64> {
    rest[node as usize].map(f64::from).into()
}

/// Nodes with which each node shares an edge, ascending.
fn neighbours(nodes: usize, triangles: &[[u32; 3]]) -> Option<Vec<Vec<u32>>> {
    let mut neighbours = vec![Vec::new(); nodes];
    for &[a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a), (b, a), (c, b), (a, c)] {
            if to as usize >= nodes {
                return None;
            }
            neighbours.get_mut(from as usize)?.push(to);
        }
    }
    for of_node in &mut neighbours {
        of_node.sort_unstable();
        of_node.dedup();
    }
    Some(neighbours)
}

/// All nodes, piece by piece, each piece from its first node outwards.
fn walk(neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut is_seen = vec![false; neighbours.len()];
    let mut order = Vec::with_capacity(neighbours.len());
    for first in 0..neighbours.len() as u32 {
        let mut at = order.len();
        if !std::mem::replace(&mut is_seen[first as usize], true) {
            order.push(first);
        }
        while let Some(&node) = order.get(at) {
            let new = neighbours[node as usize].iter();
            order.extend(new.filter(|&&next| !std::mem::replace(&mut is_seen[next as usize], true)));
            at += 1;
        }
    }
    order
}

/// The weights by which known numbers give that at `x` of the affine field that fits them best, the nearer the more.
fn fit(x: &Vector3<f64>, known: &BTreeMap<u32, Vector3<f64>>) -> Vec<(u32, f64)> {
    let far = known.values().map(|y| (y - x).norm_squared()).fold(0.0, f64::max);
    let weights: Vec<f64> = known.values().map(|y| 1.0 / ((y - x).norm_squared() + NEAR * far)).collect();
    let whole: f64 = weights.iter().sum();
    let parts = || known.values().zip(weights.iter().map(|weight| weight / whole));
    let centre = parts().fold(Vector3::zeros(), |sum, (y, part)| sum + y * part);
    let spread = parts().fold(Matrix3::zeros(), |sum: Matrix3<f64>, (y, part)| {
        sum + (y - centre) * (y - centre).transpose() * part
    });
    let size = spread.trace();
    let slope = (spread / size + Matrix3::identity() * RIDGE).try_inverse();
    // Of a single node, or of nodes at one place, the mean.
    let slope =
        slope.filter(|_| size > 0.0).map_or(Vector3::zeros(), |inverse| inverse * (x - centre) / size);
    known
        .iter()
        .zip(parts())
        .map(|((&node, _), (y, part))| (node, part * (1.0 + (y - centre).dot(&slope))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A wavy sheet of 12 × 9 nodes, and a smooth column on it.
    fn sheet() -> (Vec<[f32; 3]>, Vec<[u32; 3]>, Vec<i16>) {
        let node = |i: u32, j: u32| 12 * j + i;
        let rest: Vec<[f32; 3]> = (0..108_u32)
            .map(|k| ((k % 12) as f32 + 0.2 * (k as f32).sin(), (k / 12) as f32))
            .map(|(x, y)| [x, y, (0.3 * x).sin()])
            .collect();
        let squares = (0..11).flat_map(|i| (0..8).map(move |j| (i, j)));
        let triangles = squares.flat_map(|(i, j)| {
            [
                [node(i, j), node(i + 1, j), node(i, j + 1)],
                [node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)],
            ]
        });
        let at =
            |[x, y, z]: [f32; 3]| [900.0 * x + 40.0 * y, (0.2 * x * y).cos() * 800.0, 3000.0 - 500.0 * z];
        let column = rest.iter().flat_map(|&x| at(x).map(|value| value as i16)).collect();
        (rest.clone(), triangles.collect(), column)
    }

    #[test]
    fn columns_come_back_and_smooth_ones_leave_little() {
        let (rest, triangles, column) = sheet();
        let bytes: Vec<u8> = column.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut left = Vec::new();
        for guesses in [Guesses::previous(108), Guesses::fitted(&rest, &triangles).unwrap()] {
            let mut hidden = bytes.clone();
            guesses.hide(&mut hidden);
            left.push(hidden[324..].iter().filter(|&&high| high != 0).count());
            guesses.show(&mut hidden);
            assert_eq!(hidden, bytes);
        }
        assert!(left[1] < 80 && left[0] > 200, "{left:?} of 324 numbers are not small");
        assert!(Guesses::fitted(&rest[1..], &triangles).is_none());
    }

    /// An affine field is guessed from three nodes around it on, but for the ridge.
    #[test]
    fn an_affine_field_is_fitted() {
        let (rest, ..) = sheet();
        let known: BTreeMap<u32, _> = [0, 1, 2, 12, 14, 24, 25].map(|node| (node, place(&rest, node))).into();
        let field = |x: &Vector3<f64>| 5.0 + x.dot(&Vector3::new(3.0, -2.0, 0.7));
        let x = place(&rest, 13);
        let guess: f64 = fit(&x, &known).iter().map(|(node, weight)| weight * field(&known[node])).sum();
        assert!((guess - field(&x)).abs() < 1e-2, "{guess} {}", field(&x));
        let alone = fit(&x, &[(7, place(&rest, 7))].into());
        assert_eq!(alone, [(7, 1.0)]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Any numbers on any surface, with triangles that share everything, come back.
        #[test]
        fn any_column_comes_back(
            numbers in prop::collection::vec(any::<i16>(), 36),
            places in prop::collection::vec(prop::array::uniform3(any::<f32>()), 12),
            triangles in prop::collection::vec(prop::array::uniform3(0_u32..12), 0..40),
        ) {
            let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
            let guesses = Guesses::fitted(&places, &triangles).unwrap();
            let mut hidden = bytes.clone();
            guesses.hide(&mut hidden);
            guesses.show(&mut hidden);
            prop_assert_eq!(hidden, bytes);
        }
    }
}
