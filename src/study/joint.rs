//! Path and mount searched together in a real scene.
//!
//! A walk of a few corners at body height through a mesh, a mirrored pair on it; what counts is how many voxels of the
//! scene's surface are hit. Searched in turn (first the walk with the mount of a level pair, then the mount on that walk) and
//! both at once, with as many evaluations in all.

use std::sync::atomic::AtomicBool;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::mesh_site::MeshSite;
use super::rows::{Row, chosen, numbers, row_of};
use super::{Claim, Findings, Size, Spread, Study, StudyError, Table, Verdict};
use crate::design::optimize::{Kind, Measured, Search, Settings, Space, Variable};
use crate::report::chart;
use crate::rig::Mount;
use crate::simulate::view::View as _;
use crate::world::trajectory::Trajectory;

const CORNERS: usize = 4;
const LONGEST_M: f64 = 12.0;
const HEIGHT_M: f64 = 1.6;
/// The body keeps this far from surfaces.
const CLEARANCE_M: f64 = 0.35;
const SPEED_M_S: f64 = 1.2;
const TURN_RAD_S: f64 = 1.5;
const COLUMNS: u32 = 90;
const SCANS_PER_S: f64 = 2.0;
/// The last has the fewest rays: a quick study takes it alone.
const SENSORS: [&str; 2] = ["os1-64", "vlp-16"];
const EVALUATIONS: usize = 400;
const QUICK_EVALUATIONS: usize = 16;
/// Directions in which a corner looks for walls around it.
const FEELERS: usize = 8;
/// Mount of the walk that is searched alone: a level pair, x 0.1 m.
const LEVEL: [f64; 4] = [0.1, 0.0, 0.0, 0.0];
const MOUNT_BOUNDS: [(&str, f64, f64); 4] =
    [("x_m", 0.0, 0.15), ("y_m", -0.25, 0.25), ("z_m", -0.15, 0.15), ("pitch_deg", -90.0, 90.0)];

/// See the module.
#[derive(Debug)]
pub struct Joint;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Task {
    part: String,
    scene: std::path::PathBuf,
    sensor: String,
    evaluations: usize,
    seed: u64,
}

impl Study for Joint {
    fn name(&self) -> &'static str {
        "joint"
    }

    fn about(&self) -> &'static str {
        "Is a mount searched together with the walk better than a walk searched first and a mount after it?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let scene = size.scene.as_ref();
        let scene =
            scene.ok_or_else(|| StudyError("which scene? Give --scene MESH (a house, in metres)".into()))?;
        let mut tasks = Vec::new();
        for sensor in SENSORS.into_iter().skip(usize::from(size.quick)) {
            for part in ["in turn", "together"] {
                for seed in 1..=size.seeds {
                    let evaluations = if size.quick { QUICK_EVALUATIONS } else { EVALUATIONS };
                    let task = Task {
                        part: part.into(),
                        scene: scene.clone(),
                        sensor: sensor.into(),
                        evaluations,
                        seed,
                    };
                    tasks.push(Value::Object(row_of(&task)));
                }
            }
        }
        Ok(tasks)
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let task: Task = serde_json::from_value(task.clone()).map_err(StudyError::of)?;
        let place = Site(MeshSite::new(&task.scene, &task.sensor)?);
        let (walk, mount) = (place.walk_variables(), mount_variables());
        let level = LEVEL.to_vec();
        let found = if task.part == "together" {
            search(&task, 0, task.evaluations, [walk, mount].concat(), |values| {
                let (walk, mount) = values.split_at(2 * CORNERS);
                place.measure(walk, mount)
            })?
        } else {
            let half = task.evaluations / 2;
            let walk = search(&task, 0, half, walk, |values| place.measure(values, &level))?;
            let mount =
                search(&task, 1, task.evaluations - half, mount, |values| place.measure(&walk, values))?;
            [walk, mount].concat()
        };
        let (walk, mount) = found.split_at(2 * CORNERS);
        let (best, of_level) = (place.measure(walk, mount)?, place.measure(walk, &level)?);
        let mut row = row_of(&task);
        row.insert("voxels".into(), json!(best.score));
        row.insert("violation_m".into(), json!(best.violation));
        row.insert("voxels_level_mount_same_walk".into(), json!(of_level.score));
        row.insert("length_m".into(), json!(length_m(&place.corners_m(walk))));
        row.insert("walk_m".into(), json!(walk));
        row.insert("mount".into(), json!(mount));
        Ok(vec![row])
    }

    fn takes_a_scene(&self) -> bool {
        true
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut table = Table::new(
            "joint",
            "Voxels seen by a mirrored pair on a walk of at most 12 m",
            "Median and range over the seeds; walks that break the length or the distance from walls (violation above 0 m) count for no claim.",
            &["sensor", "search", "voxels", "same walk, level mount", "length m", "pitch", "violation m"],
        );
        let mut claims = Vec::new();
        for sensor in SENSORS {
            let of = |part: &str| chosen(rows, &[("sensor", sensor), ("part", part)]);
            if of("together").is_empty() {
                continue;
            }
            for part in ["in turn", "together"] {
                let here = of(part);
                let words = |field: &str, decimals| {
                    Spread::of(&numbers(&here, field)).map_or("none".into(), |s| s.words(decimals))
                };
                let pitches: Vec<f64> =
                    here.iter().filter_map(|row| row.get("mount")?.get(3)?.as_f64()).map(f64::abs).collect();
                table.rows.push(vec![
                    sensor.into(),
                    part.into(),
                    words("voxels", 0),
                    words("voxels_level_mount_same_walk", 0),
                    words("length_m", 1),
                    Spread::of(&pitches).map_or("none".into(), |s| s.words(1)),
                    words("violation_m", 2),
                ]);
            }
            let allowed = |part: &str| -> Vec<&Row> {
                let is_allowed = |row: &&Row| row.get("violation_m").and_then(Value::as_f64) == Some(0.0);
                of(part).into_iter().filter(is_allowed).collect()
            };
            let spreads = ["in turn", "together"].map(|part| Spread::of(&numbers(&allowed(part), "voxels")));
            claims.push(match spreads {
                [Some(in_turn), Some(together)] => claim(sensor, &in_turn, &together),
                _ => Claim {
                    claim: claimed(sensor),
                    verdict: Verdict::CannotTell,
                    because: format!(
                        "{sensor}: one of the two searches found no walk that keeps its length and its distance from walls."
                    ),
                },
            });
        }
        let summary = claims.iter().map(|claim| claim.because.clone()).collect::<Vec<_>>().join(" ");
        Findings { summary, claims, tables: vec![table], ..Findings::default() }
    }
}

fn claimed(sensor: &str) -> String {
    format!("Walk and mount of {sensor} are better searched together")
}

fn claim(sensor: &str, in_turn: &Spread, together: &Spread) -> Claim {
    let n = |value: f64| chart::number(value, 0);
    let verdict = if together.interval[0] > in_turn.interval[1] {
        Verdict::Stands
    } else if together.interval[1] < in_turn.interval[0] {
        Verdict::DoesNotStand
    } else {
        Verdict::CannotTell
    };
    Claim {
        claim: claimed(sensor),
        verdict,
        because: format!(
            "{sensor}: together {} voxels [{}, {}], in turn {} [{}, {}] (medians over {} seeds, 95 % intervals).",
            n(together.median),
            n(together.interval[0]),
            n(together.interval[1]),
            n(in_turn.median),
            n(in_turn.interval[0]),
            n(in_turn.interval[1]),
            together.count
        ),
    }
}

fn variable(name: String, low: f64, high: f64, role: usize) -> Variable {
    Variable { name, low, high, integer: false, active_from: None, role }
}

fn mount_variables() -> Vec<Variable> {
    let one = |(role, (name, low, high)): (usize, &(&str, f64, f64))| {
        variable((*name).into(), *low, *high, 2 + role)
    };
    MOUNT_BOUNDS.iter().enumerate().map(one).collect()
}

fn search(
    task: &Task,
    leg: u64,
    evaluations: usize,
    variables: Vec<Variable>,
    measure: impl Fn(&[f64]) -> Result<Measured, StudyError> + Sync,
) -> Result<Vec<f64>, StudyError> {
    let space = Space::new(variables).map_err(StudyError::of)?;
    let settings = Settings::new(2 * task.seed + leg, evaluations);
    let mut search = Search::new(space, Kind::Staged, settings);
    search.run(evaluations, measure, |_| (), &AtomicBool::new(false)).map_err(StudyError::of)?;
    let best = search.best().ok_or_else(|| StudyError("a search without an evaluation".into()))?;
    Ok(best.candidate.values.clone())
}

struct Site(MeshSite);

impl Site {
    fn walk_variables(&self) -> Vec<Variable> {
        let [low_m, high_m] = self.0.scene.bounds_m();
        let corner = |corner: usize| {
            [
                variable(format!("corner {} x_m", corner + 1), low_m.x, high_m.x, 0),
                variable(format!("corner {} y_m", corner + 1), low_m.y, high_m.y, 1),
            ]
        };
        (0..CORNERS).flat_map(corner).collect()
    }

    fn corners_m(&self, walk: &[f64]) -> Vec<DVec3> {
        let height_m = self.0.scene.bounds_m()[0].z + HEIGHT_M;
        walk.chunks_exact(2).map(|at| DVec3::new(at[0], at[1], height_m)).collect()
    }

    /// Voxels hit; violation: how much too long the walk is and how far it leads through walls, or outside, m.
    fn measure(&self, walk: &[f64], mount: &[f64]) -> Result<Measured, StudyError> {
        let corners_m = self.corners_m(walk);
        let violation = (length_m(&corners_m) - LONGEST_M).max(0.0) + self.blocked_m(&corners_m);
        let walk = Trajectory::polyline(&corners_m, SPEED_M_S, TURN_RAD_S, 0);
        let Some(view) = walk.ok().and_then(|walk| self.0.view(walk, COLUMNS, SCANS_PER_S).ok()) else {
            // all corners in one place
            return Ok(Measured { score: 0.0, violation: violation + 1.0, rays: 0 });
        };
        let master = Mount {
            x_m: mount[0],
            y_m: mount[1],
            z_m: mount[2],
            pitch_rad: mount[3].to_radians(),
            ..Mount::default()
        };
        let seen = view.see(&[self.0.rig(&[master, master.mirrored()])]).swap_remove(0);
        Ok(Measured { score: seen.union, violation, rays: seen.rays })
    }

    /// How far the walk leads through or too close to surfaces, and how open the scene is around its corners, m.
    fn blocked_m(&self, corners_m: &[DVec3]) -> f64 {
        let mut blocked_m = 0.0;
        for pair in corners_m.windows(2) {
            let step = pair[1] - pair[0];
            let length_m = step.length();
            if length_m > 1e-6
                && let Some(hit) = self.0.scene.cast(pair[0], step / length_m)
            {
                blocked_m += (length_m + CLEARANCE_M - hit.distance_m).max(0.0);
            }
        }
        for corner_m in corners_m {
            for feeler in 0..FEELERS {
                let (sin, cos) = (std::f64::consts::TAU * feeler as f64 / FEELERS as f64).sin_cos();
                // nothing around: outside the building
                blocked_m += match self.0.scene.cast(*corner_m, DVec3::new(cos, sin, 0.0)) {
                    Some(hit) => (CLEARANCE_M - hit.distance_m).max(0.0),
                    None => 1.0,
                };
            }
            if self.0.scene.cast(*corner_m, DVec3::Z).is_none() {
                blocked_m += 1.0;
            }
        }
        blocked_m
    }
}

fn length_m(corners_m: &[DVec3]) -> f64 {
    corners_m.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}
