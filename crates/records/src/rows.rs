//! Rows of numbers, read as bytes: for files of many millions of rows, where [`crate::Table`] would cost more than what is done
//! with them.
//!
//! Cells are separated by commas, semicolons or white space. Blank lines and lines that start with `#` are passed over, a byte
//! order mark too. Numbers are read to the nearest `f64` (Lemire 2021), so what was written with enough digits comes back to the
//! same bits. Memory: one buffer, whatever the file's size.

use lumenav_core::ModalityError;
use std::io::Read;
use std::path::Path;

/// Bytes asked of the file at a time.
const CHUNK: usize = 256 * 1024;
/// A line longer than this is no row of numbers.
pub const MAX_LINE_BYTES: usize = 1024 * 1024;

/// A text file as lines of bytes.
pub struct RowReader {
    file: String,
    input: Box<dyn Read + Send>,
    buffer: Vec<u8>,
    /// Unread part of the buffer.
    start: usize,
    end: usize,
    /// Number of the line last handed out, from 1.
    line: u64,
    at_end: bool,
}

/// One line, without its end.
#[derive(Clone, Copy, Debug)]
pub struct RawRow<'a> {
    /// Its bytes, no white space at either end.
    pub bytes: &'a [u8],
    /// Its number in the file, from 1.
    pub line: u64,
    /// Whether a line end follows; the last line of a file that was cut has none.
    pub is_complete: bool,
}

impl RowReader {
    /// Opens a file, unpacking `.gz`.
    ///
    /// # Errors
    /// [`ModalityError::File`] with the path.
    pub fn open(path: &Path) -> Result<Self, ModalityError> {
        Ok(Self::new(&path.display().to_string(), crate::open(path)?))
    }

    /// Reads from anything; `file` is its name for messages.
    pub fn new(file: &str, input: Box<dyn Read + Send>) -> Self {
        Self {
            file: file.to_owned(),
            input,
            buffer: vec![0; CHUNK],
            start: 0,
            end: 0,
            line: 0,
            at_end: false,
        }
    }

    /// The file's name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Number of the line last handed out, from 1; 0 before the first.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// An error at the line last handed out.
    pub fn error(&self, message: &str) -> ModalityError {
        ModalityError::Row { file: self.file.clone(), line: self.line, message: message.to_owned() }
    }

    /// The next line that is neither blank nor a comment; `None` at the end of the file.
    ///
    /// # Errors
    /// [`ModalityError::File`] where the file cannot be read on (a packed file cut short) or holds a line of more than
    /// [`MAX_LINE_BYTES`]: neither is a row that could be passed over.
    pub fn next_row(&mut self) -> Result<Option<RawRow<'_>>, ModalityError> {
        loop {
            let Some((from, to, is_complete)) = self.next_line()? else { return Ok(None) };
            self.line += 1;
            let mut bytes = &self.buffer[from..to];
            if self.line == 1 {
                bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            }
            let bytes = bytes.trim_ascii();
            if !bytes.is_empty() && bytes[0] != b'#' {
                // Indices instead of the slice: the borrow of the loop's other turns must end.
                let offset = bytes.as_ptr() as usize - self.buffer.as_ptr() as usize;
                let bytes = &self.buffer[offset..offset + bytes.len()];
                return Ok(Some(RawRow { bytes, line: self.line, is_complete }));
            }
        }
    }

    /// Start and end of the next line in the buffer, and whether a line end followed.
    fn next_line(&mut self) -> Result<Option<(usize, usize, bool)>, ModalityError> {
        let mut searched = self.start;
        loop {
            if let Some(found) = memchr::memchr(b'\n', &self.buffer[searched..self.end]) {
                let (from, to) = (self.start, searched + found);
                self.start = to + 1;
                return Ok(Some((from, to, true)));
            }
            searched = self.end;
            if self.at_end {
                let (from, to) = (self.start, self.end);
                self.start = self.end;
                return Ok((from < to).then_some((from, to, false)));
            }
            searched -= self.make_room()?;
            self.fill()?;
        }
    }

    /// Makes room behind the unread part; the number of bytes by which that moved forward.
    fn make_room(&mut self) -> Result<usize, ModalityError> {
        let moved = self.start;
        self.buffer.copy_within(self.start..self.end, 0);
        (self.start, self.end) = (0, self.end - moved);
        if self.end > MAX_LINE_BYTES {
            let message =
                format!("line {} is longer than {MAX_LINE_BYTES} bytes: no text of rows", self.line + 1);
            return Err(self.cannot_read(std::io::Error::new(std::io::ErrorKind::InvalidData, message)));
        }
        if self.buffer.len() < self.end + CHUNK {
            self.buffer.resize(self.end + CHUNK, 0);
        }
        Ok(moved)
    }

    fn fill(&mut self) -> Result<(), ModalityError> {
        match self.input.read(&mut self.buffer[self.end..]) {
            Ok(0) => self.at_end = true,
            Ok(read) => self.end += read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(source) => {
                let message = format!("cannot be read on after line {}: {source}", self.line);
                return Err(self.cannot_read(std::io::Error::new(source.kind(), message)));
            }
        }
        Ok(())
    }

    fn cannot_read(&self, source: std::io::Error) -> ModalityError {
        ModalityError::File { file: self.file.clone(), source }
    }
}

/// What stands between two cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// One comma, white space around it.
    Comma,
    /// One semicolon, white space around it.
    Semicolon,
    /// White space, any amount.
    Space,
}

impl Separator {
    /// What a row's cells are separated by.
    pub fn of(row: &[u8]) -> Self {
        match row.iter().find(|b| matches!(b, b',' | b';')) {
            Some(b',') => Self::Comma,
            Some(_) => Self::Semicolon,
            None => Self::Space,
        }
    }

    fn byte(self) -> Option<u8> {
        match self {
            Self::Comma => Some(b','),
            Self::Semicolon => Some(b';'),
            Self::Space => None,
        }
    }
}

/// The cells of a row, one after another.
#[derive(Clone, Copy, Debug)]
pub struct Cells<'a> {
    rest: &'a [u8],
    separator: Separator,
    /// Whether a cell is still to come (a row may end with a separator, and then with an empty cell).
    more: bool,
}

impl<'a> Cells<'a> {
    /// The cells of a row without white space at its ends.
    pub fn new(row: &'a [u8], separator: Separator) -> Self {
        Self { rest: row, separator, more: !row.is_empty() }
    }

    /// Where the next cell begins, as bytes from here to the row's end.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// The next cell as a finite number. `Some(Err(cell))` where it is none, with its text.
    #[inline]
    pub fn number(&mut self) -> Option<Result<f64, &'a [u8]>> {
        if !self.more {
            return None;
        }
        if let Ok((value, length)) = fast_float2::parse_partial::<f64, _>(self.rest)
            && value.is_finite()
            && let Some(rest) = self.after(length)
        {
            self.rest = rest;
            return Some(Ok(value));
        }
        // Slow way: white space before the number, an empty cell, or something else.
        let cell = self.text()?;
        Some(fast_float2::parse::<f64, _>(cell).ok().filter(|v| v.is_finite()).ok_or(cell))
    }

    /// The next cell's bytes, no white space at either end.
    pub fn text(&mut self) -> Option<&'a [u8]> {
        if !self.more {
            return None;
        }
        let end = match self.separator.byte() {
            Some(byte) => memchr::memchr(byte, self.rest),
            None => self.rest.iter().position(u8::is_ascii_whitespace),
        };
        let cell = &self.rest[..end.unwrap_or(self.rest.len())];
        match end {
            Some(end) if self.separator == Separator::Space => {
                self.rest = self.rest[end..].trim_ascii_start();
            }
            Some(end) => self.rest = &self.rest[end + 1..],
            None => self.rest = &[],
        }
        self.more = end.is_some();
        Some(cell.trim_ascii())
    }

    /// What follows a cell of so many bytes, where it ends there.
    #[inline]
    fn after(&mut self, length: usize) -> Option<&'a [u8]> {
        let rest = &self.rest[length..];
        let Some(next) = rest.first() else {
            self.more = false;
            return Some(rest);
        };
        match self.separator.byte() {
            Some(byte) if *next == byte => Some(&rest[1..]),
            None if next.is_ascii_whitespace() => Some(rest.trim_ascii_start()),
            _ => None,
        }
    }
}

/// Bytes as text for a message, shortened.
pub fn shown(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST)]).escape_debug().to_string();
    if bytes.len() > LONGEST { format!("{text}…") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn reader(text: &[u8]) -> RowReader {
        RowReader::new("f", Box::new(std::io::Cursor::new(text.to_vec())))
    }

    fn numbers(row: &str) -> Vec<Result<f64, String>> {
        let mut cells = Cells::new(row.trim().as_bytes(), Separator::of(row.as_bytes()));
        std::iter::from_fn(|| cells.number()).map(|v| v.map_err(shown)).collect()
    }

    #[test]
    fn closed_form_lines_comments_and_the_cut_last_line() {
        let mut rows = reader(b"\xef\xbb\xbf# c\n\n 1,2 \r\n#x\n3,4\n5,");
        let mut seen = Vec::new();
        while let Some(row) = rows.next_row().unwrap() {
            seen.push((row.bytes.to_vec(), row.line, row.is_complete));
        }
        let wanted: [(&[u8], u64, bool); 3] = [(b"1,2", 3, true), (b"3,4", 5, true), (b"5,", 6, false)];
        assert_eq!(seen, wanted.map(|(b, l, c)| (b.to_vec(), l, c)));
    }

    #[test]
    fn closed_form_cells_in_all_separators() {
        for row in ["1,-2.5, 3e2", "1;-2.5;3e2", "1 -2.5\t 3e2", "1 , -2.5 ,3e2"] {
            assert_eq!(numbers(row), [Ok(1.0), Ok(-2.5), Ok(300.0)], "{row}");
        }
        assert_eq!(
            numbers("1,,x,nan,"),
            [Ok(1.0), Err(String::new()), Err("x".into()), Err("nan".into()), Err(String::new())]
        );
        assert_eq!(numbers("1.5mm 2"), [Err("1.5mm".into()), Ok(2.0)]);
    }

    #[test]
    fn law_a_line_without_end_is_refused_in_bounded_memory() {
        let mut rows = RowReader::new("f", Box::new(std::io::repeat(b'1')));
        assert!(rows.next_row().unwrap_err().to_string().contains("longer than"));
        assert!(rows.buffer.len() < 3 * MAX_LINE_BYTES);
    }

    #[test]
    fn law_lines_longer_than_a_chunk_come_whole() {
        let long = "7".repeat(CHUNK + 10);
        let mut rows = reader(format!("a\n{long}\nb\n").as_bytes());
        let mut lengths = Vec::new();
        while let Some(row) = rows.next_row().unwrap() {
            lengths.push(row.bytes.len());
        }
        assert_eq!(lengths, [1, CHUNK + 10, 1]);
    }

    proptest! {
        #[test]
        fn law_numbers_read_back_to_the_same_bits(values in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::ZERO, 1..9)) {
            for separator in [",", ";", " ", "\t"] {
                let row = values.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(separator);
                let read = numbers(&row);
                prop_assert_eq!(read.len(), values.len());
                for (read, wanted) in read.iter().zip(&values) {
                    prop_assert_eq!(read.as_ref().map(|v| v.to_bits()), Ok(wanted.to_bits()));
                }
            }
        }

        #[test]
        fn law_any_bytes_are_rows_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut rows = reader(&bytes);
            while let Some(row) = rows.next_row().unwrap() {
                let mut cells = Cells::new(row.bytes, Separator::of(row.bytes));
                let count = std::iter::from_fn(|| cells.number()).count();
                prop_assert!(count >= 1 && count <= row.bytes.len() + 1);
            }
        }
    }
}
