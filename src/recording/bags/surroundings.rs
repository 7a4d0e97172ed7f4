//! What a bag states besides packets and clouds: how frames sit on each other, and where the platform went.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::cursor::{Cursor, Encoding};
use super::files;
use super::roles::Role;
use super::unpack::{ZSTD, unpack_zstd};
use super::{BagError, BagReader};
use crate::base::geometry::Pose;
use crate::rig::NamedFrame;
use crate::world::trajectory::Trajectory;

/// The frame of poses in messages that name none.
pub(crate) const PLATFORM_FRAME: &str = "base_link";
/// Links between frames that are followed.
const MOST_LINKS: usize = 32;
/// Poses of all trajectories of a bag: an hour at 1 kHz of four.
const MOST_POSES: usize = 16_000_000;

/// Frames that do not move against each other.
#[derive(Default)]
pub struct FrameTree {
    /// Parent and pose of each frame in it.
    parents: BTreeMap<String, (String, Pose)>,
}

impl FrameTree {
    fn add(&mut self, parent: &str, child: &str, parent_from_child: Pose, notices: &mut Vec<String>) {
        match self.parents.get(child) {
            Some((known, _)) if known != parent => {
                let words = format!("frame {child} has two parents, {known} and {parent}: the first is used");
                if !notices.contains(&words) {
                    notices.push(words);
                }
            }
            _ => drop(self.parents.insert(child.to_owned(), (parent.to_owned(), parent_from_child))),
        }
    }

    /// Every frame and where it sits in its parent.
    pub(crate) fn links(&self) -> impl Iterator<Item = NamedFrame> {
        self.parents.iter().map(|(name, (parent, parent_from_frame))| NamedFrame {
            name: name.clone(),
            parent: parent.clone(),
            parent_from_frame: *parent_from_frame,
        })
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.parents.is_empty()
    }

    /// Whether a frame is one of these.
    pub(crate) fn holds(&self, frame: &str) -> bool {
        self.parents.contains_key(frame)
    }

    /// Whether a frame is one of these, or one that others sit in.
    pub(crate) fn names(&self, frame: &str) -> bool {
        self.holds(frame) || self.parents.values().any(|(parent, _)| parent == frame)
    }

    /// The frame at the end of the chain of parents.
    pub(crate) fn root_of<'a>(&'a self, frame: &'a str) -> Option<&'a str> {
        Some(self.root(frame)?.0)
    }

    /// The pose of one frame in another; none where no chain of static transforms joins them.
    pub fn a_from_b(&self, a: &str, b: &str) -> Option<Pose> {
        let (root_of_a, root_from_a) = self.root(a)?;
        let (root_of_b, root_from_b) = self.root(b)?;
        (root_of_a == root_of_b).then(|| root_from_a.inverse() * root_from_b)
    }

    /// The frame at the end of the chain of parents, and the pose in it.
    fn root<'a>(&'a self, frame: &'a str) -> Option<(&'a str, Pose)> {
        let (mut at, mut at_from_frame) = (frame, Pose::IDENTITY);
        for _ in 0..MOST_LINKS {
            let Some((parent, parent_from_at)) = self.parents.get(at) else {
                return Some((at, at_from_frame));
            };
            at_from_frame = *parent_from_at * at_from_frame;
            at = parent;
        }
        None // a circle
    }
}

/// Where a frame was in another over time, by one topic.
pub struct RecordedTrajectory {
    /// The topic that says it.
    pub topic: String,
    /// The frame that stands still.
    pub parent: String,
    /// The frame that moves.
    pub child: String,
    /// Its poses.
    pub trajectory: Trajectory,
}

/// All of it.
#[derive(Default)]
pub struct Surroundings {
    /// Static transforms.
    pub frames: FrameTree,
    /// The longest first; of equally long ones those of poses before those of transforms.
    pub trajectories: Vec<RecordedTrajectory>,
    /// What is odd about them, in words.
    pub notices: Vec<String>,
}

/// Poses as they come: by topic, parent and child.
type Samples = BTreeMap<(bool, String, String, String), BTreeMap<u64, Pose>>;

impl Surroundings {
    /// Reads the transforms and poses of a bag, which messages call so.
    pub fn read(path: &Path, name: &str) -> Result<Self, BagError> {
        let mut reader = BagReader::new(Arc::new(files::find(path, name)?))?;
        let has = |role: Role| matches!(role, Role::Transforms | Role::Poses);
        let wanted = (0..reader.topics().len()).filter(|at| has(Role::of(&reader.topics()[*at])));
        let wanted = wanted.collect();
        reader.restrict(wanted);
        let mut found = Self::default();
        let mut samples = Samples::new();
        let (mut malformed, mut poses, mut unpacked) = (0_u64, 0, Vec::new());
        while let Some((number, _)) = reader.advance()? {
            let topic = &reader.topics()[number];
            let role = Role::of(topic);
            if !has(role) {
                continue;
            }
            let mut data = reader.data();
            if data.starts_with(&ZSTD) {
                data = if unpack_zstd(data, &mut unpacked).is_ok() { &unpacked } else { &[] };
            }
            let read = match role {
                Role::Transforms => transforms(topic.encoding, data),
                _ => poses_of(&topic.kind, topic.encoding, data),
            };
            let Some(read) = read else {
                malformed += 1;
                continue;
            };
            let is_static = topic.name.rsplit('/').next() == Some("tf_static");
            if topic.kind == "nav_msgs/Path" {
                // each says all of it again, as it is known by then
                samples.retain(|(_, of, _, _), _| *of != topic.name);
            }
            for Stamped { parent, child, time_ns, pose } in read {
                if is_static {
                    found.frames.add(&parent, &child, pose, &mut found.notices);
                } else if poses < MOST_POSES {
                    poses += 1;
                    let key = (role == Role::Transforms, topic.name.clone(), parent, child);
                    samples.entry(key).or_default().insert(time_ns, pose);
                }
            }
        }
        if malformed > 0 {
            found.notices.push(format!("{name}: {malformed} messages of transforms or poses cannot be read"));
        }
        if poses == MOST_POSES {
            found.notices.push(format!("{name}: poses behind the first {MOST_POSES} were left out"));
        }
        found.take_trajectories(samples);
        Ok(found)
    }

    fn take_trajectories(&mut self, samples: Samples) {
        let mut found = Vec::new();
        for ((is_transform, topic, parent, child), poses) in samples {
            if poses.len() < 2 {
                continue; // one pose is no trajectory
            }
            let Ok(trajectory) = Trajectory::new(poses.into_iter().collect()) else { continue };
            found.push((is_transform, RecordedTrajectory { topic, parent, child, trajectory }));
        }
        let span_ns = |trajectory: &Trajectory| {
            let [first_ns, last_ns] = trajectory.time_span_ns();
            last_ns - first_ns
        };
        found.sort_by_key(|(is_transform, of)| (std::cmp::Reverse(span_ns(&of.trajectory)), *is_transform));
        self.trajectories = found.into_iter().map(|(_, of)| of).collect();
    }

    /// The trajectory of the platform (of `base_link`, where static transforms lead there) by one topic, or by the one that
    /// lasts longest; and what was chosen, in words.
    pub(crate) fn platform_trajectory(
        self,
        bag: &Path,
        topic: Option<&str>,
    ) -> Result<(Trajectory, Vec<String>), BagError> {
        let name = bag.display().to_string();
        let of_topic = |of: &&RecordedTrajectory| topic.is_none_or(|topic| of.topic == topic);
        let words = |of: &RecordedTrajectory| format!("{} ({} in {})", of.topic, of.child, of.parent);
        let Some(of) = self.trajectories.iter().find(of_topic) else {
            let topics = self.trajectories.iter().map(words).collect();
            return Err(BagError::NoTrajectory { name, topic: topic.map(str::to_owned), topics });
        };
        let mut notices = vec![format!("{name}: trajectory of {}", words(of))];
        let others: Vec<String> =
            self.trajectories.iter().filter(|other| !std::ptr::eq(*other, of)).map(words).collect();
        if topic.is_none() && !others.is_empty() {
            notices.push(format!("{name}: it also has {}; {name}:TOPIC chooses", others.join(", ")));
        }
        notices.extend(self.notices);
        let child_from_platform = self.frames.a_from_b(&of.child, PLATFORM_FRAME);
        let trajectory = match child_from_platform.filter(|pose| *pose != Pose::IDENTITY) {
            Some(child_from_platform) => of.trajectory.of_fixed_frame(&child_from_platform),
            None => of.trajectory.clone(),
        };
        Ok((trajectory, notices))
    }

    /// The trajectory of a frame: the first with a child fixed to it, and how.
    pub fn trajectory_of(&self, frame: &str) -> Option<(&RecordedTrajectory, Pose)> {
        self.trajectories.iter().find_map(|of| Some((of, self.frames.a_from_b(&of.child, frame)?)))
    }
}

struct Stamped {
    parent: String,
    child: String,
    time_ns: u64,
    pose: Pose,
}

fn vector(cursor: &mut Cursor<'_>) -> Option<DVec3> {
    let vector = DVec3::new(cursor.f64()?, cursor.f64()?, cursor.f64()?);
    vector.is_finite().then_some(vector)
}

fn pose(cursor: &mut Cursor<'_>) -> Option<Pose> {
    let translation_m = vector(cursor)?;
    let rotation = DQuat::from_xyzw(cursor.f64()?, cursor.f64()?, cursor.f64()?, cursor.f64()?);
    let is_rotation = rotation.is_finite() && (rotation.length() - 1.0).abs() < 0.01;
    is_rotation.then(|| Pose::new(rotation.normalize(), translation_m))
}

/// `tf2_msgs/TFMessage`.
fn transforms(encoding: Encoding, data: &[u8]) -> Option<Vec<Stamped>> {
    let mut cursor = Cursor::new(encoding, data)?;
    let count = cursor.count(56)?;
    let one = |_| {
        let header = cursor.header()?;
        let child = cursor.string()?;
        let child = child.strip_prefix('/').unwrap_or(child).to_owned();
        Some(Stamped {
            parent: header.frame_id.to_owned(),
            child,
            time_ns: header.stamp_ns,
            pose: pose(&mut cursor)?,
        })
    };
    (0..count).map(one).collect()
}

fn poses_of(kind: &str, encoding: Encoding, data: &[u8]) -> Option<Vec<Stamped>> {
    let mut cursor = Cursor::new(encoding, data)?;
    let header = cursor.header()?;
    let parent = header.frame_id.to_owned();
    match kind {
        "nav_msgs/Odometry" => {
            let child = cursor.string()?;
            let child = child.strip_prefix('/').unwrap_or(child);
            let child = if child.is_empty() { PLATFORM_FRAME } else { child }.to_owned();
            Some(vec![Stamped { parent, child, time_ns: header.stamp_ns, pose: pose(&mut cursor)? }])
        }
        "nav_msgs/Path" => {
            let count = cursor.count(64)?;
            let one = |_| {
                let header = cursor.header()?;
                let child = PLATFORM_FRAME.to_owned();
                Some(Stamped {
                    parent: parent.clone(),
                    child,
                    time_ns: header.stamp_ns,
                    pose: pose(&mut cursor)?,
                })
            };
            (0..count).map(one).collect()
        }
        _ => {
            let child = PLATFORM_FRAME.to_owned();
            Some(vec![Stamped { parent, child, time_ns: header.stamp_ns, pose: pose(&mut cursor)? }])
        }
    }
}
