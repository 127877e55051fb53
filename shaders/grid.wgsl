// The floor: anti-aliased lines on a horizontal rectangle, every fifth one brighter, fading towards its rim.
// Lines never get thinner than a pixel; they get fainter instead, and where cells shrink to pixels the lines melt
// into their mean (B. Golus, "The best darn grid shader (yet)", 2023).

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    // Cells from the centre, and the same as a share of the half size.
    @location(0) cell: vec2<f32>,
    @location(1) share: vec2<f32>,
    // In cells.
    @location(2) line_width: f32,
    @location(3) color: vec3<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @builtin(vertex_index) index: u32,
    @location(0) center: vec3<f32>,
    @location(1) half_size: vec2<f32>,
    @location(2) spacing: f32,
    @location(3) line_width: f32,
    @location(4) color: vec3<f32>,
) -> Varyings {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0 - 1.0;
    let offset = corner * half_size;
    let position_in_room = center + vec3<f32>(offset.x, 0.0, offset.y);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * vec4<f32>(position_in_room, 1.0);
    out.cell = offset / spacing;
    out.share = corner;
    out.line_width = line_width;
    out.color = color;
    return out;
}

// The share of a pixel that the lines of a grid cover; `width` and `pixel` in cells.
fn coverage(cell: vec2<f32>, pixel: vec2<f32>, width: f32) -> f32 {
    let drawn = max(vec2<f32>(width), pixel);
    let to_line = abs(fract(cell + 0.5) - 0.5);
    let sharp = saturate((drawn * 0.5 - to_line) / pixel + 0.5) * (width / drawn);
    let lines = mix(sharp, vec2<f32>(width), saturate(pixel * 2.0 - 1.0));
    return lines.x + lines.y - lines.x * lines.y;
}

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    let pixel = max(fwidth(in.cell), vec2<f32>(1e-6));
    let fine = coverage(in.cell, pixel, in.line_width);
    let coarse = coverage(in.cell * 0.2, pixel * 0.2, in.line_width * 0.4);
    let distance2 = dot(in.share, in.share);
    let fade = saturate(1.0 - distance2);
    let alpha = max(fine * 0.45, coarse) * fade;
    return vec4<f32>(in.color * alpha, alpha);
}
