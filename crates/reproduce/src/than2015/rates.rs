//! Table 4.2: lines per window of 50 ms and their true share, five water cylinders, full ring and reduced scanner.
//!
//! Every cell comes out of the same physics. One factor, the same for all ten cells, may stand for what the source does not state
//! (sensitivity of its simulation against ours): the one that makes the largest relative deviation smallest,
//! `1/√(min r · max r)` with r = ours over published.

use super::motion::{HELIX_DURATION_S, Helix, Motion as _};
use super::published::{HELIX_RUNS, RATES, RateRow, WINDOW_S};
use super::source::{Set, Source, Tally};
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use crate::{ReproduceError, Size};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::Line;

/// Lines per run are met within this share.
const LINES_TOLERANCE: f64 = 0.10;
/// True shares are met within so many points.
const TRUE_TOLERANCE_POINTS: f64 = 3.0;
/// Of the 720 windows of the helix every eighth (full ring) or second (reduced) is simulated: some 10,000 lines or more in each cell,
/// one per cent of statistical error or less.
const EVERY: [usize; 2] = [8, 2];
const EVERY_QUICK: [usize; 2] = [240, 60];

/// A scanner's column of the table.
struct Column {
    scanner: &'static str,
    title: &'static str,
    lines: fn(&RateRow) -> f64,
    true_percent: fn(&RateRow) -> f64,
    /// Which of ours the published true share is held against.
    judged: &'static str,
}

const COLUMNS: [Column; 2] = [
    Column {
        scanner: "allegro",
        title: "full ring",
        lines: |row| row.full_lines,
        true_percent: |row| row.full_true_percent,
        judged: WITHOUT_PARTNER,
    },
    Column {
        scanner: "reduced",
        title: "reduced",
        lines: |row| row.reduced_lines,
        true_percent: |row| row.reduced_true_percent,
        judged: ALL_LINES,
    },
];

const ALL_LINES: &str = "all lines";
const WITHOUT_PARTNER: &str = "without 1274.5 keV";
const RAW: &str = "unscaled";
const SCALED: &str = "scaled";

/// One cell, per seed.
#[derive(Clone, Debug, Default)]
struct Cell {
    lines: Vec<f64>,
    true_all: Vec<f64>,
    true_without: Vec<f64>,
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let every = context.size.pick(EVERY, EVERY_QUICK);
    let seeds = &context.seeds;
    let jobs: Vec<(usize, usize, u64)> = (0..2)
        .flat_map(|c| (0..RATES.len()).flat_map(move |r| seeds.iter().map(move |s| (c, r, *s))))
        .collect();
    let tallies = context.jobs("rates", jobs.len(), |k| {
        let (column, row, seed) = jobs[k];
        tally(context, &COLUMNS[column], &RATES[row], seed, every[column])
    })?;
    let mut cells = vec![vec![Cell::default(); RATES.len()]; 2];
    for ((column, row, _), (windows, tally)) in jobs.iter().zip(&tallies) {
        let cell = &mut cells[*column][*row];
        cell.lines.push(tally.lines as f64 / *windows as f64);
        cell.true_all.push(100.0 * tally.true_lines as f64 / tally.lines as f64);
        let without = tally.lines - tally.with_partner;
        cell.true_without.push(100.0 * tally.true_lines as f64 / without as f64);
    }
    let scale = scale(&cells);
    describe(&mut table, every, scale, context.size);
    rows(&mut table, &cells, scale);
    departures(&mut table, &cells, scale);
    table.figures.push(figure(&cells, scale)?);
    Ok(table)
}

fn tally(
    context: &Context<'_>,
    column: &Column,
    row: &RateRow,
    seed: u64,
    every: usize,
) -> Result<(usize, Tally), ReproduceError> {
    let set = Set::than2015(context.models, column.scanner, row.phantom)?;
    let mut source = Source::new(&set, seed, &format!("rates-{}-{}", column.scanner, row.phantom));
    let helix = Helix { times_faster: 1.0 };
    let mut lines: Vec<Line> = Vec::new();
    let sequences: Vec<usize> = (0..helix.windows(WINDOW_S)).step_by(every).collect();
    for sequence in &sequences {
        lines.clear();
        source.window(&helix, *sequence as f64 * WINDOW_S, WINDOW_S, *sequence, &mut lines);
    }
    Ok((sequences.len(), source.tally()))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The factor for all cells.
fn scale(cells: &[Vec<Cell>]) -> f64 {
    let ratios = COLUMNS.iter().zip(cells).flat_map(|(column, cells)| {
        RATES.iter().zip(cells).map(|(row, cell)| mean(&cell.lines) / (column.lines)(row))
    });
    let (low, high) = ratios.fold((f64::INFINITY, 0.0_f64), |(a, b), r| (a.min(r), b.max(r)));
    1.0 / (low * high).sqrt()
}

fn describe(table: &mut Table, every: [usize; 2], scale: f64, size: Size) {
    let windows = every.map(|every| HELIX_RUNS.div_ceil(every));
    table.set("path", format!("helix of {HELIX_DURATION_S} s, windows of {} ms", 1e3 * WINDOW_S));
    table.set(
        "windows simulated",
        format!("{} (full ring) and {} (reduced) of {HELIX_RUNS}, evenly", windows[0], windows[1]),
    );
    table.set("simulator", Source::MODE);
    table.set(
        "rate scale",
        format!("{scale:.4}, one for all ten cells: detection efficiency that the source does not state"),
    );
    table.note(
        "true: both photons of 511 keV, neither scattered in the water. Lines per run count every accepted coincidence, those with a \
         1274.5 keV partner of Na-22 too; the true share is given over all lines and over lines without such a \
         partner from the same decay (a gamma of another decay makes a random line like any other single)",
    );
    if size == Size::Quick {
        table.note("quick: the statistical error of a cell is up to some per cent");
    }
}

fn rows(table: &mut Table, cells: &[Vec<Cell>], scale: f64) {
    for (column, cells) in COLUMNS.iter().zip(cells) {
        for (published, cell) in RATES.iter().zip(cells) {
            let at = format!("{}, {} cm", column.title, published.diameter_cm);
            let scaled: Vec<f64> = cell.lines.iter().map(|n| n * scale).collect();
            table.rows.push(
                Row::new(format!("lines per run, {at}"), "lines", Some((column.lines)(published)))
                    .ours_mean(RAW, &cell.lines)
                    .ours_mean(SCALED, &scaled)
                    .judged(SCALED, Sense::Match, Tolerance::Relative(LINES_TOLERANCE), ""),
            );
        }
        for (published, cell) in RATES.iter().zip(cells) {
            let at = format!("{}, {} cm", column.title, published.diameter_cm);
            let tolerance = Tolerance::Absolute(TRUE_TOLERANCE_POINTS);
            table.rows.push(
                Row::new(format!("true share, {at}"), "%", Some((column.true_percent)(published)))
                    .ours_mean(ALL_LINES, &cell.true_all)
                    .ours_mean(WITHOUT_PARTNER, &cell.true_without)
                    .judged(column.judged, Sense::Match, tolerance, ""),
            );
        }
    }
}

/// The largest departures of all ten cells: what this project wants to keep small.
fn departures(table: &mut Table, cells: &[Vec<Cell>], scale: f64) {
    let (mut lines, mut shares) = (0.0_f64, 0.0_f64);
    for (column, cells) in COLUMNS.iter().zip(cells) {
        for (published, cell) in RATES.iter().zip(cells) {
            let ratio = scale * mean(&cell.lines) / (column.lines)(published);
            lines = lines.max(100.0 * (ratio - 1.0).abs());
            let ours = if column.judged == ALL_LINES { &cell.true_all } else { &cell.true_without };
            shares = shares.max((mean(ours) - (column.true_percent)(published)).abs());
        }
    }
    let why = "over the rows above, each judged by itself";
    let row = Row::new("largest departure of lines per run", "%", None).ours(SCALED, lines);
    table.rows.push(row.goal(SCALED, 100.0 * LINES_TOLERANCE).not_comparable(why));
    let row = Row::new("largest departure of the true share", "points", None).ours("as judged", shares);
    table.rows.push(row.goal("as judged", TRUE_TOLERANCE_POINTS).not_comparable(why));
}

fn figure(cells: &[Vec<Cell>], scale: f64) -> Result<NamedFigure, ReproduceError> {
    let diameter = || Axis::linear("cylinder diameter (cm)");
    let mut panels = Vec::new();
    for (column, cells) in COLUMNS.iter().zip(cells) {
        let pair = |value: f64, row: &RateRow| (row.diameter_cm, value);
        let over = |value: &dyn Fn(&Cell) -> f64| -> Vec<(f64, f64)> {
            RATES.iter().zip(cells).map(|(row, cell)| pair(value(cell), row)).collect()
        };
        let published = |value: fn(&RateRow) -> f64| -> Vec<(f64, f64)> {
            RATES.iter().map(|row| pair(value(row), row)).collect()
        };
        let lines = Panel::new(diameter(), Axis::logarithmic("lines per 50 ms"))
            .titled(column.title)
            .with(Series::published("than2015, table 4.2").points(&published(column.lines)))
            .with(Series::ours(0, "ours, scaled").points(&over(&|c| scale * mean(&c.lines))));
        let shares = Panel::new(diameter(), Axis::linear("true lines (%)"))
            .titled(column.title)
            .with(Series::published("than2015, table 4.2").points(&published(column.true_percent)))
            .with(Series::ours(1, "ours, all lines").points(&over(&|c| mean(&c.true_all))))
            .with(
                Series::ours(2, "ours, without 1274.5 keV partner").points(&over(&|c| mean(&c.true_without))),
            );
        panels.push((lines, shares));
    }
    let (lines, shares): (Vec<Panel>, Vec<Panel>) = panels.into_iter().unzip();
    let svg = Figure::grid(lines.into_iter().chain(shares).collect(), 2).to_svg()?;
    Ok(NamedFigure { name: String::new(), svg })
}
