//! Sending on a CAN interface with a queue that may be full.
//!
//! SocketCAN says ENOBUFS at once, whatever the socket's time limit is, and no poll tells when there is room again
//! (`Documentation/networking/can.rst`, "transmit queue"). So a message is offered again until its time is over, and then the
//! error says how often: nothing is lost without a word.

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use super::LinkError;

/// Time between two offers: about six messages at 500 kbit/s.
const AGAIN: Duration = Duration::from_millis(2);

/// Sends one message, or says why not.
pub(super) fn send(
    name: &str,
    within: Duration,
    mut write: impl FnMut() -> io::Result<()>,
) -> Result<(), LinkError> {
    let started = Instant::now();
    let mut offers = 0u32;
    loop {
        offers += 1;
        match write() {
            Ok(()) => return Ok(()),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if is_full(&error) => {
                if started.elapsed() >= within {
                    return Err(LinkError::QueueFull { path: name.to_owned(), after: within, offers });
                }
                std::thread::sleep(AGAIN);
            }
            Err(error) => {
                return Err(LinkError::HungUp { path: name.to_owned(), reason: error.to_string() });
            }
        }
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
        || error.raw_os_error() == Some(nix::libc::ENOBUFS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_queue_is_waited_for_and_then_named() {
        let mut offers = 0;
        let write = || {
            offers += 1;
            if offers < 5 { Err(io::Error::from_raw_os_error(nix::libc::ENOBUFS)) } else { Ok(()) }
        };
        send("can:can0", Duration::from_secs(60), write).unwrap();
        assert_eq!(offers, 5, "sent once, after four refusals");
        let full = || Err(io::Error::from_raw_os_error(nix::libc::ENOBUFS));
        let error = send("can:can0", Duration::from_millis(10), full).unwrap_err();
        assert!(matches!(error, LinkError::QueueFull { offers: 2.., .. }), "{error}");
        assert!(
            error.to_string().contains("can:can0") && error.to_string().contains("acknowledges"),
            "{error}"
        );
        let down = || Err(io::Error::from_raw_os_error(nix::libc::ENETDOWN));
        let error = send("can:can0", Duration::from_secs(60), down).unwrap_err();
        assert!(matches!(error, LinkError::HungUp { .. }), "{error}");
    }
}
