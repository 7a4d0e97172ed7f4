//! `outrigger init`: a commented `rig.toml` to begin with.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use sensors::catalogue;
use sensors::ouster::Metadata;
use sensors::router::{Router, Sensor};

use super::recording::Recording;
use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output, sensor_ids};
use crate::base::files;

const TEMPLATE: &str = include_str!("init/rig.toml");
/// The lines of the template between which its sensors stand.
const SENSORS_BEGIN: &str = "[[sensor]]\n";
const SENSORS_END: &str = "# Every other section";
/// Where Velodynes send position packets, as they are delivered.
const POSITION_PORT: u16 = 8308;

/// Arguments of `init`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of the new file, made where it is absent, or the file itself (*.toml).
    #[arg(default_value = ".", value_name = "DIR")]
    place: PathBuf,
    /// Take the sensors from this recording: names, models, ports, and the metadata of Ousters as files next to rig.toml.
    #[arg(long, value_name = "RECORDING")]
    from: Option<PathBuf>,
    #[command(flatten)]
    sensors: SensorArgs,
    /// Overwrite files that exist.
    #[arg(long)]
    force: bool,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let is_file = files::ending(&args.place) == "toml" && !args.place.is_dir();
    let path = if is_file { args.place.clone() } else { args.place.join("rig.toml") };
    let folder = files::folder_of(&path).to_owned();
    let mut made = vec![(path.clone(), TEMPLATE.to_owned())];
    if let Some(recording) = &args.from {
        let found = found_in(recording, &args.sensors)?;
        made[0].1 = with_sensors(&found);
        let metadata = found
            .into_iter()
            .filter_map(|sensor| Some((folder.join(sensor.metadata_file()), sensor.metadata?)));
        made.extend(metadata);
    } else {
        context.ensure_none_of::<SensorArgs>("is about a recording: add --from RECORDING")?;
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    if let Some((existing, _)) = made.iter().find(|(path, _)| path.exists() && !args.force) {
        bail!("{} exists already; --force overwrites it", existing.display());
    }
    for (path, text) in made.iter().rev() {
        files::write_whole(path, text.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let written: Vec<&Path> = made.iter().map(|(path, _)| path.as_path()).collect();
    let lines = || written.iter().map(|path| format!("{}\n", path.display())).collect();
    output::print_result(
        context.json,
        &serde_json::json!({ "written": path, "files": written }),
        lines,
        &[],
    )?;
    Ok(Outcome::Done)
}

/// A sensor of a recording, as rig.toml describes one.
struct FoundSensor {
    name: String,
    model: Option<&'static str>,
    product: String,
    port: Option<u16>,
    auxiliary_port: Option<u16>,
    source: Option<std::net::IpAddr>,
    metadata: Option<String>,
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

    fn metadata_file(&self) -> String {
        format!("{}.json", self.name)
    }

    /// Its section; `is_shared` says that another sensor sends to its port.
    fn section(&self, is_shared: bool) -> String {
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
fn found_in(path: &Path, args: &SensorArgs) -> anyhow::Result<Vec<FoundSensor>> {
    let recording = Recording::open(path, args)?;
    let mut router: Router = recording.router()?;
    let mut drop_frame = |_: usize, _: &Sensor, _: sensors::Decoded<'_>| {};
    recording.each_packet(&mut |packet| {
        router.push(packet, &mut drop_frame);
        Ok(())
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

/// The template with these sensors in place of its own.
fn with_sensors(found: &[FoundSensor]) -> String {
    let is_shared = |sensor: &FoundSensor| found.iter().filter(|other| other.port == sensor.port).count() > 1;
    let sections: String = found.iter().map(|sensor| sensor.section(is_shared(sensor))).collect();
    let begin = TEMPLATE.find(SENSORS_BEGIN).unwrap_or(0);
    let end = TEMPLATE.find(SENSORS_END).unwrap_or(begin);
    format!("{}{sections}{}", &TEMPLATE[..begin], &TEMPLATE[end..])
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
