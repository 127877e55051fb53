//! Seams between screens: pairs of edges that run beside each other, and the gap or overlap between them.
//!
//! In: a [`Stage`]. Out: its [`Seam`]s, each with the gap or overlap across the edges, and how far their ends are off along
//! them.

use super::description::Stage;
use super::screen::Screen;
use nalgebra::{Point3, Vector3};

/// An edge of a screen as its viewer names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    Lower,
    Right,
    Upper,
    Left,
}

/// Two edges that run beside each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Seam {
    /// Index into [`Stage::screens`], and which edge of that screen; the lower index first.
    pub edges: [(usize, Edge); 2],
    /// Ends of the part that both edges have in common, on the first, metres in the room.
    pub ends: [Point3<f64>; 2],
    /// Distance of the second edge from the first, m, at both `ends`, measured perpendicular to the first.
    pub gap_m: [f64; 2],
    /// One edge lies within the other screen's picture, so that both show the same place. Otherwise there is a gap.
    pub is_overlap: bool,
    /// Distances by which the second edge's ends lie beyond the first's, m, along the first; negative: short of them.
    pub along_m: [f64; 2],
}

/// A screen that no other one's edge runs beside, and the nearest edges to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Apart {
    /// The lone screen's, and the other's.
    pub edges: [(usize, Edge); 2],
    /// Distance between their ends, at the end where it is greater, m.
    pub distance_m: f64,
}

impl Apart {
    /// The lone screen, and the other one.
    pub fn screens(&self) -> [usize; 2] {
        self.edges.map(|(screen, _)| screen)
    }

    /// `upper edge of table and lower edge of wall`.
    pub fn told(&self, stage: &Stage) -> String {
        let [a, b] = self
            .edges
            .map(|(screen, edge)| format!("{} edge of {}", edge.name(), stage.screens[screen].name));
        format!("{a} and {b}")
    }
}

/// Edges that are further apart than this fraction of the longer one do not meet.
const NEAR: f64 = 0.08;
/// Cosine of the largest angle between edges that meet: 5°.
const PARALLEL: f64 = 0.9962;

impl Edge {
    const ALL: [Edge; 4] = [Edge::Lower, Edge::Right, Edge::Upper, Edge::Left];

    pub fn name(self) -> &'static str {
        match self {
            Self::Lower => "lower",
            Self::Right => "right",
            Self::Upper => "upper",
            Self::Left => "left",
        }
    }

    fn ends(self, screen: &Screen) -> [Point3<f64>; 2] {
        let (ll, lr, ul, ur) =
            (screen.lower_left, screen.lower_right, screen.upper_left, screen.upper_right());
        match self {
            Self::Lower => [ll, lr],
            Self::Right => [lr, ur],
            Self::Upper => [ul, ur],
            Self::Left => [ll, ul],
        }
    }

    /// Unit vector in the screen, from the picture out over this edge.
    fn outwards(self, screen: &Screen) -> Vector3<f64> {
        let [right, up, _] = screen.axes();
        match self {
            Self::Lower => -up,
            Self::Right => right,
            Self::Upper => up,
            Self::Left => -right,
        }
    }
}

impl Seam {
    /// The wider of the gaps at both ends, m.
    pub fn widest_m(&self) -> f64 {
        self.gap_m[0].max(self.gap_m[1])
    }
}

impl Stage {
    /// The screens without a seam, each once: of two that are nearest to each other only the first.
    pub fn apart(&self) -> Vec<Apart> {
        let seams = self.seams();
        let mut found: Vec<Apart> = Vec::new();
        for (i, a) in self.screens.iter().enumerate() {
            if seams.iter().any(|seam| seam.edges.iter().any(|(screen, _)| *screen == i)) {
                continue;
            }
            let others = self.screens.iter().enumerate().filter(|(j, _)| *j != i);
            let pairs = others.flat_map(|(j, b)| {
                Edge::ALL.into_iter().flat_map(move |edge| {
                    Edge::ALL.map(|other| Apart {
                        edges: [(i, edge), (j, other)],
                        distance_m: between(edge.ends(a), other.ends(b)),
                    })
                })
            });
            let nearest = pairs.min_by(|x, y| x.distance_m.total_cmp(&y.distance_m));
            let is_told = |apart: &Apart| found.iter().any(|told| told.screens() == [apart.screens()[1], i]);
            if let Some(nearest) = nearest.filter(|apart| !is_told(apart)) {
                found.push(nearest);
            }
        }
        found
    }

    /// All pairs of edges of different screens that run beside each other, within 5° and 8 % of the longer one's length,
    /// for at least half the shorter one's. Only the nearest pair of two screens counts.
    pub fn seams(&self) -> Vec<Seam> {
        let mut found = Vec::new();
        for (i, a) in self.screens.iter().enumerate() {
            for (j, b) in self.screens.iter().enumerate().skip(i + 1) {
                let pairs = Edge::ALL.into_iter().flat_map(|edge| Edge::ALL.map(|other| (edge, other)));
                let near = pairs.filter_map(|(edge, other)| seam(a, edge, b, other, [i, j]));
                found.extend(near.min_by(|x, y| x.widest_m().total_cmp(&y.widest_m())));
            }
        }
        found
    }
}

/// The greater distance of the ends of two edges, in the order in which they are nearer.
fn between([a, b]: [Point3<f64>; 2], [c, d]: [Point3<f64>; 2]) -> f64 {
    let far = |c: Point3<f64>, d: Point3<f64>| (c - a).norm().max((d - b).norm());
    far(c, d).min(far(d, c))
}

fn seam(a: &Screen, edge: Edge, b: &Screen, other: Edge, screens: [usize; 2]) -> Option<Seam> {
    let [start, end] = edge.ends(a);
    let [mut from, mut to] = other.ends(b);
    let length_m = (end - start).norm();
    let other_m = (to - from).norm();
    let along = (end - start) / length_m;
    let turn = along.dot(&(to - from)) / other_m;
    if turn.abs() < PARALLEL {
        return None;
    }
    if turn < 0.0 {
        std::mem::swap(&mut from, &mut to);
    }
    let [low, high] = [(from - start).dot(&along), (to - start).dot(&along)];
    let (first, last) = (low.max(0.0), high.min(length_m));
    if last - first < 0.5 * length_m.min(other_m) {
        return None;
    }
    // The second edge's point at a place along the first, and its way from there.
    let across = |place_m: f64| {
        let share = (place_m - low) / (high - low);
        from + (to - from) * share - (start + along * place_m)
    };
    let ways = [across(first), across(last)];
    let gap_m = ways.map(|way| way.norm());
    if gap_m[0].max(gap_m[1]) > NEAR * length_m.max(other_m) {
        return None;
    }
    let way = (ways[0] + ways[1]) / 2.0;
    let is_overlap = way.dot(&edge.outwards(a)) < -1e-9 && way.dot(&other.outwards(b)) > 1e-9;
    Some(Seam {
        edges: [(screens[0], edge), (screens[1], other)],
        ends: [first, last].map(|place_m| start + along * place_m),
        gap_m,
        is_overlap,
        along_m: [-low, high - length_m],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The workbench with its wall moved.
    fn moved(by: [f64; 3]) -> Seam {
        let mut stage = Stage::find("workbench").unwrap();
        let wall = &mut stage.screens[1];
        for corner in [&mut wall.lower_left, &mut wall.lower_right, &mut wall.upper_left] {
            *corner += Vector3::from(by);
        }
        let [seam] = &stage.seams()[..] else { panic!("one seam") };
        seam.clone()
    }

    #[test]
    fn the_cyberstage_has_no_gaps() {
        assert!(Stage::find("cyberstage").unwrap().seams().iter().all(|seam| seam.widest_m() == 0.0));
    }

    #[test]
    fn edges_are_named_and_gaps_told_from_overlaps() {
        let closed = moved([0.0, 0.0, 0.0]);
        assert_eq!(closed.edges, [(0, Edge::Upper), (1, Edge::Lower)]);
        assert_eq!((closed.gap_m, closed.is_overlap, closed.along_m), ([0.0; 2], false, [0.0; 2]));
        let above = moved([0.0, 0.014, 0.0]);
        assert!(above.gap_m.iter().all(|gap| (gap - 0.014).abs() < 1e-12) && !above.is_overlap);
        // The wall reaches below the table's top, before its far edge.
        let through = moved([0.0, -0.003, 0.004]);
        assert!(through.gap_m.iter().all(|gap| (gap - 0.005).abs() < 1e-12) && through.is_overlap);
        let aside = moved([0.006, 0.0, 0.0]);
        assert!((aside.along_m[0] + 0.006).abs() < 1e-12 && (aside.along_m[1] - 0.006).abs() < 1e-12);
        assert!(aside.gap_m.iter().all(|gap| *gap < 1e-12));
    }

    #[test]
    fn a_turned_wall_opens_like_scissors() {
        let mut stage = Stage::find("workbench").unwrap();
        stage.screens[1].lower_right.z -= 0.010;
        let seam = &stage.seams()[0];
        assert!(seam.gap_m[0] < 1e-9 && (seam.gap_m[1] - 0.010).abs() < 1e-6, "{seam:?}");
        assert!((seam.widest_m() - 0.010).abs() < 1e-6);
        let wall = &mut stage.screens[1];
        (wall.lower_right.z, wall.lower_left.z) = (wall.lower_right.z + 0.010, wall.lower_left.z - 0.010);
        let seam = &stage.seams()[0];
        assert!((seam.gap_m[0] - 0.010).abs() < 1e-6 && seam.gap_m[1] < 1e-9, "{seam:?}");
        assert!((seam.widest_m() - 0.010).abs() < 1e-6);
    }

    #[test]
    fn the_lbench_gapes_by_14_mm() {
        let stage = Stage::find("lbench").unwrap();
        let seam = &stage.seams()[0];
        assert_eq!(seam.edges, [(0, Edge::Lower), (1, Edge::Upper)]);
        // 14.0 mm upwards and 1.6 mm to the viewer, from the angles and the middles of the screens.
        assert!((seam.gap_m[0] - 0.014_088).abs() < 2e-6, "{seam:?}");
        assert!(!seam.is_overlap);
    }
}
