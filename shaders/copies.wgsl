// Vertices that are drawn twice, on sharp edges: each thread copies the position of one node. Its twin on the CPU is in
// src/base/creases.rs.

// Of each copy of the chunk its node; the two other bindings hold the same.
@group(0) @binding(0) var<storage, read> nodes: array<u32>;
@group(0) @binding(3) var<storage, read_write> positions: array<f32>;

@compute @workgroup_size(64)
fn compute(@builtin(global_invocation_id) thread: vec3<u32>) {
    let i = thread.x;
    if i >= chunk.count {
        return;
    }
    let node = 3u * nodes[i];
    let copy = 3u * (chunk.first + i);
    positions[copy] = positions[node];
    positions[copy + 1u] = positions[node + 1u];
    positions[copy + 2u] = positions[node + 2u];
}
