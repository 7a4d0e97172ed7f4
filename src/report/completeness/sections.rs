//! The sections of a report about a covered surface.

use glam::DVec3;

use super::SurfaceDocument;
use crate::report::chart::{count, number};
use crate::report::{BlindSpot, FromAbove, MAX_BLIND_SPOTS, Report, blind_spots, figures, orbit};
use crate::simulate::baselines::Baselines;
use crate::simulate::ideal::IdealSensors;
use crate::world::coverage::VoxelGrid;
use crate::world::local_origin::LocalOrigin;
use crate::world::surface::ObservableSurface;

/// Edge of the cells in which uncovered samples are grouped, m.
const SPOT_M: f64 = 0.25;
/// Edge of a sample in the 3-D view, m: samples lie closer.
const POINT_M: f64 = 0.05;

impl SurfaceDocument {
    /// How much of the surface is covered, by the mounts and by single sensors.
    pub(crate) fn append_to(&self, report: &mut Report) {
        report.heading("Completeness of the surface");
        report.figures(self.mesh.figures());
        let samples = count(self.samples as u64);
        let area_m2 = number(self.area_m2, 1);
        let observable = 100.0 * self.observable_share;
        report.figure("observable", format!("{observable:.2} % of {samples} samples on {area_m2} m²"));
        let mounts = [vec!["the mounts".to_owned(), "-".into()], self.shares.percent()].concat();
        let singles = self.baselines.iter().flat_map(Baselines::named).map(|(name, single)| {
            let name = format!("{name}, {}", single.model);
            let pitch_deg = number(single.pitch_deg, 1);
            [vec![name, pitch_deg], single.seen.coverage.shares.percent()].concat()
        });
        let rows = std::iter::once(mounts).chain(singles).collect();
        let header = ["covered within, %", "pitch, deg", "2 cm", "5 cm", "10 cm", "5 cm, of the observable"];
        match &self.baselines {
            Some(baselines) => {
                let y_label = "share covered on some revolutions";
                figures::baselines_section(report, baselines, &header, rows, y_label, None);
                report.figure("time", format!("{:.2} s for the single sensors", self.times.baselines_s));
            }
            None => report.table(&header, rows),
        }
        let path = &self.registration;
        figures::registration_section(
            report,
            path.registration.as_ref(),
            "distance travelled, m",
            path.least_translation(),
        );
    }
}

/// What the pictures of a page show: samples of the surface that are covered, or could be.
pub(crate) struct Pictures<'a> {
    sensors: &'a IdealSensors,
    origin: LocalOrigin,
    /// Samples with their classes of [`figures::who_saw`].
    points: Vec<(DVec3, usize)>,
}

impl<'a> Pictures<'a> {
    pub(crate) fn new(sensors: &'a IdealSensors, surface: &ObservableSurface, origin: LocalOrigin) -> Self {
        let covered = sensors.covered_by_sensor(surface);
        let of_sample = |(index, point_m): (usize, &DVec3)| {
            let class = figures::who_saw(covered.iter().map(|flags| flags[index]));
            (class != figures::UNSEEN || surface.is_observable[index]).then_some((*point_m, class))
        };
        let points = surface.samples.points_m().iter().enumerate().filter_map(of_sample).collect();
        Self { sensors, origin, points }
    }

    /// In three dimensions; the blind spots.
    pub(crate) fn orbit_view(&self, report: &mut Report) -> Vec<BlindSpot> {
        let Self { sensors, origin, points } = self;
        let grid = VoxelGrid::centred_on(sensors.scene.bounds_m(), SPOT_M);
        let unseen = points.iter().filter(|(_, class)| *class == figures::UNSEEN);
        let cells = unseen.filter_map(|(point_m, _)| grid.index(*point_m));
        let spots = blind_spots(&grid, cells, MAX_BLIND_SPOTS).into_iter();
        let spots: Vec<BlindSpot> = spots.map(|spot| spot.in_world(*origin)).collect();
        let view = orbit::seen(
            &sensors.scene,
            &sensors.trajectory,
            (&sensors.rig, &[]),
            POINT_M,
            points.iter().copied(),
            &spots,
            *origin,
        );
        report.orbit(
            view,
            "Samples of the surface. The rig stands where the trajectory begins; its fields of view are cut off. Blind spots can be \
             seen from the path and have no hit within 5 cm.",
        );
        spots
    }

    pub(crate) fn plans(&self, report: &mut Report, spots: &[BlindSpot]) {
        let sensors = self.sensors;
        let mut above = FromAbove::new(sensors.scene.bounds_m(), 0.1, figures::WHO_CLASSES)
            .around(self.origin)
            .with_rig(&sensors.trajectory, &sensors.rig);
        self.points.iter().for_each(|(point_m, class)| above.add(*point_m, *class));
        let names: Vec<&str> = sensors.rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        let classes = figures::who_classes(&names, "can be seen, but has no hit within 5 cm");
        report.heading("Who saw what");
        figures::from_above(report, &above, &classes, "surface");
        figures::blind_spot_table(report, spots, SPOT_M);
    }
}
