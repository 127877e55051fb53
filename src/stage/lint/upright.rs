//! Finds stages that were written with z up.
//!
//! In: a [`Stage`]. Out: an error if every screen stands or lies as screens do when z points up, and fewer do when y does.

use crate::base::diagnostic::{Diagnostic, Severity};
use crate::stage::description::Stage;
use crate::stage::error::place;
use crate::stage::screen::Screen;
use nalgebra::{Point3, Vector3};

/// Least cosine between the vertical and the upward edge of a picture that stands, or the normal of one that lies.
const UPRIGHT: f64 = 0.5;

pub fn lint(stage: &Stage) -> Option<Diagnostic> {
    let stands = |screen: &Screen, up: &Vector3<f64>| screen.axes()[1].dot(up) > UPRIGHT;
    let lies = |screen: &Screen, up: &Vector3<f64>| screen.axes()[2].dot(up) > UPRIGHT;
    let right = |up: Vector3<f64>| {
        stage.screens.iter().filter(|screen| stands(screen, &up) || lies(screen, &up)).count()
    };
    let standing = stage.screens.iter().find(|screen| stands(screen, &Vector3::z()))?;
    let with_z_up = right(Vector3::z());
    let hangs = |screen: &&Screen| lies(screen, &-Vector3::z());
    let ceilings = stage.screens.iter().filter(hangs).count();
    if with_z_up + ceilings < stage.screens.len() || with_z_up <= right(Vector3::y()) {
        return None;
    }
    let Point3 { coords: x, .. } = standing.lower_left;
    let turned = Point3::new(x.x, x.z, -x.y);
    let message = format!(
        "its screens stand as if z pointed up, and stages have y up. Write every [x, y, z] as [x, z, -y], such as the \
         lower_left {} of {} as {}",
        place(&standing.lower_left),
        standing.name,
        place(&turned)
    );
    Some(Diagnostic::new(Severity::Error, "stage", message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;
    use nalgebra::UnitQuaternion;
    use std::f64::consts::FRAC_PI_2;

    /// The stage as somebody writes it for whom z points up.
    fn with_z_up(name: &str) -> Stage {
        let mut stage = Stage::find(name).unwrap();
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        for screen in &mut stage.screens {
            for corner in [&mut screen.lower_left, &mut screen.lower_right, &mut screen.upper_left] {
                *corner = turn * *corner;
            }
        }
        stage
    }

    #[test]
    fn stages_with_z_up_are_found() {
        for name in ["workbench", "cyberstage", "cave6", "cave3", "powerwall", "desktop"] {
            let found = lint(&with_z_up(name)).unwrap_or_else(|| panic!("{name} passes"));
            assert_eq!(found.severity, Severity::Error, "{name}");
        }
        let said = lint(&with_z_up("workbench")).unwrap().message;
        assert!(said.ends_with("of wall as [-0.8000, 0.9000, 0.0000]"), "{said}");
    }

    /// Each wall was reported to be on its side, in addition to the cause.
    #[test]
    fn walls_with_z_up_are_not_said_to_be_turned() {
        let stage = with_z_up("cave3");
        let said: Vec<String> =
            crate::stage::lint(&stage, &[]).into_iter().map(|found| found.message).collect();
        assert!(!said.iter().any(|message| message.contains("on its side: what")), "{said:#?}");
        assert_eq!(crate::stage::errors(&stage).count(), 1);
    }

    #[test]
    fn stages_with_y_up_pass() {
        for (name, _) in BUILT_IN {
            assert_eq!(lint(&Stage::find(name).unwrap()), None, "{name}");
        }
    }
}
