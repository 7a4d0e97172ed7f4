//! What `optimize` is asked for.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::scene_flags::SceneSearchArgs;
use super::values::{ClearanceArg, Corners, MountErrors, Range, Switch, batch, percent, tilts};
use crate::commands::experiment_args::{ExperimentArgs, FidelityArg};
use crate::design::optimize::{Acquisition, KeepApart, Kind, PUBLISHED_MASTERS_MAX};
use crate::design::robustness::{Criterion, Tolerance};

/// Arguments of `optimize`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Without --evals, methods stop by their published rules. Ctrl-C keeps the best mount so far; with --resume the \
                  search goes on from there."
)]
pub struct Args {
    #[command(flatten)]
    pub(super) experiment: ExperimentArgs,
    #[command(flatten)]
    pub(super) scene: SceneSearchArgs,
    /// Search method [default: staged].
    #[arg(long, value_enum)]
    pub(super) method: Option<Kind>,
    /// Evaluations, in a scene up to 1/8 more [default: the method's own].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub(super) evals: Option<u64>,
    /// Seed of all random numbers [default: 1].
    #[arg(long, value_name = "S")]
    pub(super) seed: Option<u64>,
    /// Stop by the method's published rule even if evaluations are left.
    #[arg(long)]
    pub(super) early_stop: bool,
    /// Points that a model (bayesian, staged) proposes at once.
    #[arg(long, value_name = "N", default_value = "1", value_parser = batch)]
    pub(super) batch: NonZeroUsize,
    /// By what a model chooses its next point; ei-plus is the published one.
    #[arg(long, value_enum, default_value_t)]
    pub(super) acquisition: Acquisition,
    /// Most masters; each is mirrored unless --no-mirror.
    #[arg(long, value_name = "N", default_value_t = PUBLISHED_MASTERS_MAX, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(super) masters_max: u32,
    /// Distance between sensor origins to keep: housing, none or metres [default: none in a published experiment, housing in a
    /// scene].
    #[arg(long, value_name = "RULE")]
    pub(super) clearance: Option<ClearanceArg>,
    /// Fewest masters.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(super) masters_min: u32,
    /// Pitches that the servo reaches: "low,high" in degrees, within -180 to 180.
    #[arg(long, value_name = "RANGE", default_value = "-90,90", allow_hyphen_values = true, value_parser = tilts)]
    pub(super) pitch_limits: Range,
    /// Rolls that the plate allows, where roll is free: "low,high" in degrees, within -180 to 180.
    #[arg(long, value_name = "RANGE", default_value = "-90,90", allow_hyphen_values = true, value_parser = tilts)]
    pub(super) roll_limits: Range,
    /// Where masters may sit: "x,x,y,y,z,z", minimum and maximum of each, m [default: as published].
    #[arg(long, value_name = "BOX", allow_hyphen_values = true)]
    pub(super) space: Option<Corners>,
    /// Pitch and roll are whole multiples of this: the step of a servo.
    #[arg(long, value_name = "DEG", value_parser = crate::commands::ranges::within(1e-3, 360.0))]
    pub(super) tilt_step: Option<f64>,
    /// Maximise the expected or the worst J of rigs that are built with errors; of several --site that over the sites, with errors of
    /// building where --tolerance is given.
    #[arg(long, value_enum, value_name = "CRITERION")]
    pub(super) robust: Option<Criterion>,
    /// Mount errors, uniform within plus and minus: "metres,degrees" [default: 0.01,1].
    #[arg(long, value_name = "M,DEG", allow_hyphen_values = true)]
    pub(super) tolerance: Option<MountErrors>,
    /// Also leave to chance where revolutions start.
    #[arg(long, requires = "robust")]
    pub(super) free_spin: bool,
    /// Draws of mount errors, the same for every mount.
    #[arg(long, value_name = "N", default_value_t = 16, requires = "robust", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(super) draws: u32,
    /// Judge the best mounts that lie apart again as they would be built (errors of --tolerance, phases free, four poses per
    /// metre) and give the best of these, not the highest J as searched [default: on for staged as planned, else off].
    #[arg(long, value_enum, conflicts_with_all = ["robust", "certify"])]
    pub(super) final_look: Option<Switch>,
    /// auto: search with four poses per metre in different phases, then look at the best mounts ever more finely until the
    /// choice can lose no more than --regret [default: auto with --voxel without flags for columns, poses or phase,
    /// unless --robust or --certify asks for something else; given for a published experiment].
    #[arg(long, value_enum)]
    pub(super) fidelity: Option<FidelityArg>,
    /// Share of J that the choice may lose, %.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.1, value_parser = percent)]
    pub(super) regret: f64,
    /// End when so many rays are cast (the running batch is finished).
    #[arg(long, value_name = "N")]
    pub(super) max_rays: Option<u64>,
    /// Then bound the J of all rigs of one master in at most N regions of mounts: a proof of how much better any could be.
    #[arg(long, value_name = "N", conflicts_with = "robust", value_parser = crate::commands::ranges::count(1, 1_000_000))]
    pub(super) certify: Option<usize>,
    /// Write the best mount to this file.
    #[arg(short, long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
    /// Write the best mount as the published program exports it.
    #[arg(long, value_name = "FILE")]
    pub(super) export_published: Option<PathBuf>,
    /// Write one line per sensor: mount, voxels, voxels alone.
    #[arg(long, value_name = "FILE")]
    pub(super) csv: Option<PathBuf>,
    /// Write a page with convergence and coverage.
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
    /// State of the search: read if it exists, written while searching.
    #[arg(long, value_name = "STATE")]
    pub(super) resume: Option<PathBuf>,
}

impl Args {
    /// The minimum distance between sensors in a published experiment.
    pub(super) fn keep_apart(&self) -> KeepApart {
        self.clearance.map_or(KeepApart::None, |clearance| clearance.0)
    }

    /// Assumed errors of a built mount.
    pub(super) fn tolerance(&self) -> Tolerance {
        let MountErrors(position_m, angle_deg) = self.tolerance.unwrap_or(MountErrors(0.01, 1.0));
        Tolerance { position_m, angle_deg, free_phase: self.free_spin }
    }
}
