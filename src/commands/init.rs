//! `outrigger init`: a commented `rig.toml` to begin with.

mod found;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output};
use crate::base::files;
use crate::report::Report;
use found::{FoundSensor, found_in};

const TEMPLATE: &str = include_str!("init/rig.toml");
/// The lines of the template between which its sensors stand.
const SENSORS_BEGIN: &str = "[[sensor]]\n";
const SENSORS_END: &str = "# Every other section";

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
        let found = found_in(&args.sensors.spec(recording))?;
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
    let mut report = Report::new("Files written", "");
    written.iter().for_each(|path| report.note(path.display().to_string()));
    let document = serde_json::json!({ "written": path, "files": written });
    output::print_result(context.json, &document, &report, &[])?;
    Ok(Outcome::Done)
}

/// The template with these sensors in place of its own.
fn with_sensors(found: &[FoundSensor]) -> String {
    let is_shared = |sensor: &FoundSensor| found.iter().filter(|other| other.port == sensor.port).count() > 1;
    let sections: String = found.iter().map(|sensor| sensor.section(is_shared(sensor))).collect();
    let begin = TEMPLATE.find(SENSORS_BEGIN).unwrap_or(0);
    let end = TEMPLATE.find(SENSORS_END).unwrap_or(begin);
    format!("{}{sections}{}", &TEMPLATE[..begin], &TEMPLATE[end..])
}
