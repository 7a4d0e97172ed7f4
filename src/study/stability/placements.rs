//! Walks to be placed in scenes that repeat, have no ends, are others, or have changed.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::recordings::{Recording, walk};
use super::{Case, Measured};
use crate::base::geometry::Pose;
use crate::base::rng::Rng;
use crate::study::StudyError;
use crate::verify::align::{Alignment, Answer, Target, place, walk_returns};
use crate::world::scene::{BoxScene, Mesh, Scene};
use crate::world::trajectory::Trajectory;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "square room",
        about: "a walk to be placed in an empty square room: four placements fit",
        measure: square_room,
    },
    Case {
        name: "long corridor",
        about: "a walk in a corridor with its ends out of view",
        measure: corridor,
    },
    Case {
        name: "other building",
        about: "a walk to be placed in a building of other rooms",
        measure: other_building,
    },
    Case {
        name: "surface missing",
        about: "0 to 40 % of the surface that was recorded is not in the scene",
        measure: surface_missing,
    },
    Case {
        name: "furniture moved",
        about: "all furniture stands up to 1 m elsewhere",
        measure: furniture_moved,
    },
];

const ROOM_M: [[f64; 3]; 2] = [[-6.0, -4.0, 0.0], [6.0, 4.0, 3.0]];
/// Pieces of furniture in the room.
const PIECES: usize = 12;
/// A placement in the right place is this good with 2 cm of range noise, mm.
const MOST_OFF_MM: f64 = 5.0;

fn boxes(boxes_m: &[[DVec3; 2]]) -> Result<Scene, StudyError> {
    Ok(Scene::Mesh(Arc::new(Mesh::of_boxes(boxes_m).map_err(StudyError::of)?)))
}

/// Furniture along the walls, clear of the walk.
fn furniture(rng: &mut Rng) -> Vec<[DVec3; 2]> {
    let piece = |number: usize| {
        let along_m = rng.between(-5.0, 5.0);
        let side = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
        let middle_m = DVec3::new(along_m, side * rng.between(2.4, 3.5), 0.0);
        let half_m = DVec3::new(rng.between(0.2, 0.8), rng.between(0.15, 0.4), 0.0);
        [middle_m - half_m, middle_m + half_m + rng.between(0.5, 2.0) * DVec3::Z]
    };
    (0..PIECES).map(piece).collect()
}

fn furnished(pieces: &[[DVec3; 2]]) -> Result<Scene, StudyError> {
    boxes(&[&[ROOM_M.map(DVec3::from)], pieces].concat())
}

/// Where a walk that was recorded in one scene is placed in another, and how far that is from the truth, mm.
fn placed(recorded_in: &Scene, scene: &Scene, truth: &Trajectory) -> Result<(Alignment, f64), StudyError> {
    let recording = Recording::healthy(recorded_in, truth)?;
    let sampled = recording.replayed();
    let tilt = DQuat::from_scaled_axis(DVec3::new(0.04, -0.03, 0.0));
    let own_from_scene = Pose::new(DQuat::from_rotation_z(2.2) * tilt, DVec3::new(31.0, -12.0, 4.0));
    let poses = truth.stamped().map(|(time_ns, pose)| (time_ns, own_from_scene * pose));
    let own = Trajectory::new(poses.collect()).map_err(StudyError::of)?;
    let returns = walk_returns(&sampled.sampled, &sampled.sensors, &own);
    let first = |walk: &Trajectory| walk.stamped().next().map_or(Pose::IDENTITY, |(_, pose)| pose);
    let (start, begin) = (first(&own), first(truth));
    let found = place(&returns, &start, &Target::of(scene), None).map_err(StudyError::of)?;
    let off_m = found.best.as_ref().map_or(f64::INFINITY, |best| {
        (best.scene_from_walk * start).translation_m.distance(begin.translation_m)
    });
    Ok((found, 1e3 * off_m))
}

/// A case in which no placement may be called sure.
fn unsure(found: &Alignment, wanted: Answer, happens: String) -> Measured {
    let wrong = f64::from(u8::from(found.answer != wanted));
    Measured::judge(
        wrong,
        "placements called sure, or refused for another reason",
        0.0,
        "a guess must not pass for a placement",
    )
    .happens(happens)
    .says((found.answer != Answer::Placed).then(|| found.words()))
}

fn square_room(_quick: bool) -> Result<Measured, StudyError> {
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -4.0, 0.0), DVec3::new(4.0, 4.0, 3.0)));
    let (found, _) = placed(&scene, &scene, &walk()?)?;
    let happens = format!("{} placements fit equally well", found.placements.len());
    Ok(unsure(&found, Answer::Ambiguous, happens))
}

fn corridor(_quick: bool) -> Result<Measured, StudyError> {
    let mut corridor = BoxScene::closed(DVec3::new(-40.0, -1.2, 0.0), DVec3::new(40.0, 1.2, 2.8));
    corridor.faces[0] = [false; 2];
    let scene = Scene::Box(corridor);
    let (found, _) = placed(&scene, &scene, &super::recordings::straight())?;
    let along =
        found.slides_along.map_or("nothing holds".into(), |[x, y, z]| format!("({x:.2}, {y:.2}, {z:.2})"));
    Ok(unsure(&found, Answer::Slides, format!("the walk slides along {along}")))
}

fn other_building(_quick: bool) -> Result<Measured, StudyError> {
    let recorded_in = furnished(&furniture(&mut Rng::new(3, 0)))?;
    let other = [
        [DVec3::ZERO, DVec3::new(14.0, 6.5, 3.4)],
        [DVec3::new(5.0, 0.0, 0.0), DVec3::new(5.2, 4.5, 3.4)],
        [DVec3::new(9.0, 2.0, 0.0), DVec3::new(9.2, 6.5, 3.4)],
    ];
    let (found, _) = placed(&recorded_in, &boxes(&other)?, &walk()?)?;
    let share = found.best.as_ref().map_or(0.0, |best| best.inlier_share);
    Ok(unsure(
        &found,
        Answer::NotFound,
        format!("the best placement fits {:.0} % of the returns", 100.0 * share),
    ))
}

fn surface_missing(quick: bool) -> Result<Measured, StudyError> {
    let pieces = furniture(&mut Rng::new(4, 0));
    let recorded_in = furnished(&pieces)?;
    let left_out: &[usize] = if quick { &[0, 6] } else { &[0, 3, 6, 9, 12] };
    let (mut offs, mut shares, mut words) = (Vec::new(), Vec::new(), None);
    for count in left_out {
        let (found, off_mm) = placed(&recorded_in, &furnished(&pieces[*count..])?, &walk()?)?;
        offs.push([100.0 * *count as f64 / PIECES as f64, off_mm]);
        shares.push(found.best.as_ref().map_or(0.0, |best| best.inlier_share));
        words = Some(found.words());
    }
    let worst_mm = offs.iter().map(|[_, off_mm]| *off_mm).fold(0.0, f64::max);
    let least = shares.iter().copied().fold(1.0, f64::min);
    Ok(Measured::judge(
        worst_mm,
        "mm off with furniture missing",
        MOST_OFF_MM,
        "what is there still determines the place",
    )
    .happens(format!("down to {:.0} % of the returns fit", 100.0 * least))
    .says(words)
    .line("furniture missing, %", "off, mm", offs))
}

fn furniture_moved(quick: bool) -> Result<Measured, StudyError> {
    let draws: u64 = if quick { 1 } else { 3 };
    let (mut worst_mm, mut least, mut words) = (0.0_f64, 1.0_f64, None);
    for draw in 0..draws {
        let mut rng = Rng::new(10 + draw, 0);
        let pieces = furniture(&mut rng);
        let moved: Vec<[DVec3; 2]> = pieces
            .iter()
            .map(|piece| {
                let by_m = DVec3::new(rng.between(-1.0, 1.0), rng.between(-0.3, 0.3), 0.0);
                piece.map(|corner_m| corner_m + by_m)
            })
            .collect();
        let (found, off_mm) = placed(&furnished(&pieces)?, &furnished(&moved)?, &walk()?)?;
        worst_mm = worst_mm.max(off_mm);
        least = least.min(found.best.as_ref().map_or(0.0, |best| best.inlier_share));
        words = Some(found.words());
    }
    Ok(Measured::judge(
        worst_mm,
        "mm off with all furniture moved",
        MOST_OFF_MM,
        "walls, floor and ceiling determine the place",
    )
    .happens(format!("{:.0} % of the returns fit at least", 100.0 * least))
    .says(words))
}
