//! Waves against laws, published rates and mistakes.

use super::*;
use crate::generator::{ColonRequest, colon};
use crate::motility_config::WaveConfig;
use crate::segment::SegmentKey;
use crate::test_tracts::stomach_and_duodenum;
use crate::tract::{End, SegmentPoints, TractDraft};
use lumenav_core::Node;
use lumenav_core::config::quantity::Fraction;
use nalgebra::Point3;
use std::path::Path;

fn jejunum() -> Tract {
    let key = SegmentKey::Jejunum;
    let points_m: Vec<_> = (0..=10).map(|i| Point3::new(0.0, 0.0, 0.1 * f64::from(i))).collect();
    let radii_m = vec![0.0075; points_m.len()];
    let segment = SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() };
    let (segments, ends) = (vec![segment], (End::Closed, End::Exit));
    let draft =
        TractDraft { name: "t".into(), segments, ends, torso_half_extents_m: None, source: String::new() };
    draft.build().unwrap().0
}

fn streams(seed: u64) -> RandomStreams {
    RandomStreams::new(seed, 0, "motility")
}

fn parse(text: &str) -> Result<MotilityConfig, lumenav_core::ConfigError> {
    Node::parse_text(text, "scenario.toml", Path::new(""), &[])?.child_or_empty("motility").parse()
}

/// All waves that start until `end_s`.
fn waves(mut motility: Motility, end_s: f64, step_s: f64) -> Vec<Wave> {
    let mut all: Vec<Wave> = Vec::new();
    let mut time_s = 0.0;
    while time_s < end_s {
        time_s += step_s;
        motility.advance_to(time_s);
        let last_s = all.last().map_or(f64::NEG_INFINITY, |wave| wave.start_time_s);
        all.extend(motility.active().iter().filter(|wave| wave.start_time_s > last_s));
    }
    all
}

#[test]
fn closed_form_swallows_that_follow_grow_stronger_up_to_twice() {
    // 0.36 (1 + 0.05 (t - 10 s)), at most 0.72, from a swallow at 10 s on; the swallow itself has 0.36.
    let text =
        "[motility.oesophagus]\nswallow_time_s = 10.0\nfurther_growth_per_s = 0.05\namplitude_spread = 0.0";
    let tract = whole_gut();
    let waves = waves(Motility::new(&parse(text).unwrap(), &tract, &streams(1)).unwrap(), 60.0, 0.1);
    let of_oesophagus: Vec<_> = waves.iter().filter(|wave| wave.start_arc_length_m < 0.1).collect();
    assert!(of_oesophagus.len() > 6, "{}", of_oesophagus.len());
    let mut largest = 0.0_f64;
    for wave in of_oesophagus {
        let grown = 1.0 + 0.05 * (wave.start_time_s - 10.0).max(0.0);
        let expected = if wave.start_time_s == 10.0 { 0.36 } else { 0.36 * grown.min(2.0) };
        assert!(wave.amplitude.iter().all(|a| (a - expected).abs() < 1e-12), "{wave:?}, expected {expected}");
        largest = largest.max(wave.amplitude[0]);
    }
    assert!((largest - 0.72).abs() < 1e-12, "{largest}");
}

/// Default motility in a colon whose haustra never rest.
fn restless() -> MotilityConfig {
    parse("[motility.colon]\nburst_fraction = 1.0").unwrap()
}

#[test]
fn law_waves_do_not_depend_on_the_step() {
    let tract = colon(&ColonRequest::default(), &streams(1)).unwrap().tract;
    for config in [restless(), MotilityConfig::default()] {
        let make = || Motility::new(&config, &tract, &streams(3)).unwrap();
        let (fine, coarse) = (waves(make(), 1800.0, 0.125), waves(make(), 1800.0, 0.375));
        assert!(fine.len() > 100);
        assert!(fine == coarse, "{} and {} waves", fine.len(), coarse.len());
        let middle_s = fine[fine.len() / 2].start_time_s + 0.1;
        let (mut once, mut back) = (make(), make());
        once.advance_to(middle_s);
        back.advance_to(1900.0);
        back.advance_to(middle_s);
        assert!(!once.active().is_empty());
        assert_eq!(once.active(), back.active());
        let other = Motility::new(&config, &tract, &streams(4)).unwrap();
        assert!(waves(other, 1800.0, 0.375) != coarse, "another seed gives the same waves");
    }
}

#[test]
fn published_rate_of_phase_three_at_one_place() {
    // 12.5 falling to 10.5 contractions per minute in the jejunum (Kerlin and Phillips 1982), phase III all the time here.
    let mut config = MotilityConfig::default();
    config.mmc.rate_factor = [Fraction(1.0); 3];
    let tract = jejunum();
    let duration_s = 3600.0;
    let all = waves(Motility::new(&config, &tract, &streams(1)).unwrap(), duration_s, 0.2);
    for (place_m, per_minute) in [(0.3, 11.9), (0.7, 11.1)] {
        let passes = all
            .iter()
            .filter(|wave| {
                let end_m = wave.start_arc_length_m + wave.speed_m_s * wave.duration_s;
                (wave.start_arc_length_m - place_m) * (end_m - place_m) < 0.0
            })
            .count();
        let rate = passes as f64 / duration_s * 60.0;
        // 700 events whose places and runs are drawn: 5 % is four standard errors of a renewal process with dead time 0.6.
        assert!((rate / per_minute - 1.0).abs() < 0.08, "{rate} per minute at {place_m} m");
    }
    // Where waves are rare, the part that is set runs aborally; in phase III those against the stream find less room.
    config.mmc.rate_factor = [Fraction(0.05); 3];
    let rare = waves(Motility::new(&config, &tract, &streams(1)).unwrap(), 40.0 * duration_s, 0.2);
    let aboral = rare.iter().filter(|wave| wave.speed_m_s > 0.0).count() as f64 / rare.len() as f64;
    assert!((aboral - config.jejunum.aboral_fraction.0).abs() < 0.02, "{aboral} aboral");
}

#[test]
fn published_phase_one_is_quiet() {
    // No contractions in phase I (Ahluwalia 1994).
    let mut config = MotilityConfig::default();
    config.mmc.start_phase = Some(Fraction(0.25));
    let motility = Motility::new(&config, &jejunum(), &streams(1)).unwrap();
    assert!(waves(motility, 300.0, 1.0).is_empty());
}

#[test]
fn law_no_two_events_of_a_cell_within_the_refractory_time() {
    let tract = whole_gut();
    let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(9)).unwrap();
    let cell = motility.cells.iter_mut().find(|cell| cell.name.starts_with("haustra")).unwrap();
    let dead = cell.rhythm.refractory_fraction;
    let mut last_s = cell.next_time_s;
    let mut sum_s = 0.0;
    let n = 4000;
    for _ in 0..n {
        cell.fire(&motility.streams, &motility.cycle);
        let interval_s = cell.next_time_s - last_s;
        assert!(interval_s >= dead / cell.rate_hz - 1e-9);
        sum_s += interval_s;
        last_s = cell.next_time_s;
    }
    // Standard error of the mean interval: (1 - r)/sqrt(n).
    assert!((sum_s / f64::from(n) * cell.rate_hz - 1.0).abs() < 4.0 * (1.0 - dead) / f64::from(n).sqrt());
}

#[test]
fn law_waves_of_the_small_bowel_keep_clear_of_each_other() {
    let mut config = MotilityConfig::default();
    config.mmc.rate_factor = [Fraction(1.0); 3];
    let mut motility = Motility::new(&config, &jejunum(), &streams(5)).unwrap();
    // 0.5 of 1/0.208 s at 8 mm/s, and less where the rate is higher: at the oral end.
    let clear_m =
        config.jejunum.refractory_fraction.0 / config.jejunum.rate_hz[0].0 * config.jejunum.speed_m_s.0;
    let (mut nearest_m, mut pairs) = (f64::INFINITY, 0);
    for k in 1..6000 {
        let time_s = 0.3 * f64::from(k);
        motility.advance_to(time_s);
        let running = motility.active();
        for (i, a) in running.iter().enumerate() {
            for b in &running[i + 1..] {
                nearest_m = nearest_m.min((a.at(time_s).centre_m - b.at(time_s).centre_m).abs());
                pairs += 1;
            }
        }
    }
    assert!(pairs > 100_000 && nearest_m >= clear_m - 1e-9, "{nearest_m} m, {clear_m} asked, {pairs} pairs");
    assert!(nearest_m < 1.05 * clear_m, "{nearest_m} m: nothing ever came near");
}

#[test]
fn law_memory_does_not_grow() {
    let tract = colon(&ColonRequest::default(), &streams(1)).unwrap().tract;
    let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(3)).unwrap();
    motility.advance_to(8.0 * 3600.0);
    assert!(motility.active.capacity() <= 512, "{}", motility.active.capacity());
    assert!(motility.active().iter().all(|wave| wave.end_time_s() > 8.0 * 3600.0));
}

#[test]
fn law_a_scheduled_wave_is_what_the_file_says() {
    let config = parse(
        "[motility]\nspontaneous = false\n[[motility.wave]]\nstart_time_s = 5\nsegment = \"transverse\"\nstart_m = 0.02\n\
         speed_m_s = -0.01\nrun_m = 0.2\nwidth_m = 0.02\namplitude = 0.5\n",
    )
    .unwrap();
    let tract = colon(&ColonRequest::default(), &streams(1)).unwrap().tract;
    let mut motility = Motility::new(&config, &tract, &streams(1)).unwrap();
    motility.advance_to(6.0);
    let [wave] = motility.active() else { panic!("{:?}", motility.active()) };
    let start_m = tract.segment(SegmentKey::Transverse).unwrap().start_m + 0.02;
    assert!((wave.start_arc_length_m - start_m).abs() < 1e-12);
    assert!((wave.duration_s - 20.0).abs() < 1e-12 && wave.speed_m_s == -0.01);
    assert!((wave.at(15.0).centre_m - (start_m - 0.1)).abs() < 1e-12);
    assert!((wave.at(15.0).weight - 0.5).abs() < 1e-12);
    motility.advance_to(25.1);
    assert!(motility.active().is_empty());
}

#[test]
fn law_mistakes_in_the_file_are_refused() {
    for (text, said) in [
        ("[motility]\namplitude_scale = 2", "amplitude_scale"),
        ("[motility]\nwaves = []", "waves"),
        ("[motility.colon]\nhaustral_rate = 1", "haustral_rate"),
        ("[motility.jejunum]\nspeed_m_s = 0", "speed_m_s"),
        ("[[motility.wave]]\nstart_time_s = -1", "start_time_s"),
    ] {
        let error = parse(text).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("scenario.toml:2"), "{error}");
    }
    let tract = jejunum();
    let refuse = |change: fn(&mut WaveConfig)| {
        let mut config = parse("[[motility.wave]]\nstart_time_s = 1").unwrap();
        change(&mut config.wave[0]);
        Motility::new(&config, &tract, &streams(1)).unwrap_err()
    };
    let why = |error: AnatomyError| match error {
        AnatomyError::InWave { index: 0, error } => *error,
        other => panic!("{other}"),
    };
    let missing = why(refuse(|wave| wave.segment = Some(SegmentKey::Caecum)));
    assert!(matches!(missing, AnatomyError::NoSuchSegment { .. }));
    assert!(matches!(why(refuse(|wave| wave.start_m.0 = 3.0)), AnatomyError::OutOfRange { .. }));
    assert!(matches!(why(refuse(|wave| wave.amplitude.0 = 1.0)), AnatomyError::OutOfRange { .. }));
    assert!(matches!(why(refuse(|wave| wave.speed_m_s.0 = 0.0)), AnatomyError::NotPositive { .. }));
}

#[test]
fn law_numbers_outside_their_range_are_refused_at_their_line() {
    let tract = jejunum();
    for (text, said) in [
        ("[motility.jejunum]\nrate_hz = [0.2, 1e9]", "scenario.toml:2:11: `motility.jejunum.rate_hz`"),
        ("[motility.colon]\nhaustral_rate_hz = 1e9", "scenario.toml:2:20: `motility.colon.haustral_rate_hz`"),
        (
            "[motility.colon]\nmass_rate_per_day = 1e9",
            "scenario.toml:2:21: `motility.colon.mass_rate_per_day`",
        ),
        ("[motility.colon]\nretrograde_rectosigmoid_rate_hz = 3", "scenario.toml:2:35:"),
        ("[motility.colon]\nhaustral_speed_m_s = 1e-9", "scenario.toml:2:22:"),
        (
            "[motility.ileum]\nspeed_m_s = 2e-5\nrun_m = [0.02, 0.08]",
            "scenario.toml:2:13: `motility.ileum.speed_m_s`: 728 waves of one place",
        ),
        ("[motility.stomach]\nwidth_m = 1e-9", "scenario.toml:2:11:"),
        ("[motility.duodenum]\nrun_m = [0.1, 1e6]", "scenario.toml:2:9:"),
        ("[motility.terminal_ileum]\namplitude = [0.5, 1]", "scenario.toml:2:13:"),
        ("[motility.oesophagus]\namplitude = 0.99", "scenario.toml:2:13:"),
        ("[motility.oesophagus]\nspeed_m_s = 1e6", "scenario.toml:2:13:"),
        ("[motility.mmc]\nperiod_s = 1e-9", "scenario.toml:2:12:"),
        ("[motility.mmc]\nperiod_spread = 0.99", "scenario.toml:2:17:"),
        ("[motility.mmc]\nfractions = [0.5, 0.1, 0.1]", "scenario.toml:2:13:"),
        (
            "[[motility.wave]]\nstart_time_s = 1e12",
            "scenario.toml:2:16: `motility.wave[0].start_time_s`: scheduled wave 1",
        ),
        ("[[motility.wave]]\nstart_time_s = 1\nwidth_m = 1e-9", "scenario.toml:3:11:"),
        ("[[motility.wave]]\nstart_time_s = 1\nspeed_m_s = 1e-12", "scenario.toml:3:13:"),
        ("[[motility.wave]]\nstart_time_s = 1\nduration_s = 1e12", "scenario.toml:3:14:"),
        ("[[motility.wave]]\nstart_time_s = 1\nsegment = \"caecum\"", "scenario.toml:3:11:"),
        (
            "[[motility.fault]]\nkind = \"ileus\"\nstart_s = 9\nend_s = 8",
            "scenario.toml:4:9: `motility.fault[0].end_s`: fault 1",
        ),
        ("[[motility.meal]]\nstart_s = 1e12", "scenario.toml:2:11: `motility.meal[0].start_s`: meal 1"),
        (
            "[[motility.meal]]\nduration_s = 600\n[[motility.meal]]\nstart_s = 599",
            "scenario.toml:4:11: `motility.meal[1].start_s`: meal 2",
        ),
        ("[[motility.fault]]\nkind = \"ileus\"\nstart_s = 9\nend_s = 9", "scenario.toml:4:9:"),
        (
            "[[motility.fault]]\nkind = \"ileus\"\n[[motility.fault]]\nkind = \"ileus\"\nstart_s = 9",
            "scenario.toml:5:11: `motility.fault[1].start_s`: fault 2",
        ),
        (
            "[[motility.fault]]\nkind = \"gastroparesis\"",
            "scenario.toml:2:8: `motility.fault[0].kind`: fault 1: gastroparesis concerns stomach; this tract has: jejunum",
        ),
    ] {
        let node = Node::parse_text(text, "scenario.toml", Path::new(""), &[]).unwrap();
        let motility = node.child_or_empty("motility");
        let error = Motility::new(&motility.parse().unwrap(), &tract, &streams(1)).map(|_| ()).unwrap_err();
        let shown = error.at_motility(&motility).to_string();
        assert!(shown.starts_with(said), "{shown}, wanted {said}");
    }
}

/// A straight gut with all segments, 0.2 m each.
fn whole_gut() -> Tract {
    whole_gut_with(End::Exit)
}

fn whole_gut_with(anal_end: End) -> Tract {
    let segment = |(i, key): (usize, SegmentKey)| {
        let z = 0.2 * i as f64;
        let points_m: Vec<_> = (0..=4).map(|k| Point3::new(0.0, 0.0, z + 0.05 * f64::from(k))).collect();
        let radii_m = vec![0.01; points_m.len()];
        SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() }
    };
    let draft = TractDraft {
        name: "t".into(),
        segments: SegmentKey::ALL.into_iter().enumerate().map(segment).collect(),
        ends: (End::Closed, anal_end),
        torso_half_extents_m: None,
        source: String::new(),
    };
    draft.build().unwrap().0
}

/// All events of one cell of `motility` until `end_s`.
fn events(motility: &mut Motility, cell: &str, end_s: f64) -> Vec<Wave> {
    let found = motility.cells.iter_mut().find(|c| c.name == cell);
    let cell = found.unwrap_or_else(|| panic!("no cell {cell}"));
    let mut all = Vec::new();
    while cell.next_time_s < end_s {
        all.extend(cell.fire(&motility.streams, &motility.cycle));
    }
    all
}

#[test]
fn law_haustra_contract_in_bursts() {
    let tract = whole_gut();
    let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(2)).unwrap();
    let days = 10.0;
    let all = events(&mut motility, "haustra/transverse/3", days * 86_400.0);
    // A fifth of the time, 3 per minute then.
    let expected = days * 86_400.0 * 0.05 * 0.2;
    assert!((all.len() as f64 / expected - 1.0).abs() < 0.03, "{} of {expected}", all.len());
    // Stretches without a pause of a minute, which the dead time of half an interval makes unlikely in a burst, are bursts of at most 300 s.
    let mut longest_s: f64 = 0.0;
    let mut begin_s = all[0].start_time_s;
    for pair in all.windows(2) {
        longest_s = longest_s.max(pair[0].start_time_s - begin_s);
        if pair[1].start_time_s - pair[0].start_time_s > 100.0 {
            begin_s = pair[1].start_time_s;
        }
    }
    // Two may follow each other across a border of their periods.
    assert!((250.0..=700.0).contains(&longest_s), "{longest_s}");
    // Cells of one segment burst together.
    let neighbour = events(&mut motility, "haustra/transverse/4", 86_400.0);
    let together = |wave: &Wave| all.iter().any(|a| (a.start_time_s - wave.start_time_s).abs() < 60.0);
    assert!(neighbour.iter().all(together));
    let mut always = Motility::new(&restless(), &tract, &streams(2)).unwrap();
    let all = events(&mut always, "haustra/transverse/3", 86_400.0);
    assert!((all.len() as f64 / (86_400.0 * 0.05) - 1.0).abs() < 0.03, "{}", all.len());
}

#[test]
fn law_no_hour_is_quiet_in_all_people() {
    // Haustral waves in the first, the second and a later minute, over people: a fifth of those of a colon that never rests.
    let tract = whole_gut();
    let mut counts = [0.0; 3];
    let people = 1500;
    for seed in 0..people {
        let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(seed)).unwrap();
        let all = events(&mut motility, "haustra/transverse/3", 1500.0);
        for (count, from_s) in counts.iter_mut().zip([0.0, 60.0, 1440.0]) {
            *count += all.iter().filter(|w| (from_s..from_s + 60.0).contains(&w.start_time_s)).count() as f64;
        }
    }
    // 0.6 a person and minute; counts within a burst go together: variance about 2 a person, four standard errors.
    let expected = 0.6 * people as f64;
    assert!(counts.iter().all(|n| (n - expected).abs() < 4.0 * (2.0 * people as f64).sqrt()), "{counts:?}");
}

#[test]
fn closed_form_the_first_event_of_a_process_that_has_always_run() {
    // One event in the first mean interval, whatever the dead time.
    let tract = whole_gut();
    for (cell, interval_s, dead) in
        [("mass/0", 3600.0, 0.05), ("defecation/0", 86_400.0, 0.5), ("stomach/0", 1.0 / 0.0517, 0.9)]
    {
        let people = 4000;
        let mut count = 0;
        for seed in 0..people {
            let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(seed)).unwrap();
            let cell = motility.cells.iter_mut().find(|c| c.name == cell).unwrap();
            while cell.next_time_s < interval_s {
                cell.fire(&motility.streams, &motility.cycle);
                count += 1;
            }
        }
        // The variance of the number is at most that of a Poisson process.
        let error = f64::from(count) / people as f64 - 1.0;
        assert!(error.abs() < 4.0 * (1.0 - 0.5 * dead) / (people as f64).sqrt(), "{cell}: {error}");
    }
}

#[test]
fn law_mass_movements_arise_in_the_proximal_colon() {
    let tract = whole_gut();
    let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(2)).unwrap();
    let all = events(&mut motility, "mass/0", 200.0 * 86_400.0);
    assert!((all.len() as f64 / 4800.0 - 1.0).abs() < 0.06, "{} in 200 days", all.len());
    let caecum_m = tract.segment(SegmentKey::Caecum).unwrap().start_m;
    let last_m = tract.segment(SegmentKey::Descending).unwrap().end_m;
    let (caecal, others): (Vec<&Wave>, Vec<&Wave>) =
        all.iter().partition(|wave| wave.start_arc_length_m == caecum_m);
    assert!((caecal.len() as f64 / all.len() as f64 - 0.3).abs() < 0.03, "{}", caecal.len());
    let mut places_m: Vec<f64> = others.iter().map(|wave| wave.start_arc_length_m).collect();
    places_m.sort_by(f64::total_cmp);
    for part in [0.1, 0.5, 0.9] {
        let expected_m = caecum_m + part * (last_m - caecum_m);
        let found_m = places_m[(part * places_m.len() as f64) as usize];
        assert!((found_m - expected_m).abs() < 0.03, "{part}: {found_m}, {expected_m}");
    }
    for wave in &all {
        // It forms in one place, then runs for its 41 cm or to the end, in the colon alone.
        let travels_s = wave.start_time_s + wave.forms_s;
        assert!((wave.forms_s - 0.15 * 0.41 / 0.022).abs() < 1e-9 && wave.acts_from_m == caecum_m);
        assert!(wave.at(travels_s).envelope > 0.999);
        assert!((wave.centre_m(travels_s) - wave.start_arc_length_m).abs() < 1e-6);
        let end_m = (wave.start_arc_length_m + 0.41).min(tract.length_m());
        assert!((wave.centre_m(wave.end_time_s()) - end_m).abs() < 1e-9);
    }
}

#[test]
fn law_a_mass_movement_leaves_the_ileum_alone() {
    let tract = std::sync::Arc::new(whole_gut());
    let mut config = restless();
    config.colon.mass_caecal_fraction = Fraction(1.0);
    config.colon.mass_rate_per_day = lumenav_core::config::quantity::NonNegative(2000.0);
    config.mmc.rate_factor = [Fraction(0.0); 3];
    let caecum_m = tract.segment(SegmentKey::Caecum).unwrap().start_m;
    let motility = Motility::new(&config, &tract, &streams(2)).unwrap();
    let mut lumen = crate::lumen::Lumen::new(tract, motility);
    let mut narrowed: f64 = 0.0;
    for k in 0..600 {
        let time_s = 0.5 * f64::from(k);
        lumen.advance_to(time_s);
        assert_eq!(lumen.radius(caecum_m - 0.002, 0.0, time_s).closed, 0.0);
        narrowed = narrowed.max(lumen.radius(caecum_m + 0.002, 0.0, time_s).closed);
    }
    assert!(narrowed > 0.9, "{narrowed}");
}

#[test]
fn published_defecations_empty_what_scintigraphy_saw() {
    // In the median 99 % of sigmoid and rectum, at least 60 % of them, at most 19 % of caecum and ascending colon with all that lies behind.
    let tract = whole_gut();
    let mut motility = Motility::new(&MotilityConfig::default(), &tract, &streams(2)).unwrap();
    let all = events(&mut motility, "defecation/0", 400.0 * 86_400.0);
    assert!((all.len() as f64 / 400.0 - 1.0).abs() < 0.1, "{} in 400 days", all.len());
    let sigmoid_m = tract.segment(SegmentKey::Sigmoid).unwrap().start_m;
    let end_m = tract.length_m();
    let ascending_m = tract.segment(SegmentKey::Ascending).unwrap().end_m;
    // From the first to the last place at which it is in full strength.
    let mut from_m = Vec::new();
    for wave in &all {
        let times_s = (0..4000).map(|k| wave.start_time_s + wave.duration_s * f64::from(k) / 4000.0);
        let full: Vec<f64> =
            times_s.filter(|t| wave.at(*t).envelope > 0.999).map(|t| wave.centre_m(t)).collect();
        from_m.push(full[0]);
        assert!(
            (full[full.len() - 1] - end_m).abs() < 5e-3,
            "in full strength up to {}",
            full[full.len() - 1]
        );
    }
    from_m.sort_by(f64::total_cmp);
    let (first, middle, last) = (from_m[0], from_m[from_m.len() / 2], from_m[from_m.len() - 1]);
    assert!((first - (ascending_m - 0.19 * 0.4)).abs() < 0.02, "{first}");
    assert!((middle - sigmoid_m).abs() < 0.05, "{middle}, {sigmoid_m}");
    assert!((last - (end_m - 0.6 * (end_m - sigmoid_m))).abs() < 0.01, "{last}");
    // A tract without a way out has none.
    let closed = whole_gut_with(End::Closed);
    let motility = Motility::new(&MotilityConfig::default(), &closed, &streams(2)).unwrap();
    assert!(motility.cells.iter().all(|cell| cell.name != "defecation/0"));
}

#[test]
fn law_a_meal_interrupts_the_motor_complex() {
    // Phase I from 60 s on for almost an hour, at the end of the duodenum 256 s later; a meal in the middle of it.
    let mut config = MotilityConfig::default();
    config.mmc.start_phase = Some(Fraction(0.99));
    let tract = whole_gut();
    config.meal = parse("[[motility.meal]]\nstart_s = 600\nduration_s = 600").unwrap().meal;
    config.pylorus.opening_fraction = Fraction(1.0);
    let duodenum = tract.segment(SegmentKey::Duodenum).unwrap().clone();
    let in_it = |wave: &&Wave| (duodenum.start_m..duodenum.end_m).contains(&wave.start_arc_length_m);
    let all = waves(Motility::new(&config, &tract, &streams(1)).unwrap(), 1800.0, 0.5);
    let between = |low: f64, high: f64| {
        all.iter().filter(|wave| (low..high).contains(&wave.start_time_s)).filter(in_it).collect::<Vec<_>>()
    };
    assert_eq!((between(330.0, 600.0).len(), between(1200.0, 1800.0).len()), (0, 0));
    let fed = between(600.0, 1200.0);
    assert!(fed.len() > 15, "{}", fed.len());
    // Amplitudes are drawn from 0.85 to 1.15 of the usual.
    let largest = fed.iter().map(|wave| wave.amplitude[0]).fold(0.0, f64::max);
    assert!(
        largest <= 1.15 * config.meal[0].amplitude_factor.0 * config.duodenum.amplitude[0].0 + 1e-9,
        "{largest}"
    );
    // The stomach goes on, but nothing opens the pylorus.
    let mut motility = Motility::new(&config, &tract, &streams(1)).unwrap();
    let mut openings = |time_s: f64| {
        motility.advance_to(time_s);
        let waves = motility.active().iter().filter(|wave| wave.speed_m_s == 0.0024).count();
        (waves > 0, motility.gate().unwrap().openings_s.len())
    };
    assert!(matches!(openings(580.0), (true, 1..)));
    assert_eq!(openings(1190.0), (true, 0));
    assert!(matches!(openings(1500.0), (true, 1..)));
}

/// Changes the number at `place` (counted over all numbers and flags); `false` where there are no more.
fn change_one(value: &mut toml::Value, place: &mut usize) -> bool {
    match value {
        toml::Value::Table(table) => table.iter_mut().any(|(_, inner)| change_one(inner, place)),
        toml::Value::Array(items) => items.iter_mut().any(|inner| change_one(inner, place)),
        toml::Value::Float(_) | toml::Value::Boolean(_) if *place > 0 => {
            *place -= 1;
            false
        }
        toml::Value::Float(number) => {
            // Small enough for every range and sum, large enough for the seventeenth digit.
            *number = if *number == 0.0 { 1e-4 } else { *number * 0.9999 };
            true
        }
        toml::Value::Boolean(flag) => {
            *flag = !*flag;
            true
        }
        _ => false,
    }
}

#[test]
fn law_the_fingerprint_tells_every_key_apart() {
    let tract = whole_gut();
    let text = "[[motility.wave]]\nstart_time_s = 5\nrun_m = 0.3\n[[motility.meal]]\n[[motility.fault]]\nkind = \"ileus\"\nend_s = 9\n[motility.mmc]\nstart_phase = 0.4";
    let base = parse(text).unwrap();
    let print =
        |config: &MotilityConfig| Motility::new(config, &tract, &streams(1)).unwrap().fingerprint_text();
    let ours = print(&base);
    let mut seen = std::collections::BTreeSet::from([ours.clone()]);
    let mut keys = 0;
    loop {
        let mut value = toml::Value::try_from(&base).unwrap();
        if !change_one(&mut value, &mut { keys }) {
            break;
        }
        let changed: MotilityConfig = value.clone().try_into().unwrap();
        assert_ne!(changed, base);
        assert!(seen.insert(print(&changed)), "change {keys} is not seen: {value}");
        keys += 1;
    }
    // Seven keys of five rhythms (three of them pairs), 17 of the colon, and the rest.
    assert!(keys > 80, "{keys}");
    assert_eq!(print(&base), ours);
    let other = Motility::new(&base, &tract, &streams(2)).unwrap().fingerprint_text();
    assert_ne!(other, ours, "the seed");
}

#[test]
fn law_strengths_are_spread_evenly_about_the_amplitude() {
    let mut config = MotilityConfig::default();
    config.mmc.rate_factor = [Fraction(1.0); 3];
    config.jejunum.amplitude = [Fraction(0.5); 2];
    config.jejunum.amplitude_spread = Fraction(0.4);
    let all = waves(Motility::new(&config, &jejunum(), &streams(2)).unwrap(), 3600.0, 0.2);
    let amplitudes: Vec<f64> = all.iter().map(|wave| wave.amplitude[0]).collect();
    let (n, sum): (f64, f64) = (amplitudes.len() as f64, amplitudes.iter().sum());
    assert!(n > 1000.0 && amplitudes.iter().all(|a| (0.3..=0.7).contains(a)));
    // Uniform: mean 0.5, standard deviation 0.4/sqrt(12), of which the standard error.
    assert!((sum / n - 0.5).abs() < 4.0 * 0.4 / 12.0_f64.sqrt() / n.sqrt(), "{}", sum / n);
    let below = amplitudes.iter().filter(|a| **a < 0.4).count() as f64 / n;
    assert!((below - 0.25).abs() < 4.0 * (0.25 * 0.75 / n).sqrt(), "{below} in the lowest quarter");
}

#[test]
fn law_the_first_centimetres_of_a_bowel_see_as_many_waves_as_the_others() {
    let mut config = MotilityConfig::default();
    config.mmc.rate_factor = [Fraction(1.0); 3];
    let duration_s = 3600.0;
    let all = waves(Motility::new(&config, &jejunum(), &streams(3)).unwrap(), duration_s, 0.2);
    // Whichever way they run: aboral ones alone are more than their part, since they cut others short.
    let passes = |place_m: f64| {
        let at = |wave: &&Wave| {
            let ends_m = [wave.start_arc_length_m, wave.centre_m(wave.end_time_s())];
            ends_m[0].min(ends_m[1]) < place_m && place_m <= ends_m[0].max(ends_m[1])
        };
        60.0 * all.iter().filter(at).count() as f64 / duration_s
    };
    // 12.5 per minute, falling by 2 over the metre; 6 % are three standard deviations over 24 seeds.
    for (place_m, per_minute) in [(0.005, 12.5), (0.2, 12.1)] {
        let seen = passes(place_m);
        assert!((seen / per_minute - 1.0_f64).abs() < 0.06, "{seen} per minute at {place_m} m");
    }
}

#[test]
fn published_antral_waves_run_to_the_pylorus_three_times_a_minute() {
    let tract = stomach_and_duodenum(0.015);
    let mut config = MotilityConfig::default();
    config.mmc.rate_factor = [Fraction(0.0); 3];
    let all = waves(Motility::new(&config, &tract, &streams(4)).unwrap(), 3600.0, 0.5);
    // 3.1 per minute (3D-Transit); regular to a tenth.
    assert!((all.len() as f64 / 60.0 - 3.1).abs() < 0.1, "{} in an hour", all.len());
    for wave in &all {
        assert!((wave.start_arc_length_m - 0.08).abs() < 1e-12, "{wave:?}");
        // At the pylorus it is as strong as it gets, before it fades.
        let arrives = wave.at(wave.start_time_s + 0.12 / wave.speed_m_s);
        assert!((arrives.centre_m - 0.2).abs() < 1e-9 && (arrives.envelope - 1.0).abs() < 1e-9);
    }
}

#[test]
fn law_a_fault_leaves_its_part_of_the_contractions_of_its_organ() {
    let tract = whole_gut();
    let count = |text: &str| {
        // Phase III all the time: many waves everywhere.
        let text = format!("[motility.mmc]\nrate_factor = [1, 1, 1]\n{text}");
        let all = waves(Motility::new(&parse(&text).unwrap(), &tract, &streams(6)).unwrap(), 2400.0, 0.5);
        // Stomach, small bowel and colon; the first and the second half.
        let mut counts = [[0_u32; 2]; 3];
        for wave in all.iter().filter(|wave| wave.start_arc_length_m >= 0.24) {
            let organ = [0.4, 1.2].iter().filter(|border_m| wave.start_arc_length_m >= **border_m).count();
            counts[organ][usize::from(wave.start_time_s >= 1200.0)] += 1;
        }
        counts
    };
    let well = count("");
    assert!(well.iter().flatten().all(|n| *n > 50), "{well:?}");
    let paralysed = count("[[motility.fault]]\nkind = \"ileus\"\nstart_s = 1200");
    assert_eq!(paralysed[0], well[0]);
    assert_eq!([paralysed[1][0], paralysed[2][0]], [well[1][0], well[2][0]]);
    assert_eq!([paralysed[1][1], paralysed[2][1]], [0, 0]);
    let weak = count("[[motility.fault]]\nkind = \"gastroparesis\"\nend_s = 1200\nremaining = 0.4");
    assert_eq!([weak[0][1], weak[2][1]], [well[0][1], well[2][1]]);
    // Antral waves that fade behind the pylorus keep the duodenum's clear of them: without them it has a few more.
    let more = f64::from(weak[1][0]) / f64::from(well[1][0]) - 1.0;
    assert!((0.0..0.06).contains(&more), "{more} more in the small bowel");
    let left = f64::from(weak[0][0]) / f64::from(well[0][0]);
    // Of some 62 waves: standard error 0.06.
    assert!((left - 0.4).abs() < 0.2, "{left} of the antral waves");
    for (text, said) in [("kind = \"spasm\"", "reflux"), ("kind = \"ileus\"\nremaining = 2", "remaining")] {
        let error = parse(&format!("[[motility.fault]]\n{text}")).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("scenario.toml:"), "{error}");
    }
}

#[test]
fn law_reflux_turns_the_duodenum_round_and_holds_the_pylorus_open() {
    let tract = stomach_and_duodenum(0.012);
    let of = |fault: &str| {
        let text = format!("[motility.mmc]\nrate_factor = [1, 1, 1]\n{fault}");
        Motility::new(&parse(&text).unwrap(), &tract, &streams(3)).unwrap()
    };
    let reflux = "[[motility.fault]]\nkind = \"reflux\"\nstart_s = 600\nend_s = 1200";
    // Waves of the duodenum: all, and those that run orally, in each third.
    let counts = |motility: Motility| {
        let mut counts = [[0_u32; 2]; 3];
        for wave in waves(motility, 1800.0, 0.2).iter().filter(|wave| wave.start_arc_length_m >= 0.2) {
            let third = &mut counts[(wave.start_time_s / 600.0) as usize];
            third[0] += 1;
            third[1] += u32::from(wave.speed_m_s < 0.0);
        }
        counts
    };
    let (well, ill) = (counts(of("")), counts(of(reflux)));
    assert_eq!(well[0], ill[0]);
    assert!(well.iter().all(|[all, oral]| *all > 100 && *oral > 0 && 3 * *oral < *all), "{well:?}");
    assert!(ill[1][0] > 100 && ill[1][0] == ill[1][1], "{ill:?}");
    assert!(3 * ill[2][1] < ill[2][0], "{ill:?}");
    // Part of them goes on aborally.
    let half = counts(of(&format!("{reflux}\nremaining = 0.5")));
    let oral = f64::from(half[1][1]) / f64::from(half[1][0]);
    // 0.5 of 0.85 remain aboral.
    assert!((oral - 0.575).abs() < 0.15, "{oral}");
    // They run through the pylorus, which stands open; it stands shut before and afterwards but for its usual openings.
    let all = waves(of(reflux), 1200.0, 0.2);
    let through = |wave: &&Wave| wave.speed_m_s < 0.0 && wave.centre_m(wave.end_time_s()) < 0.2 - 0.029;
    assert!(all.iter().filter(through).count() > 20);
    let motility = of(reflux);
    let gate = motility.gate().unwrap();
    assert_eq!([599.0, 605.1, 1194.9, 1201.0].map(|t| gate.at(t).weight), [0.9, 0.0, 0.0, 0.9]);
    for t in [600.5, 602.0, 604.4, 1195.6, 1198.0, 1199.9] {
        let difference = (gate.at(t + 1e-6).weight - gate.at(t - 1e-6).weight) / 2e-6;
        assert!((gate.at(t).weight_rate_per_s - difference).abs() < 1e-6, "at {t} s");
    }
    assert_eq!(
        [0.0, 601.0, 700.0, 1196.0, 1300.0].map(|t| gate.still_until_s(t)),
        [600.0, 601.0, 1195.0, 1196.0, f64::INFINITY]
    );
}
