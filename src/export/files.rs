//! The files into which a result set is written: either all of them, each whole, or none.

use super::batch::Outlook;
use super::exporter::{Exporter, Spread};
use super::exporters::{EXPORTERS, find_surface};
use super::result_set::ResultSet;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output::{self, Kind};
use std::path::{Path, PathBuf};

/// Files that share one name, to which each exporter appends its suffix.
pub struct Files {
    stem: PathBuf,
    /// The exporters of one file a pose that are asked for.
    surfaces: Vec<&'static Exporter>,
    poses: Vec<String>,
}

impl Files {
    /// Makes the names from the user's OUT, or OUT.csv, and the surface formats of which a file for each of `poses` is wanted.
    pub fn new(output: &Path, surfaces: &[String], poses: Vec<String>) -> Result<Files, Failure> {
        let surfaces = surfaces.iter().map(|name| find_surface(name));
        let surfaces: Vec<&Exporter> = surfaces.collect::<Result<_, _>>().map_err(Failure::wrong)?;
        for (i, pose) in poses.iter().enumerate().filter(|_| !surfaces.is_empty()) {
            if let Some(other) =
                poses[..i].iter().find(|other| *other != pose && in_name(other) == in_name(pose))
            {
                return Err(Failure::wrong(format!(
                    "poses \"{other}\" and \"{pose}\" would be written into one file: rename one"
                )));
            }
        }
        let is_csv = output.extension().is_some_and(|extension| extension == "csv");
        let stem = if is_csv { output.with_extension("") } else { output.to_owned() };
        let is_named = stem.file_name().is_some() && !output.as_os_str().as_encoded_bytes().ends_with(b"/");
        let is_special = std::fs::metadata(output).is_ok_and(|found| !found.is_file() && !found.is_dir());
        if !is_named || is_special {
            let always = EXPORTERS.iter().filter(|exporter| exporter.spread == Spread::AllPoses);
            let mut files: Vec<String> = always.map(|exporter| format!("OUT{}", exporter.suffix)).collect();
            let last = files.pop().unwrap_or_default();
            return Err(Failure::wrong(format!(
                "{}: {} and {last} are written: OUT names files in a folder, as out/part",
                output.display(),
                files.join(", ")
            )));
        }
        Ok(Files { stem, surfaces, poses })
    }

    fn path(&self, suffix: &str) -> PathBuf {
        let mut name = self.stem.clone().into_os_string();
        name.push(suffix);
        PathBuf::from(name)
    }

    /// Makes the folder and checks that everything can be written there, before anything is solved.
    pub fn try_all(&self, inputs: &[PathBuf], outlook: &Outlook) -> Result<(), Failure> {
        let always = EXPORTERS.iter().filter(|exporter| exporter.spread == Spread::AllPoses);
        for exporter in always.filter(|exporter| outlook.has(exporter.needs)) {
            let path = self.path(exporter.suffix);
            output::make_folder_of(&path)?;
            output::try_path(&path, &exporter.kind, inputs)?;
        }
        self.of_poses().try_for_each(|(exporter, _, path)| {
            output::make_folder_of(&path)?;
            Ok(output::try_path(&path, &exporter.kind, inputs)?)
        })
    }

    /// The files of one pose each.
    fn of_poses(&self) -> impl Iterator<Item = (&'static Exporter, &str, PathBuf)> {
        self.poses.iter().flat_map(move |pose| {
            let path = |exporter: &Exporter| self.path(&format!(".{}{}", in_name(pose), exporter.suffix));
            self.surfaces.iter().map(move |exporter| (*exporter, pose.as_str(), path(exporter)))
        })
    }

    /// Writes the files, and removes those of an earlier run that this run neither reads nor has results for: all of it, or
    /// nothing. Returns the paths of the files.
    pub fn write(&self, set: &ResultSet, inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
        let is_old = |path: &Path, kind: &Kind| {
            output::is(path, kind) && output::may_replace(path, kind, inputs).is_ok()
        };
        let mut written = Vec::new();
        let (mut staged, mut old) = (Vec::new(), Vec::new());
        for exporter in EXPORTERS.iter().filter(|exporter| exporter.spread == Spread::AllPoses) {
            let path = self.path(exporter.suffix);
            if !set.has(exporter.needs) {
                old.extend(is_old(&path, &exporter.kind).then_some(path));
                continue;
            }
            let contents = (exporter.write)(set);
            staged.push(output::stage(&path, &exporter.kind, |file| file.write_all(&contents))?);
            written.push(path);
        }
        let is_found = |pose: &str| set.results.iter().any(|result| result.pose == pose);
        for (exporter, pose, path) in self.of_poses() {
            if !is_found(pose) {
                old.extend(is_old(&path, &exporter.kind).then_some(path));
                continue;
            }
            let contents = (exporter.write)(&set.of_pose(pose));
            staged.push(output::stage(&path, &exporter.kind, |file| file.write_all(&contents))?);
            written.push(path);
        }
        output::put_all(staged, &old)?;
        for old in old {
            notice!(
                "note: {} is left over from an earlier run that wrote more, and is removed",
                old.display()
            );
        }
        Ok(written)
    }
}

/// A pose's name as a part of a file's name: letters, digits, '-', '_' and '.', and '-' for all else.
fn in_name(pose: &str) -> String {
    let kept = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    pose.chars().map(kept).collect()
}
