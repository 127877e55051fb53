//! Lays the ruler by [`Action::Measure`](crate::interact::Action::Measure), and draws it as two balls, a line and a plate.
//!
//! In: the ray of the stylus to which keys refer. Out: the ends of a [`Ruler`]. Nothing is done in a frame without one.

use super::ruler::{Ruler, RulerLengths, SurfacePoint};
use super::running::World;
use crate::base::plates::{Anchor, Plate};
use crate::render::{Ball, Drawable, Line};
use nalgebra::Point3;

/// Radius of the balls at its ends, against the workspace's.
const END: f64 = 0.02;
/// Linear.
const COLOR: [f32; 3] = [0.95, 0.80, 0.25];

impl World {
    /// The ruler's distances, once it has two ends.
    pub fn measured(&self) -> Option<RulerLengths> {
        let [a, b] = self.edit.ruler.ends[..] else { return None };
        let (one, two) = (&self.bodies[a.body], &self.bodies[b.body]);
        let ([now_a, rest_a], [now_b, rest_b]) = (a.places(one), b.places(two));
        let is_of_one_body = a.body == b.body;
        let apart = |x: Point3<f64>, y: Point3<f64>| match is_of_one_body {
            true => (x - y).norm(),
            false => (one.room_from_body * x - two.room_from_body * y).norm(),
        };
        Some(RulerLengths { now_m: apart(now_a, now_b), rest_m: apart(rest_a, rest_b), is_of_one_body })
    }

    /// Sets the next end where the ray hits a surface, or takes a whole ruler away.
    pub(super) fn measure(&mut self) {
        if self.edit.ruler.ends.len() == 2 {
            self.edit.ruler = Ruler::default();
            return;
        }
        match self.cursor().and_then(|stylus| self.pointed_surface(stylus)) {
            Some(point) => self.edit.ruler.ends.push(point),
            None => self.warn("ruler: the ray hits no surface".into()),
        }
    }

    /// The points of surfaces that the rays of tracked styli hit first.
    pub fn pointed_surfaces(&self) -> Vec<SurfacePoint> {
        self.tracked().filter_map(|stylus| self.pointed_surface(stylus)).collect()
    }

    /// The point of a surface that the ray of a stylus hits first.
    fn pointed_surface(&self, stylus: usize) -> Option<SurfacePoint> {
        let hit = self.hit_anywhere(stylus)?;
        let body = &self.bodies[hit.target];
        let place = body.room_from_body.inverse() * hit.point_in_room.cast::<f64>();
        SurfacePoint::nearest(hit.target, body, &place.coords)
    }

    /// Draws the ruler, where there is one.
    pub(super) fn show_ruler(&mut self) {
        if self.edit.ruler.ends.is_empty() {
            return;
        }
        let in_room = |end: &SurfacePoint| {
            let body = &self.bodies[end.body];
            body.room_from_body * end.places(body)[0]
        };
        let ends: Vec<Point3<f64>> = self.edit.ruler.ends.iter().map(in_room).collect();
        let radius_m = (END * self.assets.stage.workspace.radius_m) as f32;
        for end in &ends {
            self.frame.draw(Drawable::Ball(Ball { center: end.cast(), radius_m, color: COLOR }));
        }
        let plate = match (&ends[..], self.measured()) {
            ([a, b], Some(measured)) => {
                let [red, green, blue] = COLOR;
                let line =
                    |(opacity, over)| Line { over, ..Line::new(*a, *b, [red, green, blue, opacity], 3.0) };
                self.frame.draw(Drawable::Lines([(1.0, 0.0), (0.35, 1.0)].map(line).to_vec()));
                Plate::new(Anchor::Place(nalgebra::center(a, b).into()), measured.words())
            }
            _ => Plate::new(Anchor::Place(ends[0].into()), "ruler: M again sets the other end"),
        };
        self.frame.draw(Drawable::Plate(plate));
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::world;
    use super::*;
    use crate::deform::ControlPose;
    use crate::interact::Action;
    use crate::stage::rotation_towards;
    use crate::track::{StylusState, TrackerState};
    use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};

    /// A ray from above onto the block of 2 × 1 × 1 m at these places along it and across, m of the block.
    fn aim(world: &mut World, x: f64, z: f64) {
        let room = world.bodies[0].room_from_body;
        let (from, to) = (room * Point3::new(x, 3.0, z), room * Point3::new(x, 0.0, z));
        let rotation = rotation_towards(&(to - from), 0.0).unwrap();
        let room_from_stylus = Isometry3::from_parts(Translation3::from(from.coords), rotation).cast();
        let styli = vec![StylusState { room_from_stylus, ..StylusState::default() }];
        world.step(&TrackerState { head: None, styli, time_s: 0.0 }.into());
    }

    /// A turn of both ends turns the whole block, which changes no distance; a stretch moves the points at its ends by itself.
    #[test]
    fn the_ruler_follows_the_material_through_an_affine_motion() {
        let mut world = world();
        aim(&mut world, -0.3, 0.2);
        world.carry_out(Action::Measure);
        aim(&mut world, 0.45, -0.35);
        assert!(
            world.measured().is_none()
                && world.frame.all(Drawable::plate).count() == 1
                && world.frame.all(Drawable::ball).count() == 1
        );
        world.carry_out(Action::Measure);
        let rest = Vector3::new(0.75, 0.0, -0.55);
        let told = |world: &World| -> RulerLengths { world.measured().unwrap() };
        assert!((told(&world).now_m - f64::hypot(rest.x, rest.z)).abs() < 1e-5, "{:?}", told(&world));

        // A turn and a shift of the whole: nothing changes.
        let turn = *nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 0.5).matrix();
        let pose_of = |world: &World, e: usize, matrix: Matrix3<f64>| {
            let origin = world.bodies[0].deformer.controls[e].origin;
            ControlPose { translation: matrix * origin - origin, matrix }
        };
        let posed = |world: &mut World, matrix: Matrix3<f64>| {
            let poses = [0, 1].map(|e| pose_of(world, e, matrix));
            world.bodies[0].deformer.evaluate(&poses);
        };
        posed(&mut world, turn);
        let RulerLengths { now_m, rest_m, .. } = told(&world);
        assert!((now_m - rest_m).abs() < 1e-5, "{now_m} m, {rest_m} m");
        // Stretched along x the free sides draw in; the held ends do not, and go where the map has them.
        world.carry_out(Action::Measure);
        assert!(world.measured().is_none(), "the third time takes it away");
        posed(&mut world, Matrix3::identity());
        for x in [-0.999, 0.999] {
            aim(&mut world, x, 0.1);
            world.carry_out(Action::Measure);
        }
        let stretch = Matrix3::from_diagonal(&Vector3::new(1.1, 1.0, 1.0));
        posed(&mut world, stretch);
        let RulerLengths { now_m, rest_m, .. } = told(&world);
        assert!(
            (rest_m - 1.998).abs() < 1e-4 && (now_m / rest_m - 1.1).abs() < 1e-3,
            "{now_m} m, {rest_m} m"
        );
        aim(&mut world, 0.0, 0.0);
        assert_eq!(
            (
                world.frame.all(Drawable::lines).flatten().count(),
                world.frame.all(Drawable::ball).count(),
                world.frame.all(Drawable::plate).count()
            ),
            (2, 2, 1)
        );
        let words = &world.frame.all(Drawable::plate).next().unwrap().lines[0][0].0;
        assert!(words.contains(", at rest 2.00 m: +"), "{words}");
        world.carry_out(Action::Reset);
        aim(&mut world, 0.0, 0.0);
        assert!(
            world.frame.all(Drawable::plate).next().is_none()
                && world.frame.all(Drawable::lines).next().is_none(),
            "as at the start"
        );
    }

    #[test]
    fn a_ray_that_hits_nothing_sets_no_end() {
        let mut world = world();
        aim(&mut world, 5.0, 0.0);
        world.carry_out(Action::Measure);
        assert!(world.edit.ruler == Ruler::default() && world.warnings.len() == 1);
    }
}
