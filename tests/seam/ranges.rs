//! Witness: ranges to six anchors, each with a bias that walks (a nuisance block), against FilterPy.
//!
//! ```text
//! z_i = |p - a_i| + b_i + noise        ∂z_i/∂p = (p - a_i)ᵀ/|p - a_i|        ∂z_i/∂b_i = 1
//! ```
//!
//! FilterPy's state is `[p, v, b]`; ours has attitude and rate too, which ranges to one point never touch: their
//! estimates must not move by a bit.

use super::{Document, instant, measured, options, prior, vector};
use lumenav::core::config::quantity::Positive;
use lumenav::core::laws::{check_model, check_sensor_is_deterministic, check_units};
use lumenav::core::{
    BlockSpec, FrontEnd, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Name, Noise,
    NominalState, Outcome, Part, PosePrior, Reading, Schema, SimTime, StateView,
};
use lumenav::fusion::{Eskf, EskfOptions, Filter as _, Verdict};
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use std::sync::Arc;

const BLOCK: &str = "ranges.bias_m";

pub(super) fn schema(anchors: usize) -> Arc<Schema> {
    Schema::channels("ranges/1", "range_m", (0..anchors).map(|i| format!("anchor{i}_m")).collect())
}

struct RangeModel {
    anchors_world_m: Vec<Vector3<f64>>,
    sigma_m: f64,
    blocks: Vec<BlockSpec>,
}

impl MeasurementModel for RangeModel {
    fn blocks(&self) -> &[BlockSpec] {
        &self.blocks
    }

    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let bias_m = at.block(BLOCK).ok_or_else(|| ModalityError::MissingBlock(BLOCK.to_owned()))?;
        let ranges_m = m.value.f64("range_m")?;
        let present: Vec<usize> = (0..ranges_m.len()).filter(|i| m.value.valid()[*i]).collect();
        let mut residual = DVector::zeros(present.len());
        let mut by_pose = DMatrix::zeros(present.len(), 6);
        let mut by_bias = DMatrix::zeros(present.len(), bias_m.len());
        for (row, i) in present.into_iter().enumerate() {
            let difference = pose.translation.vector - self.anchors_world_m[i];
            residual[row] = ranges_m[i] - difference.norm() - bias_m[i];
            by_pose.view_mut((row, 0), (1, 3)).copy_from(&difference.normalize().transpose());
            by_bias[(row, i)] = 1.0;
        }
        let noise = Noise::Diagonal(DVector::from_element(residual.len(), self.sigma_m.powi(2)));
        let jacobian = vec![(Part::Pose(Instant::Now), by_pose), (Part::Block(BLOCK.into()), by_bias)];
        Ok(Linearization::Residual { residual, jacobian, noise })
    }
}

struct RangeFrontEnd(Arc<RangeModel>);

impl FrontEnd for RangeFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        Ok(Outcome::Measured(vec![Measurement::of_reading(reading, self.0.clone())]))
    }

    fn blocks(&self) -> Vec<BlockSpec> {
        self.0.blocks.clone()
    }
}

fn document() -> Document {
    Document::parse(include_str!("../cross/range_gain_filterpy.json"))
}

fn model(document: &Document) -> Arc<RangeModel> {
    let anchors_world_m: Vec<Vector3<f64>> =
        document.rows("anchors_world_m").iter().map(|a| vector(a)).collect();
    let n = anchors_world_m.len();
    let prior_sigma = Document(document.0["prior_sigma"].clone());
    let block = BlockSpec {
        name: Name::from(BLOCK),
        initial: DVector::zeros(n),
        initial_sigma: DVector::from_element(n, prior_sigma.number("bias_m")),
        random_walk: DVector::from_element(n, document.number("bias_random_walk_m_per_sqrt_s")),
    };
    Arc::new(RangeModel { anchors_world_m, sigma_m: document.number("range_sigma_m"), blocks: vec![block] })
}

#[test]
fn cross_ranges_with_biases_equal_filterpy_over_1000_steps() {
    let document = document();
    let model = model(&document);
    let mut front_end = RangeFrontEnd(model.clone());
    let prior_sigma = Document(document.0["prior_sigma"].clone());
    let options = EskfOptions {
        initial_velocity_sigma_m_s: Positive(prior_sigma.number("velocity_m_s")),
        ..options(document.number("velocity_random_walk_m_s_per_sqrt_s"), 0.1)
    };
    let turned = Vector3::new(0.3, -0.2, 0.9);
    let mut filter = Eskf::new(options, front_end.blocks())
        .with_prior(&prior(prior_sigma.number("position_m"), &turned, 0.1), SimTime::ZERO);
    let attitude = filter.belief().unwrap().state.world_from_capsule.rotation;
    let (nis, states, variances) =
        (document.numbers("nis"), document.rows("states"), document.rows("variances"));
    let schema = schema(model.anchors_world_m.len());
    let (mut worst_state, mut worst_variance, mut worst_nis) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut log_likelihood = 0.0;
    for (k, ranges_m) in document.rows("ranges_m").iter().enumerate() {
        let at = SimTime::from_seconds(document.number("step_s") * (k + 1) as f64);
        let offered =
            filter.offer(measured(&mut front_end, &instant("ranges", k as u64, at, &schema, ranges_m)));
        let Verdict::Accepted(innovation) = offered.verdict else {
            panic!("step {k}: {:?}", offered.verdict)
        };
        worst_nis = worst_nis.max((innovation.chi_square / nis[k] - 1.0).abs());
        log_likelihood += innovation.log_likelihood;
        if (k + 1) % 10 == 0 {
            let belief = filter.belief().unwrap();
            let (expected, expected_variance) = (&states[k / 10], &variances[k / 10]);
            let state = &belief.state;
            let ours = state.world_from_capsule.translation.vector.iter();
            let ours = ours.chain(state.velocity_world_m_s.iter()).chain(state.blocks[BLOCK].iter());
            ours.zip(expected).for_each(|(a, b)| worst_state = worst_state.max((a - b).abs()));
            let columns = (0..3).chain(6..9).chain(12..18);
            for (column, b) in columns.zip(expected_variance) {
                worst_variance = worst_variance.max((belief.covariance[(column, column)] / b - 1.0).abs());
            }
            assert_eq!(state.world_from_capsule.rotation, attitude, "ranges turned the capsule at step {k}");
            assert_eq!(state.angular_rate_capsule_rad_s, Vector3::zeros());
        }
    }
    let relative = (log_likelihood / document.number("log_likelihood") - 1.0).abs();
    println!(
        "|dx| {worst_state:.1e}, variance {worst_variance:.1e}, NIS {worst_nis:.1e}, log-likelihood {relative:.1e}"
    );
    assert!(worst_state < 1e-9, "state {worst_state:e}");
    assert!(worst_variance < 1e-8, "variance {worst_variance:e}");
    assert!(worst_nis < 1e-9, "NIS {worst_nis:e}");
    assert!(relative < 1e-9, "log-likelihood {relative:e}");
}

#[test]
fn law_range_model_derivatives_and_units() {
    let model = model(&document());
    let schema = schema(6);
    check_units(&schema).unwrap();
    let mut front_end = RangeFrontEnd(model.clone());
    // One channel lost: it is left out, not zero.
    let values = [0.5, 0.52, f64::NAN, 0.4, 0.6, 0.55];
    let measurement = measured(&mut front_end, &instant("ranges", 0, SimTime::ZERO, &schema, &values));
    for turn in [0.0, 1e-9, 1.0, std::f64::consts::PI - 1e-7] {
        let mut state = NominalState::at_rest(Isometry3::new(
            Vector3::new(0.03, -0.02, 0.01),
            Vector3::new(0.0, turn, 0.0),
        ));
        state.blocks.insert(BLOCK.into(), DVector::from_element(6, 0.01));
        check_model(model.as_ref(), &measurement, &state, 1e-6).unwrap();
        let Linearization::Residual { residual, .. } = model.linearize(&measurement, &state).unwrap() else {
            panic!("ranges have a residual")
        };
        assert_eq!(residual.len(), 5);
    }
    let without_block = NominalState::at_rest(Isometry3::identity());
    assert!(matches!(model.linearize(&measurement, &without_block), Err(ModalityError::MissingBlock(_))));
}

#[test]
fn law_range_sensor_is_deterministic() {
    let anchors = model(&document()).anchors_world_m.clone();
    super::world::with_truth(|truth| {
        check_sensor_is_deterministic(
            &|| super::world::sensor(super::world::Ranges { anchors_world_m: anchors.clone() }),
            truth,
            "ranges",
            20,
        )
    })
    .unwrap();
}
