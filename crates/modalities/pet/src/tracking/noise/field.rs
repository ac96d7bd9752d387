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
//! changes little over √v; on the edge itself the lines that are seen lie 1.25 √v inwards (the mean of half a
//! normal law by its distance from it: √(π/2) √v), which is the most that is taken. Outside, where a few lines are still seen, nothing is. Absorption is left out (see [`crate::coverage`]): in
//! a body that is thinner outside, it takes back a part of what the photons' own spread contributes.
//!
//! A window has one d, at the point that it is prepared about: over a capsule's markers, some millimetres from it, d differs
//! (6 mm away, Na-22) by 0.02 mm where the edge is 25 mm away, by 0.1 mm where it is 15 mm.
//!
//! S of a ring is a sum over some hundred pairs of blocks, so d is kept on a grid of [`STEP_M`], each node computed when first asked for.

use super::errors::Calibration;
use crate::coverage::Coverage;
use crate::scanner::Scanner;
use nalgebra::Vector3;
use std::sync::{Arc, OnceLock};

/// Between nodes, m.
const STEP_M: f64 = 0.01;
/// Nodes to each side of the scanner's middle; beyond the last, d is computed where it is asked for.
const HALF: usize = 15;
const SIDE: usize = 2 * HALF + 1;
/// What a straight line between nodes may be wrong by, m. Of `d = v/x`, x the way to the edge, it is `h² v / (4 x³) = h² d³ / (4 v²)` in the
/// middle of a step h: nearer to the edge d is computed where it is asked for.
const WRONG_BY_M: f64 = 0.01e-3;
/// `√(π/2)`: see the head of this file.
const FURTHEST: f64 = 1.253_314_137_315_500_3;

/// `None`: nothing is seen there, or the edge is too near for a straight line to the next node.
type GridNode = OnceLock<Option<Vector3<f64>>>;

/// The way from a source to the mean of its lines, by place.
#[derive(Clone, Debug)]
pub(super) struct Beside {
    coverage: Arc<Coverage>,
    cut_off_m2: [f64; 2],
    /// The grid's middle, that of the blocks, in the frame in which the scanner's file tells them.
    middle_m: Vector3<f64>,
    /// Row by row along z, then y, then x. Clones fill one grid.
    nodes: Arc<OnceLock<Vec<GridNode>>>,
}

/// The same coverage and variances give the same way, whichever nodes have been asked for.
impl PartialEq for Beside {
    fn eq(&self, other: &Self) -> bool {
        self.coverage == other.coverage && self.cut_off_m2 == other.cut_off_m2
    }
}

impl Beside {
    pub(super) fn new(scanner: &Scanner, coverage: Arc<Coverage>, calibration: &Calibration) -> Self {
        let middle_m = scanner.middle_m();
        Self { coverage, cut_off_m2: calibration.cut_off_m2, middle_m, nodes: Arc::default() }
    }

    /// From a place in the scanner's frame, m.
    pub(super) fn at(&self, place_scanner_m: &Vector3<f64>) -> Vector3<f64> {
        if self.cut_off_m2 == [0.0; 2] {
            return Vector3::zeros();
        }
        self.between_nodes(place_scanner_m)
            .unwrap_or_else(|| self.computed(place_scanner_m).unwrap_or_default())
    }

    /// `None` outside the grid, and where a node is none.
    fn between_nodes(&self, place_scanner_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let steps = (place_scanner_m - self.middle_m).map(|axis| axis / STEP_M + HALF as f64);
        if !steps.iter().all(|step| (0.0..(SIDE - 1) as f64).contains(step)) {
            return None;
        }
        let first = steps.map(|step| step.floor() as usize);
        let part = Vector3::from_fn(|i, _| steps[i] - first[i] as f64);
        let mut sum = Vector3::zeros();
        for corner in 0..8 {
            let (mut index, mut weight) = (0, 1.0);
            for axis in 0..3 {
                let upper = corner >> axis & 1;
                index = index * SIDE + first[axis] + upper;
                weight *= if upper == 1 { part[axis] } else { 1.0 - part[axis] };
            }
            sum += self.node(index)? * weight;
        }
        Some(sum)
    }

    fn node(&self, index: usize) -> Option<Vector3<f64>> {
        let all = || std::iter::repeat_with(OnceLock::new).take(SIDE * SIDE * SIDE).collect();
        *self.nodes.get_or_init(all)[index].get_or_init(|| {
            let along = |step: usize| (step as f64 - HALF as f64) * STEP_M;
            let place =
                Vector3::new(along(index / (SIDE * SIDE)), along(index / SIDE % SIDE), along(index % SIDE));
            let least_m2 = self.cut_off_m2.into_iter().fold(f64::INFINITY, f64::min);
            let most_m = (4.0 * WRONG_BY_M * least_m2 * least_m2 / (STEP_M * STEP_M)).cbrt();
            self.computed(&(self.middle_m + place)).filter(|way_m| way_m.norm() <= most_m)
        })
    }

    /// `None` where nothing is seen.
    fn computed(&self, place_scanner_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let (pull, axial) = self.coverage.pull_per_m(place_scanner_m)?;
        let [across_m2, along_m2] = self.cut_off_m2;
        let limited = |way_m: Vector3<f64>, variance_m2: f64| {
            let most_m = FURTHEST * variance_m2.max(0.0).sqrt();
            if way_m.norm() > most_m { way_m * (most_m / way_m.norm()) } else { way_m }
        };
        let along = axial * axial.dot(&pull);
        Some(limited((pull - along) * across_m2, across_m2) + limited(along * along_m2, along_m2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::Node;
    use std::path::Path;

    fn beside(scanner: &Scanner) -> Beside {
        let calibration = Calibration { cut_off_m2: [2e-6, 3e-6], ..Calibration::EXACT };
        Beside::new(scanner, Arc::new(Coverage::new(scanner)), &calibration)
    }

    #[test]
    fn law_lines_lie_where_more_is_seen_wherever_the_scanner_stands() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners");
        for name in ["reduced", "allegro"] {
            let here =
                Scanner::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap();
            let way = Vector3::new(0.3, -0.2, 0.6);
            let mut there = here.clone();
            there.blocks.iter_mut().for_each(|block| block.centre_world_m += way);
            let (here, there) = (beside(&here), beside(&there));
            assert!(here.at(&Vector3::zeros()).norm() < 1e-7, "{name}");
            for place in [[0.04, 0.0, 0.05], [-0.033, 0.021, -0.064]] {
                let place = Vector3::from(place);
                let (one, other) = (here.at(&place), there.at(&(place + way)));
                assert!((one - other).norm() < 1e-9, "{name} {place:?}: {one} {other}");
                assert!(one.z * place.z < 0.0, "{name} {place:?}: {one}");
            }
        }
    }

    /// Between nodes it is what would be computed there, to 0.02 mm where S of two plates bends within a step; near the edge it is computed.
    #[test]
    fn law_the_grid_is_fine_enough_and_the_edge_has_a_limit() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners");
        for name in ["reduced", "allegro", "adac-forte"] {
            let scanner =
                Scanner::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap();
            let beside = beside(&scanner);
            let check = |place: Vector3<f64>| {
                let (kept, exact) = (beside.at(&place), beside.computed(&place).unwrap_or_default());
                assert!((kept - exact).norm() < 0.022e-3, "{name} {place:?}: {kept} {exact}");
            };
            for place in [[0.045, 0.005, 0.035], [-0.015, 0.037, -0.052], [0.055, -0.013, 0.0]] {
                check(Vector3::from(place));
            }
            // Towards both edges of the plates, or the end of the ring, and beyond.
            let (width_m, length_m) = (scanner.grid.half_width_m(), scanner.grid.half_length_m());
            for way_mm in [20.0, 15.0, 10.0, 8.0, 6.0, 4.5, 3.0, 2.0, 1.0, -1.0] {
                let from_edge_m = 1e-3 * way_mm;
                check(Vector3::new(0.0, 0.0, length_m - from_edge_m));
                check(Vector3::new(0.003, 0.004, from_edge_m - length_m));
                check(Vector3::new(width_m - from_edge_m, 0.002, 0.013));
            }
        }
        let scanner = Scanner::from_node(&Node::open(&folder.join("reduced.toml")).unwrap()).unwrap();
        let beside = beside(&scanner);
        let (across_m, along_m) = (FURTHEST * 2e-6_f64.sqrt(), FURTHEST * 3e-6_f64.sqrt());
        let at = |x_m: f64, from_end_m: f64| {
            beside.at(&Vector3::new(x_m, 0.0, scanner.grid.half_length_m() - from_end_m))
        };
        assert!((at(0.0, 1e-4).z + along_m).abs() < 1e-9, "{}", at(0.0, 1e-4));
        // v over the way to the end.
        let middling = at(0.0, 6e-3).z;
        assert!((middling / (-3e-6 / 6e-3) - 1.0).abs() < 0.06, "{middling}");
        assert_eq!(at(0.0, -1e-3), Vector3::zeros());
        assert!(beside.at(&Vector3::new(0.08, 0.0, 0.0)).xy().norm() <= across_m + 1e-12);
    }
}
