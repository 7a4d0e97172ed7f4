//! What one position unit of a drive is (CiA 402-2, "Factor group"; CiA 303-2 has the codes of 0x60A8).
//!
//! 0x6064 = 0x6063 · 0x6092 / (0x608F · 0x6091): a turn of the shaft is 0x6092 units where a drive has that object. Objects
//! that state it otherwise must agree, or the drive is refused. Cyclic synchronous position mode takes positions only: the
//! units of velocity and acceleration (0x60A9, 0x60AA, 0x6094 to 0x6097) have no part in it. The polarity bit (0x607E) turns
//! the target and the reading alike.

use std::f64::consts::TAU;
use std::fmt;

/// Coarser units than this cannot say where a move is done, degrees.
const COARSEST_DEG: f64 = 0.3;
/// Two objects agree within this share.
const AGREE: f64 = 1e-6;

/// Numerator and denominator of an object with both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio(pub u32, pub u32);

impl Ratio {
    /// Its value; `None` where a part of it is 0.
    fn value(self) -> Option<f64> {
        (self.0 > 0 && self.1 > 0).then(|| f64::from(self.0) / f64::from(self.1))
    }
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.0, self.1)
    }
}

/// What a drive says of its units; `None` for objects that it does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Factors {
    /// 0x608F: increments of the encoder for turns of the motor.
    pub encoder: Option<Ratio>,
    /// 0x6091: turns of the motor for turns of the shaft.
    pub gear: Option<Ratio>,
    /// 0x6092: position units for turns of the shaft.
    pub feed: Option<Ratio>,
    /// 0x6093: increments for position units.
    pub factor: Option<Ratio>,
    /// 0x60A8: prefix and code of the position unit.
    pub si: Option<u32>,
}

/// A position unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Position units of a turn of the shaft.
    pub per_turn: f64,
    /// Increments (0x6063) of a turn of the shaft, where the drive says how many.
    pub increments_per_turn: Option<f64>,
}

/// What 0x60A8 names.
enum Si {
    /// An angle: so many units are a turn.
    PerTurn(f64),
    Increments,
    /// A length, nothing, or a unit that says nothing of turns.
    Other,
}

impl Si {
    fn of(value: u32) -> Self {
        let prefix = 10f64.powi(i32::from((value >> 24) as u8 as i8));
        match value >> 16 & 0xFF {
            0x10 => Self::PerTurn(TAU / prefix),
            0x41 => Self::PerTurn(360.0 / prefix),
            0x42 => Self::PerTurn(21_600.0 / prefix),
            0x43 => Self::PerTurn(1_296_000.0 / prefix),
            0xB4 => Self::PerTurn(1.0 / prefix),
            0xB5 => Self::Increments,
            _ => Self::Other,
        }
    }
}

impl fmt::Display for Factors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ratios =
            [(0x608F, self.encoder), (0x6091, self.gear), (0x6092, self.feed), (0x6093, self.factor)];
        let mut objects = Vec::new();
        for (object, ratio) in ratios {
            objects.extend(ratio.map(|ratio| format!("0x{object:04x} = {ratio}")));
        }
        objects.extend(self.si.map(|si| format!("0x60a8 = 0x{si:08x}")));
        if objects.is_empty() {
            f.write_str("no object of its units")
        } else {
            f.write_str(&objects.join(", "))
        }
    }
}

impl Factors {
    /// The position unit, or why it cannot be determined.
    pub(crate) fn unit(&self) -> Result<Unit, String> {
        let failed = |why: String| {
            format!(
                "its position unit cannot be determined: {why} ({self}); expected objects that agree on how many units a turn of \
                 the shaft has: set 0x6092 to that and 0x60a8 to match or to 0"
            )
        };
        for (object, ratio) in [(0x6091, self.gear), (0x6092, self.feed), (0x6093, self.factor)] {
            if ratio.is_some_and(|ratio| ratio.value().is_none()) {
                return Err(failed(format!("0x{object:04x} has a 0")));
            }
        }
        let gear = self.gear.and_then(Ratio::value).unwrap_or(1.0);
        let increments_per_turn = self.encoder.and_then(Ratio::value).map(|encoder| encoder * gear);
        let claims = self.claims(increments_per_turn);
        let Some((first, per_turn)) = claims.first().copied() else {
            return Err(failed("no object says how many units a turn has".into()));
        };
        let differs = |claim: &&(&str, f64)| (claim.1 / per_turn - 1.0).abs() > AGREE;
        if let Some((other, theirs)) = claims.iter().find(differs) {
            return Err(failed(format!("a turn is {per_turn} units by {first} and {theirs} by {other}")));
        }
        let unit_deg = 360.0 / per_turn;
        if unit_deg > COARSEST_DEG {
            return Err(failed(format!(
                "a turn is {per_turn} units by {first}, one unit {unit_deg:.3} deg, coarser than the {COARSEST_DEG} deg within \
                 which a move is done"
            )));
        }
        if per_turn > f64::from(u32::MAX) {
            return Err(failed(format!(
                "a turn is {per_turn} units by {first}, more than a goal of 32 bits has"
            )));
        }
        Ok(Unit { per_turn, increments_per_turn })
    }

    /// Units of a turn by each object that says it.
    fn claims(&self, increments_per_turn: Option<f64>) -> Vec<(&'static str, f64)> {
        let mut claims = Vec::new();
        claims.extend(self.feed.and_then(Ratio::value).map(|feed| ("0x6092", feed)));
        let by_si = match self.si.map(Si::of) {
            Some(Si::PerTurn(units)) => Some(units),
            Some(Si::Increments) => increments_per_turn,
            Some(Si::Other) | None => None,
        };
        claims.extend(by_si.map(|units| ("0x60a8", units)));
        if let (Some(increments), Some(factor)) = (increments_per_turn, self.factor.and_then(Ratio::value)) {
            claims.push(("0x6093", increments / factor));
        }
        // without any object of its own, the unit is an increment
        let is_plain = matches!(self.si, None | Some(0));
        if claims.is_empty() && is_plain && self.factor.is_none() {
            claims.extend(increments_per_turn.map(|increments| ("0x608f and 0x6091", increments)));
        }
        claims
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encoder 4096, gear 100.
    const GEARED: Factors = Factors {
        encoder: Some(Ratio(4096, 1)),
        gear: Some(Ratio(100, 1)),
        feed: None,
        factor: None,
        si: None,
    };

    #[test]
    fn a_turn_has_as_many_units_as_the_objects_in_use_say() {
        let feed = |feed, shaft| Factors { feed: Some(Ratio(feed, shaft)), ..GEARED };
        let si = |code: u32| Factors { si: Some(code), ..GEARED };
        let cases = [
            (GEARED, 409_600.0),
            (Factors { gear: None, ..GEARED }, 4096.0),
            (Factors { si: Some(0), ..GEARED }, 409_600.0),
            (feed(36_000, 1), 36_000.0),
            (feed(409_600, 1), 409_600.0),
            (feed(72_000, 5), 14_400.0),
            (Factors { feed: Some(Ratio(36_000, 1)), ..Factors::default() }, 36_000.0),
            // 0.001 degrees, alone and where the feed says the same
            (si(0xFD41_0000), 360_000.0),
            (Factors { feed: Some(Ratio(360_000, 1)), si: Some(0xFD41_0000), ..GEARED }, 360_000.0),
            (si(0xFA10_0000), TAU * 1e6),
            (si(0x0043_0000), 1_296_000.0),
            (si(0xFBB4_0000), 100_000.0),
            (si(0x00B5_0000), 409_600.0),
            // a length says nothing of turns, the feed does
            (Factors { feed: Some(Ratio(36_000, 1)), si: Some(0xFD01_0000), ..GEARED }, 36_000.0),
            // the older form: increments for a unit
            (Factors { factor: Some(Ratio(409_600, 36_000)), ..GEARED }, 36_000.0),
            (Factors { factor: Some(Ratio(1, 1)), ..GEARED }, 409_600.0),
        ];
        for (factors, wanted) in cases {
            let found = factors.unit().unwrap().per_turn;
            assert!((found / wanted - 1.0).abs() < 1e-9, "{factors}: {found}, wanted {wanted}");
        }
        assert_eq!(GEARED.unit().unwrap().increments_per_turn, Some(409_600.0));
    }

    #[test]
    fn a_unit_that_cannot_be_determined_is_refused_with_the_values() {
        let feed = |feed, shaft| Factors { feed: Some(Ratio(feed, shaft)), ..GEARED };
        let refused: [(Factors, &[&str]); 10] = [
            (Factors::default(), &["no object says"]),
            (feed(1, 1), &["1 units by 0x6092", "0x6092 = 1/1", "coarser"]),
            (feed(360, 1), &["360 units by 0x6092", "1.000 deg", "coarser"]),
            (feed(0, 1), &["0x6092 has a 0", "0x6092 = 0/1"]),
            (feed(36_000, 0), &["0x6092 has a 0"]),
            (Factors { gear: Some(Ratio(100, 0)), ..GEARED }, &["0x6091 has a 0"]),
            (
                Factors { si: Some(0xFD41_0000), ..feed(36_000, 1) },
                &["36000 units by 0x6092 and 360000 by 0x60a8", "0x60a8 = 0xfd410000"],
            ),
            (Factors { factor: Some(Ratio(1, 1)), ..feed(36_000, 1) }, &["409600 by 0x6093"]),
            // millimetres without a feed
            (Factors { si: Some(0xFD01_0000), ..GEARED }, &["no object says", "0xfd010000"]),
            (Factors { si: Some(0xF741_0000), ..GEARED }, &["32 bits"]),
        ];
        for (factors, words) in refused {
            let objects = factors.unit().unwrap_err();
            assert!(words.iter().all(|word| objects.contains(word)), "{objects}");
        }
    }
}
