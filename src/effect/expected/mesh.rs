//! Measures what the mesh itself adds to the errors of a body, by a better solution of the same linear body.
//!
//! In: a body of a scene and its solution. Out: [`MeshErrors`] of the small rigid motions of one control element, all others
//! resting: the worst motion, and the stiffness of each motion. With K the 6 × 6 stiffness against these motions and K' that of
//! the better solution, K x = λ K' x: λ - 1 is the relative difference of every component of the wrench of the motion x, whatever
//! the unit of length. Linear elements are compared with quadratic ones on the same mesh, of which they are a part, and which do
//! not lock; a refined mesh of linear elements would not show locking (in a beam at ν = 0.4999 3 % of an error of 60 %). Where these
//! quadratic ones are few, they too are cut to half the size (of that beam's error of 65 %, 64 % are told so, and 60 % uncut).
//! Quadratic ones are compared with themselves in tetrahedra of half the size, and their error is taken to be of the order 1.5 in
//! it, because stresses are singular at the edges of held parts. The resting body under the loads of the scene is compared too,
//! and the larger of the differences is reported.

use crate::base::extent::bounding_box;
use crate::deform::pose_file::PoseLoads;
use crate::deform::{MeshErrors, Moved, RigidStiffness, wrench_size};
use crate::fem::TET10;
use crate::green::{
    self, ControlElement, FIELDS, GreenError, LOAD_FIELDS, LOADS, Prepared, REACTION, Requirements,
    STIFFNESS, Solution,
};
use crate::mesh::TetMesh;
use crate::mesh::quadratic::{Curve, quadratic, straight};
use crate::mesh::refine::refine;
use crate::scene::{Generate, Scene};
use crate::solve::Progress;
use nalgebra::{DMatrix, DVector, Matrix3x2, Matrix6, Vector3, Vector6};

/// A better solution of a body, with its control elements on the same parts of it.
pub struct BetterBody {
    solution: Solution,
    /// The quadratic solution on the body's own mesh where this is in tetrahedra of half the size, and the body is not quadratic.
    uncut: Option<Solution>,
    /// The coefficient of each column of the body's loads.
    loads: Vec<f64>,
}

/// Shows each step of the solution, which takes longer than that of the body, as one of the better mesh.
struct Better<'a>(&'a dyn Progress);

impl Progress for Better<'_> {
    fn begin(&self, step: &str, units: u64) {
        self.0.begin(&format!("better mesh: {step}"), units);
    }

    fn advance(&self, units: u64) {
        self.0.advance(units);
    }

    fn end(&self) {
        self.0.end();
    }

    fn tell(&self, sentence: &str) {
        self.0.tell(sentence);
    }
}

impl BetterBody {
    /// Errors where it cannot be solved.
    pub fn new(scene: &Scene, name: &str, progress: &dyn Progress) -> Result<BetterBody, GreenError> {
        let is_quadratic = scene.body[name].element.order > 1;
        let cuts = is_quadratic || green::prepare(scene, name)?.mesh.tets.len() <= MOST_CUT;
        let solution = quadratic_solution(scene, name, cuts, progress)?;
        let uncut = match cuts && !is_quadratic {
            true => Some(quadratic_solution(scene, name, false, progress)?),
            false => None,
        };
        let loads = PoseLoads::of_scene(&scene.body[name]).coefficients;
        Ok(BetterBody { solution, uncut, loads })
    }

    /// The errors of quadratic elements on the body's own mesh for control element `e`, by those in tetrahedra of half the size; `None`
    /// where these were not solved.
    pub fn of_quadratic(&self, e: usize) -> Option<MeshErrors> {
        self.share(self.uncut.as_ref()?, e)
    }

    /// The errors that the mesh of `solution` adds to control element `e`; `None` where its rigid motions meet no resistance, or
    /// where the two solutions are too far apart for an estimate.
    pub fn share(&self, solution: &Solution, e: usize) -> Option<MeshErrors> {
        let about = solution.controls[e].origin;
        let [k, better] = [solution, &self.solution].map(|solution| rigid_stiffness(solution, e, &about));
        let (k, better) = (k?, better?);
        let wrench = largest_ratio(k - better, better)?;
        let stiffness = Some(RigidStiffness::new(&k, &limit(solution, &k, &better)));
        let nodes = same_nodes(&solution.mesh, &self.solution.mesh, &solution.surface.nodes);
        let [u, better] =
            [solution, &self.solution].map(|solution| rigid_fields(solution, e, &about, &nodes));
        let square = |u: &DMatrix<f64>| Matrix6::from_iterator((u.transpose() * u).iter().copied());
        let shape = largest_ratio(square(&(&u - &better)), square(&better))?.sqrt();
        let [of_load, shape_of_load] = self.loads_apart(solution, e, &nodes).unwrap_or_default();
        let (wrench, shape) = (wrench.max(of_load), shape.max(shape_of_load));
        let loads = self.of_loads(solution, e);
        Some(MeshErrors {
            wrench: error(solution, wrench)?,
            shape: error(solution, shape)?,
            stiffness,
            loads,
        })
    }

    /// The error of the wrench on control element `e` for a unit of each of the scene's loads, in N, while all elements rest;
    /// empty for a body without loads, and for an element that stands in the middle of the others, which has no length.
    fn of_loads(&self, solution: &Solution, e: usize) -> Vec<f64> {
        let origins: Vec<Vector3<f64>> = solution.controls.iter().map(|control| control.origin).collect();
        let wrenches = |of: &Solution| {
            let reaction = of.tables.get(REACTION)?;
            Some(
                rigid(&of.controls[e], &solution.controls[e].origin).transpose()
                    * reaction.rows(FIELDS * e, FIELDS),
            )
        };
        let both = wrenches(solution).zip(wrenches(&self.solution));
        let Some(((own, better), moved)) = both.zip(Moved::new(&origins, e)) else { return Vec::new() };
        let rest = if is_cut(solution) { 1.0 + 1.0 / (ORDER.exp2() - 1.0) } else { 1.0 };
        let of = |w: DVector<f64>| wrench_size(&Vector6::from_column_slice(w.as_slice()), moved.length);
        let apart = |k: usize| {
            let (apart, whole) = (of(own.column(k) - better.column(k)), of(better.column(k).into_owned()));
            if apart > NOISE * whole { rest * apart } else { 0.0 }
        };
        (0..own.ncols()).map(apart).collect()
    }

    /// The relative error of the force with which control element `e` is pushed along each axis while it is free in all else:
    /// 1/(K⁻¹)ₖₖ.
    pub fn pushed(&self, solution: &Solution, e: usize) -> Option<[f64; 3]> {
        let about = solution.controls[e].origin;
        let [yields, better] =
            [solution, &self.solution].map(|solution| rigid_stiffness(solution, e, &about)?.try_inverse());
        let (yields, better) = (yields?, better?);
        let mut of_axes = [0.0; 3];
        for (k, of_axis) in of_axes.iter_mut().enumerate() {
            let difference = (better[(k, k)] / yields[(k, k)] - 1.0).abs();
            *of_axis = error(solution, Some(difference).filter(|x| x.is_finite())?)?;
        }
        Some(of_axes)
    }

    /// The relative differences of the two solutions under the scene's loads while all control elements rest: in the wrench on
    /// control element `e`, weighed by what it would move, and in the shape. `None` without loads.
    fn loads_apart(&self, solution: &Solution, e: usize, nodes: &[usize]) -> Option<[f64; 2]> {
        let about = solution.controls[e].origin;
        let lambda = DVector::from_column_slice(&self.loads);
        let both = [solution, &self.solution]
            .map(|of| Some((of.tables.get(REACTION)?, of.tables.get(LOAD_FIELDS)?)));
        let [(reaction, fields), (better_reaction, better_fields)] = [both[0]?, both[1]?];
        if [reaction, better_reaction].iter().any(|table| table.ncols() != lambda.len()) {
            return None;
        }
        let wrench = |of: &Solution, reaction: &DMatrix<f64>| {
            let own = reaction.rows(FIELDS * e, FIELDS) * &lambda;
            rigid(&of.controls[e], &about).transpose() * own
        };
        let (w, better) = (wrench(solution, reaction), wrench(&self.solution, better_reaction));
        let k = rigid_stiffness(&self.solution, e, &about)?.try_inverse()?;
        let size = |w: &DVector<f64>| w.dot(&(k * w)).max(0.0).sqrt();
        let of_wrench = size(&(&w - &better)) / size(&better);
        let shape = |fields: &DMatrix<f64>| {
            let row = |row: usize| (fields.row(3 * nodes[row / 3] + row % 3) * &lambda)[0];
            DVector::from_fn(3 * nodes.len(), |i, _| row(i))
        };
        let (u, better) = (shape(fields), shape(better_fields));
        let of_shape = (&u - &better).norm() / better.norm();
        Some([of_wrench, of_shape].map(|part| if part.is_finite() { part } else { 0.0 }))
    }
}

/// The body with quadratic elements, in its own tetrahedra, or in eight for each where it `cuts` them.
fn quadratic_solution(
    scene: &Scene,
    name: &str,
    cuts: bool,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    let mut scene = scene.clone();
    let is_quadratic = scene.body[name].element.order > 1;
    let Prepared { mut mesh, controls, mut lame, .. } = green::prepare(&scene, name)?;
    // A group of nodes tells which of the new nodes it holds.
    let held = |e: usize| format!("held by control element {e}");
    for (e, control) in controls.iter().enumerate() {
        mesh.groups.insert(held(e), control.nodes.clone());
    }
    let body = &mut scene.body[name];
    body.element = &TET10;
    let on_tube;
    let curve: Curve<'_> = match &scene.body[name].generate {
        Some(Generate::Tube(tube)) => {
            on_tube = |a: &_, b: &_| tube.curve(a, b);
            &on_tube
        }
        _ => &straight,
    };
    let mesh = if cuts {
        lame = lame.iter().flat_map(|lame| [*lame; 8]).collect();
        let cut = refine(mesh, 1, curve);
        cut.map_err(|error| scene.invalid(&format!("body.{name}.refine"), error.to_string()))?
    } else {
        mesh
    };
    let mesh = if is_quadratic { mesh } else { quadratic(mesh, curve) };
    let (low, high) = bounding_box(&mesh.nodes);
    let control = |(e, control): (usize, &ControlElement)| {
        let nodes = mesh.groups.get(&held(e)).cloned().unwrap_or_default();
        ControlElement::new(&control.name, nodes, &mesh, (high - low).norm())
    };
    let controls = controls.iter().enumerate().map(control).collect();
    let prepared = Prepared { mesh, controls, lame, findings: Vec::new() };
    let loads = PoseLoads::of_scene(&scene.body[name]).coefficients;
    let families = if loads.is_empty() { vec![STIFFNESS] } else { vec![STIFFNESS, LOADS] };
    let required = Requirements::new(&families);
    green::solve_prepared(&scene, name, prepared, &required, &Better(progress))
}

/// Whether a better solution differs from this one in the size of its tetrahedra alone, so that its own error follows from the difference.
fn is_cut(own: &Solution) -> bool {
    !own.mesh.mids.is_empty()
}

/// K' without the error that is left when a cut takes away 1 - 2^-1.5 of it.
fn limit(own: &Solution, k: &Matrix6<f64>, better: &Matrix6<f64>) -> Matrix6<f64> {
    match is_cut(own) {
        false => *better,
        true => better - (k - better) / (ORDER.exp2() - 1.0),
    }
}

/// The error of a motion for which K = (1 + d) K', with d the `difference`.
fn error(own: &Solution, difference: f64) -> Option<f64> {
    let beyond = difference / (ORDER.exp2() - 1.0);
    match is_cut(own) {
        false => Some(difference),
        true => (difference < MOST).then(|| (difference + beyond) / (1.0 - beyond)),
    }
}

/// Linear tetrahedra that are compared with quadratic ones of half the size, at most: `precompute` of 1,950 took 0.6 GB, of 7,350 3 GB.
const MOST_CUT: usize = 2000;
/// The order in which the error of quadratic elements falls with their size.
const ORDER: f64 = 1.5;
/// A smaller part of a load's wrench is rounding.
const NOISE: f64 = 1e-9;
/// Largest relative change of a body by a cut that still allows an estimate of the limit.
const MOST: f64 = 1.0;

/// The 12 × 6 matrix of the coefficients of control element `e` for the small rigid motions about a point: shifts, then turns.
fn rigid(control: &ControlElement, about: &Vector3<f64>) -> DMatrix<f64> {
    let mut r = DMatrix::zeros(FIELDS, 6);
    for axis in 0..3 {
        r[(axis, axis)] = 1.0;
        let turn = Vector3::ith(axis, 1.0).cross_matrix();
        let shift = turn * (control.origin - about);
        for i in 0..3 {
            r[(i, 3 + axis)] = shift[i];
            for j in 0..3 {
                r[(3 + 3 * i + j, 3 + axis)] = turn[(i, j)];
            }
        }
    }
    r
}

/// K, of the handle stiffness S.
fn rigid_stiffness(solution: &Solution, e: usize, about: &Vector3<f64>) -> Option<Matrix6<f64>> {
    let s = solution.stiffness()?;
    let r = rigid(&solution.controls[e], about);
    let own = s.view((FIELDS * e, FIELDS * e), (FIELDS, FIELDS));
    let k = r.transpose() * own * r;
    Some(Matrix6::from_iterator((0.5 * (&k + k.transpose())).iter().copied()))
}

/// The direction perpendicular to `axis` about which control element `e` turns most easily; `None` where all are alike, to 5 %.
pub fn softest_turn(solution: &Solution, e: usize, axis: &Vector3<f64>) -> Option<Vector3<f64>> {
    let k = rigid_stiffness(solution, e, &solution.controls[e].origin)?;
    let one = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).try_normalize(0.0)?;
    let plane = Matrix3x2::from_columns(&[one, axis.cross(&one)]);
    let turns = (plane.transpose() * k.fixed_view::<3, 3>(3, 3) * plane).symmetric_eigen();
    let (soft, stiff) = (turns.eigenvalues.imin(), turns.eigenvalues.imax());
    let differ = turns.eigenvalues[stiff] > 1.05 * turns.eigenvalues[soft];
    differ.then(|| plane * turns.eigenvectors.column(soft))
}

/// Displacements of nodes for the six motions, a row for each axis of each node.
fn rigid_fields(solution: &Solution, e: usize, about: &Vector3<f64>, nodes: &[usize]) -> DMatrix<f64> {
    let entry =
        |row: usize, field: usize| solution.fields.row(3 * nodes[row / 3] + row % 3)[FIELDS * e + field];
    DMatrix::from_fn(3 * nodes.len(), FIELDS, entry) * rigid(&solution.controls[e], about)
}

/// max xᵀ A x / xᵀ B x over the motions that B resists.
fn largest_ratio(a: Matrix6<f64>, b: Matrix6<f64>) -> Option<f64> {
    let scale = b.diagonal().map(|x| if x > 0.0 { x.sqrt().recip() } else { 0.0 });
    let scaled = |m: &Matrix6<f64>| Matrix6::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
    let b = scaled(&b).symmetric_eigen();
    let most = b.eigenvalues.max();
    let whiten = b.eigenvalues.map(|x| if x > 1e-9 * most { x.sqrt().recip() } else { 0.0 });
    let w = b.eigenvectors * Matrix6::from_diagonal(&whiten);
    let ratio = (w.transpose() * scaled(&a) * w).symmetric_eigenvalues();
    Some(ratio.amax()).filter(|ratio| most > 0.0 && ratio.is_finite())
}

/// The `nodes` that have the same number in the other mesh: all corners.
fn same_nodes(mesh: &TetMesh, other: &TetMesh, nodes: &[u32]) -> Vec<usize> {
    let is_same = |&node: &usize| other.nodes.get(node).is_some_and(|x| *x == mesh.nodes[node]);
    nodes.iter().map(|&node| node as usize).filter(is_same).collect()
}
