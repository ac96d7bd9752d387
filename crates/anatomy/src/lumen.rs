//! The moving lumen: the radius R(s, φ, t) of the tube around the centre line.
//!
//! ```text
//! R(s, φ, t) = R0(s) [1 - min(0.98, Σ_j a_j G E)] [1 - h(s, φ, t) H(s)] + Σ_k D_k(s, φ)
//! H(s) = (½ + ½ cos(2π s/p))⁴      h(s, φ, t) = h0 B(s) [1 - r (½ + ½ cos 3φ)] (1 - f)
//! f = 1 - Π_j (1 - E_j W_j)         W = S((y + 3w)/2w) S((a - y)/0.05 m),  y = (s - s_j - v_j (t - t_j)) sign(v_j)
//! ```
//!
//! R0 is the tract's resting radius, the sum runs over the waves of [`crate::motility`] and the pylorus ([`crate::pylorus`]), H is the ripple of the folds with
//! pitch p (haustra, Kerckring's folds), B switches it smoothly on and off over one pitch at the ends of a segment, and r (0
//! unless set) lowers the folds of the colon at the three taeniae. Before a mass movement the haustra disappear: f flattens them from 3
//! widths behind it to `a = flattens_ahead_m` before it, in the colon alone, and haustral contractions relax there by the same
//! factor `1 - f`. The angle φ is measured from the station's normal towards its binormal. With an amplitude of zero the
//! result is exactly the resting tube.
//!
//! D_k are the pouches of the wall ([`crate::diverticulum`]), of which there are none unless they are put in.
//!
//! Derivatives are analytic. Where the waves close the lumen by more than 98 % their sum is cut off and its derivatives are
//! zero. A wave further away than 7 widths is not counted (it would change the radius by 2e-11 of itself).
//!
//! Neglected: the cross-section stays a circle (but for taeniae and diverticula), the wall does not move along the tract, and its inertia.

use crate::diverticulum::Diverticulum;
use crate::motility::{Motility, WaveInstant, smooth_step};
use crate::tract::Tract;
use nalgebra::Vector3;
use std::f64::consts::PI;
use std::sync::Arc;

/// Largest part of the radius that waves take.
const MOST_CLOSED: f64 = 0.98;
/// Waves further away than this many widths are not counted.
const REACH_WIDTHS: f64 = 7.0;
/// A wave further away than this many widths moves nothing: it takes less than 4e-6 of the radius, some 30 nm.
const STILL_WIDTHS: f64 = 5.0;
/// Length over which flattened haustra stand up again, m.
const FLATTENING_EDGE_M: f64 = 0.05;
/// How far the focus may move, m, and how long it may stay, s, before near waves are looked up again.
const FOCUS_SLACK_M: f64 = 0.01;
const FOCUS_TIME_S: f64 = 0.25;

/// Radius of the lumen at one place and time, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadiusSample {
    /// R, m.
    pub radius_m: f64,
    /// ∂R/∂s.
    pub d_ds: f64,
    /// ∂R/∂t, m/s.
    pub d_dt_m_s: f64,
    /// ∂R/∂φ, m/rad.
    pub d_dangle_m: f64,
    /// Fraction of the radius that contractions take here, 0 to 0.98.
    pub closed: f64,
}

/// The tube, resting or moving.
#[derive(Debug, Clone)]
pub struct Lumen {
    tract: Arc<Tract>,
    motility: Motility,
    folds: Vec<Folds>,
    diverticula: Vec<Diverticulum>,
    focus: Focus,
}

/// Haustra between two arc lengths.
#[derive(Debug, Clone, Copy)]
struct Folds {
    start_m: f64,
    end_m: f64,
    pitch_m: f64,
    depth: f64,
    taenia_relief: f64,
    /// Haustra flatten before a mass movement, Kerckring's folds do not.
    flatten: bool,
}

/// The waves near the place that is asked about most.
#[derive(Debug, Clone)]
struct Focus {
    near: Vec<usize>,
    instants: Vec<WaveInstant>,
    centre_m: f64,
    until_s: f64,
    since_s: f64,
    revision: u64,
}

impl Lumen {
    /// The lumen of a tract with its motility, at the start of time.
    pub fn new(tract: Arc<Tract>, motility: Motility) -> Self {
        let folds = tract
            .segments
            .iter()
            .filter(|segment| segment.wall.haustra_depth > 0.0 && segment.wall.haustra_pitch_m > 0.0)
            .map(|segment| Folds {
                start_m: segment.start_m,
                end_m: segment.end_m,
                pitch_m: segment.wall.haustra_pitch_m,
                depth: segment.wall.haustra_depth,
                flatten: segment.key.is_colon(),
                taenia_relief: if segment.key.is_colon() { motility.taenia_relief() } else { 0.0 },
            })
            .collect();
        let focus = Focus {
            near: Vec::with_capacity(256),
            instants: Vec::with_capacity(256),
            centre_m: f64::INFINITY,
            until_s: f64::NEG_INFINITY,
            since_s: f64::INFINITY,
            revision: u64::MAX,
        };
        Self { tract, motility, folds, diverticula: Vec::new(), focus }
    }

    /// Adds a pouch of the wall.
    pub fn insert(&mut self, diverticulum: Diverticulum) {
        self.diverticula.push(diverticulum);
    }

    /// Its pouches, in the order in which they came.
    pub fn diverticula(&self) -> &[Diverticulum] {
        &self.diverticula
    }

    /// The tract.
    pub fn tract(&self) -> &Arc<Tract> {
        &self.tract
    }

    /// Its motility.
    pub fn motility(&self) -> &Motility {
        &self.motility
    }

    /// Moves the motility on to `time_s`: [`Lumen::radius`] is right from there until the next wave starts.
    pub fn advance_to(&mut self, time_s: f64) {
        self.motility.advance_to(time_s);
    }

    /// Radius at arc length `s_m`, angle `angle_rad` and `time_s`, of all waves running at the time advanced to.
    pub fn radius(&self, s_m: f64, angle_rad: f64, time_s: f64) -> RadiusSample {
        let gate = self.motility.gate().map(|gate| gate.at(time_s));
        let waves = self.motility.active().iter().map(|wave| wave.at(time_s));
        self.sample(s_m, angle_rad, waves.chain(gate))
    }

    /// The resting radius with folds, m.
    pub fn resting_radius_m(&self, s_m: f64, angle_rad: f64) -> f64 {
        self.sample(s_m, angle_rad, std::iter::empty()).radius_m
    }

    /// The resting radius without folds (m) and its derivatives by arc length and angle (m/rad): what is behind all that gives way.
    pub fn outermost(&self, s_m: f64, angle_rad: f64) -> Vector3<f64> {
        let (radius_m, d_ds) = self.tract.radius.with_slope(s_m);
        Vector3::new(radius_m, d_ds, 0.0) + self.bulge(s_m, angle_rad)
    }

    /// What the diverticula add to the radius, m, and its derivatives by arc length and angle.
    #[inline]
    fn bulge(&self, s_m: f64, angle_rad: f64) -> Vector3<f64> {
        self.diverticula.iter().map(|one| one.at(s_m, angle_rad)).sum()
    }

    /// Advances to `time_s` and prepares [`Lumen::radius_near`] for arc lengths within `half_width_m` of `s_m`.
    pub fn focus_on(&mut self, s_m: f64, half_width_m: f64, time_s: f64) {
        self.motility.advance_to(time_s);
        let focus = &mut self.focus;
        let waves = self.motility.active();
        let stale = focus.revision != self.motility.revision()
            || time_s > focus.until_s
            || time_s < focus.since_s
            || (s_m - focus.centre_m).abs() > FOCUS_SLACK_M;
        if stale {
            focus.near.clear();
            for (index, wave) in waves.iter().enumerate() {
                let reach_m = (REACH_WIDTHS * wave.width_m).max(wave.flattens_ahead_m)
                    + half_width_m
                    + FOCUS_SLACK_M
                    + wave.speed_m_s.abs() * FOCUS_TIME_S;
                let centre_m = wave.centre_m(time_s);
                if (centre_m - s_m).abs() <= reach_m {
                    focus.near.push(index);
                }
            }
            focus.centre_m = s_m;
            focus.since_s = time_s;
            focus.until_s = time_s + FOCUS_TIME_S;
            focus.revision = self.motility.revision();
        }
        focus.instants.clear();
        for index in &focus.near {
            let wave = &waves[*index];
            let instant = wave.at(time_s);
            let reach_m = half_width_m + (REACH_WIDTHS * wave.width_m).max(wave.flattens_ahead_m);
            if (instant.centre_m - s_m).abs() <= reach_m {
                focus.instants.push(instant);
            }
        }
        if let Some(gate) = self.motility.gate()
            && (gate.place_m() - s_m).abs() <= half_width_m + REACH_WIDTHS * gate.width_m()
        {
            focus.instants.push(gate.at(time_s));
        }
    }

    /// Radius near the place and at the time of the last [`Lumen::focus_on`]: the same number as [`Lumen::radius`].
    #[inline]
    pub fn radius_near(&self, s_m: f64, angle_rad: f64) -> RadiusSample {
        self.sample(s_m, angle_rad, self.focus.instants.iter().copied())
    }

    /// Until when no wave comes within reach of the lumen from `s_m - half_width_m` to `s_m + half_width_m`, s: not later than the next
    /// event of the motility, after which there may be other waves; the present time where one is there. The wall stands still until then.
    pub fn still_until_s(&self, s_m: f64, half_width_m: f64) -> f64 {
        let now_s = self.motility.time_s();
        let mut until_s = self.motility.next_event_s();
        if let Some(gate) = self.motility.gate()
            && (gate.place_m() - s_m).abs() <= half_width_m + STILL_WIDTHS * gate.width_m()
        {
            until_s = until_s.min(gate.still_until_s(now_s));
        }
        for wave in self.motility.active() {
            let centre_m = wave.centre_m(now_s);
            let reach_m = half_width_m + (STILL_WIDTHS * wave.width_m).max(wave.flattens_ahead_m);
            let way_m = s_m - centre_m;
            let gap_m = way_m.abs() - reach_m;
            let arrives_s = match gap_m {
                gap if gap <= 0.0 => now_s,
                gap if way_m * wave.speed_m_s > 0.0 => now_s + gap / wave.speed_m_s.abs(),
                _ => f64::INFINITY,
            };
            if arrives_s < wave.end_time_s() {
                until_s = until_s.min(arrives_s);
            }
        }
        until_s
    }

    /// Whether the radius depends on the angle anywhere.
    pub fn depends_on_angle(&self) -> bool {
        !self.diverticula.is_empty() || self.folds.iter().any(|folds| folds.taenia_relief > 0.0)
    }

    #[inline]
    fn sample(&self, s_m: f64, angle_rad: f64, waves: impl Iterator<Item = WaveInstant>) -> RadiusSample {
        let folds = self.folds.iter().find(|folds| folds.start_m < s_m && s_m < folds.end_m);
        let in_colon = folds.is_some_and(|folds| folds.flatten);
        let mut standing = Standing::FULLY;
        // Sums of a G E and its derivatives by s and t: of all waves, and of haustral contractions.
        let (mut all, mut haustral) = (Closure::OPEN, Closure::OPEN);
        for wave in waves {
            if s_m < wave.acts_from_m {
                continue;
            }
            let u = (s_m - wave.centre_m) * wave.per_width_per_m;
            if u.abs() < REACH_WIDTHS {
                if wave.yields { haustral.add(&wave, u) } else { all.add(&wave, u) }
            }
            if in_colon && wave.flattens_ahead_m > 0.0 {
                standing.flatten(&wave, s_m);
            }
        }
        let mut closed = all.part + haustral.part * standing.part;
        let mut closed_ds = all.d_ds + haustral.d_ds * standing.part + haustral.part * standing.d_ds;
        let mut closed_dt = all.d_dt + haustral.d_dt * standing.part + haustral.part * standing.d_dt;
        if closed >= MOST_CLOSED {
            (closed, closed_ds, closed_dt) = (MOST_CLOSED, 0.0, 0.0);
        }
        let (rest_m, rest_ds) = self.tract.radius.with_slope(s_m);
        let (open, folded) =
            (1.0 - closed, folds.map_or(Ripple::NONE, |folds| folds.at(s_m, angle_rad, &standing)));
        let mut sample = RadiusSample {
            radius_m: rest_m * open * folded.open,
            d_ds: (rest_ds * open - rest_m * closed_ds) * folded.open + rest_m * open * folded.d_ds,
            d_dt_m_s: -rest_m * closed_dt * folded.open + rest_m * open * folded.d_dt,
            d_dangle_m: rest_m * open * folded.d_dangle,
            closed,
        };
        if !self.diverticula.is_empty() {
            let bulge = self.bulge(s_m, angle_rad);
            sample.radius_m += bulge.x;
            sample.d_ds += bulge.y;
            sample.d_dangle_m += bulge.z;
        }
        sample
    }
}

/// `1 - h H` and its derivatives.
struct Ripple {
    open: f64,
    d_ds: f64,
    d_dt: f64,
    d_dangle: f64,
}

impl Ripple {
    const NONE: Self = Self { open: 1.0, d_ds: 0.0, d_dt: 0.0, d_dangle: 0.0 };
}

/// A sum of `a G E`.
struct Closure {
    part: f64,
    d_ds: f64,
    d_dt: f64,
}

impl Closure {
    const OPEN: Self = Self { part: 0.0, d_ds: 0.0, d_dt: 0.0 };

    #[inline]
    fn add(&mut self, wave: &WaveInstant, u: f64) {
        let gauss = (-0.5 * u * u).exp();
        let slope = -u * wave.per_width_per_m * gauss * wave.weight;
        self.part += wave.weight * gauss;
        self.d_ds += slope;
        self.d_dt += wave.weight_rate_per_s * gauss - wave.speed_m_s * slope;
    }
}

/// How much of the haustra stands, `1 - f`, and its derivatives.
struct Standing {
    part: f64,
    d_ds: f64,
    d_dt: f64,
}

impl Standing {
    const FULLY: Self = Self { part: 1.0, d_ds: 0.0, d_dt: 0.0 };

    /// Multiplies by `1 - E W` of one wave.
    fn flatten(&mut self, wave: &WaveInstant, s_m: f64) {
        let direction = wave.speed_m_s.signum();
        let y = (s_m - wave.centre_m) * direction;
        let rise_per_m = 0.5 * wave.per_width_per_m;
        let (behind, behind_slope) = smooth_step(y * rise_per_m + 1.5);
        let (ahead, ahead_slope) = smooth_step((wave.flattens_ahead_m - y) / FLATTENING_EDGE_M);
        let window = behind * ahead;
        let window_ds =
            (behind_slope * rise_per_m * ahead - behind * ahead_slope / FLATTENING_EDGE_M) * direction;
        let factor = 1.0 - wave.envelope * window;
        let factor_ds = -wave.envelope * window_ds;
        let factor_dt = -wave.envelope_rate_per_s * window - wave.speed_m_s * factor_ds;
        self.d_ds = self.d_ds * factor + self.part * factor_ds;
        self.d_dt = self.d_dt * factor + self.part * factor_dt;
        self.part *= factor;
    }
}

impl Folds {
    #[inline]
    fn at(&self, s_m: f64, angle_rad: f64, standing: &Standing) -> Ripple {
        let (on, on_slope) = smooth_step((s_m - self.start_m) / self.pitch_m);
        let (off, off_slope) = smooth_step((self.end_m - s_m) / self.pitch_m);
        let (blend, blend_ds) = (on * off, (on_slope * off - on * off_slope) / self.pitch_m);
        let wave_number = 2.0 * PI / self.pitch_m;
        let (sine, cosine) = (wave_number * (s_m - self.start_m)).sin_cos();
        let base = 0.5 + 0.5 * cosine;
        let (ripple, ripple_ds) = (base * base * base * base, -2.0 * base * base * base * sine * wave_number);
        let (height, height_dangle) = if self.taenia_relief > 0.0 {
            let (sine3, cosine3) = (3.0 * angle_rad).sin_cos();
            (
                self.depth * (1.0 - self.taenia_relief * (0.5 + 0.5 * cosine3)),
                self.depth * self.taenia_relief * 1.5 * sine3,
            )
        } else {
            (self.depth, 0.0)
        };
        let (shape, shape_ds) = (blend * ripple, blend_ds * ripple + blend * ripple_ds);
        Ripple {
            open: 1.0 - height * shape * standing.part,
            d_ds: -height * (shape_ds * standing.part + shape * standing.d_ds),
            d_dt: -height * shape * standing.d_dt,
            d_dangle: -height_dangle * shape * standing.part,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motility_config::{MotilityConfig, WaveConfig};
    use crate::segment::SegmentKey;
    use crate::test_tracts::stomach_and_duodenum;
    use crate::tract::{End, SegmentPoints, TractDraft};
    use lumenav_core::RandomStreams;
    use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
    use nalgebra::Point3;

    fn tract(key: SegmentKey) -> Arc<Tract> {
        let points_m: Vec<_> = (0..=20).map(|i| Point3::new(0.0, 0.0, 0.05 * f64::from(i))).collect();
        // A radius that varies, so that its slope takes part.
        let radii_m = (0..=20).map(|i| 0.015 + 0.003 * f64::from(i).sin()).collect();
        let segment =
            SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() };
        let ends = (End::Closed, End::Exit);
        let segments = vec![segment];
        let draft = TractDraft {
            name: "t".into(),
            segments,
            ends,
            torso_half_extents_m: None,
            source: String::new(),
        };
        Arc::new(draft.build().unwrap().0)
    }

    fn lumen(key: SegmentKey, config: &MotilityConfig, time_s: f64) -> Lumen {
        let tract = tract(key);
        let motility = Motility::new(config, &tract, &RandomStreams::new(7, 0, "motility")).unwrap();
        let mut lumen = Lumen::new(tract, motility);
        lumen.advance_to(time_s);
        lumen
    }

    fn busy() -> MotilityConfig {
        let wave = WaveConfig {
            start_time_s: NonNegative(10.0),
            segment: None,
            start_m: Finite(0.2),
            speed_m_s: Finite(0.022),
            run_m: Some(Positive(0.41)),
            duration_s: None,
            width_m: Positive(0.03),
            amplitude: Fraction(0.9),
            flattens_ahead_m: NonNegative(0.2),
        };
        let mut config =
            MotilityConfig { wave: vec![wave], taenia_relief: Fraction(0.4), ..MotilityConfig::default() };
        config.mmc.start_phase = Some(Fraction(0.95));
        config
    }

    #[test]
    fn law_derivatives_equal_central_differences() {
        // Shortly after the start, under way and while it ends; with haustra, taeniae and haustral contractions.
        for (key, time_s) in [
            (SegmentKey::Ascending, 11.3),
            (SegmentKey::Ascending, 20.0),
            (SegmentKey::Transverse, 27.1),
            (SegmentKey::Jejunum, 20.0),
        ] {
            let mut lumen = lumen(key, &busy(), time_s);
            lumen.insert(Diverticulum::new(0.3, 2.0, 0.015, 0.03, 0.015));
            let h = 1e-6;
            let mut moving = 0;
            for i in 0..4000 {
                let (s, angle) = (0.01 + 0.98 * f64::from(i) / 4000.0, 0.37 * f64::from(i));
                let sample = lumen.radius(s, angle, time_s);
                let difference = |ds: f64, da: f64, dt: f64| {
                    (lumen.radius(s + ds, angle + da, time_s + dt).radius_m
                        - lumen.radius(s - ds, angle - da, time_s - dt).radius_m)
                        / (2.0 * h)
                };
                // Third derivatives at the scale of a fold (2 mm), times h², and rounding over h.
                let tolerance = 1e-6;
                assert!((sample.d_ds - difference(h, 0.0, 0.0)).abs() < tolerance, "{key} d/ds at {s}");
                assert!((sample.d_dangle_m - difference(0.0, h, 0.0)).abs() < tolerance, "{key} d/dφ at {s}");
                assert!((sample.d_dt_m_s - difference(0.0, 0.0, h)).abs() < tolerance, "{key} d/dt at {s}");
                moving += u32::from(sample.d_dt_m_s.abs() > 1e-5);
            }
            assert!(moving > 100, "{key} at {time_s} s: hardly anything moves, so nothing was tested");
        }
    }

    #[test]
    fn law_derivatives_at_the_pylorus_equal_central_differences() {
        let tract = Arc::new(stomach_and_duodenum(0.012));
        let mut config = MotilityConfig::default();
        config.pylorus.opening_fraction = Fraction(1.0);
        let motility = Motility::new(&config, &tract, &RandomStreams::new(7, 0, "motility")).unwrap();
        let mut lumen = Lumen::new(tract, motility);
        let (h, mut shut, mut open) = (1e-6, false, false);
        for step in 0..400 {
            let time_s = 60.0 + 0.25 * f64::from(step);
            lumen.advance_to(time_s);
            for s in [0.19, 0.197, 0.2, 0.204, 0.211] {
                let sample = lumen.radius(s, 0.0, time_s);
                let difference = |ds: f64, dt: f64| {
                    let at = |sign: f64| lumen.radius(s + sign * ds, 0.0, time_s + sign * dt).radius_m;
                    (at(1.0) - at(-1.0)) / (2.0 * h)
                };
                // The cut at 98 % has a kink, which a difference may straddle.
                if sample.closed < 0.97 {
                    assert!((sample.d_ds - difference(h, 0.0)).abs() < 1e-5, "d/ds at {s}, {time_s} s");
                    assert!((sample.d_dt_m_s - difference(0.0, h)).abs() < 1e-5, "d/dt at {s}, {time_s} s");
                }
            }
            lumen.focus_on(0.2, 0.02, time_s);
            assert_eq!(lumen.radius_near(0.203, 0.0), lumen.radius(0.203, 0.0, time_s));
            let closed = lumen.radius(0.2, 0.0, time_s).closed;
            (shut, open) = (shut || closed > 0.89, open || closed < 0.6);
        }
        assert!(shut && open, "it was never both");
    }

    #[test]
    fn law_no_amplitude_is_exactly_the_resting_tube() {
        let config = MotilityConfig { amplitude_scale: Fraction(0.0), ..busy() };
        let lumen = lumen(SegmentKey::Rectum, &config, 20.0);
        for i in 0..1000 {
            let s = f64::from(i) * 1e-3;
            let sample = lumen.radius(s, 0.0, 20.0);
            // The rectum has no folds.
            assert_eq!(sample.radius_m, lumen.tract().radius.radius_m(s));
            assert_eq!((sample.d_dt_m_s, sample.closed), (0.0, 0.0));
        }
    }

    #[test]
    fn law_the_focus_changes_no_bit() {
        let mut lumen = lumen(SegmentKey::Ascending, &busy(), 10.0);
        for i in 0..400 {
            let time_s = 10.0 + 0.05 * f64::from(i);
            let centre_m = 0.25 + 0.02 * f64::from(i) * 0.05;
            lumen.focus_on(centre_m, 0.02, time_s);
            for k in -4..=4 {
                let s = centre_m + 0.005 * f64::from(k);
                assert_eq!(lumen.radius_near(s, 1.0), lumen.radius(s, 1.0, time_s), "at {s}, {time_s} s");
            }
        }
    }

    #[test]
    fn closed_form_one_gaussian_in_a_smooth_tube() {
        let config = MotilityConfig { spontaneous: false, ..busy() };
        let lumen = lumen(SegmentKey::Rectum, &config, 20.0);
        let centre_m = 0.2 + 0.022 * 10.0;
        for (distance_m, closed) in
            [(0.0, 0.9), (0.03, 0.9 * (-0.5_f64).exp()), (-0.06, 0.9 * (-2.0_f64).exp())]
        {
            let s = centre_m + distance_m;
            let expected = lumen.tract().radius.radius_m(s) * (1.0 - closed);
            assert!((lumen.radius(s, 0.0, 20.0).radius_m - expected).abs() < 1e-15);
        }
        // Before it starts and after it ended there is nothing.
        assert_eq!(lumen.radius(centre_m, 0.0, 10.0).closed, 0.0);
        assert_eq!(lumen.radius(centre_m, 0.0, 10.0 + 0.41 / 0.022 + 1e-9).closed, 0.0);
    }
}
