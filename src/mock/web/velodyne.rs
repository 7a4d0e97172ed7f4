//! The web interface of a Velodyne: it takes any form and answers 204.

use std::net::SocketAddr;

use serde_json::{Value, json};

use super::{Answer, Request, WebFault};
use crate::live::setup::velodyne::factory_settings;

/// What a Velodyne says and takes.
#[derive(Debug)]
pub struct VelodyneWeb {
    settings: Value,
    saved: Value,
    model: String,
    serial: String,
    laser_disabled: bool,
    pulse: &'static str,
    powered: bool,
}

impl VelodyneWeb {
    /// A sensor of this model.
    pub fn new(model: &str, serial: &str) -> Self {
        Self {
            settings: factory_settings(),
            saved: factory_settings(),
            model: model.into(),
            serial: serial.into(),
            laser_disabled: false,
            pulse: "Locked",
            powered: true,
        }
    }

    /// The same, sending there: data packets, and position packets.
    pub fn sending_to(mut self, to: SocketAddr, auxiliary_to: Option<SocketAddr>) -> Self {
        self.settings["host"]["addr"] = to.ip().to_string().into();
        self.settings["host"]["dport"] = to.port().into();
        if let Some(auxiliary_to) = auxiliary_to {
            self.settings["host"]["tport"] = auxiliary_to.port().into();
        }
        self.saved = self.settings.clone();
        self
    }

    /// Its own protection switches the lasers off.
    pub fn disable_laser(&mut self) {
        self.laser_disabled = true;
    }

    /// Its head loses its power.
    pub fn cut_power_of_head(&mut self) {
        self.powered = false;
    }

    /// What its GPS input shows: `Absent`, `Synchronizing`, `Locked`, `Error`.
    pub fn set_pulse(&mut self, pulse: &'static str) {
        self.pulse = pulse;
    }

    /// Settings that it keeps without power.
    pub fn saved(&self) -> &Value {
        &self.saved
    }

    pub(super) fn destination(&self) -> (String, Option<u16>, Option<u16>) {
        let port = |path| {
            self.settings.pointer(path).and_then(Value::as_u64).and_then(|port| u16::try_from(port).ok())
        };
        let host = self.settings.pointer("/host/addr").and_then(Value::as_str).unwrap_or_default();
        (host.to_owned(), port("/host/dport"), port("/host/tport"))
    }

    pub(super) fn answer(&mut self, request: &Request) -> Answer {
        match (request.method.as_str(), request.path.as_str()) {
            ("GET", "/cgi/settings.json") => Answer::json(&self.settings),
            ("GET", "/cgi/info.json") => {
                Answer::json(&json!({ "model": self.model, "serial": self.serial, "sensor_fw": "3.0.41.1" }))
            }
            ("GET", "/cgi/status.json") => {
                let rpm = self.settings["rpm"].as_u64().unwrap_or(0);
                let laser =
                    if self.laser_disabled { "Disabled".into() } else { self.settings["laser"].clone() };
                Answer::json(&json!({
                    "gps": { "pps_state": self.pulse, "position": "" },
                    "motor": { "state": if rpm == 0 { "Off" } else { "On" }, "rpm": rpm, "lock": "Off", "phase": 0 },
                    "laser": { "state": laser },
                }))
            }
            ("GET", "/cgi/diag.json") => {
                let top = if self.powered {
                    json!({ "lm20_temp": 1110, "pwr_5v": 2058 })
                } else {
                    json!({ "lm20_temp": 0, "pwr_5v": 0 })
                };
                Answer::json(&json!({ "volt_temp": { "top": top, "bot": { "lm20_temp": 1120 } } }))
            }
            ("POST", "/cgi/save") => {
                self.saved = self.settings.clone();
                Answer { status: 204, body: String::new() }
            }
            ("POST", path) => {
                let section =
                    path.strip_prefix("/cgi/setting").map(|rest| rest.trim_start_matches('/').to_owned());
                if let Some(section) = section.filter(|_| request.fault != Some(WebFault::Reverts)) {
                    self.take(&section, &request.body);
                }
                Answer { status: 204, body: String::new() } // to anything
            }
            _ => Answer::error(404, "no such page"),
        }
    }

    /// Fields of a form that it knows; everything else is passed over in silence, as the real ones do.
    fn take(&mut self, section: &str, form: &str) {
        let target =
            if section.is_empty() { Some(&mut self.settings) } else { self.settings.get_mut(section) };
        let Some(Value::Object(target)) = target else { return };
        for (key, value) in target.iter_mut().filter(|(_, value)| !value.is_object()) {
            let Some(text) = Request::field(form, key) else { continue };
            *value = match (&*value, text.parse::<u64>()) {
                (Value::Number(_), Ok(number)) => number.into(),
                (Value::Number(_), Err(_)) => continue,
                _ => capital(&text).into(),
            };
        }
    }
}

/// `on` is shown as `On`.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
