//! Messages that hold packets, as ROS 1 and ROS 2 write them, with their definitions.

use crate::rig::NamedFrame;

/// How messages are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Ros1,
    Ros2,
}

/// One type of message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// One packet of an Ouster, and of what else is no data packet of a Velodyne.
    Packet,
    /// Data packets of a Velodyne.
    Scan,
    /// Metadata as text.
    Text,
    /// Frames and where they sit.
    Transforms,
    /// The same at one time; ROS 1 repeats none of them to late listeners.
    Poses,
}

const LINE: &str = "================================================================================\n";
const PACKET: &str = "uint8[] buf\n";
const TEXT: &str = "string data\n";

impl Kind {
    /// Its name in a ROS 1 bag.
    pub fn ros1_name(self) -> &'static str {
        match self {
            Self::Packet => "ouster_ros/PacketMsg",
            Self::Scan => "velodyne_msgs/VelodyneScan",
            Self::Text => "std_msgs/String",
            Self::Transforms | Self::Poses => "tf2_msgs/TFMessage",
        }
    }

    /// Its name in ROS 2, as ouster-ros since 0.11 calls its own.
    pub fn ros2_name(self) -> &'static str {
        match self {
            Self::Packet => "ouster_sensor_msgs/msg/PacketMsg",
            Self::Scan => "velodyne_msgs/msg/VelodyneScan",
            Self::Text => "std_msgs/msg/String",
            Self::Transforms | Self::Poses => "tf2_msgs/msg/TFMessage",
        }
    }

    /// What ROS 1 compares types by: the MD5 sum of its definition.
    pub fn md5(self) -> &'static str {
        match self {
            Self::Packet => "4f7b5949e76f86d01e96b0e33ba9b5e3",
            Self::Scan => "50804fc9533a0e579e6322c04ae70566",
            Self::Text => "992ce8a1687cec8c8bd883ec73ca41d1",
            Self::Transforms | Self::Poses => "94810edda583a504dfda3829e70d7eec",
        }
    }

    pub fn definition(self, dialect: Dialect) -> String {
        let (header, time, stamp) = match dialect {
            Dialect::Ros1 => ("Header header\n", "uint32 seq\ntime stamp\nstring frame_id\n", "time stamp\n"),
            Dialect::Ros2 => (
                "std_msgs/Header header\n",
                "builtin_interfaces/Time stamp\nstring frame_id\n",
                "builtin_interfaces/Time stamp\n",
            ),
        };
        match self {
            Self::Packet => PACKET.into(),
            Self::Text => TEXT.into(),
            Self::Transforms | Self::Poses => {
                let mut text = format!(
                    "geometry_msgs/TransformStamped[] transforms\n{LINE}MSG: geometry_msgs/TransformStamped\n{header}\
                     string child_frame_id\ngeometry_msgs/Transform transform\n{LINE}MSG: std_msgs/Header\n{time}{LINE}\
                     MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n{LINE}\
                     MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n{LINE}\
                     MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
                );
                if dialect == Dialect::Ros2 {
                    text += LINE;
                    text += "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
                }
                text
            }
            Self::Scan => {
                let mut text = format!(
                    "{header}VelodynePacket[] packets\n{LINE}MSG: std_msgs/Header\n{time}{LINE}MSG: velodyne_msgs/VelodynePacket\n\
                     {stamp}uint8[1206] data\n"
                );
                if dialect == Dialect::Ros2 {
                    text += LINE;
                    text += "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
                }
                text
            }
        }
    }
}

/// A message being written.
pub(super) struct Message {
    dialect: Dialect,
    pub bytes: Vec<u8>,
}

impl Message {
    pub fn new(dialect: Dialect) -> Self {
        let bytes = match dialect {
            Dialect::Ros1 => Vec::new(),
            Dialect::Ros2 => vec![0, 1, 0, 0], // CDR, little-endian
        };
        Self { dialect, bytes }
    }

    fn u32(&mut self, value: u32) {
        if self.dialect == Dialect::Ros2 {
            // aligned from behind the first four bytes, which are as long
            self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        }
        self.bytes.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        if self.dialect == Dialect::Ros2 {
            self.bytes.resize((self.bytes.len() - 4).next_multiple_of(8) + 4, 0);
        }
        self.bytes.extend(value.to_le_bytes());
    }

    fn time(&mut self, time_ns: u64) {
        self.u32((time_ns / 1_000_000_000) as u32); // till 2106
        self.u32((time_ns % 1_000_000_000) as u32);
    }

    fn counted(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32); // a datagram, or a text read from a file
        self.bytes.extend_from_slice(bytes);
    }

    fn string(&mut self, text: &str) {
        match self.dialect {
            Dialect::Ros1 => self.counted(text.as_bytes()),
            Dialect::Ros2 => self.counted(&[text.as_bytes(), b"\0"].concat()),
        }
    }

    pub fn packet(dialect: Dialect, payload: &[u8]) -> Vec<u8> {
        let mut message = Self::new(dialect);
        message.counted(payload);
        message.bytes
    }

    pub fn text(dialect: Dialect, text: &str) -> Vec<u8> {
        let mut message = Self::new(dialect);
        message.string(text);
        message.bytes
    }

    /// Frames and where they sit in their parents.
    pub fn transforms(dialect: Dialect, time_ns: u64, frames: &[NamedFrame]) -> Vec<u8> {
        let mut message = Self::new(dialect);
        message.u32(frames.len() as u32); // of few sensors
        for NamedFrame { name, parent, parent_from_frame } in frames {
            if dialect == Dialect::Ros1 {
                message.u32(0);
            }
            message.time(time_ns);
            message.string(parent);
            message.string(name);
            let (translation_m, rotation) = (parent_from_frame.translation_m, parent_from_frame.rotation);
            translation_m
                .to_array()
                .into_iter()
                .chain(rotation.to_array())
                .for_each(|value| message.f64(value));
        }
        message.bytes
    }

    /// Packets with their times; the header's is that of the last, as the driver's default.
    pub fn scan(dialect: Dialect, sequence: u32, frame_id: &str, packets: &[(u64, Vec<u8>)]) -> Vec<u8> {
        let mut message = Self::new(dialect);
        if dialect == Dialect::Ros1 {
            message.u32(sequence);
        }
        message.time(packets.last().map_or(0, |(time_ns, _)| *time_ns));
        message.string(frame_id);
        message.u32(packets.len() as u32); // a revolution's
        for (time_ns, payload) in packets {
            message.time(*time_ns);
            message.bytes.extend_from_slice(payload);
        }
        message.bytes
    }
}
