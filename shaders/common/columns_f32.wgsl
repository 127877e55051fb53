// Basis columns in single precision: four numbers of one column in each element.

@group(0) @binding(0) var<storage, read> columns: array<vec4<f32>>;

fn column(quad: u32) -> vec4<f32> {
    return columns[quad];
}
