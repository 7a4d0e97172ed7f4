//! What the benches share: processor time, medians, and a Python peer asked in the same run.

/// Processor time of this thread, s: what a busy machine takes from a run does not count.
pub fn thread_cpu_s() -> f64 {
    let now =
        nix::time::clock_gettime(nix::time::ClockId::CLOCK_THREAD_CPUTIME_ID).expect("every Linux has it");
    now.tv_sec() as f64 + 1e-9 * now.tv_nsec() as f64
}

/// Processor time of all threads, s.
#[allow(dead_code)] // not every bench has threads
pub fn process_cpu_s() -> f64 {
    let now =
        nix::time::clock_gettime(nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID).expect("every Linux has it");
    now.tv_sec() as f64 + 1e-9 * now.tv_nsec() as f64
}

/// Median processor time of a call on this thread, s.
pub fn median_cpu_s(repetitions: usize, mut call: impl FnMut()) -> f64 {
    let times_s = (0..repetitions).map(|_| {
        let start = thread_cpu_s();
        call();
        thread_cpu_s() - start
    });
    median(times_s.collect())
}

/// The middle one.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// What a Python script prints, run by the interpreter that `PYTHON` names (`python3` otherwise) on one thread. None,
/// with the reason on stderr, where that fails.
#[allow(dead_code)] // not every bench has a peer
pub fn python(script: &str, arguments: &[String]) -> Option<String> {
    let python = std::env::var("PYTHON").unwrap_or("python3".into());
    let script = format!("{}/tests/bench/{script}", env!("CARGO_MANIFEST_DIR"));
    let mut command = std::process::Command::new(python);
    let output = command.arg(&script).args(arguments).env("OMP_NUM_THREADS", "1").output().ok()?;
    if !output.status.success() {
        let errors = String::from_utf8_lossy(&output.stderr);
        eprintln!("{script}: {}", errors.lines().last().unwrap_or_default());
        return None;
    }
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}
