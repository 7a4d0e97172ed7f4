use std::net::SocketAddr;

use sensors::catalogue;
use sensors::ouster::{ImuProfile, Profile};
use sensors::velodyne::ReturnMode;

pub(super) fn parse_address(text: &str) -> Result<SocketAddr, String> {
    use std::net::ToSocketAddrs as _;
    let mut found =
        text.to_socket_addrs().map_err(|error| format!("{text:?}: {error}; expected HOST:PORT"))?;
    found.next().ok_or_else(|| format!("{text:?} has no address"))
}

pub(super) fn parse_model(text: &str) -> Result<String, String> {
    catalogue::decoded(text).map(|_| text.to_owned()).map_err(|error| error.to_string())
}

pub(super) fn parse_profile(text: &str) -> Result<Profile, String> {
    let names = || Profile::all().map(Profile::name).collect::<Vec<_>>().join(", ");
    Profile::from_name(&text.to_uppercase()).ok_or_else(|| format!("{text:?}; known are {}", names()))
}

pub(super) fn parse_imu_profile(text: &str) -> Result<ImuProfile, String> {
    ImuProfile::from_name(&text.to_uppercase())
        .filter(|profile| *profile != ImuProfile::Off)
        .ok_or_else(|| format!("{text:?}; known are LEGACY, ACCEL32_GYRO32_NMEA"))
}

pub(super) fn parse_returns(text: &str) -> Result<ReturnMode, String> {
    match text {
        "strongest" => Ok(ReturnMode::Strongest),
        "last" => Ok(ReturnMode::Last),
        "dual" => Ok(ReturnMode::Dual),
        _ => Err(format!("{text:?}; known are strongest, last, dual")),
    }
}
