// A body within its model's range.

fn hatched(color: vec3<f32>, stripe: f32) -> vec3<f32> {
    return color;
}
