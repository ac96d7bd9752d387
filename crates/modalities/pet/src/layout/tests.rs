use super::*;
use crate::Pet;
use crate::simulation::{EndPoints, Scintillator};
use lumenav_core::config::quantity::Fraction;
use lumenav_core::{CapsuleBody, Modality as _, ModelFolder, Name, Schedule};
use std::path::{Path, PathBuf};

const INSTALLED: &str = "scanner = \"reduced\"\nphantom = \"water-20\"\n";
const NUMBERS: usize = packed_len(6);

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models")
}

fn node(text: &str) -> Node {
    Node::parse_text(text, "test.toml", Path::new(""), &[]).unwrap()
}

fn capsule_text(capsule: &str) -> String {
    std::fs::read_to_string(models().join("capsules").join(format!("{capsule}.toml"))).unwrap()
}

fn setup(capsule: &str) -> Setup {
    Setup {
        sensor: Name::from("scanner"),
        schedule: Some(Schedule {
            rate_hz: Positive(20.0),
            start_s: NonNegative(0.0),
            latency_ms: NonNegative(0.0),
            loss: Fraction(0.0),
        }),
        capsule: CapsuleBody { radius_m: 6e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: node(capsule),
        models: ModelFolder::new(models()),
        map: None,
    }
}

fn layout_of(installed: &str, options: &str, capsule: &str) -> Result<ScannerLayout, ModalityError> {
    ScannerLayout::from_nodes(&node(installed), &node(options), &setup(capsule))
}

fn layout(installed: &str, options: &str) -> ScannerLayout {
    layout_of(installed, options, &capsule_text("pet-triangle")).unwrap()
}

fn pose() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.3, 0.4, -0.2);
    Isometry3::from_parts(Translation3::new(0.013, -0.021, 0.017), turn)
}

fn information(layout: &ScannerLayout, elements: &[LayoutElement], pose: &Isometry3<f64>) -> Matrix6<f64> {
    let mut packed = [f64::NAN; NUMBERS];
    layout.worker().together(elements, pose, &mut packed);
    unpack(&packed)
}

fn unpack(packed: &[f64]) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| packed[packed_len(i.max(j)) + i.min(j)])
}

/// Largest difference, each entry by the roots of its two diagonal entries in the first matrix.
fn difference(a: &Matrix6<f64>, b: &Matrix6<f64>) -> f64 {
    let scale = |i: usize| a[(i, i)].sqrt();
    (a - b).map_with_location(|i, j, d| d.abs() / (scale(i) * scale(j))).max()
}

fn some(layout: &ScannerLayout, numbers: &[usize]) -> Vec<LayoutElement> {
    numbers.iter().map(|i| layout.elements()[*i].clone()).collect()
}

#[test]
fn closed_form_elements_are_the_blocks() {
    let layout = layout(INSTALLED, "");
    let cost: f64 = layout.elements().iter().map(|e| e.cost).sum();
    assert_eq!((layout.elements().len(), cost), (4, 4408.0));
    assert_eq!((layout.cost_unit(), layout.parameters().len()), ("crystals", 6));
    assert_eq!(layout.prior(), [0.0; NUMBERS]);
    for (element, block) in layout.elements().iter().zip(&layout.scanner.blocks) {
        // A place 3 mm into the crystals, 20 mm along the rows and 10 mm along the columns.
        let place = element.world_from_element * Point3::new(0.020, 0.010, 0.003);
        let wanted = block.centre_world_m + block.axial * 0.020 + block.tangential * 0.010;
        assert!((place.coords - wanted - block.outward * 0.003).norm() < 1e-15);
        let back = block_at(&element.world_from_element);
        assert!((back.outward - block.outward).norm() < 1e-15 && (back.axial - block.axial).norm() < 1e-15);
    }
}

/// The whole scanner against the plan, whose parts are opened here by themselves.
#[test]
fn closed_form_all_blocks_say_what_the_plan_expects() {
    let open = |path: &str| Node::open(&models().join(path)).unwrap();
    let layout = layout(INSTALLED, "background_share = 0.25\nper_side = 6\n");
    let crystals = Scintillator::from_node(&open("scintillators/gso.toml")).unwrap();
    let scanner =
        Scanner::from_node(&open("scanners/reduced.toml")).unwrap().with_interaction_depth(&crystals);
    let errors = BlockErrors::of_block(&scanner, &crystals, EndPoints::Crystal);
    let plan = Plan {
        scanner: &scanner,
        detection: &PhotonDetection::of_block(&scanner, &crystals),
        // A core of half a millimetre, and a range of 0.4 mm in the mean: R²/5 + 2 (0.2 mm)².
        noise: &LineNoise::of_block(
            &scanner,
            &errors,
            &SourceNoise { variance_m2: 0.0625e-6 / 5.0 + 0.08e-6, ..SourceNoise::default() },
        ),
        phantom: Some(&Phantom::from_node(&open("phantoms/water-20.toml")).unwrap()),
        markers: &MarkerSet::from_capsule(&node(&capsule_text("pet-triangle")), "pet", 3).unwrap(),
        positrons_per_decay: 0.9038,
        window_s: 0.05,
        background_share: 0.25,
        per_side: 6,
    };
    let wanted = plan.expected(&pose());
    let found = information(&layout, layout.elements(), &pose());
    assert!(wanted.bound().is_some());
    assert!(difference(&wanted.information, &found) < 1e-9, "{}", difference(&wanted.information, &found));
}

#[test]
fn law_a_dead_block_takes_its_pair_with_it() {
    let layout = layout(INSTALLED, "");
    let of = |numbers: &[usize]| information(&layout, &some(&layout, numbers), &pose());
    let (first, second) = (of(&[0, 2]), of(&[1, 3]));
    for (left, wanted) in
        [([1, 2, 3], &second), ([0, 2, 3], &first), ([0, 1, 3], &second), ([0, 1, 2], &first)]
    {
        assert_eq!(of(&left), *wanted, "{left:?}");
    }
    // One line leaves only what is along it unseen: a pair by itself bounds the pose.
    assert!(first.cholesky().is_some() && second.cholesky().is_some());
    assert!(difference(&of(&[0, 1, 2, 3]), &(first + second)) < 1e-12);
    for nothing in [&[][..], &[0], &[0, 1], &[0, 3], &[1, 2]] {
        assert_eq!(of(nothing), Matrix6::zeros(), "{nothing:?}");
    }
    // The worker keeps nothing of the elements before, and the order in which they are named does not matter.
    let (mut worker, mut packed) = (layout.worker(), [f64::NAN; NUMBERS]);
    for (numbers, wanted) in [(&[0, 2][..], &first), (&[3, 1], &second), (&[0, 2], &first)] {
        worker.together(&some(&layout, numbers), &pose(), &mut packed);
        assert_eq!(unpack(&packed), *wanted, "{numbers:?}");
    }
}

#[test]
fn law_information_grows_with_every_pair() {
    let layout = layout("scanner = \"allegro\"\nphantom = \"water-20\"\n", "per_side = 4\n");
    let mut numbers = vec![0, 14];
    let mut before = information(&layout, &some(&layout, &numbers), &pose());
    for more in [7, 21, 3, 17, 10, 24] {
        numbers.push(more);
        let after = information(&layout, &some(&layout, &numbers), &pose());
        let scale = after.diagonal().map(|v| v.sqrt().recip());
        let gained = Matrix6::from_diagonal(&scale) * (after - before) * Matrix6::from_diagonal(&scale);
        assert!(gained.symmetric_eigenvalues().min() > -1e-9, "{numbers:?}");
        before = after;
    }
    let pair = information(&layout, &some(&layout, &[0, 14]), &pose());
    assert!(before.trace() > 2.0 * pair.trace());
}

#[test]
fn law_information_is_linear_in_activity_and_window() {
    let text = capsule_text("pet-triangle");
    let of = |installed: &str, options: &str, capsule: &str| {
        let layout = layout_of(installed, options, capsule).unwrap();
        (layout.window_s(), information(&layout, layout.elements(), &pose()))
    };
    let (window_s, once) = of(INSTALLED, "", &text);
    assert_eq!(window_s, 0.05);
    let hot = text.replace("activity_mbq = 1.85", "activity_mbq = 5.55");
    let (_, thrice) = of(INSTALLED, "", &hot);
    assert!(difference(&(once * 3.0), &thrice) < 1e-12);
    for (installed, options, window_s) in
        [(INSTALLED.to_owned(), "window_s = 0.2\n", 0.2), (format!("{INSTALLED}window_ms = 20\n"), "", 0.02)]
    {
        let (found_s, longer) = of(&installed, options, &text);
        assert!((found_s - window_s).abs() < 1e-15);
        assert!(difference(&(once * (window_s / 0.05)), &longer) < 1e-12);
    }
    // An isotope with fewer positrons says less, by that share.
    let folder = tempfile::tempdir().unwrap();
    let half = std::fs::read_to_string(models().join("isotopes/na-22.toml")).unwrap();
    let half = half.replace("per_decay = 0.9038", "per_decay = 0.4519");
    std::fs::write(folder.path().join("half.toml"), half).unwrap();
    let path = folder.path().join("half.toml").display().to_string();
    let (_, other) = of(INSTALLED, "", &text.replace("na-22", &path));
    assert!(difference(&(once * 0.5), &other) < 1e-12);
    // One whose positrons fly further, too: those of Ga-68 by 3.5 mm instead of 0.4, 0.889 instead of 0.904 of them.
    let (_, gallium) = of(INSTALLED, "", &text.replace("na-22", "ga-68"));
    assert!(gallium.trace() < 0.6 * once.trace(), "{} {}", gallium.trace(), once.trace());
}

/// δp turns with the world, δθ is told in the capsule's frame and does not.
fn turned(information: &Matrix6<f64>, turn: &UnitQuaternion<f64>) -> Matrix6<f64> {
    let mut by = Matrix6::identity();
    by.fixed_view_mut::<3, 3>(0, 0).copy_from(turn.to_rotation_matrix().matrix());
    by * information * by.transpose()
}

/// Blocks and capsule turned together about the axis of the water: elements may stand elsewhere than installed.
#[test]
fn law_information_turns_with_blocks_and_capsule() {
    let layout = layout(INSTALLED, "");
    let once = information(&layout, layout.elements(), &pose());
    for angle_deg in [37.0_f64, 90.0, 211.0] {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_deg.to_radians());
        let mut elements = layout.elements().to_vec();
        elements.iter_mut().for_each(|e| e.world_from_element = turn * e.world_from_element);
        let found = information(&layout, &elements, &(turn * pose()));
        let off = difference(&turned(&once, &turn), &found);
        assert!(off < 1e-9, "{angle_deg}: {off}");
    }
}

/// Two pairs 90 degrees apart look the same after a quarter of a turn: the capsule alone is turned. The sum over directions starts from the other
/// block of a pair then, so it agrees to the sum's own error.
#[test]
fn law_information_turns_with_the_capsule_in_a_symmetric_scanner() {
    let layout = layout(INSTALLED, "per_side = 32\n");
    let once = information(&layout, layout.elements(), &pose());
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    let found = information(&layout, layout.elements(), &(turn * pose()));
    let off = difference(&turned(&once, &turn), &found);
    assert!(off < 0.02, "{off}");
}

#[test]
fn law_a_block_with_a_marker_in_it_says_nothing() {
    let layout = layout(INSTALLED, "");
    let [first, second] = [0, 1].map(|i| layout.elements()[i].clone());
    // In the first block 10 mm behind its face, which stands at +y.
    let inside = Isometry3::translation(0.0, 0.43205 + 0.010, 0.0);
    assert!(layout.blocked(&first, &inside).unwrap().contains("marker 1"));
    assert_eq!(layout.blocked(&second, &inside), None);
    assert_eq!(layout.blocked(&first, &pose()), None);
    assert_eq!(information(&layout, layout.elements(), &inside), Matrix6::zeros());
    let beside = Isometry3::translation(0.0, 0.3, 0.0);
    assert_eq!(layout.blocked(&first, &beside), None);
}

#[test]
fn law_blocks_by_themselves_say_nothing() {
    let layout = layout(INSTALLED, "");
    let mut packed = [7.0; NUMBERS];
    assert!(!layout.worker().each(&layout.elements()[..1], &pose(), &mut packed));
    assert_eq!(packed, [7.0; NUMBERS]);
    assert_eq!(layout.to_toml("a", "b", layout.elements()), None);
}

#[test]
fn law_changes_of_a_scanner_are_as_in_its_file() {
    let reduced = std::fs::read_to_string(models().join("scanners/reduced.toml")).unwrap();
    let text = reduced
        .replace("radius_mm = 432.05", "radius_mm = 350.0")
        .replace("angles_deg = [0.0, 90.0, 180.0, 270.0]", "angles_deg = [0.0, 60.0, 180.0, 240.0]")
        .replace("columns = 38", "columns = 28")
        .replace("rows = 29", "rows = 20");
    let gso =
        Scintillator::from_node(&Node::open(&models().join("scintillators/gso.toml")).unwrap()).unwrap();
    let wanted = Scanner::from_node(&node(&text)).unwrap().with_interaction_depth(&gso);
    let changes =
        "scanner_changes = { radius_mm = 350, angles_deg = [0, 60, 180, 240], columns = 28, rows = 20 }\n";
    let found = layout(&format!("{INSTALLED}{changes}"), "");
    assert_eq!(found.scanner, wanted);
    assert_eq!(found.elements().iter().map(|e| e.cost).sum::<f64>(), 2240.0);
    // Nothing named, nothing changed; a scanner of listed blocks has crystals as well.
    assert_eq!(
        layout(&format!("{INSTALLED}scanner_changes = {{}}\n"), "").scanner,
        layout(INSTALLED, "").scanner
    );
    let heads = "scanner = \"adac-forte\"\nscanner_changes = { rows = 2 }\n";
    assert_eq!(layout(heads, "").scanner.grid.rows, 2);
    // A full ring keeps its blocks, at equal angles.
    let ring = layout("scanner = \"allegro\"\nscanner_changes = { radius_mm = 500 }\n", "");
    assert_eq!(ring.elements().len(), 28);
    assert!((ring.scanner.blocks[7].centre_world_m - Vector3::x() * 0.5).norm() < 1e-12);
}

#[test]
fn law_bad_input_is_refused_by_key() {
    let triangle = capsule_text("pet-triangle");
    let two: String = triangle.rsplitn(2, "[[marker]]").last().unwrap().to_owned();
    let changes = |inner: &str| format!("{INSTALLED}scanner_changes = {{ {inner} }}\n");
    let heads = "scanner = \"adac-forte\"\nscanner_changes = { radius_mm = 300 }\n".to_owned();
    let plain = INSTALLED.to_owned();
    for (installed, options, capsule, wanted) in [
        (&plain, "background_share = 1\n", &triangle, ["test.toml:1:", "background_share", "below 1"]),
        (&plain, "background_share = -0.1\n", &triangle, ["test.toml:1:", "background_share", "-0.1"]),
        (&plain, "\nper_side = 0\n", &triangle, ["test.toml:2:", "per_side", "1 to 64"]),
        (&plain, "per_side = 65\n", &triangle, ["test.toml:1:", "per_side", "1 to 64"]),
        (&plain, "window_s = 0\n", &triangle, ["test.toml:1:", "window_s", "above 0"]),
        (&plain, "windows_s = 1\n", &triangle, ["test.toml:1:", "windows_s", "window_s"]),
        (&plain, "", &two, ["test.toml:", "marker", "allowed: 3"]),
        (&changes("columns = 0"), "", &triangle, ["test.toml:3:", "scanner_changes.columns", "1 to 4096"]),
        (&changes("rows = 5000"), "", &triangle, ["test.toml:3:", "scanner_changes.rows", "1 to 4096"]),
        (&changes("radius_mm = 0"), "", &triangle, ["test.toml:3:", "scanner_changes.radius_mm", "above 0"]),
        (&changes("radius_mm = 2e4"), "", &triangle, ["test.toml:3:", "radius_mm", "up to 10000 mm"]),
        (&changes("angles_deg = [0, 60, 180]"), "", &triangle, ["test.toml:3:", "angles_deg", "allowed: 4"]),
        (
            &changes("angles_deg = [0, 10, 180, 190]"),
            "",
            &triangle,
            ["test.toml:3:", "blocks 0 and 1", "overlap"],
        ),
        (&changes("radius_mm = 60"), "", &triangle, ["test.toml:3:", "scanner_changes", "overlap"]),
        (&changes("depth_mm = 3"), "", &triangle, ["test.toml:3:", "depth_mm", "columns"]),
        (&heads, "", &triangle, ["test.toml:2:", "scanner_changes.radius_mm", "no [ring]"]),
    ] {
        let message = layout_of(installed, options, capsule).unwrap_err().to_string();
        assert!(wanted.iter().all(|words| message.contains(words)), "{message} lacks one of {wanted:?}");
    }
}

#[test]
fn law_the_plugin_has_a_layout() {
    let setup = setup(&capsule_text("pet-triangle"));
    let model = Pet::default().layout(&node(INSTALLED), &node(""), &setup).unwrap();
    assert_eq!(model.elements().len(), 4);
    for row in setup.capsule_model.log().entries().iter().flat_map(lumenav_core::Resolved::rows) {
        assert!(row.set || row.source.is_some(), "{} has no source", row.key);
    }
}

/// How long one pose takes, printed: `cargo test -p lumenav-pet --lib layout -- --nocapture`.
#[test]
fn regress_bound_of_the_reduced_scanner() {
    let layout = layout(INSTALLED, "");
    let start = std::time::Instant::now();
    let (mut worker, mut packed) = (layout.worker(), [0.0; NUMBERS]);
    let poses = 50;
    for k in 0..poses {
        let at = Isometry3::translation(0.0, 0.0, 1e-4 * f64::from(k)) * pose();
        worker.together(layout.elements(), &at, &mut packed);
    }
    println!("{:.3} ms per pose", 1e3 * start.elapsed().as_secs_f64() / f64::from(poses));
    let bound = information(&layout, layout.elements(), &pose()).try_inverse().unwrap();
    let rms_mm = 1e3 * bound.fixed_view::<3, 3>(0, 0).trace().sqrt();
    println!("{rms_mm:.4} mm");
    // Our own number of 28 November 2026. (0.3442 while a face accepted alike everywhere, with which rates were 6 to 10 % below the
    // simulator's; 0.3296 while all sources spread by 0.12 mm² per axis, these by 0.093; 0.3270 while
    // ends were told at the crystals' middle and a line counted for all that it says; both sums fine, 48 parts and half a step, changed it by 0.1 %.)
    assert!((rms_mm / 0.3328 - 1.0).abs() < 0.003, "{rms_mm}");
}
