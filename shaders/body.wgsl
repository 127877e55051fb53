// One deformed body of plain colours.
//
// A vertex colour's fourth component marks control elements (1) and plain surface (0); shaders/common/surface.wgsl draws the
// border between them. What is fixed to the material is drawn by shaders/patterned.wgsl.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) plain: vec3<f32>,
    @location(3) marked: vec4<f32>,
    @location(4) stripe: f32,
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
    out.stripe = stripe_at(position, scale.w);
    return out;
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
    @builtin(front_facing) counter_clockwise: bool,
) -> @location(0) vec4<f32> {
    let albedo = hatched(surface_albedo(in.plain, in.marked, vec3<f32>(1.0)), in.stripe);
    return surface_color(albedo, in.position, in.normal, counter_clockwise, views[eye]);
}
