//! Time per recorded line: 200,000 lines from a file to readings of 50 ms.
//!
//! Goal: ten million lines through reader and tracker in 10 s on one core, so about 100 ns a line as text.

use divan::Bencher;
use divan::counter::ItemsCount;
use lumenav_core::{CapsuleBody, ModelFolder, Name, Node, Recorded, Setup};
use lumenav_pet::{Scanner, reader};
use std::fmt::Write as _;
use std::path::Path;

fn main() {
    divan::main();
}

const LINES: usize = 200_000;

/// Coordinates with as many digits as a saved reading has (`digits = 17`), or as a camera writes (`digits = 1`).
fn text(is_saved: bool, digits: usize) -> String {
    let place = "t_s,sequence,start_s,end_s,arrival_s,";
    let mut text = format!("{}t_ms,x1_mm,y1_mm,z1_mm,x2_mm,y2_mm,z2_mm\n", if is_saved { place } else { "" });
    for i in 0..LINES {
        // 210 lines in 50 ms.
        let t_ms = i as f64 * (50.0 / 210.0);
        if is_saved {
            let n = i / 210;
            let start = n as f64 * 0.05;
            let _ =
                write!(text, "{:.9},{n},{start:.9},{:.9},{:.9},", start + 0.025, start + 0.05, start + 0.05);
        }
        let _ = write!(text, "{t_ms:.digits$}");
        for k in 0..6 {
            let spread = (i as f64 * 0.618_033_988_749_895 + f64::from(k) * 0.754_877_666_246_693).fract();
            // In the blocks at both ends of the y axis.
            let place_mm = match k {
                1 => 440.0 + 2.0 * spread,
                4 => -440.0 - 2.0 * spread,
                _ => 80.0 * spread - 40.0,
            };
            let _ = write!(text, ",{place_mm:.digits$}");
        }
        text.push('\n');
    }
    text
}

fn bench_file(bencher: Bencher<'_, '_>, text: &str) {
    let Ok(folder) = tempfile::tempdir() else { return };
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
    let node = |text: &str| Node::parse_text(text, "b.toml", folder.path(), &[]);
    let scanner = Node::open(&models.join("scanners/allegro.toml")).and_then(|n| Scanner::from_node(&n));
    let (Ok(scanner), Ok(files), Ok(empty)) = (scanner, node("lines = \"a.csv\""), node("")) else { return };
    if std::fs::write(folder.path().join("a.csv"), text).is_err() {
        return;
    }
    let setup = Setup {
        sensor: Name::from("pet"),
        schedule: None,
        capsule: CapsuleBody { radius_m: 6e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: empty,
        models: ModelFolder::new(models),
        map: None,
    };
    bencher.counter(ItemsCount::new(LINES)).bench_local(|| {
        let stream = reader::open(&scanner, &files, &setup).ok()?;
        let lines: usize = stream
            .map(|item| match item {
                Ok(Recorded::Reading(reading)) => reading.payload.rows(),
                _ => 0,
            })
            .sum();
        assert_eq!(lines, LINES);
        Some(lines)
    });
}

#[divan::bench(args = [1, 6, 13])]
fn lines(bencher: Bencher<'_, '_>, digits: usize) {
    bench_file(bencher, &text(false, digits));
}

#[divan::bench(args = [13])]
fn saved_readings(bencher: Bencher<'_, '_>, digits: usize) {
    bench_file(bencher, &text(true, digits));
}
