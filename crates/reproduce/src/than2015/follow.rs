//! Estimators that follow a capsule window by window, and the loop that leads them.
//!
//! All estimators of a comparison see the same windows. A window lives as long as it is looked at: a run of 9,600 windows of 1,732 lines
//! takes no more memory than one window.
//!
//! An estimator that cannot say where the capsule is in the first windows (few lines leave several attitudes open) is *held*: up to
//! [`MOST_HELD`] windows wait for its first pose, and are then answered by going back from it. They are counted as answered
//! late; what is not found by then has failed.

use super::estimators::START_WINDOWS;
use super::motion::Motion;
use super::scoring::{Score, placed};
use crate::ReproduceError;
use lumenav_pet::Line;
use lumenav_pet::tracking::{Tracked, Tracker, rewind};
use nalgebra::Vector3;
use std::collections::VecDeque;

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

    /// The late answers to some windows in order of time, of which the last has just brought the first pose; afterwards the estimator
    /// goes on behind the last of them.
    ///
    /// # Errors
    /// Something that is no matter of the windows.
    fn answer_late(&mut self, windows: &[Window<'_>]) -> Result<Vec<Option<Followed>>, ReproduceError>;
}

/// Windows before the first pose that are answered late: with the one that brought it, those that a first pose is found on.
pub const MOST_HELD: usize = START_WINDOWS - 1;

/// A tracker without a filter: it goes on from its own last pose.
pub struct Alone {
    name: String,
    tracker: Box<dyn Tracker>,
    tracked: Tracked,
    /// Where the markers are put in the capsule that was found; `None`: where the tracker put them.
    on_body_m: Option<[Vector3<f64>; 3]>,
}

impl Alone {
    /// The tracker under its own name.
    pub fn new(tracker: Box<dyn Tracker>) -> Self {
        Self { name: tracker.name().to_owned(), tracker, tracked: Tracked::default(), on_body_m: None }
    }

    /// Markers at these places of the capsule that the tracker found, m, instead of the tracker's own.
    pub fn on_body(self, markers_capsule_m: [Vector3<f64>; 3]) -> Self {
        Self { on_body_m: Some(markers_capsule_m), ..self }
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
        if let Some(markers) = &self.on_body_m {
            let markers_world_m = placed(&self.tracked.world_from_capsule, markers);
            return Ok(Some(Followed { markers_world_m, shares: self.tracked.shares.clone() }));
        }
        let markers: Result<[Vector3<f64>; 3], _> = self.tracked.markers_world_m.as_slice().try_into();
        let markers_world_m = markers.map_err(|_| ReproduceError::Part {
            part: self.name.clone(),
            why: format!("{} markers where three were asked for", self.tracked.markers_world_m.len()),
        })?;
        Ok(Some(Followed { markers_world_m, shares: self.tracked.shares.clone() }))
    }

    fn answer_late(&mut self, windows: &[Window<'_>]) -> Result<Vec<Option<Followed>>, ReproduceError> {
        rewind(
            self.tracker.as_mut(),
            &self.tracked.world_from_capsule,
            windows.iter().map(|window| window.lines),
        );
        windows.iter().map(|window| self.follow(window)).collect()
    }
}

/// A window that waits for the first pose.
struct HeldWindow {
    sequence: usize,
    start_s: f64,
    lines: Vec<Line>,
    truth: [Vector3<f64>; 3],
}

impl HeldWindow {
    fn window(&self, duration_s: f64) -> Window<'_> {
        Window { sequence: self.sequence, start_s: self.start_s, duration_s, lines: &self.lines }
    }
}

/// How an estimator fares.
#[derive(Default)]
struct Fares {
    score: Score,
    started: bool,
    held: VecDeque<HeldWindow>,
}

impl Fares {
    fn push(&mut self, followed: Option<&Followed>, truth: &[Vector3<f64>; 3]) {
        self.score.push(followed.map(|f| (&f.markers_world_m, f.shares.as_slice())), truth);
    }

    fn show(
        &mut self,
        follower: &mut dyn Follower,
        window: &Window<'_>,
        truth: &[Vector3<f64>; 3],
    ) -> Result<(), ReproduceError> {
        let followed = follower.follow(window)?;
        if self.started {
            self.push(followed.as_ref(), truth);
            return Ok(());
        }
        let (sequence, start_s, truth) = (window.sequence, window.start_s, *truth);
        self.held.push_back(HeldWindow { sequence, start_s, lines: window.lines.to_vec(), truth });
        if followed.is_some() {
            self.started = true;
            return self.answer_held(follower, followed.as_ref(), window.duration_s);
        }
        if self.held.len() > MOST_HELD
            && let Some(given_up) = self.held.pop_front()
        {
            self.push(None, &given_up.truth);
        }
        Ok(())
    }

    /// The first pose is there: the windows that waited for it are answered in order, the one that brought it last.
    fn answer_held(
        &mut self,
        follower: &mut dyn Follower,
        first: Option<&Followed>,
        duration_s: f64,
    ) -> Result<(), ReproduceError> {
        let mut held = std::mem::take(&mut self.held);
        if let [at_once] = held.make_contiguous() {
            self.push(first, &at_once.truth);
            return Ok(());
        }
        self.score.answered_late += held.len() - 1;
        let windows: Vec<Window<'_>> = held.iter().map(|held| held.window(duration_s)).collect();
        let late = follower.answer_late(&windows)?;
        for (followed, held) in late.iter().zip(&held) {
            self.push(followed.as_ref(), &held.truth);
        }
        Ok(())
    }

    fn finish(mut self) -> Score {
        for held in std::mem::take(&mut self.held) {
            self.push(None, &held.truth);
        }
        self.score
    }
}

/// A run: where the capsule goes, in windows of which length, and where its markers really are in it.
pub struct Run<'a> {
    /// Where it goes.
    pub motion: &'a dyn Motion,
    /// Length of a window, s.
    pub window_s: f64,
    /// The first window that is looked at.
    pub first: usize,
    /// How many windows are looked at.
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
        let mut all: Vec<Fares> = followers.iter().map(|_| Fares::default()).collect();
        let mut lines = Vec::new();
        for sequence in self.first..self.first + self.windows {
            let start_s = sequence as f64 * self.window_s;
            lines.clear();
            lines_of(sequence, start_s, &mut lines)?;
            let window = Window { sequence, start_s, duration_s: self.window_s, lines: &lines };
            let middle = self.motion.world_from_capsule(start_s + 0.5 * self.window_s);
            let truth = placed(&middle, &self.markers_capsule_m);
            for (follower, fares) in followers.iter_mut().zip(&mut all) {
                fares.show(follower.as_mut(), &window, &truth)?;
            }
        }
        Ok(all.into_iter().map(Fares::finish).collect())
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

        fn answer_late(&mut self, windows: &[Window<'_>]) -> Result<Vec<Option<Followed>>, ReproduceError> {
            windows.iter().map(|window| self.follow(window)).collect()
        }
    }

    /// Gives its first pose in window `from`, and knows everything once it was asked for late answers.
    struct SlowStart {
        from: usize,
        rewound: bool,
    }

    impl Follower for SlowStart {
        fn name(&self) -> &'static str {
            "slow start"
        }

        fn follow(&mut self, window: &Window<'_>) -> Result<Option<Followed>, ReproduceError> {
            let pose = Helix { times_faster: 1.0 }.world_from_capsule(window.start_s + 0.025);
            let followed = Followed { markers_world_m: placed(&pose, &TRIANGLE), shares: vec![] };
            Ok((self.rewound || window.sequence >= self.from).then_some(followed))
        }

        fn answer_late(&mut self, windows: &[Window<'_>]) -> Result<Vec<Option<Followed>>, ReproduceError> {
            self.rewound = true;
            windows.iter().map(|window| self.follow(window)).collect()
        }
    }

    #[test]
    fn law_windows_before_the_first_pose_are_answered_late_or_have_failed() {
        let motion = Helix { times_faster: 1.0 };
        let run = Run { motion: &motion, window_s: 0.05, first: 0, windows: 40, markers_capsule_m: TRIANGLE };
        // First pose in window `from`: how many are answered late, and how many have failed.
        for (from, late, failed) in [(0, 0, 0), (1, 1, 0), (23, 23, 0), (24, 23, 1), (26, 23, 3), (99, 0, 40)]
        {
            let slow = SlowStart { from, rewound: false };
            let score = run.lead(&mut [Box::new(slow)], |_, _, _| Ok(())).unwrap().remove(0);
            assert_eq!((score.windows, score.answered_late, score.failed_3_mm), (40, late, failed), "{from}");
            assert_eq!(score.before_first_pose, failed);
        }
    }

    #[test]
    fn closed_form_an_estimate_of_the_windows_start_is_half_a_window_late() {
        let motion = Helix { times_faster: 8.0 };
        let run = Run { motion: &motion, window_s: 0.05, first: 0, windows: 90, markers_capsule_m: TRIANGLE };
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
