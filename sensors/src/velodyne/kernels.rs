//! Measurements to arrays: the inner loops of decoding.

#![allow(unsafe_code)] // calls the AVX-512 builds of the inner loops once the CPU was asked for them

use super::wire::DATA_PACKET_BYTES;

/// Lasers of a part come in groups of this many.
pub(super) const GROUP: usize = 16;
const MEASUREMENT_BYTES: usize = 3;

/// Reads measurements (2 bytes of distance, 1 of reflectivity) from byte `at` on into whole groups of lasers. They lie
/// before the six bytes of the trailer.
pub(super) fn unpack(
    packet: &[u8; DATA_PACKET_BYTES],
    at: usize,
    unit_mm: u32,
    range_mm: &mut [u32],
    reflectivity: &mut [u8],
) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512bw") {
        // SAFETY: the CPU has the features the function is compiled for.
        unsafe { avx512::unpack(packet, at, unit_mm, range_mm, reflectivity) };
        return;
    }
    unpack_here(packet, at, unit_mm, range_mm, reflectivity);
}

/// Takes out of the second layer what is no return of its own: a firing with one echo is sent twice, or with an empty
/// second return. `first` and `second` are ranges and reflectivities of whole columns.
pub(super) fn drop_repeated(first: (&[u32], &[u8]), second: (&mut [u32], &mut [u8])) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512bw,avx512vl")]
        fn with_avx512(first: (&[u32], &[u8]), second: (&mut [u32], &mut [u8])) {
            drop_repeated_here(first, second);
        }
        if std::arch::is_x86_feature_detected!("avx512bw") && std::arch::is_x86_feature_detected!("avx512vl")
        {
            // SAFETY: the CPU has the features the function is compiled for.
            unsafe { with_avx512(first, second) };
            return;
        }
    }
    drop_repeated_here(first, second);
}

fn unpack_here(
    packet: &[u8; DATA_PACKET_BYTES],
    at: usize,
    unit_mm: u32,
    range_mm: &mut [u32],
    reflectivity: &mut [u8],
) {
    let (measurements, _) = packet[at..].as_chunks::<MEASUREMENT_BYTES>();
    for ((measurement, range), reflectivity) in measurements.iter().zip(range_mm).zip(reflectivity) {
        *range = u32::from(u16::from_le_bytes([measurement[0], measurement[1]])) * unit_mm;
        *reflectivity = measurement[2];
    }
}

#[inline(always)]
fn drop_repeated_here(first: (&[u32], &[u8]), second: (&mut [u32], &mut [u8])) {
    let ranges = first.0.iter().zip(second.0);
    let reflectivities = first.1.iter().zip(second.1);
    for ((first_range, second_range), (first_level, second_level)) in ranges.zip(reflectivities) {
        let repeated = *first_range == *second_range && *first_level == *second_level;
        let is_own = *second_range != 0 && !repeated;
        *second_range = if is_own { *second_range } else { 0 };
        *second_level = if is_own { *second_level } else { 0 };
    }
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::*;

    use super::{DATA_PACKET_BYTES, GROUP, MEASUREMENT_BYTES};

    /// Distances and reflectivities of four measurements (12 bytes), each as a 32-bit number; -1 is a zero.
    const DISTANCES: [i8; 16] = [0, 1, -1, -1, 3, 4, -1, -1, 6, 7, -1, -1, 9, 10, -1, -1];
    const LEVELS: [i8; 16] = [2, -1, -1, -1, 5, -1, -1, -1, 8, -1, -1, -1, 11, -1, -1, -1];

    #[target_feature(enable = "avx512f,avx512bw")]
    pub(super) fn unpack(
        packet: &[u8; DATA_PACKET_BYTES],
        at: usize,
        unit_mm: u32,
        range_mm: &mut [u32],
        reflectivity: &mut [u8],
    ) {
        let groups =
            range_mm.as_chunks_mut::<GROUP>().0.iter_mut().zip(reflectivity.as_chunks_mut::<GROUP>().0);
        for (group, (range_mm, reflectivity)) in groups.enumerate() {
            let at = at + group * GROUP * MEASUREMENT_BYTES;
            let bytes = &packet[at..at + 3 * 12 + 16]; // four measurements and four bytes more each time
            // SAFETY: reads of 16 bytes from 0, 12, 24 and 36 of 52; writes of sixteen numbers each.
            unsafe {
                let four = |number: usize| _mm_loadu_si128(bytes.as_ptr().add(12 * number).cast());
                let measurements = _mm512_inserti32x4::<1>(_mm512_castsi128_si512(four(0)), four(1));
                let measurements = _mm512_inserti32x4::<2>(measurements, four(2));
                let measurements = _mm512_inserti32x4::<3>(measurements, four(3));
                let [distances, levels] = [&DISTANCES, &LEVELS].map(|order| {
                    let order = _mm512_broadcast_i32x4(_mm_loadu_si128(order.as_ptr().cast()));
                    _mm512_shuffle_epi8(measurements, order)
                });
                let ranges = _mm512_mullo_epi32(distances, _mm512_set1_epi32(unit_mm as i32));
                _mm512_storeu_si512(range_mm.as_mut_ptr().cast(), ranges);
                _mm_storeu_si128(reflectivity.as_mut_ptr().cast(), _mm512_cvtepi32_epi8(levels));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::velodyne::wire::BLOCKS;

    #[test]
    fn every_build_of_the_inner_loops_agrees() {
        let packet: [u8; DATA_PACKET_BYTES] =
            std::array::from_fn(|at| ((at as u32).wrapping_mul(0x9E37_79B1) >> 24) as u8);
        for (block, lasers, slot) in [(0, 32, 0), (3, 16, 0), (3, 16, 16), (BLOCKS - 1, 32, 0)] {
            let at = block * 100 + 4 + 3 * slot;
            let mut found = [unpack_here, unpack].map(|unpack| {
                let (mut range_mm, mut reflectivity) = (vec![7; lasers], vec![7; lasers]);
                unpack(&packet, at, 4, &mut range_mm, &mut reflectivity);
                (range_mm, reflectivity)
            });
            assert_eq!(found[0], found[1]);
            let (ranges_mm, levels) = found[0].clone();
            // a repeated firing, an empty one, and one that differs in one of both
            found[1].0[3] = 0;
            found[1].0[4] += 4;
            found[1].1[5] ^= 1;
            let second = found[1].clone();
            let [plain, detected] = [drop_repeated_here, drop_repeated].map(|drop_repeated| {
                let (mut range_mm, mut reflectivity) = second.clone();
                drop_repeated((&ranges_mm, &levels), (&mut range_mm, &mut reflectivity));
                (range_mm, reflectivity)
            });
            assert_eq!(plain, detected);
            let own: Vec<usize> = (0..lasers).filter(|laser| plain.0[*laser] > 0).collect();
            assert_eq!(own, [4, 5]);
        }
    }
}
