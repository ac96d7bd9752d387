//! Faults that befall readings on their way, whatever the modality.
//!
//! A fault draws its random numbers from the stream `(fault-<index>, reading)`, so that it shifts no other draw.

use lumenav_core::time::nanoseconds;
use lumenav_core::{Column, RandomStreams, Reading};
use lumenav_scenario::Fault;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;

/// The faults of a scenario, with what they remember.
pub struct Faults {
    faults: Vec<Fault>,
    /// Values at which channels stuck, by fault.
    stuck: BTreeMap<usize, Vec<f64>>,
}

/// What is left of a reading.
pub enum Fate {
    /// It goes on, perhaps changed.
    Passed(Box<Reading>),
    /// It is lost, and why.
    Lost(String),
}

impl Faults {
    /// The faults of a scenario.
    pub fn new(faults: Vec<Fault>) -> Self {
        Self { faults, stuck: BTreeMap::new() }
    }

    /// Applies every fault that is active at the reading's time.
    pub fn befall(&mut self, mut reading: Reading, random: &RandomStreams) -> Fate {
        let now_s = reading.at().seconds();
        for (index, fault) in self.faults.iter().enumerate() {
            let (sensor, start_s, end_s) = fault.place();
            if sensor != &*reading.sensor || now_s < start_s || now_s >= end_s {
                continue;
            }
            match fault {
                Fault::Dropout { .. } => return Fate::Lost(fault.describe()),
                Fault::LostChannels { channels, .. } => {
                    let rows = reading.payload.rows();
                    for row in channels.iter().filter(|row| **row < rows) {
                        reading.payload.mask_row(*row);
                    }
                }
                Fault::Stuck { channels, .. } => {
                    stick(&mut reading, channels, self.stuck.entry(index).or_default());
                }
                Fault::Outliers { share, sigma, .. } => {
                    let mut stream =
                        random.for_component(&format!("fault-{index}")).stream("outlier", reading.sequence);
                    for values in columns_mut(&mut reading) {
                        for value in values.iter_mut() {
                            let hit = stream.random::<f64>() < share.0;
                            let wild: f64 = stream.sample(StandardNormal);
                            if hit {
                                *value += sigma.0 * wild;
                            }
                        }
                    }
                }
                Fault::Delay { delay_ms, .. } => {
                    reading.arrival = reading.arrival + nanoseconds(delay_ms.0 * 1e-3);
                }
            }
        }
        Fate::Passed(Box::new(reading))
    }
}

/// Names of the number columns of a reading, to change them in place.
fn columns_mut(reading: &mut Reading) -> Vec<&mut Vec<f64>> {
    reading
        .payload
        .columns_mut()
        .iter_mut()
        .filter_map(|column| match column {
            Column::F64(values) => Some(values),
            _ => None,
        })
        .collect()
}

fn stick(reading: &mut Reading, channels: &[usize], kept: &mut Vec<f64>) {
    for values in columns_mut(reading) {
        if kept.is_empty() {
            kept.extend(values.iter());
        }
        for row in channels {
            if let (Some(value), Some(old)) = (values.get_mut(*row), kept.get(*row)) {
                *value = *old;
            }
        }
    }
}
