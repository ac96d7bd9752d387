//! Lines, gathered into readings: so many lines, or so much time.

use super::{FilesTable, LineRow, LineSource, WINDOW_MS};
use crate::Scanner;
use crate::payload::Columns;
use lumenav_core::{ModalityError, Name, Node, Reading, Recorded, Setup, SimTime};
use lumenav_records::BadRows;
use lumenav_records::place::MAX_TIME_S;
use std::collections::{BTreeMap, VecDeque};

/// More lines than this in one window are a wrong unit of time: 2,400 is a full ring's 50 ms.
pub(super) const MAX_WINDOW_LINES: usize = 1 << 20;
/// Windows shorter or longer than this are a wrong unit, ms.
const WINDOW_RANGE_MS: (f64, f64) = (0.01, 1e9);
/// Windows that share more than this with the next one never come to an end.
const MAX_OVERLAP: f64 = 0.99;

/// How a window ends, and where the next one begins.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Lines { count: usize, step: usize },
    Time { length_ns: i64, step_ns: i64 },
}

/// Readings from a source of lines. Windows by time begin at whole multiples of their step since the time zero; those without a
/// line are readings without lines, but a pause of more than `max_gap_s` leaves a hole in the sequence.
pub(super) struct Windows {
    source: Box<dyn LineSource>,
    scanner: Scanner,
    kind: Kind,
    sensor: Name,
    time_zero_ms: f64,
    origin_mm: [f64; 3],
    max_gap_ns: i64,
    bad_rows: BadRows,
    /// Lines of the window at hand.
    buffer: VecDeque<(i64, LineRow)>,
    /// How many of them no reading has held yet.
    fresh: usize,
    /// The next line.
    ahead: Option<(i64, LineRow)>,
    start_ns: Option<i64>,
    last_ns: Option<i64>,
    sequence: u64,
    /// Rows that were passed over.
    refused: u64,
    is_at_end: bool,
    failed: bool,
}

impl Windows {
    pub(super) fn new(
        source: Box<dyn LineSource>,
        scanner: &Scanner,
        node: &Node,
        files: &FilesTable,
        setup: &Setup,
    ) -> Result<Self, ModalityError> {
        Ok(Self {
            source,
            scanner: scanner.clone(),
            kind: kind(node, files)?,
            sensor: setup.sensor.clone(),
            time_zero_ms: files.time_zero_ms.0,
            origin_mm: files.origin_mm.map(|v| v.0),
            max_gap_ns: (files.max_gap_s.0.min(MAX_TIME_S) * 1e9) as i64,
            bad_rows: files.bad_rows,
            buffer: VecDeque::new(),
            fresh: 0,
            ahead: None,
            start_ns: None,
            last_ns: None,
            sequence: 0,
            refused: 0,
            is_at_end: false,
            failed: false,
        })
    }

    /// Fetches the next line. Behind a pause that is too long it is there, too, beside the error.
    fn fetch(&mut self) -> Result<(), ModalityError> {
        let Some(mut row) = self.source.next_line()? else {
            self.is_at_end = true;
            return Ok(());
        };
        row[0] -= self.time_zero_ms;
        if row[0].abs() > MAX_TIME_S * 1e3 {
            return Err(self.source.error(&format!("time {:e} ms is out of range", row[0])));
        }
        let at_ns = (row[0] * 1e6).round() as i64;
        if let Some(last) = self.last_ns.filter(|last| at_ns < *last) {
            let message = format!(
                "time runs back from {} to {} ms; lines must be in order",
                last as f64 * 1e-6,
                row[0]
            );
            return Err(self.source.error(&message));
        }
        for (i, value) in row[1..].iter_mut().enumerate() {
            *value += self.origin_mm[i % 3];
        }
        self.check_ends(&row)?;
        let pause_ns = self.last_ns.map_or(0, |last| at_ns - last);
        self.last_ns = Some(at_ns);
        self.ahead = Some((at_ns, row));
        if pause_ns > self.max_gap_ns {
            let message = format!(
                "no line for {:.3} s before this one; allowed: {} s (`max_gap_s`)",
                pause_ns as f64 * 1e-9,
                self.max_gap_ns as f64 * 1e-9
            );
            return Err(self.source.error(&message));
        }
        Ok(())
    }

    fn check_ends(&self, row: &LineRow) -> Result<(), ModalityError> {
        let [_, x1, y1, z1, x2, y2, z2] = *row;
        for end in [[x1, y1, z1], [x2, y2, z2]] {
            self.scanner.check_end(end).map_err(|why| self.source.error(&format!("{why} (`origin_mm`)")))?;
        }
        Ok(())
    }

    fn take_ahead(&mut self) -> Result<(), ModalityError> {
        if self.buffer.len() == MAX_WINDOW_LINES {
            let message = format!("more than {MAX_WINDOW_LINES} lines in one window; is the time in ms?");
            self.failed = true;
            return Err(self.source.error(&message));
        }
        self.buffer.extend(self.ahead.take());
        self.fresh += 1;
        Ok(())
    }

    /// Moves lines into the window; `true` once it is full.
    fn gather(&mut self) -> Result<bool, ModalityError> {
        loop {
            if self.ahead.is_none() && !self.is_at_end {
                self.fetch()?;
            }
            let Some((at_ns, _)) = self.ahead else {
                if self.last_ns.is_none() {
                    self.failed = true;
                    let message = match self.refused {
                        0 => "no line in this file".to_owned(),
                        refused => format!(
                            "no line in this file that scanner `{}` could have told: all {refused} rows were refused",
                            self.scanner.name
                        ),
                    };
                    return Err(self.source.error(&message));
                }
                return Ok(self.fresh > 0);
            };
            match self.kind {
                Kind::Lines { count, .. } => {
                    self.take_ahead()?;
                    if self.buffer.len() == count {
                        return Ok(true);
                    }
                }
                Kind::Time { length_ns, step_ns } => {
                    let start = self.start_ns.get_or_insert(at_ns.div_euclid(step_ns) * step_ns);
                    if at_ns >= *start + length_ns {
                        return Ok(true);
                    }
                    self.take_ahead()?;
                }
            }
        }
    }

    fn reading(&mut self) -> Result<Reading, ModalityError> {
        let mut columns = Columns::with_capacity(self.buffer.len());
        for (_, row) in &self.buffer {
            columns.push(row, true);
        }
        let interval = match (self.kind, self.buffer.front(), self.buffer.back()) {
            (Kind::Lines { .. }, Some((first, _)), Some((last, _))) => (*first, *last),
            (Kind::Time { length_ns, .. }, ..) => {
                let start = self.start_ns.unwrap_or_default();
                (start, start + length_ns)
            }
            // A window by lines holds one line or more.
            (Kind::Lines { .. }, ..) => (0, 0),
        };
        let interval = (SimTime(interval.0), SimTime(interval.1));
        let sequence = self.sequence;
        self.advance();
        Ok(Reading {
            sensor: self.sensor.clone(),
            sequence,
            interval,
            arrival: interval.1,
            known_poses: BTreeMap::new(),
            payload: columns.into_frame()?,
        })
    }

    /// Begins the next window.
    fn advance(&mut self) {
        self.sequence += 1;
        self.fresh = 0;
        match self.kind {
            Kind::Lines { step, .. } => {
                self.buffer.drain(..step.min(self.buffer.len()));
            }
            Kind::Time { step_ns, .. } => {
                let mut start = self.start_ns.unwrap_or_default() + step_ns;
                while self.buffer.front().is_some_and(|(at_ns, _)| *at_ns < start) {
                    self.buffer.pop_front();
                }
                if let Some((at_ns, _)) = self.ahead
                    && self.buffer.is_empty()
                    && at_ns - start > self.max_gap_ns
                {
                    let windows = (at_ns - start) / step_ns;
                    start += windows * step_ns;
                    self.sequence += windows as u64;
                }
                self.start_ns = Some(start);
            }
        }
    }
}

fn kind(node: &Node, files: &FilesTable) -> Result<Kind, ModalityError> {
    let kept = 1.0 - files.overlap.0;
    if files.overlap.0 > MAX_OVERLAP {
        let message = format!("{} is not allowed; allowed: 0 to {MAX_OVERLAP}", files.overlap.0);
        return Err(node.error_at("overlap", &message).into());
    }
    if let Some(count) = files.window_lines {
        if files.window_ms.is_some() {
            let message = "a window has so many lines or so many milliseconds: give one of the two";
            return Err(node.error_at("window_lines", message).into());
        }
        let count = count as usize;
        if count == 0 || count > MAX_WINDOW_LINES {
            let message = format!("{count} lines in a window; allowed: 1 to {MAX_WINDOW_LINES}");
            return Err(node.error_at("window_lines", &message).into());
        }
        let step = (count as f64 * kept).round().max(1.0) as usize;
        return Ok(Kind::Lines { count, step });
    }
    let length_ms = files.window_ms.map_or(WINDOW_MS, |v| v.0);
    let (least, most) = WINDOW_RANGE_MS;
    if length_ms < least || length_ms > most {
        let message = format!("{length_ms} ms is not allowed; allowed: {least} to {most:e}");
        return Err(node.error_at("window_ms", &message).into());
    }
    let length_ns = (length_ms * 1e6).round();
    Ok(Kind::Time { length_ns: length_ns as i64, step_ns: (length_ns * kept).round() as i64 })
}

impl Iterator for Windows {
    type Item = Result<Recorded, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let reading = match self.gather() {
            Ok(false) => return None,
            Ok(true) => self.reading(),
            Err(error) => Err(error),
        };
        Some(match reading {
            Ok(reading) => Ok(Recorded::Reading(reading)),
            Err(error @ ModalityError::Row { .. }) if self.bad_rows == BadRows::Skip && !self.failed => {
                self.refused += 1;
                Ok(Recorded::Skipped(error))
            }
            Err(error) => {
                self.failed = true;
                Err(error)
            }
        })
    }
}
