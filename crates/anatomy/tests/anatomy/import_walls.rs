//! Import of surfaces that show walls with a thickness: pipes of known shape, whole, over a stretch, and with a blind stretch.

use super::imports::{
    BEND_M, Mesh, SIDES, deviation, import, imported, open_tube, refusal, straight, three_quarters, tube,
};
use lumenav_anatomy::import::{ImportOptions, ImportedTract, Progress, RepairKind, import_surface};
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};

const OUTER_M: f64 = 0.010;
const LUMEN_M: f64 = 0.007;

type Curve = fn(f64) -> (Point3<f64>, Vector3<f64>);

/// Triangles between a ring of corners and another with as many, from their first indices.
fn ring(mesh: &mut Mesh, outer: usize, inner: usize) {
    for side in 0..SIDES {
        let next = (side + 1) % SIDES;
        let [a, b, c, d] = [outer + side, outer + next, inner + side, inner + next].map(|v| v as u32);
        mesh.triangles.extend([[a, c, b], [b, c, d]]);
    }
}

/// A tube of so many rings of so many corners, its ends open: 2 n (n - 1) triangles.
fn fine_tube(count: usize) -> Mesh {
    let mut mesh = Mesh::default();
    for (ring, side) in (0..count).flat_map(|ring| (0..count).map(move |side| (ring, side))) {
        let centre = straight(ring as f64 / (count - 1) as f64).0;
        let angle = TAU * side as f64 / count as f64;
        mesh.vertices.push(centre + Vector3::new(angle.cos(), 0.0, angle.sin()) * 0.008);
    }
    let at = |ring: usize, side: usize| (ring * count + side % count) as u32;
    for (ring, side) in (0..count - 1).flat_map(|ring| (0..count).map(move |side| (ring, side))) {
        let [a, b, c, d] = [at(ring, side), at(ring, side + 1), at(ring + 1, side), at(ring + 1, side + 1)];
        mesh.triangles.extend([[a, b, c], [b, d, c]]);
    }
    mesh
}

fn check_fine(count: usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fine.stl");
    std::fs::write(&path, fine_tube(count).stl()).unwrap();
    let mut told: Vec<Progress> = Vec::new();
    let start = std::time::Instant::now();
    let tract =
        import_surface(&path, &ImportOptions::default(), &mut |progress| told.push(progress)).unwrap();
    println!("{} triangles in {:.1} s", tract.triangles, start.elapsed().as_secs_f64());
    assert_eq!(tract.triangles, 2 * count * (count - 1));
    let (away_mm, radius_mm) = deviation(&tract, 0.008, 0.0, straight);
    assert!(
        (tract.length_m - 0.2).abs() < 0.5e-3 && away_mm < 0.1 && radius_mm < 0.05,
        "{away_mm} {radius_mm}"
    );
    let stages: Vec<&str> = told.chunk_by(|a, b| a.stage == b.stage).map(|same| same[0].stage).collect();
    assert_eq!(stages, ["reading", "repairing", "voxels", "clearance", "way", "centre line", "contacts"]);
    for same in told.chunk_by(|a, b| a.stage == b.stage) {
        assert!(same.is_sorted_by(|a, b| a.done <= b.done && b.done <= 1.0), "{same:?}");
    }
}

#[test]
fn closed_form_a_fine_mesh_with_progress() {
    check_fine(250);
}

#[test]
#[ignore = "two million triangles take a minute: cargo test --release -- --ignored two_million"]
fn closed_form_two_million_triangles_with_progress() {
    check_fine(1000);
}

/// A wall around a curve: outer and inner face of one component, joined by rings at both ends.
fn pipe(rings: usize, curve: Curve) -> Mesh {
    let outer = open_tube(rings, OUTER_M, curve);
    let shift = outer.vertices.len();
    let mut mesh = outer.with(&open_tube(rings, LUMEN_M, curve));
    ring(&mut mesh, 0, shift);
    let last = (rings - 1) * SIDES;
    ring(&mut mesh, last, shift + last);
    mesh
}

fn kinds(tract: &ImportedTract, kind: RepairKind) -> Vec<&lumenav_anatomy::import::Repair> {
    tract.repairs.iter().filter(|repair| repair.kind == kind).collect()
}

#[test]
fn closed_form_of_a_pipe_the_lumen_is_imported() {
    let tract = imported(&pipe(181, three_quarters));
    tract.repairs.iter().for_each(|repair| println!("{repair}"));
    let (away_mm, radius_mm) = deviation(&tract, LUMEN_M, 0.01, three_quarters);
    println!("length {} m, line {away_mm} mm, radius {radius_mm} mm", tract.length_m);
    assert!(away_mm < 0.5 && radius_mm < 0.1, "{away_mm} {radius_mm}");
    // At the rings a few millimetres of the outer face stay and are closed across.
    assert!((tract.length_m / (1.5 * PI * BEND_M) - 1.0).abs() < 0.03, "{}", tract.length_m);
    let walls = kinds(&tract, RepairKind::ThickWall);
    assert_eq!(walls.len(), 1, "{:?}", tract.repairs);
    assert!((walls[0].size_m - (OUTER_M - LUMEN_M)).abs() < 2e-4, "{}", walls[0].size_m);
}

/// The first part of the straight tube, as long as `to`.
fn first_part(to: f64) -> impl Fn(f64) -> (Point3<f64>, Vector3<f64>) {
    move |t| straight(t * to)
}

#[test]
fn law_a_wall_over_a_stretch_opens_into_the_lumen_behind_it() {
    // An inner face along the first half only; at its end it stands open within the tube.
    let outer = open_tube(101, OUTER_M, straight);
    let shift = outer.vertices.len();
    let mut mesh = outer.with(&open_tube(51, LUMEN_M, first_part(0.5)));
    ring(&mut mesh, 0, shift);
    let tract = imported(&mesh);
    tract.repairs.iter().for_each(|repair| println!("{repair}"));
    let (away_mm, _) = deviation(&tract, LUMEN_M, 0.0, straight);
    assert!(away_mm < 0.3 && (tract.length_m - 0.2).abs() < 0.006, "{away_mm} mm, {} m", tract.length_m);
    assert_eq!(kinds(&tract, RepairKind::ThickWall).len(), 1);
    let radius_m = |part: f64| tract.stations[(part * tract.stations.len() as f64) as usize].radius_m;
    // Which end is oral is not known: y is not z.
    let (first, second) = (radius_m(0.25), radius_m(0.75));
    assert!((first.min(second) - LUMEN_M).abs() < 1e-4, "{first} {second}");
    assert!((first.max(second) - OUTER_M).abs() < 1e-4, "{first} {second}");
}

#[test]
fn law_a_blind_stretch_of_a_wall_is_bridged_and_listed() {
    // Inner faces from both ends, closed 46 mm apart: tissue between them.
    let outer = open_tube(101, OUTER_M, straight);
    let mut mesh = outer;
    for (from, to) in [(0.0, 0.385), (1.0, 0.615)] {
        let inner = open_tube(44, LUMEN_M, |t| straight(from + (to - from) * t));
        let shift = mesh.vertices.len();
        mesh = mesh.with(&inner);
        ring(&mut mesh, if from == 0.0 { 0 } else { 100 * SIDES }, shift);
        let tip = mesh.vertices.len() as u32;
        mesh.vertices.push(straight(to).0);
        for side in 0..SIDES {
            let last = shift + 43 * SIDES;
            mesh.triangles.push([(last + side) as u32, (last + (side + 1) % SIDES) as u32, tip]);
        }
    }
    let tract = imported(&mesh);
    tract.repairs.iter().for_each(|repair| println!("{repair}"));
    let (away_mm, _) = deviation(&tract, LUMEN_M, 0.0, straight);
    println!("{} m, line {away_mm} mm", tract.length_m);
    assert!(away_mm < 2.5, "{away_mm} mm");
    // At the rings a few millimetres of the outer face stay and are closed across.
    assert!((tract.length_m - 0.2).abs() < 0.01, "{}", tract.length_m);
    let joints = kinds(&tract, RepairKind::Parts);
    // Both blind ends look at the solid stretch between them.
    assert_eq!(joints.len(), 2);
    for joint in joints {
        assert!((joint.at_m.y.abs() - 0.023).abs() < 0.003, "{}", joint.at_m);
    }
}

#[test]
fn law_closed_pieces_are_joined_where_their_ends_face_each_other_and_not_beside() {
    let piece = |from: f64, to: f64| tube(51, 0.008, move |t| straight(from + (to - from) * t));
    // 8 mm between two flat ends.
    let tract = imported(&piece(0.0, 0.48).with(&piece(0.52, 1.0)));
    let (away_mm, radius_mm) = deviation(&tract, 0.008, 0.0, straight);
    // Ends are found in corners, so the line comes to the joint from beside the middle.
    assert!(away_mm < 1.5 && radius_mm < 0.1, "{away_mm} mm, {radius_mm} mm");
    assert!((tract.length_m - 0.2).abs() < 0.002, "{}", tract.length_m);
    let joints = kinds(&tract, RepairKind::Parts);
    assert_eq!(joints.len(), 1);
    assert!((joints[0].at_m - straight(0.5).0).norm() < 0.002, "{}", joints[0].at_m);
    // Side by side, 1 mm between the walls: their ends do not look at each other. And too far apart.
    let beside = tube(101, 0.008, |t| (straight(t).0 + Vector3::new(0.017, 0.0, 0.0), Vector3::y()));
    assert!(refusal("beside.stl", &tube(101, 0.008, straight).with(&beside).stl()).contains("2 parts"));
    assert!(refusal("far.stl", &piece(0.0, 0.4).with(&piece(0.6, 1.0)).stl()).contains("2 parts"));
}

#[test]
fn law_a_window_between_loops_is_no_short_cut() {
    // A hairpin of 120 mm legs, 1 mm apart, and a hole of 5 mm in both walls half way, joined: a handle.
    let (radius, gap) = (0.008, 0.001);
    let curve = super::imports::hairpin(radius, gap);
    let centre = Point3::new(0.0, 0.03, 0.0);
    let mesh = tube(241, radius, &curve)
        .without(|t| t.iter().all(|p| (p - centre).norm() < 0.0035 && p.x.abs() < 0.003));
    let tract = import("handle.stl", &mesh.stl(), &ImportOptions::default()).unwrap();
    tract.repairs.iter().for_each(|repair| println!("{repair}"));
    let length_m = 0.24 + PI * (radius + 0.5 * gap);
    assert!((tract.length_m / length_m - 1.0).abs() < 0.04, "{} of {length_m}", tract.length_m);
    assert!(tract.self_contacts.iter().any(|contact| contact.is_fused), "{:?}", tract.self_contacts);
}

#[test]
fn closed_form_a_double_wall_centres_the_line_and_leads_it_on_where_the_inner_face_ends() {
    // An inner face 1.5 mm beside the axis, from 4 mm behind the one end to 40 mm before the other.
    let beside = |t: f64| (straight(0.02 + 0.78 * t).0 + Vector3::new(0.0015, 0.0, 0.0), Vector3::y());
    let mesh = tube(101, OUTER_M, straight).with(&tube(81, 0.0075, beside));
    let tract = imported(&mesh);
    tract.repairs.iter().for_each(|repair| println!("{repair}"));
    assert_eq!(kinds(&tract, RepairKind::OuterWall).len(), 1);
    let led_on = kinds(&tract, RepairKind::OuterFace);
    assert_eq!(led_on.len(), 1, "{:?}", tract.repairs);
    assert!((led_on[0].at_m - straight(0.8).0).norm() < 0.008, "{}", led_on[0].at_m);
    assert!((tract.length_m - 0.196).abs() < 0.006, "{} m", tract.length_m);
    let away_mm = |p: &Point3<f64>| 1e3 * (p.x - 0.01).hypot(p.z - 0.03);
    // Far from both ends, where the line comes from corners.
    let middle: Vec<f64> =
        tract.stations.iter().filter(|s| s.point_m.y.abs() < 0.06).map(|s| away_mm(&s.point_m)).collect();
    let worst_mm = middle.iter().copied().fold(0.0, f64::max);
    println!("{} m, {worst_mm} mm beside the axis", tract.length_m);
    assert!(middle.len() > 20 && worst_mm < 0.3, "{worst_mm} mm");
}
