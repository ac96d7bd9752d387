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

/// A reason and the number it ends in, so that equal reasons count together.
pub fn stem_and_number(text: &str) -> (&str, Option<f64>) {
    let stem = text.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
    match text[stem.len()..].parse() {
        // `s14` is a name, not a figure.
        Ok(number) if stem.ends_with(' ') => (stem.trim_end(), Some(number)),
        _ => (text, None),
    }
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
        assert_eq!(stem_and_number("chi-square per dof 12.5"), ("chi-square per dof", Some(12.5)));
        assert_eq!(stem_and_number("no source near sensor s1"), ("no source near sensor s1", None));
        assert_eq!(stem_and_number("all channels lost."), ("all channels lost.", None));
        assert_eq!(stem_and_number(""), ("", None));
    }

    #[test]
    fn closed_form_directions_in_words() {
        assert_eq!(in_words([0.1, -0.99, 0.0]), "front-back (y)");
        assert_eq!(in_words([-1.0, 0.0, 0.0]), "left-right (x)");
        assert_eq!(in_words([0.0, 0.7, -0.7]), "oblique in the sagittal plane (y and z)");
        assert_eq!(in_words([0.577, 0.577, 0.577]), "oblique to all axes");
    }
}
