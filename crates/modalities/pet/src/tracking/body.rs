//! The marker set as the trackers see it: places, nominal shares, what maps it onto itself, what nearly does.

use crate::markers::MarkerSet;
use lumenav_core::pose::log_so3;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Positions that agree within this are one to the lines: a tenth of the noise of a window.
const SYMMETRIC_M: f64 = 1e-4;
/// Activities that agree within this cannot be told apart by counting 100 lines each.
const SYMMETRIC_ACTIVITY: f64 = 0.1;
/// Marker distances of a healthy window leave those of the set by at most this, m: than2015 section 5.5.1 allows 7 to 16 mm for
/// sides of 10 to 13 mm.
const DISTANCE_SLACK_M: f64 = 3e-3;
/// Orders of the markers looked at as hypotheses; of sets with more markers only those that nearly fit.
const MAX_HYPOTHESES: usize = 24;

/// A marker set, prepared.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    /// Capsule frame, m.
    pub(crate) markers_m: Vec<Vector3<f64>>,
    /// Shares by nominal activity.
    pub(crate) shares: Vec<f64>,
    /// Centroid by activity, capsule frame, m.
    pub(crate) centroid_m: Vector3<f64>,
    /// Markers from that centroid, m.
    pub(crate) arms_m: Vec<Vector3<f64>>,
    /// Lines within this of the centroid may come from a marker, m: see [`super::centroid`].
    pub(crate) spared_m: f64,
    /// Turns about the (plain) centroid that the lines cannot see.
    symmetries: Vec<Rotation3<f64>>,
    /// Turns that bring each marker near to another's place, other than symmetries.
    pub(crate) permutations: Vec<Rotation3<f64>>,
    /// About which both turn, m.
    centre_m: Vector3<f64>,
    /// Least and most distance between two markers of a healthy window, m.
    pub(crate) distances_m: [f64; 2],
}

impl Body {
    pub(crate) fn new(set: &MarkerSet) -> Self {
        let markers_m = set.positions_capsule_m();
        let total = set.total_activity_bq().max(f64::MIN_POSITIVE);
        let shares: Vec<f64> = set.markers.iter().map(|m| m.activity_bq / total).collect();
        let centroid_m: Vector3<f64> = markers_m.iter().zip(&shares).map(|(m, s)| m * *s).sum();
        let symmetric = set.symmetries(SYMMETRIC_M, SYMMETRIC_ACTIVITY);
        let any = set.symmetries(f64::INFINITY, f64::INFINITY);
        let mut near: Vec<(f64, Rotation3<f64>)> = any
            .into_iter()
            .filter(|(order, _)| symmetric.iter().all(|(other, _)| other != order))
            .map(|(order, turn)| (set.best_rotation(&order).1, turn))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(MAX_HYPOTHESES);
        let mut distances_m = [f64::INFINITY, 0.0];
        for (i, a) in markers_m.iter().enumerate() {
            for b in &markers_m[..i] {
                let d = (a - b).norm();
                distances_m = [distances_m[0].min(d), distances_m[1].max(d)];
            }
        }
        let least = (distances_m[0] - DISTANCE_SLACK_M).max(0.3 * distances_m[0]);
        Self {
            arms_m: markers_m.iter().map(|m| m - centroid_m).collect(),
            spared_m: markers_m.iter().map(|m| (m - centroid_m).norm()).fold(0.0, f64::max)
                + super::membership::REACH_M,
            markers_m,
            shares,
            centroid_m,
            symmetries: symmetric.into_iter().map(|(_, turn)| turn).collect(),
            permutations: near.into_iter().map(|(_, turn)| turn).collect(),
            centre_m: set.centroid_capsule_m(),
            distances_m: [least, distances_m[1] + DISTANCE_SLACK_M],
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.markers_m.len()
    }

    /// The pose whose activity centroid stands at a place.
    pub(crate) fn at_centroid(
        &self,
        centre_world_m: &Vector3<f64>,
        turn: &UnitQuaternion<f64>,
    ) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(centre_world_m - turn * self.centroid_m), *turn)
    }

    /// A pose turned in the body, about the markers' centroid.
    pub(crate) fn turned(&self, pose: &Isometry3<f64>, turn: &Rotation3<f64>) -> Isometry3<f64> {
        let rotation = pose.rotation * UnitQuaternion::from_rotation_matrix(turn);
        let place = pose.translation.vector + pose.rotation * self.centre_m - rotation * self.centre_m;
        Isometry3::from_parts(Translation3::from(place), UnitQuaternion::new_normalize(rotation.into_inner()))
    }

    /// A pose with its markers in every other order.
    pub(crate) fn reordered(&self, pose: Isometry3<f64>) -> impl Iterator<Item = Isometry3<f64>> + '_ {
        self.permutations.iter().map(move |turn| self.turned(&pose, turn))
    }

    /// Poses that the lines cannot tell from this one.
    pub(crate) fn twins<'a>(&'a self, pose: &'a Isometry3<f64>) -> impl Iterator<Item = Isometry3<f64>> + 'a {
        self.symmetries.iter().map(|turn| self.turned(pose, turn))
    }

    /// Of a pose and its twins the one whose attitude is nearest to another's.
    pub(crate) fn nearest_twin(&self, pose: &Isometry3<f64>, to: &Isometry3<f64>) -> Isometry3<f64> {
        let turn = |p: &Isometry3<f64>| log_so3(&(to.rotation.inverse() * p.rotation)).norm();
        self.twins(pose).fold(*pose, |best, twin| if turn(&twin) < turn(&best) { twin } else { best })
    }

    /// Largest distance between the markers at two poses, the twin of `b` that fits best, m.
    pub(crate) fn distance_m(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let apart = |p: &Isometry3<f64>| {
            self.markers_m
                .iter()
                .map(|m| (a.transform_point(&(*m).into()) - p.transform_point(&(*m).into())).norm())
                .fold(0.0, f64::max)
        };
        // A twin swaps markers: compare places, not names, by comparing poses.
        self.twins(b).fold(apart(b), |least, twin| least.min(apart(&twin)))
    }

    /// The pose that brings the set nearest to places with weights (Kabsch 1976).
    pub(crate) fn fit(&self, places_world_m: &[Vector3<f64>], weights: &[f64]) -> Option<Isometry3<f64>> {
        let total: f64 = weights.iter().sum();
        if !(total > 0.0) {
            return None;
        }
        let mean =
            |of: &[Vector3<f64>]| of.iter().zip(weights).map(|(p, w)| p * *w).sum::<Vector3<f64>>() / total;
        let (from, to) = (mean(&self.markers_m), mean(places_world_m));
        let mut cross = Matrix3::zeros();
        for ((m, p), w) in self.markers_m.iter().zip(places_world_m).zip(weights) {
            cross += (p - to) * (m - from).transpose() * *w;
        }
        let svd = cross.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let sign = (u * v_t).determinant().signum();
        let r = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
        let place = to - rotation * from;
        place
            .iter()
            .all(|v| v.is_finite())
            .then(|| Isometry3::from_parts(Translation3::from(place), rotation))
    }
}
