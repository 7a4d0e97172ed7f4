//! Sensors over their own web interfaces: what they are, how they are set, their faults; new settings, read back and
//! saved.
//!
//! Everything read is bounded in size and time ([`http`]); what a sensor says is shown, compared and stored, and never believed
//! where it can be read back.

use serde::Serialize;
use serde_json::Value;

pub mod discover;
pub mod http;
pub mod ouster;
pub mod velodyne;
pub mod warnings;

pub use http::{Http, SetupError};

/// Maker of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Vendor {
    /// HTTP API under `/api/v1`.
    Ouster,
    /// Forms under `/cgi`.
    Velodyne,
}

/// Something that an operator should know, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// A word that programs can match: `clock_not_locked`, `thermal`, `shot_limiting`, `laser_disabled`, `not_running`,
    /// `destination`, `metadata_mismatch`, `setting_differs`, `alert`, `unknown`.
    pub kind: &'static str,
    /// In words.
    pub text: String,
}

/// Where a sensor sends its packets.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Destination {
    /// Address or name of the host.
    pub host: String,
    /// UDP port of lidar packets.
    pub port: Option<u16>,
    /// UDP port of IMU (Ouster) or position packets (Velodyne).
    #[serde(rename = "aside_port")]
    pub auxiliary_port: Option<u16>,
}

/// A sensor's clock as it says itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Clock {
    /// Where it takes its time from: `TIME_FROM_PTP_1588`, `pps`, ...
    pub source: String,
    /// Whether it follows that; absent where nothing is to be followed or the sensor does not say.
    pub locked: Option<bool>,
    /// What it says, in its own words.
    pub detail: String,
}

/// Everything read from a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorState {
    /// Where it was asked.
    pub address: String,
    /// Its maker.
    pub vendor: Vendor,
    /// Product line or model, as it says.
    pub model: String,
    /// Serial number, as it says.
    pub serial: String,
    /// Firmware, as it says.
    pub firmware: String,
    /// What it is doing: `RUNNING`, `STANDBY`, `On`, ...
    pub status: String,
    /// Where its packets go.
    pub destination: Destination,
    /// Every setting, as it says.
    pub settings: Value,
    /// Its clock.
    pub clock: Clock,
    /// Inside, °C.
    pub temperature_c: Option<f64>,
    /// Its faults.
    pub warnings: Vec<Warning>,
    /// Metadata of an Ouster, as it came; what a decoder needs.
    #[serde(skip)]
    pub metadata: Option<String>,
}

/// One setting before and after.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// Its name in the sensor's interface.
    pub key: String,
    /// What it was.
    pub before: Value,
    /// What was asked for.
    pub wanted: Value,
    /// What it is, read back.
    pub after: Value,
    /// Whether the sensor took it.
    #[serde(rename = "taken")]
    pub is_accepted: bool,
}

/// What came of setting a sensor up.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Configured {
    /// One per setting that was asked for.
    pub changes: Vec<Change>,
    /// Whether the sensor was ordered to keep them without power.
    pub saved: bool,
    /// The sensor afterwards.
    pub state: SensorState,
}

impl Configured {
    /// Settings that the sensor did not take.
    pub fn refused(&self) -> impl Iterator<Item = &Change> {
        self.changes.iter().filter(|change| !change.is_accepted)
    }
}

/// New settings; none of them changes anything that is absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Where to send packets: a host, or `auto` for whoever asks (Ouster).
    pub host: Option<String>,
    /// UDP port of lidar packets.
    pub port: Option<u16>,
    /// UDP port of IMU or position packets.
    pub auxiliary_port: Option<u16>,
    /// Settings by their names in the sensor's interface.
    pub settings: Vec<(String, Value)>,
    /// Keep them without power.
    pub save: bool,
    /// How long the sensor may take until it runs again.
    pub within: std::time::Duration,
}

impl Wanted {
    /// Whether nothing is asked for.
    pub(crate) fn is_empty(&self) -> bool {
        self.host.is_none()
            && self.port.is_none()
            && self.auxiliary_port.is_none()
            && self.settings.is_empty()
            && !self.save
    }
}

/// A sensor behind its web interface.
#[derive(Debug)]
pub enum Sensor {
    /// An Ouster.
    Ouster(ouster::Ouster),
    /// A Velodyne.
    Velodyne(velodyne::Velodyne),
}

impl Sensor {
    /// Asks who answers at `HOST[:PORT]`.
    pub fn at(address: &str) -> Result<Self, SetupError> {
        Self::behind(&Http::new(address)?)
    }

    /// Asks who answers there.
    pub fn behind(http: &Http) -> Result<Self, SetupError> {
        let as_ouster = match ouster::Ouster::recognise(http) {
            Ok(Some(sensor)) => return Ok(Self::Ouster(sensor)),
            Ok(None) => "no Ouster".to_owned(),
            // a server that answers nothing will not answer another question
            Err(
                error @ (SetupError::Unreachable { .. }
                | SetupError::Broken { .. }
                | SetupError::Status { status: 503, .. }),
            ) => return Err(error),
            Err(error) => error.to_string(),
        };
        let address = http.address().to_owned();
        match velodyne::Velodyne::recognise(http) {
            Ok(Some(sensor)) => Ok(Self::Velodyne(sensor)),
            Ok(None) => Err(SetupError::Unknown { address, reason: as_ouster }),
            Err(error) => Err(SetupError::Unknown { address, reason: format!("{as_ouster}; {error}") }),
        }
    }

    /// Settings in force, by the names of its own interface.
    pub fn config(&self) -> Result<Value, SetupError> {
        match self {
            Self::Ouster(sensor) => sensor.config(),
            Self::Velodyne(sensor) => sensor.settings(),
        }
    }

    /// Reads everything.
    pub fn read(&self) -> Result<SensorState, SetupError> {
        match self {
            Self::Ouster(sensor) => sensor.read(),
            Self::Velodyne(sensor) => sensor.read(),
        }
    }

    /// Sets it up, reads back what it took, and saves it if wanted.
    pub fn configure(&self, wanted: &Wanted) -> Result<Configured, SetupError> {
        match self {
            Self::Ouster(sensor) => sensor.configure(wanted),
            Self::Velodyne(sensor) => sensor.configure(wanted),
        }
    }
}

/// A field of a document by its path; what is wrong with it when it is not there.
pub(crate) fn text_of(document: &Value, path: &str) -> String {
    match document.pointer(path) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Null) | None => String::new(),
        Some(other) => other.to_string(),
    }
}

/// A port, written as a number or as text.
pub(crate) fn port_of(document: &Value, path: &str) -> Option<u16> {
    match document.pointer(path)? {
        Value::Number(number) => u16::try_from(number.as_u64()?).ok(),
        Value::String(text) => text.parse().ok(),
        _ => None,
    }
}

/// A number, written as such or as text; sensors do both.
pub(crate) fn number_of(document: &Value, path: &str) -> Option<f64> {
    match document.pointer(path)? {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    }
}
