//! The spinning Velodyne sensors and what their data format fixes: lasers, units, firing cycle, packet layout.

use std::fmt;

/// A sensor that is decoded and encoded here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Product {
    /// VLP-16 (Puck).
    #[serde(rename = "vlp-16")]
    Vlp16,
    /// Puck LITE: a VLP-16 on the wire.
    PuckLite,
    /// Puck Hi-Res.
    PuckHiRes,
    /// HDL-32E.
    #[serde(rename = "hdl-32e")]
    Hdl32e,
    /// VLP-32A.
    #[serde(rename = "vlp-32a")]
    Vlp32a,
    /// VLP-32B: a VLP-32A on the wire.
    #[serde(rename = "vlp-32b")]
    Vlp32b,
    /// VLP-32C (Ultra Puck).
    #[serde(rename = "vlp-32c")]
    Vlp32c,
    /// VLS-128 (Alpha Prime).
    #[serde(rename = "vls-128")]
    Vls128,
    /// HDL-64E S1: no device time in its packets.
    #[serde(rename = "hdl-64e-s1")]
    Hdl64eS1,
    /// HDL-64E S2 and S2.1.
    #[serde(rename = "hdl-64e-s2")]
    Hdl64eS2,
    /// HDL-64E S3.
    #[serde(rename = "hdl-64e-s3")]
    Hdl64eS3,
}

/// How the lasers of a product share the blocks of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Family {
    /// 16 lasers: a block holds two firing sequences.
    Sixteen,
    /// 32 lasers: a block is a firing sequence.
    ThirtyTwo,
    /// 64 lasers in an upper and a lower block; no model byte.
    SixtyFour,
    /// 128 lasers in four blocks.
    OneTwentyEight,
}

impl Product {
    /// All products.
    pub const ALL: [Self; 11] = [
        Self::Vlp16,
        Self::PuckLite,
        Self::PuckHiRes,
        Self::Hdl32e,
        Self::Vlp32a,
        Self::Vlp32b,
        Self::Vlp32c,
        Self::Vls128,
        Self::Hdl64eS1,
        Self::Hdl64eS2,
        Self::Hdl64eS3,
    ];

    /// Name of the nominal model in [`crate::catalogue`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Vlp16 => "vlp-16",
            Self::PuckLite => "puck-lite",
            Self::PuckHiRes => "puck-hi-res",
            Self::Hdl32e => "hdl-32e",
            Self::Vlp32a => "vlp-32a",
            Self::Vlp32b => "vlp-32b",
            Self::Vlp32c => "vlp-32c",
            Self::Vls128 => "vls-128",
            Self::Hdl64eS1 => "hdl-64e-s1",
            Self::Hdl64eS2 => "hdl-64e-s2",
            Self::Hdl64eS3 => "hdl-64e-s3",
        }
    }

    /// The product of a catalogue name, letters of either case.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|product| product.name().eq_ignore_ascii_case(name))
    }

    /// Number of lasers, the channels of a frame.
    pub fn lasers(self) -> usize {
        match self.family() {
            Family::Sixteen => 16,
            Family::ThirtyTwo => 32,
            Family::SixtyFour => 64,
            Family::OneTwentyEight => 128,
        }
    }

    /// One unit of the distance field, mm. Sources: manuals 63-9243 (VLP-16), 63-9325 (VLP-32C), 63-9483 (VLS-128).
    pub fn distance_unit_mm(self) -> u32 {
        match self {
            Self::Vlp32a | Self::Vlp32b | Self::Vlp32c | Self::Vls128 => 4,
            _ => 2,
        }
    }

    /// Byte 1205 of a data packet; none for HDL-64E, which sends its status there. The byte is no proof: VLP-16s
    /// of 2014 send that of an HDL-32E.
    pub(crate) fn model_byte(self) -> Option<u8> {
        match self {
            Self::Hdl32e => Some(0x21),
            Self::Vlp16 | Self::PuckLite => Some(0x22),
            Self::Vlp32a | Self::Vlp32b => Some(0x23),
            Self::PuckHiRes => Some(0x24),
            Self::Vlp32c => Some(0x28),
            Self::Vls128 => Some(0xA1),
            Self::Hdl64eS1 | Self::Hdl64eS2 | Self::Hdl64eS3 => None,
        }
    }

    /// Whether nothing in the packets tells this product from the other: the same one, or one with the same byte.
    pub fn sends_as(self, other: Self) -> bool {
        self == other || self.model_byte().is_some_and(|byte| other.model_byte() == Some(byte))
    }

    /// Time from one firing sequence to the next, ns. Sources: VLP-16 manual 63-9243 ch. 9, HDL-32E application
    /// note 63-9277, VLP-32C manual 63-9325, HDL-64E S2 and S3 manuals (firing time tables). VLS-128: as measured
    /// in a capture (firmware differ: 53.3 to 57.8 us; the decoder measures). HDL-64E S1: not published, about
    /// 384.3 us a packet of six upper-lower pairs.
    pub fn cycle_ns(self) -> f64 {
        match self {
            Self::Vlp16 | Self::PuckLite | Self::PuckHiRes => 55_296.0,
            Self::Vlp32a | Self::Vlp32b | Self::Vlp32c => 55_296.0,
            Self::Hdl32e => 46_080.0,
            Self::Vls128 => 55_280.0,
            Self::Hdl64eS1 => 64_050.0,
            Self::Hdl64eS2 => 48_000.0,
            Self::Hdl64eS3 => 57_600.0,
        }
    }

    /// When the first laser of a packet fires after the packet's time stamp, ns, for a firing cycle. The stamp of
    /// a VLS-128 belongs to the fourth of the twenty slots of its first sequence (manual 63-9483, top-of-hour
    /// alignment).
    pub(crate) fn stamp_lead_ns(self, cycle_ns: f64) -> f64 {
        if self == Self::Vls128 { 3.0 * cycle_ns / 20.0 } else { 0.0 }
    }

    /// Firing sequences in a packet.
    pub fn sequences_per_packet(self, dual: bool) -> usize {
        match (self.family(), dual) {
            (Family::Sixteen, false) => 24,
            (Family::Sixteen, true) | (Family::ThirtyTwo, false) => 12,
            (Family::ThirtyTwo, true) | (Family::SixtyFour, false) => 6,
            (Family::SixtyFour, true) | (Family::OneTwentyEight, false) => 3,
            (Family::OneTwentyEight, true) => 1,
        }
    }

    /// An HDL-64E: no unit is like another, and its packets carry a status.
    pub(crate) fn is_hdl_64e(self) -> bool {
        self.family() == Family::SixtyFour
    }

    pub(crate) fn family(self) -> Family {
        match self {
            Self::Vlp16 | Self::PuckLite | Self::PuckHiRes => Family::Sixteen,
            Self::Hdl32e | Self::Vlp32a | Self::Vlp32b | Self::Vlp32c => Family::ThirtyTwo,
            Self::Hdl64eS1 | Self::Hdl64eS2 | Self::Hdl64eS3 => Family::SixtyFour,
            Self::Vls128 => Family::OneTwentyEight,
        }
    }
}

impl fmt::Display for Product {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// Which returns of a firing the sensor sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReturnMode {
    /// The strongest.
    Strongest,
    /// The last.
    Last,
    /// The last, and the strongest (the second strongest where the last is the strongest).
    Dual,
}

impl ReturnMode {
    /// Byte 1204 of a data packet.
    pub fn byte(self) -> u8 {
        match self {
            Self::Strongest => 0x37,
            Self::Last => 0x38,
            Self::Dual => 0x39,
        }
    }

    /// The mode of byte 1204. Two returns with their confidence (0x3b) are two returns to us: the confidence lies in the
    /// blocks behind them.
    pub(crate) fn from_byte(byte: u8) -> Option<Self> {
        if byte == 0x3B {
            return Some(Self::Dual);
        }
        [Self::Strongest, Self::Last, Self::Dual].into_iter().find(|mode| mode.byte() == byte)
    }
}
