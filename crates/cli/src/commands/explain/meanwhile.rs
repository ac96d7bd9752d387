//! What happened in the world while a track had a gap, refused readings or was furthest off: contractions at the capsule, faults,
//! disturbances of the sensors. Coincidence in time, not proof.

use super::Happening;
use serde::Serialize;

/// What begins or ends so long before or after, s, still counts: a filter needs some readings to go wrong and to recover.
const NEAR_S: f64 = 1.0;

/// Two things at one time.
#[derive(Serialize)]
pub struct Coincidence {
    /// What went wrong: `gap`, `refusals`, `largest error`.
    pub during: &'static str,
    /// From when to when it went wrong.
    pub from_s: f64,
    pub to_s: f64,
    /// What happened meanwhile.
    pub happened: String,
}

impl Coincidence {
    /// With its time, for sorting.
    pub fn line(&self) -> (f64, String) {
        (self.from_s, format!("{:8.2} s  meanwhile ({}): {}", self.from_s, self.during, self.happened))
    }
}

/// What of the world lasted into a stretch in which something went wrong.
pub(super) fn coincidences(
    world: &[Happening],
    during: &'static str,
    from_s: f64,
    to_s: f64,
) -> impl Iterator<Item = Coincidence> {
    let met =
        move |h: &&Happening| h.to_s > h.from_s && h.to_s + NEAR_S >= from_s && h.from_s - NEAR_S <= to_s;
    world.iter().filter(met).map(move |h| Coincidence {
        during,
        from_s,
        to_s,
        happened: format!("{} ({:.1} to {:.1} s)", h.text, h.from_s, h.to_s),
    })
}

/// The stretches in which scheduled contractions were at the capsule, from the world's notes (time and text) of a run that ended at
/// `end_s`.
pub(super) fn passages<'n>(notes: impl Iterator<Item = (f64, &'n str)>, end_s: f64) -> Vec<Happening> {
    let mut open: Vec<(String, f64)> = Vec::new();
    let mut all = Vec::new();
    let mut close = |wave: String, from_s: f64, to_s: f64| {
        all.push(Happening {
            from_s,
            to_s,
            source: "wave".to_owned(),
            text: format!("{wave} at the capsule"),
        });
    };
    for (at_s, text) in notes.filter(|(_, text)| text.starts_with("wave of ")) {
        if let Some((wave, _)) = text.split_once(" reaches the capsule") {
            open.push((wave.to_owned(), at_s));
        } else if let Some((wave, _)) = text.split_once(" leaves the capsule") {
            let wave = wave.trim_end_matches(" ends and");
            if let Some(i) = open.iter().position(|(of, _)| of == wave) {
                let (wave, from_s) = open.remove(i);
                close(wave, from_s, at_s);
            }
        }
    }
    open.into_iter().for_each(|(wave, from_s)| close(wave, from_s, end_s));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_passages_and_what_they_meet() {
        let notes = [
            (1.0, "entered transverse at 300 mm"),
            (2.0, "wave of 0.0 s starts at 0 mm, 60 mm oral of the capsule"),
            (3.0, "wave of 0.0 s reaches the capsule at 60 mm"),
            (4.0, "wave of 5.0 s reaches the capsule at 70 mm"),
            (7.5, "wave of 0.0 s ends and leaves the capsule at 200 mm"),
        ];
        let all = passages(notes.into_iter(), 12.0);
        let spans: Vec<(f64, f64)> = all.iter().map(|h| (h.from_s, h.to_s)).collect();
        assert_eq!(spans, [(3.0, 7.5), (4.0, 12.0)]);
        let met = |from, to| coincidences(&all, "gap", from, to).map(|c| c.happened).collect::<Vec<_>>();
        assert_eq!(
            met(8.0, 9.0),
            ["wave of 0.0 s at the capsule (3.0 to 7.5 s)", "wave of 5.0 s at the capsule (4.0 to 12.0 s)"]
        );
        assert_eq!(met(9.0, 9.5).len(), 1);
        assert!(met(0.0, 1.5).is_empty());
    }
}
