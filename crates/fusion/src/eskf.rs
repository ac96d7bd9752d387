//! The error-state extended Kalman filter: an event log around belief and update.
//!
//! Everything that happens to the filter within the last `lag_s` seconds stands in a log in order of (time, kind, sensor,
//! sequence), each entry with the belief from before it. Something that arrives late is put in its place, the belief from
//! before it is taken back, and what follows is applied again (robot_localization's method). The belief is only ever
//! predicted from entry to entry, so any order of arrival within the lag gives the same bits.
//!
//! Life of a belief: it starts from the first measurement that carries a fix (or from `[track.prior]`), never from truth. It
//! is given up after `reacquire_after` refusals in a row of one sensor, unless another sensor that speaks about the position
//! was accepted within the lag (then the one is broken and not the belief), or when its position's standard deviation exceeds
//! `lost_position_sigma_m`; [`Filter::predicted_pose`] then is `None`, front ends start cold, and the next fix starts it anew.
//! Nuisance blocks outlive the loss with their own covariance, as a wrong pose says nothing against a sensor's bias; but for
//! a belief that was lost before it had been accepted as often as it takes to lose one: its blocks are under suspicion too.
//!
//! Where a replay makes or undoes a start or a loss that was told otherwise before, [`Filter::take_hindsight`] tells it.
//!
//! A measurement about an instant after everything that has arrived so far, itself included, claims to come from the future. It
//! is refused: once taken, it would make all others too late.

use crate::belief::{Belief, KeptBlocks};
use crate::filter::{Counters, Filter, FilterSetup, Hindsight, Offered, Refused, Turn, Verdict};
use crate::gate::Gate;
use crate::options::{EskfOptions, PriorOptions};
use crate::update::{propose, worst_channels};
use lumenav_core::pose::exp_so3;
use lumenav_core::time::nanoseconds;
use lumenav_core::{
    BlockSpec, ConfigError, FixKind, Instant, Linearization, Measurement, ModalityError, MotionEstimate,
    MotionInput, Name, Node, Part, PoseEstimate, PosePrior, PriorUse, PublishedEstimate, Reading, SimTime,
};
use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

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
    /// What was told of it.
    told: Told,
}

/// What an entry did to the life of the belief, when it was last applied.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Told {
    lost: bool,
    started: bool,
}

impl Told {
    fn of(offered: &Offered) -> Self {
        Self { lost: offered.lost.is_some(), started: matches!(offered.verdict, Verdict::Started) }
    }
}

/// What a replay takes back.
#[derive(Clone, Default)]
struct Stage {
    belief: Option<Belief>,
    /// Measurements accepted since the belief started.
    accepted: u32,
    streaks: BTreeMap<Name, Streak>,
    /// Blocks of the belief before this one.
    kept: Option<Arc<KeptBlocks>>,
}

/// How one sensor fares.
#[derive(Clone, Copy, Default)]
struct Streak {
    refused_in_a_row: u32,
    /// When it was last accepted and spoke about the position.
    vouched_at: Option<SimTime>,
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
    hindsight: Vec<Hindsight>,
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
            hindsight: Vec::new(),
        }
    }

    /// Starts from `[track.prior]` at an instant, that from which the scenario is observed.
    pub fn with_prior(mut self, prior: &PriorOptions, begins: SimTime) -> Self {
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
        let mut belief = self.fresh_belief(begins, &fix, None);
        belief.state.velocity_world_m_s = Vector3::from(prior.velocity_mm_s.map(|v| v.0 * 1e-3));
        self.stage.belief = Some(belief);
        self.newest = begins;
        self.begins = begins;
        self
    }

    fn fresh_belief(&self, at: SimTime, fix: &PoseEstimate, measured: Option<&MotionEstimate>) -> Belief {
        let velocity = self.options.initial_velocity_sigma_m_s.0;
        let rate = self.options.initial_rate_sigma_rad_s.0;
        let mut belief = Belief::start(at, fix, velocity, rate);
        if let Some(measured) = measured {
            belief = belief.moving(measured, velocity);
        }
        for block in &self.blocks {
            belief.add_block(block);
        }
        belief
    }

    /// The belief now; `None` before the start and after a loss.
    pub fn belief(&self) -> Option<&Belief> {
        self.stage.belief.as_ref()
    }

    /// The belief with everything up to `at` and nothing after it, brought to `at`.
    fn belief_at(&self, at: SimTime) -> Option<Belief> {
        if at < self.oldest() {
            return None;
        }
        let place = self.log.partition_point(|entry| entry.key.0 <= at);
        let stage = self.log.get(place).map_or(&self.stage, |next| &next.before);
        let mut belief = stage.belief.clone().filter(|belief| belief.at <= at)?;
        belief.predict(at, &self.options.motion);
        Some(belief)
    }

    fn published(&self, belief: &Belief) -> PublishedEstimate {
        PublishedEstimate {
            at: belief.at,
            available: self.arrived.max(belief.at),
            pose: belief.pose(),
            velocity_world_m_s: Some(belief.state.velocity_world_m_s),
        }
    }

    /// Why something about `at` that arrived at `arrival` cannot be taken for its time.
    fn untimely(&self, at: SimTime, arrival: SimTime) -> Option<Refused> {
        let (oldest, now) = (self.oldest(), self.arrived.max(arrival));
        if at > now {
            let ahead_s = at.since_s(now);
            return Some(Refused::Failed(format!("its instant lies {ahead_s:.3} s after its arrival")));
        }
        (at < oldest).then(|| Refused::TooLate { by_s: oldest.since_s(at) })
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

    fn count(&mut self, verdict: &Verdict) {
        let c = &mut self.counters;
        let counter = match verdict {
            Verdict::Accepted(_) => &mut c.accepted,
            Verdict::Started => &mut c.starts,
            Verdict::Refused(Refused::Gate { .. }) => &mut c.gated,
            Verdict::Refused(Refused::NotStarted) => &mut c.not_started,
            Verdict::Refused(Refused::Failed(_)) => &mut c.failed,
            Verdict::Refused(Refused::TooLate { .. }) => &mut c.too_late,
            Verdict::Refused(Refused::ContainsPrior) => &mut c.contained_prior,
        };
        *counter += 1;
    }

    /// Puts an entry in its place, applies it and everything after it again; the entry's own answer.
    fn insert(&mut self, key: Key, action: Action) -> Option<Offered> {
        let place = self.log.partition_point(|entry| entry.key <= key);
        if let Some(next) = self.log.get(place) {
            self.stage = next.before.clone();
        }
        let at = key.0;
        self.log.insert(place, Entry { key, action, before: Stage::default(), told: Told::default() });
        let mut own = None;
        for index in place..self.log.len() {
            self.log[index].before = self.stage.clone();
            let action = self.log[index].action.clone();
            let answer = self.apply(self.log[index].key.0, &action);
            let now = answer.as_ref().map(Told::of).unwrap_or_default();
            let told = std::mem::replace(&mut self.log[index].told, now);
            if index == place {
                own = answer;
            } else if let Some(answer) = answer.filter(|_| now != told) {
                self.look_back(index, told, answer);
            }
        }
        self.newest = self.newest.max(at);
        self.forget();
        self.drop_clones();
        own
    }

    /// Tells what a replay has changed of what was `told` of an entry.
    fn look_back(&mut self, index: usize, told: Told, answer: Offered) {
        let now = Told::of(&answer);
        let (at, _, sensor, _) = &self.log[index].key;
        let Offered { lost, given_up, .. } = answer;
        let loss = match lost {
            Some(why) if !told.lost => Some(Turn::Lost { why, given_up }),
            None if told.lost => Some(Turn::NotLost),
            _ => None,
        };
        let start = match (told.started, now.started) {
            (false, true) => Some(Turn::Started),
            (true, false) => Some(Turn::NotStarted),
            _ => None,
        };
        for turn in [loss, start].into_iter().flatten() {
            let c = &mut self.counters;
            match turn {
                Turn::Lost { .. } => c.losses += 1,
                Turn::NotLost => c.losses = c.losses.saturating_sub(1),
                Turn::Started => c.starts += 1,
                Turn::NotStarted => c.starts = c.starts.saturating_sub(1),
            }
            self.hindsight.push(Hindsight { at: *at, sensor: sensor.clone(), turn });
        }
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
            Action::Motion(reading, input) => self
                .apply_motion(at, reading, input.as_ref())
                .err()
                .map(|error| Offered::refused(Refused::Failed(error.to_string()))),
            Action::Measure(measurement) => Some(self.apply_measurement(measurement)),
        }
    }

    /// A reading that makes no sense drives nothing; the prediction goes on without it.
    fn apply_motion(
        &mut self,
        at: SimTime,
        reading: &Reading,
        input: &dyn MotionInput,
    ) -> Result<(), ModalityError> {
        let motion = self.options.motion;
        let Some(belief) = &mut self.stage.belief else { return Ok(()) };
        belief.predict(reading.interval.0, &motion);
        match input.sample(reading, &belief.state) {
            Ok(sample) => belief.predict_with_rate(at, &motion, &sample),
            Err(error) => {
                belief.predict(at, &motion);
                return Err(error);
            }
        }
        Ok(())
    }

    fn apply_measurement(&mut self, measurement: &Measurement) -> Offered {
        let Some(mut belief) = self.stage.belief.take() else { return self.start_from(measurement) };
        belief.predict(measurement.at, &self.options.motion);
        if let Some(weakest) = self.too_vague(&belief) {
            self.give_up(&belief);
            let mut offered = self.start_from(measurement);
            offered.lost = Some(format!(
                "position known to {:.0} mm only (limit {:.0} mm)",
                weakest * 1e3,
                self.options.lost_position_sigma_m.0 * 1e3
            ));
            return offered;
        }
        let (verdict, of_position) = self.update(&mut belief, measurement);
        let refused = matches!(verdict, Verdict::Refused(_));
        self.stage.accepted = self.stage.accepted.saturating_add(u32::from(!refused));
        let lost = self.follow_streak(measurement, refused, of_position);
        let mut given_up = None;
        if lost.is_some() {
            given_up = Some(Box::new(self.published(&belief)));
            self.give_up(&belief);
        } else {
            self.stage.belief = Some(belief);
        }
        Offered { verdict, lost, given_up }
    }

    /// Follows how a sensor fares; why the belief is to be given up, where it is.
    fn follow_streak(
        &mut self,
        measurement: &Measurement,
        refused: bool,
        of_position: bool,
    ) -> Option<String> {
        let streak = self.stage.streaks.entry(measurement.sensor.clone()).or_default();
        if !refused {
            streak.refused_in_a_row = 0;
            streak.vouched_at = of_position.then_some(measurement.at);
            return None;
        }
        streak.refused_in_a_row = streak.refused_in_a_row.saturating_add(1);
        let count = streak.refused_in_a_row;
        let since = measurement.at - nanoseconds(self.options.lag_s.0);
        let most = self.reacquire_after();
        // One refusal of a good sensor does not take back what it has vouched for within the lag; as many as lose a belief do.
        let vouches =
            |other: &Streak| other.refused_in_a_row < most && other.vouched_at.is_some_and(|at| at >= since);
        let mut others = self.stage.streaks.iter().filter(|(name, _)| **name != measurement.sensor);
        let vouched = others.any(|(_, other)| vouches(other));
        (count >= most && !vouched)
            .then(|| format!("{count} measurements in a row of sensor `{}` were refused", measurement.sensor))
    }

    /// The largest standard deviation of the position, m, where it is beyond the limit.
    fn too_vague(&self, belief: &Belief) -> Option<f64> {
        let limit_m = self.options.lost_position_sigma_m.0;
        // No variance is larger than their sum, which costs no eigenvalues.
        let sum_m2: f64 = (0..3).map(|i| belief.covariance[(i, i)]).sum();
        if sum_m2 < limit_m * limit_m {
            return None;
        }
        Some(belief.weakest_direction().0).filter(|weakest| *weakest > limit_m)
    }

    fn reacquire_after(&self) -> u32 {
        self.options.reacquire_after.max(1)
    }

    fn give_up(&mut self, belief: &Belief) {
        let held = self.stage.accepted >= self.reacquire_after();
        let kept = held.then(|| Arc::new(belief.kept_blocks()));
        self.stage = Stage { kept, ..Stage::default() };
    }

    fn start_from(&mut self, measurement: &Measurement) -> Offered {
        let Some(fix) = &measurement.fix else { return Offered::refused(Refused::NotStarted) };
        let mut belief = self.fresh_belief(measurement.at, fix, measurement.motion.as_ref());
        if let Some(kept) = &self.stage.kept {
            belief.restore_blocks(kept);
        }
        self.stage = Stage { belief: Some(belief), ..Stage::default() };
        Offered { verdict: Verdict::Started, lost: None, given_up: None }
    }

    /// Proposes, gates and applies; the belief keeps its prediction where the measurement is refused. Beside the verdict
    /// whether the measurement speaks about where the capsule is.
    fn update(&mut self, belief: &mut Belief, measurement: &Measurement) -> (Verdict, bool) {
        let proposal = match propose(belief, measurement, self.options.max_iterations) {
            Ok(proposal) => proposal,
            Err(error) => return (Verdict::Refused(Refused::Failed(error.to_string())), false),
        };
        let of_position = measurement.since.is_none() && speaks_of_position(&proposal.first, belief);
        let innovation = proposal.innovation.clone();
        let threshold = self.gate.threshold(innovation.degrees_of_freedom);
        if innovation.chi_square.is_nan() || innovation.chi_square > threshold {
            let worst_channels = worst_channels(&proposal.first, 3);
            return (Verdict::Refused(Refused::Gate { innovation, threshold, worst_channels }), of_position);
        }
        if !proposal.is_sound() {
            let why = "the update leaves numbers that are not finite".to_owned();
            return (Verdict::Refused(Refused::Failed(why)), of_position);
        }
        proposal.apply(belief);
        (Verdict::Accepted(innovation), of_position)
    }
}

/// Whether the position now stands in the measurement, as it does not in an attitude's.
fn speaks_of_position(linearization: &Linearization, belief: &Belief) -> bool {
    let now = Part::Pose(Instant::Now);
    match linearization {
        Linearization::Residual { jacobian, .. } => jacobian
            .iter()
            .any(|(part, matrix)| *part == now && matrix.columns_range(..3).iter().any(|v| *v != 0.0)),
        Linearization::Information { parts, information, .. } => {
            let before = parts.iter().take_while(|part| **part != now);
            let start: usize = before.filter_map(|part| belief.columns(part)).map(|(_, width)| width).sum();
            parts.contains(&now) && information.columns_range(start..start + 3).iter().any(|v| *v != 0.0)
        }
    }
}

impl Filter for Eskf {
    fn offer(&mut self, measurement: Measurement) -> Offered {
        let refused = if measurement.prior_use == PriorUse::Contained {
            Some(Refused::ContainsPrior)
        } else {
            self.untimely(measurement.at, measurement.arrival)
        };
        let offered = if let Some(why) = refused {
            Offered::refused(why)
        } else {
            self.arrived = self.arrived.max(measurement.arrival);
            let key = (measurement.at, 1, measurement.sensor.clone(), measurement.sequence);
            let offered = self.insert(key, Action::Measure(Arc::new(measurement)));
            // An entry that measures always answers.
            offered.unwrap_or(Offered::refused(Refused::NotStarted))
        };
        self.count(&offered.verdict);
        self.counters.losses += u64::from(offered.lost.is_some());
        offered
    }

    fn offer_motion(&mut self, reading: Reading, input: Arc<dyn MotionInput>) -> Option<Refused> {
        let refused = self.untimely(reading.interval.1, reading.arrival).or_else(|| {
            self.arrived = self.arrived.max(reading.arrival);
            let key = (reading.interval.1, 0, reading.sensor.clone(), reading.sequence);
            match self.insert(key, Action::Motion(Arc::new(reading), input))?.verdict {
                Verdict::Refused(why) => Some(why),
                Verdict::Accepted(_) | Verdict::Started => None,
            }
        })?;
        self.count(&Verdict::Refused(refused.clone()));
        Some(refused)
    }

    fn want_clones(&mut self, sensor: &Name, instants: Vec<SimTime>) {
        let old = self.wanted.insert(sensor.clone(), instants.clone()).unwrap_or_default();
        let oldest = self.oldest();
        for at in instants.into_iter().filter(|at| *at >= oldest && !old.contains(at)) {
            self.insert((at, 2, sensor.clone(), 0), Action::Clone);
        }
        self.drop_clones();
    }

    fn take_hindsight(&mut self) -> Vec<Hindsight> {
        std::mem::take(&mut self.hindsight)
    }

    fn predicted_pose(&self, at: SimTime) -> Option<PosePrior> {
        let belief = self.belief_at(at)?;
        let velocity_world_m_s = Some(belief.state.velocity_world_m_s);
        self.too_vague(&belief).is_none().then(|| PosePrior { at, pose: belief.pose(), velocity_world_m_s })
    }

    fn predicted_estimate(&self, at: SimTime) -> Option<PublishedEstimate> {
        let belief = self.belief_at(at)?;
        // What is known no better than this is no estimate: the next measurement starts anew.
        self.too_vague(&belief).is_none().then(|| self.published(&belief))
    }

    fn estimate(&self) -> Option<PublishedEstimate> {
        self.stage.belief.as_ref().map(|belief| self.published(belief))
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// The filter of a scenario's `[track.filter]`.
pub(crate) fn build(options: &Node, setup: &FilterSetup<'_>) -> Result<Option<Box<dyn Filter>>, ConfigError> {
    let mut eskf = Eskf::new(options.parse()?, setup.blocks.clone());
    if let Some(prior) = setup.prior {
        eskf = eskf.with_prior(&prior.parse::<PriorOptions>()?, setup.begins);
    }
    Ok(Some(Box::new(eskf)))
}
