//! The one integration binary. A case that lacks its data is left out at run time: it is counted as ignored, and a
//! banner names it.

#![allow(clippy::unwrap_used)] // a failed unwrap is a failed case

mod support;

mod bags;
mod bought_servos;
mod cia402;
mod cli;
mod closed_loop;
mod compare;
mod config;
mod daemon;
mod decode;
mod demo;
mod examples;
mod export;
mod field_captures;
mod firmware;
mod damaged_files;
mod fuzz;
mod inspect;
mod maps;
mod mesh_files;
mod mount;
mod mutants;
mod optimize;
mod ouster;
mod registered;
mod rig;
mod rig_damage;
mod rig_stops;
mod rig_verbs;
mod scene_files;
mod scene_reports;
mod scene_search;
mod scenes;
mod sensor_setup;
mod session;
mod simulator;
mod study;
mod tidy;
mod tied_metadata;
mod velodyne;
mod view;

fn main() -> std::process::ExitCode {
    let modules: &[(&str, &[support::Case])] = &[
        ("bags", bags::CASES),
        ("bag_verbs", bags::VERBS),
        ("bought_servos", bought_servos::CASES),
        ("cia402", cia402::CASES),
        ("cli", cli::CASES),
        ("closed_loop", closed_loop::CASES),
        ("compare", compare::CASES),
        ("config", config::CASES),
        ("daemon", daemon::CASES),
        ("decode", decode::CASES),
        ("demo", demo::CASES),
        ("examples", examples::CASES),
        ("export", export::CASES),
        ("field_captures", field_captures::CASES),
        ("firmware", firmware::CASES),
        ("damaged_files", damaged_files::CASES),
        ("fuzz", fuzz::CASES),
        ("inspect", inspect::CASES),
        ("maps", maps::CASES),
        ("mesh_files", mesh_files::CASES),
        ("mount", mount::CASES),
        ("mutants", mutants::CASES),
        ("optimize", optimize::CASES),
        ("ouster", ouster::CASES),
        ("registered", registered::CASES),
        ("rig", rig::CASES),
        ("rig_damage", rig_damage::CASES),
        ("rig_stops", rig_stops::CASES),
        ("rig_verbs", rig_verbs::CASES),
        ("scene_files", scene_files::CASES),
        ("scene_reports", scene_reports::CASES),
        ("scene_search", scene_search::CASES),
        ("scenes", scenes::CASES),
        ("sensor_setup", sensor_setup::CASES),
        ("session", session::CASES),
        ("simulator", simulator::CASES),
        ("study", study::CASES),
        ("tidy", tidy::CASES),
        ("tied_metadata", tied_metadata::CASES),
        ("velodyne", velodyne::CASES),
        ("view", view::CASES),
    ];
    support::run(modules)
}
