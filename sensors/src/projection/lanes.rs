//! Several numbers at a time: in portable arrays, or in the registers of AVX-512. Every operation rounds as its scalar
//! counterpart does and nothing is fused, so that all of them give the same bits.

#![allow(unsafe_code)] // instructions of AVX-512, for functions that run only once the CPU was asked for them

use std::ops::{Add, Mul, Neg, Sub};

/// Samples that are worked on together; lanes come in parts of it.
pub(super) const BLOCK: usize = 16;

/// What is needed of a number.
pub(super) trait Real:
    Copy
    + Default
    + PartialEq
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    fn from_f64(value: f64) -> Self;
    /// Through i32: ranges are far below 2^31, and only that conversion is one instruction everywhere.
    fn from_mm(range_mm: i32) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn from_mm(range_mm: i32) -> Self {
        f64::from(range_mm) * 1e-3
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn from_mm(range_mm: i32) -> Self {
        range_mm as f32 * 1e-3
    }
}

/// `LANES` numbers.
pub(super) trait Lanes: Copy {
    type Real: Real;
    const LANES: usize;

    /// The part of a block from `at` on.
    fn load(block: &[Self::Real; BLOCK], at: usize) -> Self;
    fn splat(value: Self::Real) -> Self;
    /// Ranges of a block from `at` on, m.
    fn metres(range_mm: &[u32; BLOCK], at: usize) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Zero where the range is not below a limit.
    fn where_below(self, range_mm: &[u32; BLOCK], at: usize, limit_mm: u32) -> Self;
    /// Writes points from `at` on; zeros where the range is 0.
    fn store(point: [Self; 3], range_mm: &[u32; BLOCK], at: usize, out: &mut [[Self::Real; 3]; BLOCK]);
}

/// In arrays, for the compiler to make of what it can.
#[derive(Clone, Copy)]
pub(super) struct Portable<T>([T; 8]);

impl<T: Real> Portable<T> {
    #[inline(always)]
    fn of(value: impl Fn(usize) -> T) -> Self {
        Self(std::array::from_fn(value))
    }
}

impl<T: Real> Lanes for Portable<T> {
    type Real = T;
    const LANES: usize = 8;

    #[inline(always)]
    fn load(block: &[T; BLOCK], at: usize) -> Self {
        Self::of(|lane| block[at + lane])
    }

    #[inline(always)]
    fn splat(value: T) -> Self {
        Self([value; 8])
    }

    #[inline(always)]
    fn metres(range_mm: &[u32; BLOCK], at: usize) -> Self {
        Self::of(|lane| T::from_mm(range_mm[at + lane] as i32))
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::of(|lane| self.0[lane] + other.0[lane])
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::of(|lane| self.0[lane] - other.0[lane])
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self::of(|lane| self.0[lane] * other.0[lane])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self::of(|lane| if self.0[lane] < T::default() { -self.0[lane] } else { self.0[lane] })
    }

    #[inline(always)]
    fn where_below(self, range_mm: &[u32; BLOCK], at: usize, limit_mm: u32) -> Self {
        Self::of(|lane| if range_mm[at + lane] < limit_mm { self.0[lane] } else { T::default() })
    }

    #[inline(always)]
    fn store([x, y, z]: [Self; 3], range_mm: &[u32; BLOCK], at: usize, out: &mut [[T; 3]; BLOCK]) {
        for lane in 0..8 {
            let there = range_mm[at + lane] != 0;
            out[at + lane] = [x, y, z].map(|axis| if there { axis.0[lane] } else { T::default() });
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod avx512 {
    //! Functions of the traits are inlined into one that is compiled for AVX-512, and called from nowhere else.

    use std::arch::x86_64::*;

    use super::{BLOCK, Lanes};

    /// Which lane of two registers each lane of the `third`th register of three takes, when points are put behind one
    /// another: of x and y, then of that and z.
    const fn order<const LANES: usize>(third: usize, of_xy: bool) -> [i64; LANES] {
        let mut order = [0; LANES];
        let mut lane = 0;
        while lane < LANES {
            let (point, axis) = ((third * LANES + lane) / 3, (third * LANES + lane) % 3);
            order[lane] = match (of_xy, axis) {
                (true, 0) => point,
                (true, _) => LANES + point,
                (false, 2) => LANES + point,
                (false, _) => lane,
            } as i64;
            lane += 1;
        }
        // a z among x and y is replaced in the second step; it must name a lane all the same
        let mut lane = 0;
        while lane < LANES {
            if order[lane] >= 2 * LANES as i64 {
                order[lane] = 0;
            }
            lane += 1;
        }
        order
    }

    const fn narrow(order: [i64; 16]) -> [i32; 16] {
        let mut narrow = [0; 16];
        let mut lane = 0;
        while lane < 16 {
            narrow[lane] = order[lane] as i32;
            lane += 1;
        }
        narrow
    }

    const SINGLE: [[[i32; 16]; 2]; 3] = [
        [narrow(order(0, true)), narrow(order(0, false))],
        [narrow(order(1, true)), narrow(order(1, false))],
        [narrow(order(2, true)), narrow(order(2, false))],
    ];
    const DOUBLE: [[[i64; 8]; 2]; 3] = [
        [order(0, true), order(0, false)],
        [order(1, true), order(1, false)],
        [order(2, true), order(2, false)],
    ];

    impl Lanes for __m512 {
        type Real = f32;
        const LANES: usize = 16;

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

    impl Lanes for __m512d {
        type Real = f64;
        const LANES: usize = 8;

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
            let metres = wide(range_mm, at);
            // SAFETY: in a function for AVX-512.
            unsafe {
                let below = _mm512_cmplt_epu64_mask(metres, _mm512_set1_epi64(i64::from(limit_mm)));
                _mm512_maskz_mov_pd(below, self)
            }
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
}
