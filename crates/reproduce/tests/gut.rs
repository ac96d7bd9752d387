//! The passage through the gut in seconds: it runs, it is the same for any number of threads, and what can be seen of few persons is as published.

mod support;

use lumenav_reproduce::{OneAfterAnother, Table};
use support::{Backwards, quick};

fn ours(table: &Table, quantity: &str) -> f64 {
    let row = table.rows.iter().find(|row| row.quantity.starts_with(quantity));
    row.unwrap_or_else(|| panic!("no row {quantity}")).ours["lumenav"].unwrap()
}

#[test]
fn published_oesophagus_upright_and_supine() {
    let table = quick("gut/transit", &Backwards);
    // 5.2 +- 1 s for 200 persons; the mean of 30 has a standard error of 0.1 s.
    assert!((ours(&table, "oesophagus upright, mean") - 5.2).abs() < 1.3);
    // 23.6 +- 4 s for 200; that of 30 has a standard error of 2.5 s.
    assert!((ours(&table, "oesophagus supine, mean") - 23.6).abs() < 9.0);
    for name in ["oesophagus upright, not passed", "oesophagus supine, not passed"] {
        assert_eq!(ours(&table, name), 0.0);
    }
}

#[test]
fn published_contractions_of_the_stomach() {
    let table = quick("gut/gastric", &Backwards);
    assert!((ours(&table, "contractions") - 3.1).abs() < 0.3);
}

#[test]
fn published_pulls_of_phase_two_are_as_many_as_its_contractions_on_any_threads() {
    let table = quick("gut/traction", &OneAfterAnother);
    assert_eq!(table.to_json().unwrap(), quick("gut/traction", &Backwards).to_json().unwrap());
    // 2.5 per minute; ten minutes have 25 with a standard deviation of some 4.
    assert!((ours(&table, "events, phase II") - 2.5).abs() < 1.2);
}
