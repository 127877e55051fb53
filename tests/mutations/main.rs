//! Millions of damaged files for every reader: none may make one panic, take a second, or take memory beyond the
//! file's own size.
//!
//! Input number n is the same on every machine and in every run: a small good file, changed in a few places by random
//! numbers that follow from n. `GREENSTAGE_MUTATIONS` says how many inputs there are; `GREENSTAGE_MUTATION` runs one of
//! them alone. What fails is written to a file, which the failure names.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod caught;
#[path = "../common/mod.rs"]
mod common;
mod memory;
#[path = "../meshes/mesh_formats/small.rs"]
mod meshes;
mod mixer;
mod mutate;
mod readers;
#[path = "../meshes/surface_files/small.rs"]
mod surfaces;

use caught::{caught, quietly};
use readers::{Reader, readers};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Inputs without `GREENSTAGE_MUTATIONS`: a few seconds.
const FEW: u64 = 40_000;
const THREADS: usize = 2;
/// An input that takes longer fails.
const SLOW: Duration = Duration::from_secs(1);
/// Time after which a reader that has not come back never will: the program ends.
const HUNG: Duration = Duration::from_secs(60);

/// Counts of one kind of file.
#[derive(Clone, Copy, Default)]
struct Tally {
    inputs: u64,
    read: u64,
    /// Time, s, and number of the slowest.
    slowest: (f64, u64),
    /// Bytes at the peak of the greediest beyond its reader's constant, over its own bytes, and its number.
    greediest: (f64, u64),
}

impl Tally {
    fn and(self, other: &Tally) -> Tally {
        let worse = |a: (f64, u64), b: (f64, u64)| if b.0 > a.0 { b } else { a };
        Tally {
            inputs: self.inputs + other.inputs,
            read: self.read + other.read,
            slowest: worse(self.slowest, other.slowest),
            greediest: worse(self.greediest, other.greediest),
        }
    }
}

/// Reader, name and bytes of input `number`.
fn input(readers: &[Reader], number: u64) -> (usize, &str, Vec<u8>) {
    let mut random = mutate::Random::new(number);
    // Every 16th for the dear ones: those that write the input to the disk.
    let (dear, cheap): (Vec<usize>, Vec<usize>) =
        (0..readers.len()).partition(|&which| readers[which].is_dear);
    let of = if number.is_multiple_of(16) { dear } else { cheap };
    let which = of[random.below(of.len())];
    let Reader { seeds, damage, .. } = &readers[which];
    let (name, seed) = &seeds[random.below(seeds.len())];
    let other = &seeds[random.below(seeds.len())].1;
    (which, name, damage(seed, other, &mut random))
}

/// Reads one input: whether it was accepted, in which time, s, and with how many bytes at the peak; or the panic.
fn run(reader: &Reader, name: &str, bytes: &[u8]) -> Result<(bool, f64, usize), String> {
    let started = Instant::now();
    let result = caught(|| {
        let (read, peak) = memory::peak_of(|| (reader.read)(Path::new(name), bytes));
        let accepted = read.is_some();
        if let Some(then) = read {
            then();
        }
        (accepted, peak)
    });
    let time = started.elapsed().as_secs_f64();
    result.map(|(accepted, peak)| (accepted, time, peak))
}

/// [`run`] with its limits; the error says which was passed.
fn judged(reader: &Reader, name: &str, bytes: &[u8]) -> Result<(bool, f64, f64), String> {
    let (accepted, mut time, peak) = run(reader, name, bytes).map_err(|panic| format!("panics: {panic}"))?;
    // A busy machine may have stopped for a second; a slow reader is slow again.
    for _ in 0..3 {
        if time > SLOW.as_secs_f64() {
            time = time.min(run(reader, name, bytes)?.1);
        }
    }
    if time > SLOW.as_secs_f64() {
        return Err(format!("takes {time:.1} s"));
    }
    let beyond = peak.saturating_sub(reader.constant);
    if beyond > reader.per_byte * bytes.len() {
        return Err(format!("takes {peak} bytes to read {}", bytes.len()));
    }
    Ok((accepted, time, beyond as f64 / bytes.len().max(1) as f64))
}

fn saved(name: &str, number: u64, bytes: &[u8]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mutations");
    let name = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{number}-{name}"));
    std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, bytes)).unwrap();
    path
}

/// One thread's share of the inputs: `now` is the one it reads, counted from 1, and when it began, ms.
fn work(
    readers: &[Reader],
    numbers: impl Iterator<Item = u64>,
    now: &[AtomicU64; 2],
    started: Instant,
) -> (Vec<Tally>, Vec<String>) {
    let (mut tallies, mut failures) = (vec![Tally::default(); readers.len()], Vec::new());
    for number in numbers {
        let (which, name, bytes) = input(readers, number);
        now[1].store(started.elapsed().as_millis() as u64, Relaxed);
        now[0].store(number + 1, Relaxed);
        let tally = &mut tallies[which];
        tally.inputs += 1;
        match judged(&readers[which], name, &bytes) {
            Ok((accepted, time, ratio)) => {
                tally.read += u64::from(accepted);
                *tally = tally.and(&Tally {
                    slowest: (time, number),
                    greediest: (ratio, number),
                    ..Tally::default()
                });
            }
            Err(reason) => {
                let path = saved(name, number, &bytes);
                failures.push(format!("{reason}\n    input {number}: {}", path.display()));
            }
        }
        now[0].store(0, Relaxed);
        if failures.len() > 20 {
            break;
        }
    }
    (tallies, failures)
}

/// Ends the program when a thread does not come back from its input.
fn watch(readers: &[Reader], now: &[[AtomicU64; 2]], started: Instant, done: &AtomicBool) {
    while !done.load(Relaxed) {
        std::thread::sleep(Duration::from_millis(20));
        for [number, began] in now {
            let number = number.load(Relaxed);
            // It may have begun since the clock was read.
            let since = (started.elapsed().as_millis() as u64).saturating_sub(began.load(Relaxed));
            if number > 0 && u128::from(since) > HUNG.as_millis() {
                let (_, name, bytes) = input(readers, number - 1);
                let path = saved(name, number - 1, &bytes);
                eprintln!("input {} does not end: {}", number - 1, path.display());
                std::process::exit(101);
            }
        }
    }
}

/// The only test of this file, since the allocator counts for all.
#[test]
fn no_damaged_file_makes_a_reader_panic_hang_or_take_memory() {
    let folder = tempfile::tempdir().unwrap();
    let readers = readers(folder.path());
    let asked = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().expect("a number"));
    if let Some(number) = asked("GREENSTAGE_MUTATION") {
        let (which, name, bytes) = input(&readers, number);
        println!("input {number}: {}", saved(name, number, &bytes).display());
        println!("{:?}", judged(&readers[which], name, &bytes));
        return;
    }
    let count = asked("GREENSTAGE_MUTATIONS").unwrap_or(FEW);
    let (started, done) = (Instant::now(), AtomicBool::new(false));
    let now: [[AtomicU64; 2]; THREADS] = Default::default();
    let results: Vec<(Vec<Tally>, Vec<String>)> = quietly(|scope| {
        let (readers, now, done) = (&readers, &now, &done);
        scope.spawn(move || watch(readers, now, started, done));
        let share = |thread: usize| {
            let numbers = (thread as u64..count).step_by(THREADS);
            scope.spawn(move || work(readers, numbers, &now[thread], started))
        };
        let threads: Vec<_> = (0..THREADS).map(share).collect();
        let results = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
        done.store(true, Relaxed);
        results
    });

    let seconds = started.elapsed().as_secs_f64();
    println!("| reader | inputs | accepted | slowest, ms | its number | most memory / file | its number |");
    println!("|---|---|---|---|---|---|---|");
    let mut total = Tally::default();
    let row = |name: &str, tally: &Tally| {
        let Tally { inputs, read, slowest, greediest } = tally;
        println!(
            "| {name} | {inputs} | {:.0} % | {:.1} | {} | {:.1} | {} |",
            100.0 * *read as f64 / (*inputs).max(1) as f64,
            1e3 * slowest.0,
            slowest.1,
            greediest.0,
            greediest.1
        );
    };
    for (which, reader) in readers.iter().enumerate() {
        let tally = results.iter().fold(Tally::default(), |sum, (tallies, _)| sum.and(&tallies[which]));
        row(reader.name, &tally);
        total = total.and(&tally);
    }
    row("all", &total);
    println!("{:.0} inputs a second on {THREADS} threads, {seconds:.0} s", total.inputs as f64 / seconds);
    let failures: Vec<&str> = results.iter().flat_map(|(_, failures)| failures).map(String::as_str).collect();
    assert!(failures.is_empty(), "{} failures\n{}", failures.len(), failures.join("\n"));
    assert_eq!(total.inputs, count);
}
