//! Sixteen pixels at a time in the registers of AVX-512: a pixel is one to five 32-bit words and every field lies in
//! one of them, so that the words are sorted by their place in the pixel first. All but [`unpack`] is inlined into it.

#![allow(unsafe_code)] // instructions of AVX-512, in a function that runs only once the CPU was asked for them

use std::arch::x86_64::*;

use super::super::profile::{Bits, ReturnLayout};
use super::{Table, unpack_here};
use crate::Layer;

const PIXELS: usize = 16;
const MOST_WORDS: usize = 5;

/// As [`unpack_here`]; whole groups of pixels here, the rest there.
///
/// # Safety
/// The CPU has AVX-512 F.
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn unpack<const P: usize, const BYTES: usize>(
    blocks: &[u8],
    at: usize,
    first: &mut Layer,
    mut second: Option<&mut Layer>,
) {
    let layout = const { Table::<P, BYTES>::LAYOUT };
    let groups = if layout.raw_words { 0 } else { blocks.len() / (PIXELS * BYTES) };
    for group in 0..groups {
        let at = at + group * PIXELS;
        let words = sorted_words::<BYTES>(&blocks[group * PIXELS * BYTES..][..PIXELS * BYTES]);
        unpack_return(&words, at, first, const { Table::<P, BYTES>::FIRST });
        if const { Table::<P, BYTES>::LAYOUT.is_dual() }
            && let Some(second) = &mut second
        {
            unpack_return(&words, at, second, const { Table::<P, BYTES>::SECOND });
        }
    }
    let done = groups * PIXELS;
    if done * BYTES < blocks.len() {
        unpack_here::<P, BYTES>(&blocks[done * BYTES..], at + done, first, second);
    }
}

/// Word by word: the first of all pixels, the second of all pixels ...
#[inline(always)]
fn sorted_words<const BYTES: usize>(blocks: &[u8]) -> [__m512i; MOST_WORDS] {
    assert!(blocks.len() == PIXELS * BYTES && BYTES <= 4 * MOST_WORDS);
    // SAFETY: in a function for AVX-512.
    let mut words = [unsafe { _mm512_setzero_si512() }; MOST_WORDS];
    for (place, sorted) in words.iter_mut().enumerate().take(BYTES / 4) {
        for register in 0..BYTES / 4 {
            // SAFETY: as many registers as the pixels have words, by the assertion.
            let loaded = unsafe { _mm512_loadu_si512(blocks.as_ptr().add(64 * register).cast()) };
            // SAFETY: sixteen numbers.
            let order = unsafe { _mm512_loadu_si512(Order::<BYTES>::OF[place][register].as_ptr().cast()) };
            // SAFETY: in a function for AVX-512.
            let merged = || unsafe { _mm512_permutex2var_epi32(*sorted, order, loaded) };
            *sorted = if BYTES == 4 { loaded } else { merged() };
        }
    }
    words
}

/// Which elements are replaced when a register is merged into the words of one column: the others stay.
struct Order<const BYTES: usize>;

impl<const BYTES: usize> Order<BYTES> {
    const OF: [[[i32; PIXELS]; MOST_WORDS]; MOST_WORDS] = {
        let mut order = [[[0; PIXELS]; MOST_WORDS]; MOST_WORDS];
        let (mut place, words) = (0, BYTES / 4);
        while place < words {
            let mut register = 0;
            while register < words {
                let mut pixel = 0;
                while pixel < PIXELS {
                    let word = pixel * words + place;
                    let is_here = word / PIXELS == register;
                    order[place][register][pixel] =
                        if is_here { PIXELS + word % PIXELS } else { pixel } as i32;
                    pixel += 1;
                }
                register += 1;
            }
            place += 1;
        }
        order
    };
}

#[inline(always)]
fn unpack_return(words: &[__m512i; MOST_WORDS], at: usize, out: &mut Layer, layout: ReturnLayout) {
    if layout.range.is_there()
        && let Some(out) = group(&mut out.range_mm, at)
    {
        // SAFETY: sixteen numbers.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), field(words, layout.range)) };
    }
    bytes(words, layout.flags, at, &mut out.flags);
    bytes(words, layout.reflectivity, at, &mut out.reflectivity);
    bytes(words, layout.window, at, &mut out.window);
    halves(words, layout.signal, at, &mut out.signal);
    halves(words, layout.near_ir, at, &mut out.near_ir);
    halves(words, layout.zone_mask, at, &mut out.zone_mask);
    if layout.rgb[0].is_there()
        && let Some(out) = group(&mut out.rgb, at)
    {
        let mut colours = [[0; PIXELS]; 3];
        for (colour, bits) in colours.iter_mut().zip(layout.rgb) {
            // SAFETY: sixteen numbers.
            unsafe {
                let narrow = _mm512_cvtepi32_epi16(field(words, bits));
                _mm256_storeu_si256(colour.as_mut_ptr().cast(), narrow);
            }
        }
        for (pixel, out) in out.iter_mut().enumerate() {
            *out = colours.map(|colour| colour[pixel]);
        }
    }
}

#[inline(always)]
fn bytes(words: &[__m512i; MOST_WORDS], bits: Bits, at: usize, out: &mut [u8]) {
    if bits.is_there()
        && let Some(out) = group(out, at)
    {
        // SAFETY: sixteen numbers.
        unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), _mm512_cvtepi32_epi8(field(words, bits))) };
    }
}

#[inline(always)]
fn halves(words: &[__m512i; MOST_WORDS], bits: Bits, at: usize, out: &mut [u16]) {
    if bits.is_there()
        && let Some(out) = group(out, at)
    {
        // SAFETY: sixteen numbers.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), _mm512_cvtepi32_epi16(field(words, bits))) };
    }
}

/// One field of sixteen pixels, scaled; the profiles' test makes sure that it lies in one word.
#[inline(always)]
fn field(words: &[__m512i; MOST_WORDS], bits: Bits) -> __m512i {
    let word = words[usize::from(bits.at / 32)];
    // SAFETY: in a function for AVX-512.
    unsafe {
        let shifted = _mm512_srl_epi32(word, _mm_cvtsi32_si128(i32::from(bits.at % 32)));
        let masked = _mm512_and_si512(shifted, _mm512_set1_epi32(bits.mask() as i32));
        match bits.scale {
            1 => masked,
            scale => _mm512_mullo_epi32(masked, _mm512_set1_epi32(i32::from(scale))),
        }
    }
}

#[inline(always)]
fn group<T>(out: &mut [T], at: usize) -> Option<&mut [T; PIXELS]> {
    out.get_mut(at..)?.first_chunk_mut()
}
