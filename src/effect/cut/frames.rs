//! Frames in which what is worked out in the background is taken: as many as it should need, the same in a replay.
//!
//! In: sizes of a body and of a cut. Out: numbers of frames at 60 a second, and the gates beyond which a body gets a new base.

/// Frames that a step of a cut takes at least; free nodes of the mesh for which it takes one more, and edges and pressed points times free
/// nodes.
pub const LEAST_FRAMES: u32 = 2;
const NODES_A_FRAME: usize = 2000;
const EDGES_A_FRAME: usize = 36_000;
const POINTS_A_FRAME: usize = 40_000;

/// A new base of n free nodes takes n / this frames times 1 + n / [`TWICE`].
const BASE_NODES_A_FRAME: usize = 240;
const TWICE: usize = 25_000;

/// Copies beyond a base above which another one is worked out beside the steps.
pub const MOST_COPIES: usize = 200;
/// Edges beyond a base above which no step begins from it.
pub const MOST_EDGES: usize = 1000;

/// Frames of a step with so many edges, in a body with so many free nodes that is pressed at so many points.
pub fn of_step(free: usize, edges: usize, pressed: usize) -> u32 {
    let of_points = pressed * free / POINTS_A_FRAME;
    counted(LEAST_FRAMES as usize + free / NODES_A_FRAME + edges * free / EDGES_A_FRAME + of_points)
}

/// Frames of a new base with so many free nodes.
pub fn of_base(free: usize) -> u32 {
    counted(LEAST_FRAMES as usize + free * (TWICE + free) / (TWICE * BASE_NODES_A_FRAME))
}

fn counted(frames: usize) -> u32 {
    u32::try_from(frames).unwrap_or(u32::MAX)
}
