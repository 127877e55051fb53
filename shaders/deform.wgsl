// Superposition: x = X + Σ w u over the columns that have a weight. Each thread computes four consecutive numbers of the
// position array, and reads four columns at a time. Columns lie one after the other, so neighbouring threads read
// neighbouring memory. Its twin on the CPU is src/deform/kernel/superposition.rs.

// Four columns and their weights: coefficient times scale.
struct Terms {
    column: vec4<u32>,
    weight: vec4<f32>,
}

struct Sum {
    // Passes of four columns.
    passes: u32,
    terms: array<Terms>,
}

@group(0) @binding(1) var<storage, read> rest: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sum: Sum;
@group(0) @binding(3) var<storage, read_write> positions: array<vec4<f32>>;

@compute @workgroup_size(64)
fn compute(@builtin(global_invocation_id) thread: vec3<u32>) {
    let i = thread.x;
    if i >= chunk.count {
        return;
    }
    var u = vec4<f32>(0.0);
    for (var pass_index = 0u; pass_index < sum.passes; pass_index++) {
        let terms = sum.terms[pass_index];
        let at = terms.column * chunk.count + i;
        u += terms.weight.x * column(at.x) + terms.weight.y * column(at.y)
            + terms.weight.z * column(at.z) + terms.weight.w * column(at.w);
    }
    positions[chunk.first + i] = rest[chunk.first + i] + u;
}
