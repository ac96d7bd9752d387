//! The rigid body by memberships (than2015, chapter 6): minimise `Σ_j Σ_i u_ij^q |d_ij|²` over SE(3).
//!
//! For fixed memberships the cost is `Σ_j M_jᵀ A_j M_j - 2 V_j·M_j + …` with sums that are made once per pass; its minimum over
//! `M_j = p + R a_j` is found by Gauss-Newton in all six (p is linear in R, so it comes with it). Memberships and pose take turns until
//! no marker moves by more than 0.01 mm. The shares f_k stay at the markers' activities, which are known; the answer's shares are
//! those of the memberships.

use super::classic::{Classic, ClassicOptions, MAX_PASSES, REST_M};
use super::failure::Failure;
use super::{Memory, Prior, Role, Tracked, Tracker};
use crate::line::Line;
use crate::markers::MarkerSet;

/// The tracker.
#[derive(Clone, Debug)]
pub struct Rigid {
    classic: Classic,
}

impl Rigid {
    /// For a marker set.
    pub fn new(set: &MarkerSet, options: ClassicOptions) -> Self {
        Self { classic: Classic::new(set, options) }
    }

    fn window(&mut self, lines: &[Line], prior: Option<&Prior>, out: &mut Tracked) -> Result<(), Failure> {
        let c = &mut self.classic;
        let (mut pose, why) = c.begin(lines, prior)?;
        for _ in 0..MAX_PASSES {
            c.place(&pose);
            c.memberships();
            let before = pose;
            if !c.rigid_step(&mut pose) {
                return Err(Failure::Indefinite);
            }
            let moved = |m: &nalgebra::Vector3<f64>| {
                (pose.transform_point(&(*m).into()) - before.transform_point(&(*m).into())).norm()
            };
            if c.body.markers_m.iter().all(|m| moved(m) < REST_M) {
                break;
            }
        }
        c.place(&pose);
        c.memberships();
        c.update_shares();
        c.finish(&pose, prior, why, out)
    }
}

impl Tracker for Rigid {
    fn name(&self) -> &'static str {
        "rigid"
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
