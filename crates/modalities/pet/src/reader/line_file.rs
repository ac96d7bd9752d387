//! Lines and list mode as text.

use super::{Format, LineRow, LineSource, check, header};
use crate::payload::COLUMNS;
use crate::{CrystalIndex, Scanner};
use lumenav_core::ModalityError;
use lumenav_records::rows::{Cells, RawRow, RowReader, Separator, shown};
use std::path::Path;

/// Columns of list mode.
pub(super) const LIST_MODE: [&str; 5] = ["t_ms", "xa", "za", "xb", "zb"];

/// The columns that a format reads.
pub(super) fn wanted(format: Format) -> &'static [&'static str] {
    if format == Format::ListMode { &LIST_MODE } else { &COLUMNS }
}

/// Which cell of a row is which number.
pub(super) struct RowLayout {
    separator: Separator,
    names: Vec<String>,
    /// Per cell: its place in [`wanted`].
    slots: Vec<Option<usize>>,
}

impl RowLayout {
    /// From the first row: a header, or numbers in the format's own order (more may follow). Whether it was a header.
    pub(super) fn of(first: &[u8], wanted: &[&str]) -> Result<(Self, bool), String> {
        let separator = Separator::of(first);
        let mut cells = Cells::new(first, separator);
        let numbers: Vec<bool> = std::iter::from_fn(|| cells.number()).map(|cell| cell.is_ok()).collect();
        // One number in a header's place is a bad first row of numbers, not a header.
        let is_header = !numbers.iter().any(|is_number| *is_number);
        let names = if is_header {
            header(first, separator)
        } else {
            let extra = (wanted.len()..numbers.len()).map(|i| format!("column {}", i + 1));
            wanted.iter().map(ToString::to_string).chain(extra).collect()
        };
        if !is_header && numbers.len() < wanted.len() {
            return Err(format!("{} cells; expected {}: {}", numbers.len(), wanted.len(), wanted.join(", ")));
        }
        let mut slots = vec![None; names.len()];
        for (place, name) in wanted.iter().enumerate() {
            let mut at = names.iter().enumerate().filter(|(_, n)| n == name).map(|(i, _)| i);
            match (at.next(), at.next()) {
                (Some(one), None) => slots[one] = Some(place),
                (None, _) => {
                    return Err(format!("no column `{name}`; the file has: {}", shown_names(&names)));
                }
                (Some(_), Some(_)) => return Err(format!("column `{name}` is there twice")),
            }
        }
        Ok((Self { separator, names, slots }, is_header))
    }

    /// The numbers of a row.
    #[inline]
    pub(super) fn parse(&self, row: &RawRow<'_>, out: &mut [f64]) -> Result<(), String> {
        let mut cells = Cells::new(row.bytes, self.separator);
        for (i, slot) in self.slots.iter().enumerate() {
            let Some(place) = slot else {
                if cells.text().is_none() {
                    return Err(self.wrong_count(row));
                }
                continue;
            };
            match cells.number() {
                Some(Ok(value)) => out[*place] = value,
                Some(Err(cell)) => return Err(self.bad_cell(i, cell)),
                None => return Err(self.wrong_count(row)),
            }
        }
        if cells.text().is_some() {
            return Err(self.wrong_count(row));
        }
        if !row.is_complete {
            return Err(CUT.to_owned());
        }
        Ok(())
    }

    fn bad_cell(&self, index: usize, cell: &[u8]) -> String {
        let name = &self.names[index];
        if cell.is_empty() {
            format!("column {} (`{name}`) is empty", index + 1)
        } else {
            format!("column {} (`{name}`) holds `{}`; a finite number is allowed", index + 1, shown(cell))
        }
    }

    fn wrong_count(&self, row: &RawRow<'_>) -> String {
        let mut cells = Cells::new(row.bytes, self.separator);
        let count = std::iter::from_fn(|| cells.text()).count();
        let cut = if row.is_complete { "" } else { ", and no line end: the file is cut" };
        format!("{count} columns, expected {}{cut}", self.slots.len())
    }
}

/// A last line without an end: its last number may lack digits.
pub(super) const CUT: &str =
    "the file ends within this line: it is cut (a file that is whole ends its last line)";

fn shown_names(names: &[String]) -> String {
    shown(names.join(", ").as_bytes())
}

/// Lines from the crystals that fired.
pub(super) struct Crystals {
    scanner: Scanner,
}

impl Crystals {
    pub(super) fn new(scanner: &Scanner) -> Self {
        Self { scanner: scanner.clone() }
    }

    /// `t_ms,xa,za,xb,zb` as a line between the crystals' centres.
    pub(super) fn line(&self, values: &[f64]) -> Result<LineRow, String> {
        let a = self.crystal(values, 1)?;
        let b = self.crystal(values, 3)?;
        let block = |crystal: CrystalIndex| (crystal.x / self.scanner.grid.columns) as usize;
        if !self.scanner.can_coincide(block(a), block(b)) {
            return Err(format!(
                "blocks {} and {} of scanner `{}` do not fire together",
                block(a),
                block(b),
                self.scanner.name
            ));
        }
        let place = |crystal| self.scanner.position(crystal).unwrap_or_default() * 1e3;
        let (p, q) = (place(a), place(b));
        Ok([values[0], p.x, p.y, p.z, q.x, q.y, q.z])
    }

    fn crystal(&self, values: &[f64], first: usize) -> Result<CrystalIndex, String> {
        let grid = &self.scanner.grid;
        let counts = [self.scanner.blocks.len() as u32 * grid.columns, grid.rows];
        let mut index = [0; 2];
        for (i, (value, count)) in values[first..first + 2].iter().zip(counts).enumerate() {
            if value.fract() != 0.0 || *value < 0.0 || *value >= f64::from(count) {
                return Err(format!(
                    "column `{}` holds {value}; scanner `{}` has 0 to {}",
                    LIST_MODE[first + i],
                    self.scanner.name,
                    count - 1
                ));
            }
            index[i] = *value as u32;
        }
        Ok(CrystalIndex { x: index[0], z: index[1] })
    }
}

/// A text file of lines or list mode.
pub(super) struct LineFile {
    rows: RowReader,
    layout: RowLayout,
    crystals: Option<Crystals>,
}

impl LineFile {
    pub(super) fn open(path: &Path, format: Format, scanner: &Scanner) -> Result<Self, ModalityError> {
        let wanted = wanted(format);
        let mut rows = RowReader::open(path)?;
        let layout = match rows.next_row()? {
            Some(first) if !first.is_complete => Err(CUT.to_owned()),
            Some(first) => RowLayout::of(first.bytes, wanted),
            None => Err("the file is empty".to_owned()),
        };
        let (layout, is_header) = layout.map_err(|message| ModalityError::Row {
            file: rows.file().to_owned(),
            line: rows.line().max(1),
            message,
        })?;
        if !is_header {
            // The first row is a line, too.
            rows = RowReader::open(path)?;
        }
        let crystals = (format == Format::ListMode).then(|| Crystals::new(scanner));
        Ok(Self { rows, layout, crystals })
    }
}

impl LineSource for LineFile {
    fn next_line(&mut self) -> Result<Option<LineRow>, ModalityError> {
        let mut values = [0.0; 7];
        let parsed = match self.rows.next_row()? {
            None => return Ok(None),
            Some(row) => self.layout.parse(&row, &mut values),
        };
        let line = parsed.and_then(|()| match &self.crystals {
            Some(crystals) => crystals.line(&values),
            None => check(&values).map(|()| values),
        });
        line.map(Some).map_err(|message| self.rows.error(&message))
    }

    fn error(&self, message: &str) -> ModalityError {
        self.rows.error(message)
    }
}
