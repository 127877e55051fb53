//! A stage described as text: sizes, pixels, distances, fields of view, tilts, seams, windows, trackers, sensors and
//! loudspeakers.

use super::description::Stage;
use super::lint::CLOSED_M;
use super::loudspeaker::{Bearing, Sound};
use super::tracking::{ButtonId, TrackerFrame};
use super::window::{Monitor, Tile, Window};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::fmt;

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let eye = Point3::from(self.viewer.room_from_head.translation.vector);
        match self.description.as_str() {
            "" => writeln!(f, "stage {}", self.name)?,
            described => writeln!(f, "stage {}: {described}", self.name)?,
        }
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
        for screen in &self.screens {
            writeln!(f, "screen {}: {}", screen.name, screen.measures())?;
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
        for apart in self.apart() {
            writeln!(f, "no seam: {} are {:.0} mm apart", apart.told(self), apart.distance_m * 1000.0)?;
        }
        if self.swap_eyes {
            writeln!(f, "swap_eyes: each eye is shown what the other should see")?;
        }
        self.windows.iter().try_for_each(|window| self.write_window(f, window))?;
        for Monitor { name, at: [x, y], size: [width, height] } in &self.monitors {
            writeln!(f, "monitor {name}: {width} × {height} at ({x}, {y})")?;
        }
        self.write_tracking(f)?;
        self.write_sound(f)
    }
}

impl Stage {
    fn write_window(&self, f: &mut fmt::Formatter<'_>, window: &Window) -> fmt::Result {
        let [width, height] = window.size;
        let at = window.at.map_or(String::new(), |[x, y]| format!(" at ({x}, {y})"));
        let on = window.monitor.as_ref().map_or(String::new(), |monitor| format!(" on monitor {monitor}"));
        let tile = |tile: &Tile| {
            let swapped = if tile.swap_eyes { ", eyes swapped" } else { "" };
            let (screen, [x, y, width, height]) = (&self.screens[tile.screen].name, tile.rect);
            let part = if window.tiles.len() > 1 {
                format!(" in {width} × {height} at ({x}, {y})")
            } else {
                String::new()
            };
            format!("{screen}{part}, {}{swapped}", tile.stereo.name())
        };
        let tiles: Vec<String> = window.tiles.iter().map(tile).collect();
        let size = if window.fills { "fills it".to_owned() } else { format!("{width} × {height}") };
        writeln!(f, "window {}: {size}{at}{on}: {}", window.name, tiles.join("; "))
    }

    /// Nothing for a stage that says nothing about sound.
    fn write_sound(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.sound == Sound::default() {
            return Ok(());
        }
        let device = self.sound.device.as_ref().map_or(String::new(), |name| format!(", device {name}"));
        let output = self.sound.output.name();
        writeln!(f, "sound: {output}, {:.0} dB at digital full scale{device}", self.sound.loudest_db)?;
        let head = &self.viewer.room_from_head;
        for (k, one) in self.sound.used(head).iter().enumerate() {
            let (place, bearing) = (numbers(&one.position.coords, 3), Bearing::new(head, &one.position));
            writeln!(f, "loudspeaker {} {}: at {place} m, {bearing}", k + 1, one.name)?;
        }
        Ok(())
    }

    fn write_tracking(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, tracker) in &self.tracking.trackers {
            let TrackerFrame { mirror, room_from_tracker } = tracker.frame;
            let Isometry3 { translation, rotation } = room_from_tracker.isometry;
            let mirrored = mirror.map_or(String::new(), |axis| format!(", {axis:?} mirrored").to_lowercase());
            writeln!(
                f,
                "tracker {name}: {}; its unit is {} m{mirrored}, its origin at {} m, its {}",
                tracker.source,
                room_from_tracker.scaling(),
                numbers(&translation.vector, 3),
                axes(&rotation, "axes point")
            )?;
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
            let body_from_sensor = sensor.sensor_from_body.inverse();
            writeln!(
                f,
                "sensor {name}: number {} of {}: {used}; mounted at {} m on it, its {}",
                sensor.id,
                sensor.tracker,
                numbers(&body_from_sensor.translation.vector, 3),
                axes(&body_from_sensor.rotation, "axes there")
            )?;
        }
        for (name, stylus) in &self.tracking.styli {
            let button = |what: &str, id: &Option<ButtonId>| match id {
                Some(ButtonId { tracker, button }) => format!("{what} by button {button} of {tracker}"),
                None => format!("no {what}"),
            };
            let (grab, second) = (button("grab", &stylus.grab), button("second button", &stylus.second));
            writeln!(f, "stylus {name}: sensor {}, {grab}, {second}", stylus.sensor)?;
        }
        Ok(())
    }
}

/// `(0.890, 0.000, -0.100)`.
fn numbers(vector: &Vector3<f64>, digits: usize) -> String {
    let half = 0.5 * 10f64.powi(-(digits as i32));
    // No -0.000.
    let text = vector.iter().map(|x| format!("{:.digits$}", if x.abs() < half { 0.0 } else { *x }));
    format!("({})", text.collect::<Vec<_>>().join(", "))
}

/// Words for the directions of a frame's axes, as a file has them: `axes point x (1.00, 0.00, 0.00), y …`.
fn axes(rotation: &UnitQuaternion<f64>, what: &str) -> String {
    let axes = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())];
    let told = axes.map(|(name, axis)| format!("{name} {}", numbers(&(rotation * axis), 2)));
    format!("{what} {}", told.join(", "))
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
