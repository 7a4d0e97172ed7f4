//! What the page needs before the first point: names, track, and what lies under the points.

use std::path::PathBuf;

use glam::DVec3;

use super::Args;
use crate::commands::output::quoted;
use crate::recording::playback::World;
use crate::report::viewer::{Ground, Heading};
use crate::world::scene::{LoadedScene, Scene};

/// Positions of the trajectory on the page.
const TRACK: usize = 1000;
/// Triangles of a scene; of a finer mesh the largest.
const TRIANGLES: usize = 300_000;

pub(super) fn ground(loaded: &LoadedScene, world: &World) -> Ground {
    let place_m = |local_m: DVec3| (loaded.origin.world(local_m) - world.origin_m).as_vec3().to_array();
    match &loaded.scene {
        Scene::Mesh(mesh) => {
            let places_m = mesh.largest_triangles(TRIANGLES).flatten().map(place_m).collect();
            Ground { is_surface: true, places_m }
        }
        Scene::Voxels(map) => Ground { is_surface: false, places_m: map.occupied_m().map(place_m).collect() },
        Scene::Box(_) => Ground { is_surface: true, places_m: Vec::new() },
    }
}

pub(super) fn heading(args: &Args, world: Option<&World>, source: Option<String>) -> Heading {
    let flag = |name: &str, path: &Option<PathBuf>| {
        path.as_ref().map_or(String::new(), |path| format!("{name} {}", quoted(&path.to_string_lossy())))
    };
    let mut heading = Heading {
        recording: args.recording.display().to_string(),
        recording_words: quoted(&args.recording.to_string_lossy()),
        source_words: typed(&["--meta", "--calibration", "--model"]),
        mount_words: flag("--mount", &args.mount),
        trajectory_words: flag("--trajectory", &args.trajectory),
        scene: args.scene.as_ref().map(|path| path.display().to_string()),
        ..Heading::default()
    };
    let Some(world) = world else { return heading };
    heading.trajectory = source;
    heading.origin_m = world.origin_m.to_array();
    let poses: Vec<_> = world.trajectory.stamped().collect();
    for (time_ns, pose) in poses.iter().step_by(poses.len().div_ceil(TRACK).max(1)) {
        let ahead = pose.rotate(DVec3::X);
        heading.track_m.push((pose.translation_m - world.origin_m).as_vec3().to_array());
        heading.track_time_s.push(*time_ns as f64 * 1e-9);
        heading.track_heading_rad.push(ahead.y.atan2(ahead.x) as f32);
    }
    heading
}

/// Flags of this run with their values, as they were typed.
fn typed(flags: &[&str]) -> String {
    let mut words = Vec::new();
    let mut arguments = std::env::args();
    while let Some(argument) = arguments.next() {
        let name = argument.split('=').next().unwrap_or_default();
        if !flags.contains(&name) {
            continue;
        }
        words.push(quoted(&argument));
        if name == argument {
            words.extend(arguments.next().map(|value| quoted(&value)));
        }
    }
    words.join(" ")
}
