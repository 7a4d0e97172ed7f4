//! The page of a completeness.

use glam::DVec3;

use super::SurfaceDocument;
use crate::report::chart::number;
use crate::report::seen::Document;
use crate::report::{FromAbove, MAX_BLIND_SPOTS, Report, blind_spots, figures, orbit};
use crate::simulate::ideal::IdealSensors;
use crate::world::coverage::VoxelGrid;
use crate::world::local_origin::LocalOrigin;
use crate::world::surface::ObservableSurface;

/// Edge of the cells in which uncovered samples are grouped, m.
const SPOT_M: f64 = 0.25;
/// Edge of a sample in the 3-D view, m: samples lie closer.
const POINT_M: f64 = 0.05;

/// How much of the surface is covered, by whom, and what is not.
pub(crate) fn page(
    document: &Document,
    of_surface: &SurfaceDocument,
    sensors: &IdealSensors,
    surface: &ObservableSurface,
    origin: LocalOrigin,
    made_by: &str,
) -> Report {
    let covered = 100.0 * of_surface.shares.main();
    let gain = of_surface.baselines.as_ref().map_or(String::new(), |baselines| {
        format!(
            ", {:.2} points more than the best single sensor",
            baselines.best_single.seen.gain_points["0.05"]
        )
    });
    let summary =
        format!("{} sensors cover {covered:.2} % of the surface within 5 cm{gain}.", document.sensors.len());
    let mut report = Report::new("Surface completeness", &summary, made_by);
    for warning in &document.warnings {
        report.paragraph(warning);
    }
    if let Some(quality) = document.quality {
        report.paragraph(&format!("Voxels counted: {}.", quality.words(true)));
    }
    for pair in &document.conflicts.touching {
        report.paragraph(&format!("Cannot be built: {pair}."));
    }
    pictures(&mut report, sensors, surface, origin);
    shares(&mut report, document, of_surface);
    let path = &of_surface.registration;
    figures::registration_section(
        &mut report,
        path.registration.as_ref(),
        "distance travelled, m",
        path.least_translation(),
    );
    report
}

fn shares(report: &mut Report, document: &Document, of_surface: &SurfaceDocument) {
    let mut row = vec!["the mounts".to_owned(), "-".into()];
    row.extend(of_surface.shares.percent());
    let mut rows = vec![row];
    for (name, single) in of_surface.baselines.iter().flat_map(|baselines| baselines.named()) {
        let mut row = vec![name.to_owned(), number(single.pitch_deg, 1)];
        row.extend(single.seen.coverage.shares.percent());
        rows.push(row);
    }
    let header = ["covered within, %", "pitch, deg", "2 cm", "5 cm", "10 cm", "5 cm, of the observable"];
    match &of_surface.baselines {
        Some(baselines) => {
            let y_label = "share covered on some revolutions";
            figures::baselines_section(report, baselines, &header, &rows, y_label, None);
        }
        None => {
            report.heading("Completeness of the surface");
            report.table(&header, &rows);
        }
    }
    report.paragraph(&format!(
        "{:.2} % of {} samples are observable from the trajectory; {} rays, {:.1} m travelled.",
        100.0 * of_surface.observable_share,
        number(of_surface.samples as f64, 0),
        number(document.rays as f64, 0),
        document.trajectory_length_m
    ));
}

fn pictures(report: &mut Report, sensors: &IdealSensors, surface: &ObservableSurface, origin: LocalOrigin) {
    let covered = sensors.covered_by_sensor(surface);
    let bounds_m = sensors.scene.bounds_m();
    let grid = VoxelGrid::centred_on(bounds_m, SPOT_M);
    let of_sample = |(index, point_m): (usize, &DVec3)| {
        let class = figures::who_saw(covered.iter().map(|flags| flags[index]));
        (class != figures::UNSEEN || surface.is_observable[index]).then_some((*point_m, class))
    };
    let points: Vec<(DVec3, usize)> =
        surface.samples.points_m().iter().enumerate().filter_map(of_sample).collect();
    let unseen = points.iter().filter(|(_, class)| *class == figures::UNSEEN);
    let spots = blind_spots(&grid, unseen.filter_map(|(point_m, _)| grid.index(*point_m)), MAX_BLIND_SPOTS);
    let spots: Vec<_> = spots.into_iter().map(|spot| spot.in_world(origin)).collect();
    report.orbit(
        orbit::seen(
            &sensors.scene,
            &sensors.trajectory,
            (&sensors.rig, &[]),
            POINT_M,
            points.iter().copied(),
            &spots,
            origin,
        ),
        "Samples of the surface. The rig stands where the trajectory begins; its fields of view are cut off. Blind spots can be \
         seen from the path and have no hit within 5 cm.",
    );
    let mut above = FromAbove::new(bounds_m, 0.1, figures::WHO_CLASSES)
        .around(origin)
        .with_rig(&sensors.trajectory, &sensors.rig);
    points.iter().for_each(|(point_m, class)| above.add(*point_m, *class));
    let names: Vec<&str> = sensors.rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let classes = figures::who_classes(&names, "can be seen, but has no hit within 5 cm");
    report.heading("Who saw what");
    figures::from_above(report, &above, &classes, "surface");
    figures::blind_spot_table(report, &spots, SPOT_M);
}
