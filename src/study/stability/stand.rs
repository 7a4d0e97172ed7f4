//! Scenes that leave a direction open: what the scans determine, and what the mount check reports there.

use glam::DVec3;

use super::recordings::{Recording, room, straight, walk};
use super::{Case, Measured};
use crate::design::registration::{Information, RegistrationQuality};
use crate::rig::{Mount, MountedSensor, Rig};
use crate::simulate::scan::{Scanner, Spin};
use crate::study::StudyError;
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::Trajectory;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "level VLP-16 in a room",
        about: "one level sensor with beams that never meet floor or ceiling",
        measure: level_in_a_room,
    },
    Case {
        name: "open field",
        about: "nothing within range, one sensor pitched 1 degree above nominal",
        measure: |_| mount_check(nowhere(), &walk()?, 0),
    },
    Case {
        name: "floor only",
        about: "a floor without walls, one sensor pitched 1 degree above nominal",
        measure: |_| mount_check(floor(), &walk()?, 1),
    },
    Case {
        name: "corridor",
        about: "two walls, floor and ceiling without an end, gone straight, one sensor pitched 1 degree above nominal",
        measure: |_| mount_check(corridor(), &straight(), 1),
    },
    Case {
        name: "closed room",
        about: "the same error where everything is observable",
        measure: |_| mount_check(room(), &walk()?, 1),
    },
];

fn level_in_a_room(_quick: bool) -> Result<Measured, StudyError> {
    // 5 m by 6 m by 3 m: beams of +-15 degrees end on the walls
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-2.5, -3.0, 0.0), DVec3::new(2.5, 3.0, 3.0)));
    let here = DVec3::new(0.0, 0.0, 1.5);
    let trajectory = Trajectory::straight(here, here + 1e-9 * DVec3::X, 1e-8, 0);
    let least = |pitches_deg: &[f64]| -> Result<(f64, String), StudyError> {
        let model = sensors::catalogue::nominal("vlp-16").map_err(StudyError::of)?;
        let mounted = |pitch_deg: &f64| MountedSensor {
            name: String::new(),
            model: model.clone(),
            mount: Mount { pitch_rad: pitch_deg.to_radians(), ..Mount::default() },
        };
        let rig = Rig { sensors: pitches_deg.iter().map(mounted).collect() };
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, Spin { columns: 512, ..Spin::default() });
        scanner.occluders.iter_mut().for_each(Vec::clear);
        let mut information = Information::default();
        scanner.for_each_column(|_, column| {
            column.returns.iter().for_each(|back| information.add(back.point_m - here, back.normal));
        });
        let quality = RegistrationQuality::of_scans(&[information.clone()]);
        let least = information.conditioning().map_or(0.0, |conditioning| conditioning.translation.least());
        Ok((least, quality.map_or(String::new(), |quality| quality.words())))
    };
    let ((level, says), (tilted, _)) = (least(&[0.0])?, least(&[38.0, -38.0])?);
    Ok(Measured::judge(
        (crate::design::registration::DEGENERATE - level).max(0.0),
        "short of the least eigenvalue that ties a scan down",
        0.0,
        "below 0.003 a registration drifts along the weakest direction",
    )
    .happens(format!("least eigenvalue {level:.4} level, {tilted:.3} for a pair at ±38 degrees"))
    .says(Some(says).filter(|says| !says.is_empty())))
}

fn nowhere() -> Scene {
    Scene::Box(BoxScene::closed(DVec3::new(-2000.0, -2000.0, -2000.0), DVec3::splat(2000.0)))
}

fn open_box(faces: [[bool; 2]; 3]) -> Scene {
    let mut walls = BoxScene::closed(DVec3::new(-500.0, -1.5, 0.0), DVec3::new(500.0, 1.5, 3.0));
    walls.faces = faces;
    Scene::Box(walls)
}

fn floor() -> Scene {
    let mut ground = BoxScene::closed(DVec3::new(-500.0, -500.0, 0.0), DVec3::new(500.0, 500.0, 50.0));
    ground.faces = [[false; 2], [false; 2], [true, false]];
    Scene::Box(ground)
}

fn corridor() -> Scene {
    open_box([[false; 2], [true; 2], [true; 2]])
}

/// A sensor 1 degree off. `tells` is how much of that should be found: where it is 0 there is nothing to find it by.
fn mount_check(scene: Scene, walk: &Trajectory, tells: u8) -> Result<Measured, StudyError> {
    let mut recording = Recording::healthy(&scene, walk)?;
    recording.tilt_error_deg = 1.0;
    let (replayed, check) = recording.checked();
    let sensor = &check.mount[0];
    let found_deg = sensor.tilt_error_deg;
    let wrong_deg = found_deg.map_or(0.0, |found| (found - 1.0).abs());
    let silent = f64::from(u8::from(found_deg.is_none()) * tells);
    let agree = replayed.rays[0].agree_share().map_or("no ray has a prediction".into(), |share| {
        format!("{:.1} % of the rays agree", 100.0 * share)
    });
    Ok(Measured::judge(
        wrong_deg.max(silent),
        "degrees between the estimate and the truth (0 without an estimate)",
        sensor.u95_deg.unwrap_or(0.0).max(0.02),
        "its own 95 % interval, or 0.02 degrees",
    )
    .happens(match found_deg {
        Some(found) => {
            format!("{found:.3} degrees ± {:.3} are found; {agree}", sensor.u95_deg.unwrap_or(f64::NAN))
        }
        None => format!("no angle is given; {agree}"),
    })
    .says(Some(sensor.cannot_tell.clone().unwrap_or_else(|| {
        format!(
            "{} is tilted {:.2} degrees; observable: {}",
            sensor.sensor,
            found_deg.unwrap_or(f64::NAN),
            sensor.observable.join(" ")
        )
    }))))
}
