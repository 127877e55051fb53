// Basis columns in half precision, two numbers a word; the columns' scales are in the weights.

@group(0) @binding(0) var<storage, read> columns: array<vec2<u32>>;

// The singles of halves that are neither infinite nor NaN, by integers: not every device unpacks halves, and those that
// do may flush the smallest to zero.
fn single(half: vec4<u32>) -> vec4<f32> {
    let magnitude = half & vec4<u32>(0x7fffu);
    let normal = (magnitude << vec4<u32>(13u)) + vec4<u32>(112u << 23u);
    let subnormal = bitcast<vec4<u32>>(vec4<f32>(magnitude) * 0x1p-24f);
    let bits = select(subnormal, normal, magnitude >= vec4<u32>(0x400u));
    return bitcast<vec4<f32>>(bits | ((half & vec4<u32>(0x8000u)) << vec4<u32>(16u)));
}

fn column(quad: u32) -> vec4<f32> {
    let words = columns[quad];
    return single(vec4<u32>(words.x, words.x >> 16u, words.y, words.y >> 16u));
}
