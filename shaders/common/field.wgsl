// The colour of a body that shows a field: a vertex colour holds two numbers of 12 bits, the value as a part of the map's
// range and half of its part of the limit, which are interpolated and coloured pixel by pixel, so that no colour appears
// that is not of the map, and the limit's border is crisp. Twin: src/render/color_map.rs.

fn plain_of_vertex(color: vec3<f32>) -> vec3<f32> {
    let bytes = round(color * 255.0);
    let high = floor(bytes.y / 16.0);
    return vec3<f32>(bytes.x * 16.0 + high, (bytes.y - high * 16.0) * 256.0 + bytes.z, 0.0) / 4095.0;
}

// Lightness and arc length in OKLab (Ottosson, 2020) grow evenly with t.
fn color_map(t: f32) -> vec3<f32> {
    let lightness = 0.37 + 0.56 * t;
    let a = 0.061162 + t * (-0.441731 + t * (0.185061 + t * 0.141814));
    let b = -0.152849 + t * (-0.007685 + t * (0.735370 - t * 0.392648));
    let root = vec3<f32>(
        lightness + 0.3963377774 * a + 0.2158037573 * b,
        lightness - 0.1055613458 * a - 0.0638541728 * b,
        lightness - 0.0894841775 * a - 1.2914855480 * b,
    );
    let lms = root * root * root;
    return saturate(vec3<f32>(
        dot(lms, vec3<f32>(4.0767416621, -3.3077115913, 0.2309699292)),
        dot(lms, vec3<f32>(-1.2684380046, 2.6097574011, -0.3413193965)),
        dot(lms, vec3<f32>(-0.0041960863, -0.7034186147, 1.7076147010)),
    ));
}

fn painted(plain: vec3<f32>) -> vec3<f32> {
    let beyond = plain.y - 0.5;
    let pixel = max(fwidth(plain.y), 1e-6);
    let color = mix(color_map(plain.x), vec3<f32>(0.745, 0.0, 0.262), saturate(beyond / pixel + 0.5));
    return color * (1.0 - 0.7 * saturate(1.6 - abs(beyond) / pixel));
}

// Black, which is no colour of the map.
const HATCHING = vec3<f32>(0.0);

// What an eye sees of a colour: the legend's own, whatever light falls on it. Only towards the outline, where the surface
// is turned from the eye by more than 66°, it darkens, so that the form can be read.
fn seen_color(albedo: vec3<f32>, position: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>, outside: f32) -> vec3<f32> {
    return albedo * (0.4 + 0.6 * saturate(2.5 * dot(normal, to_eye)));
}
