//! The published simulator to the bit, and the general one against stored references.

use outrigger::objective::{self, Weights};
use outrigger::simulate::published::{Experiment, Path, Placement, Preset, Roll, Seen, Simulator};
use serde::Deserialize;
use sha2::Digest as _;

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("the_definition_matches_the_released_program", the_definition_matches_the_released_program),
];

/// One evaluation by the released program.
#[derive(Deserialize)]
#[allow(non_snake_case)] // the file's own names
struct Reference {
    id: String,
    kind: String,
    sensor: String,
    path_axis: String,
    vox: f64,
    az_samples: usize,
    symmetry: bool,
    fix_roll: Option<f64>,
    masters: Vec<[f64; 5]>,
    N: usize,
    U: u64,
    ge2: u64,
    per_sensor: Vec<u64>,
    unique_only: Vec<u64>,
    missed_ray_poses_per_sensor: Vec<u64>,
    rho: f64,
    delta_min_deg: Option<f64>,
    R_ov: f64,
    R_ang: f64,
    J: f64,
    boundary_voxels: u64,
    union_bits_sha256: String,
    counts_sha256: String,
}

impl Reference {
    fn all() -> Vec<Self> {
        #[derive(Deserialize)]
        struct File {
            cases: Vec<Reference>,
        }
        let text = std::fs::read_to_string(shared("reference/simulator/evaluations.json")).unwrap();
        let file: File = serde_json::from_str(&text).unwrap();
        assert_eq!(file.cases.len(), 70);
        file.cases
    }

    fn experiment(&self) -> Experiment {
        let preset = Preset::named(&format!("paper-{}", self.sensor.to_lowercase())).unwrap();
        Experiment {
            path: if self.path_axis == "x" { Path::Lateral } else { Path::Forward },
            voxel_m: self.vox,
            azimuths: self.az_samples,
            roll: self.fix_roll.map_or(Roll::Free, Roll::Fixed),
            mirror: self.symmetry,
            ..Experiment::published(preset)
        }
    }

    fn sensors(&self) -> Vec<Placement> {
        let masters: Vec<_> = self.masters.iter().map(|master| Placement::from(*master)).collect();
        self.experiment().sensors(&masters)
    }

    fn counts_sha256(seen: &Seen) -> String {
        let cells = seen.coverage.grid().len();
        let count = |index: usize| {
            let bit = |sensor| (seen.coverage.sensor_bitmap(sensor)[index / 64] >> (index % 64) & 1) as u8;
            (0..seen.coverage.sensors()).map(bit).sum::<u8>()
        };
        let bytes: Vec<u8> = (0..cells).map(count).collect();
        sha2::Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// What differs; empty when nothing does. Everything is compared to the bit except the angle and what follows from
    /// it: its arc cosine comes from another mathematics library, one unit in the last place apart in four cases.
    fn differences(&self, simulator: &Simulator, seen: &Seen) -> Vec<String> {
        let counts = seen.coverage.counts();
        let sensors = self.sensors();
        let axes: Vec<_> = sensors.iter().map(Placement::spin_axis).collect();
        let angle_deg = objective::min_angle_deg(&axes);
        let terms = objective::score(&Weights::default(), &counts, angle_deg, sensors.len());
        let mut wrong = Vec::new();
        let mut check = |what: &str, same: bool| {
            if !same {
                wrong.push(format!("{} ({}): {what}", self.id, self.kind));
            }
        };
        check("N", sensors.len() == self.N);
        check("reachable", simulator.reachable() == self.boundary_voxels);
        check(&format!("U {} for {}", counts.union, self.U), counts.union == self.U);
        check("ge2", counts.overlap == self.ge2);
        check("per_sensor", counts.per_sensor == self.per_sensor);
        check("unique_only", counts.unique_per_sensor == self.unique_only);
        check("missed", seen.lost_rays == self.missed_ray_poses_per_sensor);
        check("rho", counts.overlap_ratio() == self.rho);
        let angles = angle_deg.zip(self.delta_min_deg);
        check(
            &format!("delta {angle_deg:?} for {:?}", self.delta_min_deg),
            angle_deg == self.delta_min_deg || angles.is_some_and(|(a, b)| (a - b).abs() <= 5e-15),
        );
        check("R_ov", terms.overlap == self.R_ov);
        check(&format!("R_ang {} for {}", terms.angular, self.R_ang), (terms.angular - self.R_ang).abs() <= 5e-13);
        check(&format!("J {} for {}", terms.objective(), self.J), (terms.objective() - self.J).abs() <= 5e-12);
        check("union bits", seen.coverage.union_sha256() == self.union_bits_sha256);
        check("counts", Self::counts_sha256(seen) == self.counts_sha256);
        wrong
    }
}

fn the_definition_matches_the_released_program() {
    let mut wrong = Vec::new();
    for case in Reference::all() {
        let simulator = Simulator::new(&case.experiment()).unwrap();
        let seen = simulator.coverage_by_definition(&case.sensors()).unwrap();
        wrong.extend(case.differences(&simulator, &seen));
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
