//! Where the memory is, with the bounds that keep it there.

use super::Core;
use crate::daemon::live;
use crate::daemon::status::MemoryStatus;

/// As it is now.
pub(super) fn memory(core: &Core) -> MemoryStatus {
    let datagrams = core.intake.memory();
    let decode_queues = core.decode_queues();
    MemoryStatus {
        resident: resident_bytes(),
        packets: datagrams.held_bytes as u64,
        queue: datagrams.waiting_bytes as u64,
        queue_most: datagrams.max_waiting_bytes as u64,
        queue_limit: core.intake.queue_limit_bytes() as u64,
        picture_most: decode_queues.iter().map(|decode_queue| decode_queue.max_waiting_bytes() as u64).sum(),
        picture_limit: (decode_queues.len() * live::WAITING_BYTES) as u64,
        coverage: core.coverage.bytes() as u64,
        map: core.survey.bytes() as u64,
    }
}

/// Resident memory of this process (proc_pid_status(5), `VmRSS`).
fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_process_knows_what_it_takes() {
        let resident = super::resident_bytes().unwrap();
        assert!(resident > 1 << 20 && resident < 1 << 40, "{resident}");
    }
}
