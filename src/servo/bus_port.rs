//! A serial bus on which one side asks and the other answers: time limits on everything, and the echo of half-duplex
//! adapters taken away.

use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

use super::LinkError;

const WRITE_TIMEOUT: Duration = Duration::from_millis(100);

/// A serial adapter on a bus.
pub(super) struct BusPort {
    path: String,
    port: TTYPort,
    echoes: bool,
    /// What was sent and has not come back yet.
    expected: Vec<u8>,
}

impl BusPort {
    /// Opens an adapter, for this program alone.
    pub fn open(path: &Path, baud: u32) -> Result<Self, LinkError> {
        let path = path.display().to_string();
        let failed = |error: serialport::Error| match error.description.contains("exclusive lock") {
            true => LinkError::InUse { path: path.clone() },
            false => LinkError::Open { path: path.clone(), reason: error.to_string() },
        };
        let port = serialport::new(&path, baud).timeout(WRITE_TIMEOUT).open_native().map_err(failed)?;
        port.clear(serialport::ClearBuffer::Input).map_err(failed)?;
        Ok(Self { path, port, echoes: false, expected: Vec::new() })
    }

    /// The adapter's path.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Whether everything sent comes back. Found out once, at the start: an answer may look like its own question.
    pub fn set_echoes(&mut self, echoes: bool) {
        self.echoes = echoes;
    }

    /// Sends one question.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.expected = if self.echoes { bytes.to_vec() } else { Vec::new() };
        let _ = self.port.set_timeout(WRITE_TIMEOUT); // cannot fail: it is kept in memory
        self.port.write_all(bytes).map_err(|error| match error.kind() {
            ErrorKind::TimedOut => LinkError::WriteTimeout { path: self.path.clone(), after: WRITE_TIMEOUT },
            _ => self.hung_up(&error.to_string()),
        })
    }

    fn hung_up(&self, reason: &str) -> LinkError {
        LinkError::HungUp { path: self.path.clone(), reason: reason.to_owned() }
    }

    /// What came, without the echo; `None` when nothing came before `end`.
    pub fn read(&mut self, end: Instant) -> Result<Option<Vec<u8>>, LinkError> {
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let _ = self.port.set_timeout(left); // cannot fail: it is kept in memory
            let mut bytes = [0; 256];
            let count = match self.port.read(&mut bytes) {
                Ok(0) => return Err(self.hung_up("end of file")),
                Ok(count) => count,
                Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                    continue;
                }
                Err(error) => return Err(self.hung_up(&error.to_string())),
            };
            let same = strip(&mut self.expected, &bytes[..count]);
            if same < count {
                return Ok(Some(bytes[same..count].to_vec()));
            }
        }
    }
}

/// How many of these bytes are the echo that is still expected. An echo that came damaged is not waited for.
fn strip(expected: &mut Vec<u8>, bytes: &[u8]) -> usize {
    let same = expected.iter().zip(bytes).take_while(|(sent, heard)| sent == heard).count();
    let damaged = same < expected.len() && same < bytes.len();
    expected.drain(..if damaged { expected.len() } else { same });
    same
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_echo_is_taken_away_in_pieces_and_only_once() {
        let mut expected = b"ask".to_vec();
        assert_eq!(strip(&mut expected, b"as"), 2);
        assert_eq!(strip(&mut expected, b"kask"), 1, "the same bytes again are an answer");
        assert!(expected.is_empty());
        let mut expected = b"ask".to_vec();
        assert_eq!(strip(&mut expected, b"axxx"), 1);
        assert!(expected.is_empty(), "a damaged echo is not waited for");
    }
}
