//! Each reproduction in seconds: it runs, it is the same for any number of threads, and its rows say what they should.

mod support;

use lumenav_reproduce::{OneAfterAnother, Table, Verdict, all, find};
use support::{Backwards, quick};

/// What holds for every table.
fn check(table: &Table) {
    assert!(!table.rows.is_empty() && !table.figures.is_empty(), "{}", table.id);
    for row in &table.rows {
        assert!(!row.why.is_empty(), "{}: `{}` says not why", table.id, row.quantity);
        assert!(row.published.is_some() || row.verdict == Verdict::NotComparable, "{row:?}");
        assert!(!row.ours.is_empty(), "{row:?}");
    }
    let names: Vec<&str> = table.rows.iter().map(|row| row.quantity.as_str()).collect();
    let different: std::collections::BTreeSet<&&str> = names.iter().collect();
    assert_eq!(names.len(), different.len(), "{}: two rows of one name", table.id);
    assert!(table.figures.iter().all(|figure| figure.svg.starts_with("<svg")));
}

#[test]
fn law_ids_are_sorted_and_found() {
    let ids: Vec<&str> = all().iter().map(|r| r.id).collect();
    assert!(ids.is_sorted() && !ids.is_empty());
    assert!(ids.iter().all(|id| find(id).is_some()));
    assert!(find("than2015/nothing").is_none());
}

#[test]
fn published_rates_fall_with_the_cylinder_on_any_threads() {
    let table = quick("than2015/rates", &OneAfterAnother);
    check(&table);
    let backwards = quick("than2015/rates", &Backwards);
    assert_eq!(table.to_json().unwrap(), backwards.to_json().unwrap());
    assert_eq!(table.figures, backwards.figures);
    assert_eq!(table.rows.len(), 22);
    // Three windows of the full ring and twelve of the reduced scanner: a statistical error of some per cent.
    let lines = |prefix: &str| -> Vec<f64> {
        let rows = table.rows.iter().filter(|row| row.quantity.starts_with(prefix));
        rows.map(|row| row.ours["scaled"].unwrap() / row.published.unwrap()).collect()
    };
    for prefix in ["lines per run, full ring", "lines per run, reduced"] {
        let ratios = lines(prefix);
        assert_eq!(ratios.len(), 5);
        assert!(ratios.iter().all(|r| (0.7..1.4).contains(r)), "{prefix}: {ratios:?}");
    }
    let shares = |row: &&lumenav_reproduce::Row| row.quantity.starts_with("true share");
    for row in table.rows.iter().filter(shares) {
        let ours = row.ours[row.judged.as_ref().unwrap()].unwrap();
        assert!((ours - row.published.unwrap()).abs() < 12.0, "{row:?}");
    }
}

#[test]
fn published_dose_bound_is_met() {
    let table = quick("than2015/dose", &OneAfterAnother);
    check(&table);
    let bound = table.rows.iter().find(|row| row.published == Some(8.04)).unwrap();
    assert_eq!(bound.verdict, Verdict::Reproduced, "{bound:?}");
    assert!(table.seeds.is_empty());
}

#[test]
fn published_few_lines_are_followed_by_all_estimators() {
    let table = quick("than2015/few-lines", &OneAfterAnother);
    check(&table);
    assert_eq!(table.estimators(), ["fcm", "mixture", "mixture alone", "rigid"]);
    let mean = |lines: u32, name: &str| {
        let wanted = format!("mean marker error at {lines} lines");
        table.rows.iter().find(|row| row.quantity == wanted).unwrap().ours[name].unwrap()
    };
    // Forty windows: the motion prior helps, and helps more where there are fewer lines.
    assert!(mean(284, "mixture") < 0.6, "{}", mean(284, "mixture"));
    assert!(mean(54, "mixture") < 1.5, "{}", mean(54, "mixture"));
    assert!(mean(54, "mixture") < mean(54, "fcm"));
    assert!(table.settings.iter().any(|(name, _)| name == "motion prior"));
}

#[test]
fn published_jump_loses_only_who_does_not_look_for_it() {
    let table = quick("than2015/jump", &OneAfterAnother);
    check(&table);
    let [back, lost] = [&table.rows[0], &table.rows[1]];
    assert!(back.ours["fcm"].unwrap() <= 1.0, "{back:?}");
    assert_eq!(lost.ours["fcm, no prediction"], Some(1.0), "{lost:?}");
    assert_eq!(lost.verdict, Verdict::Reproduced);
    assert_eq!(lost.ours["fcm"], Some(0.0), "{lost:?}");
}

#[test]
fn published_static_cylinder_in_a_dozen_windows() {
    let table = quick("than2015/static-cylinder", &OneAfterAnother);
    check(&table);
    let mean = &table.rows[0];
    assert!(mean.ours.values().all(|error| error.unwrap() < 2.0), "{mean:?}");
    assert!(mean.ours["mixture"].unwrap() < mean.ours["fcm"].unwrap(), "{mean:?}");
}

#[test]
fn published_other_tables_run_in_seconds() {
    for id in [
        "than2015/speed-and-size",
        "than2015/window-and-activity",
        "than2015/torso",
        "than2015/point-registration",
    ] {
        let table = quick(id, &OneAfterAnother);
        check(&table);
        let mean = table.rows.iter().find(|row| row.quantity.starts_with("mean")).unwrap();
        // Windows of full rings; few of them.
        assert!(mean.ours["mixture"].is_some_and(|error| error < 2.0), "{id}: {mean:?}");
    }
}

#[test]
fn published_experiments_account_for_every_window() {
    for id in ["than2015/experiment-tf64", "than2015/experiment-allegro"] {
        let table = quick(id, &OneAfterAnother);
        check(&table);
        let mean = &table.rows[0];
        assert!(mean.ours["mixture"].unwrap() < 1.5, "{id}: {mean:?}");
        // The activity that brings the published lines on the whole way (the start, in the middle of the scanner, sees twice as many).
        let (_, activity) = table.settings.iter().find(|(name, _)| name == "activity").unwrap();
        let factor: f64 = activity.split([' ', ':']).nth(1).unwrap().parse().unwrap();
        assert!((0.6..1.6).contains(&factor), "{id}: {activity}");
    }
}
