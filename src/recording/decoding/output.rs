//! Where `decode` writes points: one file, a folder with a file per sensor and frame, or a ROS 2 bag.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sensors::ouster::ImuSample;
use sensors::router::Sensor;
use sensors::{Frame, SensorModel};
use serde::Serialize;

use super::error::DecodingError;
use super::placing::{Placing, Transforms};
use super::spec::DecodingSpec;
use crate::base::files::folder_of;
use crate::recording::export::{Cloud, Export, ExportError, FileFrame, Format, Source, write_bag_metadata};
use crate::recording::sensor_ids;
use crate::recording::source::Recording;

/// A point file that was written.
#[derive(Clone, Serialize)]
pub(crate) struct WrittenFile {
    /// Where.
    pub path: String,
    /// How many points it holds.
    pub points: u64,
}

/// Point files being written.
pub(super) struct Output {
    format: Format,
    destination: Destination,
    frame: FileFrame,
    force: bool,
    points: u64,
    has_inertial_samples: bool,
    sources: HashMap<usize, Arc<Source>>,
    clouds: HashMap<usize, Cloud>,
    ids: Vec<String>,
    /// Sensors whose place on the rig is written.
    stated: HashSet<usize>,
    files: Vec<WrittenFile>,
}

enum Destination {
    /// One file; a bag is one, too, with its metadata in its folder.
    File {
        path: PathBuf,
        export: Option<Export>,
        sensor: Option<usize>,
        bag: bool,
    },
    Folder(PathBuf),
}

impl Output {
    /// As asked for; `None` when no points are wanted.
    pub(super) fn new(
        spec: &DecodingSpec,
        recording: &Recording,
        frame: FileFrame,
    ) -> Result<Option<Self>, DecodingError> {
        if spec.out.as_deref() == Some(Path::new("-")) {
            return Err(DecodingError::Stdout);
        }
        let by_extension = spec.out.as_deref().and_then(Format::of_path);
        let format = match (spec.format, by_extension) {
            (Some(asked), Some(stated))
                if asked.extension() != stated.extension()
                    && !(spec.out.as_deref().is_some_and(Path::is_dir)) =>
            {
                let out = spec.out.as_deref().map_or(String::new(), |out| out.display().to_string());
                return Err(DecodingError::Contradiction { asked: asked.extension(), out });
            }
            (Some(format), _) | (None, Some(format)) => format,
            (None, None) => match &spec.out {
                Some(out) => return Err(DecodingError::WhichFormat { out: out.display().to_string() }),
                None => return Ok(None),
            },
        };
        let (out, is_file) = match &spec.out {
            Some(out) => (out.clone(), !is_folder_name(out)),
            None => default_destination(recording, format, &frame),
        };
        let name = out.display().to_string();
        if !is_file && out.exists() && !out.is_dir() {
            return Err(DecodingError::NoFolder { out: name });
        }
        if recording.is_read_from(&out) {
            return Err(DecodingError::Itself { out: name });
        }
        let parent = folder_of(&out);
        if spec.out.is_some() && !parent.is_dir() {
            return Err(DecodingError::NoParent { out: name, parent: parent.display().to_string() });
        }
        if frame.is_far() && !format.holds_far_points() {
            return Err(DecodingError::TooFar { format: format.extension(), at_m: frame.origin.world_m() });
        }
        let bag = !is_file && format == Format::Mcap;
        let destination = match is_file || bag {
            true => {
                let path = if bag { out.join(bag_file_name(&out)) } else { out };
                if path.exists() && !spec.is_forced {
                    return Err(ExportError::Exists { path }.into()); // before the work, not after
                }
                Destination::File { path, export: None, sensor: None, bag }
            }
            false => Destination::Folder(out),
        };
        Ok(Some(Self {
            format,
            destination,
            frame,
            force: spec.is_forced,
            points: 0,
            has_inertial_samples: false,
            sources: HashMap::new(),
            clouds: HashMap::new(),
            ids: Vec::new(),
            stated: HashSet::new(),
            files: Vec::new(),
        }))
    }

    /// Writes the points of a frame, the sensor's `number`th, if there are any.
    pub(super) fn add(
        &mut self,
        at: usize,
        number: u64,
        sensor: &Sensor,
        model: &SensorModel,
        frame: &Frame,
        placing: &mut Placing<'_>,
    ) -> Result<(), DecodingError> {
        let source = self.source(at, sensor);
        let cloud = self.clouds.entry(at).or_insert_with(|| Cloud::new(source, model));
        cloud.fill(model, frame);
        let transforms = placing.apply(at, sensor, frame, cloud)?;
        if cloud.points.is_empty() {
            return Ok(());
        }
        self.add_transforms(at, &transforms)?;
        self.write(at, number)
    }

    /// Writes where a sensor sits, once where nothing moves it, and where the rig was.
    fn add_transforms(&mut self, at: usize, transforms: &Transforms) -> Result<(), ExportError> {
        let Some(cloud) = self.clouds.get(&at).filter(|_| self.format.holds_transforms()) else {
            return Ok(());
        };
        let stamp_ns = cloud.stamp_ns();
        // recorded when the host's clock showed it
        let host_from_stamp_ns =
            if cloud.host_time_ns > 0 { cloud.host_time_ns.wrapping_sub(stamp_ns) } else { 0 };
        let times_ns = |stamp_ns: u64| [stamp_ns.wrapping_add(host_from_stamp_ns), stamp_ns];
        let Destination::File { path, export, bag, .. } = &mut self.destination else { return Ok(()) };
        if let Some((frame, is_moved)) = &transforms.sensor
            && (self.stated.insert(at) || *is_moved)
        {
            let file = begun(export, &self.frame, path, *bag, self.format, self.force)?;
            file.add_frames(!is_moved, times_ns(stamp_ns), std::slice::from_ref(frame))?;
        }
        for (time_ns, frame) in &transforms.rig {
            let file = begun(export, &self.frame, path, *bag, self.format, self.force)?;
            file.add_frames(false, times_ns(*time_ns), std::slice::from_ref(frame))?;
        }
        Ok(())
    }

    /// Writes points that a bag holds, the topic's `number`th cloud, if there are any.
    pub(super) fn add_cloud(
        &mut self,
        at: usize,
        number: u64,
        cloud: Cloud,
        transforms: &Transforms,
    ) -> Result<(), DecodingError> {
        if cloud.points.is_empty() {
            return Ok(());
        }
        self.clouds.insert(at, cloud);
        self.add_transforms(at, transforms)?;
        self.write(at, number)
    }

    fn write(&mut self, at: usize, number: u64) -> Result<(), DecodingError> {
        let Some(cloud) = self.clouds.get(&at) else { return Ok(()) };
        self.points += cloud.points.len() as u64;
        match &mut self.destination {
            Destination::File { path, export, sensor, bag } => {
                let first = *sensor.get_or_insert(at);
                if first != at && self.frame.name.is_none() && !self.format.holds_several_sensors() {
                    let name =
                        |at: &usize| self.clouds.get(at).map_or(String::new(), |c| c.source.id.clone());
                    return Err(DecodingError::Mixed {
                        path: path.clone(),
                        first: name(&first),
                        second: name(&at),
                    });
                }
                let file = begun(export, &self.frame, path, *bag, self.format, self.force)?;
                file.add(&self.clouds[&at])?;
            }
            Destination::Folder(folder) => {
                let name = format!("{}_{:06}.{}", cloud.source.id, number, self.format.extension());
                let path = folder.join(name);
                let mut export = begin(&self.frame, &path, true, self.format, self.force)?;
                export.add(cloud)?;
                let points = export.finish()?.points;
                self.files.push(WrittenFile { path: path.display().to_string(), points });
            }
        }
        Ok(())
    }

    /// Writes an inertial sample where the format has a place for one: in MCAP with ROS 2 messages.
    pub(super) fn add_imu(
        &mut self,
        at: usize,
        sensor: &Sensor,
        sample: &ImuSample,
        host_time_ns: u64,
    ) -> Result<(), ExportError> {
        if self.format != Format::Mcap {
            return Ok(());
        }
        let source = self.source(at, sensor);
        if let Destination::File { path, export, bag, .. } = &mut self.destination {
            let file = begun(export, &self.frame, path, *bag, self.format, self.force)?;
            file.add_imu(&source, sample, host_time_ns)?;
            self.has_inertial_samples = true;
        }
        Ok(())
    }

    fn source(&mut self, at: usize, sensor: &Sensor) -> Arc<Source> {
        let mut describe = || Source::of(sensor, sensor_ids::next_id(sensor, &mut self.ids), at);
        Arc::clone(self.sources.entry(at).or_insert_with(|| Arc::new(describe())))
    }

    /// Whether the files would be empty. Inertial samples alone are something, except where points were selected.
    pub(super) fn holds_nothing(&self, is_selective: bool) -> bool {
        self.points == 0 && (is_selective || !self.has_inertial_samples)
    }

    /// Ends the last file; lists all of them.
    pub(super) fn finish(mut self) -> Result<Vec<WrittenFile>, ExportError> {
        if let Destination::File { path, export: Some(export), bag, .. } = self.destination {
            let written = export.finish()?;
            self.files.push(WrittenFile { path: path.display().to_string(), points: written.points });
            if let (true, Some(folder), Some(name)) = (bag, path.parent(), path.file_name()) {
                write_bag_metadata(folder, &name.to_string_lossy(), &written)?;
            }
        }
        Ok(self.files)
    }
}

/// Refuses, before the work, what cannot be written.
pub(crate) fn ensure_output(spec: &DecodingSpec, recording: &Recording) -> Result<(), DecodingError> {
    Output::new(spec, recording, FileFrame::default()).map(drop)
}

/// A file that is begun when it is first written to.
fn begun<'a>(
    export: &'a mut Option<Export>,
    frame: &FileFrame,
    path: &Path,
    makes_folder: bool,
    format: Format,
    force: bool,
) -> Result<&'a mut Export, ExportError> {
    Ok(match export {
        Some(file) => file,
        None => export.insert(begin(frame, path, makes_folder, format, force)?),
    })
}

/// Begins a file; `makes_folder`: its folder is part of what was asked for.
fn begin(
    frame: &FileFrame,
    path: &Path,
    makes_folder: bool,
    format: Format,
    force: bool,
) -> Result<Export, ExportError> {
    let folder = folder_of(path);
    if makes_folder && !folder.is_dir() {
        std::fs::create_dir(folder)
            .map_err(|error| ExportError::Write { path: folder.to_owned(), cause: error.into() })?;
    }
    Export::create_in(frame, path, format, force)
}

/// `FOLDER/FOLDER_0.mcap`, as ROS 2 names the files of a bag.
fn bag_file_name(folder: &Path) -> String {
    let name = folder.file_name().map_or("bag".into(), |name| name.to_string_lossy());
    format!("{name}_0.mcap")
}

/// A folder that is there, a name that ends in `/`, a name without an extension.
fn is_folder_name(out: &Path) -> bool {
    out.is_dir() || out.as_os_str().as_encoded_bytes().ends_with(b"/") || out.extension().is_none()
}

/// In the current folder, named after the recording; and whether it is a file.
fn default_destination(recording: &Recording, format: Format, frame: &FileFrame) -> (PathBuf, bool) {
    let name = PathBuf::from(recording.name());
    let mut stem = name.file_stem().map_or("points".into(), |stem| stem.to_string_lossy().into_owned());
    if let Some(inner) = stem.strip_suffix(".pcap").or(stem.strip_suffix(".pcapng")) {
        stem = inner.to_owned(); // of a gzipped file
    }
    match format.is_per_frame() && frame.name.is_none() {
        true => (PathBuf::from(stem), false),
        false => (PathBuf::from(format!("{stem}.{}", format.extension())), true),
    }
}
