//! Drawings of a rig: measures, and words that can be read.

use std::collections::BTreeMap;

use outrigger::rig::SensorEntry;

use super::{Folder, entry, rig};

/// Entities of a DXF's ENTITIES section: kind, and values by group code.
fn entities(text: &str) -> Vec<(String, BTreeMap<u16, String>)> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    assert_eq!(lines.len() % 2, 0, "codes and values come in pairs");
    let mut found: Vec<(String, BTreeMap<u16, String>)> = Vec::new();
    let mut is_inside = false;
    for pair in lines.chunks(2) {
        let code: u16 = pair[0].parse().unwrap();
        match (code, pair[1]) {
            (2, "ENTITIES") => is_inside = true,
            (0, kind) if is_inside => found.push((kind.to_owned(), BTreeMap::new())),
            (code, value) if is_inside => {
                found.last_mut().unwrap().1.insert(code, value.to_owned());
            }
            _ => {}
        }
    }
    assert_eq!(lines[lines.len() - 1], "EOF");
    found
}

pub fn dxf_measures() {
    let folder = Folder::new();
    folder.mount("mount.json", &rig());
    folder.done(&["mount.json", "--drawing", "mount.dxf", "--drawing", "mount.svg"]);
    let text = folder.read("mount.dxf");
    assert!(text.is_ascii() && text.contains("AC1009"));
    let entities = entities(&text);
    let number = |of: &BTreeMap<u16, String>, code: u16| of[&code].parse::<f64>().unwrap();
    let mut lengths: Vec<f64> = Vec::new();
    for (_, of) in entities.iter().filter(|(kind, _)| kind == "DIMENSION") {
        let (from, to) = if number(of, 50) == 0.0 { (13, 14) } else { (23, 24) };
        let length = (number(of, from) - number(of, to)).abs();
        assert!((length - number(of, 1)).abs() < 0.01, "what is written is what is measured: {of:?}");
        lengths.push(length);
    }
    // y in the top view, x and z in the front view, y again in the side view; both sides of 123.4
    lengths.sort_by(f64::total_cmp);
    let expected = [50.0, 50.0, 119.0, 123.4, 123.4, 200.0, 310.0, 310.0];
    assert_eq!(lengths.len(), expected.len(), "{lengths:?}");
    assert!(
        lengths.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 0.01),
        "{lengths:?}"
    );
    // circles of the housings, at their places from the platform's origin in the top view
    let circles: Vec<[f64; 3]> = entities
        .iter()
        .filter(|(kind, of)| kind == "CIRCLE" && ["OUTLINE", "PHANTOM"].contains(&of[&8].as_str()))
        .map(|(_, of)| [10, 20, 40].map(|code| number(of, code)))
        .collect();
    let radii: Vec<f64> = [43.5, 51.65].into();
    let housings: Vec<_> =
        circles.iter().filter(|[_, _, r]| radii.iter().any(|radius| (radius - r).abs() < 0.01)).collect();
    assert_eq!(housings.len(), 3, "{circles:?}");
    let front = housings.iter().find(|[_, _, radius]| *radius > 50.0).unwrap();
    for side in housings.iter().filter(|[_, _, radius]| *radius < 50.0) {
        assert!(
            ((front[0] - side[0]).abs() - 123.4).abs() < 0.01 && (front[1] - side[1] - 260.0).abs() < 0.01
        );
    }
    let svg = folder.read("mount.svg");
    for words in [
        "pitch +30.0°",
        "pitch -41.5°",
        "roll -12.0°",
        "yaw -90.0°",
        "1 : ",
        "TOP",
        "FRONT",
        "SIDE",
        "vlp-16",
    ] {
        assert!(svg.contains(words), "{words}");
    }
    roxmltree::Document::parse(&svg).unwrap();
}

pub fn words_do_not_overlap() {
    let folder = Folder::new();
    let many = |count: usize| -> Vec<SensorEntry> {
        (0..count)
            .map(|n| {
                let side = if n % 2 == 0 { 1.0 } else { -1.0 };
                let at = [side * 0.15, 0.25 * (n / 2) as f64, 0.1 + 0.02 * n as f64];
                entry(&format!("sensor-{n}"), "os1-64", at, [side * 25.0, 0.0, 0.0])
            })
            .collect()
    };
    for (name, sensors) in [("three", rig()), ("one", many(1)), ("pair", many(2)), ("six", many(6))] {
        folder.mount("mount.json", &sensors);
        folder.done(&["mount.json", "--drawing", "mount.svg"]);
        let text = folder.read("mount.svg");
        let svg = roxmltree::Document::parse(&text).unwrap();
        let mut rooms: Vec<([f64; 4], String)> = Vec::new();
        for node in svg.descendants().filter(|node| node.has_tag_name("text") && node.text().is_some()) {
            let number = |name: &str| node.attribute(name).unwrap().parse::<f64>().unwrap();
            let (x, y, size, words) = (number("x"), number("y"), number("font-size"), node.text().unwrap());
            // narrow: letters that really touch, not the room between them
            let (width, height) = (0.45 * size * words.chars().count() as f64, 0.7 * size);
            let start = match node.attribute("text-anchor").unwrap() {
                "start" => 0.0,
                "middle" => -0.5 * width,
                _ => -width,
            };
            let room = if node.attribute("transform").is_some() {
                [x - height, y - start - width, x, y - start]
            } else {
                [x + start, y - height, x + start + width, y]
            };
            assert!(
                room[0] > 5.0 && room[2] < 415.0 && room[1] > 3.0 && room[3] < 294.0,
                "{name}: {words} at {room:?}"
            );
            if let Some((_, other)) = rooms.iter().find(|(other, _)| {
                room[0] < other[2] && other[0] < room[2] && room[1] < other[3] && other[1] < room[3]
            }) {
                panic!("{name}: {words:?} lies over {other:?}");
            }
            rooms.push((room, words.to_owned()));
        }
        assert!(rooms.len() > 40);
    }
}
