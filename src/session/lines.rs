//! Writes lines on a separate thread, so that the frame that makes them does not wait for a disk.
//!
//! In: lines, as bytes. Out: each is handed to the system at once, in their order. When the queue is full, the caller
//! waits, so that no line is left out.

use crate::base::diagnostic::notice;
use std::io::{Error, Result, Write};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Largest number of lines that wait: four seconds of frames.
const QUEUE: usize = 256;

pub struct Lines {
    queue: Option<SyncSender<Vec<u8>>>,
    writer: Option<JoinHandle<Result<()>>>,
}

impl Lines {
    /// Writes `head`, and starts the thread.
    pub fn write(head: Vec<u8>, mut output: impl Write + Send + 'static) -> Result<Lines> {
        output.write_all(&head)?;
        let (queue, lines) = sync_channel::<Vec<u8>>(QUEUE);
        let write = move || {
            for line in lines {
                output.write_all(&line)?;
            }
            output.flush()
        };
        let writer = Builder::new().name("lines".into()).spawn(write)?;
        Ok(Lines { queue: Some(queue), writer: Some(writer) })
    }

    /// Queues a line; an error is that of an earlier line.
    pub fn queue(&mut self, line: Vec<u8>) -> Result<()> {
        match &self.queue {
            Some(queue) if queue.send(line).is_ok() => Ok(()),
            _ => {
                self.finish()?;
                Err(Error::other("the writer has already ended"))
            }
        }
    }

    /// Waits until everything is written.
    pub fn finish(&mut self) -> Result<()> {
        self.queue = None;
        match self.writer.take().map(JoinHandle::join) {
            Some(Ok(written)) => written,
            Some(Err(_)) => Err(Error::other("its thread panicked")),
            None => Ok(()),
        }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        if let Err(error) = self.finish() {
            notice!("note: lines could not be written: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Receiver, Sender, channel};

    /// A disk that does nothing until it gets a signal.
    struct Disk(Option<Receiver<()>>, Sender<Vec<u8>>);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> Result<usize> {
            if bytes != b"head"
                && let Some(go) = self.0.take()
            {
                go.recv().unwrap();
            }
            self.1.send(bytes.to_vec()).unwrap();
            Ok(bytes.len())
        }
        fn flush(&mut self) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_disk_that_stalls_holds_nobody_up_and_loses_nothing() {
        let ((go, stalled), (told, written)) = (channel(), channel());
        let mut lines = Lines::write(b"head".to_vec(), Disk(Some(stalled), told)).unwrap();
        // On this thread: a wait would be for ever.
        for i in 0..QUEUE as u32 {
            lines.queue(i.to_be_bytes().to_vec()).unwrap();
        }
        assert_eq!(written.try_iter().count(), 1, "the head alone");
        go.send(()).unwrap();
        lines.finish().unwrap();
        let written: Vec<Vec<u8>> = written.try_iter().collect();
        assert!(
            written.iter().eq((0..QUEUE as u32).map(|i| i.to_be_bytes().to_vec()).collect::<Vec<_>>().iter())
        );
    }

    struct Full;

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> Result<usize> {
            if bytes == b"head" { Ok(bytes.len()) } else { Err(Error::other("the disk is full")) }
        }
        fn flush(&mut self) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn an_error_is_told_by_a_later_line_or_at_the_end() {
        let mut lines = Lines::write(b"head".to_vec(), Full).unwrap();
        let error = std::iter::repeat_with(|| lines.queue(b"a".to_vec())).take(1000).find_map(Result::err);
        assert_eq!(error.unwrap().to_string(), "the disk is full");
        let mut lines = Lines::write(b"head".to_vec(), Full).unwrap();
        let queued = lines.queue(b"a".to_vec());
        assert!(queued.is_err() || lines.finish().is_err());
    }
}
