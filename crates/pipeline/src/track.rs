//! One track: the front ends of its sensors and, where it has one, its filter.

use crate::events::Refusal;
use lumenav_core::{
    ConfigError, FrontEnd, Measurement, ModalityError, MotionInput, Name, Node, Outcome, PosePrior,
    PublishedEstimate, Reading,
};
use lumenav_fusion::{Eskf, EskfOptions, Offered, PriorOptions, Refused, Verdict};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;

/// `[track.filter]`: which filter, and its options beside.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FilterTable {
    /// No filter: the front end's own fixes are the track.
    None {},
    /// The error-state Kalman filter.
    Eskf(EskfOptions),
}

/// What a track says after one reading.
#[derive(Debug)]
pub struct Step {
    /// The estimate, where there is one.
    pub estimate: Option<PublishedEstimate>,
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
}

/// A running track.
pub struct Track {
    /// Its name.
    pub name: Name,
    /// Its inputs in the file's order.
    pub inputs: Vec<Input>,
    filter: Option<Eskf>,
    /// Counts updates.
    pub updates: u64,
}

/// Reads `[track.filter]`; absent: `eskf` with its defaults.
///
/// # Errors
/// [`ConfigError`] with file, line and key.
pub fn read_filter(node: &Node) -> Result<FilterTable, ConfigError> {
    let table = node.to_toml().unwrap_or_default();
    let kind = match table.get("kind") {
        None => "eskf",
        Some(toml::Value::String(kind)) => kind.as_str(),
        Some(_) => return Err(node.error_at("kind", "expected a name in quotes; allowed: none, eskf")),
    };
    match kind {
        "none" if node.keys().len() > 1 => Err(node.error("a track without a filter has no options of one")),
        "none" => Ok(FilterTable::None {}),
        "eskf" => Ok(FilterTable::Eskf(node.without("kind").parse()?)),
        other => Err(node.error_at("kind", &format!("unknown filter `{other}`; allowed: none, eskf"))),
    }
}

impl Track {
    /// A track with its inputs; `filter` as read from the file.
    ///
    /// # Errors
    /// [`ConfigError`] where two sensors without a filter contradict each other, or the prior is wrong.
    pub fn new(
        name: Name,
        inputs: Vec<Input>,
        filter: &FilterTable,
        prior: Option<&Node>,
        node: &Node,
    ) -> Result<Self, ConfigError> {
        let filter = match filter {
            FilterTable::None {} => {
                if inputs.iter().any(|i| i.front_end.is_none()) {
                    let message = "without a filter every sensor needs a front end that makes poses";
                    return Err(node.error_at("sensors", message));
                }
                if let Some(prior) = prior {
                    return Err(prior.error("a track without a filter takes no prior"));
                }
                None
            }
            FilterTable::Eskf(options) => {
                let mut blocks = Vec::new();
                for input in &inputs {
                    blocks.extend(input.front_end.iter().flat_map(|f| f.blocks()));
                    blocks.extend(input.motion_input.iter().flat_map(|m| m.blocks()));
                }
                let mut eskf = Eskf::new(options.clone(), blocks);
                if let Some(prior) = prior {
                    eskf = eskf.with_prior(&prior.parse::<PriorOptions>()?);
                }
                Some(eskf)
            }
        };
        Ok(Self { name, inputs, filter, updates: 0 })
    }

    /// The filter, where there is one.
    pub fn filter(&self) -> Option<&Eskf> {
        self.filter.as_ref()
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
        if let (Some(motion), Some(filter)) = (&input.motion_input, &mut self.filter) {
            filter.offer_motion(reading.clone(), motion.clone());
        }
        let Some(front_end) = &mut input.front_end else { return Ok(Vec::new()) };
        let prior: Option<PosePrior> = self.filter.as_ref().and_then(|f| f.predicted_pose(reading.at()));
        let outcome = front_end.process(reading, prior.as_ref())?;
        if let Some(filter) = &mut self.filter {
            filter.want_clones(&reading.sensor, front_end.wanted_clones());
        }
        let spent = begin.elapsed().as_secs_f64();
        match outcome {
            Outcome::Nothing => Ok(Vec::new()),
            Outcome::Refused { why } => {
                let refusal = Refusal::FrontEnd { why: why.to_string() };
                Ok(vec![Step::refused(None, refusal, None, spent)])
            }
            Outcome::Measured(measurements) => {
                let share = spent / measurements.len().max(1) as f64;
                Ok(measurements.into_iter().map(|m| self.take(m, share)).collect())
            }
        }
    }

    fn take(&mut self, measurement: Measurement, front_end_s: f64) -> Step {
        let begin = Instant::now();
        let Some(filter) = &mut self.filter else { return Step::alone(measurement, front_end_s) };
        let Offered { verdict, lost } = filter.offer(measurement.clone());
        let compute_s = front_end_s + begin.elapsed().as_secs_f64();
        let (nis, started) = match verdict {
            Verdict::Accepted(innovation) => {
                (Some((innovation.chi_square, innovation.degrees_of_freedom)), false)
            }
            Verdict::Started => (None, true),
            Verdict::Refused(refused) => {
                return Step::refused(Some(measurement), refusal(refused), lost, compute_s);
            }
        };
        let estimate = filter.estimate();
        Step { estimate, measurement: Some(measurement), nis, started, refusal: None, lost, compute_s }
    }
}

impl Step {
    fn refused(
        measurement: Option<Measurement>,
        refusal: Refusal,
        lost: Option<String>,
        compute_s: f64,
    ) -> Self {
        Self {
            estimate: None,
            measurement,
            nis: None,
            started: false,
            refusal: Some(refusal),
            lost,
            compute_s,
        }
    }

    /// A front end's own fix as the estimate of a track without a filter.
    fn alone(measurement: Measurement, compute_s: f64) -> Self {
        let Some(pose) = measurement.fix.clone() else {
            return Self::refused(Some(measurement), Refusal::NotStarted, None, compute_s);
        };
        let estimate = PublishedEstimate {
            at: measurement.at,
            available: measurement.arrival,
            pose,
            velocity_world_m_s: None,
        };
        Self {
            estimate: Some(estimate),
            measurement: Some(measurement),
            nis: None,
            started: false,
            refusal: None,
            lost: None,
            compute_s,
        }
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
