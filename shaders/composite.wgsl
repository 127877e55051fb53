// Two eyes' pictures become one. Its twin on the CPU is `Composite::compose` in src/render/composite.rs.
// The struct's Rust twin is `CompositeUniform` there; a test compares the layouts.

struct Composite {
    // Linear RGB of the result from that of the first and of the second picture.
    from_first: mat3x3<f32>,
    from_second: mat3x3<f32>,
    // Pixel at the tile's top left: in its target, and on its monitor.
    corner: vec2<i32>,
    panel: vec2<i32>,
    eye_size: vec2<i32>,
    // Where the second picture begins in the tile; the first begins at its corner.
    second: vec2<i32>,
    // 1 in the directions, columns and rows, in which the eyes take turns.
    turns: vec2<i32>,
}

@group(0) @binding(0) var<uniform> composite: Composite;
@group(0) @binding(1) var first: texture_2d<f32>;
@group(0) @binding(2) var second: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}

fn covers(pixel: vec2<i32>) -> bool {
    return all(pixel >= vec2<i32>(0)) && all(pixel < composite.eye_size);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(position.xy) - composite.corner;
    let in_second = pixel - composite.second;
    let turn = (pixel + composite.panel) & composite.turns;
    let is_odd = ((turn.x + turn.y) & 1) == 1;
    let take_turns = any(composite.turns != vec2<i32>(0));
    var color = vec3<f32>(0.0);
    if (!(take_turns && is_odd) && covers(pixel)) {
        color += saturate(composite.from_first * textureLoad(first, pixel, 0).rgb);
    }
    if (!(take_turns && !is_odd) && covers(in_second)) {
        color += saturate(composite.from_second * textureLoad(second, in_second, 0).rgb);
    }
    return vec4<f32>(saturate(color), 1.0);
}
