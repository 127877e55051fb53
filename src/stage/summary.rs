//! What a stage is, for a reader: sizes, pixels, distances and fields of view, and how its screens meet.
//!
//! In: a [`Stage`]. Out: its text, and its [`Seam`]s with the gap that each really has.

use super::{Screen, Stage};
use nalgebra::Point3;
use std::fmt;

/// An edge that two screens share, or were meant to.
#[derive(Clone, Debug, PartialEq)]
pub struct Seam {
    /// Indices into [`Stage::screens`], ascending.
    pub screens: [usize; 2],
    /// The edge's ends on the first screen, metres in the room.
    pub ends: [Point3<f64>; 2],
    /// The larger distance between the two screens' ends of it.
    pub gap_m: f64,
}

/// Edges whose ends lie further apart than this part of their length were not meant to meet.
const LARGEST_GAP: f64 = 0.05;

impl Stage {
    /// All pairs of screen edges whose ends meet, up to a gap of 5 % of the edge's length.
    pub fn seams(&self) -> Vec<Seam> {
        let mut seams = Vec::new();
        for (i, a) in self.screens.iter().enumerate() {
            for (j, b) in self.screens.iter().enumerate().skip(i + 1) {
                let pairs = edges(a).into_iter().flat_map(|edge| edges(b).map(|other| (edge, other)));
                let gaps = pairs.map(|(edge, other)| (edge, gap_m(edge, other)));
                seams.extend(
                    gaps.filter(|(edge, gap_m)| *gap_m <= LARGEST_GAP * (edge[1] - edge[0]).norm())
                        .map(|(ends, gap_m)| Seam { screens: [i, j], ends, gap_m }),
                );
            }
        }
        seams
    }
}

fn edges(screen: &Screen) -> [[Point3<f64>; 2]; 4] {
    let (ll, lr, ul, ur) = (screen.lower_left, screen.lower_right, screen.upper_left, screen.upper_right());
    [[ll, lr], [lr, ur], [ul, ur], [ll, ul]]
}

/// The larger distance between the ends of two edges, matched the nearer way round.
fn gap_m(a: [Point3<f64>; 2], b: [Point3<f64>; 2]) -> f64 {
    let straight = (a[0] - b[0]).norm().max((a[1] - b[1]).norm());
    let turned = (a[0] - b[1]).norm().max((a[1] - b[0]).norm());
    straight.min(turned)
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let eye = Point3::from(self.viewer.room_from_head.translation.vector);
        writeln!(f, "stage {}: {}", self.name, self.description)?;
        writeln!(
            f,
            "viewer at ({:.3}, {:.3}, {:.3}) m, eyes {:.1} mm apart, stereo {}",
            eye.x,
            eye.y,
            eye.z,
            self.viewer.ipd_m * 1000.0,
            self.stereo.name()
        )?;
        let centre = self.workspace.centre;
        let radius_m = self.workspace.radius_m;
        writeln!(
            f,
            "workspace about ({:.3}, {:.3}, {:.3}) m, radius {radius_m:.3} m",
            centre.x, centre.y, centre.z
        )?;
        writeln!(
            f,
            "{:<12} {:>15} {:>13} {:>15} {:>12} {:>11} {:>17}",
            "screen", "size (m)", "pixels", "pixel (mm)", "width/height", "viewer (m)", "field of view (°)"
        )?;
        for screen in &self.screens {
            let [pixel_width_m, pixel_height_m] = screen.pixel_size_m();
            let [across, upward] = screen.field_of_view(&eye).map(f64::to_degrees);
            writeln!(
                f,
                "{:<12} {:>15} {:>13} {:>15} {:>12.3} {:>11.3} {:>17}",
                screen.name,
                format!("{:.3} × {:.3}", screen.width_m(), screen.height_m()),
                format!("{} × {}", screen.pixels[0], screen.pixels[1]),
                format!("{:.3} × {:.3}", pixel_width_m * 1000.0, pixel_height_m * 1000.0),
                pixel_width_m / pixel_height_m,
                screen.distance_m(&eye),
                format!("{across:.1} × {upward:.1}"),
            )?;
        }
        for seam in self.seams() {
            let [a, b] = seam.screens.map(|i| self.screens[i].name.as_str());
            let length_m = (seam.ends[1] - seam.ends[0]).norm();
            writeln!(f, "seam {a} – {b}: {length_m:.3} m long, gap {:.2} mm", seam.gap_m * 1000.0)?;
        }
        for (name, tracker) in &self.tracking.trackers {
            writeln!(f, "tracker {name}: {}", tracker.kind)?;
        }
        for (name, sensor) in &self.tracking.sensors {
            let is_head = self.tracking.head.as_ref() == Some(name);
            let styli = self.tracking.styli.iter().filter(|(_, stylus)| stylus.sensor == *name);
            let used: Vec<String> = is_head
                .then(|| "the viewer's head".to_owned())
                .into_iter()
                .chain(styli.map(|(stylus, _)| format!("stylus {stylus}")))
                .collect();
            let used = if used.is_empty() { "not used".to_owned() } else { used.join(", ") };
            writeln!(f, "sensor {name}: number {} of {}: {used}", sensor.id, sensor.tracker)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_workbench_has_one_seam_and_the_cyberstage_five() {
        let seams = |name: &str| Stage::find(name).unwrap().seams();
        assert_eq!(seams("workbench").len(), 1);
        assert_eq!(seams("cyberstage").len(), 5);
        assert_eq!(seams("workbench-one-sided").len() + seams("desktop").len(), 0);
        assert!(seams("cyberstage").iter().all(|seam| seam.gap_m == 0.0));
    }

    #[test]
    fn a_gap_of_14_mm_is_told() {
        let mut stage = Stage::find("workbench").unwrap();
        let wall = &mut stage.screens[1];
        wall.lower_left.y += 0.014;
        wall.lower_right.y += 0.014;
        wall.upper_left.y += 0.014;
        assert!((stage.seams()[0].gap_m - 0.014).abs() < 1e-12);
        assert!(stage.to_string().contains("seam table – wall: 1.600 m long, gap 14.00 mm"), "{stage}");
    }

    #[test]
    fn the_text_tells_sizes_pixels_distances_and_angles() {
        let text = Stage::find("cyberstage").unwrap().to_string();
        for part in
            ["3.000 × 2.400", "1280 × 1024", "2.344 × 2.344", "1.900", "eyes 64.0 mm apart", "2.344 × 2.930"]
        {
            assert!(text.contains(part), "no `{part}` in\n{text}");
        }
    }
}
