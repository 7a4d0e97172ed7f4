//! The HTTP API of an Ouster, of firmware from 3.1 on or before.

use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use super::{Answer, Request, WebFault};
use crate::live::setup::ouster::stages;

/// Firmware that has no staging.
const OLD: &str = "ousteros-image-prod-aries-v2.4.0+20221130230319";

/// What an Ouster says and takes.
#[derive(Debug)]
pub struct OusterWeb {
    metadata: Value,
    active: Map<String, Value>,
    staged: Map<String, Value>,
    saved: Map<String, Value>,
    /// Settings that its packets are bound to.
    fixed: bool,
    ready_at: Instant,
    restart: Duration,
    alerts: Vec<Value>,
    ptp_state: &'static str,
    pulse_locked: bool,
    temperature_c: f64,
}

impl OusterWeb {
    /// Behind these metadata (the nested JSON shape); `fixed` where packets are sent that do not follow a change of mode.
    pub fn new(metadata: &str, fixed: bool) -> Option<Self> {
        let metadata: Value = serde_json::from_str(metadata).ok()?;
        metadata.pointer("/sensor_info/image_rev")?.as_str()?;
        let mut active = metadata.get("config_params")?.as_object()?.clone();
        for (key, value) in [
            ("udp_dest", json!("")),
            ("udp_port_lidar", json!(7502)),
            ("udp_port_imu", json!(7503)),
            ("operating_mode", json!("NORMAL")),
            ("timestamp_mode", json!("TIME_FROM_INTERNAL_OSC")),
            ("azimuth_window", json!([0, 360_000])),
            ("signal_multiplier", json!(1)),
            ("phase_lock_enable", json!(false)),
            ("phase_lock_offset", json!(0)),
            ("multipurpose_io_mode", json!("OFF")),
            ("sync_pulse_in_polarity", json!("ACTIVE_HIGH")),
        ] {
            active.entry(key).or_insert(value);
        }
        Some(Self {
            metadata,
            staged: active.clone(),
            saved: active.clone(),
            active,
            fixed,
            ready_at: Instant::now(),
            restart: Duration::from_millis(200),
            alerts: Vec::new(),
            ptp_state: "SLAVE",
            pulse_locked: true,
            temperature_c: 48.0,
        })
    }

    /// The same with firmware that has no staging.
    pub fn with_old_firmware(mut self) -> Self {
        self.metadata["sensor_info"]["image_rev"] = OLD.into();
        self
    }

    /// The same, sending there: lidar and auxiliary packets.
    pub fn sending_to(mut self, to: SocketAddr, auxiliary_to: Option<SocketAddr>) -> Self {
        self.active.insert("udp_dest".into(), to.ip().to_string().into());
        self.active.insert("udp_port_lidar".into(), to.port().into());
        if let Some(auxiliary_to) = auxiliary_to {
            self.active.insert("udp_port_imu".into(), auxiliary_to.port().into());
        }
        (self.staged, self.saved) = (self.active.clone(), self.active.clone());
        self
    }

    /// Something is wrong with it.
    pub fn alert(&mut self, category: &str, message: &str) {
        let id = format!("0x{:08x}", 0x0100_0000 + self.alerts.len());
        let level = "WARNING";
        self.alerts
            .push(json!({ "id": id, "category": category, "level": level, "msg": message, "active": true }));
    }

    /// Its clock loses, or finds, what it follows.
    pub fn set_clock_locked(&mut self, locked: bool) {
        (self.ptp_state, self.pulse_locked) = (if locked { "SLAVE" } else { "LISTENING" }, locked);
    }

    /// How warm it is inside, °C.
    pub fn set_temperature_c(&mut self, temperature_c: f64) {
        self.temperature_c = temperature_c;
    }

    /// Settings that it keeps without power.
    pub fn saved(&self) -> &Map<String, Value> {
        &self.saved
    }

    pub(super) fn destination(&self) -> (String, Option<u16>, Option<u16>) {
        let port =
            |key| self.active.get(key).and_then(Value::as_u64).and_then(|port| u16::try_from(port).ok());
        let host = self.active.get("udp_dest").and_then(Value::as_str).unwrap_or_default();
        (host.to_owned(), port("udp_port_lidar"), port("udp_port_imu"))
    }

    fn is_old(&self) -> bool {
        !stages(self.firmware())
    }

    fn firmware(&self) -> &str {
        self.metadata.pointer("/sensor_info/image_rev").and_then(Value::as_str).unwrap_or_default()
    }

    fn status(&self, fault: Option<WebFault>) -> &'static str {
        if Instant::now() < self.ready_at || (fault == Some(WebFault::NeverReady) && self.init_id() > 1) {
            "INITIALIZING"
        } else if self.active.get("operating_mode").is_some_and(|mode| mode == "STANDBY") {
            "STANDBY"
        } else {
            "RUNNING"
        }
    }

    fn init_id(&self) -> u64 {
        self.metadata.pointer("/sensor_info/initialization_id").and_then(Value::as_u64).unwrap_or(1)
    }

    fn document(&self, fault: Option<WebFault>) -> Value {
        let mut document = self.metadata.clone();
        document["config_params"] = Value::Object(self.active.clone());
        document["sensor_info"]["status"] = self.status(fault).into();
        document
    }

    pub(super) fn answer(&mut self, request: &Request) -> Answer {
        let Some(path) = request.path.strip_prefix("/api/v1/") else {
            return Answer::error(404, "no such page");
        };
        let query = |name: &str| Request::field(&request.query, name);
        let is =
            |name: &str, usual: bool| query(name).map_or(usual, |value| value.eq_ignore_ascii_case("true"));
        match (request.method.as_str(), path) {
            ("GET", "sensor/metadata") => Answer::json(&self.document(request.fault)),
            ("GET", "system/firmware") => Answer::json(&json!({ "fw": self.firmware() })),
            ("GET", "sensor/config") => {
                // old firmware has the page, but no staging in it
                let staged = is("staging", false) && !self.is_old();
                let settings = if staged { &self.staged } else { &self.active };
                Answer::json(&Value::Object(settings.clone()))
            }
            ("POST", "sensor/config") => {
                let Ok(Value::Object(settings)) = serde_json::from_str(&request.body) else {
                    return Answer::error(400, "expected an object of settings");
                };
                if let Err(why) = self.stage(&settings, request) {
                    return Answer::error(400, &why);
                }
                if is("reinit", true) {
                    self.reinitialize(request.fault);
                }
                if is("persist", false) {
                    self.saved = self.active.clone();
                }
                Answer { status: 200, body: "{}".into() }
            }
            ("GET", "sensor/telemetry") => Answer::json(&json!({
                "input_voltage_mv": 24_000, "input_current_ma": 700, "phase_lock_status": "DISABLED",
                "internal_temperature_deg_c": self.temperature_c,
            })),
            ("GET", "sensor/alerts") => {
                Answer::json(&json!({ "active": self.alerts, "log": [], "next_cursor": self.alerts.len() }))
            }
            ("GET", "time") => Answer::json(&json!({
                "ptp": { "port_data_set": { "port_state": self.ptp_state }, "current_data_set": { "offset_from_master": 120 } },
                "sensor": {
                    "sync_pulse_in": { "locked": u8::from(self.pulse_locked) },
                    "nmea": { "locked": u8::from(self.pulse_locked) },
                },
            })),
            ("GET", "user/data") => Answer::text("\"\""),
            ("GET", "system/network") => Answer::json(&json!({ "hostname": "os-mock", "ipv4": {} })),
            ("GET", path) => {
                match (path.strip_prefix("sensor/metadata/"), path.strip_prefix("sensor/cmd/")) {
                    (Some(part), _) => match self.document(request.fault).get(part) {
                        Some(part) => Answer::json(part),
                        None => Answer::error(404, "no such part"),
                    },
                    (_, Some(command)) if self.is_old() => self.command(command, request),
                    _ => Answer::error(404, "no such page"),
                }
            }
            _ => Answer::error(405, "not so"),
        }
    }

    /// Commands of old firmware.
    fn command(&mut self, command: &str, request: &Request) -> Answer {
        let arguments = request.query.strip_prefix("args=").unwrap_or_default();
        match command {
            "get_config_param" => {
                let settings = if arguments == "staged" { &self.staged } else { &self.active };
                Answer::json(&Value::Object(settings.clone()))
            }
            "set_config_param" => {
                let (key, value) = arguments.split_once('+').unwrap_or((arguments, ""));
                let (key, value) = (super::decoded(key), super::decoded(value));
                let settings = match (key.as_str(), serde_json::from_str(&value)) {
                    (".", Ok(Value::Object(settings))) => settings,
                    (_, Ok(value)) => Map::from_iter([(key, value)]),
                    (_, Err(_)) => Map::from_iter([(key, Value::from(value))]),
                };
                match self.stage(&settings, request) {
                    Ok(()) => Answer::text("\"set_config_param\""),
                    Err(why) => Answer::error(400, &why),
                }
            }
            "set_udp_dest_auto" => {
                self.staged.insert("udp_dest".into(), request.from.to_string().into());
                Answer::text("{}")
            }
            "reinitialize" => {
                self.reinitialize(request.fault);
                Answer::text("{}")
            }
            "save_config_params" => {
                self.saved = self.active.clone();
                Answer::text("{}")
            }
            _ => Answer::error(404, "no such command"),
        }
    }

    fn stage(&mut self, settings: &Map<String, Value>, request: &Request) -> Result<(), String> {
        for (key, value) in settings {
            let Some(before) = self.staged.get(key) else { return Err(format!("no parameter {key}")) };
            let bound = [
                "lidar_mode",
                "udp_profile_lidar",
                "udp_profile_imu",
                "columns_per_packet",
                "timestamp_mode",
            ];
            if self.fixed && before != value && bound.contains(&key.as_str()) {
                return Err(format!("{key}: this mock's packets stay {before}"));
            }
            let is_address =
                |text: &str| text == "@auto" || text.is_empty() || text.parse::<IpAddr>().is_ok();
            if key == "udp_dest" && !value.as_str().is_some_and(is_address) {
                return Err(format!("{key}: {value} is no address"));
            }
        }
        for (key, value) in settings {
            let value = if value == "@auto" { request.from.to_string().into() } else { value.clone() };
            self.staged.insert(key.clone(), value);
        }
        Ok(())
    }

    fn reinitialize(&mut self, fault: Option<WebFault>) {
        if fault == Some(WebFault::Reverts) {
            self.staged = self.active.clone();
        }
        self.active = self.staged.clone();
        self.ready_at = Instant::now() + self.restart;
        let next = self.init_id() + 1;
        self.metadata["sensor_info"]["initialization_id"] = next.into();
    }
}
