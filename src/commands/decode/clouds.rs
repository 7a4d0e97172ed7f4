//! Bags that hold clouds and no packets: their points as they are, each at its own time.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context as _, bail};

use super::Args;
use super::document::Document;
use super::output::Output;
use super::placing::Placing;
use crate::base::geometry::Pose;
use crate::commands::recording::Recording;
use crate::commands::trajectory_args::read_trajectory;
use crate::commands::{Context, Outcome};
use crate::recording::bags::{BagClouds, PLATFORM_FRAME, RecordedTrajectory, Surroundings, Topic};
use crate::recording::export::{Cloud, Source};
use crate::recording::registered::{Registration, Target};

/// Decodes nothing: hands on what a driver decoded.
pub(super) fn run(args: &Args, context: Context, recording: &Recording) -> anyhow::Result<Outcome> {
    let format = args.format(context);
    context
        .ensure_not_typed(&["mount"], "is for packets: clouds of a bag sit as its static transforms say")?;
    if !args.points.is_moved() {
        context
            .ensure_not_typed(&["trajectory", "time_offset"], "needs --frame world: the bag holds clouds")?;
    }
    let mut notices = Vec::new();
    let surroundings = match args.points.is_moved() {
        true => Some(Surroundings::read(recording.path(), &recording.name())?),
        false => None,
    };
    let (mut registration, body) = registration(args, recording, surroundings.as_ref(), &mut notices)?;
    let frames = args.points.frames(args.frames).unwrap_or_default();
    let mut output = Output::new(args, format, recording, args.points.file_frame(&registration))?;
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
        let is_wanted = args.points.part.wants(&source.id, &clouds.topics()[topic].name)
            && registration.is_wanted([cloud.record_time_ns; 2]);
        if !frames.contains(number) || !is_wanted {
            continue;
        }
        let body_from_cloud = match &surroundings {
            None => Pose::IDENTITY,
            Some(Surroundings { frames, .. }) => {
                let body = body.as_deref().or_else(|| frames.root_of(&cloud.frame_id));
                let pose = body.and_then(|body| frames.a_from_b(body, &cloud.frame_id));
                pose.with_context(|| {
                    format!(
                        "{}: no static transforms lead from frame {} of the clouds to {}",
                        recording.name(),
                        cloud.frame_id,
                        body.unwrap_or("a frame of the rig")
                    )
                })?
            }
        };
        let start_ns = cloud.points.iter().map(|point| point.time_ns).min().unwrap_or(cloud.stamp_ns);
        let mut frame = Cloud::of_points(
            Arc::clone(source),
            number as u32,
            [start_ns, cloud.record_time_ns],
            cloud.points,
        );
        document.add_cloud(at, &frame);
        registration.apply(at, &mut frame, &|_| body_from_cloud);
        if let Some(output) = &mut output {
            output.add_cloud(at, number, frame)?;
        }
    }
    let topics = sources.iter().map(|(topic, source)| (&clouds.topics()[*topic], source.as_ref()));
    document.conclude_clouds(recording, topics, clouds.losses());
    document.add_registration(&Placing { mounts: None, registration, recording }, notices);
    if document.is_empty() {
        bail!("{}: no cloud in it can be read: {}", recording.name(), document.notices().join("; "));
    }
    super::finish(args, context, document, output)
}

/// How the clouds are moved, and the frame that they are moved to before a trajectory moves them on.
fn registration(
    args: &Args,
    recording: &Recording,
    surroundings: Option<&Surroundings>,
    notices: &mut Vec<String>,
) -> anyhow::Result<(Registration, Option<String>)> {
    let filter = args.points.filter();
    let Some(surroundings) = surroundings else {
        return Ok((Registration::new(Target::Sensor, filter), None));
    };
    notices.extend(surroundings.notices.iter().cloned());
    let platform = || surroundings.frames.names(PLATFORM_FRAME).then(|| PLATFORM_FRAME.to_owned());
    if !args.points.is_read_again() {
        return Ok((Registration::new(Target::Rig, filter), platform()));
    }
    let (trajectory, body) = match args.points.trajectory() {
        Some(path) if path.as_os_str() == "odometry" => {
            bail!("--trajectory odometry is found from packets, and {} holds clouds", recording.name())
        }
        Some(path) => {
            let (trajectory, of_file) = read_trajectory(path, None)?;
            notices.extend(of_file);
            (trajectory, platform())
        }
        None => {
            let of_platform = |of: &&RecordedTrajectory| surroundings.frames.names(&of.child);
            let all = &surroundings.trajectories;
            let Some(of) = all.iter().find(of_platform).or(all.first()) else {
                bail!(
                    "{}: it holds no trajectory (nav_msgs/Odometry or Path, geometry_msgs poses, or /tf): give --trajectory",
                    recording.name()
                );
            };
            notices.push(format!("{}: poses of {} in {}", of.topic, of.child, of.parent));
            (of.trajectory.clone(), Some(of.child.clone()))
        }
    };
    let target = Target::World { trajectory, offset: args.points.time_offset() };
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
