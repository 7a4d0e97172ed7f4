//! What the benches share: processor time, medians, and a Python peer asked in the same run.

/// Processor time of this thread, s: what a busy machine takes from a run does not count.
#[allow(dead_code)] // not every bench measures itself
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
#[allow(dead_code)] // not every bench measures itself
pub fn median_cpu_s(repetitions: usize, mut call: impl FnMut()) -> f64 {
    let times_s = (0..repetitions).map(|_| {
        let start = thread_cpu_s();
        call();
        thread_cpu_s() - start
    });
    median(times_s.collect())
}

/// A number that the environment names, or the usual one.
#[allow(dead_code)] // not every bench is told
pub fn environment(name: &str, usual: f64) -> f64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// What another process takes.
#[allow(dead_code)] // not every bench starts one
pub struct Usage {
    /// Resident memory, MiB.
    pub resident_mib: f64,
    /// Processor time so far, s.
    pub cpu_s: f64,
}

#[allow(dead_code)] // not every bench starts one
impl Usage {
    /// Now (proc_pid_status(5), proc_pid_stat(5)).
    pub fn of(child: &std::process::Child) -> Self {
        let read =
            |name: &str| std::fs::read_to_string(format!("/proc/{}/{name}", child.id())).expect("it runs");
        let status = read("status");
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0 kB");
        let resident_kib: f64 = resident.trim().trim_end_matches(" kB").parse().unwrap_or(0.0);
        let stat = read("stat");
        let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
        let ticks: f64 = after_name
            .split_whitespace()
            .skip(11)
            .take(2)
            .filter_map(|field| field.parse::<f64>().ok())
            .sum();
        Self { resident_mib: resident_kib / 1024.0, cpu_s: ticks / 100.0 }
    }
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
