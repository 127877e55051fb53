// The part of a body that one dispatch covers. Its Rust twin is in src/render/chunk.rs; a test compares the layouts.

struct Chunk {
    // Items of the chunk, one a thread, and the first of them in the body.
    count: u32,
    first: u32,
}

@group(0) @binding(4) var<uniform> chunk: Chunk;
