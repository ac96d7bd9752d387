//! The fast unbiased mode: photons aimed at blocks.
//!
//! A line needs two singles of one decay or of two. They are made in three classes that exclude each other and together are all:
//!
//! - **direct**: an annihilation photon reaches a block without scattering in the body and is read out. It is aimed ([`super::aim`])
//!   and kept with its transmission; the other photon and the prompt gammas follow as they come. Both photons of a decay can be
//!   the aimed one, so a decay of which both were direct is kept with probability 1/2.
//! - **indirect**: no annihilation photon is direct, but one is read out after scattering. Directions are isotropic. To spare time only
//!   one photon in `K` is followed, and each that is read out is joined by `K` independent sets of other photon and gammas:
//!   unbiased; that two of the `K` make lines is rare. Those that would be given up after their first scattering are left out beforehand.
//! - **random**: singles of some thousand whole decays stand for the window's. The number of random lines is Poisson with the mean that
//!   the allowed pairs among them tell (a U-statistic, so unbiased).
//!
//! Lines are lost to a third single in the window with probability `1 - exp(-2 S τ)`, and to dead time with the blocks' rates.
//! Left out: two prompt gammas of one decay without an annihilation photon; singles that sum up in one block (0.1 % of lines; the
//! line is dropped).

use super::Physics;
use super::aim::{Aim, Shares};
use super::analog;
use super::coincidence::LabelledLine;
use super::compton::isotropic;
use super::detectors::{Hits, Kind, Single};
use super::photon::Photon;
use super::source::{ANNIHILATION_EV, MarkerPaths, opposite};
use lumenav_core::RandomStream;
use nalgebra::Vector3;
use rand::RngExt as _;

/// Whole decays that stand for a window's singles.
const SAMPLED_DECAYS: usize = 1500;
/// At most so many sets for one indirect photon.
const MOST_SETS: f64 = 32.0;

/// Singles of a sample of whole decays.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// Decays followed.
    pub decays: usize,
    /// Singles per decay.
    pub singles_per_decay: f64,
    /// Singles of decays that made no other.
    pub lone: Vec<Single>,
    /// Pairs of [`Self::lone`] that can fire together.
    allowed: u64,
    /// Of them, prompt gammas.
    pub prompts_per_decay: f64,
    /// Share of singles in each block.
    by_block: Vec<f64>,
}

/// Room that the forced mode needs.
#[derive(Clone, Debug, Default)]
pub(super) struct Forced {
    aim: Aim,
    first: Hits,
    others: Hits,
    first_singles: Vec<Single>,
    other_singles: Vec<Single>,
    pub sample: Sample,
    /// Decays made so far in this window: their numbers.
    number: u32,
}

/// One window: when, and how long.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub duration_s: f64,
}

/// Which photons of a decay a line must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keep {
    /// All lines.
    All,
    /// Lines with a prompt gamma.
    PromptOnly,
}

impl Forced {
    /// All lines of a window, unsorted; `false` where a marker is too near to a block to be aimed (nothing is drawn then).
    pub fn window(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) -> bool {
        for marker in 0..physics.markers.len() {
            if !self.aim.set(physics, paths, marker, 1, |_, _| Shares::ALL) {
                return false;
            }
        }
        self.number = 0;
        self.sample(physics, paths, window, SAMPLED_DECAYS, random);
        for marker in 0..physics.markers.len() {
            self.aim.set(physics, paths, marker, 1, |_, _| Shares::ALL);
            let photons = 2.0
                * physics.decay_rate_hz(marker, window.start_s)
                * window.duration_s
                * physics.positrons_per_decay[marker];
            self.direct(physics, paths, (marker, photons), window, Keep::All, random, out);
            self.indirect(physics, paths, (marker, photons), window, random, out);
        }
        self.randoms(physics, window, random, out);
        let decays: f64 = (0..physics.markers.len())
            .map(|m| physics.decay_rate_hz(m, window.start_s) * window.duration_s)
            .sum();
        self.sample.thin(physics, decays / window.duration_s, random, out);
        true
    }

    /// Aims at the blocks for a marker's way; `false` where it is too near to one.
    pub fn set_aim(&mut self, physics: &Physics, paths: &MarkerPaths, marker: usize) -> bool {
        self.aim.set(physics, paths, marker, 1, |_, _| Shares::ALL)
    }

    /// Follows whole decays, a share of each marker as its activity.
    pub fn sample(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        window: Window,
        decays: usize,
        random: &mut RandomStream,
    ) {
        let total_hz: f64 =
            (0..physics.markers.len()).map(|m| physics.decay_rate_hz(m, window.start_s)).sum();
        let scanner = physics.detectors.scanner();
        let sample = &mut self.sample;
        sample.lone.clear();
        sample.by_block.clear();
        sample.by_block.resize(scanner.blocks.len(), 0.0);
        sample.decays = decays;
        let (mut singles, mut prompts) = (0, 0);
        for number in 0..decays {
            let mut level = random.random::<f64>() * total_hz;
            let mut marker = 0;
            while marker + 1 < physics.markers.len() {
                level -= physics.decay_rate_hz(marker, window.start_s);
                if level < 0.0 {
                    break;
                }
                marker += 1;
            }
            let after_s = window.duration_s * random.random::<f64>();
            analog::decay(physics, marker, paths.at(marker, after_s), random, &mut self.first);
            self.other_singles.clear();
            let name = (after_s, number as u32, marker);
            analog::read_out(physics, &self.first, name, random, &mut self.other_singles);
            singles += self.other_singles.len();
            for single in &self.other_singles {
                sample.by_block[usize::from(single.block)] += 1.0;
                prompts += usize::from(single.kind == Kind::Prompt);
            }
            if let [lone] = self.other_singles[..] {
                sample.lone.push(lone);
            }
        }
        sample.prompts_per_decay = prompts as f64 / decays as f64;
        sample.singles_per_decay = singles as f64 / decays as f64;
        for block in &mut sample.by_block {
            *block /= decays as f64;
        }
        sample.allowed = 0;
        for (i, a) in sample.lone.iter().enumerate() {
            for b in &sample.lone[..i] {
                sample.allowed += u64::from(scanner.can_coincide(usize::from(a.block), usize::from(b.block)));
            }
        }
    }

    /// Lines with a direct photon, of so many photons of a marker.
    #[expect(
        clippy::too_many_arguments,
        reason = "what one photon is made of; a struct of it would be taken apart at once"
    )]
    pub fn direct(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        (marker, photons): (usize, f64),
        window: Window,
        keep: Keep,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let draws = super::poisson(photons * self.aim.draws_per_photon(), random);
        let reach_m = physics.markers[marker].reach_m();
        for _ in 0..draws {
            let after_s = window.duration_s * random.random::<f64>();
            let place_m = paths.at(marker, after_s);
            let aimed = self.aim.draw(physics, random);
            if !self.aim.may_keep(&aimed, physics, &place_m) {
                continue;
            }
            // Most do not get out, wherever near the marker they start: they spare the draw of where.
            let level = random.random::<f64>();
            if level >= physics.body.most_transmission_511(&place_m, &aimed.point_m, reach_m) {
                continue;
            }
            let from_m = place_m + physics.markers[marker].annihilation_offset_m(random);
            let Some(direction) = Aim::keep(&aimed, physics, &from_m) else { continue };
            if level >= physics.body.transmission_511(&from_m, &direction) {
                continue;
            }
            let photon = Photon::emitted(from_m, direction, ANNIHILATION_EV);
            if !physics.detectors.enters_first(aimed.block, &photon) {
                continue;
            }
            self.first.clear();
            physics.detectors.detect_from(
                aimed.block,
                photon,
                Kind::Annihilation,
                0,
                random,
                &mut self.first,
            );
            self.number = self.number.wrapping_add(1);
            let name = (after_s, self.number, marker);
            self.first_singles.clear();
            analog::read_out(physics, &self.first, name, random, &mut self.first_singles);
            if self.first_singles.is_empty() {
                continue;
            }
            let direct = self.complete(physics, (place_m, from_m, direction), name, keep, random);
            if direct && random.random::<bool>() {
                continue;
            }
            self.take(physics, window, out);
        }
    }

    /// Lines without a direct photon, of so many photons of a marker.
    pub fn indirect(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        (marker, photons): (usize, f64),
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let sets = (2.0 / self.aim.draws_per_photon().max(1e-9)).floor().clamp(1.0, MOST_SETS);
        let draws = super::poisson(photons / sets * physics.body.kept_share_511(), random);
        for _ in 0..draws {
            let after_s = window.duration_s * random.random::<f64>();
            let place_m = paths.at(marker, after_s);
            let from_m = place_m + physics.markers[marker].annihilation_offset_m(random);
            let direction = isotropic(random);
            let mut photon = Photon::emitted(from_m, direction, ANNIHILATION_EV);
            let Some(scatterings) = physics.body.leave_scattered_511(&mut photon, random) else { continue };
            self.first.clear();
            physics.detectors.detect(photon, Kind::Annihilation, scatterings, random, &mut self.first);
            if self.first.as_slice().is_empty() {
                continue;
            }
            for _ in 0..sets as u32 {
                // Each set is a decay of its own, at a time of its own: only the way of this photon is shared.
                self.number = self.number.wrapping_add(1);
                let name = (after_s, self.number, marker);
                self.first_singles.clear();
                analog::read_out(physics, &self.first, name, random, &mut self.first_singles);
                if self.first_singles.is_empty() {
                    continue;
                }
                if self.complete(physics, (place_m, from_m, direction), name, Keep::All, random) {
                    continue;
                }
                let both = self.other_singles.iter().any(|s| s.kind == Kind::Annihilation);
                if both && random.random::<bool>() {
                    continue;
                }
                self.take(physics, window, out);
            }
        }
    }

    /// The other photon and the gammas of a decay, read out; whether the other photon was direct.
    fn complete(
        &mut self,
        physics: &Physics,
        (place_m, from_m, direction): (Vector3<f64>, Vector3<f64>, Vector3<f64>),
        name: (f64, u32, usize),
        keep: Keep,
        random: &mut RandomStream,
    ) -> bool {
        self.others.clear();
        self.other_singles.clear();
        let marker = name.2;
        let source = &physics.markers[marker];
        if !source.isotope.gammas.is_empty() {
            let decay_m = place_m + source.core_offset_m(random);
            analog::prompts(physics, marker, decay_m, random, &mut self.others);
            if keep == Keep::PromptOnly && self.others.as_slice().is_empty() {
                return false;
            }
        }
        let second = opposite(&direction, physics.acollinearity_sigma_rad, random);
        let kind = (ANNIHILATION_EV, Kind::Annihilation);
        analog::follow(physics, from_m, second, kind, random, &mut self.others);
        analog::read_out(physics, &self.others, name, random, &mut self.other_singles);
        self.other_singles.iter().any(|s| s.kind == Kind::Annihilation && s.scatterings == 0)
    }

    /// The decay in hand, where it makes a line.
    fn take(&mut self, physics: &Physics, window: Window, out: &mut Vec<LabelledLine>) {
        let ([a], [b]) = (&self.first_singles[..], &self.other_singles[..]) else { return };
        let scanner = physics.detectors.scanner();
        let apart_s = (a.after_s - b.after_s).abs();
        let summed = self.others.as_slice().iter().any(|hit| hit.block == usize::from(a.block));
        if !summed
            && apart_s < scanner.detection.coincidence_window_s
            && scanner.can_coincide(usize::from(a.block), usize::from(b.block))
        {
            let (a, b) = if b.after_s < a.after_s { (b, a) } else { (a, b) };
            out.push(LabelledLine::of(a, b, window.start_s, window.duration_s));
        }
    }

    /// Random lines from the sample.
    fn randoms(
        &mut self,
        physics: &Physics,
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let decays: f64 = (0..physics.markers.len())
            .map(|m| physics.decay_rate_hz(m, window.start_s) * window.duration_s)
            .sum();
        let count = super::poisson(self.sample.random_lines(physics, decays, window.duration_s), random);
        let lone = &self.sample.lone;
        for _ in 0..count {
            if let Some((a, b)) = draw_pair(physics, lone, lone, random) {
                out.push(random_line(physics, (a, b), window, random));
            }
        }
    }
}

/// Two singles that can fire together; `None` where a thousand draws find none.
pub(super) fn draw_pair(
    physics: &Physics,
    from: &[Single],
    and: &[Single],
    random: &mut RandomStream,
) -> Option<(Single, Single)> {
    let scanner = physics.detectors.scanner();
    for _ in 0..1000 {
        let a = from[random.random_range(0..from.len())];
        let b = and[random.random_range(0..and.len())];
        if a.decay != b.decay && scanner.can_coincide(usize::from(a.block), usize::from(b.block)) {
            return Some((a, b));
        }
    }
    None
}

/// The line of two singles of different decays, at a time of its own.
pub(super) fn random_line(
    physics: &Physics,
    (mut a, mut b): (Single, Single),
    window: Window,
    random: &mut RandomStream,
) -> LabelledLine {
    let apart_s = physics.detectors.scanner().detection.coincidence_window_s * random.random::<f64>();
    a.after_s = window.duration_s * random.random::<f64>();
    b.after_s = a.after_s + apart_s;
    LabelledLine::of(&a, &b, window.start_s, window.duration_s)
}

impl Sample {
    /// Share of pairs of lone singles that can fire together.
    pub fn allowed_share(&self) -> f64 {
        let n = self.lone.len() as f64;
        if n < 2.0 { 0.0 } else { self.allowed as f64 / (0.5 * n * (n - 1.0)) }
    }

    /// Expected random lines of a window with so many decays: two decays lie within `τ` of each other with probability `2 τ / T`.
    pub fn random_lines(&self, physics: &Physics, decays: f64, duration_s: f64) -> f64 {
        let window_s = physics.detectors.scanner().detection.coincidence_window_s;
        let pairs_of_decays = self.decays as f64 * (self.decays as f64 - 1.0) / 2.0;
        self.allowed as f64 / pairs_of_decays * decays * decays / 2.0 * 2.0 * window_s / duration_s
    }

    /// Takes away the lines that a third single or dead time costs.
    pub fn thin(
        &self,
        physics: &Physics,
        decays_hz: f64,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let detection = &physics.detectors.scanner().detection;
        let undisturbed = (-2.0 * decays_hz * self.singles_per_decay * detection.coincidence_window_s).exp();
        let columns = physics.detectors.scanner().grid.columns;
        let alive = |block: u32| {
            1.0 / (1.0 + decays_hz * self.by_block[block as usize] * detection.block_dead_time_s)
        };
        out.retain(|line| {
            let [a, b] = line.crystals.map(|crystal| alive(crystal.x / columns));
            random.random::<f64>() < undisturbed * a * b
        });
    }
}
