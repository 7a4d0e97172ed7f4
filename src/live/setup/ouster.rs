//! Ouster sensors: the HTTP API of firmware 2.x and 3.x (Ouster "HTTP API Reference", `/api/v1`).

use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use super::{
    Change, Clock, Configured, Destination, Http, SensorState, SetupError, Vendor, Wanted, port_of, text_of,
    warnings,
};

/// Firmware from which on settings are staged with POST; before, they are arguments of commands.
const STAGING: [u32; 2] = [3, 1];
const ASK_AGAIN: Duration = Duration::from_millis(300);

/// A sensor.
#[derive(Debug)]
pub struct Ouster {
    http: Http,
    firmware: String,
}

impl Ouster {
    /// The sensor that answers there, if it is one.
    pub(crate) fn recognise(http: &Http) -> Result<Option<Self>, SetupError> {
        let Some(info) = http.find_json("/api/v1/sensor/metadata/sensor_info")? else { return Ok(None) };
        if text_of(&info, "/prod_line").is_empty() {
            let url = format!("http://{}/api/v1/sensor/metadata/sensor_info", http.address());
            return Err(SetupError::Unexpected {
                url,
                expected: "a document with prod_line",
                body: info.to_string(),
            });
        }
        let system = http.find_json("/api/v1/system/firmware")?;
        let firmware = system.map(|system| text_of(&system, "/fw")).filter(|firmware| !firmware.is_empty());
        let firmware = firmware.unwrap_or_else(|| text_of(&info, "/image_rev"));
        Ok(Some(Self { http: http.clone(), firmware }))
    }

    /// The metadata document, as it comes.
    pub(crate) fn metadata(&self) -> Result<String, SetupError> {
        self.http.get("/api/v1/sensor/metadata")
    }

    /// Settings in force.
    pub(crate) fn config(&self) -> Result<Value, SetupError> {
        let path = if self.stages() {
            "/api/v1/sensor/config"
        } else {
            "/api/v1/sensor/cmd/get_config_param?args=active"
        };
        let config = self.http.get_json(path)?;
        if config.is_object() {
            return Ok(config);
        }
        let url = format!("http://{}{path}", self.http.address());
        Err(SetupError::Unexpected { url, expected: "an object of settings", body: config.to_string() })
    }

    fn stages(&self) -> bool {
        stages(&self.firmware)
    }

    /// Reads everything.
    pub(crate) fn read(&self) -> Result<SensorState, SetupError> {
        let info = self.http.get_json("/api/v1/sensor/metadata/sensor_info")?;
        let settings = self.config()?;
        let telemetry = self.http.find_json("/api/v1/sensor/telemetry")?.unwrap_or_default();
        let alerts = self.http.find_json("/api/v1/sensor/alerts?mode=summary")?.unwrap_or_default();
        let time = self.http.find_json("/api/v1/time")?.unwrap_or_default();
        let status = text_of(&info, "/status");
        // in stand-by some sensors have none to give
        let metadata = match self.metadata() {
            Ok(metadata) => Some(metadata),
            Err(SetupError::Status { .. }) if status != "RUNNING" => None,
            Err(error) => return Err(error),
        };
        let clock = clock(&settings, &time, &telemetry);
        let mut state = SensorState {
            address: self.http.address().to_owned(),
            vendor: Vendor::Ouster,
            model: text_of(&info, "/prod_line"),
            serial: text_of(&info, "/prod_sn"),
            firmware: self.firmware.clone(),
            status,
            destination: Destination {
                host: [text_of(&settings, "/udp_dest"), text_of(&settings, "/udp_ip")]
                    .into_iter()
                    .find(|host| !host.is_empty())
                    .unwrap_or_default(),
                port: port_of(&settings, "/udp_port_lidar"),
                auxiliary_port: port_of(&settings, "/udp_port_imu"),
            },
            settings,
            clock,
            temperature_c: super::number_of(&telemetry, "/internal_temperature_deg_c"),
            warnings: Vec::new(),
            metadata,
        };
        state.warnings = warnings::of_ouster(&state, &alerts, &telemetry);
        Ok(state)
    }

    /// Sets it up, reads back what it took, and saves it if wanted.
    pub(crate) fn configure(&self, wanted: &Wanted) -> Result<Configured, SetupError> {
        let before = self.config()?;
        let settings = self.settings_of(wanted, &before)?;
        if !settings.is_empty() {
            self.put(&settings)?;
            self.wait(wanted.within)?;
        }
        let after = self.config()?;
        let changes: Vec<Change> = settings
            .into_iter()
            .map(|(key, wanted)| {
                let (before, after) = (of(&before, &key), of(&after, &key));
                let is_accepted = same(&wanted, &after);
                Change { key, before, wanted, after, is_accepted }
            })
            .collect();
        let saved = wanted.save && changes.iter().all(|change| change.is_accepted);
        if saved {
            self.save()?;
        }
        Ok(Configured { changes, saved, state: self.read()? })
    }

    fn settings_of(&self, wanted: &Wanted, before: &Value) -> Result<Map<String, Value>, SetupError> {
        let mut settings = Map::new();
        if let Some(host) = &wanted.host {
            // before firmware 2.0 the key has another name
            let key = if before.get("udp_dest").is_none() && before.get("udp_ip").is_some() {
                "udp_ip"
            } else {
                "udp_dest"
            };
            settings.insert(key.into(), if host == "auto" { "@auto".into() } else { host.as_str().into() });
        }
        for (key, port) in [("udp_port_lidar", wanted.port), ("udp_port_imu", wanted.auxiliary_port)] {
            port.into_iter().for_each(|port| drop(settings.insert(key.into(), port.into())));
        }
        for (key, value) in &wanted.settings {
            if before.get(key).is_none() {
                let known =
                    before.as_object().map(|known| known.keys().cloned().collect::<Vec<_>>().join(", "));
                let reason = format!("no setting is called {key:?}; it has {}", known.unwrap_or_default());
                return Err(SetupError::Setting { address: self.http.address().to_owned(), reason });
            }
            settings.insert(key.clone(), value.clone());
        }
        Ok(settings)
    }

    fn put(&self, settings: &Map<String, Value>) -> Result<(), SetupError> {
        if self.stages() {
            let document = Value::Object(settings.clone());
            self.http
                .post_json("/api/v1/sensor/config?staging=true&reinit=false&persist=false", &document)?;
            return self
                .http
                .post_json("/api/v1/sensor/config?staging=true&reinit=true&persist=false", &json!({}))
                .map(drop);
        }
        let mut settings = settings.clone();
        if settings.get("udp_dest").is_some_and(|host| host == "@auto") {
            settings.remove("udp_dest");
            self.command("set_udp_dest_auto", "{}")?;
        }
        for (key, value) in &settings {
            let value = match value {
                Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            self.command(
                &format!("set_config_param?args={}+{}", encoded(key), encoded(&value)),
                "\"set_config_param\"",
            )?;
        }
        self.command("reinitialize", "{}")
    }

    /// Keeps what is in force without power.
    fn save(&self) -> Result<(), SetupError> {
        if self.stages() {
            return self
                .http
                .post_json("/api/v1/sensor/config?persist=true&reinit=false", &json!({}))
                .map(drop);
        }
        self.command("save_config_params", "{}")
    }

    fn command(&self, command: &str, expected: &'static str) -> Result<(), SetupError> {
        let path = format!("/api/v1/sensor/cmd/{command}");
        let body = self.http.get(&path)?;
        if body.trim() == expected {
            return Ok(());
        }
        Err(SetupError::Unexpected { url: format!("http://{}{path}", self.http.address()), expected, body })
    }

    /// Waits until it runs again; meanwhile it may refuse, or say nothing.
    fn wait(&self, within: Duration) -> Result<(), SetupError> {
        let end = Instant::now() + within;
        let mut status = "nothing".to_owned();
        loop {
            match self.http.get_json("/api/v1/sensor/metadata/sensor_info") {
                Ok(info) => status = text_of(&info, "/status"),
                Err(
                    SetupError::Unreachable { .. } | SetupError::Status { .. } | SetupError::Broken { .. },
                ) => {}
                Err(error) => return Err(error),
            }
            if matches!(status.as_str(), "RUNNING" | "STANDBY") {
                return Ok(());
            }
            if Instant::now() >= end {
                let address = self.http.address().to_owned();
                return Err(SetupError::NotReady { address, within, status });
            }
            std::thread::sleep(ASK_AGAIN);
        }
    }
}

fn of(settings: &Value, key: &str) -> Value {
    settings.get(key).cloned().unwrap_or_default()
}

/// Whether a sensor took a value: numbers may come back as text, and a host that it was to find itself as an address.
fn same(wanted: &Value, after: &Value) -> bool {
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    if wanted == "@auto" {
        return after.as_str().is_some_and(|host| !host.is_empty() && host != "@auto" && host != "0.0.0.0");
    }
    wanted == after || text(wanted) == text(after)
}

/// Whether this firmware stages settings; before, it knows commands only.
pub(crate) fn stages(firmware: &str) -> bool {
    version_of(firmware).is_none_or(|version| version >= STAGING)
}

/// Major and minor version within a firmware's name (`ousteros-image-prod-bootes-v3.1.0+0123`).
fn version_of(firmware: &str) -> Option<[u32; 2]> {
    let at = firmware.rfind("-v").map_or_else(|| usize::from(firmware.starts_with('v')), |at| at + 2);
    let mut parts = firmware.get(at..)?.split('.').map(|part| part.parse().ok());
    Some([parts.next()??, parts.next()??])
}

/// Percent encoding of an argument (RFC 3986, unreserved characters stay).
fn encoded(text: &str) -> String {
    text.bytes()
        .map(|byte| match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
                char::from(byte).to_string()
            }
            _ => format!("%{byte:02X}"),
        })
        .collect()
}

fn clock(settings: &Value, time: &Value, telemetry: &Value) -> Clock {
    let source = text_of(settings, "/timestamp_mode");
    let (locked, detail) = match source.as_str() {
        "TIME_FROM_PTP_1588" => {
            let port = text_of(time, "/ptp/port_data_set/port_state");
            let offset = text_of(time, "/ptp/current_data_set/offset_from_master");
            let locked = (!port.is_empty()).then_some(port == "SLAVE");
            (locked, format!("PTP port {}, offset from master {} ns", or_unsaid(&port), or_unsaid(&offset)))
        }
        "TIME_FROM_SYNC_PULSE_IN" => {
            let lock = |path| super::number_of(time, path).map(|locked| locked != 0.0);
            let (pulse, nmea) = (lock("/sensor/sync_pulse_in/locked"), lock("/sensor/nmea/locked"));
            let words = |locked: Option<bool>| match locked {
                Some(true) => "locked",
                Some(false) => "not locked",
                None => "unsaid",
            };
            (
                pulse.zip(nmea).map(|(pulse, nmea)| pulse && nmea),
                format!("pulse {}, NMEA {}", words(pulse), words(nmea)),
            )
        }
        _ => (None, "runs free".to_owned()),
    };
    let phase = text_of(telemetry, "/phase_lock_status");
    let detail =
        if phase.is_empty() || phase == "DISABLED" { detail } else { format!("{detail}, phase {phase}") };
    Clock { source, locked, detail }
}

fn or_unsaid(text: &str) -> &str {
    if text.is_empty() { "unsaid" } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_found_in_names() {
        for (name, version) in [
            ("ousteros-image-prod-bootes-v3.1.0+0123", Some([3, 1])),
            ("ousteros-image-prod-aries-v2.3.0+20220415163956", Some([2, 3])),
            ("v2.5.2", Some([2, 5])),
            ("3.2.1", Some([3, 2])),
            ("", None),
            ("nightly", None),
        ] {
            assert_eq!(version_of(name), version, "{name}");
        }
    }

    #[test]
    fn arguments_are_encoded_and_values_compared() {
        assert_eq!(encoded("[0, 360000]"), "%5B0%2C%20360000%5D");
        assert!(same(&json!(7502), &json!("7502")) && same(&json!("@auto"), &json!("10.0.0.2")));
        assert!(!same(&json!("@auto"), &json!("0.0.0.0")) && !same(&json!("1024x10"), &json!("512x10")));
    }
}
