//! What a figure's SVG holds.

use lumenav_figures::{Axis, Figure, FigureError, Panel, Series};

fn count(svg: &str, what: &str) -> usize {
    svg.matches(what).count()
}

fn axes() -> Panel {
    Panel::new(Axis::linear("time (s)"), Axis::logarithmic("error (mm)"))
}

#[test]
fn law_equal_figures_are_equal_bytes_and_ask_for_no_font_file() {
    let figure = || {
        let series = Series::ours(0, "mixture").points_with_bars(&[(0.0, 0.3, 0.1), (1.0, 0.4, 0.1)]);
        Figure::grid(vec![axes().with(series.clone()).titled("a"), axes().with(series)], 2).to_svg()
    };
    let svg = figure().unwrap();
    assert_eq!(svg, figure().unwrap());
    assert!(svg.starts_with("<svg width=\"680\" height=\"250\" viewBox=\"0 0 5440 2000\""));
    assert!(svg.trim_end().ends_with("</svg>"));
    assert!(!svg.contains("font-face") && !svg.contains("href"));
}

#[test]
fn law_text_with_signs_of_xml_stays_text() {
    let title = "a < b & \"c\" > d";
    let svg = Figure::of(axes().titled(title).with(Series::ours(0, "s").points(&[(1.0, 1.0)]))).to_svg();
    let svg = svg.unwrap();
    assert!(!svg.contains(title));
    assert!(svg.contains("a &lt; b &amp; "), "{svg}");
}

#[test]
fn closed_form_a_failed_window_leaves_a_gap() {
    let curve = |ys: &[f64]| {
        let points: Vec<_> = ys.iter().enumerate().map(|(k, y)| (k as f64, *y)).collect();
        let svg = Figure::of(axes().with(Series::ours(0, "s").line(0).points(&points))).to_svg().unwrap();
        count(&svg, "stroke=\"#0072B2\"")
    };
    assert_eq!(curve(&[1.0, 2.0, 3.0, 2.0, 1.0]), 1);
    assert_eq!(curve(&[1.0, 2.0, f64::NAN, 2.0, 1.0]), 2);
    // Zero has no place on a logarithmic axis.
    assert_eq!(curve(&[1.0, 2.0, 0.0, 2.0, 1.0]), 2);
}

#[test]
fn closed_form_series_of_one_name_share_a_line_of_the_legend() {
    let one = |name: &str, k| Series::ours(k, name).points(&[(0.0, 1.0), (1.0, 2.0)]);
    let panel = || axes().with(one("mixture", 0)).with(one("rigid", 1));
    let svg = Figure::grid(vec![panel(), panel()], 2).to_svg().unwrap();
    assert_eq!((count(&svg, "\nmixture\n"), count(&svg, "\nrigid\n")), (1, 1));
    // A single name needs no legend.
    let alone = Figure::of(axes().with(one("mixture", 0))).to_svg().unwrap();
    assert_eq!(count(&alone, "\nmixture\n"), 0);
}

#[test]
fn closed_form_a_distribution_ends_below_one_where_values_are_missing() {
    let ends = |values: &[f64]| Series::ours(0, "s").distribution(values).points.last().map(|p| (p.x, p.y));
    assert_eq!(ends(&[3.0, 1.0, 2.0, 2.0]), Some((3.0, 1.0)));
    assert_eq!(ends(&[3.0, 1.0, f64::NAN, f64::INFINITY]), Some((3.0, 0.5)));
}

#[test]
fn closed_form_bars_stand_on_zero() {
    let bars = Series::ours(0, "ours").bars().points(&[(0.0, 2.0), (1.0, 4.0)]);
    let panel = Panel::new(Axis::categories("lines", ["284", "183"]), Axis::linear("mm")).with(bars);
    let svg = Figure::of(panel).to_svg().unwrap();
    let tops_and_feet: Vec<(i64, i64)> = svg
        .lines()
        .filter(|line| line.starts_with("<rect") && line.contains("#0072B2"))
        .map(|line| {
            let number = |key: &str| -> i64 {
                let rest = line.split(&format!("{key}=\"")).nth(1).unwrap();
                rest.split('"').next().unwrap().parse().unwrap()
            };
            (number(" height"), number(" y") + number(" height"))
        })
        .collect();
    assert_eq!(tops_and_feet.len(), 2);
    assert_eq!(tops_and_feet[0].1, tops_and_feet[1].1);
    assert!((tops_and_feet[1].0 - 2 * tops_and_feet[0].0).abs() <= 2, "{tops_and_feet:?}");
}

#[test]
fn law_nothing_to_draw_is_an_error_that_names_the_panel() {
    assert_eq!(Figure::grid(vec![], 2).to_svg(), Err(FigureError::NoPanel));
    let empty = axes().with(Series::ours(0, "s").points(&[(0.0, f64::NAN), (1.0, -1.0)]));
    let full = axes().with(Series::ours(0, "s").points(&[(0.0, 1.0)]));
    let error = Figure::grid(vec![full, empty], 2).to_svg().unwrap_err();
    assert_eq!(error.to_string(), "panel 2 (`error (mm)`) has no point that can be drawn");
}
