// A frame without shadows: every light is seen from everywhere.

fn seen_from(position: vec3<f32>, normal: vec3<f32>) -> Seen {
    return Seen(1.0, 1.0);
}
