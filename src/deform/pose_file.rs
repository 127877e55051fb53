//! The pose file of `greenstage deform`: `[[pose]]` tables in TOML.

pub use super::loads::pose_loads::{PointForce, PoseLoads};
use super::{COMPONENTS, ControlPose, ControlPoses, Freedom, ModelEntry, Screw};
use crate::base::failure::Failure;
use crate::config;
use crate::scene::{Body, LARGEST_NUMBER, LoadValue, Updates};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use toml::Spanned;

/// Two control elements turned against each other by more, rad, may have been meant to be turned the other way.
const DOUBTFUL: f64 = 150.0 * std::f64::consts::PI / 180.0;

/// A matrix is flat up to this determinant, beside the cube of its size.
const FLAT: f64 = 1e-12;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseFile {
    pose: Vec<Pose>,
}

/// One pose of one body; control elements that it does not name are at rest.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    pub name: String,
    /// Name of the body; may be left out where the scene has one.
    pub body: Option<String>,
    /// The pose of the same body that this one goes on from; rest, where there is none.
    after: Option<Spanned<String>>,
    /// Index of that pose in the file.
    #[serde(skip)]
    pub goes_on_from: Option<usize>,
    #[serde(default)]
    pub control: BTreeMap<String, Affine>,
    /// Values of the body's loads in this pose; loads that it does not name are as the scene has them.
    #[serde(default)]
    load: BTreeMap<String, LoadValue>,
    /// Forces at single points, with the body's `surface_compliance`.
    #[serde(default)]
    force: Vec<Spanned<PointForce>>,
    /// Line and column of each of them.
    #[serde(skip)]
    force_places: Vec<(usize, usize)>,
}

/// x ↦ o + translation + matrix · (x - o).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Affine {
    #[serde(default)]
    pub translation: [f64; 3],
    matrix: Option<Spanned<[[f64; 3]; 3]>>,
    /// Shifts and turns that are found, not given.
    free: Option<Free>,
    /// Force and moment that push it where it is free, N and N·m, along the body's axes; alone they free it in every direction.
    force: Option<[f64; 3]>,
    moment: Option<[f64; 3]>,
}

impl Pose {
    /// Whether a control element is free in something, so that its pose is found.
    pub fn finds(&self) -> bool {
        let of = |affine: &Affine| affine.free.is_some() || affine.force.is_some() || affine.moment.is_some();
        self.control.values().any(of)
    }

    /// Keys of the pose beside the motion of its control elements, as words for a message; `None` where there are none.
    pub fn beyond_motion(&self) -> Option<&'static str> {
        match () {
            () if self.after.is_some() => Some("goes on from another (`after`)"),
            () if self.finds() => Some("has free directions or is pushed (`free`, `force`, `moment`)"),
            () if !self.load.is_empty() => Some("has loads (`load`)"),
            () if !self.force.is_empty() => Some("has forces at points (`force`)"),
            () => None,
        }
    }
}

/// A list of x, y, z, rx, ry, rz, `translation` and `rotation`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Vec<String>")]
struct Free([bool; 6]);

impl TryFrom<Vec<String>> for Free {
    type Error = String;

    fn try_from(names: Vec<String>) -> Result<Free, String> {
        let mut free = [false; 6];
        for name in &names {
            match (name.as_str(), COMPONENTS.iter().position(|known| known == name)) {
                ("translation", _) => free[..3].fill(true),
                ("rotation", _) => free[3..].fill(true),
                (_, Some(place)) => free[place] = true,
                _ => {
                    let known = ["translation", "rotation"].into_iter().chain(COMPONENTS);
                    return Err(config::unknown_name("free direction", name, known));
                }
            }
        }
        Ok(Free(free))
    }
}

impl Affine {
    /// M, its rows.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        self.matrix.as_ref().map_or_else(identity, |matrix| *matrix.get_ref())
    }

    /// Offset of M in the file and its fault: with det M ≤ 0 it mirrors or flattens the nodes, which no motion of a body does.
    fn improper(&self) -> Option<(usize, String)> {
        let matrix = self.matrix.as_ref()?;
        let rows = matrix.get_ref();
        let m = Matrix3::from_fn(|i, j| rows[i][j]);
        let determinant = m.determinant();
        // What is not finite is refused with all numbers.
        let rounding = FLAT * m.norm().powi(3);
        if !determinant.is_finite() || determinant > rounding {
            return None;
        }
        let (value, does) = match determinant < -rounding {
            true => (format!("{determinant:.3}"), "turns the body inside out, as a mirror does"),
            false => ("0".to_owned(), "flattens the body"),
        };
        let message = format!(
            "its matrix has the determinant {value} and {does}: no motion does that; a turn has the determinant 1, look at the \
             signs"
        );
        Some((matrix.span().start, message))
    }

    /// The directions in which the element is free; the error names what is given and free at once, or pushed and held.
    fn freedom(&self) -> Result<Freedom, String> {
        let pushed = self.force.is_some() || self.moment.is_some();
        let free = self.free.map_or([pushed; 6], |free| free.0);
        let (force, moment) = (self.force.unwrap_or_default(), self.moment.unwrap_or_default());
        let load: [f64; 6] = std::array::from_fn(|k| if k < 3 { force[k] } else { moment[k - 3] });
        for (k, name) in COMPONENTS.into_iter().enumerate() {
            if load[k] != 0.0 && !free[k] {
                let what = if k < 3 { "force" } else { "moment" };
                return Err(format!(
                    "a {what} pushes along {name}, in which it is held: add \"{name}\" to free, or leave the {what} out"
                ));
            }
            if k < 3 && free[k] && self.translation[k] != 0.0 {
                return Err(format!(
                    "{name} is free, and its translation is found: leave {:e} out, or \"{name}\" out of free",
                    self.translation[k]
                ));
            }
        }
        if !load.iter().all(|value| value.abs() <= LARGEST_NUMBER) {
            return Err(format!("a force is not finite, or above {LARGEST_NUMBER:e}"));
        }
        if free[3..] == [true; 3] && self.matrix() != identity() {
            return Err("its rotation is free, and found: leave the matrix out".to_owned());
        }
        Ok(Freedom { free, load })
    }
}

fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// Reads the pose file.
pub fn load(path: &Path) -> Result<Vec<Pose>, Failure> {
    let text = config::read(path)?;
    parse(&text, path)
}

/// Checks the text of a pose file; `path` is only named in errors.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Pose>, Failure> {
    let mut poses = config::parse::<PoseFile>(text, path)?.pose;
    if poses.is_empty() {
        return Err(Failure::wrong(format!(
            "{}: has no pose; write a table [[pose]] for each",
            path.display()
        )));
    }
    // A pose that names no body is for the only one that there is.
    let mut known: BTreeMap<&str, BTreeSet<Option<&str>>> = BTreeMap::new();
    for pose in &poses {
        let bodies = known.entry(&pose.name).or_default();
        let is_known = bodies.contains(&None) || (pose.body.is_none() && !bodies.is_empty());
        if !bodies.insert(pose.body.as_deref()) || is_known {
            return Err(Failure::wrong(format!(
                "{}: two poses are called \"{}\"",
                path.display(),
                pose.name
            )));
        }
    }
    for place in 0..poses.len() {
        let at = |(offset, message): (usize, String)| {
            let (line, column) = config::line_and_column(text, offset);
            Failure::wrong(format!("{}:{line}:{column}: {message}", path.display()))
        };
        let line = |force: &Spanned<PointForce>| config::line_and_column(text, force.span().start);
        poses[place].force_places = poses[place].force.iter().map(line).collect();
        poses[place].goes_on_from = goes_on_from(&poses, place).map_err(at)?;
        let improper = |(name, affine): (&String, &Affine)| {
            let (offset, why) = affine.improper()?;
            Some(at((offset, format!("pose \"{}\": control {name}: {why}", poses[place].name))))
        };
        poses[place].control.iter().find_map(improper).map_or(Ok(()), Err)?;
    }
    Ok(poses)
}

/// Index of the pose that pose `place` goes on from: before it, so that none goes on from itself.
fn goes_on_from(poses: &[Pose], place: usize) -> Result<Option<usize>, (usize, String)> {
    let pose = &poses[place];
    let Some(after) = &pose.after else { return Ok(None) };
    let name = after.get_ref();
    let wrong = |message: String| Err((after.span().start, message));
    let same_body = |other: &Pose| other.body == pose.body || other.body.is_none() || pose.body.is_none();
    let found = poses.iter().position(|other| other.name == *name && same_body(other));
    match found {
        Some(before) if before < place => Ok(Some(before)),
        Some(itself) if itself == place => wrong(format!("pose \"{name}\" cannot go on from itself")),
        Some(_) => wrong(format!(
            "pose \"{}\" goes on from \"{name}\", which stands further down. Move \"{name}\" up, unless it \
             goes on from \"{}\"",
            pose.name, pose.name
        )),
        None if poses.iter().any(|other| other.name == *name) => {
            wrong(format!("pose \"{}\" is of another body than \"{name}\"", pose.name))
        }
        None => wrong(config::unknown_name("pose", name, poses.iter().map(|pose| pose.name.as_str()))),
    }
}

/// The poses of all control elements of the body called `name`, in its order.
pub fn control_poses(pose: &Pose, name: &str, body: &Body, path: &Path) -> Result<ControlPoses, Failure> {
    let entity = |message: String| {
        Failure::wrong(format!("{}: pose \"{}\": body.{}: {message}", path.display(), pose.name, name))
    };
    for control in pose.control.keys() {
        if body.updates.iter().flat_map(Updates::loose).any(|loose| loose == control) {
            let message =
                format!("control {control} is released and holds nothing: leave it out of the pose");
            return Err(entity(message));
        }
        if !body.control.contains_key(control) {
            let known = body.control.keys().map(String::as_str);
            return Err(entity(config::unknown_name("control element", control, known)));
        }
    }
    body.control
        .keys()
        .map(|control| {
            let Some(affine) = pose.control.get(control) else { return Ok(ControlPose::REST) };
            let m = affine.matrix();
            let pose = ControlPose {
                translation: Vector3::from(affine.translation),
                matrix: Matrix3::from_fn(|i, j| m[i][j]),
            };
            let numbers = pose.translation.iter().chain(pose.matrix.iter());
            if !numbers.into_iter().all(|value| value.abs() <= LARGEST_NUMBER) {
                let message =
                    format!("control {control}: a number is not finite, or above {LARGEST_NUMBER:e}");
                return Err(entity(message));
            }
            Ok(pose)
        })
        .collect()
}

/// The loads of a pose of the body called `name`: those of the scene, but for what the pose says. A body without loads has none.
pub fn loads(
    pose: &Pose,
    (name, body): (&str, &Body),
    model: &ModelEntry,
    path: &Path,
) -> Result<PoseLoads, Failure> {
    let wrong = |message: String| {
        Failure::wrong(format!("{}: pose \"{}\": body.{name}: {message}", path.display(), pose.name))
    };
    let place = |&(line, column): &(usize, usize)| format!("{}:{line}:{column}", path.display());
    let forces = pose.force.iter().map(|force| *force.get_ref()).zip(pose.force_places.iter().map(place));
    let loads = PoseLoads::of_pose(&pose.load, name, body);
    loads.and_then(|loads| loads.with_forces(forces.collect(), body, model)).map_err(wrong)
}

/// Freedom in the pose of each control element of the body called `name`, in its order; empty where none is free.
pub fn freedom(pose: &Pose, name: &str, body: &Body, path: &Path) -> Result<Vec<Freedom>, Failure> {
    let of = |control: &String| match pose.control.get(control) {
        None => Ok(Freedom::default()),
        Some(affine) => affine.freedom().map_err(|message| {
            let (path, pose) = (path.display(), &pose.name);
            Failure::wrong(format!("{path}: pose \"{pose}\": body.{name}: control {control}: {message}"))
        }),
    };
    let found: Vec<Freedom> = body.control.keys().map(of).collect::<Result<_, _>>()?;
    let is_loose = |k: &usize| found.iter().all(|of| of.free[*k]);
    if let (Some(k), Some(last)) = ((0..3).find(is_loose), body.control.keys().last()) {
        let along = COMPONENTS[k];
        return Err(Failure::wrong(format!(
            "{}: pose \"{}\": body.{name}: every control element is free in {along}, and the body moves there without a force: \
             leave \"{along}\" out of free of {last}, or of another",
            path.display(),
            pose.name
        )));
    }
    Ok(if found.iter().any(Freedom::is_any) { found } else { Vec::new() })
}

/// Description of the turn that was taken, where two control elements of `body` are turned so far against each other that their
/// matrices, which are the same after whole turns, leave a doubt.
pub fn doubtful_turn(poses: &ControlPoses, body: &Body) -> Option<String> {
    let turns: Vec<Vector3<f64>> = poses.iter().map(|pose| Screw::from_pose(pose).turn).collect();
    let pairs = (0..turns.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let apart = |&(i, j): &(usize, usize)| (turns[i] - turns[j]).norm();
    let (i, j) = pairs.max_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    let angle = apart(&(i, j));
    // The one that is turned further from rest is told.
    let (turned, other) = if turns[i].norm() >= turns[j].norm() { (i, j) } else { (j, i) };
    let name = |e: usize| body.control.keys().nth(e).map_or("", String::as_str);
    (angle > DOUBTFUL).then(|| {
        let degrees = angle.to_degrees();
        format!(
            "control element {} is turned by {degrees:.1}° against {}, by the shorter turn; {:.1}° the other \
             way has the same matrices. For that way add a pose half way, and `after`",
            name(turned),
            name(other),
            360.0 - degrees
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use proptest::prelude::*;

    const GOOD: &str =
        "[[pose]]\nname = \"a\"\ncontrol.c = { translation = [0.1, 0, 0] }\n[[pose]]\nname = \"b\"\n";

    #[test]
    fn what_is_absent_is_at_rest() {
        let poses = parse(GOOD, Path::new("poses.toml")).unwrap();
        assert_eq!(poses[0].control["c"].matrix(), identity());
        assert!(poses[1].control.is_empty());
    }

    #[test]
    fn a_pose_in_which_nothing_is_held_along_an_axis_is_refused_with_a_name() {
        let text = "[body.a]\ngenerate = { block = { size = [1, 1, 1], cells = [2, 2, 2] } }\n\
                    material = { young = 1.0, poisson = 0.0 }\n\
                    control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let scene = Scene::parse(text, Path::new("any.toml")).unwrap();
        let found = |low: &str| {
            let text = format!(
                "[[pose]]\nname = \"p\"\ncontrol.low = {{ free = [\"{low}\"] }}\ncontrol.high = {{ free = [\"x\"] }}\n"
            );
            let poses = parse(&text, Path::new("poses.toml")).unwrap();
            freedom(&poses[0], "a", &scene.body["a"], Path::new("poses.toml"))
                .map_err(|error| error.to_string())
        };
        assert!(found("y").is_ok());
        let why = found("translation").unwrap_err();
        assert!(why.contains("every control element is free in x") && why.contains("of high"), "{why}");
    }

    /// `deform` wrote files without a result, which it then took for another program's.
    #[test]
    fn a_file_without_a_pose_is_refused() {
        assert!(told("pose = []").starts_with("poses.toml: has no pose"));
    }

    fn told(text: &str) -> String {
        parse(text, Path::new("poses.toml")).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn a_pose_goes_on_from_one_above_it_of_its_body() {
        let poses = |text: &str| parse(text, Path::new("poses.toml")).unwrap();
        let found = poses(
            "pose = [{ name = \"a\" }, { name = \"b\", after = \"a\" }, { name = \"c\", after = \"b\" }]",
        );
        assert_eq!([0, 1, 2].map(|i| found[i].goes_on_from), [None, Some(0), Some(1)]);
        let both = "[[pose]]\nname = \"a\"\nbody = \"x\"\n[[pose]]\nname = \"a\"\nbody = \"y\"\n";
        let found = poses(&format!("{both}[[pose]]\nname = \"b\"\nbody = \"y\"\nafter = \"a\"\n"));
        assert_eq!(found[2].goes_on_from, Some(1));
        let other = told(&format!("{both}[[pose]]\nname = \"b\"\nbody = \"z\"\nafter = \"a\"\n"));
        assert_eq!(other, "poses.toml:10:9: pose \"b\" is of another body than \"a\"");
    }

    #[test]
    fn a_pose_that_goes_on_from_none_is_refused_with_its_line() {
        let two = |a: &str, b: &str| format!("[[pose]]\nname = \"a\"\n{a}\n[[pose]]\nname = \"b\"\n{b}\n");
        assert_eq!(told(&two("", "after = \"b\"")), "poses.toml:6:9: pose \"b\" cannot go on from itself");
        let ahead = told(&two("after = \"b\"", "after = \"a\""));
        assert!(
            ahead.starts_with("poses.toml:3:9: pose \"a\" goes on from \"b\", which stands further"),
            "{ahead}"
        );
        let unknown = told(&two("", "after = \"A\""));
        assert_eq!(unknown, "poses.toml:6:9: unknown pose \"A\" (known: a, b)");
        assert!(
            told(&two("", "after = 3")).starts_with("poses.toml:6:9: invalid type"),
            "{}",
            told(&two("", "after = 3"))
        );
    }

    /// A reflection has the determinant -1, a half turn about z 1; diag(1, 1, 0) leaves nothing along z.
    #[test]
    fn a_matrix_that_mirrors_or_flattens_is_refused_with_its_line() {
        let of = |rows: &str| told(&format!("[[pose]]\nname = \"a\"\ncontrol.c = {{ matrix = {rows} }}\n"));
        for proper in [
            "[[-1, 0, 0], [0, -1, 0], [0, 0, 1]]",
            "[[0, 1, 0], [0, 0, 1], [1, 0, 0]]",
            "[[1e-3, 0, 0], [0, 1, 0], [0, 0, 1]]",
        ] {
            assert_eq!(of(proper), "");
        }
        let mirrored = of("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]");
        assert!(
            mirrored.starts_with(
                "poses.toml:3:24: pose \"a\": control c: its matrix has the determinant -1.000 and turns"
            ),
            "{mirrored}"
        );
        for flat in ["[[1, 0, 0], [0, 1, 0], [0, 0, 0]]", "[[0.1, 0.2, 0.3], [0.2, 0.4, 0.6], [0, 0, 1]]"] {
            assert!(of(flat).contains("flattens the body"), "{}", of(flat));
        }
        assert_eq!(of("[[nan, 0, 0], [0, 1, 0], [0, 0, 1]]"), "", "refused where all numbers are looked at");
    }

    #[test]
    fn every_force_knows_its_line() {
        let lines = |text: &str| -> Vec<usize> {
            let poses = parse(text, Path::new("poses.toml")).unwrap();
            poses[0].force_places.iter().map(|(line, _)| *line).collect()
        };
        let one = "{ node = 1, force = [0, 0, 1] }";
        assert_eq!(lines(&format!("[[pose]]\nname = \"a\"\nforce = [\n  {one},\n  {one},\n]\n")), [4, 5]);
        let table = "[[pose.force]]\nnode = 1\nforce = [0, 0, 1]\n";
        assert_eq!(lines(&format!("[[pose]]\nname = \"a\"\n{table}{table}")), [3, 6]);
    }

    #[test]
    fn a_released_element_is_not_called_unknown() {
        let scene = "[body.a]\ngenerate = { block = { size = [1, 1, 1], cells = [2, 2, 2] } }\n\
                     material = { young = 1.0, poisson = 0.0 }\n\
                     updates = { release = [\"c\"], released = [\"c\"] }\n\
                     control.b = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                     control.c = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let scene = crate::scene::Scene::parse(scene, Path::new("scene.toml")).unwrap();
        let poses = parse(GOOD, Path::new("poses.toml")).unwrap();
        let error = control_poses(&poses[0], "a", &scene.body["a"], Path::new("poses.toml")).unwrap_err();
        assert!(error.to_string().contains("control c is released"), "{error}");
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in ".*", at in 0..GOOD.len(), cut in any::<bool>()) {
            let rest = if cut { "" } else { &GOOD[at..] };
            for text in [text.clone(), format!("{}{text}{rest}", &GOOD[..at])] {
                if let Err(failure) = parse(&text, Path::new("poses.toml")) {
                    prop_assert!(failure.to_string().contains("poses.toml"), "{failure}");
                }
            }
        }
    }
}
