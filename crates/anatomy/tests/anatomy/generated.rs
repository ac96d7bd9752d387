//! The colon generator against what was measured in people (`generator::MEASURED`, project reference on the gut, section B).

use crate::{load_model, load_text, models};
use lumenav_anatomy::bends::Bends;
use lumenav_anatomy::generator::{
    ColonRequest, MEASURED, MEASURED_BEND_RADIUS_M, MEASURED_SHARP_TURNS, colon, tract_file_text,
};
use lumenav_anatomy::{SegmentKey, Tract};
use lumenav_core::RandomStreams;

/// Seed of the committed colon.
const SEED: u64 = 4;

fn streams(seed: u64) -> RandomStreams {
    RandomStreams::new(seed, 0, "colon")
}

#[test]
fn regress_the_committed_colon_is_what_its_seed_makes() {
    let committed = std::fs::read_to_string(models().join("colon.toml")).unwrap();
    let generated = colon(&ColonRequest::default(), &streams(SEED)).unwrap();
    let made_by = format!("cargo run -p lumenav-anatomy --example generate_colon -- {SEED}");
    assert!(tract_file_text(&generated.draft, &made_by) == committed, "colon.toml differs from seed {SEED}");
    let (loaded, report) = load_model("colon");
    assert_eq!(report.warnings, Vec::<String>::new());
    assert!((loaded.length_m() - generated.tract.length_m()).abs() < 1e-12);
}

fn assert_measured(tract: &Tract, seed: u64) {
    for range in &MEASURED {
        let (first, last) =
            (tract.segment(range.segments.0).unwrap(), tract.segment(range.segments.1).unwrap());
        let length_m = last.end_m - first.start_m;
        assert!(
            (range.length_m.0..=range.length_m.1).contains(&length_m),
            "seed {seed}: {} {length_m}",
            first.key
        );
        for segment in tract.segments.iter().filter(|s| s.key >= first.key && s.key <= last.key) {
            let mut radii: Vec<f64> = (0..=200)
                .map(|i| segment.start_m + segment.length_m() * f64::from(i) / 200.0)
                .map(|s| tract.radius.radius_m(s))
                .collect();
            radii.sort_by(f64::total_cmp);
            let median = radii[100];
            assert!(
                (range.radius_m.0..=range.radius_m.1).contains(&median),
                "seed {seed}: {} {median}",
                segment.key
            );
        }
    }
    let bends = Bends::of(&tract.centre_line, 0.0, tract.length_m());
    let (low, high) = MEASURED_BEND_RADIUS_M;
    assert!((low..=high).contains(&bends.median_radius_m), "seed {seed}: {bends:?}");
    let (fewest, most) = MEASURED_SHARP_TURNS;
    assert!((fewest..=most).contains(&bends.sharp_turns), "seed {seed}: {bends:?}");
}

#[test]
fn published_generated_colons_lie_in_the_measured_ranges() {
    let mut totals = Vec::new();
    for seed in 0..25 {
        let generated = colon(&ColonRequest::default(), &streams(seed)).unwrap();
        assert_measured(&generated.tract, seed);
        assert!(generated.report.overlaps.is_empty() && generated.report.bridges.is_empty());
        let total = generated.tract.length_m();
        assert!((1.09..=1.97).contains(&total), "seed {seed}: {total}");
        let extent = extent_m(&generated.tract);
        // The gut box of EdinGCA_3D_00090 (1.2 m of colon) is 0.21 x 0.16 x 0.36 m; frames grow with the colon.
        for (axis, limit) in extent.iter().zip([0.27, 0.20, 0.42]) {
            assert!(*axis < limit, "seed {seed}: {extent:?}");
        }
        totals.push(total);
    }
    // Utano et al. 2021: 1.503 m with a standard deviation of 0.185 m; the mean of 25 lies within 3 standard errors.
    let mean = totals.iter().sum::<f64>() / totals.len() as f64;
    assert!((mean - 1.503).abs() < 3.0 * 0.185 / 5.0, "mean total length {mean}");
}

fn extent_m(tract: &Tract) -> [f64; 3] {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for i in 0..=1000 {
        let position = tract.station(tract.length_m() * f64::from(i) / 1000.0).position_m;
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    [0, 1, 2].map(|axis| high[axis] - low[axis])
}

#[test]
fn law_a_stated_length_and_scale_are_met() {
    let request = ColonRequest { total_length_m: Some(1.40), length_scale: 0.7, radius_scale: 0.65 };
    let generated = colon(&request, &streams(11)).unwrap();
    assert!((generated.tract.length_m() / (0.7 * 1.40) - 1.0).abs() < 0.01, "{}", generated.tract.length_m());
    let request = ColonRequest { total_length_m: Some(7.0), ..ColonRequest::default() };
    assert!(colon(&request, &streams(1)).is_err());
    let request = ColonRequest { length_scale: f64::NAN, ..ColonRequest::default() };
    assert!(colon(&request, &streams(1)).is_err());
    // Wide lumina in a small frame overlap: told, not made.
    let request = ColonRequest { length_scale: 0.5, radius_scale: 2.0, ..ColonRequest::default() };
    assert!(colon(&request, &streams(1)).unwrap_err().to_string().contains("overlaps"));
}

#[test]
fn law_the_file_of_a_generated_colon_is_the_colon() {
    let generated = colon(&ColonRequest::default(), &streams(8)).unwrap();
    let (loaded, _) = load_text(&tract_file_text(&generated.draft, "a test\nwith a line break")).unwrap();
    assert_eq!(loaded.segments.len(), 6);
    for i in 0..=300 {
        let s = loaded.length_m() * f64::from(i) / 300.0;
        assert!((loaded.station(s).position_m - generated.tract.station(s).position_m).norm() < 1e-10);
        assert!((loaded.radius.radius_m(s) - generated.tract.radius.radius_m(s)).abs() < 1e-10);
    }
    assert_eq!(loaded.segment_at(0.0).key, SegmentKey::Caecum);
}
