//! `db.xml`: a serialised C++ object, degrees and centimetres.

use roxmltree::{Document, Node, ParsingOptions};

use super::{Calibration, CalibrationError, LaserCalibration, content, in_order};

/// A file of 64 lasers has some 3000 nodes.
const MOST_NODES: u32 = 100_000;

pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    let options = ParsingOptions { allow_dtd: true, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)
        .map_err(|error| CalibrationError::Syntax { reason: error.to_string() })?;
    let root = document.root_element();
    let database = descendant(root, "DB").unwrap_or(root);
    let points = descendant(database, "points_")
        .ok_or_else(|| content("points_", "no such element: is this the db.xml of a Velodyne?"))?;
    let listed = |name: &str| match descendant(database, name) {
        Some(list) => items(list).map(|item| number(item, name)).collect::<Result<Vec<f64>, _>>(),
        None => Ok(Vec::new()),
    };
    let (enabled, least, most) = (listed("enabled_")?, listed("minIntensity_")?, listed("maxIntensity_")?);
    let mut lasers = Vec::new();
    for item in items(points) {
        let laser = descendant(item, "px").unwrap_or(item);
        let id = field(laser, "id_")? as i64;
        let at = |list: &[f64], otherwise: f64| {
            usize::try_from(id).ok().and_then(|id| list.get(id)).copied().unwrap_or(otherwise)
        };
        let near_cm = [optional(laser, "distCorrectionX_")?, optional(laser, "distCorrectionY_")?];
        lasers.push((
            id,
            LaserCalibration {
                vertical_rad: field(laser, "vertCorrection_")?.to_radians(),
                rotation_rad: field(laser, "rotCorrection_")?.to_radians(),
                distance_m: field(laser, "distCorrection_")? * 0.01,
                near_distance_m: match near_cm {
                    [Some(x), Some(y)] if [x, y] != [0.0; 2] => Some([x * 0.01, y * 0.01]),
                    _ => None,
                },
                vertical_offset_m: optional(laser, "vertOffsetCorrection_")?.map(|cm| cm * 0.01),
                horizontal_offset_m: optional(laser, "horizOffsetCorrection_")?.unwrap_or(0.0) * 0.01,
                focal_distance_m: optional(laser, "focalDistance_")?.unwrap_or(0.0) * 0.01,
                focal_slope: optional(laser, "focalSlope_")?.unwrap_or(0.0),
                intensity_limits: [at(&least, 0.0), at(&most, 255.0)]
                    .map(|level| level.clamp(0.0, 255.0) as u8),
                enabled: at(&enabled, 1.0) != 0.0,
            },
        ));
    }
    // the file of a 32-laser sensor still lists 64 places: the rest is not enabled
    if let Some(used) = enabled.iter().rposition(|enabled| *enabled != 0.0)
        && enabled.len() == lasers.len()
    {
        lasers.retain(|(id, _)| *id <= used as i64);
    }
    let distance_unit_m = optional(database, "distLSB_")?.map(|cm| cm * 0.01);
    Ok(Calibration { distance_unit_m, lasers: in_order(lasers)? })
}

fn descendant<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.descendants().find(|node| node.has_tag_name(name))
}

fn items<'a, 'input>(list: Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    list.children().filter(|node| node.has_tag_name("item"))
}

fn field(laser: Node<'_, '_>, name: &str) -> Result<f64, CalibrationError> {
    optional(laser, name)?.ok_or_else(|| content(line_of(laser), format!("no {name}")))
}

fn optional(parent: Node<'_, '_>, name: &str) -> Result<Option<f64>, CalibrationError> {
    parent.children().find(|node| node.has_tag_name(name)).map(|node| number(node, name)).transpose()
}

fn number(node: Node<'_, '_>, name: &str) -> Result<f64, CalibrationError> {
    let text = node.text().unwrap_or_default().trim();
    text.parse().map_err(|_| content(line_of(node), format!("{name} is {text:?}, expected a number")))
}

fn line_of(node: Node<'_, '_>) -> String {
    format!("line {}", node.document().text_pos_at(node.range().start).row)
}

#[cfg(test)]
mod tests {
    use super::super::Calibration;

    fn file(lasers: &str, enabled: &str) -> String {
        format!(
            "<?xml version=\"1.0\"?>\n<!DOCTYPE boost_serialization>\n<boost_serialization><DB class_id=\"0\">\
             <distLSB_>0.2</distLSB_><enabled_><count>2</count><item_version>0</item_version>{enabled}</enabled_>\
             <minIntensity_><count>2</count><item>30</item><item>40</item></minIntensity_>\n\
             <points_><count>2</count>{lasers}</points_></DB></boost_serialization>"
        )
    }

    fn laser(id: u32) -> String {
        format!(
            "<item><px class_id=\"5\"><id_>{id}</id_><rotCorrection_>-5.5</rotCorrection_>\
             <vertCorrection_>-7.25</vertCorrection_><distCorrection_>111</distCorrection_>\
             <distCorrectionX_>118</distCorrectionX_><distCorrectionY_>119</distCorrectionY_>\
             <vertOffsetCorrection_>19.7</vertOffsetCorrection_><horizOffsetCorrection_>2.6</horizOffsetCorrection_>\
             <focalDistance_>1200</focalDistance_><focalSlope_>1.4</focalSlope_></px></item>"
        )
    }

    #[test]
    fn degrees_and_centimetres_become_radians_and_metres() {
        let text = file(&(laser(0) + &laser(1)), "<item>1</item><item>1</item>");
        let calibration = Calibration::from_bytes(text.as_bytes()).unwrap();
        assert_eq!(calibration.lasers.len(), 2);
        let second = calibration.lasers[1];
        assert_eq!(second.vertical_rad, (-7.25_f64).to_radians());
        assert_eq!(second.rotation_rad, (-5.5_f64).to_radians());
        assert!((second.distance_m - 1.11).abs() < 1e-12);
        assert_eq!(
            second.near_distance_m.map(|near| near.map(|m| (m * 100.0).round())),
            Some([118.0, 119.0])
        );
        assert!((second.focal_distance_m - 12.0).abs() < 1e-12);
        assert_eq!(second.intensity_limits, [40, 255]);
        assert!((calibration.distance_unit_m.unwrap() - 0.002).abs() < 1e-12);
    }

    #[test]
    fn places_that_are_not_in_use_are_left_out() {
        let text = file(&(laser(0) + &laser(1)), "<item>1</item><item>0</item>");
        assert_eq!(Calibration::from_db_xml(&text).unwrap().lasers.len(), 1);
    }

    #[test]
    fn errors_name_their_line() {
        let refused = |text: &str, words: &[&str]| {
            let error = Calibration::from_db_xml(text).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        };
        refused("<a/>", &["points_"]);
        refused("<a>", &["never closed"]);
        refused(&file("<item><px><id_>0</id_></px></item>", ""), &["line 4", "vertCorrection_"]);
        refused(&file(&laser(0).replace("111", "far"), ""), &["line 4", "distCorrection_", "far"]);
        refused(&file(&(laser(1) + &laser(1)), ""), &["laser 1", "twice"]);
    }
}
