//! ROS 1 and ROS 2 bags: messages in the order of their record, and the sensors' packets in them.
//!
//! ```text
//! files    which files a path names: a bag, a folder with metadata.yaml, parts of a split bag, a compressed file
//! ros1     ROS 1 bags, with or without index
//! mcap     MCAP, indexed or cut off
//! db3      rosbag2's SQLite files
//! cursor   fields of a message (ROS 1 and CDR)
//! packets  messages that hold sensors' packets, and their metadata
//! clouds   messages that hold points
//! surroundings  static transforms, and poses over time
//! ```
//!
//! Topics are found by the type of their messages; their names differ in every recording.

mod clouds;
mod cursor;
#[cfg(feature = "db3")]
mod db3;
mod files;
#[cfg(feature = "mcap")]
mod mcap;
mod packets;
mod roles;
mod ros1;
mod surroundings;
mod unpack;

use std::path::Path;
use std::sync::Arc;

pub use clouds::{BagCloud, BagClouds};
pub use cursor::Encoding;
use files::{BagFile, BagFiles};
pub(crate) use files::{Packed, is_bag, is_bag_at, is_bag_folder, start_of};
pub use packets::{BagPacket, BagPackets, BagSensor, TopicCount};
pub(crate) use packets::{metadata_in, names_in, notices_of};
pub use roles::Role;
pub(crate) use surroundings::PLATFORM_FRAME;
pub use surroundings::{FrameTree, RecordedTrajectory, Surroundings};

/// Why a bag cannot be read, or not further. All messages before the place named were handed out.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system refused something.
    #[error("{name}: {doing}: {source}")]
    Io {
        /// The file.
        name: String,
        /// What was tried.
        doing: &'static str,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file contradicts itself, and nothing behind that place can be found.
    #[error("{name}: damaged at byte {offset}: found {found}, expected {expected}")]
    Damaged {
        /// The file.
        name: String,
        /// Where.
        offset: u64,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// No poses over time, or none of the topic that was asked for.
    #[error(
        "{name}: no trajectory{}; expected nav_msgs/Odometry or Path, geometry_msgs poses, or /tf; it has {}",
        topic.as_ref().map_or(String::new(), |topic| format!(" on {topic}")),
        if topics.is_empty() { "none".to_owned() } else { topics.join(", ") }
    )]
    NoTrajectory {
        /// The bag.
        name: String,
        /// The topic that was asked for.
        topic: Option<String>,
        /// Topics with trajectories, and of which frame in which.
        topics: Vec<String>,
    },
    /// A kind of bag that is not read.
    #[error("{name} is {found}: {instead}")]
    Unsupported {
        /// The file.
        name: String,
        /// What it is.
        found: String,
        /// What to do.
        instead: &'static str,
    },
}

impl BagError {
    pub(crate) fn io(path: &Path, doing: &'static str, source: std::io::Error) -> Self {
        Self::Io { name: path.display().to_string(), doing, source }
    }
}

/// One topic of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Type of its messages as ROS 1 writes it: `sensor_msgs/PointCloud2`.
    pub kind: String,
    /// How they are written.
    pub encoding: Encoding,
}

impl Topic {
    fn new(name: impl Into<String>, kind: &str, encoding: Encoding) -> Self {
        Self { name: name.into(), kind: kind.replacen("/msg/", "/", 1), encoding }
    }
}

/// One file of a bag, whatever its format.
trait Container: Send {
    /// Those known so far; more may come with the messages.
    fn topics(&self) -> &[Topic];
    /// Goes on to the next message in the order of the file: its topic and when it was recorded.
    fn advance(&mut self) -> Result<Option<(usize, u64)>, BagError>;
    /// The content of that message.
    fn data(&self) -> &[u8];
    /// Leaves out what holds no message of these topics, where an index says so. Others may come all the same.
    /// True where one does.
    fn restrict(&mut self, is_wanted: &dyn Fn(&Topic) -> bool) -> bool;
    /// Bytes read, to show progress.
    fn position(&self) -> u64;
    /// What is missing so far.
    fn losses(&self) -> &Losses;
}

/// What is missing, in words; of very many only the first are listed.
#[derive(Default)]
struct Losses {
    words: Vec<String>,
    more: u64,
}

impl Losses {
    const MOST: usize = 16;

    fn push(&mut self, words: String) {
        match self.words.len() < Self::MOST {
            true => self.words.push(words),
            false => self.more += 1,
        }
    }

    fn add(&mut self, other: &Self) {
        other.words.iter().for_each(|words| self.push(words.clone()));
        self.more += other.more;
    }

    fn listed(&self) -> Vec<String> {
        let more = (self.more > 0).then(|| format!("and {} losses more", self.more));
        self.words.iter().cloned().chain(more).collect()
    }
}

fn open_file(file: &BagFile) -> Result<Box<dyn Container>, BagError> {
    let start = crate::base::files::open(&file.path).and_then(|mut file| start_of(&mut file));
    let start = start.map_err(|source| file.io("cannot be read", source))?;
    match files::Kind::of(&start) {
        Some(files::Kind::Ros1) => Ok(Box::new(ros1::Ros1::open(file)?)),
        #[cfg(feature = "mcap")]
        Some(files::Kind::Mcap) => Ok(Box::new(mcap::Mcap::open(file)?)),
        #[cfg(feature = "db3")]
        Some(files::Kind::Db3) => Ok(Box::new(db3::Db3::open(file)?)),
        #[cfg(not(all(feature = "mcap", feature = "db3")))]
        Some(kind) => Err(kind.left_out(&file.name)),
        None => Err(BagError::Unsupported {
            name: file.name.clone(),
            found: "no bag".into(),
            instead: "expected a ROS 1 bag, an MCAP file or a db3 file",
        }),
    }
}

/// Reads the messages of a bag, all its files in order.
pub(crate) struct BagReader {
    files: Arc<BagFiles>,
    /// Files that were begun.
    begun: usize,
    current: Option<Part>,
    topics: Vec<Topic>,
    /// The topics that are needed, where not all are.
    wanted: Option<Vec<usize>>,
    losses: Losses,
    read_before: u64,
}

struct Part {
    container: Box<dyn Container>,
    /// Number among all topics of each of its own.
    numbers: Vec<usize>,
}

impl BagReader {
    fn new(files: Arc<BagFiles>) -> Result<Self, BagError> {
        let mut reader = Self {
            files,
            begun: 0,
            current: None,
            topics: Vec::new(),
            wanted: None,
            losses: Losses::default(),
            read_before: 0,
        };
        reader.losses.add(&reader.files.losses);
        reader.begin_next()?;
        Ok(reader)
    }

    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// What is missing so far, in words.
    pub fn losses(&self) -> Vec<String> {
        let mut losses = Losses::default();
        losses.add(&self.losses);
        self.current.iter().for_each(|part| losses.add(part.container.losses()));
        losses.listed()
    }

    pub fn position(&self) -> u64 {
        self.read_before + self.current.as_ref().map_or(0, |part| part.container.position())
    }

    /// From here on only messages of these topics are needed. True where an index says where they are, and that there are
    /// no others.
    pub fn restrict(&mut self, wanted: Vec<usize>) -> bool {
        let topics = &self.topics;
        let is_wanted = |topic: &Topic| wanted.iter().any(|at| topics[*at] == *topic);
        let is_indexed = self.current.as_mut().is_some_and(|part| part.container.restrict(&is_wanted));
        self.wanted = Some(wanted);
        is_indexed
    }

    /// Goes on to the next message: its topic and when it was recorded, ns since 1970.
    pub fn advance(&mut self) -> Result<Option<(usize, u64)>, BagError> {
        let (topic, time_ns) = loop {
            let Some(part) = &mut self.current else { return Ok(None) };
            if let Some(found) = part.container.advance()? {
                break found;
            }
            self.losses.add(part.container.losses());
            self.read_before += part.container.position();
            self.current = None;
            self.begin_next()?;
        };
        self.learn_topics();
        Ok(self.current.as_ref().map(|part| (part.numbers[topic], time_ns)))
    }

    /// The content of that message.
    pub fn data(&self) -> &[u8] {
        self.current.as_ref().map_or(&[], |part| part.container.data())
    }

    fn begin_next(&mut self) -> Result<(), BagError> {
        let Some(file) = self.files.files.get(self.begun) else { return Ok(()) };
        self.begun += 1;
        let mut container = open_file(file)?;
        if let Some(wanted) = &self.wanted {
            container.restrict(&|topic| wanted.iter().any(|at| self.topics[*at] == *topic));
        }
        self.current = Some(Part { container, numbers: Vec::new() });
        self.learn_topics();
        Ok(())
    }

    /// Numbers topics that were met meanwhile.
    fn learn_topics(&mut self) {
        let Some(part) = &mut self.current else { return };
        for topic in &part.container.topics()[part.numbers.len()..] {
            let number = self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
                self.topics.push(topic.clone());
                self.topics.len() - 1
            });
            part.numbers.push(number);
        }
    }
}
