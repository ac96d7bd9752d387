//! Voxel phantoms: label images written here and read back, headers that lie, the shipped torso.

use lumenav_anatomy::phantom::Phantom;
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_core::Node;
use nalgebra::Vector3;
use proptest::prelude::*;
use std::io::Write as _;
use std::path::{Path, PathBuf};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

const TISSUES: &str = "[[phantom.tissue]]\nlabels = [1, 3]\nmaterial = { name = \"soft\", attenuation_511_per_cm = 0.096 }\n\
                       [[phantom.tissue]]\nlabels = [2]\nmaterial = { name = \"bone\", attenuation_511_per_cm = 0.172 }\n";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.0.path().join(name), bytes).unwrap();
    }

    fn pack(&self, name: &str, bytes: &[u8]) {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(bytes).unwrap();
        self.write(name, packed.finish().unwrap());
    }

    fn read(&self, file: &str, more: &str) -> Result<Phantom, String> {
        let text = format!(
            "[phantom]\nkind = \"voxels\"\nname = \"t\"\nsource = \"\"\nfile = \"{file}\"\n{more}\n{TISSUES}"
        );
        let node = Node::parse_text(&text, "p.toml", self.0.path(), &[]).unwrap();
        Phantom::from_node(&node).map_err(|error| error.to_string())
    }
}

/// 4 x 3 x 2 voxels of 10, 20 and 30 mm; label 2 at (3, 0, 0), 3 at (0, 2, 1), 0 at (0, 0, 0), the rest 1.
fn labels() -> Vec<u8> {
    let mut labels = vec![1_u8; 24];
    labels[0] = 0;
    labels[3] = 2;
    labels[20] = 3;
    labels
}

fn nifti(kind: i16, numbers: &[u8], is_big: bool, sform: bool) -> Vec<u8> {
    let mut header = vec![0_u8; 352];
    let short = |v: i16| if is_big { v.to_be_bytes() } else { v.to_le_bytes() };
    let float = |v: f32| if is_big { v.to_be_bytes() } else { v.to_le_bytes() };
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &if is_big { 348_i32.to_be_bytes() } else { 348_i32.to_le_bytes() });
    for (i, n) in [3, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * i, &short(n));
    }
    put(70, &short(kind));
    for (i, v) in [1.0, 10.0, 20.0, 30.0].into_iter().enumerate() {
        put(76 + 4 * i, &float(v));
    }
    put(108, &float(352.0));
    put(123, &[2]);
    if sform {
        put(254, &short(1));
        for (row, values) in
            [[-10.0, 0.0, 0.0, 15.0], [0.0, 20.0, 0.0, -20.0], [0.0, 0.0, 30.0, -15.0]].iter().enumerate()
        {
            for (k, v) in values.iter().enumerate() {
                put(280 + 16 * row + 4 * k, &float(*v));
            }
        }
    } else {
        // A half turn about y: x and z are turned over.
        put(252, &short(1));
        for (at, v) in [(260, 1.0), (268, 15.0), (272, -20.0), (276, 15.0)] {
            put(at, &float(v));
        }
    }
    put(344, b"n+1\0");
    header.extend(numbers);
    header
}

fn name_at(phantom: &Phantom, mm: [f64; 3]) -> Option<String> {
    phantom.material_at(&(Vector3::from(mm) * 1e-3)).map(|m| m.name.clone())
}

/// Right is -x of the index in these files: label 2 stands at x = -15 mm.
fn check(phantom: &Phantom, z_flip: f64) {
    assert_eq!(name_at(phantom, [-15.0, -20.0, -15.0 * z_flip]).as_deref(), Some("bone"));
    assert_eq!(name_at(phantom, [15.0, -20.0, -15.0 * z_flip]), None, "label 0 is outside");
    assert_eq!(name_at(phantom, [15.0, 20.0, 15.0 * z_flip]).as_deref(), Some("soft"));
    assert_eq!(name_at(phantom, [0.0, 0.0, 31.0]), None);
    assert_eq!(phantom.largest_attenuation_511_per_m(), 17.2);
    assert_eq!(phantom.uniform_attenuation_511_per_m(), None);
    let depth = phantom.optical_depth_511(&Vector3::new(-1.0, -0.02, -0.015 * z_flip), &Vector3::x());
    assert!((depth - (0.172 + 2.0 * 0.096)).abs() < 1e-9, "{depth}");
}

#[test]
fn closed_form_nifti_in_both_orders_and_all_numbers() {
    let folder = Folder::new();
    let labels = labels();
    folder.write("a.nii", nifti(2, &labels, false, true));
    check(&folder.read("a.nii", "").unwrap(), 1.0);
    folder.pack("a.nii.gz", &nifti(2, &labels, false, true));
    check(&folder.read("a.nii.gz", "").unwrap(), 1.0);
    let shorts: Vec<u8> = labels.iter().flat_map(|v| i16::from(*v).to_be_bytes()).collect();
    folder.write("b.nii", nifti(4, &shorts, true, true));
    check(&folder.read("b.nii", "").unwrap(), 1.0);
    let floats: Vec<u8> = labels.iter().flat_map(|v| f32::from(*v).to_le_bytes()).collect();
    folder.write("c.nii", nifti(16, &floats, false, false));
    check(&folder.read("c.nii", "").unwrap(), -1.0);
    let moved = folder.read("a.nii", "centre_mm = [100, 0, 0]").unwrap();
    assert_eq!(name_at(&moved, [85.0, -20.0, -15.0]).as_deref(), Some("bone"));
}

const MHD: &str = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 10 20 30\nOffset = -15 20 -15\n\
                   TransformMatrix = 1 0 0 0 -1 0 0 0 1\nElementType = MET_UCHAR\nElementDataFile = ";

#[test]
fn closed_form_metaimage_in_one_file_two_files_and_packed() {
    let folder = Folder::new();
    folder.write("a.raw", labels());
    folder.write("a.mhd", format!("{MHD}a.raw\n"));
    check(&folder.read("a.mhd", "").unwrap(), 1.0);
    folder.write("b.mha", [format!("{MHD}LOCAL\n").as_bytes(), &labels()].concat());
    check(&folder.read("b.mha", "").unwrap(), 1.0);
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&labels()).unwrap();
    let header = format!("CompressedData = True\n{MHD}LOCAL\n");
    folder.write("c.mha", [header.as_bytes(), &packed.finish().unwrap()].concat());
    check(&folder.read("c.mha", "").unwrap(), 1.0);
}

const H33: &str = "!INTERFILE :=\n!number of slices := 2\n!matrix size [1] := 4\n!matrix size [2] := 3\n!number format := unsigned integer\n\
                   !number of bytes per pixel := 1\nscaling factor (mm/pixel) [1] := 10\nscaling factor (mm/pixel) [2] := 20\n\
                   scaling factor (mm/pixel) [3] := 30\n!name of data file := a.i33\n!END OF INTERFILE :=\n";

#[test]
fn closed_form_interfile_pair() {
    let folder = Folder::new();
    folder.write("a.i33", labels());
    folder.write("a.h33", H33);
    let phantom = folder.read("a.h33", "").unwrap();
    // LPS: both x and y run against the index.
    assert_eq!(name_at(&phantom, [-15.0, 20.0, -15.0]).as_deref(), Some("bone"));
    let phantom = folder.read("a.h33", "axes = \"ras\"").unwrap();
    assert_eq!(name_at(&phantom, [15.0, -20.0, -15.0]).as_deref(), Some("bone"));
}

#[test]
fn law_images_that_lie_are_refused_with_a_reason() {
    let folder = Folder::new();
    let good = nifti(2, &labels(), false, true);
    let edit = |at: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[at..at + bytes.len()].copy_from_slice(bytes);
        bad
    };
    let huge: Vec<u8> = (0..3).flat_map(|_| i16::MAX.to_le_bytes()).collect();
    let mut unknown = labels();
    unknown[7] = 9;
    for (bytes, wanted) in [
        (edit(0, &[0]), "header's length"),
        (edit(344, b"ni1\0"), "one file"),
        (edit(42, &huge), "voxels; allowed: 1 to"),
        (edit(42, &(-4_i16).to_le_bytes()), "-4 voxels along dimension 1"),
        (edit(70, &128_i16.to_le_bytes()), "type 128"),
        (edit(108, &f32::NAN.to_le_bytes()), "numbers from byte NaN"),
        (edit(280, &f32::NAN.to_le_bytes()), "voxels of no size"),
        (edit(280, &0.0_f32.to_le_bytes()), "voxels of no size"),
        (edit(292, &1e9_f32.to_le_bytes()), "from its origin"),
        (edit(112, &f32::INFINITY.to_le_bytes()), "scaled by zero"),
        (good[..370].to_vec(), "cut: fewer than 24 voxels"),
        (good[..100].to_vec(), "no NIfTI-1 header"),
        (
            nifti(2, &unknown, false, true),
            "voxel (3, 1, 0) holds label 9, which no tissue has; the table has: 0, 1, 2, 3",
        ),
    ] {
        folder.write("a.nii", bytes);
        let message = folder.read("a.nii", "").unwrap_err();
        assert!(
            message.contains(wanted) && message.contains("p.toml:5:") && message.contains("a.nii"),
            "{wanted}: {message}"
        );
    }
    folder.write("a.raw", labels());
    for (from, to, wanted) in [
        ("DimSize = 4 3 2", "DimSize = 4 3", "is not 3 numbers"),
        ("DimSize = 4 3 2", "DimSize = 99999 99999 99999", "voxels; allowed"),
        ("DimSize = 4 3 2", "DimSize = 4 3 3", "cut: fewer than 36 voxels"),
        ("MET_UCHAR", "MET_LONG_LONG", "`ElementType = MET_LONG_LONG`"),
        ("ElementSpacing = 10 20 30", "ElementSpacing = 10 nan 30", "voxels of no size"),
        ("NDims = 3", "NDims = 4", "4 dimensions"),
        ("a.raw", "b.raw", "b.raw: "),
        ("a.raw", "LIST", "lists of files"),
        ("NDims = 3\n", "", "no `NDims`"),
    ] {
        let text = format!("{MHD}a.raw\n");
        assert!(text.contains(from), "{from}");
        folder.write("a.mhd", text.replace(from, to));
        let message = folder.read("a.mhd", "").unwrap_err();
        assert!(message.contains(wanted), "{wanted}: {message}");
    }
    folder.write("a.i33", labels());
    for (from, to, wanted) in [
        ("!INTERFILE :=\n", "", "no Interfile"),
        ("[1] := 4", "[1] := -4", "allowed: a count from 1"),
        ("scaling factor (mm/pixel) [3] := 30", "slice thickness (pixels) := 3", "pixels or mm?"),
        ("per pixel := 1", "per pixel := 3", "of 3 bytes are not read"),
        ("[2] := 20", "[2] := x", "`scaling factor (mm/pixel) [2] := x` is no number"),
    ] {
        assert!(H33.contains(from), "{from}");
        folder.write("a.h33", H33.replace(from, to));
        let message = folder.read("a.h33", "").unwrap_err();
        assert!(message.contains(wanted), "{wanted}: {message}");
    }
    folder.write("a.png", b"x");
    assert!(folder.read("a.png", "").unwrap_err().contains("allowed: .nii"));
    folder.write("a.nii", &good);
    assert!(folder.read("a.nii", "outside = [0, 1]").unwrap_err().contains("label 1 stands there twice"));
}

proptest! {
    #[test]
    fn law_mutated_images_are_read_or_refused(
        which in 0_usize..4,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let folder = Folder::new();
        folder.write("a.raw", labels());
        folder.write("a.i33", labels());
        let (name, mut bytes) = match which {
            0 => ("a.nii", nifti(2, &labels(), false, true)),
            1 => {
                folder.pack("p", &nifti(2, &labels(), false, false));
                ("a.nii.gz", std::fs::read(folder.0.path().join("p")).unwrap())
            }
            2 => ("a.mhd", format!("{MHD}a.raw\n").into_bytes()),
            _ => ("a.h33", H33.as_bytes().to_vec()),
        };
        for (place, value) in &edits {
            let length = bytes.len();
            bytes[place.index(length)] = *value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        folder.write(name, &bytes);
        if let Ok(phantom) = folder.read(name, "") {
            let depth = phantom.optical_depth_511(&Vector3::new(-1.0, 0.001, 0.002), &Vector3::x());
            prop_assert!(depth.is_finite() && depth >= 0.0);
        }
    }
}

#[test]
fn law_the_shipped_torso_holds_the_colon() {
    let torso = Phantom::from_node(&Node::open(&models().join("phantoms/torso.toml")).unwrap()).unwrap();
    let grid = torso.grid().unwrap();
    assert_eq!(grid.size(), [150, 150, 178]);
    assert_eq!(torso.largest_attenuation_511_per_m(), 17.2);
    // than2015, section 4.4: 34.5 x 27.5 cm, to a voxel.
    let [x, y] = [Vector3::x(), Vector3::y()].map(|axis| {
        let (near, far) = torso.chord_m(&Vector3::zeros(), &axis).unwrap();
        far - near
    });
    assert!((x - 0.345).abs() < 0.005 && (y - 0.275).abs() < 0.005, "{x} {y}");
    let (tract, _) =
        load(&Node::open(&models().join("tracts/colon.toml")).unwrap(), &TractOptions::default()).unwrap();
    for i in 0..=200 {
        let place = tract.station(tract.length_m() * f64::from(i) / 200.0).position_m.coords;
        assert_eq!(torso.material_at(&place).map(|m| m.name.as_str()), Some("soft-tissue"));
    }
    let share = |name: &str| {
        let index = |v: &u8| grid.materials().get(usize::from(*v)).is_some_and(|m| m.name == name);
        grid.voxels().iter().filter(|v| index(v)).count() as f64 * 0.064e-3
    };
    // Litres: lungs of 2.5 to 6 (their ellipsoids are 1.75 each), a heart of 0.3 to 0.8, a spine of 0.7 to 1.5.
    assert!((2.5..6.0).contains(&share("lung")), "{}", share("lung"));
    assert!((0.3..0.8).contains(&share("heart")), "{}", share("heart"));
    assert!((0.7..1.5).contains(&share("bone")), "{}", share("bone"));
    // Across the abdomen as in a body of water with a spine in it.
    let depth = torso.optical_depth_511(&Vector3::new(0.0, -0.2, -0.1), &Vector3::y());
    assert!((depth - (0.096 * 23.3 + 0.172 * 4.2)).abs() < 0.05, "{depth}");
}

#[test]
fn law_an_empty_colon_is_air_and_a_small_body_is_refused() {
    let text = std::fs::read_to_string(models().join("phantoms/torso.toml")).unwrap();
    let read = |text: &str| {
        let node = Node::parse_text(text, "t.toml", &models().join("phantoms"), &[]).unwrap();
        Phantom::from_node(&node).map_err(|error| error.to_string())
    };
    let air = "voxels = [150, 150, 178]\nlumen = { name = \"air\", attenuation_511_per_cm = 0.0001 }";
    let empty = read(&text.replace("voxels = [150, 150, 178]", air)).unwrap();
    let place = Vector3::new(0.0926, -0.0034, -0.0144);
    assert_eq!(empty.material_at(&place).unwrap().name, "air");
    let message = read(&text.replace("width_mm = 345.0", "width_mm = 180.0")).unwrap_err();
    assert!(message.contains("the lumen leaves the body"), "{message}");
    for (from, to) in
        [("[150, 150, 178]", "[0, 1, 1]"), ("[150, 150, 178]", "[100000, 100000, 10]"), ("4.0", "nan")]
    {
        assert!(read(&text.replacen(from, to, 1)).is_err());
    }
}
