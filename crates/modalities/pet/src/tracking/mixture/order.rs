//! The test of the markers' order over the last windows.

use super::{BETTER, Mixture, TEST_LINES, TEST_STEPS};
use crate::line::Line;
use crate::tracking::climb::COARSE;
use crate::tracking::window::Preparation;
use crate::tracking::{Prior, Reinitialized, Tracked};
use lumenav_core::PriorUse;
use nalgebra::{Isometry3, Rotation3, Vector3};

/// An order that is behind by this after some windows is not looked at in the others: odds of e^20.
const HOPELESS: f64 = 20.0;

impl Mixture {
    /// Climbs the last windows again from every other order of the markers; the turn that explains them better, if one does.
    pub(super) fn better_order(&mut self) -> Option<Rotation3<f64>> {
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
        let best = orders.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0));
        self.orders = orders;
        let (best, turn) = best?;
        (best - here > BETTER).then(|| self.body.permutations[turn])
    }

    /// Takes another order of the markers where the last windows ask for it: this window is answered anew.
    pub(super) fn test_order(&mut self, lines: &[Line], prior: Option<&Prior>, out: &mut Tracked) {
        let Some(turn) = self.better_order() else { return };
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
        self.roles(&out.world_from_capsule, &mut out.roles);
        for (_, pose) in &mut self.memory.recent {
            *pose = self.body.turned(pose, &turn);
        }
        self.memory.world_from_capsule = Some(out.world_from_capsule);
        self.memory.markers_world_m.clone_from(&out.markers_world_m);
    }
}
