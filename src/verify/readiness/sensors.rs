//! What a rig.toml names: files are read, web interfaces asked, and all that held against each other.

use std::collections::BTreeMap;

use sensors::ouster::Metadata;
use sensors::velodyne::Product;

use super::{Check, CheckState};
use crate::base::errors::with_causes;
use crate::live::config::{Config, SensorConfig};
use crate::live::setup::{Sensor, SensorState, warnings};
use crate::live::watch::{is_model, read_metadata};

/// What was found.
#[derive(Default)]
pub(crate) struct ConfiguredSensors {
    pub checks: Vec<Check>,
    /// Metadata by the names of sensors, as recording will have them.
    pub metadata: BTreeMap<String, String>,
    /// What all sensors will send together, with two returns where that is not known; none where one's rate is not.
    pub bytes_s: Option<f64>,
    /// Of the sensors of the mount file that axis 0, 1, ... turn.
    pub pitches_deg: Vec<f64>,
}

impl ConfiguredSensors {
    /// Reads the files of all sensors and asks them.
    pub(crate) fn of(config: &Config) -> Self {
        let mut named = Self::default();
        let mut units: BTreeMap<String, String> = BTreeMap::new();
        for sensor in config.sensors.iter().filter(|sensor| sensor.listen.is_some()) {
            let state = named.ask(sensor);
            let serial = named.read(sensor, state.as_ref());
            let Some(serial) = serial.filter(|serial| !serial.is_empty()) else { continue };
            if let Some(other) = units.insert(serial.clone(), sensor.name.clone()) {
                let found = format!("{other} and {} both claim to be the unit {serial}", sensor.name);
                named.bad(
                    "sensors",
                    found,
                    "each [[sensor]] has the `metadata` and the `host` of its own unit",
                );
            }
        }
        let rates = config.sensors.iter().filter(|sensor| sensor.listen.is_some());
        let rates: Option<Vec<f64>> =
            rates.map(|sensor| sensor.bytes_per_s(named.metadata.get(&sensor.name))).collect();
        named.bytes_s = rates.map(|rates| rates.iter().sum()).filter(|bytes_s| *bytes_s > 0.0);
        named
    }

    pub(crate) fn add(&mut self, name: &str, state: CheckState, found: String, advice: &str) {
        self.checks.push(Check::new(name, state, found, advice));
    }

    pub(crate) fn bad(&mut self, name: &str, found: String, advice: &str) {
        self.add(name, CheckState::Bad, found, advice);
    }

    /// What a sensor says of itself.
    fn ask(&mut self, config: &SensorConfig) -> Option<SensorState> {
        let name = format!("sensor {}", config.name);
        let mut state = match Sensor::at(config.host.as_ref()?).and_then(|sensor| sensor.read()) {
            Ok(state) => state,
            Err(error) => {
                self.bad(
                    &name,
                    error.to_string(),
                    "`outrigger sensor discover` finds sensors on this network",
                );
                return None;
            }
        };
        let found = format!("{} {} firmware {}, {}", state.model, state.serial, state.firmware, state.status);
        if is_model(&config.model, &state.model, &state.model) {
            self.add(&name, CheckState::Ok, found, "");
        } else {
            let found = format!("{found}; `model` says {}", config.model);
            self.bad(&name, found, "correct `model`, or `host`");
        }
        for warning in std::mem::take(&mut state.warnings) {
            self.add(
                &name,
                CheckState::Warning,
                warning.text,
                "`outrigger sensor configure` sets what it can",
            );
        }
        Some(state)
    }

    /// The metadata of a sensor, from its file or else from itself; which unit it is.
    fn read(&mut self, config: &SensorConfig, state: Option<&SensorState>) -> Option<String> {
        let name = format!("metadata of {}", config.name);
        let serial = state.map(|state| state.serial.clone());
        let theirs = state.and_then(|state| state.metadata.clone());
        let Some(path) = &config.metadata else {
            if let Some(text) = theirs {
                self.metadata.insert(config.name.clone(), text);
            } else if config.host.is_none() && Product::from_name(&config.model).is_none() {
                let found =
                    "neither `metadata` nor `host` is named: what is recorded cannot be decoded".to_owned();
                self.bad(&name, found, "`outrigger sensor info HOST --save-metadata FILE.json` saves them");
            }
            return serial;
        };
        let text = match read_metadata(path) {
            Ok(text) => text,
            Err(error) => {
                let advice = "`outrigger sensor info HOST --save-metadata FILE.json` writes it";
                self.bad(&name, with_causes(&error), advice);
                return serial;
            }
        };
        let differences = theirs.and_then(|theirs| warnings::of_metadata(&theirs, &text).ok());
        for warning in differences.unwrap_or_default() {
            self.bad(&name, warning.text, "save them again, with the sensor as it is to be recorded");
        }
        let ours = Metadata::parse(&text, &path.display().to_string()).ok()?;
        let found = format!("{} {}, {}", ours.product(), ours.serial, path.display());
        if is_model(&config.model, &ours.product(), &ours.product()) {
            self.add(&name, CheckState::Ok, found, "");
        } else {
            let found = format!("{found}; `model` says {}", config.model);
            self.bad(&name, found, "correct `model`, or name the metadata of this sensor");
        }
        self.metadata.insert(config.name.clone(), text);
        Some(ours.serial)
    }
}
