//! Loss of a body's equilibrium: the critical pose and the mode, in words and numbers.
//!
//! In: the tangent's least eigenvalue and its mode ([`Stability`]) at the last equilibrium before it, and the ways of the
//! control elements. Out: how far an element has turned there, and where and how the body gives way. The mode is seen from
//! the turned material: φ̄ = Rᵀ φ, R being the rotation of F at each point of the elements, and φ the mean of their nodes.

use crate::base::table::count;
use crate::deform::pose::follow::FollowedTurn;
use crate::deform::pose::screw::Way;
use crate::fem::{StrainPoints, nearest_turn};
use crate::green::ControlElement;
use crate::mesh::TetMesh;
use crate::solve::Stability;
use nalgebra::{Matrix3, Vector3};
use std::fmt;

/// The pose in which a path through static equilibria ends, and the mode in which the body gives way.
#[derive(Clone, Debug, PartialEq)]
pub struct CriticalPose {
    /// Share of the way at which it stands.
    pub share: f64,
    /// Poses of the control elements there, in words.
    pub pose: String,
    /// The largest angle by which two control elements have turned against each other there, rad.
    pub turn: f64,
    /// The least eigenvalue of the tangent stiffness, in parts of that at rest.
    pub least: f64,
    /// Share of the way at which it extrapolates to zero, and that angle there.
    pub zero_at: Option<(f64, f64)>,
    /// The path itself drives the mode; otherwise the body buckles to either side of it.
    pub snaps: bool,
    /// Whether the stiffness of the mode is lost, and not the solver at its end.
    pub is_critical: bool,
    /// Modes that lose their stiffness together.
    pub modes: usize,
    pub shape: ModeShape,
}

/// A mode, seen from the turned material.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeShape {
    /// Part of Σ V |φ̄|² along the body's axis.
    pub along: f64,
    /// The body's axis at rest: from the first control element to the one farthest from it.
    pub axis: Vector3<f64>,
    /// The node that moves most: its tag, and where it rested, m.
    pub tag: u64,
    pub place: Vector3<f64>,
    /// Part of the body that moves: (Σ V |φ̄|²)² / (Σ V Σ V |φ̄|⁴).
    pub spread: f64,
}

impl fmt::Display for CriticalPose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let how = match (self.is_critical, self.snaps) {
            (true, true) => "the body snaps out of its way",
            (true, false) => "the body buckles",
            (false, _) => "the solver ends",
        };
        write!(f, "{how} with {}", self.pose)
    }
}

impl CriticalPose {
    /// The least eigenvalue, where it comes to zero, and its mode.
    pub fn details(&self) -> String {
        let ModeShape { along, axis, tag, place, spread } = &self.shape;
        let zero = self.zero_at.map_or_else(String::new, |(share, turn)| {
            let turn = if self.turn > 0.0 { format!(", {:.1}°", turn.to_degrees()) } else { String::new() };
            format!(", zero at {:.1} % of the way{turn}", 100.0 * share)
        });
        format!(
            "Least eigenvalue of the tangent stiffness: {:.2} % of that at rest{zero} ({}). Its mode moves {:.0} % of the body, \
             {:.0} % across the axis ({:.2}, {:.2}, {:.2}), most at node {tag} at ({:.4}, {:.4}, {:.4}) m",
            100.0 * self.least,
            count(self.modes.max(1), "mode"),
            100.0 * spread,
            100.0 * (1.0 - along),
            axis.x,
            axis.y,
            axis.z,
            place.x,
            place.y,
            place.z
        )
    }
}

/// The ways of the control elements from where they began.
pub struct Ways<'a> {
    pub controls: &'a [ControlElement],
    pub ways: &'a [Way],
    /// Turn of each control element before the way.
    pub before: &'a [FollowedTurn],
    /// Steps in which no element turns by more than 30°.
    pub steps: usize,
}

impl Ways<'_> {
    /// Turn of every control element at `share` of the way.
    pub fn turns(&self, share: f64) -> Vec<FollowedTurn> {
        let mut turns = self.before.to_vec();
        for step in 1..=self.steps {
            let at = share * step as f64 / self.steps as f64;
            for (turn, way) in turns.iter_mut().zip(self.ways) {
                *turn = turn.follow(&way.pose(at));
            }
        }
        turns
    }

    /// The two control elements that have turned most against each other: the one turned further from rest, the other,
    /// and the angle, rad.
    fn farthest(&self, share: f64) -> Option<(usize, usize, f64)> {
        let turns = self.turns(share);
        let pairs = (0..turns.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let apart = pairs.map(|(i, j)| (i, j, turns[i].against(&turns[j])));
        let (i, j, angle) = apart.max_by(|a, b| a.2.total_cmp(&b.2))?;
        let own = |e: usize| turns[e].against(&FollowedTurn::REST);
        Some(if own(i) >= own(j) { (i, j, angle) } else { (j, i, angle) })
    }

    /// Poses of the control elements at `share`, in words, and the largest angle between two, rad.
    fn pose(&self, share: f64) -> (String, f64) {
        let name = |e: usize| self.controls[e].name.as_str();
        if let Some((i, j, angle)) = self.farthest(share).filter(|(_, _, angle)| *angle > 1e-6) {
            return (format!("{} turned by {:.1}° against {}", name(i), angle.to_degrees(), name(j)), angle);
        }
        // The first element rests, or what the others have in common with it is no strain.
        let place = |e: usize| self.ways[e].pose(share).translation;
        let moved = |e: usize| (place(e) - place(0)).norm();
        let told = (1..self.ways.len()).max_by(|&a, &b| moved(a).total_cmp(&moved(b)));
        let told = told.filter(|e| moved(*e) > 0.0);
        let told = told.map(|e| format!("{} moved by {:.4} m against {}", name(e), moved(e), name(0)));
        (told.unwrap_or_else(|| format!("{:.1} % of its loads", 100.0 * share)), 0.0)
    }

    /// The critical pose if the way ends at `share`.
    pub fn critical(
        &self,
        share: f64,
        stability: &Stability,
        mesh: &TetMesh,
        strained: (&StrainPoints, &[Matrix3<f64>]),
    ) -> CriticalPose {
        let (pose, turn) = self.pose(share);
        let zero = |at: f64| (at, self.farthest(at).map_or(0.0, |(_, _, angle)| angle));
        CriticalPose {
            share,
            pose,
            turn,
            least: stability.least,
            zero_at: stability.zero_at.map(zero),
            snaps: stability.snaps(),
            is_critical: stability.is_critical,
            modes: stability.modes,
            shape: shape(&stability.mode.data, mesh, strained, axis(self.controls)),
        }
    }
}

/// The direction from the first control element to the one farthest from it.
fn axis(controls: &[ControlElement]) -> Vector3<f64> {
    let Some(first) = controls.first() else { return Vector3::x() };
    let ways = controls.iter().map(|control| control.origin - first.origin);
    let longest = ways.max_by(|a, b| a.norm().total_cmp(&b.norm()));
    longest.and_then(|way| way.try_normalize(f64::MIN_POSITIVE)).unwrap_or_else(Vector3::x)
}

fn shape(
    mode: &[f64],
    mesh: &TetMesh,
    (points, gradients): (&StrainPoints, &[Matrix3<f64>]),
    axis: Vector3<f64>,
) -> ModeShape {
    let at = |node: usize| Vector3::from_column_slice(&mode[3 * node..][..3]);
    let (mut volume, mut square, mut fourth, mut along) = (0.0, 0.0, 0.0, 0.0);
    for (point, h) in gradients.iter().enumerate() {
        let (v, nodes) = (points.volume[point], points.nodes_of(points.element_of(point)));
        let sum: Vector3<f64> = nodes.iter().map(|&node| at(node as usize)).sum();
        let seen = nearest_turn(&(Matrix3::identity() + h)).inverse() * (sum / nodes.len() as f64);
        let size = seen.norm_squared();
        volume += v;
        square += v * size;
        fourth += v * size * size;
        along += v * seen.dot(&axis).powi(2);
    }
    let most = (0..mesh.nodes.len()).max_by(|&a, &b| at(a).norm().total_cmp(&at(b).norm())).unwrap_or(0);
    ModeShape {
        along: along / square.max(f64::MIN_POSITIVE),
        axis,
        tag: mesh.tags.get(most).copied().unwrap_or(0),
        place: mesh.nodes.get(most).copied().unwrap_or_default(),
        spread: square * square / (volume * fourth).max(f64::MIN_POSITIVE),
    }
}
