use super::*;
use std::path::Path;

fn shipped(name: &str) -> Scanner {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners").join(format!("{name}.toml"));
    Scanner::from_node(&Node::open(&path).unwrap()).unwrap()
}

#[test]
fn published_numbers_of_crystals() {
    // than2015, table 5.1 and section 4.3.
    assert_eq!(shipped("allegro").crystals(), 17_864);
    assert_eq!(shipped("tf64").crystals(), 28_336);
    assert_eq!(shipped("reduced").crystals(), 4_408);
}

/// than2015 eq. 5.1 to 5.10, written out here once more.
#[test]
fn published_crystal_positions() {
    let scanner = shipped("allegro");
    let (radius, depth, pitch_t, pitch_a) = (0.43205, 0.020, 0.0043, 0.0063);
    for (x, z) in [(0, 0), (21, 28), (22, 3), (615, 14), (300, 7)] {
        let alpha = f64::from(x / 22) * std::f64::consts::TAU / 28.0;
        let h = pitch_t * (f64::from(x % 22) - 10.5);
        let wanted = Vector3::new(
            (radius + 0.5 * depth) * alpha.sin() + h * alpha.cos(),
            (radius + 0.5 * depth) * alpha.cos() - h * alpha.sin(),
            pitch_a * (f64::from(z) - 14.0),
        );
        let found = scanner.position(CrystalIndex { x, z }).unwrap();
        assert!((found - wanted).norm() < 1e-12, "{x} {z}: {found} {wanted}");
    }
}

#[test]
fn law_index_and_position_are_inverse() {
    for name in ["allegro", "tf64", "reduced"] {
        let scanner = shipped(name);
        for x in 0..scanner.blocks.len() as u32 * scanner.grid.columns {
            for z in 0..scanner.grid.rows {
                let crystal = CrystalIndex { x, z };
                let place = scanner.position(crystal).unwrap();
                assert_eq!(scanner.crystal_at(&place), Some(crystal), "{name}");
            }
        }
        let block = scanner.nearest_block(&scanner.position(CrystalIndex { x: 45, z: 3 }).unwrap());
        assert_eq!(Some(block), scanner.block_of(CrystalIndex { x: 45, z: 3 }));
    }
}

#[test]
fn law_what_is_no_crystal_is_none() {
    let scanner = shipped("reduced");
    assert_eq!(scanner.position(CrystalIndex { x: 4 * 38, z: 0 }), None);
    assert_eq!(scanner.position(CrystalIndex { x: 0, z: 29 }), None);
    assert_eq!(scanner.crystal_at(&Vector3::zeros()), None);
}

#[test]
fn law_pairs_are_symmetric_and_as_the_file_says() {
    let scanner = shipped("reduced");
    for (a, b) in [(0, 1), (1, 2), (0, 0)] {
        assert!(!scanner.can_coincide(a, b));
    }
    assert!(scanner.can_coincide(0, 2) && scanner.can_coincide(2, 0) && scanner.can_coincide(1, 3));
    let ring = shipped("allegro");
    assert!(
        !ring.can_coincide(0, 1)
            && !ring.can_coincide(0, 27)
            && ring.can_coincide(0, 2)
            && ring.can_coincide(27, 1)
    );
}

#[test]
fn law_blocks_look_at_the_axis_and_their_axes_are_right_handed() {
    for block in shipped("tf64").blocks {
        assert!((block.tangential.cross(&block.axial) + block.outward).norm() < 1e-12);
        assert!(block.centre_world_m.dot(&block.outward) > 0.4);
    }
}

fn refused(text: &str) -> String {
    let node = Node::parse_text(text, "s.toml", Path::new(""), &[]).unwrap();
    Scanner::from_node(&node).unwrap_err().to_string()
}

#[test]
fn law_a_bad_scanner_is_refused_by_key() {
    let good = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/reduced.toml"),
    )
    .unwrap();
    for (from, to, wanted) in [
        ("radius_mm = 432.05", "radius_mm = -1.0", "radius_mm"),
        ("columns = 38", "columns = 0", "columns"),
        ("pairs = [[0, 2], [1, 3]]", "pairs = [[0, 4]]", "pairs"),
        ("pairs = [[0, 2], [1, 3]]", "pairs = []", "fire together"),
        ("energy_window_kev = [434.35, 587.65]", "energy_window_kev = [587.65, 434.35]", "energy_window_kev"),
        ("depth_mm = 20.0", "depth_mm = nan", "depth_mm"),
        ("angles_deg = [0.0, 90.0, 180.0, 270.0]", "angles_deg = [0.0]", "angles_deg"),
        ("[ring]", "[rings]", "rings"),
    ] {
        assert!(good.contains(from), "{from}");
        let message = refused(&good.replace(from, to));
        assert!(message.contains(wanted), "{message}");
    }
}

/// What cannot be built, or would be simulated wrongly or for ever.
#[test]
fn law_scanners_that_cannot_be_are_refused() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/reduced.toml");
    let text = std::fs::read_to_string(path).unwrap();
    for (from, to, wanted) in [
        ("radius_mm = 432.05", "radius_mm = 0.43205", "blocks 0 and 1 overlap"),
        ("radius_mm = 432.05", "radius_mm = 60", "blocks 0 and 1 overlap"),
        ("[0.0, 90.0,", "[0.0, 5.0,", "blocks 0 and 1 overlap"),
        ("time_resolution_ns", "efficiency = 80\ntime_resolution_ns", "efficiency`: 80 of the photons"),
        (
            "time_resolution_ns",
            "position_fwhm_mm = 4\ntime_resolution_ns",
            "position_fwhm_mm`: of a detector without",
        ),
        ("pairs = [[", "min_block_difference = 1\npairs = [[", "give one of the two"),
    ] {
        assert!(text.contains(from), "{from}");
        let file = Node::parse_text(&text.replacen(from, to, 1), "s.toml", Path::new(""), &[]).unwrap();
        let message = Scanner::from_node(&file).unwrap_err().to_string();
        assert!(message.contains("s.toml:") && message.contains(wanted), "{to}: {message}");
    }
    // The same of what a scenario changes, also where blocks are listed one by one: here side by side, 400 mm apart.
    let plates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/adac-forte.toml");
    let plates = std::fs::read_to_string(plates).unwrap();
    let beside = plates
        .replace("[0.0, 0.0, 356.0]", "[400.0, 0.0, -356.0]")
        .replace("[0.0, 0.0, 1.0]", "[0.0, 0.0, -1.0]");
    assert_ne!(plates, beside);
    let beside = Node::parse_text(&beside, "p.toml", Path::new(""), &[]).unwrap();
    let changes = Node::parse_text("columns = 2", "s.toml", Path::new(""), &[]).unwrap();
    let message = Scanner::from_node(&beside).unwrap().changed(&beside, &changes).unwrap_err().to_string();
    assert!(message.contains("s.toml:") && message.contains("blocks 0 and 1 overlap"), "{message}");
    // Blocks may stand edge to edge, and behind each other.
    for radius_mm in ["83", "1000"] {
        let near = text.replacen("432.05", radius_mm, 1);
        Scanner::from_node(&Node::parse_text(&near, "s.toml", Path::new(""), &[]).unwrap()).unwrap();
    }
    let body = |name: &str| {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../../models/phantoms/{name}.toml"));
        Phantom::from_node(&Node::open(&path).unwrap()).unwrap()
    };
    let near = text.replacen("432.05", "90", 1);
    let near = Scanner::from_node(&Node::parse_text(&near, "s.toml", Path::new(""), &[]).unwrap()).unwrap();
    assert_eq!(near.block_inside(&body("water-20")), Some(0));
    assert_eq!(shipped("reduced").block_inside(&body("water-20")), None);
    assert_eq!(shipped("allegro").block_inside(&body("torso")), None);
}
