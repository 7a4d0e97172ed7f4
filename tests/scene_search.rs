//! What views say of mounts in the furnished house, against a ray caster that is not ours, and the search with them.

use std::collections::BTreeMap;

use outrigger::base::instructions::Instructions;
use outrigger::rig::{Mount, MountedSensor, Rig, Unit};
use outrigger::simulate::view::{
    CastView, CellView, Fineness, Precision, Sampling, Seen, Shades, View as _, ViewSite,
};
use outrigger::world::coverage::VoxelGrid;
use outrigger::world::scene::{Scene, load_mesh};
use outrigger::world::trajectory::Trajectory;
use serde::Deserialize;

use crate::support::{Case, shared, shared_folder, with_machine, with_shared};

mod command;
mod quality;
mod sites;

const ASKED: &str = "minutes of casting: set OUTRIGGER_STATISTICS=1 (and OUTRIGGER_SHARED)";

pub const CASES: &[Case] = &[
    with_shared("some_pairs_in_the_house_are_those_of_the_reference", some_pairs),
    with_shared("a_view_is_the_same_with_any_threads_and_instructions", any_threads_and_instructions),
    with_shared("the_model_ranks_good_mounts_in_the_house", the_model_ranks_good_mounts),
    with_machine("every_pair_in_the_house_is_that_of_the_reference", ASKED, is_asked, every_pair),
    with_machine("every_beam_in_the_house_is_that_of_the_reference", ASKED, is_asked, every_beam),
    with_machine("the_model_in_the_house_is_as_good_as_promised", ASKED, is_asked, the_model_is_as_good),
    with_shared("predict_casts_ideal_mounts", command::predict_casts_ideal_mounts),
    with_shared("optimize_finds_a_pair_in_the_house", command::optimize_finds_a_pair_in_the_house),
    crate::support::case("optimize_searches_a_room_along_waypoints", command::optimize_searches_a_room),
    crate::support::case("optimize_searches_with_any_sensor", command::searches_with_any_sensor),
    crate::support::case("optimize_compares_numbers_of_sensors", command::compares_numbers_of_sensors),
    crate::support::case("operators_and_housings_shade_in_the_search", command::operators_and_housings_shade),
    crate::support::case("of_mounts_that_see_alike_the_level_one_is_best", command::prefers_the_level_mount),
    crate::support::case("a_search_in_a_scene_goes_on_from_a_state_file", command::goes_on_from_a_state_file),
    crate::support::case("views_count_returns_as_by_hand", quality::views_count_as_by_hand),
    crate::support::case(
        "limits_of_range_and_angle_cut_where_they_should",
        quality::limits_cut_where_they_should,
    ),
    crate::support::case(
        "the_model_knows_limits_of_range_angle_and_returns",
        quality::the_model_knows_the_limits,
    ),
    crate::support::case(
        "search_and_prediction_count_alike",
        quality::the_search_and_the_prediction_count_alike,
    ),
    crate::support::case("a_map_of_voxels_has_no_normals", quality::a_map_has_no_normals),
    crate::support::case("one_site_twice_is_that_site", sites::one_site_twice_is_that_site),
    crate::support::case("the_score_of_two_sites_is_the_mean_of_theirs", sites::the_score_of_two_sites),
    crate::support::case("sites_go_with_the_other_flags", sites::go_with_the_other_flags),
    crate::support::case("sites_refuse_what_is_about_one", sites::refuse_what_is_about_one),
    crate::support::case("beams_of_dear_rigs_are_thinned", command::thins_the_beams_of_dear_rigs),
    crate::support::case("a_prediction_is_scored", command::a_prediction_is_scored),
    crate::support::case(
        "errors_of_building_are_reckoned_with",
        command::errors_of_building_are_reckoned_with,
    ),
    crate::support::case("registration_counts_in_a_scene", command::registration_counts),
    crate::support::case("a_search_in_a_scene_refuses_what_it_cannot_use", command::refuses),
];

fn is_asked() -> bool {
    std::env::var_os("OUTRIGGER_STATISTICS").is_some() && shared_folder().is_some()
}

/// `reference/scene_search/house.json`.
#[derive(Deserialize)]
struct Reference {
    pairs: BTreeMap<String, Vec<Entry>>,
    best_known: BTreeMap<String, Vec<Entry>>,
    named_pairs: BTreeMap<String, Vec<Entry>>,
    single_sensors: BTreeMap<String, Vec<Entry>>,
    full_sampling_pairs: BTreeMap<String, Vec<Entry>>,
}

#[derive(Deserialize)]
struct Entry {
    master: [f64; 5],
    rays: u64,
    #[serde(rename = "0.5")]
    coarse: Counted,
    #[serde(rename = "0.1")]
    fine: Counted,
}

#[derive(Deserialize)]
struct Counted {
    per_sensor: Vec<u64>,
    union: u64,
    overlap: u64,
    j: f64,
    union_sha256: String,
}

fn reference() -> Reference {
    let text = std::fs::read_to_string(shared("reference/scene_search/house.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn site(voxel_m: f64) -> ViewSite {
    let mesh = load_mesh(&shared("scenes/house.ply"), None, None).unwrap().mesh;
    let scene = Scene::Mesh(std::sync::Arc::new(mesh));
    let walk = std::fs::read(shared("reference/validation/house_trajectory.tum")).unwrap();
    let trajectory = Trajectory::read(&walk, None).unwrap().trajectory;
    ViewSite {
        grid: VoxelGrid::centred_on(scene.bounds_m(), voxel_m),
        scene,
        trajectory,
        shades: Shades::default(),
    }
}

fn sampling(columns: u32, scan_stride: u32) -> Sampling {
    Sampling {
        is_ideal: true,
        columns: Some(columns),
        scan_stride,
        min_range_m: Some(0.3),
        ..Sampling::default()
    }
}

/// Of pairs and of single sensors.
fn rig(model: &str, master: &[f64; 5], sensors: usize) -> Rig {
    let mount = Mount {
        x_m: master[0],
        y_m: master[1],
        z_m: master[2],
        pitch_rad: master[3].to_radians(),
        roll_rad: master[4].to_radians(),
        ..Mount::default()
    };
    let model = Unit::nominal(model).unwrap().model;
    let master = MountedSensor { name: "master".into(), model, mount };
    let mirrored = MountedSensor { name: "mirrored".into(), mount: mount.mirrored(), ..master.clone() };
    Rig { sensors: [master, mirrored].into_iter().take(sensors).collect() }
}

fn view(site: &ViewSite, model: &str, sampling: &Sampling, precision: Precision) -> CastView {
    CastView::new(site.clone(), &[Unit::nominal(model).unwrap()], sampling, precision).unwrap()
}

/// What single precision may be off by, voxels.
const MOST_OFF: u64 = 5;

/// To the bit in double precision; in single precision within [`MOST_OFF`], of 0.5 m within 1 but for one rig in fifty. The
/// largest difference.
fn compare(
    sites: &[ViewSite; 2],
    model: &str,
    sampling: &Sampling,
    entries: &[&Entry],
    precision: Precision,
) -> u64 {
    let mut worst = 0;
    for (site, usual) in sites.iter().zip([1, MOST_OFF]) {
        let mut unusual = 0;
        let view = view(site, model, sampling, precision);
        for entry in entries {
            let expected = if usual == 1 { &entry.coarse } else { &entry.fine };
            let rig = rig(model, &entry.master, expected.per_sensor.len());
            assert_eq!(view.rays(&rig), entry.rays);
            let what = format!("{model} {:?} {precision:?}", entry.master);
            let coverage = view.cover(&rig);
            let counts = coverage.counts();
            if precision == Precision::Double {
                assert_eq!(counts.per_sensor, expected.per_sensor, "{what}");
                assert_eq!((counts.union, counts.overlap), (expected.union, expected.overlap), "{what}");
                assert_eq!(coverage.union_sha256(), expected.union_sha256, "{what}");
            } else {
                let pairs = counts.per_sensor.iter().zip(&expected.per_sensor);
                let pairs =
                    pairs.chain([(&counts.union, &expected.union), (&counts.overlap, &expected.overlap)]);
                let most = pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
                assert!(most <= MOST_OFF, "{what}: {most} voxels off");
                unusual += usize::from(most > usual);
                worst = worst.max(most);
            }
        }
        assert!(unusual * 50 <= entries.len(), "{model} {precision:?}: {unusual} are more than {usual} off");
    }
    worst
}

fn sites() -> [ViewSite; 2] {
    [site(0.5), site(0.1)]
}

fn some_pairs() {
    let reference = reference();
    let sites = sites();
    for (model, chosen) in [("os1-64", &[7][..]), ("vlp-16", &[100])] {
        let mut entries: Vec<&Entry> = chosen.iter().map(|at| &reference.pairs[model][*at]).collect();
        entries.push(&reference.single_sensors[model][3]);
        entries.push(&reference.best_known[model][0]);
        for precision in [Precision::Double, Precision::Single] {
            compare(&sites, model, &sampling(512, 4), &entries, precision);
        }
    }
}

fn every_pair() {
    let reference = reference();
    let sites = sites();
    for model in ["os1-64", "vlp-16"] {
        let lists =
            [&reference.pairs, &reference.best_known, &reference.named_pairs, &reference.single_sensors];
        let entries: Vec<&Entry> = lists.iter().flat_map(|list| &list[model]).collect();
        assert!(entries.len() > 280, "{}", entries.len());
        compare(&sites, model, &sampling(512, 4), &entries, Precision::Double);
        let worst = compare(&sites, model, &sampling(512, 4), &entries, Precision::Single);
        eprintln!("{model}: {} rigs, single precision off by {worst} voxels at most", entries.len());
    }
}

fn every_beam() {
    let reference = reference();
    let sites = sites();
    for model in ["os1-64", "vlp-16"] {
        let entries: Vec<&Entry> = reference.full_sampling_pairs[model].iter().collect();
        for precision in [Precision::Double, Precision::Single] {
            let worst = compare(&sites, model, &sampling(1024, 1), &entries, precision);
            eprintln!("{model}, every beam, {precision:?}: off by {worst} voxels at most");
        }
    }
}

fn any_threads_and_instructions() {
    let site = site(0.5);
    let rigs: Vec<Rig> =
        [10.0, -25.0].iter().map(|pitch| rig("vlp-16", &[0.1, 0.05, -0.1, *pitch, 3.0], 2)).collect();
    let sampling = Sampling { columns: Some(180), scan_stride: 20, ..Sampling::default() };
    let units = [Unit::nominal("vlp-16").unwrap()];
    let fineness = Fineness { views: 5, ..Fineness::between((-0.1, 0.1)) };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let exact = view(&site, "vlp-16", &sampling, Precision::Single).see(&rigs);
            (exact, CellView::new(&site, &units, &sampling, &fineness).unwrap().see(&rigs))
        })
    };
    let (exact, modelled) = on(1);
    assert!(exact[0].union > 1000.0 && exact[0] != exact[1], "{exact:?}");
    for threads in [2, 3, 7] {
        assert_eq!(on(threads), (exact.clone(), modelled.clone()), "{threads} threads");
    }
    for instructions in Instructions::available() {
        let view = view(&site, "vlp-16", &sampling, Precision::Single).with_instructions(instructions);
        assert_eq!(view.see(&rigs), exact, "{instructions:?}");
    }
}

/// Of the model against the reference.
struct Ranking {
    /// Standard deviation of the union's error among the best quarter.
    best_quarter_sd: f64,
    /// J that its first choice loses against the best of all, as a share.
    first_loss: f64,
    /// J that the best of its ten loses.
    tenth_loss: f64,
}

fn rank(model: &str, entries: &[&Entry], fineness: &Fineness) -> Ranking {
    let site = site(0.1);
    let units = [Unit::nominal(model).unwrap()];
    let cells = CellView::new(&site, &units, &sampling(512, 4), fineness).unwrap();
    let rigs: Vec<Rig> = entries.iter().map(|entry| rig(model, &entry.master, 2)).collect();
    let seen: Vec<Seen> = cells.see(&rigs);
    let best = entries.iter().map(|entry| entry.fine.j).fold(f64::NEG_INFINITY, f64::max);
    // terms of J other than coverage are the same for both
    let errors: Vec<f64> =
        seen.iter().zip(entries).map(|(seen, entry)| seen.union - entry.fine.union as f64).collect();
    let modelled = |at: &usize| entries[*at].fine.j + errors[*at];
    let mut ranked: Vec<usize> = (0..entries.len()).collect();
    ranked.sort_by(|a, b| modelled(b).total_cmp(&modelled(a)));
    let loss = |chosen: &[usize]| {
        let found = chosen.iter().map(|at| entries[*at].fine.j).fold(f64::NEG_INFINITY, f64::max);
        (best - found) / best
    };
    let mut truly: Vec<usize> = (0..entries.len()).collect();
    truly.sort_by(|a, b| entries[*b].fine.j.total_cmp(&entries[*a].fine.j));
    let quarter: Vec<f64> = truly[..entries.len() / 4].iter().map(|at| errors[*at]).collect();
    let mean = quarter.iter().sum::<f64>() / quarter.len() as f64;
    let square = quarter.iter().map(|error| (error - mean).powi(2)).sum::<f64>();
    let ranking = Ranking {
        best_quarter_sd: (square / (quarter.len() - 1) as f64).sqrt(),
        first_loss: loss(&ranked[..1]),
        tenth_loss: loss(&ranked[..10]),
    };
    let all = errors.iter().sum::<f64>() / errors.len() as f64;
    eprintln!(
        "{model}: {:?}; error mean {all:.0}, of the best quarter {mean:.0} +- {:.1}; first choice loses {:.3} %, best of ten \
         {:.3} %",
        cells.cost(),
        ranking.best_quarter_sd,
        100.0 * ranking.first_loss,
        100.0 * ranking.tenth_loss
    );
    ranking
}

fn the_model_is_as_good() {
    let reference = reference();
    for model in ["os1-64", "vlp-16"] {
        let entries: Vec<&Entry> = reference.pairs[model].iter().collect();
        let ranking = rank(model, &entries, &Fineness::between((-0.15, 0.15)));
        assert!(ranking.best_quarter_sd <= 80.0, "{}", ranking.best_quarter_sd);
        assert!(ranking.first_loss <= 0.001 && ranking.tenth_loss <= 1e-12, "{model}");
    }
}

fn the_model_ranks_good_mounts() {
    let reference = reference();
    let entries: Vec<&Entry> = reference.pairs["vlp-16"].iter().step_by(4).collect();
    let ranking = rank("vlp-16", &entries, &Fineness { views: 50, ..Fineness::between((-0.15, 0.15)) });
    assert!(ranking.best_quarter_sd <= 160.0, "{}", ranking.best_quarter_sd);
    assert!(ranking.first_loss <= 0.003 && ranking.tenth_loss <= 0.001);
}
