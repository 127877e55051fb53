//! Makes the 16-bit columns of a container pack well, and undoes it.
//!
//! In: the bytes of a .green file. Out: as many bytes in which the columns stand as what differs from guesses
//! ([`super::guess`]), and behind them which guesses:
//!
//! ```text
//! container | a byte for each tensor of such columns, in the order of their names | their number, u32 | MARK
//! ```

use super::guess::Guesses;
use super::zstd_context;
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
struct Known(BTreeMap<(u8, String), Guesses>);

impl Known {
    const KINDS: [u8; 2] = [b'p', b'f'];

    fn of(&mut self, kind: u8, columns: &Columns, (rest, triangles): &SurfaceOf) -> Option<&Guesses> {
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
    let mut known = Known::default();
    let mut chosen = Vec::new();
    for of in &columns {
        let mut least: Option<(usize, u8, Vec<u8>)> = None;
        for kind in Known::KINDS {
            let Some(guesses) = known.of(kind, of, &surfaces[&of.body]) else { continue };
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
    let mut known = Known::default();
    for (of, kind) in columns.iter().zip(chosen) {
        let guesses = known.of(kind, of, &surfaces[&of.body]).ok_or(damaged)?;
        bytes[of.place.clone()].chunks_exact_mut(6 * of.nodes).for_each(|column| guesses.show(column));
    }
    Ok(bytes)
}
