//! The lines as the filter's model: the laws of a model, and windows in which the likelihood has no top.

use lumenav_core::laws::{check_model, check_observed_information};
use lumenav_core::pose::exp_so3;
use lumenav_core::{
    Linearization, Measurement, MeasurementModel as _, Name, Node, NominalState, PriorUse, RandomStreams,
    SimTime,
};
use lumenav_pet::model::LinesModel;
use lumenav_pet::payload;
use lumenav_pet::tracking::likelihood::{Likelihood, Weights};
use lumenav_pet::tracking::noise::{BlockNoise, LineNoise, SourceNoise};
use lumenav_pet::tracking::window::{Preparation, Window};
use lumenav_pet::{Line, Scanner};
use nalgebra::{Isometry3, Point3, Translation3, UnitVector3, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::path::Path;
use std::sync::Arc;

const MARKERS_MM: [[f64; 3]; 3] = [[-12.0, 0.0, 0.0], [0.0, 5.0, 0.0], [3.0, -5.0, 0.0]];

fn pose() -> Isometry3<f64> {
    let turn = exp_so3(&Vector3::new(0.4, -0.9, 1.3));
    Isometry3::from_parts(Translation3::new(0.012, -0.02, 0.015), turn)
}

/// Lines of random directions that miss their markers by 2 mm per axis, and as many background lines as `background` says.
fn lines(markers: usize, background: usize, seed: u64) -> Vec<Line> {
    let mut random = RandomStreams::new(seed, 0, "lines").stream("offset", 0);
    let mut normal = |sigma: f64| -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * random.sample::<f64, _>(StandardNormal))
    };
    (0..markers + background)
        .map(|i| {
            let marker = pose() * Point3::from(Vector3::from(MARKERS_MM[i % 3]) * 1e-3);
            let along = UnitVector3::new_normalize(normal(1.0).component_mul(&Vector3::new(1.0, 1.0, 0.2)));
            let through = marker.coords + normal(if i < markers { 2e-3 } else { 40e-3 });
            Line {
                t_s: 1e-4 * i as f64,
                ends_world_m: [through - along.scale(0.44), through + along.scale(0.44)],
            }
        })
        .collect()
}

fn model(lines: &[Line]) -> LinesModel {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/allegro.toml");
    let scanner = Scanner::from_node(&Node::open(&file).unwrap()).unwrap();
    let noise = LineNoise::of_law(&scanner, &BlockNoise::reference(), &SourceNoise::default());
    let mut window = Window::default();
    window.prepare(lines, &noise, &Preparation::about(pose().translation.vector), 3).unwrap();
    LinesModel {
        likelihood: Arc::new(Likelihood::new(MARKERS_MM.map(|m| Vector3::from(m) * 1e-3).to_vec())),
        noise: Arc::new(noise),
        window: Arc::new(window),
        weights: Weights { shares: vec![1.0 / 3.0; 3], background: 0.2 },
    }
}

fn measurement(model: &LinesModel, lines: &[Line]) -> Measurement {
    Measurement {
        sensor: Name::from("scanner"),
        sequence: 0,
        at: SimTime::ZERO,
        arrival: SimTime::ZERO,
        since: None,
        value: Arc::new(payload::frame(lines).unwrap()),
        model: Arc::new(model.clone()),
        prior_use: PriorUse::StartOnly,
        fix: None,
        motion: None,
    }
}

#[test]
fn law_gradient_and_information_are_derivatives() {
    let lines = lines(240, 40, 1);
    let model = model(&lines);
    let m = measurement(&model, &lines);
    for offset in [[0.0; 3], [1e-3, -5e-4, 8e-4]] {
        let mut state = NominalState::at_rest(pose());
        state.world_from_capsule.translation.vector += Vector3::from(offset);
        check_model(&model, &m, &state, 1e-5).unwrap();
        check_observed_information(&model, &m, &state, 1e-4).unwrap();
    }
}

/// What counts of a line (`LineNoise::information_share`) counts in everything that the filter is given, and alike.
#[test]
fn law_of_what_lines_say_only_their_share_counts() {
    let lines = lines(240, 40, 5);
    let (full, mut half) = (model(&lines), model(&lines));
    Arc::make_mut(&mut half.noise).information_share = 0.5;
    let m = measurement(&full, &lines);
    let mut state = NominalState::at_rest(pose());
    state.world_from_capsule.translation.vector.x += 3e-4;
    let said = |model: &LinesModel| match model.linearize(&m, &state).unwrap() {
        Linearization::Information { gradient, information, log_likelihood, .. } => {
            (gradient, information, log_likelihood)
        }
        Linearization::Residual { .. } => panic!("lines are information"),
    };
    let ((g, i, l), (g_half, i_half, l_half)) = (said(&full), said(&half));
    assert!(g.norm() > 0.0 && (g * 0.5 - g_half).norm() == 0.0);
    assert!((i * 0.5 - i_half).norm() == 0.0);
    assert!((0.5 * l - l_half).abs() == 0.0);
    let expected = |model: &LinesModel| model.expected_information(&m, &state).unwrap().unwrap();
    assert!((expected(&full) * 0.5 - expected(&half)).norm() == 0.0);
}

/// Away from the peak, or with a handful of lines, the likelihood curves upwards somewhere: what the filter is given is still
/// semidefinite, and its gradient still exact.
#[test]
fn law_the_filter_is_never_given_negative_information() {
    for (count, seed) in [(4, 1), (6, 2), (9, 3), (60, 4)] {
        let lines = lines(count, 12, seed);
        let model = model(&lines);
        let m = measurement(&model, &lines);
        let mut negative = 0;
        for k in 0..40 {
            let mut state = NominalState::at_rest(pose());
            let k = f64::from(k);
            state.world_from_capsule.translation.vector +=
                Vector3::new(k.sin(), (1.7 * k).cos(), (0.3 * k).sin()) * 6e-3;
            check_model(&model, &m, &state, 1e-5).unwrap();
            let observed = model.evaluate(&state.world_from_capsule).information;
            negative += u32::from(observed.symmetric_eigenvalues().min() < 0.0);
            let Linearization::Information { information, .. } = model.linearize(&m, &state).unwrap() else {
                panic!("lines are information")
            };
            let scale = information.diagonal().amax();
            assert!(information.symmetric_eigenvalues().min() > -1e-9 * scale);
        }
        assert!(negative > 0, "this test looks at no window without a top");
    }
}
