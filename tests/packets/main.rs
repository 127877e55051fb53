//! Millions of damaged packets for every parser that listens to a network or a serial line: none may make one panic,
//! take a second, or take memory; and what a parser keeps from packet to packet does not grow.
//!
//! Packet number n is the same on every machine and in every run: a small good packet, or a stream of them, changed in
//! a few places by random numbers that follow from n. `GREENSTAGE_MUTATIONS` says how many there are.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "../mutations/caught.rs"]
mod caught;
#[path = "../mutations/memory.rs"]
mod memory;
#[path = "../mutations/mutate.rs"]
mod mutate;
mod parsers;

use caught::{caught, quietly};
use parsers::{PacketParser, parsers};
use std::time::{Duration, Instant};

/// Packets without `GREENSTAGE_MUTATIONS`: a few seconds.
const FEW: u64 = 200_000;
const THREADS: u64 = 2;
/// A packet that takes longer, and again each time that it is heard, fails: more than a frame of a display.
const SLOW: Duration = Duration::from_millis(20);
const TIMES: u32 = 5;
/// More bytes at once than a parser may take for one packet: two buffers of a stream, and what it answers.
const MOST_AT_ONCE: usize = 512 << 10;
/// Bytes that all of a thread's parsers may hold more at the end than after the first tenth: less than all their channels.
const MOST_GROWTH: isize = 512 << 10;
/// Largest growth of the pages of the whole process: the allocator keeps some of the pieces of up to 200 KiB that were given back
/// (10 MiB after 200,000 packets, 20 MiB after ten million).
const MOST_PAGES: u64 = 48 << 20;

#[derive(Clone, Copy, Default)]
struct Tally {
    packets: u64,
    /// Packets of which something was taken.
    taken: u64,
    slowest_s: f64,
    most_bytes: usize,
    most_channels: usize,
}

struct Outcome {
    tallies: Vec<Tally>,
    failures: Vec<String>,
    growth: isize,
}

fn packet(parsers: &[PacketParser], number: u64) -> (usize, Vec<u8>) {
    let mut random = mutate::Random::new(number);
    let which = random.below(parsers.len());
    let seeds = &parsers[which].seeds;
    let (seed, other) = (random.below(seeds.len()), random.below(seeds.len()));
    // A few of a stream's packets stay as they are, so that parsers get beyond their first word.
    let bytes = match random.below(8) {
        0 => seeds[seed].clone(),
        _ => mutate::mutated(&seeds[seed], &seeds[other], &mut random),
    };
    (which, bytes)
}

/// One packet: whether something of it was taken, the time, the bytes at the peak, the channels kept; or the fault.
fn hear(parser: &mut PacketParser, bytes: &[u8]) -> Result<(bool, f64, usize, usize), String> {
    let started = Instant::now();
    let heard = caught(|| memory::peak_of(|| (parser.hear)(bytes)));
    let seconds = started.elapsed().as_secs_f64();
    let ((taken, channels), most) = heard.map_err(|panic| format!("panics: {panic}"))?;
    if most > MOST_AT_ONCE {
        return Err(format!("takes {most} bytes of memory"));
    }
    if channels > 3 * greenstage::track::device::MOST_CHANNELS {
        return Err(format!("keeps {channels} channels"));
    }
    Ok((taken, seconds, most, channels))
}

/// One thread's share, all by the same parsers.
fn work(first: u64, count: u64) -> Outcome {
    let mut parsers = parsers();
    let mut outcome =
        Outcome { tallies: vec![Tally::default(); parsers.len()], failures: Vec::new(), growth: 0 };
    let settled = count / 10;
    let mut held = 0;
    for number in (first..count).step_by(THREADS as usize) {
        if number / THREADS == settled / THREADS {
            held = memory::in_use();
        }
        let (which, bytes) = packet(&parsers, number);
        let parser = &mut parsers[which];
        let mut heard = hear(parser, &bytes);
        // A busy machine may have stopped for a moment; a slow parser is slow again.
        for _ in 1..TIMES {
            if matches!(heard, Ok((_, seconds, ..)) if seconds > SLOW.as_secs_f64()) {
                heard = hear(parser, &bytes);
            }
        }
        let tally = &mut outcome.tallies[which];
        tally.packets += 1;
        match heard {
            Ok((taken, seconds, most, channels)) if seconds <= SLOW.as_secs_f64() => {
                tally.taken += u64::from(taken);
                tally.slowest_s = tally.slowest_s.max(seconds);
                tally.most_bytes = tally.most_bytes.max(most);
                tally.most_channels = tally.most_channels.max(channels);
            }
            Ok((_, seconds, ..)) => {
                outcome.failures.push(format!("{} packet {number} takes {seconds} s", parser.name));
            }
            Err(fault) => {
                let start = &bytes[..bytes.len().min(200)];
                outcome.failures.push(format!("{} packet {number} {fault}: {start:02x?}", parser.name));
            }
        }
        if outcome.failures.len() > 10 {
            break;
        }
    }
    outcome.growth = memory::in_use() - held;
    outcome
}

/// Bytes of memory that the process occupies; `None` where the system does not say.
fn resident() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    text.split_whitespace().nth(1)?.parse::<u64>().ok().map(|pages| 4096 * pages)
}

/// The only test of this file, since the allocator counts for all.
#[test]
fn no_damaged_packet_makes_a_parser_panic_hang_or_grow() {
    let count = std::env::var("GREENSTAGE_MUTATIONS").ok().map_or(FEW, |text| text.parse().unwrap());
    quietly(|_| work(0, FEW / 10));
    let (before, started) = (resident(), Instant::now());
    let outcomes: Vec<Outcome> = quietly(|scope| {
        let threads: Vec<_> = (0..THREADS).map(|first| scope.spawn(move || work(first, count))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    let seconds = started.elapsed().as_secs_f64();
    let after = resident();

    println!("| parser | packets | something taken | slowest, ms | most memory, KiB | channels kept |");
    println!("|---|---|---|---|---|---|");
    let mut packets = 0;
    for (which, parser) in parsers().iter().enumerate() {
        let mut all = Tally::default();
        for tally in outcomes.iter().map(|outcome| &outcome.tallies[which]) {
            all.packets += tally.packets;
            all.taken += tally.taken;
            all.slowest_s = all.slowest_s.max(tally.slowest_s);
            all.most_bytes = all.most_bytes.max(tally.most_bytes);
            all.most_channels = all.most_channels.max(tally.most_channels);
        }
        packets += all.packets;
        let part = 100.0 * all.taken as f64 / all.packets.max(1) as f64;
        println!(
            "| {} | {} | {part:.0} % | {:.1} | {:.0} | {} |",
            parser.name,
            all.packets,
            1e3 * all.slowest_s,
            all.most_bytes as f64 / 1024.0,
            all.most_channels
        );
        assert!(all.taken > 0, "{} takes nothing at all", parser.name);
    }
    println!("{:.0} packets a second on {THREADS} threads, {seconds:.0} s", packets as f64 / seconds);
    let failures: Vec<&str> =
        outcomes.iter().flat_map(|outcome| &outcome.failures).map(String::as_str).collect();
    assert!(failures.is_empty(), "{} failures\n{}", failures.len(), failures.join("\n"));
    assert_eq!(packets, count);
    for outcome in &outcomes {
        println!("a thread's parsers hold {} bytes more than after a tenth", outcome.growth);
        assert!(outcome.growth < MOST_GROWTH, "{} bytes", outcome.growth);
    }
    if let (Some(before), Some(after)) = (before, after) {
        println!(
            "resident memory {:.1} MiB, then {:.1} MiB",
            before as f64 / 1048576.0,
            after as f64 / 1048576.0
        );
        assert!(after < before + MOST_PAGES, "{before} bytes grew to {after}");
    }
}
