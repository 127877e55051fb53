// A deformed surface: its colours with control elements cut out crisply, seen from both sides.

// The colour that was interpolated with this weight. The weight may leave 0 to 1, because multisampling extrapolates
// at the middle of a pixel that lies outside its triangle.
fn unweighted(sum: vec3<f32>, weight: f32) -> vec3<f32> {
    return saturate(sum / select(weight, 1e-3, abs(weight) < 1e-3));
}

// `plain` and `marked` are colours weighted by the mark (1 on control elements, 0 elsewhere) and interpolated, so that each
// stays pure inside the triangles between. The border is drawn where the mark is one half: a clean anti-aliased line
// with a dark seam, instead of a smear one triangle wide. `image` colours what is plain.
fn surface_albedo(plain: vec3<f32>, marked: vec4<f32>, image: vec3<f32>) -> vec3<f32> {
    let mark = marked.a;
    let border = mark - 0.5;
    let pixel = max(fwidth(mark), 1e-6);
    let share = saturate(border / pixel + 0.5);
    let seam = 1.0 - 0.55 * saturate(1.6 - abs(border) / pixel);
    let own = painted(unweighted(plain, 1.0 - mark));
    return mix(own * image, unweighted(marked.rgb, mark), share) * seam;
}

// What an eye sees of it; `counter_clockwise` on the screen.
fn surface_color(
    albedo: vec3<f32>,
    position: vec3<f32>,
    smooth_normal: vec3<f32>,
    counter_clockwise: bool,
    view_of_eye: View,
) -> vec4<f32> {
    let outside = select(-1.0, 1.0, counter_clockwise) * view_of_eye.front_sign;
    let normal = normalize(smooth_normal) * outside;
    let to_eye = normalize(view_of_eye.eye_in_room - position);
    return vec4<f32>(seen_color(albedo, position, normal, to_eye, outside), 1.0);
}

// Which line of a hatching with so many lines a metre a place in the body lies at.
fn stripe_at(position: vec3<f32>, lines_per_m: f32) -> f32 {
    return dot(position, vec3<f32>(0.48, 0.64, 0.6)) * lines_per_m;
}
