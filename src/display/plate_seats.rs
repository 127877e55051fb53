//! Seats of the plates of a world: apart from each other and from the overlay, never over what a hand holds, and steady.
//!
//! In: the sizes that each plate may have, the most important plate first, and the rectangles in the picture ([`Room`]).
//! Out: a [`Seat`] for each plate, or none where there is no room even for the smallest. A plate stands in its own corner,
//! above the plates before it, while nothing is held there. Otherwise it goes where it covers least of the bodies, smaller
//! where it must, stays there until something comes under it, and goes back when its own place has been free for a second.
//!
//! [`keep_clear`] finds the rectangles that plates must not cover: the control elements that are held, their arrows and the
//! points that styli hit, as the screens show them.

use crate::render::Drawable;
use crate::scene::Grab;
use crate::stage::{NEAR_M, Screen};
use crate::world::{Highlight, PlacedBody, World};
use egui::{Pos2, Rect, Vec2, pos2};
use nalgebra::{Matrix4, Point3, Vector3};

/// The side of the picture in whose lower corner a plate stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

/// A plate that is to be seated.
#[derive(Clone, Debug)]
pub(super) struct PlateRequest {
    pub side: Side,
    /// Sizes, from the full one to the smallest.
    pub sizes: Vec<Vec2>,
}

/// The rectangles in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room<'a> {
    /// The rectangle within which plates stand.
    pub inside: Rect,
    /// Distance between two plates.
    pub gap: f32,
    /// Overlay, panel and messages, which do not give way.
    pub taken: &'a [Rect],
    /// Held elements and their arrows: nothing stands there.
    pub held: &'a [Rect],
    /// Elements that can be taken: plates go elsewhere if they can.
    pub loose: &'a [Rect],
    /// Bodies: plates cover as little of them as they can.
    pub bodies: &'a [Rect],
    pub time_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seat {
    pub rect: Rect,
    /// Index of its size in [`PlateRequest::sizes`].
    pub size: usize,
}

/// Seats of the plates from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct PlateSeats {
    inside: Option<Rect>,
    kept: Vec<LastSeat>,
}

/// The seat that a plate had in the last frame; `key` is the plate's side and its number there.
#[derive(Clone, Copy, Debug)]
struct LastSeat {
    key: (Side, usize),
    corner: Pos2,
    size: usize,
    is_own: bool,
    /// The time since which its own place has been free, s.
    free_since_s: Option<f64>,
}

/// Time after which a plate goes back to its own place, s.
const BACK_S: f64 = 1.0;

/// The time since which a plate's own place has been free, from that of the frame before, s; and whether it goes back there.
pub(super) fn free_since(before_s: Option<f64>, is_free: bool, time_s: f64) -> (Option<f64>, bool) {
    // A script's time begins anew with every round.
    let before_s = before_s.filter(|since_s| is_free && time_s >= *since_s);
    let since_s = before_s.or(is_free.then_some(time_s));
    (since_s, since_s.is_some_and(|since_s| time_s - since_s >= BACK_S))
}

/// Penalties of a place, added to its distance from the plate's own place in parts of the picture's diagonal: for each step
/// to a smaller size, and for the part of the plate over an element that can be taken and over a body.
const SMALLER: f32 = 0.5;
const OVER_LOOSE: f32 = 8.0;
const OVER_BODY: f32 = 1.5;

impl PlateSeats {
    /// The seat of each plate in this frame.
    pub(super) fn take(&mut self, room: &Room<'_>, requests: &[PlateRequest]) -> Vec<Option<Seat>> {
        if self.inside.replace(room.inside) != Some(room.inside) {
            self.kept.clear();
        }
        let before = std::mem::take(&mut self.kept);
        let (mut taken, mut counts) = (room.taken.to_vec(), [0; 2]);
        let mut seats = Vec::new();
        for plate in requests {
            let count = &mut counts[usize::from(plate.side == Side::Right)];
            let key = (plate.side, *count);
            *count += 1;
            let before = before.iter().find(|kept| kept.key == key).copied();
            let kept = room.seated(plate, before, &taken, key);
            let seat = kept.map(|kept| Seat {
                rect: Rect::from_min_size(kept.corner, plate.sizes[kept.size]),
                size: kept.size,
            });
            self.kept.extend(kept);
            taken.extend(seat.map(|seat| seat.rect));
            seats.push(seat);
        }
        seats
    }
}

impl Room<'_> {
    fn seated(
        &self,
        plate: &PlateRequest,
        before: Option<LastSeat>,
        taken: &[Rect],
        key: (Side, usize),
    ) -> Option<LastSeat> {
        let own = self.own(plate, taken);
        // A plate goes back only when three gaps around its place are free: a body that trembles at the border does not call it.
        let is_free = own.is_some_and(|own| self.is_clear(own.expand(3.0 * self.gap)));
        let since_s = before.and_then(|before| before.free_since_s);
        let (free_since_s, is_back) = free_since(since_s, is_free, self.time_s);
        let kept = |rect: Rect, size, is_own| LastSeat { key, corner: rect.min, size, is_own, free_since_s };
        let is_at_home = before.is_none_or(|before| before.is_own);
        if let Some(own) = own.filter(|own| (is_at_home || is_back) && self.is_clear(*own)) {
            return Some(kept(own, 0, true));
        }
        let stays = before.filter(|before| !before.is_own).and_then(|before| {
            let rect = Rect::from_min_size(before.corner, *plate.sizes.get(before.size)?);
            let is_usable = self.is_inside(rect)
                && !is_over(rect, taken)
                && !is_over(rect, self.held)
                && !is_over(rect, self.loose);
            is_usable.then(|| kept(rect, before.size, false))
        });
        stays.or_else(|| self.best(plate, taken).map(|seat| kept(seat.rect, seat.size, false)))
    }

    fn is_inside(&self, rect: Rect) -> bool {
        self.inside.expand(0.5).contains_rect(rect)
    }

    fn is_clear(&self, rect: Rect) -> bool {
        !is_over(rect, self.held) && !is_over(rect, self.loose)
    }

    /// The lowest free place in the plate's own column.
    fn own(&self, plate: &PlateRequest, taken: &[Rect]) -> Option<Rect> {
        let size = *plate.sizes.first()?;
        let x = match plate.side {
            Side::Left => self.inside.min.x,
            Side::Right => self.inside.max.x - size.x,
        };
        let feet = taken.iter().map(|rect| rect.min.y - self.gap).chain([self.inside.max.y]);
        let rects = feet.map(|foot| Rect::from_min_size(pos2(x, foot - size.y), size));
        let free = rects.filter(|rect| self.is_inside(*rect) && !is_over(*rect, taken));
        free.max_by(|a, b| a.max.y.total_cmp(&b.max.y))
    }

    /// The best of all places at the edges of the picture and beside the rectangles in it.
    fn best(&self, plate: &PlateRequest, taken: &[Rect]) -> Option<Seat> {
        let held: Vec<Rect> = self.held.iter().map(|held| held.expand(1.5 * self.gap)).collect();
        let edges = || taken.iter().chain(&held).chain(self.loose).chain(self.bodies);
        let full = *plate.sizes.first()?;
        let home = match plate.side {
            Side::Left => pos2(self.inside.min.x, self.inside.max.y - full.y),
            Side::Right => self.inside.max - full,
        };
        let mut best = None::<(f32, Seat)>;
        for (number, &size) in plate.sizes.iter().enumerate() {
            let right = self.inside.max - size;
            let xs = edges().flat_map(|edge| [edge.max.x + self.gap, edge.min.x - self.gap - size.x]);
            let ys = edges().flat_map(|edge| [edge.max.y + self.gap, edge.min.y - self.gap - size.y]);
            let ys: Vec<f32> = [right.y, self.inside.min.y].into_iter().chain(ys).collect();
            for x in [right.x, self.inside.min.x].into_iter().chain(xs) {
                for &y in &ys {
                    let rect = Rect::from_min_size(pos2(x, y), size);
                    if !self.is_inside(rect) || is_over(rect, taken) || is_over(rect, &held) {
                        continue;
                    }
                    let away = (rect.center() - (home + 0.5 * full)).length() / self.inside.size().length();
                    let cost = away
                        + SMALLER * number as f32
                        + OVER_LOOSE * covered(rect, self.loose)
                        + OVER_BODY * covered(rect, self.bodies);
                    if best.is_none_or(|(least, _)| cost < least - 1e-4) {
                        best = Some((cost, Seat { rect, size: number }));
                    }
                }
            }
        }
        best.map(|(_, seat)| seat)
    }
}

/// Whether a rectangle overlaps one of the others.
pub(super) fn is_over(rect: Rect, others: &[Rect]) -> bool {
    others.iter().any(|other| rect.shrink(0.01).intersects(*other))
}

/// The sum of a rectangle's overlaps with the others, in parts of its area.
pub(super) fn covered(rect: Rect, others: &[Rect]) -> f32 {
    let shared = |other: &Rect| {
        let both = rect.intersect(*other);
        both.width().max(0.0) * both.height().max(0.0)
    };
    others.iter().map(shared).sum::<f32>() / (rect.width() * rect.height()).max(1.0)
}

/// Largest number of nodes of an element or of a body that are sampled.
const NODES: usize = 64;

/// Rectangles on one screen, of both eyes: left, right, bottom, top in normalised device coordinates of the whole screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeepClear {
    /// Rectangles about each held element, each arrow and each place pointed at: nothing stands there.
    pub held: Vec<[f64; 4]>,
    /// Rectangles about each element that can be taken: plates go elsewhere if they can.
    pub loose: Vec<[f64; 4]>,
    /// Rectangles about each body.
    pub bodies: Vec<[f64; 4]>,
}

/// The rectangles of each screen.
pub fn keep_clear(world: &World) -> Vec<KeepClear> {
    let things = [held(world), elements(world, Highlight::Idle), bodies(world)];
    let on_screen = |screen: &Screen| {
        let viewer = &world.assets.stage.viewer;
        let views = world.assets.stage.stereo.eyes().iter().filter_map(|&eye| {
            let view = screen.view(&viewer.eye_in_room(&world.room_from_head, eye), NEAR_M).ok()?;
            Some(view.clip_from_room.cast::<f64>())
        });
        let views: Vec<Matrix4<f64>> = views.collect();
        let [held, loose, bodies] =
            things.each_ref().map(|all| all.iter().filter_map(|points| rectangle(&views, points)).collect());
        KeepClear { held, loose, bodies }
    };
    world.assets.stage.screens.iter().map(on_screen).collect()
}

/// Points in the room of each thing that is held or pointed at.
fn held(world: &World) -> Vec<Vec<Point3<f64>>> {
    let mut things = elements(world, Highlight::Held);
    let hits = world.frame.all(Drawable::stylus).filter_map(|stylus| stylus.hit);
    things.extend(hits.map(|hit| vec![hit.cast()]));
    things.extend(
        world
            .frame
            .all(Drawable::arrow)
            .map(|arrow| vec![arrow.from.cast(), (arrow.from + arrow.along).cast()]),
    );
    things
}

/// Points in the room of each control element that is held, or, for any other highlight, that can be taken and is not held.
fn elements(world: &World, highlight: Highlight) -> Vec<Vec<Point3<f64>>> {
    let mut things = Vec::new();
    for (body, shown) in world.bodies.iter().zip(&world.frame.bodies) {
        let is_chosen = |grab: Grab, now: Highlight| match highlight {
            Highlight::Held => now == Highlight::Held,
            _ => now != Highlight::Held && grab == Grab::Dragger,
        };
        let controls = body.assets.controls.iter().zip(&shown.highlights).enumerate();
        for (c, _) in controls.filter(|(_, (control, now))| is_chosen(control.grab, **now)) {
            let nodes = body.deformer.control_nodes(c);
            things.push(places(body, nodes.iter().copied(), nodes.len()));
        }
    }
    things
}

fn bodies(world: &World) -> Vec<Vec<Point3<f64>>> {
    let nodes_of = |body: &PlacedBody| {
        let count = body.deformer.node_count();
        places(body, 0..count as u32, count)
    };
    world.bodies.iter().map(nodes_of).collect()
}

/// Places in the room of at most [`NODES`] of the nodes.
fn places(body: &PlacedBody, nodes: impl Iterator<Item = u32>, count: usize) -> Vec<Point3<f64>> {
    let positions = body.deformer.kept_positions();
    let room_from_surface = body.room_from_surface();
    let place = |node: u32| {
        let position = positions.get(node as usize)?;
        Some(room_from_surface * Point3::from(Vector3::from(*position).cast::<f64>()))
    };
    nodes.step_by(count.div_ceil(NODES).max(1)).filter_map(place).collect()
}

/// The rectangle about the points in all views, as far as it is on the screen.
fn rectangle(views: &[Matrix4<f64>], points: &[Point3<f64>]) -> Option<[f64; 4]> {
    let seen = views.iter().flat_map(|view| points.iter().map(move |point| view * point.to_homogeneous()));
    let seen = seen.filter(|clip| clip.w > clip.z).map(|clip| [clip.x / clip.w, clip.y / clip.w]);
    let about = seen
        .map(|[x, y]| [x, x, y, y])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])])?;
    let [left, right, bottom, top] = about;
    let is_on_screen = left < 1.0 && right > -1.0 && bottom < 1.0 && top > -1.0;
    (is_on_screen && about.iter().all(|x| x.is_finite())).then_some(about)
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::vec2;
    use proptest::prelude::*;

    /// A legend and a curve in the right corner and words in the left one, as a picture of 1280 by 800 pixels has them.
    fn plates() -> Vec<PlateRequest> {
        let sizes = |full: Vec2| [1.0, 0.8, 0.65].map(|scale| full * scale).to_vec();
        let wanted = |side, full| PlateRequest { side, sizes: sizes(full) };
        vec![
            wanted(Side::Right, vec2(580.0, 110.0)),
            wanted(Side::Right, vec2(420.0, 250.0)),
            wanted(Side::Left, vec2(300.0, 80.0)),
        ]
    }

    const INSIDE: Rect = Rect { min: pos2(16.0, 16.0), max: pos2(1264.0, 784.0) };
    const EMPTY: Room<'_> =
        Room { inside: INSIDE, gap: 8.0, taken: &[], held: &[], loose: &[], bodies: &[], time_s: 0.0 };

    fn rects(seats: &[Option<Seat>]) -> Vec<Rect> {
        seats.iter().map(|seat| seat.unwrap().rect).collect()
    }

    /// The tube of the desktop: its right end was under the curve, with the arrow, while a hand held it.
    #[test]
    fn a_curve_leaves_the_held_end_and_its_arrow_and_comes_back_after_a_second() {
        let (mut seats, plates) = (PlateSeats::default(), plates());
        let own = rects(&seats.take(&EMPTY, &plates));
        assert_eq!(own[0].max, INSIDE.max);
        assert_eq!((own[1].max.x, own[1].max.y), (INSIDE.max.x, own[0].min.y - 8.0));
        assert_eq!((own[2].min.x, own[2].max.y), (INSIDE.min.x, INSIDE.max.y));

        let held = [Rect::from_min_max(pos2(910.0, 410.0), pos2(975.0, 650.0))];
        let bodies = [Rect::from_min_max(pos2(300.0, 420.0), pos2(980.0, 570.0))];
        let room = |time_s: f64| Room { held: &held, bodies: &bodies, time_s, ..EMPTY };
        let away = seats.take(&room(0.1), &plates);
        assert!(away.iter().all(|seat| seat.unwrap().size == 0), "there is room for all: {away:?}");
        let away = rects(&away);
        assert!(!away.iter().any(|rect| is_over(*rect, &held)) && away[1] != own[1], "{away:?}");
        assert!(!is_over(away[1], &bodies), "{away:?}");
        // As long as nothing comes under it, it stays.
        let near = [held[0].translate(vec2(-30.0, 10.0))];
        assert_eq!(rects(&seats.take(&Room { held: &near, ..room(0.2) }, &plates)), away);
        assert_eq!(rects(&seats.take(&Room { time_s: 0.3, ..EMPTY }, &plates)), away, "not at once");
        assert_eq!(rects(&seats.take(&Room { time_s: 1.4, ..EMPTY }, &plates)), own, "a second later");
    }

    #[test]
    fn where_there_is_no_room_a_plate_is_smaller_and_the_last_is_left_out() {
        let inside = Rect::from_min_size(pos2(0.0, 0.0), vec2(600.0, 300.0));
        let seats = PlateSeats::default().take(&Room { inside, ..EMPTY }, &plates());
        let sizes: Vec<Option<usize>> = seats.iter().map(|seat| seat.map(|seat| seat.size)).collect();
        assert_eq!(sizes[0], Some(0), "the most important one is as large as ever");
        assert!(sizes[1].is_some_and(|size| size > 0), "{sizes:?}");
        let small = Rect::from_min_size(pos2(0.0, 0.0), vec2(590.0, 120.0));
        let seats = PlateSeats::default().take(&Room { inside: small, ..EMPTY }, &plates());
        assert!(seats[0].is_some() && seats[1].is_none() && seats[2].is_none(), "{seats:?}");
    }

    #[test]
    fn a_plate_goes_aside_for_an_element_that_can_be_taken() {
        let loose = [Rect::from_min_max(pos2(1100.0, 500.0), pos2(1200.0, 600.0))];
        let seats = PlateSeats::default().take(&Room { loose: &loose, ..EMPTY }, &plates());
        assert!(!rects(&seats).iter().any(|rect| is_over(*rect, &loose)), "{seats:?}");
    }

    proptest! {
        /// Whatever is held and whatever stands there, in windows of any size: no plate is over it, outside, or over another.
        #[test]
        fn no_plate_is_over_another_or_over_what_is_held(
            width in 100f32..2000.0, height in 60f32..1200.0,
            there in proptest::collection::vec((0f32..1.0, 0f32..1.0, 1f32..400.0, 1f32..400.0), 0..7),
            split in 0_usize..7, steps in 1_usize..4,
        ) {
            let inside = Rect::from_min_size(pos2(10.0, 10.0), vec2(width, height));
            let mut seats = PlateSeats::default();
            for step in 0..steps {
                let all: Vec<Rect> = there.iter().skip(step).map(|(x, y, w, h)| {
                    Rect::from_center_size(pos2(x * width, y * height), vec2(*w, *h))
                }).collect();
                let (taken, held) = all.split_at(split.min(all.len()));
                let room = Room { inside, taken, held, time_s: step as f64, ..EMPTY };
                let shown: Vec<Rect> =
                    seats.take(&room, &plates()).iter().flatten().map(|seat| seat.rect).collect();
                for (k, rect) in shown.iter().enumerate() {
                    prop_assert!(inside.expand(0.5).contains_rect(*rect), "{:?} {:?}", rect, inside);
                    prop_assert!(!is_over(*rect, &all), "{:?} {:?}", rect, all);
                    prop_assert!(!is_over(*rect, &shown[..k]), "{:?}", shown);
                }
            }
        }
    }
}
