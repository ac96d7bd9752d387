//! Import of label volumes: tubes filled with voxels by the tests, as NIfTI and MetaImage.

use super::imports::{deviation, import, s_bend};
use lumenav_anatomy::import::{ImportError, ImportOptions, ImportedTract, RepairKind};
use lumenav_anatomy::tract_file::Axes;
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::PI;
use std::io::Write as _;

const RADIUS_M: f64 = 0.006;

/// A label image: size, columns of voxel edges (mm), middle of the first voxel (mm), numbers.
struct Image {
    size: [usize; 3],
    edges_mm: Matrix3<f64>,
    first_mm: Vector3<f64>,
    labels: Vec<u8>,
}

impl Image {
    /// Voxels whose middles lie within `RADIUS_M` of an S-bend shifted by each `shift`, which get its label.
    fn of(
        edges_mm: Matrix3<f64>,
        first_mm: Vector3<f64>,
        size: [usize; 3],
        bends: &[(Vector3<f64>, u8)],
    ) -> Self {
        let fine: Vec<Point3<f64>> = (0..=400).map(|i| s_bend(f64::from(i) / 400.0).0).collect();
        let mut labels = Vec::new();
        for index in 0..size.iter().product::<usize>() {
            let ijk = [index % size[0], index / size[0] % size[1], index / (size[0] * size[1])];
            let place = Point3::from((first_mm + edges_mm * Vector3::from(ijk.map(|n| n as f64))) * 1e-3);
            let is_in = |shift: &Vector3<f64>| fine.iter().any(|p| (p + shift - place).norm() < RADIUS_M);
            labels.push(bends.iter().find(|(shift, _)| is_in(shift)).map_or(0, |(_, label)| *label));
        }
        Self { size, edges_mm, first_mm, labels }
    }

    /// One bend with label 3 in a straight grid of 1 mm.
    fn plain() -> Self {
        Self::of(
            Matrix3::identity(),
            Vector3::new(-12.0, -12.0, -12.0),
            [105, 105, 25],
            &[(Vector3::zeros(), 3)],
        )
    }

    fn nifti(&self) -> Vec<u8> {
        let mut bytes = vec![0; 352];
        let mut put = |at: usize, part: &[u8]| bytes[at..at + part.len()].copy_from_slice(part);
        put(0, &348_i32.to_le_bytes());
        for (i, n) in [3, self.size[0], self.size[1], self.size[2], 1, 1, 1, 1].into_iter().enumerate() {
            put(40 + 2 * i, &(n as i16).to_le_bytes());
        }
        put(70, &2_i16.to_le_bytes());
        put(72, &8_i16.to_le_bytes());
        put(108, &352_f32.to_le_bytes());
        bytes[123] = 2;
        let mut put = |at: usize, part: &[u8]| bytes[at..at + part.len()].copy_from_slice(part);
        put(254, &1_i16.to_le_bytes());
        for row in 0..3 {
            let numbers = [
                self.edges_mm[(row, 0)],
                self.edges_mm[(row, 1)],
                self.edges_mm[(row, 2)],
                self.first_mm[row],
            ];
            for (column, number) in numbers.into_iter().enumerate() {
                put(280 + 16 * row + 4 * column, &(number as f32).to_le_bytes());
            }
        }
        put(344, b"n+1\0");
        bytes.extend(&self.labels);
        bytes
    }

    fn metaimage(&self) -> Vec<u8> {
        let [nx, ny, nz] = self.size;
        let (f, e) = (self.first_mm, self.edges_mm);
        let mut bytes = format!(
            "ObjectType = Image\nNDims = 3\nDimSize = {nx} {ny} {nz}\nElementSpacing = {} {} {}\nOffset = {} {} {}\n\
             ElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
            e[(0, 0)], e[(1, 1)], e[(2, 2)], f.x, f.y, f.z
        )
        .into_bytes();
        bytes.extend(&self.labels);
        bytes
    }
}

fn check(tract: &ImportedTract) {
    let (away_mm, radius_mm) = deviation(tract, RADIUS_M, 2.0 * RADIUS_M, s_bend);
    println!("length {} m, line {away_mm} mm, radius {radius_mm} mm", tract.length_m);
    // Half a voxel of 1 mm; the line is led to the wall at round ends, which lie a radius beyond the curve's.
    assert!(away_mm < 0.5 && radius_mm < 0.5, "{away_mm} {radius_mm}");
    let length_m = PI * 0.04 + 2.0 * RADIUS_M;
    assert!((tract.length_m / length_m - 1.0).abs() < 0.03, "{} of {length_m}", tract.length_m);
    assert!(tract.repairs.is_empty(), "{:?}", tract.repairs);
}

fn refused(name: &str, bytes: &[u8], options: &ImportOptions) -> String {
    let error = import(name, bytes, options).unwrap_err().to_string();
    println!("{error}");
    assert!(error.contains(name), "{error}");
    error
}

#[test]
fn closed_form_s_bend_from_nifti_and_metaimage() {
    let image = Image::plain();
    let nifti = image.nifti();
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&nifti).unwrap();
    for (name, bytes, axes) in [
        ("gut.nii", nifti, Axes::Ras),
        ("gut.NII.GZ", packed.finish().unwrap(), Axes::Ras),
        ("gut.mha", image.metaimage(), Axes::Lps),
    ] {
        let tract = import(name, &bytes, &ImportOptions::default()).unwrap();
        check(&tract);
        assert_eq!(tract.axes, axes, "{name}");
        assert!(!tract.warnings.iter().any(|warning| warning.contains("axes were not stated")), "{name}");
    }
}

#[test]
fn closed_form_oblique_and_mirrored_voxels() {
    // Edges of 0.9, 1.1 and 0.8 mm along turned axes, the first of them mirrored.
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 0.4);
    let edges_mm = turn.matrix() * Matrix3::from_diagonal(&Vector3::new(-0.9, 1.1, 0.8));
    let first_mm = turn.matrix() * Vector3::new(115.0, -45.0, -10.0);
    let image = Image::of(edges_mm, first_mm, [145, 110, 26], &[(Vector3::zeros(), 1)]);
    // Normals point outwards although the voxels are mirrored: no repair.
    check(&import("oblique.nii", &image.nifti(), &ImportOptions::default()).unwrap());
}

#[test]
fn law_several_labels_are_asked_about() {
    let beside = Vector3::new(0.0, 0.0, 0.02);
    let image = Image::of(
        Matrix3::identity(),
        Vector3::new(-12.0, -12.0, -12.0),
        [105, 105, 46],
        &[(Vector3::zeros(), 3), (beside, 5)],
    );
    let bytes = image.nifti();
    let message = refused("two.nii", &bytes, &ImportOptions::default());
    assert!(message.contains("labels 3, 5; which of them"), "{message}");
    let with = |labels: &[i64]| ImportOptions { labels: labels.to_vec(), ..ImportOptions::default() };
    check(&import("two.nii", &bytes, &with(&[3])).unwrap());
    let message = refused("two.nii", &bytes, &with(&[7]));
    assert!(message.contains("asked for labels 7; there are: 3, 5"), "{message}");
    // Both are the lumen: then it is in two components.
    let message = refused("two.nii", &bytes, &with(&[3, 5]));
    assert!(message.contains("2 parts that do not meet"), "{message}");
}

#[test]
fn law_bad_volumes_are_refused_in_words() {
    let options = ImportOptions::default();
    let whole = Image::plain().nifti();
    assert!(refused("cut.nii", &whole[..whole.len() / 2], &options).contains("cut"));
    assert!(refused("short.nii", &whole[..100], &options).contains("no NIfTI-1 header"));
    let with = |at: usize, number: f32| {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        bytes
    };
    // An edge, a place, the slope of the numbers.
    assert!(refused("edge.nii", &with(280, f32::NAN), &options).contains("voxels of no size"));
    assert!(refused("place.nii", &with(292, f32::NAN), &options).contains("from its origin"));
    assert!(refused("slope.nii", &with(112, f32::NAN), &options).contains("no number"));
    // The second edge along the first.
    let mut flat = with(284, 1.0);
    flat[300..304].copy_from_slice(&0_f32.to_le_bytes());
    assert!(refused("flat.nii", &flat, &options).contains("lie in one plane"));
    let nothing = Image { labels: vec![0; 105 * 105 * 25], ..Image::plain() };
    assert!(refused("nothing.nii", &nothing.nifti(), &options).contains("no label but 0"));
    // Micrometres written as millimetres and the reverse: asked about.
    for scale in [1e-3, 30.0] {
        let mut image = Image::plain();
        image.edges_mm *= scale;
        image.first_mm *= scale;
        let message = refused("unit.nii", &image.nifti(), &options);
        assert!(message.contains("which unit"), "{message}");
    }
}

#[test]
fn law_broken_volumes_never_panic() {
    for (name, bytes) in [("a.nii", Image::plain().nifti()), ("b.mha", Image::plain().metaimage())] {
        for n in 0..60 {
            let mut broken = bytes.clone();
            // A fixed walk over the header: each place gets another byte.
            let place = (n * 37 + 11 * n * n) % 352;
            broken[place] = broken[place].wrapping_add((1 + 5 * n) as u8);
            let end = if n % 4 == 0 { broken.len() - n * broken.len() / 80 } else { broken.len() };
            match import(name, &broken[..end], &ImportOptions::default()) {
                Ok(tract) => assert!(tract.length_m.is_finite()),
                Err(error) => assert!(error.to_string().contains(name), "{error}"),
            }
        }
    }
}

#[test]
fn law_axes_that_the_user_states_win() {
    let options = ImportOptions { axes: Some(Axes::Ras), ..ImportOptions::default() };
    let tract = import("gut.mha", &Image::plain().metaimage(), &options).unwrap();
    assert_eq!(tract.axes, Axes::Ras);
    assert!(!tract.repairs.iter().any(|repair| repair.kind == RepairKind::Inverted));
    let error = import("gut.mha", b"NDims = 2\n", &options).unwrap_err();
    assert!(matches!(error, ImportError::Volume { .. }), "{error}");
}
