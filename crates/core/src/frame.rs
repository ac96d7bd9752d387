//! What a sensor hands over: columns with a schema and a validity mask.
//!
//! No closed enum of sensor types and no `Any`: recorded data, CSV, Parquet, the viewer and a child process carry a
//! reading of a modality they never heard of.
//!
//! Two shapes cover every sensor. *Channels*: a fixed set of named channels, one value each (48 magnetometer axes, 12
//! signal strengths); one reading is one row of a CSV file. *Events*: any number of rows with the same columns (lines
//! of response, features); each is one row of a CSV file. An absent channel or row has `valid == false`; its number
//! means nothing and is written as an empty cell.

use crate::time::SimTime;
use crate::{ModalityError, Name};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// One column's values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Column {
    /// Numbers with the unit that the column's name ends in.
    F64(Vec<f64>),
    /// Indices: crystals, markers, channels.
    U32(Vec<u32>),
    /// Raw bytes: an encoded image.
    Bytes(Vec<u8>),
}

/// What the rows of a frame are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Rows {
    /// Row `i` is the channel with this label; the frame has exactly these rows and one column.
    Channels(Vec<String>),
    /// Rows are events, any number of them.
    Events,
}

/// Kind of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ColumnKind {
    /// [`Column::F64`]
    F64,
    /// [`Column::U32`]
    U32,
    /// [`Column::Bytes`]; its length is free.
    Bytes,
}

/// Name (with unit suffix) and kind of a column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColumnSpec {
    /// For example `flux_tesla`, `x1_mm`.
    pub name: String,
    /// What the column holds.
    pub kind: ColumnKind,
}

/// Names and meaning of a frame's columns; shared by all frames of a sensor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schema {
    /// Name and version, for example `magnetometers/1`.
    pub name: String,
    /// The columns in their order.
    pub columns: Vec<ColumnSpec>,
    /// What a row is.
    pub rows: Rows,
}

impl Schema {
    /// A schema of labelled channels with one `F64` column called `column`.
    pub fn channels(name: &str, column: &str, labels: Vec<String>) -> Arc<Self> {
        Arc::new(Self {
            name: name.to_owned(),
            columns: vec![ColumnSpec { name: column.to_owned(), kind: ColumnKind::F64 }],
            rows: Rows::Channels(labels),
        })
    }

    /// A schema of events with `F64` columns of these names.
    pub fn events(name: &str, columns: &[&str]) -> Arc<Self> {
        let columns = columns
            .iter()
            .map(|column| ColumnSpec { name: (*column).to_owned(), kind: ColumnKind::F64 })
            .collect();
        Arc::new(Self { name: name.to_owned(), columns, rows: Rows::Events })
    }
}

/// A frame that contradicts its schema, or a reader that asks for what is not there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Column count, kind or length differ from the schema.
    #[error("frame of schema `{schema}`: {what}")]
    Shape {
        /// The schema's name.
        schema: String,
        /// What differs.
        what: String,
    },
    /// The reader asked for a column that the schema does not have.
    #[error("frame of schema `{schema}` has no column `{column}` of the wanted kind")]
    NoColumn {
        /// The schema's name.
        schema: String,
        /// The wanted column.
        column: String,
    },
}

/// Columns of equal length and a validity mask, one bit per row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    schema: Arc<Schema>,
    columns: Vec<Column>,
    valid: Vec<bool>,
}

impl Frame {
    /// A frame that agrees with its schema.
    ///
    /// # Errors
    /// [`FrameError::Shape`] where column count, kinds or lengths do not.
    pub fn new(schema: Arc<Schema>, columns: Vec<Column>, valid: Vec<bool>) -> Result<Self, FrameError> {
        let shape = |what: String| FrameError::Shape { schema: schema.name.clone(), what };
        if columns.len() != schema.columns.len() {
            return Err(shape(format!("{} columns, schema has {}", columns.len(), schema.columns.len())));
        }
        if let Rows::Channels(labels) = &schema.rows
            && labels.len() != valid.len()
        {
            return Err(shape(format!("{} rows, schema has {} channels", valid.len(), labels.len())));
        }
        for (column, spec) in columns.iter().zip(&schema.columns) {
            let (kind, length) = match column {
                Column::F64(v) => (ColumnKind::F64, v.len()),
                Column::U32(v) => (ColumnKind::U32, v.len()),
                Column::Bytes(_) => (ColumnKind::Bytes, valid.len()),
            };
            if kind != spec.kind {
                return Err(shape(format!(
                    "column `{}` is {kind:?}, schema says {:?}",
                    spec.name, spec.kind
                )));
            }
            if length != valid.len() {
                return Err(shape(format!("column `{}` has {length} rows of {}", spec.name, valid.len())));
            }
        }
        Ok(Self { schema, columns, valid })
    }

    /// A frame with one `F64` column in which every value that is not finite is masked.
    ///
    /// # Errors
    /// [`FrameError::Shape`] as [`Frame::new`].
    pub fn of_values(schema: Arc<Schema>, values: Vec<f64>) -> Result<Self, FrameError> {
        let valid = values.iter().map(|v| v.is_finite()).collect();
        Self::new(schema, vec![Column::F64(values)], valid)
    }

    /// Names of the columns and meaning of the rows.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    /// All columns, in the schema's order.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The numbers of a column.
    ///
    /// # Errors
    /// [`FrameError::NoColumn`] where there is none of that name with numbers.
    pub fn f64(&self, column: &str) -> Result<&[f64], FrameError> {
        let found = self.schema.columns.iter().position(|c| c.name == column);
        match found.map(|i| &self.columns[i]) {
            Some(Column::F64(values)) => Ok(values),
            _ => Err(FrameError::NoColumn { schema: self.schema.name.clone(), column: column.to_owned() }),
        }
    }

    /// The indices of a column.
    ///
    /// # Errors
    /// [`FrameError::NoColumn`] where there is none of that name with indices.
    pub fn u32(&self, column: &str) -> Result<&[u32], FrameError> {
        let found = self.schema.columns.iter().position(|c| c.name == column);
        match found.map(|i| &self.columns[i]) {
            Some(Column::U32(values)) => Ok(values),
            _ => Err(FrameError::NoColumn { schema: self.schema.name.clone(), column: column.to_owned() }),
        }
    }

    /// Which rows hold a value.
    pub fn valid(&self) -> &[bool] {
        &self.valid
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.valid.len()
    }

    /// Masks one row: the channel was lost.
    pub fn mask_row(&mut self, row: usize) {
        self.valid[row] = false;
    }

    /// The columns, to change numbers in place (faults that the world applies to a reading); lengths must stay.
    pub fn columns_mut(&mut self) -> &mut [Column] {
        &mut self.columns
    }
}

/// One reading of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The sensor's name in the scenario.
    pub sensor: Name,
    /// Counts this sensor's readings from 0, lost ones included.
    pub sequence: u64,
    /// The interval it integrates over (an exposure, a 50 ms window); an instant has start == end.
    pub interval: (SimTime, SimTime),
    /// When it reaches the estimator; never before the interval's end.
    pub arrival: SimTime,
    /// Poses that encoders tell both sides (`world_from_<name>`: bed, robot arm, body-worn array), as told: not truth.
    pub known_poses: BTreeMap<String, Isometry3<f64>>,
    /// The columns.
    pub payload: Frame,
}

impl Reading {
    /// The instant a reading stands for: the middle of its interval.
    pub fn at(&self) -> SimTime {
        SimTime::middle(self.interval)
    }
}

impl From<FrameError> for ModalityError {
    fn from(error: FrameError) -> Self {
        Self::Reading(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_frame_agrees_with_its_schema_or_is_refused() {
        let schema = Schema::channels("test/1", "flux_tesla", vec!["a".into(), "b".into()]);
        assert!(Frame::of_values(schema.clone(), vec![1.0, 2.0]).is_ok());
        assert!(Frame::of_values(schema.clone(), vec![1.0]).is_err());
        assert!(Frame::new(schema.clone(), vec![Column::U32(vec![1, 2])], vec![true; 2]).is_err());
        assert!(Frame::new(schema, vec![], vec![true; 2]).is_err());
    }

    #[test]
    fn law_absent_is_masked_never_zero() {
        let schema = Schema::channels("test/1", "flux_tesla", vec!["a".into(), "b".into()]);
        let frame = Frame::of_values(schema, vec![f64::NAN, 2.0]).unwrap();
        assert_eq!(frame.valid(), &[false, true]);
        assert!(frame.f64("other").is_err());
        assert!(frame.u32("flux_tesla").is_err());
    }
}
