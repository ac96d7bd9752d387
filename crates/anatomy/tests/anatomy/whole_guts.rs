//! Generated whole guts against what was measured in people, and the figures of measured people against the reference.

use crate::{data, load_model, load_text, models};
use lumenav_anatomy::generator::{BodySize, Generated, WholeGutRequest, tract_file_text, whole_gut};
use lumenav_anatomy::statistics::{Quantity, TractStatistics};
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_anatomy::{SegmentKey, Tract};
use lumenav_core::{Node, RandomStreams};

/// Seed of the committed guts.
const SEED: u64 = 1;

fn make(size: BodySize, seed: u64) -> Generated {
    whole_gut(&WholeGutRequest::new(size), &RandomStreams::new(seed, 0, "whole-gut")).unwrap()
}

fn refusal(size: BodySize, length_scale: f64, radius_scale: f64) -> String {
    let request = WholeGutRequest { size, length_scale, radius_scale };
    whole_gut(&request, &RandomStreams::new(SEED, 0, "whole-gut")).unwrap_err().to_string()
}

/// Every figure in its measured range; the small bowel in the narrower ranges of the reference (gut, section B).
fn assert_measured(generated: &Generated, who: &str) {
    let statistics = TractStatistics::of(&generated.tract, &generated.report);
    let verdicts = statistics.verdicts();
    assert_eq!(verdicts.len(), 30, "{who}: a part is missing");
    for verdict in verdicts {
        assert!(verdict.inside(), "{who}: {verdict}");
    }
    let small_bowel = statistics.part("small bowel").unwrap();
    for (quantity, low, high) in [
        (Quantity::BendRadiusMedian, 0.0195, 0.0245),
        (Quantity::BendRadiusP5, 0.0065, 0.009),
        (Quantity::MeanCurvature, 48.0, 62.5),
        (Quantity::LengthPerTurn, 0.0775, 0.0925),
    ] {
        let value = small_bowel.get(quantity);
        assert!((low..=high).contains(&value), "{who}: {quantity:?} {value}");
    }
}

/// No two stretches of the wall meet: every pair of places more than 60 mm (and 1.5 sums of the radii) apart along the line is
/// further apart than both radii. Looked at every 3 mm, another grid than that of the tract's own check, whose step of 2 mm is
/// allowed for.
fn assert_no_intersection(tract: &Tract, who: &str) {
    let count = (tract.length_m() / 0.003) as usize;
    let places: Vec<_> = (0..=count)
        .map(|i| tract.length_m() * i as f64 / count as f64)
        .map(|s| (s, tract.station(s).position_m, tract.radius.radius_m(s)))
        .collect();
    for (i, (s, point, radius)) in places.iter().enumerate() {
        for (other_s, other, other_radius) in &places[i..] {
            let sum = radius + other_radius;
            let apart = other_s - s > 0.062_f64.max(1.5 * sum);
            assert!(!apart || (other - point).norm() > sum, "{who}: {s:.3} m meets {other_s:.3} m");
        }
    }
}

#[test]
fn published_generated_guts_lie_in_the_measured_ranges() {
    for (size, seeds) in
        [(BodySize::SmallWoman, 1..3), (BodySize::AverageMan, 1..4), (BodySize::LargeMan, 1..3)]
    {
        for seed in seeds {
            assert_measured(&make(size, seed), &format!("{} {seed}", size.as_str()));
        }
    }
}

#[test]
fn law_twenty_generated_guts_never_meet_themselves_and_stay_in_their_torso() {
    for seed in 0..20 {
        let size = BodySize::ALL[seed % 3];
        let who = format!("{} {seed}", size.as_str());
        let generated = make(size, seed as u64);
        assert!(generated.report.warnings.is_empty(), "{who}: {:?}", generated.report.warnings);
        let tract = &generated.tract;
        assert_no_intersection(tract, &who);
        let keys: Vec<SegmentKey> = tract.segments.iter().map(|segment| segment.key).collect();
        assert_eq!(keys, SegmentKey::ALL, "{who}");
        let half = size.torso_half_extents_m();
        assert_eq!(tract.torso_half_extents_m, Some(half), "{who}");
        for i in 0..=2000 {
            let at = tract.station(tract.length_m() * f64::from(i) / 2000.0).position_m;
            assert!((at.x / half.x).hypot(at.y / half.y) < 1.0 && at.z.abs() < half.z, "{who}: {at}");
        }
    }
}

#[test]
#[ignore = "a thousand tracts take a quarter of an hour: cargo test --release -- --ignored thousand"]
fn law_a_thousand_guts_never_meet_themselves_or_are_refused_with_the_reason() {
    let mut refused = 0;
    for seed in 0..1000 {
        let size = BodySize::ALL[seed % 3];
        let streams = RandomStreams::new(seed as u64, 0, "whole-gut");
        match whole_gut(&WholeGutRequest::new(size), &streams) {
            Ok(generated) => assert_no_intersection(&generated.tract, &format!("{} {seed}", size.as_str())),
            Err(error) => {
                refused += 1;
                println!("{} {seed}: {error}", size.as_str());
                assert!(error.to_string().contains("attempts met the request; the last: "), "{error}");
            }
        }
    }
    println!("{refused} of 1000 refused");
    assert!(refused < 50, "{refused} of 1000 refused");
}

#[test]
fn law_equal_seeds_make_equal_bytes_and_others_do_not() {
    let text = |seed| tract_file_text(&make(BodySize::AverageMan, seed).draft, "a test");
    let (first, again, other) = (text(5), text(5), text(6));
    assert!(first == again);
    assert!(first != other);
    let (loaded, report) = load_text(&first).unwrap();
    assert!(report.warnings.is_empty() && loaded.segments.len() == 12, "{:?}", report.warnings);
}

#[test]
fn regress_committed_guts_are_what_their_seed_makes() {
    for size in BodySize::ALL {
        let name = format!("whole-gut-{}", size.as_str());
        let committed = std::fs::read_to_string(models().join(format!("{name}.toml"))).unwrap();
        let made_by = format!(
            "lumenav models generate tract --size {} --seed {SEED} --out models/tracts/{name}.toml",
            size.as_str()
        );
        assert!(tract_file_text(&make(size, SEED).draft, &made_by) == committed, "{name} differs");
        let (_, report) = load_model(&name);
        assert_eq!(report.warnings, Vec::<String>::new());
    }
}

#[test]
fn law_length_scale_reaches_the_cadaver_in_the_same_torso() {
    let size = BodySize::LargeMan;
    let request = WholeGutRequest { length_scale: 2.3, ..WholeGutRequest::new(size) };
    let generated = whole_gut(&request, &RandomStreams::new(3, 0, "whole-gut")).unwrap();
    let statistics = TractStatistics::of(&generated.tract, &generated.report);
    let length_m = statistics.part("small bowel").unwrap().length_m;
    assert!((6.5..=7.3).contains(&length_m), "{length_m}");
    assert!(statistics.closest_approach_m > 0.002);
    assert_eq!(generated.tract.torso_half_extents_m, Some(size.torso_half_extents_m()));
    // The lengths asked for and built are the same to 2 %: the jejunum is two fifths.
    let jejunum_m = statistics.part("jejunum").unwrap().length_m;
    let ileum_m = statistics.part("ileum").unwrap().length_m;
    assert!((jejunum_m / (jejunum_m + ileum_m) - 0.4).abs() < 0.01, "{jejunum_m} {ileum_m}");
}

#[test]
fn law_bad_requests_are_refused_in_words() {
    let size = BodySize::AverageMan;
    for (length_scale, radius_scale, word) in [
        (f64::NAN, 1.0, "length_scale has to be from 0.5 to 4"),
        (0.0, 1.0, "length_scale has to be from 0.5 to 4"),
        (1.0, -1.0, "radius_scale has to be from 0.5 to 2"),
        (1.0, f64::INFINITY, "radius_scale has to be from 0.5 to 2"),
        (4.0, 1.0, "length_scale has to be from 0 to 7"),
    ] {
        let message = refusal(size, length_scale, radius_scale);
        assert!(message.contains(word), "{message}");
    }
    // Wide lumina in a frame of this size: every colon overlaps itself.
    let message = refusal(BodySize::SmallWoman, 1.0, 2.0);
    assert!(message.contains("100 attempts") && message.contains("overlaps itself"), "{message}");
    assert_eq!(BodySize::from_name("giant"), None);
}

/// Reference on the gut, section B, first person (EdinGCA_3D_00090): lengths (m) and radii (mm) as stated there.
#[test]
fn published_figures_of_the_measured_person_are_the_references() {
    let Some(data) = data("published_figures_of_the_measured_person_are_the_references") else { return };
    let text = "[tract]\nframe = \"lps\"\ncentre_line_csv = \"EdinGCA_3D_00090_centerline.csv\"\n\
                segment_names = { esophagus_part = \"oesophagus\", cecum_colon = \"caecum\" }\n";
    let node = Node::parse_text(text, "tract.toml", &data, &[]).unwrap();
    let (tract, report) = load(&node, &TractOptions::default()).unwrap();
    let statistics = TractStatistics::of(&tract, &report);
    println!("{statistics}");
    // The CSV's segments end a sample or a gap before the next begins (2 to 10 mm, added here to the one before).
    for (part, length_m, tolerance_m) in [
        ("oesophagus", 0.056, 0.0015),
        ("stomach", 0.18, 0.005),
        ("duodenum", 0.14, 0.006),
        ("jejunum", 0.98, 0.006),
        ("transverse", 0.34, 0.006),
        ("descending", 0.40, 0.006),
        ("sigmoid and rectum", 0.28, 0.008),
        ("colon", 1.20, 0.006),
    ] {
        let found = statistics.part(part).unwrap().length_m;
        assert!((found - length_m).abs() < tolerance_m, "{part}: {found} m, reference {length_m} m");
    }
    // 2.30 m and the 37 mm to the caecum, which the reference leaves out.
    let small_bowel = statistics.part("small bowel").unwrap();
    assert!((small_bowel.length_m - 2.337).abs() < 0.008, "{}", small_bowel.length_m);
    let stomach = statistics.part("stomach").unwrap();
    assert!((1e3 * stomach.radius_median_m - 18.0).abs() < 0.5, "{}", stomach.radius_median_m);
    assert!((1e3 * stomach.radius_p90_m - 23.0).abs() < 0.5, "{}", stomach.radius_p90_m);
    assert!((1e3 * statistics.part("jejunum").unwrap().radius_median_m - 8.4).abs() < 0.05);
    // Bends, over three people: 20 to 24 mm, 6.5 to 9 mm, 48 to 62 /m, a turn per 8 to 9 cm. This person is the most bent; the method
    // here puts it 6 % beyond the first range and 3 % beyond the third.
    assert!((0.94 * 20.0..24.5).contains(&(1e3 * small_bowel.bend_radius_median_m)));
    assert!((6.45..9.0).contains(&(1e3 * small_bowel.bend_radius_p5_m)));
    assert!((47.5..1.035 * 62.0).contains(&small_bowel.mean_curvature_per_m));
    assert!((75.0..95.0).contains(&(1e3 * small_bowel.get(Quantity::LengthPerTurn))));
    assert!((20..=33).contains(&small_bowel.sharp_turns));
    // Colon: median bend radius 26 to 45 mm over five people; this one is at the lower end.
    let colon = statistics.part("colon").unwrap();
    assert!((25.5..45.5).contains(&(1e3 * colon.bend_radius_median_m)), "{colon:?}");
}
