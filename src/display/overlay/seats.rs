//! Seats of the plates of an overlay: never over what is held, and steady.
//!
//! In: the sizes that two plates would like, and rectangles to keep clear. Out: a [`Seat`] for each, in a column at the left or
//! right edge. A plate stays where it is until something comes under it, and goes back to its own side when that has been
//! free for a second.

use crate::display::plate_seats::free_since;
use egui::{Rect, pos2, vec2};

/// The seat of a plate: its corner, its width, and its largest height; none where that is less than it needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seat {
    pub rect: Rect,
}

/// Seats of the plates from frame to frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seats {
    chosen: Option<SeatChoice>,
    /// The time since which the plates' own places have been free, s.
    free_since_s: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
struct SeatChoice {
    /// The rectangle in which the plates were seated: another window is another choice.
    inside: Rect,
    seats: [Option<Seat>; 2],
    is_own: bool,
}

/// The plates that are to be seated.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeatRequests {
    /// The rectangle within which the plates stand.
    pub inside: Rect,
    pub width: f32,
    /// Heights of the left and the right plate, with all their rows; the right one may be empty.
    pub heights: [f32; 2],
    /// Distance between plates, and to what is kept clear.
    pub margin: f32,
    /// A plate below this height is left out.
    pub least: f32,
    /// Whether both fit beside each other.
    pub is_wide: bool,
}

impl Seats {
    /// The seats of both plates in this frame; `None` where there is no room for one.
    pub(super) fn take(&mut self, wanted: &SeatRequests, clear: &[Rect], time_s: f64) -> [Option<Seat>; 2] {
        let own = wanted.arranged(0, &[]);
        let far = |seats: &[Option<Seat>; 2], margin: f32| {
            let shown = seats.iter().zip(wanted.heights).filter_map(|(seat, height)| {
                let rect = seat.as_ref()?.rect;
                Some(Rect::from_min_size(rect.min, vec2(rect.width(), height.min(rect.height()))))
            });
            let mut shown = shown.map(|rect| rect.expand(margin));
            shown.all(|rect| !clear.iter().any(|held| held.intersects(rect)))
        };
        // Three margins are free before they go back: what trembles at the border does not make them.
        let is_free = far(&own, 3.0 * wanted.margin);
        let (free_since_s, is_back) = free_since(self.free_since_s, is_free, time_s);
        self.free_since_s = free_since_s;
        let kept = self.chosen.take().filter(|chosen| {
            let is_right = chosen.inside == wanted.inside && far(&chosen.seats, 0.0);
            is_right && (chosen.is_own || !is_back)
        });
        let chosen = match kept {
            // Own seats are as high as there is room.
            Some(SeatChoice { is_own: true, .. }) => {
                SeatChoice { inside: wanted.inside, seats: own, is_own: true }
            }
            Some(chosen) => chosen,
            None if far(&own, 0.0) => SeatChoice { inside: wanted.inside, seats: own, is_own: true },
            None => SeatChoice { inside: wanted.inside, seats: wanted.best(clear), is_own: false },
        };
        let seats = chosen.seats;
        self.chosen = Some(chosen);
        seats
    }
}

impl SeatRequests {
    /// The first of all arrangements that shows most of the plates, with a margin about what is kept clear.
    fn best(&self, clear: &[Rect]) -> [Option<Seat>; 2] {
        let clear: Vec<Rect> = clear.iter().map(|held| held.expand(2.0 * self.margin)).collect();
        let mut best = ([None; 2], -1.0);
        for arrangement in 0..4 {
            let seats = self.arranged(arrangement, &clear);
            let shown = |k: usize| seats[k].map_or(0.0, |seat| seat.rect.height().min(self.heights[k]));
            let shown = shown(0) + shown(1);
            if shown > best.1 + 1.0 {
                best = (seats, shown);
            }
        }
        best.0
    }

    /// The seats of an arrangement: beside each other, each on its own side or on the other's, or both on one side.
    fn arranged(&self, arrangement: usize, clear: &[Rect]) -> [Option<Seat>; 2] {
        let sides =
            if self.is_wide { [[0, 1], [1, 1], [0, 0], [1, 0]] } else { [[0, 0], [1, 1], [0, 0], [1, 1]] };
        let [left, right] = sides[arrangement];
        let column = |side: usize| {
            let x = if side == 0 { self.inside.min.x } else { self.inside.max.x - self.width };
            Rect::from_min_size(pos2(x, self.inside.min.y), vec2(self.width, self.inside.height()))
        };
        // Where both share a column, the bodies' plate comes first and leaves the other at most a part of it.
        let is_shared = left == right && self.heights[1] > 0.0;
        let share = |height: f32, part: f32| height.min(part * self.inside.height());
        let second = match self.heights[1] > 0.0 {
            true => {
                let most = if is_shared {
                    let rest = self.inside.height() - share(self.heights[0], 0.35) - self.margin;
                    self.heights[1].min(rest.max(0.6 * self.inside.height()))
                } else {
                    self.inside.height()
                };
                self.seated(column(right), most, clear)
            }
            false => None,
        };
        let mut taken = clear.to_vec();
        if let Some(seat) = second.filter(|_| is_shared) {
            let height = seat.rect.height().min(self.heights[1]);
            taken.push(Rect::from_min_size(seat.rect.min, vec2(self.width, height)).expand(self.margin));
        }
        [self.seated(column(left), self.inside.height(), &taken), second]
    }

    /// The highest free part of a column, of those as high the first.
    fn seated(&self, column: Rect, most: f32, clear: &[Rect]) -> Option<Seat> {
        let mut held: Vec<&Rect> = clear.iter().filter(|held| held.intersects(column)).collect();
        held.sort_by(|a, b| a.min.y.total_cmp(&b.min.y));
        let (mut top, mut best) = (column.min.y, None::<Rect>);
        let ends = held.iter().map(|held| (held.min.y, held.max.y)).chain([(column.max.y, column.max.y)]);
        for (bottom, next) in ends {
            let free =
                Rect::from_min_max(pos2(column.min.x, top), pos2(column.max.x, bottom.min(top + most)));
            if free.height() >= self.least && best.is_none_or(|best| free.height() > best.height() + 1.0) {
                best = Some(free);
            }
            top = top.max(next);
        }
        best.map(|rect| Seat { rect })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn wanted(size: [f32; 2], is_wide: bool) -> SeatRequests {
        let inside = Rect::from_min_size(pos2(10.0, 10.0), vec2(size[0], size[1]));
        SeatRequests { inside, width: 200.0, heights: [300.0, 350.0], margin: 10.0, least: 40.0, is_wide }
    }

    fn rect(x: f32, y: f32) -> Rect {
        Rect::from_center_size(pos2(x, y), vec2(30.0, 30.0))
    }

    #[test]
    fn a_plate_moves_aside_and_comes_back_after_a_second_without_flicker() {
        let (mut seats, wanted) = (Seats::default(), wanted([900.0, 700.0], true));
        let own = seats.take(&wanted, &[], 0.0);
        assert!(own[0].unwrap().rect.min.x == 10.0 && own[1].unwrap().rect.max.x == 910.0);
        // Between the plates nothing happens; under the left one it goes away.
        assert_eq!(seats.take(&wanted, &[rect(450.0, 100.0)], 0.1), own);
        let held = [rect(100.0, 100.0)];
        let away = seats.take(&wanted, &held, 0.2);
        assert!(away != own && away.iter().flatten().all(|seat| !seat.rect.intersects(held[0])));
        // It trembles at the border of the plate's own place: nothing moves.
        for k in 0..100 {
            let x = if k % 2 == 0 { 190.0 } else { 240.0 };
            assert_eq!(seats.take(&wanted, &[rect(x, 100.0)], 0.2 + 0.05 * f64::from(k)), away, "{k}");
        }
        assert_eq!(seats.take(&wanted, &[], 6.0), away, "not at once");
        assert_eq!(seats.take(&wanted, &[], 6.9), away);
        assert_eq!(seats.take(&wanted, &[], 7.1), own, "a second later");
    }

    proptest! {
        /// Whatever is held, wherever, in windows of any size: no plate is over it, outside, or over the other.
        #[test]
        fn no_plate_is_over_what_is_held(
            width in 200f32..2000.0, height in 20f32..1200.0,
            held in proptest::collection::vec((0f32..1.0, 0f32..1.0, 1f32..400.0, 1f32..400.0), 0..5),
            steps in 1_usize..4,
        ) {
            let wanted = SeatRequests { is_wide: width > 450.0, ..wanted([width, height], true) };
            let mut seats = Seats::default();
            for step in 0..steps {
                let clear: Vec<Rect> = held.iter().skip(step).map(|(x, y, w, h)| {
                    Rect::from_center_size(pos2(x * width, y * height), vec2(*w, *h))
                }).collect();
                let taken = seats.take(&wanted, &clear, step as f64);
                let shown: Vec<Rect> = taken.iter().zip(wanted.heights).filter_map(|(seat, most)| {
                    let rect = seat.as_ref()?.rect;
                    Some(Rect::from_min_size(rect.min, vec2(rect.width(), most.min(rect.height()))))
                }).collect();
                for rect in &shown {
                    prop_assert!(wanted.inside.expand(0.5).contains_rect(*rect), "{:?} {:?}", rect, wanted.inside);
                    prop_assert!(!clear.iter().any(|held| held.intersects(rect.shrink(0.01))), "{:?} {:?}", rect, clear);
                }
                if let [a, b] = shown[..] {
                    prop_assert!(!a.shrink(0.01).intersects(b.shrink(0.01)), "{:?} {:?}", a, b);
                }
            }
        }
    }
}
