use super::*;

fn read(name: &str, bytes: &[u8]) -> Result<Vec<CloudPoint>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let mut points = Vec::new();
    read_cloud(&path, |point| points.push(point)).map_err(|error| error.to_string())?;
    Ok(points)
}

const POSITIONS: [DVec3; 3] =
    [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.5, 0.25, 0.0), DVec3::new(4.0, -5.0, 6.5)];

fn pcd_header(kind: &str) -> Vec<u8> {
    format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x y z normal timestamp\nSIZE 1 4 4 4 4 8\nTYPE U F F F F F\n\
         COUNT 1 1 1 1 3 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {kind}\n"
    )
    .into_bytes()
}

/// Little-endian columns of the header above, each of all points.
fn pcd_columns() -> Vec<Vec<Vec<u8>>> {
    let floats = |values: [f64; 3]| values.map(|value| (value as f32).to_le_bytes().to_vec()).to_vec();
    vec![
        vec![vec![7], vec![8], vec![9]],
        floats(POSITIONS.map(|p| p.x)),
        floats(POSITIONS.map(|p| p.y)),
        floats(POSITIONS.map(|p| p.z)),
        vec![vec![0; 12]; 3],
        [10.5_f64, 11.0, 11.5].map(|time_s| time_s.to_le_bytes().to_vec()).to_vec(),
    ]
}

fn check(points: &[CloudPoint]) {
    let expected: Vec<CloudPoint> = POSITIONS
        .into_iter()
        .zip([10.5, 11.0, 11.5])
        .map(|(position_m, time_s)| CloudPoint { position_m, seen_from_m: None, time_s: Some(time_s) })
        .collect();
    assert_eq!(points, expected);
}

#[test]
fn pcd_in_its_three_encodings_says_the_same() {
    let mut text = pcd_header("ascii");
    text.extend(b"7 1 2 3 0 0 1 10.5\n8 -1.5 0.25 0 0 0 1 11\n\n9 4 -5 6.5 0 0 1 11.5\n");
    check(&read("a.pcd", &text).unwrap());
    let columns = pcd_columns();
    let mut binary = pcd_header("binary");
    (0..3).for_each(|row| columns.iter().for_each(|column| binary.extend(&column[row])));
    check(&read("a.pcd", &binary).unwrap());
    let plain: Vec<u8> = columns.concat().concat();
    // LZF of literals only
    let packed: Vec<u8> =
        plain.chunks(32).flat_map(|part| [&[part.len() as u8 - 1], part].concat()).collect();
    let mut compressed = pcd_header("binary_compressed");
    compressed.extend((packed.len() as u32).to_le_bytes());
    compressed.extend((plain.len() as u32).to_le_bytes());
    compressed.extend(&packed);
    check(&read("a.pcd", &compressed).unwrap());
    let last = compressed.len() - 1;
    for (bytes, words) in [
        (binary[..binary.len() - 5].to_vec(), "5 bytes of points are missing"),
        (compressed[..last].to_vec(), "ends in the compressed points"),
        (text[..text.len() - 5].to_vec(), "fewer numbers than fields"),
        (text[..text.len() - 24].to_vec(), "3 points, the file holds 2"),
    ] {
        let error = read("a.pcd", &bytes).unwrap_err();
        assert!(error.contains(words) && error.contains("a.pcd"), "{error}");
    }
}

#[test]
fn faults_of_a_pcd_header_are_reported() {
    let header = String::from_utf8(pcd_header("ascii")).unwrap();
    for (from, to, words) in [
        ("FIELDS intensity x", "FIELDS intensity u", "FIELDS without x"),
        ("SIZE 1 4", "SIZE 1", "differ in length"),
        ("SIZE 1 4", "SIZE 1 3", "field x: no numbers of type F with 3 bytes"),
        ("WIDTH 3", "WIDTH three", "line 7: \"WIDTH three\": \"three\" is no number"),
        ("DATA ascii", "DATA zip", "expected ascii, binary"),
        ("DATA ascii\n", "", "ends without a line DATA"),
        ("POINTS 3", "POINTS 0", "no point"),
    ] {
        let error = read("a.pcd", header.replace(from, to).as_bytes()).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn ply_clouds_tell_where_and_when_points_were_seen() {
    let header = |kind: &str| {
        format!(
            "ply\nformat {kind} 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n\
             property float vp_x\nproperty float vp_y\nproperty float vp_z\nproperty double scalar_GpsTime\n\
             property uchar red\nend_header\n"
        )
    };
    let mut bytes = header("binary_little_endian").into_bytes();
    let nowhere = [f32::NAN; 3];
    for (place, seen_from, time_s) in
        [([1.0, 2.0, 3.0], [0.5, 0.0, 1.0], 7.25), ([4.0, 5.0, 6.0], nowhere, 7.5_f64)]
    {
        place.iter().for_each(|value: &f64| bytes.extend(value.to_le_bytes()));
        seen_from.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.extend(time_s.to_le_bytes());
        bytes.push(255);
    }
    let points = read("a.ply", &bytes).unwrap();
    assert_eq!(points[0].seen_from_m, Some(DVec3::new(0.5, 0.0, 1.0)));
    assert_eq!((points[0].time_s, points[1].time_s), (Some(7.25), Some(7.5)));
    assert_eq!((points[1].position_m, points[1].seen_from_m), (DVec3::new(4.0, 5.0, 6.0), None));
    let header = header("ascii");
    let text = format!("{header}1 2 3 0.5 0 1 7.25 255\n4 5 6 0.5 0 1 7.5 0\n");
    assert_eq!(read("a.ply", text.as_bytes()).unwrap()[0], points[0]);
    let error = read("a.ply", format!("{header}1 2 3\n").as_bytes()).unwrap_err();
    assert!(error.contains("line 13") && error.contains("vertex"), "{error}");
    assert!(
        read("a.ply", header.replace("double y", "double v").as_bytes()).unwrap_err().contains("property y")
    );
    let folder = tempfile::tempdir().unwrap();
    let is = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        is_cloud(&path)
    };
    assert!(is("a.ply", &header) && is("b.LAZ", ""));
    let faces = |count: u32| header.replace("end_header", &format!("element face {count}\nend_header"));
    assert!(
        is("c.ply", &faces(0)) && !is("d.ply", &faces(1)) && !is("e.ply", "no header") && !is("f.obj", "")
    );
}

#[test]
fn what_is_no_cloud_is_named() {
    assert!(read("a.foo", b"1 2 3\n").unwrap_err().contains("known are .ply"));
    assert!(read("a.las", b"LASF").unwrap_err().contains("a.las: byte 4: the file ends in the header"));
    let missing = read_cloud(Path::new("no-such.pcd"), |_| ()).unwrap_err().to_string();
    assert!(missing.contains("no-such.pcd: cannot be read"), "{missing}");
}
