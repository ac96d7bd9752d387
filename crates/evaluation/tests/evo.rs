//! APE and RPE equal those of evo 1.38 on the same TUM files, over relations, alignments, distances and pair
//! rules. The files and figures are made by `cross/evo_reference.py`.

use lumenav_evaluation::trajectory::absolute::absolute_errors;
use lumenav_evaluation::trajectory::alignment::{AlignmentKind, aligned};
use lumenav_evaluation::trajectory::relative::{Delta, PairRule, PairsFrom, relative_pose_error};
use lumenav_evaluation::trajectory::{AssociatedPoses, Relation, Statistics, Trajectory, associate};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde_json::Value;
use std::path::PathBuf;

/// The requirement is 1e-6; what is reached is held.
const TOLERANCE: f64 = 1e-9;

fn read(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/cross").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Strict: `t x y z qx qy qz qw`, exactly eight numbers a line, `#` for comments.
fn tum(name: &str) -> Trajectory {
    let text = read(name);
    let (mut stamps_s, mut poses) = (Vec::new(), Vec::new());
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let v: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        assert_eq!(v.len(), 8, "{name}: {line}");
        stamps_s.push(v[0]);
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(v[7], v[4], v[5], v[6]));
        poses.push(Isometry3::from_parts(Translation3::new(v[1], v[2], v[3]), rotation));
    }
    Trajectory::new(stamps_s, poses).unwrap()
}

fn text<'a>(case: &'a Value, key: &str) -> &'a str {
    case[key].as_str().unwrap_or_else(|| panic!("no text {key} in {case}"))
}

fn number(case: &Value, key: &str) -> f64 {
    case[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {case}"))
}

fn flag(case: &Value, key: &str) -> bool {
    case[key].as_bool().unwrap_or_else(|| panic!("no flag {key} in {case}"))
}

fn with_alignment(pairs: &AssociatedPoses, case: &Value) -> AssociatedPoses {
    let kind = match text(case, "alignment") {
        "none" => return pairs.clone(),
        "align" => AlignmentKind::Rigid,
        "align+scale" => AlignmentKind::Similarity,
        other => panic!("unknown alignment {other}"),
    };
    let (moved, alignment) = aligned(pairs, kind).unwrap();
    if let Some(parameters) = case.get("parameters") {
        assert!((alignment.scale - number(parameters, "scale")).abs() < TOLERANCE);
        let rotation = alignment.reference_from_estimate.rotation.to_rotation_matrix();
        for i in 0..3 {
            let translation = parameters["translation_m"][i].as_f64().unwrap();
            assert!(
                (alignment.reference_from_estimate.translation.vector[i] - translation).abs() < TOLERANCE
            );
            for j in 0..3 {
                let entry = parameters["rotation"][i][j].as_f64().unwrap();
                assert!((rotation[(i, j)] - entry).abs() < TOLERANCE);
            }
        }
    }
    moved
}

fn rule(case: &Value) -> PairRule {
    let delta = number(case, "delta");
    let delta = match text(case, "unit") {
        "frames" => Delta::Frames(delta as usize),
        "meters" => Delta::Metres(delta),
        "radians" => Delta::Radians(delta),
        "degrees" => Delta::Degrees(delta),
        other => panic!("unknown unit {other}"),
    };
    let from_reference = flag(case, "pairs_from_reference");
    PairRule {
        delta,
        all_pairs: flag(case, "all_pairs"),
        relative_tolerance: 0.1,
        pairs_from: if from_reference { PairsFrom::Reference } else { PairsFrom::Estimate },
    }
}

/// Largest deviation, relative for figures above one (degrees, sums of squares), else absolute.
fn deviation(ours: &Statistics, case: &Value) -> f64 {
    let theirs = &case["statistics"];
    let figures = [
        ("rmse", ours.rmse),
        ("mean", ours.mean),
        ("median", ours.median),
        ("std", ours.std),
        ("min", ours.min),
        ("max", ours.max),
        ("sse", ours.sse),
    ];
    let deviations = figures.map(|(key, value)| {
        let expected = number(theirs, key);
        (value - expected).abs() / expected.abs().max(1.0)
    });
    deviations.into_iter().fold(0.0, f64::max)
}

#[test]
fn cross_ate_rpe_equal_evo() {
    let reference_figures: Value = serde_json::from_str(&read("evo_reference.json")).unwrap();
    let (reference, estimate) = (tum("evo_reference.tum"), tum("evo_estimate.tum"));
    let pairs = associate(&reference, &estimate, 0.01).unwrap();
    assert_eq!(pairs.len() as u64, reference_figures["matched"].as_u64().unwrap());
    let swapped = associate(&estimate, &reference, 0.01).unwrap();
    let cases = reference_figures["cases"].as_array().unwrap();
    // 2 orders x 3 alignments x 5 relations, and (6 deltas x 5 relations + 1) x 4 pair rules.
    assert_eq!(cases.len(), 30 + 124);
    let mut worst: f64 = 0.0;
    for case in cases {
        let relation: Relation = serde_json::from_value(case["relation"].clone()).unwrap();
        let errors = if text(case, "metric") == "ape" {
            let pairs = if text(case, "roles") == "swapped" { &swapped } else { &pairs };
            absolute_errors(&with_alignment(pairs, case), relation)
        } else {
            let poses = with_alignment(&pairs, case).first(number(case, "poses") as usize);
            relative_pose_error(&poses, relation, &rule(case)).unwrap().errors
        };
        assert_eq!(errors.len() as f64, number(case, "count"), "{case}");
        let found = deviation(&Statistics::of(&errors).unwrap(), case);
        assert!(found < TOLERANCE, "deviation {found:e} in {case}");
        worst = worst.max(found);
    }
    println!("largest deviation from evo over {} cases: {worst:e}", cases.len());
}
