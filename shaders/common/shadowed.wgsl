// How much of the key light and of the sky a point of a body sees, by maps of depth from the lights
// (src/render/shadow.rs). The maps are the same for both eyes and all screens.

const SKY_LIGHTS: u32 = 6u;

struct ShadowLight {
    map_from_room: mat4x4<f32>,
    to_light: vec3<f32>,
    // Side of a pixel of the map, m in the room.
    texel_m: f32,
}

// First the key light, then those of the sky.
@group(1) @binding(0) var<uniform> shadow_lights: array<ShadowLight, 7>;
@group(1) @binding(1) var shadow_maps: texture_depth_2d_array;
@group(1) @binding(2) var shadow_sampler: sampler_comparison;

// The share of a disc of `radius` pixels about a place that the light reaches, from so many samples on a spiral.
fn reached(light: u32, place: vec3<f32>, radius: f32, samples: u32) -> f32 {
    let pixel = 1.0 / f32(textureDimensions(shadow_maps).x);
    var sum = 0.0;
    for (var k = 0u; k < samples; k++) {
        let r = radius * sqrt((f32(k) + 0.5) / f32(samples));
        let turn = 2.39996323 * f32(k);
        let at = place.xy + vec2<f32>(cos(turn), sin(turn)) * (r * pixel);
        sum += textureSampleCompareLevel(shadow_maps, shadow_sampler, at, light, place.z);
    }
    return sum / f32(samples);
}

// Where a point lies in a map: u, v, depth. The point is moved off its own surface by some pixels, the more the flatter the
// light falls on it.
fn place_in_map(light: u32, position: vec3<f32>, normal: vec3<f32>, pixels: f32) -> vec3<f32> {
    let it = shadow_lights[light];
    let cosine = saturate(dot(normal, it.to_light));
    let off = pixels * it.texel_m * (0.3 + sqrt(1.0 - cosine * cosine));
    return (it.map_from_room * vec4<f32>(position + normal * off, 1.0)).xyz;
}

fn seen_from(position: vec3<f32>, normal: vec3<f32>) -> Seen {
    let key = reached(0u, place_in_map(0u, position, normal, 4.0), 5.0, 16u);
    // Hidden sky, weighted as Lambert's law weighs it.
    var whole = 0.05;
    var open = 0.05;
    for (var light = 1u; light <= SKY_LIGHTS; light++) {
        let weight = saturate(dot(normal, shadow_lights[light].to_light));
        whole += weight;
        if weight > 0.0 {
            open += weight * reached(light, place_in_map(light, position, normal, 12.0), 10.0, 8u);
        }
    }
    return Seen(key, open / whole);
}
