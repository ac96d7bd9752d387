//! The consistency tests on a filter whose consistency is known: a linear Kalman filter that follows truth
//! drawn from its own model passes; the same filter with its noise misstated by 2 either way fails, on the
//! right side.
//!
//! Three axes, each with position and velocity (white acceleration), position measured. What the filter
//! believes of its standard deviations is the truth times `belief`.

use lumenav_evaluation::chi_square::Band;
use lumenav_evaluation::consistency::across_runs::NeesAcrossRuns;
use lumenav_evaluation::consistency::one_run::{NeesAccumulator, NisAccumulator};
use lumenav_evaluation::consistency::quadratic_form;
use lumenav_evaluation::consistency::verdict::Verdict;
use lumenav_evaluation::consistency::whiteness::InnovationWhiteness;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, RowVector2, Vector2, Vector3};
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64Mcg;

const STEP_S: f64 = 0.1;
const ACCELERATION_M_S2: f64 = 0.02;
const READING_M: f64 = 0.002;
const START: [f64; 2] = [0.01, 0.005]; // m, m/s

struct Run {
    nees: Vec<f64>,
    nis: NisAccumulator,
    whiteness: InnovationWhiteness,
}

fn process_noise(acceleration_m_s2: f64) -> Matrix2<f64> {
    let gain = Vector2::new(0.5 * STEP_S * STEP_S, STEP_S) * acceleration_m_s2;
    gain * gain.transpose()
}

/// One run of `steps`; the axes share covariances, so one 2 x 2 filter serves all three.
fn run(steps: usize, belief: f64, reading_belief: f64, rng: &mut Pcg64Mcg) -> Run {
    let mut draw = || -> f64 { StandardNormal.sample(rng) };
    let transition = Matrix2::new(1.0, STEP_S, 0.0, 1.0);
    let observe = RowVector2::new(1.0, 0.0);
    let q = process_noise(ACCELERATION_M_S2 * belief);
    let r = (READING_M * reading_belief).powi(2);
    let mut covariance =
        Matrix2::from_diagonal(&Vector2::new(START[0], START[1]).map(|s| (s * belief).powi(2)));
    let mut truth = [0; 3].map(|_| Vector2::new(START[0] * draw(), START[1] * draw()));
    let mut estimate = [Vector2::<f64>::zeros(); 3];
    let mut result =
        Run { nees: Vec::new(), nis: NisAccumulator::new(), whiteness: InnovationWhiteness::new(10) };
    for _ in 0..steps {
        covariance = transition * covariance * transition.transpose() + q;
        let s = covariance[(0, 0)] + r;
        let gain = covariance * observe.transpose() / s;
        let mut innovation = Vector3::zeros();
        for axis in 0..3 {
            let push = Vector2::new(0.5 * STEP_S * STEP_S, STEP_S) * (ACCELERATION_M_S2 * draw());
            truth[axis] = transition * truth[axis] + push;
            estimate[axis] = transition * estimate[axis];
            innovation[axis] = truth[axis].x + READING_M * draw() - estimate[axis].x;
            estimate[axis] += gain * innovation[axis];
        }
        covariance -= gain * s * gain.transpose();
        let error = Vector3::from_fn(|axis, _| truth[axis].x - estimate[axis].x);
        result.nees.push(quadratic_form(&error, &(Matrix3::identity() * covariance[(0, 0)])).unwrap());
        let s3 = Matrix3::identity() * s;
        result.nis.push(quadratic_form(&innovation, &s3).unwrap(), 3).unwrap();
        let (innovation, s3) =
            (DVector::from_column_slice(innovation.as_slice()), DMatrix::identity(3, 3) * s);
        result.whiteness.push(&innovation, &s3).unwrap();
    }
    result
}

fn across(runs: usize, steps: usize, belief: f64, reading_belief: f64) -> NeesAcrossRuns {
    let mut rng = Pcg64Mcg::seed_from_u64(101);
    let mut collection = NeesAcrossRuns::new(3).unwrap();
    (0..runs).for_each(|_| collection.push_run((0..).zip(run(steps, belief, reading_belief, &mut rng).nees)));
    collection
}

#[test]
fn law_matched_linear_filter_passes_across_runs() {
    let collection = across(200, 100, 1.0, 1.0);
    let summary = collection.summary().unwrap();
    assert_eq!(Verdict::of_runs(&summary), Verdict::Consistent, "{summary:?}");
    assert_eq!((summary.runs, summary.steps), (200, 100));
    assert!((summary.mean_per_dof - 1.0).abs() < 0.05, "{summary:?}");
    assert_eq!(collection.share_of_steps_within(Band { lower: 0.85, upper: 1.25 }), Some(1.0));
}

#[test]
fn law_noise_misstated_by_two_fails_on_its_side() {
    for (belief, word) in [(0.5, "overconfident: "), (2.0, "cautious: ")] {
        let summary = across(200, 100, belief, belief).summary().unwrap();
        let verdict = Verdict::of_runs(&summary).to_string();
        assert!(verdict.starts_with(word), "{verdict}");
        assert!(summary.share_inside_95 < 0.01, "{summary:?}");
        // All standard deviations scaled alike scale the claimed covariance alone.
        assert!((summary.mean_per_dof * belief * belief - 1.0).abs() < 0.05, "{summary:?}");
    }
}

/// Scaled all together, NEES changes by algebra. One noise alone changes the gain and the error with it.
#[test]
fn law_one_noise_misstated_by_two_fails_on_its_side() {
    for (factor, word) in [(0.5, "overconfident: "), (2.0, "cautious: ")] {
        for (belief, reading_belief) in [(factor, 1.0), (1.0, factor)] {
            let summary = across(200, 100, belief, reading_belief).summary().unwrap();
            let verdict = Verdict::of_runs(&summary).to_string();
            println!("motion {belief}, readings {reading_belief}: {verdict}");
            assert!(verdict.starts_with(word), "motion {belief}, readings {reading_belief}: {verdict}");
            assert!(summary.share_inside_95 < 0.5, "{summary:?}");
        }
    }
}

/// The finding behind the rule that NEES is not pooled over one run: a perfect filter would be rejected far
/// more often than at the nominal 5 %, while NIS keeps its level.
#[test]
fn law_pooled_nees_rejects_a_perfect_filter_and_pooled_nis_does_not() {
    let mut rng = Pcg64Mcg::seed_from_u64(102);
    let (runs, steps) = (300, 150);
    let (mut nees_outside, mut nis_outside) = (0, 0);
    for _ in 0..runs {
        let result = run(steps, 1.0, 1.0, &mut rng);
        // The wrong test, made with the machinery of the right one: NEES as if it were white like NIS.
        let mut pooled = NisAccumulator::new();
        result.nees.iter().for_each(|value| pooled.push(*value, 3).unwrap());
        let rejects =
            |nis: &NisAccumulator| !Verdict::of_innovations(&nis.summary().unwrap()).is_consistent();
        nees_outside += usize::from(rejects(&pooled));
        nis_outside += usize::from(rejects(&result.nis));
    }
    let share = |count: usize| count as f64 / f64::from(runs);
    println!("rejected at 5 %: NEES {:.3}, NIS {:.3}", share(nees_outside), share(nis_outside));
    assert!(share(nees_outside) > 0.2, "{nees_outside} of {runs}");
    // Four standard errors of a share of 5 % in 300 runs.
    assert!((share(nis_outside) - 0.05).abs() < 0.05, "{nis_outside} of {runs}");
}

#[test]
fn law_innovations_are_white_only_for_the_right_ratio_of_noises() {
    let mut rng = Pcg64Mcg::seed_from_u64(103);
    let runs = 300;
    let rejected =
        (0..runs).filter(|_| run(300, 1.0, 1.0, &mut rng).whiteness.p_value().unwrap() < 0.05).count();
    println!("whiteness rejected at 5 %: {rejected} of {runs}");
    // Four standard errors of a share of 5 % in 300 runs.
    assert!((rejected as f64 / f64::from(runs) - 0.05).abs() < 0.05, "{rejected} of {runs}");
    // A filter that trusts its motion model far too much lags behind: the innovations remember.
    let lagging = run(3000, 0.1, 1.0, &mut rng);
    assert!(lagging.whiteness.p_value().unwrap() < 1e-6);
}

#[test]
fn law_one_run_is_reported_with_the_right_word() {
    let mut rng = Pcg64Mcg::seed_from_u64(104);
    for (belief, word) in [(1.0, "consistent"), (0.5, "overconfident"), (2.5, "cautious")] {
        let mut collection = NeesAccumulator::new(3).unwrap();
        run(3000, belief, belief, &mut rng).nees.iter().for_each(|value| collection.push(*value));
        let verdict = Verdict::of_run(&collection.summary().unwrap()).to_string();
        assert!(verdict.starts_with(word), "{verdict}");
    }
}
