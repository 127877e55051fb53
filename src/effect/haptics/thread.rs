//! The thread of the haptic loop: reads the device, runs a tick and pushes, at 1 kHz or more whatever the frame rate.
//!
//! In: the newest [`Grasp`] of the frame. Out: the newest [`Report`] for the frame. Both go through triple buffers; a tick
//! never waits.

use super::device::{Device, Push, Reading};
use super::grasp::{Grasp, device_from_handle};
use super::haptic_source::HapticSource;
use super::loop_state::LoopState;
use super::tick::{Control, Renewal};
use crate::track::device::now_s;
use spin_sleep::SpinSleeper;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use triple_buffer::{Input, Output, triple_buffer};

/// The number of loops that run in this process.
pub fn running() -> usize {
    RUNNING.load(Ordering::SeqCst)
}

static RUNNING: AtomicUsize = AtomicUsize::new(0);

/// Counts a running loop until it ends or panics.
struct RunCount;

impl RunCount {
    fn new() -> RunCount {
        RUNNING.fetch_add(1, Ordering::SeqCst);
        RunCount
    }
}

impl Drop for RunCount {
    fn drop(&mut self) {
        RUNNING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// A loop's timing since its start. Lateness is measured only while something is held, because otherwise the loop sleeps
/// less precisely.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopTiming {
    pub ticks: u64,
    /// Ticks in the last whole second; 0 before the first.
    pub rate_hz: f64,
    /// Ticks that began more than half a period after they were due.
    pub late: u64,
    /// Ticks that were skipped because the next one was already due.
    pub missed: u64,
    /// Computing time of a tick, without reading the device and pushing, s.
    pub work_p50_s: f64,
    pub work_p99_s: f64,
    pub work_most_s: f64,
    /// Delay of a tick's beginning, s.
    pub late_p50_s: f64,
    pub late_p99_s: f64,
}

/// The state of the loop, as the frame reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    pub state: LoopState,
    pub timing: LoopTiming,
    /// Messages of the device that could not be read.
    pub malformed: u64,
}

/// A running loop. When it is dropped, the loop ends with a last push of no force.
pub struct Loop {
    pub device: String,
    grasp: Input<Grasp>,
    report: Output<Report>,
    readings: Option<Output<Option<Reading>>>,
    renewals: Renewals,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Models on their way into the loop, and old ones on their way out of it: the loop itself frees no memory.
struct Renewals {
    waiting: Vec<Renewal>,
    into: SyncSender<Renewal>,
    old: Receiver<Renewal>,
}

/// Models on their way at most; others wait for a later frame.
const RENEWALS: usize = 8;

impl Loop {
    pub fn start(control: Control, device: Box<dyn Device>) -> std::io::Result<Loop> {
        let (grasp, newest) = triple_buffer(&Grasp::default());
        let (told, report) = triple_buffer(&Report::default());
        let (read, readings) = triple_buffer(&None);
        let ((into, new), (retire, old)) = (sync_channel(RENEWALS), sync_channel(RENEWALS));
        let renewals = Renewals { waiting: Vec::new(), into, old };
        let stop = Arc::new(AtomicBool::new(false));
        let (described, stopped) = (device.describe(), stop.clone());
        let counted = RunCount::new();
        let work = move || {
            run((control, device), (newest, new, retire), (told, read), &stopped);
            drop(counted);
        };
        let thread = std::thread::Builder::new().name("haptics".into()).spawn(work)?;
        let (readings, thread) = (Some(readings), Some(thread));
        Ok(Loop { device: described, grasp, report, readings, renewals, stop, thread })
    }

    /// Gives a body another model from the next frame on that is told.
    pub fn renew(&mut self, renewal: Renewal) {
        let waiting = &mut self.renewals.waiting;
        waiting.retain(|other| other.body != renewal.body);
        waiting.push(renewal);
    }

    /// Passes a frame's data to the loop. `write` gets one of three buffers with old contents and must write all of it.
    pub fn tell(&mut self, write: impl FnOnce(&mut Grasp)) {
        let Renewals { waiting, into, old } = &mut self.renewals;
        old.try_iter().for_each(drop);
        while let Some(renewal) = waiting.pop() {
            if let Err(TrySendError::Full(renewal)) = into.try_send(renewal) {
                waiting.push(renewal);
                break;
            }
        }
        write(self.grasp.input_buffer_mut());
        self.grasp.publish();
    }

    /// The device's measurements as a source of poses; `None` after the first call.
    pub fn source(&mut self) -> Option<HapticSource> {
        Some(HapticSource::of_loop(self.device.clone(), self.readings.take()?))
    }

    pub fn report(&mut self) -> &Report {
        self.report.read()
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

fn run(
    (mut control, mut device): (Control, Box<dyn Device>),
    (mut grasp, renewals, retire): (Output<Grasp>, Receiver<Renewal>, SyncSender<Renewal>),
    (mut told, mut read): (Input<Report>, Input<Option<Reading>>),
    stop: &AtomicBool,
) {
    let period = Duration::from_secs_f64(control.haptic.period_s());
    // Spin for the last part of a period, because a plain sleep wakes late; at most a quarter of the time.
    let awake = (period / 4).min(Duration::from_micros(125));
    let sleeper = SpinSleeper::new(awake.as_nanos() as u32);
    let (mut work, mut late) = (Histogram::new(), Histogram::new());
    let mut timing = LoopTiming::default();
    let mut second = (Instant::now(), 0);
    let mut due = Instant::now();
    // Percentiles are computed about thirty times a second.
    let summary = (control.haptic.rate_hz / 30.0).max(1.0) as u64;
    let mut is_felt = false;
    while !stop.load(Ordering::Relaxed) {
        due += period;
        if is_felt {
            sleeper.sleep_until(due);
        } else {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let behind = due.elapsed();
        let skipped = (behind.as_nanos() / period.as_nanos()) as u32;
        due += period * skipped;
        timing.ticks += 1;
        if is_felt {
            timing.late += u64::from(behind > period / 2);
            timing.missed += u64::from(skipped);
            late.add(behind);
        }

        let news = grasp.update();
        if news {
            let hand = grasp.output_buffer().room_from_hand;
            if let Some(hand) = hand {
                device.hand(&device_from_handle(&control.haptic, &hand));
            }
        }
        let now = now_s();
        let reading = device.read(now);
        control.latency_s = device.latency_s();
        let started = Instant::now();
        if news {
            while let Ok(mut renewal) = renewals.try_recv() {
                control.renew(&mut renewal);
                // With no room left it is freed here.
                let _ = retire.try_send(renewal);
            }
            control.take(grasp.output_buffer());
        }
        let push = control.tick(reading.as_ref(), now);
        if is_felt {
            work.add(started.elapsed());
        }
        device.push(&push, now);
        is_felt = control.holds() && reading.is_some();
        read.write(reading);

        if timing.ticks.is_multiple_of(summary) {
            let (since, ticks) = second;
            if since.elapsed() >= Duration::from_secs(1) {
                timing.rate_hz = (timing.ticks - ticks) as f64 / since.elapsed().as_secs_f64();
                second = (Instant::now(), timing.ticks);
            }
            (timing.work_p50_s, timing.work_p99_s) = (work.quantile_s(0.5), work.quantile_s(0.99));
            timing.work_most_s = work.most.as_secs_f64();
            (timing.late_p50_s, timing.late_p99_s) = (late.quantile_s(0.5), late.quantile_s(0.99));
        }
        told.write(Report { state: control.state, timing, malformed: device.malformed() });
    }
    device.push(&Push::NONE, now_s());
}

/// Durations in classes of 1/8 octave, which gives quantiles to 9 % in constant memory.
struct Histogram {
    counts: [u64; 8 * 34],
    total: u64,
    most: Duration,
}

impl Histogram {
    fn new() -> Histogram {
        Histogram { counts: [0; 8 * 34], total: 0, most: Duration::ZERO }
    }

    fn add(&mut self, duration: Duration) {
        let class = (8.0 * (duration.as_nanos().max(1) as f64).log2()) as usize;
        self.counts[class.min(8 * 34 - 1)] += 1;
        self.total += 1;
        self.most = self.most.max(duration);
    }

    /// Upper end of the class in which the quantile lies, s.
    fn quantile_s(&self, part: f64) -> f64 {
        let rank = (part * self.total as f64) as u64;
        let mut below = 0;
        let found = self.counts.iter().position(|count| {
            below += count;
            below > rank
        });
        found.map_or(0.0, |class| 1e-9 * ((class + 1) as f64 / 8.0).exp2())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_numbers_to_a_class() {
        let mut histogram = Histogram::new();
        for i in 1..=1000 {
            histogram.add(Duration::from_nanos(i * 10));
        }
        for (part, expected) in [(0.5, 5e-6), (0.99, 9.9e-6)] {
            let found = histogram.quantile_s(part);
            assert!(found >= expected && found < 1.1 * expected, "{found} for {expected}");
        }
        assert_eq!(Histogram::new().quantile_s(0.5), 0.0);
    }
}
