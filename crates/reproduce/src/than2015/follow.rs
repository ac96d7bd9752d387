//! Estimators that follow a capsule window by window, and the loop that leads them.
//!
//! All estimators of a comparison see the same windows. A window lives as long as it is looked at: a run of 9,600 windows of 1,732 lines
//! takes no more memory than one window.

use super::motion::Motion;
use super::scoring::{Score, placed};
use crate::ReproduceError;
use lumenav_pet::Line;
use lumenav_pet::tracking::{Tracked, Tracker};
use nalgebra::Vector3;

/// One window, as estimators see it.
#[derive(Clone, Copy, Debug)]
pub struct Window<'a> {
    /// Counted from 0.
    pub sequence: usize,
    /// When it begins, s.
    pub start_s: f64,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Its lines.
    pub lines: &'a [Line],
}

/// What an estimator says about a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// Apex, base, base, in the middle of the window, world, m.
    pub markers_world_m: [Vector3<f64>; 3],
    /// Share of each marker in the lines; empty where the estimator does not say.
    pub shares: Vec<f64>,
}

/// An estimator.
pub trait Follower: Send {
    /// Its name in the table.
    fn name(&self) -> &str;

    /// Looks at the next window; `None` where it gives no pose.
    ///
    /// # Errors
    /// Something that is no matter of the window.
    fn follow(&mut self, window: &Window<'_>) -> Result<Option<Followed>, ReproduceError>;
}

/// A tracker without a filter: it goes on from its own last pose.
pub struct Alone {
    name: String,
    tracker: Box<dyn Tracker>,
    tracked: Tracked,
}

impl Alone {
    /// The tracker under its own name.
    pub fn new(tracker: Box<dyn Tracker>) -> Self {
        Self { name: tracker.name().to_owned(), tracker, tracked: Tracked::default() }
    }

    /// The tracker under another name.
    pub fn named(tracker: Box<dyn Tracker>, name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::new(tracker) }
    }
}

impl Follower for Alone {
    fn name(&self) -> &str {
        &self.name
    }

    fn follow(&mut self, window: &Window<'_>) -> Result<Option<Followed>, ReproduceError> {
        // Why a window failed is the tracker's business; that it did is counted.
        if self.tracker.track_into(window.lines, None, &mut self.tracked).is_err() {
            return Ok(None);
        }
        let markers: Result<[Vector3<f64>; 3], _> = self.tracked.markers_world_m.as_slice().try_into();
        let markers_world_m = markers.map_err(|_| ReproduceError::Part {
            part: self.name.clone(),
            why: format!("{} markers where three were asked for", self.tracked.markers_world_m.len()),
        })?;
        Ok(Some(Followed { markers_world_m, shares: self.tracked.shares.clone() }))
    }
}

/// A run: where the capsule goes, in windows of which length, and where its markers really are in it.
pub struct Run<'a> {
    /// Where it goes.
    pub motion: &'a dyn Motion,
    /// Length of a window, s.
    pub window_s: f64,
    /// How many windows of it are looked at.
    pub windows: usize,
    /// Where the markers really are, capsule frame, m.
    pub markers_capsule_m: [Vector3<f64>; 3],
}

impl Run<'_> {
    /// Leads estimators through the windows that `lines_of` gives (sequence, start, its buffer emptied) and scores each.
    ///
    /// # Errors
    /// What `lines_of` or an estimator says.
    pub fn lead(
        &self,
        followers: &mut [Box<dyn Follower>],
        mut lines_of: impl FnMut(usize, f64, &mut Vec<Line>) -> Result<(), ReproduceError>,
    ) -> Result<Vec<Score>, ReproduceError> {
        let mut scores = vec![Score::default(); followers.len()];
        let mut lines = Vec::new();
        for sequence in 0..self.windows {
            let start_s = sequence as f64 * self.window_s;
            lines.clear();
            lines_of(sequence, start_s, &mut lines)?;
            let window = Window { sequence, start_s, duration_s: self.window_s, lines: &lines };
            let middle = self.motion.world_from_capsule(start_s + 0.5 * self.window_s);
            let truth = placed(&middle, &self.markers_capsule_m);
            for (follower, score) in followers.iter_mut().zip(&mut scores) {
                let followed = follower.follow(&window)?;
                score.push(followed.as_ref().map(|f| (&f.markers_world_m, f.shares.as_slice())), &truth);
            }
        }
        Ok(scores)
    }
}

#[cfg(test)]
mod tests {
    use super::super::motion::Helix;
    use super::*;

    const TRIANGLE: [Vector3<f64>; 3] =
        [Vector3::new(-0.012, 0.0, 0.0), Vector3::new(0.0, 0.005, 0.0), Vector3::new(0.0, -0.005, 0.0)];

    /// Knows where the capsule is at the start of each window, and nothing of windows without lines.
    struct Late;

    impl Follower for Late {
        fn name(&self) -> &'static str {
            "late"
        }

        fn follow(&mut self, window: &Window<'_>) -> Result<Option<Followed>, ReproduceError> {
            let pose = Helix { times_faster: 8.0 }.world_from_capsule(window.start_s);
            let followed = Followed { markers_world_m: placed(&pose, &TRIANGLE), shares: vec![] };
            Ok((!window.lines.is_empty()).then_some(followed))
        }
    }

    #[test]
    fn closed_form_an_estimate_of_the_windows_start_is_half_a_window_late() {
        let motion = Helix { times_faster: 8.0 };
        let run = Run { motion: &motion, window_s: 0.05, windows: 90, markers_capsule_m: TRIANGLE };
        let line = Line { t_s: 0.0, ends_world_m: [Vector3::zeros(), Vector3::x()] };
        let scores = run
            .lead(&mut [Box::new(Late)], |sequence, _, lines| {
                if sequence != 40 {
                    lines.push(line);
                }
                Ok(())
            })
            .unwrap();
        // 44.5 mm/s for 25 ms: the base 1.1 mm, the apex a little more as it swings round; 1.1 + 2.2 once for the missing window.
        let score = &scores[0];
        assert_eq!((score.windows, score.without_pose, score.failed_3_mm), (90, 1, 1));
        assert!((score.mean_mm() - 1.15).abs() < 0.06, "{}", score.mean_mm());
    }
}
