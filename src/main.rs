//! The `outrigger` program.

fn main() -> std::process::ExitCode {
    outrigger::commands::run(std::env::args_os())
}
