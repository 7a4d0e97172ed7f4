//! Bags that hold clouds and no packets: their points as they are, each at its own time.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::bail;

use super::document::Document;
use super::output::Output;
use super::{Args, FrameRange, OutputFrame};
use crate::commands::recording::Recording;
use crate::commands::{Context, Outcome};
use crate::recording::bags::{BagClouds, Surroundings, Topic};
use crate::recording::export::{Cloud, Source};

/// Decodes nothing: hands on what a driver decoded.
pub(super) fn run(args: &Args, context: Context, recording: &Recording) -> anyhow::Result<Outcome> {
    let mut output = Output::new(args, args.format(context), recording)?;
    let frames: FrameRange = args.frames.unwrap_or_default();
    let mut clouds = BagClouds::open(recording.path(), &recording.name())?;
    let surroundings = match args.frame {
        OutputFrame::Sensor => None,
        OutputFrame::World => Some(Surroundings::read(recording.path(), &recording.name())?),
    };
    let (mut outside, mut used) = (0, BTreeSet::new());
    let mut document = Document::default();
    let mut sources: BTreeMap<usize, Arc<Source>> = BTreeMap::new();
    while let Some(mut cloud) = clouds.next()? {
        let at = sources.len();
        let topic = cloud.topic;
        let source = sources.entry(topic).or_insert_with(|| Arc::new(source(&clouds.topics()[topic], at)));
        let at = usize::from(source.number);
        let number = document.count_frame(at);
        if !frames.contains(number) {
            continue;
        }
        if let Some(surroundings) = &surroundings {
            let Some((of, child_from_cloud)) = surroundings.trajectory_of(&cloud.frame_id) else {
                bail!("{}: {}", recording.name(), no_trajectory(surroundings, &cloud.frame_id));
            };
            outside += of.place(child_from_cloud, &mut cloud.points);
            used.insert(format!("{}: poses of {} in {}", of.topic, of.child, of.parent));
        }
        let start_ns = cloud.points.iter().map(|point| point.time_ns).min().unwrap_or(cloud.stamp_ns);
        let frame = Cloud::of_points(
            Arc::clone(source),
            number as u32,
            [start_ns, cloud.record_time_ns],
            cloud.points,
        );
        document.add_cloud(at, &frame);
        if let Some(output) = &mut output {
            output.add_cloud(at, number, frame)?;
        }
    }
    let topics = sources.iter().map(|(topic, source)| (&clouds.topics()[*topic], source.as_ref()));
    let mut losses = clouds.losses();
    if outside > 0 {
        losses.push(format!("{outside} points lie outside of the trajectory's time and were left out"));
    }
    document.conclude_clouds(recording, topics, losses);
    let odd = surroundings.into_iter().flat_map(|surroundings| surroundings.notices);
    document.add_notices(used.into_iter().chain(odd));
    if document.is_empty() {
        bail!("{}: no cloud in it can be read: {}", recording.name(), document.notices().join("; "));
    }
    super::finish(args, context, document, output)
}

/// Why clouds cannot be placed: what trajectories there are, and what is missing.
fn no_trajectory(surroundings: &Surroundings, frame: &str) -> String {
    let found: Vec<String> = surroundings
        .trajectories
        .iter()
        .map(|of| format!("{} ({} in {})", of.topic, of.child, of.parent))
        .collect();
    if found.is_empty() {
        return "it holds no trajectory (nav_msgs/Odometry or Path, geometry_msgs poses, or /tf)".into();
    }
    format!(
        "no static transforms lead from frame {frame} to a frame that has a trajectory: {}",
        found.join(", ")
    )
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
