// The colour of a body that shows no field: that of its vertices. `field.wgsl` stands in its place where it shows one.

// Of a vertex colour, what is interpolated over plain surface.
fn plain_of_vertex(color: vec3<f32>) -> vec3<f32> {
    return linear_from_srgb(color);
}

// Linear colour of what was interpolated.
fn painted(plain: vec3<f32>) -> vec3<f32> {
    return plain;
}
