// A body that is bent beyond its model: hatched, so that its own colours remain visible between the lines. `stripe` grows by
// one from line to line.

fn hatched(color: vec3<f32>, stripe: f32) -> vec3<f32> {
    let pixel = max(fwidth(stripe), 1e-6);
    let to_line = abs(fract(stripe) - 0.5);
    return mix(color, HATCHING, saturate((0.11 - to_line) / pixel + 0.5));
}
