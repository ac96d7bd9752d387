//! The one place through which results and complaints are printed.
//!
//! `println!` panics when nobody reads any more (`lumenav … | head -1`). Here a closed pipe is [`ReaderGone`], which ends
//! the program quietly; a full disk behind `>` is an error like any other.

use anyhow::Context as _;
use std::fmt;
use std::io::{ErrorKind, Write as _};

/// Nobody reads the output any more. Not a failure: whoever closed the pipe had enough.
#[derive(Debug)]
pub struct ReaderGone;

impl fmt::Display for ReaderGone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("nobody reads the output any more")
    }
}

impl std::error::Error for ReaderGone {}

/// Writes to stdout.
///
/// # Errors
/// [`ReaderGone`], or what kept it from being written.
pub fn print(text: fmt::Arguments<'_>) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Err(ReaderGone.into()),
        other => other.context("cannot write to standard output"),
    }
}

/// Writes a line to stderr; where that is impossible there is nobody left to tell.
pub fn complain(text: fmt::Arguments<'_>) {
    writeln!(std::io::stderr().lock(), "{text}").ok();
}

/// Prints a value as JSON.
///
/// # Errors
/// As [`print`].
pub fn json<T: serde::Serialize>(value: &T) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    print(format_args!("{text}\n"))
}

/// A line on stdout; an error where nobody reads it.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::print(format_args!("{}\n", format_args!($($text)*))) };
}

/// A line on stderr.
macro_rules! complain {
    ($($text:tt)*) => { $crate::output::complain(format_args!($($text)*)) };
}
