//! What is cast into what: the sensors on their mounts, the mesh, the way, the samples.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::bail;

use super::Args;
use super::document::{Beside, Seen};
use crate::commands::baselines::{Baselines, SCAN_PITCHES_DEG, Single, best_pitch, level_mount, search_step};
use crate::commands::ground::{MeshTaken, stations};
use crate::commands::registration::{Tied, along_way};
use crate::commands::surface::{MAIN_RANK, Surface};
use crate::rig::{Mount, MountFile, MountedSensor, Rig, Unit, UnitChoice};
use crate::simulate::fan::BeamFan;
use crate::simulate::scan::{Scanner, Spin};
use crate::world::scene::{Mesh, Scene};
use crate::world::surface::{Completeness, SurfaceSamples, THRESHOLDS_M};
use crate::world::trajectory::Trajectory;

/// A sensor on its mount.
pub struct Placed {
    pub name: String,
    pub mount: Mount,
    pub unit: Unit,
}

/// Everything that is cast into.
pub struct Field {
    pub scene: Scene,
    pub mesh: Arc<Mesh>,
    pub taken: MeshTaken,
    pub trajectory: Trajectory,
    samples: SurfaceSamples,
    /// By sensor.
    pub fans: Vec<BeamFan>,
}

/// The sensors of `--mounts` or of the mount file.
pub fn placed(args: &Args) -> anyhow::Result<Vec<Placed>> {
    match (&args.mounts, &args.mount) {
        (Some(masters), _) => {
            let [choice] = &args.sensor[..] else { refuse!("--mounts takes one --sensor for all of them") };
            let unit = match choice {
                UnitChoice { sensor: Some(name), .. } => {
                    refuse!(
                        "--sensor {name}=...: sensors of --mounts have no names; give one --sensor for all"
                    )
                }
                UnitChoice { file: Some(file), model, .. } => Unit::calibrated(file, model.as_deref())?,
                UnitChoice { model, .. } => Unit::nominal(model.as_deref().unwrap_or_default())?,
            };
            let place = |(index, placement): (usize, &crate::simulate::published::Placement)| Placed {
                name: format!("sensor {}", index + 1),
                mount: placement.mount(),
                unit: unit.clone(),
            };
            Ok(masters.without_models()?.iter().enumerate().map(place).collect())
        }
        (None, Some(path)) => {
            let file = MountFile::read(path)?;
            let units = file.units(&args.sensor)?;
            let place = |(entry, unit): (&crate::rig::SensorEntry, Unit)| Placed {
                name: entry.name.clone(),
                mount: entry.mount(),
                unit,
            };
            Ok(file.sensors.iter().zip(units).map(place).collect())
        }
        (None, None) => refuse!("give --mounts or --mount"),
    }
}

/// The sensors as a rig.
pub fn rig(placed: &[Placed]) -> Rig {
    let mounted = |placed: &Placed| MountedSensor {
        name: placed.name.clone(),
        model: placed.unit.model.clone(),
        mount: placed.mount,
    };
    Rig { sensors: placed.iter().map(mounted).collect() }
}

/// Reads and checks everything.
pub fn field(args: &Args, placed: &[Placed]) -> anyhow::Result<(Field, Vec<String>)> {
    let read = args.mesh_args.read(&args.mesh)?;
    let mut warnings: Vec<String> = placed.iter().filter_map(|placed| placed.unit.notice.clone()).collect();
    warnings.dedup();
    warnings.extend(read.warnings);
    let trajectory = args.trajectory.read()?;
    let fans: Vec<_> = placed.iter().map(|placed| fan(args, &placed.unit)).collect::<Result<_, _>>()?;
    if let Some(slow) = fans.iter().find(|fan| fan.scans(&trajectory) == 0) {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        bail!(
            "{}: {} s long, expected at least one revolution of {} s",
            args.trajectory.name(),
            (end_ns - start_ns) as f64 * 1e-9,
            1.0 / slow.rate_hz
        );
    }
    warnings.extend(args.trajectory.doubts("mesh", read.mesh.bounds_m(), &trajectory));
    let samples = args.samples.take(&read.mesh, args.seed)?;
    let mesh = Arc::new(read.mesh);
    let (scene, taken) = (Scene::Mesh(mesh.clone()), read.taken);
    Ok((Field { scene, mesh, taken, trajectory, samples, fans }, warnings))
}

fn fan(args: &Args, unit: &Unit) -> anyhow::Result<BeamFan> {
    let columns = args.azimuths.unwrap_or(unit.columns);
    let rate_hz = args.spin_rate.unwrap_or(unit.rate_hz);
    let mut fan = BeamFan::nominal(&unit.model, columns as usize, rate_hz);
    fan.min_range_m = args.min_range;
    fan.max_range_m = args.max_range.unwrap_or(fan.max_range_m);
    if !(fan.min_range_m >= 0.0 && fan.max_range_m > fan.min_range_m) {
        bail!("ranges from {} to {} m, expected 0 or more, ascending", fan.min_range_m, fan.max_range_m);
    }
    Ok(fan)
}

impl Field {
    /// The samples with the observable set.
    pub fn surface(&self, placed: &[Placed]) -> Surface {
        let mounts: Vec<_> = placed.iter().map(|placed| placed.mount).collect();
        Surface::new(&self.mesh, self.samples.clone(), &stations(&self.trajectory, &mounts))
    }

    /// What the sensors see.
    pub fn see(&self, placed: &[Placed], surface: &Surface) -> (Seen, Completeness) {
        let pairs: Vec<_> = self.fans.iter().zip(placed.iter().map(|placed| placed.mount)).collect();
        self.cast(&pairs, surface)
    }

    /// What fans on mounts see. Mounts of equal fans are cast together, as they were listed.
    fn cast(&self, pairs: &[(&BeamFan, Mount)], surface: &Surface) -> (Seen, Completeness) {
        let mut completeness = Completeness::new(&surface.samples, &THRESHOLDS_M);
        let mut groups: Vec<(&BeamFan, Vec<Mount>)> = Vec::new();
        for (fan, mount) in pairs {
            match groups.iter_mut().find(|(other, _)| other == fan) {
                Some((_, mounts)) => mounts.push(*mount),
                None => groups.push((fan, vec![*mount])),
            }
        }
        let cast = |(fan, mounts): &(&BeamFan, Vec<Mount>)| {
            fan.cover(&self.scene, &self.trajectory, mounts, 1, &mut completeness)
        };
        let rays = groups.iter().map(cast).sum();
        let mounts = pairs.iter().map(|(_, mount)| numbers(mount)).collect();
        (Seen { covered: surface.covered(&completeness), mounts, rays }, completeness)
    }

    /// Flags of the samples that each sensor covers at 5 cm.
    pub fn covered_by_sensor(&self, placed: &[Placed], surface: &Surface) -> Vec<Vec<bool>> {
        let pairs = self.fans.iter().zip(placed.iter().map(|placed| placed.mount));
        pairs.map(|pair| self.cast(&[pair], surface).1.covered(MAIN_RANK)).collect()
    }

    /// One level sensor, the best single one, and the first of several without the others.
    pub fn baselines(&self, placed: &[Placed], surface: &Surface, of_mounts: &Seen) -> Baselines<Beside> {
        let mounts: Vec<_> = placed.iter().map(|placed| placed.mount).collect();
        let level = level_mount(&mounts);
        // of equals the first
        let channels = |index: &usize| placed[*index].unit.model.channels();
        let strongest = (0..placed.len()).rev().max_by_key(channels).unwrap_or(0);
        let alone = |index: usize, mount: Mount| {
            let (seen, _) = self.cast(&[(&self.fans[index], mount)], surface);
            let gain = |(key, value): (&String, &f64)| {
                (key.clone(), 100.0 * (of_mounts.covered.completeness[key] - value))
            };
            let gain_points: BTreeMap<_, _> = seen.covered.completeness.iter().map(gain).collect();
            Single::new(&placed[index].unit.model.name, &mount, Beside { seen, gain_points })
        };
        let tilted = |pitch_deg: f64| Mount { pitch_rad: pitch_deg.to_radians(), ..level };
        let (best_deg, pitch_search) = best_pitch(&SCAN_PITCHES_DEG, |pitch_deg| {
            self.share_of_some(&self.fans[strongest], tilted(pitch_deg), surface)
        });
        let level_single = alone(strongest, level);
        let mut best_single =
            if best_deg == 0.0 { level_single.clone() } else { alone(strongest, tilted(best_deg)) };
        let share = |single: &Single<Beside>| single.seen.seen.covered.main();
        // the search saw a part of the way only
        if share(&best_single) < share(&level_single) {
            best_single = level_single.clone();
        }
        Baselines {
            level_single,
            best_single,
            first_single: (placed.len() > 1).then(|| alone(0, placed[0].mount)),
            pitch_search,
            search_by: "completeness at 0.05 m on some revolutions",
        }
    }

    /// How well scans are tied down, by the sensors' own beams and spins.
    pub fn tied(&self, placed: &[Placed]) -> Tied {
        let rig = rig(placed);
        let mut scanner = Scanner::new(&self.scene, &self.trajectory, &rig, Spin::default());
        for (spin, fan) in scanner.spins.iter_mut().zip(&self.fans) {
            (spin.rate_hz, spin.columns) = (fan.rate_hz, fan.columns() as u32);
        }
        along_way(&scanner)
    }

    /// Share of the samples within 5 cm of a hit on some revolutions.
    fn share_of_some(&self, fan: &BeamFan, mount: Mount, surface: &Surface) -> f64 {
        let mut completeness = Completeness::new(&surface.samples, &THRESHOLDS_M[MAIN_RANK..=MAIN_RANK]);
        let step = search_step(fan.scans(&self.trajectory));
        fan.cover(&self.scene, &self.trajectory, &[mount], step, &mut completeness);
        completeness.shares()[0]
    }
}

fn numbers(mount: &Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}
