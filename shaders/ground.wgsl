// The bodies' shadow on the floor, under a lamp overhead: one sample a pixel of what shaders/ground_map.wgsl made.

@group(1) @binding(1) var hidden: texture_2d<f32>;
@group(1) @binding(2) var hidden_sampler: sampler;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @builtin(vertex_index) index: u32,
) -> Varyings {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0 - 1.0;
    let offset = corner * ground_floor.half_size;
    let position_in_room = ground_floor.center + vec3<f32>(offset.x, 0.0, offset.y);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * vec4<f32>(position_in_room, 1.0);
    out.uv = corner * 0.5 + 0.5;
    return out;
}

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(0.0, 0.0, 0.0, 0.8 * textureSample(hidden, hidden_sampler, in.uv).r);
}
