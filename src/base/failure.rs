//! The failure of a command: whether the request or the work is at fault, and the chain of reasons.

use super::output::OutputError;
use std::fmt;
use std::thread::JoinHandle;

/// An error and the exit status it ends with.
pub enum Failure {
    /// The request or its files are wrong: status 2.
    Request(anyhow::Error),
    /// The work failed: status 1.
    Work(anyhow::Error),
}

impl Failure {
    pub fn request(error: impl Into<anyhow::Error>) -> Failure {
        Failure::Request(error.into())
    }

    pub fn work(error: impl Into<anyhow::Error>) -> Failure {
        Failure::Work(error.into())
    }

    /// A wrong request in words.
    pub fn wrong(message: impl fmt::Display) -> Failure {
        Failure::Request(anyhow::anyhow!("{message}"))
    }

    pub fn status(&self) -> u8 {
        match self {
            Failure::Request(_) => 2,
            Failure::Work(_) => 1,
        }
    }
}

/// The result of a thread; where it panicked, the failure names `what` it was doing.
pub fn join<T>(thread: JoinHandle<Result<T, Failure>>, what: &str) -> Result<T, Failure> {
    let panicked =
        || Failure::work(anyhow::anyhow!("{what} stopped unexpectedly; this is a bug in greenstage"));
    thread.join().unwrap_or_else(|_| Err(panicked()))
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Failure::Request(error) | Failure::Work(error)) = self;
        let mut told = error.to_string();
        f.write_str(&told)?;
        // Most errors name their cause themselves.
        for cause in error.chain().skip(1).map(ToString::to_string) {
            if !told.contains(&cause) {
                write!(f, ": {cause}")?;
            }
            told = cause;
        }
        Ok(())
    }
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Failure {
        if error.is_request() { Failure::request(error) } else { Failure::work(error) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use anyhow::Context;
    use std::path::Path;

    #[test]
    fn a_cause_is_told_once() {
        let missing = config::load::<toml::Table>(Path::new("no/such.toml")).unwrap_err();
        let text = Failure::from(missing).to_string();
        assert_eq!(text.matches("os error").count(), 1, "{text}");
        let inner: Result<(), _> = Err(std::io::Error::other("the disk is full"));
        let outer = inner.context("cannot write a.csv").unwrap_err();
        assert_eq!(Failure::work(outer).to_string(), "cannot write a.csv: the disk is full");
    }
}
