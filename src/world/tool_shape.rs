//! The shape of a tool: a core, thickened by a radius.
//!
//! In: a tool of the scene. Out: its signed distance φ(x) = ±|x - core(x)| - radius with ∇φ, negative inside, in the tool's own axes; the
//! point of a triangle that is nearest to the core; its surface for drawing. Because every shape is round, ∇φ is defined where it
//! touches.

use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::render::GhostShape;
use crate::scene::{Scene, ToolShape};
use nalgebra::{Rotation3, Vector3};
use parry3d::math::Vector as Vec3;
use parry3d::query::PointQuery;
use parry3d::shape::{TriMesh, TriMeshFlags};
use std::f64::consts::{PI, TAU};

type V3 = Vector3<f64>;

/// A tool's shape in its own axes, m.
pub struct Shape {
    core: Core,
    radius: f64,
}

enum Core {
    Point,
    /// The line from the origin to z = length.
    Segment {
        length: f64,
    },
    /// Lines from each point to the next one.
    Path {
        points: Vec<V3>,
    },
    /// Half sides.
    Box {
        half: V3,
    },
    Floor,
    Mesh(Box<MeshCore>),
}

struct MeshCore {
    solid: TriMesh,
    vertices: Vec<V3>,
    triangles: Vec<[u32; 3]>,
    /// Half sides of its bounding box.
    half: V3,
}

/// Steps at most, and the part of a length at which they end, towards the nearest point of a triangle.
const STEPS: usize = 60;
const NEAR: f64 = 1e-9;
/// Rings of the surface that is drawn, and side of a floor, m.
const RINGS: usize = 24;
pub const FLOOR_SIDE: f64 = 1.0;

impl Shape {
    /// The shape of the scene's tool of this name. The error says why its file is no closed surface.
    pub fn new(scene: &Scene, name: &str, shape: &ToolShape) -> Result<Shape, Failure> {
        Ok(match shape {
            ToolShape::Ball { radius } => Shape { core: Core::Point, radius: *radius },
            ToolShape::Capsule { radius, length } => {
                Shape { core: Core::Segment { length: *length }, radius: *radius }
            }
            ToolShape::Rod { radius, points } => {
                let points = points.iter().map(|point| V3::from(*point)).collect();
                Shape { core: Core::Path { points }, radius: *radius }
            }
            ToolShape::Box { size, radius } => {
                let radius = ToolShape::box_radius(size, *radius);
                let half = V3::from(*size) * 0.5 - V3::repeat(radius);
                Shape { core: Core::Box { half }, radius }
            }
            ToolShape::Floor => Shape { core: Core::Floor, radius: 0.0 },
            ToolShape::Blade { .. } => {
                let message = "a blade cuts bodies and touches none".to_owned();
                return Err(Failure::request(scene.invalid(&format!("tool.{name}.shape"), message)));
            }
            ToolShape::Mesh { file, unit, radius } => {
                let surface = scene.tool_surface(name, file, *unit).map_err(Failure::request)?;
                let (low, high) = bounding_box(&surface.vertices);
                let points = surface.vertices.iter().map(|x| Vec3::new(x.x as f32, x.y as f32, x.z as f32));
                let solid =
                    TriMesh::with_flags(points.collect(), surface.triangles.clone(), TriMeshFlags::ORIENTED);
                let solid = solid.map_err(|error| {
                    let message = format!("{} is no closed surface: {error}", file.display());
                    Failure::request(scene.invalid(&format!("tool.{name}.shape"), message))
                })?;
                let radius = ToolShape::mesh_radius((high - low).norm(), *radius);
                let (vertices, triangles) = (surface.vertices, surface.triangles);
                let half = (high - low) * 0.5;
                Shape { core: Core::Mesh(Box::new(MeshCore { solid, vertices, triangles, half })), radius }
            }
        })
    }

    /// φ and ∇φ at `x`, m.
    pub fn distance(&self, x: &V3) -> (f64, V3) {
        let (signed, normal) = match &self.core {
            Core::Floor => (x.y, V3::y()),
            Core::Box { half } => in_box(half, x),
            Core::Mesh(mesh) => mesh.distance(x),
            Core::Point | Core::Segment { .. } | Core::Path { .. } => {
                let away = x - self.nearest_of_core(x);
                let distance = away.norm();
                (distance, if distance > 0.0 { away / distance } else { V3::y() })
            }
        };
        (signed - self.radius, normal)
    }

    /// The point of the core that is nearest to `x`, on its surface where `x` lies inside.
    fn nearest_of_core(&self, x: &V3) -> V3 {
        match &self.core {
            Core::Point => V3::zeros(),
            Core::Segment { length } => V3::new(0.0, 0.0, x.z.clamp(0.0, *length)),
            Core::Path { points } => {
                let all = points.windows(2).map(|ends| nearest_of_line([&ends[0], &ends[1]], x));
                let nearer = |a: V3, b: V3| if (b - x).norm() < (a - x).norm() { b } else { a };
                all.reduce(nearer).unwrap_or_else(V3::zeros)
            }
            _ => {
                let (distance, normal) = self.distance(x);
                x - normal * (distance + self.radius)
            }
        }
    }

    /// Weights of the corners in the point of a triangle that is nearest to the core.
    pub fn nearest_of_triangle(&self, corners: &[V3; 3]) -> [f64; 3] {
        let Core::Path { points } = &self.core else {
            return self.nearest_between(corners, &|x| self.nearest_of_core(x));
        };
        // Each line by itself, for together they are not convex.
        let all = points.windows(2).map(|ends| {
            let weights = self.nearest_between(corners, &|x| nearest_of_line([&ends[0], &ends[1]], x));
            let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            ((at - nearest_of_line([&ends[0], &ends[1]], &at)).norm(), weights)
        });
        all.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or([1.0 / 3.0; 3], |(_, weights)| weights)
    }

    /// Weights of the corners in the point of a triangle that is nearest to a convex core, by projecting to and fro between the two.
    fn nearest_between(&self, corners: &[V3; 3], nearest_of_core: &dyn Fn(&V3) -> V3) -> [f64; 3] {
        let mut weights = [1.0 / 3.0; 3];
        let place = |w: &[f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
        for _ in 0..STEPS {
            let now = place(&weights);
            weights = nearest_weights(corners, &nearest_of_core(&now));
            if (place(&weights) - now).norm() <= NEAR * self.radius {
                break;
            }
        }
        weights
    }

    /// A length by which the tool may move without passing its own middle, m.
    pub fn thickness(&self) -> f64 {
        match &self.core {
            Core::Point | Core::Segment { .. } | Core::Path { .. } => self.radius,
            Core::Box { half } => self.radius + half.min(),
            Core::Floor => f64::INFINITY,
            Core::Mesh(mesh) => self.radius + 0.25 * mesh.half.min(),
        }
    }

    /// The least radius of curvature of its surface, m: an edge of a body that is longer may touch it between its ends.
    pub fn bluntness(&self) -> f64 {
        if matches!(self.core, Core::Floor) { f64::INFINITY } else { self.radius }
    }

    /// Largest distance of its points from its origin, m; 0 for a floor, which a turn hardly moves.
    pub fn reach(&self) -> f64 {
        self.radius
            + match &self.core {
                Core::Point | Core::Floor => 0.0,
                Core::Segment { length } => *length,
                Core::Path { points } => points.iter().map(V3::norm).fold(0.0, f64::max),
                Core::Box { half } => half.norm(),
                Core::Mesh(mesh) => mesh.vertices.iter().map(V3::norm).fold(0.0, f64::max),
            }
    }

    /// Surface for drawing; that of a floor is a square.
    pub fn surface(&self) -> GhostShape {
        let bits = |x: &V3| <[f32; 3]>::from(x.cast::<f32>());
        match &self.core {
            Core::Floor => {
                let h = FLOOR_SIDE / 2.0;
                let corners = [[-h, -h], [-h, h], [h, h], [h, -h]].map(|[x, z]| bits(&V3::new(x, 0.0, z)));
                let triangles = vec![[0, 1, 2], [0, 2, 3]];
                GhostShape { positions: corners.to_vec(), normals: vec![[0.0, 1.0, 0.0]; 4], triangles }
            }
            Core::Mesh(mesh) => {
                let mut normals = vec![V3::zeros(); mesh.vertices.len()];
                for triangle in &mesh.triangles {
                    let [a, b, c] = triangle.map(|node| mesh.vertices[node as usize]);
                    triangle.iter().for_each(|node| normals[*node as usize] += (b - a).cross(&(c - a)));
                }
                normals
                    .iter_mut()
                    .for_each(|normal| *normal = normal.try_normalize(0.0).unwrap_or_else(V3::y));
                let outer =
                    mesh.vertices.iter().zip(&normals).map(|(x, normal)| bits(&(x + normal * self.radius)));
                let positions = outer.collect();
                GhostShape {
                    positions,
                    normals: normals.iter().map(bits).collect(),
                    triangles: mesh.triangles.clone(),
                }
            }
            Core::Path { points } => self.rods(points),
            _ => self.round_surface(),
        }
    }

    /// The surfaces of capsules from each point to the next one.
    fn rods(&self, points: &[V3]) -> GhostShape {
        let mut all = GhostShape { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
        for ends in points.windows(2) {
            let along = ends[1] - ends[0];
            let straight = Shape { core: Core::Segment { length: along.norm() }, radius: self.radius };
            let GhostShape { positions, normals, triangles } = straight.round_surface();
            let turned = Rotation3::rotation_between(&V3::z(), &along);
            let turn = turned.unwrap_or_else(|| Rotation3::from_axis_angle(&V3::x_axis(), PI)).cast::<f32>();
            let from = ends[0].cast::<f32>();
            let first = all.positions.len() as u32;
            all.triangles.extend(triangles.iter().map(|triangle| triangle.map(|node| node + first)));
            all.positions.extend(positions.iter().map(|x| <[f32; 3]>::from(turn * Vector3::from(*x) + from)));
            all.normals.extend(normals.iter().map(|n| <[f32; 3]>::from(turn * Vector3::from(*n))));
        }
        all
    }

    /// The surface of a convex core: the farthest point of the core along each direction, and the radius along it.
    fn round_surface(&self) -> GhostShape {
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        let around = 2 * RINGS;
        for ring in 0..=RINGS {
            for step in 0..=around {
                // No direction lies in a plane of symmetry, where the farthest point would be two.
                let high = (ring as f64 / RINGS as f64 * PI).clamp(1e-6, PI - 1e-6);
                let turn = (step as f64 + 0.5) / around as f64 * TAU;
                let normal = V3::new(high.sin() * turn.cos(), high.sin() * turn.sin(), (high + 1e-6).cos());
                let far = match &self.core {
                    Core::Segment { length } => V3::z() * if normal.z > 0.0 { *length } else { 0.0 },
                    Core::Box { half } => half.zip_map(&normal, |half, along| half * along.signum()),
                    _ => V3::zeros(),
                };
                positions.push(<[f32; 3]>::from((far + normal * self.radius).cast::<f32>()));
                normals.push(<[f32; 3]>::from(normal.cast::<f32>()));
                if ring < RINGS && step < around {
                    let a = (ring * (around + 1) + step) as u32;
                    let b = a + around as u32 + 1;
                    triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
                }
            }
        }
        // The two ends of a box are faces, not points.
        let last = (RINGS * (around + 1)) as u32;
        for step in 1..around as u32 {
            triangles.extend([[0, step, step + 1], [last, last + step + 1, last + step]]);
        }
        GhostShape { positions, normals, triangles }
    }
}

impl MeshCore {
    fn distance(&self, x: &V3) -> (f64, V3) {
        let found = self.solid.project_local_point(Vec3::new(x.x as f32, x.y as f32, x.z as f32), false);
        let on = V3::new(found.point.x.into(), found.point.y.into(), found.point.z.into());
        let sign = if found.is_inside { -1.0 } else { 1.0 };
        let away = x - on;
        let distance = away.norm();
        (sign * distance, if distance > 0.0 { away * (sign / distance) } else { V3::y() })
    }
}

/// The point of a line between two ends that is nearest to `x`.
fn nearest_of_line([a, b]: [&V3; 2], x: &V3) -> V3 {
    let along = b - a;
    let share = (x - a).dot(&along) / along.norm_squared();
    // Two ends in one place are a ball.
    a + along * if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
}

/// Signed distance of a box, and its gradient.
fn in_box(half: &V3, x: &V3) -> (f64, V3) {
    let beyond = x.abs() - half;
    let outside = beyond.map(|b| b.max(0.0));
    let sign = x.map(f64::signum);
    let distance = outside.norm();
    if distance > 0.0 {
        return (distance, outside.component_mul(&sign) / distance);
    }
    let axis = beyond.imax();
    let mut normal = V3::zeros();
    normal[axis] = sign[axis];
    (beyond[axis], normal)
}

/// Weights of the corners in the point of a triangle that is nearest to `x` (C. Ericson, Real-Time Collision Detection, section 5.1.5).
pub fn nearest_weights([a, b, c]: &[V3; 3], x: &V3) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let along = |from: &V3| (ab.dot(&(x - from)), ac.dot(&(x - from)));
    let ((a1, a2), (b1, b2), (c1, c2)) = (along(a), along(b), along(c));
    if a1 <= 0.0 && a2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    if b1 >= 0.0 && b2 <= b1 {
        return [0.0, 1.0, 0.0];
    }
    if c2 >= 0.0 && c1 <= c2 {
        return [0.0, 0.0, 1.0];
    }
    let of_c = a1 * b2 - b1 * a2;
    if of_c <= 0.0 && a1 >= 0.0 && b1 <= 0.0 {
        let share = a1 / (a1 - b1);
        return [1.0 - share, share, 0.0];
    }
    let of_b = c1 * a2 - a1 * c2;
    if of_b <= 0.0 && a2 >= 0.0 && c2 <= 0.0 {
        let share = a2 / (a2 - c2);
        return [1.0 - share, 0.0, share];
    }
    let of_a = b1 * c2 - c1 * b2;
    if of_a <= 0.0 && b2 >= b1 && c1 >= c2 {
        let share = (b2 - b1) / ((b2 - b1) + (c1 - c2));
        return [0.0, 1.0 - share, share];
    }
    let sum = of_a + of_b + of_c;
    [of_a / sum, of_b / sum, of_c / sum]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use std::path::Path;

    /// A tetrahedron, also with its faces turned inward, and with a face left out.
    const FACES: [&str; 3] = [
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n",
        "f 1 3 2\nf 1 2 4\nf 1 4 3\n",
    ];

    fn made(kind: &ToolShape, faces: &str) -> Result<Shape, Failure> {
        let folder = tempfile::tempdir().unwrap();
        let text = format!("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\n{faces}");
        std::fs::write(folder.path().join("wedge.obj"), text).unwrap();
        let scene = Scene::parse(
            "[body.b]\nmesh = \"b.msh\"\nmaterial = { young = 1.0, poisson = 0.3 }\n[body.b.control]\n\
             a = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n",
            &folder.path().join("s.toml"),
        );
        Shape::new(&scene.unwrap(), "t", kind)
    }

    fn wedge() -> ToolShape {
        ToolShape::Mesh { file: Path::new("wedge.obj").to_owned(), unit: None, radius: Some(0.1) }
    }

    fn shapes() -> Vec<Shape> {
        let kinds = [
            ToolShape::Ball { radius: 0.7 },
            ToolShape::Capsule { radius: 0.3, length: 1.5 },
            ToolShape::Box { size: [1.0, 2.0, 1.4], radius: Some(0.2) },
            ToolShape::Floor,
            wedge(),
            ToolShape::Rod {
                radius: 0.2,
                points: vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.7, 1.3], [0.0, 0.9, 0.4]],
            },
        ];
        kinds.iter().map(|kind| made(kind, FACES[0]).unwrap()).collect()
    }

    #[test]
    fn a_mesh_is_turned_outward_and_an_open_one_is_refused() {
        let [outward, turned] = [0, 1].map(|faces| made(&wedge(), FACES[faces]).unwrap());
        for x in [V3::new(0.3, 0.3, 0.3), V3::new(1.0, 2.0, 3.0), V3::new(-1.0, 0.1, 0.2)] {
            assert_eq!(outward.distance(&x), turned.distance(&x));
        }
        let error = made(&wedge(), FACES[2]).err().unwrap().to_string();
        assert!(error.contains("tool.t.shape: wedge.obj: the surface is not closed: 1 hole"), "{error}");
    }

    /// φ is a distance: |∇φ| = 1, and going by φ against ∇φ leads to the surface.
    #[test]
    fn the_distance_leads_to_the_surface() {
        let mut random = Random::default();
        for (number, shape) in shapes().iter().enumerate() {
            let exact = if number == 4 { 1e-5 } else { 1e-12 };
            for _ in 0..300 {
                let x = V3::from_fn(|_, _| 5.0 * random.draw());
                let (distance, normal) = shape.distance(&x);
                assert!((normal.norm() - 1.0).abs() < 1e-9, "shape {number} at {x}");
                let (on, _) = shape.distance(&(x - normal * distance));
                // Inside a core, the nearest way out may lead past an edge.
                let is_outside = distance > -shape.radius;
                assert!(!is_outside || on.abs() < exact, "shape {number} at {x}: {distance} m, then {on:e}");
            }
        }
    }

    #[test]
    fn known_distances() {
        let shapes = shapes();
        for (number, x, expected) in [
            (0, V3::new(0.0, 2.0, 0.0), 1.3),
            (1, V3::new(0.0, 1.0, 1.0), 0.7),
            (1, V3::new(0.0, 0.0, -1.0), 0.7),
            (2, V3::new(1.5, 0.0, 0.0), 1.0),
            (2, V3::new(0.0, 0.0, 0.5), -0.2),
            (3, V3::new(4.0, -0.25, 3.0), -0.25),
            (4, V3::new(0.5, 0.5, -1.0), 0.9),
            (4, V3::new(0.3, 0.3, 0.3), -0.4),
            (5, V3::new(0.5, 0.0, 0.5), 0.3),
            (5, V3::new(0.0, 1.9, 0.4), 0.8),
        ] {
            let (distance, _) = shapes[number].distance(&x);
            assert!((distance - expected).abs() < 1e-6, "shape {number} at {x}: {distance}, not {expected}");
        }
    }

    /// No point of a triangle is nearer than the one found, of many that are tried.
    #[test]
    fn the_nearest_point_of_a_triangle() {
        let mut random = Random::default();
        for (number, shape) in shapes().iter().enumerate().filter(|(number, _)| [0, 1, 2, 5].contains(number))
        {
            for _ in 0..40 {
                let away = V3::new(0.0, 3.0, 0.0);
                let corners = [(); 3].map(|()| away + V3::from_fn(|_, _| 3.0 * random.draw()));
                let at = |w: [f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
                let weights = shape.nearest_of_triangle(&corners);
                assert!(
                    (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && weights.iter().all(|w| *w >= 0.0)
                );
                let (least, _) = shape.distance(&at(weights));
                for i in 0..=40 {
                    for j in 0..=40 - i {
                        let (a, b) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                        let (other, _) = shape.distance(&at([a, b, 1.0 - a - b]));
                        assert!(other > least - 1e-4, "shape {number}: {other} m is nearer than {least}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_drawn_lies_on_the_surface() {
        for (number, shape) in shapes().iter().enumerate() {
            let drawn = shape.surface();
            for (x, normal) in drawn.positions.iter().zip(&drawn.normals) {
                let (distance, _) = shape.distance(&V3::from(x.map(f64::from)));
                // Corners of a thickened mesh are cut off.
                let exact = if number == 4 { shape.radius } else { 1e-6 };
                // The ends of a bent rod's straight parts lie in one another.
                let is_within = number == 5 && distance > -shape.radius && distance < 0.0;
                assert!(
                    distance.abs() < exact || is_within,
                    "shape {number}: {distance} m off at {x:?}, {normal:?}"
                );
            }
            for [a, b, c] in &drawn.triangles {
                let [x, y, z] =
                    [a, b, c].map(|node| V3::from(drawn.positions[*node as usize].map(f64::from)));
                let (area, out) =
                    ((y - x).cross(&(z - x)), V3::from(drawn.normals[*a as usize].map(f64::from)));
                assert!(
                    area.norm() < 1e-9 || area.dot(&out) > -1e-9,
                    "shape {number}: a triangle faces inward"
                );
            }
        }
    }

    #[test]
    fn what_is_drawn_encloses_the_shape() {
        let cut = |length: f64| length - 0.4;
        let [x, y, z] = [1.0, 2.0, 1.4].map(cut);
        let rounded =
            x * y * z + 0.4 * (x * y + y * z + z * x) + PI * 0.04 * (x + y + z) + 4.0 / 3.0 * PI * 0.008;
        let ball = |radius: f64| 4.0 / 3.0 * PI * radius.powi(3);
        let capsule = ball(0.3) + PI * 0.09 * 1.5;
        for (shape, expected) in shapes().iter().zip([ball(0.7), capsule, rounded]) {
            let GhostShape { positions, triangles, .. } = shape.surface();
            let at = |node: u32| V3::from(positions[node as usize].map(f64::from));
            let volume: f64 =
                triangles.iter().map(|[a, b, c]| at(*a).dot(&at(*b).cross(&at(*c))) / 6.0).sum();
            assert!((volume / expected - 1.0).abs() < 0.02, "{volume} m³, not {expected}");
        }
    }
}
