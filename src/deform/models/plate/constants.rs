//! The plate's constants, from the body's own handle stiffness, and the motion of all control elements from one set of
//! frames to another.
//!
//! In: S, and a shell with its grips. Out: four moduli, against stretching and shearing, bending and twisting, with which the
//! shell answers small rigid motions of the control elements as the body does: the thickness enters as h and h³/12, so that
//! a homogeneous plate of elements that do not lock has four equal ones, E.
//!
//! ```text
//! min over f of ‖Wᵀ S_plate(f) W - I‖²     Wᵀ S W = I     S_plate = Σ_k f_k ∂S/∂f_k + grips
//! ```
//!
//! Relative errors of all motions count alike, soft or stiff. ∂S/∂f_k are the energies of the answers, by the envelope theorem.
//!
//! Between two control elements, the body's energy to the third order ([`Helicoidal`]) also gives the force with which it pulls
//! at them when it is bent or twisted a little: p and q of the [`Point`]s are such that the shell pulls as strongly. Elements
//! that lock in bending or twisting feel these stretches differently.
//!
//! [`follow`] moves the control elements in steps along screws; the quaternions distinguish turns up to 360° apart.

use super::point::{Hold, Law, Point};
use super::sheet::{Sheet, Standing};
use crate::deform::models::helicoidal::Helicoidal;
use crate::deform::pose::frame::{ControlFrame, FrameSlope, PoseSlope};
use crate::deform::pose::se3::{exp, log_of, long_turn};
use crate::green::FIELDS;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix4, UnitQuaternion, Vector3, Vector4, Vector6};
use std::f64::consts::PI;

/// Poisson's ratio: little of it is to be seen in S.
pub const POISSON: f64 = 0.3;
/// The grips' springs, beside a cell's own stiffness.
const GRIP: f64 = 300.0;
/// Cost of the square of a ratio's logarithm: of the two moduli of either pair, and of bending's to stretching's. Locking makes
/// twisting up to twenty times stiffer than bending, shearing hardly stiffer than stretching.
const ALIKE: [f64; 3] = [1e-1, 1e-4, 1e-4];
const ROUNDS: usize = 20;

/// Young's moduli, Pa, that four kinds of strain feel: stretching, shearing, bending, twisting.
pub type Moduli = [f64; 4];

/// Gives the shell these moduli; its grips are as strong as that needs.
pub fn apply(sheet: &mut Sheet, moduli: &Moduli) {
    for point in &mut sheet.points {
        let [stretch, shear, bend, twist] = *moduli;
        let (h, area) = (point.thickness, point.area);
        let law = |normal: f64, shear: f64| Law {
            shear: Law::isotropic(shear, POISSON).shear,
            ..Law::isotropic(normal, POISSON)
        };
        point.membrane = law(stretch, shear).scaled(h * area);
        point.bending = law(bend, twist).scaled(h.powi(3) / 12.0 * area);
    }
    for grip in &mut sheet.grips {
        grip.pull = GRIP * moduli[0] * grip.share;
        grip.turn = GRIP * moduli[2] * grip.share * grip.spread;
    }
}

/// Gives the shell the moduli with which it is nearest to S, and returns its distance from S: the root mean square of the
/// relative errors of all motions. Where S resists no motion, that is not known, and not a number.
pub fn fit(sheet: &mut Sheet, origins: &[Vector3<f64>], stiffness: &DMatrix<f64>) -> (Moduli, f64) {
    let mut moduli = [1.0; 4];
    apply(sheet, &moduli);
    let Some(whitened) = whitened(stiffness, origins.len(), sheet.size) else { return (moduli, f64::NAN) };
    let count = whitened.ncols();
    let target = DMatrix::identity(count, count);
    let mut off = f64::INFINITY;
    for round in 0..ROUNDS {
        let Some(parts) = energies(sheet, origins) else { break };
        let parts: Vec<DMatrix<f64>> =
            parts.iter().map(|part| whitened.transpose() * part * &whitened).collect();
        let whole: DMatrix<f64> = parts.iter().sum();
        if round == 0 {
            // All alike first.
            let scale = whole.trace() / whole.norm_squared();
            moduli = moduli.map(|modulus| modulus * scale);
            apply(sheet, &moduli);
            continue;
        }
        let left = &whole - &target;
        off = left.norm() / (count as f64).sqrt();
        let logarithms = Vector4::from(moduli.map(f64::ln));
        let unlike = unlike();
        let normal = Matrix4::from_fn(|i, j| parts[i].dot(&parts[j])) + unlike + Matrix4::identity() * 1e-9;
        let slope = Vector4::from_fn(|i, _| parts[i].dot(&left)) + unlike * logarithms;
        let Some(step) = normal.lu().solve(&-slope) else { break };
        for (modulus, step) in moduli.iter_mut().zip(step.iter()) {
            *modulus *= step.clamp(-1.0, 1.0).exp();
        }
        apply(sheet, &moduli);
        if step.amax() < 1e-4 {
            break;
        }
    }
    (moduli, off)
}

/// The quadratic form of the moduli's logarithms with the costs [`ALIKE`].
fn unlike() -> Matrix4<f64> {
    let ratios = [
        Vector4::new(1.0, -1.0, 0.0, 0.0),
        Vector4::new(0.0, 0.0, 1.0, -1.0),
        Vector4::new(1.0, 1.0, -1.0, -1.0) * 0.5,
    ];
    ratios.iter().zip(ALIKE).map(|(ratio, cost)| ratio * ratio.transpose() * cost).sum()
}

/// Gives the shell the p and q with which it pulls at two control elements as the body does; `normal` to the plate.
/// Without a body's energy to the third order, they are 1.
pub fn fit_second(
    sheet: &mut Sheet,
    moduli: &Moduli,
    origins: &[Vector3<f64>],
    normal: &Vector3<f64>,
    energy: Option<Helicoidal>,
) {
    let mut shares = [1.0; 2];
    stretch(sheet, shares);
    let (&[first, last], Some(mut energy)) = (origins, energy) else { return };
    let chord: Vector3<f64> = last - first;
    let (Some(axis), Some(across)) =
        (chord.try_normalize(1e-9 * sheet.size), normal.cross(&chord).try_normalize(1e-9 * sheet.size))
    else {
        return;
    };
    // So little that the plate does not rise by its thickness.
    let angle = 0.3 * sheet.thickness / chord.norm();
    for (kind, turn) in [across, axis].into_iter().enumerate() {
        let frames = apart(first, &chord, &(turn * angle));
        let along = UnitQuaternion::from_scaled_axis(turn * (0.5 * angle)) * axis;
        let mut of_body =
            [FrameSlope { force: Vector3::zeros(), torque: Vector3::zeros(), stretch: Matrix3::zeros() }; 2];
        if energy.respond(&frames, &mut of_body).is_none() {
            continue;
        }
        let wanted = of_body[1].force.dot(&along);
        let mut pull = |share: f64| {
            let mut trial = shares;
            trial[kind] = share;
            stretch(sheet, trial);
            sheet.reset();
            let holds = frames.each_ref().map(held);
            let mut slopes = [PoseSlope::default(); 2];
            sheet.settle(&holds)?;
            sheet.slopes(&holds, &mut slopes);
            Some(slopes[1].translation.dot(&along))
        };
        // It is linear in the share.
        if let (Some(none), Some(some)) = (pull(0.0), pull(SHARE)) {
            let share = SHARE * (wanted - none) / (some - none);
            if share.is_finite() {
                let most = MOST_SHARE * moduli[2 + kind] / moduli[0];
                shares[kind] = share.clamp(-most, most);
            }
        }
    }
    stretch(sheet, shares);
    sheet.reset();
}

/// The share with which the pull is measured; and the largest, where bending is as stiff as the body: a membrane strain ε
/// changes the stiffness against bending by about this part of it, times ε.
const SHARE: f64 = 10.0;
const MOST_SHARE: f64 = 6.0;

fn stretch(sheet: &mut Sheet, shares: [f64; 2]) {
    sheet.points.iter_mut().for_each(|point| point.stretch_with_bending(POISSON, shares));
}

/// Frames of two control elements, the last of which is turned and stands on an arc, or a straight line, of its length.
fn apart(first: Vector3<f64>, chord: &Vector3<f64>, turn: &Vector3<f64>) -> [ControlFrame; 2] {
    let end = exp(&Vector6::new(chord.x, chord.y, chord.z, turn.x, turn.y, turn.z));
    let frame = |place, turn| ControlFrame { place, turn, stretch: Matrix3::identity() };
    [frame(first, UnitQuaternion::identity()), frame(first + end.translation.vector, end.rotation)]
}

/// W of the rigid motions of all control elements but the first; motions that meet no resistance are left out. `None` where
/// none is left.
fn whitened(stiffness: &DMatrix<f64>, controls: usize, size: f64) -> Option<DMatrix<f64>> {
    if stiffness.shape() != (FIELDS * controls, FIELDS * controls) || controls < 2 {
        return None;
    }
    let motions = 6 * (controls - 1);
    let mut fields = DMatrix::zeros(FIELDS * controls, motions);
    for motion in 0..motions {
        let (first, kind) = (FIELDS * (1 + motion / 6), motion % 6);
        if kind < 3 {
            fields[(first + kind, motion)] = 1.0;
        } else {
            let turn = Vector3::ith(kind - 3, 1.0).cross_matrix();
            (0..9).for_each(|k| fields[(first + 3 + k, motion)] = turn[(k / 3, k % 3)] / size);
        }
    }
    let s = fields.transpose() * stiffness * fields;
    let eigen = ((&s + s.transpose()) * 0.5).symmetric_eigen();
    let most = eigen.eigenvalues.max();
    let resisting: Vec<usize> = (0..motions).filter(|&k| eigen.eigenvalues[k] > 1e-8 * most).collect();
    let column = |i: usize, k: usize| {
        let unit = if i % 6 < 3 { 1.0 } else { 1.0 / size };
        unit * eigen.eigenvectors[(i, resisting[k])] / eigen.eigenvalues[resisting[k]].sqrt()
    };
    (!resisting.is_empty()).then(|| DMatrix::from_fn(motions, resisting.len(), column))
}

/// The energies of the answers to rigid motions of all control elements but the first, by the four moduli and in the grips.
fn energies(sheet: &mut Sheet, origins: &[Vector3<f64>]) -> Option<[DMatrix<f64>; 5]> {
    // So small that what is of second order does not matter.
    let small = 1e-7;
    let motions = 6 * (origins.len() - 1);
    let unit_of = |motion: usize| if motion % 6 < 3 { small * sheet.size } else { small };
    let units: Vec<f64> = (0..motions).map(unit_of).collect();
    let holds: Vec<Vec<Hold>> = (0..motions).map(|motion| moved(origins, motion, units[motion])).collect();
    let answers = sheet.answers(&holds)?;
    let (mut strains, mut pulls) = (Vec::new(), Vec::new());
    for ((answer, holds), unit) in answers.iter().zip(&holds).zip(units) {
        let strain = |point: &Point| strain(point, sheet, answer, unit);
        strains.push(sheet.points.iter().map(strain).collect::<Option<Vec<_>>>()?);
        let moved: Vec<Vector3<f64>> = sheet.rest.iter().zip(answer).map(|(x, u)| x + u).collect();
        let pulled = |grip: &super::point::Grip| {
            let pulled = grip.pulled(&moved, &holds[grip.control]);
            let (pull, turn) = (grip.pull.sqrt() / unit, grip.turn.sqrt() / unit);
            let [x, y] = pulled.tilt;
            [pulled.off.x * pull, pulled.off.y * pull, pulled.off.z * pull, x * turn, y * turn]
        };
        pulls.push(sheet.grips.iter().flat_map(pulled).collect::<Vec<f64>>());
    }
    let of_moduli = |kind: usize| {
        DMatrix::from_fn(motions, motions, |i, j| {
            let pairs = strains[i].iter().zip(&strains[j]).zip(&sheet.points);
            pairs.map(|((one, two), point)| part(point, kind, &one[kind / 2], &two[kind / 2])).sum()
        })
    };
    let dot = |i: usize, j: usize| pulls[i].iter().zip(&pulls[j]).map(|(a, b): (&f64, &f64)| a * b).sum();
    let grips = DMatrix::from_fn(motions, motions, dot);
    Some([of_moduli(0), of_moduli(1), of_moduli(2), of_moduli(3), grips])
}

/// The holds at rest, but for one rigid motion of one control element, behind the first.
fn moved(origins: &[Vector3<f64>], motion: usize, by: f64) -> Vec<Hold> {
    let hold = |&place: &Vector3<f64>| Hold { place, matrix: Matrix3::identity() };
    let mut holds: Vec<Hold> = origins.iter().map(hold).collect();
    let (hold, kind) = (&mut holds[1 + motion / 6], motion % 6);
    if kind < 3 {
        hold.place[kind] += by;
    } else {
        hold.matrix += Vector3::ith(kind - 3, by).cross_matrix();
    }
    holds
}

fn strain(point: &Point, sheet: &Sheet, answer: &[Vector3<f64>], unit: f64) -> Option<[[f64; 3]; 2]> {
    let local = point.local(&sheet.rest)?;
    Some(point.strain_by(&local, |node| answer[node]).map(|part| part.map(|strain| strain / unit)))
}

/// One kind's share in the energy of two strains.
fn part(point: &Point, kind: usize, one: &[f64; 3], two: &[f64; 3]) -> f64 {
    let law = if kind < 2 { &point.membrane } else { &point.bending };
    let stress = law.stress(*two);
    if kind.is_multiple_of(2) { one[0] * stress[0] + one[1] * stress[1] } else { one[2] * stress[2] }
}

/// Largest turn of a control element in one step, rad, largest move in parts of the body's size, and largest stretch.
const TURN: f64 = PI / 8.0;
const MOVE: f64 = 0.2;
const STRETCH: f64 = 0.1;
const MOST_STEPS: f64 = 64.0;

/// The hold of a control element on the shell.
pub fn held(frame: &ControlFrame) -> Hold {
    Hold { place: frame.place, matrix: frame.matrix() }
}

/// Leads the sheet to these frames.
pub fn follow(
    from: &[ControlFrame],
    to: &[ControlFrame],
    holds: &mut [Hold],
    sheet: &mut Sheet,
) -> Option<Standing> {
    let steps = distance(from, to, sheet.size).max(1.0).ceil().min(MOST_STEPS);
    let (mut iterations, mut buckled) = (0, false);
    for step in 1.. {
        let share = step as f64 / steps;
        for ((hold, from), to) in holds.iter_mut().zip(from).zip(to) {
            *hold = if share >= 1.0 { held(to) } else { at(from, to, share) };
        }
        let found = sheet.settle(holds)?;
        iterations += found.iterations;
        buckled |= found.buckled;
        if share >= 1.0 {
            return Some(Standing { iterations, buckled, ..found });
        }
    }
    None
}

/// Distance that the farthest control element goes, in largest steps.
pub fn distance(from: &[ControlFrame], to: &[ControlFrame], size: f64) -> f64 {
    let of = |(from, to): (&ControlFrame, &ControlFrame)| {
        let turn = long_turn(&(to.turn * from.turn.inverse())).norm() / TURN;
        let moved = (to.place - from.place).norm() / (MOVE * size);
        turn.max(moved).max((to.stretch - from.stretch).norm() / STRETCH)
    };
    from.iter().zip(to).map(of).fold(0.0, f64::max)
}

/// The hold at `share` of the way from one frame to another.
fn at(from: &ControlFrame, to: &ControlFrame, share: f64) -> Hold {
    let start = from.motion();
    let motion = to.motion() * start.inverse();
    let turn = long_turn(&motion.rotation);
    let place = if turn.norm() <= PI {
        exp(&(log_of(&motion) * share)) * start
    } else {
        let turned = UnitQuaternion::from_scaled_axis(turn * share) * start.rotation;
        Isometry3::from_parts(from.place.lerp(&to.place, share).into(), turned)
    };
    let stretch = from.stretch * (1.0 - share) + to.stretch * share;
    held(&ControlFrame { place: place.translation.vector, turn: place.rotation, stretch })
}
