//! `greenstage inspect`: shows what is in a mesh, .green, scene or stage file.

use super::expected;
use super::print::print;
use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::base::table::{Table, bytes, count};
use crate::base::text::quoted;
use crate::config::foreign;
use crate::green::{GreenError, GreenFile, STIFFNESS};
use crate::mesh::length_unit::{LARGEST_M, implausible};
use crate::mesh::{self, Surface, diagnostics, quality, surface_check, surface_files};
use crate::prepare::{self, Resolved};
use crate::scene::built_in::{self, BUILT_IN};
use crate::scene::{Material, Method, Scene};
use crate::session::open;
use crate::stage::Stage;
use crate::world::flow;
use crate::{effect, tuning};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Show what is in a mesh, surface, .green, scene or stage file, or in a built-in stage
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The file, whose kind is recognised by its name and content; or the name of a built-in stage
    pub file: PathBuf,
    /// Print the file of a built-in stage or scene as it stands, to start one of your own from it: greenstage inspect workbench
    /// --toml > bench.toml
    #[arg(long, conflicts_with_all = ["json", "graph"])]
    pub toml: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Print the data flow of a scene, from tracker to surface: text, or dot for Graphviz
    #[arg(long, value_enum, num_args = 0..=1, default_missing_value = "text", conflicts_with = "json")]
    pub graph: Option<GraphFormat>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum GraphFormat {
    Text,
    Dot,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.toml {
        return print(&built_in_text(&args.file)?);
    }
    if let Some(format) = args.graph {
        return graph(&args.file, format);
    }
    let extension = args.file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (text, value) = match extension.as_str() {
        "green" => green(&args.file)?,
        "toml" if is_stage(&args.file)? => stage(&args.file)?,
        "toml" => scene(&args.file)?,
        "" if is_built_in_scene(&args.file) => scene(&args.file)?,
        "" if !args.file.exists() => stage(&args.file)?,
        _ if surface_files::is_surface_file(&args.file) => surface(&args.file)?,
        _ => match foreign::display_at(&args.file) {
            Some(told) => return Err(Failure::wrong(format!("{}: {told}", args.file.display()))),
            None => mesh(&args.file)?,
        },
    };
    if args.json { print(&format!("{value:#}\n")) } else { print(&text) }
}

/// The text of a built-in stage or scene, or of a file.
fn built_in_text(name: &Path) -> Result<String, Failure> {
    match BUILT_IN.iter().find(|(known, _)| is_built_in_scene(name) && *known == name.as_os_str()) {
        Some((_, text)) => Ok((*text).to_owned()),
        None => Ok(Stage::text(&name.display().to_string()).map_err(Failure::request)?.into_owned()),
    }
}

/// Whether this is the name of a built-in scene, and no file's.
pub fn is_built_in_scene(name: &Path) -> bool {
    matches!(built_in::named(name), Some(Ok(_)))
}

/// A TOML file with a stage's tables describes a stage, any other a scene; a name without extension, of which there is
/// no file, is a built-in stage's, if it is no built-in scene's.
pub fn is_stage(path: &Path) -> Result<bool, Failure> {
    if is_built_in_scene(path) {
        return Ok(false);
    }
    if path.extension().is_none() && !path.exists() {
        return Ok(true);
    }
    let table: toml::Table = crate::config::load(path)?;
    let tables = ["screen", "viewer", "workspace", "window", "tracker", "sensor", "stylus", "haptic"];
    Ok(tables.iter().any(|name| table.contains_key(*name)))
}

fn mesh(path: &Path) -> Result<(String, Value), Failure> {
    let loaded = mesh::load(path).map_err(Failure::request)?;
    let surface = Surface::from_mesh(&loaded.mesh);
    let report = quality::report(&loaded.mesh, &surface);
    let [low, high] = report.bounding_box;
    let mut text = format!(
        "{}\n{} nodes, {} tetrahedra; surface {} nodes, {} triangles; {}\n\
         box ({:.6}, {:.6}, {:.6}) to ({:.6}, {:.6}, {:.6})\nvolume {:.6e} m³, surface {:.6e} m²\n\n",
        path.display(),
        report.nodes,
        report.tetrahedra,
        report.surface_nodes,
        report.surface_triangles,
        count(report.components, "piece"),
        low[0],
        low[1],
        low[2],
        high[0],
        high[1],
        high[2],
        report.volume,
        report.area,
    );
    let mut regions = Table::new(&["region", "name", "tetrahedra", "volume m³"]);
    for (number, region) in &report.regions {
        let name = region.name.as_deref().unwrap_or("");
        let (tetrahedra, volume) = (region.tetrahedra.to_string(), format!("{:.6e}", region.volume));
        regions.row(&[&number.to_string(), name, &tetrahedra, &volume]);
    }
    text.push_str(&regions.text());
    if !report.groups.is_empty() {
        let mut groups = Table::new(&["node group", "nodes"]);
        for (name, nodes) in &report.groups {
            groups.row(&[name, &nodes.to_string()]);
        }
        text.push_str(&format!("\n{}", groups.text()));
    }
    text.push_str(&format!("\n{}", histogram(&report.quality)));
    let found = diagnostics::find(&loaded.mesh);
    text.push_str(match found.is_empty() {
        true => "nothing wrong is found\n",
        false => "what is wrong\n",
    });
    for line in &found {
        text.push_str(&format!("  {}: {}\n", line.severity, line.message));
    }
    let doubt = implausible((0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max), LARGEST_M);
    for notice in loaded.notices.iter().chain(&doubt) {
        text.push_str(&format!("note: {notice}\n"));
    }
    let value =
        json!({ "file": path.to_string_lossy(), "mesh": report, "wrong": found, "notices": loaded.notices });
    Ok((text, value))
}

fn surface(path: &Path) -> Result<(String, Value), Failure> {
    let loaded = surface_files::load(path).map_err(Failure::request)?;
    let (mut surface, mut notices) = (loaded.surface, loaded.notices);
    let report = surface_check::check(&mut surface, &mut notices);
    let faults = report.faults();
    let [low, high] = report.bounding_box;
    let cavities = report.shells.iter().filter(|shell| shell.is_cavity).count();
    let is_closed = report.is_closed();
    let volume = |inside: f64| if is_closed { format!("{inside:.6e}") } else { "open".to_owned() };
    let mut text = format!(
        "{}\na surface of {} vertices and {} triangles ({} without area); {}, {cavities} of them cavities\n\
         box ({:.6}, {:.6}, {:.6}) to ({:.6}, {:.6}, {:.6})\n{}surface {:.6e} m²\n\n",
        path.display(),
        report.vertices,
        report.triangles,
        report.flat,
        count(report.shells.len(), "shell"),
        low[0],
        low[1],
        low[2],
        high[0],
        high[1],
        high[2],
        if is_closed { format!("volume {} m³, ", volume(report.volume)) } else { String::new() },
        report.area,
    );
    let mut shells = Table::new(&["shell", "triangles", "volume m³"]);
    for (number, shell) in report.shells.iter().enumerate().take(20) {
        shells.row(&[&(number + 1).to_string(), &shell.triangles.to_string(), &volume(shell.volume)]);
    }
    text.push_str(&format!("{}\n", shells.text()));
    let wrong = faults.iter().map(|fault| format!("wrong: {fault}\n"));
    let notes = notices.iter().map(|notice| format!("note: {notice}\n"));
    text.extend(wrong.chain(notes));
    let doubt = implausible((0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max), LARGEST_M);
    text.extend(doubt.map(|doubt| format!("note: {doubt}\n")));
    let limit = if faults.is_empty() { "" } else { ", unless what is wrong is larger than a cell" };
    text += &match is_closed {
        true => format!(
            "closed: `greenstage new {}` fills it with cells that suit its walls{limit}\n",
            quoted(&path.to_string_lossy())
        ),
        false => "not closed: it has no inside to be filled\n".to_owned(),
    };
    let value =
        json!({ "file": path.to_string_lossy(), "surface": report, "faults": faults, "notices": notices });
    Ok((text, value))
}

/// Text bars of the element qualities.
fn histogram(quality: &quality::QualityReport) -> String {
    const WIDTH: usize = 50;
    let most = quality.histogram.iter().copied().max().unwrap_or(0).max(1);
    let mut text =
        format!("quality 6·√2·V/l³ (1 = regular): least {:.4}, mean {:.3}\n", quality.min, quality.mean);
    for (bin, &count) in quality.histogram.iter().enumerate() {
        let bar = "█".repeat((count * WIDTH).div_ceil(most).min(WIDTH));
        text.push_str(&format!(
            "  {:.1} – {:.1}  {count:>8}  {bar}\n",
            bin as f64 / 10.0,
            (bin + 1) as f64 / 10.0
        ));
    }
    text
}

fn green(path: &Path) -> Result<(String, Value), Failure> {
    let file = GreenFile::open(path)?;
    file.verify()?;
    let mut text = format!(
        "{}\n{}, format {}, {}\n",
        path.display(),
        file.meta.program,
        file.meta.format,
        file.meta.units
    );
    for (name, body) in &file.meta.bodies {
        text.push_str(&format!(
            "\nbody {name}: mesh of {} nodes{}, surface {} nodes and {} triangles\n  solver {}, \
             worst relative residual {:.1e}{}{}\n  {}\n  fingerprint {}\n",
            body.mesh_nodes,
            if body.element == Method::Bem.name() {
                ", boundary elements".to_owned()
            } else {
                format!(" and {} {}", body.mesh_tets, body.element)
            },
            body.surface_nodes,
            body.surface_triangles,
            body.accuracy.solver,
            body.accuracy.residual,
            body.accuracy.forward_error.map(|e| format!(", forward error {e:.1e}")).unwrap_or_default(),
            body.accuracy.asymmetry.map(|a| format!(", asymmetry of S {a:.1e}")).unwrap_or_default(),
            body.accuracy.stored(),
            body.fingerprint,
        ));
        if let Some(compressed) = &body.compressed {
            text.push_str(&format!("  {}\n", compressed.told()));
        }
        for control in &body.controls {
            let zero = match control.vanishing.is_empty() {
                true => String::new(),
                false => format!(", zero: {}", control.vanishing.join(", ")),
            };
            text.push_str(&format!(
                "  control {}: {} nodes, {} of 12 fields independent{zero}\n",
                control.name, control.nodes, control.independent
            ));
        }
        if let Some(errors) = effect::expected::read(&file, name)? {
            text.push_str(&expected::lines(name, &errors));
        }
    }
    let mut tensors = Table::new(&["tensor", "type", "shape", "size"]);
    for (name, dtype, shape, size) in file.tensors() {
        tensors.row(&[name, &dtype, &format!("{shape:?}"), &bytes(size as f64)]);
    }
    text.push_str(&format!("\n{}", tensors.text()));
    Ok((text, json!({ "file": path.to_string_lossy(), "green": file.meta })))
}

fn scene(path: &Path) -> Result<(String, Value), Failure> {
    let scene = Resolved::load(path)?;
    let mut text = format!("{}\nstage {}\n", path.display(), scene.stage);
    for (name, body) in &scene.body {
        let needs = match scene.law(name)? {
            Some(_) => "; solved anew for every pose",
            None if scene.requirements(name)?.has(STIFFNESS) => "; needs the handle stiffness",
            None => "",
        };
        let loaded = scene.load_mesh(name, body)?;
        let effects = if body.effects.is_empty() { "none".to_owned() } else { body.effects.join(", ") };
        text.push_str(&format!(
            "\nbody {name}: {} nodes, {}; model {}, effects {effects}{needs}\n",
            loaded.mesh.nodes.len(),
            match body.method {
                Method::Bem => format!("{} triangles of boundary elements", loaded.mesh.triangles.len()),
                Method::Fem => format!("{} tetrahedra", loaded.mesh.tets.len()),
            },
            body.model,
        ));
        for (control_name, control) in &body.control {
            let nodes = control.nodes.select(&loaded.mesh).map_err(|message| {
                Failure::request(scene.invalid(&format!("body.{name}.control.{control_name}.nodes"), message))
            })?;
            let grab = control.grab.name();
            text.push_str(&format!("  control {control_name}: {} nodes, {grab}\n", nodes.len()));
        }
        let order = effect::in_order(&scene.bodies[name]);
        if order.len() > 1 {
            text.push_str(&format!("  its effects act in this order: {}\n", order.join(", ")));
        }
        let (low, high) = bounding_box(&loaded.mesh.nodes);
        let materials = std::iter::once(&body.material).chain(body.region.values());
        let doubts = materials.filter_map(Material::doubt).map(|(_, message)| message);
        for doubt in doubts.chain(implausible((high - low).amax(), body.material.largest_m())) {
            text.push_str(&format!("  note: {doubt}\n"));
        }
    }
    let path = prepare::green_path(&scene);
    let online = tuning::settle_from_file(scene.clone())?;
    let state = match prepare::fresh(&online, &path)? {
        Ok(_) => "is fresh",
        Err(GreenError::Stale { .. }) => "is stale",
        Err(_) => "is not there yet",
    };
    text.push_str(&format!("\n{} {state}\n", path.display()));
    let scene = Scene::clone(&scene);
    Ok((text, json!({ "scene": scene, "green": path.to_string_lossy(), "state": state })))
}

/// The data flow of the bodies that are shown in windows, with one hand.
fn graph(path: &Path, format: GraphFormat) -> Result<(), Failure> {
    let is_toml = path.extension().is_some_and(|extension| extension == "toml");
    if !is_built_in_scene(path) && (!is_toml || is_stage(path)?) {
        return Err(Failure::wrong(format!("{}: only a scene has a data flow to show", path.display())));
    }
    let scene = tuning::settle_from_file(Resolved::load(path)?)?;
    let stage = open::stage(&scene, None)?;
    let (graph, _) = flow::graph(&scene.body, &stage).map_err(Failure::request)?;
    print(&match format {
        GraphFormat::Text => graph.text(),
        GraphFormat::Dot => graph.dot(),
    })
}

fn stage(path: &Path) -> Result<(String, Value), Failure> {
    let found = if path.exists() { Stage::load(path) } else { Stage::find(&path.display().to_string()) };
    let stage = found.and_then(crate::track::checked).map_err(Failure::request)?;
    let text = stage.to_string();
    Ok((text.clone(), json!({ "file": path.to_string_lossy(), "stage": text.lines().collect::<Vec<_>>() })))
}
