//! Posture of a screen: its tilt and the direction that it faces, as an inclinometer and a compass measure them.
//!
//! In: a [`Screen`]. Out: angles in degrees, and words for people who measured the same with a tape.

use super::screen::Screen;

/// Smallest angle that is mentioned, degrees.
const STRAIGHT: f64 = 0.05;
/// Tilt between lying and standing, degrees.
const HALF: f64 = 45.0;
/// A lower edge that is steeper than 45° is no lower edge: the sine.
const ASIDE: f64 = std::f64::consts::FRAC_1_SQRT_2;

impl Screen {
    /// Angle between the picture and the floor, degrees: 0 lies face up with its upper edge towards the back, 90 stands,
    /// less leans back, more leans forward, 180 hangs face down; below 0 its upper edge is lower than its lower one.
    pub fn tilt_degrees(&self) -> f64 {
        let [_, up, normal] = self.axes();
        up.y.atan2(normal.y).to_degrees()
    }

    /// The direction that a standing picture faces, degrees about the vertical: 0 to +z, 90 to +x, -90 to -x.
    pub fn facing_degrees(&self) -> f64 {
        let [right, ..] = self.axes();
        (-right.z).atan2(right.x).to_degrees()
    }

    /// Distance of upper_left from where a rectangle on the same lower edge has it, along that edge, m.
    pub fn off_rectangle_m(&self) -> f64 {
        let across = self.lower_right - self.lower_left;
        (across.dot(&(self.upper_left - self.lower_left)) / across.norm()).abs()
    }

    /// Tilt in words.
    pub fn posture(&self) -> String {
        let tilt = self.tilt_degrees();
        let [right, up, normal] = self.axes();
        match tilt {
            _ if right.y.abs() > ASIDE => "stands on its side".into(),
            _ if up.y < -ASIDE && normal.y.abs() < ASIDE => "stands on its head".into(),
            t if t.abs() < STRAIGHT => "lies level".into(),
            t if (t - 90.0).abs() < STRAIGHT => "stands upright".into(),
            t if 180.0 - t.abs() < STRAIGHT => "hangs level, face down".into(),
            t if (0.0..=HALF).contains(&t) => format!("rises by {t:.1}° to its upper edge"),
            t if (-HALF..0.0).contains(&t) => format!("falls by {:.1}° to its upper edge", -t),
            t if (HALF..90.0).contains(&t) => format!("leans back by {:.1}°", 90.0 - t),
            t if (90.0..=90.0 + HALF).contains(&t) => format!("leans forward by {:.1}°", t - 90.0),
            _ => "faces down or away".into(),
        }
    }

    /// Sides, tilt and heights, to be held against the tape.
    pub fn measures(&self) -> String {
        let heights = [self.lower_left, self.lower_right, self.upper_left, self.upper_right()].map(|c| c.y);
        let [low, high] = [
            heights.iter().fold(f64::INFINITY, |a, b| a.min(*b)),
            heights.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)),
        ];
        // Adding 0.0 prints -0.0 as 0.0.
        let tenth = |degrees: f64| (degrees * 10.0).round() / 10.0 + 0.0;
        format!(
            "{:.3} × {:.3} m, {} (tilt {:.1}°), facing {:.1}°, {:.3} to {:.3} m high",
            self.width_m(),
            self.height_m(),
            self.posture(),
            tenth(self.tilt_degrees()),
            tenth(self.facing_degrees()),
            low,
            high
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::stage::Stage;
    use nalgebra::Point3;

    #[test]
    fn built_in_screens_have_the_postures_that_their_names_say() {
        let stage = |name: &str| Stage::find(name).unwrap();
        let angles = |name: &str| {
            let of = |screen: &crate::stage::Screen| {
                let angles = [screen.tilt_degrees(), screen.facing_degrees()];
                (screen.name.clone(), angles.map(|angle| (angle * 10.0).round() / 10.0 + 0.0))
            };
            stage(name).screens.iter().map(of).collect::<Vec<_>>()
        };
        assert_eq!(angles("workbench"), [("table".into(), [0.0, 0.0]), ("wall".into(), [90.0, 0.0])]);
        let cave = angles("cyberstage");
        let of = |name: &str| cave.iter().find(|(known, _)| known == name).unwrap().1;
        assert_eq!((of("left"), of("right"), of("floor")), ([90.0, 90.0], [90.0, -90.0], [0.0, 0.0]));
        // The one-sided bench slopes by 20° to the horizontal.
        assert_eq!(stage("workbench-one-sided").screens[0].posture(), "rises by 20.0° to its upper edge");
    }

    #[test]
    fn leaning_forward_and_falling_back_are_told_from_their_opposites() {
        let mut stage = Stage::find("workbench").unwrap();
        let [table, wall] = &mut stage.screens[..] else { panic!() };
        wall.upper_left = Point3::new(-0.80, 2.18, 0.112);
        assert_eq!(wall.posture(), "leans forward by 5.0°");
        wall.upper_left.z = -0.112;
        assert_eq!(wall.posture(), "leans back by 5.0°");
        table.upper_left.y = 0.72;
        assert_eq!(table.posture(), "falls by 8.0° to its upper edge");
        let [corner, across, upward] = [wall.lower_left, wall.lower_right, wall.upper_left];
        (wall.lower_left, wall.lower_right, wall.upper_left) = (upward, corner, upward + (across - corner));
        assert_eq!(wall.posture(), "stands on its side");
        (wall.lower_left, wall.lower_right, wall.upper_left) = (upward + (across - corner), upward, across);
        assert_eq!(wall.posture(), "stands on its head");
        let told = table.measures();
        assert!(told.starts_with("1.600 × 1.293 m, falls by 8.0°"), "{told}");
        assert!(told.contains("0.720 to 0.900 m high"), "{told}");
    }
}
