//! Vector elements in the registers of AVX-512. Everything is inlined into a function compiled for it, and called from
//! nowhere else.

#![allow(unsafe_code)] // instructions of AVX-512, for functions that run only once the CPU was asked for them

use std::arch::x86_64::*;

use super::{BLOCK, Elements};

/// Which element of two registers each element of the `third`th register of three takes, when points are put behind one
/// another: of x and y, then of that and z.
const fn order<const WIDTH: usize>(third: usize, of_xy: bool) -> [i64; WIDTH] {
    let mut order = [0; WIDTH];
    let mut element = 0;
    while element < WIDTH {
        let (point, axis) = ((third * WIDTH + element) / 3, (third * WIDTH + element) % 3);
        order[element] = match (of_xy, axis) {
            (true, 0) => point,
            (true, _) => WIDTH + point,
            (false, 2) => WIDTH + point,
            (false, _) => element,
        } as i64;
        element += 1;
    }
    // a z among x and y is replaced in the second step; it must name a element all the same
    let mut element = 0;
    while element < WIDTH {
        if order[element] >= 2 * WIDTH as i64 {
            order[element] = 0;
        }
        element += 1;
    }
    order
}

const fn narrow(order: [i64; 16]) -> [i32; 16] {
    let mut narrow = [0; 16];
    let mut element = 0;
    while element < 16 {
        narrow[element] = order[element] as i32;
        element += 1;
    }
    narrow
}

const SINGLE: [[[i32; 16]; 2]; 3] = [
    [narrow(order(0, true)), narrow(order(0, false))],
    [narrow(order(1, true)), narrow(order(1, false))],
    [narrow(order(2, true)), narrow(order(2, false))],
];
const DOUBLE: [[[i64; 8]; 2]; 3] =
    [[order(0, true), order(0, false)], [order(1, true), order(1, false)], [order(2, true), order(2, false)]];

impl Elements for __m512 {
    type Real = f32;
    const WIDTH: usize = 16;

    #[inline(always)]
    fn load(block: &[f32; BLOCK], _: usize) -> Self {
        // SAFETY: 16 numbers, in a function for AVX-512.
        unsafe { _mm512_loadu_ps(block.as_ptr()) }
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_set1_ps(value) }
    }

    #[inline(always)]
    fn metres(range_mm: &[u32; BLOCK], _: usize) -> Self {
        // SAFETY: 16 numbers, in a function for AVX-512.
        unsafe {
            let range_mm = _mm512_cvtepi32_ps(_mm512_loadu_si512(range_mm.as_ptr().cast()));
            _mm512_mul_ps(range_mm, _mm512_set1_ps(1e-3))
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_sub_ps(self, other) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_mul_ps(self, other) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_abs_ps(self) }
    }

    #[inline(always)]
    fn where_below(self, range_mm: &[u32; BLOCK], _: usize, limit_mm: u32) -> Self {
        // SAFETY: 16 numbers, in a function for AVX-512.
        unsafe {
            let range_mm = _mm512_loadu_si512(range_mm.as_ptr().cast());
            let below = _mm512_cmplt_epu32_mask(range_mm, _mm512_set1_epi32(limit_mm as i32));
            _mm512_maskz_mov_ps(below, self)
        }
    }

    #[inline(always)]
    fn any(range_mm: &[u32; BLOCK], _: usize) -> bool {
        // SAFETY: 16 numbers, in a function for AVX-512.
        unsafe {
            let range_mm = _mm512_loadu_si512(range_mm.as_ptr().cast());
            _mm512_test_epi32_mask(range_mm, range_mm) != 0
        }
    }

    #[inline(always)]
    fn store(point: [Self; 3], range_mm: &[u32; BLOCK], _: usize, out: &mut [[f32; 3]; BLOCK]) {
        // SAFETY: 16 ranges and 48 numbers of 16 points, in a function for AVX-512.
        unsafe {
            let range_mm = _mm512_loadu_si512(range_mm.as_ptr().cast());
            let there = _mm512_test_epi32_mask(range_mm, range_mm);
            let [x, y, z] = point.map(|axis| _mm512_maskz_mov_ps(there, axis));
            for (third, [of_xy, of_z]) in SINGLE.iter().enumerate() {
                let [of_xy, of_z] = [of_xy, of_z].map(|order| _mm512_loadu_si512(order.as_ptr().cast()));
                let xy = _mm512_permutex2var_ps(x, of_xy, y);
                let xyz = _mm512_permutex2var_ps(xy, of_z, z);
                _mm512_storeu_ps(out.as_mut_ptr().cast::<f32>().add(16 * third), xyz);
            }
        }
    }
}

impl Elements for __m512d {
    type Real = f64;
    const WIDTH: usize = 8;

    #[inline(always)]
    fn load(block: &[f64; BLOCK], at: usize) -> Self {
        assert!(at + 8 <= BLOCK);
        // SAFETY: 8 numbers from there on, in a function for AVX-512.
        unsafe { _mm512_loadu_pd(block.as_ptr().add(at)) }
    }

    #[inline(always)]
    fn splat(value: f64) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_set1_pd(value) }
    }

    #[inline(always)]
    fn metres(range_mm: &[u32; BLOCK], at: usize) -> Self {
        assert!(at + 8 <= BLOCK);
        // SAFETY: 8 numbers from there on, in a function for AVX-512.
        unsafe {
            let range_mm = _mm512_cvtepi32_pd(_mm256_loadu_si256(range_mm.as_ptr().add(at).cast()));
            _mm512_mul_pd(range_mm, _mm512_set1_pd(1e-3))
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_add_pd(self, other) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_sub_pd(self, other) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_mul_pd(self, other) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_abs_pd(self) }
    }

    #[inline(always)]
    fn where_below(self, range_mm: &[u32; BLOCK], at: usize, limit_mm: u32) -> Self {
        let range_mm = wide(range_mm, at);
        // SAFETY: in a function for AVX-512.
        unsafe {
            let below = _mm512_cmplt_epu64_mask(range_mm, _mm512_set1_epi64(i64::from(limit_mm)));
            _mm512_maskz_mov_pd(below, self)
        }
    }

    #[inline(always)]
    fn any(range_mm: &[u32; BLOCK], at: usize) -> bool {
        let range_mm = wide(range_mm, at);
        // SAFETY: in a function for AVX-512.
        unsafe { _mm512_test_epi64_mask(range_mm, range_mm) != 0 }
    }

    #[inline(always)]
    fn store(point: [Self; 3], range_mm: &[u32; BLOCK], at: usize, out: &mut [[f64; 3]; BLOCK]) {
        let range_mm = wide(range_mm, at);
        // SAFETY: `wide` has checked that 8 points follow, of 24 numbers; in a function for AVX-512.
        unsafe {
            let there = _mm512_test_epi64_mask(range_mm, range_mm);
            let [x, y, z] = point.map(|axis| _mm512_maskz_mov_pd(there, axis));
            for (third, [of_xy, of_z]) in DOUBLE.iter().enumerate() {
                let [of_xy, of_z] = [of_xy, of_z].map(|order| _mm512_loadu_si512(order.as_ptr().cast()));
                let xy = _mm512_permutex2var_pd(x, of_xy, y);
                let xyz = _mm512_permutex2var_pd(xy, of_z, z);
                _mm512_storeu_pd(out.as_mut_ptr().cast::<f64>().add(3 * at + 8 * third), xyz);
            }
        }
    }
}

/// Eight ranges from `at` on, as 64-bit numbers.
#[inline(always)]
fn wide(range_mm: &[u32; BLOCK], at: usize) -> __m512i {
    assert!(at + 8 <= BLOCK);
    // SAFETY: 8 numbers from there on, in a function for AVX-512.
    unsafe { _mm512_cvtepu32_epi64(_mm256_loadu_si256(range_mm.as_ptr().add(at).cast())) }
}
