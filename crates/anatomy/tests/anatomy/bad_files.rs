//! Files that are wrong: told with file, line, key and what is allowed; never a panic.

use crate::load_text;
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;

const GOOD: &str = "\
[tract]
frame = \"ras\"
source = \"own\"

[[tract.segment]]
name = \"jejunum\"
points_mm = [
  [0, 0, 0, 9],
  [30, 2, 5, 10],
  [60, -10, 9, 9.5],
]
[[tract.segment]]
name = \"ileum\"
points_mm = [
  [64, -12, 10, 9],
  [90, -40, 12, 8],
  [95, -80, 20, 8],
]
wall = { friction = 0.1, haustra_pitch_mm = 20 }
";

fn error_of(text: &str) -> String {
    load_text(text).map(|(tract, _)| tract.name).unwrap_err().to_string()
}

#[test]
fn law_the_good_file_loads_and_its_bridge_is_named() {
    let (tract, report) = load_text(GOOD).unwrap();
    assert_eq!(tract.segments.len(), 2);
    assert!((tract.segments[1].wall.haustra_pitch_m - 0.02).abs() < 1e-15);
    assert_eq!(report.bridges.len(), 1);
    assert!(report.warnings[0].contains("between `jejunum` and `ileum`"), "{:?}", report.warnings);
}

#[test]
fn law_errors_name_line_key_and_what_is_allowed() {
    let cases: [(&str, &str, &[&str]); 20] = [
        ("frame = \"ras\"\n", "", &["frame"]),
        ("\"ras\"", "\"world\"", &["tract.toml:2:", "ras", "lps"]),
        (
            "\"jejunum\"",
            "\"jejunumm\"",
            &["tract.toml:6:", "no segment is called `jejunumm`", "terminal_ileum"],
        ),
        ("\"ileum\"", "\"stomach\"", &["tract.toml:13:", "`stomach` cannot follow `jejunum`"]),
        ("\"ileum\"", "\"jejunum\"", &["tract.toml:13:", "cannot follow"]),
        ("[30, 2, 5, 10]", "[30, 2, 5, -10]", &["tract.toml:9:", "radius of -10", "above 0"]),
        ("[30, 2, 5, 10]", "[30, 2, 5, 0]", &["tract.toml:9:", "above 0"]),
        ("[30, 2, 5, 10]", "[30, 2, nan, 10]", &["tract.toml:9:", "finite"]),
        ("[30, 2, 5, 10]", "[30, 2, 5, inf]", &["tract.toml:9:", "finite"]),
        ("[30, 2, 5, 10]", "[30, 2, 1e300, 10]", &["tract.toml:9:", "units"]),
        ("[30, 2, 5, 10]", "[30, 2]", &["tract.toml:9:", "2 numbers"]),
        ("[30, 2, 5, 10]", "[0, 0, 0, 10]", &["tract.toml:9:", "1e-6 m"]),
        ("[90, -40, 12, 8]", "[64, -12, 10, 9]", &["tract.toml:16:", "1e-6 m"]),
        ("[30, 2, 5, 10]", "[30, 2, 5]", &["tract.toml:9:", "default_radius_mm"]),
        ("[64, -12, 10, 9]", "[164, -12, 10, 9]", &["tract.toml:12:", "gaps below 0.05 m"]),
        ("friction = 0.1", "friction = -1", &["tract.toml:19:", "friction", "0 or above"]),
        ("friction = 0.1", "frictoin = 0.1", &["tract.toml:19:", "frictoin", "friction"]),
        ("points_mm", "points_cm", &["tract.toml:7:", "points_mm"]),
        ("source = \"own\"", "interpolation = \"linear\"", &["tract.toml:3:", "cubic_c2"]),
        ("[tract]", "[tracts]\nx = 1\n[tract]", &["tract.toml:", "tracts", "one table"]),
    ];
    for (find, replace, expected) in cases {
        let text = GOOD.replacen(find, replace, 1);
        assert_ne!(text, GOOD);
        let error = error_of(&text);
        for part in expected {
            assert!(error.contains(part), "`{find}` -> `{replace}`: expected `{part}` in: {error}");
        }
    }
}

#[test]
fn law_lines_that_touch_themselves_are_refused_and_overlapping_lumina_counted() {
    let loops = |above: f64| {
        format!(
            "[tract]\nframe = \"ras\"\n[[tract.segment]]\nname = \"ileum\"\ndefault_radius_mm = 6\npoints_mm = [[-60, 0, 0], \
             [0, 0, 0], [60, 0, 0], [90, 40, 0], [60, 80, {above}], [0, 60, {above}], [0, 0, {above}], [0, -60, {above}]]\n"
        )
    };
    let error = error_of(&loops(1.0));
    assert!(error.contains("within") && error.contains("of itself"), "{error}");
    let (_, report) = load_text(&loops(8.0)).unwrap();
    assert_eq!(report.overlaps.len(), 1);
    let overlap = &report.overlaps[0];
    assert!((overlap.depth_m - 0.004).abs() < 2e-4, "two tubes of 6 mm, 8 mm apart: {overlap:?}");
    assert!((overlap.at_m.0 - 0.06).abs() < 3e-3 && report.warnings.iter().any(|w| w.contains("1 places")));
    assert!(load_text(&loops(14.0)).unwrap().1.overlaps.is_empty());
}

#[test]
fn law_bad_shapes_and_csvs_are_refused() {
    let shape = |shape: &str| {
        error_of(&format!(
            "[tract]\nframe = \"ras\"\n[[tract.segment]]\nname = \"ileum\"\ndefault_radius_mm = 6\nshape = {shape}\n"
        ))
    };
    let error = shape("{ kind = \"torus\" }");
    assert!(error.starts_with("tract.toml:6:") && error.contains("three-half-circles"), "{error}");
    assert!(shape("{ kind = \"helix\", radius_mm = -3, pitch_mm = 3, turns = 1 }").contains("radius_mm"));
    assert!(shape("{ kind = \"helix\", radius_mm = 3, turns = 1 }").contains("pitch_mm"));
    assert!(shape("{ kind = \"helix\", radius_mm = 3, pitch_mm = 3, turns = 1e30 }").contains("100 m"));
    assert!(
        shape("{ kind = \"helix\", radius_mm = 1e300, pitch_mm = 1e300, turns = 1e300 }").contains("100 m")
    );
    assert!(shape("{ kind = \"straight\", start_mm = [0, 0, 0], end_mm = [0, 0, 0] }").contains("1e-6"));
    assert!(
        shape("{ kind = \"straight\", start_mm = [0, 0, 0], end_mm = [0, 0, 1], x = 1 }").contains("end_mm")
    );
    assert!(shape("{ }").contains("kind"));
    assert!(shape("[1]").contains("shape"));
    let error = error_of("[tract]\nframe = \"ras\"\ncentre_line_csv = \"nowhere.csv\"\n");
    assert!(error.starts_with("tract.toml:3:") && error.contains("nowhere.csv"), "{error}");
}

#[test]
fn law_csv_errors_name_line_and_column() {
    let folder = std::env::temp_dir().join(format!("lumenav-anatomy-csv-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let try_csv = |csv: &str, extra: &str| {
        std::fs::write(folder.join("line.csv"), csv).unwrap();
        let text = format!("[tract]\nframe = \"ras\"\ncentre_line_csv = \"line.csv\"\n{extra}\n");
        let node = lumenav_core::Node::parse_text(&text, "tract.toml", &folder, &[]).unwrap();
        lumenav_anatomy::tract_file::load(&node, &lumenav_anatomy::tract_file::TractOptions::default())
            .map_err(|error| error.to_string())
    };
    let head = "# comment\nsegment,s,x,y,z,radius\n";
    let good = format!("{head}cecum,0,0,0,0,0.02\ncecum,0,0,0,0.02,\ncecum,0,0,0.01,0.05,0.02\n");
    let (tract, _) = try_csv(&good, "default_radius_mm = 21").unwrap();
    assert!((tract.radius.range_m().1 - 0.021).abs() < 1e-15);
    for (csv, part) in [
        (good.clone(), "line.csv:4:1: `radius`: no radius here"),
        (format!("{head}cecum,0,0,0,0,0.02\n"), "at least 2 points"),
        (format!("{head}cecum,0,0,x,0,0.02\n"), "line.csv:3:1: `y`: `x` is not a finite number"),
        (format!("{head}cecum,0,0,0,0,nan\n"), "line.csv:3:1: `radius`"),
        (format!("{head}cecum,0,0,0,0,-1\n"), "above 0"),
        (format!("{head}cecum,0,0\n"), "ends before"),
        (format!("{head}ascending,0,0,0,0,1\ncecum,0,0,0,1,1\n"), "`caecum` cannot follow `ascending`"),
        ("segment,x,y\n".to_owned(), "`z`: the column is missing"),
        ("segment,x,y,z,q\n".to_owned(), "unknown column"),
        (String::new(), "no points"),
    ] {
        let error = try_csv(&csv, "").map(|_| ()).unwrap_err();
        assert!(error.contains(part), "expected `{part}` in: {error}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Pieces that a mutation may put anywhere.
const PIECES: [&str; 24] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e300",
    "1e-300",
    "[",
    "]",
    "\"",
    "=",
    "\n",
    ",",
    "[0, 0, 0, 9],",
    "{}",
    "points_m",
    "shape",
    "\"stomach\"",
    "[[tract.segment]]",
    "[tract]",
    "é",
    "#",
    "default_radius_mm = 5\n",
    "9223372036854775807",
    "true",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: Some(Box::new(WithSource("regressions"))), ..ProptestConfig::default() })]

    /// Mutated files give a tract or an error, never a panic.
    #[test]
    fn law_mutated_files_never_panic(
        edits in prop::collection::vec((0..GOOD.len(), 0..12_usize, 0..PIECES.len()), 1..5),
    ) {
        let mut text = GOOD.to_owned();
        for (at, remove, piece) in edits {
            let start = (0..=at.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
            let end = (start + remove).min(text.len());
            let end = (end..=text.len()).find(|i| text.is_char_boundary(*i)).unwrap_or(text.len());
            text.replace_range(start..end, PIECES[piece]);
        }
        if let Err(error) = load_text(&text) {
            prop_assert!(error.to_string().starts_with("tract.toml"));
        }
    }

    /// Numbers of any size in a well-formed file give a tract or an error, never a panic.
    #[test]
    fn law_any_points_never_panic(
        rows in prop::collection::vec(prop::array::uniform4(prop::num::f64::ANY), 2..8),
        scale in -12..3_i32,
    ) {
        let small = |v: f64| if v.is_finite() { (v.abs().log10() * 37.0).sin() * 10_f64.powi(scale) } else { v };
        for squash in [false, true] {
            let row = |r: &[f64; 4]| {
                let [x, y, z, radius] = r.map(|v| if squash { small(v) } else { v });
                format!("[{x:e}, {y:e}, {z:e}, {:e}]", radius.abs()).replace("NaN", "nan")
            };
            let rows: Vec<String> = rows.iter().map(row).collect();
            let text = format!(
                "[tract]\nframe = \"lps\"\n[[tract.segment]]\nname = \"ileum\"\npoints_m = [{}]\n", rows.join(", ")
            );
            if let Ok((tract, _)) = load_text(&text) {
                let station = tract.station(0.5 * tract.length_m());
                prop_assert!(station.normal.norm().is_finite() && station.position_m.coords.norm().is_finite());
            }
        }
    }
}
