//! Bags that hold clouds and no packets: their points as they are, each at its own time.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::document::Document;
use super::error::DecodingError;
use super::frames::OutputFrame;
use super::output::Output;
use super::placing::{Placing, Transforms};
use super::spec::DecodingSpec;
use crate::base::geometry::Pose;
use crate::recording::bags::{BagClouds, PLATFORM_FRAME, RecordedTrajectory, Surroundings, Topic};
use crate::recording::export::{Cloud, Format, Source};
use crate::recording::registered::{Registration, Target};
use crate::recording::source::Recording;
use crate::recording::{TrajectorySource, read_trajectory};
use crate::world::trajectory::Trajectory;

/// Decodes nothing: hands on what a driver decoded.
pub(crate) fn decode_clouds(spec: &DecodingSpec, recording: &Recording) -> Result<Document, DecodingError> {
    let mut notices = Vec::new();
    let states_transforms = spec.file_format().is_some_and(Format::holds_transforms);
    let surroundings = match spec.is_moved() || states_transforms {
        true => Some(Surroundings::read(recording.path(), &recording.name())?),
        false => None,
    };
    let (mut registration, body) = registration(spec, recording, surroundings.as_ref(), &mut notices)?;
    let frames = spec.wanted_frames().unwrap_or_default();
    let mut output = Output::new(spec, recording, spec.file_frame(&registration))?;
    let mut clouds = BagClouds::open(recording.path(), &recording.name())?;
    let mut document = Document::default();
    let mut sources: BTreeMap<usize, Arc<Source>> = BTreeMap::new();
    while let Some(cloud) = clouds.next()? {
        registration.begin(cloud.record_time_ns);
        let at = sources.len();
        let topic = cloud.topic;
        let source = sources.entry(topic).or_insert_with(|| Arc::new(source(&clouds.topics()[topic], at)));
        let at = usize::from(source.number);
        let number = document.count_frame(at);
        let is_wanted = spec.part.wants(&source.id, &clouds.topics()[topic].name)
            && registration.is_wanted([cloud.record_time_ns; 2]);
        if !frames.contains(number) || !is_wanted {
            continue;
        }
        let body_from_cloud = surroundings.as_ref().and_then(|Surroundings { frames, .. }| {
            let body = body.as_deref().or_else(|| frames.root_of(&cloud.frame_id))?;
            frames.a_from_b(body, &cloud.frame_id)
        });
        if body_from_cloud.is_none() && spec.is_moved() {
            return Err(DecodingError::NoTransform {
                recording: recording.name(),
                frame: cloud.frame_id,
                body: body.unwrap_or_else(|| "a frame of the rig".to_owned()),
            });
        }
        let start_ns = cloud.points.iter().map(|point| point.time_ns).min().unwrap_or(cloud.stamp_ns);
        let mut frame = Cloud::of_points(
            Arc::clone(source),
            number as u32,
            [start_ns, cloud.record_time_ns],
            cloud.points,
        );
        document.add_cloud(at, &frame);
        registration.apply(at, &mut frame, &|_| body_from_cloud.unwrap_or(Pose::IDENTITY));
        if let Some(output) = &mut output {
            let transforms = Transforms::of(body_from_cloud, false, at, &frame, &mut registration);
            output.add_cloud(at, number, frame, &transforms)?;
        }
    }
    let topics = sources.iter().map(|(topic, source)| (&clouds.topics()[*topic], source.as_ref()));
    document.conclude_clouds(recording, topics, clouds.losses());
    let placing = Placing { mounts: None, registration, recording };
    document.add_registration(&placing, notices);
    if document.is_empty() {
        let (recording, notices) = (recording.name(), document.notices().join("; "));
        return Err(DecodingError::NoCloud { recording, notices });
    }
    document.close(spec, output, &placing.registration)
}

/// How the clouds are moved, and the frame that they are moved to before a trajectory moves them on.
fn registration(
    spec: &DecodingSpec,
    recording: &Recording,
    surroundings: Option<&Surroundings>,
    notices: &mut Vec<String>,
) -> Result<(Registration, Option<String>), DecodingError> {
    let filter = spec.filter.clone();
    let Some(surroundings) = surroundings else {
        return Ok((Registration::new(Target::Sensor, filter), None));
    };
    notices.extend(surroundings.notices.iter().cloned());
    let platform = || surroundings.frames.names(PLATFORM_FRAME).then(|| PLATFORM_FRAME.to_owned());
    if spec.frame == OutputFrame::Rig && !spec.is_read_again() {
        return Ok((Registration::new(Target::Rig, filter), platform()));
    }
    let (trajectory, body) = match &spec.trajectory {
        Some(TrajectorySource::Odometry) => {
            return Err(DecodingError::OdometryOfClouds { recording: recording.name() });
        }
        Some(TrajectorySource::Still) if !spec.is_moved() => {
            return Ok((Registration::new(Target::Sensor, filter), platform()));
        }
        Some(TrajectorySource::Still) => (Trajectory::still(), platform()),
        Some(TrajectorySource::File(path)) => {
            let (trajectory, of_file) = read_trajectory(path, None)?;
            notices.extend(of_file);
            (trajectory, platform())
        }
        None => {
            let of_platform = |of: &&RecordedTrajectory| surroundings.frames.names(&of.child);
            let all = &surroundings.trajectories;
            match all.iter().find(of_platform).or(all.first()) {
                Some(of) => {
                    notices.push(format!("{}: poses of {} in {}", of.topic, of.child, of.parent));
                    (of.trajectory.clone(), Some(of.child.clone()))
                }
                None if spec.is_moved() => {
                    return Err(DecodingError::NoTrajectory { recording: recording.name() });
                }
                None => return Ok((Registration::new(Target::Sensor, filter), platform())),
            }
        }
    };
    let offset = spec.time_offset;
    let target = match spec.is_moved() {
        true => Target::World { trajectory, offset },
        false => Target::SensorOnTrajectory { trajectory, offset },
    };
    Ok((Registration::new(target, filter), body))
}

/// By the namespace of its topic; where that has none, by its name.
fn source(topic: &Topic, number: usize) -> Source {
    let name = topic.name.trim_matches('/');
    let (namespace, last) = name.rsplit_once('/').unwrap_or((name, name));
    let is_second = last.ends_with("points2");
    let id: String =
        namespace.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).collect();
    Source {
        id: if is_second { format!("{id}-second") } else { id },
        number: number as u16, // few topics hold clouds
        vendor: "unknown".into(),
        model: topic.kind.clone(),
        serial: String::new(),
        timestamp_mode: None,
    }
}
