// The colour of a body that shows no field: that of its vertices. `field.wgsl` stands in its place where it shows one.

// Of a vertex colour, what is interpolated over plain surface.
fn plain_of_vertex(color: vec3<f32>) -> vec3<f32> {
    return linear_from_srgb(color);
}

// Linear colour of what was interpolated.
fn painted(plain: vec3<f32>) -> vec3<f32> {
    return plain;
}

// Linear colour of the hatching of a body that is bent beyond its model.
const HATCHING = vec3<f32>(0.42, 0.035, 0.05);

// What an eye sees of a colour: it is lit. The inside of a wall is the same material with less of the room to see.
fn seen_color(albedo: vec3<f32>, position: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>, outside: f32) -> vec3<f32> {
    return tone(shade(albedo, normal, to_eye, seen_from(position, normal)) * (0.75 + 0.25 * outside));
}
