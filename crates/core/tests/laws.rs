//! Each law catches what it is there for: a model, an information or a front end that is wrong in one place.

use lumenav_core::laws::{
    LawViolation, check_front_end_is_deterministic, check_model, check_observed_information,
};
use lumenav_core::{
    BlockSpec, Frame, FrontEnd, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Name,
    Noise, NominalState, Outcome, Part, PosePrior, PriorUse, Reading, Schema, SimTime, StateView,
};
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

const CLONE: SimTime = SimTime(5);

/// Which place of [`Everything`] or [`Ball`] is wrong.
#[derive(Clone, Copy, PartialEq)]
enum Wrong {
    Nothing,
    Jacobian,
    ForgotVelocity,
    ForgotRate,
    ForgotBlock,
    ForgotClone,
    Information,
}

/// `z = 2 p + v + ω + 1e9 b + p_clone` in one dimension of each; b is of the size of 1e-9.
struct Everything(Wrong, Vec<BlockSpec>);

fn everything(wrong: Wrong) -> Everything {
    let block = BlockSpec {
        name: Name::from("b_tesla"),
        initial: DVector::zeros(1),
        initial_sigma: DVector::from_element(1, 1e-9),
        random_walk: DVector::zeros(1),
    };
    Everything(wrong, vec![block])
}

fn row(width: usize, value: f64) -> DMatrix<f64> {
    let mut row = DMatrix::zeros(1, width);
    row[(0, 0)] = value;
    row
}

impl MeasurementModel for Everything {
    fn blocks(&self) -> &[BlockSpec] {
        &self.1
    }

    fn linearize(&self, _m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let place = |instant| at.world_from_capsule(instant).unwrap().translation.x;
        // Quadratic, so that a step of 1 in a block of 1e-9 would be seen to be too wide.
        let block = at.block("b_tesla").unwrap()[0] * 1e9;
        let expected = 2.0 * place(Instant::Now)
            + at.velocity_world_m_s().x
            + at.angular_rate_capsule_rad_s().x
            + block
            + block.powi(3)
            + place(Instant::Clone(CLONE));
        let slope = 1e9 * (1.0 + 3.0 * block.powi(2));
        let all = [
            (
                Wrong::Nothing,
                Part::Pose(Instant::Now),
                row(6, if self.0 == Wrong::Jacobian { 2.001 } else { 2.0 }),
            ),
            (Wrong::ForgotVelocity, Part::Velocity, row(3, 1.0)),
            (Wrong::ForgotRate, Part::AngularRate, row(3, 1.0)),
            (Wrong::ForgotBlock, Part::Block("b_tesla".into()), row(1, slope)),
            (Wrong::ForgotClone, Part::Pose(Instant::Clone(CLONE)), row(6, 1.0)),
        ];
        let jacobian = all
            .into_iter()
            .filter(|(forgot, _, _)| self.0 == Wrong::Nothing || *forgot != self.0)
            .map(|(_, part, matrix)| (part, matrix))
            .collect();
        let residual = DVector::from_element(1, 1.0 - expected);
        Ok(Linearization::Residual {
            residual,
            jacobian,
            noise: Noise::Diagonal(DVector::from_element(1, 1.0)),
        })
    }
}

fn frame(values: &[f64]) -> Frame {
    let labels = (0..values.len()).map(|i| format!("{i}_m")).collect();
    Frame::of_values(Schema::channels("law/1", "value_m", labels), values.to_vec()).unwrap()
}

fn measurement(model: Arc<dyn MeasurementModel>) -> Measurement {
    Measurement {
        sensor: Name::from("s"),
        sequence: 0,
        at: SimTime::ZERO,
        arrival: SimTime::ZERO,
        since: None,
        value: Arc::new(frame(&[0.0])),
        model,
        prior_use: PriorUse::None,
        fix: None,
        motion: None,
    }
}

fn state() -> NominalState {
    let mut state =
        NominalState::at_rest(Isometry3::new(Vector3::new(0.1, 0.2, -0.1), Vector3::new(0.3, 0.5, 0.7)));
    state.velocity_world_m_s = Vector3::new(0.01, 0.02, 0.03);
    state.clones.insert(CLONE, Isometry3::identity());
    state.blocks.insert(Name::from("b_tesla"), DVector::from_element(1, 1e-9));
    state
}

fn check(wrong: Wrong) -> Result<f64, LawViolation> {
    let model = Arc::new(everything(wrong));
    check_model(model.as_ref(), &measurement(model.clone()), &state(), 1e-6)
}

#[test]
fn law_check_model_sees_every_part_of_the_state() {
    check(Wrong::Nothing).unwrap();
    for (wrong, expected) in [
        (Wrong::Jacobian, Part::Pose(Instant::Now)),
        (Wrong::ForgotVelocity, Part::Velocity),
        (Wrong::ForgotRate, Part::AngularRate),
        (Wrong::ForgotBlock, Part::Block("b_tesla".into())),
        (Wrong::ForgotClone, Part::Pose(Instant::Clone(CLONE))),
    ] {
        let Err(LawViolation::Derivative { part, .. }) = check(wrong) else { panic!("{expected:?} passed") };
        assert_eq!(part, expected);
    }
    let mut without = state();
    without.clones.insert(SimTime(6), Isometry3::identity());
    let model = Arc::new(everything(Wrong::Nothing));
    check_model(model.as_ref(), &measurement(model.clone()), &without, 1e-6).unwrap();
}

/// `log p = -½ |p - a|²/s² - ½ k |R x - u|²/t²`, its information exact: `R x · u` turns the attitude's into
/// `(R x · u) (I - x xᵀ)/t²` in the capsule's frame.
struct Ball(Wrong);

impl MeasurementModel for Ball {
    fn linearize(&self, _m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).unwrap();
        let (place, wanted) = (Vector3::new(0.1, 0.0, 0.05), Vector3::new(1.0, 2.0, -2.0) / 3.0);
        let (s2, t2) = (1e-6, 0.01);
        let off = pose.translation.vector - place;
        let seen = pose.rotation.inverse() * wanted;
        let log_likelihood = -0.5 * off.norm_squared() / s2 + seen.x / t2;
        let mut gradient = DVector::zeros(6);
        gradient.rows_mut(0, 3).copy_from(&(-off / s2));
        gradient.rows_mut(3, 3).copy_from(&(Vector3::x().cross(&seen) / t2));
        let mut information = DMatrix::zeros(6, 6);
        (0..3).for_each(|i| information[(i, i)] = 1.0 / s2);
        // Half of E_j E_k + E_k E_j on x, along `seen`.
        for j in 0..3 {
            for k in 0..3 {
                let x: Vector3<f64> = Vector3::x();
                let value = if j == k { seen.x } else { 0.0 } - 0.5 * (x[j] * seen[k] + x[k] * seen[j]);
                information[(3 + j, 3 + k)] = value / t2;
            }
        }
        if self.0 == Wrong::Information {
            information[(4, 4)] *= 1.01;
        }
        Ok(Linearization::Information {
            parts: vec![Part::Pose(Instant::Now)],
            gradient,
            information,
            log_likelihood,
            effective_count: 1.0,
        })
    }
}

#[test]
fn law_observed_information_is_the_curvature_of_the_likelihood() {
    let check = |wrong: Wrong| {
        let model = Arc::new(Ball(wrong));
        let m = measurement(model.clone());
        check_model(model.as_ref(), &m, &state(), 1e-6)?;
        check_observed_information(model.as_ref(), &m, &state(), 1e-6)
    };
    check(Wrong::Nothing).unwrap();
    // One percent of the attitude's, ten thousand times smaller than the position's.
    assert!(matches!(check(Wrong::Information), Err(LawViolation::Derivative { .. })));
    let residual = Arc::new(everything(Wrong::Nothing));
    assert!(
        check_observed_information(residual.as_ref(), &measurement(residual.clone()), &state(), 1e-6)
            .is_err()
    );
}

/// Sums its readings; what is wrong with it, if anything.
struct Summing {
    sum: f64,
    forgets: bool,
    offset: f64,
}

impl FrontEnd for Summing {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        self.sum += reading.payload.f64("value_m")?[0] + self.offset;
        let mut m = measurement(Arc::new(everything(Wrong::Nothing)));
        m.value = Arc::new(frame(&[self.sum]));
        Ok(Outcome::Measured(vec![m]))
    }

    fn snapshot(&self) -> Vec<u8> {
        if self.forgets { Vec::new() } else { self.sum.to_le_bytes().to_vec() }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), ModalityError> {
        if self.forgets {
            return Ok(());
        }
        self.sum = f64::from_le_bytes(bytes.try_into().map_err(|_| ModalityError::Snapshot)?);
        Ok(())
    }
}

#[test]
fn law_a_front_end_is_deterministic_and_its_snapshot_complete() {
    let readings: Vec<Reading> = (0..6)
        .map(|k| Reading {
            sensor: Name::from("s"),
            sequence: k,
            interval: (SimTime(k as i64), SimTime(k as i64)),
            arrival: SimTime(k as i64),
            known_poses: BTreeMap::new(),
            payload: frame(&[k as f64]),
        })
        .collect();
    let built = std::cell::Cell::new(0.0);
    let check = |forgets: bool, random: bool| {
        let build = || -> Box<dyn FrontEnd> {
            built.set(built.get() + 1.0);
            Box::new(Summing { sum: 0.0, forgets, offset: if random { built.get() } else { 0.0 } })
        };
        check_front_end_is_deterministic(&build, &readings, None).map_err(|error| error.to_string())
    };
    check(false, false).unwrap();
    assert!(check(true, false).unwrap_err().contains("restored from its snapshot"));
    assert!(check(false, true).unwrap_err().contains("two front ends answer differently"));
}
