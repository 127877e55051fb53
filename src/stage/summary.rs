//! A stage described as text: sizes, pixels, distances, fields of view, seams, trackers and sensors.

use super::description::Stage;
use super::lint::CLOSED_M;
use nalgebra::Point3;
use std::fmt;

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
            let [a, b] = seam.edges.map(|(screen, _)| self.screens[screen].name.as_str());
            let length_m = (seam.ends[1] - seam.ends[0]).norm();
            let what = if seam.is_overlap { "overlap" } else { "gap" };
            write!(f, "seam {a} – {b}: {length_m:.3} m long, {what} {:.2} mm", seam.widest_m() * 1000.0)?;
            match seam.along_m[0].abs().max(seam.along_m[1].abs()) {
                off_m if off_m > CLOSED_M => writeln!(f, ", ends {:.2} mm off along it", off_m * 1000.0)?,
                _ => writeln!(f)?,
            }
        }
        for (name, tracker) in &self.tracking.trackers {
            writeln!(f, "tracker {name}: {}", tracker.source)?;
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
    fn a_gap_of_14_mm_is_told() {
        let mut stage = Stage::find("workbench").unwrap();
        let wall = &mut stage.screens[1];
        wall.lower_left.y += 0.014;
        wall.lower_right.y += 0.014;
        wall.upper_left.y += 0.014;
        assert!(stage.to_string().contains("seam table – wall: 1.600 m long, gap 14.00 mm\n"), "{stage}");
        // Over the table's picture, and to the side.
        let wall = &mut stage.screens[1];
        for corner in [&mut wall.lower_left, &mut wall.lower_right, &mut wall.upper_left] {
            *corner += nalgebra::Vector3::new(0.006, -0.017, 0.004);
        }
        assert!(
            stage
                .to_string()
                .contains("seam table – wall: 1.594 m long, overlap 5.00 mm, ends 6.00 mm off along it\n"),
            "{stage}"
        );
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
