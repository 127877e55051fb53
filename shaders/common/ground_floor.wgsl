// The part of the floor that lies in the bodies' shadow. Its Rust twin is in src/render/ground.rs; a test compares the layouts.

struct GroundFloor {
    center: vec3<f32>,
    // Heights above the floor are drawn in the map up to this, m.
    height_m: f32,
    half_size: vec2<f32>,
    // How far from a place a body can still shade it, m.
    reach_m: f32,
    end: f32,
}

@group(1) @binding(0) var<uniform> ground_floor: GroundFloor;
