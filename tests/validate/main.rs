//! Full-size acceptance: every line an issue promises, measured, written to `docs/validation/<issue>.json`.
//!
//! ```sh
//! cargo build --release && cargo run --release --example validate -- foundation|pet|magnetic|gut [WORDS…]
//! ```
//!
//! Words after the issue choose the rows whose name holds one of them; the others keep what the file says of them. A row that
//! cannot be measured on this machine says why and does not pass.

mod figures;
mod foundation;
mod gut;
mod gut_speed;
mod magnetic;
mod pet;
mod row;
mod tools;

use row::Sheet;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let issue = arguments.next().unwrap_or_default();
    let words: Vec<String> = arguments.collect();
    let mut sheet = match Sheet::open(&issue, words) {
        Ok(sheet) => sheet,
        Err(error) => return refuse(&error),
    };
    match issue.as_str() {
        "foundation" => foundation::rows(&mut sheet),
        "pet" => pet::rows(&mut sheet),
        "magnetic" => magnetic::rows(&mut sheet),
        "gut" => gut::rows(&mut sheet),
        other => return refuse(&format!("no issue `{other}`; allowed: foundation, pet, magnetic, gut")),
    }
    match sheet.close() {
        Ok(0) => {}
        Ok(failed) => refuse(&format!("{failed} rows do not pass")),
        Err(error) => refuse(&error),
    }
}

fn refuse(message: &str) {
    eprintln!("{message}");
    std::process::exit(1);
}
