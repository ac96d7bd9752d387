//! Where a recorded row stands in time: optional columns beside its time, as `--save-readings` writes them.
//!
//! | column | meaning | absent |
//! |---|---|---|
//! | `sequence` | the reading's count, lost ones included | counted by the reader |
//! | `start_s`, `end_s` | the interval it integrates over | an instant |
//! | `arrival_s` | when it reached the estimators | at once |
//!
//! Rows are in order of arrival: where `arrival_s` is given, a late reading may be about an earlier instant than the row before.

use crate::{Row, Table};
use lumenav_core::{ModalityError, SimTime};

/// Times beyond this are refused, s: the difference of two must fit nanoseconds in 64 bits (Unix times do).
pub const MAX_TIME_S: f64 = 4e9;

/// Indices of the columns.
#[derive(Clone, Copy, Debug)]
pub struct PlaceColumns {
    time: usize,
    sequence: Option<usize>,
    interval: Option<(usize, usize)>,
    arrival: Option<usize>,
}

/// A row's place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The interval; an instant has equal ends.
    pub interval: (SimTime, SimTime),
    /// When it reached the estimators.
    pub arrival: SimTime,
    /// Its count, where the file gives it.
    pub sequence: Option<u64>,
}

impl PlaceColumns {
    /// The columns of a table; `time` names the one that must be there.
    ///
    /// # Errors
    /// [`ModalityError::Row`] where it is not, or where only one end of the interval is.
    pub fn of(table: &Table, time: &str) -> Result<Self, ModalityError> {
        let find = |name: &str| table.headers().iter().position(|h| h == name);
        let interval = match (find("start_s"), find("end_s")) {
            (None, None) => None,
            // One alone: the message names the other.
            _ => Some((table.column("start_s")?, table.column("end_s")?)),
        };
        Ok(Self {
            time: table.column(time)?,
            sequence: find("sequence"),
            interval,
            arrival: find("arrival_s"),
        })
    }

    /// The place of a row, with `time_zero_s` taken off all its times.
    ///
    /// # Errors
    /// [`ModalityError::Row`] for times out of range, an interval that ends before it starts, an arrival before its end, a
    /// count that is none.
    pub fn read(&self, row: &Row<'_>, time_zero_s: f64) -> Result<Place, ModalityError> {
        let time = |column: usize| -> Result<SimTime, ModalityError> {
            let seconds = row.number(column)? - time_zero_s;
            if seconds.abs() > MAX_TIME_S {
                return Err(row.error(&format!("time {seconds:e} s is out of range")));
            }
            Ok(SimTime::from_seconds(seconds))
        };
        let interval = match self.interval {
            Some((start, end)) => (time(start)?, time(end)?),
            None => (time(self.time)?, time(self.time)?),
        };
        if interval.1 < interval.0 {
            return Err(row.error("the interval ends before it starts"));
        }
        let arrival = self.arrival.map_or(Ok(interval.1), time)?;
        if arrival < interval.1 {
            return Err(row.error("the reading arrives before its interval has ended"));
        }
        let sequence = match self.sequence {
            None => None,
            Some(column) => Some(row.text(column).parse().map_err(|_| {
                row.error(&format!("`{}` is no count; a whole number from 0 is allowed", row.text(column)))
            })?),
        };
        Ok(Place { interval, arrival, sequence })
    }
}
