//! Coordinate reference systems of survey files: the transverse Mercator grids that people name by their EPSG number, and any
//! other as the well-known text of a file. Source of the numbers: EPSG geodetic parameter dataset, as PROJ 9 writes it.

use std::path::Path;
use std::str::FromStr;

use crate::base::files;

/// A reference system as well-known text (OGC 01-009, as LAS 1.4 wants it).
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ReferenceSystem {
    pub wkt: String,
}

/// The most bytes of a file with a reference system.
const MOST_BYTES: u64 = 1 << 16;

/// Geographic system: name, datum, ellipsoid and its number, numbers of datum and system.
type Geographic = (&'static str, &'static str, &'static str, u32, u32, u32);

const AIRY_1830: &str = "\"Airy 1830\",6377563.396,299.3249646";
const BESSEL_1841: &str = "\"Bessel 1841\",6377397.155,299.1528128";
const GRS_1980: &str = "\"GRS 1980\",6378137,298.257222101";
const WGS_84: &str = "\"WGS 84\",6378137,298.257223563";

const DHDN: Geographic = ("DHDN", "Deutsches_Hauptdreiecksnetz", BESSEL_1841, 7004, 6314, 4314);
const ETRS89: Geographic =
    ("ETRS89", "European_Terrestrial_Reference_System_1989", GRS_1980, 7019, 6258, 4258);
const GDA94: Geographic = ("GDA94", "Geocentric_Datum_of_Australia_1994", GRS_1980, 7019, 6283, 4283);
const GDA2020: Geographic = ("GDA2020", "Geocentric_Datum_of_Australia_2020", GRS_1980, 7019, 1168, 7844);
const NAD83: Geographic = ("NAD83", "North_American_Datum_1983", GRS_1980, 7019, 6269, 4269);
const NZGD2000: Geographic = ("NZGD2000", "New_Zealand_Geodetic_Datum_2000", GRS_1980, 7019, 6167, 4167);
const OSGB36: Geographic = ("OSGB36", "Ordnance_Survey_of_Great_Britain_1936", AIRY_1830, 7001, 6277, 4277);
const POLAND: Geographic = ("ETRF2000-PL", "ETRF2000_Poland", GRS_1980, 7019, 1305, 9702);
const SWEREF99: Geographic = ("SWEREF99", "SWEREF99", GRS_1980, 7019, 6619, 4619);
const WGS84: Geographic = ("WGS 84", "WGS_1984", WGS_84, 7030, 6326, 4326);

/// A transverse Mercator grid in metres: name, geographic system, latitude of origin, central meridian (degrees), scale, false
/// easting and northing (m).
struct Grid(String, Geographic, [f64; 5]);

impl Grid {
    fn of_epsg(code: u32) -> Option<Self> {
        let utm = |system: Geographic, zone: u32, name: String, northing_m: f64| {
            Self(name, system, [0.0, f64::from(zone) * 6.0 - 183.0, 0.9996, 500_000.0, northing_m])
        };
        let one = |name: &str, system, numbers| Self(name.into(), system, numbers);
        Some(match code {
            32_601..=32_660 => {
                utm(WGS84, code - 32_600, format!("WGS 84 / UTM zone {}N", code - 32_600), 0.0)
            }
            32_701..=32_760 => {
                utm(WGS84, code - 32_700, format!("WGS 84 / UTM zone {}S", code - 32_700), 1e7)
            }
            25_828..=25_838 => {
                utm(ETRS89, code - 25_800, format!("ETRS89 / UTM zone {}N", code - 25_800), 0.0)
            }
            26_901..=26_923 => utm(NAD83, code - 26_900, format!("NAD83 / UTM zone {}N", code - 26_900), 0.0),
            28_348..=28_358 => utm(GDA94, code - 28_300, format!("GDA94 / MGA zone {}", code - 28_300), 1e7),
            7_846..=7_859 => utm(GDA2020, code - 7_800, format!("GDA2020 / MGA zone {}", code - 7_800), 1e7),
            31_466..=31_469 => {
                let zone = code - 31_464;
                let (meridian_deg, easting_m) = (f64::from(3 * zone), f64::from(zone) * 1e6 + 500_000.0);
                let name = format!("DHDN / 3-degree Gauss-Kruger zone {zone}");
                Self(name, DHDN, [0.0, meridian_deg, 1.0, easting_m, 0.0])
            }
            2_180 => one("ETRF2000-PL / CS92", POLAND, [0.0, 19.0, 0.9993, 500_000.0, -5_300_000.0]),
            2_193 => one(
                "NZGD2000 / New Zealand Transverse Mercator 2000",
                NZGD2000,
                [0.0, 173.0, 0.9996, 1_600_000.0, 1e7],
            ),
            3_006 => one("SWEREF99 TM", SWEREF99, [0.0, 15.0, 0.9996, 500_000.0, 0.0]),
            3_067 => one("ETRS89 / TM35FIN(E,N)", ETRS89, [0.0, 27.0, 0.9996, 500_000.0, 0.0]),
            27_700 => one(
                "OSGB36 / British National Grid",
                OSGB36,
                [49.0, -2.0, 0.999_601_271_7, 400_000.0, -100_000.0],
            ),
            _ => return None,
        })
    }

    fn wkt(&self, code: u32) -> String {
        let Self(name, (system, datum, ellipsoid, ellipsoid_code, datum_code, system_code), numbers) = self;
        let names =
            ["latitude_of_origin", "central_meridian", "scale_factor", "false_easting", "false_northing"];
        let parameters: String = names
            .iter()
            .zip(numbers)
            .map(|(name, value)| format!("PARAMETER[\"{name}\",{value}],"))
            .collect();
        format!(
            "PROJCS[\"{name}\",GEOGCS[\"{system}\",DATUM[\"{datum}\",SPHEROID[{ellipsoid},AUTHORITY[\"EPSG\",\"{ellipsoid_code}\"]],\
             AUTHORITY[\"EPSG\",\"{datum_code}\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],\
             UNIT[\"degree\",0.0174532925199433,AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"{system_code}\"]],\
             PROJECTION[\"Transverse_Mercator\"],{parameters}UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],\
             AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH],AUTHORITY[\"EPSG\",\"{code}\"]]"
        )
    }
}

impl FromStr for ReferenceSystem {
    type Err = String;

    /// `EPSG:N`, or the path of a file with well-known text.
    fn from_str(text: &str) -> Result<Self, String> {
        let of_epsg = text.get(..5).filter(|start| start.eq_ignore_ascii_case("epsg:")).map(|_| &text[5..]);
        let Some(code) = of_epsg else { return Self::of_file(Path::new(text)) };
        let code: u32 = code.trim().parse().map_err(|_| format!("{text:?}: expected EPSG: and a number"))?;
        let grid = Grid::of_epsg(code).ok_or_else(|| {
            format!(
                "EPSG:{code} is none of the grids known here (UTM of WGS 84, ETRS89 and NAD83, MGA, Gauss-Kruger of DHDN, and 2180, \
                 2193, 3006, 3067, 27700): give the file that `projinfo EPSG:{code} -o WKT1:GDAL -q` writes"
            )
        })?;
        Ok(Self { wkt: grid.wkt(code) })
    }
}

impl ReferenceSystem {
    fn of_file(path: &Path) -> Result<Self, String> {
        let name = path.display();
        let expected = "expected EPSG:N, or a file with well-known text (WKT)";
        let length = std::fs::metadata(path).map_err(|error| format!("{name}: {error}; {expected}"))?.len();
        if length > MOST_BYTES {
            return Err(format!("{name}: {length} bytes; {expected} of {MOST_BYTES} bytes at most"));
        }
        let wkt = files::read_text(path).map_err(|error| format!("{name}: {error}; {expected}"))?;
        let wkt = wkt.trim().trim_end_matches('\0');
        let is_projected = ["PROJCS[", "COMPD_CS[", "PROJCRS[", "COMPOUNDCRS[", "GEOCCS[", "LOCAL_CS["]
            .iter()
            .any(|start| wkt.starts_with(start));
        if wkt.starts_with("GEOGCS[") || wkt.starts_with("GEOGCRS[") {
            return Err(format!(
                "{name}: it counts in degrees, and points are in metres; expected a projected system"
            ));
        }
        if !is_projected || wkt.matches('[').count() != wkt.matches(']').count() {
            let start: String = wkt.chars().take(20).collect();
            return Err(format!("{name}: begins with {start:?}; {expected}"));
        }
        Ok(Self { wkt: wkt.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As PROJ 9.5 writes it.
    #[test]
    fn grids_are_written_as_proj_writes_them() {
        let utm: ReferenceSystem = "EPSG:25832".parse().unwrap();
        assert_eq!(
            utm.wkt,
            "PROJCS[\"ETRS89 / UTM zone 32N\",GEOGCS[\"ETRS89\",DATUM[\"European_Terrestrial_Reference_System_1989\",\
             SPHEROID[\"GRS 1980\",6378137,298.257222101,AUTHORITY[\"EPSG\",\"7019\"]],AUTHORITY[\"EPSG\",\"6258\"]],\
             PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433,AUTHORITY[\"EPSG\",\"9122\"]],\
             AUTHORITY[\"EPSG\",\"4258\"]],PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],\
             PARAMETER[\"central_meridian\",9],PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],\
             PARAMETER[\"false_northing\",0],UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Easting\",EAST],\
             AXIS[\"Northing\",NORTH],AUTHORITY[\"EPSG\",\"25832\"]]"
        );
        let south: ReferenceSystem = "epsg:32733".parse().unwrap();
        assert!(
            south.wkt.contains("\"central_meridian\",15]")
                && south.wkt.contains("\"false_northing\",10000000]")
        );
        let zone: ReferenceSystem = "EPSG:31467".parse().unwrap();
        assert!(
            zone.wkt.contains("\"central_meridian\",9]") && zone.wkt.contains("\"false_easting\",3500000]")
        );
    }

    #[test]
    fn unknown_systems_are_refused_with_advice() {
        for (wrong, words) in
            [("EPSG:2056", "projinfo EPSG:2056"), ("EPSG:x", "a number"), ("no-such-file", "expected EPSG:N")]
        {
            let error = wrong.parse::<ReferenceSystem>().unwrap_err();
            assert!(error.contains(words), "{error}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grid.wkt");
        for (content, is_used) in [
            ("PROJCS[\"a\",GEOGCS[\"b\"]]\n", true),
            ("GEOGCS[\"b\"]", false),
            ("PROJCS[\"a\"", false),
            ("", false),
        ] {
            std::fs::write(&path, content).unwrap();
            assert_eq!(path.to_str().unwrap().parse::<ReferenceSystem>().is_ok(), is_used, "{content}");
        }
    }
}
