//! Forces on a body, as a scene writes them: body loads, force patterns over regions, and the compliance of its surface.
//!
//! In: the keys `gravity`, `centrifugal`, `thermal`, `load.NAME` and `surface_compliance`. Out: their values, and the
//! [`LoadEntry`] that each load of a body becomes.

use super::direction::DirectionFile;
use super::select::Nodes;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Standard gravity, m/s².
pub const STANDARD_GRAVITY: f64 = 9.80665;

/// Names of the body loads, which no pattern may have.
pub const GRAVITY: &str = "gravity";
pub const CENTRIFUGAL: &str = "centrifugal";
pub const THERMAL: &str = "thermal";

/// Largest number of a pose or load; what is summed must stay within single precision.
pub const LARGEST_NUMBER: f64 = 1e15;

/// `gravity = true`, or the acceleration in the room's axes, m/s².
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected true, false, or an acceleration [x, y, z] in the room's axes, m/s²")]
pub enum Gravity {
    Earth(bool),
    Room([f64; 3]),
}

impl Gravity {
    /// Acceleration in the room's axes, y up, m/s²; `None` where there is none.
    pub fn in_room(self) -> Option<[f64; 3]> {
        match self {
            Gravity::Earth(false) => None,
            Gravity::Earth(true) => Some([0.0, -STANDARD_GRAVITY, 0.0]),
            Gravity::Room(acceleration) => Some(acceleration),
        }
    }
}

/// Rotation of the body about an axis in the mesh's axes.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { axis = [0, 0, 1], speed = 10.0 }")]
pub struct Centrifugal {
    pub axis: [f64; 3],
    /// A point of the axis, m.
    #[serde(default)]
    pub point: [f64; 3],
    /// rad/s.
    pub speed: f64,
}

/// The whole body is warmer than where it is without stress.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { expansion = 1.2e-5, difference = 20.0 }")]
pub struct Thermal {
    /// Coefficient of linear expansion, 1/K.
    pub expansion: f64,
    /// K.
    pub difference: f64,
}

/// A force pattern over the faces of the surface all of whose nodes are selected.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    pub nodes: Nodes,
    pub kind: LoadKind,
    /// Axis of `stretch`, `twist` and `direction`, in the mesh's axes; the faces' mean normal where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Vectors of `direction` that differ from place to place, instead of an axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<DirectionFile>,
    /// Value from the start: N, N·m or Pa; three numbers for `shift`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<LoadValue>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LoadKind {
    /// 1 N along the axis, spread evenly.
    Stretch,
    /// 1 N along x, y and z of the mesh, spread evenly: three columns.
    Shift,
    /// 1 N·m about the axis through the faces' middle; the traction grows with the distance from it.
    Twist,
    /// 1 Pa, inward.
    Pressure,
    /// 1 N along a direction that must be given, spread evenly; or along vectors of a file, spread as their lengths are, so
    /// that the sum of the forces' sizes is 1 N.
    Direction,
}

impl LoadKind {
    pub fn name(self) -> &'static str {
        match self {
            LoadKind::Stretch => "stretch",
            LoadKind::Shift => "shift",
            LoadKind::Twist => "twist",
            LoadKind::Pressure => "pressure",
            LoadKind::Direction => "direction",
        }
    }
}

/// Value of a load.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected a number, or three of them for a shift or gravity")]
pub enum LoadValue {
    One(f64),
    Three([f64; 3]),
}

impl LoadValue {
    pub fn numbers(&self) -> &[f64] {
        match self {
            LoadValue::One(value) => std::slice::from_ref(value),
            LoadValue::Three(values) => values,
        }
    }

    /// The value of one or three numbers, as text gives them: "3.0" or "0, 0, -1".
    pub fn from_numbers(numbers: &[f64]) -> Option<LoadValue> {
        match *numbers {
            [one] => Some(LoadValue::One(one)),
            [x, y, z] => Some(LoadValue::Three([x, y, z])),
            _ => None,
        }
    }
}

/// Writes the value as in a pose file.
impl std::fmt::Display for LoadValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LoadValue::One(value) => write!(f, "{value:?}"),
            LoadValue::Three(values) => write!(f, "{values:?}"),
        }
    }
}

/// `surface_compliance = { nodes = "surface" }`, or a selection.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { nodes = \"surface\" }")]
pub struct SurfaceCompliance {
    pub nodes: SurfaceNodes,
    /// Way in which hands take the surface at first; a key changes it.
    #[serde(default, skip_serializing_if = "Take::is_usual")]
    pub take: Take,
    /// Stiffness of the spring by which a hand pulls a point, N/m in the body's own metres; without it, the spring is as stiff as
    /// the point itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spring: Option<f64>,
    /// Form in which its numbers are kept in the .green file.
    #[serde(default, skip_serializing_if = "KeptForm::is_usual")]
    pub kept: KeptForm,
    /// Whether an effect needs it and the scene does not ask for it; not a key of the file.
    #[serde(skip)]
    pub is_added: bool,
}

/// `kept = "inverse"`, `kept = { error = 1e-4 }` or `kept = "factor"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum KeptForm {
    /// All numbers.
    #[default]
    Inverse,
    /// Compressed within this error, a part of how far the node itself yields.
    #[serde(rename = "error")]
    Compressed(f64),
    /// The factor, from which columns are solved when they are needed.
    Factor,
}

impl KeptForm {
    /// The errors that can be asked for: the least is what single precision holds.
    pub const ERRORS: RangeInclusive<f64> = 1e-6..=1e-2;

    fn is_usual(&self) -> bool {
        *self == KeptForm::default()
    }

    /// The error says what cannot be kept so.
    pub(super) fn check(self) -> Result<(), String> {
        match self {
            KeptForm::Compressed(error) if !KeptForm::ERRORS.contains(&error) => Err(format!(
                "kept = {{ error = {error:e} }} must lie between {:e} and {:e} of the pressed node's \
                 displacement. For less write kept = \"inverse\"",
                KeptForm::ERRORS.start(),
                KeptForm::ERRORS.end()
            )),
            _ => Ok(()),
        }
    }
}

/// Way in which a hand that points at the surface takes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Take {
    /// Control elements alone.
    #[default]
    Elements,
    /// A point, by a spring.
    Force,
    /// A point, which is then where the hand is.
    Place,
}

impl Take {
    fn is_usual(&self) -> bool {
        *self == Take::default()
    }
}

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected \"surface\", or a selection of nodes such as { group = \"inner\" }")]
pub enum SurfaceNodes {
    All(Whole),
    Some(Nodes),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Whole {
    Surface,
}

impl SurfaceNodes {
    pub fn selection(&self) -> Option<&Nodes> {
        match self {
            SurfaceNodes::All(Whole::Surface) => None,
            SurfaceNodes::Some(nodes) => Some(nodes),
        }
    }
}

/// One load of a body: what its columns are made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadSource<'a> {
    Gravity,
    Centrifugal(&'a Centrifugal),
    Thermal,
    Pattern(&'a Load),
}

/// A load with its name and what it has from the start, in the units of its columns.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadEntry<'a> {
    pub name: &'a str,
    pub source: LoadSource<'a>,
    /// A coefficient for each column: m/s² along x, y, z (of gravity in the room's axes), (rad/s)², strain, N, N·m or Pa.
    pub start: Vec<f64>,
}

impl LoadSource<'_> {
    /// Number of columns.
    pub fn columns(&self) -> usize {
        match self {
            LoadSource::Gravity => 3,
            LoadSource::Pattern(load) if load.kind == LoadKind::Shift => 3,
            _ => 1,
        }
    }
}
