//! Contacts of a tool, and fewer that stand for many.
//!
//! In: points where a tool touches. Out: at most [`MOST_POINTS`] of them, each with the force of its members, at the middle of it.

use nalgebra::{Matrix3, Vector3};

type V3 = Vector3<f64>;

/// Contacts at most.
pub const MOST_POINTS: usize = 16;
/// Members of a merged point whose compliance is asked for.
const MOST_MEMBERS: usize = 4;
/// Least cosine between the normals of points that are merged.
const SAME_WAY: f64 = 0.5;

/// A contact of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchPoint {
    /// Lever arm from the tool's origin, in the room, m.
    pub arm: V3,
    /// Axes in columns: the normal into the body, and two tangents.
    pub axes: Matrix3<f64>,
    /// Coefficient of friction.
    pub friction: f64,
    /// Force on the body, along the room's axes, N.
    pub force: V3,
    /// Distance to the tool, m; 0 or less where they touch.
    pub gap: f64,
    /// Normal force at which the body yields without more, N; infinite where nothing breaks.
    pub limit: f64,
}

/// Members of each merged point, with their shares in its force.
pub fn clusters(points: &[TouchPoint]) -> Vec<Vec<(usize, f64)>> {
    if points.len() <= MOST_POINTS {
        return (0..points.len()).map(|i| vec![(i, 1.0)]).collect();
    }
    // The strongest first, then always the point that is farthest from all that were taken.
    let strength = |point: &TouchPoint| point.force.norm();
    let strongest =
        (0..points.len()).max_by(|a, b| strength(&points[*a]).total_cmp(&strength(&points[*b]))).unwrap_or(0);
    let mut centres = vec![strongest];
    let normal = |point: &TouchPoint| point.axes.column(0).into_owned();
    let size = points.iter().map(|point| (point.arm - points[strongest].arm).norm()).fold(0.0, f64::max);
    // Points that face other ways are far from one another: their forces would cancel.
    let apart = |a: &TouchPoint, b: &TouchPoint| {
        let faces = normal(a).dot(&normal(b)) > SAME_WAY;
        (a.arm - b.arm).norm() + if faces { 0.0 } else { size }
    };
    let mut far: Vec<f64> = points.iter().map(|point| apart(point, &points[strongest])).collect();
    while centres.len() < MOST_POINTS {
        let next = (0..points.len()).max_by(|a, b| far[*a].total_cmp(&far[*b])).unwrap_or(0);
        centres.push(next);
        for (far, point) in far.iter_mut().zip(points) {
            *far = far.min(apart(point, &points[next]));
        }
    }
    let mut clusters = vec![Vec::new(); centres.len()];
    for (i, point) in points.iter().enumerate() {
        let distance = |centre: &usize| apart(point, &points[*centre]);
        let nearest =
            (0..centres.len()).min_by(|a, b| distance(&centres[*a]).total_cmp(&distance(&centres[*b])));
        clusters[nearest.unwrap_or(0)].push((i, strength(point)));
    }
    for members in &mut clusters {
        members.sort_by(|(_, a), (_, b)| b.total_cmp(a));
        let sum: f64 = members.iter().map(|(_, share)| share).sum();
        let even = 1.0 / members.len().max(1) as f64;
        members.iter_mut().for_each(|(_, share)| *share = if sum > 0.0 { *share / sum } else { even });
    }
    clusters.retain(|members| !members.is_empty());
    clusters
}

/// The members that have most of the force, with their shares among themselves: they stand for all in the compliance.
pub fn strongest(members: &[(usize, f64)]) -> Vec<(usize, f64)> {
    let few = &members[..members.len().min(MOST_MEMBERS)];
    let sum: f64 = few.iter().map(|(_, share)| share).sum();
    few.iter().map(|(i, share)| (*i, share / sum)).collect()
}

/// The point with the force of its members, at the middle of it.
pub fn merged(points: &[TouchPoint], members: &[(usize, f64)]) -> TouchPoint {
    if let [(one, _)] = members {
        return points[*one];
    }
    let sum = |of: &dyn Fn(&TouchPoint) -> V3| members.iter().map(|(i, w)| of(&points[*i]) * *w).sum::<V3>();
    let first = &points[members[0].0];
    let normal = sum(&|point| point.axes.column(0).into_owned())
        .try_normalize(0.0)
        .unwrap_or_else(|| first.axes.column(0).into_owned());
    TouchPoint {
        arm: sum(&|point| point.arm),
        axes: contact_axes(&normal),
        friction: members.iter().map(|(i, _)| points[*i].friction).fold(f64::INFINITY, f64::min),
        force: members.iter().map(|(i, _)| points[*i].force).sum(),
        gap: members.iter().map(|(i, _)| points[*i].gap).fold(f64::INFINITY, f64::min),
        limit: members.iter().map(|(i, _)| points[*i].limit).sum(),
    }
}

/// Axes of a contact in columns: its normal, and two along the surface.
pub fn contact_axes(normal: &V3) -> Matrix3<f64> {
    let across = if normal.x.abs() < 0.7 { V3::x() } else { V3::y() };
    let first = normal.cross(&across).normalize();
    Matrix3::from_columns(&[*normal, first, normal.cross(&first)])
}
