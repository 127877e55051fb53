// An image on a body, projected along the three axes on the surface at rest, and mixed by how the surface faces them.

@group(2) @binding(0) var image: texture_2d<f32>;
@group(2) @binding(1) var image_sampler: sampler;

fn image_color(rest: vec3<f32>, repetitions: vec2<f32>, flat_normal: vec3<f32>) -> vec3<f32> {
    // Upright in the body's y; v runs downwards in an image.
    let along_x = textureSample(image, image_sampler, vec2<f32>(rest.z, -rest.y) * repetitions + 0.5).rgb;
    let along_y = textureSample(image, image_sampler, vec2<f32>(rest.x, rest.z) * repetitions + 0.5).rgb;
    let along_z = textureSample(image, image_sampler, vec2<f32>(rest.x, -rest.y) * repetitions + 0.5).rgb;
    let facing = max(abs(flat_normal) - 0.35, vec3<f32>(0.0)) + 1e-4;
    let weight = facing / (facing.x + facing.y + facing.z);
    return along_x * weight.x + along_y * weight.y + along_z * weight.z;
}
