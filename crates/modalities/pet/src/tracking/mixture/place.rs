//! Whether the followed place is the right one: when it is tested, what beats it, and the doubt where a search cannot tell.

use super::{BETTER, Mixture, SAME_POSE_M, STACK, TEST_EVERY, TEST_LINES, start};
use crate::line::Line;
use crate::tracking::climb::{NormalPrior, Top};
use crate::tracking::{Failure, Reinitialized};
use nalgebra::{Isometry3, Vector3};

/// Fall of the mean log-likelihood that asks for a search, standard deviations.
const FALL_SD: f64 = 4.0;
/// Least standard deviation of the mean log-likelihood per line, times the root of the lines: the law of one line has a spread of
/// about 1.5, so a short memory must not make it smaller.
const LEAST_SPREAD: f64 = 1.0;
/// Another place is taken where nothing speaks against the followed one but a search that finds more, by odds of e^10: a search looks at
/// eight attitudes about two places, and there are two a second at 20 windows a second.
const ELSEWHERE: f64 = 10.0;

impl Mixture {
    /// Whether place and order are to be tested in this window.
    pub(super) fn is_test_due(&self) -> bool {
        let due = self.memory.windows % TEST_EVERY == TEST_EVERY - 1 && self.memory.recent.len() == STACK;
        self.options.test_permutations && due
    }

    /// Whether the log-likelihood per line fell out of what the last windows had.
    pub(super) fn fell(&self, top: &Top) -> bool {
        let known = &self.memory.mean_log_likelihoods;
        if known.len() < STACK {
            return false;
        }
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        let variance = known.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (known.len() - 1) as f64;
        let lines = self.window.len().max(1) as f64;
        let sd = variance.sqrt().max(LEAST_SPREAD / lines.sqrt());
        top.gain / lines < mean - FALL_SD * sd
    }

    /// A search beside the pose that was followed; what was found is taken where it gains more by a margin. Where that is ambiguous, the
    /// followed pose is doubted: it is not the answer, nor is a prediction looked at until a search has told.
    pub(super) fn relocalize(
        &mut self,
        lines: &[Line],
        (followed, is_sound): (&Top, bool),
        start: &Isometry3<f64>,
        velocity_world_m_s: Vector3<f64>,
        contained: Option<&NormalPrior>,
    ) -> Result<(Top, Option<Reinitialized>), Failure> {
        // A pose that held so far is tested on the last windows together; one that just broke, on this window alone.
        let is_moving = velocity_world_m_s != Vector3::zeros();
        let along = if is_moving { velocity_world_m_s } else { self.recent_velocity() };
        let mut stack = std::mem::take(&mut self.stack);
        if is_sound {
            self.carry_stack(lines, along, &mut stack);
        }
        let tested = if is_sound { &stack[..] } else { lines };
        let found = if is_sound { self.find(tested) } else { self.find_anew(tested) };
        // Of a sound pose only another place is looked for: the same one, a little better without a velocity, is none.
        let most = self
            .tops
            .first()
            .filter(|top| !is_sound || self.body.distance_m(&top.pose, &followed.pose) > SAME_POSE_M);
        let most = most.map_or(f64::NEG_INFINITY, |top| top.gain);
        let here = self.gain_in_search(tested, followed);
        self.stack = stack;
        let margin = if is_sound { ELSEWHERE } else { BETTER };
        match found {
            Ok(top) if most > here + margin => {
                // Another place is better, whether or not this window by itself can be followed there.
                let there = self.follow(lines, &top.pose, Vector3::zeros(), None);
                self.memory.doubted |= there.is_err();
                Ok((there.map_err(|failure| self.doubt(failure))?, Some(Reinitialized::LikelihoodFell)))
            }
            Err(failure @ Failure::Ambiguous { .. }) if most > here + ELSEWHERE => {
                self.memory.doubted = true;
                Err(self.doubt(failure))
            }
            _ => Ok((self.follow(lines, start, velocity_world_m_s, contained)?, None)),
        }
    }

    /// This window's lines behind those of as many earlier ones as come to [`TEST_LINES`] with it, which are carried along the capsule's
    /// velocity to this window's middle.
    pub(super) fn carry_stack(
        &self,
        lines: &[Line],
        velocity_world_m_s: Vector3<f64>,
        stack: &mut Vec<Line>,
    ) {
        stack.clear();
        let mut room = TEST_LINES.saturating_sub(lines.len());
        if let Some(now_s) = start::mean_time_s(lines) {
            for (recent, _) in self.earlier_than(lines).rev() {
                let Some(left) = room.checked_sub(recent.len()) else { break };
                room = left;
                stack.extend(recent.iter().map(|line| {
                    let way = velocity_world_m_s * (now_s - line.t_s);
                    Line { ends_world_m: line.ends_world_m.map(|end| end + way), ..*line }
                }));
            }
        }
        stack.extend_from_slice(lines);
    }

    /// How fast the last windows' poses moved.
    pub(super) fn recent_velocity(&self) -> Vector3<f64> {
        let place = |(lines, pose): &(Vec<Line>, Isometry3<f64>)| {
            Some((start::mean_time_s(lines)?, self.place_of(pose)))
        };
        start::slope(self.memory.recent.iter().filter_map(place))
    }

    /// A search in place of a pose that is doubted. The doubt ends where a search finds one pose, or no sign of another.
    pub(super) fn resolve_doubt(&mut self, lines: &[Line]) -> Result<(Top, Option<Reinitialized>), Failure> {
        match self.first_pose(lines) {
            Ok(top) => {
                self.memory.doubted = false;
                Ok((top, Some(Reinitialized::LikelihoodFell)))
            }
            Err(failure) => {
                // An empty window says nothing for or against it.
                self.memory.doubted = matches!(
                    failure,
                    Failure::Ambiguous { .. } | Failure::TooFewLines { .. } | Failure::Gathering { .. }
                );
                Err(self.doubt(failure))
            }
        }
    }

    pub(super) fn doubt(&self, failure: Failure) -> Failure {
        if self.memory.doubted { Failure::Doubted { why: Box::new(failure) } } else { failure }
    }
}
