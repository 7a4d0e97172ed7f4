//! The page of a search in a scene.

use super::Document;
use crate::design::scene_search::Judged;
use crate::report::chart::{LineChart, Series, number};
use crate::report::{FromAbove, MAX_BLIND_SPOTS, Report, blind_spots, figures, orbit};
use crate::rig::Rig;
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// What the page shows of the scene.
pub(crate) struct Pictured<'a> {
    pub scene: &'a Scene,
    pub trajectory: &'a Trajectory,
    pub rig: &'a Rig,
    pub coverage: &'a Coverage,
    /// Voxels that some rig saw.
    pub observable: &'a [usize],
    pub origin: LocalOrigin,
    pub made_by: &'a str,
}

/// The answer, what it is compared with, how sure it is, and where it sees.
pub(crate) fn page(document: &Document, pictured: &Pictured<'_>) -> Report {
    let mut page = Report::new("Mounts for a scene", &document.sentence(), pictured.made_by);
    document.warnings.iter().for_each(|warning| page.paragraph(warning));
    document.quality_line().iter().for_each(|line| page.paragraph(&format!("Counted: {line}.")));
    let (coverage, grid) = (pictured.coverage, pictured.coverage.grid());
    let unseen = pictured
        .observable
        .iter()
        .copied()
        .filter(|cell| figures::who_covers(coverage, *cell) == figures::UNSEEN);
    let spots: Vec<_> = blind_spots(grid, unseen, MAX_BLIND_SPOTS)
        .into_iter()
        .map(|spot| spot.in_world(pictured.origin))
        .collect();
    page.orbit(
        orbit::seen(
            pictured.scene,
            pictured.trajectory,
            (pictured.rig, &[]),
            grid.voxel_m,
            figures::who_covers_each(coverage, pictured.observable),
            &spots,
            pictured.origin,
        ),
        "The rig stands where the trajectory begins; its fields of view are cut off. Blind spots are voxels that another mount \
         of the search saw and this one does not.",
    );
    mounts(&mut page, document);
    certainty(&mut page, document);
    search(&mut page, document);
    let names: Vec<&str> = document.best.judged.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let above = FromAbove::new(pictured.scene.bounds_m(), grid.voxel_m, figures::WHO_CLASSES);
    let mut above = above.around(pictured.origin).with_rig(pictured.trajectory, pictured.rig);
    figures::who_covers_each(coverage, pictured.observable)
        .for_each(|(place_m, class)| above.add(place_m, class));
    page.heading("Who sees what");
    let classes = figures::who_classes(&names, "seen by another mount only");
    figures::from_above(&mut page, &above, &classes, "scene");
    figures::blind_spot_table(&mut page, &spots, grid.voxel_m);
    page
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
