//! A picture of a pose for a report: the body seen so that it moves within the picture, over a ghost of itself at rest, with
//! axes, a scale bar, the force and what the colours mean; drawn in software.
//!
//! In: the results of one pose. Out: a PNG file. Beside the body stand only its axes and
//! a bar of a round length; words and the legend have bands of their own.

mod view;

use super::exporter::{Exporter, Spread};
use super::raster::{Raster, SAMPLES};
use super::result_set::{Geometry, Needs, PoseResult, ResultSet};
use super::{pose_text, shape};
use crate::base::extent::extent;
use crate::base::legend::{round_up, ticks};
use crate::base::output::Kind;
use crate::base::quantity::{power_of, prefix, quantity, short};
use crate::deform::{ControlPose, Wrench};
use crate::render::map_color;
use egui::ecolor::linear_f32_from_gamma_u8;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};
use image::RgbaImage;
use nalgebra::Vector3;
use view::View;

const SIZE: [usize; 2] = [1280, 960];
const PAPER: [u8; 3] = [250, 250, 248];
const GHOST: [u8; 3] = [170, 174, 180];
const BODY: [u8; 3] = [104, 140, 180];
const INK: Color32 = Color32::from_rgb(28, 32, 40);
const QUIET: Color32 = Color32::from_rgb(100, 106, 116);
const FORCE: Color32 = Color32::from_rgb(192, 48, 32);
/// The area of the body.
const STAGE: Rect = Rect { min: pos2(150.0, 100.0), max: pos2(1240.0, 640.0) };
/// The area of the words, below the body.
const BAND: Rect = Rect { min: pos2(40.0, 712.0), max: pos2(1240.0, 950.0) };
/// A body that moves by less than this part of its size is drawn as if it moved by the other.
const SMALL: [f64; 2] = [0.03, 0.08];

/// A picture of each pose.
pub const PICTURE: Exporter = Exporter {
    suffix: ".png",
    kind: Kind { name: "a PNG file", recognizes: |head| head.starts_with(b"\x89PNG\r\n\x1a\n") },
    spread: Spread::EachPose,
    needs: Needs::Nothing,
    write,
};

/// The body that moves most, of the bodies in a pose; without a pose the largest, at rest.
fn write(set: &ResultSet) -> Vec<u8> {
    let most = |result: &&PoseResult| result.displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
    let result = set.results.iter().max_by(|a, b| most(a).total_cmp(&most(b)));
    let geometry = |result: &PoseResult| set.geometry.iter().find(|geometry| geometry.body == result.body);
    let drawn = match result {
        Some(result) => geometry(result).and_then(|geometry| draw(geometry, result, &Words::new(result))),
        None => largest(set).and_then(|geometry| {
            let rest = PoseResult::at_rest(geometry);
            draw(geometry, &rest, &Words { lines: Vec::new(), ..Words::new(&rest) })
        }),
    };
    let picture = drawn.unwrap_or_else(|| RgbaImage::from_pixel(1, 1, image::Rgba([250, 250, 248, 255])));
    let mut bytes = std::io::Cursor::new(Vec::new());
    // Into memory, of a size that fits: nothing can fail.
    let written = picture.write_to(&mut bytes, image::ImageFormat::Png);
    written.map_or_else(|_| Vec::new(), |()| bytes.into_inner())
}

fn largest(set: &ResultSet) -> Option<&Geometry> {
    let size = |geometry: &&Geometry| view::size(&geometry.rest).unwrap_or(0.0);
    set.geometry.iter().max_by(|a, b| size(a).total_cmp(&size(b)))
}

/// Words on a picture.
struct Words {
    title: String,
    lines: Vec<String>,
    /// The forces on the control elements that were moved, and those at points.
    arrows: Vec<Arrow>,
    /// The places that are grey where colours show the stress.
    grey: &'static str,
}

impl Words {
    fn new(result: &PoseResult) -> Words {
        let told = &result.told;
        let forces = result.wrenches.as_ref().map_or(&[][..], |forces| &forces.controls);
        let [floor, _] = pose_text::floors(result);
        let arrow = |((pose, place), (name, wrench)): ((&ControlPose, &Vector3<f64>), &(String, Wrench))| {
            let is_moved = *pose != ControlPose::REST && wrench.force.norm() > floor;
            is_moved.then(|| Arrow {
                place: *place,
                shift: pose.translation,
                force: wrench.force,
                label: format!("{name}: {}", pose_text::force(wrench, &told.error)),
            })
        };
        let acting = told.pushed.iter().filter(|push| push.force.norm() > 0.0);
        let pushed = acting.map(|push| Arrow {
            place: push.rest,
            shift: push.moved,
            force: push.force,
            label: quantity(push.force.norm(), "N"),
        });
        let arrows =
            told.control.iter().zip(&told.places).zip(forces).filter_map(arrow).chain(pushed).collect();
        let grey = match told.pushed.is_empty() {
            true => "grey: held by a control element",
            false => "grey: control element, or point of a force",
        };
        let lines = pose_text::moves(result).into_iter().chain(pose_text::sentences(result, None)).collect();
        Words { title: result.pose.clone(), lines, arrows, grey }
    }
}

struct Arrow {
    /// Place of the element's origin at rest, and its shift, m, in the mesh's coordinates.
    place: Vector3<f64>,
    shift: Vector3<f64>,
    /// N.
    force: Vector3<f64>,
    label: String,
}

/// The picture of one body in one pose; `None` where it has no extent.
fn draw(geometry: &Geometry, result: &PoseResult, words: &Words) -> Option<RgbaImage> {
    let (nodes, triangles) = shape::boundary(geometry);
    let rest: Vec<Vector3<f64>> = nodes.iter().map(|&node| geometry.rest[node as usize]).collect();
    let moved: Vec<Vector3<f64>> = nodes.iter().map(|&node| result.displacement[node as usize]).collect();
    let most = moved.iter().map(Vector3::norm).fold(0.0, f64::max);
    let size = view::size(&rest)?;
    let larger = match most / size {
        part if part > 0.0 && part < SMALL[0] => round_up(SMALL[1] / part).max(1.0),
        _ => 1.0,
    };
    let shown: Vec<Vector3<f64>> = rest.iter().zip(&moved).map(|(x, u)| x + u * larger).collect();
    let view = View::new(&rest, &moved);
    let fit = Fit::around(&view, rest.iter().chain(&shown))?;
    let colours = Colours::new(result, &nodes);
    let mut raster = Raster::new(SIZE, PAPER);
    body(&mut raster, &fit, &triangles, &rest, &|_, _| GHOST.map(linear_f32_from_gamma_u8));
    raster.forget_depth();
    body(&mut raster, &fit, &triangles, &shown, &|node, weights| colours.at(node, weights));
    raster.paint(|painter| Page { painter, fit: &fit, words, larger }.paint(&colours));
    Some(raster.picture())
}

/// The colour of a triangle at the weights of its corners.
type Colour<'a> = dyn Fn(&[u32; 3], [f64; 3]) -> [f32; 3] + 'a;

/// Draws a surface with light from the eye; `colour` of a triangle at the weights of its corners.
fn body(
    raster: &mut Raster,
    fit: &Fit<'_>,
    triangles: &[[u32; 3]],
    places: &[Vector3<f64>],
    colour: &Colour<'_>,
) {
    for triangle in triangles {
        let [a, b, c] = triangle.map(|node| places[node as usize]);
        let normal = fit.view.turned(&(b - a).cross(&(c - a)));
        // From the eye and a little from above.
        let light = Vector3::new(-0.25, 0.45, 0.86);
        let facing = (normal.dot(&light) / normal.norm().max(f64::MIN_POSITIVE)).abs() as f32;
        let shade = 0.35 + 0.65 * facing;
        let corners = [a, b, c].map(|place| {
            let at = fit.pixel(&place);
            [f64::from(at.x) * SAMPLES as f64, f64::from(at.y) * SAMPLES as f64, fit.view.turned(&place).z]
        });
        raster.triangle(corners, true, &|weights| {
            let [r, g, b] = colour(triangle, weights);
            [r * shade, g * shade, b * shade, 1.0]
        });
    }
}

/// The view, and how large it is drawn where.
struct Fit<'a> {
    view: &'a View,
    middle: Vector3<f64>,
    /// Pixels for each metre.
    scale: f64,
    /// Area of body and ghost in the picture.
    drawn: Rect,
}

impl<'a> Fit<'a> {
    fn around<'b>(view: &'a View, places: impl Iterator<Item = &'b Vector3<f64>>) -> Option<Fit<'a>> {
        let (low, high) = extent(places.map(|place| view.turned(place)))?;
        let extent = high - low;
        let scale = (f64::from(STAGE.width()) / extent.x).min(f64::from(STAGE.height()) / extent.y) * 0.86;
        let half = extent * (0.5 * scale);
        let drawn = Rect::from_center_size(STAGE.center(), 2.0 * vec2(half.x as f32, half.y as f32));
        scale.is_normal().then(|| Fit { view, middle: (low + high) * 0.5, scale, drawn })
    }

    fn pixel(&self, place: &Vector3<f64>) -> Pos2 {
        let at = (self.view.turned(place) - self.middle) * self.scale;
        STAGE.center() + vec2(at.x as f32, -at.y as f32)
    }
}

/// Colours of the body.
struct Colours {
    /// Stress of each node of the surface, where it has any, Pa.
    values: Vec<Option<f64>>,
    /// Stress at the end of the colours, Pa.
    to: f64,
    most: f64,
    limit: Option<f64>,
}

impl Colours {
    fn new(result: &PoseResult, nodes: &[u32]) -> Colours {
        let stress = result.stress.as_ref();
        let at = |&node: &u32| Some(stress?.nodes.get(node as usize)?.as_ref()?.von_mises);
        let values: Vec<Option<f64>> = nodes.iter().map(at).collect();
        let mut all: Vec<f64> = values.iter().flatten().copied().collect();
        all.sort_by(f64::total_cmp);
        // A sharp corner alone does not set the scale.
        let most = all.last().copied().unwrap_or(0.0);
        let to = round_up(all.get(all.len() * 199 / 200).copied().unwrap_or(0.0).max(1e-300));
        let limit = stress.and_then(|stress| stress.reached.limit).map(|(_, limit)| limit);
        let limit = limit.and_then(|limit| match limit {
            crate::scene::Limit::Stress(value) => Some(value),
            crate::scene::Limit::Strain(_) => None,
        });
        Colours { values, to, most, limit }
    }

    fn is_any(&self) -> bool {
        self.values.iter().any(Option::is_some)
    }

    /// Linear light; grey where a control element holds the body.
    fn at(&self, triangle: &[u32; 3], weights: [f64; 3]) -> [f32; 3] {
        if !self.is_any() {
            return BODY.map(linear_f32_from_gamma_u8);
        }
        let value = |i: usize| self.values[triangle[i] as usize];
        match [value(0), value(1), value(2)] {
            [Some(a), Some(b), Some(c)] => {
                let part = (a * weights[0] + b * weights[1] + c * weights[2]) / self.to;
                map_color(part as f32).map(linear_f32_from_gamma_u8)
            }
            _ => [120, 122, 126].map(linear_f32_from_gamma_u8),
        }
    }
}

struct Page<'a> {
    painter: &'a Painter,
    fit: &'a Fit<'a>,
    words: &'a Words,
    larger: f64,
}

impl Page<'_> {
    fn paint(&self, colours: &Colours) {
        self.text(pos2(40.0, 24.0), Align2::LEFT_TOP, &self.words.title, 30.0, INK);
        let drawn = match self.larger {
            1.0 => "drawn to scale; grey: at rest".to_owned(),
            times => format!("movement drawn {times:.0} times as large; grey: at rest"),
        };
        self.text(pos2(40.0, 64.0), Align2::LEFT_TOP, &drawn, 18.0, QUIET);
        self.axes();
        self.scale_bar();
        for arrow in &self.words.arrows {
            self.arrow(arrow);
        }
        let width = if colours.is_any() { 760.0 } else { BAND.width() };
        let mut y = BAND.min.y;
        for line in &self.words.lines {
            let galley = self.painter.layout(line.clone(), FontId::proportional(18.0), INK, width);
            let height = galley.size().y;
            if y + height > BAND.max.y {
                break;
            }
            self.painter.galley(pos2(BAND.min.x, y), galley, INK);
            y += height + 5.0;
        }
        if colours.is_any() {
            self.legend(colours);
        }
    }

    fn text(&self, place: Pos2, anchor: Align2, text: &str, size: f32, ink: Color32) -> Rect {
        self.painter.text(place, anchor, text, FontId::proportional(size), ink)
    }

    /// The body's axes, in a corner of their own.
    fn axes(&self) {
        let origin = pos2(84.0, 630.0);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let along = self.fit.view.turned(&Vector3::ith(axis, 1.0)) * 48.0;
            let way = vec2(along.x as f32, -along.y as f32);
            if way.length() > 6.0 {
                self.painter.arrow(origin, way, Stroke::new(2.0, INK));
            }
            let label = origin + way + way.normalized() * 14.0;
            let ink = if way.length() > 14.0 { INK } else { QUIET };
            let label = if way.length() > 14.0 { label } else { origin + vec2(-16.0, 14.0) };
            self.text(label, Align2::CENTER_CENTER, name, 18.0, ink);
        }
    }

    /// A bar of a round length, between the body and the words.
    fn scale_bar(&self) {
        let length = round_down(180.0 / self.fit.scale);
        let wide = (length * self.fit.scale) as f32;
        let (left, y) = (STAGE.max.x - wide, 672.0);
        let stroke = Stroke::new(2.5, INK);
        self.painter.line_segment([pos2(left, y), pos2(left + wide, y)], stroke);
        for x in [left, left + wide] {
            self.painter.line_segment([pos2(x, y - 5.0), pos2(x, y + 5.0)], stroke);
        }
        let power = power_of(length);
        let text = format!("{} {}m", short(length / 1000f64.powi(power)), prefix(power));
        self.text(pos2(left + 0.5 * wide, y + 4.0), Align2::CENTER_TOP, &text, 18.0, INK);
    }

    fn arrow(&self, arrow: &Arrow) {
        let foot = self.fit.pixel(&(arrow.place + arrow.shift * self.larger));
        let along = self.fit.view.turned(&arrow.force);
        let way = vec2(along.x as f32, -along.y as f32);
        // A force towards the eye has a short arrow.
        let seen = (way.length() as f64 / along.norm().max(f64::MIN_POSITIVE)) as f32;
        let way = way.normalized() * (24.0 + 76.0 * seen);
        self.painter.arrow(foot, way, Stroke::new(4.0, FORCE));
        let end = foot + way;
        let galley = self.painter.layout_no_wrap(arrow.label.clone(), FontId::proportional(20.0), FORCE);
        // Beside the arrow's end, or where that is on the body, above it.
        let is_right = end.x > STAGE.center().x;
        let anchor = if is_right { Align2::RIGHT_CENTER } else { Align2::LEFT_CENTER };
        let aside = vec2(if is_right { -14.0 } else { 14.0 }, if way.y < 0.0 { -10.0 } else { 10.0 });
        let mut rect = anchor.anchor_size(end + aside, galley.size());
        if rect.intersects(self.fit.drawn) {
            let x = rect.center().x.clamp(STAGE.min.x + 0.5 * rect.width(), STAGE.max.x - 0.5 * rect.width());
            let y = self.fit.drawn.min.y.min(end.y) - 24.0;
            rect = Rect::from_center_size(pos2(x, y), rect.size());
            self.painter
                .line_segment([rect.center_bottom(), end], Stroke::new(1.0, FORCE.gamma_multiply(0.5)));
        }
        let [r, g, b] = PAPER;
        self.painter.rect_filled(rect.expand(4.0), 3.0, Color32::from_rgba_unmultiplied(r, g, b, 220));
        self.painter.galley(rect.min, galley, FORCE);
    }

    fn legend(&self, colours: &Colours) {
        let bar = Rect::from_min_size(pos2(BAND.max.x - 380.0, BAND.min.y + 34.0), vec2(370.0, 20.0));
        let steps = 74;
        for k in 0..steps {
            let wide = bar.width() / steps as f32;
            let rect =
                Rect::from_min_size(bar.min + vec2(k as f32 * wide, 0.0), vec2(wide + 0.5, bar.height()));
            let [r, g, b] = map_color((k as f32 + 0.5) / steps as f32);
            self.painter.rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
        }
        let power = power_of(colours.to);
        let title = format!("von Mises stress, {}Pa", prefix(power));
        self.text(bar.min - vec2(0.0, 8.0), Align2::LEFT_BOTTOM, &title, 18.0, INK);
        let place = |value: f64| bar.min.x + bar.width() * (value / colours.to) as f32;
        for tick in ticks(colours.to) {
            let text = short(tick / 1000f64.powi(power));
            self.text(pos2(place(tick), bar.max.y + 3.0), Align2::CENTER_TOP, &text, 16.0, INK);
        }
        let mut lines = vec![format!("at most {}", quantity(colours.most, "Pa"))];
        if let Some(limit) = colours.limit {
            lines.push(format!("limit {}", quantity(limit, "Pa")));
            if limit <= colours.to {
                let x = place(limit);
                let ends = [pos2(x, bar.min.y - 6.0), pos2(x, bar.max.y + 6.0)];
                self.painter.line_segment(ends, Stroke::new(3.0, FORCE));
            }
        }
        let ink = if colours.limit.is_some_and(|limit| colours.most > limit) { FORCE } else { INK };
        let text = lines.join(", ");
        self.text(pos2(bar.min.x, bar.max.y + 28.0), Align2::LEFT_TOP, &text, 17.0, ink);
        self.text(pos2(bar.min.x, bar.max.y + 52.0), Align2::LEFT_TOP, self.words.grey, 16.0, QUIET);
    }
}

/// The largest of 1, 2 and 5 times a power of ten that is no more.
fn round_down(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|step| step * power).find(|round| *round <= value).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of 2 × 1 × 1 m without a pose: its picture has the size of all, and a middle that is not paper.
    #[test]
    fn a_body_at_rest_is_drawn_where_there_is_no_pose() {
        let corner = |k: u32| Vector3::new(f64::from(2 * (k & 1)), f64::from(k >> 1 & 1), f64::from(k >> 2));
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let cells = sides.iter().flat_map(|[a, b, c, d]| [vec![*a, *b, *c], vec![*a, *c, *d]]).collect();
        let rest: Vec<Vector3<f64>> = (0..8).map(corner).collect();
        let geometry = Geometry { body: "block".into(), tags: (1..9).collect(), rest, cells };
        let set = ResultSet { geometry: vec![geometry], ..ResultSet::default() };
        let picture = image::load_from_memory(&write(&set)).unwrap().to_rgb8();
        assert_eq!([picture.width(), picture.height()].map(|side| side as usize), SIZE);
        let middle = picture.get_pixel(STAGE.center().x as u32, STAGE.center().y as u32);
        assert!(middle.0.iter().zip(PAPER).any(|(ink, paper)| ink.abs_diff(paper) > 40), "{middle:?}");
    }
}
