//! A filter whose model is right must know how wrong it is: NEES across runs, NIS pooled over one run, white innovations. The
//! same filter with its noises misstated by 2 either way must fail on its side.
//!
//! Linear and Gaussian: white-noise acceleration, positions measured; truth is drawn from the very model.

use crate::models::{PositionModel, measurement, normal, normal3, values, white_motion};
use lumenav_core::{AxisStep, FixKind, PoseEstimate, RandomStream, RandomStreams, SimTime};
use lumenav_evaluation::consistency::across_runs::{AcrossRunsSummary, NeesAcrossRuns};
use lumenav_evaluation::consistency::one_run::NisAccumulator;
use lumenav_evaluation::consistency::quadratic_form;
use lumenav_evaluation::consistency::verdict::Verdict as Judgement;
use lumenav_evaluation::consistency::whiteness::InnovationWhiteness;
use lumenav_fusion::Belief;
use lumenav_fusion::update::propose;
use nalgebra::{DVector, Isometry3, Matrix6, Vector3, Vector6};
use std::sync::Arc;

const STEP_NS: i64 = 100_000_000;
const STEP_S: f64 = 0.1;
const WALK: f64 = 4e-3;
const SIGMA_M: f64 = 2e-3;
const START_M: f64 = 5e-3;
const START_M_S: f64 = 3e-3;

struct Run {
    nees: Vec<f64>,
    nis: NisAccumulator,
    whiteness: InnovationWhiteness,
}

/// Standard deviations the filter is told, over the true ones: of the start, the motion, and the readings.
#[derive(Clone, Copy)]
struct Told {
    start: f64,
    motion: f64,
    readings: f64,
}

/// The start, without the gate of the event log around it: a filter that is told wrong noises must be seen to be wrong.
fn start(told: Told) -> Belief {
    let fix = PoseEstimate {
        world_from_capsule: Isometry3::identity(),
        covariance: Matrix6::identity() * (START_M * told.start).powi(2),
        kind: FixKind::Full,
    };
    Belief::start(SimTime::ZERO, &fix, START_M_S * told.start, 0.1)
}

/// One step of truth: `[p, v]` per axis with the exact covariance of white-noise acceleration.
fn advance(position: &mut Vector3<f64>, velocity: &mut Vector3<f64>, stream: &mut RandomStream) {
    let step = AxisStep::over(STEP_S, WALK, None);
    let root_pp = step.noise_pp.sqrt();
    let root_vp = step.noise_pv / root_pp;
    let root_vv = (step.noise_vv - root_vp.powi(2)).sqrt();
    for i in 0..3 {
        let (first, second) = (normal(stream), normal(stream));
        position[i] += STEP_S * velocity[i] + root_pp * first;
        velocity[i] += root_vp * first + root_vv * second;
    }
}

fn run(steps: u64, told: Told, seed: u64) -> Run {
    let streams = RandomStreams::new(seed, 0, "consistency");
    let mut stream = streams.stream("truth", 0);
    let mut belief = start(told);
    let motion = white_motion(WALK * told.motion, 0.1);
    let (mut position, mut velocity) = (START_M * normal3(&mut stream), START_M_S * normal3(&mut stream));
    let model = Arc::new(PositionModel { sigma_m: SIGMA_M * told.readings });
    let mut result =
        Run { nees: Vec::new(), nis: NisAccumulator::new(), whiteness: InnovationWhiteness::new(10) };
    for k in 1..=steps {
        advance(&mut position, &mut velocity, &mut stream);
        let z = position + SIGMA_M * normal3(&mut stream);
        let at = SimTime(STEP_NS * k as i64);
        belief.predict(at, &motion);
        let innovation = z - belief.state.world_from_capsule.translation.vector;
        let mut covariance = belief.covariance.view((0, 0), (3, 3)).into_owned();
        (0..3).for_each(|i| covariance[(i, i)] += model.sigma_m.powi(2));
        result.whiteness.push(&DVector::from_column_slice(innovation.as_slice()), &covariance).unwrap();
        let m = measurement("s", k, at, values("position/1", z.as_slice()), model.clone());
        let proposal = propose(&belief, &m, 1).unwrap();
        result.nis.push(proposal.innovation.chi_square, 3).unwrap();
        proposal.apply(&mut belief);
        let dp = position - belief.state.world_from_capsule.translation.vector;
        let dv = velocity - belief.state.velocity_world_m_s;
        let error = Vector6::new(dp.x, dp.y, dp.z, dv.x, dv.y, dv.z);
        let columns = [0, 1, 2, 6, 7, 8];
        let covariance = Matrix6::from_fn(|i, j| belief.covariance[(columns[i], columns[j])]);
        result.nees.push(quadratic_form(&error, &covariance).unwrap());
    }
    result
}

fn across(runs: u64, told: Told) -> AcrossRunsSummary {
    let mut collection = NeesAcrossRuns::new(6).unwrap();
    (0..runs).for_each(|seed| collection.push_run((0..).zip(run(60, told, 1000 + seed).nees)));
    collection.summary().unwrap()
}

const MATCHED: Told = Told { start: 1.0, motion: 1.0, readings: 1.0 };

#[test]
fn law_matched_filter_is_inside_its_nees_band() {
    let summary = across(250, MATCHED);
    println!("{summary:?}");
    assert_eq!(summary.runs, 250);
    assert!(summary.share_inside_95 >= 0.9, "{summary:?}");
    assert_eq!(Judgement::of_runs(&summary), Judgement::Consistent);
}

#[test]
fn law_noise_misstated_by_two_fails_on_its_side() {
    for (factor, word) in [(0.5, "overconfident: "), (2.0, "cautious: ")] {
        let summary = across(200, Told { start: factor, motion: factor, readings: factor });
        let words = Judgement::of_runs(&summary).to_string();
        assert!(words.starts_with(word), "{factor}: {words}");
        assert!(summary.share_inside_95 < 0.01, "{summary:?}");
        // All standard deviations scaled alike scale the claimed covariance alone.
        assert!((summary.mean_per_dof * factor * factor - 1.0).abs() < 0.05, "{summary:?}");
    }
}

/// Scaled all together, NEES changes by algebra whatever the filter does. One noise alone changes the gain, too, and the error
/// with it: no formula foretells NEES, but its side is known.
#[test]
fn law_one_noise_misstated_by_two_fails_on_its_side() {
    for (factor, word) in [(0.5, "overconfident: "), (2.0, "cautious: ")] {
        for told in [Told { readings: factor, ..MATCHED }, Told { motion: factor, ..MATCHED }] {
            let summary = across(200, told);
            let words = Judgement::of_runs(&summary).to_string();
            println!("motion {}, readings {}: {words}", told.motion, told.readings);
            assert!(words.starts_with(word), "motion {}, readings {}: {words}", told.motion, told.readings);
            assert!(summary.share_inside_95 < 0.5, "{summary:?}");
        }
    }
}

#[test]
fn law_pooled_nis_is_inside_its_band_and_outside_when_misstated() {
    let judge = |told: Told| Judgement::of_innovations(&run(1000, told, 7).nis.summary().unwrap());
    assert!(judge(MATCHED).is_consistent(), "{}", judge(MATCHED));
    for factor in [0.5, 2.0] {
        let judged = judge(Told { start: factor, motion: factor, readings: factor });
        assert!(!judged.is_consistent(), "{factor}: {judged}");
    }
}

#[test]
fn law_innovations_are_white_unless_the_motion_is_trusted_too_much() {
    // Alpha 0.01, one seed: a right filter would fail here once in a hundred seeds.
    let matched = run(1000, MATCHED, 8).whiteness.p_value().unwrap();
    assert!(matched > 0.01, "p = {matched}");
    let lagging = run(1000, Told { start: 0.1, motion: 0.1, readings: 1.0 }, 8).whiteness.p_value().unwrap();
    assert!(lagging < 1e-6, "p = {lagging}");
}
