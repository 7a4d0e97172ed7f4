//! Frames, inertial samples and zone reports to the packets a sensor would have sent.

use super::imu::{self, ImuSample};
use super::kernels::{Kernels, kernels};
use super::metadata::Metadata;
use super::profile::Profile;
use super::wire::{ColumnHeader, Header, NO_CRC, PacketFormat, PacketKind, write_crc};
use super::zones::{self, ZoneReport};
use crate::{Frame, Health};

/// What goes where the checksum belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// CRC-64 over the packet, as firmware 3.2 on writes it.
    Crc64,
    /// The constant of firmware 2.3 to 2.4.
    Constant,
    /// Zeros, as firmware 2.2 writes them.
    Zero,
}

/// Makes the UDP payloads of one sensor.
pub struct OusterEncoder {
    metadata: Metadata,
    format: PacketFormat,
    kernels: Kernels,
    checksum: Checksum,
    /// What IMU and zone packets say about the sensor; lidar packets say what their frame says.
    pub health: Health,
    packet: Vec<u8>,
}

impl OusterEncoder {
    /// An encoder that writes valid checksums.
    pub fn new(metadata: Metadata) -> Self {
        Self {
            format: metadata.packet_format(),
            kernels: kernels(metadata.profile),
            checksum: Checksum::Crc64,
            health: Health::default(),
            packet: Vec::new(),
            metadata,
        }
    }

    /// With another checksum.
    pub fn with_checksum(mut self, checksum: Checksum) -> Self {
        self.checksum = checksum;
        self
    }

    /// The sensor's metadata.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Lidar packets of a frame, in the order of columns. A packet of which no column came (all times 0) is left
    /// out. Ranges are rounded down to the format's step and saturate at its end. Arrays that a layer does not have, and
    /// a second layer that is not there, are sent as zeros. The frame must have the columns and channels of the metadata.
    pub fn frame(&mut self, frame: &Frame, emit: &mut dyn FnMut(&[u8])) {
        assert_eq!(
            (frame.columns(), frame.channels),
            (self.metadata.columns_per_frame, self.metadata.pixels_per_column),
            "the frame has the shape of the metadata"
        );
        let per_packet = self.format.columns_per_packet;
        for slot in 0..self.metadata.packet_slots() {
            let columns = slot * per_packet..((slot + 1) * per_packet).min(frame.columns());
            let came =
                columns.clone().any(|column| frame.column_valid[column] || frame.column_time_ns[column] > 0);
            if came && self.metadata.profile != Profile::Off {
                self.lidar(frame, columns);
                emit(&self.packet);
            }
        }
    }

    /// One IMU packet. LEGACY packets hold the first sample only; ACCEL32 packets as many as the metadata says.
    pub fn imu(
        &mut self,
        frame_id: u32,
        samples: &[ImuSample],
        columns: &[u16],
        nmea: Option<(u64, &str)>,
    ) -> &[u8] {
        self.packet.clear();
        if self.metadata.imu_profile == super::ImuProfile::Legacy {
            if let Some(sample) = samples.first() {
                self.packet.extend_from_slice(&imu::write_legacy(sample));
            }
            return &self.packet;
        }
        self.packet.resize(imu::accel32_bytes(self.metadata.imu_samples_per_packet), 0);
        self.header(PacketKind::Imu, frame_id, self.health);
        let held = &samples[..samples.len().min(self.metadata.imu_samples_per_packet)];
        imu::write_accel32(&mut self.packet, held, columns, nmea);
        self.footer();
        &self.packet
    }

    /// One zone-monitor packet.
    pub fn zones(&mut self, report: &ZoneReport) -> &[u8] {
        self.packet.clear();
        self.packet.resize(zones::PACKET_BYTES, 0);
        self.header(PacketKind::Zone, report.frame_id, self.health);
        zones::write(report, &mut self.packet);
        self.footer();
        &self.packet
    }

    fn lidar(&mut self, frame: &Frame, columns: std::ops::Range<usize>) {
        self.packet.clear();
        self.packet.resize(self.format.packet_bytes(), 0);
        if self.metadata.profile.has_packet_header() {
            self.header(PacketKind::Lidar, frame.frame_id, frame.health);
        }
        let first_column = columns.start;
        for index in 0..self.format.columns_per_packet {
            let column = first_column + index;
            let valid = columns.contains(&column) && frame.column_valid[column];
            let header = ColumnHeader {
                time_ns: frame.column_time_ns.get(column).copied().unwrap_or(0),
                measurement_id: column as u16,
                valid,
            };
            let bytes = self.format.column_mut(&mut self.packet, index);
            self.format.write_column(bytes, header, frame.frame_id, self.metadata.columns_per_frame);
            if valid {
                let at = frame.index(column, 0);
                (self.kernels.pack)(self.format.blocks_mut(bytes), at, &frame.first, frame.second.as_ref());
            }
        }
        if self.metadata.profile.has_packet_header() {
            self.footer();
        }
    }

    fn header(&mut self, kind: PacketKind, frame_id: u32, health: Health) {
        let serial = self.metadata.serial_number().unwrap_or(0);
        let header = Header { kind, frame_id, init_id: self.metadata.init_id, serial, health };
        header.write(self.metadata.header, &mut self.packet);
    }

    fn footer(&mut self) {
        match self.checksum {
            Checksum::Crc64 => write_crc(&mut self.packet),
            Checksum::Constant => {
                if let Some(place) = self.packet.last_chunk_mut() {
                    *place = NO_CRC.to_le_bytes();
                }
            }
            Checksum::Zero => {}
        }
    }
}
