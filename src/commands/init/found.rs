//! The sensors of a recording, for a rig.toml.

use std::fmt::Write as _;

use anyhow::ensure;
use sensors::catalogue;
use sensors::ouster::Metadata;
use sensors::router::{Router, Sensor};

use crate::recording::{Recording, RecordingSpec, sensor_ids};

/// Where Velodynes send position packets, as they are delivered.
const POSITION_PORT: u16 = 8308;

/// A sensor of a recording, as rig.toml describes one.
pub(super) struct FoundSensor {
    name: String,
    model: Option<&'static str>,
    product: String,
    pub(super) port: Option<u16>,
    auxiliary_port: Option<u16>,
    source: Option<std::net::IpAddr>,
    pub(super) metadata: Option<String>,
}

impl FoundSensor {
    fn new(name: String, sensor: &Sensor, metadata: Option<&str>) -> Self {
        let product = sensor.model().map_or_else(|| sensor.product(), |model| model.name.clone());
        let imu_port = || Metadata::parse(metadata?, &name).ok()?.imu_port;
        let position_port = (sensor.position_packets > 0).then_some(POSITION_PORT);
        Self {
            model: model_named(&product),
            port: sensor.data_port(),
            auxiliary_port: imu_port().or(position_port),
            source: sensor.source().map(|source| source.ip()),
            metadata: metadata.map(str::to_owned),
            product,
            name,
        }
    }

    pub(super) fn metadata_file(&self) -> String {
        format!("{}.json", self.name)
    }

    /// Its section; `is_shared` says that another sensor sends to its port.
    pub(super) fn section(&self, is_shared: bool) -> String {
        let mut text = format!("[[sensor]]\nname = \"{}\"\n", self.name);
        let _ = match self.model {
            Some(model) => writeln!(text, "model = \"{model}\""),
            None => writeln!(text, "# model = \"...\"  # the recording has a {}", self.product),
        };
        let _ = match self.port {
            Some(port) => writeln!(text, "listen = {port}"),
            None => writeln!(text, "# listen = 7502  # the recording names no port"),
        };
        if let Some(port) = self.auxiliary_port {
            let _ = writeln!(text, "listen_aside = {port}");
        }
        if let Some(source) = self.source.filter(|_| is_shared) {
            let _ = writeln!(text, "source = \"{source}\"");
        }
        if self.metadata.is_some() {
            let _ = writeln!(text, "metadata = \"{}\"", self.metadata_file());
        }
        text + "\n"
    }
}

/// The model of the catalogue: `OS-1-64-U02` is an `os1-64`.
fn model_named(product: &str) -> Option<&'static str> {
    let plain =
        |name: &str| name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase();
    let product = plain(product);
    let known = catalogue::names().into_iter().filter(|known| product.starts_with(&plain(known)));
    known.max_by_key(|known| known.len())
}

/// The sensors of a recording: reads all of it.
pub(super) fn found_in(spec: &RecordingSpec) -> anyhow::Result<Vec<FoundSensor>> {
    let path = &spec.path;
    let recording = Recording::open(spec)?;
    let mut router: Router = recording.router()?;
    let mut drop_frame = |_: usize, _: &Sensor, _: sensors::Decoded<'_>| {};
    recording.each_packet(&mut |packet| {
        router.push(packet, &mut drop_frame);
    })?;
    router.finish(&mut drop_frame);
    let ids = sensor_ids::ids(&router);
    let found = ids.into_iter().zip(router.sensors());
    let found: Vec<_> =
        found.map(|(id, sensor)| FoundSensor::new(id, sensor, recording.metadata_text(sensor))).collect();
    ensure!(
        !found.is_empty(),
        "{}: no packet of it is assigned to a sensor; `outrigger inspect {}` says what it holds, --meta gives metadata of an Ouster",
        path.display(),
        path.display()
    );
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_have_their_model() {
        for (product, model) in
            [("OS-1-64", "os1-64"), ("OS-1-128-U02", "os1-128"), ("VLP-16", "vlp-16"), ("os0-32", "os0-32")]
        {
            assert_eq!(model_named(product), Some(model), "{product}");
        }
        assert_eq!(model_named("unknown"), None);
    }
}
