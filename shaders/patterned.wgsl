// A deformed body with what is fixed to its material: lines and an image, found from where each point lay at rest.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) plain: vec3<f32>,
    @location(3) marked: vec4<f32>,
    // m from the middle of the pattern.
    @location(4) rest: vec3<f32>,
    // Lines a metre; repetitions of the image a metre along u and v.
    @location(5) @interpolate(flat) scale: vec3<f32>,
    @location(6) stripe: f32,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec4<f32>,
    @location(3) room_from_body_0: vec4<f32>,
    @location(4) room_from_body_1: vec4<f32>,
    @location(5) room_from_body_2: vec4<f32>,
    @location(6) room_from_body_3: vec4<f32>,
    @location(7) scale: vec4<f32>,
    @location(8) rest: vec3<f32>,
) -> Varyings {
    let room_from_body = mat4x4<f32>(room_from_body_0, room_from_body_1, room_from_body_2, room_from_body_3);
    let position_in_room = room_from_body * vec4<f32>(position, 1.0);
    let rgb = linear_from_srgb(color.rgb);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * position_in_room;
    out.position = position_in_room.xyz;
    out.normal = (room_from_body * vec4<f32>(normal, 0.0)).xyz;
    out.plain = plain_of_vertex(color.rgb) * (1.0 - color.a);
    out.marked = vec4<f32>(rgb * color.a, color.a);
    out.rest = rest;
    out.scale = scale.xyz;
    out.stripe = stripe_at(position, scale.w);
    return out;
}

// The share of a pixel that lines at the whole numbers of `cell` cover, for each axis. A line is LINE_WIDTH of a cell wide on
// the surface, but at least a pixel; it fades where cells shrink to pixels.
const LINE_WIDTH: f32 = 0.035;

// `pixel` is how much of a cell a pixel spans, `slope` by how much a cell changes along the surface, 0 to 1.
fn line_coverage(cell: vec3<f32>, pixel: vec3<f32>, slope: vec3<f32>) -> f32 {
    let drawn = max(LINE_WIDTH * slope, 1.2 * pixel);
    let to_line = abs(fract(cell + 0.5) - 0.5);
    let sharp = saturate((0.5 * drawn - to_line) / pixel + 0.5);
    // Where the surface lies in a plane of the lines there is no line to draw.
    let is_steep = saturate((slope - 0.3) * 4.0);
    let is_near = saturate(1.6 - 6.0 * pixel / slope);
    let lines = sharp * is_steep * is_near;
    return 1.0 - (1.0 - lines.x) * (1.0 - lines.y) * (1.0 - lines.z);
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
    @builtin(front_facing) counter_clockwise: bool,
) -> @location(0) vec4<f32> {
    let along_x = dpdx(in.rest);
    let along_y = dpdy(in.rest);
    let across = cross(along_x, along_y);
    // Of the triangle at rest.
    let flat_normal = across * inverseSqrt(max(dot(across, across), 1.1754944e-38));
    let slope = sqrt(max(1.0 - flat_normal * flat_normal, vec3<f32>(1e-4)));
    let cell = in.rest * in.scale.x;
    let pixel = max((abs(along_x) + abs(along_y)) * in.scale.x, vec3<f32>(1e-6));
    let lines = line_coverage(cell, pixel, slope);
    let image = image_color(in.rest, in.scale.yz, flat_normal);
    let albedo = hatched(surface_albedo(in.plain, in.marked, image) * (1.0 - 0.5 * lines), in.stripe);
    return surface_color(albedo, in.position, in.normal, counter_clockwise, views[eye]);
}
