//! Loads on a body whose points are x = m (c̄ + Σ z_k h_k), as forces on z, on the frame m and on c̄, the translation that all control
//! elements have in common against it.
//!
//! In: the table of the loads' work of the family `reduced`, what is applied, m = (R, t) and c̄. Out, with D_k = Σ f ⊗ h_k over all
//! forces f along the body's axes,
//!
//! ```text
//! W = Σ f · (x - X) = N·(t + R c̄ - ō) + Σ_k z_k g_k - tr D_0    N = Σ f    g_k = D_k : R
//! ∂W by m exp η: (Rᵀ N, c̄ × Rᵀ N + Σ_k z_k axial(Rᵀ D_k))         ∂W/∂c̄ = Rᵀ N
//! ```
//!
//! Warmth e makes the stress-free body s = 1 + e times as large: s³ V(F/s) = (V - ε zᵀ T z + ½ ε² T_00)/s with ε = (s² - 1)/2, which
//! is exact for St. Venant–Kirchhoff's law. Without a T the body's energy knows s itself.
//!
//! What acts now ([`Acting`]) are sums over tables with a column of vectors for each of the loads' columns. While a pose is settled
//! all forces keep their directions: those that follow the body are turned beforehand.

use super::applied::{AppliedLoads, PointLoad, Pull, SharedLoads};
use crate::deform::model::{ColumnsAt, LoadInput, ModelInput};
use crate::deform::pose::frame::axial;
use crate::green::{Lift, LoadMeta, REDUCED_LOADS, Turning, WARMTH};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Rotation3, Vector3, Vector6};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Contribution of the loads to V, which becomes (V - ε zᵀ T z)/s - g·z.
pub struct LoadedPotential {
    /// s.
    pub size: f64,
    /// 1/s and ε, where there is a T.
    share: f64,
    strain: f64,
    /// T without T_00, where there is warmth; T z.
    warmth: DMatrix<f64>,
    product: DVector<f64>,
    /// g; that of z_0 is 0.
    pub forces: Vec<f64>,
}

pub struct FrameForces {
    acting: Acting,
    table: DMatrix<f64>,
    surface: ColumnsAt,
    lift: Lift,
    fields: usize,
    centre: V3,
    /// h at nodes that forces are applied to.
    touched: BTreeMap<u32, Vec<V3>>,
    /// N, and D_0, D_1, … column by column: of forces that keep their directions, of those that follow, and of all.
    pub fixed: Vec<V3>,
    follows: Vec<V3>,
    all: Vec<V3>,
    /// g_0, and ½ ε² T_00/s.
    first: f64,
    stored: f64,
    whole: f64,
    pub burden: LoadedPotential,
    pub is_none: bool,
}

impl FrameForces {
    /// Forces on a body with `fields` fields Φ; `None` where nothing may act on it.
    pub fn from_input(input: &ModelInput<'_>, fields: usize) -> Result<Option<FrameForces>, String> {
        let Some(loads) = input.loads else { return Ok(None) };
        let (acting, lift) = (Acting::new(&loads), Lift::new(input.controls.len()));
        let n = 1 + lift.len() + fields;
        let (slots, columns) = (1 + 3 * n, acting.columns());
        let table = match (input.table)(REDUCED_LOADS) {
            Some(table) if table.shape() == (3 * slots, columns) => table,
            _ if columns == 0 => DMatrix::zeros(3 * slots, 0),
            _ => return Err(format!("the table {REDUCED_LOADS} of the loads cannot be used")),
        };
        let mut warmth = match (input.table)(WARMTH) {
            Some(table) if table.shape() == (n, n) => table,
            None => DMatrix::zeros(0, 0),
            Some(_) => return Err(format!("the table {WARMTH} cannot be used")),
        };
        let whole = warmth.get_mut((0, 0)).map_or(0.0, std::mem::take);
        let origins: V3 = input.controls.iter().map(|control| control.origin).sum();
        Ok(Some(FrameForces {
            acting,
            table,
            surface: loads.surface.clone(),
            lift,
            fields,
            centre: origins / input.controls.len().max(1) as f64,
            touched: BTreeMap::new(),
            fixed: vec![V3::zeros(); slots],
            follows: vec![V3::zeros(); slots],
            all: vec![V3::zeros(); slots],
            first: 0.0,
            stored: 0.0,
            whole,
            burden: LoadedPotential {
                size: 1.0,
                share: 1.0,
                strain: 0.0,
                product: DVector::zeros(warmth.nrows()),
                warmth,
                forces: vec![0.0; n],
            },
            is_none: true,
        }))
    }

    /// Reads what is applied; whether it has changed.
    pub fn read(&mut self) -> bool {
        let has_changed = self.acting.read();
        if has_changed {
            self.gather();
        }
        has_changed
    }

    pub fn applied(&self) -> &AppliedLoads {
        &self.acting.applied
    }

    /// Goes on from what was applied.
    pub fn set_applied(&mut self, applied: &AppliedLoads) {
        self.acting.applied.clone_from(applied);
        self.gather();
    }

    /// ∂/∂z of e ∫ (3λ + 2μ) tr ε: what warmth pushes with at rest.
    pub fn push_of_warmth(&self, k: usize) -> f64 {
        self.burden.warmth.get((0, k)).map_or(0.0, |push| 2.0 * push * self.acting.strain())
    }

    fn gather(&mut self) {
        self.is_none = self.acting.is_none();
        self.fixed.fill(V3::zeros());
        self.follows.fill(V3::zeros());
        self.acting.add(&self.table, Turning::Fixed, &mut self.fixed);
        self.acting.add(&self.table, Turning::Follows, &mut self.follows);
        let FrameForces { acting, touched, surface, lift, fields, centre, fixed, .. } = self;
        touched.retain(|node, _| acting.applied.points.iter().any(|point| point.nodes.contains(node)));
        for (point, force) in acting.points() {
            for (node, w) in point.nodes.iter().zip(point.weights).filter(|(_, w)| *w != 0.0) {
                let h =
                    touched.entry(*node).or_insert_with(|| place_in_z(surface, *node, lift, *fields, centre));
                fixed[0] += force * w;
                for (slots, h) in fixed[1..].chunks_exact_mut(3).zip(h.iter()) {
                    slots.iter_mut().zip(h.iter()).for_each(|(slot, h)| *slot += force * (w * h));
                }
            }
        }
        let strain = acting.strain();
        self.burden.size = 1.0 + strain;
        let strain = if self.burden.warmth.is_empty() { 0.0 } else { strain };
        self.burden.share = if strain == 0.0 { 1.0 } else { self.burden.size.recip() };
        self.burden.strain = 0.5 * strain * (2.0 + strain);
        self.stored = 0.5 * self.burden.strain.powi(2) * self.whole * self.burden.share;
    }

    /// Finds g in the frame m, with the mean turn of the control elements, by which loads that follow the body turn.
    pub fn find(&mut self, m: &Isometry3<f64>, mean: &Rotation3<f64>) {
        let rotation = m.rotation.to_rotation_matrix();
        for ((all, fixed), follows) in self.all.iter_mut().zip(&self.fixed).zip(&self.follows) {
            *all = fixed + mean * follows;
        }
        for (k, force) in self.burden.forces.iter_mut().enumerate() {
            *force = columns(&self.all, k).dot(rotation.matrix());
        }
        self.first = std::mem::take(&mut self.burden.forces[0]);
    }

    /// Potential of the loads beside that of [`LoadedPotential`]: -N·(t + R c̄ - ō) - g_0 + tr D_0, and the energy that warmth stores.
    pub fn beside(&self, m: &Isometry3<f64>, common: &V3) -> f64 {
        let shift = m.translation.vector + m.rotation * common - self.centre;
        self.stored - self.all[0].dot(&shift) - self.first + columns(&self.all, 0).trace()
    }

    /// ∂W by a motion of m in its own axes, z and c̄ being held.
    pub fn by_frame(&self, m: &Isometry3<f64>, common: &V3, z: &[f64]) -> Vector6<f64> {
        let moments = z.iter().enumerate().map(|(k, z)| columns(&self.all, k) * *z).sum();
        let torque = common.cross(&self.by_common(m));
        joined(m, &self.all[0], &moments) + Vector6::new(0.0, 0.0, 0.0, torque.x, torque.y, torque.z)
    }

    /// ∂W/∂c̄, in the axes of m.
    pub fn by_common(&self, m: &Isometry3<f64>) -> V3 {
        m.rotation.inverse() * self.all[0]
    }

    /// Derivative of Σ p_k g_k over the fields Φ by a motion of m in its own axes: forces that keep their directions turn against
    /// m. Those that follow the body turn against it by the little by which m is not the mean turn, which is left out.
    pub fn by_turn(&self, m: &Isometry3<f64>, q: &[f64]) -> Vector6<f64> {
        let start = 1 + self.lift.rigid;
        let moments = q.iter().enumerate().map(|(k, p)| columns(&self.fixed, start + k) * *p).sum();
        joined(m, &V3::zeros(), &moments)
    }
}

fn joined(m: &Isometry3<f64>, force: &V3, moments: &Matrix3<f64>) -> Vector6<f64> {
    let inverse = m.rotation.inverse().to_rotation_matrix();
    let (force, torque) = (inverse * force, axial(&(inverse.matrix() * moments)));
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

/// D_k.
fn columns(slots: &[V3], k: usize) -> Matrix3<f64> {
    Matrix3::from_columns(&slots[1 + 3 * k..4 + 3 * k])
}

/// h at a node of the surface, in the order of z: X - ō, the y of undeformed elements, Φ, the other y.
fn place_in_z(surface: &ColumnsAt, node: u32, lift: &Lift, fields: usize, centre: &V3) -> Vec<V3> {
    let (place, columns) = surface(node);
    let (affine, rest) = columns.split_at(lift.columns.nrows().min(columns.len()));
    let lifted = |k: usize| affine.iter().zip(lift.columns.column(k).iter()).map(|(u, l)| u * *l).sum::<V3>();
    let bent = (0..fields).map(|k| rest.get(k).copied().unwrap_or_default());
    std::iter::once(place - centre)
        .chain((0..lift.rigid).map(lifted))
        .chain(bent)
        .chain((lift.rigid..lift.len()).map(lifted))
        .collect()
}

impl LoadedPotential {
    /// V and its slopes against the first of z become those with loads; how large the numbers are that make it up.
    pub fn add(&mut self, value: f64, z: &[f64], slopes: &mut [f64]) -> (f64, f64) {
        let mut total = self.share * value;
        if self.strain != 0.0 {
            self.multiply(z, 0..slopes.len());
            let product = &self.product.as_slice()[..slopes.len()];
            let square: f64 = product.iter().zip(z).map(|(t, z)| t * z).sum();
            total -= self.share * self.strain * square;
        }
        self.turn(0, slopes);
        let work: f64 = self.forces.iter().zip(z).take(slopes.len()).map(|(g, z)| g * z).sum();
        (total - work, self.share * value.abs() + work.abs())
    }

    /// Adds the loads to the slopes behind the first `active`.
    pub fn add_beyond(&mut self, z: &[f64], active: usize, slopes: &mut [f64]) {
        if self.strain != 0.0 {
            self.multiply(z, active..z.len());
        }
        self.turn(active, slopes);
    }

    /// Adds the loads to the second derivatives against the first `active`, row by row.
    pub fn add_second(&self, active: usize, second: &mut [f64]) {
        for (i, row) in second.chunks_exact_mut(active).take(active).enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                let warmth = if self.strain == 0.0 { 0.0 } else { 2.0 * self.strain * self.warmth[(i, j)] };
                *value = self.share * (*value - warmth);
            }
        }
    }

    /// T z in some rows.
    fn multiply(&mut self, z: &[f64], rows: std::ops::Range<usize>) {
        for k in rows {
            self.product[k] = self.warmth.column(k).iter().zip(z).map(|(t, z)| t * z).sum();
        }
    }

    fn turn(&self, first: usize, slopes: &mut [f64]) {
        for (k, slope) in (first..).zip(slopes) {
            let warmth = if self.strain == 0.0 { 0.0 } else { 2.0 * self.strain * self.product[k] };
            *slope = self.share * (*slope - warmth) - self.forces[k];
        }
    }
}

pub struct Acting {
    shared: SharedLoads,
    metas: Vec<LoadMeta>,
    /// The loads as they were read last.
    pub applied: AppliedLoads,
}

impl Acting {
    pub fn new(input: &LoadInput<'_>) -> Acting {
        let (shared, metas) = (input.shared.clone(), input.metas.to_vec());
        Acting { shared, metas, applied: AppliedLoads::default() }
    }

    /// Reads what is applied now, or keeps that of the last time where a frame is just setting it; whether it has changed.
    pub fn read(&mut self) -> bool {
        let Ok(shared) = self.shared.try_lock() else { return false };
        let has_changed = *shared != self.applied;
        if has_changed {
            self.applied.clone_from(&shared);
        }
        has_changed
    }

    /// Whether nothing acts.
    pub fn is_none(&self) -> bool {
        self.applied.points.is_empty() && self.applied.coefficients.iter().all(|c| *c == 0.0)
    }

    /// Number of columns of the loads.
    pub fn columns(&self) -> usize {
        self.metas.iter().map(|meta| meta.columns).sum()
    }

    /// Thermal strain: the relative elongation of the body where it is free.
    pub fn strain(&self) -> f64 {
        let inner = self.turnings().zip(&self.applied.coefficients);
        inner.filter(|(turning, _)| *turning == Turning::Inner).map(|(_, strain)| strain).sum()
    }

    /// Adds the columns of a table of vectors for the loads that turn like this.
    pub fn add(&self, table: &DMatrix<f64>, like: Turning, sums: &mut [V3]) {
        let all = self.turnings().zip(&self.applied.coefficients).zip(table.column_iter());
        for ((turning, c), column) in all {
            if turning == like && *c != 0.0 {
                for (sum, own) in sums.iter_mut().zip(column.as_slice().chunks_exact(3)) {
                    *sum += V3::from_column_slice(own) * *c;
                }
            }
        }
    }

    /// The points that forces are applied to, and these, N, along the body's axes.
    pub fn points(&self) -> impl Iterator<Item = (&PointLoad, V3)> {
        self.applied.points.iter().filter_map(|point| match point.pull {
            Pull::Force(force) => Some((point, force)),
            // A model without a compliance takes no springs.
            Pull::Towards { .. } => None,
        })
    }

    fn turnings(&self) -> impl Iterator<Item = Turning> {
        self.metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns))
    }
}
