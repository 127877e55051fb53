//! Pieces that have fallen off a body. They are rigid: what nothing holds is not strained.
//!
//! In: a loose part of a cut mesh, and where its nodes were. Out: its surface, mass and moments, and its motion from frame to frame, under
//! gravity or with a hand, and against tools ([`super::landing`]). A piece starts at rest where it comes off, as all of a body without `dynamics` is at
//! rest in every frame.

use super::landing::{Drive, Motion, Obstacle, Solid};
use super::loose::shares;
use super::opened::Cuttable;
use crate::base::creases::Creases;
use crate::deform::vertex_normals;
use crate::fem::Polar;
use crate::interact::{PickShape, PickTarget};
use crate::mesh::split::{CutEdges, CutPoint, CutSurface, LoosePart, Split, TetCorner};
use crate::render::GhostShape;
use crate::scene::CREASE;
use crate::world::flight::RigidInertia;
use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Similarity3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Weight of the turn of the body's axes against that of the nodes, where these leave the turn open.
const AXES: f64 = 1e-6;
/// The longest step in which a piece moves, s: after a pause it goes on where it was.
const LONGEST_S: f64 = 0.1;

/// A piece that has fallen off.
pub struct Fallen {
    /// The lowest corner of a tetrahedron in it, by which it is known.
    pub corner: TetCorner,
    /// Nodes of the mesh at its corners.
    pub nodes: Vec<u32>,
    drawn: Arc<GhostShape>,
    /// Corners and triangles that a hand can take.
    corners: Vec<Vector3<f32>>,
    pickable: PickShape,
    /// Rest place of its middle about the body's centre, m.
    middle: V3,
    solid: Solid,
    pub motion: Motion,
}

/// Everything that moves pieces in a frame.
pub struct Falling<'a> {
    pub dt_s: f64,
    /// Acceleration in the room, m/s²; `None` where the body has no gravity, and what comes off stays where it is.
    pub gravity: Option<V3>,
    /// Size of the body in the room against its own.
    pub scale: f64,
    pub obstacles: &'a [Obstacle<'a>],
    /// Pieces that hands carry, and the poses in the room to which they bring them.
    pub carried: &'a [(TetCorner, Isometry3<f64>)],
}

impl Fallen {
    /// The pieces that a cut body has beyond those of an earlier cut, at rest where its mesh is.
    pub fn all(of: &Cuttable, (split, cut): (&Split, &CutEdges), before: &Split) -> Vec<Fallen> {
        let with_corners = |part| (part, LoosePart::corners(part, split));
        let mut parts: Vec<(&LoosePart, Vec<TetCorner>)> = split.loose.iter().map(with_corners).collect();
        parts.retain(|(_, corners)| corners.first().is_some_and(|corner| !before.is_loose_at(*corner)));
        if parts.is_empty() {
            return Vec::new();
        }
        let surface = of.matter.splitter.surface(split, cut);
        parts.iter().map(|(part, corners)| Fallen::new(of, (split, &surface), part, corners)).collect()
    }

    fn new(
        of: &Cuttable,
        (split, surface): (&Split, &CutSurface),
        part: &LoosePart,
        of_tets: &[TetCorner],
    ) -> Fallen {
        let count = of.matter.splitter.mesh.nodes.len();
        let has = |corners: &&[u32; 3]| part.nodes.binary_search(&surface.corner(corners[0], count)).is_ok();
        let place = |corner: u32| match (corner as usize).checked_sub(count) {
            None => of.matter.splitter.mesh.nodes[corner as usize] - of.matter.centre,
            Some(point) => {
                let CutPoint { nodes, share } = surface.points[point];
                let [a, b] = nodes.map(|node| of.matter.splitter.place(split, node));
                a.lerp(&b, share) - of.matter.centre
            }
        };
        let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
        let mut corners = Vec::new();
        let mut number = |corner: u32| {
            *numbers.entry(corner).or_insert_with(|| {
                corners.push(place(corner));
                corners.len() as u32 - 1
            })
        };
        let triangles: Vec<[u32; 3]> =
            surface.triangles.iter().filter(has).map(|corners| corners.map(&mut number)).collect();
        let mass: f64 =
            shares(split, part).map(|((tet, _), own)| of.matter.mass(tet) * own.iter().sum::<f64>()).sum();
        let (middle, inertia) = inertia_of(&corners, &triangles, mass);
        corners.iter_mut().for_each(|x| *x -= middle);
        let pickable = PickShape { triangles: triangles.clone(), points: Vec::new() };
        let drawn = Arc::new(shape(&corners, &triangles));
        let motion = Motion::at_rest(Isometry3::translation(middle.x, middle.y, middle.z));
        let corner = of_tets.first().copied().unwrap_or_default();
        let nodes: BTreeSet<u32> =
            of_tets.iter().map(|(tet, k)| of.matter.splitter.mesh.tets[*tet as usize][*k]).collect();
        let nodes = nodes.into_iter().collect();
        Fallen {
            corner,
            nodes,
            drawn,
            corners: corners.iter().map(|x| x.cast()).collect(),
            pickable,
            middle,
            solid: Solid { corners, inertia },
            motion,
        }
    }

    /// Mass, kg; 0 without gravity.
    #[cfg(test)]
    pub fn mass(&self) -> f64 {
        self.solid.inertia.map_or(0.0, |inertia| inertia.mass)
    }

    /// Puts the piece to where these places of its nodes were, by the rigid motion that fits best; about the body's centre, and in the
    /// room.
    pub fn put(&mut self, places: &[(V3, V3)], room_from_columns: &Similarity3<f64>) {
        let scale = room_from_columns.scaling();
        let count = places.len().max(1) as f64;
        let rest = places.iter().map(|(x, _)| x).sum::<V3>() / count;
        let room = places.iter().map(|(_, y)| y / scale).sum::<V3>() / count;
        let axes = room_from_columns.isometry.rotation;
        let spread: Matrix3<f64> =
            places.iter().map(|(x, y)| (y / scale - room) * (x - rest).transpose()).sum();
        let part = if spread.norm() > 0.0 { AXES * spread.norm() } else { 1.0 };
        let turned = Polar::new(&(spread + axes.to_rotation_matrix().matrix() * part));
        let turn = turned.map_or(axes, |polar| polar.turn());
        let place = match places.is_empty() {
            true => (room_from_columns * Point3::from(self.middle)).coords / scale,
            false => room + turn * (self.middle - rest),
        };
        self.motion = Motion::at_rest(Isometry3::from_parts(place.into(), turn));
    }

    /// Moves it on by a frame.
    pub fn fall(&mut self, falling: &Falling<'_>) {
        let Falling { gravity, scale, obstacles, carried, .. } = falling;
        let carried = carried.iter().find(|(corner, _)| *corner == self.corner);
        let drive = match (carried, gravity) {
            (Some((_, Isometry3 { translation, rotation })), _) => {
                Drive::Hand(Isometry3::from_parts((translation.vector / *scale).into(), *rotation))
            }
            (None, Some(gravity)) => Drive::Weight(*gravity),
            (None, None) => return,
        };
        let dt_s = falling.dt_s.min(LONGEST_S);
        if dt_s > 0.0 {
            let after = self.solid.moved(&self.motion, &drive, (obstacles, *scale), dt_s);
            if after.is_finite() {
                self.motion = after;
            }
        }
    }

    /// room_from_piece of a body of this size.
    fn room_from_piece(&self, scale: f64) -> Similarity3<f64> {
        let Isometry3 { translation, rotation } = self.motion.pose;
        Similarity3::from_parts((translation.vector * scale).into(), rotation, scale)
    }

    /// Surface, and room_from_shape.
    pub fn drawn(&self, scale: f64) -> (Arc<GhostShape>, Matrix4<f32>) {
        (self.drawn.clone(), self.room_from_piece(scale).to_homogeneous().cast())
    }

    /// The surface as a hand takes it.
    pub fn target(&self, scale: f64) -> PickTarget<'_> {
        PickTarget {
            shape: &self.pickable,
            positions: &self.corners,
            ball_radius_m: 0.0,
            room_from_body: self.room_from_piece(scale),
        }
    }
}

/// The middle of a closed surface, and the inertia of a body of this mass that fills it evenly, about its middle; `None` without mass or
/// volume. Integrals over tetrahedra from the origin: ∫ x xᵀ dV = V/20 (Σ x_i x_iᵀ + s sᵀ), s = Σ x_i.
fn inertia_of(corners: &[V3], triangles: &[[u32; 3]], mass: f64) -> (V3, Option<RigidInertia>) {
    let start = corners.first().copied().unwrap_or_default();
    let (mut volume, mut first, mut second) = (0.0, V3::zeros(), Matrix3::zeros());
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| corners[corner as usize] - start);
        let own = a.cross(&b).dot(&c) / 6.0;
        let sum = a + b + c;
        volume += own;
        first += sum * (own / 4.0);
        let squares = a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose();
        second += squares * (own / 20.0);
    }
    if volume.is_nan() || volume <= 0.0 {
        return (start, None);
    }
    let middle = first / volume;
    let density = mass / volume;
    let spread = (second - middle * middle.transpose() * volume) * density;
    let moments = Matrix3::from_diagonal_element(spread.trace()) - spread;
    let inertia = RigidInertia { mass, centre: V3::zeros(), moments };
    (start + middle, Some(inertia).filter(|inertia| inertia.mass > 0.0 && moments.try_inverse().is_some()))
}

/// The surface as it is drawn: smooth, but for edges that are folded sharply.
fn shape(corners: &[V3], triangles: &[[u32; 3]]) -> GhostShape {
    let mut positions: Vec<[f32; 3]> = corners.iter().map(|x| x.cast::<f32>().into()).collect();
    let mut triangles = triangles.to_vec();
    if let Some(creases) = Creases::new(&triangles, &positions, CREASE.to_radians()) {
        creases.extend(&mut positions);
        triangles = creases.triangles;
    }
    let mut normals = vec![[0.0; 3]; positions.len()];
    vertex_normals(&positions, &triangles, &mut Vec::new(), &mut normals);
    GhostShape { positions, normals, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Surface, block};
    use nalgebra::UnitQuaternion;

    /// A block off the origin: m (b² + c²)/12 about its middle.
    #[test]
    fn a_block_has_the_moments_of_a_cuboid() {
        let size = [0.3, 0.1, 0.06];
        let mesh = block(&Block { size, cells: [2, 1, 3] }).unwrap();
        let corners: Vec<V3> = mesh.nodes.iter().map(|x| x + V3::new(3.0, -1.0, 2.0)).collect();
        let surface = Surface::from_mesh(&mesh);
        let global = |triangle: &[u32; 3]| triangle.map(|corner| surface.nodes[corner as usize]);
        let triangles: Vec<[u32; 3]> = surface.triangles.iter().map(global).collect();
        let (middle, inertia) = inertia_of(&corners, &triangles, 1.2);
        let expected = corners.iter().sum::<V3>() / corners.len() as f64;
        let [a, b, c] = size.map(|side| side * side * 1.2 / 12.0);
        let moments = Matrix3::from_diagonal(&V3::new(b + c, a + c, a + b));
        let off = (inertia.unwrap().moments - moments).amax() / moments.amax();
        println!("middle off by {:e} m, moments by {off:e}", (middle - expected).norm());
        assert!((middle - expected).norm() < 4e-15 && off < 1e-14, "{middle}, {off:e}");
    }

    /// Nodes of a piece that has turned and shifted, and a single node, which goes with the body's axes.
    #[test]
    fn a_piece_comes_off_where_its_nodes_were() {
        let axes = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
        let room_from_columns = Similarity3::from_parts(V3::new(1.0, 2.0, 3.0).into(), axes, 2.0);
        let turn = UnitQuaternion::from_euler_angles(-0.4, 2.0, 0.5);
        let rest = [V3::x(), V3::y(), V3::z(), V3::zeros()];
        let solid = || Solid { corners: Vec::new(), inertia: None };
        let drawn = Arc::new(shape(&[], &[]));
        let motion = Motion::at_rest(Isometry3::identity());
        let middle = V3::new(0.2, 0.3, 0.1);
        for (count, expected) in [(4, turn), (1, axes)] {
            let mut piece = Fallen {
                corner: (0, 0),
                nodes: Vec::new(),
                drawn: drawn.clone(),
                corners: Vec::new(),
                pickable: PickShape::default(),
                middle,
                solid: solid(),
                motion,
            };
            let shift = V3::new(0.5, 0.0, -0.5);
            let places: Vec<(V3, V3)> =
                rest.iter().take(count).map(|x| (*x, (turn * x + shift) * 2.0)).collect();
            piece.put(&places, &room_from_columns);
            let Isometry3 { translation, rotation } = piece.motion.pose;
            println!("{count}: turned {:e} rad off", rotation.angle_to(&expected));
            assert!(rotation.angle_to(&expected) < 1e-5, "{count}: {rotation}");
            let [rest, room] = [places[0].0, places[0].1 / 2.0];
            let place = room + expected * (middle - rest);
            println!("{count}: {:e} m off", (translation.vector - place).norm());
            assert!((translation.vector - place).norm() < 3e-6, "{count}: {translation}");
        }
    }
}
