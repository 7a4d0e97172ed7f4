//! From a replayed recording to its comparison.

use super::comparison::{CheckReport, Comparison, Measured, RayReport, Reason, SurfaceReport, Verdict};
use super::silent::silent;
use super::{decide, words};
use crate::recording::Fault;
use crate::rig::MountedSensor;
use crate::verify::calibrate::{self, MountCheck, SensorCheck};
use crate::verify::compare::{
    Agreement, Conflicts, CoverageCounts, Field, Healthy, NullTest, PatchAgreement, Patches, RayClasses,
    Replayed, SurfaceCovered, misread, surface_cells,
};
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Rays of each healthy run.
const NULL_RAYS: usize = 200_000;

/// From this share of a sensor's returns beyond the scene on, hundredths of a degree are not to be believed:
/// with half of a furnished house removed a relative pitch was off by 15 times its interval.
const HOLES_SHARE: f64 = 0.3;

/// What is being worked on.
pub enum Step {
    /// So many healthy runs are simulated.
    HealthyRuns(u64),
    /// One of them is done.
    HealthyRun,
    /// The mounts are estimated.
    Mounts,
}

/// What a replayed recording is compared with.
pub struct Inputs<'a> {
    /// As it is known.
    pub scene: &'a Scene,
    /// As it is believed.
    pub trajectory: &'a Trajectory,
    /// Where the frame of both begins in that of the files.
    pub origin: LocalOrigin,
    /// The surface that can be seen from the trajectory.
    pub patches: Option<&'a Patches>,
    /// Coverage of the plan; as driven where there was none.
    pub planned: Option<&'a Coverage>,
    /// What healthy runs are simulated with.
    pub healthy: Healthy,
    /// Of the sensors; 0 where none is known.
    pub revolution_ns: u64,
    /// The trajectory was found from this recording, with the nominal mounts.
    pub is_own_trajectory: bool,
    /// A recorded and a predicted range agree within this.
    pub agree_within_m: f64,
    /// Found while decoding.
    pub faults: Vec<Fault>,
    /// Called at each step.
    pub report: &'a dyn Fn(Step),
}

/// Everything that the replay shows.
pub fn judge(inputs: Inputs<'_>, replayed: &Replayed) -> Comparison {
    let Replayed { sensors, sampled, .. } = replayed;
    let field = Field {
        scene: inputs.scene,
        trajectory: inputs.trajectory,
        sensors,
        rays: sampled,
        agree_within_m: inputs.agree_within_m,
    };
    let mut faults = inputs.faults;
    faults.extend(silent(replayed, &faults));
    faults.extend(misread(&field));
    let every = sampled.len().div_ceil(NULL_RAYS).max(1);
    let fewer: Vec<_> = sampled.iter().step_by(every).copied().collect();
    let thinned = Field { rays: &fewer, ..field };
    let prediction = inputs.patches.map(|patches| {
        (inputs.report)(Step::HealthyRuns(inputs.healthy.runs as u64));
        NullTest::run(&thinned, patches, inputs.healthy, || (inputs.report)(Step::HealthyRun))
    });
    (inputs.report)(Step::Mounts);
    let MountCheck { mount, relative_tilt, rounds, converged, residual_sd_mm, scans } =
        mount_check(&field, &inputs.healthy, inputs.revolution_ns);
    let mount = match inputs.is_own_trajectory {
        true => mount.into_iter().zip(sensors).map(|(check, sensor)| shared(check, sensor)).collect(),
        false => mount,
    };
    // where the scene ends, rays near the cut fit the surfaces behind it
    let relative_tilt =
        relative_tilt.filter(|_| !replayed.breakdown.iter().any(|rays| has_holes(&rays.total())));
    let p_value = prediction.as_ref().and_then(|prediction| prediction.p_value);
    let seed = inputs.healthy.seed;
    let between = |recorded| patch_agreement(inputs.patches, replayed, recorded, seed);
    let agreement = between(|surface| &surface.recorded_patches).map(|patches| Measured { patches, p_value });
    let planned = inputs.planned.unwrap_or(&replayed.as_driven);
    let universe = surface_cells(inputs.scene, planned.grid());
    let overlap =
        |from: &Coverage, to: &Coverage| Agreement::between(&from.union(), &to.union(), universe.as_deref());
    let mut comparison = Comparison {
        verdict: Verdict::CannotTell,
        reason: Reason::undecided(),
        words: Vec::new(),
        faults,
        rays: sensors.iter().map(|s| s.name.clone()).zip(rays(replayed)).collect(),
        agreement,
        agreement_as_placed: between(|surface| &surface.placed_patches),
        execution: overlap(planned, &replayed.as_driven),
        model: overlap(&replayed.as_driven, &replayed.recorded),
        coverage: CoverageCounts {
            planned: planned.union_count(),
            as_driven: replayed.as_driven.union_count(),
            recorded: replayed.recorded.union_count(),
        },
        surface: surface_report(inputs.patches, replayed),
        mount,
        relative_tilt,
        mount_check: Some(CheckReport { rounds, converged, residual_sd_mm, scans }),
        conflicts: Conflicts::between(&thinned).map(|conflicts| conflicts.in_world(inputs.origin)),
        prediction,
    };
    let cell_m = match inputs.scene {
        Scene::Voxels(map) => Some(map.voxel_m()),
        _ => None,
    };
    (comparison.verdict, comparison.reason) = decide(&comparison, cell_m);
    comparison.words = words(&comparison, replayed, inputs.patches, inputs.origin, cell_m);
    comparison
}

/// Of the patches predicted as driven and those recorded; `recorded` says which of them count as such.
fn patch_agreement(
    patches: Option<&Patches>,
    replayed: &Replayed,
    recorded: fn(&SurfaceCovered) -> &Vec<bool>,
    seed: u64,
) -> Option<PatchAgreement> {
    let (patches, surface) = patches.zip(replayed.surface.as_ref())?;
    Some(PatchAgreement::between(patches, &surface.as_driven_patches, recorded(surface), seed))
}

fn surface_report(patches: Option<&Patches>, replayed: &Replayed) -> Option<SurfaceReport> {
    let (patches, surface) = patches.zip(replayed.surface.as_ref())?;
    Some(SurfaceReport {
        observable_share: patches.observable_share(),
        as_driven: surface.as_driven,
        recorded: surface.recorded,
        placed: surface.placed,
    })
}

/// The error of a mount is not observable where its returns made the trajectory: a part of it went there.
fn shared(check: SensorCheck, sensor: &MountedSensor) -> SensorCheck {
    let why = "the trajectory was found with this mount, and took up what all sensors share; what one differs from another by \
               is left";
    SensorCheck {
        cannot_tell: check.cannot_tell.or_else(|| Some(why.to_owned())),
        is_of_another_scene: check.is_of_another_scene,
        rays: check.rays,
        ..SensorCheck::undetermined(&sensor.name, sensor.mount)
    }
}

/// Whether so many returns come where the scene has nothing that a part of it must be missing.
fn has_holes(rays: &RayClasses) -> bool {
    let returns = rays.agree + rays.short + rays.long + rays.extra;
    rays.extra as f64 > HOLES_SHARE * returns as f64
}

fn mount_check(field: &Field<'_>, healthy: &Healthy, revolution_ns: u64) -> MountCheck {
    let revolution_ns = if revolution_ns > 0 { revolution_ns } else { 100_000_000 };
    let settings = calibrate::Settings { pose: healthy.pose, revolution_ns, ..Default::default() };
    let field = calibrate::Field {
        scene: field.scene,
        trajectory: field.trajectory,
        sensors: field.sensors,
        rays: field.rays,
    };
    calibrate::check(&field, &settings)
}

fn rays(replayed: &Replayed) -> impl Iterator<Item = RayReport> + '_ {
    replayed.breakdown.iter().zip(&replayed.rays).map(|(breakdown, classes)| RayReport {
        classes: *classes,
        agree_share: classes.agree_share(),
        by_channel: breakdown.by_channel(),
        by_azimuth: breakdown.by_azimuth(),
        by_incidence: breakdown.by_incidence.to_vec(),
    })
}
