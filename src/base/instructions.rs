//! Instruction sets that kernels are compiled for. The best one that the processor has is chosen at run time; every
//! kernel gives the same bits with each.
#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them

/// Vector instructions that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instructions(Level);

/// What a kernel is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// What every processor of the target has: SSE2 on x86-64.
    Baseline,
    /// 256-bit vectors: AVX2, FMA, POPCNT.
    Avx2,
    /// 512-bit vectors: AVX-512 F, DQ, VL and BW, and what `Avx2` has.
    Avx512,
}

impl Instructions {
    /// The best that there are.
    #[inline]
    pub fn best() -> Self {
        if has_avx512() {
            Self(Level::Avx512)
        } else if has_avx2() {
            Self(Level::Avx2)
        } else {
            Self(Level::Baseline)
        }
    }

    /// All that there are, plain ones first.
    pub fn available() -> Vec<Self> {
        let has = [(true, Level::Baseline), (has_avx2(), Level::Avx2), (has_avx512(), Level::Avx512)];
        has.into_iter().filter(|(has, _)| *has).map(|(_, level)| Self(level)).collect()
    }

    /// Runs a kernel as compiled for these instructions.
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx512 => unsafe { run_avx512(kernel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level exists only where the processor has these instructions
            Level::Avx2 => unsafe { run_avx2(kernel) },
            _ => kernel.run(),
        }
    }

    /// What to run. Whoever gets a level may run what is compiled for it: no other function returns one.
    #[inline]
    pub(crate) fn level(self) -> Level {
        self.0
    }
}

/// What is compiled for each instruction set. `run` and what it calls must be `inline(always)`, and give no closure to
/// `array::map` or `array::from_fn`, which stay calls of plain instructions.
pub(crate) trait Kernel {
    type Output;

    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("popcnt")
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512bw")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_avx2() -> bool {
    false
}

#[cfg(not(target_arch = "x86_64"))]
fn has_avx512() -> bool {
    false
}
