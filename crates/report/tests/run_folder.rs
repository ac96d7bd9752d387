//! The files of a run: round trips, contracts, failures, equal bytes.

#![expect(clippy::disallowed_types, reason = "world side: the test plays a world")]

#[path = "../../pipeline/tests/synthetic/mod.rs"]
mod synthetic;

use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::frame::ColumnKind;
use lumenav_core::{Column, ColumnSpec, Frame, Reading, Rows, Schema, SimTime};
use lumenav_pipeline::events::PeriodTable;
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use lumenav_records::tum;
use lumenav_report::{
    Logged, Manifest, Metrics, MetricsObserver, Provenance, ReadingsObserver, ReportError, RunFolder,
    RunWriter, StampedPose, Timing, TruthObserver, WriterOptions, read_events, read_json, read_tracks,
    write_csv, write_kitti, write_tum,
};
use nalgebra::Isometry3;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const TRACKS: [&str; 2] = ["magnetic", "pet"];

fn stamped((at, world_from_capsule): (SimTime, Isometry3<f64>)) -> StampedPose {
    StampedPose { at, world_from_capsule }
}

/// Runs the synthetic run of 30 s at 10 Hz into a folder.
fn run(target: &Path) -> PathBuf {
    let options = WriterOptions {
        save_readings: true,
        provenance: Provenance {
            command_line: vec!["lumenav".into(), "run".into(), "helix.toml".into()],
            inputs: BTreeMap::from([("helix.toml".to_owned(), "00".to_owned())]),
            ..Provenance::default()
        },
        ..WriterOptions::default()
    };
    let mut writer = RunWriter::create(target, options).unwrap();
    synthetic::play(&mut writer, 30.0, 10.0, &TRACKS).unwrap();
    assert_eq!(writer.metrics().unwrap().tracks.len(), 2);
    writer.commit().unwrap()
}

#[test]
fn law_the_folder_appears_whole_with_all_files() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out/helix-7"));
    let mut names: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "events.jsonl",
            "magnetic.tum",
            "manifest.json",
            "metrics.json",
            "pet.tum",
            "readings",
            "timing.json",
            "tracks.parquet",
            "truth.parquet",
            "truth.tum"
        ]
    );
    assert_eq!(std::fs::read_dir(folder.path().join("out")).unwrap().count(), 1);
    let manifest: Manifest = read_json(&out.join("manifest.json")).unwrap();
    assert_eq!((manifest.seed, manifest.scenario.as_str()), (7, "helix"));
    assert_eq!(manifest.provenance.command_line.len(), 3);
    assert_eq!(manifest.scenario_toml, "name = \"helix\"\n");
    assert!(manifest.files.contains_key("tracks.parquet") && !manifest.files.contains_key("timing.json"));
    let timing: Timing = read_json(&out.join("timing.json")).unwrap();
    assert_eq!(timing.tracks["pet"].updates, 280);
    assert!((timing.tracks["pet"].update_ms.unwrap().mean - 0.1).abs() < 1e-12);
}

#[test]
fn law_two_equal_runs_differ_in_timing_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (run(&folder.path().join("a")), run(&folder.path().join("b")));
    for name in
        ["events.jsonl", "magnetic.tum", "manifest.json", "metrics.json", "tracks.parquet", "truth.tum"]
    {
        assert!(std::fs::read(a.join(name)).unwrap() == std::fs::read(b.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn law_tum_round_trips_and_equals_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out"));
    let poses: Vec<StampedPose> =
        tum::read(&out.join("truth.tum")).unwrap().into_iter().map(stamped).collect();
    assert_eq!(poses.len(), 300);
    for pose in &poses {
        let truth = synthetic::truth(pose.at).world_from_capsule;
        assert!((pose.world_from_capsule.translation.vector - truth.translation.vector).norm() < 2e-12);
        assert!(pose.world_from_capsule.rotation.angle_to(&truth.rotation) < 1e-8);
    }
    let again = folder.path().join("again.tum");
    write_tum(&again, &poses).unwrap();
    let lines = |path: &Path| -> Vec<String> {
        let text = std::fs::read_to_string(path).unwrap();
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
    };
    for (a, b) in lines(&out.join("truth.tum")).iter().zip(lines(&again)) {
        let numbers = |line: &str| line.split(' ').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>();
        assert_eq!(a.split(' ').next(), b.split(' ').next());
        assert!(numbers(a).iter().zip(numbers(&b)).all(|(x, y)| (x - y).abs() < 3e-12));
    }
}

#[test]
fn law_a_truth_without_tract_and_wall_has_empty_cells() {
    for known in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let mut observer = TruthObserver::new(folder.path());
        observer.start(&synthetic::header(1.0, &TRACKS)).unwrap();
        for i in 0..5 {
            let mut truth = synthetic::truth(SimTime(i));
            (truth.arc_length_m, truth.wall_force_n) = (known.then_some(0.25), known.then_some(0.5));
            truth.segment = truth.segment.filter(|_| known);
            observer.on(&RunEvent::Truth(&truth)).unwrap();
        }
        observer.finish().unwrap();
        let file = std::fs::File::open(folder.path().join("truth.parquet")).unwrap();
        let mut batches = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap();
        let batch = batches.next().unwrap().unwrap();
        for name in ["arc_length_m", "wall_force_n", "segment"] {
            let empty = batch.column_by_name(name).unwrap().null_count();
            assert_eq!((batch.num_rows(), empty), (5, if known { 0 } else { 5 }), "{name}");
        }
        assert_eq!(batch.column_by_name("x_m").unwrap().null_count(), 0);
    }
}

#[test]
fn closed_form_kitti_is_the_upper_part_of_the_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let quarter = Isometry3::new(
        nalgebra::Vector3::new(1.0, 2.0, 3.0),
        nalgebra::Vector3::z() * std::f64::consts::FRAC_PI_2,
    );
    write_kitti(&path, &[StampedPose { at: SimTime(0), world_from_capsule: quarter }]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let numbers: Vec<f64> = text.split_whitespace().map(|x| x.parse().unwrap()).collect();
    let expected = [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0];
    assert!(
        numbers.len() == 12 && numbers.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
        "{numbers:?}"
    );
}

#[test]
fn closed_form_tracks_parquet_holds_every_update() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out"));
    let rows = read_tracks(&out.join("tracks.parquet")).unwrap();
    assert_eq!(rows.len(), 2 * 280);
    for row in &rows {
        let t = SimTime(row.t_ns).seconds();
        let scale = if &*row.track == "pet" { 3.0 } else { 1.0 };
        let phase = if &*row.track == "pet" { 1.0 } else { 0.0 };
        assert!((row.number("error_x_mm").unwrap() - scale * (1.7 * t + phase).sin()).abs() < 1e-12);
        assert_eq!(row.available_ns - row.t_ns, 20_000_000);
        assert_eq!((row.pose_dof, row.nees_dof), (5, Some(5)));
        assert_eq!(row.number("nis").is_some(), row.update > 0);
        assert_eq!(row.number("attitude_error_deg"), None);
        assert!((row.covariance_matrix()[(2, 2)] - (2.2e-3 * scale).powi(2)).abs() < 1e-18);
        assert!(row.valid && row.started == (row.update == 0));
    }
    let truth = tum::read(&out.join("pet.tum")).unwrap();
    let pet: Vec<_> = rows.iter().filter(|row| &*row.track == "pet").collect();
    assert_eq!(truth.len(), pet.len());
    for (a, b) in truth.iter().zip(&pet) {
        let b = b.stamped_pose().unwrap();
        assert_eq!(a.0, b.at);
        assert!((a.1.translation.vector - b.world_from_capsule.translation.vector).norm() < 2e-12);
    }
    let csv = folder.path().join("a.csv");
    write_csv(&csv, &rows).unwrap();
    let text = std::fs::read_to_string(&csv).unwrap();
    let mut lines = text.lines();
    let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
    let error = columns.iter().position(|name| *name == "error_x_mm").unwrap();
    for (line, row) in lines.zip(&rows) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), columns.len());
        assert_eq!(cells[error].parse::<f64>().ok(), row.number("error_x_mm"));
    }
}

#[test]
fn law_a_file_that_is_no_table_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tracks.parquet");
    std::fs::write(&path, "no table at all").unwrap();
    assert!(matches!(read_tracks(&path), Err(ReportError::Table { .. })));
    assert!(read_tracks(&folder.path().join("none")).unwrap_err().to_string().starts_with("cannot open "));
}

#[test]
fn closed_form_metrics_follow_from_the_known_error() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out"));
    let metrics: Metrics = read_json(&out.join("metrics.json")).unwrap();
    assert_eq!((metrics.schema, metrics.seed, metrics.duration_s), (1, 7, 30.0));
    let track = &metrics.tracks["magnetic"];
    let times: Vec<f64> =
        (0..300).map(|i| f64::from(i) / 10.0).filter(|t| !(20.0..22.0).contains(t)).collect();
    let norm = |t: f64| ((1.7 * t).sin().powi(2) + (2.9 * t).cos().powi(2) + (0.8 * t).sin().powi(2)).sqrt();
    let n = times.len() as f64;
    let mean = times.iter().map(|t| norm(*t)).sum::<f64>() / n;
    let rmse = (times.iter().map(|t| norm(*t).powi(2)).sum::<f64>() / n).sqrt();
    let position = track.position_error_mm.unwrap();
    assert!((position.mean - mean).abs() < 1e-9 && (position.rmse - rmse).abs() < 1e-9);
    // The bound's trace is 1 mm²: RMSE in mm is the ratio.
    assert!((track.rmse_over_bound.unwrap() - rmse).abs() < 1e-9);
    let bias = times.iter().map(|t| (1.7 * t).sin()).sum::<f64>() / n;
    assert!((track.position_error_per_axis_mm.unwrap().x.bias - bias).abs() < 1e-9);
    assert_eq!(track.attitude_error_deg, None);
    // At 0 s there is no estimate yet. From 20 to 22 s there is no update: the one of 19.9 s is fresh until 20.9 s, so the
    // instants from 21.0 to 22.0 s are without (the truth of an instant comes before its update). 12 of 300.
    assert_eq!(track.availability, Some(288.0 / 300.0));
    assert_eq!((track.updates, track.starts, track.failed_updates), (280, 1, 0));
    assert_eq!(track.refused, BTreeMap::from([("gate".to_owned(), 20)]));
    assert!((track.latency_ms.unwrap().mean - 20.0).abs() < 1e-9);
    assert_eq!(track.time_to_first_fix_s, Some(0.02));
    assert_eq!(track.nees.unwrap().dof, 5);
    assert_eq!(track.nis.unwrap().dof, 48.0);
    assert!(track.verdict.is_some());
    let text = std::fs::read_to_string(out.join("metrics.json")).unwrap();
    for key in [
        "\"position_error_mm\"",
        "\"nees\"",
        "\"inside_95\"",
        "\"latency_ms\"",
        "\"attitude_error_deg\": null",
    ] {
        assert!(text.contains(key), "{key}");
    }
}

#[test]
fn law_events_round_trip_with_their_figures() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out"));
    let events = read_events(&out.join("events.jsonl")).unwrap();
    assert_eq!(events.len(), 1 + 40);
    let Logged::Refused { track, reason, chi_square, worst, .. } = &events[1].what else {
        panic!("{:?}", events[1])
    };
    assert_eq!((track.as_str(), reason.as_str(), *chi_square), ("magnetic", "gate", Some(120.0)));
    assert_eq!((worst[0].channel, worst[0].standardised), (3, 7.0));
    let path = folder.path().join("bad.jsonl");
    std::fs::write(&path, "{\"t_ns\":0,\"event\":\"note\",\"source\":\"world\",\"text\":\"x\"}\n{}\n")
        .unwrap();
    assert!(read_events(&path).unwrap_err().to_string().contains("bad.jsonl:2: no event"));
}

fn reading(sensor: &str, at_s: f64, payload: Frame) -> Reading {
    let at = SimTime::from_seconds(at_s);
    let known_poses = BTreeMap::from([("array".to_owned(), Isometry3::translation(0.5, 0.0, 0.0))]);
    Reading { sensor: sensor.into(), sequence: 3, interval: (at, at), arrival: at, known_poses, payload }
}

#[test]
fn law_readings_read_back_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let mut observer = ReadingsObserver::new(folder.path());
    observer.start(&synthetic::header(1.0, &TRACKS)).unwrap();
    let values = [1.0 / 3.0, f64::NAN, -4.9e-324, 5e-5];
    let labels = ["a_T", "b_T", "c,d", "e_T"].map(str::to_owned).to_vec();
    let flux = Frame::of_values(Schema::channels("m/1", "flux_tesla", labels), values.to_vec()).unwrap();
    let lines = Frame::new(
        Schema::events("lor/1", &["x1_mm", "x2_mm"]),
        vec![Column::F64(vec![0.1, 0.2]), Column::F64(vec![0.3, 0.4])],
        vec![true, false],
    )
    .unwrap();
    let image_schema = Arc::new(Schema {
        name: "image/1".into(),
        columns: vec![ColumnSpec { name: "jpeg".into(), kind: ColumnKind::Bytes }],
        rows: Rows::Events,
    });
    let jpeg = vec![0xff, 0xd8, 1, 2, 3];
    let image = Frame::new(image_schema, vec![Column::Bytes(jpeg.clone())], vec![true]).unwrap();
    for (sensor, frame) in [("belt", flux), ("scanner", lines), ("camera", image)] {
        observer
            .on(&RunEvent::Reading { reading: &reading(sensor, 0.000_000_001, frame), labels: None })
            .unwrap();
    }
    observer.finish().unwrap();
    let text = |name: &str| std::fs::read_to_string(folder.path().join("readings").join(name)).unwrap();
    let belt = text("belt.csv");
    let mut rows = belt.lines();
    assert_eq!(rows.next(), Some("t_s,sequence,start_s,end_s,arrival_s,a_T,b_T,\"c,d\",e_T"));
    let cells: Vec<&str> = rows.next().unwrap().split(',').collect();
    let place = "0.000000001,3,0.000000001,0.000000001,0.000000001";
    assert_eq!((cells[..5].join(","), cells[6]), (place.to_owned(), ""));
    for (cell, value) in [(5, 0), (7, 2), (8, 3)] {
        assert_eq!(cells[cell].parse::<f64>().unwrap().to_bits(), values[value].to_bits());
    }
    let header = "t_s,sequence,start_s,end_s,arrival_s";
    assert_eq!(text("scanner.csv"), format!("{header},x1_mm,x2_mm\n{place},0.1,0.3\n{place},,\n"));
    assert_eq!(text("camera/frames.csv"), format!("{header},file\n{place},00000003.jpg\n"));
    assert_eq!(std::fs::read(folder.path().join("readings/camera/00000003.jpg")).unwrap(), jpeg);
    let poses = tum::read(&folder.path().join("readings/belt.array.tum")).unwrap();
    assert_eq!(poses[0].1.translation.x, 0.5);
}

#[test]
fn law_results_are_not_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let target = run(&folder.path().join("out"));
    std::fs::write(target.join("plot.png"), "x").unwrap();
    assert!(matches!(RunFolder::create(&target, false), Err(ReportError::Exists(_))));
    // Replaced only at the end, and not by a run that fails.
    drop(RunFolder::create(&target, true).unwrap());
    assert!(target.join("plot.png").exists());
    let new = RunFolder::create(&target, true).unwrap();
    std::fs::write(new.path().join("result"), "y").unwrap();
    new.commit().unwrap();
    assert!(target.join("result").exists() && !target.join("plot.png").exists());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn law_only_what_is_ours_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("thesis");
    std::fs::create_dir(&target).unwrap();
    // An empty folder may be replaced.
    RunFolder::create(&target, true).unwrap().commit().unwrap();
    let refused = || {
        let error = RunFolder::create(&target, true).unwrap_err();
        assert!(matches!(error, ReportError::NotOurs { .. }), "{error:?}");
        assert!(error.to_string().contains("thesis is not replaced"), "{error}");
    };
    // Somebody's work, also with a manifest of another program, also with a `trials` folder of its own.
    std::fs::write(target.join("chapter-1.tex"), "x").unwrap();
    refused();
    std::fs::write(target.join("manifest.json"), "{\"name\": \"a web page\"}").unwrap();
    refused();
    std::fs::create_dir_all(target.join("trials/patients")).unwrap();
    refused();
    std::fs::remove_file(target.join("chapter-1.tex")).unwrap();
    std::fs::remove_file(target.join("manifest.json")).unwrap();
    refused();
    assert!(target.join("trials/patients").is_dir());
    // Trials that were stopped: finished runs, and what a killed one was filling.
    std::fs::remove_dir(target.join("trials/patients")).unwrap();
    std::fs::create_dir(target.join("trials/.001.partial-7-0")).unwrap();
    run(&target.join("trials/000"));
    drop(RunFolder::create(&target, true).unwrap());
    let file = folder.path().join("file");
    std::fs::write(&file, "x").unwrap();
    assert!(matches!(RunFolder::create(&file, true), Err(ReportError::NotOurs { .. })));
}

#[cfg(unix)]
#[test]
fn law_replacing_a_link_keeps_what_it_points_to() {
    let folder = tempfile::tempdir().unwrap();
    let real = run(&folder.path().join("real"));
    let link = folder.path().join("link");
    std::os::unix::fs::symlink(&real, &link).unwrap();
    RunFolder::create(&link, true).unwrap().commit().unwrap();
    assert!(real.join("metrics.json").is_file(), "the run behind the link is gone");
    assert!(!link.symlink_metadata().unwrap().is_symlink());
}

#[test]
fn law_a_manifest_tells_the_same_run_from_another() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(&folder.path().join("out"));
    let manifest: Manifest = read_json(&out.join("manifest.json")).unwrap();
    assert_eq!(manifest.random_streams_version, 1);
    assert!(manifest.is_whole(&out));
    let mut same = manifest.clone();
    same.provenance.command_line.clear();
    same.machine.cores += 1;
    assert_eq!(manifest.first_difference(&same), None);
    let differs = |change: &dyn Fn(&mut Manifest), word: &str| {
        let mut other = manifest.clone();
        change(&mut other);
        let said = manifest.first_difference(&other).unwrap_or_default();
        assert!(said.contains(word), "expected `{word}` in `{said}`");
    };
    differs(&|m| m.scenario_toml.push('#'), "scenario");
    differs(&|m| m.seed += 1, "seed (7)");
    differs(&|m| m.trial += 1, "trial (0)");
    differs(&|m| m.lumenav_version.push('x'), "version");
    differs(&|m| m.random_streams_version += 1, "version");
    differs(&|m| m.provenance.git_changes = Some("x".into()), "revision");
    differs(&|m| m.machine.arch.push('x'), "machine");
    differs(&|m| drop(m.provenance.settings.insert("record".into(), "full".into())), "outputs");
    differs(&|m| drop(m.provenance.inputs.insert("helix.toml".into(), "01".into())), "helix.toml");
    differs(&|m| drop(m.provenance.inputs.insert("new.toml".into(), "01".into())), "new.toml");
    differs(&|m| m.provenance.inputs.clear(), "helix.toml");
    std::fs::write(out.join("truth.tum"), "").unwrap();
    assert!(!manifest.is_whole(&out));
}

#[test]
fn law_what_appears_meanwhile_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("out");
    let new = RunFolder::create(&target, false).unwrap();
    std::fs::create_dir(&target).unwrap();
    assert!(matches!(new.commit(), Err(ReportError::Exists(_))));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn law_a_folder_that_cannot_be_made_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "x").unwrap();
    let error = RunFolder::create(&file.join("out"), false).unwrap_err().to_string();
    assert!(error.starts_with("cannot create folder ") && error.contains("file"), "{error}");
    assert!(matches!(RunFolder::create(Path::new("/"), false), Err(ReportError::NoName(_))));
}

#[test]
fn law_a_failed_write_stops_the_run_and_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("out");
    let mut writer = RunWriter::create(&target, WriterOptions::default()).unwrap();
    // In the place of a file stands a folder.
    std::fs::create_dir(writer.path().join("events.jsonl")).unwrap();
    let error = synthetic::play(&mut writer, 1.0, 10.0, &TRACKS).unwrap_err().to_string();
    assert!(error.contains("cannot create ") && error.contains("events.jsonl"), "{error}");
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Puts periods into the header on its way to the metrics.
struct WithPeriods(MetricsObserver);

impl RunObserver for WithPeriods {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        let period = |name: &str, from_s: f64, to_s: f64| PeriodTable {
            name: name.to_owned(),
            from_s: NonNegative(from_s),
            to_s: Positive(to_s),
        };
        let periods =
            vec![period("early", 0.0, 12.0), period("late", 12.0, 99.0), period("never", 98.0, 99.0)];
        self.0.start(&RunHeader { periods, ..header.clone() })
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.0.on(event)
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.0.finish()
    }
}

#[test]
fn closed_form_periods_add_up_to_the_run() {
    let mut observer = WithPeriods(MetricsObserver::in_memory());
    synthetic::play(&mut observer, 30.0, 10.0, &TRACKS).unwrap();
    for track in observer.0.metrics().unwrap().tracks.values() {
        let [early, late, never] = ["early", "late", "never"].map(|name| &track.periods[name]);
        let all = track.position_error_mm.unwrap();
        let (a, b) = (early.position_error_mm.unwrap(), late.position_error_mm.unwrap());
        assert_eq!(early.judged + late.judged, track.judged);
        assert!(early.judged > 100 && late.judged > early.judged);
        let (n, m) = (early.judged as f64, late.judged as f64);
        assert!(((n * a.mean + m * b.mean) / (n + m) - all.mean).abs() < 1e-12 * all.mean);
        assert_eq!(a.max.max(b.max), all.max);
        assert!(a.max != b.max);
        assert_eq!((never.judged, never.position_error_mm, never.availability), (0, None, None));
        let share = 0.4 * early.availability.unwrap() + 0.6 * late.availability.unwrap();
        assert!((share - track.availability.unwrap()).abs() < 2e-3, "{share} {:?}", track.availability);
    }
}
