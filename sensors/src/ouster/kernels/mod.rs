//! Pixel blocks to arrays and back: one pair of functions per profile, made by the compiler from the profile's
//! table, so that every shift and mask is a constant in the inner loop.

#![allow(unsafe_code)] // calls the AVX-512 and AVX2 builds of the inner loops once the CPU was asked for them

#[cfg(target_arch = "x86_64")]
mod avx512;

#[cfg(target_arch = "x86_64")]
use std::arch::is_x86_feature_detected;

use super::profile::{Bits, LAYOUTS, Layout, Profile, ReturnLayout};
use super::wire::Columns;
use crate::Layer;

/// Takes the pixel blocks of neighbouring columns apart into the layers, at sample `at` and onward.
pub(super) type Unpack = fn(columns: Columns<'_>, at: usize, first: &mut Layer, second: Option<&mut Layer>);

/// Puts the samples from `at` onward into pixel blocks; every byte is written. Arrays that are missing count as zeros;
/// without the raw words of a raw profile its words are made of the fields.
pub(super) type Pack = fn(blocks: &mut [u8], at: usize, first: &Layer, second: Option<&Layer>);

/// The pair of functions of a profile.
#[derive(Clone, Copy)]
pub(super) struct Kernels {
    pub(super) unpack: Unpack,
    pub(super) pack: Pack,
}

/// By profile. A const parameter cannot give an array length, so the block length stands here a second time; the
/// compiler checks it against the table.
pub(super) fn kernels(profile: Profile) -> Kernels {
    const fn of<const P: usize, const BYTES: usize>() -> Kernels {
        Kernels { unpack: unpack::<P, BYTES>, pack: pack::<P, BYTES> }
    }
    match profile {
        Profile::Legacy => of::<0, 12>(),
        Profile::Rng19Rfl8Sig16Nir16 => of::<1, 12>(),
        Profile::Rng19Rfl8Sig16Nir16Dual => of::<2, 16>(),
        Profile::Rng15Rfl8Nir8 => of::<3, 4>(),
        Profile::Rng15Rfl8Nir8Dual => of::<4, 8>(),
        Profile::FusaRng15Rfl8Nir8Dual => of::<5, 8>(),
        Profile::Rng15Rfl8Nir8Zone16 => of::<6, 8>(),
        Profile::Rng19Rfl8Sig16Nir16Zone16 => of::<7, 12>(),
        Profile::Rng19Rfl8Sig16Zone16Dual => of::<8, 16>(),
        Profile::Rng15Rfl8Win8 => of::<9, 4>(),
        Profile::Rng19Rfl8Sig16Nir16Rgb16 => of::<10, 16>(),
        Profile::Rng19Rfl8Sig16Nir16Rgb16Dual => of::<11, 20>(),
        Profile::FiveWordPixel => of::<12, 20>(),
        Profile::Off => Kernels { unpack: |_, _, _, _| {}, pack: |_, _, _, _| {} },
    }
}

struct Table<const P: usize, const BYTES: usize>;

impl<const P: usize, const BYTES: usize> Table<P, BYTES> {
    const LAYOUT: Layout = {
        assert!(LAYOUTS[P].bytes == BYTES, "the block length of the table and of the list differ");
        LAYOUTS[P]
    };
    const FIRST: ReturnLayout = Self::LAYOUT.first;
    const SECOND: ReturnLayout = Self::LAYOUT.second;
}

fn unpack<const P: usize, const BYTES: usize>(
    columns: Columns<'_>,
    at: usize,
    first: &mut Layer,
    second: Option<&mut Layer>,
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2<const P: usize, const BYTES: usize>(
            columns: Columns<'_>,
            at: usize,
            first: &mut Layer,
            second: Option<&mut Layer>,
        ) {
            unpack_here::<P, BYTES>(columns, at, first, second);
        }
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw") {
            // SAFETY: the CPU has the features the function is compiled for.
            unsafe { avx512::unpack::<P, BYTES>(columns, at, first, second) };
            return;
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the CPU has the feature the function is compiled for.
            unsafe { with_avx2::<P, BYTES>(columns, at, first, second) };
            return;
        }
    }
    unpack_here::<P, BYTES>(columns, at, first, second);
}

#[inline(always)]
fn unpack_here<const P: usize, const BYTES: usize>(
    columns: Columns<'_>,
    at: usize,
    first: &mut Layer,
    mut second: Option<&mut Layer>,
) {
    for column in 0..columns.count {
        let at = at + column * (columns.length / BYTES);
        unpack_column::<P, BYTES>(columns.blocks(column), at, first, second.as_deref_mut());
    }
}

#[inline(always)]
fn unpack_column<const P: usize, const BYTES: usize>(
    blocks: &[u8],
    at: usize,
    first: &mut Layer,
    second: Option<&mut Layer>,
) {
    let (blocks, _) = blocks.as_chunks::<BYTES>();
    unpack_return(blocks, at, first, Table::<P, BYTES>::FIRST);
    if const { Table::<P, BYTES>::LAYOUT.raw_words } {
        for (block, out) in blocks.iter().zip(&mut first.raw_words[at..]) {
            *out = words(block);
        }
    }
    if const { Table::<P, BYTES>::LAYOUT.is_dual() }
        && let Some(second) = second
    {
        unpack_return(blocks, at, second, Table::<P, BYTES>::SECOND);
    }
}

/// A pixel block as words.
#[inline(always)]
fn words(block: &[u8]) -> [u32; 5] {
    let (quads, _) = block.as_chunks();
    std::array::from_fn(|word| quads.get(word).map_or(0, |quad| u32::from_le_bytes(*quad)))
}

#[inline(always)]
fn unpack_return<const BYTES: usize>(
    blocks: &[[u8; BYTES]],
    at: usize,
    out: &mut Layer,
    layout: ReturnLayout,
) {
    unpack_field(blocks, layout.range, at, &mut out.range_mm, |value| value);
    unpack_field(blocks, layout.flags, at, &mut out.flags, |value| value as u8);
    unpack_field(blocks, layout.reflectivity, at, &mut out.reflectivity, |value| value as u8);
    unpack_field(blocks, layout.window, at, &mut out.window, |value| value as u8);
    unpack_field(blocks, layout.signal, at, &mut out.signal, |value| value as u16);
    unpack_field(blocks, layout.near_ir, at, &mut out.near_ir, |value| value as u16);
    unpack_field(blocks, layout.zone_mask, at, &mut out.zone_mask, |value| value as u16);
    if layout.rgb[0].is_there() {
        for (block, out) in blocks.iter().zip(&mut out.rgb[at..]) {
            *out = layout.rgb.map(|field| get(block, field) as u16);
        }
    }
}

/// One field of all blocks: a loop of its own, so that it becomes vector code.
#[inline(always)]
fn unpack_field<T, const BYTES: usize>(
    blocks: &[[u8; BYTES]],
    field: Bits,
    at: usize,
    out: &mut [T],
    narrow: impl Fn(u32) -> T,
) {
    if field.is_there() {
        let out = &mut out[at..at + blocks.len()];
        for (block, out) in blocks.iter().zip(out) {
            *out = narrow(get(block, field));
        }
    }
}

fn pack<const P: usize, const BYTES: usize>(
    blocks: &mut [u8],
    at: usize,
    first: &Layer,
    second: Option<&Layer>,
) {
    let (blocks, _) = blocks.as_chunks_mut::<BYTES>();
    blocks.fill([0; BYTES]);
    if const { Table::<P, BYTES>::LAYOUT.raw_words } && !first.raw_words.is_empty() {
        for (block, words) in blocks.iter_mut().zip(first.raw_words.iter().skip(at)) {
            let (quads, _) = block.as_chunks_mut::<4>();
            for (quad, word) in quads.iter_mut().zip(words) {
                *quad = word.to_le_bytes();
            }
        }
        return; // the words hold every other field too
    }
    pack_return(blocks, at, first, Table::<P, BYTES>::FIRST);
    if const { Table::<P, BYTES>::LAYOUT.is_dual() }
        && let Some(second) = second
    {
        pack_return(blocks, at, second, Table::<P, BYTES>::SECOND);
    }
}

#[inline(always)]
fn pack_return<const BYTES: usize>(
    blocks: &mut [[u8; BYTES]],
    at: usize,
    from: &Layer,
    layout: ReturnLayout,
) {
    for (offset, block) in blocks.iter_mut().enumerate() {
        let sample = at + offset;
        put(block, layout.range, from.range_mm.get(sample).copied());
        put(block, layout.flags, from.flags.get(sample).copied());
        put(block, layout.reflectivity, from.reflectivity.get(sample).copied());
        put(block, layout.window, from.window.get(sample).copied());
        put(block, layout.signal, from.signal.get(sample).copied());
        put(block, layout.near_ir, from.near_ir.get(sample).copied());
        put(block, layout.zone_mask, from.zone_mask.get(sample).copied());
        for (colour, field) in layout.rgb.into_iter().enumerate() {
            put(block, field, from.rgb.get(sample).map(|rgb| rgb[colour]));
        }
    }
}

/// One field of a block, scaled. The smallest load that holds the field, moved back when it would leave the block.
#[inline(always)]
fn get<const BYTES: usize>(block: &[u8; BYTES], field: Bits) -> u32 {
    let at = field.at as usize;
    let word = match (at % 8 + field.width as usize).div_ceil(8) {
        0 => return 0,
        1 => u32::from(block[at / 8]) >> (at % 8),
        2 => u32::from(u16::from_le_bytes([block[at / 8], block[at / 8 + 1]])) >> (at % 8),
        _ => {
            let start = (at / 8).min(BYTES.saturating_sub(4));
            let bytes = [block[start], block[start + 1], block[start + 2], block[start + 3]];
            u32::from_le_bytes(bytes) >> (at - start * 8)
        }
    };
    (word & field.mask()) * u32::from(field.scale)
}

/// Writes one field into a block of zeros, as the nearest lower count; what does not fit saturates.
#[inline(always)]
fn put<const BYTES: usize>(block: &mut [u8; BYTES], field: Bits, value: Option<impl Into<u32>>) {
    let (true, Some(value)) = (field.is_there(), value) else { return };
    let count = (value.into() / u32::from(field.scale)).min(field.mask());
    let at = field.at as usize;
    let spread = u64::from(count) << (at % 8);
    let bytes = (at % 8 + field.width as usize).div_ceil(8);
    for (byte, part) in block[at / 8..at / 8 + bytes].iter_mut().zip(spread.to_le_bytes()) {
        *byte |= part;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ouster::{Metadata, Synthetic, assembly::blank_frame};

    #[test]
    fn every_build_of_the_inner_loops_agrees() {
        fn check<const P: usize, const BYTES: usize>(profile: Profile) {
            let metadata = Metadata::synthetic(&Synthetic::new("os1-64", 1, profile)).unwrap();
            for (pixels, count) in [(64, 1), (32, 3), (8, 16), (8, 1), (37, 4)] {
                let (length, stride) = (pixels * BYTES, pixels * BYTES + 12);
                let bytes: Vec<u8> =
                    (0..(stride * count) as u32).map(|i| (i.wrapping_mul(0x9E37_79B1) >> 24) as u8).collect();
                let columns = Columns { bytes: &bytes, stride, length, count };
                let [plain, detected] =
                    [unpack_here::<P, BYTES> as Unpack, kernels(profile).unpack].map(|unpack| {
                        let mut frame = blank_frame(&metadata);
                        unpack(columns, 128, &mut frame.first, frame.second.as_mut());
                        frame
                    });
                assert!(plain == detected, "{profile:?}, {count} columns of {pixels} pixels");
                let ranges_mm = &plain.first.range_mm;
                let end = 128 + count * pixels;
                assert!(ranges_mm[128..end].iter().any(|range| *range > 0));
                assert!(ranges_mm[..128].iter().chain(&ranges_mm[end..]).all(|range| *range == 0));
            }
        }
        check::<0, 12>(Profile::Legacy);
        check::<1, 12>(Profile::Rng19Rfl8Sig16Nir16);
        check::<2, 16>(Profile::Rng19Rfl8Sig16Nir16Dual);
        check::<3, 4>(Profile::Rng15Rfl8Nir8);
        check::<4, 8>(Profile::Rng15Rfl8Nir8Dual);
        check::<5, 8>(Profile::FusaRng15Rfl8Nir8Dual);
        check::<6, 8>(Profile::Rng15Rfl8Nir8Zone16);
        check::<7, 12>(Profile::Rng19Rfl8Sig16Nir16Zone16);
        check::<8, 16>(Profile::Rng19Rfl8Sig16Zone16Dual);
        check::<9, 4>(Profile::Rng15Rfl8Win8);
        check::<10, 16>(Profile::Rng19Rfl8Sig16Nir16Rgb16);
        check::<11, 20>(Profile::Rng19Rfl8Sig16Nir16Rgb16Dual);
        check::<12, 20>(Profile::FiveWordPixel);
    }
}
