//! What makes a folder with an MCAP file a ROS 2 bag: `metadata.yaml`.
//!
//! Source: rosbag2 `rosbag2_storage/metadata_io`, version 5 of the layout (ROS 2 Humble; later releases read it).

use std::fmt::Write as _;
use std::path::Path;

use super::{ExportError, Written};
use crate::base::files;

/// Writes `metadata.yaml` next to `mcap_name`, the finished file in `folder`.
pub fn write_metadata(folder: &Path, mcap_name: &str, written: &Written) -> Result<(), ExportError> {
    let path = folder.join("metadata.yaml");
    files::write_whole(&path, metadata(mcap_name, written).as_bytes())
        .map_err(|error| ExportError::Write { path, cause: error.into() })
}

fn metadata(mcap_name: &str, written: &Written) -> String {
    let messages: u64 = written.topics.iter().map(|topic| u64::from(topic.messages)).sum();
    let first_ns = written.topics.iter().map(|topic| topic.log_time_ns[0]).min().unwrap_or(0);
    let last_ns = written.topics.iter().map(|topic| topic.log_time_ns[1]).max().unwrap_or(0);
    let duration_ns = last_ns - first_ns;
    let file = quoted(mcap_name);
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration_ns}\n  \
         starting_time:\n    nanoseconds_since_epoch: {first_ns}\n  message_count: {messages}\n  \
         topics_with_message_count:{}\n",
        if written.topics.is_empty() { " []" } else { "" }
    );
    for topic in &written.topics {
        // names hold only letters, digits, slashes and underscores
        let _ = writeln!(
            text,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"\"\n      message_count: {}",
            topic.name, topic.kind, topic.messages
        );
    }
    let _ = writeln!(
        text,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    - path: {file}\n      \
         starting_time:\n        nanoseconds_since_epoch: {first_ns}\n      duration:\n        nanoseconds: {duration_ns}\n      \
         message_count: {messages}"
    );
    text
}

/// A double-quoted YAML scalar, which JSON's strings are.
fn quoted(name: &str) -> String {
    serde_json::Value::from(name).to_string()
}
