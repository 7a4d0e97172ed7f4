//! What a topic is for, by the type of its messages.

use super::Topic;

/// What the messages of a topic hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A packet of an Ouster.
    OusterPacket,
    /// The metadata of an Ouster, as text.
    OusterMetadata,
    /// Packets of a Velodyne, each with its stamp.
    VelodyneScan,
    /// One packet of a Velodyne.
    VelodynePacket,
    /// Packets of a maker that are not read.
    OtherPackets(&'static str),
    /// A cloud of points.
    Cloud,
    /// A cloud of points of a Livox.
    LivoxCloud,
    /// Transforms between frames.
    Transforms,
    /// Poses of one frame in another.
    Poses,
    /// Anything else.
    Other,
}

impl Role {
    /// By a topic's type, and of the text topics by its name.
    pub fn of(topic: &Topic) -> Self {
        let (package, name) = topic.kind.split_once('/').unwrap_or(("", &topic.kind));
        let last = topic.name.rsplit('/').next().unwrap_or_default();
        match (package, name) {
            ("ouster_ros" | "ouster_msgs" | "ouster_sensor_msgs", "PacketMsg") => Self::OusterPacket,
            ("std_msgs", "String") if last == "metadata" || last.ends_with("_metadata") => {
                Self::OusterMetadata
            }
            ("velodyne_msgs", "VelodyneScan") => Self::VelodyneScan,
            ("velodyne_msgs", "VelodynePacket") => Self::VelodynePacket,
            ("pandar_msgs" | "hesai_ros_driver" | "hesai_lidar", _) => Self::OtherPackets("Hesai"),
            ("rslidar_msg" | "rslidar_msgs" | "robosense_msgs", _) => Self::OtherPackets("RoboSense"),
            ("nebula_msgs", "NebulaPackets" | "NebulaPacket") => {
                Self::OtherPackets("nebula's (Hesai, Continental or another)")
            }
            ("sensor_msgs", "PointCloud2") => Self::Cloud,
            ("livox_ros_driver" | "livox_ros_driver2" | "livox_interfaces", "CustomMsg") => Self::LivoxCloud,
            ("tf2_msgs", "TFMessage") | ("tf", "tfMessage") => Self::Transforms,
            ("nav_msgs", "Odometry" | "Path")
            | ("geometry_msgs", "PoseStamped" | "PoseWithCovarianceStamped") => Self::Poses,
            _ => Self::Other,
        }
    }

    /// Whether packets are read from it.
    pub fn has_packets(self) -> bool {
        matches!(self, Self::OusterPacket | Self::VelodyneScan | Self::VelodynePacket)
    }
}
