//! `readings/`: what the sensors measured, in the formats that `replay` reads.
//!
//! | rows of the reading | file |
//! |---|---|
//! | labelled channels | `<sensor>.csv`: `t_s,<place>,<labels>`, one row a reading |
//! | events | `<sensor>.csv`: `t_s,<place>,<columns>`, one row an event |
//! | bytes (images) | `<sensor>/frames.csv`: `t_s,<place>,file`, and the files beside it |
//! | poses told by encoders | `<sensor>.<name>.tum` |
//!
//! `<place>` is `sequence,start_s,end_s,arrival_s`: the reading's count, its interval, and when it reached the estimators; so a
//! replay hands on the same readings at the same times, late ones late. Rows are in order of arrival. A masked channel or event
//! is an empty cell. Numbers are the shortest that read back to the same bits; times are exact to the nanosecond, and `t_s` is
//! the middle of the interval. A reading without events leaves a row with empty cells.

use crate::error::ReportError;
use crate::file::{OutputFile, csv_cell, seconds_text};
use crate::tum::StampedPose;
use lumenav_core::{Column, Frame, Name, Reading, Rows};
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Writes `readings/` into a folder.
pub struct ReadingsObserver {
    folder: PathBuf,
    tables: BTreeMap<Name, OutputFile>,
    poses: BTreeMap<(Name, String), OutputFile>,
}

impl ReadingsObserver {
    /// The files go into `folder/readings`; `folder` exists.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.join("readings"), tables: BTreeMap::new(), poses: BTreeMap::new() }
    }

    fn write(&mut self, reading: &Reading) -> Result<(), ReportError> {
        let time = place(reading);
        self.write_poses(reading)?;
        if let Some(bytes) = image_of(&reading.payload) {
            return self.write_image(reading, bytes, &time);
        }
        let table = match self.tables.entry(reading.sensor.clone()) {
            std::collections::btree_map::Entry::Occupied(table) => table.into_mut(),
            std::collections::btree_map::Entry::Vacant(place) => {
                let mut file = OutputFile::in_place(&self.folder.join(format!("{}.csv", reading.sensor)))?;
                file.line(&header(&reading.payload))?;
                place.insert(file)
            }
        };
        rows(&reading.payload, &time).iter().try_for_each(|row| table.line(row))
    }

    fn write_poses(&mut self, reading: &Reading) -> Result<(), ReportError> {
        for (name, pose) in &reading.known_poses {
            let key = (reading.sensor.clone(), name.clone());
            let file = match self.poses.entry(key) {
                std::collections::btree_map::Entry::Occupied(file) => file.into_mut(),
                std::collections::btree_map::Entry::Vacant(place) => place.insert(OutputFile::in_place(
                    &self.folder.join(format!("{}.{name}.tum", reading.sensor)),
                )?),
            };
            // A replay sees what the run saw, to the last bit.
            file.line(&StampedPose { at: reading.at(), world_from_capsule: *pose }.exact_tum_line())?;
        }
        Ok(())
    }

    fn write_image(&mut self, reading: &Reading, bytes: &[u8], time: &str) -> Result<(), ReportError> {
        let folder = self.folder.join(&*reading.sensor);
        if !self.tables.contains_key(&reading.sensor) {
            std::fs::create_dir_all(&folder).map_err(ReportError::file("cannot create folder", &folder))?;
            let mut table = OutputFile::in_place(&folder.join("frames.csv"))?;
            table.line(&format!("{PLACE},file"))?;
            self.tables.insert(reading.sensor.clone(), table);
        }
        let ending = match bytes {
            [0xff, 0xd8, ..] => "jpg",
            [0x89, b'P', b'N', b'G', ..] => "png",
            _ => "bin",
        };
        let name = format!("{:08}.{ending}", reading.sequence);
        let mut image = OutputFile::in_place(&folder.join(&name))?;
        image.write(bytes)?;
        image.finish()?;
        match self.tables.get_mut(&reading.sensor) {
            Some(table) => table.line(&format!("{time},{name}")),
            None => Ok(()),
        }
    }
}

/// Columns that place a reading in time.
const PLACE: &str = "t_s,sequence,start_s,end_s,arrival_s";

fn place(reading: &Reading) -> String {
    let (start, end) = reading.interval;
    let [at, start, end, arrival] = [reading.at(), start, end, reading.arrival].map(|t| seconds_text(t.0));
    format!("{at},{},{start},{end},{arrival}", reading.sequence)
}

/// The bytes of a reading that is an image.
fn image_of(frame: &Frame) -> Option<&[u8]> {
    frame.columns().iter().find_map(|column| match column {
        Column::Bytes(bytes) => Some(bytes.as_slice()),
        _ => None,
    })
}

/// The first line of a table.
fn header(frame: &Frame) -> String {
    let mut cells = vec![PLACE.to_owned()];
    match &frame.schema().rows {
        Rows::Channels(labels) => cells.extend(labels.iter().map(|label| csv_cell(label))),
        Rows::Events => cells.extend(frame.schema().columns.iter().map(|column| csv_cell(&column.name))),
    }
    cells.join(",")
}

/// The rows of a reading.
fn rows(frame: &Frame, time: &str) -> Vec<String> {
    match &frame.schema().rows {
        Rows::Channels(_) => {
            let mut row = time.to_owned();
            for i in 0..frame.rows() {
                row.push(',');
                if let Some(column) = frame.columns().first() {
                    row.push_str(&cell(column, i, frame.valid()[i]));
                }
            }
            vec![row]
        }
        Rows::Events if frame.rows() == 0 => vec![time.to_owned() + &",".repeat(frame.columns().len())],
        Rows::Events => (0..frame.rows())
            .map(|i| {
                let mut row = time.to_owned();
                for column in frame.columns() {
                    row.push(',');
                    row.push_str(&cell(column, i, frame.valid()[i]));
                }
                row
            })
            .collect(),
    }
}

/// One number; empty where it is masked.
fn cell(column: &Column, row: usize, valid: bool) -> String {
    match column {
        _ if !valid => String::new(),
        Column::F64(values) => format!("{:?}", values[row]),
        Column::U32(values) => values[row].to_string(),
        // Readings with bytes are images and do not come here.
        Column::Bytes(_) => String::new(),
    }
}

impl RunObserver for ReadingsObserver {
    fn start(&mut self, _: &RunHeader) -> Result<(), ObserverError> {
        std::fs::create_dir_all(&self.folder)
            .map_err(ReportError::file("cannot create folder", &self.folder))
            .map_err(|e| ObserverError::new("readings", e))
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        let RunEvent::Reading { reading, .. } = event else { return Ok(()) };
        self.write(reading).map_err(|e| ObserverError::new("readings", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.tables
            .values_mut()
            .chain(self.poses.values_mut())
            .try_for_each(OutputFile::finish)
            .map_err(|e| ObserverError::new("readings", e))
    }
}
