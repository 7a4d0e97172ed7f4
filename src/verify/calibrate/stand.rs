//! Stand test: what a servo really does, from a rig that stands still while an axis goes through settings.
//!
//! The points of each setting are laid into the planes of a reference setting (as one sensor into another's,
//! [`relative_mount`]), with what the axis measured as the guess: what is left over is the sensor's turn less
//! what was measured. Nothing of the scene is known beforehand, and the body's pose is no unknown: it stands. Over all
//! settings the angles that were found are regressed on those that were measured: a factor other than 1 is a wrong gear
//! or a wrong scale, a step between settings reached from below and from above is play that the reading does not see. The
//! turns between settings have a common axis, which is the servo's as the sensor sees it. Where zero is cannot be determined by
//! turns alone.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::Estimate;
use super::relative::{Pair, relative_mount, student};
use crate::base::geometry::Pose;
use crate::rig::{Mount, MountedSensor};
use crate::verify::compare::RecordedRay;
use crate::world::trajectory::{PoseError, Trajectory};

/// The body stands, and this much is left for the ground to give.
const STANDING: PoseError = PoseError { position_sd_m: 1e-4, rotation_sd_rad: 1e-5, correlation_s: 60.0 };
/// Parts of a setting that are judged apart, to see what the estimate scatters by.
const WINDOWS: u64 = 6;
/// Turns smaller than this from the reference say little about the axis, rad.
const LEAST_TURN_RAD: f64 = 0.02;

/// From which side a setting was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reached {
    /// From smaller angles.
    FromBelow,
    /// From greater ones.
    FromAbove,
}

impl Reached {
    /// How one angle is reached from another, rad.
    pub(crate) fn between(before_rad: f64, now_rad: f64) -> Self {
        if before_rad < now_rad { Self::FromBelow } else { Self::FromAbove }
    }
}

/// A stretch in which the axis held still.
#[derive(Clone, Debug)]
pub struct Setting {
    /// What the axis measured, rad.
    pub measured_rad: f64,
    /// None for the first.
    pub reached: Option<Reached>,
    /// Of this sensor alone, in order of time.
    pub rays: Vec<RecordedRay>,
}

/// One setting against the reference.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FoundSetting {
    /// What the axis measured, degrees.
    pub measured_deg: f64,
    /// From which side it was reached.
    pub reached: Option<Reached>,
    /// The setting that the others are held against: its angle counts as measured.
    pub is_reference: bool,
    /// The angle found less the angle measured, degrees; none where the surfaces do not tell.
    pub error_deg: Option<Estimate>,
    /// Turn from the reference, rad, in the reference's sensor frame.
    #[serde(skip)]
    turn_rad: Option<DVec3>,
    /// Points that met a plane of the reference.
    pub pairs: usize,
    /// Why there is no result.
    pub cannot_tell: Option<String>,
}

/// What one servo does.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StandTest {
    /// The sensor on it.
    pub sensor: String,
    /// In the order of time.
    pub settings: Vec<FoundSetting>,
    /// Angle turned over angle measured, less 1.
    pub scale_error: Option<Estimate>,
    /// Angle at a reading that was reached from above, less that at the same reading reached from below, degrees: how far the
    /// sensor lags behind its reading.
    pub play_deg: Option<Estimate>,
    /// Root mean square of what is left of the settings after both, degrees.
    pub left_over_deg: Option<f64>,
    /// The servo's axis in the sensor frame at zero tilt: unit vector, the sensor's own y where it sits square.
    pub axis: Option<[f64; 3]>,
    /// Angle between it and the axis of the mount, degrees.
    pub axis_off_deg: Option<f64>,
    /// Standard deviation of that angle's two parts, degrees.
    pub axis_sd_deg: Option<f64>,
}

/// Lays every setting against the one in the middle. The pitch of `nominal` is not used.
pub(crate) fn stand_test(nominal: &MountedSensor, settings: &[Setting], revolution_ns: u64) -> StandTest {
    let reference = middle(settings);
    let found: Vec<FoundSetting> = settings
        .iter()
        .enumerate()
        .map(|(place, setting)| match reference {
            Some(reference) if place != reference => {
                against(nominal, setting, &settings[reference], revolution_ns)
            }
            _ => FoundSetting { is_reference: true, ..FoundSetting::unknown(setting) },
        })
        .collect();
    let mut test = StandTest {
        sensor: nominal.name.clone(),
        scale_error: None,
        play_deg: None,
        left_over_deg: None,
        axis: None,
        axis_off_deg: None,
        axis_sd_deg: None,
        settings: found,
    };
    test.regress();
    test.find_axis();
    test
}

/// The setting that lies nearest to all others.
fn middle(settings: &[Setting]) -> Option<usize> {
    let mean = settings.iter().map(|setting| setting.measured_rad).sum::<f64>() / settings.len() as f64;
    let off = |place: &usize| (settings[*place].measured_rad - mean).abs();
    (0..settings.len()).min_by(|a, b| off(a).total_cmp(&off(b)))
}

fn against(
    nominal: &MountedSensor,
    setting: &Setting,
    reference: &Setting,
    revolution_ns: u64,
) -> FoundSetting {
    let at = |measured_rad: f64| MountedSensor {
        mount: Mount { pitch_rad: measured_rad, ..nominal.mount },
        ..nominal.clone()
    };
    let sensors = [at(setting.measured_rad), at(reference.measured_rad)];
    let mut rays: Vec<RecordedRay> = from_zero(&setting.rays, 0, setting.measured_rad)
        .chain(from_zero(&reference.rays, 1, reference.measured_rad))
        .collect();
    rays.sort_by_key(|ray| (ray.time_ns, ray.sensor, ray.channel));
    let mut found = FoundSetting {
        cannot_tell: Some("cannot tell here: no returns while it held".into()),
        ..FoundSetting::unknown(setting)
    };
    let Some(end_ns) = rays.last().map(|ray| ray.time_ns + 1) else { return found };
    // the body stands: windows may be long, and planes of many points lie better
    let revolution_ns = revolution_ns.max(end_ns / WINDOWS);
    let Ok(still) = Trajectory::new(vec![(0, Pose::IDENTITY), (end_ns, Pose::IDENTITY)]) else {
        return found;
    };
    let pair =
        Pair { trajectory: &still, sensors: &sensors, first: 0, second: 1, rays: &rays, revolution_ns };
    let relative = relative_mount(&pair, &STANDING);
    found.pairs = relative.pairs;
    found.error_deg = relative.tilt.as_ref().map(|tilt| Estimate {
        value: tilt.error_deg,
        sd: tilt.sd_deg,
        u95: tilt.u95_deg,
        p_value: tilt.p_value,
    });
    found.cannot_tell = relative.cannot_tell;
    if let [Some(x), Some(y), Some(z)] = relative.rotation_deg {
        let off = DVec3::new(x.value, y.value, z.value) * 1f64.to_radians();
        let [rotation, of_reference] = sensors.each_ref().map(|sensor| sensor.mount.rotation());
        let rotation = glam::DMat3::from_quat(glam::DQuat::from_scaled_axis(off)) * rotation;
        let turn = glam::DQuat::from_mat3(&(of_reference.transpose() * rotation));
        found.turn_rad = Some(turn.to_scaled_axis());
    }
    found
}

/// The rays of a stretch as of sensor `number`, their times counted from its first.
fn from_zero(rays: &[RecordedRay], number: usize, pitch_rad: f64) -> impl Iterator<Item = RecordedRay> + '_ {
    let start_ns = rays.first().map_or(0, |ray| ray.time_ns);
    rays.iter().map(move |ray| RecordedRay {
        sensor: number,
        pitch_rad,
        time_ns: ray.time_ns - start_ns,
        ..*ray
    })
}

impl FoundSetting {
    fn unknown(setting: &Setting) -> Self {
        Self {
            measured_deg: setting.measured_rad.to_degrees(),
            reached: setting.reached,
            is_reference: false,
            error_deg: None,
            turn_rad: None,
            pairs: 0,
            cannot_tell: None,
        }
    }
}

impl StandTest {
    /// Found on measured: scale, play and a constant that takes up the reference's own error.
    fn regress(&mut self) {
        let reference_deg =
            self.settings.iter().find(|found| found.is_reference).map_or(0.0, |f| f.measured_deg);
        let both = [Reached::FromBelow, Reached::FromAbove];
        let has_both = both.iter().all(|side| {
            self.settings.iter().any(|found| found.reached == Some(*side) && found.error_deg.is_some())
        });
        let rows: Vec<([f64; 3], f64, f64)> = self
            .settings
            .iter()
            // with play, an angle reached from an unknown side lies anywhere in it
            .filter(|found| !has_both || found.reached.is_some())
            .filter_map(|found| {
                let error = found.error_deg?;
                let side = if found.reached == Some(Reached::FromAbove) { 0.5 } else { -0.5 };
                Some(([1.0, found.measured_deg - reference_deg, side], error.value, error.sd))
            })
            .collect();
        let turned = || rows.iter().map(|(row, ..)| row[1]);
        let span_deg = turned().fold(f64::NEG_INFINITY, f64::max) - turned().fold(f64::INFINITY, f64::min);
        let mut used = vec![0];
        if span_deg > LEAST_TURN_RAD.to_degrees() {
            used.push(1);
        }
        if has_both {
            used.push(2);
        }
        if rows.len() <= used.len() {
            return;
        }
        let matrix =
            DMatrix::from_fn(rows.len(), used.len(), |row, place| rows[row].0[used[place]] / rows[row].2);
        let right = DVector::from_fn(rows.len(), |row, _| rows[row].1 / rows[row].2);
        let Some(inverse) = (matrix.transpose() * &matrix).try_inverse() else { return };
        let solution = &inverse * (matrix.transpose() * &right);
        let left = &right - &matrix * &solution;
        let freedom = rows.len() - used.len();
        // settings scatter by more than their own noise says where planes are not even
        let scatter = (left.norm_squared() / freedom as f64).max(1.0);
        let estimate = |unknown: usize| {
            let place = used.iter().position(|used| *used == unknown)?;
            Some(student(solution[place], (inverse[(place, place)] * scatter).sqrt(), freedom))
        };
        self.scale_error = estimate(1);
        self.play_deg = estimate(2);
        let squares: f64 = left.iter().zip(&rows).map(|(left, (.., sd))| (left * sd).powi(2)).sum();
        self.left_over_deg = Some((squares / rows.len() as f64).sqrt());
    }

    /// The common axis of all turns from the reference, each counted by its angle.
    fn find_axis(&mut self) {
        // turns to the other side have the axis turned round
        let ahead = |turn: DVec3| if turn.y < 0.0 { -turn } else { turn };
        let turns: Vec<DVec3> = self.settings.iter().filter_map(|found| found.turn_rad).map(ahead).collect();
        let turns: Vec<DVec3> = turns.into_iter().filter(|turn| turn.length() > LEAST_TURN_RAD).collect();
        if turns.len() < 2 {
            return;
        }
        let axis = turns.iter().map(|turn| turn.length() * *turn).sum::<DVec3>().normalize();
        let lever: f64 = turns.iter().map(|turn| turn.length_squared()).sum();
        let across: f64 = turns.iter().map(|turn| turn.reject_from_normalized(axis).length_squared()).sum();
        // of one of the two directions across it
        let variance = across / (2.0 * (turns.len() - 1) as f64);
        self.axis = Some(axis.to_array());
        self.axis_off_deg = Some(axis.angle_between(DVec3::Y).to_degrees());
        self.axis_sd_deg = Some((variance / lever).sqrt().to_degrees());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::FramePitch;
    use crate::simulate::frames::{Scan, Spin};
    use crate::verify::compare::Thinning;
    use crate::world::scene::{BoxScene, Scene};

    const TURN_NS: u64 = 100_000_000;

    /// A servo that turns `scale` times what it measures, about an axis that lies `askew_rad` off towards z, with play.
    fn settings(model: &str, scale: f64, askew_rad: f64, play_rad: f64) -> (MountedSensor, Vec<Setting>) {
        let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, -1.4), DVec3::new(5.0, 3.5, 1.6)));
        let model = sensors::catalogue::nominal(model).unwrap();
        let nominal =
            MountedSensor { name: "left".into(), model, mount: Mount { z_m: 0.1, ..Mount::default() } };
        let still = Trajectory::new(vec![(0, Pose::IDENTITY), (60_000_000_000, Pose::IDENTITY)]).unwrap();
        let spin = Spin::Angles { columns: 512, rate_hz: 10.0 };
        let mut settings: Vec<Setting> = Vec::new();
        let mut start_ns = 0;
        for measured_deg in [-20.0_f64, -10.0, 0.0, 15.0, 10.0, 0.0, -10.0] {
            let measured_rad = measured_deg.to_radians();
            let reached = settings.last().map(|last| Reached::between(last.measured_rad, measured_rad));
            let late_rad = match reached {
                Some(Reached::FromBelow) | None => -0.5 * play_rad,
                Some(Reached::FromAbove) => 0.5 * play_rad,
            };
            let level = Mount { pitch_rad: 0.0, ..nominal.mount }.body_from_sensor();
            let axis = DVec3::new(0.0, askew_rad.cos(), askew_rad.sin());
            let turn = glam::DQuat::from_axis_angle(axis, scale * measured_rad + late_rad);
            // about the mount's axes, like any tilt
            let axes = glam::DQuat::from_mat3(&crate::base::geometry::BODY_FROM_MOUNT_FRAME);
            let body_from_sensor =
                Pose::new(axes * turn * axes.conjugate() * level.rotation, level.translation_m);
            let scan = Scan {
                scene: &scene,
                trajectory: &still,
                model: &nominal.model,
                body_from_sensor: &|_| body_from_sensor,
                noise_m: 0.01,
                seed: 7,
                range_step_mm: 1,
            };
            let mut rays = Thinning::new(80_000);
            for turn in 0..10 {
                let columns = spin.columns(start_ns, turn);
                let frame = scan.frame(turn, &columns, spin.azimuth_rate_rad_per_ns());
                rays.add_frame(0, &nominal.model, &FramePitch::constant(measured_rad), 0, &frame);
            }
            settings.push(Setting { measured_rad, reached, rays: Thinning::joined([rays]) });
            start_ns += 30 * TURN_NS;
        }
        (nominal, settings)
    }

    #[test]
    fn scale_play_and_axis_come_out() {
        let (nominal, settings) = settings("vlp-16", 1.02, 0.5_f64.to_radians(), 0.3_f64.to_radians());
        let found = stand_test(&nominal, &settings, TURN_NS);
        println!("{found:#?}");
        let near =
            |value: f64, truth: f64, within: f64| assert!((value - truth).abs() < within, "{value} {truth}");
        near(found.scale_error.unwrap().value, 0.02, 0.002);
        near(found.play_deg.unwrap().value, 0.3, 0.04);
        near(found.axis_off_deg.unwrap(), 0.5, 0.05);
        assert!(found.left_over_deg.unwrap() < 0.03);
        let alone = found.settings.iter().filter(|setting| setting.is_reference).collect::<Vec<_>>();
        assert!(alone.len() == 1 && alone[0].measured_deg == 0.0);
    }

    #[test]
    fn an_honest_servo_has_neither() {
        let (nominal, settings) = settings("vlp-16", 1.0, 0.0, 0.0);
        let found = stand_test(&nominal, &settings, TURN_NS);
        println!("{found:#?}");
        let [scale, play] = [found.scale_error, found.play_deg].map(Option::unwrap);
        assert!(scale.value.abs() < 0.002 && scale.p_value > 0.001, "{scale:?}");
        assert!(play.value.abs() < 0.04 && play.p_value > 0.001, "{play:?}");
        assert!(found.axis_off_deg.unwrap() < 0.05, "{found:?}");
    }

    #[test]
    fn one_setting_tells_nothing() {
        let (nominal, mut settings) = settings("vlp-16", 1.0, 0.0, 0.0);
        settings.truncate(1);
        let found = stand_test(&nominal, &settings, TURN_NS);
        assert!(found.scale_error.is_none() && found.play_deg.is_none() && found.axis.is_none());
        settings.clear();
        assert!(stand_test(&nominal, &settings, TURN_NS).settings.is_empty());
    }
}
