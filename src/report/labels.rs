//! Places labels beside their points. Labels never cover each other, and cover points and lines as little as possible.
//!
//! Each label in turn takes the cheapest of some hundred places around its point; once all have one, each may move again
//! (Christensen, Marks and Shieber, ACM Trans. Graph. 14, 1995, 203–232, section 3).

/// x from left, y from top, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    /// The rectangle with margins `by` on all sides; smaller where `by` is negative.
    pub fn grown(&self, by: [f64; 2]) -> Rect {
        let [dx, dy] = by;
        Rect { x: self.x - dx, y: self.y - dy, width: self.width + 2.0 * dx, height: self.height + 2.0 * dy }
    }

    fn around([x, y]: [f64; 2], half: f64) -> Rect {
        Rect { x, y, width: 0.0, height: 0.0 }.grown([half; 2])
    }

    fn overlaps(&self, other: &Rect) -> bool {
        let apart = |a: f64, wide_a: f64, b: f64, wide_b: f64| a + wide_a <= b || b + wide_b <= a;
        !apart(self.x, self.width, other.x, other.width) && !apart(self.y, self.height, other.y, other.height)
    }

    fn contains(&self, other: &Rect) -> bool {
        let corners = [[other.x, other.y], [other.x + other.width, other.y + other.height]];
        corners.iter().all(|corner| self.nearest(*corner) == *corner)
    }

    /// The point of the rectangle nearest to `p`.
    pub fn nearest(&self, p: [f64; 2]) -> [f64; 2] {
        [p[0].clamp(self.x, self.x + self.width), p[1].clamp(self.y, self.y + self.height)]
    }

    /// Whether a straight line from a to b touches it (clipping by Liang and Barsky).
    fn meets(&self, [a, b]: [[f64; 2]; 2]) -> bool {
        let mut range = [0.0_f64, 1.0_f64];
        for axis in 0..2 {
            let (low, size) = if axis == 0 { (self.x, self.width) } else { (self.y, self.height) };
            let along = b[axis] - a[axis];
            if along == 0.0 {
                if a[axis] < low || a[axis] > low + size {
                    return false;
                }
                continue;
            }
            let (s, t) = ((low - a[axis]) / along, (low + size - a[axis]) / along);
            range = [range[0].max(s.min(t)), range[1].min(s.max(t))];
        }
        range[0] <= range[1]
    }
}

/// A label of this size beside the point `at`.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    pub at: [f64; 2],
    pub width: f64,
    pub height: f64,
}

/// Points and lines that labels should not cover.
#[derive(Clone, Debug, Default)]
pub struct Obstacles {
    pub points: Vec<[f64; 2]>,
    pub lines: Vec<[[f64; 2]; 2]>,
}

/// Half of a marker and a gap.
const MARKER: f64 = 7.0;
const RINGS: [f64; 9] = [8.0, 13.0, 20.0, 30.0, 44.0, 60.0, 80.0, 105.0, 140.0];
/// Degrees, the best first: up and to the right.
const DIRECTIONS: [f64; 12] =
    [-45.0, 0.0, 45.0, -135.0, 180.0, 135.0, -90.0, 90.0, -25.0, 25.0, -155.0, 155.0];

/// A place inside `area` for each label, `None` where there is no room that no other label takes.
pub fn place(labels: &[Label], obstacles: &Obstacles, area: Rect) -> Vec<Option<Rect>> {
    let mut placed: Vec<Option<Rect>> = vec![None; labels.len()];
    for i in (0..labels.len()).cycle().take(3 * labels.len()) {
        placed[i] = None;
        let mut least = f64::INFINITY;
        for (radius, turn) in
            RINGS.iter().flat_map(|radius| (0..DIRECTIONS.len()).map(move |turn| (radius, turn)))
        {
            let rect = beside(&labels[i], DIRECTIONS[turn], *radius);
            let taken = |other: &Rect| other.grown([3.0, 1.0]).overlaps(&rect);
            if !area.contains(&rect)
                || placed.iter().enumerate().any(|(j, other)| j != i && other.as_ref().is_some_and(taken))
            {
                continue;
            }
            let cost = radius + 0.5 * turn as f64 + covered(i, &rect, labels, &placed, obstacles);
            if cost < least {
                (least, placed[i]) = (cost, Some(rect));
            }
        }
    }
    placed
}

/// The label in a direction from its point: it touches the end of that way with its nearest side or corner.
fn beside(label: &Label, degrees: f64, radius: f64) -> Rect {
    let (dy, dx) = degrees.to_radians().sin_cos();
    let shift = |d: f64, size: f64| match d {
        d if d > 0.3 => 0.0,
        d if d < -0.3 => -size,
        _ => -0.5 * size,
    };
    let x = label.at[0] + radius * dx + shift(dx, label.width);
    let y = label.at[1] + radius * dy + shift(dy, label.height);
    Rect { x, y, width: label.width, height: label.height }
}

/// Pixels of distance that covering all this is worth.
fn covered(i: usize, rect: &Rect, labels: &[Label], placed: &[Option<Rect>], obstacles: &Obstacles) -> f64 {
    let leader = |j: usize, rect: &Rect| [labels[j].at, rect.nearest(labels[j].at)];
    let own = leader(i, rect);
    let far = |p: &&[f64; 2]| (p[0] - own[0][0]).hypot(p[1] - own[0][1]) > 2.0 * MARKER;
    let points = obstacles.points.iter().filter(|p| Rect::around(**p, MARKER).overlaps(rect)).count();
    let lines = obstacles.lines.iter().filter(|line| rect.meets(**line)).count();
    let passed = obstacles.points.iter().filter(far).filter(|p| Rect::around(**p, MARKER - 2.0).meets(own));
    let others =
        placed.iter().enumerate().filter(|(j, _)| *j != i).filter_map(|(j, other)| Some((j, (*other)?)));
    let crossed = others.map(|(j, other)| {
        let theirs = leader(j, &other);
        usize::from(other.meets(own)) + usize::from(rect.meets(theirs)) + usize::from(crosses(own, theirs))
    });
    25.0 * points as f64 + 22.0 * lines as f64 + 40.0 * (passed.count() + crossed.sum::<usize>()) as f64
}

fn crosses([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let side =
        |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AREA: Rect = Rect { x: 0.0, y: 0.0, width: 600.0, height: 300.0 };

    #[test]
    fn a_line_meets_a_rectangle() {
        let rect = Rect { x: 10.0, y: 10.0, width: 20.0, height: 10.0 };
        assert!(rect.meets([[0.0, 0.0], [40.0, 30.0]]));
        assert!(rect.meets([[15.0, 15.0], [16.0, 16.0]]));
        assert!(!rect.meets([[0.0, 0.0], [9.0, 30.0]]));
        assert!(!rect.meets([[12.0, 5.0], [28.0, 5.0]]));
    }

    #[test]
    fn a_lone_label_stands_at_its_point() {
        let label = Label { at: [300.0, 150.0], width: 80.0, height: 14.0 };
        let placed = place(&[label], &Obstacles::default(), AREA);
        let rect = placed[0].expect("there is room");
        let away = [rect.x - 300.0, 150.0 - rect.y - rect.height];
        assert!(away.iter().all(|d| (d - 8.0 * 0.5_f64.sqrt()).abs() < 1e-9), "{away:?}");
    }

    proptest! {
        #[test]
        fn labels_never_cover_each_other(
            at in prop::collection::vec((0.0_f64..600.0, 0.0_f64..300.0), 0..30),
            width in 10.0_f64..150.0,
        ) {
            let points: Vec<[f64; 2]> = at.iter().map(|&(x, y)| [x, y]).collect();
            let labels: Vec<Label> = points.iter().map(|&at| Label { at, width, height: 14.0 }).collect();
            let placed = place(&labels, &Obstacles { points, lines: vec![] }, AREA);
            for (i, rect) in placed.iter().enumerate() {
                let Some(rect) = rect else { continue };
                prop_assert!(AREA.contains(rect));
                prop_assert!(!placed[..i].iter().flatten().any(|other| other.overlaps(rect)));
            }
        }
    }
}
