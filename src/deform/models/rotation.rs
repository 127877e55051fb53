//! Method 2a of the paper's appendix: the mean rotation of the control elements is taken out of the poses and
//! given to the whole body, so that the linear theory sees half the rotation or less.
//!
//! A = Σ w M_e + Σ w (c_e - c̄)(C_e - C̄)ᵀ/ℓ² with C_e = o_e, c_e = o_e + T_e, ℓ² = Σ w |C_e - C̄|² and w = 1/E; R̄ = polar(A). Then x = R̄ (X + u(c̄)) + t̄ for the poses
//! M̄_e = R̄ᵀ M_e, T̄_e = R̄ᵀ (o_e + T_e - t̄) - o_e. Exact for rigid motions of any body. Its forces are those of the energy in
//! [`Helicoidal`] coordinates: that of the shape takes a turned control element for one that shrank.

use super::helicoidal::{CubicForm, Helicoidal};
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{
    ControlFrame, ControlPose, DEFINED, FrameSlope, PoseSlope, is_mean_defined, stationary, unwrapped,
};
use crate::field::numbers::Numbers;
use crate::green::{AFFINE, CUBIC, FIELDS, STIFFNESS};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "rotation",
    summary: "method 2a: the control elements' mean rotation is given to the whole body, a bent tube keeps its wall",
    requirements: &[AFFINE],
    frame: Frame::MeanMotion,
    energy: Some(&[STIFFNESS, CUBIC]),
    // As for `linear`; the mean of both ends' turns is taken out, and half of it is left either way.
    turn_limits_deg: [15.0, 45.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Rotation::new(input)?))),
    loads: Bearing::Columns,
    fits: None,
};

pub struct Rotation {
    controls: Vec<ControlRest>,
    /// R̄ of the last evaluation in which it was defined.
    last: Rotation3<f64>,
    /// The rotation of every control element in the last evaluation, with the sign that continues the one before: it
    /// distinguishes a turn by 200° from one by -160°.
    turns: Vec<UnitQuaternion<f64>>,
    /// Energy, where forces were asked for, and its results for the last poses that have one.
    energy: Option<Helicoidal>,
    frames: Vec<ControlFrame>,
    slopes: Vec<FrameSlope>,
    response: Response,
}

impl Rotation {
    fn new(input: &ModelInput<'_>) -> Result<Rotation, String> {
        let origins: Vec<Vector3<f64>> = input.controls.iter().map(|control| control.origin).collect();
        let fields = FIELDS * origins.len();
        let cubic = (input.table)(CUBIC.name);
        let cubic = cubic.and_then(|table| CubicForm::new(fields, table.as_slice().to_vec()));
        let energy = match ((input.table)(STIFFNESS.name), cubic) {
            (Some(stiffness), Some(cubic)) => Some(Helicoidal::new(&origins, stiffness, Some(cubic))?),
            _ => None,
        };
        let nothing = Vector3::zeros();
        Ok(Rotation {
            controls: input.controls.to_vec(),
            last: Rotation3::identity(),
            turns: vec![UnitQuaternion::identity(); origins.len()],
            energy,
            frames: Vec::with_capacity(origins.len()),
            slopes: vec![
                FrameSlope { force: nothing, torque: nothing, stretch: Matrix3::zeros() };
                origins.len()
            ],
            response: Response { energy: 0.0, is_defined: true },
        })
    }
}

impl DeformationModel for Rotation {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.turns = unwrapped(Some(&self.turns), poses);
        let mean = mean_rotation(&self.controls, poses, &self.turns);
        self.last = mean.unwrap_or(self.last);
        let (rotation, inverse) = (self.last, self.last.inverse());
        let weights = weights(&self.controls);
        let moved = |e: usize| self.controls[e].origin + poses[e].translation;
        let shift: Vector3<f64> =
            (0..poses.len()).map(|e| (moved(e) - rotation * self.controls[e].origin) * weights[e]).sum();
        let body_from_surface =
            Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_rotation_matrix(&rotation));
        let coefficients = (0..poses.len())
            .flat_map(|e| {
                let seen = ControlPose {
                    translation: inverse * (moved(e) - shift) - self.controls[e].origin,
                    matrix: inverse.matrix() * poses[e].matrix,
                };
                seen.coefficients()
            })
            .collect();
        BodyState {
            parts: vec![body_from_surface],
            coefficients,
            rotation_undefined: mean.is_none(),
            ..BodyState::at_rest(0)
        }
    }

    /// Energy and forces at `poses`; where the frames have no mean, the last ones go on.
    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let energy = self.energy.as_mut()?;
        self.frames.clear();
        for ((control, pose), turn) in self.controls.iter().zip(poses).zip(&mut self.turns) {
            let frame = ControlFrame::new(&control.origin, pose, Some(turn));
            self.frames.extend(frame.inspect(|frame| *turn = frame.turn));
        }
        let is_whole = self.frames.len() == self.controls.len();
        let found = if is_whole { energy.respond(&self.frames, &mut self.slopes) } else { None };
        self.response =
            Response { energy: found.unwrap_or(self.response.energy), is_defined: found.is_some() };
        if found.is_some() {
            for ((slope, frame), own) in slopes.iter_mut().zip(&self.frames).zip(&self.slopes) {
                *slope = frame.pull_back(own);
            }
        }
        Some(self.response)
    }

    fn memory(&self) -> ModelMemory {
        let Response { energy, is_defined } = self.response;
        let unknowns = self.last.matrix().list();
        ModelMemory { turns: self.turns.clone(), energy, is_defined, unknowns, ..ModelMemory::default() }
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        memory.suits(self.controls.len(), 9)?;
        self.turns = memory.turns_of(self.controls.len());
        self.last = Rotation3::from_matrix_unchecked(Unknowns(&memory.unknowns).take());
        self.response = Response { energy: memory.energy, is_defined: memory.is_defined };
        Ok(())
    }

    fn forget(&mut self) {
        self.last = Rotation3::identity();
        self.turns.fill(UnitQuaternion::identity());
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = turn;
        }
    }
}

/// R̄ of the poses, or `None` where it is not defined.
///
/// A has four stationary rotations, its polar factor and that turned by half a turn about one of its axes. Beyond 180°
/// between two elements the polar factor is the wrong half way; the one nearest to the mean of `turns`, which know
/// the whole way, is taken.
pub fn mean_rotation(
    controls: &[ControlRest],
    poses: &[ControlPose],
    turns: &[UnitQuaternion<f64>],
) -> Option<Rotation3<f64>> {
    let weights = weights(controls);
    let mean = |point: &dyn Fn(usize) -> Vector3<f64>| -> Vector3<f64> {
        (0..poses.len()).map(|e| point(e) * weights[e]).sum()
    };
    let rest = |e: usize| controls[e].origin;
    let moved = |e: usize| controls[e].origin + poses[e].translation;
    let (rest_mean, moved_mean) = (mean(&rest), mean(&moved));
    let mut a: Matrix3<f64> = (0..poses.len()).map(|e| poses[e].matrix * weights[e]).sum();
    let square: f64 = (0..poses.len()).map(|e| weights[e] * (rest(e) - rest_mean).norm_squared()).sum();
    if square > 0.0 {
        let chords: Matrix3<f64> = (0..poses.len())
            .map(|e| (moved(e) - moved_mean) * (rest(e) - rest_mean).transpose() * weights[e])
            .sum();
        a += chords / square;
    }
    let mean: nalgebra::Vector4<f64> = turns.iter().zip(&weights).map(|(turn, w)| turn.coords * *w).sum();
    let mean = UnitQuaternion::try_new(nalgebra::Quaternion::from(mean), DEFINED)?;
    let mean = mean.to_rotation_matrix();
    // The trace of RᵀR' is 1 + 2 cos of the angle between them.
    let closeness = |rotation: &Rotation3<f64>| mean.matrix().dot(rotation.matrix());
    let ways = stationary(&a)?.into_iter();
    let (rotation, beta) = ways.max_by(|(a, _), (b, _)| closeness(a).total_cmp(&closeness(b)))?;
    is_mean_defined(&beta).then_some(rotation)
}

/// Equal ones: how finely an element's part of the mesh is divided says nothing of the body.
fn weights(controls: &[ControlRest]) -> Vec<f64> {
    vec![1.0 / controls.len().max(1) as f64; controls.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::ControlPoses;

    fn controls() -> Vec<ControlRest> {
        [(-1.0, 100), (1.0, 100)]
            .map(|(x, nodes)| ControlRest { name: String::new(), origin: Vector3::new(x, 0.2, 0.0), nodes })
            .to_vec()
    }

    fn rigid(rotation: Rotation3<f64>, shift: Vector3<f64>) -> ControlPoses {
        controls()
            .iter()
            .map(|control| ControlPose {
                translation: rotation * control.origin + shift - control.origin,
                matrix: *rotation.matrix(),
            })
            .collect()
    }

    #[test]
    fn rigid_motion_leaves_no_coefficients_and_moves_the_body() {
        let rotation = Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 2.0));
        let shift = Vector3::new(0.3, -2.0, 0.7);
        let none = |_| Vec::new();
        let controls = controls();
        let input = ModelInput {
            controls: &controls,
            rest: &[],
            triangles: &[],
            control_nodes: &none,
            table: &|_| None,
            loads: None,
        };
        let mut model = Rotation::new(&input).unwrap();
        let made = model.state(&rigid(rotation, shift));
        assert!(made.coefficients.iter().all(|c| c.abs() < 1e-14), "{made:?}");
        let x = nalgebra::Point3::new(0.5, 0.1, -0.3);
        let expected = rotation * x + shift;
        assert!((made.body_from_surface() * x - expected).norm() < 1e-14);
    }

    #[test]
    fn two_ends_share_the_rotation_between_them() {
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), 1.2);
        let mut poses = rigid(Rotation3::identity(), Vector3::zeros());
        poses[1].matrix = *turned.matrix();
        let mean = mean_rotation(&controls(), &poses, &unwrapped(None, &poses)).unwrap();
        // The chord does not turn; the mean of {0, 1.2} pulled towards it by its own weight.
        let (axis, angle) = mean.axis_angle().unwrap();
        assert!((axis.x - 1.0).abs() < 1e-12 && angle > 0.3 && angle <= 0.6 + 1e-12, "{angle}");
    }

    #[test]
    fn undefined_mean_keeps_the_last_one() {
        let half_turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let mut poses = rigid(Rotation3::identity(), Vector3::zeros());
        poses[1].matrix = *half_turn.matrix();
        let mean = |poses: &ControlPoses| mean_rotation(&controls(), poses, &unwrapped(None, poses));
        assert!(mean(&poses).is_none());
        poses[1].matrix = Matrix3::from_element(f64::NAN);
        assert!(mean(&poses).is_none());
    }

    /// One end twisted by two whole turns, in steps: the mean follows at half the angle, through 180°, and half a turn
    /// beyond 360° it is still half of the whole way.
    #[test]
    fn many_turns_are_followed() {
        let mut poses = rigid(Rotation3::identity(), Vector3::zeros());
        let mut turns = None;
        for degree in (0..700).step_by(5) {
            let angle = f64::from(degree).to_radians();
            poses[1].matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), angle).matrix();
            let now = unwrapped(turns.as_deref(), &poses);
            if let Some(mean) = mean_rotation(&controls(), &poses, &now) {
                let half = Rotation3::from_axis_angle(&Vector3::x_axis(), angle / 2.0);
                let off = UnitQuaternion::from_rotation_matrix(&(half.inverse() * mean)).angle().to_degrees();
                assert!(off < 1e-6, "{degree}°: the mean is {off}° off");
            }
            turns = Some(now);
        }
    }
}
