//! The loads of one pose of a pose file: what each load of the scene comes to, and forces at points of the surface.
//!
//! In: the keys `load` and `force` of a pose. Out: [`PoseLoads`], to be applied to a body that is summed from its columns or to
//! one that is solved anew, and to be written again.

use super::applied::StaticForces;
use super::{AppliedLoads, PointLoad, Pull};
use crate::base::extent::bounding_box;
use crate::config::unknown_name;
use crate::deform::deformer::Deformer;
use crate::deform::kernel::surface::nearest_point;
use crate::deform::model::ModelEntry;
use crate::deform::statics::Statics;
use crate::mesh::Surface;
use crate::mesh::diagnostics::digits;
use crate::scene::{Body, LARGEST_NUMBER, LoadEntry, LoadSource, LoadValue};
use nalgebra::{Rotation3, Vector3};
use serde::Deserialize;
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// A point force's place may be so far from the surface, as part of the body's radius.
const FARTHEST: f64 = 0.02;

/// A force at a node of the surface, or at its point nearest to a place.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointForce {
    /// m, in the mesh's coordinates at rest.
    pub at: Option<[f64; 3]>,
    /// The node's tag in the mesh.
    pub node: Option<u64>,
    /// N, along the mesh's axes.
    pub force: [f64; 3],
}

/// The loads of one pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseLoads {
    /// Every load of the body as a pose file has it, with its name.
    pub written: Vec<(String, LoadValue)>,
    /// Coefficients of the columns of the body's loads, along the mesh's axes.
    pub coefficients: Vec<f64>,
    pub forces: Vec<PointForce>,
    /// Place of each force: file, line and column.
    places: Vec<String>,
}

/// Value of a scene's load in a pose that does not name it, as a pose file would give it.
fn as_in_scene(load: &LoadEntry<'_>, body: &Body) -> LoadValue {
    match (load.source, &load.start[..]) {
        (LoadSource::Centrifugal(centrifugal), _) => LoadValue::One(centrifugal.speed),
        (LoadSource::Thermal, _) => LoadValue::One(body.thermal.map_or(0.0, |thermal| thermal.difference)),
        (LoadSource::Gravity, start) => {
            let turn = body.place.and_then(|place| place.rotation).unwrap_or_default();
            let room = Rotation3::new(V3::from(turn));
            LoadValue::Three((room.inverse() * V3::from_column_slice(start)).into())
        }
        (LoadSource::Pattern(_), &[x, y, z]) => LoadValue::Three([x, y, z]),
        (LoadSource::Pattern(_), start) => LoadValue::One(start.first().copied().unwrap_or(0.0)),
    }
}

impl PoseLoads {
    /// All loads of a body as they are in the scene.
    pub fn of_scene(body: &Body) -> PoseLoads {
        PoseLoads::of_pose(&BTreeMap::new(), "", body).unwrap_or_default()
    }

    /// The scene's loads, with the values that the pose gives in `load`. The error names the wrong one, of the body `name`.
    pub fn of_pose(load: &BTreeMap<String, LoadValue>, name: &str, body: &Body) -> Result<PoseLoads, String> {
        let entries = body.loads();
        if let Some(unknown) = load.keys().find(|key| entries.iter().all(|load| load.name != **key)) {
            return Err(match entries[..] {
                [] => format!(
                    "load.{unknown}: the scene gives this body no load; add gravity or a [body.{name}.load.NAME]"
                ),
                _ => unknown_name("load", unknown, entries.iter().map(|load| load.name)),
            });
        }
        let (mut written, mut coefficients) = (Vec::new(), Vec::new());
        for entry in &entries {
            let value = load.get(entry.name).copied().unwrap_or_else(|| as_in_scene(entry, body));
            let own = body.load_coefficients(entry, value.numbers());
            coefficients.extend(own.map_err(|why| format!("load.{}: {why}", entry.name))?);
            written.push((entry.name.to_owned(), value));
        }
        Ok(PoseLoads { written, coefficients, ..PoseLoads::default() })
    }

    /// Adds forces at points, each with its place in the file. The error names one that the body cannot have.
    pub fn with_forces(
        self,
        forces: Vec<(PointForce, String)>,
        body: &Body,
        model: &ModelEntry,
    ) -> Result<PoseLoads, String> {
        let (forces, places): (Vec<PointForce>, Vec<String>) = forces.into_iter().unzip();
        for (number, force) in forces.iter().enumerate() {
            let place = called(number, &places);
            if body.surface_compliance.is_none() && !model.takes_points() {
                return Err(format!(
                    "{place}: forces at points need surface_compliance = {{ nodes = \"surface\" }} in the scene"
                ));
            }
            if force.at.is_some() == force.node.is_some() {
                return Err(format!("{place}: name either at = [x, y, z] or node = TAG, one of the two"));
            }
            let mut numbers = force.at.iter().flatten().chain(&force.force);
            if !numbers.all(|value| value.abs() <= LARGEST_NUMBER) {
                return Err(format!("{place}: a number is not finite, or above {LARGEST_NUMBER:e}"));
            }
        }
        Ok(PoseLoads { forces, places, ..self })
    }

    /// Whether nothing acts on the body but its control elements.
    pub fn is_none(&self) -> bool {
        self.forces.is_empty() && self.coefficients.iter().all(|load| *load == 0.0)
    }

    /// Factor by which warmth lengthens the body where it is free.
    pub fn free_stretch(&self, body: &Body) -> f64 {
        let columns = body.loads().into_iter().flat_map(|load| {
            std::iter::repeat_n(matches!(load.source, LoadSource::Thermal), load.source.columns())
        });
        let warm = columns.zip(&self.coefficients).filter(|(is_thermal, _)| *is_thermal);
        1.0 + warm.map(|(_, strain)| strain).sum::<f64>()
    }

    /// The loads as they are applied to a body that is summed from its columns; the error names a place that cannot take a force.
    pub fn applied(&self, body: &Deformer) -> Result<AppliedLoads, String> {
        let takes = body.bears_forces();
        let rest: Vec<V3> =
            body.rest().iter().map(|x| Vector3::from(*x).cast::<f64>() + body.centre).collect();
        let surface = Taking {
            triangles: body.triangles(),
            rest: &rest,
            tags: body.tags(),
            takes: &|node| takes.contains(&node),
            otherwise: "is not among the nodes of surface_compliance, or belongs to a control element",
        };
        self.on(&surface)
    }

    /// The loads as they are applied to a body that is solved anew.
    pub fn on_mesh(&self, statics: &Statics) -> Result<StaticForces, String> {
        let (loads, nodes) = self.on_its_surface(statics)?;
        let forces = StaticForces::from_loads(&loads, |node| nodes.get(node as usize).copied());
        forces.ok_or_else(|| "a force is not given as a vector".to_owned())
    }

    /// The forces at points of such a body, whose nodes count as those of its mesh.
    pub fn points_on_mesh(&self, statics: &Statics) -> Result<Vec<PointLoad>, String> {
        let (AppliedLoads { points, .. }, nodes) = self.on_its_surface(statics)?;
        let in_mesh = |node: u32| nodes[node as usize];
        Ok(points.into_iter().map(|point| PointLoad { nodes: point.nodes.map(in_mesh), ..point }).collect())
    }

    /// The loads by the nodes of the mesh's surface, and these nodes.
    fn on_its_surface(&self, statics: &Statics) -> Result<(AppliedLoads, Vec<u32>), String> {
        let mesh = &statics.mesh;
        let Surface { nodes, triangles } = Surface::from_mesh(mesh);
        let rest: Vec<V3> = nodes.iter().map(|&node| mesh.nodes[node as usize]).collect();
        let tags: Vec<u64> = nodes.iter().map(|&node| mesh.tags[node as usize]).collect();
        let is_held =
            |node: u32| statics.controls.iter().any(|control| control.nodes.contains(&nodes[node as usize]));
        let surface = Taking {
            triangles: &triangles,
            rest: &rest,
            tags: &tags,
            takes: &|node| !is_held(node),
            otherwise: "belongs to a control element",
        };
        Ok((self.on(&surface)?, nodes))
    }

    fn on(&self, surface: &Taking<'_>) -> Result<AppliedLoads, String> {
        let wrong = |number: usize, message: String| format!("{}: {message}", called(number, &self.places));
        let point = |(number, asked): (usize, &PointForce)| {
            surface.point(asked).map_err(|message| wrong(number, message))
        };
        let points = self.forces.iter().enumerate().map(point).collect::<Result<_, _>>()?;
        Ok(AppliedLoads { coefficients: self.coefficients.clone(), points })
    }
}

/// A force of a pose file, for an error.
fn called(number: usize, places: &[String]) -> String {
    places
        .get(number)
        .map_or_else(|| format!("force {}", number + 1), |place| format!("force {} ({place})", number + 1))
}

/// A surface that takes forces, in the mesh's coordinates.
struct Taking<'a> {
    triangles: &'a [[u32; 3]],
    rest: &'a [V3],
    tags: &'a [u64],
    takes: &'a dyn Fn(u32) -> bool,
    /// Error for a place that takes none.
    otherwise: &'static str,
}

impl Taking<'_> {
    fn point(&self, asked: &PointForce) -> Result<PointLoad, String> {
        let (nodes, weights) = match (asked.at, asked.node) {
            (Some(at), _) => {
                let (low, high) = bounding_box(self.rest);
                let reach = FARTHEST * 0.5 * (high - low).norm();
                let rest = |node: u32| self.rest[node as usize];
                let nearest = nearest_point(self.triangles, &rest, &V3::from(at))
                    .ok_or_else(|| "the surface has no area".to_owned())?;
                if nearest.away.is_nan() || nearest.away > reach {
                    let on: V3 = nearest.corners.iter().zip(nearest.weights).map(|(&n, w)| rest(n) * w).sum();
                    let [x, y, z] = <[f64; 3]>::from(on).map(digits);
                    return Err(format!(
                        "at = {at:?} is {} m from the surface, at most {} are taken. The nearest point is [{x}, {y}, {z}]",
                        digits(nearest.away),
                        digits(reach)
                    ));
                }
                (nearest.corners, nearest.weights)
            }
            (None, node) => {
                let tag = node.unwrap_or(0);
                let found = self.tags.iter().position(|known| *known == tag);
                let node = found.ok_or_else(|| format!("the surface has no node with tag {tag}"))?;
                ([node as u32; 3], [1.0, 0.0, 0.0])
            }
        };
        if nodes.iter().zip(&weights).any(|(&node, weight)| *weight > 1e-12 && !(self.takes)(node)) {
            return Err(format!("its place {}", self.otherwise));
        }
        Ok(PointLoad { nodes, weights, pull: Pull::Force(V3::from(asked.force)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_off_the_surface_is_told_with_its_line_and_its_distance() {
        let rest = [V3::zeros(), V3::x(), V3::y()];
        let surface = Taking {
            triangles: &[[0, 1, 2]],
            rest: &rest,
            tags: &[1, 2, 3],
            takes: &|_| true,
            otherwise: "",
        };
        let at = |z: f64| PoseLoads {
            forces: vec![PointForce { at: Some([0.25, 0.25, z]), node: None, force: [1.0, 0.0, 0.0] }],
            places: vec!["poses.toml:4:9".to_owned()],
            ..PoseLoads::default()
        };
        // The body's radius is √½ m.
        assert!(at(0.014).on(&surface).is_ok());
        let told = at(0.125).on(&surface).unwrap_err();
        assert!(
            told.starts_with(
                "force 1 (poses.toml:4:9): at = [0.25, 0.25, 0.125] is 0.1250 m from the surface, at most 0.01414"
            ) && told.contains("is [0.2500, 0.2500, 0]"),
            "{told}"
        );
    }
}
