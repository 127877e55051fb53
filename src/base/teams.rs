//! Jobs that are done side by side, each by its own team of threads.
//!
//! Loops inside a job share the threads of its team alone, so that jobs do not wait for one another, and never more jobs are begun than
//! there are teams: each may need much memory.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc;

/// Does `count` jobs in up to `teams` teams, and hands each result on in this thread, in the order in which they are done.
pub fn each_in_teams<T: Send>(
    teams: usize,
    count: usize,
    job: impl Fn(usize) -> T + Sync,
    mut take: impl FnMut(usize, T),
) {
    let teams = teams.min(count).min(rayon::current_num_threads()).max(1);
    let threads = rayon::current_num_threads() / teams;
    let pool = |_| rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok();
    let pools: Vec<rayon::ThreadPool> = (0..teams).filter(|_| teams > 1).filter_map(pool).collect();
    let next = AtomicUsize::new(0);
    let claim = || Some(next.fetch_add(1, Relaxed)).filter(|next| *next < count);
    let (sender, results) = mpsc::channel();
    std::thread::scope(|scope| {
        for pool in &pools {
            let (job, claim, sender) = (&job, &claim, sender.clone());
            let work = move || {
                let mut own = std::iter::from_fn(claim);
                own.try_for_each(|number| sender.send((number, pool.install(|| job(number)))))
            };
            // The others do what is left by one that cannot be started.
            let _ = std::thread::Builder::new().spawn_scoped(scope, work);
        }
        drop(sender);
        results.iter().for_each(|(number, result)| take(number, result));
    });
    // Without teams, this thread does all.
    std::iter::from_fn(claim).for_each(|number| take(number, job(number)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering::SeqCst;

    #[test]
    fn no_more_jobs_run_than_there_are_teams_and_each_is_done_once() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(6).build().unwrap();
        for teams in [1, 2, 3] {
            let (running, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let mut seen = [0; 20];
            let job = |number: usize| {
                most.fetch_max(running.fetch_add(1, SeqCst) + 1, SeqCst);
                std::thread::sleep(std::time::Duration::from_millis(2));
                running.fetch_sub(1, SeqCst);
                (number * number, rayon::current_num_threads())
            };
            pool.install(|| {
                each_in_teams(teams, seen.len(), job, |number, (square, threads)| {
                    assert_eq!((square, threads), (number * number, 6 / teams));
                    seen[number] += 1;
                });
            });
            assert!(seen.iter().all(|times| *times == 1) && most.into_inner() <= teams, "{seen:?}");
        }
    }
}
