//! From a window of lines to a measurement.
//!
//! `mixture`, `rigid` and `fcm` answer with a pose of their own; the filter's prediction, where there is one, is a start point and
//! no evidence. `lines` hands the window to the filter as it is, with the mixture's likelihood as its model: below a hundred lines a
//! window alone has several poses that explain it, and only the likelihood itself, not one peak of it, can be weighed against a
//! prediction.
//!
//! A filter that holds a pose with two markers exchanged would go on holding it: near the wrong peak every window agrees. The
//! mixture therefore follows every window beside the filter and tests the orders of the markers over the last ones. Where it
//! settles on another pose than the filter's, the front end *insists*: it hands over that pose instead of lines until the filter,
//! which refuses it at first, has given up its belief and started from it. Where the prediction itself is vague, or nothing of the
//! window is where it points, the tracker's own pose is handed over as well.

mod points;
mod scene;

pub use points::PointFrontEnd;

use crate::config::{Installed, OptionsTable, Output, sources};
use crate::line::Line;
use crate::markers::MarkerSet;
use crate::model::{FixOfLines, LinesModel};
use crate::payload;
use crate::tracking::ClassicOptions;
use crate::tracking::budget::Budget;
use crate::tracking::climb::SharePrior;
use crate::tracking::fcm::Fcm;
use crate::tracking::likelihood::{Likelihood, Weights};
use crate::tracking::mixture::{FIRST_BACKGROUND, FOLLOWED_GAIN, Mixture, MixtureOptions, TEST_EVERY};
use crate::tracking::noise::{BlockErrors, LineNoise, SourceNoise};
use crate::tracking::points::Points;
use crate::tracking::rigid::Rigid;
use crate::tracking::window::{FEWEST_LINES, Preparation, Window};
use crate::tracking::{Failure, Limits, Memory, Prior, Reinitialized, Tracked, Tracker};
use lumenav_core::fix::FixModel;
use lumenav_core::pose::{ominus, oplus};
use lumenav_core::{
    Estimator, FixKind, FrontEnd, Measurement, MeasurementModel, ModalityError, Name, Outcome, PoseEstimate,
    PosePrior, Primitive, PriorUse, Reading, Setup,
};
use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Squared distance of two poses, in standard deviations, beyond which they are not the same: χ² of 6 at 0.9999.
const SAME_POSE: f64 = 27.86;

/// A filter that has not come round after so many windows is left alone: half a second at 20 Hz.
const LONGEST_INSISTENCE: u32 = 10;

/// Variance of an angle that nobody told, rad²: uniform on the circle.
const UNKNOWN_ANGLE_RAD2: f64 = std::f64::consts::PI * std::f64::consts::PI / 3.0;

/// What the front end keeps between windows, as it is written to a snapshot.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Kept {
    tracker: Memory,
    insisting: u32,
    since_order: u64,
}

/// The estimator side of a scanner, for a rigid set of markers.
pub struct PetFrontEnd {
    sensor: Name,
    output: Output,
    tracker: Box<dyn Tracker>,
    model: LinesModel,
    /// Some rotation maps the markers onto themselves.
    symmetric: bool,
    markers: MarkerSet,
    tracked: Tracked,
    lines: Vec<Line>,
    /// Where a bed has put the scanner, by the reading's encoder, m.
    scanner_world_m: Vector3<f64>,
    /// Most lines of a window that the filter is handed.
    most_lines: Option<usize>,
    /// Windows for which the front end has insisted on its own pose.
    insisting: u32,
    /// Windows since a test preferred another order of the markers than the filter's, counted from 1; 0: not lately.
    since_order: u64,
}

impl PetFrontEnd {
    /// A front end with a tracker of its own.
    pub fn new(
        sensor: Name,
        markers: MarkerSet,
        output: Output,
        tracker: Box<dyn Tracker>,
        model: LinesModel,
    ) -> Self {
        let symmetric = !markers.symmetries(SYMMETRIC_WITHIN_M, ACTIVITIES_ALIKE).is_empty();
        Self {
            sensor,
            output,
            tracker,
            model,
            symmetric,
            markers,
            tracked: Tracked::default(),
            lines: Vec::new(),
            scanner_world_m: Vector3::zeros(),
            most_lines: None,
            insisting: 0,
            since_order: 0,
        }
    }

    /// Hands the filter at most so many lines of a window.
    #[must_use]
    pub fn limited_to(self, most_lines: Option<usize>) -> Self {
        Self { most_lines, ..self }
    }

    /// Where the capsule was so many seconds before the last window, by the motion that a first pose from several windows came with:
    /// the late answer to windows that said too little by themselves.
    pub fn earlier(&self, seconds: f64) -> Isometry3<f64> {
        let pose = self.tracked.world_from_capsule;
        let Some(motion) = &self.tracked.motion else { return pose };
        let rates = [motion.velocity_world_m_s, motion.angular_rate_capsule_rad_s];
        oplus(&pose, &Vector6::from_fn(|i, _| -seconds * rates[i / 3][i % 3]))
    }

    /// What a pose of these markers can claim.
    fn kind(&self) -> FixKind {
        if self.symmetric { FixKind::Pointing } else { FixKind::Full }
    }

    /// The window as the filter's model, about a pose; [`Failure::TooFewLines`] where it holds too few.
    fn window_about(
        &self,
        pose: &Isometry3<f64>,
        prior: Option<&Prior>,
        at_s: f64,
    ) -> Result<LinesModel, Failure> {
        let centroid = pose * nalgebra::Point3::from(self.markers.centroid_capsule_m());
        let how = Preparation {
            about_world_m: centroid.coords,
            scanner_world_m: self.scanner_world_m,
            velocity_world_m_s: prior.map_or_else(Vector3::zeros, |p| p.velocity_world_m_s),
            at_s,
            budget: self.most_lines,
        };
        let mut window = Window::default();
        window.prepare(&self.lines, &self.model.noise, &how, FEWEST_LINES)?;
        Ok(LinesModel { window: Arc::new(window), ..self.model.clone() })
    }

    /// What the scanner is expected to see of each marker at a pose.
    fn expected_shares(&self, pose: &Isometry3<f64>, shares: &mut Vec<f64>) {
        let prior = SharePrior {
            shares: self.model.weights.shares.clone(),
            coverage: self.model.noise.coverage().clone(),
            scanner_world_m: self.scanner_world_m,
            background: FIRST_BACKGROUND,
        };
        prior.at(&self.model.likelihood, pose, shares);
    }

    /// Share of the background with the pose held fixed, by expectation-maximisation: how the lines divide where the tracker could
    /// not say.
    fn background_at(model: &mut LinesModel, pose: &Isometry3<f64>) {
        let near = model.window.near() as f64;
        for _ in 0..BACKGROUND_STEPS {
            let found = model.evaluate(pose);
            model.weights.background = share_of(found.background_lines, near);
        }
    }

    fn measured(
        &self,
        reading: &Reading,
        value: lumenav_core::Frame,
        model: Arc<dyn MeasurementModel>,
        fix: Option<PoseEstimate>,
        prior_use: PriorUse,
    ) -> Outcome {
        Outcome::Measured(vec![Measurement {
            sensor: self.sensor.clone(),
            sequence: reading.sequence,
            at: reading.at(),
            arrival: reading.arrival,
            since: None,
            value: Arc::new(value),
            model,
            prior_use,
            // Where the tracker has just found the pose from several windows, how it moved meanwhile.
            motion: fix.as_ref().and(self.tracked.motion.clone()),
            fix,
        }])
    }

    /// The tracker's pose as a fix.
    fn fix(&self) -> PoseEstimate {
        PoseEstimate {
            world_from_capsule: self.tracked.world_from_capsule,
            covariance: self.tracked.covariance,
            kind: FixKind::Full,
        }
        .limited_to(self.kind())
    }

    fn pose_outcome(&self, reading: &Reading, prior: Option<&Prior>) -> Outcome {
        let fix = self.fix();
        let used = self.tracked.prior_use;
        let model: Arc<dyn MeasurementModel> =
            match self.window_about(&self.tracked.world_from_capsule, prior, reading.at().seconds()) {
                Ok(mut lines) => {
                    lines.weights = self.weights(&lines.window);
                    Arc::new(FixOfLines(lines))
                }
                Err(_) => Arc::new(FixModel),
            };
        self.measured(reading, fix.to_frame(), model, Some(fix), used)
    }

    /// The tracker's shares; the background's is that among the lines of `window` that pass near.
    fn weights(&self, window: &Window) -> Weights {
        if self.tracked.shares.len() != self.markers.len() {
            return self.model.weights.clone();
        }
        // The tracker may have looked at fewer lines than the filter is handed: its share is that of all.
        let explained = (1.0 - self.tracked.background_share) * window.len() as f64;
        let near = window.near() as f64;
        Weights {
            shares: self.tracked.shares.clone(),
            background: share_of((near - explained).max(0.0), near),
        }
    }

    /// The lines for a filter that holds a pose already.
    fn lines_outcome(&mut self, reading: &Reading, prior: &Prior, tracked: &Result<(), Failure>) -> Outcome {
        if tracked.is_ok() && self.must_insist(prior) {
            self.insisting += 1;
            return self.pose_outcome(reading, Some(prior));
        }
        self.insisting = 0;
        if let Err(doubted @ Failure::Doubted { .. }) = tracked {
            // The lines would only say that the filter is near the peak that it is at.
            return refused(&doubted.to_string());
        }
        let about = prior.world_from_capsule;
        let mut model = match self.window_about(&about, Some(prior), reading.at().seconds()) {
            Ok(model) => model,
            Err(why) => return refused(&why.to_string()),
        };
        if tracked.is_ok() {
            model.weights = self.weights(&model.window);
        } else {
            // The tracker's shares are those of an earlier window.
            self.expected_shares(&about, &mut model.weights.shares);
            Self::background_at(&mut model, &about);
        }
        let found = model.evaluate(&about);
        let explained = found.effective_lines();
        let gain = found.log_likelihood - model.window.near() as f64 * model.window.background_per_m2.ln();
        let is_here = gain >= FOLLOWED_GAIN && explained >= FEWEST_EXPLAINED;
        if tracked.is_ok() && !is_here {
            // The prediction is too far off for the lines to say anything about it; the tracker found the capsule elsewhere.
            return self.pose_outcome(reading, Some(prior));
        }
        if gain < FOLLOWED_GAIN || gain.is_nan() {
            return refused(&Failure::NoEvidence { gain, needed: FOLLOWED_GAIN }.to_string());
        }
        if explained < FEWEST_EXPLAINED {
            let given = model.window.len();
            return refused(&format!(
                "{explained:.1} of {given} lines pass the markers; needed: {FEWEST_EXPLAINED}"
            ));
        }
        self.measured(reading, reading.payload.clone(), Arc::new(model), None, PriorUse::StartOnly)
    }

    /// Whether the tracker has settled on another pose than the filter's: it begins where the tracker has just found one by a search, or
    /// twice in a row by a test of the markers' order (its odds are twenty to one, and a filter that has followed the capsule for a while
    /// knows better than one of them), and ends where the filter has come round or will not.
    fn must_insist(&mut self, prior: &Prior) -> bool {
        let is_going_on = (1..LONGEST_INSISTENCE).contains(&self.insisting);
        let found = match self.tracked.reinitialized {
            Some(Reinitialized::LikelihoodFell) => true,
            Some(Reinitialized::Permutation) => std::mem::replace(&mut self.since_order, 1) > 0,
            _ => false,
        };
        if self.tracked.reinitialized != Some(Reinitialized::Permutation) && self.since_order > 0 {
            self.since_order += 1;
            if self.since_order > TEST_EVERY {
                self.since_order = 0;
            }
        }
        (found || is_going_on) && !self.agrees(prior)
    }

    fn agrees(&self, prior: &Prior) -> bool {
        let alike = std::iter::once(self.tracked.world_from_capsule).chain(
            self.tracked
                .ambiguous
                .iter()
                .filter(|r| r.log_likelihood_difference == 0.0)
                .map(|r| r.world_from_capsule),
        );
        let covariance = self.tracked.covariance + prior.covariance;
        let Some(factor) = covariance.cholesky() else { return true };
        alike.into_iter().any(|pose| {
            let error = ominus(&pose, &prior.world_from_capsule);
            error.dot(&factor.solve(&error)) < SAME_POSE
        })
    }
}

/// The front end of a track.
///
/// # Errors
/// [`ModalityError::Config`] with file, line and key.
pub(crate) fn build(
    installed: &Installed,
    options: &OptionsTable,
    setup: &Setup,
) -> Result<Estimator, ModalityError> {
    let errors =
        BlockErrors::of_block(&installed.scanner, &installed.scintillator, installed.table.end_points);
    let noise_of = |source: &SourceNoise| LineNoise::of_block(&installed.scanner, &errors, source);
    if options.front_end == Output::Points {
        // Tracers and calibration sources are not the capsule's markers.
        let points = Points::new(options.points as usize, noise_of(&SourceNoise::default()));
        let which = options.point as usize - 1;
        return Ok(Estimator::of_front_end(PointFrontEnd::new(setup.sensor.clone(), points, which)));
    }
    let markers = MarkerSet::from_capsule(&setup.capsule_model, &setup.sensor, 3)?;
    let source = SourceNoise::of_markers(&sources(&markers, setup)?);
    // Tracker and filter look at the same lines.
    let noise = Arc::new(noise_of(&source).wide_enough_for(&markers));
    let tracker = tracker(options, &markers, &noise);
    let likelihood = Arc::new(Likelihood::new(markers.positions_capsule_m()));
    let activity = markers.total_activity_bq();
    let shares = markers.markers.iter().map(|m| m.activity_bq / activity).collect();
    let model = LinesModel {
        likelihood,
        noise,
        window: Arc::default(),
        weights: Weights { shares, background: FIRST_BACKGROUND },
    };
    let front_end = PetFrontEnd::new(setup.sensor.clone(), markers, options.front_end, tracker, model);
    Ok(Estimator::of_front_end(front_end.limited_to(options.most_lines.map(|n| n as usize))))
}

fn tracker(options: &OptionsTable, markers: &MarkerSet, noise: &LineNoise) -> Box<dyn Tracker> {
    let most = options.most_lines.map(|n| n as usize);
    let classic = || {
        let default = ClassicOptions::default();
        ClassicOptions {
            budget: most.map_or(default.budget, Budget::AtMost),
            predict_failures: options.predict_failures,
            ..default
        }
    };
    match options.front_end {
        Output::Fcm => Box::new(Fcm::new(markers, classic())),
        Output::Rigid => Box::new(Rigid::new(markers, classic())),
        // Points have no tracker of a rigid set; they were built before.
        Output::Mixture | Output::Lines | Output::Points => {
            let mixture = MixtureOptions {
                budget: most.map_or(Budget::All, Budget::AtMost),
                test_permutations: options.predict_failures,
                estimate_markers: options.estimate_markers,
                start_windows: options.start_windows as usize,
                start_sigma_m: 1e-3 * options.start_sigma_mm.0,
                start_rate_sigma_rad_s: options.start_rate_sigma_rad_s.0,
                ..MixtureOptions::default()
            };
            Box::new(Mixture::new(markers, noise.clone(), mixture))
        }
    }
}

/// A share, with one line on each side before any was counted: neither may be without a voice.
fn share_of(lines: f64, of: f64) -> f64 {
    (lines + 1.0) / (of + 2.0)
}

/// A turn that brings the markers onto themselves within this cannot be told from none: a third of a line's noise (2 mm) over the
/// root of the lines that a marker has in a window (60).
const SYMMETRIC_WITHIN_M: f64 = 1e-4;
/// Activities that differ by less than this share do not tell markers apart: √60 lines of 60.
const ACTIVITIES_ALIKE: f64 = 0.15;
/// Steps of the expectation-maximisation of the background's share: what is left then is below a line.
const BACKGROUND_STEPS: u32 = 8;
/// Fewer lines than this do not say where three markers are, whatever the prediction.
const FEWEST_EXPLAINED: f64 = 4.0;

/// Whether a prediction is so uncertain that a climb from it may end at another order of the markers (a filter that has not seen the
/// roll for a while): then the tracker's own pose, found by a search or held from the last window, is handed over in place of lines.
/// The roll of markers that look alike after a turn is never told by a pose: of it nothing is asked.
fn is_vague(prior: &Prior, symmetric: bool) -> bool {
    let limits = Limits::default();
    let sigma = |from: usize, size: usize| {
        let block = prior.covariance.view((from, from), (size, size)).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    let rotation_rad = if symmetric { sigma(4, 2) } else { sigma(3, 3) };
    !(sigma(0, 3) <= limits.position_m && rotation_rad <= limits.rotation_rad)
}

/// The filter's prediction as a tracker takes it; what it does not know is as wide as a circle.
fn prior_of(prior: &PosePrior) -> Prior {
    let mut covariance: Matrix6<f64> = prior.pose.covariance;
    let unknown = match prior.pose.kind {
        FixKind::Position => 3..6,
        FixKind::Pointing => 3..4,
        FixKind::Full => 0..0,
    };
    for i in unknown {
        covariance[(i, i)] += UNKNOWN_ANGLE_RAD2;
    }
    Prior {
        world_from_capsule: prior.pose.world_from_capsule,
        covariance,
        velocity_world_m_s: prior.velocity_world_m_s.unwrap_or_default(),
        how: PriorUse::StartOnly,
    }
}

fn refused(why: &str) -> Outcome {
    Outcome::Refused { why: why.into() }
}

impl FrontEnd for PetFrontEnd {
    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        // What is no line is left out; the trackers count what is left.
        payload::lines(&reading.payload, &mut self.lines)?;
        let prior = prior.map(prior_of);
        let vague = prior.as_ref().is_some_and(|prior| is_vague(prior, self.symmetric));
        // Neither a prediction that does not know nor one that is contradicted is a place to start from.
        let hint = prior.as_ref().filter(|_| !vague && self.insisting == 0);
        let scanner = reading.known_poses.get(payload::SCANNER);
        self.scanner_world_m = scanner.map_or_else(Vector3::zeros, |pose| pose.translation.vector);
        self.tracker.scanner_at(&self.scanner_world_m);
        let tracked = self.tracker.track_into(&self.lines, hint, &mut self.tracked);
        Ok(match (self.output, &prior, tracked) {
            (Output::Lines, Some(prior), tracked) if !vague => self.lines_outcome(reading, prior, &tracked),
            (_, _, Ok(())) => self.pose_outcome(reading, hint),
            (_, _, Err(why)) => refused(&why.to_string()),
        })
    }

    fn resolves(&self) -> FixKind {
        self.kind()
    }

    fn snapshot(&self) -> Vec<u8> {
        let kept =
            Kept { tracker: self.tracker.memory(), insisting: self.insisting, since_order: self.since_order };
        // TOML reads every number back to the same bits. A memory of numbers always has a text.
        toml::to_string(&kept).unwrap_or_default().into_bytes()
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), ModalityError> {
        let kept: Kept = toml::from_slice(bytes).map_err(|_| ModalityError::Snapshot)?;
        self.tracker.recall(kept.tracker);
        self.insisting = kept.insisting;
        self.since_order = kept.since_order;
        Ok(())
    }

    fn scene(&self, out: &mut Vec<Primitive>) {
        let markers = &self.tracked.markers_world_m;
        let centre = if markers.is_empty() {
            self.tracked.world_from_capsule.translation.vector
        } else {
            markers.iter().sum::<Vector3<f64>>() / markers.len() as f64
        };
        out.push(scene::lines(&self.lines, &self.tracked.roles, &centre));
        if !markers.is_empty() {
            out.push(scene::markers(markers));
        }
    }
}
