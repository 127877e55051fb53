//! The body deformed on the device against its twin on the CPU: all storages, several elements, whole and in chunks.

use crate::render_common::{draw_full, off_axis, require_gpu};
use greenstage::base::columns::{ColumnGroup, Storage, StoredColumns, half_to_single};
use greenstage::base::parts::PartWeights;
use greenstage::deform::{Superposition, move_parts, vertex_normals};
use greenstage::green::FIELDS;
use greenstage::render::{
    BodyBuffers, BodyInstance, COLOR_FORMAT, FrameContents, Gpu, RenderError, Renderer,
};
use nalgebra::{Isometry3, Matrix4, Point3, Rotation3, Vector3};
use std::f32::consts::TAU;

/// An open tube of length 1 m about the origin, and a last vertex in no triangle.
struct Tube {
    rest: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn tube(around: usize, along: usize) -> Tube {
    let mut rest: Vec<[f32; 3]> = (0..around * along)
        .map(|i| {
            let (sin, cos) = (TAU * (i % around) as f32 / around as f32).sin_cos();
            [(i / around) as f32 / (along - 1) as f32 - 0.5, 0.1 * cos, 0.1 * sin]
        })
        .collect();
    rest.push([0.0, 0.3, 0.0]);
    let cell = |i: usize| {
        let next = i / around * around + (i + 1) % around;
        [[i, i + around, next], [next, i + around, next + around]].map(|t| t.map(|node| node as u32))
    };
    Tube { rest, triangles: (0..around * (along - 1)).flat_map(cell).collect() }
}

/// Twelve columns for each element: an affine field that fades away from the element's place on the tube.
fn columns(tube: &Tube, elements: usize) -> Vec<Vec<Vec<f64>>> {
    let field = |e: usize, k: usize| -> Vec<f64> {
        let place = e as f64 / elements as f64 - 0.5;
        let number = |x: &[f32; 3], axis: usize| {
            let x = x.map(f64::from);
            let fade = 1.0 / (1.0 + 9.0 * (x[0] - place).powi(2));
            let value = if k < 3 { 1.0 } else { x[(k - 3) % 3] };
            if axis == if k < 3 { k } else { (k - 3) / 3 } { fade * value } else { 0.03 * fade * x[axis] }
        };
        tube.rest.iter().flat_map(|x| [0, 1, 2].map(|axis| number(x, axis))).collect()
    };
    (0..elements).map(|e| (0..FIELDS).map(|k| field(e, k)).collect()).collect()
}

/// `columns` of all elements in one storage.
fn stored(storage: Storage, tube: &Tube, elements: usize) -> Vec<StoredColumns> {
    columns(tube, elements).iter().map(|columns| StoredColumns::new(storage, columns)).collect()
}

fn groups(data: &[StoredColumns]) -> Vec<ColumnGroup<'_>> {
    data.iter().map(StoredColumns::group).collect()
}

fn body(gpu: &Gpu, tube: &Tube, data: &[StoredColumns], weights: Option<&PartWeights>) -> BodyBuffers {
    let colors = vec![[0; 4]; tube.rest.len()];
    BodyBuffers::with_columns(gpu, &tube.triangles, &colors, &tube.rest, &groups(data), weights, &[]).unwrap()
}

/// Coefficients of a moderate bend: every element moved, turned and stretched; the last field of each left at zero.
fn pose(elements: usize, step: usize) -> Vec<f64> {
    let c = |e: usize, k: usize| 0.2 * ((5 * e + 3 * k + 7 * step) as f64).sin();
    let of = |e: usize| (0..FIELDS).map(move |k| if k == 11 { 0.0 } else { c(e, k) });
    (0..elements).flat_map(of).collect()
}

/// Weights and motions of a body's parts; `None` where it is one part.
type Parts<'a> = Option<(&'a PartWeights, &'a [Isometry3<f64>])>;

/// Largest difference of positions, and of normals of the vertices that have one.
fn difference(
    gpu: &Gpu,
    body: &BodyBuffers,
    tube: &Tube,
    groups: &[ColumnGroup],
    c: &[f64],
    parts: Parts<'_>,
) -> [f32; 2] {
    let mut positions = vec![[0.0; 3]; tube.rest.len()];
    Superposition::new(groups, positions.len()).update(groups, c, &mut positions);
    for (x, rest) in positions.as_flattened_mut().iter_mut().zip(tube.rest.as_flattened()) {
        *x += rest;
    }
    if let Some((weights, motions)) = parts {
        move_parts(weights, motions, &mut positions);
    }
    let [found_positions, found_normals] = body.read(gpu).unwrap();
    // Triangles between parts are small: the last digit of a place is worth more in their normals than these may differ by.
    let corners = if parts.is_some() { &found_positions } else { &positions };
    let mut normals = vec![[0.0; 3]; positions.len()];
    vertex_normals(corners, &tube.triangles, &mut Vec::new(), &mut normals);
    let largest = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        assert_eq!(a.len(), b.len());
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        pairs.fold(0.0, |largest: f32, (a, b)| {
            assert!(a.is_finite() && b.is_finite());
            largest.max((a - b).abs())
        })
    };
    [largest(&positions, &found_positions), largest(&normals, &found_normals)]
}

/// The body is 1 m long: differences in metres are parts of its size.
#[test]
fn device_and_cpu_agree_to_a_hundred_thousandth_in_every_storage() {
    let Some(mut gpu) = require_gpu() else { return };
    let whole = gpu.storage_limit;
    // 1,505 vertices end within a word of halves and within a thread's four numbers; 1,004 do not.
    for (around, along) in [(47, 32), (17, 59)] {
        let tube = tube(around, along);
        for storage in Storage::ALL {
            for elements in [1, 2, 4] {
                let data = stored(storage, &tube, elements);
                for limit in [whole, 40 << 10] {
                    gpu.storage_limit = limit;
                    let mut body = body(&gpu, &tube, &data, None);
                    let [sums, normals] = body.chunks().unwrap();
                    assert_eq!(sums == 1 && normals == 1, limit == whole, "{sums} and {normals} chunks");
                    for step in 0..2 {
                        let c = pose(elements, step);
                        assert!(body.deform(&gpu, &c, &[]).unwrap());
                        let [position, normal] = difference(&gpu, &body, &tube, &groups(&data), &c, None);
                        println!(
                            "{} nodes, {storage:?}, {elements} elements, {sums} and {normals} chunks: \
                             positions {position:e} m, normals {normal:e}",
                            tube.rest.len()
                        );
                        assert!(position < 1e-5 && normal < 1e-5, "{position:e} {normal:e}");
                    }
                }
                gpu.storage_limit = whole;
            }
        }
    }
}

/// Three parts with groups of 12, 1 and 7 columns, whole and in chunks: the shaders and their twins on the CPU agree, the
/// motion of a part alone deforms the body anew, and every vertex is in the box by which its patch is drawn.
#[test]
fn device_and_cpu_agree_on_several_parts_and_any_number_of_columns() {
    let Some(mut gpu) = require_gpu() else { return };
    let (whole, tube) = (gpu.storage_limit, tube(47, 32));
    let rows: Vec<Vec<(u32, f64)>> = tube
        .rest
        .iter()
        .map(|x| {
            let along = 2.0 * (f64::from(x[0]) + 0.5);
            let (first, share) = (along.floor().min(1.0), along - along.floor().min(1.0));
            vec![(first as u32, 1.0 - share), (first as u32 + 1, share)]
        })
        .collect();
    let weights = PartWeights::new(3, &rows).unwrap();
    let motions = |step: usize| -> Vec<Isometry3<f64>> {
        let number = |p: usize, k: usize| 0.6 * ((4 * p + 5 * k + 3 * step) as f64).cos();
        let vector = |p: usize, k: usize| Vector3::new(number(p, k), number(p, k + 1), number(p, k + 2));
        (0..3).map(|p| Isometry3::new(vector(p, 0), vector(p, 3))).collect()
    };
    for storage in Storage::ALL {
        let all = columns(&tube, 3);
        let data: Vec<StoredColumns> =
            all.iter().zip([12, 1, 7]).map(|(of, count)| StoredColumns::new(storage, &of[..count])).collect();
        let groups = groups(&data);
        let c: Vec<f64> = pose(2, 1)[..20].to_vec();
        for limit in [whole, 40 << 10] {
            gpu.storage_limit = limit;
            let mut body = body(&gpu, &tube, &data, Some(&weights));
            // Weights that are rounded to f32 sum to 1 but for their last bit.
            let [made, _] = body.read(&gpu).unwrap();
            let mut pairs = made.as_flattened().iter().zip(tube.rest.as_flattened());
            assert!(pairs.all(|(made, rest)| (made - rest).abs() < 1e-6), "it is made at rest");
            for step in 0..3 {
                let parts = motions(step);
                assert!(body.deform(&gpu, &c, &parts).unwrap(), "the parts moved");
                assert!(!body.deform(&gpu, &c, &parts).unwrap());
                let [position, normal] =
                    difference(&gpu, &body, &tube, &groups, &c, Some((&weights, &parts)));
                println!("{storage:?}, limit {limit}: positions {position:e} m, normals {normal:e}");
                assert!(position < 1e-6 && normal < 1e-5, "{storage:?}: {position:e} {normal:e}");
            }
            let few = body.deform(&gpu, &c, &motions(0)[..2]).unwrap_err();
            assert!(matches!(few, RenderError::PartCount { found: 2, expected: 3 }), "{few}");
        }
        gpu.storage_limit = whole;
    }
    assert_eq!(gpu.made.compute_pipelines() % 3, 0, "one more pass, of these bodies alone");
}

/// All 63,488 finite halves, the subnormal ones too, and all integers of 16 bits come out as they went in.
#[test]
fn every_half_and_every_integer_is_read_exactly() {
    let Some(gpu) = require_gpu() else { return };
    let halves: Vec<u16> = (0..=u16::MAX).filter(|bits| bits & 0x7c00 != 0x7c00).chain([0]).collect();
    let integers: Vec<i16> = (i16::MIN..=i16::MAX).chain([0, 0]).collect();
    let read = |data: ColumnGroup, numbers: usize| {
        let rest = vec![[0.0; 3]; numbers / 3];
        let colors = vec![[0; 4]; numbers / 3];
        let mut body =
            BodyBuffers::with_columns(&gpu, &[[0, 1, 2]], &colors, &rest, &[data], None, &[]).unwrap();
        body.deform(&gpu, &[1.0], &[]).unwrap();
        let [positions, _] = body.read(&gpu).unwrap();
        positions.into_flattened()
    };
    let found = read(ColumnGroup::F16 { bits: &halves, scales: &[1.0] }, halves.len());
    for (&bits, found) in halves.iter().zip(found) {
        assert_eq!(half_to_single(bits), found, "{bits:#x}");
    }
    let found = read(ColumnGroup::Int16 { values: &integers, scales: &[0.5] }, integers.len());
    for (&value, found) in integers.iter().zip(found) {
        assert_eq!(0.5 * f32::from(value), found);
    }
}

#[test]
fn only_new_coefficients_are_summed_and_rest_is_exact() {
    let Some(gpu) = require_gpu() else { return };
    let tube = tube(16, 9);
    let mut body = body(&gpu, &tube, &stored(Storage::F32, &tube, 1), None);
    assert_eq!(body.read(&gpu).unwrap()[0], tube.rest, "it is made at rest");
    let c = pose(1, 3);
    assert!(!body.deform(&gpu, &[0.0; FIELDS], &[]).unwrap());
    assert!(body.deform(&gpu, &c, &[]).unwrap());
    assert!(!body.deform(&gpu, &c, &[]).unwrap());
    assert!(body.deform(&gpu, &[0.0; FIELDS], &[]).unwrap());
    assert_eq!(body.read(&gpu).unwrap()[0], tube.rest);
    let short = body.deform(&gpu, &c[1..], &[]).unwrap_err();
    assert!(matches!(short, RenderError::CoefficientCount { found: 11, expected: 12 }), "{short}");
}

#[test]
fn a_body_that_the_cpu_deforms_makes_no_storage_buffer_and_no_compute_pipeline() {
    let Some(gpu) = require_gpu() else { return };
    let tube = tube(16, 9);
    let mut plain = BodyBuffers::new(&gpu, &tube.triangles, &vec![[0; 4]; tube.rest.len()]).unwrap();
    plain.upload(&gpu, &tube.rest, &tube.rest).unwrap();
    assert!(!plain.deform(&gpu, &[1.0; FIELDS], &[]).unwrap() && !plain.is_deformed_here());
    assert_eq!((gpu.made.storage_bytes(), gpu.made.compute_pipelines()), (0, 0));
    body(&gpu, &tube, &stored(Storage::F32, &tube, 1), None);
    assert_eq!(gpu.made.compute_pipelines(), 2);
    assert!(gpu.made.storage_bytes() > 0);
}

#[test]
fn columns_that_do_not_fit_are_refused_with_the_numbers() {
    let Some(mut gpu) = require_gpu() else { return };
    let tube = tube(16, 9);
    let colors = vec![[0; 4]; tube.rest.len()];
    let exact = columns(&tube, 1);
    let data = Storage::ALL.map(|storage| StoredColumns::new(storage, &exact[0]));
    let make = |gpu: &Gpu, groups: &[ColumnGroup]| {
        BodyBuffers::with_columns(gpu, &tube.triangles, &colors, &tube.rest, groups, None, &[]).err().unwrap()
    };
    let mixed = make(&gpu, &[data[0].group(), data[1].group()]);
    assert!(matches!(mixed, RenderError::MixedStorage), "{mixed}");
    let short = make(&gpu, &[ColumnGroup::F32(&[0.0; 100])]);
    assert!(matches!(short, RenderError::ColumnLength { numbers: 100, .. }), "{short}");
    gpu.storage_limit = 64;
    let large = make(&gpu, &[data[0].group()]);
    assert!(matches!(large, RenderError::BufferSize { limit: 64, .. }), "{large}");
}

/// Time on the device, where it has a clock: every pass is named, in its order.
#[test]
fn passes_tell_their_time() {
    let Some(mut gpu) = require_gpu() else { return };
    assert_eq!(gpu.read_clock().unwrap(), []);
    if !gpu.start_clock().unwrap() {
        return eprintln!("SKIPPED: this device has no clock");
    }
    let tube = tube(16, 9);
    let mut body = body(&gpu, &tube, &stored(Storage::F32, &tube, 1), None);
    gpu.read_clock().unwrap();
    for round in 0..3 {
        body.deform(&gpu, &pose(1, round), &[]).unwrap();
        let spans = gpu.read_clock().unwrap();
        let names: Vec<&str> = spans.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["deform", "normals"]);
        assert!(spans.iter().all(|(_, time)| *time >= 0.0 && *time < 10.0), "{spans:?}");
    }
}

/// A body in patches from random heads, bent at random, of one part and of two in turn: leaving out what a view cannot see changes no pixel.
#[test]
fn patches_that_are_left_out_would_not_have_been_seen() {
    let Some(gpu) = require_gpu() else { return };
    let tube = tube(47, 60);
    let share = |x: &[f32; 3]| f64::from(x[0] + 0.5).clamp(0.0, 1.0);
    let rows: Vec<_> = tube.rest.iter().map(|x| vec![(0, 1.0 - share(x)), (1, share(x))]).collect();
    let weights = PartWeights::new(2, &rows).unwrap();
    let data = stored(Storage::Int16, &tube, 2);
    let mut bodies = [None, Some(&weights)].map(|weights| body(&gpu, &tube, &data, weights));
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let (mut drawn, mut culled, mut lit) = (0, 0, 0);
    for round in 0..24_u8 {
        let body = &mut bodies[usize::from(round % 2)];
        let number = |k: f32| (f32::from(round) * 1.7 + k * 2.3).sin();
        let part = |k: f32| {
            let vector = |k: f32| Vector3::new(number(k), number(k + 1.0), number(k + 2.0)).cast::<f64>();
            Isometry3::new(vector(k) * 0.2, vector(k + 3.0))
        };
        body.deform(&gpu, &pose(2, round.into()), &[part(10.0), part(20.0)]).unwrap();
        let place = Vector3::new(number(1.0), number(2.0), 0.6 * number(3.0));
        let turn = Rotation3::from_scaled_axis(Vector3::new(number(4.0), number(5.0), number(6.0)) * 3.0);
        let room_from_body = Matrix4::new_translation(&place) * turn.to_homogeneous();
        let bodies = [BodyInstance { buffers: body, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..Default::default() };
        let eye = Point3::new(number(7.0), number(8.0), 1.4 + 0.5 * number(9.0));
        let view = off_axis(Point3::origin(), [0.8, 0.64], 0.0, eye);
        let mut picture = |culling| {
            renderer.culling = culling;
            let picture = draw_full(&gpu, &mut renderer, [160, 128], view, &contents);
            (picture, renderer.counts)
        };
        let ((with, counts), (without, all)) = (picture(true), picture(false));
        assert!(with == without, "round {round}: {counts:?}");
        assert_eq!((all.drawn, all.culled), (counts.drawn + counts.culled, 0));
        assert!(all.drawn > 16, "it is in patches: {all:?}");
        (drawn, culled) = (drawn + counts.drawn, culled + counts.culled);
        lit += without.pixels().filter(|pixel| pixel.0[2] > 60).count();
    }
    println!("{drawn} drawn, {culled} left out, {lit} pixels of the body");
    assert!(drawn > 50 && culled > 300 && lit > 1000, "{drawn}, {culled}, {lit}");
}
