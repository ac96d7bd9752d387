//! Array and capsule files: what they build, and what is refused with file, line and key.

use super::support::*;
use lumenav_core::Node;
use lumenav_magnetic::array::{Axes, SensorArray};
use lumenav_magnetic::config::Magnet;
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;
use std::path::Path;

const HEAD: &str = "[array]\nname = \"a\"\nsource = \"test\"\nnoise_tesla = 1e-8\n";

fn array(body: &str) -> SensorArray {
    SensorArray::from_node(&node(&format!("{HEAD}{body}"))).unwrap()
}

fn refused(text: &str) -> String {
    match Node::parse_text(text, "array.toml", Path::new(""), &[])
        .and_then(|node| SensorArray::from_node(&node))
    {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.to_string(),
    }
}

fn places(array: &SensorArray) -> Vec<Vector3<f64>> {
    array.sensors.iter().map(|s| s.pose.translation.vector).collect()
}

fn same(ours: &[Vector3<f64>], expected: &[[f64; 3]]) {
    assert_eq!(ours.len(), expected.len());
    for (a, b) in ours.iter().zip(expected) {
        assert!((a - Vector3::from(*b)).norm() < 1e-15, "{a:?} is not {b:?}");
    }
}

#[test]
fn law_every_shipped_array_loads() {
    let counts = [
        ("belt-16", 48),
        ("cube", 192),
        ("patch-16", 48),
        ("plane-4x4", 48),
        ("plane-4x4-below", 48),
        ("two-planes", 96),
    ];
    let mut seen = 0;
    for entry in std::fs::read_dir(models().join("sensor-arrays")).unwrap() {
        let path = entry.unwrap().path();
        let array = SensorArray::from_node(&Node::open(&path).unwrap()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(Some(array.name.as_str()), path.file_stem().and_then(|s| s.to_str()));
        if let Some((_, count)) = counts.iter().find(|(name, _)| *name == array.name) {
            assert_eq!(array.labels().len(), *count, "{}", array.name);
            seen += 1;
        }
        assert_eq!(array.labels().len(), array.channels(&Isometry3::identity()).len());
        assert_eq!(array.labels().len(), array.channel_axes().len());
    }
    assert_eq!(seen, counts.len());
}

#[test]
fn closed_form_plane() {
    let plane = "[[plane]]\ncentre_mm = [10, 0, 5]\nalong = [0, 3, 0]\nacross = [0, 0, -2]\ncolumns = 3\nrows = 2\nwidth_mm = 200\nheight_mm = 100\n";
    let low = 0.005 + 0.05;
    let high = 0.005 - 0.05;
    same(
        &places(&array(plane)),
        &[
            [0.01, -0.1, low],
            [0.01, 0.0, low],
            [0.01, 0.1, low],
            [0.01, -0.1, high],
            [0.01, 0.0, high],
            [0.01, 0.1, high],
        ],
    );
}

#[test]
fn closed_form_checkerboard_halves_are_disjoint_and_complete() {
    let plane = "[[plane]]\ncentre_mm = [0, 0, 0]\nalong = [1, 0, 0]\nacross = [0, 1, 0]\ncolumns = 4\nrows = 3\nwidth_mm = 300\nheight_mm = 200\n";
    let half = |n: u32| places(&array(&format!("{plane}checkerboard = {n}\n")));
    let whole = places(&array(plane));
    let (zero, one) = (half(0), half(1));
    assert_eq!((zero.len(), one.len()), (6, 6));
    for place in whole {
        assert_ne!(zero.contains(&place), one.contains(&place), "{place:?}");
    }
    assert!((zero[0] - Vector3::new(-0.15, -0.1, 0.0)).norm() < 1e-15);
}

#[test]
fn closed_form_line_and_single_points() {
    same(
        &places(&array("[[line]]\nfrom_mm = [0, 0, 0]\nto_mm = [30, 60, 0]\ncount = 4\n")),
        &[[0.0, 0.0, 0.0], [0.01, 0.02, 0.0], [0.02, 0.04, 0.0], [0.03, 0.06, 0.0]],
    );
    same(
        &places(&array("[[line]]\nfrom_mm = [0, 0, 0]\nto_mm = [30, 60, 0]\ncount = 1\n")),
        &[[0.015, 0.03, 0.0]],
    );
}

#[test]
fn closed_form_ring() {
    let ring = "[[ring]]\ncentre_mm = [0, 0, 40]\nsemi_axis_x_mm = 200\nsemi_axis_y_mm = 100\ncount = 4\nfirst_angle_deg = 90\n";
    same(&places(&array(ring)), &[[0.0, 0.1, 0.04], [-0.2, 0.0, 0.04], [0.0, -0.1, 0.04], [0.2, 0.0, 0.04]]);
}

#[test]
fn closed_form_single_sensors_turn_and_read_their_axes() {
    let text = "[[sensor]]\nposition_mm = [10, 20, 30]\nrotation_vector_deg = [0, 0, 90]\n\
                [[sensor]]\nposition_mm = [0, 0, 0]\naxes = \"z\"\n";
    let array = array(text);
    assert_eq!(array.labels(), ["s0x_T", "s0y_T", "s0z_T", "s1z_T"]);
    assert_eq!(array.channel_axes(), [(0, 0), (0, 1), (0, 2), (1, 2)]);
    assert_eq!(array.sensors[1].axes, Axes::Z);
    let channels = array.channels(&Isometry3::identity());
    let axes: Vec<Vector3<f64>> = channels.channels.iter().map(|c| c.axis_world).collect();
    for (axis, expected) in axes.iter().zip([Vector3::y(), -Vector3::x(), Vector3::z(), Vector3::z()]) {
        assert!((axis - expected).norm() < 1e-15);
    }
}

#[test]
fn closed_form_the_start_follows_the_array() {
    let file = array("[[sensor]]\nposition_mm = [0, 0, 0]\n");
    let moved = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
    let given = SensorArray::from_node(&node(&format!(
        "{HEAD}start_positions_mm = [[100, 0, 0]]\n[[sensor]]\nposition_mm = [0, 0, 0]\n"
    )))
    .unwrap();
    let start = given.start_positions_m(&given.channels(&moved), &moved)[0];
    assert!((start - Vector3::new(1.0, 2.1, 3.0)).norm() < 1e-15);
    assert_eq!(file.start_positions_m(&file.channels(&moved), &moved)[0], Vector3::new(1.0, 2.0, 3.0));
    // The rule for a flat array: 0.2 m above and below the reference grid.
    let plane = grid(4);
    let mut starts = plane.start_positions_m(&plane.channels(&Isometry3::identity()), &Isometry3::identity());
    starts.sort_by(|a, b| a.z.total_cmp(&b.z));
    assert!((starts[0].z + 0.2).abs() < 2e-4 && (starts[1].z - 0.2).abs() < 2e-4, "{starts:?}");
}

#[test]
fn law_errors_name_file_line_and_key() {
    let plane = |change: (&str, &str)| {
        let text = "[[plane]]\ncentre_mm = [0, 0, 0]\nalong = [1, 0, 0]\nacross = [0, 1, 0]\ncolumns = 2\nrows = 2\nwidth_mm = 10\nheight_mm = 10\n";
        format!("{HEAD}{}", text.replace(change.0, change.1))
    };
    for (text, wanted) in [
        (plane(("columns = 2", "colums = 2")), "array.toml:9:1: `plane.[0].colums`: unknown field"),
        (plane(("width_mm = 10", "width_mm = nan")), "array.toml:11:12: `plane.[0].width_mm`"),
        (
            plane(("along = [1, 0, 0]", "along = [0, 0, 0]")),
            "array.toml:7:9: `plane[0].along`: a direction of length zero",
        ),
        (plane(("across = [0, 1, 0]", "across = [0.0, 0, 0]")), "array.toml:8:10: `plane[0].across`"),
        (plane(("columns = 2", "columns = 0")), "array.toml:5:1: `plane[0]`: 0 sensors"),
        (plane(("columns = 2", "columns = 4000000000")), "`plane[0]`: 4294967295 sensors"),
        (plane(("rows = 2", "rows = 2\ncheckerboard = 2")), "array.toml:11:16: `plane[0].checkerboard`"),
        (plane(("centre_mm = [0, 0, 0]", "centre_mm = [1e9, 0, 0]")), "more than 100 m"),
        (format!("{HEAD}[[lines]]\n"), "array.toml:5:3: `lines`: unknown field"),
        (HEAD.to_owned(), "no sensors"),
        (HEAD.replace("1e-8", "0"), "array.toml:4:15: `array.noise_tesla`"),
        ("[[sensor]]\nposition_mm = [0, 0, 0]\n".to_owned(), "missing field `array`"),
        (format!("{HEAD}sensor = 3\n"), "`array.sensor`"),
        (
            format!("{HEAD}[[sensor]]\nposition_mm = [1, 0, 0]\n[[sensor]]\nposition_mm = [1, 0, 0]\n"),
            "array.toml:7:1: `sensor[1]`: sensors 0 and 1 stand at the same place",
        ),
    ] {
        let error = refused(&text);
        assert!(error.starts_with("array.toml:"), "{error}");
        assert!(error.contains(wanted), "{error}\nwanted: {wanted}");
    }
    // Single-axis sensors may share a place, and a description allows triads to.
    array(
        "[[sensor]]\nposition_mm = [1, 0, 0]\naxes = \"x\"\n[[sensor]]\nposition_mm = [1, 0, 0]\naxes = \"y\"\n",
    );
    let described = HEAD.replace("source", "description = \"twice, to halve the noise\"\nsource");
    SensorArray::from_node(&node(&format!(
        "{described}[[sensor]]\nposition_mm = [1, 0, 0]\n[[sensor]]\nposition_mm = [1, 0, 0]\n"
    )))
    .unwrap();
}

#[test]
fn law_ten_thousand_sensors_are_the_limit_also_in_many_tables() {
    let line = "[[line]]\nfrom_mm = [0, 0, 0]\nto_mm = [30, 60, 0]\ncount = 9000\n";
    let error = refused(&format!("{HEAD}{line}{}", line.replace("30, 60, 0", "0, 0, 70")));
    assert!(error.contains("more than 10000 sensors"), "{error}");
}

/// A text with some of its bytes replaced, doubled or cut, as a slip of an editor would.
fn mutated(text: &'static str) -> impl Strategy<Value = String> {
    let edit = (
        0..text.len(),
        0..4_u8,
        prop::sample::select(vec![
            "nan",
            "-1",
            "1e308",
            "0",
            "inf",
            "\"",
            "[",
            "]",
            "=",
            "\n",
            "x",
            ",",
            "\u{b5}",
            "9999999999999",
            "[[plane]]\n",
            "#",
            " ",
            "-",
        ]),
    );
    prop::collection::vec(edit, 1..5).prop_map(move |edits| {
        let mut bytes: Vec<char> = text.chars().collect();
        for (at, kind, with) in edits {
            let at = at.min(bytes.len());
            match kind {
                0 => bytes.truncate(at),
                1 => drop(bytes.splice(at..at, with.chars())),
                2 => drop(bytes.splice(at..(at + 3).min(bytes.len()), with.chars())),
                _ => {
                    let line: Vec<char> = bytes[at..].iter().copied().take_while(|c| *c != '\n').collect();
                    bytes.splice(at..at, line);
                }
            }
        }
        bytes.into_iter().collect()
    })
}

/// Found by the property test below.
#[test]
fn regress_a_rotation_that_overflows_is_refused() {
    let text = "[array]\nname = \"a\"\nsource = \"\"\nnoise_tesla = 1e-8\n[[sensor]]\nposition_mm = [1, 2, 3]\n\
                rotation_vector_deg = [10, 1e308, 30]\n";
    let error = SensorArray::from_node(&node(text)).unwrap_err().to_string();
    assert!(error.contains("rotation_vector_deg") && error.contains("too large"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: Some(Box::new(WithSource("regressions"))), ..ProptestConfig::default() })]

    #[test]
    fn law_no_array_file_panics_and_every_error_has_a_place(text in prop_oneof![
        mutated(include_str!("../../../../../models/sensor-arrays/belt-16.toml")),
        mutated(include_str!("../../../../../models/sensor-arrays/plane-4x4.toml")),
        mutated(include_str!("../../../../../models/sensor-arrays/patch-16.toml")),
        mutated("[array]\nname = \"a\"\nsource = \"\"\nnoise_tesla = 1e-8\naxes = \"z\"\n[[sensor]]\nposition_mm = [1, 2, 3]\nrotation_vector_deg = [10, 20, 30]\naxes = \"x\"\n[[sensor]]\nposition_mm = [4, 5, 6]\n"),
    ]) {
        match Node::parse_text(&text, "array.toml", Path::new(""), &[]).and_then(|node| SensorArray::from_node(&node)) {
            Err(error) => prop_assert!(error.to_string().starts_with("array.toml:"), "{error}\n{text}"),
            Ok(array) => {
                let channels = array.channels(&Isometry3::identity());
                prop_assert!(channels.positions_world_m.iter().all(|p| p.iter().all(|v| v.is_finite())));
                prop_assert!(channels.channels.iter().all(|c| (c.axis_world.norm() - 1.0).abs() < 1e-9));
                let starts = array.start_positions_m(&channels, &Isometry3::identity());
                prop_assert!(starts.iter().all(|p| p.iter().all(|v| v.is_finite())));
            }
        }
    }

    #[test]
    fn law_no_capsule_file_panics_and_every_error_has_a_place(
        text in mutated(include_str!("../../../../../models/capsules/pillcam-magnet.toml")),
    ) {
        let mut setup = setup([0.0; 3]);
        match Node::parse_text(&text, "capsule.toml", Path::new(""), &[]) {
            Err(error) => prop_assert!(error.to_string().starts_with("capsule.toml:"), "{error}"),
            Ok(node) => {
                setup.capsule_model = node;
                match Magnet::from_capsule(&setup) {
                    Err(error) => prop_assert!(error.to_string().starts_with("capsule.toml:"), "{error}"),
                    Ok(magnet) => prop_assert!(magnet.cylinder.strength_t_m3().is_finite()),
                }
            }
        }
    }
}
