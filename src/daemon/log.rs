//! The log to stderr. Whoever logs never waits: a thread of its own writes, and lines that find no reader (a
//! closed pipe, a full disk, a reader that stands still) are dropped and counted.

use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::status::LogStatus;

/// Lines that may wait for a slow reader.
const WAITING: usize = 1024;
/// A terminal that another program made non-blocking is asked again after this time.
const AGAIN: Duration = Duration::from_millis(10);
/// A write that takes longer is named.
const STUCK: Duration = Duration::from_secs(1);

/// A line, and how many had been dropped before it.
type Line = (u64, Vec<u8>);

/// A handle on the log; each line is one write to a clone of it.
#[derive(Clone, Debug)]
pub struct Log {
    queue: SyncSender<Line>,
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    begun: Instant,
    /// Lines given to the thread, and those that it is done with.
    queued: AtomicU64,
    done: AtomicU64,
    /// Lines that found no room, and those that the output refused.
    dropped: AtomicU64,
    refused: AtomicU64,
    /// Since when the present write waits, ms since `begun`, plus one; 0 while none does.
    writing_since_ms: AtomicU64,
    /// Why the newest line could not be written.
    error: Mutex<Option<String>>,
}

impl Log {
    /// Starts the thread that writes to `output`.
    pub(crate) fn start(output: impl Write + Send + 'static) -> io::Result<Self> {
        let (queue, waiting) = sync_channel(WAITING);
        let shared = Arc::new(Shared {
            begun: Instant::now(),
            queued: AtomicU64::new(0),
            done: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            writing_since_ms: AtomicU64::new(0),
            error: Mutex::default(),
        });
        let writer = Arc::clone(&shared);
        std::thread::Builder::new().name("log".into()).spawn(move || writer.run(&waiting, output))?;
        Ok(Self { queue, shared })
    }

    /// Waits until all lines were written or refused, so long at most: a reader that stands still holds up no end. Whether
    /// they were.
    pub(crate) fn flush(&self, patience: Duration) -> bool {
        let until = Instant::now() + patience;
        let shared = &self.shared;
        loop {
            if shared.done.load(Ordering::Acquire) >= shared.queued.load(Ordering::Acquire) {
                return true;
            }
            if Instant::now() >= until {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(super) fn status(&self) -> LogStatus {
        let shared = &self.shared;
        let since_ms = shared.writing_since_ms.load(Ordering::Relaxed);
        let stuck = shared.begun.elapsed().saturating_sub(Duration::from_millis(since_ms));
        LogStatus {
            lines: shared.queued.load(Ordering::Relaxed) + shared.dropped.load(Ordering::Relaxed),
            lost_lines: shared.dropped.load(Ordering::Relaxed) + shared.refused.load(Ordering::Relaxed),
            error: shared.error.lock().unwrap_or_else(PoisonError::into_inner).clone(),
            stuck_s: if since_ms > 0 && stuck > STUCK { stuck.as_secs_f64() } else { 0.0 },
        }
    }
}

impl Write for Log {
    /// Takes a line, always.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.shared.queued.fetch_add(1, Ordering::AcqRel);
        let dropped = self.shared.dropped.load(Ordering::Relaxed);
        if self.queue.try_send((dropped, line.to_vec())).is_err() {
            self.shared.queued.fetch_sub(1, Ordering::AcqRel);
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Shared {
    fn run(&self, waiting: &Receiver<Line>, mut output: impl Write) {
        let mut reported = 0;
        for (dropped, line) in waiting {
            let lost = dropped + self.refused.load(Ordering::Relaxed);
            if lost > reported {
                let words = format!("{} lines of this log were lost here\n", lost - reported);
                if self.put(&mut output, words.as_bytes()).is_ok() {
                    reported = lost;
                }
            }
            let written = self.put(&mut output, &line);
            if written.is_err() {
                self.refused.fetch_add(1, Ordering::Relaxed);
            }
            *self.error.lock().unwrap_or_else(PoisonError::into_inner) =
                written.err().map(|error| error.to_string());
            self.done.fetch_add(1, Ordering::AcqRel);
        }
    }

    fn put(&self, output: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
        let now_ms = self.begun.elapsed().as_millis() as u64;
        self.writing_since_ms.store(now_ms + 1, Ordering::Relaxed);
        let mut written = Ok(());
        while !bytes.is_empty() {
            match output.write(bytes) {
                Ok(0) => written = Err(ErrorKind::WriteZero.into()),
                Ok(count) => bytes = &bytes[count..],
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(AGAIN),
                Err(error) => written = Err(error),
            }
            if written.is_err() {
                break;
            }
        }
        self.writing_since_ms.store(0, Ordering::Relaxed);
        written
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Sender, channel};

    /// An output that takes a line for each permission, and refuses it where that says so.
    struct Gate(Receiver<bool>, Arc<Mutex<Vec<u8>>>);

    impl Write for Gate {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.recv() == Ok(false) {
                return Err(ErrorKind::BrokenPipe.into());
            }
            self.1.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn log() -> (Log, Sender<bool>, Arc<Mutex<Vec<u8>>>) {
        let (permit, permits) = channel();
        let text = Arc::default();
        (Log::start(Gate(permits, Arc::clone(&text))).unwrap(), permit, text)
    }

    #[test]
    fn a_reader_that_stands_still_holds_up_no_thread_and_gets_the_number_of_lost_lines() {
        let (mut log, permit, text) = log();
        let most = WAITING as u64 + 1; // the queue and the line in the writer's hand
        log.write_all(b"line 0\n").unwrap();
        while log.shared.writing_since_ms.load(Ordering::Relaxed) == 0 {
            std::thread::sleep(Duration::from_millis(1)); // until it is in the writer's hand
        }
        for line in 1..3 * most {
            log.write_all(format!("line {line}\n").as_bytes()).unwrap();
        }
        let begun = Instant::now();
        assert!(!log.flush(Duration::from_millis(50)));
        assert!(begun.elapsed() >= Duration::from_millis(50), "it waited as long as it was to");
        let lost = log.status().lost_lines;
        assert_eq!(lost, 2 * most);
        std::thread::sleep(STUCK + Duration::from_millis(200));
        assert!(log.status().stuck_s > 1.0);
        drop(permit); // the reader reads on
        assert!(log.flush(Duration::from_secs(60)));
        log.write_all(b"last\n").unwrap();
        assert!(log.flush(Duration::from_secs(60)));
        assert_eq!((log.status().stuck_s, log.status().error), (0.0, None));
        let text = String::from_utf8(text.lock().unwrap().clone()).unwrap();
        assert!(text.starts_with("line 0\nline 1\n"), "{text}");
        assert!(text.ends_with(&format!("\n{lost} lines of this log were lost here\nlast\n")), "{text}");
    }

    #[test]
    fn an_output_that_refuses_is_named_until_it_takes_a_line_again() {
        let (mut log, permit, text) = log();
        permit.send(false).unwrap();
        log.write_all(b"one\n").unwrap();
        log.flush(Duration::from_secs(60));
        assert!(log.status().error.unwrap().contains("broken pipe"));
        assert_eq!((log.status().lines, log.status().lost_lines), (1, 1));
        drop(permit);
        log.write_all(b"two\n").unwrap();
        log.flush(Duration::from_secs(60));
        assert_eq!(log.status().error, None);
        assert_eq!(*text.lock().unwrap(), b"1 lines of this log were lost here\ntwo\n");
    }
}
