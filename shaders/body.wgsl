// One deformed body: lit, two-sided, its control elements cut out crisply.
//
// A vertex colour's fourth component marks control elements (1) and plain surface (0). Both colours are interpolated
// weighted by the mark, so each stays pure inside the triangles between, and the border is drawn where the mark is
// one half: a clean anti-aliased line with a dark seam, instead of a smear one triangle wide.

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) plain: vec3<f32>,
    @location(3) marked: vec4<f32>,
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
    return out;
}

// The colour that was interpolated with this weight. The weight may leave 0 to 1, because multisampling extrapolates
// at the middle of a pixel that lies outside its triangle.
fn unweighted(sum: vec3<f32>, weight: f32) -> vec3<f32> {
    return saturate(sum / select(weight, 1e-3, abs(weight) < 1e-3));
}

@fragment
fn fragment(
    @builtin(view_index) eye: u32,
    in: Varyings,
    @builtin(front_facing) counter_clockwise: bool,
) -> @location(0) vec4<f32> {
    let mark = in.marked.a;
    let border = mark - 0.5;
    let pixel = max(fwidth(mark), 1e-6);
    let share = saturate(border / pixel + 0.5);
    let plain = painted(unweighted(in.plain, 1.0 - mark));
    let marked = unweighted(in.marked.rgb, mark);
    let seam = 1.0 - 0.55 * saturate(1.6 - abs(border) / pixel);
    let albedo = mix(plain, marked, share) * seam;

    let outside = select(-1.0, 1.0, counter_clockwise) * views[eye].front_sign;
    let normal = normalize(in.normal) * outside;
    let to_eye = normalize(views[eye].eye_in_room - in.position);
    // The inside of a wall is the same material with less of the room to see.
    let radiance = shade(albedo, normal, to_eye) * (0.75 + 0.25 * outside);
    return vec4<f32>(tone(radiance), 1.0);
}
