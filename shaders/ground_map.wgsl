// How much of a round lamp overhead the bodies hide from each place of the floor.
//
// The map of heights tells the underside of the bodies as the floor sees it. A horizontal piece of area dA at height h and
// distance r hides h² dA / (π (h² + r²)²) of Lambert's sky, so that a ring from r to R hides R²/(h² + R²) - r²/(h² + r²). The
// lamp is the part of the sky within asin √LAMP of the zenith: narrower than the sky, for a shadow that is seen. In closed
// form, a disc of radius a at height h hides min(a²/(h² + a²), LAMP) / LAMP from the place below its middle.

@group(1) @binding(1) var heights: texture_depth_2d;

const LAMP: f32 = 0.3;
const RINGS: u32 = 12u;
const TURNS: u32 = 16u;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle over the whole map.
    return vec4<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn hidden_within(r: f32, h: f32) -> f32 {
    return min(r * r / (h * h + r * r + 1e-12), LAMP) / LAMP;
}

@fragment
fn fragment(@builtin(position) place: vec4<f32>) -> @location(0) vec4<f32> {
    let size = vec2<f32>(textureDimensions(heights));
    let pixels_per_m = size / (2.0 * ground_floor.half_size);
    var hidden = 0.0;
    for (var ring = 0u; ring < RINGS; ring++) {
        let ends = vec2<f32>(f32(ring), f32(ring + 1u)) / f32(RINGS);
        let inner = ground_floor.reach_m * ends.x * ends.x;
        let outer = ground_floor.reach_m * ends.y * ends.y;
        let middle = 0.5 * (inner + outer);
        for (var k = 0u; k < TURNS; k++) {
            let turn = 6.2831853 * (f32(k) + 0.5 * f32(ring & 1u)) / f32(TURNS);
            let at = vec2<i32>(floor(place.xy + vec2<f32>(cos(turn), sin(turn)) * middle * pixels_per_m));
            if any(at < vec2<i32>(0)) || any(at >= vec2<i32>(size)) {
                continue;
            }
            let depth = textureLoad(heights, at, 0);
            if depth < 1.0 {
                let h = depth * ground_floor.height_m;
                hidden += hidden_within(outer, h) - hidden_within(inner, h);
            }
        }
    }
    return vec4<f32>(hidden / f32(TURNS));
}
