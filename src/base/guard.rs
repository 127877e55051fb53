//! A guard for a connection to a device that pushes: a small separate process that takes the force back, however this program
//! ends.
//!
//! In: a connection, and the message that means no force, as bytes. Out: nothing, until this program's end of a socket
//! between the two closes, or until no heartbeat comes while a force acts. Then the guard sends the message. The kernel
//! closes that socket when the last thread of this program is gone, whatever ended it (SIGKILL, a fault, a library that
//! calls exit), so that no force can follow the message. A guard is this program again, started with the one argument
//! [`ARGUMENT`]; it holds the connection itself, and the program writes to it directly.

use libc::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::{Shutdown, TcpStream};
use std::os::fd::{AsFd, FromRawFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// The program with this one argument is a guard.
pub const ARGUMENT: &str = "guard-of-a-force-device";
/// The name of the process for `ps`; a tool that ends programs by name, such as `killall`, does not find it by ours.
const NAME: &str = "force-guard";
/// Silence after which a program that pushes counts as stopped: the force is taken back.
const SILENT: Duration = Duration::from_millis(24);
/// Beats are no more frequent than this.
const BEAT: Duration = Duration::from_millis(4);
/// Time for which the guard goes on reading from the device: a connection that is closed with bytes unread is reset, and a reset
/// may overtake the last message.
const LINGER: Duration = Duration::from_secs(1);

// What the program says, a byte each. Behind SENDS stand the length of the message, a little-endian u16, and the message.
const PUSHES: u8 = b'p';
const RESTS: u8 = b'r';
const SENDS: u8 = b's';

/// The program that guards: the one whose `main` asked [`run_if_asked`], or which a test names. In any other executable, as one of
/// unit tests, the guard is a thread, which ends with its process.
pub static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// A connection's guard. When it is dropped, the guard takes the force back and ends.
#[derive(Debug)]
pub struct Guard {
    life: UnixStream,
    /// Time of the last message that a force acts; `None` while none does.
    beaten: Option<Instant>,
}

impl Guard {
    /// Starts the guard of `connection`, which sends `none` at the end.
    ///
    /// # Errors
    /// No process can be started, or `none` is too long.
    pub fn start(connection: &TcpStream, none: &[u8]) -> Result<Guard> {
        let (life, guards) = UnixStream::pair()?;
        life.set_nonblocking(true)?;
        let mut started = Guard { life, beaten: None };
        // Before the guard runs, so that it knows what to send if this program ends at once.
        started.sends(none)?;
        let Some(program) = PROGRAM.get() else {
            let connection = connection.try_clone()?;
            let run = move || guard(guards, connection);
            std::thread::Builder::new().name("guard".into()).spawn(run)?;
            return Ok(started);
        };
        let mut guard = Command::new(program)
            .arg0(NAME)
            .arg(ARGUMENT)
            .stdin(OwnedFd::from(guards))
            .stdout(connection.as_fd().try_clone_to_owned()?)
            .stderr(Stdio::null())
            // Ctrl-C in a terminal, and `timeout`, end a whole process group.
            .process_group(0)
            .spawn()?;
        // Ends with the guard, so that it leaves no zombie.
        std::thread::Builder::new().name("guard".into()).spawn(move || guard.wait())?;
        Ok(started)
    }

    /// Replaces the message that the guard sends at the end.
    ///
    /// # Errors
    /// The guard is gone, or `none` has more than 65,535 bytes.
    pub fn sends(&mut self, none: &[u8]) -> Result<()> {
        let length = u16::try_from(none.len()).map_err(Error::other)?;
        self.life.write_all(&[&[SENDS][..], &length.to_le_bytes(), none].concat())
    }

    /// A force is about to be sent, or acts: said before the first, and again at least every 20 ms.
    ///
    /// # Errors
    /// The guard is gone: no force may be sent.
    pub fn pushes(&mut self) -> Result<()> {
        if self.beaten.is_none_or(|beaten| beaten.elapsed() >= BEAT) {
            self.life.write_all(&[PUSHES])?;
            self.beaten = Some(Instant::now());
        }
        Ok(())
    }

    /// No force was sent, and none acts.
    ///
    /// # Errors
    /// The guard is gone.
    pub fn rests(&mut self) -> Result<()> {
        if self.beaten.take().is_some() {
            self.life.write_all(&[RESTS])?;
        }
        Ok(())
    }

    /// Signals the guard that this program is alive, if a force acts that was sent before.
    pub fn beat(&mut self) -> Result<()> {
        if self.beaten.is_some() { self.pushes() } else { Ok(()) }
    }
}

/// The guard's own run, if that is what this process was started for: the first thing that `main` asks.
pub fn run_if_asked() -> Option<ExitCode> {
    PROGRAM.get_or_init(|| PathBuf::from("/proc/self/exe"));
    let mut arguments = std::env::args_os().skip(1);
    (arguments.next()? == ARGUMENT && arguments.next().is_none()).then(run)
}

fn run() -> ExitCode {
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        // SAFETY: takes numbers alone, and sets no handler. What ends the program by its name must not end the guard first.
        unsafe { libc::signal(signal, libc::SIG_IGN) };
    }
    // SAFETY: the first two descriptors are this process's own, and nothing else here uses them.
    let [life, connection] = [0, 1].map(|descriptor| unsafe { OwnedFd::from_raw_fd(descriptor) });
    match guard(UnixStream::from(life), TcpStream::from(connection)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}

/// Sends the message whenever the program falls silent, and at its end.
fn guard(mut life: UnixStream, mut connection: TcpStream) -> Result<()> {
    let (mut none, mut said) = (Vec::new(), [0]);
    loop {
        match life.read(&mut said) {
            Ok(1) if said == [SENDS] => {
                let mut length = [0; 2];
                life.read_exact(&mut length)?;
                none.resize(u16::from_le_bytes(length).into(), 0);
                life.read_exact(&mut none)?;
            }
            Ok(1) => life.set_read_timeout((said == [PUSHES]).then_some(SILENT))?,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                connection.write_all(&none)?;
                life.set_read_timeout(None)?;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            _ => break,
        }
    }
    connection.write_all(&none)?;
    connection.shutdown(Shutdown::Write)?;
    let end = Instant::now() + LINGER;
    let mut unread = [0; 4096];
    while let Some(left) = end.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
        connection.set_read_timeout(Some(left))?;
        if connection.read(&mut unread)? == 0 {
            break;
        }
    }
    Ok(())
}
