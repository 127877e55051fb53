// What every pass knows: the eye it draws for, and the lights and sky of the frame. The Rust twins are ViewUniform in
// src/render/view.rs and LightingUniform in src/render/lighting.rs; tests compare the layouts.

struct View {
    clip_from_room: mat4x4<f32>,
    // Direction in the room (not unit) of the sight line through (x, y, 1) in normalised device coordinates.
    direction_from_ndc: mat3x3<f32>,
    eye_in_room: vec3<f32>,
    // +1 where an outward triangle is counter-clockwise on the screen, -1 for a mirrored picture; 0 where the eye sees
    // nothing and its picture stays black.
    front_sign: f32,
    // Width and height of the viewport in pixels.
    size_px: vec2<f32>,
}

struct Lighting {
    to_key: vec3<f32>,
    key: vec3<f32>,
    to_fill: vec3<f32>,
    fill: vec3<f32>,
    sky: vec3<f32>,
    ground: vec3<f32>,
    zenith: vec3<f32>,
    horizon: vec3<f32>,
    nadir: vec3<f32>,
}

@group(0) @binding(0) var<uniform> views: array<View, 2>;
@group(0) @binding(1) var<uniform> lighting: Lighting;

// Which view is drawn. Where both eyes are drawn in one pass, entry points take it from the device instead: the line
// with view_index in their parameters is left out of the source for one eye (src/render/shader.rs).
const eye = 0u;

// sRGB to linear by a cubic, within 0.2 % of the standard's curve (Hable and others); per vertex, so cheap is enough.
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}
