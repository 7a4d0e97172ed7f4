//! E57 (ASTM E2807-11): scans, each in a frame of its own that the file places. Where a scan is placed stood its scanner.

use std::fs::File;
use std::io::BufReader;

use e57::{CartesianCoordinate, E57Reader, Point, PointCloud, PointCloudReaderSimple, RecordName};
use glam::{DQuat, DVec3};

use super::guard::guarded;
use super::{CloudPoint, Fault};
use crate::base::geometry::Pose;

/// A scanner this far from all of its points did not see them: the pose is a shift of coordinates, m.
const FARTHEST_M: f64 = 1000.0;
/// So many points of a scan tell how far the scanner is.
const MOST_JUDGES: usize = 1000;

/// Reads every point of every scan; what is odd about the scans.
pub(super) fn read(file: File, take: &mut dyn FnMut(CloudPoint)) -> Result<Vec<String>, Fault> {
    let mut reader = guarded("E57", || E57Reader::new(BufReader::new(file)))?;
    let scans = reader.pointclouds();
    let mut notes = Vec::new();
    for (number, scan) in scans.iter().enumerate() {
        let file_from_scan = pose(scan).map_err(|reason| Fault::at(format!("scan {number}"), reason))?;
        let mut seen_from_m = scanner_m(scan, &file_from_scan);
        if seen_from_m.is_some() {
            // not by the box that the file states: pye57 states it in the frame of the file, the standard wants the scan's
            let some = points_of(&mut reader, scan)?.take(MOST_JUDGES);
            let nearest_m = guarded(&format!("E57 scan {number}"), || nearest_of(some))?;
            if nearest_m > FARTHEST_M {
                notes.push(format!(
                    "scan {number}: its points are {nearest_m:.0} m and more from where the file places its scanner; that place is \
                     not believed"
                ));
                seen_from_m = None;
            }
        }
        let mut points = points_of(&mut reader, scan)?;
        loop {
            let place = || format!("E57 scan {number}");
            let Some(point) = guarded(&place(), || points.next().transpose())? else { break };
            let position_m = match point.cartesian {
                CartesianCoordinate::Valid { x, y, z } => file_from_scan.transform_point(DVec3::new(x, y, z)),
                // a direction into which nothing was measured
                CartesianCoordinate::Direction { .. } | CartesianCoordinate::Invalid => DVec3::NAN,
            };
            take(CloudPoint { position_m, seen_from_m, time_s: None });
        }
    }
    Ok(notes)
}

/// The points of a scan, in its own frame.
fn points_of<'a>(
    reader: &'a mut E57Reader<BufReader<File>>,
    scan: &'a PointCloud,
) -> Result<PointCloudReaderSimple<'a, BufReader<File>>, Fault> {
    let mut points = guarded("E57", || reader.pointcloud_simple(scan))?;
    points.apply_pose(false);
    Ok(points)
}

fn pose(scan: &PointCloud) -> Result<Pose, String> {
    let Some(transform) = &scan.transform else { return Ok(Pose::IDENTITY) };
    let (q, t) = (&transform.rotation, &transform.translation);
    let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    let translation_m = DVec3::new(t.x, t.y, t.z);
    if !((rotation.length() - 1.0).abs() < 1e-2 && translation_m.is_finite()) {
        return Err(format!(
            "a pose of quaternion {rotation} and translation {translation_m}, expected a rotation"
        ));
    }
    Ok(Pose::new(rotation.normalize(), translation_m))
}

/// Where the scanner stood, in the frame of the file; unknown where the file places no scan, and its points are not by angle and
/// range either.
fn scanner_m(scan: &PointCloud, file_from_scan: &Pose) -> Option<DVec3> {
    let is_by_range = scan.prototype.iter().any(|record| record.name == RecordName::SphericalRange);
    (scan.transform.is_some() || is_by_range).then_some(file_from_scan.translation_m)
}

/// From the scanner to the nearest of some of its points, m; 0 without one.
fn nearest_of(points: impl Iterator<Item = e57::Result<Point>>) -> e57::Result<f64> {
    let mut nearest_m = f64::INFINITY;
    for point in points {
        if let CartesianCoordinate::Valid { x, y, z } = point?.cartesian {
            nearest_m = nearest_m.min(DVec3::new(x, y, z).length());
        }
    }
    Ok(if nearest_m.is_finite() { nearest_m } else { 0.0 })
}
