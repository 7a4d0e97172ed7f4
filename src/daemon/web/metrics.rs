//! The state as Prometheus reads it (text exposition format 0.0.4). (Own code: the crates keep counters of their own, and
//! this is a snapshot of a state that others count.)

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::daemon::status::{ComponentState, SensorState, Severity};
use crate::daemon::{Percentiles, SensorStatus, Status};

/// Name, help, and value of a sensor.
type Metric<T> = (&'static str, &'static str, fn(&SensorStatus) -> T);

/// All metrics.
pub(super) fn text(status: &Status, picture: &[Percentiles], missed: u64) -> String {
    let mut out = Text::default();
    out.one("outrigger_uptime_seconds", "Since the daemon started.", status.uptime_s);
    out.one("outrigger_state_age_seconds", "Since these values were put together.", status.age_ms * 1e-3);
    let dead = status.components.iter().filter(|component| component.state == ComponentState::Dead).count();
    out.one("outrigger_components_dead", "Parts of the daemon that died.", dead as f64);
    let lost_lines = status.log.lost_lines as f64;
    out.one("outrigger_log_lost_lines_total", "Lines of the log without a reader.", lost_lines);
    let counters: [Metric<u64>; 5] = [
        ("outrigger_sensor_packets_total", "Packets received.", |sensor| sensor.packets),
        ("outrigger_sensor_frames_total", "Revolutions decoded.", |sensor| sensor.frames),
        ("outrigger_sensor_frames_complete_total", "Whole revolutions decoded.", |sensor| {
            sensor.complete_frames
        }),
        ("outrigger_sensor_restarts_total", "Times the sensor was initialised again.", |sensor| {
            sensor.restarts
        }),
        (
            "outrigger_sensor_picture_dropped_total",
            "Packets left out of the picture, and recorded.",
            |sensor| sensor.picture_dropped,
        ),
    ];
    for (name, help, value) in counters {
        let rows =
            status.sensors.iter().map(|sensor| (format!("sensor=\"{}\"", sensor.name), value(sensor) as f64));
        out.many(name, help, rows);
    }
    let losses = status.sensors.iter().flat_map(|sensor| {
        let of = sensor.losses;
        [
            ("kernel", of.kernel_dropped),
            ("queue", of.queue_dropped),
            ("on_the_way", of.in_network),
            ("malformed", of.malformed),
            ("checksum", of.crc_errors),
            ("late", of.late),
        ]
        .map(|(at, count)| (format!("sensor=\"{}\",at=\"{at}\"", sensor.name), count as f64))
    });
    out.many("outrigger_sensor_lost_packets_total", "Packets lost, by where.", losses);
    let gauges: [Metric<f64>; 6] = [
        ("outrigger_sensor_up", "1 while packets come and are decoded.", |sensor| {
            f64::from(u8::from(sensor.state == SensorState::Ok))
        }),
        (
            "outrigger_sensor_last_packet_age_seconds",
            "Since its last packet; NaN before the first.",
            |sensor| sensor.last_packet_age_s.unwrap_or(f64::NAN),
        ),
        ("outrigger_sensor_decoded_age_seconds", "Since what is decoded of it was put out.", |sensor| {
            sensor.decoded_age_ms.map_or(f64::NAN, |age_ms| age_ms * 1e-3)
        }),
        ("outrigger_sensor_packets_per_second", "Packets received.", |sensor| sensor.packets_per_s),
        ("outrigger_sensor_points_per_second", "Returns decoded.", |sensor| sensor.points_per_s),
        ("outrigger_sensor_clock_offset_seconds", "Host minus device; NaN while not known.", |sensor| {
            sensor.clock.as_ref().map_or(f64::NAN, |clock| clock.host_minus_device_s)
        }),
    ];
    for (name, help, value) in gauges {
        let rows = status.sensors.iter().map(|sensor| (format!("sensor=\"{}\"", sensor.name), value(sensor)));
        out.many(name, help, rows);
    }
    let recorder = &status.recorder;
    let flag = |flag: bool| f64::from(u8::from(flag));
    out.all([
        ("outrigger_recorder_age_seconds", "Since the recorder put this out.", recorder.age_ms * 1e-3),
        ("outrigger_recording", "1 while a session is open.", flag(recorder.recording)),
        ("outrigger_recorder_session_packets", "Packets in the open session.", recorder.packets as f64),
        ("outrigger_recorder_session_bytes", "Payload bytes in it.", recorder.bytes as f64),
        ("outrigger_recorder_session_lost", "Packets lost since it began.", recorder.session_lost as f64),
        ("outrigger_recorder_lost_total", "Packets lost in closed sessions.", recorder.lost as f64),
        ("outrigger_recorder_stalled_seconds", "How long the disk holds up a write.", recorder.stalled_s),
    ]);
    let free = recorder.free_bytes.map_or(f64::NAN, |bytes| bytes as f64);
    out.one("outrigger_disk_free_bytes", "Free where sessions go.", free);
    out.summary("outrigger_recorder_latency_seconds", "Kernel stamp to session.", "", &recorder.latency);
    for (sensor, picture) in status.sensors.iter().zip(picture) {
        let label = format!("sensor=\"{}\"", sensor.name);
        out.summary(
            "outrigger_picture_latency_seconds",
            "Kernel stamp to the page's connections.",
            &label,
            picture,
        );
    }
    out.one("outrigger_pages_missed_total", "Messages that slow pages missed.", missed as f64);
    let memory = &status.memory;
    let resident = memory.resident.map_or(f64::NAN, |bytes| bytes as f64);
    out.one("process_resident_memory_bytes", "Resident memory.", resident);
    for (name, help, bytes) in [
        ("outrigger_packet_buffer_bytes", "Buffers of packets.", memory.packets),
        ("outrigger_queue_bytes", "Packets that wait for the recorder.", memory.queue),
        ("outrigger_queue_limit_bytes", "More never waits for it.", memory.queue_limit),
        ("outrigger_coverage_bytes", "Cells of the coverage.", memory.coverage),
    ] {
        out.one(name, help, bytes as f64);
    }
    if let Some(coverage) = &status.coverage {
        let age_s = coverage.last_point_age_s.unwrap_or(f64::NAN);
        out.one("outrigger_coverage_age_seconds", "Since points were last counted.", age_s);
        out.one("outrigger_coverage_seen_cells", "Cells seen.", coverage.seen as f64);
        if let (Some(predicted), Some(confirmed)) = (coverage.predicted, coverage.seen_of_predicted) {
            out.one("outrigger_coverage_predicted_cells", "Predicted cells.", predicted as f64);
            out.one(
                "outrigger_coverage_predicted_seen_cells",
                "Predicted cells that were seen.",
                confirmed as f64,
            );
        }
    }
    if let Some(rig) = &status.rig {
        out.one("outrigger_rig_connected", "1 while the rig answers.", flag(rig.connected));
        if let Some(of) = &rig.status {
            out.one("outrigger_rig_armed", "1 while motion is allowed.", flag(of.armed));
            for (name, help, value) in [
                ("outrigger_rig_pitch_degrees", "Achieved.", 0),
                ("outrigger_rig_target_degrees", "Wanted.", 1),
                ("outrigger_rig_age_seconds", "Since that was measured.", 2),
            ] {
                let rows = of.axes.iter().map(|axis| {
                    (
                        format!("axis=\"{}\"", axis.axis),
                        [axis.position_deg, axis.target_deg, axis.age_ms * 1e-3][value],
                    )
                });
                out.many(name, help, rows);
            }
        }
    }
    let kinds = status.problems.iter().fold(BTreeMap::new(), |mut kinds, problem| {
        *kinds.entry((&problem.about, problem.kind)).or_insert(0.0) += 1.0;
        kinds
    });
    let rows =
        kinds.into_iter().map(|((about, kind), count)| (format!("about=\"{about}\",kind=\"{kind}\""), count));
    out.many("outrigger_problem", "What is wrong now, by kind; no row for what is well.", rows);
    for (severity, word) in [(Severity::Error, "error"), (Severity::Warning, "warning")] {
        let count = status.problems.iter().filter(|problem| problem.severity == severity).count();
        let rows = std::iter::once((format!("severity=\"{word}\""), count as f64));
        out.many("outrigger_problems", "What is wrong now.", rows);
    }
    out.text
}

#[derive(Default)]
struct Text {
    text: String,
    last: String,
}

impl Text {
    fn all<const N: usize>(&mut self, metrics: [(&str, &str, f64); N]) {
        metrics.into_iter().for_each(|(name, help, value)| self.one(name, help, value));
    }

    fn one(&mut self, name: &str, help: &str, value: f64) {
        self.many(name, help, std::iter::once((String::new(), value)));
    }

    fn many(&mut self, name: &str, help: &str, rows: impl Iterator<Item = (String, f64)>) {
        let kind = if name.ends_with("_total") { "counter" } else { "gauge" };
        self.head(name, kind, help);
        for (labels, value) in rows {
            self.row(name, &labels, value);
        }
    }

    fn summary(&mut self, name: &str, help: &str, labels: &str, of: &Percentiles) {
        self.head(name, "summary", help);
        let comma = if labels.is_empty() { "" } else { "," };
        for (quantile, ms) in [("0.5", of.p50_ms), ("0.99", of.p99_ms)] {
            self.row(name, &format!("{labels}{comma}quantile=\"{quantile}\""), ms * 1e-3);
        }
        self.row(&format!("{name}_count"), labels, of.count as f64);
    }

    fn head(&mut self, name: &str, kind: &str, help: &str) {
        if self.last != name {
            name.clone_into(&mut self.last);
            let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}"); // a String takes everything
        }
    }

    fn row(&mut self, name: &str, labels: &str, value: f64) {
        let labels = if labels.is_empty() { String::new() } else { format!("{{{labels}}}") };
        let _ = writeln!(self.text, "{name}{labels} {value}");
    }
}
