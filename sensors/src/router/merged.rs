//! Datagrams merged by a network card or a kernel (generic receive offload): a capture shows them as one, with a
//! payload made of several of one length.

use super::guess::{Guess, has_weight};
use super::{Claims, Router};
use crate::Packet;
use crate::ouster::Claim;
use crate::ouster::imu::LEGACY_BYTES;
use crate::velodyne::wire::{DATA_PACKET_BYTES, POSITION_PACKET_BYTES};

impl Router {
    /// Length of the datagrams that a payload was put together from; none of one that came as it is.
    pub(super) fn merged_bytes(&self, packet: &Packet<'_>, claims: Claims) -> Option<usize> {
        if let (Some((_, Claim::Certain)), _) = claims {
            return None;
        }
        let length = packet.payload.len();
        let is_several = |bytes: usize| bytes > 0 && length > bytes && length.is_multiple_of(bytes);
        let each = |bytes: usize, fits: &dyn Fn(&Packet<'_>) -> bool| {
            let is_part = |payload| fits(&Packet { payload, ..*packet });
            is_several(bytes) && packet.payload.chunks(bytes).all(is_part)
        };
        let velodyne =
            [(DATA_PACKET_BYTES, Guess::VelodyneData), (POSITION_PACKET_BYTES, Guess::VelodynePosition)];
        for (bytes, guess) in velodyne {
            if each(bytes, &|part| Guess::of_velodyne(part.payload).as_ref() == Some(&guess)) {
                return Some(bytes);
            }
        }
        let is_inertial = |part: &Packet<'_>| {
            has_weight(part.payload) && Guess::of(part.payload) == Guess::OusterImu { header: None }
        };
        if each(LEGACY_BYTES, &is_inertial) {
            return Some(LEGACY_BYTES);
        }
        let mut ousters = self.sensors.iter().filter_map(|sensor| sensor.lidar_bytes().zip(Some(sensor)));
        ousters
            .find(|(bytes, sensor)| each(*bytes, &|part| sensor.claim(part) > Claim::No))
            .map(|(bytes, _)| bytes)
    }
}
