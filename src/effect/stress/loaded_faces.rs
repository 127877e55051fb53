//! Tractions of loads on the triangles of a body's surface: a load's traction is stress there that no strain shows.
//!
//! In: the patterns of a scene's body, on its mesh. Out: the traction of each of their columns at every triangle, Pa for a
//! coefficient of 1, kept in the section of the .green file; and their sum for the coefficients of a moment.

use crate::deform::FaceLoads;
use crate::green::{GreenError, GreenFile, LoadMeta, Tensor, Tractions, Turning};
use crate::mesh::{Surface, TetMesh};
use crate::scene::{LoadSource, Scene};
use nalgebra::Vector3;

/// Tensor of the numbers of these columns among the body's load columns, …
const COLUMNS: &str = "load";
/// … and their tractions, column by column.
const TRACTIONS: &str = "traction";

/// The tractions of all patterns of a body.
#[derive(Debug, Default)]
pub struct LoadedFaces(Vec<Column>);

#[derive(Debug)]
struct Column {
    /// Number among the body's load columns.
    number: usize,
    /// Whether it turns with the body.
    follows: bool,
    of_triangles: Vec<Vector3<f64>>,
}

impl LoadedFaces {
    pub fn of_mesh(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<LoadedFaces, GreenError> {
        let mut columns = Vec::new();
        let mut number = 0;
        let mut surface = None;
        for load in scene.body[name].loads() {
            let first = number;
            number += load.source.columns();
            let LoadSource::Pattern(pattern) = load.source else { continue };
            let tractions = Tractions::of(scene, mesh, pattern)
                .map_err(|message| scene.invalid(&format!("body.{name}.load.{}", load.name), message))?;
            let surface = surface.get_or_insert_with(|| Surface::of(mesh));
            let follows = LoadMeta::of(&load).turning == Turning::Follows;
            let of_columns = tractions.at_triangles(mesh, surface).into_iter().enumerate();
            columns.extend(of_columns.map(|(k, of_triangles)| Column {
                number: first + k,
                follows,
                of_triangles,
            }));
        }
        Ok(LoadedFaces(columns))
    }

    /// Tensors for the section of the file; none without patterns.
    pub fn tensors(&self) -> Vec<(String, Tensor)> {
        let Some(first) = self.0.first() else { return Vec::new() };
        let numbers: Vec<u32> = self.0.iter().map(|column| column.number as u32).collect();
        let shape = [numbers.len(), first.of_triangles.len(), 3];
        let values = self.0.iter().flat_map(|column| column.of_triangles.iter().flat_map(|t| t.iter()));
        let values: Vec<f32> = values.map(|value| *value as f32).collect();
        vec![
            (COLUMNS.into(), Tensor::new(&[numbers.len()], numbers)),
            (TRACTIONS.into(), Tensor::new(&shape, values)),
        ]
    }

    /// Reads the section of this name in a file of this scene. The error names a tensor that does not suit the body.
    pub fn of_file(
        scene: &Scene,
        file: &GreenFile,
        name: &str,
        section: &str,
    ) -> Result<LoadedFaces, GreenError> {
        let has_patterns =
            scene.body[name].loads().iter().any(|load| matches!(load.source, LoadSource::Pattern(_)));
        if !has_patterns {
            return Ok(LoadedFaces::default());
        }
        let (_, numbers) = file.section::<u32>(name, section, COLUMNS)?;
        let (_, values) = file.section::<f32>(name, section, TRACTIONS)?;
        let metas = file.meta.bodies.get(name).map_or(&[][..], |meta| &meta.loads);
        let turnings: Vec<Turning> =
            metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns)).collect();
        let triangles = file.triangles(name).len();
        let fits = values.len() == 3 * triangles * numbers.len()
            && numbers.iter().all(|&number| (number as usize) < turnings.len())
            && values.iter().all(|value| value.is_finite());
        if !fits || triangles == 0 {
            let reason =
                format!("tensor {name}/{section}/{TRACTIONS} does not hold tractions of the body's loads");
            return Err(GreenError::Damaged { path: file.path.clone(), reason });
        }
        let vector = |value: &[f32]| Vector3::new(value[0], value[1], value[2]).cast::<f64>();
        let column = |(&number, values): (&u32, &[f32])| Column {
            number: number as usize,
            follows: turnings[number as usize] == Turning::Follows,
            of_triangles: values.chunks_exact(3).map(vector).collect(),
        };
        Ok(LoadedFaces(numbers.iter().zip(values.chunks_exact(3 * triangles)).map(column).collect()))
    }

    /// The tractions for the coefficients of all load columns of the body.
    pub fn at(&self, coefficients: &[f64]) -> FaceLoads {
        let mut loads = FaceLoads::default();
        for column in &self.0 {
            let coefficient = coefficients.get(column.number).copied().unwrap_or(0.0);
            if coefficient == 0.0 {
                continue;
            }
            let sum = if column.follows { &mut loads.follows } else { &mut loads.fixed };
            sum.resize(column.of_triangles.len(), Vector3::zeros());
            sum.iter_mut().zip(&column.of_triangles).for_each(|(sum, t)| *sum += t * coefficient);
        }
        loads
    }
}
