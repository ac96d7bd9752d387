//! How far the lines of a source that a scanner sees lie beside it.
//!
//! ```text
//! d = V P⁻¹ ∇ ln S        S  what the scanner sees of the place ([`crate::coverage`])
//!                         P  mean of 1 - n nᵀ over the directions n of the lines seen there
//!                         V  the variance v that an edge cuts off, across the scanner's axis and along it ([`super::errors`])
//! ```
//!
//! Of the lines of a direction that are seen, more start where more of it is seen, at a mean offset `v ∇ ln ρ`, ρ(n, x) its density, which
//! does not change along n: `∇·∫ (1 - n nᵀ) ρ dn = ∇ ∫ ρ dn = ∇ S`, so least squares over all offsets gives d. Linear in v, right while S
//! changes little over √v; beside the very edge the lines that are seen lie at most
//! 1.25 √v inwards (half a normal law by its distance from the edge: √(π/2) √v). Absorption is left out (see [`crate::coverage`]): in
//! a body that is thinner outside, it takes back a part of what the photons' own spread contributes.
//!
//! S of a ring is a sum over some hundred pairs of blocks, so d is kept on a grid of [`STEP_M`], each node computed when first asked for.

use super::errors::Calibration;
use crate::coverage::Coverage;
use nalgebra::Vector3;
use std::sync::{Arc, OnceLock};

/// Between nodes, m: d bends on the scale of the field of view, and is 0.1 mm.
const STEP_M: f64 = 0.01;
/// Nodes to each side of the scanner's middle; beyond the last, d is the last one's.
const HALF: usize = 15;
const SIDE: usize = 2 * HALF + 1;
/// `√(π/2)`: see the head of this file.
const FURTHEST: f64 = 1.253_314_137_315_500_3;

/// The way from a source to the mean of its lines, by place.
#[derive(Clone, Debug)]
pub(super) struct Beside {
    coverage: Arc<Coverage>,
    cut_off_m2: [f64; 2],
    nodes: OnceLock<Nodes>,
}

/// Row by row along z, then y, then x.
type Nodes = Arc<[OnceLock<Vector3<f64>>]>;

/// The same coverage and variances give the same way, whichever nodes have been asked for.
impl PartialEq for Beside {
    fn eq(&self, other: &Self) -> bool {
        self.coverage == other.coverage && self.cut_off_m2 == other.cut_off_m2
    }
}

impl Beside {
    pub(super) fn new(coverage: Arc<Coverage>, calibration: &Calibration) -> Self {
        Self { coverage, cut_off_m2: calibration.cut_off_m2, nodes: OnceLock::new() }
    }

    /// In another scanner's field.
    pub(super) fn in_field(&self, coverage: Arc<Coverage>) -> Self {
        Self { coverage, cut_off_m2: self.cut_off_m2, nodes: OnceLock::new() }
    }

    /// From a place in the scanner's frame, m.
    pub(super) fn at(&self, place_scanner_m: &Vector3<f64>) -> Vector3<f64> {
        if self.cut_off_m2 == [0.0; 2] {
            return Vector3::zeros();
        }
        let steps = place_scanner_m.map(|axis| (axis / STEP_M + HALF as f64).clamp(0.0, (SIDE - 1) as f64));
        let first = steps.map(|step| (step.floor() as usize).min(SIDE - 2));
        let part = Vector3::from_fn(|i, _| steps[i] - first[i] as f64);
        let mut sum = Vector3::zeros();
        for corner in 0..8 {
            let (mut index, mut weight) = (0, 1.0);
            for axis in 0..3 {
                let upper = corner >> axis & 1;
                index = index * SIDE + first[axis] + upper;
                weight *= if upper == 1 { part[axis] } else { 1.0 - part[axis] };
            }
            if weight > 0.0 {
                sum += self.node(index) * weight;
            }
        }
        sum
    }

    fn node(&self, index: usize) -> &Vector3<f64> {
        let all = || std::iter::repeat_with(OnceLock::new).take(SIDE * SIDE * SIDE).collect();
        self.nodes.get_or_init(all)[index].get_or_init(|| {
            let along = |step: usize| (step as f64 - HALF as f64) * STEP_M;
            let place =
                Vector3::new(along(index / (SIDE * SIDE)), along(index / SIDE % SIDE), along(index % SIDE));
            self.computed(&place)
        })
    }

    fn computed(&self, place_scanner_m: &Vector3<f64>) -> Vector3<f64> {
        let Some((pull, axial)) = self.coverage.pull_per_m(place_scanner_m) else { return Vector3::zeros() };
        let [across_m2, along_m2] = self.cut_off_m2;
        let limited = |way_m: Vector3<f64>, variance_m2: f64| {
            let most_m = FURTHEST * variance_m2.max(0.0).sqrt();
            if way_m.norm() > most_m { way_m * (most_m / way_m.norm()) } else { way_m }
        };
        let along = axial * axial.dot(&pull);
        limited((pull - along) * across_m2, across_m2) + limited(along * along_m2, along_m2)
    }
}
