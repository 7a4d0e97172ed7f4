//! The page of a search in a scene.

use super::{Document, SiteSource};
use crate::design::scene_search::{CoveredSite, Judged, JudgedAtSite};
use crate::report::chart::{LineChart, Series, number};
use crate::report::{BlindSpot, FromAbove, MAX_BLIND_SPOTS, Report, blind_spots, figures, orbit};
use crate::rig::Rig;
use crate::simulate::view::{CastSites, CastView, ViewSite};
use crate::world::local_origin::LocalOrigin;

/// What the page shows of a site.
struct Pictured<'a> {
    name: &'a str,
    site: &'a ViewSite,
    covered: &'a CoveredSite,
    origin: LocalOrigin,
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

/// The answer, what it is compared with, how sure it is, and where it sees.
pub(crate) fn page(
    document: &Document,
    rig: &Rig,
    cast: &CastSites,
    sources: &[SiteSource],
    made_by: &str,
) -> Report {
    let views = cast.views().iter().zip(&document.answer.covered).zip(sources);
    let pictured = |((view, covered), source)| {
        let (view, source): (&CastView, &SiteSource) = (view, source);
        Pictured { name: &source.scene, site: view.site(), covered, origin: source.origin }
    };
    let sites: Vec<Pictured<'_>> = views.map(pictured).collect();
    let mut page = Report::new("Mounts for a scene", &document.sentence(), made_by);
    document.warnings.iter().for_each(|warning| page.paragraph(warning));
    document.quality_line().iter().for_each(|line| page.paragraph(&format!("Counted: {line}.")));
    for pictured in &sites {
        if sites.len() > 1 {
            page.heading(pictured.name);
        }
        let Pictured { site, covered: CoveredSite { coverage, observable }, origin, .. } = pictured;
        page.orbit(
            orbit::seen(
                &site.scene,
                &site.trajectory,
                (rig, &[]),
                coverage.grid().voxel_m,
                figures::who_covers_each(coverage, observable),
                &pictured.blind_spots(),
                *origin,
            ),
            "The rig stands where the trajectory begins; its fields of view are cut off. Blind spots are voxels that can be \
             seen from the trajectory and that this mount does not see.",
        );
    }
    mounts(&mut page, document);
    certainty(&mut page, document);
    search(&mut page, document);
    for pictured in &sites {
        let of = if sites.len() > 1 { format!(": {}", pictured.name) } else { String::new() };
        page.heading(&format!("Who sees what{of}"));
        from_above(&mut page, document, rig, pictured);
    }
    page
}

fn from_above(page: &mut Report, document: &Document, rig: &Rig, pictured: &Pictured<'_>) {
    let Pictured { site, covered: CoveredSite { coverage, observable }, origin, .. } = pictured;
    let names: Vec<&str> = document.best.judged.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let voxel_m = coverage.grid().voxel_m;
    let above = FromAbove::new(site.scene.bounds_m(), voxel_m, figures::WHO_CLASSES);
    let mut above = above.around(*origin).with_rig(&site.trajectory, rig);
    figures::who_covers_each(coverage, observable).for_each(|(place_m, class)| above.add(place_m, class));
    let classes = figures::who_classes(&names, "observable, but unseen");
    figures::from_above(page, &above, &classes, "scene");
    figures::blind_spot_table(page, &pictured.blind_spots(), voxel_m);
}

fn mounts(page: &mut Report, document: &Document) {
    page.heading("The mounts");
    let row = |(name, judged): (&str, &Judged)| {
        vec![
            name.to_owned(),
            document.percent(judged),
            number(judged.unique_voxels as f64, 0),
            format!("{:.1} %", 100.0 * judged.overlap_ratio),
            number(judged.objective, 1),
        ]
    };
    let rows: Vec<_> = document.compared().into_iter().map(row).collect();
    page.table(&["", "seen", "voxels", "overlap", "J"], &rows);
    if let Some(line) = document.sites_line() {
        let row = |(site, mount, seen): (usize, &str, &JudgedAtSite)| {
            vec![
                document.sites[site - 1].scene.clone(),
                mount.to_owned(),
                format!("{:.2} %", 100.0 * seen.observable_share),
                number(seen.unique_voxels as f64, 0),
                format!("{:.1} %", 100.0 * seen.overlap_ratio),
                number(seen.objective, 1),
            ]
        };
        let rows: Vec<_> = document.at_sites().into_iter().map(row).collect();
        page.table(&["site", "mount", "seen", "voxels", "overlap", "J"], &rows);
        page.paragraph(&format!("{line}."));
    }
    let row = |sensor: &crate::rig::SensorEntry| {
        let position_m = [sensor.x_m, sensor.y_m, sensor.z_m].map(|value| number(value, 4));
        let angles_deg = [sensor.pitch_deg, sensor.roll_deg].map(|value| number(value, 3));
        let named = [sensor.name.clone(), sensor.model.clone()];
        named.into_iter().chain(position_m).chain(angles_deg).collect()
    };
    let rows: Vec<Vec<String>> = document.best.judged.sensors.iter().map(row).collect();
    page.table(&["sensor", "model", "x m", "y m", "z m", "pitch, deg", "roll, deg"], &rows);
    if !document.by_count.is_empty() {
        page.heading("How many sensors");
        let row = |found: &super::CountDocument| {
            vec![
                found.sensors.to_string(),
                format!("{:.2} %", 100.0 * found.observable_share),
                number(found.unique_voxels as f64, 0),
                number(found.objective, 1),
            ]
        };
        let rows: Vec<_> = document.by_count.iter().map(row).collect();
        page.table(&["sensors", "seen", "voxels", "J"], &rows);
    }
}

fn certainty(page: &mut Report, document: &Document) {
    page.heading("How sure, how flat");
    let answer = &document.answer;
    let rows: Vec<_> = answer
        .flat
        .iter()
        .map(|range| vec![range.coordinate.clone(), number(range.low, 3), number(range.high, 3)])
        .collect();
    page.table(&["loses less than 0.1 %", "from", "to"], &rows);
    page.paragraph(&document.tolerance_line());
    page.paragraph(&document.certainty_line());
    document.model_line().iter().for_each(|line| page.paragraph(line));
}

fn search(page: &mut Report, document: &Document) {
    page.heading("The search");
    let points = document.history.iter().map(|(at, best)| [*at as f64, *best]).collect();
    let chart = LineChart {
        title: "Best exact score over mounts that the model looked at".into(),
        x_label: "mounts".into(),
        y_label: "best score so far".into(),
        series: vec![Series { name: document.method.into(), points }],
        steps: true,
        ..LineChart::default()
    };
    page.figure(&chart.svg(), &document.cost_line());
}
