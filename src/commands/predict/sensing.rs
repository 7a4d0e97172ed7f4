//! How the sensors of a prediction spin, and what is less than perfect about them.

use crate::commands::ensure_consistent;
use crate::commands::scene_args::{Operator, QualityArgs};
use crate::rig::{Rig, Unit};
use crate::simulate::detection::Detection;
use crate::simulate::scan::{Scanner, SensorErrors, Spin};
use crate::simulate::view::Sampling;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Options of the sensors.
#[derive(clap::Args, Debug)]
pub struct SensingArgs {
    /// Revolutions per second [default: as the calibration says; else 10].
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(0.1, 200.0))]
    spin_rate: Option<f64>,
    /// Encoder azimuth of every sensor when the trajectory begins.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true, value_parser = crate::commands::ranges::within(-3600.0, 3600.0))]
    spin_phase: f64,
    /// Least range that is reported [default: the model's].
    #[arg(long, value_name = "M", value_parser = crate::commands::ranges::within(0.0, 10_000.0))]
    min_range: Option<f64>,
    #[command(flatten)]
    pub(super) quality: QualityArgs,
    /// Standard deviation of a range.
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = crate::commands::ranges::within(0.0, 100.0))]
    range_noise: f64,
    /// Reflectivity of all surfaces, matt, above 0 and at most 1: dark, far and grazing ones then lose returns
    /// [default: every return is detected].
    #[arg(long, value_name = "SHARE", value_parser = crate::commands::ranges::within(1e-6, 1.0))]
    reflectivity: Option<f64>,
    /// Share of returns lost at random.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = crate::commands::ranges::within(0.0, 0.999_999))]
    drop_out: f64,
    /// Rays spread over each beam's divergence; the median range counts.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=64))]
    sub_rays: u32,
    /// The operator, who shades beams: "x,y,z,x,y,z,radius", the ends of a capsule in the body frame (x forward, y left), m.
    #[arg(long, allow_hyphen_values = true, value_name = "CAPSULE")]
    operator: Option<Operator>,
    /// Let beams pass through the other sensors.
    #[arg(long)]
    no_housings: bool,
}

/// Least range of an ideal sensor, m.
const IDEAL_MIN_RANGE_M: f64 = 0.3;

impl SensingArgs {
    /// Ideal beams, at the columns, rate and ranges that are given.
    pub(crate) fn ideal(&self, columns: Option<u32>) -> Sampling {
        Sampling {
            is_ideal: true,
            columns,
            rate_hz: self.spin_rate,
            min_range_m: self.min_range.or(Some(IDEAL_MIN_RANGE_M)),
            quality: self.quality.quality(),
            ..Sampling::default()
        }
    }

    /// The rig, made ready to scan.
    pub(crate) fn scanner<'a>(
        &self,
        scene: &'a Scene,
        trajectory: &'a Trajectory,
        (rig, units): (&'a Rig, &[Unit]),
        columns: Option<u32>,
        seed: u64,
    ) -> anyhow::Result<Scanner<'a>> {
        let mut scanner = Scanner::new(scene, trajectory, rig, Spin::default());
        for (spin, unit) in scanner.spins.iter_mut().zip(units) {
            *spin = Spin {
                rate_hz: self.spin_rate.unwrap_or(unit.rate_hz),
                columns: columns.unwrap_or(unit.columns),
                phase_rad: self.spin_phase.to_radians(),
                clockwise: true,
            };
        }
        if self.no_housings {
            scanner.occluders.iter_mut().for_each(Vec::clear);
        }
        if let Some(Operator(capsule)) = self.operator {
            scanner.occluders.iter_mut().for_each(|solids| solids.push(capsule));
        }
        scanner.sensor_errors = SensorErrors {
            min_range_m: self.min_range,
            max_range_m: self.quality.max_range,
            range_noise_m: self.range_noise,
            max_incidence_rad: self.quality.max_incidence.map(f64::to_radians),
            drop_out: self.drop_out,
            detection: self.reflectivity.map(|reflectivity| Detection { reflectivity }),
            sub_rays: self.sub_rays,
        };
        (scanner.seed, scanner.min_hits) = (seed, self.quality.quality().min_hits);
        Ok(scanner)
    }

    pub(super) fn check(&self) -> anyhow::Result<()> {
        let (Some(min_m), Some(max_m)) = (self.min_range, self.quality.max_range) else { return Ok(()) };
        let words = format!("--min-range {min_m} is not below --max-range {max_m}");
        ensure_consistent([(min_m >= max_m, words)])
    }
}
