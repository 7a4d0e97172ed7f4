//! tf as YAML: a list of transforms under `transforms` as `ros2 topic echo /tf_static` prints it, or the list alone.

use serde::Deserialize;

use super::super::NamedFrame;
use super::{Extrinsics, matrix};
use crate::base::geometry::Pose;

#[derive(Deserialize)]
struct Message {
    transforms: Vec<Stamped>,
}

#[derive(Deserialize)]
struct Stamped {
    header: Header,
    child_frame_id: String,
    transform: Transform,
}

#[derive(Deserialize)]
struct Header {
    frame_id: String,
}

#[derive(Deserialize)]
struct Transform {
    translation: Vector,
    rotation: Quaternion,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

pub(super) fn parse(text: &str) -> Result<Extrinsics, String> {
    // `ros2 topic echo` ends each message with a line of its own
    let mut transforms = Vec::new();
    for document in text.split("\n---").filter(|document| !is_blank(document)) {
        transforms.extend(document_of(document.trim_start_matches("---"))?);
    }
    if transforms.is_empty() {
        return Err("has no transforms: expected them under `transforms`, as `ros2 topic echo /tf_static` prints them".into());
    }
    let mut found = Extrinsics::default();
    for (index, stamped) in transforms.into_iter().enumerate() {
        let child = stamped.child_frame_id.trim_start_matches('/').to_owned();
        let parent = stamped.header.frame_id.trim_start_matches('/').to_owned();
        let wrong = |reason: String| format!("transforms[{index}] ({parent} to {child}): {reason}");
        if child.is_empty() || parent.is_empty() {
            return Err(wrong("a frame has no name".into()));
        }
        let Transform { translation: at, rotation: by } = stamped.transform;
        let rotation = matrix::quaternion([by.x, by.y, by.z, by.w]).map_err(wrong)?;
        let translation_m = glam::DVec3::new(at.x, at.y, at.z);
        if !translation_m.is_finite() {
            return Err(wrong(format!("translation {translation_m} is not finite")));
        }
        let parent_from_frame = Pose::new(rotation, translation_m);
        found.links.push(NamedFrame { name: child, parent, parent_from_frame });
    }
    Ok(found)
}

fn is_blank(document: &str) -> bool {
    document.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#'))
}

fn document_of(text: &str) -> Result<Vec<Stamped>, String> {
    let message = match serde_saphyr::from_str::<Message>(text) {
        Ok(message) => return Ok(message.transforms),
        Err(error) => error,
    };
    serde_saphyr::from_str::<Vec<Stamped>>(text).map_err(|_| format!("no tf message: {message}"))
}
