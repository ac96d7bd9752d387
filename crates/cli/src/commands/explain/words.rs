//! Numbers in a reader's words: directions of the body, reasons of refusals.

use super::seconds;
use lumenav::report::TrackRow;
use serde::Serialize;

/// Where and along which direction a position was weakest.
#[derive(Clone, Serialize)]
pub struct Weakness {
    /// When, s.
    pub t_s: f64,
    /// One standard deviation along the direction, mm.
    pub sigma_mm: f64,
    /// The direction in the world.
    pub direction_world: [f64; 3],
    /// The direction in words.
    pub direction: &'static str,
    /// The error then, where there is a truth.
    pub error_mm: Option<f64>,
}

impl Weakness {
    /// Of a row; `None` where it holds no such figures.
    pub fn of(row: &TrackRow) -> Option<Self> {
        let get = |name: &str| row.number(name);
        let axis = [get("weakest_x")?, get("weakest_y")?, get("weakest_z")?];
        Some(Self {
            t_s: seconds(row.t_ns),
            sigma_mm: get("weakest_sigma_mm")?,
            direction_world: axis,
            direction: in_words(axis),
            error_mm: get("error_mm"),
        })
    }

    /// In a phrase.
    pub fn text(&self) -> String {
        let error = self.error_mm.map_or(String::new(), |e| format!("; the error then was {e:.2} mm"));
        format!("{}, {:.2} mm (1 sigma) at {:.2} s{error}", self.direction, self.sigma_mm, self.t_s)
    }
}

/// The weakest instant of a stretch.
pub fn weakest(rows: &[&TrackRow], from_s: f64, to_s: f64) -> Option<Weakness> {
    rows.iter()
        .filter(|row| (from_s..=to_s).contains(&seconds(row.t_ns)))
        .filter_map(|row| Weakness::of(row))
        .max_by(|a, b| a.sigma_mm.total_cmp(&b.sigma_mm))
}

/// A direction in the world in a patient's words (RAS: x right, y anterior, z superior).
fn in_words([x, y, z]: [f64; 3]) -> &'static str {
    let axes = [(x.abs(), "left-right (x)"), (y.abs(), "front-back (y)"), (z.abs(), "head-foot (z)")];
    let largest = axes.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    match largest {
        Some((share, words)) if *share > 0.8 => words,
        _ if z.abs() < 0.4 => "oblique in the transverse plane (x and y)",
        _ if y.abs() < 0.4 => "oblique in the coronal plane (x and z)",
        _ if x.abs() < 0.4 => "oblique in the sagittal plane (y and z)",
        _ => "oblique to all axes",
    }
}

/// Why something was refused, after a number: "12 by the gate".
pub fn refusal(reason: &str) -> &str {
    match reason {
        "gate" => "by the gate",
        "too_late" => "because they came too late",
        "front_end" => "without a fix",
        "not_started" => "because the track had not started",
        "contains_prior" => "because they contain the track's own prior",
        "failed" => "because the update failed",
        other => other,
    }
}

/// A reason without its figures, and the one that it ends in, so that equal reasons count together: `3.2 of 48 lines` is `… of … lines`.
pub fn stem_and_number(text: &str) -> (String, Option<f64>) {
    let figure = |word: &str| word.trim_matches(['(', ')', ',', ';', ':']).parse::<f64>().ok();
    let words: Vec<&str> = text.split(' ').collect();
    // `s14` is a name, not a figure.
    let last = words.last().and_then(|word| word.parse::<f64>().ok());
    let kept = if last.is_some() { &words[..words.len() - 1] } else { &words[..] };
    let hidden = |word: &&str| if figure(word).is_some() { without_figure(word) } else { (*word).to_owned() };
    let stem: Vec<String> = kept.iter().map(hidden).collect();
    (stem.join(" "), last)
}

/// `(5.0,` as `(…,`.
fn without_figure(word: &str) -> String {
    let of_figure = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e' | 'E');
    let start = word.find(of_figure).unwrap_or(word.len());
    let end = word.rfind(|c: char| c.is_ascii_digit()).map_or(start, |last| last + 1);
    format!("{}…{}", &word[..start], &word[end..])
}

/// `1 reading`, `2 readings`.
pub fn count(n: u64, one: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_the_number_at_the_end_of_a_reason() {
        let told = |text: &str| stem_and_number(text);
        assert_eq!(told("chi-square per dof 12.5"), ("chi-square per dof".to_owned(), Some(12.5)));
        assert_eq!(told("no source near sensor s1"), ("no source near sensor s1".to_owned(), None));
        assert_eq!(told("all channels lost."), ("all channels lost.".to_owned(), None));
        assert_eq!(told(""), (String::new(), None));
        let few = "3.2 of 48 lines pass the markers; needed: 4";
        assert_eq!(told(few), ("… of … lines pass the markers; needed:".to_owned(), Some(4.0)));
        let vague = "the pose is too uncertain: 6.0 mm, 27 degrees (allowed 5.0 mm, 34 degrees)";
        let hidden = "the pose is too uncertain: … mm, … degrees (allowed … mm, … degrees)";
        assert_eq!(told(vague), (hidden.to_owned(), None));
    }

    #[test]
    fn closed_form_directions_in_words() {
        assert_eq!(in_words([0.1, -0.99, 0.0]), "front-back (y)");
        assert_eq!(in_words([-1.0, 0.0, 0.0]), "left-right (x)");
        assert_eq!(in_words([0.0, 0.7, -0.7]), "oblique in the sagittal plane (y and z)");
        assert_eq!(in_words([0.577, 0.577, 0.577]), "oblique to all axes");
    }
}
