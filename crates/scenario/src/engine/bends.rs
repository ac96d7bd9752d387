//! Bends that are tighter than the capsule, where the tissue has to give way.
//!
//! Centre lines of measured bowels have kinks with bend radii of a few millimetres: a rigid cylinder of 15 mm does not fit a tube
//! bent like that. A real bowel hangs on its mesentery and straightens around the capsule. So does the lumen here, by as much as
//! the capsule does not fit:
//!
//! ```text
//! σ(s) = |½ (x(s + h) + x(s - h)) - x(s)|          sagitta of the capsule's own chord, h: half of its cylinder
//! a(s) = (x(s + h) - x(s - h)) / |...|              the chord's direction
//! w(s) = S((σ - max(R_rest - r, 0) - 0.1 mm) / 2 mm) 0: the capsule fits (σ is below its play), 1: the tissue follows it
//! ```
//!
//! With `w` the rings before and behind the capsule's middle meet the tube around the chord `x(s) + u a(s)` instead of the tube
//! around the centre line (offset, direction and arc length are blended). The middle ring always meets the tube around the
//! centre line: the capsule's centre stays in the lumen as it was measured.
//!
//! Neglected: the work that straightening the tissue costs, and the reaction to the turn of `a(s)` as the capsule moves on.

use super::wall::smooth_step;
use lumenav_anatomy::tract::Tract;
use nalgebra::Vector3;

/// Distance of the table's entries, m: the tightest bends are a few of them long.
const SPACING_M: f64 = 0.5e-3;
/// Misfit over which the tissue comes to follow the capsule, m.
const GIVING_M: f64 = 2e-3;
/// Misfit that the wall's own compliance takes up, m.
const TAKEN_UP_M: f64 = 0.1e-3;
/// Chords shorter than this say nothing, m.
const SHORTEST_CHORD_M: f64 = 1e-3;

/// How far the tissue gives way along a tract for one capsule.
#[derive(Debug, Clone)]
pub(crate) struct Bends {
    entries: Vec<Chord>,
}

/// The chord at one place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chord {
    /// w, 0 to 1.
    pub(crate) gives: f64,
    /// Unit direction, aboral.
    pub(crate) direction: Vector3<f64>,
}

impl Bends {
    /// For a capsule of radius `radius_m` whose cylinder is `2 half_m` long.
    pub(crate) fn of(tract: &Tract, half_m: f64, radius_m: f64) -> Self {
        let count = (tract.length_m() / SPACING_M).ceil() as usize + 1;
        let entries = (0..count).map(|i| chord(tract, i as f64 * SPACING_M, half_m, radius_m)).collect();
        Self { entries }
    }

    /// The chord of a capsule whose middle is at an arc length, `None` where it fits.
    #[inline]
    pub(crate) fn chord(&self, arc_length_m: f64) -> Option<Chord> {
        let place = arc_length_m / SPACING_M;
        let index = (place as usize).min(self.entries.len().saturating_sub(2));
        let [before, after] = self.entries.get(index..index + 2)? else { return None };
        if before.gives == 0.0 && after.gives == 0.0 {
            return None;
        }
        let x = (place - index as f64).clamp(0.0, 1.0);
        let direction = before.direction * (1.0 - x) + after.direction * x;
        Some(Chord { gives: before.gives * (1.0 - x) + after.gives * x, direction: direction.normalize() })
    }
}

fn chord(tract: &Tract, arc_length_m: f64, half_m: f64, radius_m: f64) -> Chord {
    let here = tract.station(arc_length_m);
    let s = here.arc_length_m;
    // Near an end the chord is shorter, and the same on both sides.
    let reach_m = half_m.min(s).min(tract.length_m() - s);
    let (behind, ahead) = (tract.station(s - reach_m).position_m, tract.station(s + reach_m).position_m);
    let chord = ahead - behind;
    if chord.norm() < SHORTEST_CHORD_M {
        return Chord { gives: 0.0, direction: here.tangent };
    }
    let sagitta_m = (nalgebra::center(&behind, &ahead) - here.position_m).norm();
    let play_m = (tract.radius.radius_m(s) - radius_m).max(0.0);
    Chord { gives: smooth_step((sagitta_m - play_m - TAKEN_UP_M) / GIVING_M), direction: chord.normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_anatomy::segment::SegmentKey;
    use lumenav_anatomy::tract::{End, SegmentPoints, TractDraft};
    use nalgebra::Point3;

    /// 0.1 m straight on, a bend of 90 degrees, 0.1 m straight on.
    fn elbow(bend_m: f64, radius_m: f64) -> Tract {
        let mut points_m: Vec<_> = (0..100).map(|i| Point3::new(0.0, 0.0, 1e-3 * f64::from(i))).collect();
        let turn = (0..=20).map(|i| std::f64::consts::FRAC_PI_2 * f64::from(i) / 20.0);
        points_m.extend(turn.map(|a| Point3::new(bend_m * (1.0 - a.cos()), 0.0, 0.1 + bend_m * a.sin())));
        points_m.extend((1..=100).map(|i| Point3::new(bend_m + 1e-3 * f64::from(i), 0.0, 0.1 + bend_m)));
        let key = SegmentKey::Ileum;
        let radii_m = vec![radius_m; points_m.len()];
        let segment =
            SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() };
        let draft = TractDraft {
            name: "elbow".into(),
            segments: vec![segment],
            ends: (End::Closed, End::Closed),
            torso_half_extents_m: None,
            source: String::new(),
        };
        draft.build().unwrap().0
    }

    #[test]
    fn closed_form_misfit_in_an_arc() {
        // A cylinder of 12.4 mm within a bend of 8 mm: sagitta rho (1 - cos(h/rho)), and the chord along the middle's tangent.
        let (bend_m, half_m, radius_m) = (0.008_f64, 0.0062_f64, 0.0055);
        let sagitta_m = bend_m * (1.0 - (half_m / bend_m).cos());
        for lumen_m in [0.0055, 0.006, 0.007, 0.0075, 0.012] {
            let tract = elbow(bend_m, lumen_m);
            let middle_m = 0.1 + bend_m * std::f64::consts::FRAC_PI_4;
            let expected = smooth_step((sagitta_m - (lumen_m - radius_m) - TAKEN_UP_M) / GIVING_M);
            let found = Bends::of(&tract, half_m, radius_m).chord(middle_m);
            assert!(
                (found.map_or(0.0, |chord| chord.gives) - expected).abs() < 0.01,
                "{lumen_m}: {expected}"
            );
            if let Some(chord) = found {
                let diagonal = Vector3::new(1.0, 0.0, 1.0).normalize();
                assert!(chord.direction.dot(&diagonal) > 0.999, "{}", chord.direction);
            }
        }
    }

    #[test]
    fn law_straight_lumina_and_ends_do_not_give() {
        let bends = Bends::of(&elbow(0.006, 0.0055), 0.0075, 0.0055);
        for i in 0..80 {
            assert!(bends.chord(1e-3 * f64::from(i)).is_none(), "{i} mm");
        }
        assert!(bends.chord(0.105).is_some_and(|chord| chord.gives > 0.5));
        assert!(bends.chord(10.0).is_none() && bends.chord(-1.0).is_none());
    }
}
