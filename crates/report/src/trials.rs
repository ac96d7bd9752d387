//! `trials.json`: what many trials of one scenario say together.
//!
//! Per track: means over trials with 95 % bootstrap intervals, the worst, and the proper test of consistency (mean NEES over
//! the trials at each instant against its band; a single run allows none). Per pair of tracks: the difference trial by trial,
//! since trial k gives every track the same gut, motion and noise, over the instants at which both were judged. Failed trials are counted, and leave no figure behind.
//!
//! Figures are read back from the trials' own files, in the order of the trials: equal for any number of threads.

use crate::error::ReportError;
use crate::expected::ExpectVerdict;
use crate::file::OutputFile;
use crate::metrics::{Metrics, TrackMetrics};
use crate::tracks::for_each_track_row;
use lumenav_core::RandomStreams;
use lumenav_evaluation::EvaluationError;
use lumenav_evaluation::chi_square::Band;
use lumenav_evaluation::consistency::across_runs::{AcrossRunsSummary, NeesAcrossRuns};
use lumenav_evaluation::consistency::verdict::Verdict;
use lumenav_evaluation::monte_carlo::bootstrap::{BootstrapSettings, MeanInterval, mean_with_interval};
use lumenav_evaluation::monte_carlo::paired::{PairedComparison, compare_paired, correct_family};
use lumenav_evaluation::summary::ScalarSummary;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

/// Where the mean NEES per degree of freedom of a nonlinear filter must lie at most of the steps, when its truth is drawn
/// from its own motion model: linearisation is allowed to cost that much.
pub const NONLINEAR_BAND: Band = Band { lower: 0.85, upper: 1.25 };

/// `trials.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trials {
    /// Version of the keys.
    pub schema: u32,
    /// The scenario.
    pub scenario: String,
    /// The seed; trial k draws from (seed, k).
    pub seed: u64,
    /// Trials that were asked for.
    pub trials: u64,
    /// Trials that ended with an error.
    pub failed: u64,
    /// Figures per track.
    pub tracks: BTreeMap<String, TrialsOfTrack>,
    /// Every pair of tracks; p-values are corrected for making them all.
    pub comparisons: Vec<PairOfTracks>,
    /// What the scenario expects, and in how many trials it is so.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expected: Vec<ExpectOverTrials>,
}

/// One thing that a scenario asks (`[expect]`), over trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExpectOverTrials {
    /// What is asked, in words, with its unit.
    pub quantity: String,
    /// The least and the most that it may be; `null`: no such end.
    pub allowed: [Option<f64>; 2],
    /// Trials that ended well.
    pub trials: u64,
    /// The trials, by their number, in which it is not so.
    pub unmet: Vec<u64>,
    /// The least and the largest figure of a trial; `null` where none has one.
    pub range: Option<[f64; 2]>,
}

impl ExpectOverTrials {
    /// Adds a trial's verdict: every trial is asked the same, in the same order.
    fn take(all: &mut Vec<Self>, at: usize, trial: u64, verdict: &ExpectVerdict) {
        if at == all.len() {
            let (quantity, allowed) = (verdict.quantity.clone(), verdict.allowed);
            all.push(Self { quantity, allowed, trials: 0, unmet: Vec::new(), range: None });
        }
        let over = &mut all[at];
        over.trials += 1;
        if !verdict.met {
            over.unmet.push(trial);
        }
        if let Some(figure) = verdict.figure {
            let [least, most] = over.range.unwrap_or([figure; 2]);
            over.range = Some([least.min(figure), most.max(figure)]);
        }
    }
}

/// One track over trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialsOfTrack {
    /// Trials with an estimate to judge.
    pub trials: u64,
    /// Mean position error of a trial.
    pub mean_error_mm: Option<MeanInterval>,
    /// Position RMSE of a trial.
    pub rmse_mm: Option<MeanInterval>,
    /// Largest position error of all.
    pub worst_mm: Option<f64>,
    /// Mean availability, 0 to 1, and the worst trial's.
    pub availability: Option<Availability>,
    /// NEES across trials at each instant.
    pub nees: Option<NeesOverTrials>,
    /// `consistent`, `overconfident: …` or `cautious: …` by the test across runs.
    pub verdict: Option<Verdict>,
    /// Stretches of the run that the scenario names (`[[period]]`).
    #[serde(default)]
    pub periods: BTreeMap<String, PeriodOverTrials>,
}

/// One stretch of the run over trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeriodOverTrials {
    /// Trials with an estimate to judge in it.
    pub trials: u64,
    /// Mean position error of a trial.
    pub mean_error_mm: Option<MeanInterval>,
    /// The p95 of a trial's position errors.
    pub p95_mm: Option<MeanInterval>,
    /// The largest p95 of a trial.
    pub worst_p95_mm: Option<f64>,
    /// Largest position error of all.
    pub worst_mm: Option<f64>,
    /// Mean availability, 0 to 1, and the worst trial's.
    pub availability: Option<Availability>,
}

/// Share of the time with a fresh estimate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Availability {
    /// Mean over trials.
    pub mean: f64,
    /// The worst trial.
    pub worst: f64,
}

/// NEES across trials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeesOverTrials {
    /// Against its band, and the coverage of credible regions.
    #[serde(flatten)]
    pub across: AcrossRunsSummary,
    /// Share of the instants whose mean per degree of freedom lies in [`NONLINEAR_BAND`].
    pub share_within_085_125: f64,
}

/// Two tracks on the same trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairOfTracks {
    /// In words.
    pub sentence: String,
    /// What the means rest on.
    pub instants: Instants,
    /// Mean errors of the trials compared, mm, over common instants.
    #[serde(flatten)]
    pub comparison: PairedComparison,
}

/// What the trials of one scenario add up to; fed in the order of the trials.
#[derive(Default)]
pub struct TrialsCollector {
    seen: u64,
    failed: u64,
    first: Option<(String, u64)>,
    tracks: BTreeMap<String, Collected>,
    /// Mean error of both tracks of a pair, over the instants that both were judged at.
    pairs: BTreeMap<(String, String), BTreeMap<Trial, (f64, f64)>>,
    instants: BTreeMap<(String, String), Instants>,
    expected: Vec<ExpectOverTrials>,
}

/// How many of the instants of a pair of tracks are common.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Instants {
    /// Judged in both tracks: what the comparison rests on.
    pub common: u64,
    /// Judged in one alone.
    pub single: u64,
}

#[derive(Default)]
struct Collected {
    errors: BTreeMap<Trial, ScalarSummary>,
    availability: Vec<f64>,
    nees: Option<NeesAcrossRuns>,
    periods: BTreeMap<String, CollectedPeriod>,
}

#[derive(Default)]
struct CollectedPeriod {
    errors: Vec<ScalarSummary>,
    availability: Vec<f64>,
}

/// Seed and number of a trial.
type Trial = (u64, u64);

/// What one track says at one instant.
struct Judged {
    t_ns: i64,
    error_mm: f64,
    nees: Option<(usize, f64)>,
}

impl TrialsCollector {
    /// A trial that ended with an error.
    pub fn push_failed(&mut self) {
        self.seen += 1;
        self.failed += 1;
    }

    /// A trial that ended well; `folder` holds its `tracks.parquet`.
    ///
    /// # Errors
    /// [`ReportError`] where that file cannot be read.
    pub fn push(&mut self, metrics: &Metrics, folder: &Path) -> Result<(), ReportError> {
        self.seen += 1;
        self.first.get_or_insert_with(|| (metrics.scenario.clone(), metrics.seed));
        let trial = (metrics.seed, metrics.trial);
        for (at, verdict) in metrics.expected.verdicts.iter().enumerate() {
            ExpectOverTrials::take(&mut self.expected, at, metrics.trial, verdict);
        }
        for (name, figures) in &metrics.tracks {
            self.tracks.entry(name.clone()).or_default().take(trial, figures);
        }
        self.take_rows(trial, &folder.join("tracks.parquet"))
    }

    fn take_rows(&mut self, trial: Trial, path: &Path) -> Result<(), ReportError> {
        let mut rows: BTreeMap<String, Vec<Judged>> = BTreeMap::new();
        for_each_track_row(path, |row| {
            if let Some(error_mm) = row.number("error_mm") {
                // Without a value the covariance was none: it counts as uncovered.
                let nees = row.nees_dof.map(|dof| (usize::from(dof), row.number("nees").unwrap_or(f64::NAN)));
                rows.entry(row.track.to_string()).or_default().push(Judged {
                    t_ns: row.t_ns,
                    error_mm,
                    nees,
                });
            }
        })?;
        for rows in rows.values_mut() {
            one_per_instant(rows);
        }
        for (name, rows) in &rows {
            let track = self.tracks.entry(name.clone()).or_default();
            track.take_nees(rows).map_err(metrics_error(name))?;
        }
        let tracks: Vec<(&String, &Vec<Judged>)> = rows.iter().collect();
        for (i, (first, a)) in tracks.iter().enumerate() {
            for (second, b) in &tracks[i + 1..] {
                let key = ((*first).clone(), (*second).clone());
                let (means, instants) = common_means(a, b);
                let counted = self.instants.entry(key.clone()).or_default();
                counted.common += instants.common;
                counted.single += instants.single;
                if let Some(means) = means {
                    self.pairs.entry(key).or_default().insert(trial, means);
                }
            }
        }
        Ok(())
    }

    /// The figures.
    ///
    /// # Errors
    /// [`ReportError::Metrics`] where a statistic cannot be formed.
    pub fn finish(self) -> Result<Trials, ReportError> {
        // A stream for each track and pair: their intervals depend on their own figures alone.
        let random = RandomStreams::new(0, 0, "trials");
        let settings = BootstrapSettings::default();
        let mut tracks = BTreeMap::new();
        for (name, collected) in &self.tracks {
            let mut stream = random.for_component(name).stream("bootstrap", 0);
            let mut interval = |values: Vec<f64>| {
                // One trial has a mean but no interval: nothing is claimed of it.
                if values.len() < 2 {
                    Ok(None)
                } else {
                    mean_with_interval(&values, &settings, &mut stream).map(Some)
                }
            };
            let figures = collected.figures(&mut interval).map_err(metrics_error(name))?;
            tracks.insert(name.clone(), figures);
        }
        let (scenario, seed) = self.first.clone().unwrap_or_default();
        let comparisons = self.comparisons(&settings, &random)?;
        Ok(Trials {
            schema: 1,
            scenario,
            seed,
            trials: self.seen,
            failed: self.failed,
            tracks,
            comparisons,
            expected: self.expected,
        })
    }

    fn comparisons(
        &self,
        settings: &BootstrapSettings,
        random: &RandomStreams,
    ) -> Result<Vec<PairOfTracks>, ReportError> {
        let mut family = Vec::new();
        for ((first, second), trials) in &self.pairs {
            // Figures are compared by their place: trials are the same for both.
            let of = |choose: fn(&(f64, f64)) -> f64| -> BTreeMap<u64, f64> {
                (0..).zip(trials.values().map(choose)).collect()
            };
            let (a, b) = (of(|means| means.0), of(|means| means.1));
            let mut stream = random.for_component(&format!("{first}/{second}")).stream("bootstrap", 0);
            match compare_paired((first, &a), (second, &b), settings, &mut stream) {
                Ok(comparison) => family.push(comparison),
                // Too few common trials to compare: there is no such row.
                Err(EvaluationError::TooFew { .. }) => {}
                Err(error) => return Err(metrics_error(first)(error)),
            }
        }
        correct_family(&mut family).map_err(metrics_error("all"))?;
        Ok(family
            .into_iter()
            .map(|comparison| PairOfTracks {
                sentence: comparison.sentence(1.0, "mm"),
                instants: self
                    .instants
                    .get(&(comparison.first.clone(), comparison.second.clone()))
                    .copied()
                    .unwrap_or_default(),
                comparison,
            })
            .collect())
    }
}

/// In order of time, and of several rows about one instant (two sensors at once, a late reading) the last: one run counts once at
/// an instant.
fn one_per_instant(rows: &mut Vec<Judged>) {
    rows.sort_by_key(|row| row.t_ns);
    rows.reverse();
    rows.dedup_by_key(|row| row.t_ns);
    rows.reverse();
}

/// Mean errors of two tracks over the instants at which both were judged; both lists are in order of time.
fn common_means(a: &[Judged], b: &[Judged]) -> (Option<(f64, f64)>, Instants) {
    let (mut i, mut j) = (0, 0);
    let (mut sums, mut common) = ((0.0, 0.0), 0_u64);
    while let (Some(first), Some(second)) = (a.get(i), b.get(j)) {
        match first.t_ns.cmp(&second.t_ns) {
            Ordering::Less => i += 1,
            Ordering::Greater => j += 1,
            Ordering::Equal => {
                sums = (sums.0 + first.error_mm, sums.1 + second.error_mm);
                common += 1;
                i += 1;
                j += 1;
            }
        }
    }
    let single = (a.len() + b.len()) as u64 - 2 * common;
    let n = common as f64;
    ((common > 0).then(|| (sums.0 / n, sums.1 / n)), Instants { common, single })
}

fn metrics_error(track: &str) -> impl FnOnce(EvaluationError) -> ReportError {
    let track = track.to_owned();
    move |source| ReportError::Metrics { track, source }
}

impl Collected {
    fn take(&mut self, trial: Trial, figures: &TrackMetrics) {
        if let Some(error) = figures.position_error_mm {
            self.errors.insert(trial, error);
        }
        self.availability.extend(figures.availability);
        for (name, figures) in &figures.periods {
            let period = self.periods.entry(name.clone()).or_default();
            period.errors.extend(figures.position_error_mm);
            period.availability.extend(figures.availability);
        }
    }

    fn take_nees(&mut self, rows: &[Judged]) -> Result<(), EvaluationError> {
        let mut steps = rows.iter().filter_map(|r| r.nees.map(|(dof, nees)| (r.t_ns, dof, nees))).peekable();
        let Some((_, dof, _)) = steps.peek() else { return Ok(()) };
        let across = match &mut self.nees {
            Some(across) => across,
            None => self.nees.insert(NeesAcrossRuns::new(*dof)?),
        };
        across.push_run_of(steps)
    }

    fn figures(
        &self,
        interval: &mut impl FnMut(Vec<f64>) -> Result<Option<MeanInterval>, EvaluationError>,
    ) -> Result<TrialsOfTrack, EvaluationError> {
        let all = |f: fn(&ScalarSummary) -> f64| -> Vec<f64> { self.errors.values().map(f).collect() };
        let nees = match self.nees.as_ref().map(|nees| (nees, nees.summary())) {
            Some((nees, Ok(across))) => {
                let share_within_085_125 = nees.share_of_steps_within(NONLINEAR_BAND).unwrap_or(0.0);
                Some(NeesOverTrials { across, share_within_085_125 })
            }
            // No covariance of this track gave a value.
            None | Some((_, Err(EvaluationError::TooFew { .. }))) => None,
            Some((_, Err(error))) => return Err(error),
        };
        let mut periods = BTreeMap::new();
        for (name, period) in &self.periods {
            periods.insert(name.clone(), period.figures(interval)?);
        }
        Ok(TrialsOfTrack {
            trials: self.errors.len() as u64,
            mean_error_mm: interval(all(|e| e.mean))?,
            rmse_mm: interval(all(|e| e.rmse))?,
            worst_mm: all(|e| e.max).into_iter().reduce(f64::max),
            availability: availability(&self.availability),
            verdict: nees.as_ref().map(|nees| Verdict::of_runs(&nees.across)),
            nees,
            periods,
        })
    }
}

impl CollectedPeriod {
    fn figures(
        &self,
        interval: &mut impl FnMut(Vec<f64>) -> Result<Option<MeanInterval>, EvaluationError>,
    ) -> Result<PeriodOverTrials, EvaluationError> {
        let all = |f: fn(&ScalarSummary) -> f64| -> Vec<f64> { self.errors.iter().map(f).collect() };
        Ok(PeriodOverTrials {
            trials: self.errors.len() as u64,
            mean_error_mm: interval(all(|e| e.mean))?,
            p95_mm: interval(all(|e| e.p95))?,
            worst_p95_mm: all(|e| e.p95).into_iter().reduce(f64::max),
            worst_mm: all(|e| e.max).into_iter().reduce(f64::max),
            availability: availability(&self.availability),
        })
    }
}

fn availability(of_trials: &[f64]) -> Option<Availability> {
    let mean = of_trials.iter().sum::<f64>() / of_trials.len() as f64;
    let worst = of_trials.iter().copied().reduce(f64::min)?;
    Some(Availability { mean, worst })
}

/// Writes `trials.json` into a folder, whole or not at all.
///
/// # Errors
/// [`ReportError::File`], [`ReportError::Json`].
pub fn write_trials(folder: &Path, trials: &Trials) -> Result<(), ReportError> {
    let path = folder.join("trials.json");
    let text = serde_json::to_string_pretty(trials)
        .map_err(|source| ReportError::Json { path: path.clone(), source })?;
    let mut file = OutputFile::beside(&path)?;
    file.line(&text)?;
    file.finish()
}
