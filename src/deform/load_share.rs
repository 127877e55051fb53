//! The part of the loads under which errors were measured that acts on a body now.
//!
//! In: the coefficients of the loads' columns then, what acts, and how the body is turned. Out: the part, the same of each load and
//! in its direction to the body; nothing of other loads, nor where forces at points act, under which nothing was measured.

use super::loads::AppliedLoads;
use crate::green::{LoadMeta, Turning};
use nalgebra::{DVectorView, UnitQuaternion, Vector3};

/// Loads that differ by less than this part are the same.
const SAME: f64 = 0.01;

/// The part from 0 to 1; 1 too where there were no loads and are none. `turn`: of the body, against that in which it was measured.
pub(super) fn share(
    measured: &[f64],
    acting: &AppliedLoads,
    metas: &[LoadMeta],
    turn: &UnitQuaternion<f64>,
) -> Option<f64> {
    if !acting.points.is_empty() {
        return None;
    }
    let mut shares: Vec<f64> = Vec::new();
    let mut first = 0;
    for meta in metas {
        let of = |all: &[f64]| {
            let own = all.get(first..first + meta.columns).unwrap_or(&[0.0; 3][..meta.columns.min(3)]);
            DVectorView::from_slice(own, own.len()).into_owned()
        };
        let (then, mut now) = (of(measured), of(&acting.coefficients));
        first += meta.columns;
        if meta.turning == Turning::Fixed && meta.columns == 3 {
            now.copy_from(&(turn.inverse() * Vector3::new(now[0], now[1], now[2])));
        }
        let size = then.norm();
        if size == 0.0 {
            (now.norm() == 0.0).then_some(())?;
            continue;
        }
        let share = then.dot(&now) / (size * size);
        ((&now - &then * share).norm() <= SAME * size).then_some(())?;
        shares.push(share);
    }
    let most = shares.iter().copied().reduce(f64::max).unwrap_or(1.0);
    let least = shares.iter().copied().fold(most, f64::min);
    (least >= 0.0 && most - least <= SAME && most <= 1.0 + SAME).then_some(most.min(1.0))
}

/// Whether that is all of them.
pub(super) fn is_whole(share: f64) -> bool {
    share >= 1.0 - SAME
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{PointLoad, Pull};

    #[test]
    fn the_same_part_of_each_load_is_known_and_no_other() {
        let meta = |name: &str, columns: usize| LoadMeta {
            name: name.into(),
            columns,
            turning: Turning::Fixed,
            unit: "N".into(),
        };
        let metas = [meta("gravity", 3), meta("press", 1), meta("idle", 1)];
        let all = [0.0, -9.81, 0.0, 1e5, 0.0];
        let still = UnitQuaternion::identity();
        let acting =
            |coefficients: &[f64]| AppliedLoads { coefficients: coefficients.to_vec(), points: Vec::new() };
        let of = |coefficients: &[f64]| share(&all, &acting(coefficients), &metas, &still);
        assert_eq!(of(&all), Some(1.0));
        assert_eq!(of(&[0.0, -4.905, 0.0, 5e4, 0.0]), Some(0.5));
        assert_eq!(of(&[1e-3, -9.81, 0.0, 1e5, 0.0]), Some(1.0), "turned by nothing");
        assert_eq!(of(&[]), Some(0.0), "none of them");
        for (other, what) in [
            ([9.81, 0.0, 0.0, 1e5, 0.0], "turned"),
            ([0.0, -9.81, 0.0, 0.0, 0.0], "one without the other"),
            ([0.0, -19.62, 0.0, 2e5, 0.0], "more"),
            ([0.0, 9.81, 0.0, -1e5, 0.0], "the other way round"),
            ([0.0, -9.81, 0.0, 1e5, 1.0], "one that was not there"),
        ] {
            assert_eq!(of(&other), None, "{what}");
        }
        let turned = |axis: Vector3<f64>| {
            share(&all, &acting(&all), &metas, &UnitQuaternion::from_scaled_axis(axis * 1.5))
        };
        assert_eq!(
            (turned(Vector3::x()), turned(Vector3::y())),
            (None, Some(1.0)),
            "the body, about the weight too"
        );
        let pull = Pull::Force(Vector3::x());
        let points = vec![PointLoad { nodes: [0, 1, 2], weights: [1.0, 0.0, 0.0], pull }];
        let pushed = AppliedLoads { coefficients: all.to_vec(), points };
        assert_eq!(share(&all, &pushed, &metas, &still), None, "a force at a point");
        assert_eq!(share(&[], &AppliedLoads::default(), &[], &still), Some(1.0), "a body without loads");
        assert_eq!(share(&[], &acting(&[0.0; 5]), &metas, &still), Some(1.0), "loads that do not act");
    }
}
