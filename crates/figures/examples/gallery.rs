//! Draws what the tests draw, to be looked at: `cargo run -p lumenav-figures --example gallery FOLDER`.

use lumenav_figures::{Axis, Figure, Panel, Series};

/// One figure of each kind. The numbers are of no experiment.
fn gallery() -> Vec<(&'static str, Figure)> {
    let x = [20.0, 25.0, 30.0, 35.0, 40.0];
    let curve = |scale: f64| -> Vec<(f64, f64)> {
        x.iter().map(|x| (*x, scale * 2410.0 * (-(x - 20.0) / 12.6_f64).exp())).collect()
    };
    let rates = Panel::new(Axis::linear("cylinder diameter (cm)"), Axis::logarithmic("lines per window"))
        .titled("full ring")
        .with(Series::published("published").points(&curve(1.0)))
        .with(Series::ours(0, "lumenav").points(&curve(0.97)));
    let bars = |scale: f64| -> Vec<(f64, f64, f64)> {
        curve(scale).iter().map(|(x, y)| (*x, 100.0 / y.sqrt(), 20.0 / y.sqrt())).collect()
    };
    let errors = Panel::new(Axis::linear("cylinder diameter (cm)"), Axis::linear("marker error (mm)"))
        .titled("reduced scanner")
        .with(Series::published("published").points_with_bars(&bars(0.1)))
        .with(Series::ours(0, "mixture").points_with_bars(&bars(0.2)))
        .with(Series::ours(1, "rigid").points_with_bars(&bars(0.15)))
        .with(Series::ours(2, "fcm").points_with_bars(&bars(0.12)));
    let names = ["284", "183", "120", "80", "54"];
    let group = |f: f64| -> Vec<(f64, f64, f64)> {
        (0..5).map(|k| (f64::from(k), f * f64::from(k + 1) * 0.2, 0.05)).collect()
    };
    let grouped = Panel::new(Axis::categories("lines per window", names), Axis::linear("mean error (mm)"))
        .with(Series::published("than2015").bars().points_with_bars(&group(1.4)))
        .with(Series::ours(0, "mixture").bars().points_with_bars(&group(0.7)))
        .with(Series::ours(1, "rigid").bars().points_with_bars(&group(1.1)));
    let wave = |k: i32, phase: f64| {
        let t = f64::from(k) * 0.05;
        let jump = if (300..320).contains(&k) { 30.0 } else { 0.3 };
        // A gap where a window failed.
        (t, if (400..420).contains(&k) { f64::NAN } else { jump * (1.2 + (t + phase).sin()) })
    };
    let run = |phase: f64| (0..720).map(|k| wave(k, phase)).collect::<Vec<_>>();
    let jump = Panel::new(Axis::linear("time (s)"), Axis::logarithmic("marker error (mm)"))
        .with(Series::ours(0, "with failure prediction").line(0).points(&run(0.0)))
        .with(Series::ours(1, "without").line(1).points(&run(2.0)));
    let values = |s: f64| (1..200).map(|k| s * (f64::from(k) / 60.0).powi(2)).collect::<Vec<_>>();
    let distribution =
        Panel::new(Axis::linear("marker error (mm)"), Axis::linear("share of windows").at_least(0.0, 1.0))
            .with(Series::ours(0, "mixture").line(0).distribution(&values(0.1)))
            .with(Series::ours(1, "rigid").line(1).distribution(&values(0.2)))
            .with(Series::ours(2, "fcm").line(2).distribution(&values(0.3)));
    vec![
        ("panels", Figure::grid(vec![rates, errors], 2)),
        ("bars", Figure::of(grouped)),
        ("jump", Figure::of(jump).panel_size(680, 250)),
        ("distribution", Figure::of(distribution)),
    ]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_owned()));
    for (name, figure) in gallery() {
        let path = folder.join(format!("{name}.svg"));
        std::fs::write(&path, figure.to_svg()?)?;
        println!("{}", path.display());
    }
    Ok(())
}
