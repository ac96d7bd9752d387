//! `metrics.json`: what a script wants to know of a run; and the same as a value.
//!
//! Keys are stable (schema 1); a figure that does not exist (no truth, no roll, no filter) is `null`. No wall times: equal
//! runs give equal files. Memory: 8 bytes per judged update for the position error, whose quantiles are exact; those of the other
//! figures are exact for short runs and good to half a thousandth for long ones; where `[expect]` asks for them, 8 bytes per step and per pair (`lumenav_evaluation::bounded`). Everything else is sums.
//!
//! *Availability* is the share of the truth's instants (in a replay: of the clock's) at which the last estimate that a measurement
//! has entered is at most [`FRESH_S`] old. *Latency* is the time between the instant an estimate is about and the one at which it was available.
//! *Errors* and *NEES* are taken at every published estimate, the predictions at refused measurements included: a filter does
//! not look better by refusing what it got wrong. *NIS* includes what the gate refused. Both as in
//! `lumenav_evaluation::consistency`; NEES with the degrees of freedom that most of the estimates had. The bound (and RMSE
//! over it) belongs to tracks without a filter: a filter knows more than its last measurement. *Drift* is the error of
//! displacements over the truth's path, from pairs [`DRIFT_SPAN_M`] apart.

use crate::error::ReportError;
use crate::expected::{Expectations, Plausibility};
use crate::file::write_json;
use crate::log::refusal_reason;
use crate::motion::{ErrorsBySegment, Motion, MotionFigures, SegmentErrors};
use lumenav_core::{Name, Rows, SimTime};
use lumenav_evaluation::bound::EfficiencyAccumulator;
use lumenav_evaluation::bounded::BoundedQuantiles;
use lumenav_evaluation::consistency::one_run::{NeesAccumulator, NeesSummary, NisAccumulator};
use lumenav_evaluation::consistency::verdict::Verdict;
use lumenav_evaluation::displacement::{DisplacementErrors, Span};
use lumenav_evaluation::summary::{Quantiles, ScalarSummary};
use lumenav_pipeline::events::PeriodTable;
use lumenav_pipeline::{ObserverError, Refusal, RunEvent, RunHeader, RunObserver, TrackUpdate};
use nalgebra::{Isometry3, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Time over which the relative error is taken, s.
pub const RELATIVE_SPAN_S: f64 = 1.0;

/// Path of the truth over which relative error and drift are taken, m: the distance a contraction moves a capsule.
pub const DRIFT_SPAN_M: f64 = 0.01;

/// An estimate older than this is no estimate of where the capsule is.
pub const FRESH_S: f64 = 1.0;

/// `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Version of the keys.
    pub schema: u32,
    /// The scenario.
    pub scenario: String,
    /// The seed.
    pub seed: u64,
    /// The trial within a Monte Carlo.
    pub trial: u64,
    /// Simulated time, s.
    pub duration_s: f64,
    /// From where the scenario was observed, s: figures are of what came then.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub observe_from_s: f64,
    /// Figures per track.
    pub tracks: BTreeMap<String, TrackMetrics>,
    /// What the sensors delivered.
    pub sensors: BTreeMap<String, SensorMetrics>,
    /// How far the controllers moved their sensors; absent where there are none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub controllers: BTreeMap<String, ControllerMetrics>,
    /// How the capsule moved along the tract; absent where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionFigures>,
    /// What the scenario expects of the motion (`[expect]`), checked.
    #[serde(default)]
    pub expected: Expectations,
}

/// What one controller did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControllerMetrics {
    /// Decisions that it took.
    pub decisions: u64,
    /// Times that it set its sensor in motion.
    pub starts: u64,
    /// Way of the sensor, mm.
    pub travel_mm: f64,
    /// From where to where along z, mm.
    pub range_z_mm: [f64; 2],
}

/// A controller being watched.
#[derive(Debug, Default)]
struct Watched {
    figures: ControllerMetrics,
    last_m: Option<Vector3<f64>>,
    moving: bool,
}

impl Watched {
    fn see(&mut self, world_from_sensor: &Isometry3<f64>, twist_world: &Vector6<f64>) {
        let place_m = world_from_sensor.translation.vector;
        let z_mm = 1e3 * place_m.z;
        let [low, high] = &mut self.figures.range_z_mm;
        (*low, *high) = if self.last_m.is_none() { (z_mm, z_mm) } else { (low.min(z_mm), high.max(z_mm)) };
        self.figures.travel_mm += self.last_m.map_or(0.0, |last| 1e3 * (place_m - last).norm());
        self.last_m = Some(place_m);
        let moving = twist_world.norm() > 0.0;
        self.figures.starts += u64::from(moving && !self.moving);
        self.moving = moving;
        self.figures.decisions += 1;
    }
}

/// What one sensor delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SensorMetrics {
    /// Readings that arrived.
    pub readings: u64,
    /// Readings that were due and did not arrive, or could not be read.
    pub missing: u64,
    /// Events (lines of response, decoded rows) in all readings; absent where readings are of channels.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub events: u64,
}

fn is_zero<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// The figures of one track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackMetrics {
    /// Norm of the position error.
    pub position_error_mm: Option<ScalarSummary>,
    /// Position error along the world's axes.
    pub position_error_per_axis_mm: Option<PerAxis>,
    /// Angle of the whole attitude error; `null` where roll is not observable.
    pub attitude_error_deg: Option<ScalarSummary>,
    /// Angle between estimated and true x axis.
    pub heading_error_deg: Option<ScalarSummary>,
    /// Error of the displacement over one second.
    pub relative_error_1s_mm: Option<ScalarSummary>,
    /// Error of the displacement over 10 mm of the truth's path.
    pub relative_error_10mm_mm: Option<ScalarSummary>,
    /// Sum of the latter over that path, percent.
    pub drift_percent: Option<f64>,
    /// Magnitude of the error along the tract.
    pub along_tract_error_mm: Option<ScalarSummary>,
    /// Share of the time with an estimate that is at most one second old, 0 to 1.
    pub availability: Option<f64>,
    /// Updates that could not be computed.
    pub failed_updates: u64,
    /// Estimates that a measurement has entered.
    pub updates: u64,
    /// Estimates that were judged: updates, and predictions at refused measurements.
    pub judged: u64,
    /// Estimates that the truth holds nothing about: it begins later, ends earlier or has a gap. 0 where there is no truth at all.
    #[serde(default)]
    pub unjudged: u64,
    /// Starts and restarts.
    pub starts: u64,
    /// Readings and measurements that did not enter, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Innovations against their claimed covariance.
    pub nis: Option<NisFigures>,
    /// Errors against the claimed covariance.
    pub nees: Option<NeesFigures>,
    /// `consistent`, `overconfident: …` or `cautious: …`; `null` without truth.
    pub verdict: Option<Verdict>,
    /// Position RMSE over the root mean trace of the bound; tracks without a filter only.
    pub rmse_over_bound: Option<f64>,
    /// Root mean square of error over root trace of the bound at each estimate: no place with a poor bound hides the rest.
    pub rms_of_error_over_bound: Option<f64>,
    /// Time from the instant an estimate is about until it was available.
    pub latency_ms: Option<ScalarSummary>,
    /// When the first estimate was available, from where the scenario was observed.
    pub time_to_first_fix_s: Option<f64>,
    /// The same over stretches of the run that the scenario names (`[[period]]`).
    #[serde(default)]
    pub periods: BTreeMap<String, PeriodFigures>,
    /// The same over the segments of a tract, in the order in which they were entered.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<SegmentErrors>,
}

/// Errors over a stretch of the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeriodFigures {
    /// Its first instant, s.
    pub from_s: f64,
    /// Its end, s.
    pub to_s: f64,
    /// Estimates about instants in it that were judged.
    pub judged: u64,
    /// Share of its time with an estimate that is at most one second old, 0 to 1.
    pub availability: Option<f64>,
    /// Norm of the position error.
    pub position_error_mm: Option<ScalarSummary>,
    /// Angle between estimated and true x axis.
    pub heading_error_deg: Option<ScalarSummary>,
}

/// Error figures along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PerAxis {
    /// To the patient's right at the start.
    pub x: AxisError,
    /// Anterior.
    pub y: AxisError,
    /// Superior.
    pub z: AxisError,
}

/// The error along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisError {
    /// Mean of estimate minus truth.
    pub bias: f64,
    /// Root mean square.
    pub rmse: f64,
}

/// NIS in one run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NisFigures {
    /// Mean.
    pub mean: f64,
    /// Mean degrees of freedom: what the mean should be.
    pub dof: f64,
    /// Share of updates inside the 95 % band, 0 to 1.
    pub inside_95: f64,
}

/// NEES in one run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeesFigures {
    /// Mean.
    pub mean: f64,
    /// Degrees of freedom: what the mean should be.
    pub dof: usize,
    /// Share of updates inside the 95 % band, 0 to 1.
    pub inside_95: f64,
}

/// Collects the figures of one track over a stretch of the run.
struct PeriodCollector {
    period: PeriodTable,
    position_mm: Quantiles,
    heading_deg: BoundedQuantiles,
    judged: u64,
    instants: u64,
    instants_fresh: u64,
}

impl PeriodCollector {
    fn new(period: &PeriodTable) -> Self {
        Self {
            period: period.clone(),
            position_mm: Quantiles::new(),
            heading_deg: BoundedQuantiles::new(),
            judged: 0,
            instants: 0,
            instants_fresh: 0,
        }
    }

    fn figures(&mut self) -> PeriodFigures {
        PeriodFigures {
            from_s: self.period.from_s.0,
            to_s: self.period.to_s.0,
            judged: self.judged,
            availability: (self.instants > 0).then(|| self.instants_fresh as f64 / self.instants as f64),
            position_error_mm: self.position_mm.summary(),
            heading_error_deg: self.heading_deg.summary(),
        }
    }
}

/// Collects the figures of one track.
struct Collector {
    position_mm: Quantiles,
    heading_deg: BoundedQuantiles,
    attitude_deg: BoundedQuantiles,
    along_tract_mm: BoundedQuantiles,
    latency_ms: BoundedQuantiles,
    relative_time: DisplacementErrors,
    relative_path: DisplacementErrors,
    axis_sums: [f64; 3],
    axis_squares: [f64; 3],
    axis_count: u64,
    nis: NisAccumulator,
    nees: BTreeMap<usize, NeesAccumulator>,
    efficiency: EfficiencyAccumulator,
    refused: BTreeMap<String, u64>,
    updates: u64,
    judged: u64,
    unjudged: u64,
    starts: u64,
    last_estimate: Option<SimTime>,
    first_available: Option<SimTime>,
    instants: u64,
    instants_fresh: u64,
    periods: Vec<PeriodCollector>,
    segments: ErrorsBySegment,
}

impl Collector {
    fn new(periods: &[PeriodTable]) -> Self {
        Self {
            position_mm: Quantiles::new(),
            heading_deg: BoundedQuantiles::new(),
            attitude_deg: BoundedQuantiles::new(),
            along_tract_mm: BoundedQuantiles::new(),
            latency_ms: BoundedQuantiles::new(),
            relative_time: DisplacementErrors::over(Span::Seconds(RELATIVE_SPAN_S)),
            relative_path: DisplacementErrors::over(Span::Metres(DRIFT_SPAN_M)),
            axis_sums: [0.0; 3],
            axis_squares: [0.0; 3],
            axis_count: 0,
            nis: NisAccumulator::new(),
            nees: BTreeMap::new(),
            efficiency: EfficiencyAccumulator::new(),
            refused: BTreeMap::new(),
            updates: 0,
            judged: 0,
            unjudged: 0,
            starts: 0,
            last_estimate: None,
            first_available: None,
            instants: 0,
            instants_fresh: 0,
            periods: periods.iter().map(PeriodCollector::new).collect(),
            segments: ErrorsBySegment::default(),
        }
    }

    fn update(&mut self, update: &TrackUpdate<'_>) -> Result<(), lumenav_evaluation::EvaluationError> {
        let estimate = update.estimate;
        self.updates += u64::from(update.accepted);
        self.starts += u64::from(update.started);
        if update.started {
            // What lies between two beliefs is no displacement.
            self.relative_time.interrupt();
            self.relative_path.interrupt();
        }
        // A prediction that stands in for a refused measurement is judged, but nobody has seen the capsule.
        if update.accepted {
            self.last_estimate = self.last_estimate.max(Some(estimate.at));
            self.first_available.get_or_insert(estimate.available);
        }
        self.latency_ms.push(1e3 * estimate.available.since_s(estimate.at));
        if let Some((nis, dof)) = update.nis {
            self.innovation(nis, dof)?;
        }
        let (Some(error), Some(truth)) = (update.error, update.truth) else {
            self.unjudged += u64::from(update.truth.is_none());
            return Ok(());
        };
        self.judged += 1;
        self.displacement(update, truth.world_from_capsule.translation.vector);
        let mm = 1e3 * error.position_world_m;
        self.position_mm.push(mm.norm());
        if mm.iter().all(|x| x.is_finite()) {
            self.axis_count += 1;
            for axis in 0..3 {
                self.axis_sums[axis] += mm[axis];
                self.axis_squares[axis] += mm[axis] * mm[axis];
            }
        }
        self.heading_deg.extend(error.heading_rad.map(f64::to_degrees));
        let at_s = estimate.at.seconds();
        for period in self.periods.iter_mut().filter(|p| p.period.contains(at_s)) {
            period.judged += 1;
            period.position_mm.push(mm.norm());
            period.heading_deg.extend(error.heading_rad.map(f64::to_degrees));
        }
        self.segments.see(truth.segment.as_deref(), mm.norm(), error.heading_rad.map(f64::to_degrees));
        self.attitude_deg.extend(error.attitude_rad.map(f64::to_degrees));
        self.along_tract_mm.extend(error.along_tract_m.map(|m| 1e3 * m.abs()));
        if let Some(bound_m2) = error.bound_position_m2 {
            self.efficiency.push(error.position_world_m.norm(), bound_m2);
        }
        let dof = error.nees_degrees_of_freedom;
        if dof > 0 {
            let nees = match self.nees.entry(dof) {
                std::collections::btree_map::Entry::Occupied(nees) => nees.into_mut(),
                std::collections::btree_map::Entry::Vacant(place) => place.insert(NeesAccumulator::new(dof)?),
            };
            // Without a value the covariance was none: counted as such.
            match error.nees {
                Some(value) => nees.push(value),
                None => nees.push_unusable(),
            }
        }
        Ok(())
    }

    /// An innovation, before the gate.
    fn innovation(&mut self, nis: f64, dof: f64) -> Result<(), lumenav_evaluation::EvaluationError> {
        // An information-form measurement is worth a fractional count; the band needs a whole one.
        self.nis.push(nis, (dof.round() as usize).max(1))
    }

    fn displacement(&mut self, update: &TrackUpdate<'_>, truth_m: Vector3<f64>) {
        let estimate_m = update.estimate.pose.world_from_capsule.translation.vector;
        for relative in [&mut self.relative_time, &mut self.relative_path] {
            relative.push(update.estimate.at.seconds(), estimate_m, truth_m);
        }
    }

    fn refusal(&mut self, why: &Refusal) -> Result<(), lumenav_evaluation::EvaluationError> {
        *self.refused.entry(refusal_reason(why).to_owned()).or_default() += 1;
        match why {
            Refusal::Gate { chi_square, degrees_of_freedom, .. } => {
                self.innovation(*chi_square, *degrees_of_freedom)
            }
            _ => Ok(()),
        }
    }

    /// An instant at which the track should know where the capsule is.
    fn instant(&mut self, at: SimTime) {
        let fresh = u64::from(self.last_estimate.is_some_and(|last| at.since_s(last) <= FRESH_S));
        self.instants += 1;
        self.instants_fresh += fresh;
        for period in self.periods.iter_mut().filter(|p| p.period.contains(at.seconds())) {
            period.instants += 1;
            period.instants_fresh += fresh;
        }
    }

    /// The NEES of the degrees of freedom that most updates had.
    fn nees(&self) -> Option<NeesSummary> {
        let all = self.nees.values().filter_map(NeesAccumulator::summary);
        all.max_by_key(|nees| nees.updates + nees.not_positive_definite)
    }

    fn per_axis(&self) -> Option<PerAxis> {
        let n = self.axis_count as f64;
        let axis =
            |i: usize| AxisError { bias: self.axis_sums[i] / n, rmse: (self.axis_squares[i] / n).sqrt() };
        (self.axis_count > 0).then(|| PerAxis { x: axis(0), y: axis(1), z: axis(2) })
    }

    fn metrics(&mut self, has_truth: bool, observe_from_s: f64) -> TrackMetrics {
        let nees = self.nees();
        TrackMetrics {
            position_error_mm: self.position_mm.summary(),
            position_error_per_axis_mm: self.per_axis(),
            attitude_error_deg: self.attitude_deg.summary(),
            heading_error_deg: self.heading_deg.summary(),
            relative_error_1s_mm: self.relative_time.summary_m().map(|s| s.scaled(1e3)),
            relative_error_10mm_mm: self.relative_path.summary_m().map(|s| s.scaled(1e3)),
            drift_percent: self.relative_path.drift_share().map(|share| 100.0 * share),
            along_tract_error_mm: self.along_tract_mm.summary(),
            availability: (self.instants > 0).then(|| self.instants_fresh as f64 / self.instants as f64),
            failed_updates: self.refused.get("failed").copied().unwrap_or(0),
            updates: self.updates,
            judged: self.judged,
            unjudged: if has_truth { self.unjudged } else { 0 },
            starts: self.starts,
            refused: self.refused.clone(),
            nis: self.nis.summary().filter(|nis| nis.updates > 0).map(|nis| {
                let dof = nis.total_dof as f64 / nis.updates as f64;
                NisFigures { mean: nis.mean_per_dof * dof, dof, inside_95: nis.inside_95 }
            }),
            nees: nees.as_ref().map(|n| NeesFigures { mean: n.mean, dof: n.dof, inside_95: n.inside_95 }),
            verdict: nees.as_ref().map(Verdict::of_run),
            rmse_over_bound: self.efficiency.efficiency().map(|e| e.rmse_over_bound),
            rms_of_error_over_bound: self.efficiency.efficiency().map(|e| e.rms_of_ratios),
            latency_ms: self.latency_ms.summary(),
            time_to_first_fix_s: self.first_available.map(|at| at.seconds() - observe_from_s),
            periods: self.periods.iter_mut().map(|p| (p.period.name.clone(), p.figures())).collect(),
            segments: self.segments.figures(),
        }
    }
}

/// Collects the metrics of a run; writes `metrics.json` where it was given a folder.
#[derive(Default)]
pub struct MetricsObserver {
    path: Option<PathBuf>,
    header: Option<RunHeader>,
    tracks: BTreeMap<Name, Collector>,
    sensors: BTreeMap<Name, SensorMetrics>,
    controllers: BTreeMap<Name, Watched>,
    plausibility: Plausibility,
    motion: Motion,
    last: SimTime,
    result: Option<Metrics>,
}

impl MetricsObserver {
    /// Writes `metrics.json` into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self { path: Some(folder.join("metrics.json")), ..Self::default() }
    }

    /// Writes nothing: for a Monte Carlo, whose trials are only collected.
    pub fn in_memory() -> Self {
        Self::default()
    }

    /// The figures, once the run has finished.
    pub fn metrics(&self) -> Option<&Metrics> {
        self.result.as_ref()
    }

    fn instant(&mut self, at: SimTime) {
        self.tracks.values_mut().for_each(|track| track.instant(at));
    }

    fn see(&mut self, event: &RunEvent<'_>) -> Result<(), ReportError> {
        let is_replay = self.header.as_ref().is_some_and(|header| header.duration_s.is_none());
        let failed = |track: &Name| {
            let track = track.to_string();
            move |source| ReportError::Metrics { track, source }
        };
        match event {
            RunEvent::Truth(truth) => {
                self.last = self.last.max(truth.at);
                self.motion.see(truth.at, truth.arc_length_m, truth.segment.as_deref());
                if !is_replay {
                    self.instant(truth.at);
                }
            }
            RunEvent::Clock { at } => {
                self.last = self.last.max(*at);
                if is_replay {
                    self.instant(*at);
                }
            }
            RunEvent::Update(update) => {
                self.last = self.last.max(update.estimate.at);
                self.plausibility.update(update);
                if let Some(track) = self.tracks.get_mut(update.track) {
                    track.update(update).map_err(failed(update.track))?;
                }
            }
            RunEvent::Reading { reading, .. } => {
                let sensor = self.sensors.entry(reading.sensor.clone()).or_default();
                sensor.readings += 1;
                if reading.payload.schema().rows == Rows::Events {
                    sensor.events += reading.payload.rows() as u64;
                }
            }
            RunEvent::Command { controller, command, world_from_sensor, .. } => {
                let watched = self.controllers.entry((*controller).clone()).or_default();
                watched.see(world_from_sensor, &command.twist_world);
            }
            RunEvent::Missing { sensor, .. } => {
                self.sensors.entry((*sensor).clone()).or_default().missing += 1;
            }
            RunEvent::Refused { track: name, why, .. } => {
                if let Some(track) = self.tracks.get_mut(*name) {
                    track.refusal(why).map_err(failed(name))?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), ReportError> {
        let Some(header) = &self.header else { return Ok(()) };
        let metrics = Metrics {
            schema: 1,
            scenario: header.scenario.clone(),
            seed: header.seed,
            trial: header.trial,
            duration_s: header.duration_s.unwrap_or(self.last.seconds()),
            observe_from_s: header.observe_from_s,
            tracks: self
                .tracks
                .iter_mut()
                .map(|(name, track)| {
                    (name.to_string(), track.metrics(header.has_truth, header.observe_from_s))
                })
                .collect(),
            sensors: self.sensors.iter().map(|(name, sensor)| (name.to_string(), *sensor)).collect(),
            controllers: self
                .controllers
                .iter()
                .map(|(name, seen)| (name.to_string(), seen.figures))
                .collect(),
            motion: self.motion.figures(),
            expected: self.plausibility.expectations(&header.expect),
        };
        if let Some(path) = &self.path {
            write_json(path, &metrics)?;
        }
        self.result = Some(metrics);
        Ok(())
    }
}

impl RunObserver for MetricsObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        self.tracks =
            header.tracks.iter().map(|track| (track.name.clone(), Collector::new(&header.periods))).collect();
        self.sensors = header.sensors.iter().map(|s| (s.name.clone(), SensorMetrics::default())).collect();
        self.plausibility = Plausibility::new(header);
        self.header = Some(header.clone());
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.see(event).map_err(|e| ObserverError::new("metrics", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.close().map_err(|e| ObserverError::new("metrics", e))
    }
}
