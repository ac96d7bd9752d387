//! Faults that befall readings on their way, whatever the modality.
//!
//! A channel is a row of the reading; a fault of values touches every column of numbers. Random numbers come from the stream
//! `(fault in words, reading)`: another fault in the file shifts no draw of this one.

use crate::error::RunError;
use lumenav_core::time::nanoseconds;
use lumenav_core::{Column, Frame, RandomStreams, Reading};
use lumenav_scenario::Fault;
use rand::RngExt as _;
use rand_distr::StandardNormal;

/// The faults of a scenario, with what they remember.
pub struct Faults {
    faults: Vec<Remembering>,
}

struct Remembering {
    fault: Fault,
    /// What the reading was when channels stuck.
    stuck_at: Option<Frame>,
}

/// What is left of a reading.
#[derive(Debug)]
pub enum Fate {
    /// It goes on, perhaps changed.
    Passed(Box<Reading>),
    /// It is lost, and why.
    Lost(String),
}

impl Faults {
    /// The faults of a scenario.
    pub fn new(faults: Vec<Fault>) -> Self {
        Self { faults: faults.into_iter().map(|fault| Remembering { fault, stuck_at: None }).collect() }
    }

    /// Applies every fault that is active at the reading's time, in the file's order.
    ///
    /// # Errors
    /// [`RunError::Fault`] where a fault names a channel that the reading does not have.
    pub fn befall(&mut self, mut reading: Reading, random: &RandomStreams) -> Result<Fate, RunError> {
        let now_s = reading.at().seconds();
        for Remembering { fault, stuck_at } in &mut self.faults {
            let (sensor, start_s, end_s) = fault.place();
            if sensor != &*reading.sensor || now_s < start_s || now_s >= end_s {
                continue;
            }
            match &*fault {
                Fault::Dropout { .. } => return Ok(Fate::Lost(fault.describe())),
                Fault::LostChannels { channels, .. } => {
                    known(fault, channels, reading.payload.rows())?;
                    for row in channels {
                        reading.payload.mask_row(*row);
                    }
                }
                Fault::Stuck { channels, .. } => {
                    known(fault, channels, reading.payload.rows())?;
                    let kept = stuck_at.get_or_insert_with(|| reading.payload.clone());
                    stick(&mut reading.payload, channels, kept);
                }
                Fault::Outliers { share, sigma, .. } => {
                    let streams = random.for_component(&fault.describe());
                    let mut stream = streams.stream("outlier", reading.sequence);
                    for value in numbers_mut(&mut reading.payload).flatten() {
                        // Both are drawn for each value, so that the share changes no value that is hit.
                        let hit = stream.random::<f64>() < share.0;
                        let wild: f64 = stream.sample(StandardNormal);
                        if hit {
                            *value += sigma.0 * wild;
                        }
                    }
                }
                Fault::Delay { delay_ms, .. } => {
                    reading.arrival = reading.arrival + nanoseconds(delay_ms.0 * 1e-3);
                }
            }
        }
        Ok(Fate::Passed(Box::new(reading)))
    }
}

/// All channels that a fault names are there.
fn known(fault: &Fault, channels: &[usize], rows: usize) -> Result<(), RunError> {
    match channels.iter().find(|channel| **channel >= rows) {
        None => Ok(()),
        Some(channel) => Err(RunError::Fault {
            fault: fault.describe(),
            why: format!(
                "there is no channel {channel}; the sensor's readings have channels 0 to {}",
                rows.saturating_sub(1)
            ),
        }),
    }
}

/// The columns of numbers of a frame, to change them in place.
fn numbers_mut(frame: &mut Frame) -> impl Iterator<Item = &mut Vec<f64>> {
    frame.columns_mut().iter_mut().filter_map(|column| match column {
        Column::F64(values) => Some(values),
        _ => None,
    })
}

/// Channels keep the values they had, and stay lost where they were lost then.
fn stick(frame: &mut Frame, channels: &[usize], kept: &Frame) {
    for (column, old) in frame.columns_mut().iter_mut().zip(kept.columns()) {
        if let (Column::F64(values), Column::F64(old)) = (column, old) {
            for row in channels {
                if let (Some(value), Some(old)) = (values.get_mut(*row), old.get(*row)) {
                    *value = *old;
                }
            }
        }
    }
    for row in channels {
        if kept.valid().get(*row) == Some(&false) {
            frame.mask_row(*row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::{Node, Schema, SimTime};
    use std::path::Path;
    use std::sync::Arc;

    fn fault(text: &str) -> Fault {
        let text = format!("sensor = \"s\"\nstart_s = 1.0\nend_s = 9.0\n{text}");
        Node::parse_text(&text, "f.toml", Path::new(""), &[]).unwrap().parse().unwrap()
    }

    fn reading(sequence: u64, values: [[f64; 3]; 2]) -> Reading {
        let schema = Schema::events("two/1", &["a", "b"]);
        let columns = values.iter().map(|column| Column::F64(column.to_vec())).collect();
        let at = SimTime::from_seconds(1.0 + sequence as f64);
        Reading {
            sensor: Arc::from("s"),
            sequence,
            interval: (at, at),
            arrival: at,
            payload: Frame::new(schema, columns, vec![true; 3]).unwrap(),
            known_poses: std::collections::BTreeMap::default(),
        }
    }

    fn values(fate: Fate) -> Reading {
        match fate {
            Fate::Passed(reading) => *reading,
            Fate::Lost(why) => panic!("lost: {why}"),
        }
    }

    fn after(faults: &[Fault], readings: &[Reading]) -> Vec<Reading> {
        let streams = RandomStreams::new(1, 0, "");
        let mut faults = Faults::new(faults.to_vec());
        readings.iter().map(|r| values(faults.befall(r.clone(), &streams).unwrap())).collect()
    }

    #[test]
    fn law_a_stuck_channel_keeps_its_own_value_in_each_column() {
        let readings = [reading(0, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), reading(1, [[7.0; 3], [8.0; 3]])];
        let out = after(&[fault("kind = \"stuck\"\nchannels = [1]")], &readings);
        assert_eq!(out[1].payload.f64("a").unwrap(), [7.0, 2.0, 7.0]);
        assert_eq!(out[1].payload.f64("b").unwrap(), [8.0, 5.0, 8.0]);
    }

    #[test]
    fn law_a_channel_that_stuck_while_lost_stays_lost() {
        let mut first = reading(0, [[1.0; 3], [2.0; 3]]);
        first.payload.mask_row(2);
        let out =
            after(&[fault("kind = \"stuck\"\nchannels = [2]")], &[first, reading(1, [[7.0; 3], [8.0; 3]])]);
        assert_eq!(out[1].payload.valid(), [true, true, false]);
    }

    #[test]
    fn law_a_channel_that_is_not_there_is_refused() {
        for kind in ["stuck", "lost-channels"] {
            let mut faults = Faults::new(vec![fault(&format!("kind = \"{kind}\"\nchannels = [0, 3]"))]);
            let error = faults.befall(reading(0, [[1.0; 3]; 2]), &RandomStreams::new(1, 0, "")).unwrap_err();
            assert!(
                error.to_string().contains("no channel 3") && error.to_string().contains("0 to 2"),
                "{error}"
            );
        }
    }

    #[test]
    fn law_another_fault_shifts_no_draw() {
        let outliers = fault("kind = \"outliers\"\nshare = 0.5\nsigma = 10.0");
        let lost = fault("kind = \"lost-channels\"\nchannels = [0]");
        let readings = [reading(0, [[0.0; 3]; 2]), reading(1, [[0.0; 3]; 2])];
        let (alone, among) =
            (after(std::slice::from_ref(&outliers), &readings), after(&[lost, outliers], &readings));
        for (a, b) in alone.iter().zip(&among) {
            assert_eq!(a.payload.f64("b").unwrap()[1..], b.payload.f64("b").unwrap()[1..]);
        }
        let hit = alone.iter().flat_map(|r| r.payload.f64("a").unwrap()).filter(|v| **v != 0.0).count();
        assert!((1..6).contains(&hit), "{hit} of 6 values hit");
    }

    #[test]
    fn closed_form_delay_and_dropout_hold_in_their_time_alone() {
        let late = after(
            &[fault("kind = \"delay\"\ndelay_ms = 250")],
            &[reading(0, [[0.0; 3]; 2]), reading(8, [[0.0; 3]; 2])],
        );
        assert_eq!(late[0].arrival.since_s(late[0].at()), 0.25);
        assert_eq!(late[1].arrival, late[1].at());
        let mut faults = Faults::new(vec![fault("kind = \"dropout\"")]);
        let streams = RandomStreams::new(1, 0, "");
        assert!(matches!(faults.befall(reading(0, [[0.0; 3]; 2]), &streams), Ok(Fate::Lost(_))));
        assert!(matches!(faults.befall(reading(8, [[0.0; 3]; 2]), &streams), Ok(Fate::Passed(_))));
    }
}
