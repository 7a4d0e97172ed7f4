//! The mount of a recording's sensors where no mount file is given: a bag's static transforms, or level for a single sensor.

use std::path::Path;

use sensors::catalogue;
use sensors::router::{Family, Router, Sensor};

use crate::base::geometry::Pose;
use crate::live::watch::is_model;
use crate::recording::Session;
use crate::recording::bags::{FrameTree, PLATFORM_FRAME, Surroundings};
use crate::recording::packet_reader::PacketReader;
use crate::recording::sensor_ids::ids;
use crate::recording::source::{Recording, RecordingError, look_first};
use crate::recording::unread::why_nothing;
use crate::rig::{Mount, MountFile, MountedSensor, SensorEntry};

/// The mounts of all sensors of a bag with packets; none where its static transforms lack one of them. What was concluded goes
/// to `notices`.
pub(crate) fn of_bag(
    recording: &Recording,
    notices: &mut Vec<String>,
) -> Result<Option<MountFile>, RecordingError> {
    if !recording.is_bag() || recording.holds_clouds_only() {
        return Ok(None);
    }
    let frames = Surroundings::read(recording.path(), &recording.name())?.frames;
    if frames.is_empty() {
        return Ok(None);
    }
    let router = first_sensors(recording)?;
    let is_only = router.sensors().len() == 1;
    let mut entries = Vec::new();
    for sensor in router.sensors() {
        let Some(name) = &sensor.name else { return Ok(None) };
        let Some((frame, base, base_from_sensor)) = place_of(&frames, sensor, name, is_only) else {
            notices.push(format!(
                "the static transforms of the bag have no frame of {name} (looked for {name}/os_sensor, {name}_velodyne and the like)"
            ));
            return Ok(None);
        };
        let Some(entry) = entry_of(sensor, name, Mount::from_body(&base_from_sensor), notices)? else {
            return Ok(None);
        };
        notices.push(format!("{name}: mounted as the static transforms say, {frame} in {base}"));
        entries.push(entry);
    }
    Ok((!entries.is_empty()).then(|| MountFile::new(entries)))
}

/// A single sensor is the body: level at its origin.
pub(crate) fn of_only_sensor(
    recording: &Recording,
    session: Option<&Session>,
    notices: &mut Vec<String>,
) -> Result<MountFile, RecordingError> {
    let slots = session.map_or(&[][..], |session| &session.manifest().sensors);
    let mut router = first_sensors(recording)?;
    if router.sensors().is_empty() {
        router = recording.router()?;
        let ending = recording.each_packet(&mut |packet| {
            router.push(packet, &mut |_, _, _| {});
        })?;
        router.finish(&mut |_, _, _| {});
        if router.sensors().is_empty() {
            return Err(RecordingError::NothingRead(why_nothing(recording, &router, &ending)));
        }
    }
    let without = |why| RecordingError::NoMount { recording: recording.name(), why };
    let ([sensor], [] | [_]) = (router.sensors(), slots) else {
        let of_session: Vec<String> = slots.iter().map(|slot| slot.name.clone()).collect();
        let names = if of_session.is_empty() { ids(&router) } else { of_session };
        let (count, names) = (names.len(), names.join(", "));
        return Err(without(format!("a file that says where its {count} sensors sit: {names}")));
    };
    let slot = slots.first().map(|slot| &slot.name);
    let name = slot.or(sensor.name.as_ref()).map_or("sensor", String::as_str);
    let entry = entry_of(sensor, name, Mount::default(), &mut Vec::new())?.ok_or_else(|| {
        let product = sensor.product();
        without(format!(
            "a file that names the model of the sensor: no model of the catalogue is called {product:?}"
        ))
    })?;
    notices.push(format!(
        "{name}: no mount is given; it is level at the origin of the body (--mount FILE places it otherwise)"
    ));
    Ok(MountFile::new(vec![entry]))
}

/// What a look at the first packets finds: a Velodyne's say which model it is.
fn first_sensors(recording: &Recording) -> Result<Router, RecordingError> {
    let mut router = recording.router()?;
    let mut reader = PacketReader::open(recording.path(), &recording.name())?;
    look_first(|| {
        router.push(&reader.next().ok()??, &mut |_, _, _| {});
        Some(true)
    });
    Ok(router)
}

/// A sensor at a mount, as a mount file names it; none where the catalogue does not have it, which goes to `notices`.
fn entry_of(
    sensor: &Sensor,
    name: &str,
    mount: Mount,
    notices: &mut Vec<String>,
) -> Result<Option<SensorEntry>, RecordingError> {
    let Some(model) = sensor.model() else { return Ok(None) };
    let product = sensor.product();
    let known = catalogue::names();
    let by_name = known.iter().find(|known| **known == model.name);
    let Some(model) = by_name.or_else(|| known.iter().find(|known| is_model(known, &product, &model.name)))
    else {
        notices.push(format!("{name}: a {product} is not in the catalogue of sensors: give --mount"));
        return Ok(None);
    };
    let last = Path::new(name).file_name().map_or(name.into(), |last| last.to_string_lossy());
    let model = catalogue::nominal(model)?;
    Ok(Some(SensorEntry::of(&MountedSensor { name: last.into_owned(), model, mount })))
}

/// The frame of a sensor, that of the platform, and the one in the other.
fn place_of(
    frames: &FrameTree,
    sensor: &Sensor,
    name: &str,
    is_only: bool,
) -> Option<(String, String, Pose)> {
    let last = name.rsplit('/').next().unwrap_or(name);
    let own = match sensor.family() {
        Family::Ouster(_) => ["os_sensor", "os_lidar"].as_slice(),
        Family::Velodyne(_) => &["velodyne"],
    };
    let of_own = own.iter().flat_map(|own| {
        let prefixed =
            [name, last].into_iter().flat_map(move |name| [format!("{name}/{own}"), format!("{name}_{own}")]);
        prefixed.chain(is_only.then(|| (*own).to_owned()))
    });
    let by_name = [name.to_owned(), last.to_owned()];
    let frame = of_own.chain(by_name).find(|frame| frames.holds(frame))?;
    let base = match frames.a_from_b(PLATFORM_FRAME, &frame).is_some() {
        true => PLATFORM_FRAME.to_owned(),
        false => frames.root_of(&frame)?.to_owned(),
    };
    let mut base_from_sensor = frames.a_from_b(&base, &frame)?;
    if frame.ends_with("os_lidar") {
        let sensor_from_lidar = sensor.model()?.sensor_from_lidar();
        let rotation = glam::DQuat::from_mat3(&sensor_from_lidar.matrix3);
        base_from_sensor = base_from_sensor * Pose::new(rotation, sensor_from_lidar.translation).inverse();
    }
    Some((frame, base, base_from_sensor))
}
