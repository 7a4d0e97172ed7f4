//! Whether enough light comes back: surfaces that are dark, far or seen at a grazing angle lose returns.

/// A matt surface of one reflectivity, and a sensor that detects what its data sheet says.
///
/// The power that comes back from a matt (Lambertian) surface which fills the beam goes with reflectivity, the cosine
/// of the angle of incidence, and one over the range squared (the lidar equation; Wagner et al. 2006,
/// doi:10.1016/j.isprsjprs.2005.12.001). A sensor's maximum range is that at which half of the returns from
/// a surface of [`REFERENCE_REFLECTIVITY`], met square on, are detected: Ouster's data sheet of the OS1 states 120 m at
/// 80 % and 40 m at 10 %, this law gives 42 m for the latter. Around the threshold the share of detected returns is a
/// logistic function of the power in decibels; its width is an assumption: nine in ten come back from a range at which
/// 1.2 times the range brings one in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Share of the light that the surfaces scatter back, above 0, at most 1.
    pub reflectivity: f64,
}

/// Reflectivity of the target for which data sheets state the maximum range.
pub const REFERENCE_REFLECTIVITY: f64 = 0.8;

/// Decibels of power from an even chance to odds of e to one: 20 log10(1.2) / ln 9.
const WIDTH_DB: f64 = 0.720_74;

impl Detection {
    /// Share of returns that are detected at a range, for a surface met at this cosine of incidence.
    pub(crate) fn probability(&self, range_m: f64, cos_incidence: f64, max_range_m: f64) -> f64 {
        if !max_range_m.is_finite() {
            return 1.0;
        }
        let power = self.reflectivity * cos_incidence.max(0.0) / REFERENCE_REFLECTIVITY;
        let excess_db = 10.0 * power.log10() + 20.0 * (max_range_m / range_m).log10();
        1.0 / (1.0 + (-excess_db / WIDTH_DB).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_data_sheet_is_met_at_its_own_points() {
        let share = |reflectivity, range_m| Detection { reflectivity }.probability(range_m, 1.0, 120.0);
        assert!((share(0.8, 120.0) - 0.5).abs() < 1e-9);
        assert!((share(0.8, 100.0) - 0.9).abs() < 1e-3);
        // 40 m by the data sheet
        assert!(share(0.1, 40.0) > 0.5 && share(0.1, 45.0) < 0.5);
    }

    #[test]
    fn dark_far_and_grazing_surfaces_return_less() {
        let share = |reflectivity, range_m, angle_deg: f64| {
            Detection { reflectivity }.probability(range_m, angle_deg.to_radians().cos(), 100.0)
        };
        assert!(share(0.8, 10.0, 0.0) > 0.999_999);
        assert!(share(0.1, 60.0, 0.0) < 0.01 && share(0.8, 60.0, 0.0) > 0.99);
        assert!(share(0.8, 60.0, 80.0) < 0.05);
        assert!(share(0.8, 10.0, 90.0) < 1e-50);
        assert_eq!(Detection { reflectivity: 0.01 }.probability(1e6, 0.1, f64::INFINITY), 1.0);
    }
}
