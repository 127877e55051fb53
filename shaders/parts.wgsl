// Several rigid parts: each thread moves one vertex y, deformed already, to x = Σ w (R y + t) over the parts that move it.
// Its Rust twin is in src/deform/kernel/parts.rs.

struct Share {
    part: u32,
    weight: f32,
}

// One row [R | t] an axis.
struct Motion {
    rows: array<vec4<f32>, 3>,
}

@group(0) @binding(0) var<storage, read> motions: array<Motion>;
// Where the shares of each vertex of the chunk start; one more for the end.
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> shares: array<Share>;
@group(0) @binding(3) var<storage, read_write> positions: array<f32>;

@compute @workgroup_size(64)
fn compute(@builtin(global_invocation_id) thread: vec3<u32>) {
    let i = thread.x;
    if i >= chunk.count {
        return;
    }
    let at = 3u * (chunk.first + i);
    let place = vec4<f32>(positions[at], positions[at + 1u], positions[at + 2u], 1.0);
    var sum = vec3<f32>(0.0);
    let end = starts[i + 1u];
    for (var k = starts[i]; k < end; k++) {
        let share = shares[k];
        let motion = motions[share.part];
        sum += share.weight
            * vec3<f32>(dot(motion.rows[0], place), dot(motion.rows[1], place), dot(motion.rows[2], place));
    }
    positions[at] = sum.x;
    positions[at + 1u] = sum.y;
    positions[at + 2u] = sum.z;
}
