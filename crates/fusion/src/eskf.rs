//! The error-state extended Kalman filter: an event log around belief and update.
//!
//! Everything that happens to the filter within the last `lag_s` seconds stands in a log in order of (time, kind, sensor,
//! sequence), each entry with the belief from before it. Something that arrives late is put in its place, the belief from
//! before it is taken back, and what follows is applied again (robot_localization's method). The belief is only ever
//! predicted from entry to entry, so any order of arrival within the lag gives the same bits.
//!
//! Life of a belief: it starts from the first measurement that carries a fix (or from `[track.prior]`), never from truth. It
//! is given up after `reacquire_after` refusals in a row, or when its position's standard deviation exceeds
//! `lost_position_sigma_m`; [`Eskf::predicted_pose`] then is `None`, front ends start cold, and the next fix starts it anew.

use crate::belief::Belief;
use crate::gate::Gate;
use crate::options::{EskfOptions, PriorOptions};
use crate::update::{Innovation, propose, worst_channels};
use lumenav_core::pose::exp_so3;
use lumenav_core::time::nanoseconds;
use lumenav_core::{
    BlockSpec, FixKind, Measurement, ModalityError, MotionInput, Name, PoseEstimate, PosePrior, PriorUse,
    PublishedEstimate, Reading, SimTime,
};
use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// How often what happened, since the start of the run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Measurements that entered the belief.
    pub accepted: u64,
    /// Measurements beyond the chi-square gate.
    pub gated: u64,
    /// Measurements and motion readings older than the lag.
    pub too_late: u64,
    /// Measurements that came before there was a belief and could not start one.
    pub not_started: u64,
    /// Measurements whose value contains the prior.
    pub contained_prior: u64,
    /// Updates whose algebra or model failed.
    pub failed: u64,
    /// Times a belief was started from a fix.
    pub starts: u64,
    /// Times a belief was given up.
    pub losses: u64,
}

/// Why a measurement was refused.
#[derive(Clone, Debug)]
pub enum Refused {
    /// Beyond the gate.
    Gate {
        /// The innovation.
        innovation: Innovation,
        /// The threshold it exceeded.
        threshold: f64,
        /// Channels that speak loudest against the prediction: index, standardised residual.
        worst_channels: Vec<(usize, f64)>,
    },
    /// Older than the lag by so many seconds.
    TooLate {
        /// How far behind, s.
        by_s: f64,
    },
    /// There is no belief and the measurement carries no fix.
    NotStarted,
    /// Its value contains the prior.
    ContainsPrior,
    /// It could not be computed.
    Failed(String),
}

/// What became of a measurement.
#[derive(Clone, Debug)]
pub enum Verdict {
    /// It entered the belief.
    Accepted(Innovation),
    /// It started the belief.
    Started,
    /// It did not enter.
    Refused(Refused),
}

/// The answer to an offered measurement.
#[derive(Clone, Debug)]
pub struct Offered {
    /// What became of it.
    pub verdict: Verdict,
    /// Whether the belief was given up because of it, and why.
    pub lost: Option<String>,
}

/// What an entry of the log does.
#[derive(Clone)]
enum Action {
    /// Keep a clone of the pose.
    Clone,
    /// Predict with a measured angular rate.
    Motion(Arc<Reading>, Arc<dyn MotionInput>),
    /// Update.
    Measure(Arc<Measurement>),
}

/// Order of the log: time, then kind, then sensor and sequence. Motion comes first (it brings the belief to that time), then
/// updates, then clones (of the updated pose).
type Key = (SimTime, u8, Name, u64);

struct Entry {
    key: Key,
    action: Action,
    /// State from before this entry; `None` before the start.
    before: Stage,
}

/// Belief and streak of refusals: what a replay takes back.
#[derive(Clone, Default)]
struct Stage {
    belief: Option<Belief>,
    refused_in_a_row: u32,
}

/// The error-state extended Kalman filter.
pub struct Eskf {
    options: EskfOptions,
    gate: Gate,
    stage: Stage,
    log: VecDeque<Entry>,
    blocks: Vec<BlockSpec>,
    wanted: BTreeMap<Name, Vec<SimTime>>,
    newest: SimTime,
    /// The instant of the prior, before which there is nothing; the beginning of time without one.
    begins: SimTime,
    arrived: SimTime,
    counters: Counters,
}

impl Eskf {
    /// A filter without a belief; `blocks` are the nuisance states that the track's front ends ask for.
    pub fn new(options: EskfOptions, blocks: Vec<BlockSpec>) -> Self {
        let gate = Gate::new(options.gate_probability.0);
        Self {
            options,
            gate,
            stage: Stage::default(),
            log: VecDeque::new(),
            blocks,
            wanted: BTreeMap::new(),
            newest: SimTime(i64::MIN),
            begins: SimTime(i64::MIN),
            arrived: SimTime(i64::MIN),
            counters: Counters::default(),
        }
    }

    /// Starts from `[track.prior]` at the scenario's start.
    pub fn with_prior(mut self, prior: &PriorOptions) -> Self {
        let rotation = Vector3::from(prior.rotation_vector_deg.map(|v| v.0.to_radians()));
        let mut covariance = Matrix6::zeros();
        for i in 0..3 {
            covariance[(i, i)] = (prior.position_sigma_mm.0 * 1e-3).powi(2);
            covariance[(3 + i, 3 + i)] = prior.rotation_sigma_deg.0.to_radians().powi(2);
        }
        let position = Vector3::from(prior.position_mm.map(|v| v.0 * 1e-3));
        let fix = PoseEstimate {
            world_from_capsule: Isometry3::from_parts(Translation3::from(position), exp_so3(&rotation)),
            covariance,
            kind: FixKind::Full,
        };
        let mut belief = self.fresh_belief(SimTime::ZERO, &fix);
        belief.state.velocity_world_m_s = Vector3::from(prior.velocity_mm_s.map(|v| v.0 * 1e-3));
        self.stage.belief = Some(belief);
        self.newest = SimTime::ZERO;
        self.begins = SimTime::ZERO;
        self
    }

    fn fresh_belief(&self, at: SimTime, fix: &PoseEstimate) -> Belief {
        let velocity = self.options.initial_velocity_sigma_m_s.0;
        let rate = self.options.initial_rate_sigma_rad_s.0;
        let mut belief = Belief::start(at, fix, velocity, rate);
        for block in &self.blocks {
            belief.add_block(block);
        }
        belief
    }

    /// Counters since the start.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The belief now; `None` before the start and after a loss.
    pub fn belief(&self) -> Option<&Belief> {
        self.stage.belief.as_ref()
    }

    /// The prediction at an instant, for a front end's start point; `None` where there is no belief, or the instant is older
    /// than the newest measurement (a late reading: its front end starts without help rather than from the future).
    pub fn predicted_pose(&self, at: SimTime) -> Option<PosePrior> {
        let mut belief = self.stage.belief.clone()?;
        if at < belief.at {
            return None;
        }
        belief.predict(at, &self.options.motion);
        let vague = belief.weakest_direction().0 > self.options.lost_position_sigma_m.0;
        (!vague).then(|| PosePrior { at, pose: belief.pose() })
    }

    /// The estimate at the belief's own time.
    pub fn estimate(&self) -> Option<PublishedEstimate> {
        let belief = self.stage.belief.as_ref()?;
        Some(PublishedEstimate {
            at: belief.at,
            available: self.arrived.max(belief.at),
            pose: belief.pose(),
            velocity_world_m_s: Some(belief.state.velocity_world_m_s),
        })
    }

    /// Tells which instants a sensor's front end wants clones of from now on. One older than the lag cannot be had any more; a
    /// measurement that refers to it will be refused.
    pub fn want_clones(&mut self, sensor: &Name, instants: Vec<SimTime>) {
        let old = self.wanted.insert(sensor.clone(), instants.clone()).unwrap_or_default();
        let oldest = self.oldest();
        for at in instants.into_iter().filter(|at| *at >= oldest && !old.contains(at)) {
            self.insert((at, 2, sensor.clone(), 0), Action::Clone);
        }
        self.drop_clones();
    }

    /// Drops clones that nobody wants and no replay can ask for. After a replay as well, which brings dropped ones back: the
    /// columns of the belief must not depend on the order of arrival.
    fn drop_clones(&mut self) {
        let keep_from = self.oldest();
        let wanted = &self.wanted;
        if let Some(belief) = &mut self.stage.belief {
            belief.retain_clones(&|at| at >= keep_from || wanted.values().any(|all| all.contains(&at)));
        }
    }

    /// The oldest instant that can still be put in its place.
    fn oldest(&self) -> SimTime {
        SimTime(self.newest.0.saturating_sub(nanoseconds(self.options.lag_s.0))).max(self.begins)
    }

    /// An inertial reading that drives the prediction.
    pub fn offer_motion(&mut self, reading: Reading, input: Arc<dyn MotionInput>) {
        if reading.interval.1 < self.oldest() {
            self.counters.too_late += 1;
            return;
        }
        self.arrived = self.arrived.max(reading.arrival);
        let key = (reading.interval.1, 0, reading.sensor.clone(), reading.sequence);
        self.insert(key, Action::Motion(Arc::new(reading), input));
    }

    /// A measurement. It is put in its place in time and the belief follows.
    pub fn offer(&mut self, measurement: Measurement) -> Offered {
        if measurement.prior_use == PriorUse::Contained {
            self.counters.contained_prior += 1;
            return Offered { verdict: Verdict::Refused(Refused::ContainsPrior), lost: None };
        }
        let oldest = self.oldest();
        if measurement.at < oldest {
            self.counters.too_late += 1;
            let by_s = oldest.since_s(measurement.at);
            return Offered { verdict: Verdict::Refused(Refused::TooLate { by_s }), lost: None };
        }
        self.arrived = self.arrived.max(measurement.arrival);
        let key = (measurement.at, 1, measurement.sensor.clone(), measurement.sequence);
        let offered = self.insert(key, Action::Measure(Arc::new(measurement)));
        // An entry that measures always answers.
        let offered =
            offered.unwrap_or(Offered { verdict: Verdict::Refused(Refused::NotStarted), lost: None });
        self.count(&offered);
        offered
    }

    fn count(&mut self, offered: &Offered) {
        let c = &mut self.counters;
        match &offered.verdict {
            Verdict::Accepted(_) => c.accepted += 1,
            Verdict::Started => c.starts += 1,
            Verdict::Refused(Refused::Gate { .. }) => c.gated += 1,
            Verdict::Refused(Refused::NotStarted) => c.not_started += 1,
            Verdict::Refused(Refused::Failed(_)) => c.failed += 1,
            Verdict::Refused(Refused::TooLate { .. } | Refused::ContainsPrior) => {}
        }
        c.losses += u64::from(offered.lost.is_some());
    }

    /// Puts an entry in its place, applies it and everything after it again; the entry's own answer.
    fn insert(&mut self, key: Key, action: Action) -> Option<Offered> {
        let place = self.log.partition_point(|entry| entry.key <= key);
        if let Some(next) = self.log.get(place) {
            self.stage = next.before.clone();
        }
        let at = key.0;
        self.log.insert(place, Entry { key, action, before: Stage::default() });
        let mut own = None;
        for index in place..self.log.len() {
            self.log[index].before = self.stage.clone();
            let action = self.log[index].action.clone();
            let answer = self.apply(self.log[index].key.0, &action);
            if index == place {
                own = answer;
            }
        }
        self.newest = self.newest.max(at);
        self.forget();
        self.drop_clones();
        own
    }

    /// Drops entries older than the lag.
    fn forget(&mut self) {
        let oldest = self.oldest();
        while self.log.front().is_some_and(|entry| entry.key.0 < oldest) {
            self.log.pop_front();
        }
    }

    fn apply(&mut self, at: SimTime, action: &Action) -> Option<Offered> {
        match action {
            Action::Clone => {
                if let Some(belief) = &mut self.stage.belief {
                    belief.predict(at, &self.options.motion);
                    belief.clone_pose();
                }
                None
            }
            Action::Motion(reading, input) => {
                self.apply_motion(at, reading, input.as_ref());
                None
            }
            Action::Measure(measurement) => Some(self.apply_measurement(measurement)),
        }
    }

    fn apply_motion(&mut self, at: SimTime, reading: &Reading, input: &dyn MotionInput) {
        let motion = self.options.motion;
        if let Some(belief) = &mut self.stage.belief {
            belief.predict(reading.interval.0, &motion);
            match input.sample(reading, &belief.state) {
                Ok(sample) => belief.predict_with_rate(at, &motion, &sample),
                // A reading that makes no sense drives nothing; the prediction goes on without it.
                Err(_) => belief.predict(at, &motion),
            }
        }
    }

    fn apply_measurement(&mut self, measurement: &Measurement) -> Offered {
        let Some(mut belief) = self.stage.belief.take() else { return self.start_from(measurement) };
        belief.predict(measurement.at, &self.options.motion);
        let (weakest, _) = belief.weakest_direction();
        if weakest > self.options.lost_position_sigma_m.0 {
            let mut offered = self.start_from(measurement);
            offered.lost = Some(format!(
                "position known to {:.0} mm only (limit {:.0} mm)",
                weakest * 1e3,
                self.options.lost_position_sigma_m.0 * 1e3
            ));
            return offered;
        }
        let verdict = self.update(&mut belief, measurement);
        let refused = matches!(verdict, Verdict::Refused(_));
        self.stage.refused_in_a_row = if refused { self.stage.refused_in_a_row + 1 } else { 0 };
        let lost = (self.stage.refused_in_a_row >= self.options.reacquire_after.max(1))
            .then(|| format!("{} measurements in a row were refused", self.stage.refused_in_a_row));
        if lost.is_some() {
            self.stage = Stage::default();
        } else {
            self.stage.belief = Some(belief);
        }
        Offered { verdict, lost }
    }

    fn start_from(&mut self, measurement: &Measurement) -> Offered {
        self.stage = Stage::default();
        let verdict = match &measurement.fix {
            Some(fix) => {
                self.stage.belief = Some(self.fresh_belief(measurement.at, fix));
                Verdict::Started
            }
            None => Verdict::Refused(Refused::NotStarted),
        };
        Offered { verdict, lost: None }
    }

    /// Proposes, gates and applies; the belief keeps its prediction where the measurement is refused.
    fn update(&mut self, belief: &mut Belief, measurement: &Measurement) -> Verdict {
        let proposal = match propose(belief, measurement, self.options.max_iterations) {
            Ok(proposal) => proposal,
            Err(error) => return failed(&error),
        };
        let innovation = proposal.innovation.clone();
        let threshold = self.gate.threshold(innovation.degrees_of_freedom);
        if innovation.chi_square.is_nan() || innovation.chi_square > threshold {
            let worst_channels = worst_channels(&proposal.first, 3);
            return Verdict::Refused(Refused::Gate { innovation, threshold, worst_channels });
        }
        if !proposal.is_sound() {
            return Verdict::Refused(Refused::Failed(
                "the update leaves numbers that are not finite".to_owned(),
            ));
        }
        proposal.apply(belief);
        Verdict::Accepted(innovation)
    }
}

fn failed(error: &ModalityError) -> Verdict {
    Verdict::Refused(Refused::Failed(error.to_string()))
}
