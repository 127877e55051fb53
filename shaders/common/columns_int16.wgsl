// Basis columns as 16-bit integers, two a word; the columns' scales are in the weights.

@group(0) @binding(0) var<storage, read> columns: array<vec2<u32>>;

fn column(quad: u32) -> vec4<f32> {
    let words = bitcast<vec2<i32>>(columns[quad]);
    // Shifts of signed integers carry the sign.
    return vec4<f32>(vec4<i32>(words.x << 16u, words.x, words.y << 16u, words.y) >> vec4<u32>(16u));
}
