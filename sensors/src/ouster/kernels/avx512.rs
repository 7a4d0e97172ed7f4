//! Sixteen pixels at a time in the registers of AVX-512: a pixel is one to five 32-bit words and every field lies in
//! one of them, so that the words are sorted by their place in the pixel first. All but [`unpack`] is inlined into it.

#![allow(unsafe_code)] // instructions of AVX-512, in a function that runs only once the CPU was asked for them

use std::arch::x86_64::*;

use super::super::profile::{Bits, ReturnLayout};
use super::super::wire::Columns;
use super::{Table, unpack_column};
use crate::Layer;

const PIXELS: usize = 16;
const MOST_WORDS: usize = 5;

/// As [`super::unpack_here`]; whole groups of pixels here, the rest as there.
///
/// # Safety
/// The CPU has AVX-512 F and BW.
#[target_feature(enable = "avx512f,avx512bw")]
pub(super) unsafe fn unpack<const P: usize, const BYTES: usize>(
    columns: Columns<'_>,
    at: usize,
    first: &mut Layer,
    mut second: Option<&mut Layer>,
) {
    let pixels = columns.length / BYTES;
    if pixels.is_multiple_of(PIXELS) {
        for column in 0..columns.count {
            let at = at + column * pixels;
            for (group, blocks) in columns.blocks(column).chunks_exact(PIXELS * BYTES).enumerate() {
                unpack_group::<P, BYTES>(blocks, at + group * PIXELS, first, second.as_deref_mut());
            }
        }
        return;
    }
    // columns lie one behind the other in the layers: a group may begin in one and end in another
    let mut buffer = [0; PIXELS * 4 * MOST_WORDS];
    let (mut column, mut done) = (0, 0);
    for from in (0..pixels * columns.count).step_by(PIXELS) {
        let mut length = 0;
        while length < PIXELS * BYTES && column < columns.count {
            let left = &columns.blocks(column)[done..pixels * BYTES];
            let step = left.len().min(PIXELS * BYTES - length);
            buffer[length..length + step].copy_from_slice(&left[..step]);
            (length, done) = (length + step, done + step);
            if done == pixels * BYTES {
                (column, done) = (column + 1, 0);
            }
        }
        let second = second.as_deref_mut();
        match length == PIXELS * BYTES {
            true => unpack_group::<P, BYTES>(&buffer[..PIXELS * BYTES], at + from, first, second),
            false => unpack_column::<P, BYTES>(&buffer[..length], at + from, first, second),
        }
    }
}

#[inline(always)]
fn unpack_group<const P: usize, const BYTES: usize>(
    blocks: &[u8],
    at: usize,
    first: &mut Layer,
    second: Option<&mut Layer>,
) {
    let words = sorted_words::<BYTES>(blocks);
    unpack_return(&words, at, first, const { Table::<P, BYTES>::FIRST });
    if const { Table::<P, BYTES>::LAYOUT.raw_words }
        && let Some(out) = group(&mut first.raw_words, at)
    {
        for (block, out) in blocks.as_chunks::<BYTES>().0.iter().zip(out) {
            *out = super::words(block);
        }
    }
    if const { Table::<P, BYTES>::LAYOUT.is_dual() }
        && let Some(second) = second
    {
        unpack_return(&words, at, second, const { Table::<P, BYTES>::SECOND });
    }
}

/// Word by word: the first of all pixels, the second of all pixels ...
#[inline(always)]
fn sorted_words<const BYTES: usize>(blocks: &[u8]) -> [__m512i; MOST_WORDS] {
    assert!(blocks.len() == PIXELS * BYTES && BYTES <= 4 * MOST_WORDS);
    // SAFETY: in a function for AVX-512.
    let mut words = [unsafe { _mm512_setzero_si512() }; MOST_WORDS];
    let mut registers = words;
    for (number, register) in registers.iter_mut().enumerate().take(BYTES / 4) {
        // SAFETY: as many registers as the pixels have words, by the assertion.
        *register = unsafe { _mm512_loadu_si512(blocks.as_ptr().add(64 * number).cast()) };
    }
    for (place, sorted) in words.iter_mut().enumerate().take(BYTES / 4) {
        *sorted = registers[0];
        for (number, register) in registers.iter().enumerate().take(BYTES / 4).skip(1) {
            // SAFETY: sixteen numbers, in a function for AVX-512.
            *sorted = unsafe {
                let order = _mm512_loadu_si512(Order::<BYTES>::OF[place][number].as_ptr().cast());
                _mm512_permutex2var_epi32(*sorted, order, *register)
            };
        }
    }
    words
}

/// Which elements come from a register that is merged into the words of one place, and which from those merged before:
/// the first register is taken as it is.
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
                    let is_first = register == 1 && word < PIXELS;
                    order[place][register][pixel] = match (is_here, is_first) {
                        (true, _) => PIXELS + word % PIXELS,
                        (_, true) => word,
                        _ => pixel,
                    } as i32;
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
        let [low, high] = [0, 1].map(|more| words[usize::from(layout.rgb[0].at / 32) + more]);
        let order = if layout.rgb[0].at.is_multiple_of(32) { &EVEN_HALVES } else { &ODD_HALVES };
        // SAFETY: 48 numbers, of which each order names 32 or, the second, 16.
        unsafe {
            let [start, end] = [0, 1].map(|half: usize| _mm512_loadu_si512(order[half].as_ptr().cast()));
            let out = out.as_mut_ptr().cast::<u8>();
            _mm512_storeu_si512(out.cast(), _mm512_permutex2var_epi16(low, start, high));
            let rest = _mm512_castsi512_si256(_mm512_permutex2var_epi16(low, end, high));
            _mm256_storeu_si256(out.add(64).cast(), rest);
        }
    }
}

/// Which halves of two sorted words make the three numbers of each pixel, one pixel behind the other; they begin in the
/// lower half of the first word, or in the upper.
const EVEN_HALVES: [[i16; 32]; 2] = halves_of_three(0);
const ODD_HALVES: [[i16; 32]; 2] = halves_of_three(1);

const fn halves_of_three(begin: usize) -> [[i16; 32]; 2] {
    let mut order = [[0; 32]; 2];
    let mut number = 0;
    while number < 3 * PIXELS {
        let (pixel, half) = (number / 3, begin + number % 3);
        order[number / 32][number % 32] = (half / 2 * 32 + 2 * pixel + half % 2) as i16;
        number += 1;
    }
    order
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
