//! Ctrl-C, or another request to end, while a force device is open: no force first, then the end.
//!
//! Such a signal ends a process where it stands, and a device may push with the last force for as long as it is told
//! nothing.

use crate::base::signal::on_end;
use crate::effect::haptics::thread::stop_all;
use std::sync::Once;
use std::time::Duration;

/// A loop ends within a tick, and its device's connection within this.
const PATIENCE: Duration = Duration::from_secs(2);

/// From the first call on such a signal leaves no force.
pub fn end_without_force() {
    static ASKED: Once = Once::new();
    let stop = || {
        stop_all(PATIENCE);
        None
    };
    ASKED.call_once(|| on_end(stop).keep());
}

#[cfg(test)]
mod tests {
    use super::super::bench_haptics::control;
    use super::*;
    use crate::base::signal;
    use crate::effect::haptics::{Device, Loop, News, Push, Reading};
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use signal_hook::consts::SIGTERM;
    use std::io::{BufRead, BufReader};
    use std::os::unix::process::{CommandExt, ExitStatusExt};
    use std::process::{Command, Stdio};

    /// A handle that stands aside of rest, and tells on standard output when a force begins and when it ends.
    struct Aside {
        is_pushed: bool,
    }

    impl Device for Aside {
        fn describe(&self) -> String {
            "aside".into()
        }

        fn read(&mut self, now_s: f64) -> Option<Reading> {
            let place = Vector3::new(0.01, 0.0, 0.0);
            let device_from_handle = Isometry3::from_parts(place.into(), UnitQuaternion::identity());
            let (buttons, news) = ([true, false], News::default());
            Some(Reading {
                device_from_handle,
                buttons,
                arrived_s: now_s,
                measured_s: None,
                tracked: true,
                news,
            })
        }

        fn push(&mut self, push: &Push, _now_s: f64) {
            let is_pushed = push.force.norm() > 0.0;
            if is_pushed != self.is_pushed {
                println!("\n{}", if is_pushed { "a force" } else { "no force" });
                self.is_pushed = is_pushed;
            }
        }
    }

    const CHILD: &str = "GREENSTAGE_TEST_CHILD";

    /// Not a test of its own: the process that the next one ends.
    #[test]
    fn child() {
        if std::env::var_os(CHILD).is_none() {
            return;
        }
        signal::watch().unwrap();
        end_without_force();
        let (control, grasp) = control("linear", 2).unwrap();
        let mut running = Loop::start(control, Box::new(Aside { is_pushed: false })).unwrap();
        for _ in 0..6000 {
            running.tell(|told| told.clone_from(&grasp));
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn a_program_that_is_told_to_end_leaves_no_force() {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "cli::interrupt::tests::child", "--nocapture"])
            .env(CHILD, "1")
            .stdout(Stdio::piped());
        // SAFETY: the call changes the signal mask alone. The tests' own first thread must block the signals too, and it
        // runs before `child` can say so.
        let mut child = unsafe { command.pre_exec(signal::block) }.spawn().unwrap();
        let mut told = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(told.any(|line| line == "a force"));
        let ended = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
        assert!(ended.success());
        assert_eq!(told.filter(|line| !line.is_empty()).last().as_deref(), Some("no force"));
        assert_eq!(child.wait().unwrap().signal(), Some(SIGTERM), "as the signal ends a program");
    }
}
