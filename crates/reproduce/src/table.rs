//! The table that a reproduction ends in, as JSON (the contract that scripts rely on) and as cells of text.

use crate::verdict::{Goal, Sense, Tolerance, Verdict, judge};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the JSON.
pub const SCHEMA: u32 = 1;

/// A drawn figure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFigure {
    /// What it is called behind the reproduction's own name; empty for the only one.
    pub name: String,
    /// The drawing.
    pub svg: String,
}

/// What was published, what came out here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Version of this format.
    pub schema: u32,
    /// `<publication>/<table>`.
    pub id: String,
    /// Publication and number of the table or figure.
    pub source: String,
    /// The seeds; the estimators were not tuned on them.
    pub seeds: Vec<u64>,
    /// What it was made with, in the order of the reader's questions.
    pub settings: Vec<(String, String)>,
    /// A row per published number.
    pub rows: Vec<Row>,
    /// What a reader must know beside the rows.
    pub notes: Vec<String>,
    /// The figures, written beside the JSON.
    #[serde(skip)]
    pub figures: Vec<NamedFigure>,
}

impl Table {
    /// The head of a table.
    pub fn new(id: &str, source: &str, seeds: &[u64]) -> Self {
        Self {
            schema: SCHEMA,
            id: id.to_owned(),
            source: source.to_owned(),
            seeds: seeds.to_vec(),
            settings: Vec::new(),
            rows: Vec::new(),
            notes: Vec::new(),
            figures: Vec::new(),
        }
    }

    /// Notes a setting.
    pub fn set(&mut self, name: &str, value: impl Into<String>) {
        self.settings.push((name.to_owned(), value.into()));
    }

    /// Notes what a reader must know.
    pub fn note(&mut self, text: impl Into<String>) {
        self.notes.push(text.into());
    }

    /// Names of the estimators of all rows, sorted.
    pub fn estimators(&self) -> Vec<String> {
        let mut names: Vec<String> = self.rows.iter().flat_map(|row| row.ours.keys().cloned()).collect();
        names.sort();
        names.dedup();
        names
    }

    /// Heads of the columns of [`Self::cells`].
    pub fn head(&self) -> Vec<String> {
        let fixed = |name: &str| name.to_owned();
        let mut head = vec![fixed("quantity"), fixed("unit"), fixed("published")];
        head.extend(self.estimators());
        head.extend([fixed("tolerance"), fixed("verdict")]);
        head
    }

    /// The rows as text, for whoever draws tables.
    pub fn cells(&self) -> Vec<Vec<String>> {
        let estimators = self.estimators();
        let cell = |value: Option<f64>| value.filter(|v| v.is_finite()).map_or("-".to_owned(), significant);
        let one = |row: &Row| {
            let is_claim = matches!(row.verdict, Verdict::Holds | Verdict::DoesNotHold);
            let sign = match row.sense {
                Sense::LowerIsBetter if is_claim => "<= ",
                Sense::HigherIsBetter if is_claim => ">= ",
                _ => "",
            };
            let published = format!("{sign}{}", cell(row.published));
            let mut cells = vec![row.quantity.clone(), row.unit.clone(), published];
            cells.extend(estimators.iter().map(|name| cell(row.ours.get(name).copied().flatten())));
            let tolerance = row.tolerance.filter(|_| sign.is_empty());
            cells.push(tolerance.map_or("-".to_owned(), |t| t.text(&row.unit)));
            let goal = row.goal.as_ref().map_or("", |g| if g.met { ", goal met" } else { ", goal missed" });
            cells.push(format!("{}{goal}", row.verdict));
            cells
        };
        self.rows.iter().map(one).collect()
    }

    /// How many rows got each verdict, in words.
    pub fn tally(&self) -> String {
        let all = [
            Verdict::Reproduced,
            Verdict::Better,
            Verdict::Differs,
            Verdict::Holds,
            Verdict::DoesNotHold,
            Verdict::NotComparable,
        ];
        let counted = all.map(|v| (v, self.rows.iter().filter(|row| row.verdict == v).count()));
        let words: Vec<String> =
            counted.iter().filter(|(_, n)| *n > 0).map(|(v, n)| format!("{n} {v}")).collect();
        let goals: Vec<bool> = self.rows.iter().filter_map(|row| row.goal.as_ref().map(|g| g.met)).collect();
        let met = goals.iter().filter(|met| **met).count();
        let goals =
            if goals.is_empty() { String::new() } else { format!("; {met} of {} goals met", goals.len()) };
        format!("{} rows: {}{goals}", self.rows.len(), words.join(", "))
    }
}

/// Four significant digits, whole numbers whole.
fn significant(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude >= 1000.0 || value.fract() == 0.0 {
        return format!("{value:.0}");
    }
    let before = if magnitude < 1.0 { 1 } else { magnitude.log10().floor() as i32 + 1 };
    format!("{value:.*}", usize::try_from(4 - before).unwrap_or(0))
}

/// One published number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it is.
    pub quantity: String,
    /// Its unit; empty for counts.
    pub unit: String,
    /// As published; absent where the source gives none.
    pub published: Option<f64>,
    /// Ours per estimator (or per way of counting): the mean of the seeds, or their sum where the quantity says so.
    pub ours: BTreeMap<String, Option<f64>>,
    /// Ours per estimator and seed, in the order of the seeds; absent where it does not depend on seeds.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub per_seed: BTreeMap<String, Vec<Option<f64>>>,
    /// The estimator that the verdict is about; absent where there is one only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judged: Option<String>,
    /// How far ours may be from the published number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<Tolerance>,
    /// Which side is the good one.
    pub sense: Sense,
    /// The verdict.
    pub verdict: Verdict,
    /// The verdict for each of ours.
    pub verdicts: BTreeMap<String, Verdict>,
    /// Why, in words.
    pub why: String,
    /// What this project wants of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<Goal>,
}

impl Row {
    /// A row with what was published; to be filled and then judged.
    pub fn new(quantity: impl Into<String>, unit: &str, published: Option<f64>) -> Self {
        Self {
            quantity: quantity.into(),
            unit: unit.to_owned(),
            published,
            ours: BTreeMap::new(),
            per_seed: BTreeMap::new(),
            judged: None,
            tolerance: None,
            sense: Sense::Match,
            verdict: Verdict::NotComparable,
            verdicts: BTreeMap::new(),
            why: String::new(),
            goal: None,
        }
    }

    /// A value of ours that does not depend on seeds.
    pub fn ours(mut self, name: &str, value: f64) -> Self {
        self.ours.insert(name.to_owned(), finite(value));
        self
    }

    /// A value of ours per seed; the table shows the mean.
    pub fn ours_mean(mut self, name: &str, per_seed: &[f64]) -> Self {
        let mean = per_seed.iter().sum::<f64>() / per_seed.len() as f64;
        self.ours.insert(name.to_owned(), finite(mean));
        self.per_seed.insert(name.to_owned(), per_seed.iter().map(|v| finite(*v)).collect());
        self
    }

    /// A value of ours per seed; the table shows the worst, which is the largest.
    pub fn ours_worst(mut self, name: &str, per_seed: &[f64]) -> Self {
        // A seed without a number is worse than any number.
        let known = per_seed.iter().all(|v| v.is_finite());
        let worst = if known { per_seed.iter().copied().fold(f64::NEG_INFINITY, f64::max) } else { f64::NAN };
        self.ours.insert(name.to_owned(), finite(worst));
        self.per_seed.insert(name.to_owned(), per_seed.iter().map(|v| finite(*v)).collect());
        self
    }

    /// Wanted of one estimator.
    pub fn goal(mut self, of: &str, at_most: f64) -> Self {
        let met = self.ours.get(of).copied().flatten().is_some_and(|v| v <= at_most);
        self.goal = Some(Goal { of: of.to_owned(), at_most, met });
        self
    }

    /// Judges `name` of ours by `tolerance`; `why` explains what the numbers do not.
    pub fn judged(mut self, name: &str, sense: Sense, tolerance: Tolerance, why: &str) -> Self {
        self.sense = sense;
        self.tolerance = Some(tolerance);
        let of = |ours: &Option<f64>| judge(self.published, *ours, tolerance, sense);
        self.verdicts = self.ours.iter().map(|(name, ours)| (name.clone(), of(ours))).collect();
        self.verdict = self.verdicts.get(name).copied().unwrap_or(Verdict::NotComparable);
        self.judged = (self.ours.len() > 1).then(|| name.to_owned());
        self.why = match (self.published, self.ours.get(name).copied().flatten()) {
            (Some(published), Some(ours)) => in_words(name, ours, published, tolerance, &self.unit),
            (None, _) => "the source gives no number".to_owned(),
            (_, None) => format!("{name} gave no number"),
        };
        self.add_why(why);
        self
    }

    /// As [`Self::judged`] for a claim: true or not.
    pub fn claimed(self, name: &str, sense: Sense, tolerance: Tolerance, why: &str) -> Self {
        let mut row = self.judged(name, sense, tolerance, "");
        let claim = |verdict: Verdict| match verdict {
            Verdict::Reproduced | Verdict::Better => Verdict::Holds,
            Verdict::Differs => Verdict::DoesNotHold,
            other => other,
        };
        row.verdict = claim(row.verdict);
        row.verdicts.values_mut().for_each(|verdict| *verdict = claim(*verdict));
        if let (Some(published), Some(ours)) = (row.published, row.ours.get(name).copied().flatten()) {
            let asked = match sense {
                Sense::LowerIsBetter => "at most ",
                Sense::HigherIsBetter => "at least ",
                Sense::Match => "",
            };
            let (ours, published) = (significant(ours), significant(published));
            row.why = format!("{ours} {} where {asked}{published} is claimed", row.unit).replace("  ", " ");
        }
        row.add_why(why);
        row
    }

    /// Not to be compared, and why.
    pub fn not_comparable(mut self, why: &str) -> Self {
        self.verdict = Verdict::NotComparable;
        self.verdicts = self.ours.keys().map(|name| (name.clone(), Verdict::NotComparable)).collect();
        self.add_why(why);
        self
    }

    fn add_why(&mut self, why: &str) {
        if !why.is_empty() {
            let so_far = std::mem::take(&mut self.why);
            self.why = if so_far.is_empty() { why.to_owned() } else { format!("{so_far}; {why}") };
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// `mixture 0.29 against 0.36 mm, 19.4 % lower (tolerance 10 %)`.
fn in_words(name: &str, ours: f64, published: f64, tolerance: Tolerance, unit: &str) -> String {
    let apart = ours - published;
    let direction = if apart < 0.0 { "lower" } else { "higher" };
    let space = if unit.is_empty() { "" } else { " " };
    let by = if apart == 0.0 {
        "equal".to_owned()
    } else if published == 0.0 || matches!(tolerance, Tolerance::Absolute(_)) {
        format!("{}{space}{unit} {direction}", significant(apart.abs()))
    } else {
        format!("{:.1} % {direction}", 100.0 * apart.abs() / published.abs())
    };
    let (ours, published) = (significant(ours), significant(published));
    format!("{name} {ours} against {published}{space}{unit}, {by} (tolerance {})", tolerance.text(unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> Row {
        Row::new("mean marker error at 284 lines", "mm", Some(0.36))
            .ours_mean("mixture", &[0.29, 0.30, 0.28])
            .ours_mean("fcm", &[0.7, 0.8, 0.75])
            .goal("mixture", 0.32)
            .judged("mixture", Sense::LowerIsBetter, Tolerance::Relative(0.1), "")
    }

    #[test]
    fn law_json_keeps_the_contract() {
        let mut table = Table::new("than2015/few-lines", "than2015, table 4.3", &[1, 2, 3]);
        table.set("process noise", "30 mm/s^2");
        table.rows.push(row());
        let json = serde_json::to_value(&table).unwrap();
        assert_eq!(json["schema"], 1);
        assert_eq!(json["id"], "than2015/few-lines");
        assert_eq!(json["seeds"], serde_json::json!([1, 2, 3]));
        let first = &json["rows"][0];
        assert_eq!(first["quantity"], "mean marker error at 284 lines");
        assert_eq!((&first["unit"], &first["published"]), (&"mm".into(), &0.36.into()));
        assert!((first["ours"]["mixture"].as_f64().unwrap() - 0.29).abs() < 1e-12);
        assert_eq!(first["verdict"], "better");
        assert_eq!(first["why"], "mixture 0.290 against 0.360 mm, 19.4 % lower (tolerance 10 %)");
        assert_eq!(first["verdicts"]["fcm"], "differs");
        assert_eq!(first["goal"]["met"], true);
        let back: Table = serde_json::from_value(json).unwrap();
        assert_eq!(back, table);
    }

    #[test]
    fn law_a_seed_without_a_number_is_not_hidden_by_the_others() {
        let row = Row::new("failures", "", Some(0.0))
            .ours_worst("mixture", &[0.0, f64::NAN, 1.0])
            .goal("mixture", 2.0)
            .judged("mixture", Sense::LowerIsBetter, Tolerance::Absolute(3.0), "");
        assert_eq!(row.verdict, Verdict::NotComparable);
        assert_eq!(row.why, "mixture gave no number");
        assert!(!row.goal.unwrap().met);
        assert_eq!(row.per_seed["mixture"], [Some(0.0), None, Some(1.0)]);
    }

    #[test]
    fn closed_form_cells_and_tally() {
        let mut table = Table::new("a/b", "source", &[1]);
        table.rows =
            vec![row(), Row::new("angle", "deg", None).ours("mixture", 1.84).not_comparable("other frame")];
        assert_eq!(table.head(), ["quantity", "unit", "published", "fcm", "mixture", "tolerance", "verdict"]);
        let cells = table.cells();
        assert_eq!(cells[0][2..], ["0.360", "0.750", "0.290", "10 %", "better, goal met"]);
        assert_eq!(cells[1], ["angle", "deg", "-", "-", "1.840", "-", "not comparable"]);
        assert_eq!(table.tally(), "2 rows: 1 better, 1 not comparable; 1 of 1 goals met");
        assert_eq!([2410.4, 73.12, 54.0, 0.0].map(significant), ["2410", "73.12", "54", "0"]);
    }
}
