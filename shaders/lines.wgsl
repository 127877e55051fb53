// Straight lines of a constant width in pixels, anti-aliased by the distance of a pixel from the middle of its line.
// One instance a line, a strip of four corners. Thinner than a pixel they get fainter instead. One may lie over everything.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec4<f32>,
    // Pixels from the middle, times w, and w: their quotient runs linearly over the screen.
    @location(1) across: vec2<f32>,
    @location(2) half_width: f32,
}

@vertex
fn vertex(
    @builtin(view_index) eye: u32,
    @builtin(vertex_index) index: u32,
    @location(0) from_in_room: vec3<f32>,
    @location(1) to_in_room: vec3<f32>,
    @location(2) color: vec4<f32>,
    @location(3) width: f32,
    @location(4) over: f32,
) -> Varyings {
    var start = views[eye].clip_from_room * vec4<f32>(from_in_room, 1.0);
    var end = views[eye].clip_from_room * vec4<f32>(to_in_room, 1.0);
    // Cut at the near plane, where w is z.
    let before = vec2<f32>(start.w - start.z, end.w - end.z);
    var out: Varyings;
    if max(before.x, before.y) <= 0.0 {
        return out;
    }
    let cut = before.x / (before.x - before.y);
    if before.x < 0.0 {
        start = mix(start, end, cut);
    } else if before.y < 0.0 {
        end = mix(start, end, cut);
    }
    let half_size = views[eye].size_px * 0.5;
    let start_px = start.xy / start.w * half_size;
    let end_px = end.xy / end.w * half_size;
    let along = end_px - start_px;
    let direction = select(vec2<f32>(1.0, 0.0), normalize(along), dot(along, along) > 1e-12);
    let half_width = max(width, 1.0) * 0.5;
    // A pixel more on both sides for the soft edge; square ends, so that lines meet in corners.
    let side = f32(index & 1u) * 2.0 - 1.0;
    let reach = half_width + 1.0;
    let is_end = (index >> 1u) == 1u;
    let clip = select(start, end, is_end);
    let middle_px = select(start_px - direction * half_width, end_px + direction * half_width, is_end);
    let place_px = middle_px + vec2<f32>(-direction.y, direction.x) * (side * reach);
    // Depth is reversed: at 1 it is nearer than all.
    out.clip = vec4<f32>(place_px / half_size * clip.w, mix(clip.z, clip.w, over), clip.w);
    out.color = vec4<f32>(color.rgb, color.a * min(width, 1.0));
    out.across = vec2<f32>(side * reach * clip.w, clip.w);
    out.half_width = half_width;
    return out;
}

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    let from_middle = abs(in.across.x / in.across.y);
    let alpha = in.color.a * saturate(in.half_width + 0.5 - from_middle);
    return vec4<f32>(in.color.rgb * alpha, alpha);
}
