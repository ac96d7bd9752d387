//! The search for a pose without an idea where it is: all attitudes about two places, and what makes a find believed.

use super::order::HOPELESS;
use super::{MOST_START_WINDOWS, Mixture, SAME_POSE_M, SEARCH_STEPS, TEST_STEPS};
use crate::line::Line;
use crate::tracking::Failure;
use crate::tracking::centroid::Weight;
use crate::tracking::climb::{COARSE, Top};
use crate::tracking::densest::distance_m;
use crate::tracking::window::Preparation;
use nalgebra::{Isometry3, Matrix3, Matrix3x6, Vector3};

/// A second attitude within this of the best makes a first pose ambiguous: odds of e^4.
pub(super) const AMBIGUOUS: f64 = 4.0;
/// A start that does not wait for all of its windows has seen so many: one tells no motion.
const FEWEST_OF_AN_EARLY_START: usize = 2;
/// Least gain of a pose that was searched for, as [`super::FOLLOWED_GAIN`]: half of what chi-square exceeds once in 10⁹ (30³ places and 60
/// attitudes that a search can tell apart, one false alarm in a thousand searches).
const SEARCHED_GAIN: f64 = 28.0;
/// A pose that is searched for explains at least this share of all lines, and this share of those that pass near: of 47 to 82 per cent
/// true lines (than2015 table 4.2) nearly all pass near, of the others a fifth, so the capsule owns four of five lines there. A
/// place where scattered lines happen to crowd does not.
const LEAST_TRUE_SHARE: f64 = 0.2;
const LEAST_NEAR_SHARE: f64 = 0.5;
/// What is like the best top is looked at about so many tops in turn.
const LIKENESS_ROUNDS: usize = 3;
/// Lines that a search looks at: beyond, more of them tell attitudes apart no better than 600 of which 120 are true.
const SEARCH_LINES: usize = 600;

impl Mixture {
    /// Lines that a search looks at.
    pub(super) fn search_budget(&self) -> usize {
        self.budget().map_or(SEARCH_LINES, |most| most.min(SEARCH_LINES))
    }

    /// The pose that explains these lines best, of all attitudes about two places: the lines' centroid, and where most lines pass. The
    /// first needs no pair of lines to meet; the second is not drawn away where few lines are true.
    pub(super) fn find(&mut self, lines: &[Line]) -> Result<Top, Failure> {
        let looked_at = self.look_everywhere(lines)?;
        self.unambiguous(looked_at)
    }

    /// The same where nothing is followed, and no place may be missed that is as likely.
    pub(super) fn find_anew(&mut self, lines: &[Line]) -> Result<Top, Failure> {
        let looked_at = self.look_everywhere(lines)?;
        self.look_at_likes();
        self.unambiguous(looked_at)
    }

    /// Climbs as well from what looks like the best top, in the lines that were looked at: its markers in every other order, seen from the
    /// front and from behind (lines that run nearly one way tell hardly which marker is nearer). A search by the markers' distances to
    /// lines that finds one of these may miss the others, and took it for the only one. Where a better one is found, about that again.
    pub(super) fn look_at_likes(&mut self) {
        let lines = std::mem::take(&mut self.looked_at);
        for _ in 0..LIKENESS_ROUNDS {
            // What is not believed anyway needs no rival.
            let Ok(best) = self.supported(lines.len()) else { break };
            if !self.climb_from_likes(&lines, &best) {
                break;
            }
        }
        self.looked_at = lines;
    }

    /// Adds to the tops what is found in lines from what is like one of them; whether another one is the best now.
    fn climb_from_likes(&mut self, lines: &[Line], top: &Top) -> bool {
        let how = Preparation { budget: Some(self.search_budget()), ..self.about(self.place_of(&top.pose)) };
        if self.window.prepare(lines, &self.noise, &how, self.needed()).is_err() {
            return false;
        }
        let behind = self.seen_from_behind(top);
        let body = &self.body;
        // The top itself, too: found in fewer lines it may have gained less.
        let starts = [top.pose].into_iter().chain(behind).chain(body.reordered(top.pose));
        for start in starts.chain(behind.into_iter().flat_map(|pose| body.reordered(pose))) {
            let how = (SEARCH_STEPS, COARSE);
            let (likelihood, window) = (&self.likelihood, &self.window);
            let found = self.climber.climb(likelihood, window, &start, &self.shares, None, how);
            if found.gain > top.gain - HOPELESS {
                self.tops.push(found);
            }
        }
        self.tops.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        self.tops.first().is_some_and(|best| self.body.distance_m(&best.pose, &top.pose) > SAME_POSE_M)
    }

    /// The pose whose markers lie as far behind their middle as those of a top lie before it, along the way of which its lines tell least.
    fn seen_from_behind(&self, top: &Top) -> Option<Isometry3<f64>> {
        let of_place = top.information.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigen();
        let depth = of_place.eigenvectors.column(of_place.eigenvalues.imin()).into_owned();
        let middle = self.place_of(&top.pose);
        let mirrored = |marker: &Vector3<f64>| {
            let place = top.pose.transform_point(&(*marker).into()).coords;
            place - depth * (2.0 * depth.dot(&(place - middle)))
        };
        let places: Vec<Vector3<f64>> = self.likelihood.markers_capsule_m.iter().map(mirrored).collect();
        self.body.fit(&places, &self.body.shares)
    }

    /// Fills `self.tops`, best first; how many lines were looked at.
    pub(super) fn look_everywhere(&mut self, lines: &[Line]) -> Result<usize, Failure> {
        self.tops.clear();
        let by_centroid = self.search(lines);
        let mut looked_at = std::mem::take(&mut self.looked_at);
        looked_at.clear();
        looked_at.extend(self.window.indices.iter().map(|index| lines[*index as usize]));
        let given = looked_at.len();
        if let Some(place) = self.densest.find(&looked_at)
            && !self.is_found_at(&place)
        {
            let mut crowded = std::mem::take(&mut self.crowded);
            crowded.clear();
            let near = |line: &&Line| distance_m(line, &place) < self.noise.background_radius_m;
            crowded.extend(looked_at.iter().filter(near));
            // Where this finds nothing, what the centroid found is left.
            let _ = self.search(&crowded);
            self.crowded = crowded;
        }
        self.looked_at = looked_at;
        if self.tops.is_empty() {
            by_centroid?;
        }
        self.tops.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        Ok(given)
    }

    /// Whether the best top so far has its markers where most lines pass: all attitudes were tried there.
    pub(super) fn is_found_at(&self, place_world_m: &Vector3<f64>) -> bool {
        let best = self.tops.iter().max_by(|a, b| a.gain.total_cmp(&b.gain));
        best.is_some_and(|top| (self.place_of(&top.pose) - place_world_m).norm() < self.body.spared_m)
    }

    /// Climbs from all candidates of a search in `self.window`; the tops are added to `self.tops`.
    pub(super) fn search(&mut self, lines: &[Line]) -> Result<(), Failure> {
        let about = self.memory.centroid_world_m.unwrap_or_default();
        let how = Preparation { budget: Some(self.search_budget()), ..self.about(about) };
        self.window.load(lines, &how, self.needed())?;
        let centre = self.centroid.find(&self.window, Weight::Uniform, self.body.spared_m)?;
        self.window.move_origin(&(about + centre));
        self.window.shape(&self.noise);
        self.memory.centroid_world_m = Some(self.window.origin_world_m);
        let found = self.search.find(self.centroid.kept_rays(), &centre, &self.body.arms_m);
        for (_, turn) in found {
            let start = self.body.at_centroid(&self.window.origin_world_m, turn);
            let top = self.climber.climb(
                &self.likelihood,
                &self.window,
                &start,
                &self.shares,
                None,
                (SEARCH_STEPS, COARSE),
            );
            self.tops.push(top);
        }
        Ok(())
    }

    /// The first pose: of this window or, where it says too little, of the last ones together.
    pub(super) fn first_pose(&mut self, lines: &[Line]) -> Result<Top, Failure> {
        // A capsule that was lost is wanted back at once: where it was looked for before, one window has to do.
        let is_start = !self.memory.started;
        let needed = if is_start { self.options.start_windows.min(MOST_START_WINDOWS) } else { 1 };
        let have = self.earlier_than(lines).count() + 1;
        let is_early = have < needed;
        if is_early && (have < FEWEST_OF_AN_EARLY_START || self.options.start_sigma_m <= 0.0) {
            return Err(Failure::Gathering { have, needed });
        }
        let mut stack = std::mem::take(&mut self.stack);
        stack.clear();
        self.earlier_than(lines).for_each(|(kept, _)| stack.extend_from_slice(kept));
        stack.extend_from_slice(lines);
        let found = if needed > 1 { self.start_of_stack(&stack, lines) } else { self.find_anew(&stack) };
        self.stack = stack;
        if is_early && !found.as_ref().is_ok_and(|top| self.is_settled(top)) {
            self.motion = None;
            return Err(Failure::Gathering { have, needed });
        }
        let found = found?;
        if needed > 1 {
            return Ok(found);
        }
        // The stack told the attitude; the pose is this window's.
        self.follow(lines, &found.pose, Vector3::zeros(), None)
    }

    /// Whether more windows are not worth waiting for: every marker is told well enough, and no other place is nearly as likely.
    fn is_settled(&self, top: &Top) -> bool {
        let has_rival = self.tops.first().is_some_and(|best| {
            self.tops[1..].iter().any(|other| {
                self.body.distance_m(&best.pose, &other.pose) > SAME_POSE_M
                    && best.gain - other.gain < 2.0 * AMBIGUOUS
            })
        });
        !has_rival && self.worst_marker_sd_m(top).is_some_and(|sd_m| sd_m <= self.options.start_sigma_m)
    }

    /// Standard deviation of the place of the marker that is told worst, m: `|δm|` with `δm = δp - R [m]x δθ`.
    fn worst_marker_sd_m(&self, top: &Top) -> Option<f64> {
        let covariance = (top.information * self.noise.information_share).cholesky()?.inverse();
        let rotation = top.pose.rotation.to_rotation_matrix().into_inner();
        let variance = |marker: &Vector3<f64>| {
            let mut moves = Matrix3x6::zeros();
            moves.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            moves.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(rotation * marker.cross_matrix()));
            (moves * covariance * moves.transpose()).trace()
        };
        let worst = self.likelihood.markers_capsule_m.iter().map(variance).fold(0.0, f64::max);
        Some(worst.sqrt())
    }

    /// The best top of a search that looked at `given` lines, if it explains enough of them, and no other place does nearly as well.
    pub(super) fn unambiguous(&self, given: usize) -> Result<Top, Failure> {
        let best = self.supported(given)?;
        match self.tops[1..].iter().find(|top| self.is_rival(&best, top)) {
            Some(rival) => Err(Self::ambiguous(&best, rival)),
            None => Ok(best),
        }
    }

    /// Whether a top is another pose than the best and explains the lines nearly as well.
    pub(super) fn is_rival(&self, best: &Top, top: &Top) -> bool {
        self.body.distance_m(&best.pose, &top.pose) > SAME_POSE_M && best.gain - top.gain < AMBIGUOUS
    }

    pub(super) fn ambiguous(best: &Top, rival: &Top) -> Failure {
        Failure::Ambiguous { poses: vec![best.pose, rival.pose], difference: rival.gain - best.gain }
    }

    /// The best top of a search that looked at `given` lines, if it explains enough of them.
    pub(super) fn supported(&self, given: usize) -> Result<Top, Failure> {
        let Some(best) = self.tops.first() else { return Err(Failure::Indefinite) };
        let share = (LEAST_TRUE_SHARE * given as f64).max(LEAST_NEAR_SHARE * best.near as f64);
        let needed = self.needed().max(share.ceil() as usize);
        if !(best.effective_lines >= needed as f64) {
            let background = 100.0 * (1.0 - best.effective_lines / given.max(1) as f64);
            return Err(Failure::Background { effective: best.effective_lines, background, needed });
        }
        if !(best.gain >= SEARCHED_GAIN) {
            return Err(Failure::NoEvidence { gain: best.gain, needed: SEARCHED_GAIN });
        }
        Ok(*best)
    }

    /// The gain of a top over the lines that a search looks at.
    pub(super) fn gain_in_search(&mut self, lines: &[Line], top: &Top) -> f64 {
        let about = self.about(self.place_of(&top.pose));
        let how = Preparation { budget: Some(self.search_budget()), ..about };
        if self.other.prepare(lines, &self.noise, &how, self.needed()).is_err() {
            return f64::NEG_INFINITY;
        }
        let climber = &mut self.climber;
        climber.climb(&self.likelihood, &self.other, &top.pose, &self.shares, None, (TEST_STEPS, COARSE)).gain
    }
}
