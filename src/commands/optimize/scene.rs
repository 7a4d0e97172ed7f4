//! `optimize --scene`: the search in any scene.

use std::time::Instant;

use anyhow::{Context as _, bail};

use super::args::Args;
use super::scene_document::write;
use super::scene_rigs::{fineness, largest, present, rig_space, sampling};
use super::scene_runs::{Run, asked, compared, errors};
use super::site::sites;
use crate::base::files;
use crate::commands::experiment_args::ExperimentArgs;
use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, signals, wrong_usage};
use crate::design::scene_search::Views;
use crate::report::scene_search::{Document, Pictures, report};
use crate::simulate::view::ViewError;

/// What only a search in a published experiment knows.
const OF_AN_EXPERIMENT: [&str; 12] = [
    "method",
    "early_stop",
    "batch",
    "acquisition",
    "masters_max",
    "masters_min",
    "final_look",
    "fidelity",
    "regret",
    "max_rays",
    "certify",
    "export_published",
];
/// And what only a search in a scene.
const OF_A_SCENE: [&str; 19] = [
    "site",
    "max_range",
    "max_incidence",
    "min_hits",
    "trajectory",
    "rate",
    "trajectory_out",
    "sensors",
    "count",
    "operator",
    "ideal",
    "scan_stride",
    "weights",
    "present",
    "mesh_unit",
    "up",
    "map_voxel",
    "map_hits",
    "map_path",
];

const DEFAULT_EVALUATIONS: u64 = 1000;
/// Whether a scene is asked for; refuses what has no use then, or otherwise.
pub(crate) fn is_asked(args: &Args, context: Context) -> anyhow::Result<bool> {
    let is_scene = args.scene.scene.is_some() || args.scene.room.is_some() || !args.scene.site.is_empty();
    if is_scene {
        let why = "is about a published experiment, and --scene or --room searches another place";
        context.ensure_not_typed(&ExperimentArgs::ONLY_PUBLISHED, why)?;
        context.ensure_not_typed(&OF_AN_EXPERIMENT, why)?;
    } else {
        context.ensure_not_typed(
            &OF_A_SCENE,
            "is about a search in a place of your own: add --scene, --room or --site",
        )?;
    }
    Ok(is_scene)
}

/// Searches and reports.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let files = [&args.out, &args.scene.trajectory_out, &args.csv, &args.report, &args.resume];
    output::check_places(files)?;
    let start = Instant::now();
    let rigs = rig_space(args)?;
    let errors = errors(args, context)?;
    let present = args.scene.present.as_deref().map(|path| present(path, &rigs)).transpose()?;
    let (sites, mut warnings) = sites(args, context)?;
    warnings.iter().for_each(|warning| output::say_notice(warning));
    if let (Some(path), [(site, source)]) = (&args.scene.trajectory_out, &sites[..]) {
        files::write_whole(path, site.trajectory.moved(source.origin.world_m()).to_tum().as_bytes())
            .with_context(|| path.display().to_string())?;
    }
    let stop = signals::stop_flag()?;
    let stage = Stage::begin("looking around from the trajectory");
    let evaluations = args.evals.unwrap_or(DEFAULT_EVALUATIONS) as usize;
    let seed = args.seed.unwrap_or(1);
    let mut units = rigs.units.clone();
    units.extend(present.iter().flat_map(|(units, _)| units.iter().cloned()));
    let (sites, sources): (Vec<_>, Vec<_>) = sites.into_iter().unzip();
    let largest = largest(args, &rigs);
    let refused = |error: ViewError| if error.is_usage() { wrong_usage(error) } else { error.into() };
    let (sampling, left_out) = sampling(args, &sites, &units, &largest).map_err(refused)?;
    left_out.iter().for_each(|words| output::say_notice(words));
    warnings.extend(left_out);
    let asked = asked(args, sampling.scan_stride)?;
    let fineness = fineness(&rigs);
    let views = Views::new(sites, &units, (&sampling, &fineness), &largest, &asked).map_err(refused)?;
    let Views { mut model, judges, weights } = views;
    let run = Run {
        args,
        asked: &asked,
        judges: &judges,
        weights,
        evaluations,
        seed,
        errors,
        stage: &stage,
        stop: &stop,
    };
    let cast = &judges.cast;
    let (rigs, known, found) = run.by_count(rigs, &mut model)?;
    let (search, mut end) = run.search(&rigs, &mut model, known)?;
    stage.next("casting what the best mount is compared with");
    let answer = search.answer(&mut end.exact, present.as_ref().map(|(_, rig)| rig));
    let Some(answer) = answer else {
        bail!("stopped before the first exact evaluation: no mount was scored")
    };
    let fidelities = args.report.as_ref().map(|_| {
        stage.next("measuring speed against accuracy");
        search.fidelities(answer.phase_sd_voxels)
    });
    drop(stage);
    let winner = &end.exact[0];
    let violation_m = rigs.violation_m(&winner.rig);
    if winner.violation > violation_m {
        bail!(
            "none of {} mounts keeps the conditioning of registration at {} or more; the nearest misses it by {:.1} %: give a smaller \
             --min-conditioning",
            end.evaluations,
            asked.registration.1,
            100.0 * (winner.violation - violation_m)
        );
    }
    if violation_m > 0.0 {
        bail!(
            "none of {} mounts keeps the sensors apart; the nearest misses it by {violation_m:.4} m: give a larger --space, or \
             a smaller --clearance",
            end.evaluations
        );
    }
    let of_answer = warnings.len();
    warnings.extend(answer.doubts());
    warnings.extend(rigs.limits_of(&winner.values));
    warnings[of_answer..].iter().for_each(|warning| output::say_notice(warning));
    let by_count = compared(&found, &answer.observable_voxels);
    let mut document = Document::new(&asked, cast, &search, &end, answer, &sources);
    document.wall_s = start.elapsed().as_secs_f64();
    (document.by_count, document.warnings) = (by_count, warnings);
    let pictures = fidelities.as_deref().map(|fidelities| Pictures {
        rig: &winner.rig,
        cast,
        sources: &sources,
        fidelities,
    });
    let report = report(&document, pictures.as_ref());
    let written = write(args, &rigs, &document, &winner.values)
        .and_then(|()| output::write_page(args.report.as_deref(), &report));
    output::print_result(context.json, &document, &report, &[])?;
    written?;
    Ok(Outcome::Done)
}
