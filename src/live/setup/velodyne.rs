//! Velodyne sensors: the web interface of VLP-16, Puck Hi-Res, HDL-32E, VLP-32C and VLS-128 (VLP-16 manual 63-9243 rev D,
//! chapter 8). It answers 200 or 204 to bad requests too, so everything is read back.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::{
    Change, Clock, Configured, Destination, Http, SensorState, SetupError, Vendor, Wanted, number_of,
    port_of, text_of, warnings,
};

/// Time between two writes: its server takes about one a second.
const BETWEEN_WRITES: Duration = Duration::from_secs(1);
const ASK_AGAIN: Duration = Duration::from_millis(500);
/// The motor is at speed within this, revolutions per minute.
const RPM_NEAR: f64 = 10.0;

/// A form and one of its fields by the name of a setting.
const SETTINGS: [(&str, &str, &str, &str); 8] = [
    // name, form, field, where it is read back
    ("rpm", "/cgi/setting", "rpm", "/rpm"),
    ("laser", "/cgi/setting", "laser", "/laser"),
    ("returns", "/cgi/setting", "returns", "/returns"),
    ("fov_start", "/cgi/setting/fov", "start", "/fov/start"),
    ("fov_end", "/cgi/setting/fov", "end", "/fov/end"),
    ("phaselock", "/cgi/setting/phaselock", "enabled", "/phaselock/enabled"),
    // hundredths of a degree, though the manual says degrees
    ("phaselock_offset", "/cgi/setting/phaselock", "offset", "/phaselock/offset"),
    ("dhcp", "/cgi/setting/net", "dhcp", "/net/dhcp"),
];

/// A sensor.
#[derive(Debug)]
pub struct Velodyne {
    http: Http,
    info: Value,
    between_writes: Duration,
    written: Mutex<Option<Instant>>,
}

impl Velodyne {
    /// The sensor that answers there, if it is one.
    pub(crate) fn recognise(http: &Http) -> Result<Option<Self>, SetupError> {
        let Some(info) = http.find_json("/cgi/info.json")? else { return Ok(None) };
        if text_of(&info, "/model").is_empty() {
            let url = format!("http://{}/cgi/info.json", http.address());
            return Err(SetupError::Unexpected {
                url,
                expected: "a document with a model",
                body: info.to_string(),
            });
        }
        Ok(Some(Self { http: http.clone(), info, between_writes: BETWEEN_WRITES, written: Mutex::new(None) }))
    }

    /// Settings in force.
    pub(crate) fn settings(&self) -> Result<Value, SetupError> {
        self.http.get_json("/cgi/settings.json")
    }

    /// Reads everything.
    pub(crate) fn read(&self) -> Result<SensorState, SetupError> {
        let settings = self.settings()?;
        let status = self.http.get_json("/cgi/status.json")?;
        let diagnosis = self.http.find_json("/cgi/diag.json")?.unwrap_or_default();
        let pulse = text_of(&status, "/gps/pps_state");
        let position = text_of(&status, "/gps/position");
        let motor = text_of(&status, "/motor/state");
        let mut state = SensorState {
            address: self.http.address().to_owned(),
            vendor: Vendor::Velodyne,
            model: text_of(&self.info, "/model"),
            serial: text_of(&self.info, "/serial"),
            firmware: ["/sensor_fw", "/firmware", "/version"]
                .iter()
                .map(|path| text_of(&self.info, path))
                .find(|text| !text.is_empty())
                .unwrap_or_default(),
            status: format!("motor {motor}, laser {}", text_of(&status, "/laser/state")),
            destination: Destination {
                host: text_of(&settings, "/host/addr"),
                port: port_of(&settings, "/host/dport"),
                auxiliary_port: port_of(&settings, "/host/tport"),
            },
            settings,
            clock: Clock {
                source: "pps".into(),
                locked: (!pulse.is_empty()).then_some(pulse == "Locked"),
                detail: format!(
                    "pulse {pulse}, position {}",
                    if position.is_empty() { "none" } else { &position }
                ),
            },
            temperature_c: temperature_c(&diagnosis),
            warnings: Vec::new(),
            metadata: None,
        };
        state.warnings = warnings::of_velodyne(&state, &status, &diagnosis);
        Ok(state)
    }

    /// Sets it up, reads back what it took, and saves it if wanted.
    pub(crate) fn configure(&self, wanted: &Wanted) -> Result<Configured, SetupError> {
        let before = self.settings()?;
        let mut asked: Vec<(String, &str, Value)> = Vec::new();
        if wanted.host.is_some() || wanted.port.is_some() || wanted.auxiliary_port.is_some() {
            let (mut form, mut fields) = (
                Vec::new(),
                [
                    ("addr", "/host/addr", wanted.host.clone().map(Value::from)),
                    ("dport", "/host/dport", wanted.port.map(Value::from)),
                    ("tport", "/host/tport", wanted.auxiliary_port.map(Value::from)),
                ],
            );
            for (field, path, value) in &mut fields {
                // the form is read as a whole: what is not to change is sent again
                let value = value.take();
                let setting = value.clone().or_else(|| before.pointer(path).cloned()).unwrap_or_default();
                form.push((*field, plain(&setting)));
                if let Some(value) = value {
                    asked.push((format!("host.{field}"), path, value));
                }
            }
            if wanted.host.as_deref() == Some("auto") {
                return Err(self.wrong("this sensor cannot find out who asks: give the host's address"));
            }
            self.write("/cgi/setting/host", &form)?;
        }
        for (key, value) in &wanted.settings {
            let known = || SETTINGS.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", ");
            let setting = SETTINGS.iter().find(|(name, ..)| name == key);
            let Some((_, form, field, path)) = setting else {
                return Err(self.wrong(&format!("no setting is called {key:?}; it has {}", known())));
            };
            self.write(form, &[(*field, plain(value))])?;
            asked.push((key.clone(), path, value.clone()));
        }
        let at_speed = wanted
            .settings
            .iter()
            .find(|(key, _)| key == "rpm")
            .and_then(|(_, value)| plain(value).parse().ok());
        if let Some(rpm) = at_speed {
            self.wait_for_speed(rpm, wanted.within)?;
        }
        let after = self.settings()?;
        let changes: Vec<Change> = asked
            .into_iter()
            .map(|(key, path, wanted)| {
                let of = |settings: &Value| settings.pointer(path).cloned().unwrap_or_default();
                let is_accepted = plain(&wanted).eq_ignore_ascii_case(&plain(&of(&after)));
                Change { key, before: of(&before), wanted, after: of(&after), is_accepted }
            })
            .collect();
        let saved = wanted.save && changes.iter().all(|change| change.is_accepted);
        if saved {
            self.write("/cgi/save", &[("data", "submit".into())])?;
        }
        Ok(Configured { changes, saved, state: self.read()? })
    }

    fn wrong(&self, reason: &str) -> SetupError {
        SetupError::Setting { address: self.http.address().to_owned(), reason: reason.to_owned() }
    }

    fn write(&self, path: &str, fields: &[(&str, String)]) -> Result<(), SetupError> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(last) = *written {
            std::thread::sleep(self.between_writes.saturating_sub(last.elapsed()));
        }
        self.http.post_form(path, fields)?;
        *written = Some(Instant::now());
        Ok(())
    }

    fn wait_for_speed(&self, rpm: f64, within: Duration) -> Result<(), SetupError> {
        let end = Instant::now() + within;
        loop {
            let status = self.http.get_json("/cgi/status.json")?;
            let now = number_of(&status, "/motor/rpm").unwrap_or(f64::NAN);
            if (now - rpm).abs() <= RPM_NEAR {
                return Ok(());
            }
            if Instant::now() >= end {
                let status = format!("motor {} at {now} rpm", text_of(&status, "/motor/state"));
                return Err(SetupError::NotReady { address: self.http.address().to_owned(), within, status });
            }
            std::thread::sleep(ASK_AGAIN);
        }
    }
}

/// A value as a form has it.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Bool(on) => if *on { "on" } else { "off" }.into(),
        other => other.to_string(),
    }
}

/// Temperature of the top board from its LM20 sensor, °C (VLP-16 manual, appendix "Diagnostics": 12 bits of 5 V; LM20 data
/// sheet, SNIS106, the parabola over the whole range).
fn temperature_c(diagnosis: &Value) -> Option<f64> {
    let counts = number_of(diagnosis, "/volt_temp/top/lm20_temp").filter(|counts| *counts > 0.0)?;
    let volts = counts * 5.0 / 4096.0;
    Some(-1481.96 + (2.1962e6 + (1.8639 - volts) / 3.88e-6).sqrt())
}

/// What an empty document of settings looks like, for those who imitate one.
pub(crate) fn factory_settings() -> Value {
    json!({
        "returns": "Strongest", "rpm": 600, "laser": "On",
        "fov": { "start": 0, "end": 359 },
        "host": { "addr": "255.255.255.255", "dport": 2368, "tport": 8308 },
        "net": { "addr": "192.168.1.201", "mask": "255.255.255.0", "gateway": "192.168.1.1", "dhcp": "Off" },
        "phaselock": { "enabled": "Off", "offset": 0 },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_temperatures_follow_the_data_sheet() {
        // LM20: 1.5743 V at 25 °C, 1.3180 V at 47 °C (approximately 11.69 mV/°C)
        let at = |volts: f64| {
            let counts = volts * 4096.0 / 5.0;
            temperature_c(&json!({ "volt_temp": { "top": { "lm20_temp": counts } } })).unwrap()
        };
        assert!((at(1.5743) - 25.0).abs() < 0.2, "{}", at(1.5743));
        assert!((at(1.8639) - 0.0).abs() < 0.2, "{}", at(1.8639));
        assert_eq!(temperature_c(&json!({ "volt_temp": { "top": { "lm20_temp": 0 } } })), None);
    }
}
