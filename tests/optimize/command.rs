//! `outrigger optimize` as a user meets it.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

pub fn outrigger(arguments: &[&str]) -> std::process::Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(arguments)
        .env_remove("OUTRIGGER_JSON")
        .env_remove("OUTRIGGER_PRESET")
        .output()
        .unwrap()
}

pub fn json(arguments: &[&str]) -> serde_json::Value {
    let output = outrigger(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    crate::support::document(&output.stdout).unwrap()
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

    let evaluated = json(&["predict", "--json", "--mount", &mount]);
    assert_eq!(evaluated["objective"], whole["best"]["objective"], "the mount file scores as found");
    let notice = |arguments: &[&str]| {
        let output = outrigger(&[&["predict", "--mount", &mount], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        said.split_once("found with ").map(|(_, what)| what.trim_end().to_owned())
    };
    assert_eq!(notice(&[]), None);
    let lambda = notice(&["--lambda", "1500"]);
    assert_eq!(lambda.as_deref(), Some("--lambda vlp-16=2000 (here vlp-16=1500)"));
    let path = notice(&["--path", "forward"]);
    assert_eq!(path.as_deref(), Some("--path lateral (here forward)"));

    // the plan is made for the first budget, so both legs are given the same one by interrupting at a limit
    search(&["--method", "pattern", "--evals", "30", "--seed", "3", "--resume", &state]);
    let again = search(&["--resume", &state]);
    assert_eq!(again["history"], whole["history"]);
    let longer = search(&["--resume", &state, "--evals", "40"]);
    assert_eq!(longer["evaluations"], 40);
    assert_eq!(longer["history"].as_array().unwrap()[..30], whole["history"].as_array().unwrap()[..]);

    let other = outrigger(&["optimize", "--preset", "paper-os1-64", "--resume", &state, "--evals", "50"]);
    let words = String::from_utf8_lossy(&other.stderr);
    assert!(!other.status.success() && words.contains("--preset") && words.contains("state.json"), "{words}");
    // by the flag that was typed, not by what follows from it
    for (typed, words) in [
        (&["--voxel", "0.25"][..], "--voxel 0.5, asked for is 0.25"),
        (&["--voxel", "0.5"], "--phase locked, asked for is free (--fidelity auto"),
        (&["--masters-max", "2"], "--masters-max 5, asked for is 2"),
        (&["--pitch-limits", "0,45"], "--pitch-limits [-90.0,90.0], asked for is [0.0,45.0]"),
    ] {
        let other =
            outrigger(&[&["optimize", "--preset", "paper-vlp-16", "--resume", &state], typed].concat());
        let said = String::from_utf8_lossy(&other.stderr).into_owned();
        assert!(other.status.code() == Some(2) && said.contains(words), "{typed:?}: {said}");
    }
    let spent = [&["optimize"], &common[..], &["--resume", &state, "--evals", "60", "--max-rays", "1"]];
    let spent = outrigger(&spent.concat());
    let said = String::from_utf8_lossy(&spent.stderr);
    assert!(spent.status.success() && !said.contains("interrupted"), "{said}");
    let document: serde_json::Value = crate::support::document(&spent.stdout).unwrap();
    assert_eq!(document["stopped_by"], "rays");
    std::fs::write(&state, "{").unwrap();
    let broken = outrigger(&["optimize", "--preset", "paper-vlp-16", "--resume", &state, "--evals", "50"]);
    let words = String::from_utf8_lossy(&broken.stderr);
    assert!(!broken.status.success() && words.contains("line 1") && words.contains("state.json"), "{words}");
}

pub fn ctrl_c_gives_the_best_so_far_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json");
    let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"));
    program
        .args(["optimize", "--preset", "paper-os1-64", "--evals", "1000000", "--json", "--out"])
        .arg(&mount);
    program.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let running = program.spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_secs(3));
    let told = std::time::Instant::now();
    kill(Pid::from_raw(running.id() as i32), Signal::SIGINT).unwrap();
    let output = running.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    // far less than the final look of 32 mounts takes, far more than a batch does
    assert!(told.elapsed() < std::time::Duration::from_secs(20), "{:?}", told.elapsed());
    let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!(document["stopped_by"], "interrupted");
    assert!(document["final_look"].is_null() && said.contains("without another look"), "{said}");
    assert!(mount.is_file());
}

pub fn the_default_gives_what_is_best_as_built() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state.json").to_str().unwrap().to_owned();
    let common = ["optimize", "--preset", "paper-vlp-16", "--masters-max", "1", "--json", "--resume", &state];
    let page = folder.path().join("report.html").to_str().unwrap().to_owned();
    let looked = json(&[&common[..], &["--evals", "80", "--report", &page]].concat());
    let look = &looked["final_look"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!(number(&look["chosen"]["mean"]) >= number(&look["favourite"]["mean"]), "{look}");
    assert_eq!(number(&look["favourite_as_searched"]), number(&looked["history"][79][1]));
    assert_eq!(look["chosen"]["draws"], 16);
    let page = std::fs::read_to_string(&page).unwrap();
    for words in ["the best of those looked at again", "no mount can score above", "as searched, comes to"] {
        assert!(page.contains(words), "the report says what the screen says: {words}");
    }
    let mounts = number(&look["looked_at"]);
    assert!(
        mounts > 1.0 && number(&look["evaluations"]) == 4.0 * mounts + 16.0 * (1.0 + (mounts / 4.0).floor())
    );
    assert!(look["best"].as_u64().unwrap() > 0, "with this seed another mount is better as built: {look}");
    assert!(number(&looked["best"]["objective"]) < number(&looked["history"][79][1]));

    // from disk the search is at its end, and the look is the same
    let again = json(&common);
    assert_eq!(again["best"], looked["best"]);
    assert_eq!(again["final_look"]["chosen"], look["chosen"]);

    let searched = json(&[&common[..], &["--final-look", "off"]].concat());
    assert!(searched["final_look"].is_null());
    assert_eq!(searched["best"]["objective"], searched["history"][79][1]);
    let both =
        outrigger(&["optimize", "--preset", "paper-vlp-16", "--fidelity", "auto", "--final-look", "on"]);
    assert!(!both.status.success() && String::from_utf8_lossy(&both.stderr).contains("--final-look"));
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
        (&["--robust", "worst", "--tolerance", "-1,0"], "tolerance -1"),
        (&["--tilt-step", "200"], "leaves no angle but 0 between -90 and 90"),
        (&["--pitch-limits", "-200,200"], "expected within -180 to 180"),
    ] {
        let output = outrigger(&[&["optimize", "--preset", "paper-vlp-16", "--evals", "5"], bad].concat());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{bad:?}");
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

/// What the released program writes, name by name, as its encoder writes it; and what it says is the mount that was found.
pub fn the_published_export_is_read_as_it_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("best_mounts.json");
    let export = path.to_str().unwrap();
    let arguments =
        ["optimize", "--preset", "paper-vlp-16", "--path", "forward", "--roll", "free", "--json", "--method"];
    let more = ["pattern", "--evals", "40", "--masters-max", "2", "--export-published", export];
    let found = json(&[&arguments[..], &more].concat());
    let text = std::fs::read_to_string(&path).unwrap();
    let written: serde_json::Value = serde_json::from_str(&text).unwrap();
    let names = |of: &serde_json::Value| -> Vec<String> { of.as_object().unwrap().keys().cloned().collect() };
    let sorted = |mut names: Vec<String>| {
        names.sort();
        names.join(" ")
    };
    for (part, expected) in [
        ("", "backpack mounts optimization roll sensor_type symmetry trajectory_world"),
        ("/symmetry", "enabled plane"),
        ("/roll", "fixed fixed_deg"),
        ("/backpack", "margin path_axis path_length path_step"),
        ("/optimization", "N lambda method total_coverage"),
        ("/mounts/0", "euler_deg position"),
        ("/trajectory_world/0", "R t"),
    ] {
        assert_eq!(sorted(names(written.pointer(part).unwrap())), expected, "{part}");
    }
    assert_eq!(written["sensor_type"], "Velodyne VLP-16");
    let walk = serde_json::json!({ "path_axis": "y", "path_length": 40.0, "path_step": 1.0, "margin": 5.0 });
    assert_eq!(written["backpack"], walk);
    assert_eq!(written["optimization"]["total_coverage"], found["best"]["unique_voxels"]);
    assert_eq!(written["optimization"]["N"], found["best"]["sensors"]);
    let poses = written["trajectory_world"].as_array().unwrap();
    assert_eq!(poses.len(), 41);
    assert_eq!(poses[40]["t"], serde_json::json!([0.0, 20.0, 1.6]));
    assert_eq!(poses[0]["R"][1], serde_json::json!([0.0, 1.0, 0.0]));

    let evaluate = |mount: &str| {
        json(&["predict", "--mount", mount, "--preset", "paper-vlp-16", "--path", "forward", "--json"])
    };
    let again = evaluate(export);
    assert_eq!(again["sensors"], found["best"]["sensors"]);
    let voxels = |of: &serde_json::Value| of["unique_voxels"].as_f64().unwrap();
    // angles went through another convention: a ray on the edge of a voxel may change sides
    assert!((voxels(&again) - voxels(&found["best"])).abs() <= 3.0, "{again}");
    let master = &found["best"]["masters"][0];
    for axis in 0..5 {
        let [then, now] = [&master[axis], &again["mounts"][0][axis]].map(|v| v.as_f64().unwrap());
        assert!((then - now).abs() < 1e-9, "{axis}: {then} {now}");
    }

    let one = serde_json::json!({ "mounts": written["mounts"][0] });
    let lone = folder.path().join("lone.json");
    let mut single = written.clone();
    single["mounts"] = one["mounts"].clone();
    std::fs::write(&lone, single.to_string()).unwrap();
    assert_eq!(
        evaluate(lone.to_str().unwrap())["sensors"],
        1,
        "its encoder writes a list of one as its member"
    );
    single["mounts"]["euler_deg"] = serde_json::json!([0, 20, 30]);
    std::fs::write(&lone, single.to_string()).unwrap();
    let output = outrigger(&["predict", "--mount", lone.to_str().unwrap()]);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && error.contains("mounts[0].euler_deg"), "{error}");
}

pub fn batches_and_acquisitions_are_chosen_by_flags() {
    let arguments =
        ["optimize", "--preset", "paper-vlp-16", "--method", "bayesian", "--evals", "20", "--json"];
    let masters = ["--masters-max", "1"];
    let found = |more: &[&str]| json(&[&arguments[..], &masters[..], more].concat())["history"].clone();
    let plain = found(&[]);
    assert_eq!(plain, found(&["--batch", "1", "--acquisition", "log-ei-plus"]));
    // what is chosen comes after the seed points, which are the same
    for more in [&["--batch", "4"][..], &["--acquisition", "ei"]] {
        let other = found(more);
        assert_eq!(plain.as_array().unwrap()[..12], other.as_array().unwrap()[..12]);
        assert_eq!(other.as_array().unwrap().len(), 20);
        assert_ne!(plain, other, "{more:?}");
    }
    for (method, flags, words) in [
        ("ga", &["--acquisition", "ei"][..], "--acquisition is about --method staged, bayesian: genetic"),
        ("random", &["--batch", "1"], "--batch is about --method staged, bayesian: random"),
        (
            "cma-es",
            &["--early-stop"],
            "--early-stop is about --method bayesian, genetic, particle-swarm: cma-es",
        ),
        ("random", &["--regret", "5"], "--regret is about --fidelity auto"),
        ("random", &["--roll-limits", "1,2"], "--roll-limits is about a free roll"),
    ] {
        let asked = ["optimize", "--preset", "paper-vlp-16", "--evals", "5", "--method", method];
        let output = outrigger(&[&asked, flags].concat());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && error.contains(words), "{method} {flags:?}: {error}");
    }
}

pub fn a_mount_is_scored_as_it_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json").to_str().unwrap().to_owned();
    let asked =
        ["optimize", "--preset", "paper-os1-64,paper-vlp-16", "--path", "forward", "--azimuths", "90"];
    let more = [
        "--lambda",
        "os1-64=900,vlp-16=700",
        "--masters-max",
        "1",
        "--evals",
        "20",
        "--out",
        &mount,
        "--json",
    ];
    let found = json(&[&asked[..], &more, &["--final-look", "off"]].concat());
    let evaluate = ["predict", "--mount", &mount, "--json"];
    let scored = json(&evaluate);
    assert_eq!(scored["objective"], found["best"]["objective"]);
    assert_eq!((&scored["path"], &scored["prices"]), (&found["path"], &found["prices"]));
    // what is said counts, and where it is other than in the file that is told
    let output = outrigger(&[&evaluate[..], &["--path", "lateral"]].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && told.contains("found with --path forward (here lateral)"), "{told}");
    // the same experiment, whoever of its sensors is named first
    let swapped = json(&[&evaluate[..], &["--preset", "paper-vlp-16,paper-os1-64"]].concat());
    assert_eq!((&swapped["objective"], &swapped["azimuths"]), (&scored["objective"], &90.into()));
    assert_eq!(swapped["prices"], serde_json::json!([700.0, 900.0]));
    let mut turned: serde_json::Value = serde_json::from_slice(&std::fs::read(&mount).unwrap()).unwrap();
    turned["sensors"][0]["pitch_deg"] = (turned["sensors"][0]["pitch_deg"].as_f64().unwrap() + 1.0).into();
    let other = folder.path().join("turned.json").to_str().unwrap().to_owned();
    std::fs::write(&other, turned.to_string()).unwrap();
    let output = outrigger(&["predict", "--mount", &other]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("its sensors were changed since"), "{told}");
    // a file from before these were kept is read
    let mut old: serde_json::Value = serde_json::from_slice(&std::fs::read(&mount).unwrap()).unwrap();
    assert_eq!(old["found_with"]["azimuths"], 90);
    old.as_object_mut().unwrap().remove("found_with");
    std::fs::write(&mount, old.to_string()).unwrap();
    assert_eq!(json(&evaluate)["azimuths"], 180);
}

pub fn a_certificate_lies_between_what_was_found_and_the_plain_bound() {
    let arguments =
        ["optimize", "--preset", "paper-vlp-16", "--evals", "40", "--method", "pattern", "--json"];
    let masters = ["--masters-max", "1"];
    let plain = json(&[&arguments[..], &masters].concat());
    assert!(plain["certificate"].is_null());
    let proved = json(&[&arguments[..], &masters, &["--certify", "40"]].concat());
    let number = |of: &serde_json::Value, at: &str| of.pointer(at).unwrap().as_f64().unwrap();
    let (found, bound) = (number(&proved, "/best/objective"), number(&proved, "/bound"));
    assert!(found < bound && bound < number(&plain, "/bound"), "{found} {bound}");
    assert_eq!(number(&proved, "/certificate/gap"), bound - found);
    assert!(number(&proved, "/certificate/regions") <= 40.0);
    let two = outrigger(&["optimize", "--certify", "9", "--masters-min", "2", "--preset", "paper-vlp-16"]);
    let error = String::from_utf8_lossy(&two.stderr).into_owned();
    assert!(two.status.code() == Some(2) && error.contains("one master"), "{error}");
}

pub fn a_search_looks_again_at_what_it_liked() {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json").to_str().unwrap().to_owned();
    let arguments = ["optimize", "--preset", "paper-os1-64", "--masters-max", "1", "--evals", "40", "--json"];
    let auto = [&arguments[..], &["--fidelity", "auto", "--out", &mount]].concat();
    let found = json(&auto);
    let fidelity = &found["fidelity"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!(fidelity["looked_at"].as_u64().unwrap() > 5, "{fidelity}");
    assert!(number(&fidelity["regret_bound"]) <= 1e-3 * number(&fidelity["value"]), "{fidelity}");
    assert!(number(&fidelity["value"]) >= number(&fidelity["favourite"]["value"]), "{fidelity}");
    // judged alone and to the end, the mount is worth what was said
    let settled = json(&["predict", "--mount", &mount, "--fidelity", "auto", "--tolerance", "0.2", "--json"]);
    let settled = &settled["fidelity"];
    let apart = (number(&settled["value"]) - number(&fidelity["value"])).abs();
    assert!(apart <= number(&settled["bound"]) + number(&fidelity["bound"]), "{fidelity} {settled}");
    // better than what the published pattern likes, under the converged model
    let plain = folder.path().join("plain.json").to_str().unwrap().to_owned();
    json(&[&arguments[..], &["--out", &plain]].concat());
    let of_plain =
        json(&["predict", "--mount", &plain, "--fidelity", "auto", "--tolerance", "0.2", "--json"]);
    let of_plain = &of_plain["fidelity"];
    assert!(
        number(&settled["value"]) + number(&settled["bound"])
            >= number(&of_plain["value"]) - number(&of_plain["bound"]),
        "{settled} {of_plain}"
    );
    assert_eq!(json(&auto)["fidelity"], *fidelity, "same seed, same choice");
    let refused = outrigger(&[&auto[..], &["--robust", "worst"]].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--robust"));
}
