//! Bags that hold clouds and no packets: their points as they are, each at its own time.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::bail;

use super::document::Document;
use super::output::Output;
use super::{Args, FrameRange};
use crate::commands::output::{print_json, print_text, say_notice};
use crate::commands::recording::Recording;
use crate::commands::{Context, Outcome};
use crate::recording::bags::{BagClouds, Topic};
use crate::recording::export::{Cloud, Source};

/// Decodes nothing: hands on what a driver decoded.
pub(super) fn run(args: &Args, context: Context, recording: &Recording) -> anyhow::Result<Outcome> {
    let mut output = Output::new(args, args.format(context), recording)?;
    let frames: FrameRange = args.frames.unwrap_or_default();
    let mut clouds = BagClouds::open(recording.path(), &recording.name())?;
    let mut document = Document::default();
    let mut sources: BTreeMap<usize, Arc<Source>> = BTreeMap::new();
    while let Some(cloud) = clouds.next()? {
        let at = sources.len();
        let topic = cloud.topic;
        let source = sources.entry(topic).or_insert_with(|| Arc::new(source(&clouds.topics()[topic], at)));
        let at = usize::from(source.number);
        let number = document.count_frame(at);
        if !frames.contains(number) {
            continue;
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
    document.conclude_clouds(recording, topics, clouds.losses());
    if document.is_empty() {
        bail!("{}: no cloud in it can be read: {}", recording.name(), document.notices().join("; "));
    }
    if args.frames.is_some() {
        document.ensure_frames(frames)?;
    }
    if let Some(output) = output {
        document.set_files(output.finish()?);
    }
    if context.json {
        print_json(&document)?;
    } else {
        print_text(&document.table())?;
    }
    document.notices().iter().for_each(|notice| say_notice(notice));
    Ok(if document.is_data_lost() { Outcome::DataLost } else { Outcome::Done })
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
