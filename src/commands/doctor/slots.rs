//! The mount file of a rig.toml against its sensors.

use crate::commands::defaults::section;
use crate::commands::{Verb, record, rig_args};
use crate::live::config::Config;
use crate::live::receive::is_auxiliary;
use crate::rig::MountSlots;
use crate::verify::readiness::{CheckState, ConfiguredSensors};

/// The mount file that recording will store, and every sensor's slot in it.
pub(super) fn check_slots(sensors: &mut ConfiguredSensors, config: &Config) {
    let args: anyhow::Result<record::Args> = section(config, &["record"], |verb| match verb {
        Verb::Record(args) => Some(args),
        _ => None,
    });
    let slots = args.and_then(|args| {
        let axes = rig_args::axes_of(config)?;
        let slots = args.mount.as_deref().map(|mount| MountSlots::read(mount, &axes)).transpose()?;
        Ok(slots.map(|slots| (slots, axes)))
    });
    let rig = match slots {
        Ok(None) => return,
        Ok(Some((slots, axes))) => {
            sensors.pitches_deg = slots.mount.axis_pitches_deg(&axes);
            slots.rig
        }
        Err(error) => {
            return sensors.bad(
                "mount file",
                format!("{error:#}"),
                "`outrigger record` will not start with this",
            );
        }
    };
    let names = || config.sensors.iter().map(|sensor| sensor.name.as_str());
    let lost: Vec<String> = names()
        .filter(|name| !is_auxiliary(name, names()))
        .filter_map(|name| Some(rig.slot(name).err()?.to_string()))
        .collect();
    if lost.is_empty() {
        sensors.add("mount file", CheckState::Ok, "has a slot for every sensor".to_owned(), "");
    }
    for words in lost {
        sensors.bad("mount file", words, "a sensor has one name in the rig.toml and in the mount file");
    }
}
