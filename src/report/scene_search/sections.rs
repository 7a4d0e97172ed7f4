//! The report of a search in a scene.

use super::{CountDocument, Document, SiteDocument, SiteSource, TrajectoryDocument};
use crate::design::scene_search::{Answer, CoveredSite, Fidelity, FlatRange, Judged, JudgedAtSite};
use crate::report::chart::{LineChart, NamedPoint, ScatterChart, Series, count, number};
use crate::report::{BlindSpot, FromAbove, MAX_BLIND_SPOTS, Report, blind_spots, figures, orbit};
use crate::rig::{Rig, SensorEntry};
use crate::simulate::view::{CastSites, CastView, ViewSite};
use crate::world::local_origin::LocalOrigin;

/// What the page shows of a site.
struct Pictured<'a> {
    name: &'a str,
    site: &'a ViewSite,
    rig: &'a Rig,
    covered: &'a CoveredSite,
    origin: LocalOrigin,
}

impl<'a> Pictures<'a> {
    fn sites(&self, answer: &'a Answer) -> Vec<Pictured<'a>> {
        let views = self.cast.views().iter().zip(&answer.covered).zip(self.sources);
        let pictured = |((view, covered), source): ((&'a CastView, &'a CoveredSite), &'a SiteSource)| {
            Pictured { name: &source.scene, site: view.site(), rig: self.rig, covered, origin: source.origin }
        };
        views.map(pictured).collect()
    }
}

impl Pictured<'_> {
    /// Of groups of voxels that can be seen and that the rig does not see the largest.
    fn blind_spots(&self) -> Vec<BlindSpot> {
        let is_unseen = |cell: &usize| figures::who_covers(&self.covered.coverage, *cell) == figures::UNSEEN;
        let unseen = self.covered.observable.iter().copied().filter(is_unseen);
        let spots = blind_spots(self.covered.coverage.grid(), unseen, MAX_BLIND_SPOTS).into_iter();
        spots.map(|spot| spot.in_world(self.origin)).collect()
    }
}

/// What the pictures of a page show.
pub(crate) struct Pictures<'a> {
    pub rig: &'a Rig,
    pub cast: &'a CastSites,
    pub sources: &'a [SiteSource],
    pub fidelities: &'a [Fidelity],
}

/// The answer, what it is compared with, how sure it is; with where it sees, for a page.
pub(crate) fn report(document: &Document, pictures: Option<&Pictures<'_>>) -> Report {
    let mut report = Report::new("Mounts for a scene", &document.sentence());
    report.notices(&document.warnings);
    let trajectory = &document.trajectory;
    let [length_m, duration_s] = [trajectory.length_m, trajectory.duration_s];
    report.figure("trajectory", format!("{length_m:.1} m in {duration_s:.0} s, {}", trajectory.source));
    for (at, SiteDocument { scene, trajectory, reachable_voxels }) in document.sites.iter().enumerate() {
        let TrajectoryDocument { length_m, source, .. } = trajectory;
        let voxels = count(*reachable_voxels);
        let words = format!("{scene}: {length_m:.1} m, {source}; {voxels} voxels can be seen");
        report.figure(&format!("site {}", at + 1), words);
    }
    report.figures(document.sampling.quality.map(|quality| ("counted", quality.words(true))));
    let pictured = pictures.map_or_else(Vec::new, |pictures| pictures.sites(&document.answer));
    let is_one = pictured.len() == 1;
    for site in &pictured {
        if !is_one {
            report.heading(site.name);
        }
        orbit_view(&mut report, site);
    }
    mounts(&mut report, document);
    certainty(&mut report, document);
    search(&mut report, document);
    speed_against_accuracy(&mut report, pictures.map_or(&[], |pictures| pictures.fidelities));
    for site in &pictured {
        let of = if is_one { String::new() } else { format!(": {}", site.name) };
        report.heading(&format!("Who sees what{of}"));
        from_above(&mut report, document, site);
    }
    report
}

fn orbit_view(report: &mut Report, pictured: &Pictured<'_>) {
    let Pictured { site, rig, covered: CoveredSite { coverage, observable }, origin, .. } = pictured;
    let view = orbit::seen(
        &site.scene,
        &site.trajectory,
        (rig, &[]),
        coverage.grid().voxel_m,
        figures::who_covers_each(coverage, observable),
        &pictured.blind_spots(),
        *origin,
    );
    report.orbit(
        view,
        "The rig stands where the trajectory begins; its fields of view are cut off. Blind spots are voxels that can be \
         seen from the trajectory and that this mount does not see.",
    );
}

fn from_above(report: &mut Report, document: &Document, pictured: &Pictured<'_>) {
    let Pictured { site, rig, covered: CoveredSite { coverage, observable }, origin, .. } = pictured;
    let names: Vec<&str> = document.best.judged.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let voxel_m = coverage.grid().voxel_m;
    let above = FromAbove::new(site.scene.bounds_m(), voxel_m, figures::WHO_CLASSES);
    let mut above = above.around(*origin).with_rig(&site.trajectory, rig);
    figures::who_covers_each(coverage, observable).for_each(|(place_m, class)| above.add(place_m, class));
    let classes = figures::who_classes(&names, "observable, but unseen");
    figures::from_above(report, &above, &classes, "scene");
    figures::blind_spot_table(report, &pictured.blind_spots(), voxel_m);
}

/// Share, voxels, overlap and J, as all tables show them.
fn seen(share: f64, voxels: u64, overlap: Option<f64>, objective: f64) -> Vec<String> {
    let overlap = overlap.map(|overlap| format!("{:.1} %", 100.0 * overlap));
    let seen = [format!("{:.2} %", 100.0 * share), count(voxels)];
    seen.into_iter().chain(overlap).chain([number(objective, 1)]).collect()
}

fn mounts(report: &mut Report, document: &Document) {
    report.heading("What mounts see");
    let row = |(name, judged): (&str, &Judged)| {
        let Judged { observable_share, unique_voxels, overlap_ratio, objective, .. } = judged;
        let seen = seen(*observable_share, *unique_voxels, Some(*overlap_ratio), *objective);
        [vec![name.to_owned()], seen].concat()
    };
    let rows = document.compared().into_iter().map(row).collect();
    report.table(&["mount", "seen", "voxels", "overlap", "J"], rows);
    if let Some(line) = document.sites_line() {
        let row = |(site, mount, of_site): (usize, &str, &JudgedAtSite)| {
            let JudgedAtSite { observable_share, unique_voxels, overlap_ratio, objective, .. } = of_site;
            let seen = seen(*observable_share, *unique_voxels, Some(*overlap_ratio), *objective);
            [vec![format!("{mount}, site {site}")], seen].concat()
        };
        let rows = document.at_sites().into_iter().map(row).collect();
        report.table(&["mount and site", "seen", "voxels", "overlap", "J"], rows);
        report.note(format!("{line}."));
    }
    report.heading("The best mount");
    let row = |sensor: &SensorEntry| {
        let position_m = [sensor.x_m, sensor.y_m, sensor.z_m].map(|value| number(value, 4));
        let angles_deg = [sensor.pitch_deg, sensor.roll_deg].map(|value| number(value, 3));
        let named = [sensor.name.clone(), sensor.model.clone()];
        named.into_iter().chain(position_m).chain(angles_deg).collect()
    };
    let rows = document.best.judged.sensors.iter().map(row).collect();
    report.table(&["sensor", "model", "x, m", "y, m", "z, m", "pitch, deg", "roll, deg"], rows);
    if !document.by_count.is_empty() {
        report.heading("How many sensors");
        let row = |found: &CountDocument| {
            let seen = seen(found.observable_share, found.unique_voxels, None, found.objective);
            [vec![found.sensors.to_string()], seen].concat()
        };
        report.table(&["sensors", "seen", "voxels", "J"], document.by_count.iter().map(row).collect());
    }
}

fn certainty(report: &mut Report, document: &Document) {
    report.heading("How sure, how flat");
    let flat = document.answer.flat.iter();
    let row = |range: &FlatRange| vec![range.coordinate.clone(), number(range.low, 3), number(range.high, 3)];
    report.table(&["loses less than 0.1 %", "from", "to"], flat.map(row).collect());
    let registration = document.best.judged.registration.as_ref();
    report.figures(registration.map(|quality| ("registration strength", quality.words())));
    report.figures(document.answer.as_built.as_ref().map(|built| ("as built", built.words())));
    report.figure("tolerance", document.tolerance_line());
    report.figure("known to", document.certainty_line());
    report.figures(document.model_line().map(|line| ("model", line)));
}

fn search(report: &mut Report, document: &Document) {
    report.heading("The search");
    report.figure("cost", document.cost_line());
    let points = document.history.iter().map(|(at, best)| [*at as f64, *best]).collect();
    let chart = LineChart {
        title: "Best exact score over mounts that the model looked at".into(),
        x_label: "mounts".into(),
        y_label: "best score so far".into(),
        series: vec![Series { name: document.method.into(), points }],
        steps: true,
        ..LineChart::default()
    };
    let cast = match document.plan.thinning {
        1 => "every beam".to_owned(),
        thinning => format!("one beam in {thinning}"),
    };
    report.chart(&chart.svg(), &format!("A step is a better mount of which {cast} was cast."));
}

fn speed_against_accuracy(report: &mut Report, fidelities: &[Fidelity]) {
    if fidelities.is_empty() {
        return;
    }
    report.heading("Speed against accuracy");
    let row = |of: &Fidelity| vec![of.name.clone(), number(of.ms_per_mount, 2), number(of.sd_voxels, 0)];
    report.table(&["what counts", "ms a mount", "error, voxels"], fidelities.iter().map(row).collect());
    let point = |of: &Fidelity| NamedPoint {
        name: of.name.clone(),
        at: [of.ms_per_mount, of.sd_voxels],
        group: usize::from(of.is_model),
    };
    let chart = ScatterChart {
        title: "Error of a count against the time that it takes".into(),
        x_label: "ms a mount".into(),
        y_label: "error, voxels".into(),
        points: fidelities.iter().map(point).collect(),
    };
    let words = "Here, on this machine. The error is the standard deviation of the difference from the beams of the search, over the best \
                 mounts that they judged; theirs is over starts of the revolutions. What all mounts share is no error of a choice.";
    report.chart(&chart.svg(), words);
}
