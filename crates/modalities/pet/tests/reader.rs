//! Recorded lines: written by hand, read back; what is wrong is reported with its line.

#![allow(clippy::format_collect, reason = "rows of test files")]

use lumenav_core::{
    CapsuleBody, ModalityError, ModelFolder, Name, Node, Reading, Recorded, Rows, Setup, SimTime,
};
use lumenav_pet::reader::open;
use lumenav_pet::{CrystalIndex, Line, Scanner, payload};
use nalgebra::Vector3;
use parquet::data_type::{DoubleType, FloatType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use proptest::prelude::*;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models")
}

fn scanner(name: &str) -> Scanner {
    Scanner::from_node(&Node::open(&models().join(format!("scanners/{name}.toml"))).unwrap()).unwrap()
}

fn setup() -> Setup {
    Setup {
        sensor: Name::from("pet"),
        schedule: None,
        capsule: CapsuleBody { radius_m: 6e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: Node::parse_text("", "c.toml", Path::new(""), &[]).unwrap(),
        models: ModelFolder::new(models()),
        map: None,
    }
}

/// A folder with what a test writes.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.0.path().join(name), bytes).unwrap();
    }

    fn pack(&self, name: &str, text: &str) {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        packed.write_all(text.as_bytes()).unwrap();
        self.write(name, packed.finish().unwrap());
    }

    fn read(&self, of: &str, files: &str) -> Result<Vec<Result<Recorded, ModalityError>>, ModalityError> {
        let node = Node::parse_text(files, "s.toml", self.0.path(), &[]).unwrap();
        Ok(open(&scanner(of), &node, &setup())?.collect())
    }

    fn readings(&self, of: &str, files: &str) -> Vec<Reading> {
        self.read(of, files).unwrap().into_iter().map(|r| read_of(r.unwrap())).collect()
    }

    /// The first error, of opening or reading.
    fn error(&self, of: &str, files: &str) -> String {
        match self.read(of, files) {
            Err(error) => error.to_string(),
            Ok(all) => all.into_iter().find_map(Result::err).expect("no error").to_string(),
        }
    }

    /// Number of lines read, and what was passed over in words.
    fn skipping(&self, of: &str, files: &str) -> (usize, Vec<String>) {
        let (mut lines, mut skipped) = (0, Vec::new());
        for item in self.read(of, &format!("{files}\nbad_rows = \"skip\"")).unwrap() {
            match item.unwrap() {
                Recorded::Reading(reading) => lines += reading.payload.rows(),
                Recorded::Skipped(error) => skipped.push(error.to_string()),
            }
        }
        (lines, skipped)
    }
}

fn read_of(recorded: Recorded) -> Reading {
    match recorded {
        Recorded::Reading(reading) => reading,
        Recorded::Skipped(error) => panic!("passed over: {error}"),
    }
}

fn lines_of(reading: &Reading) -> Vec<Line> {
    let mut lines = Vec::new();
    assert_eq!(payload::lines(&reading.payload, &mut lines).unwrap(), 0);
    lines
}

fn rows_of(readings: &[Reading]) -> Vec<[f64; 7]> {
    let row = |r: &Reading, i: usize| payload::COLUMNS.map(|c| r.payload.f64(c).unwrap()[i]);
    readings.iter().flat_map(|r| (0..r.payload.rows()).map(|i| row(r, i)).collect::<Vec<_>>()).collect()
}

const HEADER: &str = "t_ms,x1_mm,y1_mm,z1_mm,x2_mm,y2_mm,z2_mm\n";
const ROWS: [[f64; 7]; 4] = [
    [0.5, 1.25, 440.1, -3.0, 2.0, -440.0, 4.0],
    [49.75, 0.1, 440.2, -3.5, 2.5, -440.5, 4.5],
    [50.0, -0.3, 440.3, 0.0, 3.0, -441.0, 5.0],
    [180.125, 7.0, 440.4, 1.0, 3.5, -441.5, 5.5],
];

fn text_of(rows: &[[f64; 7]], separator: &str) -> String {
    let row = |r: &[f64; 7]| r.map(|v| format!("{v:?}")).join(separator) + "\n";
    rows.iter().map(row).collect()
}

#[test]
fn closed_form_lines_with_and_without_header_in_all_separators() {
    let folder = Folder::new();
    folder.write("a.csv", format!("# a comment\n{HEADER}{}", text_of(&ROWS, ",")));
    folder.write("b.txt", text_of(&ROWS, " "));
    folder.write("c.txt", text_of(&ROWS, " ; ").replace('\n', "\r\n\r\n"));
    folder.pack("d.csv.gz", &format!("{HEADER}{}", text_of(&ROWS, ",")));
    // As NumPy writes an array of nine columns.
    let numpy = |r: &[f64; 7]| r.map(|v| format!("{v:.18e}")).join(" ") + " 0.0e+00 1.0e+00\n";
    folder.write("e.csv", ROWS.iter().map(numpy).collect::<String>());
    let turned = |r: &[f64; 7]| format!("x,{},{},{},{},{},{},{}\n", r[6], r[5], r[4], r[3], r[2], r[1], r[0]);
    let header = "\"note\", z2_mm ,\"y2_mm\",x2_mm,z1_mm,y1_mm,x1_mm,t_ms\n";
    folder.write("f.csv", format!("{header}{}", ROWS.iter().map(turned).collect::<String>()));
    for name in ["a.csv", "b.txt", "c.txt", "d.csv.gz", "e.csv", "f.csv"] {
        let readings = folder.readings("allegro", &format!("lines = \"{name}\""));
        assert_eq!(rows_of(&readings), ROWS, "{name}");
        assert_eq!(&*readings[0].payload.schema().name, "lines_of_response/1");
        assert_eq!(readings[0].payload.schema().rows, Rows::Events);
    }
    let shifted = folder.readings("allegro", "lines = \"a.csv\"\norigin_mm = [1, 2, 3]\ntime_zero_ms = 0.5");
    let first = lines_of(&shifted[0])[0];
    assert_eq!(first.t_s, 0.0);
    assert!((first.ends_world_m[0] - Vector3::new(2.25e-3, 0.4421, 0.0)).norm() < 1e-15);
    assert!((first.ends_world_m[1] - Vector3::new(3e-3, -0.438, 7e-3)).norm() < 1e-15);
}

#[test]
fn closed_form_windows_by_time_and_by_count() {
    let folder = Folder::new();
    folder.write("a.csv", format!("{HEADER}{}", text_of(&ROWS, ",")));
    let shape = |files: &str| -> Vec<(u64, i64, i64, usize)> {
        let files = format!("lines = \"a.csv\"\n{files}");
        let readings = folder.readings("allegro", &files);
        let us = |t: SimTime| t.0 / 1000;
        readings.iter().for_each(|r| assert_eq!(r.arrival, r.interval.1));
        readings.iter().map(|r| (r.sequence, us(r.interval.0), us(r.interval.1), r.payload.rows())).collect()
    };
    // Default: 50 ms; a window without lines is a reading without lines.
    let by_time =
        [(0, 0, 50_000, 2), (1, 50_000, 100_000, 1), (2, 100_000, 150_000, 0), (3, 150_000, 200_000, 1)];
    assert_eq!(shape(""), by_time);
    assert_eq!(shape("window_ms = 200"), [(0, 0, 200_000, 4)]);
    let overlapping = [(0, 0, 100_000, 3), (1, 50_000, 150_000, 1), (2, 100_000, 200_000, 1)];
    assert_eq!(shape("window_ms = 100\noverlap = 0.5"), overlapping);
    assert_eq!(shape("window_lines = 3"), [(0, 500, 50_000, 3), (1, 180_125, 180_125, 1)]);
    assert_eq!(
        shape("window_lines = 2\noverlap = 0.5"),
        [(0, 500, 49_750, 2), (1, 49_750, 50_000, 2), (2, 50_000, 180_125, 2)]
    );
    // A pause beyond `max_gap_s` is a bad row; passed over, it leaves a hole in the sequence.
    let message = folder.error("allegro", "lines = \"a.csv\"\nmax_gap_s = 0.1");
    assert!(message.contains("a.csv:5: ") && message.contains("no line for 0.130 s"), "{message}");
    let (lines, skipped) = folder.skipping("allegro", "lines = \"a.csv\"\nmax_gap_s = 0.1\nwindow_ms = 1");
    assert_eq!((lines, skipped.len()), (4, 1));
}

#[test]
fn law_a_long_pause_makes_no_endless_readings() {
    let folder = Folder::new();
    let rows = [ROWS[0], [1e12, 7.0, 440.4, 1.0, 3.5, -441.5, 5.5]];
    folder.write("a.csv", format!("{HEADER}{}", text_of(&rows, ",")));
    let all = folder.read("allegro", "lines = \"a.csv\"\nbad_rows = \"skip\"").unwrap();
    assert!(all.len() < 5, "{}", all.len());
    let Some(Ok(Recorded::Reading(last))) = all.last() else { panic!("no last reading") };
    assert_eq!((last.sequence, last.payload.rows()), (20_000_000_000, 1));
}

#[test]
fn closed_form_list_mode_is_the_line_between_the_crystals() {
    let folder = Folder::new();
    folder.write("a.csv", "t_ms,xa,za,xb,zb\n1.5,0,0,300,28\n2.5,21,14,310,3\n");
    let readings = folder.readings("allegro", "lines = \"a.csv\"");
    let allegro = scanner("allegro");
    let lines = lines_of(&readings[0]);
    assert_eq!(lines.len(), 2);
    for (line, [xa, za, xb, zb]) in lines.iter().zip([[0, 0, 300, 28], [21, 14, 310, 3]]) {
        for (end, (x, z)) in line.ends_world_m.iter().zip([(xa, za), (xb, zb)]) {
            assert!((end - allegro.position(CrystalIndex { x, z }).unwrap()).norm() < 1e-12);
        }
    }
    assert_eq!(lines[0].t_s, 1.5e-3);
    folder.write("b.txt", "1.5 0 0 300 28\n");
    assert_eq!(folder.readings("allegro", "lines = \"b.txt\"\nformat = \"list-mode\"").len(), 1);
    let message = folder.error("allegro", "lines = \"b.txt\"");
    assert!(message.contains("`list-mode` or `two-plane`?"), "{message}");
    for (row, wanted) in [
        ("1.5,616,0,300,28", "column `xa` holds 616; scanner `allegro` has 0 to 615"),
        ("1.5,0,0,300,29", "column `zb` holds 29; scanner `allegro` has 0 to 28"),
        ("1.5,-1,0,300,2", "column `xa` holds -1"),
        ("1.5,0.5,0,300,2", "column `xa` holds 0.5"),
        ("1.5,0,0,1e99,2", "column `xb` holds"),
        ("1.5,0,0,22,2", "blocks 0 and 1 of scanner `allegro` do not fire together"),
        ("1.5,0,0,0,0", "do not fire together"),
    ] {
        folder.write("c.csv", format!("t_ms,xa,za,xb,zb\n1.0,0,0,300,28\n{row}\n2.0,0,0,300,28\n"));
        let message = folder.error("allegro", "lines = \"c.csv\"");
        assert!(message.contains("c.csv:3: ") && message.contains(wanted), "{row}: {message}");
        let (lines, skipped) = folder.skipping("allegro", "lines = \"c.csv\"");
        assert_eq!((lines, skipped.len()), (2, 1));
    }
}

const TWO_PLANE: &str = "Some laboratory\n\nTwo screens are separated by 712 mm.\nColumns are [t, x1, y1, x2, y2], 1 2 3\n\n\
                         Separation=   712\nFixed slices:    250 events\n\n  0.9\t279.7\t134.5\t198.2\t114.5\n  1.0\t301.75\t301.75\t301.75\t301.75\n";

#[test]
fn closed_form_two_planes_are_moved_to_the_scanner() {
    let folder = Folder::new();
    folder.pack("a.csv.gz", TWO_PLANE);
    let readings = folder.readings("adac-forte", "lines = \"a.csv.gz\"\nwindow_lines = 200");
    let rows = rows_of(&readings);
    assert_eq!(rows[1], [1.0, 0.0, 0.0, -356.0, 0.0, 0.0, 356.0]);
    let wanted = [0.9, -22.05, -167.25, -356.0, -103.55, -187.25, 356.0];
    for (ours, wanted) in rows[0].iter().zip(wanted) {
        assert!((ours - wanted).abs() < 1e-9);
    }
    let message = folder.error("adac-forte-600", "lines = \"a.csv.gz\"");
    assert!(message.contains("712 mm apart") && message.contains("adac-forte-600"), "{message}");
    let message = folder.error("allegro", "lines = \"a.csv.gz\"");
    assert!(message.contains("not two planes"), "{message}");
    for (text, wanted) in [
        (TWO_PLANE.replace("Separation=   712\n", ""), "does not say `Separation"),
        (TWO_PLANE.replace("=   712", "= x"), "no distance of two planes"),
        (TWO_PLANE[..60].to_owned() + "\n", "no row of five numbers"),
        (format!("{TWO_PLANE}1.1\t2\t3\t4\n"), ":11: 4 columns, expected 5"),
        (format!("{TWO_PLANE}1.1\t2\t3\t4\tx\n"), ":11: column 5 (`y2`) holds `x`"),
        (format!("{TWO_PLANE}  7"), ":11: 1 columns, expected 5: t_ms x1 y1 x2 y2, and no line end"),
        (format!("{TWO_PLANE}1.1\t2\t3\t4\t5\t6\n"), ":11: more than 5 columns"),
    ] {
        folder.write("b.txt", &text);
        let message = folder.error("adac-forte", "lines = \"b.txt\"\nformat = \"two-plane\"");
        assert!(message.contains(wanted), "{message}");
    }
}

#[test]
fn law_bad_rows_stop_or_are_counted() {
    let folder = Folder::new();
    let good = text_of(&ROWS[..2], ",");
    for (row, wanted) in [
        ("60,1,2,3,4,5\n", "bad.csv:4: 6 columns, expected 7"),
        ("60,1,2,3,4,5,6,7\n", "bad.csv:4: 8 columns, expected 7"),
        ("60,1,2,nan,4,5,6\n", "bad.csv:4: column 4 (`z1_mm`) holds `nan`; a finite number"),
        ("60,1,2,inf,4,5,6\n", "column 4 (`z1_mm`) holds `inf`"),
        ("60,1,2,3,4,1e400,6\n", "column 6 (`y2_mm`) holds `1e400`"),
        ("60,1,2,3,,5,6\n", "bad.csv:4: column 5 (`x2_mm`) is empty"),
        ("60,1,2,3,4mm,5,6\n", "column 5 (`x2_mm`) holds `4mm`"),
        ("60,1,2,3,1,2,3\n", "bad.csv:4: a line of length zero"),
        ("60,1,2,3,1,2,3.00001\n", "a line of length zero"),
        ("40,1,2,3,4,5,6\n", "bad.csv:4: time runs back from 49.75 to 40 ms"),
        ("60,1,2,3,4,5,60000\n", "a place beyond 10000 mm"),
        ("1e300,1,2,3,4,5,6\n", "out of range"),
        ("60,1,2,\u{fffd},4,5,6\n", "column 4 (`z1_mm`) holds"),
    ] {
        folder.write("bad.csv", format!("{HEADER}{good}{row}180,7,440,1,3,-440,5\n"));
        let message = folder.error("allegro", "lines = \"bad.csv\"");
        assert!(message.contains(wanted), "{row}: {message}");
        let (lines, skipped) = folder.skipping("allegro", "lines = \"bad.csv\"");
        assert_eq!((lines, skipped.len()), (3, 1), "{row}");
        assert!(skipped[0].contains(wanted), "{skipped:?}");
    }
}

#[test]
fn law_lines_that_are_not_the_scanners_are_bad_rows() {
    let folder = Folder::new();
    let changed = |change: &dyn Fn(f64) -> f64| {
        let row = |row: &[f64; 7]| {
            let mut row = *row;
            row[1..].iter_mut().for_each(|v| *v = change(*v));
            row
        };
        format!("{HEADER}{}", text_of(&ROWS.map(|r| row(&r)), ","))
    };
    for (what, text) in [
        ("metres", changed(&|v| 1e-3 * v)),
        ("inches", changed(&|v| v / 25.4)),
        ("another centre", changed(&|v| v + 50.0)),
        ("a smaller ring", changed(&|v| 0.9 * v)),
    ] {
        folder.write("a.csv", text);
        let message = folder.error("allegro", "lines = \"a.csv\"");
        assert!(
            message.contains("a.csv:2: an end at (") && message.contains("`allegro`"),
            "{what}: {message}"
        );
        // None is left.
        let all = folder.read("allegro", "lines = \"a.csv\"\nbad_rows = \"skip\"").unwrap();
        assert_eq!(all.len(), ROWS.len() + 1, "{what}");
        let last = all.last().unwrap().as_ref().unwrap_err().to_string();
        assert!(last.contains("a.csv") && last.contains("all 4 rows were refused"), "{what}: {last}");
    }
    // Between the blocks of the reduced scanner, which the full ring has.
    let turned = "1.0,311,311,0,-311,-311,0\n";
    folder.write("a.csv", format!("{HEADER}{turned}"));
    assert_eq!(folder.skipping("allegro", "lines = \"a.csv\""), (1, vec![]));
    assert!(folder.error("reduced", "lines = \"a.csv\"").contains("(311.0, 311.0, 0.0) mm is at no block"));
    // A frame whose centre is elsewhere, and said to be.
    folder.write("a.csv", changed(&|v| v + 50.0));
    let (lines, _) = folder.skipping("allegro", "lines = \"a.csv\"\norigin_mm = [-50, -50, -50]");
    assert_eq!(lines, ROWS.len());
}

#[test]
fn law_a_file_without_a_line_is_no_recording() {
    let folder = Folder::new();
    folder.write("a.csv", HEADER);
    let message = folder.error("allegro", "lines = \"a.csv\"");
    assert!(message.contains("a.csv:1: no line in this file"), "{message}");
}

#[test]
fn law_cut_files_are_never_taken_for_whole() {
    let folder = Folder::new();
    let text = format!("{HEADER}{}", text_of(&ROWS, ","));
    for cut in 1..text.len() {
        folder.write("cut.csv", &text[..cut]);
        let outcome = folder.read("allegro", "lines = \"cut.csv\"");
        let failed = outcome.as_ref().map_or(true, |all| all.iter().any(Result::is_err));
        // Cut between two lines nothing can be seen, and nothing is wrong with what is there.
        let is_whole = text[..cut].ends_with('\n') && cut > HEADER.len();
        assert_eq!(failed, !is_whole, "{cut}: {:?}", &text[..cut]);
    }
    folder.pack("whole.csv.gz", &text_of(&ROWS, ",").clone().replace("180.125", "180.5"));
    let packed = std::fs::read(folder.0.path().join("whole.csv.gz")).unwrap();
    for cut in [packed.len() - 1, packed.len() / 2, 11, 3] {
        folder.write("cut.csv.gz", &packed[..cut]);
        let message = folder.error("allegro", "lines = \"cut.csv.gz\"\nbad_rows = \"skip\"");
        assert!(message.contains("cut.csv.gz: "), "{message}");
    }
}

#[test]
fn law_bad_tables_are_refused_by_key() {
    let folder = Folder::new();
    folder.write("a.csv", format!("{HEADER}{}", text_of(&ROWS, ",")));
    folder.write("empty.csv", "");
    folder.write("other.csv", "time,x\n1,2\n");
    folder.write("few.txt", "1 2 3\n");
    folder.write("twice.csv", "t_ms,x1_mm,x1_mm,y1_mm,z1_mm,x2_mm,y2_mm,z2_mm\n");
    folder.write("saved.csv", format!("t_s,sequence,start_s,end_s,arrival_s,{HEADER}"));
    for (files, wanted) in [
        ("lines = \"none.csv\"", "`lines`: "),
        ("lines = \"a.csv\"\nwindow_lines = 0", "`window_lines`: 0 lines in a window; allowed: 1 to 1048576"),
        ("lines = \"a.csv\"\nwindow_ms = 0", "`window_ms`"),
        ("lines = \"a.csv\"\nwindow_ms = 1e-9", "`window_ms`"),
        ("lines = \"a.csv\"\nwindow_ms = 5\nwindow_lines = 5", "give one of the two"),
        ("lines = \"a.csv\"\noverlap = 1", "`overlap`: 1 is not allowed; allowed: 0 to 0.99"),
        ("lines = \"a.csv\"\nformat = \"nema\"", "`format`"),
        ("lines = \"a.csv\"\ncolour = 1", "unknown field `colour`"),
        ("lines = \"a.csv\"\nformat = \"list-mode\"", "no column `xa`; the file has: t_ms, x1_mm"),
        ("lines = \"a.csv\"\nposes = { bed = \"b.tum\" }", "only saved readings"),
        ("lines = \"empty.csv\"", "empty.csv:1: the file is empty"),
        ("lines = \"other.csv\"", "other.csv:1: no column `t_ms`; the file has: time, x"),
        ("lines = \"few.txt\"", "few.txt:1: 3 cells; expected 7"),
        ("lines = \"twice.csv\"", "column `x1_mm` is there twice"),
        ("lines = \"saved.csv\"\nwindow_ms = 50", "saved readings have their own windows"),
    ] {
        let message = folder.error("allegro", files);
        assert!(message.contains(wanted), "{files}: {message}");
    }
}

/// Numbers whose last bits are easily lost.
const ODD: [f64; 7] = [0.1 + 0.2, -0.0, 440.0 + 1.0 / 3.0, 5e-324, 4.0 / 7.0, -440.7, 0.1];

/// Saved readings as `--save-readings` lays them out: an empty one, a masked event, a late one.
fn saved() -> String {
    let mut text = format!("t_s,sequence,start_s,end_s,arrival_s,{HEADER}");
    let place = |n: u64, start: f64, late: f64| {
        format!("{:.9},{n},{start:.9},{:.9},{:.9},", start + 0.025, start + 0.05, start + 0.05 + late)
    };
    for row in &ROWS[..2] {
        text += &(place(0, 0.0, 0.0) + &text_of(&[*row], ","));
    }
    text += &(place(1, 0.05, 0.0) + ",,,,,,\n");
    text += &(place(3, 0.15, 0.0) + &text_of(&[ROWS[3]], ","));
    text += &(place(3, 0.15, 0.0) + ",,,,,,\n");
    text += &(place(2, 0.1, 0.2) + &text_of(&[ODD], ","));
    text
}

#[test]
fn law_saved_readings_read_back_to_the_same_readings() {
    let folder = Folder::new();
    folder.write("pet.csv", saved());
    folder.write(
        "pet.scanner.tum",
        "0.025 0 0 0.01 0 0 0 1\n0.075 0 0 0.02 0 0 0 1\n0.125 0 0 0.03 0 0 0 1\n0.175 0 0 0.04 0 0 0 1\n",
    );
    let readings =
        folder.readings("allegro", "lines = \"pet.csv\"\nposes = { scanner = \"pet.scanner.tum\" }");
    let shape: Vec<_> = readings.iter().map(|r| (r.sequence, r.payload.valid().to_vec())).collect();
    assert_eq!(shape, [(0, vec![true; 2]), (1, vec![]), (3, vec![true, false]), (2, vec![true])]);
    assert_eq!(readings[3].interval, (SimTime(100_000_000), SimTime(150_000_000)));
    assert_eq!(readings[3].arrival, SimTime(350_000_000));
    assert_eq!(readings[3].known_poses["scanner"].translation.vector.z, 0.03);
    let last = rows_of(&readings[3..]);
    assert_eq!(last[0].map(f64::to_bits), ODD.map(f64::to_bits));
    assert_eq!(rows_of(&readings[..1]), ROWS[..2]);
    folder.write("pet.scanner.tum", "0.025 0 0 0.01 0 0 0 1\n");
    let message = folder.error("allegro", "lines = \"pet.csv\"\nposes = { scanner = \"pet.scanner.tum\" }");
    assert!(message.contains("pet.csv:4: the file of pose `scanner` has none at 0.075000 s"), "{message}");
}

#[test]
fn law_bad_saved_rows_name_their_line() {
    let folder = Folder::new();
    for (from, to, wanted) in [
        ("0.150000000,0.200000000", "0.250000000,0.200000000", "starts, ends and arrives"),
        ("0.150000000,0.350000000", "0.150000000,0.050000000", ":7: a reading starts, ends and arrives"),
        ("0.150000000,0.350000000", "0.150000000,0.200000000", ":7: time 0.200000 s does not increase"),
        ("0.075000000,1,", "0.075000000,x,", ":4: `x` is no count"),
        ("0.075000000,1,", "nan,1,", ":4: column `t_s` holds `nan`"),
        ("0.5,1.25,", "0.5,", ":2: 11 columns, expected 12"),
        ("0.5,1.25", "0.5,?", ":2: column `x1_mm` holds `?`"),
        ("5.5\n", "5.5,1\n", "more than 12 columns"),
        ("z1_mm", "z_mm", ":1: the header must be t_s,sequence"),
    ] {
        let text = saved();
        assert!(text.contains(from), "{from}");
        let text = text.replace(from, to);
        folder.write("pet.csv", text);
        let message = folder.error("allegro", "lines = \"pet.csv\"");
        assert!(message.contains(wanted), "{from}: {message}");
    }
    let text = saved();
    folder.write("pet.csv", &text[..text.len() - 3]);
    let message = folder.error("allegro", "lines = \"pet.csv\"");
    assert!(message.contains("pet.csv:7: ") && message.contains("cut"), "{message}");
}

#[test]
fn law_saved_readings_of_another_scanner_or_of_nothing_are_refused() {
    let folder = Folder::new();
    folder.write("pet.csv", saved().replace("440.1", "340.1"));
    let message = folder.error("allegro", "lines = \"pet.csv\"");
    assert!(message.contains("pet.csv:2: an end at (") && message.contains("`allegro`"), "{message}");
    // The scanner stood 100 mm up: its own places are 100 mm lower than the world's.
    let up = ROWS.map(|row| [row[0], row[1], row[2], row[3] + 100.0, row[4], row[5], row[6] + 100.0]);
    let head = format!("t_s,sequence,start_s,end_s,arrival_s,{HEADER}");
    folder.write("pet.csv", head.clone() + "0.025,0,0,0.05,0.05," + &text_of(&up[..1], ","));
    let moved = "lines = \"pet.csv\"\nposes = { scanner = \"pet.scanner.tum\" }";
    for (z_m, is_there) in [("0.1", true), ("0", false)] {
        folder.write("pet.scanner.tum", format!("0.025 0 0 {z_m} 0 0 0 1\n"));
        assert_eq!(folder.read("allegro", moved).unwrap().iter().all(Result::is_ok), is_there, "{z_m}");
    }
    folder.write("pet.csv", head.clone());
    let message = folder.error("allegro", "lines = \"pet.csv\"");
    assert!(message.contains("no reading in this file"), "{message}");
    // A file of another scanner is no file of this one, whatever is passed over.
    folder.write(
        "pet.csv",
        head.clone() + "0.025,0,0,0.05,0.05," + &text_of(&ROWS[..1], ",").replace("440.1", "340.1"),
    );
    let message = folder.error("reduced", "lines = \"pet.csv\"\nbad_rows = \"skip\"");
    assert!(message.contains("all 1 were refused, the first: "), "{message}");
    let message = folder.error("allegro", "lines = \"pet.csv\"\nposes = { bed = \"pet.scanner.tum\" }");
    assert!(message.contains("no pose `bed`") && message.contains("`scanner`"), "{message}");
}

/// A Parquet file of `DOUBLE` columns.
fn parquet_file(path: &Path, names: &[&str], rows: &[Vec<f64>], packing: parquet::basic::Compression) {
    let schema: String = names.iter().map(|n| format!("REQUIRED DOUBLE {n}; ")).collect();
    let schema = Arc::new(parse_message_type(&format!("message lines {{ {schema} }}")).unwrap());
    let properties = Arc::new(WriterProperties::builder().set_compression(packing).build());
    let file = std::fs::File::create(path).unwrap();
    let mut writer = SerializedFileWriter::new(file, schema, properties).unwrap();
    for part in rows.chunks(10_000) {
        let mut group = writer.next_row_group().unwrap();
        let mut index = 0;
        while let Some(mut column) = group.next_column().unwrap() {
            let values: Vec<f64> = part.iter().map(|r| r[index]).collect();
            column.typed::<DoubleType>().write_batch(&values, None, None).unwrap();
            column.close().unwrap();
            index += 1;
        }
        group.close().unwrap();
    }
    writer.close().unwrap();
}

#[test]
fn law_parquet_is_equal_to_csv_in_every_packing() {
    use parquet::basic::Compression;
    let folder = Folder::new();
    let rows: Vec<Vec<f64>> = (0..25_000)
        .map(|i| {
            vec![f64::from(i) * 0.01, f64::from(i % 7) / 3.0, 440.0, 1.0, 2.0, -440.0, f64::from(i % 13)]
        })
        .collect();
    let text: String = rows
        .iter()
        .map(|r| r.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(",") + "\n")
        .collect();
    folder.write("a.csv", text);
    let wanted = folder.readings("allegro", "lines = \"a.csv\"");
    for packing in [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::GZIP(parquet::basic::GzipLevel::default()),
        Compression::ZSTD(parquet::basic::ZstdLevel::default()),
        Compression::LZ4_RAW,
    ] {
        parquet_file(&folder.0.path().join("a.parquet"), &payload::COLUMNS, &rows, packing);
        assert_eq!(folder.readings("allegro", "lines = \"a.parquet\""), wanted, "{packing:?}");
    }
    let mut bad = rows[..20].to_vec();
    bad[7][3] = f64::NAN;
    parquet_file(&folder.0.path().join("bad.parquet"), &payload::COLUMNS, &bad, Compression::SNAPPY);
    let message = folder.error("allegro", "lines = \"bad.parquet\"");
    assert!(message.contains("bad.parquet:8: row 8: column `z1_mm` holds no finite number"), "{message}");
    let (lines, skipped) = folder.skipping("allegro", "lines = \"bad.parquet\"");
    assert_eq!((lines, skipped.len()), (19, 1));
    parquet_file(
        &folder.0.path().join("few.parquet"),
        &["t_ms", "x"],
        &[vec![1.0, 2.0]],
        Compression::SNAPPY,
    );
    let message = folder.error("allegro", "lines = \"few.parquet\"");
    assert!(message.contains("no column `x1_mm`; the file has: t_ms, x"), "{message}");
}

#[test]
fn closed_form_parquet_list_mode_with_other_types_and_lost_cells() {
    let folder = Folder::new();
    let schema = "message l { REQUIRED FLOAT t_ms; REQUIRED INT32 xa; REQUIRED INT32 za; REQUIRED INT32 xb; OPTIONAL INT32 zb; }";
    let file = std::fs::File::create(folder.0.path().join("a.parquet")).unwrap();
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(parse_message_type(schema).unwrap()), Arc::default())
            .unwrap();
    let mut group = writer.next_row_group().unwrap();
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<FloatType>().write_batch(&[1.5, 2.5], None, None).unwrap();
    column.close().unwrap();
    for values in [[0, 21], [0, 14], [300, 310]] {
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<Int32Type>().write_batch(&values, None, None).unwrap();
        column.close().unwrap();
    }
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<Int32Type>().write_batch(&[28], Some(&[1, 0]), None).unwrap();
    column.close().unwrap();
    group.close().unwrap();
    writer.close().unwrap();
    let all = folder.read("allegro", "lines = \"a.parquet\"").unwrap();
    let message = all[0].as_ref().unwrap_err().to_string();
    assert!(message.contains("row 2: column `zb` holds no finite number"), "{message}");
    let (lines, _) = folder.skipping("allegro", "lines = \"a.parquet\"");
    assert_eq!(lines, 1);
}

proptest! {
    /// Whatever happens to a file, the answer is readings or an error, in bounded memory and time.
    #[test]
    fn law_mutated_text_is_read_or_refused(
        which in 0_usize..4,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
        is_packed in any::<bool>(),
        skip in any::<bool>(),
    ) {
        let folder = Folder::new();
        let (text, of) = match which {
            0 => (format!("{HEADER}{}", text_of(&ROWS, ",")), "allegro"),
            1 => ("t_ms,xa,za,xb,zb\n1.5,0,0,300,28\n2.5,21,14,310,3\n".to_owned(), "allegro"),
            2 => (TWO_PLANE.to_owned(), "adac-forte"),
            _ => (saved(), "allegro"),
        };
        let mut bytes = text.into_bytes();
        if is_packed {
            folder.pack("p.gz", &String::from_utf8(bytes).unwrap());
            bytes = std::fs::read(folder.0.path().join("p.gz")).unwrap();
        }
        for (place, value) in &edits {
            let length = bytes.len();
            bytes[place.index(length)] = *value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let name = if is_packed { "a.gz" } else { "a.csv" };
        folder.write(name, &bytes);
        let policy = if skip { "skip" } else { "strict" };
        let files = format!("lines = \"{name}\"\nmax_gap_s = 1\nbad_rows = \"{policy}\"");
        if let Ok(all) = folder.read(of, &files) {
            prop_assert!(all.len() < 200);
            for recorded in all.into_iter().flatten() {
                if let Recorded::Reading(reading) = recorded {
                    let mut lines = Vec::new();
                    prop_assert_eq!(payload::lines(&reading.payload, &mut lines).unwrap(), 0);
                }
            }
        }
    }

    #[test]
    fn law_mutated_parquet_is_read_or_refused(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let folder = Folder::new();
        let path = folder.0.path().join("a.parquet");
        let rows: Vec<Vec<f64>> = ROWS.iter().map(|r| r.to_vec()).collect();
        parquet_file(&path, &payload::COLUMNS, &rows, parquet::basic::Compression::SNAPPY);
        let mut bytes = std::fs::read(&path).unwrap();
        for (place, value) in &edits {
            let length = bytes.len();
            bytes[place.index(length)] = *value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        folder.write("a.parquet", &bytes);
        if let Ok(all) = folder.read("allegro", "lines = \"a.parquet\"\nmax_gap_s = 1\nbad_rows = \"skip\"") {
            prop_assert!(all.len() < 200);
        }
    }
}

/// `docs/pet.md` holds every key, and a scanner that can be read.
#[test]
fn law_the_page_names_every_key() {
    use lumenav_pet::config::{INSTALLED_SOURCES, OPTIONS_SOURCES, REALITY_SOURCES};
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../docs/pet.md");
    let page = std::fs::read_to_string(page).unwrap();
    let tables: [&[(&str, &str)]; 4] =
        [&INSTALLED_SOURCES, &REALITY_SOURCES, &OPTIONS_SOURCES, &lumenav_pet::reader::FILES_SOURCES];
    for (key, _) in tables.into_iter().flatten() {
        assert!(page.contains(&format!("`{key}`")), "{key}");
    }
    let start = page.find("[scanner]\n").unwrap();
    let end = start + page[start..].find("```").unwrap();
    let node = Node::parse_text(&page[start..end], "page.toml", Path::new(""), &[]).unwrap();
    let scanner = Scanner::from_node(&node).unwrap();
    assert_eq!(scanner.blocks.len(), 24);
    assert!((scanner.told_depth_m() - 9e-3).abs() < 1e-12);
    // With all of its keys written, commented ones as well.
    for (key, _) in lumenav_pet::scanner::SCANNER_SOURCES {
        assert!(page[start..end].contains(key), "{key}");
    }
}

/// The folder of recorded data, or a line that says it is skipped.
fn data_or_skip(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LUMENAV_DATA");
    match &folder {
        Some(_) => println!("REAL-DATA ran {test}"),
        None => println!("{test}: SKIPPED (LUMENAV_DATA unset)"),
    }
    folder.map(PathBuf::from)
}

#[test]
fn law_recorded_lines_are_read_whole() {
    // Runs where the folder of recorded data is; says so where it is not.
    let Some(_) = data_or_skip("law_recorded_lines_are_read_whole") else { return };
    let folder = Folder::new();
    for (name, of, lines, bad) in [
        ("sample_2p_static", "adac-forte", 30_026, 1),
        ("sample_1p_fluidised_bed", "adac-forte-600", 80_000, 0),
    ] {
        let files = format!("lines = \"$LUMENAV_DATA/pet/{name}.csv.gz\"\nwindow_lines = 200");
        let (read, skipped) = folder.skipping(of, &files);
        assert_eq!((read, skipped.len()), (lines, bad), "{name}: {skipped:?}");
        // The shared copy of the first is cut within its last row.
        assert!(skipped.iter().all(|s| s.contains("1 columns, expected 5")), "{skipped:?}");
    }
}
