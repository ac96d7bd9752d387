//! Fuzzy C-means over lines (than2015, chapter 3, eq. 3.14 to 3.18): every marker moves on its own.
//!
//! `M_k += h Σ u^q d / Σ u^q`, h = 1.5 (a line pulls across itself only, two of three directions, which h makes good), until the
//! largest move is below 0.01 mm or 50 passes; the relative activity f_k is the share of memberships. The pose is the marker set
//! fitted to the places, weighted by their activity.

use super::classic::{Classic, ClassicOptions, MAX_PASSES, REST_M};
use super::failure::Failure;
use super::{Memory, Prior, Role, Tracked, Tracker};
use crate::line::Line;
use crate::markers::MarkerSet;

/// Step of eq. 3.18.
const STEP: f64 = 1.5;

/// The tracker.
#[derive(Clone, Debug)]
pub struct Fcm {
    classic: Classic,
}

impl Fcm {
    /// For a marker set.
    pub fn new(set: &MarkerSet, options: ClassicOptions) -> Self {
        let mut classic = Classic::new(set, options);
        classic.are_markers_free = true;
        Self { classic }
    }

    fn window(&mut self, lines: &[Line], prior: Option<&Prior>, out: &mut Tracked) -> Result<(), Failure> {
        let c = &mut self.classic;
        let (_, why) = c.begin(lines, prior)?;
        for pass in 1..=MAX_PASSES {
            if pass > 1 {
                c.memberships();
            }
            let mut largest_m: f64 = 0.0;
            for (place, sums) in c.places_m.iter_mut().zip(&c.sums) {
                if sums.weight > 0.0 {
                    let step = (sums.side_m - sums.matrix * *place) * (STEP / sums.weight);
                    *place += step;
                    largest_m = largest_m.max(step.norm());
                }
            }
            c.update_shares();
            if largest_m < REST_M {
                break;
            }
        }
        let pose = c.body.fit(&c.places_m, &c.shares).ok_or(Failure::Indefinite)?;
        c.finish(&pose, prior, why, out)
    }
}

impl Tracker for Fcm {
    fn name(&self) -> &'static str {
        "fcm"
    }

    fn track_into(
        &mut self,
        lines: &[Line],
        prior: Option<&Prior>,
        out: &mut Tracked,
    ) -> Result<(), Failure> {
        out.roles.clear();
        out.roles.resize(lines.len(), Role::Unused);
        out.markers_world_m.clear();
        let done = self.window(lines, prior, out);
        self.classic.remember(done, out)
    }

    fn memory(&self) -> Memory {
        self.classic.memory.clone()
    }

    fn recall(&mut self, memory: Memory) {
        self.classic.memory = memory;
    }
}
