//! Frames in which what is worked out in the background is taken: as many as it should need, the same in a replay.
//!
//! In: sizes of a body and of a cut. Out: numbers of frames at 60 a second, and the gates beyond which a body gets a new base.

/// Frames that a step of a cut takes at least; free nodes of the mesh for which it takes one more, and edges times free nodes.
pub const LEAST_FRAMES: u32 = 2;
const NODES_A_FRAME: usize = 2000;
const EDGES_A_FRAME: usize = 60_000;
/// The most frames: where a step takes longer, the frame in which it is taken waits.
const MOST_FRAMES: usize = 20;

/// Copies beyond a base above which another one is worked out beside the frames.
pub const MOST_COPIES: usize = 200;
/// Edges beyond a base above which no step begins from it.
pub const MOST_EDGES: usize = 1000;
/// A new base of n free nodes takes n / these frames times 1 + n / these nodes.
const OF_BASE_A_FRAME: usize = 500;
const OF_BASE_TWICE: usize = 10_000;

/// Frames of a step with so many edges in a body with so many free nodes.
pub fn of_step(free: usize, edges: usize) -> u32 {
    let frames = LEAST_FRAMES as usize + free / NODES_A_FRAME + edges * free / EDGES_A_FRAME;
    frames.min(MOST_FRAMES) as u32
}

/// Frames of a new base with so many free nodes.
pub fn of_base(free: usize) -> u32 {
    let frames = LEAST_FRAMES as usize + free / OF_BASE_A_FRAME * (OF_BASE_TWICE + free) / OF_BASE_TWICE;
    u32::try_from(frames).unwrap_or(u32::MAX)
}
