// A shape that stands translucent in the room, as the rest shape of a body: clear where it is looked at straight, denser
// towards its outline (a Fresnel term), so that its form is read without hiding what is behind. Its far side is left out.
//
// An opacity below 0 is that of what lies hidden behind a body: that is fainter.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec4<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(3) room_from_shape_0: vec4<f32>,
    @location(4) room_from_shape_1: vec4<f32>,
    @location(5) room_from_shape_2: vec4<f32>,
    @location(6) room_from_shape_3: vec4<f32>,
    @location(7) color: vec4<f32>,
) -> Varyings {
    let room_from_shape =
        mat4x4<f32>(room_from_shape_0, room_from_shape_1, room_from_shape_2, room_from_shape_3);
    let position_in_room = room_from_shape * vec4<f32>(position, 1.0);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * position_in_room;
    out.position = position_in_room.xyz;
    out.normal = (room_from_shape * vec4<f32>(normal, 0.0)).xyz;
    out.color = color;
    return out;
}

// How opaque it is where the cosine between normal and sight is this; its twin is in tests/pictures/render_ghosts.rs.
fn ghost_opacity(n_dot_v: f32, opacity: f32) -> f32 {
    let grazing = 1.0 - n_dot_v;
    let clear = select(0.18, 0.12, opacity < 0.0);
    return saturate(abs(opacity) * (clear + (1.0 - clear) * grazing * grazing * grazing));
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
    @builtin(front_facing) counter_clockwise: bool,
) -> @location(0) vec4<f32> {
    let outside = select(-1.0, 1.0, counter_clockwise) * views[eye].front_sign;
    if outside < 0.0 {
        discard;
    }
    let to_eye = normalize(views[eye].eye_in_room - in.position);
    let n_dot_v = saturate(abs(dot(normalize(in.normal), to_eye)));
    let alpha = ghost_opacity(n_dot_v, in.color.a);
    return vec4<f32>(in.color.rgb * alpha, alpha);
}
