//! Which sensors send nothing.

use std::time::{Duration, Instant};

use super::{Monitor, SensorCounters};

/// A sensor that sent nothing for so long is named.
const SILENT: Duration = Duration::from_secs(2);

/// Watches for sensors that fall silent and come back.
#[derive(Debug)]
pub struct DataTimeouts {
    begun: Instant,
    /// Packets seen so far, when they last grew, and whether the sensor was already named.
    sensors: Vec<(u64, Instant, bool)>,
}

/// A sensor sends no data, or sends again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataTimeout {
    /// Its place in the receiver's list.
    pub sensor: usize,
    /// `sensor_silent` or `sensor_heard`.
    pub event: &'static str,
    /// The same in words.
    pub words: String,
}

impl DataTimeouts {
    /// No packet yet.
    pub(crate) fn new(sensors: usize, now: Instant) -> Self {
        Self { begun: now, sensors: vec![(0, now, false); sensors] }
    }

    /// What is new.
    pub(crate) fn poll(&mut self, monitor: &Monitor, now: Instant) -> Vec<DataTimeout> {
        let ports: Vec<u16> = (0..self.sensors.len()).map(|sensor| monitor.address(sensor).port()).collect();
        self.check(&monitor.sensors(), &ports, now)
    }

    /// The same from the counters and local ports of sensors.
    pub(crate) fn check(
        &mut self,
        counters: &[SensorCounters],
        ports: &[u16],
        now: Instant,
    ) -> Vec<DataTimeout> {
        let mut news = Vec::new();
        for (sensor, ((counters, port), (seen, grown, named))) in
            counters.iter().zip(ports).zip(&mut self.sensors).enumerate()
        {
            if counters.packets > *seen {
                if *named {
                    let after_s = now.duration_since(self.begun).as_secs_f64();
                    let words = format!("packets on port {port} since {after_s:.1} s");
                    news.push(DataTimeout { sensor, event: "sensor_heard", words });
                }
                (*seen, *grown, *named) = (counters.packets, now, false);
            } else if !*named && now.duration_since(*grown) >= SILENT {
                *named = true;
                let words = if *seen == 0 {
                    format!("no packets on port {port}: is it powered, is udp_dest set to this host?")
                } else {
                    format!("no packets on port {port} for {} s, after {seen}", SILENT.as_secs())
                };
                news.push(DataTimeout { sensor, event: "sensor_silent", words });
            }
        }
        news
    }

    /// Whether a sensor is silent.
    pub(crate) fn is_silent(&self, sensor: usize) -> bool {
        self.sensors[sensor].2
    }
}
