//! Places the bodies of a scene on a stage, by the keys of their `place` and, for what those leave out, in sight.
//!
//! In: bodies with the points of their meshes. Out: room_from_mesh of each; in words, the part of a body that is not in
//! sight, with a place that is; and the depths to which bodies reach into each other where they stand at rest.

use crate::base::extent::bounding_box;
use crate::mesh::isosurface_stuffing::lattice::Depth;
use crate::mesh::surface_files::TriangleSurface;
use crate::scene::{Body, Place};
use crate::stage::{GivenPlace, HiddenPart, Stage, place_line};
use nalgebra::{Point3, Similarity3, UnitQuaternion, Vector3};

/// Bodies without a place are fitted together, as one; each other one by itself, with the keys of its place.
pub fn rooms_from_meshes(bodies: &[(&Body, &[Point3<f64>])], stage: &Stage) -> Vec<Similarity3<f64>> {
    let unplaced = || bodies.iter().filter(|(body, _)| body.place.is_none());
    let together: Vec<Point3<f64>> = unplaced().flat_map(|(_, points)| points.iter().copied()).collect();
    let rotation = unplaced().find_map(|(body, _)| rotation(body));
    let fitted = fitted(&together, &GivenPlace { rotation, ..GivenPlace::default() }, stage);
    let of = |(body, points): &(&Body, &[Point3<f64>])| match &body.place {
        None => fitted,
        Some(place) => self::fitted(points, &given(body, place), stage),
    };
    bodies.iter().map(of).collect()
}

fn fitted(points: &[Point3<f64>], given: &GivenPlace, stage: &Stage) -> Similarity3<f64> {
    stage.room_from_mesh(points, given).unwrap_or_else(Similarity3::identity)
}

/// The turn of a body, where that is not to be chosen: weight pulls it down its mesh's own y axis, on every stage.
fn rotation(body: &Body) -> Option<UnitQuaternion<f64>> {
    let given = body.place.and_then(|place| place.rotation);
    let given = given.map(|turn| UnitQuaternion::from_scaled_axis(Vector3::from(turn)));
    given.or_else(|| body.gravity.map(|_| UnitQuaternion::identity()))
}

fn given(body: &Body, place: &Place) -> GivenPlace {
    let position = place.position.map(Vector3::from);
    GivenPlace { position, rotation: rotation(body), scale: place.scale }
}

/// Names what is wrong with the place of a body, with the numbers, and a line that mends it.
pub fn fault(points: &[Point3<f64>], room_from_mesh: &Similarity3<f64>, stage: &Stage) -> Option<String> {
    let placed: Vec<Point3<f64>> = points.iter().map(|x| room_from_mesh * x).collect();
    let standing = stage.standing(&placed)?;
    if standing.is_right(stage) {
        return None;
    }
    let HiddenPart { unseen, sunk, size_m, middle } = &standing;
    let width_m = 2.0 * stage.workspace.radius_m;
    let mut wrong = Vec::new();
    if *unseen > 0.005 {
        let Point3 { coords: m } = middle;
        wrong.push(format!(
            "{:.0} % of it is on no screen for both eyes (its middle is at ({:.3}, {:.3}, {:.3}) m)",
            (100.0 * unseen).max(1.0),
            m.x,
            m.y,
            m.z
        ));
    }
    if let Some((what, deep)) = sunk {
        wrong.push(format!("it reaches {:.0} mm below {what}", (1e3 * deep).max(1.0)));
    }
    if *size_m > 1.03 * width_m {
        wrong.push(format!("it is {size_m:.3} m long in a workspace of {width_m:.3} m"));
    }
    let rotation = Some(room_from_mesh.isometry.rotation);
    let fitted = stage.room_from_mesh(points, &GivenPlace { rotation, ..GivenPlace::default() })?;
    let remedy = place_line(&fitted);
    Some(format!(
        "{}. Remove its `place`, and it is put where it is seen; or write {remedy}",
        wrong.join("; ")
    ))
}

/// Bodies that touch, or stand in each other by less than this part of the smaller one's size, are not reported.
const TOUCHING: f64 = 0.01;

/// Pairs of surfaces (closed, in one frame, m, oriented outward), by their numbers, of which one has a vertex inside the
/// other, and the depth of the deepest such vertex below the other's surface, m.
pub fn overlaps(surfaces: &[TriangleSurface]) -> Vec<([usize; 2], f64)> {
    let boxes: Vec<_> = surfaces.iter().map(|surface| bounding_box(&surface.vertices)).collect();
    let depths: Vec<Option<Depth<'_>>> = surfaces.iter().map(|surface| Depth::new(surface).ok()).collect();
    let reach = |from: usize, into: usize| -> f64 {
        let (Some(depth), (low, high)) = (&depths[into], &boxes[into]) else { return 0.0 };
        let is_near = |x: &&nalgebra::Vector3<f64>| (0..3).all(|i| low[i] < x[i] && x[i] < high[i]);
        surfaces[from].vertices.iter().filter(is_near).map(|x| depth.at(x)).fold(0.0, f64::max)
    };
    let size = |of: usize| (boxes[of].1 - boxes[of].0).amax();
    let mut found = Vec::new();
    for one in 0..surfaces.len() {
        for other in one + 1..surfaces.len() {
            let depth = reach(one, other).max(reach(other, one));
            if depth > TOUCHING * size(one).min(size(other)) {
                found.push(([one, other], depth));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Surface, block};
    use crate::scene::Scene;
    use nalgebra::Vector3;
    use std::path::Path;

    fn body(place: &str) -> Body {
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [0.2, 1.0, 0.2], cells = [1, 5, 1] }} }}\n\
             material = {{ young = 1e6, poisson = 0.3, density = 1e3 }}\n{place}\n[body.a.control.c]\nnodes = {{ group = \"ymin\" }}\n\
             grab = \"fixed\"\n"
        );
        Scene::parse(&text, Path::new("a.toml")).unwrap().body["a"].clone()
    }

    fn rod() -> Vec<Point3<f64>> {
        let corner = |k: usize| {
            Vector3::new(0.1, 0.5, 0.1)
                .map_with_location(|axis, _, half| if k >> axis & 1 == 0 { -half } else { half })
        };
        (0..8).map(|k| Point3::from(corner(k))).collect()
    }

    /// The message suggests a place that is in sight.
    #[test]
    fn the_line_to_paste_mends_the_place() {
        let (stage, points) = (Stage::find("workbench").unwrap(), rod());
        for (place, words) in [
            ("place = { scale = 2.0 }", "it is 2.000 m long in a workspace of 0.700 m"),
            ("place = { position = [0.0, 0.9, 0.5], scale = 0.3 }", "it reaches 150 mm below screen `table`"),
            ("place = { position = [3.0, 1.2, 0.5], scale = 0.3 }", "100 % of it is on no screen"),
        ] {
            let body = body(place);
            let of = |body: &Body| rooms_from_meshes(&[(body, &points)], &stage)[0];
            let wrong = fault(&points, &of(&body), &stage).unwrap();
            assert!(wrong.contains(words), "{place}: {wrong}");
            let line = &wrong[wrong.find("place = {").unwrap()..];
            assert_eq!(fault(&points, &of(&self::body(line)), &stage), None, "{line}");
        }
    }

    /// A pose file's gravity, along the mesh's axes, would otherwise differ from that of a session.
    #[test]
    fn a_body_with_weight_is_not_turned() {
        let (stage, points) = (Stage::find("desktop").unwrap(), rod());
        let turn = |keys: &str| {
            rooms_from_meshes(&[(&body(keys), &points)], &stage)[0].isometry.rotation.angle().to_degrees()
        };
        let weight = "gravity = true\n";
        assert_eq!([turn("").round(), turn(weight)], [90.0, 0.0], "a rod lies across the view");
        assert!((turn(&format!("{weight}place = {{ rotation = [0.0, 0.0, 1.0] }}")) - 57.296).abs() < 1e-3);
        assert_eq!(turn(&format!("{weight}place = {{ scale = 0.1 }}")), 0.0);
    }

    #[test]
    fn bodies_without_a_place_keep_their_places_to_each_other() {
        let (stage, points) = (Stage::find("desktop").unwrap(), rod());
        let beside: Vec<_> = points.iter().map(|x| x + Vector3::x()).collect();
        let [plain, placed] = ["", "place = { scale = 0.05 }"].map(body);
        let all = [(&plain, &points[..]), (&placed, &points[..]), (&plain, &beside[..])];
        let places = rooms_from_meshes(&all, &stage);
        assert_eq!(places[0], places[2]);
        assert_eq!((places[1].scaling(), places[0] == places[1]), (0.05, false));
    }

    fn cube(corner: f64, side: f64) -> TriangleSurface {
        let mesh = block(&Block { size: [side; 3], cells: [4; 3] }).unwrap();
        let Surface { triangles, nodes } = Surface::from_mesh(&mesh);
        let (low, _) = bounding_box(&mesh.nodes);
        let at = |node: &u32| mesh.nodes[*node as usize] - low + Vector3::repeat(corner);
        TriangleSurface { vertices: nodes.iter().map(at).collect(), triangles }
    }

    #[test]
    fn bodies_in_each_other_are_found_with_their_depth() {
        let found = overlaps(&[cube(0.0, 1.0), cube(0.75, 1.0), cube(5.0, 1.0), cube(5.4, 0.2)]);
        let pairs: Vec<[usize; 2]> = found.iter().map(|(pair, _)| *pair).collect();
        assert_eq!(pairs, [[0, 1], [2, 3]]);
        // The corner (0.75, 0.75, 0.75) is a quarter below three faces; the small cube's corners nearest to the middle 0.4.
        assert!((found[0].1 - 0.25).abs() < 1e-6, "{}", found[0].1);
        assert!((found[1].1 - 0.4).abs() < 1e-6, "{}", found[1].1);
    }

    #[test]
    fn bodies_that_touch_pass() {
        assert_eq!(overlaps(&[cube(0.0, 1.0), cube(1.0, 1.0), cube(1.995, 1.0)]), []);
    }
}
