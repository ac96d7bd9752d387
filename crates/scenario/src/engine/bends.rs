//! Bends that are tighter than the capsule, where the tissue has to give way.
//!
//! Centre lines of measured bowels have kinks with bend radii of a few millimetres: a rigid cylinder of 15 mm does not fit a tube
//! bent like that. A real bowel hangs on its mesentery and straightens around the capsule. So does the lumen here, by as much as
//! the capsule does not fit:
//!
//! ```text
//! a(s) = (x(s + h) - x(s - h)) / |...|              the chord's direction, h: half of the capsule's cylinder
//! d_i = [x(s + ξ_i) - x(s)]·b                       how far the centre line leaves that chord at ring i, b: the bend's direction
//! u_i = R_rest(s + ξ_i) - ρ_i                       play of ring i
//! m(s) = ½ [max(d_i - u_i) - min(d_i + u_i)] - max(0, max(-u_i))
//! w(s) = S((m + 2.5 mm) / 1.5 mm)                    0: the capsule fits with play, 1: the tissue follows it
//! ```
//!
//! `m` is the misfit of a straight capsule put sideways as well as can be: it lies in the bent tube if every ring i finds a common shift δ with
//! `|d_i - δ| <= u_i + m`. What a straight lumen of that width would squeeze is no misfit of the bend and taken off (there the chord is the
//! centre line anyway).
//!
//! With `w` the rings before and behind the capsule's middle meet the tube around the chord `x(s) + u a(s)` instead of the tube
//! around the centre line (offset, direction and arc length are blended). The middle ring always meets the tube around the
//! centre line: the capsule's centre stays in the lumen as it was measured.
//!
//! Neglected: the work that straightening the tissue costs, and the reaction to the turn of `a(s)` as the capsule moves on.

use super::wall::{RINGS, Rings, smooth_step};
use lumenav_anatomy::centre_line::Station;
use lumenav_anatomy::tract::Tract;
use nalgebra::Vector3;

/// Distance of the table's entries, m: the tightest bends are a few of them long.
const SPACING_M: f64 = 0.5e-3;
/// Misfits between which the tissue comes to follow the capsule, m [T: a pull of 60 mN takes a capsule through all but one or two bends of
/// a shipped gut, where a dragged one meets 20 to 100 mN (B); from -0.5 to 0.5 mm it stuck in fourteen at 90 mN].
const GIVING_M: [f64; 2] = [-2.5e-3, -1e-3];
/// Chords shorter than this say nothing, m.
const SHORTEST_CHORD_M: f64 = 1e-3;
/// Where the ends of the capsule leave the chord by less there is no bend, m.
const STRAIGHT_M: f64 = 1e-9;

/// How far the tissue gives way along a tract for one capsule.
#[derive(Debug)]
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
    /// For a capsule with these rings.
    pub(crate) fn of(tract: &Tract, rings: &Rings) -> Self {
        let count = (tract.length_m() / SPACING_M).ceil() as usize + 1;
        let entries = (0..count).map(|i| chord(tract, i as f64 * SPACING_M, rings)).collect();
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

fn chord(tract: &Tract, arc_length_m: f64, rings: &Rings) -> Chord {
    let here = tract.station(arc_length_m);
    let s = here.arc_length_m;
    // Near an end the chord is shorter, and the same on both sides.
    let reach_m = rings.dome.min(s).min(tract.length_m() - s);
    let (behind, ahead) = (tract.station(s - reach_m).position_m, tract.station(s + reach_m).position_m);
    let chord = ahead - behind;
    if chord.norm() < SHORTEST_CHORD_M {
        return Chord { gives: 0.0, direction: here.tangent };
    }
    let direction = chord.normalize();
    let misfit_m = misfit_m(tract, &here, &direction, rings);
    Chord { gives: smooth_step((misfit_m - GIVING_M[0]) / (GIVING_M[1] - GIVING_M[0])), direction }
}

/// m(s) of the module's text.
fn misfit_m(tract: &Tract, here: &Station, direction: &Vector3<f64>, rings: &Rings) -> f64 {
    let away = |along_m: f64| {
        let way = tract.station(here.arc_length_m + along_m).position_m - here.position_m;
        way - direction * direction.dot(&way)
    };
    let tip_m = rings.offset_m[RINGS - 1];
    let bend = (away(tip_m) + away(-tip_m)).try_normalize(STRAIGHT_M).unwrap_or_else(Vector3::zeros);
    let (mut high, mut low, mut squeezed) = (f64::NEG_INFINITY, f64::INFINITY, 0.0_f64);
    for (along_m, radius_m) in rings.offset_m.iter().zip(&rings.radius_m) {
        let play_m = tract.radius.radius_m(here.arc_length_m + along_m) - radius_m;
        let off_m = bend.dot(&away(*along_m));
        high = high.max(off_m - play_m);
        low = low.min(off_m + play_m);
        squeezed = squeezed.max(-play_m);
    }
    0.5 * (high - low) - squeezed
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_anatomy::segment::SegmentKey;
    use lumenav_anatomy::tract::{End, SegmentPoints, TractDraft};
    use lumenav_core::CapsuleBody;
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

    fn rings() -> Rings {
        Rings::of(&CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 })
    }

    #[test]
    fn closed_form_misfit_in_an_arc() {
        // In an arc of radius rho the line leaves the middle's tangent, which is the chord's direction, by rho (1 - cos(xi/rho)). Its side with the
        // least room is the tip or the end of the cylinder on one side, the middle on the other.
        let bend_m = 0.02_f64;
        let away_m = |along_m: f64| bend_m * (1.0 - (along_m / bend_m).cos());
        let (tip_m, tip_radius_m) = (0.0075 + 0.0055 * 0.5_f64.sqrt(), 0.0055 * 0.5_f64.sqrt());
        let mut partly = 0;
        for lumen_m in [0.0055, 0.006, 0.0068, 0.0075, 0.0078, 0.008, 0.0083, 0.012] {
            let tract = elbow(bend_m, lumen_m);
            let middle_m = 0.1 + bend_m * std::f64::consts::FRAC_PI_4;
            let outer = (away_m(tip_m) - lumen_m + tip_radius_m).max(away_m(0.0075) - lumen_m + 0.0055);
            let misfit_m = 0.5 * (outer - (lumen_m - 0.0055));
            let expected = smooth_step((misfit_m - GIVING_M[0]) / (GIVING_M[1] - GIVING_M[0]));
            partly += u32::from(expected > 0.1 && expected < 0.9);
            let found = Bends::of(&tract, &rings()).chord(middle_m);
            let gives = found.map_or(0.0, |chord| chord.gives);
            assert!((gives - expected).abs() < 0.03, "{lumen_m}: {gives}, not {expected}");
            if let Some(chord) = found {
                let diagonal = Vector3::new(1.0, 0.0, 1.0).normalize();
                assert!(chord.direction.dot(&diagonal) > 0.999, "{}", chord.direction);
            }
        }
        assert!(partly >= 2, "{partly}");
    }

    #[test]
    fn law_straight_lumina_and_ends_do_not_give() {
        let bends = Bends::of(&elbow(0.006, 0.0085), &rings());
        for i in 0..80 {
            assert!(bends.chord(1e-3 * f64::from(i)).is_none(), "{i} mm");
        }
        assert!(bends.chord(0.105).is_some_and(|chord| chord.gives > 0.5));
        assert!(bends.chord(10.0).is_none() && bends.chord(-1.0).is_none());
        // Narrow and straight: the chord is the centre line, and following it changes nothing.
        let narrow = elbow(0.3, 0.005);
        let chord = Bends::of(&narrow, &rings()).chord(0.05).unwrap();
        assert!((chord.direction - narrow.station(0.05).tangent).norm() < 1e-9);
    }
}
