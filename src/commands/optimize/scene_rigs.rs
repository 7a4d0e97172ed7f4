//! What is searched in a scene: the rigs, their bounds, and the beams that judge.

use std::path::{Path, PathBuf};

use super::args::Args;
use super::scene_flags::Counts;
use super::values::Corners;
use crate::base::numbers::count;
use crate::commands::{ensure_consistent, output, wrong_usage};
use crate::design::optimize::{KeepApart, MountBounds};
use crate::design::scene_search::{RigSpace, affordable_stride, is_of_few_channels};
use crate::rig::{MountFile, Rig, Roll, Unit};
use crate::simulate::view::{Fineness, Sampling, ViewError, ViewSite};

/// Least range of an ideal sensor, m.
const IDEAL_MIN_RANGE_M: f64 = 0.3;
/// A search corrects its model, and may look coarsely: rays, and layers of height, m.
const SEARCH_STEP_SHARE: f64 = 0.85;
const SEARCH_LAYER_GAP_M: f64 = 0.3;

pub(super) fn rig_space(args: &Args) -> anyhow::Result<RigSpace> {
    let named = args.scene.sensors.len();
    ensure_consistent([
        (
            named == 0,
            "which sensors? Give --sensors, models of the catalogue with commas between them (os1-64,os1-64)"
                .into(),
        ),
        (
            args.scene.count.is_some() && named > 1,
            format!("--count is about one model, and --sensors names {named}: give it once"),
        ),
    ])?;
    let mut units: Vec<Unit> = Vec::new();
    let mut files: Vec<Option<PathBuf>> = Vec::new();
    let mut places = Vec::new();
    for typed in &args.scene.sensors {
        let (unit, file) = Unit::typed(typed.trim()).map_err(wrong_usage)?;
        let place = units.iter().position(|known| known.model == unit.model).unwrap_or_else(|| {
            unit.notice.iter().for_each(|notice| output::say_notice(notice));
            units.push(unit);
            files.push(file);
            units.len() - 1
        });
        places.push(place);
    }
    let settings = args.experiment.of_scene();
    let mut bounds = MountBounds {
        pitch_deg: (args.pitch_limits.0, args.pitch_limits.1),
        roll_deg: (args.roll_limits.0, args.roll_limits.1),
        ..MountBounds::default()
    };
    if let Some(Corners([x0, x1, y0, y1, z0, z1])) = args.space {
        (bounds.x_m, bounds.y_m, bounds.z_m) = ((x0, x1), (y0, y1), (z0, z1));
    }
    Ok(RigSpace {
        masters: RigSpace::masters_of(&places, settings.is_mirrored),
        units,
        files,
        bounds,
        fixed_roll_deg: match settings.roll {
            Roll::Fixed(roll_deg) => Some(roll_deg),
            Roll::Free => None,
        },
        tilt_step_deg: args.tilt_step,
        keep_apart: args.clearance.map_or(KeepApart::Housings, |clearance| clearance.0),
    })
}

/// Which beams judge, and a notice where revolutions are left out.
///
/// # Errors
/// Those of a view.
pub(super) fn sampling(
    args: &Args,
    sites: &[ViewSite],
    units: &[Unit],
    largest: &Rig,
) -> Result<(Sampling, Option<String>), ViewError> {
    let all = Sampling {
        is_ideal: args.scene.ideal,
        columns: args.experiment.of_scene().columns,
        min_range_m: args.scene.ideal.then_some(IDEAL_MIN_RANGE_M),
        quality: args.scene.quality.quality(),
        ..Sampling::default()
    };
    if let Some(scan_stride) = args.scene.scan_stride {
        return Ok((Sampling { scan_stride, ..all }, None));
    }
    let (scan_stride, rays) = affordable_stride(sites, units, &all, largest)?;
    let left_out = (scan_stride > 1).then(|| {
        format!(
            "judged by one revolution in {scan_stride}, as all are {} beams a mount; --scan-stride 1 casts them",
            count(rays)
        )
    });
    Ok((Sampling { scan_stride, ..all }, left_out))
}

/// The units and the rig of a mount file.
pub(super) fn present(path: &Path, rigs: &RigSpace) -> anyhow::Result<(Vec<Unit>, Rig)> {
    let file = MountFile::read(path)?;
    let units = file.units(&[])?;
    let rig = file.rig_of(&units);
    let of_search = rigs.any();
    if rig.sensors.len() != of_search.sensors.len() {
        output::say_notice(&format!(
            "{}: {} sensors, and {} are searched: the two are judged side by side as they are",
            path.display(),
            rig.sensors.len(),
            of_search.sensors.len()
        ));
    }
    Ok((units, rig))
}

/// A rig of as many sensors as are searched at most.
pub(super) fn largest(args: &Args, rigs: &RigSpace) -> Rig {
    match args.scene.count {
        Some(Counts(_, last)) => rigs.with_sensors(last, args.experiment.of_scene().is_mirrored).any(),
        None => rigs.any(),
    }
}

/// How finely the model of a search looks.
pub(super) fn fineness(rigs: &RigSpace) -> Fineness {
    Fineness {
        views: if is_of_few_channels(&rigs.any()) { 100 } else { 50 },
        step_share: SEARCH_STEP_SHARE,
        ..Fineness::between(rigs.bounds.z_m)
    }
    .with_gaps(SEARCH_LAYER_GAP_M)
}
