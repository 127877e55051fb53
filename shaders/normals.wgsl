// Vertex normals: each thread gathers the cross products of the triangles around one vertex, which weighs them by
// area, and normalises their sum; a vertex whose triangles vanish gets (0, 0, 0). Its twin on the CPU is
// src/deform/kernel/surface.rs.

@group(0) @binding(0) var<storage, read> positions: array<f32>;
// Where the corners of each vertex of the chunk start; one more for the end.
@group(0) @binding(1) var<storage, read> starts: array<u32>;
// Of each triangle around a vertex, the two other corners in their order.
@group(0) @binding(2) var<storage, read> corners: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> normals: array<f32>;

fn position(vertex: u32) -> vec3<f32> {
    let at = 3u * vertex;
    return vec3<f32>(positions[at], positions[at + 1u], positions[at + 2u]);
}

@compute @workgroup_size(64)
fn compute(@builtin(global_invocation_id) thread: vec3<u32>) {
    let i = thread.x;
    if i >= chunk.count {
        return;
    }
    let vertex = chunk.first + i;
    let here = position(vertex);
    var sum = vec3<f32>(0.0);
    let end = starts[i + 1u];
    for (var k = starts[i]; k < end; k++) {
        let corner = corners[k];
        sum += cross(position(corner.x) - here, position(corner.y) - here);
    }
    // Scaled first: the square of a nanometre's area is no f32.
    let size = abs(sum);
    let largest = max(max(size.x, size.y), size.z);
    let scaled = sum * select(0.0, 1.0 / largest, largest > 0.0);
    let normal = scaled * inverseSqrt(max(dot(scaled, scaled), 1.1754944e-38));
    let at = 3u * vertex;
    normals[at] = normal.x;
    normals[at + 1u] = normal.y;
    normals[at + 2u] = normal.z;
}
