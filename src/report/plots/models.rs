//! The error of the models by the largest local rotation: a mark a pose, a line a model.

use super::common::{distinct, listed};
use super::entry::PlotEntry;
use crate::report::data::{ModelError, Report};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::units::{Unit, digits, relative};

pub const MODELS: PlotEntry = PlotEntry {
    name: "models",
    heading: "Models at large rotations",
    reading: "Each mark is a pose. Above the dotted line the model is wrong by more than 1 %. Thin lines only join the marks: \
              between two poses nothing was measured.",
    caption,
    picture,
    table: None,
};

/// The models in the order of the report, each with its poses by their rotation.
fn by_rotation(report: &Report) -> Vec<(&String, Vec<&ModelError>)> {
    let models = distinct(report.models.iter().map(|of| &of.model)).into_iter();
    let poses = |model: &String| {
        let mut poses: Vec<&ModelError> = report.models.iter().filter(|of| of.model == *model).collect();
        poses.sort_by(|a, b| a.rotation.total_cmp(&b.rotation));
        poses
    };
    models.map(|model| (model, poses(model))).collect()
}

fn picture(report: &Report) -> Result<Picture, String> {
    let models = by_rotation(report);
    let point = |(series, of): (usize, &ModelError)| {
        let (x, error) = (of.rotation.to_degrees(), relative(of.error));
        let tip = format!("{}, pose {}: {error} at {x:.1}°", of.model, of.pose);
        Point { x, y: of.error, series, line: Some(series), strong: true, tip, ..Point::default() }
    };
    let marks = models.iter().enumerate().flat_map(|(i, (_, poses))| poses.iter().map(move |of| (i, *of)));
    let plot = Plot {
        title: "How wrong the models are by how far the body turns",
        note: "Against the converged nonlinear solution on the same mesh: the model's error alone.".into(),
        x: Scale {
            label: "largest local rotation of the pose".into(),
            unit: Unit::Degrees,
            logarithmic: false,
        },
        y: Scale::ratio("model error, relative L2"),
        series: models.iter().map(|(model, _)| (*model).clone()).collect(),
        points: marks.map(point).collect(),
        front: Vec::new(),
        triangles: Vec::new(),
    };
    plot.told()
}

fn caption(report: &Report) -> String {
    let bearable = 0.05;
    let sentence = |(model, of): (&String, Vec<&ModelError>)| {
        let good = of.iter().take_while(|row| row.error <= bearable).count();
        let degrees = |i: usize| format!("{}°", digits(of[i].rotation.to_degrees(), 2));
        match good {
            0 => format!("{model} in none (not at {})", degrees(0)),
            n if n == of.len() => format!("{model} in all of them (up to {})", degrees(n - 1)),
            n => format!("{model} up to {} (not at {})", degrees(n - 1), degrees(n)),
        }
    };
    let sentences: Vec<String> = by_rotation(report).into_iter().map(sentence).collect();
    format!("An error of at most {} in these poses: {}.", relative(bearable), listed(&sentences))
}
