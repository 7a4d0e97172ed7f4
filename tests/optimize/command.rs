//! `outrigger optimize` as a user meets it.

fn outrigger(arguments: &[&str]) -> std::process::Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(arguments)
        .env_remove("OUTRIGGER_JSON")
        .env_remove("OUTRIGGER_PRESET")
        .output()
        .unwrap()
}

fn json(arguments: &[&str]) -> serde_json::Value {
    let output = outrigger(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

pub fn the_command_finds_writes_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (mount, state) = (path("mount.json"), path("state.json"));
    let common = ["--preset", "paper-vlp-16", "--json"];
    let search = |extra: &[&str]| json(&[&["optimize"], &common[..], extra].concat());
    let whole = search(&["--method", "pattern", "--evals", "30", "--seed", "3", "--out", &mount]);
    assert_eq!((&whole["evaluations"], &whole["stopped_by"]), (&30.into(), &"budget".into()));
    assert_eq!(whole["history"].as_array().unwrap().len(), 30);
    assert_eq!(whole["history"][29][1], whole["best"]["objective"]);

    let evaluated = json(&["evaluate", "--json", "--mount", &mount]);
    assert_eq!(evaluated["objective"], whole["best"]["objective"], "the mount file scores as found");

    // the plan is made for the first budget, so both legs are given the same one by interrupting at a limit
    search(&["--method", "pattern", "--evals", "30", "--seed", "3", "--resume", &state]);
    let again = search(&["--resume", &state]);
    assert_eq!(again["history"], whole["history"]);
    let longer = search(&["--resume", &state, "--evals", "40"]);
    assert_eq!(longer["evaluations"], 40);
    assert_eq!(longer["history"].as_array().unwrap()[..30], whole["history"].as_array().unwrap()[..]);

    let other = outrigger(&["optimize", "--preset", "paper-os1-64", "--resume", &state, "--evals", "50"]);
    let words = String::from_utf8_lossy(&other.stderr);
    assert!(!other.status.success() && words.contains("preset") && words.contains("state.json"), "{words}");
    std::fs::write(&state, "{").unwrap();
    let broken = outrigger(&["optimize", "--preset", "paper-vlp-16", "--resume", &state, "--evals", "50"]);
    let words = String::from_utf8_lossy(&broken.stderr);
    assert!(!broken.status.success() && words.contains("line 1") && words.contains("state.json"), "{words}");
}

pub fn housings_that_must_not_collide_do_not() {
    let found = json(&[
        "optimize",
        "--preset",
        "paper-vlp-16",
        "--method",
        "pattern",
        "--evals",
        "60",
        "--clearance",
        "housing",
        "--json",
    ]);
    assert_eq!(found["best"]["feasible"], true, "{}", found["best"]);
    assert_eq!(found["best"]["violations"].as_array().unwrap().len(), 0);
    let far = outrigger(&[
        "optimize",
        "--preset",
        "paper-vlp-16",
        "--method",
        "random",
        "--evals",
        "5",
        "--clearance",
        "9",
    ]);
    let words = String::from_utf8_lossy(&far.stderr);
    assert!(!far.status.success() && words.contains("clearance"), "{words}");
}

pub fn a_servo_s_steps_and_limits_are_kept() {
    let arguments = ["optimize", "--preset", "paper-vlp-16", "--evals", "40", "--json", "--masters-min", "2"];
    let limits = [
        "--pitch-limits",
        "-20,31",
        "--tilt-step",
        "2.5",
        "--masters-max",
        "2",
        "--space=0,0.1,-0.1,0.1,0,0.05",
    ];
    let best = json(&[&arguments[..], &limits[..]].concat())["best"].clone();
    let masters = best["masters"].as_array().unwrap();
    assert_eq!(masters.len(), 2);
    for master in masters {
        let [x, y, z, pitch] = [0, 1, 2, 3].map(|at| master[at].as_f64().unwrap());
        assert!(
            (0.0..=0.1).contains(&x) && (-0.1..=0.1).contains(&y) && (0.0..=0.05).contains(&z),
            "{master}"
        );
        assert!((-20.0..=30.0).contains(&pitch) && pitch % 2.5 == 0.0, "{master}");
    }
    for (bad, words) in [
        (&["--tilt-step", "0"][..], "--tilt-step"),
        (&["--tilt-step", "7", "--pitch-limits", "1,6"], "no multiple of 7"),
        (&["--masters-min", "3", "--masters-max", "2"], "--masters-min 3"),
        (&["--pitch-limits", "9,3"], "bounds 9 to 3"),
        (&["--robust", "worst", "--tolerance", "-1,0"], "tolerance -1"),
    ] {
        let output = outrigger(&[&["optimize", "--preset", "paper-vlp-16", "--evals", "5"], bad].concat());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{bad:?}");
        assert!(error.contains(words), "{bad:?}: {error}");
    }
}

pub fn robust_searches_report_what_is_built() {
    let arguments = ["optimize", "--preset", "paper-vlp-16", "--masters-max", "1", "--evals", "30", "--json"];
    let robust =
        |more: &[&str]| json(&[&arguments[..], &["--robust", "expected", "--draws", "4"], more].concat());
    let found = robust(&[]);
    let [mean, worst] = ["mean", "worst"].map(|name| found["robust"][name].as_f64().unwrap());
    assert!(worst <= mean);
    let history = found["history"].as_array().unwrap();
    assert_eq!(history[29][1].as_f64().unwrap(), mean, "the search maximises what is built");
    // each evaluation casts the rays of every draw
    assert_eq!(found["rays"].as_u64().unwrap(), 30 * 4 * 2 * 41 * 180 * 16);
    let exact = robust(&["--tolerance", "0,0"]);
    assert_eq!(exact["robust"]["deviation"].as_f64().unwrap(), 0.0);
    assert_eq!(exact["robust"]["mean"], exact["best"]["objective"], "no error, no difference");
    let spun = robust(&["--tolerance", "0,0", "--free-spin"]);
    assert!(spun["robust"]["deviation"].as_f64().unwrap() > 0.0);
}

pub fn a_budget_of_rays_and_all_outputs() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (csv, page) = (path("sensors.csv"), path("report.html"));
    let document = json(&[
        "optimize",
        "--preset",
        "paper-vlp-16",
        "--masters-max",
        "1",
        "--evals",
        "500",
        "--method",
        "random",
        "--json",
        "--max-rays",
        "5000000",
        "--csv",
        &csv,
        "--report",
        &page,
    ]);
    assert_eq!(document["stopped_by"], "rays");
    let rays = document["rays"].as_u64().unwrap();
    assert!((5_000_000..10_000_000).contains(&rays), "{rays}");
    let [wall_s, objective_s, search_s] =
        ["wall_s", "objective_s", "search_s"].map(|n| document[n].as_f64().unwrap());
    assert!(objective_s > 0.0 && search_s >= 0.0 && (wall_s - objective_s - search_s).abs() < 1e-6);
    let lines = std::fs::read_to_string(csv).unwrap();
    assert_eq!(lines.lines().count(), 3, "{lines}");
    assert!(lines.lines().nth(1).unwrap().starts_with("master,vlp-16,"), "{lines}");
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.matches("<svg class").count() >= 2 && page.contains("seen by both"));
}
