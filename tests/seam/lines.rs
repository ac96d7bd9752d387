//! Witness: 500 unlabelled lines in a 50 ms window as gradient and observed information of a mixture's likelihood.
//!
//! Line l passes a_l along the unit vector u_l; marker i stands at `m_i = p + R c_i`; d_li = (I - u uᵀ)(m_i - a) is its
//! offset from the line. With s the blur, K markers and the background uniform over a disc of radius B across the line:
//!
//! ```text
//! p_l = w₀/(π B²) + (1 - w₀)/K Σ_i exp(-|d_li|²/2s²)/(2π s²)       r_li = share of marker i in p_l
//! g_li = -J_iᵀ d_li/s²    J_i = [I, -R [c_i]ₓ]                      gradient = Σ_l Σ_i r_li g_li
//! information = Σ_l Σ_i r_li (J_iᵀ (I - u uᵀ) J_i/s² + D_li)       complete data
//!             - Σ_l (Σ_i r_li g_li g_liᵀ - ḡ_l ḡ_lᵀ)               missing data (Louis 1982), ḡ_l = Σ_i r_li g_li
//! ```
//!
//! D_li is the second derivative of the marker's place by the rotation, along d_li/s²: zero in the mean at the truth. Away
//! from the peak the likelihood is not concave; there the complete-data information takes its place, which makes the step one of
//! expectation-maximisation (uphill for certain), and the iteration ends where the observed one holds.

use super::{Document, matrix, measured, numbers, options, prior, reading, vector};
use lumenav::core::frame::ColumnKind;
use lumenav::core::laws::{check_information, check_model, check_sensor_is_deterministic, check_units};
use lumenav::core::pose::{exp_so3, oplus, skew};
use lumenav::core::{
    Column, ColumnSpec, Frame, FrontEnd, Instant, Linearization, Measurement, MeasurementModel,
    ModalityError, NominalState, Outcome, Part, PosePrior, RandomStreams, Reading, Rows, Schema, SimTime,
    StateView,
};
use lumenav::evaluation::consistency::across_runs::{AcrossRunsSummary, NeesAcrossRuns};
use lumenav::evaluation::consistency::quadratic_form;
use lumenav::fusion::{Eskf, Filter as _, Verdict};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix3x6, Matrix6, Translation3, Vector3, Vector6};
use rand_distr::{Distribution as _, StandardNormal};
use std::sync::Arc;

#[derive(Clone)]
pub(super) struct LineModel {
    pub(super) markers_capsule_m: Vec<Vector3<f64>>,
    pub(super) sigma_m: f64,
    pub(super) background: f64,
    pub(super) disc_radius_m: f64,
    /// The mistake that the law warns of: the missing information is not subtracted.
    complete_data: bool,
}

pub(super) fn schema() -> Arc<Schema> {
    Schema::events("lines/1", &["x_m", "y_m", "z_m", "ux_unit", "uy_unit", "uz_unit"])
}

pub(super) fn label_schema() -> Arc<Schema> {
    let marker = ColumnSpec { name: "marker_index".to_owned(), kind: ColumnKind::U32 };
    Arc::new(Schema { name: "line_labels/1".to_owned(), columns: vec![marker], rows: Rows::Events })
}

/// A point on a line, world m, and its unit direction.
pub(super) type Line = (Vector3<f64>, Vector3<f64>);

pub(super) fn frame(lines: &[Line]) -> Frame {
    let points = (0..3).map(|i| Column::F64(lines.iter().map(|line| line.0[i]).collect()));
    let directions = (0..3).map(|i| Column::F64(lines.iter().map(|line| line.1[i]).collect()));
    Frame::new(schema(), points.chain(directions).collect(), vec![true; lines.len()]).unwrap()
}

/// What is summed over lines.
struct Sums {
    gradient: Vector6<f64>,
    information: Matrix6<f64>,
    log_likelihood: f64,
    explained: f64,
}

/// A marker where the state puts it: place, and its derivatives by the pose's error.
struct Placed {
    at_world_m: Vector3<f64>,
    first: Matrix3x6<f64>,
    /// `∂²m/∂θ_j∂θ_k` at zero: `R ½(E_j E_k + E_k E_j) c`.
    second: [[Vector3<f64>; 3]; 3],
}

impl Placed {
    fn new(marker_capsule_m: &Vector3<f64>, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let mut first = Matrix3x6::zeros();
        first.fixed_columns_mut::<3>(0).fill_with_identity();
        first.fixed_columns_mut::<3>(3).copy_from(&-(rotation * skew(marker_capsule_m)));
        let axis = |j: usize| skew(&Vector3::from_fn(|i, _| f64::from(u8::from(i == j))));
        let second = [0, 1, 2].map(|j| {
            [0, 1, 2].map(|k| rotation * (axis(j) * axis(k) + axis(k) * axis(j)) * marker_capsule_m * 0.5)
        });
        Self { at_world_m: rotation * marker_capsule_m + pose.translation.vector, first, second }
    }
}

impl LineModel {
    fn sums(&self, value: &Frame, pose: &Isometry3<f64>) -> Result<Sums, ModalityError> {
        let columns = ["x_m", "y_m", "z_m", "ux_unit", "uy_unit", "uz_unit"].map(|name| value.f64(name));
        let [x, y, z, ux, uy, uz] = columns;
        let (x, y, z, ux, uy, uz) = (x?, y?, z?, ux?, uy?, uz?);
        let placed: Vec<Placed> =
            self.markers_capsule_m.iter().map(|marker| Placed::new(marker, pose)).collect();
        let mut sums = Sums {
            gradient: Vector6::zeros(),
            information: Matrix6::zeros(),
            log_likelihood: 0.0,
            explained: 0.0,
        };
        for l in (0..value.rows()).filter(|l| value.valid()[*l]) {
            self.add_line(
                &Vector3::new(x[l], y[l], z[l]),
                &Vector3::new(ux[l], uy[l], uz[l]),
                &placed,
                &mut sums,
            );
        }
        Ok(sums)
    }

    fn add_line(&self, point: &Vector3<f64>, direction: &Vector3<f64>, placed: &[Placed], sums: &mut Sums) {
        let variance = self.sigma_m.powi(2);
        let across = Matrix3::identity() - direction * direction.transpose();
        let peak = (1.0 - self.background) / placed.len() as f64 / (std::f64::consts::TAU * variance);
        let offsets: Vec<Vector3<f64>> =
            placed.iter().map(|marker| across * (marker.at_world_m - point)).collect();
        let densities: Vec<f64> =
            offsets.iter().map(|d| peak * (-0.5 * d.norm_squared() / variance).exp()).collect();
        let background = self.background / (std::f64::consts::PI * self.disc_radius_m.powi(2));
        let total = background + densities.iter().sum::<f64>();
        sums.log_likelihood += total.ln();
        let mut mean = Vector6::zeros();
        for ((marker, offset), density) in placed.iter().zip(&offsets).zip(&densities) {
            let share = density / total;
            let score = -(marker.first.transpose() * offset) / variance;
            mean += score * share;
            sums.explained += share;
            let mut complete = marker.first.transpose() * across * marker.first / variance;
            if self.complete_data {
                sums.information += complete * share;
                continue;
            }
            for j in 0..3 {
                for k in 0..3 {
                    complete[(3 + j, 3 + k)] += offset.dot(&marker.second[j][k]) / variance;
                }
            }
            sums.information += (complete - score * score.transpose()) * share;
        }
        sums.gradient += mean;
        if !self.complete_data {
            sums.information += mean * mean.transpose();
        }
    }
}

impl MeasurementModel for LineModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let mut sums = self.sums(&m.value, &pose)?;
        if sums.information.cholesky().is_none() {
            sums = Self { complete_data: true, ..self.clone() }.sums(&m.value, &pose)?;
        }
        Ok(Linearization::Information {
            parts: vec![Part::Pose(Instant::Now)],
            gradient: DVector::from_column_slice(sums.gradient.as_slice()),
            information: DMatrix::from_column_slice(6, 6, sums.information.as_slice()),
            log_likelihood: sums.log_likelihood,
            effective_count: sums.explained,
        })
    }

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

struct LineFrontEnd(Arc<LineModel>);

impl FrontEnd for LineFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        if reading.payload.rows() == 0 {
            return Ok(Outcome::Nothing);
        }
        Ok(Outcome::Measured(vec![Measurement::of_reading(reading, self.0.clone())]))
    }
}

fn document() -> Document {
    Document::parse(include_str!("../cross/lines_mixture.json"))
}

fn model(document: &Document) -> LineModel {
    LineModel {
        markers_capsule_m: document.rows("markers_capsule_m").iter().map(|m| vector(m)).collect(),
        sigma_m: document.number("sigma_m"),
        background: document.number("background"),
        disc_radius_m: document.number("disc_radius_m"),
        complete_data: false,
    }
}

fn window(sequence: u64, lines: &[Line]) -> Reading {
    let start = SimTime(50_000_000 * sequence as i64);
    reading("lines", sequence, (start, start + 50_000_000), frame(lines))
}

fn committed_window(document: &Document) -> Reading {
    let (points, directions) = (document.rows("points_m"), document.rows("directions"));
    let lines: Vec<_> = points.iter().zip(&directions).map(|(a, u)| (vector(a), vector(u))).collect();
    window(0, &lines)
}

fn committed_states(document: &Document) -> Vec<(NominalState, Document)> {
    let base = exp_so3(&vector(&document.numbers("rotation_vector_rad")));
    let states = document.0["states"].as_array().unwrap();
    states
        .iter()
        .map(|state| {
            let state = Document(state.clone());
            let rotation = base * exp_so3(&vector(&state.numbers("offset_rad")));
            let position = Translation3::from(vector(&numbers(&state.0["position_m"])));
            (NominalState::at_rest(Isometry3::from_parts(position, rotation)), state)
        })
        .collect()
}

#[test]
fn cross_mixture_of_500_lines_equals_40_digit_derivatives() {
    let document = document();
    let model = model(&document);
    let measurement = measured(&mut LineFrontEnd(Arc::new(model.clone())), &committed_window(&document));
    for (state, expected) in committed_states(&document) {
        let Linearization::Information { gradient, information, log_likelihood, effective_count, .. } =
            model.linearize(&measurement, &state).unwrap()
        else {
            panic!("lines have an information form")
        };
        assert!((log_likelihood / expected.number("log_likelihood") - 1.0).abs() < 1e-12);
        let theirs = DVector::from_vec(expected.numbers("gradient"));
        assert!((&gradient - &theirs).amax() < 1e-9 * theirs.amax());
        let theirs = matrix(&expected.rows("observed_information"));
        // Position (1/m²) and attitude (1/rad²) differ by 1e4: each block is compared in its own unit.
        for (row, column) in [(0, 0), (0, 3), (3, 3)] {
            let (a, b) = (information.view((row, column), (3, 3)), theirs.view((row, column), (3, 3)));
            let relative = (a - b).amax() / b.amax();
            assert!(relative < 1e-9, "information block ({row}, {column}): {relative:e}");
        }
        assert!(
            (effective_count - 350.0).abs() < 40.0,
            "{effective_count} of 500 lines explained, 30 % are background"
        );
    }
}

#[test]
fn law_line_model_derivatives_and_units() {
    check_units(&schema()).unwrap();
    check_units(&label_schema()).unwrap();
    let document = document();
    let model = model(&document);
    let measurement = measured(&mut LineFrontEnd(Arc::new(model.clone())), &committed_window(&document));
    for (state, _) in committed_states(&document) {
        check_model(&model, &measurement, &state, 1e-6).unwrap();
    }
}

#[test]
fn law_line_sensor_is_deterministic() {
    let model = model(&document());
    super::world::with_truth(|truth| {
        check_sensor_is_deterministic(
            &|| super::world::sensor(super::world::Lines { model: model.clone(), count: 50 }),
            truth,
            "lines",
            10,
        )
    })
    .unwrap();
}

/// Lines of a window seen from a pose, by a model.
fn draw(model: &LineModel, pose: &Isometry3<f64>, streams: &RandomStreams, k: u64) -> Vec<Line> {
    let mut stream = streams.stream("lines", k);
    (0..500)
        .map(|_| {
            let (point, direction, _) = super::world::draw_line(model, pose, &mut stream);
            (point, direction)
        })
        .collect()
}

/// The law that makes an information form honest: its mean is the covariance of the gradient (both are the expected
/// information). The complete-data form is far above it.
#[test]
fn law_observed_information_is_the_scatter_of_the_gradient() {
    let model = model(&document());
    let careless = LineModel { complete_data: true, ..model.clone() };
    let pose = Isometry3::new(Vector3::new(0.01, 0.0, -0.02), Vector3::new(0.4, -0.8, 0.3));
    let streams = RandomStreams::new(7, 0, "lines");
    let (mut observed, mut complete, mut scatter) = (Vec::new(), Vec::new(), Vec::new());
    // Position in mm, so that both blocks of the information have entries of a similar size.
    let scale = Vector6::new(1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.1);
    let scaled = |m: &Matrix6<f64>| {
        let scaled = Matrix6::from_diagonal(&scale) * m * Matrix6::from_diagonal(&scale);
        DMatrix::from_column_slice(6, 6, scaled.as_slice())
    };
    for k in 0..2000 {
        let lines = frame(&draw(&model, &pose, &streams, k));
        let sums = model.sums(&lines, &pose).unwrap();
        observed.push(scaled(&sums.information));
        scatter.push(scaled(&(sums.gradient * sums.gradient.transpose())));
        complete.push(scaled(&careless.sums(&lines, &pose).unwrap().information));
    }
    let mean =
        |all: &[DMatrix<f64>]| all.iter().fold(DMatrix::zeros(6, 6), |sum, m| sum + m) / all.len() as f64;
    // Relative standard error of a covariance from 2000 draws: about sqrt(2/2000) = 3 % per entry.
    check_information(&mean(&scatter), &observed, 0.08).unwrap();
    let (truly, claimed) = (mean(&observed).symmetric_eigenvalues(), mean(&complete).symmetric_eigenvalues());
    println!("information per window: observed {truly:.1?}, complete-data {claimed:.1?}");
    assert!(claimed.min() > 1.5 * truly.min(), "the complete data would claim more than there is");
}

/// NEES of the full pose over seeds: the start is drawn from the prior, the lines from the model; the capsule lies still.
fn nees(model: &LineModel, runs: u64, windows: u64) -> AcrossRunsSummary {
    let (sigma_m, sigma_rad) = (1e-3, 0.1);
    let start = Vector3::new(0.2, -0.1, 0.3);
    let prior = prior(sigma_m, &start, sigma_rad);
    let truthful = LineModel { complete_data: false, ..model.clone() };
    let mut collection = NeesAcrossRuns::new(6).unwrap();
    for seed in 0..runs {
        let streams = RandomStreams::new(seed, 0, "lines");
        let mut stream = streams.stream("start", 0);
        let offset = Vector6::from_fn(|i, _| {
            let normal: f64 = StandardNormal.sample(&mut stream);
            normal * if i < 3 { sigma_m } else { sigma_rad }
        });
        let truth = oplus(&Isometry3::from_parts(Translation3::identity(), exp_so3(&start)), &offset);
        let mut front_end = LineFrontEnd(Arc::new(model.clone()));
        // A prior that stands still: what moves the belief is the lines alone.
        let mut options = options(0.0, 0.0);
        options.initial_velocity_sigma_m_s.0 = 1e-9;
        options.initial_rate_sigma_rad_s.0 = 1e-9;
        options.max_iterations = 30;
        let mut filter = Eskf::new(options, Vec::new()).with_prior(&prior, SimTime::ZERO);
        let mut values = Vec::new();
        for k in 0..windows {
            let reading = window(k, &draw(&truthful, &truth, &streams, k));
            let offered = filter.offer(measured(&mut front_end, &reading));
            assert!(matches!(offered.verdict, Verdict::Accepted(_)), "{:?}", offered.verdict);
            let belief = filter.belief().unwrap();
            let error = lumenav::core::pose::ominus(&truth, &belief.state.world_from_capsule);
            let covariance: Matrix6<f64> = belief.covariance.fixed_view::<6, 6>(0, 0).into_owned();
            values.push(quadratic_form(&error, &covariance).unwrap());
        }
        collection.push_run((0..).zip(values));
    }
    collection.summary().unwrap()
}

#[test]
fn law_line_filter_is_consistent_and_the_complete_data_one_overconfident() {
    let model = model(&document());
    let honest = nees(&model, 60, 10);
    let careless = nees(&LineModel { complete_data: true, ..model }, 60, 10);
    println!("honest {honest:?}\ncareless {careless:?}");
    assert!(honest.share_inside_95 >= 0.9, "{honest:?}");
    assert!(careless.mean_per_dof > 1.3 && careless.share_above_95 >= 0.9, "{careless:?}");
}
