//! The test of the markers' order over the last windows.
//!
//! What one test says is added to what those before it said about the order that is followed: where lines tell little, five windows by
//! chance prefer another one now and then, by odds of twenty to one twice a second.

use super::{BETTER, Mixture, TEST_LINES, TEST_STEPS};
use crate::line::Line;
use crate::tracking::climb::COARSE;
use crate::tracking::window::Preparation;
use crate::tracking::{Prior, Reinitialized, Tracked};
use lumenav_core::PriorUse;
use nalgebra::{Isometry3, Vector3};

/// An order that is behind by this after some windows is not looked at in the others: odds of e^20.
pub(super) const HOPELESS: f64 = 20.0;
/// However long an order was behind, it is not believed less than this, odds of e^7: a capsule that is thrown may turn over.
const LEAST_EVIDENCE: f64 = -7.0;

impl Mixture {
    /// Climbs the last windows again from every other order of the markers; the number of the turn that, with what earlier tests said,
    /// explains them better, if one does.
    pub(super) fn better_order(&mut self) -> Option<usize> {
        let mut here = 0.0;
        let mut orders = std::mem::take(&mut self.orders);
        orders.clear();
        orders.extend((0..self.body.permutations.len()).map(|turn| (0.0, turn)));
        for at in 0..self.memory.recent.len() {
            let (lines, pose) = &self.memory.recent[at];
            let about = self.about(pose.transform_point(&self.body.centroid_m.into()).coords);
            let how = Preparation { budget: Some(TEST_LINES), ..about };
            if self.other.prepare(lines, &self.noise, &how, 1).is_err() {
                continue;
            }
            let mut climb = |start: &Isometry3<f64>| {
                self.climber
                    .climb(&self.likelihood, &self.other, start, &self.shares, None, (TEST_STEPS, COARSE))
                    .objective
            };
            here += climb(pose);
            for (sum, turn) in &mut orders {
                *sum += climb(&self.body.turned(pose, &self.body.permutations[*turn]));
            }
            orders.retain(|(sum, _)| *sum > here - HOPELESS);
        }
        let evidence = &mut self.memory.order_evidence;
        evidence.resize(self.body.permutations.len(), 0.0);
        for (turn, so_far) in evidence.iter_mut().enumerate() {
            let ahead =
                orders.iter().find(|(_, other)| *other == turn).map_or(-HOPELESS, |(sum, _)| sum - here);
            *so_far = (*so_far + ahead).max(LEAST_EVIDENCE);
        }
        self.orders = orders;
        let (turn, ahead) = evidence.iter().copied().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        (ahead > BETTER).then_some(turn)
    }

    /// Takes another order of the markers where the last windows ask for it: this window is answered anew.
    pub(super) fn test_order(&mut self, lines: &[Line], prior: Option<&Prior>, out: &mut Tracked) {
        let Some(number) = self.better_order() else { return };
        let turn = self.body.permutations[number];
        let start = self.body.turned(&out.world_from_capsule, &turn);
        let Ok(top) = self.follow(lines, &start, Vector3::zeros(), None) else { return };
        // The prior is of the wrong order: it must not pull the answer back, nor choose between twins.
        let free = prior.map(|p| Prior { how: PriorUse::None, ..*p });
        let mut anew = out.clone();
        if self.answer(&top, free.as_ref(), &mut anew).is_err() {
            return;
        }
        *out = anew;
        out.reinitialized = Some(Reinitialized::Permutation);
        // The order that was left is behind by as much, and no other is ahead of it.
        let behind = -self.memory.order_evidence[number];
        self.memory.order_evidence.fill(behind);
        self.roles(&out.world_from_capsule, &mut out.roles);
        for (_, pose) in &mut self.memory.recent {
            *pose = self.body.turned(pose, &turn);
        }
        self.memory.world_from_capsule = Some(out.world_from_capsule);
        self.memory.markers_world_m.clone_from(&out.markers_world_m);
    }
}
