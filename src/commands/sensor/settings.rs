//! Settings of a sensor as a person types them.

use std::net::IpAddr;

use serde_json::Value;

/// A setting that is named more than once.
pub(super) fn twice(settings: &[(String, Value)]) -> Option<&str> {
    let again = |at: usize, key: &str| settings[..at].iter().any(|(other, _)| other == key);
    settings.iter().enumerate().find_map(|(at, (key, _))| again(at, key).then_some(key.as_str()))
}

/// An address, a name, or `auto`.
pub(super) fn parse_destination(text: &str) -> Result<String, String> {
    let is_name = text
        .split('.')
        .all(|part| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c)));
    // 300.1.1.1 is no name: the last part of one has letters in it
    let is_number = text.rsplit('.').next().is_some_and(|last| last.chars().all(|c| c.is_ascii_digit()));
    if text.parse::<IpAddr>().is_ok() || (is_name && !is_number) {
        return Ok(text.to_owned());
    }
    Err(format!("{text:?}: expected an address (192.168.1.10), a host's name, or auto"))
}

/// `KEY=VALUE`, the value as JSON or, if it is none, as text.
pub(super) fn parse_setting(text: &str) -> Result<(String, Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("{text:?}: expected KEY=VALUE"))?;
    let key = key.trim();
    if key.is_empty() || !key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!("{key:?}: expected the name of a setting"));
    }
    match serde_json::from_str(value) {
        Ok(value) => Ok((key.to_owned(), value)),
        // what begins as JSON is meant as such
        Err(error) if value.trim_start().starts_with(['[', '{', '"']) => {
            Err(format!("{key}: {value}: no JSON value: {error}"))
        }
        Err(_) => Ok((key.to_owned(), Value::from(value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn destinations_and_settings_as_typed() {
        for good in ["auto", "192.168.1.10", "::1", "rover.lan", "rover-2"] {
            assert_eq!(parse_destination(good).as_deref(), Ok(good));
        }
        for wrong in ["300.1.1.1", "", "a b", "10.0.0", "rover..lan", "1.2.3.4:7502"] {
            assert!(
                parse_destination(wrong).is_err_and(|error| error.contains("expected an address")),
                "{wrong}"
            );
        }
        let window = parse_setting("azimuth_window=[90000,270000]").unwrap();
        assert_eq!(window, ("azimuth_window".to_owned(), serde_json::json!([90000, 270_000])));
        assert_eq!(parse_setting("lidar_mode=1024x10").unwrap().1, "1024x10");
        assert!(parse_setting("azimuth_window=[90000,").is_err_and(|error| error.contains("no JSON value")));
        let settings = ["rpm=600", "laser=on", "rpm=300"].map(|text| parse_setting(text).unwrap());
        assert_eq!((twice(&settings), twice(&settings[..2])), (Some("rpm"), None));
    }
}
