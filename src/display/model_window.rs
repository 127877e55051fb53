//! Shows the stage as a model in a separate window, or in a picture; dragging turns it, the wheel zooms.

use super::bodies::{GpuBodies, contents};
use super::device;
use super::stage_model::{Camera, Orbit, StageModel, write_names};
use super::view_source::ViewSource;
use super::window_layout::WindowFrame;
use crate::base::failure::Failure;
use crate::render::window::{AppError, Input, WindowSpec};
use crate::render::{COLOR_FORMAT, EyePicture, Gpu, Offscreen, Overlay, Renderer, Samples, Viewport};
use crate::session::Session;
use crate::stage::Stage;
use crate::track::doubts::doubts;
use image::RgbaImage;

/// A window that looks at the stage from outside.
pub struct ModelWindow {
    orbit: Orbit,
    size: [u32; 2],
    overlay: Option<Overlay>,
}

impl ModelWindow {
    pub fn new(camera: Camera, size: [u32; 2]) -> ModelWindow {
        ModelWindow { orbit: Orbit::new(camera), size, overlay: None }
    }

    pub(super) fn spec(&self, stage: &Stage) -> WindowSpec {
        WindowSpec {
            title: format!("greenstage – {} – room", stage.name),
            monitor: None,
            position: None,
            size: self.size,
            fills: false,
            decorated: true,
            fullscreen: false,
            unmanaged: false,
        }
    }

    pub(super) fn input(&mut self, input: &Input) {
        self.orbit.handle(input);
    }

    pub(super) fn draw(&mut self, frame: &mut WindowFrame<'_>) -> Result<(), AppError> {
        let WindowFrame { presenter, session, bodies, .. } = frame;
        bodies.upload(presenter.gpu(), &session.world)?;
        let model = model(session, &self.orbit.camera);
        let instances = bodies.instances(&session.world);
        let contents = model.contents(contents(&session.world, &instances));
        let sizes = presenter.sizes();
        let size = sizes.first().copied().unwrap_or([0, 0]);
        let view = self.orbit.camera.view(f64::from(size[0]) / f64::from(size[1].max(1)));
        let tiles = self.orbit.camera.tiles(&session.world, &sizes);
        let overlay = &mut self.overlay;
        let mut paint = |gpu: &Gpu, picture: &EyePicture<'_>| {
            let overlay = overlay.get_or_insert_with(|| Overlay::new(picture.format));
            overlay.paint(gpu, picture.texture, picture.texture_size, |painter| {
                view.iter().for_each(|view| write_names(painter, painter.clip_rect(), view, &model, &[]));
            })
        };
        presenter.present(&tiles, &vec![&contents; tiles.len()], Some(&mut paint))?;
        Ok(())
    }
}

/// The stage of a session with its viewer's head, and all sensors that its trackers speak of.
fn model(session: &mut Session, camera: &Camera) -> StageModel {
    let reports = session.input.tracker_reports();
    let world = &session.world;
    let mut model = StageModel::new(&world.assets.stage, &world.room_from_head, &camera.eye());
    model.add_measures(&world.assets.stage);
    model.add_sensors(&reports);
    model.add_notes(doubts(&world.assets.stage, &reports).into_iter().map(|doubt| doubt.text));
    model
}

/// The stage of a session from outside as a picture.
pub fn picture(
    session: &mut Session,
    camera: &Camera,
    size: [u32; 2],
    samples: Samples,
    device: device::Args,
) -> Result<RgbaImage, Failure> {
    let gpu = Gpu::headless().map_err(Failure::work)?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, samples.on(&gpu))?;
    device.apply(&gpu, &mut renderer)?;
    let target = Offscreen::new(&gpu, &renderer, size)?;
    let view = camera.view(f64::from(size[0]) / f64::from(size[1]));
    let model = model(session, camera);
    let mut bodies = GpuBodies::new(&gpu, &mut session.world, device)?;
    bodies.upload(&gpu, &session.world)?;
    let instances = bodies.instances(&session.world);
    let contents = model.contents(contents(&session.world, &instances));
    renderer.draw(&gpu, &[target.picture(&Viewport::full(size, view))], &contents)?;
    Overlay::new(COLOR_FORMAT).paint(&gpu, &target.image.view, size, |painter| {
        view.iter().for_each(|view| write_names(painter, painter.clip_rect(), view, &model, &[]));
    })?;
    Ok(target.read(&gpu)?.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Drawable, StylusShape};
    use crate::stage::BUILT_IN;
    use crate::track::FakeSource;
    use crate::track::device::now_s;
    use crate::track::tracker_set::TrackerSet;
    use crate::world::World;
    use nalgebra::{Isometry3, Point3};
    use std::path::Path;

    const TRACKING: &str = "
[tracker.lab]
dtrack = \"0\"
room_from_tracker = { position = [0.0, 1.0, 0.0] }
[sensor.head]
tracker = \"lab\"
id = 0
[sensor.wand]
tracker = \"lab\"
id = 1
[stylus.right]
sensor = \"wand\"
";

    /// Names, measures and heights lay over each other where edges meet.
    #[test]
    fn no_words_lie_over_others_or_beyond_the_picture() {
        for (name, size) in BUILT_IN.iter().flat_map(|(name, _)| [(*name, [1280, 960]), (*name, [960, 600])])
        {
            let stage = Stage::find(name).unwrap();
            let camera = Camera::facing(&stage);
            let mut room = StageModel::new(&stage, &stage.viewer.room_from_head, &camera.eye());
            room.add_measures(&stage);
            room.note.clear();
            let [width, height] = size.map(|side| side as f32);
            let picture = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height));
            let view = camera.view(f64::from(width / height)).unwrap();
            let input = egui::RawInput { screen_rect: Some(picture), ..Default::default() };
            let output = egui::Context::default().run_pass(input, |context| {
                let painter = context.layer_painter(egui::LayerId::background());
                write_names(&painter, picture, &view, &room, &[]);
            });
            let words = output.shapes.iter().filter(|clipped| matches!(clipped.shape, egui::Shape::Text(_)));
            let words: Vec<_> = words.map(|clipped| clipped.shape.visual_bounding_rect()).collect();
            assert!(words.len() >= stage.screens.len(), "{name}");
            for (k, rect) in words.iter().enumerate() {
                assert!(picture.contains_rect(*rect), "{name}, {size:?}: {rect}");
                let over = words[..k].iter().find(|other| other.shrink(0.5).intersects(rect.shrink(0.5)));
                assert_eq!(over, None, "{name}, {size:?}: over {rect}");
            }
        }
    }

    #[test]
    fn an_installer_sees_head_stylus_and_every_sensor_where_the_calibration_puts_them() {
        let text = BUILT_IN[0].1.replacen("[viewer]", "[viewer]\nhead = \"head\"", 1) + TRACKING;
        let stage = Stage::parse(&text, Path::new("lab.toml")).unwrap();
        let source = FakeSource::default();
        let trackers = TrackerSet::with_sources(&stage.tracking, vec![Box::new(source.clone())], now_s());
        let viewer = stage.viewer.room_from_head;
        let mut session = Session::new(World::of_stage(stage).unwrap(), None);
        session.input.trackers = Some(trackers);
        let drawn = |session: &mut Session| {
            session.advance(0.0).unwrap();
            let camera = Camera::facing(&session.world.assets.stage);
            let model = model(session, &camera);
            let said = |model: &StageModel, of: &str| {
                model.labels.iter().find(|label| label.text.starts_with(of)).map(|label| label.place)
            };
            let styli: Vec<StylusShape> = session.world.frame.all(Drawable::stylus).copied().collect();
            (styli, said(&model, "head"), said(&model, "wand"), said(&model, "7 of lab"), model)
        };
        let (styli, head, wand, seventh, model) = drawn(&mut session);
        assert!(styli.is_empty() && [head, wand, seventh] == [None; 3], "nobody has spoken");
        let eyes =
            model.drawables.iter().filter_map(Drawable::ball).filter(|ball| ball.radius_m == 0.016).count();
        assert_eq!(eyes, 2);
        for (sensor, place) in [(0, [0.2, 0.6, 1.2]), (1, [0.3, 0.2, 0.5]), (7, [1.0, 0.0, 0.0])] {
            let [x, y, z] = place;
            source.change(|device| device.take_pose(sensor, Isometry3::translation(x, y, z), None, 1.0));
        }
        let (styli, head, wand, seventh, _) = drawn(&mut session);
        let off = |found: Option<Point3<f64>>, x: f64, y: f64, z: f64| {
            (found.unwrap() - Point3::new(x, y, z)).norm()
        };
        assert!(off(head, 0.2, 1.6, 1.2) < 1e-6 && off(wand, 0.3, 1.2, 0.5) < 1e-6);
        assert!(off(seventh, 1.0, 1.0, 0.0) < 1e-6, "one that the stage does not name");
        let tip = styli[0].room_from_stylus.fixed_view::<3, 1>(0, 3).into_owned();
        assert!((tip - nalgebra::Vector3::new(0.3, 1.2, 0.5)).norm() < 1e-6, "{tip}");
        let moved = session.world.room_from_head.translation.vector - viewer.translation.vector;
        assert!(moved.norm() > 0.1, "the head is where its sensor is");
    }
}
