//! From singles to lines.
//!
//! Singles are sorted by time. The first that is not yet used opens the coincidence window; where exactly one more falls into it and
//! the two blocks can fire together the two make a line, where more do all of them are dropped (multiples). A block with dead time
//! takes no single for so long after the last one that it took (non-paralyzable; deposits outside the energy window are left out).
//! Randoms are the pairs of different decays: nothing is added by hand.

use super::detectors::{Kind, Single};
use crate::line::Line;
use crate::scanner::{CrystalIndex, Scanner};

/// Where a line comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Both annihilation photons of one decay, neither scattered in the body.
    True,
    /// Both annihilation photons of one decay, one or both scattered in the body.
    Scattered,
    /// One decay, with a prompt gamma as one of the two.
    Prompt,
    /// Two decays.
    Random,
}

/// What only the world knows about a line. For evaluation and recording; never for an estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Label {
    /// Where it comes from.
    pub origin: Origin,
    /// Which of the two photons is a prompt gamma (of a random line, too).
    pub prompt: [bool; 2],
    /// How often each photon scattered in the body.
    pub scatterings: [u8; 2],
    /// Marker of each photon.
    pub markers: [u8; 2],
}

impl Label {
    /// The label of two singles.
    pub fn of(a: &Single, b: &Single) -> Self {
        let prompt = [a.kind == Kind::Prompt, b.kind == Kind::Prompt];
        let scatterings = [a.scatterings, b.scatterings];
        let origin = if a.decay != b.decay {
            Origin::Random
        } else if prompt[0] || prompt[1] {
            Origin::Prompt
        } else if scatterings == [0, 0] {
            Origin::True
        } else {
            Origin::Scattered
        };
        Self { origin, prompt, scatterings, markers: [a.marker, b.marker] }
    }

    /// Whether one of the two photons is a prompt gamma.
    pub fn has_prompt(&self) -> bool {
        self.prompt[0] || self.prompt[1]
    }
}

/// A line with its crystals and its label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelledLine {
    /// The line.
    pub line: Line,
    /// The crystals that fired, in the order of its ends.
    pub crystals: [CrystalIndex; 2],
    /// Where it comes from.
    pub label: Label,
}

impl LabelledLine {
    /// The line of two singles of a window.
    pub fn of(a: &Single, b: &Single, start_s: f64, duration_s: f64) -> Self {
        // Smeared by nanoseconds, a line at the window's border would fall out of it.
        let after_s = a.after_s.min(b.after_s).clamp(0.0, duration_s * (1.0 - 1e-12));
        Self {
            line: Line { t_s: start_s + after_s, ends_world_m: [a.end_world_m, b.end_world_m] },
            crystals: [a.crystal, b.crystal],
            label: Label::of(a, b),
        }
    }
}

/// Sorts singles by time; equal times by decay and crystal, so that the order never depends on how they were made.
pub fn sort(singles: &mut [Single]) {
    singles.sort_unstable_by(|a, b| {
        a.after_s.total_cmp(&b.after_s).then(a.decay.cmp(&b.decay)).then(a.crystal.cmp(&b.crystal))
    });
}

/// Drops singles of blind blocks. `free_at_s` is room for one time per block.
pub fn apply_dead_time(scanner: &Scanner, singles: &mut Vec<Single>, free_at_s: &mut Vec<f64>) {
    let dead_s = scanner.detection.block_dead_time_s;
    if dead_s == 0.0 {
        return;
    }
    free_at_s.clear();
    free_at_s.resize(scanner.blocks.len(), f64::NEG_INFINITY);
    singles.retain(|single| {
        let free = &mut free_at_s[usize::from(single.block)];
        let taken = single.after_s >= *free;
        if taken {
            *free = single.after_s + dead_s;
        }
        taken
    });
}

/// Hands every pair of sorted singles that makes a line to `take`.
pub fn pair(scanner: &Scanner, singles: &[Single], mut take: impl FnMut(&Single, &Single)) {
    let window_s = scanner.detection.coincidence_window_s;
    let mut first = 0;
    while first < singles.len() {
        let end_s = singles[first].after_s + window_s;
        let mut next = first + 1;
        while next < singles.len() && singles[next].after_s < end_s {
            next += 1;
        }
        if next - first == 2 {
            let (a, b) = (&singles[first], &singles[first + 1]);
            if scanner.can_coincide(usize::from(a.block), usize::from(b.block)) {
                take(a, b);
            }
        }
        first = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::Node;
    use nalgebra::Vector3;
    use std::path::Path;

    fn reduced() -> Scanner {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/reduced.toml");
        Scanner::from_node(&Node::open(&file).unwrap()).unwrap()
    }

    fn single(after_ns: f64, block: u16, decay: u32) -> Single {
        Single {
            after_s: after_ns * 1e-9,
            decay,
            marker: 0,
            kind: Kind::Annihilation,
            scatterings: 0,
            block,
            crystal: CrystalIndex { x: u32::from(block) * 38, z: 0 },
            end_world_m: Vector3::zeros(),
        }
    }

    fn pairs(scanner: &Scanner, singles: &[Single]) -> Vec<(u32, u32)> {
        let mut found = Vec::new();
        pair(scanner, singles, |a, b| found.push((a.decay, b.decay)));
        found
    }

    #[test]
    fn closed_form_pairs_multiples_and_forbidden_blocks() {
        let scanner = reduced();
        // A pair; a pair of blocks that cannot fire together; a triple; two that are too far apart.
        let singles = [
            single(0.0, 0, 1),
            single(7.4, 2, 1),
            single(100.0, 0, 2),
            single(101.0, 1, 2),
            single(200.0, 0, 3),
            single(203.0, 2, 3),
            single(206.0, 1, 4),
            single(300.0, 1, 5),
            single(307.6, 3, 5),
        ];
        assert_eq!(pairs(&scanner, &singles), vec![(1, 1)]);
    }

    #[test]
    fn closed_form_dead_time_is_non_paralyzable() {
        let mut scanner = reduced();
        scanner.detection.block_dead_time_s = 10e-9;
        let mut singles = vec![
            single(0.0, 0, 1),
            single(1.0, 2, 1),
            single(9.0, 0, 2),
            single(10.5, 0, 3),
            single(11.5, 2, 3),
        ];
        apply_dead_time(&scanner, &mut singles, &mut Vec::new());
        assert_eq!(singles.iter().map(|s| s.decay).collect::<Vec<_>>(), vec![1, 1, 3, 3]);
    }

    #[test]
    fn closed_form_labels() {
        let (mut a, mut b) = (single(0.0, 0, 1), single(1.0, 2, 1));
        assert_eq!(Label::of(&a, &b).origin, Origin::True);
        b.scatterings = 2;
        assert_eq!(Label::of(&a, &b).origin, Origin::Scattered);
        a.kind = Kind::Prompt;
        assert_eq!(Label::of(&a, &b).origin, Origin::Prompt);
        b.decay = 7;
        let label = Label::of(&a, &b);
        assert!(label.origin == Origin::Random && label.has_prompt());
    }
}
