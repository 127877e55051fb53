//! Texts of a terminal about each pose: where the control elements are, the forces with their errors, what holds them, where the
//! material yields.

use super::result_set::{PoseResult, ResultSet};
use super::told::{FirstYield, PointPush, Sureness};
use crate::base::diagnostic::is_verbose;
use crate::base::quantity::{quantity, scale_of};
use crate::base::table::Table;
use crate::deform::{COMPONENTS, ControlPose, Freedom, Wrench, percent};
use crate::effect::name_of;
use crate::fem::nearest_turn;
use crate::scene::LoadValue;
use crate::world::WrenchError;
use nalgebra::Vector3;

/// Error of the forces above which another model is named.
const DOUBTFUL: f64 = 0.1;
/// Distance from which a control element counts as far away, in sizes of the body.
const FAR: f64 = 10.0;
/// Part of the moment about the element's place at rest from which on a moment is reported.
const NOTICED: f64 = 0.02;

/// Part of the largest force or moment below which one is rounding.
const ROUNDING: f64 = 1e-7;

/// The text about all poses, one after another; sentences that hold for all of them stand once, at the end.
pub fn of_set(set: &ResultSet) -> String {
    let rest = |result: &PoseResult| {
        set.geometry.iter().find(|geometry| geometry.body == result.body).map(|geometry| &geometry.rest[..])
    };
    let size =
        |result: &PoseResult| super::free_poses::size(rest(result).unwrap_or_default().iter().copied());
    let said: Vec<Vec<String>> =
        set.results.iter().map(|result| sentences(result, Some(size(result)))).collect();
    let of_all = |line: &&String| said.len() > 1 && said.iter().all(|lines| lines.contains(line));
    let mut text = String::new();
    for (result, lines) in set.results.iter().zip(&said) {
        let PoseResult { pose, body, told, .. } = result;
        text +=
            &format!("\npose \"{pose}\": body.{body}, model {}\n{}", told.model.name, table(result).text());
        text.extend(lines.iter().filter(|line| !of_all(line)).map(|line| format!("  {line}\n")));
    }
    let common: Vec<String> =
        said.iter().take(1).flatten().filter(of_all).map(|line| format!("  {line}\n")).collect();
    if common.is_empty() { text } else { format!("{text}\nall poses:\n{}", common.concat()) }
}

/// Sentences about a pose; comparisons with the body's size where that is given.
pub fn sentences(result: &PoseResult, size: Option<f64>) -> Vec<String> {
    let mut lines = size.map_or_else(Vec::new, |size| far(result, size));
    lines.extend(loads(result));
    lines.extend(result.told.beyond.iter().map(|bent| format!("warning: {bent}")));
    lines.extend(result.told.pushed.iter().map(pushed));
    lines.extend(stress(result));
    lines.extend(sureness(result));
    lines.extend(what_holds(result));
    if size.is_some() && result.wrenches.is_none() {
        lines.push(format!("no forces: they need effects = [\"{}\"]", name_of(|effect| effect.needs_energy)));
    }
    lines
}

/// The motion of each control element that is not at rest, with the force and moment on it.
pub fn moves(result: &PoseResult) -> Vec<String> {
    let (told, floors) = (&result.told, floors(result));
    let mut lines = Vec::new();
    for (e, (name, pose)) in told.names.iter().zip(&told.control).enumerate() {
        if *pose == ControlPose::REST {
            continue;
        }
        let turn = nearest_turn(&pose.matrix).angle().to_degrees();
        let turned = if turn > 0.0005 { format!(", turned by {turn:.2}°") } else { String::new() };
        let moved = quantity(pose.translation.norm(), "m");
        let wrench = result.wrenches.as_ref().and_then(|forces| forces.controls.get(e));
        let force = wrench.map_or(String::new(), |(_, wrench)| {
            let moment = as_found(wrench.about_the_place(pose), told.freedom.get(e)).moment.norm();
            let moment = if moment > floors[1] { moment } else { 0.0 };
            let is_rounding = wrench.force.norm() <= floors[0];
            let plain = if is_rounding { Vector3::zeros() } else { wrench.force };
            let force = force(&Wrench { force: plain, ..*wrench }, &told.error);
            format!(": force {force}, moment {}", quantity(moment, "N·m"))
        });
        lines.push(format!("{name} moved by {moved}{turned}{force}"));
    }
    lines
}

/// `1.20 kN ± 80.0 N`, or `1.20 kN ±> 80.0 N` where the mesh's part is not known.
pub fn force(wrench: &Wrench, sure: &Sureness) -> String {
    let by = plus_minus(sure.measured(), |error| error.force, "N");
    format!("{} {by}", quantity(wrench.force.norm(), "N")).trim_end().to_owned()
}

/// Numbers of a vector with one prefix, `(0, 0, 5.00) mm`.
fn vector(v: &Vector3<f64>, unit: &str) -> String {
    let (scale, prefix) = scale_of(v.amax());
    let number = |x: f64| match x / scale {
        x if x.abs() < 0.005 => "0".to_owned(),
        x if x.abs() < 9.995 => format!("{x:.2}"),
        x if x.abs() < 99.95 => format!("{x:.1}"),
        x => format!("{x:.0}"),
    };
    format!("({}, {}, {}) {prefix}{unit}", number(v.x), number(v.y), number(v.z))
}

/// The error of a number of a wrench, `± 1.2 N`; `±> 1.2 N` of one that may be more.
fn plus_minus(error: Option<&WrenchError>, of: fn(&WrenchError) -> f64, unit: &str) -> String {
    error.map_or(String::new(), |error| {
        format!("±{} {}", if error.is_whole { "" } else { ">" }, quantity(of(error), unit))
    })
}

/// The force and the moment that are rounding beside the largest: of both, over the distance of the control elements.
pub fn floors(result: &PoseResult) -> [f64; 2] {
    let places = &result.told.places;
    let apart = places.iter().map(|place| (place - places[0]).norm()).fold(0.0, f64::max);
    let all = || result.wrenches.iter().flat_map(|forces| &forces.controls);
    let largest = |of: fn(&Wrench) -> f64| all().map(|(_, wrench)| of(wrench)).fold(0.0, f64::max);
    let [force, moment] = [largest(|wrench| wrench.force.norm()), largest(|wrench| wrench.moment.norm())];
    let by_moment = if apart > 0.0 { moment / apart } else { 0.0 };
    [force.max(by_moment), moment.max(force * apart)].map(|size| ROUNDING * size)
}

fn table(result: &PoseResult) -> Table {
    let floors = floors(result);
    let plain = |v: Vector3<f64>, floor: f64| if v.norm() <= floor { Vector3::zeros() } else { v };
    let error = result.told.error.measured();
    let heading = ["control", "moved by", "turned by", "force", "moment about its place"];
    let columns = if result.wrenches.is_some() { 5 } else { 3 };
    let mut table = Table::new(&heading[..columns]);
    for (e, name) in result.told.names.iter().enumerate() {
        let Some(pose) = result.told.control.get(e) else { continue };
        let turn = nearest_turn(&pose.matrix).scaled_axis();
        let turned = format!("{:.3}°", turn.norm().to_degrees());
        let moved =
            if pose.translation.amax() == 0.0 { "0".to_owned() } else { vector(&pose.translation, "m") };
        let (mut force, mut moment) = (String::new(), String::new());
        if let Some((_, wrench)) = result.wrenches.as_ref().and_then(|forces| forces.controls.get(e)) {
            let placed = as_found(wrench.about_the_place(pose), result.told.freedom.get(e));
            let of = |v: Vector3<f64>, unit: &str, by: fn(&WrenchError) -> f64| {
                let by = plus_minus(error, by, unit);
                match v == Vector3::zeros() {
                    true => format!("0 {by}"),
                    false => format!("{} |{}| {by}", vector(&v, unit), quantity(v.norm(), unit)),
                }
            };
            force = of(plain(placed.force, floors[0]), "N", |error| error.force);
            moment = of(plain(placed.moment, floors[1]), "N·m", |error| error.moment);
        }
        table.row(&[name, &moved, &turned, force.trim(), moment.trim()][..columns]);
    }
    table
}

/// The loads on the body beside control elements and points, as a pose file has them, and how far the surface moves.
fn loads(result: &PoseResult) -> Option<String> {
    let acts = |value: &LoadValue| value.numbers().iter().any(|x| *x != 0.0);
    let acting = result.told.loads.written.iter().filter(|(_, value)| acts(value));
    let acting: Vec<String> = acting.map(|(name, value)| format!("{name} = {value}")).collect();
    let most = result.displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
    (!acting.is_empty())
        .then(|| format!("under {}; the surface moves by up to {}", acting.join(", "), quantity(most, "m")))
}

/// The motion of the point at which a force acts.
fn pushed(PointPush { force, rest, moved }: &PointPush) -> String {
    let along = force
        .try_normalize(0.0)
        .map_or(String::new(), |way| format!(", {} of it along the force", quantity(moved.dot(&way), "m")));
    let (force, rest) = (quantity(force.norm(), "N"), vector(rest, "m"));
    format!("where {force} act, at {rest}, the surface moves by {}{along}", vector(moved, "m"))
}

/// The wrench with its loads along the free directions, by which their pose was found: in a model of small strain the moments of
/// the displaced body differ from them by terms of second order.
fn as_found(placed: Wrench, freedom: Option<&Freedom>) -> Wrench {
    let Some(Freedom { free, load }) = freedom else { return placed };
    let part = |k: usize, value: f64| if free[k] { load[k] } else { value };
    Wrench {
        force: Vector3::from_fn(|k, _| part(k, placed.force[k])),
        moment: Vector3::from_fn(|k, _| part(3 + k, placed.moment[k])),
    }
}

/// The forces that hold the control elements in directions that the pose does not mention.
fn what_holds(result: &PoseResult) -> Vec<String> {
    let Some(forces) = &result.wrenches else { return Vec::new() };
    let [_, floor] = floors(result);
    let mut lines = Vec::new();
    for (e, (name, wrench)) in forces.controls.iter().enumerate() {
        let Some(pose) = result.told.control.get(e) else { continue };
        let freedom = result.told.freedom.get(e).copied().unwrap_or_default();
        let placed = wrench.about_the_place(pose);
        if freedom.is_any() {
            let found: Vec<&str> = (0..6).filter(|&k| freedom.free[k]).map(|k| COMPONENTS[k]).collect();
            let pushed =
                if freedom.load == [0.0; 6] { "nothing pushes" } else { "only the given force pushes" };
            lines
                .push(format!("{name}: free in {}: {pushed} there, and its pose is found", found.join(", ")));
        }
        let is_turned = nearest_turn(&pose.matrix).angle() > 1e-9;
        let holds = placed.moment.norm() > floor.max(NOTICED * wrench.moment.norm());
        let is_moved = *pose != ControlPose::REST;
        if is_moved
            && !is_turned
            && !freedom.free[3..].contains(&true)
            && holds
            && pose.translation.norm() > 0.0
        {
            let moment = quantity(placed.moment.norm(), "N·m");
            lines.push(format!(
                "{name} is clamped against turning ({moment}). To let it turn: free = [\"rotation\"]"
            ));
        }
        if let Some(along) = slid(pose, &placed, &freedom.free) {
            lines.push(format!("{name} {along}"));
        }
    }
    lines
}

/// A force across the way of an element, which it does not need in order to be moved.
fn slid(pose: &ControlPose, placed: &Wrench, free: &[bool; 6]) -> Option<String> {
    let way = pose.translation.try_normalize(0.0)?;
    let along = placed.force.dot(&way);
    let across = placed.force - way * along;
    let is_held: Vec<&str> = (0..3)
        .filter(|&k| !free[k] && way[k].abs() < 1e-9 && across[k].abs() > placed.force.norm() * 0.1)
        .map(|k| COMPONENTS[k])
        .collect();
    (!is_held.is_empty()).then(|| {
        let list: Vec<String> = is_held.iter().map(|name| format!("\"{name}\"")).collect();
        format!(
            "is held from sliding aside by {} ({} along its way). To let it slide: free = [{}]",
            quantity(across.norm(), "N"),
            quantity(along, "N"),
            list.join(", ")
        )
    })
}

/// Whether the pose is of another size than the body.
fn far(result: &PoseResult, size: f64) -> Vec<String> {
    let (told, mut lines) = (&result.told, Vec::new());
    for (name, pose) in told.names.iter().zip(&told.control) {
        let times = pose.translation.norm() / size;
        if times > FAR {
            let (way, whole) = (quantity(pose.translation.norm(), "m"), quantity(size, "m"));
            lines.push(format!(
                "warning: {name} is moved by {way}, {times:.0} times the body's size of {whole}. Poses are in \
                 metres: were millimetres meant?"
            ));
        }
    }
    let most = result.displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
    if lines.is_empty() && most > FAR * size {
        let (way, whole) = (quantity(most, "m"), quantity(size, "m"));
        lines.push(format!(
            "warning: a node moves by {way}, {:.0} times the body's size of {whole}. Check the units of \
             loads and material (Pa, N, kg/m³)",
            most / size
        ));
    }
    lines
}

fn stress(result: &PoseResult) -> Vec<String> {
    let Some(stress) = &result.stress else { return Vec::new() };
    let reached = &stress.reached;
    let mut lines = vec![reached.sentence()];
    match (&result.told.first_yield, reached.limit) {
        (Some(first), _) => lines.push(yielding(result, first)),
        (None, Some(_))
            if reached.is_beyond() && reached.inside.limit.is_some_and(|(part, _)| part <= 1.0) =>
        {
            let elsewhere = reached.inside.limit.map_or(0.0, |(part, _)| part);
            lines.push(format!(
                "above the limit only at edges of control elements, whose peaks grow with a finer mesh; \
                 elsewhere {} of the limit",
                percent(elsewhere)
            ));
        }
        (None, Some((part, _))) if part > 1.0 => {
            lines.push("Yielding is not computed: forces beyond the limit assume elasticity".to_owned());
        }
        (None, Some((part, _))) if part > 0.5 || !result.told.loads.is_none() => {
            lines.push(format!("no yield: {} of the limit is reached", quantity(part, "")));
        }
        (None, Some((part, _))) if part > 0.0 => {
            lines.push(format!("no yield: the limit lies at about {:.1} times this pose", 1.0 / part));
        }
        _ => {}
    }
    lines
}

/// The first yield on the way: what moved, and the force on it.
fn yielding(result: &PoseResult, first: &FirstYield) -> String {
    let moved = (0..first.control.len())
        .max_by(|&a, &b| size_of(&first.control[a]).total_cmp(&size_of(&first.control[b])))
        .unwrap_or(0);
    if first.share == 0.0 {
        return "The loads alone pass the limit. Beyond that, forces assume elasticity".to_owned();
    }
    let (pose, name) = (&first.control[moved], result.told.names.get(moved).map_or("", String::as_str));
    let way = match pose.translation.norm() {
        0.0 => format!("{:.2}° of {name}", nearest_turn(&pose.matrix).angle().to_degrees()),
        way => format!("{} of {name}", quantity(way, "m")),
    };
    let wrench = first.wrenches.as_ref().and_then(|wrenches| wrenches.get(moved));
    let force = wrench.map_or(String::new(), |wrench| {
        let size = wrench.force.norm();
        let by = plus_minus(first.error.as_ref(), |error| error.force, "N");
        let along = pose.translation.try_normalize(0.0).map(|way| wrench.force.dot(&way));
        let along = along.filter(|along| (along.abs() - size).abs() > 0.02 * size);
        let along = along.map_or(String::new(), |along| format!(", {} along its way,", quantity(along, "N")));
        format!("{}{along} at ", format!("{} {by}", quantity(size, "N")).trim_end())
    });
    let share = percent(first.share);
    // Near rest stress grows as the way does.
    let edges = match first.at_edges {
        part if part > 1.02 && is_verbose() => format!(
            " Peaks at the edges of control elements, which grow with a finer mesh, reach the limit at about {}.",
            percent(first.share / part)
        ),
        _ => String::new(),
    };
    format!("First yield: {force}{way} ({share} of this pose). Beyond that, forces assume elasticity.{edges}")
}

fn size_of(pose: &ControlPose) -> f64 {
    pose.translation.norm() + nearest_turn(&pose.matrix).angle() * 1e-6
}

/// The certainty of the forces, and the model that is more certain.
fn sureness(result: &PoseResult) -> Vec<String> {
    if result.wrenches.is_none() {
        return Vec::new();
    }
    match &result.told.error {
        Sureness::Unknown(why) => vec![format!("force error unknown: {why}")],
        Sureness::Measured(error) if error.force == 0.0 && error.moment == 0.0 => Vec::new(),
        Sureness::Measured(error) => {
            let name = result.told.model.name;
            let how = match error.parts {
                [Some(model), Some(mesh)] => {
                    format!(
                        "{} of the largest force by the model {name}, {} by the mesh",
                        percent(model),
                        percent(mesh)
                    )
                }
                [Some(model), None] if !error.is_whole => {
                    format!(
                        "{} of the largest force by the model {name}; the mesh's part is not known, so it may be more",
                        percent(model)
                    )
                }
                _ => format!(
                    "{} of the largest force by the model {name} and the mesh together",
                    percent(error.part)
                ),
            };
            let mut lines = vec![format!("error of forces: {how}")];
            if error.parts[0].unwrap_or(error.part) > DOUBTFUL && result.told.model.law().is_none() {
                lines.push(
                    "For forces in this pose take model = \"stvk\", which adds no error of its own"
                        .to_owned(),
                );
            }
            lines
        }
    }
}
