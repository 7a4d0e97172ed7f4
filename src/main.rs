//! The `outrigger` program.
#![allow(unsafe_code)] // a signal is ignored, before there is any thread that it could disturb

use nix::sys::signal::{SigHandler, Signal, signal};

fn main() -> std::process::ExitCode {
    // a file that may not grow (ulimit -f) is an error of whoever writes it, which says so, and not the program's death;
    // SAFETY: no handler is installed that could run where it must not
    let _ = unsafe { signal(Signal::SIGXFSZ, SigHandler::SigIgn) }; // refused only for signals that cannot be caught
    outrigger::commands::run_command_line(std::env::args_os())
}
