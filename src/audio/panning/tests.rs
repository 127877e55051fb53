//! Tests of the panning: Pulkki's equation, power, and that nothing jumps.

use super::*;
use crate::base::random::Random;
use crate::stage::Stage;
use proptest::prelude::*;

struct Room {
    places: Vec<Point3<f64>>,
    viewer: Point3<f64>,
    panner: Panner,
}

impl Room {
    fn new(places: Vec<Point3<f64>>, viewer: Point3<f64>) -> Room {
        let panner = Panner::new(&places, viewer);
        Room { places, viewer, panner }
    }

    fn cyberstage() -> Room {
        let stage = Stage::find("cyberstage").unwrap();
        let places = stage.sound.loudspeakers.iter().map(|one| one.position).collect();
        Room::new(places, Point3::from(stage.viewer.room_from_head.translation.vector))
    }

    /// A place where a head can be that stands or sits in the room.
    fn head(random: &mut Random) -> Point3<f64> {
        Point3::new(2.0 * random.draw(), 1.3 + random.draw(), 2.0 * random.draw())
    }
}

fn direction(random: &mut Random) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.draw()).normalize()
}

fn power(gains: &[f64]) -> f64 {
    gains.iter().map(|gain| gain * gain).sum()
}

#[test]
fn a_source_behind_a_loudspeaker_sounds_from_that_one_alone() {
    let room = Room::cyberstage();
    let mut random = Random::default();
    for head in (0..50).map(|_| Room::head(&mut random)).chain([room.viewer]) {
        for (channel, place) in room.places.iter().enumerate() {
            let gains = room.panner.gains(&head, &(place - head));
            let alone: [f64; MOST_CHANNELS] = std::array::from_fn(|k| if k == channel { 1.0 } else { 0.0 });
            for (gain, expected) in gains.iter().zip(alone) {
                assert!((gain - expected).abs() < 1e-12, "{channel} from {head}: {gains:?}");
            }
        }
    }
}

/// p ∥ Σ g l with the unit directions l from the head, g ≥ 0, and Σ g² = 1, for all directions and heads in the room.
#[test]
fn directions_are_those_of_pulkkis_equation() {
    let room = Room::cyberstage();
    let mut random = Random::default();
    for _ in 0..1000 {
        let (head, direction) = (Room::head(&mut random), direction(&mut random));
        let gains = room.panner.gains(&head, &direction);
        assert!((power(&gains) - 1.0).abs() < 1e-12 && gains.iter().all(|gain| *gain >= 0.0), "{gains:?}");
        let sum: Vector3<f64> =
            room.places.iter().zip(gains).map(|(place, gain)| (place - head).normalize() * gain).sum();
        assert!((sum.normalize() - direction).norm() < 1e-12, "{head} {direction}: {sum}");
    }
}

/// In the middle of a wall all four of its loudspeakers sound alike; with the equation for triangles only two would.
#[test]
fn all_corners_of_a_wall_sound_for_its_middle() {
    let room = Room::cyberstage();
    let head = Point3::new(0.0, 1.2, 0.0);
    for wall in [-Vector3::z(), Vector3::z(), Vector3::x(), Vector3::y(), -Vector3::y()] {
        let gains = room.panner.gains(&head, &wall);
        let near = |place: &Point3<f64>| (place - head).dot(&wall) > 0.0;
        for (place, gain) in room.places.iter().zip(gains) {
            let expected = if near(place) { 0.5 } else { 0.0 };
            assert!((gain - expected).abs() < 1e-12, "{wall}: {gains:?}");
        }
    }
}

/// The tangent law of stereo: tan φ / tan 30° = (left - right) / (left + right), for φ to the left (Pulkki 1997, equation 2).
#[test]
fn two_loudspeakers_follow_the_tangent_law() {
    let at = |degrees: f64| Vector3::new(-degrees.to_radians().sin(), 0.0, -degrees.to_radians().cos());
    let room = Room::new([30.0, -30.0].map(|degrees| Point3::from(at(degrees))).into(), Point3::origin());
    for degrees in [-29.0, -10.0, 0.0, 5.0, 20.0] {
        let [left, right, ..] = room.panner.gains(&room.viewer, &at(degrees));
        let found = (left - right) / (left + right) * 30f64.to_radians().tan();
        assert!((found - degrees.to_radians().tan()).abs() < 1e-12, "{degrees}: {left} {right}");
    }
    let [left, right, ..] = room.panner.gains(&room.viewer, &at(180.0));
    assert!((left - right).abs() < 1e-12, "from behind as from before");
    let [left, right, ..] = room.panner.gains(&room.viewer, &at(90.0));
    assert!(left > 0.9 && right < 0.4, "{left} {right}");
}

/// The rooms that people have, complete or not.
fn rooms() -> Vec<Room> {
    let ring = |count: usize, height: f64| {
        let at = move |k: usize| {
            let angle = std::f64::consts::TAU * (k as f64 + 0.5) / count as f64;
            Point3::new(2.0 * angle.sin(), height, -2.0 * angle.cos())
        };
        (0..count).map(at)
    };
    let viewer = Point3::new(0.0, 1.2, 0.3);
    let of = |places: Vec<Point3<f64>>| Room::new(places, viewer);
    vec![
        Room::cyberstage(),
        of(ring(4, 1.2).collect()),
        of(ring(5, 1.0).collect()),
        of(ring(8, 1.2).chain(ring(4, 2.5)).collect()),
        of(ring(8, 1.2).chain(ring(4, 2.5)).chain(ring(4, 0.0)).collect()),
        of(ring(3, 2.5).collect()),
        of(ring(2, 1.2).collect()),
        of(ring(1, 1.2).collect()),
        // A centre loudspeaker much nearer than the others.
        of(ring(4, 2.4).chain(ring(4, 0.0)).chain([Point3::new(0.0, 1.2, -0.5)]).collect()),
    ]
}

/// A degree of the source, or a centimetre of the head, changes no gain by more than a few percent, also where nothing covers.
#[test]
fn no_gain_jumps_when_source_or_head_moves() {
    let mut random = Random::default();
    let mut worst = [0.0f64; 2];
    for room in rooms() {
        for _ in 0..300 {
            let (way, axis) = (direction(&mut random), direction(&mut random));
            let head = room.viewer + 0.6 * direction(&mut random);
            let aside = way.cross(&axis).normalize();
            let turned = way * 1f64.to_radians().cos() + aside * 1f64.to_radians().sin();
            let before = room.panner.gains(&head, &way);
            let change = |after: [f64; MOST_CHANNELS]| {
                after.iter().zip(before).map(|(after, before)| (after - before).abs()).fold(0.0, f64::max)
            };
            worst[0] = worst[0].max(change(room.panner.gains(&head, &turned)));
            worst[1] = worst[1].max(change(room.panner.gains(&(head + 0.01 * axis), &way)));
        }
    }
    println!("worst change for 1°: {}, for 1 cm: {}", worst[0], worst[1]);
    assert!(worst[0] < 0.1 && worst[1] < 0.1, "{worst:?}");
}

#[test]
fn every_loudspeaker_sounds_for_some_direction() {
    for (k, room) in rooms().iter().enumerate() {
        for (channel, place) in room.places.iter().enumerate() {
            let gains = room.panner.gains(&room.viewer, &(place - room.viewer));
            assert!((gains[channel] - 1.0).abs() < 1e-9, "room {k}, loudspeaker {channel}: {gains:?}");
        }
    }
}

proptest! {
    /// Loudspeakers and heads anywhere: the power is 1 where there is a loudspeaker to hear, else 0.
    #[test]
    fn the_power_is_always_one(
        places in proptest::collection::vec(prop::array::uniform3(-3.0..3.0f64), 0..10),
        head in prop::array::uniform3(-9.0..9.0f64), way in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let room = Room::new(places.into_iter().map(Point3::from).collect(), Point3::new(0.0, 1.0, 0.0));
        prop_assume!(Vector3::from(way).norm() > 1e-3);
        let power = power(&room.panner.gains(&Point3::from(head), &Vector3::from(way).normalize()));
        let expected = if room.places.is_empty() { 0.0 } else { 1.0 };
        prop_assert!((power - expected).abs() < 1e-9, "{power}");
    }
}
