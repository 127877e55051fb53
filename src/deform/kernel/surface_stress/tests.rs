//! Stresses against closed forms: uniform extension, pure bending, the pressed tube of Lamé, two materials side by side.

use super::*;
use crate::fem::{COROTATIONAL, NEO_HOOKEAN, STVK, hooke_at_free_face};
use crate::mesh::{Block, Surface, TetMesh, Tube, block, tube};
use nalgebra::{Matrix3, Rotation3, SymmetricEigen};

const POISSON: f64 = 0.3;

fn lame(young: f64) -> Lame {
    Lame::from_young_poisson(young, POISSON)
}

struct Shape {
    mesh: TetMesh,
    surface: Surface,
    rest: Vec<[f32; 3]>,
}

impl Shape {
    fn new(mesh: TetMesh) -> Shape {
        let surface = Surface::from_mesh(&mesh);
        let rest = surface.nodes.iter().map(|&node| mesh.nodes[node as usize].cast::<f32>().into()).collect();
        Shape { mesh, surface, rest }
    }

    fn place(&self, i: usize) -> Vector3<f64> {
        self.mesh.nodes[self.surface.nodes[i] as usize]
    }

    /// Stress of the field `u` of places, where the places for which `held` is true are held.
    fn stress(
        &self,
        lame: &[Lame],
        material: &[u8],
        held: impl Fn(&Vector3<f64>) -> bool,
        u: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Vec<Option<NodeStress>> {
        self.stress_by(Strain::Finite, lame, material, held, u)
    }

    fn stress_by(
        &self,
        of: Strain,
        lame: &[Lame],
        material: &[u8],
        held: impl Fn(&Vector3<f64>) -> bool,
        u: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Vec<Option<NodeStress>> {
        let all = 0..self.rest.len();
        let held = vec![all.clone().filter(|&i| held(&self.place(i))).map(|i| i as u32).collect()];
        let triangles = &self.surface.triangles;
        let parts = SurfaceParts {
            rest: &self.rest,
            triangles,
            material,
            lame,
            held: &held,
            law: hooke_at_free_face,
        };
        let u: Vec<Vector3<f64>> = all.map(|i| u(&self.place(i))).collect();
        SurfaceStress::new(&parts).at_nodes(&u, 1.0, of, &FaceLoads::default(), |at| at.von_mises)
    }
}

fn bar(cells: u32) -> Shape {
    Shape::new(block(&Block { size: [4.0, 1.0, 1.0], cells: [4 * cells, cells, cells] }).unwrap())
}

/// The ends of a bar about the origin, where forces pull it.
fn ends(x: &Vector3<f64>) -> bool {
    x.x.abs() == 2.0
}

#[test]
fn a_pulled_bar_has_e_times_epsilon_however_it_is_turned() {
    let (shape, young, strain) = (bar(2), 2.1e11, 1e-3);
    let stretch = Matrix3::from_diagonal(&Vector3::new(strain, -POISSON * strain, -POISSON * strain));
    for angle in [0.0, 90.0, 200.0_f64] {
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.6, -0.64, 0.48) * angle.to_radians());
        let gradient = turn.matrix() * (Matrix3::identity() + stretch) - Matrix3::identity();
        let found = shape.stress(&[lame(young)], &[], ends, |x| gradient * x + Vector3::repeat(7.0));
        let free: Vec<NodeStress> = found.into_iter().flatten().collect();
        assert_eq!(free.len() + 2, shape.rest.len(), "only what lies amid the held ends has no stress");
        for at in free {
            assert!((at.von_mises / (young * strain) - 1.0).abs() < 1e-9, "{angle}°: {at:?}");
            assert!((at.strain / strain - 1.0).abs() < 1e-9, "{angle}°: {at:?}");
        }
        let rigid = turn.matrix() - Matrix3::identity();
        let found = shape.stress(&[lame(young)], &[], |_| false, |x| rigid * x);
        assert!(found.iter().flatten().all(|at| at.von_mises < 1e-13 * young && at.strain < 1e-13));
    }
    let all_held = shape.stress(&[lame(young)], &[], |_| true, |x| stretch * x);
    assert!(all_held.iter().all(Option::is_none), "nothing is told where forces act");
}

/// u of pure bending with curvature κ (Timoshenko and Goodier, article 102): σ = E κ y.
fn bent(x: &Vector3<f64>, curvature: f64) -> Vector3<f64> {
    let (x, y, z) = (x.x, x.y, x.z);
    Vector3::new(x * y, -0.5 * (x * x + POISSON * (y * y - z * z)), -POISSON * y * z) * curvature
}

#[test]
fn a_bent_bar_has_the_stress_of_its_outermost_fibre() {
    const CURVATURE: f64 = 1e-6;
    let shape = bar(8);
    let found = shape.stress(&[lame(1e9)], &[], ends, |x| bent(x, CURVATURE));
    let outermost = |i: &usize| shape.place(*i).y.abs() == 0.5 && shape.place(*i).z.abs() < 0.4;
    // Of the second order in the curvature alone.
    for i in (0..found.len()).filter(outermost) {
        let Some(at) = found[i] else { continue };
        let off = (at.von_mises / (1e9 * CURVATURE * 0.5) - 1.0).abs();
        assert!(off < 1e-5 || shape.place(i).x.abs() == 2.0, "{}: {off:e}", shape.place(i));
    }
    // On the sides σ = E κ y, which changes within a triangle.
    let side = |i: &usize| shape.place(*i).z.abs() == 0.5 && shape.place(*i).y.abs() < 0.4;
    for i in (0..found.len()).filter(side) {
        let (Some(at), x) = (found[i], shape.place(i)) else { continue };
        let off = (at.von_mises - 1e9 * CURVATURE * x.y.abs()).abs() / (1e9 * CURVATURE * 0.5);
        assert!(off < 0.02 || x.x.abs() == 2.0, "{x}: {off:e}");
    }
}

/// Small-strain theory turns the ends of this bar by 11°: as a shape it would be longer there by
/// 2 %, beside a bending strain of 5 %.
#[test]
fn of_small_strain_theory_a_turn_is_no_stretch() {
    const CURVATURE: f64 = 0.1;
    let shape = bar(8);
    let outermost = |i: &usize| shape.place(*i).y.abs() == 0.5 && shape.place(*i).z.abs() < 0.4;
    let ratios = |of: Strain| {
        let found = shape.stress_by(of, &[lame(1e9)], &[], ends, |x| bent(x, CURVATURE));
        let inner = (0..found.len()).filter(outermost).filter(|&i| shape.place(i).x.abs() < 1.9);
        let ratios: Vec<f64> =
            inner.filter_map(|i| Some(found[i]?.von_mises / (1e9 * CURVATURE * 0.5))).collect();
        ratios.into_iter().fold(0.0, f64::max)
    };
    assert!((ratios(Strain::Small) - 1.0).abs() < 1e-5);
    assert!(ratios(Strain::Finite) > 1.3);
}

/// Outer wall, in plane strain: σ_θ = 2 p a² / (b² - a²), σ_z = ν σ_θ, σ_r = 0 (article 28).
#[test]
fn a_pressed_tube_has_the_hoop_stress_of_lame() {
    let (a, b, young, pressure) = (0.5_f64, 1.0_f64, 1e9, 1e3);
    let c = (1.0 + POISSON) * pressure * a * a / (young * (b * b - a * a));
    let hoop = 2.0 * pressure * a * a / (b * b - a * a);
    let expected = hoop * (1.0 - POISSON + POISSON * POISSON).sqrt();
    let strain = (1.0 - POISSON * POISSON) * hoop / young;
    const AXIS: usize = 0;
    let worst = |size: u32| {
        let shape = Shape::new(
            tube(&Tube {
                inner_radius: a,
                outer_radius: b,
                length: 1.0,
                radial: size,
                around: 12 * size,
                along: 2 * size,
                control_length: 0.1,
            })
            .unwrap(),
        );
        let off = |x: &Vector3<f64>| {
            let mut r = *x;
            r[AXIS] = 0.0;
            r
        };
        let found = shape.stress(
            &[lame(young)],
            &[],
            |_| false,
            |x| {
                let r = off(x);
                r * (c * (1.0 - 2.0 * POISSON) + c * b * b / r.norm_squared())
            },
        );
        let outer = |i: &usize| {
            let x = shape.place(*i);
            (off(&x).norm() - b).abs() < 1e-9 && x[AXIS].abs() < 0.3
        };
        let errors: Vec<[f64; 2]> = (0..found.len())
            .filter(outer)
            .map(|i| {
                let at = found[i].unwrap();
                [(at.von_mises / expected - 1.0).abs(), (at.strain / strain - 1.0).abs()]
            })
            .collect();
        assert!(errors.len() >= 12 * size as usize, "{} nodes", errors.len());
        [0, 1].map(|k| errors.iter().map(|error| error[k]).fold(0.0, f64::max))
    };
    let (coarse, fine) = (worst(2), worst(4));
    println!("tube: {coarse:?}, {fine:?}");
    for k in 0..2 {
        assert!(fine[k] < 0.02 && (coarse[k] / fine[k]).log2() > 1.8, "{coarse:?}, {fine:?}");
    }
}

/// A bar of two materials, stretched alike: each has its own stress up to the seam, and there the larger.
#[test]
fn materials_are_not_mixed_where_they_meet() {
    let shape = bar(2);
    let middle = |t: &[u32; 3]| t.iter().map(|&i| shape.place(i as usize).x).sum::<f64>() / 3.0;
    let material: Vec<u8> = shape.surface.triangles.iter().map(|t| u8::from(middle(t) > 0.0)).collect();
    let stretch = Matrix3::from_diagonal(&Vector3::new(1e-6, -POISSON * 1e-6, -POISSON * 1e-6));
    let found = shape.stress(&[lame(1e9), lame(4e9)], &material, ends, |x| stretch * x);
    for (i, at) in found.iter().enumerate() {
        let Some(at) = at else { continue };
        let expected = if shape.place(i).x < 0.0 { 1e3 } else { 4e3 };
        assert!((at.von_mises / expected - 1.0).abs() < 1e-4, "{}: {at:?}", shape.place(i));
    }
}

/// The laws differ at large strain: a bar of St. Venant–Kirchhoff pulled to 1.2 has S = E (1.44 - 1)/2.
#[test]
fn large_strain_has_the_stress_of_its_law() {
    let shape = bar(1);
    let lame = lame(1e6);
    for law in [STVK, NEO_HOOKEAN, COROTATIONAL] {
        // λ across of a bar that is free at its sides.
        let across = (0..60).fold(-0.05, |across, _| {
            let side = (law.free_face)([0.2, across], lame).across;
            0.5 * (across + side)
        });
        let face = (law.free_face)([0.2, across], lame);
        assert!(face.stress[1].abs() < 1.0, "{}: {face:?}", law.name);
        let gradient = Matrix3::from_diagonal(&Vector3::new(0.2, across, across));
        let all = 0..shape.rest.len();
        let held: Vec<u32> = all.clone().filter(|&i| ends(&shape.place(i))).map(|i| i as u32).collect();
        let parts = SurfaceParts {
            rest: &shape.rest,
            triangles: &shape.surface.triangles,
            material: &[],
            lame: &[lame],
            held: std::slice::from_ref(&held),
            law: law.free_face,
        };
        let u: Vec<Vector3<f64>> = all.map(|i| gradient * shape.place(i)).collect();
        // P is the force on the area at rest; σ on that which is left.
        let nominal = (law.stress)(&gradient, lame)[(0, 0)];
        let expected = nominal / (1.0 + across).powi(2);
        for at in SurfaceStress::new(&parts)
            .at_nodes(&u, 1.0, Strain::Finite, &FaceLoads::default(), |at| at.strain)
            .into_iter()
            .flatten()
        {
            assert!((at.von_mises / expected - 1.0).abs() < 1e-3, "{}: {at:?}, {expected}", law.name);
            assert!((at.strain - 0.2).abs() < 1e-6, "{}: {at:?}", law.name);
        }
        if law.name == "stvk" {
            assert!((nominal / (1.2 * 1e6 * 0.22) - 1.0).abs() < 1e-4, "{nominal}");
        }
    }
}

proptest::proptest! {
    #[test]
    fn invariants_are_those_of_the_principal_values(parts in proptest::array::uniform6(-1e9..1e9_f64)) {
        let [xx, yy, zz, yz, zx, xy] = parts;
        let values = SymmetricEigen::new(Matrix3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz)).eigenvalues;
        let size = values.amax();
        proptest::prop_assert!((largest(&parts) - values.max()).abs() < 1e-6 * size);
        let [a, b, c] = [values[0] - values[1], values[1] - values[2], values[2] - values[0]];
        let expected = (0.5 * (a * a + b * b + c * c)).sqrt();
        proptest::prop_assert!((von_mises(&parts) - expected).abs() < 1e-9 * size);
    }
}

/// A block in a uniform state σ, whose strain it has: every face bears σ n, which makes the stress whole there. Without it
/// the faces would seem to have plane stress.
#[test]
fn tractions_make_the_stress_of_a_loaded_face_whole() {
    let shape = bar(2);
    let (young, lame) = (1e9, lame(1e9));
    let stress = Matrix3::new(3.0, 1.0, -0.5, 1.0, -2.0, 0.7, -0.5, 0.7, 0.4) * 1e3;
    let strain = (stress * (1.0 + POISSON) - Matrix3::identity() * (POISSON * stress.trace())) / young;
    let deviator = stress - Matrix3::from_diagonal_element(stress.trace() / 3.0);
    let expected = [(1.5 * deviator.norm_squared()).sqrt(), SymmetricEigen::new(strain).eigenvalues.max()];
    let triangles = &shape.surface.triangles;
    let parts = SurfaceParts {
        rest: &shape.rest,
        triangles,
        material: &[],
        lame: &[lame],
        held: &[],
        law: hooke_at_free_face,
    };
    let tractions: Vec<Vector3<f64>> = triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.map(|node| shape.place(node as usize));
            stress * (b - a).cross(&(c - a)).normalize()
        })
        .collect();
    let surface = SurfaceStress::new(&parts);
    let inner = |i: usize| {
        [2.0, 0.5, 0.5].iter().zip(shape.place(i).iter()).filter(|(s, x)| **s == x.abs()).count() == 1
    };
    let stress_of = |turn: &Rotation3<f64>, of: Strain, loads: &FaceLoads| -> Vec<NodeStress> {
        let gradient = turn.matrix() * (Matrix3::identity() + strain) - Matrix3::identity();
        let u: Vec<Vector3<f64>> = (0..shape.rest.len()).map(|i| gradient * shape.place(i)).collect();
        let found = surface.at_nodes(&u, 1.0, of, loads, |at| at.von_mises);
        found.into_iter().enumerate().filter(|(i, _)| inner(*i)).filter_map(|(_, at)| at).collect()
    };
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.6, -0.64, 0.48) * 2.0);
    let turned = tractions.iter().map(|t| turn * t).collect();
    for (turn, of, loads) in [
        (Rotation3::identity(), Strain::Small, FaceLoads { follows: tractions.clone(), fixed: Vec::new() }),
        (turn, Strain::Finite, FaceLoads { follows: tractions, fixed: Vec::new() }),
        (turn, Strain::Finite, FaceLoads { follows: Vec::new(), fixed: turned }),
    ] {
        for at in stress_of(&turn, of, &loads) {
            let off = [at.von_mises / expected[0] - 1.0, at.strain / expected[1] - 1.0];
            assert!(off.iter().all(|off| off.abs() < 2e-5), "{off:?}");
        }
    }
    let free = stress_of(&Rotation3::identity(), Strain::Small, &FaceLoads::default());
    assert!(free.iter().any(|at| (at.von_mises / expected[0] - 1.0).abs() > 0.1));
}
