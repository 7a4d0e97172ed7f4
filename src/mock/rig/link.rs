//! The mock rig as a [`Link`] in simulated time: an hour passes in a second, the same each time.

use std::collections::VecDeque;
use std::time::Duration;

use firmware_protocol::{Frame, LinkCounters, Receiver};

use super::{Damage, MockConfig, MockDevice, MockFault, Proxy};
use crate::drive::{Link, LinkError, Received};

const STEP_US: u64 = 1000;

/// What no line tells.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Since the start, µs.
    pub time_us: u64,
    /// Where the axes really are, µrad.
    pub position_urad: [i32; 2],
    /// Whether the rig may move.
    pub armed: bool,
}

type Watch = Box<dyn FnMut(Truth) + Send>;

/// A mock rig and a line to it.
pub struct SimulatedLink {
    device: MockDevice,
    to_device: Proxy,
    to_host: Proxy,
    receiver: Receiver,
    frames: VecDeque<Received>,
    now_us: u64,
    faults: VecDeque<(u64, MockFault)>,
    others: VecDeque<(u64, Frame)>,
    cut: bool,
    watch: Option<Watch>,
}

impl SimulatedLink {
    /// A rig that is switched on now, on a line that damages `damage` of what it carries.
    pub fn new(config: MockConfig, seed: u64, damage: Damage) -> Self {
        Self {
            device: MockDevice::new(config, seed, 0),
            to_device: Proxy::new(damage, seed, 1),
            to_host: Proxy::new(damage, seed, 2),
            receiver: Receiver::default(),
            frames: VecDeque::new(),
            now_us: 0,
            faults: VecDeque::new(),
            others: VecDeque::new(),
            cut: false,
            watch: None,
        }
    }

    /// Breaks something at a time, µs since the start. Later calls are for later times.
    pub fn inject_at(&mut self, time_us: u64, fault: MockFault) {
        self.faults.push_back((time_us, fault));
    }

    /// Lets another host say something on the same bus at a time, µs since the start. Later calls are for later times.
    pub fn another_says_at(&mut self, time_us: u64, frame: Frame) {
        self.others.push_back((time_us, frame));
    }

    /// Shows the truth every millisecond.
    pub fn watch(&mut self, watch: impl FnMut(Truth) + Send + 'static) {
        self.watch = Some(Box::new(watch));
    }

    fn step(&mut self) {
        self.now_us += STEP_US;
        while self.faults.front().is_some_and(|(time_us, _)| *time_us <= self.now_us) {
            match self.faults.pop_front() {
                Some((_, MockFault::HangUp)) => self.cut = true,
                Some((_, fault)) => self.device.inject(self.now_us, fault),
                None => {}
            }
        }
        while self.others.front().is_some_and(|(time_us, _)| *time_us <= self.now_us) {
            if let Some((_, frame)) = self.others.pop_front() {
                self.device.take(self.now_us, frame.encode().bytes());
            }
        }
        let bytes = self.to_device.receive(self.now_us);
        self.device.take(self.now_us, &bytes);
        let mut out = Vec::new();
        self.device.step(self.now_us, &mut out);
        for frame in out {
            self.to_host.send(self.now_us, &frame);
        }
        for byte in self.to_host.receive(self.now_us) {
            let time_ns = self.now_us * 1000;
            self.frames.extend(self.receiver.push(byte).map(|frame| Received { time_ns, frame }));
        }
        if let ([Some(a), Some(b)], Some(watch)) = (self.device.true_positions_urad(), &mut self.watch) {
            watch(Truth { time_us: self.now_us, position_urad: [a, b], armed: self.device.armed() });
        }
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.cut {
            return Err(LinkError::HungUp { path: self.name().to_owned(), reason: "cut".to_owned() });
        }
        Ok(())
    }
}

impl Link for SimulatedLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        self.check()?;
        self.to_device.send(self.now_us, frame.encode().bytes());
        Ok(())
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        self.check()?;
        let until_us = self.now_us + wait.as_micros() as u64;
        while self.frames.is_empty() && self.now_us < until_us {
            self.step();
            self.check()?;
        }
        Ok(self.frames.pop_front())
    }

    fn now_ns(&self) -> u64 {
        self.now_us * 1000
    }

    fn counters(&self) -> LinkCounters {
        self.receiver.counters()
    }

    fn device_errors(&self, _axis: usize) -> Vec<String> {
        Vec::new()
    }

    fn is_busy(&self) -> bool {
        false
    }

    fn name(&self) -> &str {
        "simulated rig"
    }
}
