//! The error in millimetres on the body: the most accurate setting, the scene's own and the cheapest side by side, in one
//! pose and with one scale of colours.

use super::cost_metric::costs;
use super::data::{Report, Shapes};
use super::drawing::markup::escape;
use super::drawing::relief::{COLOURS, Frame, Relief, View, base64};
use super::headline::{Shown, shown};
use super::units::metres;
use nalgebra::Vector3;

/// The figure as HTML; empty where there are no shapes.
pub fn figure(report: &Report) -> String {
    let Some(shapes) = &report.shapes else { return String::new() };
    let view = View::of(&shapes.equilibrium);
    let bent: Vec<Vec<Vector3<f64>>> = shapes.errors.iter().map(|(_, error)| moved(shapes, error)).collect();
    let all = bent.iter().flatten().chain(&shapes.equilibrium);
    let Some(frame) = Frame::around(view, all) else { return String::new() };
    let most = shapes.errors.iter().map(|(_, error)| largest(error)).fold(0.0, f64::max);
    let panel = |Shown { role, row }: &Shown| {
        let at = shapes.errors.iter().position(|(of, _)| of == row)?;
        let error = &shapes.errors[at].1;
        let part: Vec<f64> = error.iter().map(|e| e.norm() / most.max(f64::MIN_POSITIVE)).collect();
        let mut relief = Relief::new(frame);
        relief.ghost(&shapes.triangles, &shapes.equilibrium);
        relief.surface(&shapes.triangles, &bent[at], &part);
        let name = capital(role);
        let setting = &report.rows[*row];
        Some(format!(
            "<figure><img alt=\"{}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{}\"/>\n\
             <figcaption><strong>{}: wrong by up to {}</strong><br/>{}<br/><span class=\"muted\">{}</span></figcaption></figure>\n",
            escape(&format!("The body by {}, coloured by its error", setting.setting)),
            frame.size[0],
            frame.size[1],
            base64(&relief.png()),
            escape(&name),
            escape(&metres(largest(error))),
            escape(&setting.setting.to_string()),
            escape(&costs(&setting.cost)),
        ))
    };
    let panels: String = shown(report).iter().filter_map(panel).collect();
    let stops: Vec<String> = COLOURS.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    format!(
        "<h2>The error on the body</h2>\n<p>The body in the pose in which this scene's setting is furthest off ({}), as each \
         setting bends it; grey behind it: equilibrium. All pictures have the same colours.</p>\n<div class=\"bodies\">\n{panels}</div>\n\
         <div class=\"scale\"><div style=\"background:linear-gradient(90deg,{})\"></div><p><span>0</span><span>{}</span><span>{}</span></p></div>\n\
         <p class=\"muted\">Colour: distance of a point of the surface from where equilibrium has it.</p>\n",
        escape(&shapes.pose),
        stops.join(","),
        escape(&metres(0.5 * most)),
        escape(&metres(most)),
    )
}

fn moved(shapes: &Shapes, error: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    shapes.equilibrium.iter().zip(error).map(|(x, e)| x + e).collect()
}

fn largest(error: &[Vector3<f64>]) -> f64 {
    error.iter().map(|e| e.norm()).fold(0.0, f64::max)
}

/// Begins a text with a capital letter.
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
