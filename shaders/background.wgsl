// The empty room: a dark gradient over the height of the sight line. It lies at infinity in the room, not on the
// screen, so it is the same for both eyes and runs on across the seam of two screens.

struct Varyings {
    @invariant @builtin(position) clip: vec4<f32>,
    @location(0) direction: vec3<f32>,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @builtin(vertex_index) index: u32,
) -> Varyings {
    // One triangle over the whole viewport, at infinite distance: depth 0, since depth is reversed. An eye that sees
    // nothing gets a point outside.
    let ndc = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0;
    let is_seen = views[eye].front_sign != 0.0;
    var out: Varyings;
    out.clip = vec4<f32>(select(vec2<f32>(2.0), ndc, is_seen), 0.0, 1.0);
    out.direction = views[eye].direction_from_ndc * vec3<f32>(ndc, 1.0);
    return out;
}

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    let up = in.direction.y * inverseSqrt(dot(in.direction, in.direction));
    let away = select(lighting.nadir, lighting.zenith, up > 0.0);
    return vec4<f32>(mix(lighting.horizon, away, sqrt(abs(up))), 1.0);
}
