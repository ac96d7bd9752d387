//! Ranges and ticks: 1, 2 and 5 times powers of ten.

use crate::figure::{Axis, Scale};
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// An axis made ready: values are mapped (log10 on a logarithmic axis), ticks are mapped values with their text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ready {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) ticks: Vec<f64>,
    labels: Vec<String>,
    scale: Scale,
}

/// Share of the range that is left free at either end.
const AIR: f64 = 0.04;

impl Ready {
    /// An axis that shows `values`. `from_zero`: bars stand on zero. `None` where no value can be shown.
    pub(crate) fn new(axis: &Axis, values: &[f64], from_zero: bool, wanted: usize) -> Option<Self> {
        let map = |v: f64| mapped(axis.scale, v);
        let mut shown: Vec<f64> = values.iter().filter_map(|v| map(*v)).collect();
        if shown.is_empty() {
            return None;
        }
        if !axis.categories.is_empty() {
            let count = axis.categories.len();
            return Some(Self {
                low: -0.5,
                high: count as f64 - 0.5,
                ticks: (0..count).map(|k| k as f64).collect(),
                labels: axis.categories.clone(),
                scale: Scale::Linear,
            });
        }
        shown.extend(axis.at_least.into_iter().flatten().filter_map(map));
        let zero = from_zero && axis.scale == Scale::Linear;
        if zero {
            shown.push(0.0);
        }
        let (mut low, mut high) =
            shown.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        if high - low < 1e-12 * high.abs().max(1e-9) {
            // One value only: a range around it.
            let half = if axis.scale == Scale::Logarithmic { 0.5 } else { 0.5 * high.abs().max(1.0) };
            (low, high) = (low - half, high + half);
        }
        let air = AIR * (high - low);
        // A limit that was asked for is the edge itself, and so is zero under bars.
        let asked = axis.at_least.map(|ends| ends.map(|v| map(v).unwrap_or(f64::NAN)));
        let edge = |v: f64, which: usize| asked.is_some_and(|ends| ends[which] == v) || (zero && v == 0.0);
        let (low, high) =
            (if edge(low, 0) { low } else { low - air }, if edge(high, 1) { high } else { high + air });
        let (ticks, labels) = match axis.scale {
            Scale::Linear => linear_ticks(low, high, wanted),
            Scale::Logarithmic => logarithmic_ticks(low, high, wanted),
        };
        Some(Self { low, high, ticks, labels, scale: axis.scale })
    }

    /// A value as the axis counts; `None` where it cannot be shown.
    pub(crate) fn place(&self, value: f64) -> Option<f64> {
        mapped(self.scale, value)
    }

    /// The text of the tick at a mapped value.
    pub(crate) fn label(&self, at: f64) -> String {
        let close = |tick: &f64| (tick - at).abs() <= 1e-9 * (self.high - self.low);
        self.ticks.iter().position(close).and_then(|k| self.labels.get(k).cloned()).unwrap_or_default()
    }

    /// Letters of the longest label.
    pub(crate) fn longest_label(&self) -> usize {
        self.labels.iter().map(|l| l.chars().count()).max().unwrap_or(0)
    }
}

/// What plotters asks of an axis.
impl Ranged for Ready {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.low) / (self.high - self.low);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Ready {
    fn format_ext(&self, value: &f64) -> String {
        self.label(*value)
    }
}

fn mapped(scale: Scale, value: f64) -> Option<f64> {
    let mapped = match scale {
        Scale::Linear => value,
        Scale::Logarithmic if value > 0.0 => value.log10(),
        Scale::Logarithmic => return None,
    };
    mapped.is_finite().then_some(mapped)
}

/// Multiples of the finest step of 1, 2 or 5 times a power of ten that gives at most `wanted` intervals.
fn linear_ticks(low: f64, high: f64, wanted: usize) -> (Vec<f64>, Vec<String>) {
    let rough = (high - low) / wanted.max(1) as f64;
    let power = rough.log10().floor();
    let steps = [1.0, 2.0, 5.0, 10.0].map(|m| m * 10_f64.powf(power));
    let step = steps.into_iter().find(|s| *s >= rough * (1.0 - 1e-9)).unwrap_or(steps[3]);
    let decimals = (-step.log10() + 1e-9).floor().max(0.0);
    let decimals = if step < 1.0 { decimals.max((-step.log10() - 1e-9).ceil()) as usize } else { 0 };
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    let ticks: Vec<f64> = (first..=last).map(|k| k as f64 * step).collect();
    let labels = ticks.iter().map(|t| number(*t, decimals)).collect();
    (ticks, labels)
}

/// 1, 2 and 5 of each decade; all nine where those are fewer than three, 1 and 3 or the decades alone where they are many.
fn logarithmic_ticks(low: f64, high: f64, wanted: usize) -> (Vec<f64>, Vec<String>) {
    let decades = (low.floor() as i32)..=(high.ceil() as i32);
    let of = |multiples: &'static [u8]| -> Vec<(f64, i32, u8)> {
        let all = decades.clone().flat_map(|d| multiples.iter().map(move |m| (d, *m)));
        all.map(|(d, m)| (f64::from(d) + f64::from(m).log10(), d, m))
            .filter(|(at, ..)| *at >= low - 1e-9 && *at <= high + 1e-9)
            .collect()
    };
    let all = [of(&[1, 2, 5]), of(&[1, 2, 3, 4, 5, 6, 7, 8, 9]), of(&[1, 3]), of(&[1])];
    let fits = |ticks: &Vec<_>| (3..=wanted + 2).contains(&ticks.len());
    let chosen = all.into_iter().find(fits).unwrap_or_else(|| of(&[1]));
    let text = |decade: i32, multiple: u8| {
        if (-3..=5).contains(&decade) {
            let decimals = if decade < 0 { decade.unsigned_abs() as usize } else { 0 };
            number(f64::from(multiple) * 10_f64.powi(decade), decimals)
        } else {
            format!("{multiple}e{decade}")
        }
    };
    (chosen.iter().map(|c| c.0).collect(), chosen.iter().map(|(_, d, m)| text(*d, *m)).collect())
}

/// With a true minus sign and no negative zero.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let is_zero = text.chars().all(|c| c == '0' || c == '.');
    if value < 0.0 && !is_zero { format!("\u{2212}{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ready: &Ready) -> Vec<String> {
        ready.ticks.iter().map(|t| ready.label(*t)).collect()
    }

    #[test]
    fn closed_form_ticks_as_people_choose_them() {
        let axis = Axis::linear("x").at_least(0.0, 1.0);
        let ready = Ready::new(&axis, &[0.3], false, 5).unwrap();
        assert_eq!(labels(&ready), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        let ready = Ready::new(&Axis::linear("x"), &[-57.0, 57.0], false, 5).unwrap();
        assert_eq!(labels(&ready), ["\u{2212}50", "0", "50"]);
        let ready = Ready::new(&Axis::linear("x"), &[0.001, 0.0024], true, 5).unwrap();
        assert_eq!(labels(&ready), ["0.0000", "0.0005", "0.0010", "0.0015", "0.0020"]);
        let ready = Ready::new(&Axis::logarithmic("x"), &[50.0, 2500.0], false, 6).unwrap();
        assert_eq!(labels(&ready), ["50", "100", "200", "500", "1000", "2000"]);
        let ready = Ready::new(&Axis::logarithmic("x"), &[1e-7, 1e-5], false, 4).unwrap();
        assert_eq!(labels(&ready), ["1e-7", "3e-7", "1e-6", "3e-6", "1e-5"]);
    }

    #[test]
    fn law_every_value_is_inside_and_bars_stand_on_zero() {
        let values = [3.0, 47.2, 12.0, f64::NAN];
        for from_zero in [false, true] {
            let ready = Ready::new(&Axis::linear("x").at_least(5.0, 20.0), &values, from_zero, 5).unwrap();
            assert!(ready.low <= 3.0 && ready.high >= 47.2);
            assert_eq!(from_zero, ready.low == 0.0);
        }
        assert!(Ready::new(&Axis::logarithmic("x"), &[0.0, -1.0], false, 5).is_none());
        let one = Ready::new(&Axis::linear("x"), &[7.0], false, 5).unwrap();
        assert!(one.low < 7.0 && one.high > 7.0 && !one.ticks.is_empty());
    }
}
