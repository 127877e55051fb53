//! The columns of one body as other programs take them: its surface at rest, and a displacement field for each column.
//!
//! In: a .green file and, where one is asked for, a pose. Out: [`BodyBasis`], in which the body's shape is a linear sum,
//! moved as a whole:
//!
//! ```text
//! x = centre + motion · (rest + Σ coefficient · column)
//! ```

use crate::base::extent::extent;
use crate::base::failure::Failure;
use crate::config::unknown_name;
use crate::deform::{ControlRest, Deformer, ModelEntry};
use crate::export::asked::{PoseRequest, lead};
use crate::green::{ColumnName, ColumnSource, ControlMeta, GreenFile};
use crate::prepare::Resolved;
use crate::scene::{Grab, Scene};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;

/// One body.
#[derive(Clone)]
pub struct BodyBasis {
    pub body: String,
    pub model: &'static ModelEntry,
    /// Mesh coordinates of the origin about which all else stands, m.
    pub centre: Vector3<f64>,
    pub rest: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// The columns that move something.
    pub columns: Vec<Column>,
    /// The columns that move nothing: fields of flat control elements, loads on what is held.
    pub vanishing: Vec<ColumnName>,
    pub controls: Vec<Handle>,
    /// Whether the columns were chosen one by one.
    pub is_chosen: bool,
    /// Name of the pose in which the coefficients and the motion are; both are at rest without.
    pub pose: Option<String>,
    pub motion: Isometry3<f64>,
    /// The body's largest extent, m.
    pub size: f64,
}

/// One displacement field.
#[derive(Clone)]
pub struct Column {
    pub name: ColumnName,
    /// Displacement of each node, m per unit.
    pub u: Vec<[f32; 3]>,
    /// The largest of them.
    pub largest: f64,
    pub coefficient: f64,
}

/// A control element.
#[derive(Clone)]
pub struct Handle {
    pub rest: ControlRest,
    pub is_grabbed: bool,
    /// Half of the largest extent of its surface nodes, m; of a single node a part of the body's size.
    pub radius: f64,
}

/// Radius of a control element of a single node, in parts of the body's size.
const SINGLE_NODE: f64 = 0.03;

/// The columns and poses that are wanted of a body.
#[derive(Clone, Copy, Default)]
pub struct Choice<'a> {
    /// Names of columns, without their body; all where there is none.
    pub columns: &'a [String],
    /// The pose of each body, behind those that it goes on from.
    pub asked: &'a [PoseRequest<'a>],
}

impl BodyBasis {
    /// Reads a body; the error says why it cannot be written as a sum.
    pub fn read(
        scene: &Resolved,
        file: &Arc<GreenFile>,
        name: &str,
        choice: Choice<'_>,
    ) -> Result<BodyBasis, Failure> {
        let wrong = |message: String| Failure::request(scene.invalid(&format!("body.{name}"), message));
        let model = scene.bodies[name].model;
        let names = file.column_names(name);
        let deformer = Deformer::new(file.clone(), name, model).map_err(Failure::wrong)?;
        let (nodes, groups) = (deformer.node_count(), file.groups(name));
        let places =
            groups.iter().flat_map(|group| (0..group.columns(nodes).unwrap_or(0)).map(move |k| (group, k)));
        let asked = choice.asked.iter().rfind(|asked| asked.body == name);
        let posed = asked.map(|asked| pose(asked, choice.asked, deformer)).transpose()?;
        let rest = file.rest(name).to_vec();
        let size = largest_extent(rest.iter().copied()).unwrap_or(1.0);
        check_chosen(choice.columns.iter(), &names)?;
        let (mut columns, mut vanishing, mut missing) = (Vec::new(), Vec::new(), Vec::new());
        for (k, (name, (group, of_group))) in names.into_iter().zip(places).enumerate() {
            let value = |node: usize, axis: usize| group.value(nodes, of_group, 3 * node + axis);
            let u: Vec<[f32; 3]> = (0..nodes).map(|node| [0, 1, 2].map(|axis| value(node, axis))).collect();
            let largest = u.iter().map(|u| Vector3::from(*u).cast::<f64>().norm()).fold(0.0, f64::max);
            let coefficient = posed.as_ref().and_then(|(c, _)| c.get(k).copied()).unwrap_or(0.0);
            let is_chosen = choice.columns.is_empty() || choice.columns.contains(&name.name);
            // The entries of M have no unit; what a load does for 1 N or 1 Pa is small of any stiff body.
            let is_zero = match name.source {
                ColumnSource::Field { .. } => largest <= f64::from(f32::EPSILON) * size,
                ColumnSource::Load => largest == 0.0,
                ColumnSource::Model => false,
            };
            match (is_zero, is_chosen) {
                (true, true) => vanishing.push(name),
                (false, true) => columns.push(Column { name, u, largest, coefficient }),
                (false, false) if coefficient != 0.0 => missing.push(name.name),
                (_, false) => {}
            }
        }
        if !missing.is_empty() {
            let (pose, names) = (asked.map_or("", |asked| asked.pose), missing.join(","));
            return Err(wrong(format!(
                "the pose \"{pose}\" is a sum of other columns as well: add {names} to --columns"
            )));
        }
        Ok(BodyBasis {
            body: name.to_owned(),
            model,
            centre: Vector3::from(file.meta.bodies[name].centre),
            triangles: file.triangles(name).to_vec(),
            columns,
            vanishing,
            controls: handles(scene, file, name, size),
            pose: asked.map(|asked| asked.pose.to_owned()),
            motion: posed.map_or_else(Isometry3::identity, |(_, motion)| motion),
            is_chosen: !choice.columns.is_empty(),
            size,
            rest,
        })
    }

    /// The column of a field of a control element, if it moves something.
    pub fn field(&self, control: usize, field: usize) -> Option<usize> {
        self.columns.iter().position(|column| column.name.source == ColumnSource::Field { control, field })
    }

    /// The displacements of the pose before its motion, m.
    pub fn displacements(&self) -> Vec<Vector3<f64>> {
        let mut u = vec![Vector3::zeros(); self.rest.len()];
        for column in self.columns.iter().filter(|column| column.coefficient != 0.0) {
            for (u, own) in u.iter_mut().zip(&column.u) {
                *u += Vector3::from(*own).cast::<f64>() * column.coefficient;
            }
        }
        u
    }
}

/// Coefficients of all columns, and the motion of the whole body.
fn pose(
    asked: &PoseRequest<'_>,
    all: &[PoseRequest<'_>],
    mut body: Deformer,
) -> Result<(Vec<f64>, Isometry3<f64>), Failure> {
    let wrong = |message: &str| Failure::wrong(format!("{}: {message}", asked.place()));
    let as_surface = "write the surface of the pose instead: -o OUT.stl, OUT.ply or OUT.obj";
    if !asked.loads.forces.is_empty() {
        return Err(wrong(&format!("forces at points are no sum of columns; {as_surface}")));
    }
    let applied = asked.loads.applied(&body).map_err(|message| wrong(&message))?;
    body.apply(&applied);
    lead(asked, all, None, &mut body);
    body.evaluate(&asked.control);
    if body.part_weights().is_some() {
        return Err(wrong(&format!(
            "its model moves the surface in parts, which no sum of columns does; {as_surface}"
        )));
    }
    Ok((body.state.coefficients.clone(), body.body_from_surface()))
}

/// Whether every column that is asked for is there.
pub(super) fn check_chosen<'a>(
    mut chosen: impl Iterator<Item = &'a String>,
    names: &[ColumnName],
) -> Result<(), Failure> {
    let known = || names.iter().map(|column| column.name.as_str());
    let unknown = chosen.find(|name| known().all(|known| known != *name));
    unknown.map_or(Ok(()), |name| {
        Err(Failure::wrong(format!("--columns: {}", unknown_name("column", name, known()))))
    })
}

fn handles(scene: &Scene, file: &GreenFile, body: &str, size: f64) -> Vec<Handle> {
    let (rest, settings) = (file.rest(body), &scene.body[body]);
    let places = |control: &ControlMeta| {
        file.control(body, &control.name).iter().map(|node| rest[*node as usize]).collect::<Vec<_>>()
    };
    let handle = |control: &ControlMeta| Handle {
        rest: ControlRest {
            name: control.name.clone(),
            origin: Vector3::from(control.origin),
            nodes: control.nodes,
        },
        is_grabbed: settings.control.get(&control.name).is_some_and(|control| control.grab == Grab::Dragger),
        radius: largest_extent(places(control).into_iter()).map_or(SINGLE_NODE * size, |extent| 0.5 * extent),
    };
    file.meta.bodies[body].controls.iter().map(handle).collect()
}

/// The largest extent of places along an axis; `None` for a single one.
fn largest_extent(places: impl Iterator<Item = [f32; 3]>) -> Option<f64> {
    let (low, high) = extent(places.map(Vector3::from))?;
    let extent = f64::from((high - low).max());
    (extent.is_finite() && extent > 0.0).then_some(extent)
}
