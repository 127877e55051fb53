//! Shapes are drawn where the projection puts them, nearer before farther, the same in every arrangement of viewports.

use crate::render_common::*;
use greenstage::render::*;
use image::RgbaImage;
use nalgebra::{Matrix4, Point3, Vector3};

const SIZE: [u32; 2] = [320, 256];

fn eyes() -> [View; 2] {
    [-0.032, 0.032]
        .map(|x| off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], -0.3, Point3::new(x + 0.1, 1.3, 0.9)))
}

/// Mean place of the pixels that are at least half as bright as the brightest, in pixels from the top left corner.
fn bright_spot(image: &RgbaImage) -> [f32; 2] {
    let value = |p: &image::Rgba<u8>| p.0[..3].iter().map(|&c| u32::from(c)).sum::<u32>();
    let brightest = image.pixels().map(value).max().unwrap();
    assert!(brightest > 300, "nothing bright was drawn: {brightest}");
    let (mut sum, mut count) = ([0.0, 0.0], 0.0);
    for (x, y, pixel) in image.enumerate_pixels() {
        if value(pixel) * 2 >= brightest {
            sum = [sum[0] + x as f32 + 0.5, sum[1] + y as f32 + 0.5];
            count += 1.0;
        }
    }
    sum.map(|total| total / count)
}

#[test]
fn a_small_body_lands_on_the_projected_pixel_for_both_eyes() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let center = [0.0, 0.0, 0.0];
    let buffers = square(0.012, center, [255, 255, 255, 0]).buffers(&gpu);
    for point in [[0.2, 1.1, -0.3], [-0.3, 0.8, 0.1], [0.0, 1.0, 0.4], [0.05, 1.2, -3.0]] {
        // The same size on the screen at every depth.
        let point = Point3::from(point);
        let scale = (eyes()[0].eye_in_room - point).norm();
        let room_from_body = Matrix4::new_translation(&point.coords) * Matrix4::new_scaling(scale);
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
        for view in eyes() {
            let found = bright_spot(&draw_full(&gpu, &mut renderer, SIZE, view, &contents));
            let expected = pixel_of(&view, SIZE, point);
            let error = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(error < 1.0, "{point}: found {found:?}, expected {expected:?}");
        }
    }
}

/// The hit point is paler than the ray that ends in it; half way the ray is there, in the stylus' colour.
#[test]
fn ray_and_hit_point_land_on_their_projected_pixels() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let hit = Point3::new(0.11, 1.05, -0.2);
    let tip = Point3::new(-0.1, 1.2, -0.6);
    let room_from_stylus = Matrix4::new_translation(&tip.coords);
    for pressed in [false, true] {
        let stylus = StylusShape {
            room_from_stylus,
            size_m: 0.4,
            ray_length_m: 1.0,
            hit: Some(hit),
            bend: None,
            pressed,
        };
        let contents = FrameContents {
            drawables: [&[Drawable::Stylus(stylus)], &[]],
            lighting: black_room(),
            ..FrameContents::default()
        };
        for view in eyes() {
            let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
            let expected = pixel_of(&view, SIZE, hit);
            let near_hit = |x: u32, y: u32| (x as f32 - expected[0]).hypot(y as f32 - expected[1]) < 20.0;
            let pale: Vec<_> =
                image.enumerate_pixels().filter(|&(x, y, p)| p.0[2] > 120 && near_hit(x, y)).collect();
            let mean = |f: fn(&(u32, u32, &image::Rgba<u8>)) -> u32| {
                pale.iter().map(|p| f(p) as f32 + 0.5).sum::<f32>() / pale.len() as f32
            };
            let found = [mean(|p| p.0), mean(|p| p.1)];
            let error = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(error < 1.0, "found {found:?} from {} pixels, expected {expected:?}", pale.len());

            let [x, y] = pixel_of(&view, SIZE, nalgebra::center(&tip, &hit)).map(|p| p as u32);
            let [r, g, b, _] = image.get_pixel(x, y).0;
            assert!((r > g) == pressed && g > 2 * b, "half way, pressed {pressed}: {r} {g} {b}");
        }
    }
}

/// An arrow's slender head is lit as its shaft is, not as if it were seen from its tip: its sides lie at an angle of
/// atan(2.6/8) = 18° to the axis, so from the side the middle of both faces the eye.
#[test]
fn the_sides_of_a_stretched_cone_face_sideways() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], -0.3, Point3::new(0.0, 1.0, 0.9));
    let (from, along) = (Point3::new(-0.3, 1.0, -0.3), Vector3::new(0.6, 0.0, 0.0));
    let arrows = [Drawable::Arrow(Arrow { from, along, radius_m: 0.02, color: [0.4; 3], through: false })];
    let contents =
        FrameContents { drawables: [&arrows, &[]], lighting: black_room(), ..FrameContents::default() };
    let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
    let brightness = |share: f32| {
        let [x, y] = pixel_of(&view, SIZE, from + along * share);
        f32::from(image.get_pixel(x as u32, y as u32).0[0])
    };
    let (shaft, head) = (brightness(0.4), brightness(0.85));
    assert!(shaft > 60.0 && (head / shaft - 1.0).abs() < 0.1, "shaft {shaft}, head {head}");
}

/// The arrow of the body's pull is seen though the body stands before it, and is hidden where it is not meant to be.
#[test]
fn an_arrow_is_shown_through_what_stands_before_it() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], -0.3, Point3::new(0.0, 1.0, 0.9));
    let buffers = square(0.4, [0.0; 3], [255, 255, 255, 0]).buffers(&gpu);
    let bodies = [BodyInstance {
        buffers: &buffers,
        room_from_body: Matrix4::new_translation(&Vector3::new(0.0, 1.0, 0.0)),
    }];
    let (from, along) = (Point3::new(-0.2, 1.0, -0.3), Vector3::new(0.4, 0.0, 0.0));
    for through in [false, true] {
        let arrows =
            [Drawable::Arrow(Arrow { from, along, radius_m: 0.02, color: [0.9, 0.0, 0.0], through })];
        let contents = FrameContents {
            bodies: &bodies,
            drawables: [&arrows, &[]],
            lighting: black_room(),
            ..FrameContents::default()
        };
        let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
        let [x, y] = pixel_of(&view, SIZE, from + along * 0.4);
        let [red, green, ..] = image.get_pixel(x as u32, y as u32).0.map(u32::from);
        assert_eq!(red > 2 * green.max(20), through, "{red} {green}");
    }
}

/// A point in front of the screen is crossed: the left eye sees it farther right. Behind the screen it is the reverse,
/// and in the screen both eyes see it at the same place.
#[test]
fn parallax_has_the_sign_and_size_of_stereo() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let buffers = square(0.02, [0.0; 3], [255, 255, 255, 0]).buffers(&gpu);
    let views = [-0.032, 0.032]
        .map(|x| off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(x, 1.0, 0.8)));
    // Similar triangles: separation · z / (distance - z), in pixels of 1 m / 320.
    for z in [0.3_f32, 0.0, -0.8] {
        let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 1.0, z));
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
        let [left, right] =
            views.map(|view| bright_spot(&draw_full(&gpu, &mut renderer, SIZE, view, &contents)));
        let expected = 0.064 * z / (0.8 - z) * 320.0;
        assert!((left[0] - right[0] - expected).abs() < 1.0, "z = {z}: {left:?}, {right:?}, {expected}");
        assert!((left[1] - right[1]).abs() < 0.1);
    }
}

#[test]
fn the_nearer_of_two_bodies_hides_the_farther_in_either_order() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let near = square(0.2, [0.0, 1.0, 0.101], [255, 0, 0, 0]).buffers(&gpu);
    let far = square(0.4, [0.0, 1.0, 0.1], [0, 0, 255, 0]).buffers(&gpu);
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.0, 1.0, 0.8));
    let at = |buffers| BodyInstance { buffers, room_from_body: Matrix4::identity() };
    for bodies in [[at(&near), at(&far)], [at(&far), at(&near)]] {
        let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
        let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
        let [r, _, b, _] = image.get_pixel(160, 128).0;
        assert!(r > b, "the near body is red: {r} {b}");
        let [r, _, b, _] = image.get_pixel(60, 128).0;
        assert!(b > r, "the far body is blue and wider: {r} {b}");
    }
}

/// An outward face is lit by the key above it; turned over, its other side is lit, not black.
#[test]
fn both_sides_of_a_surface_are_lit_and_a_mirrored_picture_is_the_mirror_image() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let buffers = square(0.3, [0.0; 3], [200, 200, 200, 0]).buffers(&gpu);
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.1, 1.0, 0.8));
    let center = |view: View, turn: f32| {
        let room_from_body = Matrix4::new_translation(&Vector3::<f32>::y())
            * Matrix4::new_rotation(Vector3::new(0.0, turn, 0.0));
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..FrameContents::default() };
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
        draw_full(&gpu, &mut renderer, SIZE, view, &contents).get_pixel(160, 128).0[0]
    };
    let (front, back) = (center(view, 0.0), center(view, std::f32::consts::PI));
    assert!(back > front / 2 && back < front, "front {front}, back {back}: the inside is a little darker");

    let mirror = Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0));
    let mirrored = View { clip_from_room: mirror * view.clip_from_room, ..view };
    assert!(
        center(mirrored, 0.0).abs_diff(front) <= 1,
        "a mirrored picture swaps the winding, not the sides"
    );

    // The whole scene, background included.
    let room_from_body = Matrix4::new_translation(&Vector3::new(0.2, 1.1, 0.0));
    let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
    let contents = FrameContents { bodies: &bodies, ..FrameContents::default() };
    let plain = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
    let flipped =
        image::imageops::flip_horizontal(&draw_full(&gpu, &mut renderer, SIZE, mirrored, &contents));
    assert!(pixels_apart(&plain, &flipped, 2) < 4, "{} pixels", pixels_apart(&plain, &flipped, 2));
}

/// A value of a field has the legend's colour, which is the CPU's twin of the map, however the light falls on it; beyond its
/// limit it has the colour that the map has not. It was lit: 0 Pa was drawn from (68, 41, 123) to (161, 148, 185).
#[test]
fn a_field_is_shown_in_the_colours_of_its_legend_under_any_light() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.1, 1.0, 0.8));
    let mut center = |color: [u8; 4], turn: f32, shadows: Shadows| {
        let mut buffers = square(0.3, [0.0; 3], color).buffers(&gpu);
        buffers.shows_field = true;
        let room_from_body =
            Matrix4::new_translation(&Vector3::<f32>::y()) * Matrix4::new_rotation(Vector3::x() * turn);
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..FrameContents::default() };
        renderer.shadows = shadows;
        draw_full(&gpu, &mut renderer, SIZE, view, &contents).get_pixel(160, 128).0
    };
    for (part, of_limit) in
        [(0.0, 0.0), (0.2, 0.9), (0.5, 0.0), (0.8, 0.3), (1.0, 0.3), (7.0, 0.0), (0.4, 1.2)]
    {
        let [r, g, b] = if of_limit > 1.0 { beyond_color() } else { map_color(part as f32) };
        for (turn, shadows) in [(0.0, Shadows::Off), (0.9, Shadows::Off), (-0.9, Shadows::Soft)] {
            let shown = center(field_code(part, of_limit), turn, shadows);
            let off = shown.iter().zip([r, g, b, 255]).map(|(a, b)| a.abs_diff(b)).max().unwrap();
            assert!(off <= 1, "{part}, {of_limit}, turned by {turn}: {shown:?}, not {:?}", [r, g, b]);
        }
    }
}

/// Bent beyond its model, a body was red all over, and its stress could not be seen. The hatching leaves more than half of it.
#[test]
fn a_hatched_body_shows_its_colours_between_the_lines() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.1, 1.0, 0.8));
    let (code, [r, g, b]) = (field_code(0.5, 0.0), map_color(0.5));
    let mut buffers = square(0.3, [0.0; 3], code).buffers(&gpu);
    buffers.shows_field = true;
    let room_from_body = Matrix4::new_translation(&Vector3::<f32>::y());
    let mut shares = |hatched_per_m: Option<f32>| {
        buffers.hatched_per_m = hatched_per_m;
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..FrameContents::default() };
        let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
        let count = |color: [u8; 3]| {
            let is_it = |p: &&image::Rgba<u8>| p.0.iter().zip(color).all(|(a, b)| a.abs_diff(b) <= 1);
            image.pixels().filter(is_it).count() as f64
        };
        [count([r, g, b]), count([0; 3])]
    };
    let [whole, none] = shares(None);
    let [own, lines] = shares(Some(30.0)).map(|pixels| pixels / whole);
    println!("{own:.2} of the body in its own colour, {lines:.2} in lines");
    assert!(whole > 5000.0 && none == 0.0);
    assert!((0.6..0.75).contains(&own) && (0.09..0.22).contains(&lines), "{own}, {lines}");
}

/// Number of pixels that differ by more than `step` in any channel.
pub fn pixels_apart(a: &RgbaImage, b: &RgbaImage, step: u8) -> usize {
    assert_eq!(a.dimensions(), b.dimensions());
    let differs =
        |p: &image::Rgba<u8>, q: &image::Rgba<u8>| p.0.iter().zip(q.0).any(|(&x, y)| x.abs_diff(y) > step);
    a.pixels().zip(b.pixels()).filter(|(p, q)| differs(p, q)).count()
}

/// A whole scene, for comparisons of pictures.
fn with_scene<R>(gpu: &Gpu, work: impl FnOnce(&FrameContents<'_>) -> R) -> R {
    let buffers = bent_tube(20, 16).buffers(gpu);
    let room_from_body = Matrix4::new_translation(&Vector3::new(0.0, 1.0, -0.1)) * Matrix4::new_scaling(0.7);
    let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
    let room_from_stylus = Matrix4::new_translation(&Vector3::new(0.3, 0.9, 0.3));
    let hit = Some(Point3::new(0.2, 1.1, 0.1));
    let stylus =
        StylusShape { room_from_stylus, size_m: 0.2, ray_length_m: 1.0, hit, bend: None, pressed: false };
    let grid = Some(Grid::new(Point3::new(0.0, 0.8, 0.0), [1.0, 1.0], 0.1));
    work(&FrameContents {
        bodies: &bodies,
        drawables: [&[Drawable::Stylus(stylus)], &[]],
        grid,
        ..Default::default()
    })
}

#[test]
fn side_by_side_equals_two_separate_pictures() {
    let Some(gpu) = require_gpu() else { return };
    for samples in [1, 4] {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        with_scene(&gpu, |contents| {
            let [left, right] = eyes();
            let [width, height] = SIZE;
            let wide = [2 * width, height];
            let viewports = side_by_side(wide, Some(left), Some(right));
            let both = draw(&gpu, &mut renderer, wide, &viewports, contents);
            for (k, view) in [left, right].into_iter().enumerate() {
                let alone = draw_full(&gpu, &mut renderer, SIZE, view, contents);
                let half = image::imageops::crop_imm(&both, k as u32 * width, 0, width, height).to_image();
                // A viewport's offset changes the rounding of interpolated values, here and there by one step of 8
                // bits; no edge moves.
                assert_eq!(pixels_apart(&alone, &half, 1), 0, "eye {k}, {samples} samples");
                let rounded = pixels_apart(&alone, &half, 0);
                assert!(rounded * 1000 < width as usize * height as usize, "{rounded} pixels, eye {k}");
            }
        });
    }
}

#[test]
fn one_submission_of_many_pictures_equals_one_each_and_a_second_time() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    with_scene(&gpu, |contents| {
        // More views than the renderer starts with, so that its buffer grows.
        let views: Vec<_> = (0..12)
            .map(|k| Point3::new(0.1 * k as f32 - 0.5, 1.4, 0.9))
            .map(|eye| off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], -0.3, eye))
            .collect();
        let size = [80, 64];
        let targets: Vec<_> = views.iter().map(|_| Offscreen::new(&gpu, &renderer, size).unwrap()).collect();
        let viewports: Vec<_> = views.iter().map(|&view| Viewport::full(size, Some(view))).collect();
        let pictures: Vec<_> = targets.iter().zip(&viewports).map(|(t, v)| t.picture(v)).collect();
        renderer.draw(&gpu, &pictures, contents).unwrap();
        for (target, &view) in targets.iter().zip(&views) {
            let together = target.read(&gpu).unwrap().0;
            assert_eq!(together, draw_full(&gpu, &mut renderer, size, view, contents));
        }
    });
}

#[test]
fn an_absent_or_useless_view_is_black_and_its_neighbour_is_not() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    with_scene(&gpu, |contents| {
        let broken = View { clip_from_room: Matrix4::from_element(f32::NAN), ..eyes()[0] };
        for absent in [None, Some(broken)] {
            let viewports = side_by_side(SIZE, absent, Some(eyes()[1]));
            let image = draw(&gpu, &mut renderer, SIZE, &viewports, contents);
            for (x, _, pixel) in image.enumerate_pixels() {
                let is_black = pixel.0 == [0, 0, 0, 255];
                assert_eq!(is_black, x < SIZE[0] / 2, "column {x}: {:?}", pixel.0);
            }
        }
    });
}

/// The border of a slanted square holds mixed colours with four samples, and none with one.
#[test]
fn four_samples_smooth_an_edge() {
    let Some(gpu) = require_gpu() else { return };
    let mesh = square(0.2, [0.0; 3], [255, 255, 255, 0]);
    let buffers = mesh.buffers(&gpu);
    let room_from_body =
        Matrix4::new_translation(&Vector3::<f32>::y()) * Matrix4::new_rotation(Vector3::new(0.0, 0.0, 0.3));
    let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
    let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.0, 1.0, 0.8));
    let mixed = [1, 4].map(|samples| {
        let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples).unwrap();
        let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
        image.pixels().filter(|p| (8..150).contains(&p.0[1])).count()
    });
    assert!(mixed[0] == 0 && mixed[1] > 200, "mixed pixels with 1 and 4 samples: {mixed:?}");
}

/// Control elements keep their own colour up to a sharp border within the triangles that cross it.
#[test]
fn the_border_of_a_control_element_is_sharp_and_lies_halfway() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let mut mesh = square(0.4, [0.0, 1.0, 0.0], [0, 0, 255, 0]);
    for right in [1, 3] {
        mesh.colors[right] = [255, 0, 0, 255];
    }
    let buffers = mesh.buffers(&gpu);
    let bodies = [BodyInstance { buffers: &buffers, room_from_body: Matrix4::identity() }];
    let contents = FrameContents { bodies: &bodies, lighting: black_room(), ..FrameContents::default() };
    let view = off_axis(Point3::new(0.0, 1.0, 0.0), [1.0, 0.8], 0.0, Point3::new(0.0, 1.0, 0.8));
    let image = draw_full(&gpu, &mut renderer, SIZE, view, &contents);
    for x in 40..280 {
        let [r, _, b, _] = image.get_pixel(x, 100).0;
        match x {
            ..157 => assert!(b > 150 && r < 110, "column {x}: {r} {b}"),
            163.. => assert!(r > 150 && b < 110, "column {x}: {r} {b}"),
            _ => {}
        }
    }
}

/// Values are extrapolated with four samples where a pixel's middle lies outside its triangle; undoing the weights of the two
/// colours there once gave green and blue dots along the silhouette of a control element.
#[test]
fn red_bodies_have_no_coloured_dots_along_their_silhouette() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let mut mesh = bent_tube(20, 16);
    mesh.colors.iter_mut().for_each(|color| *color = [230, 0, 0, color[3]]);
    let buffers = mesh.buffers(&gpu);
    let grey = [0.3; 3];
    let lighting = Lighting { key: grey, fill: grey, sky: grey, ground: grey, ..black_room() };
    for step in 0..40 {
        let turn = Matrix4::new_rotation(Vector3::new(0.0, 0.15 * step as f32, 0.0));
        let room_from_body = Matrix4::new_translation(&Vector3::<f32>::y()) * turn;
        let bodies = [BodyInstance { buffers: &buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, lighting, ..FrameContents::default() };
        let image = draw_full(&gpu, &mut renderer, [160, 128], eyes()[0], &contents);
        let wrong = image.enumerate_pixels().find(|(_, _, p)| p.0[1].max(p.0[2]) > p.0[0]);
        assert_eq!(wrong, None, "step {step}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_its_numbers() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1).unwrap();
    let too_wide = [gpu.device.limits().max_texture_dimension_2d + 1, 16];
    for size in [too_wide, [0, 16], [16, 0]] {
        let error = Offscreen::new(&gpu, &renderer, size).err().unwrap().to_string();
        assert!(error.contains(&format!("{} × {}", size[0], size[1])), "{error}");
    }
    let target = Offscreen::new(&gpu, &renderer, [64, 32]).unwrap();
    for rect in [[60, 0, 8, 8], [0, 0, 0, 8], [u32::MAX, 0, 2, 2]] {
        let viewports = [Viewport { rect, view: None }];
        let drawn = renderer.draw(&gpu, &[target.picture(&viewports)], &FrameContents::default());
        assert!(matches!(drawn, Err(RenderError::ViewportOutside { .. })), "{rect:?}: {drawn:?}");
    }
    assert!(matches!(Renderer::new(&gpu, COLOR_FORMAT, 3), Err(RenderError::Samples { .. })));
    let mut smooth = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let drawn = smooth.draw(&gpu, &[target.picture(&[])], &FrameContents::default());
    assert!(matches!(drawn, Err(RenderError::SamplesDiffer { found: 1, expected: 4 })), "{drawn:?}");

    let grey = [[128, 128, 128, 0]; 3];
    assert!(matches!(BodyBuffers::new(&gpu, &[], &grey), Err(RenderError::EmptyBody { .. })));
    assert!(matches!(
        BodyBuffers::new(&gpu, &[[0, 1, 2], [0, 1, 3]], &grey),
        Err(RenderError::VertexOutOfRange { triangle: 1, vertex: 3, vertices: 3 })
    ));
    let mut body = BodyBuffers::new(&gpu, &[[0, 1, 2]], &grey).unwrap();
    let short = body.upload(&gpu, &[[0.0; 3]; 2], &[[0.0; 3]; 3]);
    assert!(matches!(short, Err(RenderError::VertexCount { found: 2, expected: 3, .. })));
    gpu.wait().unwrap();
}

/// Positions that are not numbers draw nothing, and break nothing.
#[test]
fn a_body_of_nan_does_no_harm() {
    let Some(gpu) = require_gpu() else { return };
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4).unwrap();
    let mut buffers = square(0.2, [0.0; 3], [255, 255, 255, 0]).buffers(&gpu);
    buffers.upload(&gpu, &[[f32::NAN; 3]; 4], &[[f32::INFINITY; 3]; 4]).unwrap();
    let bodies = [BodyInstance { buffers: &buffers, room_from_body: Matrix4::identity() }];
    let room_from_stylus = Matrix4::from_element(f32::NAN);
    let broken = StylusShape {
        room_from_stylus,
        size_m: 0.2,
        ray_length_m: 1.0,
        hit: None,
        bend: None,
        pressed: false,
    };
    let contents = FrameContents {
        bodies: &bodies,
        drawables: [&[Drawable::Stylus(broken)], &[]],
        ..FrameContents::default()
    };
    let image = draw_full(&gpu, &mut renderer, [64, 64], eyes()[0], &contents);
    let empty = draw_full(&gpu, &mut renderer, [64, 64], eyes()[0], &FrameContents::default());
    assert_eq!(image, empty);
}
