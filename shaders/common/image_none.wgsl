// A body without an image.

fn image_color(rest: vec3<f32>, repetitions: vec2<f32>, flat_normal: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}
