//! The surface of a deformed body: positions, normals and what is drawn, displacements.

use super::Deformer;
use crate::base::columns::ColumnGroup;
use crate::base::creases::Creases;
use crate::deform::kernel::parts::{PartialSum, move_parts, moved_exactly};
use crate::deform::kernel::superposition::{Superposition, displacement};
use crate::deform::kernel::surface::{SurfaceNormals, vertex_normals};
use crate::green::GreenFile;
use nalgebra::{Point3, Vector3};
use std::borrow::Cow;
use std::sync::Arc;

impl Deformer {
    /// Draws edges sharp from now on if their sides are more than `angle` (rad) apart at rest.
    pub fn keep_sharp(&mut self, angle: f64) {
        self.sharp = Some(angle);
        self.find_creases();
        self.deform();
    }

    /// Finds what is drawn more than once, of the triangles as they are now.
    pub(super) fn find_creases(&mut self) {
        self.creases = self.sharp.and_then(|angle| Creases::new(self.triangles(), self.rest(), angle));
        let drawn = self.positions.len() + self.creases.as_ref().map_or(0, |creases| creases.copies.len());
        self.surface_normals = SurfaceNormals::new(self.drawn_triangles(), drawn);
        self.normals.resize(drawn, [0.0; 3]);
    }

    /// Nodes that are drawn more than once.
    pub fn creases(&self) -> Option<&Creases> {
        self.creases.as_ref()
    }

    /// The triangles as they are drawn: over the nodes, and copies of those on sharp edges.
    pub fn drawn_triangles(&self) -> &[[u32; 3]] {
        self.creases.as_ref().map_or_else(|| self.triangles(), |creases| &creases.triangles)
    }

    /// Something of the nodes, for all vertices that are drawn.
    pub fn drawn<T: Copy>(&self, mut of_nodes: Vec<T>) -> Vec<T> {
        if let Some(creases) = &self.creases {
            creases.extend(&mut of_nodes);
        }
        of_nodes
    }

    /// Positions of all vertices that are drawn, as [`Deformer::positions`] of their nodes.
    pub fn drawn_positions(&self) -> Cow<'_, [[f32; 3]]> {
        match (&self.creases, &self.partial) {
            (None, _) => self.positions(),
            (Some(_), None) => Cow::Borrowed(&self.drawn),
            (Some(_), Some(_)) => Cow::Owned(self.drawn(self.positions().into_owned())),
        }
    }

    /// Limits the CPU's sum to these surface nodes, without normals: the graphics device makes the whole surface from the
    /// coefficients.
    pub fn sum_only_at(&mut self, nodes: Vec<u32>) {
        self.partial = Some(PartialSum::new(nodes, &self.groups(), self.positions.len()));
        for values in [&mut self.u, &mut self.positions, &mut self.normals] {
            values.fill([f32::NAN; 3]);
        }
        self.deform();
    }

    /// The file from which it is made.
    pub fn file(&self) -> &Arc<GreenFile> {
        &self.file
    }

    /// Whether the CPU sums some nodes alone.
    pub fn is_partial(&self) -> bool {
        self.partial.is_some()
    }

    /// Makes the CPU sum the whole surface again, whatever the graphics device does.
    pub fn sum_everywhere(&mut self) {
        if self.partial.take().is_none() {
            return;
        }
        self.sum = Superposition::new(&self.groups(), self.positions.len());
        self.u.fill([0.0; 3]);
        let state = std::mem::replace(&mut self.state, self.summed.clone());
        self.deform();
        self.state = state;
    }

    /// Positions of all surface nodes, about `centre`, before [`Deformer::body_from_surface`]: summed for this call where
    /// the graphics device deforms the surface.
    pub fn positions(&self) -> Cow<'_, [[f32; 3]]> {
        if self.partial.is_none() {
            return Cow::Borrowed(&self.positions);
        }
        let mut positions = vec![[0.0; 3]; self.positions.len()];
        let groups = self.groups();
        let mut sum = Superposition::new(&groups, positions.len());
        sum.update(&groups, &self.summed.coefficients, &mut positions);
        for (position, rest) in positions.as_flattened_mut().iter_mut().zip(self.rest().as_flattened()) {
            *position += rest;
        }
        if let Some(weights) = &self.weights {
            move_parts(weights, &self.summed.parts, &mut positions);
        }
        Cow::Owned(positions)
    }

    /// The positions as they are, without work: NaN but for the nodes of [`Deformer::sum_only_at`] where that was called.
    pub fn kept_positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Unit normals of all vertices that are drawn, in the frame of the positions, made as these are.
    pub fn normals(&self) -> Cow<'_, [[f32; 3]]> {
        if self.partial.is_none() {
            return Cow::Borrowed(&self.normals);
        }
        let mut normals = vec![[0.0; 3]; self.normals.len()];
        vertex_normals(&self.drawn_positions(), self.drawn_triangles(), &mut Vec::new(), &mut normals);
        Cow::Owned(normals)
    }

    /// u of surface node `i`: the sum of its columns and of what forces at points do, in the surface's frame, m.
    pub fn linear_part(&self, i: usize) -> Vector3<f64> {
        match &self.partial {
            None => Vector3::from(self.u[i]).cast::<f64>(),
            Some(_) => displacement(&self.groups(), self.u.len(), i, &self.summed.coefficients),
        }
    }

    /// Displacement of a surface node by a coefficient of 1 of each column, in the order of the state's coefficients.
    pub fn columns_of(&self, node: u32) -> Vec<Vector3<f64>> {
        let (groups, nodes) = (self.groups(), self.u.len());
        let columns =
            groups.iter().flat_map(|group| (0..group.columns(nodes).unwrap_or(0)).map(move |k| (group, k)));
        let value = |(group, k): (&ColumnGroup<'_>, usize)| {
            Vector3::from_fn(|axis, _| f64::from(group.value(nodes, k, 3 * node as usize + axis)))
        };
        columns.map(value).collect()
    }

    /// Places in the body's frame of surface nodes in the state that was taken last, whether or not the surface was summed for it;
    /// f64, m.
    pub fn places_in_state(&self, nodes: impl Iterator<Item = u32>) -> Vec<Vector3<f64>> {
        let groups = self.groups();
        nodes.map(|node| self.place_by(&groups, node as usize, &self.state.coefficients)).collect()
    }

    /// Displacements of all surface nodes in that state by the model alone, without what the columns of effects add; body's frame, f64, m.
    pub fn displacements_of_model(&self) -> Vec<Vector3<f64>> {
        let (groups, mut coefficients) = (self.groups(), self.state.coefficients.clone());
        let of_model = coefficients.len() - self.contribution.coefficients.len();
        coefficients[of_model..].fill(0.0);
        let rest = self.rest().iter().map(|x| Vector3::from(*x).cast::<f64>());
        rest.enumerate().map(|(i, rest)| self.place_by(&groups, i, &coefficients) - rest).collect()
    }

    fn place_by(&self, groups: &[ColumnGroup<'_>], i: usize, coefficients: &[f64]) -> Vector3<f64> {
        let mut place = Vector3::from(self.rest()[i]).cast::<f64>();
        place += displacement(groups, self.u.len(), i, coefficients);
        if let Some(field) = self.model.field() {
            place += Vector3::from(field[i]).cast::<f64>();
        }
        match &self.weights {
            Some(weights) => moved_exactly(weights.at(i), &self.state.parts, place),
            None => (self.state.body_from_surface() * Point3::from(place)).coords,
        }
    }

    /// u of surface node `i` but for a rigid motion of the whole body: all that strains it, m.
    pub fn straining_part(&self, i: usize) -> Vector3<f64> {
        match &self.weights {
            None => self.linear_part(i),
            Some(_) => self.displacement(i),
        }
    }

    /// Whole displacement of surface node `i` from where it was at rest, in the body's frame, f64.
    pub fn displacement(&self, i: usize) -> Vector3<f64> {
        let rest = Vector3::from(self.rest()[i]).cast::<f64>();
        let u = self.linear_part(i);
        if let Some(weights) = &self.weights {
            return moved_exactly(weights.at(i), &self.summed.parts, rest + u) - rest;
        }
        let motion = self.body_from_surface();
        // R (X + u) + t - X, written so that a small u keeps its digits beside a large X.
        let turned = motion.rotation * rest - rest;
        turned + motion.rotation * u + motion.translation.vector
    }
}
