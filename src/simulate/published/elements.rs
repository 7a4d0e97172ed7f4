//! Blocks of elements: plain arithmetic over arrays, which the compiler turns into vector instructions.

/// Beams that are worked on side by side.
pub(super) const WIDTH: usize = 16;

/// How small a component of a direction the definition decides on, where rounding may turn it into zero or back.
pub(super) const TINY: f64 = 1e-12;

/// Adding this leaves the nearest whole number in the low bits of an f64 (1.5 * 2^52).
pub(super) const TO_WHOLE: f64 = 6_755_399_441_055_744.0;

/// World directions of a block of beams, axis by axis.
pub(super) type Directions = [[f64; WIDTH]; 3];

/// In the order of operations of the definition, so that what is zero there is zero here.
#[inline(never)]
pub(super) fn exact_directions(
    rows: &[[f64; 3]; 3],
    azimuth: [f64; 2],
    sines: &[f64; WIDTH],
    cosines: &[f64; WIDTH],
) -> Directions {
    let [sin_azimuth, cos_azimuth] = azimuth;
    rows.map(|row| {
        std::array::from_fn(|element| {
            let local = [cosines[element] * cos_azimuth, cosines[element] * sin_azimuth, sines[element]];
            row[0] * local[0] + row[1] * local[1] + row[2] * local[2]
        })
    })
}

/// `a * b + c`, in one instruction where there is one.
#[inline(always)]
pub(super) fn fused<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// `a * b + c`, in one instruction where there is one.
#[inline(always)]
pub(super) fn fused_f32<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// The smaller of two numbers, neither of them NaN: one instruction, where `f64::min` asks for NaN first.
#[inline(always)]
pub(super) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
