//! The rigid body by memberships (than2015, chapter 6): minimise `Σ_j Σ_i u_ij^q |d_ij|²` over SE(3).
//!
//! For fixed memberships the cost is `Σ_j M_jᵀ A_j M_j - 2 V_j·M_j + …` with sums that are made once per pass; its minimum over
//! `M_j = p + R a_j` is found by Gauss-Newton in all six (p is linear in R, so it comes with it). Memberships and pose take turns until
//! no marker moves by more than 0.01 mm. Such turns converge linearly, so each goes on along the last two (Anderson 1965, of depth one):
//!
//! ```text
//! r = g(x) - x,  θ = r·Δr / |Δr|²,  x' = g - θ Δg        g one turn, Δ from the last, x the pose from the first in tangent coordinates
//! ```
//!
//! The fixed point is the same; a turn that grew is taken as it is. The shares f_k stay at the markers' activities, which are known; the answer's shares are
//! those of the memberships.

use super::classic::{Classic, ClassicOptions, MAX_PASSES, REST_M};
use super::failure::Failure;
use super::{Memory, Prior, Role, Tracked, Tracker};
use crate::line::Line;
use crate::markers::MarkerSet;
use lumenav_core::pose::{ominus, oplus};
use nalgebra::{Isometry3, Vector6};

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
        let mut ahead = Ahead::from(&pose);
        for pass in 1..=MAX_PASSES {
            if pass > 1 {
                c.place(&pose);
                c.memberships();
            }
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
            if pass < MAX_PASSES {
                pose = ahead.of(&before, &pose);
            }
        }
        c.update_shares();
        c.place(&pose);
        c.finish(&pose, prior, why, out)
    }
}

/// Length that a radian counts for beside a metre: that of a marker's arm.
const ARM_M: f64 = 8e-3;
/// Furthest that a turn is carried on, turns: convergence by four fifths a turn.
const FURTHEST: f64 = 4.0;

/// Carries turns on.
struct Ahead {
    first: Isometry3<f64>,
    /// Last turn's end and its residual, from the first pose.
    last: Option<(Vector6<f64>, Vector6<f64>)>,
}

impl Ahead {
    fn from(first: &Isometry3<f64>) -> Self {
        Self { first: *first, last: None }
    }

    /// Where to go on from behind a turn.
    fn of(&mut self, before: &Isometry3<f64>, behind: &Isometry3<f64>) -> Isometry3<f64> {
        let (x, g) = (ominus(before, &self.first), ominus(behind, &self.first));
        let mut residual = g - x;
        residual.fixed_rows_mut::<3>(3).scale_mut(ARM_M);
        let Some((last, last_residual)) = self.last.replace((g, residual)) else { return *behind };
        let change = residual - last_residual;
        let squared = change.norm_squared();
        if residual.norm_squared() >= last_residual.norm_squared() || squared <= 0.0 {
            return *behind;
        }
        let theta = (residual.dot(&change) / squared).clamp(-FURTHEST, FURTHEST);
        oplus(&self.first, &(g - (g - last) * theta))
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
