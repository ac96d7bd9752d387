//! A controller moves a scanner after the capsule, by what a track has published.

use crate::support::{Run, root, scratch};
use lumenav::records::tum;
use lumenav::report::{Metrics, read_json};
use std::fmt::Write as _;
use std::path::Path;

/// Ten seconds along the axis of the reduced scanner, out of a cylinder of water and 110 mm beyond the end of the blocks.
fn scenario(controller: &str) -> String {
    format!(
        "[scenario]\nname = \"bed\"\nduration_s = 10.0\n[capsule]\nmodel = \"hybrid\"\n\
         [truth]\nkind = \"line\"\nfrom_mm = [20, 0, 0]\nto_mm = [30, 10, 200]\nspeed_mm_s = 20\n\
         [[sensor]]\nname = \"scanner\"\nmodality = \"pet\"\n[sensor.schedule]\nrate_hz = 20\n\
         [sensor.installed]\nscanner = \"reduced\"\nphantom = \"water-20\"\n\
         [[sensor]]\nname = \"belt\"\nmodality = \"magnetic\"\n[sensor.schedule]\nrate_hz = 1\n\
         [sensor.installed]\narray = \"belt-16\"\n\
         [[track]]\nname = \"pet\"\nsensors = [\"scanner\"]\n[track.sensor.scanner]\nfront_end = \"lines\"\n{controller}"
    )
}

fn controller(table: &str, law: &str) -> String {
    format!("[[controller]]\nname = \"bed\"\n{table}\n[controller.law]\n{law}\n")
}

fn run(folder: &Path, name: &str, text: &str) -> Run {
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, text).expect("a scratch file");
    let models = root().join("models");
    Run::new(&file).out(&folder.join(name)).arg("--models").arg(models).arg("--record").arg("none")
}

fn metrics(folder: &Path, name: &str, controller: &str) -> Metrics {
    run(folder, name, &scenario(controller)).ok();
    read_json(&folder.join(name).join("metrics.json")).expect("metrics")
}

#[test]
fn law_the_bed_keeps_the_capsule_in_view_and_the_estimates_in_the_patient() {
    let folder = scratch();
    let law = controller("track = \"pet\"\nsensor = \"scanner\"", "kind = \"bed\"\ndead_band_mm = 5");
    let (with, without) = (metrics(folder.path(), "with", &law), metrics(folder.path(), "without", ""));
    let (pet, bed) = (&with.tracks["pet"], &with.controllers["bed"]);
    let errors = pet.position_error_mm.as_ref().expect("errors");
    // The scanner has gone after the capsule, and what is estimated is the capsule in the patient, not in the scanner.
    assert!((140.0..200.0).contains(&bed.range_z_mm[1]), "{bed:?}");
    assert!(pet.availability > Some(0.97) && errors.p95 < 2.0, "{:?} {errors:?}", pet.availability);
    // A scanner that stands loses it behind its last ring, at 91 of 200 mm.
    let left = &without.tracks["pet"];
    assert!(left.availability < Some(0.65), "{:?}", left.availability);
    assert!(without.controllers.is_empty());
}

#[test]
fn law_a_moved_scanner_tells_its_place_and_replays_to_the_same_track() {
    let folder = scratch();
    let law = controller("track = \"pet\"\nsensor = \"scanner\"", "kind = \"bed\"\ndead_band_mm = 5");
    let mut text = scenario(&law);
    text = text.replace("duration_s = 10.0", "duration_s = 3.0");
    run(folder.path(), "saved", &text).arg("--save-readings").ok();
    let readings = folder.path().join("saved/readings");
    let places = tum::read(&readings.join("scanner.scanner.tum")).expect("places by the encoder");
    assert!(places.first().expect("a row").1.translation.z.abs() < 1e-3);
    assert!(places.last().expect("a row").1.translation.z > 0.02);
    let mut replay = String::from("[scenario]\nname = \"again\"\n[capsule]\nmodel = \"hybrid\"\n");
    write!(
        replay,
        "[[sensor]]\nname = \"scanner\"\nmodality = \"pet\"\n[sensor.installed]\nscanner = \"reduced\"\n\
         [sensor.files]\nlines = {:?}\nposes = {{ scanner = {:?} }}\n[[track]]\nname = \"pet\"\nsensors = [\"scanner\"]\n\
         [track.sensor.scanner]\nfront_end = \"lines\"\n",
        readings.join("scanner.csv"),
        readings.join("scanner.scanner.tum")
    )
    .expect("text grows");
    let file = folder.path().join("again.toml");
    std::fs::write(&file, replay).expect("a scratch file");
    let again = folder.path().join("again");
    let output = crate::support::lumenav()
        .args(["replay", "--record", "none", "--models"])
        .arg(root().join("models"))
        .arg("--out")
        .arg(&again)
        .arg(&file)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let track = |folder: &Path| std::fs::read(folder.join("pet.tum")).expect("a track");
    assert_eq!(track(&folder.path().join("saved")), track(&again));
}

#[test]
fn law_what_cannot_be_moved_or_followed_is_named() {
    let folder = scratch();
    let to_scanner = "track = \"pet\"\nsensor = \"scanner\"";
    for (name, text, words) in [
        (
            "belt",
            scenario(&controller("track = \"pet\"\nsensor = \"belt\"", "kind = \"bed\"")),
            "`belt` cannot be moved",
        ),
        (
            "sensor",
            scenario(&controller("track = \"pet\"\nsensor = \"table\"", "kind = \"bed\"")),
            "no sensor `table`",
        ),
        (
            "track",
            scenario(&controller("track = \"magnetic\"\nsensor = \"scanner\"", "kind = \"bed\"")),
            "no track `magnetic`",
        ),
        (
            "kind",
            scenario(&controller(to_scanner, "kind = \"crane\"")),
            "unknown controller `crane`; allowed: bed",
        ),
        ("key", scenario(&controller(to_scanner, "kind = \"bed\"\nspeed = 1")), "unknown field `speed`"),
        (
            "tables",
            scenario(&controller(to_scanner, "kind = \"bed\"")).replace(
                "phantom = \"water-20\"\n",
                "phantom = \"water-20\"\n[sensor.reality]\nmode = \"tabulated\"\n",
            ),
            "mode `tabulated`",
        ),
    ] {
        let message = run(folder.path(), name, &text).fails(3);
        assert!(message.contains(words) && message.contains(&format!("{name}.toml")), "{name}: {message}");
        assert!(!folder.path().join(name).exists(), "a refused run left its folder");
        let dry = run(folder.path(), name, &text).arg("--dry-run").fails(3);
        assert!(dry.contains(words), "{name}, dry run: {dry}");
    }
}
