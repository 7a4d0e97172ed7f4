//! Extrinsics as JSON: a 4x4 matrix (a list of 16, or four lists of four), an object of them by sensor, Ouster metadata with
//! the extrinsic that Ouster's programs store there, or Ouster's list of transforms.

use std::path::Path;

use sensors::catalogue;
use serde_json::{Map, Value};

use super::{Extrinsics, Known, matrix};
use crate::base::geometry::Pose;

pub(super) fn parse(text: &str, stem: &str, path: &Path) -> Result<Extrinsics, String> {
    let value: Value = serde_json::from_str(text).map_err(|error| format!("no JSON: {error}"))?;
    match &value {
        Value::Array(_) => {
            let mut found = Extrinsics::default();
            put_matrix(&mut found, stem, &value)?;
            Ok(found)
        }
        Value::Object(object) => match object.get("transforms") {
            Some(Value::Array(transforms)) => ouster_transforms(transforms),
            _ if is_metadata(object) => metadata(object, stem, path),
            _ => by_name(object),
        },
        _ => {
            Err("a single value, expected a 4x4 matrix, an object of them by sensor, or Ouster metadata"
                .into())
        }
    }
}

fn put_matrix(found: &mut Extrinsics, name: &str, value: &Value) -> Result<(), String> {
    let (pose, notice) = numbers(value).and_then(|numbers| matrix::pose(&numbers))?;
    found.notices.extend(notice.map(|notice| format!("{name}: {notice}")));
    found.put(name, pose);
    found.known.insert(name.to_owned(), Known::default());
    Ok(())
}

/// Sixteen numbers: in one list, or in four of four.
fn numbers(value: &Value) -> Result<[f64; 16], String> {
    let expected = "expected 16 numbers of a 4x4 matrix, row by row, or four lists of four";
    let Value::Array(items) = value else { return Err(format!("no list, {expected}")) };
    let flat: Vec<&Value> = if items.iter().all(Value::is_array) {
        items.iter().filter_map(Value::as_array).flatten().collect()
    } else {
        items.iter().collect()
    };
    let numbers: Option<Vec<f64>> = flat.iter().map(|item| item.as_f64()).collect();
    let numbers = numbers.ok_or_else(|| format!("an item is no number, {expected}"))?;
    <[f64; 16]>::try_from(numbers).map_err(|numbers| format!("{} numbers, {expected}", numbers.len()))
}

fn by_name(object: &Map<String, Value>) -> Result<Extrinsics, String> {
    let mut found = Extrinsics::default();
    for (name, value) in object {
        put_matrix(&mut found, name, value).map_err(|reason| format!("{name:?}: {reason}"))?;
    }
    if found.links.is_empty() {
        return Err("has no matrix: expected one by the name of each sensor".into());
    }
    Ok(found)
}

fn is_metadata(object: &Map<String, Value>) -> bool {
    ["beam_intrinsics", "beam_altitude_angles", "sensor_info", "prod_sn"]
        .iter()
        .any(|key| object.contains_key(*key))
}

/// Ouster metadata as ouster-sdk writes them: `ouster-sdk.extrinsic`, where the sensor sits, row by row, in metres.
fn metadata(object: &Map<String, Value>, stem: &str, path: &Path) -> Result<Extrinsics, String> {
    let own = object.get("ouster-sdk").and_then(|own| own.get("extrinsic"));
    let value = own.or_else(|| object.get("extrinsic")).ok_or(
        "Ouster metadata without extrinsics: expected `extrinsic` under `ouster-sdk`, which Ouster's programs write and a \
         sensor does not",
    )?;
    let mut found = Extrinsics::default();
    put_matrix(&mut found, stem, value).map_err(|reason| format!("ouster-sdk.extrinsic: {reason}"))?;
    if found.links.iter().all(|link| link.parent_from_frame == Pose::IDENTITY) {
        found.notices.push(format!(
            "{stem}: its extrinsic is the identity, which is what stands there until somebody sets it"
        ));
    }
    let info = object.get("sensor_info").unwrap_or(&Value::Null);
    let line = info.get("prod_line").or_else(|| object.get("prod_line")).and_then(Value::as_str);
    let model = line.map(|line| line.to_ascii_lowercase().replacen('-', "", 1));
    let model = model.filter(|model| catalogue::nominal(model).is_ok());
    if let (None, Some(line)) = (&model, line) {
        found
            .notices
            .push(format!("{stem}: product line {line} has no model here; --sensor {stem}=MODEL names one"));
    }
    // beams of a unit of a known model are its calibration
    let calibration = model.is_some().then(|| path.to_owned());
    found.known.insert(stem.to_owned(), Known { name: None, model, calibration });
    Ok(found)
}

/// Ouster's list: `source_frame` (a serial number) in `destination_frame`, by position and quaternion.
fn ouster_transforms(transforms: &[Value]) -> Result<Extrinsics, String> {
    let mut found = Extrinsics::default();
    for (index, transform) in transforms.iter().enumerate() {
        let wrong = |reason: String| format!("transforms[{index}]: {reason}");
        let number = |key: &str| {
            let number = transform.get(key).and_then(Value::as_f64).filter(|number| number.is_finite());
            number.ok_or_else(|| wrong(format!("{key} is {}, expected a number", shown(transform.get(key)))))
        };
        let name = transform.get("source_frame").and_then(Value::as_str).filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| {
            wrong(format!(
                "source_frame is {}, expected the sensor's serial number",
                shown(transform.get("source_frame"))
            ))
        })?;
        let rotation = matrix::quaternion([number("q_x")?, number("q_y")?, number("q_z")?, number("q_w")?])
            .map_err(wrong)?;
        let at_m = glam::DVec3::new(number("p_x")?, number("p_y")?, number("p_z")?);
        found.put(name, Pose::new(rotation, at_m));
        found.known.insert(name.to_owned(), Known::default());
    }
    if found.links.is_empty() {
        return Err("transforms is empty: expected one per sensor".into());
    }
    Ok(found)
}

fn shown(value: Option<&Value>) -> String {
    value.map_or("missing".into(), Value::to_string)
}
