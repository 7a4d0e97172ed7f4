//! The `outrigger` program: parse, dispatch, exit code.

use clap::Parser;

fn main() -> std::process::ExitCode {
    outrigger::commands::Cli::parse().run()
}
