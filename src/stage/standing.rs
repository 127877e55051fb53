//! Places a body on a stage: fitted into what both eyes see, above table and floor; and finds what of it is not there.
//!
//! In: points of a body in its mesh's frame, and the keys of its place that are given. Out: room_from_mesh; or, for points in the
//! room, [`HiddenPart`]: how many are on no screen, and how far they reach below table or floor. All for the viewer where the stage
//! file has it.

use super::description::Stage;
use super::screen::{NEAR_M, Screen};
use nalgebra::{
    Isometry3, Matrix4, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3, Vector4,
};
use std::f64::consts::{FRAC_PI_2, TAU};

/// The keys of a place that are given; the others are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GivenPlace {
    /// Position of the mesh's origin in the room, m.
    pub position: Option<Vector3<f64>>,
    pub rotation: Option<UnitQuaternion<f64>>,
    pub scale: Option<f64>,
}

/// The part of a body that a viewer does not see where it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenPart {
    /// The part of the points that are on no screen for one of the eyes, or nearer to it than is drawn.
    pub unseen: f64,
    /// The table, or the floor below the grid, into which it reaches farthest, and how far, m.
    pub sunk: Option<(String, f64)>,
    /// The body's longest side along the room's axes, m.
    pub size_m: f64,
    pub middle: Point3<f64>,
}

/// Ratio of the longest side to the next from which a body is a rod.
const ROD: f64 = 3.0;
/// Ratio of the middle side to the shortest from which a body is a plate.
const PLATE: f64 = 3.0;
/// Deeper than wide by more than this, a body is turned about the vertical.
const DEEP: f64 = 1.25;
/// Factor by which the visible space exceeds a fitted body.
const SPARE: f64 = 1.03;
/// Points up to here, in half widths and heights of a screen, may lie behind a bezel.
const ABOUT_SHOWN: f64 = 1.02;
/// A screen whose normal points up by more than this is a table or a floor.
const LEVEL: f64 = 0.5;
/// Smallest depth of sinking that is reported, m.
const SUNK_M: f64 = 1e-3;
/// Halvings between the smallest and the largest scale: to a thousandth.
const HALVINGS: usize = 14;
const LEAST: f64 = 0.01;

/// Depth of a point below a table or a floor, m.
type Depth<'a> = Box<dyn Fn(&Point3<f64>) -> f64 + 'a>;

impl HiddenPart {
    /// Whether nothing is wrong: all but some points at the border are seen, and nothing is sunk.
    pub fn is_right(&self, stage: &Stage) -> bool {
        self.unseen <= 0.005 && self.sunk.is_none() && self.size_m <= 2.0 * SPARE * stage.workspace.radius_m
    }
}

impl Stage {
    /// room_from_mesh of a body. What is not given is chosen:
    ///
    /// - rotation: a rod (its longest side is over 3 times the next) lies across the view, along x; a plate (its shortest side
    ///   is below a third of the next) faces the viewer, along z; any other body that is deeper than wide by over 1.25 is turned
    ///   by a quarter about the vertical. Else, and where the position of the mesh's origin is given, as the mesh has it.
    /// - scale: the longest side is 0.95 of the workspace's diameter, or as much less as it takes for all of the body to be
    ///   seen by both eyes and to be above table and floor.
    /// - position: the middle of its box is at the workspace's centre, or as much higher as it takes to be above table and floor.
    ///
    /// `None` for points without extent, or not finite.
    pub fn room_from_mesh(&self, points: &[Point3<f64>], given: &GivenPlace) -> Option<Similarity3<f64>> {
        let (low, high) = bounds(points)?;
        let rotation = given.rotation.unwrap_or_else(|| match given.position {
            Some(_) => UnitQuaternion::identity(),
            None => turned(&(high - low)),
        });
        let outer = outermost(points);
        let turned: Vec<Point3<f64>> = points.iter().map(|x| rotation * x).collect();
        let (low, high) = bounds(&turned)?;
        let largest = self.workspace.room_from_body(low, high)?.scaling();
        let middle = nalgebra::center(&low, &high);
        let sight = Sight::new(self);
        let at = |scale: f64| {
            let chosen = self.workspace.centre.coords - middle.coords * scale;
            let place = |position| Similarity3::from_parts(Translation3::from(position), rotation, scale);
            given.position.map(place).unwrap_or_else(|| {
                let lift = sight.lift(outer.iter().map(|x| place(chosen) * x));
                place(chosen + Vector3::y() * lift)
            })
        };
        if let Some(scale) = given.scale {
            return Some(at(scale));
        }
        let fits = |scale: f64| {
            let room_from_mesh = at(scale);
            let about = room_from_mesh.isometry.translation.vector + middle.coords * scale;
            let spread = |x: &Point3<f64>| about + ((room_from_mesh * x).coords - about) * SPARE;
            let is_above = |x: &Point3<f64>| sight.lift([room_from_mesh * x].into_iter()) <= 1e-9;
            outer.iter().all(|x| sight.sees(&spread(x).into()) && is_above(x))
        };
        if fits(largest) || !fits(LEAST * largest) {
            return Some(at(largest));
        }
        let (mut small, mut large) = (LEAST * largest, largest);
        for _ in 0..HALVINGS {
            let scale = f64::sqrt(small * large);
            *if fits(scale) { &mut small } else { &mut large } = scale;
        }
        Some(at(small))
    }

    /// The standing of a body whose points these are, in the room. `None` without points, or if one is not finite.
    pub fn standing(&self, points: &[Point3<f64>]) -> Option<HiddenPart> {
        let (low, high) = bounds(points)?;
        let sight = Sight::new(self);
        let unseen = points.iter().filter(|place| !sight.sees(place)).count() as f64 / points.len() as f64;
        let sunk = self.levels().filter_map(|(name, depth)| {
            let deepest = points.iter().map(&depth).fold(0.0, f64::max);
            (deepest > SUNK_M).then_some((name, deepest))
        });
        Some(HiddenPart {
            unseen,
            sunk: sunk.max_by(|a, b| a.1.total_cmp(&b.1)),
            size_m: (high - low).max(),
            middle: nalgebra::center(&low, &high),
        })
    }

    /// Tables and floors, with how far a point is below one: of a screen only under its picture.
    fn levels(&self) -> impl Iterator<Item = (String, Depth<'_>)> {
        let of_screen = |screen: &'_ Screen| {
            let [right, up, normal] = screen.axes();
            let (corner, size) = (screen.lower_left, [screen.width_m(), screen.height_m()]);
            move |place: &Point3<f64>| {
                let from_corner = place - corner;
                let foot = [from_corner.dot(&right), from_corner.dot(&up)];
                let is_under = foot.iter().zip(size).all(|(x, side)| (0.0..=side).contains(x));
                if is_under { -from_corner.dot(&normal) } else { 0.0 }
            }
        };
        let tables = self.screens.iter().filter(|screen| is_level(screen)).map(move |screen| {
            let depth: Depth<'_> = Box::new(of_screen(screen));
            (format!("screen `{}`", screen.name), depth)
        });
        let floor = self.grid.map(|grid| {
            let depth: Depth<'_> = Box::new(move |place| grid.height_m - place.y);
            ("the grid".to_owned(), depth)
        });
        tables.chain(floor)
    }
}

fn is_level(screen: &Screen) -> bool {
    screen.axes()[2].y > LEVEL
}

/// The space that both eyes see, and that is above all tables and floors.
struct Sight {
    /// Per eye, per screen: clip_from_room, and the near distance, m.
    eyes: Vec<Vec<(Matrix4<f64>, f64)>>,
    /// A point and the normal of each table and floor.
    levels: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl Sight {
    fn new(stage: &Stage) -> Sight {
        let of_eye = |eye: &super::viewer::Eye| {
            let place = stage.viewer.eye_in_room(&stage.viewer.room_from_head, *eye);
            let views = stage.screens.iter().filter_map(|screen| screen.view(&place, NEAR_M).ok());
            views.map(|view| (view.clip_from_room.cast(), f64::from(view.near_m))).collect()
        };
        let centre = stage.workspace.centre;
        let tables =
            stage.screens.iter().filter(|screen| is_level(screen) && screen.distance_m(&centre) > 0.0);
        let floor = stage.grid.filter(|grid| grid.height_m < centre.y);
        let floor = floor.map(|grid| (Point3::new(0.0, grid.height_m, 0.0), Vector3::y()));
        Sight {
            eyes: stage.stereo.eyes().iter().map(of_eye).collect(),
            levels: tables.map(|screen| (screen.lower_left, screen.axes()[2])).chain(floor).collect(),
        }
    }

    /// Whether each eye sees the point on some screen.
    fn sees(&self, place: &Point3<f64>) -> bool {
        let place: Vector4<f64> = place.to_homogeneous();
        self.eyes.iter().all(|screens| {
            screens.iter().any(|(clip_from_room, near_m)| {
                let clip = clip_from_room * place;
                clip.w > *near_m && clip.x.abs().max(clip.y.abs()) <= ABOUT_SHOWN * clip.w
            })
        })
    }

    /// Height by which these points must be lifted to be above all tables and floors, m.
    fn lift(&self, points: impl Iterator<Item = Point3<f64>>) -> f64 {
        let needed = |place: &Point3<f64>| {
            let of = |(corner, normal): &(Point3<f64>, Vector3<f64>)| (corner - place).dot(normal) / normal.y;
            self.levels.iter().map(of).fold(0.0, f64::max)
        };
        points.map(|place| needed(&place)).fold(0.0, f64::max)
    }
}

fn bounds(points: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let (low, high) = points.iter().map(|x| (*x, *x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
    (low.iter().chain(high.iter()).all(|x| x.is_finite())).then_some((low, high))
}

/// The points farthest along the directions to the corners, edges and faces of a cube, each once.
fn outermost(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let directions = (0..27).map(|k| Vector3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1).cast::<f64>());
    let farthest = directions.filter_map(|way| {
        (0..points.len()).max_by(|&a, &b| points[a].coords.dot(&way).total_cmp(&points[b].coords.dot(&way)))
    });
    let found: std::collections::BTreeSet<usize> = farthest.collect();
    found.into_iter().map(|i| points[i]).collect()
}

/// The turn of a body of this box; the least of the turns that will do.
fn turned(sides: &Vector3<f64>) -> UnitQuaternion<f64> {
    let mut sorted: [f64; 3] = (*sides).into();
    sorted.sort_by(f64::total_cmp);
    let [thin, middle, long] = sorted;
    let (is_rod, is_plate) = (long > ROD * middle, middle > PLATE * thin);
    let about = |axis: Vector3<f64>, angle: f64| {
        UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(axis), angle)
    };
    let diagonal = Vector3::new(1.0, 1.0, 1.0);
    let turns = [
        UnitQuaternion::identity(),
        about(Vector3::y(), FRAC_PI_2),
        about(Vector3::x(), FRAC_PI_2),
        about(Vector3::z(), -FRAC_PI_2),
        about(diagonal, TAU / 3.0),
        about(diagonal, -TAU / 3.0),
    ];
    let is_good = |turn: &&UnitQuaternion<f64>| {
        let rotation: Rotation3<f64> = turn.to_rotation_matrix();
        let turned = rotation.matrix().map(|x| x.round().abs()) * sides;
        let is_upright = turned.y == sides.y && DEEP * turned.x >= turned.z;
        match (is_rod, is_plate) {
            (false, false) => is_upright,
            _ => (!is_rod || turned.x == long) && (!is_plate || turned.z == thin),
        }
    };
    turns.iter().find(is_good).copied().unwrap_or_else(UnitQuaternion::identity)
}

/// Text for a scene file that places a body so.
pub fn place_line(room_from_mesh: &Similarity3<f64>) -> String {
    let Isometry3 { translation, rotation } = room_from_mesh.isometry;
    // Adding 0.0 prints -0.0 as 0.0.
    let numbers =
        |v: Vector3<f64>| v.iter().map(|x| format!("{:?}", rounded(*x))).collect::<Vec<_>>().join(", ");
    let scale = room_from_mesh.scaling();
    let digits = 10f64.powi(5 - scale.log10().floor() as i32);
    let scale = (scale * digits).round() / digits;
    let turn = rotation.scaled_axis();
    let turn = if turn.norm() > 1e-6 { format!("rotation = [{}], ", numbers(turn)) } else { String::new() };
    format!("place = {{ position = [{}], {turn}scale = {scale:?} }}", numbers(translation.vector))
}

fn rounded(x: f64) -> f64 {
    (x * 1e4).round() / 1e4 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;

    fn corners(sides: [f64; 3]) -> Vec<Point3<f64>> {
        let half = Vector3::from(sides) / 2.0;
        let corner =
            |k: usize| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half[axis] } else { half[axis] });
        (0..8).map(|k| Point3::new(3.0, -2.0, 7.0) + corner(k)).collect()
    }

    /// The demo's tube, and boxes of all shapes, on all stages: seen by both eyes, above table and floor; those that have room
    /// fill the workspace.
    #[test]
    fn every_box_stands_wholly_in_sight_above_table_and_floor() {
        for (name, _) in BUILT_IN {
            let stage = Stage::find(name).unwrap();
            let fitted = |sides: [f64; 3]| {
                let points = corners(sides);
                let place = stage.room_from_mesh(&points, &GivenPlace::default()).unwrap();
                let placed: Vec<_> = points.iter().map(|x| place * x).collect();
                let standing = stage.standing(&placed).unwrap();
                assert!(
                    standing.is_right(&stage) && standing.unseen == 0.0,
                    "{name} {sides:?}: {standing:?}"
                );
                let off = standing.middle - stage.workspace.centre;
                assert!(
                    off.xz().norm() < 1e-9 && (0.0..stage.workspace.radius_m).contains(&(off.y + 1e-9)),
                    "{name}: {off}"
                );
                standing.size_m / (2.0 * stage.workspace.radius_m)
            };
            assert!((fitted([1.0, 0.2, 0.2]) - 0.95).abs() < 1e-9, "{name}: the demo's tube");
            let tube = stage.room_from_mesh(&corners([1.0, 0.2, 0.2]), &GivenPlace::default()).unwrap();
            assert!(
                (tube * Point3::new(3.0, -2.0, 7.0) - stage.workspace.centre).norm() < 1e-9,
                "{name}: is where it was"
            );
            for sides in [[1.0, 1.0, 1.0], [0.5, 2.0, 0.5], [0.4, 0.5, 3.0], [1.4, 2.7, 1.0], [1.0, 0.1, 1.0]]
            {
                let share = fitted(sides);
                assert!((0.6..0.9501).contains(&share), "{name} {sides:?}: {share}");
            }
        }
    }

    #[test]
    fn rods_lie_across_plates_face_the_viewer_and_others_stay_upright() {
        let turn = |sides: [f64; 3]| {
            let turn = turned(&Vector3::from(sides));
            ([Vector3::x(), Vector3::y(), Vector3::z()]).map(|axis| {
                let way: Vector3<f64> = turn * axis;
                let (k, sign) = (way.iamax(), way[way.iamax()].signum());
                (sign * [1.0, 2.0, 3.0][k]) as i32
            })
        };
        let kept = [1, 2, 3];
        for (what, sides, axes) in [
            ("a tube along x", [1.0, 0.2, 0.2], kept),
            ("a rod upright is laid down", [0.12, 1.0, 0.05], [-2, 1, 3]),
            ("a rod into the depth", [0.2, 0.2, 1.0], [-3, 2, 1]),
            ("a plate on the floor is turned up", [1.0, 0.1, 1.0], [1, 3, -2]),
            ("a plate from the side", [0.1, 1.0, 1.0], [-3, 2, 1]),
            ("a leaf spring on edge", [0.2, 0.01, 2.0], [2, 3, 1]),
            ("a standing figure", [1.39, 2.69, 1.05], kept),
            ("a little deeper than wide", [0.142, 0.0615, 0.166], kept),
            ("deeper than wide", [1.0, 1.0, 1.5], [-3, 2, 1]),
        ] {
            assert_eq!(turn(sides), axes, "{what}");
        }
    }

    #[test]
    fn each_key_stands_on_its_own() {
        let stage = Stage::find("workbench").unwrap();
        let points = corners([0.2, 1.0, 0.2]);
        let place = |given: GivenPlace| stage.room_from_mesh(&points, &given).unwrap();
        let middle = Point3::new(3.0, -2.0, 7.0);
        let automatic = place(GivenPlace::default());
        let scaled = place(GivenPlace { scale: Some(0.25), ..GivenPlace::default() });
        assert_eq!((scaled.scaling(), scaled.isometry.rotation), (0.25, automatic.isometry.rotation));
        assert!((scaled * middle - stage.workspace.centre).norm() < 1e-12);
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 1.3));
        let turned = place(GivenPlace { rotation: Some(rotation), ..GivenPlace::default() });
        assert!(
            (turned * middle - stage.workspace.centre).norm() < 1e-12 && turned.isometry.rotation == rotation
        );
        let position = Vector3::new(-0.9, 1.75, -1.8);
        let moved = place(GivenPlace { position: Some(position), ..GivenPlace::default() });
        assert_eq!(
            (moved.isometry.translation.vector, moved.isometry.rotation),
            (position, UnitQuaternion::identity())
        );
        let placed: Vec<_> = points.iter().map(|x| moved * x).collect();
        assert!(stage.standing(&placed).unwrap().is_right(&stage), "its scale is chosen so that it is seen");
    }

    #[test]
    fn what_is_not_where_it_is_seen_is_told_with_numbers() {
        let stage = Stage::find("workbench").unwrap();
        let at = |middle: [f64; 3], sides: [f64; 3]| {
            let shift = Vector3::from(middle) - Vector3::new(3.0, -2.0, 7.0);
            let placed: Vec<_> = corners(sides).iter().map(|x| x + shift).collect();
            stage.standing(&placed).unwrap()
        };
        let sunk = at([0.0, 1.0, 0.55], [0.3, 0.3, 0.3]);
        assert!(
            matches!(&sunk.sunk, Some((what, deep)) if what == "screen `table`" && (deep - 0.05).abs() < 1e-9)
        );
        assert!(at([5.0, 1.2, 0.5], [0.3, 0.3, 0.3]).unseen == 1.0, "far aside");
        assert!(at([0.0, 1.7, 1.5], [0.01, 0.01, 0.01]).unseen > 0.4, "in the viewer's face");
        let low = at([0.0, 0.5, 1.6], [0.1, 0.1, 0.1]);
        assert!(matches!(&low.sunk, Some((what, deep)) if what == "the grid" && (deep - 0.35).abs() < 1e-9));
        assert!(!at([0.0, 1.2, 0.5], [0.8, 0.2, 0.2]).is_right(&stage), "larger than the workspace");
        assert_eq!(stage.standing(&[]), None);
        assert_eq!(stage.standing(&[Point3::new(f64::NAN, 0.0, 0.0)]), None);
    }

    #[test]
    fn a_place_is_written_as_a_scene_file_has_it() {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, FRAC_PI_2, 0.0));
        let place = |turn| Similarity3::from_parts(Translation3::new(0.1, -0.00001, 2.0), turn, 0.0123456);
        assert_eq!(
            place_line(&place(turn)),
            "place = { position = [0.1, 0.0, 2.0], rotation = [0.0, 1.5708, 0.0], scale = 0.0123456 }"
        );
        assert_eq!(
            place_line(&place(UnitQuaternion::identity())),
            "place = { position = [0.1, 0.0, 2.0], scale = 0.0123456 }"
        );
    }
}
