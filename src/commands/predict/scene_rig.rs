//! The rig of `predict --scene` and `--room`, and its models.

use anyhow::bail;

use super::Args;
use crate::commands::{output, wrong_usage};
use crate::rig::{MountDeg, MountFile, MountedSensor, Rig, Unit, UnitChoice};

pub(super) fn units(args: &Args) -> anyhow::Result<(Vec<Unit>, Rig)> {
    let (units, rig) = match (&args.mounts, &args.sensors[..], &args.mount) {
        (Some(mounts), models, _) => {
            mounted(&mounts.without_models().map_err(wrong_usage)?, models, &args.sensor)?
        }
        (None, models @ [model], _) => {
            output::say_notice(&format!(
                "one {model}, level at the platform's origin; --mounts or --mount gives another mount"
            ));
            mounted(&[MountDeg::default()], models, &args.sensor)?
        }
        (None, [], Some(path)) => {
            let file = MountFile::read(path)?;
            let units = file.units(&args.sensor)?;
            let rig = file.rig_of(&units);
            (units, rig)
        }
        (None, ..) => {
            refuse!(
                "where do the sensors sit? Give --mount FILE, --mounts LIST, or a single model by --sensors MODEL"
            )
        }
    };
    if args.out.is_some() && rig.sensors.len() > 32 {
        bail!("{} sensors: a coverage file has bits for 32", rig.sensors.len());
    }
    Ok((units, rig))
}

/// The sensors of `--mounts`, of these models.
fn mounted(
    mounts: &[MountDeg],
    models: &[String],
    choices: &[UnitChoice],
) -> anyhow::Result<(Vec<Unit>, Rig)> {
    let units: Vec<Unit> = match (models, choices) {
        ([], [choice]) => vec![unit_of_all(choice)?; mounts.len()],
        (_, [_, ..]) | ([], []) => {
            refuse!("--mounts takes models by --sensors MODEL,MODEL, or one --sensor MODEL for all of them")
        }
        ([model], []) => vec![Unit::typed(model).map_err(wrong_usage)?.0; mounts.len()],
        (models, []) if models.len() == mounts.len() => models
            .iter()
            .map(|model| Ok(Unit::typed(model).map_err(wrong_usage)?.0))
            .collect::<anyhow::Result<_>>()?,
        (models, []) => refuse!(
            "--sensors names {} models and --mounts lists {} sensors: give one model for all, or one for each",
            models.len(),
            mounts.len()
        ),
    };
    let sensor = |(index, (unit, mount)): (usize, (&Unit, &MountDeg))| MountedSensor {
        name: format!("sensor {}", index + 1),
        model: unit.model.clone(),
        mount: mount.mount(),
    };
    let sensors = units.iter().zip(mounts).enumerate().map(sensor).collect();
    Ok((units, Rig { sensors }))
}

fn unit_of_all(choice: &UnitChoice) -> anyhow::Result<Unit> {
    Ok(match choice {
        UnitChoice { sensor: Some(name), .. } => {
            refuse!("--sensor {name}=...: sensors of --mounts have no names; give one --sensor for all")
        }
        UnitChoice { file: Some(file), model, .. } => Unit::calibrated(file, model.as_deref())?,
        UnitChoice { model, .. } => {
            Unit::nominal(model.as_deref().unwrap_or_default()).map_err(wrong_usage)?
        }
    })
}
