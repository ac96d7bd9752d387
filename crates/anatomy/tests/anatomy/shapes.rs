//! Analytic shapes, the committed models, the mesh and the map.

use crate::{load_model, load_text, models};
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_anatomy::{End, SegmentKey, tube_mesh};
use lumenav_core::Node;
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

#[test]
fn closed_form_straight_tube() {
    let (tract, report) = load_model("straight-tube");
    assert!((tract.length_m() - 0.3).abs() < 1e-12);
    assert!((tract.station(0.1).position_m - Point3::new(0.0, 0.0, 0.05)).norm() < 1e-12);
    assert_eq!(tract.radius.with_slope(0.2), (0.0085, 0.0));
    assert_eq!(tract.ends, (End::Closed, End::Exit));
    assert_eq!(report.warnings, Vec::<String>::new());
}

#[test]
fn published_helix_of_than2015() {
    // Start (-57, 0, -45) mm, end (57, 0, 45) mm; 36 s at 5 mm/s around z and 2.5 mm/s along it.
    let (tract, _) = load_model("helix");
    let (start, end) = (tract.station(0.0), tract.station(tract.length_m()));
    assert!((start.position_m - Point3::new(-0.057, 0.0, -0.045)).norm() < 1e-12);
    assert!((end.position_m - Point3::new(0.057, 0.0, 0.045)).norm() < 1e-12);
    assert!((tract.length_m() - (PI * 0.057).hypot(0.09)).abs() < 1e-9);
    // 36 s at the resultant speed of hypot(5, 2.5) mm/s come to 201.2 mm; the thesis' speeds are rounded to half a per cent.
    assert!((tract.length_m() / (36.0 * 0.005_f64.hypot(0.0025)) - 1.0).abs() < 0.005);
    for i in 0..=100 {
        let position = tract.station(tract.length_m() * f64::from(i) / 100.0).position_m;
        assert!((position.x.hypot(position.y) - 0.057).abs() < 1e-8);
    }
}

#[test]
fn published_track_of_than2015() {
    let (tract, _) = load_model("than2015-track");
    let radii = [0.058, 0.056, 0.058];
    let exact: f64 = radii.iter().map(|radius| PI * radius).sum();
    assert!((tract.length_m() - exact).abs() < 2e-6, "{} not {exact}", tract.length_m());
    // Half circles lie in the YZ, XZ and YZ planes and keep their radius to 20 um, but for 6 mm about the joints.
    let mut start = 0.0;
    for (radius, (centre, flat)) in radii.iter().zip([
        (Point3::new(-0.056, -0.058, 0.0), 0),
        (Point3::new(0.0, 0.0, 0.0), 1),
        (Point3::new(0.056, 0.058, 0.0), 0),
    ]) {
        for i in 0..=50 {
            let s = start + 0.006 + (PI * radius - 0.012) * f64::from(i) / 50.0;
            let from_centre = tract.station(s).position_m - centre;
            assert!((from_centre.norm() - radius).abs() < 2e-5 && from_centre[flat].abs() < 2e-5, "at {s}");
        }
        start += PI * radius;
    }
}

#[test]
fn law_lps_is_ras_turned_half_about_z() {
    let text = |frame: &str| {
        format!(
            "[tract]\nframe = \"{frame}\"\n[[tract.segment]]\nname = \"ileum\"\n\
             points_mm = [[0, 10, 20, 8], [30, 15, 22, 9], [60, -5, 40, 8.5]]\n"
        )
    };
    let (ras, _) = load_text(&text("ras")).unwrap();
    let (lps, _) = load_text(&text("lps")).unwrap();
    for i in 0..=20 {
        let s = ras.length_m() * f64::from(i) / 20.0;
        let (a, b) = (ras.station(s).position_m, lps.station(s).position_m);
        assert!((Point3::new(-a.x, -a.y, a.z) - b).norm() < 1e-15);
    }
    assert!((ras.station(0.0).position_m - Point3::new(0.0, 0.01, 0.02)).norm() < 1e-15);
}

#[test]
fn law_selection_keeps_consecutive_segments_only() {
    let node = Node::open(&models().join("colon.toml")).unwrap();
    let (whole, _) = load(&node, &TractOptions::default()).unwrap();
    let keep = |keys: &[SegmentKey]| {
        load(&node, &TractOptions { segments: keys.to_vec(), ..TractOptions::default() })
    };
    let keys = [SegmentKey::Ascending, SegmentKey::Transverse, SegmentKey::Descending];
    let (part, _) = keep(&keys).unwrap();
    assert_eq!(part.segments.iter().map(|s| s.key).collect::<Vec<_>>(), keys);
    for segment in &part.segments {
        let same = whole.segment(segment.key).unwrap();
        assert!((same.length_m() - segment.length_m()).abs() < 1e-4);
        let (a, b) = (whole.station(same.start_m).position_m, part.station(segment.start_m).position_m);
        assert!((a - b).norm() < 1e-9);
    }
    assert_eq!(part.segment_at(0.0).key, SegmentKey::Ascending);
    assert_eq!(part.segment_at(f64::INFINITY).key, SegmentKey::Descending);
    let error = keep(&[SegmentKey::Ascending, SegmentKey::Descending]).unwrap_err().to_string();
    assert!(
        error.contains("`descending` does not follow `ascending`") && error.contains("caecum"),
        "{error}"
    );
    let error = keep(&[SegmentKey::Stomach]).unwrap_err().to_string();
    assert!(error.contains("no segment `stomach`") && error.contains("caecum, ascending"), "{error}");
}

#[test]
fn law_landmarks_stand_at_the_ends_of_segments() {
    let (tract, _) = load_model("colon");
    let names: Vec<&str> = tract.landmarks().iter().map(|landmark| landmark.name).collect();
    assert_eq!(
        names,
        [
            "ileocaecal_valve",
            "caecocolic_junction",
            "hepatic_flexure",
            "splenic_flexure",
            "descending_sigmoid_junction",
            "rectosigmoid_junction",
            "anus"
        ]
    );
    let radii = tract.radii(0.3);
    assert!(radii.contracted_m < radii.resting_m && radii.resting_m < radii.distended_m);
}

#[test]
fn closed_form_mesh_of_a_tube_is_closed_and_encloses_its_volume() {
    let (tract, _) = load_model("straight-tube");
    let sides = 48;
    let mesh = tube_mesh(&tract, 40, sides, |_, _| 0.01);
    assert_eq!(mesh.vertices_m.len(), 40 * sides + 2);
    assert_eq!(mesh.arc_length_m.len(), mesh.vertices_m.len());
    // Every edge is used once in each direction.
    let mut edges: Vec<[u32; 2]> =
        mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
    edges.sort_unstable();
    assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
    assert!(edges.iter().all(|edge| edges.binary_search(&[edge[1], edge[0]]).is_ok()));
    // The divergence theorem gives the volume of the prism, positive when normals point outwards.
    let corner = |i: u32| Vector3::from(mesh.vertices_m[i as usize].map(f64::from));
    let volume: f64 =
        mesh.triangles.iter().map(|t| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2]))) / 6.0).sum();
    let area = 0.5 * sides as f64 * 0.01_f64.powi(2) * (2.0 * PI / sides as f64).sin();
    assert!((volume / (0.3 * area) - 1.0).abs() < 1e-5, "volume {volume}");
}
