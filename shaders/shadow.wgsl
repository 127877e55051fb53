// Depth of the bodies as a light sees them: parallel rays, 0 at the end near the light.

@group(0) @binding(0) var<uniform> clip_from_room: mat4x4<f32>;

@vertex
fn vertex(
    @location(0) position: vec3<f32>,
    @location(3) room_from_body_0: vec4<f32>,
    @location(4) room_from_body_1: vec4<f32>,
    @location(5) room_from_body_2: vec4<f32>,
    @location(6) room_from_body_3: vec4<f32>,
) -> @builtin(position) vec4<f32> {
    let room_from_body = mat4x4<f32>(room_from_body_0, room_from_body_1, room_from_body_2, room_from_body_3);
    return clip_from_room * (room_from_body * vec4<f32>(position, 1.0));
}
