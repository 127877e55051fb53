//! The models: errors by the largest local rotation of the poses, and by how far one control element turns alone; and what a
//! smaller error of the force costs in time.

use super::common::{PlotEntry, distinct, listed};
use crate::measure::units::{Unit, digits, relative, seconds};
use crate::measure::{ModelError, ModelTrial, Report, TrialMotion};
use crate::report::canvas::Picture;
use crate::report::plot::{Plot, Point, Scale};
use crate::report::tables;

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
        ..Plot::default()
    };
    plot.picture()
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

pub const DISPLACEMENT: PlotEntry = PlotEntry {
    name: "trial-displacement",
    heading: "Models from 1° to 360°",
    reading: "Filled marks: one control element is bent away. Hollow marks: it is twisted. A line ends where the body has no \
              equilibrium, or the model no forces. Below the dotted line the model is wrong by less than 1 %.",
    caption: |report| SHAPE.caption(report),
    picture: |report| SHAPE.picture(report),
    table: None,
};
pub const FORCE: PlotEntry = PlotEntry {
    name: "trial-force",
    heading: "",
    reading: "The same for the force on a control element, as a part of the equilibrium's largest force or torque.",
    caption: |report| FORCES.caption(report),
    picture: |report| FORCES.picture(report),
    table: None,
};
pub const TORQUE: PlotEntry = PlotEntry {
    name: "trial-torque",
    heading: "",
    reading: "The same for the torque.",
    caption: |report| TORQUES.caption(report),
    picture: |report| TORQUES.picture(report),
    table: None,
};
pub const TRADE: PlotEntry = PlotEntry {
    name: "trial-time",
    heading: "",
    reading: "What a better force costs: the larger error of force and torque in bends, against the time from poses to the \
              deformed surface with its forces. A line joins the angles of one model.",
    caption: trade_caption,
    picture: trade,
    table: Some((
        "Error of displacement · larger error of force and torque · energy over that of the equilibrium; the least error of \
         each motion is bold.",
        tables::trials,
    )),
};

struct Quantity {
    title: &'static str,
    label: &'static str,
    of: fn(&ModelTrial) -> Option<f64>,
}

const SHAPE: Quantity = Quantity {
    title: "Displacement: how wrong each model is by the angle",
    label: "error of the surface, part of the length (RMS)",
    of: |row| Some(row.displacement),
};
const FORCES: Quantity = Quantity {
    title: "Force: how wrong each model is by the angle",
    label: "error of force, part of the largest wrench",
    of: |row| row.force,
};
const TORQUES: Quantity = Quantity {
    title: "Torque: how wrong each model is by the angle",
    label: "error of torque, part of the largest wrench",
    of: |row| row.torque,
};

fn models(report: &Report) -> Vec<String> {
    distinct(report.trials.rows.iter().map(|row| row.model.clone()))
}

/// The rows of one model and motion, by the angle.
fn line<'a>(report: &'a Report, model: &str, motion: TrialMotion) -> Vec<&'a ModelTrial> {
    let is_own = |row: &&ModelTrial| row.model == model && row.motion == motion;
    let mut rows: Vec<&ModelTrial> = report.trials.rows.iter().filter(is_own).collect();
    rows.sort_by(|a, b| a.degrees.total_cmp(&b.degrees));
    rows
}

impl Quantity {
    fn picture(&self, report: &Report) -> Result<Picture, String> {
        let models = models(report);
        let mut points = Vec::new();
        for (series, model) in models.iter().enumerate() {
            for (m, motion) in TrialMotion::ALL.into_iter().enumerate() {
                let number = TrialMotion::ALL.len() * series + m;
                let strong = motion == TrialMotion::Bend;
                points.extend(line(report, model, motion).into_iter().filter_map(|row| {
                    let (x, y) = (row.degrees, (self.of)(row)?);
                    let tip = format!("{model}, {} by {}°: {}", motion.name(), digits(x, 4), relative(y));
                    Some(Point { x, y, series, line: Some(number), strong, tip, ..Point::default() })
                }));
            }
        }
        let plot = Plot {
            title: self.title,
            note: "Against static equilibrium on the same mesh. Filled: bend; hollow: twist.".into(),
            x: Scale { label: "angle of the control element".into(), unit: Unit::Degrees, logarithmic: true },
            y: Scale::ratio(self.label),
            series: models,
            points,
            ..Plot::default()
        };
        plot.picture()
    }

    /// The bend up to which each model stays within a bearable error.
    fn caption(&self, report: &Report) -> String {
        let bearable = 0.05;
        let sentence = |model: String| {
            let rows = line(report, &model, TrialMotion::Bend);
            let good = rows.iter().take_while(|row| (self.of)(row).is_some_and(|error| error <= bearable));
            match good.last() {
                Some(row) => format!("{model} up to {}°", digits(row.degrees, 4)),
                None => format!("{model} at no angle that was tried"),
            }
        };
        let sentences: Vec<String> = models(report).into_iter().map(sentence).collect();
        if sentences.is_empty() {
            return String::new();
        }
        format!("An error of at most {} in bends: {}.", relative(bearable), listed(&sentences))
    }
}

fn trade(report: &Report) -> Result<Picture, String> {
    let models = models(report);
    let mut points = Vec::new();
    for (series, model) in models.iter().enumerate() {
        points.extend(line(report, model, TrialMotion::Bend).into_iter().filter_map(|row| {
            let (x, y) = (row.frame_s, row.held()?);
            let angle = format!("{}°", digits(row.degrees, 4));
            let tip = format!("{model}, bend by {angle}: {} in {}", relative(y), seconds(x));
            let label = Some(angle).filter(|_| LABELLED.contains(&row.degrees));
            Some(Point { x, y, series, line: Some(series), strong: true, label, tip, ..Point::default() })
        }));
    }
    let plot = Plot {
        title: "What a better force costs in time",
        note: "Bends; the labels are their angles.".into(),
        x: Scale {
            label: "time of one frame with forces (median)".into(),
            unit: Unit::Seconds,
            logarithmic: true,
        },
        y: Scale::ratio("error of force and torque"),
        series: models,
        points,
        ..Plot::default()
    };
    plot.picture()
}

/// Angles that stand beside their points.
const LABELLED: [f64; 2] = [30.0, 90.0];

/// The models that reach a bearable force at the largest of [`LABELLED`] that was measured, the fastest first.
fn trade_caption(report: &Report) -> String {
    let bends = || report.trials.rows.iter().filter(|row| row.motion == TrialMotion::Bend);
    let Some(angle) = LABELLED.into_iter().rev().find(|angle| bends().any(|row| row.degrees == *angle))
    else {
        return String::new();
    };
    let here = bends().filter(|row| row.degrees == angle);
    let mut good: Vec<(&ModelTrial, f64)> =
        here.filter_map(|row| Some((row, row.held().filter(|error| *error <= 0.05)?))).collect();
    good.sort_by(|a, b| a.0.frame_s.total_cmp(&b.0.frame_s));
    if good.is_empty() {
        return format!("At {angle}° no model has force and torque within 5 %.");
    }
    let told = good
        .iter()
        .map(|(row, error)| format!("{} ({}, {})", row.model, seconds(row.frame_s), relative(*error)));
    format!(
        "Force and torque within 5 % at {angle}°, the fastest first: {}.",
        listed(&told.collect::<Vec<_>>())
    )
}
