//! One track: the front ends of its sensors and, where it has one, its filter.
//!
//! Every reading that is looked at is answered with an estimate, once there is one. Where the filter or the front end refuses
//! it, the estimate is the filter's prediction: a track is judged where it was wrong, too, and cannot look better by
//! refusing what contradicts it. A late reading changes what the filter believes of a time that it has published already;
//! such a step is a *revision*.

use crate::events::Refusal;
use lumenav_core::{
    BlockSpec, ConfigError, FixKind, FrontEnd, Measurement, ModalityError, MotionInput, Name, Node, Outcome,
    PosePrior, PublishedEstimate, Reading, SimTime,
};
use lumenav_fusion::{Filter, Hindsight, Offered, Refused, Turn, Verdict};
use std::sync::Arc;
use std::time::Instant;

/// Why a filter is not given a reading that shares time with the last one.
const REPEATED: &str = "its window overlaps the last one: a filter would count what they share twice";

/// Windows that follow each other may seem to share this, ns: their ends are rounded, here and in files.
const SLACK_NS: i64 = 1000;

/// What a track says after one reading.
#[derive(Debug, Default)]
pub struct Step {
    /// The estimate, where there is one: after a refusal the prediction, for an instant that none was published for.
    pub estimate: Option<PublishedEstimate>,
    /// The estimate is about an instant that this track has published before, and the reading about an earlier one: it came late.
    /// Whoever counts instants leaves it out.
    pub revision: bool,
    /// The measurement it came from.
    pub measurement: Option<Measurement>,
    /// Normalised innovation squared and its degrees of freedom.
    pub nis: Option<(f64, f64)>,
    /// Whether the belief was started by it.
    pub started: bool,
    /// Why it was refused.
    pub refusal: Option<Refusal>,
    /// Why the belief was given up.
    pub lost: Option<String>,
    /// Starts and losses at instants that had passed already, changed by what arrived late.
    pub hindsight: Vec<Hindsight>,
    /// Time spent, s.
    pub compute_s: f64,
}

/// What one sensor contributes.
pub struct Input {
    /// The sensor.
    pub sensor: Name,
    /// Makes measurements.
    pub front_end: Option<Box<dyn FrontEnd>>,
    /// Drives the prediction.
    pub motion_input: Option<Arc<dyn MotionInput>>,
    /// The interval of the last reading that entered the filter.
    pub taken: Option<(SimTime, SimTime)>,
}

impl Input {
    /// Whether a reading repeats a part of the last one: windows that overlap. Each by itself tells a pose; to a filter they would be
    /// independent measurements, and what they share would count twice.
    fn repeats(&self, interval: (SimTime, SimTime)) -> bool {
        self.taken.is_some_and(|taken| interval.0 + SLACK_NS < taken.1 && taken.0 + SLACK_NS < interval.1)
    }
}

/// A running track.
pub struct Track {
    /// Its name.
    pub name: Name,
    /// Its inputs in the file's order.
    pub inputs: Vec<Input>,
    filter: Option<Box<dyn Filter>>,
    /// The newest instant published.
    newest: SimTime,
    /// What was published last.
    latest: Option<PublishedEstimate>,
    /// Counts updates.
    pub updates: u64,
}

/// The nuisance states that the inputs of a track ask for.
pub fn blocks(inputs: &[Input]) -> Vec<BlockSpec> {
    let of = |input: &Input| {
        let measured = input.front_end.iter().flat_map(|f| f.blocks());
        measured.chain(input.motion_input.iter().flat_map(|m| m.blocks())).collect::<Vec<_>>()
    };
    inputs.iter().flat_map(of).collect()
}

impl Track {
    /// A track with its inputs and its filter, if it has one; `node` is its table in the file.
    ///
    /// # Errors
    /// [`ConfigError`] where a track without a filter has a sensor that makes no poses.
    pub fn new(
        name: Name,
        inputs: Vec<Input>,
        filter: Option<Box<dyn Filter>>,
        node: &Node,
    ) -> Result<Self, ConfigError> {
        if filter.is_none() && inputs.iter().any(|i| i.front_end.is_none()) {
            let message = "without a filter every sensor needs a front end that makes poses";
            return Err(node.error_at("sensors", message));
        }
        Ok(Self { name, inputs, filter, newest: SimTime(i64::MIN), latest: None, updates: 0 })
    }

    /// The filter, where there is one.
    pub fn filter(&self) -> Option<&dyn Filter> {
        self.filter.as_deref()
    }

    /// What it published of the newest instant, unless it has given that belief up: what a controller sees.
    pub fn latest(&self) -> Option<&PublishedEstimate> {
        self.latest.as_ref()
    }

    /// Takes one reading of one of its sensors.
    ///
    /// # Errors
    /// [`ModalityError`] where the reading does not fit the installed sensor.
    pub fn process(&mut self, reading: &Reading) -> Result<Vec<Step>, ModalityError> {
        let Some(input) = self.inputs.iter_mut().find(|i| i.sensor == reading.sensor) else {
            return Ok(Vec::new());
        };
        let begin = Instant::now();
        let mut steps = Vec::new();
        if let (Some(motion), Some(filter)) = (&input.motion_input, &mut self.filter)
            && let Some(refused) = filter.offer_motion(reading.clone(), motion.clone())
        {
            let refusal = Some(refusal(refused));
            steps.push(Step { refusal, compute_s: begin.elapsed().as_secs_f64(), ..Step::default() });
        }
        let repeats = self.filter.is_some() && input.repeats(reading.interval);
        let Some(front_end) = &mut input.front_end else { return Ok(self.with_hindsight(steps)) };
        if repeats {
            let refusal = Some(Refusal::FrontEnd { why: REPEATED.to_owned() });
            let estimate = self.predicted(reading.at(), reading.arrival);
            let step = Step { estimate, refusal, ..Step::default() };
            steps.push(self.published(step, reading.at()));
            return Ok(self.with_hindsight(steps));
        }
        let prior: Option<PosePrior> = self.filter.as_ref().and_then(|f| f.predicted_pose(reading.at()));
        let outcome = front_end.process(reading, prior.as_ref())?;
        if let Some(filter) = &mut self.filter {
            filter.want_clones(&reading.sensor, front_end.wanted_clones());
        }
        let spent = begin.elapsed().as_secs_f64();
        match outcome {
            Outcome::Nothing => {}
            Outcome::Refused { why } => {
                let refusal = Some(Refusal::FrontEnd { why: why.to_string() });
                let estimate = self.predicted(reading.at(), reading.arrival);
                let step = Step { estimate, refusal, compute_s: spent, ..Step::default() };
                steps.push(self.published(step, reading.at()));
            }
            Outcome::Measured(measurements) => {
                let share = spent / measurements.len().max(1) as f64;
                let taken: Vec<Step> = measurements.into_iter().map(|m| self.take(m, share)).collect();
                if taken.iter().any(|step| step.refusal.is_none()) {
                    self.entered(reading);
                }
                steps.extend(taken);
            }
        }
        Ok(self.with_hindsight(steps))
    }

    /// Keeps the time of a reading that the filter has taken.
    fn entered(&mut self, reading: &Reading) {
        if let Some(input) = self.inputs.iter_mut().find(|input| input.sensor == reading.sensor) {
            input.taken = Some(reading.interval);
        }
    }

    /// Adds what the reading changed of the past without a measurement of its own (a motion, a clone).
    fn with_hindsight(&mut self, mut steps: Vec<Step>) -> Vec<Step> {
        let late = self.filter.as_mut().map(|filter| filter.take_hindsight()).unwrap_or_default();
        match steps.last_mut() {
            Some(step) => step.hindsight.extend(late),
            None if !late.is_empty() => steps.push(Step { hindsight: late, ..Step::default() }),
            None => {}
        }
        steps
    }

    fn take(&mut self, measurement: Measurement, front_end_s: f64) -> Step {
        let begin = Instant::now();
        let at = measurement.at;
        let Some(filter) = &mut self.filter else {
            let step = Step::alone(measurement, front_end_s);
            return self.published(step, at);
        };
        let Offered { verdict, lost, given_up } = filter.offer(measurement.clone());
        let mut step = Step { lost, hindsight: filter.take_hindsight(), ..Step::default() };
        match verdict {
            Verdict::Accepted(innovation) => {
                step.nis = Some((innovation.chi_square, innovation.degrees_of_freedom));
                step.estimate = filter.estimate().or_else(|| step.last_word());
            }
            Verdict::Started => {
                step.started = true;
                step.estimate = filter.estimate().or_else(|| step.last_word());
            }
            // Older than anything that the filter still knows.
            Verdict::Refused(Refused::TooLate { by_s }) => step.refusal = Some(Refusal::TooLate { by_s }),
            Verdict::Refused(refused) => {
                step.refusal = Some(refusal(refused));
                step.estimate = match given_up {
                    Some(last) => Some(PublishedEstimate {
                        available: measurement.arrival.max(last.available),
                        ..*last
                    }),
                    None => self.predicted(at, measurement.arrival),
                };
            }
        }
        step.measurement = Some(measurement);
        step.compute_s = front_end_s + begin.elapsed().as_secs_f64();
        self.published(step, at)
    }

    /// What the filter says where something about `at` was refused: its prediction then, or the belief where that is newer.
    fn predicted(&self, at: SimTime, arrival: SimTime) -> Option<PublishedEstimate> {
        let filter = self.filter.as_ref()?;
        let newer = filter.estimate().filter(|estimate| estimate.at > at);
        let mut estimate = newer.or_else(|| filter.predicted_estimate(at))?;
        estimate.available = estimate.available.max(arrival);
        Some(estimate)
    }

    /// How much of a pose the sensors of this track can tell apart.
    fn resolves(&self) -> FixKind {
        let of_front_ends = self.inputs.iter().filter_map(|input| input.front_end.as_ref());
        of_front_ends.map(|front_end| front_end.resolves()).max().unwrap_or(FixKind::Full)
    }

    /// Follows which instants have been published; `about` is the instant of what the step came from.
    fn published(&mut self, mut step: Step, about: SimTime) -> Step {
        let resolved = self.resolves();
        if let Some(estimate) = &mut step.estimate {
            estimate.pose = estimate.pose.clone().limited_to(resolved);
            step.revision = estimate.at > about && estimate.at <= self.newest;
            self.newest = self.newest.max(estimate.at);
            if self.latest.as_ref().is_none_or(|latest| latest.at <= estimate.at) {
                self.latest = Some(estimate.clone());
            }
        }
        if step.lost.is_some() {
            // What was given up is nothing to steer by.
            self.latest = None;
        }
        step
    }
}

impl Step {
    /// Whether the belief that is published was started anew because of it, at its own instant or at a later one.
    pub fn starts_anew(&self) -> bool {
        self.started || self.hindsight.iter().any(|seen| matches!(seen.turn, Turn::Started))
    }

    /// What a belief said that is gone now: it was given up at an instant after the measurement that entered it.
    fn last_word(&self) -> Option<PublishedEstimate> {
        self.hindsight.iter().rev().find_map(|seen| match &seen.turn {
            Turn::Lost { given_up: Some(last), .. } => Some((**last).clone()),
            _ => None,
        })
    }

    /// A front end's own fix as the estimate of a track without a filter.
    fn alone(measurement: Measurement, compute_s: f64) -> Self {
        let Some(pose) = measurement.fix.clone() else {
            let (measurement, refusal) = (Some(measurement), Some(Refusal::NotStarted));
            return Self { measurement, refusal, compute_s, ..Self::default() };
        };
        let estimate = PublishedEstimate {
            at: measurement.at,
            available: measurement.arrival,
            pose,
            velocity_world_m_s: None,
        };
        Self { estimate: Some(estimate), measurement: Some(measurement), compute_s, ..Self::default() }
    }
}

fn refusal(refused: Refused) -> Refusal {
    match refused {
        Refused::Gate { innovation, threshold, worst_channels } => Refusal::Gate {
            chi_square: innovation.chi_square,
            degrees_of_freedom: innovation.degrees_of_freedom,
            threshold,
            worst_channels,
        },
        Refused::TooLate { by_s } => Refusal::TooLate { by_s },
        Refused::NotStarted => Refusal::NotStarted,
        Refused::ContainsPrior => Refusal::ContainsPrior,
        Refused::Failed(why) => Refusal::Failed { why },
    }
}
