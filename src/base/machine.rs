//! The memory and the threads that this process may use.
//!
//! Memory is bounded by the machine, by every control group around the process (versions 1 and 2; what their file
//! caches hold is given back) and by `ulimit -v` and `-d`. The need of a step is compared with it before the step,
//! because the system kills a process above a limit without a message.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Largest number of threads that is not refused, unless the machine has more processors.
const MOST_THREADS: usize = 1024;

/// Allowance for what estimates of need leave out: a share of them, and bytes for the rest of the program.
const SPARE: [f64; 2] = [0.1, 16e6];

const STATUS: &str = "/proc/self/status";
const LIMITS: &str = "/proc/self/limits";
const ADDRESSES: &str = "Max address space";

/// The error of a need for more memory than is left: by whom, how much, how much is left, and which limit leaves it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{text}")]
pub struct TooLarge {
    text: Box<str>,
    /// The memory that is left, in parts of what is needed.
    pub share: f64,
}

impl TooLarge {
    fn new(what: &str, need: f64, left: f64, bound: &str) -> TooLarge {
        let text = format!("{what} needs {} of memory, and {bound} leaves {}", size(need), size(left));
        TooLarge { text: text.into(), share: left / need }
    }
}

/// Writes a size in GB or MB, without digits that nobody knows.
pub fn size(bytes: f64) -> String {
    if bytes < 1e9 { format!("{:.0} MB", bytes / 1e6) } else { format!("{:.1} GB", bytes / 1e9) }
}

/// Returns an error if the process cannot get `need` more bytes, with a tenth of them and 16 MB to spare, as far as the system
/// reports; else they are planned ([`plan`]).
pub fn expect(what: impl Into<String>, need: f64) -> Result<(), TooLarge> {
    fits(what, need, 0.0)?;
    plan(need);
    Ok(())
}

/// The most memory that was planned, bytes: that in use when a step began, and that step's need.
static PLANNED: AtomicU64 = AtomicU64::new(0);

/// Plans a step that needs at most `need` bytes more.
pub fn plan(need: f64) {
    let used = std::fs::read_to_string(STATUS).ok().and_then(|status| kilobytes(&status, "VmRSS:"));
    PLANNED.fetch_max((used.unwrap_or(0.0) + need) as u64, Relaxed);
}

/// The expected [`peak_memory`], bytes; 0 where no step was planned.
pub fn planned_memory() -> f64 {
    PLANNED.load(Relaxed) as f64
}

/// Whether the process can get `need` more bytes, with a tenth of them and 16 MB to spare, and another `mapped` bytes that are
/// allocated and hardly used: only limits on addresses count them. Nothing is planned.
pub fn fits(what: impl Into<String>, need: f64, mapped: f64) -> Result<(), TooLarge> {
    let need = need + SPARE[0] * need + SPARE[1];
    let refused = |(left, bound): (f64, Bound)| {
        let need = if bound.counts_mapped { need + mapped } else { need };
        (need > left).then_some((need, left, bound))
    };
    let Some((need, left, bound)) = bounds().into_iter().find_map(refused) else { return Ok(()) };
    let mut what = what.into();
    if bound.counts_mapped && mapped > 0.0 {
        what += &format!(" (and {} for the threads' buffers, less with RAYON_NUM_THREADS=1)", size(mapped));
    }
    Err(TooLarge::new(&what, need, left, bound.name))
}

/// The error if the system refused `need` bytes although that many seemed to be left.
pub fn refused(what: impl Into<String>, need: f64) -> TooLarge {
    let least = bounds().into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b));
    let (left, bound) = least.map_or((0.0, "the system"), |(left, bound)| (left, bound.name));
    let what: String = what.into();
    TooLarge::new(&what, need, left, bound)
}

/// A limit on the memory of a process.
struct Bound {
    name: &'static str,
    /// Whether it limits addresses, rather than the memory behind them.
    counts_mapped: bool,
}

/// Bytes that each limit leaves to this process.
fn bounds() -> Vec<(f64, Bound)> {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let status = read(STATUS);
    let used = |key: &str| kilobytes(&status, key).unwrap_or(0.0);
    let machine = of_machine(&read("/proc/meminfo"));
    let group = of_groups(&read("/proc/self/cgroup"), Path::new("/sys/fs/cgroup"));
    let limits = read(LIMITS);
    let address = limit(&limits, ADDRESSES).map(|limit| limit - used("VmSize:"));
    let data = limit(&limits, "Max data size").map(|limit| limit - used("VmData:"));
    [
        (machine, "this machine", false),
        (group, "the memory limit of the control group", false),
        (address, "the limit on address space (ulimit -v)", true),
        (data, "the limit on data (ulimit -d)", true),
    ]
    .into_iter()
    .filter_map(|(left, name, counts_mapped)| Some((left?.max(0.0), Bound { name, counts_mapped })))
    .collect()
}

/// Whether `ulimit -v` bounds the addresses of this process.
pub fn addresses_are_limited() -> bool {
    std::fs::read_to_string(LIMITS).is_ok_and(|limits| limit(&limits, ADDRESSES).is_some())
}

/// Largest resident memory of this process since its start, bytes, if the system reports it.
pub fn peak_memory() -> Option<f64> {
    kilobytes(&std::fs::read_to_string(STATUS).ok()?, "VmHWM:")
}

/// Processor time of the calling thread, s: time that other programs take does not count.
pub fn thread_s() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes into `time`, which lives on, and nowhere else.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &raw mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Bytes of the largest cache of a processor, as faer's matrix products read it; at least 2 MiB.
pub fn largest_cache() -> f64 {
    let size = |index: u32| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size");
        let text = std::fs::read_to_string(path).ok()?;
        let text = text.trim();
        let units = [("K", 10), ("M", 20), ("G", 30)];
        let (number, shift) = units
            .into_iter()
            .find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, shift)))
            .unwrap_or((text, 0));
        Some(number.parse::<f64>().ok()? * f64::from(1u32 << shift))
    };
    let (second, third) = (size(2).unwrap_or(0.0), size(3).unwrap_or(0.0));
    third.max(4.0 * second).max(f64::from(1 << 21))
}

/// The number behind `key` in a file of /proc, whose unit is kB, in bytes.
fn kilobytes(text: &str, key: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(1024.0 * line.trim().trim_end_matches("kB").trim().parse::<f64>().ok()?)
}

/// Memory and swap that are free or can be freed.
fn of_machine(meminfo: &str) -> Option<f64> {
    Some(kilobytes(meminfo, "MemAvailable:")? + kilobytes(meminfo, "SwapFree:").unwrap_or(0.0))
}

/// The fewest bytes that any control group around the process leaves.
fn of_groups(own: &str, root: &Path) -> Option<f64> {
    let groups = own.lines().filter_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, path) = (parts.next()?, parts.next()?.trim_start_matches('/'));
        let files = ["memory.max", "memory.current", "inactive_file", "active_file"];
        let old_files =
            ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file", "total_active_file"];
        if controllers.is_empty() {
            Some((root.to_owned(), path, files))
        } else if controllers.split(',').any(|name| name == "memory") {
            Some((root.join("memory"), path, old_files))
        } else {
            None
        }
    });
    let of_folder = |folder: &Path, [limit, usage, caches @ ..]: [&str; 4]| -> Option<f64> {
        let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
        let number = |name: &str| read(name)?.trim().parse::<f64>().ok();
        let stat = read("memory.stat").unwrap_or_default();
        let cached = |key: &str| {
            let line = stat.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(' '));
            line.and_then(|number| number.trim().parse::<f64>().ok()).unwrap_or(0.0)
        };
        let cache: f64 = caches.into_iter().map(cached).sum();
        Some(number(limit)? - number(usage)? + cache)
    };
    groups
        .flat_map(|(root, path, files)| {
            // A container sees its own group at the root, whatever the path says.
            let folders = Path::new(path).ancestors().map(|path| root.join(path));
            folders.filter_map(|folder| of_folder(&folder, files)).collect::<Vec<_>>()
        })
        .min_by(f64::total_cmp)
}

/// The soft limit of this name in /proc/self/limits, where there is one.
fn limit(limits: &str, name: &str) -> Option<f64> {
    let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// The reason why the working threads cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum ThreadsError {
    #[error(
        "{variable} asks for {asked} threads; this machine has {processors} processors, at most {most} \
         threads are taken. Leave it unset, or write {processors}"
    )]
    TooMany { variable: &'static str, asked: usize, processors: usize, most: usize },
    #[error(
        "{threads} threads cannot be started ({source}): allow more threads or memory, or set RAYON_NUM_THREADS=1"
    )]
    Start { threads: String, source: Box<dyn std::error::Error + Send + Sync> },
}

/// Starts the threads that share the work: as many as there are processors, or as RAYON_NUM_THREADS says.
pub fn start_threads() -> Result<(), ThreadsError> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let most = MOST_THREADS.max(processors);
    let asked = ["RAYON_NUM_THREADS", "RAYON_RS_NUM_CPUS"].into_iter().find_map(|variable| {
        let asked: usize = std::env::var(variable).ok()?.parse().ok()?;
        Some((variable, asked))
    });
    if let Some((variable, asked)) = asked.filter(|(_, asked)| *asked > most) {
        return Err(ThreadsError::TooMany { variable, asked, processors, most });
    }
    match rayon::ThreadPoolBuilder::new().build_global() {
        // Without a source, they are started already.
        Err(error) if std::error::Error::source(&error).is_some() => {
            let threads = asked.map_or(processors, |(_, asked)| asked).to_string();
            Err(ThreadsError::Start { threads, source: error.into() })
        }
        _ => Ok(()),
    }
}

/// Lets this thread share its work with a separate pool of threads, as many as [`start_threads`] started with this one, and work
/// along. A thread outside a pool sleeps until the pool's threads have woken and are done, and stands in line behind what is
/// solved in the background: on two threads a superposition of 10,000 nodes and 24 columns takes 0.8 to 0.9 of the time. Where no
/// more threads can be started, or this one is in a pool already, nothing changes.
pub fn work_along() {
    let threads = rayon::current_num_threads();
    if let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread().build() {
        // Dropped, its threads would end; this one stays in it.
        std::mem::forget(pool);
    }
}

/// The processor's name, or its instruction set if the system does not report the name.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or(std::env::consts::ARCH, |(_, name)| name.trim()).to_owned()
}

/// Whether this program was compiled for tests, by the profiles `quick` or `dev`: its times are not those of the program that
/// people run.
pub const IS_TEST_BUILD: bool = matches!(env!("GREENSTAGE_TEST_BUILD").as_bytes(), b"yes");

/// Refusal to measure times with a test build.
#[derive(Debug, thiserror::Error)]
#[error(
    "this program was compiled for tests and is slower than the one that people run. Measure with target/release/greenstage (`make demo` builds it)"
)]
pub struct TestBuild;

/// Returns an error in a test build, unless `anyway`.
pub fn expect_full_speed(anyway: bool) -> Result<(), TestBuild> {
    if IS_TEST_BUILD && !anyway { Err(TestBuild) } else { Ok(()) }
}

/// The mean number of waiting programs in the last minute, 0 where the system does not report it.
pub fn load() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().and_then(|first| first.parse().ok()).unwrap_or(0.0)
}

/// Processor, threads and operating system in words, and whether this is a test build.
pub fn description() -> String {
    let name = processor();
    let build = if IS_TEST_BUILD { ", test build" } else { "" };
    format!("{name}, {} threads, {}{build}", rayon::current_num_threads(), std::env::consts::OS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_gives_what_is_available_and_its_swap() {
        let text = "MemTotal:  100 kB\nMemAvailable:      40 kB\nSwapFree:  2 kB\n";
        assert_eq!(of_machine(text), Some(42.0 * 1024.0));
        assert_eq!(of_machine("MemTotal: 100 kB\n"), None);
    }

    #[test]
    fn limits_of_the_shell_are_read() {
        let text = "Limit                     Soft Limit           Hard Limit           Units     \n\
                    Max data size             unlimited            unlimited            bytes     \n\
                    Max address space         614400000            unlimited            bytes     \n";
        assert_eq!(limit(text, ADDRESSES), Some(614_400_000.0));
        assert_eq!(limit(text, "Max data size"), None);
    }

    #[test]
    fn the_tightest_control_group_counts() {
        let root = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write("a/b/memory.max", "max\n");
        write("a/b/memory.current", "1000\n");
        write("a/memory.max", "5000\n");
        write("a/memory.current", "3000\n");
        write("a/memory.stat", "inactive_file 400\nactive_file 30\nanon 7\n");
        assert_eq!(of_groups("0::/a/b\n", root.path()), Some(2430.0), "caches are given back");
        write("a/b/memory.max", "1500\n");
        assert_eq!(of_groups("0::/a/b\n", root.path()), Some(500.0));
        assert_eq!(of_groups("0::/elsewhere\n", root.path()), None);
        write("memory/memory.limit_in_bytes", "900\n");
        write("memory/memory.usage_in_bytes", "100\n");
        write("memory/memory.stat", "inactive_file 1\ntotal_inactive_file 50\n");
        let own = "5:cpu,cpuacct:/c\n4:memory:/docker/0123\n";
        assert_eq!(of_groups(own, root.path()), Some(850.0), "in a container, at the root");
    }

    #[test]
    fn what_does_not_fit_is_told_with_its_figures() {
        assert!(expect("a little", 1e3).is_ok());
        if let Err(refusal) = expect("a thing of this test", 1e18) {
            let text = refusal.to_string();
            assert!(text.starts_with("a thing of this test needs 1100000000.0 GB of memory, and "), "{text}");
        }
    }
}
