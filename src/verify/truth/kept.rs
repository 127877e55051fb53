//! Judged bodies in a file, a line of JSON for each, from which a later run goes on.
//!
//! In: the file, and bodies as they are judged. Out: the bodies that this program judged before. Lines of another build stay in the
//! file and count for nothing; a last line that was cut off is a body that was not judged.

use super::statement::JudgedBody;
use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A line of the file.
#[derive(Serialize, Deserialize)]
struct Line<T> {
    /// Hash of the program's own file, and which of its statements are judged.
    program: String,
    body: T,
}

/// The open file, and what was in it.
pub struct KeptBodies {
    program: String,
    file: Mutex<File>,
    pub bodies: Vec<JudgedBody>,
    /// Bodies that another build judged.
    pub others: usize,
}

impl KeptBodies {
    /// Opens or begins the file for bodies of which `all` statements are judged, or the ± alone; the error names a line that is no judged
    /// body.
    pub fn open(path: &Path, all: bool) -> anyhow::Result<KeptBodies> {
        let of_file = || path.display().to_string();
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .with_context(of_file)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).with_context(of_file)?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let program =
            std::env::current_exe().and_then(std::fs::read).context("reading the program's own file")?;
        let program = blake3::hash(&program).to_hex().to_string() + if all { "" } else { ", expected" };
        let (mut bodies, mut others) = (Vec::new(), 0);
        for (number, line) in bytes[..whole].split(|byte| *byte == b'\n').enumerate() {
            if line.is_empty() {
                continue;
            }
            let read = match serde_json::from_slice::<Line<serde_json::Value>>(line) {
                Ok(line) if line.program != program => Ok(None),
                Ok(line) => serde_json::from_value(line.body).map(Some),
                Err(error) => Err(error),
            };
            match read {
                Ok(Some(body)) => bodies.push(body),
                Ok(None) => others += 1,
                Err(error) => bail!(
                    "{}:{}: not a body that `verify truth` judged: {error}. Name another file, or remove the line",
                    path.display(),
                    number + 1
                ),
            }
        }
        file.set_len(whole as u64).and_then(|()| file.seek(SeekFrom::End(0))).with_context(of_file)?;
        Ok(KeptBodies { program, file: Mutex::new(file), bodies, others })
    }

    /// Appends a body.
    pub fn keep(&self, body: &JudgedBody) -> anyhow::Result<()> {
        let line = Line { program: self.program.clone(), body };
        let mut text = serde_json::to_vec(&line)?;
        text.push(b'\n');
        Ok(self.file.lock().unwrap_or_else(PoisonError::into_inner).write_all(&text)?)
    }

    pub fn has(&self, seed: u64) -> bool {
        self.bodies.iter().any(|body| body.seed == seed)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyKind, Quantity, Source, Statement};
    use super::*;

    fn body(seed: u64) -> JudgedBody {
        let statement = Statement {
            source: Source::Expected,
            quantity: Quantity::Torque,
            of: "bent 7°".into(),
            turn: 7.0,
            shown: None,
            doubt: 0.1,
            truth: 1.0 / 3.0,
        };
        JudgedBody {
            seed,
            kind: BodyKind::Thin,
            model: "reduced".into(),
            nodes: 300,
            seconds: 1.5,
            statements: vec![statement],
            left_out: vec!["bent 7°: no equilibrium".into()],
        }
    }

    /// Bodies are found again; a line that was cut off is gone, one of another build counts for nothing, and one that is no body is an
    /// error with its place.
    #[test]
    fn a_run_goes_on_from_what_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.jsonl");
        let first = KeptBodies::open(&path, true).unwrap();
        first.keep(&body(3)).unwrap();
        first.keep(&body(5)).unwrap();
        drop(first);
        let text = std::fs::read_to_string(&path).unwrap();
        let other = r#"{"program":"0","body":{"seed":3,"of an earlier":"form"}}"#;
        std::fs::write(&path, format!("{text}{other}\n{}", &text[..40])).unwrap();
        let second = KeptBodies::open(&path, true).unwrap();
        assert!(second.has(3) && second.has(5) && !second.has(4));
        assert_eq!((second.bodies.len(), second.others), (2, 1));
        assert_eq!(format!("{:?}", second.bodies[0]), format!("{:?}", body(3)));
        second.keep(&body(4)).unwrap();
        drop(second);
        assert!(KeptBodies::open(&path, true).unwrap().has(4));
        let alone = KeptBodies::open(&path, false).unwrap();
        assert_eq!(
            (alone.bodies.len(), alone.others),
            (0, 4),
            "bodies of which the ± alone is judged are others"
        );
        std::fs::write(&path, format!("{text}no body\n")).unwrap();
        let error = KeptBodies::open(&path, true).err().unwrap().to_string();
        assert!(error.contains("truth.jsonl:3: not a body"), "{error}");
    }
}
