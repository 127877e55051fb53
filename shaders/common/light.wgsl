// A dielectric under a key light, a fill light and a two-tone sky: Lambert, Blinn-Phong with its energy factor,
// Schlick's Fresnel on the reflected sky. No pow and no exp: on a software device they would be most of the cost.

fn sky_light(up: f32) -> vec3<f32> {
    return mix(lighting.ground, lighting.sky, 0.5 + 0.5 * up);
}

// Reinhard's curve with white at 2.5: leaves dark tones, rolls highlights off without a clipped edge.
fn tone(radiance: vec3<f32>) -> vec3<f32> {
    return saturate(radiance * (1.0 + radiance * 0.16) / (1.0 + radiance));
}

// The shares of the key light and of the sky that a point sees.
struct Seen {
    key: f32,
    sky: f32,
}

// Radiance to the eye; `normal` and `to_eye` are unit vectors on the same side of the surface.
fn shade(albedo: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>, seen: Seen) -> vec3<f32> {
    let n_dot_v = saturate(dot(normal, to_eye));
    let grazing = 1.0 - n_dot_v;
    let grazing2 = grazing * grazing;
    let fresnel = 0.04 + 0.46 * grazing2 * grazing2 * grazing;

    // The key wraps a little round the form, so that the terminator stays readable without shadows.
    let n_dot_key = dot(normal, lighting.to_key);
    let key = saturate(n_dot_key * 0.85 + 0.15);
    let fill = saturate(dot(normal, lighting.to_fill));
    let diffuse = sky_light(normal.y) * seen.sky + lighting.key * ((key * key * 0.35 + key * 0.65) * seen.key)
        + lighting.fill * (fill * seen.sky);

    let half_way = normalize(lighting.to_key + to_eye);
    let s = saturate(dot(normal, half_way));
    let s2 = s * s;
    let s4 = s2 * s2;
    let s8 = s4 * s4;
    let s32 = s8 * s8 * s8 * s8;
    let highlight = lighting.key * (s32 * 0.16 + s8 * 0.02) * (saturate(n_dot_key * 4.0) * seen.key);

    let reflected_up = 2.0 * dot(normal, to_eye) * normal.y - to_eye.y;
    let mirror = sky_light(clamp(reflected_up * 1.6, -1.0, 1.0)) * (fresnel * 1.6 * seen.sky);
    return albedo * diffuse * (1.0 - fresnel) + highlight + mirror;
}
