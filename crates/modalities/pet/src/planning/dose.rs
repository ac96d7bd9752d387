//! Dose from the markers (than2015, section 3.6 and figure 3.10).
//!
//! ```text
//! H' = Γ A exp(-μ T) / d²        H = n Γ A t / d²    (a resting capsule, nothing in between: an upper bound)
//! ```
//!
//! Γ is the dose rate constant, A a marker's activity, T the tissue between, d the distance. Positrons themselves stop in the
//! marker's shell. Dose is that of the gamma rays, in sievert.

use lumenav_anatomy::Tract;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Dose rate constant of Na-22, Sv m²/(h Bq): 0.362 uSv/h per MBq at 1 m (than2015, section 3.6).
pub const SODIUM_22_SV_M2_PER_H_BQ: f64 = 0.362e-12;

const SECONDS_PER_HOUR: f64 = 3600.0;

/// Dose rate at a distance, Sv/h: constant in Sv m²/(h Bq), activity in Bq, attenuation in 1/m, tissue between and distance in m.
pub fn dose_rate_sv_per_h(
    constant_sv_m2_per_h_bq: f64,
    activity_bq: f64,
    attenuation_per_m: f64,
    tissue_m: f64,
    distance_m: f64,
) -> f64 {
    constant_sv_m2_per_h_bq * activity_bq * (-attenuation_per_m * tissue_m).exp() / (distance_m * distance_m)
}

/// Upper bound of the dose at a distance from a resting capsule with all its activity in one point, Sv.
pub fn dose_bound_sv(
    constant_sv_m2_per_h_bq: f64,
    total_activity_bq: f64,
    time_s: f64,
    distance_m: f64,
) -> f64 {
    dose_rate_sv_per_h(constant_sv_m2_per_h_bq, total_activity_bq, 0.0, 0.0, distance_m) * time_s
        / SECONDS_PER_HOUR
}

/// Where a capsule was when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransitPoint {
    /// s.
    pub t_s: f64,
    /// Along the centre line, m.
    pub arc_length_m: f64,
}

/// What the wall is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallDose {
    /// Dose rate constant, Sv m²/(h Bq).
    pub constant_sv_m2_per_h_bq: f64,
    /// Activity of all markers, Bq, taken to sit in the capsule's centre.
    pub total_activity_bq: f64,
    /// Attenuation on the straight way from source to wall, 1/m; 0: nothing in between.
    pub attenuation_per_m: f64,
    /// The wall is never nearer to the source than this, m: the capsule's radius, where a contracted lumen holds it.
    pub nearest_m: f64,
    /// Places along the tract, 2 or more.
    pub stations: usize,
    /// Places around it.
    pub around: usize,
}

/// Dose of the wall at one place along the tract.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallPoint {
    /// Along the centre line, m.
    pub arc_length_m: f64,
    /// Mean around the lumen, Sv.
    pub mean_sv: f64,
    /// Largest around the lumen, Sv: neighbouring loops make a difference.
    pub largest_sv: f64,
}

/// The source moves by no more than this share of the smallest distance between two terms of the sum: 1/d² then changes by less than
/// half a per cent about its middle.
const STEP_SHARE: f64 = 0.1;

impl WallDose {
    /// Dose that a transit along the centre line leaves in a tract's wall at rest; a capsule that lies against the wall leaves more there. Between two points of the transit the capsule moves at a constant
    /// rate along the centre line; `None` where times run back or there are fewer than two points.
    pub fn along(&self, tract: &Tract, transit: &[TransitPoint]) -> Option<Vec<WallPoint>> {
        if transit.len() < 2 || self.stations < 2 || self.around == 0 {
            return None;
        }
        let is_forward = |pair: &[TransitPoint]| pair[1].t_s >= pair[0].t_s;
        if !transit.windows(2).all(is_forward) {
            return None;
        }
        let sources = self.sources(tract, transit);
        let walls = (0..self.stations).map(|i| {
            let arc_length_m = tract.length_m() * i as f64 / (self.stations - 1) as f64;
            let (station, radius_m) = (tract.station(arc_length_m), tract.radii(arc_length_m).resting_m);
            let (mut sum, mut largest_sv) = (0.0, 0.0_f64);
            for k in 0..self.around {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / self.around as f64).sin_cos();
                let place =
                    station.position_m.coords + (station.normal * cos + station.binormal * sin) * radius_m;
                let dose_sv = self.at(&place, &sources);
                sum += dose_sv;
                largest_sv = largest_sv.max(dose_sv);
            }
            WallPoint { arc_length_m, mean_sv: sum / self.around as f64, largest_sv }
        });
        Some(walls.collect())
    }

    /// Places of the source and the time spent there, s: the tract in pieces of [`STEP_SHARE`] of the smallest distance, each with the
    /// time that the capsule spent in it, at the mean place of that time.
    fn sources(&self, tract: &Tract, transit: &[TransitPoint]) -> Vec<(Vector3<f64>, f64)> {
        let piece_m = STEP_SHARE * self.nearest_m;
        // By piece: time, and time by place, s and m s.
        let mut pieces: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
        for pair in transit.windows(2) {
            let (from_m, way_m) = (pair[0].arc_length_m, pair[1].arc_length_m - pair[0].arc_length_m);
            let steps = (way_m.abs() / piece_m).ceil().max(1.0) as usize;
            let step_s = (pair[1].t_s - pair[0].t_s) / steps as f64;
            for i in 0..steps {
                let arc_length_m = from_m + way_m * (i as f64 + 0.5) / steps as f64;
                let piece = pieces.entry((arc_length_m / piece_m).floor() as i64).or_default();
                *piece = (piece.0 + step_s, piece.1 + step_s * arc_length_m);
            }
        }
        let spent = pieces.into_values().filter(|(time_s, _)| *time_s > 0.0);
        spent.map(|(time_s, moment)| (tract.station(moment / time_s).position_m.coords, time_s)).collect()
    }

    fn at(&self, place_m: &Vector3<f64>, sources: &[(Vector3<f64>, f64)]) -> f64 {
        let rate = |source: &Vector3<f64>| {
            let distance_m = (place_m - source).norm().max(self.nearest_m);
            dose_rate_sv_per_h(
                self.constant_sv_m2_per_h_bq,
                self.total_activity_bq,
                self.attenuation_per_m,
                distance_m,
                distance_m,
            )
        };
        sources.iter().map(|(source, time_s)| rate(source) * time_s / SECONDS_PER_HOUR).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_anatomy::tract_file::{TractOptions, load};
    use lumenav_core::Node;
    use std::path::Path;

    #[test]
    fn published_bound_of_three_markers_over_ten_hours() {
        // than2015, section 3.6: three markers of 1.85 MBq, 10 h, 50 mm: 8.04 mSv.
        let bound = dose_bound_sv(SODIUM_22_SV_M2_PER_H_BQ, 3.0 * 1.85e6, 36_000.0, 0.050);
        assert!((bound * 1e3 - 8.04).abs() < 0.005, "{bound}");
        let behind = dose_rate_sv_per_h(SODIUM_22_SV_M2_PER_H_BQ, 1.85e6, 9.6, 0.1, 0.1);
        assert!((behind - 0.362e-12 * 1.85e6 * (-0.96_f64).exp() / 0.01).abs() < 1e-18);
    }

    fn tube() -> Tract {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/tracts");
        let node = Node::open(&models.join("straight-tube.toml")).unwrap();
        load(&node, &TractOptions::default()).unwrap().0
    }

    fn ask(attenuation_per_m: f64) -> WallDose {
        WallDose {
            constant_sv_m2_per_h_bq: SODIUM_22_SV_M2_PER_H_BQ,
            total_activity_bq: 5.55e6,
            attenuation_per_m,
            nearest_m: 5.5e-3,
            stations: 11,
            around: 8,
        }
    }

    #[test]
    fn closed_form_dose_of_a_pass_through_a_straight_tube() {
        let tract = tube();
        let (length, radius) = (tract.length_m(), tract.radii(0.5 * tract.length_m()).resting_m);
        let there = |t_s: f64, arc_length_m: f64| TransitPoint { t_s, arc_length_m };
        let wall = ask(0.0).along(&tract, &[there(0.0, 0.0), there(3600.0, length)]).unwrap();
        // ∫ dt Γ A / (r² + v²t²) over the tube, seen from its middle: Γ A / (r v) 2 atan(L/2r), v in m/h.
        let speed = length;
        let wanted = 0.362e-12 * 5.55e6 / (radius * speed) * 2.0 * (0.5 * length / radius).atan();
        assert!((wall[5].mean_sv / wanted - 1.0).abs() < 5e-3, "{} {wanted}", wall[5].mean_sv);
        assert!((wall[5].largest_sv / wall[5].mean_sv - 1.0).abs() < 1e-6);
        // At the ends half of the way is missing.
        assert!(wall[0].mean_sv < 0.55 * wall[5].mean_sv);
    }

    #[test]
    fn closed_form_dose_of_a_capsule_at_rest() {
        let tract = tube();
        let middle = 0.5 * tract.length_m();
        let radius = tract.radii(middle).resting_m;
        let rest = [0.0, 7200.0].map(|t_s| TransitPoint { t_s, arc_length_m: middle });
        let wall = ask(9.6).along(&tract, &rest).unwrap();
        let wanted = 2.0 * 0.362e-12 * 5.55e6 / (radius * radius) * (-9.6 * radius).exp();
        assert!((wall[5].mean_sv / wanted - 1.0).abs() < 1e-9);
        assert!(ask(0.0).along(&tract, &rest[..1]).is_none());
        assert!(ask(0.0).along(&tract, &[rest[1], rest[0]]).is_none());
    }
}
