//! One revolution of one sensor: ranges and the angles and times they were measured at, never points.

/// A frame. Arrays of samples are column-major: `column * channels + channel`, because a column is one instant on
/// the wire and in the world.
///
/// The azimuth of a sample is the encoder angle, **clockwise** seen from above, from the sensor's +x axis, in
/// radians: for Ouster `2 pi * measurement_id / columns_per_frame`, for Velodyne the block azimuth interpolated to
/// the firing. A sample's own time and azimuth are
/// `column_time_ns + fire_offset_ns(channel)` and `column_azimuth_rad + azimuth_rate * fire_offset_ns(channel)`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// The sensor's own frame counter (Ouster), or the number of frames before this one (Velodyne).
    pub frame_id: u32,
    /// Beams per column.
    pub channels: usize,
    /// Device time of each column in the sensor's clock, ns; 0 where the column never came.
    pub column_time_ns: Vec<u64>,
    /// Encoder azimuth of each column, rad, clockwise, in [0, 2 pi).
    pub column_azimuth_rad: Vec<f64>,
    /// Whether the column came and the sensor calls it valid.
    pub column_valid: Vec<bool>,
    /// Encoder rate during the frame, rad/ns, for the azimuth of beams that fire inside a column.
    pub azimuth_rate_rad_per_ns: f64,
    /// First return of each firing (strongest, or last, as the sensor is set).
    pub first: Layer,
    /// Second return, where the sensor sends one.
    pub second: Option<Layer>,
    /// Lidar packets that went into this frame.
    pub packets: u32,
    /// Packets a whole frame has, where the format says so.
    pub expected_packets: Option<u32>,
    /// Times that the sensor had been initialised again before this frame, as far as its packets tell (Ouster).
    pub restarts: u64,
    /// Every expected packet came and every expected azimuth was covered.
    pub complete: bool,
    /// Host arrival time of the first and the last packet, ns.
    pub host_time_ns: [u64; 2],
    /// What the sensor reported about itself in the packets of this frame, if its format has room for it.
    pub health: Health,
}

/// The sensor's own warnings, from the last packet header of a frame (Ouster, all formats but LEGACY).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// Alert flags: bits 0-5 cursor, bit 6 overflow, bit 7 active.
    pub alert_flags: u8,
    /// Seconds until the sensor shuts down for heat; 0 when that is not coming.
    pub thermal_countdown_s: u8,
    /// Seconds until the sensor limits its shots; 0 when that is not coming.
    pub shot_limiting_countdown_s: u8,
    /// 1: thermal shutdown is imminent.
    pub thermal_shutdown: u8,
    /// 0 normal, 1 imminent, 2 to 9 level of shot limiting.
    pub shot_limiting: u8,
}

/// What was measured for one return of every sample. Arrays a format does not carry stay empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Raw range in mm before any correction by calibration; 0 is "no return". Length `columns * channels`.
    pub range_mm: Vec<u32>,
    /// Calibrated reflectivity (Ouster REFLECTIVITY, Velodyne intensity byte).
    pub reflectivity: Vec<u8>,
    /// Signal photons (Ouster).
    pub signal: Vec<u16>,
    /// Ambient light (Ouster NEAR_IR), already scaled to the format's unit.
    pub near_ir: Vec<u16>,
    /// Range flags (Ouster).
    pub flags: Vec<u8>,
    /// Window flags (Ouster WINDOW).
    pub window: Vec<u8>,
    /// Zone mask (Ouster ZONE_MASK).
    pub zone_mask: Vec<u16>,
    /// Red, green, blue as IEEE half floats (Ouster Rev8).
    pub rgb: Vec<[u16; 3]>,
    /// Raw 32-bit words of formats that are passed through undecoded (Ouster FIVE_WORD): 5 per sample.
    pub raw_words: Vec<[u32; 5]>,
}

impl Frame {
    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.column_time_ns.len()
    }

    /// Columns that came and are valid.
    pub fn valid_columns(&self) -> usize {
        self.column_valid.iter().filter(|valid| **valid).count()
    }

    /// Position of a sample in the arrays of a [`Layer`].
    pub fn index(&self, column: usize, channel: usize) -> usize {
        column * self.channels + channel
    }

    /// Earliest and latest device time of the columns that came, ns. Columns stand in order of their azimuth: where a
    /// field-of-view window goes through azimuth 0, the first of them was not fired first.
    pub fn time_span_ns(&self) -> Option<[u64; 2]> {
        let times = self.column_time_ns.iter().zip(&self.column_valid).filter(|(_, v)| **v).map(|(t, _)| *t);
        times.fold(None, |span: Option<[u64; 2]>, time_ns| {
            let [first_ns, last_ns] = span.unwrap_or([time_ns; 2]);
            Some([first_ns.min(time_ns), last_ns.max(time_ns)])
        })
    }
}

impl Layer {
    /// Takes the first samples of another layer of the same format.
    pub(crate) fn copy_samples(&mut self, from: &Self, samples: usize) {
        fn copy<T: Copy>(to: &mut [T], from: &[T], samples: usize) {
            if let (Some(to), Some(from)) = (to.get_mut(..samples), from.get(..samples)) {
                to.copy_from_slice(from);
            }
        }
        copy(&mut self.range_mm, &from.range_mm, samples);
        copy(&mut self.reflectivity, &from.reflectivity, samples);
        copy(&mut self.signal, &from.signal, samples);
        copy(&mut self.near_ir, &from.near_ir, samples);
        copy(&mut self.flags, &from.flags, samples);
        copy(&mut self.window, &from.window, samples);
        copy(&mut self.zone_mask, &from.zone_mask, samples);
        copy(&mut self.rgb, &from.rgb, samples);
        copy(&mut self.raw_words, &from.raw_words, samples);
    }

    /// Number of samples with a return.
    pub fn points(&self) -> usize {
        self.range_mm.iter().filter(|range| **range > 0).count()
    }
}
