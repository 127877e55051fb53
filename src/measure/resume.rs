//! Results of finished steps in a separate folder: the same command goes on from there after Ctrl-C or a kill.
//!
//! In: the bytes of finished steps. Out: the same bytes in a later run of the same scene, poses, limits and program on the same
//! machine; everything else begins anew. A file is there whole or not at all, and a damaged one is measured again. A solved body
//! is kept without its mesh, which is made again.

use super::request::Request;
use crate::base::cache;
use crate::base::machine::{self, load};
use crate::fem::NodeFields;
use crate::green::{
    self, CUBIC, PRESSED_POINTS, QUARTIC, RADIUS, REDUCED_FIELDS, RigidMotion, SERIES, STIFFNESS, Solution,
    StepTimes, VOLUME_FORMS, substructure,
};
use crate::mesh::Surface;
use crate::scene::Scene;
use crate::solve::{Method, NO_UNKNOWNS, SolveStats};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The folder of an unfinished run, below the report's.
pub const FOLDER: &str = "unfinished";
const RUN: &str = "run.txt";
const SUFFIX: &str = "step";
const HASH: usize = blake3::OUT_LEN;

pub struct Kept {
    folder: PathBuf,
}

/// A finished step of an earlier run.
pub struct Old {
    pub bytes: Vec<u8>,
    /// The load of the machine then.
    pub load: f64,
}

impl Kept {
    /// The folder for this request, and a sentence where steps of another run were removed from it.
    pub fn open(folder: &Path, request: &Request<'_>) -> std::io::Result<(Kept, Option<String>)> {
        std::fs::create_dir_all(folder)?;
        let (run, machine) = (folder.join(RUN), machine::description());
        let own = format!("{}\n{machine}\n", fingerprint(request));
        let mut told = None;
        match std::fs::read_to_string(&run) {
            Ok(text) if text == own => {}
            Ok(text) => {
                let other = text.lines().nth(1).unwrap_or_default();
                let what = if other == machine || other.is_empty() {
                    "another scene, other poses or options, or another version of the program".to_owned()
                } else {
                    format!("another machine ({other}), whose times do not hold here")
                };
                told =
                    Some(format!("What {} holds is of {what}: measuring starts afresh.", folder.display()));
                remove(folder);
                std::fs::create_dir_all(folder)?;
                std::fs::write(&run, own)?;
            }
            Err(_) => std::fs::write(&run, own)?,
        }
        Ok((Kept { folder: folder.to_owned() }, told))
    }

    fn path(&self, key: &str) -> PathBuf {
        let name = blake3::hash(key.as_bytes()).to_hex();
        self.folder.join(format!("{}.{SUFFIX}", &name[..24]))
    }

    /// `None` where it is not there, or damaged.
    pub fn find(&self, key: &str) -> Option<Old> {
        let file = std::fs::read(self.path(key)).ok()?;
        let (hash, rest) = file.split_at_checked(HASH)?;
        if blake3::hash(rest).as_bytes() != hash {
            return None;
        }
        let (load, bytes) = rest.split_at_checked(8)?;
        Some(Old { load: f64::from_le_bytes(load.try_into().ok()?), bytes: bytes.to_vec() })
    }

    /// Keeps a step. A full disk stops nothing: the step is then measured again.
    pub fn keep(&self, key: &str, bytes: &[u8]) {
        let mut rest = Vec::with_capacity(8 + bytes.len());
        rest.extend(load().to_le_bytes());
        rest.extend(bytes);
        let (path, hash) = (self.path(key), blake3::hash(&rest));
        let beside = path.with_extension("part");
        let written = std::fs::write(&beside, [hash.as_bytes(), &rest[..]].concat())
            .and_then(|()| std::fs::rename(&beside, &path));
        if let Err(error) = written {
            tracing::debug!("{}: not kept: {error}", path.display());
        }
    }
}

/// Removes what `Kept` wrote in a folder, and the folder where nothing else is in it.
pub fn remove(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_own = |name: &str| {
            name == RUN || [SUFFIX, "part"].iter().any(|end| path.extension().is_some_and(|e| e == *end))
        };
        if path.file_name().and_then(|name| name.to_str()).is_some_and(is_own) {
            // What cannot be removed is found out of date or overwritten by the next run.
            let _ = std::fs::remove_file(&path);
        }
    }
    let _ = std::fs::remove_dir(folder);
}

/// A hash of all that the numbers depend on: body, poses, limits, and the program's file.
fn fingerprint(request: &Request<'_>) -> String {
    let name = request.body;
    let requirements = (request.requirements_of)(request.scene);
    let body = green::fingerprint(request.scene, name, &requirements).unwrap_or_default();
    let settings = &request.scene.body[name];
    let text = format!(
        "{body} {} {} {:?} {:?} {} {} {:?} {:?}",
        env!("CARGO_PKG_VERSION"),
        cache::program().unwrap_or_default(),
        request.poses,
        request.limits,
        request.quick,
        request.packs,
        settings.effects,
        settings.model,
    );
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// The tables that a solution may hold.
fn known_tables() -> impl Iterator<Item = &'static str> {
    let own =
        [STIFFNESS.name, CUBIC.name, QUARTIC, VOLUME_FORMS, PRESSED_POINTS, REDUCED_FIELDS, SERIES, RADIUS];
    own.into_iter().chain(substructure::TABLES)
}

/// A solution without its numbers.
#[derive(Serialize, Deserialize)]
struct Head {
    columns: usize,
    /// Name, rows, columns.
    tables: Vec<(String, usize, usize)>,
    asymmetry: Option<f64>,
    rigid: RigidMotion,
    /// With a method of the list where there were no unknowns, because no list has [`NO_UNKNOWNS`].
    stats: SolveStats,
    is_without_unknowns: bool,
    times: StepTimes,
    matrix_entries: usize,
}

/// A solution as bytes; `None` where a table is not known here.
pub fn write(solution: &Solution) -> Option<Vec<u8>> {
    let Solution { fields, tables, .. } = solution;
    if tables.keys().any(|name| !known_tables().any(|known| known == *name)) {
        return None;
    }
    let mut stats = solution.stats.clone();
    let is_without_unknowns = stats.method.name == NO_UNKNOWNS.name;
    if is_without_unknowns {
        stats.method = <&'static Method>::default();
    }
    let head = Head {
        columns: fields.columns,
        tables: tables
            .iter()
            .map(|(name, table)| ((*name).to_owned(), table.nrows(), table.ncols()))
            .collect(),
        asymmetry: solution.asymmetry,
        rigid: solution.rigid,
        stats,
        is_without_unknowns,
        times: solution.times.clone(),
        matrix_entries: solution.matrix_entries,
    };
    let head = serde_json::to_vec(&head).ok()?;
    let mut bytes = (head.len() as u64).to_le_bytes().to_vec();
    bytes.extend(head);
    let numbers = fields.data.iter().chain(tables.values().flat_map(|table| table.iter()));
    bytes.extend(numbers.flat_map(|number| number.to_le_bytes()));
    Some(bytes)
}

/// The solution of a scene's body that [`write()`] wrote; `None` where the bytes are not of this body.
pub fn read(scene: &Scene, body: &str, bytes: &[u8]) -> Option<Solution> {
    let (length, rest) = bytes.split_at_checked(8)?;
    let length = usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?;
    let (head, rest) = rest.split_at_checked(length)?;
    let mut head: Head = serde_json::from_slice(head).ok()?;
    if head.is_without_unknowns {
        head.stats.method = &NO_UNKNOWNS;
    }
    let prepared = green::prepare(scene, body).ok()?;
    let nodes = prepared.mesh.nodes.len();
    let mut numbers =
        rest.chunks_exact(8).map(|number| f64::from_le_bytes(number.try_into().unwrap_or_default()));
    let mut take = |count: usize| -> Option<Vec<f64>> {
        let taken: Vec<f64> = numbers.by_ref().take(count).collect();
        (taken.len() == count).then_some(taken)
    };
    let fields = NodeFields { nodes, columns: head.columns, data: take(3 * nodes * head.columns)? };
    let mut tables = BTreeMap::new();
    for (name, rows, columns) in &head.tables {
        let name = known_tables().find(|known| known == name)?;
        tables.insert(name, DMatrix::from_vec(*rows, *columns, take(rows * columns)?));
    }
    if take(1).is_some() {
        return None;
    }
    let own = &scene.body[body];
    Some(Solution {
        element: own.element,
        method: own.method,
        surface: Surface::from_mesh(&prepared.mesh),
        mesh: prepared.mesh,
        controls: prepared.controls,
        fields,
        tables,
        loads: Vec::new(),
        compliance: None,
        kept_factor: None,
        compressed: None,
        asymmetry: head.asymmetry,
        rigid: head.rigid,
        stats: head.stats,
        times: head.times,
        matrix_entries: head.matrix_entries,
        notices: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::green::{AFFINE, Requirements};
    use crate::solve::Silent;
    use std::path::Path;

    /// A block of one cell, whose nodes are all held, has no unknowns.
    #[test]
    fn a_solution_is_read_as_it_was_written() {
        for cells in [1, 2] {
            let scene = format!(
                "[body.b]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [{cells}, 1, 1] }} }}\n\
                 material = {{ young = 1e6, poisson = 0.3 }}\n\
                 control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
                 control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"fixed\" }}\n"
            );
            let scene = Scene::parse(&scene, Path::new("block.toml")).unwrap();
            let solution = green::solve(&scene, "b", &Requirements::new(&[AFFINE]), &Silent).unwrap();
            assert_eq!(solution.stats.method.name == NO_UNKNOWNS.name, cells == 1);
            let bytes = write(&solution).unwrap();
            let again = read(&scene, "b", &bytes).unwrap();
            assert_eq!((again.fields.data, again.stats), (solution.fields.data, solution.stats));
            assert!(read(&scene, "b", &bytes[..bytes.len() - 8]).is_none());
        }
    }
}
