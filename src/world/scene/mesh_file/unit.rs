//! The unit of a mesh file: stated by the user, by a comment of the file, or doubted by the size.

use glam::DVec3;

/// Length unit of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshUnit {
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
    /// International feet.
    Foot,
    /// Feet of surveys in the United States: 2 ppm longer, 3 m at the coordinates of a state plane.
    SurveyFoot,
    /// Inches.
    Inch,
}

/// Units by their names on the command line, in the order in which they are offered.
pub(crate) const UNITS: [(&str, MeshUnit); 6] = [
    ("m", MeshUnit::Metre),
    ("cm", MeshUnit::Centimetre),
    ("mm", MeshUnit::Millimetre),
    ("ft", MeshUnit::Foot),
    ("us-ft", MeshUnit::SurveyFoot),
    ("in", MeshUnit::Inch),
];

/// Height that most floors of buildings are near to, m.
const FLOOR_M: f64 = 3.0;

impl MeshUnit {
    /// Metres per unit.
    pub(crate) fn metres(self) -> f64 {
        match self {
            MeshUnit::Metre => 1.0,
            MeshUnit::Centimetre => 0.01,
            MeshUnit::Millimetre => 0.001,
            MeshUnit::Foot => 0.3048,
            MeshUnit::SurveyFoot => 1200.0 / 3937.0,
            MeshUnit::Inch => 0.0254,
        }
    }

    /// As the command line names it.
    pub(crate) fn name(self) -> &'static str {
        UNITS.into_iter().find(|(_, unit)| *unit == self).map_or("m", |(name, _)| name)
    }

    /// What an extent would be in some units, in words behind what they follow; empty for none.
    pub(crate) fn offer(units: &[Self], extent_units: DVec3) -> String {
        let words = units.iter().map(|unit| {
            let [x, y, z] = (extent_units * unit.metres()).to_array();
            format!("in {} it would be {x:.2} x {y:.2} x {z:.2} m", unit.spoken())
        });
        let words = words.collect::<Vec<_>>().join(", ");
        if words.is_empty() { words } else { format!(" ({words})") }
    }

    /// In a sentence.
    pub(crate) fn spoken(self) -> &'static str {
        match self {
            MeshUnit::Foot => "feet",
            MeshUnit::Inch => "inches",
            other => other.name(),
        }
    }

    /// The unit that a comment names, as in `File units = inches` or `UNITS: mm`.
    pub(super) fn of_comment(comment: &str) -> Option<Self> {
        let lower = comment.to_ascii_lowercase();
        let (_, after) = lower.split_once("unit")?;
        let words = after.split(|letter: char| !letter.is_ascii_alphabetic()).filter(|word| !word.is_empty());
        words.take(4).find_map(|word| match word.strip_suffix('s').unwrap_or(word) {
            "m" | "meter" | "metre" => Some(Self::Metre),
            "cm" | "centimeter" | "centimetre" => Some(Self::Centimetre),
            "mm" | "millimeter" | "millimetre" => Some(Self::Millimetre),
            "ft" | "foot" | "feet" if lower.contains("survey") => Some(Self::SurveyFoot),
            "ft" | "foot" | "feet" => Some(Self::Foot),
            "inch" | "inche" => Some(Self::Inch),
            _ => None,
        })
    }
}

/// Units in which an extent looks like a building, the likeliest first.
pub(crate) fn plausible_units(extent_units: [f64; 3]) -> Vec<MeshUnit> {
    let metres = |unit: MeshUnit| extent_units.map(|units| units * unit.metres());
    let is_building = |unit: &MeshUnit| {
        let [x, y, z] = metres(*unit);
        (2.0..=500.0).contains(&x.max(y).max(z)) && z <= 100.0
    };
    let all = [MeshUnit::Millimetre, MeshUnit::Centimetre, MeshUnit::Inch, MeshUnit::Foot];
    let mut likely: Vec<MeshUnit> = all.into_iter().filter(is_building).collect();
    let off = |unit: &MeshUnit| (metres(*unit)[2].max(0.1) / FLOOR_M).ln().abs();
    likely.sort_by(|a, b| off(a).total_cmp(&off(b)));
    likely
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_name_units() {
        for (comment, unit) in [
            (" File units = inches", Some(MeshUnit::Inch)),
            ("UNITS= mm", Some(MeshUnit::Millimetre)),
            (" units: Feet", Some(MeshUnit::Foot)),
            ("Units: US survey feet", Some(MeshUnit::SurveyFoot)),
            ("one unit is 1 meter", Some(MeshUnit::Metre)),
            ("uniform colours, 3 m", None),
            ("unit cube", None),
            ("a room in mm", None),
        ] {
            assert_eq!(MeshUnit::of_comment(comment), unit, "{comment}");
        }
    }

    #[test]
    fn the_likeliest_unit_comes_first() {
        let words = |extent: [f64; 3]| MeshUnit::offer(&plausible_units(extent), extent.into());
        assert!(words([8000.0, 6000.0, 3000.0]).starts_with(" (in mm it would be 8.00 x 6.00 x 3.00 m"));
        assert!(words([315.0, 236.2, 118.1]).starts_with(" (in inches it would be 8.00 x 6.00 x 3.00 m"));
        assert_eq!(words([0.008, 0.006, 0.003]), "");
    }
}
