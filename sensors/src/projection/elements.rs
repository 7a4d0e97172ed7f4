//! Several numbers at a time: in portable arrays, or in the registers of AVX-512. Every operation rounds as its scalar
//! counterpart does and nothing is fused, so that all of them give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx512;

use std::ops::{Add, Mul, Neg, Sub};

/// Samples that are worked on together; elements come in parts of it.
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

/// `WIDTH` numbers.
pub(super) trait Elements: Copy {
    type Real: Real;
    const WIDTH: usize;

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
    /// Whether any range from `at` on is not 0.
    fn any(range_mm: &[u32; BLOCK], at: usize) -> bool;
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

impl<T: Real> Elements for Portable<T> {
    type Real = T;
    const WIDTH: usize = 8;

    #[inline(always)]
    fn load(block: &[T; BLOCK], at: usize) -> Self {
        Self::of(|element| block[at + element])
    }

    #[inline(always)]
    fn splat(value: T) -> Self {
        Self([value; 8])
    }

    #[inline(always)]
    fn metres(range_mm: &[u32; BLOCK], at: usize) -> Self {
        Self::of(|element| T::from_mm(range_mm[at + element] as i32))
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::of(|element| self.0[element] + other.0[element])
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::of(|element| self.0[element] - other.0[element])
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self::of(|element| self.0[element] * other.0[element])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self::of(|element| if self.0[element] < T::default() { -self.0[element] } else { self.0[element] })
    }

    #[inline(always)]
    fn where_below(self, range_mm: &[u32; BLOCK], at: usize, limit_mm: u32) -> Self {
        Self::of(|element| if range_mm[at + element] < limit_mm { self.0[element] } else { T::default() })
    }

    #[inline(always)]
    fn any(range_mm: &[u32; BLOCK], at: usize) -> bool {
        range_mm[at..at + 8].iter().any(|range_mm| *range_mm != 0)
    }

    #[inline(always)]
    fn store([x, y, z]: [Self; 3], range_mm: &[u32; BLOCK], at: usize, out: &mut [[T; 3]; BLOCK]) {
        for element in 0..8 {
            let there = range_mm[at + element] != 0;
            out[at + element] = [x, y, z].map(|axis| if there { axis.0[element] } else { T::default() });
        }
    }
}
