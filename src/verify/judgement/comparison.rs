//! What a replayed recording comes to: the document that `compare` and `demo` share.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::recording::Fault;
use crate::verify::align::Alignment;
use crate::verify::calibrate::{RelativeTilt, SensorCheck};
use crate::verify::compare::{
    Agreement, Conflicts, CoverageCounts, NullTest, PatchAgreement, RayClasses, SurfaceShare,
};

/// Predicted against recorded.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// PASS, DIFFERS or CANNOT TELL.
    pub verdict: Verdict,
    /// The test that decides.
    pub reason: Reason,
    /// What is missing, where, and why most likely.
    pub words: Vec<String>,
    /// What is broken, the worst first.
    pub faults: Vec<Fault>,
    /// By sensor.
    pub rays: BTreeMap<String, RayReport>,
    /// As driven against recorded, on the patches that can be seen from the path.
    pub agreement: Option<Measured>,
    /// The same with points where they were measured, not where they were predicted.
    pub agreement_as_placed: Option<PatchAgreement>,
    /// Planned against as driven, cells.
    pub execution: Agreement,
    /// As driven against recorded, cells.
    pub model: Agreement,
    /// Cells.
    pub coverage: CoverageCounts,
    /// None without a surface to sample.
    pub surface: Option<SurfaceReport>,
    /// By sensor, in the order of the rig.
    pub mount: Vec<SensorCheck>,
    /// Of two sensors against each other.
    pub relative_tilt: Option<RelativeTilt>,
    /// None where no mount was checked.
    pub mount_check: Option<CheckReport>,
    /// Cells that are free in the recording and occupied in the scene, or the reverse.
    pub conflicts: Option<Conflicts>,
    /// Healthy simulated runs, as the reference of the recording.
    pub prediction: Option<NullTest>,
}

/// From this share of rays outside the trajectory's time on, the comparison is about a part of the recording.
pub(super) const PART_SHARE: f64 = 0.05;

impl Comparison {
    /// The share of the rays that agree, of all sensors together; none without informative rays.
    pub(super) fn agree_share(&self) -> Option<f64> {
        let (mut agree, mut all) = (0, 0);
        for RayReport { classes, .. } in self.rays.values() {
            agree += classes.agree;
            all += classes.informative();
        }
        (all > 0).then(|| agree as f64 / all as f64)
    }

    /// Share of the rays that lie outside the trajectory's time.
    pub(super) fn unplaced_share(&self) -> f64 {
        let (mut unplaced, mut all) = (0, 0);
        for RayReport { classes, .. } in self.rays.values() {
            unplaced += classes.unplaced;
            all += classes.informative() + classes.nothing + classes.unplaced;
        }
        unplaced as f64 / all.max(1) as f64
    }

    /// The verdict in one sentence, how much of the recording it is about, and what it leaves open.
    pub(crate) fn headline(&self) -> String {
        let share = self.unplaced_share();
        let part = match share >= PART_SHARE {
            true => {
                format!(", as far as the trajectory goes: {:.0} % of the rays lie outside it", 100.0 * share)
            }
            false => String::new(),
        };
        let what = match self.reason.code {
            "map_too_coarse" => "the map leaves gaps through which the rays go on",
            _ => self.verdict.words(),
        };
        format!("{what}{part}{}", self.undetermined())
    }

    /// What to do, in one sentence.
    pub(crate) fn advice(&self) -> &'static str {
        match (self.verdict, self.reason.code) {
            (Verdict::Matches, _) => "Nothing is to be done: the recording can be used.",
            (_, "map_too_coarse") => {
                "Make the map of more revolutions, or of smaller cells (--map-voxel), or give a mesh, and compare again."
            }
            (Verdict::CannotTell, _) => {
                "Record longer, or give a trajectory that covers the recording, and compare again."
            }
            (_, "mount_off") => {
                "Compare again with --corrected-mount, set the mount to what was found, and check the brackets."
            }
            (_, "another_frame") => {
                "Trajectory and scene are in different frames: compare again with --align."
            }
            (_, "silent_sensor" | "sensor_with_few_rays") => {
                "Check power, cable and network of the sensor that is named below, and record again."
            }
            (_, "metadata_missing" | "metadata_of_another_unit" | "wrong_model") => {
                "Give the metadata of the sensors that recorded (--meta), and compare again."
            }
            (_, "surface_missing") => "Look at the missed surface below and walk there again.",
            _ => "Mend what the first finding names, and compare again.",
        }
    }

    /// What a match leaves open: predicted coverage does not confirm pitches.
    fn undetermined(&self) -> String {
        let undetermined = self.mount.iter().filter(|check| check.cannot_tell.is_some());
        let names: Vec<&str> = undetermined.map(|check| check.sensor.as_str()).collect();
        match names[..] {
            [_, ..] if self.verdict == Verdict::Matches => {
                format!("; the pitch of {} is not observable", names.join(" and "))
            }
            _ => String::new(),
        }
    }
}

/// One sensor's rays.
#[derive(Debug, Serialize)]
pub struct RayReport {
    /// How many ended how.
    #[serde(flatten)]
    pub classes: RayClasses,
    /// None without informative rays.
    pub agree_share: Option<f64>,
    /// Counted from 0.
    pub by_channel: Vec<RayClasses>,
    /// Sectors of 5 degrees of the encoder, clockwise from 0.
    pub by_azimuth: Vec<RayClasses>,
    /// Bins of 10 degrees from the normal.
    pub by_incidence: Vec<RayClasses>,
}

/// Agreement with how sure it is.
#[derive(Debug, Serialize)]
pub struct Measured {
    /// Of the patches, by area.
    #[serde(flatten)]
    pub patches: PatchAgreement,
    /// How often healthy simulated runs agree no better.
    pub p_value: Option<f64>,
}

/// Share of the surface's sample points within 5 cm.
#[derive(Debug, Serialize)]
pub struct SurfaceReport {
    /// Of all samples, those with a line of sight from the path.
    pub observable_share: f64,
    /// As predicted for the columns that were recorded.
    pub as_driven: SurfaceShare,
    /// Snapped to the prediction: errors can only lower it.
    pub recorded: SurfaceShare,
    /// As measured.
    pub placed: SurfaceShare,
}

/// How the mount check went.
#[derive(Debug, Serialize)]
pub struct CheckReport {
    /// Of the solver.
    pub rounds: usize,
    /// Whether its last step was negligible.
    pub converged: bool,
    /// Of the ranges, along the normals.
    pub residual_sd_mm: f64,
    /// Revolutions with a pose of their own.
    pub scans: usize,
}

/// What the comparison comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The recording covers what was predicted.
    Matches,
    /// It does not.
    Differs,
    /// Too little was recorded to say.
    CannotTell,
}

impl Verdict {
    /// As it stands before its sentence.
    pub(crate) fn label(self) -> &'static str {
        match self {
            Self::Matches => "PASS",
            Self::Differs => "DIFFERS",
            Self::CannotTell => "CANNOT TELL",
        }
    }

    /// One sentence.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Matches => "the recording covers what was predicted",
            Self::Differs => "the recording is not what was predicted",
            Self::CannotTell => "too little was recorded within the trajectory's time",
        }
    }
}

/// The test that decided a verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reason {
    /// For scripts: the name of a fault, or of the test.
    pub code: &'static str,
    /// Its figures, and what they are held against.
    pub values: BTreeMap<&'static str, f64>,
    /// How often healthy runs do no better, where that decides.
    pub p_value: Option<f64>,
}

impl Reason {
    pub(super) fn new(code: &'static str) -> Self {
        Self { code, values: BTreeMap::new(), p_value: None }
    }

    /// Of what is not judged yet.
    pub(crate) fn undecided() -> Self {
        Self::new("undecided")
    }

    /// With those values that there are.
    pub(super) fn with(mut self, values: impl IntoIterator<Item = (&'static str, Option<f64>)>) -> Self {
        self.values.extend(values.into_iter().filter_map(|(name, value)| Some((name, value?))));
        self
    }

    /// Of a walk that has no sure place in the scene.
    pub(crate) fn of_placement(alignment: &Alignment) -> Self {
        let inliers = alignment.best.as_ref().map(|best| best.inlier_share);
        let second = alignment.second_best.as_ref();
        Self::new(alignment.code()).with([
            ("placements", Some(alignment.placements.len() as f64)),
            ("inlier_share", inliers),
            ("only_best", second.map(|second| second.only_best)),
            ("only_second", second.map(|second| second.only_second)),
        ])
    }

    /// In words.
    pub(crate) fn line(&self) -> String {
        let values = self.values.iter().map(|(name, value)| {
            let digits = if value.fract() == 0.0 { 0 } else { 4 };
            format!("{name} {value:.digits$}")
        });
        let p_value = self.p_value.map(|p| format!("p {p:.3}"));
        let all: Vec<String> = std::iter::once(self.code.to_owned()).chain(values).chain(p_value).collect();
        all.join(", ")
    }
}
