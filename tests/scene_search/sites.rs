//! `optimize --site`: one mount for several scenes.

use serde_json::Value;

use crate::optimize::command::{json, outrigger};

const FLAGS: [&str; 9] =
    ["--sensors", "vlp-16,vlp-16", "--ideal", "--azimuths", "120", "--scan-stride", "5", "--voxel", "0.5"];
const SMALL: &str = "-3,0 3,0 3,2";
const LARGE: &str = "-9,0 9,0";

/// A room and a hall, as meshes.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (name, [x, y, z]) in [("room.obj", [6.0, 4.0, 3.0]), ("hall.obj", [12.0, 9.0, 8.0])] {
            let corner = |n: usize| {
                let side = |bit: usize, edge_m: f64| if n >> bit & 1 == 1 { edge_m } else { -edge_m };
                format!("v {} {} {}\n", side(0, x), side(1, y), if n > 3 { z } else { 0.0 })
            };
            let corners: String = (0..8).map(corner).collect();
            let faces = "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n";
            std::fs::write(folder.path(name), corners + faces).unwrap();
        }
        folder
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    fn site(&self, scene: &str, walk: &str) -> String {
        format!("{}={walk}", self.path(scene))
    }

    fn search(&self, sites: &[String], more: &[&str]) -> Value {
        let mut flags = vec!["optimize", "--json", "--evals", "60"];
        sites.iter().for_each(|site| flags.extend(["--site", site]));
        json(&[&flags[..], &FLAGS, more].concat())
    }

    /// J of a mount file at a site, and the share that it sees.
    fn predicted(&self, mount: &str, scene: &str, walk: &str) -> (f64, u64) {
        let scene = self.path(scene);
        let flags = ["predict", "--json", "--weights", "published", "--sample-count", "1000"];
        let place = ["--mount", mount, "--scene", &scene, "--trajectory", walk];
        let found = json(&[&flags[..], &place, &FLAGS[2..]].concat());
        (found["objective"].as_f64().unwrap(), found["unique_voxels"].as_u64().unwrap())
    }
}

pub fn one_site_twice_is_that_site() {
    let folder = Folder::new();
    let site = folder.site("room.obj", SMALL);
    let once = folder.search(std::slice::from_ref(&site), &[]);
    let twice = folder.search(&[site.clone(), site], &[]);
    for what in ["masters", "sensors", "objective", "unique_voxels", "observable_share", "overlap_ratio"] {
        assert_eq!(once["best"][what], twice["best"][what], "{what}");
    }
    assert_eq!(once["history"], twice["history"]);
    assert_eq!(once["reachable_voxels"], twice["reachable_voxels"]);
    assert_eq!(once.get("sites"), None);
    let by_site = twice["best"]["by_site"].as_array().unwrap();
    assert!(by_site.len() == 2 && by_site[0] == by_site[1]);
    assert_eq!(by_site[0]["objective"], once["best"]["objective"]);
    // and it is what --scene and --trajectory say
    let scene = folder.path("room.obj");
    let place = ["--scene", &scene, "--trajectory", SMALL];
    let alone = json(&[&["optimize", "--json", "--evals", "60"][..], &place, &FLAGS].concat());
    assert_eq!(alone["best"], once["best"]);
}

pub fn the_score_of_two_sites() {
    let folder = Folder::new();
    let mount = folder.path("mount.json");
    let sites = [folder.site("room.obj", SMALL), folder.site("hall.obj", LARGE)];
    let found = folder.search(&sites, &["--weights", "published", "-o", &mount]);
    let best = &found["best"];
    let (room, hall) =
        (folder.predicted(&mount, "room.obj", SMALL), folder.predicted(&mount, "hall.obj", LARGE));
    let by_site = best["by_site"].as_array().unwrap();
    for (site, (objective, voxels)) in by_site.iter().zip([room, hall]) {
        let off = (site["objective"].as_f64().unwrap() - objective).abs();
        assert!(off <= 3.0, "{site} {objective}");
        assert!(site["unique_voxels"].as_u64().unwrap().abs_diff(voxels) <= 2, "{site} {voxels}");
    }
    let mean = |what: &str| by_site.iter().map(|site| site[what].as_f64().unwrap()).sum::<f64>() / 2.0;
    assert!((best["objective"].as_f64().unwrap() - mean("objective")).abs() < 1e-6, "{best}");
    assert!((best["objective"].as_f64().unwrap() - 0.5 * (room.0 + hall.0)).abs() <= 3.0, "{best}");

    // as shares a site of many voxels counts as much as a small one
    let shares = folder.search(&sites, &[]);
    let by_site = shares["best"]["by_site"].as_array().unwrap();
    let share_of = |site: usize| {
        by_site[site]["objective"].as_f64().unwrap()
            / shares["sites"][site]["reachable_voxels"].as_f64().unwrap()
    };
    let all = shares["sites"].as_array().unwrap();
    let reachable = all.iter().map(|site| site["reachable_voxels"].as_f64().unwrap()).sum::<f64>() / 2.0;
    assert!(all[1]["reachable_voxels"].as_u64() > all[0]["reachable_voxels"].as_u64().map(|n| 3 * n));
    let expected = 0.5 * (share_of(0) + share_of(1)) * reachable;
    let objective = shares["best"]["objective"].as_f64().unwrap();
    assert!((objective / expected - 1.0).abs() < 0.005, "{objective} {expected}");
    let seen = |site: usize| by_site[site]["observable_share"].as_f64().unwrap();
    let share = shares["best"]["observable_share"].as_f64().unwrap();
    assert!((share - 0.5 * (seen(0) + seen(1))).abs() < 1e-9, "{share}");

    // the worst site is no worse than that of the best mean
    let worst = folder.search(&sites, &["--weights", "published", "--robust", "worst"]);
    assert_eq!(worst["robust"], "worst");
    let least = |found: &Value| {
        let by_site = found["best"]["by_site"].as_array().unwrap().clone();
        by_site.iter().map(|site| site["objective"].as_f64().unwrap()).fold(f64::INFINITY, f64::min)
    };
    assert_eq!(worst["best"]["objective"].as_f64().unwrap(), least(&worst));
    assert!(least(&worst) >= least(&found) - 5.0, "{} {}", least(&worst), least(&found));
    assert!(worst.get("as_built").is_none(), "--robust alone is about the sites");
    let built = folder.search(&sites, &["--robust", "worst", "--tolerance", "0.01,0", "--draws", "2"]);
    assert_eq!((&built["robust"], &built["as_built"]["criterion"]), (&"worst".into(), &"worst".into()));
}

pub fn go_with_the_other_flags() {
    let folder = Folder::new();
    let (mount, state, page) =
        (folder.path("mount.json"), folder.path("state.json"), folder.path("page.html"));
    let sites = [folder.site("room.obj", SMALL), folder.site("hall.obj", LARGE)];
    let limits = ["--max-range", "8", "--min-hits", "2"];
    let first = folder.search(&sites, &[&limits[..], &["--resume", &state, "-o", &mount]].concat());
    assert_eq!(first["sampling"]["quality"]["max_range_m"], 8.0);
    let asked = [&limits[..], &["--resume", &state, "--present", &mount, "--report", &page]].concat();
    let again = folder.search(&sites, &asked);
    assert_eq!(again["best"], first["best"]);
    assert_eq!(again["present"]["by_site"], first["best"]["by_site"]);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("Who sees what: ") && html.contains("hall.obj"), "{}", html.len());
    let mut count = vec!["optimize", "--json", "--evals", "60", "--count", "1..2", "--sensors", "vlp-16"];
    sites.iter().for_each(|site| count.extend(["--site", site]));
    let counted = json(&[&count[..], &FLAGS[2..]].concat());
    assert_eq!(counted["by_count"].as_array().unwrap().len(), 2);
    // other sites are another search
    let mut other = vec!["optimize", "--site", &sites[0], "--site", &sites[0], "--evals", "60"];
    other.extend(limits.iter().chain(&["--resume", &state]).chain(&FLAGS));
    let output = outrigger(&other);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && words.contains("sites"), "{words}");
}

pub fn refuse_what_is_about_one() {
    let folder = Folder::new();
    let (one, other) = (folder.site("room.obj", SMALL), folder.site("hall.obj", LARGE));
    let nowhere = folder.site("none.obj", SMALL);
    let written = folder.path("walk.tum");
    let scene = folder.path("room.obj");
    for (typed, words) in [
        (&["--site", &one, "--site", &other, "--trajectory-out", &written][..], "--trajectory-out"),
        (&["--site", &one, "--site", "=0,0 1,0"], "SCENE=TRAJECTORY"),
        (&["--site", &one, "--site", &nowhere], "none.obj"),
        (&["--site", &one, "--scene", &scene], "--scene"),
        (&["--site", &one, "--site", &other, "--rate", "10"], "--rate"),
        (&["--site", &one, "--site", &other, "--registration-weight", "10"], "--registration-weight"),
        (&["--preset", "paper-os1-64", "--site", &one], "--preset"),
    ] {
        let output = outrigger(&[&["optimize", "--evals", "20"], typed, &FLAGS].concat());
        let messages = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && messages.contains(words), "{typed:?}: {messages}");
        assert!(!messages.contains("panicked"), "{messages}");
    }
}
