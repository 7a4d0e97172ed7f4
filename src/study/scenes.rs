//! The best pair of mounts in each of many scenes and walks, and how well one scene's mount serves another.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::mesh_site::{MeshSite, VOXEL_M};
use super::rows::{FAILED, Row, chosen, row_of, text};
use super::walks::Walk;
use super::{Claim, Figure, Findings, Size, Study, StudyError, Table, Verdict};
use crate::base::statistics::index_of_max;
use crate::report::chart::{self, LineChart, Series};
use crate::rig::{Mount, Rig};
use crate::simulate::view::{CastView, View as _};

const SENSORS: [&str; 2] = ["os1-64", "vlp-16"];
const COLUMNS: u32 = 180;
const SCANS_PER_S: f64 = 2.5;
/// Half the distance between the two sensors of a pair, m.
const HALF_DISTANCE_M: f64 = 0.1;
/// Pitches that see less than the best by this share are as good: what a rig built to 1 degree differs by.
const ALIKE: f64 = 0.005;

/// See the module.
#[derive(Debug)]
pub struct Scenes;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Task {
    scene: PathBuf,
    walk: Walk,
    sensor: String,
    quick: bool,
}

impl Study for Scenes {
    fn name(&self) -> &'static str {
        "scenes"
    }

    fn about(&self) -> &'static str {
        "Which pair of mounts is best in which scene, and how well does one scene's serve another?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let path = size.scene.as_deref();
        let path = path.ok_or_else(|| StudyError("which scenes? Give --scene FOLDER of meshes".into()))?;
        let mut tasks = Vec::new();
        for scene in meshes(path)? {
            for walk in Walk::ALL.into_iter().take(if size.quick { 2 } else { 4 }) {
                for sensor in SENSORS {
                    let (scene, sensor) = (scene.clone(), sensor.into());
                    tasks.push(Value::Object(row_of(&Task { scene, walk, sensor, quick: size.quick })));
                }
            }
        }
        Ok(tasks)
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let task: Task = serde_json::from_value(task.clone()).map_err(StudyError::of)?;
        let (site, view) = match viewed(&task) {
            Ok(viewed) => viewed,
            // one bad file of a folder does not keep the others from being studied
            Err(StudyError(reason)) => {
                let mut row = row_of(&task);
                row.insert(FAILED.into(), json!(reason));
                return Ok(vec![row]);
            }
        };
        let voxels = |rigs: Vec<Rig>| -> Vec<u64> {
            view.see(&rigs).into_iter().map(|seen| seen.union as u64).collect()
        };
        let at =
            |x_m: f64, pitch_deg: f64| Mount { x_m, pitch_rad: pitch_deg.to_radians(), ..Mount::default() };
        let pitches: Vec<f64> = (0..=75).step_by(if task.quick { 15 } else { 3 }).map(f64::from).collect();
        let pair = |pitch: &f64| site.rig(&[at(-HALF_DISTANCE_M, -pitch), at(HALF_DISTANCE_M, *pitch)]);
        let pairs = voxels(pitches.iter().map(pair).collect());
        let single = voxels(pitches.iter().map(|pitch| site.rig(&[at(0.0, *pitch)])).collect());
        let mut row = row_of(&task);
        let name = task.scene.file_stem().map(|name| name.to_string_lossy().into_owned());
        row.insert("scene".into(), json!(name));
        row.insert("length_m".into(), json!((view.site().trajectory.length_m() * 10.0).round() / 10.0));
        row.insert("pitches_deg".into(), json!(pitches));
        row.insert("pair_voxels".into(), json!(pairs));
        row.insert("single_voxels".into(), json!(single));
        Ok(vec![row])
    }

    fn rests_on_seeds(&self) -> bool {
        false
    }

    fn takes_a_scene(&self) -> bool {
        true
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut findings = Findings::default();
        let mut advice = Vec::new();
        for sensor in SENSORS {
            let places: Vec<Place> =
                chosen(rows, &[("sensor", sensor)]).into_iter().filter_map(Place::of).collect();
            if places.is_empty() {
                continue;
            }
            findings.tables.push(best_table(sensor, &places));
            findings.tables.push(served_table(sensor, &places));
            findings.figures.push(shares_figure(sensor, &places));
            let (words, claim) = recommend(sensor, &places);
            advice.push(words);
            findings.claims.push(claim);
        }
        for row in rows.iter().filter(|row| row.contains_key(FAILED)) {
            let reason = text(row, FAILED);
            if !findings.failed.iter().any(|reported| reported == reason) {
                findings.failed.push(reason.to_owned());
            }
        }
        if !findings.failed.is_empty() {
            let mut table =
                Table::new(FAILED, "Left out", "Scenes and walks that could not be studied.", &["why"]);
            table.rows.extend(findings.failed.iter().map(|reason| vec![reason.clone()]));
            findings.tables.push(table);
            advice.push(format!("{} left out: see the end.", findings.failed.len()));
        }
        findings.summary = advice.join(" ");
        findings
    }
}

/// A task's scene and the view along the walk through it.
fn viewed(task: &Task) -> Result<(MeshSite, CastView), StudyError> {
    let site = MeshSite::new(&task.scene, &task.sensor)?;
    let walk = task.walk.through(&site.scene).map_err(|error| StudyError::at(&task.scene, error))?;
    let (columns, rate_hz) = if task.quick { (60, 1.0) } else { (COLUMNS, SCANS_PER_S) };
    let view = site.view(walk, columns, rate_hz).map_err(|error| StudyError::at(&task.scene, error))?;
    Ok((site, view))
}

/// The meshes of a folder, or the one that is named.
fn meshes(path: &Path) -> Result<Vec<PathBuf>, StudyError> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let unreadable = |error| StudyError(format!("{}: {error}", path.display()));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        let ending = file.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        if matches!(ending.as_deref(), Some("ply" | "obj" | "stl" | "gltf" | "glb")) {
            found.push(file);
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(StudyError(format!("{}: holds no mesh (.ply, .obj, .stl, .gltf, .glb)", path.display())));
    }
    Ok(found)
}

/// A scene with a walk, and what pairs and single sensors see there.
struct Place {
    name: String,
    pitches_deg: Vec<f64>,
    pair: Vec<f64>,
    single: Vec<f64>,
}

impl Place {
    fn of(row: &Row) -> Option<Self> {
        let numbers = |field: &str| -> Option<Vec<f64>> {
            row.get(field)?.as_array()?.iter().map(Value::as_f64).collect()
        };
        Some(Self {
            name: format!("{}, {}", text(row, "scene"), text(row, "walk").replace('_', "-")),
            pitches_deg: numbers("pitches_deg")?,
            pair: numbers("pair_voxels")?,
            single: numbers("single_voxels")?,
        })
    }

    fn best(&self) -> usize {
        index_of_max(&self.pair)
    }

    /// Share of this place's best that a pitch sees.
    fn share(&self, pitch: usize) -> f64 {
        self.pair[pitch] / self.pair[self.best()]
    }

    /// Pitches that are as good as the best, degrees.
    fn alike_deg(&self) -> [f64; 2] {
        let alike = (0..self.pair.len()).filter(|pitch| self.share(*pitch) >= 1.0 - ALIKE);
        let alike: Vec<f64> = alike.map(|pitch| self.pitches_deg[pitch]).collect();
        [alike.first(), alike.last()].map(|end| end.copied().unwrap_or(f64::NAN))
    }
}

fn percent(share: f64) -> String {
    format!("{:+.1} %", 100.0 * share)
}

fn best_table(sensor: &str, places: &[Place]) -> Table {
    let mut table = Table::new(
        &format!("best-{sensor}"),
        &format!("Best mirrored pair of {sensor}"),
        &format!(
            "Voxels of {VOXEL_M} m of the scene's surface that are hit. As good: pitches within {} % of the best. Gains of the \
             pair over one level sensor and over one sensor at its own best pitch.",
            100.0 * ALIKE
        ),
        &[
            "scene, walk",
            "voxels",
            "pitch",
            "as good",
            "over a level sensor",
            "over the best single",
            "its pitch",
            "level pair",
        ],
    );
    for place in places {
        let (best, alone) = (place.best(), index_of_max(&place.single));
        let [low, high] = place.alike_deg();
        table.rows.push(vec![
            place.name.clone(),
            chart::number(place.pair[best], 0),
            chart::number(place.pitches_deg[best], 0),
            format!("{low:.0} to {high:.0}"),
            percent(place.pair[best] / place.single[0] - 1.0),
            percent(place.pair[best] / place.single[alone] - 1.0),
            chart::number(place.pitches_deg[alone], 0),
            percent(place.share(0) - 1.0),
        ]);
    }
    table
}

/// What the pair of one scene sees in another, as a share of that one's best; a scene's walks count together.
fn served_table(sensor: &str, places: &[Place]) -> Table {
    let scenes = scenes(places);
    let mut table = Table::new(
        &format!("served-{sensor}"),
        &format!("One scene's pair of {sensor} in another"),
        "Row: the pair's own scene. Column: where it is used; share of what that scene's own best pairs see, the mean over its walks.",
        &["pair of", "pitch"],
    );
    table.columns.extend(scenes.iter().map(|(name, _)| name.clone()));
    for (name, own) in &scenes {
        let pitch = fairest(own, mean_share);
        let mut cells = vec![name.clone(), chart::number(own[0].pitches_deg[pitch], 0)];
        cells.extend(scenes.iter().map(|(_, there)| format!("{:.1} %", 100.0 * mean_share(there, pitch))));
        table.rows.push(cells);
    }
    table
}

/// Places by scene, in their order.
fn scenes(places: &[Place]) -> Vec<(String, Vec<&Place>)> {
    let mut scenes: Vec<(String, Vec<&Place>)> = Vec::new();
    for place in places {
        let name = place.name.split(',').next().unwrap_or_default().to_owned();
        match scenes.last_mut() {
            Some((last, own)) if *last == name => own.push(place),
            _ => scenes.push((name, vec![place])),
        }
    }
    scenes
}

fn mean_share(places: &[&Place], pitch: usize) -> f64 {
    places.iter().map(|place| place.share(pitch)).sum::<f64>() / places.len() as f64
}

fn min_share(places: &[&Place], pitch: usize) -> f64 {
    places.iter().map(|place| place.share(pitch)).fold(f64::INFINITY, f64::min)
}

/// The pitch at which a figure over places is at its max.
fn fairest(places: &[&Place], figure: fn(&[&Place], usize) -> f64) -> usize {
    let count = places.first().map_or(0, |place| place.pair.len());
    index_of_max(&(0..count).map(|pitch| figure(places, pitch)).collect::<Vec<_>>())
}

fn shares_figure(sensor: &str, places: &[Place]) -> Figure {
    let scenes = scenes(places);
    let line = |(name, own): &(String, Vec<&Place>)| Series {
        name: name.clone(),
        points: own[0]
            .pitches_deg
            .iter()
            .enumerate()
            .map(|(pitch, deg)| [*deg, 100.0 * mean_share(own, pitch)])
            .collect(),
    };
    let chart = LineChart {
        title: format!("{sensor}: what a pair sees of the best pair's"),
        x_label: "pitch, degrees".into(),
        y_label: "share of the scene's best, %".into(),
        series: scenes.iter().map(line).collect(),
        ..LineChart::default()
    };
    Figure {
        svg: chart.svg(),
        caption: format!(
            "What a mirrored pair of {sensor} sees over its pitch, as a share of the scene's best pair."
        ),
    }
}

/// The pitch with the best worst place, with those that are as good.
fn recommend(sensor: &str, places: &[Place]) -> (String, Claim) {
    let all: Vec<&Place> = places.iter().collect();
    let pitch = fairest(&all, min_share);
    let least = min_share(&all, pitch);
    let alike: Vec<f64> = (0..all[0].pair.len())
        .filter(|other| min_share(&all, *other) >= least - ALIKE)
        .map(|other| all[0].pitches_deg[other])
        .collect();
    let (low, high) = (alike.first().copied().unwrap_or(0.0), alike.last().copied().unwrap_or(0.0));
    let gains: Vec<f64> =
        all.iter().map(|place| place.pair[pitch] / place.single[index_of_max(&place.single)] - 1.0).collect();
    let [min_gain, max_gain] = [
        gains.iter().copied().fold(f64::INFINITY, f64::min),
        gains.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ];
    let words = format!(
        "{sensor}: a pair at ±{:.0} degrees ({low:.0} to {high:.0} are as good) sees at least {:.1} % of every scene's best, and \
         {} to {} more than the best single sensor.",
        all[0].pitches_deg[pitch],
        100.0 * least,
        percent(min_gain),
        percent(max_gain)
    );
    let everywhere = least >= 0.95;
    let claim = Claim {
        claim: format!("One pitch of a pair of {sensor} serves every scene within 5 % of its best"),
        verdict: if everywhere { Verdict::Stands } else { Verdict::DoesNotStand },
        because: format!("the worst place is left with {:.1} % over {} places", 100.0 * least, all.len()),
    };
    (words, claim)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room as a mesh.
    fn room(x_m: f64, y_m: f64, z_m: f64) -> String {
        let mut text = String::new();
        for corner in 0..8 {
            let side = |bit: i32, half: f64| if corner >> bit & 1 == 1 { half } else { -half };
            text += &format!(
                "v {} {} {}\n",
                side(0, x_m / 2.0),
                side(1, y_m / 2.0),
                if corner >> 2 & 1 == 1 { z_m } else { 0.0 }
            );
        }
        for face in [[1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7], [1, 3, 7, 5], [2, 6, 8, 4]] {
            text += &format!("f {} {} {} {}\n", face[0], face[1], face[2], face[3]);
        }
        text
    }

    #[test]
    fn every_scene_of_a_folder_is_walked_and_judged() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("low.obj"), room(8.0, 6.0, 2.5)).unwrap();
        std::fs::write(folder.path().join("tall.obj"), room(8.0, 6.0, 12.0)).unwrap();
        std::fs::write(folder.path().join("notes.txt"), "").unwrap();
        std::fs::write(folder.path().join("empty.ply"), "").unwrap();
        let size = Size { seeds: 1, quick: true, scene: Some(folder.path().into()), ..Size::default() };
        let tasks = Scenes.tasks(&size).unwrap();
        assert_eq!(tasks.len(), 3 * 2 * 2);
        let rows: Vec<Row> = tasks.iter().flat_map(|task| Scenes.run(task).unwrap()).collect();
        let findings = Scenes.findings(&rows);
        assert_eq!(findings.tables.len(), 5);
        assert!(
            findings.failed.len() == 1 && findings.failed[0].contains("empty.ply"),
            "{:?}",
            findings.failed
        );
        let [best, served] = &findings.tables[..2] else { panic!() };
        assert_eq!((best.rows.len(), served.rows.len()), (4, 2));
        assert_eq!(served.rows[0][2], "100.0 %", "{served:?}");
        // who walks under a high ceiling must look up
        let pitch = |row: usize| best.rows[row][2].parse::<f64>().unwrap();
        assert!(pitch(2) > pitch(0), "{best:?}");
        assert!(
            findings.summary.contains("os1-64: a pair at") && findings.summary.contains("vlp-16: a pair")
        );
        let error = Scenes.tasks(&Size { scene: None, ..size }).unwrap_err();
        assert!(error.to_string().contains("--scene FOLDER"));
    }
}
