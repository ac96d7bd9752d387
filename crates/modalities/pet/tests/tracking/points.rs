//! Independent points: one and two particles between two plates, none, too close ones, and recorded data.

use super::support::{Ends, Generator, noise_of_law, scanner, scintillator, set};
use lumenav_pet::simulation::EndPoints;
use lumenav_pet::tracking::{BlockErrors, BlockNoise, Failure, Points, Role, TrackedPoint};
use lumenav_pet::{Line, Scanner};
use nalgebra::{Isometry3, Vector3};

const PLACES_MM: [[f64; 3]; 2] = [[-70.0, 20.0, 10.0], [90.0, -30.0, -40.0]];

struct Bench {
    scanner: Scanner,
    law: BlockNoise,
}

fn bench() -> Bench {
    let scanner = scanner("adac-forte");
    let law = BlockErrors::of_block(&scanner, &scintillator(&scanner), EndPoints::Crystal).law;
    Bench { scanner, law }
}

impl Bench {
    fn points(&self, count: usize) -> Points {
        Points::new(count, noise_of_law(&self.scanner, &self.law))
    }

    fn generator(&self, places_mm: &[[f64; 3]], seed: u64) -> Generator {
        Generator::new(self.scanner.clone(), Ends::Law(self.law), set(places_mm), seed)
    }
}

fn still(_: f64) -> Isometry3<f64> {
    Isometry3::identity()
}

#[test]
fn law_points_are_placed_without_bias_and_with_a_covariance_that_fits() {
    let bench = bench();
    for count in [1, 2] {
        let places = &PLACES_MM[..count];
        let mut points = bench.points(count);
        let mut generator = bench.generator(places, 21);
        let (mut sums, mut nees, mut windows) = ([Vector3::zeros(); 2], 0.0, 0.0);
        for w in 0..150 {
            let (lines, origins) = generator.window(&still, 0.05 * f64::from(w), 60 * count, 60);
            let (found, roles) = points.track(&lines);
            for (k, place) in places.iter().enumerate() {
                let point = found[k].as_ref().unwrap_or_else(|why| panic!("window {w}, point {k}: {why}"));
                let error = point.position_world_m - Vector3::from(*place) * 1e-3;
                assert!(error.norm() < 12e-3, "window {w}, point {k}: {error}");
                sums[k] += error;
                nees += error.dot(&(point.covariance_m2.try_inverse().unwrap() * error)) / 3.0;
            }
            windows += 1.0;
            // Roles agree with what the lines are, but where noise puts a line beyond reach or background within it.
            let agree = roles
                .iter()
                .zip(&origins)
                .filter(|(role, origin)| **role == origin.map_or(Role::Background, |m| Role::Marker(m as u8)))
                .count();
            assert!(agree * 10 > 8 * lines.len(), "{agree} of {}", lines.len());
        }
        let mean_nees = nees / (windows * count as f64);
        println!("figure: {count} points: NEES/dof {mean_nees:.3}");
        assert!((0.8..1.25).contains(&mean_nees), "{mean_nees}");
        for sum in &sums[..count] {
            let bias_mm = sum * (1e3 / windows);
            assert!(bias_mm.xy().norm() < 0.15 && bias_mm.z.abs() < 0.4, "{bias_mm}");
        }
    }
}

#[test]
fn law_points_are_numbered_by_place_whatever_the_order_of_the_lines() {
    let bench = bench();
    let reversed = [PLACES_MM[1], PLACES_MM[0]];
    for places in [&PLACES_MM, &reversed] {
        let (mut lines, _) = bench.generator(places, 4).window(&still, 0.0, 120, 60);
        lines.reverse();
        let (found, _) = bench.points(2).track(&lines);
        let x: Vec<f64> = found.iter().flatten().map(|p| p.position_world_m.x).collect();
        assert!(x.len() == 2 && x[0] < 0.0 && x[1] > 0.0, "{x:?}");
    }
}

#[test]
fn law_a_point_that_jumps_is_found_again_in_the_next_window() {
    let bench = bench();
    let mut points = bench.points(1);
    let mut generator = bench.generator(&PLACES_MM[..1], 8);
    for (w, at_m) in [0.0, 0.0, 0.15, 0.15, -0.05].into_iter().enumerate() {
        let motion = |_: f64| Isometry3::translation(at_m, 0.0, 0.0);
        let (lines, _) = generator.window(&motion, 0.05 * w as f64, 100, 60);
        let (found, _) = points.track(&lines);
        let place = found[0].as_ref().unwrap().position_world_m;
        assert!((place - Vector3::new(at_m - 0.07, 0.02, 0.01)).norm() < 0.008, "window {w}: {place}");
    }
}

#[test]
fn law_what_is_no_point_is_not_answered_with_one() {
    let bench = bench();
    let mut generator = bench.generator(&PLACES_MM[..1], 5);
    for w in 0..20 {
        let (background, _) = generator.window(&still, 0.05 * f64::from(w), 0, 200);
        let (found, _) = bench.points(1).track(&background);
        assert!(found[0].is_err(), "window {w}: {found:?}");
    }
    let (few, _) = generator.window(&still, 0.0, 2, 0);
    assert!(bench.points(1).track(&few).0[0].is_err());
    let parallel: Vec<Line> = (0..1000)
        .map(|i| {
            let across = Vector3::new(f64::from(i % 40) * 1e-3, f64::from(i / 40) * 1e-3, 0.0);
            let along = Vector3::z() * 0.356;
            Line { t_s: 0.0, ends_world_m: [across - along, across + along] }
        })
        .collect();
    assert!(bench.points(2).track(&parallel).0.iter().all(Result::is_err));
    assert!(bench.points(2).track(&[]).0.iter().all(Result::is_err));
    // Two sources 20 mm apart: one is refused, and it is said why.
    let (lines, _) = bench.generator(&[[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]], 6).window(&still, 0.0, 200, 40);
    let (found, _) = bench.points(2).track(&lines);
    assert!(found.iter().any(|p| matches!(p, Err(Failure::TooClose { .. }))), "{found:?}");
}

#[test]
fn law_memory_goes_on_where_it_was() {
    let bench = bench();
    let mut generator = bench.generator(&PLACES_MM, 7);
    let mut first = bench.points(2);
    let (lines, _) = generator.window(&still, 0.0, 120, 60);
    first.track(&lines);
    let mut second = bench.points(2);
    second.recall(first.memory());
    let (lines, _) = generator.window(&still, 0.05, 120, 60);
    assert_eq!(first.track(&lines).0, second.track(&lines).0);
}

#[test]
fn law_points_that_were_lost_keep_their_numbers_wherever_they_come_back() {
    let bench = bench();
    let mut generator = bench.generator(&PLACES_MM, 31);
    let mut alone = [bench.generator(&PLACES_MM[..1], 32), bench.generator(&PLACES_MM[1..], 33)];
    let mut background = bench.generator(&PLACES_MM[..1], 34);
    let mut points = bench.points(2);
    let mut w = 0;
    let mut next = |generator: &mut Generator, x_m: f64, marked: usize| {
        w += 1;
        let motion = |_: f64| Isometry3::translation(x_m, 0.0, 0.0);
        points.track(&generator.window(&motion, 0.05 * f64::from(w), marked, 60).0).0
    };
    let is_at = |found: &Result<TrackedPoint, Failure>, place: [f64; 3], x_m: f64| {
        let place = Vector3::from(place) * 1e-3 + Vector3::x() * x_m;
        found.as_ref().is_ok_and(|point| (point.position_world_m - place).norm() < 8e-3)
    };
    // One alone, before both were seen: it could be either.
    let first = next(&mut alone[1], 0.0, 100);
    assert_eq!(first[0], Err(Failure::Unnumbered { found: 1, points: 2 }));
    assert!(first[1].is_err());
    let both = next(&mut generator, 0.0, 160);
    assert!(is_at(&both[0], PLACES_MM[0], 0.0) && is_at(&both[1], PLACES_MM[1], 0.0), "{both:?}");
    for which in [1, 0] {
        // Both lost; then one is seen, later the other as well, 40 mm further on.
        assert!(next(&mut background, 0.0, 0).iter().all(Result::is_err));
        let seen = next(&mut alone[which], 0.0, 100);
        assert!(is_at(&seen[which], PLACES_MM[which], 0.0) && seen[1 - which].is_err(), "{seen:?}");
        assert!(next(&mut background, 0.0, 0).iter().all(Result::is_err));
        let further = next(&mut generator, 0.04, 160);
        assert!(
            is_at(&further[0], PLACES_MM[0], 0.04) && is_at(&further[1], PLACES_MM[1], 0.04),
            "{further:?}"
        );
        // Back to where they were, while nothing was seen.
        assert!(next(&mut background, 0.0, 0).iter().all(Result::is_err));
        let back = next(&mut generator, 0.0, 160);
        assert!(is_at(&back[0], PLACES_MM[0], 0.0) && is_at(&back[1], PLACES_MM[1], 0.0), "{back:?}");
    }
}

#[test]
fn law_a_point_that_comes_back_alone_somewhere_between_waits_for_the_other() {
    let bench = bench();
    let mut points = bench.points(2);
    let mut seed = 40;
    let mut next = |places_mm: &[[f64; 3]]| {
        seed += 1;
        let mut generator = bench.generator(if places_mm.is_empty() { &PLACES_MM } else { places_mm }, seed);
        let marked = 80 * places_mm.len();
        points.track(&generator.window(&still, 0.05 * seed as f64, marked, 60).0).0
    };
    let x_mm = |found: &Result<TrackedPoint, Failure>| {
        found.as_ref().map_or(f64::NAN, |point| 1e3 * point.position_world_m.x)
    };
    assert!(next(&PLACES_MM).iter().all(Result::is_ok));
    assert!(next(&[]).iter().all(Result::is_err));
    // The second, 90 mm on its way, stands nearer to where the first was.
    let between = [0.0, -30.0, -40.0];
    let alone = next(&[between]);
    assert!(alone.contains(&Err(Failure::Unnumbered { found: 1, points: 2 })), "{alone:?}");
    assert!(alone.iter().all(Result::is_err), "{alone:?}");
    let both = next(&[between, [-120.0, 20.0, 10.0]]);
    let [first, second] = [&both[0], &both[1]].map(x_mm);
    assert!((first + 120.0).abs() < 8.0 && second.abs() < 8.0, "{both:?}");
    // Lost the longer, gone the further: the first was seen until now, the second has had eight windows.
    for _ in 0..8 {
        assert!(next(&[[-120.0, 20.0, 10.0]])[0].is_ok());
    }
    assert!(next(&[]).iter().all(Result::is_err));
    let alone = next(&[[-55.0, -30.0, -40.0]]);
    assert!(alone[0].is_err() && (x_mm(&alone[1]) + 55.0).abs() < 8.0, "{alone:?}");
}

#[test]
fn law_a_point_that_is_searched_for_does_not_evict_one_that_is_followed() {
    let bench = bench();
    let mut points = bench.points(2);
    let (first, second) = ([0.0, 0.0, 0.0], [62.0, 0.0, 0.0]);
    let windows: [(&[[f64; 3]], [bool; 2]); 3] = [
        (&[first, second], [true, true]),
        (&[first], [true, false]),
        // Back where it was, while the first has come 5 mm nearer: too close.
        (&[[5.0, 0.0, 0.0], second], [true, false]),
    ];
    for (w, (places_mm, answered)) in windows.into_iter().enumerate() {
        let mut generator = bench.generator(places_mm, 60 + w as u64);
        let lines = generator.window(&still, 0.05 * w as f64, 150 * places_mm.len(), 40).0;
        let found = points.track(&lines).0;
        assert_eq!([found[0].is_ok(), found[1].is_ok()], answered, "window {w}: {found:?}");
    }
}
