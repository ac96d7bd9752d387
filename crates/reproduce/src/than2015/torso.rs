//! Section 4.4: a capsule in the colon of a voxel torso, 1 mm/s, three markers of 5.5 MBq, pairs of blocks.
//!
//! The torso and the colon are this project's own (34.5 x 27.5 cm), so counts can only be near. The stretch of colon, as long as the
//! published run, is the one that spans the least along the scanner's axis; the bed is moved so that it lies in the middle of the field
//! of view.

use super::case::{self, Figured, Led, Path, lines_per_window, per_seed, true_percent};
use super::estimators::{Estimators, FCM, FILTERED, MotionPrior, RIGID};
use super::motion::{Motion, along};
use super::published::{TORSO, WINDOW_S};
use super::scoring::Score;
use super::set_up;
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_anatomy::centre_line::CentreLine;
use lumenav_anatomy::tract_file::{self, TractOptions};
use lumenav_core::{ModelFolder, Node};
use lumenav_pet::tracking::Budget;
use nalgebra::Isometry3;

/// Errors are reproduced within this share.
const TOLERANCE: f64 = 0.10;
/// Lines and true share are comparable within these.
const LINES_TOLERANCE: f64 = 0.20;
const TRUE_TOLERANCE: f64 = 4.0;
/// Lines that `fcm` and `rigid` take at most (than2015, section 4.3).
const BUDGET: usize = 210;
/// Windows of a quick run.
const QUICK_WINDOWS: usize = 12;
/// Step of the search for a stretch, m.
const STEP_M: f64 = 5e-3;

/// A stretch of a centre line at constant speed.
struct Stretch {
    line: CentreLine,
    start_m: f64,
    length_m: f64,
    speed_m_s: f64,
}

impl Motion for Stretch {
    fn world_from_capsule(&self, t_s: f64) -> Isometry3<f64> {
        along(&self.line, self.start_m + (self.speed_m_s * t_s).min(self.length_m))
    }

    fn duration_s(&self) -> f64 {
        self.length_m / self.speed_m_s
    }
}

impl Stretch {
    /// The stretch of the colon that spans the least along z, and the middle of that span, m.
    fn flattest(models: &ModelFolder) -> Result<(Self, f64), ReproduceError> {
        let node = Node::open(&models.root().join("tracts").join("colon.toml"))?;
        let (tract, _) = tract_file::load(&node, &TractOptions::default())?;
        let line = tract.centre_line;
        let speed_m_s = 1e-3 * TORSO.speed_mm_s;
        let length_m = TORSO.runs as f64 * WINDOW_S * speed_m_s;
        let steps = |of_m: f64| (of_m / STEP_M).floor() as usize;
        let span = |start: usize| {
            let z = (0..=steps(length_m)).map(|k| {
                let at = (start + k) as f64 * STEP_M;
                line.station(at).position_m.z
            });
            z.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)))
        };
        let last = steps(line.length_m() - length_m);
        let best = (0..=last).map(|start| (start, span(start))).min_by(|a, b| {
            let width = |(low, high): (f64, f64)| high - low;
            width(a.1).total_cmp(&width(b.1))
        });
        let Some((start, (low, high))) = best else {
            return Err(ReproduceError::of_part("torso")("the colon is shorter than the published run"));
        };
        let start_m = start as f64 * STEP_M;
        Ok((Self { line, start_m, length_m, speed_m_s }, 0.5 * (low + high)))
    }
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let (stretch, middle_z_m) = Stretch::flattest(context.models)?;
    let mut set = Set::new(
        context.models,
        "reduced",
        set_up::phantom(context.models, "torso")?,
        set_up::markers(context.models)?,
    )?;
    for block in &mut set.scanner.blocks {
        block.centre_world_m.z += middle_z_m;
    }
    set.scale_activity(TORSO.activity_mbq / 1.85);
    let all = stretch.windows(WINDOW_S);
    let windows = context.size.pick(all, QUICK_WINDOWS);
    // A few windows are taken from the middle: at its ends the stretch leaves the field of view's centre.
    let path = Path { motion: &stretch, window_s: WINDOW_S, first: (all - windows) / 2, windows };
    let seeds = &context.seeds;
    let runs = context.jobs("torso", seeds.len(), |k| {
        let followers = Estimators::new(&set).all(Budget::AtMost(BUDGET), MotionPrior::SLOW);
        case::lead(&set, path, "torso", seeds[k], followers)
    })?;
    let runs: Vec<&Led> = runs.iter().collect();
    table.set(
        "path",
        format!(
            "our colon from {:.0} mm on at {} mm/s, {windows} of {all} windows of 50 ms",
            1e3 * stretch.start_m,
            TORSO.speed_mm_s
        ),
    );
    table.set("phantom", "our torso, 34.5 x 27.5 cm, voxels of 4 mm");
    table.set("scanner", format!("reduced, its middle at z = {:.0} mm of the torso", 1e3 * middle_z_m));
    table.set("activity", format!("3 x {} MBq", TORSO.activity_mbq));
    table.set("simulator", Source::MODE);
    table.set("lines", format!("at most {BUDGET} for `fcm` and `rigid`, all for the mixtures"));
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    rows(&mut table, &runs);
    table.figures.push(case::distribution("", &runs)?);
    Ok(table)
}

fn rows(table: &mut Table, runs: &[&Led]) {
    let (lines, percent) = (lines_per_window(runs), true_percent(runs));
    let match_ = Sense::Match;
    let row = Row::new("lines per window", "", Some(TORSO.lines)).ours("simulator", lines);
    table.rows.push(row.judged("simulator", match_, Tolerance::Relative(LINES_TOLERANCE), "another torso"));
    let row = Row::new("true lines", "%", Some(TORSO.true_percent)).ours("simulator", percent);
    table.rows.push(row.judged("simulator", match_, Tolerance::Absolute(TRUE_TOLERANCE), "another torso"));
    let comparable = (lines / TORSO.lines - 1.0).abs() <= LINES_TOLERANCE
        && (percent - TORSO.true_percent).abs() <= TRUE_TOLERANCE;
    let judged = |row: Row, name: &str, tolerance: Tolerance| {
        if comparable {
            row.judged(name, Sense::LowerIsBetter, tolerance, "")
        } else {
            row.not_comparable("lines or true share beyond 20 % and 4 points of the source's")
        }
    };
    let relative = Tolerance::Relative(TOLERANCE);
    for (k, marker) in ["apex", "first base", "second base"].into_iter().enumerate() {
        for (name, published) in [(FCM, TORSO.fcm_mm[k]), (RIGID, TORSO.rigid_mm[k])] {
            let row = Row::new(
                format!("mean error of the {marker} marker, published for {name}"),
                "mm",
                Some(published),
            );
            let row = per_seed(row, runs, |s| s.markers_mm()[k], false).goal(FILTERED, published);
            table.rows.push(judged(row, name, relative));
        }
    }
    let [mean_deg, _] = TORSO.orientation_deg;
    let row = Row::new("mean error of the orientation vector", "deg", Some(mean_deg));
    table.rows.push(judged(per_seed(row, runs, Score::orientation_deg, false), FCM, relative));
    let windows = runs.first().map_or(0, |led| led.scores[0].windows);
    let counted: [(&str, Figured); 2] =
        [("that failed (3 mm)", |s| s.failed_3_mm as f64), ("without a pose", |s| s.without_pose as f64)];
    for (what, value) in counted {
        let row = Row::new(format!("windows of {windows} {what}, worst seed"), "", Some(0.0));
        let row = per_seed(row, runs, value, true);
        table.rows.push(judged(row, FCM, Tolerance::Absolute(0.0)));
    }
}
