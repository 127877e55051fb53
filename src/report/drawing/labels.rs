//! Where labels go beside their points: they never cover each other, and cover points and lines as little as can be.
//!
//! Greedy, then improved: each label in turn takes the cheapest of some hundred places around its point, and once all
//! have one, each may move again (Christensen, Marks and Shieber, ACM Trans. Graph. 14, 1995, 203–232, section 3).

/// x from left, y from top, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub fn around(centre: [f64; 2], half: f64) -> Rect {
        Rect { x: centre[0] - half, y: centre[1] - half, width: 2.0 * half, height: 2.0 * half }
    }

    pub fn overlaps(&self, other: &Rect) -> bool {
        self.x < other.x + other.width
            && other.x < self.x + self.width
            && self.y < other.y + other.height
            && other.y < self.y + self.height
    }

    pub fn contains(&self, other: &Rect) -> bool {
        other.x >= self.x
            && other.y >= self.y
            && other.x + other.width <= self.x + self.width
            && other.y + other.height <= self.y + self.height
    }

    /// The point of the rectangle nearest to `p`.
    pub fn nearest(&self, p: [f64; 2]) -> [f64; 2] {
        [p[0].clamp(self.x, self.x + self.width), p[1].clamp(self.y, self.y + self.height)]
    }

    /// Whether a straight line from a to b touches it (clipping by Liang and Barsky).
    pub fn meets(&self, [a, b]: [[f64; 2]; 2]) -> bool {
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
pub struct Wish {
    pub at: [f64; 2],
    pub width: f64,
    pub height: f64,
}

/// What labels should not cover.
#[derive(Clone, Debug, Default)]
pub struct Obstacles {
    pub points: Vec<[f64; 2]>,
    pub lines: Vec<[[f64; 2]; 2]>,
}

/// Half of a marker and a gap.
const MARKER: f64 = 7.0;
const RINGS: [f64; 9] = [8.0, 13.0, 20.0, 30.0, 44.0, 60.0, 80.0, 105.0, 140.0];
/// Up and to the right first.
const DIRECTIONS: [[f64; 2]; 12] = [
    [0.71, -0.71],
    [1.0, 0.0],
    [0.71, 0.71],
    [-0.71, -0.71],
    [-1.0, 0.0],
    [-0.71, 0.71],
    [0.0, -1.0],
    [0.0, 1.0],
    [0.9, -0.42],
    [0.9, 0.42],
    [-0.9, -0.42],
    [-0.9, 0.42],
];

/// A place inside `area` for each label, `None` where there is no room that no other label takes.
pub fn place(wishes: &[Wish], obstacles: &Obstacles, area: Rect) -> Vec<Option<Rect>> {
    let mut placed: Vec<Option<Rect>> = vec![None; wishes.len()];
    for _ in 0..3 {
        for i in 0..wishes.len() {
            placed[i] = None;
            placed[i] = best(i, wishes, &placed, obstacles, area);
        }
    }
    placed
}

fn best(
    i: usize,
    wishes: &[Wish],
    placed: &[Option<Rect>],
    obstacles: &Obstacles,
    area: Rect,
) -> Option<Rect> {
    let wish = &wishes[i];
    let mut found: Option<(f64, Rect)> = None;
    for radius in RINGS {
        for (turn, direction) in DIRECTIONS.iter().enumerate() {
            let rect = beside(wish, *direction, radius);
            if !area.contains(&rect) || placed.iter().flatten().any(|other| padded(other).overlaps(&rect)) {
                continue;
            }
            let cost = radius + 0.5 * turn as f64 + covered(i, &rect, wishes, placed, obstacles);
            if found.is_none_or(|(least, _)| cost < least) {
                found = Some((cost, rect));
            }
        }
    }
    found.map(|(_, rect)| rect)
}

fn padded(rect: &Rect) -> Rect {
    Rect { x: rect.x - 3.0, y: rect.y - 1.0, width: rect.width + 6.0, height: rect.height + 2.0 }
}

fn beside(wish: &Wish, [dx, dy]: [f64; 2], radius: f64) -> Rect {
    let shift = |d: f64, size: f64| match d {
        d if d > 0.3 => 0.0,
        d if d < -0.3 => -size,
        _ => -0.5 * size,
    };
    Rect {
        x: wish.at[0] + radius * dx + shift(dx, wish.width),
        y: wish.at[1] + radius * dy + shift(dy, wish.height),
        width: wish.width,
        height: wish.height,
    }
}

/// Pixels of distance that covering all this is worth.
fn covered(i: usize, rect: &Rect, wishes: &[Wish], placed: &[Option<Rect>], obstacles: &Obstacles) -> f64 {
    let leader = [wishes[i].at, rect.nearest(wishes[i].at)];
    let points = obstacles.points.iter().filter(|p| Rect::around(**p, MARKER).overlaps(rect)).count();
    let lines = obstacles.lines.iter().filter(|line| rect.meets(**line)).count();
    let own = |p: &&[f64; 2]| (p[0] - wishes[i].at[0]).hypot(p[1] - wishes[i].at[1]) > 2.0 * MARKER;
    let passed =
        obstacles.points.iter().filter(own).filter(|p| Rect::around(**p, MARKER - 2.0).meets(leader));
    let mut cost = 25.0 * points as f64 + 22.0 * lines as f64 + 40.0 * passed.count() as f64;
    for (j, other) in placed.iter().enumerate().filter(|(j, _)| *j != i) {
        let Some(other) = other else {
            continue;
        };
        let theirs = [wishes[j].at, other.nearest(wishes[j].at)];
        let crossings = [other.meets(leader), rect.meets(theirs), crosses(leader, theirs)];
        cost += 40.0 * crossings.iter().filter(|&&crossing| crossing).count() as f64;
    }
    cost
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
        let wish = Wish { at: [300.0, 150.0], width: 80.0, height: 14.0 };
        let placed = place(&[wish], &Obstacles::default(), AREA);
        let rect = placed[0].expect("there is room");
        assert_eq!([rect.x, rect.y + rect.height], [305.68, 144.32]);
    }

    proptest! {
        #[test]
        fn labels_never_cover_each_other(
            at in prop::collection::vec((0.0_f64..600.0, 0.0_f64..300.0), 0..30),
            width in 10.0_f64..150.0,
        ) {
            let points: Vec<[f64; 2]> = at.iter().map(|&(x, y)| [x, y]).collect();
            let wishes: Vec<Wish> = points.iter().map(|&at| Wish { at, width, height: 14.0 }).collect();
            let placed = place(&wishes, &Obstacles { points, lines: vec![] }, AREA);
            for (i, rect) in placed.iter().enumerate() {
                let Some(rect) = rect else { continue };
                prop_assert!(AREA.contains(rect));
                prop_assert!(!placed[..i].iter().flatten().any(|other| other.overlaps(rect)));
            }
        }
    }
}
