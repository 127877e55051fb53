//! A precomputation that is killed goes on in the next run, and ends with the bytes of one that was not.

use crate::common::{folder, program, text};
use greenstage::base::progress::Progress;
use greenstage::green::journal_path;
use greenstage::prepare::{self, Resolved};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Three control elements, 36 columns: of conjugate gradients they are two groups.
fn scene(solver: &str) -> String {
    format!(
        r#"
[body.block]
generate = {{ block = {{ size = [1.0, 1.0, 1.0], cells = [4, 3, 3] }} }}
material = {{ young = 1.0e3, poisson = 0.3, density = 1.0e3 }}
solver = {{ method = "{solver}" }}
surface_compliance = {{ nodes = {{ group = "zmax" }} }}
gravity = true
control.high = {{ nodes = {{ group = "xmax" }}, grab = "dragger" }}
control.low = {{ nodes = {{ group = "xmin" }}, grab = "fixed" }}
control.below = {{ nodes = {{ box = {{ min = [-0.3, -0.6, -0.3], max = [0.3, -0.4, 0.3] }} }}, grab = "dragger" }}
"#
    )
}

/// Numbers between 0 and 1, always the same ones.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

/// Keeps the journal as it is when a step ends, and the progress.
struct Watch {
    part: PathBuf,
    seen: Arc<Mutex<(Vec<u8>, String)>>,
}

impl Progress for Watch {
    fn begin(&self, _step: &str, _units: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {
        self.seen.lock().unwrap().0 = std::fs::read(&self.part).unwrap_or_default();
    }
    fn tell(&self, sentence: &str) {
        self.seen.lock().unwrap().1.push_str(sentence);
    }
}

/// Bytes of the .green file, those of the journal at the end, and the progress.
fn made(path: &Path) -> (Vec<u8>, Vec<u8>, String) {
    let scene = Resolved::load(path).unwrap();
    let green = path.with_extension("green");
    let part = journal_path(&green);
    let _ = std::fs::remove_file(&green);
    let seen = Arc::default();
    let teller =
        |_: &str| -> Box<dyn Progress> { Box::new(Watch { part: part.clone(), seen: Arc::clone(&seen) }) };
    prepare::make(&scene, &green, (Duration::ZERO, false), &teller).unwrap();
    assert!(!part.exists(), "the journal is gone");
    let (journal, told) = std::mem::take(&mut *seen.lock().unwrap());
    (std::fs::read(green).unwrap(), journal, told)
}

#[test]
fn a_journal_cut_at_a_hundred_places_leads_to_the_same_bytes() {
    let mut state = 1;
    for (solver, cuts) in [("pcg", 60), ("cholesky", 20), ("mixed", 20)] {
        let folder = folder(&format!("kills-{solver}"));
        let path = folder.join("scene.toml");
        std::fs::write(&path, scene(solver)).unwrap();
        let (whole, journal, told) = made(&path);
        assert!(!told.contains("resumes"), "{told}");
        assert!(journal.len() > 20_000, "{}", journal.len());
        let part = journal_path(&path.with_extension("green"));
        let mut resumed = [0, 0];
        for cut in 0..=cuts {
            // The last is not cut.
            let length = if cut == cuts {
                journal.len()
            } else {
                (random(&mut state) * journal.len() as f64) as usize
            };
            std::fs::write(&part, &journal[..length]).unwrap();
            let (bytes, _, told) = made(&path);
            assert!(bytes == whole, "{solver}: {length} of {} bytes", journal.len());
            resumed[0] += usize::from(told.contains("resumes: 24 of 36 columns were there"));
            resumed[1] += usize::from(told.contains("resumes: 36 of 36 columns were there"));
        }
        assert!(resumed[1] > cuts / 4 && (resumed[0] > 0 || solver != "pcg"), "{solver}: {resumed:?}");
    }
}

#[test]
fn a_run_that_is_killed_is_taken_up() {
    let folder = folder("kills-real");
    std::fs::write(folder.join("scene.toml"), scene("pcg")).unwrap();
    let [green, part] = ["scene.green", "scene.green.part"].map(|name| folder.join(name));
    let run = || {
        let mut command = program(&folder, &["precompute", "scene.toml", "--keep-after", "0"]);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    };
    let started = Instant::now();
    assert!(run().status().unwrap().success());
    let whole_s = started.elapsed().as_secs_f64();
    let whole = std::fs::read(&green).unwrap();
    let (mut state, mut resumed) = (7, 0);
    for kill in 0.. {
        if kill >= 12 && resumed > 0 {
            break;
        }
        assert!(kill < 60, "never taken up");
        std::fs::remove_file(&green).unwrap();
        let mut child = run().spawn().unwrap();
        if kill % 2 == 0 {
            // Anywhere.
            std::thread::sleep(Duration::from_secs_f64(whole_s * (0.2 + 0.8 * random(&mut state))));
        } else {
            // As soon as some columns are kept.
            let has_columns = || std::fs::metadata(&part).is_ok_and(|file| file.len() > 4096);
            while !has_columns() && child.try_wait().unwrap().is_none() {
                std::thread::yield_now();
            }
        }
        child.kill().unwrap();
        child.wait().unwrap();
        // A run that had ended by then has left the whole file.
        assert!(!green.exists() || std::fs::read(&green).unwrap() == whole);
        let output = run().output().unwrap();
        let told = text(&output.stderr);
        assert!(output.status.success(), "{told}");
        resumed += usize::from(told.contains("taken up"));
        assert!(std::fs::read(&green).unwrap() == whole, "after {kill} kills: {told}");
        assert!(!part.exists());
    }
    // Another state of the scene does not take them.
    std::fs::remove_file(&green).unwrap();
    std::fs::write(&part, [&b"greenstage columns, format 1\n"[..], &[0; 32], b"rest"].concat()).unwrap();
    let told = text(&run().output().unwrap().stderr);
    assert!(told.contains("is dropped: it belongs to another state of the scene"), "{told}");
    assert!(std::fs::read(&green).unwrap() == whole && !part.exists());
}

/// Adding an effect took the whole precomputation again: the equilibria of the body are kept from one to the next, and lead to the
/// same bytes.
#[test]
fn a_body_with_one_more_effect_takes_up_its_equilibria() {
    let folder = folder("kills-equilibria");
    let scene = |effects: &str| {
        format!(
            "[body.block]\ngenerate = {{ block = {{ size = [0.3, 0.1, 0.1], cells = [6, 2, 2] }} }}\nmodel = \"reduced\"\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\neffects = [{effects}]\n\
             control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        )
    };
    let made = |effects: &str, further: &[&str]| {
        std::fs::write(folder.join("scene.toml"), scene(effects)).unwrap();
        let arguments = [&["precompute", "scene.toml", "--keep-after", "0"], further].concat();
        let output =
            program(&folder, &arguments).env("XDG_CACHE_HOME", folder.join("cache")).output().unwrap();
        let told = text(&output.stderr);
        assert!(output.status.success(), "{told}");
        (
            std::fs::read(folder.join("scene.green")).unwrap(),
            told.contains("resumes: the equilibria on 47 of 47 paths"),
        )
    };
    assert!(!made("", &[]).1, "nothing was there");
    let (taken_up, is_told) = made("\"stress\"", &[]);
    assert!(is_told);
    let (anew, is_told) = made("\"stress\"", &["--force"]);
    assert!(!is_told && anew == taken_up, "the same bytes without them");
}
