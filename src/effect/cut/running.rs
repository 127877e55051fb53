//! The effect in a world: blades, and the bodies that they cut, from frame to frame.

use super::blade::{Blade, Sweep};
use super::opened::{Cuttable, Moved, Opened};
use super::settings::NAME;
use crate::base::failure::Failure;
use crate::deform::Contribution;
use crate::effect::entry::EffectInput;
use crate::green::{GreenFile, VOLUME, Volume, resurfaced};
use crate::mesh::split::CutEdges;
use crate::render::{Drawable, Formed};
use crate::world::inertia::Inertia;
use crate::world::running::{Memory, read, written};
use crate::world::{Frame, RunningEffect, World};
use nalgebra::{Isometry3, Point3, Similarity3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

type V3 = Vector3<f64>;

struct Cuts {
    blades: Vec<Blade>,
    bodies: Vec<CutBody>,
    /// Pose of each blade in the last frame.
    last: Vec<Option<Isometry3<f64>>>,
    warnings: Vec<String>,
}

struct CutBody {
    b: usize,
    name: String,
    file: Arc<GreenFile>,
    cuttable: Cuttable,
    edges: Vec<[u32; 2]>,
    cut: CutEdges,
    /// How the cut has changed the columns at all nodes.
    moved: Moved,
    /// Shape in the last frame.
    seen: Option<Seen>,
    /// Copies of nodes in the cut body, and the part by which its equations are missed.
    outcome: Option<(usize, f64)>,
    /// The file that has the new surface, until the world takes it.
    remade: Option<Arc<GreenFile>>,
}

/// From what the places of a body's nodes follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seen {
    #[serde(with = "crate::field::numbers::flat")]
    coefficients: Vec<f64>,
    #[serde(with = "crate::field::numbers")]
    room_from_columns: Similarity3<f64>,
}

/// All that lasts from frame to frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Memorised {
    blades: Vec<Posed>,
    bodies: Vec<BodyMemory>,
}

/// Pose of a blade that was there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
struct Posed(#[serde(with = "crate::field::numbers::option")] Option<Isometry3<f64>>);

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BodyMemory {
    /// Edges that are cut, and where.
    cut: Vec<([u32; 2], f64)>,
    seen: Option<Seen>,
}

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let blades: Vec<Blade> = listed.scene.tool.values().filter_map(Blade::new).collect();
    let mut bodies = Vec::new();
    for &(b, name) in &listed.bodies {
        let file = world.bodies[b].deformer.file().clone();
        let wrong = |message: String| Failure::request(anyhow::anyhow!("body.{name}: {message}"));
        bodies.push(CutBody::new(b, name, file).map_err(wrong)?);
    }
    let last = vec![None; blades.len()];
    Ok(Some(Box::new(Cuts { blades, bodies, last, warnings: Vec::new() })))
}

impl CutBody {
    fn new(b: usize, name: &str, file: Arc<GreenFile>) -> Result<CutBody, String> {
        let meta = file.meta.bodies.get(name).ok_or("the file does not have it")?;
        let names: Vec<&str> = meta.controls.iter().map(|control| control.name.as_str()).collect();
        let volume = Volume::read(&|table| file.table(name, table), names.len())?;
        let lacks = || format!("its file has no numbers of the family {}", VOLUME.name);
        let stiffness = file.stiffness(name).ok_or_else(lacks)?;
        let cuttable = Cuttable::new(volume, &names, V3::from(meta.centre), stiffness)?;
        Ok(CutBody {
            b,
            name: name.to_owned(),
            edges: cuttable.edges(),
            cuttable,
            cut: CutEdges::new(),
            moved: Moved::default(),
            seen: None,
            outcome: None,
            remade: None,
            file: file.clone(),
        })
    }

    /// Places of all nodes in the room.
    fn places(&mut self, seen: &Seen) -> Result<Vec<V3>, String> {
        let at = self.cuttable.places(&self.moved, &seen.coefficients)?;
        Ok(at.into_iter().map(|x| (seen.room_from_columns * Point3::from(x)).coords).collect())
    }

    /// Cuts what blades have passed through since the last frame. The error says why that could not be done; the body is then as it was.
    fn pass(&mut self, sweeps: &[Sweep], now: Seen) -> Result<(), String> {
        let before = self.seen.replace(now.clone()).unwrap_or_else(|| now.clone());
        if sweeps.is_empty() {
            return Ok(());
        }
        let to = self.places(&now)?;
        let from = if before == now { to.clone() } else { self.places(&before)? };
        let mut cut = self.cut.clone();
        for sweep in sweeps {
            for (edge, share) in sweep.crossed(&self.edges, (&from, &to)) {
                if cut.contains_key(&edge) {
                    continue;
                }
                cut.insert(edge, share);
                let around = self.cuttable.splitter.tets_around(edge[0]);
                if around.iter().any(|tet| self.cuttable.splitter.shatters(*tet, &cut)) {
                    cut.remove(&edge);
                }
            }
        }
        if cut == self.cut { Ok(()) } else { self.set(cut) }
    }

    /// Makes the body one with these cuts.
    fn set(&mut self, cut: CutEdges) -> Result<(), String> {
        if cut.is_empty() {
            (self.moved, self.remade) = (Moved::default(), Some(self.file.clone()));
        } else {
            let Opened { surface, moved, error, split } = self.cuttable.open(&cut)?;
            self.outcome = Some((split.copies.len(), error));
            let file =
                resurfaced(self.file.clone(), &self.name, &surface).map_err(|error| error.to_string())?;
            (self.moved, self.remade) = (moved, Some(Arc::new(file)));
        }
        self.cut = cut;
        Ok(())
    }
}

impl RunningEffect for Cuts {
    fn name(&self) -> &'static str {
        NAME
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(
        &mut self,
        world: &World,
        _contributions: &mut [Contribution],
        _inertias: &mut [&mut dyn Inertia],
    ) {
        self.warnings.clear();
        let poses: Vec<_> = self.blades.iter().map(|blade| blade.place.pose(world)).collect();
        let mut sweeps = Vec::new();
        for ((blade, last), now) in self.blades.iter().zip(&self.last).zip(&poses) {
            let Some((last, now)) = last.as_ref().zip(now.as_ref()) else { continue };
            sweeps.push(Sweep { from: blade.edge(last), to: blade.edge(now) });
        }
        self.last = poses;
        for body in &mut self.bodies {
            let placed = &world.bodies[body.b];
            let state = &placed.deformer.state;
            let now = Seen {
                coefficients: state.coefficients.clone(),
                room_from_columns: placed.room_from_body * state.body_from_surface(),
            };
            if let Err(message) = body.pass(&sweeps, now) {
                self.warnings.push(format!("body.{}: {message}", body.name));
            }
        }
    }

    fn remade(&mut self) -> Vec<(usize, Arc<GreenFile>)> {
        self.bodies.iter_mut().filter_map(|body| Some((body.b, body.remade.take()?))).collect()
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        frame.warnings.append(&mut self.warnings);
        for (blade, pose) in self.blades.iter().zip(&self.last) {
            let Some(pose) = pose else { continue };
            blade.place.hide_pen(world, frame);
            let (shape, color) = (blade.drawn.clone(), blade.color);
            let room_from_shape = pose.to_homogeneous().cast();
            frame.drawables.push(Drawable::Formed(Formed { shape, room_from_shape, color }));
        }
    }

    fn summary(&mut self) -> String {
        let of = |body: &CutBody| {
            let (copies, error) = body.outcome?;
            let (name, edges) = (&body.name, body.cut.len());
            Some(format!(
                "{name}: cut across {edges} edges of its mesh, {copies} copies of nodes; its equations hold to a part of {error:.0e}\n"
            ))
        };
        self.bodies.iter().filter_map(of).collect()
    }

    fn memory(&self) -> Option<Memory> {
        let of = |body: &CutBody| BodyMemory {
            cut: body.cut.iter().map(|(edge, share)| (*edge, *share)).collect(),
            seen: body.seen.clone(),
        };
        written(&Memorised {
            blades: self.last.iter().copied().map(Posed).collect(),
            bodies: self.bodies.iter().map(of).collect(),
        })
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let Memorised { blades, bodies } = read(memory)?;
        if (blades.len(), bodies.len()) != (self.blades.len(), self.bodies.len()) {
            return Err("its blades and bodies are those of another scene".to_owned());
        }
        self.last = blades.into_iter().map(|Posed(pose)| pose).collect();
        for (body, memory) in self.bodies.iter_mut().zip(bodies) {
            body.seen = memory.seen;
            let is_edge = |(edge, share): &([u32; 2], f64)| {
                body.edges.binary_search(edge).is_ok() && *share > 0.0 && *share < 1.0
            };
            if !memory.cut.iter().all(is_edge) {
                return Err(format!("body.{}: its cut is that of another body", body.name));
            }
            let cut: CutEdges = memory.cut.into_iter().collect();
            if cut != body.cut {
                body.set(cut)?;
            }
        }
        Ok(())
    }
}
