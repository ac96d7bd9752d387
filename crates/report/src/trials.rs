//! `trials.json`: what many trials of one scenario say together.
//!
//! Per track: means over trials with 95 % bootstrap intervals, the worst, and the proper test of consistency (mean NEES over
//! the trials at each instant against its band; a single run allows none). Per pair of tracks: the difference trial by trial,
//! since trial k gives every track the same gut, motion and noise. Failed trials are counted, and leave no figure behind.
//!
//! Figures are read back from the trials' own files, in the order of the trials: equal for any number of threads.

use crate::error::ReportError;
use crate::file::OutputFile;
use crate::metrics::{Metrics, TrackMetrics};
use crate::tracks::for_each_track_row;
use lumenav_core::{RandomStream, RandomStreams};
use lumenav_evaluation::EvaluationError;
use lumenav_evaluation::chi_square::Band;
use lumenav_evaluation::consistency::across_runs::{AcrossRunsSummary, NeesAcrossRuns};
use lumenav_evaluation::consistency::verdict::Verdict;
use lumenav_evaluation::monte_carlo::bootstrap::{BootstrapSettings, MeanInterval, mean_with_interval};
use lumenav_evaluation::monte_carlo::paired::{PairedComparison, compare_paired, correct_family};
use lumenav_evaluation::summary::ScalarSummary;
use serde::{Deserialize, Serialize};
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
    /// Mean errors of the trials compared, mm.
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
}

#[derive(Default)]
struct Collected {
    errors: BTreeMap<u64, ScalarSummary>,
    availability: Vec<f64>,
    nees: Option<NeesAcrossRuns>,
    other_dof: u64,
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
        for (name, figures) in &metrics.tracks {
            self.tracks.entry(name.clone()).or_default().take(metrics.trial, figures);
        }
        self.take_nees(&folder.join("tracks.parquet"))
    }

    fn take_nees(&mut self, path: &Path) -> Result<(), ReportError> {
        let mut steps: BTreeMap<String, Vec<(u8, i64, f64)>> = BTreeMap::new();
        for_each_track_row(path, |row| {
            if let (Some(nees), Some(dof)) = (row.number("nees"), row.nees_dof) {
                steps.entry(row.track.to_string()).or_default().push((dof, row.t_ns, nees));
            }
        })?;
        for (name, steps) in steps {
            let track = self.tracks.entry(name.clone()).or_default();
            track.take_nees(&steps).map_err(metrics_error(&name))?;
        }
        Ok(())
    }

    /// The figures.
    ///
    /// # Errors
    /// [`ReportError::Metrics`] where a statistic cannot be formed.
    pub fn finish(self) -> Result<Trials, ReportError> {
        // A stream of its own: the intervals depend on the figures alone.
        let mut random = RandomStreams::new(0, 0, "trials").stream("bootstrap", 0);
        let settings = BootstrapSettings::default();
        let mut interval = |values: Vec<f64>| {
            // One trial has a mean but no interval: nothing is claimed of it.
            if values.len() < 2 {
                Ok(None)
            } else {
                mean_with_interval(&values, &settings, &mut random).map(Some)
            }
        };
        let mut tracks = BTreeMap::new();
        for (name, collected) in &self.tracks {
            let figures = collected.figures(&mut interval).map_err(metrics_error(name))?;
            tracks.insert(name.clone(), figures);
        }
        let (scenario, seed) = self.first.clone().unwrap_or_default();
        let comparisons = self.comparisons(&settings, &mut random)?;
        Ok(Trials { schema: 1, scenario, seed, trials: self.seen, failed: self.failed, tracks, comparisons })
    }

    fn comparisons(
        &self,
        settings: &BootstrapSettings,
        random: &mut RandomStream,
    ) -> Result<Vec<PairOfTracks>, ReportError> {
        let means = |collected: &Collected| -> BTreeMap<u64, f64> {
            collected.errors.iter().map(|(trial, error)| (*trial, error.mean)).collect()
        };
        let tracks: Vec<(&String, BTreeMap<u64, f64>)> =
            self.tracks.iter().map(|(name, collected)| (name, means(collected))).collect();
        let mut family = Vec::new();
        for (i, (first, a)) in tracks.iter().enumerate() {
            for (second, b) in &tracks[i + 1..] {
                match compare_paired((first, a), (second, b), settings, random) {
                    Ok(comparison) => family.push(comparison),
                    // Too few common trials to compare: there is no such row.
                    Err(EvaluationError::TooFew { .. }) => {}
                    Err(error) => return Err(metrics_error(first)(error)),
                }
            }
        }
        correct_family(&mut family).map_err(metrics_error("all"))?;
        Ok(family
            .into_iter()
            .map(|comparison| PairOfTracks { sentence: comparison.sentence(1.0, "mm"), comparison })
            .collect())
    }
}

fn metrics_error(track: &str) -> impl FnOnce(EvaluationError) -> ReportError {
    let track = track.to_owned();
    move |source| ReportError::Metrics { track, source }
}

impl Collected {
    fn take(&mut self, trial: u64, figures: &TrackMetrics) {
        if let Some(error) = figures.position_error_mm {
            self.errors.insert(trial, error);
        }
        self.availability.extend(figures.availability);
    }

    /// The NEES of one trial: degrees of freedom, instant, value.
    fn take_nees(&mut self, steps: &[(u8, i64, f64)]) -> Result<(), EvaluationError> {
        let Some((first, ..)) = steps.first() else { return Ok(()) };
        let across = match &mut self.nees {
            Some(across) => across,
            None => self.nees.insert(NeesAcrossRuns::new(usize::from(*first))?),
        };
        let dof = across.dof();
        let same = steps.iter().filter(|(d, ..)| usize::from(*d) == dof);
        self.other_dof += (steps.len() - same.clone().count()) as u64;
        across.push_run(same.map(|(_, at, nees)| (*at, *nees)));
        Ok(())
    }

    fn figures(
        &self,
        interval: &mut impl FnMut(Vec<f64>) -> Result<Option<MeanInterval>, EvaluationError>,
    ) -> Result<TrialsOfTrack, EvaluationError> {
        let all = |f: fn(&ScalarSummary) -> f64| -> Vec<f64> { self.errors.values().map(f).collect() };
        let nees = self.nees.as_ref().map(|nees| -> Result<NeesOverTrials, EvaluationError> {
            Ok(NeesOverTrials {
                across: nees.summary()?,
                share_within_085_125: nees.share_of_steps_within(NONLINEAR_BAND).unwrap_or(0.0),
            })
        });
        let nees = nees.transpose()?;
        let n = self.availability.len() as f64;
        let availability = (!self.availability.is_empty()).then(|| Availability {
            mean: self.availability.iter().sum::<f64>() / n,
            worst: self.availability.iter().copied().fold(1.0, f64::min),
        });
        Ok(TrialsOfTrack {
            trials: self.errors.len() as u64,
            mean_error_mm: interval(all(|e| e.mean))?,
            rmse_mm: interval(all(|e| e.rmse))?,
            worst_mm: all(|e| e.max).into_iter().reduce(f64::max),
            availability,
            verdict: nees.as_ref().map(|nees| Verdict::of_runs(&nees.across)),
            nees,
        })
    }
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
