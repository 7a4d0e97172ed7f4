//! Lidar packet profiles: where each field sits inside one pixel block. A new profile is one entry of [`Profile`],
//! one table in [`LAYOUTS`] and one line in `kernels.rs`.
//!
//! Source: Ouster firmware user manual, "Lidar data format"; bit positions checked on captured packets.

/// A lidar packet profile (`udp_profile_lidar`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(usize)]
pub enum Profile {
    /// Firmware 1.x and the old choice of 2.x and 3.x: columns without packet header or footer.
    Legacy,
    /// Single return.
    Rng19Rfl8Sig16Nir16,
    /// Dual return.
    Rng19Rfl8Sig16Nir16Dual,
    /// Low data rate, single return.
    Rng15Rfl8Nir8,
    /// Low data rate, dual return.
    Rng15Rfl8Nir8Dual,
    /// Low data rate, dual return, functional-safety header.
    FusaRng15Rfl8Nir8Dual,
    /// Low data rate with zone mask.
    Rng15Rfl8Nir8Zone16,
    /// Single return with zone mask.
    Rng19Rfl8Sig16Nir16Zone16,
    /// Dual return with zone mask.
    Rng19Rfl8Sig16Zone16Dual,
    /// Low data rate with window flags instead of ambient light.
    Rng15Rfl8Win8,
    /// Single return with colour (Rev8).
    Rng19Rfl8Sig16Nir16Rgb16,
    /// Dual return with colour (Rev8).
    Rng19Rfl8Sig16Nir16Rgb16Dual,
    /// Five raw words per pixel; the words begin like the dual profile.
    FiveWordPixel,
    /// No lidar packets.
    Off,
}

/// A field of a pixel block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bits {
    /// First bit, counted from the block's start, little-endian.
    pub at: u16,
    /// Number of bits; 0 when the profile lacks the field.
    pub width: u8,
    /// What one count stands for (8 mm ranges, 16-count ambient light).
    pub scale: u16,
}

/// The fields of one return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReturnLayout {
    /// Range, mm after scaling.
    pub range: Bits,
    /// Range flags.
    pub flags: Bits,
    /// Calibrated reflectivity.
    pub reflectivity: Bits,
    /// Signal photons.
    pub signal: Bits,
    /// Ambient light.
    pub near_ir: Bits,
    /// Window flags.
    pub window: Bits,
    /// Zone mask.
    pub zone_mask: Bits,
    /// Red, green and blue, one after the other.
    pub rgb: [Bits; 3],
}

/// One pixel block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Which profile this is.
    pub profile: Profile,
    /// Name in metadata.
    pub name: &'static str,
    /// Bytes per pixel.
    pub bytes: usize,
    /// First return, and everything that exists once per pixel.
    pub first: ReturnLayout,
    /// Second return; all fields absent in single-return profiles.
    pub second: ReturnLayout,
    /// The block is also stored as five 32-bit words.
    pub raw_words: bool,
}

impl Bits {
    /// Whether the profile has the field.
    pub const fn is_there(self) -> bool {
        self.width > 0
    }

    /// The field's bits, at the block's bit 0.
    pub const fn mask(self) -> u32 {
        if self.width >= 32 { u32::MAX } else { (1 << self.width) - 1 }
    }

    /// The maximum value of the field, scaled.
    pub const fn maximum(self) -> u32 {
        self.mask() * self.scale as u32
    }
}

impl Layout {
    /// Whether the profile carries a second return.
    pub const fn is_dual(&self) -> bool {
        self.second.range.is_there()
    }
}

impl Profile {
    /// All of them.
    pub fn all() -> impl Iterator<Item = Self> {
        LAYOUTS.iter().map(|layout| layout.profile)
    }

    /// By its name in metadata.
    pub fn from_name(name: &str) -> Option<Self> {
        LAYOUTS.iter().find(|layout| layout.name == name).map(|layout| layout.profile)
    }

    /// Name in metadata.
    pub fn name(self) -> &'static str {
        self.layout().name
    }

    /// The pixel block.
    pub fn layout(self) -> &'static Layout {
        &LAYOUTS[self as usize]
    }

    /// Packets have a header and a footer, and columns have the newer framing.
    pub(crate) fn has_packet_header(self) -> bool {
        self != Self::Legacy
    }
}

const fn bits(at: u16, width: u8) -> Bits {
    scaled(at, width, 1)
}

const fn scaled(at: u16, width: u8, scale: u16) -> Bits {
    Bits { at, width, scale }
}

const ABSENT: Bits = bits(0, 0);

const NOTHING: ReturnLayout = ReturnLayout {
    range: ABSENT,
    flags: ABSENT,
    reflectivity: ABSENT,
    signal: ABSENT,
    near_ir: ABSENT,
    window: ABSENT,
    zone_mask: ABSENT,
    rgb: [ABSENT; 3],
};

const fn rng19(range_at: u16, reflectivity_at: u16) -> ReturnLayout {
    ReturnLayout {
        range: bits(range_at, 19),
        flags: bits(range_at + 19, 5),
        reflectivity: bits(reflectivity_at, 8),
        ..NOTHING
    }
}

const fn rng15(range_at: u16) -> ReturnLayout {
    ReturnLayout {
        range: scaled(range_at, 15, 8),
        flags: bits(range_at + 15, 1),
        reflectivity: bits(range_at + 16, 8),
        ..NOTHING
    }
}

const fn rgb(at: u16) -> [Bits; 3] {
    [bits(at, 16), bits(at + 16, 16), bits(at + 32, 16)]
}

const RNG15_DUAL: Layout = Layout {
    profile: Profile::Rng15Rfl8Nir8Dual,
    name: "RNG15_RFL8_NIR8_DUAL",
    bytes: 8,
    first: ReturnLayout { near_ir: scaled(24, 8, 16), window: bits(56, 8), ..rng15(0) },
    second: rng15(32),
    raw_words: false,
};

const RNG19_DUAL: Layout = Layout {
    profile: Profile::Rng19Rfl8Sig16Nir16Dual,
    name: "RNG19_RFL8_SIG16_NIR16_DUAL",
    bytes: 16,
    first: ReturnLayout { signal: bits(64, 16), near_ir: bits(96, 16), window: bits(120, 8), ..rng19(0, 24) },
    second: ReturnLayout { signal: bits(80, 16), ..rng19(32, 56) },
    raw_words: false,
};

/// Every profile, in the order of [`Profile`].
pub const LAYOUTS: [Layout; 14] = [
    Layout {
        profile: Profile::Legacy,
        name: "LEGACY",
        bytes: 12,
        first: ReturnLayout {
            range: bits(0, 20),
            flags: bits(28, 4),
            reflectivity: bits(32, 8),
            signal: bits(48, 16),
            near_ir: bits(64, 16),
            ..NOTHING
        },
        second: NOTHING,
        raw_words: false,
    },
    Layout {
        profile: Profile::Rng19Rfl8Sig16Nir16,
        name: "RNG19_RFL8_SIG16_NIR16",
        bytes: 12,
        first: ReturnLayout {
            signal: bits(48, 16),
            near_ir: bits(64, 16),
            window: bits(88, 8),
            ..rng19(0, 32)
        },
        second: NOTHING,
        raw_words: false,
    },
    RNG19_DUAL,
    Layout {
        profile: Profile::Rng15Rfl8Nir8,
        name: "RNG15_RFL8_NIR8",
        bytes: 4,
        first: ReturnLayout { near_ir: scaled(24, 8, 16), ..rng15(0) },
        second: NOTHING,
        raw_words: false,
    },
    RNG15_DUAL,
    Layout { profile: Profile::FusaRng15Rfl8Nir8Dual, name: "FUSA_RNG15_RFL8_NIR8_DUAL", ..RNG15_DUAL },
    Layout {
        profile: Profile::Rng15Rfl8Nir8Zone16,
        name: "RNG15_RFL8_NIR8_ZONE16",
        bytes: 8,
        first: ReturnLayout {
            near_ir: scaled(24, 8, 16),
            zone_mask: bits(32, 16),
            window: bits(48, 8),
            ..rng15(0)
        },
        second: NOTHING,
        raw_words: false,
    },
    Layout {
        profile: Profile::Rng19Rfl8Sig16Nir16Zone16,
        name: "RNG19_RFL8_SIG16_NIR16_ZONE16",
        bytes: 12,
        first: ReturnLayout {
            window: bits(40, 8),
            signal: bits(48, 16),
            near_ir: bits(64, 16),
            zone_mask: bits(80, 16),
            ..rng19(0, 32)
        },
        second: NOTHING,
        raw_words: false,
    },
    Layout {
        profile: Profile::Rng19Rfl8Sig16Zone16Dual,
        name: "RNG19_RFL8_SIG16_ZONE16_DUAL",
        first: ReturnLayout { near_ir: ABSENT, zone_mask: bits(96, 16), ..RNG19_DUAL.first },
        ..RNG19_DUAL
    },
    Layout {
        profile: Profile::Rng15Rfl8Win8,
        name: "RNG15_RFL8_WIN8",
        bytes: 4,
        first: ReturnLayout { window: bits(24, 8), ..rng15(0) },
        second: NOTHING,
        raw_words: false,
    },
    Layout {
        profile: Profile::Rng19Rfl8Sig16Nir16Rgb16,
        name: "RNG19_RFL8_SIG16_NIR16_RGB16",
        bytes: 16,
        first: ReturnLayout { signal: bits(32, 16), near_ir: bits(48, 16), rgb: rgb(64), ..rng19(0, 24) },
        second: NOTHING,
        raw_words: false,
    },
    Layout {
        profile: Profile::Rng19Rfl8Sig16Nir16Rgb16Dual,
        name: "RNG19_RFL8_SIG16_NIR16_RGB16_DUAL",
        bytes: 20,
        first: ReturnLayout { window: ABSENT, rgb: rgb(112), ..RNG19_DUAL.first },
        ..RNG19_DUAL
    },
    Layout {
        profile: Profile::FiveWordPixel,
        name: "FIVE_WORD_PIXEL",
        bytes: 20,
        first: ReturnLayout { window: ABSENT, ..RNG19_DUAL.first },
        raw_words: true,
        ..RNG19_DUAL
    },
    Layout {
        profile: Profile::Off,
        name: "OFF",
        bytes: 0,
        first: NOTHING,
        second: NOTHING,
        raw_words: false,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_stand_in_the_order_of_the_profiles() {
        for (position, layout) in LAYOUTS.iter().enumerate() {
            assert_eq!(layout.profile as usize, position, "{}", layout.name);
            assert_eq!(Profile::from_name(layout.name), Some(layout.profile));
        }
    }

    #[test]
    fn fields_fit_their_block_and_a_word_and_do_not_overlap() {
        for layout in &LAYOUTS {
            let mut used = vec![false; layout.bytes * 8];
            for half in [&layout.first, &layout.second] {
                let fields = [
                    half.range,
                    half.flags,
                    half.reflectivity,
                    half.signal,
                    half.near_ir,
                    half.window,
                    half.zone_mask,
                    half.rgb[0],
                    half.rgb[1],
                    half.rgb[2],
                ];
                for field in fields {
                    let first = field.at as usize;
                    let word = first % 32 + field.width as usize;
                    assert!(word <= 32, "{}: {field:?} lies in two words", layout.name);
                    for used in &mut used[first..first + field.width as usize] {
                        assert!(!*used, "{}: {field:?}", layout.name);
                        *used = true;
                    }
                }
            }
        }
    }
}
