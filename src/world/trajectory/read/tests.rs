//! One walk in every format, and what each can get wrong.

use super::*;

/// Five poses of a walk, as times in ns, x in m, and yaw by z and w of the quaternion.
const WALK: [(u64, f64, f64, f64); 5] = [
    (1_700_000_000_000_000_000, -3.0, 0.0, 1.0),
    (1_700_000_000_100_000_000, -1.5, 0.6, 0.8),
    (1_700_000_000_200_000_000, 0.0, 0.8, 0.6),
    (1_700_000_000_300_000_000, 1.5, 0.6, 0.8),
    (1_700_000_000_400_000_000, 3.0, 0.0, 1.0),
];

fn rows(row: impl Fn(u64, f64, f64, f64) -> String) -> String {
    WALK.iter().map(|(time_ns, x, z, w)| row(*time_ns, *x, *z, *w) + "\n").collect()
}

fn tum() -> String {
    rows(|t, x, z, w| format!("{}.{:09} {x} 0 1 0 0 {z} {w}", t / 1_000_000_000, t % 1_000_000_000))
}

fn read(text: &str) -> ReadTrajectory {
    Trajectory::read(text.as_bytes(), None).unwrap_or_else(|error| panic!("{error} in:\n{text}"))
}

fn refused(text: &str, rate_hz: Option<f64>) -> String {
    Trajectory::read(text.as_bytes(), rate_hz).unwrap_err().to_string()
}

fn same(found: &Trajectory, what: &str) {
    let expected = read(&tum()).trajectory;
    assert_eq!(found.time_span_ns(), expected.time_span_ns(), "{what}");
    for ((t0, p0), (t1, p1)) in found.stamped().zip(expected.stamped()) {
        assert_eq!((t0, p0.translation_m), (t1, p1.translation_m), "{what}");
        assert!(p0.rotation.angle_between(p1.rotation) < 1e-6, "{what}");
    }
}

#[test]
fn every_format_gives_the_same_walk() {
    let matrix = |z: f64, w: f64, x: f64| {
        let (cos, sin) = (w * w - z * z, 2.0 * z * w);
        format!("{cos} {} 0 {x} {sin} {cos} 0 0 0 0 1 1", -sin)
    };
    let euroc_header =
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []";
    let euroc = rows(|t, x, z, w| format!("{t},{x},0,1,{w},0,0,{z}"));
    let biased = rows(|t, x, z, w| format!("{t},{x},0,1,{w},0,0,{z},0.1,0,0,0,0,0,0,0,0"));
    let named = rows(|t, x, z, w| format!("{t};map;{w};0;0;{z};{x};0;1"));
    for (what, text) in [
        ("mark, comments and CRLF", format!("\u{feff}# t x y z\r\n{}", tum().replace('\n', "\r\n"))),
        ("old Mac line ends", tum().replace('\n', "\r")),
        ("tabs and commas", tum().replace(' ', ",\t")),
        ("indented, commented", tum().lines().map(|line| format!("  {line} # here\n")).collect()),
        (
            "numpy's exponents",
            rows(|t, x, z, w| format!("{:.18e} {x:e} 0e0 1 0 0 {z:e} {w:e}", t as f64 * 1e-9))
                .lines()
                .zip(tum().lines())
                .map(|(e, plain)| {
                    // an f64 does not hold the time: its digits are those of the plain file
                    let digits: String = plain.split(' ').next().unwrap().replace('.', "");
                    let rest = e.split_once(' ').unwrap().1;
                    format!("{}.{}e+09 {rest}\n", &digits[..1], &digits[1..])
                })
                .collect(),
        ),
        ("EuRoC", format!("{euroc_header}\n{euroc}")),
        ("EuRoC with biases, no header", biased),
        ("names in a row", format!("stamp;frame_id;qw;qx;qy;qz;x;y;z\n{named}")),
        ("w first without a word", rows(|t, x, z, w| format!("{t} {x} 0 1 {w} 0 0 {z}"))),
        ("microseconds", rows(|t, x, z, w| format!("{} {x} 0 1 0 0 {z} {w}", t / 1000))),
        ("milliseconds", rows(|t, x, z, w| format!("{} {x} 0 1 0 0 {z} {w}", t / 1_000_000))),
        ("stamped matrices", rows(|t, x, z, w| format!("{t} {}", matrix(z, w, x)))),
        ("stamped matrices of 4 x 4", rows(|t, x, z, w| format!("{t} {} 0 0 0 1", matrix(z, w, x)))),
    ] {
        same(&read(&text).trajectory, what);
    }
    for (what, end) in [("KITTI", ""), ("KITTI of 16 columns", " 0 0 0 1")] {
        let text = rows(|_, x, z, w| matrix(z, w, x) + end);
        let found = Trajectory::read(text.as_bytes(), Some(10.0)).unwrap().trajectory;
        let later = found.stamped().map(|(t, pose)| (t + WALK[0].0, pose)).collect();
        same(&Trajectory::new(later).unwrap(), what);
        let message = refused(&text, None);
        assert!(message.contains("--rate") && message.contains("KITTI"), "{message}");
    }
}

#[test]
fn how_a_file_was_read_is_reported() {
    assert_eq!(read(&tum()).notes, Vec::<String>::new());
    let repeated = tum().replacen("1700000000.200000000", "1700000000.100000000", 1);
    let found = read(&repeated);
    assert_eq!(found.trajectory.stamped().count(), 4);
    assert!(
        found.notes[0].contains("1 pose with the time") && found.notes[0].contains("line 3"),
        "{:?}",
        found.notes
    );
    let w_first = read(&rows(|t, x, z, w| format!("{t} {x} 0 1 {w} 0 0 {z}")));
    assert!(w_first.notes.iter().any(|note| note.contains("qw qx qy qz")), "{:?}", w_first.notes);
    assert!(w_first.notes.iter().any(|note| note.contains("nanoseconds")), "{:?}", w_first.notes);
}

#[test]
fn errors_show_the_numbers_of_the_file() {
    let back = tum().replacen("1700000000.300000000", "1700000000.050000000", 1);
    let message = refused(&back, None);
    assert!(
        message.contains("line 4: time 1700000000.050000000 after 1700000000.200000000 (line 3)"),
        "{message}"
    );
    assert!(refused(&tum(), Some(10.0)).contains("leave it out"));
    assert!(refused("1 2 3\n", None).contains("line 1: 3 fields, expected 8"));
    assert!(refused("stamp,x,y,z,roll,pitch,yaw\n1,0,0,0,0,0,0\n", None).contains("quaternion"));
    let euler = refused("timestamp x y z\n1 2 3 4\n", None);
    assert!(euler.contains("the header names timestamp, x, y, z") && euler.contains("missing"), "{euler}");
    assert!(
        refused(&format!("{}1700000001 0 0 1 0 0 0\n", tum()), None).contains("line 6: 7 fields, expected 8")
    );
    assert!(refused("\u{feff}# nothing\n", None).contains("at least one pose"));
    assert!(Trajectory::read(b"\xff\xfe1\0", None).unwrap_err().to_string().contains("UTF-16"));
    assert!(refused("1 0 0 0 0 0 0 2\n", None).contains("norm 2.0"));
    assert!(refused("1 0 0 x 0 0 0 1\n", None).contains("\"x\""));
}
