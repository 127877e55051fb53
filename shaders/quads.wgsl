// Translucent parallelograms, as screens seen from outside: one colour for the front, whose edges right and up turn
// counter-clockwise, another for the back. One instance each, a strip of four corners.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) front: vec4<f32>,
    @location(1) back: vec4<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @builtin(vertex_index) index: u32,
    @location(0) corner: vec3<f32>,
    @location(1) right: vec3<f32>,
    @location(2) up: vec3<f32>,
    @location(3) front: vec4<f32>,
    @location(4) back: vec4<f32>,
) -> Varyings {
    let place = corner + right * f32(index & 1u) + up * f32(index >> 1u);
    var out: Varyings;
    out.clip = views[eye].clip_from_room * vec4<f32>(place, 1.0);
    out.front = front;
    out.back = back;
    return out;
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
    @builtin(front_facing) counter_clockwise: bool,
) -> @location(0) vec4<f32> {
    let is_front = counter_clockwise == (views[eye].front_sign > 0.0);
    let color = select(in.back, in.front, is_front);
    return vec4<f32>(color.rgb * color.a, color.a);
}
