// Styli, their rays and hit points, arrows and balls: small rigid solids, one instance each, lit or glowing.

// Added to the glow of an instance that is shown through whatever stands before it: its depths are squeezed into the tenth
// next to the eye, in their order.
const THROUGH = 2.0;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // Linear colour, and the share of it that is emitted.
    @location(2) color: vec4<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // The fourth component is the weight of the instance's colour.
    @location(2) base_color: vec4<f32>,
    @location(3) room_from_solid_0: vec4<f32>,
    @location(4) room_from_solid_1: vec4<f32>,
    @location(5) room_from_solid_2: vec4<f32>,
    @location(6) room_from_solid_3: vec4<f32>,
    @location(7) instance_color: vec4<f32>,
) -> Varyings {
    let room_from_solid = mat4x4<f32>(room_from_solid_0, room_from_solid_1, room_from_solid_2, room_from_solid_3);
    let position_in_room = room_from_solid * vec4<f32>(position, 1.0);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * position_in_room;
    var own_color = instance_color;
    if own_color.a >= THROUGH {
        own_color.a -= THROUGH;
        out.clip.z = 0.9 * out.clip.w + 0.1 * out.clip.z;
    }
    out.position = position_in_room.xyz;
    // The inverse transpose of columns at right angles to each other, which a stretched solid's are.
    out.normal = room_from_solid[0].xyz * (normal.x / dot(room_from_solid[0], room_from_solid[0]))
        + room_from_solid[1].xyz * (normal.y / dot(room_from_solid[1], room_from_solid[1]))
        + room_from_solid[2].xyz * (normal.z / dot(room_from_solid[2], room_from_solid[2]));
    out.color = mix(vec4<f32>(linear_from_srgb(base_color.rgb), 0.0), own_color, base_color.a);
    return out;
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
) -> @location(0) vec4<f32> {
    let to_eye = normalize(views[eye].eye_in_room - in.position);
    let normal = normalize(in.normal);
    let lit = tone(shade(in.color.rgb, normal, to_eye, Seen(1.0, 1.0)));
    // A glow is a little brighter towards its middle, which rounds the ray without lighting it.
    let glow = in.color.rgb * (0.7 + 0.3 * saturate(dot(normal, to_eye)));
    return vec4<f32>(mix(lit, glow, in.color.a), 1.0);
}
