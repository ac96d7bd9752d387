//! Saved readings: rows `t_s,sequence,start_s,end_s,arrival_s` and the columns of the payload; consecutive rows with the same place
//! in time are the events of one reading. A row without numbers is a masked event; alone, it is a reading without events.

use super::windows::MAX_WINDOW_LINES;
use super::{FilesTable, LineRow, check, header};
use crate::Scanner;
use crate::payload::{COLUMNS, Columns, SCANNER};
use lumenav_core::{ModalityError, Name, Node, Reading, Recorded, Setup, SimTime};
use lumenav_records::BadRows;
use lumenav_records::place::{MAX_TIME_S, Place};
use lumenav_records::rows::{Cells, RawRow, RowReader, Separator, shown};
use lumenav_records::tum;
use nalgebra::{Isometry3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

const PLACE: [&str; 5] = ["t_s", "sequence", "start_s", "end_s", "arrival_s"];

/// A reading being gathered.
struct Gathered {
    /// The bytes of its place in time, with the comma behind them.
    prefix: Vec<u8>,
    place: Place,
    columns: Columns,
    has_numbers: bool,
    line: u64,
}

/// A file of saved readings.
pub(super) struct SavedReader {
    rows: RowReader,
    sensor: Name,
    bad_rows: BadRows,
    scanner: Scanner,
    poses: BTreeMap<String, Vec<(SimTime, Isometry3<f64>)>>,
    gathered: Option<Gathered>,
    last: Option<(SimTime, u64)>,
    has_read: bool,
    /// Rows and readings that were passed over, and why the first was.
    refused: u64,
    first_refused: Option<String>,
    failed: bool,
}

impl SavedReader {
    pub(super) fn open(
        path: &Path,
        scanner: &Scanner,
        node: &Node,
        files: &FilesTable,
        setup: &Setup,
    ) -> Result<Self, ModalityError> {
        let given = [
            ("window_lines", files.window_lines.is_some()),
            ("window_ms", files.window_ms.is_some()),
            ("overlap", files.overlap.0 != 0.0),
            ("time_zero_ms", files.time_zero_ms.0 != 0.0),
            ("origin_mm", files.origin_mm.iter().any(|v| v.0 != 0.0)),
        ];
        if let Some((key, _)) = given.iter().find(|(_, is_given)| *is_given) {
            let message = "saved readings have their own windows, times and places";
            return Err(node.error_at(key, message).into());
        }
        let mut poses = BTreeMap::new();
        for (name, file) in &files.poses {
            if name != SCANNER {
                let message = format!(
                    "no pose `{name}` is known; allowed: `{SCANNER}`, where a bed has put the scanner"
                );
                return Err(node.error_at("poses", &message).into());
            }
            poses.insert(name.clone(), tum::read(&node.existing_path("poses", file)?)?);
        }
        let mut rows = RowReader::open(path)?;
        let names = match rows.next_row()? {
            Some(row) => header(row.bytes, Separator::Comma),
            None => Vec::new(),
        };
        if !names.iter().map(String::as_str).eq(PLACE.into_iter().chain(COLUMNS)) {
            let message = format!("the header must be {},{}", PLACE.join(","), COLUMNS.join(","));
            return Err(rows.error(&message));
        }
        Ok(Self {
            rows,
            sensor: setup.sensor.clone(),
            bad_rows: files.bad_rows,
            scanner: scanner.clone(),
            poses,
            gathered: None,
            last: None,
            has_read: false,
            refused: 0,
            first_refused: None,
            failed: false,
        })
    }

    /// Takes the next row in; the reading before it, where it begins another one.
    fn step(&mut self) -> Result<Step, ModalityError> {
        let Some(row) = self.rows.next_row()? else { return Ok(Step::End) };
        let same = self.gathered.as_ref().is_some_and(|g| row.bytes.starts_with(&g.prefix));
        let outcome = if same {
            let gathered = self.gathered.as_mut().map(|g| (g.prefix.len(), g));
            gathered.map_or(Ok(()), |(length, gathered)| add_event(&row, length, gathered)).map(|()| None)
        } else {
            begin(&row, self.last).map(Some)
        };
        match outcome {
            Ok(None) => Ok(Step::Taken),
            Ok(Some(next)) => {
                self.last = next.place.sequence.map(|sequence| (next.place.arrival, sequence));
                Ok(self.gathered.replace(next).map_or(Step::Taken, |g| Step::Whole(Box::new(g))))
            }
            Err(message) => Err(self.rows.error(&message)),
        }
    }

    fn next_reading(&mut self) -> Result<Option<Reading>, ModalityError> {
        loop {
            let whole = match self.step()? {
                Step::Taken => continue,
                Step::Whole(whole) => *whole,
                Step::End => match self.gathered.take() {
                    Some(last) => last,
                    None if self.has_read => return Ok(None),
                    None => {
                        self.failed = true;
                        return Err(self.rows.error(&self.nothing_read()));
                    }
                },
            };
            let reading = self.finish(whole)?;
            self.has_read = true;
            return Ok(Some(reading));
        }
    }

    fn nothing_read(&self) -> String {
        match &self.first_refused {
            None => "no reading in this file".to_owned(),
            Some(first) => {
                format!(
                    "no reading in this file was taken: all {} were refused, the first: {first}",
                    self.refused
                )
            }
        }
    }

    fn finish(&self, mut gathered: Gathered) -> Result<Reading, ModalityError> {
        if !gathered.has_numbers && gathered.columns.len() == 1 {
            gathered.columns.clear();
        }
        let at = SimTime::middle(gathered.place.interval);
        let error = |message: String| ModalityError::Row {
            file: self.rows.file().to_owned(),
            line: gathered.line,
            message,
        };
        let mut known_poses = BTreeMap::new();
        for (name, poses) in &self.poses {
            let Ok(found) = poses.binary_search_by_key(&at, |(t, _)| *t) else {
                return Err(error(format!("the file of pose `{name}` has none at {:.6} s", at.seconds())));
            };
            known_poses.insert(name.clone(), poses[found].1);
        }
        // Where the scanner was moved, the world's places are put back into its frame.
        let scanner =
            known_poses.get(SCANNER).map_or_else(Vector3::zeros, |pose| 1e3 * pose.translation.vector);
        for end in gathered.columns.ends_mm().flatten() {
            let checked = self.scanner.check_end((Vector3::from(end) - scanner).into());
            checked.map_err(|why| {
                error(format!("{why}; where a bed moved it, give its `poses = {{ {SCANNER} = … }}`"))
            })?;
        }
        Ok(Reading {
            sensor: self.sensor.clone(),
            sequence: gathered.place.sequence.unwrap_or_default(),
            interval: gathered.place.interval,
            arrival: gathered.place.arrival,
            known_poses,
            payload: gathered.columns.into_frame()?,
        })
    }
}

/// What a row brought.
enum Step {
    Taken,
    Whole(Box<Gathered>),
    End,
}

/// The row's place, as the start of a reading.
fn begin(row: &RawRow<'_>, last: Option<(SimTime, u64)>) -> Result<Gathered, String> {
    let mut cells = Cells::new(row.bytes, Separator::Comma);
    let mut texts = [&b""[..]; 5];
    for (i, text) in texts.iter_mut().enumerate() {
        *text = cells.text().ok_or_else(|| wrong_count(row, i))?;
    }
    let prefix = &row.bytes[..row.bytes.len() - cells.rest().len()];
    let time = |i: usize| -> Result<SimTime, String> {
        let text = String::from_utf8_lossy(texts[i]);
        let seconds = text.parse::<f64>().ok().filter(|v| v.abs() <= MAX_TIME_S);
        let allowed = format!("a time of at most {MAX_TIME_S:e} s is allowed");
        seconds
            .map(SimTime::from_seconds)
            .ok_or_else(|| format!("column `{}` holds `{}`; {allowed}", PLACE[i], shown(texts[i])))
    };
    time(0)?;
    let (start, end, arrival) = (time(2)?, time(3)?, time(4)?);
    let sequence: u64 = String::from_utf8_lossy(texts[1])
        .parse()
        .map_err(|_| format!("`{}` is no count; a whole number from 0 is allowed", shown(texts[1])))?;
    if end < start || arrival < end {
        return Err("a reading starts, ends and arrives in this order".to_owned());
    }
    if last.is_some_and(|(before, count)| arrival < before || (arrival == before && sequence <= count)) {
        return Err(format!("time {:.6} s does not increase", arrival.seconds()));
    }
    let place = Place { interval: (start, end), arrival, sequence: Some(sequence) };
    let columns = Columns::default();
    let mut gathered =
        Gathered { prefix: prefix.to_vec(), place, columns, has_numbers: false, line: row.line };
    add_event(row, prefix.len(), &mut gathered)?;
    Ok(gathered)
}

/// Adds the event of a row, whose numbers begin at `offset`.
fn add_event(row: &RawRow<'_>, offset: usize, gathered: &mut Gathered) -> Result<(), String> {
    if gathered.columns.len() == MAX_WINDOW_LINES {
        return Err(format!("more than {MAX_WINDOW_LINES} events in one reading"));
    }
    let numbers = &row.bytes[offset..];
    if numbers == b",,,,,," {
        gathered.columns.push(&[f64::NAN; 7], false);
        return Ok(());
    }
    let mut cells = Cells::new(numbers, Separator::Comma);
    let mut values: LineRow = [0.0; 7];
    for (i, value) in values.iter_mut().enumerate() {
        *value = match cells.number() {
            Some(Ok(value)) => value,
            Some(Err(b"")) => return Err(format!("column `{}` is empty", COLUMNS[i])),
            Some(Err(cell)) => {
                return Err(format!(
                    "column `{}` holds `{}`; a finite number is allowed",
                    COLUMNS[i],
                    shown(cell)
                ));
            }
            None => return Err(wrong_count(row, PLACE.len() + i)),
        };
    }
    if cells.text().is_some() {
        return Err(format!("more than {} columns", PLACE.len() + COLUMNS.len()));
    }
    if !row.is_complete {
        return Err(super::line_file::CUT.to_owned());
    }
    check(&values)?;
    gathered.columns.push(&values, true);
    gathered.has_numbers = true;
    Ok(())
}

fn wrong_count(row: &RawRow<'_>, count: usize) -> String {
    let cut = if row.is_complete { "" } else { ", and no line end: the file is cut" };
    format!("{count} columns, expected {}{cut}", PLACE.len() + COLUMNS.len())
}

impl Iterator for SavedReader {
    type Item = Result<Recorded, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        match self.next_reading() {
            Ok(reading) => reading.map(|reading| Ok(Recorded::Reading(reading))),
            Err(error @ ModalityError::Row { .. }) if self.bad_rows == BadRows::Skip && !self.failed => {
                self.refused += 1;
                self.first_refused.get_or_insert(error.to_string());
                Some(Ok(Recorded::Skipped(error)))
            }
            Err(error) => {
                self.failed = true;
                Some(Err(error))
            }
        }
    }
}
