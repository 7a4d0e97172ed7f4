//! Sensors without rings: a direction for every point of a period, from prisms that turn or from a file.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::DVec3;

/// Directions over one period, after which they begin again: `lines` beams fire together at each instant.
#[derive(Clone, Debug)]
pub struct Pattern {
    /// Sensor frame (x forward, y left, z up), instant by instant, unit vectors.
    directions: Arc<[[f32; 3]]>,
    lines: usize,
    axis: DVec3,
}

impl PartialEq for Pattern {
    fn eq(&self, other: &Self) -> bool {
        self.lines == other.lines
            && (Arc::ptr_eq(&self.directions, &other.directions) || self.directions == other.directions)
    }
}

impl Pattern {
    /// Directions instant by instant; what is left of an unfinished instant is dropped. None without one instant.
    pub(crate) fn new(mut directions: Vec<[f32; 3]>, lines: usize) -> Option<Self> {
        directions.truncate(directions.len() / lines.max(1) * lines);
        let sum: DVec3 = directions.iter().map(|direction| DVec3::from(direction.map(f64::from))).sum();
        let mean = sum / directions.len().max(1) as f64;
        let axis = if mean.truncate().length() < 0.2 { DVec3::Z } else { mean.normalize() };
        (!directions.is_empty()).then(|| Self { directions: directions.into(), lines, axis })
    }

    /// Beams that fire together.
    pub fn lines(&self) -> usize {
        self.lines
    }

    /// Instants of a period.
    pub fn columns(&self) -> usize {
        self.directions.len() / self.lines
    }

    /// Direction of a line at a share of the period.
    pub fn direction(&self, line: usize, share: f64) -> DVec3 {
        let columns = self.columns();
        let column = (share.rem_euclid(1.0) * columns as f64).round() as usize % columns;
        DVec3::from(self.directions[column * self.lines + line].map(f64::from))
    }

    /// All directions.
    pub fn directions(&self) -> &[[f32; 3]] {
        &self.directions
    }

    /// The axis of symmetry of the pattern: z if it looks all around, else the mean direction.
    pub fn axis(&self) -> DVec3 {
        self.axis
    }
}

/// How the directions of a period come about, as a model file says it.
#[derive(serde::Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum Recipe {
    Prisms(Prisms),
    Band(Band),
}

/// Prisms that turn one behind the other about the forward axis (Risley prisms).
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Prisms {
    points_per_s: u32,
    prisms_hz: Vec<f64>,
    /// Between the faces of each; the tilted face looks at the source where it is positive.
    prisms_deg: Vec<f64>,
    prism_index: f64,
    /// Sideways slopes at which the beams enter.
    beams_x: Vec<f64>,
}

/// Lines side by side that turn about z while their band climbs from the lowest elevation to the highest, again and again.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Band {
    points_per_s: u32,
    lines: usize,
    turns_hz: f64,
    elevation_deg: [f64; 2],
    band_deg: f64,
    climb_s: f64,
}

/// Length of a period that a recipe makes, s.
const PERIOD_S: f64 = 1.0;
/// Points that a period may have: a bound on the memory that a model file asks for.
const MOST_POINTS: u32 = 10_000_000;

impl Recipe {
    /// The pattern and its period, s.
    pub(crate) fn pattern(&self) -> Result<(Pattern, f64), String> {
        let (points, lines) = match self {
            Self::Prisms(prisms) => (prisms.points_per_s, prisms.beams_x.len()),
            Self::Band(band) => (band.points_per_s, band.lines),
        };
        let instants = points as usize / lines.max(1);
        if lines == 0 || instants == 0 || points > MOST_POINTS {
            return Err(format!(
                "pattern: {points} points per second on {lines} lines, expected one line or more and at most {MOST_POINTS} points"
            ));
        }
        let directions: Vec<[f32; 3]> = match self {
            Self::Prisms(prisms) => prisms.directions(instants)?,
            Self::Band(band) => band.directions(instants),
        };
        let pattern = Pattern::new(directions, lines).ok_or("pattern: no point")?;
        Ok((pattern, PERIOD_S))
    }
}

impl Prisms {
    fn directions(&self, instants: usize) -> Result<Vec<[f32; 3]>, String> {
        if self.prisms_hz.len() != self.prisms_deg.len() {
            let (speeds, angles) = (self.prisms_hz.len(), self.prisms_deg.len());
            return Err(format!("pattern: {speeds} prisms_hz and {angles} prisms_deg, expected as many"));
        }
        let mut directions = Vec::with_capacity(instants * self.beams_x.len());
        for instant in 0..instants {
            let time_s = PERIOD_S * instant as f64 / instants as f64;
            for slope in &self.beams_x {
                let along = self.bent(DVec3::new(1.0, *slope, 0.0).normalize(), time_s);
                directions.push(along.as_vec3().to_array());
            }
        }
        Ok(directions)
    }

    /// A beam behind all prisms, by Snell's law at each face.
    fn bent(&self, mut along: DVec3, time_s: f64) -> DVec3 {
        for (speed_hz, wedge_deg) in self.prisms_hz.iter().zip(&self.prisms_deg) {
            let (sin_turn, cos_turn) = (TAU * (speed_hz * time_s).fract()).sin_cos();
            let (sin_wedge, cos_wedge) = wedge_deg.to_radians().sin_cos();
            let tilted = DVec3::new(cos_wedge, sin_wedge * cos_turn, sin_wedge * sin_turn);
            let (first, second) = if *wedge_deg > 0.0 { (tilted, DVec3::X) } else { (DVec3::X, tilted) };
            along = refracted(refracted(along, first, 1.0 / self.prism_index), second, self.prism_index);
        }
        along
    }
}

/// A unit vector behind a face of this normal (along the beam), `ratio` being the index before over the one behind. Beyond the
/// critical angle it leaves along the face.
fn refracted(along: DVec3, normal: DVec3, ratio: f64) -> DVec3 {
    let cos = along.dot(normal);
    let sideways = ratio * (along - cos * normal);
    let square = 1.0 - sideways.length_squared();
    if square > 0.0 { sideways + square.sqrt() * normal } else { sideways.normalize() }
}

impl Band {
    fn directions(&self, instants: usize) -> Vec<[f32; 3]> {
        let [low_deg, high_deg] = self.elevation_deg;
        let mut directions = Vec::with_capacity(instants * self.lines);
        for instant in 0..instants {
            let time_s = PERIOD_S * instant as f64 / instants as f64;
            let azimuth_rad = -TAU * (self.turns_hz * time_s).fract();
            let climbed = (time_s / self.climb_s).fract();
            for line in 0..self.lines {
                let in_band_deg = self.band_deg * (line as f64 + 0.5) / self.lines as f64;
                let base_deg = low_deg + climbed * (high_deg - low_deg - self.band_deg).max(0.0);
                directions.push(direction(azimuth_rad, (base_deg + in_band_deg).to_radians()));
            }
        }
        directions
    }
}

fn direction(azimuth_rad: f64, elevation_rad: f64) -> [f32; 3] {
    let (sin, cos) = elevation_rad.sin_cos();
    DVec3::new(cos * azimuth_rad.cos(), cos * azimuth_rad.sin(), sin).as_vec3().to_array()
}

/// Directions of a pattern file: lines of time, azimuth and zenith angle (degrees, counter-clockwise from x and from z), with or
/// without a heading, evenly spaced in time.
pub(crate) fn directions_of(text: &str) -> Result<Vec<[f32; 3]>, String> {
    let mut directions = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let numbers: Option<Vec<f64>> =
            line.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        match numbers.as_deref() {
            Some([_, azimuth_deg, zenith_deg, ..]) if (0.0..=180.0).contains(zenith_deg) => {
                directions.push(direction(azimuth_deg.to_radians(), 0.5 * PI - zenith_deg.to_radians()));
            }
            None if number == 0 => {} // the heading
            _ if line.trim().is_empty() => {}
            _ => {
                return Err(format!(
                    "line {}: {line:?}, expected time, azimuth in degrees and zenith angle in degrees (0 to 180)",
                    number + 1
                ));
            }
        }
        if directions.len() > MOST_POINTS as usize {
            return Err(format!("more than {MOST_POINTS} points: give one period of the pattern"));
        }
    }
    Ok(directions)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn widest_deg(name: &str) -> [f64; 2] {
        let model = crate::catalogue::nominal(name).unwrap();
        let pattern = model.pattern().unwrap();
        let most = |axis: usize| {
            let angles = pattern.directions().iter().map(|d| f64::from(d[axis]).atan2(f64::from(d[0])));
            2.0 * angles.fold(0.0, f64::max).to_degrees()
        };
        [most(1), most(2)]
    }

    /// Fields of view as the maker's data sheets state them.
    #[test]
    fn prisms_fill_the_stated_field_of_view() {
        for (name, [wide_deg, high_deg]) in
            [("livox-mid-40", [38.4, 38.4]), ("livox-mid-70", [70.4, 70.4]), ("livox-avia", [70.4, 77.2])]
        {
            let [wide, high] = widest_deg(name);
            let near = |found: f64, stated: f64| (found - stated).abs() < 0.06 * stated;
            let as_stated = near(wide, wide_deg) && near(high, high_deg);
            let turned = near(wide, high_deg) && near(high, wide_deg);
            assert!(as_stated || turned, "{name}: {wide:.1} x {high:.1}");
        }
    }

    #[test]
    fn a_pattern_file_is_read_and_its_faults_are_named() {
        let text = "Time/s,Azimuth/deg,Zenith/deg\n1,0,90\n2,90,90\n3,180,0\n";
        let pattern = Pattern::new(directions_of(text).unwrap(), 1).unwrap();
        assert_eq!(pattern.columns(), 3);
        assert!(pattern.direction(0, 1.0 / 3.0).distance(DVec3::Y) < 1e-6);
        assert!(pattern.direction(0, 2.0 / 3.0).distance(DVec3::Z) < 1e-6);
        let error = directions_of("1,0,90\n2,5,200\n").unwrap_err();
        assert!(error.starts_with("line 2") && error.contains("zenith"), "{error}");
        assert!(directions_of("1,0,90\nx\n").unwrap_err().starts_with("line 2"));
    }

    #[test]
    fn a_band_looks_all_around() {
        let model = crate::catalogue::nominal("livox-mid-360").unwrap();
        let pattern = model.pattern().unwrap();
        assert_eq!((pattern.lines(), pattern.columns(), pattern.axis()), (4, 50_000, DVec3::Z));
        let elevations = pattern.directions().iter().map(|d| f64::from(d[2]).asin().to_degrees());
        let (low, high) = elevations.fold((90.0_f64, -90.0_f64), |(low, high), e| (low.min(e), high.max(e)));
        assert!((-7.22..-6.0).contains(&low) && (54.0..55.22).contains(&high), "{low} {high}");
        assert!(crate::catalogue::nominal("livox-avia").unwrap().pattern().unwrap().axis().x > 0.99);
    }
}
