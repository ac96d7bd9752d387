//! What a reading of this modality holds: the lines of a window, as events.
//!
//! One schema, `lines_of_response/1`, for simulator, reader and front end: `t_ms` since the scenario's start and both ends in the
//! world, mm. Milliseconds and millimetres because the columns are those of the files; estimators get [`Line`]s in SI.

use crate::Line;
use lumenav_core::{Column, Frame, ModalityError, Schema};
use nalgebra::Vector3;
use std::sync::{Arc, LazyLock};

/// Where a bed has put the scanner, as a reading names it: `world_from_scanner`.
pub const SCANNER: &str = "scanner";

/// Name and version of the schema.
pub const SCHEMA: &str = "lines_of_response/1";
/// Its columns.
pub const COLUMNS: [&str; 7] = ["t_ms", "x1_mm", "y1_mm", "z1_mm", "x2_mm", "y2_mm", "z2_mm"];

/// The schema of all readings of this modality.
pub fn schema() -> Arc<Schema> {
    static SHARED: LazyLock<Arc<Schema>> = LazyLock::new(|| Schema::events(SCHEMA, &COLUMNS));
    SHARED.clone()
}

/// Lines as columns, and which of them are there.
#[derive(Clone, Debug, Default)]
pub(crate) struct Columns {
    columns: [Vec<f64>; 7],
    valid: Vec<bool>,
}

impl Columns {
    pub(crate) fn with_capacity(lines: usize) -> Self {
        Self { columns: std::array::from_fn(|_| Vec::with_capacity(lines)), valid: Vec::with_capacity(lines) }
    }

    /// Adds a line in the columns' own units.
    pub(crate) fn push(&mut self, row: &[f64; 7], valid: bool) {
        for (column, value) in self.columns.iter_mut().zip(row) {
            column.push(*value);
        }
        self.valid.push(valid);
    }

    pub(crate) fn len(&self) -> usize {
        self.valid.len()
    }

    /// Both ends of each line that is one, mm.
    pub(crate) fn ends_mm(&self) -> impl Iterator<Item = [[f64; 3]; 2]> {
        let end = |k: usize, first: usize| std::array::from_fn(|axis| self.columns[first + axis][k]);
        let is_line = |k: &usize| self.valid[*k];
        (0..self.len()).filter(is_line).map(move |k| [end(k, 1), end(k, 4)])
    }

    pub(crate) fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
        self.valid.clear();
    }

    pub(crate) fn into_frame(self) -> Result<Frame, ModalityError> {
        Ok(Frame::new(schema(), self.columns.into_iter().map(Column::F64).collect(), self.valid)?)
    }
}

/// A window's lines as a reading's payload.
///
/// # Errors
/// None that a caller could cause; the frame's own check is handed on.
pub fn frame(lines: &[Line]) -> Result<Frame, ModalityError> {
    let mut columns = Columns::with_capacity(lines.len());
    for line in lines {
        let [a, b] = line.ends_world_m.map(|end| end * 1e3);
        columns.push(&[line.t_s * 1e3, a.x, a.y, a.z, b.x, b.y, b.z], true);
    }
    columns.into_frame()
}

/// The lines of a payload, into `out` (emptied first), in their order. Masked events are not there. What is no line (a number that
/// is not finite, ends at one place) is left out and counted: the answer. Whoever reads says so.
///
/// # Errors
/// [`ModalityError::Reading`] where the payload has other columns.
pub fn lines(payload: &Frame, out: &mut Vec<Line>) -> Result<usize, ModalityError> {
    let column = |name: &str| payload.f64(name);
    let [t, x1, y1, z1, x2, y2, z2] = COLUMNS.map(column);
    let (t, ends) = (t?, [[x1?, y1?, z1?], [x2?, y2?, z2?]]);
    out.clear();
    let mut unusable = 0;
    for (i, valid) in payload.valid().iter().enumerate() {
        if !valid {
            continue;
        }
        let line = Line {
            t_s: t[i] * 1e-3,
            ends_world_m: ends.map(|[x, y, z]| Vector3::new(x[i], y[i], z[i]) * 1e-3),
        };
        if line.t_s.is_finite() && line.direction().is_some() {
            out.push(line);
        } else {
            unusable += 1;
        }
    }
    Ok(unusable)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(t_s: f64, x: f64) -> Line {
        Line { t_s, ends_world_m: [Vector3::new(x, 0.43205, -0.1), Vector3::new(0.02, -0.44, 0.05)] }
    }

    #[test]
    fn law_lines_round_trip_through_a_payload() {
        let there = [line(0.0125, 0.1), line(1.5, -0.3)];
        let frame = frame(&there).unwrap();
        let mut back = vec![line(9.0, 9.0)];
        assert_eq!(lines(&frame, &mut back).unwrap(), 0);
        assert_eq!(back.len(), 2);
        for (a, b) in there.iter().zip(&back) {
            assert!((a.t_s - b.t_s).abs() < 1e-15);
            assert!((a.ends_world_m[0] - b.ends_world_m[0]).norm() < 1e-15);
            assert!((a.ends_world_m[1] - b.ends_world_m[1]).norm() < 1e-15);
        }
    }

    #[test]
    fn law_what_is_no_line_is_counted_and_what_is_masked_is_not_there() {
        let mut bad = line(0.1, 0.1);
        bad.ends_world_m[1] = bad.ends_world_m[0];
        let mut frame = frame(&[line(0.0, 0.1), bad, line(f64::NAN, 0.1), line(0.2, 0.2)]).unwrap();
        frame.mask_row(0);
        let mut back = Vec::new();
        assert_eq!(lines(&frame, &mut back).unwrap(), 2);
        assert_eq!(back.len(), 1);
        let other = Frame::of_values(Schema::channels("a/1", "v", vec!["a".into()]), vec![1.0]).unwrap();
        assert!(lines(&other, &mut back).is_err());
    }
}
