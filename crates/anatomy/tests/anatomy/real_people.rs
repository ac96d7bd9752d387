//! Centre lines of real people, where `LUMENAV_DATA` names the folder with `tracts/` (GCA-Models, CC BY 4.0).

use lumenav_anatomy::bends::Bends;
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_anatomy::{SegmentKey, Tract, TractReport};
use lumenav_core::{ConfigError, Node};
use std::path::{Path, PathBuf};

pub(crate) fn data(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LUMENAV_DATA").map(|folder| Path::new(&folder).join("tracts"));
    match &folder {
        Some(_) => println!("REAL-DATA ran {test}"),
        None => println!("{test}: SKIPPED (LUMENAV_DATA unset)"),
    }
    folder
}

/// Lengths that the file itself states, m.
const STATED_M: [(SegmentKey, f64); 12] = [
    (SegmentKey::Oesophagus, 0.2305),
    (SegmentKey::Stomach, 0.1816),
    (SegmentKey::Duodenum, 0.1417),
    (SegmentKey::Jejunum, 0.9537),
    (SegmentKey::Ileum, 1.0904),
    (SegmentKey::TerminalIleum, 0.0757),
    (SegmentKey::Caecum, 0.0662),
    (SegmentKey::Ascending, 0.1184),
    (SegmentKey::Transverse, 0.3348),
    (SegmentKey::Descending, 0.3935),
    (SegmentKey::Sigmoid, 0.1942),
    (SegmentKey::Rectum, 0.0740),
];

#[test]
fn published_complete_tract_of_one_person_has_the_stated_lengths() {
    let Some(data) = data("published_complete_tract_of_one_person_has_the_stated_lengths") else { return };
    let node = Node::open(&data.join("gi_tract_edin00090.toml")).unwrap();
    let (tract, report) = load(&node, &TractOptions::default()).unwrap();
    assert_eq!(tract.segments.len(), STATED_M.len());
    for (segment, (key, stated_m)) in tract.segments.iter().zip(STATED_M) {
        assert_eq!(segment.key, key);
        let ratio = segment.length_m() / stated_m;
        println!(
            "{:<15} {:.4} m, stated {stated_m:.4} m ({:+.2} %)",
            segment.key,
            segment.length_m(),
            100.0 * (ratio - 1.0)
        );
        // 2 % and the rounding of the stated length. The bridge to the caecum is one chord of 37 mm in the stated length; a smooth curve is longer.
        let tolerance = if key == SegmentKey::TerminalIleum { 0.08 } else { 0.02 + 0.00005 / stated_m };
        assert!((ratio - 1.0).abs() < tolerance, "{key}: {ratio}");
    }
    // LPS became RAS: the ascending colon lies on the right, which is +x.
    let middle =
        |key| tract.segment(key).map(|s| tract.station(0.5 * (s.start_m + s.end_m)).position_m).unwrap();
    assert!(middle(SegmentKey::Ascending).x > 0.0 && middle(SegmentKey::Descending).x < 0.0);
    assert!(report.bridges.iter().any(|b| b.after == SegmentKey::Caecum && (b.gap_m - 0.0372).abs() < 1e-4));
    println!("{}", report.warnings.join("\n"));
}

fn csv(
    folder: &Path,
    file: &str,
    names: &str,
    keep: &[SegmentKey],
) -> Result<(Tract, TractReport), ConfigError> {
    let text =
        format!("[tract]\nframe = \"lps\"\ncentre_line_csv = \"{file}\"\nsegment_names = {{ {names} }}\n");
    let node = Node::parse_text(&text, "tract.toml", folder, &[])?;
    load(&node, &TractOptions { segments: keep.to_vec(), ..TractOptions::default() })
}

#[test]
fn published_centre_line_csvs_load_and_unknown_names_are_explained() {
    let Some(data) = data("published_centre_line_csvs_load_and_unknown_names_are_explained") else { return };
    let file = "EdinGCA_3D_00090_centerline.csv";
    let error = csv(&data, file, "", &[]).unwrap_err().to_string();
    assert!(
        error.contains("esophagus_part") && error.contains("segment_names") && error.contains(":3:"),
        "{error}"
    );
    let names = "esophagus_part = \"oesophagus\", cecum_colon = \"caecum\"";
    let keep = [SegmentKey::Duodenum, SegmentKey::Jejunum, SegmentKey::Ileum, SegmentKey::TerminalIleum];
    let (small_bowel, _) = csv(&data, file, names, &keep).unwrap();
    // 2.30 m in the reference, which counts the terminal ileum without the 60 mm to the caecum.
    let length_m = small_bowel.length_m();
    assert!((length_m / 2.30 - 1.0).abs() < 0.05, "small bowel {length_m} m");

    // The other person's terminal ileum ends too far from the caecum to be bridged; the colon alone is whole.
    let (file, names) = ("HuBMAPVHM_3D_00070_centerline.csv", "sigmoid_rectum = \"sigmoid\"");
    let error = csv(&data, file, names, &[]).unwrap_err().to_string();
    assert!(
        error.contains("`terminal_ileum` ends 0.0597") && error.contains("before `caecum` begins"),
        "{error}"
    );
    let keep = [
        SegmentKey::Caecum,
        SegmentKey::Ascending,
        SegmentKey::Transverse,
        SegmentKey::Descending,
        SegmentKey::Sigmoid,
    ];
    let (colon, _) = csv(&data, file, names, &keep).unwrap();
    println!("Visible Human male: {:?}", Bends::of(&colon.centre_line, 0.0, colon.length_m()));
    assert!((colon.length_m() / 1.39 - 1.0).abs() < 0.05, "colon {} m", colon.length_m());
}
