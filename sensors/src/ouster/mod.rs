//! Ouster OS0, OS1, OS2 and OSDome: lidar, IMU and zone packets, metadata, encode and decode.

/// One inertial sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Device time, ns.
    pub time_ns: u64,
    /// Acceleration, m/s^2, sensor frame.
    pub acceleration_m_s2: [f64; 3],
    /// Angular rate, rad/s, sensor frame.
    pub angular_rate_rad_s: [f64; 3],
}

/// One zone-monitor packet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneReport {}
