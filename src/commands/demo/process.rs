//! Mock devices as processes of their own: what can be killed, unplugged and silent in the field can be so here.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::Context as _;
use serde::de::DeserializeOwned;

/// A mock device that runs as a child; it ends when this is dropped.
#[derive(Debug)]
pub struct MockProcess {
    what: String,
    child: Child,
    lines: Receiver<String>,
}

impl MockProcess {
    /// Starts `outrigger ARGUMENTS`.
    pub fn start(what: &str, arguments: &[String]) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("this program does not know its own path")?;
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start the {what}"))?;
        let stdout = child.stdout.take().with_context(|| format!("the {what} has no stdout"))?;
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Ok(Self { what: what.to_owned(), child, lines })
    }

    /// The next line it prints, as JSON; an error when it ends or stays silent.
    pub fn next_line<T: DeserializeOwned>(&mut self, within: Duration) -> anyhow::Result<T> {
        let line = match self.lines.recv_timeout(within) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => anyhow::bail!("the {} said nothing for {within:?}", self.what),
            Err(RecvTimeoutError::Disconnected) => {
                let status = self.child.wait().map_or("unknown".to_owned(), |status| status.to_string());
                anyhow::bail!("the {} ended before it was ready ({status})", self.what)
            }
        };
        serde_json::from_str(&line).with_context(|| format!("the {} printed {line:?}", self.what))
    }

    /// The last line printed so far, as JSON.
    pub fn last_line<T: DeserializeOwned>(&mut self) -> Option<T> {
        self.lines.try_iter().filter_map(|line| serde_json::from_str(&line).ok()).last()
    }

    /// How it ended, if it did.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Ends it at once, as a pulled plug would.
    pub fn kill(&mut self) {
        // it may have ended by itself: both calls then have nothing to do
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for MockProcess {
    fn drop(&mut self) {
        self.kill();
    }
}
