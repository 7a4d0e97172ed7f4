//! What an alignment comes to, as data and in words.

use glam::{DMat3, DQuat, DVec3, EulerRot};
use nalgebra::Matrix3;
use serde::Serialize;

use super::rays::Refined;
use crate::base::geometry::Pose;

/// Where a walk lies in a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Alignment {
    /// How sure it is.
    pub answer: Answer,
    /// The best placement; null where none was found.
    #[serde(flatten)]
    pub best: Option<Placement>,
    /// Of the best placement.
    pub sd: Option<Deviation>,
    /// The one that fits best of all others.
    pub second_best: Option<SecondBest>,
    /// All placements that fit as well as the best, this first.
    pub placements: Vec<Placement>,
    /// Along which the walk slides: a unit vector in the scene.
    pub slides_along: Option<[f64; 3]>,
    /// A stretch of the walk that does not fit while the rest does.
    pub misfit: Option<Misfit>,
}

/// How sure a placement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// One placement fits, and no other.
    Placed,
    /// Several fit equally well.
    Ambiguous,
    /// It fits all along a direction.
    Slides,
    /// None fits: another building, or one that changed too much.
    NotFound,
}

/// One placement: scene from trajectory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Placement {
    /// Where the trajectory's origin lies in the scene, m.
    pub translation_m: [f64; 3],
    /// About z, the first of three turns about the axes turned so far.
    pub yaw_deg: f64,
    /// About y.
    pub pitch_deg: f64,
    /// About x.
    pub roll_deg: f64,
    /// Share of the returns that end at the scene's first surface on their ray.
    pub inlier_share: f64,
    /// The same as one transform.
    #[serde(skip)]
    pub scene_from_walk: Pose,
}

/// Standard deviations, from the scatter between stretches of the walk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Deviation {
    /// Along the axes of the scene, m.
    pub translation_m: [f64; 3],
    /// About the vertical.
    pub yaw_deg: f64,
    /// About the level axis across the trajectory's x axis.
    pub pitch_deg: f64,
    /// About the level axis along it.
    pub roll_deg: f64,
}

/// The next best placement, return by return.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SecondBest {
    /// Where it lies.
    #[serde(flatten)]
    pub placement: Placement,
    /// Share of the returns that fit the best placement alone.
    pub only_best: f64,
    /// Share of those that fit this one alone.
    pub only_second: f64,
    /// Their difference over its standard deviation, from blocks of the walk.
    pub z: f64,
}

/// A stretch of the walk, from its begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Misfit {
    /// Begin, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Share of its returns that fit.
    pub inlier_share: f64,
}

impl Placement {
    pub(super) fn of(scene_from_walk: Pose, inlier_share: f64) -> Self {
        let (yaw, pitch, roll) = scene_from_walk.rotation.to_euler(EulerRot::ZYX);
        Self {
            translation_m: scene_from_walk.translation_m.to_array(),
            yaw_deg: yaw.to_degrees(),
            pitch_deg: pitch.to_degrees(),
            roll_deg: roll.to_degrees(),
            inlier_share,
            scene_from_walk,
        }
    }

    fn words(&self) -> String {
        let [x, y, z] = self.translation_m;
        format!("({x:.2}, {y:.2}, {z:.2}) m, yaw {:.1}°", self.yaw_deg)
    }
}

impl Deviation {
    pub(super) fn of(refined: &Refined) -> Self {
        let covariance = &refined.covariance;
        // the origin of the trajectory moves with the turns about the middle of the walk
        let lever = refined.pose.translation_m - refined.about_m;
        #[rustfmt::skip]
        let turned = Matrix3::new(
            0.0, lever.z, -lever.y,
            -lever.z, 0.0, lever.x,
            lever.y, -lever.x, 0.0,
        );
        let (own, cross) = (covariance.fixed_view::<3, 3>(0, 0), covariance.fixed_view::<3, 3>(0, 3));
        let turns: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into();
        let origin = own
            + cross * turned.transpose()
            + turned * cross.transpose()
            + turned * turns * turned.transpose();
        let (yaw, ..) = refined.pose.rotation.to_euler(EulerRot::ZYX);
        let axes = DMat3::from_quat(DQuat::from_rotation_z(yaw));
        let along = |axis: DVec3| {
            let axis = nalgebra::Vector3::new(axis.x, axis.y, axis.z);
            (axis.transpose() * turns * axis)[0].max(0.0).sqrt().to_degrees()
        };
        Self {
            translation_m: [0, 1, 2].map(|at| origin[(at, at)].max(0.0).sqrt()),
            yaw_deg: along(DVec3::Z),
            pitch_deg: along(axes.y_axis),
            roll_deg: along(axes.x_axis),
        }
    }
}

impl Alignment {
    /// The same in a frame of the scene that begins so far before this one.
    pub fn moved(&self, by_m: DVec3) -> Self {
        let moved = |placement: &Placement| {
            let mut pose = placement.scene_from_walk;
            pose.translation_m += by_m;
            Placement::of(pose, placement.inlier_share)
        };
        let second =
            |second: &SecondBest| SecondBest { placement: moved(&second.placement), ..second.clone() };
        Self {
            best: self.best.as_ref().map(moved),
            second_best: self.second_best.as_ref().map(second),
            placements: self.placements.iter().map(moved).collect(),
            ..self.clone()
        }
    }

    /// Scene from trajectory, where one placement is sure.
    pub fn placed(&self) -> Option<Pose> {
        let best = self.best.as_ref().filter(|_| self.answer == Answer::Placed)?;
        Some(best.scene_from_walk)
    }

    /// For `reason.code`.
    pub fn code(&self) -> &'static str {
        match self.answer {
            Answer::Placed => "placed",
            Answer::Ambiguous => "placement_ambiguous",
            Answer::Slides => "placement_slides",
            Answer::NotFound => "placement_not_found",
        }
    }

    /// The answer in one sentence, and what would make a better one.
    pub fn words(&self) -> String {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let Some(best) = &self.best else {
            return "The walk fits nowhere in the scene: it has hardly any wall, or the scene is another place.".into();
        };
        match self.answer {
            Answer::Placed => {
                let sd = self.sd.map_or(String::new(), |sd| {
                    let [x, y, _] = sd.translation_m;
                    format!(" (sd {:.0} mm, {:.3}°)", 1e3 * x.max(y), sd.yaw_deg)
                });
                let second = self.second_best.as_ref().map_or(String::new(), |second| {
                    format!("; the next best placement fits {}", percent(second.placement.inlier_share))
                });
                format!(
                    "trajectory placed in the scene at {}{sd}: {} of the returns fit{second}",
                    best.words(),
                    percent(best.inlier_share)
                )
            }
            Answer::Ambiguous => {
                let all: Vec<String> = self.placements.iter().map(Placement::words).collect();
                format!(
                    "Ambiguous: {} placements fit equally well: {}. Give --align-near x,y,yaw (where the walk begins).",
                    all.len(),
                    all.join("; ")
                )
            }
            Answer::Slides => {
                let [x, y, z] = self.slides_along.unwrap_or_default();
                format!(
                    "Ambiguous: the walk slides along ({x:.2}, {y:.2}, {z:.2}): the surfaces that it saw look the same all along. \
                     Walk until an end, a door or a corner is in view."
                )
            }
            Answer::NotFound if best.inlier_share >= super::LEAST_INLIERS => format!(
                "The walk is not placed: the best placement fits {} of the returns, but others fit many that it does not. Another \
                 building looks like this, and one in which much has changed; --align-near x,y,yaw says where the walk begins.",
                percent(best.inlier_share)
            ),
            Answer::NotFound => format!(
                "The walk fits nowhere in the scene: the best placement fits {} of the returns, expected {} or more. \
                 Is it the same building, in the same unit, and with the same axis up?",
                percent(best.inlier_share),
                percent(super::LEAST_INLIERS)
            ),
        }
    }

    /// Where the trajectory does not fit while the rest does.
    pub fn doubt(&self) -> Option<String> {
        let Misfit { from_s, to_s, inlier_share } = self.misfit?;
        Some(format!(
            "{:.0} % of the returns from {from_s:.1} to {to_s:.1} s fit the scene, {:.0} % of all: the trajectory jumps or bends \
             there, or the scene has changed",
            100.0 * inlier_share,
            100.0 * self.best.as_ref().map_or(0.0, |best| best.inlier_share)
        ))
    }
}
