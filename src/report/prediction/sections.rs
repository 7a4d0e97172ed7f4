//! The report of a prediction.

use super::{Document, SensorDocument};
use crate::report::chart::{count, number};
use crate::report::{FromAbove, Report, figures, orbit, unfold_box};
use crate::simulate::prediction::SceneBaselines;
use crate::simulate::scan::Scanner;
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;

/// What the pictures of a page show.
pub(crate) struct Pictures<'a> {
    pub scanner: &'a Scanner<'a>,
    pub coverage: &'a Coverage,
    pub observable: &'a [usize],
    pub origin: LocalOrigin,
}

/// What the rig will see, and what it will not.
pub(crate) fn report(document: &Document, pictures: Option<&Pictures<'_>>) -> Report {
    let mut report = Report::new("Predicted coverage", &sentence(document));
    report.notices(&document.warnings);
    report.figure("trajectory", format!("{:.2} m", document.trajectory_length_m));
    let [rays, returns] = [document.rays, document.returns].map(count);
    report.figure(
        "cast",
        format!(
            "{rays} rays, {returns} returns in {:.2} s, with all else {:.2} s",
            document.wall_s, document.total_s
        ),
    );
    report.figures(document.quality.map(|quality| ("counted", quality.words(false))));
    report.figures(document.counted.figures());
    report.figures(document.map.iter().flat_map(|map| map.figures()));
    report.figures(document.conflicts.figures());
    if let Some(pictures) = pictures {
        orbit_view(&mut report, document, pictures);
    }
    sensors(&mut report, document);
    surface(&mut report, document);
    baselines(&mut report, document);
    if let Some(pictures) = pictures {
        who_saw_what(&mut report, document, pictures);
    }
    report.detail("Largest blind spots");
    figures::blind_spot_table(&mut report, &document.blind_spots, document.grid.voxel_m);
    if let Some(omissions) = &document.left_out {
        report.heading("Not modelled");
        omissions.iter().for_each(|omission| report.note(format!("{}.", omission.words())));
    }
    let path = &document.registration;
    figures::registration_section(
        &mut report,
        path.registration.as_ref(),
        "distance travelled, m",
        path.least_translation(),
    );
    report
}

fn sentence(document: &Document) -> String {
    let share = document.counted.percent();
    let gain = document.baselines.as_ref().map_or(String::new(), |baselines| {
        let seen = &baselines.singles.best_single.seen;
        format!(
            "; {} the rig sees {} more than the best single sensor",
            baselines.rays_words(),
            seen.gain_words()
        )
    });
    format!(
        "{} sensors will see {} of {} voxels of {} m that are observable from the trajectory ({share:.1} %){gain}.",
        document.sensors.len(),
        count(document.counted.unique_voxels),
        count(document.counted.reachable_voxels),
        document.grid.voxel_m,
    )
}

fn orbit_view(report: &mut Report, document: &Document, pictures: &Pictures<'_>) {
    let Pictures { scanner, coverage, observable, origin } = pictures;
    let solids = scanner.operator();
    let orbit = orbit::seen(
        scanner.scene,
        scanner.trajectory,
        (scanner.rig, &solids),
        coverage.grid().voxel_m,
        figures::who_covers_each(coverage, observable),
        &document.blind_spots,
        *origin,
    );
    report.orbit(
        orbit,
        "The rig stands where the trajectory begins; its fields of view are cut off. Blind spots are voxels that could be seen \
         from the path and are not.",
    );
}

fn sensors(report: &mut Report, document: &Document) {
    report.heading("The sensors");
    let row = |sensor: &SensorDocument| {
        vec![
            sensor.name.clone(),
            sensor.model.clone(),
            sensor.columns.to_string(),
            count(sensor.rays),
            count(sensor.returns),
            count(sensor.voxels),
            count(sensor.unique_voxels),
        ]
    };
    let rows = document.sensors.iter().map(row).collect();
    report.table(&["sensor", "model", "columns", "rays", "returns", "voxels", "alone"], rows);
}

fn surface(report: &mut Report, document: &Document) {
    let Some(surface) = &document.surface else { return };
    report.heading("Completeness of the surface");
    report.figures(surface.mesh.figures());
    let observable = 100.0 * surface.observable_share;
    let samples = count(surface.samples as u64);
    report.figure("observable", format!("{observable:.2} % of {samples} samples of the surface"));
    let rig = ("the rig".to_owned(), &surface.shares);
    let all = std::iter::once(rig).chain(document.baselines.iter().flat_map(SceneBaselines::shares));
    let rows = all.map(|(name, shares)| std::iter::once(name).chain(shares.percent()).collect()).collect();
    report.table(&["covered within, %", "2 cm", "5 cm", "10 cm", "5 cm, of the observable"], rows);
}

fn baselines(report: &mut Report, document: &Document) {
    let Some(baselines) = &document.baselines else { return };
    let seen = count(baselines.rig.unique_voxels);
    let rig = ["the rig".into(), "-".into(), "-".into(), seen, "-".into()];
    let single = baselines.singles.named().map(|(name, single)| {
        vec![
            name.into(),
            single.model.clone(),
            number(single.pitch_deg, 0),
            count(single.seen.unique_voxels),
            single.seen.gain_words(),
        ]
    });
    let rows = std::iter::once(rig.to_vec()).chain(single).collect();
    let words = baselines.rays_words();
    let header = [words.as_str(), "model", "pitch, deg", "voxels seen", "the rig sees more"];
    let y_label = match document.surface {
        Some(_) => "share covered on some revolutions",
        None => "voxels seen on some revolutions",
    };
    figures::baselines_section(report, &baselines.singles, &header, rows, y_label, None);
}

fn who_saw_what(report: &mut Report, document: &Document, pictures: &Pictures<'_>) {
    let Pictures { scanner, coverage, observable, origin } = pictures;
    let scene = scanner.scene;
    let names: Vec<&str> = document.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let classes = figures::who_classes(&names, "observable, but unseen");
    report.heading("Who saw what");
    if matches!(scene, Scene::Box(_)) {
        report.maps(
            "Voxels by who saw them",
            &unfold_box(coverage.grid(), &|cell| Some(figures::who_covers(coverage, cell))),
            &classes,
            "The room unfolded: floor and ceiling seen from above with world x up the page, walls from inside.",
        );
        return;
    }
    let above = FromAbove::new(scene.bounds_m(), coverage.grid().voxel_m, figures::WHO_CLASSES);
    let mut above = above.around(*origin).with_rig(scanner.trajectory, scanner.rig);
    figures::who_covers_each(coverage, observable).for_each(|(place_m, class)| above.add(place_m, class));
    figures::from_above(report, &above, &classes, "surface");
}
