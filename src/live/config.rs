//! `rig.toml`: the sensors of a rig, and settings of the verbs of the command line, unless flags or environment say
//! otherwise.
//!
//! ```toml
//! format = "outrigger-rig/1"
//!
//! [[sensor]]
//! name = "left"
//! model = "os1-64"
//! listen = "7502"             # port, or address and port, that its lidar packets come to
//! metadata = "left.json"      # of an Ouster; relative to this file
//! host = "os-122220001234.local"  # its web interface; without `metadata`, recording asks it for them
//!
//! [rig]                       # a section per verb, a key per flag
//! port = "/dev/ttyACM0"
//! limits_deg = [[-50, 50]]
//! ```

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use sensors::catalogue;
use serde::Deserialize;
use serde::de::IntoDeserializer as _;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::live::receive::Listen;

/// What `format` says.
pub const FORMAT: &str = "outrigger-rig/1";

/// The content of a `rig.toml`.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Where it was read.
    pub path: PathBuf,
    /// The sensors, in the file's order.
    pub sensors: Vec<SensorConfig>,
    /// Settings of verbs.
    pub sections: Vec<Section>,
}

/// One physical sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorConfig {
    /// Name within the rig.
    pub name: String,
    /// Name of a sensor model (`os1-64`).
    pub model: String,
    /// Where its lidar packets arrive on this host.
    pub listen: Option<SocketAddr>,
    /// Where its IMU (Ouster) or position packets (Velodyne) arrive.
    pub listen_auxiliary: Option<SocketAddr>,
    /// The only address its packets may come from.
    pub source: Option<IpAddr>,
    /// Metadata file of an Ouster.
    pub metadata: Option<PathBuf>,
    /// Its web interface, `HOST` or `HOST:PORT`: where it is set up, and where metadata come from without a file.
    pub host: Option<String>,
}

/// One of a sensor's streams of packets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Where it is received, and under which name.
    pub listen: Listen,
    /// Name of the sensor's model, for its lidar packets, where that is specified.
    pub model: Option<String>,
    /// Metadata file of the sensor, for its lidar packets.
    pub metadata: Option<PathBuf>,
    /// Its web interface, which is asked for the metadata where there is no file.
    pub host: Option<String>,
}

impl SensorConfig {
    /// Its lidar packets, and its auxiliary stream.
    pub(crate) fn streams(&self) -> impl Iterator<Item = Stream> + use<> {
        let Self { name, model, listen, listen_auxiliary, source, metadata, host } = self.clone();
        let auxiliary = listen_auxiliary.map(|address| {
            let listen = Listen { name: crate::live::receive::auxiliary_name(&name), address, source };
            Stream { listen, model: None, metadata: None, host: None }
        });
        let lidar = listen.map(|address| {
            let listen = Listen { name, address, source };
            Stream { listen, model: Some(model), metadata, host }
        });
        lidar.into_iter().chain(auxiliary)
    }
}

/// Settings of one verb.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Section {
    /// `["rig"]` or, of a verb within a verb, `["mock", "sensor"]`.
    pub verb: Vec<String>,
    /// Line of its heading, from 1.
    pub line: usize,
    /// In the file's order.
    pub settings: Vec<Setting>,
}

/// One key of a section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// As written.
    pub key: String,
    /// Its line, from 1.
    pub line: usize,
    /// One value, or those of an array; arrays within it are joined by commas.
    pub values: Vec<String>,
}

/// Why a file was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("cannot read {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Something in it is wrong.
    #[error("{}:{line}: {reason}", path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What was found and what was expected.
        reason: String,
    },
}

/// A sensor as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorTable {
    name: String,
    model: String,
    listen: Option<Endpoint>,
    listen_aside: Option<Endpoint>,
    source: Option<IpAddr>,
    metadata: Option<PathBuf>,
    host: Option<String>,
}

/// What `listen` may be; anything at first: what is wrong with it is reported when it is read.
#[derive(Deserialize)]
#[serde(untagged)]
enum Endpoint {
    Port(i64),
    Text(String),
    Other(toml::Value),
}

impl Config {
    /// Reads a file and checks everything in it but the settings, which the verbs know.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = crate::base::files::read_text(path)
            .map_err(|source| ConfigError::Unreadable { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// The same from its text; `path` is for messages and relative paths.
    pub(crate) fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let reader = Reader { text, path };
        let table = DeTable::parse(text).map_err(|error| reader.toml_error(&error))?;
        let mut config = Self { path: path.to_owned(), sensors: Vec::new(), sections: Vec::new() };
        let mut format = None;
        for (key, value) in table.into_inner() {
            let (at, name) = (key.span().start, key.into_inner());
            match (name.as_ref(), value.get_ref()) {
                ("format", DeValue::String(text)) => format = Some(text.clone().into_owned()),
                ("sensor", DeValue::Array(_)) => config.sensors = reader.sensors(value)?,
                (_, DeValue::Table(_)) => {
                    reader.sections(vec![name.into_owned()], value, &mut config.sections)?
                }
                (_, other) => {
                    let found = other.type_str();
                    let reason = format!(
                        "`{name}` is a {found}; expected format, [[sensor]], or a section with the name of a verb"
                    );
                    return Err(reader.wrong(at, reason));
                }
            }
        }
        match format {
            Some(format) if format == FORMAT => Ok(config),
            Some(format) => Err(reader.wrong(0, format!("format {format:?}; expected {FORMAT:?}"))),
            None => Err(reader.wrong(0, format!("no format; expected format = {FORMAT:?} on top"))),
        }
    }
}

struct Reader<'a> {
    text: &'a str,
    path: &'a Path,
}

impl Reader<'_> {
    fn wrong(&self, at: usize, reason: String) -> ConfigError {
        ConfigError::Wrong { path: self.path.to_owned(), line: self.line(at), reason }
    }

    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())].iter().filter(|byte| **byte == b'\n').count()
    }

    fn toml_error(&self, error: &toml::de::Error) -> ConfigError {
        self.wrong(error.span().map_or(0, |span| span.start), error.message().to_owned())
    }

    fn sensors(&self, value: Spanned<DeValue<'_>>) -> Result<Vec<SensorConfig>, ConfigError> {
        let DeValue::Array(tables) = value.into_inner() else { return Ok(Vec::new()) };
        let mut sensors: Vec<SensorConfig> = Vec::new();
        for table in tables {
            let at = table.span().start;
            let table = SensorTable::deserialize(table.into_deserializer())
                .map_err(|error| self.toml_error(&error))?;
            let sensor = self.sensor(table).map_err(|reason| self.wrong(at, reason))?;
            if sensors.iter().any(|other| other.name == sensor.name) {
                return Err(self.wrong(at, format!("two sensors are called {:?}", sensor.name)));
            }
            sensors.push(sensor);
        }
        Ok(sensors)
    }

    fn sensor(&self, table: SensorTable) -> Result<SensorConfig, String> {
        let SensorTable { name, model, listen, listen_aside: listen_auxiliary, source, metadata, host } =
            table;
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c)) {
            return Err(format!(
                "sensor name {name:?}: expected letters, digits, dots, dashes and underscores"
            ));
        }
        catalogue::decoded(&model).map_err(|error| error.to_string())?;
        let folder = crate::base::files::folder_of(self.path);
        Ok(SensorConfig {
            listen: listen.map(Endpoint::address).transpose().map_err(|why| format!("listen = {why}"))?,
            listen_auxiliary: listen_auxiliary
                .map(Endpoint::address)
                .transpose()
                .map_err(|why| format!("listen_aside = {why}"))?,
            metadata: metadata.map(|metadata| folder.join(metadata)),
            name,
            model,
            source,
            host,
        })
    }

    fn sections(
        &self,
        verb: Vec<String>,
        value: Spanned<DeValue<'_>>,
        out: &mut Vec<Section>,
    ) -> Result<(), ConfigError> {
        let line = self.line(value.span().start);
        let DeValue::Table(table) = value.into_inner() else { return Ok(()) };
        let mut settings = Vec::new();
        for (key, value) in table {
            let line = self.line(key.span().start);
            let key = key.into_inner().into_owned();
            if value.get_ref().is_table() {
                let within = verb.iter().cloned().chain([key]).collect();
                self.sections(within, value, out)?;
                continue;
            }
            let values = match value.get_ref() {
                DeValue::Array(values) => {
                    values.iter().map(|value| self.text_of(value)).collect::<Result<_, _>>()?
                }
                _ => vec![self.text_of(&value)?],
            };
            settings.push(Setting { key, line, values });
        }
        settings.sort_by_key(|setting| setting.line); // the table is sorted by name
        out.push(Section { verb, line, settings });
        Ok(())
    }

    fn text_of(&self, value: &Spanned<DeValue<'_>>) -> Result<String, ConfigError> {
        Ok(match value.get_ref() {
            DeValue::String(text) => text.to_string(),
            DeValue::Integer(number) if number.radix() == 10 => number.as_str().to_owned(),
            DeValue::Float(number) => number.as_str().to_owned(),
            DeValue::Boolean(flag) => flag.to_string(),
            DeValue::Array(values) => {
                let texts = values.iter().map(|value| self.text_of(value)).collect::<Result<Vec<_>, _>>()?;
                texts.join(",")
            }
            other => {
                let reason =
                    format!("found a {}; expected text, a number, true, false or an array", other.type_str());
                return Err(self.wrong(value.span().start, reason));
            }
        })
    }
}

impl Endpoint {
    fn address(self) -> Result<SocketAddr, String> {
        let found = match self {
            Self::Port(port) => port.to_string(),
            Self::Text(text) => text,
            Self::Other(value) => value.to_string(),
        };
        let port = found.parse::<u16>().ok().filter(|port| *port > 0);
        match (port, found.parse()) {
            (Some(port), _) => Ok((Ipv4Addr::UNSPECIFIED, port).into()),
            (None, Ok(address)) => Ok(address),
            (None, Err(_)) => Err(format!("{found:?}: expected a port (1 to 65535) or \"address:port\"")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Config, ConfigError> {
        Config::parse(&format!("format = \"outrigger-rig/1\"\n{text}"), Path::new("rigs/rig.toml"))
    }

    #[test]
    fn sensors_and_settings_are_read() {
        let config = parse(
            "[[sensor]]\nname = \"left\"\nmodel = \"os1-64\"\nlisten = 7502\nlisten_aside = \"[::1]:7503\"\n\
             source = \"10.0.0.1\"\nmetadata = \"left.json\"\n[rig]\nlimits_deg = [[-50, 50.5], [0, 1]]\narm = true\n\
             [mock.sensor]\nmodel = \"vlp-16\"\n",
        )
        .unwrap();
        let sensor = &config.sensors[0];
        assert_eq!(sensor.listen.unwrap().to_string(), "0.0.0.0:7502");
        assert_eq!(sensor.listen_auxiliary.unwrap().to_string(), "[::1]:7503");
        assert_eq!(sensor.metadata.as_deref(), Some(Path::new("rigs/left.json")));
        let section =
            |verb: &str| config.sections.iter().find(|section| section.verb.join(" ") == verb).unwrap();
        let limits = &section("rig").settings[0];
        assert_eq!((limits.line, &limits.values[..]), (10, &["-50,50.5".to_owned(), "0,1".to_owned()][..]));
        assert_eq!(section("mock sensor").settings[0].values, ["vlp-16"]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, line, words) in [
            ("rig = 3\n", 2, "`rig` is a integer"),
            ("[rig\n", 2, ""),
            ("[[sensor]]\nname = \"a\"\n", 2, "missing field `model`"),
            ("[[sensor]]\nname = \"a\"\nmodel = \"os9\"\n", 2, "os9"),
            ("[[sensor]]\nname = \"a\"\nmodel = \"os1-64\"\nport = 1\n", 5, "unknown field `port`"),
            (
                "[[sensor]]\nname = \"a\"\nmodel = \"os1-64\"\nlisten = \"here\"\n",
                2,
                "listen = \"here\": expected a port",
            ),
            (
                "[[sensor]]\nname = \"a\"\nmodel = \"os1-64\"\nlisten_aside = 75020\n",
                2,
                "listen_aside = \"75020\": expected a port (1 to 65535)",
            ),
            (
                "[[sensor]]\nname = \"a\"\nmodel = \"os1-64\"\nlisten = 0\n",
                2,
                "listen = \"0\": expected a port",
            ),
            (
                "[[sensor]]\nname = \"a\"\nmodel = \"os1-64\"\nlisten = true\n",
                2,
                "listen = \"true\": expected a port",
            ),
            ("[[sensor]]\nname = \"a b\"\nmodel = \"os1-64\"\n", 2, "expected letters"),
            ("[rig]\nport = 2026-01-01\n", 3, "found a datetime"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("rigs/rig.toml:{line}: ")) && error.contains(words),
                "{text}: {error}"
            );
        }
        let error = Config::parse("[rig]\n", Path::new("rig.toml")).unwrap_err().to_string();
        assert_eq!(error, "rig.toml:1: no format; expected format = \"outrigger-rig/1\" on top");
    }
}
